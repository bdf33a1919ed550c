"""The report of a run, and what its page has more."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from dockloop.base.number import say_number
from dockloop.base.sections import FACTS, Section, list_files
from dockloop.report.parts import (
    describe_scene,
    describe_settings,
    list_peaks,
    say_value,
    show_figure,
)
from dockloop.result.capture import WITH_CAPTURE
from dockloop.result.peaks import say_place

_DISSIPATED = "dissipated_"
_LEAST_PART = 1e-3  # of the dissipated energy; smaller parts are not said


def report_run(summary: dict) -> list[Section]:
    """Return the report of a run; `summary` is that of `summarise`."""
    loads = list_peaks(summary.get("peak_loads", {}), ["value"])
    limits = (
        [limit[key] for key in ("name", "time", "value", "unit", "sentence")]
        for limit in summary.get("limits", ())
    )
    return [
        Section(
            f"{summary['scene']}: {summary['title']}",
            say_outcome(summary),
            [FACTS, *_list_facts(summary)],
        ),
        Section(
            "Peak loads on the target: true peaks over inner steps",
            table=[("load", "peak", "unit", "rated", "of the rated", "where"), *loads],
        ),
        Section(
            "Limits passed", table=[("limit", "first at [s]", "value", "unit", "meaning"), *limits]
        ),
    ]


def complete_report(
    summary: dict, figures: Sequence[Path], command: Sequence[str], view: Path | None = None
) -> list[Section]:
    """Return the report of a run as its page has it.

    Args:
        summary: of `summarise`.
        figures: PNG files of the run.
        command: words that repeat it.
        view: page with its motion.
    """
    head, *others = report_run(summary)
    remark = "The same run again"
    head.commands = [(remark, shlex.join(command))]
    head.links = {remark: view} if view else {}
    keys = ("outcome", "phase", "time_of_contact", "time_of_capture", "explanation")
    ends = [(_title(key), say_value(summary[key])) for key in keys if key in summary]
    energy = [(n.replace("_", " "), say_value(v)) for n, v in summary.get("energy", {}).items()]
    return [
        head,
        Section("Outcome", table=[FACTS, *ends]),
        *others,
        *(show_figure(figure) for figure in figures),
        Section("Energy [J]", table=[FACTS, *energy]),
        describe_scene(summary["model"]),
        describe_settings(summary["model"]),
    ]


def _title(key: str) -> str:
    """Return a member of a summary as words; times have their unit."""
    return key.replace("_", " ") + (" [s]" if key.startswith("time_") else "")


def _list_facts(summary: dict) -> Iterator[tuple[str, str]]:
    """Yield what happened, what does not add up, and what it took."""
    if reached := summary.get("sequence"):
        time = f"{reached['time_in_step']:.1f} s at the end"
        yield "sequence", f"{', '.join(reached['steps'])}; in '{reached['step']}' for {time}"
    if legs := summary.get("legs"):
        ends = (say_number(1e3 * legs[f"{end}_travel"]) for end in ("shortest", "longest"))
        force = f"largest force {say_number(legs['largest_force'])} N {say_place(legs['peak'])}"
        travel = f"travel {' to '.join(ends)} mm from the start at communication points"
        yield "legs", f"{travel}, {force}"
    if energy := summary.get("energy"):
        least = _LEAST_PART * abs(energy["dissipated"])
        parts = ", ".join(
            f"{name.removeprefix(_DISSIPATED)} {say_number(value)}"
            for name, value in energy.items()
            if name.startswith(_DISSIPATED) and value >= least and value > 0.0
        )
        begun = f"{say_number(energy['initial_relative'])} J {energy['initial_meaning']}"
        absorbed = f"{say_number(energy['dissipated'])} J absorbed" + (f" ({parts})" * bool(parts))
        yield "energy", f"{begun}, {absorbed}"
        ratio = energy["residual_ratio"]
        part = "" if ratio is None else f" ({ratio:.1e} of the initial relative energy)"
        yield "audit", f"energy residual {energy['residual']:.1e} J{part}"
    if "momentum_residual" in summary:
        yield "", f"momentum residual {summary['momentum_residual']:.1e} (relative)"
    for vehicle, load in summary.get("records", {}).items():
        impulse = say_number(float(np.linalg.norm(load["impulse"])))
        force = say_number(load["largest_force"])
        yield (
            "record",
            f"{impulse} N s and at most {force} N from outside keep the {vehicle} on its record",
        )
    clock = summary["time"]
    simulated = f"{summary['simulated_time']:g} s simulated in {clock['loop']:.2f} s"
    speed = f"{clock['real_time_factor']:.0f} times real time"
    yield "time", f"{simulated} ({speed}) after {clock['load']:.2f} s of loading"
    yield (
        "",
        f"inside fmi2DoStep {clock['do_step']:.3f} s, reading outputs {clock['read']:.3f} s, Python"
        f" and FMPy {clock['python']:.3f} s over {summary['communication_steps']} steps",
    )
    if solver := summary.get("solver"):
        each = clock.get("microseconds_per_rhs")
        steps = f"{solver['steps']} inner steps, {solver['rejected_steps']} rejected"
        price = f" of {each:.1f} microseconds" if each else ""
        yield "solver", f"{steps}, {solver['rhs_evaluations']} evaluations{price}"
    yield from (("note", text) for text in summary.get("notes", ()))
    if error := summary.get("error_estimate"):
        yield "error", error["sentence"]
        if level := error.get("level"):
            yield "level error", f"{level['name']}: {level['sentence']}"
    if summary.get("assured") is True:  # otherwise a warning says so
        yield "assured", summary["assurance"]["sentence"]
    yield from (("warning", text) for text in summary.get("warnings", ()))
    yield from list_files(summary.get("files", ()))


def say_outcome(summary: dict) -> str:
    """Say how the docking ended."""
    if "outcome" not in summary:
        return f"ran to {summary['simulated_time']:g} s"
    why = summary.get("explanation")
    contact, capture = summary["time_of_contact"], summary["time_of_capture"]
    if contact is None:
        return f"no contact within {summary['simulated_time']:g} s (outcome: {summary['outcome']})"
    begin = f"first contact at {contact:.3f} s"
    if capture is None and why:
        return f"{why}; {begin} (outcome: {summary['outcome']}, phase {summary['phase']})"
    end = f"{summary['outcome']}, phase {summary['phase']} at the end"
    if capture is not None:
        began = f"captured at {capture:.3f} s, {capture - contact:.3f} s after {begin}"
        if summary["outcome"] not in WITH_CAPTURE and why:
            return f"{why}; {begin}; {end}"
        return began if summary["outcome"] == "captured" else f"{began}; {end}"
    if summary["latches"]:
        end += f", {summary['latches_held']} of {summary['latches']} latches held"
    return f"not captured; {begin}; {end}"
