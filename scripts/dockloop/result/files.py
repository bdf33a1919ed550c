"""Results of ``dockloop run`` read back: the recorded values and the model that made them."""

from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import UsageError, find_reason
from dockloop.base.files import MADE_BY
from dockloop.base.paths import check_file, is_file, shown
from dockloop.base.tables import read_table
from dockloop.native.variables import VEHICLES
from dockloop.result.recording import Result
from dockloop.result.summary import COMMAND, RESULT, SUFFIXES, find_summary
from dockloop.scene.carried import read_scene
from dockloop.scene.find import find_scene, parse_json
from dockloop.scene.resolve import resolve_scene


def read_result(path: Path, model: str | None = None) -> Result:
    """Read a result file and the model next to it.

    Args:
        path: a file that ``dockloop run`` wrote.
        model: a scene or an FMU to take the geometry from; default: the summary next to the result.

    Returns:
        What ``run_fmu`` had returned, without wall times.

    Raises:
        UsageError: it is no result, or nothing says which model made it.
    """
    check_file(path, "result file")
    try:
        is_own = RESULT.is_own(path)
    except OSError as error:
        raise UsageError(f"{shown(path)}: cannot be read ({find_reason(error)})") from None
    except Exception:  # noqa: BLE001  whatever else is no table of ours
        is_own = False
    if not is_own:
        raise UsageError(
            f"{shown(path)}: is no result of '{COMMAND}' ({', '.join(SUFFIXES)} with the columns"
            " time and outputs of an FMU)"
        )
    names, units, values = _read_values(path)
    document, parameters = _find_model(path, model, len(values))
    return Result(document, names, units, values, parameters)


def _read_values(path: Path) -> tuple[list[str], list[str], np.ndarray]:
    """Return names, units and values of a result file."""
    try:
        if path.suffix == ".csv":  # of any size
            with path.open(encoding="utf-8") as file:
                names = file.readline().strip().split(",")
                begin = file.tell()
                units = file.readline().strip().split(",")
                if units[0] != "s":
                    units = [""] * len(names)
                    file.seek(begin)
                values = np.loadtxt(file, delimiter=",", ndmin=2)
        else:
            table = read_table(path)
            names = [column.name for column in table.columns]
            units = [column.unit or "" for column in table.columns]
            values = np.column_stack([table.read_numbers(column) for column in table.columns])
    except (OSError, KeyError, ValueError) as error:
        raise UsageError(
            f"{shown(path)}: its values cannot be read ({error}): run the docking again"
        ) from None
    if values.ndim != 2 or values.shape[1] != len(names) or not len(values):
        raise UsageError(
            f"{shown(path)}: has {len(names)} columns in its header and values of the shape"
            f" {values.shape}: run the docking again"
        )
    if not np.all(np.isfinite(values)):
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise UsageError(
            f"{shown(path)}: {names[column]} in row {row + 1} is not finite: run the docking again"
        )
    if np.any(np.diff(values[:, 0]) <= 0.0):
        raise UsageError(f"{shown(path)}: time does not increase: run the docking again")
    return names, units, values


def _find_model(path: Path, model: str | None, rows: int) -> tuple[dict, dict[str, float]]:
    """Return the resolved scene and the parameters of a result."""
    if model:
        is_fmu = model.endswith(".fmu")
        document = read_scene(Path(model)) if is_fmu else resolve_scene(find_scene(model))
        vehicles = [name for name in VEHICLES if name in document]
        return document, {f"{name}.mass": float(document[name]["mass"]) for name in vehicles}
    summary_file = find_summary(path)
    hint = "run the docking again, or name scene or FMU with --model"
    if not is_file(summary_file):
        raise UsageError(
            f"{shown(path)}: {shown(summary_file)} is missing, which holds its model: {hint}"
        )
    try:
        summary: Any = parse_json(summary_file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{shown(summary_file)}: cannot be read ({error}): {hint}") from None
    if not isinstance(summary, dict) or summary.get(MADE_BY) != COMMAND:
        raise UsageError(f"{shown(summary_file)}: is no summary of '{COMMAND}': {hint}")
    if not isinstance(summary.get("model"), dict):
        raise UsageError(
            f"{shown(summary_file)}: has no member 'model', as an older dockloop wrote it: {hint}"
        )
    if summary.get("communication_steps") != rows - 1:
        raise UsageError(
            f"{shown(summary_file)}: is of a run of {summary.get('communication_steps')} steps, but"
            f" {shown(path)} has {rows - 1}: {hint}"
        )
    return summary["model"], summary.get("parameters", {})
