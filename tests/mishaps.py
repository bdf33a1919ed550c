"""What may happen to a long sweep, made on purpose: workers and processes that die, a full disk."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dockloop.sweeps.journal import Journal


class Cluster:
    """A scheduler and two workers, processes of their own, started as scripts/README.md says."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._file = folder, folder / "scheduler.json"
        self._scheduler = self._start("scheduler", "--port", "0")
        self.workers = [self.start_worker() for _ in range(2)]
        for _ in range(6000):
            if self._file.exists() and self._file.stat().st_size > 0:  # it is made, then written
                break
            time.sleep(0.01)
        self.scheduler_address = json.loads(self._file.read_text())["address"]

    def start_worker(self) -> subprocess.Popen:
        alone = ("--nthreads", "1", "--no-nanny", "--memory-limit", "0")
        return self._start("worker", *alone, "--local-directory", str(self._folder))

    def kill_scheduler(self) -> None:
        self._scheduler.kill()

    def close(self) -> None:
        for process in (*self.workers, self._scheduler):
            process.kill()
            process.wait(timeout=60)

    def _start(self, *words: str) -> subprocess.Popen:
        common = ("--scheduler-file", str(self._file), "--no-dashboard", "--host", "127.0.0.1")
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen([sys.executable, "-m", "dask", *words, *common], **quiet)


def lines_of(journal: Path) -> int:
    """Return the number of results in a journal."""
    return journal.read_bytes().count(b"\n") - 1 if journal.exists() else 0


def wait_for_lines(journal: Path, count: int, patience: float = 60.0) -> None:
    """Wait until a journal has so many results; patience in s."""
    for _ in range(round(100.0 * patience)):
        if lines_of(journal) >= count:
            return
        time.sleep(0.01)
    raise AssertionError(f"{journal} has {lines_of(journal)} results, not {count}")


@contextmanager
def full_disk(*lines: int) -> Iterator[None]:
    """Let the disk have no space for these lines of journals, counted from 1."""
    real, written = Journal._write, []

    def write_line(self: Journal, line: dict) -> int:
        written.append(line)
        if len(written) in lines:
            self._file.close()
            self._file = Path("/dev/full").open("wb")  # noqa: SIM115  the journal closes it
        return real(self, line)

    Journal._write = write_line
    try:
        yield
    finally:
        Journal._write = real
