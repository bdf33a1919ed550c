"""Reads measured time histories: a table of text whose header names outputs and units.

    time [s],relative.axial [mm] +-0.5,capture.compression [kN]
    0.000,12.5,0
    0.002,12.3,0.004

``+-0.5`` is the accuracy of the channel, in the unit of its header. Values become those of the
outputs, in SI units. What cannot be read is refused with file, column, row, and what is expected.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dockloop.errors import UsageError, did_you_mean
from dockloop.number import read_number
from dockloop.paths import read_bytes, shown

_COLUMN = re.compile(
    r"\s*(?P<name>[^\s\[]\S*)\s+\[(?P<unit>[^\[\]]+)\]\s*(\+-\s*(?P<accuracy>\S+)\s*)?"
)

# Unit of a header: unit of the output, and its size in it.
UNITS: dict[str, tuple[str, float]] = {
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "m/s": ("m/s", 1.0),
    "mm/s": ("m/s", 1e-3),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180.0),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", math.pi / 180.0),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "N m": ("N.m", 1.0),
    "N.m": ("N.m", 1.0),
    "kN m": ("N.m", 1e3),
    "J": ("J", 1.0),
    "1": ("1", 1.0),
}


@dataclass(frozen=True)
class Data:
    """Measured histories.

    Attributes:
        time: [s], increasing, shape (samples,).
        names: of the outputs that were measured.
        units: of these outputs.
        values: in these units, shape (samples, names).
        accuracies: of the outputs whose header states one, in their unit.
    """

    time: np.ndarray
    names: list[str]
    units: list[str]
    values: np.ndarray
    accuracies: dict[str, float] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        """Return whether an output was measured."""
        return name in self.names

    def __getitem__(self, name: str) -> np.ndarray:
        """Return one history, shape (samples,)."""
        return self.values[:, self.names.index(name)]


def read_data(path: Path, outputs: Sequence[str], units: Sequence[str]) -> Data:
    """Read a table of measurements.

    Args:
        path: the file.
        outputs: of the run, ``time`` first.
        units: of these.

    Raises:
        UsageError: naming file, column or row, and what is expected.
    """
    try:
        lines = read_bytes(path, "file of measurements").decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise UsageError(f"{shown(path)}: is no text in UTF-8 ({error.reason})") from None
    rows = [(i, line.split(",")) for i, line in enumerate(lines, 1) if line.strip()]
    if len(rows) < 3:
        raise UsageError(f"{shown(path)}: needs a header line and at least two rows of values")
    expected = dict(zip(outputs, units, strict=True))
    names, factors, accuracies = _read_header(path, rows[0][1], expected)
    values = np.array([_read_row(path, i, cells, names) for i, cells in rows[1:]]) * factors
    steps = np.diff(values[:, 0])
    if np.any(steps <= 0.0):
        row = rows[2 + int(np.argmax(steps <= 0.0))][0]
        raise UsageError(f"{shown(path)}: time must increase, but does not in line {row}")
    units_of_data = [expected[n] for n in names[1:]]
    return Data(values[:, 0], names[1:], units_of_data, values[:, 1:], accuracies)


def _read_header(
    path: Path, cells: list[str], expected: dict[str, str]
) -> tuple[list[str], np.ndarray, dict[str, float]]:
    """Return names of the columns, factors to the units of the outputs, stated accuracies."""
    names: list[str] = []
    accuracies: dict[str, float] = {}
    factors = []
    for cell in cells:
        found = _COLUMN.fullmatch(cell)
        if not found:
            raise UsageError(
                f"{shown(path)}: the header has '{cell.strip()}': must be an output and its unit,"
                " for example 'relative.axial [mm]' or 'relative.axial [mm] +-0.5'"
            )
        name, unit = found["name"], found["unit"].strip()
        if name not in expected:
            hint = did_you_mean(name, expected)
            raise UsageError(f"{shown(path)}: the run has no output '{name}'{hint}")
        if name in names:
            raise UsageError(f"{shown(path)}: has two columns '{name}'")
        names.append(name)
        factors.append(_find_factor(path, name, unit, expected[name]))
        if stated := found["accuracy"]:
            accuracy = _read_number(stated)
            if not accuracy > 0.0:
                raise UsageError(
                    f"{shown(path)}: the accuracy of '{name}' is '{stated}': must be a finite"
                    f" number above 0, in {unit}"
                )
            accuracies[name] = factors[-1] * accuracy
    if names[0] != "time" or len(names) < 2:
        raise UsageError(f"{shown(path)}: must begin with 'time [s]', and have one more column")
    return names, np.array(factors), accuracies


def _find_factor(path: Path, name: str, unit: str, expected: str) -> float:
    """Return the size of a unit in that of the output; outputs in 1 take every unit."""
    base, factor = UNITS.get(unit, ("", 0.0))
    expected = expected or "1"
    if not base or expected not in (base, "1"):
        fitting = [u for u, (b, _) in UNITS.items() if expected in (b, "1")]
        raise UsageError(
            f"{shown(path)}: '{name}' is in '{unit}': must be in {' or '.join(fitting)}"
        )
    return factor


def _read_row(path: Path, line: int, cells: list[str], names: list[str]) -> list[float]:
    """Return the numbers of a row."""
    if len(cells) != len(names):
        raise UsageError(
            f"{shown(path)}: line {line} has {len(cells)} values: must have {len(names)}"
        )
    numbers = []
    for name, cell in zip(names, cells, strict=True):
        number = _read_number(cell)
        if not math.isfinite(number):
            raise UsageError(
                f"{shown(path)}: '{name}' in line {line} is '{cell.strip()}': must be a finite"
                " number; leave out rows that were not measured"
            )
        numbers.append(number)
    return numbers


def _read_number(text: str) -> float:
    """Return a finite number; not a number if the text is none."""
    try:
        return read_number(text)
    except ValueError:
        return math.nan
