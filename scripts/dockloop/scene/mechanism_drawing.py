"""``dockloop check MECHANISM --draw FILE.svg``: a mechanism at home, on one sheet.

Above, bodies and joints from the side and from the front, to scale. Below, the tree of bodies:
how each one moves, where loops are cut, which joint follows which, where force elements act.
Everything is read from the mechanism file.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from dockloop.base.files import Kind, claim, read_head, write_text
from dockloop.base.palette import FAINT, INK, LATCH, LEG, PAPER, RING, SOFT
from dockloop.scene.resolve import convert_degrees
from dockloop.scene.shapes import (
    draw_hardware,
    draw_hulls,
    find_body_places,
    find_legs,
    find_pins,
    list_legs,
    list_points,
)
from dockloop.scene.sheet import Drawing, Point, Vector

_MADE_BY = "<!-- made by dockloop check -->"
SHEET = Kind("drawing", "dockloop check", lambda path: _MADE_BY.encode() in read_head(path))
_WIDTH, _TOP, _ROW, _INDENT = 960, 400, 17, 16
_COLUMN = 250  # where the notes on a body begin
_NAMES = "xyz"


def write_drawing(
    path: Path, mechanism: dict, report: dict, hulls: Mapping[str, dict] = MappingProxyType({})
) -> None:
    """Write the sheet of a checked mechanism. Raises like `dockloop.base.files.writing`.

    Args:
        path: the file.
        mechanism: its description.
        report: what the core says of it.
        hulls: of the vehicles of its scene, from `place_hulls`.
    """
    claim(path, SHEET, "--draw")
    sheet = draw_mechanism(mechanism, report["home_q"], report["independent"], hulls)
    write_text(path, SHEET, sheet.replace("<title>", f"{_MADE_BY}<title>", 1))


def draw_mechanism(
    mechanism: dict,
    home_q: Sequence[float],
    independent: Sequence[str],
    hulls: Mapping[str, dict] = MappingProxyType({}),
) -> str:
    """Return the sheet as SVG.

    Args:
        mechanism: its description.
        home_q: coordinates of the joints at home, body by body.
        independent: names of the bodies whose joints are independent.
        hulls: as for `write_drawing`.
    """
    rows = list(_list_rows(mechanism, set(independent)))
    height = _TOP + 40 + _ROW * len(rows)
    name = mechanism.get("name", "mechanism")
    d = Drawing(_WIDTH, height, f"{name} at home: bodies, joints, cuts and force elements")
    d.label((30, 24), name, anchor="start", bold=True, size=16)
    _draw_views(d, mechanism, home_q, hulls)
    _draw_legend(d)
    for i, (depth, mark, text, notes) in enumerate(rows):
        y = _TOP + 30 + _ROW * i
        x = 36 + _INDENT * depth
        if mark:
            _draw_joint(d, (x, y), mark)
        d.label((x + 10, y + 4), text, anchor="start", size=11, bold=not mark)
        d.label((_COLUMN, y + 4), notes, anchor="start", size=11, color=SOFT)
    return d.text_of()


def _list_rows(mechanism: dict, independent: set[str]) -> Iterator[tuple[int, str, str, str]]:
    """Yield depth, kind of joint, text and notes, top down."""
    bodies = mechanism.get("bodies", [])
    yield 0, "", "bodies", "joint in its own axes, and what acts there"
    depth = {"base": -1}
    for body in _sort_depth_first(bodies):
        depth[body["name"]] = depth[body["parent"]] + 1
        notes = [_describe_joint(body), *_describe_ties(mechanism, body["name"])]
        if body["name"] in independent:
            notes.insert(0, "independent")
        kind = body["joint"]["type"]
        yield depth[body["name"]], kind, body["name"], "; ".join(notes)
    for leg in list_legs(mechanism):
        if "bodies" not in leg:  # these are in the tree
            kind = f"{leg.get('type', 'leg')} from {leg['root']} to {leg['closing']}"
            if screw := leg.get("screw"):
                kind += f"; screw of {1e3 * screw['lead']:g} mm"
            if gear := leg.get("gear"):
                kind += f"; gear of {gear['ratio']:g}"
            parts = ("crank", "cross", "cyl", "rod", "rotor")
            ties = (_describe_ties(mechanism, f"{leg['name']}_{part}") for part in parts)
            yield 0, "leg", leg["name"], "; ".join((kind, *itertools.chain(*ties)))


def _sort_depth_first(bodies: list[dict], parent: str = "base") -> Iterator[dict]:
    """Yield every body behind its parent, chains together."""
    for body in bodies:
        if body["parent"] == parent:
            yield body
            yield from _sort_depth_first(bodies, body["name"])


def _describe_joint(body: dict) -> str:
    """Say how a body moves."""
    joint = body["joint"]
    if joint["type"] == "free":
        return "free"
    axis = np.array(joint["axis"], float)
    along = int(np.argmax(np.abs(axis)))
    is_plain = abs(axis[along]) > 1 - 1e-9
    shown = _NAMES[along] if is_plain else "(" + ", ".join(f"{a:.3g}" for a in axis) + ")"
    return f"turns about {shown}" if joint["type"] == "revolute" else f"slides along {shown}"


def _describe_ties(mechanism: dict, name: str) -> Iterator[str]:
    """Yield the cut, the coupling and the force elements of a body's joint."""
    for loop in mechanism.get("loops", []):
        if loop["terminal"] == name:
            yield f"cut {loop['cut']['type']} at {loop['closing']} (loop {loop['name']})"
    for row in mechanism.get("couplings", []):
        if row["dependent"] == name:
            terms = [f"{term['ratio']:.4g} {term['joint']}" for term in row["terms"]]
            yield "follows " + " + ".join(terms).replace("+ -", "- ")
    for force in mechanism.get("forces", []):
        joints = [term["joint"] for term in force.get("along", [])] or [force.get("joint")]
        if name in joints:
            laws = [law["type"] for law in force.get("laws", [])] or ["spring, damper"]
            yield f"element {force.get('name', name)}: {', '.join(laws)}"


# ------------------------------------------------------------------- the two views


def _draw_views(
    d: Drawing, mechanism: dict, home_q: Sequence[float], hulls: Mapping[str, dict]
) -> None:
    """Draw the mechanism from the side and from the front, before the hulls."""
    lines, marks = _find_skeleton(mechanism, home_q)
    plain = convert_degrees(mechanism)
    hardware = list_points(plain, home_q, hulls.values())
    points = np.vstack([*(ends for _, *ends in lines), hardware, np.zeros(3)])
    low, high = points.min(axis=0), points.max(axis=0)
    radius = np.max(np.hypot(points[:, 1], points[:, 2]))
    length = high[0] - low[0]
    scale = min(150 / (radius or length or 1.0), 460 / (length or radius or 1.0))

    def side(point: Vector) -> Point:
        return 50 + scale * (point[0] - low[0]), 205 - scale * point[1]

    def front(point: Vector) -> Point:
        return 740 + scale * point[1], 205 - scale * point[2]

    draw_hulls(d, hulls, scale, (side, front))
    draw_hardware(d, plain, home_q, scale, (side, front))
    for view in (side, front):
        for kind, first, last in lines:
            color, width = (LEG, 3.0) if kind == "leg" else (FAINT, 2.0)
            d.line(view(first), view(last), color=color, width=width)
        for kind, point in marks:
            _draw_joint(d, view(point), kind)
    origin = np.zeros(3)
    d.axes(side(origin), "B", (-12, 17), "xyz")
    d.axes(front(origin), "B", (-12, 17), "yzx")
    d.ruler((50, _TOP - 20), scale, radius or length or 1.0)


def _find_skeleton(
    mechanism: dict, home_q: Sequence[float]
) -> tuple[list[tuple[str, np.ndarray, np.ndarray]], list[tuple[str, np.ndarray]]]:
    """Return lines (kind, two ends) and marks (kind, point), in axes of the base.

    A body is a line from its own origin to every joint and every cut on it. Shafts that stand
    in the origin of the base, where only couplings move them, have no place to be drawn at.
    """
    places = find_body_places(mechanism, home_q)
    lines: list[tuple[str, np.ndarray, np.ndarray]] = []
    marks: list[tuple[str, np.ndarray]] = []
    for body in mechanism.get("bodies", []):
        kind, here = body["joint"]["type"], places[body["name"]][1]
        if body["parent"] != "base":
            lines.append(("body", places[body["parent"]][1], here))
        elif kind != "free" and "position" not in body["joint"]:
            continue
        if kind != "free":
            marks.append((kind, here))
    for loop in mechanism.get("loops", []):
        for body, point in (("terminal", "point_on_terminal"), ("closing", "point_on_closing")):
            rotation, position = places[loop[body]]
            at = position + rotation @ np.array(loop["cut"].get(point, (0, 0, 0)), float)
            if loop[body] != "base":
                lines.append(("body", position, at))
        marks.append(("cut", at))
    written = {leg["name"] for leg in list_legs(mechanism) if "bodies" in leg}
    pins = find_pins(mechanism, home_q)
    for name, root, end in find_legs(mechanism, home_q):
        points = [root, *([pins[name]] if name in pins else []), end]
        lines += [("leg", *pair) for pair in itertools.pairwise(points)]
        if name not in written:  # its loop has marked the cut
            marks.append(("cut", end))
    return lines, marks


def _draw_joint(d: Drawing, at: Point, kind: str) -> None:
    """Draw the mark of a joint, a cut or a leg."""
    x, y = at
    if kind == "revolute":
        d.circle(at, 4, fill=PAPER, color=INK)
    elif kind == "prismatic":
        d.square(at, PAPER)
    elif kind == "cut":
        d.circle(at, 4, fill=PAPER, color=RING, width=2)
    elif kind == "hook":
        d.circle(at, 4, fill=LATCH, color=INK, width=1)
    elif kind == "leg":
        d.line((x - 5, y), (x + 5, y), color=LEG, width=3)
    else:
        d.circle(at, 3, fill=INK)


def _draw_legend(d: Drawing) -> None:
    """Explain the marks."""
    texts = {"revolute": "turns", "prismatic": "slides", "free": "moves freely"}
    for i, (kind, text) in enumerate(
        {**texts, "cut": "cut of a loop", "hook": "latch, hook"}.items()
    ):
        x = 330 + 125 * i
        _draw_joint(d, (x, 20), kind)
        d.label((x + 10, 24), text, anchor="start", size=11)
    d.label((330, _TOP - 16), "from the side (x to the right)", size=11, color=SOFT)
    d.label((740, _TOP - 16), "from the front (against x)", size=11, color=SOFT)
