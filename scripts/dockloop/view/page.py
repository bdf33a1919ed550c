"""The page: one HTML file with shapes, motion, curves and the viewer, for ``dockloop view``.

Data are columns in base64: times and poses as 64-bit numbers, everything else as 32-bit ones. A
page stays below 5 MB: of long results some samples are taken, those of all events among them.
"""

import base64
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base import palette, rotations
from dockloop.base.errors import DockloopError, UsageError, did_you_mean
from dockloop.base.files import Kind, read_head, writing
from dockloop.base.number import say_number
from dockloop.base.paths import shown
from dockloop.base.template import fill
from dockloop.base.version import __version__
from dockloop.native.core import list_choices, list_limits, list_loads
from dockloop.native.variables import VEHICLES, happened
from dockloop.report.run import say_outcome
from dockloop.result.limits import find_exceeded
from dockloop.result.peaks import find_peak
from dockloop.result.recording import Result
from dockloop.view import geometry, parts

COMMAND = "dockloop view"
TOLERANCE = 1e-4  # the shapes of the scene must fit what was recorded so well [m]
_BEGIN = f"<!doctype html>\n<!-- made by {COMMAND} -->"
_DATA_LIMIT = 2_500_000  # bytes of columns in base64
_PAGE_LIMIT = 5_000_000  # bytes of a page

# Columns as well as poses: what the page shows of a result, by name or pattern.
_SHOWN = re.compile(
    r"relative\.(axial|lateral|pitch_yaw|roll)|gap|phase|outcome|captured"
    r"|capture\.(tension|compression|shear|bending|torsion|load_ratio|(force|torque)\[\d\])"
    r"|contact\.(petal|surface)\[\d+\]\.force|latch\[\d+\]\.(opening|lateral|force|state)|latched\[\d+\]"
    r"|leg\[\d+\]\.(length|force)|energy\.(kinetic|potential|dissipated)"
)
# What is missing in a result, and the group of outputs that holds it.
_GROUPS = {
    "relative.position[1]": ("relative", "motion of the target"),
    "ring.position[1]": ("ring", "motion of the ring and the legs"),
    "capture.compression": ("capture", "loads in the capture interface"),
    "contact.petal[1].force": ("contact", "petal forces and latches"),
    "phase": ("phase", "phases, first contact and capture"),
    "leg[1].length": ("legs", "leg forces"),
}


PAGE = Kind("page", COMMAND, lambda path: read_head(path).startswith(_BEGIN.encode()))


def write_page(
    run: Result,
    path: Path,
    *,
    command: str | None = None,
    meshes: Sequence[tuple[str, dict]] = (),
) -> dict:
    """Write the page of a recorded docking.

    Args:
        run: what was recorded.
        path: the file, ``.html``.
        command: what repeats the run, shown in the page.
        meshes: of `dockloop.view.mesh.read_mesh`, of vehicles and bodies.

    Returns:
        ``bytes``, ``samples``, ``every`` (one of so many was taken) and ``fit`` [m], the largest
        difference between drawn and recorded leg lengths and latch openings.

    Raises:
        UsageError: the scene does not fit the result, or a mesh has no place or is too large.
        DockloopError: the page cannot be written.
    """
    data = make_data(run, command)
    for name, _ in meshes:
        _check_place(name, run, data)
    data["geometry"]["meshes"] = meshes
    text = fill_template(data)
    size = len(text.encode())
    if size > _PAGE_LIMIT:
        raise UsageError(
            f"{shown(path)}: would have {size / 1e6:.1f} MB, more than {_PAGE_LIMIT / 1e6:.0f} MB:"
            " give meshes with fewer triangles"
        )
    with writing(path, PAGE) as partial:
        partial.write_text(text, encoding="utf-8")
    return {"bytes": size, **{k: data["meta"][k] for k in ("samples", "every", "fit")}}


def _check_place(name: str, run: Result, data: dict) -> None:
    """Raise UsageError: what a mesh draws is not in the scene, or its pose was not recorded."""
    shapes, columns = data["geometry"], data["columns"]
    fixed = [*shapes["vehicles"], "base"]
    known = [*fixed, *(body["name"] for body in shapes["bodies"])]
    if name not in known:
        near = did_you_mean(name, known)
        raise UsageError(
            f"--mesh {name}: the scene '{run.scene['name']}' has no such vehicle or body{near}; it"
            f" has {', '.join(known)}"
        )
    pose = "pose.ring" if name == shapes["capture_body"] else f"pose.body.{name}"
    if name not in fixed and pose not in columns:
        raise UsageError(f"--mesh {name}: its pose needs the group 'states' in [outputs] groups")


def make_data(run: Result, command: str | None = None) -> dict:
    """Return all that a page holds: ``meta``, ``geometry``, ``events``, ``columns``."""
    shapes = geometry.make_geometry(run.scene, run.parameters)
    shapes["parts"] = parts.list_parts(run.scene)
    times = run["time"]
    names = [name for name in run.names if _SHOWN.fullmatch(name)]
    events = find_events(run)
    count = len(shapes["bodies"]) + len(shapes["parts"]) + 1  # of poses, at most about
    width = 8 * (1 + 7 * count) + 4 * len(names)
    rows = _choose_rows(run, events, max(100, int(_DATA_LIMIT * 0.75 / width)))
    for event in events:
        event["index"] = int(np.searchsorted(rows, event["index"]))
    held = replace(run, values=run.values[rows])
    poses, notes = _find_poses(held, shapes)
    fit = _check_fit(held, poses, shapes)
    columns = {"time": _encode(times[rows], "f8")}
    columns |= {f"pose.{name}": _encode(values, "f8") for name, values in poses.items()}
    columns |= {name: _encode(held[name], "f4") for name in names}
    every = len(times) / len(rows)
    passed = [f"{text} at {at:.3f} s" for _, text, at in _list_passed(run)]
    groups = {"target": "relative", "ring": "ring"}
    derived = {group for name, group in groups.items() if name in poses}
    notes += run.warnings
    if len(rows) < len(times):
        notes.append(f"{len(rows)} of {len(times)} recorded samples are in this page")
    notes += [
        f"not recorded: {what}; the scene needs the group '{group}' in [outputs] groups"
        for name, (group, what) in _GROUPS.items()
        if name not in run and group not in derived and _can_have(run.scene, group)
    ]
    return {
        "meta": {
            "name": run.scene["name"],
            "title": run.scene["title"],
            "sentence": "; ".join([describe_outcome(run), *passed]),
            "command": command,
            "version": __version__,
            "samples": len(rows),
            "every": every,
            "fit": fit,
            "notes": notes,
            "phases": [phase.name for phase in list_choices("phase")],
            "outcomes": [outcome.name for outcome in list_choices("outcome")],
            "latch_states": [state.name for state in list_choices("latch.state")],
            "loads": list_loads(),
            "colors": {
                **palette.SPACE,
                "chaser": palette.CHASER_EDGE,
                "target": palette.TARGET_EDGE,
                "axes": list(palette.AXES.values()),
                **palette.EVENTS,
                "latch": palette.LATCH_STATES,
                "phase": palette.PHASES,
                "outcome": palette.OUTCOMES,
                "lines": palette.LINES,
                "dashes": palette.DASHES,
                **{n: getattr(palette, n.upper()) for n in ("ink", "soft", "faint", "paper")},
            },
            "rated": {
                name: value
                for name, value in run.scene["mechanism"].get("limits", {}).items()
                if name in list_loads()
            },
        },
        "geometry": shapes,
        "events": events,
        "columns": columns,
    }


def fill_template(data: dict, *, style: str = "", panel: str = "", script: str = "") -> str:
    """Return the page of these data as text.

    Args:
        data: of `make_data`.
        style: more rules of CSS, after those of the view.
        panel: HTML between the time line and the curves.
        script: JavaScript that runs when the page shows the docking.
    """

    def as_script(text: str) -> str:
        return text.replace("</script", "<\\/script")

    three = f"/* {' '.join(read_web('view', 'three.LICENSE.txt').split())} */"
    return fill(
        "view",
        "web/page.html",
        made_by=_BEGIN,
        title=f"{data['meta']['name']}: {data['meta']['title']}",
        style=read_web("view", "view.css") + style,
        panel=panel,
        scripts=[
            as_script(text)
            for text in (
                f"{three}\n{read_web('view', 'three.min.js')}",
                read_web("view", "view.js"),
                script,
            )
            if text
        ],
        data=json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
    )


def read_web(room: str, name: str) -> str:
    """Return the text of a file in the folder ``web`` of a room."""
    return (files(f"dockloop.{room}") / "web" / name).read_text(encoding="utf-8")


def describe_outcome(run: Result) -> str:
    """Say in one line how the docking ended."""
    timed = {"loop": 1.0, "do_step": 0.0, "read": 0.0, "load": 0.0}  # a result file has no times
    return say_outcome((run if run.wall else replace(run, wall=timed)).summary)


def _find_poses(run: Result, shapes: dict) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return poses of P, of the ring and of other bodies in axes of A, one row of 7 per sample."""
    poses, notes = {}, []
    count = len(run.values)
    if "target" in run.scene:
        if "relative.position[1]" in run and "relative.attitude[1]" in run:
            poses["target"] = _rows(run, "relative")
        elif (
            "chaser.position[1]" in run
            and "target.position[1]" in run
            and not any("adapter" in run.scene[v] for v in VEHICLES)
        ):
            poses["target"] = _find_relative(run, shapes["vehicles"])
            notes.append(
                "relative.* is not recorded: P in A follows from the poses of the vehicles"
            )
    if "ring.position[1]" in run and "ring.attitude[1]" in run:
        poses["ring"] = _rows(run, "ring")
    mechanism = run.scene["mechanism"]
    capture = mechanism.get("capture", {}).get("body", "base")
    others = [b["name"] for b in mechanism.get("bodies", []) if b["name"] != capture]
    why = "their poses need the group 'states' in [outputs] groups"
    if "state.q[1]" in run and (others or (capture != "base" and "ring" not in poses)):
        try:
            found = geometry.place_bodies(mechanism, run["time"], run.vector("state.q"))
        except UsageError as error:
            found, why = {}, str(error)
        base = geometry.as_row(shapes["base"])
        in_chaser = {name: rotations.join_poses(base, rows) for name, rows in found.items()}
        poses |= {f"body.{name}": in_chaser[name] for name in others if name in found}
        if "ring" not in poses and capture in found:
            back = rotations.invert_poses(geometry.as_row(shapes["capture_body_in_G"]))
            poses["ring"] = rotations.join_poses(in_chaser[capture], back)
            notes.append("ring.* is not recorded: the ring follows from state.q")
    placed = {"base", *([capture] if "ring" in poses else [])}
    placed |= {name.removeprefix("body.") for name in poses}
    legs = [leg for leg in shapes["legs"] if {leg["root"], leg["closing"]} <= placed]
    placed |= {name for leg in legs for name in leg.get("bodies", [])}
    missing = [name for name in others if name not in placed]
    if missing:
        notes.append(
            f"not drawn: {', '.join(missing[:6])}{' and others' * (len(missing) > 6)}: {why}"
        )
    poses |= parts.place_parts(run, shapes["vehicles"], poses.get("target"))
    if lost := [i for i in range(1, len(shapes["parts"]) + 1) if f"part[{i}]" not in poses]:
        notes.append(f"not drawn: parts {', '.join(map(str, lost))}; their poses are not recorded")
    if capture == "base" and "ring" not in poses and mechanism["name"] != "none":
        poses["ring"] = np.tile(geometry.as_row(shapes["base"]), (count, 1))
    return poses, notes


def _rows(run: Result, name: str) -> np.ndarray:
    return np.hstack([run.vector(f"{name}.position"), run.vector(f"{name}.attitude")])


def _find_relative(run: Result, vehicles: dict) -> np.ndarray:
    """Return P in axes of A from the poses of both vehicles."""
    a, p = (
        rotations.join_poses(
            _rows(run, name), rotations.invert_poses(geometry.as_row(vehicles[name]["pose"]))
        )
        for name in VEHICLES
    )
    back = rotations.conjugate(a[:, 3:])
    way = rotations.turn(back, p[:, :3] - a[:, :3])  # the difference first: no digits are lost
    return np.hstack([way, rotations.multiply(back, p[:, 3:])])


def _check_fit(run: Result, poses: dict[str, np.ndarray], shapes: dict) -> float | None:
    """Compare drawn leg lengths and latch openings with the recorded ones.

    Returns:
        The largest difference [m]; None: there is nothing to compare.

    Raises:
        UsageError: the shapes are not those of the run.
    """
    at = {"base": geometry.as_row(shapes["base"])}
    if "ring" in poses:
        at[shapes["capture_body"]] = rotations.join_poses(
            poses["ring"], geometry.as_row(shapes["capture_body_in_G"])
        )
    at |= {k.removeprefix("body."): v for k, v in poses.items() if k.startswith("body.")}
    differences = {}
    for leg in shapes["legs"]:
        name = f"leg[{leg['number']}].length"
        if name in run and leg["root"] in at and leg["closing"] in at:
            drawn = geometry.find_leg_length(leg, at[leg["root"]], at[leg["closing"]])
            differences[name] = float(np.max(np.abs(drawn - run[name])))
    for i in range(len(shapes["latches"]["hooks"]) if shapes["latches"] else 0):
        name = f"latch[{i + 1}].opening"
        if name in run and {"target", "ring"} <= poses.keys():
            opening = geometry.find_opening(shapes["latches"], i, poses["ring"], poses["target"])
            differences[name] = float(np.max(np.abs(opening - run[name])))
    for name, difference in differences.items():
        if difference > TOLERANCE:
            raise UsageError(
                f"{name} drawn from the mechanism '{run.scene['mechanism']['name']}' differs from"
                f" the recorded one by {1e3 * difference:.3g} mm: the model is not that of this"
                " result; run the docking again, or name the right --model"
            )
    return max(differences.values(), default=None)


def find_events(run: Result) -> list[dict]:
    """Return start, first contact, capture, peaks of loads, passed limits, end, by time.

    The index of an event is that of the first sample at which the event is over.
    """
    times = run["time"]
    events: list[dict] = [{"key": "start", "text": "start", "time": float(times[0]), "index": 0}]
    if len(times) == 1:  # a saved state
        return [{**events[0], "text": "saved state"}]

    def add(key: str, text: str, at: float) -> None:
        index = min(int(np.searchsorted(times, at - 1e-9)), len(times) - 1)
        events.append({"key": key, "text": text, "time": float(at), "index": index})

    for name, key, text in (
        ("time_of_contact", "contact", "first contact"),
        ("time_of_capture", "capture", "capture"),
    ):
        if name in run and happened(run[name][-1]):
            add(key, text, float(run[name][-1]))
    for name, text, at in _list_passed(run):
        if name != "load":  # below, each load apart
            add(f"limit_{name}", text, at)
    rated = run.scene["mechanism"].get("limits", {})
    peaks = []
    for name, unit in list_loads().items():
        peak = f"capture.peak.{name}"
        if peak in run and run[peak][-1] > 0.0:
            value, index = float(run[peak][-1]), int(np.argmax(run[peak] >= run[peak][-1]))
            found = find_peak(run, name)
            at = float(times[index])
            if found["time"] is not None:  # an inner step may report its peak samples later
                at = found["time"]
                index = min(int(np.searchsorted(times, at - 1e-9)), len(times) - 1)
            part = (
                f"{value / rated[name]:.1%} of the rated {rated[name]:g}" if name in rated else ""
            )
            if name in rated and value > rated[name]:
                above = float(times[int(np.argmax(run[peak] > rated[name]))])
                add(f"limit_{name}", f"{name} above rated {rated[name]:g} {unit}", above)
            text = f"{say_number(value)} {unit}"
            text += f" in step '{found['step']}'" if found["step"] else ""
            peaks.append((value / rated.get(name, 1.0), name, text, part, at, index))
    for rank, (_, name, text, part, at, index) in enumerate(sorted(peaks, reverse=True)):
        events.append(
            {
                "key": f"peak_{name}",
                "text": f"peak {name} {text}",
                "part": part,
                "time": at,
                "index": index,
                "first": rank == 0,  # nearest to its rated load
            }
        )
    last = len(times) - 1
    events.append({"key": "end", "text": "end", "time": float(times[-1]), "index": last})
    return sorted(events, key=lambda event: (event["time"], event["key"] == "end"))


def _list_passed(run: Result) -> list[tuple[str, str, float]]:
    """Return name, words and time [s] of each passed limit, by time."""
    words = {limit.name: limit.happened for limit in list_limits()}
    return [(row["name"], words[row["name"]], row["time"]) for row in find_exceeded(run)]


def _choose_rows(run: Result, events: list[dict], limit: int) -> np.ndarray:
    """Return the samples that a page holds: all, or evenly some and those of events."""
    count = len(run.values)
    if count <= limit:
        return np.arange(count)
    wanted = {event["index"] for event in events} | {max(event["index"] - 1, 0) for event in events}
    for name in run.names:
        if name == "phase" or name.endswith("].state"):
            changes = np.flatnonzero(np.diff(run[name]))[:50]
            wanted |= {int(i) for i in changes} | {int(i) + 1 for i in changes}
    evenly = np.linspace(0, count - 1, limit - len(wanted)).round().astype(int)
    return np.unique([*evenly, *wanted])


def _can_have(scene: dict, group: str) -> bool:
    """Return whether a scene has what a group of outputs is about."""
    mechanism = scene["mechanism"]
    contact = mechanism.get("contact", {})
    needs: dict[str, Any] = {
        "relative": "target" in scene,
        "ring": mechanism.get("bodies"),
        "capture": "target" in scene and contact,
        "contact": contact.get("type") == "guide_ring",
        "phase": "target" in scene and contact,
        "legs": mechanism.get("legs"),
    }
    return bool(needs[group])


def _encode(values: np.ndarray, kind: str) -> dict:
    """Return a column as the page holds it."""
    with np.errstate(over="ignore"):
        packed = np.ascontiguousarray(values, dtype=f"<{kind}")
    if not np.all(np.isfinite(packed)):
        raise DockloopError("a recorded value is too large to be shown in a page")
    return {
        "type": kind,
        "shape": packed.shape,
        "data": base64.b64encode(packed.tobytes()).decode(),
    }
