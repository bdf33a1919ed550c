"""Lists of scenarios: a table with a case in each row becomes named cases of a sweep.

A column is a key of the scene or a start value of the FMU, in its unit or with its own in the
heading (``initial.lateral_offset [mm]``). The column ``name`` names the cases. An empty cell means:
as in the scene.
"""

from pathlib import Path
from typing import Any

from dockloop.base.errors import UsageError
from dockloop.base.paths import next_to
from dockloop.base.tables import Column, Table, from_frame, read_table, say_form
from dockloop.base.units import is_unit

NAME = "name"  # column of the names, in the table and in that of the results


def read_scenarios(source: Any, sweep: Path) -> tuple[dict[str, Any], str]:
    """Return the entry of ``vary`` that a table is, and how the table was read.

    Args:
        source: a ``pandas.DataFrame``, or the path of a file that `dockloop.base.tables` reads.
        sweep: the file next to which the table is.

    Raises:
        UsageError: naming file, row, column, and what is expected.
        DockloopError: a package is missing.
    """
    if hasattr(source, "columns"):
        table = from_frame(source, "cases")
    else:
        table = read_table(next_to(sweep, source), is_list=True)
    values: dict[str, list[Any]] = {
        name: (_read_names if name == NAME else _read_column)(table, column)
        for name, column in zip(map(_find_key, table.columns), table.columns, strict=True)
    }
    if len(values) < len(table.columns) or "" in values:
        heads = [_find_key(column) for column in table.columns]
        twice = next(name for name in heads if not name or heads.count(name) > 1)
        wrong = f"has two columns '{twice}'" if twice else "has a column without a name"
        raise UsageError(f"{table.place}: {wrong}: must have one column for each key")
    lines = table.columns[0].lines
    if not len(lines):
        raise UsageError(f"{table.place}: has no rows: must have one for each case")
    names = values.pop(NAME, [str(number) for number in range(1, len(lines) + 1)])
    if not values:
        raise UsageError(f"{table.place}: has no column but '{NAME}': must have one for each key")
    cases: dict[str, dict[str, Any]] = {}
    for row, (line, name) in enumerate(zip(lines, names, strict=True)):
        settings = {key: column[row] for key, column in values.items() if column[row] is not None}
        if name is None and not settings:
            continue  # an empty row
        if name is None or name in cases:
            wrong = "is empty" if name is None else f"is '{name}' again"
            raise UsageError(
                f"{table.place}: '{NAME}' in {table.line} {line} {wrong}: each case must have a"
                " name of its own"
            )
        cases[name] = settings
    units = {column.name: column.unit for column in table.columns if column.unit}
    entry = {"type": "cases", "name": NAME, "cases": cases, "units": units, "file": table.place}
    return entry, say_form(table.form)


def _find_key(column: Column) -> str:
    """Return what a column is: no key differs from `NAME` in capitals only."""
    return NAME if column.name.lower() == NAME else column.name


def _read_names(table: Table, column: Column) -> list[str | None]:
    """Return the names of cases as they are written; Excel writes whole numbers as others."""
    pairs = zip(column.cells, table.read_values(column), strict=True)
    names = [cell.strip() if isinstance(cell, str) else value for cell, value in pairs]
    return [None if name in (None, "") else str(name) for name in names]


def _read_column(table: Table, column: Column) -> list[Any]:
    """Return the values of a column, which are of one kind."""
    values = table.read_values(column)
    kinds = {type(v) if isinstance(v, bool | str) else float: v for v in values if v is not None}
    if len(kinds) > 1:
        odd = next(v for kind, v in kinds.items() if kind is not float or bool in kinds)
        line = column.lines[values.index(odd)]
        unit = odd.strip("[]()") if isinstance(odd, str) else ""
        is_of_units = bool(unit) and is_unit(unit)
        more = f"; write the unit in the heading, `{column.name} [{unit}]`" if is_of_units else ""
        raise UsageError(
            f"{table.place}: '{column.name}' in {table.line} {line} is {odd!r}, other cells are"
            f" of another kind: must be all numbers, all true or false, or all texts{more}"
        )
    return values
