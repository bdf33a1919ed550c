"""Tables of a scene that prescribe inputs: ``[[input]]``.

Oracle: velocity and position of a free body under a piecewise linear or constant force, integrated
row by row with Simpson's rule, which is exact for polynomials of the third degree.
"""

import itertools

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.errors import UsageError
from dockloop.fmu.build import build_fmu
from dockloop.native.core import number_choice
from extreme_cases.fmi_host import OK, Host
from slides import VEHICLE, make_element, make_slide, write_slide

MASS = 1000.0
SCENE = f"""{VEHICLE}
[[input]]
file = "jets.csv"
"""
TIMES = [0.2, 0.35, 0.35, 1.0, 1.37, 2.0, 2.5]  # a jump at 0.35
FORCES = [0.0, 30.0, 12.0, -25.0, -25.0, 4.0, 0.0]
TABLE = "time [s],chaser.force_ext[1] [N]\n" + "".join(
    f"{t},{f}\n" for t, f in zip(TIMES, FORCES, strict=True)
)


def find_force(time, *, is_held=False):
    """The force just after a time."""
    row = int(np.searchsorted(TIMES, time, "right")) - 1
    if row < 0 or row + 1 == len(TIMES) or is_held:
        return FORCES[max(row, 0)]
    share = (time - TIMES[row]) / (TIMES[row + 1] - TIMES[row])
    return FORCES[row] + share * (FORCES[row + 1] - FORCES[row])


def find_motion(stop, *, is_held=False):
    """Velocity and position at `stop`, from rest."""
    velocity = position = 0.0
    ends = sorted({0.0, stop, *(t for t in TIMES if t < stop)})
    for begin, end in itertools.pairwise(ends):
        h = end - begin
        first, middle = (find_force(begin + part * h, is_held=is_held) for part in (0.0, 0.5))
        last = 2.0 * middle - first
        position += h * velocity + h * h / 6.0 * (first + 2.0 * middle) / MASS
        velocity += h / 6.0 * (first + 4.0 * middle + last) / MASS
    return velocity, position


@pytest.fixture
def write(tmp_path):
    def call(text=TABLE, more="", scene=SCENE):
        (tmp_path / "jets.csv").write_text(text)
        file = tmp_path / "vehicle.toml"
        file.write_text(scene + more)
        return str(file)

    return call


@pytest.mark.parametrize("method", ["auto", "explicit", "rosenbrock", "fixed_rk4"])
@pytest.mark.parametrize("interpolation", ["linear", "hold"])
def test_a_force_has_its_effect_at_any_step(write, method, interpolation):
    scene = write(more=f'interpolation = "{interpolation}"\n')
    velocity, position = find_motion(3.0, is_held=interpolation == "hold")
    for step in (1.0, 0.3, 0.01):
        run = dl.run(scene, start_values={"solver.method": method}, stop=3.0, step=step)
        assert run["chaser.velocity[1]"][-1] == pytest.approx(velocity, rel=1e-9)
        assert run["chaser.position[1]"][-1] == pytest.approx(position, rel=1e-9)
        most = 1e-6 if method == "rosenbrock" else 1e-9  # of the tolerance of the scene
        assert np.max(np.abs(run["energy.residual"])) < most
        assert np.max(np.abs(run["chaser.force_mean[1]"])) < 1e-7  # no docking system acts
        shown = [find_force(t, is_held=interpolation == "hold") for t in run.time]
        away = np.min(np.abs(run.time[:, None] - TIMES), axis=1) > 1e-9  # rounding decides there
        assert run["chaser.force_ext[1]"][away] == pytest.approx(np.array(shown)[away], abs=1e-7)


def test_a_table_is_compared_with_the_start_of_the_run(write, capsys):
    scene = write("time,chaser.force_ext[1]\n0,10\n2,10\n")
    dl.run(scene, {"experiment.start": 64.0, "experiment.stop": 66.0}, stop=65.0)
    said = capsys.readouterr().err
    assert "jets.csv: is from 0 to 2 s, the run from 64 to 66 s: only one row acts" in said


@pytest.mark.parametrize("begin", [1774958400, 100, -9])  # since 1970; behind the run; before it
def test_a_table_that_the_run_does_not_meet_is_said(write, begin, capsys):
    text = f"time,chaser.force_ext[1]\n{begin},10\n{begin + 2},10\n"
    assert dl.run(write(text), stop=2.0)["chaser.velocity[1]"][-1] == pytest.approx(0.02)
    said = capsys.readouterr().err
    assert f"jets.csv: is from {begin} to {begin + 2} s, the run from 0 to 3 s" in said


def test_columns_are_mapped_and_converted(write):
    text = "t [ms];F [kN];spare\n0;0;1\n1000;0,03;2\n1000;0;3\n"
    scene = write(text, 'columns = { F = "chaser.force_ext[2]", spare = "" }\n')
    run = dl.run(scene, stop=2.0, step=0.5)
    assert run["chaser.velocity[2]"][-1] == pytest.approx(15.0 / MASS, rel=1e-12)


def test_a_saved_state_goes_on_with_the_same_bits(write):
    for interpolation in ("linear", "hold"):
        docking = dl.Docking(write(more=f'interpolation = "{interpolation}"\n'))
        docking.step(0.6)
        state, ends = docking.save(), []
        for _ in range(2):
            for _ in range(4):
                docking.step(0.3)
            ends.append([docking.get(f"chaser.{m}[1]") for m in ("position", "velocity")])
            docking.restore(state)
        assert ends[0] == ends[1]


def test_fmu_has_the_numbers_and_the_same_bits(write, tmp_path):
    scene = write()
    fmu = build_fmu(scene, output=tmp_path / "vehicle.fmu")
    docking = dl.Docking(scene)
    (tmp_path / "jets.csv").unlink()
    with Host(fmu) as host:
        host.start()
        for _ in range(10):
            assert host.step_status(0.3) == OK
            docking.step(0.3)
        assert host.value("chaser.position[1]") == docking.get("chaser.position[1]")
    with Host(fmu, exchange=True) as host:
        host.integrate(3.0, 0.01, host.start_exchange())
        velocity, position = find_motion(3.0)
        assert host.value("chaser.velocity[1]") == pytest.approx(velocity, rel=1e-9)
        assert host.value("chaser.position[1]") == pytest.approx(position, rel=1e-9)


def test_a_host_cannot_set_an_input_that_has_a_table_and_the_others_act_too(write):
    docking = dl.Docking(write())
    assert docking.variables["chaser.force_ext[1]"].causality == "output"
    with pytest.raises(UsageError, match=r"chaser\.force_ext\[1\]"):
        docking.set("chaser.force_ext[1]", 1.0)
    docking.set("chaser.force_ext[2]", 10.0)
    docking.step(3.0)
    assert docking.get("chaser.velocity[1]") == pytest.approx(find_motion(3.0)[0], rel=1e-9)
    assert docking.get("chaser.velocity[2]") == pytest.approx(30.0 / MASS, rel=1e-12)


def test_gravity_over_time(write):
    """9.6 t^2/2 m/s2 in steps: a ramp from 0 to 9.6 m/s2 within 2 s, then held."""
    text = "time [s],gravity[3] [m/s2]\n0,0\n2,9.6\n"
    for step in (1.0, 0.07):
        run = dl.run(write(text), stop=2.8, step=step)
        end = run.time[-1]
        after = end - 2.0
        assert run["chaser.velocity[3]"][-1] == pytest.approx(9.6 + 9.6 * after, rel=1e-9)
        fallen = 9.6 * 2.0**2 / 6.0 + 9.6 * after + 4.8 * after**2
        assert run["chaser.position[3]"][-1] == pytest.approx(fallen, rel=1e-9)


def test_command_of_an_element(tmp_path):
    """The current of a motor: a force that grows for a second, then stops."""
    motor = {"type": "motor", "constant": 2.0, "resistance": 1.0, "current_limit": 100.0}
    motor |= {"current": 5.0, "commanded": True}
    path = write_slide(tmp_path, make_slide(40.0, make_element(motor)))
    (tmp_path / "plan.csv").write_text("time [s],element[1].command\n0,0\n1,20\n1,0\n")
    with (tmp_path / "scene.toml").open("a") as scene:
        scene.write('[[input]]\nfile = "plan.csv"\n')
    for step in (0.6, 0.01):
        run = dl.run(path, stop=1.2, step=step)
        assert run["element[1].rate"][-1] == pytest.approx(20.0 / 40.0, rel=1e-9)
        assert abs(run["energy.residual"][-1]) < 1e-8


def test_commands_to_a_sequence(tmp_path):
    """A command between communication points acts at its time, not at the next point."""
    steps = [
        {"name": "wait", "phase": 1, "next": [{"when": {"command": "extend"}, "go": "next"}]},
        {"name": "next", "phase": 2},
    ]
    slide = make_slide(40.0, make_element({"type": "constant", "force": 0.0}))
    slide["sequence"] = {"start": "wait", "steps": steps}
    path = write_slide(tmp_path, slide)
    number = number_choice("command", "extend")
    (tmp_path / "plan.csv").write_text(f"time [s],command\n0,1\n0.437,{number}\n")
    with (tmp_path / "scene.toml").open("a") as scene:
        scene.write('[[input]]\nfile = "plan.csv"\n')
    for step in (1.0, 0.1):
        run = dl.run(path, stop=1.0, step=step)
        assert run["sequence.entered[2]"][-1] == pytest.approx(0.437, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "more", "expected"),
    [
        (None, "", "no such table"),
        ("time [s],chaser.force_ext[4] [N]\n0,0\n1,1\n", "", "has no input 'chaser.force_ext[4]'"),
        ("time [s],F [N]\n0,0\n1,1\n", 'columns = { F = "chaser.thrust" }\n', "has no input"),
        ("time [s],F [N]\n0,0\n1,1\n", "", "has no column of an input"),
        ("time [s],F [m]\n0,0\n1,1\n", 'columns = { F = "chaser.force_ext[1]" }\n', "is in 'm'"),
        (TABLE.replace("2.0,4.0", "1.2,4.0"), "", "time must not decrease, but does in line 7"),
        (TABLE.replace("2.0,4.0", "2.0,big"), "", "'chaser.force_ext[1]' in line 7 is 'big'"),
        (TABLE, '[[input]]\nfile = "jets.csv"\n', "has a table already"),
        (TABLE, 'interpolation = "cubic"\n', "must be one of linear, hold"),
        (
            "time,F\n0,0\n1,1\n",
            'columns = { F = "chaser.force_ext[1]:kN" }\n',
            'or [[input]] columns = { "time" = "time:s" }',
        ),
        (
            "time [s],F [N]\n0,0\n1,1\n",
            'columns = { F = "chaser.contact_thrust" }\n',
            "has no input 'chaser.contact_thrust'",
        ),
    ],
)
def test_a_bad_table_is_refused_in_one_sentence(write, tmp_path, text, more, expected):
    scene = write(text or TABLE, more)
    if text is None:
        (tmp_path / "jets.csv").unlink()
    with pytest.raises(UsageError) as caught:
        dl.Docking(scene)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
