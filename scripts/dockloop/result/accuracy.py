"""The estimated error of a run: ``dockloop run --estimate-error``.

A second run with tighter tolerances estimates the error (`dockloop.result.run_errors`) of the first
one. If the model is simplified (``model.level``), one more run with every body shows what that
costs in the same figures. `dockloop.runs.assured` goes on with tighter runs until two agree.
"""

from collections.abc import Callable, Sequence
from typing import Any

from dockloop.base import schema
from dockloop.base.errors import DockloopError, UsageError
from dockloop.native.core import FULL, list_methods, name_choice, number_choice
from dockloop.result.recording import Result
from dockloop.result.run_errors import find_figures, find_frame, find_worst, has_same_outcome

_TIGHTER, _LEAST_RTOL = 1e-2, 1e-13  # tolerances of the second run over those of the first
_SHORTER = 0.25  # the same for the step of a fixed-step method
_FAR_ABOVE = 5.0  # times the wanted error: worth a sentence
ATOL_PER_RTOL = {"atol_position": 1e-2, "atol_velocity": 1e-2, "atol_energy": 1e-1}  # of the choice


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


def check_comparable(outputs: Sequence[str]) -> None:
    """Check that runs with these outputs can be compared. Raises UsageError."""
    if "solver.chosen_rtol" not in outputs:
        raise UsageError("an error estimate needs the outputs 'solver': add it to outputs.groups")
    find_frame(outputs)


def _estimate_integration(
    run: Result, repeat: Callable[[dict[str, float]], Result]
) -> dict[str, Any]:
    """Estimate the error of the integration."""
    check_comparable(run.names)
    tighter = tighten(run)
    second = repeat(tighter)
    cost = int(second["solver.rhs_evaluations"][-1])
    known: dict[str, Any] = {"second_run": {**tighter, "evaluations": cost}}
    settings = ", ".join(f"{n} {v:.3g}" for n, v in tighter.items() if n in _NAMED)
    if not has_same_outcome(second, run):
        ends = say_outcomes(run, second)
        return known | {
            "error": None,
            "figures": {},
            "sentence": "the outcome depends on the last digits: this run and a second one"
            f" ({settings}) end as {ends}; the docking is at a boundary of capture, and its loads"
            " and times are not determined",
        }
    figures = find_figures(second, run)
    worst, error = find_worst(figures)
    return known | {
        "error": error,
        "figures": figures,
        "sentence": f"about {error:.1e} ({worst}), by a second run ({settings})"
        + _compare_with_wanted(error, run.parameters["accuracy"]),
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
    if not is_simplified(run):
        return {}
    known: dict[str, Any] = {"name": name_choice("model.level", run.parameters["model.level"])}
    known |= {"error": None, "figures": {}, "is_larger": True}
    start: dict[str, float] = {"model.level": number_choice("model.level", FULL)}
    try:
        full = repeat(start)
    except DockloopError as failure:
        return known | {"sentence": f"not known: the run at level {FULL} failed ({failure})"}
    known["full_run"] = {**start, "evaluations": int(full["solver.rhs_evaluations"][-1])}
    if not has_same_outcome(full, run):
        ends = say_outcomes(run, full)
        sentence = f"this run and one at level {FULL} end as {ends}: level {known['name']} has"
        return known | {"sentence": f"{sentence} another outcome"}
    figures = find_figures(full, run)
    worst, own = find_worst(figures)
    is_larger = error is None or own > error
    compared = "more" if is_larger else "not more"
    return known | {
        "error": own,
        "figures": figures,
        "is_larger": is_larger,
        "sentence": f"about {own:.1e} ({worst}), by a run at level {FULL};"
        f" {compared} than the error of the integration",
    }


def list_tolerances(rtol: float) -> dict[str, float]:
    """Return start values: a relative tolerance, and absolute ones in proportion."""
    return {"solver.rtol": rtol} | {
        f"solver.{n}": share * rtol for n, share in ATOL_PER_RTOL.items()
    }


def state_rtol(method: float | str, rtol: float, accuracy: float) -> dict[str, Any]:
    """Return start values: a method and a relative tolerance.

    Args:
        method: name or number.
        rtol: relative tolerance.
        accuracy: above 0, absolute tolerances that are not stated follow from the docking.
    """
    # Never the default: it counts as not stated, and `accuracy` would choose it.
    stated = rtol if accuracy == 0.0 else rtol * (1.0 + 1e-9)
    return {"accuracy": accuracy, "solver.method": method, "solver.rtol": stated}


_NAMED = ("solver.rtol", "solver.step")  # settings that a sentence names


def tighten(run: Result, share: float = _TIGHTER) -> dict[str, float]:
    """Return start values of a run with a smaller error, without choices of its own.

    Args:
        run: the run; it needs the group ``solver`` of outputs.
        share: its tolerances are multiplied by; a fixed step by a quarter.
    """
    number = int(run["solver.chosen_method"][-1])
    method = next(each for each in list_methods() if each["number"] == number)
    if method["fixed_step"]:
        step = _SHORTER * float(run["solver.chosen_step"][-1])
        return {"accuracy": 0.0, "solver.method": number, "solver.step": step}
    accuracy = max(0.0, run.parameters["accuracy"])  # real time chooses no tolerances
    used = float(run["solver.chosen_rtol"][-1])
    rtol = max(share * used, min(used, _LEAST_RTOL))
    tighter = state_rtol(number, rtol, accuracy)
    defaults = schema.list_defaults("scene", "solver")
    for name in ATOL_PER_RTOL:
        given = run.parameters[f"solver.{name}"]
        if accuracy == 0.0 or given != defaults[name]:
            used_too = given * min(1.0, used / run.parameters["solver.rtol"])
            tighter[f"solver.{name}"] = used_too * rtol / used
    return tighter


def say_outcomes(*runs: Result) -> str:
    """Return the outcomes of runs, as ``'captured' and 'rebound'``."""
    names = (
        name_choice("outcome", run["outcome"][-1]) if "outcome" in run else "not captured"
        for run in runs
    )
    return " and ".join(f"'{name}'" for name in names)


def is_simplified(run: Result) -> bool:
    """Return whether the level of the model of a run is a simplified one."""
    level = round(run.parameters.get("model.level", 0.0))
    return 0 < level < number_choice("model.level", FULL)  # these have smaller numbers
