"""Many runs in one process: threads of the core, ``dockloop sweep --engine core``.

1. Results are those of the FMU to the last bit, for any number of threads: cases that differ in
   conditions, start values and geometry, that are refused by the scene, by the FMU, or fail.
2. An early end is that of the FMU.
3. A bad case has its reason and stops no other.
4. A sweep that ends early loses nothing: --resume goes on, with either engine; a defect is raised.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from dockloop.base.errors import UsageError
from dockloop.base.progress import ProgressBar
from dockloop.runs.outcome import Result
from dockloop.sweeps.cases import run_case
from dockloop.sweeps.executors import CoreThreads
from dockloop.sweeps.journal import InterruptedWorkError
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.run import run_sweep
from dockloop.sweeps.sampling import Sweep, read_sweep
from small_sweeps import OFFSETS, write

pytestmark = pytest.mark.usefixtures("native")  # the bits of FMUs are compared with the core's

# Geometry, conditions and start values; a tilt and a friction that are refused, and an inner step
# of which a communication step needs too many.
MIXED = f"""
scene = "idss_25t_350t"
seed = 3
outcomes = ["outcome", "captured", "capture.peak.compression", "relative.roll", "energy.residual"]
[set]
"initial.approach_time" = 0.1
"solver.method" = 7
[[vary]]
{OFFSETS}
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


def run_fmus(sweep: Sweep) -> list[Result]:
    """Run each case through an FMU, in this process."""
    planner, results = Planner(sweep), []
    job = planner.make_job("fmu")
    for values in sweep.cases:
        try:
            results.append(run_case(job, *planner.resolve(values)))
        except UsageError as error:
            results.append(Result("refused", str(error)))
    return results


def run_core(sweep: Sweep, folder: Path, threads: int, **options) -> list[Result]:
    output = folder / f"{threads}.parquet"
    return list(run_sweep(sweep, output, engine="core", workers=threads, **options)["results"])


@pytest.fixture(scope="module")
def mixed(native, tmp_path_factory) -> tuple[Sweep, list[Result]]:
    """The sweep MIXED, and its results by FMUs."""
    sweep = read_sweep(str(write(tmp_path_factory.mktemp("mixed"), MIXED)))
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
    sweep = read_sweep(str(write(tmp_path, CAPTURED)))
    expected, found = run_fmus(sweep), run_core(sweep, tmp_path, 1)
    assert found == expected
    assert 0.0 < found[0].end_time < 20.0


def test_a_sweep_that_ends_early_loses_nothing(mixed, tmp_path, monkeypatch):
    sweep, expected = mixed
    collected = []

    def collect(self, future) -> Result:
        if len(collected) == 2:
            raise KeyboardInterrupt
        collected.append(future.result())
        return collected[-1]

    with monkeypatch.context() as patched:
        patched.setattr(CoreThreads, "collect", collect)
        with pytest.raises(InterruptedWorkError, match=r"interrupted with \d+ of 24 .*--resume"):
            run_core(sweep, tmp_path, 2)
    journal = (tmp_path / "2.jsonl").read_text().splitlines()
    done = len(journal) - 1
    assert 2 <= done < len(sweep.cases), journal
    again = run_sweep(sweep, tmp_path / "2.parquet", engine="core", resume=True)
    assert again["ran"] == len(sweep.cases) - done
    assert list(again["results"]) == expected
    other = run_sweep(sweep, tmp_path / "2.parquet", engine="fmu", resume=True)
    assert (other["ran"], list(other["results"])) == (0, expected)


def test_a_defect_of_the_planner_is_reported(mixed, tmp_path, monkeypatch):
    def fail(*_) -> dict:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(Planner, "resolve", fail)
    with pytest.raises(ZeroDivisionError, match="a defect"):
        run_core(mixed[0], tmp_path, 1)


def test_the_core_needs_no_dask_and_no_scheduler(dockloop):
    modules = "import sys; import dockloop.sweeps.run; print('distributed' in sys.modules)"
    assert subprocess.check_output([sys.executable, "-c", modules], text=True) == "False\n"
    done = dockloop.succeed("sweep", "absorber_1d_speeds", "--no-plots", "--json")
    assert json.loads(done.out)["time"]["engine"] == "core"
