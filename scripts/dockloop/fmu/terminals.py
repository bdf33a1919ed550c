"""Terminals of an FMU: which variables belong together when systems are wired.

FMI 2.0.4 borrows ``terminalsAndIcons/terminalsAndIcons.xml`` from FMI 3.0 (section 2.4.9). Here are
one terminal for each vehicle (pose, twist and loads) and one for gravity. Members are named as the
variables without the vehicle in front and are matched by that name (rule ``bus``), so a partner
may offer fewer. All members are signals: connected values are equal.

The element GraphicalRepresentation is left out: it would only repeat its defaults (a sheet from
-100 to 100 that the icon fills), and the terminals module of fmu-manipulation-toolbox 2.0 reads
terminals only when they are the first element.
"""

import xml.etree.ElementTree as ET
from typing import NamedTuple

from dockloop.base import paths

FIGURES = paths.MODELS / "figures"


class _Terminal(NamedTuple):
    """What a terminal is called and where it stands on the icon: x1, y1, x2, y2."""

    name: str
    kind: str
    icon: str
    corners: tuple[int, int, int, int]
    color: str
    description: str


_TERMINALS = (
    _Terminal(
        "chaser", "_dockloop.Vehicle", "port_vehicle", (-110, -10, -90, 10), "66 96 127",
        "Motion of the chaser and loads on it: pose and twist of the centre of mass, loads of the"
        " docking system (force_mean and torque_mean are what a driven vehicle integrates), loads"
        " from outside (force_ext, torque_ext)",
    ),
    _Terminal(
        "target", "_dockloop.Vehicle", "port_vehicle", (90, -10, 110, 10), "128 104 60",
        "Motion of the target and loads on it, as for the chaser",
    ),
    _Terminal(
        "gravity", "_dockloop.Gravity", "port_gravity", (-10, 90, 10, 110), "138 151 166",
        "Acceleration of gravity in N on every body inside",
    ),
)  # fmt: skip


def make_terminals(description: str) -> dict[str, bytes]:
    """Return the folder ``terminalsAndIcons`` of an FMU: file name to content.

    Args:
        description: text of modelDescription.xml, whose inputs and outputs become members.
    """
    names = [
        variable.get("name")
        for variable in ET.fromstring(description).find("ModelVariables")
        if variable.get("causality") in ("input", "output")
    ]
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    terminals = ET.SubElement(root, "Terminals")
    icons = {"icon"}
    for terminal in _TERMINALS:
        members = {
            name: name.removeprefix(f"{terminal.name}.")
            for name in names
            if name.startswith((f"{terminal.name}.", f"{terminal.name}["))
        }
        if not members:
            continue
        element = ET.SubElement(
            terminals,
            "Terminal",
            name=terminal.name,
            matchingRule="bus",
            terminalKind=terminal.kind,
            description=terminal.description,
        )
        for variable, member in members.items():
            ET.SubElement(
                element,
                "TerminalMemberVariable",
                variableName=variable,
                memberName=member,
                variableKind="signal",
            )
        corners = dict(zip(("x1", "y1", "x2", "y2"), map(str, terminal.corners), strict=True))
        ET.SubElement(
            element,
            "TerminalGraphicalRepresentation",
            defaultConnectionColor=terminal.color,
            **corners,
            iconBaseName=terminal.icon,
        )
        icons.add(terminal.icon)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    files = {
        "terminalsAndIcons.xml": f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode(),
        "icon.svg": (FIGURES / "icon.svg").read_bytes(),
    }
    return files | {f"{icon}.png": (FIGURES / f"{icon}.png").read_bytes() for icon in sorted(icons)}
