"""Figures as PNG files. Without matplotlib there are none, and everything else is still written."""

import logging
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import warn
from dockloop.base.files import figure_kind, writing


def can_draw() -> bool:
    """Return whether figures can be drawn; says in one line what is missing if not."""
    # Without a home folder matplotlib works, and warns of it.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        import matplotlib.figure
    except ImportError as error:
        warn(f"no figures are drawn ({error}): install it by .venv/bin/pip install matplotlib")
        return False
    except ValueError as error:  # MPLBACKEND, or a file of settings
        warn(f"no figures are drawn: matplotlib does not start with its settings ({error})")
        return False
    matplotlib.rcdefaults()  # figures of commands do not follow settings of the user
    return True


def save_figure(figure: Any, path: Path, command: str) -> None:
    """Write a figure in which the command leaves its name. Raises like `outputs.writing`."""
    with writing(path, figure_kind(command)) as partial:
        figure.savefig(partial, format="png", dpi=100, metadata={"Software": command})


_SQUEEZED = 30.0  # times what most samples stay below: a value so large hides them


def fit_ordinate(axis: Any) -> None:
    """Fit the ordinate to the curves between the limits of the abscissa.

    Of curves with a short peak that would flatten everything else, large values are drawn on a
    logarithmic scale: nothing is cut off. A logarithmic ordinate keeps its scale.
    """
    low, high = axis.get_xlim()
    lines = [
        (np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float))
        for line in axis.get_lines()
        if line.get_transform() == axis.transData
    ]
    parts = [y[(x >= low) & (x <= high) & np.isfinite(y)] for x, y in lines]
    levels = [np.ravel(line.get_ydata()) for line in axis.get_lines() if _is_level(axis, line)]
    shown = np.concatenate([*parts, *levels, np.empty(0)])
    if not len(shown) or axis.get_yscale() != "linear":
        return
    sizes = np.abs(shown[shown != 0.0])
    most = float(np.quantile(sizes, 0.95)) if len(sizes) else 0.0
    bottom, top = float(shown.min()), float(shown.max())
    if 0.0 < _SQUEEZED * most < max(-bottom, top):
        axis.set_yscale("symlog", linthresh=most)
        axis.set_ylim(1.3 * min(bottom, 0.0) or -0.1 * most, 1.3 * max(top, 0.0) or 0.1 * most)
        return
    margin = 0.06 * (top - bottom) or 0.06 * abs(top) or 1.0
    axis.set_ylim(bottom - margin, top + margin)


def _is_level(axis: Any, line: Any) -> bool:
    """Return whether a line is a level across the panel."""
    return line.get_transform() == axis.get_yaxis_transform(which="grid")


def put_legend(axis: Any) -> None:
    """Put the legend to the right of its panel, where it hides no curve."""
    if axis.get_legend_handles_labels()[0]:
        axis.legend(
            loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, fontsize="small",
            handlelength=3.0,
        )  # fmt: skip
