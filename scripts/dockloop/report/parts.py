"""Parts of reports that several commands have: scene, settings, peak loads, figures."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from dockloop.base.sections import FACTS, Section
from dockloop.base.version import list_versions
from dockloop.native.core import name_choice, number_choice
from dockloop.native.variables import VEHICLES
from dockloop.result.peaks import say_place, say_steps


def describe_scene(document: dict, varied: Iterable[str] = ()) -> Section:
    """Say in words what is modelled.

    Args:
        document: the resolved scene.
        varied: names of the quantities that vary.
    """
    text, rows = document["title"], []
    if names := ", ".join(varied):
        text += f". Here with the values of the scene, but varied: {names}."
    for name in VEHICLES:
        if name in document:
            vehicle = document[name]
            rows.append([name, f"{vehicle['motion']}, {vehicle['mass']:g} kg"])
    rows.append(["mechanism", document["mechanism"]["name"]])
    rows.append(["level", document.get("model", {}).get("level", "reduced")])
    initial = document["initial"]
    if initial["at"] == "first_contact":
        lateral, tilt = np.hypot(*initial["lateral"]), np.hypot(*initial["tilt"])
        rows.append(
            [
                "at first contact",
                f"closing at {initial['closing_speed']:g} m/s, {lateral:.3g} m across the docking"
                f" axis, tilted by {np.degrees(tilt):.3g} deg, rolled by"
                f" {np.degrees(initial['roll']):.3g} deg",
            ]
        )
    rated = document["mechanism"].get("limits", {})
    loads = [f"{load} {value:g}" for load, value in rated.items() if isinstance(value, int | float)]
    if loads:
        rows.append(["rated loads", ", ".join(loads) + " (N, N m)"])
    return Section("The scene", text, [FACTS, *rows])


def describe_settings(
    document: dict,
    more: Sequence[list[str]] = (),
    experiment: Mapping[str, Any] = MappingProxyType({}),
) -> Section:
    """List solver, experiment and versions.

    Args:
        document: the resolved scene.
        more: rows that come first.
        experiment: what the experiment has otherwise than the scene.
    """
    solver = {"method": number_choice("solver.method", "auto")} | document["solver"]
    solver["method"] = name_choice("solver.method", solver["method"])
    rows = [[f"solver.{name}", str(value)] for name, value in solver.items()]
    rows += [
        [f"experiment.{name}", str(v)]
        for name, v in {**document["experiment"], **experiment}.items()
    ]
    versions = list_versions("numpy", "scipy", "fmpy")
    rows += [[package, version] for package, version in versions.items() if version]
    return Section("Settings and versions", table=[FACTS, *more, *rows])


def list_peaks(loads: dict, keys: Sequence[str]) -> Iterator[list[Any]]:
    """Yield rows of a table of peak loads: values by `keys`, unit, rated load, part, place.

    The part is that of the rated load, or of the cases above the rated load.
    """
    for name, load in loads.items():
        rated, part = load.get("rated"), load.get("above_rated", load.get("ratio"))
        share = None if rated is None else f"{part:.1%}"
        place = say_steps(load["steps"]) if "steps" in load else say_place(load)
        yield [name, *(load[key] for key in keys), load["unit"], rated, share, place]


def describe_base(planner: Any, more: Sequence[list[str]]) -> list[Section]:
    """Return scene and settings of many dockings."""
    return [
        describe_scene(planner.base, (quantity.name for quantity in planner.varied)),
        describe_settings(planner.base, more, planner.experiment),
    ]


def show_figure(figure: Path) -> Section:
    """Return the section of a figure, named by the last word of its file."""
    return Section(figure.stem.rsplit("_", 1)[-1].capitalize(), figures=[figure])


def say_value(value: Any) -> str:
    """Return a value of a summary as text."""
    match value:
        case None:
            return "never"
        case float():
            return f"{value:.6g}"
        case str():
            return value
    return json.dumps(value)
