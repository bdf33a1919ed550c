"""Patterns of a mechanism file: parts round the docking axis that are written once.

1. copies and twins stand where the shipped files have them, number by number;
2. a mechanism of patterns is the same mechanism: check, states, a docking;
3. reflections: axes of turns, plates with their edges, profiles, nodes;
4. numbers of a pattern are keys of the scene; bad patterns are one sentence.
"""

import copy
import json
import math
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.paths import ROOT
from dockloop.scene.patterns import expand_patterns
from test_cli import assert_refused

MECHANISMS = ROOT / "modelDescription" / "mechanisms"
SLIDE_LEG = {
    "name": "leg#",
    "root_point": {"x": -0.51, "radius": 0.62, "azimuth_deg": -3.0},
    "closing_point": {"x": -0.01, "radius": 0.6, "azimuth_deg": -57.0},
}
SIX = {"count": 3, "mirror": True, "legs": [SLIDE_LEG]}
PAWL = {"name": "pawl#", "hook": [0, 0.03, 0], "striker": [0.238, 0, 0]}


def read(name):
    return json.loads((MECHANISMS / f"{name}.json").read_text())


def expand(mechanism, **pattern):
    document = copy.deepcopy(mechanism)
    if pattern:
        document["patterns"] = [copy.deepcopy(pattern)]
    expand_patterns(document, Path("mine.json"))
    assert "patterns" not in document
    return document


def write_hexapod(folder, **changes):
    """Write a scene of a hexapod whose legs are a pattern."""
    mechanism = {**read("hexapod"), "patterns": [{**SIX, **changes}]}
    del mechanism["legs"]
    (folder / "mine.json").write_text(json.dumps(mechanism))
    text = (ROOT / "modelDescription" / "scenes" / "hexapod.toml").read_text()
    (folder / "own.toml").write_text(text.replace('name = "hexapod"', 'name = "mine"'))
    return folder / "own.toml"


# ------------------------------------------------------------------------------ 1. where they are


def test_legs_stand_where_the_shipped_files_have_them():
    for leg, shipped in zip(expand({}, **SIX)["legs"], read("hexapod")["legs"], strict=True):
        assert leg["name"] == shipped["name"]
        for end in ("root_point", "closing_point"):
            assert leg[end] == pytest.approx(shipped[end], abs=3e-16)
    shipped = read("apda_cranks")["legs"]
    cranks = expand({}, count=3, mirror=True, legs=[{**shipped[0], "name": "leg#"}])["legs"]
    for leg, own in zip(cranks, shipped, strict=True):
        assert leg["name"] == own["name"]
        for member in ("root_point", "closing_point", "axis"):
            assert leg[member] == pytest.approx(own[member], abs=1e-9)


def test_a_whole_number_may_have_a_point():
    """Some programs write 3 as 3.0 in JSON."""
    assert expand({}, **SIX) == expand({}, **{**SIX, "count": 3.0})


def test_latches_and_elements_join_those_that_are_written_out():
    shipped = read("probe_drogue")
    first = {**shipped, "latches": {**shipped["latches"], "list": []}}
    assert expand(first, count=4, latches=[PAWL])["latches"] == shipped["latches"]  # exact turns
    force = {"name": "leg#", "along": [{"joint": "leg#_rod"}], "laws": []}
    motor = {"name": "motor#", "along": [{"joint": "leg#_rotor"}], "laws": []}
    made = expand({"forces": [{"name": "own"}]}, count=2, forces=[force, motor])["forces"]
    assert [entry["name"] for entry in made] == ["own", "leg1", "motor1", "leg2", "motor2"]
    assert made[4]["along"] == [{"joint": "leg2_rotor"}]


def test_azimuths_may_be_listed_and_points_have_x_radius_and_azimuth_everywhere():
    made = expand({}, count=2, azimuth_deg=[0.0, 90.0], latches=[PAWL])["latches"]["list"]
    assert [entry["hook"] for entry in made] == [[0, 0.03, 0], [0, 0, 0.03]]
    plain = expand({"legs": [SLIDE_LEG], "leg_defaults": {"root_point": [1, 2, 3]}})
    angle = math.radians(-57.0)
    ring = [-0.01, 0.6 * math.cos(angle), 0.6 * math.sin(angle)]
    assert plain["legs"][0]["closing_point"] == pytest.approx(ring, abs=1e-16)
    assert plain["leg_defaults"]["root_point"] == [1, 2, 3]


# ------------------------------------------------------------------------- 2. the same mechanism


def test_a_hexapod_of_one_leg_docks_as_the_shipped_one(tmp_path):
    scene = write_hexapod(tmp_path)
    mine, shipped = (dl.run(name, stop=1.0) for name in (scene, "hexapod"))
    for name in ("relative.axial", "leg[4].length", "ring.position[2]", "energy.kinetic"):
        assert mine[name] == pytest.approx(shipped[name], rel=1e-9, abs=1e-9)


def test_twins_of_crank_legs_make_a_symmetric_mechanism(tmp_path):
    """A pull along the axis neither turns the ring nor moves it aside."""
    shipped = read("apda_cranks")
    leg = {**shipped["legs"][0], "name": "leg#", "stiffness": 2e3, "preload": 40.0}
    members = {name: shipped[name] for name in ("name", "leg_defaults", "capture")}
    members |= {"bodies": shipped["bodies"][:1], "gravity": [9.81, 0.0, 0.0]}

    def accelerate(**pattern):
        made = {**members, "patterns": [{"count": 3, "legs": [leg], **pattern}]}
        home = dl.check(made)["home_q"]
        state = {"q": home, "v_independent": [0.0] * 6, "tau": [0.0] * (len(home) - 1)}
        (tmp_path / "states.json").write_text(json.dumps({"states": [state]}))
        (found,) = dl.check(made, states=tmp_path / "states.json")
        return np.array(found["a"][:6])

    found = accelerate(mirror=True)  # of the ring: turn, then motion
    size = np.abs(found).max()
    assert size > 0.1
    assert np.sort(np.abs(found))[:5] == pytest.approx([0.0] * 5, abs=1e-9 * size)


# ----------------------------------------------------------------------------- 3. reflections


def find_edges(plate):
    corners = np.array(plate["corners"])
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    return {tuple(np.round(middles[k - 1], 12)) for k in plate["edges"]}


def test_plates_profiles_and_nodes_are_reflected_with_what_belongs_to_them():
    corners = [[0.0, 0.6, -0.2], [0.0, 0.6, 0.1], [0.1, 0.5, 0.05], [0.1, 0.5, -0.1]]
    plate = {"name": "petal#", "kind": "plate", "rounding": 0.01, "corners": corners}
    axis = {"position": [0.0, 0.3, 0.1], "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}
    pin = {"name": "pin#", "kind": "revolution", "profile": [[0, 0.1]], "rounding": 0.01}
    nodes = {"name": "n#", "kind": "nodes", "count": 5, "radius": 0.6, "rounding": 0.01}
    active = [{**plate, "edges": [1, 2]}, {**pin, "axis": axis}, {**nodes, "azimuth_offset_deg": 7}]
    contact = {"contact": {"type": "surfaces", "active": []}}
    made = expand(contact, count=2, mirror=True, active=active)["contact"]["active"]
    assert [entry["name"] for entry in made[:6:3]] == ["petal1", "petal2"]
    first, twin, turned = made[0], made[3], made[6]
    assert first["corners"] == corners
    assert find_edges(twin) == {(x, y, -z) for x, y, z in find_edges(first)}
    assert find_edges(turned) == {(x, -y, -z) for x, y, z in find_edges(first)}
    senses = [np.cross(*np.diff(np.array(p["corners"])[:3], axis=0)) for p in (first, twin)]
    assert senses[0][1] * senses[1][1] > 0.0
    frames = [np.array(entry["axis"]["rotation"]) for entry in made[1::3]]
    assert [np.linalg.det(frame) for frame in frames] == pytest.approx([1.0] * 4)
    assert frames[1][:, 0] == pytest.approx(frames[0][:, 0] * [1, 1, -1])  # where x of it points
    assert frames[2][:, 0] == pytest.approx(frames[0][:, 0] * [1, -1, -1])
    assert made[4]["axis"]["position"] == [0.0, 0.3, -0.1]
    assert [entry["azimuth_offset_deg"] for entry in made[2::3]] == [7, -7, 187, 173]


# ---------------------------------------------------------------------------- 4. keys and refusals


def test_cores_on_bodies_stay_in_the_axes_of_their_bodies():
    """The bodies stand at the places of the copies already."""
    tip = {"name": "tip#", "kind": "point", "body": "finger#", "position": [0.1, 0.0, 0.2]}
    contact = {"contact": {"type": "surfaces", "active": []}}
    made = expand(contact, count=3, active=[tip])["contact"]["active"]
    assert [core["body"] for core in made] == ["finger1", "finger2", "finger3"]
    assert all(core["position"] == [0.1, 0.0, 0.2] for core in made)


def test_numbers_of_a_pattern_are_keys_of_the_scene(tmp_path, dockloop):
    scene = write_hexapod(tmp_path)
    key = "mechanism.set.patterns.1.legs.1.root_point.radius"
    short, long = (
        dl.run(scene, overrides={key: radius}, stop=0.02)["leg[3].length"][0]
        for radius in (0.62, 0.7)
    )
    ends = [expand({}, **SIX)["legs"][2][end] for end in ("root_point", "closing_point")]
    far = [ends[0][0], *(0.7 / 0.62 * x for x in ends[0][1:])]
    ring = [0.25 + ends[1][0], *ends[1][1:]]  # at home its frame is 0.25 m in front of the base
    assert short == pytest.approx(math.dist(ends[0], ring), rel=1e-3)
    assert long == pytest.approx(math.dist(far, ring), rel=1e-3)
    listed = dockloop("variables", scene, "--json").out
    assert key.replace("legs.1", "legs.leg#") in listed


def test_lists_that_only_a_pattern_fills_need_not_be_there():
    shipped = read("probe_drogue")
    made = copy.deepcopy(shipped)
    del made["latches"]["list"]
    made["patterns"] = [{"count": 4, "latches": [PAWL]}]
    assert dl.check(made) == dl.check(shipped)
    head = made["contact"].pop("active")
    made["patterns"].append({"count": 1, "active": head})
    assert dl.check(made) == dl.check(shipped)
    assert "list" not in made["latches"]


def test_the_place_of_a_profile_may_have_radius_and_azimuth():
    at = {"x": 0.1, "radius": 0.2, "azimuth_deg": 90.0}
    pin = {"name": "pin", "kind": "revolution", "axis": {"position": at}}
    made = expand({"contact": {"type": "surfaces", "active": [pin], "passive": []}})
    assert made["contact"]["active"][0]["axis"]["position"] == [0.1, 0.0, 0.2]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"count": 0}, ["patterns[1].count", "0"]),
        ({"count": None}, ["patterns[1]", "count"]),
        ({"azimuth_deg": [0.0, 90.0]}, ["azimuth_deg", "2 numbers", "3 copies"]),
        ({"legs": [{**SLIDE_LEG, "name": "leg"}]}, ["'leg'", "6 times", "#"]),
        ({"legs": [{**SLIDE_LEG, "root_point": {"x": 0.0, "radius": 1.0}}]}, ["azimuth_deg"]),
        ({"legs": [{**SLIDE_LEG, "root_point": [0.0, 1.0]}]}, ["root_point"]),
        ({"legs": [{**SLIDE_LEG, "rot": 1}]}, ["patterns[1].legs[1]", "rot"]),
        ({"latches": [PAWL]}, ["patterns[1].latches", "list"]),
        ({"active": [{"name": "a#", "kind": "point", "rounding": 1}]}, ["active", "surfaces"]),
        ({"bodies": []}, ["patterns[1]", "bodies"]),
    ],
)
def test_bad_patterns_are_one_sentence(dockloop, tmp_path, changes, words):
    scene = write_hexapod(tmp_path, **changes)
    if changes.get("count", 1) is None:
        text = (tmp_path / "mine.json").read_text().replace('"count": null, ', "")
        (tmp_path / "mine.json").write_text(text)
    for arguments in (("check", tmp_path / "mine.json"), ("run", scene, "--stop", "0.1")):
        assert_refused(dockloop(*arguments), "mine", *words)
