"""Where scenes and mechanisms are, and how their files are read."""

import json
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dockloop.base.errors import UsageError, did_you_mean, find_reason
from dockloop.base.paths import (
    MECHANISMS,
    SCENES,
    check_file,
    is_file,
    name_kind,
    next_to,
    read_text,
    shown,
)
from dockloop.scene.patterns import open_lists


def find_shipped(reference: str, kind: str, folder: Path) -> Path:
    """Find a scene or a sweep by name (among the shipped ones) or by path. Raises UsageError.

    Args:
        reference: the name, or the path, which ends in ``.toml``.
        kind: ``scene`` or ``sweep``.
        folder: of the shipped ones.
    """
    path = Path(reference)
    if path.suffix != ".toml":
        shipped = folder / f"{reference}.toml"
        if not is_file(shipped):
            names = [file.stem for file in sorted(folder.glob("*.toml"))]
            if is_file(path):
                raise UsageError(f"{reference}: is no {kind}: {kind} files end in .toml")
            near = name_kind(reference) or did_you_mean(reference, names)
            raise UsageError(
                f"no {kind} '{reference}' in {shown(folder)}{near}:"
                f" there are {', '.join(names)}; a {kind} of your own is given by its path,"
                " ending in .toml"
            )
        path = shipped
    check_file(path, f"{kind} file")
    return path


def find_scene(reference: str) -> Path:
    """Find a scene by name (among the shipped ones) or by path.

    Raises:
        UsageError: there is none, or its name cannot name an FMU.
    """
    path = find_shipped(reference, "scene", SCENES)
    if not re.fullmatch(r"[A-Za-z_]\w*", path.stem, re.ASCII):
        raise UsageError(
            f"{shown(path)}: the file name becomes the name of the FMU, so it must consist of"
            " letters, digits and _ and not begin with a digit"
        )
    return path


def find_mechanism(name: str, scene_path: Path) -> Path:
    """Find a mechanism next to a scene, or else among the shipped ones. Raises UsageError."""
    for file in (next_to(scene_path, f"{name}.json"), MECHANISMS / f"{name}.json"):
        if is_file(file):
            return file
    names = sorted({f.stem for f in MECHANISMS.glob("*.json")})
    raise UsageError(
        f"{shown(scene_path)}: mechanism.name is '{name}': there is no {name}.json next to the"
        f" scene or in {shown(MECHANISMS)}{did_you_mean(name, names)}"
    )


def read_mechanism(path: Path) -> dict:
    """Read a mechanism file; the document may stand alone or under the key "mechanism"."""
    document = read_json(path)
    if isinstance(document, dict):
        document = get_mechanism(document)
    if not isinstance(document, dict):
        raise UsageError(f"{shown(path)}: is no mechanism, but {type(document).__name__}")
    open_lists(document)
    return document


def get_mechanism(document: dict) -> Any:
    """Return the mechanism of a document: all of it, or a member and the home pose next to it."""
    mechanism = document.get("mechanism", document)
    if isinstance(mechanism, dict) and "home_q" in document:
        return {"home_q": document["home_q"], **mechanism}
    return mechanism


def read_json(path: Path) -> Any:
    """Read a JSON file. Raises UsageError."""
    with reading(path, "JSON", "groups"):
        return parse_json(read_text(path))


class _Repeated(dict):
    """An object of a JSON file that has a key twice."""

    key: str


def parse_json(text: str) -> Any:
    """Parse JSON. Raises ValueError, also where an object has a key twice."""
    if text.lstrip().startswith("<"):
        raise ValueError("but XML: 'dockloop import' reads MJCF, URDF and SDF")
    repeated: list[_Repeated] = []

    def make_object(pairs: list[tuple[str, Any]]) -> dict:
        members = dict(pairs)
        if len(members) == len(pairs):
            return members
        names = [name for name, _ in pairs]
        found = _Repeated(members)
        found.key = next(name for name in members if names.count(name) > 1)
        repeated.append(found)
        return found

    document = json.loads(text, object_pairs_hook=make_object)
    if repeated:
        raise ValueError(f"the member {_find_repeated(document)} is there twice")
    return document


def _find_repeated(node: Any, path: str = "") -> str:
    """Return the path of the first key that is there twice; empty: there is none."""
    if isinstance(node, _Repeated):
        return f"{path}.{node.key}".lstrip(".")
    entries: Any = ()
    if isinstance(node, dict):
        entries = ((f"{path}.{name}", child) for name, child in node.items())
    elif isinstance(node, list):
        entries = ((f"{path}[{number}]", child) for number, child in enumerate(node, 1))
    return next(filter(None, (_find_repeated(child, where) for where, child in entries)), "")


@contextmanager
def reading(path: Path, language: str, parts: str) -> Iterator[None]:
    """Say what is wrong with a file that cannot be read or parsed."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"{shown(path)}: cannot be read ({find_reason(error)})") from None
    except ValueError as error:
        raise UsageError(f"{shown(path)}: is not {language} ({error})") from None
    except RecursionError:
        raise UsageError(f"{shown(path)}: lists and {parts} are nested too deeply") from None


def read_toml(path: Path) -> tuple[dict, str]:
    """Read a TOML file; returns what it says, and its text. Raises UsageError."""
    with reading(path, "TOML", "tables"):
        text = read_text(path)
        return tomllib.loads(text), text
