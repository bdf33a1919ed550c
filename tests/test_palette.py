"""Colours of figures and pages, as readers with each kind of colour-blindness see them.

Oracle: matrices of Machado, Oliveira and Fernandes (2009), severity 1, on linear sRGB, and the
distance in CIE Lab (1976, white D65). A distance of 2.3 is just noticeable.
"""

import itertools
import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from dockloop.base import palette, paths
from dockloop.base.figures import fit_ordinate
from dockloop.native.core import list_choices, list_loads
from dockloop.report.plots import draw_figures

LEAST = 20.0  # distance of colours that are used together

VISION = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


def find_lab(colour, vision):
    """Return a colour in CIE Lab, as it is seen."""
    rgb = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(VISION[vision]) @ linear, 0.0, 1.0)
    ratio = TO_XYZ @ seen / (TO_XYZ @ np.ones(3))
    x, y, z = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def test_the_distance_is_that_of_known_colours():
    """Of sRGB red in Lab, and of a pair that deuteranopes confuse."""
    assert find_lab("#ff0000", "normal") == pytest.approx([53.24, 80.09, 67.20], abs=0.02)
    tab = [find_lab(c, "deuteranopia") for c in ("#ff7f0e", "#bcbd22")]  # orange and olive
    assert np.linalg.norm(tab[0] - tab[1]) < LEAST


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("name", palette.SETS)
def test_colours_used_together_are_apart(name, vision):
    near = {
        (a, b): distance
        for a, b in itertools.combinations(palette.SETS[name], 2)
        if (distance := np.linalg.norm(find_lab(a, vision) - find_lab(b, vision))) < LEAST
    }
    assert not near


def test_every_value_of_a_choice_has_a_colour():
    for choice, colours in (
        ("outcome", palette.OUTCOMES),
        ("phase", palette.PHASES),
        ("latch.state", palette.LATCH_STATES),
    ):
        assert len(colours) == len(list_choices(choice))


def test_curves_of_one_colour_differ_in_their_dashes():
    styles = [tuple(palette.style_line(i).values()) for i in range(50)]
    assert len(set(styles)) == len(styles)
    assert len(set(palette.MARKERS)) == len(palette.MARKERS) >= len(palette.OUTCOMES) + 1


def test_ordinates_fit_what_is_shown():
    """Outside of the shown time are larger values; a short peak does not flatten the rest."""
    axis = Figure().subplots()
    t = np.linspace(0.0, 10.0, 1001)
    axis.plot(t, np.where(t < 2.0, 1e6, 3.0 + 2.0 * np.sin(9.0 * t)))
    axis.set_xlim(4.0, 8.0)
    fit_ordinate(axis)
    low, high = axis.get_ylim()
    assert (axis.get_yscale(), 0.5 < low < 1.0, 5.0 < high < 5.5) == ("linear", True, True)
    axis.axhline(8.0)  # a rated load is in sight
    axis.axvline(6.0)
    fit_ordinate(axis)
    assert 8.0 < axis.get_ylim()[1] < 9.0
    axis.set_xlim(1.99, 10.0)
    fit_ordinate(axis)
    assert axis.get_yscale() == "symlog"
    assert axis.get_ylim()[1] > 1e6
    place = axis.transAxes.inverted().transform(axis.transData.transform([(5.0, 1.0), (5.0, 5.0)]))
    assert np.ptp(place[:, 1]) > 0.1  # was 4e-6 of the height


def test_loads_have_a_style_each(runs):
    """Tension and torsion had one colour, in two panels of one figure."""
    axes = draw_figures(runs.run("probe_drogue", stop=4.0))["loads"].axes
    lines = [line for axis in axes for line in axis.lines if "peak" in str(line.get_label())]
    assert len({line.get_color() for line in lines}) == len(lines) == len(list_loads())
    for axis in axes:
        outside = axis.get_legend().get_bbox_to_anchor().transformed(axis.transAxes.inverted())
        assert outside.x0 >= 1.0


def test_no_figure_has_colours_of_its_own():
    """Named colours of matplotlib, its maps of colours for kinds, and hues in hexadecimal."""
    own = re.compile(r"[\"']tab:|[\"']C\d[\"']|colormaps|[\"']#[0-9a-f]{6}[\"']")
    folder = paths.ROOT / "scripts" / "dockloop"
    for path in (*folder.rglob("*.py"), *(paths.ROOT / "tests" / "studies").glob("*.py")):
        if path.name not in ("palette.py", "icon.py"):
            assert not own.search(path.read_text(encoding="utf-8")), path
