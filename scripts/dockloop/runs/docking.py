"""Dockings in this process: a scene, a docking that is stepped, a run. No FMU, no files.

The compiled core takes the steps that the FMU of the scene would take, with the same bits. (An FMU
with generated code for its mechanism may differ by rounding: ``dockloop run --no-kernel``.)
"""

import copy
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from dockloop.base.errors import UsageError, did_you_mean, names_arguments, say_value
from dockloop.base.number import as_number, check_number, is_number, to_plain
from dockloop.native.core import core_errors, name_choice, name_source, to_json
from dockloop.native.variables import (
    TYPES,
    WORDS,
    Value,
    find_number,
    list_names,
    list_outputs,
    match_names,
    read_variables,
    say_matches,
)
from dockloop.result.accuracy import estimate_error as find_estimate
from dockloop.result.recording import Result, find_vector, list_points, warn_of_driven
from dockloop.runs.assured import ESTIMATED_TOO, assure, check_assurable
from dockloop.scene.find import find_scene
from dockloop.scene.placement import blaming_start, read_placed
from dockloop.scene.resolve import SceneReader, list_matches, scene_members, write_scene
from dockloop.scene.values import as_setting

ANNOUNCED = (".force_mean", ".torque_mean")  # with which a host that steps first moves


class Scene:
    """A scene with overrides: what is modelled, read once and checked.

    Attributes:
        reference: name of the shipped scene, or path of the file, as commands take it.
        path: the scene file.
        overrides: keys in which it differs from its file.
        texts: the same as ``KEY=VALUE``.
        name: of the scene.
        title: one line.
        document: the resolved scene, all quantities in SI units (``resources/model.json`` of an
            FMU); both vehicles are at their start.
        warnings: issued when the vehicles were placed.
        notes: how many members each override with ``*`` sets.
    """

    @names_arguments
    def __init__(
        self,
        reference: "str | Path | Scene | Mapping[str, Any]",
        overrides: Mapping[str, Any] | None = None,
        reader: SceneReader | None = None,
    ) -> None:
        """Read a scene.

        Args:
            reference: name of a shipped scene, path of a ``.toml`` file, the members of such a
                file, or a scene to read again. Among the members, ``mechanism`` may have those of a
                mechanism file.
            overrides: values of keys of the scene file, in the units of the file:
                ``{"initial.closing_speed": 0.05, "chaser.motion": "driven"}``.
            reader: of this scene, which has read its files; for many overrides in a row.

        Raises:
            UsageError: naming file, member, value and limit.
        """
        self.overrides: dict[str, Any] = {
            name: value.tolist() if isinstance(value, np.ndarray | np.generic) else value
            for name, value in (overrides or {}).items()
        }
        if isinstance(reference, Scene):
            self.overrides = reference.overrides | self.overrides
            reference = reference.reference
        if isinstance(reference, Mapping):
            reference = write_scene(reference)
        self.reference = str(reference)
        self.path: Path = find_scene(self.reference)
        self.texts = [as_setting(name, value) for name, value in self.overrides.items()]
        self.warnings: list[str] = []
        self.document = read_placed(self.path, self.texts, reader, self.warnings.append)
        self.notes = list_matches(self.path, self.texts)
        self.name: str = self.document["name"]
        self.title: str = self.document["title"]

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {self.overrides})"


class Docking:
    """A docking that its caller steps, with the bits of the FMU.

    ::

        docking = Docking("idss_25t_350t", overrides={"initial.closing_speed": 0.05})
        docking.set("friction.coefficient", 0.2)
        while not docking.get("captured") and docking.time < 20.0:
            docking.step(0.01)

    Threads may share a docking: their calls wait for each other. A copy (`copy.copy`, `pickle`) is
    another docking in the same state.

    Attributes:
        scene: what is modelled.
        variables: everything that can be read or set, by name.
        warnings: issued so far.
        notes: what the parameter ``accuracy`` has chosen, and what it has left out; how many names
            a setting with ``*`` has set.
    """

    def __init__(
        self,
        scene: str | Path | Scene | Mapping[str, Any],
        overrides: Mapping[str, Any] | None = None,
    ) -> None:
        """Make a docking at its start.

        Args:
            scene: name of a shipped scene, path of a ``.toml`` file, its members, or a `Scene`.
            overrides: as for `Scene`.

        Raises:
            UsageError: naming file, member, value and limit.
        """
        if not isinstance(scene, Scene) or overrides:
            scene = Scene(scene, overrides)
        self.scene: Scene = scene
        self._lock = threading.RLock()  # of all below but the core, which has its own
        self.reset()
        self.variables = read_variables(self._core)
        self._rows: dict[str, list[int]] = {}
        for row, name in enumerate(self.variables):
            self._rows[name] = [row]
            if vector := find_vector(name):
                self._rows.setdefault(vector, []).append(row)
        self._list = list(self.variables.values())
        self._outputs = [
            row
            for kind in TYPES  # order of the columns of a result
            for row, v in enumerate(self._list)
            if v.causality == "output" and v.type == kind
        ]

    def reset(self) -> None:
        """Go back to the start of the scene: what was set, stepped and issued is forgotten."""
        with self._lock:
            self.warnings: list[str] = list(self.scene.warnings)
            self.notes: list[str] = list(self.scene.notes)
            self._start: bytes | None = None  # state before the first step
            self._steps, self._wall = 0, 0.0
            self._core = self._make_core()

    def _make_core(self) -> Any:
        document, source = to_json(self.scene.document), name_source(self.scene.path)
        with core_errors() as core:
            return core.Docking(document, source)

    @property
    def time(self) -> float:
        """Time of the last communication point [s]."""
        return self._core.time

    def set(self, name: str, value: Value | str | ArrayLike) -> None:
        """Set a variable: start values before the start, inputs and tunable parameters always.

        The first `step`, or `start`, is the start. A host that steps first (``coupling.mode``
        ``host_first``) reads the announced load, then reports: reading it is the start, too.

        Args:
            name: ``"chaser.mass"``, ``"chaser.force_ext"`` for ``chaser.force_ext[1..3]``, or a
                name with ``*`` for all that are like it: ``"element[*].law[1].stiffness"``.
            value: in the unit of the variable; for a vector an array of shape (entries,); for a
                choice its number or its name (``"bdf"``).

        Raises:
            UsageError: naming variable, value and limit; nothing is changed.
        """
        _check_name("Docking.set", name)
        settable = (n for n, v in self.variables.items() if v.start is not None)
        names = match_names(name, settable, "Docking.set")
        rows = [row for each in names for row in self._find(each)]
        first = self._list[rows[0]]
        if isinstance(value, str) and list_names(first.name, first.description):
            try:
                value = find_number(first.name, first.description, value)
            except UsageError as error:
                raise UsageError(f"Docking.set: {error}") from None
        values = np.array(to_plain(value), dtype=object)  # so that each entry keeps its type
        is_one = "*" in name or name in self.variables
        if values.shape != (() if is_one else (len(rows),)):
            expected = "one number" if is_one else f"{len(rows)} numbers"
            raise UsageError(f"Docking.set: '{name}' is {say_value(value)}: must be {expected}")
        kinds, wanted = (bool, WORDS["Boolean"]) if first.type == "Boolean" else ((), "a number")
        if not all(is_number(entry) or isinstance(entry, kinds) for entry in values.flat):
            raise UsageError(f"Docking.set: '{name}' is {say_value(value)}: must be {wanted}")
        entries = np.broadcast_to(values, len(rows))
        numbers = [float(e) if isinstance(e, kinds) else as_number(e) for e in entries]
        with core_errors():
            self._core.set(rows, numbers, "Docking.set")
        if "*" in name:
            self.notes.append(say_matches(f"{name}={values}", len(rows)))

    def get(self, name: str) -> Any:
        """Return the present value of a variable, in its unit.

        Args:
            name: ``"relative.axial"``, or ``"relative.position"`` for ``relative.position[1..3]``.

        Returns:
            float, int or bool; for a vector an array of shape (entries,).

        Raises:
            UsageError: there is no such variable.
        """
        rows = self._find(name)
        if self._start is None and name.partition("[")[0].endswith(ANNOUNCED):
            self._start_host_first()
        kind = TYPES[self._list[rows[0]].type]
        try:  # often called: no more than one context
            with core_errors():
                values = self._core.get(rows)
        except UsageError:
            self._blame()
        return kind(values[0]) if name in self.variables else np.array(values).astype(kind)

    def start(self) -> None:
        """End the setting of start values, as the first step does: what is set now is an input.

        Raises:
            UsageError: the start values contradict each other.
        """
        with self._lock:
            self._keep_start()
            with self._starting():
                self._core.start()

    def _start_host_first(self) -> None:
        mode = "coupling.mode"
        if mode in self.variables and name_choice(mode, self.get(mode)) == "host_first":
            self.start()

    def step(self, h: float) -> None:
        """Advance by one communication step; the first one ends the setting of start values.

        Args:
            h: communication step [s], above 0.

        Raises:
            UsageError: `h` is no step.
            DockloopError: the step failed; the docking is where it was. A smaller step may succeed.
        """
        if not 0.0 < as_number(h) < math.inf:
            raise UsageError(
                f"Docking.step: h is {say_value(h)} s: must be a positive, finite number"
            )
        with self._lock:
            self._keep_start()
            began = time.perf_counter()
            try:
                with core_errors():
                    self._core.step(h)
            except UsageError:
                self._blame()
            self._steps, self._wall = self._steps + 1, self._wall + time.perf_counter() - began
            self._keep_warnings()

    def __copy__(self) -> "Docking":
        """Return another docking in the same state."""
        return _revive(*self.__reduce__()[1])

    def __deepcopy__(self, memo: dict[int, Any]) -> "Docking":
        return self.__copy__()

    def __reduce__(self) -> tuple[Any, ...]:
        with self._lock:
            seen = {
                "warnings": list(self.warnings),
                "notes": list(self.notes),
                "_start": self._start,
                "_steps": self._steps,
                "_wall": self._wall,
            }
            return _revive, (self.scene, self.save(), seen)

    @property
    def summary(self) -> dict[str, Any]:
        """What became of the docking so far, as `Result.summary`.

        Audits are those of two points: before the first step of this object, and now. Ends the
        setting of start values, as a step does.
        """
        from dockloop.result.summary import summarise

        with self._lock:
            now = self._read_outputs(self._core)
            first = now
            if self._start is not None:
                with core_errors():
                    before = self._make_core()
                    before.restore(self._start)
                first = self._read_outputs(before)
            result = self._make_result(np.array([first, now]))
            result.wall = dict.fromkeys(("loop", "do_step"), self._wall) | {"load": 0, "read": 0}
            result.warnings, result.notes = list(self.warnings), list(self.notes)
            return summarise(result) | {"communication_steps": self._steps}

    def save(self) -> bytes:
        """Return all that decides the future; the FMU of the scene accepts these bytes too."""
        return self._core.save()

    def restore(self, state: bytes) -> None:
        """Go on from a saved state, bit for bit, in any process.

        Args:
            state: what `save` of a docking with the same scene returned.

        Raises:
            UsageError: these bytes are no state of this scene; nothing is changed.
        """
        if not isinstance(state, bytes):
            kind = type(state).__name__
            raise UsageError(f"Docking.restore: the state is of type {kind}: must be bytes")
        try:
            with core_errors():
                self._core.restore(state)
        except UsageError as error:
            raise UsageError(
                f"Docking.restore: {error}: take what 'save' of a docking with this scene returned"
            ) from None

    def record(
        self,
        times: ArrayLike,
        progress: Callable[[float], None] | None = None,
    ) -> Result:
        """Step to every one of some times and record all outputs there.

        Args:
            times: [s], shape (points,); the first is the present time.
            progress: receives the part that is done, 0 to 1, some ten times a second.

        Raises:
            UsageError: a time is no number.
            DockloopError: a step failed.
        """
        entries = np.array(times, dtype=object).ravel()
        times = np.array([check_number("Docking.record: a time is", entry) for entry in entries])
        with self._lock:
            began = time.perf_counter()
            self.start()
            with self._starting():
                result = self._make_result(np.zeros((len(times), 1 + len(self._outputs))))
                result.wall = {"load": time.perf_counter() - began}
                began = time.perf_counter()
                values, *wall = self._core.record(times.tolist(), self._outputs, progress=progress)
            loop = time.perf_counter() - began
            result.wall |= {"loop": loop, "do_step": wall[0], "read": wall[1]}
            result.values[:, 0] = times
            result.values[:, 1:] = values
            self._steps, self._wall = self._steps + len(times) - 1, self._wall + wall[0]
            self._core.log_left_out()
            self._keep_warnings()
            result.warnings, result.notes = list(self.warnings), list(self.notes)
            return result

    def _make_result(self, values: np.ndarray) -> Result:
        """Return a result with rows of time and outputs."""
        chosen = [self._list[row] for row in self._outputs]
        return Result(
            copy.deepcopy(self.scene.document),
            ["time", *(v.name for v in chosen)],
            ["s", *(v.unit for v in chosen)],
            values,
            self._read_parameters(),
        )

    @contextmanager
    def _starting(self) -> Iterator[None]:
        """Let the errors of the core be those of this package, also those of a start."""
        try:
            with core_errors():
                yield
        except UsageError:
            self._blame()

    def _blame(self) -> NoReturn:
        """Raise the present error anew; that of a start begins with the override to blame."""
        with blaming_start(self.scene.path, self.scene.texts):
            raise  # noqa: PLE0704  # called while an error is handled
        raise AssertionError

    def _keep_start(self) -> None:
        """Before the first step: keep the state, from which a summary reads the first outputs."""
        if self._start is None:
            self._start = self._core.save()

    def _read_outputs(self, core: Any) -> np.ndarray:
        """Return the time and all outputs of a docking of the core, shape (1 + outputs,)."""
        with self._starting():
            core.start()
            return np.array([core.time, *core.get(self._outputs)], dtype=float)

    def _keep_warnings(self) -> None:
        self.warnings += self._core.take_warnings()
        self.notes += self._core.take_notes()

    def _read_parameters(self) -> dict[str, float]:
        rows = [
            row
            for row, v in enumerate(self._list)
            if v.type in ("Real", "Integer") and v.causality == "parameter"
        ]
        values = self._core.get(rows)
        return {self._list[row].name: value for row, value in zip(rows, values, strict=True)}

    def _find(self, name: str) -> list[int]:
        """Return the rows of a variable or a vector."""
        _check_name(self.scene.name, name)
        if name in self._rows:
            return self._rows[name]
        hint = did_you_mean(name, self._rows)
        if name.startswith("coupling."):
            hint = (
                "; only a vehicle that a host integrates needs it:"
                " overrides={'chaser.motion': 'driven'}"
            )
        elif name in scene_members():
            hint = f"; it is a key of the scene: overrides={{{name!r}: ...}}"
        raise UsageError(f"{self.scene.name}: there is no variable '{name}'{hint}")


@names_arguments
def run(
    scene: str | Path | Scene | Mapping[str, Any],
    overrides: Mapping[str, Any] | None = None,
    start_values: Mapping[str, Value | str | ArrayLike] | None = None,
    *,
    stop: float | None = None,
    step: float | None = None,
    accuracy: float | str | None = None,
    estimate_error: bool = False,
    assured: bool | Sequence[str] = False,
    progress: Callable[[float], None] | None = None,
) -> Result:
    """Run one docking from its start to `stop`: ``dockloop run`` without an FMU.

    Args:
        scene: name of a shipped scene, path of a ``.toml`` file, its members, or a `Scene`.
        overrides: as for `Scene`.
        start_values: values of variables at the start, as for `Docking.set`.
        stop: end [s]; default: that of the scene.
        step: communication step [s]; default: that of the scene.
        accuracy: wanted relative error, or ``"real-time"``; default: that of the scene.
        estimate_error: run again with tighter tolerances, and with every body if ``model.level`` is
            a simplified one (`Result.error_estimate`).
        assured: run again with tighter settings until two runs agree within `accuracy`, and return
            the last one (`Result.assurance`); a list of outputs: their values at the end, too.
        progress: receives the part that is done, 0 to 1.

    Returns:
        Every output at every communication point, the start included.

    Raises:
        UsageError: naming file, member or variable, value and limit.
        DockloopError: a step failed.
    """
    began = time.perf_counter()
    docking = Docking(scene, overrides)
    experiment = docking.scene.document["experiment"]
    times = list_points(
        float(experiment["start"]),
        experiment["stop"] if stop is None else stop,
        experiment["step"] if step is None else step,
    )
    settings = dict(start_values or {}) | ({} if accuracy is None else {"accuracy": accuracy})
    for name, value in settings.items():
        docking.set(name, value)
    assured = list(assured) if isinstance(assured, Sequence | np.ndarray) else bool(assured)
    chosen: Sequence[str] = () if isinstance(assured, bool) else assured
    if assured:
        _check_assured(docking, chosen, is_estimated=estimate_error)
    loaded = time.perf_counter() - began
    result = docking.record(times, progress)
    result.wall["load"] += loaded
    result.warnings += warn_of_driven(docking.scene.document)

    def repeat(other: dict[str, float]) -> Result:
        return run(docking.scene, None, settings | other, stop=stop, step=step)

    if estimate_error:
        result.error_estimate = find_estimate(result, repeat)
    return assure(result, repeat, chosen) if assured else result


def _check_name(place: str, name: Any) -> None:
    if not isinstance(name, str):
        raise UsageError(f"{place}: the name of a variable is {name!r}: must be a text")


def _revive(scene: Scene, state: bytes, seen: dict[str, Any]) -> Docking:
    """Make a docking of a scene in a saved state; the rest of what it has seen."""
    docking = Docking(scene)
    docking.restore(state)
    vars(docking).update(seen)
    return docking


def _check_assured(docking: Docking, chosen: Sequence[str], *, is_estimated: bool) -> None:
    """Check, before anything runs, that a docking can be assured. Raises UsageError."""
    if is_estimated:
        raise UsageError(ESTIMATED_TOO)
    outputs = list_outputs(docking.variables)
    for name in chosen:
        if name not in outputs:
            raise UsageError(f"assured: '{name}' is no output{did_you_mean(name, outputs)}")
    check_assurable(outputs, docking.get)
