"""Units that people and tools write, and their size in the units of variables.

``pint`` knows the units. Three things differ from its rules. Units of FMI have no operators
(``kg.m2``, ``N.m``). ``Nm`` is a newton metre, and ``g`` an acceleration where one is expected. An
angle is no plain number: ``Hz`` is not ``rad/s``, and ``%`` no angle.
"""

import re
from functools import cache
from typing import Any

_ALLOWED = re.compile(r"[\w°%*/^ ()-]{1,40}")
_OTHER_LETTERS = str.maketrans("\u00ba\u2212\u207b\u00b9\u00b2\u00b3", "°--123")
_RAISED = re.compile(r"[\d)]\s*(\*\*|\^)")  # a number that is raised has no end


@cache
def _make_registry() -> Any:
    import pint

    return pint.UnitRegistry()


@cache
def _find_size(text: str) -> tuple[float, Any] | None:
    """Return the size of a unit in SI units, radians among them, and these; None: no unit."""
    text = text.strip().rstrip(".").translate(_OTHER_LETTERS)
    text = re.sub(
        r"\b((?:[kMm]|da)?N)([cm]?m)(s?)\b", r"\1 \2 \3", text
    ).strip()  # no number of yarn
    text = re.sub(r"\brev\b", "turn", text)
    text = re.sub(r"(?<=\w)\s*[.·⋅∙-]\s*(?=[^\W\d])", "*", text)  # N.m, ft-lbf
    text = re.sub(r"(?<=[^\W\d_])\^?(-?\d)", r"**\1", text)  # m2, s-1
    text = "dimensionless" if text in ("", "-", "1") else text
    is_open = re.search(r"\btons?\b", text)  # of 1000 kg, or of 2000 lb
    if is_open or not _ALLOWED.fullmatch(text) or _RAISED.search(text):
        return None
    registry = _make_registry()
    try:
        size = registry.Quantity(1.0, registry.parse_units(text)).to_base_units()
    except Exception:  # noqa: BLE001  undefined, no multiple of a unit, no unit: a dozen kinds
        return None
    return float(size.magnitude), size.units


def is_unit(text: str) -> bool:
    """Return whether a text is a unit; an empty one and ``-`` mean a plain number."""
    return _find_size(text) is not None


def find_factor(unit: str, expected: str) -> float | None:
    """Return the size of a unit in another one; None: it is no unit of this kind.

    Args:
        unit: as it is written, for example ``kN``, ``deg/s``, ``ft-lbf``, ``%``.
        expected: unit of a variable, for example ``N.m``. A variable in ``1`` takes all units: the
            size is that in SI units.
    """
    found, own = _find_size(unit), _find_size(expected)
    if unit in ("g", "G", "gn", "g0") and own == _find_size("m/s2"):
        found = _find_size("standard_gravity")
    if found is None or own is None:
        return None
    if own[1] == found[1] or expected in ("", "1"):
        return found[0] / own[0]
    return None
