"""``dockloop run``: one docking through its FMU."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dockloop import paths
from dockloop.arguments import Command, Options, finite, list_words
from dockloop.console import write_found
from dockloop.errors import UsageError

if TYPE_CHECKING:
    from dockloop.results import Result

EXAMPLE = "example: dockloop run idss_25t_350t --set friction.coefficient=0.2 --stop 12"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument("scene", metavar="SCENE|FILE.fmu", help="a scene (built first), or an FMU")
    command.add_scene_keys()
    command.add_run()
    command.add_output(
        "RESULT",
        "result file, .csv, .npz or .parquet; RESULT_summary.json (with the units) and plots"
        " are written next to it (default: build/results/SCENE/SCENE.csv)",
    )
    command.add_list(
        "--outputs",
        "outputs",
        "TEXT",
        "write only outputs with this text in their name; with *, names that are like it as a"
        " whole (repeatable; default: all)",
    )
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
    command.add_flag("--no-plots", "do not draw figures")
    command.add_flag("--view", "write RESULT_view.html, the motion in three dimensions")
    command.add_report("RESULT_report.html")
    command.add_flag("--json", "print the summary as JSON")


def run(options: Options) -> None:
    """Run the docking: FMU, recording, summary, result file, plots."""
    from dockloop.fmu import build_fmu
    from dockloop.outputs import scratch
    from dockloop.results import ProgressBar, check_size, import_optional
    from dockloop.scene import find_scene, list_matches
    from dockloop.simulate import read_scene, run_fmu
    from dockloop.summary import describe, summarise

    is_fmu = options.scene.endswith(".fmu")
    if is_fmu and options.overrides:
        raise UsageError("--scene changes a scene before it is built; for an FMU use --set")
    if options.output and options.output.suffix not in (".csv", ".npz", ".parquet"):
        raise UsageError(f"-o {options.output}: must end in .csv, .npz or .parquet")

    fmu = Path(options.scene)
    name = read_scene(fmu)["name"] if is_fmu else find_scene(options.scene).stem
    file = options.output or paths.RESULTS / "results" / name / f"{name}.csv"
    if file.suffix == ".parquet":
        import_optional("pyarrow")
    _claim(options, file)
    if options.accuracy is not None:
        options.set.append(f"accuracy={options.accuracy}")
    everything = ["*"] if options.estimate_error and options.outputs else []  # is compared

    with scratch() as folder:
        if not is_fmu:
            fmu = build_fmu(options.scene, options.overrides, folder / f"{name}.fmu", bare=True)
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
        )
        if not is_fmu:
            result.notes += list_matches(find_scene(options.scene), options.overrides)
        if options.estimate_error:
            result.error_estimate = _estimate_error(options, fmu, result)

    summary = summarise(result)
    _write_files(options, result, summary, file)
    write_found(options, summary, describe)


def _estimate_error(options: Options, fmu: Path, result: "Result") -> dict:
    """Return the error of a run, by a second run; that of a simplified level, by a third one."""
    from dockloop.accuracy import estimate_error
    from dockloop.results import ProgressBar
    from dockloop.simulate import run_fmu

    def repeat(other: dict[str, float]) -> Any:
        settings = [*options.set, *(f"{name}={value!r}" for name, value in other.items())]
        progress = ProgressBar(f"{fmu.stem}, another run")
        return run_fmu(fmu, settings, options.stop, options.step, progress=progress)

    return estimate_error(result, repeat)


def _claim(options: Options, file: Path) -> None:
    """Make sure that all files of a run can be written."""
    from dockloop import html_report
    from dockloop.outputs import claim, figure_kind, json_kind
    from dockloop.plots import list_plots
    from dockloop.summary import COMMAND, RESULT, find_summary
    from dockloop.view.page import PAGE

    claim(file, RESULT)
    claim(find_summary(file), json_kind("summary", COMMAND))
    for figure in [] if options.no_plots else list_plots(file.with_suffix("")):
        claim(figure, figure_kind(COMMAND))
    if options.view:
        claim(_find_view(file), PAGE)
    if options.report:
        claim(html_report.find_page(file), html_report.page_kind(COMMAND))


def _find_view(file: Path) -> Path:
    return file.with_name(f"{file.stem}_view.html")


def _write_files(options: Options, result: "Result", summary: dict, file: Path) -> None:
    """Write the files of a run; their names come into the summary."""
    from dockloop import html_report
    from dockloop.figures import can_draw
    from dockloop.plots import write_plots
    from dockloop.summary import COMMAND, find_summary, write_result, write_summary
    from dockloop.variables import fits
    from dockloop.view.page import write_page

    if options.outputs:
        result = result.choose(lambda output: any(fits(output, text) for text in options.outputs))
    write_result(result, file)
    files = [file, find_summary(file)]
    if not options.no_plots and can_draw():
        files += write_plots(result, file.with_suffix(""))
    if options.report:
        sections = html_report.report_run(
            summary,
            [file for file in files if file.suffix == ".png"],
            ["dockloop", "run", options.scene, *list_words(options, ("stop", "step"))],
            _find_view(file) if options.view else None,
        )
        files.append(html_report.find_page(file))
        html_report.write_page(files[-1], COMMAND, summary["title"], sections)
    if options.view:
        files.append(_find_view(file))
        write_page(result, files[-1])
    write_summary(summary, files[1], files)
