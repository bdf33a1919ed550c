"""Lengths by which outcomes are judged follow the size of the contact hardware."""

import json

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.native.core import number_choice

SCENE = """
[chaser]
mass = 400
inertia = [80, 90, 90, 0, 0, 0]
interface_position = [0.5, 0, 0]
[target]
mass = 800
inertia = [200, 250, 250, 0, 0, 0]
interface_position = [-1, 0, 0]
[mechanism]
name = "rigid_ring"
[initial]
at = "first_contact"
approach_time = 0.1
closing_speed = 0.02
[experiment]
stop = 10.0
step = 0.01
[outputs]
groups = ["relative", "phase", "contact"]
"""
LENGTHS = ("core_x", "core_inner_radius", "core_outer_radius", "ring_rounding", "node_radius")
PETALS = ("rounding", "base_x", "base_radius", "tip_x", "tip_distance", "tip_half_width")


@pytest.fixture
def scene(tmp_path):
    """A guide ring of so many times the shipped size, fixed on the chaser, without latches."""

    def write(scale):
        mechanism = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text())
        for part in ("bodies", "legs", "leg_defaults", "capture", "latches"):
            del mechanism[part]
        for name in (*LENGTHS, *(f"petal_{part}" for part in PETALS)):
            mechanism["contact"][name] *= scale
        (tmp_path / "rigid_ring.json").write_text(json.dumps(mechanism))
        file = tmp_path / "own.toml"
        file.write_text(SCENE)
        return file

    return write


def find_rebound_gap(run):
    """Return the gaps of the samples before and at which the outcome is a rebound [m]."""
    first = np.flatnonzero(run["outcome"] == number_choice("outcome", "rebound"))[0]
    return run["gap"][first - 1], run["gap"][first]


@pytest.mark.parametrize(
    ("scale", "keys", "gap"),
    [
        (1.0, {}, 0.05),
        (2.0, {}, 0.05),
        (0.1, {}, 0.005),
        (0.1, {"phases.rebound_gap": 0.02}, 0.02),
        (1.0, {"phases.rebound_gap": 0.01}, 0.01),
    ],
)
def test_a_rebound_is_judged_by_the_size_of_the_ring(scene, scale, keys, gap):
    before, after = find_rebound_gap(dl.run(scene(scale), keys))
    share = 1.15 if scale < 1.0 and not keys else 1.0  # the petals stand out of the ring
    assert before <= share * gap + 1e-6
    assert after >= gap - 2e-6
