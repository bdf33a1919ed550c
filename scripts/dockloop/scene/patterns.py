"""Patterns of a mechanism file: parts that stand round the docking axis, written once.

A pattern has a count, the azimuth of its first copy and the parts that are repeated. A ``#`` in a
text of a part becomes the number of the copy. Points and directions are turned about x; with
``mirror`` a twin follows each copy, reflected in the plane of x and the azimuth of the copy.
Anywhere in a mechanism, a point may be given by x, radius and azimuth.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from dockloop.base.errors import UsageError
from dockloop.base.paths import shown

_NUMBER = "#"
_LISTS: dict[str, tuple[str, ...]] = {  # parts of a pattern, and the lists that they join
    "legs": ("legs",),
    "forces": ("forces",),
    "couplings": ("couplings",),
    "active": ("contact", "active"),
    "passive": ("contact", "passive"),
    "latches": ("latches", "list"),
}
_GROUPS = {  # what a list belongs to: the condition, and how to meet it
    "contact": (
        lambda contact: contact.get("type") == "surfaces",
        "needs a contact of type 'surfaces' in the mechanism",
    ),
    "latches": (
        lambda latches: "count" not in latches,
        "needs latches with a 'list', not with a 'count'",
    ),
}
_POINTS = ("root_point", "closing_point", "hook", "striker", "position", "points", "corners")
_DIRECTIONS = ("reference_axis",)
_AXES = ("axis", "first_axis")  # of turns: a reflection also reverses them
Vector = list[float]


class _Turn(NamedTuple):
    """Where a copy stands.

    Attributes:
        azimuth: about x, from y to z [deg].
        is_twin: reflected in the plane of x and the azimuth.
    """

    azimuth: float
    is_twin: bool

    def turn(self, vector: Vector) -> Vector:
        """Return the vector of a copy."""
        x, y, z = vector
        c, s = _find_turn(self.azimuth)
        z = -z if self.is_twin else z
        return [x, c * y - s * z, s * y + c * z]

    def turn_axis(self, axis: Vector) -> Vector:
        """Return the axis of a turn of a copy."""
        return self.turn([-a for a in axis] if self.is_twin else axis)

    def place(self, point: Any) -> Vector:
        """Return a point of a copy, from coordinates or from x, radius and azimuth."""
        if isinstance(point, list):
            return self.turn(point)
        own = -point["azimuth_deg"] if self.is_twin else point["azimuth_deg"]
        c, s = _find_turn(own + self.azimuth)
        return [point["x"], point["radius"] * c, point["radius"] * s]


_AS_WRITTEN = _Turn(0.0, is_twin=False)


def _find_turn(degrees: float) -> tuple[float, float]:
    """Return cosine and sine, exact at multiples of 90 degrees."""
    quarter = round(degrees / 90.0)
    angle = math.radians(degrees - 90.0 * quarter)
    c, s = math.cos(angle), math.sin(angle)
    return ((c, s), (-s, c), (-c, -s), (s, -c))[quarter % 4]


def open_lists(mechanism: dict) -> None:
    """Add the lists that only patterns fill, before a schema asks for them.

    A list of single latches is short for a group with this list.
    """
    if isinstance(mechanism.get("latches"), list):
        mechanism["latches"] = {"list": mechanism["latches"]}
    patterns = mechanism.get("patterns")
    for pattern in patterns if isinstance(patterns, list) else ():
        for part in (name for name in _LISTS if isinstance(pattern, dict) and name in pattern):
            *groups, last = _LISTS[part]
            node = mechanism.get(groups[0]) if groups else None
            if isinstance(node, dict) and _GROUPS[groups[0]][0](node):
                node.setdefault(last, [])


def expand_patterns(mechanism: dict, source: Path) -> None:
    """Write out the patterns of a mechanism, and its points that are not coordinates.

    Args:
        mechanism: one that its schema accepts, modified in place.
        source: its file, for messages.

    Raises:
        UsageError: naming the pattern, the part and what is wrong.
    """
    for number, pattern in enumerate(mechanism.pop("patterns", []), 1):
        place = f"{shown(source)}: patterns[{number}]"
        turns = list(_list_turns(pattern, place))
        for part in (name for name in _LISTS if name in pattern):
            joined = _find_list(mechanism, part, f"{place}.{part}")
            for copy, turn in enumerate(turns, 1):
                for entry in pattern[part]:
                    if len(turns) > 1 and _NUMBER not in entry.get("name", _NUMBER):
                        raise UsageError(
                            f"{place}.{part}: the name '{entry['name']}' would be there"
                            f" {len(turns)} times: must have a {_NUMBER}, the number of the copy"
                        )
                    joined.append(_copy(entry, turn, str(copy)))
    for path in _LISTS.values():
        for entry in _find_entries(mechanism, path):
            put = _each(_AS_WRITTEN.place, only=dict)
            _change(entry, _POINTS, put)
            if isinstance(axes := entry.get("axis"), dict):
                _change(axes, _POINTS, put)
    if "leg_defaults" in mechanism:
        _change(mechanism["leg_defaults"], _POINTS, _each(_AS_WRITTEN.place, only=dict))


def _list_turns(pattern: dict, place: str) -> Iterator[_Turn]:
    """Yield where the copies stand."""
    count, given = int(pattern["count"]), pattern.get("azimuth_deg", 0.0)
    if isinstance(given, list) and len(given) != count:
        raise UsageError(
            f"{place}.azimuth_deg has {len(given)} numbers: must be one number, of the first copy,"
            f" or one for each of the {count} copies"
        )
    azimuths = (
        given if isinstance(given, list) else [given + 360.0 * i / count for i in range(count)]
    )
    for azimuth in azimuths:
        yield _Turn(azimuth, is_twin=False)
        if pattern.get("mirror", False):
            yield _Turn(azimuth, is_twin=True)


def _find_list(mechanism: dict, part: str, place: str) -> list:
    """Return the list that a part joins. Raises UsageError: the mechanism has other hardware."""
    *groups, last = _LISTS[part]
    node = mechanism
    for group in groups:
        node = node.setdefault(group, {})
        is_met, sentence = _GROUPS[group]
        if not is_met(node):
            raise UsageError(f"{place}: {sentence}")
    return node.setdefault(last, [])


def _find_entries(mechanism: dict, path: tuple[str, ...]) -> list[dict]:
    node: Any = mechanism
    for name in path:
        node = node.get(name, {})
    return node if isinstance(node, list) else []


def _copy(entry: dict, turn: _Turn, number: str) -> dict:
    """Return a part at another place, with another number."""
    copy = _rename(entry, number)
    if "body" in copy:  # a core in axes of its body, which stands at the other place
        return copy
    _change(copy, _POINTS, _each(turn.place))
    _change(copy, _DIRECTIONS, turn.turn)
    _change(copy, _AXES, lambda axis: turn.turn_axis(axis) if isinstance(axis, list) else axis)
    if "gear" in copy:
        _change(copy["gear"], _AXES, turn.turn_axis)
    if isinstance(axes := copy.get("axis"), dict):  # of a surface of revolution
        _change(axes, _POINTS, turn.place)
        _turn_frame(axes, turn)
    if turn.is_twin and "edges" in copy:
        copy["edges"] = sorted(5 - edge for edge in copy["edges"])
    if turn.is_twin and "corners" in copy:  # in the same sense about the plate
        first, *others = copy["corners"]
        copy["corners"] = [first, *reversed(others)]
    if copy.get("kind") == "nodes":
        own = copy.get("azimuth_offset_deg", 0.0)
        copy["azimuth_offset_deg"] = turn.azimuth + (-own if turn.is_twin else own)
    return copy


def _turn_frame(axes: dict, turn: _Turn) -> None:
    """Turn the axes of a profile, which stay right-handed: the profile is round about x."""
    columns = [[float(i == j) for i in range(3)] for j in range(3)]
    if "rotation" in axes:
        columns = [list(column) for column in zip(*axes["rotation"], strict=True)]
    turned = [turn.turn(column) for column in columns]
    if turn.is_twin:
        turned[2] = [-c for c in turned[2]]
    axes["rotation"] = [list(row) for row in zip(*turned, strict=True)]


def _rename(node: Any, number: str) -> Any:
    """Return a copy of nested groups with the number of a copy in all texts."""
    if isinstance(node, str):
        return node.replace(_NUMBER, number)
    if isinstance(node, list):
        return [_rename(child, number) for child in node]
    if isinstance(node, dict):
        return {key: _rename(child, number) for key, child in node.items()}
    return node


def _change(entry: dict, names: tuple[str, ...], change: Callable[[Any], Any]) -> None:
    for name in names:
        if name in entry:
            entry[name] = change(entry[name])


def _each(change: Callable[[Any], Vector], only: type | None = None) -> Callable[[Any], Any]:
    """Return what changes a point, or each of a list of points; `only` those of a type."""

    def apply(value: Any) -> Any:
        if isinstance(value, list) and value and not isinstance(value[0], int | float):
            return [apply(point) for point in value]
        return change(value) if only is None or isinstance(value, only) else value

    return apply
