"""What a sweep found: a summary for programs, and figures."""

import math
import shlex
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.figures import save_figure
from dockloop.base.files import (
    MADE_BY,
    Kind,
    figure_kind,
    json_kind,
)
from dockloop.base.number import say_number
from dockloop.base.palette import BLUE, MARKERS, NOT_RUN, OUTCOMES, style_line
from dockloop.base.system import LANES
from dockloop.native.core import list_choices, list_loads
from dockloop.result.capture import WITH_CAPTURE
from dockloop.result.criteria import PEAK
from dockloop.result.peaks import count_steps, list_with_places
from dockloop.result.run_errors import compare_peaks
from dockloop.result.summary import find_summary
from dockloop.runs.outcome import STATUSES
from dockloop.sweeps.assured import COLUMNS, summarise_cases
from dockloop.sweeps.histories import HISTORIES, find_histories
from dockloop.sweeps.journal import journal_kind
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import Sweep, count_drawn, list_discs
from dockloop.sweeps.table import (
    COMMAND,
    CSV,
    FIRST,
    TABLE,
    count_texts,
    find_journal,
    is_captured,
    is_text,
    list_worst,
    read_numbers,
    read_worst,
)

_NOT_RUN = "not run"  # in place of an outcome
_BINS = 8
_COLUMNS = 4  # panels of a figure side by side
_MOST_POINTS = 20_000  # of one colour in a panel
_MOST_ROWS = 64  # of a table in words
_CLOCK = ("ran", "repeats", "wall", "engine", "workers")
_ENDS = ("outcome", "time_of_capture", "capture.peak.load_ratio", "explanation", "limits")


def list_files(
    output: Path, *, as_csv: bool, plots: bool, histories: bool
) -> list[tuple[Path, Kind]]:
    """Return every file that a sweep could write, and its kind.

    Args:
        output: the table.
        as_csv: as for `write_table`.
        plots: whether figures are wanted.
        histories: whether time histories are kept.
    """
    files = [(output, TABLE), (find_journal(output), journal_kind("sweep"))]
    files.append((find_summary(output), json_kind("summary", COMMAND)))
    if histories:
        files.append((find_histories(output), HISTORIES))
    if as_csv:
        files.append((output.with_suffix(".csv"), CSV))
    if plots:
        files += [(path, figure_kind(COMMAND)) for path in _list_plots(output.with_suffix(""))]
    return files


def _list_plots(stem: Path) -> list[Path]:
    return [stem.with_name(f"{stem.name}_{name}.png") for name in ("envelope", "loads")]


def summarise_sweep(sweep: Sweep, planner: Planner, table: Any, ran: dict) -> dict:
    """Condense a sweep.

    Args:
        sweep: what was to be done.
        planner: how it was done.
        table: of `make_table`.
        ran: of `run_sweep`: cases done now, repeats among them, wall time [s], engine, workers.

    Returns:
        A dictionary that can be written as JSON.
    """
    status = count_texts(table["status"])
    summary: dict = {
        MADE_BY: COMMAND,
        "sweep": sweep.path.stem,
        "title": sweep.document["title"],
        "scene": sweep.document["scene"],
        "seed": sweep.document["seed"],
        "sampling": sweep.document["sampling"],
        "cases": len(sweep.cases),
        "fmus_built": ran["built"],
        "status": {name: status[name] for name in STATUSES if name in status},
    }
    if sweep.form:
        summary["form"] = sweep.form
    if reasons := count_texts(table["reason"]):
        most = max(reasons, key=lambda text: (reasons[text], text))
        summary["reasons"] = {"different": len(reasons), "example": most}
    if "outcome" in table.column_names and "done" in status:
        found = count_texts(table["outcome"])
        names = [choice.name for choice in list_choices("outcome")]
        summary["outcomes"] = {name: found[name] for name in names if name in found}
        captured = sum(found.get(name, 0) for name in WITH_CAPTURE)
        summary["captured"] = estimate_fraction(captured, sum(found.values()))
    if "limits" in table.column_names:
        summary["limits"] = _count_limits(table)
    if planner.assured is not None:
        columns = [table[name].to_pylist() for name in ("case", *COLUMNS)]
        summary |= summarise_cases(zip(*columns, strict=True))
    if not_seen := planner.list_not_seen():
        summary["not_seen"] = not_seen
    summary["peak_loads"] = _count_loads(planner, table)
    if sweep.passes and sweep.passes.refine:
        summary["refined"] = {**asdict(sweep.passes), **compare_passes(table)}
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    summary["units"] = {name: unit for name, unit in units.items() if unit}
    if len(sweep.cases) <= _MOST_ROWS and not count_drawn(sweep.document):
        summary["table"] = _list_cases(planner, table)
    worst = _find_worst(sweep, planner, table)
    if worst:
        summary["worst"] = worst
    wall = ran["wall"]
    summary["time"] = {name: ran[name] for name in _CLOCK}
    if ran["ran"]:
        summary["time"]["cases_per_second"] = rate = ran["ran"] / wall
        summary["cases_per_second_and_core"] = rate / ran["cores"]
        summary |= {"lanes": LANES[0], "occupancy": 1.0}  # a core computes one case at a time
    return summary


def _count_limits(table: Any) -> dict[str, int]:
    """Return in how many cases each limit was passed; limits that no case passed are left out."""
    found: Counter[str] = Counter()
    for names, count in count_texts(table["limits"]).items():
        found.update(dict.fromkeys(filter(None, names.split(", ")), count))
    return dict(found.most_common())


def _list_cases(planner: Planner, table: Any) -> list[dict]:
    """Return what varied in every case and how the case ended, for a table that people read."""
    names = [quantity.name for quantity in planner.quantities]
    shown = [*names, *(name for name in _ENDS if name in table.column_names)]
    return [
        {name: row[name] for name in shown}
        for part in table.to_batches()
        for row in part.to_pylist()
    ]


def write_sweep_plots(sweep: Sweep, planner: Planner, table: Any, stem: Path) -> list[Path]:
    """Draw the capture envelope and the distribution of the loads.

    Args:
        sweep: what was to be done.
        planner: how it was done.
        table: of `make_table`.
        stem: of the files; ``_envelope.png`` and ``_loads.png`` is appended.

    Returns:
        The files written.
    """
    envelope, loads = _list_plots(stem)
    files = []
    if "outcome" in table.column_names:
        files.append(envelope)
        _plot_envelope(sweep, planner, table, envelope)
    if any(name.startswith(PEAK) for name in table.column_names):
        files.append(loads)
        _plot_loads(sweep, planner, table, loads)
    return files


def estimate_fraction(count: int, total: int) -> dict:
    """Return a fraction with its 95 % interval by Wilson, as for cases drawn at random."""
    z = 1.959963984540054
    p = count / total
    centre = (p + z * z / (2 * total)) / (1 + z * z / total)
    half = z / (1 + z * z / total) * math.sqrt(p * (1 - p) / total + z * z / (4 * total * total))
    low, high = max(centre - half, 0.0), min(centre + half, 1.0)  # rounding may pass these
    return {"count": count, "of": total, "fraction": p, "low": low, "high": high}


def _peaks(table: Any) -> dict[str, np.ndarray]:
    """Return the peak loads of the cases that were done, by the name of the load."""
    peaks = {}
    for name in table.column_names:
        if name.startswith(PEAK):
            values = table[name].drop_null().to_numpy()
            if len(values):
                peaks[name.removeprefix(PEAK)] = values
    return peaks


def compare_passes(table: Any) -> dict:
    """Compare both passes of the cases that ran again.

    Returns:
        ``cases`` that ran again, ``failed`` in one of the passes, ``changed`` (case and both
        outcomes where these differ), ``peaks``: the relative change of every peak load, as
        `dockloop.result.run_errors` has it: its median, the largest one and the case of that.
    """
    changed, changes, cases = [], [], 0
    again = (part.filter(part[f"{FIRST}status"].is_valid()) for part in table.to_batches())
    for row in (row for part in again for row in part.to_pylist()):
        cases += 1
        first = {name.removeprefix(FIRST): v for name, v in row.items() if name.startswith(FIRST)}
        outcomes = [each["status"] if each["status"] != "done" else each.get("outcome", "done")
                    for each in (first, row)]  # fmt: skip
        if outcomes[0] != outcomes[1]:
            changed.append({"case": row["case"], "first": outcomes[0], "again": outcomes[1]})
        elif row["status"] == "done":
            peaks = [{n: v for n, v in each.items() if n.startswith(PEAK)} for each in (row, first)]
            changes.append((row["case"], compare_peaks(*peaks)))
    found: dict = {"cases": cases, "changed": changed, "peaks": {}}
    for name in dict.fromkeys(name for _, each in changes for name in each):
        parts = [(each[name], case) for case, each in changes if name in each]
        largest, case = max(parts)
        median = float(np.median([part for part, _ in parts]))
        load = name.removeprefix(PEAK)
        found["peaks"][load] = {"median": median, "largest": largest, "case": case}
    return found


def _count_loads(planner: Planner, table: Any) -> dict:
    """Return quantiles of the peak loads next to the rated loads."""
    rated = planner.base["mechanism"].get("limits", {})
    loads = {}
    for name, values in _peaks(table).items():
        quantiles = np.quantile(values, (0.5, 0.95, 0.99))
        loads[name] = {
            "unit": list_loads().get(name, ""),
            **dict(zip(("median", "q95", "q99"), quantiles.tolist(), strict=True)),
            "largest": float(values.max()),
        }
        if name in rated:
            loads[name] |= {
                "rated": rated[name],
                "above_rated": float(np.mean(values > rated[name])),
            }
        if steps := count_steps(planner.base, read_steps(table, f"{PEAK}{name}")):
            loads[name]["steps"] = steps
    return loads


def read_steps(table: Any, outcome: str) -> np.ndarray:
    """Return the steps of the sequence in which the peaks of an outcome arose, from 1.

    0: before, or no sequence; NaN: the case has no result. No values: the outcome is no peak.
    """
    column = list_with_places(outcome)[-1]
    is_there = column != outcome and column in table.column_names
    return read_numbers(table, column) if is_there else np.array([])


def _find_worst(sweep: Sweep, planner: Planner, table: Any) -> dict | None:
    """Return the case with the largest value of the outcome that counts, and its command."""
    by, values = read_worst(sweep, table)
    for row in list_worst(values, 1):
        command = planner.make_command(sweep.cases[row], table["end_time"][row].as_py())
        value = float(values[row])
        return {"case": row + 1, "by": by, "value": value, "command": shlex.join(command)}
    return None


def _plot_envelope(sweep: Sweep, planner: Planner, table: Any, path: Path) -> None:
    """Cases by outcome over what varied; below, which part captured in bins of each quantity."""
    from matplotlib.figure import Figure
    from pyarrow import compute

    outcomes = table["outcome"].fill_null(_NOT_RUN)
    captured = is_captured(outcomes)
    outcomes = compute.if_else(captured, "captured", outcomes)
    numbers = {
        quantity.name: (read_numbers(table, quantity.name), quantity.unit)
        for quantity in planner.varied
        if not is_text(table, quantity.name)
    }
    discs = list_discs(sweep.document)
    directions = {direction for _, direction in discs}
    alone = [n for n in numbers if n not in directions and n not in {m for m, _ in discs}]
    pairs = [(alone[i], alone[i + 1]) for i in range(0, len(alone) - 1, 2)]
    if len(alone) % 2:
        others = [name for name in numbers if name not in directions and name != alone[-1]]
        pairs.append((alone[-1], others[0] if others else alone[-1]))
    scalars = [name for name in numbers if name not in directions]
    clouds = [(True, *disc) for disc in discs] + [(False, *pair) for pair in pairs]
    columns = min(_COLUMNS, max(2, len(clouds), len(scalars)))
    cloud_rows, scalar_rows = (math.ceil(len(x) / columns) for x in (clouds, scalars))
    rows = max(1, cloud_rows + scalar_rows)
    figure = Figure(figsize=(3.4 * columns, 3.3 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    cloud_axes, scalar_axes = axes[:cloud_rows].flat, axes[cloud_rows:].flat

    for axis, (is_disc, first, second) in zip(cloud_axes, clouds, strict=False):
        (x, x_unit), (y, y_unit) = numbers[first], numbers[second]
        axis.set_xlabel(f"{first} [{x_unit}]")
        axis.set_ylabel(f"{second} [{y_unit}]" if second != first else "")
        if is_disc:
            angle = np.radians(y)
            x, y = x * np.cos(angle), x * np.sin(angle)
            axis.set_aspect("equal")
            axis.set_xlabel(f"{first} along y [{x_unit}]", fontsize="small")
            axis.set_ylabel(f"along z [{x_unit}]")
        _plot_outcomes(axis, outcomes, x, y)
    for axis, name in zip(scalar_axes, scalars, strict=False):
        values, unit = numbers[name]
        _plot_fraction(axis, values, captured.to_numpy())
        axis.set_xlabel(f"{name} [{unit}]")
        axis.set_ylabel("part captured")
        axis.set_ylim(-0.03, 1.03)
        axis.grid(alpha=0.3)
    for axis in (*cloud_axes[len(clouds) :], *scalar_axes[len(scalars) :]):
        axis.set_visible(False)
    if clouds:
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle(sweep.document["title"], fontsize="medium")
    save_figure(figure, path, COMMAND)


def _plot_outcomes(axis: Any, outcomes: Any, x: np.ndarray, y: np.ndarray) -> None:
    """Draw cases as points in the colour and with the marker of their outcome."""
    from pyarrow import compute

    names = (*(outcome.name for outcome in list_choices("outcome")), _NOT_RUN)
    styles = zip((*OUTCOMES, NOT_RUN), MARKERS, strict=True)
    for name, (colour, marker) in zip(names, styles, strict=True):
        chosen = np.flatnonzero(compute.equal(outcomes, name).to_numpy())
        if len(chosen):
            label = f"{name}: {len(chosen)}"
            if len(chosen) > _MOST_POINTS:  # at random: every n-th of a sequence is no sample
                chosen = np.random.default_rng(0).choice(chosen, _MOST_POINTS, replace=False)
            size = 4 if name == "captured" else 12
            axis.scatter(x[chosen], y[chosen], size, colour, marker=marker, label=label,
                         linewidths=0.6 if marker == "x" else 0)  # fmt: skip


def _plot_fraction(axis: Any, values: np.ndarray, captured: np.ndarray) -> None:
    """Draw the part captured in bins of equal count (or per value), with intervals."""
    different = np.unique(values)
    if len(different) <= _BINS:
        groups = [values == value for value in different]
    else:
        order = np.argsort(values, kind="stable")
        groups = np.array_split(order, min(_BINS, max(1, len(values) // 4)))
    for group in groups:
        part = estimate_fraction(int(captured[group].sum()), len(captured[group]))
        middle = float(np.mean(values[group]))
        axis.plot([middle, middle], [part["low"], part["high"]], color=BLUE, linewidth=0.9)
        axis.plot(middle, part["fraction"], "o", color=BLUE, markersize=4)


def _plot_loads(sweep: Sweep, planner: Planner, table: Any, path: Path) -> None:
    """Part of the cases whose peak exceeds a load; rated loads upright and dotted."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5.5), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    rated = planner.base["mechanism"].get("limits", {})
    for name, values in _peaks(table).items():
        if name not in list_loads():
            continue
        axis = axes[0] if list_loads()[name] == "N" else axes[1]
        style = style_line(list(list_loads()).index(name))
        # From the largest one on, as dense on the logarithmic axis as can be seen.
        ranks = np.unique(np.geomspace(1, len(values), _MOST_POINTS).astype(int))[::-1]
        label = f"{name}, largest {say_number(values.max())}"
        label += f", rated {rated[name]:g}" if name in rated else ""
        loads, exceeded = np.sort(values)[-ranks], ranks / len(values)
        (line,) = axis.step(loads, exceeded, where="pre", label=label, linewidth=0.9, **style)
        if name in rated:
            axis.axvline(rated[name], color=line.get_color(), linestyle=":", linewidth=1.2)
    for axis, text in zip(axes, ("peak force [N]", "peak moment [N m]"), strict=True):
        axis.set_xlabel(f"{text}; dotted: rated")
        axis.set_yscale("log")
        axis.grid(alpha=0.3)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize="small")
    axes[0].set_ylabel("part of the cases at or above")
    figure.suptitle(sweep.document["title"], fontsize="medium")
    save_figure(figure, path, COMMAND)
