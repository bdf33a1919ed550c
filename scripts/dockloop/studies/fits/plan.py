"""Before measuring: which test would say most about which parameter.

The information of a test is J'J of its channels over their stated noise, at the values of the
scene, without what its unknown time shift takes away. Information of tests adds up. Next to it
every parameter may be anywhere within its range, with the deviation of that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dockloop.base.errors import DockloopError, UsageError
from dockloop.studies.fits.problem import Problem
from dockloop.studies.fits.statistics import GUESS


@dataclass
class Planned:
    """Expected information.

    Attributes:
        alone: deviations of the parameters from one test, parts of the ranges, shape (tests,
            parameters).
        channels: the same by test and channel: shape (parameters,) each.
        order: tests, the one that says most first, then the one that adds most to it, ...
        together: deviations from the tests so far, in this order, shape (tests, parameters).
    """

    alone: np.ndarray
    channels: dict[tuple[int, str], np.ndarray]
    order: list[int]
    together: np.ndarray


def plan(problem: Problem, own: Sequence[float | None]) -> Planned:
    """Return what tests would say.

    Args:
        problem: its series have the stated noise.
        own: values of the scene as parts of the ranges; elsewhere the middle is taken.

    Raises:
        UsageError: a value of the scene is outside of its range.
        DockloopError: a test cannot be run.
    """
    for (_, vary, _), part in zip(problem.parameters, own, strict=True):
        if part is not None and not 0.0 <= part <= 1.0:
            raise UsageError(
                f"--vary {vary.name} {vary.low:g} {vary.high:g}: a plan is for the value of the"
                f" scene, {vary.value(part):g}, which is outside: widen the range"
            )
    x = np.zeros(problem.size)
    x[: len(own)] = [0.5 if part is None else part for part in own]
    trials = problem.list_trials(held=None)
    problem.run([problem.make_case(x, k) for k in trials])
    for k in trials:
        if isinstance(run := problem.get_run(x, k), str):
            raise DockloopError(f"test '{problem.trials[k].name}': {run}")
    problem.weigh(x, trials, is_robust=False)
    jacobian = problem.calc_jacobian(x, trials, is_central=True)
    rows = dict(enumerate(problem.split(jacobian, trials)))
    channels = {
        (series.trial, series.name): _inform(rows[i], len(own))
        for i, series in enumerate(problem.series)
    }
    information = [
        _inform(
            np.vstack([rows[i] for i, s in enumerate(problem.series) if s.trial == k]), len(own)
        )
        for k in trials
    ]
    left, total, order, together = list(trials), np.zeros((len(own),) * 2), [], []
    while left:
        best = max(left, key=lambda k: np.linalg.slogdet(_add_guess(total + information[k]))[1])
        total = total + information[best]
        left.remove(best)
        order.append(best)
        together.append(_find_deviations(total))
    return Planned(
        np.array([_find_deviations(each) for each in information]),
        {key: _find_deviations(each) for key, each in channels.items()},
        order,
        np.array(together),
    )


def _inform(jacobian: np.ndarray, count: int) -> np.ndarray:
    """Return the information on the parameters, all other unknowns taken out."""
    own, others = jacobian[:, :count], jacobian[:, count:]
    rest = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
    return rest.T @ rest


def _add_guess(information: np.ndarray) -> np.ndarray:
    return information + np.eye(len(information)) / GUESS**2


def _find_deviations(information: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diag(np.linalg.inv(_add_guess(information))))
