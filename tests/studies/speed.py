"""What a wanted error costs, and what default settings give: tests/validation/speed.md.

Every docking runs through its FMU: with default settings, with a method and tolerance chosen by
hand for the wanted error, and with `accuracy` at that error. Settings by hand show what the methods
give, `accuracy` what remains when the error is promised for any docking. All run by turns in one
process, and the least time inside ``fmi2DoStep`` counts.

Examples:
    .venv/bin/python tests/studies/speed.py                           # a quarter of an hour
    .venv/bin/python tests/studies/speed.py --quick -o build/speed.md
"""

import resource
import tempfile
from functools import partial
from pathlib import Path
from typing import NamedTuple

import dockloop as dl
from accuracy import FAMILIES, RING
from dockloop.base.errors import DockloopError
from dockloop.base.paths import ROOT, SWEEPS
from dockloop.base.progress import ProgressBar
from dockloop.fmu.build import build_fmu
from dockloop.fmu.host import run_fmu
from dockloop.result.accuracy import list_tolerances
from dockloop.result.recording import Result
from dockloop.result.run_errors import find_error
from idss import SWEEP, make_corners
from page import Table, call, make_parser, write_page

PAGE = ROOT / "tests" / "validation" / "speed.md"
STEEP = "mechanism.set.contact.law.friction_speed=1e-5"  # 100 times as steep
GROUPS = 'outputs.groups=["relative", "capture", "phase", "ring", "solver"]'
LADDER = tuple(10.0 ** (-k / 2) for k in range(4, 20))  # relative tolerances, 1e-2 to 3e-10
TIGHT = 1e-11  # of the reference solution, explicit
TURNS, CORNERS, CASES = 5, 4, 512
METHODS = (1, 12)  # to choose from by hand: auto, rosenbrock
DIALS = (1e-3, 1e-4)  # values of `accuracy` that default settings are compared with


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


def build(docking: Docking, path: Path) -> Path:
    """Build the FMU of a docking."""
    return build_fmu(RING, (*docking.overrides, GROUPS), path, bare=True)


def run(fmu: Path, docking: Docking, settings: list[str]) -> Result | None:
    """Run an FMU; None if a step is refused."""
    try:
        return run_fmu(fmu, settings, docking.stop, docking.step)
    except DockloopError:
        return None


def choose_by_hand(fmu: Path, docking: Docking, reference: Result, wanted: float) -> list[str]:
    """Return the loosest settings of a method with the wanted error and least evaluations."""
    found: list[tuple[float, list[str]]] = []
    ladders = [[set_tolerance(method, rtol) for rtol in LADDER] for method in METHODS]
    for ladder in ([[]], *ladders):
        for settings in ladder:
            made = run(fmu, docking, settings)
            if made is not None and find_error(reference, made) <= wanted:
                found.append((float(made["solver.rhs_evaluations"][-1]), settings))
                break
    if not found:
        raise SystemExit(f"{docking.title}: no tolerance has an error of {wanted:g}")
    return min(found)[1]


def compare(fmu: Path, docking: Docking, reference: Result, wanted: float) -> list[Cost]:
    """Return the costs with default settings, by hand and by `accuracy`."""
    by_hand = choose_by_hand(fmu, docking, reference, wanted)
    candidates = ([], by_hand, [f"accuracy={wanted!r}"])
    turns = [
        [run_fmu(fmu, chosen, docking.stop, docking.step) for chosen in candidates]
        for _ in range(TURNS)
    ]
    return [
        Cost(
            float(made["solver.rhs_evaluations"][-1]),
            find_error(reference, made),
            min(turn[k].wall["do_step"] for turn in turns),
        )
        for k, made in enumerate(turns[0])
    ]


def compare_dockings(*, quick: bool) -> Table:
    """Return the table of dockings."""
    dockings = list_dockings(quick=quick)
    report = ProgressBar("dockings")
    table = Table(
        *("docking", "wanted error", "evaluations: default / by hand / `accuracy`"),
        *("error: default / by hand / `accuracy`", "time of default settings over time by hand"),
        "over time with `accuracy`",
    )
    with tempfile.TemporaryDirectory() as folder:
        for i, (docking, errors) in enumerate(dockings):
            fmu = build(docking, Path(folder) / f"{i}.fmu")
            reference = run_fmu(fmu, set_tolerance(2, TIGHT), docking.stop, docking.step)
            for wanted in errors:
                costs = compare(fmu, docking, reference, wanted)
                table.add(
                    f"{docking.title}, {docking.stop:g} s at {docking.step:g} s",
                    f"{wanted:g}",
                    " / ".join(f"{cost.evaluations:,.0f}" for cost in costs),
                    " / ".join(f"{cost.error:.0e}" for cost in costs),
                    *(f"{costs[0].seconds / other.seconds:.1f}" for other in costs[1:]),
                )
            report((i + 1) / len(dockings))
    return table


def time_sweep(options: list[str], cases: int) -> float:
    """Return the processor time per case of a sweep, reading and writing included [s]."""
    text = (SWEEPS / f"{SWEEP}.toml").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.toml"
        lines = text.splitlines()
        lines = [f"cases = {cases}" if line.startswith("cases") else line for line in lines]
        path.write_text("\n".join(lines), encoding="utf-8")
        words = [str(ROOT / ".venv/bin/dockloop"), "sweep", str(path), "--engine", "core"]
        began = resource.getrusage(resource.RUSAGE_CHILDREN)
        call(*words, "--no-plots", "-o", f"{folder}/table.parquet", *options)
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime
    return used / cases


def compare_sweeps(cases: int) -> Table:
    """Return the table of sweeps."""
    default = time_sweep([], cases)
    table = Table("settings", "cases per second and processor", "over default settings")
    table.add("default", f"{1 / default:.1f}", "1")
    for wanted in DIALS:
        dial = time_sweep(["--accuracy", repr(wanted)], cases)
        table.add(f"`accuracy` {wanted:g}", f"{1 / dial:.1f}", f"{default / dial:.1f}")
    return table


def list_families(*, quick: bool) -> tuple[Table, str]:
    """Return the table of the shipped mechanisms, evaluations and errors; and what it says."""
    table = Table("scene", "default settings", *(f"`accuracy` {dial:g}" for dial in DIALS))
    errors, ratios = [], []
    for scene in (RING, *FAMILIES):
        run_scene = partial(dl.run, scene, None, stop=2.0 if quick else 20.0, step=0.01)
        tight = list_tolerances(TIGHT) | {"solver.method": 2}
        reference = run_scene(tight)
        made = [run_scene({} if dial is None else {"accuracy": dial}) for dial in (None, *DIALS)]
        counts = [float(each["solver.rhs_evaluations"][-1]) for each in made]
        found = [find_error(reference, each) for each in made]
        cells = zip(counts, found, strict=True)
        table.add(f"`{scene}`", *(f"{count:,.0f}, {error:.0e}" for count, error in cells))
        errors.append(found[0])
        ratios.append(counts[0] / counts[-1])
    cheaper = sum(ratio < 1.0 for ratio in ratios)
    says = (
        f"Default settings have errors of at most {max(errors):.0e} here. They take"
        f" {min(ratios):.1f} to {max(ratios):.1f} times the evaluations of `accuracy`"
        f" {DIALS[-1]:g}, and fewer for {cheaper} of {len(ratios)} mechanisms. So no value of"
        " `accuracy` serves all users better, and the default stays as it is: it promises nothing,"
        " and `accuracy` does."
    )
    return table, says


def main() -> None:
    """Write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--quick", action="store_true", help="one short docking, eight cases")
    options = parser.parse_args()
    cases = 8 if options.quick else CASES
    write_page(
        options.output,
        "Speed that accuracy buys",
        "tests/studies/speed.py",
        "Default: nothing is set. By hand: default settings, or the method auto or rosenbrock with"
        " the loosest relative tolerance (two in a decade) that has the wanted error. `accuracy`:"
        " only the wanted error is given. It is made to keep it in 95 % of all dockings, so that"
        " most dockings have a smaller error.",
        "The error is the largest relative one of peak loads, stroke, time of capture and final"
        f" motion; the reference solution is that of the explicit method at {TIGHT:g}. Times are"
        f" the least of {TURNS} by turns.",
        compare_dockings(quick=options.quick),
        f"A sweep of {cases} dockings with the conditions of the standard (25 s each). Processor"
        " time includes the start of the program, and the table.",
        compare_sweeps(cases),
        "## What default settings give",
        "Evaluations and error, 20 s at 10 ms:",
        *list_families(quick=options.quick),
    )


if __name__ == "__main__":
    main()
