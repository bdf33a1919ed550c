"""What follows from residuals and their derivatives: deviations, what is not identified, tests.

Covariance of a least-squares estimate with standardised residuals r: the inverse of J'J, times
mean(psi^2) / mean(psi')^2 of the loss (1 without loss), at least 1. Where residuals of a channel
are correlated, its samples count as fewer ones. A direction of the parameters is not identified if
its deviation is that of a guess within the range, or if differences of runs cannot resolve it. Such
a direction counts with the deviation of a guess, so that all others are as uncertain as it makes
them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

GUESS = 12.0**-0.5  # deviation of a value anywhere in a range, part of the range
QUANTILE = 1.959964  # of the normal distribution: 95 % are within
_SHARE = 0.1  # of an undetermined direction that makes a parameter undetermined
_LAGS = 12  # of the test for correlation
_ALARM = 0.001  # probability of a false alarm over all channels, some times this for few samples
_WINDOWS = 20  # of the samples: where residuals are largest


class Penalty(NamedTuple):
    """A loss by standardised residuals: half of ``rho`` is minimised, ``psi`` is its derivative."""

    rho: Callable[[np.ndarray], np.ndarray]
    psi: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]  # of psi


PENALTIES = {
    "linear": Penalty(np.square, lambda r: r, np.ones_like),
    "soft_l1": Penalty(
        lambda r: 2.0 * (np.sqrt(1.0 + r**2) - 1.0),
        lambda r: r / np.sqrt(1.0 + r**2),
        lambda r: (1.0 + r**2) ** -1.5,
    ),
}


@dataclass(frozen=True)
class Estimate:
    """Uncertainty of parameters as parts of their ranges, and of all other unknowns.

    Attributes:
        covariance: of the whole vector, shape (unknowns, unknowns).
        deviations: of the parameters; NaN: not identified.
        correlations: of the parameters, shape (parameters, parameters); NaN likewise.
        directions: unit vectors in the parameters that are not identified, shape (k, parameters).
        singular: values of the scaled derivatives without the other unknowns, largest first.
    """

    covariance: np.ndarray
    deviations: np.ndarray
    correlations: np.ndarray
    directions: np.ndarray
    singular: np.ndarray

    @property
    def log_volume(self) -> float:
        """Logarithm of the determinant of the covariance of the parameters."""
        count = len(self.deviations)
        return float(np.linalg.slogdet(self.covariance[:count, :count])[1])


def estimate(
    jacobian: np.ndarray,
    count: int,
    factor: float,
    resolution: float,
    is_held: np.ndarray | None = None,
) -> Estimate:
    """Return the uncertainty of an estimate.

    Args:
        jacobian: of standardised residuals, shape (samples, unknowns); parameters first.
        count: number of parameters.
        factor: on the covariance.
        resolution: singular values below this are errors of the differences.
        is_held: which samples say nothing on the parameters, but on all other unknowns of theirs.
    """
    own, others = jacobian[:, :count], jacobian[:, count:]
    used = np.any(others != 0.0, axis=0)
    others = others[:, used]
    passed = np.linalg.lstsq(others, own, rcond=None)[0] if used.any() else np.zeros((0, count))
    rest = own - others @ passed
    rest = rest if is_held is None else rest[~is_held]
    _, singular, axes = np.linalg.svd(rest, full_matrices=len(rest) < count)
    singular = np.pad(singular, (0, count - len(singular)))
    is_known = singular > max(math.sqrt(factor) / GUESS, resolution)
    inverse = np.where(singular > resolution, singular, 0.0) ** 2 / factor
    inverse[~is_known] += GUESS**-2
    inner = (axes.T / inverse) @ axes
    covariance = np.zeros((jacobian.shape[1],) * 2)
    covariance[:count, :count] = inner
    place = count + np.flatnonzero(used)
    covariance[np.ix_(place, place)] = (
        factor * np.linalg.pinv(others.T @ others) + passed @ inner @ passed.T
    )
    covariance[np.ix_(place, np.arange(count))] = -passed @ inner
    covariance[np.ix_(np.arange(count), place)] = -(passed @ inner).T
    blind = axes[~is_known].T @ axes[~is_known]
    deviations = np.sqrt(np.diag(inner))
    deviations[np.sqrt(np.clip(np.diag(blind), 0.0, None)) > _SHARE] = np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        correlations = inner / np.outer(deviations, deviations)
    return Estimate(covariance, deviations, correlations, _find_axes(blind), singular)


def _find_axes(projector: np.ndarray) -> np.ndarray:
    """Return unit vectors that span a subspace, parameters of their own first."""
    remaining, found = projector.copy(), []
    for _ in range(round(np.trace(projector))):
        lengths = np.sqrt(np.clip(np.diag(remaining), 0.0, None))
        axis = remaining[int(np.argmax(lengths))]
        axis = axis / np.linalg.norm(axis)
        found.append(axis)
        remaining = remaining - np.outer(axis, axis) @ remaining
    return np.array(found).reshape(len(found), len(projector))


def list_leading(direction: np.ndarray) -> list[int]:
    """Return the parameters that a direction is of, the largest part first."""
    size = np.abs(direction)
    return [int(i) for i in np.argsort(-size) if size[i] > _SHARE]


def describe_direction(direction: np.ndarray, labels: Sequence[str]) -> tuple[list[str], str]:
    """Return the parameters of a direction that is not identified, and a sentence."""
    order = list_leading(direction)
    names = [labels[i] for i in order]
    if len(names) == 1:
        return names, f"these data do not determine {names[0]}"
    lead = direction[order[0]]
    parts = (f"{labels[i]} by {direction[i] / lead:+.0%}" for i in order[1:])
    return names, (
        f"these data determine {' and '.join(names)} only together: a change of {names[0]} by +100%"
        f" of its range and of {', '.join(parts)} of its range is hardly seen"
    )


def find_factor(residuals: np.ndarray, loss: str, unknowns: int) -> float:
    """Return the factor on the covariance: loss, and scatter beyond what was stated."""
    _, psi, slope = (function(residuals) for function in PENALTIES[loss])
    spare = max(1, len(residuals) - unknowns)
    ratio = float(np.sum(psi**2) / spare / np.mean(slope) ** 2)
    return max(ratio, 1.0)


def find_correlation(residuals: np.ndarray) -> tuple[float, float]:
    """Return the p-value of no correlation (Ljung, Box), and samples per independent sample."""
    from scipy.stats import chi2

    count = len(residuals)
    lags = min(_LAGS, count // 5)
    spread = float(residuals @ residuals)
    if lags < 1 or spread == 0.0:
        return 1.0, 1.0
    most = max(lags, count // 4)
    rho = np.array([residuals[k:] @ residuals[:-k] for k in range(1, most + 1)]) / spread
    near = rho[:lags]
    statistic = count * (count + 2) * float(np.sum(near**2 / (count - np.arange(1, lags + 1))))
    ends = np.flatnonzero(rho <= 0.0)
    length = 1.0 + 2.0 * float(np.sum(rho[: ends[0] if len(ends) else most]))
    return float(chi2.sf(statistic, lags)), length


def judge_residuals(
    residuals: np.ndarray, time: np.ndarray, tests: int, *, is_stated: bool, is_exact: bool
) -> dict[str, Any]:
    """Return whether the residuals of a channel look like noise.

    Args:
        residuals: run less data over standard deviation, shape (samples,).
        time: of the samples [s].
        tests: channels that are judged, for the probability of a false alarm.
        is_stated: the standard deviation is that of a sensor; else that of these residuals.
        is_exact: they are as small as errors of runs: nothing to judge.

    Returns:
        ``chi2`` (mean square), ``p_correlation``, ``p_size`` (None unless stated), ``per_sample``
        (samples per independent one), ``hidden`` (what is wrong; empty: nothing), ``from`` and
        ``to`` (times between which residuals are largest, None unless something is).
    """
    from scipy.stats import chi2

    correlation, length = find_correlation(residuals)
    square, count = float(residuals @ residuals), len(residuals)
    size = float(chi2.sf(square, count)) if is_stated else None
    limit = _ALARM / max(1, tests) / (2 if is_stated else 1)
    hidden = []
    if not is_exact and correlation < limit:
        hidden.append(f"neighbouring residuals are alike (p = {correlation:.1e})")
    if not is_exact and size is not None and size < limit:
        hidden.append(f"they are {math.sqrt(square / count):.2f} times the stated noise")
    found: dict[str, Any] = {
        "chi2": square / count,
        "p_correlation": correlation,
        "p_size": size,
        "per_sample": length if hidden and correlation < limit else 1.0,
        "hidden": "; ".join(hidden),
        "from": None,
        "to": None,
    }
    if hidden:
        parts = np.array_split(np.arange(count), min(_WINDOWS, count))
        worst = max(parts, key=lambda rows: abs(float(np.sum(residuals[rows]))))
        found["from"], found["to"] = float(time[worst[0]]), float(time[worst[-1]])
    return found
