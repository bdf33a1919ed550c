"""``dockloop sweep``: many dockings."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dockloop.base import paths
from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.number import read_if_number
from dockloop.base.system import ENGINES, LANES
from dockloop.commands.arguments import Command, Options, positive, whole
from dockloop.commands.console import write_found

if TYPE_CHECKING:
    from dockloop.sweeps.sampling import Passes, Sweep

EXAMPLE = "example: dockloop sweep absorber_1d_speeds --engine core --workers 2 --csv"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument("sweep", metavar="SWEEP", help="name of a shipped sweep, or a .toml file")
    command.add_argument(
        "--engine",
        choices=ENGINES,
        default="auto",
        help="core: in this process or its Dask workers; fmu: each case through an FMU, in Dask"
        " workers; auto (default): core; results are the same",
    )
    text = "let the parameters of a fit vary, too, with their covariance (see dockloop fit)"
    command.add_fitted(text)
    command.add_executor()
    text = "cases that a core computes at once: 1, because there is no other way yet"
    command.add_option("--lanes", "N", text, type=positive)
    command.add_flag("--resume", "go on with a sweep that was interrupted")
    command.add_output(
        "TABLE.parquet",
        "the table; journal, TABLE_summary.json and plots are written next to it"
        " (default: build/sweeps/SWEEP/SWEEP.parquet)",
    )
    text = "wanted relative error of all cases, or real-time, as for dockloop run"
    command.add_option("--accuracy", "ERROR", text)
    command.add_assured()
    command.add_option(
        "--refine",
        "TEXT",
        'run cases again that meet a criterion, e.g. "load_ratio > 0.8 or not captured", and'
        " cases with a step that failed",
    )
    text = "wanted relative error of these; the report says what changed"
    command.add_option("--refine-accuracy", "ERROR", text)
    command.add_option(
        "--rare",
        "TEXT",
        'estimate how rarely dockings fail, e.g. "load_ratio > 1" (a criterion as for dockloop'
        " envelope), with fewer dockings than plain sampling; writes TABLE_rare.json, no table",
    )
    text = "dockings in every level of --rare: more make the interval narrow (default: 500)"
    command.add_option("--rare-cases", "N", text, type=whole)
    command.add_flag("--csv", "write the table as CSV too")
    command.add_flag("--no-plots", "do not draw figures")
    command.add_report("TABLE_report.html")
    command.add_flag("--json", "print the summary as JSON")


def run(options: Options) -> None:
    """Run the sweep, or estimate how rarely its dockings fail."""
    from dockloop.base.files import check_suffix

    if options.output:
        check_suffix(options.output, ".parquet")
    uses_dask = options.engine == "fmu" or options.scheduler
    try:
        for package in ("pyarrow", "scipy", *(["distributed"] if uses_dask else [])):
            import_module(package)
    except ImportError as error:
        raise DockloopError(
            f"sweeps need the package {error.name}: pip install 'dockloop[sweep]'; in a clone"
            " .venv/bin/pip install -e '.[sweep]'"
        ) from None
    from dockloop.base.progress import ProgressBar
    from dockloop.sweeps.campaign import read_how
    from dockloop.sweeps.sampling import read_passes, read_sweep

    if options.lanes not in (None, *LANES):
        raise UsageError(f"--lanes {options.lanes}: must be 1, there is no other way yet")
    accuracy, refined = (
        text if text is None else read_if_number(text)
        for text in (options.accuracy, options.refine_accuracy)
    )
    passes = read_passes(accuracy, options.refine, refined)
    _check_rare(options, passes)
    sweep = read_sweep(options.sweep, passes, fitted=options.fitted)
    sweep = replace(sweep, assured=options.assured)
    name = sweep.path.stem
    output = options.output or paths.RESULTS / "sweeps" / name / f"{name}.parquet"
    work = _run_all if options.rare is None else _run_rare
    work(options, sweep, output, {"progress": ProgressBar(name), **read_how(options)})


def _check_rare(options: Options, passes: "Passes | None") -> None:
    """Check that options fit to ``--rare``, or to work without it. Raises UsageError."""
    if options.rare is None:
        if options.rare_cases is not None:
            raise UsageError(f"--rare-cases {options.rare_cases}: needs --rare")
        return
    if passes and passes.refine:
        raise UsageError("--rare and --refine: give one of them")
    for name in ("csv", "report", "assured"):
        if getattr(options, name):
            raise UsageError(f"--rare and --{name}: --rare writes no table: leave out --{name}")


def _run_all(options: Options, sweep: "Sweep", output: Path, how: dict[str, Any]) -> None:
    """Run all cases: table, summary, plots, pages."""
    from dockloop.base.figures import can_draw
    from dockloop.base.files import claim
    from dockloop.base.sections import find_html, html_kind, write_html
    from dockloop.report import sweep as sweep_report
    from dockloop.report.sweep_sections import complete_report, report_sweep
    from dockloop.result.summary import find_summary, write_summary
    from dockloop.sweeps.histories import find_histories, write_histories
    from dockloop.sweeps.journal import keeps_results
    from dockloop.sweeps.run import run_sweep
    from dockloop.sweeps.table import COMMAND, TableFile, write_table
    from dockloop.view import cases
    from dockloop.view.page import PAGE

    plots = not options.no_plots
    keeps = "histories" in sweep.document
    for file, kind in sweep_report.list_files(
        output, as_csv=options.csv, plots=plots, histories=keeps
    ):
        claim(file, kind)
    if options.report:
        claim(find_html(output), html_kind(COMMAND))
        for file in cases.list_views(output):
            claim(file, PAGE)
    ran = run_sweep(sweep, output, **how)
    planner, sweep = ran["planner"], ran["sweep"]
    with keeps_results():
        files = write_table(
            sweep, planner, ran["results"], ran["first"], output, as_csv=options.csv
        )
        if keeps:
            files.append(find_histories(output))
            write_histories(planner, ran["results"], files[-1])
        table = TableFile(output)
        summary = sweep_report.summarise_sweep(sweep, planner, table, ran)
        if plots and can_draw():
            files += sweep_report.write_sweep_plots(sweep, planner, table, output.with_suffix(""))
        if options.report:
            figures = [file for file in files if file.suffix == ".png"]
            views = cases.write_views(sweep, planner, table, output)
            sections = complete_report(summary, sweep, planner, table, figures, views=views)
            files += [*views.values(), find_html(output)]
            write_html(files[-1], COMMAND, sections)
        files.append(find_summary(output))
        write_summary(summary, files[-1], files)
    write_found(options, summary, report_sweep)
    if "done" not in summary["status"]:
        raise DockloopError(f"no case was done, for example: {summary['reasons']['example']}")


def _run_rare(options: Options, sweep: "Sweep", output: Path, how: dict[str, Any]) -> None:
    """Estimate how rarely the dockings of a sweep fail."""
    from dockloop.base.files import claim
    from dockloop.result.summary import write_summary
    from dockloop.sweeps import rare
    from dockloop.sweeps.journal import keeps_results

    if "histories" in sweep.document:
        raise UsageError(
            f"--rare: writes no table, so it keeps no histories: leave 'histories' out of"
            f" {paths.shown(sweep.path)}"
        )
    file, journal = rare.name_files(output)
    claim(file, rare.SUMMARY)
    samples = rare.SAMPLES if options.rare_cases is None else options.rare_cases
    summary = rare.run_rare(sweep, options.rare, samples, journal, **how)
    with keeps_results():
        write_summary(summary, file, [file])
    write_found(options, summary, rare.report_rare)
