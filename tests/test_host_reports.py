"""Mistakes of hosts that integrate a vehicle by themselves: each is named, once and alone.

A small host integrates the chaser of the default docking in a parallel exchange and makes one
mistake at a time. N is turned, so that body axes are not those of N. The diagnosis is compared with
the mistake that was made: the host is the oracle. Hosts without a mistake get no word.
"""

import numpy as np
import pytest

import dockloop as dl
from coupling_host import cross, turn
from dockloop.native.core import name_choice
from vehicles import ARRAYS, HUB, SLOSH, TANK, FlexibleHost, components

MASS, INERTIA, ARM = 25e3, np.array([60.5e3, 132e3, 132e3]), np.array([3.72, 0.0, 0.0])
MOTION = ("position", "velocity", "attitude", "angular_velocity")
TURNED = np.array([0.8, 0.2, -0.4, 0.4])  # attitude of the frame of the scene in N
X_HALF = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about x


def multiply(a, b):
    """Product of two quaternions."""
    return np.array(
        [a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + cross(a[1:], b[1:]))]
    )


def inverse(q):
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def late(count):
    """A function of loads that returns those of `count` steps earlier."""
    queue = [(np.zeros(3), np.zeros(3))] * count
    return lambda f, t, q: (queue.append((f, t)), queue.pop(0))[1]


def mixed(share):
    """A function of loads that act late by a share of a step."""
    before = [np.zeros(3), np.zeros(3)]

    def act(f, t, q):
        mean = [(1 - share) * new + share * old for new, old in zip((f, t), before, strict=True)]
        before[:] = f, t
        return mean

    return act


def held(count):
    """A function of reports that returns a new motion in every `count`-th step only."""
    reports = []
    return lambda *z: (reports.append(z), reports[(len(reports) - 1) // count * count])[1]


def old(count):
    """A function of reports that returns the report of `count` steps earlier."""
    queue = []
    return lambda *z: (queue.append(z), queue[max(0, len(queue) - 1 - count)])[1]


def dock(
    step,
    report=None,
    loads=None,
    *,
    stop=2.5,
    settings=None,
    overrides=None,
    attitude=TURNED,
    detours=False,
    goes_on=False,
    scene="idss_25t_350t",
    orbit=None,
    starts=False,
):
    """Couple a host with a docking, until it is diagnosed unless it goes on; return the docking.

    The first report is a start value, unless the docking starts before it.
    """
    driven = {"chaser.motion": "driven", "initial.approach_time": 0.5, "coupling.mode": "parallel"}
    docking = dl.Docking(scene, driven | (overrides or {}))
    mass, inertia = docking.get("chaser.mass"), np.array(docking.get("chaser.inertia"))[:3]
    for body in ("chaser", "target"):
        for name, f in (("position", turn), ("velocity", turn), ("attitude", multiply)):
            variable = f"{body}.{name}"
            docking.set(variable, f(attitude, np.array(docking.get(variable))))
        for name, by in zip(("position", "velocity"), orbit or (), strict=False):
            docking.set(f"{body}.{name}", np.array(docking.get(f"{body}.{name}")) + by)
    gravity = np.zeros(3) if orbit is None else orbit[2]
    docking.set("gravity", gravity)
    for name, value in {"coupling.expected_step": step, **(settings or {})}.items():
        docking.set(name, value)
    p, v, q, w = (np.array(docking.get(f"chaser.{name}")) for name in MOTION)
    if starts:
        docking.record([docking.time])
    for _ in range(round(stop / step)):
        f, t = (np.array(docking.get(f"chaser.{name}_mean")) for name in ("force", "torque"))
        for name, value in zip(MOTION, report(p, v, q, w) if report else (p, v, q, w), strict=True):
            docking.set(f"chaser.{name}", value)
        if detours:
            saved = docking.save()
            docking.step(2 * step)
            docking.restore(saved)
        docking.step(step)
        if not goes_on and docking.get("coupling.diagnosis") != 1:
            break
        f, t = loads(f, t, q) if loads else (f, t)
        h = step / 10
        for _ in range(10):  # the midpoint rule
            v0, v = v, v + h * (f / mass + gravity)
            p = p + h * (v0 + v) / 2
            middle = w + h / 2 * (t - cross(w, inertia * w)) / inertia
            w = w + h * (t - cross(middle, inertia * middle)) / inertia
            q = q + h / 2 * multiply(q, np.array([0.0, *middle]))
            q /= np.linalg.norm(q)
    return docking


REPORTS = {
    "quaternion order": lambda p, v, q, w: (p, v, np.roll(q, -1), w),
    "quaternion inverse": lambda p, v, q, w: (p, v, inverse(q), w),
    "quaternion order and inverse": lambda p, v, q, w: (p, v, np.roll(inverse(q), -1), w),
    "attitude constant": lambda p, v, q, w: (p, v, TURNED, w),
    "angular velocity in degrees": lambda p, v, q, w: (p, v, q, np.degrees(w)),
    "angular velocity in N": lambda p, v, q, w: (p, v, q, turn(q, w)),
    "angular velocity sign": lambda p, v, q, w: (p, v, q, -w),
    "angular velocity missing": lambda p, v, q, w: (p, v, q, 0 * w),
    "position unit": lambda p, v, q, w: (1000 * p, v, q, w),
    "interface point": lambda p, v, q, w: (p + turn(q, ARM), v, q, w),
    "other point": lambda p, v, q, w: (p + turn(q, np.array([-0.2, 0.05, 0.02])), v, q, w),
    "velocity in body axes": lambda p, v, q, w: (p, turn(inverse(q), v), q, w),
    "velocity turned": lambda p, v, q, w: (p, turn(q, v), q, w),
    "velocity missing": lambda p, v, q, w: (p, 0 * v, q, w),
}
LOADS = {
    "force in body axes": lambda f, t, q: (turn(q, f), t),
    "force turned": lambda f, t, q: (turn(inverse(q), f), t),
    "force sign": lambda f, t, q: (-f, t),
    "force missing": lambda f, t, q: (0 * f, t),
    "force unit": lambda f, t, q: (f / 1000, t),
    "torque in N": lambda f, t, q: (f, turn(inverse(q), t)),
    "torque turned": lambda f, t, q: (f, turn(q, t)),
    "torque sign": lambda f, t, q: (f, -t),
    "torque missing": lambda f, t, q: (f, 0 * t),
    "torque unit": lambda f, t, q: (f, t / 1000),
    "torque point": lambda f, t, q: (f, t + cross(ARM, turn(inverse(q), f))),
    "unreported force": lambda f, t, q: (f + turn(q, np.array([20.0, 0, 0])), t),
    "unreported torque": lambda f, t, q: (f, t + np.array([0, 40.0, 0])),
    "force axes": lambda f, t, q: (f * [1, -1, -1], t),
    "torque axes": lambda f, t, q: (f, np.roll(t, 1)),
}
STARTS = {  # mistakes of the first report, and words of the sentence
    "velocity unit": (lambda p, v, q, w: (p, 1000 * v, q, w), "0.001 m/s"),
    "first velocity": (lambda p, v, q, w: (p, 0 * v, q, w), "from the start velocity by"),
    "position unit": (lambda p, v, q, w: (1000 * p, 1000 * v, q, w), "0.001 m"),
    "position axes": (lambda p, v, q, w: (np.roll(p, 1), np.roll(v, 1), q, w), "exchanged"),
    "first position": (lambda p, v, q, w: (p + np.array([0.3, 0, 0]), v, q, w), "0.3 m away"),
    "quaternion order": (REPORTS["quaternion order"], "order x, y, z, w:"),
    "quaternion inverse": (REPORTS["quaternion inverse"], "attitude is the attitude of N in"),
    "quaternion order and inverse": (REPORTS["quaternion order and inverse"], ", and is the"),
    "first attitude": (lambda p, v, q, w: (p, v, multiply(q, X_HALF), w), "3.14 rad"),
}
ATTITUDES = {
    "turned": TURNED,
    "as N": np.array([1.0, 0, 0, 0]),
    "half": np.array([1, -7, 1, 7]) / 10,
}
FROZEN: dict = {}  # the report of a host that connects nothing
STATED = {
    "mass": {"chaser.mass": 0.5 * MASS},
    "inertia": {"chaser.inertia": [*(0.5 * INERTIA), 0, 0, 0]},
}


def assert_named(docking, name):
    """One diagnosis, and one warning that is about it."""
    found = name_choice("coupling.diagnosis", docking.get("coupling.diagnosis"))
    warnings = [text for text in docking.warnings if text.startswith("chaser")]
    assert found == name, (found, warnings)
    assert len(warnings) == 1, warnings


@pytest.mark.parametrize("name", REPORTS)
def test_a_wrong_report_is_named(name):
    assert_named(dock(0.01, report=REPORTS[name]), name)


@pytest.mark.parametrize("step", [0.01, 0.1])
@pytest.mark.parametrize(
    ("name", "report"),
    [
        ("attitude", lambda p, v, q, w: (p, v, q, 30.0 / np.pi * w)),  # rpm are no degrees
        ("attitude", lambda p, v, q, w: (p, v, q, w + np.array([0.01, 0.0, 0.0]))),
        ("attitude", lambda p, v, q, w: (p, v, q, 1.05 * w)),  # no inertia
        ("attitude", lambda p, v, q, w: (p, v, q, w[[0, 2, 1]])),
        ("position", lambda p, v, q, w: (p, 1.02 * v, q, w)),  # no unit
        ("position constant", lambda p, v, q, w: FROZEN.setdefault("report", (p, v, q, w))),
    ],
    ids=["rpm", "bias", "scale", "exchanged", "faster", "frozen"],
)
@pytest.mark.parametrize("attitude", [TURNED, [1, 0, 0, 0], [0, 0.6, 0, 0.8]])
def test_what_resembles_another_mistake_is_not_called_so(name, report, step, attitude):
    FROZEN.clear()
    assert_named(dock(step, report=report, attitude=np.array(attitude, dtype=float)), name)


@pytest.mark.parametrize("step", [0.01, 0.1])
@pytest.mark.parametrize("name", LOADS)
def test_a_wrong_load_is_named(name, step):
    assert_named(dock(step, loads=LOADS[name], stop=4.0), name)


@pytest.mark.parametrize("step", [0.01, 0.1])
def test_a_load_that_no_single_mistake_explains_is_named_so(step):
    along_x = dock(step, loads=lambda f, t, q: (f * [1, 0, 0], t), stop=4.0)
    assert_named(along_x, "unexplained")


@pytest.mark.parametrize("step", [0.01, 0.1])
def test_a_torque_about_one_axis_only_is_no_inertia(step):
    about_x = dock(step, loads=lambda f, t, q: (f, t * [1, 0, 0]), stop=4.0)
    assert_named(about_x, "torque missing")


@pytest.mark.parametrize("attitude", ATTITUDES)
@pytest.mark.parametrize("name", STARTS)
def test_a_first_report_that_is_not_the_start_is_named(name, attitude):
    """Where surfaces would overlap there, the refusal says so."""
    report, words = STARTS[name]
    try:
        docking = dock(0.01, report=report, attitude=ATTITUDES[attitude], starts=True)
    except dl.DockloopError as error:
        sentence = str(error).split("a cause may be that ")[1]
    else:
        assert_named(docking, name)
        sentence = docking.warnings[0]
    assert words in sentence


@pytest.mark.long
@pytest.mark.parametrize("attitude", ["as N", "half"])
@pytest.mark.parametrize("step", [0.01, 0.1])
def test_mistakes_are_named_in_other_attitudes(attitude, step):
    options = {"stop": 4.0, "attitude": ATTITUDES[attitude]}
    wrong = [(name, {"report": report}) for name, report in REPORTS.items()]
    wrong += [(name, {"loads": load}) for name, load in LOADS.items()]
    for name, mistake in wrong:
        if (name, attitude) == ("quaternion inverse", "as N"):
            continue  # a start state that is refused
        assert_named(dock(step, **mistake, **options), name)


@pytest.mark.parametrize("step", [0.01, 0.1])
@pytest.mark.parametrize("name", STATED)
def test_a_wrong_mass_and_a_wrong_inertia_are_named(name, step):
    docking = dock(step, settings=STATED[name], stop=4.0)
    assert_named(docking, name)
    assert docking.get("coupling.diagnosis_value") == pytest.approx(1.0, rel=0.02)


def dock_flexible(vehicle, step, scene="idss_25t_350t", settings=None):
    """Couple a host with parts; it states `settings`, and then the loads of its parts, too."""
    docking = dl.Docking(
        scene,
        {"chaser.motion": "driven", "initial.approach_time": 0.1, "coupling.mode": "parallel"},
    )
    for name, value in {"coupling.expected_step": step, **(settings or {})}.items():
        docking.set(name, value)
    host = FlexibleHost([docking.get(f"chaser.{name}") for name in MOTION], *vehicle)
    for _ in range(round(3.0 / step)):
        f, t = (docking.get(f"chaser.{name}_mean") for name in ("force", "torque"))
        motion, own = host.motion(), host.advance(f, t, step)
        for name, value in zip(MOTION, motion, strict=True):
            docking.set(f"chaser.{name}", value)
        for name, value in zip(("force_ext", "torque_ext"), own, strict=True):
            docking.set(f"chaser.{name}", value if settings else [0.0, 0.0, 0.0])
        docking.step(step)
        if docking.get("coupling.diagnosis") != 1:
            break
    return docking


@pytest.mark.parametrize("step", [0.01, 0.1])
@pytest.mark.parametrize(
    ("vehicle", "lowest", "highest"),  # Hz, of the free vehicle: those of the hub, and its share
    [
        ((*TANK, [SLOSH]), 0.3 / np.sqrt(1.0 - 0.1), 0.3 / np.sqrt(1.0 - 0.1)),
        ((*HUB, ARRAYS), 0.3 / np.sqrt(1.0 - 12.4 / 60.5), 0.45 / np.sqrt(1.0 - 12.4 / 132.0)),
    ],
    ids=["slosh", "arrays"],
)
def test_arrays_and_slosh_are_a_flexible_part_not_another_inertia(vehicle, lowest, highest, step):
    docking = dock_flexible(vehicle, step)
    assert_named(docking, "flexible part")
    assert 0.97 * lowest < docking.get("coupling.diagnosis_value") < 1.03 * highest


@pytest.mark.parametrize("step", [0.04, 0.06, 0.1])
@pytest.mark.parametrize("scene", ["idss_25t_350t", "apda", "probe_drogue"])
def test_a_host_that_reports_the_mean_loads_of_its_arrays_gets_no_word(scene, step):
    hub = {"chaser.mass": HUB[0], "chaser.inertia": components(HUB[1])}
    docking = dock_flexible((*HUB, ARRAYS), step, scene, hub)
    assert name_choice("coupling.diagnosis", docking.get("coupling.diagnosis")) == "none"


def test_an_inertia_in_another_unit_is_named():
    docking = dock(0.01, settings={"chaser.inertia": [*(1e6 * INERTIA), 0, 0, 0]})
    assert_named(docking, "inertia")
    assert docking.get("coupling.diagnosis_value") == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize("stated", [25.0, 25e6])
def test_a_mass_in_another_unit_is_not_taken_for_a_force(stated):
    docking = dock(0.01, settings={"chaser.mass": stated})
    assert_named(docking, "mass")
    assert "25000 kg, but" in docking.warnings[0], docking.warnings


@pytest.mark.parametrize("scene", ["idss_25t_350t", "apda", "probe_drogue"])
@pytest.mark.parametrize(("step", "share"), [(0.01, 0.25), (0.02, 0.5), (0.1, 0.25), (0.1, 0.75)])
def test_a_delay_of_a_part_of_a_step_is_named_with_its_length(scene, step, share):
    docking = dock(step, stop=4.0, loads=mixed(share), scene=scene)
    assert_named(docking, "delay")
    assert docking.get("coupling.diagnosis_value") == pytest.approx(share * step)


@pytest.mark.parametrize("count", [2, 5])
def test_a_host_with_longer_steps_is_named(count):
    docking = dock(0.01, report=held(count))
    assert_named(docking, "motion held")
    assert docking.get("coupling.diagnosis_value") == pytest.approx(0.01 * count)


@pytest.mark.parametrize("make", [late, old], ids=["loads", "motion"])
@pytest.mark.parametrize(
    ("step", "count"), [(0.001, 5), (0.001, 20), (0.01, 1), (0.01, 3), (0.1, 2)]
)
def test_a_delay_is_named_with_its_length(make, step, count):
    docking = dock(step, stop=4.0, **{"loads" if make is late else "report": make(count)})
    assert_named(docking, "delay")
    assert docking.get("coupling.diagnosis_value") == pytest.approx(count * step)


def dock_without_a_mistake(seed):
    """A random scene, attitude, orbit and step; returns all words about the host."""
    random = np.random.default_rng(seed)
    attitude = random.normal(size=4)
    speed = random.normal(size=3)
    orbit = (6.8e6 * random.normal(size=3), 7.6e3 * speed / np.linalg.norm(speed), None)
    orbit = (*orbit[:2], -8.6 * orbit[0] / np.linalg.norm(orbit[0]))
    overrides = {
        "initial.closing_speed": random.uniform(0.03, 0.15),
        "initial.lateral_offset": random.uniform(0.0, 0.08),
        "initial.pitch_yaw_deg": random.uniform(0.0, 3.0),
        "initial.pitch_yaw_rate_deg_s": random.uniform(0.0, 0.15),
        "initial.approach_time": 0.2,
    }
    docking = dock(
        float(random.choice([0.008, 0.01, 0.02, 0.05, 0.1])),
        stop=1.6,
        overrides=overrides,
        attitude=attitude / np.linalg.norm(attitude),
        scene=str(random.choice(["idss_25t_350t", "apda", "probe_drogue"])),
        orbit=orbit if random.uniform() < 0.5 else None,
    )
    words = [text for text in docking.warnings if not text.startswith("limit")]
    return words if docking.get("coupling.diagnosis") == 1 else [*words, "diagnosis"]


@pytest.mark.parametrize("seed", range(12))
def test_hosts_without_a_mistake_get_no_word(seed):
    assert dock_without_a_mistake(seed) == []


@pytest.mark.long
def test_two_hundred_hosts_without_a_mistake_get_no_word():
    found = {seed: dock_without_a_mistake(seed) for seed in range(200)}
    assert {seed: words for seed, words in found.items() if words} == {}


def test_steps_that_are_tried_and_restored_change_no_diagnosis():
    plain, tried = (dock(0.01, loads=LOADS["torque sign"], detours=d) for d in (False, True))
    assert_named(plain, "torque sign")
    assert set(tried.warnings) == set(plain.warnings)
    assert (plain.time, plain.get("coupling.diagnosis_value")) == (
        tried.time,
        tried.get("coupling.diagnosis_value"),
    )
