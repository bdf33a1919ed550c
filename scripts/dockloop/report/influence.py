"""Which input decides an outcome: total Sobol indices with intervals, and thresholds.

The total Sobol index of an input is the part of the variance of an outcome that goes with the
input, alone and together with others. It is found from given cases by a Gaussian process whose
kernel is a product over the inputs of 1 + a k(x, x') (analysis of variance by smoothing splines:
Gu, Smoothing Spline ANOVA Models, 2013; order 1 or 2). Likelihood chooses the factors a and the
order. A mean prediction is too smooth and its indices are too low. Indices of functions drawn from
the posterior are not (Le Gratiet, Cannamela, Iooss, SIAM/ASA J. Uncertainty Quantification 2 (2014)
336). Each draw also resamples as many points as there are cases, so that its spread has both
uncertainties. What the process does not predict of left-out cases may go with any input: it widens
every interval. Inputs count as independent.

A threshold is the best cut of one input into two groups, with the p-value of a permutation test.
`tests/test_influence.py` counts how often the intervals hold closed forms.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dockloop.base.progress import import_optional

LEAST = 20  # cases; fewer say nothing
_RARE = 5  # cases that must differ from the most frequent outcome
_MOST, _MOST_CUT = 512, 2048  # cases that a process, a cut are fitted to, drawn from more
_POINTS, _DRAWS, _FEATURES = 1024, 100, 1000
_GRID = np.linspace(0.0, 1.0, 101)  # where functions of one input are drawn
_TAILS = (2.5, 50.0, 97.5)  # %
_WEIGHTS, _NOISE = (-9.0, 9.0), (-16.0, 5.0)  # bounds of their logarithms
_PERMUTATIONS = 999


class Share(NamedTuple):
    """The total Sobol index of an input: median and 95 % interval."""

    value: float
    low: float
    high: float


@dataclass
class Influence:
    """What inputs decide about one outcome.

    Attributes:
        score: part of the variance of left-out cases that is predicted: 1 all, 0 nothing.
        shares: total Sobol index of every input.
        cases: number of cases used.
    """

    score: float
    shares: list[Share]
    cases: int


@dataclass
class Cut:
    """The best cut of one input into two groups.

    Attributes:
        column: of the input.
        value: of the input, between the groups.
        probability: part of outcomes in random order that have as good a cut.
    """

    column: int
    value: float
    probability: float


def can_rank(outcome: np.ndarray) -> bool:
    """Return whether there are enough cases, and enough that differ from the others."""
    if len(outcome) < LEAST:
        return False
    counts = np.unique(outcome, return_counts=True)[1]
    return bool(len(outcome) - counts.max() >= _RARE)


def find_influence(inputs: np.ndarray, outcome: np.ndarray, seed: int = 0) -> Influence:
    """Find what the inputs decide about an outcome.

    Args:
        inputs: numbers, shape (cases, inputs); no column is constant.
        outcome: one number per case, shape (cases,); see `can_rank`.
        seed: of all random numbers: the same seed gives the same bits.

    Raises:
        DockloopError: scipy is not installed.
    """
    import_optional("scipy")
    random = np.random.default_rng(seed)
    inputs, outcome = _choose(inputs, outcome, _MOST, random)
    process = _Process((inputs - inputs.min(axis=0)) / np.ptp(inputs, axis=0), outcome)
    totals = process.draw_totals(random)
    low, value, high = np.percentile(totals, _TAILS, axis=0)
    unknown = 1.0 - process.score
    parts = np.clip([value, low - unknown, high + unknown], 0.0, 1.0)
    shares = [Share(*map(float, each)) for each in parts.T]
    return Influence(process.score, shares, len(outcome))


def find_cut(inputs: np.ndarray, outcome: np.ndarray, seed: int = 0) -> Cut:
    """Find the cut of one input that leaves least variance of the outcome within its two groups.

    Args:
        inputs: as for `find_influence`.
        outcome: as for `find_influence`.
        seed: of the permutations.
    """
    random = np.random.default_rng(seed)
    inputs, outcome = _choose(inputs, outcome, _MOST_CUT, random)
    count = len(outcome)
    first = outcome - outcome.mean()
    orders = np.array([first, *(random.permutation(first) for _ in range(_PERMUTATIONS))])
    below = np.arange(1, count)
    best, cut, most = -1.0, (0, 0.0), np.zeros(len(orders))
    for column, values in enumerate(inputs.T):
        order = np.argsort(values, kind="stable")
        sorted_values = values[order]
        sums = np.cumsum(orders[:, order], axis=1)[:, :-1]
        gains = np.where(np.diff(sorted_values) > 0.0, sums**2 / (below * (count - below)), 0.0)
        most = np.maximum(most, gains.max(axis=1))
        at = int(np.argmax(gains[0]))
        if gains[0, at] > best:
            best, cut = gains[0, at], (column, float(sorted_values[at : at + 2].mean()))
    return Cut(*cut, float(np.mean(most >= best * (1.0 - 1e-9))))


def _choose(
    inputs: np.ndarray, outcome: np.ndarray, most: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return at most so many cases, drawn at random."""
    if len(outcome) <= most:
        return inputs, outcome
    chosen = np.sort(random.choice(len(outcome), most, replace=False))
    return inputs[chosen], outcome[chosen]


def _calc_kernel(x: np.ndarray, y: np.ndarray, order: int) -> np.ndarray:
    """Return the kernel of smoothing splines on 0 to 1, whose functions have the mean 0."""
    far = np.abs(x[:, None] - y)
    product = np.outer(x - 0.5, y - 0.5)
    if order == 1:
        return product + (far * (far - 1.0) + 1.0 / 6.0) / 2.0
    square = np.outer(x * (x - 1.0) + 1.0 / 6.0, y * (y - 1.0) + 1.0 / 6.0)
    return product + square / 4.0 - ((far * (far - 1.0)) ** 2 - 1.0 / 30.0) / 24.0


class _Process:
    """A Gaussian process through cases: inputs from 0 to 1, an outcome of variance 1."""

    def __init__(self, x: np.ndarray, outcome: np.ndarray) -> None:
        self._x = x
        y = (outcome - outcome.mean()) / outcome.std()
        fits = [(*self._fit(y, order), order) for order in (1, 2)]
        _, found, self._order = min(fits, key=lambda fit: fit[0])
        *self._weights, self._noise = np.exp(found)
        covariance = self._calc_covariance(x) + self._noise * np.eye(len(y))
        self._inverse = np.linalg.inv(covariance)
        self._slope = self._inverse @ y
        self._variance = y @ self._slope / len(y)
        left_out = self._slope / np.diag(self._inverse)  # errors of predictions without the case
        self.score = float(max(0.0, 1.0 - np.mean(left_out**2)))

    def _fit(self, y: np.ndarray, order: int) -> tuple[float, np.ndarray]:
        """Return minus the largest log-likelihood, and the logarithms of weights and noise."""
        from scipy.linalg import cho_factor, cho_solve
        from scipy.optimize import minimize

        kernels = [_calc_kernel(values, values, order) for values in self._x.T]
        unit = np.eye(len(y))

        def calc_cost(logs: np.ndarray) -> tuple[float, np.ndarray]:
            *weights, noise = np.exp(logs)
            factors = [1.0 + a * k for a, k in zip(weights, kernels, strict=True)]
            product = np.prod(factors, axis=0)
            factor = cho_factor(product + noise * unit, lower=True)
            slope = cho_solve(factor, y)
            variance = y @ slope / len(y)
            cost = 0.5 * len(y) * np.log(variance) + np.log(np.diag(factor[0])).sum()
            rest = cho_solve(factor, unit) - np.outer(slope, slope) / variance
            shared = rest * product
            terms = zip(weights, kernels, factors, strict=True)
            slopes = [0.5 * a * np.sum(shared * (k / f)) for a, k, f in terms]
            return float(cost), np.array([*slopes, 0.5 * noise * np.trace(rest)])

        inputs = len(kernels)
        found = minimize(
            calc_cost, [*(0.0,) * inputs, -4.0], jac=True, method="L-BFGS-B",
            bounds=[_WEIGHTS] * inputs + [_NOISE], options={"maxiter": 30},
        )  # fmt: skip
        return found.fun, found.x

    def _calc_covariance(self, points: np.ndarray) -> np.ndarray:
        """Return the covariance of points with the cases, over the variance."""
        product = np.ones((len(points), len(self._x)))
        for a, p, x in zip(self._weights, points.T, self._x.T, strict=True):
            product *= 1.0 + a * _calc_kernel(p, x, self._order)
        return product

    def draw_totals(self, random: np.random.Generator) -> np.ndarray:
        """Return total indices of functions drawn from the posterior, shape (draws, inputs)."""
        count, inputs = self._x.shape
        # Points, and the same points with one input drawn anew; variances are those of both.
        first, other = (random.choice(self._x, _POINTS) for _ in range(2))
        for each in (first, other):
            random.permuted(each, axis=0, out=each)
        sets = np.array([first] * (inputs + 1))
        for column in range(inputs):
            sets[column + 1, :, column] = other[:, column]
        points = sets.reshape(-1, inputs)
        # Matheron's rule: functions of the prior, corrected by what they miss at the cases.
        prior = self._draw_prior(np.concatenate([self._x, points]), random)
        noise = np.sqrt(self._noise) * random.standard_normal((count, _DRAWS))
        covariance = self._calc_covariance(points)
        deviation = prior[count:] - covariance @ (self._inverse @ (prior[:count] + noise))
        values = (covariance @ self._slope)[:, None] + np.sqrt(self._variance) * deviation
        values = values.reshape(inputs + 1, _POINTS, _DRAWS)
        totals = []
        for draw in range(_DRAWS):
            start, *moved = values[:, random.integers(0, _POINTS, count), draw]
            variances = [np.var([start, each]) for each in moved]
            totals.append(np.mean((start - moved) ** 2, axis=1) / variances / 2.0)
        return np.array(totals)

    def _draw_prior(self, points: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Return functions of the prior over its deviation, shape (points, draws).

        Each is a sum of products of random functions of one input.
        """
        sizes, vectors = np.linalg.eigh(_calc_kernel(_GRID, _GRID, self._order))
        root = vectors * np.sqrt(np.maximum(sizes, 0.0))
        features = np.full((len(points), _FEATURES), 1.0 / np.sqrt(_FEATURES), dtype=np.float32)
        last = len(_GRID) - 1
        for a, values in zip(self._weights, points.T, strict=True):
            functions = np.sqrt(a) * (root @ random.standard_normal((len(_GRID), _FEATURES)))
            functions += random.choice([-1.0, 1.0], _FEATURES)
            left = np.minimum((values * last).astype(int), last - 1)
            part = (values * last - left)[:, None]
            features *= (1.0 - part) * functions[left] + part * functions[left + 1]
        return features @ random.standard_normal((_FEATURES, _DRAWS))
