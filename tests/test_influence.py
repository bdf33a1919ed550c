"""Which input decides an outcome: random trees against closed forms.

1. Ishigami's function: the total Sobol indices are known. Shares are these, but for what the stated
   score leaves open, in the right order.
2. An outcome that one of five inputs decides: this input has all of the variance, the others none.
3. What no input decides: the score says that nothing is explained.
4. The same seed gives the same bits; of many cases some are used.
5. Without scikit-learn the message says how to install the package.
"""

import sys

import numpy as np
import pytest

pytest.importorskip("sklearn")

from dockloop.errors import DockloopError
from dockloop.html_report import _explain_ranks
from dockloop.influence import can_rank, find_influence

A, B = 7.0, 0.1  # of Ishigami's function


def draw(cases=2048, inputs=5, seed=3):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (cases, inputs))


def ishigami(x):
    first, second, third = np.pi * x[:, :3].T
    return np.sin(first) + A * np.sin(second) ** 2 + B * third**4 * np.sin(first)


def list_exact():
    """Total Sobol indices of Ishigami's function (Homma and Saltelli, 1996)."""
    first = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
    second = A**2 / 8.0
    both = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    return np.array([first + both, second, both, 0.0, 0.0]) / (first + second + both)


def test_shares_are_the_total_sobol_indices():
    x = draw()
    found = find_influence(x, ishigami(x))
    shares = np.array([share.mean for share in found.shares])
    spreads = np.array([share.spread for share in found.shares])
    assert 0.8 < found.score.mean < 1.0
    assert found.score.spread < 0.05
    left = 1.0 - found.score.mean
    assert np.all(shares < list_exact() + 3.0 * spreads + 0.01), shares
    assert np.all(shares > list_exact() - left - 3.0 * spreads), shares
    assert list(np.argsort(-shares)[:3]) == [0, 1, 2]
    assert np.all(np.abs(shares[3:]) < 0.01)


@pytest.mark.parametrize("decides", [0, 3])
def test_one_input_of_five_decides_an_outcome(decides):
    x = draw(400)
    found = find_influence(x, (x[:, decides] > 0.3).astype(float))
    shares = [share.mean for share in found.shares]
    assert found.score.mean > 0.9
    assert shares.pop(decides) == pytest.approx(1.0, abs=0.15)
    assert np.max(np.abs(shares)) < 0.03


def test_what_no_input_decides_is_not_explained():
    x = draw(400)
    found = find_influence(x, draw(400, 1, seed=4)[:, 0])
    assert found.score.mean < 0.1
    assert all(abs(share.mean) < 3.0 * share.spread + 0.02 for share in found.shares)
    assert "too little for a sure ranking" in _explain_ranks(found)


def test_the_same_seed_gives_the_same_bits_and_of_many_cases_some_are_used():
    x = draw(3000, 2)
    assert find_influence(x, x[:, 1]) == find_influence(x, x[:, 1])
    assert find_influence(x, x[:, 1]) != find_influence(x, x[:, 1], seed=1)
    assert find_influence(x, x[:, 1]).cases == 2048


def test_few_cases_or_few_that_differ_are_not_ranked():
    assert not can_rank(np.arange(19.0))
    assert can_rank(np.arange(20.0))
    rare = np.zeros(100)
    rare[:4] = 1.0
    assert not can_rank(rare)
    rare[:5] = 1.0
    assert can_rank(rare)


def test_without_the_library_its_installation_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn", None)
    with pytest.raises(DockloopError, match=r"package scikit-learn is needed .*pip install"):
        find_influence(draw(40), np.arange(40.0))
