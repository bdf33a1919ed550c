"""An FMU in the hands of a host: variables by name, every function of FMI 2.0, and what it logs.

`Host` loads an FMU for co-simulation or model exchange and goes as far as initialization mode.
Failures of the short methods raise FMPy's FMICallException; `status` calls a function of the
interface by its name and returns its fmi2Status, for tests of what is refused. `integrate` is a
solver for model exchange of its own: equal Runge-Kutta steps, events found by bisection.
"""

import ctypes
import hashlib
import math
import pickle
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import (
    FMU2Model,
    FMU2Slave,
    fmi2Boolean,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    fmi2Integer,
    fmi2Real,
    fmi2ValueReference,
)

from dockloop.fmu.binaries import find_loadable

OK, WARNING, DISCARD, ERROR = range(4)
STEP = 0.01  # s


def unpack(fmu):
    """The folder of an unpacked FMU, next to it: it goes when the FMU goes."""
    folder = Path(fmu).with_suffix(".unpacked")
    if not folder.exists():
        new = tempfile.mkdtemp(dir=folder.parent)
        extract(str(fmu), new)
        with suppress(OSError):  # another process was quicker
            Path(new).rename(folder)
    return folder


class Host:
    """An instance of an FMU with variables by name."""

    def __init__(
        self,
        fmu,
        *,
        exchange=False,
        start_time=0.0,
        tolerance=None,
        logging_on=False,
        initialisation=True,
    ):
        self.description = read_model_description(str(fmu))
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.reference = {n: v.valueReference for n, v in self.variables.items()}
        self._of_type = {
            kind: [v.valueReference for v in self.description.modelVariables if v.type == kind]
            for kind in ("Real", "Integer", "Boolean")
        }
        self.information = None  # of the last event
        self.lines = []  # (status, category, text)
        folder, identifier = unpack(fmu), self.description.coSimulation.modelIdentifier
        self.slave = (FMU2Model if exchange else FMU2Slave)(
            guid=self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=identifier,
            instanceName="test",
            libraryPath=find_loadable(Path(folder), identifier),
        )
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log)
        self._callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE()
        self._callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE()
        self.slave.instantiate(callbacks=self._callbacks, loggingOn=logging_on)
        self.time = self.start_time = start_time
        self.slave.setupExperiment(startTime=start_time, tolerance=tolerance)
        self.state_count = self.description.numberOfContinuousStates
        self.indicator_count = self.description.numberOfEventIndicators
        if initialisation:
            self.slave.enterInitializationMode()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.free()

    def free(self):
        """End the instance."""
        self.slave.freeInstance()

    def _log(self, _environment, _instance, status, category, text):
        text = text.decode(errors="surrogateescape").replace("%%", "%")
        self.lines.append((status, category.decode(), text))

    @property
    def last_line(self):
        """Text of the last log line."""
        return self.lines[-1][2]

    def start(self):
        """Leave initialization mode."""
        self.slave.exitInitializationMode()

    # Any function, with its status

    def status(self, function, *arguments):
        """Call a function of the interface and return its status."""
        call = getattr(self.slave.dll, function)
        call.restype = ctypes.c_int
        wrapped = [ctypes.c_double(a) if isinstance(a, float) else a for a in arguments]
        return call(ctypes.c_void_p(self.slave.component), *wrapped)

    def set_status(self, values, kind="Real"):
        """The status of setting variables: a dictionary of names and values."""
        passed = {"Real": fmi2Real, "Integer": fmi2Integer, "Boolean": fmi2Boolean}[kind]
        return self.status(
            f"fmi2Set{kind}",
            self.references(values),
            ctypes.c_size_t(len(values)),
            (passed * len(values))(*values.values()),
        )

    # Values

    def references(self, names):
        """Value references as an array to pass."""
        return (fmi2ValueReference * len(names))(*(self.reference[n] for n in names))

    def get(self, *names):
        """Values of Real variables."""
        return np.array(self.slave.getReal([self.reference[name] for name in names]))

    def value(self, name):
        """The value of one Real variable."""
        return float(self.get(name)[0])

    def vector(self, name, count=3):
        """The elements of a vector."""
        return self.get(*(f"{name}[{i + 1}]" for i in range(count)))

    def put(self, name, values):
        """Set the elements of a vector."""
        names = [self.reference[f"{name}[{i + 1}]"] for i in range(len(values))]
        self.slave.setReal(names, [float(value) for value in values])

    def set(self, **values):
        """Set Real variables; a dot in a name is written as two underscores."""
        for name, value in values.items():
            self.slave.setReal([self.reference[name.replace("__", ".")]], [value])

    def choose(self, **values):
        """Set Integer variables, the same way."""
        for name, value in values.items():
            self.slave.setInteger([self.reference[name.replace("__", ".")]], [value])

    def phase(self):
        """The phase of the docking."""
        return self.slave.getInteger([self.reference["phase"]])[0]

    def everything(self):
        """A fingerprint of the bits of all variables of all types."""
        reals = np.array(self.slave.getReal(self._of_type["Real"]))
        integers = self.slave.getInteger(self._of_type["Integer"])
        booleans = self.slave.getBoolean(self._of_type["Boolean"])
        text = reals.tobytes() + repr((integers, booleans)).encode()
        return hashlib.sha256(text).hexdigest()[:16]

    def differences(self, other, but=()):
        """Names of Real variables whose bits differ from those of another instance."""
        mine = np.array(self.slave.getReal(self._of_type["Real"])).view(np.int64)
        others = np.array(other.slave.getReal(self._of_type["Real"])).view(np.int64)
        names = [v.name for v in self.description.modelVariables if v.type == "Real"]
        return [n for n, a, b in zip(names, mine, others, strict=True) if a != b and n not in but]

    # Co-simulation

    def step(self, size=STEP):
        """One communication step."""
        self.slave.doStep(self.time, size)
        self.time += size

    def step_status(self, size=STEP):
        """The status of a communication step."""
        status = self.status("fmi2DoStep", self.time, size, 1)
        if status <= WARNING:
            self.time += size
        return status

    def slope_status(self, slopes, order=1):
        """The status of setting rates of inputs: a dictionary of names and slopes."""
        count = len(slopes)
        return self.status(
            "fmi2SetRealInputDerivatives",
            self.references(slopes),
            ctypes.c_size_t(count),
            (fmi2Integer * count)(*[order] * count),
            (fmi2Real * count)(*slopes.values()),
        )

    def output_derivatives(self, names, order=1):
        """Status and values of fmi2GetRealOutputDerivatives."""
        values = (fmi2Real * len(names))(*[math.nan] * len(names))
        status = self.status(
            "fmi2GetRealOutputDerivatives",
            self.references(names),
            ctypes.c_size_t(len(names)),
            (fmi2Integer * len(names))(*[order] * len(names)),
            values,
        )
        return status, np.array(values)

    def directional_derivative(self, unknowns, knowns, seeds):
        """Status and values of fmi2GetDirectionalDerivative."""
        values = (fmi2Real * len(unknowns))(*[math.nan] * len(unknowns))
        status = self.status(
            "fmi2GetDirectionalDerivative",
            self.references(unknowns),
            ctypes.c_size_t(len(unknowns)),
            self.references(knowns),
            ctypes.c_size_t(len(knowns)),
            (fmi2Real * len(knowns))(*seeds),
            values,
        )
        return status, np.array(values)

    # Saved states

    def save(self):
        """The present state; released by release()."""
        saved = self.slave.getFMUstate()
        saved.time = self.time
        return saved

    def restore(self, saved):
        """Go back to a state, and to the time at which it was saved."""
        self.slave.setFMUstate(saved)
        self.time = saved.time

    def release(self, saved):
        """Free a state."""
        self.slave.freeFMUstate(saved)

    def save_bytes(self):
        """The present state as bytes."""
        saved = self.save()
        data = self.slave.serializeFMUstate(saved)
        self.release(saved)
        return data

    def restore_bytes(self, data, time):
        """Go back to a state of some time that came as bytes."""
        saved = self.slave.deSerializeFMUstate(data)
        saved.time = time
        self.restore(saved)
        self.release(saved)

    # Model exchange

    def start_exchange(self):
        """Leave initialization mode and settle the first events. Returns the event information."""
        self.start()
        return self.settle()

    def settle(self):
        """Update discrete states in event mode, then go on. Returns the event information."""
        self.information = self.slave.newDiscreteStates()
        self.slave.enterContinuousTimeMode()
        return self.information

    def states(self):
        """The continuous states."""
        x = (fmi2Real * self.state_count)()
        self.slave.getContinuousStates(x, self.state_count)
        return np.array(x)

    def put_states(self, states):
        """Set the continuous states."""
        self.slave.setContinuousStates((fmi2Real * len(states))(*states), len(states))

    def rates(self):
        """The derivatives of the continuous states."""
        rates = (fmi2Real * self.state_count)()
        self.slave.getDerivatives(rates, self.state_count)
        return np.array(rates)

    def nominals(self):
        """The nominal values of the continuous states."""
        nominals = (fmi2Real * self.state_count)()
        self.slave.getNominalsOfContinuousStates(nominals, self.state_count)
        return np.array(nominals)

    def indicators(self):
        """The event indicators."""
        z = (fmi2Real * self.indicator_count)()
        self.slave.getEventIndicators(z, self.indicator_count)
        return np.array(z)

    def put_time(self, time):
        """Set the time in model exchange."""
        self.slave.setTime(time)
        self.time = time

    def rates_at(self, time, states):
        """The derivatives at any time and states."""
        self.put_time(time)
        self.put_states(states)
        return self.rates()

    def runge_kutta_step(self, time, states, size):
        """States after one step of the classic Runge-Kutta method."""
        a = self.rates_at(time, states)
        b = self.rates_at(time + size / 2, states + size / 2 * a)
        c = self.rates_at(time + size / 2, states + size / 2 * b)
        d = self.rates_at(time + size, states + size * c)
        return states + size / 6 * (a + 2 * b + 2 * c + d)

    def integrate(self, stop, size, info, on_event=None):
        """Advance to `stop` in steps of `size`, shortened where an event is due.

        `info` is the event information of the last settle(); the new one is returned.
        """
        x = self.states()
        before = self.indicators()
        while self.time < stop - 4e-16 * abs(stop):
            end = min(self.time + size, stop)
            if info[4] and info[5] < end:
                assert info[5] > self.time, f"the next event is not after t = {self.time} s"
                end = info[5]
            t0, h = self.time, end - self.time
            new = self.runge_kutta_step(t0, x, h)
            self.put_time(end)
            self.put_states(new)
            after = self.indicators()
            crossed = np.any((before > 0) & (after <= 0))
            if crossed:
                low, high = 0.0, h
                for _ in range(45):
                    middle = (low + high) / 2
                    trial = self.runge_kutta_step(t0, x, middle)
                    self.put_time(t0 + middle)
                    self.put_states(trial)
                    if np.any((before > 0) & (self.indicators() <= 0)):
                        high = middle
                    else:
                        low = middle
                new = self.runge_kutta_step(t0, x, high)
                self.put_time(t0 + high)
                self.put_states(new)
            due, _ = self.slave.completedIntegratorStep()
            if crossed or due or (info[4] and self.time >= info[5]):
                self.slave.enterEventMode()
                info = self.settle()
                if on_event:
                    on_event(self)
                new = self.states()
            x = new
            before = self.indicators()
        return info


_GO_ON = """
import pickle, sys
sys.path.insert(0, sys.argv[1])
from extreme_cases.fmi_host import Host
fmu, state, time, steps, starts, seen = sys.argv[2:]
with Host(fmu) as host:
    if starts == "True":
        host.start()
    host.restore_bytes(open(state, "rb").read(), float(time))
    found = []
    for _ in range(int(steps)):
        host.step()
        found.append(host.everything())
pickle.dump(found, open(seen, "wb"))
"""


def go_on_elsewhere(fmu, data, time, steps, folder, *, starts=False):
    """Fingerprints after each of some steps of another process, from a state as bytes.

    Args:
        fmu: the FMU.
        data: the state.
        time: its time.
        steps: how many.
        folder: for two files.
        starts: whether the other instance starts before it takes the state.
    """
    state, seen = Path(folder) / "state", Path(folder) / "seen"
    state.write_bytes(data)
    words = [Path(__file__).parents[1], fmu, state, repr(time), str(steps), str(starts), seen]
    subprocess.run([sys.executable, "-c", _GO_ON, *words], check=True)
    return pickle.loads(seen.read_bytes())
