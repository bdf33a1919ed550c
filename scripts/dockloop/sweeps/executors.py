"""Where the cases of a sweep run: threads of this process, or Dask workers.

An executor resolves a case, sends it, and says what became of it; `dockloop.sweeps.campaign` knows
no more. Both do the same with it (`dockloop.sweeps.cases`). A case that kills its process ends a
sweep on threads, and ``--resume`` goes on; in a Dask worker the case becomes a lost row.
"""

import logging
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from threading import Event
from typing import Any

from dockloop.base.errors import DockloopError, UsageError, check_current_folder
from dockloop.base.files import scratch
from dockloop.base.number import check_whole
from dockloop.base.system import ENGINES, count_processors
from dockloop.base.version import __version__
from dockloop.native.core import load_core
from dockloop.runs.outcome import Result
from dockloop.sweeps.campaign import Executor, How
from dockloop.sweeps.cases import Job, run_case
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import Value


class CoreThreads:
    """Threads that run cases in the compiled core, which frees the lock of the interpreter."""

    def __init__(self, planner: Planner, job: Job, threads: int) -> None:
        self._planner, self._job, self._threads = planner, job, threads
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
        return self._pool.submit(run_case, self._job, *self._planner.resolve(values), self._check)

    def collect(self, future: Future) -> Result:
        """Return what became of a case; raises what its thread did."""
        return future.result()

    def _check(self, _part: float) -> None:
        """End a case whose result is not needed any more."""
        if self._stopping.is_set():
            raise InterruptedError


class DaskWorkers:
    """Dask workers, here or on a cluster, that do what a thread here does."""

    def __init__(self, planner: Planner, job: Job, client: Any) -> None:
        self._planner, self._job, self._client = planner, job, client
        self._pool = client.get_executor(pure=False)

    def count(self) -> int:
        """Return the number of threads of all workers that are there now."""
        with _needs_scheduler():
            return sum(self._client.nthreads().values())

    def submit(self, values: tuple[Value, ...]) -> Future:
        """Send a case. Raises UsageError like `Planner.resolve`."""
        case = self._planner.resolve(values)
        with _needs_scheduler():
            return self._pool.submit(run_case, self._job, *case)

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


def choose_engine(how: How) -> str:
    """Return ``core`` or ``fmu``; ``auto`` is the core.

    Raises:
        UsageError: it is none of these names.
    """
    engine = how.get("engine", "auto")
    if engine not in ENGINES:
        raise UsageError(f"--engine {engine!r}: must be one of {', '.join(ENGINES)}")
    return "core" if engine == "auto" else engine


@contextmanager
def open_executor(planner: Planner, how: How, cases: int) -> Iterator[Executor]:
    """Start what runs cases; no more side by side than there are.

    Raises:
        DockloopError: the scheduler cannot be used.
    """
    workers, scheduler = how.get("workers"), how.get("scheduler")
    wanted = count_processors() if workers is None else check_whole("--workers", workers, 1)
    count = min(wanted, cases)
    job = planner.make_job(choose_engine(how))
    if job.engine == "core" and scheduler is None:
        with CoreThreads(planner, job, count) as threads:
            yield threads
        return
    with _open_cluster(count, scheduler) as client:
        yield DaskWorkers(planner, job, client)


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
        except (TypeError, ValueError) as error:
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
        scratch() as folder,
        dask.config.set(
            {"distributed.worker.preload": [ignore], "temporary-directory": str(folder)}
        ),
        _without_main(),
        _start_cluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # its page of health, unseen
            memory_limit=None,
            silence_logs=logging.CRITICAL,
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
    """Check that the workers of a foreign cluster have this package, compiled."""
    found: set[str] = set()
    with suppress(Exception):  # whatever it is, the sentence below says what is needed
        client.wait_for_workers(1, timeout=30)
        found = set(client.run(_say_version).values())
    if found != {__version__}:
        raise DockloopError(
            f"--scheduler {scheduler}: it must have at least one worker, and all of them need the"
            f" Python package dockloop {__version__}"
        )


def _say_version() -> str:
    """Return the version of this package; a worker that has it, compiled, can run cases."""
    load_core()
    return __version__
