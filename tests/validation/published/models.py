"""Scenes of the cases: shipped mechanisms reduced to one axis, and small ones made for a formula.

A scene is two files in a folder that is deleted when the docking was made.
"""

import json
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import dockloop as dl
from dockloop.base import paths
from dockloop.scene.values import to_text

AXIS_GROUPS = ("relative", "capture", "phase", "ring", "legs", "energy", "solver")


def read_shipped(name: str) -> dict:
    """Return a shipped mechanism without sequence, hard dock and failures.

    These name parts that cases change.
    """
    mechanism = json.loads((paths.MECHANISMS / f"{name}.json").read_text(encoding="utf-8"))
    for member in ("failures", "sequence", "interface"):
        mechanism.pop(member, None)
    return mechanism


def read_mechanism(name: str) -> dict:
    """Return a shipped mechanism for an impact alone: its ring at home stands in A."""
    mechanism = read_shipped(name)
    on_base = [body["joint"] for body in mechanism["bodies"] if body["parent"] == "base"]
    stroke = next((j["position"][0] for j in on_base if j["type"] == "free" and "position" in j), 0)
    for joint in on_base:
        if "position" in joint:
            joint["position"][0] -= stroke
    return mechanism


def make_scene(
    mechanism: dict,
    *,
    chaser: Mapping[str, Any],
    target: Mapping[str, Any],
    initial: Mapping[str, Any] | None = None,
    groups: Sequence[str] = AXIS_GROUPS,
) -> dl.Scene:
    """Return a scene with its own mechanism; members of vehicles that are missing do not matter."""
    vehicle = {"mass": 1e4, "inertia": [1e5, 1e5, 1e5, 0, 0, 0]}
    sections = {
        "chaser": vehicle | dict(chaser),
        "target": vehicle | dict(target),
        "mechanism": {"name": "own"},
        "initial": dict(initial or {}),
        "experiment": {"stop": 1.0, "step": 0.01},
        "outputs": {"groups": list(groups)},
    }
    lines = ['title = "case of tests/validation/published"']
    for section, members in sections.items():
        lines += [f"[{section}]", *(f"{key} = {to_text(v)}" for key, v in members.items())]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "own.json").write_text(json.dumps(mechanism | {"name": "own"}), encoding="utf-8")
        (folder / "own.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
        return dl.Scene(folder / "own.toml")


# ------------------------------------------------ the differential unit, reduced to its axis

SCREW = 2.0 * math.pi / 0.016  # turn of a nut per travel of its rod [1/m], of the shipped apda
FRONT = 60.0 + 6 * 1.5 + SCREW**2 * (6 * 4e-5 + 3 * 5e-5)  # ring, rods, nuts, shafts of sums [kg]


def make_axial_unit(
    front: float,
    behind: float,
    drive: Sequence[dict],
    contact: dict | None = None,
    ratio: float = 1.0,
) -> dict:
    """Return the shipped `apda` with rods along the axis, so that formulas of one axis hold.

    Bodies, screws, differentials and couplings are those of the file. Changed are the directions
    of the rods, the sizes of the masses, the laws of the drive, and the contact.

    Args:
        front: mass of all that moves in front of the drive, referred to the axis [kg].
        behind: mass of the drive referred to the axis at ratio 1 [kg].
        drive: laws of the drive shaft, in figures of the travel of the rods.
        contact: `contact` member; without one nothing touches.
        ratio: of a gear in front of the drive; the mass behind it grows with its square.
    """
    unit = read_mechanism("apda")
    cuts = {loop["name"]: loop["cut"] for loop in unit["loops"]}
    for body in unit["bodies"]:
        if body["name"].endswith("_cross"):
            cut = cuts[body["name"].removesuffix("_cross")]
            x, y, z = cut["point_on_closing"]
            body["joint"]["position"] = [x - cut["point_on_terminal"][0], y, z]
            del body["joint"]["rotation"]
        size = front / FRONT
        if body["name"] == "drive":
            size = behind / (SCREW**2 * body["inertia"][0][0])
        if "mass" in body:
            body["mass"] *= size
        if "inertia" in body:
            body["inertia"] = [[size * value for value in row] for row in body["inertia"]]
    for coupling in unit["couplings"]:
        if coupling["name"] == "drive":
            coupling["terms"] = [t | {"ratio": ratio * t["ratio"]} for t in coupling["terms"]]
        if coupling["name"].startswith("tilt"):
            coupling["terms"][1]["ratio"] /= ratio
    for force in unit["forces"]:
        if force["name"] == "drive":
            force["along"][0]["ratio"] /= ratio
            force["laws"] = list(drive)
    del unit["latches"]
    del unit["contact"]
    return unit if contact is None else unit | {"contact": contact}
