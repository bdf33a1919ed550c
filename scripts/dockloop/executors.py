"""Where the cases of a sweep run: threads of the core in this process, or FMUs in Dask workers.

An executor plans a case, sends it, and says what became of it; `dockloop.sweeps` knows no more.
Results are the same to the last bit if one compiler made core and FMU, else to rounding. A case
that kills its process ends a sweep on threads, and ``--resume`` goes on; in a Dask worker the case
becomes a lost row.
"""

import logging
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import lru_cache
from threading import Event
from typing import Any, Protocol

from dockloop import __version__
from dockloop.cases import Result, run_case, say_version
from dockloop.core import load_core, to_json
from dockloop.errors import DockloopError, UsageError, check_current_folder, without_function
from dockloop.fmu import NEVER_TOUCH
from dockloop.number import check_whole
from dockloop.outputs import scratch
from dockloop.planning import KEPT_FMUS, Planner
from dockloop.sampling import Value
from dockloop.system import count_processors


class Executor(Protocol):
    """Runs cases side by side."""

    def count(self) -> int:
        """Return how many cases run at a time; 0 as long as no worker is left."""

    def submit(self, values: tuple[Value, ...]) -> Future:
        """Begin a case. Raises UsageError: the scene refuses these values."""

    def collect(self, future: Future) -> Result:
        """Return what became of a case. Raises DockloopError: no other case can be run either."""


class CoreThreads:
    """Threads that run cases in the compiled core, which frees the lock of the interpreter."""

    def __init__(self, planner: Planner, threads: int) -> None:
        self._planner, self._threads = planner, threads
        self._pool, self._stopping = ThreadPoolExecutor(threads), Event()

    def __enter__(self) -> "CoreThreads":
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._pool.shutdown(cancel_futures=True)

    def count(self) -> int:
        """Return the number of threads."""
        return self._threads

    def submit(self, values: tuple[Value, ...]) -> Future:
        """Begin a case. Raises UsageError like `Planner.resolve`."""
        return self._pool.submit(self._run, *self._planner.resolve(values))

    def collect(self, future: Future) -> Result:
        """Return what became of a case; raises what its thread did."""
        return future.result()

    def _run(self, document: dict, starts: dict[str, Value]) -> Result:
        core, planner = load_core(), self._planner
        result = Result("refused")
        docking: Any = None
        warnings: list[str] = []
        try:
            times = planner.list_points(document).tolist()
            docking = core.Docking(to_json(document), f"{planner.base['name']}.toml", place=True)
            warnings += [] if docking.touches else [NEVER_TOUCH]
            result.end_time = times[0]
            docking.set(docking.find(list(starts)), [float(value) for value in starts.values()])
            docking.start()
            result.status = "failed"
            rows, kept = docking.find(planner.asked), docking.find(planner.histories)
            patience = planner.experiment.get("end_after_outcome", float("inf"))
            values, *_ = docking.record(
                times, kept or rows, patience, last_only=not kept, progress=self._check
            )
            result.status, result.end_time = "done", docking.time
            outputs = docking.get(rows) if kept else values[0].tolist()
            if kept:
                result.histories = (times[: len(values)], *values.T.tolist())
            result.outputs = tuple(
                value if planner.variables[name].type == "Real" else int(value)
                for name, value in zip(planner.asked, outputs, strict=True)
            )
            warnings += docking.take_warnings()
        except UsageError as error:
            result.reason = str(error)
        except core.ModelError as error:
            reason = without_function(str(error))
            result.reason = f"the FMU: {reason}" if docking else reason
        except core.StepError as error:
            result.end_time = docking.time
            result.reason = f"at {docking.time:.9g} s: the FMU: {error}"
        result.warning = "; ".join(warnings) or None
        return result

    def _check(self, _part: float) -> None:
        """End a case whose result is not needed any more."""
        if self._stopping.is_set():
            raise InterruptedError


class DaskWorkers:
    """Dask workers, here or on a cluster, that run FMUs through FMPy.

    An FMU travels as the result of a task of its own: every worker that needs it gets it once, and
    when the workers that had it are gone the scheduler makes it again.
    """

    def __init__(self, planner: Planner, client: Any) -> None:
        self._planner, self._client = planner, client
        self._pool = client.get_executor(pure=False)
        self._find_sent = lru_cache(KEPT_FMUS)(self._send)

    def count(self) -> int:
        """Return the number of threads of all workers that are there now."""
        with _needs_scheduler():
            return sum(self._client.nthreads().values())

    def submit(self, values: tuple[Value, ...]) -> Future:
        """Send a case. Raises UsageError like `Planner.plan`."""
        plan = self._planner.plan(values)
        digest, task = self._find_sent(plan.fmu)
        with _needs_scheduler():
            return self._pool.submit(run_case, task, digest, plan.job)

    def _send(self, key: str) -> tuple[str, Future]:
        """Send the FMU of a key; returns its digest, and the task whose result it is."""
        digest, fmu = self._planner.fmu(key)
        with _needs_scheduler():
            return digest, self._client.submit(bytes, fmu, key=f"fmu-{digest}")

    def collect(self, future: Future) -> Result:
        """Return what a worker made of a case, or say what became of the worker."""
        from distributed import KilledWorker

        try:
            with _needs_scheduler():
                return future.result()
        except KilledWorker as error:
            attempts = getattr(error, "allowed_failures", 0) + 1
            return Result("lost", f"{attempts} workers in turn died while they had this case")


@contextmanager
def _needs_scheduler() -> Iterator[None]:
    """Say what to do if the scheduler does not answer any more."""
    from concurrent.futures import CancelledError

    from distributed.client import ClosedClientError

    try:
        yield
    except (CancelledError, ClosedClientError, OSError) as error:
        why = str(error) or type(error).__name__
        raise DockloopError(
            f"the Dask scheduler is gone ({why}); the same command with --resume goes on"
        ) from None


def choose_engine(engine: str, scheduler: str | None) -> str:
    """Return ``core`` or ``fmu``; ``auto`` is the core, unless there is a scheduler."""
    if engine != "auto":
        return engine
    return "fmu" if scheduler else "core"


@contextmanager
def open_executor(
    planner: Planner, engine: str, workers: int | None, scheduler: str | None, cases: int
) -> Iterator[Executor]:
    """Start what runs cases.

    Args:
        planner: plans them.
        engine: ``core``, ``fmu`` or ``auto``.
        workers: local threads (of the core) or processes; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        cases: how many there are.

    Raises:
        DockloopError: the scheduler cannot be used.
    """
    wanted = count_processors() if workers is None else check_whole("--workers", workers, 1)
    count = min(wanted, cases)
    if choose_engine(engine, scheduler) == "core":
        with CoreThreads(planner, count) as threads:
            yield threads
        return
    with _open_cluster(count, scheduler) as client:
        yield DaskWorkers(planner, client)


@contextmanager
def _open_cluster(workers: int, scheduler: str | None) -> Iterator[Any]:
    """Connect to a scheduler, or start local processes that end with the sweep."""
    import dask
    from distributed import Client

    for name in ("distributed", "distributed.client"):  # what fails is said by this package
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=10)
        except ValueError as error:
            raise UsageError(
                f"--scheduler {scheduler}: must be an address like tcp://host:8786 ({error})"
            ) from None
        except OSError as error:
            raise DockloopError(
                f"--scheduler {scheduler}: cannot be reached ({error}): start 'dask scheduler'"
                " there, and state the address that it prints"
            ) from None
        with client:
            _check_workers(client, scheduler)
            yield client
        return
    # A Ctrl-C reaches all processes of a terminal: workers leave it to this one.
    ignore = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    with (
        dask.config.set({"distributed.worker.preload": [ignore]}),
        scratch() as folder,
        _without_main(),
        _start_cluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # its page of health, unseen
            memory_limit=None,
            silence_logs=logging.CRITICAL,
            local_directory=str(folder),
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _start_cluster(**settings: Any) -> Any:
    """Start worker processes here. Raises DockloopError: they cannot be started."""
    from distributed import LocalCluster

    try:
        return LocalCluster(**settings)
    except (RuntimeError, OSError) as error:
        check_current_folder()
        raise DockloopError(
            f"no worker process can be started ({error.__cause__ or error}): use --engine core"
        ) from None


@contextmanager
def _without_main() -> Iterator[None]:
    """Let new processes import no main program: workers need nothing of it.

    A script without ``if __name__ == "__main__"`` would begin its sweep anew in each of them.
    """
    members: dict[str, Any] = vars(sys.modules["__main__"])
    kept: dict[str, Any] = {
        name: members[name] for name in ("__file__", "__spec__") if name in members
    }
    members.pop("__file__", None)
    members["__spec__"] = None
    try:
        yield
    finally:
        members |= kept


def _check_workers(client: Any, scheduler: str) -> None:
    """Check that the workers of a foreign cluster have this package."""
    found: set[str] = set()
    with suppress(Exception):  # whatever it is, the sentence below says what is needed
        client.wait_for_workers(1, timeout=30)
        found = set(client.run(say_version).values())
    if found != {__version__}:
        raise DockloopError(
            f"--scheduler {scheduler}: it must have at least one worker, and all of them need the"
            f" Python package dockloop {__version__} (nothing compiled)"
        )
