"""The command line: ``dockloop build | ssp | run | view | compare | sweep | trade | truth | ...``.

Thin on purpose: arguments in, one call into the package, text and exit status out. Exit status:
0 done, 1 the work failed, 2 bad usage or a bad file. Errors are one sentence on standard error;
only a defect of this program shows a traceback, and only with ``--debug``.
"""

import argparse
import importlib
import json
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from dockloop import __version__, paths
from dockloop.arguments import (
    add_executor_options,
    add_report_option,
    add_run_options,
    add_scene,
    add_scene_option,
)
from dockloop.errors import DockloopError, UsageError, find_reason, one_line

_BUILD_EXAMPLE = (
    "example: dockloop build idss_25t_350t --scene initial.closing_speed=0.05 -o slow.fmu"
)
_NEW_EXAMPLE = "example: dockloop new my_docking --from apda"
_SSP_EXAMPLE = "example: dockloop ssp idss_25t_350t --scene experiment.step=0.002 -o docking.ssp"
_RUN_EXAMPLE = "example: dockloop run idss_25t_350t --set friction.coefficient=0.2 --stop 12"
_SWEEP_EXAMPLE = "example: dockloop sweep absorber_1d_speeds --engine core --workers 2 --csv"
_TRADE_EXAMPLE = "example: dockloop trade absorber_1d --methods explicit,bdf --tolerances 1e-4,1e-8"
_CHECK_EXAMPLE = "example: dockloop check apda --draw apda.svg"
_VARIABLES_EXAMPLE = "example: dockloop variables idss_25t_350t --match solver --match 'latch[1].*'"
_SOLUTION_EXAMPLE = (
    "example: dockloop truth absorber_1d --output relative.axial --stop 1 --step 0.1 --check"
)


class _ReaderGoneError(Exception):
    """The reader of our output has closed it."""


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one sentence, like all others."""

    def error(self, message: str) -> NoReturn:
        text = one_line(f"{self.prog}: {message}; see {self.prog} --help")
        self.exit(UsageError.exit_status, f"{text}\n")


def main(arguments: list[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: without the name of the program; default: those of the process.

    Returns:
        The exit status.
    """
    options = _make_parser().parse_args(arguments)
    if hasattr(sys.stdout, "reconfigure"):  # names of files may hold what a terminal cannot show
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        options.command(options)
        with _printing():
            print(end="", flush=True)
    except DockloopError as error:
        _say(str(error))
        return error.exit_status
    except _ReaderGoneError:
        return 0
    except KeyboardInterrupt:
        _say("interrupted")
        return 130
    except OSError as error:  # of a disk, a folder, a program: nothing that is wrong in here
        if options.debug:
            raise
        where = f"{paths.shown(str(error.filename))}: " if error.filename else ""
        _say(f"{where}{find_reason(error)}")
        return 1
    except Exception as error:
        if options.debug:
            raise
        _say(f"defect: {type(error).__name__}: {error}; --debug shows where")
        return 1
    return 0


def _say(text: str) -> None:
    """Say in one line why a command fails."""
    print(one_line(f"dockloop: {text}"), file=sys.stderr)


def _tell(text: str) -> None:
    """Print what a command found out; it arrives when the command is done."""
    with _printing():
        print(text)


@contextmanager
def _printing() -> Iterator[None]:
    """Say that standard output cannot be written when that is so."""
    try:
        yield
    except BrokenPipeError:
        sys.stdout = None
        raise _ReaderGoneError from None
    except OSError as error:
        sys.stdout = None
        raise DockloopError(f"standard output cannot be written ({find_reason(error)})") from None


def _make_parser() -> argparse.ArgumentParser:
    """Describe all commands."""
    parser = _Parser(
        prog="dockloop",
        description="Spacecraft docking dynamics as FMUs: build them, run them, check mechanisms.",
        epilog=_RUN_EXAMPLE,
    )
    parser.add_argument("--version", action="version", version=f"dockloop {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    new = _add(commands, "new", _new, "copy a scene and its mechanism, to be edited", _NEW_EXAMPLE)
    new.add_argument("name", metavar="NAME", help="of the copies NAME.toml and NAME.json")
    new.add_argument(
        "--from",
        dest="scene",
        default="idss_25t_350t",
        metavar="SCENE",
        help="a shipped scene or a file (default: idss_25t_350t)",
    )
    new.add_argument(
        "-o", "--output", type=Path, default=Path(), metavar="FOLDER", help="default: this folder"
    )

    build = _add(commands, "build", _build, "build the FMU of a scene", _BUILD_EXAMPLE)
    add_scene(build)
    build.add_argument(
        "-o", "--output", type=Path, metavar="FILE.fmu", help="default: build/fmu/SCENE.fmu"
    )
    build.add_argument(
        "--reference",
        action="store_true",
        help="run the default experiment and put its result into the FMU (folder extra)",
    )
    build.add_argument(
        "--kernel",
        action=argparse.BooleanOptionalAction,
        help="with compiled code of its own for the mechanism, or without (default: with it where"
        " there is a C compiler; results are the same)",
    )

    ssp = _add(
        commands,
        "ssp",
        _ssp,
        "build an SSP package: the docking FMU connected to one FMU per vehicle",
        _SSP_EXAMPLE,
    )
    add_scene(ssp)
    ssp.add_argument(
        "-o", "--output", type=Path, metavar="FILE.ssp", help="default: build/ssp/SCENE.ssp"
    )

    _add_run(commands)
    _add_view(commands)
    _add_compare(commands)

    sweep = _add(
        commands,
        "sweep",
        _sweep,
        "run many dockings: how many capture, and under which loads",
        _SWEEP_EXAMPLE,
    )
    sweep.add_argument("sweep", metavar="SWEEP", help="name of a shipped sweep, or a .toml file")
    sweep.add_argument(
        "--engine",
        choices=("auto", "core", "fmu"),
        default="auto",
        help="core: threads of one process; fmu: FMPy in Dask workers, for clusters;"
        " auto (default): core, unless there is a --scheduler; results are the same",
    )
    add_executor_options(sweep)
    sweep.add_argument(
        "--resume", action="store_true", help="go on with a sweep that was interrupted"
    )
    sweep.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="TABLE.parquet",
        help="the table; journal, TABLE_summary.json and plots are written next to it"
        " (default: build/sweeps/SWEEP/SWEEP.parquet)",
    )
    sweep.add_argument(
        "--accuracy",
        metavar="ERROR",
        help="wanted relative error of all cases, or real-time, as for dockloop run",
    )
    sweep.add_argument(
        "--refine",
        metavar="TEXT",
        help='run cases again that meet a criterion, e.g. "load_ratio > 0.8 or not captured", and'
        " cases with a step that failed",
    )
    sweep.add_argument(
        "--refine-accuracy",
        metavar="ERROR",
        help="wanted relative error of these; the report says what changed",
    )
    sweep.add_argument(
        "--rare",
        metavar="TEXT",
        help='estimate how rarely dockings fail, e.g. "load_ratio > 1" (a criterion as for dockloop'
        " envelope), with fewer dockings than plain sampling; writes TABLE_rare.json, no table",
    )
    sweep.add_argument(
        "--rare-cases",
        type=int,
        default=500,
        metavar="N",
        help="dockings in every level of --rare: more make the interval narrow (default: 500)",
    )
    sweep.add_argument("--csv", action="store_true", help="write the table as CSV too")
    sweep.add_argument("--no-plots", action="store_true", help="do not draw figures")
    add_report_option(sweep, "TABLE_report.html")
    sweep.add_argument("--json", action="store_true", help="print the summary as JSON")

    _add_envelope(commands)
    _add_map(commands)
    _add_trade(commands)

    check = _add(commands, "check", _check, "say whether a mechanism is sound", _CHECK_EXAMPLE)
    check.add_argument("mechanism", metavar="MECHANISM", help="name or .json file")
    check.add_argument(
        "--states",
        type=Path,
        metavar="FILE.json",
        help="evaluate the mechanism at these states and print accelerations and forces as JSON",
    )
    check.add_argument(
        "--draw",
        type=Path,
        metavar="FILE.svg",
        help="draw bodies, joints, cuts and force elements at home",
    )
    check.add_argument("--json", action="store_true", help="print the report as JSON")

    _add_extremes(commands)

    variables = _add(
        commands,
        "variables",
        _variables,
        "list what can be set and read: name, default, unit, limits, meaning",
        _VARIABLES_EXAMPLE,
    )
    add_scene(variables)
    variables.add_argument(
        "--match",
        dest="patterns",
        action="append",
        default=[],
        metavar="TEXT",
        help="only names with this text; with *, names that are like it as a whole (repeatable)",
    )
    variables.add_argument(
        "--states", action="store_true", help="with the states of model exchange and their rates"
    )
    variables.add_argument("--json", action="store_true", help="print the list as JSON")

    _add_solution(commands)
    return parser


def _add(
    commands: Any, name: str, function: Callable, text: str, example: str
) -> argparse.ArgumentParser:
    """Add one command to the parser."""
    command = commands.add_parser(name, help=text, description=text + ".", epilog=example)
    command.set_defaults(command=function)
    command.add_argument("--debug", action="store_true", help=argparse.SUPPRESS)
    return command


def _add_run(commands: Any) -> None:
    """Add the command that runs one docking."""
    run = _add(commands, "run", _run, "run one docking through its FMU", _RUN_EXAMPLE)
    run.add_argument("scene", metavar="SCENE|FILE.fmu", help="a scene (built first), or an FMU")
    add_scene_option(run)
    add_run_options(run)
    run.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="RESULT",
        help="result file, .csv, .npz or .parquet; RESULT_summary.json (with the units) and plots"
        " are written next to it (default: build/results/SCENE/SCENE.csv)",
    )
    run.add_argument(
        "--outputs",
        action="append",
        default=[],
        metavar="TEXT",
        help="write only outputs with this text in their name; with *, names that are like it as a"
        " whole (repeatable; default: all)",
    )
    run.add_argument(
        "--max-gigabytes",
        type=float,
        default=1.0,
        metavar="GB",
        help="refuse to write a larger result file (default: 1)",
    )
    run.add_argument(
        "--accuracy",
        metavar="ERROR",
        help="wanted relative error of peak loads, stroke, time of capture and final motion, or"
        " real-time: as --set accuracy=ERROR",
    )
    run.add_argument(
        "--estimate-error",
        action="store_true",
        help="run again with tighter tolerances and state the error of this run; with a simplified"
        " model.level also with every body: what that level costs in the same quantities",
    )
    run.add_argument("--no-plots", action="store_true", help="do not draw figures")
    run.add_argument(
        "--view", action="store_true", help="write RESULT_view.html, the motion in three dimensions"
    )
    add_report_option(run, "RESULT_report.html")
    run.add_argument("--json", action="store_true", help="print the summary as JSON")


def _add_view(commands: Any) -> None:
    """Add the command that shows the motion."""
    from dockloop.view.options import EXAMPLE, add_arguments

    text = "write a page that shows a docking in three dimensions; it opens offline"
    add_arguments(_add(commands, "view", _view, text, EXAMPLE))


def _add_compare(commands: Any) -> None:
    """Add the command that lays measurements over a run."""
    from dockloop.measured.options import EXAMPLE, add_arguments

    text = "lay measured time histories over a run: time shift, peaks, energies, differences"
    add_arguments(_add(commands, "compare", _compare, text, EXAMPLE))


def _add_envelope(commands: Any) -> None:
    """Add the command that finds the boundary of a criterion."""
    from dockloop.envelopes.options import EXAMPLE, add_arguments

    text = "find where dockings meet a criterion: its boundary in two or three quantities"
    add_arguments(_add(commands, "envelope", _envelope, text, EXAMPLE))


def _add_map(commands: Any) -> None:
    """Add the command that maps where a scene holds."""
    from dockloop.maps.options import EXAMPLE, add_arguments

    text = "map where a scene is right, refused or wrong over two quantities, and what that costs"
    add_arguments(_add(commands, "map", _map, text, EXAMPLE))


def _add_solution(commands: Any) -> None:
    """Add the command that integrates with 32 digits."""
    solution = _add(
        commands,
        "truth",
        _solution,
        "integrate a scene with 32 digits, to measure errors against",
        _SOLUTION_EXAMPLE,
    )
    add_scene(solution)
    add_run_options(solution)
    solution.add_argument(
        "--output",
        dest="outputs",
        action="append",
        required=True,
        metavar="NAME",
        help="FMU variable to write (repeatable)",
    )
    solution.add_argument(
        "--tolerance",
        type=float,
        default=1e-18,
        metavar="TOL",
        help="of the steps inside, relative (default: 1e-18)",
    )
    solution.add_argument(
        "--check",
        action="store_true",
        help="run again with 1000 times the tolerance and state the differences",
    )
    solution.add_argument(
        "-o",
        "--file",
        type=Path,
        metavar="FILE.json",
        help="default: build/results/SCENE/SCENE_truth.json",
    )


def _add_trade(commands: Any) -> None:
    """Add the command that measures what accuracy costs."""
    trade = _add(
        commands,
        "trade",
        _trade,
        "measure what accuracy costs: settings against the reference solution, and what pays",
        _TRADE_EXAMPLE,
    )
    add_scene(trade)
    trade.add_argument("--levels", metavar="L,...", help="only these levels of the model")
    trade.add_argument("--methods", metavar="M,...", help="only these methods, e.g. explicit,bdf")
    trade.add_argument("--tolerances", metavar="R,...", help="relative tolerances to try")
    trade.add_argument("--steps", metavar="H,...", help="communication steps to try [s]")
    trade.add_argument(
        "--stop",
        type=float,
        metavar="T",
        help="end of the runs [s] (default: a second after the capture, or that of the scene)",
    )
    trade.add_argument(
        "--quick",
        action="store_true",
        help="a small grid: methods of the product, all at the same two communication steps, each"
        " setting timed once; the reference solution is the FMU at its tightest tolerance",
    )
    trade.add_argument(
        "--apply",
        metavar="ERROR",
        help="write the cheapest setting with this error into a copy of the scene (its name is"
        " printed; with -o FILE.toml it is that file)",
    )
    trade.add_argument("--resume", action="store_true", help="go on after an interruption")
    trade.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="for tables, figure and journal (default: build/results/trade_SCENE); with --apply"
        " also FILE.toml, the copy of the scene",
    )
    trade.add_argument("--json", action="store_true", help="print the summary as JSON")


def _add_extremes(commands: Any) -> None:
    """Add the command that judges random scenes."""
    from dockloop.extremes.options import EXAMPLE, add_arguments

    text = "judge whole scenes drawn at random over many decades"
    add_arguments(_add(commands, "extremes", _extremes, text, EXAMPLE))


def _build(options: argparse.Namespace) -> None:
    """Build an FMU and say where it is."""
    from dockloop.fmu import build_fmu
    from dockloop.reference import add_reference

    notes: list[str] = []  # issued when the FMU is there
    finish = add_reference if options.reference else None
    fmu = build_fmu(
        options.scene,
        options.overrides,
        options.output,
        options.kernel,
        notes.append,
        finish=finish,
    )
    _tell("\n".join([*notes, f"{paths.shown(fmu)} ({fmu.stat().st_size / 1e6:.1f} MB)"]))


def _ssp(options: argparse.Namespace) -> None:
    """Build an SSP package and say where it is."""
    from dockloop.ssp import build_ssp

    package = build_ssp(options.scene, options.overrides, options.output)
    _tell(f"{paths.shown(package)} ({package.stat().st_size / 1e6:.1f} MB)")


def _run(options: argparse.Namespace) -> None:
    """Run one docking: FMU, recording, summary, result file, plots."""
    from dockloop.fmu import build_fmu
    from dockloop.outputs import scratch
    from dockloop.results import check_size, import_optional
    from dockloop.scene import find_scene
    from dockloop.simulate import ProgressBar, read_scene, run_fmu
    from dockloop.summary import describe, summarise

    is_fmu = options.scene.endswith(".fmu")
    if is_fmu and options.overrides:
        raise UsageError("--scene changes a scene before it is built; for an FMU use --set")
    if options.output and options.output.suffix not in (".csv", ".npz", ".parquet"):
        raise UsageError(f"-o {options.output}: must end in .csv, .npz or .parquet")

    fmu = Path(options.scene)
    name = read_scene(fmu)["name"] if is_fmu else find_scene(options.scene).stem
    result = options.output or paths.BUILD / "results" / name / f"{name}.csv"
    if result.suffix == ".parquet":
        import_optional("pyarrow")
    _claim_run(options, result)
    if options.accuracy is not None:
        options.set.append(f"accuracy={options.accuracy}")
    everything = ["*"] if options.estimate_error and options.outputs else []  # is compared

    with scratch() as folder:
        if not is_fmu:
            fmu = build_fmu(options.scene, options.overrides, folder / f"{name}.fmu", bare=True)
        run = run_fmu(
            fmu,
            options.set,
            options.stop,
            options.step,
            outputs=[*options.outputs, *everything],
            check_size=lambda points, columns: check_size(
                points, columns, result.suffix, options.max_gigabytes
            ),
            progress=ProgressBar(fmu.stem),
            label=paths.shown(fmu) if is_fmu else f"scene {fmu.stem}",
        )
        if options.estimate_error:
            run.error_estimate = _estimate_error(options, fmu, run)

    summary = summarise(run)
    _write_run(options, run, summary, result)
    _tell(json.dumps(summary, indent=2) if options.json else describe(summary))


def _estimate_error(options: argparse.Namespace, fmu: Path, run: Any) -> dict:
    """Return the error of a run, by a second run; that of a simplified level, by a third one."""
    from dockloop.accuracy import estimate_error
    from dockloop.simulate import ProgressBar, run_fmu

    def repeat(other: dict[str, float]) -> Any:
        settings = [*options.set, *(f"{name}={value!r}" for name, value in other.items())]
        progress = ProgressBar(f"{fmu.stem}, another run")
        return run_fmu(fmu, settings, options.stop, options.step, progress=progress)

    return estimate_error(run, repeat)


def _claim_run(options: argparse.Namespace, result: Path) -> None:
    """Make sure that all files of a run can be written."""
    from dockloop import html_report
    from dockloop.outputs import claim, figure_kind, json_kind
    from dockloop.plots import list_plots
    from dockloop.summary import COMMAND, RESULT, find_summary
    from dockloop.view.page import PAGE

    claim(result, RESULT)
    claim(find_summary(result), json_kind("summary", COMMAND))
    for file in [] if options.no_plots else list_plots(result.with_suffix("")):
        claim(file, figure_kind(COMMAND))
    if options.view:
        claim(_find_view(result), PAGE)
    if options.report:
        claim(html_report.find_page(result), html_report.page_kind(COMMAND))


def _find_view(result: Path) -> Path:
    return result.with_name(f"{result.stem}_view.html")


def _write_run(options: argparse.Namespace, run: Any, summary: dict, result: Path) -> None:
    """Write the files of a run; their names come into the summary."""
    from dockloop import html_report
    from dockloop.figures import can_draw
    from dockloop.plots import write_plots
    from dockloop.summary import COMMAND, find_summary, write_result, write_summary
    from dockloop.variables import fits
    from dockloop.view.page import write_page

    if options.outputs:
        run = run.choose(lambda output: any(fits(output, text) for text in options.outputs))
    write_result(run, result)
    files = [result, find_summary(result)]
    if not options.no_plots and can_draw():
        files += write_plots(run, result.with_suffix(""))
    if options.report:
        figures = [file for file in files if file.suffix == ".png"]
        sections = html_report.report_run(
            summary,
            figures,
            _repeat("run", options.scene, options, ("stop", "step")),
            _find_view(result) if options.view else None,
        )
        files.append(html_report.find_page(result))
        html_report.write_page(files[-1], COMMAND, summary["title"], sections)
    if options.view:
        files.append(_find_view(result))
        write_page(run, files[-1])
    summary["files"] = [paths.shown(file) for file in files]
    write_summary(summary, files[1])


def _repeat(
    command: str, scene: str, options: argparse.Namespace, names: Sequence[str]
) -> list[str]:
    """Return the words that repeat a command; where it writes does not matter."""
    words = ["dockloop", command, scene]
    for option, texts in (("--scene", options.overrides), ("--set", getattr(options, "set", []))):
        words += [word for text in texts for word in (option, text)]
    for name in names:
        value = getattr(options, name)
        words += [] if value is None else [f"--{name}", str(value)]
    return words


def _view(options: argparse.Namespace) -> None:
    """Write the page, stills or film of a docking."""
    from dockloop.view.command import view

    _tell(view(options))


def _compare(options: argparse.Namespace) -> None:
    """Lay measurements over a run, write numbers and figure."""
    from dockloop.measured.command import describe, run_command

    found = run_command(options)
    _tell(json.dumps(found, indent=2) if options.json else describe(found))


def _sweep(options: argparse.Namespace) -> None:
    """Run a sweep: cases, table, summary, plots."""
    if options.output and options.output.suffix != ".parquet":
        raise UsageError(f"-o {options.output}: must end in .parquet")
    if options.engine == "core" and options.scheduler:
        raise UsageError("--engine core runs on this machine; a --scheduler needs --engine fmu")
    uses_dask = options.engine == "fmu" or options.scheduler
    try:
        for package in ("pyarrow", "scipy", *(["distributed"] if uses_dask else [])):
            importlib.import_module(package)
    except ImportError as error:
        raise DockloopError(
            f"sweeps need the package {error.name}: pip install 'dockloop[sweep]'; in a clone"
            " .venv/bin/pip install -e '.[sweep]'"
        ) from None
    from dockloop import html_report, sweep_report
    from dockloop.figures import can_draw
    from dockloop.outputs import claim
    from dockloop.sampling import read_passes, read_sweep
    from dockloop.simulate import ProgressBar
    from dockloop.summary import find_summary, write_summary
    from dockloop.sweeps import COMMAND, run_sweep
    from dockloop.view.page import PAGE

    passes = read_passes(options.accuracy, options.refine, options.refine_accuracy)
    if passes and passes.refine and options.rare:
        raise UsageError("--rare and --refine: give one of them")
    sweep = read_sweep(options.sweep, passes)
    name = sweep.path.stem
    output = options.output or paths.BUILD / "sweeps" / name / f"{name}.parquet"
    plots = not options.no_plots
    if options.rare:
        _rare(options, sweep, output)
        return
    for file, kind in sweep_report.list_files(output, as_csv=options.csv, plots=plots):
        claim(file, kind)
    if options.report:
        claim(html_report.find_page(output), html_report.page_kind(COMMAND))
        for file in sweep_report.list_views(output):
            claim(file, PAGE)
    ran = run_sweep(
        sweep,
        output,
        engine=options.engine,
        workers=options.workers,
        scheduler=options.scheduler,
        resume=options.resume,
        progress=ProgressBar(name),
    )
    planner, sweep = ran["planner"], ran["sweep"]
    files = sweep_report.write_table(
        sweep, planner, ran["results"], ran["first"], output, as_csv=options.csv
    )
    table = sweep_report.TableFile(output)
    summary = sweep_report.summarise_sweep(sweep, planner, table, ran)
    if plots and can_draw():
        files += sweep_report.write_sweep_plots(sweep, planner, table, output.with_suffix(""))
    if options.report:
        figures = [file for file in files if file.suffix == ".png"]
        views = sweep_report.write_views(sweep, planner, table, output)
        sections = html_report.report_sweep(summary, sweep, planner, table, figures, views=views)
        files += [*views.values(), html_report.find_page(output)]
        html_report.write_page(files[-1], COMMAND, summary["title"], sections)
    files.append(find_summary(output))
    summary["files"] = [paths.shown(file) for file in files]
    write_summary(summary, files[-1])
    _tell(json.dumps(summary, indent=2) if options.json else sweep_report.describe_sweep(summary))
    if "done" not in summary["status"]:
        raise DockloopError(f"no case was done, for example: {summary['reasons']['example']}")


def _rare(options: argparse.Namespace, sweep: Any, output: Path) -> None:
    """Estimate how rarely the dockings of a sweep fail."""
    from dockloop import rare
    from dockloop.outputs import claim
    from dockloop.simulate import ProgressBar
    from dockloop.summary import write_summary

    file, journal = rare.name_files(output)
    claim(file, rare.SUMMARY)
    summary = rare.run_rare(
        sweep,
        options.rare,
        options.rare_cases,
        journal,
        engine=options.engine,
        workers=options.workers,
        scheduler=options.scheduler,
        resume=options.resume,
        progress=ProgressBar(sweep.path.stem),
    )
    summary["files"] = [paths.shown(file)]
    write_summary(summary, file)
    _tell(json.dumps(summary, indent=2) if options.json else rare.describe_rare(summary))


def _envelope(options: argparse.Namespace) -> None:
    """Find the boundary of criteria: dockings, tables, summary, figure."""
    from dockloop.envelopes.command import run_command
    from dockloop.envelopes.report import describe_envelope

    summary = run_command(options)
    _tell(json.dumps(summary, indent=2) if options.json else describe_envelope(summary))


def _map(options: argparse.Namespace) -> None:
    """Map right, refused and wrong over two quantities: page, picture, table."""
    from dockloop.maps.command import run_command
    from dockloop.maps.report import describe_map

    summary = run_command(options)
    _tell(json.dumps(summary, indent=2) if options.json else describe_map(summary))


def _trade(options: argparse.Namespace) -> None:
    """Measure what accuracy costs: runs, tables, figure, recommendation."""
    from dockloop.outputs import claim
    from dockloop.scene import find_scene
    from dockloop.simulate import ProgressBar
    from dockloop.trades import report, run_trade
    from dockloop.trades.command import make_bench, make_choice

    choice = make_choice(
        *(options.levels, options.methods, options.tolerances, options.steps, options.stop),
        quick=options.quick,
    )
    name = find_scene(options.scene).stem
    copy = _find_copy(options)
    given = None if copy is not None and copy == options.output else options.output
    folder = given or paths.BUILD / "results" / f"trade_{name}"
    for file, kind in report.list_files(folder):
        claim(file, kind)
    bench = make_bench(options.scene, options.overrides, choice)
    progress = ProgressBar(name)
    measured = run_trade(bench, choice, folder, resume=options.resume, progress=progress)
    summary = report.summarise_trade(measured, _trade_command(options))
    summary["files"] = [paths.shown(file) for file in report.write_trade(summary, folder)]
    if copy is not None:
        _apply(options, bench, summary, copy)
    _tell(json.dumps(summary, indent=2) if options.json else report.describe_trade(summary))


def _find_copy(options: argparse.Namespace) -> Path | None:
    """Return the copy of the scene that --apply writes, made sure that it can be; None without."""
    from dockloop.outputs import claim
    from dockloop.trades.apply import SCENE, name_copy, parse_error

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


def _apply(options: argparse.Namespace, bench: Any, summary: dict, copy: Path) -> None:
    """Write the copy of the scene; the summary names it."""
    from dockloop.trades.apply import choose_row, make_keys, parse_error, write_copy

    row = choose_row(summary["rows"], parse_error(options.apply), bench.step)
    keys = make_keys(row, bench)
    write_copy(options.scene, keys, row, summary["command"], copy)
    summary["applied"] = {"file": paths.shown(copy), "setting": row["setting"], "keys": keys}
    summary["files"].append(paths.shown(copy))


def _trade_command(options: argparse.Namespace) -> str:
    """Return the command that repeats a trade."""
    scene = Path(options.scene)
    name = scene.name if scene.is_absolute() else options.scene
    words = _repeat("trade", name, options, ("levels", "methods", "tolerances", "steps", "stop"))
    words += ["--apply", options.apply] * (options.apply is not None)
    return shlex.join(words + ["--quick"] * options.quick)


def _check(options: argparse.Namespace) -> None:
    """Check a mechanism."""
    from dockloop.mechanism import check_mechanism, describe_report, draw

    if options.draw and options.states:
        raise UsageError("--draw shows the mechanism at home: leave --states away")
    if options.draw and options.draw.suffix != ".svg":
        raise UsageError(f"--draw {options.draw}: must end in .svg")
    report = check_mechanism(options.mechanism, options.states)
    if options.draw:
        draw(options.mechanism, report, options.draw)
    if options.json or options.states:
        _tell(json.dumps(report, indent=2))
    else:
        _tell(describe_report(report))


def _new(options: argparse.Namespace) -> None:
    """Copy a scene and its mechanism."""
    from dockloop.copies import copy_scene, describe

    _tell(describe(copy_scene(options.scene, options.name, options.output)))


def _variables(options: argparse.Namespace) -> None:
    """List what can be set and read in a scene."""
    from dockloop.catalogue import describe, list_entries, to_document

    entries = list_entries(
        options.scene, options.overrides, options.patterns, has_states=options.states
    )
    document = to_document(options.scene, entries)
    _tell(json.dumps(document, indent=2) if options.json else describe(entries))


def _extremes(options: argparse.Namespace) -> None:
    """Judge random scenes; a bad one is a failure."""
    from dockloop.extremes import random_report

    summary = random_report.run_command(options)
    text = random_report.describe(summary)
    _tell(json.dumps(summary) if options.json else text)
    if summary["bad"]:
        first = summary["bad"][0]
        raise DockloopError(
            f"extremes: {len(summary['bad'])} of {summary['scenes']} scenes are bad, the first one:"
            f" {first['repeat']}: {first['reason']}"
        )


def _solution(options: argparse.Namespace) -> None:
    """Integrate with extended precision, write the document, say what it took."""
    from dockloop.outputs import MADE_BY, claim, write_text
    from dockloop.scene import find_scene
    from dockloop.simulate import ProgressBar
    from dockloop.solution import FILE, make_solution

    name = find_scene(options.scene).stem
    file = options.file or paths.BUILD / "results" / name / f"{name}_truth.json"
    claim(file, FILE)
    solution = make_solution(
        options.scene,
        options.outputs,
        overrides=options.overrides,
        settings=options.set,
        stop=options.stop,
        step=options.step,
        tolerance=options.tolerance,
        check=options.check,
        progress=ProgressBar("truth"),
    )
    document = {MADE_BY: FILE.command, **solution}
    write_text(file, FILE, json.dumps(document, indent=1) + "\n")
    work = solution["work"]
    _tell(
        f"{paths.shown(file)}: {len(solution['time'])} time points,"
        f" {work['steps']:.0f} steps, {work['evaluations']:.0f} evaluations"
    )
    for output, difference in solution.get("check", {}).get("difference", {}).items():
        _tell(f"  {output}: {difference:.2g} from the run with 1000 times the tolerance")
