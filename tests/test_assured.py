"""Assured accuracy: runs are repeated with tighter settings until two of them agree.

1. An assured run is within its accuracy, also where one run with it is not, and states the price.
2. What cannot be had is named with the reason: boundary of capture, growth, a run that fails.
3. Times of a sequence and chosen outputs have stated scales; integration itself is no figure.
4. Sweeps: the same table by one thread, by two, after an interruption, and from FMUs.
5. Envelopes and maps pass it on. Combinations without a meaning get one sentence.
"""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.paths import ROOT
from dockloop.cli import main
from dockloop.result import accuracy, run_errors
from dockloop.result.recording import Result
from dockloop.runs.assured import assure, compare
from dockloop.runs.judging import Case, judge
from dockloop.sweeps.cases import run_case
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import make_sweep
from pawls import FORCE, PUSH, SCENE, SPEED, STRAIGHT, find_speed

NEAR = {
    "initial.approach_time": 0.3,
    "outputs.groups": ["relative", "capture", "phase", "ring", "solver"],
}
STOP, STEP = 3.0, 0.05
PAWLS = STRAIGHT | {FORCE[0]: PUSH}
LEAST = float(find_speed(PUSH))  # m/s


@pytest.fixture(scope="module")
def study():
    """The module of the study."""
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(ROOT / "tests" / "studies"))
        import assured as module

        yield module
        sys.modules.pop("assured")


def run(start_values=None, **options):
    return dl.run(SCENE, NEAR, start_values, stop=STOP, step=STEP, **options)


def push_open(speed, start_values=None, **options):
    """Run a straight docking that opens pawls."""
    keys = PAWLS | {SPEED[0]: speed}
    return dl.run(SCENE, keys, start_values, stop=6.0, step=1.0, **options)


# ---------------------------------------------------------------------------- what is assured


def test_an_assured_run_is_within_its_accuracy_and_says_what_it_cost():
    made = run(accuracy=1e-3, assured=True)
    solution = run({"solver.method": "bdf", **accuracy.list_tolerances(1e-11)})
    assert run_errors.find_worst(compare(solution, made))[1] <= 1e-3
    found = made.assurance
    assert found.verdict is True
    assert made.summary["assured"] is True
    assert found.error == max(found.figures.values()) <= 1e-3
    counts = [each["evaluations"] for each in found.runs]
    assert counts[0] == run(accuracy=1e-3)["solver.rhs_evaluations"][-1]
    assert made.summary["assurance"]["price"] == sum(counts) / counts[0]
    assert f"cost {found.price:.1f} times" in made.summary["assurance"]["sentence"]
    assert json.loads(json.dumps(made.summary["assurance"], allow_nan=False))
    assert not made.warnings


def test_the_result_is_that_of_the_tighter_run():
    made = run(accuracy=1e-2, assured=True)
    settings = made.assurance.list_settings()
    assert [each["accuracy"] for each in settings] == [1e-2, 1e-3]
    assert made.values.tobytes() == run(accuracy=1e-3).values.tobytes()


def test_stated_tolerances_become_a_tenth():
    start = {"solver.method": "bdf", **accuracy.list_tolerances(1e-7)}
    made = run(start, accuracy=1e-2, assured=True)
    settings = made.assurance.list_settings()
    assert [each["rtol"] for each in settings] == pytest.approx([1e-7, 1e-8])
    assert {each["method"] for each in settings} == {"bdf"}


@pytest.mark.parametrize("number", [9, 12])
def test_dockings_of_the_study_are_within(study, number):
    """Their runs with accuracy = 1e-2 alone are not always."""
    docking = study.draw_docking(number)
    found = study.measure_one(docking, 1e-2, study.solve(docking, study.TOLERANCES[0]))
    assert not found["assured"]["refused"]
    assert study.is_within(found, "assured", 1e-2)
    assert found["assured"]["settings"] >= 2


def test_the_page_of_the_study_says_what_its_rows_say(study):
    def make(number, error, refused):
        measured = {"error": ["stroke", error], "seconds": 1.0}
        measured |= {"settings": 2, "price": 4.0, "refused": refused}
        row = dict.fromkeys(("is_own", "has_bristles", "has_thrust", "is_long"), True)
        row |= {"number": number, "scene": "apda", "speed": 0.01}
        return row | {f"{w:g}": {"alone": measured, "assured": measured} for w in study.WANTED}

    good, bad = make(1, 1e-4, {}), make(2, None, {})
    refused = make(3, 0.5, {"outcome": "boundary of capture: x"})
    text = "\n".join(map(str, study.describe_page([good, refused])))
    assert "Every assured run is within its accuracy." in text
    assert "| all | 0.01 | 1 of 2 (50%) | 1 of 2 (50%) | 1 of 1 (100%) | 0.01 |" in text
    assert "* 3 (`apda`), `accuracy` 0.01: outcome: boundary of capture: x." in text
    assert "Called assured, but not within it: 2 at 0.01" in "\n".join(
        map(str, study.describe_page([bad]))
    )


# ---------------------------------------------------------------------------- what is not


@pytest.fixture(scope="module")
def boundary():
    """Closing speeds on both sides of the boundary of capture, one part in 1e10 apart [m/s]."""
    tight = {"solver.method": "stabilised", **accuracy.list_tolerances(1e-13)}
    low, high = LEAST, 1.001 * LEAST
    assert push_open(low, tight).outcome != "captured" == push_open(high, tight).outcome
    while high - low > 1e-10 * low:
        middle = 0.5 * (low + high)
        if push_open(middle, tight).outcome == "captured":
            high = middle
        else:
            low = middle
    return low, high


@pytest.mark.parametrize("side", [0, 1])
def test_a_docking_on_the_boundary_of_capture_is_refused(boundary, side):
    """Two runs with tolerances of 6.5e-9 and 6.5e-10 agree there, on the wrong side."""
    made = push_open(boundary[side], accuracy=1e-2, assured=True)
    assert set(made.summary["assured"]) & {"outcome", "time_of_capture"}
    said = " ".join(made.summary["assured"].values())
    assert "boundary of capture" in said or "depends on the last digits" in said
    assert "boundary of capture" in said or side == 1
    assert any(text.startswith("assured: cannot be assured") for text in made.warnings)


def test_off_the_boundary_the_same_docking_is_assured():
    for speed, outcome in ((0.98 * LEAST, "undecided"), (1.1 * LEAST, "captured")):
        made = push_open(speed, accuracy=1e-2, assured=True)
        assert made.summary["assured"] is True
        assert made.outcome == outcome


def make_result(rtol, stroke, **more):
    """Return what a run with a tolerance might have recorded: two points."""
    columns = {
        "time": [0.0, 1.0],
        **{f"ring.position[{i}]": [0.0, stroke * (i == 1)] for i in (1, 2, 3)},
        **{f"ring.velocity[{i}]": [0.0, 0.0] for i in (1, 2, 3)},
        **{f"ring.angular_velocity[{i}]": [0.0, 0.0] for i in (1, 2, 3)},
        **{f"ring.attitude[{i}]": [float(i == 1)] * 2 for i in (1, 2, 3, 4)},
        "solver.chosen_method": [3, 3],
        "solver.chosen_rtol": [rtol, rtol],
        "solver.rhs_evaluations": [0, 100],
        **more,
    }
    names = list(columns)
    values = np.array(list(columns.values()), dtype=float).T
    parameters = {"accuracy": 1e-2, "solver.method": 1.0, "solver.rtol": rtol}
    parameters |= dict.fromkeys((f"solver.{n}" for n in accuracy.ATOL_PER_RTOL), 1e-9)
    return Result({}, names, [""] * len(names), values, parameters)


def test_a_figure_on_which_no_runs_agree_is_named_with_its_growth():
    strokes = iter([0.1, 0.2] * 10)

    def repeat(settings):
        return make_result(settings["solver.rtol"], next(strokes))

    made = assure(make_result(1e-9, 0.2), repeat)
    assert set(made.assurance.verdict) == {"stroke", "final_position"}
    rtols = [each["rtol"] for each in made.assurance.runs]
    assert rtols == pytest.approx([1e-9, 1e-10, 1e-11, 1e-12, 1e-13])
    why = made.assurance.verdict["stroke"]
    growth = (1.0 if made["ring.position[1]"][-1] == 0.1 else 0.5) / 1e-12
    assert f"depends on the last digits: small changes grow {growth:.0e} times" in why


def test_a_tighter_run_that_fails_is_the_reason():
    def refuse(_):
        raise dl.DockloopError("step from t = 1 s: a test")

    made = assure(make_result(1e-6, 0.2), refuse)
    assert made.assurance.verdict is False
    assert "nothing is assured" in made.assurance.say()
    assert "(step from t = 1 s: a test)" in made.assurance.say()
    assert made.assurance.to_summary()["assured"] is False


def test_a_neighbour_that_fails_leaves_the_run_and_is_the_reason():
    def repeat(settings):
        if any(".velocity" in name for name in settings):
            raise dl.DockloopError("step from t = 1 s: a test")
        return run({"accuracy": 1e-3} | settings)

    made = assure(repeat({}), repeat)
    assert set(made.summary["assured"]) == {"outcome"}
    said = made.summary["assured"]["outcome"]
    assert said.startswith("a start that differs by ")
    assert said.endswith(" fails (step from t = 1 s: a test)")
    assert made.outcome == run(accuracy=1e-3).outcome
    assert made.assurance.error <= 1e-3


# ---------------------------------------------------------------------------- figures


def test_times_and_chosen_outputs_have_stated_scales():
    def make(contact, first, second, force, count):
        more = {
            "time_of_contact": [-1.0, contact],
            "sequence.entered[1]": [0.0, first],
            "sequence.entered[2]": [-1.0, second],
            "leg[1].force": [-50.0, force],
            "latched[1]": [0, count],
        }
        return replace(make_result(1e-9, 0.1, **more), parameters={})

    reference, other = make(0.2, 0.1, 0.7, 10.0, 1), make(0.21, 0.11, 0.75, 9.0, 0)
    chosen = ["leg[1].force", "latched[1]", "solver.rhs_evaluations"]
    figures = run_errors.find_further_figures(reference, other, chosen)
    assert figures == pytest.approx(
        {
            "time_of_contact": 0.01 / 0.2,
            "sequence.entered[1]": 0.01 / 0.1,
            "sequence.entered[2]": 0.05 / 0.5,
            "leg[1].force": 1.0 / 50.0,
            "latched[1]": 1.0,
        }
    )
    never = run_errors.find_further_figures(reference, make(0.2, 0.1, -1.0, 10.0, 1))
    assert never["sequence.entered[2]"] == np.inf


def test_moments_of_rounding_are_compared_with_the_force_at_a_millimetre():
    peaks = {"capture.peak.compression": 500.0, "capture.peak.bending": 1e-9}
    other = peaks | {"capture.peak.bending": 3e-9}
    errors = run_errors.compare_peaks(peaks, other)
    assert errors["capture.peak.bending"] == pytest.approx(2e-9 / 0.5)


def test_chosen_outputs_are_assured_too():
    made = run(accuracy=1e-2, assured=["relative.axial", "capture.compression"])
    assert {"relative.axial", "capture.compression"} <= set(made.assurance.figures)
    with pytest.raises(dl.UsageError, match=r"'relative.axal' is no output .*'relative.axial'"):
        run(accuracy=1e-2, assured=["relative.axal"])


# ---------------------------------------------------------------------------- many dockings


SPEEDS = [0.9 * LEAST, 1.0002 * LEAST, 1.1 * LEAST, 1.3 * LEAST]
SWEEP = {
    "scene": SCENE,
    "set": PAWLS,
    "vary": [{"type": "grid", "name": SPEED[0], "values": SPEEDS}],
    "experiment": {"stop": 6.0, "step": 1.0},
}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """The file of an assured sweep by one thread, and its sweep file."""
    folder = tmp_path_factory.mktemp("assured")
    file, sweep = folder / "one.parquet", folder / "own.toml"
    settings = "".join(f'"{name}" = {json.dumps(value)}\n' for name, value in PAWLS.items())
    sweep.write_text(
        f'scene = "{SCENE}"\n[set]\n{settings}\n[[vary]]\ntype = "grid"\nname = "{SPEED[0]}"\n'
        f"values = {SPEEDS}\n[experiment]\nstop = 6.0\nstep = 1.0\n",
        encoding="utf-8",
    )
    assert main(make_command(sweep, file, "--workers", "1")) == 0
    return sweep, file


def make_command(sweep, file, *more):
    options = ("--accuracy", "1e-2", "--assured", "--no-plots", "-o", str(file))
    return ["sweep", str(sweep), *options, *more]


def test_threads_and_an_interruption_change_no_byte(table, tmp_path):
    sweep, file = table
    assert main(make_command(sweep, tmp_path / "two.parquet", "--workers", "2")) == 0
    assert (tmp_path / "two.parquet").read_bytes() == file.read_bytes()
    lines = file.with_suffix(".jsonl").read_bytes().splitlines(keepends=True)
    half = tmp_path / "half.parquet"
    half.with_suffix(".jsonl").write_bytes(b"".join(lines[:3]))
    assert main(make_command(sweep, half, "--resume")) == 0
    assert half.read_bytes() == file.read_bytes()


def test_a_journal_without_assurance_is_not_resumed(table, tmp_path, capsys):
    sweep, _ = table
    plain = [w for w in make_command(sweep, tmp_path / "x.parquet") if w != "--assured"]
    assert main(plain) == 0
    assert main(make_command(sweep, tmp_path / "x.parquet", "--resume")) == 2
    assert "it was made with another assured" in capsys.readouterr().err


def test_only_cases_that_need_it_run_with_a_third_setting(table):
    frame = dl.sweep(SWEEP, accuracy=1e-2, assured=True)
    assert frame["outcome"].tolist()[0] == "undecided"
    assert frame["outcome"].tolist()[2:] == ["captured", "captured"]
    assert frame["assured"].tolist()[2:] == ["yes", "yes"]
    assert frame["settings"].min() == 2 < frame["settings"].max()
    alone = [push_open(s, accuracy=1e-2, assured=True) for s in SPEEDS[2:]]
    assert frame["price"].tolist()[2:] == pytest.approx([each.assurance.price for each in alone])
    for row, made in enumerate(alone, 2):
        assert frame["time_of_capture"][row] == made["time_of_capture"][-1]
    found = frame.attrs["summary"]
    assert found["assurance"]["cases"] == 4
    assert found["assurance"]["again"] == sum(frame["settings"] > 2)
    assert "assured" not in dl.sweep(SWEEP, accuracy=1e-2).columns


def test_fmus_find_the_same(native):
    planner = Planner(
        replace(make_sweep(SWEEP | {"set": PAWLS | {"accuracy": 1e-2}}, ROOT / "x"), assured=True)
    )
    case = planner.resolve((SPEEDS[3],))
    ours, theirs = (run_case(planner.make_job(engine), *case) for engine in ("core", "fmu"))
    assert ours.assured == theirs.assured
    assert ours.assured["refused"] == {}
    assert ours.outputs == pytest.approx(theirs.outputs, rel=1e-12, abs=1e-12)


def test_a_case_that_is_refused_is_no_assured_case():
    keys = SWEEP | {"vary": [{"type": "grid", "name": "friction.coefficient", "values": [0.1, -1]}]}
    frame = dl.sweep(keys, accuracy=1e-2, assured=True)
    assert frame["status"].tolist() == ["done", "refused"]
    assert frame["assured"].isna().tolist() == [False, True]
    assert frame.attrs["summary"]["assurance"]["cases"] == 1


def test_an_envelope_says_which_of_its_dockings_are_assured():
    found = dl.envelope(
        SCENE,
        x=(SPEED[0], 0.5 * LEAST, 1.7 * LEAST),
        y=("friction.coefficient", 0.0, 0.1),
        criteria="captured",
        overrides=PAWLS,
        stop=6.0,
        step=1.0,
        coarse=2,
        tolerance=0.25,
        checks=0,
        accuracy=1e-2,
        assured=True,
    )
    assert found.points["assured"].tolist() == ["yes"] * len(found.points)
    assert found.summary["assured"] is True
    assert found.summary["assurance"]["cases"] == len(found.points)
    assert all(text.endswith(" --assured") for text in found.points["command"])


def test_a_point_of_a_map_is_judged_by_its_assured_run():
    case = Case(SCENE, NEAR, {"accuracy": 1e-2}, stop=1.0, wanted=1e-2, assured=True)
    verdict = judge(case)
    alone = judge(replace(case, assured=False))
    assert verdict.verdict == "right"
    assert verdict.error < 0.01 * case.wanted
    assert verdict.evaluations > 2 * alone.evaluations
    assert case.make_command().endswith("--stop 1.0 --assured")


# ---------------------------------------------------------------------------- what has no meaning


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "assured: needs a wanted error: state accuracy"),
        ({"accuracy": "real-time"}, "assured: accuracy is real-time: its fixed steps"),
        (
            {"accuracy": 1e-3, "start_values": {"solver.method": "fixed_rk4"}},
            "assured: solver.method is fixed_rk4: its fixed steps",
        ),
        ({"accuracy": 1e-3, "estimate_error": True}, "assured and estimate_error: give one"),
        (
            {"accuracy": 1e-3, "overrides": {"outputs.groups": ["relative"]}},
            "needs the outputs 'solver'",
        ),
    ],
)
def test_what_has_no_meaning_gets_one_sentence(options, words):
    with pytest.raises(dl.UsageError, match=words):
        dl.run(SCENE, stop=1.0, assured=True, **options)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ([], "assured: needs a wanted error"),
        (["--accuracy", "real-time"], "assured: accuracy is real-time"),
        (["--accuracy", "1e-3", "--set", "solver.method=fixed_rk4"], "solver.method is fixed_rk4"),
    ],
)
@pytest.mark.parametrize("command", ["run", "sweep", "envelope", "map"])
def test_commands_refuse_it_before_anything_is_written(command, more, words, tmp_path, capsys):
    axes = ["--x", "initial.closing_speed", "0.05", "0.1", "--y", "chaser.mass", "1e4", "2e4"]
    if command == "sweep":
        more = [word for word in more if word != "--set"]
        fixed = "".join(f'{w.replace("=", "=" + chr(34))}"' for w in more if "=" in w)
        more = [word for word in more if "=" not in word]
        file = tmp_path / "own.toml"
        line = '"solver.method" = "fixed_rk4"' if fixed else ""
        file.write_text(
            f'scene = "{SCENE}"\n[set]\n{line}\n[[vary]]\ntype = "grid"\n'
            'name = "chaser.mass"\nvalues = [1e4, 2e4]\n',
            encoding="utf-8",
        )
        words_of = ["sweep", str(file), "-o", str(tmp_path / "own.parquet")]
    elif command == "run":
        words_of = ["run", SCENE, "--stop", "0.1", "-o", str(tmp_path / "own.csv")]
    else:
        words_of = [command, SCENE, *axes, "-o", str(tmp_path / "own")]
        words_of += ["--criterion", "captured"] if command == "envelope" else []
    assert main([*words_of, *more, "--assured"]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1
    left = [path.name for path in tmp_path.iterdir() if path.name != "own.toml"]
    assert left == []


def test_the_command_states_it(tmp_path, capsys):
    command = ["run", SCENE, "--scene", "initial.approach_time=0.3", "--stop", "1", "--no-plots"]
    command += ["-o", str(tmp_path / "own.csv"), "--accuracy", "1e-2", "--assured"]
    assert main([*command, "--outputs", "relative.axial"]) == 0
    assert re.search("  assured +every figure is within 0.01: ", capsys.readouterr().out)
    summary = json.loads((tmp_path / "own_summary.json").read_text(encoding="utf-8"))
    assert summary["assured"] is True
    assert "relative.axial" in summary["assurance"]["figures"]
    assert main([*command, "--estimate-error"]) == 2
    assert "give one of them" in capsys.readouterr().err
