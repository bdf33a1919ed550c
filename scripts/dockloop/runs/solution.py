"""``dockloop truth``: one run with 32 digits, as numbers that errors can be measured against.

The program dockloop-compare does the work: the same equations, events and latches with a scalar of
twice the digits and a method of any order. The result is one JSON document: ``time``, the values of
each output (every digit of a double counts), the work, and the distance to a run with 1000 times
the tolerance.
"""

from collections.abc import Callable, Sequence

from dockloop.base import paths
from dockloop.base.errors import one_line
from dockloop.base.files import json_kind, scratch
from dockloop.native.compiled import find_compiled
from dockloop.native.core import ask_program, to_json
from dockloop.scene.find import find_scene
from dockloop.scene.placement import blaming_start, read_placed

FILE = json_kind("truth", "dockloop truth")


def make_solution(
    reference: str,
    outputs: Sequence[str],
    *,
    overrides: Sequence[str] = (),
    settings: Sequence[str] = (),
    stop: float | None = None,
    step: float | None = None,
    tolerance: float = 1e-18,
    check: bool = False,
    progress: Callable[[float], None] | None = None,
) -> dict:
    """Integrate a scene with extended precision.

    Args:
        reference: name or path of the scene.
        outputs: names of FMU variables.
        overrides: ``KEY=VALUE`` texts that replace keys of the scene.
        settings: ``NAME=VALUE`` texts, start values of FMU variables.
        stop: end [s]; default: that of the scene's experiment.
        step: distance of the time points [s]; default: that of the scene's experiment.
        tolerance: of the steps inside, relative.
        check: run again with 1000 times the tolerance and state the differences.
        progress: receives the part that is done, 0 to 1.

    Returns:
        The document.

    Raises:
        UsageError: naming scene, key or variable, value and limit.
        DockloopError: the program is missing or failed.
    """
    source = find_scene(reference)
    document = read_placed(source, overrides)
    experiment = document["experiment"]
    duration = experiment["stop"] - experiment["start"] if stop is None else stop
    options = ["--stop", repr(float(duration))]
    options += ["--step", repr(float(experiment["step"] if step is None else step))]
    options += ["--tolerance", repr(tolerance)]
    for flag, values in (("--output", outputs), ("--set", settings)):
        for value in values:
            options += [flag, one_line(value)]
    if check:
        options.append("--check")
    with scratch() as folder:
        model = folder / "model.json"
        model.write_text(to_json(document), encoding="utf-8")
        (program,) = find_compiled(paths.COMPARE)
        with blaming_start(source, overrides):
            return ask_program(program, "truth", model, *options, source=source, progress=progress)
