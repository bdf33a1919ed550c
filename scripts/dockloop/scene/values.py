"""Values as texts: keys of a scene, settings, accuracies."""

from typing import Any

from dockloop.base.number import to_plain
from dockloop.native.variables import NAMED_NUMBERS


def say_accuracy(accuracy: float) -> str:
    """Return an accuracy by its name, or as a number."""
    names = {number: name for name, number in NAMED_NUMBERS["accuracy"].items()}
    return names.get(int(accuracy), f"{accuracy:g}") if accuracy < 0.0 else f"{accuracy:g}"


def as_setting(name: str, value: Any) -> str:
    """Return ``NAME=VALUE`` for ``--scene`` or ``--set``."""
    return f"{name}={to_text(value)}"


def to_text(value: Any) -> str:
    """Return a value as it is written in TOML and after ``KEY=``, with all digits."""
    value = to_plain(value)
    match value:
        case bool():
            return str(value).lower()
        case str():
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
        case list() | tuple():
            return "[" + ", ".join(map(to_text, value)) + "]"
        case dict():
            return "{" + ", ".join(f"{to_text(k)} = {to_text(v)}" for k, v in value.items()) + "}"
    return repr(value)
