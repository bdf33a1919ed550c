"""Runs all cases of a sweep that are not done yet.

Cases of a grid that come to the same merged scene and start values run once; each of them has its
own line with the result. A sweep may have two passes: all cases at a cheap ``accuracy``, then
critical ones again at a better one. To planner and journal these are cases like others, with
another value of ``accuracy``.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from dockloop.base.progress import ProgressBar
from dockloop.base.system import count_processors
from dockloop.result.criteria import Criterion
from dockloop.runs.outcome import Result
from dockloop.sweeps.campaign import Campaign, How
from dockloop.sweeps.executors import choose_engine, open_executor
from dockloop.sweeps.journal import Journal, Known, find_digests, make_report
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import Cases, Passes, Sweep, Value
from dockloop.sweeps.table import check_table, find_journal


def run_sweep(
    sweep: Sweep, output: Path, *, progress: ProgressBar | None = None, **how: Unpack[How]
) -> dict:
    """Run all cases of a sweep that are not done yet.

    Args:
        sweep: what to do.
        output: the table that will be written; the journal is next to it.
        progress: shows how far it is.
        how: see `How`.

    Returns:
        ``planner``, ``sweep`` (with each case as it ran last), ``results`` (one per case, in
        order, from the journal), ``first`` (the same of the first pass; None where a case did not
        run again), ``ran`` (cases done now), ``repeats`` (those of them that took the result of
        an equal case), ``built`` (FMUs), ``wall`` [s], ``engine``, ``workers``, and the
        ``cores`` that they have.

    Raises:
        UsageError: the sweep, a name in it or the journal is bad.
        DockloopError: the engine cannot be used, or a defect showed on it.
        InterruptedWorkError: by Ctrl-C.
    """
    planner = Planner(sweep)
    passes = sweep.passes or Passes(0.0)
    criterion = planner.ask(passes.refine, "--refine") if passes.refine else None
    path, resume = find_journal(output), how.get("resume", False)
    check_table(output, {planner.digest, *(find_digests(path) if resume else ())})
    cases = sweep.cases
    most = len(cases) * (2 if criterion else 1)
    journal = Journal(path, planner.find_setup(), most, resume=resume, digest=planner.digest)
    campaign = Campaign(journal, lambda: open_executor(planner, how, len(cases)))
    find_key = planner.find_key if cases.count_points() > 1 else None
    last, again = cases, np.zeros(len(cases), dtype=bool)
    with campaign.at_work(lambda: itertools.chain(cases, itertools.compress(last, again))):
        campaign.run(cases, report=make_report(progress), find_key=find_key)
        if criterion:
            results = Results(journal.known, cases)
            critical = [
                _is_critical(criterion, planner, values, results[row])
                for row, values in enumerate(cases)
            ]
            again = np.array(critical, dtype=bool)
            last = cases.at_accuracy(np.where(again, passes.refine_accuracy, passes.accuracy))
            rows = np.flatnonzero(again).tolist()
            campaign.run(last, rows, report=make_report(progress), find_key=find_key)
            journal.finish()
    engine = choose_engine(how)
    most_cores = campaign.workers if how.get("scheduler") else count_processors()
    return {
        "planner": planner,
        "sweep": replace(sweep, cases=last),
        "results": Results(journal.known, last),
        "first": Results(journal.known, cases, again),
        "built": campaign.begun if engine == "fmu" else 0,
        "engine": engine,
        "cores": max(min(campaign.workers, most_cores), 1),
        **{name: getattr(campaign, name) for name in ("ran", "repeats", "wall", "workers")},
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
