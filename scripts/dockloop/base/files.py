"""Files that commands write: a foreign one is never replaced, and none is left half written.

A command names every file that it will write before it works (`claim`), and writes each through
`writing`: under another name in the same folder, then renamed. A file that is there already must
have been made by the same command. The sign of this is in the file, never its name alone:

| file | made by the command if |
|---|---|
| summary, solution, journal | it begins with the JSON member ``made_by`` that names the command |
| figure | the text ``Software`` of the PNG names the command |
| result of a run | its columns are ``time`` and outputs that our FMUs can have, no others |
| table | its metadata or header has the columns that all of them have |
| page in Markdown | it begins with the title of all of them |
| page in HTML, drawing, film | a comment in it names the command |
| FMU, SSP package | it holds a scene of this program; all FMUs in a package do |
| document of a scene | it is such a scene |

An empty file is foreign, too. Whatever lies in the folder ``build/`` of a clone is its own, also if
an older version wrote it. `Kind` says it for one kind of file; kinds stand next to what
writes them. Temporary folders are here as well (`scratch`): a full disk is reported by its name.
"""

import csv
import errno
import json
import os
import secrets
import stat
import struct
import tempfile
import tomllib
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from dockloop.base import paths
from dockloop.base.errors import (
    FULL,
    DockloopError,
    UsageError,
    check_current_folder,
    find_reason,
)
from dockloop.base.paths import SCRATCH, shown
from dockloop.base.schema import known_members, load_schema

MADE_BY = "made_by"  # first member of every JSON document that a command writes
_HEAD = 1 << 20  # bytes of a file that are looked at
_PNG = b"\x89PNG\r\n\x1a\n"
_BEGINNINGS = {_PNG: "a figure of something else", b"PK": "a zip file", b"PAR1": "a table"}


class Kind(NamedTuple):
    """A kind of file that a command writes.

    Attributes:
        what: what it is, for messages: ``figure``.
        command: what makes it: ``dockloop run``.
        is_own: returns whether a file is one; may raise, which means no.
    """

    what: str
    command: str
    is_own: Callable[[Path], bool]


def json_kind(what: str, command: str) -> Kind:
    """Return the kind of a JSON document, or of JSON lines, that begins with its command."""
    begin = json.dumps({MADE_BY: command})[:-1]

    def is_own(path: Path) -> bool:
        head = read_head(path)[: 2 * len(begin)].decode(errors="replace")
        return "".join(head.split()).startswith("".join(begin.split()))

    return Kind(what, command, is_own)


def table_kind(what: str, command: str, begin: str, *columns: str) -> Kind:
    """Return the kind of a text whose first line begins with `begin` and has `columns` in it."""

    def is_own(path: Path) -> bool:
        line = read_head(path).decode(errors="replace").partition("\n")[0]
        return line.startswith(begin) and all(text in line for text in columns)

    return Kind(what, command, is_own)


def figure_kind(command: str) -> Kind:
    """Return the kind of a PNG file with the text ``Software`` that names the command."""

    def is_own(path: Path) -> bool:
        return b"Software\0" + command.encode() in _find_texts(read_head(path))

    return Kind("figure", command, is_own)


def read_head(path: Path) -> bytes:
    """Return the beginning of a file."""
    with path.open("rb") as file:
        return file.read(_HEAD)


def read_entry(path: Path | BinaryIO, name: str) -> bytes:
    """Return one entry of a zip file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no such zip file; the text says why.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.read(name)
    except KeyError:
        raise ValueError(f"no {name}") from None
    except OSError:
        raise
    except zipfile.BadZipFile:
        if zipfile.is_zipfile(path):
            raise ValueError(f"{name} in it is damaged") from None
        raise ValueError("not a zip file") from None
    except Exception as error:  # noqa: BLE001  packed otherwise, encrypted, damaged: a dozen kinds
        raise ValueError(f"{name} in it cannot be unpacked ({error})") from None


def check_suffix(path: Path, suffix: str) -> None:
    """Check how the name of a file ends that the user has chosen. Raises UsageError."""
    if path.suffix != suffix:
        raise UsageError(f"-o {shown(path)}: must end in {suffix}")


def claim(path: Path, kind: Kind, option: str = "-o") -> None:
    """Make sure, before any work, that a file can be written at its end.

    Args:
        path: the file.
        kind: what will be written there.
        option: names the file, for the message.

    Raises:
        UsageError: there is a file of another kind or command, a folder, or no way to write.
    """
    place, other = shown(path), f"choose another {option}"
    if "\0" in str(path):
        raise UsageError(f"{place}: no file can have this name: {other}")
    if not path.is_absolute():
        check_current_folder()
    real = Path(os.path.realpath(path))  # a link stays what it is, its file is replaced
    try:
        mode = real.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        _probe(real.parent, path, other)
        return
    except OSError as error:
        raise UsageError(f"{place}: cannot be written ({find_reason(error)}): {other}") from None
    if stat.S_ISDIR(mode):
        raise UsageError(f"{place}: is a folder, so no {kind.what} can have that name: {other}")
    if not stat.S_ISREG(mode):
        raise UsageError(f"{place}: is no ordinary file: {other}")
    is_built = not paths.IS_INSTALLED and real.is_relative_to(os.path.realpath(paths.BUILD))
    if not (is_built or _is_own(real, kind)):
        raise UsageError(
            f"{place}: is {_describe(real)}, which '{kind.command}' did not write: {other}"
        )
    if not os.access(real, os.W_OK):
        raise UsageError(f"{place}: is write-protected: {other}")
    _probe(real.parent, path, other)


@contextmanager
def writing(path: Path, kind: Kind) -> Iterator[Path]:
    """Yield the file to write instead of `path`; it gets that name when all of it is there.

    Args:
        path: the file.
        kind: what is written.

    Raises:
        UsageError: like `claim`, for what came there meanwhile.
        DockloopError: it cannot be written.
    """
    claim(path, kind)
    real = Path(os.path.realpath(path))
    partial = real.with_name(f".dockloop-{secrets.token_hex(6)}.partial")
    try:
        try:
            real.parent.mkdir(parents=True, exist_ok=True)
            yield partial
            partial.replace(real)
        except OSError as error:
            raise cannot_write(path, error) from None
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def plain(value: Any) -> str:
    """Return a measured value for a CSV table: six digits, nothing for what is not known."""
    if value is None or value != value:  # noqa: PLR0124  NaN
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def write_csv(path: Path, kind: Kind, columns: Sequence[str], rows: Iterable[Iterable]) -> None:
    """Write a table, columns separated by commas. Raises like `writing`."""
    with writing(path, kind) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(columns)
        table.writerows(rows)


def write_text(path: Path, kind: Kind, text: str) -> None:
    """Write a text. Raises like `writing`."""
    with writing(path, kind) as partial:
        partial.write_text(text, encoding="utf-8", errors="backslashreplace")


def cannot_write(path: Path, error: OSError) -> DockloopError:
    """Return the error for a file that cannot be written."""
    folder = next((folder for folder in tuple(SCRATCH) if path.is_relative_to(folder)), None)
    if error.errno in FULL and folder:
        return _no_space(folder)
    return DockloopError(f"{shown(path)}: cannot be written ({find_reason(error)})")


@contextmanager
def scratch(parent: str | None = None) -> Iterator[Path]:
    """Yield a temporary folder that is removed afterwards.

    Args:
        parent: where it is made; default: where the system has them.

    Raises:
        DockloopError: it cannot be made, or a file in it cannot be written.
    """
    try:
        folder = tempfile.TemporaryDirectory(
            prefix="dockloop-", dir=parent, ignore_cleanup_errors=True
        )
    except OSError as error:
        raise DockloopError(
            f"no temporary folder can be made ({find_reason(error)}): let TMPDIR name one"
        ) from None
    with folder as name, filling(Path(name)):
        SCRATCH.add(Path(name))
        try:
            yield Path(name)
        finally:
            SCRATCH.discard(Path(name))


@contextmanager
def filling(folder: Path) -> Iterator[None]:
    """Say which disk is full when what is written to a temporary folder finds no space."""
    try:
        yield
    except OSError as error:
        place = Path(str(error.filename or folder))  # what fails in the middle has no name
        if error.errno not in FULL or not place.is_relative_to(folder):
            raise
        raise _no_space(folder) from None


def _no_space(folder: Path) -> DockloopError:
    """Return the error for a temporary folder on a full disk."""
    return DockloopError(
        f"no space is left in {folder.parent} for temporary files: free some, or let TMPDIR name"
        " another folder"
    )


def _is_own(path: Path, kind: Kind) -> bool:
    try:
        return kind.is_own(path)
    except Exception:  # noqa: BLE001  what cannot be read as such a file is none
        return False


def _probe(folder: Path, path: Path, other: str) -> None:
    """Check that a file can be made in a folder, or in the one in which that would be made."""
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    try:
        if not folder.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{shown(folder)} is no folder")
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise UsageError(
            f"{shown(path)}: cannot be written ({find_reason(error)}): {other}"
        ) from None


def _describe(path: Path) -> str:
    """Say what a file is that a command did not make, for messages."""
    try:
        head = read_head(path)
    except OSError as error:
        return f"a file that cannot be read ({find_reason(error)})"
    for begin, what in _BEGINNINGS.items():
        if head.startswith(begin):
            return what
    text = head.decode(errors="replace")
    with suppress(ValueError, RecursionError):
        return _describe_members(json.loads(text.partition("\n")[0] if _is_lines(text) else text))
    if not text:
        return "an empty file"
    with suppress(ValueError, RecursionError):
        members = tomllib.loads(text)
        return (
            "a scene" if "chaser" in members else "a sweep" if "vary" in members else "a TOML file"
        )
    return "a file of something else"


def _is_lines(text: str) -> bool:
    """Return whether a text looks like JSON lines: its first line is a whole object."""
    first = text.partition("\n")[0].strip()
    return first.startswith("{") and first.endswith("}")


def _describe_members(content: object) -> str:
    """Say what a JSON document is."""
    members = content if isinstance(content, dict) else {}
    if isinstance(members.get(MADE_BY), str):
        return f"a file of '{members[MADE_BY]}'"
    if {"setup", "cases"} <= members.keys():
        return "a journal of another dockloop"
    inner = members.get("mechanism", members)
    if isinstance(inner, dict) and inner and inner.keys() <= _list_mechanism_members():
        return "a mechanism"
    return "a JSON file of something else"


def _list_mechanism_members() -> set[str]:
    root = load_schema("mechanism")
    return set(known_members(root, root))


def _find_texts(head: bytes) -> set[bytes]:
    """Return the texts (``keyword NUL text``) of a PNG file before its pixels."""
    texts, place = set(), len(_PNG)
    while head.startswith(_PNG) and place + 8 <= len(head):
        length, name = struct.unpack(">I4s", head[place : place + 8])
        if name == b"IDAT":
            break
        if name == b"tEXt":
            texts.add(head[place + 8 : place + 8 + length])
        place += length + 12
    return texts
