"""Scenes of one body on a slide: the simplest mechanism for laws and sequences; of a vehicle."""

import json
from pathlib import Path

SCENE = """
title = "One body on a slide"
[chaser]
motion = "fixed"
mass = 1000
inertia = [1000, 1000, 1000, 0, 0, 0]
[mechanism]
name = "slide"
[initial]
at = "start"
[initial.joints.block]
rate = {rate}
[solver]
rtol = 1e-10
atol_position = 1e-11
atol_velocity = 1e-11
atol_energy = 1e-9
[experiment]
stop = 1.0
step = 0.01
tolerance = 1e-10
[outputs]
groups = ["states", "energy", "solver"]
"""

VEHICLE = """
title = "A vehicle by itself"
[chaser]
mass = 1000
inertia = [1000, 1000, 1000, 0, 0, 0]
[initial]
at = "start"
[experiment]
stop = 3.0
step = 0.3
[outputs]
groups = ["energy", "solver"]
"""


def make_slide(mass: float, *elements: dict, **members: object) -> dict:
    """One body that slides along x of the base."""
    body = {
        "name": "block",
        "parent": "base",
        "joint": {"type": "prismatic", "axis": [1, 0, 0]},
        "mass": mass,
    }
    return {"name": "slide", "bodies": [body], "forces": list(elements), **members}


def make_element(*laws: dict, name: str = "one") -> dict:
    return {"name": name, "along": [{"joint": "block", "ratio": 1.0}], "laws": list(laws)}


def write_slide(folder: Path, mechanism: dict, rate: float = 0.0) -> str:
    """Write scene and mechanism into a folder; return the path of the scene."""
    (folder / "slide.json").write_text(json.dumps(mechanism))
    scene = folder / "scene.toml"
    scene.write_text(SCENE.format(rate=rate))
    return str(scene)
