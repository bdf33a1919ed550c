"""Calls the compiled program ``dockloop-core``, which knows mechanisms and FMU variables.

Three of its commands are used: ``check`` (is a mechanism sound), ``place`` (start states from
conditions at first contact) and ``describe`` (modelDescription.xml).
"""

import subprocess
from pathlib import Path

from dockloop import paths
from dockloop.errors import DockloopError, UsageError
from dockloop.paths import shown


def run_core(command: str, file: Path, *options: str, source: Path | None = None) -> str:
    """Run one command of dockloop-core.

    Args:
        command: ``check``, ``place`` or ``describe``.
        file: the file it reads.
        options: further arguments.
        source: the file people know, if `file` was made from it; named in errors instead.

    Returns:
        What the program prints.

    Raises:
        UsageError: the file is bad.
        DockloopError: the program is missing or failed.
    """
    if not paths.CORE.exists():
        raise DockloopError(
            f"{shown(paths.CORE)} is not there: build it with scripts/demo, scripts/test or"
            " 'cmake --preset release && cmake --build --preset release'"
        )
    done = subprocess.run(
        [paths.CORE, command, file, *options], capture_output=True, text=True, check=False
    )
    if done.returncode == 0:
        return done.stdout
    lines = done.stderr.strip().splitlines() or [
        f"dockloop-core {command} ended with status {done.returncode} and no message"
    ]
    text = lines[-1].removeprefix("dockloop-core: ").removeprefix("error: ")
    if source is not None:
        text = text.replace(str(file), shown(source))
    if shown(source or file) not in text:
        text = f"{shown(source or file)}: {text}"
    raise (UsageError if done.returncode == UsageError.exit_status else DockloopError)(text)
