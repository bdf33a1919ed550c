"""The parameter `accuracy` chooses method and tolerances from measured dockings.

1. The table of the core is what the calibration command writes; the stored errors repeat.
2. A run with `accuracy` has an error within it, costs less than a more accurate one, and says in
   outputs and in one note what was chosen and why. A second note, at the end, says what was left
   out and what that is worth.
3. Without `accuracy` nothing changes; explicit settings of scene and host stay.
4. Real time: fixed steps, the same work in every communication step.
5. Saved states, resets and files keep choice and parameter; values without a meaning are refused.
6. The error estimate by a second run is close to the error; at a boundary of capture it says so.
   With a simplified level of the model it also has the error of that level.
"""

import json
import re
import sys

import numpy as np
import pytest
from fmpy import read_model_description

import dockloop as dl
from dockloop.base.paths import ROOT
from dockloop.cli import main
from dockloop.fmu.host import Instance, unpack_fmu
from dockloop.native.core import list_methods
from dockloop.result import accuracy, run_errors
from dockloop.scene.resolve import resolve_scene
from extreme_cases.fmi_host import Host
from programs import call

SCENE = "idss_25t_350t"
NEAR = {
    "initial.approach_time": 0.3,
    "outputs.groups": ["relative", "capture", "phase", "ring", "solver"],
}
STOP, STEP = 3.0, 0.05
STORED = [548, 10005]  # of a family; of an own mechanism


@pytest.fixture(scope="module")
def study():
    """The module of the calibration command."""
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(ROOT / "tests" / "studies"))
        import accuracy as module  # that of tests/studies

        yield module
        sys.modules.pop("accuracy")


@pytest.fixture(scope="module")
def data(study):
    return json.loads(study.DATA.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rings(study, data):
    """The dockings with passive rings."""
    return study.select(data, "kPassiveRings")


def run(start_values=None, **options):
    return dl.run(SCENE, NEAR, start_values, stop=STOP, step=STEP, **options)


@pytest.fixture(scope="module")
def solution():
    return run({"solver.method": "bdf", **accuracy.list_tolerances(1e-11)})


def last(result, name):
    return float(result[f"solver.{name}"][-1])


# ---------------------------------------------------------------------------- the table


def test_the_table_of_the_core_is_what_the_command_writes(study, data):
    assert study.TABLE.read_text(encoding="utf-8") == study.make_table(data)
    assert len(data["cases"]) >= 30


@pytest.mark.parametrize("number", STORED)
def test_stored_errors_repeat(study, data, number):
    """Of dockings whose errors at 1e-5 do not hinge on rounding, as those of most dockings do."""
    case = next(case for case in data["cases"] if case["number"] == number)
    drawn = study.draw_case(case["number"])
    assert [drawn.scene, drawn.step] == [case["scene"], case["step"]]
    reference, _ = study.find_reference(drawn)
    for method in set(study.METHODS) & case.keys():
        place = data["rtol"].index(1e-5)
        made = study.run(drawn, accuracy.state_rtol(method, 1e-5, accuracy=1.0))
        stored = case[method]["errors"][place]
        assert run_errors.find_error(reference, made) == pytest.approx(stored, rel=0.1)


TABLES = {  # of the core: a scene with it
    "kPassiveRings": (SCENE, {}),
    "kPassiveRingsWithBristles": (SCENE, {"contact.friction_model": "bristle"}),
    "kOthers": ("probe_drogue", {}),
    "kOthersWithBristles": ("hexapod", {"contact.friction_model": "bristle"}),
}
LEAST = {"kOthersWithBristles": 2.3e-4}  # errors; others: 1e-6


@pytest.mark.parametrize("kind", TABLES)
def test_a_promise_holds_for_the_dockings_of_the_calibration(study, data, kind):
    data = study.select(data, kind)
    rows = study.list_rows(data)
    least = LEAST.get(kind, 1e-6)
    assert [rows[0][0], rows[-1][0]] == [pytest.approx(0.1, rel=3.0), pytest.approx(least, rel=3.0)]
    for wanted, (_, method), rtols, _ in rows:
        rtol = rtols[data["methods"].index(method)]
        tighter = [i for i, each in enumerate(data["rtol"]) if each <= rtol * 1.1]
        errors = study.list_errors(data, method)[:, tighter[0]]
        assert np.mean(errors <= wanted) >= 0.95, wanted


# ---------------------------------------------------------------------------- the choice


@pytest.mark.parametrize("wanted", [1e-2, 1e-4])
def test_the_error_is_within_the_accuracy(solution, wanted):
    made = run(accuracy=wanted)
    error = run_errors.find_error(solution, made)
    assert error <= wanted
    assert last(made, "error_estimate") == pytest.approx(wanted, rel=1e-6)


def test_less_accuracy_costs_less():
    runs = [run(accuracy=wanted) for wanted in (1e-2, 2e-3, 1e-4, 1e-6)]
    rtols = [last(each, "chosen_rtol") for each in runs]
    assert rtols == sorted(rtols, reverse=True)
    assert rtols[0] > 3.0 * rtols[1] > 10.0 * rtols[2]
    costs = [last(each, "rhs_evaluations") for each in runs]
    assert costs == sorted(costs)
    assert costs[0] < 0.6 * costs[-1]


@pytest.mark.parametrize("kind", TABLES)
def test_the_choice_is_that_of_the_table(study, data, kind):
    scene, keys = TABLES[kind]
    for wanted, methods, rtols, _ in study.list_rows(study.select(data, kind)):
        for method, step in zip(methods, study.STEPS, strict=True):
            made = dl.Docking(scene, keys | {"experiment.step": step})
            made.set("accuracy", wanted)
            rtol = rtols[data["methods"].index(method)]
            assert made.get("solver.chosen_rtol") == pytest.approx(rtol, rel=1e-9)
            makes = ["stabilised", "rosenbrock"] if method == "stabilised" else [method]  # auto
            assert made.get("solver.chosen_method") in map(made_number, makes)
            assert made.get("accuracy") == wanted
            assert made.get("solver.rtol") == 1e-6  # the parameter itself keeps its value


@pytest.mark.parametrize("wanted", [1e-1, 1e-2, 1e-3])
def test_contacts_with_bristles_have_a_table_of_their_own(study, data, wanted):
    """Its loosest row may promise less than is wanted: looser tolerances would cost more steps."""
    made = dl.Docking(SCENE, NEAR | {"contact.friction_model": "bristle"})
    made.set("accuracy", wanted)
    assert made.get("solver.chosen_method") == made_number("stabilised")
    loosest = study.list_rows(study.select(data, "kPassiveRingsWithBristles"))[0][0]
    promised = min(wanted, loosest)
    assert made.get("solver.error_estimate") == pytest.approx(promised, rel=1e-6)
    without = dl.Docking(SCENE, NEAR)
    without.set("accuracy", wanted)
    assert made.get("solver.chosen_rtol") < 0.1 * without.get("solver.chosen_rtol")


@pytest.mark.parametrize(
    ("speed", "share"), [(0.1, None), (0.05, None), (0.02, "0.4"), (0.005, "0.1"), (1e-4, "0.1")]
)
def test_a_slow_approach_has_smaller_absolute_tolerances(speed, share):
    """Errors are relative to motion and loads, which are small after a slow approach."""
    straight = {"initial.roll_rate_deg_s": 0.0, "initial.lateral_speed": 0.0}
    straight |= {"initial.pitch_yaw_rate_deg_s": 0.0, "initial.closing_speed": speed}
    made = dl.run(SCENE, NEAR | straight, stop=0.05, step=0.05, accuracy=1e-3)
    sentence = f"absolute tolerances of positions and velocities {share} times the usual ones"
    assert (sentence in made.notes[0]) == (share is not None)
    assert ("slow approach" in made.notes[0]) == (share is not None)


def test_an_immobile_vehicle_has_no_speed():
    """Its velocity is read by nothing, so it says nothing of the approach either."""
    keys = NEAR | {"target.motion": "fixed", "initial.closing_speed": 0.01}
    keys |= {"initial.roll_rate_deg_s": 0.0, "initial.pitch_yaw_rate_deg_s": 0.0}
    start = {"target.velocity[1]": 5.0}
    made = dl.run(SCENE, keys, start, stop=0.05, step=0.05, accuracy=1e-3)
    assert "slow approach" in made.notes[0]


def test_stated_absolute_tolerances_are_not_scaled():
    keys = NEAR | {"initial.closing_speed": 0.005}
    stated = {"solver.atol_position": 1e-7, "solver.atol_velocity": 1e-7}
    stated |= {"solver.atol_energy": 1e-5}
    made = dl.run(SCENE, keys, stated, stop=0.05, step=0.05, accuracy=1e-3)
    assert "slow approach" not in made.notes[0]


def test_a_slow_docking_is_within_its_accuracy():
    """Of a differential: with the usual absolute tolerances the error would be 1.3e-3."""
    keys = {
        "initial.approach_time": 0.5,
        "initial.closing_speed": 0.0125,
        "initial.lateral_offset": 0.03,
        "initial.pitch_yaw_deg": 2.0,
        "initial.pitch_yaw_direction_deg": 100.0,
        "outputs.groups": ["relative", "capture", "phase", "ring", "solver"],
    }
    options = {"stop": 12.0, "step": 0.25}
    start = {"solver.method": "bdf", **accuracy.list_tolerances(1e-9)}
    reference = dl.run("apda", keys, start, **options)
    made = dl.run("apda", keys, accuracy=1e-3, estimate_error=True, **options)
    error = run_errors.find_error(reference, made)
    assert error <= 1e-3
    # The second run has smaller absolute tolerances, too.
    assert made.error_estimate["error"] == pytest.approx(error, rel=0.2)


def made_number(method):
    return next(each["number"] for each in list_methods() if each["name"] == method)


def test_a_note_says_once_what_was_chosen():
    made = run(accuracy=1e-3)
    assert len(made.notes) == 2
    assert made.notes[0].startswith("accuracy = 0.001: solver.method ")
    assert made.notes[1].startswith("left out: ")
    assert f"{last(made, 'chosen_rtol'):.3g}" in made.notes[0]
    assert "98 %" in made.notes[0]
    assert made.summary["notes"] == made.notes
    assert made.warnings == []


def test_the_log_of_the_fmu_says_so_once_per_run(runs, tmp_path):
    description, _ = unpack_fmu(runs.fmu(SCENE, "initial.approach_time=0.3"), tmp_path)
    rows = {v.name: v for v in description.modelVariables}
    with Instance(description, str(tmp_path), "test") as instance:
        for _ in range(2):
            instance.initialise([(rows["accuracy"], 1e-3)], np.array([0.0, 1.0]))
            for name in ("gap", "relative.axial"):
                instance.slave.getReal([rows[name].valueReference])
            instance.slave.doStep(0.0, 0.05)
            assert len(instance.notes) == 1
            assert instance.notes[0].startswith("accuracy = 0.001: ")
            instance.slave.terminate()
            assert len(instance.notes) == 2
            assert instance.notes[1].startswith("left out: inner steps for 0.05 s of free drift")
            instance.slave.reset()
            instance.notes.clear()
        instance.initialise([], np.array([0.0, 1.0]))
        assert instance.notes == []


def find_numbers(pattern, note):
    found = re.search(pattern, note)
    assert found, note
    return [float(number) for number in found.groups()]


def test_a_note_says_what_was_left_out_and_what_that_is_worth():
    made = dl.run(SCENE, NEAR | {"initial.approach_time": 1.0}, stop=2.0, step=0.5, accuracy=1e-3)
    note = made.notes[-1]
    drifted, place = find_numbers(r"for (\S+) s of free drift .* at most (\S+) m\)", note)
    assert 0.5 < drifted < 1.0  # until half a centimetre before contact
    assert place == pytest.approx(10.0 * 0.01 * last(made, "chosen_rtol"), rel=0.1)
    saved, needed = find_numbers(r"about (\S+) evaluations .* which needed (\d+)", note)
    assert needed == last(made, "rhs_evaluations")
    assert saved == pytest.approx(needed * drifted / (2.0 - drifted), rel=0.1)
    far, pairs = find_numbers(r"at least (\S+) of (\d+) contact pairs", note)
    assert 0.5 * pairs < far < pairs


def test_with_loads_all_the_time_only_outputs_and_pairs_are_left_out():
    docking = dl.Docking(SCENE, NEAR)
    docking.set("accuracy", 1e-3)
    docking.set("target.torque_ext", [500.0, 0.0, 0.0])
    for _ in range(8):
        docking.step(STEP)
    note = docking.record(np.array([0.4, 0.5])).notes[-1]
    assert "free drift" not in note
    assert "rigid joint" not in note
    # The last two points are recorded.
    assert note.endswith("outputs at 8 of 10 communication points, where they were not read")
    assert not dl.run(SCENE, NEAR, stop=0.1, step=0.1).notes


@pytest.mark.parametrize(("stop", "is_long"), [(20.0, False), (45.0, True)])
def test_after_a_long_motion_the_note_says_what_is_not_promised(stop, is_long):
    keys = {"initial.approach_time": 0.5, "outputs.groups": ["phase", "solver"]}
    made = dl.run("hexapod", keys, stop=stop, step=0.5, accuracy=1e-2)
    note = made.notes[-1]
    assert ("errors of late peaks and of the final motion can grow" in note) == is_long
    if is_long:
        passed, measured = find_numbers(r"went on for (\S+) s .* ones for at most (\S+) s", note)
        assert passed == pytest.approx(stop - made["time_of_contact"][-1], rel=1e-3)
        assert measured == 30.0


def test_a_rigid_joint_is_left_out_too():
    docking = dl.Docking("apda", {"outputs.groups": ["solver"]})
    docking.set("accuracy", 1e-2)
    docking.step(0.5)
    docking.set("hard_dock.command", "join")
    note = docking.record(np.array([0.5, 1.5])).notes[-1]
    assert "relative motion for 1 s with a rigid joint" in note


@pytest.mark.parametrize(
    ("method", "step", "warned"),
    [
        ("fixed_rk4", 7.5e-3, True),
        ("fixed_rk4", 5e-4, False),
        ("fixed_rosenbrock", 7.5e-3, True),
        ("fixed_rosenbrock", 1e-3, False),
    ],
)
def test_equal_steps_that_are_long_for_the_scene_are_warned_of(method, step, warned):
    """With soft damping such a run has peak loads that are wrong by half, and good audits."""
    settings = {"solver.method": method, "solver.step": step}
    made = dl.run(SCENE, NEAR, settings, stop=0.5, step=STEP)
    assert any(w.startswith(f"solver.step = {step:.3g} s is long") for w in made.warnings) == warned


def test_a_failure_of_equal_steps_that_are_too_long_names_the_step():
    stiff = {"contact.stiffness": 2e8, "contact.node_stiffness": 2e7}
    for method, remedy in (("fixed_rosenbrock", True), ("rosenbrock", False)):
        settings = {"solver.method": method, "solver.step": 2e-3}
        try:
            dl.run(SCENE, stiff, settings, stop=2.5, step=STEP)
            refused = ""
        except dl.DockloopError as error:
            refused = str(error)
        assert ("or solver.step is too long for what happens there" in refused) == remedy


def test_a_smaller_accuracy_than_any_measured_one_is_said():
    made = run(accuracy=1e-12)
    assert "no smaller error than" in made.notes[0]
    assert last(made, "error_estimate") > 1e-8
    assert last(made, "chosen_rtol") == 2e-11
    assert last(run(accuracy=1e-7), "chosen_rtol") < last(run(accuracy=3e-7), "chosen_rtol")


# ---------------------------------------------------------------------------- explicit settings


@pytest.mark.parametrize("tolerance", [None, "suggested", 1e-7])
def test_the_suggested_tolerance_of_the_fmu_is_no_wish_of_the_host(runs, tolerance):
    """FMPy and others pass on that of the default experiment; a smaller one is a wish."""
    fmu = runs.fmu(SCENE)
    suggested = float(read_model_description(str(fmu)).defaultExperiment.tolerance)
    with Host(fmu, tolerance=suggested if tolerance == "suggested" else tolerance) as host:
        host.set(accuracy=1e-2)
        host.start()
        host.step(6.0)
        evaluations = host.value("solver.rhs_evaluations")
    assert evaluations < 3000 if tolerance != 1e-7 else evaluations > 6000, evaluations


TIGHT = {"rtol": 1e-9, "atol_position": 1e-11, "atol_velocity": 1e-11, "atol_energy": 1e-10}


@pytest.mark.parametrize(
    ("settings", "left"),
    [
        ({"rtol": 1e-6}, []),
        ({"rtol": 1e-9}, ["atol_position", "atol_velocity", "atol_energy"]),
        ({**TIGHT, "atol_velocity": 1e-8}, ["atol_velocity"]),
        (TIGHT, []),
        ({"rtol": 1e-9, "method": "fixed_rk4"}, []),
    ],
)
def test_absolute_tolerances_that_stay_behind_are_named(settings, left):
    values = {f"solver.{name}": value for name, value in settings.items()}
    notes = dl.run(SCENE, NEAR, values, stop=0.1, step=0.1).notes
    named = re.findall(r"solver\.(atol_\w+) = ", notes[0]) if notes else []
    assert named == left
    assert not left or notes[0].startswith("solver.rtol = 1e-09 is tighter than usual")


def test_without_accuracy_nothing_is_chosen():
    plain, zero = run(), run({"accuracy": 0.0})
    assert plain.values.tobytes() == zero.values.tobytes()
    assert plain.notes == []
    assert [last(plain, f"chosen_{name}") for name in ("method", "rtol", "step")] == [
        made_number("stabilised"),
        1e-6,
        0,
    ]
    assert last(plain, "error_estimate") == 0.0


@pytest.mark.parametrize("place", ["parameter", "scene"])
def test_explicit_settings_stay(place):
    stated = {"solver.rtol": 1e-8, "solver.method": "explicit", **accuracy.list_tolerances(1e-8)}
    plain = (
        run(stated) if place == "parameter" else dl.run(SCENE, NEAR | stated, stop=STOP, step=STEP)
    )
    made = (
        run(stated | {"accuracy": 1e-2})
        if place == "parameter"
        else dl.run(SCENE, NEAR | stated, stop=STOP, step=STEP, accuracy=1e-2)
    )
    assert last(made, "chosen_rtol") == 1e-8
    assert last(made, "rhs_evaluations") == last(plain, "rhs_evaluations")
    assert made["relative.axial"].tobytes() == plain["relative.axial"].tobytes()
    assert "as stated: solver.method, solver.rtol, solver.atol_position" in made.notes[0]


def test_a_stated_tolerance_gets_a_method_that_is_made_for_it():
    """The scene states 1e-10; linearly implicit steps would take 300 times the evaluations."""
    plain = dl.run("absorber_1d", stop=2.0)
    chosen = dl.run("absorber_1d", stop=2.0, accuracy=1e-2)
    assert last(chosen, "rhs_evaluations") <= 1.1 * last(plain, "rhs_evaluations")


def test_a_tighter_tolerance_does_not_choose_a_worse_method():
    """Stabilised steps reach 1e-6 with passive rings."""
    for rtol in (2.5e-10, 1e-10, 1e-11):
        docking = dl.Docking(SCENE, NEAR)
        docking.set("accuracy", 1e-6)
        docking.set("solver.rtol", rtol)
        assert docking.get("solver.chosen_method") == made_number("stabilised")


def test_steep_friction_costs_little_at_any_accuracy():
    """With velocities known to 2e-5 m/s only, surfaces with friction over 1e-5 m/s chatter."""
    steep = NEAR | {"mechanism.set.contact.law.friction_speed": 1e-5}
    runs = [dl.run(SCENE, steep, stop=6.0, step=0.25, accuracy=each) for each in (1e-2, 1e-3)]
    assert max(last(each, "rhs_evaluations") for each in runs) < 10_000


def test_one_explicit_setting_leaves_the_others_to_the_choice(study, data, rings):
    made = run({"solver.method": "auto", "solver.atol_position": 1e-12}, accuracy=1e-2)
    other = run({"solver.method": "explicit"}, accuracy=1e-2)
    assert last(made, "chosen_rtol") > 1e-6
    assert "as stated: solver.atol_position" in made.notes[0]
    assert last(other, "chosen_method") == made_number("explicit")
    assert last(other, "chosen_rtol") > 1e-6
    assert last(other, "error_estimate") == 0.0
    assert "no measured error" in other.notes[0]
    own = run({"solver.method": "stabilised"}, accuracy=1e-2)  # another name of auto
    rtol = next(row[2] for row in study.list_rows(rings) if row[0] == 1e-2)
    assert last(own, "chosen_rtol") == pytest.approx(rtol[data["methods"].index("stabilised")])


# ---------------------------------------------------------------------------- real time


def test_real_time_makes_the_same_work_in_every_step():
    made = run(accuracy="real-time")
    work = np.diff(made["solver.rhs_evaluations"])[1:]
    assert np.ptp(work) == 0.0
    assert last(made, "chosen_method") == made_number("fixed_rosenbrock")
    step = last(made, "chosen_step")
    assert work[0] < 10 * np.ceil(STEP / step)
    assert 1e-4 < step < 5e-3
    assert "real-time" in made.notes[0]


def test_the_real_time_step_follows_from_the_equations(solution):
    steps = {}
    for stiffness in (2e5, 2e6, 2e7):
        keys = NEAR | {"contact.stiffness": stiffness, "contact.friction_coefficient": 0.0}
        docking = dl.Docking(SCENE, keys)
        docking.set("accuracy", -1)
        steps[stiffness] = docking.get("solver.chosen_step")
    assert steps[2e6] == pytest.approx(np.sqrt(10.0) * steps[2e7], rel=0.1)
    assert steps[2e5] > steps[2e6]
    assert run_errors.find_error(solution, run(accuracy="real-time")) < 1e-2
    assert last(run({"solver.step": 5e-4}, accuracy="real-time"), "chosen_step") == 5e-4


@pytest.mark.parametrize("scene", [SCENE, "idss_100t_100t"])
def test_real_time_steps_follow_bristles(scene):
    """They yield fast where surfaces slide under little load, after the impact."""
    keys = NEAR | {"contact.friction_model": "bristle"}
    quick = dl.run(scene, keys, stop=STOP, step=STEP, accuracy="real-time")
    assert last(quick, "chosen_method") == made_number("fixed_rk4")
    assert not quick.warnings
    assert run_errors.find_error(dl.run(scene, keys, stop=STOP, step=STEP), quick) < 1e-2


SOFT_LEGS = NEAR | {  # that reach their stops
    "mechanism.set.leg_defaults.stiffness": 368.0,
    "contact.friction_coefficient": 0.24,
    "initial.closing_speed": 0.09,
    "initial.roll_deg": -1.36,
    "initial.lateral_offset": 0.09,
    "initial.lateral_direction_deg": 316.0,
    "initial.lateral_speed": 0.04,
    "initial.lateral_speed_direction_deg": 125.0,
    "initial.pitch_yaw_deg": 3.89,
    "initial.pitch_yaw_direction_deg": 31.0,
    "initial.pitch_yaw_rate_deg_s": 0.15,
    "initial.pitch_yaw_rate_direction_deg": 297.0,
}


def test_real_time_steps_are_right_for_friction_under_large_loads():
    """Explicit steps that follow the impact are wrong where legs reach their stops."""
    equal = {"solver.method": "fixed_rk4", "solver.step": 2.2e-4}
    exact, quick, explicit = (
        dl.run("idss_100t_100t", SOFT_LEGS, values, stop=7.5, step=STEP, accuracy=wanted)
        for values, wanted in (({}, None), ({}, "real-time"), (equal, None))
    )
    for load in ("compression", "torsion", "shear"):
        name = f"capture.peak.{load}"
        assert quick[name][-1] == pytest.approx(exact[name][-1], rel=1e-2), name
    torsion = "capture.peak.torsion"
    assert explicit[torsion][-1] != pytest.approx(exact[torsion][-1], rel=1e-2)


def test_bristles_take_the_steps_of_another_method():
    """A dense matrix of all bristles would cost more than a communication step may."""
    keys = NEAR | {"contact.friction_model": "bristle"}
    work = [
        last(dl.run(SCENE, keys, {"solver.method": method}, stop=1.0, step=0.1), "rhs_evaluations")
        for method in ("bdf", "rosenbrock", "stabilised")
    ]
    assert work[0] == work[1] == work[2]


def test_a_scene_names_its_accuracy(tmp_path):
    text = (ROOT / "modelDescription" / "scenes" / f"{SCENE}.toml").read_text(encoding="utf-8")
    for value, number in (('"real-time"', -1), ("1e-3", 1e-3)):
        file = tmp_path / "own.toml"
        file.write_text(text.replace("[solver]", f"[solver]\naccuracy = {value}"), encoding="utf-8")
        assert resolve_scene(file)["solver"]["accuracy"] == number
        docking = dl.Docking(file)
        assert docking.get("accuracy") == number
        assert docking.get("solver.error_estimate") == pytest.approx(max(number, 0.0))


# ---------------------------------------------------------------------------- states, refusals


@pytest.mark.parametrize("wanted", [1e-3, "real-time"])
def test_a_saved_state_keeps_the_choice(wanted):
    first, second = dl.Docking(SCENE, NEAR), dl.Docking(SCENE, NEAR)
    first.set("accuracy", wanted)
    first.set("target.torque_ext", [500.0, 0.0, 0.0])
    for _ in range(20):
        first.step(STEP)
    second.set("accuracy", 1e-6)
    second.restore(first.save())
    for docking in (first, second):
        for _ in range(10):
            docking.step(STEP)
    for name in first.variables:
        assert first.get(name) == second.get(name), name
    assert second.get("solver.chosen_rtol") == first.get("solver.chosen_rtol")


def test_values_without_a_meaning_are_refused():
    docking = dl.Docking(SCENE, NEAR)
    for value, words in ((2.0, "above its maximum 1$"), (-2.0, "below its minimum -1$")):
        with pytest.raises(dl.UsageError, match=words):
            docking.set("accuracy", value)
    with pytest.raises(dl.UsageError, match="must be a number or real-time"):
        docking.set("accuracy", "fast")
    docking.set("accuracy", -0.5)
    with pytest.raises(dl.UsageError, match=r"accuracy is -0.5; it must be above 0"):
        docking.step(STEP)
    with pytest.raises(dl.UsageError, match=r"solver.accuracy is .fast.: must be a number or real"):
        dl.Docking(SCENE, {"solver.accuracy": "fast"})
    with pytest.raises(dl.UsageError, match=r"solver.accuracy is -1: must be at least 0"):
        dl.Docking(SCENE, {"solver.accuracy": -1})


# ---------------------------------------------------------------------------- error estimates


@pytest.mark.parametrize(
    "start", [{"accuracy": 1e-2}, {"accuracy": 1e-4}, accuracy.list_tolerances(1e-5)]
)
def test_an_estimate_is_close_to_the_error(solution, start):
    made = run(start, estimate_error=True)
    error = run_errors.find_error(solution, made)
    estimate = made.summary["error_estimate"]
    assert estimate["error"] == max(estimate["figures"].values())
    assert 0.2 * error < estimate["error"] < 5.0 * error
    second = estimate["second_run"]
    assert second["solver.rtol"] == pytest.approx(0.01 * last(made, "chosen_rtol"))
    assert second["evaluations"] > last(made, "rhs_evaluations")
    assert {"capture.peak.shear", "stroke", "time_of_capture", "final_velocity"} <= set(
        estimate["figures"]
    )


MEASURED = {"solver.measure_error": True}
STARTS = {
    "dial": {"accuracy": 1e-3},
    "tight": {"accuracy": 1e-5},
    "stated": accuracy.list_tolerances(1e-5),
    "fixed": {"solver.method": "fixed_rk4", "solver.step": 2e-3},
    "massless": {"accuracy": 1e-3, "model.level": "massless_legs"},
}


@pytest.mark.parametrize("name", STARTS)
def test_a_run_measures_its_error_by_a_companion(name):
    """It is the difference from a finer run, and a tenth for the error of that run."""
    plain = run(STARTS[name], estimate_error=True)
    made = run(STARTS[name] | MEASURED)
    for output in made.names:
        if output not in ("time", "solver.error_estimate"):
            assert np.array_equal(made[output], plain[output]), output
    estimate = plain.error_estimate["error"]
    is_dial = STARTS[name].get("accuracy") == 1e-3  # then the companion has other settings
    rel = 0.1 if is_dial else 1e-6
    assert last(made, "error_estimate") == pytest.approx(1.1 * estimate, rel=rel)
    assert np.max(made["solver.error_estimate"]) < 1.0
    assert made.warnings == plain.warnings
    *notes, note = made.notes
    assert notes == plain.notes
    assert note.startswith(f"the error of this run is {last(made, 'error_estimate') / 1.1:.2g} (")


def test_a_measured_error_above_the_accuracy_is_a_warning():
    made = run({"solver.rtol": 1e-3, "solver.method": "bdf"} | MEASURED, accuracy=1e-6)
    error = last(made, "error_estimate")
    assert error > 1e-6
    assert len(made.warnings) == 1
    assert f"error of this run is {error / 1.1:.2g} (" in made.warnings[0]
    assert "above accuracy = 1e-06" in made.warnings[0]


def test_another_outcome_of_the_companion_is_a_warning():
    """The lateral offset is looked for at which the two runs end otherwise."""
    keys = NEAR | {"initial.closing_speed": 0.05}
    loose, tight = (
        {"solver.method": "rosenbrock", **accuracy.list_tolerances(rtol)} for rtol in (0.1, 1e-3)
    )

    def make(offset, start):
        return dl.run(SCENE, keys | {"initial.lateral_offset": offset}, start, stop=12.0, step=0.1)

    low, high = 0.25, 0.3
    for _ in range(30):
        middle = 0.5 * (low + high)
        is_captured, is_truly = (make(middle, start)["captured"][-1] for start in (loose, tight))
        if is_captured != is_truly:
            break
        low, high = (middle, high) if is_captured else (low, middle)
    made = make(middle, loose | MEASURED)
    assert last(made, "error_estimate") == 1.0
    assert any("the outcome depends on the last digits" in each for each in made.warnings)


def test_a_companion_is_saved_restored_and_reset():
    docking = dl.Docking(SCENE, NEAR)
    names = ["relative.position[1]", "solver.error_estimate", "chaser.contact_thrust"]

    def go_on():
        values = []
        for n in range(20):
            docking.step(STEP)
            if n == 10:
                docking.set("chaser.contact_thrust", 50.0)  # also that of the companion
            values.append([docking.get(name) for name in names])
        return values

    def start():
        docking.set("accuracy", 1e-3)
        docking.set("solver.measure_error", True)
        for _ in range(8):
            docking.step(STEP)
        return docking.save()

    state = start()
    first = go_on()
    assert first[-1][1] > first[0][1] > 0.0
    docking.restore(state)
    assert go_on() == first
    docking.reset()
    docking.step(STEP)
    assert docking.get("solver.error_estimate") == 0.0  # without accuracy
    docking.restore(state)
    assert go_on() == first
    docking.reset()
    assert start() == state


def test_an_estimate_with_fixed_steps_halves_them_twice(solution):
    made = run({"solver.method": "fixed_rk4", "solver.step": 2e-3}, estimate_error=True)
    error = run_errors.find_error(solution, made)
    assert 0.2 * error < made.error_estimate["error"] < 5.0 * error
    assert made.error_estimate["second_run"]["solver.step"] == 5e-4


def test_a_boundary_of_capture_is_said():
    made = run(accuracy=1e-2)
    missed = dl.run(
        SCENE, NEAR | {"initial.lateral_offset": 0.5}, stop=STOP, step=STEP, accuracy=1e-2
    )
    estimate = accuracy.estimate_error(made, lambda _: missed)
    assert estimate["error"] is None
    assert "the outcome depends on the last digits" in estimate["sentence"]
    assert "boundary of capture" in estimate["sentence"]


def test_the_error_of_a_simplified_level_is_next_to_the_estimate(solution):
    level = {"model.level": "massless_legs"}
    made = run(level, accuracy=1e-3, estimate_error=True)
    estimate = made.summary["error_estimate"]
    found = estimate["level"]
    assert estimate["error"] < 1e-3 < found["error"]
    assert found["is_larger"]
    assert found["error"] == pytest.approx(run_errors.find_error(solution, made), rel=0.1)
    assert set(found["figures"]) == set(estimate["figures"])
    assert "the error of model.level is not included" in made.notes[0]
    assert "level" not in run(accuracy=1e-2, estimate_error=True).error_estimate


def test_a_level_with_another_outcome_is_said():
    made = run({"model.level": "rigid"}, accuracy=1e-2, estimate_error=True)
    found = made.error_estimate["level"]
    assert found["error"] is None
    assert found["sentence"].endswith("level rigid has another outcome")


def test_a_run_at_the_full_level_that_fails_is_said():
    made = run({"model.level": "massless_legs"}, accuracy=1e-2)

    def refuse(_):
        raise dl.DockloopError("step from t = 1 s: a test")

    found = accuracy.estimate_level_error(made, refuse)
    assert found["error"] is None
    assert (
        found["sentence"]
        == "not known: the run at level reduced failed (step from t = 1 s: a test)"
    )


def test_an_error_far_above_the_wanted_one_is_said():
    made = run({"solver.rtol": 1e-3, "solver.method": "bdf"}, accuracy=1e-6, estimate_error=True)
    assert made.error_estimate["error"] > 5e-6
    assert "more than 5 times accuracy = 1e-06" in made.error_estimate["sentence"]


def test_the_errors_of_two_runs_are_those_of_their_figures(solution):
    other = run(accuracy.list_tolerances(1e-4))
    figures = run_errors.find_figures(solution, other)
    place = "capture.peak.compression"
    peaks = [each[place][-1] for each in (solution, other)]
    assert figures[place] == pytest.approx(abs(peaks[1] / peaks[0] - 1.0))
    assert run_errors.find_error(solution, other) == max(figures.values())
    assert max(run_errors.find_figures(solution, solution).values()) == 0.0


def test_the_command_chooses_and_estimates(tmp_path, capsys):
    command = ["run", SCENE, "--scene", "initial.approach_time=0.3", "--stop", "2", "--step", "0.1"]
    command += ["--no-plots", "-o", str(tmp_path / "own.csv")]
    assert main([*command, "--accuracy", "1e-3", "--estimate-error", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["notes"][0].startswith("accuracy = 0.001: ")
    assert summary["parameters"]["accuracy"] == 1e-3
    assert 0.0 < summary["error_estimate"]["error"] < 1e-2
    assert main([*command, "--accuracy", "real-time", "--estimate-error"]) == 0
    printed = capsys.readouterr().out
    assert re.search("note +accuracy = -1 .real-time.: solver.method fixed_rosenbrock", printed)
    assert re.search("  error +about ", printed)
    chosen = ["run", "absorber_1d", "--stop", "2", "--no-plots", "--outputs", "relative.axial"]
    assert main([*chosen, "--estimate-error", "-o", str(tmp_path / "one.csv")]) == 0
    assert re.search("  error +about ", capsys.readouterr().out)
    assert (tmp_path / "one.csv").read_text(encoding="utf-8").startswith("time,relative.axial\n")
    assert main([*command, "--estimate-error", "--set", "model.level=massless_legs"]) == 0
    assert re.search("  level error +massless_legs: about ", capsys.readouterr().out)
    assert main([*command, "--set", "accuracy=real-time"]) == 0
    assert "fixed_rosenbrock" in capsys.readouterr().out
    assert main([*command, "--accuracy", "fast"]) == 2
    assert "must be a number or real-time" in capsys.readouterr().err


@pytest.mark.long
def test_the_study_checks_dockings_that_are_not_in_the_calibration(study, data, tmp_path):
    checked = study.list_numbers(study.FIRST_CHECK, study.CHECKS)
    assert not {case["number"] for case in data["cases"]} & set(checked)
    page = tmp_path / "page.md"
    words = ("check", "--cases", "2", "1", "--workers", "1", "-o", page)
    call(sys.executable, study.__file__, *words)
    assert "| 0.001 |" in page.read_text(encoding="utf-8")
