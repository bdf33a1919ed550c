"""Mechanisms against figures that other programs computed, through `check --states` and the FMU.

``data/hexapod_r2p1r3.json``, ``crank_nested.json``, ``planar_two_loop.json``: accelerations, cut
forces, base loads and reduced equations at generic states. ``data/trajectory_hexapod_r2p1r3.json``:
a motion of 1 s. The free-floating hexapod is written out below.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from dockloop.scene.mechanism import check_mechanism
from extreme_cases.own_mechanism import (
    FIXED_BASE,
    assert_quaternion,
    capture_body_section,
    quaternion_product,
    turn,
    write_scene,
)

DATA = Path(__file__).parent / "data"
VECTORS = ("hexapod_r2p1r3", "crank_nested", "planar_two_loop")


def flat(value):
    """All numbers of nested lists and dictionaries, in order of the keys."""
    if isinstance(value, dict):
        return np.concatenate([flat(value[key]) for key in sorted(value)])
    return np.ravel(np.array(value, dtype=float))


@pytest.mark.parametrize("name", VECTORS)
def test_check_reproduces_states_of_another_program(name):
    path = DATA / f"{name}.json"
    states = json.loads(path.read_text())["states"]
    results = check_mechanism(str(path), path)
    assert len(results) == len(states) > 0
    for state, result in zip(states, results, strict=True):
        for key, expected in state["expected"].items():
            scale = max(1.0, np.max(np.abs(flat(expected))))
            assert np.max(np.abs(flat(result[key]) - flat(expected))) < 1e-11 * scale, key


def test_a_home_pose_next_to_the_key_of_the_mechanism_is_its_home_pose():
    path = DATA / "planar_two_loop.json"
    document = json.loads(path.read_text())
    mechanism, home = document["mechanism"], document["home_q"]
    for source in (str(path), document):
        report = check_mechanism(source)
        assert report["home_q"] == pytest.approx(home, abs=1e-12)
        assert not report["warnings"]
    assert "home_q" not in mechanism  # the document of the caller stays as it is
    own = document | {"mechanism": mechanism | {"home_q": home}, "home_q": [0.0] * len(home)}
    assert check_mechanism(own)["home_q"] == pytest.approx(home, abs=1e-12)


def test_a_low_level_mechanism_moves_as_in_another_program(runs, tmp_path):
    document = json.loads((DATA / "trajectory_hexapod_r2p1r3.json").read_text())
    mechanism = document["mechanism"]
    mechanism["forces"] = document["force_elements"]
    mechanism["capture"] = {"body": "ring"}
    samples = document["samples"]
    position, q = np.array(samples[0]["q"][:3]), np.array(samples[0]["q"][3:7])
    v = np.array(samples[0]["v_independent"])  # in axes of the ring
    angle = 2.0 * math.acos(q[0])
    start = capture_body_section(
        position, angle * q[1:] / np.linalg.norm(q[1:]), turn(q, v[:3]), turn(q, v[3:])
    )
    step = samples[1]["t"]
    scene = write_scene(
        tmp_path, mechanism, FIXED_BASE, start, f"[experiment]\nstop = 1.0\nstep = {step}",
        '[outputs]\ngroups = ["ring", "states", "energy", "solver"]',
    )  # fmt: skip
    gravity = tuple(f"gravity[{i}]={g}" for i, g in enumerate(mechanism["gravity"], 1))
    run = runs.run(scene, settings=gravity)
    home = np.array(mechanism["bodies"][0]["joint"]["position"])
    for row, sample in enumerate(samples):
        assert run["time"][row] == pytest.approx(sample["t"])
        at = np.array(sample["q"][:3]) + home
        assert np.max(np.abs(run.vector("ring.position")[row] - at)) < 1e-9
        assert_quaternion(run.vector("ring.attitude")[row], sample["q"][3:7], 1e-9)
        assert np.max(np.abs(run.vector("state.v")[row] - sample["v_independent"])) < 1e-8


# A base of 500 kg and a ring of 30 kg float freely, joined by six heavy legs. Computed twice by
# others (Jacobian form and Lagrangian), agreeing to 1e-12.
BASE_ANGLES = (-2.5, 2.5, 117.5, 122.5, 237.5, 242.5)
TOP_ANGLES = (310.0, 50.0, 70.0, 170.0, 190.0, 290.0)
FREE_CHASER = """
[chaser]
motion = "free"
mass = 500
inertia = [900, 1100, 1500, 0, 0, 0]
velocity = [0.01, 0, 0]
angular_velocity = [0, 0.002, 0.001]
"""
AT_2_S = {
    "ring_position": (0.043807310507, -0.015633548123, 1.982311647668),
    "ring_attitude": (0.9999840853665, 0.00296967660211, 0.00477643089554, -0.00044242793085),
    "base_position": (0.0252522153142, -0.0041301989575, -0.0170896812076),
    "base_attitude": (0.9999848423933, 0.00289526365171, 0.00466440574177, -0.00041922673760),
    "base_velocity": (0.0128959226557, -0.0021921223083, -0.0093246701705),
    "leg_lengths": (
        3.153418355592,
        3.153531227102,
        3.153473361997,
        3.153540275342,
        3.15369576913,
        3.153320900893,
    ),
}


def circle(radius, degrees):
    angle = math.radians(degrees)
    return [radius * math.cos(angle), radius * math.sin(angle), 0.0]


@pytest.fixture(scope="module")
def floating(runs, tmp_path_factory):
    """The free-floating hexapod over 2 s."""
    mechanism = {
        "name": "floating_hexapod",
        "bodies": [
            {
                "name": "ring",
                "parent": "base",
                "joint": {"type": "free", "position": [0, 0, 2]},
                "mass": 30,
                "com": [0, 0, 0],
                "inertia": [[8, 0, 0], [0, 9, 0], [0, 0, 15]],
            }
        ],
        "leg_defaults": {
            "type": "R2P1R3",
            "closing": "ring",
            "reference_axis": [0, 0, 1],
            "cylinder": {"mass": 4, "com": 0.6, "inertia_transverse": 0.5, "inertia_axial": 0},
            "rod": {"mass": 3, "com": 0.5, "inertia_transverse": 0.4, "inertia_axial": 0},
            "stiffness": 2000,
            "damping": 40,
        },
        "legs": [
            {"name": f"leg{i}", "root_point": circle(3.0, low), "closing_point": circle(1.0, high)}
            for i, (low, high) in enumerate(zip(BASE_ANGLES, TOP_ANGLES, strict=True), 1)
        ],
        "capture": {"body": "ring"},
    }
    base_rate, arm = np.array([0.0, 0.002, 0.001]), np.array([0.0, 0.0, 2.0])
    velocity = np.array([0.05, -0.03, -0.10]) - [0.01, 0.0, 0.0] - np.cross(base_rate, arm)
    rate = np.array([0.05, 0.04, -0.06]) - base_rate
    scene = write_scene(
        tmp_path_factory.mktemp("floating"), mechanism, FREE_CHASER,
        capture_body_section(np.zeros(3), np.zeros(3), velocity, rate),
        "[experiment]\nstop = 2.0\nstep = 0.5",
        '[outputs]\ngroups = ["ring", "legs", "energy", "solver"]',
    )  # fmt: skip
    return runs.run(scene)


def test_a_free_floating_hexapod_starts_with_the_stated_momentum(floating):
    linear = floating.vector("momentum.linear")[0]
    assert linear == pytest.approx([7.6833466, -1.46717431, -4.90236452], abs=1e-8)


def test_a_free_floating_hexapod_ends_where_two_other_programs_end(floating):
    base = floating.vector("chaser.position")[-1]
    attitude = floating.vector("chaser.attitude")[-1]
    assert np.max(np.abs(base - AT_2_S["base_position"])) < 1e-10
    assert_quaternion(attitude, AT_2_S["base_attitude"], 1e-10)
    assert np.max(np.abs(floating.vector("chaser.velocity")[-1] - AT_2_S["base_velocity"])) < 1e-10
    ring = base + turn(attitude, floating.vector("ring.position")[-1])
    assert np.max(np.abs(ring - AT_2_S["ring_position"])) < 1e-10
    ring_attitude = quaternion_product(attitude, floating.vector("ring.attitude")[-1])
    assert_quaternion(ring_attitude, AT_2_S["ring_attitude"], 1e-10)
    lengths = [floating[f"leg[{i}].length"][-1] for i in range(1, 7)]
    assert np.max(np.abs(np.subtract(lengths, AT_2_S["leg_lengths"]))) < 1e-10


def test_a_free_floating_hexapod_keeps_momentum_and_energy(floating):
    assert np.max(floating["momentum.residual"]) < 1e-12
    assert np.max(np.abs(floating["energy.residual"])) < 1e-9
