"""Where things are: the project, its model files, what was compiled, where results go.

The package is used from a clone (``pip install -e``), so everything is found relative to this file.
``DOCKLOOP_BUILD`` names another compiled tree, for example ``build/asan-ubsan``.
"""

import os
from contextlib import suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "modelDescription"
SCENES = MODELS / "scenes"
MECHANISMS = MODELS / "mechanisms"
SWEEPS = MODELS / "sweeps"
BUILD = ROOT / "build"
COMPILED = Path(os.environ.get("DOCKLOOP_BUILD", BUILD / "release"))
CORE = COMPILED / "dockloop-core"
LIBRARY = COMPILED / "dockloop.so"
COMPARE = COMPILED / "dockloop-compare"  # this and the next two: see compiled.py
COMPARE_LIBRARY = COMPILED / "dockloop_compare.so"
GENERATOR = COMPILED / "dockloop-kernel"
KERNELS = BUILD / "kernels"  # compiled ones, by the hash of their source
PLATFORMS = BUILD / "platforms"  # made by scripts/platforms
OUTSIDE = BUILD / "deps" / "source"  # sources of the outside packages, for portable binaries


def shown(path: Path | str) -> str:
    """Return a path as people want to read it: relative when it is below the current folder."""
    path = Path(path)
    try:
        return str(Path(os.path.normpath(Path.cwd() / path)).relative_to(Path.cwd()))
    except (ValueError, OSError):  # elsewhere; there is no current folder
        return str(path)


def is_file(path: Path) -> bool:
    """Tell whether a file is there; what cannot be one, such as a name too long, is not."""
    try:
        return path.is_file()
    except OSError:
        return False


def find_absence(path: Path, what: str) -> str:
    """Say of a path where no file is what is wrong with it; `what` is what was looked for."""
    wrong = f"no such {what}"
    with suppress(OSError):
        if path.is_dir():
            wrong = f"is a folder, no {what}"
        elif path.is_symlink():
            wrong = f"is a link to nothing, no {what}"
    return f"{shown(path)}: {wrong}"
