"""What a wanted error costs, now and in an earlier version: tests/validation/speed.md.

Every docking runs through its FMU. The settings of the earlier version are chosen by hand: method
auto, with the loosest relative tolerance of a ladder that has the wanted error. The present version
runs twice: with settings chosen by hand in the same way, and with `accuracy` at that error. The
former shows what the methods give, the latter what remains when the error is promised for any
docking. All run by turns in one process, and the least time inside ``fmi2DoStep`` counts. Without
an earlier version the present one is compared with itself.

Examples:
    git clone . ../before && git -C ../before checkout c645e7a    # before linearly implicit steps
    ../before/scripts/demo && ../before/.venv/bin/pip install -e '../before[sweep]'
    .venv/bin/python tests/studies/speed.py --before ../before      # a quarter of an hour
    .venv/bin/python tests/studies/speed.py --quick -o build/speed.md
"""

import resource
import tempfile
from pathlib import Path
from typing import NamedTuple

import dockloop as dl
from accuracy import FAMILIES, RING
from dockloop.base.errors import DockloopError
from dockloop.base.paths import ROOT, SWEEPS
from dockloop.base.progress import ProgressBar
from dockloop.fmu.host import run_fmu
from dockloop.result.accuracy import list_tolerances
from dockloop.result.recording import Result
from dockloop.result.run_errors import find_error
from idss import SWEEP, make_corners
from page import Table, call, find_commit, make_parser, write_page

PAGE = ROOT / "tests" / "validation" / "speed.md"
STEEP = "mechanism.set.contact.law.friction_speed=1e-5"  # 100 times as steep
GROUPS = 'outputs.groups=["relative", "capture", "phase", "ring", "solver"]'
LADDER = tuple(10.0 ** (-k / 2) for k in range(4, 20))  # relative tolerances, 1e-2 to 3e-10
TIGHT = 1e-11  # of the reference solution, explicit
TURNS, CORNERS, CASES = 5, 4, 512
BEFORE, NOW = (1,), (1, 12)  # methods to choose from: auto; auto, rosenbrock


class Docking(NamedTuple):
    """A docking: its title, overrides of the scene, end [s], communication step [s]."""

    title: str
    overrides: tuple[str, ...]
    stop: float
    step: float


class Cost(NamedTuple):
    """What a run took: evaluations, its error, time in fmi2DoStep [s]."""

    evaluations: float
    error: float
    seconds: float


def list_dockings(*, quick: bool) -> list[tuple[Docking, tuple[float, ...]]]:
    """Return dockings, and the errors that are wanted of each."""
    default = Docking("default docking", (), 20.0, 0.01)
    if quick:
        return [(default._replace(stop=3.0), (1e-3,))]
    steep = Docking("friction 100 times as steep", (STEEP,), 20.0, 0.01)
    corners = [
        Docking(f"corner {i} of the standard", tuple(corner), 25.0, 0.25)
        for i, corner in enumerate(make_corners(CORNERS), 1)
    ]
    return [
        (default, (1e-3, 1e-4, 1e-6)),
        (default._replace(step=1.0), (1e-3, 1e-4, 1e-6)),
        (steep, (1e-3,)),
        *((corner, (1e-3,)) for corner in corners),
    ]


def set_tolerance(method: int, rtol: float) -> list[str]:
    """Return settings: a method, a relative tolerance and absolute ones in proportion."""
    tolerances = [f"{name}={value!r}" for name, value in list_tolerances(rtol).items()]
    return [f"solver.method={method}", *tolerances]


def build(clone: Path, docking: Docking, path: Path) -> Path:
    """Build the FMU of a docking with one version of the project."""
    scene = [word for key in (*docking.overrides, GROUPS) for word in ("--scene", key)]
    call(str(clone / ".venv/bin/dockloop"), "build", RING, "-o", str(path), *scene)
    return path


def run(fmu: Path, docking: Docking, settings: list[str]) -> Result | None:
    """Run an FMU; None if a step is refused."""
    try:
        return run_fmu(fmu, settings, docking.stop, docking.step)
    except DockloopError:
        return None


def choose_by_hand(
    fmu: Path, docking: Docking, reference: Result, wanted: float, methods: tuple[int, ...]
) -> tuple[int, float]:
    """Return the method and its loosest tolerance with the wanted error and least evaluations."""
    found: list[tuple[float, int, float]] = []
    for method in methods:
        for rtol in LADDER:
            made = run(fmu, docking, set_tolerance(method, rtol))
            if made is not None and find_error(reference, made) <= wanted:
                found.append((float(made["solver.rhs_evaluations"][-1]), method, rtol))
                break
    if not found:
        raise SystemExit(f"{docking.title}: no tolerance has an error of {wanted:g}")
    return min(found)[1:]


def compare(
    docking: Docking, fmus: list[Path], references: list[Result], wanted: float
) -> tuple[list[Cost], float]:
    """Return the costs before, now by hand and now by `accuracy`; the tolerance before."""
    before = choose_by_hand(fmus[0], docking, references[0], wanted, BEFORE)
    by_hand = choose_by_hand(fmus[1], docking, references[1], wanted, NOW)
    candidates = (
        (0, set_tolerance(*before)),
        (1, set_tolerance(*by_hand)),
        (1, [f"accuracy={wanted!r}"]),
    )
    turns = [
        [run_fmu(fmus[i], chosen, docking.stop, docking.step) for i, chosen in candidates]
        for _ in range(TURNS)
    ]
    costs = [
        Cost(
            float(made["solver.rhs_evaluations"][-1]),
            find_error(references[candidates[k][0]], made),
            min(turn[k].wall["do_step"] for turn in turns),
        )
        for k, made in enumerate(turns[0])
    ]
    return costs, before[1]


def compare_dockings(clones: tuple[Path, Path], *, quick: bool) -> tuple[Table, float]:
    """Return the table of dockings, and the first tolerance that was chosen by hand."""
    dockings = list_dockings(quick=quick)
    report, chosen = ProgressBar("dockings"), []
    table = Table(
        *("docking", "wanted error", "evaluations: before / by hand / `accuracy`"),
        *("error: before / by hand / `accuracy`", "time before over time by hand"),
        "time before over time with `accuracy`",
    )
    with tempfile.TemporaryDirectory() as folder:
        for i, (docking, errors) in enumerate(dockings):
            fmus = [
                build(clone, docking, Path(folder) / f"{i}_{j}.fmu")
                for j, clone in enumerate(clones)
            ]
            references = [
                run_fmu(fmu, set_tolerance(2, TIGHT), docking.stop, docking.step) for fmu in fmus
            ]
            for wanted in errors:
                costs, rtol = compare(docking, fmus, references, wanted)
                chosen.append(rtol)
                table.add(
                    f"{docking.title}, {docking.stop:g} s at {docking.step:g} s",
                    f"{wanted:g}",
                    " / ".join(f"{cost.evaluations:,.0f}" for cost in costs),
                    " / ".join(f"{cost.error:.0e}" for cost in costs),
                    *(f"{costs[0].seconds / now.seconds:.1f}" for now in costs[1:]),
                )
            report((i + 1) / len(dockings))
    return table, chosen[0]


def time_sweep(clone: Path, keys: dict[str, float], options: list[str], cases: int) -> float:
    """Return the processor time per case of a sweep, reading and writing included [s]."""
    text = (SWEEPS / f"{SWEEP}.toml").read_text(encoding="utf-8")
    settings = "".join(f'"{name}" = {value!r}\n' for name, value in keys.items())
    lines = text.replace("[set]\n", f"[set]\n{settings}").splitlines()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.toml"
        lines = [f"cases = {cases}" if line.startswith("cases") else line for line in lines]
        path.write_text("\n".join(lines), encoding="utf-8")
        words = [str(clone / ".venv/bin/dockloop"), "sweep", str(path), "--engine", "core"]
        began = resource.getrusage(resource.RUSAGE_CHILDREN)
        call(*words, "--no-plots", "-o", f"{folder}/table.parquet", *options)
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime
    return used / cases


def compare_sweeps(clones: tuple[Path, Path], rtol: float, cases: int) -> Table:
    """Return the table of sweeps."""
    before = time_sweep(clones[0], list_tolerances(rtol), [], cases)
    table = Table("wanted error", "cases per second and processor, before / now", "ratio")
    for wanted in (1e-3, 1e-4):
        now = time_sweep(clones[1], {}, ["--accuracy", repr(wanted)], cases)
        table.add(f"{wanted:g}", f"{1 / before:.1f} / {1 / now:.1f}", f"{before / now:.1f}")
    return table


def list_families(*, quick: bool) -> Table:
    """Return the table of the families: evaluations of 20 s."""
    table = Table("scene", "default settings", "`accuracy` 1e-3", "`accuracy` 1e-4")
    for scene in (RING, *FAMILIES):
        cells = []
        for starts in ({}, {"accuracy": 1e-3}, {"accuracy": 1e-4}):
            made = dl.run(scene, None, starts, stop=2.0 if quick else 20.0, step=0.01)
            cells.append(f"{made['solver.rhs_evaluations'][-1]:,.0f}")
        table.add(f"`{scene}`", *cells)
    return table


def main() -> None:
    """Write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument(
        "--before", type=Path, default=ROOT, metavar="CLONE", help="an earlier version, set up"
    )
    parser.add_argument("--quick", action="store_true", help="one short docking, eight cases")
    options = parser.parse_args()
    clones = (options.before.resolve(), ROOT)
    dockings, rtol = compare_dockings(clones, quick=options.quick)
    cases = 8 if options.quick else CASES
    write_page(
        options.output,
        "Speed that accuracy buys",
        "tests/studies/speed.py",
        f"Before: version {find_commit(clones[0])}, method auto, with the loosest relative"
        " tolerance (two in a decade) that has the wanted error. By hand: the present version with"
        " the method auto or rosenbrock and the tolerance chosen in the same way. `accuracy`: the"
        " present version, given only the wanted error. `accuracy` is made to keep it in 95 % of"
        " all dockings, so that most dockings have a smaller error.",
        "The error is the largest relative one of peak loads, stroke, time of capture and final"
        f" motion; the reference solution is that of the explicit method at {TIGHT:g}. Times are"
        f" the least of {TURNS} by turns.",
        dockings,
        f"A sweep of {cases} dockings with the conditions of the standard (25 s each). Before: a"
        f" relative tolerance of {rtol:.0e}, chosen by hand for the default docking and an error of"
        " 1e-3. Processor time includes the start of the program, and the table.",
        compare_sweeps(clones, rtol, cases),
        "Evaluations of 20 s at 10 ms, present version:",
        list_families(quick=options.quick),
    )


if __name__ == "__main__":
    main()
