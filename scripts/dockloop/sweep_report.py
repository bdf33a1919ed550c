"""What a sweep found: the table, a summary for programs and for people, figures.

The table (Parquet) has one row per case: its number, the quantities, the status and the reason of
a failure, the outcomes at its end. It knows nothing of workers and clocks, so that the same sweep
gives the same file. It is made from the journal in parts, each a row group. Units and descriptions
are in the metadata of the columns; the whole set-up is in the metadata of the table, under keys
that begin with ``dockloop.``.
"""

import itertools
import json
import math
import platform
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dockloop import __version__
from dockloop.capture import WITH_CAPTURE, explain_capture
from dockloop.cases import STATUSES, Result
from dockloop.columns import align, say_number
from dockloop.core import list_choices, list_limits, list_loads, name_choice
from dockloop.criteria import PEAK, has_happened
from dockloop.errors import DockloopError, UsageError, did_you_mean
from dockloop.figures import save_figure
from dockloop.histories import HISTORIES, find_histories
from dockloop.journal import journal_kind
from dockloop.limits import EXCEEDED, name_exceeded
from dockloop.outputs import MADE_BY, Kind, figure_kind, json_kind, table_kind, write_csv, writing
from dockloop.palette import BLUE, MARKERS, NOT_RUN, OUTCOMES, style_line
from dockloop.paths import check_file, read_text, shown
from dockloop.peaks import count_steps, list_with_places
from dockloop.results import import_optional
from dockloop.run_errors import compare_peaks
from dockloop.sampling import Quantity, Sweep, count_drawn, list_discs, say_accuracy
from dockloop.summary import find_summary
from dockloop.sweeps import COMMAND, DIGEST, TABLE, Planner, find_journal

if TYPE_CHECKING:
    import pandas as pd

FIRST = "first."  # begins columns of the first pass, filled where a case ran again
_NAMED = ("outcome", "phase")  # Integers of the FMU that the table spells out
_OF_RESULTS = ("status", "reason", "warning", "end_time")
_PART = 1 << 14  # rows that are made at a time
_NOT_RUN = "not run"  # in place of an outcome
_BINS = 8
_VIEWS = 3  # worst cases that a report shows in motion
_COLUMNS = 4  # panels of a figure side by side
_MOST_POINTS = 20_000  # of one colour in a panel
_MOST_ROWS = 64  # of a table in words
_CLOCK = ("ran", "repeats", "wall", "engine", "workers")
_ENDS = ("outcome", "time_of_capture", "capture.peak.load_ratio", "explanation", "limits")


# A header has the number of the case, what varies, what became of it, outcomes.
_CSV = table_kind("table", COMMAND, "case,", ",status,reason,warning,end_time")


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
        files.append((output.with_suffix(".csv"), _CSV))
    if plots:
        files += [(path, figure_kind(COMMAND)) for path in _list_plots(output.with_suffix(""))]
    return files


def _list_plots(stem: Path) -> list[Path]:
    return [stem.with_name(f"{stem.name}_{name}.png") for name in ("envelope", "loads")]


def make_table(
    sweep: Sweep,
    planner: Planner,
    results: Sequence[Result],
    first: Sequence[Result | None] | None = None,
) -> Any:
    """Return the table of a sweep as a ``pyarrow.Table``.

    Args:
        sweep: what was to be done.
        planner: how it was done.
        results: one per case.
        first: results of the first pass, None where a case did not run again.
    """
    import pyarrow

    schema = _make_schema(sweep, planner)
    parts = _make_parts(schema, sweep, planner, results, first)
    return pyarrow.Table.from_batches(parts, schema)


def write_table(
    sweep: Sweep,
    planner: Planner,
    results: Sequence[Result],
    first: Sequence[Result | None] | None,
    path: Path,
    *,
    as_csv: bool = False,
) -> list[Path]:
    """Write the table of `make_table` as Parquet, on request also as CSV; returns the files.

    A part after the other is made, each a row group.
    """
    from pyarrow import parquet

    files, schema = [path], _make_schema(sweep, planner)
    with (
        writing(path, TABLE) as partial,
        parquet.ParquetWriter(partial, schema) as writer,
    ):
        for part in _make_parts(schema, sweep, planner, results, first):
            writer.write_batch(part)
    if as_csv:
        files.append(path.with_suffix(".csv"))
        table = TableFile(path)
        parts = (zip(*(c.to_pylist() for c in p.columns), strict=True) for p in table.to_batches())
        write_csv(files[-1], _CSV, table.column_names, itertools.chain.from_iterable(parts))
    return files


def read_parts(path: str | Path, columns: Sequence[str] | None = None) -> Iterator["pd.DataFrame"]:
    """Read the table of ``dockloop sweep`` in parts: memory holds one of them.

    ::

        for part in dl.read_parts("own.parquet", ["outcome", "capture.peak.compression"]):
            largest = max(largest, part["capture.peak.compression"].max())

    Args:
        path: the table.
        columns: the columns to read; default: all.

    Returns:
        An iterator over tables of at most 16384 cases each, in the order of the cases. The index
        is the number of the case. Units are in ``part.attrs["units"]``.

    Raises:
        UsageError: the file is no table of a sweep, or lacks a column.
        DockloopError: a package is missing.
    """
    import_optional("pandas")
    table = open_table(Path(path))
    wanted = list(table.column_names if columns is None else columns)
    for name in wanted:
        if name not in table.column_names:
            near = did_you_mean(name, table.column_names)
            raise UsageError(f"{shown(Path(path))}: has no column '{name}'{near}")
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}

    def read() -> Iterator["pd.DataFrame"]:
        for batch in table.to_batches(list(dict.fromkeys(["case", *wanted]))):
            part = batch.to_pandas().set_index("case", drop="case" not in wanted)[wanted]
            part.attrs["units"] = {name: units[name] for name in wanted}
            yield part

    return read()


def open_table(path: Path) -> "TableFile":
    """Open the table of a sweep.

    Raises:
        UsageError: the file is none.
        DockloopError: pyarrow is missing.
    """
    check_file(path, "table")
    try:
        import_optional("pyarrow")
    except DockloopError:
        raise DockloopError(
            "tables of sweeps need the package pyarrow: .venv/bin/pip install -e '.[sweep]'"
        ) from None
    try:
        if not TABLE.is_own(path):
            raise ValueError("it has no such metadata")
        return TableFile(path)
    except (OSError, ValueError) as error:
        raise UsageError(f"{shown(path)}: is no table of 'dockloop sweep' ({error})") from None


class TableFile:
    """The table in its file: what the summary needs of a ``pyarrow.Table``, read part by part.

    Attributes:
        schema: with units and descriptions.
        column_names: names of the columns.
    """

    def __init__(self, path: Path) -> None:
        """Open a table."""
        from pyarrow import parquet

        self._file = parquet.ParquetFile(path)
        self.schema = self._file.schema_arrow
        self.column_names: list[str] = self.schema.names

    def __getitem__(self, name: str) -> Any:
        """Read a column."""
        return self._file.read(columns=[name])[name]

    def to_batches(self, columns: list[str] | None = None) -> Iterator[Any]:
        """Read some rows after the other, of all columns or some."""
        return self._file.iter_batches(_PART, columns=columns)

    def __len__(self) -> int:
        """Return the number of rows."""
        return int(self._file.metadata.num_rows)

    def read_row(self, row: int, columns: list[str]) -> dict[str, Any]:
        """Read one row, from 0: only the row group that holds it."""
        for group in range(self._file.num_row_groups):
            count = self._file.metadata.row_group(group).num_rows
            if row < count:
                part = self._file.read_row_group(group, columns=columns).slice(row, 1)
                return dict(part.to_pylist()[0])
            row -= count
        raise IndexError(row)


def _make_schema(sweep: Sweep, planner: Planner) -> Any:
    """Return names, types, units and descriptions of the columns, and the metadata."""
    import pyarrow

    text, number, whole = pyarrow.string(), pyarrow.float64(), pyarrow.int64()
    fields = []

    def add(name: str, kind: Any, unit: str = "", description: str = "") -> None:
        metadata = {"unit": unit, "description": description}
        fields.append(pyarrow.field(name, kind, metadata=metadata))

    def add_outcomes(prefix: str) -> None:
        for name in planner.outcomes:
            variable = planner.variables[name]
            kind = text if name in _NAMED else number if variable.type == "Real" else whole
            said = variable.description.replace(", -1 before", "; empty if it did not happen")
            add(f"{prefix}{name}", kind, variable.unit, said)

    add("case", whole, description="number of the case, from 1")
    kinds = {str: text, bool: pyarrow.bool_(), int: whole}
    for column, quantity in enumerate(planner.quantities):
        types = {type(value) for value in sweep.cases.list_examples(column)}
        kind = kinds.get(types.pop(), number) if len(types) == 1 else number
        add(quantity.name, kind, quantity.unit, "varied")
        for name in _list_named(quantity):
            values = [settings.get(name) for settings in (quantity.named or {}).values()]
            found = {type(value) for value in values if value is not None}
            kind = kinds.get(found.pop(), number) if len(found) == 1 else number
            unit = planner.with_unit(Quantity(name, "")).unit
            add(name, kind, unit, f"set by '{quantity.name}'; empty: as in the scene")
    add("status", text, description=", ".join(STATUSES))
    add("reason", text, description="why a case is not done")
    add("warning", text, description="what placement or FMU had to say")
    add("end_time", number, "s", "where the case ended")
    add_outcomes("")
    if "capture.reason" in planner.asked:
        add("explanation", text, description="why it was captured or not")
    if EXCEEDED in planner.asked:
        names = ", ".join(limit.name for limit in list_limits())
        add("limits", text, description=f"limits of models and hardware that it passed: {names}")
    if sweep.passes and sweep.passes.refine:
        add(f"{FIRST}status", text, description=", ".join(STATUSES))
        add_outcomes(FIRST)
    return pyarrow.schema(fields, metadata=_make_metadata(sweep, planner))


def _list_named(quantity: Quantity) -> list[str]:
    """Return what the named cases of a quantity set, each once."""
    return list(dict.fromkeys(name for case in (quantity.named or {}).values() for name in case))


def _make_parts(
    schema: Any,
    sweep: Sweep,
    planner: Planner,
    results: Sequence[Result],
    first: Sequence[Result | None] | None,
) -> Iterator[Any]:
    """Yield the table in parts of so many rows that they fit into memory."""
    import pyarrow

    def list_outcomes(found: list[Any]) -> list[list]:
        return [
            [describe_output(name, r.outputs[i]) if r and r.outputs else None for r in found]
            for i, name in enumerate(planner.outcomes)
        ]

    for begin in range(0, len(results), _PART):
        rows = range(begin, min(begin + _PART, len(results)))
        found = [results[row] for row in rows]
        columns: list[Iterable] = [[row + 1 for row in rows]]
        varied = zip(*(sweep.cases[row] for row in rows), strict=True)
        for quantity, values in zip(planner.quantities, varied, strict=True):
            columns.append(values)
            columns += [
                [(quantity.named or {})[str(value)].get(name) for value in values]
                for name in _list_named(quantity)
            ]
        columns += [[getattr(r, name) for r in found] for name in _OF_RESULTS]
        columns += list_outcomes(found)
        ends = [dict(zip(planner.asked, r.outputs, strict=False)) for r in found]
        if "capture.reason" in planner.asked:
            columns.append([explain_capture(end) if end else None for end in ends])
        if EXCEEDED in planner.asked:
            columns.append([name_exceeded(end[EXCEEDED]) if end else None for end in ends])
        if sweep.passes and sweep.passes.refine:
            before = [first[row] if first else None for row in rows]
            columns.append([r and r.status for r in before])
            columns += list_outcomes(before)
        pairs = zip(columns, schema, strict=True)
        arrays = [pyarrow.array(values, field.type) for values, field in pairs]
        yield pyarrow.RecordBatch.from_arrays(arrays, schema=schema)


def count_texts(column: Any) -> dict[str, int]:
    """Return how often each text is in a column, the first one first."""
    counts = column.drop_null().value_counts()
    return {each["values"]: each["counts"] for each in counts.to_pylist()}


def is_captured(outcomes: Any) -> Any:
    """Return of each outcome whether it is one with a capture."""
    from pyarrow import array, compute

    return compute.is_in(outcomes, value_set=array(WITH_CAPTURE))


def has_captured(table: Any) -> np.ndarray:
    """Return 1 for each case with a capture, 0 without, NaN if it did not run."""
    from pyarrow import compute

    outcome = table["outcome"]
    captured = is_captured(outcome).cast("double")
    return compute.if_else(outcome.is_valid(), captured, np.nan).to_numpy()


def is_text(table: Any, name: str) -> bool:
    """Return whether a column has texts, and no numbers."""
    return str(table.schema.field(name).type) == "string"


def read_numbers(table: Any, name: str) -> np.ndarray:
    """Return a column of numbers, NaN where there is none."""
    return table[name].cast("double").to_numpy()


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
        "fmus_built": planner.built,
        "status": {name: status[name] for name in STATUSES if name in status},
    }
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
        summary["time"]["cases_per_second"] = ran["ran"] / wall
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


def _describe_cases(rows: list[dict]) -> list[str]:
    """Return aligned lines, one per case, under short names of the columns."""
    heads = [name.rpartition(".")[2].replace("_", " ") for name in rows[0]]
    cells = [heads] + [
        [
            "" if v is None else say_number(v) if isinstance(v, float) else str(v)
            for v in row.values()
        ]
        for row in rows
    ]
    return align(cells, "    ")


def say_steps(steps: Mapping[str, int]) -> str:
    """Say in which steps of the sequence the peaks arose: ``8 of 12 in step 'align'``."""
    total = sum(steps.values())
    return "arose in " + ", ".join(f"step '{name}' {n} of {total}" for name, n in steps.items())


def _describe_peak_loads(loads: dict[str, dict]) -> list[str]:
    """Say the peak loads of a summary as a table."""
    lines = ["  peak loads        median      95 %      99 %   largest"]
    for name, load in loads.items():
        line = f"    {name:12}" + "".join(
            f"{say_number(load[key]):>10}" for key in ("median", "q95", "q99", "largest")
        )
        line += f" {load['unit']:4}"
        if "rated" in load:
            line += f" rated {say_number(load['rated'])}, above it in {load['above_rated']:.1%}"
        lines.append(line.rstrip())
        if steps := load.get("steps"):
            lines.append(f"{'':16}{say_steps(steps)}")
    return lines


def describe_sweep(summary: dict) -> str:
    """Say a summary in words and numbers."""
    status = summary["status"]
    lines = [
        f"{summary['sweep']}: {summary['title']}",
        f"  cases        {summary['cases']} of scene {summary['scene']}"
        f" ({summary['sampling']}, seed {summary['seed']}): "
        + ", ".join(f"{count} {name}" for name, count in status.items()),
    ]
    if "reasons" in summary:
        lines.append(f"               for example: {summary['reasons']['example']}")
    if status.get("lost"):
        lines.append("               --resume tries again what was lost with its worker")
    if "captured" in summary:
        part = summary["captured"]
        others = ", ".join(f"{n} {name}" for name, n in summary["outcomes"].items())
        lines.append(
            f"  captured     {part['fraction']:.1%} (95 % interval {part['low']:.1%} to"
            f" {part['high']:.1%}): {others}"
        )
    if summary.get("limits"):
        passed = ", ".join(f"{name} in {count}" for name, count in summary["limits"].items())
        lines.append(f"  limits       passed: {passed} cases")
    lines += [f"  {text}" for text in summary.get("not_seen", [])]
    lines += _describe_cases(summary["table"]) if "table" in summary else []
    lines += _describe_peak_loads(summary["peak_loads"]) if summary["peak_loads"] else []
    lines += _describe_passes(summary["refined"]) if "refined" in summary else []
    if "worst" in summary:
        worst = summary["worst"]
        lines.append(f"  worst case   {worst['case']}: {worst['by']} {worst['value']:.4g}; alone:")
        lines.append(f"    {worst['command']}")
    elif summary["peak_loads"].get("load_ratio", {}).get("largest") == 0.0:
        lines.append(
            "  worst case   none: there are no rated loads; name an outcome as 'worst' in the sweep"
        )
    clock = summary["time"]
    if clock["ran"]:
        lines.append(
            f"  time         {clock['ran']} cases in {clock['wall']:.1f} s,"
            f" {clock['cases_per_second']:.2f} per second with {clock['workers']} workers"
            f" (engine {clock['engine']})"
        )
    if clock["repeats"]:
        lines.append(
            f"               {clock['repeats']} of them have the scene and start values of another"
            " case, and took its result"
        )
    if "files" in summary:
        first, *others = summary["files"]
        kinds = ", ".join(sorted({Path(name).suffix[1:] for name in others}))
        lines.append(f"  files        {first}; next to it {len(others)} more ({kinds})")
    return "\n".join(lines)


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


def describe_output(name: str, value: Any) -> Any:
    """Return an output as the table shows it."""
    if name in _NAMED:
        return name_choice(name, value)
    return value if has_happened(name, value) else None


def _make_metadata(sweep: Sweep, planner: Planner) -> dict[str, str]:
    """Return all that is needed to make the table again."""
    versions = {"dockloop": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "fmpy", "dask", "distributed", "pyarrow"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "unknown"
    return {
        "dockloop.sweep": sweep.text,
        "dockloop.scene": read_text(sweep.scene),
        "dockloop.mechanisms": json.dumps(planner.read_own_mechanisms()),
        "dockloop.model": json.dumps(planner.base),
        "dockloop.passes": json.dumps(sweep.passes and asdict(sweep.passes)),
        "dockloop.seed": str(sweep.document["seed"]),
        "dockloop.experiment": json.dumps(
            {
                "stop": float(planner.times[-1]),
                "step": float(planner.times[1] - planner.times[0]),
                "end_after_outcome": sweep.document["experiment"].get("end_after_outcome"),
            }
        ),
        "dockloop.versions": json.dumps(versions),
        "dockloop.model_sha256": planner.model_digest,
        DIGEST: planner.digest,
    }


def estimate_fraction(count: int, total: int) -> dict:
    """Return a fraction with its 95 % interval by Wilson, as for cases drawn at random."""
    z = 1.959963984540054
    p = count / total
    centre = (p + z * z / (2 * total)) / (1 + z * z / total)
    half = z / (1 + z * z / total) * math.sqrt(p * (1 - p) / total + z * z / (4 * total * total))
    return {"count": count, "of": total, "fraction": p, "low": centre - half, "high": centre + half}


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
        `dockloop.run_errors` has it: its median, the largest one and the case of that.
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


def _describe_passes(found: dict) -> list[str]:
    """Say what the second pass changed."""
    before, after = say_accuracy(found["accuracy"]), say_accuracy(found["refine_accuracy"])
    lines = [
        f"  refined      {found['cases']} cases at accuracy {after} after {before}"
        f" ({found['refine']}): {len(found['changed'])} end otherwise"
    ]
    if found["peaks"]:
        load, worst = max(found["peaks"].items(), key=lambda item: item[1]["largest"])
        lines.append(
            f"               largest change of a peak load: {worst['largest']:.2g} of it ({load},"
            f" case {worst['case']})"
        )
    return lines


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


def read_worst(sweep: Sweep, table: Any) -> tuple[str, np.ndarray]:
    """Return the outcome by which cases are ranked and its values, NaN where there is none.

    There are no values if it cannot rank them: it is not collected, or there are no rated loads.

    Args:
        sweep: what was to be done.
        table: of `make_table`.
    """
    by = sweep.document.get("worst", f"{PEAK}load_ratio")
    if by not in table.column_names or is_text(table, by):
        return by, np.array([])
    values = read_numbers(table, by)
    is_ranked = "worst" in sweep.document or np.nanmax(values, initial=0.0) > 0.0
    return by, values if is_ranked else np.array([])  # without rated loads no ratio is above 0


def list_worst(values: np.ndarray, count: int) -> list[int]:
    """Return the rows of the largest values that are finite, the largest one first."""
    return [int(i) for i in np.argsort(-values, kind="stable")[:count] if np.isfinite(values[i])]


def _find_worst(sweep: Sweep, planner: Planner, table: Any) -> dict | None:
    """Return the case with the largest value of the outcome that counts, and its command."""
    by, values = read_worst(sweep, table)
    for row in list_worst(values, 1):
        command = planner.make_command(sweep.cases[row], table["end_time"][row].as_py())
        value = float(values[row])
        return {"case": row + 1, "by": by, "value": value, "command": shlex.join(command)}
    return None


def list_views(output: Path) -> list[Path]:
    """Return the pages that show the worst cases, those of a report."""
    return [output.with_name(f"{output.stem}_worst{i + 1}.html") for i in range(_VIEWS)]


def write_views(sweep: Sweep, planner: Planner, table: Any, output: Path) -> dict[int, Path]:
    """Run the worst cases again and write pages with their motion; returns these by row."""
    from dockloop.view.command import run_again
    from dockloop.view.page import write_page

    _, values = read_worst(sweep, table)
    views = dict(zip(list_worst(values, _VIEWS), list_views(output), strict=False))
    for row, path in views.items():
        words = planner.make_command(sweep.cases[row], table["end_time"][row].as_py())
        write_page(run_again(words, f"case {row + 1}"), path, command=shlex.join(words))
    return views


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
