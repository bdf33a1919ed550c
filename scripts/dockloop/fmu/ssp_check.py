"""Checks an SSP package with a docking in it, as it was built or as others have edited it."""

import io
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.files import read_entry
from dockloop.base.number import read_if_number
from dockloop.base.paths import check_file, shown
from dockloop.base.sections import FACTS, Section
from dockloop.fmu.ssv import SSV
from dockloop.fmu.vehicle_fmu import COUNTS, NEEDED, Description, is_same_unit, parse_xml
from dockloop.native.variables import MOTION, VEHICLES
from dockloop.scene.carried import is_docking
from dockloop.scene.find import reading

_SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
_STRUCTURE = "SystemStructure.ssd"
_NEAR = 1e-9  # relative: start values are texts


class Link(NamedTuple):
    """A connection: element and connector where it starts and where it ends."""

    start: str
    output: str
    end: str
    input: str


class Package:
    """An SSP package.

    Attributes:
        fmus: by component.
        links: its connections.
        values: parameter values by component and variable.
        docking: component that is a docking of this program.
        notes: what was not read.
    """

    def __init__(self, path: Path) -> None:
        """Read a package. Raises UsageError: it is none, or has no docking."""
        check_file(path, "SSP package")
        with reading(path, "an SSP package", "elements"):
            root = parse_xml(read_entry(path, _STRUCTURE), _STRUCTURE)
        self.place = shown(path)
        self.fmus: dict[str, Description] = {}
        self.values: dict[str, dict[str, str]] = {}
        self.notes: list[str] = []
        above = {child: element for element in root.iter() for child in element}
        dockings = []
        for component in root.iter(f"{_SSD}Component"):
            name, source = component.get("name", ""), component.get("source", "")
            content = _read(path, source)
            self.fmus[name] = Description(io.BytesIO(content), f"{self.place}: {source}")
            self.values[name] = self._read_values(path, component, above)
            if is_docking(io.BytesIO(content)):
                dockings.append(name)
        if len(dockings) != 1:
            raise UsageError(f"{self.place}: has {len(dockings)} dockings: must have one")
        self.docking = dockings[0]
        keys = ("startElement", "startConnector", "endElement", "endConnector")
        self.links = [
            Link(*(line.get(key, "") for key in keys)) for line in root.iter(f"{_SSD}Connection")
        ]

    def _read_values(
        self, package: Path, component: Element, above: dict[Element, Element]
    ) -> dict[str, str]:
        """Return values by variable of a component: its own, then those of the systems around it.

        Later ones win. The names of a system begin with those of the elements below it.
        """
        values: dict[str, str] = {}
        element: Element | None = component
        path = ""
        while element is not None:
            for binding in element.iterfind(f"{_SSD}ParameterBindings/{_SSD}ParameterBinding"):
                file = binding.get("source", "")
                if binding.find(f"{_SSD}ParameterMapping") is not None:
                    where = f"'{element.get('name', '')}'{file and f' ({file})'}"
                    note = f"values of {where} are mapped to other names: not read, not judged"
                    self.notes += [note] if note not in self.notes else []
                    continue
                with reading(package, "an SSP package", "elements"):
                    found = parse_xml(_read(package, file), file) if file else binding
                for p in found.iter(f"{SSV}Parameter"):
                    name = binding.get("prefix", "") + p.get("name", "")
                    if len(p) and name.startswith(path):
                        values[name.removeprefix(path)] = p[0].get("value", "")
            path = f"{element.get('name', '')}.{path}"
            element = above.get(above.get(element, element))
        return values


def _read(package: Path, entry: str) -> bytes:
    """Return an entry of a package. Raises UsageError."""
    with reading(package, "an SSP package", "elements"):
        return read_entry(package, entry)


def check_ssp(path: Path) -> dict:
    """Check a package.

    Args:
        path: the package.

    Returns:
        ``components``, ``connections`` (counts), ``docking`` (name of its component), ``faults``
        (sentences; none: the package is right), ``notes`` (what was not judged).

    Raises:
        UsageError: it is no package, or has no docking.
    """
    package = Package(path)
    faults = [*_check_links(package), *_check_needed(package), *_check_starts(package)]
    return {
        "package": package.place,
        "components": len(package.fmus),
        "connections": len(package.links),
        "docking": package.docking,
        "faults": faults,
        "notes": package.notes,
    }


def _check_links(package: Package) -> Iterator[str]:
    """Yield what is wrong with single connections."""
    for link in package.links:
        ends = []
        if not (link.start and link.end):
            continue  # with a connector of the system
        for element, connector, causality in (
            (link.start, link.output, "output"),
            (link.end, link.input, "input"),
        ):
            fmu = package.fmus.get(element)
            if fmu is None:
                near = did_you_mean(element, package.fmus)
                yield f"connection of '{connector}': there is no component '{element}'{near}"
            elif connector not in fmu.variables:
                near = did_you_mean(connector, fmu.variables)
                yield f"{element}: its FMU has no variable '{connector}'{near}"
            elif (found := fmu.variables[connector].get("causality", "local")) != causality:
                yield f"{element}: '{connector}' is {found}: must be {causality}"
            else:
                ends.append(fmu.variables[connector][0])
        if len(ends) == 2 and ends[0].tag != ends[1].tag:
            yield f"'{link.output}' is {ends[0].tag}, '{link.input}' is {ends[1].tag}"
        units = [unit for end in ends if (unit := end.get("unit"))]
        if len(units) == 2 and not is_same_unit(units[0], units[1]):
            yield f"'{link.output}' is in {units[0]}, '{link.input}' in {units[1]}: must agree"
    for (element, connector), count in Counter((k.end, k.input) for k in package.links).items():
        if count > 1:
            yield f"{element}: '{connector}' is connected {count} times: must be once"


def _list_driven(package: Package) -> list[str]:
    variables = package.fmus[package.docking].variables
    names = {v: variables.get(f"{v}.position[1]") for v in VEHICLES}
    return [v for v, e in names.items() if e is not None and e.get("causality") == "input"]


def _check_needed(package: Package) -> Iterator[str]:
    """Yield what a driven vehicle needs and is not connected."""
    received = {link.input for link in package.links if link.end == package.docking}
    sent = {link.output for link in package.links if link.start == package.docking}
    for vehicle in _list_driven(package):
        for member, causality in NEEDED.items():
            names = [f"{vehicle}.{member}[{i + 1}]" for i in range(COUNTS[member])]
            there = received if causality == "output" else sent
            if missing := [name for name in names if name not in there]:
                what = "nothing gives" if causality == "output" else "nothing receives"
                yield f"{package.docking}: {what} {', '.join(missing)}"
        yield from _check_owner(package, vehicle)


def _check_owner(package: Package, vehicle: str) -> Iterator[str]:
    """Yield loads of a vehicle that another component receives, and numbers in another order."""
    owner = ""
    for link in sorted(package.links, key=lambda k: k.end != package.docking):  # motion first
        is_motion = link.end == package.docking
        name, other = (link.input, link.output) if is_motion else (link.output, link.input)
        whose, _, member = name.partition(".")
        if whose != vehicle or member.partition("[")[0] not in NEEDED:
            continue
        component = link.start if is_motion else link.end
        owner = owner or component
        if component != owner:
            yield f"'{name}' is that of '{component}', other motion that of '{owner}'"
        numbers = {text.partition("[")[2] for text in (name, other)}
        if other.startswith("chaser.") and len(numbers) > 1:  # names of this program
            yield f"'{name}' is connected to '{other}': must be the same number"


def _check_starts(package: Package) -> Iterator[str]:
    """Yield start values of a vehicle that are not those of the docking."""
    for link in package.links:
        member = link.input.partition(".")[2].partition("[")[0]
        if link.end != package.docking or member not in MOTION or link.start not in package.fmus:
            continue
        own = _find_start(package, link.start, link.output)
        expected = _find_start(package, package.docking, link.input)
        if isinstance(own, str):
            yield f"{link.start}: '{link.output}' starts at '{own}': must be a number"
        if isinstance(own, str) or own is None or not isinstance(expected, float):
            continue
        if abs(own - expected) > _NEAR * max(1.0, abs(expected)):
            yield (
                f"{link.start}: '{link.output}' starts at {own:.9g}, the docking expects"
                f" {expected:.9g}"
            )


def _find_start(package: Package, component: str, name: str) -> float | str | None:
    """Return where a variable starts: the value of the package, else that of the FMU."""
    variable = package.fmus[component].variables.get(name)
    own = None if variable is None else variable[0].get("start")
    text = package.values[component].get(name, own)
    return None if text is None else read_if_number(text)


def report_package(found: dict) -> list[Section]:
    """Return the report of a package."""
    facts = [(key, found[key]) for key in ("components", "connections", "docking")]
    verdict = f"{len(found['faults'])} faults" if found["faults"] else "right"
    return [
        Section(f"{found['package']}: {verdict}", table=[FACTS, *facts]),
        Section("faults", points=found["faults"]),
        Section("notes", points=found["notes"]),
    ]
