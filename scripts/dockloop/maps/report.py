"""What a map says: a page with its picture and tables, a table of all points, a summary.

``points.csv`` has a row for every point with the command that runs it alone. The page ``map.md``
has the parts of the plane with each verdict, reasons of refusals, every bad point with its command,
and a grid of all coarse points.
"""

import math
import shlex
from collections import Counter
from pathlib import Path
from typing import Any

from dockloop.envelopes.mesh import Point
from dockloop.envelopes.report import list_axes, list_outline, set_axes
from dockloop.envelopes.search import Search
from dockloop.errors import one_line
from dockloop.journal import journal_kind
from dockloop.judging import BAD, NUMBERS, VERDICTS, Verdict, list_reasons
from dockloop.maps.verdicts import PointJudge, read_verdict
from dockloop.outputs import (
    MADE_BY,
    figure_kind,
    json_kind,
    table_kind,
    write_csv,
    write_text,
)
from dockloop.palette import MARKERS, VERDICT_COLOURS

COMMAND = "dockloop map"
_TITLE = "# Map: "
KINDS = {  # of the files in the folder of a map
    "map.md": table_kind("page", COMMAND, _TITLE),
    "map.png": figure_kind(COMMAND),
    "points.csv": table_kind("table", COMMAND, "point,", ",verdict,reason,"),
    "summary.json": json_kind("summary", COMMAND),
    "journal.jsonl": journal_kind("map"),
}
_MOST_LISTED = 40  # bad points on the page; the table has all


def summarise_map(search: Search, judge: PointJudge, command: str) -> dict:
    """Condense a map into a dictionary that can be written as JSON."""
    verdicts = {point: read_verdict(search, point) for point in search.runs}
    tally = Counter(verdict.verdict for verdict in verdicts.values())
    right = [v for v in verdicts.values() if v.verdict == "right"]
    return {
        MADE_BY: COMMAND,
        "command": command,
        "scene": search.order.scene,
        "title": search.planner.base["title"],
        "wanted": judge.wanted,
        "host": judge.host,
        "limit": judge.limit,
        "not_seen": search.planner.list_not_seen(),
        "quantities": list_axes(search),
        "points": len(verdicts),
        "grid": (search.mesh.size + 1) ** 2,
        "verdicts": {name: tally[name] for name in VERDICTS},
        "parts": {
            name: list(search.mesh.measure(search.known, number))
            for number, name in enumerate(VERDICTS)
            if tally[name]
        },
        "right_by_audits_only": sum(verdict.audited for verdict in right),
        "largest_error_of_right": max((v.error for v in right if not v.audited), default=None),
        "refusals": list_reasons([v for v in verdicts.values() if v.verdict == "refused"]),
        "without_solution": list_reasons([v for v in right if v.reason]),
        "bad": [
            _describe_point(search, judge, point, verdicts[point])
            for point in sorted(verdicts)
            if verdicts[point].verdict in BAD
        ],
        "time": {"ran": search.ran, "wall": search.wall},
    }


def _describe_point(search: Search, judge: PointJudge, point: Point, verdict: Verdict) -> dict:
    """Return what is known of one point."""
    return {
        "values": list(search.values(point)),
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "command": make_command(search, judge, point),
    }


def make_command(search: Search, judge: PointJudge, point: Point) -> str:
    """Return the command that runs one point alone; with a host, the one that maps it alone."""
    values = search.values(point)
    if not judge.host:
        stop = float(search.planner.times[-1])
        return shlex.join(search.planner.make_command(values, stop))
    words = ["dockloop", "map", search.planner.scene_reference, "--host", judge.host]
    for letter, axis, value in zip("xy", search.order.axes, values, strict=True):
        words += [f"--{letter}", axis.name, repr(value), repr(value * (1.0 + 1e-9))]
    return shlex.join([*words, "--points", "3"])


def describe_map(summary: dict) -> str:
    """Say a summary in words and numbers."""
    lines = [f"{summary['scene']}: {summary['title']}"]
    lines += [f"  {text}" for text in summary["not_seen"]]
    for quantity in summary["quantities"]:
        lines.append(f"  {_describe_axis(quantity)}")
    tally = {name: count for name, count in summary["verdicts"].items() if count}
    text = ", ".join(f"{count} {name}" for name, count in tally.items())
    lines.append(f"  points       {summary['points']}: {text} (error up to {summary['wanted']:g})")
    for name, (part, unsure) in summary["parts"].items():
        lines.append(f"  {name:12} {part:.1%} +- {unsure:.1%} of the plane")
    lines += [
        f"  {bad['verdict']}: {bad['reason']}\n    {bad['command']}" for bad in summary["bad"]
    ]
    lines.append(f"  files        {', '.join(summary['files'])}")
    return "\n".join(lines)


def _describe_axis(quantity: dict) -> str:
    unit = f" {quantity['unit']}" if quantity["unit"] not in ("", "1") else ""
    scale = "equal ratios" if quantity["log"] else "equal differences"
    ends = f"{quantity['low']:g} to {quantity['high']:g}{unit}"
    return f"{quantity['name']}: {ends}, in {scale}"


def write_map(search: Search, judge: PointJudge, summary: dict, folder: Path) -> list[Path]:
    """Write page and table; returns the files. Raises DockloopError: one cannot be written."""
    names = [axis.name for axis in search.order.axes]
    rows = []
    for number, point in enumerate(sorted(search.runs), 1):
        verdict = read_verdict(search, point)
        figures = [_plain(getattr(verdict, name)) for name in NUMBERS]
        row = [verdict.verdict, one_line(verdict.reason), verdict.audited, *figures]
        rows.append([number, *search.values(point), *row, make_command(search, judge, point)])
    columns = ["point", *names, "verdict", "reason", "audited", *NUMBERS, "command"]
    page, table = folder / "map.md", folder / "points.csv"
    write_csv(table, KINDS[table.name], columns, rows)
    write_text(page, KINDS[page.name], _make_page(search, summary))
    return [page, table]


def _plain(value: float) -> str:
    return "" if isinstance(value, float) and math.isnan(value) else f"{value:.6g}"


def _make_page(search: Search, summary: dict) -> str:
    """Return the page."""
    x, y = summary["quantities"]
    lines = [
        f"{_TITLE}{x['name']} and {y['name']}",
        "",
        f"{summary['title']}. Written by",
        "",
        "```sh",
        summary["command"],
        "```",
        "",
        f"![verdicts and cost over {x['name']} and {y['name']}](map.png)",
        "",
        f"* {_describe_axis(x)}.",
        f"* {_describe_axis(y)}.",
        f"* Right: error up to {summary['wanted']:g} of the tight run. `scripts/README.md` defines"
        " all verdicts.",
        f"* {summary['points']} points; a grid as fine as the refined parts has"
        f" {summary['grid']}. `points.csv` has all points with their commands.",
        "",
        "| verdict | points | part of the plane |",
        "|---|---|---|",
    ]
    for name, (part, unsure) in summary["parts"].items():
        lines.append(f"| {name} | {summary['verdicts'][name]} | {part:.1%} ± {unsure:.1%} |")
    lines += ["", "## Coarse points", ""]
    lines += _make_grid(search)
    for title, rows in (
        ("Refused", summary["refusals"]),
        ("Right by audits, without a reference solution", summary["without_solution"]),
    ):
        if rows:
            lines += ["", f"## {title}", "", "| points | reason, for example |", "|---|---|"]
            lines += [f"| {row['count']} | {_cell(row['example'])} |" for row in rows]
    if summary["bad"]:
        lines += ["", "## Not right", ""]
        for bad in summary["bad"][:_MOST_LISTED]:
            lines.append(f"* {bad['verdict']}: {_cell(bad['reason'])}")
            lines.append(f"  `{bad['command']}`")
        if len(summary["bad"]) > _MOST_LISTED:
            lines.append(f"* ... of {len(summary['bad'])}; all are in `points.csv`.")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _make_grid(search: Search) -> list[str]:
    """Return the table of the coarse points: verdict, error, evaluations."""
    size = search.mesh.size
    places = range(0, size + 1, max(1, size // 8))
    x, y = search.planner.quantities
    heads = [f"{search.values((i, 0))[0]:.2g}" for i in places]
    lines = [f"| {y.name} \\ {x.name} | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
    for j in reversed(places):
        cells = [_describe_cell(search, (i, j)) for i in places]
        lines.append(f"| {search.values((0, j))[1]:.2g} | {' | '.join(cells)} |")
    return [
        *lines,
        "",
        "Each cell: verdict (nothing: right; audits: right by audits only), error, evaluations.",
    ]


def _describe_cell(search: Search, point: Point) -> str:
    if point not in search.runs:
        return ""
    verdict = read_verdict(search, point)
    words = [] if verdict.verdict == "right" else [verdict.verdict]
    words += ["audits"] if verdict.verdict == "right" and verdict.audited else []
    if verdict.verdict != "refused" and not math.isnan(verdict.error):
        words.append(f"{verdict.error:.0e}")
    if verdict.evaluations:
        words.append(f"{verdict.evaluations:.1e}".replace("e+0", "e"))
    return ", ".join(words)


def draw_map(search: Search) -> Any:
    """Draw verdicts and cost over both quantities; returns a ``matplotlib.figure.Figure``."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.9), layout="constrained", dpi=80)
    verdicts, costs = figure.subplots(1, 2, sharey=True)
    _draw_verdicts(verdicts, search)
    _draw_costs(figure, costs, search)
    for axis in (verdicts, costs):
        set_axes(axis, search)
        axis.label_outer()
    figure.suptitle(search.planner.base["title"], fontsize="medium")
    return figure


def _draw_verdicts(axis: Any, search: Search) -> None:
    """Draw cells in the colour of their verdict, white where their corners differ; and points."""
    from matplotlib.collections import PolyCollection

    outlines, colours = [], []
    for cell in search.mesh.cells:
        outlines.append([search.values(point) for point in list_outline(cell)])
        names = {read_verdict(search, corner).verdict for corner in search.mesh.corners(cell)}
        colours.append(VERDICT_COLOURS[names.pop() if len(names) == 1 else "mixed"])
    axis.add_collection(PolyCollection(outlines, facecolors=colours, edgecolors="0.9"))
    for (name, colour), marker in zip(VERDICT_COLOURS.items(), MARKERS, strict=False):
        chosen = [search.values(p) for p in search.runs if read_verdict(search, p).verdict == name]
        if chosen:
            axis.plot(*zip(*chosen, strict=True), marker, color=colour, markeredgecolor="0.3",
                      markeredgewidth=0.3, markersize=3.5, clip_on=False,
                      label=f"{name}: {len(chosen)}")  # fmt: skip
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize="x-small")


def _draw_costs(figure: Any, axis: Any, search: Search) -> None:
    """Draw the evaluations of all runs."""
    from matplotlib.colors import LogNorm

    rows = [
        (*search.values(point), verdict.evaluations)
        for point in search.runs
        if (verdict := read_verdict(search, point)).evaluations
    ]
    if rows:
        x, y, cost = zip(*rows, strict=True)
        drawn = axis.scatter(x, y, c=cost, s=14, norm=LogNorm(), cmap="viridis", clip_on=False)
        figure.colorbar(drawn, ax=axis, label="evaluations")
