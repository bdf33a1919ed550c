"""``dockloop trade SCENE --apply ERROR``: writes what was measured to be cheapest into a scene.

The copy of the scene has the keys ``[solver]`` (and the level of the model) of the cheapest setting
whose error is at most the wanted one. Settings with the communication step of the scene come first;
if none of them was measured, the copy has the step of the setting too. Everything else in the file,
comments included, stays as it is.
"""

import math
from pathlib import Path
from typing import Any

from dockloop.base import paths
from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.files import table_kind
from dockloop.base.number import read_number
from dockloop.native.core import REFERENCE, list_compared_methods, name_choice, number_choice
from dockloop.scene.find import find_scene
from dockloop.studies.trades.bench import Bench
from dockloop.studies.trades.report import recommend

BEGIN = "# Solver settings by: dockloop trade"
SCENE = table_kind("scene", "dockloop trade", BEGIN)


def parse_error(text: str) -> float:
    """Parse the wanted error of ``--apply``. Raises UsageError."""
    try:
        wanted = read_number(text)
    except ValueError:
        wanted = math.nan
    if not 0.0 < wanted < 1.0:
        raise UsageError(f"--apply {text}: must be a number above 0 and below 1, e.g. 1e-3")
    return wanted


def name_copy(reference: str, wanted: float) -> Path:
    """Return the name of the copy: next to a scene of the user's own, else in ``build/scenes``."""
    source = find_scene(reference)
    error = f"{wanted:g}".replace("-", "m").replace(".", "p")  # names of FMUs have no others
    folder = source.parent if reference.endswith(".toml") else paths.RESULTS / "scenes"
    return folder / f"{source.stem}_error_{error}.toml"


def choose_row(rows: list[dict], wanted: float, step: float) -> dict:
    """Return the cheapest setting that FMUs carry and that is right.

    Args:
        rows: of a trade.
        wanted: error.
        step: communication step of the scene [s].

    Raises:
        DockloopError: no setting is.
    """
    compared, reference = list_compared_methods(), number_choice("model.level", REFERENCE)
    carried = [r for r in rows if r["method"] not in compared and r["level"] != reference]
    own_step = [row for row in carried if math.isclose(row["step"], step)]
    row = recommend(own_step or carried, wanted)
    if row is None:
        errors = [r["error"] for r in carried if r["status"] == "done" and r["error"] is not None]
        least = f"the smallest error is {min(errors):.1e}" if errors else "none ran to its end"
        raise DockloopError(f"--apply {wanted:g}: no measured setting reaches it: {least}")
    return row


def make_keys(row: dict, bench: Bench) -> dict[str, Any]:
    """Return the keys of the scene that make a setting."""
    keys: dict[str, Any] = {"solver.method": name_choice("solver.method", row["method"])}
    if bench.start("accuracy"):  # it would choose other values
        keys["solver.accuracy"] = 0.0
    if row["rtol"] is not None:
        keys |= bench.tolerances(row["rtol"])
        if row["rtol"] > bench.scene["experiment"]["tolerance"]:  # an FMU takes the smaller one
            keys["experiment.tolerance"] = row["rtol"]
    if row["inner_step"] is not None:
        keys["solver.step"] = row["inner_step"]
    if row["level"] is not None:
        keys["model.level"] = name_choice("model.level", row["level"])
    if not math.isclose(row["step"], bench.step):
        keys["experiment.step"] = row["step"]
    return keys
