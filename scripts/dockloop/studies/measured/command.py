"""The command ``dockloop compare``: reads both sides, writes numbers and figure, says them."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.figures import can_draw, save_figure
from dockloop.base.files import MADE_BY, check_suffix, claim, figure_kind, json_kind
from dockloop.base.histories import parse_columns, read_data
from dockloop.base.paths import shown
from dockloop.base.sections import FACTS, Section, list_files
from dockloop.base.tables import parse_form, say_form
from dockloop.native.core import list_choices, name_choice
from dockloop.result.files import read_result
from dockloop.result.recording import Result
from dockloop.result.summary import find_summary, write_summary
from dockloop.studies.measured.drawing import draw
from dockloop.studies.measured.overlay import check_overlap, compare, find_shift

COMMAND = "dockloop compare"
_FEW = 0.5  # part of the samples inside the run below which a found shift may be wrong


def run_command(options: argparse.Namespace) -> dict[str, Any]:
    """Compare, write the files, and return the numbers.

    Raises:
        UsageError: a file or an option is bad.
        DockloopError: a file cannot be written.
    """
    output, figure = _claim(options)
    run = _read_run(options.result)
    form = parse_form(options.csv) if options.csv else {}
    data = read_data(options.data, run.names, run.units, form, parse_columns(options.columns))
    shift = find_shift(run, data) if options.shift is None else options.shift
    origin = "found" if options.shift is None else "given"
    check_overlap(options.data, run, data, shift, origin)
    found = {
        MADE_BY: COMMAND,
        "result": shown(options.result),
        "data": shown(options.data),
        "read": data.source,
        **compare(run, data, options.band, shift),
        "shift_found": options.shift is None,
        "outcome": _compare_outcome(run, options.outcome),
    }
    files = [output]
    if not options.no_plots and can_draw():
        save_figure(draw(run, data, found), figure, COMMAND)
        files.append(figure)
    write_summary(found, output, files)
    return found


def report_comparison(found: dict[str, Any]) -> list[Section]:
    """Return the report of a comparison."""
    energies = (
        (name, *(f"{sides[side]:.4g}" for side in ("measured", "computed")),
         "N s" if name.startswith("impulse") else "J",
         _ratio(sides["computed"], sides["measured"]))
        for name, sides in found["energies"].items()
    )  # fmt: skip
    return [
        Section(f"{found['data']} next to {found['result']}", table=[FACTS, *_list_facts(found)]),
        *(_report_column(name, row) for name, row in found["columns"].items()),
        Section("Energies", table=[("quantity", "measured", "run", "unit", "change"), *energies]),
    ]


def _report_column(name: str, row: dict[str, Any]) -> Section:
    """Return how one column differs."""
    part = row["relative_rms"]
    of = "" if part is None else f" ({part:.1%} of the range {row['range']:.3g})"
    peaks = (
        f"{word} {row[f'{side}_peak']:.4g} at {row[f'{side}_peak_time']:.3f} s"
        for word, side in (("measured", "measured"), ("run", "computed"))
    )
    change = _ratio(row["computed_peak"], row["measured_peak"])
    facts = [
        ("peak", ", ".join(peaks) + (f" ({change})" if change else "")),
        (
            "difference",
            f"rms {row['rms']:.3g}{of}, mean {row['bias']:+.3g}, largest"
            f" {row['largest_error']:.3g}; {row['in_band']:.0%} of the samples within"
            f" +-{row['half_band']:.3g}",
        ),
    ]
    unit = row["unit"].replace(".", " ") or "1"
    return Section(f"{name} [{unit}]", table=[FACTS, *facts])


def _list_facts(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield how the table was read, as far as this is no matter of course, and how both ended."""
    origin = "found" if found["shift_found"] else "given"
    overlap = f"{found['overlap']:.0%} of the samples fall into the run"
    yield "time shift", f"{found['shift']:+.4f} s ({origin}); {overlap}"
    if found["shift_found"] and found["overlap"] < _FEW:
        yield "warning", "few samples fall into the run: check units, or give --shift"
    read = found.get("read", {})
    if form := say_form(read.get("form", {})):
        yield "table", form
    if read and not any(column["stated"] for column in read["columns"].values()):
        yield "units", "none stated: those of the outputs"
    if mapped := [f"{c['from']} is {n}" for n, c in read.get("columns", {}).items() if c["mapped"]]:
        yield "columns", ", ".join(mapped)
    if read.get("time_from"):
        yield "time", f"of the data counts from {read['time_from']}"
    if left_out := read.get("left_out"):
        more = f" and {len(left_out) - 8} more" if len(left_out) > 8 else ""
        yield "left out", f"{', '.join(left_out[:8])}{more}: no outputs of the run"
    if capture := found["captured"]:
        sides = (
            f"{word} at {capture[f'{side}_time']:.3f} s" if capture[side] else f"{word} not"
            for side, word in (("measured", "measured"), ("computed", "run"))
        )
        yield "captured", ", ".join(sides)
    if outcome := found["outcome"]:
        same = "the same" if outcome.get("agrees") else "another one"
        known = f"measured {outcome.get('measured')}, run {outcome['computed']}: {same}"
        open_ = f"run {outcome['computed']}; measured: give --outcome"
        yield "outcome", known if outcome.get("measured") else open_
    yield from list_files(found["files"])


def _ratio(computed: float, measured: float) -> str:
    return f"{computed / measured - 1.0:+.1%}" if measured else ""


def _claim(options: argparse.Namespace) -> tuple[Path, Path]:
    """Return the files to write, after making sure that they can be written."""
    if not 0.0 < options.band <= 1.0:
        raise UsageError(f"--band {options.band:g}: must be above 0 and at most 1")
    result = options.result
    output = options.output or result.parent / f"{result.stem}_compared.json"
    check_suffix(output, ".json")
    figure = output.with_suffix(".png")
    claim(output, json_kind("comparison", COMMAND))
    if not options.no_plots:
        claim(figure, figure_kind(COMMAND))
    return output, figure


def _read_run(result: Path) -> Result:
    """Read a result; units of a .csv are in its summary."""
    run = read_result(result)
    if not any(run.units):
        units = json.loads(find_summary(result).read_text(encoding="utf-8")).get("units", {})
        run = replace(run, units=[units.get(name, "1") for name in run.names])
    return run


def _compare_outcome(run: Result, measured: str | None) -> dict[str, Any]:
    """Return the outcome of the run, and whether the measured one is the same."""
    names = [choice.name for choice in list_choices("outcome")]
    if measured is not None and measured not in names:
        hint = did_you_mean(measured, names)
        raise UsageError(f"--outcome {measured}: must be one of {', '.join(names)}{hint}")
    if "outcome" not in run:
        return {}
    computed = name_choice("outcome", run["outcome"][-1])
    if measured is None:
        return {"computed": computed}
    return {"measured": measured, "computed": computed, "agrees": measured == computed}
