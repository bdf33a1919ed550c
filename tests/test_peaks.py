"""Places of peaks: time, step of the sequence and part, in summaries, tables and reports.

The oracle of a run is its own history of samples: near the true peak a sample has almost its value,
and the step of the sequence that is recorded there is that of the peak.
"""

import math
from types import SimpleNamespace

import numpy as np
import pyarrow
import pytest

import dockloop as dl
from dockloop.base.sections import write_text
from dockloop.native.variables import Variable
from dockloop.report.run import report_run
from dockloop.result.criteria import Criterion, has_happened, parse_criterion, say_not_seen
from dockloop.result.peaks import (
    count_steps,
    find_leg_peak,
    find_sampled_peak,
    list_steps_after,
    list_with_places,
    say_place,
    say_steps,
)

SCENE = {"mechanism": {"sequence": {"steps": [{"name": "latch"}, {"name": "align"}]}}}


def test_a_peak_load_says_where_it_arose():
    run = dl.run("hexapod", stop=12.0, step=0.02)
    assert "step 'attenuate'" in write_text(report_run(run.summary))
    steps = set()
    for name, load in run.summary["peak_loads"].items():
        values = run[f"capture.peak.{name}"]
        after = int(np.argmax(values >= values[-1]))  # the first sample that has seen the peak
        # An inner step may end behind that sample, and is searched when it ends.
        assert run["time"][after] - 0.1 <= load["time"] <= run["time"][after] + 1e-9
        number = run[f"capture.peak_step.{name}"][-1]
        at = int(np.searchsorted(run["time"], load["time"]))
        assert number in run["sequence.step"][at - 1 : at + 1]
        assert load["step"] == run.scene["mechanism"]["sequence"]["steps"][int(number) - 1]["name"]
        assert np.all(np.diff(values) >= 0.0)
        assert np.all(np.diff(run[f"capture.peak_time.{name}"]) >= -0.1)  # found in that search
        steps.add(load["step"])
    assert len(steps) > 1
    later = list_steps_after(run, 3.5)
    first = run["time"][np.argmax(run["sequence.step"] == 4)]
    assert first > 3.5
    assert list(later) == ["attenuate"]
    assert later["attenuate"] == pytest.approx(first, abs=0.02)
    assert run["capture.peak_time.tension"][0] == -1.0
    assert run["capture.peak_step.tension"][0] == 0


def test_a_sampled_peak_names_its_leg():
    class Run(dict):
        scene = SCENE

    run = Run(
        {"time": np.array([0.0, 1.0, 2.0]), "sequence.step": np.array([1, 2, 2]),
         "leg[1].force": np.array([5.0, 1.0, 2.0]), "leg[2].force": np.array([0.0, -9.0, 3.0])}
    )  # fmt: skip
    sampled = find_sampled_peak(run, ["leg[1].force", "leg[2].force"])
    assert sampled == {"value": 9.0, "time": 1.0, "step": "align", "place": "leg[2]"}
    assert say_place(sampled) == "in leg[2] at 1 s in step 'align'"
    assert find_leg_peak(run, 2) == sampled
    inside = {"peak": 12.0, "peak_time": 0.5, "peak_step": 1.0}
    run |= {f"leg[1].{name}": np.array([0.0, value]) for name, value in inside.items()}
    found = find_leg_peak(run, 2)
    assert found == {"value": 12.0, "time": 0.5, "step": "latch", "place": "leg[1]"}


def test_peaks_of_legs_arise_inside_steps():
    """Forces at points 1 ms apart are the oracle; those at points 0.5 s apart miss a third."""
    fine, coarse = (dl.run("apda", stop=3.6, step=step) for step in (0.001, 0.5))
    legs = [f"leg[{i + 1}]" for i in range(6)]
    sizes = [np.abs(fine[f"{leg}.force"]) for leg in legs]
    for leg, size in zip(legs, sizes, strict=True):
        assert 0.999 < coarse[f"{leg}.peak"][-1] / size.max() < 1.01
        assert abs(coarse[f"{leg}.peak_time"][-1] - fine["time"][size.argmax()]) < 0.01
    most, peak = max(map(np.max, sizes)), coarse.summary["legs"]["peak"]
    assert np.abs([coarse[f"{leg}.force"] for leg in legs]).max() < 0.67 * most
    assert peak["value"] == pytest.approx(most, rel=0.01)
    assert peak["place"] == legs[int(np.argmax([size.max() for size in sizes]))]


def test_steps_of_peaks_are_counted():
    steps = np.array([2, 1, 2, 0, np.nan, 2])
    assert count_steps(SCENE, steps) == {"align": 3, "latch": 1}
    assert count_steps({"mechanism": {}}, np.zeros(3)) == {}
    assert list_with_places("outcome") == ["outcome"]
    assert list_with_places("capture.peak.shear") == [
        "capture.peak.shear", "capture.peak_time.shear", "capture.peak_step.shear"
    ]  # fmt: skip


def test_a_peak_that_is_not_there_has_no_time():
    assert not has_happened("capture.peak_time.shear", -1.0)
    assert has_happened("relative.axial", -1.0)
    name = "capture.peak_time.shear"
    shear = Variable(name, "Real", "output", "continuous", "s", None, -1.0, math.inf, "")
    criterion: Criterion = parse_criterion(f"{name} < 3", {name: shear})
    assert not criterion.holds({"capture.peak_time.shear": -1.0})
    assert criterion.holds({"capture.peak_time.shear": 2.0})


@pytest.mark.parametrize("stop", [4.0, 60.0, math.inf])
def test_what_ends_before_its_scene_says_what_it_has_not_seen(stop):
    text = say_not_seen(stop, 60.0, {"align": 12.25})
    if stop >= 60.0:
        assert text is None
    else:
        assert text is not None
        assert "after 4 s, with the steps 'align' (12.25 s), is not judged" in text


def test_inputs_are_ranked_for_the_peaks_of_each_step_apart():
    from dockloop.report.sweep_sections import _split_by_step

    name, planner = "capture.peak.tension", SimpleNamespace(base=SCENE)
    table = pyarrow.table({"capture.peak_step.tension": [2, 1, 2, 0, None]})
    peaks = np.array([5.0, 1.0, 6.0, 0.0, np.nan])
    parts = _split_by_step(name, planner, table, peaks)
    assert [title for title, _ in parts] == [
        f"{name}, 2 of 3 peaks: in step 'align'", f"{name}, 1 of 3 peaks: in step 'latch'"
    ]  # fmt: skip
    np.testing.assert_array_equal(parts[0][1], [5.0, np.nan, 6.0, np.nan, np.nan])
    np.testing.assert_array_equal(parts[1][1], [np.nan, 1.0, np.nan, np.nan, np.nan])
    one = pyarrow.table({"capture.peak_step.tension": [2, 2, 2, 2, 0]})
    assert _split_by_step(name, planner, one, peaks) == [(name, peaks)]
    assert say_steps({"align": 2, "latch": 1}) == (
        "arose in step 'align' 2 of 3, step 'latch' 1 of 3"
    )
