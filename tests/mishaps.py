"""What may happen to a long sweep, made on purpose: workers and processes that die, a full disk."""

import itertools
import json
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from dockloop import journal as journals
from dockloop.cases import Result
from dockloop.journal import Journal


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

    def close(self) -> None:
        for process in (*self.workers, self._scheduler):
            process.kill()
            process.wait(timeout=60)

    def _start(self, *words: str) -> subprocess.Popen:
        common = ("--scheduler-file", str(self._file), "--no-dashboard", "--host", "127.0.0.1")
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen([sys.executable, "-m", "dask", *words, *common], **quiet)


def count_results(journal: Path) -> int:
    """Return the number of results in a journal, also while another process writes it."""
    return len(read_results(journal))


def read_results(journal: Path) -> list[bytes]:
    """Return the results of a journal in their order, also while another process writes it."""
    with tempfile.TemporaryDirectory() as folder:
        for ending in ("", "-wal"):
            with suppress(FileNotFoundError):
                shutil.copy(f"{journal}{ending}", folder)
        with suppress(sqlite3.Error), closing(sqlite3.connect(f"{folder}/{journal.name}")) as copy:
            rows = copy.execute("SELECT content FROM results ORDER BY rowid")
            return [content for (content,) in rows]
    return []


def wait_for_results(journal: Path, count: int, patience: float = 60.0) -> None:
    """Wait until a journal has so many results; patience in s."""
    for _ in range(round(100.0 * patience)):
        if count_results(journal) >= count:
            return
        time.sleep(0.01)
    raise AssertionError(f"{journal} has {count_results(journal)} results, not {count}")


def change(journal: Path, damage: str | Callable[[Path], None]) -> None:
    """Change a journal that is at rest, by a statement of SQL or a function."""
    if callable(damage):
        damage(journal)
        return
    with closing(sqlite3.connect(journal, isolation_level=None)) as database:
        assert database.execute(damage).rowcount > 0


@contextmanager
def full_disk(result: int) -> Iterator[None]:
    """Let the disk have no space for a result of a journal, counted from 1; 0: for its tables."""
    full, added = "PRAGMA max_page_count = 1", itertools.count(1)  # no page more than there are

    def connect(path: Path) -> sqlite3.Connection:
        database = real_connect(path)
        if result == 0:
            database.execute(full)
        return database

    def add(self: Journal, values: tuple, found: Result) -> None:
        if next(added) == result:
            self._database.execute(full)
            found = replace(found, reason="more than fits on the pages that there are" * 1000)
        real_add(self, values, found)

    real_connect, real_add = journals._connect, Journal.add
    journals._connect, Journal.add = connect, add
    try:
        yield
    finally:
        journals._connect, Journal.add = real_connect, real_add
