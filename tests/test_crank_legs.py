"""Crank legs: the short form against written-out bodies, outputs, commands, refusals.

A guide ring on six cranks is expanded here a second time, by its definition: crank on the base,
universal joint at its pin, rod, spherical joint on the ring, rotor of the gear train on the base.
The axes of these bodies differ from those of the core, and so do their joint zeros.
"""

import json
import math

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.base.sections import write_text
from dockloop.native import core
from dockloop.scene.mechanism import check_mechanism, draw, report_mechanism
from dockloop.scene.shapes import find_pins
from dockloop.view import geometry
from extreme_cases.fmi_host import OK, Host

LENGTH, LEAN_DEG = 0.24, 25.0
CRANK = {"mass": 2.0, "com": 0.1, "inertia_axial": 0.002, "inertia_transverse": 0.012}
ROD = {"mass": 1.2, "com": 0.13, "inertia_axial": 0.0004, "inertia_transverse": 0.008}
CROSS = {"mass": 0.1, "inertia": 1e-4}
GEAR = {"ratio": 20.0, "inertia": 4e-5, "inertia_transverse": 3e-5, "mass": 0.3}
STIFFNESS, DAMPING, PRELOAD, FREE = 2500.0, 500.0, 3.0, 0.002
STOPS = {"min_length": -0.15, "max_length": 0.12, "stiffness": 1e6, "damping": 4, "toe": 1e-4}
MM = 1e-3
TIGHT = {"solver.rtol": 1e-10, "solver.atol_position": 1e-12, "solver.atol_velocity": 1e-12}


def turn_x(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation about a unit axis, by the formula of Rodrigues."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


HOME = np.array(  # of the ring; its axes are those of the base
    json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text(encoding="utf-8"))["bodies"][0][
        "joint"
    ]["position"]
)


def make_cranks(gear: dict | None = None) -> dict:
    """Guide ring, contact and latches of idss_hexapod on six cranks."""
    mechanism = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text(encoding="utf-8"))
    legs = []
    for place in range(3):
        for side in (-1.0, 1.0):
            turned = turn_x(math.radians(120.0 * place))
            end = turn_x(math.radians(120.0 * place + 20.0 * side)) @ (-0.01, 0.6, 0.0)
            legs.append(
                {
                    "name": f"leg{len(legs) + 1}",
                    "root_point": (turned @ (-0.08, 0.62, 0.06 * side)).tolist(),
                    "closing_point": end.tolist(),
                    "axis": (turned @ (0.0, side, 0.0)).tolist(),
                }
            )
    members = {
        "type": "R1R2R3",
        "closing": "ring",
        "crank": {"length": LENGTH, "lean_deg": LEAN_DEG, **CRANK},
        "rod": ROD,
        "cross": CROSS,
        "stiffness": STIFFNESS,
        "damping": DAMPING,
        "preload": PRELOAD,
        "free_length": FREE,
        "stops": dict(STOPS),
    }
    if gear:
        members["gear"] = gear
    return mechanism | {"name": "cranks", "leg_defaults": members, "legs": legs}


def make_body(name: str, parent: str, axis: np.ndarray, **members: object) -> dict:
    joint = {"type": "revolute", "axis": list(axis)}
    joint |= {key: members.pop(key) for key in ("position", "rotation") if key in members}
    return {"name": name, "parent": parent, "joint": joint, **members}


def make_bar(part: dict, along: np.ndarray, com: np.ndarray) -> dict:
    """Mass properties of a slender part along a unit vector, in the axes of that vector."""
    axial = np.outer(along, along)
    inertia = part["inertia_axial"] * axial + part["inertia_transverse"] * (np.eye(3) - axial)
    return {"mass": part["mass"], "com": com.tolist(), "inertia": inertia.tolist()}


def expand(leg: dict, gear: dict | None) -> tuple[list, dict, list, list]:
    """Bodies, loop, couplings and force elements of a leg.

    All bodies have the axes of the base at home, so axes of joints are skew; the crank turns the
    other way round.
    """
    name, root = leg["name"], np.array(leg["root_point"])
    axis, tip = np.array(leg["axis"]), np.array(leg["closing_point"])
    level = np.cross((1.0, 0.0, 0.0), axis)
    arm = turn(axis, math.radians(LEAN_DEG)) @ level
    rod = HOME + tip - root - LENGTH * arm
    length = float(np.linalg.norm(rod))
    along = rod / length
    second = np.cross(axis, rod - rod @ axis * axis)
    second /= np.linalg.norm(second)
    bodies = [
        make_body(f"{name}_crank", "base", -axis, position=root.tolist(),
                  **make_bar(CRANK, arm, CRANK["com"] * arm)),
        make_body(f"{name}_cross", f"{name}_crank", axis, position=(LENGTH * arm).tolist(),
                  mass=CROSS["mass"], inertia=(CROSS["inertia"] * np.eye(3)).tolist()),
        make_body(f"{name}_rod", f"{name}_cross", -second,
                  **make_bar(ROD, along, rod - ROD["com"] * along)),
    ]  # fmt: skip
    couplings = []
    if gear:
        about = np.array(gear.get("axis", axis))
        disc = {"inertia_axial": gear["inertia"], **gear}
        own = make_bar(disc, about, np.zeros(3))
        bodies.append(make_body(f"{name}_rotor", "base", about, position=root.tolist(), **own))
        terms = [{"joint": f"{name}_crank", "ratio": -gear["ratio"]}]
        couplings = [{"name": f"{name}_gear", "dependent": f"{name}_rotor", "terms": terms}]
    loop = {
        "name": name,
        "root": "base",
        "first": f"{name}_crank",
        "terminal": f"{name}_rod",
        "closing": "ring",
        "cut": {
            "type": "R3",
            "point_on_terminal": rod.tolist(),
            "point_on_closing": tip.tolist(),
        },
    }
    stop = {"type": "stop", "lower": STOPS["min_length"], "upper": STOPS["max_length"]}
    laws = [
        {"type": "spring", "stages": [[0, STIFFNESS]], "rest": FREE},
        {"type": "damper", "linear": DAMPING},
        {"type": "constant", "force": PRELOAD},
        {**stop, **{key: STOPS[key] for key in ("stiffness", "damping", "toe")}},
    ]
    travel = {"joint": f"{name}_crank", "ratio": -LENGTH}
    return bodies, loop, couplings, [{"name": name, "along": [travel], "laws": laws}]


def write_out(mechanism: dict, gear: dict | None) -> dict:
    """Return the mechanism with its legs written out."""
    parts = [expand(leg, gear) for leg in mechanism["legs"]]
    written = {k: v for k, v in mechanism.items() if k not in ("legs", "leg_defaults")}
    written["bodies"] = mechanism["bodies"] + [body for part in parts for body in part[0]]
    written["loops"] = [part[1] for part in parts]
    written["couplings"] = [coupling for part in parts for coupling in part[2]]
    written["forces"] = [force for part in parts for force in part[3]]
    written["legs"] = [
        {"name": leg["name"], "crank_joint": f"{leg['name']}_crank", "crank_length": LENGTH}
        for leg in mechanism["legs"]
    ]
    return written | {"name": "written"}


def write_scene(folder, mechanism: dict) -> str:
    """Write a mechanism and the default scene with it; return the path of the scene."""
    (folder / f"{mechanism['name']}.json").write_text(json.dumps(mechanism))
    scene = (paths.SCENES / "idss_25t_350t.toml").read_text(encoding="utf-8")
    file = folder / f"{mechanism['name']}.toml"
    file.write_text(scene.replace('name = "idss_hexapod"', f'name = "{mechanism["name"]}"'))
    return str(file)


GEARS = [None, GEAR, {**GEAR, "axis": [1.0, 0.0, 0.0]}]
IDS = ["no gear", "gear", "gear along x"]


@pytest.mark.parametrize("gear", GEARS, ids=IDS)
def test_crank_legs_are_their_bodies(tmp_path, gear):
    """Both descriptions of six crank legs dock alike.

    The crank of the second one turns backwards, so all outputs of its legs have the other sign, but
    for peaks, which have none.
    """
    mechanism = make_cranks(gear)
    files = [write_scene(tmp_path, m) for m in (mechanism, write_out(mechanism, gear))]
    short, written = (dl.run(file, TIGHT, stop=4.0, step=0.05) for file in files)
    assert short["captured"][-1]
    assert np.ptp(short["leg[1].length"]) > 5.0 * MM
    for name in short.names:
        if not name.startswith(("relative.", "ring.", "leg[", "capture.force", "capture.torque")):
            continue
        sign = -1.0 if name.startswith("leg[") and ".peak" not in name else 1.0
        scale = np.max(np.abs(written[name])) + 1e-3
        bound = 1e-5 if name.startswith("capture.") else 1e-6  # stiff contact amplifies differences
        if ".peak" in name:  # of the states that were evaluated
            bound = 1e-3
        assert np.max(np.abs(short[name] - sign * written[name])) < bound * scale, name


@pytest.mark.parametrize("gear", GEARS, ids=IDS)
def test_crank_legs_vibrate_as_their_bodies(gear):
    mechanism = make_cranks(gear)
    short, written = (check_mechanism(m) for m in (mechanism, write_out(mechanism, gear)))
    assert short["degrees_of_freedom"] == written["degrees_of_freedom"] == 6
    for key in ("frequency_rad_s", "damping_ratio"):
        values = [[mode[key] for mode in report["modes"] if key in mode]
                  for report in (short, written)]  # fmt: skip
        assert len(values[0]) >= (2 if key == "damping_ratio" else 6)
        assert values[0] == pytest.approx(values[1], rel=1e-8), key
    assert short["mass"] == pytest.approx(written["mass"])
    ends = [[(row["lower"], row["upper"]) for row in r["ranges"]] for r in (short, written)]
    assert np.array(ends[0]) == pytest.approx(np.array(ends[1]), rel=1e-6)


def test_crank_legs_with_gears_vibrate_as_a_differential_unit_of_another_program():
    """The short form of the legs of tests/data/apda_cranks.json, with its shafts and springs."""
    text = (paths.ROOT / "tests" / "data" / "apda_cranks.json").read_text(encoding="utf-8")
    written = json.loads(text)
    short = json.loads(text.replace("_gear", "_rotor"))
    legs = short.pop("loops")
    places = {body["name"]: body["joint"] for body in short["bodies"]}
    short["bodies"] = [b for b in short["bodies"] if not b["name"].startswith("leg")]
    short["couplings"] = [c for c in short["couplings"] if not c["name"].startswith("train")]
    half = 0.5 * legs[0]["cut"]["point_on_terminal"][0]
    gear = {"ratio": 90, "axis": [1, 0, 0], "inertia": 4e-5, "inertia_transverse": 4e-5}
    short["leg_defaults"] = {
        "type": "R1R2R3",
        "closing": "ring",
        "crank": {"length": LENGTH, "lean_deg": LEAN_DEG, **CRANK},
        "rod": {**ROD, "com": half},
        "gear": gear,
    }
    short["legs"] = [
        {
            "name": leg["name"],
            "root_point": places[leg["first"]]["position"],
            "closing_point": leg["cut"]["point_on_closing"],
            "axis": [row[2] for row in places[leg["first"]]["rotation"]],
        }
        for leg in legs
    ]
    modes = [check_mechanism(m)["modes"] for m in (short, written)]
    frequencies = [[mode["frequency_rad_s"] for mode in found] for found in modes]
    assert frequencies[0] == pytest.approx(frequencies[1], rel=1e-7)
    assert frequencies[0][0] == pytest.approx(3.20, abs=0.005)
    assert len(frequencies[0]) >= 6


def test_crank_legs_are_legs_of_the_fast_kind(tmp_path):
    scenes = [
        dl.Scene(write_scene(tmp_path, make_cranks(gear) | {"name": name}))
        for gear, name in ((None, "plain"), (GEAR, "geared"))
    ]
    assert all(core.has_only_legs(s.document, tmp_path) for s in scenes)
    report = check_mechanism(make_cranks())
    assert {loop["closure"] for loop in report["loops"]} == {"R1R2R3"}


@pytest.mark.parametrize("gear", [None, GEAR], ids=IDS[:2])
def test_a_command_does_its_work_along_the_travel(tmp_path, gear):
    """Without damping, force x travel of the pin is what the energy grows by."""
    mechanism = make_cranks(gear)
    mechanism["leg_defaults"] |= {"damping": 0.0}
    docking = dl.Docking(write_scene(tmp_path, mechanism), {"solver.rtol": 1e-10})
    read = [f"leg[{i}].length" for i in (2, 5)] + ["energy.kinetic", "energy.potential"]
    before = [docking.get(name) for name in read]
    assert before[:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    forces = (30.0, -20.0)
    for i, force in zip((2, 5), forces, strict=True):
        docking.set(f"leg[{i}].force_command", force)
    for _ in range(20):
        docking.step(0.02)
        change = [docking.get(name) - old for name, old in zip(read, before, strict=True)]
        work = sum(f * travel for f, travel in zip(forces, change[:2], strict=True))
        assert sum(change[2:]) == pytest.approx(work, abs=1e-6)
    assert work > 0.05


def test_the_force_of_a_crank_leg_is_its_spring_damper_and_preload(tmp_path):
    docking = dl.Docking(write_scene(tmp_path, make_cranks()))
    docking.set("leg[3].force_command", 12.0)
    for _ in range(10):
        docking.step(0.05)
        travel, rate = (docking.get(f"leg[3].{name}") for name in ("length", "rate"))
        wanted = PRELOAD - STIFFNESS * (travel - FREE) - DAMPING * rate + 12.0
        assert docking.get("leg[3].force") == pytest.approx(wanted, abs=1e-6)


def test_springs_of_crank_legs_are_parameters_at_the_pin(tmp_path):
    names = {"leg[2].stiffness": 700.0, "leg[3].damping": 45.0, "leg[1].stops.max_length": 0.11}
    mechanism = make_cranks()
    plain, by_parameter = (
        dl.run(write_scene(tmp_path, mechanism), start_values=values, stop=0.5)
        for values in ({}, names)
    )
    mechanism["legs"][1]["stiffness"] = 700.0
    mechanism["legs"][2]["damping"] = 45.0
    mechanism["legs"][0]["stops"] = STOPS | {"max_length": 0.11}
    by_file = dl.run(write_scene(tmp_path, mechanism), stop=0.5)
    assert np.array_equal(by_parameter.values, by_file.values)
    assert not np.array_equal(by_parameter.values, plain.values)


def test_derivatives_know_the_arm_of_a_crank(runs, tmp_path):
    """All laws are given, so the force of a leg grows as much as its command."""
    fmu = runs.fmu(write_scene(tmp_path, make_cranks()))
    with Host(fmu) as host:
        host.start()
        host.step(0.1)
        outputs = ["leg[1].force", "leg[2].force"]
        status, values = host.directional_derivative(outputs, ["leg[1].force_command"], [2.0])
        assert status == OK, host.last_line
        assert values == pytest.approx([2.0, 0.0], abs=1e-9)


def test_a_view_places_the_pins_where_they_are(tmp_path):
    mechanism = make_cranks()
    run = dl.run(write_scene(tmp_path, mechanism), stop=3.0, step=0.1)
    shapes = geometry.make_geometry(run.scene, {})
    ring = np.hstack([run.vector("ring.position"), run.vector("ring.attitude")])
    base = np.tile([0.0, 0, 0, 1, 0, 0, 0], (len(ring), 1))
    pins = find_pins(mechanism)
    for i, leg in enumerate(shapes["legs"], start=1):
        drawn = geometry.find_leg_length(leg, base, ring)
        assert np.max(np.abs(drawn - run[f"leg[{i}].length"])) < 1e-9
        from_root = pins[leg["name"]] - np.array(leg["root_point"])
        assert np.linalg.norm(from_root) == pytest.approx(LENGTH)
        assert from_root[0] == pytest.approx(LENGTH * math.sin(math.radians(LEAN_DEG)))


def test_a_drawing_shows_cranks_and_gears(tmp_path):
    mechanism = make_cranks(GEAR)
    draw(mechanism, check_mechanism(mechanism), tmp_path / "own.svg")
    text = (tmp_path / "own.svg").read_text()
    assert "R1R2R3 from base to ring; gear of 20" in text
    effects = write_text(report_mechanism(check_mechanism(mechanism)))
    rate = check_mechanism(mechanism)["effects"][0]["legs"][0]["rate"]
    assert rate == pytest.approx(
        0.9716, abs=5e-5
    )  # travel of pin 1 per travel of the ring, both in m
    assert "leg1 to leg6 0.9716" in effects


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d, leg: leg.update(axis=[1, 0, 0]), r"axis \(leg 'leg1'\) is parallel to the ref"),
        (lambda d, leg: leg.update(axis=[0, 2, 0]), "must be a unit vector; its length is 2"),
        (lambda d, leg: leg.pop("axis"), "lacks the member 'axis'"),
        (lambda d, leg: d.pop("crank"), "lacks the member 'crank'"),
        (lambda d, leg: d["crank"].update(length=0), "must be greater than 0"),
        (lambda d, leg: d["crank"].pop("length"), "lacks the member 'length'"),
        (lambda d, leg: d["crank"].update(lean=25), "unknown member 'lean'"),
        (lambda d, leg: leg.update(type="R2R1R3"), "must be one of R2P1R3, R1R2R3"),
        (lambda d, leg: d.update(gear={**GEAR, "ratio": 0}), r"gear\.ratio must not be 0"),
        (lambda d, leg: d.update(gear={"ratio": 3}), "lacks the member 'inertia'"),
        (lambda d, leg: d.update(gear={**GEAR, "axis": [0, 0, 3]}), "gear.axis must be a unit"),
        (
            lambda d, leg: d["stops"].update(min_length=0.01),
            "the home length 0 m must lie between min_length and max_length, 0.01 m and ",
        ),
        (
            lambda d, leg: d["stops"].update(min_length=0.5, max_length=0.3),
            "min_length 0.5 m must be below max_length 0.3 m",
        ),
        (
            lambda d, leg: leg.update(screw={"lead": 0.02, "inertia": 1e-5}),
            "screw is a member of legs of type R2P1R3; this leg has type R1R2R3",
        ),
        (
            lambda d, leg: d.update(cylinder={**ROD}),
            r"leg_defaults\.cylinder is a member of legs of type R2P1R3; no leg here has this",
        ),
    ],
)
def test_a_crank_leg_that_cannot_be_is_refused(change, message):
    mechanism = make_cranks()
    change(mechanism["leg_defaults"], mechanism["legs"][0])
    with pytest.raises(UsageError, match=message):
        check_mechanism(mechanism)


def place_tip(mechanism: dict, beyond: float, aside: float = 0.0) -> None:
    """Put the closing point of leg 1 so far from its pin: along the crank, and along its axis."""
    leg = mechanism["legs"][0]
    axis = np.array(leg["axis"])
    arm = turn(axis, math.radians(LEAN_DEG)) @ np.cross((1.0, 0.0, 0.0), axis)
    tip = leg["root_point"] + (LENGTH + beyond) * arm + aside * axis
    leg["closing_point"] = (tip - HOME).tolist()


@pytest.mark.parametrize(
    ("beyond", "aside", "message"),
    [
        (0.3, 0.05, "is stretched or folded at home"),
        (-0.1, 0.05, "is stretched or folded at home"),
        (0.0, 0.0, "has a rod without length"),
        (0.0, 0.3, "has a rod parallel to the crank axis at home"),
    ],
)
def test_a_crank_leg_without_grip_at_home_is_refused(beyond, aside, message):
    mechanism = make_cranks()
    place_tip(mechanism, beyond, aside)
    with pytest.raises(UsageError, match=rf"legs\[1\] \(leg 'leg1'\) {message}"):
        check_mechanism(mechanism)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"crank_joint": "leg1_cronk"}, "names body 'leg1_cronk', which does not exist"),
        ({"crank_joint": "ring"}, r"\(leg 'leg1'\) must name a body with a revolute joint"),
        ({"crank_joint": "base"}, "must name a body with a revolute joint"),
        ({"crank_joint": "leg2_crank"}, "is the crank of leg 'leg1' already"),
        ({"crank_length": -0.1}, "must be greater than 0"),
        ({"home_length": 0.1}, "unknown member 'home_length'"),
    ],
)
def test_a_named_crank_that_fits_no_body_is_refused(change, message):
    mechanism = write_out(make_cranks(), None)
    mechanism["legs"][0] |= change
    with pytest.raises(UsageError, match=message):
        check_mechanism(mechanism)


def test_a_slide_leg_has_no_members_of_a_crank():
    mechanism = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text(encoding="utf-8"))
    mechanism["legs"][2]["crank"] = {"length": 0.2}
    with pytest.raises(UsageError, match=r"legs\[3\]\.crank is a member of legs of type R1R2R3"):
        check_mechanism(mechanism)
    del mechanism["legs"][2]["crank"]
    mechanism["leg_defaults"]["stops"]["min_length"] = -0.1
    with pytest.raises(UsageError, match=r"min_length is -0\.1; it must be above 0"):
        check_mechanism(mechanism)


def test_both_leg_types_share_defaults():
    """Three cranks and three slides: members of both types stand in leg_defaults."""
    mechanism = make_cranks()
    slides = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text(encoding="utf-8"))
    mechanism["leg_defaults"]["cylinder"] = slides["leg_defaults"]["cylinder"]
    del mechanism["leg_defaults"]["stops"], mechanism["leg_defaults"]["free_length"]
    mechanism["legs"][3:] = [leg | {"type": "R2P1R3"} for leg in slides["legs"][3:]]
    report = check_mechanism(mechanism)
    assert [loop["closure"] for loop in report["loops"]].count("R1R2R3") == 3
    assert report["degrees_of_freedom"] == 6
