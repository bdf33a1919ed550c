"""Writes a list of what simulations reach: tests/validation/figures.md.

Example:
    .venv/bin/python tests/studies/figures.py
"""

import json
import math
import sys
import tempfile
from pathlib import Path

import numpy as np

from dockloop.base.paths import ROOT
from dockloop.fmu.build import build_fmu
from dockloop.fmu.host import run_fmu
from dockloop.native.core import name_choice
from dockloop.scene.mechanism import check_mechanism
from page import Table, write_page

DATA = Path(__file__).resolve().parents[1] / "data"
STRAIGHT = [
    f"initial.{name}=0.0"
    for name in (
        "pitch_yaw_deg",
        "roll_deg",
        "lateral_speed",
        "pitch_yaw_rate_deg_s",
        "roll_rate_deg_s",
        "approach_time",
    )
]


LINES = Table("what", "figure")


def show(what: str, figure: str) -> None:
    """Add one line to the list."""
    LINES.add(what, figure)


def run(scene: str, *overrides: str, **options):
    """Build a scene with overrides and run it."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(scene, list(overrides), Path(folder) / f"{scene}.fmu", bare=True)
        return run_fmu(fmu, **options)


def relative_difference(ours, theirs) -> float:
    """Largest difference over the largest expected number, through lists and dictionaries."""
    if isinstance(theirs, dict):
        return max(relative_difference(ours[key], theirs[key]) for key in theirs)
    ours, theirs = np.array(ours), np.array(theirs)
    return float(np.max(np.abs(ours - theirs)) / max(np.max(np.abs(theirs)), 1e-300))


def vectors() -> None:
    """Accelerations, cut forces and base loads against independently computed ones."""
    for name in ("hexapod_r2p1r3", "crank_nested", "planar_two_loop"):
        file = DATA / f"{name}.json"
        expected = [state["expected"] for state in json.loads(file.read_text())["states"]]
        worst = max(
            relative_difference(state[key], reference[key])
            for state, reference in zip(check_mechanism(str(file), file), expected, strict=True)
            for key in reference
        )
        show(f"{name}: worst relative difference of all results", f"{worst:.1e}")


def bench() -> None:
    """The free ring on six legs against its reference motion."""
    reference = json.loads((DATA / "hexapod_bench_reference.json").read_text())
    result = run("hexapod_bench")
    error = result.vector("ring.position") - np.array(reference["p"])
    show("hexapod_bench: largest ring position error", f"{np.abs(error).max():.1e} m")


def absorber() -> None:
    """Peak forces and speed ratios of the exactly known absorber."""
    mass, stiffness, speed = 25e3 * 350e3 / 375e3, 20e3, 0.1
    worst = 0.0
    at_once = speed * math.sqrt(stiffness * mass)  # undamped, and at first contact for zeta 0.5
    for zeta, peak in ((0.0, at_once), (0.1, None), (0.5, at_once)):
        ratio = math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2))
        damping = 2.0 * zeta * math.sqrt(stiffness * mass)
        result = run(
            "absorber_1d",
            f"mechanism.set.contact.damping={damping!r}",
            "mechanism.set.contact.pulls=true",
        )
        returned = float(result["relative.velocity[1]"][-1]) / speed
        worst = max(worst, abs(returned - ratio) / ratio)
        if peak:
            worst = max(worst, abs(result["capture.peak.compression"][-1] / peak - 1.0))
    show("absorber_1d: worst relative error of peaks and speed ratios", f"{worst:.1e}")


def docking() -> None:
    """Audit and price of the default docking."""
    result = run("idss_25t_350t")
    energy = 0.5 * (25e3 * 350e3 / 375e3) * 0.1**2
    residual = float(np.abs(result["energy.residual"]).max()) / energy
    show("idss_25t_350t: outcome", name_choice("outcome", result["outcome"][-1]))
    show("the same: energy residual / initial relative energy", f"{residual:.1e}")
    show("the same: momentum residual, relative", f"{result['momentum.residual'].max():.1e}")
    share = result.wall["do_step"] / result.wall["loop"]
    show("the same: share of the time through FMPy inside fmi2DoStep", f"{share:.0%}")
    evaluations = int(result["solver.rhs_evaluations"][-1])
    show("the same: evaluations in 20 s by 10 ms", f"{evaluations}")


def fast() -> None:
    """1 m/s, offset by up to 0.2 m: nothing slips through."""
    for offset in (0.0, 0.1, 0.2):
        result = run(
            "idss_25t_350t",
            *STRAIGHT,
            "initial.closing_speed=1.0",
            f"initial.lateral_offset={offset}",
        )
        deepest = float(result["contact.depth_ratio"].max())
        travel = float((result["ring.position[1]"] - result["ring.position[1]"][0]).min())
        residual = float(np.abs(result["energy.residual"]).max())
        show(
            f"1 m/s, lateral offset {offset} m",
            f"depth {deepest:.2f} of the rounding, ring {travel:+.2f} m from home,"
            f" residual {residual:.0e} J of 11 667 J,"
            f" {name_choice('outcome', result['outcome'][-1])}",
        )


def lateral() -> None:
    """Pure lateral offset at 0.10 m/s in the direction of an active and of a passive petal."""
    for offset in (0.1, 0.2, 0.3, 0.45):
        found = [
            run(
                "idss_25t_350t",
                *STRAIGHT,
                f"initial.lateral_offset={offset}",
                f"initial.lateral_direction_deg={direction}.0",
                stop=25.0,
                step=0.05,
            )
            for direction in (0, 60)
        ]
        show(
            f"lateral offset {offset} m towards an active / a passive petal",
            " / ".join(name_choice("outcome", result["outcome"][-1]) for result in found),
        )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(__doc__)
        sys.exit(0 if sys.argv[1] in ("-h", "--help") else 2)
    for part in (vectors, bench, absorber, docking, fast, lateral):
        part()
    page = ROOT / "tests" / "validation" / "figures.md"
    write_page(page, "Figures", "tests/studies/figures.py", LINES)
