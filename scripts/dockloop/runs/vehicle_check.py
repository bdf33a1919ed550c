"""``dockloop check SCENE.toml``: parts, modes and adapters of the vehicles of a scene.

The scene is started, so what cannot be is refused. Frequencies are those of the equations: poles of
the vehicle with one part, from exact derivatives.
"""

from collections.abc import Iterator, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

from dockloop.base.sections import Section
from dockloop.native.variables import VEHICLES
from dockloop.runs.docking import Docking, Scene
from dockloop.runs.linear import linearise

_HELD = 1e9  # times the mass and inertia: such a vehicle does not move


def check_vehicles(scene: str | Path | Scene | Mapping[str, Any]) -> dict[str, list[dict]]:
    """Start a scene, and list the parts of its vehicles.

    Args:
        scene: as for `Docking`.

    Returns:
        ``parts``: per oscillation of a part ``part``, ``on``, ``mass`` [kg] (of modes: None),
        ``held_Hz`` with the vehicle held, ``free_Hz`` on the free vehicle with this part alone, and
        ``damping_ratio`` (held). A part that does not oscillate has None for these.

    Raises:
        UsageError: naming file, member, value and limit.
        DockloopError: the scene cannot start.
    """
    read = Docking(scene).scene
    rows = []
    for vehicle in VEHICLES:
        for name, member, part in _list_parts(read.document.get(vehicle, {})):
            held, free = (
                _find_oscillations(read.document[vehicle], member, part, times)
                for times in (_HELD, 1.0)
            )
            mass = part[0].get("mass") if member == "part" else part.get("mass")
            place = {"part": f"{vehicle}.{name}", "on": vehicle, "mass": mass}
            numbers: list[dict[str, float | None]] = [
                {"held_Hz": at_rest[0], "free_Hz": alone[0], "damping_ratio": at_rest[1]}
                for at_rest, alone in zip_longest(held, free, fillvalue=(None, None))
            ]
            none = dict.fromkeys(("held_Hz", "free_Hz", "damping_ratio"))
            rows += [place | each for each in numbers or [none]]
    return {"parts": rows}


def report_vehicles(report: dict) -> list[Section]:
    """Return what `check_vehicles` found, for people."""
    heads = {"part": "part", "on": "hangs on", "mass": "mass [kg]"}
    heads |= {"held_Hz": "vehicle held [Hz]", "damping_ratio": "damping [1]"}
    heads |= {"free_Hz": "vehicle free, this part alone [Hz]"}
    rows = [[row[key] for key in heads] for row in report["parts"]]
    text = "" if rows else "Its vehicles are rigid."
    return [Section("The scene starts", text, [[*heads.values()], *rows])]


def _list_parts(vehicle: dict) -> Iterator[tuple[str, str, Any]]:
    """Yield name, member of the scene and what that member would be with this part alone."""
    for number, part in enumerate(vehicle.get("part", ()), 1):
        yield f"part[{number}]", "part", [part]
    modes = vehicle.get("modes", {})
    for k in range(len(modes.get("frequency", ()))):
        mode = {
            key: [value[k]] if key != "point" and isinstance(value, list) else value
            for key, value in modes.items()
        }
        yield f"modes[{k + 1}]", "modes", mode
    if adapter := vehicle.get("adapter"):
        yield "adapter", "adapter", adapter


def _find_oscillations(
    vehicle: dict, member: str, part: Any, times: float
) -> list[tuple[float, float]]:
    """Return frequencies [Hz] and damping ratios of a vehicle with one part, fastest first."""
    still = [
        {key: value for key, value in each.items() if key not in ("coordinate", "rate")}
        for each in (part if member == "part" else [part])
    ]
    body = {"mass": times * vehicle["mass"], "inertia": [times * i for i in vehicle["inertia"]]}
    alone = {"chaser": body | {member: still if member == "part" else still[0]}}
    return linearise(alone, 0.0).oscillations
