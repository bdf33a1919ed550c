"""How wrong a run is: figures against the reference solution, and the one scalar of them.

Every figure that has a unit is divided by a scale of the reference solution before the worst one is
taken. The moving frame is P seen from A (``relative``) where there is a target, and otherwise the
ring. Runs are compared at the points of time that they have in common with the reference solution.
"""

import math

import numpy as np

from dockloop.core import list_loads
from dockloop.errors import UsageError
from dockloop.simulate import Recording

_ENTRIES = {"position": 3, "attitude": 4, "velocity": 3, "angular_velocity": 3}

# What each relative figure is divided by: name of the figure -> unit and words for the scale.
SCALES = {
    "peaks": ("N", "largest peak force"),
    "peak_moments": ("N m", "largest peak moment"),
    "stroke": ("m", "stroke: largest displacement of the ring from its start"),
    "capture_time_s": ("s", "time from first contact to capture"),
    "position_m": ("m", "largest displacement from the start"),
    "attitude_rad": ("rad", "largest turn from the start"),
    "end_velocity_m_s": ("m/s", "largest velocity"),
    "end_angular_velocity_rad_s": ("rad/s", "largest angular velocity"),
}
_LEAST = 1e-3  # no scale is smaller, in its unit

ERRORS = {
    "error": "the worst of the relative ones below; empty when the outcome is another",
    "decided_by": "which one it is",
    "peaks": "peak loads until the end, worst of the five: forces over the largest peak force,"
    " moments over the largest peak moment",
    "stroke": "largest displacement of the ring from its start, relative",
    "capture_time_s": "time of capture [s]",
    "position_m": "largest error of the position of {frame} [m]",
    "attitude_rad": "largest error of the attitude of {frame} [rad]",
    "end_velocity_m_s": "velocity of {frame} at the end [m/s]",
    "end_angular_velocity_rad_s": "angular velocity of {frame} at the end [rad/s]",
    "outcome_matches": "whether outcome and capture are those of the reference solution",
}
AUDITS = {
    "momentum_residual": "largest `momentum.residual` of the run",
    "energy_residual_J": "largest `energy.residual` of the run [J]",
    "loop_gap_m": "largest `solver.closure_residual` of the run [m]",
}
_AUDITED = dict(
    zip(AUDITS, ("momentum.residual", "energy.residual", "solver.closure_residual"), strict=True)
)


def find_frame(outputs: list[str]) -> str:
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


def find_compared(outputs: list[str]) -> list[str]:
    """Return those of an FMU's outputs that are compared with the reference solution."""
    frame = find_frame(outputs)
    names = [f"{frame}.{name}[{i + 1}]" for name, n in _ENTRIES.items() for i in range(n)]
    names += [f"ring.position[{i}]" for i in (1, 2, 3)]
    names += [f"capture.peak.{load}" for load in list_loads()]
    names += ["outcome", "time_of_contact", "time_of_capture"]
    return [name for name in dict.fromkeys(names) if name in outputs]


def find_scales(solution: Recording) -> dict[str, float]:
    """Return what the figures are divided by, those of `SCALES` that the reference solution has."""
    frame, scales = find_frame(solution.names), {}

    def peak(wanted: str) -> float:
        loads = [load for load, unit in list_loads().items() if unit == wanted]
        return max(solution[f"capture.peak.{load}"][-1] for load in loads)

    if "capture.peak.shear" in solution:
        scales["peaks"], scales["peak_moments"] = peak("N"), peak("N m")
    if "ring.position[1]" in solution:
        scales["stroke"] = _stroke(solution.vector("ring.position"))
    if "time_of_capture" in solution and solution["time_of_capture"][-1] >= 0.0:
        scales["capture_time_s"] = solution["time_of_capture"][-1] - solution["time_of_contact"][-1]
    turns = solution.vector(f"{frame}.attitude")
    scales["position_m"] = _stroke(solution.vector(f"{frame}.position"))
    scales["attitude_rad"] = float(np.max(_angles(turns, turns[:1])))
    for figure, name in (
        ("end_velocity_m_s", "velocity"),
        ("end_angular_velocity_rad_s", "angular_velocity"),
    ):
        scales[figure] = np.max(np.linalg.norm(solution.vector(f"{frame}.{name}"), axis=1))
    return {name: max(float(scale), _LEAST) for name, scale in scales.items()}


def find_errors(solution: Recording, run: Recording) -> dict:
    """Compare a run with the reference solution; figures that a scene does not have are None.

    Returns:
        A value for each name in `ERRORS`.
    """
    scales, frame = find_scales(solution), find_frame(solution.names)
    here = find_times(solution["time"], run["time"])
    figures = dict.fromkeys(ERRORS)

    def pair(name: str) -> tuple[np.ndarray, np.ndarray]:
        return run.vector(name)[here], solution.vector(name)

    if "peaks" in scales:
        figures["peaks"] = max(
            abs(run[f"capture.peak.{load}"][-1] - solution[f"capture.peak.{load}"][-1])
            / scales["peaks" if unit == "N" else "peak_moments"]
            for load, unit in list_loads().items()
        )
    if "stroke" in scales:
        ours, theirs = (_stroke(points) for points in pair("ring.position"))
        figures["stroke"] = abs(ours - theirs) / scales["stroke"]
    ours, theirs = pair(f"{frame}.position")
    figures["position_m"] = np.max(np.linalg.norm(ours - theirs, axis=1))
    figures["attitude_rad"] = np.max(_angles(*pair(f"{frame}.attitude")))
    for figure, name in (
        ("end_velocity_m_s", "velocity"),
        ("end_angular_velocity_rad_s", "angular_velocity"),
    ):
        ours, theirs = pair(f"{frame}.{name}")
        figures[figure] = np.linalg.norm(ours[-1] - theirs[-1])
    figures["outcome_matches"] = True
    if "time_of_capture" in solution:
        when = [r["time_of_capture"][-1] for r in (run, solution)]
        if min(when) >= 0.0:
            figures["capture_time_s"] = abs(when[0] - when[1])
        same = round(run["outcome"][-1]) == round(solution["outcome"][-1])
        figures["outcome_matches"] = same and (when[0] >= 0.0) == (when[1] >= 0.0)
    relative = {
        name: value / (1.0 if name in ("peaks", "stroke") else scales[name])
        for name, value in figures.items()
        if name in scales and value is not None
    }
    worst = max(relative, key=relative.get)
    if figures["outcome_matches"] and all(math.isfinite(value) for value in relative.values()):
        figures["error"], figures["decided_by"] = relative[worst], worst
    return {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in figures.items()
    }


def find_audits(run: Recording) -> dict[str, float | None]:
    """Return the residuals of a run by itself, a value for each name in `AUDITS`."""
    return {
        name: float(np.max(np.abs(run[output]))) if output in run else None
        for name, output in _AUDITED.items()
    }


def find_times(wanted: np.ndarray, times: np.ndarray) -> np.ndarray | None:
    """Return the indices of the wanted times, to a nanosecond; None if one is not there."""
    nearest = np.abs(times[np.newaxis, :] - wanted[:, np.newaxis]).argmin(axis=1)
    return nearest if np.max(np.abs(times[nearest] - wanted)) < 1e-9 else None


def _stroke(positions: np.ndarray) -> float:
    return float(np.max(np.linalg.norm(positions - positions[0], axis=1)))


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles [rad] between the attitudes of two lists of quaternions, scalar first."""
    vector = (
        a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
    )  # of the quaternion from one to the other; small without cancellation
    return 2.0 * np.arcsin(np.minimum(1.0, np.linalg.norm(vector, axis=1)))
