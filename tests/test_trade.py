"""Speed against accuracy: are its errors the true ones, and does it recommend what pays.

1. Errors: those of the absorber are those against its closed form, those of the hexapod bench those
   against a reference of another program, between communication points too; a perturbed reference
   solution raises each figure by what it was perturbed by; another outcome has no error.
2. The reference solution: found once; of dockloop-compare when that knows it.
3. Rows: a refused setting is one with a reason; an interrupted trade goes on to the same rows; the
   default against itself costs its own time; the grid asks for what the FMU has.
4. Front, recommendation and verdicts on made-up rows.
5. --quick has every method of the product, all at the same steps; --apply writes the cheapest right
   setting into a copy of the scene, which runs with it, and replaces no file of the user.
"""

import csv
import json
import math
import re
import stat
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.native.core import list_different_methods, list_methods
from dockloop.result.recording import Result
from dockloop.result.run_errors import find_compared, find_error, find_scales
from dockloop.scene.copies import set_key
from dockloop.studies import trades
from dockloop.studies.trades import Choice, Setting, report
from dockloop.studies.trades.bench import Bench
from dockloop.studies.trades.columns import FIGURES, find_error_columns
from dockloop.studies.trades.solution import find_solution
from dockloop.sweeps.journal import InterruptedWorkError
from test_absorber import Exact

HEXAPOD = json.loads((Path(__file__).parent / "data/hexapod_bench_reference.json").read_text())
MEASURED = ("time_ratio", "time_ratio_of_best", "front_by_time")  # the rest repeats bit for bit


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """A folder for reference solutions and results of this file."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("build")
        patch.setattr(paths, "BUILD", folder)
        yield folder


@pytest.fixture(scope="module")
def absorber(runs, build):
    """The absorber of the scene (zeta = 0.3), which lets go when its force is zero."""
    return Bench(runs.comparing_fmu("absorber_1d"))


@pytest.fixture(scope="module")
def measured(absorber, build):
    """Its quick grid."""
    return trades.run_trade(absorber, Choice(quick=True), build / "absorber")


def done(rows):
    return [row for row in rows if row["status"] == "done"]


# ---------------------------------------------------------------- errors


def find_exact(t):
    """Position and velocity of P seen from A at t, and the largest force, in closed form."""
    exact = Exact(0.3)
    release = exact.time_of_release
    if t <= release:
        return -exact.position(t), -exact.speed(t)
    speed = -exact.speed(release)
    return -exact.position(release) + speed * (t - release), speed


def test_errors_of_the_absorber_are_those_against_its_closed_form(absorber, measured):
    """Every setting of the quick grid is run again here and compared without it."""
    exact = Exact(0.3)
    force = exact.force(exact.time_of_peak)
    settings = trades.make_settings(absorber, Choice(quick=True), absorber.stop)
    for row, setting in zip(measured.rows, settings, strict=True):
        if row["status"] != "done":
            continue
        run = absorber.run(setting.starts(absorber), absorber.stop, setting.step)
        there = np.array([find_exact(t) for t in run["time"]])
        moved = run["relative.position[1]"] - run["relative.position[1]"][0]
        looked_at = slice(None, None, round(0.1 / setting.step))
        apart = np.abs(moved - there[:, 0])
        scales = measured.about["scales"]
        position = apart[-1] / scales["final_position"]
        speed = abs(run["relative.velocity[1]"][-1] - there[-1, 1]) / scales["final_velocity"]
        peak = abs(run["capture.peak.compression"][-1] / force - 1.0)
        assert row["position_m"] == pytest.approx(np.max(apart[looked_at]), rel=1e-6, abs=1e-10)
        reported = (row["final_position"], row["final_velocity"], row["peaks"])
        # The reference solution is good to 1e-10 m, m/s and of the peak, or better.
        assert reported == pytest.approx((position, speed, peak), rel=1e-6, abs=1e-9), row[
            "setting"
        ]
        assert row["error"] == pytest.approx(max(reported), rel=1e-6, abs=1e-9), row["setting"]
    assert max(row["error"] for row in done(measured.rows)) > 1e-5
    assert measured.about["truth"]["error"] < 1e-9, measured.about["truth"]


def test_a_trade_from_python_returns_the_rows_of_the_command(runs, build):
    scene = dl.Scene("absorber_1d", {"initial.closing_speed": 0.08})
    table = dl.trade(scene, methods=["explicit"], tolerances=[1e-4, 1e-8], quick=True, stop=4.0)
    assert (table["status"] == "done").all()
    assert set(table["rtol"]) >= {1e-4, 1e-8}
    loose, tight = (table[table["rtol"] == rtol]["error"].min() for rtol in (1e-4, 1e-8))
    assert tight < loose
    summary = table.attrs["summary"]
    assert (summary["scene"], summary["stop"]) == ("absorber_1d", 4.0)
    assert any(entry["sentence"] for entry in summary["recommendations"])
    assert callable(dl.trade)  # also after the package of this name is imported


def test_the_quick_grid_of_the_hexapod_bench_from_the_command_line(dockloop, runs):
    """Positions against the reference of another program, files, and what was refused."""
    summary = dockloop.read(
        "trade", "hexapod_bench", "--quick", "--methods", "explicit,stabilised,dae", "--json"
    )
    folder = paths.BUILD / "results" / "trade_hexapod_bench"
    assert [Path(file).name for file in summary["files"]] == [
        "trade.csv",
        "trade.md",
        "work_precision.png",
    ]
    refused = [row for row in summary["rows"] if row["scheme"] == "rigid, explicit"]
    assert refused
    for row in refused:  # the ring is let go with a velocity
        assert row["status"] == "refused", row
        assert row["reason"].startswith("model.level is 1 (rigid), but the joint"), row["reason"]
        assert all(row[name] is None for name in FIGURES), row
    bench = Bench(runs.comparing_fmu("hexapod_bench"))
    reduced = [row for row in done(summary["rows"]) if row["level"] == 3]
    for row in reduced:
        starts = {"solver.method": row["method"], **bench.tolerances(row["rtol"])}
        if row["rtol"] > 1e-5:  # a run of its own to each point: its last step is a shorter one
            ends = [
                bench.run(starts, t, row["step"]).vector("ring.position")[-1]
                for t in HEXAPOD["t"][1:]
            ]
            error = np.max(np.linalg.norm(np.array(ends) - HEXAPOD["p"][1:], axis=1))
            assert row["position_m"] == pytest.approx(error, rel=1e-6, abs=2e-13), row["setting"]
        else:
            assert row["position_m"] < 0.1 * row["rtol"], row
        assert row["loop_gap_m"] < 1e-12, row
    assert len(reduced) == 1 + 2 * 3 * 2  # default; methods, tolerances, steps
    page = (folder / "trade.md").read_text()
    assert "`dockloop trade hexapod_bench --methods explicit,stabilised,dae --quick`" in page
    with (folder / "trade.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(summary["rows"])
    evaluations = [int(row["evaluations"]) for row in table if row["status"] == "done"]
    assert evaluations == sorted(evaluations)
    for entry in summary["recommendations"]:
        if entry["best"]:
            assert entry["best"]["error"] <= entry["wanted"], entry
            assert entry["best"]["setting"] in page
    assert "use" in summary["recommendations"][0]["sentence"]


def test_looking_between_communication_points_changes_no_bit(runs, build):
    bench = Bench(runs.comparing_fmu("hexapod_bench"))
    starts = {"solver.method": 6, "solver.rtol": 1e-4}
    run = bench.run(starts, 3.0, 1.0)
    seen = bench.probe(starts, 3.0, 1.0, np.linspace(0.0, 3.0, 13))
    assert (seen.values[::4] == run.values).all(), run.names
    alone = bench.run(starts, 1.75, 1.0)
    assert (seen.values[7] == alone.values[-1]).all(), run.names


def make_docking() -> Result:
    """A docking that never was: three points of time, captured at 1.5 s."""
    entries = {
        "relative.position": [[0.5, 0.0, 0.0], [0.2, 0.0, 0.0], [0.1, 0.0, 0.0]],
        "relative.attitude": [[1.0, 0.0, 0.0, 0.0]] * 3,
        "relative.velocity": [[-0.1, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.0, 0.0, 0.0]],
        "relative.angular_velocity": [[0.0, 0.01, 0.0], [0.0, 0.0, 0.02], [0.0, 0.0, 0.0]],
        "ring.position": [[0.3, 0.0, 0.0], [0.1, 0.0, 0.0], [0.25, 0.0, 0.0]],
    }
    names, columns = ["time"], [[0.0, 1.0, 2.0]]
    for name, points in entries.items():
        names += [f"{name}[{i + 1}]" for i in range(len(points[0]))]
        columns += np.transpose(points).tolist()
    for name, value in {
        "capture.peak.compression": 1000.0,
        "capture.peak.tension": 10.0,
        "capture.peak.shear": 300.0,
        "capture.peak.bending": 200.0,
        "capture.peak.torsion": 50.0,
        "outcome": 2.0,
        "captured": 1.0,
        "time_of_contact": 1.0,
        "time_of_capture": 1.5,
    }.items():
        names.append(name)
        columns.append([value] * 3)
    return Result({}, names, [""] * len(names), np.array(columns).T)


# Perturbed variable, at which point, by what -> figure, the error that it makes.
PERTURBED = {
    "force": ("capture.peak.shear", 2, 6.0, "capture.peak.shear", 0.02),
    "small force": ("capture.peak.tension", 2, 5.0, "capture.peak.tension", 0.1),  # of 5 %
    "moment": ("capture.peak.torsion", 2, 5.0, "capture.peak.torsion", 0.1),
    "stroke": ("ring.position[1]", 1, -0.01, "stroke", 0.05),
    "capture": ("time_of_capture", 2, 0.01, "time_of_capture", 0.02),
    "position": ("relative.position[2]", 2, 3e-3, "final_position", 3e-3 / 0.4),
    "turn": ("relative.attitude[3]", 2, 1e-6, "final_attitude", 2e-3),  # scale: at least 1e-3
    "velocity": ("relative.velocity[3]", 2, 4e-3, "final_velocity", 0.02),
    "rate": ("relative.angular_velocity[1]", 2, 1e-4, "final_angular_velocity", 5e-3),
}


@pytest.mark.parametrize("name", PERTURBED)
def test_a_perturbed_run_has_the_error_of_its_perturbation(name):
    variable, point, amount, figure, error = PERTURBED[name]
    solution, run = make_docking(), make_docking()
    assert find_error_columns(solution, run)["error"] == 0.0
    run.values[point, run.names.index(variable)] += amount
    found = find_error_columns(solution, run)
    assert found["error"] == pytest.approx(error, rel=1e-9), found
    assert found["error"] == find_error(solution, run)
    assert found["decided_by"] == figure, found
    assert found.get(figure, found["peaks"]) == found["error"], found
    assert found["outcome_matches"] is True


@pytest.mark.parametrize(
    ("variable", "amount", "column", "error"),
    [
        ("relative.position[2]", 3e-3, "position_m", 3e-3),
        ("relative.attitude[3]", 1e-6, "attitude_rad", 2e-6),
    ],
)
def test_a_perturbation_on_the_way_has_a_column_and_no_part_of_the_error(
    variable, amount, column, error
):
    solution, run = make_docking(), make_docking()
    run.values[1, run.names.index(variable)] += amount
    found = find_error_columns(solution, run)
    assert found[column] == pytest.approx(error, rel=1e-9), found
    assert found["error"] == 0.0


@pytest.mark.parametrize(
    ("variable", "value"), [("outcome", 3.0), ("captured", 0.0), ("time_of_capture", -1.0)]
)
def test_another_outcome_is_flagged_and_has_no_error(variable, value):
    solution, run = make_docking(), make_docking()
    run.values[2, run.names.index(variable)] = value
    found = find_error_columns(solution, run)
    assert found["outcome_matches"] is False
    assert found["error"] is None
    assert find_error(solution, run) == math.inf


def test_a_perturbed_solution_raises_the_errors_of_real_runs(absorber):
    names = find_compared(absorber.outputs)
    solution = find_solution(absorber, absorber.stop, absorber.step, names).recording
    run = absorber.run(absorber.tolerances(1e-6), absorber.stop, absorber.step)
    before = find_error_columns(solution, run)
    solution.values[250:, solution.names.index("relative.position[1]")] += 1e-3
    after = find_error_columns(solution, run)
    assert before["position_m"] < 1e-5, before
    assert after["position_m"] > 9e-4, after
    assert after["error"] > before["error"]


def test_a_scene_without_motion_to_compare_is_refused():
    with pytest.raises(UsageError, match=r"neither the outputs 'relative' nor 'ring'"):
        find_compared(["time", "energy.residual"])


# ---------------------------------------------------------------- the reference solution


def test_the_solution_is_found_once(absorber, tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "RESULTS", tmp_path)  # nothing was found in it before
    said = []
    names = ["relative.position[1]"]
    first = find_solution(absorber, 0.5, 0.1, names, said.append)
    again = find_solution(absorber, 0.5, 0.1, names, said.append)
    assert len(said) == 1
    assert again.key == first.key
    assert (again.recording.values == first.recording.values).all()
    assert np.max(np.abs(first.doubt.values - first.recording.values)) < 1e-10
    assert find_solution(absorber, 0.5, 0.05, names, said.append).key != first.key
    assert len(said) == 2


def make_core(folder, monkeypatch, answer):
    """Put a program in the place of dockloop-compare that knows the solution, or says it does."""
    core = folder / "core"
    core.write_text(f"#!/bin/sh\n{answer}\n")
    core.chmod(core.stat().st_mode | stat.S_IEXEC)
    monkeypatch.setattr(paths, "COMPARE", core)


def test_the_solution_of_the_core_is_used_where_it_is_known(absorber, tmp_path, monkeypatch):
    """A program that is sure of a position of 42 m, but not of a peak of 42 N."""
    names = ["relative.position[1]", "capture.peak.compression"]
    facts = {"tolerance": 1e-16, "digits": 33}
    answer = {
        "time": [0.0, 0.5],
        "output": {name: [42.0, 42.0] for name in names},
        "check": {"difference": dict(zip(names, (1e-14, 1.0), strict=True))},
        "work": {"evaluations": 7},
        **facts,
    }
    make_core(tmp_path, monkeypatch, f"echo '{json.dumps(answer)}'")
    solution = find_solution(absorber, 0.5, 0.5, names)
    assert solution.source.startswith("dockloop truth; capture.peak.compression: the FMU itself")
    assert solution.facts == {**facts, "evaluations": 7}
    assert solution.recording[names[0]].tolist() == [42.0, 42.0]
    assert solution.doubt[names[0]] == pytest.approx([42.0, 42.0], rel=1e-12)
    ours = absorber.run(absorber.tolerances(1e-12), 0.5, 0.5)[names[1]]
    assert solution.recording[names[1]] == pytest.approx(ours, rel=1e-9)


def test_where_the_core_fails_the_fmu_says_the_solution_and_the_reason_is_kept(
    absorber, tmp_path, monkeypatch
):
    make_core(tmp_path, monkeypatch, "echo 'double precision only' >&2; exit 2")
    solution = find_solution(absorber, 0.5, 0.5, ["relative.position[1]"])
    assert solution.source.startswith("the FMU itself"), solution.source
    assert solution.source.endswith("(dockloop truth: double precision only)"), solution.source


# ---------------------------------------------------------------- rows


def test_an_interrupted_trade_goes_on_to_the_same_rows(absorber, measured, build, monkeypatch):
    real, calls = trades.measure, []

    def measure(*arguments, **options):
        calls.append(arguments[1])
        if len(calls) == 5:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    monkeypatch.setattr(trades, "measure", measure)
    choice, folder = Choice(quick=True), build / "interrupted"
    count = len(measured.rows)
    with pytest.raises(InterruptedWorkError, match=rf"with 4 of {count} cases in .*--resume"):
        trades.run_trade(absorber, choice, folder)
    with pytest.raises(UsageError, match=f"holds 4 of {count} cases of a trade"):
        trades.run_trade(absorber, choice, folder)
    rows = trades.run_trade(absorber, choice, folder, resume=True).rows
    assert len(calls) == 1 + count, len(calls)
    for row, whole in zip(rows, measured.rows, strict=True):
        assert {n: row[n] for n in row if n not in MEASURED} == {
            n: whole[n] for n in whole if n not in MEASURED
        }
    with pytest.raises(UsageError, match="made with another stop, "):
        trades.run_trade(absorber, Choice(quick=True, stop=2.0), folder, resume=True)


def test_the_default_is_the_first_row_and_costs_its_own_time(measured):
    rows = measured.rows
    assert [row["is_default"] for row in rows] == [True] + [False] * (len(rows) - 1)
    assert rows[0]["step"] == 0.01
    assert 0.2 < rows[0]["time_ratio"] < 5.0, rows[0]["time_ratio"]  # timed once, busy or not


def test_runs_are_compared_as_often_whatever_their_step():
    for step, stop, interval in ((0.01, 4.0, 0.1), (0.1, 5.0, 0.1), (0.01, 50.0, 1.0)):
        assert trades.find_interval(step, stop) == interval, (step, stop)
    assert trades.find_interval(0.01, 0.55) == pytest.approx(0.01)
    uneven = 5.005 / trades.find_interval(0.01, 5.005)
    assert uneven == pytest.approx(51.0, rel=1e-12), uneven


def make_bench(levels=True):
    """A bench that has received what its FMU has."""
    start = {"solver.method": 1, "solver.rtol": 1e-6, "model.level": 3 if levels else None}
    names = ["solver.method", *(["model.level", "solver.dae_form"] if levels else [])]
    return SimpleNamespace(start=start.get, variables=dict.fromkeys(names), step=0.01)


def test_the_grid_asks_for_what_the_fmu_has():
    settings = trades.make_settings(make_bench(), Choice(), 4.0)
    assert settings[0] == Setting(3, 1, None, 1e-6, None, 0.01)
    assert {(s.method, s.dae_form) for s in settings if s.level == 4} == {(9, f) for f in (1, 2, 3)}
    assert {s.level for s in settings} == {1, 2, 3, 4}
    for setting in settings[1:]:
        fixed = setting.method in (7, 13)
        assert (setting.rtol is None, setting.inner_step is None) == (fixed, not fixed), setting
    assert max(s.step for s in settings) == 1.0
    assert max(s.step for s in trades.make_settings(make_bench(), Choice(), 0.5)) == 0.5
    without = trades.make_settings(make_bench(levels=False), Choice(), 4.0)
    assert {s.level for s in without} == {None}
    assert [s.dae_form for s in without if s.method == 9] == [None] * 6


def test_a_choice_restricts_the_grid():
    choice = Choice(levels=(3,), methods=(2, 7), tolerances=(1e-5,), steps=(0.02,))
    settings = trades.make_settings(make_bench(), choice, 4.0)[1:]
    assert {s.method for s in settings} == {2, 7}
    assert {s.rtol for s in settings} == {1e-5, None}
    assert {s.step for s in settings} == {0.02}
    assert {s.level for s in settings} == {3}
    with pytest.raises(UsageError, match="no setting with these"):
        trades.make_settings(make_bench(), Choice(levels=(1,), methods=(7,)), 4.0)
    with pytest.raises(UsageError, match=r"no variable 'model\.level'"):
        trades.make_settings(make_bench(levels=False), Choice(levels=(1,)), 4.0)


def test_every_method_of_the_core_can_be_asked_for_by_its_name_and_is_in_the_grid(absorber):
    variable = absorber.variables["solver.method"]
    numbers = [method["number"] for method in list_methods()]
    assert numbers == list(range(int(variable.min), int(variable.max) + 1))
    methods = {m["number"]: m["name"] for m in list_methods() if m["is_built"]}
    used = {m["number"]: m["same_as"] or m["number"] for m in list_methods() if m["is_built"]}
    for number, name in methods.items():
        assert re.search(rf"\b{number} {name}\b", variable.description), (number, name)
        (chosen,) = trades.parse_methods(name)
        assert chosen == used[number]
        settings = trades.make_settings(make_bench(), Choice(methods=(chosen,)), 4.0)
        assert {s.method for s in settings[1:]} == {chosen}, name
    everything = trades.make_settings(make_bench(), Choice(), 4.0)
    assert {s.method for s in everything} == set(used.values())


def test_a_method_for_comparison_is_refused_by_the_fmu_that_does_not_carry_it(runs, build):
    """By name, already where it is set; the description lists only what is carried."""
    bench = Bench(runs.fmu("absorber_1d"))
    variable = bench.variables["solver.method"]
    assert "solver.dae_form" not in bench.variables
    assert int(bench.variables["model.level"].max) == 3
    for method in list_methods():
        number, name = method["number"], method["name"]
        named = re.search(rf"\b{number} {name}\b", variable.description)
        assert (named is None) == method["for_comparison"], name
        if not method["for_comparison"]:
            continue
        with pytest.raises(UsageError) as refused:
            bench.run({"solver.method": number}, 0.1, 0.1)
        said = str(refused.value)
        assert said.startswith(f"'solver.method' = {number} ({name}), a method for comparison")
        assert (": take 1 (auto), 2 (explicit)" in said) == method["is_built"]
        assert ("`dockloop trade`" in said) == method["is_built"]
        assert ("; no longer built: take 1" in said) != method["is_built"]
    with pytest.raises(UsageError, match=r"'model\.level' = 4 \(reference\), a form for compar"):
        bench.run({"model.level": 4}, 0.1, 0.1)


def test_bad_usage_is_refused_with_one_sentence(dockloop):
    for arguments, words in (
        (["hexapod_bank"], "did you mean 'hexapod_bench'"),
        (["absorber_1d", "--methods", "implict"], "there is no 'implict' (did you mean 'implicit'"),
        (["absorber_1d", "--levels", "stiff"], "must be of 1 rigid, 2 massless_legs"),
        (["absorber_1d", "--tolerances", "1e-3,x"], "must be finite numbers separated by commas"),
        (["absorber_1d", "--steps", "inf"], "must be finite numbers separated by commas"),
        (["absorber_1d", "--tolerances", "2"], "must be greater than 0 and at most 1"),
        (["absorber_1d", "--steps", "0"], "must be greater than 0"),
        (["absorber_1d", "--tolerances", "-1e-3"], "--tolerances -1e-3: must be greater than 0"),
        (["absorber_1d", "--stop", "-1"], "--stop -1.0: must be greater than"),
    ):
        refused = dockloop("trade", *arguments)
        assert refused.status == 2, refused
        assert words in refused.err, refused
        assert refused.err.count("\n") == 1, refused


# ---------------------------------------------------------------- what pays


def make_row(scheme, error, evaluations, time_ratio, *, step=0.1, status="done", **more):
    return {
        "setting": f"{scheme}, {error}, step {step:g} s",
        "scheme": scheme,
        "status": status,
        "reason": None,
        "error": error,
        "evaluations": evaluations,
        "time_ratio": time_ratio,
        "step": step,
        "level": None,
        "is_default": False,
        "options": "",
        "outcome_matches": error is not None,
        **more,
    }


ROWS = [
    make_row("quick", 3e-2, 100, 0.5),
    make_row("quick", 5e-4, 400, 1.0),
    make_row("expensive", 5e-4, 300, 2.0),  # fewer evaluations, but each costs more
    make_row("expensive", 2e-7, 900, 3.0),
    make_row("coarse", 5e-4, 200, 0.9, step=1.0),
    make_row("beaten", 2e-2, 500, 1.5),
    make_row("wrong", None, 10, 0.1),  # another outcome
    make_row("refused", None, None, None, status="refused", outcome_matches=None),
]


def test_the_front_holds_what_nothing_beats():
    by_time = report.find_front(ROWS, "time_ratio")
    assert [row["setting"] for row in by_time] == [
        "quick, 0.03, step 0.1 s",
        "coarse, 0.0005, step 1 s",
        "expensive, 2e-07, step 0.1 s",
    ]
    by_evaluations = report.find_front(ROWS, "evaluations")
    assert [row["evaluations"] for row in by_evaluations] == [100, 200, 900]
    assert report.find_front(ROWS[6:], "time_ratio") == []


def test_the_cheapest_that_is_good_enough_is_recommended():
    assert report.recommend(ROWS, 1e-1)["evaluations"] == 100
    assert report.recommend(ROWS, 1e-3)["evaluations"] == 200
    assert report.recommend(ROWS, 5e-4)["evaluations"] == 200
    assert report.recommend(ROWS, 4e-4)["evaluations"] == 900
    assert report.recommend(ROWS, 1e-9) is None


def summarise(rows, doubt=1e-12):
    about = {
        "truth": {"source": "a test", "error": doubt},
        "frame": "ring",
        "scales": {"final_position": 1.0},
    }
    return report.summarise_trade(trades.Trade(rows, about), "dockloop trade")


def test_the_recommendation_says_it_in_words():
    summary = summarise(ROWS)
    sentences = {e["wanted"]: e["sentence"] for e in summary["recommendations"]}
    assert sentences[1e-3].startswith(
        "for 1e-03 use coarse, 0.0005, step 1 s: 200 evaluations, 0.9"
    )
    assert sentences[1e-8] == "for 1e-08: no setting of the grid reaches it"
    by_step = {e["wanted"]: e["by_step"] for e in summary["recommendations"]}
    assert by_step[1e-3]["0.1"]["evaluations"] == 400
    assert by_step[1e-6]["1"] is None
    doubtful = summarise(ROWS, doubt=1e-5)["recommendations"][4]
    assert doubtful["best"] is None
    assert doubtful["sentence"] == "for 1e-06: the reference solution itself is good to 1e-05 only"


def test_what_does_not_pay_and_what_levels_cost_is_said():
    assert summarise(ROWS)["does_not_pay"] == [
        "does not pay: beaten, at best 3 times the time of the cheapest (for 1e-01, step 0.1 s)"
    ]
    slow = [*ROWS, make_row("slow", 4e-3, 1000, 1.3, level=2), make_row("slow", 1e-7, 5000, 6.0)]
    summary = summarise([make_row("level", 2e-1, 10, 0.2, level=1), *slow])
    assert summary["does_not_pay"][0] == "does not pay: level, error 2.0e-01 at best"
    assert summary["does_not_pay"][-1] == (
        "does not pay: slow, at best 1.3 times the time of the cheapest (for 1e-02, step 0.1 s)"
    )
    assert [text.partition(";")[0] for text in summary["levels"]] == [
        "level rigid: error 2.0e-01 at best",
        "level massless_legs: error 4.0e-03 at best",
    ]
    assert summary["other_outcome"] == ["wrong, None, step 0.1 s"]


def test_scales_are_those_of_the_solution():
    scales = find_scales(make_docking())
    assert scales == pytest.approx(
        {
            "capture.peak.compression": 1000.0,
            "capture.peak.tension": 50.0,
            "capture.peak.shear": 300.0,
            "capture.peak.bending": 200.0,
            "capture.peak.torsion": 50.0,
            "stroke": 0.2,
            "time_of_capture": 0.5,
            "final_position": 0.4,
            "final_attitude": 1e-3,
            "final_velocity": 0.2,
            "final_angular_velocity": 0.02,
        }
    )
    assert all(math.isfinite(scale) for scale in scales.values())


# ---------------------------------------------------------------- --quick, --apply


def test_the_quick_grid_compares_like_with_like(absorber):
    settings = trades.make_settings(absorber, Choice(quick=True), absorber.stop)
    steps: dict[int, set] = {}
    for setting in settings:
        if setting.level == 3:
            steps.setdefault(setting.method, set()).add(setting.step)
    carried = {m["number"] for m in list_different_methods() if not m["for_comparison"]}
    assert set(steps) == carried
    assert 12 in carried
    assert set(map(frozenset, steps.values())) == {frozenset({0.01, 0.1})}
    named = trades.make_settings(absorber, Choice(methods=(9,), quick=True), absorber.stop)
    assert {setting.method for setting in named} == {1, 9}


TOML = """title = "a scene"  # of this test

[solver]                   # of the user
rtol = 1e-6                # relative
method = "bdf"

[experiment]
step = 0.5                 # s
"""


def test_a_key_is_set_in_place_and_comments_stay():
    changed = set_key(TOML, "solver", "rtol", 1e-3)
    assert "rtol = 0.001                # relative" in changed
    changed = set_key(changed, "solver", "step", 2e-3)
    changed = set_key(changed, "solver", "method", "auto")
    changed = set_key(changed, "model", "level", "rigid")
    assert tomllib.loads(changed) == {
        "title": "a scene",
        "solver": {"rtol": 1e-3, "method": "auto", "step": 2e-3},
        "experiment": {"step": 0.5},
        "model": {"level": "rigid"},
    }
    assert changed.count("#") == TOML.count("#")


@pytest.fixture
def own_scene(tmp_path):
    """A scene of the user's own, with a method and a comment."""
    own = tmp_path / "mine.toml"
    text = (paths.SCENES / "absorber_1d.toml").read_text()
    own.write_text(text.replace("[solver]", '[solver]\nmethod = "bdf"  # mine'))
    return own


def test_apply_writes_a_copy_that_run_sweep_and_build_honour(dockloop, own_scene):
    before = own_scene.read_text()
    words = ("trade", str(own_scene), "--quick", "--methods", "explicit,fixed_rk4", "--stop", "1")
    words += ("--apply", "1e-3")
    reported = dockloop.succeed(*words, "--json")
    applied = json.loads(reported.out)["applied"]
    copy = own_scene.with_name("mine_error_0p001.toml")
    assert applied["file"].endswith(copy.name)
    assert own_scene.read_text() == before
    found = tomllib.loads(copy.read_text())
    for name, value in applied["keys"].items():
        section, member = name.split(".")
        assert found[section][member] == value, name
    stated = tomllib.loads(before)["experiment"]
    tolerance = found["experiment"]["tolerance"]  # a host that passes it on undoes no rtol
    assert tolerance >= found["solver"]["rtol"]
    assert found["experiment"] == stated | {"tolerance": tolerance}
    number = {m["name"]: m["number"] for m in list_methods()}[found["solver"]["method"]]
    assert number in (2, 7)
    result = dl.run(copy, stop=0.1)
    assert result["solver.chosen_method"][-1] == number
    swept = dl.sweep(
        {
            "scene": str(copy),
            "outcomes": ["solver.chosen_method"],
            "vary": [{"type": "grid", "name": "initial.closing_speed", "values": [0.1]}],
            "experiment": {"stop": 0.1},
        }
    )
    assert list(swept["solver.chosen_method"]) == [number]
    fmu = copy.with_suffix(".fmu")
    assert dockloop("build", str(copy), "-o", str(fmu)).status == 0
    assert Bench(fmu).start("solver.method") == number
    again = dockloop.succeed(*words, "--resume")  # its own copy is replaced
    assert f"{copy.name} has: " in again.out


def test_apply_replaces_no_file_of_the_user_and_says_what_it_cannot_reach(dockloop, own_scene):
    before = own_scene.read_text()
    quick = ("trade", str(own_scene), "--quick", "--methods", "explicit", "--stop", "1")
    foreign = dockloop(*quick, "--apply", "1e-3", "-o", str(own_scene))
    assert foreign.status == 2
    assert "which 'dockloop trade' did not write" in foreign.err
    assert own_scene.read_text() == before
    for words, text in (
        (("--apply", "2"), "--apply 2: must be a number above 0 and below 1"),
        (("--apply", "1e-3", "--scene", "solver.rtol=1e-3"), "put it into the scene file"),
        (("-o", "own.toml"), "a scene needs --apply ERROR"),
    ):
        refused = dockloop(*quick, *words)
        assert (refused.status, refused.err.count("\n")) == (2, 1)
        assert text in refused.err
    beyond = dockloop(*quick, "--apply", "1e-15")
    assert beyond.status == 1
    assert "--apply 1e-15: no measured setting reaches it: the smallest error is" in beyond.err
