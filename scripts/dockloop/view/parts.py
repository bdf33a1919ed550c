"""Parts of vehicles for the page of ``dockloop view``: their boxes, and their poses in a run.

A part stands where its recorded coordinates take it from its placement on the vehicle. An adapter
carries the docking interface, so the body of the vehicle behind it moves in axes of the interface.
Parts count as the outputs do: those of the chaser, its adapter, then those of the target. Modes
are not drawn and not counted.
"""

from collections.abc import Iterator

import numpy as np

from dockloop.base.rotations import conjugate, multiply, turn
from dockloop.native.variables import VEHICLES
from dockloop.result.recording import Result
from dockloop.view.geometry import make_box

_AXES = np.eye(3)


def list_parts(document: dict) -> list[dict]:
    """Return number, name, vehicle and box (in axes of the part) of all parts of a scene."""
    found = []
    for _, vehicle, name, part in _walk(document):
        inertia = part.get("inertia", [0.0] * 6)
        size, attitude = make_box(float(part["mass"]), np.array(inertia, float))
        pose = {"p": list(part.get("com", [0.0] * 3)), "q": attitude[0].tolist()}
        box = {"size": size.tolist(), "pose": pose}
        found.append({"name": name, "vehicle": vehicle, "box": box})
    return found


def place_parts(run: Result, vehicles: dict, target: np.ndarray | None) -> dict[str, np.ndarray]:
    """Return poses, one row of 7 per sample: of parts in axes of A, of vehicles behind adapters.

    Args:
        run: what was recorded.
        vehicles: shapes of the vehicles, with the pose of the body in the interface frame.
        target: poses of P in axes of A, if they are known.

    Returns:
        ``part[i]``, and ``vehicle.NAME``: the displacement of the body from its place with all
        coordinates at zero, in axes of the interface.
    """
    poses: dict[str, np.ndarray] = {}
    count = len(run.values)
    on_vehicle = {
        i: (vehicle, name, part, rows)
        for i, (number, vehicle, name, part) in enumerate(_walk(run.scene), 1)
        if (rows := _place(run, number, part)) is not None
    }
    home = {v: _tile([*s["pose"]["p"], *s["pose"]["q"]], count) for v, s in vehicles.items()}
    body = dict(home)
    for vehicle, name, part, rows in on_vehicle.values():
        if name != "adapter":
            continue
        # interface in the vehicle: as the adapter moved, from the interface at rest
        moved = _join(rows, _invert(_tile(_find_placement(part), count)))
        body[vehicle] = _invert(_join(moved, _invert(home[vehicle])))
        poses[f"vehicle.{vehicle}"] = _join(body[vehicle], _invert(home[vehicle]))
    for i, (vehicle, _, _, rows) in on_vehicle.items():
        in_interface = _join(body[vehicle], rows)
        if vehicle == "chaser":
            poses[f"part[{i}]"] = in_interface
        elif target is not None:
            poses[f"part[{i}]"] = _join(target, in_interface)
    return poses


def _walk(document: dict) -> Iterator[tuple[int, str, str, dict]]:
    """Yield number of the outputs, vehicle, name and members of all parts but modes."""
    before = 0
    for vehicle in VEHICLES:
        members = document.get(vehicle, {})
        for number, part in enumerate(members.get("part", ()), 1):
            before += 1
            yield before, vehicle, f"part {number}", part
        before += len(members.get("modes", {}).get("frequency", ()))
        if "adapter" in members:
            before += 1
            yield before, vehicle, "adapter", members["adapter"]


def _find_placement(part: dict) -> list[float]:
    return [*part.get("position", [0.0] * 3), *part.get("attitude", [1.0, 0.0, 0.0, 0.0])]


def _place(run: Result, number: int, part: dict) -> np.ndarray | None:
    """Return poses of a part in axes of its vehicle; None: its coordinates are not recorded."""
    name = f"part[{number}].coordinate"
    names = [n for n in run.names if n == name or n.startswith(f"{name}[")]
    if not names:
        return None
    axis = np.array(part.get("axis", _AXES[0]), float)
    slides, turns = {
        "slide": ([axis], []),
        "hinge": ([], [axis]),
        "ball": ([], list(_AXES)),
        "elastic": (list(_AXES), list(_AXES)),
    }[part["joint"]]
    rows = _tile(_find_placement(part), len(run.values))
    for recorded, slide in zip(names, slides, strict=False):
        rows[:, :3] += turn(rows[:, 3:], np.outer(run[recorded], slide))
    for recorded, hinge in zip(names[len(slides) :], turns, strict=True):
        half = run[recorded] / 2.0
        step = np.column_stack([np.cos(half), np.outer(np.sin(half), hinge)])
        rows[:, 3:] = multiply(rows[:, 3:], step)
    return rows


def _tile(pose: list[float], count: int) -> np.ndarray:
    return np.tile(np.array(pose, float), (count, 1))


def _join(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return poses b, given in axes of a, in the axes in which a is given."""
    return np.hstack([a[:, :3] + turn(a[:, 3:], b[:, :3]), multiply(a[:, 3:], b[:, 3:])])


def _invert(a: np.ndarray) -> np.ndarray:
    back = conjugate(a[:, 3:])
    return np.hstack([turn(back, -a[:, :3]), back])
