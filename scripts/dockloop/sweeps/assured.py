"""Assured cases of sweeps and envelopes, in their tables and summaries.

A case runs with two settings, and with tighter ones only if these two runs differ by more than the
wanted accuracy. What a table says of a case depends on this case alone, so threads and resumed
sweeps give the same table.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

YES = "yes"  # in a table: every figure is assured
COLUMNS = {  # of a table, with descriptions
    "assured": f"'{YES}', or the figures that are not within the wanted accuracy, with the reason",
    "settings": "tighter and tighter settings with which it ran; results are those of the last one",
    "price": "evaluations of all runs over those of the first",
}
_PAIR = 2  # settings that every case has
_MOST_LISTED = 3  # figures that a cell names


def list_cells(noted: Mapping[str, Any] | None) -> tuple[str | None, int | None, float | None]:
    """Return the `COLUMNS` of a case; all None for one that was not done."""
    if noted is None:
        return None, None, None
    refused = noted["refused"]
    said = [f"{name}: {why}" for name, why in list(refused.items())[:_MOST_LISTED]]
    if more := len(refused) - len(said):
        said.append(f"and {more} more")
    return "; ".join(said) or YES, noted["settings"], noted["price"]


def summarise_cases(cells: Iterable[tuple[int, Any, Any, Any]]) -> dict[str, Any]:
    """Condense the `COLUMNS` of all cases, each with the number of the case.

    Returns:
        ``assured`` (true, or by figure how many cases are not, with an example; false: there are
        no cases) and ``assurance`` (``cases``, ``assured``, ``again``: more settings than two;
        ``median_price``, ``largest_price``).
    """
    done = [row for row in cells if row[1] is not None]
    refused: dict[str, list[str]] = {}
    for number, said, _, _ in done:
        if said != YES:
            figure = said.partition(":")[0]
            refused.setdefault(figure, []).append(f"case {number}: {said}")
    found = {
        figure: f"in {len(examples)} cases, for example {examples[0]}"
        for figure, examples in sorted(refused.items())
    }
    prices = [row[3] for row in done]
    return {
        "assured": found or bool(done),
        "assurance": {
            "cases": len(done),
            "assured": len(done) - sum(map(len, refused.values())),
            "again": sum(row[2] > _PAIR for row in done),
            "median_price": float(np.median(prices)) if prices else None,
            "largest_price": max(prices, default=None),
        },
    }


def list_facts(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the facts of `summarise_cases` for a report; none of a summary without it."""
    of = summary.get("assurance", {})
    if of.get("cases"):
        yield (
            "assured",
            f"{of['assured']} of {of['cases']}; {of['again']} needed more than two settings;"
            f" evaluations over those of one run: median {of['median_price']:.1f}, largest"
            f" {of['largest_price']:.1f}",
        )
        found = summary["assured"]
        yield from (("", why) for why in ([] if found is True else found.values()))
