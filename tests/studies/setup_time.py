"""How long `scripts/demo` takes in a new clone, now and at an earlier commit, by turns.

Each turn clones both commits into an empty folder and runs `scripts/demo` there: Python packages,
compile, FMU, first docking. The machine has the system packages already. Written to
tests/validation/setup_time.md. Nothing else should run meanwhile.

    .venv/bin/python tests/studies/setup_time.py               # a quarter of an hour
    .venv/bin/python tests/studies/setup_time.py --turns 3     # the least of three
"""

import argparse
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from dockloop.base.paths import ROOT
from page import Table, find_commit, write_page
from structure import BEFORE

_MARK = re.compile(r"\[ *(\d+) s\] (.*)")  # what scripts/demo prints before each part of its work


class Times(NamedTuple):
    """What one run took [s]."""

    demo: float
    compile: float
    processor: float


def time_demo(commit: str) -> Times:
    """Run ``scripts/demo`` in a new clone."""
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "dockloop"
        for words in (
            ["clone", "--quiet", str(ROOT), str(clone)],
            ["-C", str(clone), "checkout", "--quiet", commit],
        ):
            subprocess.run(["git", *words], check=True)
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        said = subprocess.run(
            ["scripts/demo"], cwd=clone, capture_output=True, text=True, check=True
        ).stdout
        wall, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    marks = [(int(at), what) for at, what in _MARK.findall(said)]
    at = next(i for i, (_, what) in enumerate(marks) if what.startswith("compile"))
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Times(wall, marks[at + 1][0] - marks[at][0], processor)


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", default=BEFORE, metavar="COMMIT")
    parser.add_argument("--turns", type=int, default=1, metavar="N")
    options = parser.parse_args()
    commits = {"before": options.before, "now": "HEAD"}
    runs: dict[str, list[Times]] = {name: [] for name in commits}
    for _ in range(options.turns):
        for name, commit in commits.items():
            runs[name].append(time_demo(commit))
            print(name, *(f"{value:.0f}" for value in runs[name][-1]), file=sys.stderr, flush=True)
    least = {name: Times(*map(min, zip(*found, strict=True))) for name, found in runs.items()}
    rows = (
        ("`scripts/demo` to the first docking", "demo"),
        ("of it compiling", "compile"),
        ("processor time of all parts", "processor"),
    )
    table = Table("what", "before [s]", "now [s]", "ratio")
    for what, key in rows:
        old, new = (getattr(least[name], key) for name in commits)
        table.add(what, f"{old:.0f}", f"{new:.0f}", f"{new / old:.2f}")
    write_page(
        ROOT / "tests" / "validation" / "setup_time.md",
        "Time of the set-up, then and now",
        " ".join(["tests/studies/setup_time.py", *sys.argv[1:]]),
        f"Before: commit {options.before}. Now: commit {find_commit()}. By turns, each in a new"
        f" clone; least of {options.turns}. System packages were there. Seconds differ between"
        " machines by a factor of two and more; the ratio says more.",
        table,
    )


if __name__ == "__main__":
    main()
