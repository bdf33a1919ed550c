"""Values as texts: keys of a scene, settings, accuracies."""

import json
import re
from collections.abc import Mapping
from datetime import date, time
from typing import Any

from dockloop.base.errors import UsageError
from dockloop.base.number import is_number, to_plain
from dockloop.native.variables import NAMED_NUMBERS

_SURROGATE = re.compile("[\ud800-\udfff]")


def say_accuracy(accuracy: float) -> str:
    """Return an accuracy by its name, or as a number."""
    names = {number: name for name, number in NAMED_NUMBERS["accuracy"].items()}
    return names.get(int(accuracy), f"{accuracy:g}") if accuracy < 0.0 else f"{accuracy:g}"


def as_setting(name: str, value: Any) -> str:
    """Return ``NAME=VALUE`` for ``--scene`` or ``--set``. Raises UsageError: the value is none."""
    try:
        return f"{name}={to_text(value)}"
    except UsageError as error:
        raise UsageError(f"{name}: {error}") from None


def list_settings(option: str, settings: Mapping[str, Any]) -> list[str]:
    """Return the words of a command that set these values by name."""
    return [word for pair in settings.items() for word in (option, as_setting(*pair))]


def to_text(value: Any) -> str:
    """Return a value as it is written in TOML and after ``KEY=``, with all digits.

    Raises UsageError: it is none.
    """
    value = to_plain(value)
    match value:
        case bool():
            return str(value).lower()
        case str() if value.isascii() or not _SURROGATE.search(value):
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case list() | tuple():
            return "[" + ", ".join(map(to_text, value)) + "]"
        case Mapping():
            return "{" + ", ".join(f"{to_text(k)} = {to_text(v)}" for k, v in value.items()) + "}"
        case date() | time():
            return value.isoformat()
        case _ if is_number(value):
            return repr(value if isinstance(value, int | float) else float(value))
    kind = "a text without Unicode" if isinstance(value, str) else f"of type {type(value).__name__}"
    raise UsageError(f"a value is {kind}: must be a number, a text, a list or a group of these")
