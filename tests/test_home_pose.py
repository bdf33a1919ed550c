"""A home pose as read off a drawing is closed; the oracle is the triangle of a four-bar."""

import json
import math

import pytest

import dockloop as dl

CRANK, COUPLER, ROCKER, GROUND, ANGLE = 0.4, 0.9, 0.7, 1.0, 1.0  # m, rad


def find_pose(rocker):
    """Return crank, coupler and rocker angle [rad] with the rocker held: law of cosines."""
    x, y = GROUND + ROCKER * math.cos(rocker), ROCKER * math.sin(rocker)
    reach = math.hypot(x, y)
    beta = math.acos((CRANK**2 + reach**2 - COUPLER**2) / (2 * CRANK * reach))
    crank = math.atan2(y, x) + beta
    coupler = math.atan2(y - CRANK * math.sin(crank), x - CRANK * math.cos(crank))
    return [crank, coupler - crank, rocker]


def make_bar(name, parent, position, length):
    inertia = [[1e-4, 0, 0], [0, length**2 / 12, 0], [0, 0, length**2 / 12]]
    joint = {"type": "revolute", "axis": [0, 0, 1], "position": position}
    return {
        "name": name,
        "parent": parent,
        "mass": 1,
        "com": [length / 2, 0, 0],
        "inertia": inertia,
        "joint": joint,
    }


def make_four_bar(home, closure=None):
    cut = {
        "type": "R1_planar",
        "point_on_terminal": [COUPLER, 0, 0],
        "point_on_closing": [ROCKER, 0, 0],
        "plane_axes_in_root": [[1, 0, 0], [0, 1, 0]],
    }
    loop = {
        "name": "loop",
        "root": "base",
        "first": "crank",
        "terminal": "coupler",
        "closing": "rocker",
        "dependent": ["crank", "coupler"],
        "cut": cut,
        "closure": closure,
    }
    bodies = [
        make_bar("crank", "base", [0, 0, 0], CRANK),
        make_bar("coupler", "crank", [CRANK, 0, 0], COUPLER),
        make_bar("rocker", "base", [GROUND, 0, 0], ROCKER),
    ]
    return {"name": "fourbar", "bodies": bodies, "loops": [loop], "home_q": home}


EXACT = find_pose(1.9)


@pytest.mark.parametrize("closure", [None, "newton"])
@pytest.mark.parametrize("digits", [2, 3, 4, 5])
def test_a_rounded_home_is_closed_with_the_independent_joint_held(closure, digits):
    guess = [round(q, digits) for q in EXACT]
    report = dl.check(make_four_bar(guess, closure))
    assert report["home_q"] == pytest.approx(find_pose(guess[2]), abs=1e-13)
    assert report["home_q"][2] == guess[2]
    (moved, pose) = report["warnings"]
    most = max(
        zip(report["home_q"], guess, ("crank", "coupler"), strict=False),
        key=lambda m: abs(m[0] - m[1]),
    )
    assert f"at the stated home; it was closed from there: '{most[2]}' moved by" in moved
    assert f"{most[0] - most[1]:.3g} rad" in moved
    # The pose as printed is exact: no guess any more.
    printed = json.loads(pose.partition('"home_q": ')[2])
    assert printed == report["home_q"]
    again = dl.check(make_four_bar(printed, closure))
    assert again["home_q"] == pytest.approx(printed, abs=1e-15)
    assert again["warnings"] == []


def test_an_exact_home_is_no_guess():
    report = dl.check(make_four_bar(EXACT))
    assert report["home_q"] == pytest.approx(EXACT, abs=1e-15)
    assert report["warnings"] == []


def test_a_home_that_is_far_open_is_refused_with_its_loop_and_the_limit():
    with pytest.raises(dl.UsageError, match=r"'loop' is open by 0\.304\d+ m .*\(limit 0\.013 m\)"):
        dl.check(make_four_bar([EXACT[0] + 0.3, *EXACT[1:]]))
