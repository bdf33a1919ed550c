"""Measure mechanisms with gears against the code without closed forms and against Pinocchio.

``scripts/bench --families`` calls this module. Two families: six screws (hexapod), six screws and
ten shafts of differentials (apda). Programs take turns as in ``bench.py``.
"""

import argparse
import json
import shutil
import sys
from datetime import date
from pathlib import Path

from benchmarks import bench, mechanisms, report
from dockloop.base import paths

FAMILIES = {
    "hexapod": "six legs with screws",
    "apda": "six screws, ten shafts of differentials",
}
PAGE = Path(__file__).parent / "families.md"
WANTED = 10  # times the accelerations of the core
CODES = {  # with what they compute
    "no closed forms": "accelerations",
    "Pinocchio, multipliers by hand": "with reactions",
    "Pinocchio, reduced by hand": "accelerations",
}
TEXT = """Inertia, bias forces and accelerations at 16 states near home, without force elements,
which all codes need. `general` is the core. `no closed forms` is the core with loops closed by
iteration and gears as bodies of the tree.

Pinocchio has no row among the coordinates of several joints. So inertia, Jacobian and bias come
from Pinocchio, and the solution from `peers/pinocchio_geared.hpp`. *Multipliers by hand* takes all
rows of loops and gears, dense, as any mechanism could be solved. *Reduced by hand* eliminates gears
and legs of this kind of mechanism, as dockloop does. It finds no cut forces."""


def take_family(name: str) -> dict:
    """Return the mechanism of a family, written out as bodies, loops and gears, with states."""
    document = json.loads((paths.MECHANISMS / f"{name}.json").read_text())
    if "couplings" in document:
        return mechanisms.take(document)
    start = json.loads((bench.DATA / "hexapod_bench.json").read_text())["initial"]
    return mechanisms.expand(document, start)


def list_programs(folder: Path, peers: list[str], quick: bool) -> dict[str, list[str]]:
    """Return the command of each program that is there."""
    google = bench.list_options(quick)
    files = [str(paths.MECHANISMS / f"{name}.json") for name in FAMILIES]
    what = "--benchmark_filter=/(accelerations|with reactions)$"
    commands = {"mechanism_bench": [*files, what, *google]}
    if "pinocchio" in peers:
        states = [str(folder / f"{name}_states.json") for name in FAMILIES]
        commands["pinocchio_bench"] = [*states, *google]
    return bench.find_programs(commands)


def list_aims(figures: dict) -> str:
    """Compare each code with the core."""
    rows = []
    for name in FAMILIES:
        core = figures[f"{name}/general/accelerations"]["ns"]
        for code, what in CODES.items():
            if (figure := figures.get(f"{name}/{code}/{what}")) is None:
                continue
            ratio = figure["ns"] / core
            met = "yes" if ratio > WANTED else "no"
            rows.append([f"{name}, {code} / general", f"{ratio:.3g}", f"> {WANTED}", met])
    return report.table(["aim", "measured", "wanted", "met"], rows)


def make_page(figures: dict, head: str) -> str:
    """Return the page."""
    parts = ["# Benchmarks of mechanisms with gears", head, TEXT, "## Aims", list_aims(figures)]
    for name, title in FAMILIES.items():
        parts += [f"## {name}: {title}", report.evaluations_table(figures, name)]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", default="pinocchio", help="comma-separated, or none")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rounds", type=int, default=None)
    parser.add_argument("--page", action="store_true")
    options = parser.parse_args()
    rounds = options.rounds or (1 if options.quick else 5)
    folder = paths.BUILD / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    for name in FAMILIES:
        bench.add_expected(take_family(name), folder)
    programs = list_programs(folder, options.peers.split(","), options.quick)
    figures = bench.measure(programs, rounds)
    command = " ".join(["scripts/bench --families", *sys.argv[1:]])
    head = (
        f"Made by `{command}` on {date.today().isoformat()}: {report.describe_machine()};"
        f" {rounds} rounds, least times. Compare figures of one report only."
    )
    file = folder / PAGE.name
    file.write_text(make_page(figures, head), encoding="utf-8")
    if options.page:
        shutil.copy(file, PAGE)
    print(paths.shown(file))


if __name__ == "__main__":
    main()
