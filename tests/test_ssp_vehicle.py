"""A vehicle FMU of another tool in an SSP package, by a map of its names."""

import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp import simulation
from fmpy.ssp.ssd import Parameter, ParameterSet

from dockloop.fmu.build import write_zip
from dockloop.fmu.ssp import PACKAGE, build_ssp
from dockloop.fmu.ssp_check import Package, check_ssp

SCENE = "absorber_1d"
THEIR = {  # of the rigid body -> of the other tool
    "chaser.position": "r_{}",
    "chaser.velocity": "v_{}",
    "chaser.attitude": "q_{}",
    "chaser.angular_velocity": "w_{}",
    "chaser.force_ext": "F_{}",
    "chaser.torque_ext": "T_{}",
}
MAP = """[chaser]
position = "r_*"
velocity = ["v_1", "v_2", "v_3"]
attitude = "q_*"
angular_velocity = "w_*"
force_mean = "F_*"
torque_mean = "T_*"
[chaser.start]
mass = "chaser.mass"
inertia = "chaser.inertia[*]"
"""


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The package with the rigid bodies of this program."""
    return build_ssp(SCENE, (), tmp_path_factory.mktemp("plain") / "own.ssp", bare=True)


@pytest.fixture(scope="module")
def foreign(plain, tmp_path_factory):
    """The FMU of the chaser with the names of another tool; its library is the same."""
    folder = tmp_path_factory.mktemp("foreign")
    with zipfile.ZipFile(plain) as archive:
        file = Path(archive.extract("resources/chaser.fmu", folder))
    return edit(file, folder / "theirs.fmu", rename)


def rename(text):
    for own, their in THEIR.items():
        text = re.sub(
            rf'name="{re.escape(own)}\[(\d)\]"', lambda m, t=their: f'name="{t.format(m[1])}"', text
        )
    return text


def edit(file, to, change, entry="modelDescription.xml"):
    """Copy a zip file; one entry is changed."""
    with zipfile.ZipFile(file) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    assert change(entries[entry].decode()) != entries[entry].decode()
    entries[entry] = change(entries[entry].decode()).encode()
    write_zip(to, PACKAGE, entries, compress=False)
    return to


def build(dockloop, foreign, text=MAP, *more):
    Path("names.toml").write_text(text)
    shutil.copy(foreign, "theirs.fmu")
    command = ("ssp", SCENE, "--chaser", "theirs.fmu", "--map", "names.toml", "-o", "mine.ssp")
    return dockloop(*command, *more)


def record(package, *, start=False):
    """Run a package in FMPy, which sets no parameter values by itself; `start` sets them."""
    values = ParameterSet(name="start")
    for component, own in Package(package).values.items() if start else ():
        for name, text in own.items():
            number = float(text.replace("true", "1").replace("false", "0"))
            values.parameters.append(Parameter(name=f"{component}.{name}", value=number))
    made = simulation.simulate_ssp(
        str(package), stop_time=1.5, step_size=0.01, parameter_set=values if start else None
    )
    names = ["docking.relative.axial", "docking.chaser.force_mean[1]", "docking.energy.kinetic"]
    return np.array([made[name] for name in names])


def test_a_foreign_vehicle_gives_the_bits_of_the_rigid_body(dockloop, plain, foreign):
    done = build(dockloop, foreign)
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith("mine.ssp (")
    ours, theirs = record(plain), record(Path("mine.ssp"))
    assert np.ptp(ours[0]) > 0.0
    assert ours.tobytes() == theirs.tobytes()
    assert check_ssp(Path("mine.ssp")) | {"package": ""} == check_ssp(plain) | {"package": ""}
    with zipfile.ZipFile("mine.ssp") as archive:
        structure = archive.read("SystemStructure.ssd").decode()
        assert archive.read("resources/chaser.fmu") == foreign.read_bytes()
    pairs = re.findall(r'Parameter name="(r_1|chaser\.mass)">\s*<ssv:Real value="(\S+)"', structure)
    assert pairs
    starts = dict(pairs)
    assert float(starts["r_1"]) < 0.0  # in front of the target
    assert float(starts["chaser.mass"]) > 0.0


OTHER = '''"""A vehicle of another tool: PythonFMU; a point mass."""

from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Real


class Body(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.mass = 1.0
        tunable = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(Real("mass", **tunable))
        output = {"causality": Fmi2Causality.output, "initial": Fmi2Initial.exact}
        self.rows = {"r": [0.0] * 3, "v": [0.0] * 3, "q": [1.0, 0.0, 0.0, 0.0], "w": [0.0] * 3}
        self.rows |= {"F": [0.0] * 3, "T": [0.0] * 3}
        for name, row in self.rows.items():
            for i in range(len(row)):
                more = {"causality": Fmi2Causality.input} if name in "FT" else output
                more["getter"] = lambda row=row, i=i: row[i]
                more["setter"] = lambda value, row=row, i=i: row.__setitem__(i, value)
                self.register_variable(Real(f"{name}_{i + 1}", **more))

    def do_step(self, time, step):
        r, v, F = (self.rows[name] for name in "rvF")
        for i in range(3):
            r[i] += step * v[i] + 0.5 * step**2 * F[i] / self.mass
            v[i] += step * F[i] / self.mass
        return True
'''


def test_a_vehicle_written_with_pythonfmu_gives_the_motion_of_the_rigid_body(dockloop, plain):
    builder = pytest.importorskip("pythonfmu.builder").FmuBuilder
    Path("body.py").write_text(OTHER)
    builder.build_FMU("body.py", dest=".")
    text = MAP.replace("chaser.mass", "mass").replace('inertia = "chaser.inertia[*]"\n', "")
    assert build(dockloop, Path("Body.fmu"), text).status == 0
    assert check_ssp(Path("mine.ssp"))["faults"] == []
    ours, theirs = (record(package, start=True) for package in (plain, Path("mine.ssp")))
    assert np.ptp(ours[1]) > 1000.0
    assert theirs == pytest.approx(ours, rel=1e-9, abs=1e-9)


def test_loads_of_thrusters_are_connected(dockloop, foreign):
    thrust = 'force_ext = ["r_1", "r_2", "r_3"]\n'  # outputs in m
    done = build(dockloop, foreign, MAP.replace("[chaser.start]", thrust + "[chaser.start]"))
    assert done.status == 2
    assert "'r_1' of theirs.fmu is in m: must be in N" in done.err
    shutil.copy(foreign, "own.fmu")
    with_thrust = edit(Path("own.fmu"), Path("jets.fmu"), lambda t: t.replace(' unit="m"', ""))
    text = MAP.replace("[chaser.start]", thrust + "[chaser.start]")
    done = build(dockloop, with_thrust, text)
    assert (done.status, done.err) == (0, "")
    assert check_ssp(Path("mine.ssp"))["connections"] == 38 + 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("r_*", "x_*"), r"names\.toml: chaser\.position: theirs\.fmu has no variable 'x_1'"),
        (('"r_*"', '["r_1", "r_2"]'), r"chaser\.position has 2 names: must have 3"),
        (('"r_*"', '["r_1", "r_1", "r_3"]'), r"chaser\.position has 'r_1' twice"),
        (('"r_*"', '"r"'), r"chaser\.position has 1 names: must have 3, or one name with"),
        (('"r_*"', "3"), r"chaser\.position is 3: must be a name with \*, or a list"),
        (("r_*", "F_*"), r"'F_1' of theirs\.fmu is an input of type Real: must be an output"),
        (("position =", "positio ="), r"has 'positio' \(did you mean 'position'\?\)"),
        (
            ('force_mean = "F_*"\n', ""),
            r"theirs\.fmu: no input stands for 'chaser\.force_mean\[1\]'",
        ),
        (("[chaser]", "[other]"), r"names\.toml: has 'other': must be one of chaser, target"),
        (("[chaser]\n", "[target]\nposition = 'r_*'\n[chaser]\n"), r"but there is no --target"),
        (("[chaser.start]", "[chaser.start]\nradius = 'r'"), r"chaser\.start: has 'radius'"),
        (("[chaser]", "[chaser"), r"names\.toml: is not TOML"),
        ((MAP, "chaser = 1"), r"names\.toml: 'chaser' must be a table of names"),
    ],
)
def test_a_map_that_is_wrong_is_refused(dockloop, foreign, change, words):
    done = build(dockloop, foreign, MAP.replace(*change))
    assert done.status == 2, done
    assert re.search(words, done.err), done.err
    assert done.err.count("\n") == 1
    assert not Path("mine.ssp").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('fmiVersion="2.0"', 'fmiVersion="3.0"'), r"of FMI 3\.0.*must be one of FMI 2\.0"),
        (("<CoSimulation", "<Other"), "only model exchange"),
        (('unit="rad/s"', 'unit="deg/s"'), r"is in deg/s: must be in rad/s"),
        (("<ModelVariables", "<ModelVariables<"), r"theirs\.fmu: is not an FMU"),
    ],
)
def test_an_fmu_that_cannot_be_a_vehicle_is_refused(dockloop, foreign, tmp_path, change, words):
    def replace(text):
        return text.replace(*change).replace("</CoSimulation>", "</Other>" * ("Other" in change[1]))

    done = build(dockloop, edit(foreign, tmp_path / "a" / "b.fmu", replace))
    assert done.status == 2, done
    assert re.search(words, done.err), done.err


def test_start_values_that_no_variable_takes_are_said(dockloop, foreign, tmp_path):
    def compute(text):
        return re.sub(r'(name="r_1"[^>]*)initial="exact"([^>]*>\s*<Real)', r"\1\2", text)

    done = build(dockloop, edit(foreign, tmp_path / "c" / "b.fmu", compute))
    assert done.status == 0, done
    assert "theirs.fmu: nothing takes chaser.position: it must be -" in done.err
    assert "[m] there" in done.err


def test_a_vehicle_that_does_not_move_is_refused(dockloop, foreign):
    done = build(dockloop, foreign, MAP, "--scene", "target.motion=fixed", "--target", "theirs.fmu")
    assert done.status == 2
    assert "--target theirs.fmu: target.motion of" in done.err
    assert "is fixed, so nothing moves it; set it to free" in done.err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((r'<ssd:Connection [^>]*endConnector="chaser.position\[2\]"[^>]*/>', ""), "nothing gives"),
        ((r'<ssd:Connection [^>]*="chaser.force_mean\[1\]"[^>]*/>', ""), "nothing receives"),
        ((r'endConnector="chaser.position\[2\]"', 'endConnector="chaser.position[1]"'), "2 times"),
        ((r'startElement="chaser"', 'startElement="chas_"'), "there is no component 'chas_'"),
        ((r'startConnector="r_1"', 'startConnector="r_9"'), "no variable 'r_9'"),
        ((r'startConnector="r_1"', 'startConnector="v_1"'), "is in m/s, 'chaser.position[1]' in m"),
        ((r'startConnector="r_1"', 'startConnector="F_1"'), "'F_1' is input: must be output"),
        ((r'(name="r_1">\s*<ssv:Real value=)"[^"]*"', r'\1"7"'), "'r_1' starts at 7, the docking"),
        (
            (r'(name="r_1">\s*<ssv:Real value=)"[^"]*"', r'\1"7 m"'),
            "'r_1' starts at '7 m': must be",
        ),
        ((r'source="resources/chaser', 'source="resources/chase'), "no resources/chase.fmu"),
        ((r'name="chaser" type', 'name="../../x" type'), "there is no component 'chaser'"),
        (
            (r'"chaser" endConnector="F_1"', '"target" endConnector="chaser.force_ext[1]"'),
            "2 times",
        ),
        (
            (r'(Connector="chaser.force_mean\[)2(\]" end\w+)="chaser"', r'\g<1>2\2="target"'),
            "other motion",
        ),
        ((r"<ssd:Elements>", "<ssd:Elements"), "is not an SSP package"),
    ],
)
def test_an_edited_package_is_judged(dockloop, foreign, tmp_path, change, words):
    assert build(dockloop, foreign).status == 0
    edit("mine.ssp", tmp_path / "x.ssp", lambda t: re.sub(*change, t), "SystemStructure.ssd")
    done = dockloop("ssp", "--check", "x.ssp")
    assert done.status in (1, 2), done
    assert words in done.err + " ".join(done.out.split()), done
    assert done.err.count("\n") == 1


BOUND = """<ssd:ParameterBindings><ssd:ParameterBinding {}>{}<ssd:ParameterValues>
<ssv:ParameterSet version="1.0" name="system"><ssv:Parameters>
<ssv:Parameter name="{}"><ssv:Real value="{}"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>
"""
MAPPED = "<ssd:ParameterMapping/>"


@pytest.mark.parametrize(
    ("binding", "words"),
    [
        (("", "", "chaser.r_1", "7"), "chaser: 'r_1' starts at 7, the docking expects -"),
        (('prefix="chaser."', "", "r_1", "7"), "chaser: 'r_1' starts at 7, the docking expects -"),
        (("", "", "docking.chaser.position[1]", "-7"), "the docking expects -7"),
        (("", "", "r_1", "7"), ": right"),  # of the system itself
        (("", MAPPED, "chaser.r_1", "7"), "are mapped to other names: not read, not judged"),
    ],
)
def test_values_of_the_system_win(dockloop, foreign, tmp_path, binding, words):
    """As the standard has it: a system names those of its components; the higher level wins."""
    assert build(dockloop, foreign).status == 0
    bound = BOUND.format(*binding)
    edit(
        *("mine.ssp", tmp_path / "x.ssp"),
        lambda t: t.replace("<ssd:Elements>", f"{bound}<ssd:Elements>"),
        "SystemStructure.ssd",
    )
    done = dockloop("ssp", "--check", "x.ssp")
    assert words in " ".join(done.out.split()), done
    assert done.status == ("expects" in words)


def test_check_stands_alone(dockloop):
    for command in (("absorber_1d", "--check", "x.ssp"), (), ("--check", "none.ssp")):
        done = dockloop("ssp", *command)
        assert done.status == 2, done
        assert done.err.count("\n") == 1


# ---------------------------------------------------------------- parameter values of SSP

VALUES = """<ssv:ParameterSet version="1.0" name="scene"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters>
<ssv:Parameter name="chaser.mass"><ssv:Real value="1.5" unit="t"/></ssv:Parameter>
<ssv:Parameter name="solver.method"><ssv:Integer value="2"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet>"""


EMPTY = VALUES[: VALUES.index("<ssv:Parameters>")] + "</ssv:ParameterSet>"


def test_values_of_ssp_are_start_values(dockloop):
    Path("own.ssv").write_text(VALUES)
    command = ("run", SCENE, "--stop", "0.1", "--step", "0.1", "--no-plots", "-o", "own.npz")
    ends = []
    for words in (("--ssv", "own.ssv"), ("--set", "chaser.mass=1500", "--set", "solver.method=2")):
        dockloop.succeed(*command, *words)
        ends.append(np.load("own.npz")["values"])
    assert ends[0].tobytes() == ends[1].tobytes()
    dockloop.succeed(*command, "--ssv", "own.ssv", "--set", "chaser.mass=1600")
    assert np.load("own.npz")["values"].tobytes() != ends[0].tobytes()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("chaser.mass", "chaser.mas"), "no variable 'chaser.mas' (did you mean 'chaser.mass'"),
        (('unit="t"', 'unit="m"'), "'chaser.mass' is in m: must be in kg, or of its kind"),
        (('"1.5"', '"much"'), "'chaser.mass' is 'much': must be a number"),
        (("ssv:Integer", "ssv:String"), "'solver.method' has String: must have one of Real"),
        (("ssv:ParameterSet", "ssv:Other"), "must be an SSV file"),
        (("<ssv:Parameters>", ""), "own.ssv: is not SSV"),
        (("solver.method", "chaser.mass"), "own.ssv: has 'chaser.mass' twice"),
        (("ssv:Parameter name", "ssv:Value name"), "own.ssv: is not SSV"),
        ((VALUES, EMPTY), "own.ssv: has no parameters of http://ssp-standard.org/SSP1/"),
        (('unit="t"', 'unit="ton"'), "'chaser.mass' is in ton: must be in kg"),
    ],
)
def test_values_of_ssp_that_are_wrong_are_refused(dockloop, change, words):
    Path("own.ssv").write_text(VALUES.replace(*change))
    done = dockloop("run", SCENE, "--ssv", "own.ssv", "--no-plots")
    assert done.status == 2, done
    assert words in done.err, done.err
    assert done.err.count("\n") == 1
