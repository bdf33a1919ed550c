"""Which links are one body, which joints of loops are cut, and the tree that is left."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.exchange.constructs import GUESSED, LEFT_OUT
from dockloop.exchange.robot import WORLD, Joint, Link, Robot

CUTS = {"ball": ("R3", 3), "universal": ("R2", 4), "revolute": ("R1", 5), "continuous": ("R1", 5)}
_GROUND = "ground"  # what the world is called where another link is the base
_LEG = 6  # coordinates of a leg of a platform that moves freely, its last joint among them


@dataclass
class Tree:
    """Bodies and how they hang together.

    Attributes:
        body_of: the body of each link; `WORLD` for what is fixed to the base.
        bodies: the bodies by name, mass and inertia of all their links, axes of the first.
        edges: joint above each body but the base, parents first; its parent.
        cuts: joints that close loops.
        base: the link to which the axes of the mechanism belong.
    """

    body_of: dict[str, str]
    bodies: dict[str, Link]
    base: Link
    edges: dict[str, tuple[Joint, str]] = field(default_factory=dict)
    cuts: list[Joint] = field(default_factory=list)

    def ends(self, joint: Joint) -> tuple[str, str]:
        """Return the bodies that a joint joins."""
        return self.body_of[joint.parent], self.body_of[joint.child]

    def path(self, body: str) -> list[str]:
        """Return the bodies from the base, without it, to this one."""
        path: list[str] = []
        while body != WORLD:
            path.insert(0, body)
            body = self.edges[body][1]
        return path

    def cycle(self, joint: Joint) -> tuple[list[str], list[str]]:
        """Return the bodies from the last common one, without it, to either end of a cut."""
        a, b = (self.path(end) for end in self.ends(joint))
        while a and b and a[0] == b[0]:
            a, b = a[1:], b[1:]
        return a, b


def make_tree(robot: Robot, base: str | None, ring: str | None, cuts: list[str]) -> Tree:
    """Merge what is fixed, choose the cuts, hang the rest on the base. Raises UsageError."""
    for what, link in (("base", base), ("ring", ring)):
        if link is not None and link not in robot.links and link != WORLD:
            near = did_you_mean(link, robot.links)
            raise UsageError(f"--{what} {link}: {robot.report.file} has no such link{near}")
    tree = _merge(robot, base)
    joints = []
    for joint in robot.joints:
        a, b = tree.ends(joint)
        if a != b:
            joints.append(joint)
        elif joint.kind != "fixed":
            robot.report.say(LEFT_OUT, f"joint '{joint.name}': it joins parts of one body")
    joints = _free_others(robot, tree, joints)
    _cut_by_name(robot, tree, joints, cuts)
    _free_platform(robot, tree, joints, ring)
    while cycle := _hang(tree, joints):
        _cut_one(robot, tree, joints, cycle)
    return tree


def _merge(robot: Robot, base: str | None) -> Tree:
    """Make one body of links that are fixed to each other."""
    if base not in (None, WORLD):
        _leave_world(robot, base)
    names = {name: name for name in [WORLD, *robot.links]}

    def find(name: str) -> str:
        while names[name] != name:
            name = names[name]
        return name

    def join(a: str, b: str) -> None:
        first, other = sorted((find(a), find(b)), key=list(names).index)
        names[other] = first

    for joint in robot.joints:
        if joint.kind == "fixed":
            join(joint.parent, joint.child)
    chosen = base or robot.base
    if chosen == WORLD and not any(WORLD in (j.parent, j.child) for j in robot.joints):
        chosen = next(iter(robot.links), WORLD)
        robot.report.say(GUESSED, f"nothing is joined to the world: the base is link '{chosen}'")
    join(WORLD, chosen)
    body_of = {name: find(name) for name in names}
    members: dict[str, list[Link]] = {}
    for link in robot.links.values():
        members.setdefault(body_of[link.name], []).append(link)
    fixed = sum(link.mass for link in members.get(WORLD, []))
    if fixed:
        what = f"{fixed:.6g} kg of the base: they belong to the vehicle"
        robot.report.say(LEFT_OUT, what)
    frame = robot.links.get(chosen) or Link(WORLD, np.eye(3), np.zeros(3))
    bodies = {name: join_links(links) for name, links in members.items() if name != WORLD}
    return Tree(body_of, bodies, frame)


def _leave_world(robot: Robot, base: str) -> None:
    """Let what was the world be a link without mass, if anything but free joints hangs on it."""
    held = [j for j in robot.joints if WORLD in (j.parent, j.child)]
    if not all(joint.kind == "free" for joint in held):
        robot.links[_GROUND] = Link(_GROUND, np.eye(3), np.zeros(3))
        what = f"the world is the link '{_GROUND}' without mass: the base is link '{base}'"
        robot.report.say(GUESSED, what)
        for joint in held:
            joint.parent = _GROUND if joint.parent == WORLD else joint.parent
            joint.child = _GROUND if joint.child == WORLD else joint.child
    robot.joints = [j for j in robot.joints if (j.kind, j.child) != ("free", base)]


def join_links(links: list[Link]) -> Link:
    """Return rigid bodies as one, in the axes of the first."""
    first = links[0]
    if len(links) == 1:
        return first
    mass = sum(link.mass for link in links)
    coms = [link.origin + link.rotation @ link.com for link in links]
    if mass > 0:
        com = sum(link.mass * at for link, at in zip(links, coms, strict=True)) / mass
    else:
        com = coms[0]
    inertia = np.zeros((3, 3))
    for link, at in zip(links, coms, strict=True):
        d = at - com
        inertia += link.rotation @ link.inertia @ link.rotation.T
        inertia += link.mass * (d @ d * np.eye(3) - np.outer(d, d))
    turn = first.rotation
    local = turn.T @ (com - first.origin)
    return Link(first.name, turn, first.origin, mass, local, turn.T @ inertia @ turn)


def _free_others(robot: Robot, tree: Tree, joints: list[Joint]) -> list[Joint]:
    """Return the joints, with a free one for each group of bodies that hangs nowhere."""
    joints = list(joints)
    for body in tree.bodies:
        if body not in _search(tree, joints, WORLD):
            point = tree.bodies[body].origin
            joints.append(Joint(f"{body}_free", "free", WORLD, body, point))
            robot.report.say(GUESSED, f"body '{body}' is joined to nothing: it is free")
    return joints


def _search(tree: Tree, joints: list[Joint], start: str) -> dict[str, tuple[Joint, str] | None]:
    """Return the bodies that can be met from one, nearest first, with the joint and the parent."""
    found: dict[str, tuple[Joint, str] | None] = {start: None}
    queue = deque([start])
    while queue:
        at = queue.popleft()
        for joint in joints:
            a, b = tree.ends(joint)
            for here, there in ((a, b), (b, a)):
                if here == at and there not in found:
                    found[there] = (joint, at)
                    queue.append(there)
    return found


def _cut_by_name(robot: Robot, tree: Tree, joints: list[Joint], cuts: list[str]) -> None:
    for name in cuts:
        names = [j.name for j in joints if j.kind in CUTS]
        found = next((j for j in joints if j.name == name), None)
        if found is None or found.kind not in CUTS:
            why = f"is {found.kind}" if found else "is no joint"
            can = f"joints that can be cut are {', '.join(names) or 'none'}"
            raise UsageError(f"--cut {name}: {why} of {robot.report.file}; {can}")
        joints.remove(found)
        tree.cuts.append(found)
        end = next((end for end in tree.ends(found) if end not in _search(tree, joints, WORLD)), "")
        if end:
            raise UsageError(f"--cut {name}: '{end}' would hang on nothing: it closes no loop")


def _free_platform(robot: Robot, tree: Tree, joints: list[Joint], ring: str | None) -> None:
    """Let a body on legs of six coordinates each move freely: all its joints are cut."""
    at = {b: [j for j in joints if b in tree.ends(j)] for b in tree.bodies}
    wanted = [tree.body_of[ring]] if ring else sorted(at, key=lambda body: -len(at[body]))
    for body in wanted:
        legs = at.get(body, [])
        least = 2 if ring else 3
        others = [j for j in joints if j not in legs]
        found = _search(tree, others, WORLD)
        used: set[str] = set()
        for joint in legs:
            a, b = tree.ends(joint)
            end, count = (a if b == body else b), len(joint.dofs)
            while joint.kind in CUTS and (step := found.get(end)) and end not in used:
                used.add(end)
                above, end = step
                count += len(above.dofs)
            if count != _LEG or end != WORLD:
                break
        else:
            if len(legs) >= least:
                for joint in legs:
                    joints.remove(joint)
                    tree.cuts.append(joint)
                free = Joint(f"{body}_free", "free", WORLD, body, tree.bodies[body].origin)
                joints.insert(0, free)
                return


def _hang(tree: Tree, joints: list[Joint]) -> Joint | None:
    """Hang all bodies on the base by the shortest paths; return a joint that closes a loop."""
    found = _search(tree, joints, WORLD)
    tree.edges = {}

    def list_below(parent: str) -> None:
        for body, above in found.items():
            if above is not None and above[1] == parent:
                tree.edges[body] = above
                list_below(body)

    list_below(WORLD)
    used = [joint for joint, _ in tree.edges.values()]
    return next((joint for joint in joints if all(joint is not other for other in used)), None)


def _cut_one(robot: Robot, tree: Tree, joints: list[Joint], closing: Joint) -> None:
    """Cut the joint of a loop that leaves the shortest chains; of equal ones the best to solve."""
    a, b = tree.cycle(closing)
    ring = [tree.edges[body][0] for body in a] + [closing]
    ring += [tree.edges[body][0] for body in reversed(b)]
    counts = [len(joint.dofs) for joint in ring]

    def cost(i: int) -> tuple:
        laws = sum(not dof.law.is_empty() for dof in ring[i].dofs)
        is_exact = ring[i].point_on_child is None  # what may be open is cut
        return (
            is_exact,
            max(sum(counts[:i]), sum(counts[i + 1 :])),
            laws,
            CUTS[ring[i].kind][1],
            -i,
        )

    able = [i for i, joint in enumerate(ring) if joint.kind in CUTS]
    if not able:
        names = ", ".join(joint.name for joint in ring)
        raise UsageError(
            f"{robot.report.file}: no joint of the loop through {names} can be cut: one must be a"
            " ball, universal or revolute joint"
        )
    chosen = ring[min(able, key=cost)]
    joints[:] = [joint for joint in joints if joint is not chosen]
    tree.cuts.append(chosen)
