"""Which input decides an outcome: intervals against closed forms.

1. Ishigami's and Sobol's functions: of 100 repetitions at least 90 intervals hold the total Sobol
   index, for every input, and their middle is right on average.
2. An outcome that one of five inputs decides: this input has all of the variance, the others none;
   its threshold is found, and said with the cases on both sides.
3. What no input decides: nothing is explained, every share is open, no threshold is better than
   chance; the p-value of what is random is as often below a level as the level says.
4. The same seed gives the same bits; of many cases some are used.
5. Without scipy the message says how to install the package.
"""

import sys

import numpy as np
import pytest

from dockloop.base.errors import DockloopError
from dockloop.report.influence import can_rank, find_cut, find_influence
from dockloop.report.sweep_sections import _explain_ranks, say_cut

A, B = 7.0, 0.1  # of Ishigami's function
G = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0, 99.0, 99.0])  # of Sobol's function
CASES, LEAST = 512, 0.9


def draw(cases=2048, inputs=5, seed=3):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (cases, inputs))


def ishigami(x):
    first, second, third = np.pi * x[:, :3].T
    return np.sin(first) + A * np.sin(second) ** 2 + B * third**4 * np.sin(first)


def sobol(x):
    return np.prod((np.abs(2.0 * x) + G) / (1.0 + G), axis=1)


def list_ishigami():
    """Total Sobol indices of Ishigami's function (Homma and Saltelli, 1996)."""
    first = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
    second = A**2 / 8.0
    both = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    return np.array([first + both, second, both]) / (first + second + both)


def list_sobol():
    """Total Sobol indices of Sobol's function: each factor has the mean 1."""
    parts = 1.0 / (3.0 * (1.0 + G) ** 2)
    whole = np.prod(1.0 + parts)
    return parts / (1.0 + parts) * whole / (whole - 1.0)


def count_intervals(function, exact, repetitions):
    """Return in what part of the repetitions each interval holds, and the mean of the shares."""
    found = []
    for seed in range(repetitions):
        x = draw(CASES, len(exact), seed)
        found.append(find_influence(x, function(x)).shares)
    value, low, high = np.moveaxis(np.array(found), 2, 0)
    return np.mean((low <= exact) & (exact <= high), axis=0), value.mean(axis=0), high - low


@pytest.mark.long
@pytest.mark.parametrize(
    ("function", "exact"), [(ishigami, list_ishigami()), (sobol, list_sobol())]
)
def test_intervals_hold_the_total_sobol_indices(function, exact):
    held, mean, widths = count_intervals(function, exact, 100)
    assert np.all(held >= LEAST), held
    assert mean == pytest.approx(exact, abs=0.02)
    assert np.mean(widths, axis=0).max() < 0.25  # what covers says something


def test_shares_are_the_total_sobol_indices():
    x = draw(300, 4)
    found = find_influence(x, ishigami(x))
    exact = [*list_ishigami(), 0.0]
    assert found.score > 0.95
    for share, right in zip(found.shares, exact, strict=True):
        assert share.low <= right <= share.high
        assert share.high - share.low < 0.4  # about 1.3 times the widths at 512 cases


@pytest.mark.parametrize("decides", [0, 3])
def test_one_input_of_five_decides_an_outcome(decides):
    x = draw(300)
    y = (x[:, decides] > 0.3).astype(float)
    found = find_influence(x, y)
    assert found.score > 0.9
    share = found.shares.pop(decides)
    assert 0.8 < share.low <= share.value <= share.high
    assert share.high == pytest.approx(1.0, abs=1e-6)
    assert all(other.low == 0.0 and other.high < 0.05 for other in found.shares)
    cut = find_cut(x, y)
    assert cut.column == decides
    assert x[y == 0.0, decides].max() < cut.value < x[y == 1.0, decides].min()
    assert cut.probability == 0.001


def test_a_threshold_of_few_misses_is_said():
    offset = np.linspace(0.0, 0.06, 301)
    inputs = {"roll": draw(301, 1)[:, 0], "offset": np.random.default_rng(1).permutation(offset)}
    units = {"roll": "1", "offset": "m"}
    captured = (inputs["offset"] < 0.0541).astype(float)
    words = "30 cases without capture: 30 of 30 where offset > 0.0541 m, 0 of the other 271"
    assert words in say_cut("capture", inputs, units, captured)
    load = np.where(inputs["offset"] < 0.0541, 2.0, 3.0)
    words = "mean load: 3 in the 30 cases where offset > 0.0541 m, 2 in the other 271 (p = 0.001"
    assert words in say_cut("load", inputs, units, load)


def test_what_no_input_decides_is_not_explained():
    x, y = draw(200), draw(200, 1, seed=4)[:, 0]
    found = find_influence(x, y)
    assert found.score < 0.1
    assert all(share.low == 0.0 and share.high > 0.9 for share in found.shares)
    assert "too little for a sure ranking" in _explain_ranks(found)
    inputs = dict(zip("abcde", x.T, strict=True))
    assert "better than chance" in say_cut("load", inputs, dict.fromkeys("abcde", "1"), y)


def test_p_values_of_what_is_random_are_uniform():
    found = [find_cut(draw(40, 3, s), draw(40, 1, s + 1000)[:, 0]).probability for s in range(200)]
    assert np.mean(np.array(found) <= 0.1) == pytest.approx(0.1, abs=0.065)  # 3 deviations
    assert np.mean(found) == pytest.approx(0.5, abs=0.065)


def test_the_same_seed_gives_the_same_bits_and_of_many_cases_some_are_used():
    x = draw(600, 2)
    assert find_influence(x, x[:, 1]) == find_influence(x, x[:, 1])
    assert find_influence(x, x[:, 1]) != find_influence(x, x[:, 1], seed=1)
    assert find_influence(x, x[:, 1]).cases == 512


def test_few_cases_or_few_that_differ_are_not_ranked():
    assert not can_rank(np.arange(19.0))
    assert can_rank(np.arange(20.0))
    rare = np.zeros(100)
    rare[:4] = 1.0
    assert not can_rank(rare)
    rare[:5] = 1.0
    assert can_rank(rare)


def test_without_the_library_its_installation_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy", None)
    with pytest.raises(DockloopError, match=r"package scipy is needed .*pip install"):
        find_influence(draw(40), np.arange(40.0))
