"""Speed of an electromagnetic brake under a constant force: v = (F/c) (1 - exp(-t/tau)).

The rotor of the drive carries nearly all inertia, mr referred to the axis, and the brake c. Then
tau = mr/c. A gear multiplies both by its square, and a larger brake both by its size: tau stays.
"""

import math

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_near
from models import make_axial_unit, make_scene

import dockloop as dl

FORCE, SLOPE, ROTOR, FRONT = 500.0, 4000.0, 200.0, 2e-3  # N, N s/m, kg, kg
TAU = ROTOR / SLOPE
TIMES = np.array([0.5, 1.0, 2.0, 4.0]) * TAU


def run_brake(ratio: float, size: float) -> dl.Result:
    """Run the shipped differential unit on its axis; the gear and the size of the brake vary."""
    slope = size * SLOPE * ratio**2
    laws = [
        {"type": "constant", "force": -FORCE},
        {"type": "eddy", "slope": slope, "peak_rate": 1e6},
    ]
    unit = make_axial_unit(FRONT, size * ROTOR, laws, ratio=ratio)
    unit["forces"] = [force for force in unit["forces"] if force["name"] == "drive"]
    scene = make_scene(unit, chaser={"motion": "fixed"}, target={"motion": "fixed"})
    return dl.run(scene, start_values={"solver.rtol": 1e-9}, stop=4.0 * TAU, step=TAU / 20.0)


def compare_exactly() -> list[Comparison]:
    """Speed over time; the time constant for other gears and sizes."""
    rows = []
    for ratio, size in ((1.0, 1.0), (1.6, 1.0), (1.0, 3.0)):
        run = run_brake(ratio, size)
        moved = FRONT + size * ROTOR * ratio**2
        slope = size * SLOPE * ratio**2
        speed = np.interp(TIMES, run.time, -run["ring.velocity[1]"])
        exact = FORCE / slope * (1.0 - np.exp(-TIMES * slope / moved))
        worst = float(np.max(np.abs(speed / exact - 1.0)))
        what = f"gear {ratio:g}, brake {size:g}: worst relative error of the speed"
        rows.append(compare_near(what, worst, 0.0, absolute=1e-6))
        last = -run["ring.velocity[1]"][-1]
        middle = float(np.interp(TAU, run.time, -run["ring.velocity[1]"]))
        tau = -TAU / math.log(1.0 - middle * (1.0 - math.exp(-4.0)) / last)
        what = f"gear {ratio:g}, brake {size:g}: time constant [s]"
        rows.append(compare_near(what, tau, TAU, relative=1e-4))
    return rows


CASE = Case(
    "N",
    "Speed of an electromagnetic brake under a constant force",
    "Syromiatnikov, pages 257-258",
    (
        Input("the speed approaches its limit exponentially", "yes", GIVEN, "257"),
        Input("its time constant does not depend on size and gear", "yes", GIVEN, "258"),
        Input("force, slope, rotor", "500 N, 4 kN s/m, 200 kg", ASSUMED),
    ),
    "The rotor turns with the rods through screws and differentials of the shipped unit. Other"
    " masses are 1e-5 of that of the rotor, as the statement is about the brake alone.",
    exact=compare_exactly,
)  # fmt: skip
