"""Parts of vehicles for the page of ``dockloop view``: their boxes, and their poses in a run.

A part stands where its recorded coordinates take it from its placement on the vehicle. An adapter
carries the docking interface, so the body of the vehicle behind it moves in axes of the interface.
Parts count as the outputs do: those of the chaser, its adapter, then those of the target. Modes
are not drawn and not counted.
"""

from collections.abc import Iterator

import numpy as np

from dockloop.base.rotations import invert_poses, join_poses, multiply, turn
from dockloop.native.variables import VEHICLES
from dockloop.result.recording import Result
from dockloop.view.geometry import as_row, make_box

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
    on_vehicle = {
        i: (vehicle, name, part, rows)
        for i, (number, vehicle, name, part) in enumerate(_walk(run.scene), 1)
        if (rows := _place(run, number, part)) is not None
    }
    home = {vehicle: as_row(shapes["pose"]) for vehicle, shapes in vehicles.items()}
    body = dict(home)
    for vehicle, name, part, rows in on_vehicle.values():
        if name != "adapter":
            continue
        # interface in the vehicle: as the adapter moved, from the interface at rest
        back = invert_poses(home[vehicle])
        moved = join_poses(rows, invert_poses(_find_placement(part)))
        body[vehicle] = invert_poses(join_poses(moved, back))
        poses[f"vehicle.{vehicle}"] = join_poses(body[vehicle], back)
    for i, (vehicle, _, _, rows) in on_vehicle.items():
        in_interface = join_poses(body[vehicle], rows)
        if vehicle == "chaser":
            poses[f"part[{i}]"] = in_interface
        elif target is not None:
            poses[f"part[{i}]"] = join_poses(target, in_interface)
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


def _find_placement(part: dict) -> np.ndarray:
    """Return the pose of a part with its coordinates at zero, in axes of the vehicle, a row."""
    attitude = part.get("attitude", [1.0, 0.0, 0.0, 0.0])
    return as_row({"p": part.get("position", [0.0] * 3), "q": attitude})


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
    rows = np.tile(_find_placement(part), (len(run.values), 1))
    for recorded, slide in zip(names, slides, strict=False):
        rows[:, :3] += turn(rows[:, 3:], np.outer(run[recorded], slide))
    for recorded, hinge in zip(names[len(slides) :], turns, strict=True):
        half = run[recorded] / 2.0
        step = np.column_stack([np.cos(half), np.outer(np.sin(half), hinge)])
        rows[:, 3:] = multiply(rows[:, 3:], step)
    return rows
