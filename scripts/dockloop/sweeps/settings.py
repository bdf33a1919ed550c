"""What a user states next to the scene: settings, ranges, an experiment; from options or Python."""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dockloop.base.errors import UsageError
from dockloop.base.number import check_number, read_if_number, read_number, to_plain
from dockloop.runs.docking import Scene
from dockloop.scene.resolve import parse_value

Range = tuple[str, float, float]  # name, low, high


def parse_setting(option: str, text: str) -> tuple[str, Any]:
    """Return name and value of ``NAME=VALUE``. Raises UsageError naming the option."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not name:
        raise UsageError(f"{option} {text}: must be NAME=VALUE")
    return name, parse_value(value)


def parse_settings(option: str, texts: Iterable[str]) -> dict[str, Any]:
    """Return values by name. Raises UsageError like `parse_setting`."""
    return dict(parse_setting(option, text) for text in texts)


def read_settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return what ``--scene``, ``--set`` and ``--accuracy`` set, by name."""
    settings = parse_settings("--scene", options.overrides) | parse_settings("--set", options.set)
    if options.accuracy is not None:
        settings["accuracy"] = read_if_number(options.accuracy)
    return settings


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


def make_experiment(stop: float | None, step: float | None) -> dict[str, float]:
    """Return what an experiment has otherwise than the scene."""
    given = {"stop": stop, "step": step}
    return {n: check_number(f"--{n}", value) for n, value in given.items() if value is not None}


def name_scene(
    scene: str | Path | Scene | Mapping[str, Any], *settings: Mapping[str, Any] | None
) -> tuple[str, dict[str, Any]]:
    """Return name or path of a scene, and its overrides together with these settings."""
    if isinstance(scene, Mapping):
        scene = Scene(scene)
    merged: dict[str, Any] = {}
    if isinstance(scene, Scene):
        merged |= scene.overrides
        scene = scene.reference
    for members in settings:
        merged |= to_plain(members or {})
    return str(scene), merged
