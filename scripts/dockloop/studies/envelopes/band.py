"""How uncertain a boundary is: the same search with parameters drawn from a fit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.number import check_whole
from dockloop.studies.envelopes.search import Order, Progress, Search, find_envelope
from dockloop.sweeps.campaign import How
from dockloop.sweeps.fitted import draw_fitted, read_fitted
from dockloop.sweeps.sampling import sample_cube
from dockloop.sweeps.settings import Settings

_RASTER = {2: 32, 3: 8}  # cells along an axis of the table


@dataclass(frozen=True)
class Draws:
    """Parameters of a fit, for the searches of a band.

    Attributes:
        values: that the fit found, by name.
        drawn: the same parameters with their covariance, one for each search.
    """

    values: Settings
    drawn: list[dict[str, float]]

    def put_values(self, order: Order) -> Order:
        """Return an order with the fitted values. Raises UsageError: it decides one itself."""
        decided = {*(axis.name for axis in order.axes), *order.settings}
        if both := sorted(decided & set(self.values)):
            raise UsageError(
                f"--from: has '{both[0]}', which --x, --y, --z or --set decide already"
            )
        return replace(order, settings=order.settings | self.values)


def read_draws(file: str | Path, count: Any, seed: int) -> Draws:
    """Draw the parameters of the searches.

    Args:
        file: result of a fit.
        count: of searches, at least 2.
        seed: of the draws.

    Raises:
        UsageError: the file is none, or a number is bad.
    """
    count, seed = check_whole("--draws", count, 2, 10_000), check_whole("--seed", seed, 0)
    numbers = read_fitted({"type": "fit", "file": str(file)}, Path())["numbers"]
    names = numbers["names"]
    cube = sample_cube("latin_hypercube", count, len(names), seed)
    drawn = [dict(zip(names, row, strict=True)) for row in draw_fitted(numbers, cube).tolist()]
    values = dict(zip(names, numbers["values"], strict=True))
    return Draws(Settings(values, dict.fromkeys(names, f"--from {file}")), drawn)


def find_band(
    order: Order,
    draws: Draws,
    name_journal: Callable[[int], Path],
    *,
    progress: Progress | None = None,
    **how: Unpack[How],
) -> list[Search]:
    """Find the boundary with each draw. Raises as `find_envelope`.

    Args:
        order: what is asked for, of `Draws.put_values`.
        draws: of `read_draws`.
        name_journal: returns the journal of a draw, from 1.
        progress: as for `find_envelope`.
        how: see `How`.
    """
    found: list[Search] = []
    for number, values in enumerate(draws.drawn, 1):
        before = sum(len(search.runs) for search in found)

        def report(done: int, total: int, note: str, *, part: tuple = (number, before)) -> None:
            if progress:
                which = f"draw {part[0]} of {len(draws.drawn)}, {note}"
                progress(part[1] + done, part[1] + total, which)

        own = Settings(values, draws.values.given_by)
        one = replace(order, settings=order.settings | own)
        found.append(find_envelope(one, name_journal(number), progress=report, **how))
    return found


def list_shares(nominal: Search, band: list[Search]) -> tuple[list[str], list[list[Any]]]:
    """Return the table of a band: points of a raster, share of draws that meet each criterion."""
    axes, texts = nominal.order.axes, [criterion.text for criterion in nominal.criteria]
    cells = min(_RASTER[len(axes)], nominal.mesh.size)
    ticks = [round(nominal.mesh.size * i / cells) for i in range(cells + 1)]
    rows = []
    for point in product(ticks, repeat=len(axes)):
        met = [search.mesh.predict(point, search.known) for search in band]
        rows.append([*nominal.values(point), *np.mean(met, axis=0).tolist()])
    return [*(axis.name for axis in axes), *(f"share: {text}" for text in texts)], rows


def summarise_band(band: Sequence[Search], number: int, shares: list[list[Any]]) -> dict[str, Any]:
    """Return what a summary says of the band of one criterion.

    Args:
        band: searches.
        number: of the criterion.
        shares: rows of `list_shares`.
    """
    parts = [search.mesh.measure(search.known, number)[0] for search in band]
    dimensions = len(band[0].order.axes)
    points = np.array([row[:dimensions] for row in shares], dtype=float)
    share = np.array([row[dimensions + number] for row in shares])
    # A point at the edge of the box stands for half a cell along that axis.
    is_edge = (points == points.min(axis=0)) | (points == points.max(axis=0))
    area = 0.5 ** np.sum(is_edge, axis=1)
    return {
        "draws": len(band),
        "met": {"mean": float(np.mean(parts)), "low": min(parts), "high": max(parts)},
        "always": float(np.average(share == 1.0, weights=area)),
        "sometimes": float(np.average((share > 0.0) & (share < 1.0), weights=area)),
    }
