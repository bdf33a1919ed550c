"""Sweeps: files that are refused, and the table with all that is said of it.

1. Bad sweeps are refused with file, member, value and limit.
2. The table: the worst case runs alone to the bits of its row; the metadata holds the set-up; named
   cases set what they name.
3. Two passes: rows are bit for bit those of a sweep at the first or at the second accuracy; the
   summary has the differences; both passes are resumed; a refined case is viewed as it ran last.
4. Many cases: a table in parts has the same bytes for any number of workers and any order of the
   journal. A table is read in parts; a case of a large one is chosen in little memory.
"""

import argparse
import dataclasses
import json
import pickle
import re
import shlex
import tracemalloc
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet

import dockloop as dl
from dockloop.base import paths
from dockloop.base.errors import UsageError
from dockloop.sweeps import table as sweep_table
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import read_sweep
from dockloop.sweeps.table import read_table_metadata
from dockloop.view.cases import _choose_cases, find_case
from small_sweeps import DISC, MANY, NAMED, NORMAL, SHORT, UNIFORM, vary, write

pytestmark = pytest.mark.usefixtures("native")  # the bits of FMUs are compared with the core's

# ---------------------------------------------------------------- refused files

SHIPPED = sorted(file.stem for file in paths.SWEEPS.glob("*.toml"))

BAD_FILES = {
    "scene lacks": ("[[vary]]\n" + UNIFORM, "lacks the member 'scene'"),
    "no cases": (vary(UNIFORM, 0), "cases is 0: must be at least 1"),
    "sampling": (vary(UNIFORM, 2, 'sampling = "sobl"'), "(did you mean 'sobol'?)"),
    "type": (vary(UNIFORM.replace("uniform", "unifrom")), 'vary[1].type is "unifrom": must be'),
    "member": (vary(UNIFORM + "\nlimit = 3"), "unknown member 'limit': must be one of "),
    "range": (vary(UNIFORM.replace("10.0, 20.0", "3.0, 2.0")), "vary[1].range is [3.0, 2.0]: must"),
    "radius": (vary(DISC.replace("0.1, 0.3", "-1.0, 0.3")), "vary[1].range[1] is -1.0: a radius"),
    "direction": (vary(DISC.replace("_direction_deg", "_speed")), "must be a key in degrees"),
    "deviation": (vary(NORMAL.replace("2.0", "0.0")), "deviation is 0.0: must be greater than 0"),
    "twice": (vary(UNIFORM + "\n[[vary]]\n" + NORMAL), "vary[2] varies 'chaser.mass', which vary"),
    "mixed": (
        vary('type = "grid"\nname = "chaser.mass"\nvalues = [1, "b"]'),
        "vary[1].values has [1, 'b']: must be all of one kind",
    ),
    "repeated": (
        vary('type = "grid"\nname = "chaser.mass"\nvalues = [1, 2]', 3),
        "cases is 3: must be 1 when only grids and named cases vary",
    ),
    "nothing": (vary('type = "cases"\nname = "variant"\ncases = {}'), "vary[1].cases"),
    "decided": (
        vary(NAMED + "\n[[vary]]\n" + UNIFORM),
        "vary[2] varies 'chaser.mass', which vary[1] decides already",
    ),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_sweep_file_is_refused(tmp_path, name):
    text, words = BAD_FILES[name]
    with pytest.raises(UsageError) as error:
        read_sweep(str(write(tmp_path, text)))
    assert words in str(error.value)
    assert "mine.toml" in str(error.value)
    assert "\n" not in str(error.value)


BAD_NAMES = {
    "unknown": ('type = "uniform"\nname = "chaser.mas"\nrange = [1, 2]', "mean 'chaser.mass'"),
    "computed": ('type = "uniform"\nname = "energy.kinetic"\nrange = [1, 2]', "is computed"),
    "choice": (
        'type = "uniform"\nname = "model.flight"\nrange = [1, 2]',
        "must be one of resting, integrated",
    ),
    "name": (
        'type = "grid"\nname = "model.flight"\nvalues = ["restin"]',
        "vary 'model.flight': is 'restin': must be one of resting, integrated (did you mean",
    ),
    "unknown in a case": (
        NAMED.replace("chaser.mass", "chaser.mas"),
        "vary 'variant', case 'heavy': 'chaser.mas': is neither a key",
    ),
    "column": (
        NAMED.replace("variant", "outcome"),
        "'outcome': is the column of the names of cases",
    ),
    "outcome": (UNIFORM, "outcomes lists 'outcom', which is no output", 'outcomes = ["outcom"]'),
    "worst": (
        UNIFORM,
        "worst is 'phase': must be one of the outcomes",
        'worst = "phase"\noutcomes = ["outcome"]',
    ),
}


@pytest.mark.parametrize("name", BAD_NAMES)
def test_a_name_that_the_scene_and_its_fmu_do_not_have_is_refused(tmp_path, name):
    text, words, *more = BAD_NAMES[name]
    with pytest.raises(UsageError) as error:
        Planner(read_sweep(str(write(tmp_path, vary(text, more="".join(more))))))
    assert words in str(error.value)


def test_the_command_line_refuses_bad_usage(dockloop):
    for arguments, words in (
        (["sweep", "idss_initial"], "did you mean 'idss_initial_conditions'"),
        (["sweep", "no.toml"], "no.toml: no such sweep file"),
        (["sweep", "absorber_1d_speeds", "--workers", "0"], "must be at least 1"),
        (["sweep", "absorber_1d_speeds", "-o", "t.csv"], "must end in .parquet"),
    ):
        refused = dockloop(*arguments)
        assert refused.status == 2, refused
        assert words in refused.err, refused
        assert refused.err.count("\n") == 1, refused


# ---------------------------------------------------------------- the table


def test_the_worst_case_runs_alone_to_the_bits_of_its_row(dockloop, cluster, reference, tmp_path):
    path, _ = reference
    summary = dockloop.read(
        "sweep", path, "--scheduler", cluster.scheduler_address, "--json", "--csv"
    )
    for file in summary["files"]:
        assert Path(file).stat().st_size > 0, file
    assert {Path(file).suffix for file in summary["files"]} == {".parquet", ".csv", ".png", ".json"}
    rows = parquet.read_table(summary["files"][0]).to_pylist()
    worst = rows[summary["worst"]["case"] - 1]
    assert worst["capture.peak.load_ratio"] == max(row["capture.peak.load_ratio"] for row in rows)

    program, *command = shlex.split(summary["worst"]["command"])
    assert program == "dockloop"
    alone = dockloop.succeed(*command, "--no-plots", "--json", "-o", "worst.npz")
    assert json.loads(alone.out)["outcome"] == worst["outcome"]
    recorded = np.load("worst.npz")
    last = dict(zip(recorded["names"].tolist(), recorded["values"][-1].tolist(), strict=True))
    compared = [name for name in worst if name in last and name != "outcome"]
    assert len(compared) >= 9, compared
    for name in compared:
        expected = last[name] if last[name] >= 0.0 or "time" not in name else None
        assert worst[name] == expected, name
    assert worst["end_time"] == last["time"]


def test_the_metadata_of_the_table_holds_units_and_the_whole_set_up(reference, tmp_path):
    path, whole = reference
    schema = parquet.read_schema(whole)
    reported = {key.decode(): value.decode() for key, value in schema.metadata.items()}
    assert reported["dockloop.sweep"] == SHORT
    assert reported["dockloop.scene"] == (paths.SCENES / "idss_25t_350t.toml").read_text()
    assert json.loads(reported["dockloop.model"])["mechanism"]["name"] == "idss_hexapod"
    assert json.loads(reported["dockloop.mechanisms"]) == {}  # it is a shipped one
    assert reported["dockloop.seed"] == "7"
    assert json.loads(reported["dockloop.experiment"])["step"] == 0.25
    assert set(json.loads(reported["dockloop.versions"])) >= {"dockloop", "numpy", "scipy", "fmpy"}
    assert len(bytes.fromhex(reported["dockloop.model_sha256"])) == 32
    units = {field.name: field.metadata[b"unit"].decode() for field in schema}
    assert units["initial.lateral_offset"] == "m"
    assert units["initial.lateral_direction_deg"] == "deg"
    assert units["initial.closing_speed"] == "m/s"
    assert units["friction.coefficient"] == "1"
    assert units["capture.peak.compression"] == "N"
    assert units["capture.peak.bending"] == "N.m"
    said = schema.field("time_of_capture").metadata[b"description"].decode()
    assert said.endswith("the first capture; empty if it did not happen")
    # The table alone is enough to make the sweep again.
    again = write(tmp_path, reported["dockloop.sweep"], "again")
    assert list(read_sweep(str(again)).cases) == list(read_sweep(str(path)).cases)


def test_named_cases_set_what_they_name_and_nothing_else(dockloop, tmp_path):
    write(tmp_path, vary(NAMED, more="[experiment]\nstop = 3.0\nstep = 0.5"))
    sweep = dockloop.succeed("sweep", "mine.toml", "--no-plots")
    rows = parquet.read_table("build/sweeps/mine/mine.parquet").to_pylist()
    assert [row["variant"] for row in rows] == ["as it is", "heavy"]
    lines = sweep.out.partition("\nCases\n")[2].splitlines()
    table = [line.split() for line in lines]
    assert table[0][0] == "variant"
    assert [row[0] for row in table[1:3]] == ["as", "heavy"]
    for row, settings in zip(
        rows, ({}, {"chaser.mass": 30e3, "initial.closing_speed": 0.05}), strict=True
    ):
        alone = dl.run("absorber_1d", settings, stop=3.0, step=0.5)
        peak = "capture.peak.compression"
        assert row[peak] == alone[peak][-1]
    heavy = Planner(read_sweep("mine.toml")).make_command(("heavy",), 3.0)
    assert "chaser.mass=30000.0" in heavy
    assert not any("variant" in word for word in heavy)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_names_of_a_shipped_sweep_are_known(name):
    planner = Planner(read_sweep(name))
    assert all(quantity.unit or quantity.named for quantity in planner.quantities)
    assert "capture.peak.compression" in planner.outcomes


# ---------------------------------------------------------------- two passes

PASSES = ("--accuracy", "1e-2", "--refine", "compression > 900 or not contact",
          "--refine-accuracy", "1e-4")  # fmt: skip


def test_critical_cases_run_again_at_another_accuracy(dockloop, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_table, "_PART", 5)
    path, table = write(tmp_path, SHORT), tmp_path / "own.parquet"
    command = ("sweep", str(path), *PASSES, "-o", str(table), "--no-plots", "--json", "--report")
    done = dockloop.succeed(*command)
    found = json.loads(done.out)["refined"]
    rows = parquet.read_table(table).to_pylist()
    cheap, fine = (dl.sweep(path, accuracy=each).to_dict("records") for each in (1e-2, 1e-4))
    load, changes = "capture.peak.compression", []
    for row, first, second in zip(rows, cheap, fine, strict=True):
        is_again = first[load] > 900.0
        for name, expected in (second if is_again else first).items():
            assert row[name] == expected or not np.all(pd.notna(expected)), name
        for name in ("status", "outcome", load, "capture.peak.bending"):
            assert row[f"first.{name}"] == (first[name] if is_again else None), name
        changes += [abs(first[load] - second[load]) / second[load]] if is_again else []
    assert 3 <= len(changes) == found["cases"] < 12
    peak = found["peaks"]["compression"]
    assert peak["largest"] == pytest.approx(max(changes), rel=1e-12)
    assert peak["median"] == pytest.approx(np.median(changes), rel=1e-12)
    assert 1e-6 < peak["largest"] < 0.02  # the second pass is another one, near the first
    assert found["changed"] == []
    assert f"{len(changes)} of them ran again" in (tmp_path / "own_report.html").read_text()

    # Both passes are resumed: journals that end in the first one and in the second one.
    journal, whole = tmp_path / "own.jsonl", table.read_bytes()
    lines = journal.read_bytes().splitlines(keepends=True)
    assert len(lines) == 1 + 12 + len(changes) + 1
    for kept, ran in ((5, 8 + len(changes)), (14, len(changes) - 1)):
        journal.write_bytes(b"".join(lines[:kept]))
        assert "interrupted" in dockloop(*command).err
        again = dockloop(*command, "--resume")
        assert json.loads(again.out)["time"]["ran"] == ran, again
        assert table.read_bytes() == whole

    # A case that ran again is shown as it ran last.
    worst = json.loads(done.out)["worst"]
    assert "accuracy=0.0001" in worst["command"]
    metadata = {k.decode(): v.decode() for k, v in parquet.read_schema(table).metadata.items()}
    planner, *case = find_case(table, metadata, worst["case"], tmp_path)
    shown = planner.make_command(*case)
    assert shown[3:] == shlex.split(worst["command"])[3:]


def test_passes_that_make_no_sense_are_refused(dockloop, tmp_path):
    path = str(write(tmp_path, SHORT))
    own = str(write(tmp_path, SHORT.replace("[set]", "[set]\naccuracy = 1e-3"), "own"))
    for arguments, words in (
        ((path, *PASSES[2:]), "give both, and --accuracy of that pass"),
        ((path, *PASSES[:4]), "give both, and --accuracy of that pass"),
        ((path, "--accuracy", "2"), "--accuracy 2.0: must be a number above 0, at most 1"),
        ((path, *PASSES[:5], "0.5"), "--refine-accuracy 0.5: must be a number above 0, below"),
        ((path, *PASSES[:3], "shear", *PASSES[4:]), "--refine 'shear': is a number"),
        ((path, *PASSES[:3], "", *PASSES[4:]), "--refine: is empty: must have a value"),
        ((path, *PASSES, "--rare", "miss"), "--rare and --refine: give one of them"),
        ((own, *PASSES), "own.toml: decides 'accuracy' already"),
    ):
        refused = dockloop("sweep", *arguments)
        assert (refused.status, refused.err.count("\n")) == (2, 1), refused
        assert words in refused.err, refused


def test_without_rated_loads_no_case_is_the_worst(dockloop, tmp_path):
    few = MANY.format(cases=1).replace("[3e5, 3.5e5, 4e5, 4.5e5]", "[3e5]")
    path = str(write(tmp_path, few))
    passes = ("--accuracy", "1e-2", "--refine", "load_ratio > 1", "--refine-accuracy", "1e-4")
    done = dockloop("sweep", path, *passes, "--no-plots", "-o", str(tmp_path / "own.parquet"))
    assert re.search("worst case +none: there are no rated loads", done.out), done
    assert "worst" not in json.loads((tmp_path / "own_summary.json").read_text())
    assert "no rated loads (member 'limits'), so load_ratio is always 0" in done.err


# ---------------------------------------------------------------- many cases


def test_a_table_in_parts_has_the_same_bytes_for_any_order_of_the_journal(
    dockloop, tmp_path, monkeypatch
):
    monkeypatch.setattr(sweep_table, "_PART", 512)
    path = write(tmp_path, MANY.format(cases=512))
    command = ["sweep", str(path), "--csv", "--no-plots", "--json", "-o", "own.parquet"]
    summary = dockloop.read(*command, "--workers", "1")
    table, journal = tmp_path / "own.parquet", tmp_path / "own.jsonl"
    whole = table.read_bytes()
    assert parquet.read_metadata(table).num_row_groups == 4
    rows = parquet.read_table(table).to_pylist()
    assert [row["case"] for row in rows] == list(range(1, 2049))
    csv = (tmp_path / "own.csv").read_text().splitlines()
    assert len(csv) == 2049
    assert csv[-1].startswith("2048,450000.0,")
    peaks = [row["capture.peak.compression"] for row in rows]
    assert summary["peak_loads"]["compression"]["largest"] == max(peaks)

    header, *lines = journal.read_text().splitlines(keepends=True)
    kept = [*reversed(lines[600:]), *lines[:100]]
    journal.write_text("".join([header, *kept]))
    second = dockloop.succeed(*command, "--workers", "2", "--resume")
    assert json.loads(second.out)["time"]["ran"] == 500
    assert table.read_bytes() == whole


def test_a_table_is_read_in_parts(dockloop, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_table, "_PART", 500)
    path = write(tmp_path, MANY.format(cases=512))
    command = ["sweep", str(path), "--no-plots", "-o", "own.parquet"]
    assert dockloop(*command).status == 0
    whole = pd.read_parquet("own.parquet").set_index("case", drop=False)
    parts = list(dl.read_parts("own.parquet"))
    assert max(map(len, parts)) <= 500
    pd.testing.assert_frame_equal(pd.concat(parts), whole)
    columns = ["capture.peak.compression", "target.mass"]
    few = pd.concat(dl.read_parts("own.parquet", columns))
    pd.testing.assert_frame_equal(few, whole[columns])
    assert next(dl.read_parts("own.parquet", columns)).attrs["units"] == dict(
        zip(columns, ("N", "kg"), strict=True)
    )
    with pytest.raises(UsageError, match=r"own\.parquet: has no column 'outcom' \(did you mean"):
        dl.read_parts("own.parquet", ["outcom"])
    with pytest.raises(UsageError, match="is no table of 'dockloop sweep'"):
        dl.read_parts(path)
    table = sweep_table.open_table(Path("own.parquet"))
    assert len(table) == 2048
    for row in (0, 499, 500, 2047):
        assert table.read_row(row, ["case"]) == {"case": row + 1}
    with pytest.raises(IndexError):
        table.read_row(2048, ["case"])


def test_a_case_of_a_large_table_is_chosen_in_little_memory(tmp_path):
    rows = 1 << 18
    numbers = np.arange(rows)
    outcomes = np.where(numbers % 80_000 == 777, "miss", "captured")
    outcomes[3] = "docked"  # was captured before
    failed = numbers == 5  # has no outputs
    statuses = np.where(failed, "failed", "done")
    loads = np.random.default_rng(1).random(rows)
    loads[246_543] = 2.0
    columns = {"case": numbers + 1, "status": statuses, "reason": np.full(rows, "a" * 30)}
    columns |= {f"filler{i}": loads + i for i in range(10)}
    outputs = {"outcome": outcomes, "capture.peak.load_ratio": loads}
    columns |= {name: pa.array(values, mask=failed) for name, values in outputs.items()}
    text = 'scene = "absorber_1d"\n'
    table = pa.table(columns).replace_schema_metadata({"dockloop.sweep": text})
    file = tmp_path / "own.parquet"
    parquet.write_table(table, file, row_group_size=1 << 14)
    del columns, outputs, table

    def choose(**options):
        chosen = {"cases": [], "not_captured": None} | options
        opened, metadata = sweep_table.open_table(file), read_table_metadata(file)
        return _choose_cases(file, opened, metadata, argparse.Namespace(**chosen))

    before = pa.total_allocated_bytes()
    tracemalloc.start()
    assert choose() == [246_544]
    assert choose(not_captured=3) == [778, 80_778, 160_778]
    assert choose(cases=[rows]) == [rows]
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 30e6, most
    assert pa.total_allocated_bytes() - before < 30e6
    with pytest.raises(UsageError, match=r"--case 6: was not done in .* \(a{30}\)"):
        choose(cases=[6])
    with pytest.raises(UsageError, match="has the cases 1 to 262144"):
        choose(cases=[0])


def test_a_sweep_of_python_writes_its_table(tmp_path):
    members = {
        "scene": "absorber_1d",
        "histories": ["relative.axial"],
        "vary": [{"type": "grid", "name": "chaser.mass", "values": [2e4, 3e4]}],
        "experiment": {"stop": 0.5, "step": 0.25},
    }
    with pytest.raises(UsageError, match=r"own\.csv: must end in \.parquet"):
        dl.sweep(members, output=tmp_path / "own.csv")
    assert not list(tmp_path.iterdir())
    table = dl.sweep(members, output=tmp_path / "own.parquet", workers=1)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"own.parquet", "own.jsonl", "own_histories.parquet"}
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "own.parquet"), table)
    kept = dl.read_histories(tmp_path / "own_histories.parquet")
    assert kept[2] == table.attrs["histories"][2]
    again = dl.sweep(members, output=tmp_path / "own.parquet", resume=True, workers=1)
    assert again.attrs["summary"]["time"]["ran"] == 0


@pytest.mark.parametrize("names", [["chaser.mass", "target.mass"], ["chaser.ma*s"]])
def test_heads_of_cases_are_distinct(dockloop, tmp_path, names):
    """Last parts of names are heads, but not where they are the same, nor a star."""
    grids = (f'type = "grid"\nname = "{name}"\nvalues = [3e4]' for name in names)
    write(tmp_path, vary("\n[[vary]]\n".join(grids), more="[experiment]\nstop = 0.5\nstep = 0.5"))
    made = dockloop.succeed("sweep", "mine.toml", "--no-plots").out
    heads = made.partition("\nCases\n")[2].splitlines()[0]
    assert re.split(r"  +", heads.strip())[: len(names)] == names


def test_what_named_cases_set_are_columns():
    """A name that a case leaves to the scene is empty; all have units."""
    cases = {
        "nominal": {},
        "heavy": {"chaser.mass": 30e3, "initial.closing_speed": 0.05},
        "implicit": {"solver.method": "bdf"},
    }
    table = dl.sweep(
        {
            "scene": "idss_25t_350t",
            "outcomes": ["chaser.position[1]"],
            "vary": [
                {"type": "cases", "name": "variant", "cases": cases},
                {"type": "grid", "name": "friction.coefficient", "values": [0.1, 0.2]},
            ],
            "experiment": {"stop": 0.02, "step": 0.01},
        }
    )
    assert list(table["status"]) == ["done"] * 6, list(table["reason"])
    assert list(table["variant"]) == [name for name in cases for _ in range(2)]
    for name in ("chaser.mass", "initial.closing_speed"):
        assert table[name].isna().tolist() == [True, True, False, False, True, True]
        assert table[name][2:4].tolist() == [cases["heavy"][name]] * 2
    assert table["solver.method"][4] == "bdf"
    assert list(table["friction.coefficient"]) == [0.1, 0.2] * 3
    assert table.attrs["units"]["chaser.mass"] == "kg"
    assert table.attrs["units"]["initial.closing_speed"] == "m/s"


def test_names_with_a_star_set_all_that_are_like_them():
    sweep = {
        "scene": "absorber_1d",
        "outcomes": ["relative.axial"],
        "vary": [{"type": "grid", "name": "*.mass", "values": [800.0, 1000.0]}],
        "experiment": {"stop": 3.0, "step": 1.0},
    }
    table = dl.sweep(sweep)
    for mass, axial in zip(table["*.mass"], table["relative.axial"], strict=True):
        both = dict.fromkeys(("chaser.mass", "target.mass"), mass)
        assert dl.run("absorber_1d", None, both, stop=3.0, step=1.0)["relative.axial"][-1] == axial
    assert table.attrs["units"]["*.mass"] == "kg"
    sweep["vary"][0]["name"] = "*.mas"
    with pytest.raises(dl.UsageError, match=r"like '\*\.mas' \(did you mean 'mass'"):
        dl.sweep(sweep)


def test_names_with_a_star_mean_keys_of_the_scene_as_well():
    sweep = {
        "scene": "absorber_1d",
        "outcomes": ["relative.axial"],
        "vary": [{"type": "grid", "name": "solver.*tol", "values": [1e-4, 1e-6]}],
        "experiment": {"stop": 3.0, "step": 1.0},
    }
    for engine in ("core", "fmu"):
        table = dl.sweep(sweep, engine=engine)
        for tolerance, axial in zip(table["solver.*tol"], table["relative.axial"], strict=True):
            alone = dl.run("absorber_1d", {"solver.rtol": tolerance}, stop=3.0, step=1.0)
            assert alone["relative.axial"][-1] == axial
    sentence = r"varies 'solver\.rtol', which set 'solver\.rtol' decides already"
    with pytest.raises(dl.UsageError, match=sentence):
        dl.sweep({**sweep, "set": {"solver.rtol": 1e-5}})


def check_values_of_python(table, found):
    """A table with histories is written, copied and compared as any other."""
    kept = table.attrs["histories"]
    assert kept == pickle.loads(pickle.dumps(kept)) != {1: kept[1]}
    assert (kept == found) == bool(kept[1] == found[1] and kept[2] == found[2])
    assert kept[1] == dataclasses.replace(kept[1], wall={"loop": 1.0}) != kept[2]
    table.to_parquet("copy.parquet")
    copy = pd.read_parquet("copy.parquet")
    assert copy.equals(table)
    assert copy.attrs == {**table.attrs, "histories": {}}
    for what in (lambda: kept[1].summary, lambda: kept[1].view("own.html")):
        with pytest.raises(dl.UsageError, match=r"run the case by itself with dl\.run"):
            what()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: dl.sweep("absorber_1d_speeds", accuracy=[1]), r"accuracy \[1\]: must be a number"),
        (
            lambda: dl.sweep("absorber_1d_speeds", accuracy=1, refine=3, refine_accuracy=0.1),
            "refine is 3: must be a text",
        ),
        (lambda: dl.sweep("absorber_1d_speeds", engine="fmus"), "engine 'fmus': must be one of"),
        (lambda: dl.sweep("absorber_1d_speeds", output=3), "output is 3: must be the path"),
        (lambda: dl.sweep("absorber_1d_speeds", scheduler=3), "scheduler is 3: must be a text"),
        (lambda: dl.read_histories(3), "path is 3: must be the path of a file"),
        (lambda: dl.read_parts(None), "path is None: must be the path of a file"),
    ],
)
def test_an_argument_of_the_wrong_kind_is_refused_in_one_sentence(call, words):
    with pytest.raises(dl.UsageError, match=words):
        call()


HISTORIES = """
scene = "absorber_1d"
histories = ["relative.axial", "chaser.velocity", "capture.tens*"]
experiment = { stop = 0.6, step = 0.1, end_after_outcome = 0.2 }
vary = [{ type = "grid", name = "initial.closing_speed", values = [0.02, 0.1] }]
"""


def test_a_sweep_keeps_chosen_histories(dockloop, monkeypatch, tmp_path):
    """They are those of a run, from every engine and after a resumed sweep."""
    monkeypatch.chdir(tmp_path)
    Path("own.toml").write_text(HISTORIES)
    table = dl.sweep("own.toml")
    kept = table.attrs["histories"]
    assert list(kept) == [1, 2]
    names = ["time", "relative.axial", *(f"chaser.velocity[{i}]" for i in (1, 2, 3))]
    for case, speed in ((1, 0.02), (2, 0.1)):
        alone = dl.run("absorber_1d", {"initial.closing_speed": speed}, stop=0.6, step=0.1)
        result = kept[case]
        points = len(result.time)
        assert result.time[-1] == table["end_time"][case - 1]
        assert result.names == [*names, "capture.tension"]
        assert result.units["chaser.velocity[2]"] == "m/s"
        assert np.array_equal(result.time, alone.time[:points])
        for name in ("relative.axial", "chaser.velocity", "capture.tension"):
            assert np.array_equal(result[name], alone[name][:points])
    for engine in ("core", "fmu"):
        command = ("sweep", "own.toml", "--no-plots", "-o", "own.parquet")
        assert dockloop(*command, "--engine", engine).status == 0
        if engine == "core":
            first = Path("own_histories.parquet").read_bytes()
            journal = Path("own.jsonl")
            journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:2]))
            assert dockloop(*command, "--resume").status == 0
            assert Path("own_histories.parquet").read_bytes() == first
        found = dl.read_histories("own_histories.parquet")
        assert all(np.array_equal(found[case].values, kept[case].values) for case in kept)
    with pytest.raises(dl.UsageError, match=r"own\.parquet: has no histories"):
        dl.read_histories("own.parquet")
    check_values_of_python(table, found)
    Path("own.toml").write_text(HISTORIES.replace("relative.axial", "relative.axia"))
    with pytest.raises(dl.UsageError, match=r"histories lists 'relative\.axia'.*did you mean"):
        dl.sweep("own.toml")


@pytest.mark.parametrize(
    ("name", "unit", "own"),
    [
        ("initial.closing_speed", "m/s", ""),
        ("initial.closing_speed", "m.s-1", ""),
        ("initial.closing_speed", "cm/s", "m/s"),
        ("target.angular_velocity.1", "deg/s", "rad/s"),
    ],
)
def test_a_unit_is_that_of_the_quantity(dockloop, tmp_path, name, unit, own):
    text = f'type = "grid"\nname = "{name}"\nunit = "{unit}"\nvalues = [0.1, 0.2]'
    file = write(tmp_path, vary(text, more="[experiment]\nstop = 0.1\nstep = 0.1\n"))
    done = dockloop("sweep", file, "-o", tmp_path / "x.parquet", "--no-plots")
    assert (done.status == 0) == (not own), done
    if own:
        assert f"the unit of '{name}' is '{unit}': must be {own}" in done.err
