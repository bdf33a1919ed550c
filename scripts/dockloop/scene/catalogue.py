"""What can be set and read in a scene: keys of its files, variables of its FMU.

No FMU is built: keys come from the schemas and the files, variables from the one table that the
core makes for the scene.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from dockloop.base import schema
from dockloop.base.errors import UsageError, did_you_mean
from dockloop.native.core import core_errors, name_source, to_json
from dockloop.native.variables import Variable, fits, list_names, read_variables
from dockloop.scene.find import find_mechanism, find_scene, read_mechanism, read_toml
from dockloop.scene.placement import read_placed
from dockloop.scene.resolve import (
    LISTS,
    apply_override,
    entry_members,
    expand_paths,
    find_entries,
    find_member,
    has_contact_law,
    list_keys,
    set_member,
)

_KINDS = {  # headings of the list, in its order
    "scene key": "Keys of the scene: --scene NAME=VALUE, scene files, sweeps",
    "mechanism key": "Numbers of the mechanism: --scene NAME=VALUE, scene files, sweeps",
    "parameter": "Parameters: --set NAME=VALUE, sweeps",
    "input": "Inputs: --set NAME=VALUE for their start, then at every communication point",
    "output": "Outputs",
    "local": "States and their rates, for model exchange",
}


@dataclass(frozen=True)
class Entry:
    """One thing that can be set or read.

    Attributes:
        name: as commands, files and Python take it.
        kind: a key of `_KINDS`.
        unit: of the value as it is written.
        default: what it is in this scene unless it is set; None: nothing, or it is computed.
        limits: ``> 0``, ``0 to 2``; empty: any value.
        choices: names that can be given instead of a number.
        set_by: option of the commands that sets it: ``--scene``, ``--set``, or nothing.
        meaning: one line.
    """

    name: str
    kind: str
    unit: str
    default: Any
    limits: str
    choices: tuple[str, ...]
    set_by: str
    meaning: str


def list_entries(
    reference: str,
    overrides: Sequence[str] = (),
    patterns: Sequence[str] = (),
    *,
    has_states: bool = False,
) -> list[Entry]:
    """List what can be set and read in a scene.

    Args:
        reference: name or path of the scene.
        overrides: ``KEY=VALUE`` texts, as given to ``--scene``.
        patterns: only names that one of them fits (``*`` stands for anything), or that contain it.
        has_states: with the local variables of the FMU: integrated states and their rates.

    Raises:
        UsageError: the scene is bad, or a pattern fits nothing.
    """
    path = find_scene(reference)
    document = read_placed(path, overrides, say=lambda _: None)
    scene, _ = read_toml(path)
    for text in overrides:
        apply_override(scene, text)
    with core_errors() as core:
        docking = core.Docking(to_json(document), name_source(path))
    variables = [_describe_variable(v) for v in read_variables(docking).values()]
    starts = {entry.name: entry.default for entry in variables}
    keys = [*_list_keys(scene, document, starts), *_list_entries(scene)]
    entries = [*keys, *_list_mechanism(scene, path), *variables]
    if not has_states:
        entries = [entry for entry in entries if entry.kind != "local"]
    if not patterns:
        return entries
    for pattern in patterns:
        if not any(fits(entry.name, pattern) for entry in entries):
            names = [entry.name for entry in entries]
            raise UsageError(
                f"{path.stem}: nothing is called '{pattern}'{did_you_mean(pattern, names)}"
            )
    return [entry for entry in entries if any(fits(entry.name, p) for p in patterns)]


def to_document(reference: str, entries: list[Entry]) -> dict:
    """Return the list for programs: ``name``, ``unit``, ``range``, ``default``, ``meaning``, ..."""
    rows = []
    for entry in entries:
        members = asdict(entry)
        first = {key: members.pop(key) for key in ("name", "unit")}
        rows.append({**first, "range": members.pop("limits"), **members})
    return {"scene": reference, "variables": rows}


def describe(entries: list[Entry]) -> str:
    """Return the list for people: a heading for each kind, a line for each name."""
    lines: list[str] = []
    for kind, heading in _KINDS.items():
        chosen = [entry for entry in entries if entry.kind == kind]
        if not chosen:
            continue
        lines += ["", f"{heading} ({len(chosen)})", ""]
        names = max(len(entry.name) for entry in chosen)
        values = [_say_value(entry) for entry in chosen]
        width = min(24, max(map(len, values)))
        for entry, value in zip(chosen, values, strict=True):
            about = "; ".join(filter(None, (_say_limits(entry), entry.meaning)))
            lines.append(f"  {entry.name:{names}}  {value:{width}}  {about}".rstrip())
    return "\n".join(lines[1:])


def _say_value(entry: Entry) -> str:
    """Return default and unit: ``0.1 m``."""
    value = entry.default
    text = "" if value is None else f"{value:.6g}" if isinstance(value, float) else _as_text(value)
    unit = "" if entry.unit == "1" else entry.unit
    return f"{text} {unit}".strip() if text else f"[{unit}]" if unit else ""


def _as_text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _say_limits(entry: Entry) -> str:
    if entry.choices and entry.kind == "scene key":  # a description of the FMU has the names
        return "one of " + ", ".join(entry.choices)
    return entry.limits


def _list_keys(scene: dict, document: dict, starts: dict[str, Any]) -> Iterator[Entry]:
    """Yield the keys of a scene file.

    Args:
        scene: what the file says.
        document: what follows from it.
        starts: start values of the variables, by name.
    """
    law = {"friction_model": starts.get("friction.model")}
    mechanism = document["mechanism"]
    law |= mechanism.get("contact", {}).get("law", {})
    takes = {"contact": has_contact_law(mechanism), "sequence": "sequence" in mechanism}
    for name, node in list_keys(scene).items():
        section, _, member = name.partition(".")
        if not takes.get(section, True):
            continue
        values = [find_member(scene, name.split(".")), node.get("default"), starts.get(name)]
        if section == "contact":
            values.append(law.get(member))
        elif section != "initial" and member:  # values of [initial] are converted
            values.append(document.get(section, {}).get(member))
        default = next((value for value in values if value is not None), None)
        entry = _describe_key(name, "scene key", node, default)
        if isinstance(default, int) and 1 <= default <= len(entry.choices):
            entry = replace(entry, default=entry.choices[default - 1])
        yield entry


def _list_entries(scene: dict) -> Iterator[Entry]:
    """Yield the members of the entries of the lists that a scene has."""
    for prefix in LISTS:
        for number, entry in enumerate(find_entries(scene, prefix), 1):
            for member, node in entry_members(prefix).items():
                value = entry.get(member, node.get("default"))
                yield _describe_key(f"{prefix}{number}.{member}", "scene key", node, value)


def _describe_key(name: str, kind: str, node: dict, default: Any) -> Entry:
    """Return the entry of a key from its node of the schema."""
    return Entry(
        name,
        kind,
        node.get("unit", ""),
        default,
        _find_limits(node),
        tuple(choice for choice in node.get("enum", ()) if isinstance(choice, str)),
        "--scene",
        node.get("description", ""),
    )


def _list_mechanism(scene: dict, path: Path) -> Iterator[Entry]:
    """Yield the numbers of the mechanism file, as ``mechanism.set`` takes them."""
    if "mechanism" not in scene:
        return
    root = schema.load_schema("mechanism")
    file = find_mechanism(scene["mechanism"]["name"], path)
    mechanism = read_mechanism(file)
    for dotted, value in expand_paths(mechanism, scene["mechanism"].get("set", {}), "").items():
        set_member(mechanism, dotted, value, file, dotted)

    def follow(node: Any) -> dict:
        return {**schema.resolve(node, root), **node} if isinstance(node, dict) else {}

    def walk(value: Any, node: dict, name: str, law: str = "") -> Iterator[Entry]:
        if isinstance(value, dict):
            known = schema.known_members(node, root, value)
            for key, child in value.items():
                yield from walk(child, follow(known.get(key)), f"{name}.{key}", law)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            item = follow(node.get("items"))
            for number, child in enumerate(value, 1):
                kind = child.get("type", "") if name.endswith(".laws") else law
                yield from walk(child, item, f"{name}.{child.get('name', number)}", kind)
        elif not isinstance(value, str) and not name.endswith(".comment"):
            is_comment = isinstance(value, list) and any(isinstance(v, str) for v in value)
            entry = _describe_key(name, "mechanism key", node, value)
            if not is_comment:
                yield replace(entry, meaning=f"{law}: {entry.meaning}") if law else entry
            columns = follow(node.get("items")).get("prefixItems", ())
            for row, numbers in enumerate(value if columns else (), 1):
                for column, (number, inner) in enumerate(zip(numbers, columns, strict=True), 1):
                    yield from walk(number, follow(inner), f"{name}.{row}.{column}", law)

    yield from walk(mechanism, root, "mechanism.set")


def _describe_variable(variable: Variable) -> Entry:
    """Return the entry of a variable of the FMU."""
    names = list_names(variable.name, variable.description)
    default: Any = variable.start
    for name, number in names.items():
        if variable.start is not None and number == variable.start:
            default = name
    low, high = variable.minimum, variable.maximum
    limits = "" if names and variable.type == "Integer" else _say_range(low, high)
    return Entry(
        variable.name,
        variable.causality,
        variable.unit,
        default,
        limits,
        tuple(names),
        "--set" if variable.start is not None else "",
        variable.description,
    )


def _find_limits(node: dict) -> str:
    """Say the limits that a schema gives a number."""
    if "exclusiveMinimum" in node:
        high = node.get("maximum", node.get("exclusiveMaximum"))
        above = f"> {node['exclusiveMinimum']:g}"
        return above if high is None else f"{above}, at most {high:g}"
    low = node.get("minimum", -math.inf)
    if "exclusiveMaximum" in node:
        return f">= {low:g}, < {node['exclusiveMaximum']:g}"
    return _say_range(low, node.get("maximum", math.inf))


def _say_range(low: float, high: float) -> str:
    """Say the limits of a variable, both inclusive."""
    if math.isinf(low) and math.isinf(high):
        return ""
    if math.isinf(high):
        return f">= {low:g}"
    return f"<= {high:g}" if math.isinf(low) else f"{low:g} to {high:g}"
