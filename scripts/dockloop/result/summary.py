"""A recorded docking in numbers (a dictionary for programs) and in words (for people).

Loads are those on the target through the capture interface; peaks are true peaks over the inner
steps of the integrator, not samples. Energies are in J, times in s, forces in N, moments in N m.
"""

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dockloop.base.files import MADE_BY, Kind, json_kind, read_head, write_text, writing
from dockloop.base.paths import shown
from dockloop.base.progress import import_optional
from dockloop.base.tables import read_table
from dockloop.native.core import list_loads, name_choice
from dockloop.native.variables import VEHICLES, happened
from dockloop.result.capture import explain_capture, list_needed
from dockloop.result.limits import EXCEEDED, find_exceeded
from dockloop.result.peaks import find_leg_peak, find_peak
from dockloop.result.recording import Result

COMMAND = "dockloop run"
SUFFIXES = {  # of results: the package that each needs
    ".csv": "",
    ".npz": "",
    ".parquet": "pyarrow",
    ".xlsx": "openpyxl",
    ".mat": "pymatreader",
    ".h5": "h5py",
}

_COLUMN = re.compile(  # outputs of FMUs by dockloop
    r"(chaser|target|relative|capture|contact|ring|base|energy|momentum|solver|coupling|state|limits"
    r"|sequence|hooks|faces|pushers|joint|stack"
    r"|(leg|latch|loop|element|hook|part|force)\[\d+\])(\.\w+(\[\d+\])?)+"
    r"|latched\[\d+\]|gap|phase|outcome|captured|time_(to|of)_\w+"
)

_SUMMARISED = re.compile(  # what a summary looks at
    r"outcome|captured|phase|time_of_\w+|latched\[\d+\]|capture\.(peak(_time|_step)?\.\w+|reason|seated_time)"
    r"|latch\[\d+\]\.(opening|lateral)|contact\.petal\[\d+\]\.force|energy\.\w+|momentum\.residual"
    r"|leg\[\d+\]\.(length|force|peak(_time|_step)?)|relative\.velocity\[\d\]|solver\.\w+|sequence\.\w+(\[\d+\])?"
    r"|limits\.(exceeded|\w+\.(time|value))"
)


def is_summarised(name: str) -> bool:
    """Return whether a summary looks at an output."""
    return _SUMMARISED.fullmatch(name) is not None


def _is_result(path: Path) -> bool:
    """Return whether a file is a result: its columns are the time and outputs of an FMU."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            columns = arrays["names"].tolist()
    elif path.suffix == ".parquet":
        columns = import_optional("pyarrow.parquet").read_schema(path).names
    elif path.suffix in SUFFIXES and path.suffix != ".csv":
        columns = [column.name for column in read_table(path).columns]
    else:
        columns = read_head(path).decode().partition("\n")[0].rstrip("\r").split(",")
    return columns[0] == "time" and len(columns) > 1 and all(map(_COLUMN.fullmatch, columns[1:]))


RESULT = Kind("result", COMMAND, _is_result)


def find_summary(result: Path) -> Path:
    """Return where the summary next to a result or a table is: ``own_summary.json`` for own.csv."""
    return result.with_name(f"{result.stem}_summary.json")


def summarise(run: Result) -> dict:
    """Condense a recording.

    Args:
        run: what was recorded; groups of outputs that the scene leaves out are left out here.

    Returns:
        A dictionary that can be written as JSON.
    """
    simulated = float(run["time"][-1] - run["time"][0])
    summary: dict = {
        MADE_BY: COMMAND,
        "scene": run.scene["name"],
        "title": run.scene["title"],
        "simulated_time": simulated,
        "communication_steps": len(run.values) - 1,
    }
    if "captured" in run:  # a sequence without a target has an outcome only
        summary |= _outcome(run)
    if EXCEEDED in run:
        summary["limits"] = find_exceeded(run)
    if "sequence.step" in run:
        summary["sequence"] = _sequence(run)
    if "capture.peak.compression" in run:
        summary["peak_loads"] = _peak_loads(run)
    if "energy.residual" in run:
        summary["energy"] = _energy(run)
    if "momentum.residual" in run:
        summary["momentum_residual"] = float(np.max(np.abs(run["momentum.residual"])))
    recorded = [v for v in VEHICLES if run.scene.get(v, {}).get("motion") == "recorded"]
    if recorded and f"{recorded[0]}.force_mean[1]" in run:
        summary["records"] = {vehicle: _record(run, vehicle) for vehicle in recorded}
    if "leg[1].length" in run:
        summary["legs"] = _legs(run)
    summary["time"] = _wall_time(run, simulated)
    if "solver.steps" in run:
        names = ("steps", "rhs_evaluations", "rejected_steps")
        summary["solver"] = {name: int(run[f"solver.{name}"][-1]) for name in names}
        summary["solver"]["closure_residual"] = float(np.max(run["solver.closure_residual"]))
        summary["solver"] |= _settings(run)
        evaluations = summary["solver"]["rhs_evaluations"]
        if evaluations > 0:
            summary["time"]["microseconds_per_rhs"] = 1e6 * run.wall["do_step"] / evaluations
    summary |= _list_findings(run)
    summary["units"] = dict(zip(run.names, run.units, strict=True))  # of the columns of a CSV file
    summary["model"] = run.scene  # from which `dockloop view` has its shapes
    summary["parameters"] = run.parameters
    return summary


def _list_findings(run: Result) -> dict:
    """Return what a run says of itself, if there is anything."""
    found = {
        "notes": run.notes,
        "error_estimate": run.error_estimate,
        **(run.assurance.to_summary() if run.assurance else {}),
        "warnings": run.warnings,
    }
    return {name: said for name, said in found.items() if said or name == "assured"}


def relative_energy(run: Result) -> float:
    """Return the kinetic energy of the relative motion at the start, m_eq v^2 / 2 [J].

    A vehicle that is not free counts as infinitely heavy. Rotation is left out, and so is the mass
    of a mechanism that the chaser's excludes. Without a target: the energy of the mechanism at the
    start.
    """
    if "relative.velocity[1]" not in run:
        return float(run["energy.kinetic"][0] + run["energy.potential"][0])
    inverse = sum(
        1.0 / run.parameters[f"{name}.mass"]
        for name in VEHICLES
        if run.scene[name]["motion"] == "free"
    )
    speed = np.linalg.norm(run.vector("relative.velocity")[0])
    return float(0.5 * speed**2 / inverse) if inverse else 0.0


def write_result(run: Result, path: Path, *, units_row: bool = False) -> None:
    """Write all recorded values.

    Args:
        run: what was recorded.
        path: ``.csv`` (one header line; units are in the summary), ``.xlsx`` (with a row of units),
            ``.parquet`` (units in the metadata of the columns), or ``.npz``, ``.mat``, ``.h5``
            (arrays names, units, values: full precision).
        units_row: whether a ``.csv`` has a row of units under its header.

    Raises:
        DockloopError: it cannot be written, or a package is missing.
    """
    arrays: dict[str, Any] = {"names": run.names, "units": list(run.units), "values": run.values}
    with writing(path, RESULT) as partial, partial.open("w+b") as file:
        if path.suffix == ".npz":
            np.savez_compressed(file, **arrays)
        elif path.suffix == ".parquet":
            _write_parquet(run, file)
        elif path.suffix == ".xlsx":
            _write_excel(run, file)
        elif path.suffix == ".mat":
            cells = {n: np.array(v, object) for n, v in arrays.items() if n != "values"}
            import_optional("scipy.io", "scipy").savemat(file, {**arrays, **cells})
        elif path.suffix == ".h5":
            with import_optional("h5py").File(file, "w") as target:
                target.update(arrays)
        else:
            rows = [run.names, run.units] if units_row else [run.names]
            header = "\n".join(map(",".join, rows))
            np.savetxt(file, run.values, "%.15g", ",", header=header, comments="", encoding="utf-8")


def _write_parquet(run: Result, file: BinaryIO) -> None:
    """Write all recorded values as a table with units."""
    import pyarrow
    from pyarrow import parquet

    fields = [
        pyarrow.field(name, "double", metadata={"unit": unit})
        for name, unit in zip(run.names, run.units, strict=True)
    ]
    schema = pyarrow.schema(fields, metadata={"dockloop.run": run.scene["name"]})
    parquet.write_table(pyarrow.Table.from_arrays(list(run.values.T), schema=schema), file)


def _write_excel(run: Result, file: BinaryIO) -> None:
    """Write all recorded values as a sheet, with a row of units."""
    book = import_optional("openpyxl").Workbook(write_only=True)
    sheet = book.create_sheet(run.scene["name"][:31])
    for row in (run.names, run.units, *run.values.tolist()):
        sheet.append(row)
    book.save(file)


def write_summary(summary: dict, path: Path, files: Iterable[Path]) -> None:
    """Write a summary as JSON, with `files`. Raises DockloopError: it cannot be written."""
    summary["files"] = [shown(file) for file in files]
    write_text(path, json_kind("summary", summary[MADE_BY]), json.dumps(summary, indent=2) + "\n")


def _outcome(run: Result) -> dict:
    """Return outcome, phase and times of contact and capture (None: never)."""

    def when(name: str) -> float | None:
        value = float(run[name][-1])
        return value if happened(value) else None

    latched = run.vector("latched")[-1] if "latched[1]" in run else np.zeros(0)
    values = {name: float(run[name][-1]) for name in list_needed(run.names)} | run.parameters
    return {
        "explanation": explain_capture(values),
        "outcome": name_choice("outcome", run["outcome"][-1]),
        "captured": bool(run["captured"][-1]),
        "phase": name_choice("phase", run["phase"][-1]),
        "time_of_contact": when("time_of_contact"),
        "time_of_capture": when("time_of_capture"),
        "latches_held": int(np.sum(latched)),
        "latches": len(latched),
    }


def _sequence(run: Result) -> dict:
    """Return the steps in their order, and the last one with its time [s].

    A step that begins and ends between two communication points is known if it was entered for the
    first time there.
    """
    names = [step["name"] for step in run.scene["mechanism"]["sequence"]["steps"]]
    numbers = run["sequence.step"].astype(int)
    entered = run.vector("sequence.entered")  # an older FMU does not have it
    counts = np.sum(happened(entered), axis=1)
    seen: list[int] = []
    for row in np.flatnonzero(np.diff(numbers, prepend=0) | np.diff(counts, prepend=0)):
        begun = [step for step in np.argsort(entered[row]) + 1 if happened(entered[row, step - 1])]
        seen += [step for step in begun if step not in (*seen, numbers[row])]
        seen += [numbers[row]] if numbers[row] not in seen[-1:] else []
    return {
        "steps": [names[step - 1] for step in seen],
        "step": names[numbers[-1] - 1],
        "time_in_step": float(run["sequence.time_in_step"][-1]),
    }


def _peak_loads(run: Result) -> dict:
    """Return the largest loads since the start next to the rated ones."""
    rated = run.scene["mechanism"].get("limits", {})
    loads = {}
    for name, unit in list_loads().items():
        loads[name] = find_peak(run, name) | {"unit": unit}
        if name in rated:
            loads[name] |= {"rated": rated[name], "ratio": loads[name]["value"] / rated[name]}
    return loads


def _energy(run: Result) -> dict:
    """Return what became of the energy, and what does not add up."""
    scale = relative_energy(run)
    residual = float(np.max(np.abs(run["energy.residual"])))
    energy = {
        "initial_relative": scale,
        "initial_meaning": "of relative motion at the start"
        if "target" in run.scene
        else "in the mechanism at the start",
        "residual": residual,
        "residual_ratio": residual / scale if scale > 0.0 else None,
    }
    for column in run.names:
        name = column.removeprefix("energy.")
        if name != column and name.startswith(("dissipated", "external")):
            energy[name] = float(run[column][-1])
    return energy


def _record(run: Result, vehicle: str) -> dict:
    """Return the load from outside that keeps a vehicle on its record.

    Its impulse [N s] is the change of momentum less the impulse of the docking system.
    """
    velocity = run.vector(f"{vehicle}.velocity")
    steps, means = np.diff(run.time), run.vector(f"{vehicle}.force_mean")[1:]
    impulse = run.parameters[f"{vehicle}.mass"] * (velocity[-1] - velocity[0]) - steps @ means
    forces = np.linalg.norm(run.vector(f"{vehicle}.force_ext"), axis=1)
    return {"impulse": impulse.tolist(), "largest_force": float(forces.max())}


def _legs(run: Result) -> dict:
    """Return travel of the legs from their start [m] and the largest force [N]."""
    count = sum(name.endswith("].length") for name in run.names)
    lengths = np.column_stack([run[f"leg[{i + 1}].length"] for i in range(count)])
    peak = find_leg_peak(run, count)
    return {
        "shortest_travel": float(np.min(lengths - lengths[0])),
        "longest_travel": float(np.max(lengths - lengths[0])),
        "largest_force": peak["value"],
        "peak": peak,
    }


def _settings(run: Result) -> dict:
    """Return method and tolerance in use, of FMUs that state them."""
    if "solver.chosen_method" not in run:
        return {}
    return {
        "method": name_choice("solver.method", run["solver.chosen_method"][-1]),
        "rtol": float(run["solver.chosen_rtol"][-1]),
        "error_estimate": float(run["solver.error_estimate"][-1]),
    }


def _wall_time(run: Result, simulated: float) -> dict:
    """Return wall times [s]; ``python`` is the loop without the calls into the FMU."""
    wall = dict(run.wall)
    wall["python"] = wall["loop"] - wall["do_step"] - wall["read"]
    wall["real_time_factor"] = simulated / wall["loop"] if simulated else 0.0
    return wall
