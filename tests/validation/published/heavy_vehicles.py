"""Case K: heavy vehicles that meet slowly, with and without thrust."""

from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_words

import dockloop as dl

SPEED, THRUST, END = 0.03, 3000.0, 30.0  # m/s, N, s
VEHICLES = {
    "chaser.mass": 120e3,
    "chaser.inertia": [1.5e6, 1.2e7, 1.2e7, 0, 0, 0],
    "chaser.interface_position": [8, 0, 0],
    "target.mass": 100e3,
    "target.inertia": [2e6, 1e7, 1e7, 0, 0, 0],
    "target.interface_position": [-10, 0, 0],
    "initial.closing_speed": SPEED,
    "initial.lateral_offset": 0.025,
    "initial.pitch_yaw_deg": 0.5,
    "initial.roll_deg": 0.5,
    "initial.approach_time": 0.5,
}


REASON = (
    "the pawls of the shipped latches take 0.5 J of the 25 J, and petals that meet almost straight"
    " take little; the forces of the original are not known"
)


def run_docking(thrust: float) -> dl.Result:
    """Run the docking of two heavy vehicles with the differential unit."""
    values = {"chaser.contact_thrust": thrust, "chaser.contact_thrust_delay": 0.3}
    return dl.run("apda", VEHICLES | values, stop=END, step=0.1)


def report() -> list[Comparison]:
    """Capture with thrust; capture or not without."""
    rows = []
    for thrust, expected in ((THRUST, "captured"), (0.0, "not captured, or late")):
        run = run_docking(thrust)
        is_captured = bool(run["captured"].any())
        after = run["time_of_capture"][-1] - run["time_of_contact"][-1]
        found = run.summary["explanation"] + (f", {after:.1f} s after contact" * is_captured)
        agrees = is_captured if thrust else (not is_captured or after > 5.0)
        what = f"{SPEED:g} m/s, thrust {thrust:.0f} N"
        rows.append(compare_words(what, found, expected, agrees, REASON))
    return rows


CASE = Case(
    "K",
    "Heavy vehicles at 0.03 m/s",
    "Accounts of STS-71 and STS-98 (Air & Space, NASA Quest)",
    (
        Input("closing speed", "0.027 to 0.034 m/s", GIVEN),
        Input("masses", "about 120 t and 100 t", GIVEN, "kind of ton not stated"),
        Input("misalignment", "below 25 mm and 0.5 deg", GIVEN),
        Input("thrust", f"{THRUST:.0f} N, 0.3 s after contact", ASSUMED),
        Input("inertia, arms", "round numbers", ASSUMED),
    ),
    "The kinetic energy of the approach is 25 J. In the accounts, thrusters fire just before"
    " contact and capture follows. One account gives an inch per minute; against the others.",
    scenario=report,
)
