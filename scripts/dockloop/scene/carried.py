"""The scene that an FMU carries, or a file of its own."""

import json
from pathlib import Path
from typing import Any, BinaryIO

from dockloop.base.errors import UsageError, find_reason
from dockloop.base.files import read_entry
from dockloop.base.paths import check_file, shown
from dockloop.scene.resolve import FORMAT

MODEL = "resources/model.json"


def read_model(path: Path | BinaryIO) -> dict:
    """Read the resolved scene that an FMU of this program carries.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no such FMU; the text says why.
    """
    try:
        document = json.loads(read_entry(path, MODEL))
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError):
        raise ValueError(f"its {MODEL} is no JSON document") from None
    if not _is_scene(document):
        raise ValueError(f"its {MODEL} is no scene of dockloop")
    return document


def is_docking(fmu: Path | BinaryIO) -> bool:
    """Return whether an FMU is one of this program, with a mechanism."""
    try:
        mechanism = read_model(fmu)["mechanism"]
    except (OSError, ValueError, KeyError):
        return False
    return bool(mechanism != {"name": "none"})


def is_document(path: Path) -> bool:
    """Return whether a file holds the scene of an FMU. Raises ValueError, OSError."""
    return _is_scene(json.loads(path.read_bytes()))


def _is_scene(document: Any) -> bool:
    members = document if isinstance(document, dict) else {}
    name = members.get("name")
    return members.get("format") == FORMAT and isinstance(name, str) and name.isidentifier()


def read_scene(path: Path) -> dict:
    """Return the scene of an FMU of this program. Raises UsageError: it is none."""
    check_file(path, "FMU")
    try:
        return read_model(path)
    except OSError as error:
        raise UsageError(f"{shown(path)}: cannot be read ({find_reason(error)})") from None
    except ValueError as error:
        raise UsageError(f"{shown(path)}: is no FMU built by dockloop ({error})") from None
