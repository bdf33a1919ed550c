"""Limits of models and hardware that a docking has passed, from the outputs ``limits.*``.

The table of limits is that of the core (`dockloop.native.core.list_limits`). Each limit is noticed
once, at the first inner step beyond it.
"""

from typing import Any

from dockloop.native.core import list_limits
from dockloop.native.variables import happened
from dockloop.result.recording import Result

EXCEEDED = "limits.exceeded"


def name_exceeded(bits: float) -> str:
    """Return the names of the limits in a value of ``limits.exceeded``: ``"load, overlap"``."""
    names = [limit.name for k, limit in enumerate(list_limits()) if int(bits) >> k & 1]
    return ", ".join(names)


def find_exceeded(run: Result) -> list[dict[str, Any]]:
    """Return name, time [s], value with unit, and sentence of each passed limit, by time.

    A recording without the outputs ``limits.*`` (group phase) gives none.
    """
    found = [
        {
            "name": limit.name,
            "time": float(run[f"limits.{limit.name}.time"][-1]),
            "value": float(run[f"limits.{limit.name}.value"][-1]),
            "unit": limit.unit,
            "sentence": f"{limit.happened}; {limit.means}",
        }
        for limit in list_limits()
        if f"limits.{limit.name}.time" in run and happened(run[f"limits.{limit.name}.time"][-1])
    ]
    return sorted(found, key=lambda row: row["time"])
