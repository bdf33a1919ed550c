"""What users of other programs reported, done here: the value is right, or one sentence refuses it.

Each row is one report: the project and number of its thread on github.com, what was done there, and
what must come out here. Rows that other files of tests have are not repeated.
"""

import copy
import json
import locale
import os
import pickle
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.errors import warn_once
from dockloop.fmu.build import build_fmu
from dockloop.scene.values import to_text
from extreme_cases.fmi_host import OK, Host
from import_files import ARM, IMPORTED, ROBOT_LINK, bring, joint, link, mjcf, sdf, turn, urdf
from programs import run
from test_input_tables import SCENE as JETS

pytestmark = pytest.mark.usefixtures("own_folder")
SCENE = "absorber_1d"


def refusal(call):
    """The sentence of what is refused; it stands on one line."""
    with pytest.raises(dl.UsageError) as error:
        call()
    text = str(error.value)
    assert "\n" not in text
    return text


# ------------------------------------------------------------------- 1. hosts and their clocks


def start(fmu, **more):
    host = Host(fmu, **more)
    host.start()
    return host


def sum_steps(fmu):
    """Times as a host sums them: 0.04 s again and again, with the rounding of 6400 sums."""
    with start(fmu) as host:
        return {host.step_status(0.04) for _ in range(6400)}, round(host.time, 6)


def end_at_the_stop(fmu):
    with Host(fmu, initialisation=False) as host:
        host.slave.setupExperiment(startTime=0.0, stopTime=0.3)
        host.slave.enterInitializationMode()
        host.start()
        return [host.step_status(0.1) for _ in range(3)], host.step_status(0.1), host.last_line


def end_twice(fmu):
    """With BDF, whose solver has memory of its own."""
    with Host(fmu, initialisation=False) as host:
        host.set_status({"solver.method": 6}, "Integer")
        host.slave.enterInitializationMode()
        host.start()
        host.step()
        calls = ("fmi2Terminate", "fmi2Terminate", "fmi2Reset", "fmi2Reset")
        return [host.status(name) for name in calls]


def step_next_to_nothing(fmu):
    with start(fmu) as host, start(fmu) as other:
        assert host.step_status(1e-300) == OK
        for each in (host, other):
            each.step(0.5)
        return host.value("relative.axial") - other.value("relative.axial")


def restore_before_the_start(fmu):
    """A state of a run that went on, in an instance that was not initialised."""
    with start(fmu) as host, Host(fmu, initialisation=False) as other:
        host.step(0.5)
        data = host.save_bytes()
        other.restore_bytes(data, 0.5)
        for each in (host, other):
            each.step(0.5)
        return host.differences(other)


HOSTS = [
    ("CATIA-Systems/FMIKit-Simulink#133", sum_steps, ({OK}, 256.0)),
    (
        "modelica/fmi-standard#575, modelica/Reference-FMUs#346",
        end_at_the_stop,
        (
            [OK, OK, OK],
            3,
            "fmi2DoStep: the step ends at 0.4 s, after the stopTime of fmi2SetupExperiment, 0.3 s",
        ),
    ),
    ("OpenModelica/OpenModelica#16319, CATIA-Systems/FMPy#357", end_twice, [OK, 3, OK, OK]),
    ("hyumo/qFMU#23", step_next_to_nothing, pytest.approx(0.0, abs=1e-12)),
    ("CATIA-Systems/FMPy#304", restore_before_the_start, []),
]


@pytest.mark.parametrize(("thread", "do", "expected"), HOSTS, ids=[row[0] for row in HOSTS])
def test_a_report_on_hosts(runs, thread, do, expected):
    assert do(runs.fmu(SCENE)) == expected


@pytest.fixture
def german(tmp_path, monkeypatch):
    """Numbers of the C library have a decimal comma."""
    made = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / "de_DE.UTF-8")]
    if shutil.which("localedef"):
        subprocess.run(made, capture_output=True, check=False)
    if not (tmp_path / "de_DE.UTF-8").exists():
        pytest.skip("there is no German locale")
    monkeypatch.setenv("LOCPATH", str(tmp_path))
    before = locale.setlocale(locale.LC_ALL)
    locale.setlocale(locale.LC_ALL, "de_DE.UTF-8")
    yield
    locale.setlocale(locale.LC_ALL, before)


def run_everywhere(fmu):
    run = dl.run(SCENE, {"chaser.mass": 25000.5}, stop=0.1)
    with start(fmu) as host:
        host.step(0.5)
        assert host.set_status({"chaser.mass": 1.5}) == 3
        assert refusal(lambda: dl.Docking(SCENE).set("chaser.mass", -1.5)).endswith("minimum 0 kg")
        return run["capture.compression"][-1].hex(), host.everything(), build_fmu(SCENE, bare=True)


def test_a_decimal_comma_of_the_system_changes_no_bit(runs, german):
    """JSBSim-Team/jsbsim#1227, OpenModelica/OMCompiler#2708: numbers were read as whole ones."""
    fmu = runs.fmu(SCENE)
    assert locale.localeconv()["decimal_point"] == ","
    *said, built = run_everywhere(fmu)
    description = zipfile.ZipFile(built).read("modelDescription.xml")
    locale.setlocale(locale.LC_ALL, "C")
    *other, built = run_everywhere(fmu)
    assert said == other
    assert description == zipfile.ZipFile(built).read("modelDescription.xml")


# ------------------------------------------------------------- 2. loops, joints, files of robots


def laws(made):
    return [law["type"] for law in made.document["forces"][0]["laws"]]


def switch_off(flag):
    joints = '<joint range="-1 1" limited="true" damping="2" stiffness="3" frictionloss="1"/>'
    made = bring(mjcf(joints, rest=f'<option><flag {flag}="disable"/></option>'))
    assert f"mapped: option/flag: {flag} is switched off" in made.report
    return made


def two_arms(*mimics, kind="continuous"):
    arms = "".join(
        f'<joint name="j{name}" type="{kind}"><parent link="base"/><child link="{name}"/>'
        f'<axis xyz="0 0 1"/>{mimic}</joint>'
        for name, mimic in zip("ab", mimics, strict=True)
    )
    links = ROBOT_LINK.format("a", "") + ROBOT_LINK.format("b", "")
    return f'<robot name="own"><link name="base"/>{links}{arms}</robot>'


def planar_loop(places, anchor):
    """Two links and a third one against them, all turning about z."""
    a, b, c = (
        f'pos="{place}"><joint name="{n}" axis="0 0 1"'
        for n, place in zip("abc", places, strict=True)
    )
    return (
        '<mujoco><compiler angle="radian"/><worldbody>'
        f'<body name="a" {a} ref="0.3"/>{IMPORTED}<body name="b" {b} ref="-0.2"/>{IMPORTED}</body></body>'
        f'<body name="c" {c}/>{IMPORTED}</body></worldbody>'
        f'<equality><connect body1="b" body2="c" anchor="{anchor}"/></equality></mujoco>'
    )  # fmt: skip


def limits(lower, upper):
    return sdf(ARM, turn(f"<limit><lower>{lower}</lower><upper>{upper}</upper></limit>"))


def inertial(mass, inertia='ixx="1" iyy="1" izz="1"'):
    text = f'<inertial><mass value="{mass}"/><inertia {inertia}/></inertial>'
    return urdf("continuous", "").replace(
        ROBOT_LINK.format("arm", ""), f'<link name="arm">{text}</link>'
    )


DEGREES = mjcf('<joint stiffness="3" damping="2" springref="30" ref="10"/>').replace(
    "radian", "degree"
)
ORIGIN = 'xyz="1 0 0" quat_xyzw="0 0 0.7071067811865476 0.7071067811865476"'
RIGHT = [  # thread, file, what must hold of what is made
    ("newton-physics/newton#3739, RobotLocomotion/drake#22493: gravity", lambda: switch_off("gravity"), lambda m: m.document["gravity"] == [0, 0, 0]),
    ("newton-physics/newton#3739: limit", lambda: switch_off("limit"), lambda m: laws(m) == ["spring", "damper", "brake"]),
    ("newton-physics/newton#3739: frictionloss", lambda: switch_off("frictionloss"), lambda m: laws(m) == ["spring", "damper", "stop"]),
    ("newton-physics/newton#3739: constraint", lambda: switch_off("constraint"), lambda m: laws(m) == ["spring", "damper"]),
    (
        "newton-physics/newton#2504: of turns per rad, whatever the angles are in",
        lambda: bring(DEGREES),
        lambda m: m.document["forces"][0]["laws"]
        == [{"type": "spring", "stages": [[0, 3]], "rest": pytest.approx(np.pi / 9)}, {"type": "damper", "linear": 2}],
    ),
    ("newton-physics/newton#4263", lambda: bring(mjcf('<joint range="-1 2" limited="false"/>')), lambda m: "forces" not in m.document),
    (
        "newton-physics/newton#2293",
        lambda: bring(planar_loop(("0 0 0", "1 0 0", "1 -1 0"), "0 -1 0")),
        lambda m: (m.document["home_q"], m.check["degrees_of_freedom"]) == ([0, 0, 0], 1),
    ),
    (
        "stack-of-tasks/pinocchio#2753",
        lambda: bring(two_arms("", '<mimic joint="ja" multiplier="-2"/>')),
        lambda m: (m.document["couplings"][0]["terms"], m.check["degrees_of_freedom"]) == ([{"joint": "a", "ratio": -2}], 1),
    ),
    ("gazebosim/sdformat#169", lambda: bring(limits("-inf", "inf")), lambda m: "forces" not in m.document),
    ("gazebosim/sdformat#1112", lambda: bring(limits("-0.5", "inf")), lambda m: m.document["forces"][0]["laws"][0]["lower"] == -0.5),
    (
        "gazebosim/sdformat#43",
        lambda: bring(sdf(link("arm", "1 0 0 0 0 1.5707963267948966"),
                          joint("turn", "revolute", "world", "arm", '<axis><xyz expressed_in="__model__">1 0 0</xyz></axis>'))),
        lambda m: np.allclose(m.document["bodies"][0]["joint"]["axis"], [0, -1, 0]),
    ),
    (
        "ros/urdfdom#194: a quaternion in place of angles",
        lambda: bring(urdf().replace('xyz="1 0 0" rpy="0 0 0.5"', ORIGIN)),
        lambda m: np.allclose(m.document["bodies"][0]["joint"]["rotation"], [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    ),
    (
        "Rhoban/onshape-to-robot#155: limits outside of their element",
        lambda: bring(sdf(ARM, turn("<lower>0.262</lower>"))),
        lambda m: "left out: joint/axis/lower (1): no construct that this import knows" in m.report,
    ),
    (
        "RobotLocomotion/drake#12598: what is not read is said",
        lambda: bring(urdf(more='<limit lower="-1" upper="2" effort="1" velocity="1" jerk="5"/>')),
        lambda m: "left out: joint/limit/@jerk (1): no construct that this import knows" in m.report,
    ),
    ("gazebosim/gz-sim#504", lambda: bring(sdf(link("arm", more="<gravity>false</gravity>"), turn(""))), lambda m: "left out: link/gravity (1): gravity acts on all bodies" in m.report),
]  # fmt: skip


@pytest.mark.parametrize(("thread", "make", "holds"), RIGHT, ids=[row[0] for row in RIGHT])
def test_a_report_on_imports_is_right(thread, make, holds):
    made = make()
    assert holds(made), (made.document, made.report)


REFUSED = [  # thread, file, words of the refusal
    (
        "articraftresearch/Articraft#120: a four-bar that is stretched",
        planar_loop(("0 0 0", "1 0 0", "3 0 0"), "1 0 0"),
        ["own.xml: the loop 'equality1' is singular at the pose of the file", "turn one of its joints"],
    ),
    (
        "jgerstmayr/EXUDYN#39: two coordinates of one motion",
        sdf(ARM, joint("u", "universal", "world", "arm", "<axis><xyz>0 0 1</xyz></axis><axis2><xyz>0 0 1</xyz></axis2>")),
        ["joint 'u' has two coordinates along one axis, 'u_1' and 'u_2'"],
    ),
    ("RobotLocomotion/drake#12598: the second of two", two_arms("", '<mimic joint="ja"/><mimic joint="ja" multiplier="3"/>'), ["joint 'jb' has 2 elements 'mimic': must have one"]),
    ("google-deepmind/mujoco#3527: a blank behind a name", two_arms("", '<mimic joint="ja "/>'), ["'jb_mimic' couples 'ja ', which is not there (did you mean 'ja'"]),
    ("ros/urdfdom#249", limits(1, -1), ["joint 'turn' axis has the limits 1 and -1"]),
    ("ros/urdfdom_headers#95", urdf(more='<limit effort="1" velocity="1"/>'), ["joint 'turn' limit has the limits 0 and 0"]),
    ("stack-of-tasks/pinocchio#60", urdf("continuous").replace(ROBOT_LINK.format("arm", ""), '<link name="arm"/>'), ["nothing that turns with 'arm' has a moment of inertia"]),
    ("pyexcel/pyexcel#138", inertial("1_0"), ["inertial mass has 'value' '1_0': must be a finite number"]),
    ("moveit/moveit_commander#11", inertial("1,5"), ["inertial mass has 'value' '1,5': must be a finite number"]),
    ("ros/robot_model#90: a joint that vanishes", urdf().replace('"arm"', '"world"'), ["moves the link 'world', which stands still"]),
    ("ros/urdfdom#123", urdf().replace('rpy="0 0 0.5"', 'quat_xyzw="0 0 0 0"'), ["has 'quat_xyzw': must not be zero"]),
]  # fmt: skip


@pytest.mark.parametrize(("thread", "text", "words"), REFUSED, ids=[row[0] for row in REFUSED])
def test_a_report_on_imports_is_one_sentence(thread, text, words):
    said = refusal(lambda: bring(text))
    assert all(word in said for word in words), said


def test_what_is_read_of_a_robot_is_not_called_unknown():
    for text in (
        sdf(ARM, turn("<dynamics><damping>1</damping></dynamics><limit><lower>-1</lower></limit>")),
        urdf(),
        two_arms("", '<mimic joint="ja" multiplier="2" offset="0.1"/>'),
        (paths.ROOT / "scripts" / "examples" / "stewart.sdf").read_text(),
    ):
        assert not any("no construct" in line for line in bring(text).report)


# ------------------------------------------------------------------- 3. contact and large numbers


NEAR = {"initial.approach_time": 0.3}


def dock(overrides=(), starts=None, stop=1.0, step=0.05):
    return dl.run("idss_25t_350t", NEAR | dict(overrides), starts, stop=stop, step=step)


def far(*place):
    """The distance along the axis, with the target somewhere else at orbital speed."""
    moved = {"target.position": list(place), "target.velocity": [0, 7500.0, 0]}
    return dock(moved)["relative.axial"][-1]


def lost(friction):
    run = dock({}, {"friction.coefficient": friction})
    return run["energy.dissipated_friction"][-1], np.abs(run["energy.residual"]).max()


def rest():
    run = dl.run(
        "idss_25t_350t",
        {"initial.at": "start", "chaser.position": [-20, 0, 0]},
        stop=50.0,
        step=1.0,
    )
    return np.ptp(run["relative.axial"]), np.ptp(run["relative.attitude[2]"])


def turned(sign):
    q = [sign * x for x in (np.cos(0.02), 0.0, np.sin(0.02), 0.0)]
    where = {"initial.at": "start", "chaser.position": [-8.7, 0, 0], "chaser.velocity": [0.1, 0, 0]}
    return dl.run("idss_25t_350t", where | {"chaser.attitude": q}, stop=1.0)["gap"].tolist()


def test_far_away_the_docking_is_the_same():
    """jrouwe/JoltPhysics#94, jrouwe/JoltPhysics#1718: 7e6 m away, at 7.5 km/s."""
    assert far(7e6, 1e5, 3e4) == pytest.approx(far(0.0, 0.0, 0.0), abs=1e-8)


def test_without_friction_none_is_lost_and_nothing_moves_without_a_force():
    """RobotLocomotion/drake#21510; projectchrono/chrono#169."""
    assert lost(0.0) == (0.0, pytest.approx(0.0, abs=1e-3))
    assert lost(0.5)[0] > 1.0
    assert rest() == (0.0, 0.0)


def test_a_quaternion_and_its_opposite_are_one_attitude():
    """raisimTech/raisimLib#33."""
    assert turned(1.0) == turned(-1.0)


@pytest.mark.parametrize("mass", [1e-3, 1.0, 1e9])
def test_masses_of_any_ratio_keep_momentum_and_energy(mass):
    """erwincoumans/experiments#4, projectchrono/chrono#542: light next to heavy bodies."""
    run = dock({"chaser.mass": mass, "chaser.inertia": [mass, mass, mass, 0, 0, 0]})
    assert run["capture.peak.compression"][-1] > 100.0
    assert np.abs(run["energy.residual"]).max() < 1e-4
    assert run["momentum.residual"].max() < 1e-13


CONTACT = [  # thread, what is done, words of the refusal
    ("google-deepmind/mujoco#441: no passing through, at any step", lambda: dock({"initial.closing_speed": 5.0}, step=1.0), ["are pressed together", "the impact is too fast for contact.stiffness"]),
    ("google-deepmind/mujoco#2080", lambda: dock({}, {"restitution": 0.0}), ["restitution is 0; it must be above 0 and at most 1"]),
    ("erincatto/box3d#83", lambda: dock({}, {"restitution": 1.0000001}), ["'restitution' = 1.0000001 is above its maximum 1"]),
    ("projectchrono/chrono#462", lambda: dock({}, {"friction.coefficient": 100.0}), ["'friction.coefficient' = 100 is above its maximum 2"]),
    ("google-deepmind/mujoco#2754", lambda: dock({"chaser.mass": 1e-300}), ["chaser.mass is 1e-300", "what is below 1e-100 counts as 0"]),
    ("BabylonJS/Babylon.js#5922", lambda: dock({"initial.at": "start", "chaser.attitude": [0, 0, 0, 0]}), ["chaser.attitude must be a unit quaternion", "its norm is 0"]),
]  # fmt: skip


@pytest.mark.parametrize(("thread", "do", "words"), CONTACT, ids=[row[0] for row in CONTACT])
def test_a_report_on_contact_is_one_sentence(thread, do, words):
    with pytest.raises(dl.DockloopError) as error:
        do()
    assert all(word in str(error.value) for word in words), error.value


# ------------------------------------------------------------------- 4. sweeps, files and tables


VEHICLE = JETS.replace("jets.csv", "in.csv")
SHORT = {"stop": 2.0, "step": 0.5}
HEAD = "time,chaser.force_ext[1]\n"
TABLES = [  # thread, table, velocity in mm/s at the end
    ("pandas-dev/pandas#4793", "\ufeff" + HEAD + "0,10\n2,10\n", 20.0),
    ("CATIA-Systems/FMPy#58: the last row is a jump", HEAD + "0,0\n2,0\n2,10\n", 0.0),
    ("CATIA-Systems/FMPy#227: a jump is none of a ramp", HEAD + "0,0\n1,0\n1,10\n2,10\n", 10.0),
    ("CATIA-Systems/FMPy#89: no shift by a step", HEAD + "0,0\n2,20\n", 20.0),
    (
        "pandas-dev/pandas#59299",
        "time;chaser.force_ext[1]\n0;1,20\n1;22,3\n2;1.234,56\n",
        640.18,
    ),
    ("modelica/Reference-FMUs#564", "time [ms],chaser.force_ext[1] [kN]\n0,0.01\n2000,0.01\n", 20),
]
BAD_TABLES = [  # thread, table, words
    ("modelica/Reference-FMUs#580", HEAD + "0,10\n2,10\n1,10\n", ["time must not decrease", "line 4"]),
    (
        "pandas-dev/pandas#19592: no second column by another name",
        "time,chaser.force_ext[1],chaser.force_ext[1]\n0,10,20\n2,10,20\n",
        ["two columns 'chaser.force_ext[1]'", 'columns = { "chaser.force_ext[1]" = "" }'],
    ),
    (
        "tidyverse/readr#713: thousand or one and a bit",
        "time;chaser.force_ext[1]\n0;1.234\n2;1.234\n",
        ["may mean 1234 or 1.234", 'csv = "decimal=.'],
    ),
    ("Tencent/rapidjson#509", HEAD + "0,inf\n2,10\n", ["line 2 is 'inf': must be a finite number"]),
    ("nlohmann/json#70", HEAD + "0,1e400\n2,10\n", ["'1e400': must be a finite"]),
]  # fmt: skip


def push(text):
    Path("in.csv").write_text(text, encoding="utf-8")
    Path("vehicle.toml").write_text(VEHICLE)
    return dl.run("vehicle.toml", **SHORT)["chaser.velocity[1]"][-1]


@pytest.mark.parametrize(("thread", "text", "speed"), TABLES, ids=[row[0] for row in TABLES])
def test_a_report_on_tables_is_right(thread, text, speed):
    assert push(text) == pytest.approx(1e-3 * speed, abs=1e-15)


@pytest.mark.parametrize(
    ("thread", "text", "words"), BAD_TABLES, ids=[row[0] for row in BAD_TABLES]
)
def test_a_report_on_tables_is_one_sentence(thread, text, words):
    said = refusal(lambda: push(text))
    assert all(word in said for word in words), said
    assert "--csv" not in said


def test_a_column_that_means_nothing_is_named_once(capsys):
    """CATIA-Systems/FMPy#699: an input was ignored without a word."""
    warn_once.cache_clear()
    text = "time,chaser.force_ext[1],spare one,spare two\n0,10,1,1\n2,10,1,1\n"
    assert push(text) == push(text) == pytest.approx(0.02)
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "in.csv: nothing uses 'spare one', 'spare two': no input of the scene has" in said
    scene = Path("vehicle.toml").read_text() + 'columns = {"spare one" = "", "spare two" = ""}\n'
    Path("vehicle.toml").write_text(scene)
    warn_once.cache_clear()
    dl.run("vehicle.toml", **SHORT)
    assert capsys.readouterr().err == ""


def test_a_column_of_a_force_law_that_means_nothing_is_named(capsys):
    warn_once.cache_clear()
    Path("spring.csv").write_text("travel,force,count\n-1,40,7\n1,-40,7\n")
    mechanism = json.loads((paths.ROOT / "scripts/examples/rig/sled.json").read_text())
    mechanism["forces"][0]["laws"] = [{"type": "table", "file": "spring.csv"}]
    Path("sled.json").write_text(json.dumps(mechanism))
    dl.check("sled.json")
    assert "spring.csv: nothing uses 'count': no quantity of a law" in capsys.readouterr().err


def test_what_stands_next_to_a_linked_file_is_found(tmp_path):
    """Known here, without a thread: behind a link, the shipped mechanism was taken instead."""
    (tmp_path / "real").mkdir()
    law = (paths.MECHANISMS / f"{SCENE}.json").read_text().replace("20000", "30000")
    (tmp_path / "real" / f"{SCENE}.json").write_text(law)
    shutil.copy(paths.SCENES / f"{SCENE}.toml", tmp_path / "real" / "own.toml")
    Path("linked.toml").symlink_to(tmp_path / "real" / "own.toml")
    contact = dl.Scene("linked.toml").document["mechanism"]["contact"]
    assert contact["stiffness"] == 30000
    Path(f"{SCENE}.json").write_text(law.replace("30000", "40000"))  # next to the link: first
    contact = dl.Scene("linked.toml").document["mechanism"]["contact"]
    assert contact["stiffness"] == 40000
    (tmp_path / "real" / "vehicle.toml").write_text(JETS)
    (tmp_path / "real" / "jets.csv").write_text(HEAD + "0,10\n2,10\n")
    Path("jets.toml").symlink_to(tmp_path / "real" / "vehicle.toml")
    assert dl.run("jets.toml", **SHORT)["chaser.velocity[1]"][-1] == pytest.approx(0.02)


def test_a_table_of_cases_without_rows_is_refused():
    said = refusal(lambda: dl.sweep({"scene": SCENE}, cases=pandas.DataFrame({"chaser.mass": []})))
    assert said == "cases: has no rows: must have one for each case"


# ------------------------------------------------------------------- 5. packages, commands, Python


def read_members():
    return tomllib.loads((paths.SCENES / f"{SCENE}.toml").read_text())


def step_copies():
    """Copies by all ways of Python go on with the bits of the original."""
    docking = dl.Docking(SCENE)
    docking.step(0.5)
    copies = [copy.copy(docking), copy.deepcopy(docking), pickle.loads(pickle.dumps(docking))]
    for each in (docking, *copies):
        each.step(0.5)
    return len({each.get("energy.dissipated").hex() for each in (docking, *copies)})


def set_numbers():
    """Numbers of numpy, of any width, are numbers."""
    docking = dl.Docking(SCENE, {"chaser.mass": np.float32(2e4)})
    for value in (np.float16(100), np.int8(100), np.uint64(100), np.array(100.0)):
        docking.set("target.mass", value)
    return docking.get("chaser.mass"), docking.get("target.mass")


def keep_title(title):
    return dl.Scene({**read_members(), "title": title}).title


def place(value):
    members = read_members()
    members["chaser"]["interface_position"] = value
    return dl.Scene(members).document["chaser"]["interface_position"]


PYTHON = [  # thread, what is done, what must come out
    ("hannorein/rebound#736, peteanderson80/Matterport3DSimulator#108", step_copies, 1),
    ("numpy/numpy#16432, uiri/toml#447", set_numbers, (2e4, 100.0)),
    ("uiri/toml#306", lambda: place(np.array([4, 0, 0])), [4, 0, 0]),
    ("uiri/toml#246, uiri/toml#56", lambda: keep_title('two\nlines\t\x07\x7f "\\ \u2028'), 'two\nlines\t\x07\x7f "\\ \u2028'),
]  # fmt: skip


@pytest.mark.parametrize(("thread", "do", "expected"), PYTHON, ids=[row[0] for row in PYTHON])
def test_a_report_on_python_is_right(thread, do, expected):
    assert do() == expected


def member(value):
    return lambda: place(value)


def named(name):
    law = {"type": "absorber", "stiffness": 2e4, "damping": 1e3}
    return lambda: dl.Scene({**read_members(), "mechanism": {"name": name, "contact": law}})


VALUE = "must be a number, a text, a list or a group of these"
BAD_CALLS = [  # thread, call, words of the refusal
    ("uiri/toml#447: a set", member({1, 2}), ["chaser", "of type set", VALUE]),
    ("uiri/toml#447: bytes", member(b"x"), ["chaser", "of type bytes", VALUE]),
    ("uiri/toml#447: an object", member([1, 2, object()]), ["chaser", "of type object", VALUE]),
    ("uiri/toml#246: half a character", lambda: keep_title("\udcff"), ["title", "a text without Unicode"]),
    ("impecablemee/gtm-mcp#1: another file was written", named("../other"), ["mechanism.name is '../other': must be a name without a folder"]),
    ("impecablemee/gtm-mcp#1: a folder that is not there", named("a/b"), ["mechanism.name is 'a/b': must be a name without a folder"]),
    ("OpenModelica/OpenModelica#2173: a column by its number", lambda: dl.run(SCENE, stop=0.1)[5], ["the name of a column is 5: must be a text"]),
    ("OpenModelica/OpenModelica#2173: no column", lambda: dl.run(SCENE, stop=0.1)[None], ["the name of a column is None: must be a text"]),
    ("numpy/numpy#16432: masked", lambda: dl.Docking(SCENE).set("chaser.force_ext", np.ma.array([1.0, 2, 3], mask=[0, 1, 0])), ["'chaser.force_ext' is masked_array(", "must be a number"]),
    ("OpenModelica/OpenModelica#2173: form of a table", lambda: dl.fit(SCENE, "rig.csv", {"chaser.mass": (1, 2)}, csv=5), ["csv is 5: must be a text"]),
    ("OpenModelica/OpenModelica#2173: loss", lambda: dl.fit(SCENE, "rig.csv", {"chaser.mass": (1, 2)}, loss=["linear"]), ["loss is ['linear']: must be a text"]),
    ("hydra-ecosystem/hydra#393: no range", lambda: dl.envelope(SCENE, 5, 6, criteria="captured"), ["x is 5: must be a list"]),
    ("hydra-ecosystem/hydra#393: no name", lambda: dl.envelope(SCENE, (1, 2, 3), (1, 2, 3), criteria="captured"), ["x (1, 2, 3): must be a name, low and high"]),
    ("OpenModelica/OpenModelica#2173: resume", lambda: dl.sweep({"scene": SCENE}, resume="no"), ["resume is 'no': must be true or false"]),
    ("OpenModelica/OpenModelica#2173: file", lambda: dl.import_mechanism(5), ["file is 5: must be the path of a file"]),
    ("OpenModelica/OpenModelica#2173: link", lambda: dl.import_mechanism("own.xml", ring=["arm"]), ["ring is ['arm']: must be a text"]),
    ("OpenModelica/OpenModelica#2173: digits", lambda: dl.check(10**5000), ["mechanism is of type int: must be a text or a path or a group"]),
    ("OpenModelica/OpenModelica#2173: names", lambda: dl.run(SCENE, {5: 1}), ["overrides is {5: 1}: must be a group of names with values"]),
    ("a scene that is no file has no folder", lambda: dl.run({**read_members(), "mass": 1}), ["scene.toml: the document has an unknown member 'mass'"]),
    ("what is too long to show", lambda: dl.run({**read_members(), "force": read_members()}), ["force is a group of members: must be a list"]),
    ("OpenModelica/OpenModelica#2173: outputs", lambda: dl.run(SCENE, assured=[5]), ["assured is [5]: must be true or false or a list of texts"]),
]  # fmt: skip


@pytest.mark.parametrize(("thread", "do", "words"), BAD_CALLS, ids=[row[0] for row in BAD_CALLS])
def test_a_report_on_python_is_one_sentence(thread, do, words):
    said = refusal(do)
    assert all(word in said for word in words), said
    assert "dockloop-" not in said  # a temporary folder


def test_whole_numbers_of_a_sweep_may_have_a_point():
    vary = [{"type": "uniform", "name": "chaser.mass", "range": [1e4, 2e4]}]
    sweep = {"scene": SCENE, "vary": vary, "experiment": {"stop": 0.1}}
    found = [dl.sweep({**sweep, "cases": of(2), "seed": of(1)}) for of in (int, float)]
    assert found[0]["chaser.mass"].tolist() == found[1]["chaser.mass"].tolist()


def test_a_file_of_a_robot_is_no_mechanism_and_the_way_is_said():
    Path("robot.urdf").write_text(urdf())
    assert "'dockloop import' reads MJCF, URDF and SDF" in refusal(lambda: dl.check("robot.urdf"))


def test_states_of_a_mechanism_may_be_given_as_a_text():
    vectors = {"states": []}
    Path("states.json").write_text(json.dumps(vectors))
    assert dl.check("hexapod_bench", states="states.json") == []


def test_a_backend_that_does_not_exist_costs_the_figures_only():
    """JuliaPy/PyPlot.jl#474, matplotlib/matplotlib#6699: a setting of another machine."""
    program = """
from dockloop.base.figures import can_draw
from dockloop.base.progress import import_optional
assert not can_draw()
try:
    import_optional("matplotlib")
except Exception as error:
    print(type(error).__name__, error)
"""
    path = str(paths.ROOT / "scripts")
    env = {**os.environ, "MPLBACKEND": "nonsense", "PYTHONPATH": path}
    ran = run(sys.executable, "-c", program, env=env)
    assert ran.returncode == 0
    assert "no figures are drawn: matplotlib does not start with its settings" in ran.stderr
    assert ran.stdout.startswith("DockloopError the package matplotlib does not start with its")


def test_every_text_of_python_is_one_of_toml():
    """uiri/toml#209, uiri/toml#148."""
    for text in ("", "a\nb", '"', "\\", "\x00\x1f\x7f\x80", "\U0001f680", "\\u0041"):
        assert tomllib.loads(f"a = {to_text(text)}")["a"] == text
    group: Mapping = {"a b": [1, 2.5, True, "x"], "c": {"d": float("inf")}}
    assert tomllib.loads(f"a = {to_text(group)}")["a"] == group
