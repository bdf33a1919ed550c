"""Cases of a sweep in three dimensions: which ones, each of them run again."""

import argparse
import json
import shlex
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.files import claim, scratch
from dockloop.base.paths import shown
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import Sweep, Value
from dockloop.sweeps.table import list_worst, read_worst
from dockloop.view.write import list_files, write_files

if TYPE_CHECKING:
    from dockloop.sweeps.table import TableFile

_MOST_CASES = 20
_VIEWS = 3  # worst cases that a report shows in motion


def list_views(output: Path) -> list[Path]:
    """Return the pages that show the worst cases, those of a report."""
    return [output.with_name(f"{output.stem}_worst{i + 1}.html") for i in range(_VIEWS)]


def write_views(sweep: Sweep, planner: Planner, table: Any, output: Path) -> dict[int, Path]:
    """Run the worst cases again and write pages with their motion; returns these by row."""
    from dockloop.view.page import write_page

    _, values = read_worst(sweep, table)
    views = dict(zip(list_worst(values, _VIEWS), list_views(output), strict=False))
    for row, path in views.items():
        case = sweep.cases[row], table["end_time"][row].as_py()
        command = shlex.join(planner.make_command(*case))
        write_page(planner.record(*case), path, command=command)
    return views


def view_sweep(
    table: Path, output: Path, options: argparse.Namespace, meshes: list[tuple[str, dict]]
) -> str:
    """Run cases of a sweep again and write one page for each."""
    from dockloop.sweeps.table import open_table, read_table_metadata

    rows, metadata = open_table(table), read_table_metadata(table)
    try:
        cases = _choose_cases(table, rows, metadata, options)
    except (OSError, ValueError) as error:
        raise UsageError(f"{shown(table)}: cannot be read ({error})") from None
    outputs = {case: output.with_stem(f"{output.stem}_case{case}") for case in cases}
    if options.output and len(cases) == 1:
        outputs = {cases[0]: output}
    for file in outputs.values():
        for part, kind in list_files(file, options):
            claim(part, kind)
    lines = []
    for case, file in outputs.items():
        with scratch() as folder:
            planner, values, end = find_case(table, metadata, case, folder)
            words, run = planner.make_command(values, end), planner.record(values, end)
        words[2] = tomllib.loads(metadata["dockloop.sweep"])["scene"]
        lines.append(write_files(run, file, options, meshes, shlex.join(words)))
    return "\n".join(lines)


def _choose_cases(
    table: Path, rows: "TableFile", metadata: dict[str, str], options: argparse.Namespace
) -> list[int]:
    """Return the numbers of the cases to show, from 1; columns are read one by one."""
    count = options.not_captured
    if options.cases and count is not None:
        raise UsageError("--case and --not-captured: give one of them")
    for case in options.cases:
        if not 1 <= case <= len(rows):
            raise UsageError(f"--case {case}: {shown(table)} has the cases 1 to {len(rows)}")
        row = rows.read_row(case - 1, ["status", "reason"])
        if row["status"] != "done":
            raise UsageError(f"--case {case}: was not done in {shown(table)} ({row['reason']})")
    if options.cases:
        return list(dict.fromkeys(options.cases))
    if count is not None and not 1 <= count <= _MOST_CASES:
        raise UsageError(f"--not-captured {count}: must be 1 to {_MOST_CASES}")
    worst = tomllib.loads(metadata["dockloop.sweep"]).get("worst", "capture.peak.load_ratio")
    return _find_cases(table, rows, worst if count is None else "outcome", count)


def _find_cases(table: Path, rows: "TableFile", by: str, count: int | None) -> list[int]:
    """Return the case with the largest value of a column, or so many that were not captured."""
    from dockloop.sweeps.table import count_texts, has_captured, is_text, list_worst, read_numbers

    done = count_texts(rows["status"]).get("done", 0)
    if not done:
        raise UsageError(f"{shown(table)}: no case was done, so there is none to show")
    found: list[int] = []
    if by in rows.column_names and count is not None:
        found = np.flatnonzero(has_captured(rows) == 0.0)[:count].tolist()
        if not found:
            raise UsageError(f"{shown(table)}: all {done} cases were captured")
    elif by in rows.column_names and not is_text(rows, by):
        found = list_worst(read_numbers(rows, by), 1)
    if not found:
        raise UsageError(f"{shown(table)}: '{by}' is no column of it, so name a --case")
    return [row + 1 for row in found]


def find_case(
    table: Path, metadata: dict[str, str], case: int, folder: Path
) -> tuple[Planner, tuple[Value, ...], float]:
    """Return the planner of a sweep, the values of a case, and its end [s].

    The sweep, a scene of the user and its mechanisms are written as they were when the table was
    made.
    """
    from dockloop.sweeps.sampling import Passes, read_sweep
    from dockloop.sweeps.table import DIGEST, open_table

    text, named = metadata["dockloop.sweep"], tomllib.loads(metadata["dockloop.sweep"])["scene"]
    file = folder / "sweep.toml"
    file.write_text(text, encoding="utf-8")
    if named.endswith(".toml"):
        scene = folder / named
        if not scene.resolve().is_relative_to(folder.resolve()):
            scene = folder / Path(named).name
            file.write_text(text.replace(named, scene.name), encoding="utf-8")
        scene.parent.mkdir(parents=True, exist_ok=True)
        scene.write_text(metadata["dockloop.scene"], encoding="utf-8")
        for name, content in json.loads(metadata.get("dockloop.mechanisms", "{}")).items():
            mechanism = scene.parent / f"{name}.json"
            if mechanism.resolve().is_relative_to(folder.resolve()):
                mechanism.parent.mkdir(parents=True, exist_ok=True)
                mechanism.write_text(content, encoding="utf-8")
    passes = json.loads(metadata.get("dockloop.passes", "null"))
    sweep = read_sweep(str(file), passes and Passes(**passes))
    try:
        planner = Planner(sweep)
    except UsageError as error:
        raise UsageError(
            f"{shown(table)}: its cases cannot be run again ({error}): run one with its command,"
            " and view that result"
        ) from None
    if planner.digest != metadata.get(DIGEST):
        raise UsageError(
            f"{shown(table)}: was made with another scene, mechanism or dockloop than these: its"
            " cases would not be the same; run the sweep again"
        )
    names = [quantity.name for quantity in sweep.quantities]
    row = open_table(table).read_row(case - 1, [*names, "end_time"])
    return planner, tuple(row[name] for name in names), row["end_time"]
