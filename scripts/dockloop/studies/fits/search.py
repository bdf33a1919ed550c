"""Minimises the residuals of a fit: some starts, then trust regions with estimated noise.

Starts are the values of the scene and a Sobol sequence, since contact makes valleys. Starts whose
outcomes are the measured ones come first. The best two go some steps, the better one goes on.
Standard deviations of channels that are not stated follow from the residuals, round by round.
"""

import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from dockloop.base.errors import DockloopError
from dockloop.studies.fits.problem import Problem
from dockloop.studies.fits.statistics import (
    QUANTILE,
    Estimate,
    estimate,
    find_factor,
    judge_residuals,
)

_BEST = 2  # starts that go on
_COARSE, _FINE = (1e-2, 4), (0.0, 40)  # part of the sum of squares, evaluations that end a search
_CHANGE = 0.01  # of half the sum of squares that ends a search: a tenth of a deviation
_STEP = 1e-5  # of the vector that ends a search
_ROUNDS = 4  # of estimates of noise
_SAME = 0.05  # change of standard deviations that ends the rounds
_INSIDE = 1e-3  # of the range that a start keeps from a bound


@dataclass
class Found:
    """What a fit found.

    Attributes:
        x: the vector.
        before: the vector with the values of the scene; None: they are not known or cannot be run.
        estimate: its uncertainty.
        noise: standard deviation of each channel, as estimated.
        judged: of every series: what its residuals look like.
        bands: of every series: half width of the 95 % band of a sample, in its unit; NaN: its noise
            is not known, as no fitted test has this channel.
        starts: outcomes of the starts, how many of each.
        changes: sentences on outcomes that change within one difference.
    """

    x: np.ndarray
    before: np.ndarray | None
    estimate: Estimate
    noise: dict[str, float]
    judged: list[dict[str, Any]]
    bands: list[np.ndarray]
    starts: dict[str, int] = field(default_factory=dict)
    changes: list[str] = field(default_factory=list)


def find_fit(
    problem: Problem,
    own: Sequence[float | None],
    *,
    starts: int,
    seed: int,
    loss: str,
    report: Callable[[str], None] = lambda _: None,
) -> Found:
    """Find the parameters.

    Args:
        problem: what is minimised.
        own: values of the scene, as parts of the ranges; None: not known.
        starts: how many.
        seed: of the starts.
        loss: ``linear`` or ``soft_l1``.
        report: receives what is being done.

    Raises:
        DockloopError: no start can be run.
    """
    fitted, held = problem.list_trials(), problem.list_trials(held=True)
    report("starts")
    ranked, counts = _rank(problem, _list_starts(problem, own, starts, seed))
    report("search")
    solved = (_solve(problem, start, loss, _COARSE) for start in ranked[:_BEST])
    x = min(solved, key=lambda found: found[0])[1]
    noise: dict[str, float] = {}
    for _ in range(_ROUNDS):
        old, noise = noise, problem.weigh(x, fitted, is_robust=loss != "linear")
        if old and all(abs(noise[name] / old[name] - 1.0) < _SAME for name in noise):
            break
        x = _solve(problem, x, loss, _FINE)[1]
    if held:
        x = problem.shift(x, held)
        for _ in range(2):  # weights depend on the shift
            problem.weigh(x, held, is_robust=loss != "linear", noise=noise)
            x = problem.polish(x, held)
    report("uncertainty")
    found = _judge(problem, x, loss, noise)
    found.starts, found.changes = counts, problem.list_changes(x)
    if None not in own:
        found.before = x.copy()
        found.before[: len(own)] = own
        found.before = problem.polish(found.before, problem.list_trials(held=None))
    return found


def _list_starts(
    problem: Problem, own: Sequence[float | None], starts: int, seed: int
) -> list[np.ndarray]:
    """Return vectors to start from: the scene if it is within the ranges, then a sequence."""
    count = len(problem.parameters)
    with warnings.catch_warnings():  # "balanced only if a power of 2"
        warnings.simplefilter("ignore", UserWarning)
        cube = qmc.Sobol(count, rng=np.random.default_rng(seed)).random(starts)
    first = [0.5 if part is None or not 0.0 <= part <= 1.0 else part for part in own]
    points = np.clip(np.vstack([first, cube])[:starts], _INSIDE, 1.0 - _INSIDE)
    return [np.concatenate([point, np.zeros(problem.size - count)]) for point in points]


def _rank(problem: Problem, points: list[np.ndarray]) -> tuple[list[np.ndarray], dict[str, int]]:
    """Return the starts that can be run, best first, and how many had which outcomes."""
    trials = problem.list_trials()
    problem.run([problem.make_case(x, k) for x in points for k in trials])
    ranked: list[tuple[int, float, int, np.ndarray]] = []
    reason = ""
    counts: Counter[str] = Counter()
    for x in points:
        runs = [problem.get_run(x, k) for k in trials]
        outcomes = [problem.outcomes[problem.make_case(x, k)] for k in trials]
        counts.update(outcomes)
        if wrong := [run for run in runs if isinstance(run, str)]:
            reason = reason or wrong[0]
            continue
        moved = problem.polish(problem.shift(x, trials))
        others = sum(problem.compare_outcome(x, k).get("agrees") is False for k in trials)
        ranked.append((others, _calc_cost(problem, moved), len(ranked), moved))
    if not ranked:
        raise DockloopError(f"no start can be run, for example: {reason}")
    best = [x for *_, x in sorted(ranked)]
    problem.mask(best[0], trials)
    return best, dict(counts)


def _calc_cost(problem: Problem, x: np.ndarray) -> float:
    return float(np.sum(problem.calc_residuals(x) ** 2))


def _solve(
    problem: Problem, x: np.ndarray, loss: str, ends: tuple[float, int]
) -> tuple[float, np.ndarray]:
    """Return the sum of squares and the vector at a minimum."""
    low, high = np.full(problem.size, -np.inf), np.full(problem.size, np.inf)
    low[: len(problem.parameters)], high[: len(problem.parameters)] = 0.0, 1.0
    counted = sum(np.isfinite(s.sigma).sum() for s in problem.series)
    found = least_squares(
        problem.calc_residuals,
        x,
        problem.calc_jacobian,
        (low, high),
        loss=loss,
        ftol=max(ends[0], 2.0 * _CHANGE / counted),
        xtol=_STEP,
        gtol=None,
        max_nfev=ends[1],
    )
    return float(found.cost), found.x


def _judge(problem: Problem, x: np.ndarray, loss: str, noise: dict[str, float]) -> Found:
    """Return the uncertainty at a minimum, and what the residuals look like."""
    every = problem.list_trials(held=None)
    jacobian = problem.calc_jacobian(x, every, is_central=True)
    residuals = problem.calc_residuals(x, every)
    counts = [len(series.time) for series in problem.series]
    rows = np.split(np.arange(len(residuals)), np.cumsum(counts)[:-1])
    is_fitted = [not problem.trials[series.trial].is_held for series in problem.series]
    judged, is_known, weights = [], [], np.zeros(len(residuals))
    for series, part, fitted in zip(problem.series, rows, is_fitted, strict=True):
        counted = part[np.isfinite(series.sigma)]
        is_stated = series.noise is not None
        is_known.append(is_stated or series.name in noise)
        is_exact = noise.get(series.name, np.inf) <= problem.find_floor(series.name)
        judged.append(
            judge_residuals(
                residuals[counted],
                series.time[np.isfinite(series.sigma)],
                sum(is_fitted),
                is_stated=is_stated,
                is_exact=is_exact and not is_stated,
            )
        )
        weights[counted] = judged[-1]["per_sample"] ** -0.5 if fitted else 0.0
    used = weights > 0.0
    extents = np.concatenate([series.extent / series.sigma for series in problem.series])
    resolution = problem.accuracy / (2.0 * problem.step) * float(np.linalg.norm(extents[used]))
    own = len(problem.parameters)
    free = own + sum(problem.trials[k].is_held is False for k, *_ in problem.labels)
    factor = find_factor(residuals[used], loss, free)
    made = estimate(jacobian[used] * weights[used, None], own, factor, resolution)
    spread = 1.0 + np.einsum("ij,jk,ik->i", jacobian, made.covariance, jacobian)
    bands = [
        (QUANTILE if known else np.nan) * series.sigma * np.sqrt(spread[part])
        for series, part, known in zip(problem.series, rows, is_known, strict=True)
    ]
    return Found(x, None, made, noise, judged, bands)
