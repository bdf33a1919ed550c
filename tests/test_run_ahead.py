"""Linearly implicit steps that end after the communication point, as a host sees them.

1. Loads and motion read at points inside steps are as good as those at their ends, and the same for
   any communication step; energy and momentum hold.
2. A change of an input or of a parameter acts from its communication point on, not earlier.
3. What is read changes nothing.
"""

import numpy as np
import pytest

from dockloop.docking import Docking, Scene

STOP = 6.0  # s; contact, capture, and most of the attenuation


@pytest.fixture(scope="module")
def scene():
    """A docking that begins just before contact."""
    return Scene("idss_25t_350t", {"initial.approach_time": 0.1})


def make(scene, method, rtol):
    """Return a docking whose mechanism is always integrated."""
    docking = Docking(scene)
    docking.set("solver.method", method)
    docking.set("model.flight", 2)
    docking.set("solver.rtol", rtol)
    for name in ("position", "velocity"):
        docking.set(f"solver.atol_{name}", 1e-2 * rtol)
    docking.set("solver.atol_energy", 0.1 * rtol)
    return docking


def follow(docking, h, act=lambda docking, i: None):
    """Return loads, motion and energy residual every 0.25 s."""
    samples = []
    for i in range(round(STOP / h)):
        act(docking, i)
        docking.step(h)
        if (i + 1) % round(0.25 / h) == 0:
            names = ("capture.force", "relative.position", "relative.velocity", "energy.residual")
            samples.append(np.concatenate([np.atleast_1d(docking.get(n)) for n in names]))
    return np.array(samples)


@pytest.mark.parametrize(("rtol", "force", "place"), [(1e-3, 3.0, 2e-5), (1e-4, 0.5, 2e-6)])
def test_what_is_read_inside_steps_is_as_good_as_at_their_ends(scene, rtol, force, place):
    exact = follow(make(scene, 2, 1e-9), 0.25)
    fine = make(scene, 12, rtol)
    found = follow(fine, 0.01)
    error = np.abs(found - exact)
    assert fine.get("captured")
    assert error[:, :3].max() < force  # N, of loads up to 1 kN
    assert error[:, 3:6].max() < place
    assert np.abs(found[:, 9]).max() < 10 * rtol
    assert fine.get("momentum.residual") < 1e-13
    coarse = make(scene, 12, rtol)
    other = follow(coarse, 0.25)
    assert np.allclose(other, found, rtol=1e-6, atol=1e-7)
    for name in ("solver.rhs_evaluations", "solver.steps"):
        assert coarse.get(name) == fine.get(name)
    assert coarse.get("time_of_capture") == pytest.approx(fine.get("time_of_capture"), abs=1e-12)


@pytest.mark.parametrize("name", ["friction.coefficient", "chaser.force_ext"])
def test_a_change_acts_from_its_communication_point_on(scene, name):
    value = 0.3 if name == "friction.coefficient" else [0.0, 500.0, 0.0]

    def act(docking, i):
        if i == 137:
            docking.set(name, value)

    exact = follow(make(scene, 2, 1e-9), 0.01, act)
    found = follow(make(scene, 12, 1e-4), 0.01, act)
    late = follow(make(scene, 2, 1e-9), 0.01, lambda docking, i: act(docking, i - 1))
    error, delay = (np.abs(x - exact)[:, 3:9].max() for x in (found, late))
    assert error < 0.2 * delay


def test_reading_changes_nothing(scene):
    silent, read = make(scene, 12, 1e-3), make(scene, 12, 1e-3)
    for _ in range(400):
        silent.step(0.01)
        read.step(0.01)
        read.get("capture.force")
        read.get("momentum.residual")
        read.get("chaser.force_mean")
    for name in read.variables:
        assert silent.get(name) == read.get(name), name
