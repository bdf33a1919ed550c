"""An FMU with a kernel computes what one without computes, and never fails because of it.

1. Shipped scenes with and without their kernels: the same docking; two runs have the same bits.
2. A ring on crank legs, whose legs stand side by side, moves as its generated kernel says.
3. Where no kernel can be made (no compiler, one that fails) the FMU has none, and the command says
   why; asked for expressly, it is an error.
4. A kernel that is damaged, or of another mechanism, is a warning, and one that was made for other
   parameters is left out; the results have the bits of the FMU without one. A vehicle's mass is no
   other parameter.
5. An FMU is the same file whenever and wherever it is built.
"""

import functools
import json
import shutil
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from benchmarks.mechanisms import crank_hexapod
from dockloop.base import paths
from dockloop.fmu.build import build_fmu
from dockloop.fmu.kernel import find_compiler
from extreme_cases.fmi_host import WARNING, Host
from extreme_cases.own_mechanism import FIXED_BASE, capture_body_section, write_scene

ENTRY = "resources/kernels/linux64/kernel.so"
SCENE = "hexapod_bench"
DOCKING = "idss_25t_350t"
NEAR = "initial.approach_time=0.2"
needs_compiler = pytest.mark.skipif(not find_compiler(), reason="needs a C compiler")


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Builds a scene with a kernel and without."""
    folder = tmp_path_factory.mktemp("kernels")

    @functools.cache
    def build(scene, *overrides):
        place = Path(tempfile.mkdtemp(dir=folder))
        return [
            build_fmu(scene, overrides, place / f"{name}.fmu", kernel, bare=True)
            for name, kernel in (("with", True), ("without", False))
        ]

    return build


def run(fmu, steps, **values):
    """Bits of everything at the end, coordinates on the way, log lines."""
    with Host(fmu) as host:
        host.set(**values)
        host.start()
        names = [
            name for name in host.reference if name.startswith(("state.q", "chaser.position["))
        ]
        trajectory = []
        for _ in range(steps):
            host.step()
            trajectory.append(host.get(*names))
        return host.everything(), np.array(trajectory), host.lines


def warnings(lines):
    return [text for status, _, text in lines if status == WARNING and "kernel" in text]


@needs_compiler
@pytest.mark.parametrize(
    ("scene", "overrides", "steps"),
    [
        (SCENE, (), 100),
        (DOCKING, (NEAR,), 100),
        (DOCKING, (NEAR, "chaser.motion=driven"), 60),
        (DOCKING, (NEAR, "model.level=massless_legs"), 60),
        ("gripper", ("initial.approach_time=0.1",), 150),
        ("absorber_1d", (), 100),
    ],
)
def test_a_docking_is_the_same_with_and_without_a_kernel(pair, scene, overrides, steps):
    groups = 'outputs.groups=["states"]'
    with_kernel, without = (run(fmu, steps) for fmu in pair(scene, *overrides, groups))
    assert not warnings(with_kernel[2])
    # Rounding chooses other steps, so that results differ by a part of the tolerance (1e-6).
    # Single evaluations agree to 1e-13 (tests/unit/kernel_test.cpp).
    apart = np.abs(with_kernel[1] - without[1]).max(axis=0)
    size = np.abs(without[1]).max(axis=0).max()
    assert apart.max() <= 1e-6 * size
    if scene != "absorber_1d":  # one slide: there is nothing to round in another way
        assert with_kernel[0] != without[0], "the kernel was not used"


@needs_compiler
@pytest.mark.parametrize(
    ("second_axis", "level"),
    [([0, 0, 1], "reduced"), ([0, 1, 0], "reduced"), ([0, 0, 1], "massless_legs")],
)
def test_crank_legs_side_by_side_move_as_their_generated_kernel_says(
    pair, tmp_path, second_axis, level
):
    bench = json.loads((paths.MECHANISMS / "hexapod_bench.json").read_text())
    start = capture_body_section(
        [0.02, -0.015, -0.03], [0.03, -0.02, 0.04], [0.05, 0.02, -0.1], [0.01, 0.02, -0.015]
    )
    scene = write_scene(
        tmp_path,
        crank_hexapod(bench, "own", second_axis),
        FIXED_BASE,
        '[initial]\nat = "start"',
        start,
    )
    notes = []
    build_fmu(scene, (), tmp_path / "default.fmu", None, notes.append, bare=True)
    assert "its legs have fast code in the library" in notes[-1]
    overrides = (f"model.level={level}", 'outputs.groups=["states"]')
    generated, lanes = (run(fmu, 100) for fmu in pair(scene, *overrides))
    assert not warnings(generated[2])
    apart = np.abs(generated[1] - lanes[1]).max()
    assert 0.0 < apart < 1e-9  # tolerance 1e-11


@needs_compiler
def test_two_runs_have_the_same_bits(pair):
    fmu = pair(DOCKING, NEAR)[0]
    assert run(fmu, 50)[0] == run(fmu, 50)[0]


@needs_compiler
def test_a_saved_state_goes_on_with_the_same_bits(pair):
    with Host(pair(DOCKING, NEAR)[0]) as host:
        host.start()
        for _ in range(25):
            host.step()
        saved, time = host.save(), host.time
        for _ in range(10):
            host.step()
        end = host.everything()
        host.restore(saved)
        host.time = time
        for _ in range(10):
            host.step()
        assert host.everything() == end
        host.release(saved)


@pytest.mark.parametrize("compiler", ["no-such-compiler", "false"])
def test_without_a_compiler_there_is_no_kernel(dockloop, monkeypatch, tmp_path, compiler):
    monkeypatch.setenv("CC", compiler)
    outcome = dockloop.succeed("build", SCENE, "-o", tmp_path / "a.fmu")
    assert "kernel: none: " in outcome.out
    assert ENTRY not in zipfile.ZipFile(tmp_path / "a.fmu").namelist()
    outcome = dockloop("build", SCENE, "--kernel", "-o", tmp_path / "b.fmu")
    assert outcome.status == 1
    assert len(outcome.err.strip().splitlines()) == 1
    assert SCENE in outcome.err
    assert not (tmp_path / "b.fmu").exists()


@needs_compiler
def test_the_command_says_what_was_made(dockloop, tmp_path):
    outcome = dockloop.succeed("build", SCENE, "--kernel", "-o", tmp_path / "a.fmu")
    assert "kernel: operations " in outcome.out
    assert ENTRY in zipfile.ZipFile(tmp_path / "a.fmu").namelist()
    outcome = dockloop("build", SCENE, "--no-kernel", "-o", tmp_path / "b.fmu")
    assert "kernel: none: not wanted" in outcome.out
    assert ENTRY not in zipfile.ZipFile(tmp_path / "b.fmu").namelist()


@needs_compiler
def test_a_damaged_kernel_is_a_warning(pair, tmp_path):
    fmu, without = pair(SCENE)
    damaged = tmp_path / "damaged.fmu"
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(damaged, "w") as target:
        for name in source.namelist():
            target.writestr(name, source.read(name) if name != ENTRY else b"no library")
    bits, _, lines = run(damaged, 10)
    assert len(warnings(lines)) == 1
    assert "kernel.so" in warnings(lines)[0]
    assert bits == run(without, 10)[0]


@needs_compiler
def test_a_kernel_of_another_mechanism_is_a_warning(pair, tmp_path):
    """Another scene's kernel has another hash."""
    _, without = pair(DOCKING, NEAR)
    other = pair(SCENE)[0]
    mixed = tmp_path / "mixed.fmu"
    shutil.copy(without, mixed)
    with zipfile.ZipFile(other) as source, zipfile.ZipFile(mixed, "a") as target:
        target.writestr(ENTRY, source.read(ENTRY))
    bits, _, lines = run(mixed, 10)
    assert len(warnings(lines)) == 1
    assert bits == run(without, 10)[0]


@needs_compiler
def test_parameters_that_the_kernel_was_not_made_for_are_computed_without_it(pair):
    fmu, without = pair(DOCKING, NEAR)
    moved = {"chaser__interface_position[2]": 0.001}
    bits, _, lines = run(fmu, 30, **moved)
    assert not warnings(lines)
    assert bits == run(without, 30, **moved)[0]


@needs_compiler
def test_the_mass_of_a_vehicle_is_an_input_of_the_kernel(pair):
    fmu, without = pair(DOCKING, NEAR)
    heavy = {"chaser__mass": 31234.5, "chaser__inertia[4]": 1234.0}
    (bits, trajectory, lines), general = run(fmu, 30, **heavy), run(without, 30, **heavy)
    assert not warnings(lines)
    assert bits != general[0]
    assert np.abs(trajectory - general[1]).max() <= 1e-6 * np.abs(general[1]).max()


@needs_compiler
def test_an_fmu_with_a_kernel_is_the_same_file_every_time(dockloop, monkeypatch, tmp_path):
    for name in ("a", "b"):
        monkeypatch.setattr(paths, "KERNELS", tmp_path / name)  # nothing is there yet
        dockloop("build", SCENE, "-o", tmp_path / f"{name}.fmu")
    assert (tmp_path / "a.fmu").read_bytes() == (tmp_path / "b.fmu").read_bytes()
