"""``dockloop host-check`` and ``dl.host_check``: logs of a host, and FMUs of vehicles, are judged.

A host docks a rigid chaser in a parallel exchange, makes one mistake or none, and writes what it
reports. The mistake that was made is the oracle. The numbers of the table follow from the mistake.
"""

import contextlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from coupling_host import RigidBody
from dockloop.fmu.build import write_fmu
from dockloop.fmu.ssp import take_out
from dockloop.native.variables import LOADS as DOCKING_LOADS
from dockloop.runs.docking import Scene
from test_host_reports import INERTIA, LOADS, MASS, MOTION, REPORTS, dock
from test_ssp_vehicle import MAP, edit, rename

SCENE, NEAR = "idss_25t_350t", {"initial.approach_time": 0.5}
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])  # N is that of the scene
HEADER = [f"chaser.{n}[{i + 1}]" for n in MOTION for i in range(4 if n == "attitude" else 3)]
STEP = 0.01
STATED = {
    "inertia": {"chaser.inertia": [*(0.5 * INERTIA), 0, 0, 0]},
    "mass": {"chaser.mass": 0.5 * MASS},
}


@pytest.fixture
def write_log(tmp_path, monkeypatch):
    """Let a host dock, and write the log of its reports into the current folder."""
    monkeypatch.chdir(tmp_path)

    def write(name, *, report=None, digits="%.17g", stop=2.5, **more):
        rows = []

        def note(*motion):
            reported = report(*motion) if report else motion
            rows.append(np.concatenate(reported))
            return reported

        with contextlib.suppress(dl.DockloopError):  # a wrong host may not come to the end
            dock(STEP, note, attitude=UPRIGHT, stop=stop, goes_on=True, **more)
        table = np.column_stack([STEP * np.arange(len(rows)), rows])
        header = ",".join(["time", *HEADER])
        np.savetxt(name, table, fmt=digits, delimiter=",", header=header, comments="")
        return name

    return write


def check(log, **more):
    return dl.host_check(log, SCENE, NEAR, **more)


def find(found, name):
    return next(entry for entry in found.checks if entry.name.startswith(name))


def test_a_right_log_is_right(write_log):
    found = check(write_log("right.csv"))
    assert found.is_right, found.sentence
    assert (found.cause, found.steps, found.mode) == ("none", 249, "parallel")
    assert {entry.verdict for entry in found.checks} == {"right"}
    assert find(found, "changes of velocity").value < 1e-7
    assert find(found, "first position").value == 0.0


@pytest.mark.parametrize(
    "name",
    [
        *("quaternion order", "angular velocity in degrees", "position unit"),
        *("velocity in body axes", "interface point"),
    ],
)
def test_a_wrong_report_is_named(write_log, name):
    turned = {"initial.pitch_yaw_deg": 3.0, "initial.pitch_yaw_rate_deg_s": 0.2}
    log = write_log("wrong.csv", report=REPORTS[name], overrides=turned)
    found = dl.host_check(log, SCENE, NEAR | turned)
    assert not found.is_right
    assert found.cause == name
    assert found.sentence.startswith("chaser.")
    assert any(entry.verdict == "wrong" for entry in found.checks), found.checks
    assert find(found, "changes of velocity").verdict == "not judged"


def test_the_error_of_a_report_is_that_of_the_mistake(write_log):
    found = check(write_log("mm.csv", report=REPORTS["position unit"]))
    start = dl.Docking(SCENE, NEAR).get("chaser.position")
    assert find(found, "first position").value == pytest.approx(999.0 * np.linalg.norm(start))
    assert found.value == pytest.approx(1e-3)


def test_a_refused_step_is_explained_by_its_first_report(write_log):
    log = write_log("turned.csv", stop=0.5)
    names = [f"chaser.attitude[{i}]" for i in (1, 2)]
    text = Path(log).read_text().replace(names[0], "q").replace(*names[::-1]).replace("q", names[1])
    Path(log).write_text(text)
    found = check(log)
    assert found.cause == "first attitude"
    assert "report the start value in the first step" in found.sentence
    assert "pressed together" in found.sentence


def test_another_point_is_away_from_the_start(write_log):
    found = check(write_log("point.csv", report=REPORTS["other point"]))
    assert found.cause == "first position"
    assert found.value == pytest.approx(np.linalg.norm([-0.2, 0.05, 0.02]))


@pytest.mark.parametrize("name", ["force sign", "torque sign", "torque in N"])
def test_a_wrong_load_is_named(write_log, name):
    found = check(write_log("wrong.csv", loads=LOADS[name], stop=4.0))
    assert found.cause == name
    kind = "velocity" if name.startswith("force") else "angular velocity"
    error = find(found, f"changes of {kind}").value
    assert find(found, "position and").verdict == "right"
    if name.endswith("sign"):  # the change is that of the load with the other sign: twice its size
        assert error == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("name", STATED)
def test_a_wrong_mass_and_a_wrong_inertia_are_named(write_log, name):
    found = check(
        write_log("wrong.csv", settings=STATED[name], stop=4.0), start_values=STATED[name]
    )
    assert found.cause == name
    assert found.value == pytest.approx(1.0, rel=0.02)  # true / stated - 1


def test_other_columns_are_inputs_or_named(write_log):
    """A push of 500 N that the log reports is no mistake; without its column it is one."""
    push = np.array([500.0, 0.0, 0.0])
    log = write_log(
        "pushed.csv",
        loads=lambda f, t, q: (f + push, t),
        settings={"chaser.force_ext": push},
        stop=1.0,
    )
    lines = Path(log).read_text().splitlines()
    head = lines[0] + ",chaser.force_ext[1],chaser.force_exxt[2]"
    Path("reported.csv").write_text("\n".join([head, *(f"{line},500,0" for line in lines[1:])]))
    found = check("reported.csv")
    assert found.is_right, found.sentence
    (note,) = found.notes
    assert note.startswith(
        "column not used: chaser.force_exxt[2] (did you mean 'chaser.force_ext[2]'"
    )
    assert check(log).cause == "unreported force"


def test_loads_of_another_docking_are_not_blamed_on_the_host(write_log):
    """The scene of the recording had another friction than the scene that is named."""
    loads = []

    def note(f, t, _q):
        loads.append([*f, *t])
        return f, t

    log = write_log("loads.csv", loads=note, stop=1.5)
    lines = Path(log).read_text().splitlines()
    names = [f"chaser.{load}_mean[{i}]" for load in ("force", "torque") for i in (1, 2, 3)]
    lines = [f"{lines[0]},{','.join(names)}"] + [
        ",".join([line, *(repr(float(x)) for x in row)])
        for line, row in zip(lines[1:], loads, strict=True)
    ]
    Path("loads.csv").write_text("\n".join(lines))
    found = check("loads.csv")
    assert found.is_right, found.sentence
    assert find(found, "recorded force_mean").value < 1e-3
    other = dl.host_check("loads.csv", SCENE, NEAR | {"contact.friction_coefficient": 0.3})
    assert other.cause == "other loads"
    assert other.sentence.startswith("chaser: recorded")


def record_host(mode, file, step=0.02, stop=1.5):
    """Let a rigid body dock in an order of exchange; write motion and loads at every time."""
    docking = dl.Docking(SCENE, NEAR | {"chaser.motion": "driven", "coupling.mode": mode})
    docking.set("coupling.expected_step", step)
    names = [f"chaser.{name}" for name in MOTION]
    loads = [f"chaser.{load}" for load in DOCKING_LOADS]
    body = RigidBody(MASS, np.diag(INERTIA), [docking.get(name) for name in names])
    if mode != "host_first":  # there the first reading of a load is the start
        docking.start()
    rows = []
    for i in range(round(stop / step)):
        held = [docking.get(name) for name in loads]
        rows.append([i * step, *np.concatenate([*body.motion(), *held])])
        if mode == "host_first":
            body.move(*held, step)
        for name, value in zip(names, body.motion(), strict=True):
            docking.set(name, value)
        docking.step(step)
        if mode != "host_first":
            body.move(*(held if mode == "parallel" else map(docking.get, loads)), step)
    assert docking.get("coupling.diagnosis") == 1, docking.warnings
    header = ",".join(["time", *HEADER, *(f"{name}[{i}]" for name in loads for i in (1, 2, 3))])
    np.savetxt(file, rows, fmt="%.17g", delimiter=",", header=header, comments="")


@pytest.mark.parametrize("mode", ["sequential", "parallel", "host_first"])
def test_a_log_is_judged_in_the_order_of_its_host(mode, tmp_path):
    record_host(mode, log := tmp_path / "log.csv")
    found = dl.host_check(log, SCENE, NEAR | {"coupling.mode": mode})
    assert found.is_right, found.sentence
    assert find(found, "recorded torque_mean").value < 1e-3
    other = "parallel" if mode == "sequential" else "sequential"
    assert not dl.host_check(log, SCENE, NEAR | {"coupling.mode": other}).is_right


def test_too_few_digits_are_named(write_log):
    found = check(write_log("short.csv", digits="%.5f"))
    assert found.cause == "digits"
    assert found.value == pytest.approx(1e-5 / STEP)
    assert "write all digits" in found.sentence


@pytest.mark.parametrize("form", ["{:.17g}", "{!r}", "{:.15g}"])
def test_entries_that_stay_have_all_their_digits(form, tmp_path):
    made = dl.run("absorber_1d", stop=0.3)  # on a line: attitude and two positions stay
    table = np.column_stack([made[name] for name in ["time", *HEADER]]).tolist()
    rows = [",".join(form.format(number) for number in row) for row in table]
    (tmp_path / "line.csv").write_text("\n".join([",".join(["time", *HEADER]), *rows]))
    found = dl.host_check(tmp_path / "line.csv", "absorber_1d")
    assert found.is_right, found.sentence
    assert find(found, "digits of position").value < 2e-11  # of 18.9990026007992
    assert find(found, "digits of attitude").verdict == "not judged"


def test_a_log_may_have_the_form_of_any_table(write_log):
    text = Path(write_log("log.csv", digits="%.9f")).read_text()
    table = text.replace(",", ";").replace(".", ",").replace("chaser,", "chaser.")
    Path("other.csv").write_text(f"# of the rig\n{table}\n\n")
    found, other = check("log.csv"), check("other.csv")
    assert found.is_right, found.sentence
    assert other.checks == found.checks
    assert find(found, "digits of position").value == pytest.approx(1e-9 / STEP)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda t: t.replace("time", "t", 1), "has no column 'time'"),
        (lambda t: t.replace("chaser.velocity[2]", "chaser.speed[2]", 1), "'chaser.velocity[2]'"),
        (lambda t: t.replace("chaser.", "tug."), "has no column 'chaser.position[1]'"),
        (lambda t: t.replace("\n0,", "\nnan,", 1), "'time' in line 2 is 'nan': must be a finite"),
        (lambda t: t.replace("\n0,", "\n9,", 1), "time must increase, but does not in line 3"),
        (lambda t: t.replace("\n0,", "\n", 1), "line 2 has 13 values: must have 14"),
        (lambda t: t.replace("chaser.velocity[1]", "time", 1), "has two columns 'time'"),
        (lambda t: t[: t.index("\n")], "has no rows of values below its header"),
        (lambda t: "\n".join(t.split("\n")[:2]), "needs at least two rows"),
        (lambda t: t.replace("\n", "\ns" + 3 * ",m" + 10 * ",1" + "\n", 1), "line 2 has units"),
        (lambda t: t.replace("chaser.", "target."), "reported"),
        (lambda t: t.replace("time", "time [s]", 1), "'time [s]' has units: leave them out"),
        (lambda t: t.replace("\n0,", '\n"0,', 1), "close its quotes"),
        (lambda t: "\n".join(line.split(",")[0] for line in t.split("\n")), "has no columns"),
    ],
)
def test_a_bad_log_gets_one_sentence(write_log, dockloop, change, text):
    log = write_log("log.csv", stop=0.1)
    content = Path(log).read_text()
    bad = change(content)
    Path("bad.csv").write_text(bad)
    scene = ["--scene", "chaser.motion=driven"] if "target" in bad else []
    outcome = dockloop("host-check", "bad.csv", SCENE, *scene)
    assert outcome.status == 2, outcome
    assert text in outcome.err
    assert "--csv" not in outcome.err
    assert outcome.err.count("\n") == 1


def test_the_command_prints_the_judgement_and_fails_with_its_sentence(write_log, dockloop):
    order = ["--scene", "initial.approach_time=0.5"]
    right = dockloop("host-check", write_log("right.csv", stop=1.0), SCENE, *order)
    assert (right.status, right.err) == (0, "")
    assert "position and integral of velocity" in right.out
    log = write_log("wrong.csv", report=REPORTS["quaternion order"])
    wrong = dockloop("host-check", log, SCENE, *order)
    assert wrong.status == 1
    assert "report the attitude as w, x, y, z" in wrong.err
    assert "cause" in wrong.out
    assert max(map(len, wrong.out.splitlines())) <= 100
    printed = dockloop("host-check", log, SCENE, *order, "--json")
    found = json.loads(printed.out)
    assert (found["cause"], found["is_right"]) == ("quaternion order", False)
    assert found["checks"][0].keys() == {"vehicle", "name", "unit", "value", "limit", "verdict"}


@pytest.fixture
def vehicle(tmp_path):
    """Write the FMU of the chaser with changes."""

    def write(**changes):
        scene = Scene(SCENE, NEAR)
        body = take_out(scene.document, "chaser")
        body["chaser"] |= changes
        file = tmp_path / "own.fmu"
        write_fmu(body, scene.path, file, bare=True)
        return file

    return write


@pytest.mark.parametrize("mode", ["parallel", "sequential", "host_first"])
def test_a_right_vehicle_fmu_is_right_in_every_order(vehicle, mode):
    found = dl.host_check(vehicle(), SCENE, NEAR | {"coupling.mode": mode}, stop=2.0, step=0.02)
    assert found.is_right, found.sentence
    assert (found.mode, found.steps) == (mode, 100)
    assert find(found, "changes of angular").value < 1e-6


def test_a_vehicle_fmu_of_another_mass_is_named(vehicle):
    found = check(vehicle(mass=2.0 * MASS), stop=4.0, step=STEP)
    assert found.cause == "mass"
    assert found.value == pytest.approx(1.0, rel=0.01)
    moves = float(re.search(r"mass were ([\d.]+) kg", found.sentence)[1])
    assert moves == pytest.approx(50e3, rel=1e-4)


def test_a_map_names_the_columns_of_a_log(write_log, dockloop):
    log = Path(write_log("log.csv", stop=1.0))
    text = log.read_text()
    for i in range(1, 5):
        text = text.replace(f"chaser.position[{i}]", f"r{i}", 1)
        text = text.replace(f"chaser.attitude[{i}]", f"q{i}", 1)
    log.write_text(text)
    Path("names.toml").write_text('[chaser]\nposition = "r*"\nattitude = "q*"\n')
    found = check("log.csv", names="names.toml")
    assert found.is_right, found.sentence
    assert find(found, "first position").value == 0.0
    Path("names.toml").write_text('[chaser]\nposition = "x*"\n')
    outcome = dockloop("host-check", "log.csv", SCENE, "--map", "names.toml")
    assert outcome.status == 2
    assert "names.toml: log.csv has no column 'x1'" in outcome.err


def test_a_map_names_the_variables_of_a_vehicle_fmu(vehicle, dockloop, tmp_path):
    """Its mass is wrong, until the map says which parameter takes that of the scene."""
    theirs = edit(vehicle(mass=2.0 * MASS), tmp_path / "theirs.fmu", rename)
    Path("names.toml").write_text(MAP)
    found = check(theirs, names="names.toml", stop=4.0, step=STEP)
    assert found.is_right, found.sentence
    Path("names.toml").write_text(MAP.partition("[chaser.start]")[0])
    assert check(theirs, names="names.toml", stop=4.0, step=STEP).cause == "mass"
    outcome = dockloop("host-check", theirs, SCENE)
    assert outcome.status == 2
    assert "no output stands for 'chaser.position[1]'" in outcome.err


def test_an_fmu_that_is_no_vehicle_is_refused(runs, dockloop, tmp_path):
    for motion in ("driven", "free"):
        docking = runs.fmu(SCENE, f"chaser.motion={motion}")
        outcome = dockloop("host-check", docking, SCENE)
        assert outcome.status == 2
        assert "is a docking, not a vehicle: name the FMU of the chaser" in outcome.err
    outcome = dockloop("host-check", docking, SCENE, "--vehicle", "target")
    assert "is a docking, not a vehicle: name the FMU of the target" in outcome.err
    (tmp_path / "text.fmu").write_text("text")
    for words, text in (
        (["text.fmu"], "text.fmu: is damaged"),
        (["no.fmu"], "no.fmu: no such FMU"),
        (["no.csv"], "no.csv: no such table"),
        (["log.txt"], "must be a log (.csv) or the FMU of a vehicle (.fmu)"),
        (["no.csv", "--vehicle", "chaser"], "--vehicle is for an FMU"),
        (["no.fmu", "--vehicle", "tug"], "--vehicle tug: must be chaser or target"),
    ):
        outcome = dockloop("host-check", *words, SCENE)
        assert outcome.status == 2, outcome
        assert text in outcome.err
