"""Runs one case: a scene with values, in this process. Threads and Dask workers do the same.

What goes wrong in a case is its result: a status and a sentence. The engine ``core`` steps the
docking of the core; ``fmu`` makes the FMU of the case and steps that through FMPy.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.files import scratch
from dockloop.fmu.build import write_fmu
from dockloop.fmu.host import Instance, Recorder, unpack_fmu
from dockloop.native.core import core_errors, list_final_outcomes, load_core, to_json
from dockloop.native.variables import TYPES
from dockloop.result.recording import Result as Recording
from dockloop.result.recording import list_points
from dockloop.runs.assured import PARAMETERS, assure
from dockloop.runs.outcome import Result
from dockloop.scene.placement import NEVER_TOUCH, find_placement

_LABEL = "the FMU: "  # begins what a docking says, from wherever it runs


@dataclass(frozen=True)
class Job:
    """What all cases of some work have in common.

    Attributes:
        engine: ``core`` or ``fmu``.
        source: file of the scene, as messages name it.
        outputs: outputs to read at the end.
        whole: those of them that are no Reals.
        histories: outputs to read at every communication point.
        experiment: ``stop``, ``step``, ``end_after_outcome`` [s] where cases differ from the scene.
        assured: outputs that are assured at the end (`dockloop.runs.assured`); None: runs once.
        needed: outputs from which it is known whether a case is assured.
    """

    engine: str
    source: Path
    outputs: tuple[str, ...]
    whole: frozenset[str]
    histories: tuple[str, ...]
    experiment: Mapping[str, float]
    assured: tuple[str, ...] | None
    needed: tuple[str, ...]


def run_case(
    job: Job, document: dict, starts: dict[str, Any], check: Callable[[float], None] | None = None
) -> Result:
    """Run one case.

    Args:
        job: what to do.
        document: the resolved scene, vehicles not placed.
        starts: start values of variables, by name.
        check: is called now and then; what it raises ends the case.
    """
    if job.assured is None:
        return _run_once(job, document, starts, check)
    kept = tuple(dict.fromkeys([*job.histories, *job.needed]))
    again = replace(job, outputs=(*job.outputs, *PARAMETERS), histories=kept)
    made: list[tuple[Recording, Result]] = []

    def repeat(more: dict[str, float]) -> Recording:
        result = _run_once(again, document, starts | more, check)
        if result.status != "done":
            raise _NotDoneError(result)
        parameters = zip(PARAMETERS, result.outputs[len(job.outputs) :], strict=True)
        values = np.array(result.histories, dtype=float).T
        names, units = ["time", *kept], [""] * (1 + len(kept))
        made.append((Recording({}, names, units, values, dict(parameters)), result))
        return made[-1][0]

    try:
        found = assure(repeat({}), repeat, job.assured)
    except _NotDoneError as error:
        return error.result
    except UsageError as error:
        return replace(made[0][1], status="refused", reason=str(error), outputs=(), histories=())
    last = next(result for recording, result in made if recording.values is found.values)
    of: Any = found.assurance
    return replace(
        last,
        outputs=last.outputs[: len(job.outputs)],
        histories=last.histories[: 1 + len(job.histories)] if job.histories else (),
        assured=of.to_case(),
    )


class _NotDoneError(DockloopError):
    """A run of a case was not done."""

    def __init__(self, result: Result) -> None:
        super().__init__(result.reason or result.status)
        self.result = result


def list_case_points(document: dict, experiment: Mapping[str, float]) -> np.ndarray:
    """Return the communication points of a case [s]: of its scene, but for what is given."""
    all_of_it = {**document["experiment"], **experiment}
    return list_points(*(float(all_of_it[name]) for name in ("start", "stop", "step")))


def _run_once(
    job: Job,
    document: dict,
    starts: dict[str, Any],
    check: Callable[[float], None] | None,
) -> Result:
    """Run a case without assurance."""
    result, warnings, label = Result("refused"), [], ""
    docking: Any = None
    try:
        times = list_case_points(document, job.experiment).tolist()
        with core_errors(), _ENGINES[job.engine](job, document, times) as docking:
            label = _LABEL
            warnings += [] if docking.touches else [NEVER_TOUCH]
            result.end_time = times[0]
            docking.set(docking.find(list(starts)), [float(value) for value in starts.values()])
            docking.start()
            result.status = "failed"
            values, *_ = docking.record(
                times,
                docking.find([*job.histories, *job.outputs]),
                job.experiment.get("end_after_outcome", math.inf),
                last_only=not job.histories,
                progress=check,
            )
            warnings += docking.take_warnings()
    except DockloopError as error:
        reason = label + str(error).removeprefix(label)
        if result.status == "failed":
            result.end_time, reason = docking.time, f"at {docking.time:.9g} s: {reason}"
        result.reason = reason
    else:
        result.status, result.end_time = "done", docking.time
        columns = values.T.tolist()
        kept = len(job.histories)
        if kept:
            result.histories = (times[: len(values)], *columns[:kept])
        result.outputs = tuple(
            int(column[-1]) if name in job.whole else column[-1]
            for name, column in zip(job.outputs, columns[kept:], strict=True)
        )
    result.warning = "; ".join(warnings) or None
    return result


@contextmanager
def _open_core(job: Job, document: dict, _: list[float]) -> Iterator[Any]:
    """Make the docking of the core."""
    yield load_core().Docking(to_json(document), str(job.source), place=True)


@contextmanager
def _open_fmu(job: Job, document: dict, times: list[float]) -> Iterator["FmuDocking"]:
    """Make the FMU of a case, and load it."""
    touches = find_placement(document, job.source) != NEVER_TOUCH
    with scratch(_worker_folder()) as folder:
        write_fmu(document, job.source, folder / "case.fmu", kernel=False, bare=True)
        description, _ = unpack_fmu(folder / "case.fmu", folder)
        with Instance(description, str(folder), _LABEL.rstrip(": ")) as instance:
            yield FmuDocking(instance, times, touches=touches)


_ENGINES = {"core": _open_core, "fmu": _open_fmu}


class FmuDocking:
    """An FMU with what a case needs of a docking of the core: a row is the name of a variable."""

    def __init__(self, instance: Instance, times: list[float], *, touches: bool) -> None:
        self.touches = touches
        self._instance, self._times = instance, times
        self._starts: list[tuple[Any, Any]] = []
        self._variables = {v.name: v for v in instance.description.modelVariables}

    @property
    def time(self) -> float:
        """The time that the last step has led to [s]."""
        return self._instance.time

    def find(self, names: list[str]) -> list[str]:
        """Return the rows of variables."""
        return names

    def set(self, rows: list[str], values: list[float]) -> None:
        """Set start values."""
        variables = [self._variables[row] for row in rows]
        self._starts = [(v, TYPES[v.type](x)) for v, x in zip(variables, values, strict=True)]

    def start(self) -> None:
        """Initialise. Raises UsageError: a start value is refused."""
        self._instance.initialise(self._starts, np.array(self._times))

    def record(
        self,
        times: list[float],
        rows: list[str],
        patience: float,
        *,
        last_only: bool,
        progress: Callable[[float], None] | None,
    ) -> tuple[np.ndarray]:
        """Step and read all rows, until the outcome has been final for `patience` [s]."""
        instance, final, last = self._instance, list_final_outcomes(), len(times) - 1
        recorder = Recorder(instance.slave, instance.description, len(times), {*rows, "outcome"})
        names, outcomes = recorder.names, recorder.values[:, recorder.names.index("outcome")]
        decision, since = 0, times[0]

        def is_over(row: int) -> bool:
            nonlocal decision, since, last
            if (outcome := outcomes[row]) != decision:
                decision, since = outcome, times[row]
            if decision not in final or times[row] - since < patience:
                return False
            last = row
            return True

        instance.loop(np.array(times), recorder, progress, is_over=is_over)
        chosen = recorder.values[last if last_only else 0 : last + 1]
        return (chosen[:, [names.index(name) for name in rows]],)

    def take_warnings(self) -> list[str]:
        """Return what the FMU had to say."""
        return self._instance.warnings


def _worker_folder() -> str | None:
    """Return the folder of this worker, which outlives no cluster; None outside of one."""
    from distributed import get_worker

    try:
        return get_worker().local_directory
    except ValueError:
        return None
