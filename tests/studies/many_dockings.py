"""A sweep of 4096 dockings, undisturbed and with mishaps: tests/validation/many_dockings.md.

Counts cases per second, measures the share of processor time outside the solver, and compares the
table with that of a sweep whose worker is killed, whose process is killed, and whose disk is full.

Examples:
    .venv/bin/python tests/studies/many_dockings.py                     # some ten minutes
    .venv/bin/python tests/studies/many_dockings.py --cases 32 -o build/many_dockings.md
"""

import contextlib
import hashlib
import io
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dockloop import cli
from dockloop.base import paths
from dockloop.native.core import load_core
from dockloop.sweeps import cases
from mishaps import Cluster, full_disk, lines_of, wait_for_lines
from page import Table, make_parser, write_page, write_table

COMMAND = "tests/studies/many_dockings.py"
PAGE = paths.ROOT / "tests" / "validation" / "many_dockings.md"
CASES = 4096
SWEEP, STOP = "idss_initial_conditions", 6.0  # s
PATIENCE = 3600.0  # s, for the mishap that is next


def write_sweep(folder: Path, cases: int) -> Path:
    """Write the shipped sweep with another number of cases and another end."""
    text = (paths.SWEEPS / f"{SWEEP}.toml").read_text(encoding="utf-8")
    for name, value in (("cases", cases), ("stop", STOP)):
        text, found = re.subn(rf"^{name} = \S+", f"{name} = {value}", text, flags=re.MULTILINE)
        assert found == 1, name
    path = folder / "many.toml"
    path.write_text(text, encoding="utf-8")
    return path


def call(*words: str) -> tuple[int, str, str]:
    """Run a command in this process; return its status and what it printed."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = cli.main(list(words))
    return status, out.getvalue(), err.getvalue()


class Clock:
    """Processor time of the threads that run cases, by what they do."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)  # s
        self._lock = threading.Lock()

    def timed(self, name: str, function: Callable) -> Callable:
        """Return a function that adds its time to a name."""

        def run(*arguments: Any, **options: Any) -> Any:
            began = time.thread_time()
            try:
                return function(*arguments, **options)
            finally:
                with self._lock:
                    self.spent[name] += time.thread_time() - began

        return run


class TimedDocking:
    """A docking of the core whose steps and whose start are timed."""

    def __init__(self, clock: Clock, *arguments: Any, **options: Any) -> None:
        make = clock.timed("start", load_core().Docking)
        self._docking, self._clock = make(*arguments, **options), clock

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._docking, name)
        if not callable(found):
            return found
        return self._clock.timed("solver" if name == "record" else "start", found)


class TimedCore:
    """The core with such dockings."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def __getattr__(self, name: str) -> Any:
        if name == "Docking":
            return lambda *arguments, **options: TimedDocking(self._clock, *arguments, **options)
        return getattr(load_core(), name)


@contextmanager
def timed_cases() -> Iterator[Clock]:
    """Time the dockings of sweeps in this process."""
    clock, real = Clock(), cases.load_core
    cases.load_core = lambda: TimedCore(clock)
    try:
        yield clock
    finally:
        cases.load_core = real


def measure_rate(sweep: Path, table: Path, workers: int) -> Table:
    """Run all cases, then the report; return the rows of costs."""
    words = ("sweep", str(sweep), "--engine", "core", "--workers", str(workers), "-o", str(table))
    with timed_cases() as clock:
        began, spent = time.perf_counter(), time.process_time()
        status, out, err = call(*words, "--json")
        wall, total = time.perf_counter() - began, time.process_time() - spent
    assert status == 0, err
    cases = json.loads(out)["status"]["done"]
    spent = time.process_time()
    status, _, err = call(*words, "--resume", "--report")
    report = time.process_time() - spent
    assert status == 0, err
    solver, start = clock.spent["solver"], clock.spent["start"]
    rest = total - solver - start
    table = Table("figure", "value")
    table.add("cases done", cases)
    table.add("threads", workers)
    table.add("cases per second of wall time", f"{cases / wall:.1f}")
    table.add("cases per second of processor time (per core)", f"{cases / total:.1f}")
    table.add("processor time in the solver", f"{solver:.1f} s, {solver / total:.1%}")
    table.add("to read scenes and place vehicles", f"{start:.1f} s, {start / total:.1%}")
    table.add("to plan, keep and report cases", f"{rest:.1f} s, {rest / total:.1%}")
    table.add("**outside the solver**", f"**{1.0 - solver / total:.1%}**")
    table.add("`--resume --report` afterwards: table, figures, page", f"{report:.1f} s")
    return table


def disturb(sweep: Path, table: Path, cases: int, folder: Path) -> list[tuple[str, int]]:
    """Run a sweep with mishaps; return these with the cases that were done until then."""
    journal, events = table.with_suffix(".jsonl"), []
    words = ("sweep", str(sweep), "-o", str(table))

    def note(event: str) -> None:
        events.append((event, lines_of(journal)))

    cluster = Cluster(folder)
    try:
        program = [sys.executable, "-m", "dockloop", *words, "--no-plots"]
        first = subprocess.Popen(
            [*program, "--scheduler", cluster.scheduler_address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        wait_for_lines(journal, cases // 8, PATIENCE)
        cluster.workers[0].kill()
        note("one of two Dask workers is killed (SIGKILL)")
        wait_for_lines(journal, cases // 4, PATIENCE)
        assert first.poll() is None
        first.kill()
        assert first.wait() == -signal.SIGKILL
        note("the process `dockloop sweep` is killed (SIGKILL)")
    finally:
        cluster.close()
    with full_disk(cases // 4):
        status, _, err = call(*words, "--engine", "core", "--resume")
    assert (status, "no space is left" in err) == (1, True), err
    note("`--resume` on threads, until the disk is full")
    status, _, err = call(*words, "--engine", "core", "--resume")
    assert status == 0, err
    note("`--resume` to the end")
    return events


def find_hash(table: Path) -> str:
    """Return the beginning of the hash of a file."""
    return hashlib.sha256(table.read_bytes()).hexdigest()[:16]


def main(words: list[str] | None = None) -> None:
    """Write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--cases", type=int, default=CASES, help="at least 16")
    options = parser.parse_args(words)
    if options.output == PAGE and options.cases != CASES:
        parser.error("--cases needs another page: -o build/many_dockings.md")
    # The FMUs of Dask workers hold the library of this build: its compiler is that of the core.
    os.environ.setdefault("DOCKLOOP_BUILD", str(paths.COMPILED))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sweep = write_sweep(folder, options.cases)
        whole, disturbed = folder / "whole.parquet", folder / "disturbed.parquet"
        rates = measure_rate(sweep, whole, len(os.sched_getaffinity(0)))
        events = disturb(sweep, disturbed, options.cases, folder)
        hashes = [find_hash(table) for table in (whole, disturbed)]
    same = "identical" if hashes[0] == hashes[1] else "**different**"
    write_page(
        options.output,
        f"A sweep of {options.cases} dockings",
        COMMAND,
        f"The shipped sweep `{SWEEP}` with {options.cases} cases of {STOP:g} s. Processor time is"
        " that of the whole command: planning, dockings, journal, table, summary and figures. Cases"
        " that are not done were refused: no free motion leads to their first contact.",
        "## Rate",
        rates,
        "## Mishaps",
        "The same sweep began on a Dask cluster of two worker processes.",
        write_table(("mishap", "cases in the journal"), events),
        f"The tables of both sweeps are {same}: SHA-256 {hashes[0]} and {hashes[1]}.",
    )


if __name__ == "__main__":
    main()
