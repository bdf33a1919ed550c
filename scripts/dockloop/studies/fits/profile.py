"""The profile of the worst pair of parameters: how fast other values meet the measurements worse.

One parameter of the pair is held at values around the best one; all other unknowns follow to the
minimum. If the model were linear, the sum of squares would rise by the square of deviations, and
the partner would go along a straight line. How far that is true is seen here, and what bounds a
direction that derivatives do not see. Residuals count as for the deviations.
"""

import math
from dataclasses import dataclass

import numpy as np

from dockloop.studies.fits.problem import Problem
from dockloop.studies.fits.search import Found, solve
from dockloop.studies.fits.statistics import PENALTIES, QUANTILE, Estimate, list_leading

_REACH = 3.0  # deviations on either side
_POINTS = 3  # on either side
_ROOM = 1e-3  # of the range: a side that is shorter has none


@dataclass
class Profile:
    """How the misfit rises.

    Attributes:
        pair: numbers of the parameter that is held, and of its partner, if it has one.
        points: vectors, the held parameter ascending; shape (points, unknowns).
        rise: of the sum of squares from the best vector; 1 is that of one deviation.
        interval: of the held parameter, 95 %, parts of its range; NaN: no end was seen.
    """

    pair: list[int]
    points: np.ndarray
    rise: np.ndarray
    interval: tuple[float, float]


def choose_pair(made: Estimate) -> list[int]:
    """Return the worst pair: of what is not identified, else of the largest correlation.

    The one that is less certain comes first. A parameter without a partner is alone.
    """
    if len(made.directions):
        return list_leading(made.directions[0])[:2]
    sizes = np.abs(made.correlations - np.diag(np.diag(made.correlations)))
    pair = {int(i) for i in np.unravel_index(np.argmax(sizes), sizes.shape)}
    return sorted(pair, key=lambda i: -made.deviations[i])


def find_profile(problem: Problem, found: Found, loss: str) -> Profile:
    """Return the profile of the worst pair. A side ends where no run can be made."""
    pair = choose_pair(found.estimate)
    kept = [series.sigma for series in problem.series]
    for series, judged in zip(problem.series, found.judged, strict=True):
        series.sigma = series.sigma * math.sqrt(judged["per_sample"])
    best = solve(problem, found.x, loss, held=pair[0])
    sides = [_follow(problem, best, found.estimate, loss, end=(pair[0], end)) for end in (0.0, 1.0)]
    points = np.array([*sides[0][::-1], best, *sides[1]])
    misfits = [float(np.sum(PENALTIES[loss].rho(problem.calc_residuals(x)))) for x in points]
    for series, sigma in zip(problem.series, kept, strict=True):
        series.sigma = sigma
    middle = len(sides[0])
    rise = (np.array(misfits) - misfits[middle]) / found.rise
    values = points[:, pair[0]]
    ends = (
        _find_end(values[middle::-1], rise[middle::-1]),
        _find_end(values[middle:], rise[middle:]),
    )
    return Profile(pair, points, rise, ends)


def _follow(
    problem: Problem, best: np.ndarray, made: Estimate, loss: str, *, end: tuple[int, float]
) -> list[np.ndarray]:
    """Return minima towards one end of the range of a parameter: where one is, the next begins."""
    count, (held, bound) = len(problem.parameters), end
    by, room = made.deviations[held], bound - best[held]
    reach = room if math.isnan(by) else math.copysign(min(abs(room), _REACH * by), room)
    way = made.covariance[:, held] / made.covariance[held, held]
    found, x = list[np.ndarray](), best
    for part in np.linspace(0.0, 1.0, _POINTS + 1)[1:] if abs(room) > _ROOM else ():
        start = x + (best[held] + part * reach - x[held]) * way
        start[:count] = np.clip(start[:count], 0.0, 1.0)
        if not np.isfinite(problem.calc_residuals(start)).all():
            break
        x = solve(problem, start, loss, held=held)
        found.append(x)
    return found


def _find_end(values: np.ndarray, rise: np.ndarray) -> float:
    """Return where the rise is that of the end of a 95 % interval; NaN: nowhere."""
    root = np.sqrt(np.maximum.accumulate(np.clip(rise, 0.0, None)))
    return float(np.interp(QUANTILE, root, values)) if root[-1] >= QUANTILE else math.nan
