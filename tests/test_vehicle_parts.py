"""Vehicles with parts: appendages on them, adapters between them and their docking hardware.

Oracles: the frequency of two masses on a spring, clouds of particles (particles.py), sums of energy
and momentum, and the rigid vehicle that a very stiff part leaves.
"""

import json
import math

import numpy as np
import pytest

import dockloop as dl
from coupling_host import cross
from dockloop.base.errors import DockloopError
from dockloop.base.paths import MECHANISMS
from particles import Cloud, quaternion_matrix, turn
from vehicles import check_saved_states, shipped

TIGHT = {"rtol": 1e-11, "atol_position": 1e-12, "atol_velocity": 1e-12}
OUTPUTS = {"groups": ["relative", "capture", "phase", "energy", "solver"]}
PLAIN = {"mass": 800.0, "inertia": [900, 1100, 1300, 0, 0, 0], "position": [-30, 0, 0]}
HINGE = {
    "mass": 120.0,
    "com": [0.1, 2.0, 0.2],
    "inertia": [160, 20, 170, 3, 0, 1],
    "position": [-1, 1, 0.2],
    "attitude": [0.8, 0.6, 0, 0],
    "joint": "hinge",
    "axis": [0.6, 0, 0.8],
    "stiffness": 400.0,
    "damping": 3.0,
    "coordinate": 0.3,
    "rate": 0.1,
}
SLIDE = {
    "mass": 80.0,
    "position": [0.5, 0, -0.3],
    "joint": "slide",
    "axis": [0, 0.6, 0.8],
    "stiffness": 300.0,
    "coordinate": -0.1,
}
BALL = {
    "mass": 60.0,
    "com": [0, 0, -1.2],
    "inertia": [3, 4, 5, 0, 0, 0],
    "position": [0.5, -1, 0],
    "joint": "ball",
    "stiffness": [10, 20, 5],
    "coordinate": [0.2, -0.3, 0.1],
    "rate": [0.1, 0.3, 0.2],
}
ADAPTER = {
    "mass": 150.0,
    "com": [0.2, 0.05, 0],
    "inertia": [60, 50, 70, 2, 1, 3],
    "position": [1.5, 0, 0],
    "attitude": [0.96, 0, 0.28, 0],
    "joint": "elastic",
    "stiffness": [9e3, 8e3, 7e3, 6e3, 5e3, 4e3],
    "damping": [9, 8, 7, 6, 5, 4],
    "coordinate": [0.01, 0.02, -0.03, 0.04, 0.05, -0.06],
    "rate": [0.1, 0, 0, 0.1, 0, 0.2],
}
FLEXIBLE = {
    "mass": 1000.0,
    "inertia": [900, 1100, 1300, 50, -40, 30],
    "velocity": [0.1, 0, 0.02],
    "angular_velocity": [0.02, -0.05, 0.03],
    "part": [HINGE, SLIDE, BALL],
    "adapter": ADAPTER,
}


def free(stop, **members):
    """Scene of bodies that nothing touches."""
    experiment = {"stop": stop, "step": 0.02}
    return {"solver": TIGHT, "experiment": experiment, "outputs": OUTPUTS, **members}


def read_parts(run, member, numbers=range(1, 17)):
    """Last values of a member of all parts, in their order."""
    names = [n for k in numbers for n in run if n.startswith(f"part[{k}].{member}")]
    return np.array([run[n][-1] for n in names])


def last(run, name, count):
    return np.array([run[f"{name}[{i + 1}]"][-1] for i in range(count)])


@pytest.mark.parametrize("frequency", [0.3, 12.0])
def test_two_masses_on_a_spring_have_their_frequency(frequency):
    """The frequency of a part is that with the vehicle held; free, both masses move."""
    part = {"mass": 120.0, "joint": "slide", "axis": [1, 0, 0], "frequency": frequency}
    vehicle = {"mass": 1000.0, "inertia": [500, 600, 700, 0, 0, 0]}
    run = dl.run(free(20 / frequency, chaser=vehicle | {"part": [part | {"coordinate": 0.01}]}))
    w = 2 * math.pi * frequency * math.sqrt(1 + 120 / 1000)
    expected = 0.01 * np.cos(w * run.time)
    assert run["part[1].coordinate"] == pytest.approx(expected, abs=3e-10)
    assert run["part[1].rate"] == pytest.approx(-0.01 * w * np.sin(w * run.time), abs=3e-10 * w)
    force = -120 * (2 * math.pi * frequency) ** 2 * expected
    assert run["part[1].force"] == pytest.approx(force, abs=3e-8 * np.abs(force).max())
    # The sum of the momenta is zero: the vehicle moves against the part.
    moved = -120 / 1120 * (expected - 0.01)
    assert run["chaser.position[1]"] == pytest.approx(moved, abs=3e-11)


def test_the_damping_ratio_is_that_with_the_vehicle_held():
    part = {"mass": 2.0, "com": [0, 0.5, 0], "joint": "hinge", "axis": [0, 0, 1]}
    part |= {"frequency": 0.5, "damping_ratio": 0.1, "coordinate": 1e-3}
    heavy = {"mass": 1e9, "inertia": [1e9, 1e9, 1e9, 0, 0, 0]}
    run = dl.run(free(6.0, chaser=heavy | {"part": [part]}))
    w, z = math.pi, 0.1
    wd = w * math.sqrt(1 - z * z)
    swing = np.cos(wd * run.time) + z * w / wd * np.sin(wd * run.time)
    assert run["part[1].coordinate"] == pytest.approx(
        1e-3 * np.exp(-z * w * run.time) * swing, abs=1e-10
    )


@pytest.fixture(scope="module")
def cloud():
    """Coordinates of the flexible vehicle after 0.3 s, from particles."""
    model = Cloud(FLEXIBLE)
    start = [
        np.concatenate([np.ravel(p.get(key, [0.0] * len(k))) for p, k in each])
        for key in ("coordinate", "rate")
        for each in [zip(model.parts, model.kinds, strict=True)]
    ]
    motion = [*FLEXIBLE["velocity"], *FLEXIBLE["angular_velocity"]]
    return model.run(np.append(np.zeros(6), start[0]), np.append(motion, start[1]), 0.3)


@pytest.mark.parametrize("name", ["chaser", "target"])
def test_a_vehicle_with_all_kinds_of_parts_moves_as_its_particles(cloud, name):
    x, v = cloud
    others = {} if name == "chaser" else {"chaser": PLAIN}
    run = dl.run(free(0.3, **{name: FLEXIBLE}, **others))
    assert read_parts(run, "coordinate") == pytest.approx(x[6:], abs=1e-10)
    assert read_parts(run, "rate") == pytest.approx(v[6:], abs=1e-9)
    assert last(run, f"{name}.position", 3) == pytest.approx(x[:3], abs=1e-11)
    rotation = quaternion_matrix(last(run, f"{name}.attitude", 4))
    assert np.abs(rotation - turn(x[3:6])).max() < 1e-10
    assert np.abs(run["energy.residual"]).max() < 1e-8  # of 70 J
    assert run["energy.dissipated"][-1] > 0.5
    assert np.abs(run["momentum.residual"]).max() < 1e-14


def make_array(side):
    part = {"mass": 150.0, "com": [0, 3 * side, 0], "inertia": [300, 5, 300, 0, 0, 0]}
    place = {"position": [-1, 1.5 * side, 0], "joint": "hinge", "axis": [1, 0, 0]}
    return part | place | {"frequency": 0.3, "damping_ratio": 0.005}


def make_adapter(x):
    body = {"mass": 2000.0, "inertia": [2000, 1500, 1500, 0, 0, 0], "position": [x, 0, 0]}
    return body | {"joint": "elastic", "frequency": 12.0, "damping_ratio": 0.01}


@pytest.mark.parametrize("name", ["idss_25t_350t", "apda", "probe_drogue"])
def test_a_docking_of_flexible_vehicles_balances(name):
    arrays = [make_array(1), make_array(-1)]
    scene = shipped(
        name,
        chaser={"mass": 22.7e3, "part": arrays, "adapter": make_adapter(2.5)},
        target={"part": arrays, "adapter": make_adapter(-14)},
    )
    scene["solver"] = {"rtol": 1e-8}
    run = dl.run(scene, stop=8.0)
    assert run["captured"][-1]
    assert np.abs(run["energy.residual"]).max() < 1e-6 * run["energy.kinetic"][0]
    assert run["momentum.residual"].max() < 1e-14
    bent = np.abs(run["part[3].coordinate[1]"]).max()
    k = 2000 * (2 * math.pi * 12) ** 2
    assert bent > 0.2 * run["capture.peak.compression"][-1] / k  # the load goes through the spring


@pytest.mark.parametrize("name", ["chaser", "target"])
def test_a_stiff_adapter_leaves_the_rigid_vehicle(name):
    """Peaks approach those of the vehicle with its adapter as one body."""
    mass, moments, ratio = 800.0, [700.0, 600.0, 500.0], 0.3
    scene = shipped("idss_25t_350t")
    side = {"chaser": 1.0, "target": -1.0}[name]
    vehicle = scene[name]
    x = 0.95 * vehicle["interface_position"][0]
    adapter = {"mass": mass, "inertia": [*moments, 0, 0, 0], "position": [x, 0, 0]}
    adapter |= {"joint": "elastic", "frequency": 400.0, "damping_ratio": ratio}
    flexible = dl.run(shipped("idss_25t_350t", **{name: {"adapter": adapter}}), stop=3.0)
    # One body, its centre of mass shifted to the side of the adapter.
    whole = vehicle["mass"] + mass
    c = mass * x / whole
    inertia = [float(i) for i in vehicle["inertia"]]
    offset = vehicle["mass"] * c * c + mass * (x - c) ** 2
    inertia[:3] = np.array(inertia[:3]) + moments + np.array([0, offset, offset])
    place = (np.array(vehicle["interface_position"]) - [c, 0, 0]).tolist()
    members = {"mass": whole, "inertia": inertia, "interface_position": place}
    rigid = dl.run(shipped("idss_25t_350t", **{name: members}), stop=3.0)
    assert side * c > 0.0
    for load in ("compression", "shear", "bending"):
        peak = [run[f"capture.peak.{load}"][-1] for run in (flexible, rigid)]
        assert peak[0] == pytest.approx(peak[1], rel=1e-3), load
    assert flexible["time_of_capture"][-1] == pytest.approx(rigid["time_of_capture"][-1], abs=1e-3)


def test_a_part_that_swings_is_not_at_rest():
    """A mechanism far from contact becomes quiescent; a vehicle with a swinging part does not."""
    scene = shipped("idss_25t_350t", chaser={"part": [make_array(1) | {"coordinate": 0.01}]})
    scene["initial"]["approach_time"] = 20.0
    scene["solver"] = {"rtol": 1e-9}
    quiescent, integrated = (
        dl.run(scene, start_values={"model.flight": flight}, stop=15.0) for flight in (1, 2)
    )
    assert np.ptp(quiescent["part[1].coordinate"][-300:]) > 0.01
    assert quiescent["part[1].coordinate"] == pytest.approx(
        integrated["part[1].coordinate"], abs=1e-9
    )


def test_a_vehicle_at_rest_carries_its_adapter():
    """Before contact the mechanism is quiescent, and the adapter with it: a rigid body."""
    scene = shipped("idss_25t_350t", chaser={"adapter": make_adapter(2.5)})
    scene["solver"] = {"rtol": 1e-10}
    quiescent, integrated = (
        dl.run(scene, start_values={"model.flight": flight}, stop=3.0) for flight in (1, 2)
    )
    for name in ("relative.position", "relative.attitude", "relative.velocity"):
        assert quiescent.vector(name) == pytest.approx(integrated.vector(name), abs=2e-6), name
    steps = [run["solver.rhs_evaluations"][100] for run in (quiescent, integrated)]
    assert steps[0] < 0.5 * steps[1]


def test_parts_fall_with_their_vehicle():
    """In gravity that frame O does not follow: one vehicle is fixed."""
    scene = free(2.0, chaser=FLEXIBLE, target=PLAIN | {"motion": "fixed"})
    docking = dl.Docking(scene)
    docking.set("gravity", [0.0, 0.3, -9.0])
    plain = dl.Docking(free(2.0, chaser=FLEXIBLE))
    for _ in range(20):
        docking.step(0.1)
        plain.step(0.1)
    fallen = np.array(docking.get("chaser.position")) - plain.get("chaser.position")
    assert fallen == pytest.approx([0, 0.6, -18.0], abs=1e-8)
    for member in ("part[1].coordinate", "part[4].rate[5]"):
        assert docking.get(member) == pytest.approx(plain.get(member), abs=1e-8)
    assert abs(docking.get("energy.residual")) < 1e-6  # of 1e5 J


def test_saved_states_hold_the_motion_of_parts():
    scene = shipped(
        "idss_25t_350t",
        chaser={"part": [make_array(1)], "adapter": make_adapter(2.5)},
        target={"part": [make_array(-1)], "adapter": make_adapter(-14)},
    )
    check_saved_states(scene, ("part[1].coordinate", "part[4].rate[6]", "part[2].force[3]", "gap"))


class RigidHost:
    """A host that integrates one rigid vehicle with the announced loads, as in the examples."""

    def __init__(self, docking, name, mass, moments):
        self._docking, self._mass, self._moments = docking, mass, np.array(moments)
        self._names = [
            f"{name}.{n}" for n in ("position", "velocity", "attitude", "angular_velocity")
        ]
        self._loads = [f"{name}.force_mean", f"{name}.torque_mean"]
        self._state = [np.array(docking.get(n)) for n in self._names]

    def report(self):
        """Report the motion; returns the load that is announced for the step."""
        loads = [np.array(self._docking.get(n)) for n in self._loads]
        for name, value in zip(self._names, self._state, strict=True):
            self._docking.set(name, value)
        return loads

    def move(self, load, h):
        """The same step of the vehicle, under the announced load."""
        force, torque = load
        p, v, q, w = self._state

        def rate(z):
            q, w = z[:4], z[4:]
            spin = np.append(-q[1:] @ w, q[0] * w + cross(q[1:], w)) / 2
            return np.append(spin, (torque - cross(w, self._moments * w)) / self._moments)

        z, n = np.append(q, w), 20
        for _ in range(n):
            a = rate(z)
            b = rate(z + h / n / 2 * a)
            c = rate(z + h / n / 2 * b)
            z = z + h / n / 6 * (a + 2 * b + 2 * c + rate(z + h / n * c))
        q = z[:4] / np.linalg.norm(z[:4])
        self._state = [p + h * v + h * h / 2 / self._mass * force, v + h / self._mass * force, q]
        self._state.append(z[4:])


SOFT = {"mass": 300.0, "inertia": [60, 50, 50, 0, 0, 0], "joint": "slide", "axis": [1, 0, 0]}
SOFT |= {"frequency": 8.0, "damping_ratio": 0.02}


@pytest.mark.parametrize("driven", [("chaser",), ("target",), ("chaser", "target")])
@pytest.mark.parametrize("soft", ["chaser", "target"])
@pytest.mark.parametrize("step", [0.05, 0.1])
def test_driven_vehicles_dock_with_a_soft_adapter_as_one_fmu(driven, soft, step):
    """The light mass in front of the spring is inside: the border lies where it is soft."""
    scene = shipped("idss_25t_350t")
    place = [0.9 * scene[soft].get("interface_position", [0.0])[0], 0, 0]
    scene[soft] |= {"adapter": SOFT | {"position": place}, "part": [make_array(1)]}
    scene["initial"]["approach_time"] = 0.5
    scene["solver"] = {"rtol": 1e-9, "atol_position": 1e-11, "atol_velocity": 1e-11}
    one = dl.run(scene, stop=2.0, step=0.1)
    for name in driven:
        scene[name] = scene[name] | {"motion": "driven"}
    coupled = dl.Docking(scene | {"coupling": {"mode": "parallel"}})
    coupled.set("coupling.expected_step", step)
    hosts = [
        RigidHost(coupled, name, scene[name]["mass"], scene[name]["inertia"][:3]) for name in driven
    ]
    for _ in range(round(2.0 / step)):
        loads = [host.report() for host in hosts]
        coupled.step(step)
        for host, load in zip(hosts, loads, strict=True):
            host.move(load, step)
    for load in ("compression", "shear", "bending"):
        peak = one[f"capture.peak.{load}"][-1]
        assert coupled.get(f"capture.peak.{load}") == pytest.approx(peak, rel=1e-5), load
    assert coupled.warnings == []
    assert np.ptp(one["part[2].coordinate"]) > 1e-4
    swing = coupled.get("part[1].coordinate")
    assert swing == pytest.approx(one["part[1].coordinate"][-1], rel=1e-4)


HANG = {"mass": 10.0, "com": [1, 0, 0], "joint": "hinge", "axis": [0, 0, 1]}
ELASTIC = {"mass": 10.0, "inertia": [1, 1, 1, 0, 0, 0], "joint": "elastic"}


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ({k: v for k, v in HANG.items() if k != "joint"}, ["chaser.part[1]", "joint"]),
        (HANG | {"mass": 0.0}, ["chaser.part[1].mass", "greater than 0"]),
        (HANG | {"mass": -2.0}, ["chaser.part[1].mass", "-2"]),
        (HANG | {"axis": [0, 0, 2]}, ["chaser.part[1].axis", "unit vector"]),
        (HANG | {"stiffness": 5.0, "frequency": 1.0}, ["'stiffness' and 'frequency'"]),
        (HANG | {"damping": 5.0, "damping_ratio": 0.1}, ["'damping' and 'damping_ratio'"]),
        (HANG | {"damping_ratio": 0.1}, ["'damping_ratio' without 'frequency'"]),
        (HANG | {"stiffness": -5.0}, ["chaser.part[1].stiffness"]),
        (HANG | {"axis": [1, 0, 0]}, ["no inertia about the axis of its hinge"]),
        (HANG | {"inertia": [1, 1, 9, 0, 0, 0]}, ["chaser.part[1].inertia", "principal moments"]),
        (HANG | {"coordinate": [1, 2]}, ["chaser.part[1].coordinate", "1"]),
        (ELASTIC, ["is elastic", "coordinate 1", "no stiffness"]),
        (ELASTIC | {"stiffness": [1, 1, 1, 1, 1, 0]}, ["coordinate 6", "no stiffness"]),
        (ELASTIC | {"stiffness": 1.0}, ["chaser.part[1].stiffness", "list of 6"]),
        (ELASTIC | {"frequency": 1.0, "inertia": [0] * 6}, ["no inertia about an axis"]),
        (ELASTIC | {"frequency": 1.0, "axis": [0, 0, 1]}, ["chaser.part[1].axis", "hinge"]),
    ],
)
def test_impossible_parts_are_refused_with_the_reason(part, words):
    with pytest.raises(DockloopError) as error:
        dl.run(free(0.1, chaser=PLAIN | {"part": [part]}))
    assert all(word in str(error.value) for word in words), str(error.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"chaser.motion": "fixed"}, ["chaser.motion", "fixed", "parts"]),
        ({"model.level": "rigid"}, ["model.level", "rigid", "parts"]),
        ({"chaser.mass_includes_mechanism": 2}, ["mass_includes_mechanism", "adapter"]),
    ],
)
def test_what_parts_do_not_go_with_is_refused(change, words):
    scene = shipped("idss_25t_350t", chaser={"adapter": make_adapter(2.5)})
    with pytest.raises(DockloopError) as error:
        dl.run(scene, change, stop=0.1)
    assert all(word in str(error.value) for word in words), str(error.value)


def test_the_step_for_real_time_follows_the_adapter_that_hooks_and_faces_hold():
    """Closed hooks swing the adapter, not the vehicle behind its springs: sqrt(k/m)."""
    mechanism = json.loads((MECHANISMS / "apda.json").read_text())["interface"]
    hooks = mechanism["hooks"]
    stiffness = mechanism["faces"]["stiffness"]
    stiffness += hooks["stiffness"] * sum(row["count"] for row in hooks["rows"])
    for mass in (5.0, 20.0):
        soft = make_adapter(2.5) | {"mass": mass, "frequency": 1.0}
        docking = dl.Docking(shipped("apda", chaser={"adapter": soft}))
        docking.set("accuracy", -1)
        step = docking.get("solver.chosen_step")
        assert step * np.sqrt(stiffness / mass) == pytest.approx(0.25, abs=0.06), step


def test_a_key_changes_or_adds_a_part():
    scene = free(1.0, chaser=PLAIN | {"part": [SLIDE]})
    part = SLIDE | {"mass": 50.0, "position": [0.5, 0.0, 0.2]}
    keys = {"chaser.part.1.mass": 50.0, "chaser.part.1.position.3": 0.2}
    keys |= {f"chaser.part.2.{member}": value for member, value in HINGE.items()}
    by_keys = dl.run(scene, keys)
    by_file = dl.run(free(1.0, chaser=PLAIN | {"part": [part, HINGE]}))
    for name in ("part[1].coordinate", "part[2].rate", "chaser.position[3]"):
        assert by_keys[name].tolist() == by_file[name].tolist(), name


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("chaser.part.3.mass", ["2 adds a part of the chaser"]),
        ("chaser.part.1.masses", ["did you mean 'mass'"]),
        ("chaser.part.1.com.4", ["has no number '4'", "com"]),
        ("target.part.1.mass", ["part[1]", "joint"]),
    ],
)
def test_a_wrong_key_of_a_part_is_refused(key, words):
    scene = free(0.1, chaser=PLAIN | {"part": [SLIDE]}, target=PLAIN)
    with pytest.raises(DockloopError) as error:
        dl.run(scene, {key: 1.0})
    assert all(word in str(error.value) for word in words), str(error.value)


def test_a_sweep_varies_a_part(tmp_path):
    (tmp_path / "swing.toml").write_text(
        'outputs.groups = ["relative"]\nexperiment = {stop = 0.5, step = 0.1}\n'
        "[chaser]\nmass = 1e9\ninertia = [1e9, 1e9, 1e9, 0, 0, 0]\n"
        '[[chaser.part]]\nmass = 2\njoint = "slide"\naxis = [1, 0, 0]\n'
        "frequency = 0.5\ncoordinate = 0.01\n"
    )
    file = tmp_path / "tune.toml"
    file.write_text(
        'scene = "swing.toml"\noutcomes = ["part[1].coordinate"]\n[[vary]]\n'
        'type = "grid"\nname = "chaser.part.1.frequency"\nvalues = [0.5, 1.0]\n'
    )
    swing = dl.sweep(file)["part[1].coordinate"].to_numpy()
    assert swing == pytest.approx([0.0, -0.01], abs=1e-6)  # after a quarter and half a period


@pytest.mark.parametrize("side", ["chaser", "target"])
def test_time_to_contact_counts_springs_that_push_the_interface(side):
    """An adapter that starts drawn back is fastest after a quarter of its period."""
    scene = shipped("idss_25t_350t")
    adapter = {"mass": 300.0, "inertia": [60, 50, 50, 0, 0, 0], "joint": "slide", "frequency": 0.4}
    sign = {"chaser": 1.0, "target": -1.0}[side]
    place = [0.9 * scene[side]["interface_position"][0], 0, 0]
    adapter |= {"position": place, "axis": [sign, 0, 0], "coordinate": -0.1}
    scene[side] |= {"adapter": adapter}
    scene["initial"] |= {"at": "first_contact", "approach_time": 2.0}
    run = dl.run(scene, stop=5.0, step=0.02)
    contact = run["time_of_contact"][-1]
    before = (run.time < contact) & (run.time > 0.0)
    assert before.sum() > 20
    assert contact > 0.0
    bound = run["time_to_contact"][before]
    assert (bound <= contact - run.time[before] + 1e-9).all()
    assert (bound > 0.0).all()


def test_check_lists_parts_with_their_frequencies(dockloop, tmp_path):
    """A slide of 120 kg on 1000 kg is faster by sqrt(1 + 120/1000), a hinge far away is not."""
    (tmp_path / "parts.toml").write_text(
        'outputs.groups = ["relative"]\nexperiment = {stop = 0.5, step = 0.1}\n'
        "[chaser]\nmass = 1000\ninertia = [500, 600, 700, 0, 0, 0]\n"
        '[[chaser.part]]\nmass = 120\njoint = "slide"\naxis = [1, 0, 0]\n'
        "frequency = 0.5\ndamping_ratio = 0.01\ncoordinate = 0.2\n"
        '[chaser.adapter]\nmass = 10\ninertia = [1, 2, 3, 0, 0, 0]\njoint = "elastic"\n'
        "frequency = 8.0\n"
        "[target]\nmass = 9000\ninertia = [5000, 6000, 7000, 0, 0, 0]\nposition = [40, 0, 0]\n"
        "modes = {frequency = [2.0], participation = [[30, 0, 0, 0, 0, 0]]}\n"
    )
    status, out, err = dockloop("check", tmp_path / "parts.toml", "--json")
    assert status == 0, err
    rows = json.loads(out)["parts"]
    names = ["chaser.part[1]", *["chaser.adapter"] * 6, "target.modes[1]"]
    assert [row["part"] for row in rows] == names
    assert [row["on"] for row in rows] == ["chaser"] * 7 + ["target"]
    held = [row["held_Hz"] for row in rows]
    assert held == pytest.approx([0.5, *[8.0] * 6, 2.0], rel=1e-6)
    assert rows[0]["free_Hz"] == pytest.approx(0.5 * math.sqrt(1.12), rel=1e-4)
    assert rows[0]["damping_ratio"] == pytest.approx(0.01, rel=1e-4)
    turns = sorted(8 * math.sqrt(1 + part / of) for part, of in ((1, 500), (2, 600), (3, 700)))
    free = sorted(row["free_Hz"] for row in rows[1:7])
    assert free == pytest.approx(sorted([*turns, *[8 * math.sqrt(1.01)] * 3]), rel=1e-5)
    assert rows[7]["free_Hz"] == pytest.approx(2 / math.sqrt(0.9), rel=1e-6)
    status, out, err = dockloop("check", tmp_path / "parts.toml")
    assert status == 0, err
    assert max(map(len, out.splitlines())) <= 100
    assert all(word in out for word in ("hangs on", "vehicle held", "0.5292", "adapter")), out


PEAKS = ("tension", "compression", "shear", "bending", "torsion")
HOOKED = 95.0  # s: the ring of apda has been retracted, and the hooks have closed


@pytest.mark.long
@pytest.mark.parametrize(
    ("hertz", "step", "most"),
    [(8, 0.1, 1e-3), (12, 0.01, 1e-5), (20, 0.1, 1e-3)],
)
def test_hooks_close_with_the_adapter_inside(hertz, step, most):
    """2 t in front of 23 t, through retraction and hooks: the worst of five peaks of one FMU."""
    mass, main = 2000.0, 23e3
    stiffness = (2 * math.pi * hertz) ** 2 * mass * main / (mass + main)  # both ends move
    adapter = {"mass": mass, "inertia": [2000, 1500, 1500, 0, 0, 0], "position": [3, 0, 0]}
    adapter |= {"joint": "slide", "axis": [1, 0, 0], "stiffness": stiffness}
    adapter["damping"] = 0.02 * stiffness / (2 * math.pi * hertz)
    inertia = [58.5e3, 118e3, 118e3, 0, 0, 0]
    scene = shipped("apda", chaser={"mass": main, "inertia": inertia, "adapter": adapter})
    scene["initial"]["approach_time"] = 0.5
    scene["solver"] = {"rtol": 1e-9, "atol_position": 1e-11, "atol_velocity": 1e-11}
    one = dl.run(scene, stop=HOOKED, step=0.1)
    scene["chaser"]["motion"] = "driven"
    coupled = dl.Docking(scene | {"coupling": {"mode": "parallel"}})
    coupled.set("coupling.expected_step", step)
    host = RigidHost(coupled, "chaser", main, inertia[:3])
    for _ in range(round(HOOKED / step)):
        load = host.report()
        coupled.step(step)
        host.move(load, step)
    assert coupled.get("phase") == one["phase"][-1] == 7  # hard_docked
    for load in PEAKS:
        peak = one[f"capture.peak.{load}"][-1]
        assert coupled.get(f"capture.peak.{load}") == pytest.approx(peak, rel=most), load
    assert [text for text in coupled.warnings if not text.startswith("limit")] == []


@pytest.mark.parametrize("method", ["fixed_rk4", "fixed_rosenbrock"])
def test_equal_steps_that_do_not_resolve_a_part_are_refused(method):
    stiff = {"mass": 50.0, "inertia": [1.0, 1.0, 1.0, 0.0, 0.0, 0.0], "joint": "slide"}
    stiff |= {"axis": [1.0, 0.0, 0.0], "frequency": 100.0}
    change = {"chaser.part": [stiff], "solver.method": method}
    with pytest.raises(DockloopError, match=r"chaser\.part\[1\] has up to 100 Hz .* take at most"):
        dl.run("idss_25t_350t", change | {"solver.step": 0.01}, stop=0.1)
