"""Is a host that integrates a vehicle right? Its reports, recorded or live, are played and judged.

Arithmetic demands of reports: they begin at the start values, the position follows the velocity,
the attitude follows the angular velocity, and changes of both follow the loads. This module
measures how well each holds. The cause of an error is what the FMU finds, ``coupling.diagnosis``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dockloop.base.errors import DockloopError, UsageError, names_arguments
from dockloop.base.files import scratch
from dockloop.base.number import check_number
from dockloop.base.paths import shown
from dockloop.base.rotations import conjugate, make_symmetric, multiply, turn
from dockloop.base.sections import FACTS, Section
from dockloop.fmu.vehicle_reports import ReportLog, Row, VehicleFmu, read_log
from dockloop.native.core import name_choice
from dockloop.native.variables import LOADS, MOTION, VEHICLES
from dockloop.result.recording import list_points
from dockloop.runs.docking import Docking, Scene

_FIRST = 1e-3  # of the first report [m], [rad]
_DRIFT = 1e-5  # of positions and attitudes [m/s], [rad/s]
_SHARE = 0.02  # of the changes of velocity that loads cause
_SILENT = 1e-7  # acceleration that is no load [m/s2], [rad/s2]
_SAME = 1e-3  # of the largest load
_LEAST_LOADED = 10  # steps, to judge loads


class Check(NamedTuple):
    """One demand on the reports of a vehicle.

    Attributes:
        vehicle: ``chaser`` or ``target``.
        name: what is compared.
        unit: of value and limit.
        value: how far the reports are from the demand; None: not judged.
        limit: the largest value that is right.
    """

    vehicle: str
    name: str
    unit: str
    value: float | None
    limit: float

    @property
    def verdict(self) -> str:
        """``right``, ``wrong`` or ``not judged``."""
        if self.value is None:
            return "not judged"
        return "right" if self.value <= self.limit else "wrong"


@dataclass(repr=False)
class HostCheck:
    """The judgement of a host.

    Attributes:
        source: the log, or the FMU of the vehicle.
        scene: name of the scene.
        mode: ``coupling.mode``, the order of exchange.
        steps: communication steps that were made.
        time: at the end [s].
        checks: what reports must obey.
        cause: the mistake that explains what is wrong, as ``coupling.diagnosis`` names it; or
            ``digits`` and ``other loads`` of a log, ``refused step``, ``unexplained``; ``none``:
            nothing is wrong.
        value: size of the mistake, ``coupling.diagnosis_value``.
        sentence: what is wrong and what to do; empty where nothing is wrong.
        notes: columns of a log that are not used; what a vehicle FMU does not take.
    """

    source: str
    scene: str
    mode: str
    steps: int
    time: float
    checks: list[Check]
    cause: str = "none"
    value: float = 0.0
    sentence: str = ""
    notes: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"HostCheck({self.source}, {self.scene}: {self.cause})"

    @property
    def is_right(self) -> bool:
        """Whether nothing is wrong."""
        return not self.sentence


@names_arguments
def host_check(
    source: str | Path,
    scene: str | Path | Scene | Mapping[str, Any],
    overrides: Mapping[str, Any] | None = None,
    start_values: Mapping[str, Any] | None = None,
    *,
    vehicle: str | None = None,
    names: str | Path | None = None,
    stop: float | None = None,
    step: float | None = None,
) -> HostCheck:
    """Judge a host that integrates a vehicle: recorded reports, or the FMU of a vehicle.

    A log is a CSV file with a header of names and one row for each communication point: ``time``
    [s], and position, velocity, attitude and angular velocity of the vehicle by the names of the
    docking FMU (``chaser.position[1]``). Other columns that are inputs of the docking, such as
    ``chaser.force_ext[1]``, are set too; those of the first row already at initialisation. Scene
    and start values must be those of the recording: then the docking receives the same reports, and
    answers with the same loads. Columns ``chaser.force_mean[1..3]`` and ``.torque_mean[1..3]``, as
    the docking returned them at the time of the row, are compared.

    The FMU of a vehicle has its motion as outputs, and the inputs ``force_ext`` and ``torque_ext``:
    ``chaser.position[1]`` or ``position[1]``. It runs in closed loop with the docking.

    If the scene states no ``coupling.mode``, the order of exchange is ``parallel``.

    Args:
        source: the log (``.csv``) or the FMU (``.fmu``).
        scene: name of a shipped scene, path of a ``.toml`` file, its members, or a `Scene`.
        overrides: as for `Scene`.
        start_values: values of variables at the start, as for `Docking.set`.
        vehicle: which one an FMU is: ``"chaser"`` (default) or ``"target"``.
        names: map of other names of columns or variables, as ``dockloop ssp --map`` takes it.
        stop: end [s]; default: that of the log, or of the scene.
        step: communication step of an FMU [s]; default: that of the scene.

    Raises:
        UsageError: the log, the FMU or the scene cannot be used; names file, column and line.
        DockloopError: the FMU of the vehicle failed.
    """
    path, own = Path(source), None if names is None else Path(names)
    docked, settings = Scene(scene, overrides), dict(start_values or {})
    if path.suffix == ".fmu":
        chosen = vehicle or VEHICLES[0]
        if chosen not in VEHICLES:
            raise UsageError(f"--vehicle {chosen}: must be {' or '.join(VEHICLES)}")
        docking = _make_docking(docked, [chosen])
        experiment = docking.scene.document["experiment"]
        times = list_points(
            docking.time,
            float(experiment["stop"]) if stop is None else stop,
            float(experiment["step"]) if step is None else step,
        )
        body = docking.scene.document[chosen]
        with scratch() as folder, VehicleFmu(path, folder, chosen, times, body, own) as fmu:
            return _judge(docking, settings, fmu, times, shown(path))
    if path.suffix != ".csv":
        raise UsageError(f"{shown(path)}: must be a log (.csv) or the FMU of a vehicle (.fmu)")
    for option, value in (("--vehicle", vehicle), ("--step", step)):
        if value is not None:
            raise UsageError(f"{option} is for an FMU: a log has its own vehicles and times")
    log = read_log(path, own)
    docking = _make_docking(docked, log.vehicles)
    log.choose_inputs(docking.variables)
    times = docking.time + log.times - log.times[0]
    if stop is not None:
        times = times[times <= check_number("--stop is", stop) + 1e-9]
        if len(times) < 2:
            raise UsageError(f"--stop {stop}: ends before the first step of {shown(path)}")
    return _judge(docking, settings, log, times, shown(path))


def report_host(found: HostCheck) -> list[Section]:
    """Return the report of a judgement: the cause, what to do, and a table of the checks."""
    facts = [("cause", found.cause)]
    facts += [("what to do", found.sentence)] if found.sentence else []
    facts += [("note", note) for note in found.notes]
    rows: list[tuple[str, ...]] = [("vehicle", "compared", "unit", "error", "limit", "verdict")]
    for check in found.checks:
        numbers = ("" if x is None else f"{x:.3g}" for x in (check.value, check.limit))
        rows.append((check.vehicle, check.name, check.unit, *numbers, check.verdict))
    head = f"{found.source} in {found.scene}, {found.mode}"
    return [
        Section(f"{head}: {found.steps} steps to {found.time:.6g} s", table=[FACTS, *facts]),
        Section("Checks", table=rows),
    ]


def _make_docking(scene: Scene, vehicles: list[str]) -> Docking:
    """Return a docking with these vehicles driven."""
    document, name = scene.document, scene.name
    for vehicle in VEHICLES:
        if vehicle in vehicles and vehicle not in document:
            raise UsageError(f"{name} has no {vehicle}, whose motion the host reports")
        if vehicle not in vehicles and document.get(vehicle, {}).get("motion") == "driven":
            raise UsageError(
                f"{name}: the {vehicle} is driven, but its motion is not reported: set"
                f" {vehicle}.motion to free or fixed, or report it"
            )
    own: dict[str, Any] = {f"{vehicle}.motion": "driven" for vehicle in vehicles}
    if "mode" not in document.get("coupling", {}):
        own["coupling.mode"] = "parallel"
    return Docking(Scene(scene, own))


def _judge(
    docking: Docking,
    settings: dict[str, Any],
    host: ReportLog | VehicleFmu,
    times: np.ndarray,
    source: str,
) -> HostCheck:
    """Play the reports into a docking and judge them."""
    for name, value in ({"coupling.expected_step": _find_steps(times[:2])[0]} | settings).items():
        docking.set(name, value)
    start = {f"{v}.{n}": np.array(docking.get(f"{v}.{n}")) for v in host.vehicles for n in MOTION}
    mode = name_choice("coupling.mode", docking.get("coupling.mode"))
    if isinstance(host, ReportLog):
        for name, number in host.read_inputs().items():
            docking.set(name, number)
    docking.start()  # what is set from here on are reports, no start values
    loads, sentence = _play(docking, host, times, mode)
    checks: list[Check] = []
    for vehicle in host.vehicles:
        if isinstance(host, ReportLog):
            checks += [Check(vehicle, *d, _DRIFT) for d in host.find_digits(vehicle)]
            checks += _compare_loads(host, vehicle, loads, is_late=mode == "sequential")
        reports = _Reports(docking, vehicle, host.motions[: len(times)], loads, times)
        motion = reports.check_motion(start)
        is_judged = all(check.verdict == "right" for check in motion)
        checks += motion + reports.check_loads(is_judged=is_judged)
    found = HostCheck(source, docking.scene.name, mode, len(loads), docking.time, checks)
    found.cause = name_choice("coupling.diagnosis", docking.get("coupling.diagnosis"))
    found.value, found.sentence = docking.get("coupling.diagnosis_value"), sentence
    found.notes = host.notes
    wrong = [check for check in checks if check.verdict == "wrong"]
    if wrong and wrong[0].name.startswith("digits"):
        found.cause, found.value = "digits", float(wrong[0].value or 0.0)
        found.sentence = (
            f"{wrong[0].vehicle}: the last digit of {wrong[0].name.split()[-1]} is"
            f" {found.value:.2g} {wrong[0].unit} over a step: write all digits of a number"
        )
    elif wrong and wrong[0].name.startswith("recorded"):
        found.cause, found.value = "other loads", float(wrong[0].value or 0.0)
        found.sentence = (
            f"{wrong[0].vehicle}: {wrong[0].name} differ by {found.value:.3g} {wrong[0].unit}: name"
            " scene, start values and coupling.mode of the recording, and record what the docking"
            " returned"
        )
    elif found.cause == "none" and sentence:
        found.cause = "refused step"
        if wrong and wrong[0].name.startswith("first"):  # which is why
            found.cause, found.value = (
                wrong[0].name.partition(" and")[0],
                float(wrong[0].value or 0),
            )
            found.sentence = (
                f"{wrong[0].vehicle}: {found.cause} differs from the start value by"
                f" {found.value:.3g} {wrong[0].unit}: report the start value in the first step, or"
                f" set it; then {sentence}"
            )
    elif found.cause == "none" and wrong:
        found.cause, found.value = "unexplained", float(wrong[0].value or 0.0)
        found.sentence = (
            f"{wrong[0].vehicle}: {wrong[0].name} has an error of {found.value:.3g}"
            f" {wrong[0].unit}, and no single mistake explains it: look for a flexible part, or a"
            " load that is not in force_ext or torque_ext"
        )
    return found


def _compare_loads(log: ReportLog, vehicle: str, loads: list[Row], *, is_late: bool) -> list[Check]:
    """Compare recorded loads with those of the docking here.

    Args:
        log: of the host.
        vehicle: its vehicle.
        loads: of every step.
        is_late: a row has the load of the step that ends there, not of the coming step.
    """
    checks = []
    for load, unit in zip(LOADS, ("N", "N.m"), strict=True):
        recorded = log.find_load(f"{vehicle}.{load}")
        if recorded is None or not loads:
            continue
        here = np.array([each[f"{vehicle}.{load}"] for each in loads])
        away = np.linalg.norm(recorded[int(is_late) :][: len(here)] - here, axis=1).max()
        limit = _SAME * np.linalg.norm(here, axis=1).max()
        checks.append(Check(vehicle, f"recorded {load} and that of here", unit, away, limit))
    return checks


def _play(
    docking: Docking,
    host: ReportLog | VehicleFmu,
    times: np.ndarray,
    mode: str,
) -> tuple[list[Row], str]:
    """Step in the order of the mode until the end, a diagnosis, or a refused step.

    Returns:
        Loads held by the host over every step, and reported ones; the sentence of a diagnosis or of
        a refused step.
    """
    means = [f"{vehicle}.{load}" for vehicle in host.vehicles for load in LOADS]
    known = [f"{vehicle}.{load}" for vehicle in host.vehicles for load in LOADS.values()]
    loads: list[Row] = []
    for time, size in zip(times[:-1].tolist(), _find_steps(times), strict=True):
        held = {name: docking.get(name) for name in means}
        if mode == "host_first":
            host.advance(held, time, size)
        for name, value in host.report().items():
            docking.set(name, value)
        seen = len(docking.warnings)
        try:
            docking.step(size)
        except DockloopError as error:
            return loads, str(error)
        if mode == "sequential":
            held = {name: docking.get(name) for name in means}
        loads.append(held | {name: docking.get(name) for name in [*known, "gravity"]})
        if mode != "host_first":
            host.advance(held, time, size)
        if docking.get("coupling.diagnosis") != 1:
            return loads, next(t for t in docking.warnings[seen:] if t.startswith(VEHICLES))
    return loads, ""


def _find_steps(times: np.ndarray) -> list[float]:
    """Return steps as a host writes them [s]: without the rounding of their sums."""
    return [float(f"{step:.9g}") for step in np.diff(times)]


class _Reports:
    """Reports of one vehicle as arrays: one row per communication point, or per step."""

    def __init__(
        self,
        docking: Docking,
        vehicle: str,
        motions: list[Row],
        loads: list[Row],
        times: np.ndarray,
    ) -> None:
        self.vehicle = vehicle
        self.x, self.v, q, self.w = (
            np.array([motion[f"{vehicle}.{name}"] for motion in motions]) for name in MOTION
        )
        self.q = q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-300)
        self.h = np.diff(times[: len(motions)])[:, None]
        steps = len(loads)
        force, torque, force_ext, torque_ext, self.gravity = (
            np.array([load[name] for load in loads]).reshape(steps, 3)
            for name in (*(f"{vehicle}.{n}" for n in (*LOADS, *LOADS.values())), "gravity")
        )
        self.force, self.torque = force + force_ext, torque + torque_ext
        self.mass = docking.get(f"{vehicle}.mass")
        self.inertia = make_symmetric(docking.get(f"{vehicle}.inertia"))

    def check_motion(self, start: Row) -> list[Check]:
        """Compare first reports with start values, poses with the integrals of velocities."""
        first = self.x[0] - start[f"{self.vehicle}.position"]
        turned = _find_turns(np.array([start[f"{self.vehicle}.attitude"], self.q[0]]))
        move = np.diff(self.x, axis=0) - self.h * (self.v[1:] + self.v[:-1]) / 2
        angle = _find_turns(self.q) - self.h * (self.w[1:] + self.w[:-1]) / 2
        turn_in_n = turn(self.q[:-1], angle)
        return [
            Check(self.vehicle, "first position and start value", "m", _size(first), _FIRST),
            Check(self.vehicle, "first attitude and start value", "rad", _size(turned), _FIRST),
            self._check_drift("position and integral of velocity", "m", move, self.v),
            self._check_drift(
                "attitude and integral of angular velocity", "rad", turn_in_n, self.w
            ),
        ]

    def _check_drift(self, name: str, unit: str, errors: np.ndarray, rates: np.ndarray) -> Check:
        """Check the sum of errors; a change of the rate within a step is no error."""
        drift = np.linalg.norm(np.cumsum(errors, axis=0), axis=1).max()
        change = np.linalg.norm(rates - rates[0], axis=1).max()
        limit = _DRIFT * float(self.h.sum()) + float(self.h.max() * change) / 2
        return Check(self.vehicle, name, unit, float(drift), limit)

    def check_loads(self, *, is_judged: bool) -> list[Check]:
        """Compare changes of velocity with loads, as a part of what the loads cause."""
        count = min(len(self.force), len(self.v) - 1)
        h = self.h[:count]
        moved = np.diff(self.v[: count + 1], axis=0) - h * self.gravity[:count]
        middle = (self.w[1 : count + 1] + self.w[:count]) / 2
        spin = np.diff(self.w[: count + 1], axis=0)
        inverse = np.linalg.inv(self.inertia)  # symmetric, as the inertia
        gyro = h * np.cross(middle, middle @ self.inertia) @ inverse
        pairs = (
            ("velocity", moved, h * self.force[:count] / self.mass),
            ("angular velocity", spin + gyro, h * self.torque[:count] @ inverse),
        )
        checks = []
        for name, found, caused in pairs:
            loaded = np.linalg.norm(caused, axis=1) > _SILENT * h[:, 0]
            share = None
            if is_judged and loaded.sum() >= _LEAST_LOADED:
                share = _size((found - caused)[loaded]) / _size(caused[loaded])
            checks.append(Check(self.vehicle, f"changes of {name} and loads", "1", share, _SHARE))
        return checks


def _size(values: np.ndarray) -> float:
    """Return the root of the sum of squares."""
    return float(np.linalg.norm(values))


def _find_turns(q: np.ndarray) -> np.ndarray:
    """Return rotation vectors from each attitude to the next, in axes of the first."""
    step = multiply(conjugate(q[:-1]), q[1:])
    step = np.where(step[:, :1] < 0.0, -step, step)
    w, v = step[:, 0], step[:, 1:]
    size = np.linalg.norm(v, axis=1)
    factor = np.where(size > 0.0, 2.0 * np.arctan2(size, w) / np.maximum(size, 1e-300), 2.0)
    return factor[:, None] * v
