"""Mass, centre of mass and inertia of a host's vehicle are identified from its reports.

The host integrates a rigid body whose numbers it knows; they are the oracle of the estimates. Peak
loads are compared with those of one FMU that integrates both vehicles, with the right numbers.
Where reports are right, or ten numbers do not explain them, identification changes no bit.
"""

import numpy as np
import pytest

import dockloop as dl
from coupling_host import MOTION, RigidBody, symmetric, turn
from dockloop.base.errors import UsageError
from dockloop.native.core import name_choice
from identified_hosts import AIMS, CASES, NEAR, SCENES, find_error, run
from test_host_reports import LOADS, inverse, late

SCENE = "idss_25t_350t"
OFF = {"coupling.identify": False}
WATCHED = ("relative.position", "capture.force", "chaser.force_mean", "coupling.pending_impulse")


def assert_same_bits(*arguments, **options):
    """A run does not depend on coupling.identify."""
    on, off = (
        run(*arguments, watch=WATCHED, settings=settings, **options) for settings in ({}, OFF)
    )
    assert np.array_equal(on.values, off.values)
    assert (on.diagnosis, on.warnings) == (off.diagnosis, off.warnings)
    return on


# ---------------------------------------------------------------- estimates


@pytest.mark.parametrize("step", [0.01, 0.1])
@pytest.mark.parametrize(
    ("factor", "centre"),
    [(1.0, (0, 0, 0)), (0.5, (0, 0, 0)), (2.0, (0, 0, 0)), (1.7, (0.05, -0.05, 0.03))],
)
def test_mass_centre_and_inertia_are_those_of_the_host(step, factor, centre):
    found = run(SCENE, step, 2.0, mass=factor, inertia=factor, centre=centre, overrides=NEAR)
    true = found.body
    for name, least in (("mass", 1e-3 * true["mass"]), ("com", 5e-3), ("inertia", 2e3)):
        value, deviation = found.estimate[name]
        error = np.abs(value - true[name])
        assert (error < least).all(), (name, value, true[name])
        assert (error < 5.0 * deviation + 1e-2 * least).all(), (name, error, deviation)
        assert (deviation < least).all(), (name, deviation)


def test_what_no_load_excites_stays_as_stated():
    found = run(SCENE, 0.01, 0.1, mass=0.5, inertia=0.5, overrides=NEAR)  # before contact
    mass, deviation = found.estimate["mass"]
    # The mechanism at rest exerts next to nothing.
    assert mass == pytest.approx(0.5 * found.body["mass"], rel=1e-3)
    assert deviation == pytest.approx(0.5 * mass, rel=1e-2)  # half of the stated mass
    assert np.abs(found.estimate["com"][0]).max() < 1e-2
    moments = found.estimate["inertia"][0][:3]
    assert moments == pytest.approx(0.5 * found.body["inertia"][:3], rel=1e-2)


# ---------------------------------------------------------------- when the prediction changes


@pytest.mark.parametrize("mode", ["sequential", "parallel"])
@pytest.mark.parametrize(
    ("scene", "step"), [(SCENE, 0.02), (SCENE, 0.1), ("apda", 0.1), ("probe_drogue", 0.1)]
)
def test_a_host_that_is_right_keeps_every_bit(scene, step, mode):
    found = assert_same_bits(scene, step, 1.0, mode=mode)
    assert found.diagnosis == 1, found.warnings


STRANGE = {
    "axes": lambda f, t, q: (turn(inverse(q), f), t),
    "thruster": lambda f, t, q: (f + turn(q, np.array([20.0, 0, 0])), t),
    "late": None,  # made anew: it has a memory
    **{name: LOADS[name] for name in ("force sign", "torque sign", "force missing")},
    "torque point": LOADS["torque point"],
}
FITS_AT_FIRST = ("axes", "torque point")  # ten numbers fit the first two or three loaded steps


@pytest.mark.parametrize("name", STRANGE)
def test_what_ten_numbers_do_not_explain_changes_no_prediction(name):
    options = {"overrides": {"initial.pitch_yaw_deg": 3.0, **NEAR}, "watch": WATCHED}
    on, off = (
        run(SCENE, 0.02, 1.5, loads=STRANGE[name] or late(1), settings=settings, **options)
        for settings in ({}, OFF)
    )
    assert on.diagnosis == off.diagnosis != 1, (on.warnings, off.warnings)
    if name in FITS_AT_FIRST:
        assert on.peaks == pytest.approx(off.peaks, rel=1e-4)
    else:
        assert np.array_equal(on.values, off.values)


def test_steps_that_are_tried_and_restored_change_no_bit():
    plain, tried = (
        run(SCENE, 0.05, 1.5, mass=0.5, overrides=NEAR, watch=WATCHED, detours=detours)
        for detours in (False, True)
    )
    assert np.array_equal(plain.values, tried.values)
    assert plain.estimate["mass"][0] == tried.estimate["mass"][0]


# ---------------------------------------------------------------- accuracy


@pytest.mark.parametrize("case", ["mass and inertia x 0.5", "mass and inertia x 2", "centre y"])
def test_a_wrong_body_is_reported_and_corrected(case):
    error, found = find_error(SCENE, 0.1, case)
    assert error < AIMS[0.1], error
    name = name_choice("coupling.diagnosis", found.diagnosis)
    assert name == ("centre of mass" if case.startswith("centre") else "mass"), found.warnings
    assert len(found.warnings) == 1, found.warnings
    without, _ = find_error(SCENE, 0.1, case, identify=False)
    assert without > error, (without, error)


@pytest.mark.long
@pytest.mark.parametrize("step", AIMS)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("scene", SCENES)
def test_peaks_of_a_wrong_body_are_those_of_the_right_one(scene, case, step):
    error, found = find_error(scene, step, case)
    assert error < AIMS[step], (error, found.warnings)


@pytest.mark.long
@pytest.mark.parametrize("scene", SCENES)
def test_fuel_that_leaves_unreported_is_followed(scene):
    error, _ = find_error(scene, 0.01, "fuel")
    assert error < 1e-5, error


# ---------------------------------------------------------------- a mass that changes


def test_a_mass_that_changes_is_a_fact():
    # A tenth of the vehicle is dropped: velocities stay, and the report is right.
    dropped = run(SCENE, 0.02, 1.5, overrides=NEAR, jettison=(0.8, 0.1), watch=WATCHED)
    assert dropped.diagnosis == 1, dropped.warnings
    assert dropped.momentum_error < 1e-9
    unsaid = run(
        SCENE, 0.02, 1.5, overrides=NEAR, jettison=(0.8, 0.1), restates=False, watch=WATCHED
    )
    apart = np.abs(dropped.peaks - unsaid.peaks) / dropped.peaks.max()
    assert 0.0 < apart.max() < 1e-3, apart


def test_the_mass_of_a_vehicle_that_the_fmu_integrates_is_fixed():
    docking = dl.Docking(SCENE)
    docking.step(0.1)
    with pytest.raises(UsageError, match="fixed parameter"):
        docking.set("chaser.mass", 20e3)


def test_a_mass_that_no_body_can_have_is_refused_and_changes_nothing():
    docking = dl.Docking(SCENE, {"chaser.motion": "driven"})
    docking.step(0.1)
    inertia = docking.get("chaser.inertia")
    with pytest.raises(UsageError, match="principal moments"):
        docking.set("chaser.inertia", [1e3, 1e3, 9e3, 0, 0, 0])
    assert np.array_equal(docking.get("chaser.inertia"), inertia)


# ---------------------------------------------------------------- two hosts


def test_of_two_wrong_vehicles_the_worse_is_shown():
    for chaser, target, worse in ((0.8, 0.4, "target"), (0.4, 0.8, "chaser")):
        docking = run_both(chaser, target)
        warnings = [text for text in docking.warnings if "as if its mass" in text]
        assert len(warnings) == 2, docking.warnings
        value = {"chaser": 1.0 / chaser - 1.0, "target": 1.0 / target - 1.0}[worse]
        assert docking.get("coupling.diagnosis_value") == pytest.approx(value, rel=0.05), worse
        mass = {"chaser": 25e3, "target": 350e3}[worse]
        assert docking.get("coupling.estimated_mass") == pytest.approx(mass, rel=1e-3), worse


def run_both(chaser, target):
    """Two driven vehicles, stated with these factors of mass and inertia."""
    step = 0.02
    docking = dl.Docking(
        SCENE,
        {"chaser.motion": "driven", "target.motion": "driven", "coupling.mode": "parallel"} | NEAR,
    )
    docking.set("coupling.expected_step", step)
    bodies = {}
    for name, factor in (("chaser", chaser), ("target", target)):
        mass, inertia = docking.get(f"{name}.mass"), np.array(docking.get(f"{name}.inertia"))
        motion = [np.array(docking.get(f"{name}.{m}")) for m in MOTION]
        bodies[name] = RigidBody(mass, symmetric(inertia), motion)
        docking.set(f"{name}.mass", factor * mass)
        docking.set(f"{name}.inertia", factor * inertia)
    for _ in range(round(1.5 / step)):
        loads = {
            name: [np.array(docking.get(f"{name}.{n}_mean")) for n in ("force", "torque")]
            for name in bodies
        }
        for name, body in bodies.items():
            for variable, value in zip(MOTION, body.motion(), strict=True):
                docking.set(f"{name}.{variable}", value)
        docking.step(step)
        for name, body in bodies.items():
            body.move(*loads[name], step)
    return docking
