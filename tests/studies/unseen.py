"""Random dockings under wide conditions: `draw_docking`.

Own mechanisms (guide rings and hexapods with other points of the legs, stiffness, damping and mass
of the ring) and the shipped families, between vehicles of 1 to 1000 t. They close at 0.005 to
0.4 m/s; contacts may have bristles, the chaser may push after contact, and every third docking goes
on for 30 s, through steps of a sequence. A number always gives the same docking.
"""

import json
import math
from typing import NamedTuple

from dockloop.base.paths import ROOT
from dockloop.studies.extremes.random_scenes import Dice

SEED = 47
GROUPS = ["relative", "capture", "phase", "ring", "solver"]
OWN = ("idss_25t_350t", "hexapod")  # scenes whose legs are drawn, too
SCENES = (*OWN, "apda", "idss_25t_350t", "probe_drogue", "hexapod")
STOP, LONG_STOP = 12.0, 30.0  # s; the latter has time for steps of a sequence
_MOVED = 0.05  # m, most that a point of a leg is moved along an axis
_FILES = {"idss_25t_350t": "idss_hexapod"}  # of mechanisms with other names than their scenes
_CHANGE = 2.5  # most that a number of the hardware is multiplied or divided by
_LAW_NUMBERS = {"slope", "forward", "back", "limit", "preload"}  # of force laws, and the stages


class Docking(NamedTuple):
    """A docking: scene, its keys, end [s]."""

    scene: str
    keys: dict
    stop: float


def draw_docking(number: int, seed: int | str = SEED, kind: str = "") -> Docking:
    """Return the docking of a number.

    Args:
        number: of the docking.
        seed: numbers of another seed are other dockings.
        kind: ``own`` for own mechanisms only, ``changed`` for the shipped mechanisms with other
            springs, dampers, brakes, drives, latches and contacts; empty for own and shipped ones.
    """
    dice = Dice(f"{seed}/{number}")
    scenes = {"own": OWN, "changed": tuple(dict.fromkeys(SCENES))}.get(kind, SCENES)
    scene = scenes[number % len(scenes)]
    keys = {"outputs.groups": GROUPS, "initial.approach_time": 0.5}
    for vehicle, sign in (("chaser", 1.0), ("target", -1.0)):
        keys |= _draw_vehicle(dice, vehicle, sign)
    speed = dice.draw_log("speed", 0.005, 0.4)
    keys |= {
        "initial.closing_speed": speed,
        "initial.lateral_offset": round(0.1 * math.sqrt(dice.draw("offset")), 4),
        "initial.lateral_direction_deg": round(360.0 * dice.draw("direction"), 1),
        "initial.lateral_speed": round(min(0.04, 0.4 * speed) * dice.draw("lateral speed"), 5),
        "initial.lateral_speed_direction_deg": round(360.0 * dice.draw("speed direction"), 1),
        "initial.pitch_yaw_deg": round(4.0 * dice.draw("tilt"), 3),
        "initial.pitch_yaw_direction_deg": round(360.0 * dice.draw("tilt direction"), 1),
        "initial.roll_deg": round(8.0 * dice.draw("roll") - 4.0, 3),
        "initial.roll_rate_deg_s": round(0.4 * dice.draw("roll rate") - 0.2, 4),
        "contact.friction_coefficient": round(0.4 * dice.draw("friction"), 3),
        "experiment.step": (0.01, 0.05, 0.25)[int(3.0 * dice.draw("step"))],
    }
    if dice.draw("has bristles") < 0.35:
        keys["contact.friction_model"] = "bristle"
    if dice.draw("has thrust") < 0.3:
        keys["chaser.contact_thrust"] = dice.draw_log("thrust", 50.0, 1500.0)
    if kind == "changed":
        keys |= _change_hardware(dice, scene)
    elif scene in OWN and (kind == "own" or number // len(SCENES) % 2 == 0):
        keys |= _draw_mechanism(dice, scene)
    return Docking(scene, keys, LONG_STOP if dice.draw("is long") < 1.0 / 3.0 else STOP)


def _draw_vehicle(dice: Dice, vehicle: str, sign: float) -> dict:
    """Draw mass, inertia (that of a box) and the place of the docking interface."""
    mass = dice.draw_log(f"{vehicle} mass", 1e3, 1e6)
    length = 2.0 * (mass / 1e3) ** (1.0 / 3.0)
    a, b, c = (length * (0.7 + 0.6 * dice.draw(f"{vehicle} {axis}")) for axis in "xyz")
    moments = (mass * s / 12.0 for s in (b * b + c * c, a * a + c * c, a * a + b * b))
    return {
        f"{vehicle}.mass": mass,
        f"{vehicle}.inertia": [*(float(f"{m:.4g}") for m in moments), 0.0, 0.0, 0.0],
        f"{vehicle}.interface_position": [round(sign * 0.5 * a, 3), 0.0, 0.0],
    }


def _read_mechanism(scene: str) -> dict:
    file = ROOT / "modelDescription" / "mechanisms" / f"{_FILES.get(scene, scene)}.json"
    return json.loads(file.read_text(encoding="utf-8"))


def _change_hardware(dice: Dice, scene: str) -> dict:
    """Multiply the numbers of the hardware by factors, one for all numbers of the same meaning."""
    mechanism = _read_mechanism(scene)

    def change(what: str, value: float) -> float:
        return float(f"{value * dice.draw_log(what, 1.0 / _CHANGE, _CHANGE):.4g}")

    keys = {}
    for force in mechanism.get("forces", ()):
        for place, law in enumerate(force["laws"], 1):
            name = f"mechanism.set.forces.{force['name']}.laws.{place}"
            for member in sorted(law.keys() & _LAW_NUMBERS):
                keys[f"{name}.{member}"] = change(f"{law['type']} {member}", law[member])
            if "stages" in law:
                stages = [[at, change("stages", value)] for at, value in law["stages"]]
                keys[f"{name}.stages"] = stages
    for part in ("latches", "leg_defaults"):
        for member in sorted(mechanism.get(part, {}).keys() & {"stiffness", "damping"}):
            value = mechanism[part][member]
            keys[f"mechanism.set.{part}.{member}"] = change(f"{part} {member}", value)
    stiffness = dice.draw_log("contact stiffness", 2e6 / _CHANGE, 2e6 * _CHANGE)
    keys["contact.stiffness"] = stiffness
    if mechanism["contact"]["type"] == "guide_ring":
        keys["contact.node_stiffness"] = stiffness / 12.0
    return keys


def _draw_mechanism(dice: Dice, scene: str) -> dict:
    """Draw the points of all legs and the ring; of passive legs also spring and damper."""
    mechanism = _read_mechanism(scene)
    keys = {}
    for leg in mechanism["legs"]:
        for point in ("root_point", "closing_point"):
            what = f"{leg['name']} {point}"
            keys[f"mechanism.set.legs.{leg['name']}.{point}"] = [
                round(value + _MOVED * (2.0 * dice.draw(f"{what} {axis}") - 1.0), 4)
                for axis, value in zip("xyz", leg[point], strict=True)
            ]
    keys["mechanism.set.bodies.ring.mass"] = dice.draw_log("ring mass", 15.0, 100.0)
    if "stiffness" in mechanism["leg_defaults"]:
        keys["mechanism.set.leg_defaults.stiffness"] = dice.draw_log("stiffness", 500.0, 2e4)
        keys["mechanism.set.leg_defaults.damping"] = dice.draw_log("damping", 200.0, 8e3)
    return keys
