"""The one reader of tables: forms of text, Excel, Parquet, NPZ, MAT, HDF5; what cannot be read.

1. Forms: the same histories in the forms that rigs, loggers, spreadsheets and tools of FMI write.
   The oracle is the list of values from which each form is made; a number comes back to rounding.
2. Times: dates, times of day, columns with times of their own.
3. Names: a map of columns, its file, what is left out.
4. Malformed files: one sentence each, with file, line or column, value, and what to do.
"""

import json
import math
import re
from datetime import datetime, timedelta

import h5py
import numpy as np
import openpyxl
import pyarrow
import pytest

from dockloop.base.errors import UsageError
from dockloop.base.histories import parse_columns, read_data
from dockloop.base.tables import parse_form, read_table
from dockloop.base.units import find_factor

SIDES = {  # of a run: outputs and their units
    "time": "s",
    "relative.axial": "m",
    **{f"capture.force[{i}]": "N" for i in (1, 2, 3)},
    "relative.roll": "rad",
    "captured": "1",
    "gap": "m",
}
TIME = [0.0, 0.25, 0.5, 0.75]
AXIAL = [1234.5, 12.25, -3.5, 0.125]  # mm
FORCE = [0.0, 1.5, -2e-3, 4.0]  # kN
HEADS = ["time [s]", "relative.axial [mm]", "capture.force[1] [kN]"]
ROWS = [[repr(x) for x in row] for row in zip(TIME, AXIAL, FORCE, strict=True)]
COMMA = [[cell.replace(".", ",") for cell in row] for row in ROWS]
SI = {"relative.axial": [1e-3 * x for x in AXIAL], "capture.force[1]": [1e3 * x for x in FORCE]}
PLAIN = {"relative.axial": AXIAL, "capture.force[1]": FORCE}  # units of the outputs
NAMES = ["time", "relative.axial", "capture.force[1]"]


def join(rows, sep=",", end="\n"):
    return "".join(sep.join(row) + end for row in rows)


def quote(rows):
    return [[f'"{cell}"' for cell in row] for row in rows]


def read(path, form="", columns=()):
    stated = parse_form(form) if form else {}
    mapped = parse_columns(columns)
    return read_data(path, list(SIDES), list(SIDES.values()), stated, mapped)


def save(path, content, encoding="utf-8"):
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return path


UNIT_ROW = [NAMES, ["s", "mm", "kN"]]
TEXTS = {  # text of the table, values; form to state, encoding
    "comma": (join([HEADS, *ROWS]), SI),
    "semicolon, decimal comma": (join([HEADS, *COMMA], ";"), SI),
    "tab": (join([HEADS, *ROWS], "\t"), SI),
    "tab, decimal comma": (join([HEADS, *COMMA], "\t"), SI),
    "bar with blanks": (join([HEADS, *ROWS], " | "), SI),
    "blanks": (join([HEADS, *ROWS], "   "), SI),
    "quoted names": (join([*quote([HEADS]), *ROWS]), SI),
    "all quoted, decimal comma": (join(quote([HEADS, *COMMA])), SI),
    "row of units": (join([*UNIT_ROW, *ROWS]), SI),
    "row of units in brackets": (join([NAMES, ["[s]", "[mm]", "[kN]"], *COMMA], ";"), SI),
    "units in parentheses": (join([["Time (s)", "relative.axial (mm)", HEADS[2]], *ROWS]), SI),
    "units behind a slash": (join([["time/s", "relative.axial / mm", HEADS[2]], *ROWS]), SI),
    "comment lines": ("# test 12\n% of a rig\n" + join([HEADS, *ROWS]) + "# end\n", SI),
    "names in a comment": ("# run 3\n# " + join([HEADS, *ROWS]), SI),
    "lines above the names": (
        "Rig 7;\nDate;31.03.2026;\nRate;100;Hz\n\n" + join([*UNIT_ROW, *COMMA], ";"),
        SI,
    ),
    "delimiter at the end": (join([[*HEADS, ""], *[[*row, ""] for row in ROWS]]), SI),
    "delimiter behind values": (join([HEADS, *[[*row, ""] for row in COMMA]], ";"), SI),
    "thousands grouped": (join([HEADS, ["0,0", "1.234,5", "0"], *COMMA[1:]], ";"), SI),
    "carriage returns": (join([HEADS, *ROWS], end="\r\n"), SI),
    "byte order mark": (join([HEADS, *ROWS]), SI, "", "utf-8-sig"),
    "UTF-16": (join([HEADS, *ROWS], "\t"), SI, "", "utf-16"),
    "UTF-16 without a mark": (join([HEADS, *ROWS], "\t"), SI, "", "utf-16-le"),
    "FMPy, cross-check": (join([*quote([NAMES]), *ROWS]), PLAIN),
    "OMSimulator": (
        '"sep=,"\n'
        + join([*quote([["time", *(f"model.root.dock.{n}" for n in NAMES[1:])]]), *ROWS]),
        PLAIN,
    ),
    "pandas with an index": (
        join([["", *HEADS], *[[str(i), *row] for i, row in enumerate(ROWS)]]),
        SI,
    ),
    "FMI names, no units": (join([NAMES, *ROWS]), PLAIN),
    "delimiter stated": (join([HEADS, *ROWS], "^"), SI, "sep=^"),
    "lines stated": (
        join([["A", "B", "C"], *UNIT_ROW, ["x", "y", "z"], *COMMA], ";"),
        SI,
        "sep=;, decimal=,, header=2, units=3",
    ),
    "comment stated": ("* rig\n" + join([HEADS, *ROWS]), SI, "comment=*"),
    "units in a comment below the names": (join([NAMES, ["#s", "mm", "kN"], *ROWS]), SI),
    "names and units in comments": ("# " + join([NAMES, ["# s", "mm", "kN"], *ROWS]), SI),
    "units behind a comma": (
        join([["time, s", "relative.axial, mm", "capture.force[1], kN"], *COMMA], ";"),
        SI,
    ),
    "typography": (
        join([HEADS, *ROWS]).replace("1234.5", "1\u202f234.5").replace("-3.5", "\u22123.5"),
        SI,
    ),
    "Swiss thousands": (join([HEADS, *ROWS], ";").replace("1234.5", "1'234.5"), SI),
    "Fortran": (
        join([NAMES, *[[f"{float(c):.6E}".replace("E", "D") for c in row] for row in ROWS]], " "),
        PLAIN,
    ),
    "two marks, zeros and the end of a DOS file": (
        "\ufeff\ufeff" + join([HEADS, *ROWS]) + "\x1a" + "\0" * 99,
        SI,
    ),
    "LabVIEW": (
        "LabVIEW Measurement\t\nX_Columns\tOne\nTime\t12:09:34,2387\n***End_of_Header***\t\n"
        "Channels\t2\t\t\nX0\t0,0\t0,0\t\nDelta_X\t0,25\t0,25\t\n***End_of_Header***\t\t\n"
        + "\t".join([*HEADS, "Comment"])
        + "\n"
        + join(COMMA, "\t"),
        SI,
    ),
}


@pytest.mark.parametrize("name", TEXTS)
def test_forms_of_text_give_the_same_values(tmp_path, name):
    text, values, form, encoding = (*TEXTS[name], *("", "utf-8")[len(TEXTS[name]) - 2 :])
    data = read(save(tmp_path / "rig.csv", text, encoding), form)
    assert data.time.tolist() == TIME
    assert set(data.names) == set(values)
    for output, expected in values.items():
        np.testing.assert_allclose(data[output], expected, rtol=4e-16)


def write_excel(path):
    book = openpyxl.Workbook()
    book.active.title = "notes"
    sheet = book.create_sheet("rig")
    for row in (["Rig 7"], [], *UNIT_ROW, *zip(TIME, AXIAL, FORCE, strict=True)):
        sheet.append(list(row))
    book.save(path)


def write_parquet(path):
    from pyarrow import parquet

    columns = dict(zip(HEADS, (TIME, AXIAL, FORCE), strict=True))
    parquet.write_table(pyarrow.table(columns), path)


def write_mat(path):
    from scipy.io import savemat

    force = np.array([FORCE, FORCE, FORCE]).T
    rig = {"time": TIME, "relative": {"axial": AXIAL}, "capture": {"force": force}}
    savemat(path, {**rig, "title": "rig 7", "serial": 12.0})


def write_trajectories(path):
    """A result of OMSimulator: MAT of version 4, a column of letters per name, signed rows."""
    from scipy.io import savemat

    def make_letters(texts):
        return np.array([list(text.ljust(max(map(len, texts)))) for text in texts])

    members = {
        "Aclass": make_letters(["Atrajectory", "1.1", "", "binTrans"]),
        "name": make_letters(["time", "root.m", "root.relative.axial", NAMES[2]]).T.copy(),
        "dataInfo": np.array([[0, 1, 2, 2], [1, 2, -2, 3], [0, 0, 0, 0], [-1, 0, -1, -1]]),
        "data_1": np.array([[0.0, 0.75], [7.0, 7.0]]),
        "data_2": np.array([TIME, np.negative(AXIAL), FORCE]),
    }
    savemat(path.with_suffix(".mat"), members, format="4")
    path.with_suffix(".mat").rename(path)


def write_hdf5(path):
    with h5py.File(path, "w") as file:
        for name, unit, values in zip(NAMES, UNIT_ROW[1], (TIME, AXIAL, FORCE), strict=True):
            file[f"bench/{name}"] = values
            file[f"bench/{name}"].attrs["unit"] = unit


def write_packed(path):
    """As netCDF and MATLAB do: whole numbers with scale and blanks, units in arrays."""
    with h5py.File(path, "w") as file:
        file["time"], file["relative.axial"] = TIME, np.array([*AXIAL]) * 8.0 + 8
        file["capture.force[1]"] = np.array([0, 1500, -2, 4000], dtype="int16")
        for name, unit in zip(NAMES, UNIT_ROW[1], strict=True):
            file[name].attrs["Units"] = np.array([unit.encode()])
        file["relative.axial"].attrs.update(scale_factor=0.125, add_offset=-1.0)
        file["capture.force[1]"].attrs.update(scale_factor=1e-3, _FillValue=np.int16(-9999))


def write_record(path):
    kinds = [(name, float) for name in NAMES]
    np.savez(path, result=np.array([*zip(TIME, AXIAL, FORCE, strict=True)], dtype=kinds))


def write_durations(path):
    from pyarrow import parquet

    times = pyarrow.array([int(4e9 * t) // 4 for t in TIME], type=pyarrow.duration("ns"))
    parquet.write_table(pyarrow.table(dict(zip(HEADS, (times, AXIAL, FORCE), strict=True))), path)


def write_texts(path):
    book = openpyxl.Workbook()
    for row in [HEADS, *COMMA]:
        book.active.append(row)
    book.save(path)


def write_npz(path):
    values = np.column_stack([TIME, SI["relative.axial"], SI["capture.force[1]"]])
    np.savez(path, names=NAMES, units=["s", "m", "N"], values=values)


@pytest.mark.parametrize(
    ("file", "write", "values", "form"),
    [
        ("rig.xlsx", write_excel, SI, "sheet=rig"),
        ("rig.parquet", write_parquet, SI, ""),
        ("rig.mat", write_mat, PLAIN, ""),
        ("result.mat", write_trajectories, PLAIN, ""),
        ("rig.h5", write_hdf5, SI, ""),
        ("rig.npz", write_npz, SI, ""),
        ("rig.npz", write_record, PLAIN, ""),
        ("rig.nc", write_packed, SI, ""),
        ("rig.parquet", write_durations, SI, ""),
        ("rig.xlsx", write_texts, SI, ""),
    ],
)
def test_files_of_tools_give_the_same_values(tmp_path, file, write, values, form):
    write(tmp_path / file)
    if write is not write_trajectories:  # begins with numbers
        (tmp_path / file).rename(tmp_path / "renamed")  # the content says what a file is
        file = "renamed"
    data = read(tmp_path / file, form)
    assert data.time.tolist() == TIME
    for output, expected in values.items():
        np.testing.assert_allclose(data[output], expected, rtol=4e-16)


def test_more_than_33_forms_are_tried():
    assert len(TEXTS) + 5 >= 33


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
def test_the_result_of_a_run_is_data_for_a_run(dockloop, tmp_path, suffix):
    for file in ("own.csv", f"other{suffix}"):
        assert dockloop("run", "absorber_1d", "--stop", "2", "-o", file, "--no-plots").status == 0
    found = dockloop.read("compare", "own.csv", f"other{suffix}", "--json", "--no-plots")
    assert abs(found["shift"]) < 1e-6
    assert found["overlap"] > 0.99
    assert found["columns"]["relative.axial"]["rms"] < 1e-6
    assert not found["read"]["left_out"]
    assert dockloop("compare", "own.csv", f"other{suffix}", "--shift", "0").status == 0  # a figure


def test_columns_of_tools_that_the_run_lacks_are_left_out(tmp_path):
    names = ["time", "relative.axial", "relative.pitch_yaw", "root.controller.x"]
    data = read(
        save(tmp_path / "own.csv", join([names, ["0", "1", "2", "3"], ["1", "2", "3", "4"]]))
    )
    assert data.names == ["relative.axial"]
    assert data.source["left_out"] == names[2:]


def test_the_table_of_fmpy_is_data_for_a_run(dockloop, tmp_path, runs):
    from fmpy import simulate_fmu, write_csv

    outputs = ["relative.axial", "capture.force[1]", "captured"]
    fmu = runs.fmu("absorber_1d")
    result = simulate_fmu(str(fmu), stop_time=2.0, output_interval=0.05, output=outputs)
    write_csv(tmp_path / "fmpy.csv", result)
    assert dockloop("run", fmu, "--stop", "2", "-o", "own.csv", "--no-plots").status == 0
    ran = dockloop("compare", "own.csv", "fmpy.csv", "--shift", "0", "--json", "--no-plots")
    found = json.loads(ran.out)
    assert set(found["columns"]) == set(outputs)
    assert found["columns"]["relative.axial"]["unit"] == "m"
    assert found["columns"]["relative.axial"]["rms"] < 1e-4
    words = dockloop("compare", "own.csv", "fmpy.csv", "--shift", "0", "--no-plots").out
    assert re.search("units +none stated: those of the outputs", words)


# ------------------------------------------------------------------------------------- times


@pytest.mark.parametrize(
    ("texts", "seconds", "start", "form"),
    [
        (["2026-03-31T23:59:59.5", "2026-04-01T00:00:00.25"], 0.75, "2026-03-31 23:59:59.5", ""),
        (["2026-03-31 12:00:00Z", "2026-03-31 15:00:01+02:00"], 3601.0, "2026-03-31 12:00:00 UTC",
         ""),
        (["31.03.2026 12:00:00", "31.03.2026 12:00:00.123456789"], 0.123456789,
         "2026-03-31 12:00:00", ""),
        (["23:00:00", "23:00:01.5"], 1.5, "23:00:00", ""),
        (["23:59:59.5", "00:00:01"], 1.5, "23:59:59.5", ""),
        (["03/31/2026 01:00:00 PM", "03/31/2026 01:00:02 PM"], 2.0, "2026-03-31 13:00:00",
         "date=%m/%d/%Y %I:%M:%S %p"),
    ],
)  # fmt: skip
def test_times_may_be_dates(tmp_path, texts, seconds, start, form):
    rows = [["Time [hh:mm:ss]", "gap [m]"], [texts[0], "1"], [texts[1], "2"]]
    data = read(save(tmp_path / "rig.csv", join(rows)), form)
    assert data.time == pytest.approx([0.0, seconds], abs=1e-10)
    assert data.source["time_from"] == start


def test_minutes_are_no_hours_where_the_heading_says_so(tmp_path):
    for cells in (["01:30", "01:31"], ["01:30.0", "01:31.0"]):
        rows = [["Time [mm:ss]", "gap [m]"], [cells[0], "1"], [cells[1], "2"]]
        assert read(save(tmp_path / "rig.csv", join(rows))).time.tolist() == [0.0, 1.0]


def test_what_c_writes_for_no_number_is_missing(tmp_path):
    blanks = ["-nan", "+NaN", "nan(ind)", "-nan(snan)", "1.#QNAN", "-1.#IND00", "n.a."]
    rows = [
        ["time", "gap"],
        ["0", "5"],
        *([str(i), b] for i, b in enumerate(blanks, 1)),
        ["9", "6"],
    ]
    found = read(save(tmp_path / "rig.csv", join(rows)))["gap"]
    np.testing.assert_array_equal(found, [5.0, *[np.nan] * len(blanks), 6.0])


def test_dates_of_excel_are_times(tmp_path):
    book, begin = openpyxl.Workbook(), datetime(2026, 3, 31, 12)
    for row in (["time", "gap [m]"], [begin, 1.0], [begin + timedelta(seconds=1.5), 2.0]):
        book.active.append(row)
    book.save(tmp_path / "rig.xlsx")
    data = read(tmp_path / "rig.xlsx")
    assert data.time == pytest.approx([0.0, 1.5], abs=1e-3)  # Excel keeps parts of a day


def test_columns_have_rates_and_times_of_their_own(tmp_path):
    gaps = [*HEADS[:2], "gap [m]"], ["0", "1", "5"], ["0.1", "2", ""], ["0.2", "", "NaN"]
    data = read(save(tmp_path / "gaps.csv", join([*gaps, ["0.3", "4", "8"]])))
    np.testing.assert_array_equal(data["gap"], [5.0, np.nan, np.nan, 8.0])
    np.testing.assert_allclose(data["relative.axial"], [1e-3, 2e-3, np.nan, 4e-3])
    two = ["time [s]", "gap [m]", "time [ms]", "relative.axial [m]"], ["0", "1", "50", "7"]
    data = read(
        save(tmp_path / "two.csv", join([*two, ["0.1", "2", "150", "8"], ["", "", "250", "9"]]))
    )
    assert data.time == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.25])
    np.testing.assert_array_equal(data["gap"], [1.0, np.nan, 2.0, np.nan, np.nan])
    np.testing.assert_array_equal(data["relative.axial"], [np.nan, 7.0, np.nan, 8.0, 9.0])


@pytest.mark.parametrize(
    ("text", "names", "units"),
    [
        ("time;gap;Leg, A\n0;1;3\n1;2;4\n", ["time", "gap", "Leg, A"], [None] * 3),
        ("time;gap, mm;Leg, A\n0;1;3\n1;2;4\n", ["time", "gap, mm", "Leg, A"], [None] * 3),
        ("# rig 3\n# t F\n0 1\n1 2\n", ["t", "F"], [None] * 2),
        ("MDF force,time\n0,1\n1,2\n", ["MDF force", "time"], [None] * 2),
    ],
)
def test_names_are_not_taken_for_units_or_for_kinds_of_files(tmp_path, text, names, units):
    file = tmp_path / "rig.csv"
    file.write_text(text)
    columns = read_table(file).columns
    assert [column.name for column in columns] == names
    assert [column.unit for column in columns] == units


def test_two_clocks_that_pass_midnight_are_refused(tmp_path):
    file = tmp_path / "rig.csv"
    file.write_text("time,time_2,gap\n23:59:59,00:00:00.5,1\n00:00:01,00:00:02,2\n")
    table = read_table(file)
    with pytest.raises(UsageError, match="pass midnight, and there are several: add dates"):
        table.read_times(table.columns[:2])


def test_a_clock_that_no_column_belongs_to_is_left_alone(tmp_path):
    both = ["time", "t [s]", "gap [m]"], ["2026-03-31 12:00:00", "0", "1"], ["", "0.5", "2"]
    data = read(save(tmp_path / "two.csv", join(both)))
    assert data.time.tolist() == [0.0, 0.5]
    assert data.source["time_from"] is None


def test_groups_of_hdf5_have_times_of_their_own(tmp_path):
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        file["a/gap"], file["a/time"] = [1.0, 2.0, 3.0], [0.0, 0.1, 0.2]
        file["b/relative.axial"], file["b/time"] = [7.0, 8.0], [0.05, 0.15]
    data = read(tmp_path / "rig.h5")
    assert data.time.tolist() == [0.0, 0.05, 0.1, 0.15, 0.2]
    np.testing.assert_array_equal(data["relative.axial"], [np.nan, 7.0, np.nan, 8.0, np.nan])


# ------------------------------------------------------------------------------------- names

RIG = "t,Fz,dx,Temp\n0,1.5,25,20\n1,2.5,50,21\n"
MAP = "t=time:ms, Fz=capture.force[1]:lbf,dx=relative.axial:in"


def test_a_map_names_columns_and_stays_with_the_result(tmp_path):
    (tmp_path / "map.toml").write_text(
        '"t" = "time:ms"\n"Fz" = "capture.force[1]:lbf"\ndx = "relative.axial:in"\n'
    )
    file = save(tmp_path / "rig.csv", RIG)
    for columns in ([MAP], MAP.split(","), [str(tmp_path / "map.toml")]):
        data = read(file, columns=columns)
        assert data.time == pytest.approx([0.0, 1e-3])
        pound, inch = 0.45359237 * 9.80665, 0.0254  # definitions
        np.testing.assert_allclose(data["capture.force[1]"], [1.5 * pound, 2.5 * pound], rtol=1e-15)
        np.testing.assert_allclose(data["relative.axial"], [25 * inch, 50 * inch], rtol=1e-15)
        kept = data.source["columns"]["capture.force[1]"]
        assert kept == {"from": "Fz", "unit": "lbf", "stated": True, "mapped": True}
        assert data.source["left_out"] == ["Temp"]


def test_a_map_leaves_columns_out_and_names_columns_without_a_header(tmp_path):
    file = save(tmp_path / "rig.csv", "time [s],gap [m],gap [m]\n0,1,2\n1,3,4\n")
    with pytest.raises(UsageError, match="two columns 'gap'"):
        read(file)
    bare = save(tmp_path / "bare.csv", "0,5,1\n1,6,2\n")
    data = read(bare, columns=["1=time:s, 3=gap:cm"])
    assert data["gap"] == pytest.approx([0.01, 0.02])
    assert data.source["left_out"] == ["2"]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("Fx=gap:m", "rig.csv: has no column 'Fx': has t, Fz, dx, Temp"),
        ("Fz=capture.forc[1]:N", "the run has no output 'capture.forc[1]' (did you mean"),
        ("t=time:s,Fz=capture.force[1]:kg", "'Fz' is in 'kg': must be in N or kN or lbf"),
        ("Fz", "'Fz' must have an output and its unit"),
        ("Fz=gap:m,Fz=gap:m", "has 'Fz' twice"),
        ("none.toml", "none.toml: no such map of columns"),
        ("Fz, dx=gap", "has no column 'Fz, dx'"),
    ],
)
def test_bad_maps_are_refused(tmp_path, monkeypatch, columns, words):
    monkeypatch.chdir(tmp_path)
    file = save(tmp_path / "rig.csv", RIG)
    with pytest.raises(UsageError) as refusal:
        read(file, columns=[columns])
    assert words in str(refusal.value)


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ("divider=;", "has 'divider'"),
        ("sep=;;", "sep is ';;': must be one character, tab or space"),
        ("decimal=x", "decimal is 'x': must be . or ,"),
        ("header=first", "header is 'first': must be the number of a line"),
        ("encoding=", "encoding is '': must be a text"),
        ("encoding=utf9", "there is no such encoding"),
        ("header=9", "has no line 9 with cells: state another header"),
    ],
)
def test_bad_statements_of_the_form_are_refused(tmp_path, form, words):
    with pytest.raises(UsageError) as refusal:
        read(save(tmp_path / "rig.csv", RIG), form)
    assert words in str(refusal.value)


# ------------------------------------------------------------------------------------- units

INCH, POUND, DEGREE = 0.0254, 0.45359237 * 9.80665, math.pi / 180.0  # definitions


@pytest.mark.parametrize(
    ("unit", "expected", "size"),
    [
        *[(unit, "N.m", 1.0) for unit in ("N.m", "N m", "Nm", "N·m", "N*m")],
        *[("kNm", "N.m", 1e3), ("mNm", "N.m", 1e-3), ("Nms", "N.m.s", 1.0), ("J", "N.m", 1.0)],
        *[("ft-lbf", "N.m", 12 * INCH * POUND), ("lbf in", "N.m", INCH * POUND)],
        *[("cm", "m", 1e-2), ("in", "m", INCH), ("kJ", "J", 1e3), ("%", "1", 1e-2)],
        *[("°/s", "rad/s", DEGREE), ("rpm", "rad/s", math.pi / 30.0), ("mrad", "rad", 1e-3)],
        *[("m s-2", "m/s2", 1.0), ("m/s²", "m/s2", 1.0), ("g", "m/s2", 9.80665), ("g", "kg", 1e-3)],
        *[("N/mm", "N/m", 1e3), ("kg m2", "kg.m2", 1.0), ("µs", "s", 1e-6), ("-", "1", 1.0)],
        *[("Nmm", "N.m", 1e-3), ("daNm", "N.m", 10.0), ("in.", "m", INCH), ("G", "m/s2", 9.80665)],
        *[("rev", "rad", 360 * DEGREE), ("º", "rad", DEGREE), ("m·s⁻²", "m/s2", 1.0)],
        *[(unit, "rad/s", None) for unit in ("Hz", "1/s", "deg", "rad")],
        *[(unit, "N", None) for unit in ("kg", "KN", "", "m**9**9**9", "(2)**9", "N*", "x" * 99)],
        *[("%", "rad", None), ("kN", "1", 1e3), ("degC", "m", None), ("nan", "m", None)],
    ],
)
def test_a_unit_has_its_size_or_none(unit, expected, size):
    found = find_factor(unit, expected)
    assert found == (size if size is None else pytest.approx(size, rel=1e-15))


@pytest.mark.parametrize(
    ("text", "form", "value"),
    [  # None: 1234 and 1.234 may both be meant
        ('time,gap\n0,"1,234"\n1,"2,345"\n', "", None),
        ('time,gap\n0,"1,234"\n1,"999"\n', "", None),
        ("time\tgap\n0\t1,234\n1\t2,345\n", "", None),
        ("time;gap\n0;1.234\n1;2.345\n", "", None),
        ('time,gap\n0.5,"1,234"\n1,"2,345"\n', "", None),
        ('time,gap\n0,"1,234"\n1,"2,345"\n', "decimal=,", 1.234),
        ('time,gap\n0,"1,234"\n1,"0,5"\n', "", 1.234),
        ('time,gap\n0,"1,234.0"\n1,"2,345.0"\n', "", 1234.0),
        ("time,gap\n1,1.234\n2,2.345\n", "", 1.234),
        ("time;gap\n0.000;1.234\n1.000;2.345\n", "", 1.234),
        ("time;gap\n0;1,234\n0,5;2,345\n", "", 1.234),
    ],
)
def test_thousands_and_decimals_are_not_confused(tmp_path, text, form, value):
    file = save(tmp_path / "rig.csv", text)
    if value is not None:
        assert read(file, form)["gap"][0] == value
        return
    for stated in ({}, None):
        with pytest.raises(UsageError, match=r"may mean 1234 or 1.234: write it like this") as said:
            read_table(file, stated)
        assert ("--csv" in str(said.value)) is (stated is not None)


# -------------------------------------------------------------------------------- malformed

HEAD = "time [s],gap [m]\n"
MALFORMED = {  # content: words of the sentence
    "empty": (b"", "is empty: must have a header line and rows of values"),
    "header alone": (HEAD, "has no rows of values below its header"),
    "one column": ("time [s]\n0\n1\n", "has no columns: must have at least two"),
    "bytes": (bytes(range(256)), "is no table: neither text in UTF-8 or Windows-1252 nor Excel"),
    "old Excel": (b"\xd0\xcf\x11\xe0" + bytes(600), "Excel file of before 2007: save it as .xlsx"),
    "LabVIEW, binary": (b"TDSm" + bytes(60), "is a TDMS file of LabVIEW: export the table as CSV"),
    "LabVIEW, two": ("***End_of_Header***\n" * 3 + HEAD + "0,1\n", "has 2 segments of LabVIEW"),
    "JSON": ('[{"time": 0}]', "is a JSON file: export the table as CSV"),
    "a page": ("<html><table>", "is XML or HTML: export the table as CSV"),
    "an array": (b"\x93NUMPY" + bytes(60), "an array without names: write each"),
    "OpenDocument": (b"PK\3\4mimetype" + b"PK\5\6" + bytes(30), "is an archive: unpack it"),
    "a control character": (HEAD + "0,1\n1,2\7\n" + "2,3\n" * 40, "line 3 has the character"),
    "decimal commas between commas": (HEAD + "0,0,1,25\n0,5,2,25\n", "has 4 names"),
    "numbers above the names": ("1,2\ntime,gap\n0,1\n1,2\n", "state one by --csv 'header=N'"),
    "names above a row of kinds": ("time,gap\nmean,raw\n0,1\n1,2\n", "names are from line 2"),
    "compressed": (b"\x1f\x8b\x08" + bytes(20), "is compressed: unpack it"),
    "zip": (b"PK\x03\x04" + bytes(30), "cannot be read"),
    "cut Parquet": (b"PAR1" + bytes(30), "cannot be read"),
    "cut HDF5": (b"\x89HDF\r\n\x1a\n" + bytes(30), "cannot be read"),
    "short line": (HEAD + "0,1\n1\n2,3\n", "line 3 has 1 values: must have 2, as the header"),
    "open quote": (HEAD + '0,1\n"1,2\n2,3\n', "line 3 cannot be split into cells"),
    "word in the first row": (HEAD + "0,x\n1,2\n", "'gap' in line 2 is 'x'"),
    "word in every row": (HEAD + "0,x\n1,y\n", "'gap' in line 2 is 'x'"),
    "second of a minute": ("time,gap [m]\n10:00:00,1\n10:00:75,2\n", "in line 3 is '10:00:75'"),
    "word": (HEAD + "0,1\n1,1_0\n", "'gap' in line 3 is '1_0': must be a finite number"),
    "error of a spreadsheet": (HEAD + "0,1\n1,#DIV/0!\n2,3\n", "'gap' in line 3 is '#DIV/0!'"),
    "decimal signs mixed": (join([["time [s]", "gap [m]"], ["0,5", "1,5"], ["1,5", "1.5"]], ";"),
                            "'gap' in line 3 is '1.5': must be a finite number"),
    "no time": (HEAD + "0,1\n,2\n2,3\n", "'time' in line 3 is empty: must have a time"),
    "time goes back": (HEAD + "0,1\n2,2\n1,3\n", "time must not decrease, but does in line 4"),
    "clock stands": (HEAD + "0,1\n0,2\n", "at least two rows of values at different times"),
    "empty column": (HEAD + "0,\n1,\n", "'gap' has no values: leave it out"),
    "unknown unit": ("time [s],gap [ell/x]\n0,1\n1,2\n", "'gap' is in 'ell/x': must be in m or"),
    "angle as a part": ("time [s],relative.roll [%]\n0,1\n1,2\n", "in '%': must be in rad or deg"),
    "unit forgotten": ("time [s],gap\n0,1\n1,2\n", "'gap' has no unit, but others have"),
    "no names": ("0,1\n1,2\n", "no column is the time"),
    "nothing of the run": ("time [s],Temp [K]\n0,1\n1,2\n", "has no column of an output of"),
    "misspelt": ("time [s],relative.axal [m]\n0,1\n1,2\n", "did you mean 'relative.axial' or"),
    "bad day": ("time,gap [m]\n2026-03-31 10:00:00,1\n2026-02-30 10:00:00,2\n",
                "'time' in line 3 is '2026-02-30 10:00:00': must be a number or a time"),
    "day or month first": ("time,gap [m]\n03/04/2026 10:00:00,1\n03/04/2026 11:00:00,2\n",
                           "state another form, for example --csv 'date=%d/%m/%Y"),
    "zones mixed": ("time,gap [m]\n2026-03-31 10:00:00,1\n2026-03-31 10:00:01Z,2\n",
                    "some times have a time zone, others none"),
}  # fmt: skip


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_file_gets_one_sentence(tmp_path, name):
    content, words = MALFORMED[name]
    with pytest.raises(UsageError) as refusal:
        read(save(tmp_path / "rig.csv", content))
    text = str(refusal.value)
    assert words in text
    assert "rig.csv: " in text
    assert len(text.splitlines()) == 1


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    write_hdf5(tmp_path / "rig.h5")
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    from dockloop.base.errors import DockloopError

    with pytest.raises(DockloopError, match=r"rig\.h5: the package h5py is needed here"):
        read_table(tmp_path / "rig.h5")
