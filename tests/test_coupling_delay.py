"""Hosts whose loads act late, or whose motion comes back late: coupling.delay.

1. With the delay stated, the docking is that of one FMU, in every order of exchange, with late
   loads, late motion or both, in whole steps or not. Momentum of hosts, inside and under way adds
   up.
2. A host in orbit whose motion is late must state it (coupling.motion_delay).
3. A step saved in the middle of the delay, restored and repeated, has the same bits.
4. A wrong statement is named with the delay that there is; a right one gets no word.
5. What cannot be is refused, and the step leaves no trace.
6. coupling.largest_delay: the delay at which the real loop, which nothing informs, begins to grow.
"""

import functools

import numpy as np
import pytest

import dockloop as dl
from coupling_host import Coupling
from coupling_scenes import SCENES, TIGHT, compare, equal_steps, run_coupled, run_solution
from dockloop.native.core import name_choice
from extreme_cases.fmi_host import OK, Host
from test_host_reports import dock, late, old

PEAKS = ("tension", "compression", "shear", "bending", "torsion")
STOP = 1.2  # s, contact and capture


@pytest.fixture(scope="module")
def peaks_of(runs):
    """The five peak loads of a scene that one FMU integrates."""

    @functools.cache
    def run(name):
        with Host(SCENES[name].build(runs, free=True)) as host:
            for setting, value in TIGHT.items():
                assert host.set_status({setting: value}) == OK
            host.start()
            for _ in range(round(STOP / 0.01)):
                host.step(0.01)
            return read_peaks(host)

    return run


def read_peaks(host):
    return np.array([host.value(f"capture.peak.{peak}") for peak in PEAKS])


def run_late(fmu, step, late, old, *, scheme="parallel", settings=None, stop=STOP, **options):
    """A run with delays in steps, all of them stated. Returns peaks, audit, the pair's warnings."""
    stated = {"coupling.delay": step * (late + old), "coupling.motion_delay": step * old}
    settings = TIGHT | stated | (settings or {})
    options = {"first_step": step, "late": late, "old": old, **options}
    with Coupling(fmu, scheme, settings=settings, **options) as pair:
        first, worst, largest = pair.audit(), np.zeros(6), 0.0
        for _ in range(round(stop / step)):
            pair.step(step)
            worst = np.maximum(worst, np.abs(pair.audit() - first))
            p, _ = pair.bodies[pair.driven[0]].momentum(pair.fixed_point)
            largest = max(largest, float(np.linalg.norm(p)))
        return read_peaks(pair.host), float(worst.max()) / largest, pair.warnings


def worst_error(peaks, right):
    there = right > 0.0
    assert (peaks[~there] == 0.0).all()
    return float(np.abs(peaks[there] / right[there] - 1.0).max())


# ---------------------------------------------------------------- 1: a stated delay

WHOLE = [(0.005, 1, 0), (0.01, 1, 0), (0.01, 2, 0), (0.01, 0, 2), (0.01, 1, 1), (0.002, 4, 6)]


@pytest.mark.parametrize("name", ["default", "light", "target", "both"])
@pytest.mark.parametrize("delays", WHOLE)
def test_a_docking_with_a_stated_delay_is_that_of_one_fmu(runs, peaks_of, name, delays):
    step, loads, motion = delays
    peaks, audit, warnings = run_late(SCENES[name].build(runs), step, loads, motion)
    assert worst_error(peaks, peaks_of(name)) < 2e-5  # measured 3e-7
    assert audit < 1e-9
    assert not warnings, warnings


@pytest.mark.parametrize("scheme", ["sequential", "host_first"])
@pytest.mark.parametrize(("loads", "motion"), [(2, 0), (0, 2), (1, 1)])
def test_the_order_of_exchange_does_not_matter(runs, peaks_of, scheme, loads, motion):
    fmu = SCENES["light"].build(runs)
    peaks, audit, warnings = run_late(fmu, 0.01, loads, motion, scheme=scheme)
    assert worst_error(peaks, peaks_of("light")) < 2e-5
    assert audit < 1e-9
    assert not warnings, warnings


@pytest.mark.parametrize("loads", [0.5, 1.25])
def test_loads_may_change_inside_the_steps_of_the_host(runs, peaks_of, loads):
    peaks, _, warnings = run_late(SCENES["light"].build(runs), 0.01, loads, 0)
    assert worst_error(peaks, peaks_of("light")) < 2e-5
    assert len(warnings) == 1, warnings
    assert f"{loads:.4g} steps" in warnings[0]


def test_the_whole_delay_is_enough_where_only_the_motion_is_late(runs, peaks_of):
    """The docking is that of one FMU, later by the age of the motion."""
    settings = TIGHT | {"coupling.delay": 0.02}
    with Coupling(SCENES["default"].build(runs), settings=settings, first_step=0.01, old=2) as pair:
        for _ in range(round((STOP + 0.02) / 0.01)):
            pair.step(0.01)
        assert worst_error(read_peaks(pair.host), peaks_of("default")) < 2e-5
        assert not pair.warnings, pair.warnings


@pytest.mark.parametrize("reported", [0.5, 1.5])
def test_momentum_adds_up_with_a_wrong_mass(runs, reported):
    _, audit, _ = run_late(SCENES["light"].build(runs), 0.01, 2, 0, reported=reported)
    assert audit < 1e-9


def test_a_known_thrust_is_felt_in_its_step_where_motion_is_late(runs):
    scene = SCENES["default"]
    loads = lambda t: {"chaser": ((0.0, 360.0 * (0.3 <= t < 0.5), 0.0), (0.0, 0.0, 0.0))}  # noqa: E731
    solution = run_solution(scene.build(runs, free=True), equal_steps(0.01, STOP), loads)
    for delays in ({"late": 2}, {"old": 2}, {"late": 1, "old": 1}):
        stated = {
            "coupling.delay": 0.01 * sum(delays.values()),
            "coupling.motion_delay": 0.01 * delays.get("old", 0),
        }
        course = run_coupled(
            scene.build(runs),
            equal_steps(0.01, STOP),
            "parallel",
            settings=TIGHT | stated,
            loads=loads,
            **delays,
        )
        errors = compare(course, solution, scene)
        assert errors.peak < 1e-4, (delays, errors)
        assert not course.warnings, course.warnings


# ---------------------------------------------------------------- 2: in orbit

ORBIT = {"shift": (7e6, 0.0, 0.0), "drift": (0.0, 7.5e3, 0.0), "gravity": (-8.1, 0.0, 0.0)}


def test_late_motion_in_orbit(runs, peaks_of):
    fmu = SCENES["default"].build(runs)
    stated = {"coupling.delay": 0.02, "coupling.motion_delay": 0.02}
    with Coupling(fmu, settings=TIGHT | stated, first_step=0.01, old=2, **ORBIT) as pair:
        for _ in range(round(STOP / 0.01)):
            pair.step(0.01)
        assert worst_error(read_peaks(pair.host), peaks_of("default")) < 1e-4
        assert not pair.warnings, pair.warnings


@pytest.mark.parametrize(("stated", "steps"), [(0.0, 2), (0.02, 0), (0.01, 2)])
def test_a_wrong_age_of_motion_in_orbit_is_named(runs, stated, steps):
    fmu = SCENES["default"].build(runs)
    settings = {"coupling.delay": 0.02, "coupling.motion_delay": stated}
    with Coupling(fmu, settings=settings, first_step=0.01, old=steps, **ORBIT) as pair:
        for _ in range(4):
            pair.step(0.01)
        (number,) = pair.host.slave.getInteger([pair.host.reference["coupling.diagnosis"]])
        found = name_choice("coupling.diagnosis", number)
        assert found == "age of motion", pair.warnings
        assert pair.host.value("coupling.diagnosis_value") == pytest.approx(0.01 * steps)


# ---------------------------------------------------------------- 3: saved states


@pytest.mark.parametrize(
    "stated",
    [{"coupling.delay": 0.02}, {"coupling.delay": 0.02, "coupling.motion_delay": 0.01}],
)
def test_steps_that_are_tried_and_restored_in_the_middle_of_the_delay_change_no_bit(stated):
    ends = [
        dock(0.01, loads=late(2), stop=1.2, settings=TIGHT | stated, detours=detours)
        for detours in (False, True)
    ]
    names = ["chaser.force_mean", "chaser.torque_mean", "relative.position", "relative.velocity"]
    names += ["coupling.pending_impulse", "coupling.pending_angular_impulse"]
    values = [[list(end.get(name)) for name in names] for end in ends]
    assert values[0] == values[1]


# ---------------------------------------------------------------- 4: wrong statements


@pytest.mark.parametrize("make", [late, old], ids=["loads", "motion"])
@pytest.mark.parametrize(
    ("step", "stated", "count"),
    [(0.01, 2, 0), (0.01, 2, 1), (0.01, 2, 4), (0.002, 10, 0), (0.002, 10, 14), (0.01, 1.5, 1)],
)
def test_a_wrong_delay_is_named_with_the_right_one(make, step, stated, count):
    delay = stated * step
    docking = dock(
        step,
        stop=4.0,
        settings={"coupling.delay": delay},
        **{"loads" if make is late else "report": make(count)},
    )
    found = name_choice("coupling.diagnosis", docking.get("coupling.diagnosis"))
    assert found == "delay", docking.warnings
    assert docking.get("coupling.diagnosis_value") == pytest.approx(count * step, abs=1e-9)
    warnings = [text for text in docking.warnings if text.startswith("chaser")]
    assert len(warnings) == 1
    assert f"coupling.delay is {delay:.3g} s" in warnings[0]


@pytest.mark.parametrize("make", [late, old], ids=["loads", "motion"])
@pytest.mark.parametrize(("step", "count"), [(0.001, 5), (0.01, 2), (0.1, 2)])
def test_a_right_delay_gets_no_word(make, step, count):
    docking = dock(
        step,
        settings={"coupling.delay": count * step},
        **{"loads" if make is late else "report": make(count)},
    )
    assert docking.get("coupling.diagnosis") == 1, docking.warnings
    assert not [text for text in docking.warnings if not text.startswith("limit")]


# ---------------------------------------------------------------- 5: refused


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"coupling.delay": 0.01, "coupling.motion_delay": 0.02}, ["motion_delay", "0.01 s"]),
        ({"coupling.delay": 0.5}, ["coupling.delay", "256", "0.001 s"]),
        ({"coupling.delay": 5e-4, "coupling.mode": 1}, ["coupling.mode", "0.0005 s"]),
    ],
)
def test_delays_that_cannot_be_are_refused(settings, words):
    with pytest.raises(dl.DockloopError) as error:
        dock(0.001, stop=0.1, settings=settings)
    assert all(word in str(error.value) for word in words), str(error.value)


# ---------------------------------------------------------------- 6: the largest delay


def test_the_largest_delay_is_that_of_the_real_loop(runs):
    """`pressed` with damped legs: the swing grows from the first longer delay on."""
    scene, step = SCENES["pressed"], 5e-3
    fmu = scene.build(runs, "mechanism.set.leg_defaults.damping=1e5")
    options = {"settings": {"solver.rtol": 1e-7}, "first_step": step, "loads": scene.loads}

    def growth(late):
        """Of the swing from the first half second to the fourth."""
        speed = []
        with Coupling(fmu, late=late, **options) as pair:
            for _ in range(400):
                pair.step(step)
                speed.append(np.linalg.norm(pair.interface_motion()[1]))
        return max(speed[-100:]) / max(speed[:100])

    with Coupling(fmu, **options) as pair:
        for _ in range(10):
            pair.step(step)
        limit = pair.host.value("coupling.largest_delay")
    assert growth(0) < 0.8  # measured 0.58
    first = next(late for late in range(1, 9) if growth(late) > 1.0)
    assert (first - 1) * step < limit < first * step, (limit, first)  # 12.6 ms, the third step
