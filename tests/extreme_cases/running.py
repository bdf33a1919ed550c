"""Extremes of running: time and steps, inputs, contact at its edges, saved states, tolerances."""

import ctypes
import math
import random
import threading

import numpy as np

from extreme_cases import Part
from extreme_cases import mechanism_benchmarks as benchmarks
from extreme_cases.fmi_host import go_on_elsewhere
from extreme_cases.mechanics import (
    BRICARD_HINGE,
    BRICARD_TIME,
    BUMPER_OUTPUTS,
    DOWN_Y,
    GRAVITY,
    RING,
    SLIDER,
    TOE,
    build_hexapod,
    bumper,
    find_four_bars_constant,
    find_hexapod,
)
from extreme_cases.reference import Bumper
from extreme_cases.scenes import FIXED_BASE, OK, OUTPUTS, Host, hexapod, move

NEAR = "initial.approach_time=0.1"  # default docking: contact after 0.1 s, capture before 1 s
EXACT = 1.0 / 128  # s, a step that binary numbers hold


# ------------------------------------------------------------------------------------------------
# 5. Long runs.
def run_turning(shop, score, quick):
    """Item 5: a parallelogram goes round and round, through two singular poses each turn.

    A step that is refused, since an inner step has come to lie in such a pose, is made in halves.
    """
    turns, chunk = (200, 5) if quick else (20_000, 100)
    period = 1.92371181733896585
    start = "[initial.joints.upright0]\nrate = 1.0"
    fmu = shop.own(benchmarks.four_bars(1), FIXED_BASE, start, OUTPUTS, rtol=1e-9)
    k = find_four_bars_constant(1)
    worst = 0.0
    with Host(fmu) as host:
        host.slave.setReal([host.reference["gravity[2]"]], [-GRAVITY])
        host.start()
        while host.time < turns * period * (1.0 - 1e-12):
            size = min(chunk * period, turns * period - host.time)
            while host.step_status(size) != OK:
                score.refuse(host.last_line, f"after {host.time / period:.0f} turns")
                size /= 2.0
                if size < 1e-3:
                    score.bad.append(f"{host.time} s: no step is small enough")
                    return
            angle, rate = host.get("state.q[1]", "state.v[1]")
            worst = max(worst, abs(0.5 * rate**2 + k * (math.cos(angle) - 1.0) - 0.5) / k)
    done = angle / (2 * math.pi)
    score.check(abs(done / turns - 1.0) < 1e-3, f"{done:.2f} turns of {turns}", "lost its way")
    score.notes["turns"] = float(done)
    score.compare(worst / turns, f"energy per turn, {turns} turns")


def run_swinging(shop, score, quick):
    """Item 5: the free-floating hexapod without dampers."""
    count = 200 if quick else 20_000
    fmu = build_hexapod(shop, rtol=1e-9, damping=0.0)
    mechanism = {"mechanism": hexapod(damping=0.0)}
    frequency = max(mode["frequency_rad_s"] for mode in shop.check(mechanism)["modes"])
    span = count * 2 * math.pi / frequency
    names = [
        "energy.kinetic", "energy.potential", "momentum.residual",
        *(f"ring.attitude[{i}]" for i in (1, 2, 3, 4)),
        *(f"chaser.attitude[{i}]" for i in (1, 2, 3, 4)),
    ]  # fmt: skip
    steps = max(20, count // 100)  # one step of 1000 oscillations takes more work than it may
    rows = move(fmu, span * np.arange(1, steps + 1) / steps, names=names)
    energy = rows[:, 0] + rows[:, 1]
    drift = np.max(np.abs(energy / energy[0] - 1.0))
    score.compare(drift / count, f"energy per oscillation, {count} of them")
    for columns, name in ((slice(3, 7), "ring"), (slice(7, 11), "base")):
        norm = np.linalg.norm(rows[:, columns], axis=1)
        score.compare(np.max(np.abs(norm - 1.0)), f"length of the quaternion, {name}")
    score.compare(np.max(rows[:, 2]), "momentum")


VEHICLE = FIXED_BASE.replace("fixed", "free") + "velocity = [0.1, 0, 0]"


def run_many_steps(shop, score, quick):
    """Item 5: a vehicle coasts; every step is a call of the interface."""
    count = 50_000 if quick else 1_000_000
    fmu = shop.own(None, VEHICLE)
    for size, added, steps in (
        (1e-3, False, count), (1e-3, True, count // 10),
        (0.0371, False, count // 10), (0.0371, True, count // 10),
    ):  # fmt: skip
        with Host(fmu) as host:
            host.start()
            call, component = host.slave.dll.fmi2DoStep, host.slave.component
            call.restype = ctypes.c_int
            call.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int]
            status, t = OK, 0.0
            for i in range(steps):
                status |= call(component, t, size, 1)
                t = t + size if added else (i + 1) * size
            x = host.value("chaser.position[1]")
        where = f"{steps} steps of {size:g} s, times {'added up' if added else 'multiplied'}"
        score.check(status == OK, where, "a step was not made")
        score.compare(abs(x / 0.1 / t - 1.0), where)


# ------------------------------------------------------------------------------------------------
# 6. Steps and times. The absorber: m x'' = -k x - c x' from x(0) = 0 until its force is zero.
def find_absorber(t):
    """Distance between the interfaces along the axis and its rate at a time after contact."""
    mass, stiffness, damping, speed = 25e3 * 350e3 / 375e3, 20e3, 12961.481396815721, 0.1
    s = damping / (2 * mass)
    w = math.sqrt(stiffness / mass - s * s)
    a = (stiffness / mass - 2 * s * s) / w
    end = (math.pi - math.atan2(2 * s, a)) / w

    def at(t):
        decay = math.exp(-s * t)
        x = speed / w * decay * math.sin(w * t)
        return x, speed * decay * (math.cos(w * t) - s / w * math.sin(w * t))

    x, v = at(min(t, end))
    return np.array([-(x + v * max(0.0, t - end)), -v])


AXIAL = ["relative.axial", "relative.velocity[1]"]


def find_times(name, end):
    """Communication points of a pattern of steps, the last one at `end`."""
    sizes = random.Random(7)
    patterns = {
        "1000 of 1e-9 s, then one": [1e-9] * 1000 + [9.0],
        "1000 of 1e-7 s, then one": [1e-7] * 1000 + [9.0],
        "of 1e-3 s": [1e-3] * 10_000,
        "of 0.0371 s": [0.0371] * 200,
        "of pi/7 s": [math.pi / 7] * 20,
        "one": [end],
        "one of 10 s": [10.0],
        "irregular, 1e-9 to 1 s": [10 ** sizes.uniform(-9, 0) for _ in range(4000)],
        "1e-9 s between steps of 0.3 s": [0.3, 1e-9] * 50,
    }
    times, t = [], 0.0
    for size in patterns[name]:
        t = t + size
        times.append(t if name == "one of 10 s" else min(t, end))
        if t >= end:
            break
    return times


PATTERNS = (
    "1000 of 1e-9 s, then one", "1000 of 1e-7 s, then one", "of 1e-3 s", "of 0.0371 s",
    "of pi/7 s", "one", "one of 10 s", "irregular, 1e-9 to 1 s", "1e-9 s between steps of 0.3 s",
)  # fmt: skip


def run_steps(shop, score, quick):
    """Item 6: patterns of steps over contact and release, from several start times."""
    fmu = shop.shipped("absorber_1d")
    for start in (0.0, 1e9) if quick else (0.0, -5.0, 1e6, 1e9, 1e12):
        for name in PATTERNS:
            times = find_times(name, 5.0)

            def find_error(times=times, start=start):
                rows = move(fmu, times, names=AXIAL, start_time=start)
                lost = 2 * len(times) * np.spacing(abs(start))  # the host's clock
                exact = np.array([find_absorber(t) for t in (times[0], times[-1])])
                error = np.abs(rows[[1, -1]] - exact) - 0.1 * lost
                return max(0.0, np.max(error)) / 0.1

            score.right_or_refused(f"steps {name}, start at {start:.0e} s", find_error)


def run_bad_steps(shop, score, _quick):
    """Item 6: sizes and times that mean nothing; the next step has the bits of the plain run."""
    fmu = shop.shipped("absorber_1d")
    with Host(fmu) as host, Host(fmu) as alone:
        for each in (host, alone):
            each.start()
            each.step(EXACT)
        trials = {
            "no size": (EXACT, 0.0), "backwards": (EXACT, -0.1), "size NaN": (EXACT, math.nan),
            "size infinite": (EXACT, math.inf), "size 1e100 s": (EXACT, 1e100),
            "size denormal": (EXACT, 5e-324), "time NaN": (math.nan, EXACT),
            "time of another step": (1.0, EXACT), "time infinite": (math.inf, EXACT),
        }  # fmt: skip
        for name, (time, size) in trials.items():
            t = host.time if time == EXACT else time
            saved = host.save()
            before = host.everything()
            status = host.status("fmi2DoStep", t, size, 1)
            if status == OK:
                reals = read_reals(host)
                score.check(np.isfinite(reals).all(), name, "accepted with figures that are not")
                host.restore(saved)
            else:
                score.refuse(host.last_line, name)
                score.check(host.everything() == before, name, "has changed the state")
            host.release(saved)
            host.step(EXACT)
            alone.step(EXACT)
            score.check(host.everything() == alone.everything(), name, "the next step differs")


def run_endless_steps(shop, score, _quick):
    """Item 6: steps so long that squares of their size overflow: finite figures or a refusal."""
    scenes = {"absorber": shop.shipped("absorber_1d"), "vehicle": shop.own(None, VEHICLE)}
    for name, fmu in scenes.items():
        for size in (1e10, 1e100, 1e150, 1e200, 1e300):
            with Host(fmu) as host:
                host.start()
                host.step(EXACT)
                where = f"{name}, {size:.0e} s"
                if host.step_status(size) != OK:
                    score.refuse(host.last_line, where)
                else:
                    strange = np.sum(~np.isfinite(read_reals(host)))
                    text = f"accepted, {strange} figures are not finite"
                    score.check(strange == 0, where, text)


# ------------------------------------------------------------------------------------------------
# 7. Impossible inputs.
def read_reals(host):
    """All Real variables."""
    return np.array(host.slave.getReal(host._of_type["Real"]))


IMPOSSIBLE = {
    "NaN": math.nan, "infinite": math.inf, "-infinite": -math.inf, "1e300": 1e300,
    "-1e300": -1e300,
}  # fmt: skip


def run_inputs(shop, score, quick):
    """Item 7: every input of a docking in contact, also together with one that is possible."""
    for driven in ("target",) if quick else ("target", "chaser"):
        free = "chaser" if driven == "target" else "target"
        fmu = shop.shipped("idss_25t_350t", NEAR, f"{driven}.motion=driven")
        with Host(fmu) as host, Host(fmu) as alone:
            for each in (host, alone):
                each.start()
                pose = Drive(each, driven)
                for _ in range(20):
                    pose.report(each)
                    each.step()
            names = [
                f"{free}.force_ext[1]", f"{free}.torque_ext[2]", "gravity[3]",
                f"{driven}.position[2]", f"{driven}.velocity[1]", f"{driven}.attitude[1]",
                f"{driven}.angular_velocity[3]", f"{driven}.force_ext[1]",
            ]  # fmt: skip
            for name in names:
                for word, value in IMPOSSIBLE.items():
                    try_input(score, (host, alone), pose, {name: value}, f"{name} {word}")
                try_input(
                    score, (host, alone), pose, {name: math.nan, f"{free}.force_ext[2]": 5.0},
                    f"{name} NaN next to a possible force",
                )  # fmt: skip
            for word, q in BAD_QUATERNIONS.items():
                values = {f"{driven}.attitude[{i}]": x for i, x in enumerate(q, 1)}
                try_input(score, (host, alone), pose, values, f"quaternion {word}")
            score.check(host.phase() == 2, "phase", "the trials were not made in contact")


BAD_QUATERNIONS = {
    "zero": (0.0, 0.0, 0.0, 0.0), "denormal": (5e-324, 0.0, 0.0, 0.0),
    "of length 0.5": (0.5, 0.0, 0.0, 0.0), "of length 2": (2.0, 0.0, 0.0, 0.0),
    "of length 1e200": (1e200, 0.0, 0.0, 0.0), "of length 1.01": (1.01, 0.0, 0.0, 0.0),
}  # fmt: skip


class Drive:
    """Imposes straight motion on one vehicle."""

    def __init__(self, host, name):
        self.name = name
        self.position, self.velocity = (
            host.vector(f"{name}.{x}") for x in ("position", "velocity")
        )
        self.attitude = host.vector(f"{name}.attitude", 4)

    def report(self, host, sign=1.0, length=1.0):
        """Set the pose at the beginning of the coming step."""
        host.put(f"{self.name}.position", self.position + host.time * self.velocity)
        host.put(f"{self.name}.velocity", self.velocity)
        host.put(f"{self.name}.attitude", sign * length * self.attitude)
        host.put(f"{self.name}.angular_velocity", (0.0, 0.0, 0.0))


def try_input(score, hosts, pose, values, where):
    """One trial: refused by the set or by the step, without a trace; then a step of both hosts."""
    host, alone = hosts
    pose.report(host)
    saved = host.save()
    before = host.everything()
    valid = host.get(*values)
    if host.set_status(values) != OK:
        score.refuse(host.last_line, where)
        score.check(host.everything() == before, where, "a refused set has changed something")
    elif host.step_status() != OK:
        score.refuse(host.last_line, where)
        host.set_status(dict(zip(values, valid, strict=True)))
        score.check(host.everything() == before, where, "a refused step has changed something")
    else:
        score.bad.append(f"{where}: accepted")
        host.restore(saved)
    host.release(saved)
    pose.report(alone)
    for each in hosts:
        each.step()
    score.check(host.everything() == alone.everything(), where, "the next step differs")


def run_harmless_inputs(shop, score, quick):
    """Item 7: denormal loads, quaternions of the other sign and of almost unit length."""
    fmu = shop.shipped("idss_25t_350t", NEAR, "target.motion=driven")
    watched = [f"relative.position[{i}]" for i in (1, 2, 3)]
    cases = {
        "sign flipped at every step": lambda host, pose, i: pose.report(host, (-1.0) ** i),
        "sign flipped once": lambda host, pose, i: pose.report(host, -1.0 if i > 15 else 1.0),
        "length 1 + 1e-6": lambda host, pose, i: pose.report(host, 1.0, 1.0 + 1e-6),
        "denormal force": lambda host, pose, _: (
            pose.report(host), host.put("chaser.force_ext", (5e-324, -5e-324, 1e-310))
        ),
        "denormal gravity": lambda host, pose, _: (
            pose.report(host), host.put("gravity", (5e-324, -5e-324, 1e-310))
        ),
    }  # fmt: skip

    def run(report):
        with Host(fmu) as host:
            host.start()
            pose = Drive(host, "target")
            for i in range(25 if quick else 50):
                report(host, pose, i)
                host.step()
            return host.get(*watched)

    plain = run(lambda host, pose, _: pose.report(host))
    for where, report in cases.items():
        score.compare(np.max(np.abs(run(report) - plain)), where)


def run_start_values(shop, score, _quick):
    """Item 7: start values that no docking can have; then it starts as if nothing had been."""
    fmu = shop.shipped("idss_25t_350t", NEAR)
    with Host(fmu) as alone:
        alone.start()
        alone.step()
        wanted = alone.everything()
    names = (
        "chaser.mass", "chaser.inertia[1]", "target.position[1]", "chaser.attitude[1]",
        "target.angular_velocity[2]", "solver.rtol", "solver.atol_position", "friction.coefficient",
        "restitution",
    )  # fmt: skip
    for name in names:
        trials = {"NaN": math.nan, "infinite": math.inf, "1e300": 1e300}
        if name.split(".")[-1] not in ("position[1]", "angular_velocity[2]"):
            trials |= {"-1": -1.0}
        if name not in ("friction.coefficient", "target.position[1]", "target.angular_velocity[2]"):
            trials |= {"0": 0.0}
        for word, value in trials.items():
            with Host(fmu) as host:
                valid = host.value(name)
                where = f"{name} {word}"
                accepted = host.set_status({name: value}) == OK
                if accepted and host.status("fmi2ExitInitializationMode") == OK:
                    score.bad.append(f"{where}: accepted")
                    continue
                score.refuse(host.last_line, where)
                score.check(host.set_status({name: valid}) == OK, where, "cannot be corrected")
                host.start()
                host.step()
                score.check(host.everything() == wanted, where, "the corrected run differs")


# ------------------------------------------------------------------------------------------------
# 8. Contact at its edges.
def run_contact_points(shop, score, quick):
    """Item 8: first contact exactly at a communication point, at the start, next to them."""
    for name, delay in {
        "at the start": 0.0, "at a communication point": 64 * EXACT,
        "a spacing of numbers before one": math.nextafter(64 * EXACT, 0.0),
        "a spacing of numbers behind one": math.nextafter(64 * EXACT, 1.0),
        "between two": 64.5 * EXACT,
    }.items():  # fmt: skip
        fmu = shop.shipped("absorber_1d", f"initial.approach_time={delay!r}")
        for size in (EXACT, 64 * EXACT) if quick else (EXACT / 8, EXACT, 8 * EXACT, 64 * EXACT):

            def find_error(fmu=fmu, size=size, delay=delay):
                times = size * np.arange(1, round(4.0 / size) + 1)
                row = move(fmu, times, names=[*AXIAL, "time_of_contact"])[-1]
                wanted = [*find_absorber(times[-1] - delay), delay]
                return np.max(np.abs(row - wanted)) / 0.1

            score.right_or_refused(f"{name}, steps of {size:g} s", find_error)


def run_wall(shop, start, rate, span, *, stiffness=0.0, rest=0.0, preload=0.0, wall=1e7):
    """Ring on a slide in front of a wall, everything else fixed: error of its path, and its scale.

    Args:
        shop: workshop.
        start: coordinate of the ring, above 0 inside the wall [m].
        rate: its speed [m/s].
        span: duration [s].
        stiffness: of a spring that holds the ring [N/m], at `rest` [m].
        rest: see there.
        preload: force that presses the ring to the wall [N].
        wall: stiffness of the wall [N/m].
    """
    mechanism = bumper(stiffness, 0.0, wall, preload, rest=rest, home=start)
    joint = f"[initial.joints.ring]\nrate = {rate!r}"
    fmu = shop.own(mechanism, SLIDER, joint, BUMPER_OUTPUTS, rtol=1e-11)
    times = span * np.arange(1, 9) / 8
    names = ["state.q[1]", "energy.residual", "energy.kinetic", "energy.potential"]
    rows = move(fmu, times, names=names)
    model = Bumper((None, 20.0), (stiffness, 0.0), (wall, TOE, 5.0), preload)
    states = model.run((rest, start, 0.0, rate), span, 8)
    scale = max(TOE, np.max(np.abs(states[:, 1] - states[0, 1])))
    energy = np.max(np.abs(rows[:, 1])) / max(1e-9, np.max(np.abs(rows[:, 2:])))
    return max(np.max(np.abs(rows[:, 0] - states[:, 1])) / scale, energy)


def run_grazing(shop, score, quick):
    """Item 8: a swing that ends at the wall, so deep in it or just in front of it.

    A touch that begins and ends within one inner step is not seen. At this tolerance that is one
    of up to 1e-7 m; what it would have done is the error that the limit of this part allows.
    """
    away, span = 0.01, 0.5 if quick else 1.0
    for power in (3, 6, 12) if quick else range(3, 16):
        for side in (1, -1):
            depth = side * 10.0**-power * away
            score.right_or_refused(
                f"depth {depth:.0e} m",
                lambda depth=depth: run_wall(
                    shop, -2 * away - depth, 0.0, span, stiffness=2000.0, rest=-away
                ),
            )


def run_chatter(shop, score, quick):
    """Item 8: a ring pressed to the wall bounces lower and lower until it rests in it."""
    drop, falls = 1e-3, 40 if quick else 200
    for load in (20.0, 2000.0) if quick else (2.0, 20.0, 200.0, 2000.0):
        span = falls * math.sqrt(2 * drop * 20.0 / load)
        score.right_or_refused(
            f"{load:g} N, {falls} times the fall",
            lambda load=load, span=span: run_wall(shop, -1e-3, 0.0, span, preload=load),
        )


def run_penetration(shop, score, quick):
    """Item 8: a start inside the wall, from the last digit to behind the surfaces."""
    for depth in (1e-15, 1e-9, 1e-4, 5e-3) if quick else [10.0**-k for k in range(15, 2, -1)]:
        score.right_or_refused(
            f"depth {depth:.0e} m", lambda depth=depth: run_wall(shop, depth, 0.0, 0.02)
        )
    score.must_be_refused("cores 0.1 mm apart", lambda: run_wall(shop, 0.0199, 0.0, 0.02))


def run_passed(shop, score, _quick):
    """Item 8: a start at which the surfaces have gone through each other."""
    for depth in (0.021, 0.03, 0.1):
        score.must_be_refused(
            f"cores passed by {1e3 * depth - 20:g} mm",
            lambda depth=depth: run_wall(shop, depth, 0.0, 0.02),
        )


# ------------------------------------------------------------------------------------------------
# 9. Saved states.
def step_on(host, steps):
    """Fingerprints of all variables after each of some steps."""
    seen = []
    for _ in range(steps):
        host.step()
        seen.append(host.everything())
    return seen


def run_saved(shop, score, quick):
    """Item 9: save in contact, go on, restore: here, in another process, next to other threads."""
    for friction in (1,) if quick else (1, 2):
        fmu = shop.shipped("idss_25t_350t", NEAR, f"contact.friction_model={friction}")
        steps, law = (40 if quick else 100), f"friction model {friction}"
        with Host(fmu) as host:
            host.start()
            step_on(host, 30)
            score.check(host.phase() == 2, law, "not in contact")
            saved, data, time = host.save(), host.save_bytes(), host.time
            wanted = step_on(host, steps)
            for _ in range(3):
                host.restore(saved)
                seen = step_on(host, steps)
                score.compare(count_differences(seen, wanted), f"{law}, restored")
            host.release(saved)
        seen = go_on_elsewhere(fmu, data, time, steps, fmu)
        score.compare(count_differences(seen, wanted), f"{law}, another process")
        run_threads(score, fmu, (data, time), wanted, law)


def run_threads(score, fmu, start, wanted, law):
    """Instances side by side in one process, stepped in turn and each in a thread of its own."""
    steps = len(wanted)
    with Host(fmu) as one, Host(fmu) as two:
        for host in (one, two):
            host.restore_bytes(*start)
        two.put("chaser.force_ext", (50.0, 0.0, 0.0))
        seen = []
        for _ in range(steps):
            two.step()
            seen += step_on(one, 1)
        score.compare(count_differences(seen, wanted), f"{law}, two in turn")
    hosts = [Host(fmu) for _ in range(4)]
    results = [None] * len(hosts)

    def work(i):
        hosts[i].restore_bytes(*start)
        if i % 2:
            hosts[i].put("chaser.force_ext", (50.0 * i, 0.0, 0.0))
        results[i] = step_on(hosts[i], steps)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(len(hosts))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for host in hosts:
        host.free()
    for i in (0, 2):
        score.compare(count_differences(results[i], wanted), f"{law}, thread {i + 1} of 4")
    score.check(results[1] != wanted, law, "a pushed instance must move otherwise")


def count_differences(seen, wanted):
    """How many fingerprints differ."""
    if seen is None or len(seen) != len(wanted):
        return math.inf
    return sum(a != b for a, b in zip(seen, wanted, strict=True))


# ------------------------------------------------------------------------------------------------
# 11. Tolerance ladder.
def tolerances(rtol):
    """Settings of a relative tolerance, absolute ones ten times tighter."""
    atol = rtol / 10
    return {"solver.rtol": rtol, "solver.atol_position": atol, "solver.atol_velocity": atol}


COST = "solver.rhs_evaluations"


def list_ladders(shop, quick):
    """Problems of the ladder: name, FMU, end, outputs, settings, error of the outputs, floor."""
    andrews = shop.own(benchmarks.andrews(), FIXED_BASE, OUTPUTS)
    yield (
        "squeezing mechanism, crank angle", andrews, 0.03, ["state.q[1]"], {},
        lambda row: abs(row[0] - 15.810771195153707), 1e-10,
    )  # fmt: skip
    yield (
        "absorber, speed in contact", shop.shipped("absorber_1d"), 2.0, ["relative.velocity[1]"],
        {}, lambda row: abs(row[0] - find_absorber(2.0)[1]) / 0.1, 1e-11,
    )  # fmt: skip
    if quick:
        return
    yield (
        "overconstrained 6R, hinge", shop.own(benchmarks.bricard(1), FIXED_BASE, OUTPUTS),
        BRICARD_TIME, RING, DOWN_Y, lambda row: np.max(np.abs(row[:3] - BRICARD_HINGE)), 1e-11,
    )  # fmt: skip
    wanted = find_hexapod(2.0)
    yield (
        "free-floating hexapod, ring", build_hexapod(shop), 2.0, RING, {},
        lambda row: np.max(np.abs(row[:3] - wanted[3:])), 1e-10,
    )  # fmt: skip


def run_ladder(shop, score, quick):
    """Item 11: slope of log error against log tolerance above the floor."""
    steps = range(4, 13, 1)
    for name, fmu, end, names, settings, find_error, floor in list_ladders(shop, quick):
        ladder = []
        for power in steps:
            rtol = 10.0**-power
            row = move(fmu, [end], settings=settings | tolerances(rtol), names=[*names, COST])[-1]
            ladder.append((rtol, float(find_error(row)), int(row[-1])))
        score.notes[name] = [f"{r:.0e}: {e:.1e}, {n} rates" for r, e, n in ladder]
        above = [(r, e) for r, e, _ in ladder if e > floor]
        score.check(len(above) >= 4, name, "fewer than four tolerances above the floor")
        score.check(ladder[-1][1] <= floor, name, f"floor {floor:.0e} missed: {ladder[-1][1]:.1e}")
        slope = np.polyfit(*np.log10(np.array(above)).T, 1)[0]
        score.compare(abs(slope - 1.0), f"{name}, slope {slope:.2f}")


PARTS = [
    Part(5, "2e4 turns through singular poses, tolerance 1e-9 [200]", "energy of the exact motion",
         "of the largest", 1e-8, run_turning),
    Part(5, "2e4 oscillations of the free hexapod, undamped, tolerance 1e-9 [200]",
         "constant energy, momentum, length", "relative", 3e-8, run_swinging),  # 30 tolerances
    Part(5, "1e6 steps of constant size [5e4]", "straight motion", "relative", 1e-9,
         run_many_steps),
    Part(6, "steps of 1e-9 to 10 s, irregular, tiny between large; starts -5 to 1e12 s [0, 1e9 s]",
         "closed form of the absorber", "of the speed", 1e-7, run_steps),
    Part(6, "sizes and times that mean nothing", "the bits of the undisturbed run", "", math.inf,
         run_bad_steps),
    Part(6, "one step of 1e10 to 1e300 s", "finite figures", "", math.inf, run_endless_steps),
    Part(7, "NaN, infinite, 1e300 in every kind of input; six quaternions",
         "refused; the bits of the undisturbed run", "", math.inf, run_inputs),
    Part(7, "quaternions of the other sign, almost unit; denormal loads", "the undisturbed run",
         "m", 1e-9, run_harmless_inputs),
    Part(7, "NaN, infinite, 1e300, 0, -1 as start values",
         "refused; corrected: the bits of the undisturbed run", "", math.inf, run_start_values),
    Part(8, "contact at the start, at, next to and between communication points",
         "closed form of the absorber", "of the speed", 1e-7, run_contact_points),
    Part(8, "swing that ends 1e-5 to 1e-17 m in or before the wall (48 contacts at once)",
         "one mass and a wall, Runge-Kutta steps", "of the way", 1e-5, run_grazing),
    Part(8, "bouncing to rest under 2 to 2000 N [20, 2000 N]",
         "one mass and a wall, Runge-Kutta steps", "of the way", 1e-5, run_chatter),
    Part(8, "start 1e-15 to 1e-3 m inside the wall; cores as good as touching",
         "one mass and a wall; too deep: a refusal", "of the way", 1e-5, run_penetration),
    Part(8, "start with the surfaces gone through each other", "a refusal", "", math.inf,
         run_passed),
    Part(9, "restored in contact: here, in another process, next to others, in threads",
         "the bits of the uninterrupted run", "steps that differ", 0, run_saved),
    Part(11, "tolerance 1e-4 to 1e-12", "quadrature, closed form, Kane's equations",
         "of slope 1", 0.3, run_ladder),
]  # fmt: skip
