"""Result files of ``dockloop run``: formats, chosen outputs, units, a limit of their size.

1. CSV, NPZ, Parquet, Excel, MAT and HDF5 hold the same numbers; units are in the summary, in all
   formats but CSV, and in CSV on request.
2. ``--outputs`` writes what it says; the summary is that of the whole run; the rest is refused.
3. A file that would be too large is refused before the run.
4. ``dockloop view`` reads every format.
"""

import json

import numpy as np
import pytest
from pyarrow import parquet

from dockloop.base.errors import UsageError
from dockloop.result.files import read_result
from dockloop.result.recording import check_size

RUN = ("run", "idss_25t_350t", "--stop", "2.5", "--step", "0.1", "--no-plots", "--json")
CHOSEN = ("--outputs", "capture.*", "--outputs", "relative.axial", "--outputs", "latched[2]")


@pytest.mark.parametrize("chosen", [(), CHOSEN])
def test_all_formats_hold_the_same_numbers(dockloop, tmp_path, chosen):
    results, summaries = [], []
    for suffix in ("csv", "npz", "parquet", "xlsx", "mat", "h5"):
        file = tmp_path / f"own.{suffix}"
        done = dockloop.succeed(*RUN, *chosen, "-o", str(file))
        results.append(read_result(file))
        summaries.append(json.loads(done.out))
    csv, npz, parquet_, excel, *others = results
    assert csv.names == npz.names
    for table in (parquet_, excel, *others):
        assert (npz.names, npz.units) == (table.names, table.units)
        if table is not excel:
            assert npz.values.tobytes() == table.values.tobytes()
    assert np.allclose(csv.values, npz.values, rtol=1e-14, atol=0.0)
    assert np.allclose(excel.values, npz.values, rtol=1e-15, atol=0.0)  # 16 digits
    assert npz.units == [summaries[0]["units"][name] for name in csv.names]
    fields = parquet.read_schema(tmp_path / "own.parquet")
    assert fields.field("capture.compression").metadata == {b"unit": b"N"}
    if chosen:
        assert csv.names[:2] == ["time", "relative.axial"]
        assert csv.names[-1] == "latched[2]"
        assert {n.split(".")[0] for n in csv.names[2:-1]} == {"capture"}


def test_a_row_of_units_is_written_on_request(dockloop, tmp_path):
    file = tmp_path / "own.csv"
    plain = dockloop.succeed(*RUN, *CHOSEN, "-o", str(file))
    without = file.read_text()
    assert dockloop(*RUN, *CHOSEN, "--units-row", "-o", str(file)).status == 0  # replaces its own
    names, units, *rows = file.read_text().splitlines()
    assert [names, *rows] == without.splitlines()
    expected = json.loads(plain.out)["units"]
    assert units.split(",") == [expected[name] for name in names.split(",")]
    assert read_result(file).units == units.split(",")
    refused = dockloop(*RUN, "--units-row", "-o", str(tmp_path / "own.npz"))
    assert (refused.status, "own.npz has its units anyway" in refused.err) == (2, True)


def test_chosen_outputs_leave_the_summary_as_it_is(dockloop, tmp_path):
    whole = dockloop.read(*RUN, "-o", str(tmp_path / "whole.npz"))
    part = dockloop.read(*RUN, *CHOSEN, "-o", str(tmp_path / "part.npz"))
    for name in ("outcome", "explanation", "peak_loads", "energy", "legs", "solver"):
        assert part[name] == whole[name], name


def test_chosen_outputs_draw_the_figures_that_they_allow(dockloop, tmp_path):
    dockloop.succeed(*RUN[:-2], "--outputs", "relative.axial", "-o", str(tmp_path / "own.csv"))
    assert {file.name for file in tmp_path.glob("own*.png")} == set()
    dockloop.succeed(*RUN[:-2], "--outputs", "capture.", "-o", str(tmp_path / "own.csv"))
    assert {file.name for file in tmp_path.glob("own*.png")} == {
        "own_loads.png",
        "own_components.png",
    }


def test_a_name_that_no_output_has_is_refused(dockloop, tmp_path):
    refused = dockloop(*RUN, "--outputs", "capture.shearr", "-o", str(tmp_path / "own.csv"))
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert "--outputs capture.shearr: no output of the FMU" in refused.err
    assert "'capture.shear'" in refused.err
    assert not list(tmp_path.iterdir())


def test_a_file_that_would_be_too_large_is_refused_before_the_run(dockloop, tmp_path, monkeypatch):
    monkeypatch.setattr("dockloop.fmu.host.Instance.initialise", None)
    long = ("run", "absorber_1d", "--step", "1e-6", "--no-plots", "-o", str(tmp_path / "own.csv"))
    refused = dockloop(*long)
    assert (refused.status, refused.err.count("\n")) == (2, 1), refused
    assert "5000001 rows of" in refused.err
    assert "GB: more than 1 GB: choose some with --outputs" in refused.err
    assert not list(tmp_path.iterdir())


def test_the_size_depends_on_rows_columns_and_format():
    check_size(1_000_000, 100, ".npz", 1.0)
    with pytest.raises(UsageError, match="Excel takes 1048574 rows of 16384"):
        check_size(1_048_575, 2, ".xlsx", 1.0)
    check_size(1_000_000, 100, ".csv", 2.0)
    with pytest.raises(Exception, match=r"1000000 rows of 100 values, 1\.7 GB: more than 1 GB"):
        check_size(1_000_000, 100, ".csv", 1.0)


def test_view_reads_the_table_of_a_run(dockloop, tmp_path):
    file = tmp_path / "own.parquet"
    dockloop(*RUN, "-o", str(file))
    dockloop.succeed("view", str(file))
    assert (tmp_path / "own_view.html").exists()
