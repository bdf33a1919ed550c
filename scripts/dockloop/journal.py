"""What long work of many cases leaves behind as it goes: a journal, and how far it is.

Results are appended to a file (JSON lines) as they arrive, in any order. ``--resume`` reads it back
and runs what is missing: a case is known by its values, not by its number, so that the work may
also be continued with more cases, and a killed run loses nothing. Used by ``dockloop sweep`` and
``dockloop trade``.
"""

import datetime
import fcntl
import itertools
import json
import os
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from dockloop.cases import Result
from dockloop.errors import DockloopError, UsageError
from dockloop.paths import shown
from dockloop.sampling import Value
from dockloop.simulate import ProgressBar

_SYNC = 1.0  # s between two times that the journal is forced to the disk


class InterruptedWorkError(DockloopError):
    """Stopped by the user; what is done is in the journal."""

    exit_status = 130


class Journal:
    """Results of cases, one line each, appended as they arrive.

    Attributes:
        known: results by the values of their cases.
        path: the file.
    """

    def __init__(
        self, path: Path, setup: dict, cases: int, *, resume: bool, work: str = "sweep"
    ) -> None:
        """Open a journal, or begin it anew.

        Args:
            path: the file.
            setup: all that decides the results beside the values; must be that of the file.
            cases: how many there will be.
            resume: go on with what the file holds.
            work: what the cases belong to, for messages.

        Raises:
            UsageError: the file belongs to another set-up, or is unfinished and not to be resumed.
        """
        self.path, self.known, self._work = path, {}, work
        self._synced = time.monotonic()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+b")
        except OSError as error:
            raise DockloopError(f"{shown(path)}: cannot be written ({error.strerror})") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UsageError(f"{shown(path)}: another {work} is writing it") from None
        header, intact = self._read()
        if header is not None and not resume and len(self.known) < header["cases"]:
            raise UsageError(
                f"{shown(path)}: holds {len(self.known)} of {header['cases']} cases of a"
                f" {work} that was interrupted: go on with --resume, or delete the file"
            )
        if header is not None and resume:
            old = header["setup"]
            other = [name for name in setup if old.get(name) != setup[name]]
            if other:
                raise UsageError(
                    f"{shown(path)}: cannot be resumed, it was made with another"
                    f" {', '.join(other)}: delete the file, or write elsewhere with -o"
                )
        else:
            self.known.clear()
            intact = 0
        self._file.truncate(intact)  # what was cut off in the middle of a line is done again
        if not intact:
            self._write({"setup": setup, "cases": cases})

    def add(self, values: tuple[Value, ...], result: Result) -> None:
        """Append one result; a case that was lost with its worker is not recorded."""
        self.known[values] = result
        if result.status != "lost":
            self._write({"values": values, **asdict(result)})

    def close(self) -> None:
        """Force everything to the disk."""
        os.fsync(self._file.fileno())
        self._file.close()

    def _write(self, line: dict) -> None:
        self._file.write(json.dumps(line).encode() + b"\n")
        self._file.flush()
        now = time.monotonic()
        if now - self._synced > _SYNC:
            os.fsync(self._file.fileno())
            self._synced = now

    def _read(self) -> tuple[dict | None, int]:
        """Return the header and the length of the intact part; fills `known`."""
        header, intact = None, 0
        self._file.seek(0)
        for raw in self._file:
            try:
                line = json.loads(raw) if raw.endswith(b"\n") else None
                if line is None:
                    break
                if header is None:
                    header = {"setup": line["setup"], "cases": line["cases"]}
                else:
                    values = tuple(line.pop("values"))
                    result = Result(**line)
                    result.outputs = tuple(result.outputs)
                    self.known[values] = result
            except (ValueError, KeyError, TypeError):
                raise UsageError(f"{shown(self.path)}: is no journal of a {self._work}") from None
            intact += len(raw)
        return header, intact


def make_report(progress: ProgressBar | None, done: int, total: int) -> Callable[[], None]:
    """Return a function that moves the progress bar by one case: rate and remaining time."""
    began, ran = time.monotonic(), itertools.count(1)

    def report() -> None:
        now = next(ran)
        rate = now / max(time.monotonic() - began, 1e-9)
        left = max(0, total - done - now)
        if progress:
            left_time = datetime.timedelta(seconds=round(left / rate))
            note = f"{done + now} of {total}, {rate:.2f} per second, {left_time} left"
            progress((done + now) / total, note)

    return report
