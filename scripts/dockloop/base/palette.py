"""Colours, dashes and markers of all figures, drawings and pages: the only place that has them.

Colours that are used together stay apart for readers with deuteranopia, protanopia or tritanopia
too: by more than 20 in CIE Lab (`tests/test_palette.py`). Curves also differ in their dashes,
points in their markers, so that a figure printed in grey can be read. Colours of a choice of the
FMU stand in the order in which the core lists its values.
"""

from typing import Any

INK, FAINT, SOFT, PAPER = "#1d2733", "#8a97a6", "#55616e", "#ffffff"
BLUE, VERMILION, NAVY, SKY = "#0072b2", "#d55e00", "#002288", "#66ccff"
MAROON, SALMON, GREY, PLUM = "#660000", "#ffaa88", "#888888", "#442244"
YELLOW, BROWN, VIOLET = "#eedd44", "#886644", "#cc66ff"

LINES = (BLUE, VERMILION, NAVY, SKY, MAROON, SALMON, PLUM, GREY)  # dark enough for white paper
DASHES = (
    (),
    (6, 2),
    (1.5, 1.5),
    (7, 2, 1.5, 2),
    (3, 1.5),
    (9, 3),
    (7, 2, 1.5, 2, 1.5, 2),
)  # widths
MARKERS = "osD^vP*X<>h"

# Of the choices of the FMU, by their numbers from 1.
OUTCOMES = (GREY, BLUE, SKY, VERMILION, PLUM, NAVY, YELLOW, MAROON, SALMON, BROWN)
NOT_RUN = VIOLET
PHASES = (GREY, YELLOW, SKY, SALMON, BLUE, BROWN, NAVY, VERMILION, VIOLET, PLUM, MAROON)
LATCH_STATES = (GREY, YELLOW, VERMILION, BLUE, VIOLET)

# Of a map and of an envelope.
VERDICT_COLOURS = {
    "right": SKY,
    "refused": GREY,
    "warned": YELLOW,
    "undetermined": VIOLET,
    "slow": BROWN,
    "loose": SALMON,
    "wrong": VERMILION,
    "hung": MAROON,
    "crashed": PLUM,
    "mixed": PAPER,
}
CELLS = {"met": SKY, "mixed": YELLOW, "not met": PAPER, "edge": NAVY}
POINTS = {"met": BLUE, "not met": VERMILION}
SHARES = "cividis"  # of draws: a map of colours made for all kinds of colour vision

# Of drawings and of the space of the view: fills are pale, and have an outline or a label.
CHASER, TARGET, ACTIVE_FILL = "#dbe7f5", "#f3e7d3", "#f7dedb"
CHASER_EDGE, TARGET_EDGE, BOX = "#42607f", "#80683c", "#eef3f8"
RING, PASSIVE, LEG, LATCH = VERMILION, BROWN, BLUE, YELLOW
AXES = {"x": "#aa1e14", "y": "#3fbf74", "z": "#2f5fc4"}
SPACE = {
    "active": RING,
    "passive": PASSIVE,
    "leg": LEG,
    "rod": GREY,
    "force": MAROON,
    "torque": PLUM,
    "petal": SALMON,
    "push": VIOLET,
    "pull": NAVY,
    "load": YELLOW,
}

EVENTS = {"contact": VERMILION, "capture": BLUE, "limit": MAROON}

# Colours that are used together, for the test.
SETS = {
    "lines": (*LINES, PAPER),
    "outcomes": (*OUTCOMES, NOT_RUN),
    "phases": PHASES,
    "latch states": LATCH_STATES,
    "verdicts": tuple(VERDICT_COLOURS.values()),
    "envelope": tuple(dict.fromkeys((*CELLS.values(), *POINTS.values()))),
    "axes": tuple(AXES.values()),
    "space": tuple(SPACE.values()),
    "events": (*EVENTS.values(), INK),
}


def style_line(number: int) -> dict[str, Any]:
    """Return colour and dashes of the curve of this number, from 0, for matplotlib."""
    dashes = DASHES[number % len(DASHES)]
    return {
        "color": LINES[number % len(LINES)],
        "linestyle": (0, dashes) if dashes else "-",
    }


def cycle_lines() -> Any:
    """Return these styles, one after the other, for ``set_prop_cycle`` of matplotlib."""
    from cycler import cycler

    styles = [style_line(i) for i in range(len(LINES) * len(DASHES))]
    return cycler(**{key: [style[key] for style in styles] for key in styles[0]})
