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

from dockloop.base.errors import one_line
from dockloop.base.files import (
    MADE_BY,
    figure_kind,
    json_kind,
    plain,
    table_kind,
    write_csv,
    write_text,
)
from dockloop.base.palette import MARKERS, VERDICT_COLOURS
from dockloop.base.sections import FACTS, Section, list_files, write_markdown
from dockloop.runs.judging import BAD, NUMBERS, VERDICTS, Verdict, list_reasons, report_reasons
from dockloop.studies.envelopes.mesh import Point
from dockloop.studies.envelopes.report import list_axes, list_outline, set_axes
from dockloop.studies.envelopes.search import Search
from dockloop.studies.maps.verdicts import PointJudge, read_verdict
from dockloop.sweeps.assured import COLUMNS, list_cells, summarise_cases
from dockloop.sweeps.assured import list_facts as list_assured
from dockloop.sweeps.journal import journal_kind

COMMAND = "dockloop map"
_TITLE = "Map: "
KINDS = {  # of the files in the folder of a map
    "map.md": table_kind("page", COMMAND, f"# {_TITLE}"),
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
    cells = (
        (number, *list_cells(verdicts[point].assured))
        for number, point in enumerate(sorted(verdicts), 1)
    )
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
        **(summarise_cases(cells) if judge.assured else {}),
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
        words = search.planner.make_command(values, stop)
        return shlex.join([*words, *(["--assured"] if judge.assured else [])])
    words = ["dockloop", "map", search.planner.scene_reference, "--host", judge.host]
    for letter, axis, value in zip("xy", search.order.axes, values, strict=True):
        words += [f"--{letter}", axis.name, repr(value), repr(value * (1.0 + 1e-9))]
    return shlex.join([*words, "--points", "3"])


def report_map(summary: dict) -> list[Section]:
    """Return the report of a map; `summary` is that of `summarise_map`."""
    tally = ", ".join(f"{count} {name}" for name, count in summary["verdicts"].items() if count)
    facts = [
        ("points", f"{summary['points']}: {tally} (error up to {summary['wanted']:g})"),
        *list_assured(summary),
        *list_files(summary.get("files", ())),
    ]
    parts = (
        (name, summary["verdicts"][name], f"{part:.1%} ± {unsure:.1%}")
        for name, (part, unsure) in summary["parts"].items()
    )
    bad = [(f"{point['verdict']}: {point['reason']}", point["command"]) for point in summary["bad"]]
    return [
        Section(f"{summary['scene']}: {summary['title']}", table=[FACTS, *facts],
                points=[*summary["not_seen"], *map(_describe_axis, summary["quantities"])]),
        Section("Verdicts", table=[("verdict", "points", "part of the plane"), *parts]),
        Section("Not right", commands=bad),
    ]  # fmt: skip


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
        figures = [plain(getattr(verdict, name)) for name in NUMBERS]
        row = [verdict.verdict, one_line(verdict.reason), verdict.audited, *figures]
        row += list_cells(verdict.assured) if judge.assured else []
        rows.append([number, *search.values(point), *row, make_command(search, judge, point)])
    columns = ["point", *names, "verdict", "reason", "audited", *NUMBERS]
    columns += [*COLUMNS, "command"] if judge.assured else ["command"]
    page, table = folder / "map.md", folder / "points.csv"
    write_csv(table, KINDS[table.name], columns, rows)
    write_text(page, KINDS[page.name], write_markdown(complete_report(search, summary)))
    return [page, table]


def complete_report(search: Search, summary: dict) -> list[Section]:
    """Return the report of a map as its page has it."""
    x, y = summary["quantities"]
    head, verdicts, bad = report_map(summary)
    head.title = f"{_TITLE}{x['name']} and {y['name']}"
    head.text = f"{summary['title']}."
    head.table = ()
    head.points = [
        *(f"{point}." for point in head.points),
        f"Right: error up to {summary['wanted']:g} of the tight run. `scripts/README.md` defines"
        " all verdicts.",
        f"{summary['points']} points; a grid as fine as the refined parts has {summary['grid']}."
        " `points.csv` has all points with their commands.",
    ]
    head.commands = [("Writes this page", summary["command"])]
    head.figures = [Path("map.png")]
    if len(bad.commands) > _MOST_LISTED:
        bad.text = f"The first {_MOST_LISTED} of {len(bad.commands)}; all are in `points.csv`."
        bad.commands = bad.commands[:_MOST_LISTED]
    text = "Each cell: verdict (nothing: right; audits: right by audits only), error, evaluations."
    return [
        head,
        verdicts,
        Section("Coarse points", text, _make_grid(search)),
        *report_reasons(summary, "points"),
        bad,
    ]


def _make_grid(search: Search) -> list[list[str]]:
    """Return the table of the coarse points: verdict, error, evaluations."""
    size = search.mesh.size
    places = range(0, size + 1, max(1, size // 8))
    x, y = search.planner.quantities
    heads = [f"{y.name} \\ {x.name}", *(f"{search.values((i, 0))[0]:.2g}" for i in places)]
    return [
        heads,
        *(
            [
                f"{search.values((0, j))[1]:.2g}",
                *(_describe_cell(search, (i, j)) for i in places),
            ]
            for j in reversed(places)
        ),
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
