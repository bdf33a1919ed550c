"""Why a docking was captured or not: the sentence, in the summary of a run and in a sweep."""

import json
import re

import pyarrow.parquet
import pytest

from dockloop.result.capture import explain_capture, list_needed
from light_vehicles import write_light_scene


def make_values(reason, held=(0, 0, 0), **others):
    values = {"capture.reason": reason, "capture.seated_time": 4.86}
    for i, holds in enumerate(held, 1):
        values[f"latched[{i}]"] = holds
        values[f"latch[{i}].opening"] = 0.003 * i
        values[f"latch[{i}].lateral"] = 0.001 * i
        values[f"latch[{i}].window"] = 0.025
        values[f"contact.petal[{i}].force"] = 0.0
    return {**values, **others}


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (make_values(1, (1, 1, 1)), "captured"),
        (make_values(2), "not captured: no contact so far"),
        (
            make_values(3, (1, 0, 1)),
            "not captured yet: has touched and is still moving, with 2 of 3 latches held,"
            " latch 2 is 6.0 mm open",
        ),
        (
            make_values(4, (0, 1, 0), **{"latch[1].lateral": 0.0292}),
            "not captured: seated for 4.9 s, with 1 of 3 latches held,"
            " latch 1 stands 4.2 mm outside its window",
        ),
        (
            make_values(5, **{"contact.petal[2].force": 30.0, "latch[3].lateral": 0.026}),
            "not captured: hung up on petal 2,"
            " latch 3 is 9.0 mm open and 1.0 mm outside its window",
        ),
        (
            make_values(6),
            "not captured: too slow to close, at rest before the latches, latch 3 is 9.0 mm open",
        ),
        (make_values(7, (1, 0, 0)), "not captured: rebounded, with 1 of 3 latches held"),
        (make_values(7), "not captured: rebounded"),
        (make_values(8), "not captured: missed"),
        (  # a sequence releases the latches when the hooks are closed
            make_values(4, outcome=6.0, time_of_capture=3.218),
            "captured at 3.218 s, then docked",
        ),
        (make_values(3, outcome=7.0, time_of_capture=3.5), "captured at 3.500 s, then undocked"),
        ({"latched[1]": 0}, None),
    ],
)
def test_every_reason_has_a_sentence(values, sentence):
    assert explain_capture(values) == sentence


def test_every_reason_of_the_fmu_has_one(runs):
    run = runs.run("idss_25t_350t", stop=0.02)
    needed = list_needed([*run.names, *run.parameters])
    some = {"capture.reason", "latch[1].lateral", "latch[3].window", "contact.petal[3].force"}
    assert some <= set(needed)
    (reason,) = {int(value) for value in run["capture.reason"]}
    assert reason == 2  # no contact so far
    for reason in range(1, 9):
        assert explain_capture(make_values(reason))


def test_the_summary_says_it(dockloop):
    argument = ("run", "idss_25t_350t", "--scene", "initial.lateral_offset=0.45", "--no-plots")
    summary = dockloop.read(*argument, "--json", "--step", "0.25")
    assert summary["explanation"].startswith("not captured")
    assert summary["captured"] is False


def test_a_sweep_has_a_column_for_it(dockloop, tmp_path):
    sweep = tmp_path / "own.toml"
    sweep.write_text(
        """
title = "speeds"
scene = "idss_25t_350t"
cases = 1
sampling = "sobol"
seed = 1
outcomes = ["outcome"]
worst = "outcome"
[[vary]]
type = "grid"
name = "initial.lateral_offset"
values = [0.0, 0.45]
[experiment]
stop = 4.0
step = 0.5
"""
    )
    dockloop.succeed("sweep", sweep, "-o", tmp_path / "own.parquet", "--no-plots")
    table = pyarrow.parquet.read_table(tmp_path / "own.parquet").to_pydict()
    first, second = table["explanation"]
    assert first == "captured"
    assert second.startswith("not captured")
    assert list(table)[-3:] == ["outcome", "explanation", "limits"]


REBOUND = [
    "initial.approach_time=0.05",
    "initial.closing_speed=1.18",
    "initial.lateral_offset=0.194",
    "initial.lateral_direction_deg=151",
    "initial.lateral_speed=0.018",
    "initial.lateral_speed_direction_deg=167",
    "initial.pitch_yaw_deg=5.58",
    "initial.pitch_yaw_direction_deg=17.1",
    "initial.roll_deg=-6.88",
    "initial.roll_rate_deg_s=175",
]


def test_a_rebound_does_not_depend_on_the_communication_step(runs, tmp_path):
    """It is one where the gap itself is 5 cm, not where a bound for the contact search is."""
    scene = str(write_light_scene(tmp_path))
    for step in (0.1, 0.02):
        run = runs.run(scene, *REBOUND, stop=1.2, step=step)
        assert run["gap"][-1] > 0.08
        assert run["outcome"][-1] == 4, step
        parted = (run["gap"] > 0.05) & (run["relative.velocity[1]"] > 0)
        assert run["phase"][parted] == pytest.approx(8), step


def run_default(dockloop, *options):
    ran = dockloop.succeed(
        "run", "idss_25t_350t", *options, "--no-plots", "--json", "-o", "own.csv"
    )
    return json.loads(ran.out)


def test_vehicles_that_pass_each_other_miss(dockloop):
    summary = run_default(dockloop, "--scene", "initial.lateral_offset=1.0")
    assert summary["outcome"] == "miss"
    assert summary["explanation"] == "not captured: missed"


def test_a_latch_that_lets_go_is_reported(dockloop):
    latches = "mechanism.set.latches"
    summary = run_default(
        dockloop,
        *(
            "--scene",
            f"{latches}.releases_on_overload=true",
            "--scene",
            f"{latches}.rated_load=200",
        ),
    )
    assert summary["captured"] is False
    assert re.match(r"captured at 3\.\d+ s, but latches let go again, ", summary["explanation"])


def test_tilt_beyond_the_description_of_the_rings_is_reported(dockloop):
    summary = run_default(dockloop, "--scene", "initial.lateral_speed=0.5")
    (warning,) = [text for text in summary["warnings"] if "tilted" in text]
    assert "do not trust loads and motion from here on" in warning


def test_energy_that_adds_up_step_by_step_is_refused(dockloop):
    """No single step of these makes more than there is; 66 kJ came together before."""
    settings = ("--set", "solver.method=7", "--set", "solver.step=0.001")
    fast = ("--scene", "initial.closing_speed=0.5", "--stop", "4", "--step", "0.012")
    ran = dockloop("run", "idss_25t_350t", *fast, *settings, "--no-plots", "-o", "own.csv")
    assert ran.status == 1
    assert "makes the energy audit wrong by" in ran.err
