"""A drawing as SVG text: a sheet with a few kinds of marks.

Figures of the documentation page of an FMU and the sheet of a mechanism are made with it.
"""

import html
import math
from collections.abc import Callable, Sequence

import numpy as np

from dockloop.base.palette import AXES, INK, PAPER

Point = tuple[float, float]
Vector = Sequence[float] | np.ndarray
View = Callable[[Vector], Point]  # from a point in space to the sheet


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
