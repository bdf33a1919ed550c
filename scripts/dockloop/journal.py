"""What long work of many cases leaves behind as it goes: a journal, and how far it is.

A journal is an SQLite database. Results are added one by one as they arrive, in any order.
``--resume`` runs what is missing: a case is known by its values, not by its number, so that the
work may also be continued with more cases. A killed run loses nothing. When the computer itself
stops, results since the last second in which one arrived may be lost; their cases run again.

| table | a row |
|---|---|
| ``about`` | the command, the set-up, the number of cases and their digest; the last row counts |
| ``results`` | the digest of the values of a case; values and result as JSON, with their CRC-32 |

One process at a time has the file. While it writes, the last results are in ``NAME.sqlite-wal``:
after a kill both files belong together. Results stay on the disk; memory holds a few MB of them.
"""

import datetime
import hashlib
import itertools
import json
import sqlite3
import time
import weakref
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from dockloop.cases import Result
from dockloop.errors import DockloopError, UsageError, warn
from dockloop.outputs import MADE_BY, Kind, cannot_write, claim, database_kind
from dockloop.paths import shown
from dockloop.sampling import Value
from dockloop.simulate import ProgressBar

_SYNC = 1.0  # s between two times that results are forced to the disk
_ABOUT = f"CREATE TABLE about ({MADE_BY} TEXT DEFAULT '%s', setup TEXT, cases INT, digest UNIQUE)"
_RESULTS = "CREATE TABLE results (key BLOB PRIMARY KEY, content BLOB, crc INT, is_lost INT)"
_BUSY, _LOCKED, _CORRUPT, _FULL, _FOREIGN = 5, 6, 11, 13, 26  # error codes of SQLite


class InterruptedWorkError(DockloopError):
    """Stopped by the user; what is done is in the journal."""

    exit_status = 130


def journal_kind(work: str) -> Kind:
    """Return the kind of the journal of ``dockloop WORK``."""
    return database_kind("journal", f"dockloop {work}")


def make_digest(content: Any) -> str:
    """Return the SHA-256 of what can be written as JSON."""
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def make_key(values: Any) -> bytes:
    """Return what a case is known by, as long for many values as for few."""
    return hashlib.blake2b(json.dumps(values).encode(), digest_size=12).digest()


def find_digests(path: Path) -> set[str]:
    """Return the digests of all cases that a journal was for; none if there is no journal."""
    return {digest for _, digest in _read_about(path)}


def find_outcomes(path: Path) -> list[str]:
    """Return the names of the outputs that a journal holds; none if there is no journal."""
    return next((setup.get("outcomes", []) for setup, _ in _read_about(path)), [])


def _read_about(path: Path) -> list[tuple[dict, str]]:
    """Return set-up and digest of all cases that a journal was for."""
    if path.is_file():
        with suppress(sqlite3.Error, ValueError), closing(_connect(path)) as database:
            rows = database.execute("SELECT setup, digest FROM about")
            return [(json.loads(setup), digest) for setup, digest in rows]
    return []  # the journal says why when it is opened


def _connect(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(path, timeout=0.0, isolation_level=None, check_same_thread=False)
    database.execute("PRAGMA locking_mode = EXCLUSIVE")
    return database


class Journal:
    """Results by the values of their cases, each on the disk as soon as it is added."""

    def __init__(
        self,
        path: Path,
        setup: dict,
        cases: int,
        *,
        resume: bool,
        work: str = "sweep",
        digest: str = "",
    ) -> None:
        """Open a journal, or begin it anew.

        Args:
            path: the file.
            setup: all that decides the results, as well as the values; must be that of the file.
            cases: how many there will be, at most if `finish` is called.
            resume: go on with what the file holds.
            work: what the cases belong to, for messages.
            digest: of these cases; a finished journal of others is not begun anew.

        Raises:
            UsageError: the file belongs to another set-up, is unfinished and not to be resumed, is
                damaged, or another process writes it.
            DockloopError: it cannot be written.
        """
        self.path, self._work, self._setup, self._digest = path, work, setup, digest
        claim(path, journal_kind(work))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileExistsError):
                path.open("xb").close()
            is_new = path.stat().st_size == 0
        except OSError as error:
            raise cannot_write(path, error) from None
        self._database = _connect(path)
        weakref.finalize(self, self._database.close)
        self._synced = time.monotonic()
        try:
            with self._explaining():
                self._open(cases, is_new=is_new, resume=resume)
        except BaseException:
            self._database.close()
            if is_new:
                path.unlink(missing_ok=True)
            raise

    def __len__(self) -> int:
        """Return the number of results."""
        return self._find("SELECT count(*) FROM results")[0]

    def __contains__(self, values: object) -> bool:
        """Return whether there is a result."""
        return bool(self._find("SELECT 1 FROM results WHERE key = ?", make_key(values)))

    def __getitem__(self, values: tuple[Value, ...]) -> Result:
        """Return the result of a case."""
        return self.read(make_key(values))

    def read(self, key: bytes) -> Result:
        """Return the result of a case by its `make_key`."""
        row = self._find("SELECT content FROM results WHERE key = ?", key)
        if row is None:
            raise DockloopError(f"{shown(self.path)}: was changed by another program meanwhile")
        content = json.loads(row[0])
        del content["values"]
        return Result(**content | {"outputs": tuple(content["outputs"])})

    def add(self, values: tuple[Value, ...], result: Result) -> None:
        """Add one result; one that was lost with its worker is forgotten when the file is reopened.

        Raises:
            DockloopError: it cannot be written.
        """
        content = json.dumps({"values": values, **vars(result)}).encode()
        row = (make_key(values), content, zlib.crc32(content), result.status == "lost")
        with self._explaining():
            self._database.execute("INSERT OR REPLACE INTO results VALUES (?, ?, ?, ?)", row)
            now = time.monotonic()
            if now - self._synced > _SYNC:
                self._database.execute("PRAGMA wal_checkpoint")
                self._synced = now

    def finish(self) -> None:
        """Note that there will be no more cases: what is known is all. Raises DockloopError."""
        with self._explaining():
            self._note_cases(len(self))

    def close(self) -> None:
        """Force everything to the disk, into one file that others may write; it can still be read.

        Raises:
            DockloopError: that fails.
        """
        try:
            with self._explaining():
                self._database.execute("PRAGMA journal_mode = DELETE")
                self._database.execute("PRAGMA locking_mode = NORMAL")
                self._database.execute("SELECT 1 FROM about").fetchone()  # this ends the lock
        except DockloopError:
            self._database.close()
            raise

    def count(self, cases: Iterable[tuple[Value, ...]]) -> str:
        """Say how many of these cases are there: ``3 of 8 cases``."""
        done, total = 0, 0
        for case in cases:
            done, total = done + (case in self), total + 1
        return f"{done} of {total} cases"

    @contextmanager
    def at_work(self, describe: Callable[[], str]) -> Iterator[None]:
        """Close the file after the work that fills it; Ctrl-C is reported as unfinished work.

        Args:
            describe: says what the file holds, such as ``3 of 8 cases``.

        Raises:
            InterruptedWorkError: by Ctrl-C.
        """
        try:
            yield
        except KeyboardInterrupt:
            raise InterruptedWorkError(
                f"interrupted with {describe()} in {shown(self.path)}; the same command with"
                " --resume goes on"
            ) from None
        finally:
            self.close()

    def _open(self, cases: int, *, is_new: bool, resume: bool) -> None:
        """Lock the file, and make it one for these cases; what is refused stays as it is."""
        execute = self._database.execute
        execute("BEGIN EXCLUSIVE")
        if is_new:
            execute(_ABOUT % f"dockloop {self._work}")
            execute(_RESULTS)
        else:
            self._take_over(resume=resume)
        self._note_cases(cases)
        execute("COMMIT")
        execute("PRAGMA journal_mode = WAL")
        execute("PRAGMA synchronous = NORMAL")  # no waiting for the disk but in checkpoints

    def _take_over(self, *, resume: bool) -> None:
        """Keep the results of a file that is there, or clear it if it is finished."""
        place, execute = shown(self.path), self._database.execute
        (state,) = execute("PRAGMA integrity_check(1)").fetchone()
        about = execute("SELECT setup, cases, digest FROM about ORDER BY rowid DESC").fetchone()
        if state != "ok" or about is None:
            raise self._damaged(state)
        setup, cases, digest = json.loads(about[0]), about[1], about[2]
        self._database.create_function("crc32", 1, zlib.crc32)
        execute("DELETE FROM results WHERE is_lost")
        damaged = execute("DELETE FROM results WHERE crc != crc32(CAST(content AS BLOB))").rowcount
        other = [name for name in self._setup if setup.get(name) != self._setup[name]]
        if resume and other:
            raise UsageError(
                f"{place}: cannot be resumed, it was made with another {', '.join(other)}:"
                " delete the file, or write elsewhere with -o"
            )
        if resume:
            if damaged:
                warn(
                    f"{place}: {damaged} of {len(self) + damaged} results are damaged or were"
                    " changed: their cases run again"
                )
            return
        holds = len(self) or damaged
        if holds and len(self) < cases:
            raise UsageError(
                f"{place}: holds {len(self)} of {cases} cases of a {self._work} that was"
                " interrupted: go on with --resume, or delete the file"
            )
        if holds and digest != self._digest:
            raise UsageError(
                f"{place}: holds the finished cases of another {self._work}: choose another -o or"
                " delete the file"
            )
        execute("DELETE FROM results")
        execute("DELETE FROM about")

    def _note_cases(self, cases: int) -> None:
        self._database.execute(
            "INSERT OR REPLACE INTO about (setup, cases, digest) VALUES (?, ?, ?)",
            (json.dumps(self._setup), cases, self._digest),
        )

    def _find(self, question: str, *values: Any) -> Any:
        """Return the first row of an answer, or None."""
        with self._explaining():
            return self._database.execute(question, values).fetchone()

    @contextmanager
    def _explaining(self) -> Iterator[None]:
        """Say in one sentence what SQLite reports."""
        try:
            yield
        except (sqlite3.Error, ValueError) as error:
            code = getattr(error, "sqlite_errorcode", _CORRUPT) & 0xFF
            if code in (_BUSY, _LOCKED):
                reason = f"{shown(self.path)}: another {self._work} is writing it"
                raise UsageError(reason) from None
            if code in (_CORRUPT, _FOREIGN, 1):
                raise self._damaged(error) from None
            reason = "no space is left on the disk" if code == _FULL else str(error)
            raise DockloopError(
                f"{shown(self.path)}: cannot be written ({reason}); the same command with --resume"
                " goes on"
            ) from None

    def _damaged(self, reason: object) -> UsageError:
        return UsageError(
            f"{shown(self.path)}: is damaged ({reason}): delete the file, or write elsewhere with"
            " -o"
        )


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
