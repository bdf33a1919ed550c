"""The same FMU in importers that are not FMPy, and under a static check of another author.

1. libcosim, ecos and a container FMU (fmu-manipulation-toolbox) give every output of the default
   docking as FMPy does, to the last bit.
2. With a step that binary numbers cannot hold, importers disagree on its last digit, and results
   follow: positions and loads stay the same far below the tolerance of the integration.
3. The static check of fmu-manipulation-toolbox finds no fault, and does find one that we make.
"""

import functools
import sys
import zipfile
from pathlib import Path

import pytest
from fmpy import read_model_description

from importers import find_obstacle, run_importer
from programs import run

pytestmark = pytest.mark.long  # three importers, one of them compiles

SCENE = ("idss_25t_350t", "initial.approach_time=0.02")
IMPORTERS = ("libcosim", "ecos", "container")
EXACT_STEP = 1 / 512  # s; also a whole number of nanoseconds, in which libcosim counts
STEPS = 640  # beyond capture
VARIANTS = [SCENE, (*SCENE, "chaser.motion=driven")]


@pytest.fixture(scope="module")
def fmpy():
    """A function that runs an FMU in FMPy; each combination once."""
    return functools.cache(
        lambda fmu, step, count, names: run_importer("fmpy", fmu, step, count, names)
    )


@pytest.mark.parametrize("importer", IMPORTERS)
def test_every_output_is_that_of_fmpy_to_the_last_bit(runs, fmpy, importer):
    fmu = runs.complete_fmu(*SCENE)
    variables = read_model_description(fmu).modelVariables
    outputs = tuple(v.name for v in variables if v.causality == "output")
    expected = fmpy(fmu, EXACT_STEP, STEPS, outputs)
    assert len(outputs) > 150
    assert expected["captured"] is True
    found = run_importer(importer, fmu, EXACT_STEP, STEPS, outputs)
    assert {n: (found[n], v) for n, v in expected.items() if found[n] != v} == {}


@pytest.mark.parametrize("importer", ["libcosim", "ecos"])
def test_rounding_of_the_step_changes_results_far_below_the_tolerance(runs, fmpy, importer):
    # Largest differences found: 6e-11 m, 3e-8 s, 1.4e-4 of a peak (stiff contact magnifies them).
    fmu, step, steps = runs.complete_fmu(*SCENE), 0.002, 700
    bounds = {"relative.axial": 1e-7, "relative.lateral": 1e-7, "time_of_capture": 1e-5}
    peaks = ("capture.peak.compression", "capture.peak.shear", "capture.peak.bending")
    names = (*bounds, *peaks)
    expected = fmpy(fmu, step, steps, names)
    found = run_importer(importer, fmu, step, steps, names)
    assert expected["time_of_capture"] > 0.0
    bounds |= {name: 5e-3 * expected[name] for name in peaks}
    differences = {name: abs(found[name] - expected[name]) for name in names}
    assert {n: d for n, d in differences.items() if not d <= bounds[n]} == {}


def check_statically(fmu):
    """Return status and text of ``fmutool -check``."""
    if reason := find_obstacle("container"):
        pytest.skip(reason)
    done = run(Path(sys.executable).parent / "fmutool", "-input", fmu, "-check")
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize("variant", VARIANTS, ids=" ".join)
def test_the_static_check_of_another_author_finds_no_fault(runs, variant):
    status, text = check_statically(runs.complete_fmu(*variant))
    assert status == 0, text
    assert "ERROR" not in text


def test_the_static_check_finds_a_fault_that_we_make(runs, tmp_path):
    sound, broken = runs.complete_fmu(*SCENE), tmp_path / "broken.fmu"
    with zipfile.ZipFile(sound) as source, zipfile.ZipFile(broken, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'causality="input"', b'causality="inputs"', 1)
            target.writestr(name, content)
    status, text = check_statically(broken)
    assert status != 0, text
