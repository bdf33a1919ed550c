"""Minimises the residuals of a fit: trust regions with estimated noise, more starts in doubt.

The first start is the scene. If what it leads to does not meet the measurements, other starts
follow, of a Sobol sequence, since contact makes valleys. Those whose outcomes are the measured ones
come first. The best two go some steps; the better one goes on if it beats what was found before.
If one ends in the valley that is known, that is it: the model is wrong rather than the search.
These steps are for means over time: short impacts that do not overlap with those of the data would
make valleys, their impulses do not.
Standard deviations of channels that are not stated follow from the residuals, round by round. A
search ends where derivatives by differences both ways foresee no gain; these give the uncertainty.
"""

import math
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares, lsq_linear
from scipy.stats import qmc

from dockloop.base.errors import DockloopError
from dockloop.studies.fits.problem import Problem
from dockloop.studies.fits.statistics import (
    PENALTIES,
    QUANTILE,
    Estimate,
    estimate,
    find_factor,
    judge_residuals,
)
from dockloop.studies.measured.overlay import TooFewSamplesError

_BEST = 2  # starts that go on
_COARSE, _FINE = (0.1, 12), (0.0, 10)  # part of the sum of squares, evaluations that end a search
_MEANS = 0.01  # of the time of a test: standard deviation of what a coarse search averages over
_CHANGE = 0.01  # of half the sum of squares that ends a search: a seventh of a deviation
_VALLEY = 0.05  # of the ranges: coarse searches that end so close have found the same valley
_STEP = 1e-5  # of the vector that ends a search
_HOLD = 1e-3  # residual of a change by all of a range: 1e-6 in the sum of squares
_ROUNDS = 6  # of estimates of noise, and of derivatives both ways
MANY = 0.5  # of the samples of a channel: fewer within the run are in doubt
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
        rise: of the sum of squares (of the loss) by one deviation.
        starts: outcomes of the starts, how many of each.
        changes: sentences on outcomes that change within one difference.
    """

    x: np.ndarray
    before: np.ndarray | None
    estimate: Estimate
    noise: dict[str, float]
    judged: list[dict[str, Any]]
    bands: list[np.ndarray]
    rise: float
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
        starts: at most so many.
        seed: of the starts.
        loss: ``linear`` or ``soft_l1``.
        report: receives what is being done.

    Raises:
        DockloopError: no start can be run.
        UsageError: all starts are refused, or too few samples fall into the run.
    """
    fitted, held = problem.list_trials(), problem.list_trials(held=True)
    points = _list_starts(problem, own, starts, seed)
    counts: Counter[str] = Counter()
    best: tuple[np.ndarray, dict[str, float]] | None = None
    valley, ends = np.zeros(0), dict[int, float]()  # of the best
    report("search")
    lost: DockloopError | None = None
    for group in (points[:1], points[1:]):
        try:
            problem.lengthen()
            ranked = _rank(problem, group, counts)[:_BEST]
            problem.cut([*ranked, *([best[0]] if best else [])], fitted)
            x = _descend(problem, ranked, loss, best and (best[0], valley))
            if x is not None:
                best = _finish(problem, x, loss)
                valley, ends = x, dict(problem.ends)
        except TooFewSamplesError as error:  # at a shift that was found
            lost = lost or error
        if best and not _is_doubtful(problem, *best):
            break
    if best is None:
        raise lost or problem.explain_undone("no start can be run, for example")
    problem.lengthen(ends)
    x = best[0]
    noise = problem.weigh(x, fitted, is_robust=loss != "linear")
    if held:
        x = problem.shift(x, held)
        problem.cut([x], held)
        for _ in range(2):  # weights depend on the shift
            problem.weigh(x, held, is_robust=loss != "linear", noise=noise)
            x = problem.polish(x, held)
    report("uncertainty")
    found = _judge(problem, x, loss, noise)
    found.starts, found.changes = dict(counts), problem.list_changes(x)
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


def _rank(problem: Problem, points: list[np.ndarray], counts: Counter[str]) -> list[np.ndarray]:
    """Return the starts that can be run, best first, and count their outcomes."""
    trials = problem.list_trials()
    problem.forget_weights()
    problem.run([problem.make_case(x, k) for x in points for k in trials])
    counts.update(problem.outcomes[problem.make_case(x, k)] for x in points for k in trials)
    done = [x for x in points if not any(isinstance(problem.get_run(x, k), str) for k in trials)]
    moved = [problem.polish(problem.shift(x, trials)) for x in done]
    ranked = sorted(moved, key=lambda x: _score(problem, x))
    if ranked:
        problem.mask(ranked[0], trials)
    return ranked


def _descend(
    problem: Problem,
    starts: list[np.ndarray],
    loss: str,
    known: tuple[np.ndarray, np.ndarray] | None,
) -> np.ndarray | None:
    """Return where the best coarse search ends; None: nowhere better than what is known.

    One that ends where the known one did ends all: another start found nothing else.

    Args:
        problem: what is minimised, with the weights of coarse searches.
        starts: vectors, best first.
        loss: of residuals.
        known: what was found before, and where the coarse search ended that led there.
    """
    count, ends = len(problem.parameters), list[np.ndarray]()
    least = _score(problem, known[0]) if known else (len(problem.trials) + 1, 0.0)
    for start in starts:
        ends.append(solve(problem, start, loss, is_coarse=True))
        if (
            known
            and np.max(np.abs(ends[-1] - known[1])[:count]) < _VALLEY
            and _score(problem, ends[-1])[0] >= least[0]
        ):
            return None
    x = min(ends, key=lambda x: _score(problem, x), default=None)
    return None if x is None or _score(problem, x) >= least else x


def _score(problem: Problem, x: np.ndarray) -> tuple[int, float]:
    """Return how many outcomes are not the measured ones, and the sum of squares."""
    squares = float(np.sum(problem.calc_residuals(x) ** 2))  # makes the runs
    trials = problem.list_trials()
    others = sum(problem.compare_outcome(x, k).get("agrees") is False for k in trials)
    return others, squares


def _finish(problem: Problem, x: np.ndarray, loss: str) -> tuple[np.ndarray, dict[str, float]]:
    """Refine a vector; again with longer runs if its data left those that end with them."""
    try:
        found = _refine(problem, x, loss)
        if not problem.is_short(found[0]):
            return found
    except TooFewSamplesError:
        if not problem.ends:
            raise
    problem.lengthen()
    return _refine(problem, x, loss)


def _refine(problem: Problem, x: np.ndarray, loss: str) -> tuple[np.ndarray, dict[str, float]]:
    """Return the vector at a minimum with its own noise, and the noise of channels."""
    trials, is_first = problem.list_trials(), True
    for _ in range(_ROUNDS):
        noise = problem.weigh(x, trials, is_robust=loss != "linear")
        if not is_first and _foresee_change(problem, x, noise) < _CHANGE:
            break
        last, x = x, solve(problem, x, loss)
        if not is_first and np.array_equal(last, x):
            break
        is_first = False
    return x, noise


def _foresee_change(problem: Problem, x: np.ndarray, noise: dict[str, float]) -> float:
    """Return half the square of the way to the minimum, over deviations, to first order.

    Without a wrong model it is by how much half the sum of squares falls. Residuals of a wrong one
    are alike, so its deviations are larger.
    """
    jacobian, residuals = problem.calc_jacobian(x, is_central=True), problem.calc_residuals(x)
    low, high = _list_bounds(problem)
    change = jacobian @ lsq_linear(jacobian, -residuals, (low - x, high - x)).x
    parts = problem.split(change, problem.list_trials())
    pairs = zip(parts, _judge_series(problem, x, noise), strict=True)
    return sum(0.5 * float(part @ part) / judged["per_sample"] for part, (judged, _) in pairs)


def _list_bounds(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.full(problem.size, -np.inf), np.full(problem.size, np.inf)
    low[: len(problem.parameters)], high[: len(problem.parameters)] = 0.0, 1.0
    return low, high


def _is_doubtful(problem: Problem, x: np.ndarray, noise: dict[str, float]) -> bool:
    """Return whether a minimum may be one of several: the measurements are not met."""
    parts = x[: len(problem.parameters)]
    return (
        _score(problem, x)[0] > 0
        or any(np.mean(np.isfinite(s.sigma)) < MANY for s in problem.choose(problem.list_trials()))
        or bool(np.any(np.minimum(parts, 1.0 - parts) < _INSIDE))
        or any(judged["hidden"] for judged, _ in _judge_series(problem, x, noise))
    )


def solve(
    problem: Problem,
    x: np.ndarray,
    loss: str,
    *,
    is_coarse: bool = False,
    held: int | None = None,
) -> np.ndarray:
    """Return the vector at a minimum; a coarse one is that of means over time.

    What has no effect stays where it is: without the last rows, steps would be those of no rank.

    Args:
        problem: what is minimised.
        x: where the search begins.
        loss: of residuals.
        is_coarse: means over time are minimised, roughly.
        held: an entry of the vector that stays.
    """
    free = np.delete(np.arange(problem.size), [] if held is None else held)
    if not len(free):
        return x
    hold = _HOLD * np.eye(len(free))
    counted = sum(np.isfinite(s.sigma).sum() for s in problem.choose(problem.list_trials()))
    end, most = _COARSE if is_coarse else _FINE

    def put(part: np.ndarray) -> np.ndarray:
        at = x.copy()
        at[free] = part
        return at

    def smooth(rows: np.ndarray) -> np.ndarray:
        return problem.smooth(rows, _MEANS) if is_coarse else rows

    low, high = _list_bounds(problem)
    found = least_squares(
        lambda at: np.append(smooth(problem.calc_residuals(put(at))), hold @ (at - x[free])),
        x[free],
        lambda at: np.vstack([smooth(problem.calc_jacobian(put(at)))[:, free], hold]),
        (low[free], high[free]),
        loss=loss,
        ftol=max(end, 2.0 * _CHANGE / counted),
        xtol=_STEP,
        gtol=None,
        max_nfev=most,
    )
    return put(found.x)


def _judge_series(
    problem: Problem, x: np.ndarray, noise: dict[str, float], *, held: bool | None = False
) -> Iterator[tuple[dict[str, Any], np.ndarray]]:
    """Yield for every series what its residuals look like, and its residuals."""
    trials = problem.list_trials(held=held)
    chosen = problem.choose(trials)
    fitted = sum(not problem.trials[series.trial].is_held for series in chosen)
    split = problem.split(problem.calc_residuals(x, trials), trials)
    for series, part in zip(chosen, split, strict=True):
        counted = np.isfinite(series.sigma)
        is_stated = series.noise is not None
        is_exact = noise.get(series.name, np.inf) <= problem.find_floor(series.name)
        judged = judge_residuals(
            part[counted],
            series.time[counted],
            fitted,
            is_stated=is_stated,
            is_exact=is_exact and not is_stated,
        )
        yield judged, part


def _judge(problem: Problem, x: np.ndarray, loss: str, noise: dict[str, float]) -> Found:
    """Return the uncertainty at a minimum, and what the residuals look like."""
    every = problem.list_trials(held=None)
    jacobian = problem.calc_jacobian(x, every, is_central=True)
    pairs = list(_judge_series(problem, x, noise, held=None))
    judged, residuals = [pair[0] for pair in pairs], np.concatenate([pair[1] for pair in pairs])
    rows = problem.split(np.arange(len(residuals)), every)
    is_known = [series.noise is not None or series.name in noise for series in problem.series]
    weights = np.concatenate([
        np.isfinite(series.sigma) * each["per_sample"] ** -0.5
        for series, each in zip(problem.series, judged, strict=True)
    ])  # fmt: skip
    is_held = np.concatenate([
        np.full(len(series.time), problem.trials[series.trial].is_held) for series in problem.series
    ])  # fmt: skip
    used = (weights > 0.0) & ~is_held
    seen = problem.choose(problem.list_trials())
    missed = all(series.misses_impacts for series in seen)
    resolution = problem.find_resolution(seen)
    own = len(problem.parameters)
    free = own + sum(problem.trials[k].is_held is False for k, *_ in problem.labels)
    factor = find_factor(residuals[used], loss, free)
    # with missed impacts this is one of several valleys, of which derivatives say nothing
    made = estimate(
        jacobian * weights[:, None], own, factor, math.inf if missed else resolution, is_held
    )
    spread = 1.0 + np.einsum("ij,jk,ik->i", jacobian, made.covariance, jacobian)
    bands = [
        (QUANTILE if known else np.nan) * series.sigma * np.sqrt(spread[part])
        for series, part, known in zip(problem.series, rows, is_known, strict=True)
    ]
    rise = factor * float(np.mean(PENALTIES[loss].slope(residuals[used])))
    return Found(x, None, made, noise, judged, bands, rise)
