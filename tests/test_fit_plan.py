"""``dockloop fit --plan``: what tests would say, before they are measured.

Plans expect the deviations of the closed form, and those that fits then have.
"""

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.sections import write_text
from dockloop.studies.fits.report import report_fit
from fit_rig import (
    APPROACH,
    DOCKING,
    LATER,
    RANGES,
    SIGMA,
    SPEED,
    STIFFNESS,
    C,
    K,
    assert_found,
    fit,
    move,
    write_rig,
)


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
