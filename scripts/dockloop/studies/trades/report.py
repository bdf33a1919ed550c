"""What the measurements say: Pareto front, recommendation in words, tables, figure.

Cost is the time ratio where settings are compared with each other: evaluations of one level of the
model cost something else than those of another. Where two settings take the same steps, evaluations
are the steadier figure; the front by evaluations is marked too.
"""

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from dockloop.base.figures import can_draw, save_figure
from dockloop.base.files import figure_kind, plain, table_kind, write_csv, write_text
from dockloop.base.palette import LINES
from dockloop.base.sections import FACTS, Section, list_files, write_markdown
from dockloop.native.core import name_choice
from dockloop.result.run_errors import describe_scale
from dockloop.studies.trades import Trade
from dockloop.studies.trades.columns import AUDITS, COSTS, ERRORS, FIGURES
from dockloop.sweeps.journal import journal_kind

WANTED = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
_PAYS = 1.25  # times the cheapest: less is within what timing can resolve
_FIELDS = ("setting", "level", "method", "dae_form", "rtol", "inner_step", "step")
_COLUMNS = (*_FIELDS, "status", "reason", *FIGURES, "front_by_evaluations", "front_by_time")
_COMMAND = "dockloop trade"
_TITLE = "Speed against accuracy: "
KINDS = {  # of the files in the folder of a trade
    "trade.csv": table_kind("table", _COMMAND, ",".join((*_FIELDS, "status", "reason", ""))),
    "trade.md": table_kind("page", _COMMAND, f"# {_TITLE}"),
    "work_precision.png": figure_kind(_COMMAND),
    "trade.jsonl": journal_kind("trade"),
}
_TABLE = (*ERRORS, *AUDITS, "evaluations", "steps", "time_ratio")  # of the page
_FRAMES = {"relative": "P seen from A", "ring": "the ring"}


def find_front(rows: list[dict], cost: str) -> list[dict]:
    """Return the rows that no other row beats in both cost and error, the cheapest first."""
    front: list[dict] = []
    for row in sorted(_usable(rows), key=lambda row: (row[cost], row["error"])):
        if not front or row["error"] < front[-1]["error"]:
            front.append(row)
    return front


def recommend(rows: list[dict], wanted: float, cost: str = "time_ratio") -> dict | None:
    """Return the cheapest row whose error is at most `wanted`; None if there is none."""
    good = [row for row in find_front(rows, cost) if row["error"] <= wanted]
    return good[0] if good else None


def summarise_trade(trade: Trade, command: str) -> dict:
    """Return the whole report: recommendation, levels, what does not pay, and the rows."""
    rows, scales = trade.rows, trade.about["scales"]
    for name, cost in (("front_by_evaluations", "evaluations"), ("front_by_time", "time_ratio")):
        front = find_front(rows, cost)
        for row in rows:
            row[name] = row in front
    frame = _FRAMES[trade.about["frame"]]
    return {
        **trade.about,
        "command": command,
        "definitions": {
            name: text.format(frame=frame) for name, text in (ERRORS | AUDITS | COSTS).items()
        },
        "error_is_the_worst_of": [_scale_sentence(name, scale) for name, scale in scales.items()],
        "recommendations": _make_recommendations(rows, trade.about["truth"]["error"]),
        "levels": _describe_levels(rows),
        "does_not_pay": _describe_losers(rows),
        "refused": _describe_refused(rows),
        "other_outcome": [row["setting"] for row in rows if row["outcome_matches"] is False],
        "rows": rows,
    }


def report_trade(summary: dict) -> list[Section]:
    """Return the report of a trade; `summary` is that of `summarise_trade`."""
    done = sum(row["status"] == "done" for row in summary["rows"])
    solution, applied = summary["truth"], summary.get("applied")
    doubt = "" if solution["error"] is None else f"; good to {solution['error']:.0e}"
    facts = [
        ("settings", f"{done} of {len(summary['rows'])} ran; default: {summary['default']}"),
        ("compared", f"with the reference solution: {solution['source']}{doubt}"),
        *([("not seen", summary["not_seen"])] if summary.get("not_seen") else []),
        *([("applied", f"{applied['file']} has: {applied['setting']}")] if applied else []),
        *list_files(summary.get("files", ())),
    ]
    others = (
        f"other outcome than the reference solution: {name}" for name in summary["other_outcome"]
    )
    verdicts = [*summary["levels"], *summary["does_not_pay"], *summary["refused"], *others]
    return [
        Section(f"{summary['title']}, {summary['stop']:g} s", table=[FACTS, *facts]),
        Section("What to use", points=[row["sentence"] for row in summary["recommendations"]]),
        Section("What it costs to do otherwise", points=verdicts),
    ]


def write_trade(summary: dict, folder: Path) -> list[Path]:
    """Write trade.csv, trade.md and, if it can be drawn, work_precision.png; returns the files.

    Raises:
        DockloopError: one cannot be written.
    """
    table, page = folder / "trade.csv", folder / "trade.md"
    rows = sorted(summary["rows"], key=_by_cost)
    drawn = [folder / "work_precision.png"] if can_draw() else []
    cells = ([plain(row[name]) for name in _COLUMNS] for row in rows)
    write_csv(table, KINDS[table.name], _COLUMNS, cells)
    write_text(page, KINDS[page.name], write_markdown(complete_report(summary, rows, drawn)))
    for path in drawn:
        _plot(summary, path)
    return [table, page, *drawn]


def _usable(rows: Iterable[dict]) -> list[dict]:
    return [row for row in rows if row["status"] == "done" and row["error"] is not None]


def _by_cost(row: dict) -> tuple:
    """Sort by evaluations, which are the same everywhere; what did not run comes last."""
    return (row["evaluations"] is None, row["evaluations"] or 0, row["setting"])


def _make_recommendations(rows: list[dict], doubt: float | None) -> list[dict]:
    found = []
    for wanted in WANTED:
        best = recommend(rows, wanted)
        entry = {"wanted": wanted, "best": None, "by_step": {}}
        if doubt is not None and doubt > wanted:
            entry["sentence"] = (
                f"for {wanted:.0e}: the reference solution itself is good to {doubt:.0e} only"
            )
        elif best is None:
            entry["sentence"] = f"for {wanted:.0e}: no setting of the grid reaches it"
        else:
            entry["best"] = _short(best)
            entry["sentence"] = f"for {wanted:.0e} use {_price(best)}"
            fewest = recommend(rows, wanted, "evaluations")
            if fewest is not best:
                entry["fewest_evaluations"] = _short(fewest)
                entry["sentence"] += f"; fewest evaluations: {_price(fewest)}"
            for step in sorted({row["step"] for row in rows}):
                at_step = recommend([row for row in rows if row["step"] == step], wanted)
                entry["by_step"][f"{step:g}"] = _short(at_step) if at_step else None
        found.append(entry)
    return found


def _price(row: dict) -> str:
    return (
        f"{row['setting']}: {_spaced(row['evaluations'])} evaluations,"
        f" {row['time_ratio']:.2g} times the time of the default, error {row['error']:.1e}"
    )


def _short(row: dict) -> dict:
    names = ("setting", "scheme", "error", "evaluations", "time_ratio", "options")
    return {name: row[name] for name in names}


def _describe_levels(rows: list[dict]) -> list[str]:
    """Say of each level of the model how wrong it is at best, and what that costs."""
    sentences = []
    for level in sorted({row["level"] for row in rows if row["level"] is not None}):
        own = _usable(row for row in rows if row["level"] == level)
        name = name_choice("model.level", level)
        if not own:
            sentences.append(
                f"level {name}: no setting of it ran to the outcome of the reference solution"
            )
            continue
        best = min(own, key=lambda row: row["error"])
        enough = recommend(own, 2.0 * best["error"])
        sentences.append(
            f"level {name}: error {best['error']:.1e} at best; cheapest setting within twice that:"
            f" {_price(enough)}"
        )
    return sentences


def _describe_losers(rows: list[dict]) -> list[str]:
    """Say which schemes are never the cheapest, at any wanted error and communication step."""
    sentences = []
    for scheme in dict.fromkeys(row["scheme"] for row in rows if not row["is_default"]):
        own = _usable(row for row in rows if row["scheme"] == scheme)
        offers = []
        for wanted in WANTED:
            for step in {row["step"] for row in own}:
                at_step = [row for row in rows if row["step"] == step]
                mine = recommend([row for row in own if row["step"] == step], wanted)
                if mine:
                    best = recommend(at_step, wanted)
                    offers.append((mine["time_ratio"] / best["time_ratio"], wanted, step))
        if own and not offers:
            least = min(row["error"] for row in own)
            sentences.append(f"does not pay: {scheme}, error {least:.1e} at best")
        elif offers and min(offers)[0] > _PAYS:
            ratio, wanted, step = min(offers)
            sentences.append(
                f"does not pay: {scheme}, at best {ratio:.2g} times the time of the cheapest"
                f" (for {wanted:.0e}, step {step:g} s)"
            )
    return sentences


def _describe_refused(rows: list[dict]) -> list[str]:
    """Say once of each scheme why it did not run."""
    reasons: dict[tuple, list[dict]] = {}
    for row in rows:
        if row["status"] != "done":
            reasons.setdefault((row["scheme"], row["status"], row["reason"]), []).append(row)
    return [
        f"{status}: {scheme} (settings: {len(those)}): {reason}"
        for (scheme, status, reason), those in reasons.items()
    ]


def _scale_sentence(name: str, scale: float) -> str:
    unit, what = describe_scale(name)
    return f"{name} / {scale:.4g} {unit} ({what})"


def _cell(name: str, value: Any) -> Any:
    """Return a value for the table of the page."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "**no**"
    if name in ("evaluations", "steps"):
        return _spaced(value)
    return f"{value:.2f}" if name == "time_ratio" else f"{value:.1e}"


def _spaced(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def complete_report(summary: dict, rows: list[dict], figures: list[Path]) -> list[Section]:
    """Return the report of a trade as its page has it."""
    head, use, otherwise = report_trade(summary)
    head.title = f"{_TITLE}{summary['title']}"
    head.text = f"Made by `{summary['command']}`: {summary['stop']:g} s, {len(rows)} settings."
    head.figures = figures
    meanings = ((f"`{name}`", text) for name, text in summary["definitions"].items())
    return [
        head,
        use,
        *_report_steps(summary, sorted({row["step"] for row in rows})),
        otherwise,
        Section("What the columns are", table=[("column", "meaning"), *meanings]),
        Section(
            "The error is the worst of",
            f"Every run is compared with the reference solution each {summary['interval']:g} s,"
            " between its communication points by shorter steps that are taken back. A tolerance is"
            " `solver.rtol`; the absolute ones keep the ratio to it that they have in the scene.",
            points=summary["error_is_the_worst_of"],
        ),
        _list_settings(rows),
    ]


def _report_steps(summary: dict, steps: list[float]) -> list[Section]:
    """Return the cheapest setting for each communication step, and options of the best ones."""
    reported = [entry for entry in summary["recommendations"] if entry["best"]]

    def describe(best: dict | None) -> str:
        name = best["setting"].rpartition(", ")[0] if best else "-"
        price = f" ({_spaced(best['evaluations'])}, {best['time_ratio']:.2g})" if best else ""
        return f"{name}{price}"

    table = (
        (f"{entry['wanted']:.0e}", *(describe(entry["by_step"][f"{step:g}"]) for step in steps))
        for entry in reported
    )
    by_options: dict[str, list[str]] = {}
    for entry in reported:
        by_options.setdefault(entry["best"]["options"], []).append(f"{entry['wanted']:.0e}")
    commands = [(", ".join(wanted), options) for options, wanted in by_options.items()]
    heads = ("wanted error", *(f"step {step:g} s" for step in steps))
    title = "The cheapest setting for each communication step (evaluations, time ratio)"
    return [
        Section(title, table=[heads, *table]),
        Section("The recommended ones as options of `dockloop run`", commands=commands),
    ]


def _list_settings(rows: list[dict]) -> Section:
    """Return the table of all settings."""
    shown = [name for name in _TABLE if any(row[name] is not None for row in rows)]
    cells = []
    for row in rows:
        name = f"**{row['setting']}**" if row["front_by_time"] else row["setting"]
        name += " (default)" if row["is_default"] else ""
        name += "" if row["status"] == "done" else f" ({row['status']})"
        cells.append((name, *(_cell(column, row[column]) for column in shown)))
    heads = ("setting", *(name.replace("_", " ") for name in shown))
    text = "Sorted by evaluations; **bold**: on the Pareto front by time."
    return Section("All settings", text, [heads, *cells])


def _plot(summary: dict, path: Path) -> None:
    """Draw error against evaluations and against time, one line per scheme and step."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    rows = [row for row in _usable(summary["rows"]) if row["error"] > 0.0]
    schemes = list(dict.fromkeys(row["scheme"] for row in rows))
    steps = sorted({row["step"] for row in rows})
    styles = {step: ("-o", "--s", ":^", "-.v")[i % 4] for i, step in enumerate(steps)}
    colours = dict(zip(schemes, itertools.cycle(LINES), strict=False))
    figure = Figure(figsize=(12, 6), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for axis, cost in zip(axes, ("evaluations", "time_ratio"), strict=True):
        for scheme in schemes:
            for step in steps:
                line = [row for row in rows if (row["scheme"], row["step"]) == (scheme, step)]
                line.sort(key=lambda row: (row["rtol"] or 0.0, row["inner_step"] or 0.0))
                x, y = [row[cost] for row in line], [row["error"] for row in line]
                colour = colours[scheme]
                axis.loglog(x, y, styles[step], color=colour, markersize=4, linewidth=0.9)
        default = next(row for row in summary["rows"] if row["is_default"])
        if default in rows:
            axis.plot(default[cost], default["error"], "*", color="black", markersize=12)
        front = [row for row in find_front(summary["rows"], cost) if row["error"] > 0.0]
        x, y = [row[cost] for row in front], [row["error"] for row in front]
        axis.step(x, y, where="post", color="black", linewidth=0.8)
        axis.plot(x, y, "o", color="black", markersize=9, fillstyle="none")
        axis.grid(alpha=0.3)
    axes[0].set_xlabel("evaluations")
    axes[1].set_xlabel("processor time over that of the default setting")
    axes[0].set_ylabel("error")
    entries = [Line2D([], [], color=colours[scheme], label=scheme) for scheme in schemes]
    entries += [
        Line2D(
            [], [], color="0.4", linestyle=style[:-1], marker=style[-1], label=f"step {step:g} s"
        )
        for step, style in styles.items()
    ]
    entries += [
        Line2D([], [], color="black", marker="o", fillstyle="none", label="Pareto front"),
        Line2D([], [], color="black", linestyle="", marker="*", label="default setting"),
    ]
    figure.legend(handles=entries, loc="outside right upper", fontsize="small")
    figure.suptitle(f"{summary['title']}, {summary['stop']:g} s", fontsize="medium")
    save_figure(figure, path, _COMMAND)
