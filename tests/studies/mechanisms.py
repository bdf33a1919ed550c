"""Prints what mechanisms with published or exact motions reach, through the FMU, as a table.

Example:
    .venv/bin/python tests/studies/mechanisms.py
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mechanism_benchmarks as benchmarks
import test_benchmarks as cases
from dockloop.fmu import build_fmu
from dockloop.simulate import run_fmu
from own_mechanism import FIXED_BASE, write_scene

WEIGHT_Y = {"gravity[2]": -cases.GRAVITY}
WEIGHT_Z = {"gravity[3]": -cases.GRAVITY}


def move(mechanism, stop, step, rtol, weight=None, *, joint=None, start=""):
    """Run one mechanism on a fixed base."""
    sections = [FIXED_BASE, f"[experiment]\nstop = {stop}\nstep = {step}"]
    if joint:
        sections.append(f"[initial.joints.{joint}]\n{start}")
    sections.append('[outputs]\ngroups = ["ring", "states", "loops", "energy", "solver"]')
    settings = [f"{name}={value!r}" for name, value in (weight or {}).items()]
    with tempfile.TemporaryDirectory() as folder:
        scene = write_scene(Path(folder), mechanism, *sections, solver=cases.SOLVER)
        fmu = build_fmu(scene, (), Path(folder) / "own.fmu")
        return run_fmu(fmu, (*settings, *cases.find_tolerances(rtol)), stop, step)


def show(what, run, error, rtol):
    """Print one row."""
    energy = np.max(np.abs(run["energy.residual"]))
    count = run["solver.rhs_evaluations"][-1]
    print(f"| {what} | {rtol:.0e} | {error:.1e} | {energy:.1e} | {count:.0f} |", flush=True)


def main() -> None:
    """Print the table."""
    print("| mechanism | rtol | position error [rad], [m] | energy error [J] | right-hand sides |")
    print("|---|---|---|---|---|")
    for rtol in (1e-10, 1e-12, 1e-13):
        run = move(benchmarks.andrews(), 0.03, 0.03, rtol)
        error = abs(run["state.q[1]"][-1] - cases.ANDREWS_COMPUTED.angle[0])
        show("squeezing mechanism, 0.03 s", run, error, rtol)
    for count, rtol in ((1, 1e-11), (2, 1e-11), (40, 1e-10)):
        four_bars = benchmarks.four_bars(count)
        run = move(four_bars, 10.0, 0.5, rtol, WEIGHT_Y, joint="upright0", start="rate = 1.0")
        exact = cases.FOUR_BARS_EXACT[count, 10][:2]
        error = np.max(np.abs(run.vector("ring.position")[-1, :2] - exact))
        show(f"chain of {count} four-bars, 10 s, 10 singular poses", run, error, rtol)
    for kind in ("R2", "R1"):
        worst = []
        for cut in range(1, 7):
            run = move(benchmarks.bricard(cut, kind), 10.0, 0.5, 1e-12, WEIGHT_Y)
            worst += [
                np.max(np.abs(cases.find_bricard_hinge(run, cut, cases.row_at(run, t)) - hinge))
                for t, (_, _, hinge) in cases.BRICARD_COMPUTED.items()
            ]
        name = "universal cuts" if kind == "R2" else "hinge cuts (one equation redundant)"
        show(f"overconstrained 6R, 10 s, worst of six {name}", run, max(worst), 1e-12)
    for variant in "ABC":
        crank = benchmarks.spatial_slider_crank(variant, "pin")
        run = move(crank, 5.0, 1.0, 1e-13, WEIGHT_Z, joint="crank", start="rate = 6.0")
        error = abs(run["state.q[1]"][-1] - cases.SPATIAL_COMPUTED[variant, 5][0])
        show(f"spatial slider-crank {variant}, 5 s", run, error, 1e-13)
    reference = None
    for independent, rate in (("crank", 10.0), ("slider", -1.0)):
        mechanism = benchmarks.slider_crank(independent)
        run = move(mechanism, 2.0, 0.1, 1e-12, WEIGHT_Y, joint=independent, start=f"rate = {rate}")
        reference = reference or run
        error = np.max(np.abs(run["ring.position[1]"] - reference["ring.position[1]"]))
        turns = (reference["state.q[1]"][-1] - reference["state.q[1]"][0]) / (2 * math.pi)
        show(f"slider-crank, {turns:.1f} turns, {independent} independent", run, error, 1e-12)


if __name__ == "__main__":
    main()
