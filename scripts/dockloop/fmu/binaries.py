"""The compiled library of the FMU for every platform, and whether it is up to date.

``scripts/platforms`` builds them into ``build/platforms/PLATFORM`` and stores next to each the
fingerprint of the sources it was built from. A library of other sources than the present ones is
never packed.
"""

import hashlib
import os
from pathlib import Path
from platform import machine, system

from dockloop.base import paths
from dockloop.base.errors import warn

STAMP = "sources.sha256"
EXTENSIONS = {
    "linux64": ".so",
    "win64": ".dll",
    "aarch64-linux": ".so",
    "darwin64": ".dylib",
    "aarch64-darwin": ".dylib",
}
_MACHINES = {
    ("Linux", "x86_64"): "linux64",
    ("Linux", "aarch64"): "aarch64-linux",
    ("Windows", "AMD64"): "win64",
    ("Darwin", "x86_64"): "darwin64",
    ("Darwin", "arm64"): "aarch64-darwin",
}


def fingerprint() -> str:
    """Return a hash of everything of this project that the library is compiled from."""
    files = [paths.ROOT / "CMakeLists.txt", paths.ROOT / "fmu" / "exports.map"]
    for folder in ("src", "fmu"):
        files += (paths.ROOT / folder).rglob("*.[ch]pp")
    total = hashlib.sha256()
    for file in sorted(files):
        content = hashlib.sha256(file.read_bytes()).hexdigest()
        total.update(f"{file.relative_to(paths.ROOT).as_posix()} {content}\n".encode())
    return total.hexdigest()


def portable_library(platform: str) -> Path:
    """Return where the portable library of a platform is, or would be."""
    return paths.PLATFORMS / platform / f"dockloop{EXTENSIONS[platform]}"


def find_platform() -> str | None:
    """Return the platform of this machine; None if no library is built for it."""
    return _MACHINES.get((system(), machine()))


def find_loadable(folder: Path, name: str) -> str | None:
    """Return the library of an unpacked FMU for this machine.

    None if there is none; FMPy then looks for one itself. FMPy knows only linux64 and darwin64,
    whatever the processor.
    """
    here = find_platform()
    library = folder / "binaries" / here / f"{name}{EXTENSIONS[here]}" if here else None
    return str(library.absolute()) if library and library.exists() else None


def find_libraries() -> dict[str, Path]:
    """Return the library to pack for every platform that has one, by folder name.

    The portable one where there is one of the present sources, else for linux64 the native one
    (always that one when ``DOCKLOOP_BUILD`` names another compiled tree). Warns about those that
    are left out since the sources have changed.
    """
    libraries, stale = {}, []
    if paths.LIBRARY.exists():
        libraries["linux64"] = paths.LIBRARY
    present = None
    for platform in EXTENSIONS:
        library = portable_library(platform)
        if not library.exists() or (platform == "linux64" and "DOCKLOOP_BUILD" in os.environ):
            continue
        if paths.IS_INSTALLED:  # a wheel holds one library, of the sources of its module
            libraries[platform] = library
            continue
        stamp = library.with_name(STAMP)
        present = present or fingerprint()
        if stamp.exists() and stamp.read_text().strip() == present:
            libraries[platform] = library
        else:
            stale.append(platform)
    if stale:
        warn(
            "portable binaries of other sources than the present ones are left out; to build them"
            f" again: scripts/platforms {' '.join(stale)}"
        )
    return libraries


if __name__ == "__main__":
    print(fingerprint())
