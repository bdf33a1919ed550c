"""A campaign: many cases, each run once and kept at once in a journal.

Sweeps, rare events, envelopes, maps, trades and random extremes are campaigns: they say which cases
come next, given the results so far. Where cases run is the matter of an executor
(`dockloop.sweeps.executors`). ``--resume`` reads the journal back and runs what is missing: a case
is known by its values, not by its number, so that the work may also go on with more cases.
"""

import itertools
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any, Protocol, TypedDict

from dockloop.base.errors import DockloopError, UsageError, warn
from dockloop.runs.outcome import Result
from dockloop.sweeps.journal import Journal, Place
from dockloop.sweeps.sampling import Value

_AHEAD = 4  # cases begun per case that runs
_PATIENCE = 30.0  # without a result before the workers are counted [s]
Values = tuple[Value, ...]
Report = Callable[[int, int], None]  # receives cases done and cases in all


class How(TypedDict, total=False):
    """How a campaign runs.

    Attributes:
        engine: ``core``, ``fmu`` or ``auto`` (the core).
        workers: local threads (of the core) or processes; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        resume: go on with the journal.
    """

    engine: str
    workers: int | None
    scheduler: str | None
    resume: bool


def read_how(options: Namespace) -> How:
    """Return how a campaign runs from the options of its command."""
    found: Any = {n: v for n, v in vars(options).items() if n in How.__annotations__}
    return found


class Executor(Protocol):
    """Runs cases side by side."""

    def count(self) -> int:
        """Return how many cases run at a time; 0: no worker is left, or `submit` itself works."""

    def submit(self, values: Values) -> Future:
        """Begin a case. Raises UsageError: the scene refuses these values."""

    def collect(self, future: Future) -> Result:
        """Return what became of a case. Raises DockloopError: no other case can be run either."""


class InTurn:
    """Executor that does one case after the other itself."""

    def __init__(self, work: Callable[[Values], Result]) -> None:
        """Prepare to do `work`."""
        self._work = work

    def count(self) -> int:
        """Return 0: `submit` works."""
        return 0

    def submit(self, values: Values) -> Future:
        """Do a case."""
        future: Future = Future()
        future.set_result(self._work(values))
        return future

    def collect(self, future: Future) -> Result:
        """Return what became of a case."""
        return future.result()


def explain_undone(
    runs: Iterable[tuple[Values, Result]], what: str, explain: Callable[[Values], str]
) -> DockloopError:
    """Return the error of work without a case that is done: bad usage if all are refused.

    Args:
        runs: cases and what became of them.
        what: the beginning of the message.
        explain: returns why a case is refused.
    """
    undone = [(values, result) for values, result in runs if result.status != "done"]
    is_refused = all(result.status == "refused" for _, result in undone)
    values, result = undone[0]
    reason = (is_refused and explain(values)) or result.reason or result.status
    return (UsageError if is_refused else DockloopError)(f"{what}: {reason}")


class Campaign:
    """Cases of some work, each run once.

    Attributes:
        journal: keeps them.
        known: results by the values of their cases.
        ran: cases done now; the others were in the journal.
        repeats: those of them that took the result of an equal case.
        begun: those of them that the executor ran.
        wall: time of these [s].
        workers: how many ran at a time.
    """

    def __init__(self, journal: Journal, start: Callable[[], AbstractContextManager[Any]]) -> None:
        """Prepare to run.

        Args:
            journal: keeps every case with its result.
            start: starts the executor, when it is first needed.
        """
        self.journal, self.known = journal, journal.known
        self._start, self._stack = start, ExitStack()
        self._executor: Executor | None = None
        self.ran = self.repeats = self.begun = self.workers = 0
        self.wall = 0.0

    @contextmanager
    def at_work(self, cases: Callable[[], Iterable[Values]] | None = None) -> Iterator[None]:
        """Stop the executor and close the journal after the work; `cases` are all of it, if known.

        Raises:
            InterruptedWorkError: by Ctrl-C.
        """

        def describe() -> str:
            return self.journal.count(cases()) if cases else f"{len(self.known)} dockings"

        with self.journal.at_work(describe), self._stack:
            yield

    def run(
        self,
        cases: Sequence[Values],
        rows: Sequence[int] | None = None,
        *,
        report: Report = lambda *_: None,
        find_key: Callable[[Values], bytes | None] | None = None,
    ) -> None:
        """Run cases that are not known yet, and keep what comes back.

        Args:
            cases: their values.
            rows: which of them; default: all.
            report: is called at the beginning and after each case.
            find_key: cases of other values that have the same key run once, and each of them gets
                the result.
        """
        rows = range(len(cases)) if rows is None else rows
        done = sum(cases[row] in self.known for row in rows) if self.known else 0
        report(done, len(rows))
        if done == len(rows):
            return
        if self._executor is None:
            self._executor = self._stack.enter_context(self._start())
            self.workers = self._executor.count()
        began, before = time.perf_counter(), len(self.known)
        missing = (values for values in map(cases.__getitem__, rows) if values not in self.known)
        numbers = itertools.count(done + 1)

        def finish(values: Values, result: Result) -> None:
            self.journal.add(values, result)
            report(next(numbers), len(rows))

        self._run(self._executor, missing, finish, find_key or (lambda _: None))
        self.wall += time.perf_counter() - began
        self.ran += len(self.known) - before

    def _run(
        self,
        executor: Executor,
        cases: Iterator[Values],
        finish: Callable[[Values, Result], None],
        find_key: Callable[[Values], bytes | None],
    ) -> None:
        """Submit cases, a few more than run at a time; `finish` those that come back."""
        running: dict[Future, tuple[bytes | None, list[Values]]] = {}  # key; case and its repeats
        begun: dict[bytes, Future] = {}  # cases that run now, by their keys
        done: dict[bytes, Place] = {}  # cases that have run, by their keys

        def fill() -> None:
            most = _AHEAD * executor.count() or 1
            while len(running) < most and (values := next(cases, None)) is not None:
                key = find_key(values)
                if key in begun:
                    self.repeats += 1
                    running[begun[key]][1].append(values)
                elif key in done:
                    self.repeats += 1
                    finish(values, self.known.read(done[key]))
                else:
                    submit(key, values)

        def submit(key: bytes | None, values: Values) -> None:
            try:
                future = executor.submit(values)
            except UsageError as error:
                finish(values, Result("refused", str(error)))
                return
            self.begun += 1
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
                    done[key] = self.known.find_place(equal[0])
            fill()
