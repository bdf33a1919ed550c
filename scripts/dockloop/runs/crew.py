"""Worker processes that may be killed: a case that hangs or crashes is a result, not an end.

A process does one case at a time. When a case takes more processor time than its limit (or many
times as long by the clock) the process is killed; when the process dies its exit status is
reported. The next case gets a new process.
"""

import multiprocessing
import os
import queue
import signal
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from dockloop.base.system import count_processors

_LOOK = 0.5  # s between two looks at the processor time of a case
_PATIENCE = 20.0  # times the limit by the clock: the processors may be busy, or the process waits


class Ending(NamedTuple):
    """How a case ended.

    Attributes:
        kind: ``done``, ``hung`` (killed at the limit) or ``crashed`` (the process died).
        value: what the work returned; of the others the last note that it sent, or None.
        reason: why it is not done.
    """

    kind: str
    value: Any
    reason: str = ""


class Crew:
    """Processes that all do the same work, one case each at a time."""

    def __init__(
        self, work: Callable[[Any, Callable[[Any], None]], Any], count: int | None = None
    ) -> None:
        """Prepare the processes; each starts with its first case.

        Args:
            work: function of a module: receives a case, and a function that sends a note; each
                note restarts the clock.
            count: processes; default: one per processor.
        """
        count = count or count_processors()
        self._count = count
        self._idle: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
        self._workers = [_Worker(work) for _ in range(count)]
        for worker in self._workers:
            self._idle.put(worker)
        self._pool = ThreadPoolExecutor(count)

    def __enter__(self) -> "Crew":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)
        for worker in self._workers:
            worker.kill()
        self._pool.shutdown()

    def count(self) -> int:
        """Return the number of processes."""
        return self._count

    def begin(self, case: Any, limit: float) -> "Future[Ending]":
        """Begin a case.

        Args:
            case: what the work receives.
            limit: most processor time from the start, or from a note, to the next note or the end
                [s].
        """
        return self._pool.submit(self._do, case, limit)

    def _do(self, case: Any, limit: float) -> Ending:
        worker = self._idle.get()
        try:
            return worker.do(case, limit)
        finally:
            self._idle.put(worker)


class _Worker:
    """One process, started again when it is gone."""

    def __init__(self, work: Callable) -> None:
        self._work = work
        self._process: Any = None
        self._pipe: Any = None

    def do(self, case: Any, limit: float) -> Ending:
        note = None
        try:
            if self._process is None:
                self._start()
            self._pipe.send(case)
            while self._waits(limit):
                is_end, value = self._pipe.recv()
                if is_end:
                    return Ending("done", value)
                note = value
        except (EOFError, OSError):
            return Ending("crashed", note, self._bury())
        self.kill()
        return Ending("hung", note, f"no end within {limit:g} s of processor time")

    def _waits(self, limit: float) -> bool:
        """Wait for the next message; returns whether there is one within the limit."""
        began, used = time.monotonic(), self._find_time()
        while not self._pipe.poll(_LOOK):
            if time.monotonic() - began > _PATIENCE * limit or self._find_time() - used > limit:
                return False
        return True

    def _find_time(self) -> float:
        """Return the processor time of the process so far [s]; that of the clock if not known."""
        try:
            stat = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="utf-8")
        except OSError:
            return time.monotonic()
        user, system = stat.rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def kill(self) -> None:
        """End the process at once."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")  # threads of this process survive no fork
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(self._work, other), daemon=True)
        self._process.start()
        other.close()

    def _bury(self) -> str:
        """Say how the process died."""
        process, self._process = self._process, None
        if process is None:  # killed with the crew
            return "the work was ended"
        process.join()
        code = process.exitcode or 0
        with suppress(ValueError):
            return f"the process died by {signal.Signals(-code).name}"
        return f"the process ended with status {code}"


def _serve(work: Callable, pipe: Any) -> None:
    """Do one case after the other, until the other end is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the command
    with suppress(EOFError, OSError):
        while True:
            case = pipe.recv()
            pipe.send((True, work(case, lambda note: pipe.send((False, note)))))
