"""Shapes of legs and docking hardware at home, for all drawings and the view."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dockloop.base.palette import (
    ACTIVE_FILL,
    CHASER,
    CHASER_EDGE,
    INK,
    LATCH,
    PAPER,
    RING,
    SOFT,
    TARGET,
    TARGET_EDGE,
)
from dockloop.base.rotations import find_matrix, invert_poses, join_poses
from dockloop.native.variables import VEHICLES
from dockloop.scene.hardware import list_active, list_hooks, make_hardware, make_hull
from dockloop.scene.sheet import Drawing, Vector, View

_STRAIGHT = 1e-4  # m: nearer to a line is on it; files of other tools have rounded numbers


def find_body_places(
    mechanism: dict, home_q: Sequence[float] = ()
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return rotation and position of every listed body at home, axes and origin of the base.

    Args:
        mechanism: its description.
        home_q: coordinates of the joints, body by body; default: where the joints have their zero.
    """
    places = {"base": (np.eye(3), np.zeros(3))}
    rest = list(home_q)
    for body in mechanism.get("bodies", []):
        joint = body["joint"]
        count = 7 if joint["type"] == "free" else 1
        q = rest[:count] or [0, 0, 0, 1, 0, 0, 0][:count]
        del rest[:count]
        rotation, position = places[body["parent"]]
        position = position + rotation @ np.array(joint.get("position", (0, 0, 0)), float)
        rotation = rotation @ np.array(joint.get("rotation", np.eye(3)), float)
        if joint["type"] == "free":
            position, turn = position + rotation @ np.array(q[:3]), tuple(q[3:])
        elif joint["type"] == "prismatic":
            position, turn = position + rotation @ (q[0] * np.array(joint["axis"])), (1, 0, 0, 0)
        else:
            turn = (math.cos(q[0] / 2), *(math.sin(q[0] / 2) * np.array(joint["axis"])))
        places[body["name"]] = rotation @ find_matrix(turn), position
    return places


def list_legs(mechanism: dict) -> list[dict]:
    """Return all legs, with their defaults: listed ones, then those that are written out.

    Each has at least ``name``, ``root``, ``closing``, ``root_point`` and ``closing_point``. A leg
    that is written out is a loop through two turns at the root, a slide and a ball on one line; it
    also has ``bodies``, the names of the bodies between its ends, and ``length`` where the slide
    has its zero. It has the name that ``legs`` gives to its slide, otherwise that of the loop.
    A listed crank leg also has ``pin``: from the root point to the crank pin at home, axes of the
    root. Crank legs that are written out are not returned: their bodies are shown as bodies.
    """
    defaults = {"root": "base", **mechanism.get("leg_defaults", {})}
    listed = mechanism.get("legs", [])
    legs = [{**defaults, **leg} for leg in listed if not {"slide", "crank_joint"} & leg.keys()]
    for leg in legs:
        if leg["type"] == "R1R2R3":
            leg["pin"] = _find_pin(leg)
    names_of_slides = {leg["slide"]: leg["name"] for leg in listed if "slide" in leg}
    places = find_body_places(mechanism)
    bodies = {body["name"]: body for body in mechanism.get("bodies", [])}
    for loop in mechanism.get("loops", []):
        chain = [bodies[loop["terminal"]]]
        while chain[0]["name"] != loop["first"]:
            chain.insert(0, bodies[chain[0]["parent"]])
        joints = [body["joint"] for body in chain]
        kinds = [joint["type"] for joint in joints]
        if kinds != ["revolute", "revolute", "prismatic"] or loop["cut"]["type"] != "R3":
            continue
        (_, foot), (_, second), (rotation, position) = (places[body["name"]] for body in chain)
        way = position + rotation @ np.array(loop["cut"]["point_on_terminal"], float) - foot
        axis = rotation @ np.array(joints[2]["axis"], float)
        if np.max(np.abs([second - foot, np.cross(way, axis)])) > _STRAIGHT:
            continue
        names = {body["name"] for body in chain}
        names |= {name for name, body in bodies.items() if body["parent"] in names}
        legs.append(
            {
                "name": names_of_slides.get(loop["terminal"], loop["name"]),
                **{key: loop[key] for key in ("root", "closing")},
                "root_point": list(joints[0].get("position", (0, 0, 0))),
                "closing_point": loop["cut"]["point_on_closing"],
                "bodies": sorted(names),
                "length": float(np.linalg.norm(way)),
            }
        )
    return legs


def _find_pin(leg: dict) -> list[float]:
    """Return where the pin of a crank is at home, from the root point of its leg."""
    crank, axis = leg["crank"], np.array(leg["axis"], float)
    axis /= np.linalg.norm(axis)
    lean = math.radians(crank["lean_deg"]) if "lean_deg" in crank else crank.get("lean", 0.0)
    level = np.cross(leg.get("reference_axis", (1.0, 0.0, 0.0)), axis)
    level /= np.linalg.norm(level)
    direction = math.cos(lean) * level + math.sin(lean) * np.cross(axis, level)
    return (crank["length"] * direction).tolist()


def find_pins(mechanism: dict, home_q: Sequence[float] = ()) -> dict[str, np.ndarray]:
    """Return the crank pin at home of every listed crank leg, axes and origin of the base."""
    places = find_body_places(mechanism, home_q)
    pins = {}
    for leg in list_legs(mechanism):
        if "pin" in leg:
            rotation, position = places[leg["root"]]
            pins[leg["name"]] = position + rotation @ np.add(leg["root_point"], leg["pin"])
    return pins


def find_legs(
    mechanism: dict, home_q: Sequence[float] = ()
) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return name and both ends at home of every leg, axes and origin of the base."""
    places = find_body_places(mechanism, home_q)
    legs = []
    for leg in list_legs(mechanism):
        ends = []
        for body, point in (("root", "root_point"), ("closing", "closing_point")):
            rotation, position = places[leg[body]]
            ends.append(position + rotation @ np.array(leg[point], float))
        legs.append((leg["name"], *ends))
    return legs


def draw_hardware(
    d: Drawing,
    mechanism: dict,
    home_q: Sequence[float],
    scale: float,
    views: tuple[View, View],
) -> None:
    """Draw the hardware of the chaser at home: surfaces and latches of G, faces, hooks, pushers.

    Args:
        d: the sheet.
        mechanism: its description, angles in rad.
        home_q: as for `find_body_places`.
        scale: points per metre.
        views: across x and along x, of points in axes of the base.
    """
    hardware = make_hardware(mechanism)
    ring, base = _place_ring(mechanism, home_q), (np.eye(3), np.zeros(3))
    for part in ("faces", "hooks", "pushers"):
        for shape in hardware["interface"].get(part, ()):
            colors = (SOFT, LATCH if part == "hooks" else PAPER)
            _draw_shape(d, _place_shape(shape, base), scale, views, colors)
    for shape in _place_active(mechanism, home_q, hardware):
        _draw_shape(d, shape, scale, views, (RING, ACTIVE_FILL))
    for shape in list_hooks(hardware):
        _draw_shape(d, _place_shape(shape, ring), scale, views, (INK, LATCH))


def place_hulls(document: dict) -> dict[str, dict]:
    """Return the placed hulls of a resolved scene, by vehicle, axes and origin of the base.

    The hull of the target is placed as docked: A and P coincide.
    """
    base = document.get("base", {})
    in_base = invert_poses(
        _as_row(base.get("position", (0, 0, 0)), base.get("attitude", (1, 0, 0, 0)))
    )
    hulls = {}
    for name in VEHICLES:
        vehicle = document.get(name, {})
        if (hull := make_hull(vehicle)) is None:
            continue
        interface = _as_row(vehicle["interface_position"], vehicle["interface_attitude"])
        row = join_poses(in_base, invert_poses(interface))[0]
        hulls[name] = _place_shape(hull, (find_matrix(row[3:]), row[:3]))
    return hulls


def draw_hulls(
    d: Drawing, hulls: Mapping[str, dict], scale: float, views: tuple[View, View]
) -> None:
    """Draw hulls of `place_hulls`, with their names; arguments as for `draw_hardware`."""
    colors = {"chaser": (CHASER_EDGE, CHASER), "target": (TARGET_EDGE, TARGET)}
    for name, hull in hulls.items():
        _draw_shape(d, hull, scale, views, colors[name])
        x, y = views[0](hull["place"]((hull["points"][1][0] / 2, 0.0, 0.0)))
        d.label((x, y - 12), f"hull of the {name}", color=colors[name][0], size=11, clear=True)


def _place_ring(mechanism: dict, home_q: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and position of G at home, axes and origin of the base."""
    capture = mechanism.get("capture", {})
    rotation, position = find_body_places(mechanism, home_q)[capture.get("body", "base")]
    at = position + rotation @ np.array(capture.get("position", (0, 0, 0)), float)
    return rotation @ np.array(capture.get("rotation", np.eye(3)), float), at


def _place_active(mechanism: dict, home_q: Sequence[float], hardware: dict) -> list[dict]:
    """Return the active shapes, each placed on G or on its body at home."""
    places, ring = find_body_places(mechanism, home_q), _place_ring(mechanism, home_q)
    return [
        _place_shape(shape, places[shape["body"]] if "body" in shape else ring)
        for shape in list_active(hardware)
    ]


def list_points(mechanism: dict, home_q: Sequence[float], hulls: Iterable[dict] = ()) -> np.ndarray:
    """Return points that bound the drawn hardware at home and placed hulls, axes of the base."""
    hardware = make_hardware(mechanism)
    placed = _place_active(mechanism, home_q, hardware)
    parts, base = hardware["interface"].values(), (np.eye(3), np.zeros(3))
    placed += [_place_shape(shape, base) for part in parts for shape in part]
    placed += hulls
    points = [
        shape["place"](point) + step
        for shape in placed
        for point in _list_corners(shape)
        for step in (-shape["rounding"], shape["rounding"])
    ]
    return np.array(points).reshape(-1, 3)


def _list_corners(shape: dict) -> list[Vector]:
    """Return the points of a shape; of a surface of revolution four on every circle."""
    if shape["kind"] != "revolution":
        return shape["points"]
    around = ((1, 0), (0, 1), (-1, 0), (0, -1))
    return [(x, r * c, r * s) for line in shape["profiles"] for x, r in line for c, s in around]


def _as_row(position: Sequence[float], attitude: Sequence[float]) -> np.ndarray:
    """Return a pose as one row of 7 numbers."""
    return np.array([[*position, *attitude]], float)


def _place_shape(shape: dict, frame: tuple[np.ndarray, np.ndarray]) -> dict:
    """Return a shape with ``place``, which gives a point of it in axes of the base."""
    rotation, position = frame
    origin = position + rotation @ np.array(shape["pose"]["p"], float)
    axes = rotation @ find_matrix(shape["pose"]["q"])
    return {**shape, "place": lambda point: origin + axes @ np.array(point, float)}


def _draw_shape(
    d: Drawing, shape: dict, scale: float, views: tuple[View, View], colors: tuple[str, str]
) -> None:
    """Draw a placed shape in both views: of a surface of revolution its section and its circles."""
    (side, front), (color, fill), place = views, colors, shape["place"]
    if shape["kind"] == "revolution":
        for profile in shape["profiles"]:
            for sign in (1, -1):
                outline = (side(place((x, sign * r, 0.0))) for x, r in profile)
                d.line(*outline, color=color, width=0.8, fill=fill, close=True)
        x = shape["profiles"][0][0][0]
        radii = [r for profile in shape["profiles"] for _, r in profile]
        for radius in {min(radii), max(radii)}:
            turns = (2 * math.pi * i / 72 for i in range(72))
            circle = (place((x, radius * math.cos(a), radius * math.sin(a))) for a in turns)
            d.line(*map(front, circle), color=color, width=0.8, close=True)
        return
    points = [place(point) for point in shape["points"]]
    for view in views:
        seen = [view(point) for point in points]
        radius = max(scale * shape["rounding"], 0.5)
        if shape["kind"] == "plate":
            d.line(*seen, color=color, width=1, fill=fill, close=True)
        elif len(seen) == 1 or math.dist(*seen) < radius / 2:
            d.circle(seen[0], radius, fill=fill, color=color, width=0.8)
        else:
            d.line(*seen, color=color, width=2 * radius)
            d.line(*seen, color=fill, width=max(2 * radius - 1.6, 0.2))
