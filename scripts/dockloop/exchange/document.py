"""Writes the mechanism of a robot: bodies, loops with their dependent joints, couplings, forces."""

import shlex
from dataclasses import dataclass
from typing import Any

import numpy as np

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.mesh_option import MeshOption
from dockloop.base.rotations import find_across
from dockloop.exchange.constructs import GUESSED, LEFT_OUT, MAPPED
from dockloop.exchange.robot import WORLD, Dof, Joint, Law, Robot
from dockloop.exchange.tree import CUTS, Tree
from dockloop.scene.hardware import find_quaternion

BASE = "base"
FORWARD = ("x", "y", "z", "-x", "-y", "-z")
# Stiffness and toe of a stop for which the file has none: slides [N/m, m], turns [N m/rad, rad].
STOPS = {"prismatic": (1e6, 1e-3), "revolute": (1e4, 1e-2)}
_FAR = 1e6  # m or rad: where a stop is put that the file does not have
_PARALLEL = 1e-4  # rad: axes of a planar loop, as rounded in a file
_LONG = 50.0  # m: a mechanism that is larger was hardly described in metres
_TURNED = 20.0  # rad: a limit that is farther was hardly described in radians


@dataclass
class _Body:
    """A body of the mechanism: one coordinate (or a free joint), its axes where it stands."""

    name: str
    parent: str
    kind: str
    rotation: np.ndarray
    origin: np.ndarray
    axis: np.ndarray
    coordinate: str = ""


def write_document(
    robot: Robot, tree: Tree, ring: str | None, assemble: float, forward: str
) -> dict[str, Any]:
    """Return the document of a mechanism, without home pose: that is zero, or near.

    Args:
        robot: as it was read.
        tree: its bodies and cuts.
        ring: the link that is the capture body.
        assemble: largest opening of a loop [m].
        forward: axis of base and ring that becomes x, one of `FORWARD`.

    Raises:
        UsageError: a loop is open by more, or a part cannot be described.
    """
    _check_size(robot)
    for joint in tree.cuts:
        _check_gap(robot, joint, assemble)
    planes = [_find_plane(tree, joint, robot) for joint in tree.cuts]
    bodies: dict[str, _Body] = {}
    turn = np.roll(np.eye(3), -"xyz".index(forward[-1]), axis=1)
    turn = turn * ([-1.0, -1.0, 1.0] if forward[0] == "-" else 1.0)
    base = _Body(BASE, "", "", tree.base.rotation @ turn, tree.base.origin, np.zeros(3))
    chains = {WORLD: [base]}  # bodies into which each one of the tree is split, from its parent on
    written: list[dict] = []
    for name, (joint, parent) in tree.edges.items():
        chains[name] = _split(tree, name, joint, chains[parent][-1])
        for body in chains[name]:
            written.append(_write_body(body, bodies.get(body.parent, base)))
            bodies[body.name] = body
        link = tree.bodies[name]
        com = link.rotation.T @ (link.origin - body.origin) + link.com
        mass = {"mass": link.mass, "com": _list(com), "inertia": _list(link.inertia)}
        written[-1] |= mass if link.mass else {}
    loops = [
        _write_loop(robot, tree, joint, plane, chains)
        for joint, plane in zip(tree.cuts, planes, strict=True)
    ]
    for mesh in robot.meshes:
        on = chains[tree.body_of[mesh.link]][-1]
        attitude = find_quaternion(on.rotation.T @ mesh.rotation)
        pose = np.array([*(on.rotation.T @ (mesh.origin - on.origin)), *attitude])
        option = shlex.quote(MeshOption(on.name, mesh.file, pose, mesh.scale).write())
        robot.report.say(LEFT_OUT, f"mesh of '{mesh.link}': dockloop view RESULT --mesh {option}")
    joints = {body.coordinate: body.name for body in bodies.values() if body.coordinate}
    couplings = [_write_coupling(robot, coupling, joints) for coupling in robot.couplings]
    _choose_dependents(loops, couplings, bodies)
    document: dict[str, Any] = {
        "name": robot.name,
        "gravity": _list(base.rotation.T @ robot.gravity),
        "bodies": written,
        "loops": loops,
        "couplings": couplings,
        "forces": _write_forces(robot, tree, joints),
        "legs": _list_legs(loops, bodies),
    }
    if ring:
        body, link = chains[tree.body_of[ring]][-1], robot.links.get(ring, tree.base)
        document["capture"] = {
            "body": body.name,
            "position": _list(body.rotation.T @ (link.origin - body.origin)),
            "rotation": _list(body.rotation.T @ link.rotation @ turn),
        }
    return {key: value for key, value in document.items() if value != []}


def _list(values: np.ndarray) -> list:
    """Return numbers as a list; what is nothing but rounding is zero."""
    return np.where(np.abs(values) < 1e-15, 0.0, values).tolist()


def _check_size(robot: Robot) -> None:
    points = [link.origin for link in robot.links.values()] + [j.point for j in robot.joints]
    size = max((float(np.ptp(np.array(points), axis=0).max()) if points else 0.0), 0.0)
    if size > _LONG:
        what = f"lengths are metres, although the mechanism is {size:.4g} m long: millimetres?"
        robot.report.say(GUESSED, what)


def _check_gap(robot: Robot, cut: Joint, assemble: float) -> None:
    """Refuse a loop that is open by more than `assemble` [m] at the pose of the file."""
    gap = 0.0 if cut.point_on_child is None else np.linalg.norm(cut.point_on_child - cut.point)
    if gap > assemble:
        raise UsageError(
            f"{robot.report.file}: the loop of '{cut.name}' is open by {gap:.6g} m (limit"
            f" {assemble:g} m): correct the file or give a larger --assemble"
        )


def _split(tree: Tree, name: str, joint: Joint, above: _Body) -> list[_Body]:
    """Return the bodies of a joint, massless but for the last, from parent to child."""
    link = tree.bodies[name]
    if joint.kind == "free":
        label = _label(name)
        body = _Body(label, above.name, "free", link.rotation, link.origin, np.zeros(3))
        return [body]
    is_turned = tree.ends(joint)[1] != name
    dofs = joint.dofs[::-1] if is_turned else joint.dofs
    bodies, parent = [], above.name
    for dof in dofs:
        label = _label(name) if dof is dofs[-1] else f"{_label(name)}_{dof.name}"
        axis = link.rotation.T @ (-dof.axis if is_turned else dof.axis)
        point = _point(joint, is_turned) if len(dofs) == 1 else dof.point
        bodies.append(_Body(label, parent, dof.kind, link.rotation, point, axis, dof.name))
        parent = label
    return bodies


def _label(name: str) -> str:
    """Return the name of a body; ``base`` is taken."""
    return f"{name}_link" if name == BASE else name


def _point(joint: Joint, is_turned: bool) -> np.ndarray:
    given = joint.point_on_child
    return given if given is not None and is_turned else joint.point


def _write_body(body: _Body, above: _Body) -> dict[str, Any]:
    turn = above.rotation.T @ body.rotation
    joint: dict[str, Any] = {"type": body.kind}
    if body.kind != "free":
        joint["axis"] = _list(body.axis)
    joint["position"] = _list(above.rotation.T @ (body.origin - above.origin))
    if np.abs(turn - np.eye(3)).max() > 1e-15:
        joint["rotation"] = _list(turn)
    return {"name": body.name, "parent": body.parent, "joint": joint}


def _find_plane(tree: Tree, cut: Joint, robot: Robot) -> np.ndarray | None:
    """Return the normal of the plane in which a loop moves; its axes become exactly parallel."""
    a, b = tree.cycle(cut)
    joints = [tree.edges[body][0] for body in a + b]
    if any(joint.kind == "free" for joint in joints) or cut.kind == "universal":
        return None
    dofs = [dof for joint in joints for dof in joint.dofs]
    if cut.kind != "ball":
        dofs += cut.dofs
    turns = [dof.axis for dof in dofs if dof.kind == "revolute"]
    if not turns:
        return None
    normal = turns[0]
    gap = cut.point - (cut.point if cut.point_on_child is None else cut.point_on_child)
    tilts = [np.linalg.norm(np.cross(normal, axis)) for axis in turns]
    tilts += [abs(normal @ dof.axis) for dof in dofs if dof.kind == "prismatic"]
    if max(tilts) > _PARALLEL or abs(normal @ gap) > 1e-9:
        return None
    tilt = 0.0
    for dof in dofs:
        along = normal * np.sign(normal @ dof.axis)
        flat = dof.axis - (normal @ dof.axis) * normal
        axis = along if dof.kind == "revolute" else flat / np.linalg.norm(flat)
        tilt = max(tilt, float(np.linalg.norm(axis - dof.axis)))
        dof.axis = axis
    if tilt > 1e-12:
        what = f"axes of the planar loop of '{cut.name}' turned by up to {tilt:.2g} rad into it"
        robot.report.say(GUESSED, what)
    return normal


def _write_loop(
    robot: Robot,
    tree: Tree,
    cut: Joint,
    normal: np.ndarray | None,
    chains: dict[str, list[_Body]],
) -> dict[str, Any]:
    a, b = tree.cycle(cut)
    on_child = cut.point if cut.point_on_child is None else cut.point_on_child
    ends = [(a, cut.point, 0), (b, on_child, -1)]  # path, point, number of its axis
    is_platform = tree.edges[a[-1]][0].kind == "free" if a else False
    if not a or (b and (is_platform or len(b) > len(a))):
        ends.reverse()
    (path, point, i), (_, at, j) = ends
    closing = tree.ends(cut)[0 if ends[1][0] is a else 1]
    common = tree.edges[path[0]][1]
    terminal, ending = chains[path[-1]][-1], chains[closing][-1]
    kind = "R1_planar" if normal is not None else CUTS[cut.kind][0]
    written: dict[str, Any] = {
        "type": kind,
        "point_on_terminal": _list(terminal.rotation.T @ (point - terminal.origin)),
        "point_on_closing": _list(ending.rotation.T @ (at - ending.origin)),
    }
    if normal is not None:
        written["plane_axes_in_root"] = _list(find_across(normal) @ chains[common][-1].rotation)
    elif kind != "R3":
        written["axis_on_terminal"] = _list(terminal.rotation.T @ cut.dofs[i].axis)
        written["axis_on_closing"] = _list(ending.rotation.T @ cut.dofs[j].axis)
    for dof in cut.dofs:
        if not dof.law.is_empty():
            what = f"forces and limits of '{dof.name}': its joint is cut (--cut chooses another)"
            robot.report.say(LEFT_OUT, what)
    robot.report.say(MAPPED, f"joint '{cut.name}' is the cut {kind} of a loop")
    return {
        "name": cut.name,
        "root": chains[common][-1].name,
        "first": chains[path[0]][0].name,
        "terminal": terminal.name,
        "closing": ending.name,
        "dependent": [],
        "cut": written,
    }


def _write_coupling(robot: Robot, coupling: Any, joints: dict[str, str]) -> dict[str, Any]:
    known = [dof.name for joint in robot.joints for dof in joint.dofs]
    for name in (coupling.dependent, *(term for term, _ in coupling.terms)):
        if name not in known:
            near = did_you_mean(name, known)
            is_there = any(joint.name == name for joint in robot.joints)
            what = "has no coordinate of its own" if is_there else f"is not there{near}"
            raise UsageError(
                f"{robot.report.file}: '{coupling.name}' couples '{name}', which {what}"
            )
        if name not in joints:
            raise UsageError(
                f"{robot.report.file}: '{coupling.name}' couples '{name}', which is no single"
                " coordinate of the tree: couple turns and slides that are not cut (--cut)"
            )
    terms = [{"joint": joints[name], "ratio": ratio} for name, ratio in coupling.terms]
    written = {"name": coupling.name, "dependent": joints[coupling.dependent], "terms": terms}
    return written | ({"offset": coupling.offset} if coupling.offset else {})


def _choose_dependents(loops: list[dict], couplings: list[dict], bodies: dict[str, _Body]) -> None:
    """Give each loop the joints that it determines, by the rank of the equations of all loops.

    Equations that depend on others are found by the core, from all joints of their loops.
    """
    if not loops:
        return
    rows, owners = [], []
    for k, loop in enumerate(loops):
        part = _find_rows(loop, bodies)
        rows.append(part)
        owners += [k] * len(part)
    names = [name for name, body in bodies.items() if body.kind != "free"]
    index = {name: i for i, name in enumerate(names)}
    matrix = np.vstack(rows)[:, [list(bodies).index(name) for name in names]]
    for coupling in couplings:
        dependent = index[coupling["dependent"]]
        for term in coupling["terms"]:
            matrix[:, index[term["joint"]]] += term["ratio"] * matrix[:, dependent]
        matrix[:, dependent] = 0.0
    scale = np.linalg.norm(matrix, axis=0)
    scaled = matrix / np.where(scale > 1e-9, scale, np.inf)
    own = {name for loop in loops for name in _path(loop["terminal"], loop["root"], bodies)}
    weight = np.array([1.0 if name in own else 0.5 for name in names])
    paths = [_list_joints(loop, bodies, scaled, index) for loop in loops]
    chosen = _pick(scaled * weight)
    owned = _match(chosen, [loop["cut"]["type"] for loop in loops], paths, names)
    for k, loop in enumerate(loops):
        loop["dependent"] = owned[k] if owned else paths[k]


def _path(body: str, root: str, bodies: dict[str, _Body]) -> list[str]:
    path: list[str] = []
    while body not in (root, BASE):
        path.insert(0, body)
        body = bodies[body].parent
    return path


def _list_joints(
    loop: dict, bodies: dict[str, _Body], matrix: np.ndarray, index: dict[str, int]
) -> list[str]:
    """Return the joints of a loop that can depend on others, those of its branch first."""
    both = [_path(loop[end], loop["root"], bodies) for end in ("terminal", "closing")]
    names = [name for path in both for name in path if name in index]
    return [name for name in names if matrix[:, index[name]].any()]


EQUATIONS = {"R3": 3, "R2": 4, "R1": 5, "R1_planar": 2}


def _find_rows(loop: dict, bodies: dict[str, _Body]) -> np.ndarray:
    """Return the rates of the equations of a cut per rate of each body's joint, at home."""

    def turn(end: str, vectors: list) -> np.ndarray:
        """Return vectors in axes of the root, of the terminal or of the closing body in ours."""
        body = bodies.get(loop[end])
        return np.array(vectors) @ (body.rotation.T if body else np.eye(3))

    cut = loop["cut"]
    speed, spin = (np.zeros((3, len(bodies))) for _ in range(2))
    point = bodies[loop["terminal"]].origin + turn("terminal", cut["point_on_terminal"])
    for end, sign in (("terminal", 1.0), ("closing", -1.0)):
        for name in _path(loop[end], BASE, bodies):
            body, i = bodies[name], list(bodies).index(name)
            axis = sign * body.rotation @ body.axis
            if body.kind == "prismatic":
                speed[:, i] += axis
            elif body.kind == "revolute":
                speed[:, i] += np.cross(axis, point - body.origin)
                spin[:, i] += axis
    if cut["type"] == "R3":
        return speed
    if cut["type"] == "R1_planar":
        return turn("root", cut["plane_axes_in_root"]) @ speed
    axis = turn("terminal", cut["axis_on_terminal"])
    if cut["type"] == "R1":
        return np.vstack([speed, find_across(axis) @ spin])
    return np.vstack([speed, np.cross(axis, turn("closing", cut["axis_on_closing"])) @ spin])


def _pick(matrix: np.ndarray) -> list[int]:
    """Return independent columns, the largest first, or none if the rows are not independent."""
    rest, chosen = matrix.copy(), []
    for _ in range(len(matrix)):
        sizes = np.linalg.norm(rest, axis=0)
        best = int(np.argmax(sizes))
        if sizes[best] < 1e-7:
            return []
        chosen.append(best)
        unit = rest[:, best] / sizes[best]
        rest -= np.outer(unit, unit @ rest)
    return chosen


def _match(
    chosen: list[int], kinds: list[str], paths: list[list[str]], names: list[str]
) -> list[list[str]]:
    """Return joints for each loop, as many as it has equations; nothing if there is no choice."""
    slots = [k for k, kind in enumerate(kinds) for _ in range(EQUATIONS[kind])]
    held: dict[int, int] = {}  # column in each slot

    def place(column: int, seen: set[int]) -> bool:
        for slot, k in enumerate(slots):
            if slot in seen or names[column] not in paths[k]:
                continue
            seen.add(slot)
            if slot not in held or place(held[slot], seen):
                held[slot] = column
                return True
        return False

    if len(chosen) != len(slots) or not all(place(column, set()) for column in chosen):
        return []
    owned = [[names[held[s]] for s in held if slots[s] == k] for k in range(len(kinds))]
    return [sorted(own, key=paths[k].index) for k, own in enumerate(owned)]


def _write_forces(robot: Robot, tree: Tree, joints: dict[str, str]) -> list[dict[str, Any]]:
    elements = []
    for joint, _ in tree.edges.values():
        for dof in joint.dofs:
            laws = _write_laws(robot, dof)
            if laws:
                along = [{"joint": joints[dof.name]}]
                elements.append({"name": dof.name, "along": along, "laws": laws})
    for dof, terms in robot.tendons:
        if lost := [name for name, _ in terms if name not in joints]:
            what = f"forces of tendon '{dof.name}': the joint of '{lost[0]}' is cut"
            robot.report.say(LEFT_OUT, what)
            continue
        sum_of = [{"joint": joints[name], "ratio": ratio} for name, ratio in terms]
        elements.append({"name": dof.name, "along": sum_of, "laws": _write_laws(robot, dof)})
    return elements


def _write_laws(robot: Robot, dof: Dof) -> list[dict[str, Any]]:
    law: Law = dof.law
    laws: list[dict[str, Any]] = []
    if law.stiffness:
        laws.append({"type": "spring", "stages": [[0.0, law.stiffness]], "rest": law.rest})
    if law.damping:
        laws.append({"type": "damper", "linear": law.damping})
    if law.friction:
        laws.append({"type": "brake", "forward": law.friction})
    if np.isfinite([law.lower, law.upper]).any():
        default, toe = STOPS[dof.kind]
        stiffness = law.stop_stiffness or default
        if law.stop_stiffness is None:
            unit = "N/m" if dof.kind == "prismatic" else "N m/rad"
            what = f"stops of '{dof.name}' have {stiffness:g} {unit}: the file has no stiffness"
            robot.report.say(GUESSED, what)
        ends = [max(law.lower, -_FAR), min(law.upper, _FAR)]
        far = max((abs(end) for end in ends if abs(end) < _FAR), default=0.0)
        if dof.kind == "revolute" and far > _TURNED:
            what = f"limits are radians, although '{dof.name}' turns up to {far:g}: degrees?"
            robot.report.say(GUESSED, what)
        laws.append(
            {
                "type": "stop",
                "lower": ends[0],
                "upper": ends[1],
                "stiffness": stiffness,
                "toe": toe,
            }
        )
    return laws


def _list_legs(loops: list[dict], bodies: dict[str, _Body]) -> list[dict[str, Any]]:
    """Return the legs of a platform, which then have outputs: two turns, a slide, a ball."""
    legs = []
    for loop in loops:
        path = _path(loop["terminal"], loop["root"], bodies)
        kinds = [bodies[name].kind for name in path]
        free = bodies.get(loop["closing"])
        if kinds == ["revolute", "revolute", "prismatic"] and free and free.kind == "free":
            foot, rod = bodies[path[0]], bodies[path[2]]
            tip = rod.origin + rod.rotation @ np.array(loop["cut"]["point_on_terminal"])
            length = float(np.linalg.norm(tip - foot.origin))
            legs.append({"name": loop["name"], "slide": path[2], "home_length": length})
    return legs
