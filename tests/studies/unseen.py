"""Random dockings that no table of this project was measured with: `draw_docking`.

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
_SHAPES = ("lateral", "pitch_yaw")


class Docking(NamedTuple):
    """A docking: scene, its keys, end [s]."""

    scene: str
    keys: dict
    stop: float


def draw_docking(number: int, seed: int = SEED) -> Docking:
    """Return the docking of a number."""
    dice = Dice(f"{seed}/{number}")
    scene = SCENES[number % len(SCENES)]
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
    if scene in OWN and number // len(SCENES) % 2 == 0:
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


def _draw_mechanism(dice: Dice, scene: str) -> dict:
    """Draw the points of all legs and the ring; of passive legs also spring and damper."""
    name = {"idss_25t_350t": "idss_hexapod", "hexapod": "hexapod"}[scene]
    file = ROOT / "modelDescription" / "mechanisms" / f"{name}.json"
    keys = {}
    for leg in json.loads(file.read_text(encoding="utf-8"))["legs"]:
        for point in ("root_point", "closing_point"):
            what = f"{leg['name']} {point}"
            keys[f"mechanism.set.legs.{leg['name']}.{point}"] = [
                round(value + _MOVED * (2.0 * dice.draw(f"{what} {axis}") - 1.0), 4)
                for axis, value in zip("xyz", leg[point], strict=True)
            ]
    keys["mechanism.set.bodies.ring.mass"] = dice.draw_log("ring mass", 15.0, 100.0)
    if name == "idss_hexapod":
        keys["mechanism.set.leg_defaults.stiffness"] = dice.draw_log("stiffness", 500.0, 2e4)
        keys["mechanism.set.leg_defaults.damping"] = dice.draw_log("damping", 200.0, 8e3)
    return keys
