"""A rig for tests of fits: a spring and a damper between two masses, in closed form.

Its tables have noise, another clock, another rate and other units than the scene.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp

import dockloop as dl
from dockloop.base.paths import ROOT

RIG = ROOT / "tests" / "data" / "measured_mujoco.csv"
MASS = 25e3 * 350e3 / 375e3
STIFFNESS, DAMPING = 23e3, 9e3  # N/m, N s/m: of the rig, not of the scene
APPROACH = 0.5  # s
K, C = "mechanism.set.contact.stiffness", "mechanism.set.contact.damping"
RANGES = {K: (1e4, 4e4), C: (2e3, 4e4)}
LATER = {"initial.approach_time": APPROACH}
SIGMA = {"relative.axial": 3e-4, "capture.compression": 20.0}  # m, N
TIME = np.arange(0.3, 4.5, 0.0137)  # s, of the run at the samples of the rig
CLOCK = 3.21  # s, of the rig when the run starts
SPEED = "initial.closing_speed"
LEGS, FRICTION = "mechanism.set.leg_defaults.damping", "friction.coefficient"
DOCKING = {LEGS: (200.0, 3000.0), FRICTION: (0.0, 0.4)}


def move(time, speed=0.1, stiffness=STIFFNESS, damping=DAMPING):
    """Distance along the axis [m] and compression [N] of the absorber, in closed form."""
    s = 0.5 * damping / MASS
    w = math.sqrt(stiffness / MASS - s**2)
    t = np.maximum(time - APPROACH, 0.0)
    depth = speed / w * np.exp(-s * t) * np.sin(w * t)
    rate = speed * np.exp(-s * t) * (np.cos(w * t) - s / w * np.sin(w * t))
    force = stiffness * depth + damping * rate
    end = (math.pi - math.atan2(2.0 * s * w, w**2 - s**2)) / w  # F = 0
    out = (
        np.exp(-s * end)
        * speed
        * np.array([math.sin(w * end) / w, math.cos(w * end) - s / w * math.sin(w * end)])
    )
    depth = np.where(t < end, depth, out[0] + out[1] * (t - end))
    depth = np.where(time < APPROACH, speed * (time - APPROACH), depth)
    return -depth, np.where((time < APPROACH) | (t >= end), 0.0, force)


def rub(time, friction=300.0):
    """Move with dry friction, and no damper, by another integrator."""

    def slope(_, y):
        sign = math.tanh(y[1] / 1e-4)
        force = max(STIFFNESS * y[0] + friction * sign, 0.0) if y[0] > 0.0 else 0.0
        return [y[1], -force / MASS]

    start = APPROACH
    done = solve_ivp(slope, (0, 5), [0.0, 0.1], max_step=1e-3)
    depth, rate = (np.interp(time - start, done.t, y) for y in done.y)
    force = np.maximum(STIFFNESS * depth + friction * np.tanh(rate / 1e-4), 0.0)
    depth = np.where(time < start, 0.1 * (time - start), depth)
    return -depth, np.where((time < start) | (depth <= 0.0), 0.0, force)


def write_rig(path, seed=2, histories=None, clock=CLOCK, **hardware):
    """Write the table of a test: mm and kN, another clock, 73 Hz, noise."""
    draw = np.random.default_rng(seed)
    axial, force = histories or move(TIME, **hardware)
    rows = zip(
        TIME + clock,
        1e3 * (axial + SIGMA["relative.axial"] * draw.normal(size=len(TIME))),
        1e-3 * (force + SIGMA["capture.compression"] * draw.normal(size=len(TIME))),
        strict=True,
    )
    lines = [f"{t:.5f},{x:.5f},{f:.6f}" for t, x, f in rows]
    head = "time [s],relative.axial [mm],capture.compression [kN]"
    path.write_text("\n".join([head, *lines]) + "\n")
    return path


def fit(*data, vary=None, starts=1, **more):
    found = dl.fit("absorber_1d", data, vary or RANGES, overrides=LATER, starts=starts, **more)
    assert all(math.isfinite(value) for value in found.values.values())
    return found


def assert_found(found, name, value, sigmas=3.0):
    deviation = found.deviations[name]
    assert abs(found.values[name] - value) < sigmas * deviation, (name, found.values, deviation)
