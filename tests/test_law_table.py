"""Force laws of type ``table``: a measured force over travel and rate.

Oracles: scipy's ``PchipInterpolator`` for the force and its antiderivative for the energy; a staged
spring, which a straight table must equal; parabolas and exponentials beyond the ends of a table;
the area of a hysteresis loop.
"""

import json
import math
import zipfile

import numpy as np
import pytest
from scipy import interpolate

import dockloop as dl
from dockloop.base.errors import DockloopError, UsageError
from dockloop.fmu.build import build_fmu
from dockloop.native.variables import list_outputs
from extreme_cases.fmi_host import Host
from slides import make_element, make_slide, write_slide

MASS = 40.0
TRAVEL = [-0.05, -0.01, 0.0, 0.02, 0.06]
FORCE = [80.0, 20.0, 0.0, -15.0, -99.0]
TABLE = {"type": "table", "travel": TRAVEL, "force": FORCE}


@pytest.fixture
def make(tmp_path):
    """Return a docking of one body on a slide with these laws, at a coordinate with a rate."""

    def call(*laws: dict, at: float = 0.0, rate: float = 0.0) -> dl.Docking:
        path = write_slide(tmp_path, make_slide(MASS, make_element(*laws)), rate)
        return dl.Docking(path, {"initial.joints.block.position": at})

    return call


def test_force_and_energy_are_those_of_scipy(make):
    exact = interpolate.PchipInterpolator(TRAVEL, FORCE)
    work = exact.antiderivative()
    for at in np.linspace(-0.05, 0.06, 23):
        docking = make(TABLE, at=float(at))
        assert docking.get("element[1].force") == pytest.approx(exact(at), abs=1e-12)
        energy = docking.get("energy.potential")
        assert energy == pytest.approx(work(0.0) - work(at), abs=1e-14)


def test_a_straight_table_is_a_spring(make):
    straight = {"type": "table", "travel": [-0.2, -0.05, 0.1], "force": [800.0, 200.0, -400.0]}
    runs = [
        make(law, at=0.05, rate=0.1) for law in (straight, {"type": "spring", "stages": [[0, 4e3]]})
    ]
    for _ in range(50):
        for docking in runs:
            docking.step(0.01)
        table, spring = (docking.get("element[1].coordinate") for docking in runs)
        assert table == pytest.approx(spring, abs=1e-13)


def test_energy_is_kept_and_the_implicit_matrix_fits(make, tmp_path):
    bounds = {**TABLE, "outside": "extend"}
    path = write_slide(tmp_path, make_slide(MASS, make_element(bounds)), 0.35)
    results = []
    for method in ("explicit", "rosenbrock", "bdf"):
        tight = {"solver.rtol": 1e-12, "solver.atol_position": 1e-14, "solver.atol_velocity": 1e-14}
        if method != "explicit":
            tight = {"solver.rtol": 1e-9}
        result = dl.run(path, {"solver.method": method, **tight}, stop=1.0, step=0.05)
        if method == "explicit":
            assert np.max(np.abs(result["energy.residual"])) < 1e-9
            assert np.ptp(result["element[1].coordinate"]) > 0.1  # through all rows
        results.append(result["element[1].coordinate"][-1])
    assert results[1] == pytest.approx(results[0], abs=1e-6)
    assert results[2] == pytest.approx(results[0], abs=1e-6)


def test_rates_are_a_damper_and_branches_a_hysteresis(make):
    # F = -k x - c v as a table: an exponential motion without a spring.
    slow = {
        "type": "table",
        "travel": [-10.0, 10.0],
        "rates": [-0.5, 0.0, 1.0],
        "force": [[20.0, 20.0], [0.0, 0.0], [-40.0, -40.0]],
    }
    docking = make(slow, rate=0.4)
    for _ in range(20):
        docking.step(0.1)
    decay = math.exp(-40.0 / MASS * 2.0)
    assert docking.get("element[1].rate") == pytest.approx(0.4 * decay, abs=1e-9)
    lost = MASS * 0.4**2 / 2.0 * (1.0 - decay**2)
    assert docking.get("energy.dissipated_legs") == pytest.approx(lost, abs=1e-8)
    # Branches 12 N apart, held above 1e-4 m/s: each way takes 6 N times its length.
    branches = {
        "type": "table",
        "travel": [-1.0, 0.0, 1.0],
        "rates": [-1e-4, 0.0, 1e-4],
        "force": [[2006.0, 6.0, -1994.0], [2000.0, 0.0, -2000.0], [1994.0, -6.0, -2006.0]],
        "outside_rate": "hold",
    }
    docking, way, last = make(branches, at=0.1), 0.0, 0.1
    for _ in range(400):
        docking.step(0.0025)
        x = docking.get("element[1].coordinate")
        way, last = way + abs(x - last), x
    assert docking.get("energy.dissipated_legs") == pytest.approx(6.0 * way, rel=2e-3)


@pytest.mark.parametrize("outside", ["refuse", "hold", "extend"])
def test_beyond_the_travel_the_law_does_what_it_states(make, outside):
    flat = {"type": "table", "travel": [0.0, 0.1], "force": [-40.0, -80.0], "outside": outside}
    docking = make(flat, at=0.05, rate=1.0)
    outputs = list_outputs(docking.variables)
    while docking.time < 0.3:
        before = [docking.get(name) for name in outputs]
        try:
            docking.step(0.01)
        except DockloopError as error:
            assert outside == "refuse"
            text = str(error)
            assert "element 'one' leaves its table" in text
            assert "between 0 and 0.1" in text
            assert "outside = 'hold' or 'extend'" in text
            assert [docking.get(name) for name in outputs] == before
            break
    if outside == "refuse":
        assert docking.get("element[1].coordinate") < 0.1
        return
    x = docking.get("element[1].coordinate")
    expected = -80.0 if outside == "hold" else -40.0 - 400.0 * x
    assert x > 0.15
    assert docking.get("element[1].force") == pytest.approx(expected, abs=1e-9)
    assert abs(docking.get("energy.residual")) < 1e-6  # of 20 J; hold has a kink at the end


def test_numbers_of_the_file_are_in_the_fmu_and_states_restore(tmp_path):
    (tmp_path / "spring.csv").write_text("x [mm];F [kN]\n-100;0,4\n0;0\n50;-0,1\n100;-0,6\n")
    law = {"type": "table", "file": "spring.csv", "columns": {"x": "travel", "F": "force"}}
    path = write_slide(tmp_path, make_slide(MASS, make_element(law)), 0.3)
    fmu = build_fmu(path, output=tmp_path / "slide.fmu")
    (tmp_path / "spring.csv").unlink()
    with zipfile.ZipFile(fmu) as package:
        read = json.loads(package.read("resources/model.json"))["mechanism"]["forces"][0]["laws"][0]
    assert read["travel"] == [-0.1, 0.0, 0.05, 0.1]
    assert read["force"] == [400.0, 0.0, -100.0, -600.0]
    assert "file" not in read
    with Host(fmu) as host:
        host.start()
        host.step(0.05)
        state, ends = host.save(), []
        for _ in range(2):
            host.step(0.05)
            ends.append(host.value("element[1].coordinate"))
            host.restore(state)
    assert ends[0] == ends[1]


@pytest.mark.parametrize(
    ("text", "law", "expected"),
    [
        ("x [mm],F [N]\n0,0\n2,-1\n2,-3\n", {}, "line 4 it is 0.002 m after 0.002"),
        ("x [mm],F [N]\n0,0\n2,\n3,-3\n", {}, "'F' in line 3 is empty or no number"),
        ("x [mm],F [N]\n0,0\n2,nan\n3,-3\n", {}, "'F' in line 3 is empty or no number"),
        ("x [mm],F [N]\n0,0\n2,high\n3,-3\n", {}, "'F' in line 3 is 'high'"),
        ("x [mm],F [N]\n0,0\n", {}, "one row of values"),
        ("x [s],F [N]\n0,0\n1,2\n", {}, "'x' is in 's': must be in m"),
        ("x [mm],F [N]\n0,0\n1,2\n", {"columns": {"x": "travel", "G": "force"}}, "no column 'G'"),
        ("x [mm],F [N]\n0,0\n1,2\n", {"columns": {"x": "travel", "F": "load"}}, "no quantity"),
        ("x [mm],F [N]\n0,0\n1,2\n", {"columns": {"x": "travel"}}, "has no column 'force'"),
        ("x [mm],F [N]\n0,0\n1,2\n", {"travel": [0, 1], "force": [0, 1]}, "must have either"),
        (
            "x [mm],F [N],F [kN]\n0,0,1\n2,-3,4\n",
            {},
            "has two columns 'force' ('F [N]' and 'F [kN]')",
        ),
        ("x [mm],F [N]\n0,0\n1,2\n", {"columns": {}}, '= { "x" = "travel" }'),  # by its unit
        (None, {}, "no such table"),
    ],
)
def test_a_bad_table_is_refused_in_one_sentence(tmp_path, text, law, expected):
    if text is not None:
        (tmp_path / "spring.csv").write_text(text)
    columns = {"x": "travel", "F": "force"}
    law = {"type": "table", "file": "spring.csv", "columns": columns, **law}
    path = write_slide(tmp_path, make_slide(MASS, make_element(law)))
    for call in (lambda: dl.Docking(path), lambda: dl.check(tmp_path / "slide.json")):
        with pytest.raises(UsageError) as caught:
            call()
        assert expected in str(caught.value), caught.value
        assert "\n" not in str(caught.value)
        assert "spring.csv" in str(caught.value) or "law 1 of element 'one'" in str(caught.value)
