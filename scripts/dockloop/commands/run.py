"""``dockloop run``: one docking through its FMU."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.base.words import list_words
from dockloop.commands.arguments import Command, Options, file_path, finite
from dockloop.commands.console import write_found

if TYPE_CHECKING:
    from dockloop.result.recording import Result

EXAMPLE = "example: dockloop run idss_25t_350t --set friction.coefficient=0.2 --stop 12"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument("scene", metavar="SCENE|FILE.fmu", help="a scene (built first), or an FMU")
    command.add_scene_keys()
    command.add_run()
    command.add_kernel()
    text = "start values of a file of SSP; what --set says comes later"
    command.add_option("--ssv", "FILE.ssv", text, type=file_path)
    command.add_output(
        "RESULT",
        "result file, .csv, .xlsx, .parquet, .npz, .mat or .h5; RESULT_summary.json (with the"
        " units) and plots are written next to it (default: build/results/SCENE/SCENE.csv)",
    )
    command.add_list(
        "--outputs",
        "outputs",
        "TEXT",
        "write only outputs with this text in their name; with *, names that are like it as a"
        " whole (repeatable; default: all)",
    )
    command.add_flag("--units-row", "write a row of units under the header of a .csv")
    text = "refuse to write a larger result file (default: 1)"
    command.add_option("--max-gigabytes", "GB", text, type=finite, default=1.0)
    command.add_option(
        "--accuracy",
        "ERROR",
        "wanted relative error of peak loads, stroke, time of capture and final motion, or"
        " real-time: as --set accuracy=ERROR",
    )
    command.add_flag(
        "--estimate-error",
        "run again with tighter tolerances and state the error of this run; with a simplified"
        " model.level also with every body: what that level costs in the same quantities",
    )
    command.add_assured()
    command.add_flag("--no-plots", "do not draw figures")
    command.add_flag("--view", "write RESULT_view.html, the motion in three dimensions")
    command.add_report("RESULT_report.html")
    command.add_flag("--json", "print the summary as JSON")


def run(options: Options) -> None:
    """Run the docking: FMU, recording, summary, result file, plots."""
    from dockloop.base.files import scratch
    from dockloop.base.progress import ProgressBar, import_optional
    from dockloop.fmu.build import build_fmu
    from dockloop.fmu.host import run_fmu
    from dockloop.native.variables import fits
    from dockloop.report.run import report_run
    from dockloop.result.accuracy import estimate_error
    from dockloop.result.recording import check_size
    from dockloop.result.summary import SUFFIXES, summarise
    from dockloop.runs.assured import ESTIMATED_TOO, assure
    from dockloop.scene.carried import read_scene
    from dockloop.scene.find import find_scene
    from dockloop.scene.resolve import list_matches

    is_fmu = options.scene.endswith(".fmu")
    if is_fmu and (options.overrides or options.kernel is not None):
        raise UsageError("--scene and --kernel change what is built; for an FMU use --set")
    if options.output and options.output.suffix not in SUFFIXES:
        raise UsageError(f"-o {options.output}: must end in {', '.join(SUFFIXES)}")

    fmu = Path(options.scene)
    name = read_scene(fmu)["name"] if is_fmu else find_scene(options.scene).stem
    file = options.output or paths.RESULTS / "results" / name / f"{name}.csv"
    if package := SUFFIXES[file.suffix]:
        import_optional(package)
    if options.units_row and file.suffix != ".csv":
        raise UsageError(f"--units-row: is for .csv; {file.name} has its units anyway")
    _claim(options, file)
    if options.assured and options.estimate_error:
        raise UsageError(ESTIMATED_TOO)
    is_compared = options.estimate_error or options.assured
    everything = ["*"] if is_compared and options.outputs else []

    with _blaming(options), scratch() as folder:
        if not is_fmu:
            made = folder / f"{name}.fmu"
            fmu = build_fmu(options.scene, options.overrides, made, options.kernel, bare=True)

        given_by = _complete_settings(options, fmu)

        def repeat(other: dict[str, float]) -> "Result":
            settings = [*options.set, *(f"{name}={value!r}" for name, value in other.items())]
            progress = ProgressBar(f"{fmu.stem}, another run")
            return run_fmu(fmu, settings, options.stop, options.step, progress=progress)

        result = run_fmu(
            fmu,
            options.set,
            options.stop,
            options.step,
            outputs=[*options.outputs, *everything],
            check_size=lambda points, columns: check_size(
                points, columns, file.suffix, options.max_gigabytes
            ),
            progress=ProgressBar(fmu.stem),
            label=paths.shown(fmu) if is_fmu else f"scene {fmu.stem}",
            given_by=given_by,
        )
        if not is_fmu:
            result.notes += list_matches(find_scene(options.scene), options.overrides)
        if options.estimate_error:
            result.error_estimate = estimate_error(result, repeat)
        if options.assured:
            chosen = [n for n in result.names if any(fits(n, t) for t in options.outputs)]
            result = assure(result, repeat, chosen)

    summary = summarise(result)
    _write_files(options, result, summary, file)
    write_found(options, summary, report_run)


def _blaming(options: Options) -> AbstractContextManager[None]:
    """Return what lets a refused start begin with the option that has changed the scene."""
    from dockloop.scene.find import find_scene
    from dockloop.scene.placement import blaming_start

    if options.scene.endswith(".fmu"):
        return nullcontext()
    path = find_scene(options.scene)
    return blaming_start(path, options.overrides, f"scene {path.stem}: ")


def _complete_settings(options: Options, fmu: Path) -> dict[str, str]:
    """Put all start values into ``--set``, where the last one holds; returns what gave the others.

    Raises UsageError: a file of start values is bad.
    """
    from dockloop.fmu.ssv import read_ssv

    given_by = {}
    if options.ssv:
        read = read_ssv(options.ssv, fmu)
        given_by = dict.fromkeys(read, paths.shown(options.ssv))
        options.set = [*read, *options.set]
    if options.accuracy is not None:
        options.set.append(f"accuracy={options.accuracy}")
        given_by[options.set[-1]] = f"--accuracy {options.accuracy}"
    return given_by


def _claim(options: Options, file: Path) -> None:
    """Make sure that all files of a run can be written."""
    from dockloop.base.files import claim, figure_kind, json_kind
    from dockloop.base.sections import find_html, html_kind
    from dockloop.report.plots import list_plots
    from dockloop.result.summary import COMMAND, RESULT, find_summary
    from dockloop.view.page import PAGE

    claim(file, RESULT)
    claim(find_summary(file), json_kind("summary", COMMAND))
    for figure in [] if options.no_plots else list_plots(file.with_suffix("")):
        claim(figure, figure_kind(COMMAND))
    if options.view:
        claim(_find_view(file), PAGE)
    if options.report:
        claim(find_html(file), html_kind(COMMAND))


def _find_view(file: Path) -> Path:
    return file.with_name(f"{file.stem}_view.html")


def _write_files(options: Options, result: "Result", summary: dict, file: Path) -> None:
    """Write the files of a run; their names come into the summary."""
    from dockloop.base.figures import can_draw
    from dockloop.base.sections import find_html, write_html
    from dockloop.native.variables import fits
    from dockloop.report.plots import write_plots
    from dockloop.report.run import complete_report
    from dockloop.result.summary import COMMAND, find_summary, write_result, write_summary
    from dockloop.view.page import write_page

    if options.outputs:
        result = result.choose(lambda output: any(fits(output, text) for text in options.outputs))
    write_result(result, file, units_row=options.units_row)
    files = [file, find_summary(file)]
    if not options.no_plots and can_draw():
        files += write_plots(result, file.with_suffix(""))
    if options.report:
        sections = complete_report(
            summary,
            [file for file in files if file.suffix == ".png"],
            ["dockloop", "run", options.scene, *list_words(options, ("stop", "step", "kernel"))],
            _find_view(file) if options.view else None,
        )
        files.append(find_html(file))
        write_html(files[-1], COMMAND, sections)
    if options.view:
        files.append(_find_view(file))
        write_page(result, files[-1])
    write_summary(summary, files[1], files)
