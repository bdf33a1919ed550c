"""What an FMU says about itself is true, complete and readable: types, limits, page, terminals.

Shown here: (1) every Real refers to a declared type of its unit; (2) in a docking no output leaves
its declared min and max, and typical sizes are typical; (3) the page names every variable, loads
nothing and its figures are well formed; (4) its first code example runs; (5) terminals follow the
schema of FMI 3.0, hold variables that exist, and are read by name as other tools do; (6) a licence
is there for every part of the library, and what it loads is stated; (7) the archive has the paths
that FMI asks for, and nothing but the scene decides its bytes; (8) a reference result, if wanted,
is that of the FMU. Validity of modelDescription.xml: test_fmu.py.
"""

import csv
import re
import xml.etree.ElementTree as ET
import zipfile
from html.parser import HTMLParser
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from lxml import etree

from conftest import SCENES
from dockloop.base import paths
from dockloop.fmu.build import build_fmu
from dockloop.fmu.licenses import PARTS
from dockloop.fmu.reference import FOLDER as REFERENCE
from dockloop.scene import shapes
from test_binary import FLOORS, parse

DEFAULT = "idss_25t_350t"
SCENES_WITH_LEGS = (
    "idss_25t_350t",
    "idss_100t_100t",
    "hexapod",
    "apda",
    "apda_cranks",
    "probe_drogue",
)  # and a target: their pages show the legs
HARD = ("initial.closing_speed=0.3", "chaser.contact_thrust=1500", "initial.pitch_yaw_deg=4")
VARIANTS = [
    *((scene,) for scene in SCENES),
    (DEFAULT, "chaser.motion=driven"),
    (DEFAULT, "target.motion=fixed"),
]
EVERY_VARIANT = pytest.mark.parametrize("variant", VARIANTS, ids=" ".join)

# Exponents of kg, m, s, rad (and A) of every unit, and how display units follow from it.
UNITS = {
    "1": (0, 0, 0, 0), "m": (0, 1, 0, 0), "m/s": (0, 1, -1, 0), "m/s2": (0, 1, -2, 0),
    "rad": (0, 0, 0, 1), "rad/s": (0, 0, -1, 1), "rad/s2": (0, 0, -2, 1), "s": (0, 0, 1, 0),
    "kg": (1, 0, 0, 0), "kg.m2": (1, 2, 0, 0), "N": (1, 1, -2, 0), "N.m": (1, 2, -2, 0),
    "N.s": (1, 1, -1, 0), "N.m.s": (1, 2, -1, 0), "J": (1, 2, -2, 0), "W": (1, 2, -3, 0),
    "1/s": (0, 0, -1, 0), "N/m": (1, 0, -2, 0), "N.s/m": (1, 0, -1, 0), "s/m": (0, -1, 1, 0),
    "A.m2": (0, 2, 0, 0, 1),
}  # fmt: skip
DISPLAY = {"mm": 1e3, "mm/s": 1e3, "deg": 180 / np.pi, "deg/s": 180 / np.pi, "t": 1e-3}


def read(fmu, name):
    """Return the content of one file of an FMU."""
    with zipfile.ZipFile(fmu) as archive:
        return archive.read(name)


def description(fmu):
    """Return modelDescription.xml."""
    return ET.fromstring(read(fmu, "modelDescription.xml"))


def variables(fmu):
    """Return the variables of an FMU with the attributes of their type element."""
    found = description(fmu).iterfind("ModelVariables/ScalarVariable")
    return {v.get("name"): (v, v[0]) for v in found}


# ------------------------------------------------------------------- modelDescription.xml


@EVERY_VARIANT
def test_every_real_has_a_declared_type_of_its_unit(runs, variant):
    fmu = runs.fmu(*variant)
    path = "TypeDefinitions/SimpleType"
    types = {t.get("name"): t.find("Real") for t in description(fmu).iterfind(path)}
    used = set()
    for name, (_, kind) in variables(fmu).items():
        if kind.tag != "Real":
            continue
        declared = types.get(kind.get("declaredType"))
        assert declared is not None, f"{name}: declaredType {kind.get('declaredType')}"
        for key in ("unit", "displayUnit"):
            assert kind.get(key) == declared.get(key), f"{name}: {key}"
        used.add(kind.get("declaredType"))
    assert used == set(types), "types that no variable has"
    assert not set(types) & set(variables(fmu)), "a type is named like a variable"


def test_a_ratio_is_no_number_of_a_force_law(runs):
    _, kind = variables(runs.fmu("idss_25t_350t"))["contact.regularisation"]
    assert kind.get("unit") == "1"
    assert kind.get("declaredType") != "LawNumber"


@EVERY_VARIANT
def test_units_have_the_right_exponents_and_display_factors(runs, variant):
    for unit in description(runs.fmu(*variant)).iterfind("UnitDefinitions/Unit"):
        base = unit.find("BaseUnit")
        exponents = tuple(int(base.get(key, 0)) for key in ("kg", "m", "s", "rad", "A"))
        expected = UNITS[unit.get("name")]
        assert exponents == (*expected, *(0,) * (5 - len(expected))), unit.get("name")
        for display in unit.iterfind("DisplayUnit"):
            factor = float(display.get("factor"))
            assert factor == pytest.approx(DISPLAY[display.get("name")]), display.get("name")


def spans(run, fmu):
    """Yield name, least and largest value seen, and attributes, of every recorded output."""
    for name, (variable, kind) in variables(fmu).items():
        if variable.get("causality") == "output" and kind.tag != "Boolean":
            yield name, float(np.min(run[name])), float(np.max(run[name])), kind


@pytest.mark.parametrize(
    "variant",
    [(DEFAULT,), (DEFAULT, *HARD), (DEFAULT, "chaser.motion=driven"), ("absorber_1d",),
     ("hexapod_bench",)],
    ids=" ".join,
)  # fmt: skip
def test_no_output_leaves_its_declared_limits(runs, variant):
    fmu = runs.fmu(*variant)
    limited = 0
    for name, low, high, kind in spans(runs.run(*variant), fmu):
        for limit, value, sign in ((kind.get("min"), low, 1), (kind.get("max"), high, -1)):
            if limit is not None:
                limited += 1
                assert sign * (value - float(limit)) >= 0, f"{name} = {value}, limit {limit}"
    assert limited >= 4


def test_nominal_values_are_within_a_factor_of_a_thousand_of_what_is_seen(runs):
    fmu = runs.fmu(DEFAULT)
    sizes, nominals = {}, {}
    for name, low, high, kind in spans(runs.run(DEFAULT), fmu):
        vector = re.sub(r"\[\d+\]", "", name)  # a component of a vector may vanish by symmetry
        sizes[vector] = max(sizes.get(vector, 0.0), abs(low), abs(high))
        if kind.tag == "Real":
            nominals[vector] = float(kind.get("nominal", 1.0))
    for name, (variable, kind) in variables(fmu).items():
        if variable.get("causality") == "parameter" and kind.tag == "Real":
            vector = re.sub(r"\[\d+\]", "", name)
            sizes[vector] = max(sizes.get(vector, 0.0), abs(float(kind.get("start"))))
            nominals[vector] = float(kind.get("nominal", 1.0))
    seen = {name: sizes[name] / nominals[name] for name in nominals if sizes[name] > 0}
    assert len(seen) > 40
    assert {name: ratio for name, ratio in seen.items() if not 1e-3 <= ratio <= 1e3} == {}


# ------------------------------------------------------------------- the page


class Page(HTMLParser):
    """Checks nesting, and gathers texts, addresses, anchors and figures of a page."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self, text):
        super().__init__()
        self.open, self.addresses, self.anchors, self.words = [], [], set(), []
        self.feed(text)
        self.close()
        self.figures = re.findall(r"<svg.*?</svg>", text, re.DOTALL)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag not in self.VOID:
            self.open.append(tag)
        if "id" in attributes:
            assert attributes["id"] not in self.anchors, f"two of {attributes['id']}"
            self.anchors.add(attributes["id"])
        self.addresses += [attributes[key] for key in ("href", "src") if key in attributes]

    def handle_startendtag(self, tag, attrs):
        """Marks of a figure that are closed at once."""

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        last = self.open.pop()
        assert last == tag, f"</{tag}> closes <{last}>"

    def handle_data(self, data):
        self.words.append(data)


@EVERY_VARIANT
def test_the_page_names_every_variable_and_loads_nothing(runs, variant):
    fmu = runs.complete_fmu(*variant)
    text = read(fmu, "documentation/index.html").decode()
    page = Page(text)
    assert page.open == [], "elements that are never closed"
    assert [name for name in variables(fmu) if name not in page.words] == []
    with zipfile.ZipFile(fmu) as archive:
        files = set(archive.namelist())
    for address in page.addresses:
        if address.startswith("#"):
            assert address[1:] in page.anchors, address
        elif not address.startswith("data:"):
            assert f"documentation/{address}" in files, address
    assert "url(" not in text
    assert "<script" not in text


@EVERY_VARIANT
def test_the_figures_of_the_page_are_well_formed(runs, variant):
    fmu = runs.complete_fmu(*variant)
    figures = Page(read(fmu, "documentation/index.html").decode()).figures
    for figure in figures:
        sheet = ET.fromstring(figure)
        width, height = (float(n) for n in sheet.get("viewBox").split()[2:])
        for mark in sheet.iter():
            pairs = [pair.split(",") for pair in mark.get("points", "").split()]
            if "cx" in mark.attrib:
                pairs.append((mark.get("cx"), mark.get("cy")))
            for x, y in pairs:
                assert 0 <= float(x) <= width, f"{mark.tag} at x = {x} of {width}"
                assert 0 <= float(y) <= height, f"{mark.tag} at y = {y} of {height}"
    assert len(figures) == (3 if variant[0] in SCENES_WITH_LEGS else 2) + (
        "chaser.motion=driven" in variant
    )


def test_the_legs_are_drawn_where_the_mechanism_has_them(runs):
    legs = runs.run(DEFAULT, stop=0.1, step=0.1)
    drawn = shapes.find_legs(legs.scene["mechanism"])
    assert len(drawn) == 6
    for i, (_, root, end) in enumerate(drawn, start=1):
        length = float(np.linalg.norm(end - root))
        assert legs[f"leg[{i}].length"][0] == pytest.approx(length, abs=1e-12), i


def test_bodies_are_drawn_where_their_joint_coordinates_at_home_put_them():
    quarter = np.pi / 2
    joints = [
        {"type": "revolute", "axis": [0, 0, 1], "position": [1, 0, 0]},
        {"type": "prismatic", "axis": [1, 0, 0]},
        {"type": "free", "position": [0, 0, 1]},
    ]
    bodies = [
        {"name": str(i), "parent": str(i - 1) if i else "base", "joint": joint}
        for i, joint in enumerate(joints)
    ]
    half = np.sqrt(0.5)  # a quarter turn about x
    home_q = [quarter, 2.0, 0.0, 0.0, 3.0, half, half, 0.0, 0.0]
    places = shapes.find_body_places({"bodies": bodies}, home_q)
    # The first turns x into y; the second slides 2 along it; the third is 1 + 3 above it.
    assert places["1"][1] == pytest.approx([1, 2, 0])
    assert places["2"][1] == pytest.approx([1, 2, 4])
    assert places["2"][0] @ (0, 1, 0) == pytest.approx([0, 0, 1])
    assert places["2"][0] @ (1, 0, 0) == pytest.approx([0, 1, 0])


def test_the_quick_start_of_the_page_runs(runs, monkeypatch, capsys):
    fmu = runs.complete_fmu("absorber_1d")
    tree = etree.HTML(read(fmu, "documentation/index.html").decode())
    code = "".join(tree.find(".//pre[@id='quick-start']").itertext())
    monkeypatch.chdir(fmu.parent)
    exec(code, {})
    time = float(re.search(r"[\d.]+", capsys.readouterr().out)[0])
    assert time == pytest.approx(5.0)


# ------------------------------------------------------------------- terminals, licences, archive


def terminals(fmu):
    """Return the terminals as importers read them: children of the first element of the file."""
    root = ET.fromstring(read(fmu, "terminalsAndIcons/terminalsAndIcons.xml"))
    return {t.get("name"): t for t in root[0] if t.tag == "Terminal"}


@EVERY_VARIANT
def test_terminals_follow_the_schema_and_hold_variables_that_exist(runs, variant):
    fmu = runs.complete_fmu(*variant)
    schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"
    document = etree.fromstring(read(fmu, "terminalsAndIcons/terminalsAndIcons.xml"))
    etree.XMLSchema(file=str(schema)).assertValid(document)
    known = variables(fmu)
    vehicles = {"chaser", "target"} if "target.force[1]" in known else {"chaser"}
    found = terminals(fmu)
    assert set(found) == {*vehicles, "gravity"}
    with zipfile.ZipFile(fmu) as archive:
        files = set(archive.namelist())
    for name, terminal in found.items():
        members = list(terminal.iterfind("TerminalMemberVariable"))
        assert len({m.get("memberName") for m in members}) == len(members)
        for member in members:
            variable = known[member.get("variableName")][0]
            assert variable.get("causality") in ("input", "output"), member.get("variableName")
            assert variable.get("name") in (
                f"{name}.{member.get('memberName')}",
                member.get("memberName"),
            )
        icon = terminal.find("TerminalGraphicalRepresentation").get("iconBaseName")
        assert f"terminalsAndIcons/{icon}.png" in files


def test_a_driven_vehicle_offers_pose_in_and_mean_loads_out_in_one_terminal(runs):
    fmu = runs.complete_fmu(DEFAULT, "chaser.motion=driven")
    known = variables(fmu)
    wanted = {
        **{f"{name}[{i}]": "input" for name in ("position", "velocity") for i in (1, 2, 3)},
        **{f"attitude[{i}]": "input" for i in (1, 2, 3, 4)},
        **{f"{name}[{i}]": "output" for name in ("force_mean", "torque_mean") for i in (1, 2, 3)},
    }
    members = {
        m.get("memberName"): known[m.get("variableName")][0].get("causality")
        for m in terminals(fmu)["chaser"].iterfind("TerminalMemberVariable")
    }
    assert {name: members.get(name) for name in wanted} == wanted


def test_there_is_a_licence_for_every_part_of_the_library(runs):
    fmu = runs.complete_fmu(DEFAULT)
    overall = read(fmu, "documentation/licenses/license.txt").decode()
    assert "Redistribution and use in source and binary forms" in overall
    for part in PARTS[1:]:
        assert part.file in overall, part.name
        text = read(fmu, f"documentation/licenses/{part.file}").decode()
        assert "opyright" in text, part.name
        assert len(text) > 1000, part.name


def test_what_the_library_loads_is_stated(runs):
    fmu = runs.complete_fmu(DEFAULT)
    text = read(fmu, "documentation/externalDependencies.txt").decode()
    packed = read(fmu, f"binaries/linux64/{DEFAULT}.so")
    name = "native" if packed == paths.LIBRARY.read_bytes() else "linux64"
    needed = {library for library in parse(packed).libraries if library.startswith("lib")}
    assert set(re.findall(r"lib\S+?\.so\.\d+", text)) >= needed
    assert f"glibc {'.'.join(map(str, FLOORS[name]['GLIBC']))} or newer" in text


def test_icons_are_png_pictures(runs):
    fmu = runs.complete_fmu(DEFAULT)
    with zipfile.ZipFile(fmu) as archive:
        icons = [name for name in archive.namelist() if name.endswith(".png")]
        assert {"model.png", "terminalsAndIcons/icon.png"} <= set(icons)
        for name in icons:
            assert archive.read(name).startswith(b"\x89PNG\r\n\x1a\n"), name


@EVERY_VARIANT
def test_the_archive_holds_plain_relative_paths_and_nothing_twice(runs, variant):
    with zipfile.ZipFile(runs.complete_fmu(*variant)) as archive:
        names = archive.namelist()
        assert len(set(names)) == len(names)
        for info in archive.infolist():
            assert not info.filename.startswith("/"), info.filename
            assert ".." not in info.filename.split("/"), info.filename
            assert "\\" not in info.filename, info.filename
            assert info.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
            assert info.external_attr >> 28 in (0, 8), f"{info.filename} is not a plain file"


@pytest.mark.parametrize("scene", SCENES)
def test_the_bytes_of_the_archive_depend_on_the_scene_only(runs, scene, tmp_path, monkeypatch):
    first = runs.complete_fmu(scene).read_bytes()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TZ", "Pacific/Auckland")
    assert build_fmu(scene, (), tmp_path / "elsewhere.fmu").read_bytes() == first


def test_a_reference_result_can_be_put_into_the_fmu(dockloop, tmp_path):
    dockloop.succeed("build", "absorber_1d", "--reference", "-o", tmp_path / "a.fmu")
    assert validate_fmu(str(tmp_path / "a.fmu")) == []
    manifest = ET.fromstring(read(tmp_path / "a.fmu", f"{REFERENCE}/fmi-ls-manifest.xml"))
    source = manifest.find("Related").get("source")
    lines = read(tmp_path / "a.fmu", f"{REFERENCE}/{source}").decode().splitlines()
    names, *rows = csv.reader(lines)
    table = dict(zip(names, np.array(rows, float).T, strict=True))
    outputs = ["relative.axial", "energy.kinetic"]
    result = fmpy.simulate_fmu(str(tmp_path / "a.fmu"), output=outputs)
    for name in outputs:
        again = np.interp(table["time"], result["time"], result[name])
        assert np.max(np.abs(again - table[name])) < 1e-7, name
    assert table["time"][-1] == 5.0
