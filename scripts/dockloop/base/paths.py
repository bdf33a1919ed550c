"""Where things are: model files, what was compiled, where results go.

In a clone the package is used as it stands in ``scripts/`` (``pip install -e``): compiled parts are
those of the C++ build, in ``build/release`` or in the folder that ``DOCKLOOP_BUILD`` names, for
example ``build/asan-ubsan``. An installed package carries all of it in its folder ``data``. Results
go to ``build`` below the present folder, in a clone too.
"""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from dockloop.base.errors import UsageError, find_reason

_DATA = Path(__file__).resolve().parents[1] / "data"
IS_INSTALLED = _DATA.is_dir()
ROOT = _DATA if IS_INSTALLED else _DATA.parents[2]
MODELS = ROOT / "modelDescription"
SCENES = MODELS / "scenes"
MECHANISMS = MODELS / "mechanisms"
SWEEPS = MODELS / "sweeps"
BUILD = Path("build") if IS_INSTALLED else ROOT / "build"
RESULTS = Path("build")  # below the present folder, unless a command is given another place
COMPILED = ROOT / "bin" if IS_INSTALLED else BUILD / "release"
COMPILED = Path(os.environ.get("DOCKLOOP_BUILD", COMPILED))
LIBRARY = COMPILED / "dockloop.so"
COMPARE = COMPILED / "dockloop-compare"  # this and the next two: see compiled.py
COMPARE_LIBRARY = COMPILED / "dockloop_compare.so"
GENERATOR = COMPILED / "dockloop-kernel"
KERNELS = BUILD / "kernels"  # compiled ones, by the hash of their source
PLATFORMS = (ROOT if IS_INSTALLED else ROOT / "build") / "platforms"  # made by scripts/platforms
SCRATCH: set[Path] = set()  # temporary folders in use
OUTSIDE = ROOT / "build" / "deps" / "source"  # of the outside packages, for portable binaries


def shown(path: Path | str) -> str:
    """Return a path as people want to read it: relative when it is below the current folder.

    Of what this process wrote for itself, a scene that was given as a group, the name is enough.
    """
    path = Path(path)
    if any(path.is_relative_to(folder) for folder in tuple(SCRATCH)):
        return path.name
    try:
        return str(Path(os.path.normpath(Path.cwd() / path)).relative_to(Path.cwd()))
    except (ValueError, OSError):  # elsewhere; there is no current folder
        return str(path)


def is_file(path: Path) -> bool:
    """Return whether a file is there; what cannot be one, such as a name too long, is not."""
    try:
        return path.is_file()
    except OSError:
        return False


def next_to(file: Path, name: str | Path) -> Path:
    """Return a file next to another one; where it is not, next to what a link leads to."""
    here, there = file.parent / name, file.resolve().parent / name
    return there if is_file(there) and not is_file(here) else here


def name_kind(name: str) -> str:
    """Say what a name that was not found is: a folder, another shipped file; else nothing."""
    with suppress(OSError):
        if Path(name).is_dir():
            return " (it is a folder)"
    for folder, what in ((SCENES, "scene"), (MECHANISMS, "mechanism"), (SWEEPS, "sweep")):
        if any(is_file(folder / f"{name}{suffix}") for suffix in (".toml", ".json")):
            return f" (it is the name of a {what})"
    return ""


def as_path(place: str, value: Any) -> Path:
    """Return the path that an argument of Python is; `place` names it. Raises UsageError."""
    if not isinstance(value, str | os.PathLike):
        raise UsageError(f"{place} is {value!r}: must be the path of a file")
    return Path(value)


def check_file(path: Path, what: str) -> None:
    """Refuse a path where no file is; `what` is what was looked for. Raises UsageError."""
    if is_file(path):
        return
    wrong = f"no such {what}"
    with suppress(OSError):
        if path.is_dir():
            wrong = f"is a folder, no {what}"
        elif path.is_symlink():
            wrong = f"is a link to nothing, no {what}"
    raise UsageError(f"{shown(path)}: {wrong}")


def read_text(path: Path) -> str:
    """Read a file that people edit; the byte order mark that some editors write is left out."""
    return path.read_text(encoding="utf-8-sig")


def read_bytes(path: Path, what: str, most: int = -1) -> bytes:
    """Read a file that the user names, or its first bytes; `what` is what was looked for.

    Raises:
        UsageError: it is not there, or cannot be read.
    """
    check_file(path, what)
    try:
        with path.open("rb") as file:
            return file.read(most)
    except OSError as error:
        raise UsageError(f"{shown(path)}: cannot be read ({find_reason(error)})") from None
