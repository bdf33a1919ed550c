"""Reads URDF: a tree of links, joints with limits, damping, friction and mimic."""

from xml.etree.ElementTree import Element

import numpy as np

from dockloop.base.rotations import find_across, make_symmetric
from dockloop.exchange.constructs import GUESSED, SIX, URDF, URDF_PARTS
from dockloop.exchange.robot import (
    WORLD,
    Coupling,
    Dof,
    Joint,
    Law,
    Link,
    Node,
    Report,
    Robot,
    meet_all,
    rotate_quaternion,
    rotate_rpy,
)

_KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
_OTHERS = {"fixed": "fixed", "floating": "free", "planar": "planar"}


def read_urdf(file: str, root: Element) -> Robot:
    """Read a robot; its base is the link without parent. Raises UsageError."""
    model = Node(file, root)
    robot = Robot(model.name(), Report(file, URDF, URDF_PARTS))
    meet_all(robot.report, root)
    links = {node.name(): node for node in model.all("link")}
    above: dict[str, Node] = {}  # joint above each link
    for node in model.all("joint"):
        parent, child = (_end(node, tag) for tag in ("parent", "child"))
        for end in (parent, child):
            if end not in links:
                raise node.fail(f"names the link '{end}', not there")
        if child == WORLD and node.attribute("type") != "fixed":
            raise node.fail(f"moves the link '{WORLD}', which stands still: give it another name")
        if child in above:
            raise node.fail(f"makes '{child}' the child of two joints: URDF has no loops, use SDF")
        above[child] = node
    roots = [name for name in links if name not in above]
    if len(roots) != 1:
        raise model.fail(f"has {len(roots)} links without parent: a tree has one")
    robot.base = roots[0]
    for node in model.all("link"):
        link = _read_link(node, above, links)
        robot.add_link(link)
        for visual in node.all("visual"):
            if mesh := visual.find("geometry/mesh"):
                turn, step = _read_origin(visual)
                pose = link.rotation @ turn, link.origin + link.rotation @ step
                scale = mesh.attribute("scale", "1 1 1")
                robot.add_mesh(link.name, mesh, mesh.attribute("filename"), pose, scale)
    for node in model.all("joint"):
        robot.add_joint(_read_joint(node, robot))
        if mimic := node.find("mimic"):
            leader = mimic.attribute("joint")
            ratio, offset = mimic.number("multiplier", 1.0), mimic.number("offset", 0.0)
            name = node.name()
            robot.couplings.append(Coupling(f"{name}_mimic", name, [(leader, ratio)], offset))
    return robot


def _end(node: Node, tag: str) -> str:
    found = node.find(tag)
    if found is None:
        raise node.fail(f"lacks the element '{tag}'")
    return found.attribute("link")


def _read_origin(node: Node) -> tuple[np.ndarray, np.ndarray]:
    origin = node.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    point = origin.vector("xyz", "0 0 0")
    text = origin.element.get("quat_xyzw")
    if text is None:
        return rotate_rpy(origin.vector("rpy", "0 0 0")), point
    quaternion = origin.numbers(text, "quat_xyzw", 4)
    if not quaternion.any() or "rpy" in origin.element.attrib:
        raise origin.fail("has 'quat_xyzw': must not be zero, and there must be no 'rpy'")
    return rotate_quaternion(quaternion[[3, 0, 1, 2]]), point


def _read_link(node: Node, above: dict[str, Node], links: dict[str, Node]) -> Link:
    rotation, origin, name = np.eye(3), np.zeros(3), node.name()
    for _ in links:
        if name not in above:
            break
        turn, step = _read_origin(above[name])
        rotation, origin = turn @ rotation, turn @ origin + step
        name = _end(above[name], "parent")
    else:
        raise node.fail("stands on itself: its joints make a ring")
    link = Link(node.name(), rotation, origin)
    if inertial := node.find("inertial"):
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or inertia is None:
            raise inertial.fail("lacks 'mass' or 'inertia'")
        turn, link.com = _read_origin(inertial)
        link.mass = mass.number("value")
        six = [inertia.number(key, None if key in SIX[:3] else 0.0) for key in SIX]
        link.inertia = turn @ make_symmetric(six) @ turn.T
    return link


def _read_joint(node: Node, robot: Robot) -> Joint:
    name, kind = node.name(), node.attribute("type")
    if kind not in _KINDS | _OTHERS:
        raise node.fail(f"has the type '{kind}': known are {', '.join(_KINDS | _OTHERS)}")
    child = robot.links[_end(node, "child")]
    point = child.origin
    joint = Joint(name, (_KINDS | _OTHERS)[kind], _end(node, "parent"), child.name, point)
    law = _read_law(node, kind)
    if kind not in _KINDS:
        robot.report.say_lost(name, kind, law if kind != "fixed" else Law())
    if kind in ("fixed", "floating"):
        return joint
    given = node.find("axis")
    local = given.direction(given.attribute("xyz"), "xyz") if given else np.array([1.0, 0.0, 0.0])
    axis = child.rotation @ local
    if kind == "planar":
        across = find_across(axis)
        axes = [(across[0], "prismatic"), (across[1], "prismatic"), (axis, "revolute")]
        dofs = [Dof(f"{name}_{i}", k, a, point) for i, (a, k) in enumerate(axes, 1)]
        joint.dofs = dofs
        return joint
    if kind == "continuous":
        robot.report.say_lost(name, kind, Law(law.lower, law.upper))
        law.lower, law.upper = -np.inf, np.inf
    elif node.find("limit") is None:
        robot.report.say(GUESSED, f"joint '{name}' states no limit: it has no stops")
    joint.dofs = [Dof(name, _KINDS[kind], axis, point, law)]
    return joint


def _read_law(node: Node, kind: str) -> Law:
    """Return forces and limits of a joint; a slide or turn without ends has both at 0."""
    law = Law()
    if dynamics := node.find("dynamics"):
        law.damping = dynamics.number("damping", 0.0)
        law.friction = dynamics.number("friction", 0.0)
    if limit := node.find("limit"):
        is_ended = kind in ("revolute", "prismatic")
        end = 0.0 if is_ended else np.inf
        law.lower = limit.end(limit.element.get("lower", ""), "lower", 0.0 - end)
        law.upper = limit.end(limit.element.get("upper", ""), "upper", end)
        if is_ended:
            limit.check_limits(law.lower, law.upper)
    return law
