"""What long work of many cases leaves behind as it goes: a journal, and how far it is.

Results are appended to a file (JSON lines) as they arrive, in any order. ``--resume`` reads it back
and runs what is missing: a case is known by its values, not by its number, so that the work may
also be continued with more cases, and a killed run loses nothing. Sweeps (``--rare`` too),
envelopes, maps, trades and random extremes keep one.

The first line says which command made the file, under which set-up, and for which cases (their
number and a digest); another such line follows when the cases become others. Every line ends with a
checksum of what stands before it: a line that was changed is reported once, its case is run again,
all other lines stay what they are.

Results stay on the disk. In memory is a digest of the values of each case, and where its line
begins.
"""

import datetime
import hashlib
import json
import os
import time
import weakref
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from dockloop.base.errors import DockloopError, UsageError, find_reason, warn
from dockloop.base.files import MADE_BY, Kind, cannot_write, claim, json_kind, writing
from dockloop.base.paths import shown
from dockloop.base.progress import ProgressBar
from dockloop.base.system import CAN_REPLACE_OPEN_FILES, lock
from dockloop.runs.outcome import STATUSES, Result
from dockloop.sweeps.sampling import Value

_SYNC = 1.0  # s between two times that the journal is forced to the disk
Place = int | tuple[tuple[Value, ...], Result]  # where a line begins; or a case that has no line
_SUM = b', "crc": "'  # stands between what a line says and its checksum


class InterruptedWorkError(DockloopError):
    """Stopped by the user; what is done is in the journal."""

    exit_status = 130


def journal_kind(work: str) -> Kind:
    """Return the kind of the journal of ``dockloop WORK``."""
    return json_kind("journal", f"dockloop {work}")


def make_digest(content: Any) -> str:
    """Return the SHA-256 of what can be written as JSON."""
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def find_digests(path: Path) -> set[str]:
    """Return the digests of all cases that a journal was for; none if there is no journal."""
    return {head["digest"] for head in _read_heads(path) if "digest" in head}


def find_outcomes(path: Path) -> list[str]:
    """Return the names of the outputs that a journal holds; none if there is no journal."""
    return next((head["setup"].get("outcomes", []) for head in _read_heads(path)), [])


def _read_heads(path: Path) -> list[dict]:
    """Return the lines of a journal that say what it is for."""
    try:
        with path.open("rb") as file:
            lines = [_parse(raw) for raw in file if b'"setup"' in raw]
    except OSError:  # the journal says so itself when it is opened
        return []
    return [line for line in lines if line and "setup" in line]


@contextmanager
def keeps_results() -> Iterator[None]:
    """Say that the journal has all results, when a file cannot be written after the work."""
    try:
        yield
    except UsageError:
        raise
    except DockloopError as error:
        raise DockloopError(
            f"{error}; the journal has all results: the same command with --resume goes on"
        ) from None


class Known(Mapping[tuple[Value, ...], Result]):
    """Results of a journal by the values of their cases, read when they are looked at."""

    def __init__(self, path: Path) -> None:
        """Prepare to read a journal; the file may be closed and opened meanwhile."""
        self._path = path
        self._file: BinaryIO | None = None
        self._places: dict[bytes, Place] = {}

    def __len__(self) -> int:
        """Return the number of cases."""
        return len(self._places)

    def __contains__(self, values: object) -> bool:
        """Return whether there is a result."""
        return _find_key(values) in self._places

    def __iter__(self) -> Iterator[tuple[Value, ...]]:
        """Yield the values of all cases."""
        return (self._read(place)[0] for place in self._places.values())

    def __getitem__(self, values: tuple[Value, ...]) -> Result:
        """Return the result of a case."""
        return self.read(self.find_place(values))

    def close(self) -> None:
        """Close the file, until a result is looked at."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def find_place(self, values: tuple[Value, ...]) -> Place:
        """Return where the result of a case is: less to keep than the result."""
        return self._places[_find_key(values)]

    def read(self, place: Place) -> Result:
        """Return the result at a place."""
        return self._read(place)[1]

    def note(self, values: tuple[Value, ...], place: int | Result) -> None:
        """Note where the line of a case begins, or the result of a case without a line."""
        self._places[_find_key(values)] = place if isinstance(place, int) else (values, place)

    def clear(self) -> None:
        """Forget all results."""
        self._places.clear()

    def _read(self, place: Place) -> tuple[tuple[Value, ...], Result]:
        if isinstance(place, tuple):
            return place
        if self._file is None:
            self._file = self._path.open("rb")
            weakref.finalize(self, self._file.close)
        self._file.seek(place)
        found = _read_result(_parse(self._file.readline()))
        if found is None:
            raise DockloopError(f"{shown(self._path)}: was changed by another program meanwhile")
        return found


class Journal:
    """Results of cases, one line each, appended as they arrive.

    Attributes:
        known: results by the values of their cases.
        path: the file.
    """

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
            UsageError: the file belongs to another set-up, or is unfinished and not to be resumed.
            DockloopError: it cannot be written.
        """
        self.path, self._work = path, work
        self.known = Known(path)
        self._synced, self._is_broken = time.monotonic(), False
        claim(path, journal_kind(work))
        header = {MADE_BY: f"dockloop {work}", "setup": setup, "cases": cases, "digest": digest}
        self._header = header
        self._made = [each for each in path.parents if not each.exists()]
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                self._file, is_new = path.open("x+b"), True
            except FileExistsError:
                self._file, is_new = path.open("r+b"), False
        except OSError as error:
            raise cannot_write(path, error) from None
        self._is_new = is_new
        try:
            self._lock(self._file)
            if is_new:
                self._write(header)
            else:
                self._go_on(header, resume=resume)
        except BaseException:
            with suppress(OSError):
                self._file.close()
            if is_new:
                self._take_away()
            raise

    def add(self, values: tuple[Value, ...], result: Result) -> None:
        """Append one result; a case that was lost with its worker is not recorded.

        Raises:
            DockloopError: it cannot be written.
        """
        if result.status == "lost":
            self.known.note(values, result)
        else:
            self.known.note(values, self._write({"values": values, **vars(result)}))

    def finish(self) -> None:
        """Note that there will be no more cases: what is known is all. Raises DockloopError."""
        self._header["cases"] = len(self.known)
        self._write(self._header)

    def close(self) -> None:
        """Force everything to the disk. Raises DockloopError: that fails."""
        try:
            if not self._is_broken:
                os.fsync(self._file.fileno())
            self._file.close()
        except OSError as error:
            if not self._is_broken:  # else it has been reported
                raise self._cannot_write(error) from None

    def count(self, cases: Iterable[tuple[Value, ...]]) -> str:
        """Say how many of these cases are there: ``3 of 8 cases``."""
        done, total = 0, 0
        for case in cases:
            done, total = done + (case in self.known), total + 1
        return f"{done} of {total} cases"

    @contextmanager
    def at_work(self, describe: Callable[[], str]) -> Iterator[None]:
        """Close the file after the work that fills it; Ctrl-C is reported as unfinished work.

        A file that this work has begun, and its folder, go if all cases are refused.

        Args:
            describe: says what the file holds, such as ``3 of 8 cases``.

        Raises:
            InterruptedWorkError: by Ctrl-C.
        """
        is_vain = False
        try:
            yield
        except KeyboardInterrupt:
            raise InterruptedWorkError(
                f"interrupted with {describe()} in {shown(self.path)}; the same command with"
                " --resume goes on"
            ) from None
        except UsageError:
            is_vain = self._is_new and all(r.status == "refused" for r in self.known.values())
            raise
        finally:
            self.close()
            if is_vain:
                self.known.close()
                self._take_away()

    def _take_away(self) -> None:
        """Remove the file and the folders that were made for it, if nothing else is in them."""
        with suppress(OSError):
            self.path.unlink()
            for folder in self._made:
                folder.rmdir()

    def _lock(self, file: BinaryIO) -> None:
        try:
            lock(file)
        except OSError:
            raise UsageError(f"{shown(self.path)}: another {self._work} is writing it") from None

    def _go_on(self, header: dict, *, resume: bool) -> None:
        """Take over a file that is there, or begin it anew if it is finished."""
        old, intact, damaged = self._read()
        place, setup = shown(self.path), header["setup"]
        other = [name for name in setup if old["setup"].get(name) != setup[name]]
        if not resume:
            holds = self.known or damaged
            if holds and len(self.known) < old["cases"]:
                raise UsageError(
                    f"{place}: holds {len(self.known)} of {old['cases']} cases of a {self._work}"
                    " that was interrupted: go on with --resume, or delete the file"
                )
            if holds and old["digest"] != header["digest"]:
                remedy = "" if other else "go on from them with --resume, "
                raise UsageError(
                    f"{place}: holds the finished cases of another {self._work}: {remedy}choose"
                    " another -o or delete the file"
                )
            self.known.clear()
            self._replace([_to_line(header)])
            return
        if other:
            raise UsageError(
                f"{place}: cannot be resumed, it was made with another {', '.join(other)}:"
                " delete the file, or write elsewhere with -o"
            )
        if damaged:
            warn(f"{place}: {_describe(damaged)} run again")
            self._file.seek(0)
            bad = set(damaged)
            kept = (raw for number, raw in enumerate(self._file, 1) if number not in bad)
            self._replace(raw for raw in kept if raw.endswith(b"\n"))
            self._file.seek(0)
            self._read()  # lines have moved
        else:
            self._file.truncate(intact)  # what was cut off in the middle of a line is done again
            self._file.seek(intact)
        if (old["cases"], old["digest"]) != (header["cases"], header["digest"]):
            self._write(header)

    def _read(self) -> tuple[dict, int, list[int]]:
        """Read all lines; fills `known`.

        Returns:
            The last header, the length up to the last whole line, and the numbers of bad lines.
        """
        header, intact, damaged = None, 0, []
        for number, raw in enumerate(self._file, 1):
            if not raw.endswith(b"\n"):
                break
            line = _parse(raw)
            if line and "setup" in line:
                header = line
            elif found := _read_result(line):
                self.known.note(found[0], intact)
            else:
                damaged.append(number)
            intact += len(raw)
        if header is None:
            raise UsageError(
                f"{shown(self.path)}: line 1 is damaged or was changed, and no other says what the"
                " cases belong to: delete the file, or write elsewhere with -o"
            )
        return header, intact, damaged

    def _replace(self, lines: Iterable[bytes]) -> None:
        """Put a file of these lines into the place of the present one, and go on with that."""
        with writing(self.path, journal_kind(self._work)) as partial:
            file = partial.open("x+b")
            self._lock(file)
            file.writelines(lines)
            file.flush()
            os.fsync(file.fileno())
            if not CAN_REPLACE_OPEN_FILES:
                file.close()
                self._file.close()
        if CAN_REPLACE_OPEN_FILES:
            self._file.close()
        else:
            file = self.path.open("r+b")
            self._lock(file)
            file.seek(0, os.SEEK_END)
        self._file = file

    def _write(self, line: dict) -> int:
        """Append a line; returns where it begins."""
        try:
            place = self._file.tell()
            self._file.write(_to_line(line))
            self._file.flush()
            now = time.monotonic()
            if now - self._synced > _SYNC:
                os.fsync(self._file.fileno())
                self._synced = now
        except OSError as error:
            self._is_broken = True
            raise self._cannot_write(error) from None
        return place

    def _cannot_write(self, error: OSError) -> DockloopError:
        return DockloopError(
            f"{shown(self.path)}: cannot be written ({find_reason(error)}); the same command with"
            " --resume goes on"
        )


def _find_key(values: Any) -> bytes:
    """Return what a case is known by, as long for many values as for few."""
    return hashlib.blake2b(json.dumps(values).encode(), digest_size=12).digest()


def _read_result(line: Any) -> tuple[tuple[Value, ...], Result] | None:
    """Return the values and the result that a line holds; None if it holds none."""
    try:
        values = tuple(line.pop("values"))
        result = Result(**line)
        result.outputs, result.histories = tuple(result.outputs), tuple(result.histories)
    except (AttributeError, KeyError, TypeError):
        return None
    return (values, result) if result.status in STATUSES else None


def _to_line(content: dict) -> bytes:
    """Return a line of the file."""
    said = json.dumps(content).encode()[:-1]
    return said + _SUM + b'%08x"}\n' % zlib.crc32(said)


def _parse(raw: bytes) -> dict | None:
    """Return what a line says, without its checksum; None if that is wrong."""
    said, _, checksum = raw.rstrip().rpartition(_SUM)
    if checksum != b'%08x"}' % zlib.crc32(said):
        return None
    return json.loads(said + b"}")


def _describe(numbers: list[int]) -> str:
    """Say which lines are bad, the first ones of many."""
    if len(numbers) == 1:
        return f"line {numbers[0]} is damaged or was changed: its case is"
    few = ", ".join(map(str, numbers[:10]))
    more = f" and {len(numbers) - 10} more" if len(numbers) > 10 else ""
    return f"lines {few}{more} are damaged or were changed: their cases are"


def make_report(progress: ProgressBar | None) -> Callable[[int, int], None]:
    """Return a function that moves a progress bar to cases done of all: rate, remaining time."""
    began, known = time.monotonic(), -1

    def report(done: int, total: int) -> None:
        nonlocal known
        if known < 0:
            known = done
        rate = (done - known) / max(time.monotonic() - began, 1e-9)
        if progress and rate:
            left_time = datetime.timedelta(seconds=round((total - done) / rate))
            note = f"{done} of {total}, {rate:.2f} per second, {left_time} left"
            progress(done / total, note)

    return report
