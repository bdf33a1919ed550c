"""Writes what mechanisms with published or exact motions reach: tests/validation/mechanisms.md.

Example:
    .venv/bin/python tests/studies/mechanisms.py         # a minute
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import test_benchmarks as cases
from dockloop.base import paths
from dockloop.fmu.build import build_fmu
from dockloop.fmu.host import run_fmu
from extreme_cases import mechanism_benchmarks as benchmarks
from extreme_cases.own_mechanism import FIXED_BASE, write_scene
from page import Table, write_page

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


def row(what, run, error, rtol):
    """One row of the first table."""
    energy = np.max(np.abs(run["energy.residual"]))
    count = run["solver.rhs_evaluations"][-1]
    return (what, f"{rtol:.0e}", f"{error:.1e}", f"{energy:.1e}", f"{count:.0f}")


def swing(rtol, t):
    """Tip of a chain of one four-bar at time t, by the equation of its exact motion."""
    k = cases.GRAVITY * 6 / 5  # as in find_four_bars_time
    solved = solve_ivp(
        lambda _, x: (x[1], k * np.sin(x[0])), (0, t), (0, 1), "RK45", rtol=rtol, atol=rtol / 10
    )
    return np.array([np.sin(solved.y[0, -1]), np.cos(solved.y[0, -1])])


def list_near_singular():
    """Rows: error of a four-bar after 10 and 20 passages through its singular pose."""
    mechanism = benchmarks.four_bars(1)
    exact = {t: swing(1e-13, t) for t in (10.0, 20.0)}
    table = Table("rtol", "10 s", "20 s", "RK45 on the exact equation, 10 s", "20 s")
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10, 1e-11):
        run = move(mechanism, 20.0, 0.5, rtol, WEIGHT_Y, joint="upright0", start="rate = 1.0")
        tip = run.vector("ring.position")[:, :2]
        ours = [np.max(np.abs(tip[cases.row_at(run, t)] - exact[t])) for t in exact]
        theirs = [np.max(np.abs(swing(rtol, t) - exact[t])) for t in exact]
        table.add(f"{rtol:.0e}", *(f"{error:.0e}" for error in (*ours, *theirs)))
    return table


def list_mechanisms():
    """Rows: one mechanism at one tolerance each."""
    table = Table(
        "mechanism", "rtol", "position error [rad], [m]", "energy error [J]", "evaluations"
    )
    for rtol in (1e-10, 1e-12, 1e-13):
        run = move(benchmarks.andrews(), 0.03, 0.03, rtol)
        error = abs(run["state.q[1]"][-1] - cases.ANDREWS_COMPUTED.angle[0])
        table.add(*row("squeezing mechanism, 0.03 s", run, error, rtol))
    for count, rtol in ((1, 1e-11), (2, 1e-11), (40, 1e-10)):
        four_bars = benchmarks.four_bars(count)
        run = move(four_bars, 10.0, 0.5, rtol, WEIGHT_Y, joint="upright0", start="rate = 1.0")
        exact = cases.FOUR_BARS_EXACT[count, 10][:2]
        error = np.max(np.abs(run.vector("ring.position")[-1, :2] - exact))
        table.add(*row(f"chain of {count} four-bars, 10 s, 10 singular poses", run, error, rtol))
    for kind in ("R2", "R1"):
        worst = []
        for cut in range(1, 7):
            run = move(benchmarks.bricard(cut, kind), 10.0, 0.5, 1e-12, WEIGHT_Y)
            worst += [
                np.max(np.abs(cases.find_bricard_hinge(run, cut, cases.row_at(run, t)) - hinge))
                for t, (_, _, hinge) in cases.BRICARD_COMPUTED.items()
            ]
        name = "universal cuts" if kind == "R2" else "hinge cuts (one equation redundant)"
        table.add(*row(f"overconstrained 6R, 10 s, worst of six {name}", run, max(worst), 1e-12))
    for variant in "ABC":
        crank = benchmarks.spatial_slider_crank(variant, "pin")
        run = move(crank, 5.0, 1.0, 1e-13, WEIGHT_Z, joint="crank", start="rate = 6.0")
        error = abs(run["state.q[1]"][-1] - cases.SPATIAL_COMPUTED[variant, 5][0])
        table.add(*row(f"spatial slider-crank {variant}, 5 s", run, error, 1e-13))
    reference = None
    for independent, rate in (("crank", 10.0), ("slider", -1.0)):
        mechanism = benchmarks.slider_crank(independent)
        run = move(mechanism, 2.0, 0.1, 1e-12, WEIGHT_Y, joint=independent, start=f"rate = {rate}")
        reference = reference or run
        error = np.max(np.abs(run["ring.position[1]"] - reference["ring.position[1]"]))
        turns = (reference["state.q[1]"][-1] - reference["state.q[1]"][0]) / (2 * math.pi)
        what = f"slider-crank, {turns:.1f} turns, {independent} independent"
        table.add(*row(what, run, error, 1e-12))
    return table


def main() -> None:
    """Write the page."""
    write_page(
        paths.ROOT / "tests" / "validation" / "mechanisms.md",
        "Mechanisms with published or exact motions",
        "tests/studies/mechanisms.py",
        list_mechanisms(),
        "## What to expect near singular poses",
        "A four-bar under its weight swings through a pose in which all bars lie on one line, once"
        " a second. Small errors grow with every passage, as for any method of this order on"
        " the equation of the exact motion (the last two columns, `scipy.integrate.solve_ivp`)."
        " Choose `solver.rtol` 100 to 1000 times smaller than the error that you can bear, and 10"
        " times smaller again for twice the time. Error of the tip in m, of 1 m:",
        list_near_singular(),
    )


if __name__ == "__main__":
    main()
