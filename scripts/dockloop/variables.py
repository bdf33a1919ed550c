"""Variables of a docking: the rows of the one table that the core makes for a scene."""

from typing import Any, NamedTuple

Value = float | int | bool
TYPES: dict[str, type] = {"Real": float, "Integer": int, "Boolean": bool}
WORDS = {"Real": "a finite number", "Integer": "a whole number", "Boolean": "true or false"}


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
    """Tell whether a Python value is of an FMI type; a whole number is a Real too."""
    kinds = (int, float) if TYPES[type_name] is float else TYPES[type_name]
    return isinstance(value, kinds) and isinstance(value, bool) == (TYPES[type_name] is bool)


def read_variables(docking: Any) -> dict[str, Variable]:
    """Return all variables of a docking of the compiled core (``_core.Docking``), by name."""
    return {row[0]: Variable(*row) for row in docking.variables()}
