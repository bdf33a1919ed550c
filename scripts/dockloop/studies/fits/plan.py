"""Before measuring: which test would say most about which parameter.

The information of a test is J'J of its channels over their stated noise, at the values of the
scene, without what its unknown time shift takes away. Information of tests adds up. What is not
identified is what a fit would call so.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.studies.fits.problem import Problem
from dockloop.studies.fits.statistics import Estimate, estimate


@dataclass
class Planned:
    """Expected uncertainty.

    Attributes:
        x: the vector with the values of the scene.
        alone: from one test, for each.
        channels: the same by test and channel.
        order: tests, the one that says most first, then the one that adds most to it, ...
        together: from the tests so far, in this order.
        changes: sentences on outcomes that change within one difference.
    """

    x: np.ndarray
    alone: list[Estimate]
    channels: dict[tuple[int, str], Estimate]
    order: list[int]
    together: list[Estimate]
    changes: list[str]


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
    trials = problem.list_trials()
    problem.run([problem.make_case(x, k) for k in trials])
    for k in trials:
        problem.require_run(x, k)
    problem.weigh(x, trials, is_robust=False)
    for series in problem.series:  # there are no data to take it from
        series.extent = float(np.ptp(problem.get_run(x, series.trial)[series.name]))
    jacobian = problem.calc_jacobian(x, trials, is_central=True)
    rows = problem.split(jacobian, trials)
    floors = [problem.find_resolution([series]) for series in problem.series]

    def expect(chosen: Sequence[int]) -> Estimate:
        """Return what some channels would say: nothing, if all have impacts between samples."""
        missed = all(problem.series[i].misses_impacts for i in chosen)
        floor = math.inf if missed else float(np.linalg.norm([floors[i] for i in chosen]))
        return estimate(np.vstack([rows[i] for i in chosen]), len(own), 1.0, floor)

    def choose(tests: Sequence[int]) -> list[int]:
        return [i for i, series in enumerate(problem.series) if series.trial in tests]

    left, order, together = list(trials), list[int](), list[Estimate]()
    while left:
        made = {k: expect(choose([*order, k])) for k in left}
        best = min(left, key=lambda k: made[k].log_volume)
        left.remove(best)
        order.append(best)
        together.append(made[best])
    return Planned(
        x,
        [expect(choose([k])) for k in trials],
        {(series.trial, series.name): expect([i]) for i, series in enumerate(problem.series)},
        order,
        together,
        problem.list_changes(x),
    )
