"""Lists of scenarios: ``cases = "FILE"`` of a sweep and ``dl.sweep(cases=...)``.

1. A table in a file of any kind, and a DataFrame, give the cases that named cases in TOML give.
2. Units of headings are converted; empty cells are as in the scene; names and values stay.
3. The table of results needs the list no more: `dockloop view` finds the command of a case.
4. Bad lists are refused in one sentence.
"""

import re
from decimal import Decimal

import pandas as pd
import pytest

import dockloop as dl
from dockloop.sweeps.scenarios import read_scenarios
from dockloop.sweeps.table import read_table_metadata
from dockloop.view.cases import find_case

SWEEP = {"scene": "absorber_1d", "experiment": {"stop": 1.0}}
NAMED = {  # the oracle: cases as a sweep file has them
    "slow": {"initial.closing_speed": 0.05, "solver.method": "bdf", "chaser.mass": 2e4},
    "as it is": {"solver.method": "explicit"},
    "3": {"initial.closing_speed": 0.125, "solver.method": "explicit", "chaser.mass": 3e4},
}
TEXT = """name;initial.closing_speed [mm/s];solver.method;chaser.mass [t]
slow;50,0;bdf;20
as it is;;explicit;
3;125,0;explicit;30
"""
FRAME = pd.DataFrame([{"name": name, **settings} for name, settings in NAMED.items()])


def sweep_named(**more):
    entry = {"type": "cases", "name": "name", "cases": NAMED}
    return dl.sweep({**SWEEP, "vary": [entry, *more.pop("vary", [])], **more})


def check_equal(found, expected):
    order = sorted(expected.columns)  # of columns: that of the list
    pd.testing.assert_frame_equal(found[order], expected[order], check_dtype=False, rtol=0)


def write_list(path):
    if path.suffix == ".csv":
        path.write_text(TEXT)
    elif path.suffix == ".xlsx":
        FRAME.to_excel(path, index=False)
    else:
        FRAME.to_parquet(path)


@pytest.mark.parametrize("suffix", [".csv", ".xlsx", ".parquet"])
def test_a_list_in_a_file_gives_the_named_cases(tmp_path, monkeypatch, suffix):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own").mkdir()
    write_list(tmp_path / "own" / f"list{suffix}")
    file = tmp_path / "own" / "mine.toml"
    file.write_text(f'scene = "absorber_1d"\ncases = "list{suffix}"\n[experiment]\nstop = 1.0\n')
    found = dl.sweep(file)
    assert found["name"].tolist() == list(NAMED)
    assert found["status"].tolist() == ["done"] * 3
    assert found.attrs["units"]["initial.closing_speed"] == "m/s"
    check_equal(found, sweep_named())


def test_a_frame_gives_the_named_cases_and_meets_a_grid():
    grid = {"type": "grid", "name": "target.mass", "values": [3e5, 4e5]}
    found = dl.sweep({**SWEEP, "vary": [grid]}, cases=FRAME)
    assert found["name"].tolist() == [name for name in NAMED for _ in range(2)]
    check_equal(found, sweep_named(vary=[grid]))
    by_index = dl.sweep(SWEEP, cases=FRAME.set_index("name"))
    check_equal(by_index, sweep_named())
    without = dl.sweep(SWEEP, cases=FRAME.drop(columns="name"))
    assert without["name"].tolist() == ["1", "2", "3"]


def test_frames_of_databases_and_headings_of_people():
    decimals = FRAME.assign(**{"chaser.mass": [Decimal("20000"), None, Decimal("30000")]})
    check_equal(dl.sweep(SWEEP, cases=decimals.rename(columns={"name": "Name"})), sweep_named())
    both = FRAME.set_index("name", drop=False)  # pandas cannot put the index back
    check_equal(dl.sweep(SWEEP, cases=both), sweep_named())


def test_the_table_needs_the_list_no_more(dockloop, tmp_path):
    write_list(tmp_path / "list.csv")
    (tmp_path / "mine.toml").write_text(
        'scene = "absorber_1d"\ncases = "list.csv"\n[experiment]\nstop = 1.0\n'
    )
    for more in ((), ("--resume",)):
        ran = dockloop.succeed("sweep", "mine.toml", "-o", "own.parquet", "--no-plots", *more)
        assert re.search("  table +text: sep ';', decimal ',', names from line 1\n", ran.out)
    (tmp_path / "list.csv").unlink()
    (tmp_path / "folder").mkdir()
    metadata = read_table_metadata(tmp_path / "own.parquet")
    planner, *case = find_case(tmp_path / "own.parquet", metadata, 1, tmp_path / "folder")
    words = planner.make_command(*case)
    assert "initial.closing_speed=0.05" in words
    assert "chaser.mass=20000.0" in words
    assert 'solver.method="bdf"' in words


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name,chaser.mas\na,1\n", "the table list.csv has 'chaser.mas': is neither a key"),
        ("name,chaser.mas\na,1\n", "did you mean 'chaser.mass'"),
        ("name,captured\na,1\n", "'captured': is computed by the FMU"),
        (
            "name,chaser.mass [m]\na,1\n",
            "list.csv: 'chaser.mass' is in 'm': must be in a unit of kg",
        ),
        ("name,chaser.mass\na,1\na,2\n", "list.csv: 'name' in line 3 is 'a' again"),
        ("name,chaser.mass\n,1\n", "list.csv: 'name' in line 2 is empty"),
        ("name,chaser.mass\na,1\nb,heavy\n", "'chaser.mass' in line 3 is 'heavy', other cells"),
        ("name,chaser.mass\n-,[t]\na,1\n", "write the unit in the heading, `chaser.mass [t]`"),
        ("name,chaser.mass\na,1\nb,heavy\n", "all true or false, or all texts"),
        ('name,chaser.mass\na,"1\n', "unexpected end of data): close its quotes"),
        ("name,chaser.mass\na,1\nb,2,3\n", "line 3 has 3 values: must have 2"),
        ("name,chaser.mass,chaser.mass\na,1,2\n", "has two columns 'chaser.mass'"),
        (",chaser.mass\n0,1\n1,2\n", "has a column without a name"),
        ("name\na\n", "has no column but 'name'"),
        ("name,chaser.mass\n", "has no rows of values below its header"),
    ],
)
def test_bad_lists_are_refused(tmp_path, monkeypatch, text, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(dl.UsageError) as refusal:
        dl.sweep({**SWEEP, "cases": "list.csv"})
    assert words in str(refusal.value)
    assert "--csv" not in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("suffix", [".csv", ".xlsx"])
def test_names_may_begin_like_comments(tmp_path, suffix):
    names = ["#1", "!2", "%3", "//4", "5"]
    rows = [["# my cases", None], ["name", "initial.closing_speed"], *([n, 0.05] for n in names)]
    file = tmp_path / f"list{suffix}"
    if suffix == ".csv":
        file.write_text("".join(",".join(map(str, filter(None, row))) + "\n" for row in rows))
    else:
        pd.DataFrame(rows).to_excel(file, index=False, header=False)
    entry, _ = read_scenarios(file, tmp_path / "own.toml")
    assert entry["cases"] == {name: {"initial.closing_speed": 0.05} for name in names}


def test_names_are_texts(tmp_path):
    names = ["001", "1", "0.10", "true", "1e3", "none"]
    rows = "".join(f" {name} ,0.05\n" for name in names)
    (tmp_path / "list.csv").write_text(f"name,initial.closing_speed\n{rows}")
    assert list(read_scenarios("list.csv", tmp_path / "own.toml")[0]["cases"]) == names
    frame = pd.DataFrame({"name": [1.0, 2.5, "x", 3], "initial.closing_speed": 0.05}, dtype=object)
    assert list(read_scenarios(frame, tmp_path / "own.toml")[0]["cases"]) == ["1", "2.5", "x", "3"]


DRAWN = {"type": "uniform", "name": "target.mass", "range": [3e5, 4e5]}


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({}, "lacks the member 'vary', or a table of cases"),
        ({"cases": ""}, "cases is empty"),
        ({"cases": ["a"]}, "cases is [\"a\"]: must be a text or a whole number"),
        ({"cases": "none.csv"}, "none.csv: no such table"),
        ({"cases": FRAME, "vary": [DRAWN]}, "draws 'target.mass' at random, but the cases are"),
        ({"cases": FRAME, "set": {"chaser.mass": 1e4}}, "varies 'chaser.mass', which set decides"),
        (
            {"cases": FRAME, "vary": [{"type": "grid", "name": "chaser.mass", "values": [1e4]}]},
            "vary[1] varies 'chaser.mass', which the table cases decides already",
        ),
    ],
)  # fmt: skip
def test_bad_sweeps_with_lists_are_refused(tmp_path, monkeypatch, members, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(dl.UsageError) as refusal:
        dl.sweep({**SWEEP, **members})
    assert words in str(refusal.value)
