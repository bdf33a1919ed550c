"""One HTML page about a run, a sweep or an envelope: self-contained, opens offline.

The page says in words what was run, and shows tables and the figures that the command draws. Each
part is a `Section`; `report.html` is the template. `influence` ranks the inputs of a sweep.
"""

import base64
import json
import platform
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from dockloop import __version__
from dockloop.columns import say_number
from dockloop.core import list_limits, name_choice, number_choice
from dockloop.errors import DockloopError
from dockloop.influence import Influence, can_rank, find_cut, find_influence
from dockloop.outputs import Kind, read_head, writing
from dockloop.peaks import count_steps, name_step, say_place
from dockloop.sampling import say_accuracy
from dockloop.summary import describe
from dockloop.sweep_report import (
    count_texts,
    has_captured,
    is_text,
    list_worst,
    read_numbers,
    read_steps,
    read_worst,
    say_steps,
)

_WORST = 10  # cases in a list
_LEAST_SCORE = 0.5  # of a prediction whose ranking can be trusted
_SURE = 0.05  # p-value of a threshold
_SHARES = (
    "Share: the part of the variance that goes with this input, alone and together with others"
    " (total Sobol index), with its 95 % interval. Shares may add up to more than 1. An input whose"
    " interval begins at 0 may have no influence. Rank correlation: whether the outcome rises or"
    " falls with the input."
)
Rows = list[list[str]]


@dataclass
class Section:
    """A part of a page.

    Attributes:
        title: heading.
        text: a paragraph; empty: none.
        columns: headings of the table.
        rows: of the table, as text; empty: no table.
        figures: PNG files.
        commands: lines for a terminal, each with a remark.
        links: pages that show the motion, by remark.
    """

    title: str
    text: str = ""
    columns: Sequence[str] = ()
    rows: Rows = field(default_factory=list)
    figures: Sequence[Path] = ()
    commands: Sequence[tuple[str, str]] = ()
    links: Mapping[str, Path] = field(default_factory=dict)


def page_kind(command: str) -> Kind:
    """Return the kind of the page of a command."""
    return Kind("report", command, lambda path: read_head(path).startswith(_begin(command)))


def find_page(result: Path) -> Path:
    """Return where the page next to a result or a table is: ``own_report.html``."""
    return result.with_name(f"{result.stem}_report.html")


def write_page(path: Path, command: str, title: str, sections: Iterable[Section]) -> None:
    """Write a page. Raises DockloopError: it cannot be written."""
    import jinja2

    template = files("dockloop").joinpath("report.html").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters["embed"] = _embed
    text = environment.from_string(template).render(
        title=title, sections=list(sections), version=__version__, command=command
    )
    with writing(path, page_kind(command)) as partial:
        partial.write_bytes(_begin(command) + text.encode())


def _begin(command: str) -> bytes:
    return f"<!doctype html>\n<!-- made by {command} -->\n".encode()


def _embed(figure: Path) -> str:
    """Return a PNG file as a data address."""
    return "data:image/png;base64," + base64.b64encode(figure.read_bytes()).decode()


# ---------------------------------------------------------------- what all pages have


def describe_scene(document: dict, varied: Iterable[str] = ()) -> Section:
    """Say in words what is modelled.

    Args:
        document: the resolved scene.
        varied: names of the quantities that vary.
    """
    text, rows = document["title"], []
    if names := ", ".join(varied):
        text += f". Here with the values of the scene, but varied: {names}."
    for name in ("chaser", "target"):
        if name in document:
            vehicle = document[name]
            rows.append([name, f"{vehicle['motion']}, {vehicle['mass']:g} kg"])
    rows.append(["mechanism", document["mechanism"]["name"]])
    rows.append(["level", document.get("model", {}).get("level", "reduced")])
    initial = document["initial"]
    if initial["at"] == "first_contact":
        lateral, tilt = np.hypot(*initial["lateral"]), np.hypot(*initial["tilt"])
        rows.append(
            [
                "at first contact",
                f"closing at {initial['closing_speed']:g} m/s, {lateral:.3g} m across the docking"
                f" axis, tilted by {np.degrees(tilt):.3g} deg, rolled by"
                f" {np.degrees(initial['roll']):.3g} deg",
            ]
        )
    rated = document["mechanism"].get("limits", {})
    loads = [f"{load} {value:g}" for load, value in rated.items() if isinstance(value, int | float)]
    if loads:
        rows.append(["rated loads", ", ".join(loads) + " (N, N m)"])
    return Section("The scene", text, ("what", "is"), rows)


def describe_settings(
    document: dict,
    more: Sequence[list[str]] = (),
    experiment: Mapping[str, Any] = MappingProxyType({}),
) -> Section:
    """List solver, experiment and versions.

    Args:
        document: the resolved scene.
        more: rows that come first.
        experiment: what the experiment has otherwise than the scene.
    """
    solver = {"method": number_choice("solver.method", "auto")} | document["solver"]
    solver["method"] = name_choice("solver.method", solver["method"])
    rows = [[f"solver.{name}", str(value)] for name, value in solver.items()]
    rows += [
        [f"experiment.{name}", str(v)]
        for name, v in {**document["experiment"], **experiment}.items()
    ]
    rows += [["dockloop", __version__], ["python", platform.python_version()]]
    for package in ("numpy", "scipy", "fmpy"):
        try:
            rows.append([package, version(package)])
        except PackageNotFoundError:
            continue
    return Section("Settings and versions", columns=("what", "value"), rows=[*more, *rows])


def list_peaks(loads: dict, keys: Sequence[str]) -> Rows:
    """Return rows of a table of peak loads: values by `keys`, unit, rated load, part, place.

    The part is that of the rated load, or of the cases above the rated load.
    """
    rows = []
    for name, load in loads.items():
        row = [name, *(say_number(load[key]) for key in keys), load["unit"]]
        rated, part = load.get("rated"), load.get("above_rated", load.get("ratio"))
        ends = ["", ""] if rated is None else [say_number(rated), f"{part:.1%}"]
        rows.append([*row, *ends, say_steps(load["steps"]) if "steps" in load else say_place(load)])
    return rows


# ---------------------------------------------------------------- one run


def report_run(
    summary: dict, figures: Sequence[Path], command: Sequence[str], view: Path | None = None
) -> list[Section]:
    """Return the parts of the page of a run.

    Args:
        summary: of `summarise`.
        figures: PNG files of the run.
        command: words that repeat it.
        view: page with its motion.
    """
    sections = [Section("Outcome", describe(summary).split("\n")[1].strip())]
    remark = "The same run again"
    sections[0].commands = [(remark, shlex.join(command))]
    sections[0].links = {remark: view} if view else {}
    if "outcome" in summary:
        keys = ("outcome", "phase", "time_of_contact", "time_of_capture", "explanation")
        sections[0].columns = ("what", "is")
        sections[0].rows = [[_title(key), _say(summary.get(key))] for key in keys]
    if summary.get("limits"):
        columns = ("limit", "first at [s]", "value", "unit", "meaning")
        keys = ("name", "time", "value", "unit", "sentence")
        rows = [[_say(limit[key]) for key in keys] for limit in summary["limits"]]
        sections.append(Section("Limits passed", columns=columns, rows=rows))
    if "peak_loads" in summary:
        heads = ("load", "peak", "unit", "rated", "of it", "where")
        rows = list_peaks(summary["peak_loads"], ["value"])
        sections.append(
            Section("Peak loads on the target", "True peaks over inner steps.", heads, rows)
        )
    sections += [_show(figure) for figure in figures]
    if "energy" in summary:
        energy = [[name.replace("_", " "), _say(v)] for name, v in summary["energy"].items()]
        sections.append(Section("Energy [J]", columns=("what", "is"), rows=energy))
    model = summary["model"]
    sections += [describe_scene(model), describe_settings(model)]
    return sections


# ---------------------------------------------------------------- a sweep


def report_sweep(
    summary: dict,
    sweep: Any,
    planner: Any,
    table: Any,
    figures: Sequence[Path],
    *,
    views: Mapping[int, Path],
) -> list[Section]:
    """Return the parts of the page of a sweep.

    Args:
        summary: of `summarise_sweep`.
        sweep: what was to be done.
        planner: how it was done.
        table: of `make_table`, or its file.
        figures: PNG files of the sweep.
        views: pages with the motion of cases, by row of the table.
    """
    status = ", ".join(f"{count} {name}" for name, count in summary["status"].items())
    text = f"{summary['cases']} cases: {status}."
    if "captured" in summary:
        part = summary["captured"]
        text += (
            f" Captured: {part['fraction']:.1%} (95 % interval {part['low']:.1%} to"
            f" {part['high']:.1%})."
        )
    text += _say_not_seen(summary)
    outcomes = [[name, str(count)] for name, count in summary.get("outcomes", {}).items()]
    sections = [Section("Outcomes", text, ("outcome", "cases"), outcomes)]
    why: Counter[str] = Counter()
    for name in ("explanation", "reason"):
        for words, count in count_texts(table[name]).items() if name in table.column_names else ():
            if not words.startswith("captured"):
                why[_without_numbers(words)] += count
    if why:
        rows = [[reason, str(count)] for reason, count in why.most_common(_WORST)]
        heads = ("why not captured, or not run", "cases")
        sections.append(Section("Reasons", columns=heads, rows=rows))
    if summary.get("limits"):
        meaning = {limit.name: f"{limit.happened}; {limit.means}" for limit in list_limits()}
        rows = [[name, str(n), meaning[name]] for name, n in summary["limits"].items()]
        sections.append(Section("Limits passed", columns=("limit", "cases", "meaning"), rows=rows))
    if summary["peak_loads"]:
        columns = (
            "load",
            "median",
            "95 %",
            "99 %",
            "largest",
            "unit",
            "rated",
            "cases above",
            "where",
        )
        rows = list_peaks(summary["peak_loads"], ("median", "q95", "q99", "largest"))
        sections.append(Section("Peak loads", columns=columns, rows=rows))
    sections += [_show(figure) for figure in figures]
    sections += _show_passes(summary, sweep, planner, table) if "refined" in summary else []
    sections += _rank_cases(sweep, planner, table, views)
    sections += _rank_inputs(sweep, planner, table)
    varied = [[f"{q.name} [{q.unit}]" if q.unit else q.name, _say_range(table, q.name)]
              for q in planner.varied]  # fmt: skip
    sections.append(Section("What varied", columns=("quantity", "from ... to"), rows=varied))
    more = [["seed", str(summary["seed"])], ["sampling", summary["sampling"]]]
    more += [[f"set {name}", _say(value)] for name, value in sweep.document["set"].items()]
    return [*sections, *_describe_base(planner, more)]


def _describe_base(planner: Any, more: Sequence[list[str]]) -> list[Section]:
    """Return scene and settings of many dockings."""
    return [
        describe_scene(planner.base, (quantity.name for quantity in planner.varied)),
        describe_settings(planner.base, more, planner.experiment),
    ]


def _show_passes(summary: dict, sweep: Any, planner: Any, table: Any) -> list[Section]:
    """Return what the second pass changed, and the cases that end otherwise."""
    found = summary["refined"]
    text = (
        f"All cases ran at accuracy {say_accuracy(found['accuracy'])}. {found['cases']} of them ran"
        f" again at {found['refine_accuracy']:g}: those with {found['refine']}, or with a step that"
        f" failed. {len(found['changed'])} end otherwise. Everything else on this page has their"
        " second results."
    )
    rows = [
        [load, f"{part['median']:.2g}", f"{part['largest']:.2g}", str(part["case"])]
        for load, part in found["peaks"].items()
    ]
    columns = ("peak load", "relative change: median", "largest", "in case")
    commands, ends = [], table["end_time"]
    for change in found["changed"][:_WORST]:
        row = change["case"] - 1
        words = planner.make_command(sweep.cases[row], ends[row].as_py())
        remark = f"case {change['case']}: {change['first']}, then {change['again']}"
        commands.append((remark, shlex.join(words)))
    return [Section("What the second pass changed", text, columns, rows, commands=commands)]


def _rank_cases(sweep: Any, planner: Any, table: Any, views: Mapping[int, Path]) -> list[Section]:
    """Return the worst cases, and those that were not captured, with commands and views."""
    by, numbers = read_worst(sweep, table)
    sections, ends = [], table["end_time"]
    worst = list_worst(numbers, _WORST)
    lost: list[int] = []
    if "outcome" in table.column_names:
        lost = np.flatnonzero(has_captured(table) == 0.0).tolist()
    for title, cases in ((f"Worst cases by {by}", worst), ("Cases not captured", lost[:_WORST])):
        if cases:
            commands: list[tuple[str, str]] = []
            links: dict[str, Path] = {}
            for i in cases:
                words = planner.make_command(sweep.cases[i], ends[i].as_py())
                remark = f"case {i + 1}"
                remark += f", {by} {numbers[i]:.4g}" if len(numbers) else ""
                commands.append((remark, shlex.join(words)))
                links |= {remark: views[i]} if i in views else {}
            sections.append(Section(title, commands=commands, links=links))
    return sections


def _rank_inputs(sweep: Any, planner: Any, table: Any) -> list[Section]:
    """Return which quantity decides about capture, and about the outcome that ranks cases."""
    outcomes = {"capture": has_captured(table)} if "outcome" in table.column_names else {}
    by, values = read_worst(sweep, table)
    outcomes |= {by: values} if len(values) else {}
    parts = [
        part for name, y in outcomes.items() for part in _split_by_step(name, planner, table, y)
    ]
    sections = [_rank_inputs_of(name, planner, table, y) for name, y in parts]
    if first := next((section for section in sections if section.rows), None):
        first.text = f"{_SHARES} {first.text}"
    return sections


def _say_not_seen(summary: dict) -> str:
    return "".join(f" {text[0].upper()}{text[1:]}." for text in summary.get("not_seen", []))


def _split_by_step(
    outcome: str, planner: Any, table: Any, y: np.ndarray
) -> list[tuple[str, np.ndarray]]:
    """Return an outcome as it is, or for every step of the sequence in which its peaks arose.

    Peaks of several steps have several causes: the first contact, or motors long after.
    """
    steps = read_steps(table, outcome)
    found = count_steps(planner.base, steps)
    if len(found) < 2:
        return [(outcome, y)]
    names = np.array([name_step(planner.base, number) for number in steps])
    total = sum(found.values())
    return [
        (
            f"{outcome}, {count} of {total} peaks: in step '{name}'",
            np.where(names == name, y, np.nan),
        )
        for name, count in found.items()
    ]


def _rank_inputs_of(outcome: str, planner: Any, table: Any, y: np.ndarray) -> Section:
    """Return the quantities by their share of the variance of one outcome."""
    from scipy.stats import spearmanr

    section = Section(f"What decides about {outcome}")
    known = np.isfinite(y)
    inputs = {q.name: _read_input(table, q.name)[known] for q in planner.varied}
    inputs = {name: values for name, values in inputs.items() if np.ptp(values) > 0.0}
    if not (inputs and can_rank(y[known])):
        section.text = "Too few cases, or too few that differ, to rank the inputs."
        return section
    try:
        found = find_influence(np.column_stack(list(inputs.values())), y[known])
    except DockloopError as error:
        section.text = f"Not ranked: {error}."
        return section
    pairs = zip(inputs.items(), found.shares, strict=True)
    for (name, values), share in sorted(pairs, key=lambda pair: -pair[1].value):
        rank = "" if is_text(table, name) else f"{spearmanr(values, y[known]).statistic:.2f}"
        interval = f"{share.low:.2f} to {share.high:.2f}"
        section.rows.append([name, f"{share.value:.2f}", interval, rank])
    section.columns = ("input", "share", "95 % interval", "rank correlation")
    section.text = _explain_ranks(found)
    numbers = {name: values for name, values in inputs.items() if not is_text(table, name)}
    if numbers:
        units = {q.name: q.unit for q in planner.varied}
        section.text += f" {say_cut(outcome, numbers, units, y[known])}"
    return section


def _explain_ranks(found: Influence) -> str:
    """Say how far the shares can be trusted."""
    text = (
        f"A Gaussian process through {found.cases} cases predicts {found.score:.0%} of the variance"
        " of cases that are left out; the intervals are wider by the rest."
    )
    if found.score < _LEAST_SCORE:
        text += " This is too little for a sure ranking: more cases may help."
    return text


def say_cut(
    outcome: str, inputs: Mapping[str, np.ndarray], units: Mapping[str, str], y: np.ndarray
) -> str:
    """Say the best threshold of one input, with the outcome on both sides.

    Args:
        outcome: its name.
        inputs: values by name, each of shape (cases,).
        units: of the inputs.
        y: the outcome, shape (cases,); 0 and 1: without and with it.
    """
    cut = find_cut(np.column_stack(list(inputs.values())), y)
    chance = f"p = {cut.probability:.3f} by permutations"
    if cut.probability > _SURE:
        return f"No threshold of one input separates the cases better than chance does ({chance})."
    name = list(inputs)[cut.column]
    above = inputs[name] > cut.value
    where = f"{name} > {cut.value:.3g} {'' if units[name] == '1' else units[name]}".rstrip()
    if set(np.unique(y)) <= {0.0, 1.0}:
        word, met = ("with", y == 1.0) if 2.0 * y.sum() <= len(y) else ("without", y == 0.0)
        found = f"{met.sum()} cases {word} {outcome}: {met[above].sum()} of {above.sum()} where"
        rest = f"{met[~above].sum()} of the other {(~above).sum()}"
    else:
        found = f"mean {outcome}: {y[above].mean():.3g} in the {above.sum()} cases where"
        rest = f"{y[~above].mean():.3g} in the other {(~above).sum()}"
    return f"Best threshold: {found} {where}, {rest} ({chance})."


def _read_input(table: Any, name: str) -> np.ndarray:
    """Return an input as numbers; texts are counted in alphabetical order."""
    if is_text(table, name):
        texts = [str(text) for text in table[name].to_pylist()]
        return np.unique(texts, return_inverse=True)[1].astype(float)
    return read_numbers(table, name)


# ---------------------------------------------------------------- an envelope


def report_envelope(summary: dict, planner: Any, figures: Sequence[Path]) -> list[Section]:
    """Return the parts of the page of an envelope."""
    rows = [
        [c["text"], f"{c['met']:.1%} +- {c['unsure']:.1%}", str(c["boundary_points"])]
        for c in summary["criteria"]
    ]
    text = f"{summary['dockings']} dockings; a grid of the same resolution has {summary['grid']}."
    if (checks := summary["checks"])["points"]:
        text += (
            f" {checks['points']} of them are checks at random away from the boundary;"
            f" {checks['differ']} of these were not as expected."
        )
    text += _say_not_seen(summary)
    columns = ("criterion", "part of the box", "boundary points")
    sections = [Section("Where the criteria are met", text, columns, rows)]
    sections += [_show(figure) for figure in figures]
    axes = [
        [q["name"], f"{q['low']:g} to {q['high']:g} {q['unit']}", say_half_distance(q)]
        for q in summary["quantities"]
    ]
    heads = ("quantity", "range", "boundary within +-")
    sections.append(Section("Quantities", columns=heads, rows=axes))
    for criterion in summary["criteria"]:
        sides = [("met", "met_example"), ("not met", "unmet_example")]
        commands = [(s, criterion[name]["command"]) for s, name in sides if name in criterion]
        if commands:
            sections.append(Section(f"Two sides of: {criterion['text']}", commands=commands))
    reasons = [[r["reason"], str(r["count"])] for r in summary.get("reasons", [])]
    if reasons:
        sections.append(Section("Dockings that did not run", "", ("reason", "dockings"), reasons))
    more = [[f"set {name}", _say(value)] for name, value in summary["set"].items()]
    return [*sections, *_describe_base(planner, more)]


def say_half_distance(quantity: dict) -> str:
    """Say how well a boundary is known along a quantity of a summary."""
    if quantity["log"]:
        return f"{quantity['half_distance']:.1%} of the value"
    unit = "" if quantity["unit"] == "1" else quantity["unit"]
    return f"{quantity['half_distance']:.3g} {unit}".rstrip()


def _show(figure: Path) -> Section:
    """Return the section of a figure, named by the last word of its file."""
    return Section(figure.stem.rsplit("_", 1)[-1].capitalize(), figures=[figure])


def _title(key: str) -> str:
    """Return a member of a summary as words; times have their unit."""
    return key.replace("_", " ") + (" [s]" if key.startswith("time_") else "")


def _say(value: Any) -> str:
    match value:
        case None:
            return "never"
        case float():
            return f"{value:.6g}"
        case str():
            return value
    return json.dumps(value)


def _say_range(table: Any, name: str) -> str:
    if is_text(table, name):
        return ", ".join(sorted(count_texts(table[name])))
    values = read_numbers(table, name)
    return f"{values.min():g} ... {values.max():g}"


def _without_numbers(text: str) -> str:
    """Return a reason without what differs from case to case."""
    return re.sub(r"\d[\d.e+-]*", "...", text)
