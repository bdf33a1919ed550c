"""Where the work of a docking goes: tests/validation/instructions.md.

Runs dockings through their FMUs under callgrind (the Debian package valgrind), which counts the
processor instructions inside ``fmi2DoStep``, function by function, and those of reading outputs.
Unlike times, the counts repeat. valgrind knows no vectors wider than four numbers, so wider
processors need fewer.

Examples:
    apt-get install valgrind
    .venv/bin/python tests/studies/instructions.py             # some five minutes
"""

import re
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

import pytest

from dockloop.base import paths
from dockloop.base.progress import ProgressBar
from dockloop.fmu.build import build_fmu
from page import call, write_page, write_table

PAGE = paths.ROOT / "tests" / "validation" / "instructions.md"
STOP, STEP = 20.0, 0.01
RUNS = (  # scene, accuracy; 0: default settings
    ("idss_25t_350t", 1e-3),
    ("idss_25t_350t", 1e-6),
    ("hexapod", 1e-3),
    ("apda", 1e-3),
)
EVALUATION = "calc_docking<double>("
PARTS = {  # of one evaluation: functions, each with all that it calls
    "mechanism: position, inertia and its factors": ("calc_position<double>(dockloop::Mechanism ",),
    "mechanism: velocities, forces, accelerations": (
        "calc_velocity<double>(dockloop::Mechanism ",
        "calc_acceleration<double>(dockloop::Mechanism ",
    ),
    "contact, latches, hard dock": ("calc_capture_forces<double>(",),
}
MATRIX = (
    "calc_mechanism_block(",
    *(f"StructuredMatrix::{n}(" for n in ("build", "factor", "solve")),
)
ALL = "dockloop::DockingSim::step(double, double)"  # all that takes time in fmi2DoStep
READING = "dockloop::DockingSim::update(dockloop::OutputGroup)"  # the same, in fmi2GetReal
# Calls `fmi2DoStep` of an FMU to the end; prints evaluations and inner steps.
SCRIPT = """
import sys
from pathlib import Path
from dockloop.fmu.host import run_fmu
fmu, stop, step, outputs, *settings = sys.argv[1:]
made = run_fmu(Path(fmu), settings, float(stop), float(step), outputs=[outputs])
print(*(int(made[f"solver.{name}"][-1]) for name in ("rhs_evaluations", "steps")))
"""


def count(
    scene: str, accuracy: float, folder: Path, inside: str = ALL, outputs: str = "solver.*"
) -> tuple[int, int, Counter[str]]:
    """Run the FMU of a scene under callgrind, with the library of this build: others lack names.

    Args:
        scene: name of a shipped scene.
        accuracy: parameter of the FMU; 0: default settings.
        folder: for files of the run.
        inside: function in which instructions are counted.
        outputs: pattern of outputs that are read at every point.

    Returns:
        Evaluations, inner steps, and the instructions of each function with all that it calls.
    """
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("DOCKLOOP_BUILD", str(paths.COMPILED))
        fmu = build_fmu(scene, (), folder / f"{scene}.fmu", bare=True)
    out = folder / "callgrind.out"
    printed = call(
        *("valgrind", "--tool=callgrind", f"--callgrind-out-file={out}"),
        *("--collect-atstart=no", f"--toggle-collect={inside}", sys.executable, "-c", SCRIPT),
        *(fmu, repr(STOP), repr(STEP), outputs, f"accuracy={accuracy!r}"),
    )
    table = call("callgrind_annotate", "--inclusive=yes", "--threshold=100", out)
    rows = re.findall(r"^ *([\d,]+) \([ \d.]+%\) +\S+?:(.*?) \[", table, re.MULTILINE)
    evaluations, steps = map(int, printed.split()[-2:])
    functions = Counter()
    for number, name in rows:
        functions[name] += int(number.replace(",", ""))
    if inside not in functions:
        raise SystemExit(f"callgrind has not seen {inside}")
    return evaluations, steps, functions


def count_reading(scene: str, accuracy: float, folder: Path, outputs: str = "*") -> float:
    """Return the instructions of reading outputs, by default all, at one communication point."""
    _, _, functions = count(scene, accuracy, folder, READING, outputs)
    return functions[READING] / (STOP / STEP + 1)


def add_up(functions: Counter[str], *parts: str) -> int:
    """Return the instructions of the functions whose names contain one of these texts."""
    return sum(n for name, n in functions.items() if any(part in name for part in parts))


def main() -> None:
    """Write the page."""
    if shutil.which("valgrind") is None:
        raise SystemExit("no valgrind on this machine: apt-get install valgrind")
    names = ("all evaluations", *(f"- {name}" for name in PARTS), "- all else of an evaluation")
    names += ("matrix of linearly implicit steps: build, factors, solutions", "all else")
    columns: list[list[str]] = []
    report = ProgressBar("runs")
    with tempfile.TemporaryDirectory() as folder:
        for i, (scene, accuracy) in enumerate(RUNS):
            evaluations, steps, functions = count(scene, accuracy, Path(folder))
            total, whole = functions[ALL], add_up(functions, EVALUATION)
            parts = [add_up(functions, *found) for found in PARTS.values()]
            matrix = add_up(functions, *MATRIX)
            shares = [whole, *parts, whole - sum(parts), matrix, total - whole - matrix]
            columns.append(
                [
                    f"{evaluations:,}",
                    f"{steps:,}",
                    f"{total / evaluations / 1000:.1f}",
                    *(f"{share / total:.0%}" for share in shares),
                    f"{count_reading(scene, accuracy, Path(folder)) / 1000:.1f}",
                ]
            )
            report((i + 1) / len(RUNS))
    heads = ("part", *(f"`{scene}`, `accuracy` {wanted:g}" for scene, wanted in RUNS))
    rows = zip(
        (
            *("evaluations", "inner steps", "thousand instructions for an evaluation, all in"),
            *(*names, "thousand instructions to read all outputs at a point"),
        ),
        *columns,
        strict=True,
    )
    write_page(
        PAGE,
        "Where the work of a docking goes",
        "tests/studies/instructions.py",
        f"Processor instructions inside `fmi2DoStep` by callgrind, {STOP:g} s at {STEP:g} s. The"
        " last row is what `fmi2GetReal` adds where a host reads all outputs.",
        write_table(heads, rows),
        "All else: stages and error control of the solver, events, audits, peaks, the list of"
        " contact pairs that are close, and what each communication point costs.",
    )


if __name__ == "__main__":
    main()
