"""Sweeps: how cases are sampled, run on workers, kept, resumed and reported.

1. Samples: every kind of distribution has its shape; the seed decides; grids meet equal samples.
2. Files: bad sweeps are refused with file, member, value and limit.
3. Planning: one FMU set by start values, and reset between cases, gives the bits of an FMU of its
   own, for every kind of quantity; an early end gives the bits of a run to that time.
4. The table: the same bytes with two workers, one of which is killed on the way, with one worker
   after Ctrl-C and a torn journal (by either engine), and from a foreign scheduler; the worst case
   runs alone to the bits of its row; the metadata holds the set-up; the linear absorber gives its
   linear answer.
5. Failures are rows: refused by the scene, by the FMU, a step discarded, a worker lost.
6. Two passes: rows are bit for bit those of a sweep at the first or at the second accuracy; the
   summary has the differences; both passes are resumed; a refined case is viewed as it ran last.
7. Many cases: a million are planned in the memory of their samples; a table in parts has the same
   bytes for any number of workers and any order of the journal. A table is read in parts; a case of
   a large one is chosen in little memory.
8. Repeats: cases that come to the same scene run once; the table has the bytes of a sweep that runs
   all of them, by both engines and after --resume.
9. The journal: a line that was changed is reported once and its case is run again, all others are
   kept; a full disk loses nothing; the finished table of another sweep stays.
"""

import argparse
import json
import math
import os
import shlex
import signal
import subprocess
import sys
import threading
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

import dask
import pandas as pd
import pyarrow as pa
from distributed import LocalCluster
from pyarrow import parquet

import dockloop as dl
from dockloop import executors, paths, sweep_report
from dockloop.cases import Job, LoadedFmu, Result
from dockloop.core import list_final_outcomes
from dockloop.errors import UsageError
from dockloop.planning import Planner
from dockloop.sampling import Passes, as_setting, read_sweep
from dockloop.simulate import ProgressBar
from dockloop.sweeps import Journal, read_table_metadata, run_sweep
from dockloop.view.command import _choose_cases, find_command
from mishaps import Cluster, full_disk, lines_of, wait_for_lines

SHIPPED = sorted(file.stem for file in paths.SWEEPS.glob("*.toml"))

# Twelve short dockings with adaptive steps.
SHORT = """
scene = "idss_25t_350t"
seed = 7
cases = 12
[set]
"initial.approach_time" = 0.1
[[vary]]
type = "disc"
magnitude = "initial.lateral_offset"
direction = "initial.lateral_direction_deg"
range = [0.0, 0.1]
[[vary]]
type = "uniform"
name = "initial.closing_speed"
range = [0.05, 0.1]
[[vary]]
type = "uniform"
name = "friction.coefficient"
range = [0.0, 0.3]
[experiment]
stop = 1.5
step = 0.25
"""


def write(folder: Path, text: str, name: str = "mine") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def vary(text: str, cases: int = 1, more: str = "") -> str:
    """Return a sweep of the absorber in which one thing varies."""
    return f'scene = "absorber_1d"\ncases = {cases}\n{more}\n[[vary]]\n{text}\n'


def make_cluster(workers: int) -> LocalCluster:
    return LocalCluster(
        n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
    )


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Two worker processes of a scheduler that sweeps reach by its address."""
    two = Cluster(tmp_path_factory.mktemp("cluster"))
    yield two
    two.close()


# ---------------------------------------------------------------- samples

UNIFORM = 'type = "uniform"\nname = "chaser.mass"\nrange = [10.0, 20.0]'
NORMAL = 'type = "normal"\nname = "chaser.mass"\nmean = 10.0\ndeviation = 2.0\nrange = [9.0, 14.0]'
DISC = (
    'type = "disc"\nmagnitude = "initial.lateral_offset"\n'
    'direction = "initial.lateral_direction_deg"\nrange = [0.1, 0.3]'
)


def columns(folder, text, cases, sampling, seed=1):
    more = f'sampling = "{sampling}"\nseed = {seed}'
    return np.array(read_sweep(str(write(folder, vary(text, cases, more)))).cases).T


def normal_part(x):
    """Return the distribution function of NORMAL, by the error function."""
    phi = [0.5 * (1.0 + math.erf((v - 10.0) / 2.0 / math.sqrt(2.0))) for v in (*x, 9.0, 14.0)]
    return (np.array(phi[:-2]) - phi[-2]) / (phi[-1] - phi[-2])


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_distributions_have_their_shape(tmp_path, sampling):
    """Each quantity, mapped to what must be uniform, against the uniform distribution."""
    (u,) = columns(tmp_path, UNIFORM, 1024, sampling)
    (x,) = columns(tmp_path, NORMAL, 1024, sampling)
    r, direction = columns(tmp_path, DISC, 1024, sampling)
    assert 9.0 <= x.min() <= x.max() <= 14.0
    assert 0.1 <= r.min() <= r.max() <= 0.3
    parts = {
        "uniform": (u - 10.0) / 10.0,
        "normal": normal_part(x),
        "disc, area": (r**2 - 0.01) / 0.08,
        "disc, direction": direction / 360.0,
    }
    for name, part in parts.items():
        if sampling == "random":
            steps = np.arange(1024) / 1024
            distance = np.abs(np.sort(part) - steps).max()
            assert distance < 1.95 / 32.0, (name, distance)  # Kolmogorov, 0.1 %
        else:  # one sample in each of 1024 strata
            strata = np.floor(part * 1024 * (1.0 + 1e-13)).astype(int)
            assert len(set(strata.tolist())) == 1024, (name, len(set(strata.tolist())))


def test_a_disc_is_uniform_over_its_area(tmp_path):
    """Sobol: every cell of 8 rings of equal area and 8 sectors gets its 16 of 1024 samples."""
    r, direction = columns(tmp_path, DISC, 1024, "sobol")
    ring = np.floor((r**2 - 0.01) / 0.08 * 8).astype(int).clip(0, 7)
    sector = np.floor(direction / 45.0).astype(int)
    counts = np.zeros((8, 8), int)
    np.add.at(counts, (ring, sector), 1)
    assert (counts == 16).all(), counts
    y, z = r * np.cos(np.radians(direction)), r * np.sin(np.radians(direction))
    assert abs(y.mean()) < 1e-3, y.mean()
    assert abs(z.mean()) < 1e-3, z.mean()


def test_a_disc_of_equal_radii_is_its_rim(tmp_path):
    r, direction = columns(tmp_path, DISC.replace("0.1, 0.3", "0.3, 0.3"), 16, "sobol")
    assert (r == 0.3).all(), r
    assert len(set(direction)) == 16


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_the_seed_decides_the_samples(tmp_path, sampling):
    first = columns(tmp_path, DISC, 64, sampling)
    assert (columns(tmp_path, DISC, 64, sampling) == first).all()
    assert (columns(tmp_path, DISC, 64, sampling, seed=2) != first).any(axis=1).all()


def test_more_cases_of_a_sobol_sequence_begin_with_the_same_cases(tmp_path):
    few, many = (columns(tmp_path, DISC, count, "sobol") for count in (24, 100))
    assert (many[:, :24] == few).all()


def test_every_grid_point_meets_the_same_samples(tmp_path):
    grids = (
        'type = "grid"\nname = "target.mass"\nvalues = [1, 2]\n[[vary]]\n'
        + UNIFORM
        + '\n[[vary]]\ntype = "grid"\nname = "mechanism.name"\nvalues = ["a", "b", "c"]'
    )
    cases = read_sweep(str(write(tmp_path, vary(grids, 4)))).cases
    points = [(m, n) for m in (1, 2) for n in ("a", "b", "c")]
    assert [(case[0], case[2]) for case in cases] == [p for p in points for _ in range(4)]
    samples = [case[1] for case in cases]
    assert samples == 6 * samples[:4]
    assert len(set(samples)) == 4


def test_the_shipped_sweep_fills_the_box_of_the_standard():
    """Limits of IDSS table 3.3.1.1-2: reached to a percent, never passed."""
    shipped = read_sweep("idss_initial_conditions")
    values = dict(zip((q.name for q in shipped.quantities), np.array(shipped.cases).T, strict=True))
    limits = {
        "initial.lateral_offset": 0.10,
        "initial.lateral_speed": 0.04,
        "initial.pitch_yaw_deg": 4.0,
        "initial.pitch_yaw_rate_deg_s": 0.2,
        "initial.roll_deg": 4.0,
        "initial.roll_rate_deg_s": 0.2,
        "initial.closing_speed": 0.10,
    }
    for name, limit in limits.items():
        largest = np.abs(values[name]).max()
        assert 0.99 * limit < largest <= limit, (name, largest)
    assert 0.05 <= values["initial.closing_speed"].min() < 0.0505


# ---------------------------------------------------------------- files

NAMED = """type = "cases"
name = "variant"
[vary.cases."as it is"]
[vary.cases."heavy"]
"chaser.mass" = 30e3
"initial.closing_speed" = 0.05
"""

BAD_FILES = {
    "scene lacks": ("[[vary]]\n" + UNIFORM, "lacks the member 'scene'"),
    "no cases": (vary(UNIFORM, 0), "cases is 0: must be at least 1"),
    "sampling": (vary(UNIFORM, 2, 'sampling = "sobl"'), "(did you mean 'sobol'?)"),
    "type": (vary(UNIFORM.replace("uniform", "unifrom")), 'vary[1].type is "unifrom": must be'),
    "member": (vary(UNIFORM + "\nlimit = 3"), "vary[1] has an unknown member 'limit'"),
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
        "vary 'model.flight' is 'restin': must be one of resting, integrated (did you mean",
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


# ---------------------------------------------------------------- planning

QUANTITIES = {
    "initial.closing_speed": 0.07,
    "chaser.mass": 12e3,
    "chaser.mass_includes_mechanism": 2,
    "chaser.contact_thrust": 1500.0,
    "contact.friction_coefficient": 0.25,
    "chaser.interface_position[2]": 0.01,  # no scene key: a start value of the FMU
    "mechanism.set.leg_defaults.stiffness": 2500.0,  # no start value: an FMU of its own
    "solver.rtol": 1e-5,
}
CAPTURED = "idss_25t_350t"
ENDS = ("time_of_contact", "capture.peak.compression", "capture.peak.bending", "relative.axial")


def test_one_fmu_that_is_reset_gives_the_bits_of_an_fmu_for_each_case(tmp_path, runs):
    """Every kind of quantity, one case after the other, against FMUs built for one case each."""
    entries = "".join(
        f'[[vary]]\ntype = "grid"\nname = "{name}"\nvalues = [{value}]\n'
        for name, value in QUANTITIES.items()
    )
    text = f'scene = "{CAPTURED}"\noutcomes = {json.dumps(ENDS)}\n' + entries
    text += "[experiment]\nstop = 2.5\nstep = 0.5\n"
    planner = Planner(read_sweep(str(write(tmp_path, text))))
    quantities, loaded, fmus = planner.quantities, {}, set()
    for quantity in quantities:
        planner.quantities = [quantity]  # the others stay as in the scene
        value = QUANTITIES[quantity.name]
        plan = planner.plan((value,))
        fmus.add(plan.fmu)
        if plan.fmu not in loaded:
            loaded[plan.fmu] = LoadedFmu(planner.fmu(plan.fmu)[1])
        result = loaded[plan.fmu].run(plan.job)
        reported = [as_setting(quantity.name, value)]
        scene_key = planner.is_scene_key(quantity.name)
        alone = runs.run(
            CAPTURED,
            *(reported if scene_key else ()),
            settings=() if scene_key else tuple(reported),
            stop=2.5,
            step=0.5,
        )
        ends = result.outputs[: len(ENDS)]  # what explains a capture comes after them
        assert ends == tuple(alone[name][-1] for name in ENDS), quantity
    for fmu in loaded.values():
        fmu.close()
    assert len(fmus) == 3, len(fmus)  # the base, another mechanism, another tolerance


def test_an_early_end_gives_the_bits_of_a_run_to_that_time(runs):
    fmu = LoadedFmu(runs.fmu(CAPTURED).read_bytes())
    result = fmu.run(Job((), ENDS, 20.0, 0.25, 1.5, list_final_outcomes()))
    fmu.close()
    captured_at = 3.25  # the first communication point after 3.08 s
    assert result.end_time == captured_at + 1.5
    alone = runs.run(CAPTURED, stop=result.end_time, step=0.25)
    assert result.outputs == tuple(alone[name][-1] for name in ENDS)


# ---------------------------------------------------------------- the table


def run(path: Path, output: Path, **options) -> Path:
    """Run a sweep and write its table, without the command line."""
    read = read_sweep(str(path))
    ran = run_sweep(read, output, **options)
    sweep_report.write_table(read, ran["planner"], ran["results"], None, output)
    return output


@pytest.fixture(scope="module")
def reference(cluster, tmp_path_factory):
    """The sweep SHORT and its table from two workers."""
    folder = tmp_path_factory.mktemp("reference")
    path = write(folder, SHORT)
    return path, run(path, folder / "mine.parquet", scheduler=cluster.scheduler_address)


def test_a_killed_worker_changes_no_bit(cluster, reference, tmp_path):
    path, whole = reference
    output = tmp_path / "mine.parquet"
    killed = []

    def kill() -> None:
        wait_for_lines(output.with_suffix(".jsonl"), 2)
        killed.append(lines_of(output.with_suffix(".jsonl")))
        cluster.workers[0].kill()

    killer = threading.Thread(target=kill)
    killer.start()
    run(path, output, scheduler=cluster.scheduler_address)
    killer.join()
    assert killed[0] < 12, "the sweep was over before the worker was killed"
    assert cluster.workers[0].wait(timeout=60) == -signal.SIGKILL
    assert output.read_bytes() == whole.read_bytes()
    cluster.workers[0] = cluster.start_worker()


@pytest.mark.parametrize("engine", ["core", "fmu"])
def test_an_interrupted_sweep_goes_on_to_the_same_table_with_one_worker(
    dockloop, reference, tmp_path, engine
):
    """Ctrl-C, then a line torn in the middle, then --resume: nothing twice, no bit different."""
    path, whole = reference
    if engine == "core":  # its compiler is another one than that of portable FMUs
        whole = tmp_path / "whole.parquet"
        dockloop("sweep", str(path), "--engine", engine, "-o", str(whole), "--no-plots")
    output, journal = tmp_path / "mine.parquet", tmp_path / "mine.jsonl"
    command = ["sweep", str(path), "--engine", engine, "--workers", "1", "-o", str(output)]
    command.append("--no-plots")
    # Where tests run in the background, Ctrl-C is ignored, and that is inherited.
    program = ["env", "--default-signal=INT", sys.executable, "-m", "dockloop"]
    first = subprocess.Popen(
        [*program, *command], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    wait_for_lines(journal, 3)
    os.killpg(first.pid, signal.SIGINT)  # as a terminal does: to all processes
    said = first.communicate(timeout=60)[1]
    assert first.returncode == 130, said
    assert said.count("\n") == 1, said
    assert "of 12 cases" in said, said
    assert "--resume" in said, said
    kept = lines_of(journal)
    assert 3 <= kept < 12, kept
    assert not output.exists()

    refused = dockloop(*command)
    assert refused.status == 2, refused
    assert f"holds {kept} of 12 cases" in refused.err, refused
    journal.write_bytes(journal.read_bytes()[:-10])
    done = dockloop(*command, "--resume", "--json")
    assert done.status == 0, done
    summary = json.loads(done.out)
    assert summary["time"]["ran"] == 12 - (kept - 1)
    assert summary["time"]["workers"] == 1
    assert output.read_bytes() == whole.read_bytes()
    _, *lines = journal.read_text().splitlines()
    assert len({str(json.loads(line)["values"]) for line in lines}) == len(lines) == 12


def test_a_finished_sweep_goes_on_with_more_cases(cluster, reference, tmp_path):
    path, whole = reference
    more = write(tmp_path, SHORT.replace("cases = 12", "cases = 14"))
    journal = tmp_path / "mine.jsonl"
    journal.write_bytes((path.parent / "mine.jsonl").read_bytes())
    output = run(more, tmp_path / "mine.parquet", scheduler=cluster.scheduler_address, resume=True)
    both = [parquet.read_table(file).to_pylist() for file in (whole, output)]
    assert len(both[1]) == 14
    assert both[1][:12] == both[0]
    other = write(tmp_path, SHORT.replace("step = 0.25", "step = 0.5"))
    with pytest.raises(UsageError, match="made with another experiment"):
        run(other, tmp_path / "mine.parquet", resume=True)


def test_two_sweeps_do_not_write_one_journal(tmp_path):
    first = Journal(tmp_path / "a.jsonl", {}, 1, resume=False)
    with pytest.raises(UsageError, match="another sweep is writing it"):
        Journal(tmp_path / "a.jsonl", {}, 1, resume=True)
    first.close()


def test_the_worst_case_runs_alone_to_the_bits_of_its_row(dockloop, cluster, reference, tmp_path):
    path, _ = reference
    reported = dockloop("sweep", path, "--scheduler", cluster.scheduler_address, "--json", "--csv")
    assert reported.status == 0, reported.err
    summary = json.loads(reported.out)
    for file in summary["files"]:
        assert Path(file).stat().st_size > 0, file
    assert {Path(file).suffix for file in summary["files"]} == {".parquet", ".csv", ".png", ".json"}
    rows = parquet.read_table(summary["files"][0]).to_pylist()
    worst = rows[summary["worst"]["case"] - 1]
    assert worst["capture.peak.load_ratio"] == max(row["capture.peak.load_ratio"] for row in rows)

    program, *command = shlex.split(summary["worst"]["command"])
    assert program == "dockloop"
    alone = dockloop(*command, "--no-plots", "--json", "-o", "worst.npz")
    assert alone.status == 0, alone.err
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
    # The table alone is enough to make the sweep again.
    again = write(tmp_path, reported["dockloop.sweep"], "again")
    assert list(read_sweep(str(again)).cases) == list(read_sweep(str(path)).cases)


def test_the_linear_absorber_gives_a_linear_answer(cluster, tmp_path):
    """Twice the speed, twice the peak, for each mass: relative error below 1e-6."""
    read = read_sweep("absorber_1d_speeds")
    output = tmp_path / "speeds.parquet"
    ran = run_sweep(
        read, output, scheduler=cluster.scheduler_address, progress=ProgressBar("speeds")
    )
    rows = sweep_report.make_table(read, ran["planner"], ran["results"]).to_pylist()
    slow, fast = rows[:4], rows[4:]
    for one, two in zip(slow, fast, strict=True):
        assert one["chaser.mass"] == two["chaser.mass"]
        error = two["capture.peak.compression"] / one["capture.peak.compression"] / 2.0 - 1.0
        assert abs(error) < 1e-6, error


def test_named_cases_set_what_they_name_and_nothing_else(dockloop, tmp_path):
    write(tmp_path, vary(NAMED, more="[experiment]\nstop = 3.0\nstep = 0.5"))
    sweep = dockloop("sweep", "mine.toml", "--no-plots")
    assert sweep.status == 0, sweep.err
    rows = parquet.read_table("build/sweeps/mine/mine.parquet").to_pylist()
    assert [row["variant"] for row in rows] == ["as it is", "heavy"]
    table = [line.split() for line in sweep.out.splitlines() if line.startswith("    ")]
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


def test_a_sweep_varies_what_a_sequence_has_set(tmp_path):
    text = """scene = "apda"
[[vary]]
type = "grid"
name = "sequence.set.retract.timeout"
values = [50.0, 60.0]
"""
    planner = Planner(read_sweep(str(write(tmp_path, text))))
    document, _ = planner.resolve((50.0,))
    steps = {step["name"]: step for step in document["mechanism"]["sequence"]["steps"]}
    assert steps["retract"]["timeout"] == 50.0
    assert "--scene" in planner.make_command((50.0,), 1.0)


def test_another_meaning_of_a_named_case_is_another_sweep(dockloop, tmp_path):
    text = vary(NAMED, more="[experiment]\nstop = 1.0\nstep = 0.5")
    write(tmp_path, text)
    assert dockloop("sweep", "mine.toml", "--no-plots").status == 0
    write(tmp_path, text.replace("30e3", "31e3"))
    again = dockloop("sweep", "mine.toml", "--no-plots", "--resume")
    assert again.status != 0
    assert "another" in again.err or "differ" in again.err, again.err


@pytest.mark.parametrize("name", SHIPPED)
def test_the_names_of_a_shipped_sweep_are_known(name):
    planner = Planner(read_sweep(name))
    assert all(quantity.unit or quantity.named for quantity in planner.quantities)
    assert "capture.peak.compression" in planner.outcomes


# ---------------------------------------------------------------- failures

FAILING = """
scene = "idss_25t_350t"
[set]
"initial.approach_time" = 0.1
"solver.method" = 7
[[vary]]
type = "grid"
name = "initial.pitch_yaw_deg"
values = [1.0, 31.0]
[[vary]]
type = "grid"
name = "restitution"
values = [0.5, -1.0]
[[vary]]
type = "grid"
name = "solver.step"
values = [1e-3, 1e-9]
[experiment]
stop = 0.5
step = 0.25
"""


def test_failures_are_rows_with_a_reason(dockloop, cluster, tmp_path):
    path = write(tmp_path, FAILING)
    reported = dockloop("sweep", path, "--scheduler", cluster.scheduler_address)
    assert reported.status == 0, reported.err
    assert "1 done, 6 refused, 1 failed" in reported.out, reported.out
    rows = parquet.read_table("build/sweeps/mine/mine.parquet").to_pylist()
    assert [row["status"] for row in rows] == ["done", "failed", *["refused"] * 6]
    assert rows[0]["reason"] is None
    assert "inner steps" in rows[1]["reason"], rows[1]
    assert rows[1]["end_time"] == 0.0
    assert "'restitution' = -1" in rows[2]["reason"], rows[2]
    assert "initial.pitch_yaw_deg is 31.0: must be less than 30" in rows[4]["reason"], rows[4]
    for row in rows[1:]:
        assert row["capture.peak.compression"] is None
        assert row["outcome"] is None

    path.write_text(FAILING.replace("[1.0, 31.0]", "[31.0]"))
    reported = dockloop(
        "sweep", path, "--scheduler", cluster.scheduler_address, "-o", "bad.parquet"
    )
    assert reported.status == 1, reported
    assert "no case was done, for example" in reported.err, reported.err


def test_a_case_that_is_lost_with_its_workers_is_tried_again_by_resume(tmp_path, monkeypatch):
    path, output = write(tmp_path, vary(UNIFORM.replace("10.0, 20.0", "1e4, 2e4"))), tmp_path / "t"
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        make_cluster(1) as one,
    ):
        address = one.scheduler_address
        with monkeypatch.context() as broken:
            broken.setattr(executors, "run_case", lambda *_: __import__("os")._exit(1))
            ran = run_sweep(read_sweep(str(path)), output, scheduler=address)
        (lost,) = ran["results"]
        assert lost.status == "lost"
        assert "died" in lost.reason
        ran = run_sweep(read_sweep(str(path)), output, scheduler=address, resume=True)
        assert ran["results"][0].status == "done", ran["results"][0]


# ---------------------------------------------------------------- two passes

PASSES = ("--accuracy", "1e-2", "--refine", "compression > 900 or not contact",
          "--refine-accuracy", "1e-4")  # fmt: skip


def test_critical_cases_run_again_at_another_accuracy(dockloop, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_report, "_PART", 5)
    path, table = write(tmp_path, SHORT), tmp_path / "own.parquet"
    command = ("sweep", str(path), *PASSES, "-o", str(table), "--no-plots", "--json", "--report")
    done = dockloop(*command)
    assert done.status == 0, done
    found = json.loads(done.out)["refined"]
    rows = parquet.read_table(table).to_pylist()
    cheap, fine = (dl.sweep(path, accuracy=each).to_dict("records") for each in (1e-2, "1e-4"))
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
    shown = find_command(table, metadata, worst["case"], tmp_path)
    assert shown[3:] == shlex.split(worst["command"])[3:]


def test_passes_that_make_no_sense_are_refused(dockloop, tmp_path):
    path = str(write(tmp_path, SHORT))
    own = str(write(tmp_path, SHORT.replace("[set]", "[set]\naccuracy = 1e-3"), "own"))
    for arguments, words in (
        ((path, *PASSES[2:]), "give both, and --accuracy of that pass"),
        ((path, *PASSES[:4]), "give both, and --accuracy of that pass"),
        ((path, "--accuracy", "2"), "--accuracy 2: must be greater than 0 and at most 1"),
        ((path, *PASSES[:5], "0.5"), "--refine-accuracy 0.5: must be greater than 0 and less"),
        ((path, *PASSES[:3], "shear", *PASSES[4:]), "--refine 'shear': is a number"),
        ((path, *PASSES, "--rare", "miss"), "--rare and --refine: give one of them"),
        ((own, *PASSES), "own.toml: decides 'accuracy' already"),
    ):
        refused = dockloop("sweep", *arguments)
        assert (refused.status, refused.err.count("\n")) == (2, 1), refused
        assert words in refused.err, refused


# ---------------------------------------------------------------- many cases

MANY = """
scene = "absorber_1d"
cases = {cases}
[[vary]]
type = "grid"
name = "target.mass"
values = [3e5, 3.5e5, 4e5, 4.5e5]
[[vary]]
type = "uniform"
name = "initial.closing_speed"
range = [0.05, 0.1]
[[vary]]
type = "uniform"
name = "chaser.mass"
range = [10e3, 30e3]
[experiment]
stop = 0.01
step = 0.01
"""


def test_a_million_cases_are_planned_in_the_memory_of_their_samples(tmp_path):
    few = read_sweep(str(write(tmp_path, MANY.format(cases=1024), "few"))).cases
    path = str(write(tmp_path, MANY.format(cases=250_000)))
    Planner(read_sweep(path))  # what is loaded once
    tracemalloc.start()
    planned = read_sweep(path, Passes(1e-3))
    planner = Planner(planned)
    kept, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 8e6, kept  # 4 MB of samples
    assert most < 40e6, most
    cases = planned.cases
    assert len(cases) == 1_000_000
    for row in (0, 1023, 250_000, 999_999, *np.random.default_rng(1).integers(10**6, size=50)):
        settings = planner.list_settings(cases[row])
        assert settings["accuracy"] == 1e-3
        assert settings["target.mass"] == (3e5, 3.5e5, 4e5, 4.5e5)[row // 250_000]
        if row % 250_000 < 1024:
            point = row // 250_000 * 1024 + row % 250_000
            assert cases[row] == (*few[point], 1e-3)
    assert cases[-1] == cases[999_999]
    with pytest.raises(IndexError):
        cases[1_000_000]


def test_a_table_in_parts_has_the_same_bytes_for_any_order_of_the_journal(
    dockloop, tmp_path, monkeypatch
):
    monkeypatch.setattr(sweep_report, "_PART", 512)
    path = write(tmp_path, MANY.format(cases=512))
    command = ["sweep", str(path), "--csv", "--no-plots", "--json", "-o", "own.parquet"]
    first = dockloop(*command, "--workers", "1")
    assert first.status == 0, first.err
    summary = json.loads(first.out)
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
    second = dockloop(*command, "--workers", "2", "--resume")
    assert second.status == 0, second.err
    assert json.loads(second.out)["time"]["ran"] == 500
    assert table.read_bytes() == whole


def test_a_table_is_read_in_parts(dockloop, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_report, "_PART", 500)
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
    table = sweep_report.open_table(Path("own.parquet"))
    assert len(table) == 2048
    for row in (0, 499, 500, 2047):
        assert table.read_row(row, ["case"]) == {"case": row + 1}
    with pytest.raises(IndexError):
        table.read_row(2048, ["case"])


def test_a_case_of_a_large_table_is_chosen_in_little_memory(tmp_path):
    rows = 1 << 18
    numbers = np.arange(rows)
    outcomes = np.where(numbers % 80_000 == 777, "miss", "captured")
    statuses = np.where(numbers == 5, "failed", "done")
    loads = np.random.default_rng(1).random(rows)
    loads[5], loads[246_543] = 9.0, 2.0
    columns = {"case": numbers + 1, "status": statuses, "reason": np.full(rows, "a" * 30)}
    columns |= {"outcome": outcomes, "capture.peak.load_ratio": loads}
    columns |= {f"filler{i}": loads + i for i in range(10)}
    text = 'scene = "absorber_1d"\n'
    table = pa.table(columns).replace_schema_metadata({"dockloop.sweep": text})
    file = tmp_path / "own.parquet"
    parquet.write_table(table, file, row_group_size=1 << 14)
    del columns, table

    def choose(**options):
        chosen = {"cases": [], "not_captured": None} | options
        opened, metadata = sweep_report.open_table(file), read_table_metadata(file)
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


# ---------------------------------------------------------------- repeats

# Offset 0 has no direction, and one condition sets what the scene has: 2 x 4 x 3 cases, of which
# (1 + 4) x 2 differ.
POLAR = """
scene = "idss_25t_350t"
[set]
"initial.approach_time" = 0.1
[[vary]]
type = "grid"
name = "initial.lateral_offset"
values = [0.0, 0.05]
[[vary]]
type = "grid"
name = "initial.lateral_direction_deg"
values = [0.0, 90.0, 180.0, 270.0]
[[vary]]
type = "cases"
name = "condition"
[vary.cases."nominal"]
[vary.cases."also nominal"]
"chaser.mass" = 25e3
[vary.cases."heavy"]
"chaser.mass" = 30e3
[experiment]
stop = 0.5
step = 0.25
"""


def test_cases_that_repeat_others_run_once_and_change_no_byte(dockloop, tmp_path, monkeypatch):
    write(tmp_path, POLAR)
    command = ["sweep", "mine.toml", "--no-plots", "--json", "--workers", "2", "-o"]
    with monkeypatch.context() as patched:  # all of them run
        patched.setattr(Planner, "find_key", lambda *_: None)
        every = dockloop(*command, "every.parquet")
    assert every.status == 0, every.err
    assert json.loads(every.out)["time"]["repeats"] == 0
    table = (tmp_path / "every.parquet").read_bytes()
    lines = sorted((tmp_path / "every.jsonl").read_text().splitlines()[1:])
    assert len(lines) == 24

    begun, submit = [], executors.CoreThreads.submit

    def count(self, values):
        begun.append(values)
        return submit(self, values)

    monkeypatch.setattr(executors.CoreThreads, "submit", count)
    once = dockloop(*command, "once.parquet")
    assert once.status == 0, once.err
    assert len(begun) == 10
    clock = json.loads(once.out)["time"]
    assert (clock["ran"], clock["repeats"]) == (24, 14)
    assert (tmp_path / "once.parquet").read_bytes() == table
    journal = tmp_path / "once.jsonl"
    header, *found = journal.read_text().splitlines(keepends=True)
    assert sorted(line.rstrip() for line in found) == lines

    journal.write_text("".join([header, *found[:9]]))
    again = dockloop(*[word for word in command if word != "--json"], "once.parquet", "--resume")
    assert again.status == 0, again.err
    assert "have the scene and start values of another case" in again.out
    assert (tmp_path / "once.parquet").read_bytes() == table

    fmu = dockloop(*command, "fmu.parquet", "--engine", "fmu")
    assert fmu.status == 0, fmu.err
    assert json.loads(fmu.out)["time"]["repeats"] == 14
    rows = [parquet.read_table(f"{name}.parquet").to_pylist() for name in ("fmu", "every")]
    for one, other in zip(*rows, strict=True):
        assert one["status"] == other["status"] == "done"
        peak = "capture.peak.compression"  # FMUs may come from another compiler
        assert one[peak] == pytest.approx(other[peak], rel=1e-5)


def test_a_case_that_is_refused_repeats_no_other(tmp_path):
    text = POLAR.replace('"chaser.mass" = 25e3', '"chaser.mass" = -1.0')
    sweep = read_sweep(str(write(tmp_path, text.replace("30e3", "-1.0"))))
    ran = run_sweep(sweep, tmp_path / "t.parquet")
    assert ran["repeats"] == 3  # of the nominal condition
    statuses = [result.status for result in ran["results"]]
    assert statuses == ["done", "refused", "refused"] * 8


# ---------------------------------------------------------------- the journal

SPEEDS = ["sweep", "absorber_1d_speeds", "--no-plots", "-o", "mine.parquet"]


def change_figure(line: str) -> str:
    """One digit of an outcome."""
    place = line.index('"outputs"') + 20
    digit = next(i for i in range(place, len(line)) if line[i] in "123456789")
    return line[:digit] + str(10 - int(line[digit])) + line[digit + 1 :]


DAMAGE = {
    "figure": change_figure,
    "value": lambda line: line.replace('"values": [0.', '"values": [1.'),
    "status": lambda line: line.replace('"done"', '"nonsense"'),
    "checksum": lambda line: line[:-4] + '0"}' if line[-4] != "0" else line[:-4] + '1"}',
    "half": lambda line: line[: len(line) // 2],
    "empty": lambda line: "",
    "other": lambda line: '{"a": 1}',
    "binary": lambda line: "\x00\x01\x02",
    "list": lambda line: "[1, 2]",
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_changed_line_is_reported_once_and_only_its_case_is_run_again(dockloop, tmp_path, damage):
    assert dockloop(*SPEEDS).status == 0
    whole, journal = (tmp_path / "mine.parquet").read_bytes(), tmp_path / "mine.jsonl"
    lines = journal.read_text().splitlines()
    changed = DAMAGE[damage](lines[3])
    assert changed != lines[3]
    journal.write_text("\n".join([*lines[:3], changed, *lines[4:], ""]))
    refused = dockloop(*SPEEDS)
    assert refused.status == 2, refused
    assert "holds 7 of 8 cases" in refused.err
    reported = dockloop(*SPEEDS, "--resume", "--json")
    assert reported.status == 0, reported
    assert reported.err == (
        "dockloop: warning: mine.jsonl: line 4 is damaged or was changed: its case is run again\n"
    )
    assert json.loads(reported.out)["time"]["ran"] == 1
    assert (tmp_path / "mine.parquet").read_bytes() == whole
    again = dockloop(*SPEEDS, "--resume", "--json")
    assert (again.status, again.err) == (0, ""), again
    assert json.loads(again.out)["time"]["ran"] == 0
    assert sorted(journal.read_text().splitlines()[1:]) == sorted(lines[1:])


def test_many_changed_lines_are_reported_in_one(dockloop, tmp_path):
    assert dockloop(*SPEEDS).status == 0
    journal = tmp_path / "mine.jsonl"
    header, *lines = journal.read_text().splitlines()
    journal.write_text("\n".join([header, *("?" for _ in lines[:-1]), lines[-1], ""]))
    reported = dockloop(*SPEEDS, "--resume", "--json")
    assert "lines 2, 3, 4, 5, 6, 7, 8 are damaged" in reported.err
    assert reported.err.count("\n") == 1
    assert json.loads(reported.out)["time"]["ran"] == 7


def test_a_status_that_unknown_is_no_result(tmp_path):
    """Not even with the right checksum."""
    journal = Journal(tmp_path / "a.jsonl", {}, 2, resume=False)
    journal.add((1.0,), Result("done", outputs=(1.0,)))
    journal.add((2.0,), Result("nonsense"))
    journal.close()
    assert set(Journal(tmp_path / "a.jsonl", {}, 2, resume=True).known) == {(1.0,)}


def test_a_journal_without_its_first_line_is_refused(dockloop, tmp_path):
    assert dockloop(*SPEEDS).status == 0
    journal = tmp_path / "mine.jsonl"
    text = journal.read_text()
    journal.write_text(text.replace('"quantities"', '"quantitles"', 1))
    for more in ([], ["--resume"]):
        refused = dockloop(*SPEEDS, *more)
        assert refused.status == 2, refused
        assert "mine.jsonl: line 1 is damaged or was changed" in refused.err
        assert refused.err.count("\n") == 1
    assert journal.read_text() == text.replace('"quantities"', '"quantitles"', 1)


def test_the_finished_table_of_another_sweep_stays(dockloop, tmp_path):
    """Other cases, another seed, another scene, other outcomes; the same sweep is made again."""
    shipped = (paths.SWEEPS / "absorber_1d_speeds.toml").read_text()
    path, table, journal = write(tmp_path, shipped), tmp_path / "t.parquet", tmp_path / "t.jsonl"
    command = ["sweep", str(path), "--no-plots", "-o", "t.parquet"]
    assert dockloop(*command).status == 0
    before, lines = table.read_bytes(), journal.read_bytes()
    for old, new in (
        ("0.05, 0.10", "0.05, 0.11"),
        ("seed = 1", "seed = 2"),
        ("step = 0.5", "step = 0.25"),
        ('worst = "capture.peak.compression"', 'outcomes = ["outcome"]'),
        ("[experiment]", "[set]\n'solver.rtol' = 1e-9\n[experiment]"),
    ):
        assert old in shipped
        write(tmp_path, shipped.replace(old, new))
        for without in (None, journal, table):  # either is enough to know it
            held = without.read_bytes() if without else b""
            if without:
                without.unlink()
            refused = dockloop(*command)
            assert refused.status == 2, (refused, new)
            assert "of another sweep" in refused.err
            assert "choose another -o or delete" in refused.err
            assert refused.err.count("\n") == 1
            if without:
                assert not without.exists()
                without.write_bytes(held)
        assert (table.read_bytes(), journal.read_bytes()) == (before, lines)
    path.write_text(f"# a comment\n{shipped}")
    assert dockloop(*command).status == 0
    assert dockloop(*command, "--resume").status == 0


def test_resume_makes_the_table_of_more_cases_and_of_those_that_it_had(dockloop, tmp_path):
    shipped = (paths.SWEEPS / "absorber_1d_speeds.toml").read_text()
    path, table = write(tmp_path, shipped), tmp_path / "t.parquet"
    command = ["sweep", str(path), "--no-plots", "-o", "t.parquet"]
    assert dockloop(*command).status == 0
    write(tmp_path, shipped.replace("0.05, 0.10", "0.05, 0.10, 0.11"))
    assert dockloop(*command).status == 2
    reported = dockloop(*command, "--resume", "--json")
    assert json.loads(reported.out)["time"]["ran"] == 4, reported.err
    assert dockloop(*command).status == 0  # it is the same sweep now
    assert parquet.read_table(table).num_rows == 12
    foreign = tmp_path / "else.parquet"
    assert dockloop("sweep", "absorber_1d_speeds", "--no-plots", "-o", str(foreign)).status == 0
    foreign.replace(table)
    (tmp_path / "t.jsonl").unlink()
    refused = dockloop(*command, "--resume")  # the table of fewer cases, but nothing to go on with
    assert refused.status == 2, refused
    assert "of another sweep" in refused.err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_a_full_disk_loses_no_case(dockloop, tmp_path):
    """First there is no space for the first line of the journal, then none for its fifth."""
    with full_disk(1, 6):
        for kept in (0, 3):
            reported = dockloop(*SPEEDS)
            assert reported.status == 1, reported
            assert reported.err == (
                "dockloop: mine.jsonl: cannot be written (no space is left on the disk); the same"
                " command with --resume goes on\n"
            )
            assert (tmp_path / "mine.jsonl").exists() == bool(kept)
            assert not (tmp_path / "mine.parquet").exists()
    reported = dockloop(*SPEEDS, "--resume", "--json")
    assert json.loads(reported.out)["time"]["ran"] == 8 - kept, reported


def test_a_table_that_cannot_be_written_is_reported_before_the_first_case(
    dockloop, tmp_path, monkeypatch
):
    def fail(*_, **__):
        raise AssertionError("a case was run")

    monkeypatch.setattr("dockloop.sweeps.run_cases", fail)
    (tmp_path / "mine.parquet").mkdir()
    refused = dockloop(*SPEEDS)
    assert refused.status == 2, refused
    assert "mine.parquet: is a folder" in refused.err
    assert not (tmp_path / "mine.jsonl").exists()


def test_a_journal_that_holds_nothing_needs_no_resume(dockloop):
    """What is left when the scheduler cannot be reached."""
    failed = dockloop(*SPEEDS, "--scheduler", "nonsense://x")
    assert failed.status == 1, failed
    assert "cannot be reached" in failed.err
    assert dockloop(*SPEEDS).status == 0


def test_another_dockloop_that_writes_the_journal_is_reported(tmp_path):
    """Also while the file is put in order."""
    journal = Journal(tmp_path / "a.jsonl", {}, 2, resume=False)
    journal.add((1.0,), Result("done"))
    journal.close()
    path = tmp_path / "a.jsonl"
    path.write_text(path.read_text() + "?\n")
    second = Journal(path, {}, 2, resume=True)
    with pytest.raises(UsageError, match="another sweep is writing it"):
        Journal(path, {}, 2, resume=True)
    second.add((2.0,), Result("done"))
    second.close()
    assert set(Journal(path, {}, 2, resume=True).known) == {(1.0,), (2.0,)}
