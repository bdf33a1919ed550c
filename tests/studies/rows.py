"""Rows of a study that are kept in a file as they arrive: `measure_rows`."""

import json
from collections.abc import Callable, Sequence
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any

from dockloop.base.progress import ProgressBar

Row = dict[str, Any]


def read_rows(path: Path | None, numbers: Sequence[int]) -> dict[int, Row]:
    """Return the rows that a file holds, by number; none without a file."""
    if path is None or not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {row["number"]: row for row in rows if row["number"] in numbers}


def measure_rows(
    measure: Callable[[int], Row],
    numbers: Sequence[int],
    path: Path | None,
    workers: int,
    label: str,
) -> list[Row]:
    """Measure the rows of some numbers that a file does not hold yet.

    Args:
        measure: returns the row of a number, which holds it as ``number``.
        numbers: of the rows.
        path: of the file: the same command goes on after an interruption. None: nothing is kept.
        workers: processes.
        label: of the progress bar.

    Returns:
        The rows, in the order of the numbers.
    """
    rows = read_rows(path, numbers)
    missing = [number for number in numbers if number not in rows]
    report = ProgressBar(label)
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
    with Pool(workers) as pool:
        for row in pool.imap_unordered(measure, missing):
            if path:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
            rows[row["number"]] = row
            report(len(rows) / len(numbers))
    return [rows[number] for number in numbers]
