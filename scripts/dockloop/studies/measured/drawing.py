"""The figure of ``dockloop compare``: one panel a column, run as a line, measurements as dots."""

from typing import Any

import numpy as np

from dockloop.base.figures import put_legend
from dockloop.base.histories import Data
from dockloop.base.palette import VERMILION
from dockloop.result.recording import Result
from dockloop.studies.measured.overlay import read_samples

_MOST = 8  # panels


def draw(run: Result, data: Data, found: dict[str, Any]) -> Any:
    """Return the figure; the grey band is that of the comparison."""
    from matplotlib.figure import Figure

    names = data.names[:_MOST]
    figure = Figure(figsize=(9, 1.0 + 2.2 * len(names)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    shift = found["shift"]
    everywhere = np.ones(len(data.time), dtype=bool)
    for axis, name, unit in zip(panels, names, data.units, strict=False):
        half = found["columns"][name]["half_band"]
        time, values = read_samples(data, name, everywhere, shift)
        axis.fill_between(time, values - half, values + half, color="0.85", label="error band")
        axis.plot(time, values, ".", markersize=2, color="0.35", label="measured")
        axis.plot(run.time, run[name], linewidth=0.9, color=VERMILION, label="run")
        axis.set_ylabel(f"{name} [{unit.replace('.', ' ')}]", fontsize="small")
        axis.grid(alpha=0.3)
    put_legend(panels[0])
    panels[0].set_title(run.scene["title"], fontsize="medium")
    panels[-1].set_xlabel(f"time of the run [s]; data shifted by {shift:.4g} s")
    first, last = data.time[0] + shift, data.time[-1] + shift
    panels[-1].set_xlim(max(first, run.time[0]), min(last, run.time[-1]))
    return figure
