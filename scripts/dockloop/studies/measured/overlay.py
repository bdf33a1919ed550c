"""Lays measured histories over a run: time shift, peaks, energies, outcome, differences.

The shift is the one with the smallest sum of squares over all columns, each divided by its own
variance or that of the run, the larger one. So a column in a wrong unit does not decide alone.
Counters, residuals and times of events say nothing of a shift, nor does a column that has no value
in common with the run: they do not take part. Of many columns the first ones of motion and loads
do. In the first search, a quarter of the shorter side overlaps at least, and samples outside of the
run count as if the run had the mean of the column there, so that a small overlap does not win. The
second search, near the first, counts only samples inside. No shift is a candidate, too: it wins if
it is better in one search and no worse in the other. An unknown offset or factor of a column is the
best one for each shift. All other figures are those of the overlap.
"""

from collections.abc import Callable, Collection, Mapping
from operator import le, lt
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.histories import Data
from dockloop.base.paths import shown
from dockloop.native.variables import VEHICLES
from dockloop.result.recording import Result

_SHIFTS, _SAMPLES = 2001, 2000  # of a search; the result is refined with all samples
_COLUMNS = 40  # that are searched at most
_LEAST = 0.25  # part of the shorter side that overlaps in the first search
_MOTION = ("relative.", "capture.", "ring.", "leg[", "contact.")  # names of these come first
_NEAR = 0.05  # part of the shorter side that the second search covers, both ways
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
_Samples = dict[str, tuple[np.ndarray, np.ndarray]]  # by column: time and values
_EDGE = 0.02  # part of the overlap over which speeds at its ends are averaged


def compare(run: Result, data: Data, band: float, shift: float | None = None) -> dict[str, Any]:
    """Return all figures of a comparison.

    Args:
        run: what was recorded.
        data: what was measured.
        band: half width of the error band, part of the range of the measured values in the overlap;
            it holds for columns whose header states no accuracy.
        shift: time of the run less time of the data [s]; None: find it.

    Returns:
        ``shift`` [s], ``shift_found``, ``overlap`` (part of the samples inside the run),
        ``columns`` (by name: peaks, differences, part inside the band), ``energies``,
        ``captured``.
    """
    found = find_shift(run, data) if shift is None else shift
    inside = find_inside(run, data, found)
    columns = {
        name: {"unit": unit}
        | _compare_column(values, read_run(run, name, when), when, band, data.accuracies.get(name))
        for name, unit in zip(data.names, data.units, strict=True)
        for when, values in [read_samples(data, name, inside, found)]
    }
    return {
        "shift": found,
        "shift_found": shift is None,
        "overlap": float(np.mean(inside)),
        "samples": int(inside.sum()),
        "band": band,
        "columns": columns,
        "energies": _compare_energies(run, data, found, inside),
        "captured": _compare_capture(run, data, found),
    }


def find_inside(run: Result, data: Data, shift: float) -> np.ndarray:
    """Return which samples fall into the run."""
    time = data.time + shift
    return (time >= run.time[0]) & (time <= run.time[-1])


class TooFewSamplesError(UsageError):
    """Too few samples fall into the run at a shift."""


def check_overlap(path: Path, run: Result, data: Data, shift: float, origin: str) -> None:
    """Refuse data of which too few samples fall into the run. Raises TooFewSamplesError."""
    inside = find_inside(run, data, shift)
    for name in data.names:
        count = len(read_samples(data, name, inside, shift)[0])
        if count < 2:
            raise TooFewSamplesError(
                f"{shown(path)}: {count} samples of '{name}' fall into the run from"
                f" {run.time[0]:g} to {run.time[-1]:g} s at the shift of {shift:g} s that was"
                f" {origin}: give another --shift, or leave the column out"
            )


def read_samples(
    data: Data, name: str, inside: np.ndarray, shift: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return time of the run and values of the samples of a column, without those it lacks."""
    measured = inside & np.isfinite(data[name])
    return data.time[measured] + shift, data[name][measured]


def read_run(run: Result, name: str, time: np.ndarray) -> np.ndarray:
    """Return an output of the run at other times, linear between communication points."""
    return np.interp(time, run.time, run[name])


def find_shift(run: Result, data: Data, unknowns: Mapping[str, Collection[str]] = {}) -> float:
    """Return the shift with the smallest sum of squares [s].

    Args:
        run: what was recorded.
        data: what was measured.
        unknowns: what else is not known of columns: ``offset``, ``scale``.
    """
    everywhere = np.ones(len(data.time), dtype=bool)
    every = {name: read_samples(data, name, everywhere, 0.0) for name in data.names}
    every = {n: (t, v) for n, (t, v) in every.items() if np.ptp(v) > 0.0 and _has_phase(n)}
    every = {n: of for n, of in every.items() if unknowns.get(n) or _do_meet(of[1], run[n])}
    chosen = sorted(every, key=lambda name: not name.startswith(_MOTION))[:_COLUMNS]
    every = {name: every[name] for name in chosen}
    if not every:
        return 0.0
    scales = {name: float(max(np.var(v), np.var(run[name]))) for name, (_, v) in every.items()}
    some = {name: _thin(time, values) for name, (time, values) in every.items()}
    least = _LEAST * min(np.ptp(run.time), np.ptp(data.time))
    first = run.time[0] - data.time[-1] + least, run.time[-1] - data.time[0] - least

    def calc(shift: float, samples: _Samples, *, has_penalty: bool) -> float:
        return _calc_cost(run, samples, scales, unknowns, shift, has_penalty=has_penalty)

    coarse = _search(lambda t: calc(t, some, has_penalty=True), *first)
    half = _NEAR * min(np.ptp(run.time), np.ptp(data.time))
    fine = _search(lambda t: calc(t, some, has_penalty=False), coarse - half, coarse + half)
    step = 2.0 * half / (_SHIFTS - 1)
    best = _minimise(lambda t: calc(t, every, has_penalty=False), fine - step, fine + step)
    at_none, at_best = (
        [calc(t, every, has_penalty=penalty) for penalty in (True, False)] for t in (0.0, best)
    )
    is_better = all(map(le, at_none, at_best)) and any(map(lt, at_none, at_best))
    return 0.0 if is_better else best


def _thin(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return some samples of a column."""
    rows = np.unique(np.linspace(0, len(time) - 1, _SAMPLES).astype(int))
    return time[rows], values[rows]


def _calc_cost(
    run: Result,
    samples: _Samples,
    scales: dict[str, float],
    unknowns: Mapping[str, Collection[str]],
    shift: float,
    *,
    has_penalty: bool,
) -> float:
    """Return the sum over columns of mean squares over scales; inf if one has no overlap."""
    cost = 0.0
    for name, (time, values) in samples.items():
        time = time + shift  # noqa: PLW2901
        inside = (time >= run.time[0]) & (time <= run.time[-1])
        if not inside.any():
            return np.inf
        error = _meet(read_run(run, name, time[inside]), values[inside], unknowns.get(name, ()))
        total = float(np.sum(error**2))
        if has_penalty:
            total += float(np.sum((values.mean() - values[~inside]) ** 2))
        cost += total / (len(values) if has_penalty else len(error)) / scales[name]
    return cost


def _meet(computed: np.ndarray, measured: np.ndarray, unknowns: Collection[str]) -> np.ndarray:
    """Return differences at the best offset and the best factor, as far as they are not known."""
    if "offset" in unknowns:
        computed, measured = computed - computed.mean(), measured - measured.mean()
    if "scale" in unknowns:
        size = float(computed @ computed)
        computed = computed * (max(float(computed @ measured), 0.0) / size if size else 1.0)
    return computed - measured


def _search(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the best of equally spaced values."""
    values = np.linspace(low, high, _SHIFTS)
    return float(values[np.argmin([function(float(value)) for value in values])])


def _minimise(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the minimum between two bounds, by golden section."""
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a, at_b = function(a), function(b)
    rounding = 4.0 * np.spacing(max(abs(low), abs(high)))  # of seconds since 1970: above 1e-7
    while high - low > max(1e-7, rounding):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - _GOLDEN * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + _GOLDEN * (high - low)
            at_b = function(b)
    return 0.5 * (low + high)


def _do_meet(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether two columns have values in common."""
    return bool(max(a.min(), b.min()) <= min(a.max(), b.max()))


def _has_phase(name: str) -> bool:
    """Return whether an output follows the motion: a shift of time shows in it."""
    is_event = name.endswith(("_time", "_step", ".time")) or ".peak" in name or "time_" in name
    is_audit = name.startswith(("solver.", "coupling.", "limits.")) or name.endswith(".residual")
    return not (is_choice(name) or is_event or is_audit)


def is_choice(name: str) -> bool:
    """Return whether an output counts or chooses: nothing between its values."""
    return name.startswith("latched") or name in ("captured", "phase", "outcome")


def _compare_column(
    measured: np.ndarray,
    computed: np.ndarray,
    time: np.ndarray,
    band: float,
    accuracy: float | None,
) -> dict[str, float | None]:
    """Return the figures of one column over the overlap.

    An accuracy, in the unit of the column, is the half width of its error band.
    """
    error = computed - measured
    size = np.abs(error)
    rms, spread = float(np.sqrt(np.mean(error**2))), float(np.ptp(measured))
    half = band * spread if accuracy is None else accuracy
    peaks = [int(np.argmax(np.abs(values))) for values in (measured, computed)]
    return {
        "samples": len(time),
        "measured_peak": float(measured[peaks[0]]),
        "measured_peak_time": float(time[peaks[0]]),
        "computed_peak": float(computed[peaks[1]]),
        "computed_peak_time": float(time[peaks[1]]),
        "rms": rms,
        "range": spread,
        "relative_rms": rms / spread if spread > 0.0 else None,
        "bias": float(np.mean(error)),
        "largest_error": float(np.max(size)),
        "half_band": half,
        "in_band": float(np.mean(size <= half)),
    }


def find_mass(run: Result) -> float:
    """Return the relative mass of the vehicles along the axis [kg]."""
    inverse = sum(
        1.0 / run.parameters[f"{vehicle}.mass"]
        for vehicle in VEHICLES
        if run.scene.get(vehicle, {}).get("motion") != "fixed"
    )
    return 1.0 / inverse if inverse > 0.0 else 0.0


def _integrate(values: np.ndarray, time: np.ndarray) -> float:
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(time)))


def _compare_energies(
    run: Result, data: Data, shift: float, inside: np.ndarray
) -> dict[str, dict[str, float]]:
    """Return energies along the axis, as far as what was measured allows [J], impulse [N s]."""
    speed, force = "relative.velocity[1]", "capture.force[1]"
    samples = {n: read_samples(data, n, inside, shift) for n in (speed, force) if n in data}
    figures: dict[str, dict[str, float]] = {}
    for side in ("measured", "computed"):
        values = {
            name: (time, measured if side == "measured" else read_run(run, name, time))
            for name, (time, measured) in samples.items()
        }
        if speed in values:
            time, v = values[speed]
            edge, half = max(1, round(_EDGE * len(time))), 0.5 * find_mass(run)
            before, after = float(np.mean(v[:edge])), float(np.mean(v[-edge:]))
            figures.setdefault("axial motion at the start", {})[side] = half * before**2
            figures.setdefault("axial motion at the end", {})[side] = half * after**2
        if force in values:
            time, f = values[force]
            figures.setdefault("impulse of the axial force", {})[side] = _integrate(f, time)
        if force in values and speed in values:
            work = -_integrate(f * np.interp(time, *values[speed]), time)
            figures.setdefault("energy taken by the axial force", {})[side] = work
    return figures


def _compare_capture(run: Result, data: Data, shift: float) -> dict[str, Any]:
    """Return whether and when each side was captured, if that was measured [s of the run]."""
    if "captured" not in data:
        return {}
    measured = np.flatnonzero(data["captured"] > 0.5)
    computed = np.flatnonzero(run["captured"] > 0.5)
    return {
        "measured": bool(measured.size),
        "measured_time": float(data.time[measured[0]] + shift) if measured.size else None,
        "computed": bool(computed.size),
        "computed_time": float(run.time[computed[0]]) if computed.size else None,
    }
