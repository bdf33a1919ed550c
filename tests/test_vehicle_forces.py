"""Forces between the vehicles in scenes: keys, variables, tables of files, hosts, the magnets.

The laws themselves are the subject of tests/unit/vehicle_force_test.cpp.
"""

import math
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.paths import ROOT
from dockloop.scene.catalogue import list_entries

MAGNETS = ROOT / "scripts/examples/magnets/magnets.toml"
VEHICLE = {"mass": 50.0, "inertia": [2.0, 2.0, 2.0, 0.0, 0.0, 0.0]}
SPRING = {"type": "spring", "stiffness": 800.0, "free_length": 0.2}
TIGHT = {
    "solver.rtol": 1e-11,
    "solver.atol_position": 1e-13,
    "solver.atol_velocity": 1e-13,
    "solver.atol_energy": 1e-12,
}


def make_scene(*forces: dict, gap: float = 0.3, **members: dict) -> dict:
    """Return two free vehicles whose docking interfaces are `gap` apart."""
    scene = {
        "chaser": dict(VEHICLE),
        "target": {**VEHICLE, "position": [gap, 0.0, 0.0]},
        "initial": {"at": "start"},
        "experiment": {"stop": 2.0, "step": 0.1},
        "outputs": {"groups": ["relative", "energy", "solver", "coupling"]},
        "force": [dict(force) for force in forces],
    }
    return scene | members


@pytest.mark.parametrize(
    "method", ["explicit", "bdf", "rosenbrock", "fixed_rk4", "fixed_rosenbrock", "auto"]
)
def test_methods_agree_on_a_spring(method):
    settings = {"solver.method": method, "solver.step": 1e-3, **TIGHT}
    if method in ("rosenbrock", "fixed_rosenbrock"):
        settings |= {"solver.rtol": 1e-7, "solver.atol_position": 1e-9}
    run = dl.run(make_scene(SPRING), start_values=settings)
    exact = 0.2 + 0.1 * np.cos(math.sqrt(800.0 / 25.0) * run["time"])
    bound = {"fixed_rk4": 1e-7, "rosenbrock": 1e-5, "fixed_rosenbrock": 1e-4}.get(method, 1e-7)
    assert run["relative.axial"] == pytest.approx(exact, abs=bound)
    assert run["force[1].distance"] == pytest.approx(exact, abs=bound)
    assert run["force[1].force[1]"] == pytest.approx(-800 * (exact - 0.2), abs=1600 * bound)


def test_keys_and_parameters_are_the_same_numbers():
    by_key = dl.run(make_scene(SPRING), {"force.1.stiffness": 300.0})
    by_parameter = dl.run(make_scene(SPRING), start_values={"force[1].stiffness": 300.0})
    for name in ("relative.axial", "force[1].force[1]", "energy.potential"):
        assert np.array_equal(by_key[name], by_parameter[name])
    point = dl.run(make_scene(SPRING), {"force.1.target_point.1": 0.05})
    assert point["force[1].distance"][0] == pytest.approx(0.35, abs=1e-15)
    added = {f"force.2.{member}": value for member, value in SPRING.items()}
    both = dl.run(make_scene(SPRING), added)
    assert both["energy.potential"][0] == pytest.approx(2 * 4.0, abs=1e-12)


def test_damping_is_dissipated_and_balanced():
    run = dl.run(make_scene({**SPRING, "damping": 20.0}), start_values=TIGHT)
    assert run["energy.dissipated_forces"][-1] > 1.0
    assert np.array_equal(run["energy.dissipated"], run["energy.dissipated_forces"])
    assert np.max(np.abs(run["energy.residual"])) < 1e-9


def test_the_list_of_names_knows_keys_and_variables(tmp_path):
    entries = {entry.name: entry for entry in list_entries(str(MAGNETS), (), ["force"])}
    assert entries["force.1.type"].choices == ("spring", "tether", "dipoles", "table")
    assert entries["force.1.size"].default == 0.008
    assert entries["force[1].chaser_moment[1]"].unit == "A.m2"
    assert entries["force[1].chaser_moment[1]"].default == 1.0
    assert entries["force[1].torque[3]"].unit == "N.m"


def test_a_driven_vehicle_receives_the_impulse():
    scene = make_scene(SPRING)
    scene["chaser"]["motion"] = "driven"
    free = dl.Docking(make_scene(SPRING))
    docking = dl.Docking(scene, {"coupling.mode": "sequential"})
    velocity, position, impulse, h = 0.0, 0.0, 0.0, 0.01
    for _ in range(20):
        docking.step(h)
        free.step(h)
        force = docking.get("chaser.force_mean[1]")
        position += velocity * h + 0.5 * force / 50.0 * h * h
        velocity += force / 50.0 * h
        impulse += force * h
        docking.set("chaser.position[1]", position)
        docking.set("chaser.velocity[1]", velocity)
    assert velocity == pytest.approx(free.get("chaser.velocity[1]"), abs=1e-5)
    assert impulse == pytest.approx(-50.0 * docking.get("target.velocity[1]"), abs=1e-3)
    assert docking.get("coupling.frequency") == pytest.approx(math.sqrt(800.0 / 25.0), rel=1e-6)


def test_a_table_of_a_file_is_that_of_lists(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = ["gap [mm],F1 [N],F2 [N]", "20,-8,-6", "100,-2,-1.5", "400,0,0"]
    Path("magnet.csv").write_text("\n".join(lines) + "\n")
    table = {"type": "table", "offset": [0.0, 0.1]}
    columns = {"F1 [N]": "force[1]", "F2 [N]": "force[2]"}
    rows = {"gap": [0.02, 0.1, 0.4], "force": [[-8.0, -2.0, 0.0], [-6.0, -1.5, 0.0]]}
    both = ({**table, "file": "magnet.csv", "columns": columns}, table | rows)
    runs = [dl.run(make_scene(force), {"target.position": [0.3, 0.03, 0.0]}) for force in both]
    for name in ("relative.axial", "force[1].force[2]"):
        assert np.array_equal(runs[0][name], runs[1][name])
    assert runs[0]["force[1].force[2]"][0] < 0.0
    Path("magnet.csv").write_text("\n".join([*lines[:3], lines[2]]) + "\n")
    with pytest.raises(
        UsageError, match=r"gap must increase, but in line \d it is 0\.1 m after 0\.1"
    ):
        dl.run(make_scene(both[0]))


@pytest.mark.parametrize(
    ("held", "mass"), [({"chaser": "fixed"}, 50.0), ({"target": "fixed"}, 50.0), ({}, 25.0)]
)
def test_one_vehicle_may_be_immobile(held, mass):
    scene = make_scene(SPRING)
    for vehicle, motion in held.items():
        scene[vehicle]["motion"] = motion
    run = dl.run(scene, start_values=TIGHT)
    exact = 0.2 + 0.1 * np.cos(math.sqrt(800.0 / mass) * run["time"])
    assert run["relative.axial"] == pytest.approx(exact, abs=1e-8)
    assert np.max(np.abs(run["energy.residual"])) < 1e-9


def test_energy_balances_where_adapters_carry_the_points():
    scene = make_scene({**SPRING, "target_point": [0.0, 0.1, 0.0], "damping": 3.0})
    hinge = {"mass": 4.0, "inertia": [0.1, 0.1, 0.1, 0, 0, 0], "joint": "hinge", "axis": [0, 0, 1]}
    for vehicle in ("chaser", "target"):
        scene[vehicle]["adapter"] = {**hinge, "stiffness": 60.0, "com": [0.05, 0.0, 0.0]}
    for method in ("auto", "rosenbrock"):
        run = dl.run(scene, start_values={**TIGHT, "solver.method": method})
        assert np.max(np.abs(run["energy.residual"])) < 1e-9
        assert run["momentum.residual"][-1] < 1e-12
        assert np.max(np.abs(run["part[2].coordinate"])) > 1e-3


def test_magnets_dock_two_small_satellites_from_rest():
    run = dl.run(str(MAGNETS), stop=30.0)
    assert run["captured"][0] == 0.0
    assert run["captured"][-1] == 1.0
    assert 15.0 < run["time_of_capture"][-1] < 20.0
    assert run["gap"][0] == pytest.approx(0.05, abs=0.005)
    assert run["momentum.residual"][-1] < 1e-12
    assert np.max(np.abs(run["energy.residual"])) < 1e-5  # of 40 mJ, with impacts
    assert run["capture.peak.compression"][-1] < 200.0  # the rated load


def test_a_scene_without_forces_has_no_variables_of_forces():
    scene = make_scene()
    del scene["force"]
    assert not [name for name in dl.run(scene) if "force[1]." in name or "_forces" in name]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"type": "rope"}, 'force[1].type is "rope"'),
        ({"stiffness": -1.0}, "force[1].stiffness is -1"),
        ({"stifness": 1.0}, "did you mean 'stiffness'"),
        ({"size": 0.1}, "force[1].size is no member of a force of type 'spring'"),
        ({"type": "dipoles"}, "force[1] lacks the member 'size'"),
        ({"type": "table"}, "must have either 'file' or 'gap' and 'force'"),
        ({"target_point": [-0.3, 0.0, 0.0]}, "the points of force[1] coincide"),
    ],
)
def test_a_bad_force_is_refused_in_one_sentence(changes, message):
    with pytest.raises(DockloopError) as refused:
        dl.Docking(make_scene(SPRING | changes)).step(0.1)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_force_needs_a_target():
    scene = make_scene(SPRING)
    del scene["target"]
    with pytest.raises(UsageError, match="the scene has no target"):
        dl.Docking(scene)


def test_a_result_is_known_as_one_and_made_again(dockloop, tmp_path):
    """Its columns name forces; a start at rest has no energy to compare the audit with."""
    file = tmp_path / "r.csv"
    for _ in range(2):
        made = dockloop.succeed("run", MAGNETS, "--stop", "0.1", "--no-plots", "-o", file)
    assert "force[1].force[1]" in file.read_text().partition("\n")[0]
    assert " J (0.0e+00" not in made.out
    assert dockloop("view", file, "-o", tmp_path / "v.html").status == 0


def test_a_copy_of_a_scene_takes_its_tables_along(dockloop, tmp_path):
    (tmp_path / "gap.csv").write_text("gap,force\n0.0,5.0\n0.1,1.0\n0.2,0.0\n")
    (tmp_path / "push.csv").write_text("time,chaser.force_ext[1]\n0,0\n1,1\n")
    (tmp_path / "own.toml").write_text(
        "[chaser]\nmass = 50.0\ninertia = [2.0, 2.0, 2.0, 0.0, 0.0, 0.0]\n"
        "[target]\nmass = 50.0\ninertia = [2.0, 2.0, 2.0, 0.0, 0.0, 0.0]\n"
        'position = [0.3, 0.0, 0.0]\n[initial]\nat = "start"\n'
        '[[force]]\ntype = "table"\nfile = "gap.csv"\n[[input]]\nfile = "push.csv"\n'
    )
    dockloop.succeed("new", "copy", "--from", tmp_path / "own.toml", "-o", tmp_path / "there")
    names = {path.name for path in (tmp_path / "there").iterdir()}
    assert names == {"copy.toml", "gap.csv", "push.csv"}
    assert dockloop("run", tmp_path / "there/copy.toml", "--stop", "0.1", "--no-plots").status == 0
