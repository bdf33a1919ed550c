"""Scene, mechanism and sweep files against their JSON Schemas, with errors people can act on.

The schemas are part of the project (``modelDescription/*.schema.json``) and document every member.
An error says which file, which member, its value and the limit, in one sentence.
"""

import contextlib
import copy
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.paths import MODELS, shown

_KEPT = 1000  # kinds of documents that a checker remembers
_NAMED_TYPES = {
    "object": "a group of members",
    "array": "a list",
    "number": "a number",
    "integer": "a whole number",
    "string": "a text",
    "boolean": "true or false",
    "null": "null",
}


@cache
def load_schema(name: str) -> dict:
    """Return ``modelDescription/NAME.schema.json`` for ``scene``, ``mechanism`` or ``sweep``."""
    return json.loads((MODELS / f"{name}.schema.json").read_text(encoding="utf-8"))


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
        UsageError: naming file, member, value and limit of the most helpful violation.
    """
    if found := find_violation(document, schema_name):
        raise UsageError(f"{shown(source)}: {found.sentence}")


class Violation(NamedTuple):
    """What is wrong with a document: the member, and a sentence that begins with it."""

    path: tuple
    sentence: str


def find_violation(document: Any, schema_name: str) -> Violation | None:
    """Return the most helpful violation of a schema, or None; arguments as for `check`."""
    root = load_schema(schema_name)
    try:
        for path, value in _numbers(document):
            if (wrong := _find_limit(value)) is not None:
                return Violation(path, f"{member_path(path)} {wrong}")
        errors = list(_make_validator(schema_name).iter_errors(document))
    except RecursionError:
        return Violation((), "lists and groups are nested too deeply")
    if not errors:
        return None
    # A violation inside a group makes its "unevaluated" rule fail too: the deepest is meant.
    error = max(errors, key=lambda e: (len(e.absolute_path), "Properties" not in e.validator))
    if error.validator == "required":
        error = _find_misspelt(error, errors, root) or error
    path, extra = tuple(error.absolute_path), tuple[str, ...]()
    if "Properties" in error.validator:
        extra = (_find_extra(error, root),)
    return Violation((*path, *extra), _sentence(error, root) + _owner(document, path))


class Checker:
    """Checks documents that differ by numbers only: the first one as a whole, then these numbers.

    A number is checked by the rules of its member alone: no schema of this project lets a number
    decide which rules other members have.
    """

    def __init__(self, schema_name: str) -> None:
        """Prepare to check against a schema; its name is that of `check`."""
        self._name = schema_name
        self._rules: dict[tuple, list[Any]] = {}

    def find_violation(self, document: Any, changes: Mapping[tuple, Any]) -> Violation | None:
        """Do the work of `find_violation`.

        Args:
            document: as there.
            changes: all in which documents of this checker differ: values by their paths.
        """
        numbers = {path: v for path, v in changes.items() if type(v) in (int, float)}
        others = [item for item in changes.items() if item[0] not in numbers]
        rules = self._rules.get(kind := (*numbers, repr(others)))
        if rules is not None and all(
            _find_limit(value) is None and rule.is_valid(value)
            for value, rule in zip(numbers.values(), rules, strict=True)
        ):
            return None
        found = find_violation(document, self._name)
        if found is None:
            if len(self._rules) == _KEPT:
                self._rules.clear()
            with contextlib.suppress(LookupError):  # a later change has removed a member
                self._rules[kind] = [self._make_rule(document, path) for path in numbers]
        return found

    def _make_rule(self, document: Any, path: tuple) -> Any:
        """Return the validator of one member of a document."""
        root = load_schema(self._name)
        node = root
        for part in path:
            inner = resolve(node, root)
            if isinstance(part, int):
                node = inner["prefixItems"][part] if "prefixItems" in inner else inner["items"]
            else:
                others = inner.get("additionalProperties")
                node = known_members(node, root, document).get(part, others or {})
            document = document[part]
        return _make_validator(self._name).evolve(schema=node)


def known_members(node: dict, root: dict, instance: Any = None) -> dict[str, dict]:
    """Collect the members that a schema node allows, through references and alternatives.

    Args:
        node: schema of an object.
        root: the whole schema, for references.
        instance: the object itself; chooses between alternatives by its member ``type``, or by
            members that one alternative requires.

    Returns:
        Member name to its schema.
    """
    members = dict(node.get("properties", {}))
    if "$ref" in node:
        members |= known_members(resolve(node, root), root, instance)
    if "if" in node:
        branch = "then" if _holds(node["if"], instance) else "else"
        members |= known_members(node.get(branch, {}), root, instance)
    return members


def list_defaults(name: str, *path: str) -> dict[str, Any]:
    """Return the defaults of the members of an object, by member.

    Args:
        name: ``scene``, ``mechanism`` or ``sweep``.
        path: of the object from the top of a file, such as ``"initial", "capture_body"``.
    """
    root = load_schema(name)
    node = root
    for part in path:
        node = known_members(node, root)[part]
    return {
        member: copy.deepcopy(child["default"])
        for member, child in known_members(node, root).items()
        if "default" in child
    }


def _holds(condition: dict, instance: Any) -> bool:
    """Return whether an object has the members, and the values of members, of a condition."""
    if not isinstance(instance, dict):
        return False
    wanted = {
        name: rule.get("enum", [rule.get("const")])
        for name, rule in condition.get("properties", {}).items()
    }
    return all(name in instance for name in condition.get("required", [])) and all(
        instance.get(name) in values for name, values in wanted.items()
    )


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


def _find_misspelt(lack: Any, errors: list, root: dict) -> Any:
    """Return the violation by a name that could be meant for what a group lacks, or None."""
    missing = _find_missing(lack)
    for error in errors:
        if "Properties" in error.validator and error.absolute_path == lack.absolute_path:
            known = known_members(error.schema, root, error.instance)
            extra = [name for name in error.instance if name not in known]
            if any(did_you_mean(name, [missing]) for name in extra):
                return error
    return None


def _find_missing(error: Any) -> str:
    """Return the member that a group lacks."""
    return next(name for name in error.validator_value if name not in error.instance)


def _find_extra(error: Any, root: dict) -> str:
    """Return the first member of a group that is unknown."""
    known = known_members(error.schema, root, error.instance)
    return next((name for name in error.instance if name not in known), "?")


def _find_limit(value: float) -> str | None:
    """Say what is wrong with a number that cannot be computed with; None if nothing is."""
    try:
        return None if math.isfinite(value) else f"is {value}: must be finite"
    except OverflowError:
        return "is too large: must be below 1e308"


def _numbers(node: Any, path: tuple = ()) -> Iterator[tuple[tuple, float]]:
    """Yield path and value of every number in a document."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _numbers(value, (*path, key))
    elif isinstance(node, list):
        for index, value in enumerate(node):
            yield from _numbers(value, (*path, index))
    elif isinstance(node, float | int):
        yield path, node


def _sentence(error: Any, root: dict) -> str:
    """Say what a schema violation means, without the vocabulary of schemas."""
    path = member_path(error.absolute_path)
    where = path or "the document"
    value, limit = error.instance, error.validator_value
    text = json.dumps(value, default=str)  # TOML has dates
    long = {"{": "a group of members", "[": "a list"}.get(text[0], f"{text[:50]}...")
    shown_value = text if len(text) < 60 else long
    match error.validator:
        case "required":
            return f"{where} lacks the member '{_find_missing(error)}'"
        case "additionalProperties" | "unevaluatedProperties":
            known, extra = known_members(error.schema, root, value), _find_extra(error, root)
            near = did_you_mean(extra, known) or f": must be one of {', '.join(known)}"
            return f"{where} has an unknown member '{extra}'{near}"
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
            names = [choice for choice in limit if isinstance(choice, str)]  # numbers mean the same
            choices = ", ".join(str(choice) for choice in names or limit)
            near = did_you_mean(value, map(str, limit)) if isinstance(value, str) else ""
            return f"{where} is {shown_value}: must be one of {choices}{near}"
        case "pattern":
            return f"{where} is {shown_value}: must be a number or {limit.strip('^$')}"
        case "type":
            types = [limit] if isinstance(limit, str) else limit
            wanted = " or ".join(_NAMED_TYPES[name] for name in types)
            return f"{where} is {shown_value}: must be {wanted}"
    return f"{where}: {error.message}"
