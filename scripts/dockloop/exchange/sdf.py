"""Reads SDF (up to 1.11): links, joints, frames. A link may be the child of two joints."""

from collections.abc import Callable
from functools import cache
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.rotations import make_symmetric
from dockloop.exchange.constructs import GUESSED, LEFT_OUT, MAPPED, SDF, SDF_PARTS, SIX
from dockloop.exchange.robot import (
    WORLD,
    Coupling,
    Dof,
    Joint,
    Law,
    Link,
    Node,
    Pose,
    Report,
    Robot,
    make_ball,
    meet_all,
    rotate_quaternion,
    rotate_rpy,
)

_MODEL = "__model__"
_NO_LIMIT = 1e15  # limits beyond are none: the default of the format is 1e16
_AXES = {"revolute": 1, "continuous": 1, "prismatic": 1, "universal": 2, "revolute2": 2}
_AXES |= {"screw": 1, "gearbox": 0, "ball": 0, "fixed": 0}


def read_sdf(file: str, root: Element) -> Robot:
    """Read the one model of a file. Raises UsageError."""
    models = root.findall("model") + root.findall("world/model")
    if len(models) != 1:
        raise UsageError(f"{file}: has {len(models)} models: an import needs one")
    _renew(root)
    model = Node(file, models[0])
    robot = Robot(model.name(), Report(file, SDF, SDF_PARTS))
    meet_all(robot.report, models[0])
    _read_world(root, model, robot)
    place = _find_frames(model)
    for node in model.all("link"):
        robot.add_link(_read_link(node, place, robot.report))
        _read_meshes(node, place, robot)
    nodes = {node.name(): node for node in model.all("joint")}
    for node in nodes.values():
        if (kind := node.attribute("type")) != "gearbox":
            robot.add_joint(_read_joint(node, kind, robot, place))
            if kind == "screw":
                robot.couplings.append(_read_screw(node, robot.report))
        for axis, number in (("axis", 1), ("axis2", 2)):
            if mimic := node.find(f"{axis}/mimic"):
                robot.couplings.append(_read_mimic(mimic, node, number, nodes))
    for node in nodes.values():
        if node.attribute("type") == "gearbox":
            robot.couplings.append(_read_gearbox(node, robot))
    return robot


def _renew(root: Element) -> None:
    """Write what earlier versions meant by the same words as a version of today has it."""
    version = [int(part) for part in root.get("version", "").split(".") if part.isdecimal()]
    axes = [*root.iter("axis"), *root.iter("axis2")] if version and version < [1, 5] else []
    for axis in axes:
        if axis.find("use_parent_model_frame") is None:
            SubElement(axis, "use_parent_model_frame").text = "true"
    for pose in root.iter("pose"):
        if frame := pose.attrib.pop("frame", ""):  # of before 1.7
            pose.set("relative_to", frame)


def _read_world(root: Element, model: Node, robot: Robot) -> None:
    """Take gravity from the world around a model, and say what else is there."""
    world = Node(robot.report.file, root).find("world")
    if world is None:
        return
    if world.find("gravity"):
        pose = model.find("pose")
        turn = _read_pose(pose)[0] if pose else np.eye(3)
        robot.gravity = turn.T @ world.numbers(world.text("gravity"), "gravity", 3)
        robot.report.say(MAPPED, "world/gravity: gravity of the mechanism")
    if others := sorted({child.tag for child in world.element} - {"model", "gravity"}):
        robot.report.say(LEFT_OUT, f"of the world: {', '.join(others)}; its model is read only")


def _find_frames(model: Node) -> Callable[[str], Pose]:
    """Return what gives the pose of a link, joint or frame in the model; joints then name links."""
    nodes: dict[str, Node] = {}
    for tag in ("link", "joint", "frame"):
        for node in model.all(tag):
            if nodes.setdefault(node.name(), node) is not node:
                raise node.fail("has the name of another link, joint or frame")
    pending: set[str] = set()

    @cache
    def find(name: str) -> Pose:
        if name in (_MODEL, WORLD):
            return np.eye(3), np.zeros(3)
        if name not in nodes:
            raise UsageError(f"{model.file}: {model.place} names the frame '{name}', not there")
        if name in pending:
            raise nodes[name].fail("stands relative to itself")
        pending.add(name)
        node = nodes[name]
        default = {"joint": lambda: node.text("child"), "link": lambda: _MODEL}
        start = default.get(node.element.tag, lambda: node.element.get("attached_to") or _MODEL)()
        return _place(node, start, find)

    def find_link(name: str) -> str:
        seen: set[str] = set()
        while True:
            if name == _MODEL:
                links = [link.name() for link in model.all("link")]
                name = model.element.get("canonical_link") or next(iter(links), WORLD)
            node = nodes.get(name)
            if node is None or node.element.tag == "link":  # what is not there is refused later
                return name
            if name in seen:
                raise node.fail("is attached to itself")
            seen.add(name)
            is_joint = node.element.tag == "joint"
            name = node.text("child") if is_joint else node.element.get("attached_to") or _MODEL

    for joint in model.all("joint"):
        find(joint.name())  # stands where the frame of its child is, which is no more named then
        for tag in ("parent", "child", "gearbox_reference_body"):
            if end := joint.find(tag):
                end.element.text = find_link(joint.text(tag))
    return find


def _place(node: Node, start: str, find: Callable[[str], Pose]) -> Pose:
    """Return the pose of an element: its ``pose``, relative to what that names, else `start`."""
    pose = node.find("pose")
    if pose is None:
        return find(start)
    rotation, origin = find(pose.element.get("relative_to") or start)
    turn, step = _read_pose(pose)
    return rotation @ turn, origin + rotation @ step


def _read_pose(pose: Node) -> Pose:
    """Return rotation and step of a ``pose``."""
    text = pose.element.text or "0 0 0 0 0 0"
    if pose.element.get("rotation_format") == "quat_xyzw":
        values = pose.numbers(text, "pose", 7)
        if not np.any(values[3:]):
            raise pose.fail("has the quaternion 0 0 0 0: must not be zero")
        return rotate_quaternion(values[[6, 3, 4, 5]]), values[:3]
    values = pose.numbers(text, "pose", 6)
    angles = np.radians(values[3:]) if pose.element.get("degrees") == "true" else values[3:]
    return rotate_rpy(angles), values[:3]


def _read_link(node: Node, place: Callable, report: Report) -> Link:
    rotation, origin = place(node.name())
    link = Link(node.name(), rotation, origin)
    inertial = node.find("inertial")
    if inertial and inertial.element.get("auto") in ("true", "1"):
        raise inertial.fail(
            "has auto='true', numbers from shapes: expand it with"
            " 'gz sdf --expand-auto-inertials -p FILE' first"
        )
    if inertial is None or inertial.find("mass") is None or inertial.find("inertia") is None:
        what = f"link '{link.name}' states no mass or inertia: 1 kg and 1 kg m2, as the format says"
        report.say(GUESSED, what)
    inertial = inertial or Node(node.file, Element("inertial"), node.place)
    pose = inertial.find("pose")
    turn, link.com = _read_pose(pose) if pose else (np.eye(3), np.zeros(3))
    link.mass = inertial.value("mass", 1.0)
    six = [inertial.value(f"inertia/{key}", float(key in SIX[:3])) for key in SIX]
    link.inertia = turn @ make_symmetric(six) @ turn.T
    return link


def _read_meshes(link: Node, place: Callable, robot: Robot) -> None:
    for visual in link.all("visual"):
        if mesh := visual.find("geometry/mesh"):
            pose, scale = _place(visual, link.name(), place), mesh.text("scale", "1 1 1")
            robot.add_mesh(link.name(), mesh, mesh.text("uri"), pose, scale)


def _read_joint(node: Node, kind: str, robot: Robot, place: Callable) -> Joint:
    """Read any joint that is not a gearbox."""
    name = node.name()
    if kind not in _AXES:
        raise node.fail(f"has the type '{kind}': known are {', '.join(_AXES)}")
    rotation, point = place(name)
    joint = Joint(name, kind, node.text("parent"), node.text("child"), point)
    if kind == "ball":
        joint.dofs = make_ball(name, point, rotation)
        if axis := node.find("axis"):
            robot.report.say_lost(name, kind, _read_law(axis))
        return joint
    for i, tag in enumerate(("axis", "axis2")[: _AXES[kind]], 1):
        axis = node.find(tag) or Node(node.file, Element(tag), node.place)
        xyz = axis.find("xyz")
        frame = xyz.element.get("expressed_in") if xyz else None
        if axis.text("use_parent_model_frame", "false") in ("true", "1"):
            frame = _MODEL
        local = axis.direction(axis.text("xyz", "0 0 1"), "xyz")
        turn = place(frame)[0] if frame else rotation
        dof = Dof(name if _AXES[kind] == 1 else f"{name}_{i}", "revolute", turn @ local, point)
        dof.kind = "prismatic" if kind == "prismatic" else "revolute"
        dof.law = _read_law(axis)
        joint.dofs.append(dof)
    if kind == "continuous":
        law = joint.dofs[0].law
        robot.report.say_lost(name, kind, Law(law.lower, law.upper))
        law.lower, law.upper = -np.inf, np.inf
    if kind == "screw":
        slide = Dof(f"{name}_slide", "prismatic", joint.dofs[0].axis, point)
        joint.dofs.append(slide)
    return joint


def _read_law(axis: Node) -> Law:
    value = axis.value
    lower, upper = (
        axis.end(axis.text(path, ""), path, end)
        for path, end in (("limit/lower", -np.inf), ("limit/upper", np.inf))
    )
    axis.check_limits(lower, upper)
    stiffness = value("limit/stiffness", 0.0)
    return Law(
        lower=lower if lower > -_NO_LIMIT else -np.inf,
        upper=upper if upper < _NO_LIMIT else np.inf,
        stop_stiffness=stiffness if stiffness > 0.0 and axis.find("limit/stiffness") else None,
        damping=value("dynamics/damping", 0.0),
        friction=value("dynamics/friction", 0.0),
        stiffness=value("dynamics/spring_stiffness", 0.0),
        rest=value("dynamics/spring_reference", 0.0),
    )


def _read_screw(node: Node, report: Report) -> Coupling:
    """Slide per turn of a screw, from the pitch of either version of the format."""
    name = node.name()
    if node.find("screw_thread_pitch"):
        ratio = node.value("screw_thread_pitch", 0.0) / (2 * np.pi)
    else:
        pitch = node.value("thread_pitch", 1.0)  # -rad/m
        if pitch == 0.0:
            raise node.fail("has 'thread_pitch' 0: must not be zero")
        ratio = -1.0 / pitch
        report.say(GUESSED, f"joint '{name}': thread_pitch is minus the turn [rad] per travel [m]")
    return Coupling(name, f"{name}_slide", [(name, ratio)])


def _read_mimic(mimic: Node, node: Node, number: int, nodes: dict[str, Node]) -> Coupling:
    leader = mimic.attribute("joint")
    if leader not in nodes:
        raise mimic.fail(f"names the joint '{leader}', not there")
    follower = node.name()
    if _AXES.get(node.attribute("type")) == 2:
        follower = f"{follower}_{number}"
    if _AXES.get(nodes[leader].attribute("type")) == 2:
        leader += "_2" if mimic.element.get("axis") == "axis2" else "_1"
    ratio, reference = mimic.value("multiplier", 1.0), mimic.value("reference", 0.0)
    offset = mimic.value("offset", 0.0) - ratio * reference
    return Coupling(f"{follower}_mimic", follower, [(leader, ratio)], offset)


def _read_gearbox(node: Node, robot: Robot) -> Coupling:
    """Turn of the child = -ratio x turn of the parent, both against the reference body."""
    reference = node.text("gearbox_reference_body")
    joints = []
    for end in (node.text("parent"), node.text("child")):
        found = [j for j in robot.joints if {j.parent, j.child} == {reference, end}]
        if len(found) != 1 or len(found[0].dofs) != 1:
            raise node.fail(f"needs a revolute joint between '{reference}' and '{end}'")
        joints.append((found[0], 1.0 if found[0].child == end else -1.0))
    (first, a), (second, b) = joints
    ratio = -node.value("gearbox_ratio", 1.0) * a * b
    return Coupling(node.name(), second.dofs[0].name, [(first.dofs[0].name, ratio)])
