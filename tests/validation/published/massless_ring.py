"""Case G: a ring of vanishing mass approaches the quasi-static ring.

The differential unit on its axis has a spring and a damper at its drive. The ring moves between
the contact spring K and these. Without mass, K (x - r) = k r + c r': an ordinary differential
equation of first order for r, solved by scipy next to that of the vehicle.
"""

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_range, compare_words
from models import make_axial_unit, make_scene
from scipy.integrate import solve_ivp

import dockloop as dl

MASS, SPEED, END = 4650.0, 0.1, 0.5  # kg, m/s, s
CONTACT, SPRING, DAMPER = 4e5, 3e4, 8e3  # N/m, N/m, N s/m
RINGS = (80.0, 40.0, 20.0, 10.0, 5.0)  # kg


def run_ring(ring: float) -> float:
    """Return the travel of the vehicle at the end [m]."""
    laws = [{"type": "spring", "stages": [[0, SPRING]]}, {"type": "damper", "linear": DAMPER}]
    contact = {"type": "absorber", "stiffness": CONTACT, "damping": 0, "pulls": False}
    scene = make_scene(
        make_axial_unit(0.5 * ring, 0.5 * ring, laws, contact),
        chaser={"motion": "fixed"},
        target={"mass": MASS, "velocity": [-SPEED, 0, 0]},
    )
    run = dl.run(scene, start_values={"solver.rtol": 1e-9}, stop=END, step=0.05)
    return -float(run["relative.axial"][-1])


def solve_without_mass() -> float:
    """Return the travel of the vehicle with a ring without mass [m]."""

    def rates(_, y: np.ndarray) -> list[float]:
        x, v, r = y
        force = CONTACT * (x - r)
        return [v, -force / MASS, (force - SPRING * r) / DAMPER]

    solved = solve_ivp(rates, (0.0, END), [0.0, SPEED, 0.0], rtol=1e-11, atol=1e-14)
    return float(solved.y[0, -1])


def compare_trends() -> list[Comparison]:
    """Order of convergence, and the error of a ring of the shipped size."""
    limit = solve_without_mass()
    errors = np.array([abs(run_ring(ring) - limit) for ring in RINGS])
    slope = float(np.log(errors[-3] / errors[-1]) / np.log(RINGS[-3] / RINGS[-1]))
    falling = bool(np.all(np.diff(errors) < 0.0))
    return [
        compare_range("order of the error in the mass of the ring", slope, 0.9, 1.1),
        compare_words(
            "error over the mass of the ring, 80 to 5 kg",
            f"{errors[0] / limit:.1e} to {errors[-1] / limit:.1e} of the travel",
            "falls",
            falling,
        ),
    ]


CASE = Case(
    "G",
    "Limit of a ring without mass",
    "engineeringmechanics.cn 3144 (abstract)",
    (
        Input("ring without mass, contact from the balance of forces", "method", GIVEN),
        Input("vehicle, speed", "4650 kg, 0.1 m/s", ASSUMED),
        Input("contact, spring, damper", "400 kN/m, 30 kN/m, 8 kN s/m", ASSUMED),
    ),
    "A test of the method, without published numbers. The ring is that of the differential unit on"
    " its axis; all masses that move with it are made smaller together.",
    trend=compare_trends,
)
