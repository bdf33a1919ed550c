"""Sweeps: how cases are sampled, planned, and run on workers.

1. Samples: every kind of distribution has its shape; the seed decides; grids meet equal samples; a
   million cases are planned in the memory of their samples.
2. Cases: both engines give the bits of an FMU that is built and run by itself, for every kind of
   quantity; an early end gives the bits of a run to that time.
3. Workers: the table has the same bytes when one of two workers is killed on the way, or both and
   another one comes; a scheduler that dies is named; the linear absorber gives its linear answer.
4. Failures are rows: refused by the scene, by the FMU, a step discarded, a worker lost.
5. Repeats: cases that come to the same scene run once; the table has the bytes of a sweep that runs
   all of them, by both engines and after --resume.

Tables and refused files: test_sweep_tables.py; journals: test_sweep_journal.py.
"""

import json
import math
import signal
import threading
import tracemalloc
from contextlib import closing

import dask
import numpy as np
import pytest
from distributed import LocalCluster
from pyarrow import parquet

from dockloop.base.errors import DockloopError
from dockloop.base.progress import ProgressBar
from dockloop.result.peaks import list_with_places
from dockloop.scene.resolve import is_scene_key
from dockloop.scene.values import as_setting
from dockloop.sweeps import campaign, executors
from dockloop.sweeps.cases import run_case
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.run import run_sweep
from dockloop.sweeps.sampling import Passes, read_sweep
from dockloop.sweeps.table import write_table
from mishaps import Cluster, lines_of, wait_for_lines
from small_sweeps import DISC, MANY, NORMAL, UNIFORM, run_table, vary, write

pytestmark = pytest.mark.usefixtures("native")  # the bits of FMUs are compared with the core's

# ---------------------------------------------------------------- samples


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


# ---------------------------------------------------------------- cases

QUANTITIES = {
    "initial.closing_speed": 0.07,
    "chaser.mass": 12e3,
    "chaser.mass_includes_mechanism": 2,
    "chaser.contact_thrust": 1500.0,
    "contact.friction_coefficient": 0.25,
    "chaser.interface_position[2]": 0.01,  # no scene key: a start value
    "mechanism.set.leg_defaults.stiffness": 2500.0,
    "solver.rtol": 1e-5,
}

CAPTURED = "idss_25t_350t"

ENDS = ("time_of_contact", "capture.peak.compression", "capture.peak.bending", "relative.axial")


@pytest.mark.parametrize("engine", ["core", "fmu"])
@pytest.mark.parametrize("name", QUANTITIES)
def test_a_case_has_the_bits_of_an_fmu_of_its_own(tmp_path, runs, engine, name):
    """Every kind of quantity, against an FMU built and run as a user does."""
    value = QUANTITIES[name]
    text = f'scene = "{CAPTURED}"\noutcomes = {json.dumps(ENDS)}\n'
    text += f'[[vary]]\ntype = "grid"\nname = "{name}"\nvalues = [{value}]\n'
    text += "[experiment]\nstop = 2.5\nstep = 0.5\n"
    planner = Planner(read_sweep(str(write(tmp_path, text))))
    result = run_case(planner.make_job(engine), *planner.resolve((value,)))
    reported = (as_setting(name, value),)
    is_key = is_scene_key(name)
    alone = runs.run(
        CAPTURED,
        *(reported if is_key else ()),
        settings=() if is_key else reported,
        stop=2.5,
        step=0.5,
    )
    names = [each for end in ENDS for each in list_with_places(end)]
    ends = result.outputs[: len(names)]  # what explains a capture comes after them
    assert ends == tuple(alone[each][-1] for each in names)


@pytest.mark.parametrize("engine", ["core", "fmu"])
def test_an_early_end_gives_the_bits_of_a_run_to_that_time(tmp_path, runs, engine):
    text = f'scene = "{CAPTURED}"\noutcomes = {json.dumps(ENDS)}\n'
    text += '[[vary]]\ntype = "grid"\nname = "chaser.mass"\nvalues = [25e3]\n'
    text += "[experiment]\nstop = 20.0\nstep = 0.25\nend_after_outcome = 1.5\n"
    planner = Planner(read_sweep(str(write(tmp_path, text))))
    result = run_case(planner.make_job(engine), *planner.resolve((25e3,)))
    captured_at = 3.25  # the first communication point after 3.08 s
    assert result.end_time == captured_at + 1.5
    alone = runs.run(CAPTURED, stop=result.end_time, step=0.25)
    names = [each for end in ENDS for each in list_with_places(end)]
    assert result.outputs[: len(names)] == tuple(alone[each][-1] for each in names)


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


@pytest.mark.parametrize(
    ("more", "begin", "sentence"),
    [
        (
            '[set]\n"chaser.inertia" = [1, 1, 9, 0, 0, 0]',
            "mine.toml: set 'chaser.inertia'",
            "chaser.inertia has the principal moments 1, 1 and 9 kg m2",
        ),
        (
            '[set]\n"accuracy" = 7\n"target.mass" = 3e5',
            "mine.toml: set 'accuracy'",
            "'accuracy' = 7 is above its maximum 1",
        ),
        (
            '[set]\n"initial.joints.foo.rate" = 1',
            "mine.toml: set 'initial.joints.foo.rate'",
            "initial.joints.foo: the mechanism has no body of that name",
        ),
    ],
)
def test_what_all_cases_share_is_tried_before_the_first(dockloop, tmp_path, more, begin, sentence):
    write(tmp_path, vary(UNIFORM, 3, more))
    for words in ((), ("--rare", "captured", "--rare-cases", "50")):
        refused = dockloop("sweep", "mine.toml", "-o", "own.parquet", *words)
        assert refused.status == 2, refused
        assert refused.err.startswith(f"dockloop: {begin}: {sentence}"), refused
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_what_cases_mend_is_no_reason_to_refuse_a_sweep(dockloop, tmp_path):
    mended = 'type = "grid"\nname = "chaser.inertia.3"\nvalues = [1.5, 9.0]'
    write(tmp_path, vary(mended, 1, '[set]\n"chaser.inertia" = [1, 1, 9, 0, 0, 0]'))
    swept = dockloop("sweep", "mine.toml", "-o", "own.parquet", "--no-plots", "--json")
    assert json.loads(swept.out)["status"] == {"done": 1, "refused": 1}, swept


# ---------------------------------------------------------------- workers


def make_cluster(workers: int) -> LocalCluster:
    return LocalCluster(
        n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
    )


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
    run_table(path, output, scheduler=cluster.scheduler_address)
    killer.join()
    assert killed[0] < 12, "the sweep was over before the worker was killed"
    assert cluster.workers[0].wait(timeout=60) == -signal.SIGKILL
    assert output.read_bytes() == whole.read_bytes()
    cluster.workers[0] = cluster.start_worker()


def test_a_sweep_without_workers_waits_and_without_scheduler_ends(reference, tmp_path, monkeypatch):
    path, whole = reference
    output, journal = tmp_path / "mine.parquet", tmp_path / "mine.jsonl"
    two, said = Cluster(tmp_path), []

    def begin(work) -> threading.Thread:
        def kill() -> None:
            wait_for_lines(journal, 2)
            work()

        thread = threading.Thread(target=kill)
        thread.start()
        return thread

    def kill_workers() -> None:
        for worker in two.workers:
            worker.kill()

    def note(text: str) -> None:
        said.append(text)
        two.workers.append(two.start_worker())

    monkeypatch.setattr(campaign, "_PATIENCE", 0.5)
    monkeypatch.setattr(campaign, "warn", note)
    with closing(two):
        killer = begin(kill_workers)
        run_table(path, output, scheduler=two.scheduler_address)
        killer.join()
        assert [text.split(":")[0] for text in said] == ["no Dask worker is left"]
        assert output.read_bytes() == whole.read_bytes()

        output.unlink()
        journal.unlink()
        killer = begin(two.kill_scheduler)
        with pytest.raises(DockloopError, match=r"the Dask scheduler is gone .* --resume goes on"):
            run_table(path, output, scheduler=two.scheduler_address)
        killer.join()
        assert 2 <= lines_of(journal) < 12


def test_the_linear_absorber_gives_a_linear_answer(cluster, tmp_path):
    """Twice the speed, twice the peak, for each mass: relative error below 1e-6."""
    read = read_sweep("absorber_1d_speeds")
    output = tmp_path / "speeds.parquet"
    ran = run_sweep(
        read, output, scheduler=cluster.scheduler_address, progress=ProgressBar("speeds")
    )
    write_table(read, ran["planner"], ran["results"], None, output)
    rows = parquet.read_table(output).to_pylist()
    slow, fast = rows[:4], rows[4:]
    for one, two in zip(slow, fast, strict=True):
        assert one["chaser.mass"] == two["chaser.mass"]
        error = two["capture.peak.compression"] / one["capture.peak.compression"] / 2.0 - 1.0
        assert abs(error) < 1e-6, error


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
    reported = dockloop.succeed("sweep", path, "--scheduler", cluster.scheduler_address)
    assert "1 done, 6 refused, 1 failed" in " ".join(reported.out.split()), reported.out
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
    once = dockloop.succeed(*command, "once.parquet")
    assert len(begun) == 10
    summary = json.loads(once.out)
    assert (summary["lanes"], summary["occupancy"]) == (1, 1.0)
    assert summary["cases_per_second_and_core"] > 0.0
    clock = summary["time"]
    assert (clock["ran"], clock["repeats"]) == (24, 14)
    assert (tmp_path / "once.parquet").read_bytes() == table
    journal = tmp_path / "once.jsonl"
    header, *found = journal.read_text().splitlines(keepends=True)
    assert sorted(line.rstrip() for line in found) == lines

    journal.write_text("".join([header, *found[:9]]))
    again = dockloop.succeed(
        *[word for word in command if word != "--json"], "once.parquet", "--resume"
    )
    assert "have the scene and start values of another case" in " ".join(again.out.split())
    assert (tmp_path / "once.parquet").read_bytes() == table

    fmu = dockloop.succeed(*command, "fmu.parquet", "--engine", "fmu")
    assert json.loads(fmu.out)["time"]["repeats"] == 14
    assert json.loads(fmu.out)["fmus_built"] == 10
    rows = [parquet.read_table(f"{name}.parquet").to_pylist() for name in ("fmu", "every")]
    for one, other in zip(*rows, strict=True):
        assert one["status"] == other["status"] == "done"
        assert one["capture.peak.compression"] == other["capture.peak.compression"]


def test_a_case_that_is_refused_repeats_no_other(tmp_path):
    text = POLAR.replace('"chaser.mass" = 25e3', '"chaser.mass" = -1.0')
    sweep = read_sweep(str(write(tmp_path, text.replace("30e3", "-1.0"))))
    ran = run_sweep(sweep, tmp_path / "t.parquet")
    assert ran["repeats"] == 3  # of the nominal condition
    statuses = [result.status for result in ran["results"]]
    assert statuses == ["done", "refused", "refused"] * 8
