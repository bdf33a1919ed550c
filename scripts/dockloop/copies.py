"""``dockloop new NAME``: a shipped scene and its mechanism as files of the user's own.

The copies stand next to each other under one name, so the scene finds its mechanism, and a change
of either needs no other file. Comments stay.
"""

import json
import re
from pathlib import Path
from typing import Any

from dockloop.errors import UsageError
from dockloop.outputs import Kind, write_text
from dockloop.paths import read_text, shown
from dockloop.scene import (
    find_mechanism,
    find_scene,
    read_mechanism,
    read_toml,
    resolve_scene,
    to_text,
)


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
    for file in texts:
        if file.exists():
            raise UsageError(f"{shown(file)}: is there already; take another name or -o FOLDER")
    for file, content in texts.items():
        write_text(file, Kind("file", "dockloop new", lambda _: False), content)
    resolve_scene(next(iter(texts)))
    return list(texts)


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
    header = re.search(rf"^[ \t]*\[[ \t]*{section}[ \t]*\][^\n]*$", text, re.MULTILINE)
    if not header:
        return f"{text.rstrip()}\n\n[{section}]\n{line}\n"
    after = re.search(r"^[ \t]*\[", text[header.end() :], re.MULTILINE)
    end = header.end() + after.start() if after else len(text)
    body = text[header.end() : end]
    pattern = rf"^([ \t]*){member}[ \t]*=[ \t]*[^#\n]*?([ \t]*(?:#[^\n]*)?)$"
    changed, count = re.subn(pattern, lambda m: m[1] + line + m[2], body, count=1, flags=re.M)
    body = changed if count else f"\n{line}{body}"
    return text[: header.end()] + body + text[end:]
