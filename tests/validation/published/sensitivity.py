"""Case L: which misalignment matters most for the capture.

From the middle of the box of initial conditions every input goes over its allowed range. There are
two measures, as that of the source is not known: with thrust, the spread of the time from first
contact to capture; for the probe without thrust, the least closing speed that captures within 20 s.
"""

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_words

import dockloop as dl

END, LATE = 12.0, 10.0  # s
MIDDLE = {
    "initial.approach_time": 0.5,
    "initial.closing_speed": 0.075,
    "initial.lateral_offset": 0.05,
    "initial.pitch_yaw_deg": 2.0,
    "initial.roll_deg": 2.0,
    "initial.lateral_speed": 0.02,
    "initial.pitch_yaw_rate_deg_s": 0.1,
    "initial.roll_rate_deg_s": 0.1,
    "chaser.contact_thrust": 500.0,
    "chaser.contact_thrust_delay": 0.3,
}
RANGES = {
    "lateral offset": ("initial.lateral_offset", (0.0, 0.025, 0.075, 0.1)),
    "angular misalignment": ("initial.pitch_yaw_deg", (0.0, 1.0, 3.0, 4.0)),
    "roll": ("initial.roll_deg", (-4.0, -2.0, 0.0, 4.0)),
    "lateral speed": ("initial.lateral_speed", (0.0, 0.04)),
    "closing speed": ("initial.closing_speed", (0.05, 0.1)),
}
FAMILIES = ("probe_drogue", "apda", "hexapod", "idss_25t_350t")
REASON = (
    "every docking is captured, later and from a higher speed the longer the guides have to travel,"
    " which is the offset; the measure of the source is not known"
)


def find_time(family: str, changes: dict[str, float]) -> float:
    """Return the time from first contact to capture [s]."""
    document = dl.Scene(family).document
    values = {k: v for k, v in (MIDDLE | changes).items() if "roll" not in k or has_roll(document)}
    run = dl.run(family, values, stop=END, step=0.1)
    if not run["captured"].any():
        return LATE
    return float(run["time_of_capture"][-1] - run["time_of_contact"][-1])


def has_roll(document: dict) -> bool:
    """Return whether the roll of a vehicle matters to its hardware."""
    return document["mechanism"]["contact"]["type"] == "guide_ring"


def rank(family: str) -> dict[str, float]:
    """Return the spread of the time of capture by input, the largest first [s]."""
    middle = find_time(family, {})
    spread = {}
    for name, (key, values) in RANGES.items():
        times = [middle, *(find_time(family, {key: value}) for value in values)]
        spread[name] = float(np.ptp(times))
    return dict(sorted(spread.items(), key=lambda item: -item[1]))


def compare_family(family: str, reason: str = "") -> Comparison:
    """Compare the order of angle and offset."""
    spread = rank(family)
    found = ", ".join(f"{name} {value:.2f} s" for name, value in spread.items())
    return compare_words(
        f"{family}: spread of the time to capture",
        found,
        "angular misalignment above lateral offset",
        spread["angular misalignment"] > spread["lateral offset"],
        reason,
    )


def find_least_speed(changes: dict[str, float]) -> float:
    """Return the least closing speed at which the probe is captured without thrust [m/s]."""
    low, high = 0.005, 0.165
    for _ in range(5):
        speed = 0.5 * (low + high)
        values = MIDDLE | {"chaser.contact_thrust": 0.0} | changes
        values = {k: v for k, v in values.items() if "roll" not in k}
        run = dl.run(
            "probe_drogue", values | {"initial.closing_speed": speed}, stop=20.5, step=0.25
        )
        low, high = (low, speed) if run["captured"].any() else (speed, high)
    return 0.5 * (low + high)


def compare_speeds() -> Comparison:
    """Compare how much angle and offset raise the least speed."""
    spread = {}
    for name in ("lateral offset", "angular misalignment"):
        key, values = RANGES[name]
        spread[name] = abs(find_least_speed({key: values[-1]}) - find_least_speed({key: values[0]}))
    return compare_words(
        "probe_drogue: change of the least closing speed",
        ", ".join(f"{name} {value:.3f} m/s" for name, value in spread.items()),
        "angular misalignment above lateral offset",
        spread["angular misalignment"] > spread["lateral offset"],
        REASON,
    )


def compare_trends() -> list[Comparison]:
    """The probe, which is what the source is about."""
    return [compare_family("probe_drogue", REASON), compare_speeds()]


def report() -> list[Comparison]:
    """The rings."""
    return [compare_family(family, REASON) for family in FAMILIES[1:]]


CASE = Case(
    "L",
    "Which misalignment matters most",
    "Schliesing 1972 (abstract)",
    (
        Input("capture is most sensitive to angle, least to lateral miss", "order", GIVEN),
        Input("range of every input", "box of the IDSS", ASSUMED),
        Input("thrust", "500 N, 0.3 s after first contact", ASSUMED),
        Input("measures", "time to capture; least closing speed", ASSUMED),
    ),
    "Units and ranges of the source are lost, so only the order of two inputs is compared. It"
    " depends on what counts as sensitive, and on hardware that is assumed.",
    trend=compare_trends,
    scenario=report,
)  # fmt: skip
