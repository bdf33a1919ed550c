"""The command ``dockloop map``."""

import argparse
import shlex

from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.base.figures import can_draw, save_figure
from dockloop.base.files import claim
from dockloop.base.words import LIMIT, list_words
from dockloop.result.summary import write_summary
from dockloop.scene.find import find_scene
from dockloop.studies.envelopes.command import make_progress
from dockloop.studies.envelopes.search import FINEST, Axis, Order, find_envelope
from dockloop.studies.maps import report
from dockloop.studies.maps.verdicts import PointJudge
from dockloop.sweeps.campaign import read_how
from dockloop.sweeps.journal import keeps_results
from dockloop.sweeps.settings import make_experiment, parse_range, read_settings

_COARSE = 8  # cells along a range at the beginning
_FEWEST = 3  # points along a range
_MOST = round(0.5 / FINEST) + 1


def run_command(options: argparse.Namespace) -> dict:
    """Make and write a map; returns the summary, with the files written.

    Raises:
        UsageError: an option is bad.
        DockloopError: the work failed.
    """
    name = find_scene(options.scene).stem
    if options.error <= 0.0:
        raise UsageError(f"--error {options.error:g}: must be greater than 0")
    if not _FEWEST <= options.points <= _MOST:
        raise UsageError(f"--points {options.points}: must be {_FEWEST} to {_MOST}")
    judge = PointJudge(options.error, options.limit, options.host, options.assured)
    order = _make_order(options)
    folder = options.output or paths.RESULTS / "maps" / name
    for file, kind in report.KINDS.items():
        claim(folder / file, kind)
    search = find_envelope(
        order,
        folder / "journal.jsonl",
        progress=make_progress(name, "points"),
        judge=judge,
        **read_how(options),
    )
    summary = report.summarise_map(search, judge, _make_command(options))
    with keeps_results():
        files = report.write_map(search, judge, summary, folder)
        if not options.no_plots and can_draw():
            files.append(folder / "map.png")
            save_figure(report.draw_map(search), files[-1], report.COMMAND)
        files.append(folder / "summary.json")
        write_summary(summary, files[-1], files)
    return summary


def _make_order(options: argparse.Namespace) -> Order:
    """Return what the search is asked for."""
    axes = []
    for letter, given in (("x", options.x), ("y", options.y)):
        is_linear = getattr(options, f"linear_{letter}")
        axis = Axis(*parse_range(f"--{letter}", given), is_log=not is_linear)
        if not is_linear and axis.low <= 0.0:
            raise UsageError(
                f"--{letter} {' '.join(given)}: must be above 0 on a logarithmic axis: raise LOW"
                f" or add --linear-{letter}"
            )
        axes.append(axis)
    cells = options.points - 1
    coarse = min(_COARSE, max(2, cells // 2))
    return Order(
        options.scene,
        tuple(axes),
        (),
        read_settings(options),
        make_experiment(options.stop, options.step),
        tolerance=min(0.25, 0.5 / cells),
        coarse=coarse,
        checks=0,
    )


def _make_command(options: argparse.Namespace) -> str:
    """Return the command that makes the map again."""
    words = ["dockloop", "map", options.scene, "--x", *options.x, "--y", *options.y]
    words += [f"--linear-{letter}" for letter in "xy" if getattr(options, f"linear_{letter}")]
    words += ["--host", options.host] if options.host else []
    words += ["--assured"] if options.assured else []
    names = ["accuracy", "error", "points", "stop", "step"] + ["limit"] * (options.limit != LIMIT)
    return shlex.join(words + list_words(options, names, _to_word))


def _to_word(value: float | str) -> str:
    """Return a number with all its digits; what is a text stays as it is."""
    if isinstance(value, str):
        return value
    short = f"{value:g}"
    return short if float(short) == value else repr(value)
