"""Copies of scenes: ``dockloop new NAME``, and copies with other numbers.

``dockloop new`` copies a shipped scene and its mechanism. The copies stand next to each other under
one name, so the scene finds its mechanism, and a change of either needs no other file. Comments
stay.
"""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

from dockloop.base.errors import UsageError
from dockloop.base.files import Kind, write_text, writing
from dockloop.base.paths import is_file, next_to, read_text, shown
from dockloop.scene.find import find_mechanism, find_scene, read_mechanism, read_toml
from dockloop.scene.resolve import resolve_scene, split_key
from dockloop.scene.tables import list_files
from dockloop.scene.values import to_text


def copy_scene(reference: str, name: str, folder: Path) -> list[Path]:
    """Copy a scene and its mechanism.

    Args:
        reference: name of a shipped scene, or path of a scene file.
        name: of both copies, without an ending.
        folder: where they are written; made if it is not there.

    Returns:
        The files: the scene, and the mechanism if the scene has one.

    Raises:
        UsageError: there is no such scene, the name cannot be that of an FMU, or a file is there
            already.
        DockloopError: a file cannot be written.
    """
    if not (name.isascii() and name.isidentifier()):
        raise UsageError(
            f"new {name}: the name becomes that of an FMU: take letters, digits and _, and begin"
            " with a letter"
        )
    source = find_scene(reference)
    scene, text = read_toml(source)
    texts = {folder / f"{name}.toml": text}
    if "mechanism" in scene:
        mechanism = find_mechanism(scene["mechanism"]["name"], source)
        texts = {
            folder / f"{name}.toml": set_key(text, "mechanism", "name", name),
            folder / f"{name}.json": _rename(mechanism, name),
        }
    tables = dict(_list_tables(scene, source, folder))
    for file in (*texts, *tables):
        if file.exists():
            raise UsageError(f"{shown(file)}: is there already; take another name or -o FOLDER")
    kind = Kind("file", "dockloop new", lambda _: False)
    for file, content in texts.items():
        write_text(file, kind, content)
    for file, table in tables.items():
        with writing(file, kind) as partial:
            partial.write_bytes(table.read_bytes())
    resolve_scene(next(iter(texts)))
    return [*texts, *tables]


def _list_tables(scene: dict, source: Path, folder: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the copy of each table that a scene or its mechanism names, and the table."""
    owners = [(source, list_files(scene))]
    if "mechanism" in scene:
        mechanism = find_mechanism(scene["mechanism"]["name"], source)
        owners.append((mechanism, list_files({"mechanism": read_mechanism(mechanism)})))
    for owner, entries in owners:
        for name in (entry["file"] for entry in entries):
            table, copy = next_to(owner, name), folder / name
            if is_file(table) and copy.resolve() != table.resolve():
                yield copy, table


def write_copy(
    reference: str, keys: Mapping[str, Any], path: Path, kind: Kind, *, begin: str, note: str
) -> None:
    """Write a copy of a scene with some keys set; what it means is checked before.

    Args:
        reference: name or path of the scene.
        keys: values by name, such as ``solver.rtol`` or ``mechanism.set.contact.damping``.
        path: the copy.
        kind: of the file.
        begin: beginning of the first line of such copies; that of a copy of a copy is replaced.
        note: the rest of this line.

    Raises:
        UsageError: the file is there and of something else, its mechanism is not found there, or a
            key cannot be set in this file.
        DockloopError: it cannot be written.
    """
    text = make_copy(reference, keys, path)
    if text.startswith(begin):
        text = text.partition("\n")[2]
    write_text(path, kind, f"{begin} ({note})\n{text}")
    resolve_scene(path)


def make_copy(reference: str, keys: Mapping[str, Any], path: Path) -> str:
    """Return the text of a copy of a scene for `path`; nothing is written. Raises: `write_copy`."""
    source = find_scene(reference)
    resolve_scene(source)
    text = read_text(source)
    find_mechanism(tomllib.loads(text)["mechanism"]["name"], path)
    places = {name: split_key(name) for name in keys}
    for name, value in keys.items():
        *_, member = places[name]
        bare = member.replace("_", "").isalnum()
        text = set_key(
            text, ".".join(places[name][:-1]), member if bare else to_text(member), value
        )
    for name, value in keys.items():
        try:
            found = reduce(getitem, places[name], tomllib.loads(text))
        except (ValueError, LookupError, TypeError):
            found = None
        if found != value:
            raise UsageError(f"{shown(source)}: {name} cannot be set in this file: set it there")
    return text


def _rename(mechanism: Path, name: str) -> str:
    """Return the text of a mechanism file with its name set; everything else stays."""
    old = json.dumps(read_mechanism(mechanism).get("name"))
    pattern = rf'("name"\s*:\s*){re.escape(old)}'
    return re.sub(pattern, lambda m: m[1] + json.dumps(name), read_text(mechanism), count=1)


def describe(files: list[Path]) -> str:
    """Say what was written, and what to do next."""
    names = [shown(file) for file in files]
    lines = [f"{' and '.join(names)} written", "next:"]
    if len(names) > 1:
        lines.append(f"  dockloop check {names[1]}      what the mechanism is, as text or drawing")
    lines += [
        f"  dockloop variables {names[0]}  all that can be set and read",
        f"  dockloop run {names[0]} --view",
    ]
    return "\n".join(lines)


def set_key(text: str, section: str, member: str, value: Any) -> str:
    """Return a TOML text with one key set; comments and everything else stay."""
    line = f"{member} = {to_text(value)}"
    header = re.search(rf"^[ \t]*\[[ \t]*{re.escape(section)}[ \t]*\][^\n]*$", text, re.MULTILINE)
    if not header:
        return f"{text.rstrip()}\n\n[{section}]\n{line}\n"
    after = re.search(r"^[ \t]*\[", text[header.end() :], re.MULTILINE)
    end = header.end() + after.start() if after else len(text)
    body = text[header.end() : end]
    pattern = rf"^([ \t]*){re.escape(member)}[ \t]*=[ \t]*[^#\n]*?([ \t]*(?:#[^\n]*)?)$"
    changed, count = re.subn(pattern, lambda m: m[1] + line + m[2], body, count=1, flags=re.M)
    body = changed if count else f"\n{line}{body}"
    return text[: header.end()] + body + text[end:]
