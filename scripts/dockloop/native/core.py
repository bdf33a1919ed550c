"""Calls what is compiled: the module ``dockloop._core``, and programs that few commands need.

The module is part of an installed package; in a clone the C++ build makes it
(`dockloop.base.paths`). Documents go to it as text, never as files. A refusal becomes one sentence
that begins with the name of the file.
"""

import json
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from dockloop.base.errors import DockloopError, UsageError, one_line, without_function
from dockloop.base.paths import shown

FULL, REFERENCE = "reduced", "reference"  # levels of the model: of FMUs the last one; without loops


def load_core() -> ModuleType:
    """Return the compiled module. Raises DockloopError if it is missing or cannot be loaded."""
    try:
        from dockloop import _core
    except ImportError as error:
        raise DockloopError(
            f"the compiled module dockloop._core cannot be loaded ({error}): build it with"
            " scripts/demo, scripts/test or 'cmake --preset release && cmake --build --preset"
            " release'"
        ) from None
    return _core


@contextmanager
def core_errors(source: Path | None = None) -> Iterator[ModuleType]:
    """Yield the compiled module; its errors become those of this package.

    Refusals name the file `source`, if there is one.

    Raises:
        UsageError: the core refused a document, a variable or a value.
        DockloopError: the module is missing, or a step failed.
    """
    core = load_core()
    try:
        yield core
    except core.ModelError as error:
        said, name = without_function(str(error)), name_source(source) if source else ""
        raise UsageError(said if said.startswith(name) else f"{name}: {said}") from None
    except core.StepError as error:
        raise DockloopError(str(error)) from None


def to_json(document: dict) -> str:
    """Return a document as JSON text, one top-level member per line."""
    lines = (f"{json.dumps(key)}: {json.dumps(value)}" for key, value in document.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def name_source(source: Path | str) -> str:
    """Return the name of a file as messages show it."""
    return one_line(shown(source))


def describe(document: dict, source: Path, date: str) -> str:
    """Return modelDescription.xml of a resolved scene. Raises like `core_errors`.

    Args:
        document: the scene, vehicles placed.
        source: the scene file, for messages.
        date: of the description, ``YYYY-MM-DDTHH:MM:SSZ``.
    """
    with core_errors() as core:
        return core.describe(to_json(document), name_source(source), date)


def place(document: dict, source: Path) -> dict:
    """Return start states that lead to the conditions at first contact. Raises like `core_errors`.

    Returns:
        ``chaser`` and ``target`` (members of the scene document, SI units, axes as there),
        ``time_of_contact`` [s], ``touches`` (false: the capture surfaces never meet).
    """
    with core_errors() as core:
        return core.place(to_json(document), name_source(source))


def check(mechanism: Any, source: Path) -> dict:
    """Return the report on a mechanism (see `dockloop.scene.mechanism`). Raises like `core_errors`.

    Args:
        mechanism: the document of the mechanism, or a text.
        source: its file, for messages.
    """
    with core_errors() as core:
        return json.loads(core.check(_as_text(mechanism), name_source(source)))


def expand(mechanism: Any, source: Path) -> dict:
    """Return a mechanism with its legs of the short form written out. Raises like `core_errors`.

    Args:
        mechanism: the document of the mechanism, or a text.
        source: its file, for messages.

    Returns:
        ``bodies``, ``loops`` and ``couplings``, and as ``forces`` the elements of these legs.
    """
    with core_errors() as core:
        return json.loads(core.expand(_as_text(mechanism), name_source(source)))


def evaluate(
    mechanism: Any, source: Path, states: Any, states_source: Path, *, newton: bool = False
) -> list[dict]:
    """Evaluate a mechanism at given states. Raises like `core_errors`.

    Args:
        mechanism: the document of the mechanism, or a text.
        source: its file, for messages.
        states: a document with a member ``states``, and perhaps a mechanism of its own; or a text.
        states_source: its file, for messages.
        newton: close loops by iteration only, by no closed form.

    Returns:
        One object per state: accelerations, forces, inertia (members ``expected`` of the format).
    """
    texts = (_as_text(mechanism), name_source(source), _as_text(states), name_source(states_source))
    with core_errors() as core:
        return json.loads(core.evaluate(*texts, newton=newton))


def _as_text(document: Any) -> str:
    return document if isinstance(document, str) else json.dumps(document)


@cache
def list_methods() -> tuple[dict, ...]:
    """Return the methods of integration that the core lists, each with ``number`` and ``name``."""
    with core_errors() as core:
        return tuple(json.loads(core.methods()))


def list_different_methods() -> tuple[dict, ...]:
    """Return the methods that are built, without those that are another name of one of them."""
    return tuple(m for m in list_methods() if m["is_built"] and not m["same_as"])


def list_compared_methods() -> frozenset[int]:
    """Return the numbers of the methods for comparison, which ordinary FMUs do not carry."""
    return frozenset(method["number"] for method in list_methods() if method["for_comparison"])


class Choice(NamedTuple):
    """One value of a choice: a number in the FMU, a name everywhere else."""

    number: int
    name: str
    meaning: str


@cache
def read_choices() -> dict[str, tuple[Choice, ...]]:
    """Return all choices, by the name of their variable."""
    with core_errors() as core:
        rows = json.loads(core.choices())
    return {variable: tuple(Choice(*row) for row in values) for variable, values in rows.items()}


def list_choices(variable: str) -> tuple[Choice, ...]:
    """Return the values that a variable such as ``phase`` or ``model.level`` can take.

    Args:
        variable: its name; ``latch.state`` stands for that of every latch.
    """
    return read_choices()[variable]


def list_final_outcomes() -> tuple[int, ...]:
    """Return the numbers of the outcomes with which a case can end (``end_after_outcome``)."""
    with core_errors() as core:
        return tuple(core.final_outcomes())


def name_choice(variable: str, number: float) -> str:
    """Return the name of one value of a choice."""
    return {choice.number: choice.name for choice in list_choices(variable)}[int(number)]


def number_choice(variable: str, name: str) -> int:
    """Return the number of one value of a choice."""
    return {choice.name: choice.number for choice in list_choices(variable)}[name]


@cache
def list_loads() -> dict[str, str]:
    """Return the loads between ring and target (``capture.NAME``), each with its unit."""
    with core_errors() as core:
        return {name: unit.replace(".", " ") for name, unit in json.loads(core.loads())}


class Limit(NamedTuple):
    """A limit of models or hardware that is watched while a docking runs.

    Attributes:
        name: in outputs (``limits.NAME.time``) and tables.
        unit: of its value.
        happened: what is beyond the limit.
        means: what follows from that.
    """

    name: str
    unit: str
    happened: str
    means: str


@cache
def list_limits() -> tuple[Limit, ...]:
    """Return the limits that are watched; limit k is bit 2^k of ``limits.exceeded``."""
    with core_errors() as core:
        return tuple(Limit(*row) for row in json.loads(core.limits()))


def has_only_legs(document: dict, source: Path) -> bool:
    """Return whether all loops of a mechanism are legs, which need no generated code.

    Args:
        document: the resolved scene.
        source: the scene file, for messages.
    """
    with core_errors() as core:
        return core.has_only_legs(to_json(document), name_source(source))


def run_program(
    program: Path,
    command: str,
    file: Path,
    *options: str,
    source: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> str:
    """Run one command of a compiled program (`dockloop.native.compiled`).

    Args:
        program: the program.
        command: its first argument.
        file: the scene that it reads.
        options: further arguments.
        source: the file people know, if `file` was made from it; errors name this one instead.
        progress: receives the part that is done, 0 to 1.

    Returns:
        What the program prints.

    Raises:
        UsageError: the file is bad.
        DockloopError: the program failed.
    """
    lines = []
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
        assert process.stdout is not None
        assert process.stderr is not None
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
    text = lines[-1].removeprefix(f"{program.name}: ").removeprefix("error: ")
    if source is not None:
        text = text.replace(str(file), shown(source))
    named = any(text.startswith(f"{option}: ") for option in options)  # a second file
    if not named and shown(source or file) not in text:
        text = f"{shown(source or file)}: {text}"
    raise (UsageError if process.returncode == UsageError.exit_status else DockloopError)(text)


def ask_program(program: Path, command: str, file: Path, *options: str, **more: Any) -> Any:
    """Return the JSON document that a command prints, see `run_program`."""
    printed = run_program(program, command, file, *options, **more)
    try:
        return json.loads(printed)
    except ValueError as error:
        raise DockloopError(
            f"{program.name} {command} printed what is no JSON document ({error})"
        ) from None
