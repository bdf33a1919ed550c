"""Contact surfaces as data in whole dockings: a probe, its drogue and the pawls of its head.

Closed forms: a head that a force pushes along a cone slides with a = (F/m)(cos a - mu sin a); a
head behind a spring latches if the closing energy exceeds max (F(u)^2/(2 k) + E(u)) of its pawls.
"""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths, schema
from dockloop.base.errors import UsageError
from dockloop.scene.catalogue import list_entries

PROBE = paths.MECHANISMS / "probe_drogue.json"
GROUPS = '["relative", "capture", "contact", "phase", "ring", "energy", "solver"]'
TIGHT = "rtol = 1e-9\natol_position = 1e-12\natol_velocity = 1e-12\natol_energy = 1e-10"

VEHICLES = """
[chaser]
mass = 25e3
inertia = [60.5e3, 132e3, 132e3, 0, 0, 0]
interface_position = [4, 0, 0]

[target]
mass = 350e3
inertia = [4e7, 8e7, 8e7, 0, 0, 0]
interface_position = [-15, 0, 0]
"""


def write_scene(folder: Path, mechanism: dict, text: str) -> Path:
    (folder / "surfaces.json").write_text(json.dumps(mechanism))
    scene = folder / "scene.toml"
    scene.write_text(text + '\n[mechanism]\nname = "surfaces"\n')
    return scene


def read_probe() -> dict:
    return json.loads(PROBE.read_text())


def test_head_slides_along_the_cone(tmp_path):
    """A vehicle of 40 kg whose nose is the head, pushed by 300 N along the axis of the cone."""
    mass, push, friction = 40.0, 300.0, 0.2
    slope = math.atan2(0.355, 0.205)
    mechanism = read_probe()
    contact = mechanism["contact"]
    contact["active"] = contact["active"][:1]
    contact["pairs"] = [["head", "cone"]]
    contact["law"] |= {"friction_coefficient": friction, "friction_speed": 1e-4}
    # It starts at 50 mm from the mouth, as deep in the wall as the push needs.
    to_wall = 0.042 - (push * math.sin(slope) / 2e6 + 5e-5 / 2)
    x = 0.05 - to_wall * math.sin(slope)
    y = 0.40 - 0.05 * math.tan(slope) - to_wall * math.cos(slope)
    scene = write_scene(
        tmp_path,
        {"name": "nose", "contact": contact},
        f"""
[chaser]
mass = {mass}
inertia = [1e5, 1e5, 1e5, 0, 0, 0]
position = [{x}, {y}, 0]

[target]
motion = "fixed"
mass = 1e6
inertia = [1e7, 1e7, 1e7, 0, 0, 0]

[solver]
{TIGHT}

[experiment]
stop = 0.35
step = 0.01

[outputs]
groups = {GROUPS}
""",
    )
    docking = dl.Docking(scene)
    docking.set("chaser.force_ext", [push, 0.0, 0.0])
    times, speeds = [], []
    for _ in range(35):
        docking.step(0.01)
        times.append(docking.time)
        speeds.append(np.linalg.norm(docking.get("relative.velocity")))
    acceleration = push / mass * (math.cos(slope) - friction * math.sin(slope))
    found = np.polyfit(times[10:], speeds[10:], 1)[0]
    assert found == pytest.approx(acceleration, rel=2e-4)
    assert docking.get("contact.surface[1].force") == pytest.approx(
        push * math.sin(slope) * math.hypot(1.0, friction), rel=2e-3
    )
    assert abs(docking.get("energy.residual")) < 1e-6


def run_against_pawls(folder: Path, speed: float) -> bool:
    """Close in on four pawls of 20 N with a head of 0.5 kg behind a spring of 4 kN/m."""
    pawls = [[0.0, 0.03, 0.0], [0.0, 0.0, 0.03], [0.0, -0.03, 0.0], [0.0, 0.0, -0.03]]
    mechanism = {
        "name": "spring",
        "bodies": [
            {
                "name": "head",
                "parent": "base",
                "joint": {"type": "prismatic", "axis": [1, 0, 0]},
                "mass": 0.5,
                "inertia": [[1e-3, 0, 0], [0, 1e-3, 0], [0, 0, 1e-3]],
            }
        ],
        "forces": [
            {"type": "joint_spring_damper", "joint": "head", "stiffness": 4000.0, "damping": 5.0}
        ],
        "capture": {"body": "head", "position": [0.1, 0, 0]},
        "contact": read_probe()["contact"],
        "latches": [
            {
                "hook": tip,
                "striker": [0.238, 0, 0],
                "measure": "passive_plane",
                "range": 0.020,
                "catch": 0.004,
                "play": 0.005,
                "window": 0.025,
                "push_force": 20.0,
                "stiffness": 1e6,
                "damping": 4.0,
            }
            for tip in pawls
        ],
    }
    scene = write_scene(
        folder,
        mechanism,
        VEHICLES
        + f"""
[initial]
at = "first_contact"
approach_time = {0.022 / speed}
closing_speed = {speed}

[experiment]
stop = {0.06 / speed}
step = 0.05

[outputs]
groups = {GROUPS}
""",
    )
    docking = dl.Docking(scene)
    docking.step(0.06 / speed)
    assert abs(docking.get("energy.residual")) < 1e-4
    return bool(docking.get("captured"))


def test_pawls_behind_a_spring_need_the_energy_of_their_barrier(tmp_path):
    u = np.linspace(0.0, 1.0, 20001)
    force = 80.0 * np.sin(math.pi * u) ** 2
    energy = 80.0 * 0.016 / 2 * (u - np.sin(2 * math.pi * u) / (2 * math.pi))
    barrier = np.max(force**2 / (2 * 4000.0) + energy)
    least = math.sqrt(2 * barrier / (25e3 * 350e3 / 375e3))
    assert least == pytest.approx(9.9111e-3, rel=1e-4)
    assert not run_against_pawls(tmp_path, 0.98 * least)
    assert run_against_pawls(tmp_path, 1.02 * least)


@pytest.fixture(scope="module")
def probe_run(tmp_path_factory):
    """A probe docking with an offset: cone, socket, floor, pawls."""
    folder = tmp_path_factory.mktemp("probe")
    shutil.copy(PROBE, folder / PROBE.name)
    scene = folder / "probe.toml"
    scene.write_text(
        VEHICLES
        + f"""
[mechanism]
name = "probe_drogue"

[initial]
at = "first_contact"
approach_time = 0.2
closing_speed = 0.20
lateral_offset = 0.10

[solver]
{TIGHT}

[experiment]
stop = 6.0
step = 0.05

[outputs]
groups = {GROUPS}
"""
    )
    return dl.run(scene)


def test_probe_slides_into_the_socket_and_is_caught(probe_run):
    assert probe_run["captured"][-1]
    cone, socket = (probe_run[f"contact.surface[{k}].peak"][-1] for k in (3, 5))
    assert cone > 10.0
    assert socket > 0.0


def test_probe_docking_keeps_energy_and_momentum(probe_run):
    scale = np.max(probe_run["energy.kinetic"])
    assert np.max(np.abs(probe_run["energy.residual"])) <= 1e-7 * scale
    assert np.max(probe_run["momentum.residual"]) < 1e-12


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"pairs": [["head", "ring"]]}, "no two cores of opposite sides have"),
        ({"pairs": [["head", "cone", "soft"]]}, "contact.laws lacks"),
        ({"pairs": [["head"]]}, "contact.pairs[1]"),
        (
            {"active": [{"name": "head", "kind": "point", "rounding": 0.05}]},
            "has a radius of 0.045",
        ),
        ({"active": [{"name": "head", "kind": "ball", "rounding": 0.04}]}, "point, segment, plate"),
        (
            {"active": [{"name": "head", "kind": "point", "rounding": 0.04, "count": 3}]},
            "has the member 'count', which a core of kind 'point' does not have",
        ),
        ({"active": [{"name": "head", "kind": "point", "roundig": 0.04}]}, "did you mean"),
    ],
)
def test_hardware_that_makes_no_sense_is_refused(change, text):
    mechanism = read_probe()
    mechanism["contact"] |= change
    with pytest.raises(UsageError, match=text.replace("[", r"\[").replace(".", r"\.")):
        dl.check(mechanism)


@pytest.mark.parametrize(("own", "count"), [("cone", 1), ("inside", 0)])
def test_a_group_without_a_piece_has_no_outputs(tmp_path, own, count):
    """Its force would always be zero: all pieces of the profile are booked to other groups."""
    mechanism = read_probe()
    cone = next(core for core in mechanism["contact"]["passive"] if core["name"] == "cone")
    cone["piece_groups"] = ["mouth", own, "socket"]
    (tmp_path / "surfaces.json").write_text(json.dumps(mechanism))
    text = (paths.SCENES / "probe_drogue.toml").read_text(encoding="utf-8")
    scene = tmp_path / "scene.toml"
    scene.write_text(text.replace('name = "probe_drogue"', 'name = "surfaces"'))
    entries = list_entries(str(scene), patterns=["contact.surface[*].force"])
    assert sum("'cone'" in entry.meaning for entry in entries) == count
    assert len({entry.meaning for entry in entries}) == len(entries) == 8


def test_schema_accepts_the_probe():
    assert schema.find_violation(read_probe(), "mechanism") is None


def test_rings_of_both_sides_may_differ(tmp_path):
    """A passive side that states what it shares has the same bits; one without petals has none."""
    mechanism = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text())
    text = (paths.SCENES / "idss_25t_350t.toml").read_text(encoding="utf-8")
    runs = []
    for passive in (None, {"petal_tip_x": mechanism["contact"]["petal_tip_x"]}, {"petal_count": 0}):
        if passive is not None:
            mechanism["contact"]["passive"] = passive
        (tmp_path / "own.json").write_text(json.dumps(mechanism))
        scene = tmp_path / "own.toml"
        scene.write_text(text.replace('name = "idss_hexapod"', 'name = "own"'))
        runs.append(dl.run(scene, stop=6.0, step=0.05))
    same, stated, bare = runs
    assert np.array_equal(same["relative.axial"], stated["relative.axial"])
    assert np.max(np.abs(same["relative.axial"] - bare["relative.axial"])) > 1e-3
    assert np.max(np.abs(bare["energy.residual"])) < 3e-6 * bare["energy.kinetic"][0]
    assert np.max(bare["momentum.residual"]) < 1e-12
