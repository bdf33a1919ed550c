"""Scene, mechanism and sweep files against their JSON Schemas, with errors people can act on.

The schemas are part of the project (``modelDescription/*.schema.json``) and document every member.
An error says which file, which member, its value and the limit, in one sentence.
"""

import json
import math
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from dockloop.errors import UsageError, did_you_mean
from dockloop.paths import MODELS, shown

_NAMED_TYPES = {
    "object": "a group of members",
    "array": "a list",
    "number": "a number",
    "integer": "a whole number",
    "string": "a text",
    "boolean": "true or false",
}


@cache
def load_schema(name: str) -> dict:
    """Return ``modelDescription/NAME.schema.json`` for ``scene``, ``mechanism`` or ``sweep``."""
    return json.loads((MODELS / f"{name}.schema.json").read_text())


@cache
def _make_validator(name: str) -> Any:
    import jsonschema

    return jsonschema.Draft202012Validator(load_schema(name))


def member_path(path: tuple | list) -> str:
    """Return ``bodies[1].joint.axis`` for ``("bodies", 0, "joint", "axis")``.

    Counted from 1, like the variables of an FMU and the messages of the C++ core.
    """
    text = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.lstrip(".")


def check(document: Any, schema_name: str, source: Path) -> None:
    """Check a document against a schema.

    Args:
        document: what was read from the file.
        schema_name: ``scene``, ``mechanism`` or ``sweep``.
        source: the file, for the message.

    Raises:
        UsageError: naming file, member, value and limit of the most telling violation.
    """
    for path, value in _numbers(document):
        if not math.isfinite(value):
            raise UsageError(f"{shown(source)}: {member_path(path)} is {value}: must be finite")
    schema = load_schema(schema_name)
    errors = list(_make_validator(schema_name).iter_errors(document))
    if errors:
        # A violation inside a group makes its "unevaluated" rule fail too: the deepest is meant.
        error = max(errors, key=lambda e: (len(e.absolute_path), "Properties" not in e.validator))
        owner = _owner(document, error.absolute_path)
        raise UsageError(f"{shown(source)}: {_sentence(error, schema)}{owner}")


def known_members(node: dict, root: dict, instance: Any = None) -> dict[str, dict]:
    """Collect the members that a schema node allows, through references and alternatives.

    Args:
        node: schema of an object.
        root: the whole schema, for references.
        instance: the object itself; chooses between alternatives by its member ``type``.

    Returns:
        Member name to its schema.
    """
    members = dict(node.get("properties", {}))
    if "$ref" in node:
        members |= known_members(resolve(node, root), root, instance)
    if "if" in node:
        condition = node["if"]["properties"]["type"]
        wanted = condition.get("enum", [condition.get("const")])
        is_then = isinstance(instance, dict) and instance.get("type") in wanted
        members |= known_members(node.get("then" if is_then else "else", {}), root, instance)
    return members


def resolve(node: dict, root: dict) -> dict:
    """Follow a local reference of a schema node, if it is one."""
    while set(node) & {"$ref"} and not set(node) & {"properties", "if"}:
        node = root["$defs"][node["$ref"].rsplit("/", 1)[1]]
    if "$ref" in node:
        target = root["$defs"][node["$ref"].rsplit("/", 1)[1]]
        merged = {**target.get("properties", {}), **node.get("properties", {})}
        return {**target, "properties": merged}
    return node


def _owner(document: Any, path: Iterable) -> str:
    """Return `` (in 'ring')`` for a path that leads through a list entry with that name."""
    owner, node = "", document
    for part in path:
        node = node[part]
        if isinstance(part, int) and isinstance(node, dict) and isinstance(node.get("name"), str):
            owner = f" (in '{node['name']}')"
    return owner


def _numbers(node: Any, path: tuple = ()) -> Iterator[tuple[tuple, float]]:
    """Yield path and value of every floating-point number in a document."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _numbers(value, (*path, key))
    elif isinstance(node, list):
        for index, value in enumerate(node):
            yield from _numbers(value, (*path, index))
    elif isinstance(node, float):
        yield path, node


def _sentence(error: Any, root: dict) -> str:
    """Say what a schema violation means, without the vocabulary of schemas."""
    path = member_path(error.absolute_path)
    where = path or "the document"
    value, limit = error.instance, error.validator_value
    shown_value = json.dumps(value) if len(json.dumps(value, default=str)) < 60 else "what it is"
    match error.validator:
        case "required":
            missing = next(name for name in limit if name not in value)
            return f"{where} lacks the member '{missing}'"
        case "additionalProperties" | "unevaluatedProperties":
            known = known_members(error.schema, root, value)
            extra = next((name for name in value if name not in known), "?")
            return f"{where} has an unknown member '{extra}'{did_you_mean(extra, known)}"
        case "exclusiveMinimum":
            return f"{where} is {shown_value}: must be greater than {limit}"
        case "minimum":
            return f"{where} is {shown_value}: must be at least {limit}"
        case "exclusiveMaximum":
            return f"{where} is {shown_value}: must be less than {limit}"
        case "maximum":
            return f"{where} is {shown_value}: must be at most {limit}"
        case "minItems" | "maxItems":
            exact = error.schema.get("minItems") == error.schema.get("maxItems")
            few = "" if exact else "at least " if error.validator == "minItems" else "at most "
            return f"{where} has {len(value)} entries: must have {few}{limit}"
        case "minLength":
            return f"{where} is empty"
        case "uniqueItems":
            return f"{where} lists an entry twice"
        case "enum":
            choices = ", ".join(str(choice) for choice in limit)
            near = did_you_mean(value, map(str, limit)) if isinstance(value, str) else ""
            return f"{where} is {shown_value}: must be one of {choices}{near}"
        case "type":
            types = [limit] if isinstance(limit, str) else limit
            wanted = " or ".join(_NAMED_TYPES[name] for name in types)
            return f"{where} is {shown_value}: must be {wanted}"
    return f"{where}: {error.message}"
