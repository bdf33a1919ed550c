"""Contact surfaces on several moving bodies: fingers that close around a ring.

The gripper runs its whole sequence, from open fingers to a released satellite. Energy and momentum
balance, methods agree, and a saved state repeats its bits. Three fingertips that squeeze a ring are
compared with MuJoCo, which moves the bodies under contact forces that this file computes.
"""

import json
import math
import tomllib

import mujoco
import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.runs.solution import make_solution

GRIPPER = paths.MECHANISMS / "gripper.json"
TIGHT = {"solver.rtol": 1e-10, "solver.atol_position": 1e-13, "solver.atol_velocity": 1e-13}
STEPS = [step["name"] for step in json.loads(GRIPPER.read_text())["sequence"]["steps"]]
HOLDING = ("grasped", "retract", "held", "extend")  # steps with a grasp


def list_steps(run) -> list[str]:
    """Return the steps of the sequence in the order of their times."""
    numbers = run["sequence.step"].astype(int)
    changes = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
    return [STEPS[numbers[k] - 1] for k in changes]


@pytest.fixture(scope="module")
def grasp():
    """From open fingers to the release, with a tight tolerance."""
    docking = dl.Docking("gripper")
    for name, value in TIGHT.items():
        docking.set(name, value)
    docking.set("solver.atol_energy", 1e-12)
    rows = []
    names = ("sequence.step", "captured", "energy.residual", "momentum.residual", "relative.axial")
    for k in range(650):
        if k == 200:
            docking.set("command", "undock")
        docking.step(0.1)
        rows.append([float(docking.get(name)) for name in names])
    return dict(zip(names, np.array(rows).T, strict=True))


def test_the_sequence_opens_closes_holds_retracts_and_releases(grasp):
    assert list_steps(grasp) == [
        *("open", "close", "grasped", "retract", "held", "extend", "release", "push", "separated"),
    ]
    holds = [STEPS[int(k) - 1] in HOLDING for k in grasp["sequence.step"]]
    assert np.array_equal(grasp["captured"], holds)
    assert grasp["relative.axial"][-1] > 0.2


def test_energy_and_momentum_of_the_whole_sequence_balance(grasp):
    """The closing energy is 0.25 J, the work of the drives 6.7 J."""
    assert np.max(np.abs(grasp["energy.residual"])) < 1e-8  # measured 1.2e-9
    assert np.max(grasp["momentum.residual"]) < 1e-12


def test_methods_agree_on_the_grasp():
    """Three methods, one of them with the structured matrix of all bodies in contact."""
    ends = {}
    for method, rtol in (("explicit", 1e-8), ("bdf", 1e-9), ("rosenbrock", 1e-6)):
        run = dl.run(
            "gripper",
            overrides={"solver.method": method},
            start_values={
                "solver.rtol": rtol,
                "solver.atol_position": 1e-3 * rtol,
                "solver.atol_velocity": 1e-3 * rtol,
            },
            stop=3.4,
            step=0.05,
        )
        assert run["captured"][-1], method
        names = ["time_of_capture", "relative.axial", "relative.lateral", "relative.pitch_yaw"]
        ends[method] = [run[name][-1] for name in names]
    for method in ("bdf", "rosenbrock"):
        assert ends[method] == pytest.approx(ends["explicit"], abs=1e-7), method


def test_a_saved_state_repeats_the_bits_of_a_grasp():
    docking = dl.Docking("gripper")
    for _ in range(30):
        docking.step(0.1)
    state = docking.save()

    def go_on() -> list[float]:
        for _ in range(10):
            docking.step(0.1)
        names = ("relative.axial", "element[2].coordinate", "contact.surface[3].force")
        return [float(docking.get(name)) for name in names]

    first = go_on()
    docking.restore(state)
    assert go_on() == first
    assert first[2] > 100.0


def test_closure_and_loads_decide_the_capture():
    """A finger that stays open holds nothing; a ring outside of the fingers is not enclosed."""
    lame = dl.run("gripper", start_values={"failure[1].active": True}, stop=22.0, step=0.1)
    assert lame.summary["outcome"] == "hang-up"
    assert not np.any(lame["captured"])
    outside = dl.run("gripper", overrides={"initial.lateral_offset": 0.14}, stop=22.0, step=0.1)
    assert list_steps(outside) == ["open", "close", "lost"]
    assert outside.summary["outcome"] == "miss"
    assert not np.any(outside["captured"])


@pytest.mark.parametrize(("moment", "step"), [(8.0, "retract"), (24.0, "extend")])
def test_a_lost_ring_is_noticed(moment, step):
    """The brake of a finger fails, and its drive has no torque any more."""
    docking = dl.Docking("gripper")
    docking.set("command", "undock")
    for i in (1, 2):
        docking.set(f"failure[{i}].active", True)
        docking.set(f"failure[{i}].time", moment)

    def find_step() -> str:
        return STEPS[int(docking.get("sequence.step")) - 1]

    while docking.time < moment - 0.1:
        docking.step(0.1)
    assert docking.get("captured")
    assert find_step() == step
    while docking.time < moment + 6.0:
        docking.step(0.1)
    assert not docking.get("captured")
    assert find_step() == "lost"
    assert docking.get("outcome") == 4  # rebound


# ---------------------------------------------------------------- against MuJoCo

RADIUS, TORUS, TIP = 0.5, 0.02, 0.01  # of the ring, of its section, of a fingertip [m]
STIFFNESS, TOE = 5e4, 1e-4  # N/m, m
TORQUE, SPRING, ARM = 12.0, 60.0, 0.2  # N m, N m/rad, m
CHASER = {"mass": 60.0, "inertia": [5.0, 7.0, 8.0, 0.4, -0.2, 0.3]}
TARGET = {"mass": 90.0, "inertia": [9.0, 12.0, 14.0, 0.5, 0.3, -0.6]}
START = {"position": [1.52, 0.004, -0.003], "velocity": [-0.01, 0.004, 0.006]}


def make_finger(i: int) -> dict:
    a = 0.3 + 2.0 * math.pi * i / 3
    c, s = math.cos(a), math.sin(a)
    return {
        "name": f"finger{i}",
        "parent": "base",
        "joint": {
            "type": "revolute",
            "axis": [0, 0, 1],
            "position": [0.0, 0.55 * c, 0.55 * s],
            "rotation": [[1, 0, 0], [0, c, -s], [0, s, c]],
        },
        "mass": 1.5 + 0.2 * i,
        "com": [0.1, 0.01, 0.0],
        "inertia": [[0.015, 0, 0], [0, 0.025, 0.001], [0, 0.001, 0.03]],
    }


BODIES = [make_finger(i) for i in range(3)]


def squeeze(folder, stop: float):
    """Return our run: torques and springs press three tips against the ring from outside."""
    names = [body["name"] for body in BODIES]
    points = [
        {"name": f"tip{name}", "body": name, "kind": "point", "position": [ARM, 0, 0]}
        for name in names
    ]
    ring = {"name": "ring", "kind": "revolution", "profile": [[0, RADIUS]], "rounding": TORUS}
    law = {"stiffness": STIFFNESS, "toe": TOE, "damping": 0.0, "friction_coefficient": 0.0}
    mechanism = {
        "name": "tips",
        "bodies": BODIES,
        "forces": [
            {
                "name": name,
                "along": [{"joint": name}],
                "laws": [
                    {"type": "constant", "force": -TORQUE},
                    {"type": "spring", "stages": [[0, SPRING]]},
                ],
            }
            for name in names
        ],
        "contact": {
            "type": "surfaces",
            "active": [{**point, "rounding": TIP} for point in points],
            "passive": [ring],
            "pairs": [[point["name"], "ring"] for point in points],
            "law": law,
        },
    }
    (folder / "tips.json").write_text(json.dumps(mechanism))
    scene = folder / "scene.toml"
    scene.write_text(
        f"""
[chaser]
mass = {CHASER["mass"]}
inertia = {CHASER["inertia"]}
interface_position = [0.5, 0, 0]
[target]
mass = {TARGET["mass"]}
inertia = {TARGET["inertia"]}
interface_position = [-0.8, 0, 0]
position = {START["position"]}
velocity = {START["velocity"]}
[mechanism]
name = "tips"
[solver]
rtol = 1e-10
atol_position = 1e-13
atol_velocity = 1e-13
atol_energy = 1e-12
[experiment]
stop = {stop}
step = 0.05
[outputs]
groups = ["relative", "capture", "contact", "states", "energy", "solver"]
"""
    )
    return dl.run(scene)


def make_mujoco_model() -> mujoco.MjModel:
    def say(*numbers) -> str:
        return " ".join(f"{number:.17g}" for number in np.ravel(numbers))

    def make_inertial(com, mass, matrix) -> str:
        xx, yy, zz = np.diag(matrix)
        full = say(xx, yy, zz, matrix[0][1], matrix[0][2], matrix[1][2])
        return f'<inertial pos="{say(com)}" mass="{mass}" fullinertia="{full}"/>'

    def make_vehicle(vehicle, position, inner="") -> str:
        xx, yy, zz, xy, xz, yz = vehicle["inertia"]
        matrix = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        inertial = make_inertial([0, 0, 0], vehicle["mass"], matrix)
        return f'<body pos="{say(position)}"><freejoint/>{inertial}{inner}</body>'

    fingers = ""
    for body in BODIES:
        joint, turned = body["joint"], np.zeros(4)
        mujoco.mju_mat2Quat(turned, np.ravel(np.array(joint["rotation"], float)))
        at = np.add([0.5, 0, 0], joint["position"])
        inertial = make_inertial(body["com"], body["mass"], np.array(body["inertia"]))
        fingers += (
            f'<body pos="{say(at)}" quat="{say(turned)}">'
            f'<joint type="hinge" axis="0 0 1" stiffness="{SPRING}"/>{inertial}</body>'
        )
    world = make_vehicle(CHASER, [0, 0, 0], fingers) + make_vehicle(TARGET, START["position"])
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler balanceinertia="false"/>'
        '<option timestep="1e-4" integrator="RK4" gravity="0 0 0"/>'
        f"<worldbody>{world}</worldbody></mujoco>"
    )


def press(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Apply torques of the fingers, and the forces between their tips and the ring."""
    target = model.nbody - 1
    turn = data.xmat[target].reshape(3, 3)
    centre = data.xpos[target] + turn @ [-0.8, 0, 0]
    data.qfrc_applied[:] = 0.0
    data.qfrc_applied[6:9] = -TORQUE
    for finger in range(2, target):
        tip = data.xpos[finger] + data.xmat[finger].reshape(3, 3) @ [ARM, 0, 0]
        across = turn.T @ (tip - centre)
        across[0] = 0.0
        on_ring = centre + turn @ (RADIUS / np.linalg.norm(across) * across)
        distance = np.linalg.norm(on_ring - tip)
        depth = TIP + TORUS - distance
        if depth <= 0.0:
            continue
        size = STIFFNESS * (depth**2 / (2 * TOE) if depth < TOE else depth - TOE / 2)
        force, at = size / distance * (on_ring - tip), (on_ring + tip) / 2
        for body, sign in ((target, 1.0), (finger, -1.0)):
            mujoco.mj_applyFT(model, data, sign * force, np.zeros(3), at, body, data.qfrc_applied)


def test_a_ring_between_three_fingers_moves_as_in_mujoco(tmp_path):
    stop = 0.6
    ours = squeeze(tmp_path, stop)
    model = make_mujoco_model()
    data = mujoco.MjData(model)
    data.qvel[9:12] = START["velocity"]
    mujoco.set_mjcb_control(press)
    try:
        while data.time < stop - 0.5 * model.opt.timestep:
            mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    assert np.max(ours["contact.surface[1].force"]) > 20.0
    assert np.sum(np.diff(ours["contact.surface[1].force"] > 0.0) != 0) >= 2  # it bounces
    last = {name: ours[name][-1] for name in ours.names}

    def read(name, count):
        return np.array([last[f"{name}[{i}]"] for i in range(1, count + 1)])

    for name, first in (("chaser", 0), ("target", 10)):
        assert read(f"{name}.position", 3) == pytest.approx(data.qpos[first : first + 3], abs=1e-7)
        there = data.qpos[first + 3 : first + 7]
        assert abs(read(f"{name}.attitude", 4) @ there) == pytest.approx(1.0, abs=1e-12)
    assert read("state.q", 3) == pytest.approx(data.qpos[7:10], abs=1e-6)
    assert read("state.v", 3) == pytest.approx(data.qvel[6:9], abs=1e-4)


def test_a_ring_between_three_fingers_approaches_the_solution_with_32_digits(tmp_path):
    names = ["relative.axial", "relative.position[2]", "state.q[1]", "state.q[2]", "state.q[3]"]
    ours = squeeze(tmp_path, 0.6)
    scene = str(tmp_path / "scene.toml")
    solution = make_solution(scene, names, stop=0.6, step=0.05, tolerance=1e-15)
    for name in names:
        error = np.max(np.abs(np.array(solution["output"][name]) - ours[name]))
        assert error < 5e-8, f"{name}: {error:.2g}"  # measured 5e-9 rad, 2e-10 m
    assert np.max(np.abs(ours["energy.residual"])) < 1e-7  # of 3 J


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("base", "'base'; cores move with a body"),
        ("thumb", r"active\[2\]\.body names body 'thumb', which does not exist"),
        ("passive", "belongs to active cores only"),
        ("latches", "states a grasp, but the mechanism has latches"),
        ("surface", r"contact\.surface\[9\]\.force', but there are 6 surfaces"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(tmp_path, change, message):
    mechanism = json.loads(GRIPPER.read_text())
    contact, steps = mechanism["contact"], mechanism["sequence"]["steps"]
    if change in ("base", "thumb"):
        contact["active"][1]["body"] = change
    elif change == "passive":
        contact["passive"][0]["body"] = "palm"
    elif change == "latches":
        probe = json.loads((paths.MECHANISMS / "probe_drogue.json").read_text())
        mechanism["latches"] = probe["latches"]
    else:
        steps[1]["next"][0]["when"] = {"quantity": "contact.surface[9].force", "above": 1}
    (tmp_path / "gripper.json").write_text(json.dumps(mechanism))
    scene = tmp_path / "own.toml"
    scene.write_text((paths.SCENES / "gripper.toml").read_text(encoding="utf-8"))
    assert tomllib.loads(scene.read_text())["mechanism"]["name"] == "gripper"
    with pytest.raises(UsageError, match=message):
        dl.run(scene, stop=0.1)
