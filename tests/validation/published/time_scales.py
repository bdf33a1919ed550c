"""Case E: how long the ring moves after the capture.

A motion has ended when its rate stays below 10 % of its largest one since first contact. Rates are
those of the ring relative to the chaser: along x, across x, and in angle.
"""

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_range

import dockloop as dl

END, PART = 100.0, 0.1  # s, 1
VEHICLES = {
    "chaser.mass": 7e3,
    "chaser.inertia": [1.2e4, 4e4, 4e4, 0, 0, 0],
    "chaser.interface_position": [3, 0, 0],
    "target.mass": 14e3,
    "target.inertia": [2e4, 6e4, 6e4, 0, 0, 0],
    "target.interface_position": [-4, 0, 0],
}
RINGS = ("apda", "hexapod", "idss_25t_350t")
SPRINGS = (
    "after the first seconds the vehicles swing slowly, at about a tenth of the largest rate, on"
    " springs and brakes whose numbers are assumed"
)
REASONS = {
    "apda": SPRINGS,
    "hexapod": "equal legs with springs and brakes: one set of numbers serves all directions",
    "idss_25t_350t": "equal legs with springs and dampers: one set serves all directions",
}


def find_times(scene: str) -> dict[str, float]:
    """Return how long each motion lasts [s]."""
    run = dl.run(scene, VEHICLES, stop=END, step=0.05)
    since = run.time - run["time_of_capture"][-1]
    linear, angular = run.vector("ring.velocity"), run.vector("ring.angular_velocity")
    rates = {
        "axial": np.abs(linear[:, 0]),
        "lateral": np.hypot(linear[:, 1], linear[:, 2]),
        "angular": np.linalg.norm(angular, axis=1),
    }
    return {
        name: float(since[np.flatnonzero(rate > PART * rate.max())[-1]])
        for name, rate in rates.items()
    }


def compare_trends() -> list[Comparison]:
    """The three time scales of the differential unit."""
    times = find_times("apda")
    bands = {"axial": (0.0, 1.0), "lateral": (1.0, 10.0), "angular": (10.0, 100.0)}
    return [
        compare_range(f"apda, {name} motion ends after [s]", times[name], *band, REASONS["apda"])
        for name, band in bands.items()
    ]


def report() -> list[Comparison]:
    """The other rings, which are not built like the original."""
    rows = []
    for scene in RINGS[1:]:
        for name, value in find_times(scene).items():
            low, high = {"axial": (0.0, 1.0), "lateral": (1.0, 10.0), "angular": (10.0, 100.0)}[
                name
            ]
            what = f"{scene}, {name} motion ends after [s]"
            rows.append(compare_range(what, value, low, high, REASONS[scene]))
    return rows


CASE = Case(
    "E",
    "Time scales after capture",
    "Syromiatnikov, page 185",
    (
        Input("longitudinal motion ends in", "several tenths of a second", GIVEN, "185"),
        Input("transverse motion", "several seconds", GIVEN, "185"),
        Input("angular motion", "several tens of seconds", GIVEN, "185"),
        Input("vehicles", "7 t and 14 t", ASSUMED, "Soyuz and Apollo in size"),
        Input("initial conditions", "of the scenes", ASSUMED),
    ),
    "Only the differential unit is built like the original. Other rings are scenarios.",
    trend=compare_trends,
    scenario=report,
)  # fmt: skip
