"""Runs single cases of a sweep; this is all that happens on a worker.

A worker receives the bytes of an FMU once, loads it once and resets it (``fmi2Reset``) before every
case, so that a case does not know what ran before it, nor where. What goes wrong in a case is its
result: a status and a sentence.
"""

import itertools
import threading
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from fmpy import fmi2
from fmpy.fmi1 import FMICallException

from dockloop import __version__
from dockloop.errors import DockloopError, UsageError
from dockloop.outputs import scratch
from dockloop.simulate import Instance, communication_points, unpack_fmu

STATUSES = ("done", "refused", "failed", "lost")  # what can become of a case
_MOST_LOADED = 4  # FMUs that a thread keeps loaded
_MINE = threading.local()  # FMUs of this thread: their digest -> LoadedFmu


@dataclass(frozen=True)
class Job:
    """What to do with an FMU in one case.

    Attributes:
        starts: start values to set, by name.
        outputs: outputs to read at the end.
        stop: end [s]; None: of the default experiment.
        step: communication step [s]; None: of the default experiment.
        histories: outputs to read at every communication point.
        end_after_outcome: end when the outcome has been final for this long [s]; None: never.
        final: numbers of the final outcomes.
        warning: issued when the vehicles were placed.
    """

    starts: tuple[tuple[str, float | int | bool], ...]
    outputs: tuple[str, ...]
    histories: tuple[str, ...]
    stop: float | None
    step: float | None
    end_after_outcome: float | None
    final: tuple[int, ...]
    warning: str | None = None


@dataclass
class Result:
    """What became of one case.

    Attributes:
        status: one of `STATUSES`: refused is its start, failed a step, lost its worker.
        reason: why it is not done.
        warning: what the FMU or the placement had to say.
        end_time: where it ended [s].
        outputs: the values of the outputs there; empty unless done.
        histories: times [s], then each output that is kept at every communication point; empty
            unless done.
    """

    status: str
    reason: str | None = None
    warning: str | None = None
    end_time: float | None = None
    outputs: tuple[float | int | bool, ...] = ()
    histories: tuple[Sequence[float], ...] = ()


def run_case(fmu: bytes, digest: str, job: Job) -> Result:
    """Run one case.

    Args:
        fmu: the FMU file.
        digest: its SHA-256.
        job: what to do.
    """
    loaded = _find_loaded(fmu, digest)
    try:
        result = loaded.run(job)
    except DockloopError as error:  # start with a fresh instance after a failure
        _MINE.loaded.pop(digest).close()
        status = "refused" if isinstance(error, UsageError) else "failed"
        result = Result(status, str(error), end_time=loaded.time)
    result.warning = "; ".join(text for text in (job.warning, result.warning) if text) or None
    return result


def say_version() -> str:
    """Return the version of this package; a worker that has it can run cases."""
    return __version__


class LoadedFmu:
    """One instance of an FMU, ready to run case after case."""

    def __init__(self, fmu: bytes) -> None:
        """Unpack and load the FMU."""
        self._used = False
        self.time: float | None = None
        with ExitStack() as made:
            folder = made.enter_context(scratch(_worker_folder()))
            path = folder / "case.fmu"
            path.write_bytes(fmu)
            self._description, _ = unpack_fmu(path, folder)
            self._variables = {v.name: v for v in self._description.modelVariables}
            self._instance = Instance(self._description, str(folder), "the FMU")
            made.enter_context(self._instance)
            self._made = made.pop_all()

    def close(self) -> None:
        """Free the instance and its files."""
        self._made.close()

    def run(self, job: Job) -> Result:
        """Run one case from its start to its end.

        Raises:
            UsageError: the start was refused.
            DockloopError: a step was.
        """
        if self._used:
            self._instance.reset()
        self._used = True
        times = communication_points(self._description, job.stop, job.step)
        self.time = float(times[0])
        starts = [(self._variables[name], value) for name, value in job.starts]
        self._instance.initialise(starts, times)
        try:
            histories = self._step(times.tolist(), job)
            outputs = tuple(self._read(name) for name in job.outputs)
            self._instance.slave.terminate()
        except FMICallException as error:
            raise DockloopError(f"at {self.time:.9g} s: {self._instance.sentence(error)}") from None
        warning = "; ".join(self._instance.warnings) or None
        return Result(
            "done", None, warning, self.time, outputs, tuple(zip(*histories, strict=True))
        )

    def _step(self, points: list[float], job: Job) -> list[tuple[float, ...]]:
        """Step through all points, or until the outcome has been final for long enough.

        Returns:
            The time and ``job.histories`` at each point; nothing without such outputs.
        """
        histories: list[tuple[float, ...]] = []

        def keep(time: float) -> None:
            if job.histories:
                histories.append((time, *(float(self._read(name)) for name in job.histories)))

        do_step, component = self._instance.slave.fmi2DoStep, self._instance.slave.component
        decision, since = 0, points[0]
        keep(points[0])
        for begin, end in itertools.pairwise(points):
            do_step(component, begin, end - begin, fmi2.fmi2True)
            self.time = end
            keep(end)
            if job.end_after_outcome is not None:
                outcome = self._read("outcome")
                if outcome != decision:
                    decision, since = outcome, end
                if decision in job.final and end - since >= job.end_after_outcome:
                    break
        return histories

    def _read(self, name: str) -> Any:
        variable = self._variables[name]
        return getattr(self._instance.slave, f"get{variable.type}")([variable.valueReference])[0]


def _find_loaded(fmu: bytes, digest: str) -> LoadedFmu:
    """Return this thread's instance of an FMU; those used longest ago make room."""
    if not hasattr(_MINE, "loaded"):
        _MINE.loaded = OrderedDict()
    loaded = _MINE.loaded
    if digest not in loaded:
        if len(loaded) == _MOST_LOADED:
            loaded.popitem(last=False)[1].close()
        loaded[digest] = LoadedFmu(fmu)
    loaded.move_to_end(digest)
    return loaded[digest]


def _worker_folder() -> str | None:
    """Return the folder of this worker, which outlives no cluster; None outside of one."""
    from distributed import get_worker

    try:
        return get_worker().local_directory
    except ValueError:
        return None
