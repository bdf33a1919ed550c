"""Hosts that `host_check` judges: a log of reports, and the FMU of a vehicle in closed loop."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from fmpy.fmi1 import FMICallException

from dockloop.base.errors import DockloopError, UsageError, did_you_mean, find_twice
from dockloop.base.paths import shown
from dockloop.base.tables import Column, Table, read_table
from dockloop.fmu import vehicle_fmu
from dockloop.fmu.host import Instance, unpack
from dockloop.fmu.vehicle_fmu import read_map, read_rows
from dockloop.native.variables import LOADS, MOTION, VEHICLES, Variable

Row = dict[str, np.ndarray]


class ReportLog:
    """Recorded reports. One row is what a host reports for one time.

    Attributes:
        times: of the rows [s], shape (rows,).
        vehicles: whose motion is reported.
        motions: of every row, by name without index.
        inputs: columns that are other inputs of the docking.
        notes: what of the log is not used.
    """

    def __init__(self, table: Table, columns: Mapping[str, Column]) -> None:
        """Read the values of all rows. Raises UsageError: one is none, or what is needed lacks.

        Args:
            table: the log.
            columns: of it, by the names of the docking.
        """
        self._place, self._row = table.place, 0
        self._columns = {name: _read_numbers(table, column) for name, column in columns.items()}
        self._texts = {name: [*map(str, column.cells)] for name, column in columns.items()}
        self.times, names = self._columns["time"], list(self._columns)
        steps = np.diff(self.times)
        if np.any(steps <= 0.0):
            line = table.columns[0].lines[1 + int(np.argmax(steps <= 0.0))]
            raise UsageError(
                f"{self._place}: time must increase, but does not in {table.line} {line}"
            )
        self.vehicles = [v for v in VEHICLES if any(n.startswith(f"{v}.position") for n in names)]
        if not self.vehicles:
            near = did_you_mean("chaser.position[1]", names)
            raise UsageError(
                f"{self._place}: has no column 'chaser.position[1]' or 'target.position[1]'{near}:"
                " must have the motion of a vehicle by the names of the docking FMU"
            )
        self.notes: list[str] = []
        self.inputs: list[str] = []
        motions = {f"{v}.{n}": self._read_motion(v, n) for v in self.vehicles for n in MOTION}
        self.motions: list[Row] = [
            {name: column[row] for name, column in motions.items()}
            for row in range(len(self.times))
        ]

    def _read_motion(self, vehicle: str, name: str) -> np.ndarray:
        entries = _list_entries(f"{vehicle}.{name}", MOTION[name])
        for entry in entries:
            if entry not in self._columns:
                near = did_you_mean(entry, self._columns)
                raise UsageError(f"{self._place}: has no column '{entry}'{near}")
        return np.column_stack([self._columns[entry] for entry in entries])

    def choose_inputs(self, variables: Mapping[str, Variable]) -> None:
        """Choose the columns that are inputs of the docking, next to the motion."""
        motion = {e for name, v in self.motions[0].items() for e in _list_entries(name, len(v))}
        rest = [name for name in self._columns if name not in motion and name != "time"]
        for name in rest:
            if name in variables and variables[name].causality == "input":
                self.inputs.append(name)
            elif name not in variables:
                near = did_you_mean(name, [n for n, v in variables.items() if v.start is not None])
                self.notes.append(f"column not used: {name}{near}")

    def report(self) -> dict[str, Any]:
        """Return motion and inputs of the present row."""
        return self.motions[self._row] | self.read_inputs()

    def read_inputs(self) -> dict[str, float]:
        """Return the inputs of the present row that are no motion."""
        return {name: float(self._columns[name][self._row]) for name in self.inputs}

    def find_load(self, name: str) -> np.ndarray | None:
        """Return a load of the docking as it was recorded, shape (rows, 3); None: it was not."""
        entries = _list_entries(name, 3)
        if not all(entry in self._columns for entry in entries):
            return None
        return np.column_stack([self._columns[entry] for entry in entries])

    def advance(self, loads: Row, time: float, step: float) -> None:
        """Go on to the next row: what loads did is in it."""
        self._row += 1

    def find_digits(self, vehicle: str) -> list[tuple[str, str, float | None]]:
        """Return for each part of a pose: check, unit, size of the last digit over the step.

        An entry that does not change is left out: `0` and `1` may be all its digits. None: all are.
        """
        step = float(np.diff(self.times).min())
        found: list[tuple[str, str, float | None]] = []
        for name, unit in (("position", "m/s"), ("attitude", "rad/s")):
            entries = _list_entries(f"{vehicle}.{name}", MOTION[name])
            last = [
                min(map(_find_last_digit, self._texts[entry])) / step
                for entry in entries
                if np.ptp(self._columns[entry]) > 0.0
            ]
            found.append((f"digits of {name}", unit, max(last, default=None)))
        return found


def _list_entries(name: str, count: int) -> list[str]:
    return [f"{name}[{i}]" for i in range(1, count + 1)]


def read_log(path: Path, names: Path | None = None) -> ReportLog:
    """Read a log of reports.

    Args:
        path: the file.
        names: map of its columns (see `dockloop.fmu.vehicle_fmu`).

    Raises:
        UsageError: naming file, column, line and what is expected.
    """
    table = read_table(path)
    headings = [column.heading for column in table.columns]
    own = (c for c in table.columns if c.name.partition(".")[0] in ("time", *VEHICLES))
    stated = next((c.heading for c in own if c.unit and names is None), None)
    if "units" in table.form or stated:
        where = f"line {table.form['units']}" if "units" in table.form else f"'{stated}'"
        raise UsageError(
            f"{table.place}: {where} has units: leave them out, and write numbers in the units of"
            " the docking FMU"
        )
    if "time" not in headings:
        near = did_you_mean("time", headings)
        raise UsageError(
            f"{table.place}: has no column 'time'{near}: the header must have names, for example"
            " time,chaser.position[1]"
        )
    if (twice := find_twice(headings)) is not None:
        raise UsageError(f"{table.place}: has two columns '{twice}'")
    if len(table.columns[0].cells) < 2:
        raise UsageError(f"{table.place}: needs at least two rows of values")
    return ReportLog(table, _name_columns(table, names))


def _name_columns(table: Table, names: Path | None) -> dict[str, Column]:
    """Return the columns by the names that a map gives them, or else by their own."""
    columns = {column.heading: column for column in table.columns}
    document, place = read_map(names)
    for vehicle, rows in document.items():
        for member, own in read_rows(f"{place}: {vehicle}", rows).items():
            for entry, name in zip(
                _list_entries(f"{vehicle}.{member}", len(own)), own, strict=True
            ):
                if name not in columns:
                    near = did_you_mean(name, columns)
                    raise UsageError(f"{place}: {table.place} has no column '{name}'{near}")
                columns[entry] = columns.pop(name)
    return columns


def _read_numbers(table: Table, column: Column) -> np.ndarray:
    values = table.read_numbers(column)
    if np.isnan(values).any():
        row = int(np.argmax(np.isnan(values)))
        raise UsageError(
            f"{table.place}: '{column.heading}' in {table.line} {column.lines[row]} is"
            f" '{column.cells[row]}': must be a finite number"
        )
    return values


def _find_last_digit(text: str) -> float:
    """Return the size of the last digit of a number as it is written."""
    digits, _, exponent = text.strip().lower().partition("e")
    decimals = re.search(r"[.,](\d*)$", digits)
    return 10.0 ** (int(exponent or 0) - (len(decimals[1]) if decimals else 0))


class VehicleFmu:
    """The FMU of a vehicle; as a context manager it is freed whatever happens.

    Attributes:
        vehicles: the one vehicle of the docking that it is.
        motions: at every communication point so far, by the names of the docking; and loads of
            thrusters where a map names them.
        notes: what the user has to see to.
    """

    def __init__(  # noqa: PLR0917  what it is, then how to run it
        self,
        path: Path,
        folder: Path,
        vehicle: str,
        times: np.ndarray,
        body: Mapping[str, Any],
        names: Path | None = None,
    ) -> None:
        """Load it.

        Args:
            path: the FMU.
            folder: an empty one, where it is unpacked.
            vehicle: of the docking.
            times: communication points [s], shape (points,).
            body: the vehicle in the scene, placed: where a map of parameters lets the FMU start.
            names: map of its variables (see `dockloop.fmu.vehicle_fmu`).

        Raises:
            UsageError: it is no FMU of a vehicle.
        """
        self._times, self.vehicles = times, [vehicle]
        description = unpack(path, folder)
        variables = {v.name: v for v in description.modelVariables}
        outputs = [name for name, v in variables.items() if v.causality == "output"]
        if all(f"{v}.force_mean[1]" in outputs for v in VEHICLES):
            raise UsageError(
                f"{shown(path)}: is a docking, not a vehicle: name the FMU of the {vehicle}"
            )
        document, place = read_map(names)
        rows = document.get(vehicle, {})
        found = vehicle_fmu.VehicleFmu(path, vehicle, rows, place)
        if "start" in rows:
            found.take_starts(body)
        self.notes, self._starts = found.notes, [(variables[n], x) for n, x in found.starts.items()]

        def find(member: str) -> list[int]:
            return [variables[name].valueReference for name in found.names[member]]

        reported = [member for member in found.names if member not in LOADS]
        self._reported = {f"{vehicle}.{member}": find(member) for member in reported}
        self._loads = {f"{vehicle}.{member}": find(member) for member in LOADS}
        self.motions: list[Row] = []
        self._instance = Instance(description, str(folder), shown(path))

    def __enter__(self) -> Self:
        self._instance.__enter__()
        self._instance.initialise(self._starts, self._times)
        self._read()
        return self

    def __exit__(self, *_: object) -> None:
        self._instance.__exit__()

    def report(self) -> Row:
        """Return the present motion, and loads of thrusters where a map names them."""
        return self.motions[-1]

    def advance(self, loads: Row, time: float, step: float) -> None:
        """Make a step under held loads. Raises DockloopError: the FMU fails."""
        slave = self._instance.slave
        try:
            for name, references in self._loads.items():
                slave.setReal(references, loads[name].tolist())
            slave.doStep(time, step)
        except FMICallException as error:
            raise DockloopError(self._instance.sentence(error)) from None
        self._instance.interrupt()
        self._read()

    def _read(self) -> None:
        get = self._instance.slave.getReal
        self.motions.append({name: np.array(get(refs)) for name, refs in self._reported.items()})
