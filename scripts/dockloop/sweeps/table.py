"""The table of a sweep.

The table (Parquet) has one row per case: its number, the quantities, the status and the reason of
a failure, the outcomes at its end. It knows nothing of workers and clocks, so that the same sweep
gives the same file. It is made from the journal in parts, each a row group. Units and descriptions
are in the metadata of the columns; the whole set-up is in the metadata of the table, under keys
that begin with ``dockloop.``.
"""

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dockloop.base.errors import DockloopError, UsageError, did_you_mean, names_arguments
from dockloop.base.files import Kind, claim, table_kind, write_csv, writing
from dockloop.base.paths import as_path, check_file, read_text, shown
from dockloop.base.progress import import_optional
from dockloop.base.version import list_versions
from dockloop.native.core import list_limits, name_choice
from dockloop.result.capture import WITH_CAPTURE, explain_capture
from dockloop.result.criteria import PEAK, has_happened
from dockloop.result.limits import EXCEEDED, name_exceeded
from dockloop.runs.outcome import STATUSES, Result
from dockloop.sweeps.assured import COLUMNS, list_cells
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import Quantity, Sweep

if TYPE_CHECKING:
    import pandas as pd

COMMAND = "dockloop sweep"
DIGEST = "dockloop.digest"  # of a sweep, in the metadata of its table
FIRST = "first."  # begins columns of the first pass, filled where a case ran again
_NAMED = ("outcome", "phase")  # Integers of the FMU that the table spells out
_OF_RESULTS = ("status", "reason", "warning", "end_time")
_PART = 1 << 14  # rows that are made at a time


def find_journal(output: Path) -> Path:
    """Return where the journal next to the table of a sweep is."""
    return output.with_suffix(".jsonl")


def read_table_metadata(path: Path) -> dict[str, str]:
    """Return the metadata of a table. Raises OSError or ValueError: it is none."""
    from pyarrow import parquet

    found = parquet.read_metadata(path).metadata or {}
    return {key.decode(): value.decode() for key, value in found.items()}


TABLE = Kind("table", COMMAND, lambda path: "dockloop.sweep" in read_table_metadata(path))


def check_table(path: Path, digests: set[str]) -> None:
    """Refuse to replace anything but the table of a sweep that has one of these digests."""
    claim(path, TABLE)
    if path.exists() and read_table_metadata(path).get(DIGEST) not in digests:
        raise UsageError(
            f"{shown(path)}: holds the finished table of another sweep (cases, scene or outcomes"
            " differ): choose another -o or delete it"
        )


# A header has the number of the case, what varies, what became of it, outcomes.
CSV = table_kind("table", COMMAND, "case,", ",status,reason,warning,end_time")


def write_table(
    sweep: Sweep,
    planner: Planner,
    results: Sequence[Result],
    first: Sequence[Result | None] | None,
    path: Path,
    *,
    as_csv: bool = False,
) -> list[Path]:
    """Write the table of a sweep as Parquet, on request also as CSV; returns the files.

    A part after the other is made, each a row group.

    Args:
        sweep: what was to be done.
        planner: how it was done.
        results: one per case.
        first: results of the first pass, None where a case did not run again.
        path: the file.
        as_csv: write CSV, too.
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
        write_csv(files[-1], CSV, table.column_names, itertools.chain.from_iterable(parts))
    return files


@names_arguments
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
    file = as_path("read_parts: path", path)
    table = open_table(file)
    wanted = list(table.column_names if columns is None else columns)
    for name in wanted:
        if name not in table.column_names:
            near = did_you_mean(name, table.column_names)
            raise UsageError(f"{shown(file)}: has no column '{name}'{near}")
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

    def to_pandas(self) -> "pd.DataFrame":
        """Read all of it, with units in ``attrs["units"]``."""
        frame = self._file.read().to_pandas()
        frame.attrs["units"] = {f.name: f.metadata[b"unit"].decode() for f in self.schema}
        return frame

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
    if planner.assured is not None:
        for name, kind in zip(COLUMNS, (text, whole, number), strict=True):
            add(name, kind, "", COLUMNS[name])
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
        if planner.assured is not None:
            columns += zip(*(list_cells(r.assured) for r in found), strict=True)
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


def describe_output(name: str, value: Any) -> Any:
    """Return an output as the table shows it."""
    if name in _NAMED:
        return name_choice(name, value)
    return value if has_happened(name, value) else None


def _make_metadata(sweep: Sweep, planner: Planner) -> dict[str, str]:
    """Return all that is needed to make the table again."""
    installed = list_versions("numpy", "scipy", "fmpy", "dask", "distributed", "pyarrow")
    versions = {package: version or "unknown" for package, version in installed.items()}
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


def read_worst(sweep: Sweep, table: Any) -> tuple[str, np.ndarray]:
    """Return the outcome by which cases are ranked and its values, NaN where there is none.

    There are no values if it cannot rank them: it is not collected, or there are no rated loads.

    Args:
        sweep: what was to be done.
        table: of the sweep.
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
