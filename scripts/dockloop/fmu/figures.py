"""Figures of the documentation page of an FMU as SVG text, made from the numbers of a scene.

The functions draw the frames, the legs at home, the phases of a docking and the coupling of a
driven vehicle. Axes are coloured as usual: x red, y green, z blue. The same scene gives the same
text.
"""

from collections.abc import Sequence

import numpy as np

from dockloop.base.palette import (
    ACTIVE_FILL,
    BOX,
    CHASER,
    CHASER_EDGE,
    FAINT,
    INK,
    LEG,
    PAPER,
    RING,
    SOFT,
    TARGET,
    TARGET_EDGE,
)
from dockloop.native.core import number_choice
from dockloop.scene.shapes import draw_hardware, find_legs, find_pins, list_points
from dockloop.scene.sheet import Drawing, Point, Vector


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
