"""Many runs in one process: ``dockloop-core batch``, and ``dockloop sweep --engine core``.

1. Results are those of the FMU to the last bit, for any number of threads: cases that differ in
   conditions, start values and geometry, that are refused by the scene, by the FMU, or fail.
2. An early end is that of the FMU.
3. Lines come in the order of the cases; a bad one has its reason and stops no other.
4. A core that ends early loses nothing: --resume goes on, with either engine; a defect is told.
"""

import itertools
import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

from dockloop import paths
from dockloop.batch import make_patch
from dockloop.cases import Result, run_case
from dockloop.errors import DockloopError, UsageError
from dockloop.fmu import to_json
from dockloop.sampling import Sweep, read_sweep
from dockloop.scene import find_scene, resolve_scene
from dockloop.simulate import ProgressBar
from dockloop.sweep import Planner, run_sweep

# Geometry, conditions and start values; a tilt and a friction that are refused, and an inner step
# of which a communication step needs too many.
MIXED = """
scene = "idss_25t_350t"
seed = 3
outcomes = ["outcome", "captured", "capture.peak.compression", "relative.roll", "energy.residual"]
[set]
"initial.approach_time" = 0.1
"solver.method" = 7
[[vary]]
type = "disc"
magnitude = "initial.lateral_offset"
direction = "initial.lateral_direction_deg"
range = [0.0, 0.1]
[[vary]]
type = "uniform"
name = "chaser.mass"
range = [20e3, 30e3]
[[vary]]
type = "grid"
name = "mechanism.set.leg_defaults.stiffness"
values = [2000.0, 2500.0]
[[vary]]
type = "grid"
name = "initial.pitch_yaw_deg"
values = [1.0, 31.0]
[[vary]]
type = "grid"
name = "friction.coefficient"
values = [0.0, 0.25, -1.0]
[[vary]]
type = "grid"
name = "solver.step"
values = [2e-3, 1e-9]
[experiment]
stop = 0.5
step = 0.25
"""
CAPTURED = """
scene = "idss_25t_350t"
[[vary]]
type = "grid"
name = "initial.closing_speed"
values = [0.1]
[experiment]
stop = 20.0
step = 0.25
end_after_outcome = 1.5
"""


def write(folder: Path, text: str) -> Sweep:
    path = folder / "mine.toml"
    path.write_text(text)
    return read_sweep(str(path))


def run_fmus(sweep: Sweep) -> list[Result]:
    """Run all cases as a worker does, in this process."""
    planner, results = Planner(sweep), []
    for values in sweep.cases:
        try:
            plan = planner.plan(values)
        except UsageError as error:
            results.append(Result("refused", planner.without_folder(str(error))))
            continue
        digest, fmu = planner.fmu(plan.fmu)
        results.append(run_case(fmu, digest, plan.job))
        said = [text for text in (plan.warning, results[-1].warning) if text]
        results[-1].warning = "; ".join(said) or None
    return results


def run_core(sweep: Sweep, folder: Path, threads: int, **options) -> list[Result]:
    output = folder / f"{threads}.parquet"
    return run_sweep(sweep, output, engine="core", workers=threads, **options)["results"]


@pytest.fixture(scope="module", autouse=True)
def native():
    """FMUs hold the library that was compiled with the core: another compiler rounds otherwise."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("dockloop.fmu.find_libraries", lambda: {"linux64": paths.LIBRARY})
        yield


@pytest.fixture(scope="module")
def mixed(native, tmp_path_factory) -> tuple[Sweep, list[Result]]:
    """The sweep MIXED, and its results by FMUs."""
    sweep = write(tmp_path_factory.mktemp("mixed"), MIXED)
    return sweep, run_fmus(sweep)


@pytest.mark.parametrize("threads", [1, 3])
def test_the_core_gives_the_bits_of_the_fmu_for_any_number_of_threads(mixed, tmp_path, threads):
    sweep, expected = mixed
    status = [result.status for result in expected]
    assert [status.count(name) for name in ("done", "refused", "failed")] == [4, 16, 4]
    assert len({result.outputs for result in expected}) == 4 + 1
    found = run_core(sweep, tmp_path, threads, progress=ProgressBar("mixed"))
    for one, other in zip(found, expected, strict=True):
        assert repr(one) == repr(other)  # 0.0 is not -0.0


def test_an_early_end_is_that_of_the_fmu(tmp_path):
    sweep = write(tmp_path, CAPTURED)
    expected, found = run_fmus(sweep), run_core(sweep, tmp_path, 1)
    assert found == expected
    assert 0.0 < found[0].end_time < 20.0


def run_lines(model: Path, lines: list[str], *options: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [paths.CORE, "batch", model, *options],
        input="".join(f"{line}\n" for line in lines),
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.json"
    path.write_text(to_json(resolve_scene(find_scene("absorber_1d"))))
    return path


BAD_LINES = {
    "nope": "case: not a JSON document",
    "[1]": "case: must be an object, not [1]",
    '{"sett": {}}': "case: member 'sett' must be 'scene' or 'set', and an object",
    '{"set": {"chaser.mas": 1}}': "there is no variable 'chaser.mas'",
    '{"set": {"chaser.mass": "1"}}': "'chaser.mass' = \"1\": must be a number, true or false",
    '{"set": {"chaser.mass": -1}}': "'chaser.mass' = -1 is below its minimum 0 kg",
    '{"set": {"solver.method": 2.5}}': "'solver.method' must be a whole number",
    '{"set": {"gap": 1}}': "'gap' is computed and cannot be set",
    '{"scene": {"chaser": {"mass": -1}}}': "model.json: chaser.mass is -1",
    '{"scene": {"mechanism": null}}': "lacks the member 'mechanism'",
}


def test_lines_come_in_the_order_of_the_cases_and_a_bad_one_stops_no_other(model):
    """Long cases before short ones: later ones are done first, and wait."""
    good = [json.dumps({"scene": {"experiment": {"stop": stop}}}) for stop in (40.0, 0.5, 1.0)]
    lines = [*good, *itertools.chain(*zip(BAD_LINES, itertools.cycle(good), strict=False))]
    ran = run_lines(model, lines, "--output", "gap", "--step", "0.01", "--threads", "3")
    assert ran.returncode == 0, ran
    results = [json.loads(line) for line in ran.stdout.splitlines()]
    assert [result.get("end_time") for result in results[:3]] == [40.0, 0.5, 1.0]
    for line, result in zip(lines, results, strict=True):
        if line in good:
            assert result == results[good.index(line)]
            assert result["status"] == "done"
        else:
            assert result["status"] == "refused", line
            assert BAD_LINES[line] in result["reason"], line


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--output", "gapp"], "there is no variable 'gapp'"),
        (["--output", "chaser.mass"], "'chaser.mass' is no output"),
        ([], "say what to write: --output NAME"),
        (["--output", "gap", "--threads", "0"], "--threads must be from 1 to"),
        (["--output", "gap", "--step", "fast"], "--step fast: must be a number"),
    ],
)
def test_a_bad_order_is_refused_before_the_first_case(model, options, words):
    ran = run_lines(model, ["{}"], *options)
    assert (ran.returncode, ran.stdout) == (2, ""), ran
    assert words in ran.stderr
    assert ran.stderr.count("\n") == 1


def test_a_core_that_ends_early_loses_nothing(mixed, tmp_path, monkeypatch):
    sweep, expected = mixed
    broken = tmp_path / "broken-core"
    broken.write_text(
        f'#!/bin/sh\n[ "$1" = batch ] || exec {paths.CORE} "$@"\n'
        f'{paths.CORE} "$@" | head -n 2\necho out of luck >&2\nexit 3\n'
    )
    broken.chmod(0o755)
    with monkeypatch.context() as patched:
        patched.setattr(paths, "CORE", broken)
        with pytest.raises(DockloopError, match=r"ended with status 3 \(out of luck\).*--resume"):
            run_core(sweep, tmp_path, 2)
    journal = (tmp_path / "2.jsonl").read_text().splitlines()
    assert len(journal) == 1 + 2, journal
    again = run_sweep(sweep, tmp_path / "2.parquet", engine="core", resume=True)
    assert again["ran"] == len(sweep.cases) - 2
    assert again["results"] == expected
    other = run_sweep(sweep, tmp_path / "2.parquet", engine="fmu", resume=True)
    assert (other["ran"], other["results"]) == (0, expected)


def test_a_defect_of_the_planner_is_told(mixed, tmp_path, monkeypatch):
    def fail(*_) -> dict:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(Planner, "plan_batch", fail)
    with pytest.raises(ZeroDivisionError, match="a defect"):
        run_core(mixed[0], tmp_path, 1)


def test_a_patch_leads_from_one_document_to_the_other():
    old = {"a": 1, "b": {"c": [1, 2], "d": 0.0}, "e": {"f": 1}, "g": "same"}
    new = {"a": {"x": 1}, "b": {"c": [1], "d": -0.0}, "g": "same", "h": None}
    patch = make_patch(old, new)
    assert repr(patch) == repr({"e": None, "a": {"x": 1}, "b": {"c": [1], "d": -0.0}, "h": None})
    assert make_patch(new, new) == {}


def test_the_core_needs_no_dask_and_no_scheduler(dockloop):
    refused = dockloop(
        "sweep", "absorber_1d_speeds", "--engine", "core", "--scheduler", "tcp://x:1"
    )
    assert refused.status == 2, refused
    assert "a --scheduler needs --engine fmu" in refused.err
    modules = (
        "import sys; import dockloop.batch, dockloop.sweep; print('distributed' in sys.modules)"
    )
    assert subprocess.check_output([sys.executable, "-c", modules], text=True) == "False\n"
    done = dockloop("sweep", "absorber_1d_speeds", "--no-plots", "--json")
    assert done.status == 0, done.err
    assert json.loads(done.out)["time"]["engine"] == "core"
