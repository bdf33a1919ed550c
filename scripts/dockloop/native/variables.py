"""Variables of a docking: the rows of the one table that the core makes for a scene.

A choice is an Integer in the FMU; everywhere else its values have names (`list_names`).
"""

import fnmatch
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.native.core import read_choices

Value = float | int | bool
TYPES: dict[str, type] = {"Real": float, "Integer": int, "Boolean": bool}
VEHICLES = ("chaser", "target")
MOTION = {"position": 3, "velocity": 3, "attitude": 4, "angular_velocity": 3}  # of a body: entries
LOADS = {"force_mean": "force_ext", "torque_mean": "torque_ext"}  # docking -> vehicle, 3 each
NAMED_NUMBERS = {"accuracy": {"real-time": -1}}  # Reals of which some values have names
WORDS = {"Real": "a finite number", "Integer": "a whole number", "Boolean": "true or false"}


NO_TIME = -1.0  # of an event that has not happened, in outputs


def happened(time: Any) -> Any:
    """Return whether a time of an event is one; of an array, which. The start may be negative."""
    return time != NO_TIME


class Variable(NamedTuple):
    """A variable, as modelDescription.xml of the FMU states it.

    Attributes:
        name: structured, ``a.b[1]``.
        type: ``Real``, ``Integer`` or ``Boolean``.
        causality: ``parameter``, ``input``, ``output`` or ``local``.
        variability: ``fixed``, ``tunable``, ``discrete`` or ``continuous``.
        unit: of a Real, SI.
        start: what it is unless it is set; None: it is computed.
        minimum: least value, inclusive.
        maximum: greatest value, inclusive.
        description: one line; for an Integer the meaning of every choice.
    """

    name: str
    type: str
    causality: str
    variability: str
    unit: str
    start: Value | None
    minimum: float
    maximum: float
    description: str


def is_of_type(value: Any, type_name: str) -> bool:
    """Return whether a Python value is of an FMI type; a whole number is a Real too."""
    kinds = (int, float) if TYPES[type_name] is float else TYPES[type_name]
    return isinstance(value, kinds) and isinstance(value, bool) == (TYPES[type_name] is bool)


def read_variables(docking: Any) -> dict[str, Variable]:
    """Return all variables of a docking of the compiled core (``_core.Docking``), by name."""
    return {row[0]: Variable(*row) for row in docking.variables()}


def list_outputs(variables: Mapping[str, Any]) -> list[str]:
    """Return the names of the outputs among variables, of this program or of FMPy."""
    return [name for name, variable in variables.items() if variable.causality == "output"]


def fits(name: str, pattern: str) -> bool:
    """Return whether a name is meant by a pattern: a part of it, or all of it with ``*``."""
    if "*" not in pattern:
        return pattern in name
    literal = pattern.replace("[", "[[]")  # indices are no sets of characters
    return fnmatch.fnmatchcase(name, literal)


def match_names(pattern: str, names: Iterable[str], place: str) -> list[str]:
    """Return the names that are like a name with ``*`` as a whole; without ``*`` the name itself.

    Args:
        pattern: ``element[*].law[1].stiffness``, where ``*`` stands for anything.
        names: what it can mean.
        place: begins the message.

    Raises:
        UsageError: no name is like that.
    """
    if "*" not in pattern:
        return [pattern]
    known = list(names)
    found = [name for name in known if fits(name, pattern)]
    if not found:
        near = did_you_mean(_put_index(pattern, "[*]"), (_put_index(n, "[*]") for n in known))
        near = near or _find_near_part(pattern, known)
        raise UsageError(f"{place}: no name that can be set is like '{pattern}'{near}")
    return found


def _put_index(name: str, index: str) -> str:
    """Return a name with the same index everywhere: ``[*]``, or none."""
    return re.sub(r"\[[^\]]*\]", index, name)


def _find_near_part(pattern: str, names: list[str]) -> str:
    """Suggest parts of names near to the first part of a pattern that no name has."""

    def list_parts(name: str) -> list[str]:
        return _put_index(name, "").split(".")

    known = dict.fromkeys(part for name in names for part in list_parts(name))
    odd = (part for part in list_parts(pattern) if "*" not in part and part not in known)
    return did_you_mean(next(odd, ""), known)


def say_matches(setting: str, count: int) -> str:
    """Say how many names a setting with ``*`` has set."""
    return f"{setting}: {count} name{'s' * (count != 1)} set"


def list_names(variable: str, description: str) -> dict[str, int]:
    """Return the numbers of the values of a variable by their names; none if it has no names.

    Args:
        variable: its name.
        description: of the variable; values that this FMU does not carry are not in it.
    """
    if variable in NAMED_NUMBERS:
        return NAMED_NUMBERS[variable]
    values = read_choices().get(variable, ())
    return {v.name: v.number for v in values if f"{v.number} {v.name}" in description}


def find_number(variable: str, description: str, text: str) -> int:
    """Return the number of a value of a choice; arguments as for `list_names`.

    A value that this FMU does not carry has its number too: the core refuses that with the reason.

    Raises:
        UsageError: there is no value of this name. The sentence continues one that ends in a colon.
    """
    names = list_names(variable, description)
    numbers = {v.name: v.number for v in read_choices().get(variable, ())} | names
    if text not in numbers:
        near = did_you_mean(text, names)
        if variable in NAMED_NUMBERS:
            raise UsageError(
                f"'{variable}' is '{text}': must be a number or {', '.join(names)}{near}"
            )
        raise UsageError(f"'{variable}' is '{text}': must be one of {', '.join(names)}{near}")
    return numbers[text]
