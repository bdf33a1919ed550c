"""Does the default ring capture at the corners of the IDSS box?

The International Docking System Standard states its initial contact conditions as limits that all
apply at once. This study draws random corners (every magnitude at its limit, every direction and
sign at random, one fixed seed), applies them at first contact and runs each for 25 s: at both ends
of the band of closing speeds, without and with a thrust of 1.5 kN that starts 0.3 s after first
contact. It prints a table and, with ``-o``, writes one row per case.

Example:
    .venv/bin/python tests/studies/idss_corners.py --corners 32
"""

import argparse
import csv
import math
import multiprocessing
import random
import sys
import tempfile
from pathlib import Path

from dockloop.fmu import build_fmu
from dockloop.simulate import run_fmu

LOADS = ("compression", "tension", "shear", "bending", "torsion")
OUTCOMES = {1: "undecided", 2: "captured", 3: "partial", 4: "rebound", 5: "miss"}


def make_corners(count: int, seed: int = 2026) -> list[list[str]]:
    """Draw corners as scene overrides: limits of the standard, directions and signs at random."""
    draw = random.Random(seed)
    corners = []
    for _ in range(count):
        directions = [draw.uniform(0.0, 360.0) for _ in range(4)]
        signs = [draw.choice((-1.0, 1.0)) for _ in range(2)]
        corners.append(
            [
                "initial.lateral_offset=0.10",
                f"initial.lateral_direction_deg={directions[0]!r}",
                "initial.pitch_yaw_deg=4.0",
                f"initial.pitch_yaw_direction_deg={directions[1]!r}",
                f"initial.roll_deg={4.0 * signs[0]!r}",
                "initial.lateral_speed=0.04",
                f"initial.lateral_speed_direction_deg={directions[2]!r}",
                "initial.pitch_yaw_rate_deg_s=0.2",
                f"initial.pitch_yaw_rate_direction_deg={directions[3]!r}",
                f"initial.roll_rate_deg_s={0.2 * signs[1]!r}",
                "initial.approach_time=0.0",
            ]
        )
    return corners


def run_case(case: tuple) -> dict:
    """Build and run one docking; return its outcome, peaks and audits."""
    scene, speed, thrust, number, corner, extra = case
    overrides = [
        *corner,
        f"initial.closing_speed={speed}",
        f"chaser.contact_thrust={thrust}",
        "chaser.contact_thrust_delay=0.3",
        *extra,
    ]
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(scene, overrides, Path(folder) / "case.fmu")
        run = run_fmu(fmu, stop=25.0, step=0.05)
    row = {"speed": speed, "thrust": thrust, "corner": number}
    row["outcome"] = OUTCOMES[int(run["outcome"][-1])]
    row["time_of_capture"] = float(run["time_of_capture"][-1])
    for load in LOADS:
        row[load] = float(run[f"capture.peak.{load}"][-1])
    lengths = [run[f"leg[{i}].length"] for i in range(1, 7)]
    row["leg_travel_in"] = min(float(length.min() - length[0]) for length in lengths)
    row["leg_travel_out"] = max(float(length.max() - length[0]) for length in lengths)
    row["depth_ratio"] = float(run["contact.depth_ratio"].max())
    row["energy_residual"] = float(abs(run["energy.residual"]).max())
    row["momentum_residual"] = float(run["momentum.residual"].max())
    row["steps"] = int(run["solver.steps"][-1])
    row["rhs_evaluations"] = int(run["solver.rhs_evaluations"][-1])
    return row


def describe(rows: list[dict]) -> str:
    """Condense the cases of one speed and thrust to a line of the table."""
    captured = [row["time_of_capture"] for row in rows if row["outcome"] == "captured"]
    others = ", ".join(
        f"{sum(row['outcome'] == name for row in rows)} {name}"
        for name in ("partial", "rebound", "miss", "undecided")
        if any(row["outcome"] == name for row in rows)
    )
    times = f"{min(captured):.1f} to {max(captured):.1f}" if captured else "-"
    peak = {load: max(row[load] for row in rows) for load in LOADS}
    travel = (
        f"{1e3 * min(row['leg_travel_in'] for row in rows):.0f}"
        f" {1e3 * max(row['leg_travel_out'] for row in rows):+.0f}"
    )
    return (
        f"| {rows[0]['speed']} | {rows[0]['thrust']:.0f} | {len(captured)}/{len(rows)} |"
        f" {others or '-'} | {times} | {peak['compression']:.0f} / {peak['tension']:.0f} /"
        f" {peak['shear']:.0f} | {peak['bending']:.0f} / {peak['torsion']:.0f} | {travel} |"
        f" {max(row['energy_residual'] for row in rows):.1e} |"
        f" {max(row['momentum_residual'] for row in rows):.0e} |"
    )


def main() -> int:
    """Run all cases and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default="idss_25t_350t", help="name or path of the scene")
    parser.add_argument("--corners", type=int, default=32, help="random corners per row")
    parser.add_argument("--workers", type=int, default=multiprocessing.cpu_count())
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the scene")
    parser.add_argument("-o", "--output", type=Path, help="CSV with one row per case")
    options = parser.parse_args()
    corners = make_corners(options.corners)
    cases = [
        (options.scene, speed, thrust, number, corner, options.set)
        for speed in (0.05, 0.10)
        for thrust in (0.0, 1500.0)
        for number, corner in enumerate(corners, 1)
    ]
    rows = []
    with multiprocessing.Pool(options.workers) as pool:
        for row in pool.imap(run_case, cases):
            rows.append(row)
            if sys.stderr.isatty():
                print(f"\r{len(rows)} of {len(cases)}", end="", file=sys.stderr)
    print(
        "| closing speed m/s | thrust N | captured | others | captured after s |"
        " compression / tension / shear N | bending / torsion N m | leg travel mm |"
        " energy residual J | momentum residual |"
    )
    print("|" + "---|" * 10)
    for i in range(0, len(rows), len(corners)):
        print(describe(rows[i : i + len(corners)]))
    if options.output:
        with options.output.open("w", newline="") as file:
            writer = csv.DictWriter(file, fieldnames=list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    assert all(math.isfinite(row["energy_residual"]) for row in rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
