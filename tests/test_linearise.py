"""Linear models of a docking: ``dl.linearise`` and ``dockloop linearise``.

1. Poles are those of two masses with a spring and a damper, by hand.
2. A step of the linear model is a step of the docking, up to second order.
3. All matrices are what central differences through the FMI give (`test_derivatives.py` has the
   same derivatives in contact, with latches and with thrust).
4. A family in hard dock moves as one rigid body, on the springs of faces and hooks.
5. The interface is that of springs and dampers in closed form; slow poles stay, zeros are exact.
6. The command writes the same matrices, and poles and Bode data that follow from them.
"""

import json

import numpy as np
import pytest
from scipy.linalg import expm

import dockloop as dl
from extreme_cases.fmi_host import Host
from test_derivatives import Jacobian

DAMPING = 2000.0
DECAY = {"mechanism.set.contact.damping": DAMPING}


@pytest.fixture(scope="module")
def pressed():
    """The absorber in contact: linear while it is pressed."""
    return dl.linearise("absorber_1d", 0.2, DECAY)


def test_poles_are_those_of_two_masses_with_spring_and_damper(pressed):
    contact = dl.Scene("absorber_1d", DECAY).document["mechanism"]["contact"]
    reduced = 25e3 * 350e3 / (25e3 + 350e3)
    omega = np.sqrt(contact["stiffness"] / reduced)
    frequency, damping = pressed.oscillations[0]  # slower ones turn the vehicles under the force
    assert frequency == pytest.approx(omega / (2 * np.pi), rel=1e-9)
    assert damping == pytest.approx(DAMPING / (2 * reduced * omega), rel=1e-9)


def test_a_step_of_the_linear_model_is_one_of_the_docking(pressed):
    """Two dockings that differ by a small force differ as the linear model says."""
    h, force, ends = 0.05, 1.0, []
    for value in (0.0, force):
        docking = dl.Docking("absorber_1d", DECAY)
        docking.step(0.2)
        docking.set("chaser.force_ext", [value, 0.0, 0.0])
        docking.step(h)
        ends.append([docking.get("relative.axial"), docking.get("capture.compression")])
    column = pressed.inputs.index("chaser.force_ext[1]")
    n = len(pressed.states)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = pressed.A, pressed.B[:, column]
    change = expm(h * block)[:n, n] * force
    names = ("relative.axial", "capture.compression")
    for name, found in zip(names, np.subtract(ends[1], ends[0]), strict=True):
        row = pressed.outputs.index(name)
        expected = pressed.C[row] @ change + pressed.D[row, column] * force
        assert found == pytest.approx(expected, rel=1e-4), name


def test_the_response_to_slow_and_fast_forces_is_that_of_masses(pressed):
    """Fast: the chaser alone moves, x = -F / (m w^2)."""
    frequency = 1e3
    (found,) = pressed.find_response("chaser.position[1]", "chaser.force_ext[1]", [frequency])
    assert found == pytest.approx(-1.0 / (25e3 * (2 * np.pi * frequency) ** 2), rel=1e-5)


def test_instants_and_what_is_refused():
    model = dl.linearise("idss_25t_350t", "capture", {"initial.approach_time": 0.2})
    run = dl.run("idss_25t_350t", {"initial.approach_time": 0.2}, stop=4.0)
    assert 0.0 <= model.time - run["time_of_capture"][-1] <= run.time[1] + 1e-9
    assert all(damping > 0.0 for _, damping in model.oscillations)
    with pytest.raises(dl.UsageError, match="did you mean 'capture'"):
        dl.linearise("absorber_1d", "captur")
    with pytest.raises(dl.UsageError, match="does not come to 'capture' until its stop at 5 s"):
        dl.linearise("absorber_1d", "capture")
    with pytest.raises(dl.UsageError, match="has a driven vehicle"):
        dl.linearise("absorber_1d", 0.0, {"chaser.motion": "driven"})
    with pytest.raises(dl.UsageError, match=r"at is -1\.0: must be a time from 0 s on"):
        dl.linearise("absorber_1d", -1.0)
    model = dl.linearise("absorber_1d", 0.0)
    with pytest.raises(
        dl.UsageError, match=r"no 'relative\.axia' \(did you mean 'relative\.axial'"
    ):
        model.find_response("relative.axia", "chaser.force_ext[1]", [1.0])


GRAVITY = tuple(f"gravity[{i}]" for i in (1, 2, 3))
APART = {"initial.approach_time": 0.5}


@pytest.mark.parametrize(
    ("scene", "overrides", "left_out"),
    [
        ("hexapod_bench", {}, ()),
        ("idss_25t_350t", APART, GRAVITY),  # free vehicles fall together
        ("idss_25t_350t", APART | {"target.motion": "fixed"}, ()),
    ],
)
def test_matrices_are_those_of_central_differences(runs, scene, overrides, left_out):
    model = dl.linearise(scene, 0.0, overrides)
    rows = [f"der({name})" for name in model.states] + model.outputs
    columns = model.states + model.inputs
    matrix = np.block([[model.A, model.B], [model.C, model.D]])
    fmu = runs.fmu(scene, *(f"{name}={value}" for name, value in overrides.items()))
    with Host(fmu, exchange=True) as host:
        host.start_exchange()
        jacobian = Jacobian(host, left_out)
        assert {*rows} == {n for n in jacobian.unknowns if not n.startswith("capture.peak")}
        assert {*columns} == {*jacobian.knowns}
        jacobian.unknowns = rows
        by_group, _ = jacobian.errors(matrix[:, [columns.index(n) for n in jacobian.knowns]])
    assert max(by_group.values()) < 1e-6, by_group


@pytest.fixture(scope="module")
def docked():
    """A family in hard dock."""
    later = {"experiment.stop": 200.0, "experiment.step": 0.5}
    return dl.linearise("apda", "hard_docked", later)


def test_a_family_in_hard_dock_is_one_body_on_faces_and_hooks(docked):
    model = docked
    mass, document = model.docking.get("stack.mass"), model.docking.scene.document
    slow = 0.01  # Hz, far below the slowest bending
    force = "chaser.force_ext[1]"
    (found,) = model.find_response("chaser.position[1]", force, [slow])
    assert found == pytest.approx(-1.0 / (mass * (2 * np.pi * slow) ** 2), rel=1e-4)
    interface = document["mechanism"]["interface"]
    hooks, faces = interface["hooks"], interface["faces"]
    stiffness = faces["stiffness"] + 12 * hooks["stiffness"]  # the ring adds 1 %
    chaser, target = (model.docking.get(f"{v}.mass") for v in ("chaser", "target"))
    (found,) = model.find_response("relative.axial", force, [1.0])
    assert abs(found) == pytest.approx(target / (chaser + target) / stiffness, rel=0.02)
    assert all(damping > 0.0 for _, damping in model.oscillations)


def test_the_command_writes_matrices_poles_and_bode_data(dockloop, tmp_path, pressed):
    order = ["linearise", "absorber_1d", "--at", "0.2", "-o", "own.json"]
    order += [f"--scene={name}={value}" for name, value in DECAY.items()]
    words, printed = dockloop(*order), dockloop(*order, "--json")
    assert words.status == printed.status == 0, words.err
    found = json.loads(printed.out)
    assert found == json.loads((tmp_path / "own.json").read_text())
    assert [found[name] for name in "ABCD"] == [getattr(pressed, name).tolist() for name in "ABCD"]
    for kind in ("states", "inputs", "outputs"):
        assert [entry["name"] for entry in found[kind]] == getattr(pressed, kind)
    assert {"name": "chaser.torque_ext[1]", "unit": "N.m"} in found["inputs"]
    assert found["phase"] == "contact"
    assert found["stack"]["mass"] == 375e3
    first = found["poles"][0]  # two masses, a spring, a damper
    chaser, target = 25e3, 350e3
    rate = DAMPING / (2 * chaser * target / (chaser + target))
    assert first["time_constant"] == pytest.approx(1.0 / rate, rel=1e-9)
    omega = 2 * np.pi * first["frequency"]
    assert first["damping_ratio"] == pytest.approx(rate / omega, rel=1e-9)
    bode = found["bode"]
    assert (bode["input"], bode["output"]) == ("chaser.force_ext[1]", "relative.axial")
    assert bode["unit"] == "m/N"
    at = bode["frequency"].index(first["frequency"])
    assert bode["magnitude"][at] == pytest.approx(1.0 / (chaser * 2 * rate * omega), rel=1e-9)
    assert bode["phase"][at] % 360.0 == pytest.approx(90.0, abs=1e-6)  # 90 deg late, and shortening
    for text in (f"  {first['frequency']:.4g} ", "stack.mass ", " m/N", "own.json, own.png"):
        assert text in words.out
    assert (tmp_path / "own.png").stat().st_size > 1000


def test_the_interface_is_that_of_spring_and_damper(pressed):
    contact = dl.Scene("absorber_1d", DECAY).document["mechanism"]["contact"]
    stiffness, damping = np.zeros((6, 6)), np.zeros((6, 6))
    stiffness[0, 0], damping[0, 0] = contact["stiffness"], DAMPING
    # The force acts at P: a displacement across gives it a moment about the place where P was.
    force = pressed.docking.get("capture.force")[0]
    stiffness[4, 2], stiffness[5, 1] = -force, force
    assert pressed.stiffness == pytest.approx(stiffness, abs=1e-9 * contact["stiffness"])
    assert pressed.damping == pytest.approx(damping, abs=1e-9 * DAMPING)


def test_the_interface_of_a_hard_dock_is_that_of_faces_and_hooks(docked):
    interface = docked.docking.scene.document["mechanism"]["interface"]
    faces, hooks = interface["faces"], interface["hooks"]
    count = sum(row["count"] for row in hooks["rows"])
    axial = faces["stiffness"] + count * hooks["stiffness"]
    rings = ((faces["stiffness"], faces["radius"]), (count * hooks["stiffness"], hooks["radius"]))
    bending = sum(k * radius**2 / 2 for k, radius in rings)
    found = np.diag(docked.stiffness)
    # Next to them the ring: 2.2 % along the axis, 0.02 % in bending.
    assert axial < found[0] < 1.03 * axial
    assert found[4:] == pytest.approx([bending, bending], rel=2e-3)
    # Nothing resists shear: each vehicle turns about its centre of mass, and the slowest poles are
    # those of two inertias on one spring, about y and z.
    inverse = sum(1.0 / docked.docking.get(f"{v}.inertia")[1] for v in ("chaser", "target"))
    slowest = sorted(abs(pole) for pole in docked.moving if pole.imag > 1.0)[:2]
    assert slowest == pytest.approx([np.sqrt(bending * inverse)] * 2, rel=5e-3)


def test_slow_poles_stay_and_zeros_are_exact():
    """A slow oscillator next to a fast one, and free bodies in chains of zeros."""
    from dockloop.runs.linear import _find_poles

    slow, fast, mass = 1e-4, 1e5, 3e5
    blocks = [np.array([[0.0, 1.0 / mass], [-(rate**2) * mass, 0.0]]) for rate in (slow, fast)] + [
        np.array([[0.0, 1.0 / mass, 0.0], [0.0, 0.0, 0.0], [7.0, 3.0, 0.0]])
    ]
    matrix = np.zeros((7, 7))
    for block, at in zip(blocks, (0, 2, 4), strict=True):
        matrix[at : at + len(block), at : at + len(block)] = block
    mix = np.linalg.qr(np.random.default_rng(1).normal(size=(7, 7)))[0]
    found = np.sort(np.abs(_find_poles(mix @ np.diag([1.0] * 7) @ mix.T @ matrix)))
    assert found == pytest.approx([0, 0, 0, slow, slow, fast, fast], rel=1e-6)


@pytest.mark.parametrize("frequency", [0.0, -1.0, np.nan, np.inf, "1"])
def test_a_bad_frequency_is_refused(pressed, frequency):
    with pytest.raises(dl.UsageError, match="find_response: a frequency is"):
        pressed.find_response("chaser.position[1]", "chaser.force_ext[1]", [1.0, frequency])


@pytest.mark.parametrize("scene", ["idss_25t_350t", "hexapod_bench"])
def test_what_the_command_prints_fits_a_page(dockloop, scene):
    outcome = dockloop.succeed("linearise", scene, "--at", "0.1")
    assert max(map(len, outcome.out.splitlines())) <= 100
    assert f"build/results/{scene}/{scene}_linear.png" in outcome.out


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--bode", "chaser.force_ext[4]", "gap"], "no 'chaser.force_ext[4]'"),
        (["--bode", "chaser.force_ext[1]", "gap[2]"], "no 'gap[2]'"),
        (["--scene", "chaser.motion=driven"], "has a driven vehicle"),
    ],
)
def test_what_no_model_can_have_is_refused_before_the_first_step(dockloop, monkeypatch, more, text):
    def step(*_):
        raise AssertionError("a step was made")

    monkeypatch.setattr(dl.Docking, "step", step)
    outcome = dockloop("linearise", "idss_25t_350t", "--at", "capture", *more)
    assert (outcome.status, text in outcome.err) == (2, True), outcome


def test_the_command_says_what_is_wrong(dockloop):
    for more, text in (
        (["--at", "hard_dock"], "--at is 'hard_dock': must be a time or capture, hard_docked (did"),
        (["--at", "-1"], "--at is -1.0: must be a time from 0 s on"),
        (
            ["--at", "0", "--bode", "chaser.force_ext[4]", "gap"],
            "no 'chaser.force_ext[4]' (did you mean 'chaser.force_ext[",
        ),
        (["--at", "capture"], "until its stop at 5 s: choose a later one (experiment.stop)"),
        (["--at", "0", "--set", "chaser.mass"], "--set chaser.mass: must be NAME=VALUE"),
    ):
        outcome = dockloop("linearise", "absorber_1d", *more)
        assert outcome.status == 2, outcome
        assert text in outcome.err
