"""``dockloop check``: is this mechanism sound?

The file is checked against its schema here; what needs kinematics (loops, closure, conditioning)
is answered by the C++ core.
"""

import copy
import json
import math
import re
from pathlib import Path
from typing import Any

from dockloop.base import schema
from dockloop.base.errors import UsageError, did_you_mean, names_arguments
from dockloop.base.paths import MECHANISMS, check_file, is_file, name_kind, shown
from dockloop.base.sections import Section
from dockloop.native import core
from dockloop.scene.find import find_scene, get_mechanism, read_json, read_mechanism
from dockloop.scene.patterns import expand_patterns, open_lists
from dockloop.scene.resolve import resolve_scene
from dockloop.scene.shapes import place_hulls
from dockloop.scene.tables import put_law_tables


def find_mechanism(reference: str) -> Path:
    """Find a mechanism by name (among the shipped ones) or by path."""
    path = Path(reference)
    if is_file(path):
        return path
    shipped = MECHANISMS / f"{reference}.json"
    if path.suffix or not is_file(shipped):
        names = [file.stem for file in sorted(MECHANISMS.glob("*.json"))]
        near = name_kind(reference) or did_you_mean(reference, names)
        raise UsageError(
            f"{reference}: no such file, and no mechanism of that name in {shown(MECHANISMS)}"
            f"{near}: there are {', '.join(names)}; a mechanism of your own is given by the path of"
            " its file"
        )
    return shipped


@names_arguments
def check_mechanism(mechanism: str | Path | dict, states: str | Path | None = None) -> Any:
    """Check a mechanism, or evaluate it at given states.

    Args:
        mechanism: name of a shipped mechanism, path of a file, or the document itself.
        states: file with a member ``states`` (coordinates, velocities, loads) to evaluate.

    Returns:
        A report: ``degrees_of_freedom``, ``loops``, ``gaps``, ``ranges``, ``modes`` and more, in
        m, kg, s, rad where no unit is named. With `states`: a list with one object per state.

    Raises:
        UsageError: naming file, member, value and limit.
    """
    path, document = _read(mechanism)
    if states is None:
        return core.check(document, path)
    file = Path(states)
    check_file(file, "file of states")
    return core.evaluate(document, path, json.dumps(read_json(file)), file)


def draw(mechanism: str | Path | dict, report: dict, to: Path) -> None:
    """Draw a mechanism at home as SVG: bodies, joints, cuts, force elements.

    Args:
        mechanism: as for `check_mechanism`.
        report: what `check_mechanism` said of it.
        to: file to write; one that is no such drawing is kept.

    Raises:
        UsageError: `to` is a file of another kind.
    """
    from dockloop.scene.mechanism_drawing import write_drawing

    write_drawing(to, _read(mechanism)[1], report)


def draw_scene(reference: str | Path, to: Path) -> None:
    """Draw the mechanism of a scene at home as SVG, with the hulls of the vehicles.

    Args:
        reference: name of a shipped scene, or path of a file.
        to: as for `draw`.

    Raises:
        UsageError: the scene is bad, or `to` is a file of another kind.
    """
    from dockloop.scene.mechanism_drawing import write_drawing

    path = find_scene(str(reference))
    document = resolve_scene(path)
    mechanism = document["mechanism"]
    write_drawing(to, mechanism, core.check(mechanism, path), place_hulls(document))


def _read(mechanism: str | Path | dict) -> tuple[Path, dict]:
    """Return a mechanism that its schema accepts, and its name for messages."""
    if isinstance(mechanism, dict):
        path = Path(str(mechanism.get("name", "mechanism")))
        document = copy.deepcopy(get_mechanism(mechanism))
        if isinstance(document, dict):
            open_lists(document)
    elif Path(mechanism).suffix == ".toml":
        raise UsageError(
            f"{shown(mechanism)}: is a scene: must be a mechanism ('dockloop check' lists the parts"
            " of its vehicles)"
        )
    else:
        path = find_mechanism(str(mechanism))
        document = read_mechanism(path)
    schema.check(document, "mechanism", path)
    expand_patterns(document, path)
    put_law_tables(document, path)
    return path, document


def find_turning(mechanism: dict, source: Path) -> dict[str, bool]:
    """Return whether the coordinate of each force element is an angle, by name.

    It is one if it is that of a joint: with another ratio, that of a thread, it is a travel.

    Args:
        mechanism: of a resolved scene.
        source: its file, for messages.
    """
    elements = [force for force in mechanism.get("forces", ()) if "laws" in force]
    bodies = core.expand(mechanism, source)["bodies"] if elements else ()
    turns = {body["name"] for body in bodies if body["joint"]["type"] == "revolute"}
    return {
        force["name"]: all(
            term["joint"] in turns and term.get("ratio", 1.0) == 1.0 for term in force["along"]
        )
        for force in elements
    }


# Units of the facts of a report and of columns of its tables.
_UNITS = {
    "mass": "kg",
    "closure_residual": "m",
    "gap": "m, rad",
    "size": "m",
    "margin": "1",
    "singularity_margin": "1",
    "max_condition": "1",
    "frequency_rad_s": "rad/s or 1/s",
    "damping_ratio": "1",
}


def report_mechanism(found: dict) -> list[Section]:
    """Return the report of a check of the core: facts, then tables of loops, ranges and others."""
    found = found | split_loops(found) | {"modes": _join_free(found.get("modes", []))}
    tables = {
        "loops": ("closed loops", [_name_first(row) for row in found["loops"]]),
        "couplings": ("couplings", [_name_first(row) for row in found["couplings"]]),
        "effects": (
            "what a unit of each coordinate changes at home: joints and elements, m or rad",
            [_effect(row) for row in found.get("effects", [])],
        ),
        "ranges": (
            "range of each independent coordinate from home, the others held",
            [_range(row, side) for row in found.get("ranges", []) for side in ("lower", "upper")],
        ),
        "modes": (
            "vibration about home, base at rest, joint forces of the file",
            [_mode(row) for row in found["modes"]],
        ),
    }
    facts = [
        fact
        for key, value in found.items()
        if key not in ("name", "warnings", "home_q", *tables) and value != []
        for fact in (_play(value) if key == "seated_play" else [_fact(key, value)])
    ]
    warnings = [f"warning: {text}" for text in found.get("warnings", [])]
    return [
        Section(found.get("name", "mechanism"), table=_table(facts), points=warnings),
        *(Section(title, table=_table(rows)) for title, rows in tables.values()),
    ]


def split_loops(report: dict) -> dict[str, list[dict]]:
    """Return the ``loops`` of a report, and apart from them the ``couplings``: screws and gears."""
    found: dict[str, list[dict]] = {"loops": [], "couplings": []}
    for row in report["loops"]:
        found["couplings" if row["cut"] == "coupling" else "loops"].append(row)
    return found


def _fact(key: str, value: object) -> dict:
    """Return one fact as the row of a table."""
    name = key.replace("_", " ")
    return {"quantity": name, "unit": _UNITS.get(key, ""), "value": _short(value)}


def _range(row: dict, side: str) -> dict:
    """Return one end of a range: the end stop that begins first, and what ends it for good."""
    factor, unit = (180.0 / math.pi, "deg") if row["unit"] == "rad" else (1.0, "m")
    end, stop, why = row[side], row.get(f"{side}_stop"), row[f"{side}_end"]
    if stop:
        why = f"stop of {stop['joint']} begins; {why} up to {factor * end:.4g} {unit}"
        end = stop["at"]
    place = {"coordinate": row["coordinate"], "end": side, "at": f"{factor * end:.4g}"}
    return {**place, "unit": unit, "reason": why}


def _effect(row: dict) -> dict:
    """Return what follows one coordinate: elements and legs; joints where there are neither."""
    parts = row["elements"] + row["legs"] or row["joints"]
    return {
        "coordinate": f"1 {row['unit']} of {row['coordinate']}",
        "changes": ", ".join(_group(parts)) or "nothing else",
    }


def _group(parts: list[dict]) -> list[str]:
    """Say rates; parts that move alike and differ by a number in their names stand together."""
    groups: list[tuple[str, list[str]]] = []
    for part in parts:
        rate, name = _short(part["rate"]), part["name"]
        same_kind = groups and re.sub(r"\d+", "#", groups[-1][1][0]) == re.sub(r"\d+", "#", name)
        if same_kind and groups[-1][0] == rate:
            groups[-1][1].append(name)
        else:
            groups.append((rate, [name]))
    return [_span(names) + f" {rate}" for rate, names in groups]


def _span(names: list[str]) -> str:
    """Name parts that belong together by the first and the last."""
    between = " and " if len(names) == 2 else " to "
    return names[0] if len(names) == 1 else names[0] + between + names[-1]


def _join_free(modes: list[dict]) -> list[dict]:
    """Return modes with those that are free, an eigenvalue each, as one: a motion has two."""
    free = [mode for mode in modes if mode["frequency_rad_s"] == 0.0]
    if len(free) < 2:
        return modes
    count = f" ({len(free)} eigenvalues; a motion that nothing brakes has 2)"
    joined = {**free[0], "motion": free[0]["motion"] + count}
    return [joined, *(mode for mode in modes if mode not in free)]


def _mode(row: dict) -> dict:
    """Return one mode: what vibrates has a frequency, anything else a rate."""
    names = ("frequency_rad_s", "damping_ratio", "motion")
    return {name: row.get(name, "") for name in names}


def _play(play: dict) -> list[dict]:
    """Return how far seated rings can move, as facts."""
    low, high = (_short(value) for value in play["roll_deg"])
    least, most = (_short(value) for value in play["lateral_mm"])
    offset, window = (_short(play[key]) for key in ("striker_offset_mm", "latch_window_mm"))
    rows = (
        ("seated play, roll", "deg", f"{low} to {high}"),
        ("seated play, lateral", "mm", f"{least} to {most} by direction"),
        ("strikers next to hooks", "mm", f"up to {offset} (latches.window {window})"),
    )
    return [dict(zip(("quantity", "unit", "value"), row, strict=True)) for row in rows]


def _table(rows: list[dict]) -> list[list[str]]:
    """Return rows as texts under the names and units of all their members."""
    columns = list(dict.fromkeys(column for row in rows for column in row))
    cells = ([_short(row.get(column, "")) for column in columns] for row in rows)
    return [[_name_column(column) for column in columns], *cells]


def _name_column(column: str) -> str:
    """Return the head of a column."""
    name = column.removesuffix("_rad_s").replace("_", " ")
    return f"{name} [{_UNITS[column]}]" if column in _UNITS else name


def _name_first(report: dict) -> dict:
    """Return a report with its member ``name`` in front."""
    return {"name": report["name"], **report} if "name" in report else report


def _joined(values: list) -> str:
    """Return a list on one line, shortened when it is long."""
    if any(isinstance(value, list) for value in values):
        return " | ".join(_short(value) for value in values)
    names = [_short(v.get("name", "?")) if isinstance(v, dict) else _short(v) for v in values]
    if len(names) > 12:
        names = [*names[:10], "...", f"({len(values)} in all)"]
    return " ".join(names)


def _short(value: object) -> str:
    """Return a value as people want to read it."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_short(entry)}" for name, entry in value.items())
    if isinstance(value, list):
        return _joined(value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
