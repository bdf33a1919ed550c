"""The documentation page of an FMU: one HTML file with all that a new reader needs.

What a page says comes from the FMU's own modelDescription.xml, from the resolved scene and from the
check of its mechanism, so it cannot differ from the FMU it lies in. ``page.html`` is the template,
with all sentences that do not depend on the scene. Figures are drawn by ``figures.py`` into the
page; nothing is loaded from elsewhere. The page prints on A4.
"""

import base64
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import NamedTuple

from dockloop.base.template import fill
from dockloop.fmu import figures
from dockloop.fmu.licenses import PARTS
from dockloop.native.core import list_choices, list_loads
from dockloop.native.variables import VEHICLES
from dockloop.scene import shapes
from dockloop.scene.mechanism import split_loops

# Sections of the variable tables: title, and how the names in it begin.
_SECTIONS = (
    ("Chaser", r"(der\()?chaser\."),
    ("Target", r"(der\()?target\."),
    ("Gravity", r"gravity\["),
    ("Relative motion", r"(relative\.|gap$)"),
    ("Loads in the capture interface", r"capture\.(?!reason|seated)"),
    ("Contact, friction and latches", r"(contact\.|latch\[|friction\.|restitution)"),
    ("Phase and outcome", r"(phase$|captured$|capture\.|latched\[|outcome$|time_)"),
    ("Guide ring", r"ring\."),
    ("Legs", r"leg\["),
    ("Force elements", r"(element\[|failure\[)"),
    ("Sequence", r"(sequence\.|command$)"),
    ("Hard dock", r"(hard_dock\.|hook\[|hooks\.|faces\.|pushers\.|joint\.)"),
    ("Independent coordinates", r"(der\()?state\."),
    ("Cut forces and base", r"(loop\[|base\.)"),
    ("Energy and momentum", r"(energy\.|momentum\.)"),
    ("Coupling", r"coupling\."),
    ("Solver", r"(solver\.|accuracy|model\.)"),
    ("Others", r""),
)

# What the library loads at run time (tests/test_binary.py reads it from the binary).
_NATIVE_NEEDS = """\
binaries/linux64 was built for this machine. It needs the C and C++ runtime of the system:

  libc.so.6, libm.so.6            glibc 2.34 or newer
  libstdc++.so.6, libgcc_s.so.1   GCC 11 or newer

Debian 12, Ubuntu 22.04 and newer have them (packages libc6, libstdc++6, libgcc-s1).
"""
_PORTABLE_NEEDS = """\
The binaries hold all they need but the C library of the system:

  linux64, aarch64-linux     libc.so.6, libm.so.6, libpthread.so.0, libdl.so.2: glibc 2.17 or newer
                             (every Linux of the last ten years but those built on musl)
  win64                      Windows 10 or newer
  darwin64, aarch64-darwin   macOS 11 or newer
"""


def describe_needs(portable: bool) -> str:
    """Return documentation/externalDependencies.txt.

    Args:
        portable: whether the library for linux64 is one of scripts/platforms.
    """
    needs = _PORTABLE_NEEDS if portable else _NATIVE_NEEDS
    return f"{needs}\nNo files outside the FMU, no servers, no licence keys.\n"


_WISHED = (  # outputs of the quick start: the first three that there are
    *("relative.axial", "capture.compression", "captured", "ring.position[1]"),
    "chaser.position[1]",
)


def make_page(document: dict, description: str, report: dict, needs: str, icon: bytes) -> str:
    """Return the documentation page.

    Args:
        document: the resolved scene.
        description: text of modelDescription.xml.
        report: what ``dockloop check`` says of the mechanism.
        needs: what the binaries need of the system (describe_needs).
        icon: the icon of the FMU as SVG, which goes into the page.
    """
    root = ET.fromstring(description)
    mechanism = document["mechanism"]
    vehicles = [vehicle for vehicle in VEHICLES if vehicle in document]
    experiment = root.find("DefaultExperiment")
    return fill(
        "fmu",
        "page.html",
        scene=document,
        mechanism=mechanism,
        icon=base64.b64encode(icon).decode(),
        holds=_list_parts(document, report),
        wished=[name for name in _WISHED if _has(root, name)][:3],
        stop=float(experiment.get("stopTime")),
        step=float(experiment.get("stepSize")),
        motions={vehicle: document[vehicle]["motion"] for vehicle in vehicles},
        drawn={
            "frames": figures.draw_frames("target" in document, bool(mechanism.get("capture"))),
            "phases": figures.draw_phases() if _has(root, "phase") else "",
            "legs": figures.draw_legs(mechanism, report["home_q"]),
        },
        coupling={vehicle: figures.draw_coupling(vehicle) for vehicle in vehicles},
        variables=_list_variables(root, parameters=False),
        parameters=_list_variables(root, parameters=True),
        choices=list_choices,
        facts=_list_facts(document, report),
        legs=_list_legs(mechanism, report["home_q"]),
        rated=[
            (name, f"{mechanism['limits'][name]:g}", unit)
            for name, unit in list_loads().items()
            if name in mechanism.get("limits", {})
        ],
        first_leg=next(iter(shapes.list_legs(mechanism)), {}),
        categories=[
            (category.get("name"), category.get("description", ""))
            for category in root.iterfind("LogCategories/Category")
        ],
        flags={
            kind: root.find(kind).attrib
            for kind in ("CoSimulation", "ModelExchange")
            if root.find(kind) is not None
        },
        needs=needs,
        parts=PARTS,
        references=[(v.get("name"), v.get("valueReference")) for v in root.find("ModelVariables")],
    )


def _list_parts(document: dict, report: dict) -> list[str]:
    """Return in words what the FMU holds, the solver apart."""
    mechanism, parts = document["mechanism"], ["equations of motion"]
    if loops := len(split_loops(report)["loops"]):
        parts.append(f"a mechanism with {loops} closed kinematic loop{'s' * (loops > 1)}")
    if "target" in document:
        parts += [part for part in ("contact", "latches") if mechanism.get(part)]
    return parts


# ------------------------------------------------------------------- variables


def _has(root: ET.Element, name: str) -> bool:
    """Return whether the FMU has a variable."""
    return root.find(f"ModelVariables/ScalarVariable[@name='{name}']") is not None


def _by_section(root: ET.Element, parameters: bool) -> Iterable[tuple[str, list[ET.Element]]]:
    """Yield sections that are not empty, with their variables."""
    rest = [
        variable
        for variable in root.find("ModelVariables")
        if (variable.get("causality") == "parameter") == parameters
    ]
    for title, pattern in _SECTIONS:
        inside = [v for v in rest if re.match(pattern, v.get("name"))]
        if inside:
            yield title, inside
        rest = [v for v in rest if v not in inside]


class _Row(NamedTuple):
    """A row of a table of variables: those that differ in their indices only."""

    name: str
    kind: str
    type: str
    unit: str
    shown: str
    start: str
    limits: str
    meaning: str


def _list_variables(root: ET.Element, parameters: bool) -> list[tuple[str, list[_Row]]]:
    """Return one table a section; a vector is one row."""
    tables = []
    for title, variables in _by_section(root, parameters):
        families: dict[str, list[ET.Element]] = {}
        for variable in variables:
            key = re.sub(r"\[\d+\]", "[]", variable.get("name")) + variable.get("causality", "")
            families.setdefault(key, []).append(variable)
        tables.append((title, [_row(family) for family in families.values()]))
    return tables


def _row(family: list[ET.Element]) -> _Row:
    """Return one row: variables that differ in their indices only."""
    first = family[0][0]
    starts = [_number(v[0].get("start")) for v in family]
    if len(set(starts)) == 1:
        starts = starts[:1]
    low, high = _number(first.get("min")), _number(first.get("max"))
    limits = f"\N{GREATER-THAN OR EQUAL TO} {low}" if low else ""
    limits = f"{low} \N{HORIZONTAL ELLIPSIS} {high}" if low and high else limits
    return _Row(
        _family_name(family),
        family[0].get("causality", "local"),
        first.tag,
        first.get("unit", ""),
        first.get("displayUnit", ""),
        ", ".join(starts),
        limits,
        _family_text(family),
    )


def _number(text: str | None) -> str:
    """Return a number as people want to read it."""
    if text is None or text in ("true", "false"):
        return text or ""
    if abs(float(text)) == math.pi:
        return ("\N{MINUS SIGN}" if float(text) < 0 else "") + "\N{GREEK SMALL LETTER PI}"
    number = re.sub(r"e([+-])0*", r"e\1", f"{float(text):.6g}").replace("e+", "e")
    return number.replace("-", "\N{MINUS SIGN}")


def _family_name(family: list[ET.Element]) -> str:
    """Return a name with ranges in place of indices: leg[1..6].force."""
    columns = zip(*(re.findall(r"\[(\d+)\]", v.get("name")) for v in family), strict=True)
    ranges = []
    for column in columns:
        numbers = [int(text) for text in column]
        low, high = min(numbers), max(numbers)
        ranges.append(f"[{low}..{high}]" if high > low else f"[{low}]")
    pieces = re.split(r"\[\d+\]", family[0].get("name"))
    return "".join(
        piece + extra for piece, extra in zip(pieces, [*ranges, ""], strict=True)
    )  # fmt: skip


def _family_text(family: list[ET.Element]) -> str:
    """Return the common description; what differs at its end is listed once."""
    texts = list(dict.fromkeys(v.get("description", "") for v in family))
    if len(texts) == 1:
        return texts[0]
    heads = {text.rpartition(", ")[0] for text in texts}
    if len(heads) == 1:
        return f"{heads.pop()} ({', '.join(text.rpartition(', ')[2] for text in texts)})"
    return texts[0]


# ------------------------------------------------------------------- the model


def _list_facts(document: dict, report: dict) -> list[tuple[str, str]]:
    """Return the facts of this scene: what, and how much."""
    mechanism = document["mechanism"]
    vehicles = [
        f"{vehicle}: {document[vehicle]['motion']}"
        + (
            f", {document[vehicle]['mass']:g} kg"
            if "mass" in document[vehicle] and document[vehicle]["motion"] != "fixed"
            else ""
        )
        for vehicle in VEHICLES
        if vehicle in document
    ]
    moving = sum(document.get(v, {}).get("motion", "fixed") != "fixed" for v in VEHICLES)
    freedoms = f"{report['degrees_of_freedom']} of the mechanism"
    if moving:
        freedoms += f", 6 of {'each vehicle' if moving > 1 else 'the vehicle that moves'}"
    found = split_loops(report)
    closures = sorted({loop.get("closure", "") for loop in found["loops"]} - {""})
    loops = f"{len(found['loops'])}" + (f" ({', '.join(closures)})" if closures else "")
    rows = [
        ("vehicles", "; ".join(vehicles)),
        ("mechanism", f"{mechanism['name']}, {report['mass']:g} kg"),
        ("moving bodies of the mechanism", str(report["bodies"])),
        ("closed loops", loops),
        ("couplings: screws, gears", str(len(found["couplings"]))),
        ("degrees of freedom", freedoms),
        ("bodies with independent coordinates", ", ".join(report["independent"]) or "none"),
    ]  # fmt: skip
    modes = [mode["frequency_rad_s"] for mode in report.get("modes", [])]
    if modes:
        rows.append(
            ("vibration about home, base at rest: magnitudes of eigenvalues",
             f"{min(modes):.3g} to {max(modes):.3g} rad/s")
        )  # fmt: skip
    contact = mechanism.get("contact", {}).get("type")
    surfaces = {
        "guide_ring": "guide rings with petals",
        "surfaces": "cores of the mechanism file",
        "absorber": "a spring-damper on the axis",
    }
    if contact and "target" in document:
        rows.append(("contact", surfaces.get(contact, contact)))
    if mechanism.get("latches"):
        latches = mechanism["latches"]
        rows.append(("latches", str(len(latches.get("list") or latches["azimuth"]))))
    return rows


def _list_legs(mechanism: dict, home_q: list[float]) -> list[tuple[str, ...]]:
    """Return the ends of the legs."""
    rows = []
    numbers = {leg["name"]: i for i, leg in enumerate(mechanism.get("legs", []), start=1)}
    for name, root, end in shapes.find_legs(mechanism, home_q):
        points = (", ".join(_number(f"{1e3 * x:.1f}") for x in point) for point in (root, end))
        length = 1e3 * float(sum((end - root) ** 2)) ** 0.5
        label = f"leg[{numbers[name]}]" if name in numbers else name
        rows.append((label, *points, f"{length:.1f}"))
    return rows
