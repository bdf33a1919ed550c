"""A host whose vehicle is not as stated: mass, inertia or centre of mass are others.

`run` docks a scene whose chaser this host integrates, and the FMU receives other numbers, or a
position that is not the centre of mass. The host applies loads where it reports the position.
`find_error` compares peak loads with those of the FMU that integrates both vehicles with the right
numbers, or that receives each new mass of a vehicle which loses fuel.
"""

import dataclasses
import functools

import numpy as np

import dockloop as dl
from coupling_host import MOTION, RigidBody, cross, symmetric, turn

LOADS = ("compression", "tension", "shear", "bending", "torsion")
PEAKS = [f"capture.peak.{load}" for load in LOADS]
SCENES = ("idss_25t_350t", "apda", "probe_drogue")
NEAR = {"initial.approach_time": 0.2}
STOP = 3.0  # s
TIGHT = {"solver.rtol": 1e-9, "solver.atol_position": 1e-11, "solver.atol_velocity": 1e-11}
AIMS = {0.01: 1e-3, 0.1: 1e-2}  # of the worst of five peak loads, by communication step [s]
CASES = {
    "right": {},
    "mass and inertia x 0.5": {"mass": 0.5, "inertia": 0.5},
    "mass and inertia x 2": {"mass": 2.0, "inertia": 2.0},
    "inertia x 0.5": {"inertia": 0.5},
    "inertia x 2": {"inertia": 2.0},
    "centre x": {"centre": (0.1, 0.0, 0.0)},
    "centre y": {"centre": (0.0, 0.1, 0.0)},
    "centre z": {"centre": (0.0, 0.0, 0.1)},
    "all": {"mass": 0.5, "inertia": 0.5, "centre": (0.06, -0.06, 0.05)},
}
FUEL = {"fuel": 0.05}  # of mass and inertia, lost in FUEL_TIME, unreported
FUEL_TIME = 4.0  # s


@dataclasses.dataclass
class Course:
    """What a run leaves."""

    peaks: np.ndarray  # in the order of LOADS
    body: dict  # numbers of the host: mass, com from the reported point, inertia
    estimate: dict  # of the same: value and deviation
    diagnosis: int
    warnings: list  # about hosts
    values: np.ndarray  # of the watched variables, (communication points, numbers)
    momentum_error: float  # linear, as an outsider sums it up, over the largest of the chaser


def components(matrix):
    """The numbers xx yy zz xy xz yz."""
    return np.array([matrix[place] for place in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])


def _read(docking, *names):
    return [np.array(docking.get(f"chaser.{name}")) for name in names]


def _set(docking, values):
    for name, value in values.items():
        docking.set(name, value)


def _report(docking, body, centre):
    x, v = body.point(-centre)
    for name, value in zip(MOTION, (x, v, body.q, body.w), strict=True):
        docking.set(f"chaser.{name}", value)


@functools.cache
def solve(scene, stop=STOP, centre=(0.0, 0.0, 0.0)):
    """Peak loads of a run in which the FMU integrates the chaser.

    Args:
        scene: its name.
        stop: end [s].
        centre: the centre of mass, from where the scene has it, body axes [m].
    """
    docking = dl.Docking(scene, NEAR)
    _set(docking, TIGHT)
    x, v, q, w, arm = _read(docking, *MOTION, "interface_position")
    centre = np.array(centre)
    docking.set("chaser.position", x + turn(q, centre))
    docking.set("chaser.velocity", v + turn(q, cross(w, centre)))
    docking.set("chaser.interface_position", arm - centre)
    for _ in range(round(stop / 0.1)):
        docking.step(0.1)
    return np.array([docking.get(name) for name in PEAKS])


def run(
    scene,
    step,
    stop,
    *,
    mass=1.0,
    inertia=1.0,
    centre=(0.0, 0.0, 0.0),
    fuel=0.0,
    jettison=None,
    restates=True,
    mode="parallel",
    overrides=NEAR,
    settings=None,
    loads=None,
    watch=(),
    detours=False,
):
    """Dock a scene with a host.

    Args:
        scene: its name.
        step: communication step [s].
        stop: end [s].
        mass: stated mass over that of the host.
        inertia: the same for the inertia.
        centre: centre of mass of the host from the position that it reports, body axes [m].
        fuel: part of mass and inertia that leaves in FUEL_TIME.
        jettison: time [s] at which a part of mass and inertia is dropped, and this part.
        restates: the FMU receives the new mass and inertia.
        mode: coupling.mode, "parallel" or "sequential".
        overrides: of the scene.
        settings: of the FMU.
        loads: function of force, torque and attitude: what the host makes of the mean loads.
        watch: variables whose values are kept.
        detours: each step is first tried with another size, and restored.
    """
    centre = np.array(centre)
    docking = dl.Docking(scene, {"chaser.motion": "driven", "coupling.mode": mode} | overrides)
    whole, x, v, q, w, six = _read(docking, "mass", *MOTION, "inertia")
    whole = float(whole)
    body = RigidBody(whole, symmetric(six), [x, v, q, w])
    body.x, body.v = body.point(centre)
    _set(docking, TIGHT | {"coupling.expected_step": step} | (settings or {}))
    _set(docking, {"chaser.mass": mass * whole, "chaser.inertia": inertia * six})
    values, momentum, lost = [], [], np.zeros(3)

    def reduce(share):
        nonlocal body, lost
        rest = RigidBody(share * whole, share * symmetric(six), body.motion())
        lost = lost + (body.mass - rest.mass) * body.v
        body = rest
        if restates:
            new = {"mass": mass * body.mass, "inertia": inertia * components(body.inertia)}
            _set(docking, {f"chaser.{name}": value for name, value in new.items()})

    def move(force, torque):
        """Hold a force in N and a torque in body axes, at the reported point."""
        if loads:
            force, torque = loads(force, torque, body.q)
        count = max(1, round(step / 1e-3)) if centre.any() else 1
        for _ in range(count):
            moment = torque - cross(centre, turn(body.q * [1, -1, -1, -1], force))
            body.move(force, moment, step / count)

    for i in range(round(stop / step)):
        if fuel:
            reduce(1.0 - fuel * min(1.0, (i + 0.5) * step / FUEL_TIME))
        if jettison and abs(i * step - jettison[0]) < 0.5 * step:
            reduce(1.0 - jettison[1])
        load = _read(docking, "force_mean", "torque_mean")
        _report(docking, body, centre)
        if detours:
            held = docking.save()
            docking.step(2.0 * step)
            docking.restore(held)
        docking.step(step)
        if mode == "sequential":
            load = _read(docking, "force_mean", "torque_mean")
        move(*load)
        if watch:
            values.append(np.concatenate([np.ravel(docking.get(name)) for name in watch]))
        if jettison:
            _report(docking, body, centre)
            inside = docking.get("momentum.linear") + docking.get("coupling.pending_impulse")
            momentum.append(inside + body.mass * body.v + lost)
    numbers = ("mass", "com", "inertia")
    estimate = {
        name: [
            np.array(docking.get(f"coupling.estimated_{name}{end}")) for end in ("", "_deviation")
        ]
        for name in numbers
    }
    own = (body.mass, centre, components(body.inertia))
    return Course(
        np.array([docking.get(name) for name in PEAKS]),
        dict(zip(numbers, own, strict=True)),
        estimate,
        docking.get("coupling.diagnosis"),
        [text for text in docking.warnings if not text.startswith("limit")],
        np.array(values),
        float(np.ptp(momentum, axis=0).max() / (whole * np.linalg.norm(body.v)))
        if momentum
        else 0.0,
    )


def find_error(scene, step, case, identify=True):
    """Error of the worst of five peak loads, and the course.

    Args:
        scene: its name.
        step: communication step [s].
        case: a name of CASES, or "fuel".
        identify: coupling.identify.
    """
    settings = {"coupling.identify": identify}
    if case == "fuel":
        right = run(scene, step, FUEL_TIME, settings=settings, **FUEL).peaks
        found = run(scene, step, FUEL_TIME, settings=settings, restates=False, **FUEL)
    else:
        options = CASES[case]
        right = solve(scene, centre=options.get("centre", (0.0, 0.0, 0.0)))
        found = run(scene, step, STOP, settings=settings, **options)
    there = right > 0.0
    return float(np.abs(found.peaks[there] / right[there] - 1.0).max()), found
