"""``dockloop trade``: what accuracy costs."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.base.words import list_words
from dockloop.commands.arguments import Command, Options, finite
from dockloop.commands.console import write_found

if TYPE_CHECKING:
    from dockloop.studies.trades.bench import Bench

EXAMPLE = "example: dockloop trade absorber_1d --methods explicit,bdf --tolerances 1e-4,1e-8"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    command.add_option("--levels", "L,...", "only these levels of the model")
    command.add_option("--methods", "M,...", "only these methods, e.g. explicit,bdf")
    command.add_option("--tolerances", "R,...", "relative tolerances to try")
    command.add_option("--steps", "H,...", "communication steps to try [s]")
    text = "end of the runs [s] (default: a second after the capture, or that of the scene)"
    command.add_option("--stop", "T", text, type=finite)
    command.add_flag(
        "--quick",
        "a small grid: methods of the product, all at the same two communication steps, each"
        " setting timed once; the reference solution is the FMU at its tightest tolerance",
    )
    command.add_option(
        "--apply",
        "ERROR",
        "write the cheapest setting with this error into a copy of the scene (its name is"
        " printed; with -o FILE.toml it is that file)",
    )
    command.add_flag("--resume", "go on after an interruption")
    command.add_output(
        "FOLDER",
        "for tables, figure and journal (default: build/results/trade_SCENE); with --apply"
        " also FILE.toml, the copy of the scene",
    )
    command.add_flag("--json", "print the summary as JSON")


def run(options: Options) -> None:
    """Measure: runs, tables, figure, recommendation."""
    from dockloop.base.files import claim
    from dockloop.base.progress import ProgressBar
    from dockloop.scene.find import find_scene
    from dockloop.studies.trades import report, run_trade
    from dockloop.studies.trades.command import make_bench, make_choice
    from dockloop.sweeps.journal import keeps_results

    choice = make_choice(
        *(options.levels, options.methods, options.tolerances, options.steps, options.stop),
        quick=options.quick,
    )
    name = find_scene(options.scene).stem
    copy = _find_copy(options)
    given = None if copy is not None and copy == options.output else options.output
    folder = given or paths.RESULTS / "results" / f"trade_{name}"
    for file, kind in report.KINDS.items():
        claim(folder / file, kind)
    bench = make_bench(options.scene, options.overrides, choice)
    progress = ProgressBar(name)
    measured = run_trade(bench, choice, folder, resume=options.resume, progress=progress)
    summary = report.summarise_trade(measured, _make_command(options))
    with keeps_results():
        summary["files"] = [paths.shown(file) for file in report.write_trade(summary, folder)]
    if copy is not None:
        _apply(options, bench, summary, copy)
    write_found(options, summary, report.report_trade)


def _find_copy(options: Options) -> Path | None:
    """Return the copy of the scene that --apply writes, made sure that it can be; None without."""
    from dockloop.base.files import claim
    from dockloop.studies.trades.apply import SCENE, name_copy, parse_error

    if options.apply is None:
        if options.output and options.output.suffix == ".toml":
            raise UsageError(f"-o {options.output}: is a folder here: a scene needs --apply ERROR")
        return None
    if options.overrides:
        raise UsageError(
            f"--scene {options.overrides[0]}: has no place in the copy that --apply writes: put it"
            " into the scene file"
        )
    wanted = parse_error(options.apply)
    is_file = options.output and options.output.suffix == ".toml"
    copy: Path = options.output if is_file else name_copy(options.scene, wanted)
    claim(copy, SCENE)
    return copy


def _apply(options: Options, bench: "Bench", summary: dict, copy: Path) -> None:
    """Write the copy of the scene; the summary names it."""
    from dockloop.scene.copies import write_copy
    from dockloop.studies.trades.apply import BEGIN, SCENE, choose_row, make_keys, parse_error

    row = choose_row(summary["rows"], parse_error(options.apply), bench.step)
    keys = make_keys(row, bench)
    note = f"error {row['error']:.1e}, measured by `{summary['command']}`"
    write_copy(options.scene, keys, copy, SCENE, begin=BEGIN, note=note)
    summary["applied"] = {"file": paths.shown(copy), "setting": row["setting"], "keys": keys}
    summary["files"].append(paths.shown(copy))


def _make_command(options: Options) -> str:
    """Return the command that repeats the trade."""
    scene = Path(options.scene)
    words = ["dockloop", "trade", scene.name if scene.is_absolute() else options.scene]
    words += list_words(options, ("levels", "methods", "tolerances", "steps", "stop", "apply"))
    return shlex.join(words + ["--quick"] * options.quick)
