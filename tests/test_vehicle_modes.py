"""Normal modes of vehicles: scalar oscillators, coupled by their participation.

Oracles: the vehicle with the same arrays as bodies, the frequency of one mode of a free vehicle,
and sums of energy and momentum.
"""

import copy
import math

import numpy as np
import pytest

import dockloop as dl
from coupling_host import MOTION, RigidBody
from dockloop.base.errors import DockloopError
from dockloop.fmu.build import build_fmu
from dockloop.runs.vehicle_check import check_vehicles
from dockloop.scene.resolve import write_scene
from extreme_cases.fmi_host import Host
from vehicles import check_saved_states, shipped

TIGHT = {"rtol": 1e-11, "atol_position": 1e-12, "atol_velocity": 1e-12}
MASS, INERTIA = 1000.0, [900.0, 1100.0, 1300.0, 50.0, -40.0, 30.0]
PLAIN = {"mass": MASS, "inertia": INERTIA}
# General modes, which turn and displace about a point off the centre of mass.
MODES = {
    "frequency": [0.4, 1.1, 2.0],
    "damping_ratio": [0.0, 0.02, 0.01],
    "participation": [
        [9.0, -6.0, 3.0, 4.0, 8.0, -5.0],
        [0.0, 12.0, 0.0, 0.0, 2.0, 9.0],
        [3.0, 3.0, -8.0, -6.0, 1.0, 1.0],
    ],
    "point": [0.3, -0.2, 0.5],
}


def free(stop, **members):
    """Scene of bodies that nothing touches."""
    outputs = {"groups": ["relative", "capture", "phase", "energy", "solver"]}
    experiment = {"stop": stop, "step": 0.02}
    return {"solver": TIGHT, "experiment": experiment, "outputs": outputs, **members}


def rigid_matrix():
    xx, yy, zz, xy, xz, yz = INERTIA
    rigid = MASS * np.eye(6)
    rigid[3:, 3:] = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return rigid


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("form", ["participation", "effective_mass"])
def test_a_mode_of_a_free_vehicle_has_its_frequency(number, form):
    """M V + L q' = 0, q'' + L' V' + w^2 q = 0: the frequency grows by 1/sqrt(1 - L' M^-1 L)."""
    share = np.array(MODES["participation"][number])
    about = np.append(share[:3], share[3:] + np.cross(MODES["point"], share[:3]))
    f = MODES["frequency"][number]
    stated = [share.tolist()] if form == "participation" else [np.outer(share, share).tolist()]
    modes = {"frequency": [f], "coordinate": 1e-4, form: stated, "point": MODES["point"]}
    run = dl.run(free(2.0, chaser=PLAIN | {"modes": modes}))
    w = 2 * math.pi * f / math.sqrt(1 - about @ np.linalg.solve(rigid_matrix(), about))
    expected = 1e-4 * np.cos(w * run.time)
    assert run["part[1].coordinate"] == pytest.approx(expected, abs=3e-10)
    assert run["part[1].rate"] == pytest.approx(-1e-4 * w * np.sin(w * run.time), abs=3e-9)
    sign = 1.0 if form == "participation" else np.sign(share[np.argmax(np.abs(share))])
    moved = -np.linalg.solve(rigid_matrix(), about)[:3] * sign
    for k in range(3):
        shift = moved[k] * (expected - 1e-4)
        assert run[f"chaser.position[{k + 1}]"] == pytest.approx(shift, abs=1e-10)


def make_arrays():
    """Two arrays on hinges, and on which side they are."""
    part = {"mass": 150.0, "inertia": [300, 5, 300, 0, 0, 0], "joint": "hinge", "axis": [1, 0, 0]}
    part |= {"frequency": 0.3, "damping_ratio": 0.005}
    return [part | {"com": [0, 3 * s, 0], "position": [0, 1.5 * s, 0]} for s in (1, -1)]


def make_modes():
    """The same as modes of the whole vehicle: participation is momentum per rate."""
    turning = 300 + 150 * 3**2  # kg m2, about the hinge
    shares = [
        (np.array([0, 0, 150 * 3 * s, 300 + 150 * 3 * 4.5, 0, 0]) / math.sqrt(turning)).tolist()
        for s in (1, -1)
    ]
    return {"frequency": [0.3, 0.3], "damping_ratio": 0.005, "participation": shares}


def with_arrays(vehicle):
    """Mass and inertia of the vehicle with its arrays, about the same centre."""
    out = np.array([300 + 150 * 4.5**2, 5, 300 + 150 * 4.5**2, 0, 0, 0])
    inertia = (np.array(vehicle["inertia"], float) + 2 * out).tolist()
    return {"mass": vehicle["mass"] + 300, "inertia": inertia}


@pytest.mark.parametrize("name", ["chaser", "target"])
def test_a_docking_with_modes_is_that_with_arrays_as_bodies(name):
    """Modes leave out what is of second order: loads of the turning vehicle on its arrays."""
    scene = shipped("idss_25t_350t")
    scene["solver"] = {"rtol": 1e-9, "atol_position": 1e-11, "atol_velocity": 1e-11}
    scene["initial"]["approach_time"] = 0.2
    vehicle = scene[name]
    bodies = dl.run(scene | {name: vehicle | {"part": make_arrays()}}, stop=4.0)
    whole = vehicle | with_arrays(vehicle)
    modes = dl.run(scene | {name: whole | {"modes": make_modes()}}, stop=4.0)
    rigid = dl.run(scene | {name: whole}, stop=4.0)
    scale = math.sqrt(300 + 150 * 9)
    for k in (1, 2):
        turned = bodies[f"part[{k}].coordinate"]
        assert 2e-5 < np.abs(turned).max() < 1e-2
        error = np.abs(modes[f"part[{k}].coordinate"] / scale - turned).max()
        spin2 = sum(bodies[f"{name}.angular_velocity[{i}]"] ** 2 for i in (1, 2, 3)).max()
        assert error < 2.0 * spin2 / (2 * math.pi * 0.3) ** 2
    speed = f"{name}.velocity[3]"
    error = np.abs(modes[speed] - bodies[speed]).max()
    assert error < 2e-3 * np.abs(rigid[speed] - bodies[speed]).max()


@pytest.mark.parametrize("name", ["chaser", "target"])
def test_a_turning_vehicle_with_modes_keeps_energy_and_momentum(name):
    """Modes swing far and the vehicle turns fast: the equations still balance."""
    large = MODES | {"coordinate": [5.0, -3.0, 2.0], "rate": [1.0, 4.0, -9.0]}
    large["damping_ratio"] = [0.0, 0.2, 0.1]
    vehicle = PLAIN | {"modes": large, "velocity": [0.1, 0, 0.02]}
    vehicle |= {"angular_velocity": [0.2, -0.5, 0.3]}
    others = {} if name == "chaser" else {"chaser": PLAIN | {"position": [-30, 0, 0]}}
    run = dl.run(free(3.0, **{name: vehicle}, **others))
    assert np.abs(run["energy.residual"]).max() < 1e-10 * run["energy.kinetic"][0]
    assert run["energy.dissipated"][-1] > 10.0
    assert np.abs(run["momentum.residual"]).max() < 1e-13
    # Nothing depends on a velocity of the whole.
    moving = copy.deepcopy(vehicle) | {"velocity": [7.1, 3.0, 0.02]}
    again = dl.run(free(3.0, **{name: moving}, **others))
    for k in (1, 2, 3):
        same = pytest.approx(run[f"part[{k}].coordinate"], abs=1e-8)
        assert again[f"part[{k}].coordinate"] == same


def test_modes_hang_in_gravity():
    """A vehicle falls with its modes; frame O does not follow, because one vehicle is fixed."""
    fixed = PLAIN | {"motion": "fixed", "position": [30, 0, 0]}
    scene = free(2.0, chaser=PLAIN | {"modes": MODES | {"rate": [0.1, 0, 0.2]}}, target=fixed)
    docking, plain = dl.Docking(scene), dl.Docking(scene)
    docking.set("gravity", [0.0, 0.3, -9.0])
    for _ in range(20):
        docking.step(0.1)
        plain.step(0.1)
    fallen = np.array(docking.get("chaser.position")) - plain.get("chaser.position")
    assert fallen == pytest.approx([0, 0.6, -18.0], abs=1e-8)
    for number in (1, 2, 3):
        same = pytest.approx(plain.get(f"part[{number}].coordinate"), abs=1e-9)
        assert docking.get(f"part[{number}].coordinate") == same
    assert abs(docking.get("energy.residual")) < 1e-6  # of 1e5 J


@pytest.mark.parametrize("name", ["idss_25t_350t", "probe_drogue"])
def test_a_docking_of_vehicles_with_modes_balances(name):
    scene = shipped(name)
    for vehicle in ("chaser", "target"):
        scene[vehicle] = scene[vehicle] | {"modes": MODES}
    adapter = {"mass": 2000.0, "inertia": [2000, 1500, 1500, 0, 0, 0], "position": [2.5, 0, 0]}
    scene["chaser"]["adapter"] = adapter | {"joint": "elastic", "frequency": 12.0}
    scene["solver"] = {"rtol": 1e-8}
    run = dl.run(scene, stop=6.0)
    assert run["captured"][-1]
    assert np.abs(run["energy.residual"]).max() < 1e-6 * run["energy.kinetic"][0]
    assert run["momentum.residual"].max() < 1e-14
    for number in (1, 2, 3, 5, 6, 7):  # part[4] is the adapter
        assert np.ptp(run[f"part[{number}].coordinate"]) > 1e-5


@pytest.mark.parametrize("step", [0.05, 0.1])
@pytest.mark.parametrize("name", ["chaser", "target"])
def test_a_driven_vehicle_docks_with_its_modes_as_one_fmu(name, step):
    """The host has the rigid vehicle with all its mass, the FMU the modes."""
    scene = shipped("idss_25t_350t")
    scene[name] |= {"modes": MODES}
    scene["initial"]["approach_time"] = 0.5
    scene["solver"] = {"rtol": 1e-9, "atol_position": 1e-11, "atol_velocity": 1e-11}
    one = dl.run(scene, stop=2.0, step=0.1)
    scene[name] = scene[name] | {"motion": "driven"}
    coupled = dl.Docking(scene | {"coupling": {"mode": "parallel"}})
    coupled.set("coupling.expected_step", step)
    names = [f"{name}.{member}" for member in MOTION]
    inertia = np.diag([float(i) for i in scene[name]["inertia"][:3]])
    motion = [np.array(coupled.get(n)) for n in names]
    host = RigidBody(float(scene[name]["mass"]), inertia, motion)
    for _ in range(round(2.0 / step)):
        loads = [np.array(coupled.get(f"{name}.{load}_mean")) for load in ("force", "torque")]
        for n, value in zip(names, host.motion(), strict=True):
            coupled.set(n, value)
        coupled.step(step)
        host.move(*loads, step)
    for load in ("compression", "shear", "bending"):
        peak = one[f"capture.peak.{load}"][-1]
        assert coupled.get(f"capture.peak.{load}") == pytest.approx(peak, rel=1e-5), load
    assert coupled.warnings == []
    for k in (1, 2, 3):
        swing = one[f"part[{k}].coordinate"]
        most = 1e-3 * np.abs(swing).max()
        assert coupled.get(f"part[{k}].coordinate") == pytest.approx(swing[-1], abs=most)


def test_modes_in_model_exchange_move_as_in_co_simulation(tmp_path):
    """The host's own Runge-Kutta steps, through contact, against the solver inside."""
    vehicle = {"modes": MODES | {"coordinate": [0.01, 0.0, 0.02]}}
    scene = shipped("idss_25t_350t", chaser=vehicle, target=vehicle)
    scene["initial"]["approach_time"] = 0.1
    scene["solver"] = TIGHT
    inside = dl.run(scene, stop=0.6, step=0.1)
    fmu = build_fmu(str(write_scene(scene)), (), tmp_path / "modes.fmu", bare=True)
    names = [f"part[{k}].{what}" for k in range(1, 7) for what in ("coordinate", "rate")]
    with Host(fmu, exchange=True) as host:
        host.integrate(0.6, 1e-3, host.start_exchange())
        assert host.phase() == 2
        for name in (*names, *(f"relative.position[{i}]" for i in (1, 2, 3))):
            assert host.value(name) == pytest.approx(inside[name][-1], abs=1e-7), name


def test_saved_states_hold_the_motion_of_modes():
    vehicle = {"modes": MODES}
    scene = shipped("idss_25t_350t", chaser=vehicle, target=vehicle)
    check_saved_states(scene, ("part[1].coordinate", "part[6].rate", "part[2].force", "gap"))


def test_a_mode_that_swings_is_not_at_rest():
    """Bounds of free drift count what the swing does to the interface."""
    swinging = MODES | {"coordinate": [0.4, 0.0, 0.0]}
    scene = shipped("idss_25t_350t", chaser={"modes": swinging})
    scene["initial"]["approach_time"] = 10.0
    scene["solver"] = {"rtol": 1e-9}
    drifting, integrated = (
        dl.run(scene, start_values={"model.flight": flight}, stop=12.0) for flight in (1, 2)
    )
    assert drifting["part[1].coordinate"] == pytest.approx(
        integrated["part[1].coordinate"], abs=1e-6
    )
    contact = [run["time_of_contact"][-1] for run in (drifting, integrated)]
    assert contact[0] > 0.0
    assert contact[0] == pytest.approx(contact[1], abs=1e-6)


HEAVY = [[math.sqrt(900.0), 0, 0, 0, 0, 0], [math.sqrt(101.0), 0, 0, 0, 0, 0]]
ONE = {"frequency": [1.0], "participation": [[5.0, 0, 0, 0, 0, 0]]}
MIXED = (np.diag([25.0, 16.0, 0, 0, 0, 0])).tolist()


@pytest.mark.parametrize(
    ("modes", "words"),
    [
        ({"frequency": [1.0]}, ["chaser.modes", "participation", "effective_mass"]),
        (ONE | {"frequency": [1.0, 2.0]}, ["2 frequencies", "1 rows"]),
        (ONE | {"frequency": [0.0]}, ["chaser.modes.frequency", "greater than 0"]),
        (ONE | {"damping_ratio": -0.1}, ["chaser.modes.damping_ratio"]),
        (ONE | {"participation": [[0.0] * 6]}, ["participation[1]", "leave this mode out"]),
        (ONE | {"effective_mass": [MIXED]}, ["'participation' and 'effective_mass'"]),
        (
            {"frequency": [1.0], "effective_mass": [MIXED]},
            ["effective_mass[1][2]", "16 as number 2", "0 follows", "two modes"],
        ),
        (
            {"frequency": [1.0, 2.0], "participation": HEAVY},
            ["chaser.modes", "1.001 times the mass", "chaser.modes.point"],
        ),
    ],
)
def test_impossible_modes_are_refused_with_the_reason(modes, words):
    with pytest.raises(DockloopError) as error:
        dl.run(free(0.1, chaser=PLAIN | {"modes": modes}))
    assert all(word in str(error.value) for word in words), str(error.value)


def test_modes_up_to_the_whole_mass_are_taken():
    heavy = copy.deepcopy(HEAVY)
    heavy[1][0] = math.sqrt(99.0)
    modes = {"frequency": [1.0, 2.0], "participation": heavy, "rate": [0.1, 0.0]}
    run = dl.run(free(2.0, chaser=PLAIN | {"modes": modes}))
    assert np.abs(run["energy.residual"]).max() < 1e-10


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"chaser.motion": "fixed"}, ["chaser.motion", "fixed"]),
        ({"model.level": "rigid"}, ["model.level", "rigid"]),
        (
            {"solver.method": "fixed_rk4", "solver.step": 0.1},
            ["chaser.modes[3]", "2.0119 Hz", "0.1 s", "0.0791"],
        ),
    ],
)
def test_what_modes_do_not_go_with_is_refused(change, words):
    with pytest.raises(DockloopError) as error:
        dl.run(shipped("idss_25t_350t", chaser={"modes": MODES}), change, stop=0.1)
    assert all(word in str(error.value) for word in words), str(error.value)


def test_check_pairs_frequencies_of_each_mode(tmp_path):
    """Held 0.31 Hz takes 0.8 of the inertia: free 0.31/sqrt(1 - 0.8), above that of the other."""
    modes = {
        "frequency": [0.31, 0.33],
        "participation": [[0, 0, 0, 0, 0, 8000], [0, 1, 0, 0, 0, 0]],
    }
    body = {"mass": 1e5, "inertia": [8e7, 8e7, 8e7, 0, 0, 0], "modes": modes}
    scene = shipped("idss_25t_350t", target=body)
    rows = check_vehicles(scene)["parts"]
    assert [row["part"] for row in rows] == ["target.modes[1]", "target.modes[2]"]
    assert [row["held_Hz"] for row in rows] == pytest.approx([0.31, 0.33], rel=1e-6)
    assert [row["free_Hz"] for row in rows] == pytest.approx([0.693181, 0.330002], rel=1e-5)
