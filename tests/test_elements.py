"""Force elements through the FMU: exact motions of one body on one slide.

Oracles (``tests/data/mechanism_oracles.json``, made by an independent program): an absorber with a
staged spring and a brake of two levels, a block that a brake stops and holds, harmonic motion with
dry friction (Den Hartog), a drive that retracts a load. A bristle is elastic before it slides: its
positions are late by up to its presliding deflection, which bounds the differences here. Only in
harmonic motion the difference goes with the root of that deflection, as friction turns late.
"""

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.errors import UsageError
from dockloop.fmu.build import build_fmu
from extreme_cases.fmi_host import OK, Host
from slides import make_element, make_slide, write_slide

DATA = json.loads((Path(__file__).parent / "data" / "mechanism_oracles.json").read_text())
M_EQ = 25e3 * 350e3 / 375e3


@pytest.fixture
def write_scene(tmp_path):
    """Write scene and mechanism into one folder; return the path of the scene."""
    count = itertools.count(1)

    def write(mechanism: dict, rate: float = 0.0) -> str:
        folder = tmp_path / str(next(count))
        folder.mkdir()
        return write_slide(folder, mechanism, rate)

    return write


@pytest.fixture
def run(runs, write_scene):
    """Run a mechanism with a start and settings; check what holds for every run."""

    def call(mechanism, rate=0.0, *, stop=1.0, step=0.01, settings=(), residual=1e-7):
        result = runs.run(
            write_scene(mechanism, rate), stop=stop, step=step, settings=tuple(settings)
        )
        scale = max(np.max(result["energy.kinetic"]), np.max(result["energy.potential"]), 1e-3)
        scale = max(scale, np.max(np.abs(result["energy.drive_work"])))
        assert np.max(np.abs(result["energy.residual"])) < residual * scale
        assert np.min(np.diff(result["energy.dissipated_brakes"])) > -1e-9 * scale
        return result

    return call


def find_crossing(t, y, x, level):
    """First time at which x falls to a level after its maximum, and y there."""
    top = int(np.argmax(x))
    after = top + int(np.flatnonzero(x[top:] <= level)[0])
    share = (x[after - 1] - level) / (x[after - 1] - x[after])
    return (
        t[after - 1] + share * (t[after] - t[after - 1]),
        y[after - 1] + share * (y[after] - y[after - 1]),
    )


@pytest.mark.parametrize("case", DATA["absorber"], ids=["released", "sticks", "strong", "plain"])
def test_absorber_with_a_staged_spring_and_a_brake_of_two_levels(run, case):
    spring = {
        "type": "spring",
        "side": "positive",
        "corner": 1e-5,
        "stages": [[0, 8e3], [0.06, 4e4]],
    }
    if case["preload"]:
        spring |= {"preload": case["preload"], "take_up": 1e-5}
    brake = {"type": "brake", "forward": case["forward"], "back": case["back"], "presliding": 1e-5}
    made = run(
        make_slide(M_EQ, make_element(spring, brake)),
        case["v0"],
        stop=1.3 * case["t_end"],
        step=case["t_end"] / 400,
    )
    t, x, v = made["time"], made["element[1].coordinate"], made["element[1].rate"]
    assert np.max(x) == pytest.approx(case["x_max"], abs=1e-5)
    assert np.min(made["element[1].force"]) == pytest.approx(-case["force_peak"], abs=1.0)
    if case["sticks"]:
        held = t > 1.1 * case["t_end"]
        assert np.all(np.abs(x[held] - case["x_stick"]) < 6e-5)
    else:
        time, rate = find_crossing(t, v, x, 0.0)
        assert time == pytest.approx(case["t_end"], abs=6e-3)  # the bristle turns over at the top
        assert rate == pytest.approx(-case["v_end"], abs=5e-5)
    # Brake levels times ways, less what the bristle holds.
    down = int(np.argmax(x))
    way = case["forward"] * x[down] + case["back"] * (x[down] - max(x[-1], 0.0))
    if case["sticks"]:
        assert made["energy.dissipated_brakes"][-1] == pytest.approx(way, abs=0.02 + 2e-3 * way)


def test_absorber_without_a_brake_returns_its_energy(run):
    spring = {"type": "spring", "stages": [[0, 2e4]], "side": "positive"}
    made = run(make_slide(M_EQ, make_element(spring)), 0.1, stop=4.0)
    t, x, v = made["time"], made["element[1].coordinate"], made["element[1].rate"]
    # Half a period of sqrt(k/m); the peak lies between samples.
    assert np.max(x) == pytest.approx(0.1 * math.sqrt(M_EQ / 2e4), rel=2e-5)
    assert v[-1] == pytest.approx(-0.1, rel=1e-7)
    assert find_crossing(t, v, x, 0.0)[0] == pytest.approx(3.393308, abs=1e-4)


def test_a_brake_stops_a_block_and_holds_it_without_creep(run):
    block = DATA["brake_block"]
    brake = {"type": "brake", "forward": block["level"], "presliding": 1e-5}
    pull = {"type": "constant", "force": 150}
    held = run(make_slide(block["m"], make_element(brake, pull)), stop=100.0, step=1.0)
    x = held["element[1].coordinate"]
    assert 0.7e-5 < x[-1] < 3e-5  # elastic, and a slip under the sudden load
    assert abs(x[-1] - x[2]) < 1e-6
    stopped = run(make_slide(block["m"], make_element(brake)), 0.1, stop=0.1, step=1e-3)
    exact = block["stop_from_0.1"]
    x, v = stopped["element[1].coordinate"], stopped["element[1].rate"]
    assert np.max(x) == pytest.approx(exact["x"], abs=1.5e-5)
    assert stopped["time"][np.flatnonzero(v <= 0.0)[0]] == pytest.approx(exact["t"], abs=2e-3)
    assert stopped["energy.dissipated_brakes"][-1] == pytest.approx(0.2, abs=2e-3)


def find_amplitude(scene, case, periods=40, steps=400):
    """Half the way from top to bottom in the last period under a harmonic force.

    The force of a motor is constant over a step. The mean of its sine over steps of 1/400 of a
    period is right to 1e-5.
    """
    docking = dl.Docking(scene)
    frequency = case["frequency_ratio"] * math.sqrt(case["k"] / case["m"])
    h, x = 2.0 * math.pi / frequency / steps, []
    for k in range(periods * steps):
        docking.set("element[1].command", case["F0"] * math.cos(frequency * (k + 0.5) * h))
        docking.step(h)
        x.append(docking.get("element[1].coordinate"))
    return np.ptp(x[-steps:]) / 2.0


@pytest.mark.parametrize("case", DATA["den_hartog"], ids=["slow", "fast"])
def test_harmonic_motion_with_dry_friction_has_the_amplitude_of_den_hartog(write_scene, case):
    errors = []
    for brake in (
        {"model": 1, "friction_speed": 1e-4},
        {"presliding": 1e-5},
        {"presliding": 1e-6},
    ):
        element = make_element(
            {"type": "spring", "stages": [[0, case["k"]]]},
            {"type": "brake", "forward": case["level"], **brake},
            {
                "type": "motor",
                "constant": 1.0,
                "resistance": 1.0,
                "current_limit": 2 * case["F0"],
                "current": 0.0,
                "commanded": True,
            },
        )
        found = find_amplitude(write_scene(make_slide(case["m"], element)), case)
        errors.append(abs(found - case["amplitude"]))
    assert errors[0] < 5e-5
    assert errors[2] < 3e-4
    assert 2.5 < errors[1] / errors[2] < 4.0  # the root of 10


def test_a_regularised_brake_may_act_one_way(run):
    brake = {"type": "brake", "forward": 0, "back": 200, "model": 1}
    free = run(make_slide(40, make_element(brake)), 0.1, stop=0.1)
    assert free["element[1].rate"][-1] == pytest.approx(0.1, abs=1e-4)
    caught = run(make_slide(40, make_element(brake)), -0.1, stop=0.1)
    assert abs(caught["element[1].rate"][-1]) < 1e-4


def test_dampers_dissipate_and_slow_down_by_their_formula(run):
    damper = {"type": "damper", "linear": 80.0}
    made = run(make_slide(40, make_element(damper)), 0.1, stop=1.0)
    assert made["element[1].rate"][-1] == pytest.approx(0.1 * math.exp(-2.0), rel=1e-6)
    assert made["energy.dissipated_legs"][-1] == pytest.approx(
        0.5 * 40 * 0.01 * (1 - math.exp(-4.0)), rel=1e-6
    )
    # Eddy brake: m v' = -c v/(1 + (v/p)^2), so m (ln(v/v0) + (v^2 - v0^2)/(2 p^2)) = -c t.
    eddy = {"type": "eddy", "slope": 200.0, "peak_rate": 0.05}
    made = run(make_slide(40, make_element(eddy)), 0.2, stop=1.0)
    v = made["element[1].rate"]
    left = 40 * (np.log(v / 0.2) + (v**2 - 0.04) / (2 * 0.05**2))
    assert np.max(np.abs(left + 200 * made["time"])) < 1e-4
    assert made["energy.dissipated_brakes"][-1] == pytest.approx(20 * (0.04 - v[-1] ** 2), rel=1e-6)


@pytest.mark.parametrize("limited", [None, *DATA["retraction"]["limited"][:2]])
def test_a_drive_retracts_a_load_in_the_stated_time(run, limited):
    exact = DATA["retraction"]
    limit = limited["limit"] if limited else 600.0
    drive = {
        "type": "drive",
        "target": exact["distance"],
        "speed": exact["speed"],
        "acceleration": exact["acceleration"],
        "gain": 2e6,
        "limit": limit,
    }
    load = {"type": "constant", "force": -exact["friction"]}
    made = run(make_slide(exact["m_eq"], make_element(drive, load)), stop=40.0, step=0.05)
    t, x = made["time"], made["element[1].coordinate"]
    reached = t[np.flatnonzero(x > exact["distance"] - 3e-4)[0]]
    stated = limited["time"] if limited else exact["time"]
    assert stated - 1.5 < reached < stated + 0.4
    assert made["energy.drive_work"][-1] == pytest.approx(exact["work"], rel=5e-3)
    assert np.max(made["element[1].saturation"]) <= 1.0 + 1e-12


def test_a_drive_below_its_load_does_not_move_and_says_so(run):
    exact = DATA["retraction"]
    drive = {
        "type": "drive",
        "target": 0.25,
        "speed": 0.01,
        "acceleration": 0.002,
        "gain": 2e5,
        "limit": exact["spring_stall"]["limit"],
    }
    spring = {"type": "spring", "stages": [[0, exact["spring_stall"]["spring"]]]}
    brake = {"type": "brake", "forward": exact["friction"]}
    made = run(make_slide(1.0, make_element(drive, spring, brake)), stop=60.0, step=0.1)
    # (180 N - 120 N)/(400 N/m)
    stall = exact["spring_stall"]["stalls_at"]
    assert made["element[1].coordinate"][-1] == pytest.approx(stall, abs=1e-3)
    assert made["element[1].saturation"][-1] > 0.98


def test_a_motor_runs_up_to_its_no_load_rate(run):
    motor = {
        "type": "motor",
        "constant": 0.5,
        "resistance": 0.6,
        "current_limit": 80,
        "voltage": 2.0,
    }
    made = run(make_slide(2.0, make_element(motor)), stop=20.0, step=0.1)
    rate = 4.0 * (1 - np.exp(-0.25 / 0.6 / 2.0 * made["time"]))
    assert np.max(np.abs(made["element[1].rate"] - rate)) < 1e-6
    work = 0.5 * 2.0 * made["element[1].rate"] ** 2
    assert np.max(np.abs(made["energy.drive_work"] - work)) < 1e-6


def test_a_commanded_law_has_an_input_and_numbers_of_laws_are_parameters(run):
    drive = {
        "type": "drive",
        "target": 0.01,
        "speed": 0.1,
        "acceleration": 0.1,
        "gain": 1e4,
        "limit": 600,
        "commanded": True,
    }
    slide = make_slide(40, make_element(drive, {"type": "eddy", "slope": 1, "peak_rate": 1}))
    assert run(slide, stop=3.0)["element[1].coordinate"][-1] == pytest.approx(0.01, abs=1e-6)
    settings = ("element[1].command=-0.03", "element[1].law[1].speed=0.02")
    made = run(slide, stop=5.0, settings=settings)
    assert made["element[1].coordinate"][-1] == pytest.approx(-0.03, abs=1e-6)
    assert np.min(made["element[1].rate"]) == pytest.approx(-0.02, rel=2e-2)


def test_a_reset_brings_the_numbers_of_the_file_back_and_takes_new_ones(runs, write_scene):
    elements = (
        make_element({"type": "constant", "force": 5.0}, name="push"),
        make_element(
            {
                "type": "motor",
                "constant": 1.0,
                "resistance": 1.0,
                "current_limit": 8.0,
                "current": 2.0,
                "commanded": True,
            },
            name="motor",
        ),
    )
    failure = {"element": "push", "law": 1, "kind": "factor", "time": 50.0, "value": 0.5}
    fmu = runs.fmu(write_scene(make_slide(10.0, *elements, failures=[failure])))
    names = ("element[1].law[1].force", "element[2].command", "failure[1].value")
    with Host(fmu) as host:
        for force, command, value in ((9.0, 3.0, 0.25), (-7.0, -4.0, 0.75)):
            assert list(host.get(*names)) == [5.0, 2.0, 0.5]
            numbers = dict(zip(names, (force, command, value), strict=True))
            assert host.set_status(numbers) == OK
            assert host.get(*names).tolist() == [force, command, value]
            host.start()
            host.time = 0.0
            host.step()
            assert host.get("element[1].force", "element[2].force").tolist() == [force, command]
            host.slave.reset()
            host.slave.setupExperiment(startTime=0.0)
            host.slave.enterInitializationMode()


def test_laws_of_two_elements_and_the_short_form_give_the_same_motion(run):
    short = {
        "type": "joint_spring_damper",
        "joint": "block",
        "stiffness": 300,
        "damping": 20,
        "rest": 0.02,
        "preload": 3,
    }
    laws = [
        {"type": "spring", "stages": [[0, 300]], "rest": 0.02},
        {"type": "damper", "linear": 20},
        {"type": "constant", "force": 3},
    ]
    idle = make_element({"type": "constant", "force": 0}, name="idle")
    a = run(make_slide(40, short, idle), 0.1, stop=3.0)
    b = run(
        make_slide(40, make_element(*laws[:1]), make_element(*laws[1:], name="two")), 0.1, stop=3.0
    )
    assert np.max(np.abs(a["state.q[1]"] - b["state.q[1]"])) < 1e-9


def test_failures_take_away_scale_and_lock(run):
    spring = {"type": "spring", "stages": [[0, 400]]}
    off = {"element": "one", "law": 1, "kind": "off", "time": 0.5}
    made = run(make_slide(40, make_element(spring), failures=[off]), 0.1, stop=2.0)
    late = made["time"] > 0.56
    assert np.ptp(made["element[1].rate"][late]) < 1e-9
    assert made["energy.dissipated_legs"][-1] > 0.0
    made = run(
        make_slide(40, make_element(spring), failures=[off]),
        0.1,
        stop=2.0,
        settings=("failure[1].active=false",),
    )
    t = made["time"]
    w = math.sqrt(10.0)
    assert np.max(np.abs(made["element[1].coordinate"] - 0.1 / w * np.sin(w * t))) < 1e-6
    doubled = dict(off, kind="factor", value=2.0)
    made = run(make_slide(40, make_element(spring), failures=[doubled]), 0.1, stop=1.0)
    assert made["element[1].force"][-1] == pytest.approx(
        -800 * made["element[1].coordinate"][-1], rel=1e-9
    )
    jammed = {"element": "one", "kind": "jammed", "time": 0.3}
    slide = make_slide(40, make_element(spring), failures=[jammed])
    made = run(slide, 0.1, stop=1.0, residual=1e-6)  # vibrates at 1118 rad/s without damping
    late = made["time"] > 0.31
    assert np.ptp(made["element[1].coordinate"][late]) < 3e-4  # 2 v sqrt(m/k)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ({"type": "spring", "stages": [[0, 8e3]], "preload": 9}, "preload is 9 without take_up"),
        ({"type": "spring", "stages": [[0, 8e3], [0.06, 4e4]], "corner": 0.04}, "at most 0.03"),
        ({"type": "brake", "forward": 450, "back": 9}, "at least 0.1 of the larger"),
        ({"type": "brake", "forwardd": 450}, "unknown member 'forwardd' (did you mean 'forward'"),
        ({"type": "brakes", "forward": 450}, "must be one of spring, constant, damper"),
        ({"type": "eddy", "slope": 3}, "lacks the member 'peak_rate'"),
        ({"type": "damper", "linear": -3}, "must be at least 0"),
    ],
)
def test_malformed_laws_are_refused_in_one_sentence(write_scene, tmp_path, law, message):
    scene = write_scene(make_slide(40, make_element(law)))
    with pytest.raises(UsageError) as caught:
        build_fmu(scene, (), tmp_path / "out.fmu", bare=True)
    assert message in str(caught.value)
    assert "forces[1].laws[1]" in str(caught.value)
    assert "\n" not in str(caught.value)
