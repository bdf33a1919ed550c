"""What should a host report of its vehicle, and what does it cost to report something else?

One docking of a chaser of 25 t, with kinds of vehicles that a host integrates: rigid, with thruster
pulses, arrays, slosh, a light part in front of a spring, a wrong mass, fuel use, a delay, another
order. Each is compared with an FMU that integrates everything. Where none can, because the vehicle
is no model of dockloop, the reference solution is the same host with steps of 1 ms. The error is
that of the worst peak load, relative. A second table has wrong masses, inertias and centres of
mass in three scenes. tests/validation/host_vehicles.md has both.

Example:
    .venv/bin/python tests/studies/host_vehicles.py --steps 10 --stop 1.0 -o /tmp/page.md
"""

import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

import dockloop as dl
from coupling_host import MOTION, RigidBody, turn
from dockloop.base import paths
from dockloop.native.core import list_loads, name_choice
from identified_hosts import CASES, SCENES, find_error
from page import Table, make_parser, replace_section, write_page
from vehicles import ARRAYS, HUB, INERTIA, MASS, SLOSH, TANK, TIGHT, FlexibleHost, components

SCENE = "idss_25t_350t"
NEAR = {"initial.approach_time": 0.1}
SHORT = 1e-3  # s, of a reference solution that a host makes
PAGE = paths.ROOT / "tests" / "validation" / "host_vehicles.md"
GUIDE = paths.ROOT / "fmu" / "HOSTS.md"  # has the table, too

PART = 2000.0  # kg, in front of a spring along x
ADAPTER = {"mass": PART, "inertia": [2000.0, 1500.0, 1500.0, 0.0, 0.0, 0.0], "joint": "elastic"}
ADAPTER |= {"position": [2.5, 0.0, 0.0], "frequency": 12.0, "damping_ratio": 0.02}


# ---------------------------------------------------------------- vehicles of hosts


class Rigid:
    """A rigid body; its mass may change, and thrusters may fire."""

    def __init__(self, motion, mass=MASS, inertia=INERTIA, burn=0.0, thrust=None):
        self.body, self.inertia, self.burn, self.thrust = (
            RigidBody(mass, inertia, motion),
            inertia,
            burn,
            thrust,
        )
        self.time = 0.0

    def motion(self):
        """Return position, velocity, attitude, angular velocity."""
        return self.body.motion()

    def advance(self, force, torque, h):
        """Make a step under held loads; return the mean of own forces, and of own torques."""
        pieces = round(h / PIECE) if self.thrust else 1
        own = np.zeros(3)
        for _ in range(pieces):
            push = self.thrust(self.time) if self.thrust else np.zeros(3)
            own += push / pieces
            if self.burn:
                share = 1.0 - self.burn * (self.time + h / 2)
                z = self.body.motion()
                self.body = RigidBody(share * MASS, share * self.inertia, z)
            self.body.move(force + push, torque, h / pieces)
            self.time += h / pieces
        return own, np.zeros(3)


class Sprung:
    """A light part with the docking interface, and behind a spring along x the rest."""

    def __init__(self, motion, part=PART, frequency=12.0):
        self.z = [np.array(z) for z in motion]
        self.part, self.rest = part, MASS - part
        omega = 2.0 * np.pi * frequency
        self.stiffness = omega**2 * self.part * self.rest / MASS
        self.damping = 0.04 * self.stiffness / omega
        self.u = self.du = 0.0

    def motion(self):
        """Return the motion of the part."""
        return self.z

    def advance(self, force, torque, h):
        """Make a step."""
        p, v, q, w = self.z
        count = round(h / 2.5e-4)
        h /= count
        moments = np.diag(INERTIA)
        for _ in range(count):
            pull = self.stiffness * self.u + self.damping * self.du
            body = turn(q * [1, -1, -1, -1], force)
            a = body / MASS
            a[0] = (body[0] + pull) / self.part
            self.du += h * (-pull / self.rest - a[0])
            self.u += h * self.du
            v = v + h * turn(q, a)
            p = p + h * v
            w = w + h * (torque - np.cross(w, moments * w)) / moments
            q = q + h / 2 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])
            q /= np.linalg.norm(q)
        self.z = [p, v, q, w]
        return np.zeros(3), np.zeros(3)


PIECE = 5e-3  # s, of thruster pulses
HOOKED = 95.0  # s: the ring of apda has been retracted, and the hooks have closed


def pulse(time):
    """400 N to the side for 30 ms, four times a second, not at ends of steps of 10 ms."""
    phase = (time + 1e-9) % 0.25
    return np.array([0.0, 400.0 if 0.115 <= phase < 0.145 else 0.0, 0.0])


# ---------------------------------------------------------------- runs


def make_docking(motion, overrides=None, chaser=None, scene=SCENE):
    """Return the docking of the study; `chaser` has members of the scene."""
    read = dl.Scene(scene)
    if chaser:
        members = tomllib.loads(read.path.read_text(encoding="utf-8"))
        members["chaser"] |= chaser
        read = dl.Scene(members)
    docking = dl.Docking(dl.Scene(read, NEAR | {"chaser.motion": motion} | (overrides or {})))
    for name, value in TIGHT.items():
        docking.set(name, value)
    return docking


def read_peaks(docking):
    """Return the peak loads so far."""
    return np.array([docking.get(f"capture.peak.{load}") for load in list_loads()])


def run_alone(stop, chaser=None, thrust=None, scene=SCENE):
    """Return peaks of a docking that integrates everything."""
    docking = make_docking("free", chaser=chaser, scene=scene)
    step = PIECE if thrust else 0.1
    for i in range(round(stop / step)):
        if thrust:
            docking.set("chaser.force_ext", thrust(i * step))
        docking.step(step)
    return read_peaks(docking)


@dataclass
class Row:
    """A vehicle, what its host reports, and how the host is coupled.

    Attributes:
        vehicle, report: texts of the table.
        make: the vehicle from its start motion.
        reference: peaks by stop time; None: the host itself with steps of `SHORT`.
        stated: start values of the docking.
        mode: `coupling.mode`.
        order: of the host, if another than that of the mode.
        with_own: the host reports its own mean loads.
        scene: of the docking.
        stop: its end, if another than that of the table [s].
        late: steps by which loads act late.
        states_delay: `coupling.delay` says so.
        point: body axes, of the point that is reported [m].
        chaser: members of the scene of the docking.
    """

    vehicle: str
    report: str
    make: Callable
    reference: Callable | None
    stated: dict = field(default_factory=dict)
    mode: str = "parallel"
    order: str = ""
    with_own: bool = False
    late: int = 0
    states_delay: bool = False
    point: tuple = (0.0, 0.0, 0.0)
    chaser: dict | None = None
    scene: str = SCENE
    stop: float | None = None


def couple(row, step, stop):
    """Return peaks, the diagnosis, and why the run ended before its time (or nothing)."""
    docking = make_docking("driven", {"coupling.mode": row.mode}, row.chaser, row.scene)
    timing = {"coupling.expected_step": step}
    if row.states_delay:
        timing["coupling.delay"] = row.late * step
    for name, value in (row.stated | timing).items():
        docking.set(name, value)
    names = [f"chaser.{name}" for name in MOTION]
    host = row.make([np.array(docking.get(name)) for name in names])
    docking.record([docking.time])  # ends the setting of start values
    nothing = np.zeros(3)
    queue = [(nothing, nothing)] * row.late

    def read():
        queue.append(tuple(docking.get(f"chaser.{load}_mean") for load in ("force", "torque")))
        return queue.pop(0)

    def report(motion, own=(nothing, nothing)):
        x, v, q, w = motion
        arm = np.array(row.point)
        motion = (x + turn(q, arm), v + turn(q, np.cross(w, arm)), q, w) if arm.any() else motion
        for name, value in zip(names, motion, strict=True):
            docking.set(name, value)
        for name, value in zip(
            ("force_ext", "torque_ext"), own if row.with_own else (), strict=False
        ):
            docking.set(f"chaser.{name}", value)

    order = row.order or row.mode
    failure = ""
    for _ in range(round(stop / step)):
        try:
            if order == "sequential":
                report(host.motion())
                docking.step(step)
                host.advance(*read(), step)
            else:
                begin, loads = host.motion(), read()
                own = host.advance(*loads, step)
                report(host.motion() if order == "host_first" else begin, own)
                docking.step(step)
        except dl.DockloopError as error:
            failure = f"refused at {docking.time:.1f} s"
            print(row.vehicle, step, error, file=sys.stderr)
            break
    found = name_choice("coupling.diagnosis", docking.get("coupling.diagnosis"))
    return read_peaks(docking), found, failure


def make_rows():
    """Return all vehicles of the study."""
    hub = {"chaser.mass": HUB[0], "chaser.inertia": components(HUB[1])}
    hub_members = {"mass": HUB[0], "inertia": components(HUB[1]), "part": ARRAYS}
    tank = {"mass": TANK[0], "inertia": components(TANK[1]), "part": [SLOSH]}
    inertia = components(INERTIA)

    def arrays(motion):
        return FlexibleHost(motion, *HUB, ARRAYS)

    def sloshing(motion):
        return FlexibleHost(motion, *TANK, [SLOSH])

    def pulsed(motion):
        return Rigid(motion, thrust=pulse)

    def thrust_alone(stop):
        return run_alone(stop, thrust=pulse)

    def arrays_alone(stop):
        return run_alone(stop, hub_members)

    def slosh_alone(stop):
        return run_alone(stop, tank)

    def with_adapter(frequency, part=PART, **where):
        """The FMU has the adapter, and the host the rest."""
        scene = where.get("scene", SCENE)
        adapter = ADAPTER | {"mass": part, "frequency": frequency}
        if part != PART:
            adapter["inertia"] = [x * part / PART for x in ADAPTER["inertia"]]
        rest = {"mass": MASS - part, "inertia": components(INERTIA), "adapter": adapter}
        name = f"adapter {part / 1e3:g} t, {frequency:g} Hz, in the FMU"
        if scene != SCENE:
            name += f", `{scene}`"
        if "stop" in where:
            name += ", hooks close"
        return Row(
            name,
            "mass and inertia of the rest",
            lambda motion: Rigid(motion, MASS - part),
            lambda stop: run_alone(stop, rest, scene=scene),
            chaser=rest,
            **where,
        )

    def behind_adapter(frequency, **where):
        """The host has all of the same vehicle, and reports its total."""
        return replace(
            with_adapter(frequency, **where),
            vehicle=f"adapter 2 t, {frequency:g} Hz, in the host, `apda`, hooks close",
            report="total mass and inertia",
            make=lambda motion: Sprung(motion, PART, frequency),
            chaser=None,
        )

    def burning(motion):
        return Rigid(motion, burn=0.05 / 4.0)

    return [
        Row("rigid", "its mass and inertia", Rigid, run_alone),
        Row("rigid, sequential", "the same", Rigid, run_alone, mode="sequential"),
        Row("rigid, host first", "the same", Rigid, run_alone, mode="host_first"),
        Row("rigid, host first", "mode parallel", Rigid, run_alone, order="host_first"),
        Row("thruster pulses", "mean force of the step", pulsed, thrust_alone, with_own=True),
        Row("thruster pulses", "nothing of them", pulsed, thrust_alone),
        Row("two arrays", "total mass and inertia", arrays, arrays_alone),
        Row(
            "two arrays",
            "those of the hub, mean loads of arrays",
            arrays,
            arrays_alone,
            hub,
            with_own=True,
        ),
        Row("slosh 10 %", "total mass and inertia", sloshing, slosh_alone),
        Row("adapter 2 t, 12 Hz, in the host", "total mass and inertia", Sprung, None),
        Row(
            "adapter 300 kg, 8 Hz, in the host, `probe_drogue`",
            "total mass and inertia",
            lambda motion: Sprung(motion, 300.0, 8.0),
            None,
            scene="probe_drogue",
        ),
        with_adapter(12.0),
        with_adapter(8.0, 300.0, scene="probe_drogue"),
        *(
            place(frequency, scene="apda", stop=HOOKED)
            for frequency in (8.0, 12.0, 20.0)
            for place in (with_adapter, behind_adapter)
        ),
        Row(
            "rigid",
            "half of the mass and inertia",
            Rigid,
            run_alone,
            {"chaser.mass": MASS / 2, "chaser.inertia": [x / 2 for x in inertia]},
        ),
        Row(
            "rigid",
            "half of the inertia",
            Rigid,
            run_alone,
            {"chaser.inertia": [x / 2 for x in inertia]},
        ),
        Row("burns 5 % of its mass in 4 s", "the mass of the start", burning, None),
        Row("loads act one step late", "as without delay", Rigid, run_alone, late=1),
        Row(
            "loads act one step late",
            "as without delay; stated in `coupling.delay`",
            Rigid,
            run_alone,
            late=1,
            states_delay=True,
        ),
        Row("rigid", "a point 0.1 m away", Rigid, run_alone, point=(0.0, 0.1, 0.0)),
    ]


def list_identified():
    """Return the table of wrong masses, inertias and centres of mass."""
    steps = (0.01, 0.1)
    heads = (f"`{scene}`, {1e3 * step:g} ms" for scene in SCENES for step in steps)
    table = Table("stated", *heads)
    for case in (*CASES, "fuel"):
        errors = [find_error(scene, step, case)[0] for scene in SCENES for step in steps]
        name = "5 % of fuel lost in 4 s" if case == "fuel" else case
        table.add(name, *(f"{error:.0e}" for error in errors))
        print(name, *errors, sep=" | ", file=sys.stderr, flush=True)
    return table


def main():
    """Run all vehicles, write the table."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument(
        "--steps", nargs="+", type=float, default=(10.0, 30.0, 50.0, 100.0), help="ms"
    )
    parser.add_argument("--stop", type=float, default=3.0, help="s, a multiple of all steps")
    options = parser.parse_args()
    table = Table(
        "vehicle of the host", "reported", *(f"{step:g} ms" for step in options.steps), "named"
    )
    solutions = {}
    for row in make_rows():
        key, stop = row.reference or row.make, row.stop or options.stop
        if key not in solutions:
            solutions[key] = row.reference(stop) if row.reference else couple(row, SHORT, stop)[0]
        cells, names = [], []
        for step in options.steps:
            peaks, found, failure = couple(row, 1e-3 * step, stop)
            occurs = solutions[key] > 0.0
            error = np.abs(peaks[occurs] / solutions[key][occurs] - 1.0).max()
            most = peaks.max() / solutions[key].max()
            cells.append(f"{failure}, load x {most:.1f}" if failure else f"{error:.0e}")
            names.append(found)
        named = [name for name in dict.fromkeys(names) if name != "none"]
        found = (row.vehicle, row.report, *cells, ", ".join(named) or "-")
        table.add(*found)
        print(*found, sep=" | ", file=sys.stderr, flush=True)
    command = "tests/studies/host_vehicles.py" + ("" if options.output == PAGE else " -o PAGE")
    blocks = (
        f"Scene `{SCENE}` unless another is named, chaser of 25 t, {options.stop:g} s. Numbers are"
        " the relative error of the worst peak load, by communication step. `named` is"
        " `coupling.diagnosis`.",
        table,
        "Wrong numbers in three scenes: what is stated over what is true. `centre` is a centre of"
        " mass 0.1 m from the position that is reported. The FMU identifies them. Errors as above.",
        list_identified(),
    )
    write_page(options.output, "What hosts report of their vehicles", command, *blocks)
    if options.output == PAGE:
        replace_section(GUIDE, "Measured", command, *blocks)
    return 0


if __name__ == "__main__":
    sys.exit(main())
