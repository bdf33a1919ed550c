"""Where things are: the project, its model files, what was compiled, where results go.

The package is used from a clone (``pip install -e``), so everything is found relative to this file.
``DOCKLOOP_BUILD`` names another compiled tree, for example ``build/asan-ubsan``.
"""

import os
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
GENERATOR = COMPILED / "dockloop-kernel"
KERNELS = BUILD / "kernels"  # compiled ones, by the hash of their source
PLATFORMS = BUILD / "platforms"  # made by scripts/platforms
OUTSIDE = BUILD / "deps" / "source"  # sources of the outside packages, for portable binaries


def shown(path: Path | str) -> str:
    """Return a path as people want to read it: relative when it is below the current folder."""
    path = Path(path)
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)
