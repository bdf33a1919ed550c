"""Fitted parameters as a distribution: what ``dockloop fit`` found drives a sweep.

Parameters are parts of the ranges that the fit searched. Those that its data do not identify are
uniform there; the others are normal with the covariance of the fit, within their ranges, each given
those before it.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.files import MADE_BY
from dockloop.base.number import is_number
from dockloop.base.paths import shown
from dockloop.scene.find import read_json

COMMAND = "dockloop fit"
_ROOM = 1e-9  # on variances, relative: a correlation of 1 has a factorisation


def make_numbers(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a draw needs of a fit: the members of the entry of a sweep.

    Args:
        summary: of `dockloop.studies.fits.report.summarise_fit`. A parameter of one test alone has
            another label than its name, and is left out.
    """
    labels = list(summary["values"])
    names = [label for label in labels if label in summary["vary"]]
    places = [labels.index(name) for name in names]
    leads = [direction["parameters"][0] for direction in summary["not_identified"]]
    return {
        "names": names,
        "units": [summary["units"][name] for name in names],
        "values": [summary["values"][name] for name in names],
        "ranges": [list(summary["vary"][name]) for name in names],
        "covariance": [[summary["covariance"][i][j] for j in places] for i in places],
        "uniform": [name for name in names if name in leads],
    }


def read_fitted(entry: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return an entry of ``vary`` with the numbers of its file.

    Args:
        entry: of type ``fit``; one that has its numbers is returned as it is.
        folder: to which its file is relative.

    Raises:
        UsageError: naming file, member and what is expected.
    """
    path = folder / entry["file"]
    if "numbers" not in entry:
        summary = read_json(path)
        if not isinstance(summary, dict) or summary.get(MADE_BY) != COMMAND:
            raise UsageError(f"{shown(path)}: was not written by '{COMMAND}': must be its result")
        if "covariance" not in summary:
            raise UsageError(f"{shown(path)}: is a plan of tests: must be the result of a fit")
        try:
            entry = {**entry, "numbers": make_numbers(summary)}
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise UsageError(
                f"{shown(path)}: lacks or has a bad member ({error}): run '{COMMAND}' again"
            ) from None
    _check(entry["numbers"], path)
    return entry


def _check(numbers: Mapping[str, Any], path: Path) -> None:
    """Refuse numbers that cannot be drawn."""
    texts: dict[str, Any] = {m: numbers.get(m) for m in ("names", "units", "uniform")}
    for member, values in texts.items():
        if not isinstance(values, list) or not all(isinstance(v, str) for v in values):
            raise UsageError(f"{shown(path)}: '{member}' must be a list of texts")
    names, units, uniform = texts.values()
    if not names:
        raise UsageError(f"{shown(path)}: has no parameter that all tests share: fit with --vary")
    if len(units) != len(names) or not set(uniform) <= set(names):
        raise UsageError(
            f"{shown(path)}: 'units' must have one text for each of 'names', 'uniform' some of them"
        )
    flat = {
        member: _flatten(numbers.get(member), shape)
        for member, shape in (
            ("values", (len(names),)),
            ("ranges", (len(names), 2)),
            ("covariance", (len(names), len(names))),
        )
    }
    for member, values in flat.items():
        if values is None:
            raise UsageError(
                f"{shown(path)}: '{member}' must be finite numbers, one for each parameter"
            )
    ranges = np.reshape(numbers["ranges"], (-1, 2))
    for name, value, (low, high) in zip(names, numbers["values"], ranges, strict=True):
        if not low < high or not low <= value <= high:
            raise UsageError(
                f"{shown(path)}: '{name}' is {value:g} in the range [{low:g}, {high:g}]: the range"
                " must ascend and hold the value"
            )
    try:
        _factorise(numbers, range(len(names)))
    except np.linalg.LinAlgError:
        raise UsageError(f"{shown(path)}: 'covariance' must be positive definite") from None


def _flatten(values: Any, shape: tuple[int, ...]) -> list[float] | None:
    """Return the numbers of nested lists; None: a shape or a number is bad."""
    if not isinstance(values, list) or len(values) != shape[0]:
        return None
    if len(shape) == 1:
        return values if all(is_number(v) and math.isfinite(v) for v in values) else None
    rows = [_flatten(row, shape[1:]) for row in values]
    return None if any(row is None for row in rows) else [v for row in rows for v in row or []]


def _factorise(numbers: Mapping[str, Any], order: Sequence[int]) -> np.ndarray:
    """Return the Cholesky factor of the covariance of parameters in an order."""
    covariance = np.array(numbers["covariance"])[np.ix_(order, order)]
    if not np.allclose(covariance, covariance.T, rtol=1e-6, atol=0.0):
        raise np.linalg.LinAlgError
    return np.linalg.cholesky(covariance + _ROOM * np.diag(np.diag(covariance)))


def draw_fitted(numbers: Mapping[str, Any], cube: np.ndarray) -> np.ndarray:
    """Return parameters for points of the unit cube, shape (cases, parameters) as there.

    Args:
        numbers: of `make_numbers`.
        cube: shape (cases, parameters).
    """
    from scipy.stats import truncnorm

    low, high = np.array(numbers["ranges"]).T
    mean = (np.array(numbers["values"]) - low) / (high - low)
    is_uniform = [name in numbers["uniform"] for name in numbers["names"]]
    order = sorted(range(len(mean)), key=lambda i: not is_uniform[i])
    factor = _factorise(numbers, order)
    normal, drawn = np.zeros_like(cube), np.empty_like(cube)
    for row, i in enumerate(order):
        centre, deviation = mean[i] + normal[:, :row] @ factor[row, :row], factor[row, row]
        if is_uniform[i]:
            part = cube[:, i]
        else:
            ends = ((end - centre) / deviation for end in (0.0, 1.0))
            part = centre + deviation * truncnorm.ppf(cube[:, i], *ends)
        drawn[:, i] = np.clip(part, 0.0, 1.0)
        normal[:, row] = (drawn[:, i] - centre) / deviation
    return low + (high - low) * drawn
