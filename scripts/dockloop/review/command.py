"""The command ``dockloop review``: one docking for a review board, as a page and as a PDF.

A run with its numerical errors, the mechanism, travel against stops, the worst direction of a start
condition, the boundary of success in that direction, and with a fit the band of the loads.
"""

import argparse
import re
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.api import sweep
from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.base.figures import can_draw, save_figure
from dockloop.base.files import MADE_BY, claim, figure_kind, json_kind
from dockloop.base.number import check_whole
from dockloop.base.progress import ProgressBar, import_optional
from dockloop.base.sections import (
    FACTS,
    Section,
    html_kind,
    list_files,
    pdf_kind,
    write_html,
    write_pdf,
)
from dockloop.base.words import list_words
from dockloop.native import core
from dockloop.report.plots import list_plots, write_plots
from dockloop.report.run import complete_report
from dockloop.result.capture import WITH_CAPTURE
from dockloop.result.recording import Result
from dockloop.result.summary import COMMAND as RUN
from dockloop.result.summary import write_summary
from dockloop.runs.docking import Scene, run
from dockloop.scene.find import find_scene
from dockloop.scene.hardware import find_extent, make_hardware
from dockloop.scene.mechanism import find_turning
from dockloop.scene.mechanism_drawing import SHEET, write_drawing
from dockloop.studies.envelopes.band import read_draws
from dockloop.studies.envelopes.command import Envelope, envelope
from dockloop.studies.envelopes.report import report_envelope
from dockloop.studies.envelopes.search import Axis, Order, check_tolerance, prepare_search
from dockloop.sweeps.settings import (
    Range,
    Settings,
    give_accuracy,
    make_experiment,
    parse_range,
    parse_settings,
)

COMMAND = "dockloop review"
CRITERION = "captured and load_ratio < 1"
_OFFSET, _SPEED = "initial.lateral_offset", "initial.closing_speed"
_PART = 0.5  # of the extent of the hardware: the largest offset, unless the user says one
_SPEEDS = (0.25, 4.0)  # of the closing speed of the scene, likewise
_DIRECTIONS = {  # of magnitudes that have one
    _OFFSET: "initial.lateral_direction_deg",
    "initial.lateral_speed": "initial.lateral_speed_direction_deg",
    "initial.pitch_yaw_deg": "initial.pitch_yaw_direction_deg",
    "initial.pitch_yaw_rate_deg_s": "initial.pitch_yaw_rate_direction_deg",
}
_TRAVELS = (  # outputs, and the parameters of their stops
    (r"(leg\[\d+\])\.length", r"\.stops\.min_length", r"\.stops\.max_length"),
    (r"(element\[\d+\])\.coordinate", r"\.law\[\d+\]\.lower", r"\.law\[\d+\]\.upper"),
)
_LOAD_RATIO = "capture.peak.load_ratio"


def run_command(options: argparse.Namespace) -> dict[str, Any]:
    """Run, draw, write both files; returns the summary.

    Raises:
        UsageError: an option is bad.
        DockloopError: the work failed, or a package is missing.
    """
    path = find_scene(options.scene)
    folder = options.output or paths.RESULTS / "reviews" / path.stem
    _check_numbers(options)
    stem, drawing = folder / "review", folder / "review_mechanism.svg"
    boundary = folder / "review_envelope.png"
    pages = _claim(options, folder, stem, drawing, boundary)

    overrides = parse_settings("--scene", options.overrides)
    settings = parse_settings("--set", options.set)
    if options.accuracy is not None:
        settings = settings | give_accuracy(options.accuracy)
    more: dict[str, Any] = {"overrides": overrides, "start_values": settings}
    more |= {"stop": options.stop, "step": options.step}
    axes = _choose_axes(options, Scene(options.scene, overrides).document)
    _check_boundary(options, axes, overrides | settings)
    progress = ProgressBar(path.stem)
    result = run(options.scene, estimate_error=True, progress=progress, **more)
    worst = _find_worst(options, overrides | settings, axes)
    band = _find_band(options, overrides | settings)
    found = _find_envelope(options, axes, more, worst)

    figures = write_plots(result, stem) if can_draw() else []
    plots = list(figures)
    if found and can_draw():
        save_figure(found.plot(), boundary, COMMAND)
        figures.append(boundary)
    if mechanism := _get_mechanism(result.scene):
        write_drawing(drawing, mechanism, core.check(mechanism, path))
        figures.append(drawing)
    travels = list(list_travels(result))
    summary = {
        MADE_BY: COMMAND,
        "scene": result.summary["scene"],
        "run": {name: value for name, value in result.summary.items() if name != "model"},
        "travels": [dict(zip(_TRAVEL_HEADS, row, strict=True)) for row in travels],
        "worst": worst,
        "envelope": found.summary if found else None,
        "band": band,
    }
    words = ["dockloop", "run", options.scene, *list_words(options, ("stop", "step", "accuracy"))]
    head, outcome, *others = complete_report(result.summary, plots, words)
    head.commands = [("This report again", shlex.join(_repeat(options))), *head.commands]
    sections = [
        head,
        outcome,
        others.pop(0),
        _report_errors(result.error_estimate),
        Section(
            "Travel against stops, at communication points",
            table=[_TRAVEL_HEADS, *travels] if travels else [],
        ),
        Section("Mechanism at home", figures=[drawing] if mechanism else []),
        *_report_worst(worst),
        *(_report_envelope(found, [boundary] if boundary in figures else []) if found else []),
        *_report_band(band, options.fitted),
        *others,
    ]
    write_html(pages[0], COMMAND, sections)
    if not options.no_pdf:
        write_pdf(pages[1], COMMAND, sections)
    files = [*pages, *figures, folder / "summary.json"]
    write_summary(summary, files[-1], files)
    return summary


def _check_numbers(options: argparse.Namespace) -> None:
    """Check, before anything runs, what later work takes. Raises UsageError."""
    check_whole("--directions", options.directions, 1, 360)
    check_whole("--cases", options.cases, 2, 10_000)
    check_tolerance(options.tolerance)


def _check_boundary(options: argparse.Namespace, axes: Sequence[Range], settings: Settings) -> None:
    """Check, before anything runs, what the boundary and the fit take. Raises UsageError."""
    draws = None if options.fitted is None else read_draws(options.fitted, options.cases, 0)
    if not axes:
        if options.criterion != [CRITERION]:
            raise UsageError(
                f"--criterion {options.criterion[0]!r}: there is no boundary, as the scene states"
                " its vehicles as they are: give --x and --y too"
            )
        return
    decided = {axis[0] for axis in axes}
    order = Order(
        options.scene,
        tuple(Axis(*axis) for axis in axes),
        tuple(options.criterion),
        settings.without(decided),
        make_experiment(options.stop, options.step),
    )
    prepare_search(draws.put_values(order) if draws else order)


def _claim(
    options: argparse.Namespace, folder: Path, stem: Path, drawing: Path, boundary: Path
) -> list[Path]:
    """Make sure that all files can be written; returns the page, and the PDF if there is one."""
    pages = [folder / "review.html"]
    if not options.no_pdf:
        import_optional("weasyprint")
        pages.append(folder / "review.pdf")
        claim(pages[1], pdf_kind(COMMAND))
    for figure in list_plots(stem):
        claim(figure, figure_kind(RUN))
    claim(boundary, figure_kind(COMMAND))
    claim(drawing, SHEET)
    claim(pages[0], html_kind(COMMAND))
    claim(folder / "summary.json", json_kind("summary", COMMAND))
    return pages


def report_review(summary: dict[str, Any]) -> list[Section]:
    """Return what the terminal shows: the outcome, what is close to a limit, the files."""
    loads = [
        (name, load["value"], load["unit"], load.get("ratio"))
        for name, load in summary["run"].get("peak_loads", {}).items()
    ]
    facts = [("outcome", summary["run"].get("outcome", "not judged"))]
    if error := summary["run"].get("error_estimate"):
        facts.append(("error", error["sentence"]))
    if worst := summary["worst"]:
        facts.append(("worst direction", f"{worst['name']} = {worst['value']:g}: {worst['why']}"))
    for criterion in (summary["envelope"] or {"criteria": []})["criteria"]:
        facts.append(("boundary", f"{criterion['text']}: {criterion['met']:.1%} of the box"))
    facts += list_files(summary.get("files", []))
    heads = ("load", "peak", "unit", "of the rated")
    travels = (row.values() for row in summary["travels"])
    return [
        Section(f"Review of {summary['scene']}", table=[FACTS, *facts]),
        Section("Peak loads", table=[heads, *loads]),
        Section("Travel against stops, at communication points", table=[_TRAVEL_HEADS, *travels]),
    ]


_TRAVEL_HEADS = ("part", "lowest", "highest", "lower stop", "upper stop", "unit", "left")


def list_travels(result: Result) -> Iterator[tuple]:
    """Yield how far each leg and element came, at communication points, and what its stops leave.

    What is left is the smallest distance to a stop, as a part of the travel between both. Angles
    are in deg, lengths in mm.
    """
    shown = _find_parts(result.scene["mechanism"], Path(result.scene["name"]))
    for name in result.names:
        for pattern, *ends in _TRAVELS:
            if not (found := re.fullmatch(pattern, name)):
                continue
            part = found[1]
            low, high = float(result[name].min()), float(result[name].max())
            lower, upper = (_find_stop(result, re.escape(part) + end) for end in ends)
            if lower is None or upper is None:
                continue
            left = min(low - lower, upper - high) / (upper - lower)
            part, factor, unit = shown[part]
            yield part, *(factor * x for x in (low, high, lower, upper)), unit, f"{left:.0%}"


def _find_parts(mechanism: dict, source: Path) -> dict[str, tuple[str, float, str]]:
    """Return names of legs and elements as in their file, with factor and unit of their travel."""
    length, angle = (1e3, "mm"), (np.degrees(1.0), "deg")
    parts = {}
    for i, leg in enumerate(mechanism.get("legs", ()), 1):
        parts[f"leg[{i}]"] = (leg.get("name", f"leg[{i}]"), *length)
    for i, (name, turns) in enumerate(find_turning(mechanism, source).items(), 1):
        parts[f"element[{i}]"] = (name, *(angle if turns else length))
    return parts


def _find_stop(result: Result, pattern: str) -> float | None:
    """Return the parameter of a stop; None: there is none, or it is nowhere."""
    names = (name for name in result.parameters if re.fullmatch(pattern, name))
    value = result.parameters.get(next(names, ""), np.inf)
    return float(value) if np.isfinite(value) else None


def _get_mechanism(scene: dict) -> dict | None:
    mechanism = scene["mechanism"]
    return mechanism if mechanism.get("bodies") or mechanism.get("legs") else None


def _choose_axes(options: argparse.Namespace, scene: dict) -> list[Range]:
    """Return the quantities of the boundary: those of the user, or offset and speed."""
    given = [("--x", options.x), ("--y", options.y)]
    if any(words for _, words in given):
        if not all(words for _, words in given):
            raise UsageError("--x, --y: the boundary has two quantities: give both, or none")
        return [parse_range(option, words) for option, words in given]
    initial = scene["initial"]
    if initial.get("at") != "first_contact" or not initial.get("closing_speed", 0.0) > 0.0:
        return []  # the scene states vehicles as they are: nothing says what may vary
    extent = find_extent(make_hardware(scene["mechanism"]))
    speeds = (factor * initial["closing_speed"] for factor in _SPEEDS)
    return [(_OFFSET, 0.0, _PART * extent), (_SPEED, *speeds)]


def _find_worst(
    options: argparse.Namespace, settings: dict[str, Any], axes: Sequence[Range]
) -> dict[str, Any] | None:
    """Return the worst of equal directions of the first quantity that has one, in mid-range."""
    chosen = next((axis for axis in axes if axis[0] in _DIRECTIONS), None)
    if chosen is None or options.directions == 1:
        return None
    magnitude, low, high = chosen
    direction = _DIRECTIONS[magnitude]
    settings = {k: v for k, v in settings.items() if k not in (magnitude, direction)}
    angles = [360.0 * i / options.directions for i in range(options.directions)]
    middle = 0.5 * (low + high)
    table = sweep(
        {
            "scene": options.scene,
            "set": {**settings, magnitude: middle},
            "vary": [{"type": "grid", "name": direction, "values": angles}],
            "experiment": make_experiment(options.stop, options.step),
        },
        workers=options.workers,
    )
    done = table[table["status"] == "done"].reset_index()
    rows = [
        [
            float(row[direction]),
            str(row["outcome"]) if "outcome" in done else None,
            float(row[_LOAD_RATIO]) if _LOAD_RATIO in done else None,
        ]
        for _, row in done.iterrows()
    ]
    if not rows:
        return None
    angle, outcome, ratio = max(rows, key=lambda row: (row[1] not in WITH_CAPTURE, row[2] or 0.0))
    return {
        "name": direction,
        "value": angle,
        "at": {magnitude: middle},
        "why": f"load ratio {ratio:.3f}" if outcome in WITH_CAPTURE and ratio else str(outcome),
        "directions": rows,
    }


def _find_envelope(
    options: argparse.Namespace, axes: Sequence[Range], more: dict, worst: dict | None
) -> Envelope | None:
    """Return the boundary in the worst direction; None: the scene says nothing that may vary."""
    if not axes:
        return None
    decided = {axis[0] for axis in axes}
    given = {name: dict(more[name]) for name in ("overrides", "start_values")}
    if worst:
        given["overrides"][worst["name"]] = worst["value"]
    settings = {
        member: {k: v for k, v in values.items() if k not in decided}
        for member, values in given.items()
    }
    return envelope(
        options.scene,
        *axes,
        criteria=options.criterion,
        **{**more, **settings},
        tolerance=options.tolerance,
        fitted=options.fitted,
        workers=options.workers,
    )


def _find_band(options: argparse.Namespace, settings: dict[str, Any]) -> dict[str, Any] | None:
    """Return the peak loads with parameters drawn from a fit; None: there is no fit."""
    if options.fitted is None:
        return None
    members = {"scene": options.scene, "set": settings, "cases": options.cases}
    members["experiment"] = make_experiment(options.stop, options.step)
    table = sweep(members, fitted=options.fitted, workers=options.workers)
    done = table[table["status"] == "done"]
    loads = {
        name.removeprefix("capture.peak."): {
            "unit": table.attrs["units"].get(name, ""),
            "low": float(done[name].quantile(0.025)),
            "median": float(done[name].median()),
            "high": float(done[name].quantile(0.975)),
        }
        for name in done.columns
        if re.fullmatch(r"capture\.peak\.\w+", name)
    }
    return {"cases": len(done), "loads": loads}


# ------------------------------------------------------------------------------------- words


def _report_errors(estimate: dict[str, Any]) -> Section:
    rows = [(name, f"{error:.1e}") for name, error in estimate.get("figures", {}).items()]
    return Section(
        "Numerical error",
        estimate.get("sentence", ""),
        [("figure", "relative error, by a second run"), *rows],
    )


def _report_worst(worst: dict[str, Any] | None) -> Iterator[Section]:
    if worst:
        ((magnitude, middle),) = worst["at"].items()
        yield Section(
            "The worst direction",
            f"{worst['name']} = {worst['value']:g}: {worst['why']}, with {magnitude} ="
            f" {middle:.4g}. The boundary below is in this direction.",
            [(worst["name"], "outcome", "load ratio"), *worst["directions"]],
        )


def _report_envelope(found: Envelope, figures: list[Path]) -> Iterator[Section]:
    head, *others = report_envelope(found.summary)
    head.title = "The boundary of success"
    head.figures = figures
    yield head
    yield from others


def _report_band(band: dict[str, Any] | None, file: str | None) -> Iterator[Section]:
    if band:
        rows = [(name, *(load[k] for k in ("low", "median", "high", "unit")))
                for name, load in band["loads"].items()]  # fmt: skip
        yield Section(
            "Loads with the uncertainty of the fit",
            f"{band['cases']} dockings as above, but with parameters drawn from {file}.",
            [("load", "2.5 %", "median", "97.5 %", "unit"), *rows],
        )


def _repeat(options: argparse.Namespace) -> list[str]:
    """Return the words of this command."""
    words = ["dockloop", "review", options.scene, *list_words(options, ("stop", "step"))]
    for letter in "xy":
        if given := getattr(options, letter):
            words += [f"--{letter}", *given]
    names = {"--accuracy": "accuracy", "--from": "fitted", "-o": "output"}
    names |= {f"--{name}": name for name in ("tolerance", "directions", "cases")}
    for option, member in names.items():
        value = getattr(options, member)
        words += [] if value is None else [option, str(value)]
    for text in options.criterion:
        words += ["--criterion", text]
    return words + ["--no-pdf"] * options.no_pdf
