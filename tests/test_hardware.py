"""Drawn hardware: `dockloop check --draw` and the view take shapes and sizes from one place.

1. Hooks, pushers, faces, petals and latches stand where the mechanism file puts them.
2. A mechanism with all lengths divided by 50 gives the same drawing, but for the label of its
   ruler, and shapes of a view that are 50 times smaller: no size is that of a large ring.
3. A hull is the set of points that are nearer to its segment than its radius, where the vehicle is.
"""

import math
import re

import numpy as np
import pytest

from dockloop.base.paths import MECHANISMS, SCENES
from dockloop.base.rotations import find_matrix
from dockloop.native import core
from dockloop.scene import hardware
from dockloop.scene.find import read_json
from dockloop.scene.mechanism_drawing import draw_mechanism
from dockloop.scene.resolve import convert_degrees, resolve_scene
from dockloop.scene.shapes import place_hulls
from dockloop.view import geometry

PER_SMALL = 50
LENGTHS = {
    *("position", "root_point", "closing_point", "point_on_terminal", "point_on_closing"),
    *("hook", "striker", "points", "profile", "rounding", "radius", "range", "catch", "play"),
    *("window", "stroke", "min_length", "max_length"),
}


def shrink(node, key=""):
    """Return a mechanism with smaller lengths."""
    if isinstance(node, dict):
        return {name: shrink(value, name) for name, value in node.items()}
    if isinstance(node, list):
        return [shrink(value, key) for value in node]
    return node / PER_SMALL if key in LENGTHS and isinstance(node, int | float) else node


def read_mechanism(name):
    return read_json(MECHANISMS / f"{name}.json")


def make(name):
    return hardware.make_hardware(convert_degrees(read_mechanism(name)))


def test_the_hard_dock_stands_on_its_circles():
    document = read_mechanism("apda")["interface"]
    parts = make("apda")["interface"]
    for name, circles in (
        ("hooks", [{**document["hooks"], **row} for row in document["hooks"]["rows"]]),
        ("pushers", [document["pushers"]]),
    ):
        expected = [
            circle["radius"]
            * np.exp(1j * np.radians(circle.get("azimuth_deg", 0) + 360 * i / circle["count"]))
            for circle in circles
            for i in range(circle["count"])
        ]
        found = [complex(*shape["points"][0][1:]) for shape in parts[name]]
        assert found == pytest.approx(expected)
    lengths = {math.dist(*shape["points"]) for shape in parts["pushers"]}
    assert lengths == {document["pushers"]["stroke"]}
    assert parts["faces"][0]["points"] == [[0.0, document["faces"]["radius"]]]


@pytest.mark.parametrize(
    "nodes", [[[0.0, 0.5]], [[0.0, 0.5], [0.3, 0.1]], [[0, 1], [0, 2], [1, 2]]]
)
def test_a_profile_is_the_rounded_polyline(nodes):
    """Every point of an outline has the distance of the rounding to its piece."""
    rounding = 0.02
    profiles = hardware._make_profiles(nodes, rounding)
    assert len(profiles) == max(len(nodes) - 1, 1)
    for profile, start, end in zip(profiles, nodes, nodes[1:] or nodes, strict=False):
        a, b = np.array(start, float), np.array(end, float)
        way = b - a
        for point in np.array(profile):
            part = np.clip((point - a) @ way / (way @ way or 1.0), 0.0, 1.0)
            assert np.linalg.norm(point - a - part * way) == pytest.approx(rounding)
        assert profile[0] == pytest.approx(profile[-1])


@pytest.mark.parametrize("name", ["probe_drogue", "probe_drogue_levers"])
def test_a_small_mechanism_is_drawn_like_a_large_one(name):
    document = read_mechanism(name)
    report = core.check(document, MECHANISMS / f"{name}.json")
    slides = [b["joint"]["type"] == "prismatic" for b in document["bodies"]]
    home = [q / PER_SMALL if s else q for q, s in zip(report["home_q"], slides, strict=True)]
    ruler, place = r">[\d.]+ m?m<", r"-?\d+\.\d"
    sheets = []
    for drawn, q in ((document, report["home_q"]), (shrink(document), home)):
        sheets.append(draw_mechanism(drawn, q, report["independent"]))
    large, small = (sheet.split("bodies</text>")[0] for sheet in sheets)
    assert re.findall(ruler, large) == [">0.1 m<"]
    assert re.findall(ruler, small) != re.findall(ruler, large)
    count = [len(re.findall("<(?:circle|poly)", sheet)) for sheet in (large, small)]
    assert count[0] == count[1] > 40
    ends = [
        np.array(
            [float(x) for x in re.findall(place, re.sub(r"<text.*|.*stroke-width=\"2\".*", "", s))]
        )
        for s in (large, small)
    ]
    assert np.max(np.abs(ends[0] - ends[1])) <= 0.11  # points are written with one digit


def test_sizes_of_the_view_follow_the_hardware():
    document = {"mechanism": convert_degrees(read_mechanism("probe_drogue"))}
    large = geometry.make_geometry(document, {})
    small = geometry.make_geometry(shrink(document), {})
    assert small["extent"] == pytest.approx(large["extent"] / PER_SMALL)
    sizes = [[hook["rounding"] for hook in shapes["hooks"]] for shapes in (large, small)]
    assert sizes[1] == pytest.approx(np.array(sizes[0]) / PER_SMALL)
    head = next(core for core in large["cores"]["active"] if core["kind"] == "point")
    assert max(sizes[0]) < head["rounding"] / 2  # latches do not hide the head


HULL = {"from": [-3.0, 0.0, 0.5], "to": [1.0, 0.4, 0.0], "radius": 1.5}
TURN = {  # of A in C, and of the base in A
    "chaser.interface_position": [3.0, 0.2, -0.1],
    "chaser.interface_attitude": [0.8, 0.0, 0.6, 0.0],
    "mechanism.base_position": [0.1, -0.2, 0.3],
    "mechanism.base_attitude": [0.6, 0.8, 0.0, 0.0],
}


def find_distances(points, start, end):
    """Return distances of points from a segment."""
    way = end - start
    part = np.clip((points - start) @ way / (way @ way), 0.0, 1.0)
    return np.linalg.norm(points - start - part[:, None] * way, axis=1)


def test_a_drawn_hull_has_its_radius_about_its_segment():
    keys = TURN | {f"chaser.hull.{member}": value for member, value in HULL.items()}
    scene = resolve_scene(
        SCENES / "idss_25t_350t.toml", [f"{key}={value}" for key, value in keys.items()]
    )
    start, end = (np.array(HULL[at]) for at in ("from", "to"))
    outline = [(x, r * np.cos(a), r * np.sin(a)) for a in range(6)
               for x, r in hardware.make_hull(scene["chaser"])["profiles"][0] if r > 0]  # fmt: skip
    # The view: axes of the body.
    shape = geometry.make_geometry(scene, {})["vehicles"]["chaser"]["hull"]
    inside = np.array(shape["pose"]["p"]) + outline @ find_matrix(shape["pose"]["q"]).T
    assert find_distances(inside, start, end) == pytest.approx(HULL["radius"])
    # The drawing: axes of the base. Back to those of the body, by matrices.
    placed = np.array([place_hulls(scene)["chaser"]["place"](point) for point in outline])
    on_a = TURN["mechanism.base_position"] + placed @ find_matrix([0.6, 0.8, 0.0, 0.0]).T
    on_c = TURN["chaser.interface_position"] + on_a @ find_matrix([0.8, 0.0, 0.6, 0.0]).T
    assert find_distances(on_c, start, end) == pytest.approx(HULL["radius"])
    assert on_c == pytest.approx(inside)
