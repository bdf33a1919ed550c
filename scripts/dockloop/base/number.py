"""What a number is, in texts and in Python: the one reader of numbers.

In options, settings and tables a number is decimal, perhaps with an exponent: ``-1.5e-3``. In
Python it is an ``int``, a ``float`` or a scalar of numpy. Texts and booleans are no numbers. Files
are TOML or JSON, with the grammars of these.
"""

import math
import re
from numbers import Integral, Real
from typing import Any

from dockloop.base.errors import UsageError

_WHOLE = re.compile(r"[+-]?[0-9]+")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


def read_number(text: str) -> float:
    """Return the finite number that a text is. Raises ValueError: it is none."""
    number = float(text) if _NUMBER.fullmatch(text.strip()) else math.nan
    if not math.isfinite(number):
        raise ValueError(text)
    return number


def read_whole(text: str) -> int:
    """Return the whole number that a text is. Raises ValueError: it is none."""
    if not _WHOLE.fullmatch(text.strip()):
        raise ValueError(text)
    return int(text)


def read_if_number(text: str) -> float | str:
    """Return the finite number that a text is, or else the text."""
    try:
        return read_number(text)
    except ValueError:
        return text


def is_number(value: Any) -> bool:
    """Return whether a value of Python is a number, perhaps one that is not finite."""
    return isinstance(value, Real) and not isinstance(value, bool)


def as_number(value: Any) -> float:
    """Return a number; infinity for a whole one that is too large, NaN for what is none."""
    try:
        return float(value) if is_number(value) else math.nan
    except OverflowError:
        return math.inf


def check_number(place: str, value: Any) -> float:
    """Return a finite number; `place` names it. Raises UsageError: the value is none."""
    number = as_number(value)
    if not math.isfinite(number):
        shown = number if is_number(value) else repr(value)
        raise UsageError(f"{place} {shown}: must be a finite number")
    return number


def to_plain(value: Any) -> Any:
    """Return numbers and arrays of numpy, in groups and lists too, as those of Python."""
    if isinstance(value, dict):
        return {name: to_plain(member) for name, member in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(entry) for entry in value]
    return value.tolist() if hasattr(value, "tolist") else value


def check_whole(place: str, value: Any, least: int, most: int | None = None) -> int:
    """Return a whole number within limits; `place` names it. Raises UsageError: it is none."""
    if not (is_number(value) and isinstance(value, Integral)):
        raise UsageError(f"{place} {value!r}: must be a whole number")
    number = int(value)
    if number < least or (most is not None and number > most):
        limits = f"at least {least}" if most is None else f"{least} to {most}"
        raise UsageError(f"{place} {number}: must be {limits}")
    return number


def say_number(value: float) -> str:
    """Return a number with four digits; loads and masses need no exponent."""
    return f"{value:.0f}" if 9999.5 <= abs(value) < 1e7 else f"{value:.4g}"
