"""Figures of one docking: relative motion, loads, phases and latches, legs, energies, residuals.

A figure whose outputs were not recorded is left out. Every figure is one PNG next to the result.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.figures import fit_ordinate, put_legend, save_figure
from dockloop.base.number import say_number
from dockloop.base.palette import LATCH_STATES, PHASES, cycle_lines, style_line
from dockloop.native.core import list_choices, list_loads
from dockloop.native.variables import happened
from dockloop.result.peaks import find_peak
from dockloop.result.recording import Result
from dockloop.result.summary import COMMAND

_LATCH_STATE = re.compile(r"latch\[\d+\]\.state")


def write_plots(run: Result, stem: Path) -> list[Path]:
    """Draw all figures that the recording allows.

    Args:
        run: what was recorded.
        stem: result file without its suffix; ``_motion.png`` and so on is appended.

    Returns:
        The files written.
    """
    files = []
    for name, figure in draw_figures(run).items():
        files.append(_name_plot(stem, name))
        save_figure(figure, files[-1], COMMAND)
    return files


def draw_figures(run: Result) -> dict[str, Any]:
    """Draw all figures that the recording allows; returns matplotlib figures by name."""
    return {
        name: _draw(run, draw)
        for name, (needed, draw) in _FIGURES.items()
        if all(output in run for output in needed)
    }


def list_plots(stem: Path) -> list[Path]:
    """Return every file that `write_plots` could write."""
    return [_name_plot(stem, name) for name in _FIGURES]


def _name_plot(stem: Path, name: str) -> Path:
    return stem.with_name(f"{stem.name}_{name}.png")


def _draw(run: Result, draw: Callable) -> Any:
    """Let `draw` fill two panels over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for axis in axes:
        axis.set_prop_cycle(cycle_lines())
    draw(run, axes)
    for axis in axes:
        axis.grid(alpha=0.3)
        fit_ordinate(axis)
        put_legend(axis)
        if "time_of_contact" in run:
            for event in ("time_of_contact", "time_of_capture"):
                if happened(run[event][-1]):
                    axis.axvline(run[event][-1], color="0.6", linewidth=0.8, linestyle=":")
    remark = "; dotted: first contact, capture" if "outcome" in run else ""
    axes[-1].set_xlabel(f"time [s]{remark}{axes[-1].get_xlabel()}")
    axes[0].set_title(run.scene["title"], fontsize="medium")
    return figure


def _plot_motion(run: Result, axes: Any) -> None:
    """Motion of the passive interface P relative to the active one A."""
    t = run["time"]
    axes[0].plot(t, 1e3 * run["relative.axial"], label="axial")
    axes[0].plot(t, 1e3 * run["relative.lateral"], label="lateral")
    axes[0].set_ylabel("P relative to A [mm]")
    axes[1].plot(t, np.degrees(run["relative.pitch_yaw"]), label="pitch/yaw")
    axes[1].plot(t, np.degrees(run["relative.roll"]), label="roll")
    axes[1].set_ylabel("misalignment [deg]")


def _plot_ring(run: Result, axes: Any) -> None:
    """Motion of the ring G relative to A."""
    t = run["time"]
    for column, name in enumerate("xyz"):
        axes[0].plot(t, 1e3 * run.vector("ring.position")[:, column], label=name)
        axes[1].plot(t, 1e3 * run.vector("ring.velocity")[:, column], label=name)
    axes[0].set_ylabel("ring position in A [mm]")
    axes[1].set_ylabel("ring velocity in A [mm/s]")


def _plot_loads(run: Result, axes: Any) -> None:
    """Loads on the target through the interface; rated values where they are in sight.

    A dot marks the true peak of every load, which may lie between two samples. The time is from
    first contact to the last dot.
    """
    t, rated = run["time"], run.scene["mechanism"].get("limits", {})
    loads = {n: u for n, u in list_loads().items() if f"capture.{n}" in run}
    last = t[0]
    for name, unit in loads.items():
        axis = axes[0] if unit == "N" else axes[1]
        style = style_line(list(list_loads()).index(name))
        peaks = run[f"capture.peak.{name}"]
        peak = peaks[-1]
        found = find_peak(run, name)
        label = f"{name}, peak {say_number(peak)}"
        if found["step"]:
            label += f" in '{found['step']}'"
        if name in rated:
            label += f", rated {say_number(rated[name])}"
        (line,) = axis.plot(t, run[f"capture.{name}"], label=label, linewidth=0.9, **style)
        at = float(t[np.argmax(peaks >= peak)]) if found["time"] is None else found["time"]
        last = max(last, _mark(axis, line, at, peak))
        if name in rated and peak > 0.5 * rated[name]:
            axis.axhline(rated[name], color=line.get_color(), linestyle=":", linewidth=1.2)
    _zoom(run, axes[0], last)
    axes[0].set_ylabel("force on the target [N]")
    axes[1].set_ylabel("moment on the target [N m]")
    axes[1].set_xlabel("; dots: true peaks, between samples too")


def _plot_components(run: Result, axes: Any) -> None:
    """Components of force and moment on the target; a dot marks the largest sample of each."""
    t = run["time"]
    last = t[0]
    for axis, name in zip(axes, ("force", "torque"), strict=True):
        for letter, values in zip("xyz", run.vector(f"capture.{name}").T, strict=True):
            label = f"{letter}, largest {say_number(np.max(np.abs(values)))}"
            (line,) = axis.plot(t, values, label=label, linewidth=0.9)
            largest = int(np.argmax(np.abs(values)))
            last = max(last, _mark(axis, line, float(t[largest]), values[largest]))
    _zoom(run, axes[0], last)
    axes[0].set_ylabel("force on the target, axes of P [N]")
    axes[1].set_ylabel("moment on the target [N m]")


def _mark(axis: Any, line: Any, time: float, value: float) -> float:
    """Put a dot of the colour of a line; returns its time [s]."""
    axis.plot(time, value, "o", color=line.get_color(), markersize=4)
    return time


def _zoom(run: Result, axis: Any, last: float) -> None:
    """Show the time from first contact to the capture or to `last`, what is later [s]."""
    if "time_of_contact" in run and happened(run["time_of_contact"][-1]):
        begin, capture = run["time_of_contact"][-1], run["time_of_capture"][-1]
        end = max(last, capture) if happened(capture) else last
        margin = 0.1 * (end - begin) + 0.1
        axis.set_xlim(max(run["time"][0], begin - margin), min(run["time"][-1], end + margin))


def _plot_timeline(run: Result, axes: Any) -> None:
    """Draw a strip of phases, and a strip of states for every latch."""
    _draw_strips(axes[0], run, {"phase": "phase"}, "phase", PHASES)
    count = sum(bool(_LATCH_STATE.fullmatch(name)) for name in run.names)
    strips = {f"latch {i}": f"latch[{i}].state" for i in range(count, 0, -1)}
    _draw_strips(axes[1], run, strips, "latch.state", LATCH_STATES)


def _draw_strips(
    axis: Any, run: Result, strips: dict[str, str], choice: str, colours: tuple[str, ...]
) -> None:
    """Draw outputs that are choices as coloured strips.

    Args:
        axis: where.
        run: what was recorded.
        strips: outputs by label, from below.
        choice: as for `list_choices`.
        colours: of its values.
    """
    t, used = run["time"], {int(n) for output in strips.values() for n in np.unique(run[output])}
    for row, output in enumerate(strips.values()):
        starts = np.flatnonzero(np.diff(run[output], prepend=np.nan))
        ends = np.append(t[starts[1:]], t[-1])
        for value in list_choices(choice):
            if value.number in used:
                spans = [
                    (t[i], end - t[i])
                    for i, end in zip(starts, ends, strict=True)
                    if run[output][i] == value.number
                ]
                label = value.name if row == 0 else None
                colour = colours[value.number - 1]
                axis.broken_barh(spans, (row - 0.4, 0.8), color=colour, label=label)
    axis.set_yticks(range(len(strips)), strips)
    axis.set_ylim(-0.6, len(strips) - 0.4)


def _plot_legs(run: Result, axes: Any) -> None:
    """Length and force of every leg."""
    count = sum(name.endswith("].length") for name in run.names)
    for i in range(1, count + 1):
        axes[0].plot(run["time"], 1e3 * run[f"leg[{i}].length"], label=f"leg {i}")
        axes[1].plot(run["time"], run[f"leg[{i}].force"], label=f"leg {i}")
    axes[0].set_ylabel("length [mm]")
    axes[1].set_ylabel("force, + pushes apart [N]")


def _plot_energy(run: Result, axes: Any) -> None:
    """Where the energy is, and what does not add up."""
    t = run["time"]
    for name in ("kinetic", "potential", "dissipated", "external"):
        if f"energy.{name}" in run:
            values = run[f"energy.{name}"]
            axes[0].plot(t, values - values[0], label=f"{name}, change")
    axes[0].set_ylabel("energy [J]")
    axes[1].semilogy(t, np.abs(run["energy.residual"]) + 1e-16, label="energy residual [J]")
    if "momentum.residual" in run:
        axes[1].semilogy(t, run["momentum.residual"] + 1e-18, label="momentum residual [1]")
    axes[1].set_ylabel("audit")


# Name of a figure: the outputs that it needs, and what draws it.
_FIGURES: dict[str, tuple[tuple[str, ...], Callable]] = {
    "motion": (
        tuple(f"relative.{name}" for name in ("axial", "lateral", "pitch_yaw", "roll")),
        _plot_motion,
    ),
    "ring": (
        tuple(f"ring.{name}[{i}]" for name in ("position", "velocity") for i in (1, 2, 3)),
        _plot_ring,
    ),
    "loads": (("capture.compression", "capture.peak.compression"), _plot_loads),
    "components": (
        tuple(f"capture.{name}[{i}]" for name in ("force", "torque") for i in (1, 2, 3)),
        _plot_components,
    ),
    "timeline": (("phase", "latch[1].state"), _plot_timeline),
    "legs": (("leg[1].length",), _plot_legs),
    "energy": (("energy.residual",), _plot_energy),
}
