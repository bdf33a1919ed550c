"""``dockloop fit``: parameters from measurements with their uncertainty.

The data are those of a spring and a damper between two masses, in closed form or by another engine
(MuJoCo, `data/measured_mujoco.py`), with noise, another clock, another rate and names of a rig. So
the numbers to be found are known. What is not known to the fit:

1. values, deviations and time shift: within their intervals, as often as these say;
2. what data cannot determine is named: one parameter, or some that only act together;
3. the worst pair has a profile;
4. a law of another kind (dry friction in place of a damper) is noticed, noise is not;
5. filters, offsets, scales, outliers, own values of each test, tests that are held back;
6. plans expect the deviations that fits then have;
7. copies of the scene, journals, bad input;
8. dockings with six legs and impacts: how many runs a fit takes, and what these hide;
9. data of runs with 32 digits, seen by a rig.
"""

import importlib.util
import json
import math
import tomllib

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import dockloop as dl
from dockloop.base.paths import ROOT
from dockloop.base.sections import write_text
from dockloop.runs.solution import make_solution
from dockloop.studies.fits.problem import filter_low, limit_rate
from dockloop.studies.fits.report import report_fit
from dockloop.studies.fits.statistics import estimate
from test_cli import assert_refused

RIG = ROOT / "tests" / "data" / "measured_mujoco.csv"
MASS = 25e3 * 350e3 / 375e3
STIFFNESS, DAMPING = 23e3, 9e3  # N/m, N s/m: of the rig, not of the scene
APPROACH = 0.5  # s
K, C = "mechanism.set.contact.stiffness", "mechanism.set.contact.damping"
RANGES = {K: (1e4, 4e4), C: (2e3, 4e4)}
LATER = {"initial.approach_time": APPROACH}
SIGMA = {"relative.axial": 3e-4, "capture.compression": 20.0}  # m, N
TIME = np.arange(0.3, 4.5, 0.0137)  # s, of the run at the samples of the rig
CLOCK = 3.21  # s, of the rig when the run starts


def move(time, speed=0.1, stiffness=STIFFNESS, damping=DAMPING):
    """Distance along the axis [m] and compression [N] of the absorber, in closed form."""
    s = 0.5 * damping / MASS
    w = math.sqrt(stiffness / MASS - s**2)
    t = np.maximum(time - APPROACH, 0.0)
    depth = speed / w * np.exp(-s * t) * np.sin(w * t)
    rate = speed * np.exp(-s * t) * (np.cos(w * t) - s / w * np.sin(w * t))
    force = stiffness * depth + damping * rate
    end = (math.pi - math.atan2(2.0 * s * w, w**2 - s**2)) / w  # F = 0
    out = (
        np.exp(-s * end)
        * speed
        * np.array([math.sin(w * end) / w, math.cos(w * end) - s / w * math.sin(w * end)])
    )
    depth = np.where(t < end, depth, out[0] + out[1] * (t - end))
    depth = np.where(time < APPROACH, speed * (time - APPROACH), depth)
    return -depth, np.where((time < APPROACH) | (t >= end), 0.0, force)


def rub(time, friction=300.0):
    """Move with dry friction, and no damper, by another integrator."""

    def slope(_, y):
        sign = math.tanh(y[1] / 1e-4)
        force = max(STIFFNESS * y[0] + friction * sign, 0.0) if y[0] > 0.0 else 0.0
        return [y[1], -force / MASS]

    start = APPROACH
    done = solve_ivp(slope, (0, 5), [0.0, 0.1], max_step=1e-3)
    depth, rate = (np.interp(time - start, done.t, y) for y in done.y)
    force = np.maximum(STIFFNESS * depth + friction * np.tanh(rate / 1e-4), 0.0)
    depth = np.where(time < start, 0.1 * (time - start), depth)
    return -depth, np.where((time < start) | (depth <= 0.0), 0.0, force)


def write_rig(path, seed=2, histories=None, clock=CLOCK, **hardware):
    """Write the table of a test: mm and kN, another clock, 73 Hz, noise."""
    draw = np.random.default_rng(seed)
    axial, force = histories or move(TIME, **hardware)
    rows = zip(
        TIME + clock,
        1e3 * (axial + SIGMA["relative.axial"] * draw.normal(size=len(TIME))),
        1e-3 * (force + SIGMA["capture.compression"] * draw.normal(size=len(TIME))),
        strict=True,
    )
    lines = [f"{t:.5f},{x:.5f},{f:.6f}" for t, x, f in rows]
    head = "time [s],relative.axial [mm],capture.compression [kN]"
    path.write_text("\n".join([head, *lines]) + "\n")
    return path


def fit(*data, vary=None, starts=1, **more):
    found = dl.fit("absorber_1d", data, vary or RANGES, overrides=LATER, starts=starts, **more)
    assert all(math.isfinite(value) for value in found.values.values())
    return found


def assert_found(found, name, value, sigmas=3.0):
    deviation = found.deviations[name]
    assert abs(found.values[name] - value) < sigmas * deviation, (name, found.values, deviation)


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
    """From a stiffness that is far away the search finds a shift at which 16 of 307 are left."""
    rig = write_rig(tmp_path / "rig.csv")
    vary = {K: (STIFFNESS + 500.0, 1e5), C: RANGES[C]}
    found = fit(rig, vary=vary)
    counted = found.residuals["rig"]["relative.axial"]["samples"]
    assert counted < 0.5 * len(TIME)
    assert f"only {counted} of {len(TIME)} samples" in found.summary["hidden"][0]
    stated = fit(rig, vary=vary, shift=-CLOCK)
    assert stated.summary["at_bound"] == [K]
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
    with pytest.raises(dl.UsageError, match="vary 'test' decides already"):
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


# ------------------------------------------------------------------------------- 6. plans


def test_a_plan_expects_the_deviations_of_the_closed_form():
    """Samples next to the jump of the force at the contact do not count."""
    time = np.arange(0.0, 4.5, 0.0137)
    inside = np.abs(time - APPROACH) > 0.02

    def see(stiffness, damping, shift):
        seen = move(time + shift, stiffness=stiffness, damping=damping)
        return np.concatenate([x[inside] / s for x, s in zip(seen, SIGMA.values(), strict=True)])

    tests = [{"name": "rig", "noise": SIGMA}]
    planned = dl.plan_fit("absorber_1d", tests, RANGES, overrides=LATER, stop=4.5, step=0.0137)
    own = np.array([*planned["scene_values"].values(), 0.0])
    ways = np.diag([1.0, 1.0, 1e-4])
    slopes = np.transpose([(see(*(own + w)) - see(*(own - w))) / (2.0 * w.sum()) for w in ways])
    wanted = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))[:2]
    found = list(planned["by_test"]["rig"]["deviations"].values())
    assert found == pytest.approx(wanted, rel=0.01)


def test_a_plan_says_what_tests_determine_only_together():
    """As a fit of their data would: motions alone are the same with all masses and laws doubled."""
    vary = {**RANGES, "chaser.mass": (15e3, 40e3)}
    motion = {"relative.axial": SIGMA["relative.axial"]}
    tests = [{"name": "motion", "noise": motion}, {"name": "load", "noise": SIGMA}]
    planned = dl.plan_fit("absorber_1d", tests, vary, overrides=LATER)
    alone = planned["by_test"]["motion"]
    assert set(alone["deviations"].values()) == {None}
    assert {name for row in alone["not_identified"] for name in row["parameters"]} == set(vary)
    assert not planned["not_identified"]
    assert planned["order"][0]["test"] == "load"
    assert set(planned["best"].values()) == {"load"}
    text = write_text(report_fit(planned))
    assert "not identified, by motion alone" in text
    assert "only together" in text


def test_a_plan_knows_what_tests_and_sensors_do_not_know():
    """A factor of the load cell hides all masses; a speed of its own belongs to one test."""
    tests = [
        {"name": "a", "noise": SIGMA, "outcome": "captured"},
        {"name": "b", "noise": SIGMA, "held_back": True},
    ]
    planned = dl.plan_fit(
        "absorber_1d", tests, {"chaser.mass": (15e3, 40e3), **RANGES}, overrides=LATER,
        vary_each={SPEED: (0.05, 0.2)}, scales="capture.compression",
    )  # fmt: skip
    assert planned["by_test"]["a"]["deviations"][f"{SPEED} @ b"] is None
    assert planned["best"] == {f"{SPEED} @ {name}": name for name in "ab"}
    together = {name for row in planned["not_identified"] for name in row["parameters"]}
    assert together == {"chaser.mass", *RANGES}
    assert "outcome of 'a': measured captured" in write_text(report_fit(planned))


def test_a_plan_of_a_load_between_samples_says_so():
    tests = [{"name": "load", "noise": {"capture.compression": 20.0}}]
    planned = dl.plan_fit("idss_25t_350t", tests, DOCKING, stop=4, step=0.02)
    assert set(planned["by_test"]["load"]["deviations"].values()) == {None}
    assert "between two samples" in planned["hidden"][0]


def test_a_plan_names_no_best_test_of_what_none_determines():
    vary = {K: RANGES[K], "chaser.inertia[2]": (1e5, 2e5)}
    planned = dl.plan_fit("absorber_1d", {"name": "a", "noise": SIGMA}, vary, overrides=LATER)
    assert planned["best"] == {K: "a"}
    text = write_text(report_fit(planned))
    assert f"a says most about {K}" in text
    assert "says most about chaser.inertia[2]" not in text


def test_a_value_is_at_a_bound_if_it_could_be_on_it(tmp_path):
    """A value close to the end of a wide range, but many deviations away, and one beyond it."""
    rig = write_rig(tmp_path / "rig.csv")
    far = fit(rig, vary={K: (1e4, 1e7), C: RANGES[C]})
    assert_found(far, K, STIFFNESS)
    assert not far.summary["at_bound"]
    near = fit(rig, vary={K: (STIFFNESS + 500.0, 5e4), C: RANGES[C]})
    assert near.summary["at_bound"] == [K]


def test_a_plan_at_a_value_outside_of_its_range_is_refused():
    """The scene has a stiffness of 20e3 N/m."""
    with pytest.raises(dl.UsageError) as error:
        dl.plan_fit("absorber_1d", {"noise": SIGMA}, {K: (3e4, 4e4)})
    for word in (K, "30000", "40000", "20000", "outside"):
        assert word in str(error.value)


def test_a_plan_expects_the_deviations_of_the_fit(tmp_path):
    tests = [
        {"name": "slow", "set": {"initial.closing_speed": 0.03}, "noise": SIGMA},
        {"name": "fast", "set": {"initial.closing_speed": 0.1}, "noise": SIGMA},
    ]
    found = fit(write_rig(tmp_path / "rig.csv"), noise=SIGMA)
    found.apply(tmp_path / "fitted.toml")  # where derivatives are those of the plan
    planned = dl.plan_fit(
        tmp_path / "fitted.toml", tests, RANGES, overrides=LATER, stop=4.5, step=0.0137
    )
    assert planned["order"][0]["test"] == "fast"
    assert set(planned["best"].values()) == {"fast"}
    expected = planned["by_test"]["fast"]["deviations"]
    for name in RANGES:  # the rig has 307 samples, the plan 329
        assert found.deviations[name] == pytest.approx(expected[name], rel=0.1)
        together = planned["order"][1]["deviations"][name]
        assert together < min(expected[name], planned["by_test"]["slow"]["deviations"][name])
        channels = planned["by_test"]["fast"]["channels"]
        assert expected[name] < min(row[name] for row in channels.values())


# ------------------------------------------------------------------- 7. files and bad input


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


# ----------------------------------------------------------------------- 8. dockings with legs

LEGS, FRICTION = "mechanism.set.leg_defaults.damping", "friction.coefficient"
HARDWARE = {LEGS: 1300.0, FRICTION: 0.16}
DOCKING = {LEGS: (200.0, 3000.0), FRICTION: (0.0, 0.4)}
SIGMAS = SIGMA | {"relative.lateral": 3e-4}  # m


@pytest.fixture(scope="module")
def docked():
    return dl.run(
        "idss_25t_350t", overrides={LEGS: 1300.0}, start_values={FRICTION: 0.16}, stop=6, step=2e-3
    )


def write_docking(path, run, names, seed, step=0.0137):
    """Write what sensors of a rig saw of a run: noise, another clock, another rate."""
    draw = np.random.default_rng(seed)
    time = np.arange(0.3, run.time[-1] - 0.3, step)
    noise = {name: SIGMAS[name] * draw.normal(size=len(time)) for name in names}
    columns = [np.interp(time, run.time, run[name]) + noise[name] for name in names]
    head = ",".join(["time [s]", *(f"{n} [{run.units[n]}]" for n in names)])
    np.savetxt(path, np.transpose([time + CLOCK, *columns]), "%.9g", ",", header=head, comments="")
    return path


@pytest.mark.parametrize(
    ("second", "most"), [("relative.lateral", 16), ("capture.compression", 34)]
)
def test_a_fit_of_a_docking_takes_few_runs(tmp_path, docked, second, most):
    """By hand (least_squares, differences for each): 24 runs; with the load 56, 30 sigma off."""
    rig = write_docking(tmp_path / "rig.csv", docked, ["relative.axial", second], seed=1)
    found = dl.fit("idss_25t_350t", rig, DOCKING, stop=6)
    for name, value in HARDWARE.items():
        assert_found(found, name, value)
    shift = found.summary["by_test"]["rig"]["unknowns"]["shift"]
    assert abs(shift["value"] + CLOCK) < 3.0 * shift["deviation"]
    assert found.summary["starts"] == {"captured": 1}  # no doubt, so no other start
    assert found.summary["runs"] <= most


def test_four_parameters_of_three_dockings_take_few_runs(tmp_path):
    """Twenty-two points of three tests: some 8 s of processor."""
    spring, offset = "mechanism.set.leg_defaults.stiffness", "initial.lateral_offset"
    hardware = {LEGS: 1300.0, spring: 1900.0, SLIDING: 0.16}
    data = []
    for seed, speed in enumerate((0.05, 0.06, 0.08)):
        run = dl.run("idss_25t_350t", overrides={**hardware, SPEED: speed}, stop=6, step=2e-3)
        names = ["relative.axial", "relative.lateral"]
        file = write_docking(tmp_path / f"{seed}.csv", run, names, seed)
        data.append({"file": str(file), "set": {SPEED: speed}})
    ranges = {LEGS: (200.0, 3000.0), spring: (500.0, 1e4), SLIDING: (0.0, 0.4), offset: (0.0, 0.1)}
    found = dl.fit("idss_25t_350t", data, ranges, stop=6)
    for name, value in {**hardware, offset: 0.05}.items():
        assert_found(found, name, value)
    assert not found.summary["hidden"]
    assert found.summary["runs"] <= 80


def test_a_load_with_impacts_alone_ends_in_no_false_valley(tmp_path, docked):
    """Impacts of 5 to 11 ms. Without means over time 57 runs and more ended 30 sigma off."""
    names = ["capture.compression"]
    rig = write_docking(tmp_path / "rig.csv", docked, names, seed=1, step=2e-3)
    found = dl.fit("idss_25t_350t", rig, DOCKING, stop=6)
    for name, value in HARDWARE.items():
        assert_found(found, name, value)
    assert found.summary["starts"] == {"captured": 1}
    assert not found.summary["hidden"]
    assert found.summary["runs"] <= 45


def test_impacts_between_two_samples_leave_no_deviation(tmp_path, docked):
    """At 73 Hz most impacts fall between samples, so valleys are left: which one is not known."""
    for channels in (["capture.compression"], ["relative.axial", "capture.compression"]):
        rig = write_docking(tmp_path / "rig.csv", docked, channels, seed=1)
        found = dl.fit("idss_25t_350t", rig, DOCKING, stop=6, starts=1)
        is_alone = len(channels) == 1
        assert any("between two samples" in s for s in found.summary["hidden"]) == is_alone
        assert all((by is None) == is_alone for by in found.deviations.values())


SPEED = "initial.closing_speed"


@pytest.mark.parametrize(
    ("speed", "ends", "start", "outcome"),
    [(0.018, (5e-3, 0.06), "captured", "undecided"), (0.024, (0.0, 0.03), "undecided", "captured")],
)
def test_a_search_crosses_the_boundary_of_capture(tmp_path, speed, ends, start, outcome):
    """Dockings of 8 s at less than 0.02 m/s are not captured. Searches begin elsewhere."""
    made = {"overrides": {SPEED: speed}, "start_values": {FRICTION: 0.16}}
    run = dl.run("idss_25t_350t", **made, stop=8, step=2e-3)
    file = write_docking(tmp_path / "rig.csv", run, ["relative.axial", "relative.lateral"], seed=1)
    data = {"file": str(file), "outcome": outcome}
    found = dl.fit("idss_25t_350t", data, {SPEED: ends, FRICTION: (0.0, 0.4)}, stop=8)
    assert start in found.summary["starts"]
    assert found.summary["by_test"]["rig"]["outcome"]["agrees"]
    assert_found(found, SPEED, speed)
    assert_found(found, FRICTION, 0.16)


@pytest.mark.parametrize(
    ("speed", "ends"), [(0.06, (-0.15, 0.09)), (0.01, (-0.15, 0.15)), (0.02, (-0.15, 0.15))]
)
def test_a_search_goes_around_what_is_refused(tmp_path, speed, ends):
    """Negative speeds are refused: at the first start, or at a step from there.

    With the third one, the first search ends at a shift that leaves no sample in the run.
    """
    rig = write_rig(tmp_path / "rig.csv", speed=speed)
    found = fit(rig, vary={**RANGES, SPEED: ends}, starts=8)
    for name, value in ((SPEED, speed), (K, STIFFNESS), (C, DAMPING)):
        assert_found(found, name, value)
    assert "closing_speed is -" in found.summary["not_done"][0]
    assert "runs were not done" in write_text(report_fit(found.summary))
    assert not found.summary["hidden"]


def test_a_search_compares_what_it_found_with_runs_of_another_length(tmp_path):
    """A first result in doubt, whose runs ended with the data; those of the next starts do not."""
    rig = write_rig(tmp_path / "rig.csv", speed=0.02)
    vary = {SPEED: (-0.15, 0.15), **RANGES}
    found = fit(rig, vary=vary, columns="capture.compression=", starts=3)
    assert sum(found.summary["starts"].values()) == 3
    for name, value in ((SPEED, 0.02), (K, STIFFNESS), (C, DAMPING)):
        assert_found(found, name, value)


# ------------------------------------------------------------------------------ 9. 32 digits

OFFSETS = {"capture.compression": 150.0, "relative.lateral": 5e-3}  # N, m
SLIDING = "contact.friction_coefficient"
RIGS = {  # by scene: a second channel, the hardware with its ranges, what is known
    "absorber_1d": (
        "capture.compression:kN", {K: (STIFFNESS, RANGES[K]), C: (DAMPING, RANGES[C])},
        {"overrides": LATER, "stop": 5.0},
    ),
    "idss_25t_350t": (
        "relative.lateral:mm", {LEGS: (1300.0, DOCKING[LEGS]), SLIDING: (0.16, DOCKING[FRICTION])},
        {"overrides": {}, "stop": 4.0},
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "scene", ["absorber_1d", pytest.param("idss_25t_350t", marks=pytest.mark.long)]
)
def test_numbers_behind_a_run_with_32_digits_are_in_their_intervals(tmp_path, scene):
    """Resampled, with noise, a clock of its own and an offset, in columns with names of a rig."""
    second, varied, more = RIGS[scene]
    hardware = {name: value for name, (value, _) in varied.items()}
    ranges = {name: ends for name, (_, ends) in varied.items()}
    names = ["relative.axial", second.partition(":")[0]]
    overrides = [f"{name}={value!r}" for name, value in (hardware | more["overrides"]).items()]
    solution = make_solution(scene, names, overrides=overrides, stop=more["stop"], step=5e-3)
    time = np.arange(0.3, more["stop"] - 0.3, 0.0137)
    clean = [CubicSpline(solution["time"], solution["output"][name])(time) for name in names]
    clean[1] = clean[1] + OFFSETS[names[1]]
    units = np.array([[1e3], [1e-3 if second.endswith("kN") else 1e3]])
    inside = dict.fromkeys((*hardware, "shift", "offset"), 0)
    for seed in range(20):
        noise = np.random.default_rng(200 + seed).normal(size=(2, len(time)))
        seen = units * (clean + noise * [[SIGMAS[name]] for name in names])
        table = np.transpose([time + CLOCK, *seen])
        np.savetxt(tmp_path / "rig.csv", table, "%.9g", ";", header="clock;dx;other", comments="")
        found = dl.fit(
            scene, tmp_path / "rig.csv", ranges, **more, offsets=names[1],
            columns=f"clock=time:s, dx=relative.axial:mm, other={second}",
        )  # fmt: skip
        for name, value in hardware.items():
            low, high = found.summary["intervals"][name]
            inside[name] += low <= value <= high
        unknowns = found.summary["by_test"]["rig"]["unknowns"]
        wanted = {"shift": -CLOCK, f"offset of {names[1]}": OFFSETS[names[1]]}
        for name, value in wanted.items():
            by = unknowns[name]
            inside[name.split()[0]] += abs(by["value"] - value) < 1.96 * by["deviation"]
        assert not found.summary["hidden"]
    assert min(inside.values()) >= 16, inside  # of 20: fewer happen once in 400
