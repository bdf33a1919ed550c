"""What the families of mechanisms cost and do: tests/validation/families.md.

Processor time per evaluation and for whole sequences, audits of whole sequences, where they
capture, the brake against exact motions, and what must come out (family_trends.py).

Examples:
    .venv/bin/python tests/studies/families.py                        # some ten minutes
    .venv/bin/python tests/studies/families.py --only brake           # this section of the page
    .venv/bin/python tests/studies/families.py --only brake -o build/brake.md
    .venv/bin/python tests/studies/families.py --quick -o build/families.md   # a small sample
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import dockloop as dl
from dockloop.base.figures import save_figure
from dockloop.base.palette import BLUE, VERMILION, YELLOW
from dockloop.base.paths import ROOT
from family_trends import ACCURACY, TRENDS, Row
from page import Block, Table, make_parser, replace_section, write_page, write_points
from slides import make_element, make_slide, write_slide

PAGE = ROOT / "tests" / "validation" / "families.md"
COMMAND = "tests/studies/families.py"
FAMILIES = ("apda", "apda_cranks", "hexapod", "probe_drogue", "probe_drogue_levers")
QUICK = ("hexapod",)
RIGID = {"sequence.set": {"hard_docked.do.2.joint": "rigid"}}

DURATION = 1200.0  # s, approach to separation
STEP, LONG_STEP = 0.5, 10.0  # s, communication; the long one while hard docked
RTOL, COARSER = 1e-8, 1e-7  # of whole sequences: the audited one, one to compare with
WANTED_ENERGY, WANTED_MOMENTUM = 1e-7, 1e-12

OFFSETS, SPEEDS = (0.0, 0.40), (0.01, 0.15)  # m, m/s
THRUSTS = (0.0, 1000.0)  # N, 0.3 s after first contact
WITHIN = "captured and load_ratio < 1"
ALONG = 4  # points of the boundary that are run again for their stops

ORACLES = json.loads((ROOT / "tests" / "data" / "mechanism_oracles.json").read_text())
BRAKES = {  # as in the specification: bristle_stiffness is k_b, rate_cap is v_b
    "regularised, 1 mm/s": {"model": 1, "friction_speed": 1e-3},
    "regularised, 0.1 mm/s": {"model": 1, "friction_speed": 1e-4},
    "bristle 0.4 MN/m": {"bristle_stiffness": 4e5},
    "bristle 4 MN/m": {"bristle_stiffness": 4e6},
    "bristle 4 MN/m, rate cap 10 mm/s": {"bristle_stiffness": 4e6, "rate_cap": 0.01},
    "bristle 40 MN/m, rate cap 10 mm/s": {"bristle_stiffness": 4e7, "rate_cap": 0.01},
}
METHODS = ("explicit", "bdf")
NO_CAP = 1e6  # m/s, a rate that is never met

TEXTS = {
    "cost": """
Runs with `accuracy` 1e-3. The time of an evaluation includes the work of the method: matrices,
steps, outputs. *Apart* is before first contact, with `model.flight` integrated. *In contact* lasts
from first contact to capture. *Hard docked* is the time under hooks and faces (elastic), or as one
body (rigid).
""",
    "sequences": """
Each family goes through its whole sequence, and is undocked 10 s after hard docking. The method is
that of the scene, with rtol 1e-8, 1e-10 m, 1e-11 m/s and 1e-9 J. The energy residual is the largest
at communication points, divided by the kinetic energy at the start. Drives do more work than this
energy. *Ten times coarser* is the same residual with all tolerances ten times larger. An event or
a sum that is booked at a wrong time would leave a residual that does not fall with the tolerance.
Under closing hooks the vehicles rock on their faces at mm/s, so an absolute tolerance must lie
below rtol times such speeds. The momentum residual is relative to the largest momentum.
""",
    "capture": """
Offset towards 30 degrees, 1.5 degrees of misalignment as in the scenes, 30 s from first contact on.
Thrust begins 0.3 s after first contact. *Least speed* is the middle between two dockings with
different ends. *Loads* are the largest shares of rated loads at the captured side of the boundary.
*Stops* are the largest shares of the travel to a stop there.
""",
    "brake": """
23.3 t meet a staged spring at 0.10 m/s; the brake holds 200 N forward and 450 N back. The exact
motion turns at {x_max:.3f} mm and leaves the spring at {v_end:.3f} mm/s. Relative tolerance 1e-7.
Creep: a block of 40 kg under 150 N, a brake of 200 N; its motion from 2 s to 100 s.
""",
    "trends": """
Expectations are those of the specification of mechanisms. Runs have `accuracy` 1e-3, and each
number is computed by the study. The command shows one of the runs of its row; `dockloop` is
`.venv/bin/dockloop`. Comparisons with published numbers: [published.md](published.md).
""",
}


def find_steps(docking: dl.Docking) -> list[str]:
    """Return the names of the steps of the sequence."""
    return [step["name"] for step in docking.scene.document["mechanism"]["sequence"]["steps"]]


def follow(docking: dl.Docking, undock: Callable[[float], bool], long: float) -> Iterator[str]:
    """Step through a sequence; yield the name of its step after each communication step.

    Args:
        docking: at its start.
        undock: receives the time since hard docking [s]; says whether to undock.
        long: communication step while hard docked [s].
    """
    steps, name, docked = find_steps(docking), "approach", None
    while name not in ("separated", "hold") and docking.time < 2.0 * DURATION:
        docking.step(long if name == "hard_docked" else STEP)
        name = steps[docking.get("sequence.step") - 1]
        if name == "hard_docked":
            docked = docking.time if docked is None else docked
            if undock(docking.time - docked):
                docking.set("command", "undock")
        yield name


class Cost(NamedTuple):
    """Processor time and evaluations.

    Attributes:
        seconds: of the processor.
        evaluations: of the right-hand side.
    """

    seconds: float = 0.0
    evaluations: float = 0.0

    def write_each(self) -> str:
        """Return the time of an evaluation [us]."""
        return f"{1e6 * self.seconds / self.evaluations:.1f}" if self.evaluations else "-"


def measure(name: str, keys: dict[str, Any], long: float, duration: float) -> dict[str, Cost]:
    """Run a whole sequence; return what each of its steps costs."""
    docking = dl.Docking(name, keys)
    docking.set("accuracy", ACCURACY)
    docking.set("model.flight", "integrated")
    costs: dict[str, Cost] = {}
    before, began, count = "approach", time.process_time(), 0.0
    for step in follow(docking, lambda _: docking.time > duration - 5.0, long):
        now, evaluations = time.process_time(), docking.get("solver.rhs_evaluations")
        old = costs.get(before, Cost())
        costs[before] = Cost(old.seconds + now - began, old.evaluations + evaluations - count)
        before, began, count = step, now, evaluations
    if before != "separated":
        raise dl.DockloopError(f"{name}: the sequence ends in {before}")
    return costs


def add(costs: dict[str, Cost], names: tuple[str, ...] = ()) -> Cost:
    """Add the costs of some steps, or of all."""
    parts = [cost for name, cost in costs.items() if not names or name in names]
    return Cost(sum(p.seconds for p in parts), sum(p.evaluations for p in parts))


def list_costs(options: argparse.Namespace) -> Block:
    """Cost of evaluations and of whole sequences."""
    duration = 200.0 if options.quick else DURATION
    each = Table("us per evaluation", "apart", "in contact", "hard docked", "rigid joint")
    whole = Table(
        "s of the processor", "elastic joint", "rigid joint",
        "of that hard docked: elastic", "rigid", f"rigid, steps of {LONG_STEP:g} s",
    )  # fmt: skip
    for name in options.families:
        elastic = measure(name, {}, STEP, duration)
        rigid = measure(name, RIGID, STEP, duration)
        coarse = measure(name, RIGID, LONG_STEP, duration)
        each.add(
            name,
            add(elastic, ("approach",)).write_each(),
            add(elastic, ("contact",)).write_each(),
            add(elastic, ("hard_docked",)).write_each(),
            add(rigid, ("hard_docked",)).write_each(),
        )
        whole.add(
            name,
            *(f"{add(costs).seconds:.2f}" for costs in (elastic, rigid)),
            *(
                f"{cost.seconds:.2f} ({cost.evaluations:.0f} evaluations)"
                for cost in (add(c, ("hard_docked",)) for c in (elastic, rigid, coarse))
            ),
        )
    return [
        each,
        f"From approach to separation, {duration:.0f} s with communication steps of {STEP:g} s:",
        whole,
        "An elastic joint leaves docked vehicles the play of petals or socket, in which they swing"
        " for minutes: most of its evaluations follow this motion. With a rigid joint the mechanism"
        " costs nothing, but each communication step ends a step of the method. So hard docking"
        " saves most with a rigid joint and long communication steps.",
    ]


# ------------------------------------------------ audits


class Audit(NamedTuple):
    """Residuals of a whole sequence.

    Attributes:
        end: its last step.
        energy: largest energy residual, by the kinetic energy at the start.
        docked: the same before undocking.
        worst: step in which it grows most.
        momentum: largest momentum residual.
        work: of drives [J].
    """

    end: str
    energy: float
    docked: float
    worst: str
    momentum: float
    work: float

    def is_met(self) -> bool:
        """Are both residuals as small as wanted?"""
        return self.energy < WANTED_ENERGY and self.momentum < WANTED_MOMENTUM


def find_tolerances(rtol: float) -> dict[str, float]:
    """Return the tolerances of an audited sequence."""
    names = ("rtol", "atol_position", "atol_velocity", "atol_energy")
    shares = (1.0, 1e-2, 1e-3, 1e-1)
    return {f"solver.{name}": rtol * s for name, s in zip(names, shares, strict=True)}


def audit(name: str, keys: dict[str, Any]) -> Audit:
    """Run a whole sequence and look at its residuals."""
    docking = dl.Docking(name, keys)
    scale = docking.get("energy.kinetic")
    last = energy = docked = momentum = 0.0  # J, 1
    growth: dict[str, float] = {}
    for step in follow(docking, lambda waited: waited > 10.0, STEP):
        present = docking.get("energy.residual")
        growth[step] = growth.get(step, 0.0) + abs(present - last)
        last, energy = present, max(energy, abs(present))
        docked = docked if step in ("undock", "separated") else energy
        momentum = max(momentum, docking.get("momentum.residual"))
    return Audit(
        find_steps(docking)[docking.get("sequence.step") - 1],
        energy / scale,
        docked / scale,
        max(growth, key=lambda step: growth[step]),
        momentum,
        docking.get("energy.drive_work"),
    )


def list_sequences(options: argparse.Namespace) -> Block:
    """Energy and momentum residuals of whole sequences."""
    table = Table(
        "family", "end", "energy residual", "ten times coarser", "grows most in",
        "before undocking", "momentum residual", "work of drives J", "wanted",
    )  # fmt: skip
    missed = []
    for name in options.families:
        rough = {"solver.accuracy": ACCURACY}
        fine, coarse = (
            audit(name, rough if options.quick else find_tolerances(rtol))
            for rtol in (RTOL, COARSER)
        )
        missed += [] if fine.is_met() else [name]
        table.add(
            name,
            fine.end,
            f"{fine.energy:.1e}",
            f"{coarse.energy:.1e}",
            fine.worst,
            f"{fine.docked:.1e}",
            f"{fine.momentum:.1e}",
            f"{fine.work:.0f}",
            "met" if fine.is_met() else "**missed**",
        )
    wanted = f"Wanted: energy {WANTED_ENERGY:g}, momentum {WANTED_MOMENTUM:g}."
    return [table, wanted + (f"\nMissed by: {', '.join(missed)}." if missed else "")]


# ------------------------------------------------ capture


def find_envelope(name: str, thrust: float, *, quick: bool) -> Any:
    """Find where a family captures, and where also its loads are rated."""
    return dl.envelope(
        name,
        ("initial.lateral_offset", *OFFSETS),
        ("initial.closing_speed", *SPEEDS),
        criteria=["captured", WITHIN],
        overrides={"initial.approach_time": 0.2},
        start_values={
            "accuracy": 1e-2 if quick else ACCURACY,
            "chaser.contact_thrust": thrust,
            "chaser.contact_thrust_delay": 0.3,
        },
        stop=10.0 if quick else 30.0,
        step=0.5,
        coarse=2 if quick else 4,
        tolerance=0.25 if quick else 0.0625,
        checks=0 if quick else 4,
    )


def find_stops(run: dl.Result, forces: list[dict]) -> tuple[float, str]:
    """Return the largest share of the travel to a stop, and whose it is."""
    found = [(0.0, "none")]
    for i, force in enumerate(forces, 1):
        for law in force.get("laws", ()):
            if law["type"] == "stop":
                travel = run[f"element[{i}].coordinate"]
                share = max(np.max(travel) / law["upper"], np.min(travel) / law["lower"])
                found.append((float(share), force["name"]))
    return max(found)


def list_captured(envelope: Any) -> Any:
    """Return the captured dockings at the boundary, of ``points``."""
    x, y = "initial.lateral_offset", "initial.closing_speed"
    edge = envelope.boundary[envelope.boundary["criterion"] == "captured"]
    places = {(row[f"{x} met"], row[f"{y} met"]) for _, row in edge.iterrows()}
    points = envelope.points
    chosen = [(a, b) in places for a, b in zip(points[x], points[y], strict=True)]
    return points[chosen].sort_values([x, y])


def write_least(envelope: Any, offset: float) -> str:
    """Return the speeds at which the end changes, at one offset."""
    x, y = "initial.lateral_offset", "initial.closing_speed"
    edge = envelope.boundary[envelope.boundary["criterion"] == "captured"]
    here = edge[(edge["along"] == y) & np.isclose(edge[x], offset)]
    if len(here):
        return ", ".join(f"{1e3 * speed:.0f}" for speed in sorted(here[y]))
    row = envelope.points[np.isclose(envelope.points[x], offset)]
    if not len(row):
        return "?"
    return "all" if bool(row["captured"].eq(True).all()) else "none"


def draw(name: str, envelopes: dict[float, Any], path: Path) -> None:
    """Draw the dockings of a family over offset and speed, a panel for each thrust."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 2.8), layout="constrained")
    axes = figure.subplots(1, len(envelopes), sharey=True, squeeze=False)[0]
    for axis, (thrust, envelope) in zip(axes, envelopes.items(), strict=True):
        points = envelope.points
        captured = points["captured"].eq(True)  # empty if a docking failed
        rated = captured & (points["capture.peak.load_ratio"] < 1.0)
        for label, colour, marker, chosen in (
            ("captured, loads rated", BLUE, "o", rated),
            ("captured, loads above", YELLOW, "s", captured & ~rated),
            ("not captured", VERMILION, "x", ~captured),
        ):
            part = points[chosen]
            axis.plot(
                part["initial.lateral_offset"], 1e3 * part["initial.closing_speed"], marker,
                color=colour, markersize=4, label=label,
            )  # fmt: skip
        axis.set_title(f"{name}, thrust {thrust:.0f} N", fontsize="small")
        axis.set_xlabel("lateral offset [m]", fontsize="small")
        axis.tick_params(labelsize="small")
    axes[0].set_ylabel("closing speed [mm/s]", fontsize="small")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3,
                  fontsize="x-small")  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, path, COMMAND)


def list_captures(options: argparse.Namespace) -> Block:
    """Where the families capture, with margins along the boundary."""
    offsets = (0.0, 0.4) if options.quick else (0.0, 0.1, 0.2, 0.3, 0.4)
    table = Table(
        "family", "thrust N", "captured, of the box", "with rated loads", "dockings",
        *(f"least speed at {y:g} m, mm/s" for y in offsets), "loads", "stops",
    )  # fmt: skip
    pictures, failed = [], []
    for name in options.families:
        forces = dl.Scene(name).document["mechanism"]["forces"]
        envelopes = {thrust: find_envelope(name, thrust, quick=options.quick) for thrust in THRUSTS}
        for thrust, envelope in envelopes.items():
            captured = list_captured(envelope)
            points = envelope.points
            failed += [
                (name, point["command"], point["reason"])
                for _, point in points[points["status"] != "done"].iterrows()
            ]
            loads, stops = captured["capture.peak.load_ratio"], []
            along = 2 if options.quick else ALONG
            spread = np.unique(np.linspace(0, len(captured) - 1, along).astype(int))
            for _, point in captured.iloc[spread if len(captured) else []].iterrows():
                keys = {k: float(point[k]) for k in envelope.points if k.startswith("initial.")}
                run = dl.run(
                    name,
                    {"initial.approach_time": 0.2, **keys},
                    {"chaser.contact_thrust": thrust, "chaser.contact_thrust_delay": 0.3},
                    stop=30.0,
                    step=0.05,
                    accuracy=ACCURACY,
                )
                stops.append(find_stops(run, forces))
            share, whose = max(stops, default=(0.0, "none"))
            table.add(
                name,
                f"{thrust:.0f}",
                *(f"{100 * c['met']:.0f} %" for c in envelope.summary["criteria"]),
                envelope.summary["dockings"],
                *(write_least(envelope, y) for y in offsets),
                f"{loads.min():.2f} to {loads.max():.2f}" if len(loads) else "-",
                f"{share:.2f} ({whose})",
            )
        figure = options.output.parent / "figures" / f"families_{name}.png"
        draw(name, envelopes, figure)
        pictures.append(f"![Where {name} captures](figures/{figure.name})")
    tolerance = envelope.summary["uncertainty"]
    blocks = [table, f"The boundary is known within {100 * tolerance:.0f} % of a range."]
    if failed:
        names, (_, command, reason) = sorted({name for name, *_ in failed}), failed[0]
        blocks += [
            f"{len(failed)} dockings of {', '.join(names)} failed and count as not captured."
            " One is:",
            f"* `{command}`: {reason}",
        ]
    return [*blocks, *pictures]


# ------------------------------------------------ brake


def run_slide(mechanism: dict, rate: float, stop: float, step: float, method: str) -> dl.Result:
    """Run one body on a slide."""
    with tempfile.TemporaryDirectory() as folder:
        scene = dl.Scene(write_slide(Path(folder), mechanism, rate))
    values = {"solver.method": method, "solver.rtol": 1e-7}
    return dl.run(scene, None, values, stop=stop, step=step)


def make_absorber(brake: dict) -> dict:
    """The absorber of the specification, with one model of its brake."""
    case = ORACLES["absorber"][0]
    spring = {
        "type": "spring", "side": "positive", "corner": 1e-5,
        "stages": [[0, 8e3], [0.06, 4e4]], "preload": case["preload"], "take_up": 1e-5,
    }  # fmt: skip
    levels = {"type": "brake", "forward": case["forward"], "back": case["back"]}
    return make_slide(case["m"], make_element(spring, levels | brake))


def list_brakes(options: argparse.Namespace) -> Block:
    """Errors, evaluations and creep of the models of a brake."""
    case = ORACLES["absorber"][0]
    table = Table(
        "model", "error x_max mm", "error v_end mm/s", "evaluations: explicit", "bdf",
        "creep in 98 s, um",
    )  # fmt: skip
    stop, block = 1.02 * case["t_end"], ORACLES["brake_block"]
    for name in list(BRAKES)[: 2 if options.quick else None]:
        brake = BRAKES[name]
        if "bristle_stiffness" in brake:
            brake = {"rate_cap": NO_CAP} | brake
        run = run_slide(make_absorber(brake), case["v0"], stop, 5e-4, METHODS[0])
        x, v = run["element[1].coordinate"], run["element[1].rate"]
        top = int(np.argmax(x))
        v_end = float(np.interp(0.0, x[top:][::-1], v[top:][::-1]))
        counts = [
            run_slide(make_absorber(brake), case["v0"], case["t_end"], case["t_end"], method)[
                "solver.rhs_evaluations"
            ][-1]
            for method in METHODS
        ]
        pull = {"type": "constant", "force": 0.75 * block["level"]}
        held = make_element({"type": "brake", "forward": block["level"], **brake}, pull)
        creep = run_slide(make_slide(block["m"], held), 0.0, 100.0, 1.0, METHODS[1])
        place = creep["element[1].coordinate"]
        table.add(
            name,
            f"{1e3 * (x[top] - case['x_max']):.4f}",
            f"{1e3 * (-v_end - case['v_end']):.4f}",
            *(f"{count:.0f}" for count in counts),
            f"{1e6 * (place[-1] - place[2]):.2g}",
        )
    return table


# ------------------------------------------------ page


def list_trends(options: argparse.Namespace) -> Block:
    """Expectations next to results."""
    names = ("central", "roll") if options.quick else TRENDS
    rows: list[Row] = [row for name in names for row in TRENDS[name]()]
    table = Table("case", "expected", "found", "verdict")
    for row in rows:
        verdict = "agrees" if row.agrees else f"**differs**: {row.why}"
        table.add(row.case, row.expected, row.found, verdict)
    agree = sum(row.agrees for row in rows)
    commands = write_points(f"{row.case}: `{row.command}`" for row in rows)
    return [table, f"{agree} of {len(rows)} rows agree.", "Commands:", commands]


SECTIONS = {
    "cost": ("Cost", list_costs),
    "sequences": ("Whole sequences", list_sequences),
    "capture": ("Where they capture", list_captures),
    "brake": ("The brake", list_brakes),
    "trends": ("What must come out", list_trends),
}


def main(words: list[str] | None = None) -> None:
    """Write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--quick", action="store_true", help="a small sample of each section")
    parser.add_argument("--only", choices=SECTIONS, help="one section, the others stay")
    options = parser.parse_args(words)
    if options.output == PAGE and options.quick:
        parser.error("--quick needs another page: -o build/families.md")
    options.families = QUICK if options.quick else FAMILIES
    if options.only and options.output.exists():
        title, *blocks = make_section(options.only, options)
        replace_section(options.output, title, f"{COMMAND} --only {options.only}", *blocks)
        return
    made = [make_section(name, options) for name in SECTIONS if options.only in (None, name)]
    sections = ((f"## {title}", *blocks) for title, *blocks in made)
    write_page(options.output, "What the families of mechanisms cost and do", COMMAND, *sections)


def make_section(name: str, options: argparse.Namespace) -> tuple[str, Block, Block]:
    """Return title and blocks of a section."""
    title, make = SECTIONS[name]
    exact = ORACLES["absorber"][0]
    text = TEXTS[name].format(**{k: 1e3 * exact[k] for k in ("x_max", "v_end")})
    began = time.perf_counter()
    blocks = make(options)
    print(f"{title}: {time.perf_counter() - began:.0f} s", flush=True)
    return title, text, blocks


if __name__ == "__main__":
    main()
