"""Which input decides an outcome: permutation importance of random trees, by scikit-learn.

Five forests are fitted, each to four fifths of the cases, and tested with the fifth that they have
not seen. There the values of one input are shuffled: half the growth of the squared error, over the
variance of the outcome, is the total Sobol index of that input (Jansen, Computer Physics
Communications 117 (1999) 35). It is the part of the variance that goes with the input, alone and
together with others. How much the forests explain is their score on cases that they have not seen.
Both have the spread over the five forests as uncertainty. `tests/test_influence.py`
compares with closed forms.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dockloop.results import import_optional

LEAST = 20  # cases; fewer say nothing
_MOST = 2048  # cases that are used, drawn at random from more
_FOLDS, _TREES, _SHUFFLES = 5, 50, 3
_RARE = 5  # cases that must differ from the most frequent outcome


class Part(NamedTuple):
    """A mean over the forests and its spread (standard deviation)."""

    mean: float
    spread: float

    def __str__(self) -> str:
        """Return both as people read them."""
        return f"{self.mean:.2f} +- {self.spread:.2f}"


@dataclass
class Influence:
    """What inputs decide about one outcome.

    Attributes:
        score: part of the variance of the outcome that the forests explain: 1 all, 0 nothing.
        shares: total Sobol index of every input, as far as the forests know it.
        cases: number of cases used.
    """

    score: Part
    shares: list[Part]
    cases: int


def can_rank(outcome: np.ndarray) -> bool:
    """Return whether there are enough cases, and enough that differ from the others."""
    if len(outcome) < LEAST:
        return False
    counts = np.unique(outcome, return_counts=True)[1]
    return bool(len(outcome) - counts.max() >= _RARE)


def find_influence(inputs: np.ndarray, outcome: np.ndarray, seed: int = 0) -> Influence:
    """Find what the inputs decide about an outcome.

    Args:
        inputs: numbers, shape (cases, inputs).
        outcome: one number per case, shape (cases,); see `can_rank`.
        seed: of all random numbers: the same seed gives the same bits.

    Raises:
        DockloopError: scikit-learn is not installed.
    """
    import_optional("sklearn", "scikit-learn")
    if len(outcome) > _MOST:
        chosen = np.sort(np.random.default_rng(seed).choice(len(outcome), _MOST, replace=False))
        inputs, outcome = inputs[chosen], outcome[chosen]
    variance = float(np.var(outcome))
    scores, shares = [], []
    for error, growth in _test_forests(inputs, outcome, seed):
        scores.append(1.0 - error / variance)
        shares.append(growth / (2.0 * variance))
    return Influence(
        _summarise(np.array(scores)), [_summarise(each) for each in np.transpose(shares)],
        len(outcome),
    )  # fmt: skip


def _test_forests(
    inputs: np.ndarray, outcome: np.ndarray, seed: int
) -> Iterator[tuple[float, np.ndarray]]:
    """Yield the squared error of each forest, and its growth when an input is shuffled."""
    from sklearn.ensemble import ExtraTreesRegressor
    from sklearn.inspection import permutation_importance
    from sklearn.model_selection import KFold

    folds: Any = KFold(_FOLDS, shuffle=True, random_state=seed)
    for number, (known, unseen) in enumerate(folds.split(inputs), seed):
        forest = ExtraTreesRegressor(_TREES, min_samples_leaf=2, random_state=number)
        forest.fit(inputs[known], outcome[known])
        x, y = inputs[unseen], outcome[unseen]
        found = permutation_importance(
            forest, x, y, scoring="neg_mean_squared_error", n_repeats=_SHUFFLES,
            random_state=number,
        )  # fmt: skip
        yield float(np.mean((forest.predict(x) - y) ** 2)), found["importances_mean"]


def _summarise(values: np.ndarray) -> Part:
    return Part(float(np.mean(values)), float(np.std(values, ddof=1)))
