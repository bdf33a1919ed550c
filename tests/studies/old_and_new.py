"""Do dockings end as before two changes of November 2026? Writes tests/validation/old_and_new.md.

1. The ring of `idss_hexapod` stands 0.28 m in front of its mating plane (commit ce09316); it stood
   in that plane.
2. `auto` takes linearly implicit steps where stability limits explicit ones (commit a7f0f88); with
   the tolerances of the shipped scenes it was the method `stabilised`.

*Before* is this version with both turned back: the legs, the ring and the docking interface of the
chaser lie where they were, and `solver.method` is `stabilised`. The vehicles then pass through each
other, which is a limit that is watched and changes nothing.

Examples:
    .venv/bin/python tests/studies/old_and_new.py                    # some minutes on two cores
    .venv/bin/python tests/studies/old_and_new.py --corners 2 --cases 4 -o build/old_and_new.md
"""

import json
import os
from collections.abc import Iterable
from multiprocessing.pool import ThreadPool
from typing import Any, NamedTuple

import numpy as np

import dockloop as dl
from dockloop.base.number import to_plain
from dockloop.base.paths import MECHANISMS, ROOT, SWEEPS
from dockloop.native.core import list_loads
from dockloop.scene.resolve import OPEN_KEYS, parse_value, scene_members
from dockloop.sweeps.sampling import read_sweep
from idss import SCENE, SPEEDS, SWEEP, make_corners
from page import Block, Table, make_parser, write_page, write_points

PAGE = ROOT / "tests" / "validation" / "old_and_new.md"
LOADS = list_loads()
MOVED = 0.28  # m, along x
FAMILIES = ("hexapod", "apda", "probe_drogue")
METHOD = {"solver.method": "stabilised"}
Settings = dict[str, Any]


class End(NamedTuple):
    """What became of a docking: outcome, seconds from first contact to capture, peak loads."""

    outcome: str
    capture: float
    peaks: np.ndarray


class Pair(NamedTuple):
    """A docking before and now; why it did not run, if it did not."""

    before: End | str
    now: End | str


def put_ring_back() -> Settings:
    """Return the settings with which the ring stands in its mating plane, on the same vehicle."""
    legs = json.loads((MECHANISMS / "idss_hexapod.json").read_text(encoding="utf-8"))["legs"]
    a = dl.Scene(SCENE).document["chaser"]["interface_position"]
    moved = {
        f"mechanism.set.legs.{leg['name']}.root_point": leg["root_point"] - MOVED * np.eye(3)[0]
        for leg in legs
    }
    return to_plain(
        moved
        | {"mechanism.set.bodies.ring.joint.position": np.zeros(3)}
        | {"chaser.interface_position": a + MOVED * np.eye(3)[0]}
    )


def run_one(scene: str, overrides: Settings, start_values: Settings, stop: float) -> End | str:
    """Run a docking with communication steps of 0.05 s."""
    try:
        run = dl.run(scene, overrides, start_values, stop=stop, step=0.05)
    except dl.DockloopError as error:
        return str(error)
    capture = run["time_of_capture"][-1] - run["time_of_contact"][-1]
    peaks = np.array([run[f"capture.peak.{load}"][-1] for load in LOADS])
    return End(run.outcome, float(capture) if capture > 0.0 else np.nan, peaks)


def run_pairs(
    pool: ThreadPool, scene: str, cases: Iterable[Settings], back: Settings, stop: float
) -> list[Pair]:
    """Run dockings with some keys of the scene and start values, before and now."""

    def run(case: Settings) -> Pair:
        is_key = {name: name in scene_members() or name.startswith(OPEN_KEYS) for name in case}
        keys = {name: value for name, value in case.items() if is_key[name]}
        starts = {name: value for name, value in case.items() if not is_key[name]}
        before = run_one(scene, keys | back, starts | METHOD, stop)
        return Pair(before, run_one(scene, keys, starts, stop))

    return pool.map(run, cases, 1)


def describe(name: str, pairs: list[Pair]) -> tuple[object, ...]:
    """Condense pairs to a row of the table."""
    ran = [p for p in pairs if isinstance(p.before, End) and isinstance(p.now, End)]
    same = [p for p in ran if p.before.outcome == p.now.outcome]
    both = [p for p in same if np.isfinite(p.before.capture + p.now.capture)]
    # Loads are compared where outcomes are the same, each with the largest load of its docking.
    off = [
        float(np.abs(p.now.peaks - p.before.peaks).max() / max(p.before.peaks.max(), 1e-12))
        for p in same
    ]
    late = [abs(p.now.capture - p.before.capture) for p in both]
    cells = [
        f"{side(p).capture:.1f}" if np.isfinite(side(p).capture) else side(p).outcome
        for p in ran
        for side in (lambda p: p.before, lambda p: p.now)
    ]
    spans = [_span(cells[::2]), _span(cells[1::2])]
    largest = [
        " / ".join(f"{value:.0f}" for value in np.max([e.peaks for e in ends], axis=0))
        for ends in ([p.before for p in ran], [p.now for p in ran])
    ]
    return (
        name,
        f"{len(ran)} of {len(pairs)}",
        f"{sum(p.before.outcome == 'captured' for p in ran)}",
        f"{sum(p.now.outcome == 'captured' for p in ran)}",
        len(ran) - len(same),
        *spans,
        *largest,
        f"{max(off, default=0.0):.1e}",
        f"{np.median(off) if off else 0.0:.1e}",
        f"{1e3 * max(late, default=0.0):.2g}",
    )


def _span(cells: list[str]) -> str:
    """Return least and largest of those that are numbers."""
    numbers = sorted(float(cell) for cell in cells if cell[0].isdigit())
    return f"{numbers[0]:.1f} to {numbers[-1]:.1f}" if numbers else "-"


HEAD = (
    *("dockings", "run", "captured before", "now", "other outcome"),
    *("s to capture before", "now"),
    *(f"largest {' / '.join(LOADS)} before", "now"),
    *("largest difference of a peak", "median", "of the time of capture, ms"),
)


def list_other_outcomes(names: list[str], pairs: list[Pair]) -> list[str]:
    """Return a sentence per docking that ends otherwise, or is refused."""
    points = []
    for name, pair in zip(names, pairs, strict=True):
        ends = [end.outcome if isinstance(end, End) else "refused" for end in pair]
        if ends[0] != ends[1]:
            points.append(f"{name}: {ends[0]} before, {ends[1]} now.")
        elif isinstance(pair.now, str):
            points.append(f"{name}: refused before and now: {pair.now.splitlines()[0]}.")
    return points


def study_idss(pool: ThreadPool, corners: int, cases: int) -> list[Block]:
    """Corners of the box, and the box by the first cases of the shipped sweep."""
    back, table, others = put_ring_back(), Table(*HEAD), []
    drawn = [
        {key: parse_value(text) for key, _, text in (entry.partition("=") for entry in corner)}
        for corner in make_corners(corners)
    ]
    for speed in SPEEDS:
        for thrust in (0.0, 1500.0):
            more = {
                "initial.closing_speed": speed,
                "chaser.contact_thrust": thrust,
                "chaser.contact_thrust_delay": 0.3,
            }
            pairs = run_pairs(pool, SCENE, [case | more for case in drawn], back, 25.0)
            name = f"corners, {speed} m/s, {thrust:.0f} N"
            table.add(*describe(name, pairs))
            others += list_other_outcomes([f"{name}, {i + 1}" for i in range(corners)], pairs)
    box = list_cases(SWEEP, cases)
    pairs = run_pairs(pool, SCENE, box, back, 25.0)
    table.add(*describe("inside the box", pairs))
    others += list_other_outcomes([f"inside the box, case {i + 1}" for i in range(cases)], pairs)
    return [table, write_points(others) or "No docking ends otherwise."]


def study_families(pool: ThreadPool) -> list[Block]:
    """The shipped contact cases in their nominal condition; only the method is another one."""
    table, others = Table(*HEAD), []
    for family in FAMILIES:
        cases = [c for c in list_cases(f"contact_cases_{family}") if _is_nominal(c)]
        pairs = run_pairs(pool, family, cases, {}, 30.0)
        table.add(*describe(family, pairs))
        names = [f"`{family}`, {case}" for case in map(_say, cases)]
        others += list_other_outcomes(names, pairs)
    return [table, write_points(others) or "No docking ends otherwise."]


def _is_nominal(case: Settings) -> bool:
    return not any(name.startswith(("chaser.contact_", "failure", "mechanism.")) for name in case)


def _say(case: Settings) -> str:
    return ", ".join(f"{name} {value}" for name, value in case.items())


def list_cases(name: str, count: int | None = None) -> list[Settings]:
    """Return what the first cases of a shipped sweep set."""
    sweep = read_sweep(str(SWEEPS / f"{name}.toml"))
    cases = []
    for row in range(len(sweep.cases) if count is None else count):
        case = dict(sweep.document["set"])
        for quantity, value in zip(sweep.quantities, sweep.cases[row], strict=True):
            case |= quantity.settings(value)
        cases.append(case)
    return cases


def main() -> None:
    """Measure and write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--corners", type=int, default=8, help="random corners per row")
    parser.add_argument("--cases", type=int, default=32, help="of the sweep of the box")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    options = parser.parse_args()
    with ThreadPool(options.workers) as pool:
        idss = study_idss(pool, options.corners, options.cases)
        families = study_families(pool)
    write_page(
        options.output,
        "Dockings before and after two changes",
        f"tests/studies/old_and_new.py --corners {options.corners} --cases {options.cases}",
        "Two changes of November 2026 touched the shipped dockings. The default ring stands 0.28 m"
        " in front of its mating plane; it stood in that plane. The method `auto` takes linearly"
        " implicit steps where stability limits explicit ones; it was the method `stabilised`.",
        "*Before* is this version with both turned back by settings. The old versions themselves"
        " did not run. Loads are in N and N m. A difference of a peak is relative to the largest"
        " load of its docking. Differences are those of dockings with the same outcome.",
        "## IDSS",
        f"Scene `{SCENE}`, 25 s. Corners have every magnitude at the limit of the standard, and"
        " random directions. Both changes are turned back.",
        idss,
        "## Families",
        "The shipped contact cases in their nominal condition, 30 s. The rings stood in front of"
        " their mating planes before, so only the method is turned back.",
        families,
    )


if __name__ == "__main__":
    main()
