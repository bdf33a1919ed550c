"""Loads on vehicles that act for a while, failures that begin at a step, and late settings."""

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.errors import UsageError
from slides import VEHICLE, make_element, make_slide, write_slide

SCENE = f"""{VEHICLE}
[[disturbance]]
vehicle = "chaser"
time = 0.5
duration = 1.0
force = [10, 0, 0]
torque = [0, 0, 5]
"""
SPRING = {"type": "spring", "stages": [[0, 400]]}
STEPS = [
    {
        "name": "wait",
        "phase": 1,
        "next": [{"when": {"quantity": "time", "above": 0.5}, "go": "next"}],
    },
    {"name": "next", "phase": 2},
]


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "vehicle.toml"
    file.write_text(SCENE)
    return str(file)


@pytest.mark.parametrize(
    "method", ["auto", "explicit", "bdf", "fixed_rk4", "rosenbrock", "fixed_rosenbrock"]
)
def test_a_disturbance_has_its_impulse_at_any_step(scene, method):
    """Neither begin nor end lies at a communication point; bdf keeps to its tolerance."""
    most = 1e-4 if method == "bdf" else 1e-9
    run = dl.run(scene, start_values={"solver.method": method}, stop=3.0, step=0.3)
    assert run["chaser.velocity[1]"][-1] == pytest.approx(0.01, rel=most)
    assert run["chaser.angular_velocity[3]"][-1] == pytest.approx(0.005, rel=most)
    assert run["chaser.position[1]"][-1] == pytest.approx(0.005 + 1.5 * 0.01, rel=most)
    assert np.max(np.abs(run["energy.residual"])) < max(1e-9, 0.1 * most)
    early = run.time < 0.5
    assert np.all(run["chaser.velocity[1]"][early] == 0.0)
    # No docking system acts, also in steps in which the disturbance begins or ends.
    assert np.max(np.abs(run["chaser.force_mean[1]"])) < 1e4 * most


def test_its_numbers_are_parameters(scene):
    values = {"disturbance[1].force[1]": 0.0, "disturbance[1].force[2]": 20.0}
    run = dl.run(scene, start_values={**values, "disturbance[1].time": 2.5}, stop=3.0)
    assert abs(run["chaser.velocity[1]"][-1]) < 1e-18
    assert run["chaser.velocity[2]"][-1] == pytest.approx(0.01, rel=1e-9)  # half of it


def test_a_key_changes_or_adds_a_disturbance(scene):
    changed = dl.run(scene, {"disturbance.1.force.1": 20.0}, stop=3.0, step=0.3)
    assert changed["chaser.velocity[1]"][-1] == pytest.approx(0.02, rel=1e-9)
    assert changed["chaser.angular_velocity[3]"][-1] == pytest.approx(0.005, rel=1e-9)
    added = {"vehicle": "chaser", "duration": 2.0, "force": [0.0, 3.0, 0.0]}
    keys = {f"disturbance.2.{member}": value for member, value in added.items()}
    both = dl.run(scene, keys, stop=3.0, step=0.3)
    assert both["chaser.velocity[1]"][-1] == pytest.approx(0.01, rel=1e-9)
    assert both["chaser.velocity[2]"][-1] == pytest.approx(0.006, rel=1e-3)  # it turns slowly


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("disturbance.0.time", "counted from 1"),
        ("disturbance.3.time", "2 adds a disturbance"),
        ("disturbance.first.time", "counted from 1"),
        ("disturbance.1.forces", "did you mean 'force'"),
        ("disturbance.1.force.4", "force and torque have numbers"),
        ("disturbance.1.duration.1", "force and torque have numbers"),
        ("disturbance.2.duration", "lacks the member 'vehicle'"),
    ],
)
def test_a_wrong_key_of_a_disturbance_is_refused(scene, key, message):
    with pytest.raises(UsageError, match=message) as error:
        dl.run(scene, {key: 1.0})
    assert "\n" not in str(error.value)


def test_a_sweep_adds_a_disturbance(scene, tmp_path):
    file = tmp_path / "push.toml"
    file.write_text(
        'scene = "vehicle.toml"\noutcomes = ["chaser.velocity[2]"]\n[set]\n'
        '"disturbance.2.vehicle" = "chaser"\n"disturbance.2.duration" = 1.0\n'
        '[[vary]]\ntype = "grid"\nname = "disturbance.2.force.2"\nvalues = [1.0, 2.0]\n'
    )
    table = dl.sweep(file)
    assert table["chaser.velocity[2]"].tolist() == pytest.approx([1e-3, 2e-3], rel=1e-2)


def test_a_state_saved_while_it_acts_goes_on_with_the_same_bits(scene):
    docking = dl.Docking(scene)
    docking.step(0.8)
    saved = docking.save()
    ends = []
    for _ in range(2):
        for _ in range(7):
            docking.step(0.2)
        ends.append(docking.get("chaser.position"))
        docking.restore(saved)
    assert np.array_equal(*ends)
    assert ends[0][0] == pytest.approx(0.005 + 0.7 * 0.01, rel=1e-9)


def test_a_disturbance_may_wait_for_a_step(tmp_path):
    mechanism = make_slide(40, make_element(SPRING), sequence={"steps": STEPS})
    scene = write_slide(tmp_path, mechanism, 0.1)
    load = {"vehicle": "chaser", "at": "next", "time": 0.25, "duration": 0.5, "force": [80, 0, 0]}
    run = dl.run(scene, {"chaser.motion": "free", "disturbance": [load]}, stop=2.0, step=0.1)
    momentum = 1040 * run["chaser.velocity[1]"] + 40 * run["state.v[1]"]
    assert np.ptp(momentum[run.time < 0.75]) < 1e-9
    assert momentum[-1] - momentum[0] == pytest.approx(40.0, rel=1e-9)
    assert np.max(np.abs(run["energy.residual"])) < 1e-7


@pytest.mark.parametrize("kind", ["off", "jammed"])
def test_a_failure_may_begin_at_a_step(tmp_path, kind):
    """As the same failure at the time at which the step is entered."""
    failure = {"element": "one", "kind": kind} | ({"law": 1} if kind == "off" else {})
    runs = []
    for onset in ({"time": 0.7}, {"at": "next", "time": 0.2}):
        mechanism = make_slide(
            40, make_element(SPRING), sequence={"steps": STEPS}, failures=[failure | onset]
        )
        runs.append(dl.run(write_slide(tmp_path, mechanism, 0.1), stop=1.5, step=0.1))
    a, b = (run["state.q[1]"] for run in runs)
    assert np.max(np.abs(a - b)) < 1e-8
    assert abs(runs[0]["state.v[1]"][-1] - 0.1 * np.cos(np.sqrt(10.0) * 1.5)) > 1e-3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vehicle": "target"}, "is 'target', but the scene has none"),
        ({"duration": 0}, "must be greater than 0"),
        ({"at": "retract"}, r"disturbance\[1\].at names a step, but the mechanism has no"),
        ({"forces": [1, 0, 0]}, "unknown member 'forces'"),
    ],
)
def test_a_disturbance_that_cannot_act_is_refused(scene, change, message):
    load = {"vehicle": "chaser", "duration": 1.0, **change}
    with pytest.raises(UsageError, match=message):
        dl.Docking(scene, overrides={"disturbance": [load]})


@pytest.mark.parametrize(
    ("failure", "message"),
    [
        ({"kind": "jammed", "at": "next"}, "names a step, but the mechanism has no sequence"),
        ({"kind": "jammed", "value": 0}, "value is 0; the stiffness of the lock .* above 0"),
        ({"kind": "jammed", "law": 1}, "law has no effect: 'jammed' holds the whole element"),
        ({"kind": "delayed", "law": 1, "value": 1}, r"law 1 \(spring\) .* takes no command"),
    ],
)
def test_a_failure_without_effect_is_refused(tmp_path, failure, message):
    mechanism = make_slide(40, make_element(SPRING), failures=[{"element": "one", **failure}])
    with pytest.raises(UsageError, match=message):
        dl.Docking(write_slide(tmp_path, mechanism))


def test_a_step_that_does_not_exist_is_named(tmp_path):
    failure = {"element": "one", "kind": "jammed", "at": "later"}
    mechanism = make_slide(40, make_element(SPRING), sequence={"steps": STEPS}, failures=[failure])
    with pytest.raises(UsageError, match="is 'later'; no step has this name"):
        dl.Docking(write_slide(tmp_path, mechanism))


# ---------------------------------------------------------------- late settings

DRIVE = {"type": "drive", "target": 0.5, "speed": 0.05, "acceleration": 0.1}
DRIVE |= {"gain": 1e4, "limit": 300, "corner": 10}
MOTOR = {"type": "motor", "constant": 1.0, "resistance": 1.0, "current_limit": 50, "current": 5}
PUSH = {"type": "constant", "force": 100.0}
LATE = {"element": "one", "law": 1, "kind": "delayed", "value": 0.75}


def at_times(*settings: tuple[float, dict]) -> dict:
    """A sequence that makes settings of the element at these times; the first is the start."""
    times = [time for time, _ in settings]
    steps = []
    for i, (time, members) in enumerate(settings):
        step = {"name": f"s{i}", "phase": 1, "do": [{"element": "one", **members}]}
        if i + 1 < len(settings):
            wait = {"quantity": "time", "above": times[i + 1] - time}
            step["next"] = [{"when": wait, "go": f"s{i + 1}"}]
        steps.append(step)
    return {"steps": steps}


def run_slide(folder, laws, settings=(), *, rate=0.0, failures=(), stop=4.0):
    """Run a slide whose sequence makes the settings."""
    keys = {"sequence": at_times(*settings)} if settings else {}
    mechanism = make_slide(40, make_element(*laws), failures=list(failures), **keys)
    return dl.run(write_slide(folder, mechanism, rate), stop=stop, step=0.05)


def find_difference(a, b):
    """Largest differences of coordinate, and of force away from jumps."""
    forces = np.abs(a["element[1].force"] - b["element[1].force"])
    assert np.sum(forces > 1e-3) <= 2, forces
    return np.max(np.abs(a["element[1].coordinate"] - b["element[1].coordinate"]))


TURN = ({"run": {"target": 0.2}}, {"run": {"target": -0.2}}, {"run": "off"})
GRIP = ({"engagement": 0}, {"engagement": 1}, {"engagement": 0.3})
BRAKE = {"type": "brake", "forward": 400, "presliding": 1e-4}
LAWS = {
    "drive": ((DRIVE,), TURN, {"run": "off"}),
    "brake": ((BRAKE, PUSH), GRIP, {"engagement": 1}),
    "regularised": (({**BRAKE, "model": 1}, PUSH), GRIP, {"engagement": 1}),
    "eddy": (({"type": "eddy", "slope": 300, "peak_rate": 2.0}, PUSH), GRIP, {"engagement": 1}),
}


@pytest.mark.parametrize("kind", LAWS)
@pytest.mark.parametrize("times", [(0.0, 1.5, 2.5), (0.0, 1.0, 1.25)], ids=["apart", "under way"])
def test_a_late_setting_is_one_that_is_made_later(tmp_path, kind, times):
    """Until it arrives the old one acts, also while others are on their way."""
    laws, actions, before = LAWS[kind]
    late = run_slide(tmp_path, laws, list(zip(times, actions, strict=True)), failures=[LATE])
    later = [(0.0, before), *zip((time + 0.75 for time in times), actions, strict=True)]
    assert find_difference(late, run_slide(tmp_path, laws, later)) < 1e-7
    assert np.max(np.abs(late["energy.residual"])) < 1e-4


@pytest.mark.parametrize("onset", [{"time": 1.2}, {"at": "s1"}, {"at": "s1", "time": 0.5}])
def test_a_setting_before_the_onset_is_not_late(tmp_path, onset):
    settings = list(zip((0.0, 1.5, 2.5), TURN, strict=True))
    late = run_slide(tmp_path, (DRIVE,), settings, failures=[LATE | onset])
    first = 2 if len(onset) == 2 else 1  # setting that is late
    later = settings[:first] + [(time + 0.75, action) for time, action in settings[first:]]
    assert find_difference(late, run_slide(tmp_path, (DRIVE,), later)) < 1e-7


@pytest.mark.parametrize("law", [MOTOR, DRIVE], ids=["motor", "drive"])
@pytest.mark.parametrize(("onset", "start"), [(0.0, 0.75), (5.0, 0.0)])
def test_a_motor_starts_late_if_the_delay_begins_with_the_run(tmp_path, law, onset, start):
    made = run_slide(tmp_path, (law,), failures=[LATE | {"time": onset}], stop=1.0)
    moves = made["element[1].coordinate"] > 0.0
    assert np.array_equal(moves, made.time > start + 1e-9)


def test_the_command_hold_is_late_too(tmp_path):
    mechanism = make_slide(40, make_element(DRIVE), failures=[LATE | {"time": 0.5}])
    mechanism["sequence"] = at_times((0.0, {"run": {"target": 0.5}}))
    docking = dl.Docking(write_slide(tmp_path, mechanism))
    docking.step(1.0)
    docking.set("command", "hold")
    docking.step(0.7)
    assert docking.get("element[1].rate") == pytest.approx(0.05, rel=1e-3)
    docking.step(1.3)
    assert abs(docking.get("element[1].rate")) < 1e-3


def test_settings_under_way_are_part_of_a_saved_state(tmp_path):
    mechanism = make_slide(40, make_element(DRIVE), failures=[LATE])
    mechanism["sequence"] = at_times(*zip((0.0, 1.5, 1.9), TURN, strict=True))
    docking = dl.Docking(write_slide(tmp_path, mechanism))
    docking.step(2.0)  # two are on their way
    saved, ends = docking.save(), []
    for _ in range(2):
        for _ in range(8):
            docking.step(0.13)
        ends.append((docking.get("element[1].coordinate"), docking.get("element[1].rate")))
        docking.restore(saved)
    assert ends[0] == ends[1]


@pytest.mark.parametrize(
    ("law", "failures", "message"),
    [
        ({**DRIVE, "commanded": True}, [LATE], r"law 1 \(drive\) .* has its command from the host"),
        (DRIVE, [LATE, LATE], "is delayed already; give one failure with the sum of the delays"),
    ],
)
def test_a_delay_that_cannot_act_is_refused(tmp_path, law, failures, message):
    mechanism = make_slide(40, make_element(law), failures=failures)
    with pytest.raises(UsageError, match=message) as error:
        dl.Docking(write_slide(tmp_path, mechanism))
    assert "\n" not in str(error.value)


# ---------------------------------------------------------------- friction that follows a load


@pytest.mark.parametrize("model", [1, 2])
@pytest.mark.parametrize(
    ("engagement", "failure", "left"),
    [
        (1.0, {"kind": "off"}, 0.0),
        (1.0, {"kind": "factor", "value": 0.5}, 0.5),
        (0.5, {"kind": "off"}, 0.0),
    ],
    ids=["off", "half", "engagement 0.5"],
)
def test_the_friction_of_a_load_fails_with_its_brake(tmp_path, model, engagement, failure, left):
    """The level is that of the brake times its engagement, and a share of the load."""
    brake = {"type": "brake", "forward": 20, "load_share": 0.5, "model": model}
    brake |= {"engagement": engagement}
    failure = {"element": "one", "law": 2, "time": 1.0, **failure}
    made = run_slide(tmp_path, (PUSH, brake), rate=1.0, failures=[failure], stop=2.0)
    friction = 100.0 - made["element[1].force"]
    whole = 20.0 * engagement + 50.0
    assert friction[(made.time > 0.2) & (made.time < 0.99)] == pytest.approx(whole, abs=1e-3)
    assert friction[-1] == pytest.approx(left * whole, abs=1e-3)
