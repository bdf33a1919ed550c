"""The dockings on which the coupling of driven vehicles is tried, and their reference solution.

| scene | what is special |
|---|---|
| `default` | 25 t against a free 350 t, soft legs: contact, latches |
| `light` | 500 kg on the same mechanism, a tenth of it moving; little damping in the legs |
| `pressed` | 25 t that presses with 4 kN against the 350 t; latched, nothing damped or rubbing |
| `both` | `default` with both vehicles driven |
| `target` | `default` with the target driven and the chaser free |

`pressed` is an oscillator at 14 rad/s that forgets no error, and stays pressed together.

The reference solution of a scene is one FMU that integrates both vehicles, at the same tight
tolerance. Errors are those of the interface velocity, P from A in N, from the vehicles as their
owners know them, divided by the closing speed; of peak loads, relative; of the attitude of the
chaser, rad.
"""

import dataclasses

import numpy as np
from fmpy.fmi1 import FMICallException

from coupling_host import MOTION, VEHICLES, Coupling, read_body, rotation_vector
from extreme_cases.fmi_host import Host

GROUPS = 'outputs.groups=["relative", "capture", "phase", "energy", "coupling", "solver"]'
LOADS = ("compression", "shear", "bending")
TIGHT = {  # leaves errors of 1e-8 of the closing speed, 1e-6 of the peaks, in these scenes
    "solver.rtol": 1e-9,
    "solver.atol_position": 1e-11,
    "solver.atol_velocity": 1e-11,
    "solver.atol_energy": 1e-8,
}
THRUST = 4000.0  # N


def _press(_time):
    """The thrust of scene `pressed`: known, constant in N."""
    return {"chaser": ((THRUST, 0.0, 0.0), (0.0, 0.0, 0.0))}


@dataclasses.dataclass(frozen=True)
class CouplingScene:
    """A docking: overrides of the default scene, which vehicles the host moves, known loads."""

    overrides: tuple
    speed: float  # [m/s] by which velocity errors are divided
    driven: tuple = ("chaser",)
    loads: object = None
    peaks: tuple = ("compression", "shear")

    def build(self, runs, *more, free=False):
        """The FMU for a host, or the one that integrates both vehicles."""
        motion = [] if free else [f"{vehicle}.motion=driven" for vehicle in self.driven]
        return runs.fmu("idss_25t_350t", GROUPS, *self.overrides, *motion, *more)


_NEAR = ("initial.approach_time=0.1",)
SCENES = {
    "default": CouplingScene(_NEAR, 0.1),
    "light": CouplingScene(
        (
            *_NEAR,
            "chaser.mass=500",
            "chaser.inertia=[60, 110, 120, 0, 0, 0]",
            "chaser.interface_position=[0.62, 0.03, -0.02]",
            "mechanism.set.leg_defaults.damping=120",
            "contact.restitution=0.3",  # else many bounces magnify whatever error there is
        ),
        0.1,
    ),
    "pressed": CouplingScene(
        (
            "initial.at=start",
            "initial.capture_body.displacement=[-3.29e-4, 0, 0]",
            "chaser.position=[-19.0, 0.2, 0.1]",
            "chaser.interface_position=[3.720821, 0.1, -0.05]",
            "chaser.velocity=[0.006, 0.004, -0.003]",
            "chaser.angular_velocity=[0.002, -0.001, 0.0015]",
            "target.interface_position=[-15, 0.3, 0.05]",
            "mechanism.set.leg_defaults.stiffness=3e6",
            "mechanism.set.leg_defaults.damping=0",
            "mechanism.set.latches.damping=0",
            "contact.friction_coefficient=0",
            "contact.restitution=1",
        ),
        0.006,
        loads=_press,
        peaks=("compression", "bending"),
    ),
    "both": CouplingScene(_NEAR, 0.1, ("chaser", "target")),
    "target": CouplingScene(_NEAR, 0.1, ("target",)),
}


# ---------------------------------------------------------------- runs


@dataclasses.dataclass
class Course:
    """A run: what is compared, at communication points."""

    time: list = dataclasses.field(default_factory=list)
    velocity: list = dataclasses.field(default_factory=list)  # of P from A in N
    attitude: list = dataclasses.field(default_factory=list)  # of the chaser
    peaks: dict = dataclasses.field(default_factory=dict)
    time_of_capture: float = -1.0
    audit: float = np.nan  # momentum that does not add up, over the largest of a vehicle
    mismatch: float = 0.0  # of the mass, as the FMU sees it at the end
    warnings: list = dataclasses.field(default_factory=list)
    broken: str = ""  # why the run ended before its time

    def add(self, time, velocity, attitude):
        """One communication point."""
        self.time.append(time)
        self.velocity.append(velocity)
        self.attitude.append(attitude)


def _interface_velocity(bodies, points):
    """Velocity of P from A in N."""
    return bodies["target"].point(points["target"])[1] - bodies["chaser"].point(points["chaser"])[1]


def _interface_points(host):
    return {v: host.vector(f"{v}.interface_position") for v in VEHICLES}


def _read_peaks(host):
    """The largest loads so far."""
    return {load: host.value(f"capture.peak.{load}") for load in LOADS}


class _Reader:
    """Reads the motion of vehicles that are free in one call."""

    def __init__(self, host, vehicles):
        self.host, self.vehicles = host, vehicles
        self.points = _interface_points(host)
        self.bodies = {v: read_body(host, v) for v in vehicles}
        self.names = [
            f"{v}.{name}[{i + 1}]" for v in vehicles for name, n in MOTION.items() for i in range(n)
        ]

    def __call__(self, course, time, driven=()):
        """Add a communication point."""
        values = self.host.get(*self.names) if self.names else ()
        for k, v in enumerate(self.vehicles):
            x = values[13 * k : 13 * k + 13]
            self.bodies[v].put((x[:3], x[3:6], x[6:10], x[10:]))
        bodies = self.bodies | dict(driven)
        velocity = _interface_velocity(bodies, self.points)
        course.add(time, velocity, bodies["chaser"].q)


def run_solution(fmu, sizes, loads=None, settings=TIGHT):
    """Run of an FMU that integrates both vehicles, seen at the ends of steps of these sizes."""
    course = Course()
    with Host(fmu) as host:
        for name, value in settings.items():
            assert host.set_status({name: value}) == 0, host.last_line
        host.start()
        read = _Reader(host, VEHICLES)
        for size in sizes:
            for vehicle, (force, torque) in loads(host.time).items() if loads else ():
                host.put(f"{vehicle}.force_ext", force)
                host.put(f"{vehicle}.torque_ext", torque)
            host.step(size)
            read(course, host.time)
        course.peaks = _read_peaks(host)
        course.time_of_capture = host.value("time_of_capture")
    return course


def run_coupled(fmu, sizes, scheme, *, announce=False, settings=TIGHT, **options):
    """Run of an FMU with driven vehicles under a scheme.

    Args:
        fmu: the FMU.
        sizes: communication steps.
        scheme: of the host, see coupling_host.py.
        announce: True announces every step (coupling.next_step).
        settings: start values.
        options: passed to Coupling.
    """
    course = Course()
    sizes = list(sizes)
    with Coupling(fmu, scheme, settings=settings, first_step=sizes[0], **options) as pair:
        free = [v for v in VEHICLES if v not in pair.driven]
        read = _Reader(pair.host, free)
        first = pair.audit()
        worst, scale = np.zeros(2), np.zeros(2)
        for i, size in enumerate(sizes):
            following = sizes[i + 1] if announce and i + 1 < len(sizes) else None
            try:
                pair.step(size, following)
            except FMICallException:
                course.broken = pair.host.last_line
                break
            read(course, pair.time, pair.bodies)
            away = np.abs(pair.audit() - first)
            worst = np.maximum(worst, (away[:3].max(), away[3:].max()))
            momenta = [b.momentum(pair.fixed_point) for b in pair.bodies.values()]
            sizes_now = [max(np.linalg.norm(m[k]) for m in momenta) for k in (0, 1)]
            scale = np.maximum(scale, sizes_now)
        # Little turns about the fixed point: then linear momentum at a lever of 1 m is the measure.
        course.audit = float((worst / np.maximum(scale, (0.0, scale[0]))).max())
        course.peaks = _read_peaks(pair.host)
        course.time_of_capture = pair.host.value("time_of_capture")
        course.mismatch = pair.host.value("coupling.mass_mismatch")
        course.warnings = pair.warnings
    return course


# ---------------------------------------------------------------- errors


@dataclasses.dataclass(frozen=True)
class Errors:
    """How far a run is from the reference solution."""

    velocity: float  # largest, over the closing speed
    peak: float  # of the peak loads, relative; the larger one
    capture: float  # [s]
    attitude: float  # at the end [rad]


def compare(course, solution, scene):
    """Errors of a run at the communication points that the reference has too."""
    grid, times = np.array(solution.time), np.array(course.time)
    places = np.minimum(np.searchsorted(grid, times - 1e-9), len(grid) - 1)
    common = np.abs(grid[places] - times) < 1e-9
    assert common[-1], (grid[-1], times[-1])
    places = places[common]
    differences = np.array(course.velocity)[common] - np.array(solution.velocity)[places]
    turned = rotation_vector(course.attitude[-1], solution.attitude[places[-1]])
    return Errors(
        float(np.linalg.norm(differences, axis=1).max()) / scene.speed,
        max(abs(course.peaks[load] / solution.peaks[load] - 1.0) for load in scene.peaks),
        abs(course.time_of_capture - solution.time_of_capture),
        float(np.linalg.norm(turned)),
    )


def equal_steps(size, stop):
    """Steps of one size."""
    return [size] * round(stop / size)
