"""Lays measured histories over a run: time shift, peaks, energies, outcome, differences.

The shift is the one with the smallest sum of squares over all columns, each divided by its own
variance or that of the run, the larger one. So a column in a wrong unit does not decide alone.
In the first search, samples outside of the run count as if the run had the mean of the
column there, so that a small overlap does not win. The second search, near the first, counts only
samples inside. All other figures are those of the overlap.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from dockloop.measured.data import Data
from dockloop.results import Result

_SHIFTS, _SAMPLES = 2001, 2000  # of a search; the result is refined with all samples
_NEAR = 0.05  # part of the shorter side that the second search covers, both ways
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
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
    time = data.time[inside] + found
    columns = {
        name: {"unit": unit}
        | _compare_column(
            data[name][inside], read_run(run, name, time), time, band, data.accuracies.get(name)
        )
        for name, unit in zip(data.names, data.units, strict=True)
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


def read_run(run: Result, name: str, time: np.ndarray) -> np.ndarray:
    """Return an output of the run at other times, linear between communication points."""
    return np.interp(time, run.time, run[name])


def find_shift(run: Result, data: Data) -> float:
    """Return the shift with the smallest sum of squares [s]."""
    names = [name for name in data.names if np.ptp(data[name]) > 0.0 and not _is_choice(name)]
    if not names:
        return 0.0
    scales = {name: float(max(np.var(data[name]), np.var(run[name]))) for name in names}
    everything = np.arange(len(data.time))
    some = np.unique(np.linspace(0, len(data.time) - 1, _SAMPLES).astype(int))
    first = run.time[0] - data.time[-1], run.time[-1] - data.time[0]
    coarse = _search(lambda t: _calc_cost(run, data, scales, t, some, has_penalty=True), *first)

    def calc_fine(shift: float, rows: np.ndarray = some) -> float:
        return _calc_cost(run, data, scales, shift, rows, has_penalty=False)

    half = _NEAR * min(np.ptp(run.time), np.ptp(data.time))
    fine = _search(calc_fine, coarse - half, coarse + half)
    step = 2.0 * half / (_SHIFTS - 1)
    return _minimise(lambda t: calc_fine(t, everything), fine - step, fine + step)


def _calc_cost(
    run: Result,
    data: Data,
    scales: dict[str, float],
    shift: float,
    rows: np.ndarray,
    *,
    has_penalty: bool,
) -> float:
    """Return the sum over columns of mean squares over scales; inf without an overlap."""
    time = data.time[rows] + shift
    inside = (time >= run.time[0]) & (time <= run.time[-1])
    if not inside.any():
        return np.inf
    cost = 0.0
    for name, scale in scales.items():
        values = data[name][rows]
        error = read_run(run, name, time) - values
        outside = values.mean() - values
        error = np.where(inside, error, outside) if has_penalty else error[inside]
        cost += float(np.mean(error**2)) / scale
    return cost


def _search(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the best of equally spaced values."""
    values = np.linspace(low, high, _SHIFTS)
    return float(values[np.argmin([function(float(value)) for value in values])])


def _minimise(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the minimum between two bounds, by golden section."""
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a, at_b = function(a), function(b)
    while high - low > 1e-7:
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - _GOLDEN * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + _GOLDEN * (high - low)
            at_b = function(b)
    return 0.5 * (low + high)


def _is_choice(name: str) -> bool:
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
    if not len(time):
        return {}
    error = computed - measured
    size = np.abs(error)
    rms, spread = float(np.sqrt(np.mean(error**2))), float(np.ptp(measured))
    half = band * spread if accuracy is None else accuracy
    peaks = [int(np.argmax(np.abs(values))) for values in (measured, computed)]
    return {
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
        for vehicle in ("chaser", "target")
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
    time = data.time[inside] + shift
    sides = {
        "measured": {n: data[n][inside] for n in (speed, force) if n in data},
        "computed": {n: read_run(run, n, time) for n in (speed, force) if n in data},
    }
    figures: dict[str, dict[str, float]] = {}
    if len(time) < 2:
        return figures
    edge = max(1, round(_EDGE * len(time)))
    for side, values in sides.items():
        if speed in values:
            v, half = values[speed], 0.5 * find_mass(run)
            before, after = float(np.mean(v[:edge])), float(np.mean(v[-edge:]))
            figures.setdefault("axial motion at the start", {})[side] = half * before**2
            figures.setdefault("axial motion at the end", {})[side] = half * after**2
        if force in values:
            impulse = _integrate(values[force], time)
            figures.setdefault("impulse of the axial force", {})[side] = impulse
        if force in values and speed in values:
            work = -_integrate(values[force] * values[speed], time)
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
