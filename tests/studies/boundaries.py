"""Where dockings succeed and how rarely they fail, against known answers: boundaries.md.

A capture boundary and a rare failure in closed form (tests/pawls.py), the boundary of the default
docking over offset and speed with the number of dockings of a grid, and a rare load of the IDSS box
against a plain sweep. Written to tests/validation/boundaries.md.

Examples:
    .venv/bin/python tests/studies/boundaries.py                          # some ten minutes
    .venv/bin/python tests/studies/boundaries.py --quick -o build/boundaries.md
"""

import argparse
import math
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import dockloop as dl
from dockloop.base import paths
from dockloop.base.figures import save_figure
from dockloop.report.sweep import estimate_fraction
from dockloop.sweeps.rare import run_rare
from dockloop.sweeps.sampling import read_sweep
from page import Block, Table, make_parser, write_page
from pawls import FORCE, PUSH, SCENE, SPEED, STRAIGHT, SWEEP, find_area, find_speed, sample_failures

COMMAND = "tests/studies/boundaries.py"
PAGE = paths.ROOT / "tests" / "validation" / "boundaries.md"
OFFSETS, SPEEDS = ("initial.lateral_offset", 0.0, 0.2), ("initial.closing_speed", 0.01, 0.15)
CRITERIA = ("captured within 5 s", "captured within 5 s and load_ratio < 1")
RARE_LOAD, BOX = "load_ratio > 0.37", "idss_initial_conditions"
STOP, APPROACH = 6.0, 0.1  # s, of dockings of the box: the end, free motion before contact
PLAIN, LEVEL = 1024, 200  # dockings: of the plain sweep, in each level
SEEDS = range(1, 4)
AIM = 5.0  # times fewer dockings than a grid


# ------------------------------------------------ boundaries


def describe_box(*axes: tuple[str, float, float]) -> str:
    """Say over which quantities a boundary is looked for."""
    texts = [f"`{name}` from {low:g} to {high:g}" for name, low, high in axes]
    return f"Box: {' and '.join(texts)}, in SI units."


def add_cost(table: Table, envelope: Any) -> None:
    """Add the rows about the number of dockings."""
    found = envelope.summary
    ratio, checks = found["grid_over_dockings"], found["checks"]
    verdict = "met" if ratio >= AIM else "**missed**"
    differ = f"{checks['points']}, {checks['differ']} differ"
    table.add("boundary within", f"{found['uncertainty']:.2%} of each range")
    table.add("dockings", found["dockings"])
    table.add("dockings of a grid of the same resolution", found["grid"])
    table.add(f"times fewer (aim: {AIM:g})", f"{ratio:.1f}, {verdict}")
    table.add("checks at random away from the boundary", differ)


def list_known(options: argparse.Namespace) -> list[Block]:
    """The boundary in closed form."""
    found = dl.envelope(
        SCENE, SPEED, FORCE, criteria="captured", overrides=STRAIGHT, stop=8.0, step=1.0,
        tolerance=0.1 if options.quick else None, coarse=4 if options.quick else None,
    )  # fmt: skip
    points, edge = found.points, found.boundary[found.boundary["along"] == SPEED[0]]
    known = points[SPEED[0]] > find_speed(points[FORCE[0]])
    wrong = int((points["captured"] != known).sum())
    errors = np.abs(edge[SPEED[0]] - find_speed(edge[FORCE[0]])) / (SPEED[2] - SPEED[1])
    (criterion,) = found.summary["criteria"]
    part = f"{criterion['met']:.2%} +- {criterion['unsure']:.2%}"
    table = Table("figure", "value")
    add_cost(table, found)
    table.add("dockings on the wrong side of the closed form", wrong)
    table.add("largest error of the boundary, part of the range of speeds", f"{errors.max():.2%}")
    table.add("captured part of the box", part)
    table.add("closed form", f"{find_area():.2%}")
    return [table]


def list_default(options: argparse.Namespace) -> list[Block]:
    """The boundary of the default docking."""
    found = dl.envelope(
        SCENE, OFFSETS, SPEEDS, criteria=CRITERIA, stop=10.0, step=0.5,
        tolerance=0.125 if options.quick else None, coarse=4 if options.quick else None,
        checks=4 if options.quick else 64,
    )  # fmt: skip
    figure = options.output.parent / "figures" / "boundaries.png"
    figure.parent.mkdir(parents=True, exist_ok=True)
    save_figure(found.plot(), figure, COMMAND)
    table = Table("figure", "value")
    add_cost(table, found)
    for each in found.summary["criteria"]:
        part = f"{each['met']:.2%} +- {each['unsure']:.2%} of the box"
        table.add(f"`{each['text']}`", part)
    return [table, f"![Where the default docking is captured](figures/{figure.name})"]


# ------------------------------------------------ rare failures


def write_box(folder: Path, cases: int, sampling: str) -> Path:
    """Write the box of the standard with another number of cases and another end."""
    text = (paths.SWEEPS / f"{BOX}.toml").read_text(encoding="utf-8")
    document = tomllib.loads(text)
    for old, new in (
        (f"cases = {document['cases']}", f"cases = {cases}"),
        (f'sampling = "{document["sampling"]}"', f'sampling = "{sampling}"'),
        (f"stop = {document['experiment']['stop']}", f"stop = {STOP}"),
        ('"initial.approach_time" = 0.5', f'"initial.approach_time" = {APPROACH}'),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / f"box_{sampling}.toml"
    path.write_text(text, encoding="utf-8")
    return path


def list_estimates(
    path: Path, failure: str, exact: tuple[float, float], options: argparse.Namespace
) -> Table:
    """Estimate a rare failure with several seeds, next to an interval of the answer."""
    text = path.read_text(encoding="utf-8")
    table = Table(
        *("seed", "part that fails", "95 % interval", "meets the answer", "dockings"),
        *("plain sampling for the same interval", "times fewer"),
    )
    for seed in list(SEEDS)[: 1 if options.quick else None]:
        document = tomllib.loads(text)
        path.write_text(text.replace(f"seed = {document['seed']}\n", f"seed = {seed}\n"))
        level = 50 if options.quick else LEVEL
        found = run_rare(read_sweep(str(path)), failure, level, path.with_suffix(f".{seed}.jsonl"))
        meets = found["low"] <= exact[1] and exact[0] <= found["high"]
        table.add(
            seed,
            f"{found['probability']:.2e}",
            f"{found['low']:.2e} to {found['high']:.2e}",
            "yes" if meets else "**no**",
            found["dockings"],
            found["plain_dockings"],
            f"{found['plain_dockings'] / found['dockings']:.1f}",
        )
    return table


def list_pawls(options: argparse.Namespace) -> list[Block]:
    """A rare failure in closed form."""
    samples = 4_000_000
    part = sample_failures(samples)
    half = 1.96 * math.sqrt(part / samples)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pawls.toml"
        path.write_text(SWEEP, encoding="utf-8")
        lines = list_estimates(path, "not captured", (part - half, part + half), options)
    answer = f"Answer: {part:.3e} +- {half:.0e}, {samples} samples of the closed form."
    return [answer, lines]


def list_loads(options: argparse.Namespace) -> list[Block]:
    """A rare load of the IDSS box, next to a plain sweep."""
    cases = 64 if options.quick else PLAIN
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table = dl.sweep(write_box(folder, cases, "random"))
        refused = table["status"] != "done"
        limit = float(RARE_LOAD.rpartition(" ")[2])
        count = int((refused | (table["capture.peak.load_ratio"] > limit)).sum())
        plain = estimate_fraction(count, cases)
        box = write_box(folder, cases, "sobol")
        lines = list_estimates(box, RARE_LOAD, (plain["low"], plain["high"]), options)
    answer = (
        f"Answer: {count} of {cases} dockings of a plain sweep, {plain['fraction']:.2e}"
        f" (95 % interval {plain['low']:.2e} to {plain['high']:.2e}). {refused.sum()} of them did"
        " not run; both methods count these as failures."
    )
    return [answer, lines]


# ------------------------------------------------ page

SECTIONS = {
    "A boundary that is known": (
        f"Three pawls stop an approach without enough energy. {describe_box(SPEED, FORCE)}",
        list_known,
    ),
    "The boundary of the default docking": (
        f"Scene `{SCENE}`. {describe_box(OFFSETS, SPEEDS)}",
        list_default,
    ),
    "A rare failure that is known": (
        f"Pawls of {PUSH:g} N, a speed with a normal distribution, an uncertain mass. Failure:"
        " `not captured`.",
        list_pawls,
    ),
    "A rare load of the box of the standard": (
        f"The shipped sweep `{BOX}` with an end at {STOP:g} s. Failure: `{RARE_LOAD}`. This failure"
        " is frequent enough for a plain sweep, which is the answer here.",
        list_loads,
    ),
}


def main(words: list[str] | None = None) -> None:
    """Write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--quick", action="store_true", help="a small sample of each section")
    options = parser.parse_args(words)
    if options.output == PAGE and options.quick:
        parser.error("--quick needs another page: -o build/boundaries.md")
    blocks: list[Block] = []
    for title, (text, make) in SECTIONS.items():
        blocks += [f"## {title}", text, make(options)]
        print(title, flush=True)
    head = "Where dockings succeed, and how rarely they fail"
    write_page(options.output, head, COMMAND, *blocks)


if __name__ == "__main__":
    main()
