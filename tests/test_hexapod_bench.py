"""A ring on six legs against a reference motion that was computed independently.

``data/hexapod_bench_reference.json``: 51 samples over 5 s of another program (tolerance 1e-13).
"""

import json
from pathlib import Path

import numpy as np
import pytest

REFERENCE = json.loads((Path(__file__).parent / "data/hexapod_bench_reference.json").read_text())


@pytest.fixture(scope="module")
def run(runs):
    """The benchmark at the tolerances of its scene."""
    return runs.run("hexapod_bench")


def test_the_ring_follows_the_reference_to_a_tenth_of_a_nanometre(run):
    assert run["time"] == pytest.approx(REFERENCE["t"])
    error = run.vector("ring.position") - np.array(REFERENCE["p"])
    assert np.max(np.linalg.norm(error, axis=1)) < 1e-10


def test_its_attitude_follows_too(run):
    ours, theirs = run.vector("ring.attitude"), np.array(REFERENCE["q"])
    theirs = theirs * np.sign(np.sum(ours * theirs, axis=1))[:, None]
    assert np.max(np.abs(ours - theirs)) < 1e-10


def test_velocities_follow_too(run):
    for name, key in (("ring.velocity", "v"), ("ring.angular_velocity", "w")):
        assert np.max(np.abs(run.vector(name) - np.array(REFERENCE[key]))) < 1e-9


def test_legs_report_length_rate_and_force_of_their_law(run):
    length, rate = run["leg[1].length"], run["leg[1].rate"]
    home = np.hypot(0.4, np.hypot(*np.subtract(
        0.65 * np.array([np.cos(np.radians(-6)), np.sin(np.radians(-6))]),
        0.60 * np.array([np.cos(np.radians(-54)), np.sin(np.radians(-54))]),
    )))  # fmt: skip
    expected = -2000.0 * (length - home) - 150.0 * rate
    assert run["leg[1].force"] == pytest.approx(expected, abs=1e-9)


def test_loops_stay_closed_and_energy_adds_up(run):
    assert np.max(run["solver.closure_residual"]) < 1e-12
    energy = run["energy.kinetic"][0] + run["energy.potential"][0]
    assert np.max(np.abs(run["energy.residual"])) < 1e-8 * energy
