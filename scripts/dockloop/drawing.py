"""Figures as SVG text, made from the numbers of a scene, nothing else.

They stand in the documentation page of an FMU; `mechanism_drawing` draws its sheet with them too.
:class:`Drawing` is a sheet with a few kinds of marks. The functions below draw the frames, the legs
at home, the phases of a docking and the coupling of a driven vehicle. Axes are coloured as usual:
x red, y green, z blue. The same scene gives the same text.
"""

import html
import math
from collections.abc import Callable, Sequence

import numpy as np

from dockloop.core import number_choice
from dockloop.hardware import list_active, list_hooks, make_hardware
from dockloop.palette import (
    ACTIVE_FILL,
    AXES,
    BOX,
    CHASER,
    CHASER_EDGE,
    FAINT,
    INK,
    LATCH,
    LEG,
    PAPER,
    RING,
    SOFT,
    TARGET,
    TARGET_EDGE,
)

Point = tuple[float, float]
Vector = Sequence[float] | np.ndarray
View = Callable[[Vector], Point]  # from a point in space to the sheet

_STRAIGHT = 1e-9  # m: nearer to a line is on it


class Drawing:
    """A sheet of SVG, measured in points from the upper left corner."""

    def __init__(self, width: float, height: float, title: str) -> None:
        self._head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img"'
            f' font-family="sans-serif" font-size="13" fill="{INK}">'
            f"<title>{html.escape(title)}</title>"
        )
        self._marks: list[str] = []

    def text_of(self) -> str:
        """Return the sheet as one SVG element."""
        return "\n".join([self._head, *self._marks, "</svg>"])

    def line(
        self,
        *points: Point,
        color: str = INK,
        width: float = 1.5,
        dash: str = "",
        fill: str = "none",
        close: bool = False,
    ) -> None:
        """Draw a line through points, or a filled polygon."""
        kind = "polygon" if close else "polyline"
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self._marks.append(
            f'<{kind} points="{path}" fill="{fill}" stroke="{color}" stroke-width="{width:g}"'
            f' stroke-linejoin="round" stroke-linecap="round"{dashed}/>'
        )

    def box(self, at: Point, size: Point, fill: str) -> None:
        """Draw a rectangle with rounded corners, `at` its upper left one."""
        (x, y), (width, height) = at, size
        self._marks.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="8"'
            f' fill="{fill}" stroke="{INK}" stroke-width="1.2"/>'
        )

    def circle(
        self, at: Point, radius: float, fill: str = "none", color: str = INK, width: float = 1.5
    ) -> None:
        """Draw a circle."""
        self._marks.append(
            f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius:.1f}" fill="{fill}"'
            f' stroke="{color}" stroke-width="{width:g}"/>'
        )

    def label(
        self,
        at: Point,
        text: str,
        *,
        anchor: str = "middle",
        color: str = INK,
        size: float = 13,
        bold: bool = False,
        code: bool = False,
        clear: bool = False,
    ) -> None:
        """Write one line of text, `at` its base line; `clear` keeps lines away from it."""
        style = ' font-weight="bold"' if bold else ""
        style += ' font-family="monospace"' if code else ""
        halo = f' paint-order="stroke" stroke="{PAPER}" stroke-width="4"' if clear else ""
        self._marks.append(
            f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" text-anchor="{anchor}" fill="{color}"'
            f' font-size="{size:g}"{style}{halo}>{html.escape(text)}</text>'
        )

    def arrow(
        self, *points: Point, color: str = INK, width: float = 1.5, dash: str = "", head: float = 7
    ) -> None:
        """Draw a line through points with a head at its end."""
        (x0, y0), (x1, y1) = points[-2:]
        length = math.hypot(x1 - x0, y1 - y0)
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        foot = (x1 - head * ux, y1 - head * uy)
        side = (-0.4 * head * uy, 0.4 * head * ux)
        self.line(*points[:-1], foot, color=color, width=width, dash=dash)
        tips = [(foot[0] + side[0], foot[1] + side[1]), (foot[0] - side[0], foot[1] - side[1])]
        self.line((x1, y1), *tips, color=color, width=0.5, fill=color, close=True)

    def square(self, at: Point, fill: str, width: float = 1.5) -> None:
        """Draw a small square around a point."""
        corners = ((-4, -4), (4, -4), (4, 4), (-4, 4))
        self.line(*((at[0] + x, at[1] + y) for x, y in corners), width=width, fill=fill, close=True)

    def ruler(self, at: Point, scale: float, reach: float) -> None:
        """Draw a power of ten [m] that is at most `reach`, with its label; `at` its left end."""
        length = 10 ** math.floor(math.log10(reach))
        x, y = at
        self.line(at, (x + scale * length, y), width=2)
        text = f"{length:g} m" if length >= 0.1 else f"{1e3 * length:g} mm"
        self.label((x + 8 + scale * length, y + 4), text, anchor="start", size=11)

    def axes(
        self,
        at: Point,
        name: str,
        place: Point,
        names: Sequence[str] = "xyz",
        size: float = 34,
    ) -> None:
        """Draw a right-handed frame: axes to the right, up and out of the sheet."""
        right, up, out = names
        x, y = at
        self.arrow(at, (x + size, y), color=AXES[right], width=2)
        self.arrow(at, (x, y - size), color=AXES[up], width=2)
        self.circle(at, 4.5, fill=PAPER, color=AXES[out], width=1.8)
        self.circle(at, 1.2, fill=AXES[out], color=AXES[out], width=0.5)
        self.label((x + size + 6, y + 4), right, color=AXES[right], size=11)
        self.label((x, y - size - 4), up, color=AXES[up], size=11)
        if name:
            self.label((x + place[0], y + place[1]), name, bold=True, size=15)


def draw_frames(has_target: bool, has_ring: bool) -> str:
    """Draw where the frames are, not to scale, with the vectors that are variables."""
    d = Drawing(760, 318, "Frames N, C, A, B, G, P, D and the vectors between them")
    c, a, g, p, t, n = (120, 160), (250, 160), (345, 160), (505, 160), (635, 160), (48, 286)
    d.box((40, 90), (210, 140), CHASER)
    d.label((58, 112), "chaser", anchor="start", color=CHASER_EDGE)
    if has_target:
        d.box((505, 80), (215, 160), TARGET)
        d.label((703, 102), "target", anchor="end", color=TARGET_EDGE)
        d.line((505, 108), (505, 212), width=5, color=TARGET_EDGE)
    d.line((250, 112), (250, 208), width=5, color=CHASER_EDGE)
    if has_ring:
        for y0, y1 in ((112, 106), (126, 196), (194, 124), (208, 214)):
            d.line((250, y0), (g[0], y1), color=LEG, width=2)
        d.line((g[0], 100), (g[0], 220), color=RING, width=7)
    grey = SOFT
    for start, end, text, place in (
        (n, c, "chaser.position", (66, 250)),
        *([(n, t, "target.position", (330, 243))] if has_target else []),
    ):
        d.arrow(start, (end[0] - 5, end[1] + 5), color=FAINT, width=1.2, dash="5 4")
        d.label(place, text, anchor="start", size=11, code=True, color=grey, clear=True)
    for start, end, text, y, top in (
        (c, a, "chaser.interface_position", 66, 120),
        *([(t, p, "target.interface_position", 56, 120)] if has_target else []),
        *([(a, g, "ring.position", 84, 98)] if has_ring else []),
        *([(a, p, "relative.position", 28, 106)] if has_target else []),
    ):
        for x, _ in (start, end):
            d.line((x, top), (x, y - 4), color=FAINT, width=0.7, dash="2 3")
        d.arrow((start[0], y), (end[0], y), color=grey, width=1.2)
        middle = (start[0] + end[0]) / 2
        d.label((middle, y - 6), text, size=11, code=True, color=grey, clear=True)
    d.axes(n, "N", place=(-22, 6))
    d.axes(c, "C", place=(-20, 4))
    d.axes(a, "A, B", place=(-28, 5))
    if has_ring:
        d.axes(g, "G", place=(-16, 5))
    if has_target:
        d.axes(p, "P", place=(-14, 5))
        d.axes(t, "D", place=(14, 20))
    return d.text_of()


def draw_phases() -> str:
    """Draw the phases of a docking and what leads from one to the next."""
    d = Drawing(760, 214, "Phases of a docking")
    fills = {"rebound": ACTIVE_FILL, "aligned": CHASER}
    for x, y, name in (
        (10, 60, "approach"),
        (165, 60, "contact"),
        (330, 60, "captured"),
        (490, 60, "attenuating"),
        (650, 60, "aligned"),
        (165, 160, "rebound"),
    ):
        d.box((x, y), (100, 42), fills.get(name, BOX))
        d.label((x + 50, y + 26), f"{number_choice('phase', name)} {name}")
    for start, end, lines in (
        (110, 165, ("first", "touch")),
        (265, 330, ("all latches", "hold")),
        (430, 490, ("motion", "reversed")),
        (590, 650, ("at rest", "")),
    ):
        d.arrow((start, 81), (end, 81))
        for i, text in enumerate(lines):
            d.label(((start + end) / 2, 28 + 13 * i), text, size=11, color=SOFT)
        d.line(((start + end) / 2, 45), ((start + end) / 2, 74), color=FAINT, width=0.7, dash="2 3")
    d.arrow((198, 102), (198, 160))
    d.label((191, 128), "open by 50 mm and opening,", anchor="end", size=11, color=SOFT)
    d.label((191, 142), "no latch holds", anchor="end", size=11, color=SOFT)
    d.arrow((232, 160), (232, 102))
    d.label((240, 142), "touches again, or a latch catches", anchor="start", size=11, color=SOFT)
    d.arrow((700, 102), (700, 181), (265, 181))
    text = "latches let go (also after capture; to contact while it touches)"
    d.label((490, 174), text, size=11)
    return d.text_of()


def draw_coupling(vehicle: str) -> str:
    """Draw the exchange with the host of a driven vehicle."""
    d = Drawing(760, 150, f"Coupling of the driven vehicle {vehicle}")
    d.box((20, 30), (200, 100), CHASER if vehicle == "chaser" else TARGET)
    d.label((120, 70), "vehicle model of the host", size=13)
    d.label((120, 92), "from t to t + h", size=12, color=SOFT)
    d.box((540, 30), (200, 100), BOX)
    d.label((640, 70), "this FMU", bold=True)
    d.label((640, 92), "from t to t + h", size=12, color=SOFT)
    d.arrow((220, 55), (540, 55))
    d.label((380, 30), f"at t: {vehicle}.position, velocity,", size=12)
    d.label((380, 46), "attitude, angular_velocity", size=12)
    d.arrow((540, 105), (220, 105))
    d.label((380, 98), f"after the step: {vehicle}.force_mean, torque_mean", size=12)
    d.label((380, 124), "constant over the step, exact impulse", size=11, color=SOFT)
    return d.text_of()


# ------------------------------------------------------------------- legs at home


def find_body_places(
    mechanism: dict, home_q: Sequence[float] = ()
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return rotation and position of every listed body at home, axes and origin of the base.

    Args:
        mechanism: its description.
        home_q: coordinates of the joints, body by body; default: where the joints have their zero.
    """
    places = {"base": (np.eye(3), np.zeros(3))}
    rest = list(home_q)
    for body in mechanism.get("bodies", []):
        joint = body["joint"]
        count = 7 if joint["type"] == "free" else 1
        q = rest[:count] or [0, 0, 0, 1, 0, 0, 0][:count]
        del rest[:count]
        rotation, position = places[body["parent"]]
        position = position + rotation @ np.array(joint.get("position", (0, 0, 0)), float)
        rotation = rotation @ np.array(joint.get("rotation", np.eye(3)), float)
        if joint["type"] == "free":
            position, turn = position + rotation @ np.array(q[:3]), tuple(q[3:])
        elif joint["type"] == "prismatic":
            position, turn = position + rotation @ (q[0] * np.array(joint["axis"])), (1, 0, 0, 0)
        else:
            turn = (math.cos(q[0] / 2), *(math.sin(q[0] / 2) * np.array(joint["axis"])))
        places[body["name"]] = rotation @ _matrix(turn), position
    return places


def _matrix(quaternion: Sequence[float]) -> np.ndarray:
    """Return the rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    cross = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def list_legs(mechanism: dict) -> list[dict]:
    """Return all legs, with their defaults: listed ones, then those that are written out.

    Each has at least ``name``, ``root``, ``closing``, ``root_point`` and ``closing_point``. A leg
    that is written out is a loop through two turns at the root, a slide and a ball on one line; it
    also has ``bodies``, the names of the bodies between its ends, and ``length`` where the slide
    has its zero. It has the name that ``legs`` gives to its slide, otherwise that of the loop.
    A listed crank leg also has ``pin``: from the root point to the crank pin at home, axes of the
    root. Crank legs that are written out are not returned: their bodies are shown as bodies.
    """
    defaults = {"root": "base", **mechanism.get("leg_defaults", {})}
    listed = mechanism.get("legs", [])
    legs = [{**defaults, **leg} for leg in listed if not {"slide", "crank_joint"} & leg.keys()]
    for leg in legs:
        if leg["type"] == "R1R2R3":
            leg["pin"] = _find_pin(leg)
    names_of_slides = {leg["slide"]: leg["name"] for leg in listed if "slide" in leg}
    places = find_body_places(mechanism)
    bodies = {body["name"]: body for body in mechanism.get("bodies", [])}
    for loop in mechanism.get("loops", []):
        chain = [bodies[loop["terminal"]]]
        while chain[0]["name"] != loop["first"]:
            chain.insert(0, bodies[chain[0]["parent"]])
        joints = [body["joint"] for body in chain]
        kinds = [joint["type"] for joint in joints]
        if kinds != ["revolute", "revolute", "prismatic"] or loop["cut"]["type"] != "R3":
            continue
        rotation, position = places[loop["terminal"]]
        end = rotation @ np.array(loop["cut"]["point_on_terminal"], float)
        root = np.array(joints[0].get("position", (0, 0, 0)), float)
        apart = [*(places[body["name"]][1] - position for body in chain)]
        apart.append(np.cross(end, rotation @ np.array(joints[2]["axis"], float)))
        if np.max(np.abs(apart)) > _STRAIGHT:
            continue
        names = {body["name"] for body in chain}
        names |= {name for name, body in bodies.items() if body["parent"] in names}
        legs.append(
            {
                "name": names_of_slides.get(loop["terminal"], loop["name"]),
                **{key: loop[key] for key in ("root", "closing")},
                "root_point": root.tolist(),
                "closing_point": loop["cut"]["point_on_closing"],
                "bodies": sorted(names),
                "length": float(np.linalg.norm(end)),
            }
        )
    return legs


def _find_pin(leg: dict) -> list[float]:
    """Return where the pin of a crank is at home, from the root point of its leg."""
    crank, axis = leg["crank"], np.array(leg["axis"], float)
    axis /= np.linalg.norm(axis)
    lean = math.radians(crank["lean_deg"]) if "lean_deg" in crank else crank.get("lean", 0.0)
    level = np.cross(leg.get("reference_axis", (1.0, 0.0, 0.0)), axis)
    level /= np.linalg.norm(level)
    direction = math.cos(lean) * level + math.sin(lean) * np.cross(axis, level)
    return (crank["length"] * direction).tolist()


def find_pins(mechanism: dict, home_q: Sequence[float] = ()) -> dict[str, np.ndarray]:
    """Return the crank pin at home of every listed crank leg, axes and origin of the base."""
    places = find_body_places(mechanism, home_q)
    pins = {}
    for leg in list_legs(mechanism):
        if "pin" in leg:
            rotation, position = places[leg["root"]]
            pins[leg["name"]] = position + rotation @ np.add(leg["root_point"], leg["pin"])
    return pins


def find_legs(
    mechanism: dict, home_q: Sequence[float] = ()
) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return name and both ends at home of every leg, axes and origin of the base."""
    places = find_body_places(mechanism, home_q)
    legs = []
    for leg in list_legs(mechanism):
        ends = []
        for body, point in (("root", "root_point"), ("closing", "closing_point")):
            rotation, position = places[leg[body]]
            ends.append(position + rotation @ np.array(leg[point], float))
        legs.append((leg["name"], *ends))
    return legs


def draw_legs(mechanism: dict, home_q: Sequence[float] = ()) -> str:
    """Draw side view and front view of the legs at home, to scale; empty if there are none."""
    legs = find_legs(mechanism, home_q)
    if not legs:
        return ""
    pins = find_pins(mechanism, home_q)
    roots, ends = (np.array([leg[i] for leg in legs]) for i in (1, 2))
    along = int(np.argmax(np.abs(np.mean(ends - roots, axis=0))))
    right, up = (along + 1) % 3, (along + 2) % 3
    names = "xyz"
    hardware = list_points(mechanism, home_q) if along == 0 else np.empty((0, 3))
    everything = np.vstack([roots, ends, *pins.values(), hardware])
    low, high = everything.min(axis=0), everything.max(axis=0)
    radius = max(np.hypot(everything[:, right], everything[:, up]))
    scale = min(150 / radius, 310 / (high[along] - low[along]))
    d = Drawing(760, 380, "Legs at home, from the side and from the front")

    def side(point: Vector) -> Point:
        return 30 + scale * (point[along] - low[along]), 185 - scale * point[right]

    def front(point: Vector) -> Point:
        return 570 + scale * point[right], 185 - scale * point[up]

    d.label((30, 372), f"from the side ({names[along]} to the right)", anchor="start", color=SOFT)
    d.label((570, 372), f"from the front (against {names[along]})", color=SOFT)
    if along == 0:  # the ring stands across x
        draw_hardware(d, mechanism, home_q, scale, (side, front))
    for i, (name, root, end) in enumerate(legs):
        middle = pins.get(name, root + 0.3 * (end - root))
        for view in (side, front):
            bends = [view(pins[name])] if name in pins else []
            d.line(view(root), *bends, view(end), color=LEG, width=3)
            d.circle(view(end), 3.5, fill=PAPER, color=LEG)
            d.square(view(root), INK, width=1)
        d.circle(front(middle), 9, fill=PAPER, color=LEG, width=1)
        d.label((front(middle)[0], front(middle)[1] + 4), str(i + 1), size=11)
    origin = np.zeros(3)
    order = names[along] + names[right] + names[up]
    d.axes(side(origin), "B", (-12, 17), order)
    d.axes(front(origin), "B", (-12, 17), order[1:] + order[0])
    d.ruler((30, 345), scale, radius)
    return d.text_of()


def draw_hardware(
    d: Drawing,
    mechanism: dict,
    home_q: Sequence[float],
    scale: float,
    views: tuple[View, View],
) -> None:
    """Draw the hardware of the chaser at home: surfaces and latches of G, faces, hooks, pushers.

    Args:
        d: the sheet.
        mechanism: its description, angles in rad.
        home_q: as for `find_body_places`.
        scale: points per metre.
        views: across x and along x, of points in axes of the base.
    """
    hardware = make_hardware(mechanism)
    ring = _place_ring(mechanism, home_q)
    base = (np.eye(3), np.zeros(3))
    for part in ("faces", "hooks", "pushers"):
        for shape in hardware["interface"].get(part, ()):
            colors = (SOFT, LATCH if part == "hooks" else PAPER)
            _draw_shape(d, _place_shape(shape, base), scale, views, colors)
    for shape in list_active(hardware):
        _draw_shape(d, _place_shape(shape, ring), scale, views, (RING, ACTIVE_FILL))
    for shape in list_hooks(hardware):
        _draw_shape(d, _place_shape(shape, ring), scale, views, (INK, LATCH))


def _place_ring(mechanism: dict, home_q: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and position of G at home, axes and origin of the base."""
    capture = mechanism.get("capture", {})
    rotation, position = find_body_places(mechanism, home_q)[capture.get("body", "base")]
    at = position + rotation @ np.array(capture.get("position", (0, 0, 0)), float)
    return rotation @ np.array(capture.get("rotation", np.eye(3)), float), at


def list_points(mechanism: dict, home_q: Sequence[float]) -> np.ndarray:
    """Return points that bound the drawn hardware at home, axes and origin of the base."""
    hardware = make_hardware(mechanism)
    ring, base = _place_ring(mechanism, home_q), (np.eye(3), np.zeros(3))
    placed = [_place_shape(shape, ring) for shape in list_active(hardware)]
    parts = hardware["interface"].values()
    placed += [_place_shape(shape, base) for part in parts for shape in part]
    points = [
        shape["place"](point) + step
        for shape in placed
        for point in _list_corners(shape)
        for step in (-shape["rounding"], shape["rounding"])
    ]
    return np.array(points).reshape(-1, 3)


def _list_corners(shape: dict) -> list[Vector]:
    """Return the points of a shape; of a surface of revolution four on every circle."""
    if shape["kind"] != "revolution":
        return shape["points"]
    around = ((1, 0), (0, 1), (-1, 0), (0, -1))
    return [(x, r * c, r * s) for line in shape["profiles"] for x, r in line for c, s in around]


def _place_shape(shape: dict, frame: tuple[np.ndarray, np.ndarray]) -> dict:
    """Return a shape with ``place``, which gives a point of it in axes of the base."""
    rotation, position = frame
    origin = position + rotation @ np.array(shape["pose"]["p"], float)
    axes = rotation @ _matrix(shape["pose"]["q"])
    return {**shape, "place": lambda point: origin + axes @ np.array(point, float)}


def _draw_shape(
    d: Drawing, shape: dict, scale: float, views: tuple[View, View], colors: tuple[str, str]
) -> None:
    """Draw a placed shape in both views: of a surface of revolution its section and its circles."""
    (side, front), (color, fill), place = views, colors, shape["place"]
    if shape["kind"] == "revolution":
        for profile in shape["profiles"]:
            for sign in (1, -1):
                outline = (side(place((x, sign * r, 0.0))) for x, r in profile)
                d.line(*outline, color=color, width=0.8, fill=fill, close=True)
        x = shape["profiles"][0][0][0]
        radii = [r for profile in shape["profiles"] for _, r in profile]
        for radius in {min(radii), max(radii)}:
            turns = (2 * math.pi * i / 72 for i in range(72))
            circle = (place((x, radius * math.cos(a), radius * math.sin(a))) for a in turns)
            d.line(*map(front, circle), color=color, width=0.8, close=True)
        return
    points = [place(point) for point in shape["points"]]
    for view in views:
        seen = [view(point) for point in points]
        radius = max(scale * shape["rounding"], 0.5)
        if shape["kind"] == "plate":
            d.line(*seen, color=color, width=1, fill=fill, close=True)
        elif len(seen) == 1 or math.dist(*seen) < radius / 2:
            d.circle(seen[0], radius, fill=fill, color=color, width=0.8)
        else:
            d.line(*seen, color=color, width=2 * radius)
            d.line(*seen, color=fill, width=max(2 * radius - 1.6, 0.2))
