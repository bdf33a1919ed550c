"""How well do hosts that hold loads over a step couple their vehicles to the FMU?

Runs the dockings of tests/coupling_scenes.py with every scheme of tests/coupling_host.py and steps
from 0.1 to 100 ms against one FMU that integrates both vehicles; tests/validation/coupling.md:

* largest error of the interface velocity over the closing speed, for every step;
* error of the peak loads, of the time of capture, of the final attitude of the chaser;
* momentum that does not add up for an outsider, worst of all steps, over the largest there is;
* what the look-ahead of the parallel mode costs: time in fmi2DoStep over that of the sequential
  mode, of two instances that step in turn.

"x 0.5" and "x 1.5": the FMU receives that share of the true mass and inertia of the vehicles.

The section "Identified vehicles": the worst of five peak loads where the host integrates another
body than the FMU receives (tests/identified_hosts.py), without and with coupling.identify.

Example:
    .venv/bin/python tests/studies/coupling.py --scenes default pressed --steps 1 10 --stop 1
    .venv/bin/python tests/studies/coupling.py --only-identified   # this section of the page alone
"""

import functools
import multiprocessing
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

import identified_hosts
from coupling_host import Coupling
from coupling_scenes import SCENES, TIGHT, compare, equal_steps, run_coupled, run_solution
from dockloop.base import paths
from dockloop.base.palette import BLUE, GREY, NAVY, VERMILION
from dockloop.fmu.build import build_fmu
from page import Table, make_parser, replace_section, write_page, write_table

STUDIED = ("default", "light", "pressed", "both")
STEPS = (0.1, 1.0, 3.0, 10.0, 30.0, 100.0)  # ms
OWN = ("parallel", "sequential")
OTHERS = ("iterated", "end_of_step")
LEAST_ITERATED = 1.0  # ms; below, a run takes an hour
GRID = 1e-3  # s, of the reference solution
SHOWN = 10.0  # ms, step of the columns next to the velocity
FIGURE = paths.MODELS / "figures" / "coupling_errors.png"
PAGE = paths.ROOT / "tests" / "validation" / "coupling.md"


class Runs:
    """Builds every FMU once, in a folder."""

    def __init__(self, folder):
        self.folder = Path(folder)

    @functools.cache
    def fmu(self, scene, *overrides):
        """The FMU of a scene with overrides."""
        number = len(list(self.folder.iterdir()))
        return build_fmu(scene, overrides, self.folder / str(number) / f"{scene}.fmu")


@functools.cache
def find_solution(fmu, name, stop):
    """The reference solution of a scene, once per process."""
    return run_solution(fmu, equal_steps(GRID, stop), SCENES[name].loads)


def run_case(case):
    """Run one scene with one scheme, step and mass. Returns errors (None if it broke) and audit."""
    name, scheme, reported, step, stop, free, driven = case
    scene = SCENES[name]
    sizes = equal_steps(1e-3 * step, stop)
    course = run_coupled(driven, sizes, scheme, reported=reported, loads=scene.loads)
    errors = None
    if not course.broken and np.isfinite(course.velocity).all():
        errors = compare(course, find_solution(free, name, stop), scene)
    return case, errors, course.audit


def find_cost(fmu, name, stop, step=0.01):
    """Time in fmi2DoStep of the parallel mode over that of the sequential one, step by step."""
    scene, spent = SCENES[name], np.zeros(2)
    pairs = [
        Coupling(fmu, scheme, loads=scene.loads, settings=TIGHT, first_step=step) for scheme in OWN
    ]
    for i in range(round(stop / step)):
        for k in (0, 1) if i % 2 else (1, 0):
            doing = pairs[k].host.slave.doStep

            def timed(*arguments, doing=doing, k=k):
                begin = time.perf_counter()
                doing(*arguments)
                spent[k] += time.perf_counter() - begin

            pairs[k].host.slave.doStep = timed
            pairs[k].step(step)
            pairs[k].host.slave.doStep = doing
    for pair in pairs:
        pair.host.free()
    return float(spent[0] / spent[1])


# ---------------------------------------------------------------- tables and figure


def show(value, limit=20.0):
    """A figure of a table; what is not there, or absurd, as a dash."""
    return "-" if value is None or not value < limit else f"{value:.1e}"


def label(scheme, reported):
    """What a row of the table is called."""
    return scheme.replace("_", " ") + ("" if reported == 1.0 else f", mass x {reported:g}")


def make_table(name, results, steps):
    """The table of one scene: results by (scheme, reported, step)."""
    columns = [f"{step:g} ms" for step in steps]
    next_to = SHOWN if SHOWN in steps else steps[0]
    rest = [f"{what}, {next_to:g} ms" for what in ("peak loads", "capture s", "attitude rad")]
    table = Table(f"{name}: velocity error", *columns, *rest, "momentum")
    rows = dict.fromkeys((scheme, reported) for scheme, reported, _ in results)
    for row in rows:
        found = [results.get((*row, step), (None, None)) for step in steps]
        cells = [show(errors and errors.velocity) for errors, _ in found]
        errors = results.get((*row, next_to), (None, None))[0]
        cells += [
            show(errors and getattr(errors, what)) for what in ("peak", "capture", "attitude")
        ]
        cells.append(show(max((audit for e, audit in found if e), default=None)))
        table.add(label(*row), *cells)
    return table


IDENTIFIED = "Identified vehicles"
# One case of each kind; the long test of tests/test_identification.py has all.
STATED = ("mass and inertia x 0.5", "mass and inertia x 2", "inertia x 0.5", "centre y", "fuel")


def find_identified_row(case):
    """A row of the section: scene, case, and errors by step without and with identification."""
    scene, name = case
    errors = [
        identified_hosts.find_error(scene, step, name, identify)[0]
        for step in identified_hosts.AIMS
        for identify in (False, True)
    ]
    return (scene, name, *(show(error) for error in errors))


def make_identified_section(workers):
    """Table of hosts whose vehicle is not as stated."""
    cases = [(scene, name) for scene in identified_hosts.SCENES for name in STATED]
    columns = [
        f"{1e3 * step:g} ms, {used}"
        for step in identified_hosts.AIMS
        for used in ("as stated", "identified")
    ]
    rows = []
    with multiprocessing.Pool(workers) as pool:
        for row in pool.imap(find_identified_row, cases):
            rows.append(row)
            report_progress(len(rows), len(cases))
    return [
        "Error of the worst of five peak loads against one FMU with the right numbers, with a"
        " parallel host. `centre`: the host reports a point 0.1 m from its centre of mass. `fuel`:"
        " 5 % of mass and inertia leave in 4 s, against a host that reports each new mass.",
        write_table(("scene", "stated", *columns), rows),
    ]


def draw(results, steps, file):
    """Velocity error over the step, one panel per scene."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    rows, columns = -(-len(results) // 2), min(len(results), 2)
    figure, axes = plt.subplots(
        rows, columns, figsize=(4.2 * columns, 3.4 * rows), sharex=True, sharey=True, squeeze=False
    )
    styles = {"parallel": "o", "sequential": "x", "iterated": "^", "end_of_step": "s"}
    colours = {1.0: BLUE, 0.5: VERMILION, 1.5: NAVY}
    for axis, (name, found) in zip(axes.flat, results.items(), strict=False):
        for scheme, reported in dict.fromkeys((scheme, reported) for scheme, reported, _ in found):
            line = [
                (step, errors.velocity)
                for step in steps
                if (errors := found.get((scheme, reported, step), (None, None))[0])
                and errors.velocity < 20.0
            ]
            if not line or (scheme == "sequential" and reported != 1.0):
                continue
            axis.loglog(
                *zip(*line, strict=True),
                marker=styles[scheme],
                color=colours.get(reported, GREY) if scheme in OWN else "0.45",
                linestyle="--" if scheme == "sequential" else "-",
                linewidth=1.0,
                markersize=4.0,
                label=label(scheme, reported),
            )
        axis.set_title(name, fontsize=10)
        axis.grid(alpha=0.3)
    figure.supxlabel("communication step [ms]", fontsize=10)
    figure.supylabel("velocity error / closing speed", fontsize=10)
    axes[0][0].legend(fontsize=7, loc="upper left", ncols=2)
    figure.tight_layout()
    figure.savefig(file, dpi=110)


def report_progress(done, count):
    """Draw a progress bar on a terminal."""
    if sys.stderr.isatty():
        filled = 40 * done // count
        bar = "#" * filled + "." * (40 - filled)
        print(f"\r[{bar}] {done} of {count}", end="", file=sys.stderr, flush=True)


def make_cases(options, fmus):
    """All runs, long ones last: a host's scheme is tried with wrong masses where it is ours."""
    cases = []
    for name in options.scenes:
        for scheme in options.schemes:
            for reported in options.reported if scheme in OWN else [1.0]:
                for step in options.steps:
                    if scheme == "iterated" and step < LEAST_ITERATED:
                        continue
                    cases.append((name, scheme, reported, step, options.stop, *fmus[name]))
    return cases


def main():
    """Run all cases, print and write tables."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=STUDIED)
    parser.add_argument("--schemes", nargs="+", choices=OWN + OTHERS, default=OWN + OTHERS)
    parser.add_argument("--steps", nargs="+", type=float, default=STEPS, help="ms")
    parser.add_argument("--reported", nargs="+", type=float, default=(1.0, 0.5, 1.5))
    parser.add_argument("--stop", type=float, default=3.0, help="s, a multiple of all steps")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument(
        "--figure", nargs="?", type=Path, const=FIGURE, help=f"PNG; default {paths.shown(FIGURE)}"
    )
    parser.add_argument("--only-identified", action="store_true", help=f"section '{IDENTIFIED}'")
    options = parser.parse_args()
    identified = make_identified_section(options.workers)
    if options.only_identified:
        command = "tests/studies/coupling.py --only-identified"
        page = options.output.read_text(encoding="utf-8")
        if f"\n## {IDENTIFIED}\n" not in page:
            options.output.write_text(f"{page}\n## {IDENTIFIED}\n", encoding="utf-8")
        replace_section(options.output, IDENTIFIED, command, *identified)
        return 0
    for step in options.steps:
        count = 1e3 * options.stop / step
        if count < 1.0 or abs(count - round(count)) > 1e-6:
            parser.error(f"--stop {options.stop:g} s is not a multiple of --steps {step:g} ms")
    results, texts = {name: {} for name in options.scenes}, []
    with tempfile.TemporaryDirectory(prefix="dockloop-") as folder:
        runs = Runs(folder)
        fmus = {
            name: (SCENES[name].build(runs, free=True), SCENES[name].build(runs))
            for name in options.scenes
        }
        cases = make_cases(options, fmus)
        with multiprocessing.Pool(options.workers) as pool:
            for done, (case, errors, audit) in enumerate(pool.imap(run_case, cases), 1):
                name, scheme, reported, step = case[:4]
                results[name][scheme, reported, step] = (errors, audit)
                report_progress(done, len(cases))
        texts += [make_table(name, found, options.steps) for name, found in results.items()]
        costs = ", ".join(
            f"{name} {find_cost(fmus[name][1], name, min(options.stop, 1.0)):.2f}"
            for name in options.scenes
        )
    texts.append(f"Time of a step of 10 ms, parallel over sequential mode: {costs}")
    command = f"tests/studies/coupling.py --stop {options.stop:g} --steps"
    command += "".join(f" {step:g}" for step in options.steps)
    texts += [f"## {IDENTIFIED}", *identified]
    write_page(options.output, "Vehicles that a host integrates", command, *texts)
    if options.figure:
        draw(results, options.steps, options.figure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
