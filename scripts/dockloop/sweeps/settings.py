"""What a user states next to the scene: settings, ranges, an experiment; from options or Python."""

import argparse
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dockloop.base.errors import UsageError
from dockloop.base.number import check_number, read_if_number, read_number, to_plain
from dockloop.runs.docking import Scene
from dockloop.scene.resolve import parse_value
from dockloop.scene.values import as_setting

Range = tuple[str, float, float]  # name, low, high


class Settings(dict[str, Any]):
    """Values by name.

    Attributes:
        given_by: with what messages about them begin, by name: the option as it was typed.
    """

    def __init__(
        self, values: Mapping[str, Any] | None = None, given_by: Mapping[str, str] | None = None
    ) -> None:
        super().__init__(values or {})
        self.given_by = dict(given_by or {})

    def __or__(self, other: Any) -> "Settings":  # type: ignore[override]  # narrower
        """Return these and others, which hold where both have a name."""
        kept = {name: begin for name, begin in self.given_by.items() if name not in other}
        return Settings({**self, **other}, kept | getattr(other, "given_by", {}))

    def without(self, names: Collection[str]) -> "Settings":
        """Return those of other names."""
        return Settings({n: v for n, v in self.items() if n not in names}, self.given_by)


def parse_setting(option: str, text: str) -> tuple[str, Any]:
    """Return name and value of ``NAME=VALUE``. Raises UsageError naming the option."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not name:
        raise UsageError(f"{option} {text}: must be NAME=VALUE")
    return name, parse_value(value)


def parse_settings(option: str, texts: Iterable[str]) -> Settings:
    """Return values by name. Raises UsageError like `parse_setting`."""
    settings = Settings()
    for text in texts:  # the last one of a name holds
        name, value = parse_setting(option, text)
        settings = settings | Settings({name: value}, {name: f"{option} {text}"})
    return settings


def read_settings(options: argparse.Namespace) -> Settings:
    """Return what ``--scene``, ``--set`` and ``--accuracy`` set, by name."""
    settings = parse_settings("--scene", options.overrides) | parse_settings("--set", options.set)
    if options.accuracy is not None:
        return settings | give_accuracy(options.accuracy)
    return settings


def give_accuracy(accuracy: float | str) -> Settings:
    """Return what ``--accuracy`` sets."""
    value = read_if_number(accuracy) if isinstance(accuracy, str) else accuracy
    return Settings({"accuracy": value}, {"accuracy": f"--accuracy {accuracy}"})


def parse_range(option: str, given: Sequence[str]) -> Range:
    """Parse ``NAME LOW HIGH``. Raises UsageError."""
    name, *ends = given
    try:
        low, high = map(read_number, ends)
    except ValueError:
        raise UsageError(
            f"{option} {' '.join(given)}: must be NAME LOW HIGH, two numbers"
        ) from None
    return name, low, high


def say_range(option: str, name: str, low: float, high: float) -> str:
    """Return ``OPTION NAME LOW HIGH`` as it may have been typed."""
    return f"{option} {name} {low:g} {high:g}"


def make_experiment(stop: float | None, step: float | None) -> dict[str, float]:
    """Return what an experiment has otherwise than the scene."""
    given = {"stop": stop, "step": step}
    return {n: check_number(f"--{n}", value) for n, value in given.items() if value is not None}


def name_scene(
    scene: str | Path | Scene | Mapping[str, Any],
    overrides: Mapping[str, Any] | None,
    start_values: Mapping[str, Any] | None,
) -> tuple[str, Settings]:
    """Return name or path of a scene, and its overrides together with these settings."""
    if isinstance(scene, Mapping):
        scene = Scene(scene)
    given = [("--scene", overrides), ("--set", start_values)]
    if isinstance(scene, Scene):
        given.insert(0, ("--scene", scene.overrides))
        scene = scene.reference
    merged = Settings()
    for option, members in given:
        values = to_plain(members or {})
        merged = merged | Settings(
            values, {n: f"{option} {as_setting(n, v)}" for n, v in values.items()}
        )
    return str(scene), merged
