"""Linearly implicit steps that end after the communication point, as a host sees them.

1. Loads and motion read at points inside steps are as good as those at their ends, and the same for
   any communication step; energy and momentum hold.
2. A change of an input or of a parameter acts from its communication point on, not earlier.
3. What is read changes nothing.
4. Mechanisms with a sequence, hooks and pushers take such steps too: the same run for any
   communication step, saved states bit for bit. (Commands: test_sequence.py.)
"""

import random

import numpy as np
import pytest

import dockloop as dl
from dockloop.runs.docking import Docking, Scene

STOP = 6.0  # s; contact, capture, and most of the attenuation


@pytest.fixture(scope="module")
def scene():
    """A docking that begins just before contact."""
    return Scene("idss_25t_350t", {"initial.approach_time": 0.1})


def make(scene, method, rtol):
    """Return a docking whose mechanism is always integrated."""
    docking = Docking(scene)
    docking.set("solver.method", method)
    docking.set("model.flight", 2)
    docking.set("solver.rtol", rtol)
    for name in ("position", "velocity"):
        docking.set(f"solver.atol_{name}", 1e-2 * rtol)
    docking.set("solver.atol_energy", 0.1 * rtol)
    return docking


def follow(docking, h, act=lambda docking, i: None):
    """Return loads, motion and energy residual every 0.25 s."""
    samples = []
    for i in range(round(STOP / h)):
        act(docking, i)
        docking.step(h)
        if (i + 1) % round(0.25 / h) == 0:
            names = ("capture.force", "relative.position", "relative.velocity", "energy.residual")
            samples.append(np.concatenate([np.atleast_1d(docking.get(n)) for n in names]))
    return np.array(samples)


@pytest.mark.parametrize(("rtol", "force", "place"), [(1e-3, 3.0, 2e-5), (1e-4, 0.5, 2e-6)])
def test_what_is_read_inside_steps_is_as_good_as_at_their_ends(scene, rtol, force, place):
    exact = follow(make(scene, 2, 1e-9), 0.25)
    fine = make(scene, 12, rtol)
    found = follow(fine, 0.01)
    error = np.abs(found - exact)
    assert fine.get("captured")
    assert error[:, :3].max() < force  # N, of loads up to 1 kN
    assert error[:, 3:6].max() < place
    assert np.abs(found[:, 9]).max() < 10 * rtol
    assert fine.get("momentum.residual") < 1e-13
    coarse = make(scene, 12, rtol)
    other = follow(coarse, 0.25)
    assert np.allclose(other, found, rtol=1e-6, atol=1e-7)
    for name in ("solver.rhs_evaluations", "solver.steps"):
        assert coarse.get(name) == fine.get(name)
    assert coarse.get("time_of_capture") == pytest.approx(fine.get("time_of_capture"), abs=1e-12)


@pytest.mark.parametrize("name", ["friction.coefficient", "chaser.force_ext"])
def test_a_change_acts_from_its_communication_point_on(scene, name):
    value = 0.3 if name == "friction.coefficient" else [0.0, 500.0, 0.0]

    def act(docking, i):
        if i == 137:
            docking.set(name, value)

    exact = follow(make(scene, 2, 1e-9), 0.01, act)
    found = follow(make(scene, 12, 1e-4), 0.01, act)
    late = follow(make(scene, 2, 1e-9), 0.01, lambda docking, i: act(docking, i - 1))
    error, delay = (np.abs(x - exact)[:, 3:9].max() for x in (found, late))
    assert error < 0.2 * delay


def test_reading_changes_nothing(scene):
    silent, read = make(scene, 12, 1e-3), make(scene, 12, 1e-3)
    for _ in range(400):
        silent.step(0.01)
        read.step(0.01)
        read.get("capture.force")
        read.get("momentum.residual")
        read.get("chaser.force_mean")
    for name in read.variables:
        assert silent.get(name) == read.get(name), name


def test_bristles_do_not_swing_inside_long_explicit_steps():
    keys = {  # a light chaser on soft surfaces with steep friction: long steps, fast bristles
        "chaser.mass": 266.7,
        "chaser.inertia": [1237.7335418, 1314.5630554, 652.2612614, 0.0, 0.0, 0.0],
        "chaser.interface_position": [1.745, 0.0, 0.0],
        "initial.closing_speed": 0.08353,
        "initial.approach_time": 0.06266,
        "initial.lateral_offset": 0.03052,
        "initial.lateral_direction_deg": 18.66600567033858,
        "initial.lateral_speed": 0.0008088,
        "initial.pitch_yaw_deg": 0.0,
        "initial.pitch_yaw_rate_deg_s": 0.8879,
        "initial.pitch_yaw_direction_deg": 342.2786190766401,
        "initial.pitch_yaw_rate_direction_deg": 197.71368444224862,
        "initial.roll_rate_deg_s": 2.404,
        "contact.stiffness": 3297.0,
        "contact.node_stiffness": 9.887e6,
        "contact.friction_coefficient": 1.827,
        "contact.friction_model": "bristle",
        "mechanism.set.leg_defaults.stiffness": 1702.0,
        "mechanism.set.leg_defaults.damping": 14.99,
        "model.level": "massless_legs",
    }
    docking = make(Scene("idss_25t_350t", keys), 12, 2.977e-3)
    in_play, residuals = docking.get("energy.kinetic"), []
    for _ in range(109):
        docking.step(0.005019)
        residuals.append(abs(docking.get("energy.residual")))
    assert max(residuals) < 0.02 * in_play


# ---------------------------------------------------------------------------- sequences

FAMILIES = ("hexapod", "apda", "probe_drogue")


def make_family(name):
    """Return a docking of a family that begins just before contact."""
    docking = Docking(Scene(name, {"initial.approach_time": 0.1}))
    docking.set("accuracy", 1e-3)
    return docking


def read(docking):
    return {name: docking.get(name) for name in docking.variables}


@pytest.mark.parametrize("name", FAMILIES)
def test_a_sequence_is_the_same_for_any_communication_step(name):
    """A run with an exact method is near; energy and momentum hold."""
    coarse, fine = make_family(name), make_family(name)
    exact = Docking(fine.scene)
    exact.set("solver.method", 2)
    for docking, h in ((coarse, 0.5), (fine, 0.02), (exact, 0.5)):
        for _ in range(round(12.0 / h)):
            docking.step(h)
    assert fine.get("captured")
    assert fine.get("solver.rhs_evaluations") == coarse.get("solver.rhs_evaluations")
    assert fine.get("time_of_capture") == pytest.approx(coarse.get("time_of_capture"), abs=1e-12)
    assert fine.get("sequence.step") == coarse.get("sequence.step") == exact.get("sequence.step")
    place = [docking.get("relative.position") for docking in (fine, coarse, exact)]
    assert np.allclose(place[0], place[1], rtol=0.0, atol=1e-9)
    assert np.allclose(place[0], place[2], rtol=0.0, atol=1e-4)
    assert fine.get("momentum.residual") < 1e-13


@pytest.mark.parametrize("name", FAMILIES)
def test_a_run_with_a_sequence_goes_on_from_any_saved_state(name):
    draw = random.Random(3)
    straight, docking = make_family(name), make_family(name)
    restored = 0
    for i in range(150):
        h = draw.choice([0.005, 0.05, 0.2])
        if i == 100:
            for each in (straight, docking):
                each.set("command", "hold")
        straight.step(h)
        if draw.random() < 0.2:
            state = docking.save()
            if draw.random() < 0.5:  # something else first
                docking.step(0.3 * h)
                docking.get("capture.force")
            else:
                docking = Docking(docking.scene)
            docking.restore(state)
            restored += 1
        docking.step(h)
        assert (
            docking.get("relative.position").tobytes()
            == straight.get("relative.position").tobytes()
        )
    assert restored > 20
    ours, theirs = read(docking), read(straight)
    for variable, value in theirs.items():
        assert np.array_equal(ours[variable], value), variable


def test_a_rigid_joint_ends_steps_ahead():
    """The target then follows the chaser at communication points, under a constant load too."""
    straight, docking = make_family("apda"), make_family("apda")
    for i in range(120):
        for each in (straight, docking):
            if i == 40:
                each.set("chaser.force_ext", [20.0, 5.0, 0.0])
            if i == 60:
                each.set("hard_dock.command", "join")
        straight.step(0.05)
        if i % 7 == 3:
            state = docking.save()
            docking = Docking(docking.scene)
            docking.restore(state)
        docking.step(0.05)
    ours, theirs = read(docking), read(straight)
    for variable, value in theirs.items():
        assert np.array_equal(ours[variable], value), variable
    assert np.abs(docking.get("relative.velocity")).max() < 1e-9


def test_mean_loads_of_long_steps_are_the_changes_of_momentum():
    """Between two points the head slides from one side of the cone to the other."""
    docking = make_family("probe_drogue")
    mass = docking.get("chaser.mass")
    speed = docking.get("chaser.velocity")
    for _ in range(20):
        docking.step(0.5)
        gained = mass * (docking.get("chaser.velocity") - speed) / 0.5
        assert docking.get("chaser.force_mean") == pytest.approx(gained, abs=1e-6 * mass)
        speed = docking.get("chaser.velocity")


@pytest.mark.parametrize("name", ["idss_25t_350t", "probe_drogue"])
@pytest.mark.parametrize("h", [0.01, 0.03, 0.1, 0.25])
def test_points_inside_the_loosest_steps_are_good(name, h):
    """No point is off by 1 % of the energy without a warning, and peaks do not come from there."""
    loose = {f"solver.{key}": 1e-2 for key in ("rtol", "atol_position", "atol_velocity")}
    docking, right = Docking(name, loose), Docking(name, {"solver.accuracy": 1e-4})
    energy, worst = docking.get("energy.kinetic"), 0.0
    for _ in range(round(15.0 / h)):
        docking.step(h)
        right.step(h)
        worst = max(worst, abs(docking.get("energy.residual")))
    assert worst < 0.01 * energy or any("energy audit" in text for text in docking.warnings)
    peak = right.get("capture.peak.compression")
    assert docking.get("capture.peak.compression") == pytest.approx(peak, rel=0.1)


def test_stiff_drives_get_linearly_implicit_steps():
    """Method 1 (auto) takes them where stability would limit it, and goes on from a saved state."""
    auto, stable = Docking("hexapod"), Docking("hexapod", {"solver.method": "stabilised"})
    for i in range(120):
        if i == 80:
            saved = auto.save()
        auto.step(0.5)
        stable.step(0.5)
    assert auto.get("solver.rhs_evaluations") < 0.5 * stable.get("solver.rhs_evaluations")
    assert auto.get("solver.chosen_method") == 12
    assert stable.get("solver.chosen_method") == 11
    peak = stable.get("capture.peak.compression")
    assert auto.get("capture.peak.compression") == pytest.approx(peak, rel=1e-5)
    again = Docking("hexapod")
    again.restore(saved)
    for _ in range(40):
        again.step(0.5)
    for name in ("relative.position", "capture.force", "element[1].force", "solver.steps"):
        assert np.all(again.get(name) == auto.get(name)), name


@pytest.mark.long
def test_a_sequence_costs_less_than_with_bdf_for_the_same_error():
    """Counts of evaluations at the same tolerance say nothing: the errors differ by orders."""

    def run(values):
        made = dl.run("probe_drogue", {}, {"command": "undock", **values}, stop=130.0, step=0.5)
        names = [f"capture.peak.{load}" for load in ("tension", "compression", "bending")]
        return np.array([made[name][-1] for name in names]), made["solver.rhs_evaluations"][-1]

    right, _ = run({"solver.rtol": 1e-8})
    cases = ({"solver.method": "bdf"}, {"accuracy": 5e-2}, {})
    (bdf, of_bdf), (loose, of_loose), (default, _) = (
        (np.max(np.abs(peaks / right - 1.0)), count) for peaks, count in map(run, cases)
    )
    print(f"errors of peaks: bdf {bdf:.0e}, accuracy 5e-2 {loose:.0e}, default {default:.0e}")
    assert loose < bdf
    assert of_loose < of_bdf
    assert default < 0.1 * bdf
