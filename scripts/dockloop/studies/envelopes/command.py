"""The command ``dockloop envelope``, and the same in Python: `envelope`."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dockloop.base import paths
from dockloop.base.errors import UsageError, is_watched, names_arguments, say
from dockloop.base.figures import can_draw, save_figure
from dockloop.base.files import claim, scratch
from dockloop.base.number import check_number
from dockloop.base.paths import as_path
from dockloop.base.progress import ProgressBar, import_optional
from dockloop.base.sections import write_html
from dockloop.result.summary import write_summary
from dockloop.runs.docking import Scene
from dockloop.scene.find import find_scene
from dockloop.studies.envelopes import report
from dockloop.studies.envelopes.band import Draws, find_band, list_shares, read_draws
from dockloop.studies.envelopes.search import COMMAND, Axis, Order, Progress, Search, find_envelope
from dockloop.sweeps.campaign import How, read_how
from dockloop.sweeps.journal import keeps_results
from dockloop.sweeps.settings import (
    Range,
    give_accuracy,
    make_experiment,
    name_scene,
    parse_range,
    read_settings,
)

if TYPE_CHECKING:
    import pandas as pd


@dataclass
class Envelope:
    """The boundary of criteria in two or three quantities.

    Attributes:
        summary: what ``dockloop envelope --json`` prints.
        points: a row for every docking: quantities, which criteria it meets, outcomes, command.
        boundary: a row for every place where a criterion changes: the middle of two dockings, half
            their distance, both of them. Units are in ``attrs["units"]`` of all tables.
        band: with parameters of a fit: points of a raster, and the share of draws that meet each
            criterion there; None without.
        draws: the parameters of each draw, by name; empty without.
    """

    summary: dict[str, Any]
    points: "pd.DataFrame"
    boundary: "pd.DataFrame"
    band: "pd.DataFrame | None"
    draws: list[dict[str, float]]
    _search: Search
    _shares: report.Table | None

    def plot(self) -> Any:
        """Draw where the criteria are met; returns a ``matplotlib.figure.Figure``."""
        import_optional("matplotlib")
        return report.draw_envelope(self._search, self._shares)


@names_arguments
def envelope(
    scene: str | Path | Scene | Mapping[str, Any],
    x: Range,
    y: Range,
    z: Range | None = None,
    *,
    criteria: str | Sequence[str],
    overrides: Mapping[str, Any] | None = None,
    start_values: Mapping[str, Any] | None = None,
    stop: float | None = None,
    step: float | None = None,
    log: str = "",
    tolerance: float | None = None,
    coarse: int | None = None,
    checks: int = 16,
    seed: int = 0,
    fitted: str | Path | None = None,
    draws: int = 8,
    output: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    accuracy: float | str | None = None,
    assured: bool = False,
) -> Envelope:
    """Find where dockings meet criteria: the boundary in two or three quantities.

    Args:
        scene: name of a shipped scene, path of a ``.toml`` file, its members, or a
            `dockloop.Scene`.
        x: name, low and high of a quantity: a key of the scene or a variable of the FMU.
        y: a second one.
        z: perhaps a third one.
        criteria: one text or several, such as ``"captured within 5 s and load_ratio < 1"``.
        overrides: keys of the scene that all dockings have otherwise.
        start_values: values of variables that all dockings start with.
        stop: end of a docking [s]; default: that of the scene.
        step: communication step [s]; default: that of the scene.
        log: letters of quantities that go in equal ratios, such as ``"xy"``.
        tolerance: the boundary is found within this part of each range.
        coarse: cells along a range at the beginning; what is smaller may be missed.
        checks: dockings at random away from the boundary.
        seed: of these, and of `draws`.
        fitted: the result of ``dockloop fit`` (``fit.json``): the boundary is found with its
            values, and then with parameters drawn with its covariance: `Envelope.band`.
        draws: how often.
        output: folder for the journal; default: it is not kept.
        workers: threads; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        resume: go on with the journal of `output`.
        accuracy: wanted relative error of all dockings, or ``"real-time"``.
        assured: run each docking again with tighter settings until two runs agree within the
            accuracy; columns of `Envelope.points` say what was found.

    Raises:
        UsageError: naming what is bad, its value and the limit.
        DockloopError: a package is missing, or no docking could be run.
    """
    pd = import_optional("pandas")
    ranges = [axis for axis in (x, y, z) if axis is not None]
    reference, settings = name_scene(scene, overrides, start_values)
    if accuracy is not None:
        settings = settings | give_accuracy(accuracy)
    order = Order(
        reference,
        _make_axes(ranges, log),
        (criteria,) if isinstance(criteria, str) else tuple(criteria),
        settings,
        make_experiment(stop, step),
        tolerance,
        coarse,
        checks,
        seed,
        bool(assured),
    )
    drawn = None if fitted is None else read_draws(as_path("fitted", fitted), draws, seed)
    how = How(workers=workers, scheduler=scheduler, resume=resume)
    with scratch() as folder:
        found, band = _find(order, drawn, as_path("-o", output or folder), None, how)
    shares = list_shares(found, band) if band else None

    def make_table(made: report.Table) -> Any:
        columns, rows = made
        table = pd.DataFrame(rows, columns=columns)
        units = report.list_units(found)
        table.attrs["units"] = {name: units[name] for name in columns if name in units}
        return table

    return Envelope(
        report.summarise_envelope(found, band, shares),
        make_table(report.list_points(found)),
        make_table(report.list_boundary(found)),
        make_table(shares) if shares else None,
        drawn.drawn if drawn else [],
        found,
        shares,
    )


def _find(
    order: Order, draws: Draws | None, folder: Path, progress: Progress | None, how: How
) -> tuple[Search, list[Search]]:
    """Find the boundary, and with draws its band."""
    if draws:
        order = draws.put_values(order)
    found = find_envelope(order, folder / report.JOURNAL, progress=progress, **how)
    if not draws:
        return found, []

    def name_journal(number: int) -> Path:
        return folder / report.name_journal(number)

    return found, find_band(order, draws, name_journal, progress=progress, **how)


def run_command(options: argparse.Namespace) -> dict:
    """Find and write an envelope; returns the summary, with the files written.

    Raises:
        UsageError: an option is bad.
        DockloopError: the work failed.
    """
    name = find_scene(options.scene).stem
    ranges = [given for given in (options.x, options.y, options.z) if given]
    numbers = [
        parse_range(f"--{letter}", given) for letter, given in zip("xyz", ranges, strict=False)
    ]
    order = Order(
        options.scene,
        _make_axes(numbers, options.log or ""),
        tuple(options.criteria),
        read_settings(options),
        make_experiment(options.stop, options.step),
        options.tolerance,
        options.coarse,
        options.check,
        options.seed,
        options.assured,
    )
    folder = options.output or paths.RESULTS / "envelopes" / name
    draws = None
    if options.fitted is not None:
        draws = read_draws(options.fitted, options.draws, options.seed)
    for file, kind in report.list_kinds(len(draws.drawn) if draws else 0).items():
        claim(folder / file, kind)
    found, band = _find(order, draws, folder, make_progress(name), read_how(options))
    shares = list_shares(found, band) if band else None
    summary = report.summarise_envelope(found, band, shares)
    with keeps_results():
        files = report.write_tables(found, folder, shares)
        figures = []
        if not options.no_plots and can_draw():
            figures.append(folder / "envelope.png")
            save_figure(report.draw_envelope(found, shares), figures[0], COMMAND)
        files += figures
        if options.report:
            files.append(folder / "report.html")
            sections = report.complete_report(summary, found.planner, figures)
            write_html(files[-1], COMMAND, sections)
        files.append(folder / "summary.json")
        write_summary(summary, files[-1], files)
    return summary


def _make_axes(ranges: Sequence[Range], log: str) -> tuple[Axis, ...]:
    letters = "xyz"[: len(ranges)]
    if wrong := set(log) - set(letters):
        raise UsageError(f"--log {log}: '{min(wrong)}' must be one of {', '.join(letters)}")
    axes = []
    for letter, given in zip(letters, ranges, strict=True):
        if len(given) != 3 or not isinstance(given[0], str):
            raise UsageError(f"--{letter} {given!r}: must be a name, low and high")
        name, *ends = given
        low, high = (check_number(f"--{letter} {name}", end) for end in ends)
        axes.append(Axis(name, low, high, letter in log))
    return tuple(axes)


def make_progress(label: str, what: str = "dockings") -> Progress:
    """Return what shows progress: a bar at a terminal, else a line for every round."""
    bar, rounds = ProgressBar(label), set()

    def show(done: int, total: int, note: str) -> None:
        bar(0.999 * done / max(total, 1), f"{done} of {total} {what} so far, {note}")
        if total not in rounds and not is_watched():
            rounds.add(total)
            say(f"{label}: {note}, {total} {what} so far")

    return show
