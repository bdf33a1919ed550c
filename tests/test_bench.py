"""The benchmarks compare the same mechanism, and say when the accelerations of an engine are wrong.

1. The mechanisms written for other engines, bodies and loops, are those that dockloop reads as
   legs.
2. The ring on crank legs is closed at home, by the closed form of the order of axes asked for.
3. The report chooses the cheapest setting of an accuracy, and marks times without a meaning.
4. ``scripts/bench`` explains itself and refuses what it does not know.
"""

import json

import numpy as np
import pytest

from benchmarks import bench, families, mechanisms, report
from dockloop.base import paths
from dockloop.native import core
from programs import run

BENCH = json.loads(bench.BENCH.read_text())
START = json.loads((bench.DATA / "hexapod_bench.json").read_text())["initial"]


# Its legs have screws. Laws of force elements are no part of what engines compare.
SCREWS = {
    key: value
    for key, value in json.loads((paths.MECHANISMS / "hexapod.json").read_text()).items()
    if key not in ("forces", "failures", "sequence")
}


@pytest.mark.parametrize(
    "document", [BENCH, mechanisms.hexapod(BENCH, 3), mechanisms.hexapod(BENCH, 7), SCREWS]
)
def test_other_engines_receive_the_same_mechanism(document, tmp_path):
    expanded = mechanisms.expand(document, START)
    for state in expanded["states"]:
        state["external"] = []
    legs, bodies = tmp_path / "legs.json", tmp_path / "bodies.json"
    legs.write_text(json.dumps(document))
    bodies.write_text(json.dumps(expanded))
    ours, theirs = (
        core.evaluate(file.read_text(), file, bodies.read_text(), bodies) for file in (legs, bodies)
    )
    for state, a, b in zip(expanded["states"], ours, theirs, strict=True):
        assert np.array(b["v"]) == pytest.approx(np.array(state["v"]), rel=1e-14, abs=1e-14)
        for key in ("a", "base_force", "base_moment"):
            scale = np.max(np.abs(a[key]))
            assert np.array(b[key]) == pytest.approx(np.array(a[key]), abs=1e-12 * scale)


def test_a_mechanism_with_gears_is_closed_at_states_that_move(tmp_path):
    document = families.take_family("apda")
    bench.add_expected(document, tmp_path)
    state = json.loads((tmp_path / "apda_states.json").read_text())["states"][3]
    nut, rod = (find_place(document, name) for name in ("rod1_nut", "rod1_rod"))
    ratio = document["mechanism"]["couplings"][0]["terms"][0]["ratio"]
    for key in ("v", "a"):
        values = state["expected"][key]
        assert values[nut + 5] == pytest.approx(ratio * values[rod + 5], rel=1e-12)
        assert abs(values[rod + 5]) > 1e-3


def find_place(document, name):
    """Which body it is; the first has six velocities, all others one."""
    return [body["name"] for body in document["mechanism"]["bodies"]].index(name)


def test_the_page_of_families_says_what_is_met():
    figures = {
        "apda/general/accelerations": {"ns": 2000.0},
        "apda/no closed forms/accelerations": {"ns": 22000.0},
        "apda/Pinocchio, reduced by hand/accelerations": {"ns": 13000.0, "error": 1e-15},
        "hexapod/general/accelerations": {"ns": 1000.0},
    }
    page = families.make_page(figures, "head")
    assert "| apda, no closed forms / general | 11 | > 10 | yes |" in page
    assert "| apda, Pinocchio, reduced by hand / general | 6.5 | > 10 | no |" in page


@pytest.mark.parametrize(
    ("second_axis", "closure"), [([0, 0, 1], "R1R2R3"), ([0, 1, 0], "R1R2R3_perp")]
)
def test_crank_legs_are_closed_at_home(second_axis, closure, tmp_path):
    file = tmp_path / "cranks.json"
    file.write_text(json.dumps(mechanisms.crank_hexapod(BENCH, "cranks", second_axis)))
    checked = core.check(file.read_text(), file)
    assert [loop["closure"] for loop in checked["loops"]] == [closure] * 6
    assert checked["closure_residual"] < 1e-14
    assert checked["singularity_margin"] > 0.5
    assert checked["home_q"] == pytest.approx([0.0] * 3 + [1.0] + [0.0] * 21, abs=1e-13)


def test_a_motion_is_priced_by_the_cheapest_setting_that_is_accurate():
    figures = {
        "hand-written/A/1e-05": {"ns": 2e6, "error": 5e-7, "evaluations": 100},
        "hand-written/B/1e-05": {"ns": 1e6, "error": 5e-7, "evaluations": 200},
        "hand-written/A/1e-08": {"ns": 9e6, "error": 5e-9, "evaluations": 900},
    }
    (row,) = report.motions_table(figures).split("\n")[2:]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1] == cells[2] == "1 (200, B 1e-05)"
    assert cells[3:] == ["9 (900, A 1e-08)", "not reached"]


def test_accelerations_that_are_wrong_are_called_so():
    figures = {
        "m/hand-written/accelerations": {"ns": 400.0},
        "m/good/with reactions": {"ns": 8000.0, "error": 1e-12},
        "m/bad/with reactions": {"ns": 100.0, "error": 0.4},
    }
    table = report.evaluations_table(figures, "m")
    assert "| bad (accelerations wrong) |" in table
    assert "| good |" in table


@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [
        (["--help"], 0, "example: scripts/bench"),
        (["--peers", "abacus"], 2, "--peers needs"),
        (["--rounds", "0"], 2, "--rounds needs"),
        (["--fast"], 2, "'--fast' is not known"),
    ],
)
def test_the_command_explains_itself(arguments, status, text):
    done = run(paths.ROOT / "scripts" / "bench", *arguments)
    assert done.returncode == status
    assert text in done.stdout + done.stderr
