"""Does the default ring capture under the conditions of the IDSS? Writes tests/validation/idss.md.

The International Docking System Standard states its initial contact conditions as limits that all
apply at once. Three tables, each for the shipped ring and for variants of it:

1. capture over closing speed and lateral offset, 4 deg of tilt and roll: is it monotone?
2. random corners (every magnitude at its limit, every direction and sign at random, one fixed
   seed) at both ends of the band of closing speeds, without and with a thrust of 1.5 kN that starts
   0.3 s after first contact;
3. the box inside these limits, by the shipped sweep.

Examples:
    .venv/bin/python tests/studies/idss.py                       # a quarter of an hour on two cores
    .venv/bin/python tests/studies/idss.py --corners 4 --cases 16 -o build/idss.md
"""

import os
import random
import sys
import tempfile
import tomllib
from multiprocessing.pool import Pool
from pathlib import Path

import numpy as np
from pyarrow import parquet

from dockloop.base.paths import ROOT, SWEEPS
from dockloop.base.progress import ProgressBar
from dockloop.fmu.build import build_fmu
from dockloop.fmu.host import run_fmu
from dockloop.native.core import list_loads, name_choice
from dockloop.sweeps.run import run_sweep
from dockloop.sweeps.sampling import read_sweep
from dockloop.sweeps.table import write_table as write_rows
from page import Block, Table, make_parser, write_page, write_table

SCENE, SWEEP = "idss_25t_350t", "idss_initial_conditions"
PAGE = ROOT / "tests" / "validation" / "idss.md"
LOADS = list_loads()
SPEEDS = (0.05, 0.1)
OFFSETS = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1)

_HARDWARE = "mechanism.set.contact"
VARIANTS = {
    "the shipped ring": [],
    "loose petals (the default until November 2026: base corners at r = 0.585 m, 28 deg)": [
        f"{_HARDWARE}.petal_base_radius=0.585",
        f"{_HARDWARE}.petal_base_half_angle_deg=28",
    ],
    "stiffer legs (7.1 kN/m, 4.6 kN s/m each)": [
        "mechanism.set.leg_defaults.stiffness=7100",
        "mechanism.set.leg_defaults.damping=4600",
    ],
}


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


def run_case(overrides: list[str]) -> dict:
    """Build and run one docking of 25 s; return its outcome, peaks and audits."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(SCENE, overrides, Path(folder) / "case.fmu", bare=True)
        run = run_fmu(fmu, stop=25.0, step=0.05)
    lengths = [run[f"leg[{i}].length"] for i in range(1, 7)]
    return {
        "outcome": name_choice("outcome", run["outcome"][-1]),
        "capture": float(run["time_of_capture"][-1] - run["time_of_contact"][-1]),
        **{load: float(run[f"capture.peak.{load}"][-1]) for load in LOADS},
        "in": min(float(length.min() - length[0]) for length in lengths),
        "out": max(float(length.max() - length[0]) for length in lengths),
        "energy": float(abs(run["energy.residual"]).max()),
        "momentum": float(run["momentum.residual"].max()),
    }


def list_others(outcomes: list[str]) -> str:
    """Return how many cases ended in what, but for captures."""
    names = sorted({name for name in outcomes if name != "captured"})
    return ", ".join(f"{outcomes.count(name)} {name}" for name in names) or "no others"


def describe_corners(speed: float, thrust: float, rows: list[dict]) -> tuple[object, ...]:
    """Condense the cases of one speed and thrust to a line of the table."""
    captured = [row["capture"] for row in rows if row["outcome"] == "captured"]
    peak = {load: max(row[load] for row in rows) for load in LOADS}
    return (
        speed,
        f"{thrust:.0f}",
        f"{len(captured)}/{len(rows)}",
        list_others([row["outcome"] for row in rows]),
        f"{min(captured):.1f} to {max(captured):.1f}" if captured else "-",
        f"{peak['compression']:.0f} / {peak['tension']:.0f} / {peak['shear']:.0f}",
        f"{peak['bending']:.0f} / {peak['torsion']:.0f}",
        f"{1e3 * min(r['in'] for r in rows):.0f} {1e3 * max(r['out'] for r in rows):+.0f}",
        f"{max(row['energy'] for row in rows):.1e}",
        f"{max(row['momentum'] for row in rows):.0e}",
    )


def study_offsets(pool: Pool, extra: list[str]) -> Table:
    """Capture over closing speed and lateral offset."""
    at_limit = ["initial.pitch_yaw_deg=4.0", "initial.roll_deg=4.0", "initial.approach_time=0.5"]
    cases = [
        [*at_limit, f"initial.closing_speed={v}", f"initial.lateral_offset={y}", *extra]
        for v in SPEEDS
        for y in OFFSETS
    ]
    rows = pool.map(run_case, cases, 1)
    cells = [
        f"{row['capture']:.1f}" if row["outcome"] == "captured" else row["outcome"] for row in rows
    ]
    n = len(OFFSETS)
    head = ("closing speed m/s", *(f"{y:g} m" for y in OFFSETS))
    return write_table(head, ((v, *cells[i * n : i * n + n]) for i, v in enumerate(SPEEDS)))


def study_corners(pool: Pool, count: int, extra: list[str]) -> Table:
    """All limits of the standard at once."""
    corners = make_corners(count)
    table = Table(
        *("closing speed m/s", "thrust N", "captured", "others", "captured after s"),
        *("compression / tension / shear N", "bending / torsion N m", "leg travel mm"),
        *("energy residual J", "momentum residual"),
    )
    for speed in SPEEDS:
        for thrust in (0.0, 1500.0):
            more = [
                f"initial.closing_speed={speed}",
                f"chaser.contact_thrust={thrust}",
                "chaser.contact_thrust_delay=0.3",
                *extra,
            ]
            rows = pool.map(run_case, [[*corner, *more] for corner in corners], 1)
            table.add(*describe_corners(speed, thrust, rows))
    return table


def study_box(count: int, workers: int, extra: list[str]) -> list[Block]:
    """The box inside the limits: the shipped sweep, its first `count` cases."""
    source = (SWEEPS / f"{SWEEP}.toml").read_text(encoding="utf-8")
    document = tomllib.loads(source)
    sets = "".join(f'"{key}" = {value}\n' for key, value in (e.split("=") for e in extra))
    text = source.replace(f"cases = {document['cases']}", f"cases = {count}")
    text = text.replace("[set]\n", f"[set]\n{sets}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{SWEEP}.toml"
        file.write_text(text, encoding="utf-8")
        sweep = read_sweep(str(file))
        output = Path(folder) / "box.parquet"
        ran = run_sweep(sweep, output, workers=workers, progress=ProgressBar("box"))
        write_rows(sweep, ran["planner"], ran["results"], None, output)
        table = parquet.read_table(output).to_pydict()
    done = np.array(table["status"]) == "done"
    outcome = [str(name) for name in np.array(table["outcome"])[done]]
    captured = np.array([name == "captured" for name in outcome])
    offset = np.array(table["initial.lateral_offset"])[done]
    quarter = np.argsort(offset)
    n = len(quarter) // 4
    contact, capture = (
        np.array(table[f"time_of_{name}"], dtype=float)[done] for name in ("contact", "capture")
    )  # NaN where it never came
    after = capture - contact
    text = (
        f"{count} cases, {int(done.sum())} run, {int(count - done.sum())} refused or failed:"
        f" {int(captured.sum())} captured, {list_others(outcome)}. Of the quarter with the smallest"
        f" lateral offsets {int(captured[quarter[:n]].sum())} of {n} were captured, of that with"
        f" the largest {int(captured[quarter[-n:]].sum())}. Half of the captures took less than"
        f" {np.median(after[captured]):.1f} s from first contact, the longest"
        f" {after[captured].max():.1f} s."
    )
    peaks = Table("peak load", "median", "95 %", "99 %", "largest")
    for load, unit in LOADS.items():
        values = np.array(table[f"capture.peak.{load}"], dtype=float)[done]
        cells = [f"{np.quantile(values, q):.0f}" for q in (0.5, 0.95, 0.99, 1.0)]
        peaks.add(f"{load} {unit}", *cells)
    return [text, peaks]


def main() -> int:
    """Run all cases and write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--corners", type=int, default=32, help="random corners per row")
    parser.add_argument("--cases", type=int, default=512, help="of the sweep: a power of two")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    options = parser.parse_args()
    command = f"tests/studies/idss.py --corners {options.corners} --cases {options.cases}"
    blocks: list[Block] = [
        f"Scene `{SCENE}`, runs of 25 s. Variants are made with `--scene KEY=VALUE`; what a passive"
        " ring does not capture is reported, not tuned away. `dockloop check` says how far seated"
        " rings of a variant can play, and whether their latches can still catch then.",
    ]
    with Pool(options.workers) as pool:
        for name, extra in VARIANTS.items():
            print(name, file=sys.stderr)
            keys = " ".join(f"--scene {key}" for key in extra)
            blocks += [
                f"## {name[0].upper()}{name[1:]}",
                f"`{keys}`" if keys else "",
                "Seconds from first contact to capture over closing speed and lateral offset; tilt"
                " and roll 4 deg:",
                study_offsets(pool, extra),
                f"{options.corners} random corners a row (every limit of the standard at once):",
                study_corners(pool, options.corners, extra),
                "Inside the limits (`dockloop sweep idss_initial_conditions`):",
                study_box(options.cases, options.workers, extra),
            ]
    title = "Capture under the conditions of the IDSS"
    write_page(options.output, title, command, *blocks)
    return 0


if __name__ == "__main__":
    sys.exit(main())
