"""``dockloop fit``: parameters from measurements with their uncertainty.

The data are those of a spring and a damper between two masses, in closed form or by another engine
(MuJoCo, `data/measured_mujoco.py`), with noise, another clock, another rate and names of a rig. So
the numbers to be found are known. What is not known to the fit:

1. values, deviations and time shift: within their intervals, as often as these say;
2. what data cannot determine is named: one parameter, or some that only act together;
3. the worst pair has a profile;
4. a law of another kind (dry friction in place of a damper) is noticed, noise is not;
5. filters, offsets, scales, outliers, own values of each test, tests that are held back;
6. copies of the scene, journals, bad input.

Plans: test_fit_plan.py. Dockings with legs: test_fit_docking.py.
"""

import importlib.util
import json
import math
import tomllib

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.paths import ROOT
from dockloop.base.sections import write_text
from dockloop.studies.fits.problem import filter_low, limit_rate
from dockloop.studies.fits.report import report_fit
from dockloop.studies.fits.statistics import estimate
from fit_rig import (
    APPROACH,
    CLOCK,
    DAMPING,
    LATER,
    MASS,
    RANGES,
    RIG,
    SIGMA,
    STIFFNESS,
    TIME,
    C,
    K,
    assert_found,
    fit,
    move,
    rub,
    write_rig,
)
from test_cli import assert_refused

# ---------------------------------------------------------------------- 1. values and intervals


def test_the_numbers_of_a_rig_are_found_with_their_deviations(tmp_path):
    found = fit(write_rig(tmp_path / "rig.csv"), starts=8)
    assert_found(found, K, STIFFNESS)
    assert_found(found, C, DAMPING)
    assert max(found.deviations[K] / STIFFNESS, found.deviations[C] / DAMPING) < 3e-3
    shift = found.summary["by_test"]["rig"]["unknowns"]["shift"]
    assert abs(shift["value"] + CLOCK) < 3.0 * shift["deviation"] < 3e-3
    for name, row in found.residuals["rig"].items():
        assert row["noise"] == pytest.approx(SIGMA[name], rel=0.12)  # of 307 samples: 4 %
        assert row["rms"] < 0.1 * row["rms_before"]
        assert row["in_band"] == pytest.approx(0.95, abs=0.03)
    assert not found.summary["hidden"]
    assert not found.not_identified
    assert found.correlations[K][K] == pytest.approx(1.0)
    assert found.correlations[K][C] == pytest.approx(found.correlations[C][K])
    assert found.summary["runs"] < 50


def test_the_numbers_behind_data_of_another_engine_are_found():
    found = fit(RIG, scales=["capture.force[1]"], stop=7.0)
    assert_found(found, K, 20e3)
    assert_found(found, C, 2.0 * 0.3 * math.sqrt(20e3 * MASS))
    unknowns = found.summary["by_test"]["measured_mujoco"]["unknowns"]
    assert unknowns["shift"]["value"] == pytest.approx(-6.8, abs=5e-3)
    scale = unknowns["scale of capture.force[1]"]
    assert abs(scale["value"] - 1.02) < 3.0 * scale["deviation"]
    assert not found.summary["hidden"]


def count_inside(folder, repetitions):
    """Fit again and again with other noise; count how often each value is inside its interval."""
    inside, alarms = dict.fromkeys((K, C, "shift"), 0), 0
    for seed in range(repetitions):
        found = fit(write_rig(folder / "rig.csv", seed=100 + seed, clock=0.01 * seed))
        for name, value in ((K, STIFFNESS), (C, DAMPING)):
            low, high = found.summary["intervals"][name]
            inside[name] += low <= value <= high
        shift = found.summary["by_test"]["rig"]["unknowns"]["shift"]
        inside["shift"] += abs(shift["value"] + 0.01 * seed) < 1.96 * shift["deviation"]
        alarms += bool(found.summary["hidden"])
    return inside, alarms


def test_samples_outside_of_the_run_do_not_count(tmp_path):
    rig = write_rig(tmp_path / "rig.csv")
    found = fit(rig, stop=2.5)
    assert found.residuals["rig"]["relative.axial"]["samples"] == np.sum(TIME <= 2.5)
    assert_found(found, K, STIFFNESS)
    assert_found(found, C, DAMPING)


def test_a_fit_of_python_writes_its_summary(tmp_path):
    rig = write_rig(tmp_path / "rig.csv")
    with pytest.raises(dl.UsageError, match=r"own\.csv: must end in \.json"):
        fit(rig, output=tmp_path / "own.csv")
    found = fit(rig, stop=2.5, output=tmp_path / "own.json")
    assert {path.name for path in tmp_path.iterdir()} == {"rig.csv", "own.json", "own.jsonl"}
    assert json.loads((tmp_path / "own.json").read_text())["values"] == found.values
    members = {"scene": "absorber_1d", "cases": 2, "experiment": {"stop": 0.5, "step": 0.5}}
    table = dl.sweep(members, fitted=tmp_path / "own.json", workers=1)
    assert set(found.values) <= set(table.columns)


def find_ends(folder, **more):
    """Fit the first half of a test; return what was found and when its runs ended [s]."""
    lines = write_rig(folder / "rig.csv").read_text().splitlines()
    (folder / "rig.csv").write_text("\n".join(lines[:150]) + "\n")
    data = {"file": str(folder / "rig.csv"), "outcome": more.pop("outcome", "")}
    found = fit(data, output=folder / "fit.json", **more)
    rows = [json.loads(line) for line in (folder / "fit.jsonl").read_text().splitlines()]
    (folder / "fit.jsonl").unlink()
    return found, [row["end_time"] for row in rows if "values" in row]


def test_runs_end_with_the_data(tmp_path):
    """The scene stops after 5 s, the data at 2.33 s; a start shows which shift is possible."""
    last = TIME[148]
    found, ends = find_ends(tmp_path)
    assert ends[0] == 5.0
    assert max(ends[1:]) < last + 0.1 * np.ptp(TIME[:149]) + 0.05
    assert sum(ends) < 0.6 * 5.0 * len(ends)
    _, known = find_ends(tmp_path, shift=-CLOCK)
    assert last < max(known[1:]) < last + 0.03
    for more in ({"stop": 5.0}, {"outcome": "rebound"}, {"starts": 2, "outcome": "captured"}):
        whole, ends = find_ends(tmp_path, **more)
        assert set(ends) == {5.0}
        for name, by in found.deviations.items():
            assert abs(whole.values[name] - found.values[name]) < 0.1 * by


def test_runs_go_on_if_the_data_leave_them(tmp_path, monkeypatch):
    """As after a search that shifts the data far behind a start."""
    whole, _ = find_ends(tmp_path, stop=5.0)
    monkeypatch.setattr("dockloop.studies.fits.problem._LATER", -0.3)
    found, ends = find_ends(tmp_path)
    assert min(ends) < TIME[148]
    assert ends[-1] == 5.0
    for name, by in whole.deviations.items():
        assert abs(found.values[name] - whole.values[name]) < 0.1 * by
    samples = [each.residuals["rig"]["relative.axial"]["samples"] for each in (found, whole)]
    assert samples[0] == samples[1]


def test_a_shift_that_leaves_most_samples_out_is_said(tmp_path):
    """The run ends before most of the data are over."""
    rig = write_rig(tmp_path / "rig.csv")
    found = fit(rig, stop=2.0)
    counted = found.residuals["rig"]["relative.axial"]["samples"]
    assert counted < 0.5 * len(TIME)
    assert f"only {counted} of {len(TIME)} samples" in found.summary["hidden"][0]
    stated = fit(rig, stop=2.0, shift=-CLOCK)
    assert not any("samples" in each for each in stated.summary["hidden"])


@pytest.mark.long
def test_intervals_hold_the_value_as_often_as_they_say(tmp_path):
    inside, alarms = count_inside(tmp_path, 100)
    assert min(inside.values()) >= 90, inside
    assert alarms <= 5


@pytest.mark.long
def test_intervals_hold_the_numbers_of_another_engine(tmp_path):
    """Each repetition: other noise, another clock, 73 Hz, an offset, a factor, names of a rig."""
    spec = importlib.util.spec_from_file_location("measured_mujoco", RIG.with_suffix(".py"))
    rig = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(rig)
    clean = np.transpose(list(rig.simulate()))
    time = np.arange(0.2, 4.8, 0.0137)
    axial, _, force = (np.interp(time, clean[0], column) for column in clean[1:])
    true = {K: rig.STIFFNESS, C: 2.0 * rig.RATIO * (rig.STIFFNESS * MASS) ** 0.5}
    inside = dict.fromkeys((*true, "shift", "offset", "scale"), 0)
    for seed in range(100):
        noise = np.random.default_rng(300 + seed).normal(size=(2, len(time)))
        seen = 1e3 * (axial + 3e-3) + 0.5 * noise[0], 1.02 * force + 15.0 * noise[1]
        table = np.transpose([time + 0.02 * seed, *seen])
        np.savetxt(tmp_path / "rig.csv", table, "%.9g", ";", header="clock;dx;Fz", comments="")
        found = fit(
            tmp_path / "rig.csv", offsets="relative.axial", scales="capture.force[1]",
            columns="clock=time:s, dx=relative.axial:mm, Fz=capture.force[1]:N",
        )  # fmt: skip
        for name, value in true.items():
            low, high = found.summary["intervals"][name]
            inside[name] += low <= value <= high
        unknowns = found.summary["by_test"]["rig"]["unknowns"]
        sensor = {"shift": -0.02 * seed, "offset": 3e-3, "scale": 1.02}
        for name, by in unknowns.items():
            kind = name.split()[0]
            inside[kind] += abs(by["value"] - sensor[kind]) < 1.96 * by["deviation"]
    assert min(inside.values()) >= 90, inside


# ------------------------------------------------------------------------- 2. not identified


def test_a_parameter_without_effect_is_named(tmp_path):
    found = fit(write_rig(tmp_path / "rig.csv"), vary={**RANGES, "chaser.inertia[1]": (5e4, 9e4)})
    assert [row["parameters"] for row in found.not_identified] == [["chaser.inertia[1]"]]
    assert "do not determine chaser.inertia[1]" in found.not_identified[0]["sentence"]
    assert found.deviations["chaser.inertia[1]"] is None
    assert_found(found, K, STIFFNESS)
    assert_found(found, C, DAMPING)


def test_parameters_that_only_act_together_are_named(tmp_path):
    """Without a force, masses, springs and dampers that are all twice as large move the same."""
    rig = write_rig(tmp_path / "rig.csv")
    vary = {**RANGES, "chaser.mass": (15e3, 40e3)}
    found = fit(rig, vary=vary, columns="capture.compression=")
    assert len(found.not_identified) == 1
    assert set(found.not_identified[0]["parameters"]) == set(vary)
    assert "only together" in found.not_identified[0]["sentence"]
    with_force = fit(rig, vary=vary)
    assert not with_force.not_identified
    assert_found(with_force, "chaser.mass", 25e3)


def test_a_direction_that_is_not_seen_has_the_deviation_of_a_guess():
    """Two parameters of which only the sum is seen, to 0.01, and a third one, to 0.1."""
    jacobian = np.array([[100.0, 100.0, 0.0], [0.0, 0.0, 10.0]])
    found = estimate(jacobian, 3, factor=1.0, resolution=0.0)
    assert np.isnan(found.deviations[:2]).all()
    assert found.deviations[2] == pytest.approx(0.1)
    assert np.abs(found.directions) == pytest.approx(np.array([[0.5, 0.5, 0.0]]) ** 0.5)
    assert found.covariance[0, 0] == pytest.approx(1.0 / 24.0, rel=1e-2)


# --------------------------------------------------------------------- 3. the worst pair


def test_a_profile_agrees_with_the_deviations_where_the_model_is_nearly_linear(tmp_path):
    rig = write_rig(tmp_path / "rig.csv")
    vary = {**RANGES, "chaser.mass": (15e3, 40e3)}
    plain, found = fit(rig, vary=vary), fit(rig, vary=vary, profile=True)
    assert plain.summary["profile"] is None
    changed = {name for name, value in found.summary.items() if value != plain.summary[name]}
    assert changed == {"profile", "runs", "ran", "seconds"}
    assert found.summary["runs"] <= plain.summary["runs"] + 16
    profile = found.summary["profile"]
    assert profile["parameters"] == found.summary["worst_pair"] == ["chaser.mass", K]
    by = found.deviations["chaser.mass"]
    ways = (np.array(profile["values"]["chaser.mass"]) - found.values["chaser.mass"]) / by
    assert ways == pytest.approx(np.arange(-3, 4), abs=1e-6)
    assert profile["rise"] == pytest.approx(ways**2, abs=0.5)
    assert profile["interval"] == pytest.approx(
        found.summary["intervals"]["chaser.mass"], abs=by / 8
    )
    slope = np.diff(profile["values"][K]) / np.diff(profile["values"]["chaser.mass"])
    line = found.correlations[K]["chaser.mass"] * found.deviations[K] / by
    assert slope == pytest.approx(np.full(6, line), rel=0.02)
    text = write_text(report_fit(found.summary))
    assert f"Profile of chaser.mass and {K}" in text
    assert len(found.plot().axes) == len(plain.plot().axes) + 2


def test_a_profile_of_what_only_acts_together_goes_through_its_range(tmp_path):
    vary = {**RANGES, "chaser.mass": (15e3, 40e3)}
    rig = write_rig(tmp_path / "rig.csv")
    found = fit(rig, vary=vary, columns="capture.compression=", profile=True)
    profile = found.summary["profile"]
    masses = np.array(profile["values"]["chaser.mass"])
    assert (masses[0], masses[-1]) == pytest.approx((15e3, 40e3))
    assert np.abs(profile["rise"]).max() < 0.01
    assert profile["interval"] == [None, None]
    ratio = profile["values"][K] * (1.0 / masses + 1.0 / 350e3)
    assert ratio == pytest.approx(np.full(7, STIFFNESS / MASS), rel=3e-3)
    assert "no lower bound, no upper bound" in write_text(report_fit(found.summary))
    found.plot()


@pytest.mark.parametrize("more", [{}, {"shift": -CLOCK}])
def test_a_profile_of_one_parameter_has_no_partner(tmp_path, more):
    rig = write_rig(tmp_path / "rig.csv", damping=12961.0)
    found = fit(rig, vary={K: RANGES[K]}, profile=True, **more)
    profile = found.summary["profile"]
    assert profile["parameters"] == [K]
    assert profile["interval"] == pytest.approx(found.summary["intervals"][K], rel=1e-4)
    found.plot()


# ------------------------------------------------------------------------- 4. a wrong model


@pytest.mark.parametrize(("friction", "most"), [(300.0, 45), (60.0, 38)])
def test_a_friction_law_of_another_kind_is_noticed(tmp_path, friction, most):
    """It costs another start, which finds the same; with 60 N the damping is at its bound."""
    rig = write_rig(tmp_path / "rig.csv", histories=rub(TIME, friction))
    found = fit(rig, starts=8)
    assert "model is of another kind" in "".join(found.summary["hidden"])
    assert sum(found.summary["starts"].values()) == 8
    assert found.summary["runs"] <= most
    row = found.residuals["rig"]["capture.compression"]
    assert row["from"] < row["to"]
    assert row["per_sample"] > 2.0  # neighbours are alike: deviations are larger


@pytest.mark.long
def test_a_weak_friction_of_another_kind_is_noticed_nearly_always(tmp_path):
    """Friction of 60 N is 3 times the noise of the load cell."""
    histories = rub(TIME, friction=60.0)
    fits = [fit(write_rig(tmp_path / "rig.csv", seed, histories=histories)) for seed in range(50)]
    assert sum(bool(found.summary["hidden"]) for found in fits) >= 45


def test_noise_that_is_larger_than_stated_is_noticed(tmp_path):
    rig = write_rig(tmp_path / "rig.csv")
    found = fit(rig, noise={"relative.axial": 0.5 * SIGMA["relative.axial"]})
    ratio = found.residuals["rig"]["relative.axial"]["chi2"] ** 0.5
    assert ratio == pytest.approx(2.0, rel=0.1)
    assert f"{ratio:.2f} times the stated noise" in found.summary["hidden"][0]
    right = fit(rig, noise=SIGMA)
    assert not right.summary["hidden"]
    assert right.residuals["rig"]["relative.axial"]["noise_is"] == "stated"


# ------------------------------------------------------------------------- 5. sensors and tests


@pytest.mark.parametrize(
    ("sense", "option", "number"),
    [(filter_low, "filters", 1.5), (limit_rate, "rate_limits", 1500.0)],  # Hz, N/s
)
def test_a_slow_sensor_is_known_by_its_corner_or_its_rate(tmp_path, sense, option, number):
    """The load rises by up to 6 kN/s after a jump to 900 N."""
    fine = np.arange(0.0, 5.0, 1e-4)
    axial, force = move(fine)
    slow = np.interp(TIME, fine, sense(fine, force, number))
    rig = write_rig(tmp_path / "rig.csv", histories=(np.interp(TIME, fine, axial), slow))
    found = fit(rig, **{option: {"capture.compression": number}})
    assert_found(found, K, STIFFNESS)
    assert_found(found, C, DAMPING)
    assert not found.summary["hidden"]
    assert fit(rig).summary["hidden"]


def test_a_low_pass_of_a_ramp_lags_by_its_time_constant():
    time = np.linspace(0.0, 10.0, 101)
    slow = filter_low(time, time, 0.5)
    lag = 1.0 / (2.0 * math.pi * 0.5)
    exact = time - lag * (1.0 - np.exp(-time / lag))
    assert slow == pytest.approx(exact, abs=1e-12)


def test_a_limited_rate_lags_and_catches_up():
    """A jump by 2, then a ramp of 0.25/s, followed at 0.5/s: they meet after 8 s."""
    time = np.linspace(0.0, 10.0, 101)
    values = np.where(time > 0.0, 2.0 + 0.25 * time, 0.0)
    assert limit_rate(time, values, 0.5) == pytest.approx(np.minimum(0.5 * time, values), abs=1e-9)
    assert limit_rate(time, -values, 0.5) == pytest.approx(-limit_rate(time, values, 0.5))


def test_offsets_and_outliers_are_no_matter_of_the_parameters(tmp_path):
    axial, force = move(TIME)
    force = force + 150.0
    force[::25] += 4e3
    rig = write_rig(tmp_path / "rig.csv", histories=(axial, force))
    found = fit(rig, offsets=["capture.compression"], loss="soft_l1")
    assert_found(found, K, STIFFNESS)
    assert_found(found, C, DAMPING)
    offset = found.summary["by_test"]["rig"]["unknowns"]["offset of capture.compression"]
    assert offset["value"] == pytest.approx(150.0, abs=12.0)


def test_tests_have_conditions_of_their_own_and_may_be_held_back(tmp_path):
    speeds = {"slow": 0.06, "fast": 0.1, "other": 0.08}
    for seed, (name, speed) in enumerate(speeds.items()):
        write_rig(tmp_path / f"{name}.csv", seed, speed=speed, clock=seed)
    tests = tmp_path / "tests.toml"
    tests.write_text(
        '[[test]]\nfile = "slow.csv"\noutcome = "captured"\n'
        '[[test]]\nfile = "fast.csv"\noutcome = "rebound"\n'
        '[[test]]\nfile = "other.csv"\nheld_back = true\nset = {"initial.closing_speed" = 0.08}\n'
    )
    each = {"initial.closing_speed": (0.02, 0.15)}
    with pytest.raises(dl.UsageError, match=r"^vary_each initial\.closing_speed .*which DATA"):
        fit(tests, vary_each=each)
    tests.write_text(tests.read_text().partition('[[test]]\nfile = "other.csv"')[0])
    found = fit(tests, vary_each=each)
    assert_found(found, K, STIFFNESS)
    assert_found(found, C, DAMPING)
    for name in ("slow", "fast"):
        assert_found(found, f"initial.closing_speed @ {name}", speeds[name])
    outcomes = {name: row["outcome"] for name, row in found.summary["by_test"].items()}
    assert outcomes["slow"]["measured"] == "captured" != outcomes["slow"]["computed"]
    assert [row["agrees"] for row in outcomes.values()] == [False, True]


def test_a_capture_that_only_the_rig_had_is_named(tmp_path):
    head, *lines = write_rig(tmp_path / "rig.csv").read_text().splitlines()
    rows = [f"{line},{i > 200:d}" for i, line in enumerate(lines)]
    (tmp_path / "rig.csv").write_text("\n".join([f"{head},captured [1]", *rows]) + "\n")
    found = fit(tmp_path / "rig.csv")
    assert found.summary["by_test"]["rig"]["outcome"]["agrees"] is False
    assert "measured captured" in write_text(report_fit(found.summary))
    assert set(found.residuals["rig"]) == set(SIGMA)  # a choice has no residual


@pytest.mark.parametrize("options", [(), ("offset",), ("scale",), ("offset", "scale")], ids=str)
def test_a_test_that_is_held_back_is_predicted_within_its_band(tmp_path, options):
    """What sensors have of their own in each test follows from its own data, held back or not."""
    sensor = {name: value for name, value in (("offset", 0.02), ("scale", 1.1)) if name in options}
    data = []
    for seed, (name, speed) in enumerate({"slow": 0.06, "fast": 0.1, "other": 0.08}.items()):
        axial, force = move(TIME, speed)
        seen = sensor.get("scale", 1.0) * axial + sensor.get("offset", 0.0), force
        file = str(write_rig(tmp_path / f"{name}.csv", seed, seen, clock=seed))
        held = {"held_back": name == "other"}
        data.append({"file": file, "set": {"initial.closing_speed": speed}, **held})
    more = {f"{name}s": "relative.axial" for name in options}
    found = fit(*data, **more)
    for row in found.residuals["other"].values():
        assert row["in_band"] == pytest.approx(0.95, abs=0.03)
        assert row["rms_before"] > 2.0 * row["rms"]
    assert not found.summary["hidden"]
    unknowns = found.summary["by_test"]["other"]["unknowns"]
    true = {"shift": -2.0} | {f"{name} of relative.axial": sensor[name] for name in options}
    assert unknowns.keys() == true.keys()
    for name, value in true.items():
        assert abs(unknowns[name]["value"] - value) < 3.0 * unknowns[name]["deviation"], name
    without = fit(*data[:2], **more)
    assert found.values == pytest.approx(without.values, rel=1e-4)
    assert found.deviations == pytest.approx(without.deviations, rel=1e-3)


def test_what_is_not_known_of_a_held_back_sensor_widens_its_band():
    """One parameter, known to 0.1 by a fitted sample; two more samples share an unknown offset."""
    jacobian = np.array([[10.0, 0.0], [1.0, 1.0], [3.0, 1.0]])
    found = estimate(jacobian, 1, 1.0, 0.0, np.array([False, True, True]))
    assert found.covariance[0, 0] == pytest.approx(0.01)
    spread = np.einsum("ij,jk,ik->i", jacobian, found.covariance, jacobian)
    assert spread[1:] == pytest.approx([0.5 + 0.01] * 2)  # half of the noise, less the mean slope


def test_a_channel_that_only_a_held_back_test_has_is_not_judged_without_noise(tmp_path):
    """A prediction that is wrong by far has no band made of its own errors."""
    wrong = move(TIME)[0], 2.0 * move(TIME)[1]
    data = [
        {
            "file": str(write_rig(tmp_path / "rig.csv")),
            "columns": "capture.compression=",
        },
        {
            "file": str(write_rig(tmp_path / "other.csv", 1, wrong)),
            "held_back": True,
        },
    ]
    vary = {K: RANGES[K]}
    found = fit(*data, vary=vary)
    row = found.residuals["other"]["capture.compression"]
    assert (row["in_band"], row["noise"], row["noise_is"]) == (None, None, "not known")
    hidden = "".join(found.summary["hidden"])
    assert "no fitted test has it: state --noise capture.compression" in hidden
    assert "not judged" in write_text(report_fit(found.summary))
    found.plot()
    stated = fit(*data, vary=vary, noise=SIGMA)
    assert stated.residuals["other"]["capture.compression"]["in_band"] < 0.6
    assert not any("not judged" in each for each in stated.summary["hidden"])


# ------------------------------------------------------------------- 6. files and bad input


def test_the_command_reads_own_names_and_writes_a_copy_of_the_scene(dockloop, tmp_path):
    lines = write_rig(tmp_path / "rig.csv").read_text().splitlines()[1:]
    rows = (line.replace(",", ";").replace(".", ",") for line in lines)
    (tmp_path / "rig.csv").write_text("\n".join(["t;dx;Fz", *rows]) + "\n")
    words = ["--vary", K, "1e4", "4e4", "--vary", C, "2e3", "4e4"]
    columns = "t=time:s, dx=relative.axial:mm, Fz=capture.compression:kN"
    words += ["--scene", f"initial.approach_time={APPROACH}", "--columns", columns]
    more = ["-o", "fit.json", "--apply", "new.toml", "--report"]
    ran = dockloop.succeed("fit", "absorber_1d", tmp_path / "rig.csv", *words, *more)
    for text in ("Parameters", "deviation", "N s/m", "sep ';', decimal ','", "rms before"):
        assert text in ran.out
    found = json.loads((tmp_path / "fit.json").read_text())
    assert found["values"][C] == pytest.approx(DAMPING, rel=0.01)
    page = (tmp_path / "fit_report.html").read_text()
    assert "Correlations" in page
    assert "data:image/png" in page
    new = tomllib.loads((tmp_path / "new.toml").read_text())
    assert new["mechanism"]["set"]["contact.damping"] == found["values"][C]
    assert (
        dl.Scene(tmp_path / "new.toml").document["mechanism"]["contact"]["damping"]
        == (found["values"][C])
    )
    resumed = dockloop.read(
        "fit", "absorber_1d", tmp_path / "rig.csv", *words, *more, "--resume", "--json"
    )
    assert resumed["ran"] == 0
    assert resumed["values"] == found["values"]
    own = tmp_path / "own.toml"
    own.write_text("# mine\n")
    refused = dockloop("fit", "absorber_1d", tmp_path / "rig.csv", *words, "--apply", own)
    assert_refused(refused, "own.toml")
    assert own.read_text() == "# mine\n"


def test_cases_are_drawn_within_the_ranges_and_do_not_heap_at_bounds(tmp_path):
    """The range of the stiffness ends near the value; nothing determines the inertia."""
    top = STIFFNESS + 10.0
    vary = {K: (1e4, top), C: RANGES[C], "chaser.inertia[1]": (5e4, 9e4)}
    found = fit(write_rig(tmp_path / "rig.csv"), vary=vary)
    table = found.draw(4000, seed=1)
    assert table[K].max() < top
    assert table[K].nunique() == 4000
    inertia = np.sort((table["chaser.inertia[1]"] - 5e4) / 4e4)
    assert np.abs(inertia - np.linspace(0.0, 1.0, 4000)).max() < 0.03  # 1.63 / sqrt(4000): 1 %


def test_what_only_acts_together_is_drawn_together(tmp_path):
    vary = {**RANGES, "chaser.mass": (15e3, 40e3)}
    found = fit(write_rig(tmp_path / "rig.csv"), vary=vary, columns="capture.compression=")
    table = found.draw(500)
    for name, (low, high) in vary.items():
        assert table[name].between(low, high).all()
    assert table[K].std() > 0.5 * 12.0**-0.5 * 1e4
    reduced = 1.0 / (1.0 / table["chaser.mass"] + 1.0 / 350e3)
    ratio = table[K] / reduced  # nearly the same: differences follow a straight line
    assert ratio.std() < 0.1 * ratio.mean()


@pytest.mark.parametrize("name", ["accuracy", "solver.accuracy"])
def test_an_accuracy_that_is_set_holds(tmp_path, name):
    rig = write_rig(tmp_path / "rig.csv")
    more = {"overrides": {**LATER, name: 1e-4}}
    found = dl.fit("absorber_1d", rig, {K: RANGES[K]}, starts=1, **more)
    assert found.summary["set"]["accuracy"] == 1e-4
    with pytest.raises(dl.UsageError, match=f"accuracy: is given twice, {name} = 0.0001"):
        dl.fit("absorber_1d", rig, {K: RANGES[K]}, accuracy=1e-6, **more)


def test_a_copy_has_what_all_tests_share_and_the_rest_is_named(tmp_path, capsys):
    """Keys of the scene by overrides and by each test; paths and names with a star too."""
    write_rig(tmp_path / "rig.csv")
    common = {"initial.approach_time": APPROACH, "target.inertia": [5e7, 9e7, 9e7, 0, 0, 0]}
    tests = [
        {
            "file": str(tmp_path / "rig.csv"),
            "name": name,
            "set": common | {"initial.roll_deg": roll},
        }
        for name, roll in (("a", 0.0), ("b", 0.1))
    ]
    ranges = {C: RANGES[C]}
    found = dl.fit(
        "absorber_1d", tests, ranges, starts=1, start_values={"chaser.force_ext[1]": 0.0},
        overrides={K: STIFFNESS, "*.interface_attitude": [1, 0, 0, 0]},
    )  # fmt: skip
    capsys.readouterr()
    found.apply(tmp_path / "new.toml")
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "new.toml has no chaser.force_ext[1], initial.roll_deg: a copy holds" in said
    new = tomllib.loads((tmp_path / "new.toml").read_text())
    assert new["mechanism"]["set"] == {
        "contact.stiffness": STIFFNESS,
        "contact.damping": found.values[C],
    }
    assert new["initial"]["approach_time"] == APPROACH
    assert new["target"]["inertia"] == common["target.inertia"]
    assert (
        new["chaser"]["interface_attitude"] == new["target"]["interface_attitude"] == [1, 0, 0, 0]
    )
    assert found.summary["applied"]["shared"].keys() == {
        *common, K, "chaser.interface_attitude", "target.interface_attitude"
    }  # fmt: skip


@pytest.mark.parametrize(
    ("words", "refusal"),
    [
        (["--vary", K, "1e4", "4e4", "--plan", "--profile"], ["--profile", "plan"]),
        (["--vary", K, "1e4", "4e4", "--cases", "200000"], ["--cases", "200000", "100000"]),
        (["--vary-each", K, "1e4", "4e4", "--cases", "9"], ["--cases", "--vary"]),
        (["--vary", K, "1e4", "4e4", "--apply", "new.toml"], [K, "cannot be set in this file"]),
        (
            ["--vary", "chaser.part.1.mass", "1", "9", "--apply", "new.toml"],
            ["chaser.part.1.mass", "cannot be set in this file"],
        ),
        (["--vary", C, "2e3", "4e4", "--apply", "no/new.toml"], ["no mech.json", "next to"]),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_first_run(
    dockloop, tmp_path, monkeypatch, words, refusal
):
    monkeypatch.chdir(tmp_path)
    write_rig(tmp_path / "rig.csv")
    table = '[mechanism]\nname = "absorber_1d"\n'
    text = (ROOT / "modelDescription" / "scenes" / "absorber_1d.toml").read_text()
    if K in words:
        inline = 'mechanism = {name = "absorber_1d"}\n'
        text = text.replace(table, "").replace("[chaser]", f"{inline}[chaser]", 1)
    if C in words:
        shipped = ROOT / "modelDescription" / "mechanisms" / "absorber_1d.json"
        (tmp_path / "mech.json").write_text(shipped.read_text())
        text = text.replace(table, '[mechanism]\nname = "mech"\n')
    if "chaser.part.1.mass" in words:
        text += '[[chaser.part]]\nmass = 120.0\njoint = "slide"\naxis = [1, 0, 0]\n'
        text += "frequency = 1.0\n"
    (tmp_path / "own.toml").write_text(text)
    refused = dockloop("fit", "own.toml", "rig.csv", "-o", "fit.json", *words)
    assert_refused(refused, *refusal)
    assert not (tmp_path / "fit.jsonl").exists()
    assert not (tmp_path / "new.toml").exists()


def test_drawn_cases_have_the_covariance_and_run_as_a_sweep(tmp_path):
    found = fit(write_rig(tmp_path / "rig.csv"))
    table = found.draw(4000, seed=1)
    for name in RANGES:
        assert table[name].mean() == pytest.approx(found.values[name], abs=found.deviations[name])
        assert table[name].std() == pytest.approx(found.deviations[name], rel=0.1)
    assert table[K].corr(table[C]) == pytest.approx(found.correlations[K][C], abs=0.06)
    swept = dl.sweep({"scene": "absorber_1d", "set": LATER}, cases=table[:8])
    assert set(swept["status"]) == {"done"}
    _, force = move(np.linspace(0.0, 5.0, 10001))
    peaks = swept["capture.peak.compression"]
    assert peaks.mean() == pytest.approx(force.max(), rel=2e-3)
    assert 0.0 < peaks.std() < 2e-3 * force.max()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vary": {"contact.dampi": (1, 2)}}, ["contact.dampi", "neither a key"]),
        ({"vary": {C: (4e4, 2e3)}}, [C, "ascend"]),
        ({"vary": {C: (float("nan"), 2e3)}}, [C, "ascend"]),
        ({"vary": {}}, ["at least one"]),
        ({"vary": {C: 9e3}}, [C, "low and high"]),
        ({"vary": {"relative.axial": (0, 1)}}, ["relative.axial", "computed by the FMU"]),
        ({"overrides": {**LATER, C: 9e3}}, [C, "given twice"]),
        ({"vary": {C[:-3] + "*": (1, 2), C: (1, 2)}}, [C, "given twice"]),
        ({"vary": {C[:-3] + "*": (1, 2), C[:-7] + "*ing": (1, 2)}}, [C, "given twice"]),
        ({"vary": {C[:-3] + "*": (1, 2)}, "overrides": {C: 9e3}}, [C, "given twice"]),
        (
            {"vary": {C[:-3] + "*": (1, 2)}, "data": [{"file": "rig.csv", "set": {C: 9e3}}]},
            [C, "given twice"],
        ),
        ({"data": []}, ["at least one test is needed"]),
        ({"data": 5}, ["data has 5", "must be a path"]),
        ({"data": ["rig.csv", 5]}, ["data has 5", "must be a path"]),
        ({"vary": 5}, ["vary is 5", "must be a group"]),
        ({"overrides": 5}, ["overrides is 5", "must be a group"]),
        ({"filters": 5}, ["filters is 5", "must be a group"]),
        ({"noise": 5}, ["noise is 5", "must be a group"]),
        ({"scales": 5}, ["scales is 5", "must be a text"]),
        ({"columns": [5]}, ["columns is [5]", "must be a text"]),
        ({"offsets": "relative.axal"}, ["relative.axal", "no test"]),
        ({"text": ""}, ["rig.csv"]),
        ({"text": "time [s],relative.axial [m]\n"}, ["rig.csv"]),
        ({"text": "time [s],relative.axal [m]\n0,1\n1,1\n"}, ["relative.axal"]),
        ({"text": "time [s],captured\n0,0\n1,1\n"}, ["no channel to fit"]),
        ({"text": "time [s],relative.axial [m]\n0,nan\n1,nan\n"}, ["no values"]),
        ({"text": "time [s],relative.axial [m]\n0,inf\n1,0\n"}, ["finite"]),
        ({"shift": 100.0}, ["100 s", "fall into the run"]),
        ({"shift": math.nan}, ["shift", "finite"]),
        ({"noise": {"relative.axial": 0.0}}, ["relative.axial", "above 0"]),
        ({"noise": {"capture.tension": 1.0}}, ["capture.tension", "no test"]),
        ({"filters": {"relative.axial": -1.0}}, ["relative.axial", "above 0"]),
        ({"offsets": ["relative.axal"]}, ["relative.axal", "no test"]),
        ({"rate_limits": {"relative.axial": 0.0}}, ["rate_limits", "relative.axial", "above 0"]),
        ({"rate_limits": {"relative.axal": 1.0}}, ["rate_limits", "relative.axal", "no test"]),
        ({"loss": "cubic"}, ["cubic", "soft_l1"]),
        ({"starts": 0}, ["starts", "1 to"]),
        ({"accuracy": 0.5}, ["0.5", "at most 0.01"]),
        ({"data": [{"file": "rig.csv", "sat": {}}]}, ["sat", "set"]),
        ({"data": [{"file": "rig.csv", "outcome": "caught"}]}, ["caught", "captured"]),
        ({"data": [{"name": "one"}]}, ["lacks 'file'"]),
        ({"data": ["rig.csv", "rig.csv"]}, ["two tests", "rig"]),
    ],
    ids=lambda value: str(value)[:40] if isinstance(value, dict) else "",
)
def test_bad_input_is_refused_in_one_sentence(tmp_path, monkeypatch, change, words):
    monkeypatch.chdir(tmp_path)
    change = dict(change)
    rig = write_rig(tmp_path / "rig.csv")
    if "text" in change:
        rig.write_text(change.pop("text"))
    given = {"data": "rig.csv", "vary": RANGES, "overrides": LATER} | change
    with pytest.raises(dl.UsageError) as error:
        dl.fit("absorber_1d", given.pop("data"), given.pop("vary"), **given)
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ("rig.csv", "--vary", "chaser.mass", "-5", "-1"),
            "no start can be run, for example: --vary chaser.mass -5 -1: chaser.mass is -3.0",
        ),
        (
            ("rig.csv", "--vary", "chaser.inertia.3", "1e9", "2e9"),
            "no start can be run, for example: --vary chaser.inertia.3 1e+09 2e+09: chaser.inertia",
        ),
        (
            ("rig.toml", "--vary", "chaser.mass", "1e4", "5e4", "--plan"),
            "test 'rig' cannot be run: DATA: set 'target.mass': target.mass is -1: must be",
        ),
    ],
)
def test_a_fit_whose_starts_are_all_refused_leaves_nothing(dockloop, tmp_path, words, sentence):
    write_rig(tmp_path / "rig.csv")
    (tmp_path / "rig.toml").write_text(
        '[[test]]\nname = "rig"\nset = {"target.mass" = -1}\n'
        'noise = {"capture.compression" = 1.0}\n'
    )
    refused = dockloop("fit", "absorber_1d", *words, "-o", "own.json")
    assert_refused(refused, f"dockloop: {sentence}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.csv", "rig.toml"]
