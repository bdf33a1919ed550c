"""``dockloop map`` and the verdicts it draws: right, refused, wrong and what lies between.

1. Verdicts: a run at an ordinary setting is right; a tolerance that is too wide is loose and the
   remedy is right; what the start refuses is refused; a wrong mass in a coupling is reported by a
   warning, the right mass is right; a figure on which neighbours disagree is undetermined.
2. A crew kills what hangs, reports what dies, and goes on with the next case.
3. The command refines where verdicts change, writes page, picture and table, resumes without a
   point twice, and every point runs alone.
"""

import csv
import json
import math
import os
import shlex
import signal
import sys
import time
from pathlib import Path

import pytest

from dockloop.cli import _make_parser
from dockloop.runs.crew import Crew
from dockloop.runs.judging import VERDICTS, Case, Verdict, find_promise, find_verdict, judge
from dockloop.studies.maps.command import _make_command
from programs import run

SCENE = "idss_25t_350t"
SHORT = {"initial.approach_time": 0.1}
MAP = (
    *(
        "map",
        "absorber_1d",
        "--x",
        "solver.step",
        "1e-4",
        "1",
        "--y",
        "experiment.step",
        "0.5",
        "2",
    ),
    *("--set", "solver.method=fixed_rk4", "--scene", "solver.rtol=1e-6", "--stop", "3"),
    *("--points", "5", "--workers", "1"),
)


# ---------------------------------------------------------------- verdicts


def judge_short(wanted=1e-3, stop=0.6, host="", **keys):
    """Judge a short docking with some keys of the scene changed."""
    settings = {name.replace("__", "."): value for name, value in keys.items()}
    return judge(Case(SCENE, SHORT | settings, stop=stop, wanted=wanted, host=host))


def test_an_ordinary_run_is_right_with_its_figures():
    verdict = judge_short()
    assert (verdict.verdict, verdict.audited) == ("right", False)
    assert 0.0 < verdict.error < 1e-3
    assert verdict.momentum < 1e-12
    assert verdict.evaluations > 100


def test_a_tolerance_that_is_too_wide_is_loose_and_its_remedy_is_right():
    verdict = judge_short(wanted=1e-5, solver__rtol=1e-2)
    assert verdict.verdict == "loose", verdict
    assert verdict.error > 1e-5
    name, value = verdict.reason.rpartition("right with ")[2].split()
    assert name == "solver.rtol"
    share = float(value) / 1e-2
    atol = {"solver.atol_position": 1e-8 * share, "solver.atol_velocity": 1e-8 * share}
    cured = Case(SCENE, SHORT | {name: float(value)} | atol, stop=0.6, wanted=1e-5)
    assert judge(cured).verdict == "right"


def test_what_the_start_refuses_is_refused_with_its_reason():
    verdict = judge_short(solver__method="adams")
    assert verdict.verdict == "refused"
    assert "a method for comparison" in verdict.reason
    assert judge_short(initial__closing_speed=0.0).verdict == "refused"


def test_a_wrong_mass_in_a_coupling_is_off_and_reported():
    right = judge_short(host="chaser", stop=1.0, wanted=1e-2, experiment__step=0.02)
    assert right.verdict == "right", right
    off = judge_short(host="chaser", stop=1.0, wanted=1e-3, experiment__step=0.04, chaser__mass=4e3)
    assert off.verdict == "warned", off
    assert "chaser.mass is 4000 kg" in off.reason


@pytest.mark.parametrize(
    ("overrides", "host"),
    [
        ({"chaser.mass": 2500.0, "experiment.step": 0.3}, "chaser"),  # a tenth: units may be wrong
        ({"chaser.mass": 2.5e5, "experiment.step": 0.3}, "chaser"),  # as a load that is not known
        (
            {
                "mechanism.set.leg_defaults.damping": 42.2,
                "solver.method": "fixed_rk4",
                "solver.step": 0.0075,
            },
            "",
        ),
    ],
)
def test_what_a_warning_of_any_kind_says_is_not_wrong(overrides, host):
    overrides = {"initial.approach_time": 0.2, **overrides}
    off = judge(Case(SCENE, overrides, stop=4.0 if host else 1.5, wanted=1e-2, host=host))
    assert off.verdict == "warned", off


def test_a_figure_on_which_neighbours_do_not_agree_is_undetermined():
    verdict = judge_short(wanted=1e-11)  # the start of the neighbours is 1e-9 away
    assert verdict.verdict == "undetermined", verdict
    assert "neighbours" in verdict.reason


def test_a_run_that_takes_too_long_is_slow():
    case = Case(SCENE, SHORT, {"solver.method": "fixed_rk4", "solver.step": 1e-6}, stop=5.0)
    verdict = judge(Case(**{**vars(case), "limit": 0.9}))
    assert verdict.verdict == "slow"
    assert "of the run are done" in verdict.reason


def test_a_verdict_survives_the_journal():
    verdict = Verdict("loose", "off", False, 0.1, math.nan, 1e-15, 7, 0.5)
    again = Verdict.from_result(verdict.to_result())
    assert repr(again) == repr(verdict)
    assert [find_promise(rtol) < 1.0 for rtol in (1e-2, 3e-3, 1e-12)] == [False, True, True]


# ---------------------------------------------------------------- processes


def act(case, note):
    """What the processes of a crew do in these tests."""
    if case == "hang":
        while True:
            pass
    if case == "sleep after a note":
        note("early")
        time.sleep(600.0)
    if case == "die":
        os.kill(os.getpid(), signal.SIGSEGV)
    return case


def test_a_crew_kills_what_hangs_reports_what_dies_and_goes_on():
    with Crew(act, 1) as crew:
        futures = [crew.begin(case, 1.0) for case in ("fine", "hang", "die", "again")]
        endings = [future.result() for future in futures]
        assert [ending.kind for ending in endings] == ["done", "hung", "crashed", "done"]
        assert "no end within 1 s" in endings[1].reason
        assert "SIGSEGV" in endings[2].reason
        assert (endings[0].value, endings[3].value) == ("fine", "again")
        noted = crew.begin("sleep after a note", 0.05).result()  # waits 20 times as long
        assert (noted.kind, noted.value) == ("hung", "early")


def test_an_ending_becomes_a_verdict():
    with Crew(act, 1) as crew:
        assert find_verdict(crew.begin("die", 9.0).result()).verdict == "crashed"
        known = crew.begin(Verdict("right"), 9.0).result()
        assert find_verdict(known).verdict == "right"
        late = known._replace(kind="hung")  # the run was there, its reference solution was not
        assert (find_verdict(late).verdict, find_verdict(late).audited) == ("right", True)


# ---------------------------------------------------------------- the command


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """A map of the absorber: fixed steps that are too long are off."""
    folder = tmp_path_factory.mktemp("map")
    ran = run(sys.executable, "-m", "dockloop", *MAP, "-o", folder, "--json")
    assert ran.returncode == 0, ran.stderr
    return folder, json.loads(ran.stdout), ran.stderr


def test_a_map_refines_where_verdicts_change(mapped):
    folder, summary, progress = mapped
    assert "points so far" in progress
    verdicts = summary["verdicts"]
    assert verdicts["right"] > 0
    assert verdicts["right"] < summary["points"] == sum(verdicts.values()) < summary["grid"]
    assert set(verdicts) == set(VERDICTS)
    with (folder / "points.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == summary["points"]
    fine = [row for row in rows if float(row["solver.step"]) < 1e-3]
    assert {row["verdict"] for row in fine} == {"right"}
    coarse = [row for row in rows if float(row["solver.step"]) == 1.0]
    assert "right" not in {row["verdict"] for row in coarse}
    assert all(float(row["evaluations"]) > 0 for row in fine)


def test_the_page_has_picture_table_and_command(mapped):
    folder, summary, _ = mapped
    page = (folder / "map.md").read_text()
    assert summary["command"] in page
    assert "](map.png)" in page
    assert (folder / "map.png").stat().st_size < 100_000
    assert f"| right | {summary['verdicts']['right']} |" in page
    assert "| experiment.step \\ solver.step |" in page


def test_a_map_resumes_without_a_point_twice(dockloop, mapped):
    folder, summary, _ = mapped
    before = (folder / "points.csv").read_text()
    again = dockloop.succeed(*MAP, "-o", str(folder), "--resume", "--json")
    assert json.loads(again.out)["time"]["ran"] == 0
    assert (folder / "points.csv").read_text() == before
    assert json.loads(again.out)["verdicts"] == summary["verdicts"]
    other = dockloop(*MAP, "-o", str(folder), "--resume", "--error", "0.5")
    assert other.status == 2, other
    assert "it was made with another error: delete the file" in other.err


def test_a_point_runs_alone(dockloop, mapped, tmp_path):
    folder, _, _ = mapped
    with (folder / "points.csv").open() as file:
        row = next(row for row in csv.DictReader(file) if row["verdict"] == "right")
    words = shlex.split(row["command"])
    assert words[:3] == ["dockloop", "run", "absorber_1d"]
    assert words[words.index("--step") + 1] == repr(float(row["experiment.step"]))
    dockloop.succeed(*words[1:], "-o", str(tmp_path / "r.csv"), "--no-plots", "--json")
    counted = json.loads(Path(tmp_path / "r_summary.json").read_text())
    assert counted["solver"]["rhs_evaluations"] == float(row["evaluations"])


def test_an_assured_map_says_of_which_points_it_is_sure(dockloop, tmp_path):
    words = ["map", "absorber_1d", "--x", "initial.closing_speed", "0.1", "0.2", "--stop", "2"]
    words += ["--y", "chaser.mass", "1e3", "2e3", "--points", "3", "--workers", "1", "--no-plots"]
    words += ["--assured", "--accuracy", "1e-3", "--scene", "solver.rtol=1e-6"]
    words += ["--scene", "solver.atol_position=1e-8", "--scene", "solver.atol_velocity=1e-8"]
    made = json.loads(dockloop.succeed(*words, "-o", str(tmp_path), "--json").out)
    assert made["assured"] is True
    assert made["assurance"]["cases"] == made["points"]
    with (tmp_path / "points.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["assured"] for row in rows} == {"yes"}
    assert all(float(row["price"]) > 1.0 for row in rows)
    assert all(row["command"].endswith(" --assured") for row in rows)
    again = dockloop.succeed(*words, "-o", str(tmp_path), "--resume", "--json")
    assert json.loads(again.out)["assurance"] == made["assurance"]


@pytest.mark.parametrize("accuracy", ["1e-3", "real-time"])
def test_the_command_of_a_map_has_all_digits_and_texts(accuracy):
    words = ["map", SCENE, "--x", "solver.rtol", "1e-9", "1e-2", "--y", "solver.step", "1e-4", "1"]
    words += [
        "--accuracy",
        accuracy,
        "--error",
        "0.01",
        "--points",
        "9",
        "--stop",
        "4.123456789",
        "--limit",
        "20.5",
    ]
    command = _make_command(_make_parser(words).parse_args(words))
    assert shlex.split(command) == ["dockloop", *words]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--x", "solver.rtol", "0", "1e-2"), "must be above 0 on a logarithmic axis"),
        (
            ("--x", "solver.rtoll", "1e-9", "1e-2"),
            "--x solver.rtoll 1e-09 0.01: is neither a key",
        ),
        (("--x", "solver.rtol", "1e-2", "1e-9"), "must be finite and ascend"),
        (("--error", "0"), "--error 0: must be greater than 0"),
        (("--points", "2"), "--points 2: must be 3 to 4001"),
        (("--points", "4002"), "--points 4002: must be 3 to 4001"),
        (("--scene", "outputs.groups=['energy']"), "add one of them to outputs.groups"),
        (("--limit", "nan"), "--limit: is nan: must be a finite number"),
    ],
)
def test_bad_usage_is_refused_in_one_sentence(dockloop, tmp_path, words, text):
    quantities = ("--x", "solver.rtol", "1e-9", "1e-2", "--y", "experiment.step", "0.1", "1")
    outcome = dockloop("map", SCENE, *quantities, *words, "-o", str(tmp_path))
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert text in outcome.err
