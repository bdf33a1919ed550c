"""An FMU on the bench: unpacked once, run again and again, each time in a fresh instance."""

import hashlib
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import fmi2
from fmpy.fmi1 import FMICallException

from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.files import scratch
from dockloop.fmu.host import Instance, Recorder, communication_points, record, unpack_fmu
from dockloop.native.variables import list_outputs
from dockloop.result.accuracy import ATOL_PER_RTOL
from dockloop.result.recording import Result

_CLOSE = 1e-9  # s: the same time


class Bench:
    """An FMU that is run with many settings.

    Attributes:
        fmu_digest: SHA-256 of the FMU.
        variables: of the FMU, by name.
        outputs: names of its outputs.
        scene: the resolved scene.
        model: the file of the scene, as the FMU reads it.
        step: communication step of the default experiment [s].
        stop: its end [s].
    """

    def __init__(self, fmu: Path) -> None:
        """Unpack an FMU; its folder goes with this object."""
        with ExitStack() as made:
            self._folder = made.enter_context(scratch())
            self._description, self.scene = unpack_fmu(fmu, self._folder)
            self._made = made.pop_all()
        self.fmu_digest = hashlib.sha256(fmu.read_bytes()).hexdigest()
        self.model = self._folder / "resources" / "model.json"
        self.variables = {v.name: v for v in self._description.modelVariables}
        self.outputs = list_outputs(self.variables)
        self.step = float(self._description.defaultExperiment.stepSize)
        self.stop = float(self._description.defaultExperiment.stopTime)

    def start(self, name: str) -> float | int | None:
        """Return the start value of a parameter; None if the FMU does not have it."""
        variable = self.variables.get(name)
        if variable is None:
            return None
        return (int if variable.type == "Integer" else float)(variable.start)

    def tolerances(self, rtol: float) -> dict[str, float]:
        """Return start values for a relative tolerance; absolute ones keep their ratio to it."""
        factor = rtol / self.start("solver.rtol")
        names = (f"solver.{name}" for name in ATOL_PER_RTOL)
        return {"solver.rtol": rtol} | {name: self.start(name) * factor for name in names}

    def run(self, starts: dict[str, Any], stop: float, step: float) -> Result:
        """Run to `stop`; `wall` of the recording is processor time of this thread.

        Raises:
            UsageError: a start value was refused.
            DockloopError: a step was.
        """
        with self._initialised(starts, stop, step) as (instance, times):
            return record(instance, self.scene, times, clock=time.thread_time)

    def probe(self, starts: dict[str, Any], stop: float, step: float, at: np.ndarray) -> Result:
        """Run the same, but record the times `at`, also those between communication points.

        To look there a shorter step is made and taken back: what follows is not changed.
        """
        with self._initialised(starts, stop, step) as (instance, times):
            slave = instance.slave
            recorder = Recorder(slave, self._description, len(at))
            rows = np.searchsorted(at, times - _CLOSE)  # of the first that is not before
            for i in range(len(times)):
                if rows[i] < len(at) and abs(at[rows[i]] - times[i]) < _CLOSE:
                    recorder.read(rows[i], at[rows[i]])
                if i == len(times) - 1:
                    break
                begin, end = float(times[i]), float(times[i + 1])
                between = [row for row in range(rows[i], rows[i + 1]) if at[row] > begin + _CLOSE]
                if between:
                    state = slave.getFMUstate()
                    for row in between:
                        _step(slave, begin, float(at[row]))
                        recorder.read(row, at[row])
                        slave.setFMUstate(state)
                    slave.freeFMUstate(state)
                _step(slave, begin, end)
        return Result(self.scene, recorder.names, recorder.units, recorder.values)

    @contextmanager
    def _initialised(
        self, starts: dict[str, Any], stop: float, step: float
    ) -> Iterator[tuple[Instance, np.ndarray]]:
        """Yield an initialised instance and its communication points."""
        for name in starts:
            if name not in self.variables:
                raise UsageError(f"the FMU has no variable '{name}'")
        times = communication_points(self._description, stop, step)
        reported = [(self.variables[name], value) for name, value in starts.items()]
        with Instance(self._description, str(self._folder), "the FMU") as instance:
            try:
                instance.initialise(reported, times)
                yield instance, times
            except FMICallException as error:
                raise DockloopError(instance.sentence(error).removeprefix("the FMU: ")) from None
            except DockloopError as error:
                raise type(error)(str(error).removeprefix("the FMU: ")) from None


def _step(slave: Any, begin: float, end: float) -> None:
    slave.fmi2DoStep(slave.component, begin, end - begin, fmi2.fmi2False)
