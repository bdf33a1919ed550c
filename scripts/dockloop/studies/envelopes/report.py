"""What was found: two tables, a summary for programs and for people, a figure.

``points.csv`` has a row for every docking, with the command that runs it alone; ``boundary.csv``
has a row for every place where a criterion changes: a point on either side and the middle, which is
off by half their distance at most. Units of the columns are in the summary (member ``units``).
"""

import math
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.files import MADE_BY, Kind, figure_kind, json_kind, table_kind, write_csv
from dockloop.base.palette import CELLS, POINTS, SHARES
from dockloop.base.sections import FACTS, Section, html_kind, list_files
from dockloop.report.parts import describe_base, say_value, show_figure
from dockloop.report.sweep import estimate_fraction
from dockloop.result.capture import explain_capture
from dockloop.studies.envelopes.band import summarise_band
from dockloop.studies.envelopes.mesh import Cell, Point
from dockloop.studies.envelopes.search import COMMAND, WORK, Search
from dockloop.sweeps.assured import COLUMNS, list_cells, summarise_cases
from dockloop.sweeps.assured import list_facts as list_assured
from dockloop.sweeps.journal import journal_kind
from dockloop.sweeps.table import describe_output

KINDS = {  # of the files in the folder of an envelope
    "points.csv": table_kind("table", COMMAND, "run,", ",status,reason"),
    "boundary.csv": table_kind("table", COMMAND, "criterion,along,"),
    "summary.json": json_kind("summary", COMMAND),
    "envelope.png": figure_kind(COMMAND),
    "report.html": html_kind(COMMAND),
}
_BAND = "band.csv"
JOURNAL = "journal.jsonl"
_SLICES = 4  # panels of a figure of three quantities, for each criterion
_FAINT = 0.75  # opacity of shares of draws
_LEVELS = [i / 10 for i in range(11)]
Row = list[Any]
Table = tuple[list[str], list[Row]]


def name_journal(draw: int) -> str:
    """Return the file of the runs of a draw, from 1."""
    return f"journal_{draw}.jsonl"


def list_kinds(draws: int) -> dict[str, Kind]:
    """Return all files in the folder of an envelope; `draws` searches make its band."""
    journals = [JOURNAL, *(name_journal(number) for number in range(1, draws + 1))]
    band = {_BAND: table_kind("table", COMMAND, "", ",share: ")} if draws else {}
    return KINDS | band | dict.fromkeys(journals, journal_kind(WORK))


def list_points(search: Search) -> tuple[list[str], list[Row]]:
    """Return the table of all dockings: names of the columns, and rows in order of the points."""
    planner = search.planner
    axes = [axis.name for axis in search.order.axes]
    texts = [criterion.text for criterion in search.criteria]
    looked_at = (name for criterion in search.criteria for name in criterion.outputs)
    shown = [n for n in dict.fromkeys([*planner.outcomes, *looked_at]) if n not in (*axes, *texts)]
    columns = ["run", *axes, "status", "reason", *texts]
    columns += [*shown, "explanation", "command"]
    columns += [] if planner.assured is None else COLUMNS
    rows = []
    for number, point in enumerate(sorted(search.runs), 1):
        result, outputs = search.runs[point], search.outputs(point)
        met = search.known[point] if outputs else [None] * len(search.criteria)
        ends = [describe_output(name, outputs[name]) if outputs else None for name in shown]
        why = explain_capture(outputs)
        command = shlex.join(make_command(search, point))
        status = [result.status, result.reason]
        row = [number, *search.values(point), *status, *met, *ends, why, command]
        rows.append([*row, *([] if planner.assured is None else list_cells(result.assured))])
    return columns, rows


def list_boundary(search: Search) -> tuple[list[str], list[Row]]:
    """Return the table of all places where a criterion changes."""
    axes = [axis.name for axis in search.order.axes]
    columns = ["criterion", "along", *axes, "half_distance"]
    columns += [f"{name} {side}" for side in ("met", "not met") for name in axes]
    rows: list[Row] = []
    for number, criterion in enumerate(search.criteria):
        for bracket in search.mesh.list_brackets(search.known, number):
            inside, outside = search.values(bracket.inside), search.values(bracket.outside)
            (along,) = (i for i, (a, b) in enumerate(zip(*bracket, strict=True)) if a != b)
            half = abs(inside[along] - outside[along]) / 2
            middle = search.middle(bracket)
            rows.append([criterion.text, axes[along], *middle, half, *inside, *outside])
    return columns, rows


def make_command(search: Search, point: Point) -> list[str]:
    """Return the words of the command that runs one point alone."""
    end = search.runs[point].end_time
    stop = float(search.planner.times[-1]) if end is None else end
    return search.planner.make_command(search.values(point), stop)


def summarise_envelope(
    search: Search, band: Sequence[Search] = (), shares: Table | None = None
) -> dict:
    """Condense what was found into a dictionary that can be written as JSON.

    Args:
        search: the boundary.
        band: searches with draws of a fit.
        shares: of `dockloop.studies.envelopes.band.list_shares`, with a band.
    """
    planner, mesh = search.planner, search.mesh
    status = Counter(result.status for result in search.runs.values())
    criteria = [_summarise_criterion(search, number) for number in range(len(search.criteria))]
    for number, criterion in enumerate(criteria):
        if shares:
            criterion["band"] = summarise_band(band, number, shares[1])
    full = (mesh.size + 1) ** mesh.dimensions
    summary: dict = {
        MADE_BY: COMMAND,
        "scene": search.order.scene,
        "title": planner.base["title"],
        "set": dict(search.order.settings),
        "quantities": [
            {
                **described,
                "half_distance": axis.value(0.5 / mesh.size) / axis.low - 1.0
                if axis.is_log
                else axis.value(0.5 / mesh.size) - axis.low,
            }
            for described, axis in zip(list_axes(search), search.order.axes, strict=True)
        ],
        "criteria": criteria,
        "cells": mesh.size,
        "uncertainty": 0.5 / mesh.size,
        "dockings": len(search.runs),
        "grid": full,
        "grid_over_dockings": full / len(search.runs),
        "status": dict(status),
        "checks": {"points": len(search.checks), "differ": sum(search.checks.values())},
        "units": list_units(search),
        "time": {
            "ran": sum(each.ran for each in (search, *band)),
            "wall": sum(each.wall for each in (search, *band)),
        },
    }
    reasons = Counter(result.reason for result in search.runs.values() if result.reason)
    if planner.assured is not None:
        runs = (search.runs[point] for point in sorted(search.runs))
        summary |= summarise_cases((n, *list_cells(r.assured)) for n, r in enumerate(runs, 1))
    if not_seen := planner.list_not_seen():
        summary["not_seen"] = not_seen
    if reasons:
        summary["reasons"] = [
            {"reason": reason, "count": count} for reason, count in reasons.most_common(5)
        ]
    return summary


def list_axes(search: Search) -> list[dict]:
    """Return what varies, for a summary: name, unit, range, scale."""
    return [
        {
            "name": quantity.name,
            "unit": quantity.unit,
            "low": axis.low,
            "high": axis.high,
            "log": axis.is_log,
        }
        for quantity, axis in zip(search.planner.quantities, search.order.axes, strict=True)
    ]


def list_units(search: Search) -> dict[str, str]:
    """Return the units of the columns of both tables that have one."""
    planner = search.planner
    units = {quantity.name: quantity.unit for quantity in planner.quantities}
    units |= {f"{name} {side}": u for name, u in units.items() for side in ("met", "not met")}
    units |= {name: planner.variables[name].unit for name in planner.asked}
    return {name: unit for name, unit in units.items() if unit}


def _summarise_criterion(search: Search, number: int) -> dict:
    """Return how much of the box meets a criterion, and a point on either side with its command."""
    mesh, known = search.mesh, search.known
    part, unsure = mesh.measure(known, number)
    brackets = mesh.list_brackets(known, number)
    summary: dict = {
        "text": search.criteria[number].text,
        "met": part,
        "unsure": unsure,
        "boundary_points": len(brackets),
    }
    if brackets:
        example = brackets[len(brackets) // 2]
        for name, point in (("met_example", example.inside), ("unmet_example", example.outside)):
            summary[name] = {
                "values": list(search.values(point)),
                "command": shlex.join(make_command(search, point)),
            }
    return summary


def report_envelope(summary: dict) -> list[Section]:
    """Return the report of an envelope; `summary` is that of `summarise_envelope`."""
    title = f"{summary['scene']}: {summary['title']}"
    heads = ("criterion", "part of the box", "boundary points")
    bands = [
        (c["text"], f"{b['met']['low']:.1%} to {b['met']['high']:.1%}", f"{b['always']:.1%}",
         f"{b['sometimes']:.1%}")
        for c in summary["criteria"] if (b := c.get("band"))
    ]  # fmt: skip
    band_heads = ("criterion", "part of the box, by draw", "met by all draws", "by some")
    met = (
        (c["text"], _say_part(c, summary["dockings"]), c["boundary_points"])
        for c in summary["criteria"]
    )
    axes = (
        (q["name"], f"{q['low']:g} to {q['high']:g} {q['unit']}", say_half_distance(q))
        for q in summary["quantities"]
    )
    sides = {"met_example": "met", "unmet_example": "not met"}
    return [
        Section(title, table=[FACTS, *_list_facts(summary)], points=summary.get("not_seen", [])),
        Section("Where the criteria are met", table=[heads, *met]),
        Section("With parameters drawn from the fit", table=[band_heads, *bands] if bands else []),
        Section("Quantities", table=[("quantity", "range", "boundary within +-"), *axes]),
        *(
            Section(
                f"Two sides of: {c['text']}",
                commands=[(side, c[name]["command"]) for name, side in sides.items() if name in c],
            )
            for c in summary["criteria"]
        ),
    ]


def _say_part(criterion: dict, dockings: int) -> str:
    """Say which part of the box meets a criterion."""
    text = f"{criterion['met']:.1%} +- {criterion['unsure']:.1%}"
    if criterion["boundary_points"]:
        return text
    where = "everywhere" if criterion["met"] > 0.5 else "nowhere"
    return f"{text}: {where} in this box, as far as {dockings} dockings say"


def _list_facts(summary: dict) -> Iterator[tuple[str, str]]:
    """Yield what ran, how far the boundary can be trusted, and what it took."""
    grid = f"a grid of the same resolution has {summary['grid']}"
    times = f"{summary['grid_over_dockings']:.1f} times as many"
    yield "ran", f"{summary['dockings']} dockings; {grid}: {times}"
    yield from list_assured(summary)
    if count := summary["checks"]["points"]:
        right = count - summary["checks"]["differ"]
        least = f"at least {estimate_fraction(right, count)['low']:.0%} of that area (95 %)"
        where = "points at random away from the boundary are as expected"
        yield "checks", f"{right} of {count} {where}: {least}"
    if list(summary["status"]) != ["done"]:
        counts = ", ".join(f"{count} {name}" for name, count in summary["status"].items())
        yield "status", f"{counts}; what did not run meets no criterion"
        yield "", f"for example: {summary['reasons'][0]['reason']}"
    clock = summary["time"]
    if clock["ran"]:
        yield "time", f"{clock['ran']} dockings in {clock['wall']:.1f} s"
    yield from list_files(summary.get("files", ()))


def complete_report(summary: dict, planner: Any, figures: Sequence[Path]) -> list[Section]:
    """Return the report of an envelope as its page has it."""
    reasons = (r.values() for r in summary.get("reasons", []))
    more = [[f"set {name}", say_value(value)] for name, value in summary["set"].items()]
    return [
        *report_envelope(summary),
        *(show_figure(figure) for figure in figures),
        Section("Dockings that did not run", table=[("reason", "dockings"), *reasons]),
        *describe_base(planner, more),
    ]


def write_tables(search: Search, folder: Path, shares: Table | None) -> list[Path]:
    """Write the tables; returns the files. Raises DockloopError: one cannot be written."""
    tables = {"points.csv": list_points(search), "boundary.csv": list_boundary(search)}
    if shares:
        tables[_BAND] = shares
    kinds = list_kinds(int(shares is not None))
    for name, table in tables.items():
        write_csv(folder / name, kinds[name], *table)
    return [folder / name for name in tables]


def draw_envelope(search: Search, shares: Table | None = None) -> Any:
    """Draw where every criterion is met; returns a ``matplotlib.figure.Figure``.

    Three quantities give slices: a row for every criterion, a panel for every value of the third.
    In a plane `shares` of draws are shown behind the boundary.
    """
    from matplotlib.figure import Figure

    size = search.mesh.size
    flat = search.mesh.dimensions == 2
    heights = [0] if flat else [size * (2 * i + 1) // (2 * _SLICES) for i in range(_SLICES)]
    count = len(search.criteria)
    rows, columns = (1, count) if flat else (count, len(heights))
    figure = Figure(figsize=(4.6 * columns + 0.4, 4.3 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for (number, height), axis in zip(product(range(count), heights), axes.flat, strict=True):
        _draw_panel(axis, search, number, height)
        if flat and shares:
            _draw_shares(figure, axis, number, shares[1])
    figure.suptitle(search.planner.base["title"], fontsize="medium")
    return figure


def _draw_panel(axis: Any, search: Search, number: int, height: int) -> None:
    """Draw the cells of one criterion at one height, their corners, and the boundary."""
    from matplotlib.collections import LineCollection, PolyCollection

    mesh, known = search.mesh, search.known
    flat = mesh.dimensions == 2
    polygons, colours = [], []
    for cell in mesh.cells:
        if not flat and not cell.corner[2] <= height < cell.corner[2] + cell.width:
            continue
        here = [known[corner][number] for corner in mesh.corners(cell)]
        polygons.append(
            [search.values((*c, height) if not flat else c)[:2] for c in list_outline(cell)]
        )
        colours.append(CELLS["met" if all(here) else "mixed" if any(here) else "not met"])
    axis.add_collection(
        PolyCollection(polygons, facecolors=colours, edgecolors="0.9", linewidths=0.2)
    )
    points = [point for point in search.runs if flat or point[2] == height]
    for met, marker, label in ((True, "o", "met"), (False, "x", "not met")):
        chosen = [search.values(p) for p in points if known[p][number] == met]
        if chosen:
            axis.plot(
                *zip(*(v[:2] for v in chosen), strict=True), marker, color=POINTS[label],
                markersize=2.5, markeredgewidth=0.7, label=f"{label}: {len(chosen)}",
            )  # fmt: skip
    if flat:
        axis.add_collection(LineCollection(_find_segments(search, number), colors=CELLS["edge"]))
    set_axes(axis, search)
    title = search.criteria[number].text
    if not flat:
        third = search.order.axes[2].value(height / mesh.size)
        title += f"\n{_label(search, 2)}: {third:.4g}"
    axis.set_title(title, fontsize="small", wrap=True)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="upper left", bbox_to_anchor=(0.0, -0.16), ncols=2, fontsize="x-small")


def _draw_shares(figure: Any, axis: Any, number: int, rows: list[Row]) -> None:
    """Draw which share of draws meets a criterion, over the cells of the boundary."""
    side = math.isqrt(len(rows))
    x, y, share = (
        np.array([row[column] for row in rows]).reshape(side, side) for column in (0, 1, 2 + number)
    )
    filled = axis.contourf(x, y, share, levels=_LEVELS, cmap=SHARES, alpha=_FAINT, zorder=1.5)
    figure.colorbar(filled, ax=axis, label="share of draws", shrink=0.8)


def set_axes(axis: Any, search: Search) -> None:
    """Give the axes of a panel the ranges, scales and names of the first two quantities."""
    x, y = search.order.axes[:2]
    for scale, limit, quantity in (
        (axis.set_xscale, axis.set_xlim, x),
        (axis.set_yscale, axis.set_ylim, y),
    ):
        scale("log" if quantity.is_log else "linear")
        limit(quantity.low, quantity.high)
    axis.set_xlabel(_label(search, 0))
    axis.set_ylabel(_label(search, 1))


def _label(search: Search, number: int) -> str:
    quantity = search.planner.quantities[number]
    return f"{quantity.name} [{quantity.unit}]" if quantity.unit else quantity.name


def list_outline(cell: Cell) -> list[Point]:
    """Return the corners of a square in order round it."""
    (x, y), w = cell.corner[:2], cell.width
    return [(x, y), (x + w, y), (x + w, y + w), (x, y + w)]


def _find_segments(search: Search, number: int) -> list[list[tuple[float, ...]]]:
    """Return the boundary in every finest square: lines between the middles of its edges."""
    mesh, known = search.mesh, search.known
    segments = []
    for cell in mesh.cells:
        if cell.width > 1:
            continue
        round_it = list_outline(cell)
        middles = []
        for first, second in zip(round_it, round_it[1:] + round_it[:1], strict=True):
            if known[first][number] != known[second][number]:
                parts = ((a + b) / 2 / mesh.size for a, b in zip(first, second, strict=True))
                axes = zip(search.order.axes, parts, strict=True)
                middles.append(tuple(axis.value(part) for axis, part in axes))
        segments += [middles[i : i + 2] for i in range(0, len(middles), 2)]
    return segments


def say_half_distance(quantity: dict) -> str:
    """Say how well a boundary is known along a quantity of a summary."""
    if quantity["log"]:
        return f"{quantity['half_distance']:.1%} of the value"
    unit = "" if quantity["unit"] == "1" else quantity["unit"]
    return f"{quantity['half_distance']:.3g} {unit}".rstrip()
