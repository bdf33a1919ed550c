"""The error of a run, as ``accuracy`` and ``dockloop run --estimate-error`` mean it.

Two runs of one docking are compared: peak loads, stroke, time of capture, final motion. Every
figure is relative; the largest one is the error of the run. A second run with tighter tolerances
estimates the error of the first one. If the model is simplified (``model.level``), one more run
with every body shows what that costs in the same figures.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from dockloop import schema
from dockloop.core import list_choices, list_loads, list_methods, name_choice
from dockloop.criteria import PEAK
from dockloop.errors import DockloopError, UsageError
from dockloop.results import Result
from dockloop.trades.errors import find_frame, find_scales, find_times

_LEAST_PEAK = 0.05  # no peak is compared with less than this part of the largest one of its unit
_TIGHTER, _LEAST_RTOL = 1e-2, 1e-13  # tolerances of the second run over those of the first
_SHORTER = 0.25  # the same for the step of a fixed-step method
_FULL = "reduced"  # level of the model with every body; simplified ones have smaller numbers
_FAR_ABOVE = 5.0  # times the wanted error: worth a sentence
ATOL_PER_RTOL = {"atol_position": 1e-2, "atol_velocity": 1e-2, "atol_energy": 1e-1}  # of the choice
_FINAL = {  # figure -> scale (`find_scales`), output of the frame
    "final_position": ("position_m", "position"),
    "final_attitude": ("attitude_rad", "attitude"),
    "final_velocity": ("end_velocity_m_s", "velocity"),
    "final_angular_velocity": ("end_angular_velocity_rad_s", "angular_velocity"),
}


def find_figures(reference: Result, run: Result) -> dict[str, float]:
    """Return the relative errors of a run.

    Args:
        reference: the same docking, closer to the solution.
        run: at the same communication points, or at points among which are those of `reference`.

    Returns:
        By name: ``capture.peak.NAME`` over the peak itself (at least 5 % of the largest peak of its
        unit), ``stroke`` over the largest displacement of the ring, ``time_of_capture`` over the
        time from contact to capture, final motion over its largest value. Figures that the scene
        does not have are left out. Without capture in one of the two runs ``time_of_capture`` is
        infinite.
    """
    scales = find_scales(reference)
    here = find_times(reference.time, run.time)
    peaks = [
        {name: each[name][-1] for name in each.names if name.startswith(PEAK)}
        for each in (reference, run)
    ]
    figures = compare_peaks(*peaks)
    if "stroke" in scales:
        strokes = [_find_stroke(reference), _find_stroke(run, here)]
        figures["stroke"] = float(abs(strokes[1] - strokes[0]) / scales["stroke"])
    if "time_of_capture" in reference:
        times = [each["time_of_capture"][-1] for each in (run, reference)]
        if min(times) >= 0.0:
            figures["time_of_capture"] = float(abs(times[0] - times[1]) / scales["capture_time_s"])
        elif max(times) >= 0.0:
            figures["time_of_capture"] = np.inf
    frame = find_frame(reference.names)
    for figure, (scale, name) in _FINAL.items():
        ends = [each.vector(f"{frame}.{name}")[-1] for each in (run, reference)]
        apart = np.linalg.norm(ends[0] - ends[1])
        if name == "attitude":  # the angle; q and -q are the same attitude
            apart = 2.0 * np.minimum(apart, np.linalg.norm(ends[0] + ends[1]))
        figures[figure] = float(apart / scales[scale])
    return figures


def has_same_outcome(reference: Result, run: Result) -> bool:
    """Return whether two runs end alike: outcome, and capture or none."""
    return all(
        round(reference[name][-1]) == round(run[name][-1])
        for name in ("outcome", "captured")
        if name in reference
    )


def find_error(reference: Result, run: Result) -> float:
    """Return the largest of the `find_figures`; infinite if the outcome is another one."""
    if not has_same_outcome(reference, run):
        return np.inf
    return max(find_figures(reference, run).values())


def compare_peaks(reference: Mapping[str, float], run: Mapping[str, float]) -> dict[str, float]:
    """Return the relative errors of the peak loads, ``capture.peak.NAME``, that both runs have."""
    units = {f"{PEAK}{load}": unit for load, unit in list_loads().items()}
    names = [name for name in units if name in reference and name in run]
    figures = {}
    for name in names:
        alike = [reference[each] for each in names if units[each] == units[name]]
        scale = max(reference[name], _LEAST_PEAK * max(alike))
        if scale > 0.0:
            figures[name] = float(abs(run[name] - reference[name]) / scale)
    return figures


def _find_stroke(run: Result, here: np.ndarray | None = None) -> float:
    """Return the largest displacement of the ring from its start [m]."""
    positions = run.vector("ring.position")
    positions = positions if here is None else positions[here]
    return float(np.max(np.linalg.norm(positions - positions[0], axis=1)))


def estimate_error(run: Result, repeat: Callable[[dict[str, float]], Result]) -> dict[str, Any]:
    """Estimate the error of a run by a second run with tolerances of a hundredth.

    Args:
        run: the run; it needs the group ``solver`` of outputs.
        repeat: makes the same run with other start values.

    Returns:
        ``error`` (None: not known), ``figures`` (see `find_figures`), ``second_run`` (its start
        values and evaluations) and ``sentence``. With a simplified level of the model also
        ``level``, see `estimate_level_error`.

    Raises:
        UsageError: the scene does not have the outputs that are compared.
    """
    estimate = _estimate_integration(run, repeat)
    level = estimate_level_error(run, repeat, estimate["error"])
    return estimate | ({"level": level} if level else {})


def _estimate_integration(
    run: Result, repeat: Callable[[dict[str, float]], Result]
) -> dict[str, Any]:
    """Estimate the error of the integration."""
    if "solver.chosen_rtol" not in run:
        raise UsageError("an error estimate needs the outputs 'solver': add it to outputs.groups")
    find_frame(run.names)
    tighter = tighten(run)
    second = repeat(tighter)
    cost = int(second["solver.rhs_evaluations"][-1])
    known: dict[str, Any] = {"second_run": {**tighter, "evaluations": cost}}
    settings = ", ".join(f"{n} {v:.3g}" for n, v in tighter.items() if n in _NAMED)
    if not has_same_outcome(second, run):
        ends = " and ".join(f"'{_say_outcome(each)}'" for each in (run, second))
        return known | {
            "error": None,
            "figures": {},
            "sentence": "the outcome depends on the last digits: this run and a second one"
            f" ({settings}) end as {ends}; the docking is at a boundary of capture, and its loads"
            " and times are not determined",
        }
    figures = find_figures(second, run)
    worst = max(figures, key=lambda name: figures[name])
    return known | {
        "error": figures[worst],
        "figures": figures,
        "sentence": f"about {figures[worst]:.1e} ({worst}), by a second run ({settings})"
        + _compare_with_wanted(figures[worst], run.parameters["accuracy"]),
    }


def _compare_with_wanted(error: float, accuracy: float) -> str:
    """Say that an error is far above the wanted one; empty if it is not."""
    if accuracy <= 0.0 or error <= _FAR_ABOVE * accuracy:
        return ""
    return (
        f"; that is more than {_FAR_ABOVE:g} times accuracy = {accuracy:g}: small changes grow in"
        " this motion (repeated contacts, play); a smaller accuracy helps"
    )


def estimate_level_error(
    run: Result, repeat: Callable[[dict[str, float]], Result], error: float | None = None
) -> dict[str, Any]:
    """Estimate what the simplified model of a run costs, by the same run with every body.

    Args:
        run: the run.
        repeat: makes the same run with other start values.
        error: of the integration of `run`; None: not known.

    Returns:
        ``name`` of the level, ``error`` (None: not known), ``figures`` (see `find_figures`),
        ``full_run`` (its start values and evaluations), ``is_larger`` (than `error`) and
        ``sentence``. Empty: nothing is simplified.
    """
    number = round(run.parameters.get("model.level", 0.0))
    names = {level.name: level.number for level in list_choices("model.level")}
    if not 0 < number < names[_FULL]:
        return {}
    known: dict[str, Any] = {"name": name_choice("model.level", number)}
    known |= {"error": None, "figures": {}, "is_larger": True}
    start: dict[str, float] = {"model.level": names[_FULL]}
    try:
        full = repeat(start)
    except DockloopError as failure:
        return known | {"sentence": f"not known: the run at level {_FULL} failed ({failure})"}
    known["full_run"] = {**start, "evaluations": int(full["solver.rhs_evaluations"][-1])}
    if not has_same_outcome(full, run):
        ends = " and ".join(f"'{_say_outcome(each)}'" for each in (run, full))
        sentence = f"this run and one at level {_FULL} end as {ends}: level {known['name']} has"
        return known | {"sentence": f"{sentence} another outcome"}
    figures = find_figures(full, run)
    worst = max(figures, key=lambda name: figures[name])
    is_larger = error is None or figures[worst] > error
    compared = "more" if is_larger else "not more"
    return known | {
        "error": figures[worst],
        "figures": figures,
        "is_larger": is_larger,
        "sentence": f"about {figures[worst]:.1e} ({worst}), by a run at level {_FULL};"
        f" {compared} than the error of the integration",
    }


def list_tolerances(rtol: float) -> dict[str, float]:
    """Return start values: a relative tolerance, and absolute ones in proportion."""
    return {"solver.rtol": rtol} | {
        f"solver.{n}": share * rtol for n, share in ATOL_PER_RTOL.items()
    }


_NAMED = ("solver.rtol", "solver.step")  # settings that a sentence names


def tighten(run: Result) -> dict[str, float]:
    """Return start values of a run with a smaller error, without choices of its own."""
    number = int(run["solver.chosen_method"][-1])
    tighter: dict[str, float] = {"accuracy": 0.0, "solver.method": number}
    method = next(each for each in list_methods() if each["number"] == number)
    if method["fixed_step"]:
        return tighter | {"solver.step": _SHORTER * float(run["solver.chosen_step"][-1])}
    used = float(run["solver.chosen_rtol"][-1])
    rtol = max(_TIGHTER * used, min(used, _LEAST_RTOL))
    defaults = schema.list_defaults("scene", "solver")
    for name, share in ATOL_PER_RTOL.items():
        given = run.parameters[f"solver.{name}"]
        is_chosen = run.parameters["accuracy"] != 0.0 and given == defaults[name]
        atol = share * used if is_chosen else given * min(1.0, used / run.parameters["solver.rtol"])
        tighter[f"solver.{name}"] = atol * rtol / used
    return tighter | {"solver.rtol": rtol}


def _say_outcome(run: Result) -> str:
    """Return the outcome of a run."""
    return name_choice("outcome", run["outcome"][-1]) if "outcome" in run else "not captured"
