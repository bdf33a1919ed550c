"""Drives one FMU through one docking with FMPy and records every output.

The loop is kept lean, because it is the yardstick for the price of co-simulation: buffers are
allocated once, and a communication step costs one fmi2DoStep and at most three get calls
(all Reals, all Integers, all Booleans). Peaks between communication points are found inside the
FMU, so the step may be as coarse as the plots allow.
"""

import ctypes
import os
import time
import zipfile
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import fmi2, read_model_description
from fmpy.fmi1 import FMICallException

from dockloop.base.errors import (
    DockloopError,
    UsageError,
    check_current_folder,
    did_you_mean,
    find_reason,
    without_function,
)
from dockloop.base.files import filling, scratch
from dockloop.base.number import read_number, read_whole
from dockloop.base.paths import check_file, shown
from dockloop.base.system import interrupting_later
from dockloop.fmu.binaries import find_loadable
from dockloop.native.variables import WORDS, find_number, fits, list_names, match_names, say_matches
from dockloop.result.recording import Result, list_points, warn_of_driven
from dockloop.result.summary import is_summarised
from dockloop.scene.carried import read_scene
from dockloop.scene.resolve import scene_members

_WARNING = 1  # fmi2Warning
_CHOICES = b"logChoices"  # category of what `accuracy` has chosen
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


def run_fmu(
    path: Path,
    settings: Iterable[str] = (),
    stop: float | None = None,
    step: float | None = None,
    *,
    outputs: Iterable[str] = (),
    check_size: Callable[[int, int], None] | None = None,
    progress: Callable[[float], None] | None = None,
    label: str | None = None,
    given_by: Mapping[str, str] | None = None,
) -> Result:
    """Run an FMU from its start time to `stop`.

    Args:
        path: the FMU.
        settings: ``NAME=VALUE`` texts: start values to set before initialisation.
        stop: end [s]; default: the FMU's default experiment.
        step: communication step [s]; default: the FMU's default experiment.
        outputs: patterns of the outputs to record (`variables.fits`), as well as those that a
            summary needs; default: all.
        check_size: receives the numbers of points and of chosen columns before the run.
        progress: called now and then with the part of the run that is done, 0 to 1.
        label: what errors call the FMU; default: its path.
        given_by: of settings that no ``--set`` has given: with what messages about them begin.

    Returns:
        Every output (that is wanted) at every communication point, start included.

    Raises:
        UsageError: the file is no FMU of this program, or a setting is bad or refused.
        DockloopError: the FMU reported an error while running.
    """
    began = time.perf_counter()
    with scratch() as folder:
        description, scene = unpack_fmu(path, folder)
        parsed = {text: _parse_settings(text, description) for text in settings}
        origins = {text: f"--set {text}" for text in parsed} | dict(given_by or {})
        starts = {v.name: (v, value) for found in parsed.values() for v, value in found}
        begins = {v.name: origins[text] for text, found in parsed.items() for v, _ in found}
        times = communication_points(description, stop, step)
        chosen = choose_outputs([v.name for v in _list_outputs(description)], tuple(outputs))
        if check_size:
            check_size(len(times), 1 + len(chosen))
        with Instance(description, str(folder), label or shown(path)) as instance:
            instance.initialise([*starts.values()], times, begins)
            loaded = time.perf_counter()
            wanted = chosen | {v.name for v in _list_outputs(description) if is_summarised(v.name)}
            recording = record(instance, scene, times, progress, wanted=wanted)
            recording.wall["load"] = loaded - began
            recording.notes += [say_matches(t, len(f)) for t, f in parsed.items() if "*" in t]
            recording.warnings += warn_of_driven(scene)
    return recording


def choose_outputs(outputs: list[str], patterns: tuple[str, ...]) -> set[str]:
    """Return the outputs that patterns mean; all without patterns. Raises UsageError."""
    for pattern in patterns:
        if not any(fits(name, pattern) for name in outputs):
            near = did_you_mean(pattern, outputs)
            raise UsageError(f"--outputs {pattern}: no output of the FMU has such a name{near}")
    return {n for n in outputs if not patterns or any(fits(n, pattern) for pattern in patterns)}


def record(
    instance: "Instance",
    scene: dict,
    times: np.ndarray,
    progress: Callable[[float], None] | None = None,
    *,
    clock: Callable[[], float] = time.perf_counter,
    wanted: Collection[str] | None = None,
) -> Result:
    """Step an initialised instance through all communication points.

    `clock` times it [s]; `wanted` are the outputs to record, all if it is None.
    """
    recorder = Recorder(instance.slave, instance.description, len(times), wanted)
    recording = Result(scene, recorder.names, recorder.units, recorder.values)
    try:
        recording.parameters = instance.read_parameters()
    except FMICallException as error:
        raise DockloopError(instance.sentence(error)) from None
    recording.wall = instance.loop(times, recorder, progress, clock)
    recording.warnings, recording.notes = instance.warnings, instance.notes
    return recording


class Instance:
    """One instance of an FMU; as a context manager it is freed whatever happens."""

    def __init__(self, description: Any, folder: str, label: str) -> None:
        self.description = description
        self._label, self._folder = label, folder
        self._log: list[str] = []
        self.time = 0.0  # that the last step has led to [s]
        self._stack = ExitStack()
        self.interrupt: Callable[[], None] = lambda: None  # if that was asked for in a call
        self.warnings: list[str] = []
        self.notes: list[str] = []
        # The callbacks must live as long as the instance, so they are kept here.
        self._callbacks = fmi2.fmi2CallbackFunctions()
        self._callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._on_log)
        self._callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
        self._callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
        identifier = description.coSimulation.modelIdentifier
        check_current_folder()
        here = Path.cwd()  # FMPy goes elsewhere to load, and stays there when it fails
        try:
            self.slave = fmi2.FMU2Slave(
                guid=description.guid,
                unzipDirectory=folder,
                modelIdentifier=identifier,
                instanceName=description.modelName,
                libraryPath=find_loadable(Path(folder), identifier),
            )
        except Exception as error:  # noqa: BLE001  FMPy raises a bare Exception here
            os.chdir(here)
            why = self._without_folder(str(error))
            remedy = ""
            noexec = getattr(os, "ST_NOEXEC", 0)  # of Linux only
            if noexec and os.statvfs(folder).f_flag & noexec:
                remedy = (
                    f": {Path(folder).parent} is mounted noexec, so let TMPDIR name another folder"
                )
            raise DockloopError(f"{label}: its binary cannot be loaded ({why}){remedy}") from None

    def __enter__(self) -> "Instance":
        try:
            self.slave.instantiate(callbacks=self._callbacks, loggingOn=True)
        except Exception as error:  # noqa: BLE001  FMPy raises a bare Exception here
            self.slave.freeLibrary()
            raise UsageError(self.sentence(error)) from None
        self.interrupt = self._stack.enter_context(interrupting_later())  # the FMU calls `_on_log`
        self._stack.callback(self.slave.freeInstance)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def initialise(
        self, starts: list[tuple], times: np.ndarray, begins: Mapping[str, str] | None = None
    ) -> None:
        """Set start values and initialise at times[0]; refusals are the caller's fault.

        `begins` are those of messages about values, by the name of the variable.
        """
        slave, self.time, begins = self.slave, float(times[0]), begins or {}
        begin = None
        try:
            # No tolerance from here: the parameter solver.rtol decides.
            slave.setupExperiment(startTime=times[0], stopTime=times[-1])
            for variable, value in starts:
                begin = begins.get(variable.name)
                getattr(slave, f"set{variable.type}")([variable.valueReference], [value])
            begin = None
            slave.enterInitializationMode()
            slave.exitInitializationMode()
        except FMICallException as error:
            said = self._say(error)
            if begin is None:  # what is said begins with the name of a variable or of a vector
                word = said.partition(" ")[0]
                known = (b for name, b in begins.items() if name.partition("[")[0] == word)
                begin = next(known, self._label)
            raise UsageError(f"{begin}: {said}") from None

    def read_parameters(self) -> dict[str, float]:
        """Read every parameter that is a number."""
        values: dict[str, float] = {}
        for kind, get in (("Real", self.slave.getReal), ("Integer", self.slave.getInteger)):
            found = [
                v
                for v in self.description.modelVariables
                if v.type == kind and v.causality in ("parameter", "calculatedParameter")
            ]
            names = [v.name for v in found]
            values |= zip(names, get([v.valueReference for v in found]), strict=True)
        return values

    def loop(
        self,
        times: np.ndarray,
        recorder: "Recorder",
        progress: Callable | None,
        clock: Callable[[], float] = time.perf_counter,
        is_over: Callable[[int], bool] = lambda _: False,
    ) -> dict[str, float]:
        """Step through all communication points; returns the time by `clock`, and its split [s].

        After each step, `is_over` says for the row that was read whether it was the last one.
        """
        do_step, component = self.slave.fmi2DoStep, self.slave.component
        points, stepping, reading, last = times.tolist(), 0.0, 0.0, len(times) - 1
        interrupt = self.interrupt
        began = clock()
        try:
            recorder.read(0, points[0])
            for i in range(last):
                t0 = clock()
                do_step(component, points[i], points[i + 1] - points[i], fmi2.fmi2True)
                t1 = clock()
                recorder.read(i + 1, points[i + 1])
                t2 = clock()
                stepping += t1 - t0
                reading += t2 - t1
                self.time = points[i + 1]
                interrupt()
                if progress:
                    progress((i + 1) / last)
                if is_over(i + 1):
                    break
        except FMICallException as error:
            raise DockloopError(self.sentence(error)) from None
        self.slave.terminate()
        return {"loop": clock() - began, "do_step": stepping, "read": reading}

    def _on_log(self, _env: Any, _name: bytes, status: int, category: bytes, text: bytes) -> None:
        message = (text or b"").decode(errors="replace").replace("%%", "%").strip()
        if category == _CHOICES:
            self.notes.append(message)
        elif status == _WARNING:
            self.warnings.append(message)
        elif status > _WARNING:
            self._log.append(message)

    def sentence(self, error: Exception) -> str:
        """Return why the last call failed, in the words of the FMU after its name."""
        return f"{self._label}: {self._say(error)}"

    def _say(self, error: Exception) -> str:
        text = self._log[-1] if self._log else f"the FMU refused without a message ({error})"
        return self._without_folder(without_function(text))

    def _without_folder(self, text: str) -> str:
        """Return a sentence that names files of the FMU as people know them."""
        return text.replace(f"{self._folder}{os.sep}", "")


class Recorder:
    """Buffers for all outputs, or variables that are wanted; reading is one call per data type."""

    def __init__(
        self,
        slave: fmi2.FMU2Slave,
        description: Any,
        points: int,
        wanted: Collection[str] | None = None,
    ) -> None:
        outputs = _list_outputs(description)
        if wanted is not None:
            outputs = [v for v in description.modelVariables if v.name in wanted]
        self._component = slave.component
        self._calls = []
        self.names, self.units = ["time"], ["s"]
        for type_name, getter, c_type in (
            ("Real", slave.fmi2GetReal, ctypes.c_double),
            ("Integer", slave.fmi2GetInteger, ctypes.c_int),
            ("Boolean", slave.fmi2GetBoolean, ctypes.c_int),
        ):
            chosen = [v for v in outputs if v.type == type_name]
            if not chosen:
                continue
            count = len(chosen)
            references = (ctypes.c_uint * count)(*(v.valueReference for v in chosen))
            buffer = (c_type * count)()
            columns = slice(len(self.names), len(self.names) + count)
            view = np.ctypeslib.as_array(buffer)
            self._calls.append((getter, references, count, buffer, view, columns))
            self.names += [v.name for v in chosen]
            self.units += [v.unit or "" for v in chosen]
        self.values = np.zeros((points, len(self.names)))

    def read(self, row: int, t: float) -> None:
        """Store all outputs at time t [s] in one row."""
        values = self.values[row]
        values[0] = t
        for getter, references, count, buffer, view, columns in self._calls:
            getter(self._component, references, count, buffer)
            values[columns] = view


def unpack_fmu(path: Path, folder: Path) -> tuple[Any, dict]:
    """Unpack an FMU of this program; returns its model description and its scene.

    Raises:
        UsageError: it is none, or is damaged.
        DockloopError: there is no space for it.
    """
    scene = read_scene(path)
    description = unpack(path, folder)
    if description.defaultExperiment is None:
        raise _damaged(path)
    return description, scene


def _damaged(path: Path) -> UsageError:
    return UsageError(
        f"{shown(path)}: its modelDescription.xml is missing or damaged: build it again"
    )


def unpack(path: Path, folder: Path) -> Any:
    """Unpack an FMU for co-simulation, of any program; returns its model description.

    Raises:
        UsageError: it is none, or is damaged.
        DockloopError: there is no space for it.
    """
    check_file(path, "FMU")
    try:
        with filling(folder), zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
    except DockloopError:
        raise
    except Exception as error:  # noqa: BLE001  zip files break in a dozen ways
        why = find_reason(error) if isinstance(error, OSError) else error
        raise UsageError(
            f"{shown(path)}: is damaged, it cannot be unpacked ({why}): build it again"
        ) from None
    try:
        description = read_model_description(str(folder), validate=False)
        given = description.defaultExperiment
        for value in (given.startTime or 0.0, given.stopTime, given.stepSize) if given else ():
            float(value)
    except Exception:  # noqa: BLE001  FMPy takes a description as it is
        raise _damaged(path) from None
    if description.coSimulation is None:
        raise UsageError(f"{shown(path)}: has no co-simulation interface")
    return description


def _list_outputs(description: Any) -> list[Any]:
    return [v for v in description.modelVariables if v.causality == "output"]


def _parse_settings(text: str, description: Any) -> list[tuple[Any, Any]]:
    """Parse one NAME=VALUE, where NAME may have ``*``; returns variables and values."""
    name, equals, value = (part.strip() for part in text.rpartition("="))
    if not equals:
        return [_parse_setting(text, description)]
    settable = [v.name for v in description.modelVariables if _is_settable(v)]
    names = match_names(name, settable, f"--set {text}")
    return [_parse_setting(f"{each}={value}", description) for each in names]


def _is_settable(variable: Any) -> bool:
    """Return whether a variable takes a start value."""
    given = variable.causality in ("parameter", "input") or variable.initial in ("exact", "approx")
    return given and variable.variability != "constant"


def _parse_setting(text: str, description: Any) -> tuple[Any, Any]:
    """Parse one NAME=VALUE against the variables of an FMU; returns variable and value."""
    name, equals, value_text = (part.strip() for part in text.rpartition("="))
    if not equals or not name:
        raise UsageError(f"--set {text}: must be NAME=VALUE, for example friction.coefficient=0.2")
    variables = {v.name: v for v in description.modelVariables}
    if name not in variables:
        hint = did_you_mean(name, [v.name for v in variables.values() if _is_settable(v)])
        if name.startswith("coupling."):
            hint = "; only a vehicle that a host integrates needs it: --scene chaser.motion=driven"
        elif name in scene_members():
            hint = f"; it is a key of the scene: build with --scene {name}={value_text}"
        raise UsageError(f"--set {text}: the FMU has no variable '{name}'{hint}")
    variable = variables[name]
    if not _is_settable(variable):
        raise UsageError(f"--set {text}: '{name}' is computed by the FMU and has no start value")
    try:
        value = _parse_as(variable.type, value_text)
    except ValueError:
        word = value_text.strip('"')
        if list_names(name, variable.description or "") and word[:1].isalpha():
            try:
                return variable, find_number(name, variable.description, word)
            except UsageError as error:
                raise UsageError(f"--set {text}: {error}") from None
        raise UsageError(
            f"--set {text}: '{name}' must be {WORDS.get(variable.type, variable.type)}"
        ) from None
    return variable, value


def _parse_as(type_name: str, text: str) -> Any:
    """Parse a value of an FMI data type. Raises ValueError."""
    match type_name:
        case "Real":
            return read_number(text)
        case "Integer":
            return read_whole(text)
        case "Boolean":
            if text.lower() not in _BOOLEANS:
                raise ValueError
            return _BOOLEANS[text.lower()]
    return text


def communication_points(description: Any, stop: float | None, step: float | None) -> np.ndarray:
    """Return all communication points [s] of an FMU; the last step is shorter if it must be."""
    default = description.defaultExperiment
    return list_points(
        float(default.startTime or 0.0),
        float(default.stopTime) if stop is None else stop,
        float(default.stepSize) if step is None else step,
    )
