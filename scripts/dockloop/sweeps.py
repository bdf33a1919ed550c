"""Runs many dockings: every case of a sweep that is not done yet, keeps every result at once.

Where cases run is the matter of `dockloop.executors`; results, journal and table are the same for
all. Results are appended to a journal (JSON lines) as they arrive, in any order. ``--resume`` reads
it back and runs what is missing: a case is known by its values, not by its number, so that a sweep
may also be continued with more cases.
"""

import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path
from typing import TYPE_CHECKING

from dockloop.cases import Result
from dockloop.errors import UsageError
from dockloop.executors import Executor, choose_engine, open_executor
from dockloop.journal import Journal, find_digests, make_report
from dockloop.outputs import Kind, claim, scratch
from dockloop.paths import shown
from dockloop.planning import Planner
from dockloop.results import ProgressBar, import_optional
from dockloop.sampling import Sweep, make_sweep, read_sweep

if TYPE_CHECKING:
    import pandas as pd

COMMAND = "dockloop sweep"
DIGEST = "dockloop.digest"  # of a sweep, in the metadata of its table
_AHEAD = 4  # cases planned per case that runs


def sweep(
    reference: str | Path | dict,
    *,
    output: Path | None = None,
    engine: str = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
) -> "pd.DataFrame":
    """Run many dockings and return what became of them.

    Args:
        reference: name of a shipped sweep, path of a ``.toml`` file, or the members of such a file.
        output: where the journal is kept (next to this file, ``.jsonl``); default: nowhere.
        engine: ``core`` (threads), ``fmu`` (Dask workers) or ``auto``: threads without scheduler.
        workers: local threads or processes; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        resume: go on with the journal of `output`.

    Returns:
        One row per case: ``case``, the quantities, ``status``, ``reason``, ``warning``,
        ``end_time`` [s], the outcomes at the end. Units are in ``table.attrs["units"]``, the
        summary of ``dockloop sweep --json`` is in ``table.attrs["summary"]``.

    Raises:
        UsageError: the sweep, a name in it or the journal is bad.
        DockloopError: a package is missing, or the executor cannot be used.
    """
    import_optional("pandas")
    import_optional("pyarrow")
    from dockloop import sweep_report

    if isinstance(reference, dict):
        cases = make_sweep(reference, Path("sweep"))
    else:
        cases = read_sweep(str(reference))
    with scratch() as folder:
        ran = run_sweep(
            cases,
            output or folder / "sweep.parquet",
            engine=engine,
            workers=workers,
            scheduler=scheduler,
            resume=resume,
        )
    table = sweep_report.make_table(cases, ran["planner"], ran["results"])
    frame = table.to_pandas()
    frame.attrs["units"] = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    frame.attrs["summary"] = sweep_report.summarise_sweep(cases, ran["planner"], table, ran)
    return frame


def run_sweep(
    sweep: Sweep,
    output: Path,
    *,
    engine: str = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    progress: ProgressBar | None = None,
) -> dict:
    """Run all cases of a sweep that are not done yet.

    Args:
        sweep: what to do.
        output: the table that will be written; the journal is next to it.
        engine: ``core``, ``fmu`` or ``auto``: the core, unless there is a scheduler.
        workers: local threads (of the core) or processes; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        resume: go on with an interrupted sweep.
        progress: shows how far it is.

    Returns:
        ``planner``, ``results`` (one per case, in order), ``ran`` (cases run now), ``wall`` [s],
        ``engine`` and ``workers``.

    Raises:
        UsageError: the sweep, a name in it or the journal is bad.
        DockloopError: the engine cannot be used, or a defect showed on it.
        InterruptedWorkError: by Ctrl-C.
    """
    planner = Planner(sweep)
    path = find_journal(output)
    _check_table(output, {planner.digest, *(find_digests(path) if resume else ())})
    journal = Journal(
        path, planner.find_setup(), len(sweep.cases), resume=resume, digest=planner.digest
    )
    missing = [values for values in dict.fromkeys(sweep.cases) if values not in journal.known]
    done = len(sweep.cases) - len(missing)
    began, threads = time.perf_counter(), 0
    engine = choose_engine(engine, scheduler)
    with journal.at_work(lambda: journal.count(sweep.cases)):
        if missing:
            with open_executor(planner, engine, workers, scheduler, len(missing)) as executor:
                began, threads = time.perf_counter(), executor.count()
                report = make_report(progress, done, len(sweep.cases))
                run_cases(executor, planner, missing, journal.add, report)
    return {
        "planner": planner,
        "results": [journal.known[values] for values in sweep.cases],
        "ran": len(missing),
        "wall": time.perf_counter() - began,
        "engine": engine,
        "workers": threads,
    }


def find_journal(output: Path) -> Path:
    """Return where the journal next to the table of a sweep is."""
    return output.with_suffix(".jsonl")


def read_table_metadata(path: Path) -> dict[str, str]:
    """Return the metadata of a table. Raises OSError or ValueError: it is none."""
    from pyarrow import parquet

    found = parquet.read_metadata(path).metadata or {}
    return {key.decode(): value.decode() for key, value in found.items()}


TABLE = Kind("table", COMMAND, lambda path: "dockloop.sweep" in read_table_metadata(path))


def _check_table(path: Path, digests: set[str]) -> None:
    """Refuse to replace anything but the table of a sweep that has one of these digests."""
    claim(path, TABLE)
    if path.exists() and read_table_metadata(path).get(DIGEST) not in digests:
        raise UsageError(
            f"{shown(path)}: holds the finished table of another sweep (cases, scene or outcomes"
            " differ): choose another -o or delete it"
        )


def run_cases(
    executor: Executor,
    planner: Planner,
    cases: list[tuple],
    keep: Callable[[tuple, Result], None],
    report: Callable[[], None],
) -> None:
    """Submit cases, a few more than run at a time, and keep what comes back.

    Args:
        executor: where they run.
        planner: whose cases they are.
        cases: their values.
        keep: receives every case with its result.
        report: called after each.
    """
    todo = iter(cases)
    running: dict[Future, tuple] = {}

    def finish(values: tuple, result: Result) -> None:
        keep(values, result)
        report()

    def fill() -> None:
        most = _AHEAD * max(1, executor.count())
        while len(running) < most and (values := next(todo, None)) is not None:
            try:
                running[executor.submit(values)] = values
            except UsageError as error:
                finish(values, Result("refused", planner.without_folder(str(error))))

    fill()
    while running:
        arrived: set[Future] = wait(running, return_when=FIRST_COMPLETED).done
        for future in arrived:
            finish(running.pop(future), executor.collect(future))
        fill()
