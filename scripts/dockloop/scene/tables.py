"""Tables of users in scenes and mechanisms: the numbers take the place of the file.

A force law of type ``table`` reads a force over travel, an entry of ``[[force]]`` one over gap and
offset, an entry of ``[[input]]`` histories of inputs. Columns are mapped and converted as those of
measurements are (`dockloop.base.histories`).
"""

import copy
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.ccsds import find_kind
from dockloop.base.errors import UsageError, warn_once
from dockloop.base.histories import (
    Channel,
    Data,
    Terms,
    check_once,
    find_channels,
    list_unknown,
    read_data,
    split_column,
)
from dockloop.base.paths import next_to, shown
from dockloop.base.tables import Table, parse_form, read_table
from dockloop.base.units import find_factor
from dockloop.native.core import core_errors, name_source, to_json
from dockloop.native.variables import read_variables
from dockloop.scene.records import MEMBERS, NAMES, UNITS, Records

_SLIDE, _TURN = ("m", "N"), ("rad", "N.m")
_SHOWN = 8  # names in a warning


@contextmanager
def _naming_members() -> Iterator[None]:
    """Let messages name the member ``csv`` where they name the option."""
    try:
        yield
    except UsageError as error:
        raise UsageError(re.sub(r"--csv '([^']*)'", r'csv = "\1"', str(error))) from None


def put_law_tables(mechanism: dict, source: Path) -> None:
    """Read the files of force laws; arrays take their place.

    Args:
        mechanism: one that its schema accepts, modified in place.
        source: its file: next to it are those of the laws.

    Raises:
        UsageError: naming file, line or column, value, and what is expected.
        DockloopError: a package is missing.
    """
    joints = {b["name"]: b.get("joint", {}).get("type") for b in mechanism.get("bodies", [])}
    for entry in mechanism.get("forces", []):
        for number, law in enumerate(entry.get("laws", []), 1):
            if law["type"] != "table":
                continue
            what = f"law {number} of element '{entry['name']}'"
            if _names_file(law, "travel", f"{shown(source)}: {what}"):
                _read_law(law, source, what, joints.get(entry["along"][0]["joint"]))


@_naming_members()
def put_force_tables(forces: Sequence[dict], source: Path) -> None:
    """Read the files of forces between the vehicles; arrays take their place.

    Args:
        forces: entries of ``[[force]]``, which the schema accepts, modified in place.
        source: the scene file: next to it are the tables.

    Raises:
        UsageError: naming file, line or column, value, and what is expected.
        DockloopError: a package is missing.
    """
    for number, entry in enumerate(forces, 1):
        what = f"force[{number}]"
        if entry["type"] != "table" or not _names_file(entry, "gap", f"{shown(source)}: {what}"):
            continue
        path, form, columns = _take_file(entry, source, f"{shown(source)}: {what}")
        table = read_table(path, form)
        offsets = entry.get("offset")
        names = [f"force[{i}]" for i in range(1, len(offsets) + 1)] if offsets else ["force"]
        units = {"gap": _SLIDE[0], **dict.fromkeys(names, _SLIDE[1])}
        terms = Terms(f"{what}: columns", "a force 'table'", "quantity", "force:N")
        values = _read_forces(table, units, columns, terms, "sort the rows")
        entry["gap"] = values["gap"].tolist()
        entry["force"] = [values[name].tolist() for name in names]


def _names_file(entry: dict, along: str, place: str) -> bool:
    """Return whether a table is in a file; else it is in the entry. Raises UsageError."""
    has_file, has_rows = "file" in entry, along in entry and "force" in entry
    if has_file == has_rows or (has_file and (along in entry or "force" in entry)):
        raise UsageError(f"{place}: must have either 'file' or '{along}' and 'force'")
    return has_file


@_naming_members()
def _read_law(law: dict, source: Path, what: str, joint: str | None) -> None:
    """Put the rows of a file into its law. @param joint: type of the joint; None: of a leg."""
    place = f"{shown(source)}: {what}"
    path, form, columns = _take_file(law, source, place)
    table = read_table(path, form)
    rates = law.get("rates")
    forces = [f"force[{i}]" for i in range(1, len(rates) + 1)] if rates else ["force"]
    units = _TURN if joint == "revolute" else _SLIDE
    if joint is None and any(find_factor(c.unit or "", "rad") for c in table.columns):
        units = _TURN
    expected = {"travel": units[0], **dict.fromkeys(forces, units[1])}
    terms = Terms(f"{what}: columns", "a law 'table'", "quantity", f"force:{units[1]}")
    advice = "sort the rows, and give each branch of a hysteresis a column of its own with a rate"
    values = _read_forces(table, expected, columns, terms, advice)
    law["travel"] = values["travel"].tolist()
    lists = [values[name].tolist() for name in forces]
    law["force"] = lists if rates else lists[0]


def _read_forces(
    table: Table,
    expected: dict[str, str],
    columns: dict[str, tuple[str, str]],
    terms: Terms,
    advice: str,
) -> dict[str, np.ndarray]:
    """Return the values of the expected columns, the first of which must increase.

    Args:
        table: of the file.
        expected: unit of each quantity by its name.
        columns: what the columns mean, where the user says it.
        terms: for messages.
        advice: what to do if the first quantity does not increase.

    Raises:
        UsageError: naming file, line or column, value, and what is expected.
    """
    found, left_out = find_channels(table, expected, columns, terms)
    check_once(table, found, terms)
    channels = {channel.name: channel for channel in found}
    for name, unit in expected.items():
        if name not in channels:
            fits = (c for c in table.columns if c.unit and find_factor(c.unit, unit))
            column = next(fits, table.columns[-1])
            meant = name if column.unit else f"{name}:{unit}"
            raise UsageError(
                f"{table.place}: has no column '{name}': name it, for example"
                f" {terms.say_map(column.name, meant)}"
            )
    _warn_of_unknown(table.place, list_unknown(left_out, columns), terms)
    values = {name: _read_full(table, channel) for name, channel in channels.items()}
    first = next(iter(expected))
    along, lines = values[first], channels[first].column.lines
    if len(along) < 2:
        raise UsageError(f"{table.place}: has one row of values: a law needs two or more")
    if (falls := np.flatnonzero(np.diff(along) <= 0.0)).size:
        row = int(falls[0]) + 1
        raise UsageError(
            f"{table.place}: {first} must increase, but in {table.line} {lines[row]} it is"
            f" {along[row]:g} {expected[first]} after {along[row - 1]:g}: {advice}"
        )
    return values


@_naming_members()
def read_inputs(entries: Sequence[dict], document: dict, source: Path) -> list[dict[str, Any]]:
    """Return the histories of inputs that the tables of a scene are.

    Args:
        entries: of ``[[input]]``, which the schema accepts.
        document: the resolved scene without them; vehicles with a record become ``recorded``.
        source: the scene file: next to it are the tables.

    Returns:
        For each input ``variable``, ``interpolation``, ``time`` [s] and ``value`` in SI units, for
        each vehicle with a record ``time``, ``pose`` and ``velocity``.

    Raises:
        UsageError: naming file, line or column, value, and what is expected.
        DockloopError: a package is missing.
    """
    with core_errors() as core:
        variables = read_variables(core.Docking(to_json(document), name_source(source)))
    inputs = {name: v for name, v in variables.items() if v.causality == "input"}
    units = ["s", *(variable.unit for variable in inputs.values()), *UNITS]
    records = Records(document)
    terms = Terms("[[input]] columns", "the scene", "input", "chaser.force_ext[1]:N")
    histories: dict[str, dict[str, Any]] = {}
    for number, entry in enumerate(copy.deepcopy(entries), 1):
        place = f"{shown(source)}: input[{number}]"
        path, form, columns = _take_file(entry, source, place)
        shorts = NAMES if find_kind(path) else []
        if "vehicle" in entry and not shorts:
            raise UsageError(
                f"{place}: 'vehicle' is of CCSDS messages: columns of a table name their vehicle"
            )
        names = ["time", *inputs, *shorts]
        data = read_data(path, names, units[: len(names)], form, columns, terms)
        _warn_of_unknown(shown(path), data.unknown, terms)
        _say_message(shown(path), data)
        names = [records.complete(name, entry.get("vehicle"), place) for name in data.names]
        is_motion = any(name.partition("[")[0].partition(".")[2] in MEMBERS for name in names)
        if is_motion and entry.get("interpolation") == "hold":
            raise UsageError(f"{place}: has a motion, which cannot hold: leave 'interpolation' out")
        shift = records.find_shift(data, entry.get("start"), place, is_motion=is_motion)
        data = replace(data, time=data.time - shift, names=names)
        others = records.take(data, shown(path))
        if not others:
            continue
        begin, stop = (document["experiment"][name] for name in ("start", "stop"))
        if data.time[0] > stop or data.time[-1] < begin:
            span = f"{data.time[0]:.10g} to {data.time[-1]:.10g} s"
            span += f", the run from {begin:g} to {stop:g} s"
            warn_once(
                f"{shown(path)}: is from {span}: only one row acts; times are those of the run, or"
                " dates"
            )
        for name in others:
            values = data[name]
            if name in histories:
                raise UsageError(f"{place}: '{name}' has a table already: leave one of them out")
            rows = np.isfinite(values)
            is_held = inputs[name].type != "Real" or entry.get("interpolation") == "hold"
            histories[name] = {
                "variable": name,
                "interpolation": "hold" if is_held else "linear",
                "time": data.time[rows].tolist(),
                "value": values[rows].tolist(),
            }
    motions = records.list_motions()
    for motion in motions:
        document[motion["variable"].partition(".")[0]]["motion"] = "recorded"
    return [*motions, *histories.values()]


def _say_message(place: str, data: Data) -> None:
    """Say once what the frame and the keywords of a CCSDS message are taken for."""
    form = data.source["form"]
    if "message" not in form:
        return
    if form["unknown"]:
        names = "', '".join(form["unknown"])
        warn_once(f"{place}: nothing uses the keyword '{names}'")
    warn_once(
        f"{place}: REF_FRAME '{form['frame']}' is taken as the frame N of the scene; the first row"
        f" is at {data.source['time_from']} {form['time_system']}"
    )


def list_files(scene: Mapping[str, Any]) -> list[dict]:
    """Return the entries of a scene that is no file which name a table: inputs, forces, laws."""
    mechanism = scene.get("mechanism", {})
    patterns = mechanism.get("patterns") if isinstance(mechanism, Mapping) else None
    groups = [mechanism, *(patterns if isinstance(patterns, list) else ())]
    forces = [f for group in groups if isinstance(group, Mapping) for f in group.get("forces", [])]
    laws = [law for force in forces for law in force.get("laws", [])]
    return [
        entry
        for entry in [*scene.get("input", []), *scene.get("force", []), *laws]
        if "file" in entry
    ]


def _warn_of_unknown(place: str, headings: Sequence[str], terms: Terms) -> None:
    """Say once of a table which columns have no effect."""
    if headings:
        names = "', '".join(headings[:_SHOWN])
        more = f" and {len(headings) - _SHOWN} more" if len(headings) > _SHOWN else ""
        warn_once(
            f"{place}: nothing uses '{names}'{more}: no {terms.what} of {terms.owner} has such a"
            " name; map columns, or state an empty text for those that are left out"
        )


def _take_file(
    entry: dict, source: Path, place: str
) -> tuple[Path, dict[str, str], dict[str, tuple[str, str]]]:
    """Take ``file``, ``csv`` and ``columns`` out of a law or an input. Raises UsageError.

    Args:
        entry: modified in place.
        source: of the entry: next to it is the file.
        place: of the entry, for messages.

    Returns:
        The path of the file, what is stated of its form, what its columns mean.
    """
    path = next_to(source, entry.pop("file"))
    csv = entry.pop("csv", "")
    form = parse_form(csv, f"{place}: csv") if csv else {}
    columns = {name: split_column(value) for name, value in entry.pop("columns", {}).items()}
    return path, form, columns


def _read_full(table: Table, channel: Channel) -> np.ndarray:
    """Return the values of a column, all of which must be there."""
    values = table.read_numbers(channel.column) * channel.factor
    if (missing := np.flatnonzero(np.isnan(values))).size:
        raise UsageError(
            f"{table.place}: '{channel.column.name}' in {table.line}"
            f" {channel.column.lines[int(missing[0])]} is empty or no number: must have a value"
        )
    return values
