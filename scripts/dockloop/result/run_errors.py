"""The error of a run: one definition for all commands that compare runs.

Two runs of one docking are compared: peak loads, stroke, time of capture, final motion. Every
figure is divided by a scale of the reference result; the largest one is the error of the run. A run
with another outcome has an infinite error. The moving frame is P seen from A (``relative``) where
there is a target, and otherwise the ring.

What a user reads in addition (`find_further_figures`): times of contact and of the sequence, and
outputs that the user chose.
"""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.native.core import list_loads
from dockloop.native.variables import MOTION, NO_TIME, happened
from dockloop.result.criteria import PEAK
from dockloop.result.recording import Result

_OUTCOME, _CAPTURE = ("outcome", "captured"), "time_of_capture"
_TIMES = re.compile(r"time_of_contact|sequence\.entered\[\d+\]")  # -1: did not happen
_NO_FIGURES = re.compile(  # of the integration, not of the docking; a place is not that of a load
    r"solver\..*|.*residual|capture\.peak_(time|step)\..*"
)
_LEAST = 1e-3  # no scale but that of a peak is smaller, in its unit
_LEAST_PEAK = 0.05  # no peak is compared with less than this part of the largest one of its unit
_LEAST_ARM = 1e-3  # m: no moment with less than the largest force at this arm

_SCALES = {  # unit of a figure, and words for what it is divided by
    "stroke": ("m", "the largest displacement of the ring from its start"),
    "time_of_capture": ("s", "the time from first contact to capture"),
    "final_position": ("m", "the largest displacement from the start"),
    "final_attitude": ("rad", "the largest turn from the start"),
    "final_velocity": ("m/s", "the largest velocity"),
    "final_angular_velocity": ("rad/s", "the largest angular velocity"),
}


def find_frame(outputs: Sequence[str]) -> str:
    """Return the moving frame whose motion is compared.

    Raises:
        UsageError: the scene exports no motion.
    """
    for frame in ("relative", "ring"):
        if f"{frame}.position[1]" in outputs:
            return frame
    raise UsageError(
        "the scene exports neither the outputs 'relative' nor 'ring', with which the solution is"
        " compared: add one of them to outputs.groups"
    )


def find_compared(outputs: Sequence[str]) -> list[str]:
    """Return those of an FMU's outputs that are compared with the reference result."""
    frame = find_frame(outputs)
    vectors = (*(f"{frame}.{name}[" for name in MOTION), "ring.position[")
    names = {*_OUTCOME, "time_of_contact", _CAPTURE, *_list_peaks()}
    return [name for name in outputs if name in names or name.startswith(vectors)]


def is_figure(output: str) -> bool:
    """Return whether an output says something of the docking, and not of its integration."""
    return not _NO_FIGURES.fullmatch(output)


def list_further(outputs: Sequence[str], chosen: Iterable[str]) -> list[str]:
    """Return the outputs that `find_further_figures` compares."""
    wanted = {name for name in chosen if is_figure(name)}
    return [name for name in outputs if name in wanted or _TIMES.fullmatch(name)]


def find_scales(reference: Result) -> dict[str, float]:
    """Return what the figures are divided by, for each figure that it has."""
    frame = find_frame(reference.names)
    scales = {}
    if "ring.position[1]" in reference:
        scales["stroke"] = _find_stroke(reference.vector("ring.position"))
    if _CAPTURE in reference and happened(reference[_CAPTURE][-1]):
        scales[_CAPTURE] = reference[_CAPTURE][-1] - reference["time_of_contact"][-1]
    for name in MOTION:
        points = reference.vector(f"{frame}.{name}")
        start = np.zeros_like(points) if name.endswith("velocity") else points[:1]
        scales[f"final_{name}"] = np.max(_find_distances(name, points, start))
    least = {name: max(float(scale), _LEAST) for name, scale in scales.items()}
    return _find_peak_scales(_find_peaks(reference)) | least


def describe_scale(figure: str) -> tuple[str, str]:
    """Return the unit of a figure, and words for what it is divided by."""
    if figure in _SCALES:
        return _SCALES[figure]
    unit = list_loads()[figure.removeprefix(PEAK)]
    part = f"the peak, at least {100.0 * _LEAST_PEAK:g} % of the largest one of its unit"
    arm = f", and the largest force at an arm of {1e3 * _LEAST_ARM:g} mm" if unit == "N m" else ""
    return unit, part + arm


def find_figures(reference: Result, run: Result) -> dict[str, float]:
    """Return the relative errors of a run.

    Args:
        reference: the same docking, closer to the solution.
        run: at the same communication points, or at points among which are those of `reference`.

    Returns:
        By name: ``capture.peak.NAME`` over the peak itself (at least 5 % of the largest peak of its
        unit; a moment also over the largest force at an arm of 1 mm), ``stroke`` over the largest
        displacement of the ring, ``time_of_capture`` over the time from contact to capture, final
        motion over its largest value. Figures that the scene does not have are left out. Without
        capture in one of the two runs ``time_of_capture`` is infinite.
    """
    scales, frame = find_scales(reference), find_frame(reference.names)
    figures = compare_peaks(_find_peaks(reference), _find_peaks(run))
    if "stroke" in scales:
        ours, theirs = _take_common("ring.position", reference, run)
        figures["stroke"] = abs(_find_stroke(ours) - _find_stroke(theirs)) / scales["stroke"]
    if _CAPTURE in reference:
        times = [each[_CAPTURE][-1] for each in (run, reference)]
        if all(map(happened, times)):
            figures[_CAPTURE] = float(abs(times[0] - times[1]) / scales[_CAPTURE])
        elif any(map(happened, times)):
            figures[_CAPTURE] = np.inf
    for name in MOTION:
        ends = [each.vector(f"{frame}.{name}")[-1:] for each in (run, reference)]
        figures[f"final_{name}"] = float(_find_distances(name, *ends)[0] / scales[f"final_{name}"])
    return figures


def find_further_figures(
    reference: Result, run: Result, chosen: Iterable[str] = ()
) -> dict[str, float]:
    """Return the relative errors of times of contact and of the sequence, and of chosen outputs.

    Args:
        reference: the same docking, closer to the solution.
        run: as for `find_figures`.
        chosen: outputs; those that are no figures (`is_figure`), or are in `find_figures`, are
            left out.

    Returns:
        By output, of its value at the end: of a time over the time from first contact, before that
        from the start; of others over the largest value in the run. No scale is less than 1e-3 in
        its unit. What happened in one of the runs only is infinite.
    """
    figures = {}
    contact = reference["time_of_contact"][-1] if "time_of_contact" in reference else NO_TIME
    others = [name for name in chosen if name not in (*_OUTCOME, _CAPTURE)]
    for name in list_further(reference.names, (n for n in others if n not in _list_peaks())):
        ours, theirs = float(run[name][-1]), float(reference[name][-1])
        if _TIMES.fullmatch(name):
            since = contact if happened(contact) and contact < theirs else reference.time[0]
            scale, is_same = theirs - since, happened(ours) == happened(theirs)
            figures[name] = abs(ours - theirs) / max(scale, _LEAST) if is_same else np.inf
        else:
            figures[name] = abs(ours - theirs) / max(np.max(np.abs(reference[name])), _LEAST)
    return {name: float(error) for name, error in figures.items()}


def has_same_outcome(reference: Result, run: Result) -> bool:
    """Return whether two runs end alike: outcome, and capture or none, also in between."""

    def find_end(of: Result) -> list[float]:
        ends = [round(of[name][-1]) for name in _OUTCOME if name in reference]
        return [*ends, _CAPTURE in reference and happened(of[_CAPTURE][-1])]

    return find_end(reference) == find_end(run)


def find_errors(reference: Result, run: Result) -> dict[str, float]:
    """Return the `find_figures`, and ``outcome``: infinite if it is another one, otherwise 0."""
    is_same = has_same_outcome(reference, run)
    return find_figures(reference, run) | {"outcome": 0.0 if is_same else np.inf}


def find_worst(figures: Mapping[str, float]) -> tuple[str, float]:
    """Return the figure that decides the error, and the error; NaN is worse than any number."""
    return max(figures.items(), key=lambda item: (np.isnan(item[1]), item[1]))


def find_error(reference: Result, run: Result) -> float:
    """Return the error of a run: the largest of the `find_errors`."""
    return find_worst(find_errors(reference, run))[1]


def compare_peaks(reference: Mapping[str, float], run: Mapping[str, float]) -> dict[str, float]:
    """Return the relative errors of the peak loads, ``capture.peak.NAME``, that both runs have."""
    scales = _find_peak_scales({name: reference[name] for name in reference if name in run})
    return {name: float(abs(run[name] - reference[name]) / s) for name, s in scales.items()}


def find_largest_errors(reference: Result, run: Result) -> dict[str, float]:
    """Return the largest errors of position [m] and attitude [rad] over the whole run."""
    frame, largest = find_frame(reference.names), {}
    for name in ("position", "attitude"):
        ours, theirs = _take_common(f"{frame}.{name}", reference, run)
        largest[name] = float(np.max(_find_distances(name, ours, theirs)))
    return largest


def find_times(wanted: np.ndarray, times: np.ndarray) -> np.ndarray | None:
    """Return the indices of the wanted times, to a nanosecond; None if one is not there."""
    nearest = np.abs(times[np.newaxis, :] - wanted[:, np.newaxis]).argmin(axis=1)
    return nearest if np.max(np.abs(times[nearest] - wanted)) < 1e-9 else None


def _take_common(name: str, reference: Result, run: Result) -> tuple[np.ndarray, np.ndarray]:
    """Return a vector of a run and of the reference result, at the points of the latter."""
    ours, here = run.vector(name), find_times(reference.time, run.time)
    return ours if here is None else ours[here], reference.vector(name)


def _list_peaks() -> list[str]:
    return [f"{PEAK}{load}" for load in list_loads()]


def _find_peaks(run: Result) -> dict[str, float]:
    return {name: run[name][-1] for name in run.names if name.startswith(PEAK)}


def _find_peak_scales(peaks: Mapping[str, float]) -> dict[str, float]:
    """Return what peak loads are divided by; without those of a unit in which there is no load."""
    units = {f"{PEAK}{load}": unit for load, unit in list_loads().items()}
    names = [name for name in units if name in peaks]
    largest = {u: max(peaks[n] for n in names if units[n] == u) for u in map(units.get, names)}
    least = {unit: _LEAST_PEAK * load for unit, load in largest.items()}
    if "N m" in least:  # by symmetry moments can be those of rounding alone
        least["N m"] = max(least["N m"], _LEAST_ARM * largest.get("N", 0.0))
    scales = {name: max(peaks[name], least[units[name]]) for name in names}
    return {name: float(scale) for name, scale in scales.items() if scale > 0.0}


def _find_stroke(positions: np.ndarray) -> float:
    """Return the largest displacement from the start [m]."""
    return float(np.max(_find_distances("position", positions, positions[:1])))


def _find_distances(name: str, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances of points, or the angles [rad] between attitudes (scalar first)."""
    if name != "attitude":
        return np.linalg.norm(a - b, axis=1)
    vector = (
        a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
    )  # of the quaternion from one to the other; small without cancellation
    return 2.0 * np.arcsin(np.minimum(1.0, np.linalg.norm(vector, axis=1)))
