"""Dockings whose capture is known in closed form: the approach must open three pawls.

Both vehicles are rigid and meet straight, so only the pawls of the latches slow them down. The
force of a pawl is that of sin^2 over 16 mm, so its work is half of the peak times 16 mm.
"""

import json
from typing import Any

import numpy as np

SCENE = "idss_25t_350t"
STRAIGHT = {
    "model.level": "rigid",
    **dict.fromkeys(("initial.lateral_offset", "initial.pitch_yaw_deg", "initial.roll_deg"), 0),
    **dict.fromkeys(("initial.lateral_speed", "initial.pitch_yaw_rate_deg_s"), 0),
    "initial.roll_rate_deg_s": 0,
    "chaser.mass_includes_mechanism": 2,
}
CHASER, TARGET = 25e3, 350e3  # kg
STROKE = 0.016  # m

# A box for the boundary.
SPEED = ("initial.closing_speed", 0.01, 0.03)
FORCE = ("mechanism.set.latches.push_force", 20.0, 400.0)

# A sweep that fails rarely: mean, deviation and least closing speed [m/s]; a force [N].
MEAN, DEVIATION, LEAST, PUSH = 0.022, 0.002, 0.005, 100.0
MASSES = (20e3, 30e3)
SWEEP = f"""
scene = "{SCENE}"
seed = 3
cases = 400
sampling = "random"
[set]
{"".join(f'"{name}" = {json.dumps(value)}' + chr(10) for name, value in STRAIGHT.items())}
"mechanism.set.latches.push_force" = {PUSH}
[[vary]]
type = "normal"
name = "initial.closing_speed"
mean = {MEAN}
deviation = {DEVIATION}
range = [{LEAST}, 0.05]
[[vary]]
type = "uniform"
name = "chaser.mass"
range = [{MASSES[0]}, {MASSES[1]}]
[experiment]
stop = 6.0
step = 1.0
"""


def find_speed(force: Any, chaser: Any = CHASER) -> Any:
    """Return the least closing speed that opens three pawls."""
    mass = chaser * TARGET / (chaser + TARGET)
    return np.sqrt(2.0 * 3.0 * force * STROKE / 2.0 / mass)


def find_area() -> float:
    """Return the part of the box with capture: the integral over the forces."""
    _, low, high = SPEED
    least = np.clip(find_speed(np.linspace(*FORCE[1:], 100_001)), low, high)
    return float(np.mean((high - least) / (high - low)))


def sample_failures(count: int = 4_000_000) -> float:
    """Return the part of samples of the sweep whose energy opens no pawls, without dockings."""
    random = np.random.default_rng(5)
    speed = MEAN + DEVIATION * random.standard_normal(count)
    chaser = random.uniform(*MASSES, count)
    return float(np.mean(speed < find_speed(PUSH, chaser)))
