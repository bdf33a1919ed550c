"""Vehicles that are not rigid, for tests: in scenes, and as hosts integrate them."""

import copy
import tomllib

import numpy as np

import dockloop as dl
from coupling_host import MOTION, turn
from dockloop.base.paths import SCENES

MASS, INERTIA = 25e3, np.diag([60.5e3, 132e3, 132e3])  # kg, kg m2, of the chaser as a whole
TIGHT = {"solver.rtol": 1e-9, "solver.atol_position": 1e-11, "solver.atol_velocity": 1e-11}
ARRAY_MASS, ARRAY_ARM = 300.0, 6.0  # kg; m from the hinge axis of the vehicle to the centre of mass
ARRAYS = [
    {
        "mass": ARRAY_MASS,
        "com": [0.0, 4.0 * side, 0.0],
        "inertia": [1600.0, 25.0, 1600.0, 0.0, 0.0, 0.0],
        "position": [0.0, 2.0 * side, 0.0],
        "joint": "hinge",
        "axis": axis,
        "frequency": frequency,
        "damping_ratio": 0.005,
    }
    for side, axis, frequency in ((1, [1, 0, 0], 0.3), (-1, [0, 0, 1], 0.45))
]
_OWN = 2.0 * (1600.0 + ARRAY_MASS * ARRAY_ARM**2)
HUB = (MASS - 2.0 * ARRAY_MASS, INERTIA - np.diag([_OWN, 50.0, _OWN]))
SLOSH = {"mass": 2500.0, "joint": "slide", "axis": [0.6, 0.8, 0.0], "frequency": 0.3}
SLOSH |= {"position": [0.0, 0.0, 0.0], "damping_ratio": 0.01}
TANK = (MASS - SLOSH["mass"], INERTIA)


def components(matrix):
    """The numbers xx yy zz xy xz yz."""
    return [float(matrix[i, k]) for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def shipped(name, **vehicles):
    """A shipped scene with members of its vehicles changed."""
    scene = tomllib.loads((SCENES / f"{name}.toml").read_text())
    for vehicle, members in vehicles.items():
        scene[vehicle] = copy.deepcopy(scene[vehicle]) | members
    return scene


def check_saved_states(scene, names):
    """A run that goes back and repeats each step has the bits of one that does not."""
    plain, twice = dl.Docking(scene), dl.Docking(scene)
    for _ in range(30):
        plain.step(0.1)
        saved = twice.save()
        twice.step(0.1)
        twice.restore(saved)
        twice.step(0.1)
        for name in names:
            assert twice.get(name) == plain.get(name), name


class FlexibleHost:
    """A vehicle with parts, integrated by a docking that has this vehicle only."""

    def __init__(self, motion, mass, inertia, parts):
        members = {"mass": mass, "inertia": components(inertia), "part": parts}
        members |= dict(zip(MOTION, (list(map(float, z)) for z in motion), strict=True))
        tight = {name.partition(".")[2]: value for name, value in TIGHT.items()}
        scene = {"solver": tight, "experiment": {"stop": 9.0, "step": 0.1}, "chaser": members}
        self.docking, self.mass, self.inertia = dl.Docking(scene), mass, inertia

    def motion(self):
        """Return position, velocity, attitude, angular velocity of the hub."""
        return [np.array(self.docking.get(f"chaser.{name}")) for name in MOTION]

    def advance(self, force, torque, h):
        """Make a step; return the mean loads of the parts on the hub, from its momentum."""
        begin = self.motion()
        self.docking.set("chaser.force_ext", force)
        self.docking.set("chaser.torque_ext", torque)
        self.docking.step(h)
        end = self.motion()
        own = self.mass * (end[1] - begin[1]) / h - force
        spins = [turn(z[2], self.inertia @ z[3]) for z in (begin, end)]
        middle = begin[2] + end[2]
        back = middle / np.linalg.norm(middle) * [1.0, -1.0, -1.0, -1.0]
        return own, turn(back, (spins[1] - spins[0]) / h) - torque
