"""``dockloop review``: a page and a PDF of one docking, for a review board.

1. all parts are there, with the figures of the commands that make them alone;
2. travel against stops, the worst direction;
3. packages that are missing, files of others, bad words.
"""

import json
import sys

import numpy as np
import pytest

import dockloop as dl
from dockloop.review.command import list_travels
from test_cli import assert_refused
from test_fit_sweep import C, K, write_fit

AXES = ["--x", "initial.closing_speed", "0.05", "0.15", "--y", "chaser.mass", "15e3", "35e3"]
LIMIT = ["--criterion", "capture.peak.compression < 2500"]
SHORT = ["--stop", "3", "--tolerance", "0.1"]


@pytest.fixture(scope="module")
def fit_file(tmp_path_factory):
    both = {"values": {K: 23e3, C: 3e3}, "vary": {K: [1e4, 4e4], C: [2e3, 4e4]}}
    both |= {"units": {K: "N/m", C: "N.s/m"}, "not_identified": []}
    both["covariance"] = [[1e-2, 0.0], [0.0, 1e-4]]
    return write_fit(tmp_path_factory.mktemp("fit") / "fit.json", **both)


def test_a_review_has_all_parts_and_repeats(dockloop, tmp_path, fit_file):
    pytest.importorskip("weasyprint", exc_type=(ImportError, OSError))
    words = ["review", "absorber_1d", *AXES, *LIMIT, *SHORT, "--from", fit_file, "--cases", "8"]
    made = dockloop(*words, "-o", tmp_path, "--json")
    found = json.loads(made.out)
    alone = dl.run("absorber_1d", stop=3, estimate_error=True).summary
    assert found["run"]["peak_loads"] == alone["peak_loads"]
    assert found["run"]["error_estimate"] == alone["error_estimate"]
    load = found["band"]["loads"]["compression"]
    assert found["band"]["cases"] == 8
    assert load["low"] < load["median"] < load["high"]
    (criterion,) = found["envelope"]["criteria"]
    assert 0.0 < criterion["band"]["met"]["low"] <= criterion["band"]["met"]["high"] < 1.0
    page = (tmp_path / "review.html").read_text()
    for title in (
        *("Peak loads", "Numerical error", "The boundary of success"),
        *("Loads with the uncertainty of the fit", "The scene", "Settings and versions"),
    ):
        assert f">{title}" in page, title
    assert "dockloop review absorber_1d --stop 3.0 --x initial.closing_speed" in page
    assert "data:image/svg+xml" not in page  # an absorber has no bodies to draw
    pdf = (tmp_path / "review.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert len(pdf) > 20_000
    assert dockloop(*words, "-o", tmp_path).status == 0  # over its own files


def test_travel_is_laid_against_stops():
    slides = dl.run("idss_25t_350t", stop=4.0)
    rows = list(list_travels(slides))
    assert [row[0] for row in rows] == [f"leg{i}" for i in range(1, 7)]
    _, low, high, lower, upper, unit, left = rows[2]
    assert (lower, upper, unit) == (650, 1233, "mm")
    length = 1e3 * slides["leg[3].length"]
    assert (low, high) == pytest.approx((length.min(), length.max()), rel=1e-15)
    assert left == f"{min(low - lower, upper - high) / (upper - lower):.0%}"
    laws = list(list_travels(dl.run("hexapod", stop=0.1)))
    assert [row[0] for row in laws] == [f"leg{i}" for i in range(1, 7)]
    assert {row[3:6] for row in laws} == {(-282.5, 300.5, "mm")}
    assert not list(list_travels(dl.run("absorber_1d", stop=0.1)))


def test_travel_has_the_names_and_units_of_the_elements(imported):
    palm, *fingers = list_travels(dl.run("gripper", stop=0.5))
    assert (palm[0], palm[3:6]) == ("palm", (-120, 80, "mm"))
    assert [row[0] for row in fingers] == ["finger1", "finger2", "finger3"]
    ends = np.degrees([-0.4, 1.1])
    assert {row[5] for row in fingers} == {"deg"}
    assert fingers[1][3:5] == pytest.approx(ends)
    apda = list(list_travels(dl.run("apda", stop=0.1)))
    assert apda[-1][3:6] == (-280, 20, "mm")  # along its thread
    slides = list(list_travels(dl.run(imported, stop=0.1)))
    assert [row[0] for row in slides] == [f"slide{i}" for i in range(1, 7)]
    assert {row[3:6] for row in slides} == {(-200, 150, "mm")}


def test_the_boundary_is_looked_for_in_the_worst_direction(dockloop, tmp_path):
    axes = ["--x", "initial.lateral_offset", "0.04", "0.08"]
    axes += ["--y", "initial.closing_speed", "0.1", "0.12"]
    words = [*axes, "--directions", "3", "--stop", "4", "--tolerance", "0.25", "--no-pdf"]
    words += ["--accuracy", "1e-2"]
    made = dockloop("review", "idss_25t_350t", *words, "-o", tmp_path, "--json")
    found = json.loads(made.out)
    key = "initial.lateral_direction_deg"
    ratios = {
        angle: dl.run(
            "idss_25t_350t", {key: angle, "initial.lateral_offset": 0.06}, stop=4.0, accuracy=1e-2
        )["capture.peak.load_ratio"][-1]
        for angle in (0.0, 120.0, 240.0)
    }
    worst = found["worst"]
    assert worst["at"] == {"initial.lateral_offset": pytest.approx(0.06)}
    assert worst["value"] == max(ratios, key=ratios.get)
    assert [row[2] for row in worst["directions"]] == pytest.approx(list(ratios.values()))
    assert found["envelope"]["set"][key] == worst["value"]
    page = (tmp_path / "review.html").read_text()
    assert "--tolerance 0.25 --directions 3" in page
    assert not (tmp_path / "review.pdf").exists()


def test_a_scene_that_states_its_vehicles_has_no_boundary(dockloop, tmp_path):
    made = dockloop(
        "review", "hexapod_bench", "--stop", "0.2", "--no-pdf", "-o", tmp_path, "--json"
    )
    found = json.loads(made.out)
    assert found["envelope"] is None
    assert found["worst"] is None
    assert np.isfinite(found["run"]["energy"]["residual"])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (AXES[:4], ["--x, --y", "both"]),
        (["--directions", "0"], ["--directions", "1"]),
        (["--cases", "1"], ["--cases", "2"]),
        (["--from", "none.json"], ["none.json"]),
        (["--tolerance", "0.3"], ["--tolerance", "0.25"]),
        ([*AXES[:3], "x", *AXES[4:]], ["--x", "two numbers"]),
        ([*AXES, "--criterion", "kaptured"], ["--criterion", "kaptured"]),
        (["--criterion", "load_ratio"], ["--criterion", "load_ratio"]),
        (["--x", "no.such", "1", "2", *AXES[4:]], ["no.such"]),
        ([*AXES, "--set", "chaser.mas=2e4"], ["chaser.mas"]),
    ],
)
def test_bad_words_are_one_sentence_before_any_work(dockloop, tmp_path, monkeypatch, more, words):
    def run(*_, **__):
        raise AssertionError("a docking was run")

    monkeypatch.setattr("dockloop.review.command.run", run)
    refused = dockloop("review", "absorber_1d", "--no-pdf", "-o", tmp_path, *SHORT, *more)
    assert_refused(refused, *words)


def test_a_criterion_without_a_boundary_is_refused(dockloop, tmp_path):
    words = ["hexapod_bench", "--no-pdf", "-o", tmp_path, "--criterion", "captured"]
    assert_refused(dockloop("review", *words), "--criterion", "--x", "--y")


def test_files_of_others_stay_and_a_missing_package_is_named(dockloop, tmp_path, monkeypatch):
    (tmp_path / "review.html").write_text("mine")
    refused = dockloop("review", "absorber_1d", "--no-pdf", "-o", tmp_path)
    assert_refused(refused, "review.html")
    assert (tmp_path / "review.html").read_text() == "mine"
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    refused = dockloop("review", "absorber_1d", "-o", tmp_path / "new")
    assert refused.status == 1
    assert "weasyprint" in refused.err
    assert "pip install" in refused.err
    assert not (tmp_path / "new").exists()
