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
that has no other.)

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
from io import BytesIO
from pathlib import Path

from dockloop import __version__, paths
from dockloop.errors import UsageError
from dockloop.fmu import find_date, place_vehicles, read_model, write_fmu, write_zip
from dockloop.outputs import Kind, check_suffix, claim, read_entry, scratch
from dockloop.scene import find_scene, resolve_scene
from dockloop.variables import MOTION, TYPES

PARAMETER_SET = "scene"

_VEHICLES = ("chaser", "target")
_LOADS = {"force_mean": "force_ext", "torque_mean": "torque_ext"}  # docking -> vehicle, 3 each
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
) -> Path:
    """Build the SSP package of a scene.

    Args:
        reference: name or path of the scene.
        overrides: ``KEY=VALUE`` texts that replace keys of the scene.
        output: the package to write; default ``build/ssp/SCENE.ssp`` below the current folder.
        bare: its FMUs hold only what is needed to run them (see `dockloop.fmu`).

    Returns:
        The package.

    Raises:
        UsageError: scene, mechanism, override or name of the file is bad, or no vehicle can be
            taken out.
        DockloopError: the compiled parts are missing, or the file cannot be written.
    """
    source = find_scene(reference)
    document = resolve_scene(source, overrides)
    output = output or paths.RESULTS / "ssp" / f"{document['name']}.ssp"
    claim(output, PACKAGE)
    check_suffix(output, ".ssp")
    documents = _split(document, source)
    with scratch() as folder:
        archives = {name: folder / f"{name}.fmu" for name in documents}
        for name, archive in archives.items():
            write_fmu(documents[name], source, archive, bare=bare)
        structure = _describe_system(document, {n: _Fmu(a) for n, a in archives.items()})
        entries = {"SystemStructure.ssd": structure}
        entries |= {f"resources/{a.name}": a.read_bytes() for a in archives.values()}
    write_zip(output, PACKAGE, entries, compress=not bare)
    return output


def _split(document: dict, source: Path) -> dict[str, dict]:
    """Return the documents of all FMUs: `docking` and the vehicles that move.

    A host may go through them in this order. In parallel mode the docking is the last, so that it
    receives where its vehicles are before it is initialised; in sequential mode it steps first.
    """
    taken_out = [v for v in _VEHICLES if document.get(v, {"motion": "fixed"})["motion"] != "fixed"]
    if not taken_out:
        raise UsageError(
            f"{paths.shown(source)}: no vehicle is free or driven, so there is nothing to connect;"
            " set chaser.motion or target.motion"
        )
    if document["mechanism"].keys() == {"name"}:
        raise UsageError(
            f"{paths.shown(source)}: has no [mechanism], so nothing acts between the vehicles;"
            " 'dockloop build' makes the FMU of a vehicle by itself"
        )
    place_vehicles(document, source)
    docking = copy.deepcopy(document)
    docking["coupling"] = {"mode": "parallel", **document.get("coupling", {})}
    documents = {}
    for vehicle in taken_out:
        docking[vehicle]["motion"] = "driven"
        documents[vehicle] = take_out(document, vehicle)
    if docking["coupling"]["mode"] == "sequential":
        return {"docking": docking, **documents}
    return {**documents, "docking": docking}


def take_out(document: dict, vehicle: str) -> dict:
    """Return the scene of one vehicle by itself: a rigid body, called `chaser` in there.

    Args:
        document: a resolved scene, vehicles placed.
        vehicle: which one; its parts stay in the FMU of the docking.
    """
    body = {k: v for k, v in document[vehicle].items() if k not in ("part", "adapter")}
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


class _Fmu:
    """What the model description of an FMU says, as far as a system structure needs it."""

    def __init__(self, archive: Path) -> None:
        with zipfile.ZipFile(archive) as opened:
            root = ET.fromstring(opened.read("modelDescription.xml"))
        self.units = root.findall("UnitDefinitions/Unit")
        self.variables = {v.get("name"): v for v in root.iter("ScalarVariable")}

    def names(self, causality: str) -> list[str]:
        """Return the variables of a causality that every importer understands."""
        return [
            name
            for name, variable in self.variables.items()
            if variable.get("causality") == causality and variable[0].tag in TYPES
        ]


def _find_connections(vehicle: str) -> list[tuple[str, str, str, str]]:
    """Return (start element, start connector, end element, end connector) for one vehicle."""
    motion = [f"{name}[{i + 1}]" for name, count in MOTION.items() for i in range(count)]
    motions = [(vehicle, f"chaser.{name}", "docking", f"{vehicle}.{name}") for name in motion]
    loads = [
        ("docking", f"{vehicle}.{mean}[{i + 1}]", vehicle, f"chaser.{reported}[{i + 1}]")
        for mean, reported in _LOADS.items()
        for i in range(3)
    ]
    return motions + loads


def _describe_system(document: dict, fmus: dict[str, _Fmu]) -> bytes:
    """Return SystemStructure.ssd."""
    connections = [
        link for vehicle in fmus if vehicle != "docking" for link in _find_connections(vehicle)
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
    for unit in fmus["docking"].units:
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


def _add_component(elements: ET.Element, name: str, fmu: _Fmu, connections: list[tuple]) -> None:
    """Add one FMU: its connectors, and the values of its parameters.

    A vehicle has only what is connected, and no values: an FMU of the user takes its place.
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
        outputs = fmu.names("output")
    connectors = _add(component, "ssd:Connectors")
    for kind, names in (("input", inputs), ("output", outputs)):
        for variable in names:
            connector = _add(connectors, "ssd:Connector", name=variable, kind=kind)
            _add_value(connector, "ssc", fmu.variables[variable][0])
    if name != "docking":
        return
    bindings = _add(component, "ssd:ParameterBindings")
    values = _add(_add(bindings, "ssd:ParameterBinding"), "ssd:ParameterValues")
    parameter_set = _add(values, "ssv:ParameterSet", version="1.0", name=PARAMETER_SET)
    parameters = _add(parameter_set, "ssv:Parameters")
    for known in fmu.names("parameter"):
        declared = fmu.variables[known][0]
        parameter = _add(parameters, "ssv:Parameter", name=known)
        _add_value(parameter, "ssv", declared, value=declared.get("start"))


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
