"""Numbers of springs, surfaces, latches and hard dock as parameters; where a base stands on A."""

import json
import re
from shutil import copy

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.errors import UsageError
from dockloop.base.paths import MECHANISMS, SCENES
from extreme_cases.fmi_host import ERROR, OK, Host
from slides import make_slide, write_slide

RING, PROBE, ABSORBER = "idss_25t_350t", "probe_drogue", "absorber_1d"
STOP = 6.0  # [s], after capture and first contacts of the faces
HELD = 12.0  # [s], when latches have held

# scene, parameter = value, the same as keys of the scene
SAME = {
    "common law": (RING, {"contact.stiffness": 8e5}, {"contact.stiffness": 8e5}),
    "nodes": (RING, {"contact.node_stiffness": 9e4}, {"contact.node_stiffness": 9e4}),
    "friction speed": (RING, {"contact.friction_speed": 3e-3}, {"contact.friction_speed": 3e-3}),
    "law with friction": (
        RING,
        {"contact.toe": 8e-5, "friction.coefficient": 0.2, "restitution": 0.5},
        {
            "contact.toe": 8e-5,
            "contact.friction_coefficient": 0.2,
            "contact.restitution": 0.5,
            "contact.restitution_speed": 0.1,
        },
    ),
    "pawls": (
        RING,
        {f"latch[{i}].push_force": 55.0 for i in (1, 2, 3)},
        {"mechanism.set.latches.push_force": 55.0},
    ),
    "play": (
        RING,
        {f"latch[{i}].play": 0.0075 for i in (1, 2, 3)},
        {"mechanism.set.latches.play": 0.0075},
    ),
    "hooks": (PROBE, {"hooks.preload": 9e3}, {"mechanism.set.interface.hooks.preload": 9e3}),
    "pushers": (PROBE, {"pushers.stroke": 0.02}, {"mechanism.set.interface.pushers.stroke": 0.02}),
    "legs": (
        RING,
        {
            f"leg[{i}].{name}": value
            for i in range(1, 7)
            for name, value in (("stiffness", 2500.0), ("free_length", 0.93), ("preload", 40.0))
        },
        {
            "mechanism.set.leg_defaults.stiffness": 2500.0,
            "mechanism.set.leg_defaults.free_length": 0.93,
            "mechanism.set.leg_defaults.preload": 40.0,
        },
    ),
    "end stops": (
        RING,
        {f"leg[{i}].stops.min_length": 0.91 for i in range(1, 7)},
        {"mechanism.set.leg_defaults.stops.min_length": 0.91},
    ),
    "absorber": (ABSORBER, {"contact.damping": 300.0}, {"mechanism.set.contact.damping": 300.0}),
}


@pytest.mark.parametrize(("scene", "parameters", "keys"), SAME.values(), ids=SAME)
def test_a_parameter_does_what_the_scene_would(scene, parameters, keys):
    stop = HELD if "latch[1].play" in parameters else STOP
    plain = dl.run(scene, stop=stop)
    by_parameter = dl.run(scene, start_values=parameters, stop=stop)
    by_scene = dl.run(scene, keys, stop=stop)
    assert np.array_equal(by_parameter.values, by_scene.values)
    assert by_parameter.parameters == by_scene.parameters
    assert plain.parameters != by_parameter.parameters
    if "hooks" not in str(parameters) and "pushers" not in str(parameters):  # which act later
        assert not np.array_equal(by_parameter.values, plain.values)


def test_a_law_of_its_own_has_parameters_of_its_own(tmp_path):
    """Only what the law states; the rest follows the common law."""
    mechanism = json.loads((MECHANISMS / f"{PROBE}.json").read_text())
    contact = mechanism["contact"]
    contact["laws"] = {"smooth": {"friction_coefficient": 0.3, "stiffness": 3e6}}
    contact["pairs"][0].append("smooth")
    (tmp_path / f"{PROBE}.json").write_text(json.dumps(mechanism))
    scene = copy(SCENES / f"{PROBE}.toml", tmp_path)
    run = dl.run(scene, start_values={"contact.law[1].friction_coefficient": 0.05}, stop=8.0)
    contact["laws"]["smooth"]["friction_coefficient"] = 0.05
    (tmp_path / f"{PROBE}.json").write_text(json.dumps(mechanism))
    same = dl.run(scene, stop=8.0)
    assert run["time_of_contact"][-1] > 0.0
    assert np.array_equal(run.values, same.values)
    numbers = {name for name in run.parameters if name.startswith("contact.law[")}
    assert numbers == {f"contact.law[1].{name}" for name in contact["laws"]["smooth"]}


@pytest.mark.parametrize("level", ["rigid", "massless_legs"])
def test_legs_have_their_numbers_at_every_level_of_the_model(level):
    keys = {"mechanism.set.leg_defaults.damping": 700.0, "model.level": level}
    values = {f"leg[{i}].damping": 700.0 for i in range(1, 7)}
    by_parameter = dl.run(RING, {"model.level": level}, start_values=values, stop=4.0)
    by_scene = dl.run(RING, keys, stop=4.0)
    assert np.array_equal(by_parameter.values, by_scene.values)


def test_a_spring_of_a_joint_has_parameters(tmp_path):
    """Those of every spring that the file states, also of one that is all zeros."""
    spring = {"type": "joint_spring_damper", "joint": "block", "stiffness": 50.0, "damping": 2.0}
    idle = spring | {"stiffness": 0.0, "damping": 0.0}
    rest = {"joint_spring[2].rest": 0.2}
    off = {f"joint_spring[2].{name}": 0.0 for name in ("stiffness", "damping")}
    runs = [
        dl.run(write_slide(tmp_path, make_slide(3.0, idle, last), 0.1), start_values=values).values
        for last, values in (
            (spring, rest),
            (spring | {"rest": 0.2}, {}),
            (spring, off),
            (idle, {}),
            (spring, {}),
        )
    ]
    assert np.array_equal(runs[0], runs[1])
    assert np.array_equal(runs[2], runs[3])
    assert not np.array_equal(runs[0], runs[4])


def test_a_latch_can_release_on_overload():
    loads = {f"latch[{i}].rated_load": 90.0 for i in (1, 2, 3)}
    switches = {f"latch[{i}].releases_on_overload": True for i in (1, 2, 3)}
    holds = dl.run(RING, start_values=loads, stop=HELD)
    opens = dl.run(RING, start_values=loads | switches, stop=HELD)
    peak = max(holds[f"latch[{i}].force"].max() for i in (1, 2, 3))
    assert peak > 150.0
    assert holds["captured"][-1]
    assert not opens["captured"][-1]
    assert max(opens[f"latch[{i}].force"].max() for i in (1, 2, 3)) < peak


@pytest.mark.parametrize("wrong", [-3, -1, 2, 256])  # the last one would be 0 in one byte
def test_a_switch_of_an_fmu_is_zero_or_one(runs, wrong):
    name = "latch[1].releases_on_overload"
    with Host(runs.fmu(RING)) as host:
        for right in (1, 0):
            assert host.set_status({name: right}, "Boolean") == OK
            assert host.set_status({name: wrong}, "Boolean") == ERROR
            assert f"'{name}' = {wrong}: must be false (0) or true (1)" in host.last_line
            assert host.slave.getBoolean([host.reference[name]]) == [right]


BAD = {
    "leg[2].stiffness": (-1.0, "leg[2].stiffness' = -1 is below its minimum 0 N/m"),
    "leg[3].stops.toe": (0.0, "leg[3].stops.toe is 0 m; it must be above 0"),
    "leg[4].stops.min_length": (-0.1, "leg[4].stops: min_length is -0.1; it must be above 0"),
    "leg[1].stops.max_length": (0.5, "min_length 0.65 m must be below max_length 0.5 m"),
    "latch[2].play": (0.001, "latch 2: play is 0.001 m; it must be at least catch, 0.004 m"),
    "latch[1].range": (0.002, "latch 1: range is 0.002 m; it must be above catch, 0.004 m"),
    "latch[1].stiffness": (0.0, "latch 1: stiffness is 0; it must be above 0"),
    "latch[3].window": (-1.0, "latch[3].window' = -1 is below its minimum 0 m"),
    "contact.stiffness": (0.0, "contact law: stiffness is 0; it must be above 0"),
    "contact.regularisation": (0.1, "regularisation is 0.1; it must be at most 0.01"),
    "latch[1].rated_load": (-1.0, "latch[1].rated_load' = -1 is below its minimum 0 N"),
}


@pytest.mark.parametrize(("name", "value", "why"), [(n, *v) for n, v in BAD.items()], ids=BAD)
def test_bad_numbers_are_refused(name, value, why):
    with pytest.raises(UsageError, match=re.escape(why)):
        dl.run(RING, start_values={name: value}, stop=0.1)


def test_the_base_may_stand_elsewhere_on_the_interface(tmp_path):
    """A mechanism described in shifted and turned axes docks as the shipped one."""
    shift, turn = np.array([-0.3, 0.02, 0.05]), np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    mechanism = json.loads((MECHANISMS / "idss_hexapod.json").read_text())
    joint = mechanism["bodies"][0]["joint"]

    def move(point):  # from axes of A to axes of the base
        return (turn.T @ (np.array(point) - shift)).tolist()

    joint["position"], joint["rotation"] = move(joint["position"]), turn.T.tolist()
    for leg in mechanism["legs"]:
        leg["root_point"] = move(leg["root_point"])
    (tmp_path / "moved.json").write_text(json.dumps(mechanism))
    scene = copy(SCENES / f"{RING}.toml", tmp_path)
    # axes of the base to axes of A: a third of a turn about (1, 1, 1)
    keys = {
        "mechanism.name": "moved",
        "mechanism.base_position": shift.tolist(),
        "mechanism.base_attitude": [0.5, 0.5, 0.5, 0.5],
    }
    shipped = dl.run(RING, stop=STOP)
    moved = dl.run(scene, keys, stop=STOP)
    for name in ("relative.position", "ring.position", "ring.attitude", "relative.velocity"):
        assert np.allclose(moved[name], shipped[name], rtol=0.0, atol=2e-8), name
    assert np.allclose(moved["capture.force"], shipped["capture.force"], rtol=1e-3, atol=0.5)
    assert moved["time_of_capture"][-1] == pytest.approx(shipped["time_of_capture"][-1], abs=1e-6)
    moved.view(tmp_path / "moved.html")  # refuses geometry that disagrees with the run


@pytest.mark.parametrize("count", [2, 4])
def test_a_count_of_latches_that_differs_from_their_angles_is_refused(count):
    message = f"latches.count is {count}, but there are 3 angles"
    with pytest.raises(UsageError, match=message):
        dl.Docking(RING, overrides={"mechanism.set.latches.count": count})


def test_play_of_a_latch_is_above_0_in_the_file_as_in_the_parameter():
    with pytest.raises(UsageError, match=r"latches\.play is 0: must be greater than 0"):
        dl.Docking(RING, overrides={"mechanism.set.latches.play": 0})
