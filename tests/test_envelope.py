"""``dockloop envelope``: the boundary of criteria in two or three quantities.

1. Criteria: every form has its meaning, for a docking that captures and one that does not; bad ones
   are refused in one sentence, and nothing of a text is executed.
2. The mesh finds the boundary of closed forms in the plane and in space: every bracket holds it,
   area and volume are right within what is stated, with a fraction of the points of a grid; a check
   finds an island.
3. Dockings: latches that the energy of the approach must push open have a boundary in closed form,
   sqrt(2 W / m): every docking is on the right side of it, the boundary is right within 1 %.
4. Interrupted and resumed: the same tables, no docking twice; other criteria need no new ones; a
   point runs alone to the values of its row.
5. Bad usage is refused before a docking runs.
"""

import csv
import itertools
import json
import math
import shlex
import sys

import numpy as np
import pytest

import dockloop as dl
from dockloop.result.criteria import parse_criterion
from dockloop.studies.envelopes.mesh import Mesh
from pawls import FORCE, SPEED, STRAIGHT, find_area, find_speed
from programs import run

SCENE = "idss_25t_350t"


@pytest.fixture(scope="module")
def outputs():
    variables = dl.Docking(SCENE).variables.values()
    return {v.name: v for v in variables if v.causality == "output"}


# ---------------------------------------------------------------- criteria

END = {
    "captured": 1,
    "outcome": 2,
    "phase": 5,
    "time_of_contact": 2.0,
    "time_of_capture": 3.5,
    "capture.peak.load_ratio": 0.8,
    "capture.peak.shear": 250.0,
    "capture.peak.bending": 1000.0,
    "relative.axial": -0.01,
    "latched[2]": 1,
    "leg[1].force": 40.0,
    "initial.closing_speed": 0.1,
}
NOT_CAPTURED = {**END, "captured": 0, "outcome": 4, "time_of_capture": -1.0}
MEANINGS = {  # criterion: met by END, met by NOT_CAPTURED
    "captured": (True, False),
    "not captured": (False, True),
    "captured within 1.6 s": (True, False),
    "captured within 1.4 s": (False, False),
    "captured within 2": (True, False),
    "not captured within 1.4 s": (True, True),
    "contact within 1.9 s": (False, False),
    "contact within 2 s and not rebound": (True, False),
    "rebound": (False, True),
    "miss or rebound": (False, True),
    "captured within 5 s and load_ratio < 1": (True, False),
    "load_ratio<0.8": (False, False),
    "load_ratio <= 0.8": (True, True),
    "0.5 < load_ratio < 1": (True, True),
    "0.5 < load_ratio < 0.7": (False, False),
    "capture.peak.shear == 250": (True, True),
    "shear != 250": (False, False),
    "max(shear, bending / 2) >= 500": (True, True),
    "abs(relative.axial) < 0.02 and -relative.axial > 0": (True, True),
    "latched[2] and leg[1].force > 39": (True, True),
    'outcome == "captured"': (True, False),
    'phase != "aligned"': (False, False),
    'phase == "hard_docked" or outcome == 4': (False, True),
    "time_of_capture < 4": (True, False),
    "time_of_capture > 1e9": (False, True),
    "time_of_capture - time_of_contact < 2": (True, False),
    "captured and (shear > 300 or initial.closing_speed * 1000 == 100)": (True, False),
    "1 / (time_of_contact - 2) > 0": (False, False),
}


@pytest.mark.parametrize("text", MEANINGS)
def test_a_criterion_means_what_it_says(outputs, text):
    criterion = parse_criterion(text, outputs, ["initial.closing_speed"])
    assert (criterion.holds(END), criterion.holds(NOT_CAPTURED)) == MEANINGS[text]
    needed = {name: END[name] for name in criterion.outputs}
    assert criterion.holds({**needed, "initial.closing_speed": 0.1}) == MEANINGS[text][0]


BAD_CRITERIA = {
    "": "must have 1 to 500 characters",
    "captured within": "'within' needs an event and a time",
    "shear within 5 s": "'shear' has no time: 'within' takes one of captured, contact",
    "capturedd": "there is no 'capturedd' (did you mean 'captured'",
    "load_ratio": "is a number, no condition: compare it, e.g. load_ratio < 1",
    "captured and load_ratio": "'load_ratio' is a number, no condition: compare it",
    "captured < 3": "'captured' is a condition and cannot be compared",
    "load_ratio = 1": "cannot be read at '= 1': write comparisons (<, <=,",
    "captured && miss": "cannot be read at",
    'outcome == "capturedd"': "'outcome' is never 'capturedd' (did you mean 'captured'?)",
    "outcome < 3": "a choice is compared with one of its names, by == or !=",
    "__import__('os').system('true') == 0": "has no place in a criterion",
    "captured if miss else rebound": "has no place in a criterion",
    "(lambda: captured)()": "has no place in a criterion",
    "load_ratio ** 2 < 1": "'load_ratio ** 2' has no place in a criterion",
    "min(shear) < 1": "min() has 1 numbers in it",
    "-" * 490 + "1 > 0": "cannot be read: it is nested too deeply",
    "captured or " * 50 + "captured": "must have 1 to 500 characters",
    "captured\x00": "cannot be read",
}


@pytest.mark.parametrize("text", BAD_CRITERIA)
def test_a_bad_criterion_is_refused(outputs, text):
    with pytest.raises(dl.UsageError) as refusal:
        parse_criterion(text, outputs)
    assert BAD_CRITERIA[text] in str(refusal.value)
    assert f"--criterion '{text}'" in str(refusal.value)


# ---------------------------------------------------------------- mesh


def refine(mesh: Mesh, criteria, known=None) -> dict:
    """Run functions of points in the unit box instead of dockings."""
    known = {} if known is None else known
    while True:
        for point in mesh.list_missing(known):
            where = [coordinate / mesh.size for coordinate in point]
            known[point] = tuple(bool(criterion(*where)) for criterion in criteria)
        if not mesh.split(known):
            return known


def circle(x, y):
    return math.hypot(x - 0.45, y - 0.55) < 0.3


def test_two_criteria_of_the_plane_share_their_points():
    mesh = Mesh(2, 8, 4)
    criteria = (circle, lambda x, y: y > 0.3 + 0.4 * x)
    known = refine(mesh, criteria)
    for number, exact in enumerate((math.pi * 0.09, 0.5)):
        area, unsure = mesh.measure(known, number)
        assert abs(area - exact) < unsure < 0.02
        brackets = mesh.list_brackets(known, number)
        for inside, outside in brackets:
            assert sum(abs(a - b) for a, b in zip(inside, outside, strict=True)) == 1
            assert criteria[number](*(c / mesh.size for c in inside))
            assert not criteria[number](*(c / mesh.size for c in outside))
    everywhere = itertools.pairwise(
        [(i, j) for i in range(mesh.size) for j in range(mesh.size + 1)]
    )
    crossed = [
        pair
        for pair in everywhere
        if pair[0][0] == pair[1][0]
        and circle(*(c / mesh.size for c in pair[0])) != circle(*(c / mesh.size for c in pair[1]))
    ]
    vertical = [b for b in mesh.list_brackets(known, 0) if b.inside[0] == b.outside[0]]
    assert len(vertical) == len(crossed)  # a full grid finds no more
    assert (mesh.size + 1) ** 2 > 6 * len(known)


def test_a_ball_in_space_is_found_with_a_fraction_of_the_grid():
    mesh = Mesh(3, 4, 3)
    known = refine(mesh, [lambda x, y, z: math.dist((x, y, z), (0.5, 0.5, 0.5)) < 0.4])
    volume, unsure = mesh.measure(known, 0)
    assert abs(volume - 4 / 3 * math.pi * 0.064) < unsure < 0.1
    assert 3.0 * len(known) < (mesh.size + 1) ** 3


def test_a_check_finds_an_island_and_it_is_refined():
    def island(x, y):
        return math.hypot(x - 0.3125, y - 0.6875) < 0.05  # in the middle of a coarse cell

    mesh = Mesh(2, 8, 3)
    known = refine(mesh, [island])
    assert mesh.measure(known, 0)[0] == 0.0  # missed
    points = mesh.draw_checks(known, 400, seed=1)
    assert points == mesh.draw_checks(known, 400, seed=1)
    assert len(points) == len(set(points)) == 400
    surprises = [p for p in points if island(*(c / mesh.size for c in p))]
    assert surprises
    assert all(mesh.predict(p, known) == (False,) for p in points)
    known |= {p: (p in surprises,) for p in points}
    known = refine(mesh, [island], known)
    area, unsure = mesh.measure(known, 0)
    assert abs(area - math.pi * 0.0025) < unsure


# ---------------------------------------------------------------- dockings

COMMAND = [
    *("envelope", SCENE, "--x", *map(str, SPEED), "--y", *map(str, FORCE)),
    *("--stop", "8", "--step", "1"),
    *(word for name, value in STRAIGHT.items() for word in ("--scene", f"{name}={value}")),
]

CAPTURED = ("--criterion", "captured")


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The boundary that is known, with the tolerance of 1 %."""
    folder = tmp_path_factory.mktemp("envelope")
    done = run(sys.executable, "-m", "dockloop", *COMMAND, *CAPTURED, "-o", folder)
    assert done.returncode == 0, done
    return folder, done


def test_a_capture_boundary_is_the_known_one_within_a_percent(written):
    folder, done = written
    points, boundary = read(folder / "points.csv"), read(folder / "boundary.csv")
    summary = json.loads((folder / "summary.json").read_text())
    for row in points:
        speed, force = float(row[SPEED[0]]), float(row[FORCE[0]])
        captured = row["captured"] == "True"
        assert captured == (speed > find_speed(force)), row
    rows = [row for row in boundary if row["criterion"] == "captured"]
    speeds = np.array([float(row[SPEED[0]]) for row in rows])
    known = find_speed(np.array([float(row[FORCE[0]]) for row in rows]))
    along = np.array([row["along"] == SPEED[0] for row in rows])
    assert along.any()
    assert not along.all()
    errors = np.abs(speeds - known) / (SPEED[2] - SPEED[1])
    assert errors[along].max() <= 0.5 / summary["cells"] < 0.01, errors.max()
    assert np.ptp(known) > 0.9 * (SPEED[2] - SPEED[1])
    (found,) = summary["criteria"]
    assert abs(found["met"] - find_area()) < found["unsure"] < 0.02
    assert summary["grid_over_dockings"] >= 5.0, summary["dockings"]
    assert summary["dockings"] == len(points)
    assert summary["checks"] == {"points": 16, "differ": 0}
    assert (folder / "envelope.png").stat().st_size > 1e4
    assert f"{found['met']:.1%} +- {found['unsure']:.1%}" in done.stdout
    assert f"{len(points)} dockings so far" in done.stderr


def test_the_command_of_a_point_runs_it_alone(dockloop, written, tmp_path):
    folder, _ = written
    rows = [row for row in read(folder / "points.csv") if row["captured"] == "True"]
    row = rows[len(rows) // 2]
    words = shlex.split(row["command"])[1:]
    summary = dockloop.read(*words, "-o", str(tmp_path / "alone.csv"), "--no-plots", "--json")
    assert summary["captured"]
    assert math.isclose(summary["time_of_capture"], float(row["time_of_capture"]), rel_tol=1e-9)
    peak = float(row["capture.peak.compression"])
    assert math.isclose(summary["peak_loads"]["compression"]["value"], peak, rel_tol=1e-6)


def test_an_interrupted_search_goes_on_and_other_criteria_share_its_runs(
    dockloop, written, tmp_path, monkeypatch
):
    finished, _ = written
    journal = (finished / "journal.jsonl").read_bytes().splitlines(keepends=True)
    torn = b"".join(journal[:-50]) + journal[-50][:40]
    (tmp_path / "journal.jsonl").write_bytes(torn)
    refused = dockloop(*COMMAND, *CAPTURED, "-o", str(tmp_path))
    assert refused.status == 2
    assert "go on with --resume" in refused.err
    dockloop.succeed(*COMMAND, *CAPTURED, "-o", str(tmp_path), "--resume")
    for name in ("points.csv", "boundary.csv"):
        assert (tmp_path / name).read_bytes() == (finished / name).read_bytes()
    ran = json.loads((tmp_path / "summary.json").read_text())["time"]["ran"]
    assert ran == 49  # the last line of a finished journal is no docking

    monkeypatch.setattr("dockloop.studies.envelopes.search.open_executor", None)  # nothing may run
    for criterion in ("load_ratio < 1 or not captured", "compression < 100"):  # of fewer outputs
        again = dockloop.succeed(
            *(*COMMAND, "--criterion", criterion, "--tolerance", "0.1"),
            *("-o", str(tmp_path), "--resume", "--json", "--check", "0", "--coarse", "4"),
        )
        assert json.loads(again.out)["time"]["ran"] == 0


def test_python_gives_tables_with_units():
    found = dl.envelope(
        SCENE,
        SPEED,
        ("chaser.mass", 5e3, 1e5),
        criteria="captured",
        overrides={**STRAIGHT, "mechanism.set.latches.push_force": 100.0},
        stop=8.0,
        step=1.0,
        log="y",
        tolerance=0.1,
        coarse=5,
        checks=4,
        workers=1,
    )
    assert found.points.attrs["units"]["chaser.mass"] == "kg"
    assert found.boundary.attrs["units"]["initial.closing_speed met"] == "m/s"
    mass = 350e3 * found.points["chaser.mass"] / (350e3 + found.points["chaser.mass"])
    known = found.points["initial.closing_speed"] > np.sqrt(2.0 * 2.4 / mass)
    assert (found.points["captured"] == known).all()
    ratios = np.unique(found.points["chaser.mass"])
    assert np.isclose(ratios[1:] / ratios[:-1], 20.0 ** (1 / 5), rtol=1e-9).any()
    assert found.summary["cells"] == 5
    assert found.plot() is not None


def test_three_quantities():
    found = dl.envelope(
        SCENE,
        SPEED,
        FORCE,
        ("chaser.mass", 2e4, 3e4),
        criteria=["captured", "rebound"],
        overrides=STRAIGHT,
        stop=8.0,
        step=1.0,
        tolerance=0.125,
        checks=0,
    )
    points = found.points
    mass = 350e3 * points["chaser.mass"] / (350e3 + points["chaser.mass"])
    energy = mass * points["initial.closing_speed"] ** 2 / 2.0
    assert (points["captured"] == (energy > 0.024 * points[FORCE[0]])).all()
    assert found.summary["grid"] == 125
    assert set(found.boundary["along"]) == {SPEED[0], FORCE[0], "chaser.mass"}
    assert found.plot() is not None


def test_what_cannot_run_meets_nothing_and_is_counted():
    found = dl.envelope(
        SCENE,
        ("initial.pitch_yaw_deg", 0.0, 40.0),  # from 30 deg on the scene refuses
        ("initial.closing_speed", 0.05, 0.1),
        criteria="time_of_contact >= 0",
        stop=0.5,
        step=0.5,
        tolerance=0.25,
        coarse=2,
        checks=0,
    )
    refused = found.points["initial.pitch_yaw_deg"] >= 30.0
    assert (found.points["status"] == np.where(refused, "refused", "done")).all()
    assert found.summary["status"]["refused"] == refused.sum() > 0
    assert "must be less than 30" in found.summary["reasons"][0]["reason"]
    assert "\nrefused" not in found.points.loc[refused, "command"].iloc[0]


def test_a_search_without_any_docking_leaves_room_for_the_next(dockloop, tmp_path):
    def search(*words):
        return dockloop(
            *("envelope", SCENE, "--x", "initial.pitch_yaw_deg", *words),
            *("--y", "initial.closing_speed", "0.05", "0.1", "--criterion", "time_of_contact >= 0"),
            *("--stop", "0.5", "--step", "0.5", "--tolerance", "0.25", "--coarse", "2"),
            *("--check", "0", "--no-plots", "-o", str(tmp_path / "own")),
        )

    refused = search("31", "40")
    assert refused.status == 2, refused
    assert refused.err.endswith(
        "dockloop: no docking could be run, for example: --x initial.pitch_yaw_deg 31 40:"
        " initial.pitch_yaw_deg is 31.0: must be less than 30\n"
    )
    assert not (tmp_path / "own").exists()
    found = search("0", "10")
    assert found.status == 0, found
    resumed = search("31", "40", "--resume")  # does not take the results above with it
    assert resumed.status == 2, resumed
    again = search("0", "10", "--resume", "--json")
    assert again.status == 0, again
    assert json.loads(again.out)["time"]["ran"] == 0


@pytest.mark.parametrize(
    ("words", "guilty"),
    [
        (("chaser.inertia.3", "1e9", "2e9"), "--x chaser.inertia.3 1e+09 2e+09"),
        (
            ("chaser.mass", "1e4", "2e4", "--set", "chaser.inertia.3=1e9"),
            "--set chaser.inertia.3=1e9",
        ),
    ],
)
def test_a_refusal_of_every_start_begins_with_the_option_to_blame(
    dockloop, tmp_path, words, guilty
):
    refused = dockloop(
        *("envelope", "absorber_1d", "--x", *words),
        *("--y", "initial.closing_speed", "0.05", "0.1", "--criterion", "time_of_contact >= 0"),
        *("--stop", "0.5", "--step", "0.5", "--coarse", "2", "-o", str(tmp_path / "own")),
    )
    assert refused.status == 2, refused
    assert f"{guilty}: chaser.inertia has the principal moments" in refused.err
    assert not (tmp_path / "own").exists()


BAD_USAGE = {
    "range": ([*COMMAND[:3], SPEED[0], "0.2", "0.1"], "--x initial.closing_speed 0.2 0.1: must"),
    "number": ([*COMMAND[:3], SPEED[0], "a", "0.1"], "must be NAME LOW HIGH, two numbers"),
    "name": ([*COMMAND[:3], "initial.closing_sped", "0.1", "0.2"], "mean 'initial.closing_speed'"),
    "twice": ([*COMMAND[:3], FORCE[0], "1", "2"], "--y mechanism.set.latches.push_force: this qu"),
    "tolerance": (
        [*COMMAND[:6], "--tolerance", "0.9"],
        "0.9: must be 0.000125 to 0.25",
    ),
    "log": ([*COMMAND[:6], "--log", "z"], "--log z: 'z' must be one of x, y"),
    "log range": ([*COMMAND[:3], "initial.roll_deg", "-1", "1", "--log", "x"], "must be above 0"),
    "coarse": ([*COMMAND[:6], "--coarse", "1"], "--coarse 1: must be 2 to 1024"),
    "negative": ([*COMMAND[:3], "initial.roll_deg", "-1e-3", "-2e-3"], "_deg -0.001 -0.002: must"),
    "infinite": ([*COMMAND[:6], "--criterion", "compression < 1e400"], "must be below 1e308"),
    "before": ([*COMMAND[:6], "--criterion", "captured within -1 s"], "must be at least 0 s"),
    "criterion": ([*COMMAND[:6], "--criterion", "capture"], "did you mean 'captured'"),
}


@pytest.mark.parametrize("case", BAD_USAGE)
def test_bad_usage_is_refused_before_a_docking_runs(dockloop, tmp_path, monkeypatch, case):
    monkeypatch.setattr("dockloop.studies.envelopes.search.open_executor", None)
    arguments, words = BAD_USAGE[case]
    more = ("--y", *map(str, FORCE), "--criterion", "captured", "-o", str(tmp_path / "own"))
    refused = dockloop(*arguments, *more)
    assert (refused.status, refused.err.count("\n")) == (2, 1), refused
    assert words in refused.err


@pytest.mark.long
def test_the_boundary_of_the_default_scene_needs_a_fifth_of_a_grid():
    found = dl.envelope(
        SCENE,
        ("initial.lateral_offset", 0.0, 0.2),
        ("initial.closing_speed", 0.01, 0.15),
        criteria="captured within 2 s",
        stop=4.25,
        step=0.5,
    )
    summary = found.summary
    assert summary["grid"] == 65**2
    assert summary["grid_over_dockings"] > 5.0, summary["dockings"]
    assert summary["uncertainty"] < 0.01
    (criterion,) = summary["criteria"]
    assert 0.3 < criterion["met"] < 0.5
    # Faster approaches capture sooner, from any offset: the boundary has one speed for each offset.
    rows = found.boundary[found.boundary["along"] == "initial.closing_speed"]
    assert rows["initial.lateral_offset"].is_unique
    assert len(rows) > 50
