"""Reads a file of parameter values (SSV of SSP 1.0) as settings of a run."""

import xml.etree.ElementTree as ET
from pathlib import Path

from dockloop.base.errors import UsageError, did_you_mean, find_twice
from dockloop.base.number import read_number
from dockloop.base.paths import check_file, shown
from dockloop.base.units import find_factor
from dockloop.fmu.vehicle_fmu import Description, parse_xml
from dockloop.native.variables import TYPES
from dockloop.scene.find import reading

SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"


def read_ssv(path: Path, fmu: Path) -> list[str]:
    """Read a file of parameter values.

    Args:
        path: the file; a Real in another unit than the variable is converted.
        fmu: whose variables its values are.

    Returns:
        Settings ``NAME=VALUE``, in SI units.

    Raises:
        UsageError: naming file, variable, value and what is expected.
    """
    check_file(path, "file of parameter values")
    with reading(path, "SSV", "elements"):
        root = parse_xml(path.read_bytes(), path.name)
    place, variables = shown(path), Description(fmu).variables
    if root.tag != f"{SSV}ParameterSet":
        raise UsageError(f"{place}: must be an SSV file, begins with <{root.tag}>")
    parameters = [(node.get("name", ""), node) for node in root.iter(f"{SSV}Parameter")]
    twice = find_twice([name for name, _ in parameters])
    if twice is not None or not parameters:
        wrong = f"has no parameters of {SSV[1:-1]}" if twice is None else f"has '{twice}' twice"
        raise UsageError(f"{place}: {wrong}")
    return [_read(place, name, parameter, variables) for name, parameter in parameters]


def _read(place: str, name: str, parameter: ET.Element, variables: dict[str, ET.Element]) -> str:
    """Return the setting of a parameter."""
    if name not in variables:
        near = did_you_mean(name, variables)
        raise UsageError(f"{place}: there is no variable '{name}'{near}")
    kind = parameter[0].tag.removeprefix(SSV) if len(parameter) else "nothing"
    if kind not in TYPES:
        raise UsageError(f"{place}: '{name}' has {kind}: must have one of {', '.join(TYPES)}")
    value = parameter[0].get("value", "")
    unit, expected = parameter[0].get("unit", ""), variables[name][0].get("unit", "1")
    if kind != "Real":
        return f"{name}={value}"
    factor = find_factor(unit, expected) if unit and unit != expected else 1.0
    if factor is None:
        raise UsageError(f"{place}: '{name}' is in {unit}: must be in {expected}, or of its kind")
    try:
        number = read_number(value)
    except ValueError:
        raise UsageError(f"{place}: '{name}' is '{value}': must be a number") from None
    return f"{name}={number * factor if factor != 1.0 else number!r}"
