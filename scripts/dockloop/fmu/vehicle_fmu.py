"""A vehicle FMU of the user in an SSP package: what of it stands for what the docking needs.

A map in TOML has a table for a vehicle; its keys are the variables of that vehicle in the docking::

    [chaser]
    position = "r_IB[*]"                       # * counts from 1
    attitude = ["q4", "q1", "q2", "q3"]        # or all names, in the order of the docking
    force_mean = ["Fx", "Fy", "Fz"]            # inputs: the load of the docking
    force_ext = ["Tx", "Ty", "Tz"]             # outputs: the load of thrusters, where there are any
    [chaser.start]                             # parameters that take the values of the scene
    mass = "m"

A key without a row is looked for by the name that it has in the docking or in the vehicle that is
replaced. Variables must be Reals of co-simulation (FMI 2.0) in SI units, because a package converts
nothing in three of four programs.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from dockloop.base.errors import UsageError, did_you_mean, find_twice
from dockloop.base.files import read_entry
from dockloop.base.paths import check_file, shown
from dockloop.base.units import find_factor
from dockloop.native.variables import LOADS, MOTION, VEHICLES
from dockloop.scene.carried import is_docking
from dockloop.scene.find import read_toml, reading

NEEDED = {**dict.fromkeys(MOTION, "output"), **dict.fromkeys(LOADS, "input")}
THRUST = dict.fromkeys(LOADS.values(), "output")  # may be missing: no thrusters
COUNTS = {**MOTION, **dict.fromkeys((*LOADS, *LOADS.values()), 3), "mass": 1, "inertia": 6}
UNITS = {
    **dict(zip(MOTION, ("m", "m/s", "1", "rad/s"), strict=True)),
    **dict.fromkeys(("force_mean", "force_ext"), "N"),
    **dict.fromkeys(("torque_mean", "torque_ext"), "N.m"),
    "mass": "kg",
    "inertia": "kg.m2",
}
STARTS = (*MOTION, "mass", "inertia")


class Description:
    """What the model description of an FMU says, as far as a system structure needs it.

    Attributes:
        units: its definitions of units.
        variables: elements ``ScalarVariable`` by name.
    """

    def __init__(self, archive: Path | BinaryIO, place: str = "") -> None:
        """Read an FMU.

        Args:
            archive: the file.
            place: for messages; default: its path.

        Raises:
            UsageError: it is none of FMI 2.0 for co-simulation.
        """
        self.place = place or shown(str(archive))
        with reading(Path(self.place), "an FMU", "elements"):
            root = parse_xml(read_entry(archive, "modelDescription.xml"), "modelDescription.xml")
            variables = {v.get("name", ""): v for v in root.iter("ScalarVariable")}
            if bare := [name for name, variable in variables.items() if not len(variable)]:
                raise ValueError(f"variable '{bare[0]}' has no type")
        version = root.get("fmiVersion")
        if version != "2.0" or root.find("CoSimulation") is None:
            has = "co-simulation" if version != "2.0" else "only model exchange"
            raise UsageError(
                f"{self.place}: is an FMU of FMI {version}, {has}: must be one of FMI 2.0 for"
                " co-simulation"
            )
        self.units = root.findall("UnitDefinitions/Unit")
        self.variables = variables
        types = {t.get("name"): t[0].get("unit") for t in root.iter("SimpleType") if len(t)}
        for variable in self.variables.values():
            declared = variable[0].get("declaredType")
            if "unit" not in variable[0].attrib and types.get(declared):
                variable[0].set("unit", types[declared] or "")

    def list_names(self, causality: str, types: Sequence[str]) -> list[str]:
        """Return the variables of a causality and of some types."""
        return [
            name
            for name, variable in self.variables.items()
            if variable.get("causality") == causality and variable[0].tag in types
        ]


class VehicleFmu(Description):
    """A vehicle FMU of the user.

    Attributes:
        names: of its variables by member of the vehicle in the docking, each a list.
        starts: values by names of variables that take them.
        notes: sentences on what the user has to see to.
    """

    def __init__(self, archive: Path, vehicle: str, rows: Mapping[str, Any], place: str) -> None:
        """Find what the docking needs.

        Args:
            archive: the FMU.
            vehicle: which vehicle of the docking it is.
            rows: its table of the map.
            place: of the map, for messages.

        Raises:
            UsageError: naming FMU or map, variable, what is expected.
        """
        check_file(archive, "FMU of a vehicle")
        super().__init__(archive)
        if is_docking(archive):
            raise UsageError(f"{self.place}: is a docking, not the vehicle '{vehicle}'")
        self._vehicle, self._map = vehicle, f"{place}: {vehicle}"
        self._starts = dict(rows.get("start", {}))
        _check_keys(f"{self._map}.start", self._starts, STARTS)
        stated = read_rows(self._map, rows)
        self.starts: dict[str, float] = {}
        self.notes: list[str] = []
        self.names: dict[str, list[str]] = {}
        for member, causality in {**NEEDED, **THRUST}.items():
            if member in stated or member in NEEDED:
                self.names[member] = self._find(member, causality, stated.get(member))

    def _find(self, member: str, causality: str, names: list[str] | None) -> list[str]:
        """Return the variables that stand for a member; all are right."""
        if names is None:
            return self._find_by_name(member, causality)
        for name in names:
            self._check(f"{self._map}.{member}", name, member, causality)
        return names

    def _find_by_name(self, member: str, causality: str) -> list[str]:
        """Look for the name in the docking, and for that in a vehicle which receives loads."""
        known = self.list_names(causality, ["Real"])
        own = dict.fromkeys((member, LOADS.get(member, member)))
        prefixes = dict.fromkeys((f"{self._vehicle}.", *(f"{v}." for v in VEHICLES), ""))
        tries = [f"{prefix}{name}" for prefix in prefixes for name in own]
        for stem in tries:
            names = _count(f"{stem}[*]", COUNTS[member])
            if all(name in known for name in names):
                for name in names:
                    self._check(self.place, name, member, causality)
                return names
        name = f"{tries[0]}[1]"
        raise UsageError(
            f"{self.place}: no {causality} stands for '{name}'{did_you_mean(name, known)}: state"
            f" '{member}' in [{self._vehicle}] of a map (--map FILE.toml)"
        )

    def _check(self, place: str, name: str, member: str, causality: str) -> None:
        """Refuse a variable that cannot stand for a member."""
        if name not in self.variables:
            near = did_you_mean(name, self.variables)
            raise UsageError(f"{place}: {self.place} has no variable '{name}'{near}")
        variable = self.variables[name]
        kind, is_one = variable[0], variable.get("causality", "local")
        if is_one != causality or kind.tag != "Real":
            raise UsageError(
                f"{place}: '{name}' of {self.place} is {_say(is_one)} of type {kind.tag}: must be"
                f" {_say(causality)} of type Real"
            )
        unit = kind.get("unit")
        if unit and not is_same_unit(unit, UNITS[member]):
            raise UsageError(
                f"{place}: '{name}' of {self.place} is in {unit}: must be in {UNITS[member]},"
                " because packages convert no units"
            )

    def take_starts(self, body: Mapping[str, Any]) -> None:
        """Note where the vehicle starts. Raises UsageError: the map is wrong.

        Args:
            body: the vehicle in its scene, placed: `STARTS` and more.
        """
        for member in STARTS:
            values = body[member] if isinstance(body[member], list) else [body[member]]
            names = self._find_parameters(member)
            if not names:
                self.notes.append(
                    f"{self.place}: nothing takes {self._vehicle}.{member}: it must be"
                    f" {', '.join(f'{value:.9g}' for value in values)} [{UNITS[member]}] there"
                )
            self.starts |= dict(zip(names, map(float, values), strict=False))

    def _find_parameters(self, member: str) -> list[str]:
        """Return the variables that take the start value of a member; none: there are none."""
        if member in self._starts:
            place = f"{self._map}.start.{member}"
            names = read_row(place, member, self._starts[member])
            for name in names:
                self._check(place, name, member, self._find_causality(name))
            return names
        names = self.names.get(member, [])
        if names and all(self.variables[name].get("initial") == "exact" for name in names):
            return names
        return []

    def _find_causality(self, name: str) -> str:
        """Return the causality of a variable that takes a start value; a parameter else."""
        variable = self.variables.get(name)
        takes = variable is not None and variable.get("initial") == "exact"
        return variable.get("causality", "local") if variable is not None and takes else "parameter"


def parse_xml(content: bytes, name: str) -> ET.Element:
    """Return the root of an entry. Raises ValueError: it is no XML; `name` is that of the entry."""
    try:
        return ET.fromstring(content)
    except ET.ParseError as error:
        raise ValueError(f"{name}: {error}") from None


def _check_keys(place: str, rows: Any, known: Any) -> None:
    for key in rows:
        if key not in known:
            near = did_you_mean(key, known)
            raise UsageError(f"{place}: has '{key}'{near}: must be one of {', '.join(known)}")


def read_rows(place: str, rows: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return the names of a table of a map by member, without those of ``start``.

    Raises UsageError: there is no such member, or no such names.
    """
    own = {key: value for key, value in rows.items() if key != "start"}
    _check_keys(place, own, {**NEEDED, **THRUST})
    return {member: read_row(f"{place}.{member}", member, row) for member, row in own.items()}


def read_row(place: str, member: str, row: Any) -> list[str]:
    """Return the names that a row of a map means. Raises UsageError; `place` names the row."""
    count = COUNTS[member]
    if isinstance(row, str):
        row = _count(row, count) if "*" in row else [row]
    if not isinstance(row, list) or not all(isinstance(name, str) for name in row):
        raise UsageError(f"{place} is {row!r}: must be a name with *, or a list of names")
    if (twice := find_twice(row)) is not None:
        raise UsageError(f"{place} has '{twice}' twice")
    if len(row) != count:
        raise UsageError(f"{place} has {len(row)} names: must have {count}, or one name with *")
    return row


def _count(pattern: str, count: int) -> list[str]:
    return [pattern.replace("*", str(number + 1)) for number in range(count)]


def _say(causality: str) -> str:
    return f"an {causality}" if causality[0] in "io" else f"a {causality}"


def is_same_unit(unit: str, expected: str) -> bool:
    """Return whether two texts mean one unit."""
    factor = find_factor(unit, expected)
    return factor is not None and math.isclose(factor, 1.0, rel_tol=1e-12)


def read_map(path: Path | None) -> tuple[dict[str, Any], str]:
    """Return the tables of a map by vehicle, and its name for messages. Raises UsageError."""
    if path is None:
        return {}, "map"
    check_file(path, "map of names")
    document = read_toml(path)[0]
    _check_keys(shown(path), document, VEHICLES)
    for vehicle, rows in document.items():
        if not isinstance(rows, dict) or not isinstance(rows.get("start", {}), dict):
            raise UsageError(f"{shown(path)}: '{vehicle}' must be a table of names")
    return document, shown(path)
