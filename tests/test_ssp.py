"""The SSP package of a scene: what is in it, and that it runs as it stands in four importers.

1. It obeys the schema of SSP 1.0; connectors exist in the FMUs with the stated causality and type;
   every input that is listed is connected (fmpy.ssp fails otherwise); no Enumeration.
2. The same scene gives the same bytes; all FMUs start from one placed state, with one mass.
3. libcosim, ecos, fmpy.ssp and a container FMU agree with each other to the last bit (fmpy.ssp,
   which begins with zeros, to rounding), and with the run of one FMU that integrates both vehicles
   as far as loads held over a step allow.
4. Parameter values of the package reach the FMUs.
5. The FMU of a vehicle is a rigid body. A package needs a vehicle that moves and a mechanism.
6. The programs in the README run.
"""

import functools
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.ssp.ssd import read_ssd
from fmpy.validation import validate_fmu

from dockloop import paths
from dockloop.ssp import build_ssp
from importers import find_obstacle, run_importer

STEP = 1 / 512  # s; exact in binary and in nanoseconds
STEPS = 512
SCENE = ("idss_25t_350t", "initial.approach_time=0.02")
IMPORTERS = ("libcosim", "ecos", "fmpy.ssp", "container")
RESULTS = [
    *(f"relative.position[{i + 1}]" for i in range(3)),
    *(f"relative.attitude[{i + 1}]" for i in range(4)),
    *(f"capture.peak.{load}" for load in ("compression", "shear", "bending", "torsion")),
    *("time_of_contact", "time_of_capture", "phase", "captured"),
]
MOTION = {"position": 3, "velocity": 3, "attitude": 4, "angular_velocity": 3}
SSD = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The package of a short docking."""
    folder = tmp_path_factory.mktemp("ssp")
    return build_ssp(SCENE[0], (SCENE[1], f"experiment.step={STEP}"), folder / "docking.ssp")


@pytest.fixture(scope="module")
def fmus(package, tmp_path_factory):
    """The FMUs in the package by component."""
    folder = tmp_path_factory.mktemp("fmus")
    with zipfile.ZipFile(package) as archive:
        archive.extractall(folder)
    return {name: folder / "resources" / f"{name}.fmu" for name in ("chaser", "target", "docking")}


@pytest.fixture(scope="module")
def result_of(package):
    """A function from importers to the results of the package, each run once."""

    @functools.cache
    def run(importer):
        return run_importer(importer, package, STEP, STEPS, RESULTS)

    return run


@pytest.fixture(scope="module")
def monolithic(runs):
    """Results of the one FMU that integrates both vehicles."""
    result = simulate_fmu(
        str(runs.fmu(*SCENE)),
        stop_time=STEP * STEPS,
        step_size=STEP,
        output_interval=STEP,
        output=RESULTS,
    )
    return {name: result[name][-1].item() for name in RESULTS}


def read_structure(package):
    """Return the root of SystemStructure.ssd."""
    with zipfile.ZipFile(package) as archive:
        return ET.fromstring(archive.read("SystemStructure.ssd"))


def find_starts(fmu, vehicle):
    """Return the start values of motion, mass and inertia of a vehicle."""
    variables = {v.name: v for v in read_model_description(fmu).modelVariables}
    vectors = {**MOTION, "inertia": 6}.items()
    names = [f"{vehicle}.{name}[{i + 1}]" for name, n in vectors for i in range(n)]
    return [float(variables[name].start) for name in (*names, f"{vehicle}.mass")]


def test_the_structure_obeys_the_schema_and_fits_its_fmus(package, fmus):
    read_ssd(str(package))  # validates against the schema of SSP 1.0
    root = read_structure(package)
    lines = root.iter(f"{{{SSD['ssd']}}}Connection")
    ends = [(line.get("endElement"), line.get("endConnector")) for line in lines]
    assert len(ends) == len(set(ends)) == 2 * (13 + 6)
    for component in root.iter(f"{{{SSD['ssd']}}}Component"):
        name = component.get("name")
        variables = {v.name: v for v in read_model_description(fmus[name]).modelVariables}
        for connector in component.iter(f"{{{SSD['ssd']}}}Connector"):
            variable = variables[connector.get("name")]
            assert connector.get("kind") == variable.causality
            assert connector[0].tag == f"{{{SSD['ssc']}}}{variable.type}"
            assert connector[0].get("unit") == variable.unit
            assert variable.type in ("Real", "Integer", "Boolean")
            assert variable.causality != "input" or (name, variable.name) in ends
        for parameter in component.iter(f"{{{SSD['ssv']}}}Parameter"):
            variable = variables[parameter.get("name")]
            assert variable.causality == "parameter"
            assert parameter[0].get("value") == variable.start


@pytest.mark.parametrize("name", ["chaser", "target", "docking"])
def test_every_fmu_of_the_package_is_valid(fmus, name):
    assert validate_fmu(str(fmus[name])) == []


def test_the_same_scene_gives_the_same_package(tmp_path):
    first = build_ssp("idss_100t_100t", (), tmp_path / "a.ssp")
    second = build_ssp("idss_100t_100t", (), tmp_path / "b" / "c.ssp")
    assert first.read_bytes() == second.read_bytes()


def test_all_fmus_have_the_vehicles_of_the_scene_where_they_were_placed(runs, fmus):
    for vehicle in ("chaser", "target"):
        free = find_starts(runs.fmu(*SCENE), vehicle)
        assert find_starts(fmus["docking"], vehicle) == free
        assert find_starts(fmus[vehicle], "chaser") == free
        assert np.linalg.norm(free[:3]) > 1.0 or vehicle == "target"


@pytest.mark.parametrize("importer", IMPORTERS)
def test_the_package_gives_the_docking_of_one_fmu(result_of, monolithic, importer):
    # Differences found: position 1.4e-5 m, attitude 1.2e-6, peaks 2.2e-3 of the value, time of
    # capture 6.4e-5 s. They are of first order in the step: loads reach the vehicles one step late.
    found = result_of(importer)

    def differ(prefix):
        return max(abs(found[n] - monolithic[n]) for n in RESULTS if n.startswith(prefix))

    assert differ("relative.position") < 5e-5  # m, of 0.1 m travelled since contact
    assert differ("relative.attitude") < 2e-5
    assert differ("time_of_contact") < 1e-6  # s
    assert differ("time_of_capture") < STEP
    for name in RESULTS:
        if name.startswith("capture.peak"):
            assert found[name] == pytest.approx(monolithic[name], rel=0.02), name
    assert found["phase"] == monolithic["phase"]
    assert found["captured"] is True


@pytest.mark.parametrize("importer", ["ecos", "container"])
def test_importers_give_the_same_bits(result_of, importer):
    assert result_of(importer) == result_of("libcosim")


def test_fmpy_ssp_gives_the_same_to_rounding(result_of):
    # Differences found: 7e-11; peaks 6e-4 of the value (stiff contact magnifies).
    found, expected = result_of("fmpy.ssp"), result_of("libcosim")
    for name in RESULTS:
        tolerance = {"rel": 5e-3} if name.startswith("capture.peak") else {"abs": 1e-6}
        assert found[name] == pytest.approx(expected[name], **tolerance), name


@pytest.mark.parametrize("importer", ["libcosim", "ecos"])  # the others take no values from it
def test_parameter_values_of_the_package_reach_the_fmus(package, tmp_path, importer):
    edited = tmp_path / "edited.ssp"
    with zipfile.ZipFile(package) as source, zipfile.ZipFile(edited, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "SystemStructure.ssd":
                before = b'name="friction.coefficient">\n                    <ssv:Real value="0.1"'
                assert content.count(before) == 1
                content = content.replace(before, before.replace(b'"0.1"', b'"0.35"'))
            target.writestr(name, content)
    found = run_importer(importer, edited, STEP, 1, ["friction.coefficient"])
    assert found == {"friction.coefficient": 0.35}


def test_the_fmu_of_a_vehicle_is_a_rigid_body(fmus):
    # 25 t and 60.5 t m2 about x. Force in N, torque in body axes.
    starts = {"chaser.force_ext[1]": 500.0, "chaser.torque_ext[1]": 121.0}
    names = ["chaser.velocity[1]", "chaser.angular_velocity[1]", "chaser.position[1]"]
    result = simulate_fmu(
        str(fmus["chaser"]),
        start_values=starts,
        stop_time=10.0,
        output_interval=1.0,
        output=names,
        apply_default_start_values=True,
    )
    change = [result[name] - result[name][0] for name in names]
    t = result["time"]
    assert np.max(np.abs(change[0] - 0.02 * t)) < 1e-9
    assert np.max(np.abs(change[2] - result[names[0]][0] * t - 0.01 * t**2)) < 1e-8
    assert change[1][-1] == pytest.approx(0.02, rel=1e-3)  # it turns about y and z as well


@pytest.mark.parametrize(
    ("importer", "word"),
    [
        ("libcosim", "libcosimpy"),
        ("ecos", "ecospy"),
        ("fmpy.ssp", "simulate_ssp"),
        ("container", "Assembly"),
    ],
)
def test_the_programs_in_the_readme_run(package, tmp_path, importer, word):
    if reason := find_obstacle(importer):
        pytest.skip(reason)
    blocks = re.findall(r"```python\n(.*?)```", (paths.ROOT / "README.md").read_text(), re.DOTALL)
    (program,) = (block for block in blocks if word in block)
    shutil.copy(package, tmp_path / "docking.ssp")
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    made = {"libcosim": "results/docking_*.csv", "container": "docking.fmu"}.get(importer)
    assert list(tmp_path.glob(made)) if made else float(done.stdout.split()[-1]) != 0.0


def test_a_fixed_vehicle_has_no_component(tmp_path):
    package = build_ssp(SCENE[0], ("target.motion=fixed",), tmp_path / "fixed.ssp")
    names = [c.get("name") for c in read_structure(package).iter(f"{{{SSD['ssd']}}}Component")]
    assert names == ["chaser", "docking"]


def test_the_command_builds_a_package_and_says_where(dockloop, tmp_path):
    status, out, err = dockloop("ssp", "absorber_1d")
    assert (status, err) == (0, "")
    assert out.startswith("build/ssp/absorber_1d.ssp")
    assert (tmp_path / "build/ssp/absorber_1d.ssp").is_file()


def test_a_package_without_a_vehicle_that_moves_is_refused(dockloop):
    status, _, err = dockloop("ssp", "hexapod_bench")
    assert status == 2
    assert "hexapod_bench.toml: no vehicle is free or driven" in err
    assert len(err.splitlines()) == 1


def test_a_package_without_mechanism_is_refused(dockloop, tmp_path):
    scene = tmp_path / "alone.toml"
    scene.write_text("[chaser]\nmass = 10\ninertia = [1, 2, 2, 0, 0, 0]\n")
    status, _, err = dockloop("ssp", scene)
    assert status == 2
    assert "alone.toml: has no [mechanism]" in err


def test_help_shows_an_example(dockloop):
    status, out, _ = dockloop("ssp", "--help")
    assert status == 0
    assert "example: dockloop ssp" in out
