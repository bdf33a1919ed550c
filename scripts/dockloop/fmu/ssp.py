"""Builds an SSP package: the docking FMU and one FMU per vehicle, connected (SSP 1.0).

A package shows how a host couples its own vehicle models to a docking, and runs as it stands in
libcosim, ecos, fmpy.ssp and as a container FMU. Layout::

    SystemStructure.ssd        components, connections, parameters, how to run
    resources/docking.fmu      the scene with its vehicles `driven`
    resources/chaser.fmu       the chaser as a rigid body: the same library, a scene of one vehicle
    resources/target.fmu       likewise the target

Each vehicle sends its motion to the docking, the docking sends loads to the vehicle::

    V.chaser.position, velocity, attitude, angular_velocity  ->  docking.V.position, ...
    docking.V.force_mean, torque_mean                        ->  V.chaser.force_ext, torque_ext

(V is chaser or target. In its own FMU every vehicle is called `chaser`, the one vehicle of a scene
that has no other. An FMU of the user in its place has names of its own: see `vehicle_fmu`.)

The mean load of a step carries the whole impulse of that step, and a vehicle holds it over the
step. Which step that is depends on the host. Most are parallel: all components make a step with
what the others reported at its start, so the docking announces the mean of the coming step, for the
first one already when initialised (`coupling.mode` 2, `coupling.expected_step` that of the
experiment). For a sequential host, which steps one component after the other, build the package
with ``--scene coupling.mode=sequential``: the docking comes first then and sends the mean of the
step that it has just made, and its vehicles make the same step (`coupling.mode` 1). The docking FMU
starts with the mode by itself, because fmpy.ssp and containers read no values from a package.

Conditions at first contact are placed once, with the vehicles free; all FMUs start from the result.
What is written is what every importer understands: the connectors that are connected and the
outputs of the docking (fmpy.ssp fails on inputs that are not connected), no Enumeration, parameter
values inside their component under one name, `PARAMETER_SET` (ecos applies a set that is named), a
master algorithm for OMSimulator (which refuses a system without).
"""

import copy
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

from dockloop.base import paths
from dockloop.base.errors import UsageError, warn
from dockloop.base.files import Kind, check_suffix, claim, read_entry, scratch
from dockloop.base.version import __version__
from dockloop.fmu.build import find_date, write_fmu, write_zip
from dockloop.fmu.vehicle_fmu import COUNTS, NEEDED, Description, VehicleFmu, read_map
from dockloop.native.variables import LOADS, TYPES, VEHICLES
from dockloop.scene.carried import read_model
from dockloop.scene.find import find_scene
from dockloop.scene.placement import read_placed
from dockloop.scene.resolve import SceneReader

PARAMETER_SET = "scene"
# Of the FMU of a vehicle that is no FMU of the user.
_RIGID_BODY = {
    member: [f"chaser.{LOADS.get(member, member)}[{i + 1}]" for i in range(COUNTS[member])]
    for member in NEEDED
}

_NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}


def _is_package(path: Path) -> bool:
    """Return whether a package is of this program, and so is every FMU in it."""
    if b'generationTool="dockloop ' not in read_entry(path, "SystemStructure.ssd"):
        return False
    with zipfile.ZipFile(path) as archive:
        fmus = [name for name in archive.namelist() if name.endswith(".fmu")]
        return all(read_model(BytesIO(archive.read(name))) for name in fmus)


PACKAGE = Kind("SSP package", "dockloop ssp", _is_package)


def build_ssp(
    reference: str,
    overrides: list[str] | tuple[str, ...] = (),
    output: Path | None = None,
    *,
    bare: bool = False,
    vehicles: Mapping[str, Path] = {},
    names: Path | None = None,
) -> Path:
    """Build the SSP package of a scene.

    Args:
        reference: name or path of the scene.
        overrides: ``KEY=VALUE`` texts that replace keys of the scene.
        output: the package to write; default ``build/ssp/SCENE.ssp`` below the current folder.
        bare: its FMUs hold only what is needed to run them (see `dockloop.fmu.build`).
        vehicles: FMUs of the user, by vehicle, each in place of the rigid body.
        names: map of their variables (see `dockloop.fmu.vehicle_fmu`).

    Returns:
        The package. What the user has to see to is warned.

    Raises:
        UsageError: scene, mechanism, override or name of the file is bad, or no vehicle can be
            taken out.
        DockloopError: the compiled parts are missing, or the file cannot be written.
    """
    source = find_scene(reference)
    reader = SceneReader(source)
    reader.resolve(overrides, work=lambda document: _check(document, source))
    document = read_placed(source, overrides, reader)
    output = output or paths.RESULTS / "ssp" / f"{document['name']}.ssp"
    claim(output, PACKAGE)
    check_suffix(output, ".ssp")
    documents = _split(document)
    own = _read_vehicles(vehicles, names, documents, source)
    with scratch() as folder:
        archives = {name: vehicles.get(name, folder / f"{name}.fmu") for name in documents}
        for name in documents.keys() - own.keys():
            write_fmu(documents[name], source, archives[name], bare=bare)
        fmus = {name: own.get(name) or Description(archives[name]) for name in documents}
        entries = {"SystemStructure.ssd": _describe_system(document, fmus)}
        entries |= {f"resources/{name}.fmu": a.read_bytes() for name, a in archives.items()}
    write_zip(output, PACKAGE, entries, compress=not bare)
    return output


def _list_moving(document: dict) -> list[str]:
    """Return the vehicles that get FMUs of their own."""
    return [v for v in VEHICLES if document.get(v, {"motion": "fixed"})["motion"] != "fixed"]


def _check(document: dict, source: Path) -> None:
    """Check that vehicles can be taken out. Raises UsageError."""
    if recorded := [v for v in VEHICLES if document.get(v, {}).get("motion") == "recorded"]:
        raise UsageError(
            f"{paths.shown(source)}: the {recorded[0]} follows a record, so no FMU can move it;"
            " leave its entries of [[input]] out"
        )
    if not _list_moving(document):
        raise UsageError(
            f"{paths.shown(source)}: no vehicle is free or driven, so there is nothing to connect;"
            " set chaser.motion or target.motion"
        )
    if document["mechanism"].keys() == {"name"}:
        raise UsageError(
            f"{paths.shown(source)}: has no [mechanism], so nothing acts between the vehicles;"
            " 'dockloop build' makes the FMU of a vehicle by itself"
        )


def _split(document: dict) -> dict[str, dict]:
    """Return the documents of all FMUs: `docking` and the vehicles that move.

    A host may go through them in this order. In parallel mode the docking is the last, so that it
    receives where its vehicles are before it is initialised; in sequential mode it steps first.
    """
    docking = copy.deepcopy(document)
    docking["coupling"] = {"mode": "parallel", **document.get("coupling", {})}
    documents = {}
    for vehicle in _list_moving(document):
        docking[vehicle]["motion"] = "driven"
        documents[vehicle] = take_out(document, vehicle)
    if docking["coupling"]["mode"] == "sequential":
        return {"docking": docking, **documents}
    return {**documents, "docking": docking}


def _read_vehicles(
    vehicles: Mapping[str, Path], names: Path | None, documents: Mapping[str, dict], source: Path
) -> dict[str, VehicleFmu]:
    """Return the FMUs of the user. Raises UsageError: one has no place, or is not what it must."""
    rows, place = read_map(names)
    for vehicle in rows:
        if vehicle not in vehicles:
            raise UsageError(f"{place}: has [{vehicle}], but there is no --{vehicle} FILE.fmu")
    found = {}
    for vehicle, archive in vehicles.items():
        if vehicle not in documents:
            raise UsageError(
                f"--{vehicle} {paths.shown(archive)}: {vehicle}.motion of {paths.shown(source)} is"
                " fixed, so nothing moves it; set it to free"
            )
        found[vehicle] = VehicleFmu(archive, vehicle, rows.get(vehicle, {}), place)
        found[vehicle].take_starts(documents[vehicle]["chaser"])
        for note in found[vehicle].notes:
            warn(note)
    return found


def take_out(document: dict, vehicle: str) -> dict:
    """Return the scene of one vehicle by itself: a rigid body, called `chaser` in there.

    Args:
        document: a resolved scene, vehicles placed.
        vehicle: which one; its parts and modes stay in the FMU of the docking.
    """
    body = {k: v for k, v in document[vehicle].items() if k not in ("part", "modes", "adapter")}
    return {
        "format": document["format"],
        "name": vehicle,
        "title": f"Rigid body moved by the loads it receives: {vehicle} of {document['name']}",
        "chaser": {**body, "motion": "free"},
        "mechanism": {"name": "none"},
        "initial": {"at": "start"},
        "solver": document["solver"],
        "experiment": document["experiment"],
        "outputs": {"groups": []},
    }


def _find_connections(vehicle: str, fmu: Description) -> list[tuple[str, str, str, str]]:
    """Return (start element, start connector, end element, end connector) for one vehicle."""
    links = []
    for member, names in fmu.names.items() if isinstance(fmu, VehicleFmu) else _RIGID_BODY.items():
        for i, name in enumerate(names, 1):
            ends = (vehicle, name, "docking", f"{vehicle}.{member}[{i}]")
            links.append(ends if NEEDED.get(member) != "input" else (*ends[2:], *ends[:2]))
    return links


def _describe_system(document: dict, fmus: Mapping[str, Description]) -> bytes:
    """Return SystemStructure.ssd."""
    connections = [
        link
        for vehicle, fmu in fmus.items()
        if vehicle != "docking"
        for link in _find_connections(vehicle, fmu)
    ]
    experiment = document["experiment"]
    root = ET.Element(
        _tag("ssd", "SystemStructureDescription"),
        version="1.0",
        name=document["name"],
        description=document["title"],
        generationTool=f"dockloop {__version__}",
        generationDateAndTime=find_date().strftime("%Y-%m-%dT%H:%M:%SZ"),
    )
    system = _add(root, "ssd:System", name=document["name"])
    elements = _add(system, "ssd:Elements")
    for name, fmu in fmus.items():
        _add_component(elements, name, fmu, connections)
    lines = _add(system, "ssd:Connections")
    for link in connections:
        keys = ("startElement", "startConnector", "endElement", "endConnector")
        _add(lines, "ssd:Connection", **dict(zip(keys, link, strict=True)))
    _add_master_of_omsimulator(system, experiment)
    units = _add(root, "ssd:Units")
    for unit in {u.get("name"): u for fmu in fmus.values() for u in fmu.units}.values():
        if unit.find("BaseUnit") is None:
            continue
        base = unit.find("BaseUnit").attrib
        _add(_add(units, "ssc:Unit", name=unit.get("name")), "ssc:BaseUnit", **base)
    _add(
        root,
        "ssd:DefaultExperiment",
        startTime=repr(experiment["start"]),
        stopTime=repr(experiment["stop"]),
    )
    for prefix, uri in _NAMESPACES.items():
        ET.register_namespace(prefix, uri)
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _add_component(
    elements: ET.Element, name: str, fmu: Description, connections: list[tuple]
) -> None:
    """Add one FMU: its connectors, and the values of its parameters.

    A vehicle has only what is connected; one of the user has start values too.
    """
    component = _add(
        elements,
        "ssd:Component",
        name=name,
        type="application/x-fmu-sharedlibrary",
        source=f"resources/{name}.fmu",
        implementation="CoSimulation",
    )
    inputs = [link[3] for link in connections if link[2] == name]
    outputs = [link[1] for link in connections if link[0] == name]
    if name == "docking":
        outputs = fmu.list_names("output", [*TYPES])
    connectors = _add(component, "ssd:Connectors")
    for kind, names in (("input", inputs), ("output", outputs)):
        for variable in names:
            connector = _add(connectors, "ssd:Connector", name=variable, kind=kind)
            _add_value(connector, "ssc", fmu.variables[variable][0])
    if isinstance(fmu, VehicleFmu):
        starts = {name: repr(value) for name, value in fmu.starts.items()}
    elif name == "docking":
        names = fmu.list_names("parameter", [*TYPES])
        starts = {name: fmu.variables[name][0].get("start", "") for name in names}
    else:
        return
    bindings = _add(component, "ssd:ParameterBindings")
    values = _add(_add(bindings, "ssd:ParameterBinding"), "ssd:ParameterValues")
    parameter_set = _add(values, "ssv:ParameterSet", version="1.0", name=PARAMETER_SET)
    parameters = _add(parameter_set, "ssv:Parameters")
    for parameter, value in starts.items():
        element = _add(parameters, "ssv:Parameter", name=parameter)
        _add_value(element, "ssv", fmu.variables[parameter][0], value=value)


def _add_value(parent: ET.Element, prefix: str, kind: ET.Element, /, **attributes: str) -> None:
    """Add data type and unit of a variable; `kind` is its element in the model description."""
    if unit := kind.get("unit"):
        attributes["unit"] = unit
    _add(parent, f"{prefix}:{kind.tag}", **attributes)


def _add_master_of_omsimulator(system: ET.Element, experiment: dict) -> None:
    """Add the annotation without which OMSimulator does not know how to step the system."""
    annotations = _add(system, "ssd:Annotations")
    annotation = _add(annotations, "ssc:Annotation", type="org.openmodelica")
    information = _add(_add(annotation, "oms:Annotations"), "oms:SimulationInformation")
    _add(
        information,
        "oms:FixedStepMaster",
        description="oms-ma",
        stepSize=repr(experiment["step"]),
        absoluteTolerance=repr(experiment["tolerance"]),
        relativeTolerance=repr(experiment["tolerance"]),
    )


def _tag(prefix: str, name: str) -> str:
    return f"{{{_NAMESPACES[prefix]}}}{name}"


def _add(parent: ET.Element, tag: str, /, **attributes: str) -> ET.Element:
    """Add an element; `tag` is PREFIX:NAME."""
    return ET.SubElement(parent, _tag(*tag.split(":")), attributes)
