"""Reads time histories: a table whose headings name variables and units, or are mapped.

Of a rig, whose columns are outputs of a run, and of inputs of a scene:

    time [s],relative.axial [mm] +-0.5,capture.compression [kN]
    0.000,12.5,0
    0.002,12.3,0.004

``+-0.5`` is the accuracy of the channel, in the unit of its heading. Values become those of the
outputs, in SI units. Tables of FMI tools have the names of outputs and no units: those of the
outputs hold. What cannot be read is refused with file, column, row, and what is expected.
`find_channels` serves other tables with named columns, too.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.ccsds import read_message
from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.number import read_number
from dockloop.base.paths import read_bytes, shown
from dockloop.base.tables import Column, Table, read_table
from dockloop.base.units import find_factor

NAMELESS = "(no name)"
_TIMES = ("time", "t")
_EXAMPLES = (
    *("s", "ms", "m", "mm", "m/s", "mm/s", "rad", "deg", "rad/s", "deg/s", "N", "kN", "lbf"),
    *("N m", "kN m", "J", "kJ", "%", "1"),
)


@dataclass(frozen=True)
class Terms:
    """Words of messages: what maps columns, whose names they are to mean, what these are."""

    option: str
    owner: str
    what: str
    example: str

    def say_map(self, column: str, name: str = "") -> str:
        """Return how a column is mapped to a name; without one it is left out."""
        if self.option.startswith("-"):
            return f"{self.option} '{column}={name}'"
        return f'{self.option} = {{ "{column}" = "{name}" }}'


MEASURED = Terms("--columns", "the run", "output", "capture.compression:kN")


@dataclass(frozen=True)
class Data:
    """Measured histories.

    Attributes:
        time: [s], never decreasing, shape (samples,).
        names: of the outputs that were measured.
        units: of these outputs.
        values: in these units, NaN where a column was not measured, shape (samples, names).
        accuracies: of the outputs whose heading states one, in their unit.
        source: how the table was read: ``form`` (`Table.form`), ``columns`` (by output: ``from``
            which heading, ``unit``, whether this is ``stated`` and the name is ``mapped``),
            ``left_out`` (headings), ``time_from`` (moment; None: times are numbers).
        unknown: headings that mean nothing, and that no map leaves out.
    """

    time: np.ndarray
    names: list[str]
    units: list[str]
    values: np.ndarray
    accuracies: dict[str, float] = field(default_factory=dict)
    source: dict[str, Any] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)

    def __contains__(self, name: str) -> bool:
        """Return whether an output was measured."""
        return name in self.names

    def __getitem__(self, name: str) -> np.ndarray:
        """Return one history, shape (samples,)."""
        return self.values[:, self.names.index(name)]


@dataclass(frozen=True)
class Channel:
    """A column and what it means: a variable or the time, unit, size of that in the variable's."""

    column: Column
    name: str
    unit: str
    factor: float


def parse_columns(
    texts: Sequence[str], option: str = MEASURED.option
) -> dict[str, tuple[str, str]]:
    """Return the output and the unit (empty: not stated) of columns by their names.

    Args:
        texts: each ``Fz=capture.compression:kN, dx=relative.axial``, or the path of a TOML file
            with such members; an output that is empty leaves its column out.
        option: for the message.

    Raises:
        UsageError: naming option or file, and what is wrong.
    """
    pairs: list[tuple[str, str, Any]] = []
    for text in texts:
        if text.endswith(".toml"):
            try:
                content = read_bytes(Path(text), "map of columns").decode("utf-8-sig")
                members = tomllib.loads(content)
            except ValueError as error:
                raise UsageError(f"{shown(text)}: is no TOML file ({error})") from None
            pairs += [(shown(text), name, value) for name, value in members.items()]
        else:
            # A name may have a comma: "x, y=relative.axial" is one column.
            is_map = re.fullmatch(r"(?:[^=]+=[^=,]*(?:,|$))+", text)
            parts = re.findall(r"([^=]+)=([^=,]*)(?:,|$)", text) if is_map else [(text, None)]
            pairs += [(f"{option} '{text}'", name.strip(), value) for name, value in parts]
    found: dict[str, tuple[str, str]] = {}
    for place, name, value in pairs:
        if not isinstance(value, str) or not name:
            raise UsageError(
                f"{place}: '{name}' must have an output and its unit, for example"
                " Fz=capture.compression:kN"
            )
        if name in found:
            raise UsageError(f"{place}: has '{name}' twice")
        found[name] = split_column(value)
    return found


def split_column(value: str) -> tuple[str, str]:
    """Return the name and the unit, which may be empty, of ``capture.compression:kN``."""
    name, _, unit = (part.strip() for part in value.partition(":"))
    return name, unit


def read_data(  # noqa: PLR0917  what a table is, then how to read it
    path: Path,
    outputs: Sequence[str],
    units: Sequence[str],
    form: Mapping[str, str] = {},
    columns: Mapping[str, tuple[str, str]] = {},
    terms: Terms = MEASURED,
) -> Data:
    """Read a table of measurements, or of inputs.

    Args:
        path: the file, of any kind that `dockloop.base.tables` reads.
        outputs: of the run, ``time`` first; or inputs.
        units: of these.
        form: what is stated of the file.
        columns: of `parse_columns`.
        terms: of messages.

    Raises:
        UsageError: naming file, column or row, and what is expected.
        DockloopError: a package is missing.
    """
    table = read_message(path) or read_table(path, form)
    expected = dict(zip(outputs, units, strict=True))
    channels, left_out = find_channels(table, expected, columns, terms)
    times = [channel for channel in channels if channel.name == "time"]
    measured = [channel for channel in channels if channel.name != "time"]
    _check_channels(table, times, measured, terms)
    owners = [_find_time(table, times, channel, terms) for channel in measured]
    times = [time for time in times if any(owner is time for owner in owners)]
    clocks, start = table.read_times([time.column for time in times])
    parts = []  # time and values of the columns that share a time
    for time, clock in zip(times, clocks, strict=True):
        own = [c for c, owner in zip(measured, owners, strict=True) if owner is time]
        parts.append((own, *_read_part(table, time, clock * time.factor, own)))
    rows = np.concatenate([clock for _, clock, _ in parts])
    values = np.full((len(rows), len(measured)), np.nan)
    begin = 0
    for own, clock, part in parts:
        for channel, column in zip(own, part.T, strict=True):
            values[begin : begin + len(clock), measured.index(channel)] = column
        begin += len(clock)
    order = np.argsort(rows, kind="stable")
    source = {
        "form": {k: v for k, v in table.form.items() if v is not None},
        "columns": {c.name: _describe_channel(c, columns) for c in channels},
        "left_out": [column.heading or NAMELESS for column in left_out],
        "time_from": start or None,
    }
    accuracies = {c.name: a for c in measured if (a := _read_accuracy(table, c)) is not None}
    names = [channel.name for channel in measured]
    of_names = [expected[name] for name in names]
    unknown = list_unknown(left_out, columns)
    return Data(rows[order], names, of_names, values[order], accuracies, source, unknown)


def find_channels(
    table: Table,
    expected: dict[str, str],
    columns: Mapping[str, tuple[str, str]],
    terms: Terms = MEASURED,
) -> tuple[list[Channel], list[Column]]:
    """Return the columns that are known or mapped, and the others.

    Args:
        table: as it was read.
        expected: the variables that columns may mean, with their units.
        columns: of `parse_columns`.
        terms: of messages.

    Raises:
        UsageError: naming file and column, and what is expected.
    """
    headings = [name for c in table.columns for name in (c.heading, c.name)]
    for name, (output, _) in columns.items():
        if name not in headings:
            near = did_you_mean(name, headings) or f": has {', '.join(headings[::2])}"
            raise UsageError(f"{table.place}: has no column '{name}'{near}")
        if output and output not in expected:
            near = did_you_mean(output, expected)
            raise UsageError(
                f"{terms.say_map(name, output)}: {terms.owner} has no {terms.what} '{output}'{near}"
            )
    has_units = any(c.unit for c in table.columns) or any(unit for _, unit in columns.values())
    is_typed = has_units and not columns
    channels, left_out = [], []
    for column in table.columns:
        mapped = columns.get(column.heading, columns.get(column.name))
        output, unit = mapped or (_find_name(table, column, expected, terms, is_typed=is_typed), "")
        if not output:
            left_out.append(column)
            continue
        stated = column.unit or ""
        if unit and stated and unit != stated:
            raise UsageError(
                f"{table.place}: '{column.heading}' is in '{stated}', {terms.option} states"
                f" '{unit}':"
                " leave one of them out"
            )
        own = expected[output] or "1"
        unit = unit or stated
        if output == "time" and table.has_moments(column):
            unit = own  # whatever the heading says of hours and minutes
        if not unit and has_units and own != "1":
            raise UsageError(
                f"{table.place}: the heading '{column.heading}' has no unit, but others have: must"
                f" have one, for example '{output} [{own}]', or"
                f" {terms.say_map(column.name, f'{output}:{own}')}"
            )
        unit = unit or own
        factor = find_factor(unit, own)
        if factor is None:
            fitting = [u for u in _EXAMPLES if find_factor(u, own)]
            raise UsageError(
                f"{table.place}: '{column.name}' is in '{unit}': must be in"
                f" {' or '.join(fitting or [own])}, or in another unit of {own}"
            )
        channels.append(Channel(column, output, unit, factor))
    return channels, left_out


def list_unknown(left_out: Sequence[Column], columns: Mapping[str, tuple[str, str]]) -> list[str]:
    """Return the headings of columns that are left out without a word of a map."""
    unknown = (c for c in left_out if c.heading not in columns and c.name not in columns)
    return [column.heading or NAMELESS for column in unknown]


def _find_name(
    table: Table, column: Column, expected: dict[str, str], terms: Terms, *, is_typed: bool
) -> str:
    """Return the variable that a column means without a map; empty: none.

    A name that is typed by hand may be misspelt; tables of tools have other columns, too.
    """
    for name in (column.name, column.heading):
        if name in expected:
            return name
    last = column.name.lower() if table.has_order else column.name.lower().rpartition(".")[2]
    if last in _TIMES and "time" in expected:
        return "time"
    ends = [name for name in expected if column.name.endswith(f".{name}")]
    near = did_you_mean(column.name, expected) if column.name and is_typed else ""
    if not ends and near:
        raise UsageError(
            f"{table.place}: {terms.owner} has no {terms.what} '{column.name}'{near}; map it, or"
            f" leave it out: {terms.say_map(column.name, f'{terms.what.upper()}:UNIT')} or"
            f" '{column.name}='"
        )
    return max(ends, key=len, default="")


def _describe_channel(channel: Channel, columns: Mapping[str, tuple[str, str]]) -> dict[str, Any]:
    """Return where a channel comes from, for people and programs."""
    column = channel.column
    by_map = columns.get(column.heading, columns.get(column.name))
    return {
        "from": column.heading,
        "unit": channel.unit,
        "stated": bool(column.unit or (by_map and by_map[1])),
        "mapped": channel.name not in (column.name, column.heading),
    }


def _check_channels(
    table: Table, times: list[Channel], measured: list[Channel], terms: Terms
) -> None:
    """Refuse a table without time or variables, and a variable that two columns mean."""
    if not times:
        name = next((column.name for column in table.columns if column.name), NAMELESS)
        header, more = table.form.get("header"), ""
        if isinstance(header, int):
            more = f"; names are from {table.line} {header}, state another one by --csv 'header=N'"
        elif "none" in str(header):
            count = len(table.columns)
            more = f"; no line above the values has {count} names, state one by --csv 'header=N'"
        raise UsageError(
            f"{table.place}: no column is the time: must have 'time [s]', or name it, for example"
            f" {terms.say_map(name, 'time:s')}{more}"
        )
    if not measured:
        others = [c.name for c in table.columns if all(c is not t.column for t in times)]
        raise UsageError(
            f"{table.place}: has no column of an {terms.what} of {terms.owner}: name them, for"
            f" example {terms.say_map((others or ['COLUMN'])[-1], terms.example)}"
        )
    check_once(table, measured, terms)


def check_once(table: Table, channels: Sequence[Channel], terms: Terms) -> None:
    """Refuse a table with two columns of one variable. Raises UsageError."""
    names = [channel.name for channel in channels]
    for i, name in enumerate(names):
        if name in names[:i]:
            both = "' and '".join(c.column.heading for c in channels if c.name == name)
            raise UsageError(
                f"{table.place}: has two columns '{name}' ('{both}'): leave one out, for example"
                f" {terms.say_map(channels[i].column.name)}"
            )


def _find_time(table: Table, times: list[Channel], channel: Channel, terms: Terms) -> Channel:
    """Return the time of a column: the next on its left, or the one of its group."""
    if table.has_order:
        place = table.columns.index(channel.column)
        left = [t for t in times if table.columns.index(t.column) < place]
        return (left or times[:1])[-1]
    groups = [time.column.name.rpartition(".")[:2] for time in times]
    sizes = [len(g) if channel.column.name.startswith(f"{g}{p}") else -1 for g, p in groups]
    if sizes.count(max(sizes)) > 1:
        raise UsageError(
            f"{table.place}: '{channel.column.name}' has several times in its group: leave all but"
            f" one out, for example {terms.say_map(times[-1].column.name)}"
        )
    return times[sizes.index(max(sizes))]


def _read_part(
    table: Table, time: Channel, clock: np.ndarray, own: list[Channel]
) -> tuple[np.ndarray, np.ndarray]:
    """Return a time and the values of its columns, without rows that have neither."""
    for channel in own:
        if len(channel.column.cells) != len(clock):
            raise UsageError(
                f"{table.place}: '{channel.column.name}' has {len(channel.column.cells)} values,"
                f" its time '{time.column.name}' {len(clock)}: they must have the same number"
            )
    values = np.column_stack([table.read_numbers(c.column) * c.factor for c in own])
    for channel, column in zip(own, values.T, strict=True):
        if not np.isfinite(column).any():
            raise UsageError(f"{table.place}: '{channel.column.name}' has no values: leave it out")
    is_timed = np.isfinite(clock)
    lost = ~is_timed & np.isfinite(values).any(axis=1)
    if lost.any():
        row = time.column.lines[int(np.argmax(lost))]
        raise UsageError(
            f"{table.place}: '{time.column.name}' in {table.line} {row} is empty: must have a time"
            " for its values"
        )
    lines = np.array(time.column.lines)[is_timed]
    clock, values = clock[is_timed], values[is_timed]
    steps = np.diff(clock)
    if (steps < 0.0).any():
        row = lines[1 + int(np.argmax(steps < 0.0))]
        raise UsageError(
            f"{table.place}: time must not decrease, but does in {table.line} {row}: sort the rows,"
            " or separate the tests"
        )
    if not (steps > 0.0).any():
        raise UsageError(f"{table.place}: needs at least two rows of values at different times")
    return clock, values


def _read_accuracy(table: Table, channel: Channel) -> float | None:
    """Return the accuracy that a heading states, in the unit of the output."""
    stated = channel.column.accuracy
    if not stated:
        return None
    try:
        accuracy = read_number(stated.replace(",", "."))
    except ValueError:
        accuracy = 0.0
    if not accuracy > 0.0:
        raise UsageError(
            f"{table.place}: the accuracy of '{channel.column.name}' is '{stated}': must be a"
            f" finite number above 0, in {channel.unit}"
        )
    return channel.factor * accuracy
