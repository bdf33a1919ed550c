"""``dockloop fit`` of dockings with legs and impacts.

1. How many runs a fit takes, what impacts hide, boundaries of capture and refused runs on the way;
2. data of runs with 32 digits, seen by a rig: within their intervals.
"""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import dockloop as dl
from dockloop.base.sections import write_text
from dockloop.runs.solution import make_solution
from dockloop.studies.fits.report import report_fit
from fit_rig import (
    CLOCK,
    DAMPING,
    DOCKING,
    FRICTION,
    LATER,
    LEGS,
    RANGES,
    SIGMA,
    SPEED,
    STIFFNESS,
    C,
    K,
    assert_found,
    fit,
    write_rig,
)

# ----------------------------------------------------------------------- 1. runs

HARDWARE = {LEGS: 1300.0, FRICTION: 0.16}
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


# ------------------------------------------------------------------------------ 2. 32 digits

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
