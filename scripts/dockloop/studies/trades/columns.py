"""What a trade measures of a run: its error, residuals and cost, one column for each."""

import math

import numpy as np

from dockloop.result.criteria import PEAK
from dockloop.result.recording import Result
from dockloop.result.run_errors import (
    find_errors,
    find_largest_errors,
    find_worst,
    has_same_outcome,
)

ERRORS = {
    "error": "the worst of the relative ones, as `accuracy` means it; empty when the outcome is"
    " another",
    "decided_by": "which one it is; one of the peak loads by its name",
    "peaks": "worst of the peak loads until the end, relative",
    "stroke": "largest displacement of the ring from its start, relative",
    "time_of_capture": "over the time from first contact to capture",
    "final_position": "position of {frame} at the end, relative",
    "final_attitude": "attitude of {frame} at the end, relative",
    "final_velocity": "velocity of {frame} at the end, relative",
    "final_angular_velocity": "angular velocity of {frame} at the end, relative",
    "position_m": "largest error of the position of {frame} over the whole run [m]; no part of"
    " `error`",
    "attitude_rad": "the same of the attitude [rad]",
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
COSTS = {
    "evaluations": "`solver.rhs_evaluations`; a Jacobian counts as one per column",
    "steps": "`solver.steps`",
    "rejected_steps": "`solver.rejected_steps`",
    "time_ratio": "processor time inside fmi2DoStep over that of the default setting, which was run"
    " next to it by turns: ratio of the medians",
    "time_ratio_of_best": "ratio of the shortest ones",
}
FIGURES = (*ERRORS, *AUDITS, *COSTS)


def find_error_columns(solution: Result, run: Result) -> dict:
    """Compare a run with the reference solution; figures that a scene does not have are None.

    Returns:
        A value for each name in `ERRORS`.
    """
    figures = find_errors(solution, run)
    decided_by, error = find_worst(figures)
    peaks = [value for name, value in figures.items() if name.startswith(PEAK)]
    largest = find_largest_errors(solution, run)
    known = figures | {
        "peaks": max(peaks, default=None),
        "position_m": largest["position"],
        "attitude_rad": largest["attitude"],
        "outcome_matches": has_same_outcome(solution, run),
    }
    if all(map(math.isfinite, figures.values())):
        known |= {"error": error, "decided_by": decided_by}
    row = {name: known.get(name) for name in ERRORS}
    return {n: None if isinstance(v, float) and not math.isfinite(v) else v for n, v in row.items()}


def find_audits(run: Result) -> dict[str, float | None]:
    """Return the residuals of a run by itself, a value for each name in `AUDITS`."""
    return {
        name: float(np.max(np.abs(run[output]))) if output in run else None
        for name, output in _AUDITED.items()
    }
