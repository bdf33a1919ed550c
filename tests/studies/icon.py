"""Draws the icon of the FMUs: two vehicles, and between them a ring on legs.

``.venv/bin/python tests/studies/icon.py`` writes icon.png, icon.svg and the icons of the terminals
to ``modelDescription/figures``. The files are part of the project and FMUs take them as they are,
so that an FMU does not depend on the version of the drawing library. Legs and ring are those of
the default mechanism, seen from the side and stretched out of the vehicle.
"""

import json
from pathlib import Path

import numpy as np
from matplotlib import rcParams
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, FancyBboxPatch, Polygon

from dockloop.base import paths
from dockloop.scene.shapes import find_legs

BLUE, SAND, RED, INK = "#42607f", "#a5854b", "#c2483d", "#1d2733"
FIGURES = paths.MODELS / "figures"


def draw_icon(size: int = 256) -> Figure:
    """Return the icon on a transparent sheet from -100 to 100."""
    figure, axes = _sheet(size)
    mechanism = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text(encoding="utf-8"))
    legs = find_legs(mechanism)
    axes.add_patch(_body((-94, -34), (58, 68), "#dbe7f5", BLUE))
    axes.add_patch(_body((38, -44), (56, 88), "#f3e7d3", SAND))
    axes.plot([-36, -36], [-46, 46], color=BLUE, linewidth=5, solid_capstyle="round")
    axes.plot([38, 38], [-46, 46], color=SAND, linewidth=5, solid_capstyle="round")
    for x, y in ((-65, 34), (66, 44)):  # panels
        for sign in (1, -1):
            axes.plot([x, x], [sign * y, sign * (y + 8)], color=INK, linewidth=2)
            low = sign * (y + 8) if sign > 0 else -y - 48
            axes.add_patch(_body((x - 15, low), (30, 40), "#5d7fa6", INK, corner=2))
    depth = sorted(legs, key=lambda leg: leg[1][2] + leg[2][2])  # far legs first
    for i, (_, root, end) in enumerate(depth):
        foot, tip = _place(root, -36, 0), _place(end, 6, 12)
        color = "#9db8d6" if i < len(depth) // 2 else "#2f6db5"
        axes.plot([foot[0], tip[0]], [foot[1], tip[1]], color=color, linewidth=3.4)
    axes.add_patch(Ellipse((6, 0), 24, 94, facecolor="none", edgecolor=RED, linewidth=6))
    for angle in (70, 190, 310):  # petals lean inwards, towards the target
        corners = [_on_circle(6, angle + side, 47) for side in (-26, 26)]
        corners += [_on_circle(26, angle + side, 32) for side in (9, -9)]
        axes.add_patch(Polygon(corners, facecolor="#f0b8b2", edgecolor=RED, linewidth=1.4))
    return figure


def draw_port(color: str, gravity: bool) -> Figure:
    """Return the icon of a terminal: a flange, or an arrow for gravity."""
    figure, axes = _sheet(48)
    if gravity:
        style = {"head_width": 80, "head_length": 70, "length_includes_head": True, "width": 24}
        axes.arrow(0, 90, 0, -180, color=color, **style)
    else:
        axes.add_patch(_body((-82, -82), (164, 164), "white", color, corner=3))
        axes.add_patch(Ellipse((0, 0), 84, 84, facecolor=color))
    return figure


def write_icons(folder: Path = FIGURES) -> None:
    """Write all icons to a folder."""
    rcParams["svg.hashsalt"] = "dockloop"
    icon = draw_icon()
    icon.savefig(folder / "icon.png", transparent=True, metadata={"Software": None})
    icon.savefig(folder / "icon.svg", transparent=True, metadata={"Date": None, "Creator": None})
    for name, color, gravity in (("port_vehicle", INK, False), ("port_gravity", "#8a97a6", True)):
        port = draw_port(color, gravity)
        port.savefig(folder / f"{name}.png", transparent=True, metadata={"Software": None})


def _sheet(size: int) -> tuple:
    """Return an empty square figure of `size` pixels and its axes."""
    figure = Figure(figsize=(size / 100, size / 100), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-100, 100), ylim=(-100, 100))
    axes.set_axis_off()
    return figure, axes


def _body(
    at: tuple, size: tuple[float, float], fill: str, edge: str, *, corner: float = 8
) -> FancyBboxPatch:
    """Return a box with rounded corners, `at` its lower left one."""
    style = f"round,pad=0,rounding_size={corner}"
    return FancyBboxPatch(
        at, size[0], size[1], boxstyle=style, facecolor=fill, edgecolor=edge, linewidth=2
    )


def _on_circle(x: float, degrees: float, radius: float) -> tuple[float, float]:
    """Return where a point of a circle that stands across the axis at `x` is seen."""
    angle = np.radians(degrees)
    return x + radius / 47 * 12 * np.cos(angle), radius * np.sin(angle)


def _place(point: np.ndarray, x: float, depth: float) -> tuple[float, float]:
    """Return where a leg end is seen on the plate or ring at `x`, which shows this much depth."""
    return x - depth * point[2] / 0.66, 47 * point[1] / 0.66


if __name__ == "__main__":
    write_icons()
