"""Makes the kernel of a scene's mechanism: straight-line C from dockloop-kernel, compiled here.

What a kernel is and when an FMU uses it: ``src/mechanism/README.md``. The compiled one is kept in
``build/kernels`` under the hash of its source: most scenes that are built share a mechanism.
"""

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dockloop.base import paths
from dockloop.base.errors import DockloopError, UsageError, find_reason, warn_once
from dockloop.base.files import Kind, scratch, writing
from dockloop.fmu.binaries import find_platform
from dockloop.native.compiled import find_compiled, find_optional
from dockloop.native.core import has_only_legs, to_json

FLAGS = [
    # Vectors of two, and another order of instructions, cost more than they save here, measured.
    *("-O2", "-fno-tree-slp-vectorize", "-fno-schedule-insns2"),
    *("-fno-math-errno", "-ffp-contract=off"),
    *("-shared", "-fPIC", "-s"),
]
_STDIN = "/dev/stdin"
_KEPT = Kind("kernel", "dockloop build", lambda path: path.parent.samefile(paths.KERNELS))


@dataclass
class Kernel:
    """What came of it: entries of the FMU (none without a kernel), and one line that says why."""

    note: str
    entries: dict[str, bytes] = field(default_factory=dict)


def find_compiler() -> list[str]:
    """Return the command of a C compiler (``CC`` decides if it is set), or nothing.

    Raises:
        UsageError: what ``CC`` says is no command.
    """
    names = [os.environ["CC"]] if "CC" in os.environ else ["cc", "gcc", "clang"]
    for name in names:
        try:
            command = shlex.split(name)
        except ValueError as error:
            raise UsageError(f"CC is '{name}': must be a command ({error})") from None
        if command and shutil.which(command[0]):
            return command
    return []


def make_kernel(document: dict, needed: bool) -> Kernel:
    """Make the kernel of a resolved scene for the platform at hand, if that is possible.

    Args:
        document: the resolved scene, as FMUs hold it.
        needed: make one also where the core has a kernel of its own.
    """
    folder = find_platform() if platform.system() == "Linux" else None
    compiler = find_compiler()
    if not folder:
        return Kernel(f"none: not made on {platform.system()} {platform.machine()}")
    if not compiler:
        return Kernel("none: no C compiler was found (cc, gcc, clang or what CC names)")
    source, said = _write(document, needed)
    if not source:
        return Kernel(f"none: {said}")
    key = hashlib.sha256(f"{compiler} {FLAGS}\n{source}".encode()).hexdigest()[:32]
    library = paths.KERNELS / f"{key}.so"
    try:
        content = library.read_bytes() if library.exists() else _compile(compiler, source, library)
    except DockloopError as error:
        if not needed:
            warn_once(f"goes on without generated code: {error}")
        return Kernel(f"none: {error}")
    return Kernel(f"{said}, by {compiler[0]}", {f"resources/kernels/{folder}/kernel.so": content})


def _write(document: dict, needed: bool) -> tuple[str, str]:
    """Write the source of a kernel; returns it and one line about it, or an empty text and why."""
    if not needed and has_only_legs(document, Path(document["name"])):
        return "", "its legs have fast code in the library, so none is generated"
    if needed:
        find_compiled(paths.GENERATOR)
    elif obstacle := find_optional(paths.GENERATOR):
        return "", obstacle
    written = subprocess.run(
        [paths.GENERATOR, "scene", _STDIN],
        input=to_json(document),
        capture_output=True,
        text=True,
        check=False,
    )
    said = written.stderr.strip()
    if written.returncode != 0:
        return "", said.replace(f"{_STDIN}: ", "")
    return written.stdout, said


def _compile(compiler: list[str], source: str, library: Path) -> bytes:
    """Compile C into a shared library, kept for the next time. Raises DockloopError."""
    command = [*compiler, *FLAGS, "-o", "kernel.so", "kernel.c", "-lm"]
    with scratch() as folder:
        (folder / "kernel.c").write_text(source, encoding="utf-8")
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        except OSError as error:
            raise DockloopError(f"{compiler[0]} cannot be run ({find_reason(error)})") from None
        if done.returncode != 0:
            said = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise DockloopError(f"{compiler[0]} failed: {said}")
        content = (folder / "kernel.so").read_bytes()
    with suppress(DockloopError), writing(library, _KEPT) as partial:
        partial.write_bytes(content)  # a folder that cannot be written keeps nothing
    return content
