"""The page of the file formats, modelDescription/FORMATS.md, from the schemas.

``python -m dockloop.scene.formats`` writes the page. A member of a schema is a row: unit, value,
default, meaning, example. The schemas have three keywords of their own: ``unit``; ``otherwise``,
what holds without a member whose default is no value; ``examples`` is that of JSON Schema.
"""

import json
from collections.abc import Iterator
from typing import Any

from dockloop.base.paths import MODELS
from dockloop.base.schema import load_schema
from dockloop.base.sections import Section, write_table

PAGE = MODELS / "FORMATS.md"
FILES = {
    "scene": ("Scene files", "TOML"),
    "mechanism": ("Mechanism files", "JSON"),
    "sweep": ("Sweep files", "TOML"),
}
HEAD = """# Formats of scene, mechanism and sweep files

`python -m dockloop.scene.formats` writes this page from `modelDescription/*.schema.json`. Do not
edit the page.

A section describes one group of members. `bodies[]` stands for each entry of the list `bodies`. A
member with the default *required* must be there. A member without default can be left out and then
has no effect. Every group of a mechanism file may have a `comment`.
"""
HEADS = ("member", "unit", "value", "default", "meaning", "example")
_VALUES = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
    "null": "null",
    "object": "group",
    "array": "list",
}


def make_page() -> str:
    """Return the page as text."""
    parts = [HEAD]
    for name, (title, language) in FILES.items():
        root = load_schema(name)
        parts.append(f"## {title} ({language})\n\n{_sentence(root['description'])}\n")
        for section in _list_sections(name):
            heading = f"`{section.title}`" if section.title else "top level"
            parts.append(f"### {name}: {heading}\n")
            if section.text:
                parts.append(f"{section.text}\n")
            if section.table:
                parts.append("\n".join(write_table([HEADS, *section.table])) + "\n")
    return "\n".join(parts)


def list_members(name: str) -> Iterator[tuple[str, dict, bool]]:
    """Yield path, schema and "is required" of every member of a format.

    Args:
        name: ``scene``, ``mechanism`` or ``sweep``.
    """
    for title, node, known in _list_groups(name):
        for member, child in _properties(node, load_schema(name)).items():
            if member not in known:
                path = f"{title}.{member}" if title else member
                yield path, _merge(child, load_schema(name)), member in node.get("required", [])


def _list_sections(name: str) -> list[Section]:
    root = load_schema(name)
    sections = []
    for title, node, known in _list_groups(name):
        rows = [
            _row(member, _merge(child, root), member in node.get("required", []))
            for member, child in _properties(node, root).items()
            if member not in known and member != "comment"
        ]
        text = _sentence(node.get("description", "")) if title else ""
        text = " ".join(part for part in (text, _describe_known(node, known, root)) if part)
        if rows or known:
            sections.append(Section(title, text, rows))
    return sections


def _list_groups(name: str) -> Iterator[tuple[str, dict, dict[str, str]]]:
    """Yield every group: title, schema, and members of a group before, with its title."""
    root = load_schema(name)
    seen: dict[str, str] = {}

    def walk(title: str, given: dict) -> Iterator[tuple[str, dict, dict[str, str]]]:
        node = _merge(given, root)
        known: dict[str, str] = {}
        for reference in _references(given, root):
            if reference in seen:
                members = _properties(root["$defs"][reference], root)
                known |= dict.fromkeys(members, seen[reference])
            else:
                seen[reference] = title
        yield title, node, known
        for member, child in _properties(node, root).items():
            if member not in known:
                yield from below(f"{title}.{member}" if title else member, child)
        for value, alternative in _alternatives(node):
            yield from walk(f"{title} ({value})", alternative)

    def below(title: str, child: dict) -> Iterator[tuple[str, dict, dict[str, str]]]:
        merged = _merge(child, root)
        if "items" in merged and _is_group(_merge(merged["items"], root)):
            yield from walk(f"{title}[]", merged["items"])
        elif isinstance(merged.get("additionalProperties"), dict):
            if _is_group(_merge(merged["additionalProperties"], root)):
                yield from walk(f"{title}.NAME", merged["additionalProperties"])
        elif _is_group(merged):
            yield from walk(title, child)

    yield from walk("", root)


def _describe_known(node: dict, known: dict[str, str], root: dict) -> str:
    """Return which members a group shares with one before."""
    if not known:
        return ""
    text = f"As `{next(iter(known.values()))}`"
    return text + "." if len(_properties(node, root)) == len(known) else f"{text}, and:"


def _is_group(node: dict) -> bool:
    return "value" not in node and ("properties" in node or "if" in node)


def _references(node: dict, root: dict) -> list[str]:
    """Names of the definitions that a node refers to, through each other."""
    names = []
    while "$ref" in node:
        names.append(node["$ref"].rsplit("/", 1)[1])
        node = root["$defs"][names[-1]]
    return names


def _merge(node: dict, root: dict) -> dict:
    """Return a node with what it refers to; its own words win."""
    merged: dict[str, Any] = {}
    for name in reversed(_references(node, root)):
        merged |= root["$defs"][name]
    merged |= {key: value for key, value in node.items() if key != "$ref"}
    merged["properties"] = _properties(node, root)
    if not merged["properties"]:
        del merged["properties"]
    return merged


def _properties(node: dict, root: dict) -> dict[str, dict]:
    """Members of a group without those of its alternatives."""
    members = dict(node.get("properties", {}))
    for name in _references(node, root):
        members = root["$defs"][name].get("properties", {}) | members
    return {name: child for name, child in members.items() if isinstance(child, dict)}


def _alternatives(node: dict) -> Iterator[tuple[str, dict]]:
    """Yield condition and schema of the alternatives of a group."""
    listed = node.get("properties", {}).get("type", {}).get("enum", [])
    while "if" in node:
        if "required" in node["if"]:
            members = " and ".join(node["if"]["required"])
            yield f"with {members}", node["then"]
            yield f"without {members}", node["else"]
            return
        condition = node["if"]["properties"]["type"]
        values = condition.get("enum", [condition.get("const")])
        if "$ref" in node.get("then", {}) or "properties" in node.get("then", {}):
            yield f"type {' or '.join(values)}", node["then"]
        listed = [value for value in listed if value not in values]
        node = node.get("else", {})
        if "$ref" in node or "properties" in node:
            yield f"type {' or '.join(listed)}", node
            return


def _row(member: str, node: dict, is_required: bool) -> tuple[str, ...]:
    if "default" in node:
        default = f"`{json.dumps(node['default'])}`"
    elif "otherwise" in node:
        default = node["otherwise"]
    else:
        default = "*required*" if is_required else ""
    examples = [f"`{json.dumps(example)}`" for example in node.get("examples", [])]
    cells = (
        f"`{member}`",
        node.get("unit", ""),
        _describe_value(node),
        default,
        node.get("description", ""),
        ", ".join(examples),
    )
    return tuple(cell.replace("\n", " ") for cell in cells)


def _describe_value(node: dict) -> str:
    """Return which values a member can have."""
    if "value" in node:
        return node["value"]
    if "enum" in node:
        values = node["enum"]
        names = [value for value in values if not isinstance(value, int)]
        numbers = values[len(names) :]
        if names and len(numbers) > 2:
            return ", ".join(f"`{name}`" for name in names) + f", `{numbers[0]}` to `{numbers[-1]}`"
        return ", ".join(f"`{value}`" for value in values)
    types = node.get("type", "object" if _is_group(node) else [])
    types = [types] if isinstance(types, str) else types
    if types == ["array"]:
        return _describe_list(node)
    text = " or ".join(_VALUES[name] for name in types)
    limits = [
        f"{word} {node[key]:g}"
        for key, word in (
            ("exclusiveMinimum", "above"),
            ("minimum", "at least"),
            ("exclusiveMaximum", "below"),
            ("maximum", "at most"),
        )
        if key in node
    ]
    return f"{text} {' and '.join(limits)}".strip() if limits else text


def _describe_list(node: dict) -> str:
    least, most = node.get("minItems"), node.get("maxItems")
    items = node.get("items", {})
    if "enum" in items:
        return "list of " + _describe_value(items)
    kind = items.get("type", "")
    plural = {"number": "numbers", "string": "texts"}.get(kind if isinstance(kind, str) else "", "")
    reference = items.get("$ref", "")
    if reference.endswith(("vector", "point")):
        plural = "lists of 3 numbers" if reference.endswith("vector") else "points"
    count = f"{least} " if least is not None and least == most else ""
    return f"{count}{plural}".strip() if count and plural else f"list of {plural or 'entries'}"


def _sentence(text: str) -> str:
    text = text.strip()
    return text if not text or text.endswith(".") else f"{text[0].upper()}{text[1:]}."


def main() -> None:
    """Write the page."""
    PAGE.write_text(make_page(), encoding="utf-8")


if __name__ == "__main__":
    main()
