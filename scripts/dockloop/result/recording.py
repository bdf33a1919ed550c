"""What a run left behind: every output at every communication point, with names and units."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dockloop.base import paths
from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.number import check_number
from dockloop.base.progress import import_optional
from dockloop.native.variables import VEHICLES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_MAX_STEPS = 10_000_000
_EXCEL = (1 << 20, 1 << 14)  # rows and columns of a sheet
_BYTES = {".csv": 17}  # of a value; elsewhere 8


class Units(list[str]):
    """Units of columns: ``units[3]`` by number, ``units["relative.axial"]`` by name."""

    def __init__(self, units: Iterable[str], names: Sequence[str]) -> None:
        """Join units with the names of their columns."""
        super().__init__(units)
        self._names = names

    def __getitem__(self, key: Any) -> Any:
        """Return a unit. Raises UsageError: there is no column of this name."""
        return super().__getitem__(find_column(self._names, key) if isinstance(key, str) else key)


def find_column(names: Sequence[str], name: str) -> int:
    """Return the number of a column of a result. Raises UsageError: there is none."""
    if not isinstance(name, str):
        raise UsageError(f"the name of a column is {name!r}: must be a text")
    if name not in names:
        near = did_you_mean(name, names)
        raise UsageError(f"this result has no column '{name}'{near}; .names lists all")
    return names.index(name)


@cache  # a run asks for each name some ten times
def find_vector(name: str) -> str | None:
    """Return the vector of which a variable is an entry: ``a.b`` for ``a.b[3]``."""
    found = re.fullmatch(r"(.+)\[\d+\]", name)
    return found[1] if found else None


@dataclass(repr=False, eq=False)
class Result:
    """What a run left behind.

    ``result["relative.axial"]`` is one variable over time, shape (points,), and
    ``result["relative.position"]`` a vector, shape (points, 3). All values are floats: true is 1, a
    choice is its number, and `get_choices` returns its name. Iteration and `keys` give the names,
    ``len`` their number.

    Attributes:
        scene: the resolved scene (``resources/model.json`` of the FMU).
        names: recorded variables, ``time`` first.
        units: their units, ``units["relative.axial"]``.
        values: one row per communication point, one column per name, shape (points, names).
        parameters: value of every parameter that is a number, after initialisation.
        wall: wall time [s]: ``load`` (until the start state is there), ``loop``, and of the loop
            ``do_step`` (inside the steps) and ``read`` (reading outputs).
        warnings: issued before and during the run.
        notes: what the parameter ``accuracy`` has chosen, and what it has left out.
        error_estimate: from a second run (`dockloop.result.accuracy.estimate_error`); empty without
            one.
        assurance: of assured runs (`dockloop.runs.assured.Assurance`); None: not asked for.
    """

    scene: dict
    names: list[str]
    units: list[str]
    values: np.ndarray
    parameters: dict[str, float] = field(default_factory=dict)
    wall: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    error_estimate: dict[str, Any] = field(default_factory=dict)
    assurance: Any = None

    def __post_init__(self) -> None:
        self.units = Units(self.units, self.names)

    def __repr__(self) -> str:
        end = f", {self.outcome} at the end" if "outcome" in self else ""
        return (
            f"Result({self.scene.get('name', '')!r}: {len(self.values)} points from"
            f" {self.time[0]:g} to {self.time[-1]:g} s, {len(self.names)} columns{end})"
        )

    def __eq__(self, other: object) -> bool:
        """Return whether both have the same scene, parameters, columns and values, bit for bit."""
        if not isinstance(other, Result):
            return NotImplemented
        mine, others = (
            (r.scene, r.parameters, r.names, list(r.units), r.values.shape, r.values.tobytes())
            for r in (self, other)
        )
        return mine == others

    __hash__ = None  # type: ignore[assignment]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the columns, ``time`` first."""
        return iter(self.names)

    def __len__(self) -> int:
        """Return the number of columns, over which it iterates."""
        return len(self.names)

    def keys(self) -> list[str]:
        """Return the names of the columns, ``time`` first; ``dict(result)`` works."""
        return list(self.names)

    @property
    def outcome(self) -> str:
        """The outcome at the end, by its name, such as ``captured``."""
        return str(self.get_choices("outcome")[-1])

    def get_choices(self, name: str) -> np.ndarray:
        """Return the names of a choice over time, such as ``phase``: texts, shape (points,).

        Raises:
            UsageError: there is no such column, or its values have no names.
        """
        from dockloop.native.core import read_choices

        choices = read_choices().get(re.sub(r"\[\d+\]", "", name), ())
        names = {choice.number: choice.name for choice in choices}
        values = self[name]
        if not names:
            raise UsageError(f"Result.get_choices: values of '{name}' have no names")
        return np.array([names[int(value)] for value in values])

    def __contains__(self, name: str) -> bool:
        """Return whether a variable or a vector was recorded."""
        return name in self.names or bool(self._find_entries(name))

    def __getitem__(self, name: str) -> np.ndarray:
        """Return one variable over time, shape (points,), or a vector, shape (points, entries).

        Raises:
            UsageError: there is no such column.
        """
        if name not in self.names and self._find_entries(name):
            return self.vector(name)
        return self.values[:, find_column(self.names, name)]

    def vector(self, name: str) -> np.ndarray:
        """Return ``name[1], name[2], ...`` as columns, shape (points, entries)."""
        return self.values[:, self._find_entries(name)]

    def _find_entries(self, name: str) -> list[int]:
        """Return the columns of a vector; none if there is no such vector."""
        return [i for i, n in enumerate(self.names) if name and find_vector(n) == name]

    def choose(self, is_chosen: Callable[[str], bool]) -> "Result":
        """Return the same with the time and the variables that are chosen by their names."""
        columns = [0, *(i for i, name in enumerate(self.names) if i and is_chosen(name))]
        names, units = ([list_[i] for i in columns] for list_ in (self.names, self.units))
        return replace(self, names=names, units=units, values=self.values[:, columns])

    @property
    def time(self) -> np.ndarray:
        """Communication points [s], shape (points,)."""
        return self["time"]

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The run in numbers, as ``dockloop run --json`` prints them: outcome, peak loads, audits.

        Loads in N and N m, times in s, energies in J.

        Raises:
            UsageError: these are histories of a sweep.
        """
        from dockloop.result.summary import summarise

        self._check_whole("summary")
        return summarise(self)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table: the index is the time [s], one column per variable.

        Units are in ``table.attrs["units"]``, by name of the column.
        """
        pd = import_optional("pandas")
        index = pd.Index(self.time, name="time")
        table = pd.DataFrame(self.values[:, 1:], index=index, columns=self.names[1:])
        table.attrs["units"] = dict(zip(self.names, self.units, strict=True))
        return table

    def to_xarray(self) -> "xr.Dataset":
        """Return a data set: one variable per name over ``time`` [s], with the attribute ``units``.

        ``relative.position[1]`` to ``[3]`` become one variable of shape (points, 3); its second
        dimension is called ``relative.position.index`` and counts from 1.
        """
        xr = import_optional("xarray")
        data: dict[str, Any] = {}
        for name, unit in zip(self.names[1:], self.units[1:], strict=True):
            base = find_vector(name) or name
            if base in data:
                continue
            if base == name:
                data[name] = ("time", self[name], {"units": unit})
            else:
                data[base] = (("time", f"{base}.index"), self.vector(base), {"units": unit})
        counts = {dims[1]: values.shape[1] for dims, values, _ in data.values() if dims != "time"}
        coordinates: dict[str, Any] = {n: np.arange(1, count + 1) for n, count in counts.items()}
        coordinates["time"] = ("time", self.time, {"units": "s"})
        title = {"scene": self.scene["name"], "title": self.scene["title"]}
        return xr.Dataset(data, coordinates, title)

    def plot(self) -> dict[str, Any]:
        """Draw the figures of ``dockloop run`` that the recorded outputs allow.

        Returns:
            ``matplotlib.figure.Figure`` by name: motion, ring, loads, legs, energy.

        Raises:
            DockloopError: matplotlib is not installed.
        """
        import_optional("matplotlib")
        from dockloop.report.plots import draw_figures

        return draw_figures(self)

    def view(self, path: str | Path) -> Path:
        """Write the page of ``dockloop view``: the docking in three dimensions, opens offline.

        Args:
            path: the file, ``.html``.

        Returns:
            The file.

        Raises:
            UsageError: it is no ``.html`` file, another program made the file that is there, or
                these are histories of a sweep.
            DockloopError: the page cannot be written.
        """
        from dockloop.view.page import write_page

        file = paths.as_path("Result.view: path", path)
        self._check_whole("view")
        if file.suffix != ".html":
            raise UsageError(f"Result.view: {file} must end in .html")
        write_page(self, file)
        return file

    def _check_whole(self, what: str) -> None:
        """Refuse what needs the model. Raises UsageError: this is a history of a sweep."""
        if "mechanism" not in self.scene:
            raise UsageError(
                f"Result.{what}: a sweep keeps outputs of a case, without the model: run the case"
                " by itself with dl.run"
            )


def list_points(start: float, stop: float, step: float) -> np.ndarray:
    """Return all communication points [s]; the last step is shorter if it must be.

    Raises:
        UsageError: naming the value and the limit.
    """
    for option, value in (("--stop", stop), ("--step", step)):
        check_number(option, value)
    if stop <= start:
        raise UsageError(f"--stop {stop}: must be greater than the start time {start} s")
    if step <= 0.0:
        raise UsageError(f"--step {step}: must be greater than 0")
    steps = (stop - start) / step * (1.0 - 1e-12)
    if not steps <= _MAX_STEPS:
        raise UsageError(f"--step {step}: needs {steps:.6g} steps, more than {_MAX_STEPS}")
    times = start + step * np.arange(math.ceil(steps) + 1)
    times[-1] = stop
    return times


def check_size(points: int, columns: int, suffix: str, limit: float) -> None:
    """Refuse a result file that would be too large.

    Args:
        points: communication points.
        columns: variables written.
        suffix: of the file.
        limit: [GB].

    Raises:
        UsageError: naming the size, the limit, and what makes the file smaller.
    """
    if suffix == ".xlsx" and (points + 2 > _EXCEL[0] or columns > _EXCEL[1]):
        raise UsageError(
            f"the result would have {points} rows of {columns} values: Excel takes {_EXCEL[0] - 2}"
            f" rows of {_EXCEL[1]}: choose another format with -o, or a longer --step"
        )
    size = points * columns * _BYTES.get(suffix, 8) / 1e9
    if size > limit:
        raise UsageError(
            f"the result would have {points} rows of {columns} values, {size:.2g} GB: more than"
            f" {limit:g} GB: choose some with --outputs, a longer --step, or --max-gigabytes"
        )


def warn_of_driven(scene: dict) -> list[str]:
    """Return a warning for every vehicle whose motion a run alone cannot impose."""
    return [
        f"{vehicle} is driven, but no host imposes its motion in this run: it is put back"
        " to its start at every communication point"
        for vehicle in VEHICLES
        if scene.get(vehicle, {}).get("motion") == "driven"
    ]
