"""The command ``dockloop compare``: reads both sides, writes numbers and figure, says them."""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from dockloop.core import list_choices, name_choice
from dockloop.errors import UsageError, did_you_mean
from dockloop.figures import can_draw, save_figure
from dockloop.measured.data import read_data
from dockloop.measured.drawing import draw
from dockloop.measured.overlay import compare
from dockloop.outputs import MADE_BY, claim, figure_kind, json_kind
from dockloop.paths import shown
from dockloop.results import Result
from dockloop.summary import find_summary, write_summary
from dockloop.view.results import read_result

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
    data = read_data(options.data, run.names, run.units)
    found = {
        MADE_BY: COMMAND,
        "result": shown(options.result),
        "data": shown(options.data),
        **compare(run, data, options.band, options.shift),
        "outcome": _compare_outcome(run, options.outcome),
    }
    if found["samples"] < 2:
        raise UsageError(
            f"{shown(options.data)}: {found['samples']} samples fall into the run from"
            f" {run.time[0]:g} to {run.time[-1]:g} s: give another --shift"
        )
    files = [output]
    if not options.no_plots and can_draw():
        save_figure(draw(run, data, found), figure, COMMAND)
        files.append(figure)
    write_summary(found, output, files)
    return found


def describe(found: dict[str, Any]) -> str:
    """Return a comparison in words."""
    origin = "found" if found["shift_found"] else "given"
    lines = [
        f"{found['data']} next to {found['result']}",
        f"  time shift   {found['shift']:+.4f} s ({origin}); {found['overlap']:.0%} of the samples"
        " fall into the run",
    ]
    if found["shift_found"] and found["overlap"] < _FEW:
        lines.append("  warning      few samples fall into the run: check units, or give --shift")
    for name, row in found["columns"].items():
        unit = row["unit"].replace(".", " ") or "1"
        lines += [
            f"  {name} [{unit}]",
            f"    peak       measured {row['measured_peak']:.4g} at"
            f" {row['measured_peak_time']:.3f} s, run {row['computed_peak']:.4g} at"
            f" {row['computed_peak_time']:.3f} s"
            + _ratio(row["computed_peak"], row["measured_peak"]),
            f"    difference rms {row['rms']:.3g}{_say_part(row)}, mean {row['bias']:+.3g}, largest"
            f" {row['largest_error']:.3g}; {row['in_band']:.0%} of the samples within"
            f" +-{row['half_band']:.3g}",
        ]
    for name, sides in found["energies"].items():
        unit = "N s" if name.startswith("impulse") else "J"
        lines.append(
            f"  {name}: measured {sides['measured']:.4g} {unit}, run {sides['computed']:.4g} {unit}"
            + _ratio(sides["computed"], sides["measured"])
        )
    lines += _describe_ends(found)
    return "\n".join([*lines, f"  files        {', '.join(found['files'])}"])


def _say_part(row: dict[str, Any]) -> str:
    """Say the difference as a part of the measured range, if there is one."""
    part = row["relative_rms"]
    return "" if part is None else f" ({part:.1%} of the range {row['range']:.3g})"


def _ratio(computed: float, measured: float) -> str:
    return f" ({computed / measured - 1.0:+.1%})" if measured else ""


def _describe_ends(found: dict[str, Any]) -> list[str]:
    """Return what became of both sides."""
    lines = []
    capture = found["captured"]
    if capture:
        sides = []
        for side, name in (("measured", "measured"), ("computed", "run")):
            when = f"at {capture[f'{side}_time']:.3f} s" if capture[side] else "not"
            sides.append(f"{name} {when}")
        lines.append(f"  captured     {', '.join(sides)}")
    outcome = found["outcome"]
    if outcome.get("measured"):
        same = "the same" if outcome["agrees"] else "another one"
        lines.append(
            f"  outcome      measured {outcome['measured']}, run {outcome['computed']}: {same}"
        )
    elif outcome:
        lines.append(f"  outcome      run {outcome['computed']}; measured: give --outcome")
    return lines


def _claim(options: argparse.Namespace) -> tuple[Path, Path]:
    """Return the files to write, after making sure that they can be written."""
    if not 0.0 < options.band <= 1.0:
        raise UsageError(f"--band {options.band:g}: must be above 0 and at most 1")
    result = options.result
    output = options.output or result.parent / f"{result.stem}_compared.json"
    if output.suffix != ".json":
        raise UsageError(f"-o {output}: must end in .json")
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
