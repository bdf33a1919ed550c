"""A start before zero shifts times, and nothing else: -1 is no time only where nothing happened."""

import math

import pytest

import dockloop as dl
from dockloop.native.variables import NO_TIME, happened
from dockloop.result.run_errors import find_figures

FAST = {"initial.approach_time": 0.5, "initial.closing_speed": 0.6, "initial.lateral_offset": 0.0}


def run(start, length=4.0):
    shift = {"experiment.start": start, "experiment.stop": start + length}
    return dl.run("idss_25t_350t", FAST | shift)


@pytest.fixture(scope="module")
def usual():
    return run(0.0)


@pytest.mark.parametrize("start", [-16.0, -1.5, -1.0])
def test_the_summary_of_an_early_start_is_that_of_zero(usual, start):
    found, wanted = run(start).summary, usual.summary
    assert wanted["captured"]
    for name in ("outcome", "captured", "phase"):
        assert found[name] == wanted[name]
    times = [(of["time_of_contact"], of["time_of_capture"]) for of in (found, wanted)]
    assert times[0] == pytest.approx([t + start for t in times[1]], abs=1e-4)
    assert [row["name"] for row in found["limits"]] == [row["name"] for row in wanted["limits"]]
    assert wanted["limits"], "the case has none: take another one"
    for load, peak in wanted["peak_loads"].items():
        if peak["time"] is not None:
            assert found["peak_loads"][load]["time"] == pytest.approx(
                peak["time"] + start, abs=1e-3
            )


def test_what_an_early_start_has_not_seen_has_not_happened(usual):
    early = run(-16.0, length=0.25)
    assert early.summary["time_of_contact"] is None
    assert early["time_of_capture"][-1] == NO_TIME
    assert not happened(early["time_of_capture"]).any()
    assert math.isinf(find_figures(usual, early)["time_of_capture"])
