"""What is known and what is assumed in every family. Writes tests/validation/parameters.md.

Every group of assumed numbers is scaled by 0.8 and by 1.25, all others stay. An elasticity is the
change of a result in per cent for one per cent of the group. It holds near the shipped scene only.

Example:
    .venv/bin/python tests/validation/published/parameters.py    # some minutes
"""

import math
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "studies"))

import json

from models import read_shipped

import dockloop as dl
from dockloop.base import paths
from page import Block, write_page, write_table

PAGE = paths.ROOT / "tests" / "validation" / "parameters.md"
LOW, HIGH = 0.8, 1.25
END, STEP = 12.0, 0.05  # s
LEAST = 0.1  # elasticity that is worth a measurement
START = {"initial.approach_time": 0.5}
Change = Callable[[dict, float], None]
WORDS = f"""\
Each number is an elasticity: by how many per cent a result changes if one group of numbers grows
by one per cent. It is found from two runs, with the group times {LOW:g} and times {HIGH:g}, the
other groups unchanged. The scenes are the shipped ones, {END:g} s long, with
{START["initial.approach_time"]:g} s of approach. Groups with the largest effect on any result come
first. A small change can change the order of impacts, so small elasticities say little. A dash: a
run without this result. With other vehicles or other initial conditions the order may differ: run
the script again with your own scene."""


# ------------------------------------------------ groups of numbers, and how they are scaled


def list_laws(mechanism: dict, name: str, kind: str) -> Iterator[dict]:
    """Yield the laws of one kind of all elements whose name begins like this."""
    for force in mechanism["forces"]:
        if force["name"].startswith(name):
            yield from (law for law in force["laws"] if law["type"] == kind)


def scale_springs(name: str) -> Change:
    """Scale stiffness and preload."""

    def change(mechanism: dict, factor: float) -> None:
        for law in list_laws(mechanism, name, "spring"):
            law["stages"] = [[start, factor * stiffness] for start, stiffness in law["stages"]]
            law["preload"] = factor * law.get("preload", 0.0)

    return change


def scale_laws(name: str, kind: str, *members: str) -> Change:
    """Scale members of laws."""

    def change(mechanism: dict, factor: float) -> None:
        for law in list_laws(mechanism, name, kind):
            law.update({member: factor * law[member] for member in members})

    return change


def scale_bodies(pattern: str) -> Change:
    """Scale mass and inertia of bodies."""

    def change(mechanism: dict, factor: float) -> None:
        for body in mechanism["bodies"]:
            if re.fullmatch(pattern, body["name"]):
                body["mass"] = factor * body.get("mass", 0.0)
                if "inertia" in body:
                    body["inertia"] = [[factor * v for v in row] for row in body["inertia"]]

    return change


def scale_members(*place: str) -> Change:
    """Scale one number of a part of the file; a law of contact also for its nodes."""

    def change(mechanism: dict, factor: float) -> None:
        part = mechanism
        for name in place[:-1]:
            part = part[name]
        for name in {place[-1], f"node_{place[-1]}"} & set(part):
            part[name] *= factor

    return change


CONTACT = {
    "stiffness of the contact": scale_members("contact", "law", "stiffness"),
    "force of the pawls": scale_members("latches", "push_force"),
    "stiffness of the latches": scale_members("latches", "stiffness"),
}
FAMILIES: dict[str, tuple[str, dict[str, Change], str]] = {
    "apda": (
        "apda",
        {
            "springs of the differences": scale_springs("difference"),
            "springs of the tilts": scale_springs("tilt"),
            "eddy-current brakes of the differences": scale_laws("difference", "eddy", "slope"),
            "eddy-current brakes of the tilts": scale_laws("tilt", "eddy", "slope"),
            "friction brakes of the differences": scale_laws(
                "difference", "brake", "forward", "back"
            ),
            "friction brake of the drive": scale_laws("drive", "brake", "forward", "back"),
            "damper of the drive": scale_laws("drive", "damper", "linear"),
            "rotating parts": scale_bodies(r"rod\d_nut|pair.*|drive|tilt\d"),
            "ring": scale_bodies("ring"),
            **CONTACT,
        },
        "Known: six screws in three pairs with differentials, three brakes, a friction brake in the"
        " drive (Syromiatnikov 64-65); rotating parts of 205, later 170 kg, referred to the ring"
        " (135), here 122 kg; brakes that hold more on the way back (172), staged"
        " springs (249). Sizes of ring and rated tension and bending as in the IDSS. All other"
        " numbers are assumed.",
    ),
    "hexapod": (
        "hexapod",
        {
            "springs of the legs": scale_springs("leg"),
            "eddy-current brakes of the legs": scale_laws("motor", "eddy", "slope"),
            "rotors": scale_bodies(r"leg\d_rotor"),
            "rods and cylinders": scale_bodies(r"leg\d_(rod|cyl)"),
            "ring": scale_bodies("ring"),
            **CONTACT,
        },
        "Known: six linear actuators carry the ring; sizes of ring and rated tension and bending"
        " (IDSS). All other numbers are assumed.",
    ),
    "probe_drogue": (
        "probe_drogue",
        {
            "spring of the rod": scale_springs("probe"),
            "eddy-current brake of the rod": scale_laws("probe", "eddy", "slope"),
            "springs of the side absorbers": scale_springs("side"),
            "brakes of the side absorbers": scale_laws("side", "eddy", "slope"),
            "damping of the contact": scale_members("contact", "law", "damping"),
            **CONTACT,
        },
        "Known: rod on a screw with a brake, side absorbers, head with latches, cone with socket"
        " (Syromiatnikov 36). All numbers are assumed.",
    ),
    "idss_25t_350t": (
        "idss_hexapod",
        {
            "stiffness of the legs": scale_members("leg_defaults", "stiffness"),
            "damping of the legs": scale_members("leg_defaults", "damping"),
            "ring": scale_bodies("ring"),
            **CONTACT,
        },
        "Known: six linear actuators carry the ring; mating plane 1200 mm, passage 800 mm, three"
        " petals, rated tension and bending (IDSS). All other numbers are assumed.",
    ),
}
RESULTS = {
    "compression": "capture.peak.compression",
    "tension": "capture.peak.tension",
    "shear": "capture.peak.shear",
    "bending": "capture.peak.bending",
    "time to capture": "time_of_capture",
}
FRICTION = "friction coefficient"


def run_variant(scene: str, mechanism: dict, overrides: dict | None = None) -> dict[str, float]:
    """Run a shipped scene with a changed mechanism; returns its results."""
    text = (paths.SCENES / f"{scene}.toml").read_text(encoding="utf-8")
    text = re.sub(r'(?m)^name = ".*"', 'name = "own"', text)
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "own.json").write_text(json.dumps(mechanism | {"name": "own"}))
        file = Path(name) / "own.toml"
        file.write_text(text, encoding="utf-8")
        run = dl.run(dl.Scene(file, START | (overrides or {})), stop=END, step=STEP)
    results = {name: float(run[output][-1]) for name, output in RESULTS.items()}
    results["time to capture"] -= float(run["time_of_contact"][-1])
    return results if run["captured"][-1] else dict.fromkeys(RESULTS, math.nan)


def find_elasticities(scene: str, file: str, change: Change | None) -> dict[str, float]:
    """Return the elasticity of every result; NaN where a run has none."""
    sides = []
    for factor in (LOW, HIGH):
        mechanism = read_shipped(file)
        if change is None:
            sides.append(
                run_variant(scene, mechanism, {"contact.friction_coefficient": 0.1 * factor})
            )
        else:
            change(mechanism, factor)
            sides.append(run_variant(scene, mechanism))
    low, high = sides
    span = math.log(HIGH / LOW)
    return {
        n: math.log(high[n] / low[n]) / span if min(low[n], high[n]) > 0.0 else math.nan
        for n in RESULTS
    }


def find_size(value: float) -> float:
    """Return the size of an elasticity; an unknown one ranks last."""
    return 0.0 if math.isnan(value) else abs(value)


def name_largest(rows: dict[str, dict[str, float]], result: str) -> str:
    """Return the two groups with the largest effect on a result."""
    sizes = {name: find_size(row[result]) for name, row in rows.items()}
    names = [n for n in sorted(sizes, key=lambda n: -sizes[n]) if sizes[n] >= LEAST]
    return ", ".join(names[:2]) or f"nothing above {LEAST:g}"


def show(value: float) -> str:
    """Return an elasticity as text."""
    return "-" if math.isnan(value) else f"{value:+.2f}"


def write_family(scene: str) -> list[Block]:
    """Return the section of a family."""
    file, groups, known = FAMILIES[scene]
    base = run_variant(scene, read_shipped(file))
    every: dict[str, Change | None] = {**groups, FRICTION: None}
    rows = {name: find_elasticities(scene, file, change) for name, change in every.items()}
    order = sorted(rows, key=lambda name: -max(map(find_size, rows[name].values())))
    units = {"bending": "N m", "time to capture": "s"}
    shipped = ", ".join(f"{name} {base[name]:.3g} {units.get(name, 'N')}" for name in RESULTS)
    table = ((name, *(show(rows[name][result]) for result in RESULTS)) for name in order)
    tops = [f"{result}: {name_largest(rows, result)}" for result in RESULTS]
    print(scene, file=sys.stderr)
    return [
        f"## `{scene}`",
        known,
        f"Shipped: {shipped}.",
        write_table(("group of numbers", *RESULTS), table),
        f"Measure first, for {'; for '.join(tops)}.",
    ]


def main() -> int:
    """Run all variants and write the page."""
    write_page(
        PAGE,
        "Parameters: what is known, what is assumed, what to measure first",
        "tests/validation/published/parameters.py",
        WORDS,
        map(write_family, FAMILIES),
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
