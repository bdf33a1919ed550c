"""The numerical extremes (``extreme_cases``), every part in its quick range.

1. Every case of every part is right within its limit or refused with a reason; what cannot be
   right is refused.
2. The score counts as bad what is beyond a limit, NaN, a refusal without words, a part that breaks
   down and one without a case.
3. The table states every part and what is bad.
"""

import math

import pytest

from dockloop.base.errors import DockloopError, UsageError
from extreme_cases import TITLES, Part, Score, describe, list_parts, run_extremes, run_part

pytestmark = pytest.mark.long  # hundreds of extreme scenes

PARTS = list_parts()


@pytest.mark.parametrize("part", PARTS, ids=lambda part: f"{part.item}: {part.what}")
def test_every_case_is_right_or_refused(part):
    row = run_part(part, quick=True)
    assert row["bad"] == [], f"{len(row['bad'])} of {row['cases']} cases"
    assert row["verdict"] in ("right", "refused")
    assert row["worst"] <= part.limit, (row["worst"], row["where"])
    assert row["cases"] == row["right"] + row["refused"]


def test_every_item_of_the_list_has_a_part():
    assert {part.item for part in PARTS} == set(TITLES) == set(range(1, 13))


def fail():
    raise DockloopError("x is 3; it must be below 2")


def fail_silently():
    raise DockloopError("error")


@pytest.mark.parametrize(
    "use",
    [
        lambda score: score.compare(2e-3, "here"),
        lambda score: score.compare(math.nan, "here"),
        lambda score: score.check(False, "here"),
        lambda score: score.right_or_refused("here", lambda: math.inf),
        lambda score: score.right_or_refused("here", fail_silently),
        lambda score: score.must_be_refused("here", lambda: None),
    ],
)
def test_a_case_that_is_not_right_is_bad(use):
    score = Score(limit=1e-3)
    use(score)
    assert (score.right, score.refused, len(score.bad)) == (0, 0, 1)
    assert "here" in score.bad[0]


def test_right_cases_and_refusals_are_counted_with_the_worst_error_and_the_reason():
    score = Score(limit=1e-3)
    score.compare(1e-5, "first")
    score.right_or_refused("second", lambda: 1e-4)
    score.right_or_refused("third", fail)
    score.must_be_refused("fourth", fail)
    assert (score.right, score.refused, score.bad) == (2, 2, [])
    assert (score.worst, score.where) == (1e-4, "second")
    assert score.reasons == ["x is 3; it must be below 2"]


def break_down(*_):
    raise ZeroDivisionError("of this test")


def bad_part(run):
    return Part(1, "range", "oracle", "m", 1e-3, run)


@pytest.mark.parametrize(
    ("run", "word"), [(break_down, "of this test"), (lambda *_: None, "no case")]
)
def test_a_part_that_breaks_down_or_runs_nothing_is_bad(run, word):
    row = run_part(bad_part(run), quick=True)
    assert row["verdict"] == "bad"
    assert word in row["bad"][0]


def test_the_table_states_every_part_and_what_is_bad():
    table = describe(run_extremes([4], quick=True, progress=lambda _: None))
    assert "| 4 redundant constraints |" in table
    assert "0 bad cases" in table
    row = run_part(bad_part(break_down), quick=True)
    assert "of this test" in describe([row])


def test_an_item_that_is_not_there_is_named():
    with pytest.raises(UsageError, match="--item 13: no such item; there are 1, 2"):
        list_parts([13])
