"""`import_mechanism`: a file of another tool becomes a mechanism, with a report in words."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from dockloop.base import schema
from dockloop.base.errors import UsageError, names_arguments
from dockloop.base.files import Kind, check_suffix, write_text
from dockloop.base.number import check_number
from dockloop.base.paths import check_file, shown
from dockloop.exchange.constructs import FORMATS, GUESSED
from dockloop.exchange.document import FORWARD, write_document
from dockloop.exchange.mjcf import read_mjcf
from dockloop.exchange.robot import Robot
from dockloop.exchange.sdf import read_sdf
from dockloop.exchange.tree import make_tree
from dockloop.exchange.urdf import read_urdf
from dockloop.native import core

ASSEMBLE = 0.01  # m: loops that are open by less are closed
_KIND = Kind("mechanism", "dockloop import", lambda _: False)  # never written over


@dataclass
class Imported:
    """What an import makes.

    Attributes:
        document: the mechanism; its ``comment`` has the report.
        report: lines that begin with ``mapped:``, ``guessed:`` or ``left out:``.
        check: what `dockloop.check` says of it.
    """

    document: dict[str, Any]
    report: list[str]
    check: dict[str, Any]


@names_arguments
def import_mechanism(
    file: str | Path,
    output: str | Path | None = None,
    *,
    base: str | None = None,
    ring: str | None = None,
    cut: str | Sequence[str] = (),
    assemble: float = ASSEMBLE,
    forward: str = "x",
) -> Imported:
    """Read MJCF, URDF or SDF, and return (and write) the mechanism.

    Args:
        file: the file; its root element says what it is. MJCF needs ``dockloop[import]``.
        output: file to write, ``NAME.json``; one that is there is kept.
        base: link that is the base; default: the world, or the root of the tree.
        ring: link that becomes the capture body.
        cut: joints to cut, each of one loop; default: those that leave the shortest chains.
        assemble: largest opening of a loop [m] that is closed, at the pose of the file.
        forward: axis of base and ring that points at the other vehicle: ``"z"``, ``"-x"``, ...

    Raises:
        UsageError: naming file, part and remedy.
        DockloopError: MuJoCo is not installed, or `output` cannot be written.
    """
    if not check_number("--assemble", assemble) >= 0.0:
        raise UsageError(f"--assemble is {assemble:g} m: must be at least 0")
    if forward not in FORWARD:
        raise UsageError(f"--forward {forward}: must be one of {', '.join(FORWARD)}")
    path = Path(file)
    if output is not None:
        _check_output(Path(output))
    robot = _read(path)
    tree = make_tree(robot, base, ring, [cut] if isinstance(cut, str) else list(cut))
    document = write_document(robot, tree, ring, assemble, forward)
    schema.check(document, "mechanism", path)
    try:
        checked = core.check(document, path)
    except UsageError as error:
        raise _explain_singular(error, robot.report.file) from None
    document["home_q"] = checked["home_q"]  # the same, or closed
    for text in checked["warnings"]:
        robot.report.say(GUESSED, text)
    report = robot.report.describe()
    document = {"comment": [f"dockloop import {path.name}", *report], **document}
    if output is not None:
        write_text(Path(output), _KIND, to_text(document))
    return Imported(document, report, checked)


def _explain_singular(error: UsageError, file: str) -> UsageError:
    """Return an error, in other words if no joints could be chosen as dependent."""
    found = re.search(r"(loop '.*'): \d+ cut equations but \d+ dependent joints", str(error))
    if not found:
        return error
    return UsageError(
        f"{file}: the {found[1]} is singular at the pose of the file, so which joints follow from"
        " others is not to be found there: turn one of its joints in the file"
    )


def _check_output(output: Path) -> None:
    check_suffix(output, ".json")
    if output.exists():
        raise UsageError(f"{shown(output)}: is there already; choose another -o")


def _read(path: Path) -> Robot:
    """Read a file by the reader for its root element."""
    check_file(path, "file of a mechanism")
    file = shown(path)
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, ValueError) as error:
        raise UsageError(f"{file}: is no XML ({error}): MJCF, URDF and SDF are") from None
    if root.tag not in FORMATS:
        known = ", ".join(f"<{tag}>" for tag in FORMATS)
        raise UsageError(f"{file}: has the root element <{root.tag}>: an import reads {known}")
    if root.tag == "mujoco":
        return read_mjcf(file, path)
    _check_expanded(file, root)
    return (read_sdf if root.tag == "sdf" else read_urdf)(file, root)


def _check_expanded(file: str, root: ElementTree.Element) -> None:
    """Refuse a file whose macros and properties only another program expands."""
    for element in root.iter():
        values = (f'{key}="{v}"' for key, v in element.items() if "${" in v or "$(" in v)
        is_macro = "xacro" in element.tag or "xacro" in element.tag.partition("}")[0]
        found = f"<{element.tag.rpartition('}')[2]}>" if is_macro else next(values, "")
        if found:
            raise UsageError(f"{file}: has {found}: expand it with 'xacro FILE' first")


def to_text(document: dict[str, Any]) -> str:
    """Return a document as JSON, one entry of a list per line."""
    members = []
    for key, value in document.items():
        text = json.dumps(value)
        if isinstance(value, list) and value and not isinstance(value[0], int | float):
            text = "[\n" + ",\n".join(f"    {json.dumps(entry)}" for entry in value) + "\n  ]"
        members.append(f"  {json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(members) + "\n}\n"


def describe(imported: Imported) -> str:
    """Say what was mapped, guessed and left out, and what came of it."""
    check = imported.check
    free = ", ".join(check["independent"])
    result = f"{check['bodies']} bodies, {len(check['loops'])} loops and couplings"
    degrees = f"{check['degrees_of_freedom']} degrees of freedom: {free}"
    return "\n".join([*imported.report, f"{result}, {degrees}"])
