"""Shapes of docking hardware and hulls from their files, in metres, for all drawings and the view.

Rings, petals and cores are the contact surfaces that the core computes with. Hooks, strikers, faces
and pushers are places: the file holds no sizes of these, so they are symbols whose sizes follow the
circle on which they stand.

A shape has ``kind``, ``points``, ``rounding`` and ``pose``, a pair ``{"p": [x, y, z], "q": [w, x,
y, z]}``. On another body than that of G it also has ``body``, the name of this body. Kinds are
``point``, ``segment``, ``plate`` (corners in order) and ``revolution`` about x, whose points are
pairs of x and radius. It also has ``profiles``: closed outlines of its section.
"""

import itertools
import math
from collections.abc import Iterable, Sequence

import numpy as np

from dockloop.base.rotations import find_across

_HERE = {"p": [0.0, 0.0, 0.0], "q": [1.0, 0.0, 0.0, 0.0]}
_SYMBOL = 0.02  # radius of a hook's symbol over that of the circle of hooks
_HOOK = 0.035  # largest radius of a latch's symbol over the extent
_UNKNOWN = 0.4  # extent of a mechanism without any dimension [m]


def make_hardware(mechanism: dict) -> dict:
    """Return the hardware of a mechanism.

    Args:
        mechanism: its description, angles in rad.

    Returns:
        Members ``ring`` (both guide rings; None: there are none), ``cores`` (shapes by side; None),
        ``latches`` (None), ``interface``: shapes of hard-dock parts by name, in axes of A.
    """
    contact = mechanism.get("contact", {})
    return {
        "ring": _make_rings(contact) if contact.get("type") == "guide_ring" else None,
        "cores": _make_cores(contact) if contact.get("type") == "surfaces" else None,
        "latches": _make_latches(mechanism.get("latches")),
        "interface": _make_interface(mechanism.get("interface", {})),
    }


def make_hull(vehicle: dict) -> dict | None:
    """Return the hull of a vehicle of a scene, a cylinder with round ends, in its body axes.

    None: the scene states no hull.
    """
    if "hull" not in vehicle:
        return None
    start, end = (np.array(vehicle["hull"][key], float) for key in ("from", "to"))
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    rotation = np.column_stack([axis, *find_across(axis)])
    rotation[:, 2] *= np.linalg.det(rotation)
    points = [[0.0, 0.0], [length, 0.0]]
    return {
        "kind": "revolution",
        "points": points,
        "profiles": _make_profiles(points, vehicle["hull"]["radius"]),
        "rounding": 0.0,  # the profile has it
        "pose": {"p": start.tolist(), "q": find_quaternion(rotation).tolist()},
    }


def list_active(hardware: dict) -> list[dict]:
    """Return the active shapes: ring and petals, or cores; axes of G, or of their ``body``."""
    if ring := hardware["ring"]:
        body = {**ring["body"], "pose": _HERE}
        petal = {"kind": "plate", "rounding": ring["petal_rounding"], "pose": _HERE}
        return [body, *({**petal, "points": corners} for corners in ring["petals"])]
    return hardware["cores"]["active"] if hardware["cores"] else []


def list_hooks(hardware: dict) -> list[dict]:
    """Return the symbols of the hooks of latches, axes of G: small next to their distances."""
    hooks = (hardware["latches"] or {}).get("hooks", [])
    apart = (math.dist(a, b) for a, b in itertools.combinations(hooks, 2))
    size = min([_HOOK * find_extent(hardware), *(distance / 4 for distance in apart if distance)])
    symbol = {"kind": "point", "rounding": size, "pose": _HERE}
    return [{**symbol, "points": [hook]} for hook in hooks]


def find_extent(hardware: dict, points: Iterable[Sequence[float]] = ()) -> float:
    """Return the largest distance of the hardware and of other points from their origins [m].

    Pictures take the sizes of their symbols from this length.
    """
    places = [np.linalg.norm(point) for point in points]
    shapes = list_active(hardware) + (hardware["cores"]["passive"] if hardware["cores"] else [])
    shapes += [shape for part in hardware["interface"].values() for shape in part]
    for shape in shapes:
        at = np.linalg.norm(shape["pose"]["p"])
        places += [at + np.linalg.norm(point) for point in shape["points"]]
        places += [at + math.hypot(*point) for line in shape.get("profiles", ()) for point in line]
    if latches := hardware["latches"]:
        places += [np.linalg.norm(hook) for hook in latches["hooks"]]
    return float(max(places, default=0.0)) or _UNKNOWN


def find_quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix."""
    k = np.array(
        [
            [np.trace(rotation), 0.0, 0.0, 0.0],
            [rotation[2, 1] - rotation[1, 2], 2 * rotation[0, 0] - np.trace(rotation), 0.0, 0.0],
            [rotation[0, 2] - rotation[2, 0], 0.0, 2 * rotation[1, 1] - np.trace(rotation), 0.0],
            [rotation[1, 0] - rotation[0, 1], 0.0, 0.0, 2 * rotation[2, 2] - np.trace(rotation)],
        ]
    )
    for i, j in ((1, 2), (1, 3), (2, 3)):
        k[j, i] = rotation[i - 1, j - 1] + rotation[j - 1, i - 1]
    values, vectors = np.linalg.eigh(k)  # reads the lower triangle
    best = vectors[:, int(np.argmax(values))]
    return best if best[0] >= 0.0 else -best


def _make_rings(contact: dict) -> dict:
    """Return both guide rings; ``passive`` also has the ``pose`` in which it is placed."""
    passive = {**contact, **contact.get("passive", {})}
    axis = np.array(_at_azimuth(0.0, 1.0, math.pi / (2 * max(passive["petal_count"], 1))))
    pose = {"p": [0.0, 0.0, 0.0], "q": [0.0, *axis.tolist()]}  # a turn by pi
    return {**_make_ring(contact), "passive": {**_make_ring(passive), "pose": pose}}


def _make_ring(contact: dict) -> dict:
    """Return an active guide ring; as ``make_capture_hardware`` in src/contact/guide_ring.cpp."""
    count, petals = contact["petal_count"], []
    base, half = contact["petal_base_radius"], contact["petal_base_half_angle"]
    tip = (contact["petal_tip_x"], contact["petal_tip_distance"], contact["petal_tip_half_width"])
    for j in range(count):
        a = 2.0 * math.pi * j / count
        petals.append(
            [
                _at_azimuth(contact["petal_base_x"], base, a - half),
                _at_azimuth(contact["petal_base_x"], base, a + half),
                _about_x((tip[0], tip[1], tip[2]), a),
                _about_x((tip[0], tip[1], -tip[2]), a),
            ]
        )
    nodes = [[contact["core_x"], contact[f"core_{side}_radius"]] for side in ("inner", "outer")]
    return {
        "body": {
            "kind": "revolution",
            "points": nodes,
            "profiles": _make_profiles(nodes, contact["ring_rounding"]),
            "rounding": contact["ring_rounding"],
        },
        "petal_rounding": contact["petal_rounding"],
        "petals": petals,
    }


def _make_cores(contact: dict) -> dict[str, list[dict]]:
    """Return the cores of both sides, in axes of G (or of their body) and of P."""
    return {
        side: [shape for core in contact[side] for shape in _list_shapes(core)]
        for side in ("active", "passive")
    }


def _list_shapes(core: dict) -> list[dict]:
    """Return a core as shapes: ``kind``, ``points``, ``rounding`` and ``pose``."""
    shape = {"kind": core["kind"], "rounding": core["rounding"], "pose": _HERE}
    if "body" in core:
        shape["body"] = core["body"]
    if core["kind"] == "nodes":
        circle = (core.get("x", 0.0), core["radius"], core.get("azimuth_offset", 0.0))
        points = [
            _at_azimuth(*circle[:2], circle[2] + 2.0 * math.pi * i / core["count"])
            for i in range(core["count"])
        ]
        return [{**shape, "kind": "point", "points": [point]} for point in points]
    if core["kind"] == "revolution":
        axis = core.get("axis", {})
        turn_of_axis = find_quaternion(np.array(axis.get("rotation", np.eye(3)), float))
        pose = {"p": axis.get("position", [0.0, 0.0, 0.0]), "q": turn_of_axis.tolist()}
        profiles = _make_profiles(core["profile"], core["rounding"])
        return [{**shape, "points": core["profile"], "profiles": profiles, "pose": pose}]
    if core["kind"] == "point":
        return [{**shape, "points": [core.get("position", [0.0, 0.0, 0.0])]}]
    return [{**shape, "points": core["points" if core["kind"] == "segment" else "corners"]}]


def _make_latches(latches: dict | None) -> dict | None:
    """Return hooks in axes of G, strikers in axes of P, and distances of the first latch."""
    if not latches:
        return None
    if "list" in latches:
        hooks = [latch["hook"] for latch in latches["list"]]
        strikers = [latch["striker"] for latch in latches["list"]]
        first = {**latches, **latches["list"][0]}
    else:
        hooks = [_at_azimuth(0.0, latches["radius"], a) for a in latches["azimuth"]]
        strikers, first = hooks, latches
    law = {key: first[key] for key in ("range", "catch", "window")}
    measure = first.get("measure", "active_axis")
    return {"hooks": hooks, "strikers": strikers, "measure": measure, **law}


def _make_profiles(nodes: Sequence[Sequence[float]], rounding: float) -> list[list[list[float]]]:
    """Return the outline of every piece of a polyline of (x, radius) with its rounding.

    One point makes a circle.
    """
    profiles = []
    for start, end in zip(nodes, nodes[1:] or nodes, strict=False):
        along = math.atan2(end[1] - start[1], end[0] - start[0])
        profile = []
        for j in (*range(26), 0):  # once around the piece, half of it about each end
            half, step = divmod(j, 13)
            angle = along + math.pi * (step / 12.0 + half - 0.5)
            x, radius = start if half else end
            at = [x + rounding * math.cos(angle), max(radius + rounding * math.sin(angle), 0.0)]
            profile.append(at)
        profiles.append(profile)
    return profiles


def _make_interface(interface: dict) -> dict[str, list[dict]]:
    """Return faces, hooks and pushers of the hard dock in axes of A; hooks in rows."""
    parts: dict[str, list[dict]] = {}
    size = _SYMBOL * max((part["radius"] for part in interface.values() if "radius" in part),
                         default=0.0)  # fmt: skip
    symbol = {"rounding": size, "pose": _HERE}
    if faces := interface.get("faces"):
        ring = [[0.0, faces["radius"]]]
        profiles = _make_profiles(ring, size / 2)
        parts["faces"] = [{**symbol, "kind": "revolution", "points": ring, "profiles": profiles}]
    if hooks := interface.get("hooks"):
        places = (at for row in hooks["rows"] for at in _list_circle({**hooks, **row}))
        parts["hooks"] = [{**symbol, "kind": "point", "points": [at]} for at in places]
    if pushers := interface.get("pushers"):
        symbol["rounding"] = size / 2 or pushers["stroke"] / 8
        parts["pushers"] = [
            {**symbol, "kind": "segment", "points": [at, [pushers["stroke"], *at[1:]]]}
            for at in _list_circle(pushers)
        ]
    return parts


def _list_circle(circle: dict) -> list[list[float]]:
    """Return points on a circle in the mating plane; as ``make_circle`` in src/docking."""
    first, radius = circle.get("azimuth", 0.0), circle.get("radius", 0.0)
    turns = (i / circle["count"] for i in range(circle["count"]))
    return [_at_azimuth(0.0, radius, first + 2.0 * math.pi * part) for part in turns]


def _at_azimuth(x: float, radius: float, azimuth: float) -> list[float]:
    return [x, radius * math.cos(azimuth), radius * math.sin(azimuth)]


def _about_x(point: Sequence[float], angle: float) -> list[float]:
    x, y, z = point
    c, s = math.cos(angle), math.sin(angle)
    return [x, c * y - s * z, s * y + c * z]
