"""The SSP package of a scene: what is in it, and that it runs as it stands in four importers.

1. It obeys the schema of SSP 1.0; connectors exist in the FMUs with the stated causality and type;
   every input that is listed is connected (fmpy.ssp fails otherwise); no Enumeration.
2. The same scene gives the same bytes; all FMUs start from one placed state, with one mass.
3. When each master hands on values: all of them step in parallel, with the values of the start of
   the step; a container can also step one component after the other. All but fmpy.ssp hand on
   values before the first step.
4. In all of them the package gives the run of one FMU that integrates both vehicles: velocities,
   peaks, times, in steps of 16 ms; momentum adds up, as seen from outside. In the wrong mode it is
   of first order. libcosim and ecos agree to the last bit.
5. Parameter values of the package reach the FMUs.
6. The FMU of a vehicle is a rigid body that holds its loads over a step, the force in N, the torque
   in axes that turn. A package needs a vehicle that moves and a mechanism.
7. The programs in the README and the example run.
"""

import functools
import re
import shutil
import sys
import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.ssp.ssd import read_ssd
from fmpy.validation import validate_fmu

from dockloop.base import paths
from dockloop.fmu.build import build_fmu
from dockloop.fmu.ssp import build_ssp
from extreme_cases.fmi_host import Host
from importers import find_obstacle, record_importer, run_importer
from programs import call

pytestmark = pytest.mark.long  # four importers run whole packages

STEP = 1 / 64  # s; exact in binary and in nanoseconds
STEPS = 128
SPEED = 0.1  # m/s, at which the vehicles close
SCENE = (
    "idss_25t_350t",
    "initial.approach_time=0.02",
    "solver.rtol=1e-8",
    "solver.atol_position=1e-10",
    "solver.atol_velocity=1e-10",
    f"experiment.step={STEP}",
    'outputs.groups=["relative", "capture", "contact", "phase", "energy", "coupling"]',
)
IN_SEQUENCE = "coupling.mode=sequential"
PARALLEL = ("libcosim", "ecos", "fmpy.ssp", "container")
MASTERS = (*PARALLEL, "sequential container")
RESULTS = [
    *(f"relative.position[{i + 1}]" for i in range(3)),
    *(f"relative.attitude[{i + 1}]" for i in range(4)),
    *(f"capture.peak.{load}" for load in ("compression", "shear", "bending", "torsion")),
    *("time_of_contact", "time_of_capture", "phase", "captured"),
]
MOTION = {"position": 3, "velocity": 3, "attitude": 4, "angular_velocity": 3}
MOTIONS = [
    f"{vehicle}.{name}[{i + 1}]"
    for vehicle in ("chaser", "target")
    for name, count in MOTION.items()
    for i in range(count)
]
INSIDE = [
    f"{name}[{i + 1}]"
    for name in (
        "momentum.linear",
        "momentum.angular",
        "momentum.reference",
        "coupling.pending_impulse",
        "coupling.pending_angular_impulse",
    )
    for i in range(3)
]
SSD = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The package of a short docking, as users get it."""
    return build_ssp(SCENE[0], SCENE[1:], tmp_path_factory.mktemp("ssp") / "docking.ssp")


@pytest.fixture(scope="module")
def bare_package(tmp_path_factory):
    """A function from scene and overrides to a package to be run; each built once."""

    @functools.cache
    def build(scene, *overrides):
        file = tmp_path_factory.mktemp("ssp") / "docking.ssp"
        return build_ssp(scene, overrides, file, bare=True)

    return build


@pytest.fixture(scope="module")
def fmus(package, tmp_path_factory):
    """The FMUs in the package by component."""
    folder = tmp_path_factory.mktemp("fmus")
    with zipfile.ZipFile(package) as archive:
        archive.extractall(folder)
    return {name: folder / "resources" / f"{name}.fmu" for name in ("chaser", "target", "docking")}


@pytest.fixture(scope="module")
def recording_of(bare_package):
    """A function from masters to all that is looked at, after every step; each run once."""

    @functools.cache
    def record(master, wrong_mode=False):
        sequential = (master == "sequential container") != wrong_mode
        file = bare_package(*SCENE, *([IN_SEQUENCE] if sequential else []))
        reported = {f"{name.partition('.')[0]}::{rename(name)}": name for name in MOTIONS}
        names = [*RESULTS, *INSIDE, *reported]
        found = record_importer(master, file, STEP, STEPS, names, every=1)
        return {reported.get(name, name): np.array(values) for name, values in found.items()}

    return record


@pytest.fixture(scope="module")
def alone(runs):
    """The same, of the one FMU that integrates both vehicles."""
    names = [*RESULTS, *MOTIONS]
    found = record_importer("fmpy", runs.fmu(*SCENE), STEP, STEPS, names, every=1)
    return {name: np.array(values) for name, values in found.items()}


def rename(name):
    """Return the name of a variable in the FMU of its vehicle."""
    return f"chaser.{name.partition('.')[2]}"


def find_vector(recording, name, count=3):
    """Return a vector over time, one row per step."""
    return np.stack([recording[f"{name}[{i + 1}]"] for i in range(count)], axis=1)


def read_structure(package):
    """Return the root of SystemStructure.ssd."""
    with zipfile.ZipFile(package) as archive:
        return ET.fromstring(archive.read("SystemStructure.ssd"))


def find_starts(fmu, vehicle):
    """Return the start values of motion, mass and inertia of a vehicle."""
    starts = read_starts(fmu)
    vectors = {**MOTION, "inertia": 6}.items()
    names = [f"{vehicle}.{name}[{i + 1}]" for name, n in vectors for i in range(n)]
    return [starts[name] for name in (*names, f"{vehicle}.mass")]


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
        listed = [c.get("name") for c in component.iter(f"{{{SSD['ssd']}}}Connector")]
        if name != "docking":  # what an own vehicle needs, and nothing that it may lack
            assert set(listed) == {rename(n) for n in MOTIONS} | {
                f"chaser.{load}_ext[{i + 1}]" for load in ("force", "torque") for i in range(3)
            }
            assert component.find(f"{{{SSD['ssd']}}}ParameterBindings") is None
        for parameter in component.iter(f"{{{SSD['ssv']}}}Parameter"):
            variable = variables[parameter.get("name")]
            assert variable.causality == "parameter"
            assert parameter[0].get("value") == variable.start


@pytest.mark.parametrize("name", ["chaser", "target", "docking"])
def test_every_fmu_of_the_package_is_valid(fmus, name):
    assert validate_fmu(str(fmus[name])) == []


def test_the_same_scene_gives_the_same_package(bare_package, tmp_path):
    second = build_ssp(SCENE[0], SCENE[1:], tmp_path / "b" / "c.ssp", bare=True)
    assert bare_package(*SCENE).read_bytes() == second.read_bytes()


def test_all_fmus_have_the_vehicles_of_the_scene_where_they_were_placed(runs, fmus):
    for vehicle in ("chaser", "target"):
        free = find_starts(runs.fmu(*SCENE), vehicle)
        assert find_starts(fmus["docking"], vehicle) == free
        assert find_starts(fmus[vehicle], "chaser") == free
        assert np.linalg.norm(free[:3]) > 1.0 or vehicle == "target"


@pytest.fixture(scope="module")
def chain_of(tmp_path_factory):
    """A function from the order of two components to their package; each written once."""
    return functools.cache(lambda *names: write_chain(tmp_path_factory.mktemp("chain"), names))


def write_chain(folder, names):
    """Write a package in which `leader`, that moves at 1 m/s from 1 m, pushes `docking` of 1 kg.

    The force in newton on `docking` is the position of `leader` in metres.
    """
    states = {"leader": "position = [1, 0, 0]\nvelocity = [1, 0, 0]", "docking": ""}
    ports = {"leader": [("output", "position")]}
    ports["docking"] = [("input", "force_ext"), ("output", "velocity")]
    components = ""
    package = folder / f"{names[0]}_first.ssp"
    with zipfile.ZipFile(package, "w") as archive:
        for name in names:
            scene = folder / f"{name}.toml"
            scene.write_text(
                f"[chaser]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n{states[name]}\n"
                "[experiment]\nstop = 3.0\nstep = 1.0\n"
            )
            fmu = build_fmu(scene, (), folder / f"{name}.fmu", bare=True)
            archive.write(fmu, f"resources/{name}.fmu")
            connectors = "".join(
                f'<ssd:Connector name="chaser.{port}[1]" kind="{kind}"><ssc:Real/></ssd:Connector>'
                for kind, port in ports[name]
            )
            components += (
                f'<ssd:Component name="{name}" source="resources/{name}.fmu"'
                ' type="application/x-fmu-sharedlibrary" implementation="CoSimulation">'
                f"<ssd:Connectors>{connectors}</ssd:Connectors></ssd:Component>"
            )
        archive.writestr(
            "SystemStructure.ssd",
            f'<ssd:SystemStructureDescription xmlns:ssd="{SSD["ssd"]}" xmlns:ssc="{SSD["ssc"]}"'
            f' version="1.0" name="chain"><ssd:System name="chain"><ssd:Elements>{components}'
            '</ssd:Elements><ssd:Connections><ssd:Connection startElement="leader"'
            ' startConnector="chaser.position[1]" endElement="docking"'
            ' endConnector="chaser.force_ext[1]"/></ssd:Connections></ssd:System>'
            '<ssd:DefaultExperiment startTime="0" stopTime="3"/></ssd:SystemStructureDescription>',
        )
    return package


@pytest.mark.parametrize("first", ["leader", "docking"])
@pytest.mark.parametrize("master", MASTERS)
def test_when_a_master_hands_on_values(chain_of, master, first):
    # The leader is at 1, 2, 3, 4 m after 0, 1, 2, 3 steps of 1 s. The speed that the other one has
    # gained in a step shows which of these it was pushed by: that of the start of the step where
    # all step at once, that of its end where the leader has stepped before it.
    names = ("leader", "docking") if first == "leader" else ("docking", "leader")
    name = "chaser.velocity[1]"
    speed = record_importer(master, chain_of(*names), 1.0, 3, [name], every=1)[name]
    ahead = master == "sequential container" and first == "leader"
    expected = [2.0, 3.0, 4.0] if ahead else [1.0, 2.0, 3.0]
    if master == "fmpy.ssp":
        expected[0] = 0.0
    assert np.diff(speed, prepend=0.0) == pytest.approx(expected, abs=1e-12)


def differ(found, expected, prefix):
    """Return the largest difference over time and variables."""
    names = [name for name in MOTIONS + RESULTS if name.startswith(prefix)]
    return max(np.max(np.abs(1.0 * found[n] - expected[n])) for n in names)


@pytest.mark.parametrize("master", MASTERS)
def test_the_package_gives_the_docking_of_one_fmu(recording_of, alone, master):
    # Largest differences found stand next to the limits; the vehicles' own positions keep
    # H^2 a / 12 (6e-7 m), since they move under means.
    found = recording_of(master)
    assert alone["captured"][-1]
    assert differ(found, alone, "chaser.velocity") < 2e-8 * SPEED  # 2e-9
    assert differ(found, alone, "target.velocity") < 1e-9 * SPEED  # 1e-10
    assert differ(found, alone, "chaser.position") < 6e-6
    assert differ(found, alone, "relative.position") < 3e-9  # 3e-10
    assert differ(found, alone, "relative.attitude") < 3e-10  # 2e-11
    assert differ(found, alone, "time_of_contact") < 3e-10  # 3e-11
    assert differ(found, alone, "time_of_capture") < 2e-7  # 2e-8
    for name in RESULTS:
        if name.startswith("capture.peak"):  # 5e-6
            assert found[name][-1] == pytest.approx(alone[name][-1], rel=5e-5), name
    assert np.array_equal(found["phase"], alone["phase"])


@pytest.mark.parametrize("master", MASTERS)
def test_a_load_from_the_first_step_on_reaches_the_vehicles(runs, bare_package, master):
    # The absorber touches at the start. fmpy.ssp hands on nothing before the first step, so its
    # vehicles feel that step's load in the second one.
    scene = ("absorber_1d", *SCENE[2:5], f"experiment.step={STEP}")
    mode = (IN_SEQUENCE,) if master == "sequential container" else ()
    package = bare_package(*scene, *mode)
    reported = {
        "relative.axial": "relative.axial",
        "chaser.velocity[1]": "chaser::chaser.velocity[1]",
    }
    found = record_importer(master, package, STEP, 64, reported.values(), every=1)
    expected = record_importer("fmpy", runs.fmu(*scene), STEP, 64, reported, every=1)
    for name, outside in reported.items():
        difference = np.max(np.abs(np.subtract(found[outside], expected[name]))[1:])
        assert np.ptp(expected[name]) > 0.01
        assert difference < 2e-11, name  # 4e-12: at points inside a step


def test_in_the_wrong_mode_it_is_of_first_order(recording_of, alone):
    # 0.4 % of the closing speed: in a parallel master the mean of a step comes one step late.
    error = differ(recording_of("ecos", wrong_mode=True), alone, "chaser.velocity")
    assert 1e-3 * SPEED < error < 1e-2 * SPEED


@pytest.mark.parametrize("master", MASTERS)
def test_momentum_adds_up_as_seen_from_outside(recording_of, fmus, master):
    found = recording_of(master)
    linear = find_vector(found, "momentum.linear") + find_vector(found, "coupling.pending_impulse")
    angular = find_vector(found, "momentum.angular")
    angular = angular + find_vector(found, "coupling.pending_angular_impulse")
    reference = find_vector(found, "momentum.reference")
    largest = [0.0, 0.0]
    for vehicle in ("chaser", "target"):
        starts = read_starts(fmus["docking"])
        mass = starts[f"{vehicle}.mass"]
        inertia = make_symmetric([starts[f"{vehicle}.inertia[{i + 1}]"] for i in range(6)])
        p = mass * find_vector(found, f"{vehicle}.velocity")
        turned = find_vector(found, f"{vehicle}.angular_velocity") @ inertia
        spin = rotate(find_vector(found, f"{vehicle}.attitude", 4), turned)
        spin += np.cross(find_vector(found, f"{vehicle}.position") - reference, p)
        linear, angular = linear + p, angular + spin
        largest = [max(largest[0], np.max(np.abs(p))), max(largest[1], np.max(np.abs(spin)))]
    residuals = [np.max(np.abs(x - x[0])) for x in (linear, angular)]  # 2e-11, 7e-12
    assert residuals[0] < 1e-13 * largest[0], f"{residuals[0]:.3g} N s of {largest[0]:.3g}"
    assert residuals[1] < 1e-13 * largest[1], f"{residuals[1]:.3g} N m s of {largest[1]:.3g}"


def read_starts(fmu):
    """Return all start values of an FMU."""
    return {
        v.name: float(v.start)
        for v in read_model_description(fmu).modelVariables
        if v.type == "Real" and v.start is not None
    }


def make_symmetric(six):
    """Return the matrix of (xx, yy, zz, xy, xz, yz)."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def rotate(q, v):
    """Rotate vectors by quaternions (w, x, y, z), row by row."""
    w, r = q[..., :1], q[..., 1:]
    return v + 2.0 * np.cross(r, np.cross(r, v) + w * v)


def test_libcosim_and_ecos_give_the_same_bits(recording_of):
    found, expected = recording_of("ecos"), recording_of("libcosim")
    names = [*MOTIONS, *RESULTS]
    assert [n for n in names if not np.array_equal(found[n], expected[n])] == []


@pytest.mark.parametrize("importer", ["libcosim", "ecos"])  # the others take no values from it
def test_parameter_values_of_the_package_reach_the_fmus(bare_package, tmp_path, importer):
    edited = tmp_path / "edited.ssp"
    with zipfile.ZipFile(bare_package(*SCENE)) as source, zipfile.ZipFile(edited, "w") as target:
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


def test_the_fmu_of_a_vehicle_holds_its_loads_over_a_step(tmp_path):
    # Tumbling at 0.6 rad/s, with other loads in every step; against 40 Runge-Kutta steps of a
    # rigid body for each of them. Difference found: 1e-9.
    inertia = [60.0, 110.0, 120.0, 3.0, -4.0, 5.0]
    scene = tmp_path / "tumbling.toml"
    scene.write_text(
        f"[chaser]\nmass = 500\ninertia = {inertia}\nvelocity = [0.1, -0.2, 0.3]\n"
        "angular_velocity = [0.3, -0.4, 0.35]\n[solver]\nrtol = 1e-10\n"
        "atol_position = 1e-12\natol_velocity = 1e-12\n"
    )
    host = Host(build_fmu(scene, (), tmp_path / "tumbling.fmu", bare=True))
    host.start()
    matrix = make_symmetric(inertia)
    state = np.concatenate([host.vector(f"chaser.{n}", count) for n, count in MOTION.items()])

    def rates(x, force, torque):
        q, w = x[6:10], x[10:]
        turning = 0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])
        spin = np.linalg.solve(matrix, torque - np.cross(w, matrix @ w))
        return np.concatenate([x[3:6], force / 500.0, turning, spin])

    loads = np.random.default_rng(1).uniform(-1.0, 1.0, (40, 2, 3)) * [[100.0], [40.0]]
    for force, torque in loads:
        host.put("chaser.force_ext", force)
        host.put("chaser.torque_ext", torque)
        host.step(0.1)
        h = 0.1 / 40
        for _ in range(40):
            k1 = rates(state, force, torque)
            k2 = rates(state + h / 2 * k1, force, torque)
            k3 = rates(state + h / 2 * k2, force, torque)
            k4 = rates(state + h * k3, force, torque)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        found = np.concatenate([host.vector(f"chaser.{n}", count) for n, count in MOTION.items()])
        found[6:10] *= np.sign(found[6:10] @ state[6:10])
        assert np.max(np.abs(found - state)) < 1e-8
    assert np.linalg.norm(state[10:]) > 0.1


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
    blocks = re.findall(
        r"```python\n(.*?)```", (paths.ROOT / "fmu" / "README.md").read_text(), re.DOTALL
    )
    (program,) = (block for block in blocks if word in block)
    shutil.copy(package, tmp_path / "docking.ssp")
    said = call(sys.executable, "-c", program, cwd=tmp_path)
    made = {"libcosim": "results/docking_*.csv", "container": "docking.fmu"}.get(importer)
    assert list(tmp_path.glob(made)) if made else float(said.split()[-1]) != 0.0


@pytest.mark.parametrize(
    "master", ["libcosim", "ecos", "fmpy", "container", "sequential-container"]
)
def test_the_example_runs(master):
    if reason := find_obstacle(master.replace("-", " ")):
        pytest.skip(reason)
    program = paths.ROOT / "scripts/examples/masters.py"
    said = call(sys.executable, program, "--master", master, "--stop", "0.05")
    rows = dict(re.findall(r"^(\S+)(?: \w+)? +(\S.*)$", said, re.MULTILINE))
    assert rows["outcome"].split() == ["undecided", "undecided"]
    found, expected, difference = map(float, rows["relative.axial"].split())
    assert abs(difference) < 1e-9
    assert found == expected != 0.0


@pytest.mark.parametrize(("mode", "value"), [("parallel", "2"), ("sequential", "1")])
def test_the_docking_starts_in_the_mode_of_the_host(bare_package, tmp_path, mode, value):
    package = bare_package(*SCENE, *([] if mode == "parallel" else [IN_SEQUENCE]))
    with zipfile.ZipFile(package) as archive:
        fmu = archive.extract("resources/docking.fmu", tmp_path)
    starts = {v.name: v.start for v in read_model_description(fmu).modelVariables}
    assert starts["coupling.mode"] == value
    assert float(starts["coupling.expected_step"]) == STEP
    names = [c.get("name") for c in read_structure(package).iter(f"{{{SSD['ssd']}}}Component")]
    assert names.index("docking") == (0 if mode == "sequential" else 2)


def test_a_mode_that_there_is_not_is_refused(dockloop):
    status, _, err = dockloop("ssp", SCENE[0], "--scene", "coupling.mode=both")
    assert status == 2
    assert "coupling.mode" in err
    assert "must be one of sequential, parallel" in err
    assert len(err.splitlines()) == 1


def test_a_fixed_vehicle_has_no_component(bare_package):
    package = bare_package(SCENE[0], "target.motion=fixed")
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


def test_a_docking_is_no_vehicle(dockloop, bare_package, tmp_path):
    archive, package = tmp_path / "docking.fmu", tmp_path / "x.ssp"
    with zipfile.ZipFile(bare_package(SCENE[0])) as whole:
        archive.write_bytes(whole.read("resources/docking.fmu"))
    status, _, err = dockloop("ssp", SCENE[0], "--chaser", archive, "-o", package)
    assert (status, package.exists()) == (2, False)
    assert "docking.fmu: is a docking, not the vehicle 'chaser'" in err


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
