"""Tables and figures of the pages of the families: modelDescription/HEXAPOD.md and others.

The text of a page is typed. What stands between ``<!-- made: ... -->`` and ``<!-- end -->`` is
written here: the numbers of the mechanism file with units and sources, variables of the FMU, the
loads of a whole docking. The figures are a drawing, a whole docking over time and, with --stills,
the mechanism at first contact (needs Chromium).

Examples:
    .venv/bin/python tests/studies/family_pages.py                # half a minute
    .venv/bin/python tests/studies/family_pages.py --stills       # also the pictures
"""

import hashlib
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import dockloop as dl
from dockloop.base.figures import put_legend, save_figure
from dockloop.base.palette import BLUE, SOFT, cycle_lines
from dockloop.base.paths import MECHANISMS, MODELS, ROOT, SCENES, shown
from dockloop.native import core
from dockloop.scene import formats
from dockloop.scene.mechanism_drawing import draw_mechanism
from dockloop.scene.shapes import find_legs
from page import Block, Table, list_blocks, make_parser, write_table

COMMAND = "tests/studies/family_pages.py"
FIGURES = MODELS / "figures"
SHORT, STOP, STEP = 20.0, 170.0, 0.05  # s: first panel, whole docking, recording
LIMITS = ("tension", "compression", "shear", "bending", "torsion")
SOURCE = re.compile(r"assumed|assumption|standard|recalled|derived", re.IGNORECASE)
BLOCK = re.compile(r"(<!-- made: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


class Family(NamedTuple):
    """What a page shows.

    Attributes:
        drive: elements that retract; their coordinate is drawn.
        sets: variables that a host sets.
        reads: variables that a host reads.
    """

    drive: tuple[int, ...]
    sets: tuple[str, ...]
    reads: tuple[str, ...]

    def list_forces(self, document: dict) -> list[tuple[str, str]]:
        """Return label and variable of each force that is drawn: of legs, else of fingers."""
        legs = [leg["name"] for leg in document.get("legs", ())]
        if legs:
            return [(name, f"leg[{i}].force") for i, name in enumerate(legs, 1)]
        groups = dict.fromkeys(c.get("group", c["name"]) for c in document["contact"]["active"])
        return [(name, f"contact.surface[{i}].force") for i, name in enumerate(groups, 1)]


_SETS = ("command", "chaser.contact_thrust", "chaser.contact_thrust_delay", "friction.coefficient")
_READS = (
    "sequence.step", "outcome", "captured", "relative.axial", "gap", "capture.load_ratio",
    "hook[1].force", "faces.force", "energy.drive_work", "energy.residual",
)  # fmt: skip
FAMILIES = {
    "hexapod": Family(
        drive=(1, 3, 5, 7, 9, 11),
        sets=(*_SETS, "element[2].command", "failure[1].active", "failure[2].active"),
        reads=(*_READS, "leg[1].length", "leg[1].force", "element[2].force", "latch[1].force"),
    ),
    "apda": Family(
        drive=(7,),
        sets=(*_SETS, "failure[1].active", "failure[2].active", "element[7].law[2].engagement"),
        reads=(*_READS, "leg[1].force", "element[1].coordinate", "element[7].force",
               "element[7].saturation", "latch[1].force"),
    ),
    "probe_drogue": Family(
        drive=(1,),
        sets=(*_SETS, "failure[1].active", "failure[2].active", "element[1].law[3].limit"),
        reads=(*_READS, "element[1].coordinate", "element[1].force", "element[1].saturation",
               "leg[1].force", "contact.surface[3].force", "contact.surface[5].force",
               "latch[1].force"),
    ),
    "gripper": Family(
        drive=(1,),
        sets=("command", "friction.coefficient", "failure[1].active", "failure[2].active",
              "element[2].law[1].limit"),
        reads=("sequence.step", "outcome", "captured", "time_of_capture", "relative.axial", "gap",
               "capture.load_ratio", "energy.drive_work", "energy.residual",
               "element[1].coordinate", "element[2].coordinate", "element[2].force",
               "element[2].saturation", *(f"contact.surface[{i}].force" for i in range(1, 7))),
    ),
}  # fmt: skip


def find_page(name: str) -> Path:
    """Return the page of a family."""
    return MODELS / f"{name.upper()}.md"


def read_mechanism(name: str) -> dict:
    """Return a shipped mechanism file."""
    return json.loads((MECHANISMS / f"{name}.json").read_text(encoding="utf-8"))


def find_stamp(name: str) -> str:
    """Return the sum of the files that a recorded docking depends on."""
    files = (MECHANISMS / f"{name}.json", SCENES / f"{name}.toml")
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


# ------------------------------------------------ numbers


def find_units() -> dict[str, str]:
    """Return the unit of each member of mechanism files, by its path in FORMATS.md.

    Groups that share members have them under the first of their paths: also by first and last part.
    """
    units = {path: node.get("unit", "") for path, node, _ in formats.list_members("mechanism")}
    shared = {f"{re.split(r'[. ]', path)[0]}.{path.rsplit('.', 1)[-1]}": u
              for path, u in units.items()}  # fmt: skip
    return shared | units


def write_number(value: Any) -> str:
    """Return a value as text: diagonal of a matrix, numbers of a list, word."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:.4g}"
    if isinstance(value, str):
        return value
    if np.shape(value) == (3, 3):
        value = np.diag(value).tolist()
    return f"({', '.join(write_number(part) for part in value)})"


class Numbers:
    """Rows of the table of numbers of one mechanism: part, numbers, source."""

    def __init__(self, document: dict) -> None:
        self.document = document
        self._units = find_units()
        self._rows: dict[tuple[str, str], list[str]] = {}  # text and source: names

    def list_rows(self) -> Iterator[tuple[str, str, str]]:
        """Yield name, numbers and source of each group."""
        for body in self.document["bodies"]:
            self._add(body["name"], body, "bodies[]", leave=("joint",))
        for part, group in self.document.get("leg_defaults", {}).items():
            if isinstance(group, dict):
                self._add(f"{part} of a leg", group, f"leg_defaults.{part}")
        self._add_legs()
        for row in self.document.get("couplings", ()):
            if len(row["terms"]) == 1:
                ratio = write_number(abs(row["terms"][0]["ratio"]))
                self._note(row["name"], f"{ratio} rad per unit of its joint", "")
        for force in self.document["forces"]:
            self._add_laws(force)
        self._add_contact()
        self._add_latches()
        self._add("rated loads", self.document["limits"], "limits")
        group = self.document.get("interface", {})
        for part in ("faces", "hooks", "pushers"):
            if part in group:
                self._add(part, group[part], f"interface.{part}", comment=group.get("comment", ""))
        self._add_actions()
        for (text, source), names in self._rows.items():
            yield name_all(names), text, source

    def _note(self, name: str, text: str, comment: str) -> None:
        """Add a row, to an equal one if there is one."""
        sentences = re.split(r"(?<=[.;:]) ", comment)
        source = " ".join(text for text in sentences if SOURCE.search(text)) or "assumption"
        self._rows.setdefault((text, source), []).append(name)

    def _add(
        self, name: str, group: dict, path: str, *, leave: tuple[str, ...] = (),
        is_rotary: bool = False, comment: str = "",
    ) -> None:  # fmt: skip
        """Add the numbers of a group with their units."""
        parts = [
            self._write_member(key, value, f"{path}.{key}", is_rotary)
            for key, value in group.items()
            if key not in ("comment", "name", "parent", "type", "kind", "commanded", *leave)
        ]
        if parts:
            self._note(name, "; ".join(parts), join_comment(group) or comment)

    def _write_member(self, key: str, value: Any, path: str, is_rotary: bool) -> str:
        if isinstance(value, list) and value and isinstance(value[0], dict):
            inner = (
                "; ".join(
                    self._write_member(k, v, f"{path}[].{k}", is_rotary) for k, v in x.items()
                )
                for x in value
            )
            return f"{key} {', '.join(f'({text})' for text in inner)}"
        short = f"{re.split(r'[. ]', path)[0]}.{key}"
        unit = self._units.get(path, self._units.get(short, ""))
        if key == "stages":
            first, second = (choose_unit(part, is_rotary) for part in unit.split("; "))
            return ", ".join(f"from {a:g} {first} {b:g} {second}" for a, b in value)
        unit = choose_unit(unit, is_rotary)
        return f"{key} {write_number(value)}" + (f" {unit}" if unit not in ("", "1") else "")

    def _add_legs(self) -> None:
        """Where legs stand at home: the first, others lie turned or mirrored."""
        report = core.check(self.document, Path(self.document["name"]))
        for name, root, end in list(find_legs(self.document, report["home_q"]))[:1]:
            ends = (
                f"{what}: x {point[0]:.3g} m, radius {np.hypot(*point[1:]):.3g} m,"
                f" azimuth {np.degrees(np.arctan2(point[2], point[1])):.3g} deg"
                for what, point in (("root", root), ("end", end))
            )
            self._note(f"{name} at home", "; ".join(ends), "")

    def _add_laws(self, force: dict) -> None:
        joints = {body["name"]: body["joint"] for body in self.document["bodies"]}
        term = force["along"][0]
        joint = joints.get(term["joint"], {}).get("type")
        turns = joint == "revolute" or (joint is None and not term["joint"].endswith("_rod"))
        is_rotary = turns and term.get("ratio", 1.0) == 1.0
        for law in force["laws"]:
            path = f"forces[] (without type).laws[] (type {law['type']})"
            name = f"{force['name']}: {law['type']}"
            self._add(name, law, path, is_rotary=is_rotary)

    def _add_contact(self) -> None:
        contact = self.document["contact"]
        own = {k: v for k, v in contact.items() if k not in ("law", "laws", "type", "pairs")}
        comment = join_comment(contact)
        if contact["type"] == "guide_ring":
            self._add("guide ring", own, "contact (type guide_ring)", comment=comment)
        else:
            for core_ in (*own["active"], *own["passive"]):
                text = {
                    k: v for k, v in core_.items() if k not in ("piece_groups", "group", "body")
                }
                path = "contact (type surfaces).active[]"
                self._add(f"surface {core_['name']}: {core_['kind']}", text, path)
        self._add("contact law", contact["law"], "contact (type surfaces).law")

    def _add_latches(self) -> None:
        latches = self.document.get("latches")
        if latches is None:
            return
        path = f"latches ({'with' if 'list' in latches else 'without'} list)"
        text = {k: v for k, v in latches.items() if k != "list"}
        self._add("latches", text, path, comment=join_comment(latches))

    def _add_actions(self) -> None:
        """What drives and brakes do, step by step."""
        for step in self.document["sequence"]["steps"]:
            for action in step.get("do", ()):
                what = action.get("element", action.get("elements"))
                if isinstance(action.get("run"), dict):
                    run, unit = action["run"], "m" if self.slides(what) else "rad"
                    text = f"drive to {run['target']:g} {unit}"
                    if "speed" in run:
                        text += f" at {1e3 * run['speed']:g} m{unit}/s"
                    self._note(f"step {step['name']}", f"{what}: {text}", "")

    def slides(self, elements: str) -> bool:
        """Return whether the coordinate of elements of this name, or pattern, is a travel."""
        joints = {body["name"]: body["joint"]["type"] for body in self.document["bodies"]}
        named = (f for f in self.document["forces"] if fnmatch(f.get("name", ""), elements))
        term = next(named)["along"][0]
        return joints.get(term["joint"]) != "revolute" or term.get("ratio", 1.0) != 1.0


def join_comment(group: dict) -> str:
    """Return the comment of a group as one text."""
    comment = group.get("comment", "")
    return comment if isinstance(comment, str) else " ".join(comment)


def choose_unit(unit: str, is_rotary: bool) -> str:
    """Return the unit of a slide or of a turn, of "m or rad"."""
    parts = unit.split(" or ")
    return parts[is_rotary] if len(parts) == 2 else unit


def name_all(names: list[str]) -> str:
    """Return one name of several that differ in numbers."""
    kinds = dict.fromkeys(re.sub(r"\d+", "*", name) for name in names)
    if len(kinds) == 1 and len(names) > 1:
        return f"{next(iter(kinds))} ({len(names)} times)"
    return ", ".join(names)


def list_numbers(name: str) -> Table:
    """Return the table of numbers of a family."""
    rows = Numbers(read_mechanism(name)).list_rows()
    return write_table(("part", "numbers", "source"), rows)


# ------------------------------------------------ variables


def list_variables(name: str) -> Table:
    """Return the tables of what a host sets and reads."""
    known = dl.Docking(name).variables
    table = Table("variable", "unit", "meaning")
    for kind, names in (("set", FAMILIES[name].sets), ("read", FAMILIES[name].reads)):
        table.add(f"*{kind}*", "", "")
        for each in names:
            row = known[each]
            text = row.description.split(": 1 ")[0]  # without the list of a choice
            table.add(f"`{each}`", "" if row.unit == "1" else row.unit, text)
    return table


# ------------------------------------------------ a whole docking


def run_docking(name: str) -> dl.Result:
    """Run the shipped scene from approach to separation."""
    return dl.run(name, None, {"command": "undock"}, stop=STOP, step=STEP)


class Share(NamedTuple):
    """A row of the table of loads.

    Attributes:
        what: load or travel.
        largest: of the docking.
        rated: or limit.
    """

    what: str
    largest: float
    rated: float
    unit: str

    @property
    def share(self) -> float:
        """Largest by rated."""
        return self.largest / self.rated


def list_shares(name: str, run: dl.Result) -> Iterator[Share]:
    """Yield loads, travels to stops and forces of drives."""
    document = read_mechanism(name)
    numbers = Numbers(document)
    for load in LIMITS:
        unit = "N m" if load in ("bending", "torsion") else "N"
        yield Share(load, run[f"capture.peak.{load}"][-1], document["limits"][load], unit)
    for i, force in enumerate(document["forces"], 1):
        travel = 1e3 * run[f"element[{i}].coordinate"]
        slides = numbers.slides(force["name"])
        length, unit = ("mm", "N") if slides else ("mrad", "N m")
        for law in force["laws"]:
            if law["type"] == "stop":
                what = f"travel of {force['name']}"
                ends = ((np.min(travel), law["lower"]), (np.max(travel), law["upper"]))
                shares = (Share(what, most, 1e3 * end, length) for most, end in ends)
                yield max(shares, key=lambda share: share.share)
            if law["type"] == "drive":
                most = np.max(run[f"element[{i}].saturation"]) * law["limit"]
                kind = "force" if slides else "torque"
                yield Share(f"{kind} of the drive of {force['name']}", most, law["limit"], unit)


def list_loads(name: str, run: dl.Result) -> list[Block]:
    """Return the table of the largest loads and travels next to what is rated."""
    kinds: dict[str, list[Share]] = {}
    for share in list_shares(name, run):
        kinds.setdefault(re.sub(r"\d+", "*", share.what), []).append(share)
    table = Table("load or travel", "largest", "rated or limit", "share")
    for kind, shares in kinds.items():
        most = max(shares, key=lambda share: share.share)
        what = most.what if len(shares) == 1 else f"{kind}, largest: {most.what.split()[-1]}"
        each = (f"{value:.0f} {most.unit}" for value in (most.largest, most.rated))
        table.add(what, *each, f"{100 * most.share:.0f} %")
    return [f"<!-- files {find_stamp(name)} -->", table]


def list_boundary(name: str) -> Table:
    """Return the largest lateral offset that is captured, for speeds and directions."""
    directions = (0.0, 60.0)  # deg: towards a finger, and between two
    table = Table("closing speed", *(f"offset towards {d:g} deg" for d in directions))
    for speed in (0.01, 0.03, 0.08):
        largest = []
        for direction in directions:
            low, high = 0.0, 0.4
            while high - low > 2e-3:
                offset = 0.5 * (low + high)
                keys = {
                    "initial.closing_speed": speed,
                    "initial.lateral_offset": offset,
                    "initial.lateral_direction_deg": direction,
                }
                captured = dl.run(name, keys, stop=10.0, step=0.25)["captured"][-1]
                low, high = (offset, high) if captured else (low, offset)
            largest.append(f"{1e3 * low:.0f} mm")
        table.add(f"{1e3 * speed:.0f} mm/s", *largest)
    return table


def list_steps(name: str, run: dl.Result) -> list[tuple[float, str]]:
    """Return the times at which steps begin."""
    steps = [step["name"] for step in read_mechanism(name)["sequence"]["steps"]]
    at = run["sequence.step"]
    begins = [0, *(np.flatnonzero(np.diff(at)) + 1)]
    return [(float(run["time"][i]), steps[int(at[i]) - 1]) for i in begins]


def draw_docking(name: str, run: dl.Result) -> Any:
    """Draw loads, legs, drive and steps over time; the capture has panels of its own."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 7.2), layout="constrained")
    panels: Any = figure.subplots(4, 2, sharey="row", sharex="col", width_ratios=(1, 1.4))
    document: dict = read_mechanism(name)
    t = run["time"]
    last = min(len(t) - 1, np.searchsorted(t, list_steps(name, run)[-1][0] + 5.0))
    end, shown = float(t[last]), slice(last + 1)
    for side, (low, high) in enumerate(((0.0, SHORT), (SHORT, end))):
        loads, legs, drive, steps = panels[:, side]
        for axis in (loads, legs, drive):
            axis.set_prop_cycle(cycle_lines())
        for load in LIMITS:
            share = run[f"capture.{load}"][shown] / document["limits"][load]
            loads.plot(t[shown], share, linewidth=0.8, label=load)
        loads.axhline(1.0, color=SOFT, linewidth=0.8)
        for label, variable in FAMILIES[name].list_forces(document):
            legs.plot(t[shown], run[variable][shown], linewidth=0.8, label=label)
        for i in FAMILIES[name].drive:
            label = document["forces"][i - 1]["name"]
            drive.plot(t[shown], run[f"element[{i}].coordinate"][shown], linewidth=0.8, label=label)
        drive.plot(
            t[shown], run["relative.axial"][shown], color=SOFT, linestyle=":",
            label="axial distance",
        )  # fmt: skip
        draw_steps(steps, list_steps(name, run))
        for axis in panels[:, side]:
            axis.grid(alpha=0.3)
            axis.set_xlim(low, high)
            axis.tick_params(labelsize="small")
        panels[-1, side].set_xlabel("time [s]", fontsize="small")
    force = "leg force [N]" if "legs" in document else "contact force [N]"
    texts = ("load / rated load", force, "travel, distance [m]", "step")
    for axis, text in zip(panels[:, 0], texts, strict=True):
        axis.set_ylabel(text, fontsize="small")
    for axis in panels[:3, 1]:
        put_legend(axis)
    return figure


def draw_steps(axis: Any, begins: list[tuple[float, str]]) -> None:
    """Draw the steps of a sequence as stairs with names."""
    names = [name for _, name in begins]
    times = [time for time, _ in begins]
    axis.step([*times, STOP], [*range(len(names)), len(names) - 1], where="post", color=BLUE)
    axis.set_yticks(range(len(names)), names)


# ------------------------------------------------ pages and figures


def draw_mechanism_of(name: str) -> str:
    """Return the drawing of `dockloop check --draw` as SVG."""
    document = read_mechanism(name)
    report = core.check(document, MECHANISMS / f"{name}.json")
    return draw_mechanism(document, report["home_q"], report["independent"]) + "\n"


def fill(text: str, makers: dict[str, Callable[[], Block]]) -> str:
    """Return a page with these blocks made anew where it has them; others stay."""

    def put(found: re.Match) -> str:
        if found[2] not in makers:
            return found[0]
        made = "\n\n".join(list_blocks(makers[found[2]]()))
        return f"{found[1]}\n{made}\n\n{found[3]}"

    return BLOCK.sub(put, text)


def make_page(name: str, run: dl.Result | None = None) -> str:
    """Return the page of a family, with the loads of a docking if there is one."""
    makers: dict[str, Callable[[], Block]] = {
        "numbers": lambda: list_numbers(name),
        "variables": lambda: list_variables(name),
    }
    if run is not None:
        makers["loads"] = lambda: list_loads(name, run)
        makers["boundary"] = lambda: list_boundary(name)
    return fill(find_page(name).read_text(encoding="utf-8"), makers)


def write_still(name: str) -> None:
    """Let `dockloop view` draw the mechanism at first contact."""
    tool = Path(sys.executable).with_name("dockloop")
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder) / "own.csv"
        picture = FIGURES / f"{name}.png"
        for words in (
            f"run {name} --stop 4 --step 0.02 -o {own}",
            f"view {own} --still contact --size 1040x650 -o {picture}",
        ):
            subprocess.run([tool, *words.split()], check=True, cwd=ROOT)


def write_family(name: str, *, stills: bool) -> None:
    """Write page and figures of a family."""
    run = run_docking(name)
    find_page(name).write_text(make_page(name, run), encoding="utf-8")
    (FIGURES / f"{name}_drawing.svg").write_text(draw_mechanism_of(name), encoding="utf-8")
    save_figure(draw_docking(name, run), FIGURES / f"{name}_docking.png", COMMAND)
    if stills:
        write_still(name)
    print(shown(find_page(name)))


def main(words: list[str] | None = None) -> None:
    """Write pages and figures."""
    parser = make_parser(__doc__)
    parser.add_argument("--stills", action="store_true", help="pictures, too (needs Chromium)")
    options = parser.parse_args(words)
    for name in FAMILIES:
        write_family(name, stills=options.stills)


if __name__ == "__main__":
    main()
