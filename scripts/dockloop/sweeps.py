"""Runs many dockings: every case of a sweep that is not done yet, keeps every result at once.

Where cases run is the matter of `dockloop.executors`; results, journal and table are the same for
all. Results are appended to a journal (JSON lines) as they arrive, in any order. ``--resume`` reads
it back and runs what is missing: a case is known by its values, not by its number, so that a sweep
may also be continued with more cases. Cases of a grid that come to the same merged scene and start
values run once; each of them has its own line with the result.

A sweep may have two passes: all cases at a cheap ``accuracy``, then critical ones again at a better
one. To planner and journal these are cases like others, with another value of ``accuracy``.
"""

import itertools
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dockloop.cases import Result
from dockloop.criteria import Criterion
from dockloop.docking import Scene
from dockloop.errors import UsageError, names_arguments, warn
from dockloop.executors import Executor, choose_engine, open_executor
from dockloop.histories import Histories, write_histories
from dockloop.journal import Journal, Known, Place, find_digests, make_report
from dockloop.number import to_plain
from dockloop.outputs import Kind, claim, scratch
from dockloop.paths import shown
from dockloop.planning import Planner
from dockloop.results import ProgressBar, import_optional
from dockloop.sampling import Cases, Passes, Sweep, Value, make_sweep, read_passes, read_sweep

if TYPE_CHECKING:
    import pandas as pd

COMMAND = "dockloop sweep"
DIGEST = "dockloop.digest"  # of a sweep, in the metadata of its table
_AHEAD = 4  # cases planned per case that runs
_PATIENCE = 30.0  # without a result before the workers are counted [s]


@names_arguments
def sweep(
    reference: str | Path | dict,
    *,
    output: str | Path | None = None,
    engine: str = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    accuracy: float | str | None = None,
    refine: str | None = None,
    refine_accuracy: float | str | None = None,
) -> "pd.DataFrame":
    """Run many dockings and return what became of them.

    Args:
        reference: name of a shipped sweep, path of a ``.toml`` file, or the members of such a file;
            there the scene may be a `dockloop.Scene`, or the members of a scene file.
        output: where the journal is kept (next to this file, ``.jsonl``); default: nowhere.
        engine: ``core`` (threads), ``fmu`` (Dask workers) or ``auto``: threads without scheduler.
        workers: local threads or processes; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        resume: go on with the journal of `output`.
        accuracy: wanted relative error of all cases, or ``"real-time"``.
        refine: criterion of cases that run again, such as ``"load_ratio > 0.8 or not captured"``.
        refine_accuracy: wanted relative error of these.

    Returns:
        One row per case: ``case``, the quantities, ``status``, ``reason``, ``warning``,
        ``end_time`` [s], the outcomes at the end; with `refine` also those of the first pass,
        ``first.NAME``. Units are in ``table.attrs["units"]``, the summary of ``dockloop sweep
        --json`` is in ``table.attrs["summary"]``. With the key ``histories`` in the sweep,
        ``table.attrs["histories"]`` has a `Result` by the number of each case that was done.

    Raises:
        UsageError: the sweep, a name in it or the journal is bad.
        DockloopError: a package is missing, or the executor cannot be used.
    """
    import_optional("pandas")
    pyarrow = import_optional("pyarrow")
    from dockloop import sweep_report

    passes = read_passes(accuracy, refine, refine_accuracy)
    if isinstance(reference, dict):
        cases = make_sweep(to_plain(_name_scene(reference)), Path("sweep"), passes=passes)
    else:
        cases = read_sweep(str(reference), passes)
    with scratch() as folder:
        ran = run_sweep(
            cases,
            Path(output) if output else folder / "sweep.parquet",
            engine=engine,
            workers=workers,
            scheduler=scheduler,
            resume=resume,
        )
        cases = ran["sweep"]
        table = sweep_report.make_table(cases, ran["planner"], ran["results"], ran["first"])
        histories = None
        if ran["planner"].histories:
            file = folder / "histories.parquet"
            write_histories(ran["planner"], ran["results"], file)
            histories = Histories(pyarrow.BufferReader(file.read_bytes()))
    frame = table.to_pandas()
    frame.attrs["units"] = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    frame.attrs["summary"] = sweep_report.summarise_sweep(cases, ran["planner"], table, ran)
    if histories is not None:
        frame.attrs["histories"] = histories
    return frame


def _name_scene(members: dict) -> dict:
    """Return the members of a sweep file, where a scene has a name; its overrides are set."""
    scene = members.get("scene")
    if not isinstance(scene, Scene):
        return members
    return {**members, "scene": scene.reference, "set": scene.overrides | members.get("set", {})}


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
        ``planner``, ``sweep`` (with each case as it ran last), ``results`` (one per case, in
        order, from the journal), ``first`` (the same of the first pass; None where a case did not
        run again), ``ran`` (cases done now), ``repeats`` (those of them that took the result of
        an equal case), ``wall`` [s], ``engine`` and ``workers``.

    Raises:
        UsageError: the sweep, a name in it or the journal is bad.
        DockloopError: the engine cannot be used, or a defect showed on it.
        InterruptedWorkError: by Ctrl-C.
    """
    planner = Planner(sweep)
    passes = sweep.passes or Passes(0.0)
    criterion = planner.ask(passes.refine, "--refine") if passes.refine else None
    path = find_journal(output)
    _check_table(output, {planner.digest, *(find_digests(path) if resume else ())})
    cases = sweep.cases
    most = len(cases) * (2 if criterion else 1)
    journal = Journal(path, planner.find_setup(), most, resume=resume, digest=planner.digest)
    engine = choose_engine(engine, scheduler)
    clock: dict[str, Any] = {
        "ran": 0,
        "repeats": 0,
        "wall": 0.0,
        "engine": engine,
        "workers": 0,
    }

    def run(cases: Cases, rows: Sequence[int]) -> None:
        known = journal.known
        missing = (values for values in map(cases.__getitem__, rows) if values not in known)
        before = len(known)
        count = sum(cases[row] not in known for row in rows) if before else len(rows)
        if count:
            with open_executor(planner, engine, workers, scheduler, count) as executor:
                began, clock["workers"] = time.perf_counter(), executor.count()
                report = make_report(progress, len(rows) - count, len(rows))
                may_repeat = cases.count_points() > 1
                clock["repeats"] += run_cases(
                    executor, planner, missing, journal, report, may_repeat=may_repeat
                )
                clock["wall"] += time.perf_counter() - began
        clock["ran"] += len(known) - before

    last, again = cases, np.zeros(len(cases), dtype=bool)
    with journal.at_work(
        lambda: journal.count(itertools.chain(cases, itertools.compress(last, again)))
    ):
        run(cases, range(len(cases)))
        if criterion:
            results = Results(journal.known, cases)
            critical = [
                _is_critical(criterion, planner, values, results[row])
                for row, values in enumerate(cases)
            ]
            again = np.array(critical, dtype=bool)
            last = cases.at_accuracy(np.where(again, passes.refine_accuracy, passes.accuracy))
            run(last, np.flatnonzero(again).tolist())
            journal.finish()
    return {
        "planner": planner,
        "sweep": replace(sweep, cases=last),
        "results": Results(journal.known, last),
        "first": Results(journal.known, cases, again),
        **clock,
    }


class Results(Sequence[Any]):
    """Results of cases, in their order, read from the journal when they are looked at."""

    def __init__(self, known: Known, cases: Cases, wanted: np.ndarray | None = None) -> None:
        """Prepare to read.

        Args:
            known: results by the values of their cases.
            cases: these values.
            wanted: which rows have a result, the others have None; default: all.
        """
        self._known, self._cases, self._wanted = known, cases, wanted

    def __len__(self) -> int:
        """Return the number of cases."""
        return len(self._cases)

    def __getitem__(self, row: Any) -> Any:
        """Return the result of a row, or None."""
        if self._wanted is None or self._wanted[row]:
            return self._known[self._cases[row]]
        return None


def _is_critical(
    criterion: Criterion, planner: Planner, values: tuple[Value, ...], result: Result
) -> bool:
    """Return whether a case runs again: it meets the criterion, or a step of it failed."""
    if result.status == "done":
        return criterion.holds(planner.name_values(values, result))
    return result.status == "failed"


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
    cases: Iterable[tuple],
    journal: Journal,
    report: Callable[[], None],
    *,
    may_repeat: bool = False,
) -> int:
    """Submit cases, a few more than run at a time, and keep what comes back.

    Args:
        executor: where they run.
        planner: whose cases they are.
        cases: their values.
        journal: keeps every case with its result.
        report: called after each.
        may_repeat: cases of other values may come to the same scene and start values: these run
            once, and each of them gets the result.

    Returns:
        The number of cases that got the result of another one.
    """
    todo = iter(cases)
    running: dict[Future, tuple[bytes | None, list[tuple]]] = {}  # key; the case and its repeats
    begun: dict[bytes, Future] = {}  # cases that run now, by their keys
    done: dict[bytes, Place] = {}  # cases that have run, by their keys
    repeats = 0

    def finish(values: tuple, result: Result) -> None:
        journal.add(values, result)
        report()

    def fill() -> None:
        nonlocal repeats
        most = _AHEAD * max(1, executor.count())
        while len(running) < most and (values := next(todo, None)) is not None:
            key = planner.find_key(values) if may_repeat else None
            if key in begun:
                repeats += 1
                running[begun[key]][1].append(values)
            elif key in done:
                repeats += 1
                finish(values, journal.known.read(done[key]))
            else:
                submit(key, values)

    def submit(key: bytes | None, values: tuple) -> None:
        try:
            future = executor.submit(values)
        except UsageError as error:
            finish(values, Result("refused", planner.without_folder(str(error))))
            return
        running[future] = (key, [values])
        if key is not None:
            begun[key] = future

    fill()
    is_alone = False  # no worker is left
    while running:
        arrived: set[Future] = wait(running, _PATIENCE, return_when=FIRST_COMPLETED).done
        was_alone, is_alone = is_alone, not arrived and executor.count() == 0
        if is_alone and not was_alone:
            warn(
                "no Dask worker is left: the cases wait for one; after Ctrl-C the same command"
                " with --resume goes on"
            )
        for future in arrived:
            result = executor.collect(future)
            key, equal = running.pop(future)
            for values in equal:
                finish(values, result)
            if key is not None:
                del begun[key]
                done[key] = journal.known.find_place(equal[0])
        fill()
    return repeats
