"""Calls the compiled program ``dockloop-core``, which knows mechanisms and FMU variables.

Its commands are ``check`` (is a mechanism sound), ``place`` (start states from conditions at first
contact), ``describe`` (modelDescription.xml), ``methods`` (their list) and ``kernel`` (has the core
a kernel for a scene); ``batch`` (many runs) is called by `dockloop.batch`. A second program,
``dockloop-compare``, has ``truth`` (a run with 32 digits) and ``describe`` with all methods.
"""

import json
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

from dockloop import paths
from dockloop.errors import DockloopError, UsageError
from dockloop.paths import shown


def find_core() -> Path:
    """Return the program. Raises DockloopError if it is missing."""
    if not paths.CORE.exists():
        raise DockloopError(
            f"{shown(paths.CORE)} is not there: build it with scripts/demo, scripts/test or"
            " 'cmake --preset release && cmake --build --preset release'"
        )
    return paths.CORE


def run_core(
    command: str,
    file: Path,
    *options: str,
    source: Path | None = None,
    progress: Callable[[float], None] | None = None,
    program: Path | None = None,
) -> str:
    """Run one command of dockloop-core.

    Args:
        command: ``check``, ``place``, ``describe``, ``kernel`` or ``truth``.
        file: the file it reads.
        options: further arguments.
        source: the file people know, if `file` was made from it; named in errors instead.
        progress: told the part that is done, 0 to 1 (``truth`` says it, in lines of its own).
        program: instead of dockloop-core.

    Returns:
        What the program prints.

    Raises:
        UsageError: the file is bad.
        DockloopError: the program is missing or failed.
    """
    program, lines = program or find_core(), []
    with (
        subprocess.Popen(
            [program, command, file, *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="surrogateescape",  # as in the names of files
        ) as process,
        ThreadPoolExecutor(1) as pool,
    ):
        printed = pool.submit(process.stdout.read)
        for line in process.stderr:
            if not line.startswith("progress "):
                lines += [line.strip()] if line.strip() else []
            elif progress:
                done, of = line.split()[1:]
                progress(int(done) / int(of))
    if process.returncode == 0:
        return printed.result()
    if not lines:
        lines = [f"{program.name} {command} ended with status {process.returncode} and no message"]
    text = lines[-1].removeprefix("dockloop-core: ").removeprefix("error: ")
    if source is not None:
        text = text.replace(str(file), shown(source))
    named = any(text.startswith(f"{option}: ") for option in options)  # a second file
    if not named and shown(source or file) not in text:
        text = f"{shown(source or file)}: {text}"
    raise (UsageError if process.returncode == UsageError.exit_status else DockloopError)(text)


def ask_core(command: str, file: Path, *options: str, **more: Any) -> Any:
    """Run one command of dockloop-core that prints JSON; returns what that says, see `run_core`."""
    printed = run_core(command, file, *options, **more)
    try:
        return json.loads(printed)
    except ValueError as error:
        raise DockloopError(f"{command} printed what is no JSON document ({error})") from None


@cache
def list_methods() -> tuple[dict, ...]:
    """Return the methods of integration that the core lists, each with ``number`` and ``name``."""
    done = subprocess.run([find_core(), "methods"], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise DockloopError(f"{shown(paths.CORE)} lists no methods: build it again")
    return tuple(json.loads(done.stdout))
