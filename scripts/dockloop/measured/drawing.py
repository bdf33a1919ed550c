"""The figure of ``dockloop compare``: one panel a column, run as a line, measurements as dots."""

from typing import Any

import numpy as np

from dockloop.figures import put_legend
from dockloop.measured.data import Data
from dockloop.palette import VERMILION
from dockloop.results import Result

_MOST = 8  # panels


def draw(run: Result, data: Data, found: dict[str, Any]) -> Any:
    """Return the figure; the grey band is that of the comparison."""
    from matplotlib.figure import Figure

    names = data.names[:_MOST]
    figure = Figure(figsize=(9, 1.0 + 2.2 * len(names)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    time = data.time + found["shift"]
    for axis, name, unit in zip(panels, names, data.units, strict=False):
        half = found["columns"][name]["half_band"]
        axis.fill_between(
            time, data[name] - half, data[name] + half, color="0.85", label="error band"
        )
        axis.plot(time, data[name], ".", markersize=2, color="0.35", label="measured")
        axis.plot(run.time, run[name], linewidth=0.9, color=VERMILION, label="run")
        axis.set_ylabel(f"{name} [{unit.replace('.', ' ')}]", fontsize="small")
        axis.grid(alpha=0.3)
    put_legend(panels[0])
    panels[0].set_title(run.scene["title"], fontsize="medium")
    panels[-1].set_xlabel(f"time of the run [s]; data shifted by {found['shift']:.4g} s")
    panels[-1].set_xlim(max(time[0], run.time[0]), min(time[-1], run.time[-1]))
    return figure
