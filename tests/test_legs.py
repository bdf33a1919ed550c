"""Legs: screws of the short form against written-out bodies; the force that a leg transmits.

The short form of ``hexapod`` is expanded here a second time, by its definition: universal joint,
cylinder, rod, rotor of the screw, spherical joint.
"""

import json
import math

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.errors import UsageError
from slides import make_element, make_slide, write_slide


def expand_leg(leg: dict, members: dict, ring_position: np.ndarray) -> tuple[list, dict, dict]:
    """Bodies, loop and coupling of a leg whose root is the base."""
    name, root = leg["name"], np.array(leg["root_point"])
    along = np.array(leg["closing_point"]) + ring_position - root
    length = float(np.linalg.norm(along))
    x = along / length
    y = np.cross((1.0, 0.0, 0.0), x)
    y /= np.linalg.norm(y)
    axes = np.column_stack((x, y, np.cross(x, y))).tolist()

    def make(part, parent, kind, axis, own=(0.0, 0.0, 0.0, 0.0), **place):
        mass, com, axial, transverse = own
        return {
            "name": f"{name}_{part}",
            "parent": parent,
            "joint": {"type": kind, "axis": axis, **place},
            "mass": mass,
            "com": [com, 0, 0],
            "inertia": np.diag((axial, transverse, transverse)).tolist(),
        }

    cylinder, rod, screw = (members[part] for part in ("cylinder", "rod", "screw"))
    tube = [cylinder[key] for key in ("mass", "com", "inertia_axial", "inertia_transverse")]
    on_rod = screw.get("carried_by") == "rod"
    tip = [rod["mass"], length - rod["com"], rod["inertia_axial"], rod["inertia_transverse"]]
    rotor = [screw[key] for key in ("mass", "com", "inertia", "inertia_transverse")]
    if on_rod:
        rotor[1] = length - rotor[1]
    place = {"position": root.tolist(), "rotation": axes}
    bodies = [
        make("cross", "base", "revolute", [0, 1, 0], **place),
        make("cyl", f"{name}_cross", "revolute", [0, 0, 1], tube),
        make("rod", f"{name}_cyl", "prismatic", [1, 0, 0], tip),
        make("rotor", f"{name}_{'rod' if on_rod else 'cyl'}", "revolute", [1, 0, 0], rotor),
    ]
    loop = {
        "name": name,
        "root": "base",
        "first": f"{name}_cross",
        "terminal": f"{name}_rod",
        "closing": "ring",
        "cut": {
            "type": "R3",
            "point_on_terminal": [length, 0, 0],
            "point_on_closing": leg["closing_point"],
        },
    }
    # Nut and thread: a rotor on the rod turns the other way for the same thread.
    ratio = (-2.0 if on_rod else 2.0) * math.pi / screw["lead"]
    coupling = {
        "name": f"{name}_screw",
        "dependent": f"{name}_rotor",
        "terms": [{"joint": f"{name}_rod", "ratio": ratio}],
    }
    return bodies, loop, coupling


@pytest.mark.parametrize("carrier", ["cylinder", "rod"])
def test_a_leg_with_a_screw_is_its_bodies(tmp_path, carrier):
    mechanism = json.loads((paths.MECHANISMS / "hexapod.json").read_text(encoding="utf-8"))
    members, legs = mechanism.pop("leg_defaults"), mechanism["legs"]
    members["screw"]["carried_by"] = carrier
    ring = np.array(mechanism["bodies"][0]["joint"]["position"])
    parts = [expand_leg(leg, members, ring) for leg in legs]
    for bodies, *_ in parts:
        mechanism["bodies"] += bodies
    mechanism["loops"] = [loop for _, loop, _ in parts]
    mechanism["couplings"] = [coupling for *_, coupling in parts]
    mechanism["legs"] = [
        {
            "name": leg["name"],
            "slide": f"{leg['name']}_rod",
            "home_length": loop["cut"]["point_on_terminal"][0],
        }
        for leg, (_, loop, _) in zip(legs, parts, strict=True)
    ]
    (tmp_path / "written.json").write_text(json.dumps(mechanism | {"name": "written"}))
    scene = (paths.SCENES / "hexapod.toml").read_text(encoding="utf-8")
    (tmp_path / "written.toml").write_text(scene.replace('name = "hexapod"', 'name = "written"'))
    settings = {"solver.rtol": 1e-9, "solver.atol_position": 1e-11, "solver.atol_velocity": 1e-11}
    carried = {"mechanism.set.leg_defaults.screw.carried_by": carrier}
    short = dl.run("hexapod", settings | carried, stop=4.0, step=0.05)
    written = dl.run(str(tmp_path / "written.toml"), settings, stop=4.0, step=0.05)
    assert short["captured"][-1]
    for name in short.names:
        if name.startswith(("relative.", "ring.", "leg[", "element[")):
            scale = np.max(np.abs(written[name])) + 1e-3
            assert np.max(np.abs(short[name] - written[name])) < 1e-6 * scale, name


MASS, STIFFNESS, ROTOR, LEAD = 40.0, 400.0, 1e-4, 0.02


def make_screw(**members: object) -> dict:
    """A block on a spring, with a rotor that a screw turns; its slide is a leg."""
    rotor = {
        "name": "rotor",
        "parent": "base",
        "joint": {"type": "revolute", "axis": [1, 0, 0]},
        "mass": 1.0,
        "inertia": [[ROTOR, 0, 0], [0, ROTOR, 0], [0, 0, ROTOR]],
    }
    terms = [{"joint": "block", "ratio": 2.0 * math.pi / LEAD}]
    mechanism = make_slide(
        MASS,
        make_element({"type": "spring", "stages": [[0, STIFFNESS]]}),
        couplings=[{"name": "screw", "dependent": "rotor", "terms": terms}],
        legs=[{"name": "rod", "slide": "block", "home_length": 0.5, **members}],
    )
    mechanism["bodies"].append(rotor)
    return mechanism


def write_legs(folder, mechanism: dict, rate: float = 0.0) -> str:
    scene = write_slide(folder, mechanism, rate)
    file = folder / "scene.toml"
    file.write_text(file.read_text().replace('groups = ["states"', 'groups = ["legs", "states"'))
    return scene


def test_the_force_of_a_leg_is_what_moves_the_body_at_its_end(tmp_path):
    """Spring and rotor act on the slide; the sum accelerates the block alone."""
    moved = MASS + ROTOR * (2.0 * math.pi / LEAD) ** 2
    docking = dl.Docking(write_legs(tmp_path, make_screw(), 0.1))
    w = math.sqrt(STIFFNESS / moved)
    for _ in range(20):
        docking.step(0.07)
        x = 0.1 / w * math.sin(w * docking.time)
        assert docking.get("leg[1].length") == pytest.approx(0.5 + x, abs=1e-8)
        force = -MASS * STIFFNESS * x / moved
        assert docking.get("leg[1].force") == pytest.approx(force, abs=1e-6)


def test_a_leg_takes_a_command(tmp_path):
    moved = MASS + ROTOR * (2.0 * math.pi / LEAD) ** 2
    docking = dl.Docking(write_legs(tmp_path, make_screw()))
    docking.set("leg[1].force_command", 10.0)
    docking.step(1e-4)
    assert docking.get("leg[1].force") == pytest.approx(10.0 * MASS / moved, rel=1e-6)
    assert docking.get("leg[1].rate") == pytest.approx(1e-4 * 10.0 / moved, rel=1e-4)


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"slide": "blocc"}, "names body 'blocc', which does not exist"),
        ({"slide": "rotor"}, "leg 'rod'.* must name a body with a prismatic joint"),
        ({"slide": "base"}, "must name a body with a prismatic joint"),
        ({"home_length": 0}, "must be greater than 0"),
        ({"stiffness": 3}, "unknown member 'stiffness'"),
    ],
)
def test_a_named_leg_that_fits_no_body_is_refused(tmp_path, members, message):
    with pytest.raises(UsageError, match=message):
        dl.Docking(write_legs(tmp_path, make_screw(**members)))


@pytest.mark.parametrize(
    ("screw", "message"),
    [
        ({"lead": 0, "inertia": 1e-5}, r"screw\.lead must not be 0"),
        ({"lead": 0.02, "gear": 0, "inertia": 1e-5}, r"screw\.gear must not be 0"),
        ({"lead": 0.02, "inertia": 1e-5, "carried_by": "ring"}, "must be one of cylinder, rod"),
        ({"lead": 0.02}, "lacks the member 'inertia'"),
    ],
)
def test_a_screw_that_cannot_turn_is_refused(screw, message):
    with pytest.raises(UsageError, match=message):
        dl.Docking("hexapod", overrides={"mechanism.set.leg_defaults.screw": screw})
