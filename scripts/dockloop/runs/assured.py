"""Assured accuracy: ``--assured``, ``assured=True``.

One run cannot know its own error. It is repeated with tighter settings, until two runs in a row
agree in every figure that a user reads (`dockloop.result.run_errors`) within the wanted
``accuracy``. The result is the tighter one of the two, whose error is a fraction of their
difference. Figures on which the tightest runs do not agree cannot be assured, and the reason says
why.

Two runs can agree on the wrong side of a boundary. Two neighbours of the docking, whose start
differs by the error, show this: if they end otherwise, tighter runs follow, with closer neighbours.

The first tighter run has a tenth of the ``accuracy``, so that the cheapest method for that error
makes it. Where tolerances are stated, and below the errors that were measured, each run has a tenth
of the tolerances of the one before.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from dockloop.base import schema
from dockloop.base.errors import DockloopError, UsageError, one_line
from dockloop.native.core import list_methods, name_choice, number_choice
from dockloop.native.variables import VEHICLES
from dockloop.result.accuracy import (
    ATOL_PER_RTOL,
    check_comparable,
    is_simplified,
    say_outcomes,
    tighten,
)
from dockloop.result.recording import Result
from dockloop.result.run_errors import (
    find_compared,
    find_errors,
    find_further_figures,
    find_worst,
    has_same_outcome,
    list_further,
)

ESTIMATED_TOO = "assured and estimate_error: give one of them: assured runs state their error, too"
_SHARE = 0.1  # of accuracy or tolerances, from one run to the next
_LEAST_ACCURACY = 1e-6  # that the dial is asked for: about the smallest error that was measured
_CHANGED = 0.5  # tolerances that are not smaller than this part of the former ones are no others
_CHAOS = 1e6  # growth of small changes from which on a figure depends on the last digits
_ERRORS = 2.0  # times the difference of two runs: how far away neighbours are
_LEAST_SHIFT = 1e-9  # of neighbours, relative
_REGULAR = 100.0  # growth of small changes that is no jump
_ASIDE, _LEAST_SPEED = 0.1, 1e-3  # part of the velocity that is turned; m/s
_EVALUATIONS = "solver.rhs_evaluations"
_STARTS = tuple(f"{v}.velocity[{i}]" for v in VEHICLES for i in (1, 2, 3))
_BASIS = ("solver.chosen_method", "solver.chosen_rtol", _EVALUATIONS)  # outputs that are needed
_STATED = ("solver.method", "solver.rtol", *(f"solver.{n}" for n in ATOL_PER_RTOL))
PARAMETERS = ("accuracy", *_STATED)  # that are needed


@dataclass
class Assurance:
    """What was found about a run.

    Attributes:
        accuracy: wanted relative error.
        refused: figures that cannot be assured, with the reason.
        error: the largest difference of the last two runs; None: there is no second run.
        figures: these differences.
        runs: settings and evaluations of all runs, the first one first; ``shift``: of a neighbour,
            the relative change of its start.
        is_level: the model is simplified; the error of this is not in the figures.
    """

    accuracy: float
    refused: dict[str, str] = field(default_factory=dict)
    error: float | None = None
    figures: dict[str, float] = field(default_factory=dict)
    runs: list[dict[str, Any]] = field(default_factory=list)
    is_level: bool = False

    def note(self, run: Result, shift: float = 0.0) -> None:
        """Note a run."""
        self.runs.append(
            {
                "accuracy": run.parameters["accuracy"],
                "method": name_choice("solver.method", run["solver.chosen_method"][-1]),
                "rtol": _look_up(run, "solver.chosen_rtol"),
                "shift": shift,
                "evaluations": int(run[_EVALUATIONS][-1]),
            }
        )

    def list_settings(self) -> list[dict[str, Any]]:
        """Return the runs with tighter and tighter settings, without neighbours."""
        return [run for run in self.runs if run["shift"] == 0.0]

    def to_case(self) -> dict[str, Any]:
        """Return what is kept of a case (`dockloop.sweeps.assured.list_cells`)."""
        return {
            "refused": self.refused,
            "settings": len(self.list_settings()),
            "price": self.price,
        }

    @property
    def verdict(self) -> bool | dict[str, str]:
        """True: every figure is assured. False: none, there is no second run. Else the others."""
        return self.refused or True if self.error is not None else False

    @property
    def price(self) -> float:
        """Evaluations of all runs over those of the first."""
        counts = [run["evaluations"] for run in self.runs]
        return sum(counts) / max(1, counts[0])

    def to_summary(self) -> dict[str, Any]:
        """Return the members of a summary."""
        found = {
            "accuracy": self.accuracy,
            "error": _to_json(self.error),
            "figures": {name: _to_json(error) for name, error in self.figures.items()},
            "runs": self.runs,
            "price": self.price,
            "sentence": self.say(),
        }
        return {"assured": self.verdict, "assurance": found}

    def say(self) -> str:
        """Say it in a sentence."""
        price = f"{len(self.runs)} runs cost {self.price:.1f} times the evaluations of the first"
        if self.error is None:
            return f"nothing is assured: {next(iter(self.refused.values()))}"
        if self.refused:
            said = "; ".join(f"{name}: {why}" for name, why in self.refused.items())
            return f"cannot be assured within {self.accuracy:g}: {said}; {price}"
        worst, error = find_worst(self.figures)
        level = "; the error of model.level is not included" if self.is_level else ""
        return (
            f"every figure is within {self.accuracy:g}: the last two runs differ by at most"
            f" {error:.1e} ({worst}){level}; {price}"
        )


def check_assurable(outputs: Sequence[str], get: Callable[[str], float]) -> None:
    """Check that a run can be assured.

    Args:
        outputs: that it has.
        get: returns a parameter, or the output ``solver.chosen_method``.

    Raises:
        UsageError: an output is missing, there is no wanted error, or steps are fixed.
    """
    check_comparable(outputs)
    accuracy = get("accuracy")
    if accuracy == 0.0:
        raise UsageError("assured: needs a wanted error: state accuracy, such as accuracy = 1e-3")
    if accuracy < 0.0:
        raise UsageError(
            "assured: accuracy is real-time: its fixed steps keep no wanted error: state a number,"
            " such as accuracy = 1e-3"
        )
    number = round(get("solver.chosen_method"))
    if next(each["fixed_step"] for each in list_methods() if each["number"] == number):
        raise UsageError(
            f"assured: solver.method is {name_choice('solver.method', number)}: its fixed steps"
            " have no tolerance: choose another method, or leave out assured"
        )


def assure(
    run: Result, repeat: Callable[[dict[str, float]], Result], chosen: Sequence[str] = ()
) -> Result:
    """Repeat a run with tighter settings until two runs agree, and their neighbours with them.

    Args:
        run: the run; it needs the group ``solver`` of outputs, and a wanted ``accuracy``.
        repeat: makes the same run with other start values.
        chosen: outputs whose values at the end are assured, too.

    Returns:
        The last run, with `Result.assurance`; a warning names figures that cannot be assured.

    Raises:
        UsageError: the run cannot be assured, see `check_assurable`.
    """
    check_assurable(run.names, lambda name: _look_up(run, name))
    made = Assurance(run.parameters["accuracy"], is_level=is_simplified(run))
    before = last = _Trial({}, run)
    made.note(run)
    failure = ""
    while True:
        if made.error is not None and made.error <= made.accuracy:
            made.refused = _ask_neighbours(made, before, repeat, chosen)
            if not made.refused:
                break
        try:
            better = _repeat_tighter(last.run, repeat)
        except UsageError:
            raise
        except DockloopError as error:
            failure = one_line(str(error))
            break
        if better is None:
            break
        before, last = last, better
        made.note(last.run)
        made.figures = compare(last.run, before.run, chosen)
        made.error, made.refused = find_worst(made.figures)[1], {}
    if not made.refused and (made.error is None or not made.error <= made.accuracy):
        made.refused = _explain(made, before.run, last.run, failure)
    found = replace(last.run, assurance=made, warnings=list(last.run.warnings))
    if made.refused:
        found.warnings.append(f"assured: {made.say()}")
    return found


class _Trial(NamedTuple):
    """A run, and its start values that the first run does not have."""

    settings: dict[str, float]
    run: Result


def _ask_neighbours(
    made: Assurance,
    before: _Trial,
    repeat: Callable[[dict[str, float]], Result],
    chosen: Sequence[str],
) -> dict[str, str]:
    """Return the figures that jump between this docking and others as close as the error.

    Two runs can agree on the wrong side of a boundary that is nearer than their errors.
    """
    shift = max(_ERRORS * (made.error or 0.0), _LEAST_SHIFT)
    for sign in (1.0, -1.0):
        start = _shift_start(before.run, sign * shift)
        if not start:
            return {}
        near = f"a start that differs by {shift:.1e}"
        try:
            other = repeat(before.settings | start)
        except UsageError:
            raise
        except DockloopError as error:
            return {"outcome": f"{near} fails ({one_line(str(error))})"}
        made.note(other, sign * shift)
        if not has_same_outcome(before.run, other):
            ends = say_outcomes(before.run, other)
            why = f"boundary of capture: this docking and {near} end as {ends}"
            return {"outcome": f"{why}; loads and times are not determined either"}
        changes = compare(before.run, other, chosen)
        most = max(made.accuracy, _REGULAR * shift)
        jumps = {name: change for name, change in changes.items() if not change <= most}
        if jumps:
            return {
                name: f"depends on the last digits: {near} changes it by {change:.1e}"
                for name, change in jumps.items()
            }
    return {}


def _shift_start(run: Result, shift: float) -> dict[str, float]:
    """Return start values that change the relative velocity by a part of it; none if all is driven.

    The direction is none of symmetry, so that the change crosses boundaries of every kind.
    """
    found = {
        vehicle: run.vector(f"{vehicle}.velocity")[0]
        for vehicle in VEHICLES
        if f"{vehicle}.velocity[1]" in run
    }
    if not found:
        return {}
    vehicle, velocity = next(iter(found.items()))
    relative = velocity - found.get("target", np.zeros(3)) if vehicle == "chaser" else velocity
    aside = _ASIDE * max(float(np.linalg.norm(relative)), _LEAST_SPEED) * np.array([-1, 1, -1])
    moved = velocity + shift * (relative + aside)
    return {f"{vehicle}.velocity[{i}]": float(value) for i, value in enumerate(moved, 1)}


def compare(reference: Result, run: Result, chosen: Sequence[str] = ()) -> dict[str, float]:
    """Return the relative errors of all figures that a user reads, ``outcome`` among them.

    Runs that end at different times, because their outcomes were final, are compared up to the
    earlier one.
    """
    end = min(reference.time[-1], run.time[-1])
    reference, run = (
        replace(each, values=each.values[each.time <= end]) for each in (reference, run)
    )
    return find_errors(reference, run) | find_further_figures(reference, run, chosen)


def _repeat_tighter(run: Result, repeat: Callable[[dict[str, float]], Result]) -> _Trial | None:
    """Make the next run; None: there are no tighter settings. Raises DockloopError."""
    failure: DockloopError | None = None
    for settings in _list_tighter(run):
        try:
            made = repeat(settings)
        except UsageError:
            raise
        except DockloopError as error:  # of a method that this docking is too hard for
            failure = error
            continue
        if _is_tighter(made, run):
            return _Trial(settings, made)
    if failure:
        raise failure
    return None


def _list_tighter(run: Result) -> Iterator[dict[str, float]]:
    """Yield tighter settings, the cheapest ones first."""
    accuracy = run.parameters["accuracy"]
    if _is_free(run) and _SHARE * accuracy >= _LEAST_ACCURACY:
        yield {"accuracy": _SHARE * accuracy}
    settings = tighten(run, _SHARE)
    if settings["solver.rtol"] < _CHANGED * _look_up(run, "solver.chosen_rtol"):
        yield settings


def _is_tighter(made: Result, before: Result) -> bool:
    """Return whether a run has other settings: where the measured errors end, the dial has not."""
    if made["solver.chosen_method"][-1] != before["solver.chosen_method"][-1]:
        return True
    rtols = [float(run["solver.chosen_rtol"][-1]) for run in (made, before)]
    return rtols[0] < _CHANGED * rtols[1]


def _is_free(run: Result) -> bool:
    """Return whether the dial chooses method and tolerances: none is stated."""
    defaults = {f"solver.{n}": v for n, v in schema.list_defaults("scene", "solver").items()}
    defaults["solver.method"] = number_choice("solver.method", "auto")
    return all(run.parameters[name] == defaults[name] for name in _STATED)


def _to_json(number: float | None) -> float | None:
    """Return a number that JSON can hold: none for an infinite one."""
    return number if number is not None and np.isfinite(number) else None


def _look_up(run: Result, name: str) -> float:
    """Return a parameter, or an output at the end."""
    return float(run.parameters[name] if name in run.parameters else run[name][-1])


def _explain(made: Assurance, before: Result, last: Result, failure: str) -> dict[str, str]:
    """Return the figures that cannot be assured, with the reason."""
    if made.error is None:
        return {"outcome": f"the run with tighter settings failed ({failure or 'there are none'})"}
    runs = made.list_settings()[-2:]
    pair = " and ".join(f"{each['method']} at {each['rtol']:.1e}" for each in runs)
    if not has_same_outcome(last, before):
        ends = say_outcomes(before, last)
        why = f"boundary of capture: the last two runs ({pair}) end as {ends}"
        why += f"; a tighter one failed ({failure})" if failure else ", on the last digits"
        return {"outcome": f"{why}; loads and times are not determined either"}
    refused = {}
    for name, error in made.figures.items():
        if error <= made.accuracy:
            continue
        growth = error / runs[0]["rtol"]
        why = f"the last two runs ({pair}) differ by {error:.1e}"
        if growth >= _CHAOS:
            why = f"depends on the last digits: small changes grow {growth:.0e} times; {why}"
        refused[name] = f"{why}; a tighter one failed ({failure})" if failure else why
    return refused


def list_recorded(outputs: Sequence[str], chosen: Sequence[str]) -> list[str]:
    """Return the outputs that must be recorded for `assure`."""
    wanted = {*find_compared(outputs), *list_further(outputs, chosen), *_BASIS, *_STARTS}
    return [name for name in outputs if name in wanted]
