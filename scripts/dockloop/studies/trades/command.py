"""What ``dockloop trade`` measures, and the same in Python: `trade`."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dockloop.base.errors import names_arguments
from dockloop.base.files import scratch
from dockloop.base.number import check_number
from dockloop.base.paths import as_path
from dockloop.base.progress import import_optional
from dockloop.fmu.build import build_fmu
from dockloop.native.compiled import add_comparison
from dockloop.native.core import FULL, REFERENCE
from dockloop.runs.docking import Scene
from dockloop.scene.find import find_scene
from dockloop.scene.placement import read_placed
from dockloop.scene.values import as_setting
from dockloop.studies.trades import (
    Choice,
    needs_comparison,
    parse_methods,
    parse_names,
    parse_numbers,
    run_trade,
)
from dockloop.studies.trades.bench import Bench
from dockloop.studies.trades.report import summarise_trade

if TYPE_CHECKING:
    import pandas as pd


@names_arguments
def trade(
    scene: str | Path | Scene | Mapping[str, Any],
    *,
    overrides: Mapping[str, Any] | None = None,
    levels: Sequence[str] = (),
    methods: Sequence[str] = (),
    tolerances: Sequence[float] = (),
    steps: Sequence[float] = (),
    stop: float | None = None,
    quick: bool = False,
    output: str | Path | None = None,
    resume: bool = False,
) -> "pd.DataFrame":
    """Measure speed against accuracy: a grid of settings against the reference solution.

    Args:
        scene: name of a shipped scene, path of a ``.toml`` file, its members, or a `Scene`.
        overrides: keys of the scene that all runs have otherwise.
        levels: only these levels of the model, by name; empty: all.
        methods: only these methods, by name; empty: all.
        tolerances: relative tolerances to try; empty: those of the grid.
        steps: communication steps to try [s]; empty: those of the grid.
        stop: end of the runs [s]; default: a second after the capture, or that of the scene.
        quick: a small grid: methods of the product, two communication steps, each timed once.
        output: folder for the journal; default: it is not kept.
        resume: go on with the journal of `output`.

    Returns:
        One row per setting: ``setting`` in words, its fields, ``status``, ``reason``, ``error``
        and the parts of it, what it cost (``evaluations``, ``time_ratio``), and whether it pays
        (``front_by_time``). The summary of ``dockloop trade --json`` is in
        ``table.attrs["summary"]``: recommendations, levels, what does not pay.

    Raises:
        UsageError: the scene, a choice or the journal is bad.
        DockloopError: a package is missing, or there is no reference solution.
    """
    pd = import_optional("pandas")
    whole = Scene(scene, overrides)
    numbers = (
        [check_number(option, number) for number in given]
        for option, given in (("--tolerances", tolerances), ("--steps", steps))
    )
    choice = make_choice(
        *(",".join(map(str, given)) or None for given in (levels, methods, *numbers)),
        stop,
        quick=quick,
    )
    texts = [as_setting(name, value) for name, value in whole.overrides.items()]
    with scratch() as kept:
        folder = as_path("-o", output) if output else kept
        bench = make_bench(whole.reference, texts, choice)
        measured = run_trade(bench, choice, folder, resume=resume)
    summary = summarise_trade(measured, f"dockloop.trade({whole.reference!r}, ...)")
    table = pd.DataFrame(summary.pop("rows"))
    table.attrs["summary"] = summary
    return table


def make_choice(
    levels: str | None,
    methods: str | None,
    tolerances: str | None,
    steps: str | None,
    stop: float | None,
    *,
    quick: bool,
) -> Choice:
    """Return what the user wants of the grid; lists are separated by commas. Raises UsageError."""
    return Choice(
        parse_names("--levels", levels, "model.level"),
        parse_methods(methods),
        parse_numbers("--tolerances", tolerances, 0.0, 1.0),
        parse_numbers("--steps", steps, 0.0, math.inf),
        stop,
        quick,
    )


def make_bench(reference: str, overrides: Sequence[str], choice: Choice) -> Bench:
    """Return the FMU of a scene with all methods of the grid. Raises UsageError."""
    path = find_scene(reference)
    model = read_placed(path, overrides, say=lambda _: None, starts=True).get("model", {})
    if model.get("level") == REFERENCE:  # the grid has all levels; the FMU starts here
        overrides = [*overrides, f"model.level={FULL}"]
    with scratch() as temporary:
        fmu = temporary / f"{path.stem}.fmu"
        finish = add_comparison if needs_comparison(choice) else None
        build_fmu(reference, [*overrides], fmu, bare=True, finish=finish)
        return Bench(fmu)
