"""``dockloop compare``: measured histories over a run.

1. Data of another engine (MuJoCo, `data/measured_mujoco.py`) with noise, another clock and a load
   cell that reads 2 % too much: shift, peaks, energies, outcome are found.
2. The same data next to a run with other hardware: the differences show it.
3. A known shift, units and scale of a column come back exactly.
4. Bad tables and options are refused in one sentence.
"""

import json
import re

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.histories import Data, read_data
from dockloop.base.paths import ROOT
from dockloop.base.sections import write_text
from dockloop.result.recording import Result
from dockloop.studies.measured.command import report_comparison
from dockloop.studies.measured.overlay import compare, find_shift

RIG = ROOT / "tests" / "data" / "measured_mujoco.csv"
CONTACT = 6.8 + 0.5  # s, of the clock of the rig
LATER = ("--scene", "initial.approach_time=0.5")


def run_absorber(dockloop, *options):
    dockloop.succeed("run", "absorber_1d", *LATER, *options, "--no-plots", "-o", "own.csv")


def compare_rig(dockloop, *options):
    ran = dockloop.succeed("compare", "own.csv", RIG, "--json", *options)
    return json.loads(ran.out)


def test_data_of_another_engine_agree_with_the_run(dockloop, tmp_path):
    run_absorber(dockloop, "--stop", "7")
    found = compare_rig(dockloop, "--outcome", "rebound")
    assert found["shift"] == pytest.approx(0.5 - CONTACT, abs=5e-3)
    assert found["overlap"] > 0.98
    force = found["columns"]["capture.force[1]"]
    noise = 3.5 * 15.0  # N, largest of some hundred samples
    assert force["measured_peak"] == pytest.approx(1.02 * 1757.152, abs=noise)
    assert force["computed_peak"] == pytest.approx(1757.152, rel=1e-3)
    axial = found["columns"]["relative.axial"]
    assert axial["unit"] == "m"
    assert axial["rms"] == pytest.approx(0.5e-3, rel=0.1)  # the noise, and nothing else
    assert min(row["in_band"] for row in found["columns"].values()) > 0.98
    before, after = (found["energies"][f"axial motion at the {end}"] for end in ("start", "end"))
    assert before["computed"] == pytest.approx(0.5 * 25e3 * 350e3 / 375e3 * 0.01, rel=1e-3)
    assert before["measured"] == pytest.approx(before["computed"], rel=0.02)
    assert after["measured"] == pytest.approx(after["computed"], rel=0.02)
    taken = found["energies"]["energy taken by the axial force"]
    assert taken["measured"] / taken["computed"] == pytest.approx(1.02, abs=0.01)
    lost = before["computed"] - after["computed"]
    assert taken["computed"] == pytest.approx(lost, rel=0.01)  # 0.7 %: a jump between two samples
    assert found["outcome"] == {"measured": "rebound", "computed": "rebound", "agrees": True}
    assert (tmp_path / "own_compared.png").stat().st_size > 1e4
    words = dockloop("compare", "own.csv", RIG).out
    assert re.search("time shift +-6.80", words)
    assert "measured: give --outcome" in words


def test_other_hardware_shows(dockloop):
    run_absorber(dockloop, "--scene", "mechanism.set.contact.damping=25923")
    found = compare_rig(dockloop, "--no-plots", "--outcome", "captured")
    assert found["columns"]["capture.force[1]"]["in_band"] < 0.9
    assert found["columns"]["relative.axial"]["rms"] > 5e-3
    assert found["outcome"]["agrees"] is False
    given = compare_rig(dockloop, "--no-plots", "--shift", "-6.5")
    assert (given["shift"], given["shift_found"]) == (-6.5, False)


def make_run():
    time = np.linspace(0.0, 10.0, 1001)
    angle = np.radians(5.0) * np.exp(-((time - 4.0) ** 2))
    values = np.column_stack([time, angle, 100.0 * np.sin(time), time > 6.0])
    names = ["time", "relative.roll", "capture.force[1]", "captured"]
    return Result({}, names, ["s", "rad", "N", "1"], values)


def write_table(path, run, shift, rows):
    lines = ["time [ms], relative.roll [deg] ,capture.force[1] [kN],captured [1]"]
    for time, angle, force, held in run.values[rows]:
        cells = (1e3 * (time + shift), np.degrees(angle), 1e-3 * force, held)
        lines.append(",".join(repr(float(cell)) for cell in cells))
    path.write_text("\ufeff" + "\r\n".join(lines) + "\r\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("shift", [0.0, -2.0, 1234.56])
def test_shift_units_and_time_of_capture_are_found(tmp_path, shift):
    run = make_run()
    file = write_table(tmp_path / "rig.csv", run, shift, slice(200, 900, 3))
    data = read_data(file, run.names, run.units)
    assert data["relative.roll"].max() == pytest.approx(np.radians(5.0), rel=1e-4)
    assert find_shift(run, data) == pytest.approx(-shift, abs=1e-5)
    found = compare(run, data, 0.1, -shift)
    assert max(row["largest_error"] for row in found["columns"].values()) < 1e-9
    assert found["captured"]["measured_time"] == pytest.approx(6.02, abs=1e-9)
    assert found["captured"]["computed_time"] == pytest.approx(6.01)


@pytest.mark.parametrize("unknowns", [["offset"], ["scale"], ["offset", "scale"]], ids=str)
def test_the_shift_is_found_next_to_what_else_is_not_known(unknowns):
    """A distance that grows: an offset of 0.3 or a factor of 1.2 is like another shift."""
    run = dl.run("absorber_1d", stop=4.0)
    name, rows = "relative.axial", slice(20, 350, 3)
    seen = (1.2 if "scale" in unknowns else 1.0) * run[name][rows, np.newaxis]
    data = Data(run.time[rows] + 2.0, [name], ["m"], seen + 0.3 * ("offset" in unknowns))
    assert find_shift(run, data, {name: unknowns}) == pytest.approx(-2.0, abs=1e-4)
    assert abs(find_shift(run, data) + 2.0) > 3e-3


def test_times_since_1970_come_to_an_end():
    """Their rounding is larger than the accuracy of the search."""
    run = make_run()
    data = Data(run.time + 1774958400.0, run.names[1:], run.units[1:], run.values[:, 1:])
    assert find_shift(run, data) == pytest.approx(-1774958400.0, abs=1e-5)


def test_data_of_the_run_itself_that_go_on_behind_its_end_need_no_shift():
    name = "capture.compression"
    run, rest = dl.run("absorber_1d", stop=1.0), dl.run("absorber_1d")
    data = Data(rest.time[::10], [name], ["N"], rest[name][::10, np.newaxis])
    assert find_shift(run, data) == 0.0


@pytest.mark.parametrize(
    ("scene", "overrides", "step"),
    [
        ("absorber_1d", {"chaser.mass": 26000}, 0.01),
        ("hexapod", {"initial.closing_speed": 0.11}, 0.05),
    ],
)
def test_two_whole_runs_with_one_clock_need_nearly_no_shift(scene, overrides, step):
    """Rounding, counters and constants of other values once found a shift out of the run."""
    run, other = (dl.run(scene, keys, stop=5.0, step=step) for keys in ({}, overrides))
    data = Data(other.time, other.names[1:], other.units[1:], other.values[:, 1:])
    assert abs(find_shift(run, data)) < 0.1


def test_the_shift_that_leaves_the_run_is_named(dockloop, tmp_path):
    dockloop.succeed("run", "absorber_1d", "-o", tmp_path / "own.csv", "--no-plots")
    rig = tmp_path / "rig.csv"
    rig.write_text("time,capture.compression,gap\n0,0,\n0.2,900,\n0.7,1750,\n1.5,800,0.1\n")
    found = dockloop("compare", tmp_path / "own.csv", rig)
    said = "1 samples of 'gap' fall into the run from 0 to 5 s at the shift of"
    assert said in found.err
    assert "s that was found: give" in found.err
    given = dockloop("compare", tmp_path / "own.csv", rig, "--shift", "9")
    assert "at the shift of 9 s that was given: give" in given.err


def test_bands_are_parts_of_the_range_or_the_stated_accuracy(tmp_path):
    """A leg of 0.788 m that travels 0.1 m: the run is 8 % of the travel too long."""
    time = np.linspace(0.0, 10.0, 201)
    travel = 0.05 * np.cos(time)
    names, units = ["time", "leg1.length", "gap"], ["s", "m", "m"]
    lengths = 0.788 + travel
    run = Result({}, names, units, np.column_stack([time, lengths + 0.008, 0.0 * time + 1.0]))

    def read(accuracy):
        rows = [f"{t!r},{1e3 * v!r},990" for t, v in np.column_stack([time, lengths]).tolist()]
        header = f"time [s],leg1.length [mm]{accuracy},gap [mm] +-5"
        (tmp_path / "rig.csv").write_text("\n".join([header, *rows]))
        data = read_data(tmp_path / "rig.csv", names, units)
        return compare(run, data, 0.1, 0.0)["columns"]

    leg = read("")["leg1.length"]
    assert leg["half_band"] == pytest.approx(0.1 * 2.0 * 0.05, rel=1e-3)
    assert leg["relative_rms"] == pytest.approx(0.08, rel=1e-3)
    stated = read(" +-7.9 ")
    assert (stated["leg1.length"]["half_band"], stated["leg1.length"]["in_band"]) == (7.9e-3, 0.0)
    assert read(" +-8.1")["leg1.length"]["in_band"] == 1.0
    assert read("+- 8.1")["gap"]["relative_rms"] is None  # nothing moves
    assert read("")["gap"]["in_band"] == 0.0  # 10 mm of 5


def test_a_column_in_a_wrong_unit_does_not_decide_the_shift():
    run = make_run()
    angle, force = run["relative.roll"], run["capture.force[1]"]
    names = ["relative.roll", "relative.pitch_yaw", "capture.force[1]"]
    run = Result(
        {},
        ["time", *names],
        ["s", "rad", "rad", "N"],
        np.column_stack([run.time, angle, angle**2, force]),
    )
    rows = slice(200, 900, 3)
    values = np.column_stack([angle, angle**2, 1e-3 * force])[rows]  # force in kN, stated as N
    data = Data(run.time[rows] + 12.0, names, ["rad", "rad", "N"], values)
    assert find_shift(run, data) == pytest.approx(-12.0, abs=0.1)
    # Where nothing fits, a shift of few samples comes with a warning.
    found = compare(run, data, 0.1, -12.0) | {
        "data": "a",
        "result": "b",
        "outcome": {},
        "files": [],
    }
    words = "  warning     few samples fall into the run: check units"
    few, many = (found | {"shift_found": True, "overlap": part} for part in (0.05, 0.9))
    assert words in write_text(report_comparison(few))
    assert words not in write_text(report_comparison(many))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time [s],relative.axal [m]\n0,1\n1,2\n", "did you mean 'relative.axial'"),
        ("time [s],relative.axial\n0,1\n1,2\n", "'relative.axial' has no unit, but others have"),
        ("time [s],relative.axial [N]\n0,1\n1,2\n", "must be in m or mm"),
        ("relative.axial [m],gap [m]\n0,1\n1,2\n", "no column is the time"),
        ("time [s],gap [m],gap [m]\n0,1,1\n1,2,2\n", "two columns 'gap'"),
        ("time [s],gap [m]\n0,1\n0,2\n", "two rows of values at different times"),
        ("time [s],gap [m]\n0,1\n2,1\n1,2\n", "time must not decrease, but does in line 4"),
        ("time [s],gap [m]\n0,1\n1,inf\n", "'gap' in line 3 is 'inf'"),
        ("time [s],gap [m]\n0,1\n1\n", "line 3 has 1 values: must have 2"),
        ("time [s],gap [m]\n0,1\n", "at least two rows"),
        ("time [s],gap [m] +-0\n0,1\n1,2\n", "accuracy of 'gap' is '0': must be a finite number"),
        ("time [s],gap [m] +-x\n0,1\n1,2\n", "accuracy of 'gap' is 'x': must be a finite number"),
        ("time [s],gap [m]\n90,1\n91,2\n", "give another --shift"),
    ],
)
def test_bad_tables_are_refused_in_one_sentence(dockloop, tmp_path, text, words):
    run_absorber(dockloop, "--stop", "1")
    (tmp_path / "rig.csv").write_text(text)
    ran = dockloop("compare", "own.csv", "rig.csv", "--shift", "0", "--no-plots")
    assert ran.status == 2, ran
    assert words in ran.err
    assert ran.err.count("\n") == 1
    assert not (tmp_path / "own_compared.json").exists()


def test_bad_options_are_refused(dockloop, tmp_path):
    run_absorber(dockloop, "--stop", "1")
    for option, value, words in (
        ("--band", "0", "above 0"),
        ("--shift", "nan", "must be a finite number"),
        ("--outcome", "reboundd", "did you mean 'rebound'"),
        ("-o", "own.txt", "must end in .json"),
        ("-o", "own_summary.json", "own_summary.json"),
    ):
        ran = dockloop("compare", "own.csv", RIG, option, value, "--no-plots")
        assert ran.status == 2, (option, ran)
        assert words in ran.err
    assert dockloop("compare", "none.csv", RIG).status == 2
    assert dockloop("compare", "own.csv", "none.csv").status == 2
