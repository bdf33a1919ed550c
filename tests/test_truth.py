"""The reference solution: runs with 32 digits against exact, independent and ordinary results.

Digits beyond double are the subject of tests/unit/truth_test.cpp; here is what reaches a user.
"""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from dockloop.base.errors import UsageError
from dockloop.runs.solution import make_solution

REFERENCE = json.loads((Path(__file__).parent / "data/hexapod_bench_reference.json").read_text())
AXES = ("1", "2", "3")


def test_absorber_has_all_digits_of_its_closed_form():
    """Undamped: x = v0/w sin(w t) until the return after 1.7 s."""
    undamped = ["mechanism.set.contact.damping=0.0"]
    solution = make_solution(
        "absorber_1d", ["relative.axial"], overrides=undamped, stop=1.5, step=0.125
    )
    w = math.sqrt(20e3 * 375e3 / (25e3 * 350e3))
    start = solution["output"]["relative.axial"][0]
    exact = start - 0.1 / w * np.sin(w * np.array(solution["time"]))
    error = np.max(np.abs(exact - solution["output"]["relative.axial"]))
    assert error <= 3e-17, error  # of 0.1 m


def test_hexapod_agrees_with_the_reference_and_with_less_tolerance():
    outputs = [f"ring.{what}[{i}]" for what in ("position", "velocity") for i in AXES]
    solution = make_solution("hexapod_bench", outputs, check=True)
    for what, key in (("position", "p"), ("velocity", "v")):
        ours = np.array([solution["output"][f"ring.{what}[{i}]"] for i in AXES]).T
        error = np.max(np.abs(ours - np.array(REFERENCE[key])))
        assert error <= 1e-13, f"{what}: {error:.2g} from a reference of tolerance 1e-13"
    worst = max(solution["check"]["difference"].values())
    assert worst <= 3e-16, f"{worst:.2g} between tolerances 1e-18 and 1e-15"
    assert solution["work"]["evaluations"] < 10_000, solution["work"]


def test_an_ordinary_run_at_tight_tolerance_approaches_the_solution_of_a_docking(runs):
    """Contact after 2 s: kinks, sliding surfaces, end of the run in full contact."""
    outputs = [f"relative.position[{i}]" for i in AXES]
    solution = make_solution("idss_25t_350t", outputs, stop=2.1, step=0.35, tolerance=1e-15)
    errors = []
    for rtol in (1e-8, 1e-12):
        ratio = rtol / 1e-8
        settings = (
            f"solver.rtol={rtol!r}",
            f"solver.atol_position={1e-10 * ratio!r}",
            f"solver.atol_velocity={1e-10 * ratio!r}",
        )
        run = runs.run("idss_25t_350t", settings=settings, stop=2.1, step=0.35)
        ours = np.array([run[name] for name in outputs])
        theirs = np.array([solution["output"][name] for name in outputs])
        errors.append(np.max(np.abs(ours - theirs)))
    assert errors[1] <= 1e-13, errors  # measured 2e-14; 1e-13 at the looser tolerance
    assert errors[1] < 0.5 * errors[0], errors


def test_what_cannot_be_done_is_refused_in_one_sentence():
    with pytest.raises(UsageError, match=r"no variable 'relative\.sideways'"):
        make_solution("absorber_1d", ["relative.sideways"], stop=0.1, step=0.1)
    with pytest.raises(UsageError, match=r"chaser\.motion"):
        make_solution(
            "absorber_1d", ["gap"], overrides=["chaser.motion=driven"], stop=0.1, step=0.1
        )
    bad = "chaser.inertia=[1,1,9,0,0,0]"
    with pytest.raises(UsageError, match=rf"^--scene {re.escape(bad)}: chaser\.inertia has "):
        make_solution("absorber_1d", ["gap"], overrides=[bad], stop=0.1, step=0.1)
    with pytest.raises(UsageError, match=r"--tolerance must be from"):
        make_solution("absorber_1d", ["gap"], stop=0.1, step=0.1, tolerance=1e-40)
    with pytest.raises(UsageError, match=r"chaser\.mass=heavy"):
        make_solution("absorber_1d", ["gap"], settings=["chaser.mass=heavy"], stop=0.1, step=0.1)
