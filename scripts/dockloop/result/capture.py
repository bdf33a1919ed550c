"""Why a docking was captured or not: one sentence from the outputs at its end.

The FMU says which kind of reason it is (``capture.reason``). Which latch, which petal, and by how
much follows from the outputs of latches and petals.
"""

import math
import re
from collections.abc import Iterable, Mapping

from dockloop.native.core import name_choice
from dockloop.native.variables import NO_TIME, happened

_NEEDED = re.compile(
    r"capture\.(reason|seated_time)|time_of_capture|outcome|latched\[\d+\]"
    r"|latch\[\d+\]\.(opening|lateral|window)|contact\.petal\[\d+\]\.force"
)
AFTER_CAPTURE = ("docked", "undocked")  # outcomes of a sequence that has released the latches
WITH_CAPTURE = ("captured", *AFTER_CAPTURE)


def list_needed(names: Iterable[str]) -> list[str]:
    """Return the variables of an FMU that `explain_capture` looks at; none without a reason."""
    needed = [name for name in names if _NEEDED.fullmatch(name)]
    return needed if "capture.reason" in needed else []


def explain_capture(values: Mapping[str, float]) -> str | None:
    """Say in one sentence why a docking was captured or not.

    Args:
        values: outputs at the end and parameters, at least those of `list_needed`.

    Returns:
        The sentence, without a full stop; None if the FMU gives no reason.
    """
    if "capture.reason" not in values:
        return None
    outcome = name_choice("outcome", values["outcome"]) if "outcome" in values else ""
    capture = values.get("time_of_capture", NO_TIME)
    if outcome in AFTER_CAPTURE and happened(capture):
        return f"captured at {capture:.3f} s, then {outcome}"
    held = _list(values, "latched[{}]")
    some = f"with {sum(map(bool, held))} of {len(held)} latches held" if any(held) else ""
    free = [i for i, holds in enumerate(held) if not holds]
    widest = _name_widest(values, free)
    why = {
        "none": ["captured"],
        "no contact": ["not captured: no contact so far"],
        "in motion": ["not captured yet: has touched and is still moving", some, widest],
        "beside window": _describe_seat(values, free, some),
        "hung up": [f"not captured: hung up{_name_petal(values)}", some, widest],
        "too slow": ["not captured: too slow to close, at rest before the latches", some, widest],
        "rebound": ["not captured: rebounded", some],
        "miss": ["not captured: missed"],
    }
    reason = name_choice("capture.reason", values["capture.reason"])
    parts = [part for part in why[reason] if part]
    if happened(capture) and reason != "none":
        parts.insert(0, f"captured at {capture:.3f} s, but latches let go again")
    return ", ".join(parts)


def _list(values: Mapping[str, float], pattern: str) -> list[float]:
    """Return the values of ``name[1]``, ``name[2]``, ... as far as there are some."""
    found: list[float] = []
    while (name := pattern.format(len(found) + 1)) in values:
        found.append(values[name])
    return found


def _describe_seat(values: Mapping[str, float], free: list[int], some: str) -> list[str]:
    """Say for how long the rings were seated, and which striker stands furthest outside."""
    laterals = _list(values, "latch[{}].lateral")
    parts = [f"not captured: seated for {values.get('capture.seated_time', 0.0):.1f} s", some]
    excess = {i: laterals[i] - _find_window(values, i) for i in free if i < len(laterals)}
    worst = max(excess, key=excess.__getitem__, default=0)
    if excess and excess[worst] <= 0.0:
        parts.append(f"latch {worst + 1} is within its window but does not catch again")
    elif excess:
        parts.append(f"latch {worst + 1} stands {1e3 * excess[worst]:.1f} mm outside its window")
    return parts


def _find_window(values: Mapping[str, float], i: int) -> float:
    """Return the lateral window of latch i, counted from 0 [m]; an older FMU does not have it."""
    return values.get(f"latch[{i + 1}].window", math.inf)


def _name_petal(values: Mapping[str, float]) -> str:
    """Name the petal that carries most."""
    forces = _list(values, "contact.petal[{}].force")
    return f" on petal {forces.index(max(forces)) + 1}" if any(forces) else ""


def _name_widest(values: Mapping[str, float], free: list[int]) -> str:
    """Name the latch without a striker that is open most, and how far away it is."""
    openings = _list(values, "latch[{}].opening")
    known = [i for i in free if i < len(openings)]
    if not known:
        return ""
    widest = max(known, key=openings.__getitem__)
    text = f"latch {widest + 1} is {1e3 * openings[widest]:.1f} mm open"
    lateral = values.get(f"latch[{widest + 1}].lateral", 0.0)
    excess = lateral - _find_window(values, widest)
    return text + (f" and {1e3 * excess:.1f} mm outside its window" if excess > 0.0 else "")
