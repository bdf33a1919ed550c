"""Case E: how long the ring moves after the capture.

A motion has ended when its rate stays below 10 % of its largest one since first contact. Rates are
those of the ring relative to the chaser: along x, across x, and in angle.
"""

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_range

import dockloop as dl

END, PART = 100.0, 0.1  # s, 1
FAMILIES = ("apda", "hexapod")  # a sequence retracts them
VEHICLES = {
    "chaser.mass": 7e3,
    "chaser.inertia": [1.2e4, 4e4, 4e4, 0, 0, 0],
    "chaser.interface_position": [3, 0, 0],
    "target.mass": 14e3,
    "target.inertia": [2e4, 6e4, 6e4, 0, 0, 0],
    "target.interface_position": [-4, 0, 0],
}
BANDS = {"axial": (0.0, 1.0), "lateral": (1.0, 10.0), "angular": (10.0, 100.0)}  # s
SWING = (
    "after the first seconds the vehicles swing slowly, at about a tenth of the largest rate, on"
    " springs and brakes whose numbers are assumed"
)
REASONS = {
    "hexapod": "equal legs with springs and brakes: one set of numbers serves all directions",
    "idss_25t_350t": "equal legs with springs and dampers: one set serves all directions",
}


def run_scene(scene: str) -> dl.Result:
    """Run a scene with these vehicles; the mechanism does not retract."""
    held = {"sequence.stop_after": "attenuate"} if scene in FAMILIES else {}
    return dl.run(scene, VEHICLES | held, stop=END, step=0.05)


def find_times(run: dl.Result) -> dict[str, float]:
    """Return how long each motion lasts after the capture [s]."""
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


def find_slip(run: dl.Result) -> float:
    """Return when the drive, which is the longitudinal absorber, has all but 10 % of its slip."""
    since = run.time - run["time_of_capture"][-1]
    left = np.abs(run["element[7].coordinate"] - run["element[7].coordinate"][-1])
    return float(since[np.flatnonzero(left > PART * left.max())[-1]])


def compare_trends() -> list[Comparison]:
    """The three time scales of the differential unit."""
    run = run_scene("apda")
    times = find_times(run)
    return [
        compare_range("apda, slip of the drive ends after [s]", find_slip(run), 0.0, 1.0),
        *(
            compare_range(f"apda, {name} motion ends after [s]", times[name], *band, reason)
            for (name, band), reason in zip(BANDS.items(), ("", SWING, SWING), strict=True)
        ),
    ]


def report() -> list[Comparison]:
    """The other rings, which are not built like the original."""
    rows = []
    for scene, reason in REASONS.items():
        for name, value in find_times(run_scene(scene)).items():
            what = f"{scene}, {name} motion ends after [s]"
            rows.append(compare_range(what, value, *BANDS[name], reason))
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
