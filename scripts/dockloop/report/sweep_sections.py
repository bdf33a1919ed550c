"""The report of a sweep: outcomes, worst cases, which inputs decide (`influence` ranks them)."""

import re
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import DockloopError
from dockloop.base.sections import FACTS, Section, list_files
from dockloop.native.core import list_limits
from dockloop.report.influence import Influence, can_rank, find_cut, find_influence
from dockloop.report.parts import describe_base, list_peaks, say_value, show_figure
from dockloop.report.sweep import read_steps
from dockloop.result.peaks import count_steps, name_step
from dockloop.scene.values import say_accuracy
from dockloop.sweeps.assured import list_facts as list_assured
from dockloop.sweeps.table import (
    count_texts,
    has_captured,
    is_text,
    list_worst,
    read_numbers,
    read_worst,
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


def report_sweep(summary: dict) -> list[Section]:
    """Return the report of a sweep; `summary` is that of `summarise_sweep`."""
    head = Section(f"{summary['sweep']}: {summary['title']}", table=[FACTS, *_list_facts(summary)])
    head.points = [f"{text[0].upper()}{text[1:]}." for text in summary.get("not_seen", [])]
    if worst := summary.get("worst"):
        remark = f"worst case {worst['case']}: {worst['by']} {worst['value']:.4g}; alone:"
        head.commands = [(remark, worst["command"])]
    meaning = {limit.name: f"{limit.happened}; {limit.means}" for limit in list_limits()}
    limits = ((name, n, meaning[name]) for name, n in summary.get("limits", {}).items())
    cases = summary.get("table", [{}])
    names = _shorten(list(cases[0]))
    heads = ("load", "median", "95 %", "99 %", "largest", "unit", "rated", "cases above", "where")
    loads = list_peaks(summary["peak_loads"], ("median", "q95", "q99", "largest"))
    return [
        head,
        Section("Outcomes", table=[("outcome", "cases"), *summary.get("outcomes", {}).items()]),
        Section("Limits passed", table=[("limit", "cases", "meaning"), *limits]),
        Section("Cases", table=[names, *(case.values() for case in cases if case)]),
        Section("Peak loads", table=[heads, *loads]),
        *([_report_passes(summary["refined"])] if "refined" in summary else []),
    ]


def _shorten(names: list[str]) -> list[str]:
    """Return last parts of names as heads; the whole name where only that is distinct."""
    ends = [name.rpartition(".")[2] for name in names]
    return [
        name if "*" in end or ends.count(end) > 1 else end.replace("_", " ")
        for name, end in zip(names, ends, strict=True)
    ]


def _list_facts(summary: dict) -> Iterator[tuple[str, str]]:
    """Yield what ran, how it ended, and what it took."""
    status = summary["status"]
    counts = ", ".join(f"{count} {name}" for name, count in status.items())
    of = f"of scene {summary['scene']} ({summary['sampling']}, seed {summary['seed']})"
    yield "cases", f"{summary['cases']} {of}: {counts}"
    if "form" in summary:
        yield "table", summary["form"]
    if "reasons" in summary:
        yield "reason", f"for example: {summary['reasons']['example']}"
    if status.get("lost"):
        yield "", "--resume tries again what was lost with its worker"
    if part := summary.get("captured"):
        interval = f"95 % interval {part['low']:.1%} to {part['high']:.1%}"
        yield "captured", f"{part['fraction']:.1%} ({interval})"
    yield from list_assured(summary)
    if summary["peak_loads"].get("load_ratio", {}).get("largest") == 0.0 and "worst" not in summary:
        yield (
            "worst case",
            ("none: there are no rated loads; name an outcome as 'worst' in the sweep"),
        )
    clock = summary["time"]
    if clock["ran"]:
        speed = f"{clock['cases_per_second']:.2f} per second with {clock['workers']} workers"
        ran = f"{clock['ran']} cases in {clock['wall']:.1f} s"
        yield "time", f"{ran}, {speed} (engine {clock['engine']})"
    if clock["repeats"]:
        same = "of them have the scene and start values of another case, and took its result"
        yield "", f"{clock['repeats']} {same}"
    yield from list_files(summary.get("files", ()))


def _report_passes(found: dict) -> Section:
    """Return what the second pass changed."""
    text = (
        f"All cases ran at accuracy {say_accuracy(found['accuracy'])}. {found['cases']} of them ran"
        f" again at {found['refine_accuracy']:g}: those with {found['refine']}, or with a step that"
        f" failed. {len(found['changed'])} end otherwise. Everything else has their second results."
    )
    rows = (
        (load, f"{part['median']:.2g}", f"{part['largest']:.2g}", part["case"])
        for load, part in found["peaks"].items()
    )
    heads = ("peak load", "relative change: median", "largest", "in case")
    return Section("What the second pass changed", text, [heads, *rows])


def complete_report(
    summary: dict,
    sweep: Any,
    planner: Any,
    table: Any,
    figures: Sequence[Path],
    *,
    views: Mapping[int, Path],
) -> list[Section]:
    """Return the report of a sweep as its page has it.

    Args:
        summary: of `summarise_sweep`.
        sweep: what was to be done.
        planner: how it was done.
        table: of `make_table`, or its file.
        figures: PNG files of the sweep.
        views: pages with the motion of cases, by row of the table.
    """
    why: Counter[str] = Counter()
    for name in ("explanation", "reason"):
        for words, count in count_texts(table[name]).items() if name in table.column_names else ():
            if not words.startswith("captured"):
                why[_without_numbers(words)] += count
    varied = [
        (f"{q.name} [{q.unit}]" if q.unit else q.name, _say_range(table, q.name))
        for q in planner.varied
    ]
    more = [["seed", str(summary["seed"])], ["sampling", summary["sampling"]]]
    more += [[f"set {name}", say_value(value)] for name, value in sweep.document["set"].items()]
    return [
        *report_sweep(summary),
        Section(
            "Reasons", table=[("why not captured, or not run", "cases"), *why.most_common(_WORST)]
        ),
        *(show_figure(figure) for figure in figures),
        Section("Cases that end otherwise", commands=_list_changed(summary, sweep, planner, table)),
        *_rank_cases(sweep, planner, table, views),
        *_rank_inputs(sweep, planner, table),
        Section("What varied", table=[("quantity", "from ... to"), *varied]),
        *describe_base(planner, more),
    ]


def _list_changed(summary: dict, sweep: Any, planner: Any, table: Any) -> list[tuple[str, str]]:
    """Return the cases that end otherwise in the second pass, with commands."""
    changed = summary.get("refined", {}).get("changed", [])[:_WORST]
    remarks = (f"case {c['case']}: {c['first']}, then {c['again']}" for c in changed)
    commands = (_make_command(sweep, planner, table, c["case"] - 1) for c in changed)
    return list(zip(remarks, commands, strict=True))


def _make_command(sweep: Any, planner: Any, table: Any, row: int) -> str:
    """Return the command that runs a case alone."""
    words = planner.make_command(sweep.cases[row], table["end_time"][row].as_py())
    return shlex.join(words)


def _rank_cases(sweep: Any, planner: Any, table: Any, views: Mapping[int, Path]) -> list[Section]:
    """Return the worst cases, and those that were not captured, with commands and views."""
    by, numbers = read_worst(sweep, table)
    lost: list[int] = []
    if "outcome" in table.column_names:
        lost = np.flatnonzero(has_captured(table) == 0.0).tolist()
    chosen = {f"Worst cases by {by}": list_worst(numbers, _WORST), "Cases not captured": lost}
    sections = []
    for title, cases in chosen.items():
        values = (f", {by} {numbers[i]:.4g}" if len(numbers) else "" for i in cases[:_WORST])
        remarks = {i: f"case {i + 1}{value}" for i, value in zip(cases, values, strict=False)}
        commands = [(r, _make_command(sweep, planner, table, i)) for i, r in remarks.items()]
        links = {remark: views[i] for i, remark in remarks.items() if i in views}
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
    if first := next((section for section in sections if section.table), None):
        first.text = f"{_SHARES} {first.text}"
    return sections


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
    rows = [("input", "share", "95 % interval", "rank correlation")]
    pairs = zip(inputs.items(), found.shares, strict=True)
    for (name, values), share in sorted(pairs, key=lambda pair: -pair[1].value):
        rank = "" if is_text(table, name) else f"{spearmanr(values, y[known]).statistic:.2f}"
        interval = f"{share.low:.2f} to {share.high:.2f}"
        rows.append((name, f"{share.value:.2f}", interval, rank))
    section.table = rows
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


def _say_range(table: Any, name: str) -> str:
    if is_text(table, name):
        return ", ".join(sorted(count_texts(table[name])))
    values = read_numbers(table, name)
    return f"{values.min():g} ... {values.max():g}"


def _without_numbers(text: str) -> str:
    """Return a reason without what differs from case to case."""
    return re.sub(r"\d[\d.e+-]*", "...", text)
