"""``dockloop extremes --random``: whole scenes over many decades, each with a verdict.

1. A scene is drawn alike every time; draws stay in their ranges and reach all methods and levels.
2. Some scenes of the plain suite are right or refused, none is wrong, hung or crashed; with the
   label long 200 of them.
3. A bad case is made simpler, stays bad, and its command repeats it; the summary counts it and the
   command fails.
4. A right run is not wrong because its reference solution, at longer steps, misses a peak.
5. A stroke that a run shows only at an end which is not determined is not wrong either.
6. An energy audit that is off by little is loose if a tighter tolerance mends it.
"""

import itertools
import json
import math
from collections import Counter

import numpy as np
import pytest

from dockloop.base.sections import write_markdown
from dockloop.native.core import list_methods
from dockloop.result.recording import Result
from dockloop.result.run_errors import find_errors
from dockloop.runs import judging
from dockloop.runs.judging import BAD, VERDICTS, Case, Verdict, judge
from dockloop.studies.extremes import random_report, random_scenes
from dockloop.studies.extremes.random_scenes import (
    Drawn,
    Outcome,
    draw_scene,
    list_ranges,
    run_random,
)

SEED, FEW, MANY = 11, 8, 200


def test_scenes_are_drawn_alike_and_in_their_ranges():
    cases = [draw_scene(SEED, number) for number in range(1, 400)]
    assert cases[:5] == [draw_scene(SEED, number) for number in range(1, 6)]
    for case in cases:
        for name, where in list_ranges(case.scene).items():
            value = case.overrides[name]
            is_cut = name == "initial.approach_time"  # of scenes of few steps
            assert where.low * (0.0 if is_cut else 1.0) <= value <= where.high or value == 0.0
            assert value > 0.0 or where.zero > 0.0
        xx, yy, zz, *_ = case.overrides["chaser.inertia"]
        assert max(xx, yy, zz) <= (1.0 + 1e-12) * (xx + yy + zz) / 2.0
        assert case.overrides["experiment.stop"] > case.overrides["experiment.start"]
    drawn = {case.overrides["solver.method"] for case in cases}
    assert drawn == {method["name"] for method in list_methods()}
    levels = Counter(case.overrides["model.level"] for case in cases)
    assert set(levels) == {"rigid", "massless_legs", "reduced", "reference"}
    assert {case.scene for case in cases} == set(random_scenes.BASES)


def check(outcome, count):
    """Check that no scene is bad and that scenes really ran."""
    tally = Counter(drawn.verdict.verdict for drawn in outcome.drawn)
    assert sum(tally.values()) == count
    bad = [d for d in outcome.drawn if d.verdict.verdict in BAD]
    assert not bad, [(d.number, d.verdict.reason, d.case.make_command()) for d in bad]
    assert tally["right"] > count // 5
    assert tally["slow"] <= count // 20
    for drawn in outcome.drawn:
        if drawn.verdict.verdict == "refused":
            assert len(drawn.verdict.reason.split()) >= 3
        else:
            assert drawn.verdict.evaluations > 0 or drawn.verdict.verdict == "slow"


def test_some_random_scenes_are_right_or_refused():
    check(run_random(FEW, SEED), FEW)


@pytest.mark.long
def test_many_random_scenes_are_right_or_refused():
    check(run_random(MANY, SEED + 1), MANY)


class BadAbove:
    """A crew that calls every scene wrong whose chaser is heavier than 1 t."""

    def __init__(self):
        self.asked = 0

    def ask(self, case):
        self.asked += 1
        is_bad = case.overrides.get("chaser.mass", 25e3) > 1e3
        return Verdict("wrong" if is_bad else "right", "mass")


def test_a_bad_case_is_made_simpler_and_stays_bad():
    number = next(n for n in range(1, 99) if draw_scene(1, n).overrides["chaser.mass"] > 1e5)
    case, judges = draw_scene(1, number), BadAbove()
    simpler, verdict = random_scenes.shrink(judges, case, Verdict("wrong", "mass"))
    assert verdict.verdict == "wrong"
    assert len(simpler.overrides) < len(case.overrides) / 2
    assert simpler.overrides.get("chaser.mass", 25e3) > 1e3
    assert 0 < judges.asked <= 24


def test_a_summary_counts_and_names_what_is_bad():
    case = Case("absorber_1d", {"chaser.mass": 3.0})
    outcome = Outcome(5, 60.0)
    outcome.drawn = [
        Drawn(1, case, Verdict("right", error=1e-4, energy=1e-6, momentum=1e-15)),
        Drawn(2, case, Verdict("refused", "chaser.mass is 3: must be more")),
        Drawn(3, case, Verdict("crashed", "died by SIGSEGV"), (case, Verdict("crashed", "died"))),
    ]
    summary = random_report.summarise(outcome)
    assert {name: summary[name] for name in VERDICTS if summary[name]} == {
        "right": 1,
        "refused": 1,
        "crashed": 1,
    }
    assert summary["bad"][0]["repeat"] == "dockloop extremes --random 1 --seed 5 --first 3"
    assert summary["bad"][0]["simpler"] == "dockloop run absorber_1d --scene chaser.mass=3.0"
    assert math.isclose(summary["largest_error"]["value"], 1e-4)
    page = write_markdown(random_report.complete_report(summary, "dockloop extremes"))
    assert "| crashed | 1 |" in page
    bad = "# crashed: died by SIGSEGV\ndockloop extremes --random 1 --seed 5 --first 3\n"
    assert bad + "# simpler: died\ndockloop run absorber_1d --scene chaser.mass=3.0\n" in page
    assert json.loads(json.dumps(summary)) == summary


def test_the_command_counts_resumes_and_fails_when_a_scene_is_bad(dockloop, tmp_path, monkeypatch):
    words = ("extremes", "--random", "2", "--seed", "4", "--workers", "1", "-o", str(tmp_path))
    reported = dockloop.succeed(*words, "--json")
    counts = json.loads(reported.out.splitlines()[-1])
    assert sum(counts[name] for name in VERDICTS) == counts["scenes"] == 2
    before = (tmp_path / "random.md").read_text()
    again = dockloop.succeed(*words, "--resume")
    assert "right" in again.out
    assert (tmp_path / "random.md").read_text() == before
    bad = Drawn(1, Case("absorber_1d"), Verdict("hung", "no end"))
    monkeypatch.setattr(random_report, "run_random", lambda *_, **__: Outcome(4, 60.0, [bad]))
    failed = dockloop(*words)
    assert failed.status == 1
    assert "1 of 1 scenes are bad" in failed.err
    assert "hung: no end" in failed.out


BENT_PEAK = {  # shear has its peak at a bend between two steps; everything else is smooth
    "initial.closing_speed": 0.03816,
    "initial.approach_time": 0.004737,
    "initial.lateral_offset": 0.0003321,
    "initial.lateral_direction_deg": 41.1,
    "initial.pitch_yaw_deg": 0.002533,
    "initial.pitch_yaw_direction_deg": 89.96,
    "initial.pitch_yaw_rate_deg_s": 0.01187,
    "initial.pitch_yaw_rate_direction_deg": 213.4,
    "initial.roll_rate_deg_s": 0.07135,
    "contact.stiffness": 2426.0,
    "contact.node_stiffness": 6.088e6,
    "contact.friction_coefficient": 0.02721,
    "model.level": "rigid",
    "solver.method": "rosenbrock",
    "solver.rtol": 3e-11,
    "solver.atol_position": 3e-13,
    "solver.atol_velocity": 3e-13,
    "solver.atol_energy": 3e-12,
}

SLOW_ABSORBER = {  # what a light chaser at 0.17 mm/s brings is 2e5 absolute tolerances
    "chaser.mass": 1334.0,
    "chaser.inertia": [4709.5, 5387.4, 973.0, 0.0, 0.0, 0.0],
    "target.mass": 195700.0,
    "initial.closing_speed": 0.0001715,
    "initial.approach_time": 0.02424,
    "experiment.step": 0.01452,
    "experiment.stop": 1.5383451,
}
MOTION = [
    *(f"{name}[{i}]" for name in ("position", "velocity", "angular_velocity") for i in (1, 2, 3)),
    *(f"attitude[{i}]" for i in (1, 2, 3, 4)),
]


def test_a_peak_that_a_reference_solution_misses_is_not_determined():
    verdict = judge(Case("apda", BENT_PEAK, stop=0.2063))
    assert verdict.verdict in ("right", "undetermined"), verdict


def make_result(times, places, **others):
    """Make a run of a ring that moves along x."""
    columns = {"time": times, "ring.position[1]": places, "outcome": np.zeros(len(times))}
    columns |= {f"ring.position[{i}]": np.zeros(len(times)) for i in (2, 3)}
    columns |= {f"relative.{name}": np.zeros(len(times)) for name in MOTION} | others
    return Result({}, list(columns), [""] * len(columns), np.array(list(columns.values())).T)


def test_neighbours_are_compared_where_the_run_has_points(monkeypatch):
    """They agree on the stroke, which lies between the two points of the run, but on no end."""
    times = np.linspace(0.0, 1.0, 11)

    def move_to(end):
        return make_result(times, np.append(np.where(times[:-1] == 0.5, 1.0, 0.0), end))

    ends = itertools.count(1)
    solution = move_to(0.2)
    monkeypatch.setattr(
        judging,
        "_find_reference",
        lambda _, shift: move_to(0.05 * next(ends)) if shift else solution,
    )
    run = make_result(times[[0, -1]], np.array([0.0, 0.3]))
    verdict = judging._compare(Case("any", wanted=1e-3), run, Verdict("right"))
    assert verdict.verdict == "undetermined", verdict
    assert find_errors(solution, solution)["stroke"] == 0.0


def test_an_energy_audit_that_a_tighter_tolerance_mends_is_loose():
    """332 evaluations, and a residual of 1.2 times the absolute tolerances that it may have."""
    verdict = judge(Case("absorber_1d", SLOW_ABSORBER))
    assert verdict.verdict == "loose", verdict
    assert "energy.residual" in verdict.reason
    assert "right with solver.rtol 1e-12" in verdict.reason
