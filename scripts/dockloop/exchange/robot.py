"""What a file of another tool describes: links and joints at the pose of the file, and a report.

All points and axes are in one frame, that of the model; all coordinates are zero at this pose.
"""

import itertools
import re
from collections import Counter
from collections.abc import Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.number import read_number
from dockloop.base.rotations import find_matrix
from dockloop.exchange.constructs import (
    GUESSED,
    LEFT_OUT,
    MAPPED,
    REFUSED,
    UNKNOWN,
    Row,
    find_row,
)

_INFINITE = re.compile(r"([+-]?)inf(?:inity)?", re.IGNORECASE)
Pose = tuple[np.ndarray, np.ndarray]  # rotation, origin
WORLD = "world"  # the link that does not move


@dataclass
class Law:
    """Forces of one coordinate, counted from the pose of the file; SI units, angles in rad."""

    lower: float = -np.inf
    upper: float = np.inf
    stop_stiffness: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0

    def is_empty(self) -> bool:
        """Return whether there is no force at all."""
        forces = self.damping or self.friction or self.stiffness
        return not (forces or np.isfinite([self.lower, self.upper]).any())


@dataclass
class Dof:
    """A turn (``revolute``) or a slide (``prismatic``) of the child against the parent."""

    name: str
    kind: str
    axis: np.ndarray
    point: np.ndarray
    law: Law = field(default_factory=Law)


@dataclass
class Joint:
    """A joint: its kind, its coordinates from parent to child, its point on either link."""

    name: str
    kind: str
    parent: str
    child: str
    point: np.ndarray
    dofs: list[Dof] = field(default_factory=list)
    point_on_child: np.ndarray | None = None  # where it differs: the loop is open by that


@dataclass
class Link:
    """A rigid body: rotation and origin of its axes, mass, centre of mass and inertia there."""

    name: str
    rotation: np.ndarray
    origin: np.ndarray
    mass: float = 0.0
    com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))


class Mesh(NamedTuple):
    """A file that draws a link: where its axes are, and its scale along them."""

    link: str
    file: str
    rotation: np.ndarray
    origin: np.ndarray
    scale: np.ndarray


@dataclass
class Coupling:
    """Coordinate of ``dependent`` = offset + sum of ratio x coordinate; names of `Dof`."""

    name: str
    dependent: str
    terms: list[tuple[str, float]]
    offset: float = 0.0


class Tendon(NamedTuple):
    """Forces along a sum of ratio x coordinate of joints; `along` has the laws."""

    along: Dof
    terms: list[tuple[str, float]]


class Report:
    """What was mapped, guessed and left out, in words."""

    def __init__(self, file: str, table: dict[str, Row], parts: Set[str] | None = None) -> None:
        """Begin a report.

        Args:
            file: as messages show it.
            table: of the format.
            parts: what is read with the rows of this table; None: all that has no row.
        """
        self.file, self.table, self._parts = file, table, parts
        self._met: Counter[str] = Counter()
        self.lines: list[str] = []

    def meet(self, path: str, name: str = "") -> None:
        """Count a construct of the file. Raises UsageError for one that is refused."""
        key, row = find_row(self.table, path)
        if row.what == REFUSED:
            named = f" '{name}'" if name else ""
            raise UsageError(f"{self.file}: {path}{named} cannot be mapped: {row.text}")
        is_part = self._parts is None or path in self._parts or row.what == LEFT_OUT
        if path == key or not is_part:  # a part belongs to that row
            self._met[path] += 1

    def meet_kind(self, path: str) -> None:
        """Count a kind of construct that may have a row of its own."""
        if path in self.table:
            self.meet(path)

    def say_lost(self, name: str, kind: str, law: Law) -> None:
        """Say that a joint whose coordinates carry no laws has some in the file."""
        if not law.is_empty():
            what = "limits" if kind == "continuous" else "forces and limits"
            self.say(LEFT_OUT, f"{what} of '{name}': a {kind} joint has none here")

    def say(self, what: str, text: str) -> None:
        """Add a line about a single part."""
        line = f"{what}: {text}"
        if line not in self.lines:
            self.lines.append(line)

    def describe(self) -> list[str]:
        """Return all lines: constructs of the file, then single parts; what was mapped first."""
        lines = []
        for path, count in self._met.items():
            row = self.table.get(path, UNKNOWN)
            lines.append(f"{row.what}: {path} ({count}): {row.text}")
        order = (MAPPED, GUESSED, LEFT_OUT)
        lines += self.lines
        return sorted(lines, key=lambda line: order.index(line.partition(":")[0]))


@dataclass
class Robot:
    """A mechanism as another tool describes it."""

    name: str
    report: Report
    links: dict[str, Link] = field(default_factory=dict)
    joints: list[Joint] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    tendons: list[Tendon] = field(default_factory=list)
    meshes: list[Mesh] = field(default_factory=list)
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    base: str = WORLD

    def add_link(self, link: Link) -> None:
        """Add a link. Raises UsageError for a second one of its name."""
        if link.name in self.links:
            raise UsageError(f"{self.report.file}: the link '{link.name}' is there twice")
        self.links[link.name] = link

    def add_mesh(self, link: str, node: "Node", file: str, pose: Pose, scale: str) -> None:
        """Add what an element of a file draws; packages of other tools lie next to the file."""
        rest = re.sub(r"^(package|model)://[^/]*/|^file://", "", file)
        path = str(Path(self.report.file).parent / rest)
        self.meshes.append(Mesh(link, path, *pose, node.numbers(scale, "scale", 3)))

    def add_joint(self, joint: Joint) -> None:
        """Add a joint between links that are there. Raises UsageError."""
        file = self.report.file
        if any(other.name == joint.name for other in self.joints):
            raise UsageError(f"{file}: the joint '{joint.name}' is there twice")
        for end in (joint.parent, joint.child):
            if end != WORLD and end not in self.links:
                raise UsageError(f"{file}: joint '{joint.name}' names the link '{end}', not there")
        if joint.parent == joint.child:
            raise UsageError(f"{file}: joint '{joint.name}' joins '{joint.child}' with itself")
        for dof, other in itertools.combinations(joint.dofs, 2):
            is_same = dof.kind == other.kind and np.allclose(dof.point, other.point)
            if is_same and np.linalg.norm(np.cross(dof.axis, other.axis)) < 1e-9:
                raise UsageError(
                    f"{file}: joint '{joint.name}' has two coordinates along one axis, '{dof.name}'"
                    f" and '{other.name}': leave one out"
                )
        self.joints.append(joint)


def meet_all(report: Report, model: Element) -> None:
    """Count all constructs of a model: elements and attributes."""

    def visit(element: Element, path: str) -> None:
        for child in element:
            at = f"{path}{child.tag}"
            report.meet(at, child.get("name", ""))
            if at == "joint":
                report.meet_kind(f"joint[{child.get('type')}]")
            if find_row(report.table, at)[1].what != LEFT_OUT:
                for key in child.attrib:
                    report.meet(f"{at}/@{key}")
                visit(child, f"{at}/")

    visit(model, "")


class Node:
    """An element of a file, with messages that name it."""

    def __init__(self, file: str | Path, element: Element, owner: str = "") -> None:
        self.file, self.element = str(file), element
        name = element.get("name")
        self.place = f"{owner} {element.tag}".strip() + (f" '{name}'" if name else "")

    def fail(self, text: str) -> UsageError:
        """Return the error of this element."""
        return UsageError(f"{self.file}: {self.place} {text}")

    def find(self, path: str) -> "Node | None":
        """Return the element below this one, None if it is not there. Raises UsageError: twice."""
        found = self.element.findall(path)
        if len(found) > 1:
            raise self.fail(f"has {len(found)} elements '{path}': must have one")
        return Node(self.file, found[0], self.place) if found else None

    def all(self, tag: str) -> list["Node"]:
        """Return all elements of a kind directly below this one."""
        return [Node(self.file, found, self.place) for found in self.element.findall(tag)]

    def name(self) -> str:
        """Return the name. Raises UsageError if there is none."""
        return self.attribute("name")

    def attribute(self, key: str, default: str | None = None) -> str:
        """Return an attribute. Raises UsageError if it is not there and has no default."""
        text = self.element.get(key, default)
        if not text:
            raise self.fail(f"lacks the attribute '{key}'")
        return text

    def text(self, path: str, default: str | None = None) -> str:
        """Return the text of an element below. Raises UsageError like `attribute`."""
        found = self.find(path)
        text = (found.element.text or "" if found else "").strip() or default
        if text is None:
            raise self.fail(f"lacks the element '{path}'")
        return text

    def numbers(self, text: str, what: str, count: int) -> np.ndarray:
        """Return finite numbers of a text. Raises UsageError."""
        try:
            values = np.array([read_number(word) for word in text.split()])
        except ValueError:
            values = np.array([np.nan])
        if len(values) != count or not np.isfinite(values).all():
            need = f"{count} finite numbers" if count > 1 else "a finite number"
            raise self.fail(f"has '{what}' {text!r}: must be {need}")
        return values

    def vector(self, key: str, default: str | None = None) -> np.ndarray:
        """Return three numbers of an attribute."""
        return self.numbers(self.attribute(key, default), key, 3)

    def number(self, key: str, default: float | None = None) -> float:
        """Return a number of an attribute."""
        text = self.attribute(key, None if default is None else repr(default))
        return float(self.numbers(text, key, 1)[0])

    def value(self, path: str, default: float) -> float:
        """Return a number in an element below."""
        return float(self.numbers(self.text(path, repr(default)), path, 1)[0])

    def end(self, text: str, what: str, default: float) -> float:
        """Return the limit that a text is: a number or an infinity; empty: the default."""
        infinite = _INFINITE.fullmatch(text)
        if infinite:
            return -np.inf if infinite[1] == "-" else np.inf
        return float(self.numbers(text, what, 1)[0]) if text else default

    def check_limits(self, lower: float, upper: float) -> None:
        """Raise UsageError: limits that leave no motion."""
        if not lower < upper:
            raise self.fail(f"has the limits {lower:g} and {upper:g}: the first must be less")

    def direction(self, text: str, what: str) -> np.ndarray:
        """Return a unit vector. Raises UsageError for zero."""
        axis = self.numbers(text, what, 3)
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise self.fail(f"has '{what}' {text!r}: must not be zero")
        return axis / length


def rotate_rpy(rpy: np.ndarray) -> np.ndarray:
    """Return the rotation of roll, pitch, yaw [rad] about fixed axes."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ about_y @ about_x


def rotate_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation of a quaternion (w, x, y, z), which need not have the length 1."""
    return find_matrix(quaternion / np.linalg.norm(quaternion))


def make_ball(name: str, point: np.ndarray, axes: np.ndarray) -> list[Dof]:
    """Return the three turns of a ball about the columns of `axes`."""
    return [Dof(f"{name}_{i + 1}", "revolute", axes[:, i], point) for i in range(3)]
