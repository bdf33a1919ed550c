"""The product against what was published (`tests/validation/published.md`).

1. Exact comparisons: every one agrees within its band.
2. Trends, ratios and scales (long): every one agrees, but for those that are known to fail. These
   have a reason on the page; one that begins to agree must leave the list here.
3. A comparison outside its band fails, whatever was found.
"""

import sys

import pytest

from dockloop.base.paths import ROOT

FOLDER = ROOT / "tests" / "validation" / "published"


@pytest.fixture(scope="module")
def published():
    """The modules of the cases."""
    before = set(sys.modules)
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(FOLDER))
        import case
        import cases

        yield {"case": case, **{c.letter: c for c in cases.CASES}}
        for name in set(sys.modules) - before:
            if str(FOLDER) in str(getattr(sys.modules[name], "__file__", "")):
                del sys.modules[name]


def check(rows):
    failing = [row for row in rows if not row.agrees and not row.reason]
    assert rows
    assert not failing, "\n".join(f"{r.what}: {r.found}, not {r.expected}" for r in failing)


@pytest.mark.parametrize("letter", ["A", "B", "C", "D", "J", "N"])
def test_exact_cases_agree(published, letter):
    rows = published[letter].exact()
    check(rows)
    assert not [row.reason for row in rows if row.reason]  # no excuse where the solution is known


KNOWN_FAILURES = {
    "D": ("independent legs, single", "independent legs, all deviations"),
    "E": ("apda, lateral motion",),
    "L": ("probe_drogue: spread", "probe_drogue: change of the least"),
}


@pytest.mark.long
@pytest.mark.parametrize("letter", ["A", "B", "C", "D", "E", "F", "G", "L"])
def test_trends_agree_but_for_those_that_are_known(published, letter):
    rows = published[letter].trend()
    check(rows)
    failing = {row.what for row in rows if not row.agrees}
    known = KNOWN_FAILURES.get(letter, ())
    assert len(failing) == len(known)
    assert all(any(what.startswith(name) for what in failing) for name in known)


def test_no_case_is_left_out(published):
    letters = {name: case for name, case in published.items() if name != "case"}
    marks = {mark.args[0]: mark.args[1] for mark in test_exact_cases_agree.pytestmark}
    assert set(marks["letter"]) == {name for name, case in letters.items() if case.exact}
    marks = test_trends_agree_but_for_those_that_are_known.pytestmark
    (trends,) = [mark.args[1] for mark in marks if mark.name == "parametrize"]
    assert set(trends) == {name for name, case in letters.items() if case.trend}


def test_what_is_outside_of_its_band_fails(published):
    case = published["case"]
    assert case.compare_near("x", 1.009, 1.0, relative=0.01).agrees
    assert not case.compare_near("x", 1.011, 1.0, relative=0.01).agrees
    assert not case.compare_near("x", float("nan"), 1.0, relative=0.01).agrees
    assert not case.compare_range("x", 0.51, 0.33, 0.5).agrees
    failing = case.compare_range("x", 0.51, 0.33, 0.5, reason="own geometry")
    assert (failing.verdict, failing.reason) == ("fails", "own geometry")
    assert case.compare_range("x", 0.4, 0.33, 0.5, reason="own geometry").reason == ""
