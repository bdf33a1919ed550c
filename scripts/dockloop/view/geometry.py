"""Shapes of a docking from its resolved scene, in metres, for the page of ``dockloop view``.

Nothing is drawn that the scene does not hold: rings, petals, cores, hooks and strikers are the
contact surfaces that the core computes with, legs run between the joint points of the mechanism
file. A vehicle is a homogeneous box with its mass and inertia, or a mesh that the user gives, and
the hull that the scene states.

Poses are pairs ``{"p": [x, y, z], "q": [w, x, y, z]}``, quaternions as in the FMU.
"""

from pathlib import Path

import numpy as np

from dockloop.base.rotations import (
    conjugate,
    invert_poses,
    join_poses,
    make_symmetric,
    multiply,
    turn,
)
from dockloop.native import core
from dockloop.scene.hardware import (
    find_extent,
    find_quaternion,
    list_hooks,
    make_hardware,
    make_hull,
)
from dockloop.scene.shapes import find_body_places, list_legs

_HERE = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
_PORT = 0.2  # clearance of a vehicle's box from its mating plane over the extent


def make_geometry(document: dict, parameters: dict[str, float]) -> dict:
    """Return all shapes of a docking.

    Args:
        document: the resolved scene (``resources/model.json`` of the FMU).
        parameters: values of the FMU's parameters; they win over the document.

    Returns:
        Members ``base`` (its pose in axes of A), ``vehicles``, those of `make_hardware`, ``hooks``
        (symbols of latches), ``extent`` [m], ``contact``, ``legs``, ``capture_body``,
        ``capture_body_in_G``, ``meshes``, ``bodies``.
    """
    mechanism = document["mechanism"]
    legs = _list_legs(mechanism)
    hardware = make_hardware(mechanism)
    extent = find_extent(
        hardware, (leg[at] for leg in legs for at in ("root_point", "closing_point"))
    )
    port = _PORT * extent
    back = min((leg["root_point"][0] for leg in legs if leg["root"] == "base"), default=-2 * port)
    vehicles = {}
    for name, front in (("chaser", min(back, -port)), ("target", port)):
        if name in document:
            vehicles[name] = _make_vehicle(name, document[name], parameters, front)
    base = document.get("base", {})
    return {
        "base": {
            "p": list(base.get("position", [0.0, 0.0, 0.0])),
            "q": list(base.get("attitude", [1.0, 0.0, 0.0, 0.0])),
        },
        "vehicles": vehicles,
        **hardware,
        "hooks": list_hooks(hardware),
        "extent": extent,
        "contact": mechanism.get("contact", {}).get("type"),
        "legs": legs,
        "capture_body": mechanism.get("capture", {}).get("body", "base"),
        "capture_body_in_G": _place_body_in_ring(mechanism.get("capture", {})),
        "meshes": [],
        "bodies": [_describe_body(body, mechanism) for body in mechanism.get("bodies", [])],
    }


def _describe_body(body: dict, mechanism: dict) -> dict:
    """Return what is drawn of a body: its axes if it has a mass, lines to where loops end on it."""
    loops = (loop for loop in mechanism.get("loops", []) if loop["terminal"] == body["name"])
    return {
        "name": body["name"],
        "parent": body["parent"],
        "is_named": bool(body.get("mass")),
        "ends": [loop["cut"]["point_on_terminal"] for loop in loops],
    }


def place_bodies(
    mechanism: dict, times: np.ndarray, coordinates: np.ndarray
) -> dict[str, np.ndarray]:
    """Return poses of all bodies, those of legs among them; the core closes loops and couplings.

    Args:
        mechanism: its description.
        times: of the samples [s]; some couplings move with time.
        coordinates: ``state.q``, the independent ones, one row per sample.

    Returns:
        For every body rows of position and quaternion in axes of the base.

    Raises:
        UsageError: loops cannot be closed there.
    """
    source = Path(mechanism["name"])
    checked, bodies = (core_of(mechanism, source) for core_of in (core.check, core.expand))
    columns, end = {}, 0
    for body in bodies["bodies"]:
        end, start = end + (7 if body["joint"]["type"] == "free" else 1), end
        columns[body["name"]] = slice(start, end)
    q = np.tile(checked["home_q"], (len(times), 1))
    chosen = np.r_[tuple(columns[name] for name in checked["independent"])]
    q[:, chosen] = coordinates[:, : len(chosen)]  # those of parts of the chaser come last
    if bodies["loops"] or bodies["couplings"]:
        rest = {"v_independent": [0.0] * checked["degrees_of_freedom"]}
        rest["tau"] = [0.0] * checked["tree_velocities"]
        states = [
            {"time": time, "q": row, **rest}
            for time, row in zip(times.tolist(), q.tolist(), strict=True)
        ]
        closed = core.evaluate(mechanism, source, {"states": states}, Path("result"))
        q = np.array([state["q"] for state in closed])
    poses = {"base": _HERE}
    for body in bodies["bodies"]:
        joint, at = body["joint"], q[:, columns[body["name"]]]
        placed = {"p": joint["position"], "q": find_quaternion(np.array(joint["rotation"]))}
        steps = at if joint["type"] == "free" else np.tile(_HERE, (len(q), 1))
        if joint["type"] == "prismatic":
            steps[:, :3] = at * joint["axis"]
        elif joint["type"] == "revolute":
            steps[:, 3:] = np.hstack([np.cos(at / 2.0), np.sin(at / 2.0) * joint["axis"]])
        frame = join_poses(poses[body["parent"]], as_row(placed))
        poses[body["name"]] = join_poses(frame, steps)
    del poses["base"]
    return poses


def as_row(pose: dict) -> np.ndarray:
    """Return a pose as one row of 7 numbers."""
    return np.array([[*pose["p"], *pose["q"]]], float)


def find_leg_length(leg: dict, root: np.ndarray, closing: np.ndarray) -> np.ndarray:
    """Return lengths of a leg from the poses of the bodies at its ends, rows of 7 numbers [m].

    The length of a crank leg is the travel of its pin from home.
    """
    ends = (
        rows[:, :3] + turn(rows[:, 3:], np.array(leg[point]))
        for rows, point in ((root, "root_point"), (closing, "closing_point"))
    )
    first, second = ends
    if "crank" not in leg:
        return np.linalg.norm(second - first, axis=1)
    crank = leg["crank"]
    axis, home = np.array(crank["axis"]), np.array(crank["pin"])
    pin = _find_pin(crank, turn(conjugate(root[:, 3:]), second - first))
    angle = np.arctan2(np.cross(home, pin) @ axis, pin @ home)
    return np.linalg.norm(home) * angle


def _find_pin(crank: dict, tip: np.ndarray) -> np.ndarray:
    """Return the crank pin for tips, rows of 3 numbers from the root point, axes of the root.

    Seen along the crank axis, crank and rod are two sides of a triangle from root point to tip.
    """
    axis, length = np.array(crank["axis"]), np.linalg.norm(crank["pin"])
    height = tip @ axis
    flat = tip - np.outer(height, axis)
    distance = np.linalg.norm(flat, axis=1)
    along = (distance**2 + length**2 - crank["rod"] ** 2 + height**2) / (2.0 * distance)
    across = crank["side"] * np.sqrt(np.maximum(length**2 - along**2, 0.0))
    return (along[:, None] * flat + across[:, None] * np.cross(axis, flat)) / distance[:, None]


def make_box(mass: float, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sides [m] and attitude (a row) of the homogeneous box with these xx yy zz xy xz yz."""
    moments, axes = np.linalg.eigh(make_symmetric(inertia))
    order = np.argmax(np.abs(axes), axis=0)  # keep x, y, z where the axes are nearly those
    if len(set(order)) == 3:
        moments, axes = moments[np.argsort(order)], axes[:, np.argsort(order)]
    axes = axes * np.where(np.diag(axes) < 0.0, -1.0, 1.0)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    squares = 6.0 * (np.sum(moments) - 2.0 * moments) / mass
    return np.sqrt(np.maximum(squares, 0.0)), find_quaternion(axes)[None]


def _make_vehicle(name: str, vehicle: dict, parameters: dict[str, float], front: float) -> dict:
    """Return the box of a vehicle and the pose of its body frame in its interface frame."""

    def read(member: str, count: int) -> np.ndarray:
        given = vehicle[member]
        values = (parameters.get(f"{name}.{member}[{i + 1}]", given[i]) for i in range(count))
        return np.array(list(values), float)

    mass = float(parameters.get(f"{name}.mass", vehicle["mass"]))
    inertia = read("inertia", 6)
    position, attitude = read("interface_position", 3), read("interface_attitude", 4)
    attitude /= np.linalg.norm(attitude)
    back = conjugate(attitude[None])
    origin = turn(back, -position)[0]  # centre of mass in axes of the interface
    size, attitude = make_box(mass, inertia)
    box = multiply(back, attitude)
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    points = np.array([origin + turn(box, size * corner)[0] for corner in corners])
    low, high = points.min(axis=0), points.max(axis=0)
    center, is_cut = origin, False
    if name == "chaser" and high[0] > front:
        high[0], low[0], is_cut = front, min(low[0], 5 / 3 * front), True
    if name == "target" and low[0] < front:
        low[0], high[0], is_cut = front, max(high[0], 5 / 3 * front), True
    if is_cut:  # axes of the interface then, which are those of the box in all but odd cases
        center, size, box = (low + high) / 2.0, high - low, np.array([[1.0, 0.0, 0.0, 0.0]])
    return {
        "mass": mass,
        "hull": make_hull(vehicle),
        "motion": vehicle.get("motion", "free"),
        "pose": {"p": origin.tolist(), "q": back[0].tolist()},
        "box": {"size": size.tolist(), "pose": {"p": center.tolist(), "q": box[0].tolist()}},
        "is_cut": is_cut,
    }


def _list_legs(mechanism: dict) -> list[dict]:
    """Return what is drawn of the legs."""
    legs = []
    places = find_body_places(mechanism)
    numbers = {leg["name"]: i for i, leg in enumerate(mechanism.get("legs", []), start=1)}
    for leg in list_legs(mechanism):
        stops = {} if "pin" in leg else leg.get("stops") or {}
        legs.append(
            {
                **{key: leg[key] for key in ("name", "root", "closing")},
                "number": numbers.get(leg["name"], 0),  # of the outputs; 0: it has none
                **{key: [float(x) for x in leg[key]] for key in ("root_point", "closing_point")},
                **{key: stops[key] for key in ("min_length", "max_length") if key in stops},
                **{key: leg[key] for key in ("bodies", "length") if key in leg},
                **({"crank": _make_crank(leg, places)} if "pin" in leg else {}),
            }
        )
    return legs


def _make_crank(leg: dict, places: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict:
    """Return what places a crank: axis, pin at home, length of the rod, side of the pin."""
    (root, at), (closing, there) = places[leg["root"]], places[leg["closing"]]
    tip = root.T @ (there + closing @ np.array(leg["closing_point"], float) - at)
    tip -= np.array(leg["root_point"], float)
    axis, pin = np.array(leg["axis"], float), np.array(leg["pin"], float)
    axis /= np.linalg.norm(axis)
    return {
        "axis": axis.tolist(),
        "pin": pin.tolist(),
        "rod": float(np.linalg.norm(tip - pin)),
        "side": 1.0 if np.cross(axis, tip) @ pin > 0.0 else -1.0,
    }


def find_opening(latches: dict, i: int, ring: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the opening of latch i, counted from 0, from poses of G and P, rows of 7 numbers [m].

    Raises:
        IndexError: there is no such latch.
    """
    hook, striker = (np.array(latches[ends][i], float) for ends in ("hooks", "strikers"))
    way = target[:, :3] + turn(target[:, 3:], striker) - ring[:, :3] - turn(ring[:, 3:], hook)
    axes = target if latches["measure"] == "passive_plane" else ring
    return turn(conjugate(axes[:, 3:]), way)[:, 0]


def _place_body_in_ring(capture: dict) -> dict:
    """Return the pose of the capture body in axes of G."""
    attitude = find_quaternion(np.array(capture.get("rotation", np.eye(3)), float))
    pose = {"p": capture.get("position", [0.0, 0.0, 0.0]), "q": attitude}
    row = invert_poses(as_row(pose))[0].tolist()
    return {"p": row[:3], "q": row[3:]}
