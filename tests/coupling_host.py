"""A host that moves vehicles by itself and couples them to a docking FMU, as a user would.

`RigidBody` is a vehicle under a force held in N and a torque held in body axes, all that a host
knows. `Coupling` makes communication steps of an FMU with `driven` vehicles in one of the orders,
or schemes, that masters have:

| scheme | what happens in a step from t to t + H |
|---|---|
| `sequential` | the FMU steps first; the vehicle makes the same step with its mean load (mode 1) |
| `parallel` | both step at once; the vehicle holds the mean load announced at t (mode 2) |
| `host_first` | the vehicle steps first with the announced load; the FMU gets its end (mode 3) |
| `vehicle_first` | the same in mode 1: wrong for this FMU |
| `end_of_step` | both step at once; the vehicle holds `V.force`, the load at t (heavy) |
| `iterated` | the FMU step is repeated until its load leads to the pose that it received (heavy) |

*Heavy*: the FMU receives a million times the mass and inertia, so that the vehicle inside keeps its
velocity during a step. That makes of the FMU what hosts meet elsewhere, a model that extrapolates
poses: `end_of_step` is scheme J1 and `iterated` scheme I of the coupling studies. (Inputs held
constant, pose and twist, cannot be made of this FMU from outside: a pose that stays needs a twist
of zero, and that is another twist.)

The masses of the host are those of the scene, the true ones; the FMU may receive others. `audit()`
is the momentum of everything as an outsider sums it up, less known impulses: a constant.
"""

import collections
import math

import numpy as np

from extreme_cases.fmi_host import WARNING, Host

VEHICLES = ("chaser", "target")
SEQUENTIAL, PARALLEL, HOST_FIRST = 1, 2, 3  # coupling.mode
HEAVY = 1e6
SCHEMES = ("parallel", "sequential", "host_first", "vehicle_first", "end_of_step", "iterated")
MOTION = {"position": 3, "velocity": 3, "attitude": 4, "angular_velocity": 3}
ZERO = (0.0, 0.0, 0.0)


# ---------------------------------------------------------------- rotations, quaternions w x y z


def cross(a, b):
    """Cross product of two vectors (numpy's takes twenty times as long)."""
    return np.array(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )


def turn(q, a):
    """Turn a vector from body axes to reference axes."""
    b = cross(q[1:], a) + q[0] * np.asarray(a)
    return a + 2.0 * cross(q[1:], b)


def rotation_vector(q0, q1):
    """The turn from attitude q0 to attitude q1 as a rotation vector, axes of q0."""
    w = q0 @ q1
    v = q0[0] * q1[1:] - q1[0] * q0[1:] - cross(q0[1:], q1[1:])
    if w < 0.0:
        w, v = -w, -v
    size = math.sqrt(v @ v)
    return v * (2.0 * math.atan2(size, w) / size if size > 0.0 else 2.0)


def symmetric(components):
    """A matrix from xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = components
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


# ---------------------------------------------------------------- a vehicle of the host


class RigidBody:
    """A vehicle as its host integrates it: mass, inertia about the CoM, and motion."""

    LONGEST, LARGEST_TURN = 5e-3, 2e-3  # of a Runge-Kutta step [s], [rad]

    def __init__(self, mass, inertia, motion):
        self.mass, self.inertia = mass, np.array(inertia)
        self._rows = [*map(tuple, self.inertia), *map(tuple, np.linalg.inv(self.inertia))]
        self.x, self.v = motion[0], motion[1]  # [m], [m/s] in N
        self.q, self.w = motion[2], motion[3]  # body to N, [rad/s] in body axes

    def motion(self):
        """Position, velocity, attitude, angular velocity."""
        return self.x, self.v, self.q, self.w

    def put(self, motion):
        """Set what motion() returned."""
        self.x, self.v, self.q, self.w = motion

    def _spin_rates(self, s, torque):
        """Rates of attitude and angular velocity; plain numbers, which is quickest."""
        q0, q1, q2, q3, x, y, z = s
        a, b, c, d, e, f = self._rows
        hx = a[0] * x + a[1] * y + a[2] * z
        hy = b[0] * x + b[1] * y + b[2] * z
        hz = c[0] * x + c[1] * y + c[2] * z
        tx, ty, tz = torque
        tx, ty, tz = tx - y * hz + z * hy, ty - z * hx + x * hz, tz - x * hy + y * hx
        return (
            0.5 * (-q1 * x - q2 * y - q3 * z),
            0.5 * (q0 * x + q2 * z - q3 * y),
            0.5 * (q0 * y - q1 * z + q3 * x),
            0.5 * (q0 * z + q1 * y - q2 * x),
            d[0] * tx + d[1] * ty + d[2] * tz,
            e[0] * tx + e[1] * ty + e[2] * tz,
            f[0] * tx + f[1] * ty + f[2] * tz,
        )

    def move(self, force, torque, size, gravity=ZERO):
        """Move under a force in N and a torque in body axes that are held for some seconds."""
        a = np.asarray(force) / self.mass + np.asarray(gravity)
        self.x = self.x + size * self.v + 0.5 * size * size * a  # exact
        self.v = self.v + size * a
        torque = [float(t) for t in torque]
        s = [*map(float, self.q), *map(float, self.w)]
        rate = max(map(abs, s[4:])) + size * max(map(abs, torque)) / self.inertia.diagonal().min()
        count = math.ceil(max(size / self.LONGEST, size * rate / self.LARGEST_TURN) - 1e-9)
        h = size / count
        for _ in range(count):
            k1 = self._spin_rates(s, torque)
            k2 = self._spin_rates([y + 0.5 * h * k for y, k in zip(s, k1, strict=True)], torque)
            k3 = self._spin_rates([y + 0.5 * h * k for y, k in zip(s, k2, strict=True)], torque)
            k4 = self._spin_rates([y + h * k for y, k in zip(s, k3, strict=True)], torque)
            s = [
                y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
                for y, a, b, c, d in zip(s, k1, k2, k3, k4, strict=True)
            ]
            norm = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2] + s[3] * s[3])
            s[:4] = [y / norm for y in s[:4]]
        self.q, self.w = np.array(s[:4]), np.array(s[4:])

    def momentum(self, point):
        """Linear momentum, and angular momentum about a point, in N."""
        p = self.mass * self.v
        return p, cross(self.x - point, p) + turn(self.q, self.inertia @ self.w)

    def point(self, r):
        """Position and velocity in N of a point given in body axes."""
        return self.x + turn(self.q, r), self.v + turn(self.q, cross(self.w, r))


def read_body(host, vehicle):
    """The rigid body that a vehicle of an FMU is at the moment."""
    return RigidBody(
        host.value(f"{vehicle}.mass"),
        symmetric(host.vector(f"{vehicle}.inertia", 6)),
        [host.vector(f"{vehicle}.{name}", count) for name, count in MOTION.items()],
    )


# ---------------------------------------------------------------- coupling


class Coupling:
    """An FMU whose driven vehicles are moved here, step by step.

    Args:
        fmu: the FMU; its vehicles that are `driven` are moved by this host.
        scheme: one of SCHEMES.
        reported: mass and inertia that the FMU receives, as a multiple of the true ones.
        bodies: own rigid bodies by vehicle, where they differ from what the FMU says.
        shift, drift: everything is started elsewhere [m], with another velocity [m/s].
        loads: function from time to {vehicle: (force in N, torque in body axes)}; known loads.
        reported_loads: False keeps these loads from the FMU.
        gravity: in N [m/s2], reported to the FMU as well.
        settings: start values of the FMU by name.
        first_step: the step that is announced at the beginning (coupling.expected_step).
        mode: coupling.mode, if another than belongs to the scheme.
        late, old: steps by which loads act late, and reports of the motion are old; a part of a
            step of `late` lets loads change inside the steps.
    """

    def __init__(
        self,
        fmu,
        scheme="parallel",
        *,
        reported=1.0,
        bodies=None,
        shift=ZERO,
        drift=ZERO,
        loads=None,
        reported_loads=True,
        gravity=ZERO,
        settings=None,
        first_step=None,
        mode=None,
        late=0.0,
        old=0,
        **host_options,
    ):
        assert scheme in SCHEMES, scheme
        self.scheme, self.loads, self.reported_loads = scheme, loads, reported_loads
        self.gravity = np.array(gravity)
        self.host = Host(fmu, **host_options)
        causality = {name: v.causality for name, v in self.host.variables.items()}
        present = [v for v in VEHICLES if f"{v}.position[1]" in causality]
        self.driven = [v for v in present if causality[f"{v}.position[1]"] == "input"]
        self._shift(present, np.array(shift), np.array(drift))
        self.bodies = {v: read_body(self.host, v) for v in self.driven} | (bodies or {})
        if scheme in ("end_of_step", "iterated"):
            reported *= HEAVY
            settings = {"coupling.identify": False} | (settings or {})
        for vehicle in self.driven if reported != 1.0 else []:
            self.host.set(**{f"{vehicle}__mass": reported * self.host.value(f"{vehicle}.mass")})
            self.host.put(
                f"{vehicle}.inertia", reported * self.host.vector(f"{vehicle}.inertia", 6)
            )
        for name, value in (settings or {}).items():
            kind = self.host.variables[name].type
            assert self.host.set_status({name: value}, kind) <= WARNING, self.host.last_line
        if "coupling.mode" in causality:
            own = {"parallel": PARALLEL, "host_first": HOST_FIRST}.get(scheme, SEQUENTIAL)
            self.host.choose(coupling__mode=mode or own)
        if first_step and "coupling.expected_step" in causality:
            self.host.set(coupling__expected_step=first_step)
        if any(gravity):
            self.host.put("gravity", gravity)
        self._report_loads(self._known_loads())
        self.host.start()
        self.known = np.zeros(6)  # impulse of known loads, and moment about the fixed point, so far
        self.calls = 0  # of fmi2DoStep
        nothing = {v: (np.zeros(3), np.zeros(3)) for v in self.driven}
        self.share = late - math.floor(late)  # of a step in which the load before still acts
        self.queue = collections.deque([nothing] * (math.floor(late) + 1))
        self.arrived = None  # the last report
        self.reports = collections.deque([{v: self.bodies[v].motion() for v in self.driven}] * old)
        self.fixed_point = self._reference()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.host.free()

    @property
    def time(self):
        """The time of the host's clock."""
        return self.host.time

    @property
    def warnings(self):
        """Texts of warnings so far, but for limits, which runs without a host pass, too."""
        texts = [text for status, _, text in self.host.lines if status == WARNING]
        return [text for text in texts if not text.startswith("limit '")]

    def _shift(self, present, shift, drift):
        """Start everything elsewhere."""
        for vehicle in present if shift.any() or drift.any() else []:
            for name, by in (("position", shift), ("velocity", drift)):
                self.host.put(f"{vehicle}.{name}", self.host.vector(f"{vehicle}.{name}") + by)

    def _known_loads(self):
        """Loads that the host knows at the present time."""
        return self.loads(self.host.time) if self.loads else {}

    def _report_loads(self, known):
        """Pass known loads to the FMU."""
        for vehicle, (force, torque) in known.items() if self.reported_loads else ():
            self.host.put(f"{vehicle}.force_ext", force)
            self.host.put(f"{vehicle}.torque_ext", torque)

    def _report_motion(self, vehicle, motion):
        """Pass the motion of a vehicle to the FMU, in one call."""
        names = [
            self.host.reference[f"{vehicle}.{name}[{i + 1}]"]
            for name, count in MOTION.items()
            for i in range(count)
        ]
        self.host.slave.setReal(names, [float(x) for x in np.concatenate(motion)])

    def _read_loads(self, kind="_mean"):
        """Load of the docking on each driven vehicle."""
        loads = {}
        for vehicle in self.driven:
            names = [f"{vehicle}.{n}{kind}[{i}]" for n in ("force", "torque") for i in (1, 2, 3)]
            both = self.host.get(*names)
            loads[vehicle] = (both[:3], both[3:])
        return loads

    def _do_step(self, size):
        """One step of the FMU; the host's clock goes on later."""
        self.host.slave.doStep(self.host.time, size)
        self.calls += 1

    def _delay(self, loads):
        """Send loads to the vehicles, and take those that arrive in this step."""
        self.queue.append(loads)
        before = self.queue.popleft()
        return before, self.queue[0]

    def _delay_report(self, motion):
        """Send a report to the FMU, and take the one that arrives."""
        self.reports.append(motion)
        self.arrived = self.reports.popleft()
        return self.arrived

    def _ends(self, pair, known, size):
        """Where the loads before and after a change would take the vehicles within a step."""
        ends = {}
        for vehicle in self.driven:
            body = self.bodies[vehicle]
            start = body.motion()
            f, t = known.get(vehicle, (ZERO, ZERO))
            for loads, share in zip(pair, (self.share, 1.0 - self.share), strict=True):
                force, torque = loads[vehicle]
                if share > 0.0:
                    total = force + np.asarray(f), torque + np.asarray(t)
                    body.move(*total, share * size, self.gravity)
            ends[vehicle] = body.motion()
            body.put(start)
        return ends

    # Steps

    def step(self, size, next_size=None):
        """One communication step.

        Args:
            size: its length [s].
            next_size: length of the step after it, which a parallel host may announce.
        """
        known = self._known_loads()
        self._report_loads(known)
        if next_size and "coupling.next_step" in self.host.reference:
            self.host.set(coupling__next_step=next_size)
        if self.scheme == "iterated":
            ends = self._iterate(known, size)
        else:
            kind = "" if self.scheme == "end_of_step" else "_mean"
            loads = None if self.scheme == "sequential" else self._delay(self._read_loads(kind))
            reported = {v: self.bodies[v].motion() for v in self.driven}
            if self.scheme in ("host_first", "vehicle_first"):
                reported = self._ends(loads, known, size)
            reported = self._delay_report(reported)
            for vehicle in self.driven:
                self._report_motion(vehicle, reported[vehicle])
            self._do_step(size)
            ends = self._ends(loads or self._delay(self._read_loads(kind)), known, size)
        self._count(known, ends, size)
        for vehicle, end in ends.items():
            self.bodies[vehicle].put(end)
        self.host.time += size

    def _iterate(self, known, size, most=30, close=1e-11):
        """Repeat the step of the FMU until its load leads to the end pose that it received."""
        saved = self.host.save()
        ends = {v: self.bodies[v].motion() for v in self.driven}
        first = {v: (self.bodies[v].v, self.bodies[v].w) for v in self.driven}
        for turn_count in range(most):
            for vehicle in self.driven:
                x, _, q, _ = self.bodies[vehicle].motion()
                x1, _, q1, _ = ends[vehicle]
                v, w = (x1 - x) / size, rotation_vector(q, q1) / size
                if turn_count == 0:
                    v, w = first[vehicle]
                self._report_motion(vehicle, (x, v, q, w))
            self._do_step(size)
            new = self._ends([self._read_loads()] * 2, known, size)
            moved = [new[v][0] - ends[v][0] for v in self.driven]
            turned = [rotation_vector(ends[v][2], new[v][2]) for v in self.driven]
            change = np.abs(moved + turned).max()
            ends = new
            if change < close:
                break
            if turn_count + 1 < most:
                self.host.restore(saved)
                self._report_loads(known)
        self.host.release(saved)
        return ends

    # What an outsider sees

    def _count(self, known, ends, size):
        """Add the impulses of known loads, with their moments about the fixed point.

        The force acts at the CoM, whose path under the loads held over the step is a parabola: its
        mean position is exact.  The mean attitude is Simpson's.
        """
        for vehicle, (force, torque) in known.items():
            if vehicle in self.driven:
                x0, v0, q0, _ = self.bodies[vehicle].motion()
                x1, v1, q1, _ = ends[vehicle]
                way = (x0 + x1) / 2.0 + size / 12.0 * (v0 - v1) - self.fixed_point
                middle = q0 + (q1 if q0 @ q1 > 0.0 else -q1)
                middle = middle / np.linalg.norm(middle)
                turned = (turn(q0, torque) + 4.0 * turn(middle, torque) + turn(q1, torque)) / 6.0
                self.known[3:] += size * (cross(way, force) + turned)
            self.known[:3] += size * np.asarray(force)

    def _reference(self):
        """The point about which the FMU states angular momentum."""
        return self.host.vector("momentum.reference")

    def audit(self):
        """Linear momentum, and angular about a fixed point, of everything, less known impulses.

        The FMU receives the motion that is due now first: its pending impulse depends on what its
        loads really did. Without gravity, which acts on masses inside that the host does not know.
        """
        for vehicle in self.driven:
            due = self.reports[0][vehicle] if self.reports else self.bodies[vehicle].motion()
            is_there = self.scheme == "host_first" and self.arrived
            self._report_motion(vehicle, self.arrived[vehicle] if is_there else due)
        total = np.zeros(6)
        for body in self.bodies.values():
            linear, angular = body.momentum(self.fixed_point)
            total += np.concatenate([linear, angular])
        about = self._reference()
        pairs = [("momentum.linear", "momentum.angular")]
        if "coupling.pending_impulse[1]" in self.host.reference:
            pairs.append(("coupling.pending_impulse", "coupling.pending_angular_impulse"))
        for linear, angular in pairs:
            p = self.host.vector(linear)
            total[:3] += p
            total[3:] += self.host.vector(angular) + cross(about - self.fixed_point, p)
        return total - self.known

    def interface_motion(self):
        """Position and velocity of P from A in N, from the vehicles themselves."""
        ends = []
        for vehicle in VEHICLES:
            body = self.bodies.get(vehicle)
            if body is None:
                body = read_body(self.host, vehicle)
            ends.append(body.point(self.host.vector(f"{vehicle}.interface_position")))
        return ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]
