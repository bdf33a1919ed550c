"""How well reference solutions are known.

Runs scenes with 32 digits at a tolerance, and again at 1000 times that tolerance. Written to
tests/validation/reference_solutions.md: evaluations, and the largest difference of each output.

    .venv/bin/python tests/studies/reference_solutions.py            # some minutes
"""

from dockloop.base.paths import ROOT
from dockloop.runs.solution import make_solution
from page import Table, write_page

RUNS = {  # scene: outputs, end and communication step [s]
    "absorber_1d": (["relative.axial", "capture.force[1]"], 5.0, 0.1),
    "hexapod_bench": (["ring.position[1]", "ring.velocity[1]"], 5.0, 0.1),
    "idss_25t_350t": (["relative.position[2]", "capture.force[1]", "energy.residual"], 4.0, 0.1),
}


def main() -> None:
    """Write the page."""
    table = Table(
        *("scene", "end s", "evaluations"),
        *("output", "difference from 1000 times the tolerance"),
    )
    for scene, (outputs, stop, step) in RUNS.items():
        solution = make_solution(scene, outputs, stop=stop, step=step, check=True)
        for name, apart in solution["check"]["difference"].items():
            work = int(solution["work"]["evaluations"])
            cells = (scene, f"{stop:g}", work, f"`{name}`", f"{apart:.0e}")
            table.add(*cells)
    write_page(
        ROOT / "tests" / "validation" / "reference_solutions.md",
        "Reference solutions",
        "tests/studies/reference_solutions.py",
        "Runs with 32 digits at a relative tolerance of 1e-18 (`dockloop truth SCENE --check`)."
        " Kinks of the contact force need most of the evaluations.",
        table,
    )


if __name__ == "__main__":
    main()
