"""The packaged FMU as an outsider sees it: valid, deterministic, complete, strict about input."""

import re
import shutil
import signal
import zipfile
from contextlib import contextmanager

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu
from lark import Lark

from conftest import SCENES
from dockloop.fmu.host import Instance, run_fmu

DEFAULT = "idss_25t_350t"
VARIANTS = [
    *((scene,) for scene in SCENES),
    (DEFAULT, "chaser.motion=driven"),
    (DEFAULT, "target.motion=driven"),
    (DEFAULT, "target.motion=fixed"),
]

# What the default scene must export: names are an interface and do not change.
# V is chaser and target; [1..3] is three names; {a,b} is two.
EXPECTED = """
V.position[1..3] V.velocity[1..3] V.attitude[1..4] V.angular_velocity[1..3]
V.force_ext[1..3] V.torque_ext[1..3] V.{force,torque,force_mean,torque_mean}[1..3]
V.mass V.inertia[1..6] V.interface_position[1..3] V.interface_attitude[1..4]
V.mass_includes_mechanism gravity[1..3]
relative.{position,velocity,angular_velocity}[1..3] relative.attitude[1..4]
relative.{axial,lateral,pitch_yaw,roll} gap stack.mass stack.com[1..3] stack.inertia[1..6]
capture.{force,torque}[1..3] capture.{tension,compression,shear,bending,torsion,load_ratio}
capture.{peak,peak_time,peak_step}.{tension,compression,shear,bending,torsion,load_ratio}
contact.petal[1..3].force contact.depth_ratio latch[1..3].{opening,force,lateral,state}
friction.{coefficient,model} restitution restitution_speed
phase captured latched[1..3] outcome time_to_contact time_of_contact time_of_capture
capture.{reason,seated_time} limits.exceeded
limits.{overlap,passed,stop,load,tilt,depth,time_out,singular}.{time,value}
chaser.{contact_thrust,contact_thrust_delay}
ring.{position,velocity,angular_velocity}[1..3] ring.attitude[1..4]
leg[1..6].{length,rate,force,force_command,peak,peak_time,peak_step}
energy.{kinetic,potential,dissipated,external,residual}
energy.{dissipated_contact,dissipated_friction,dissipated_legs,dissipated_latches}
momentum.residual momentum.{linear,angular,reference}[1..3]
solver.{steps,rhs_evaluations,rejected_steps,closure_residual,singularity_margin}
solver.{method,rtol,atol_position,atol_velocity}
accuracy solver.{chosen_method,chosen_rtol,chosen_step,error_estimate}
"""


def expand(pattern):
    """Expand the shorthand of EXPECTED into names."""
    if pattern.startswith("V."):
        return [n for v in ("chaser", "target") for n in expand(pattern.replace("V", v, 1))]
    if match := re.search(r"\{(.*?)\}", pattern):
        choices = match[1].split(",")
    elif match := re.search(r"(?<=\[)1\.\.(\d)", pattern):
        choices = [str(i + 1) for i in range(int(match[1]))]
    else:
        return [pattern]
    head, tail = pattern[: match.start()], pattern[match.end() :]
    return [name for choice in choices for name in expand(head + choice + tail)]


@contextmanager
def instance(fmu, initialised=True, stop_time=None, **start_values):
    """An instance of an FMU and a function from names to value references."""
    description = read_model_description(fmu)
    references = {v.name: v.valueReference for v in description.modelVariables}
    folder = extract(fmu)
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="test",
    )
    slave.instantiate()
    try:
        slave.setupExperiment(startTime=0.0, stopTime=stop_time)
        for name, value in start_values.items():
            slave.setReal([references[name]], [value])
        if initialised:
            slave.enterInitializationMode()
            slave.exitInitializationMode()
        yield slave, references
    finally:
        slave.freeInstance()
        shutil.rmtree(folder, ignore_errors=True)


def set_and_step(slave, reference, value):
    """Set one Real and make a step: one of the two must refuse a bad value."""
    slave.setReal([reference], [value])
    slave.doStep(0.0, 0.01)


@pytest.fixture(scope="module")
def legal_names():
    """FMPy parses each name of a variable once, not in every scene: that takes most of its time."""
    parse, legal = Lark.parse, set()

    def parse_once(parser, name):
        if name not in legal:
            parse(parser, name)
            legal.add(name)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Lark, "parse", parse_once)
        yield legal


@pytest.mark.parametrize("variant", VARIANTS, ids=" ".join)
@pytest.mark.usefixtures("legal_names")
def test_every_scene_gives_a_valid_fmu(runs, variant):
    assert validate_fmu(str(runs.complete_fmu(*variant))) == []


def test_a_bare_fmu_is_the_complete_one_without_what_is_read_or_compiled(runs):
    files = []
    for fmu in (runs.fmu(DEFAULT), runs.complete_fmu(DEFAULT)):
        with zipfile.ZipFile(fmu) as archive:
            files.append({name: archive.read(name) for name in archive.namelist()})
    bare, complete = files
    needed = re.compile(r"modelDescription\.xml|binaries/.*|resources/.*")
    assert set(bare) == {name for name in complete if needed.fullmatch(name)}
    listed = re.compile(rb"><SourceFiles>.*?</SourceFiles></\w+>")
    assert {name: listed.sub(b"/>", complete[name]) for name in bare} == bare


def test_the_archive_holds_what_fmi_asks_for(runs):
    with zipfile.ZipFile(runs.complete_fmu(DEFAULT)) as archive:
        names = set(archive.namelist())
        assert {
            f"binaries/linux64/{DEFAULT}.so",
            "documentation/index.html",
            "documentation/licenses/license.txt",
            "model.png",
            "modelDescription.xml",
            "resources/model.json",
            "terminalsAndIcons/terminalsAndIcons.xml",
        } <= names
        known = {"binaries", "documentation", "extra", "resources", "sources", "terminalsAndIcons"}
        assert {n.split("/")[0] for n in names} <= known | {"model.png", "modelDescription.xml"}
        page = archive.read("documentation/index.html").decode()
    assert "capture.peak.compression" in page


def test_the_default_scene_exports_every_variable_of_its_groups(runs):
    names = {v.name for v in read_model_description(runs.fmu(DEFAULT)).modelVariables}
    expected = [name for pattern in EXPECTED.split() for name in expand(pattern)]
    assert [name for name in expected if name not in names] == []


@pytest.mark.parametrize("variant", VARIANTS, ids=" ".join)
def test_every_real_has_a_unit_and_every_variable_a_description(runs, variant):
    for variable in read_model_description(runs.fmu(*variant)).modelVariables:
        assert variable.description or variable.causality == "independent", variable.name
        assert variable.type != "Real" or variable.unit, variable.name


def test_groups_that_a_scene_leaves_out_are_not_exported(runs):
    fmu = runs.fmu(DEFAULT, "outputs.groups=['relative']")
    found = read_model_description(fmu).modelVariables
    names = {v.name for v in found if v.causality == "output"}
    assert "relative.axial" in names
    assert not any(name.startswith(("capture", "ring", "leg[", "energy")) for name in names)


def test_a_driven_vehicle_has_its_motion_as_inputs(runs):
    variables = {
        v.name: v
        for v in read_model_description(runs.fmu(DEFAULT, "chaser.motion=driven")).modelVariables
    }
    assert variables["chaser.position[1]"].causality == "input"
    assert variables["target.position[1]"].causality == "output"


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("name", ["chaser.force_ext[1]", "gravity[2]", "leg[1].force_command"])
def test_an_input_that_is_not_finite_is_an_fmi_error(runs, name, bad):
    with instance(runs.fmu(DEFAULT)) as (slave, references):
        with pytest.raises(FMICallException):
            set_and_step(slave, references[name], bad)
        slave.reset()


def test_a_pose_that_is_not_finite_is_an_fmi_error(runs):
    fmu = runs.fmu(DEFAULT, "chaser.motion=driven")
    for name in ("chaser.position[2]", "chaser.attitude[1]", "chaser.velocity[3]"):
        with instance(fmu) as (slave, references), pytest.raises(FMICallException):
            set_and_step(slave, references[name], float("nan"))


@pytest.mark.parametrize("point", [float("inf"), float("-inf"), float("nan")])
def test_a_communication_point_that_is_not_finite_changes_nothing(runs, point):
    with instance(runs.fmu(DEFAULT)) as (slave, _):
        slave.doStep(0.0, 0.01)
        with pytest.raises(FMICallException):
            slave.doStep(point, 0.01)
        slave.doStep(0.01, 0.01)


def test_no_step_ends_after_the_stop_time(runs):
    with instance(runs.fmu(DEFAULT), stop_time=0.1) as (slave, _):
        with pytest.raises(FMICallException):
            slave.doStep(0.0, 100.0)
        slave.doStep(0.0, 0.05)
        with pytest.raises(FMICallException):
            slave.doStep(0.05, 0.0501)
        slave.doStep(0.05, 0.05 * (1.0 + 1e-9))  # a master that overshoots by rounding


def test_the_same_run_gives_the_same_bits_and_so_does_a_run_after_reset(runs):
    with instance(runs.fmu(DEFAULT)) as (slave, references):
        names = ("relative.axial", "ring.position[2]", "capture.peak.shear", "energy.kinetic")
        chosen = [references[name] for name in names]

        def run():
            for i in range(30):
                slave.doStep(0.1 * i, 0.1)
            return slave.getReal(chosen)

        first = run()
        slave.reset()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        assert run() == first
    with instance(runs.fmu(DEFAULT)) as (slave, _):
        assert run() == first


def test_two_instances_do_not_disturb_each_other(runs):
    fmu = runs.fmu(DEFAULT)
    alone = runs.run(DEFAULT, stop=3.0, step=0.1)
    with instance(fmu) as (a, references), instance(fmu) as (b, _):
        for i in range(30):
            a.doStep(alone["time"][i], alone["time"][i + 1] - alone["time"][i])
            b.doStep(0.05 * i, 0.05)
        assert a.getReal([references["ring.position[1]"]]) == [alone["ring.position[1]"][-1]]


def test_the_communication_step_does_not_matter_beyond_the_tolerance(runs):
    coarse = runs.run(DEFAULT, stop=3.0, step=0.1)
    fine = runs.run(DEFAULT, stop=3.0, step=0.01)
    difference = coarse.vector("relative.position")[-1] - fine.vector("relative.position")[-1]
    assert np.max(np.abs(difference)) < 1e-5


def test_ctrl_c_is_not_lost_where_the_fmu_logs(runs, monkeypatch):
    log, asked = Instance._on_log, []

    def on_log(self, *about):
        asked.append(self.time)
        signal.raise_signal(signal.SIGINT)
        log(self, *about)

    monkeypatch.setattr(Instance, "_on_log", on_log)
    # Where tests run in the background, Ctrl-C is ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            run_fmu(runs.fmu("absorber_1d"), ["accuracy=1e-3"])
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert set(asked) == {0.0}  # before the second step, and not at the end
