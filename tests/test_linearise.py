"""Linear models of a docking: ``dl.linearise``.

1. Poles are those of two masses with a spring and a damper, by hand.
2. A step of the linear model is a step of the docking, up to second order.
"""

import numpy as np
import pytest
from scipy.linalg import expm

import dockloop as dl

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
