"""Gears, screws and drives through the FMU, and other coordinates on a vehicle that floats.

1. A joint driven at constant speed follows the time; the vehicle recoils so that momentum stays,
   and the work of the drive closes the balance of energy.
2. A screw between slide and rotor swings like the mass that it reflects, exactly.
3. The force of a leg holds what its screw transmits: it does all the work on the ring.
4. Two slider-cranks on a floating vehicle, their sliders independent, run through their dead
   centres (their coordinates change several times): motion, momentum and energy are those of the
   cranks.
5. Coupling tables that make no sense are refused in one sentence.
"""

import copy
import json
import math

import numpy as np
import pytest

from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.scene.mechanism import check_mechanism
from extreme_cases import mechanism_benchmarks as benchmarks
from extreme_cases.own_mechanism import FIXED_BASE, write_scene

FREE_BASE = FIXED_BASE.replace("fixed", "free").replace("mass = 1000", "mass = 20")
GROUPS = '[outputs]\ngroups = ["ring", "states", "energy", "solver"]'


def move(runs, folder, mechanism, *sections, stop=1.0, step=0.1, settings=()):
    """Run a mechanism; returns the recording."""
    experiment = f"[experiment]\nstop = {stop}\nstep = {step}"
    return runs.run(
        write_scene(folder, mechanism, *sections, experiment, GROUPS), settings=settings
    )


def test_a_driven_crank_follows_the_time_and_its_work_closes_the_balance(runs, tmp_path):
    mechanism = benchmarks.slider_crank()
    mechanism["couplings"] = [
        {"name": "motor", "dependent": "crank", "rate": 5.0, "offset": math.pi / 2}
    ]
    # Something that swings, so that there is more to it than kinematics.
    mechanism["bodies"].append(
        {
            "name": "pendulum",
            "parent": "slider",
            "joint": {"type": "revolute", "axis": [0, 0, 1]},
            "mass": 0.5,
            "com": [0, -0.2, 0],
            "inertia": [[0, 0, 0], [0, 0, 0], [0, 0, 1e-3]],
        }
    )
    mechanism["home_q"].append(0.0)
    run = move(runs, tmp_path, mechanism, FREE_BASE, stop=2.0)
    angle = math.pi / 2 + 5.0 * run["time"]
    slider = 0.1 * np.cos(angle) + np.sqrt(0.09 - (0.1 * np.sin(angle)) ** 2)
    assert np.max(np.abs(run["ring.position[1]"] - slider)) < 1e-14
    assert np.max(run["momentum.residual"]) < 1e-12
    assert np.max(np.abs(run["chaser.velocity[1]"])) > 1e-3  # it does recoil
    assert np.ptp(run["energy.kinetic"]) > 0.02  # the motor works, both ways
    assert np.max(np.abs(run["energy.residual"])) < 1e-9


def test_a_screw_swings_like_the_mass_that_it_reflects(runs, tmp_path):
    lead, mass, rotor, stiffness = 0.02, 2.0, 4e-5, 500.0
    ratio = 2 * math.pi / lead
    mechanism = {
        "name": "screw",
        "bodies": [
            {
                "name": "slide",
                "parent": "base",
                "joint": {"type": "prismatic", "axis": [1, 0, 0]},
                "mass": mass,
            },
            {
                "name": "rotor",
                "parent": "slide",
                "joint": {"type": "revolute", "axis": [1, 0, 0]},
                "inertia": [[rotor, 0, 0], [0, 1e-5, 0], [0, 0, 1e-5]],
            },
        ],
        "couplings": [
            {
                "name": "thread",
                "dependent": "rotor",
                "terms": [{"joint": "slide", "ratio": ratio}],
            }
        ],
        "forces": [
            {
                "type": "joint_spring_damper",
                "joint": "slide",
                "stiffness": stiffness,
                "damping": 0,
            }
        ],
        "capture": {"body": "slide"},
    }
    start = "[initial.joints.slide]\nposition = 0.05"
    run = move(runs, tmp_path, mechanism, FIXED_BASE, start, stop=3.0)
    frequency = math.sqrt(stiffness / (mass + rotor * ratio**2))
    exact = 0.05 * np.cos(frequency * run["time"])
    assert np.max(np.abs(run["state.q[1]"] - exact)) < 1e-11


def test_the_force_of_a_leg_holds_what_its_screw_transmits(runs, tmp_path):
    """Legs all but without mass: what they exert along themselves is all that moves the ring."""
    file = paths.MECHANISMS / "hexapod_bench.json"
    mechanism = json.loads(file.read_text(encoding="utf-8"))
    rotor, lead, light = 6e-5, 0.02, {"mass": 1e-6, "com": 0.1, "inertia_transverse": 1e-9}
    light["inertia_axial"] = 1e-9
    reflected = rotor * (2 * math.pi / lead) ** 2  # kg, a seventh of the ring per leg
    mechanism["leg_defaults"] |= {"cylinder": light, "rod": light}
    names = [leg["name"] for leg in mechanism["legs"]]
    for name in names:
        mechanism["bodies"].append(
            {
                "name": f"{name}_rotor",
                "parent": "base",
                "joint": {"type": "revolute", "axis": [1, 0, 0]},
                "inertia": [[rotor, 0, 0], [0, 0.5 * rotor, 0], [0, 0, 0.5 * rotor]],
            }
        )
    mechanism["couplings"] = [
        {
            "name": f"{name}_screw",
            "dependent": f"{name}_rotor",
            "terms": [{"joint": f"{name}_rod", "ratio": 2 * math.pi / lead}],
        }
        for name in names
    ]
    start = "[initial.capture_body]\ndisplacement = [0, 0, -0.05]"
    groups = GROUPS.replace('"ring"', '"ring", "legs"')
    run = runs.run(
        write_scene(
            tmp_path,
            mechanism,
            FIXED_BASE,
            start,
            "[experiment]\nstop = 0.4\nstep = 0.002",
            groups,
        )
    )
    count = range(1, len(names) + 1)
    power = sum(run[f"leg[{i}].force"] * run[f"leg[{i}].rate"] for i in count)
    work = np.concatenate(([0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * 0.002)))
    moved = 0.5 * 30.0 * run["ring.velocity[3]"] ** 2
    assert np.max(moved) > 1.0  # J
    assert np.max(np.abs(work - moved)) < 1e-3 * np.max(moved)
    springs = -2000 * (run["leg[1].length"] - run["leg[1].length"][0]) - 150 * run["leg[1].rate"]
    assert reflected > 5.0
    assert np.max(np.abs(run["leg[1].force"] - springs)) > 20.0  # N, by the rotors


def two_slider_cranks(independent):
    """Two slider-cranks side by side, the second one turned and heavier."""
    first, second = (benchmarks.slider_crank(independent) for _ in range(2))
    renamed = json.loads(
        json.dumps(second)
        .replace('"crank"', '"crank2"')
        .replace('"rod"', '"rod2"')
        .replace('"slider"', '"slider2"')
        .replace('"pin"', '"pin2"')
    )
    for body in renamed["bodies"]:
        body["mass"] = 1.7 * body["mass"]
        if body["parent"] == "base":
            body["joint"]["position"] = [0.1, -0.3, 0.2]
    first["bodies"] += renamed["bodies"]
    first["loops"] += renamed["loops"]
    first["home_q"] += renamed["home_q"]
    return first


def start_slider_cranks(independent, crank_rates):
    """Sections that start both; a crank at the top moves its slider by -0.1 m per radian."""
    factor = 1.0 if independent == "crank" else -0.1
    return [
        f"[initial.joints.{independent}{suffix}]\nrate = {factor * rate!r}"
        for suffix, rate in zip(("", "2"), crank_rates, strict=True)
    ]


def test_coordinates_change_on_a_floating_vehicle_and_nothing_else_does(runs, tmp_path):
    results = {}
    for independent in ("crank", "slider"):
        folder = tmp_path / independent
        folder.mkdir()
        sections = [FREE_BASE, *start_slider_cranks(independent, (9.0, -7.0))]
        results[independent] = move(
            runs, folder, two_slider_cranks(independent), *sections, stop=2.0
        )
    cranks, sliders = results["crank"], results["slider"]
    # Both coordinates of the sliders turn back several times on the way.
    assert abs(cranks["state.q[1]"][-1] - cranks["state.q[1]"][0]) > 4 * math.pi
    for name in ("chaser.position", "chaser.velocity", "chaser.angular_velocity", "ring.position"):
        difference = np.max(np.abs(sliders.vector(name) - cranks.vector(name)))
        assert difference < 1e-8, f"{name}: {difference}"
    assert np.max(sliders["momentum.residual"]) < 1e-12
    scale = np.max(cranks["energy.kinetic"])
    assert np.max(np.abs(sliders["energy.residual"])) < 1e-8 * scale


def geared_five_bar():
    """Two cranks whose tips two links join at a pin; a gear turns the cranks against each other.

    At home the cranks stand at 60 and 120 deg. Whichever joint is independent at the start meets a
    pose where it stops being so.
    """
    crank, link = (1.0, (0.1, 0), 5e-3), (0.5, (0.2, 0), 8e-3)
    a, throw, length, half = math.pi / 3, 0.2, 0.6, 0.25
    tip = -half + throw * math.cos(a), throw * math.sin(a)
    slope = math.acos(-tip[0] / length)
    return {
        "name": "five_bar",
        "bodies": [
            benchmarks.planar_body("A", "base", (-half, 0), crank),
            benchmarks.planar_body("B", "base", (half, 0), crank),
            benchmarks.planar_body("linkA", "A", (throw, 0), link),
            benchmarks.planar_body("linkB", "B", (throw, 0), link),
        ],
        "loops": [
            benchmarks.planar_loop(
                "pin", ("A", "linkA"), "linkB", ["linkA", "linkB"], ((length, 0), (length, 0))
            )
        ],
        "couplings": [
            {
                "name": "gear",
                "dependent": "A",
                "offset": math.pi,
                "terms": [{"joint": "B", "ratio": -1.0}],
            }
        ],
        "home_q": [a, math.pi - a, slope - a, a - slope],
        "capture": {"body": "linkA"},
    }


@pytest.mark.parametrize("step", [0.01, 0.5])
def test_a_geared_linkage_changes_its_coordinates_and_goes_on(runs, tmp_path, step):
    run = move(
        runs, tmp_path, geared_five_bar(), FIXED_BASE, "[initial.joints.B]\nrate = 2.0",
        stop=4.0, step=step, settings=("gravity[2]=-9.81",),
    )  # fmt: skip
    # The pin moves on the line of symmetry only.
    assert np.max(np.abs(run["energy.residual"])) < 1e-8
    assert np.max(run["solver.closure_residual"]) < 1e-13
    assert np.ptp(run["ring.position[2]"]) > 0.1


def test_gears_that_say_the_same_twice_are_one_gear(tmp_path):
    body = {"joint": {"type": "revolute", "axis": [0, 0, 1]}, "mass": 1}
    inertia = {"inertia": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
    mechanism = {
        "name": "twice",
        "bodies": [{"name": name, "parent": "base", **body, **inertia} for name in "ab"],
        "couplings": [
            {"name": "one", "dependent": "a", "terms": [{"joint": "b", "ratio": 2.0}]},
            {"name": "two", "dependent": "b", "terms": [{"joint": "a", "ratio": 0.5}]},
        ],
    }
    path, states = tmp_path / "own.json", tmp_path / "states.json"
    path.write_text(json.dumps(mechanism))
    report = check_mechanism(str(path))
    assert report["degrees_of_freedom"] == 1
    assert "rank 1" in " ".join(report["warnings"])
    free = report["independent"] == ["a"]
    q = [3.0, 0.0] if free else [0.0, 1.5]
    state = {"q": q, "v_independent": [2.0 if free else 1.0], "tau": [4.0, 2.0]}
    states.write_text(json.dumps({"states": [state]}))
    result = check_mechanism(str(path), states)[0]
    assert result["q"] == pytest.approx([3.0, 1.5])
    assert result["v"] == pytest.approx([2.0, 1.0])
    # 1 + 1/4 kg m2 seen from a, driven by 4 + 2/2 N m.
    assert result["a"] == pytest.approx([4.0, 2.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"terms": [{"joint": "rotr", "ratio": 2}]}, ["motor", "rotr"]),
        ({"terms": [{"joint": "crank", "ratio": 2}]}, ["motor", "itself"]),
        ({"dependent": "rod"}, ["'rod'", "already determined", "pin"]),
        ({"rate": "fast"}, ["couplings", "rate"]),
        ({"ratio": 2}, ["couplings", "ratio"]),
    ],
)
def test_couplings_that_make_no_sense_are_refused(tmp_path, change, words):
    mechanism = copy.deepcopy(benchmarks.slider_crank())
    mechanism["couplings"] = [{"name": "motor", "dependent": "crank", "rate": 1.0} | change]
    path = tmp_path / "own.json"
    path.write_text(json.dumps(mechanism))
    with pytest.raises(UsageError) as error:
        check_mechanism(str(path))
    text = str(error.value)
    assert "\n" not in text
    for word in ["own.json", *words]:
        assert word in text
