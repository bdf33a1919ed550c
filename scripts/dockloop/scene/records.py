"""Recorded motion of driven vehicles: entries of ``[[input]]`` that have position and attitude.

Between rows a motion is the cubic that has the poses and velocities of both, so that velocity and
acceleration belong to it. What a record lacks or contradicts is said in words.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dockloop.base.errors import UsageError, warn_once
from dockloop.base.histories import Data
from dockloop.base.rotations import conjugate, multiply
from dockloop.base.tables import find_moment

MEMBERS = {"position": "m", "velocity": "m/s", "attitude": "1", "angular_velocity": "rad/s"}
NAMES = [f"{m}[{i}]" for m in MEMBERS for i in range(1, 5 if m == "attitude" else 4)]
UNITS = [MEMBERS[name.partition("[")[0]] for name in NAMES]
_COLUMN = re.compile(r"(chaser|target)\.(\w+)\[(\d)\]")
_UNIT_ERROR = 1e-3  # of the length of a quaternion
_GAP = 10.0  # a gap, in usual intervals
_MOST_TURN = 60.0  # between rows [deg]
_SAME = 0.01  # of an interval: rows of two files that are one
_CONTRADICTION, _LEAST = 0.01, 1e-4  # of the change of velocity; [m/s] or [rad/s]


@dataclass
class _Part:
    """A member of a motion: place for messages, time [s], values, rates or None."""

    place: str
    time: np.ndarray
    value: np.ndarray
    rate: np.ndarray | None = None


@dataclass
class Records:
    """What entries of ``[[input]]`` say of the motion of vehicles.

    Attributes:
        document: the resolved scene without inputs.
    """

    document: Mapping[str, Any]
    _parts: dict[str, dict[str, _Part]] = field(default_factory=dict)
    _clock: tuple[str, str] | None = None  # moment of t = 0, time system

    def list_driven(self) -> list[str]:
        """Return the vehicles that a record can move."""
        vehicles = ("chaser", "target")
        return [v for v in vehicles if self.document.get(v, {}).get("motion") == "driven"]

    def complete(self, name: str, vehicle: str | None, place: str) -> str:
        """Return the full name of a column: ``position[1]`` means that of the driven vehicle.

        Raises:
            UsageError: no vehicle is driven, or several are and none is named.
        """
        if name not in NAMES:
            return name
        driven = [vehicle] if vehicle else self.list_driven()
        if len(driven) == 1 and driven[0] in self.list_driven():
            return f"{driven[0]}.{name}"
        if len(driven) == 2:
            raise UsageError(f'{place}: two vehicles are driven: state vehicle = "chaser"')
        wanted = driven[0] if driven else "chaser"
        raise UsageError(
            f'{place}: has a motion, but the {wanted} is not driven: set {wanted}.motion = "driven"'
        )

    def find_shift(self, data: Data, start: Any, place: str, *, is_motion: bool) -> float:
        """Return the time of a table at t = 0 of the run.

        Dates of motion share one t = 0: the first row of the first table, or what `start` states.

        Raises:
            UsageError: `start` is of another kind than the times, or time systems differ.
        """
        begin = data.source["time_from"]
        if begin is None:
            if start is not None and not isinstance(start, int | float):
                raise UsageError(f"{place}: start is '{start}': must be a number, as the times are")
            return float(start or 0.0)
        zero = start or begin
        if is_motion:
            system = data.source["form"].get("time_system", "")
            first, shared = self._clock or (zero, system)
            if system and shared and system != shared:
                raise UsageError(
                    f"{place}: has times of '{system}', another motion of '{shared}': convert one"
                )
            zero = start or first
            self._clock = (zero, shared or system)
        moments = [find_moment(str(moment)) for moment in (zero, begin)]
        if not moments[0] or not moments[1]:
            raise UsageError(f"{place}: start is '{start}': must be a date, as {begin}")
        days, seconds = (moments[0][i] - moments[1][i] for i in (0, 1))
        return 86400.0 * days + seconds

    def take(self, data: Data, place: str) -> list[str]:
        """Take the columns of motion out of a table; return the names of the others.

        Args:
            data: times are those of the run, names are complete.
            place: of the table.

        Raises:
            UsageError: naming the column, the time and what is expected.
        """
        groups: dict[tuple[str, str], dict[int, np.ndarray]] = {}
        others = []
        for name, values in zip(data.names, data.values.T, strict=True):
            found = _COLUMN.fullmatch(name)
            if found and found[2] in MEMBERS:
                groups.setdefault((found[1], found[2]), {})[int(found[3])] = values
            else:
                others.append(name)
        for (vehicle, member), columns in groups.items():
            count = 4 if member == "attitude" else 3
            if len(columns) < count:
                missing = next(i for i in range(1, count + 1) if i not in columns)
                raise UsageError(f"{place}: has no column '{vehicle}.{member}[{missing}]'")
            values = np.column_stack([columns[i] for i in range(1, count + 1)])
            is_there = np.isfinite(values)
            rows = is_there.all(axis=1)
            if (partly := is_there.any(axis=1) & ~rows).any():
                at = data.time[int(np.argmax(partly))]
                raise UsageError(f"{place}: {vehicle}.{member} at t = {at:.9g} s is not complete")
            parts = self._parts.setdefault(vehicle, {})
            if member in parts:
                raise UsageError(f"{place}: '{vehicle}.{member}' has a table already")
            part = _Part(f"{place}: {vehicle}.{member}", data.time[rows], values[rows])
            if len(part.time) < 2:
                raise UsageError(f"{part.place} has {len(part.time)} rows: must have two or more")
            if (again := np.flatnonzero(np.diff(part.time) <= 0.0)).size:
                at = part.time[int(again[0])]
                raise UsageError(f"{part.place} has two rows at t = {at:.9g} s: must have one")
            parts[member] = part
        return others

    def list_motions(self) -> list[dict[str, Any]]:
        """Return what the core reads: rows of pose and velocity of each recorded vehicle.

        Raises:
            UsageError: naming place, time, value and what is expected.
        """
        return [self._make_motion(vehicle, parts) for vehicle, parts in self._parts.items()]

    def _make_motion(self, vehicle: str, parts: dict[str, _Part]) -> dict[str, Any]:
        place = next(iter(parts.values())).place
        place = place[: place.rindex(": ")]
        position = parts.get("position")
        if position is None:
            raise UsageError(f"{place}: the record of the {vehicle} has no position")
        found = _differentiate(position)
        position.rate = _choose_rates(position, found, parts.get("velocity"), "m/s")
        attitude = parts.get("attitude")
        if attitude is None:
            if "angular_velocity" in parts:
                raise UsageError(f"{place}: the {vehicle} has angular velocities, but no attitude")
            warn_once(f"{place}: has no attitude: the {vehicle} keeps that of the scene")
            fixed = self.document[vehicle].get("attitude", [1.0, 0.0, 0.0, 0.0])
            ends = position.time[[0, -1]]
            attitude = _Part(place, ends, np.array([fixed, fixed]))
        _put_turns(attitude, parts.get("angular_velocity"))
        time = _join_times(position.time, attitude.time)
        self._check_span(place, vehicle, time)
        p, v = _resample(position, time)
        q, q_rate = _resample(attitude, time)
        length = np.linalg.norm(q, axis=1, keepdims=True)
        w = 2.0 * multiply(conjugate(q), q_rate)[:, 1:] / length**2
        return {
            "variable": f"{vehicle}.motion",
            "time": time.tolist(),
            "pose": np.hstack([p, q / length]).tolist(),
            "velocity": np.hstack([v, w]).tolist(),
        }

    def _check_span(self, place: str, vehicle: str, time: np.ndarray) -> None:
        experiment = self.document["experiment"]
        begin, end = experiment["start"], experiment["stop"]
        rounding = 1e-9 * max(abs(begin), abs(end))
        if len(time) < 2 or time[0] > begin + rounding or time[-1] < end - rounding:
            span = f"{time[0]:.9g} to {time[-1]:.9g} s" if len(time) else "0 s long"
            raise UsageError(
                f"{place}: the record of the {vehicle} is from {span}, the run from {begin:g} to"
                f" {end:g} s: record more, or set experiment.stop or the start of the record"
            )
        steps = np.diff(time)
        usual = np.median(steps)
        widest = int(np.argmax(steps))
        if steps[widest] > _GAP * usual:
            warn_once(
                f"{place}: has a gap of {steps[widest]:.3g} s at t = {time[widest]:.9g} s, between"
                f" rows every {usual:.3g} s: a cubic bridges it"
            )


def _differentiate(part: _Part) -> np.ndarray:
    """Return the rates of a spline through the values of a part."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(part.time, part.value)(part.time, 1)


def _choose_rates(part: _Part, found: np.ndarray, stated: _Part | None, unit: str) -> np.ndarray:
    """Return the rates that are stated, else those found from the values of a part.

    Raises:
        UsageError: they have other rows.
    """
    if stated is None:
        return found
    if not np.array_equal(stated.time, part.time):
        raise UsageError(f"{stated.place} has other rows than {part.place}: must have the same")
    error = np.linalg.norm(found - stated.value, axis=1)
    worst = int(np.argmax(error))
    if error[worst] > max(_CONTRADICTION * np.ptp(stated.value, axis=0).max(), _LEAST):
        warn_once(
            f"{stated.place} contradicts the rows of {part.place.rpartition(' ')[2]} by"
            f" {error[worst]:.3g} {unit} at t = {part.time[worst]:.9g} s: the motion follows both,"
            " and swings between rows"
        )
    return stated.value


def _put_turns(attitude: _Part, rate: _Part | None) -> None:
    """Make quaternions of length 1 and continuous, and give them rates."""
    q = attitude.value
    length = np.linalg.norm(q, axis=1)
    if (wrong := np.abs(length - 1.0) > _UNIT_ERROR).any():
        row = int(np.argmax(wrong))
        raise UsageError(
            f"{attitude.place} at t = {attitude.time[row]:.9g} s has length {length[row]:.6g}: must"
            " be 1 (order w, x, y, z)"
        )
    q = q / length[:, None]
    cosine = np.sum(q[1:] * q[:-1], axis=1)
    q[1:] *= np.cumprod(np.where(cosine < 0.0, -1.0, 1.0))[:, None]
    turn = np.degrees(2.0 * np.arccos(np.clip(np.abs(cosine), 0.0, 1.0)))
    if (turn > _MOST_TURN).any():
        row = int(np.argmax(turn))
        raise UsageError(
            f"{attitude.place} turns by {turn[row]:.3g} deg between the rows at"
            f" t = {attitude.time[row]:.9g} s and {attitude.time[row + 1]:.9g} s: must be at most"
            f" {_MOST_TURN:g} deg; record more rows"
        )
    attitude.value = q
    found = 2.0 * multiply(conjugate(q), _differentiate(attitude))[:, 1:]
    w = _choose_rates(attitude, found, rate, "rad/s")
    attitude.rate = 0.5 * multiply(q, np.hstack([np.zeros((len(q), 1)), w]))


def _join_times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the times of both within the span of both, those that are nearly one once."""
    if np.array_equal(a, b):
        return a
    apart = _SAME * min(np.median(np.diff(a)), np.median(np.diff(b)))
    near = np.clip(np.searchsorted(a, b)[:, None] + np.array([-1, 0]), 0, len(a) - 1)
    is_new = np.abs(b[:, None] - a[near]).min(axis=1) > apart
    every = np.sort(np.concatenate([a, b[is_new]]))
    begin, end = max(a[0], b[0]) - apart, min(a[-1], b[-1]) + apart
    return every[(every >= begin) & (every <= end)]


def _resample(part: _Part, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values and rates of the cubics of a part; with other rows the motion is the same."""
    from scipy.interpolate import CubicHermiteSpline

    if np.array_equal(part.time, time):
        return part.value, np.asarray(part.rate)
    spline = CubicHermiteSpline(part.time, part.value, part.rate)
    return spline(time), spline(time, 1)
