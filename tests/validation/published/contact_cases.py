"""Case F: contact cases of the rigs of the time, on the differential unit.

Their geometry is not described completely, so only outcomes and orders are compared.
"""

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_words

import dockloop as dl

STRAIGHT = {
    "initial.approach_time": 0.5,
    "initial.lateral_offset": 0.0,
    "initial.pitch_yaw_deg": 0.0,
    "initial.roll_deg": 0.0,
}
CASES = {
    "central": {},
    "with roll": {"initial.roll_deg": 4.0},
    "guides on guides": {"initial.lateral_offset": 0.1, "initial.roll_deg": 4.0},
    "guides on ring": {"initial.pitch_yaw_deg": 4.0},
}
COMPARED = ("central", "with roll", "guides on ring")
DIFFERENCES = (1, 2, 3)  # elements that carry roll
SPEED, SLOW = 0.1, 0.02  # m/s
JET = {"vehicle": "chaser", "at": "retract", "time": 5.0, "duration": 3.0, "torque": [900, 0, 0]}
RETRACTED = 90.0  # s, before the faces meet


def run_case(name: str, speed: float = SPEED, thrust: float = 0.0) -> dl.Result:
    """Run one contact case without thrust, or with it."""
    values = {"initial.closing_speed": speed, "chaser.contact_thrust": thrust}
    return dl.run("apda", STRAIGHT | CASES[name] | values, stop=12.0, step=0.02)


def find_roll(run: dl.Result) -> tuple[float, float]:
    """Return the largest roll of the ring [deg], and the largest load of a roll absorber [N]."""
    attitude = run.vector("ring.attitude")
    force = np.array([run[f"element[{i}].force"] for i in DIFFERENCES])
    roll = 2.0 * np.degrees(np.arctan2(attitude[:, 1], attitude[:, 0]))
    return float(np.max(np.abs(roll))), float(np.max(np.abs(force)))


def find_retraction_load(*disturbances: dict) -> float:
    """Return the largest load of a roll absorber while the ring retracts [N]."""
    run = dl.run("apda", {"disturbance": list(disturbances)}, stop=RETRACTED, step=0.05)
    retracts = run["phase"] == 6
    loads = [np.max(np.abs(run[f"element[{i}].force"][retracts])) for i in DIFFERENCES]
    return float(max(loads))


def compare_trends() -> list[Comparison]:
    """Roll: largest load and travel; separation at low speed without thrust."""
    rolls = {name: find_roll(run_case(name)) for name in CASES}
    travel = max(rolls, key=lambda name: rolls[name][0])
    load = max(COMPARED, key=lambda name: rolls[name][1])
    slow = run_case("with roll", SLOW)
    pushed = run_case("with roll", SLOW, thrust=800.0)
    quiet, disturbed = find_retraction_load(), find_retraction_load(JET)
    return [
        compare_words(
            "largest roll of the ring over the cases",
            f"{rolls['with roll'][0]:.2f} deg with roll, largest in '{travel}'",
            "in a case with roll",
            CASES[travel].get("initial.roll_deg", 0.0) > 0.0,
        ),
        compare_words(
            "largest load of the roll absorbers: central, roll, guides on ring",
            ", ".join(f"{rolls[name][1]:.0f} N" for name in COMPARED),
            "with roll",
            load == "with roll",
            "a tilted ring loads the difference shafts of the shipped unit too",
        ),
        compare_words(
            f"roll case at {SLOW:g} m/s without thrust",
            slow.summary["explanation"],
            "not captured",
            not slow["captured"].any(),
        ),
        compare_words(
            f"roll case at {SLOW:g} m/s with a thrust of 800 N",
            pushed.summary["explanation"],
            "captured",
            bool(pushed["captured"].any()),
        ),
        compare_words(
            "largest load of a roll absorber during the retraction, a jet fires",
            f"{disturbed:.0f} N, {quiet:.0f} N without",
            "above that without",
            disturbed > quiet,
        ),
    ]  # fmt: skip


def report() -> list[Comparison]:
    """Outcome and peak of every case."""
    rows = []
    for name in CASES:
        run = run_case(name)
        load = f"compression {run['capture.peak.compression'][-1]:.0f} N"
        found = f"{run.summary['explanation']}; {load}"
        is_captured = bool(run["captured"].any())
        rows.append(compare_words(f"{name}, {SPEED:g} m/s", found, "captured", is_captured))
    return rows


CASE = Case(
    "F",
    "Contact cases of the rigs",
    "Syromiatnikov, pages 237, 303",
    (
        Input("with roll: largest load, travel of roll absorbers", "order", GIVEN, "237"),
        Input("with roll, slow, no thrust: vehicles can separate", "outcome", GIVEN, "237"),
        Input("closing speed", "0.1 m/s, slow 0.02 m/s", ASSUMED),
        Input("jet during coupling: loads absorbers beyond rating", "order", GIVEN, "269, 279"),
        Input("misalignments", "4 deg, 0.1 m", ASSUMED, "limits of the IDSS"),
        Input("jet", "900 N m of roll for 3 s", ASSUMED, "a pair of 445 N at 1 m"),
    ),
    "Four of the five cases of the three-freedom rig; the fifth, ring on ring, needs a geometry"
    " that is lost.",
    trend=compare_trends,
    scenario=report,
)  # fmt: skip
