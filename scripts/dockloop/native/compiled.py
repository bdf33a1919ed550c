"""Compiled parts that few commands need: built when one of them is first asked for.

`scripts/demo` compiles what every docking needs. The methods for comparison (``dockloop trade`` and
``dockloop truth``) and the generator of kernels are targets of the same build folder.
"""

import os
import re
import shutil
import subprocess
import zipfile
from contextlib import suppress
from pathlib import Path

from dockloop.base import paths
from dockloop.base.errors import DockloopError, say, warn, warn_once
from dockloop.base.files import scratch
from dockloop.native.core import run_program

TARGETS = {
    paths.COMPARE: "dockloop-compare",
    paths.COMPARE_LIBRARY: "dockloop_compare_fmu",
    paths.GENERATOR: "dockloop-kernel",
}
_OPTION = "DOCKLOOP_COMPARE:BOOL=ON"


def find_compiled(*files: Path) -> list[Path]:
    """Return compiled parts, built now if one is missing or older than the core.

    Args:
        files: keys of `TARGETS`.

    Raises:
        DockloopError: one is missing and cannot be built here.
    """
    if all(_is_current(file) for file in files):
        return list(files)
    missing = [file for file in files if not file.exists()]
    obstacle = _find_obstacle()
    if obstacle and not missing:
        return list(files)
    if obstacle:
        raise DockloopError(
            f"{paths.shown(missing[0])} is not there, and {obstacle} build it in a clone with"
            " scripts/demo and 'cmake -DDOCKLOOP_COMPARE=ON build/release && cmake --build"
            f" build/release --target {TARGETS[missing[0]]}'"
        )
    import fcntl  # not on Windows, where no clone compiles

    with (paths.COMPILED / "compiled.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # another process may build the same
        stale = [file for file in files if not _is_current(file)]
        if stale:
            _build([TARGETS[file] for file in stale])
            for file in stale:  # the build may have found nothing to change
                file.touch()
    return list(files)


def find_optional(file: Path) -> str:
    """Return an empty text if a compiled part is there or could be built, else why not.

    A failure is a warning, once: it is kept next to the part until the core is compiled again.

    Args:
        file: key of `TARGETS` that a command can do without.
    """
    kept = file.with_suffix(".failed")
    if not _is_current(file) and _is_current(kept):
        return kept.read_text(encoding="utf-8")
    try:
        find_compiled(file)
    except DockloopError as error:
        warn_once(f"goes on without {file.name}: {error}")
        with suppress(OSError):
            kept.write_text(str(error), encoding="utf-8")
        return str(error)
    return ""


def add_comparison(fmu: Path) -> None:
    """Replace library and description of an FMU by those with the methods for comparison.

    Where these cannot be compiled the FMU stays as it is, with a warning: it refuses such methods.
    """
    try:
        program, library = find_compiled(paths.COMPARE, paths.COMPARE_LIBRARY)
    except DockloopError as error:
        warn(f"methods for comparison are left out: {error}")
        return
    with zipfile.ZipFile(fmu) as archive:
        entries = {info: archive.read(info) for info in archive.infolist()}
    with scratch() as folder:
        model = folder / "model.json"
        for info, content in entries.items():
            if info.filename == "resources/model.json":
                model.write_bytes(content)
        date = "1980-01-01T00:00:00Z"
        description = run_program(program, "describe", model, "--date", date)
    with zipfile.ZipFile(fmu, "w") as archive:
        for info, content in entries.items():
            if info.filename == "modelDescription.xml":
                archive.writestr(info, description)
            elif info.filename.startswith("binaries/linux64/"):
                archive.writestr(info, library.read_bytes())
            elif not info.filename.startswith("binaries/"):  # other platforms have no such library
                archive.writestr(info, content)


def _is_current(file: Path) -> bool:
    core = paths.COMPILED / "libdockloop_core.a"
    if not file.exists():
        return False
    return not core.exists() or file.stat().st_mtime >= core.stat().st_mtime


def _find_obstacle() -> str:
    """Say why nothing can be compiled here, with what follows from it; empty if it can."""
    folder, cache = paths.shown(paths.COMPILED), paths.COMPILED / "CMakeCache.txt"
    if not cache.exists():
        return f"{folder} is no build folder:"
    made = re.search("^CMAKE_CACHEFILE_DIR:INTERNAL=(.*)", cache.read_text("utf-8"), re.MULTILINE)
    if made and os.path.realpath(made[1]) != os.path.realpath(paths.COMPILED):
        return f"{folder} was made as {made[1]}, then moved or copied: remove {folder} and"
    if not os.access(paths.COMPILED, os.W_OK):
        return f"{folder} cannot be written:"
    return "" if shutil.which("cmake") else "there is no cmake:"


def _build(targets: list[str]) -> None:
    say(f"compiling {', '.join(targets)} (once)")
    folder, commands = str(paths.COMPILED), []
    if _OPTION not in (paths.COMPILED / "CMakeCache.txt").read_text(encoding="utf-8"):
        commands.append(["cmake", "-DDOCKLOOP_COMPARE=ON", folder])
    commands.append(["cmake", "--build", folder, "--target", *targets])
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = (done.stdout + done.stderr).strip().splitlines() or ["no message"]
            errors = [line for line in said if "error" in line] or said[-1:]
            raise DockloopError(f"'{' '.join(command)}' failed: {errors[0].strip()}")
