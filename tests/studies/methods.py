"""What methods and levels cost and reach in the default docking: tests/validation/methods.md.

Every run goes through the FMU, always integrated (``model.flight`` 2). Times are ratios of the time
inside ``fmi2DoStep`` to that of a run with the default settings, made by turns with it.

Examples:
    .venv/bin/python tests/studies/methods.py            # ten minutes
    .venv/bin/python tests/studies/methods.py --quick    # two communication steps of each
"""

import tempfile
from pathlib import Path

import numpy as np

from dockloop.base import paths
from dockloop.base.errors import DockloopError
from dockloop.base.progress import ProgressBar
from dockloop.fmu.build import build_fmu
from dockloop.fmu.host import run_fmu
from dockloop.native.compiled import add_comparison
from dockloop.native.core import list_different_methods
from page import Table, make_parser, write_page

PAGE = paths.ROOT / "tests" / "validation" / "methods.md"
SCENE, BENCH, STOP = "idss_25t_350t", "hexapod_bench", 20.0
LONG = (5.0, 0.1)  # end and step [s]
STEEP = "mechanism.set.contact.law.friction_speed=1e-5"  # 100 times as steep
GROUPS = 'outputs.groups=["relative", "capture", "phase", "ring", "legs", "solver"]'
PEAK = "capture.peak.compression"
LEVELS = {
    1: "rigid: one body with the chaser, locked at the start pose",
    2: "massless_legs: masses of leg parts go to foot and head",
    3: "reduced: nothing is left out",
}
TURNS = 5  # of which the shortest time counts
TIGHT = ["solver.rtol=1e-11", "solver.atol_position=1e-13", "solver.atol_velocity=1e-13"]


class Study:
    """FMUs built once, a number of runs still to make."""

    def __init__(self, folder: Path, runs: int, *, quick: bool) -> None:
        self._folder, self._fmus, self._quick = folder, {}, quick
        self._report, self._done, self._runs = ProgressBar("methods"), 0, runs

    def run(self, scene, overrides, settings, stop, step):
        """Run; returns the recording, or None if a step was refused."""
        key = (scene, *overrides)
        if key not in self._fmus:
            fmu = self._folder / f"{len(self._fmus)}.fmu"
            self._fmus[key] = build_fmu(
                scene, [*overrides, GROUPS], fmu, bare=True, finish=add_comparison
            )
        self._done += 1
        self._report(min(1.0, self._done / self._runs))
        stop = min(stop, 2 * step) if self._quick else stop
        try:
            return run_fmu(self._fmus[key], ["model.flight=2", *settings], stop, step)
        except DockloopError:
            return None


def count(run):
    """Evaluations of a run, rounded to a hundred."""
    return "refused" if run is None else f"{run['solver.rhs_evaluations'][-1]:,.0f}"


def list_methods(study):
    """Rows: evaluations and peaks of every method, and with steep friction."""
    scenes = {"plain": [], "steep": [STEEP]}
    exact = study.run(SCENE, [], [*TIGHT, "solver.method=2"], STOP, 0.01)[PEAK][-1]
    table = Table(
        *("`solver.method`", "what it is for", "evaluations, 10 ms / 1 s"),
        *("peak load off by", "steep friction, 10 ms / 1 s"),
    )
    for row in list_different_methods():
        method, name, purpose = row["number"], row["name"], row["meaning"]
        purpose = f"to compare with: {purpose}" if row["for_comparison"] else purpose
        settings = [f"solver.method={method}", *(["model.level=4"] if method == 9 else [])]
        runs = {
            (scene, step): study.run(SCENE, scenes[scene], settings, STOP, step)
            for scene in scenes
            for step in (0.01, 1.0)
        }
        off = [
            abs(run[PEAK][-1] / exact - 1) for key, run in runs.items() if run and key[0] == "plain"
        ]
        table.add(
            f"{method} {name}",
            purpose,
            " / ".join(count(runs["plain", step]) for step in (0.01, 1.0)),
            " / ".join(f"{each:.0e}" for each in off),
            " / ".join(count(runs["steep", step]) for step in (0.01, 1.0)),
        )
    return table


def list_forms(study):
    """Rows: the reduced form next to three forms with multipliers, in long steps."""
    kinds = {
        "2 explicit": ["solver.method=2"],
        "6 bdf": ["solver.method=6"],
        **{f"9 dae, form {i}": ["model.level=4", f"solver.dae_form={i}"] for i in (1, 2, 3)},
    }
    table = Table(
        *("`solver.rtol`", "method", "hexapod: evaluations, time", "error, gap m"),
        *("docking: evaluations, time", "error, gap m"),
    )
    ends = {
        scene: study.run(scene, [], [*TIGHT, "solver.method=2"], *LONG) for scene in (BENCH, SCENE)
    }
    for rtol in (1e-4, 1e-6, 1e-8):
        tolerances = [
            f"solver.rtol={rtol}",
            *(f"solver.atol_{kind}={rtol / 100}" for kind in ("position", "velocity", "energy")),
        ]
        for name, settings in kinds.items():
            cells = []
            for scene, exact in ends.items():
                pairs = [
                    [
                        study.run(scene, [], [*tolerances, *chosen], *LONG)
                        for chosen in (settings, ["solver.method=2"])
                    ]
                    for _ in range(TURNS)
                ]
                run = pairs[0][0]
                if run is None:
                    cells += [count(run), "-"]
                    continue
                ring = [each.vector("ring.position")[-1] for each in (run, exact)]
                best = [min(pair[i].wall["do_step"] for pair in pairs) for i in (0, 1)]
                cells += [
                    f"{count(run)}, {best[0] / best[1]:.1f}",
                    f"{np.linalg.norm(ring[0] - ring[1]):.0e},"
                    f" {run['solver.closure_residual'][-1]:.0e}",
                ]
            table.add(f"{rtol:.0e}", name, *cells)
    return table


def list_levels(study):
    """Rows: what each level leaves out and what that changes."""
    table = Table(
        *("`model.level`", "compression N", "shear N", "ring travel mm", "captured at s"),
        *("evaluations", "time per evaluation"),
    )
    turns = [
        {level: study.run(SCENE, [], [f"model.level={level}"], STOP, 0.01) for level in LEVELS}
        for _ in range(TURNS)
    ]
    cost = {
        level: min(turn[level].wall["do_step"] for turn in turns)
        / turns[0][level]["solver.rhs_evaluations"][-1]
        for level in LEVELS
    }
    for level, name in LEVELS.items():
        run = turns[0][level]
        ring = run.vector("ring.position")
        travel = 1e3 * np.max(np.linalg.norm(ring - ring[0], axis=1))
        table.add(
            f"{level} {name}",
            f"{run[PEAK][-1]:.0f}",
            f"{run['capture.peak.shear'][-1]:.0f}",
            f"{travel:.0f}",
            f"{run['time_of_capture'][-1]:.3f}" if run["captured"][-1] else "not captured",
            count(run),
            f"{cost[level] / cost[3]:.2f}",
        )
    return table


def main() -> None:
    """Write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--quick", action="store_true", help="two communication steps only")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        runs = 1 + 4 * len(list_different_methods()) + 2 + 3 * 5 * 4 * TURNS + TURNS * len(LEVELS)
        study = Study(Path(folder), runs, quick=options.quick)
        write_page(
            options.output,
            "Methods and levels in the default docking",
            "tests/studies/methods.py",
            "## Methods",
            f"{STOP:g} s of `{SCENE}`, always integrated (`model.flight` 2), `solver.rtol` 1e-6,"
            " `solver.step` 1 ms, communication"
            " steps of 10 ms and of 1 s. A Jacobian counts as one evaluation per column: that is"
            " its cost. The peak load is compared with method 2 at a tolerance of 1e-11. Steep"
            f" friction: `--scene {STEEP}`.",
            list_methods(study),
            "## The reduced form and forms with multipliers",
            f"{LONG[0]:g} s in communication steps of {LONG[1]:g} s, absolute tolerances a"
            " hundredth of the relative one. Times are in units of that of method 2, the shortest"
            " of five by turns. Error: position of the ring at the end. Gap: what the loops are"
            " open by. Refused: one communication step needs more work than its limit."
            " `solver.dae_form` 1 holds loops by accelerations (index 1), 2 the same with"
            " Baumgarte stabilisation, 3 by velocities and positions (stabilised index 2).",
            list_forms(study),
            "## Levels of the model",
            f"{STOP:g} s of `{SCENE}` in communication steps of 10 ms; time per evaluation as a"
            " ratio to level 3.",
            list_levels(study),
        )


if __name__ == "__main__":
    main()
