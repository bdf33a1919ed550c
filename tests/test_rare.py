"""``dockloop sweep --rare``: the part of dockings that fail when few do.

1. Closed forms instead of dockings: the mean is right, the stated interval holds the answer about
   as often as it says, the stated variation is the one that is found, with a fifth of the samples
   that plain sampling needs for the same interval.
2. Dockings: pawls that the energy of the approach must open, with uncertain speed and masses. The
   closed form of the boundary, sampled by brute force without dockings, is the answer; so is a
   plain sweep of dockings where failures are frequent.
3. Grades of criteria lead to failure: they rise with what makes a docking fail.
4. The same seed gives the same summary; an interrupted estimate goes on to it.
"""

import math

import numpy as np
import pytest
from scipy.stats import norm

import dockloop as dl
from dockloop.base.errors import DockloopError
from dockloop.base.sections import write_text
from dockloop.result.criteria import parse_criterion
from dockloop.sweeps.rare import estimate_rare, report_rare
from pawls import MEAN, SWEEP, sample_failures

CLOSED = {  # limit, exact probability, dimensions
    "a plane": (lambda z: z.sum(axis=1) / 2.0 - 3.5, norm.sf(3.5), 4),
    "two ends": (lambda z: np.abs(z[:, 0]) - 3.7, 2.0 * norm.sf(3.7), 3),
    "frequent": (lambda z: z.sum(axis=1) / 2.0 - 1.0, norm.sf(1.0), 4),
}


def make_rank(limit):
    def rank(cube):
        values = limit(norm.ppf(np.clip(cube, 1e-16, 1.0 - 1e-16)))
        return np.where(values > 0.0, np.inf, values)

    return rank


@pytest.mark.parametrize("name", CLOSED)
def test_the_interval_holds_the_answer_as_often_as_it_says(name):
    limit, exact, width = CLOSED[name]
    found = [estimate_rare(make_rank(limit), width, 500, seed) for seed in range(60)]
    holds = sum(low <= exact <= high for low, high in (e.interval for e in found))
    assert holds >= 52, holds  # 95 % of 60 is 57; binomial, 2 %
    parts = np.array([e.probability for e in found])
    variation = np.mean([e.variation for e in found])
    assert abs(parts.mean() / exact - 1.0) < 3.0 * variation / math.sqrt(60)
    assert 0.6 < parts.std() / exact / variation < 1.5
    assert all(e.samples == 500 + 450 * (len(e.levels) - 1) for e in found)
    if exact < 0.01:
        assert np.median([e.plain_samples / e.samples for e in found]) > 5.0


def test_the_words_state_the_bound():
    levels = [{"floor": None, "part": 0.1}, {"floor": 0.9, "part": 0.0}]
    summary = {"sweep": "mine", "title": "T", "failure": "miss", "probability": 0.0, "high": 0.128}
    summary |= {"levels": levels, "dockings": 190, "stuck": True, "not_run": 0, "examples": []}
    words = write_text(report_rare(summary | {"time": {"ran": 190, "wall": 1.0}}))
    assert "at most 0.13 (95 % confidence): none of 190 failed" in words


def test_a_rank_without_grades_is_refused():
    def rank(cube):
        return np.where(cube[:, 0] > 0.9999, np.inf, -1.0)

    with pytest.raises(DockloopError, match="equally near to failing"):
        estimate_rare(rank, 2, 100, 0)


def test_what_never_fails_is_below_the_last_level():
    found = estimate_rare(lambda cube: cube[:, 0] - 2.0, 1, 100, 0)
    assert found.probability == 0.0
    assert len(found.levels) == 10
    assert not found.is_stuck


def test_chains_that_cannot_move_are_reported():
    def rank(cube):
        return np.minimum(cube[:, 0], 0.99)  # nothing is nearer to failing than that

    found = estimate_rare(rank, 1, 100, 0)
    assert found.probability == 0.0
    assert found.is_stuck
    assert 2 <= len(found.levels) < 10


def test_where_nothing_fails_the_bound_holds_as_often_as_it_says():
    """The rank has no grade above 0.97, which 3 % of the samples have: no more can fail."""
    found = [estimate_rare(lambda c: np.minimum(c[:, 0], 0.97), 2, 200, s) for s in range(100)]
    assert all(e.is_stuck and e.probability == 0.0 and e.interval[0] == 0.0 for e in found)
    bounds = np.array([e.interval[1] for e in found])
    assert np.mean(bounds >= 0.03) >= 0.88  # 95 % of 100; binomial, 0.4 %
    assert np.median(bounds) < 0.06


@pytest.fixture(scope="module")
def outputs():
    variables = dl.Docking("idss_25t_350t").variables.values()
    return {v.name: v for v in variables if v.causality == "output"}


def end(delay=math.inf, load=0.5, speed=0.1):
    return {
        "captured": delay < math.inf,
        "outcome": 2 if delay < math.inf else 4,
        "time_of_contact": 2.0,
        "time_of_capture": 2.0 + delay if delay < math.inf else -1.0,
        "capture.peak.load_ratio": load,
        "initial.closing_speed": speed,
    }


GRADES = {  # ascending: nearer and nearer to failing, the last one fails
    "not captured": [end(0.5), end(1.0), end(9.0), end()],
    "not captured within 5 s": [end(0.5), end(1.0), end(4.9), end(5.1)],
    "load_ratio > 1": [end(load=0.1), end(load=0.9), end(load=1.1)],
    "not captured or load_ratio > 1": [end(0.5, 0.1), end(0.5, 0.9), end(0.5, 1.1)],
    "not (captured and load_ratio < 1)": [end(0.5, 0.1), end(0.5, 0.9), end(0.5, 1.1)],
    "captured and initial.closing_speed < 0.05": [end(1, speed=v) for v in (0.1, 0.06, 0.04)],
}


@pytest.mark.parametrize("text", GRADES)
def test_grades_rise_towards_failure(outputs, text):
    criterion = parse_criterion(text, outputs, ["initial.closing_speed"])
    ranks = [criterion.rank(values) for values in GRADES[text]]
    assert ranks == sorted(ranks)
    assert len(set(ranks)) == len(ranks)
    assert ranks[-1] == math.inf
    assert all(rank <= 0.0 for rank in ranks[:-1])


# ---------------------------------------------------------------- dockings


def write(folder, text=SWEEP):
    (folder / "mine.toml").write_text(text)
    return str(folder / "mine.toml")


def test_rare_failures_of_dockings_are_those_of_brute_force(dockloop, tmp_path):
    exact = sample_failures()
    assert 1e-4 < exact < 1e-3, exact
    command = ("sweep", write(tmp_path), "-o", str(tmp_path / "own.parquet"))
    rare = ("--rare", "not captured", "--rare-cases", "100", "--json")
    summary = dockloop.read(*command, *rare)
    assert summary["low"] < exact < summary["high"], (summary, exact)
    assert summary["dockings"] < 0.2 * summary["plain_dockings"]
    assert not (tmp_path / "own.parquet").exists()
    assert "dockloop run idss_25t_350t" in summary["examples"][0]["command"]
    # A lost end of the journal is run again, to the same summary.
    journal = tmp_path / "own_rare.jsonl"
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:-20]))
    assert dockloop(*command, *rare).status == 2
    again = dockloop.read(*command, *rare, "--resume")
    assert again["time"]["ran"] <= 20
    assert {**again, "time": 0} == {**summary, "time": 0}


def test_frequent_failures_are_those_of_a_plain_sweep(tmp_path):
    slow = SWEEP.replace(f"mean = {MEAN}", "mean = 0.0155").replace("cases = 400", "cases = 150")
    from dockloop.sweeps.rare import run_rare
    from dockloop.sweeps.sampling import read_sweep

    sweep = read_sweep(write(tmp_path, slow))
    found = run_rare(sweep, "not captured", 150, tmp_path / "own.jsonl")
    table = dl.sweep(write(tmp_path, slow))
    part = (table["outcome"] != "captured").mean()
    spread = math.sqrt(2.0 * part * (1.0 - part) / 150)
    assert abs(found["probability"] - part) < 3.0 * spread
    assert len(found["levels"]) == 1
    assert found["plain_dockings"] == 150  # this was plain sampling


def test_bad_usage_is_refused(dockloop, tmp_path):
    masses = 'name = "chaser.mass"'
    cases = f'{SWEEP}[[vary]]\ntype = "cases"\nname = "variant"\n[vary.cases."a"]\n'
    grid = SWEEP.replace(f'type = "uniform"\n{masses}\nrange', f'type = "grid"\n{masses}\nvalues')
    for text, arguments, words in (
        (SWEEP, ("--rare", "not capturedd"), "--rare 'not capturedd': there is no 'capturedd'"),
        (SWEEP, ("--rare", "not captured", "--rare-cases", "55"), "must be a multiple of 10"),
        (grid, ("--rare", "not captured"), "--rare needs distributions"),
        (cases, ("--rare", "not captured"), "no vary of type cases"),
        (SWEEP, ("--rare", ""), "is empty: must have a value"),
        (SWEEP, ("--rare", "not captured", "--report"), "writes no table: leave out --report"),
        (SWEEP, ("--rare-cases", "100"), "--rare-cases 100: needs --rare"),
    ):
        refused = dockloop("sweep", write(tmp_path, text), *arguments)
        assert (refused.status, refused.err.count("\n")) == (2, 1), refused
        assert words in refused.err
