"""The examples for users (scripts/examples), run as users run them, give what one FMU gives.

1. The host in numpy, in both modes: the same outcome, the same times, the same peak loads.
2. Basilisk in orbit, in both modes: likewise.
3. With the gravity of the target inside the FMU, the vehicles fly to each other as the gradient of
   gravity says; with that of the chaser they do not notice that they are in orbit.
4. Options that make no sense are refused in a sentence.
5. The cells of the notebook run.
6. The controller of the hexapod takes energy out of the swing, and the audit closes.
7. A tunnel that vibrates inside the FMU, and a controller whose commands act later: as one FMU.
8. Arrays and slosh of Basilisk dock as the parts of one FMU: two programs, other equations.
"""

import importlib.util
import json
import re
import sys

import pytest

from dockloop.base import paths
from programs import call, run

pytestmark = pytest.mark.long  # examples as users run them

EXAMPLES = paths.ROOT / "scripts" / "examples"
MODES = ("parallel", "sequential")
PEAKS = [
    f"capture.peak.{load}" for load in ("compression", "tension", "shear", "bending", "torsion")
]
NEEDS_BASILISK = pytest.mark.skipif(
    importlib.util.find_spec("Basilisk") is None, reason="Basilisk (package bsk) is not installed"
)


def run_example(name, *options):
    """Run an example; returns the finished process."""
    return run(sys.executable, EXAMPLES / name, *options)


def read_table(name, *options, warns=()):
    """Run an example; returns (value with one FMU, difference) by name, outcomes, distance."""
    process = run_example(name, *options)
    assert process.returncode == 0, process.stdout + process.stderr
    warnings = [line for line in process.stdout.splitlines() if "WARNING" in line]
    assert len(warnings) == len(warns)
    assert all(word in line for word, line in zip(warns, warnings, strict=True)), warnings
    rows = re.findall(r"^(\S+) +(?:s|N|N\.m) +\S+ +(\S+) +(\S+)$", process.stdout, re.MULTILINE)
    table = {quantity: (float(alone), float(difference)) for quantity, alone, difference in rows}
    table["outcome"] = re.search(r"^outcome +(\S+) +(\S+)$", process.stdout, re.MULTILINE).groups()
    (table["distance"],) = map(float, re.findall(r"at the end: (\S+) m", process.stdout))
    return table


def check_agreement(table, *, peaks, times, distance):
    """Both runs capture; peaks differ by less than a fraction, times by s, places by m."""
    assert table["outcome"] == ("captured", "captured")
    assert table["time_of_capture"][0] > table["time_of_contact"][0] > 0.0
    assert all(table[name][0] > 0.0 for name in PEAKS)
    limits = {"time_of_contact": times, "time_of_capture": times}
    limits |= {name: peaks * table[name][0] for name in PEAKS}
    beyond = {n: (table[n][1], limit) for n, limit in limits.items() if abs(table[n][1]) >= limit}
    assert beyond == {}
    assert table["distance"] < distance


@pytest.mark.parametrize("mode", [*MODES, "host_first"])
def test_a_host_in_numpy_docks_as_one_fmu_does(mode):
    table = read_table("python_host.py", "--mode", mode)
    # Found: 1.3e-7 of a peak (1e-4 with other steps: impacts magnify rounding), 2.1e-9 s, 2.6e-7 m.
    check_agreement(table, peaks=1e-3, times=2e-8, distance=2.6e-6)


def test_a_tunnel_inside_the_fmu_vibrates_as_in_one_fmu():
    table = read_table("python_host.py", "--adapter", "--step", "0.05")
    # Found: 6e-7 of a peak, 6e-11 s, 8e-6 m.
    check_agreement(table, peaks=1e-5, times=2e-8, distance=8e-5)


def test_commands_of_a_controller_act_later_at_no_cost_of_accuracy():
    times = []
    for delay in ("2", "40"):
        table = read_table("controller_host.py", "--delay", delay)
        # Found: 2e-7 of a peak (impacts magnify rounding), 9e-10 s, 3e-7 m.
        check_agreement(table, peaks=1e-3, times=2e-8, distance=3e-6)
        times.append(table["time_of_contact"][0])
    assert abs(times[0] - times[1]) > 1e-3  # the delay changes the docking


@NEEDS_BASILISK
def test_arrays_and_slosh_of_basilisk_dock_as_parts_of_one_fmu():
    table = read_table("basilisk_flexible.py", warns=["flexible part"])
    # Found: 1.5e-4 of a peak, 4.7e-7 s, 3.8e-7 m.
    check_agreement(table, peaks=1e-3, times=5e-6, distance=4e-6)


@NEEDS_BASILISK
@pytest.mark.parametrize("mode", MODES)
def test_basilisk_docks_in_orbit_as_one_fmu_does_at_rest(mode):
    table = read_table("basilisk_host.py", "--mode", mode)
    # Found: 2.2e-5 of a peak (likewise), 1.7e-6 s, 1.8e-7 m: gravity is held over a step, which
    # moves the target by 8e-10 m a step against the orbit of the chaser.
    check_agreement(table, peaks=1e-3, times=1.7e-5, distance=1.8e-6)


@NEEDS_BASILISK
def test_the_gradient_of_gravity_pulls_as_it_should_or_not_at_all():
    # Before contact, one behind the other in orbit: they approach by mu/r^3 times their distance.
    stop, gradient = 1.5, 3.986004e14 / 6.8e6**3
    chaser = read_table("basilisk_host.py", "--stop", str(stop))
    target = read_table("basilisk_host.py", "--stop", str(stop), "--gravity-at", "target")
    assert chaser["outcome"] == target["outcome"] == ("undecided", "undecided")
    expected = 0.5 * gradient * 19.25 * stop**2  # the distance falls from 19.3 to 19.1 m
    assert target["distance"] == pytest.approx(expected, rel=0.01)
    assert chaser["distance"] < 0.01 * expected


@pytest.mark.parametrize("options", [("--step", "0"), ("--stop", "nan"), ("--mode", "both")])
def test_options_that_make_no_sense_are_refused_in_a_sentence(options):
    process = run_example("python_host.py", *options)
    assert process.returncode == 2
    assert f"argument {options[0]}" in process.stderr
    assert "Traceback" not in process.stderr


def test_the_cells_of_the_notebook_run_from_the_top(tmp_path):
    notebook = json.loads((EXAMPLES / "docking.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    assert len(cells) > 5
    assert not any(c.get("outputs") for c in notebook["cells"])  # results belong to the user
    script = "\n".join([*cells, 'assert result.summary["captured"] and docking.get("captured")'])
    call(sys.executable, "-c", script, cwd=tmp_path)
    assert (tmp_path / "docking.html").stat().st_size > 1e5


def test_the_impedance_controller_damps_the_swing():
    process = run_example("impedance_control.py", "--step", "0.005")
    assert process.returncode == 0, process.stderr
    rows = re.findall(r"^(.*?) {2,}(\S+) +(\S+)$", process.stdout, re.MULTILINE)
    table = {name: (float(damped), float(free)) for name, damped, free in rows}
    damped, free = table["swing of relative.axial"]
    assert damped < 0.85 * free  # found: 0.71
    assert table["energy.drive_work"][0] < -20.0  # found: -52 J
    assert table["energy.drive_work"][1] == 0.0
    assert max(map(abs, table["energy.residual"])) < 1e-4
    assert min(table["time_of_capture"]) > 2.0
