"""Whole dockings through the FMU: captured or not, and do energy and momentum add up.

Outcomes near the boundary of the capture envelope are sensitive to everything; the cases here lie
well inside or well outside.
"""

import numpy as np
import pytest

import dockloop as dl
from conftest import SCENES
from dockloop.base.sections import write_text
from dockloop.native.core import list_loads
from dockloop.report.run import report_run
from dockloop.result.summary import relative_energy, summarise

DEFAULT = "idss_25t_350t"
MOMENTUM_LIMIT = 1e-10  # relative
ENERGY_LIMIT = 3e-6  # of the initial relative energy: one step over a corner of a law may take two

# No misalignment at all: what a test then adds is the only one.
ALIGNED = (
    "initial.lateral_offset=0",
    "initial.pitch_yaw_deg=0",
    "initial.roll_deg=0",
    "initial.lateral_speed=0",
    "initial.pitch_yaw_rate_deg_s=0",
    "initial.roll_rate_deg_s=0",
    "initial.approach_time=0.5",
)


def assert_audited(run):
    assert np.max(run["momentum.residual"]) < MOMENTUM_LIMIT
    assert np.max(np.abs(run["energy.residual"])) < ENERGY_LIMIT * relative_energy(run)
    assert np.max(run["solver.closure_residual"]) < 1e-12


@pytest.mark.parametrize("scene", SCENES)
def test_energy_and_momentum_add_up_in_every_shipped_scene(runs, scene):
    run = runs.run(scene)
    assert np.all(np.isfinite(run.values))
    energy = relative_energy(run)
    if scene == "gripper":  # motors put 44 J into its springs, the vehicles bring 0.25 J
        energy = np.max(run["energy.drive_work"])
    assert np.max(np.abs(run["energy.residual"])) < ENERGY_LIMIT * energy
    if scene != "hexapod_bench":  # its base is held: momentum is not kept
        assert np.max(run["momentum.residual"]) < MOMENTUM_LIMIT


@pytest.mark.parametrize("speed", ["0.05", "0.10"])
def test_the_default_docking_captures_at_both_ends_of_the_speed_band(runs, speed):
    run = runs.run(DEFAULT, f"initial.closing_speed={speed}")
    summary = summarise(run)
    assert summary["outcome"] == "captured", write_text(report_run(summary))
    assert summary["time_of_contact"] == pytest.approx(2.0, abs=2e-3)
    assert summary["time_of_capture"] > summary["time_of_contact"]
    assert_audited(run)


def test_the_start_is_placed_so_that_the_conditions_hold_at_first_contact(runs):
    run = runs.run(DEFAULT)
    before = np.flatnonzero(run["time"] < run["time_of_contact"][-1])[-1]
    assert run["relative.lateral"][before] == pytest.approx(0.05, abs=2e-3)
    assert np.degrees(run["relative.pitch_yaw"][before]) == pytest.approx(1.5, abs=0.02)
    assert np.degrees(abs(run["relative.roll"][before])) == pytest.approx(1.5, abs=0.02)
    assert run["relative.velocity[1]"][before] == pytest.approx(-0.10, abs=1e-6)
    assert run["gap"][before] == pytest.approx(0.0, abs=2e-3)
    assert np.hypot(*run.vector("relative.velocity")[before, 1:]) == pytest.approx(0.01, abs=1e-6)


@pytest.mark.parametrize("scene", [DEFAULT, "idss_100t_100t", "hexapod", "apda", "apda_cranks"])
def test_a_ring_attenuates_in_front_of_the_mating_plane(runs, scene):
    """A and P coincide when the vehicles are docked, so nothing passes them before."""
    run = runs.run(scene)
    assert run["captured"][-1]
    assert np.min(run["relative.axial"]) > 0.0
    assert run["ring.position[1]"][0] > 0.249  # home
    assert np.min(run["ring.position[1]"]) > 0.0


def test_peaks_are_no_smaller_than_samples_and_within_the_ratings(runs):
    run = runs.run(DEFAULT)
    for load in list_loads():  # samples and peaks are values of one solution, good to rtol
        largest = np.max(np.abs(run[f"capture.{load}"]))
        assert run[f"capture.peak.{load}"][-1] >= largest * (1.0 - 1e-6)
    assert run["capture.peak.load_ratio"][-1] < 1.0


def test_a_lateral_offset_of_0_45_m_does_not_capture(runs):
    run = runs.run(DEFAULT, *ALIGNED, "initial.lateral_offset=0.45")
    assert not run["captured"][-1]
    assert summarise(run)["outcome"] != "captured"
    assert_audited(run)


def test_the_peak_load_grows_with_the_closing_speed(runs):
    peaks = []
    for speed in ("0.05", "0.07", "0.10"):
        run = runs.run(DEFAULT, *ALIGNED, f"initial.closing_speed={speed}", stop=5.0)
        assert run["captured"][-1]
        assert_audited(run)
        peaks.append(run["capture.peak.compression"][-1])
    assert peaks == sorted(peaks)
    assert peaks[2] == pytest.approx(2.0 * peaks[0], rel=0.1)


@pytest.mark.parametrize("offset", ["0", "0.1", "0.2"])
def test_nothing_slips_through_at_1_m_per_s(runs, offset):
    overrides = ("initial.closing_speed=1.0", f"initial.lateral_offset={offset}")
    run = runs.run(DEFAULT, *ALIGNED, *overrides, stop=2.0)
    assert np.max(run["contact.depth_ratio"]) < 1.0
    assert np.min(run["relative.axial"]) > -0.47  # the ring stays in front of its base joints
    assert_audited(run)


def test_post_contact_thrust_presses_harder_and_stops_at_capture(runs):
    plain = runs.run(DEFAULT, "initial.closing_speed=0.05")
    overrides = ("initial.closing_speed=0.05", "chaser.contact_thrust=1500")
    pushed = runs.run(DEFAULT, *overrides, "chaser.contact_thrust_delay=0.3")
    assert pushed["captured"][-1]
    assert pushed["capture.peak.compression"][-1] > 1.2 * plain["capture.peak.compression"][-1]
    t, work = pushed["time"], pushed["energy.external"]
    before = t <= pushed["time_of_contact"][-1] + 0.29
    after = t >= pushed["time_of_capture"][-1]
    assert np.max(np.abs(work[before])) < 1e-9
    assert work[-1] > 1.0
    assert np.ptp(work[after]) < 1.0  # J: at most what is left of one step
    assert_audited(pushed)


def test_orbital_positions_and_speeds_change_nothing_that_matters(runs):
    here = runs.run(DEFAULT, stop=4.0)
    shifts = {"position": 7.0e6, "velocity": 7.5e3}
    start = {
        f"{vehicle}.{name}[2]": here[f"{vehicle}.{name}[2]"][0] + shift
        for vehicle in ("chaser", "target")
        for name, shift in shifts.items()
    }
    settings = tuple(f"{name}={float(value)!r}" for name, value in start.items())
    there = runs.run(DEFAULT, settings=settings, stop=4.0)
    difference = there.vector("relative.position") - here.vector("relative.position")
    # 7e6 m + 7.5e3 m/s t resolves 1e-9 m; contacts multiply that.
    assert np.max(np.abs(difference)) < 1e-6


def test_the_summary_says_in_words_what_happened(runs):
    run = runs.run(DEFAULT)
    text = write_text(report_run(summarise(run)))
    for word in (
        "captured at",
        "first contact at",
        "compression",
        "of the rated",
        "audit",
        "times",
    ):
        assert word in text


def test_signs_of_quaternions_in_a_spin_of_several_turns():
    """Attitudes of vehicles are continuous; w of relative attitudes is never negative.

    A host that differences attitudes needs that: github.com/gazebosim/gz-sim/pull/3834.
    """
    spin = {"chaser.angular_velocity": [0.5, 0.3, 0.1], "chaser.velocity": [-0.3, 0.0, 0.0]}
    result = dl.run(DEFAULT, start_values=spin, stop=60.0, step=0.5)
    attitude = result["chaser.attitude"]
    half_turn = 0.5 * 0.5 * np.linalg.norm(spin["chaser.angular_velocity"])  # of one step [rad]
    assert np.all(np.sum(attitude[1:] * attitude[:-1], axis=1) > np.cos(1.2 * half_turn))
    assert attitude[:, 0].min() < -0.9
    assert result["relative.attitude"][:, 0].min() >= 0.0
    assert np.allclose(np.linalg.norm(result["relative.attitude"], axis=1), 1.0, atol=1e-15)
