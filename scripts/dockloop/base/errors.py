"""The two ways in which a command fails, how it says so, and the help that a misspelt name gets."""

import atexit
import difflib
import errno
import functools
import inspect
import os
import re
import reprlib
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin

FULL = (errno.ENOSPC, errno.EDQUOT)  # errors of a disk that has no space left
_OPTION = re.compile(r"(?<!\S)-(o\b|-[a-z][a-z-]*)")
_ARGUMENTS = {  # of Python functions that have another name than the option
    "-check": "checks",
    "-criterion": "criteria",
    "-filter": "filters",
    "-map": "names",
    "-offset": "offsets",
    "-rate-limit": "rate_limits",
    "-scale": "scales",
    "-scene": "overrides",
    "-set": "start_values",
    "o": "output",
}


def _is_group(value: Any) -> bool:
    return isinstance(value, Mapping) and all(isinstance(name, str) for name in value)


def _is_list(value: Any) -> bool:
    """Return whether a value has entries: a list, an array, a column of a table."""
    return hasattr(value, "__len__") and not isinstance(value, str | bytes | Mapping)


_KINDS: dict[Any, tuple[Callable[[Any], bool], str]] = {  # of an annotation: what it is, in words
    str: (lambda value: isinstance(value, str), "a text"),
    Path: (lambda value: isinstance(value, os.PathLike), "a path"),
    bool: (lambda value: type(value).__name__ in ("bool", "bool_"), "true or false"),
    Mapping: (_is_group, "a group of names with values"),
    dict: (
        lambda value: isinstance(value, dict) and _is_group(value),
        "a group of names with values",
    ),
    **dict.fromkeys((Sequence, list, tuple), (_is_list, "a list")),
    Callable: (callable, "a function"),
    type(None): (lambda value: value is None, ""),
}
_TEXTS = (
    lambda value: _is_list(value) and all(isinstance(v, str) for v in value),
    "a list of texts",
)
_names_options = ContextVar("_names_options", default=False)  # else: arguments of functions
P = ParamSpec("P")
R = TypeVar("R")


class DockloopError(Exception):
    """The work failed. The text is one sentence for people."""

    exit_status = 1


class UsageError(DockloopError):
    """Bad usage or a bad file: the text names the file, the member and the limit."""

    exit_status = 2


def find_twice(names: Sequence[str]) -> str | None:
    """Return the first name that stands twice; None: all are different."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Suggest the known names nearest to a misspelt one.

    Args:
        word: what was written.
        known: what could have been meant; names that differ in a letter come first, then names
            that begin with the word and have one more part (``friction``:
            ``friction.coefficient``), then names with it as a part.

    Returns:
        `` (did you mean 'a' or 'b'?)`` with a leading blank, or an empty string.
    """
    names = list(dict.fromkeys(known))
    longer = [name for name in names if name.startswith(f"{word}.")]
    longer = longer or [name for name in names if word in re.split(r"[._]", name)]
    close = [difflib.get_close_matches(word, names, 3, least) for least in (0.9, 0.6)]
    near = list(dict.fromkeys([*close[0], *longer, *close[1]]))[:3]
    return f" (did you mean {' or '.join(repr(name) for name in near)}?)" if near else ""


def say_value(value: Any) -> str:
    """Return a value of Python for a message: short, and on one line."""
    try:
        return " ".join(reprlib.repr(value).split())
    except ValueError:  # a whole number with more digits than Python writes
        return f"of type {type(value).__name__}"


def _check_kind(name: str, annotation: Any, value: Any) -> None:
    """Refuse an argument of another kind; what takes numbers says by itself what these must be."""
    is_union = get_origin(annotation) in (Union, UnionType)
    parts = get_args(annotation) if is_union else (annotation,)
    if any((get_origin(part) or part) not in _KINDS for part in parts):
        return
    kinds = [
        _TEXTS if part == Sequence[str] else _KINDS[get_origin(part) or part] for part in parts
    ]
    if any(is_of_kind(value) for is_of_kind, _ in kinds):
        return
    words = " or ".join(text for _, text in kinds if text)
    words = "the path of a file" if words == "a text or a path" else words
    raise UsageError(f"{name} is {say_value(value)}: must be {words}")


def names_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Let a Python function check the kinds of its arguments, and name these in its messages.

    In commands they name options: ``--stop``, not ``stop`` (`naming_options`).
    """
    signature = inspect.signature(function)
    known = signature.parameters

    def rename(option: re.Match) -> str:
        name = _ARGUMENTS.get(option[1], option[1][1:].replace("-", "_"))
        return name if name in known else option[0]

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            _check_kind(name, known[name].annotation, value)
        try:
            return function(*args, **kwargs)
        except DockloopError as error:
            if _names_options.get():
                raise
            raise type(error)(_OPTION.sub(rename, str(error))) from None
        except OSError as error:
            raise explain(error) from error

    return call


@contextmanager
def naming_options() -> Iterator[None]:
    """Let messages name options whatever function of Python a command calls."""
    before = _names_options.set(True)
    try:
        yield
    except DockloopError as error:
        raise type(error)(re.sub(r"^Docking\.set:", "--set:", str(error))) from None
    finally:
        _names_options.reset(before)


def find_reason(error: OSError) -> str:
    """Return why the system refused something, without the name of the file."""
    return "no space is left on the disk" if error.errno in FULL else error.strerror or str(error)


def check_current_folder() -> None:
    """Refuse a current folder that was removed. Raises UsageError."""
    try:
        Path.cwd()
    except OSError:
        wrong = "the current folder is not there any more: change to another folder"
        raise UsageError(wrong) from None


def explain(error: OSError) -> DockloopError:
    """Return the error of this package for what the system refused: file, reason and remedy."""
    try:
        check_current_folder()
    except UsageError as gone:  # whatever needed it: the system names no file
        return gone
    where = f"{error.filename}: " if error.filename else ""
    return DockloopError(f"{where}{find_reason(error)}")


def one_line(text: str) -> str:
    """Return a text on one line; what cannot be printed, in names of others, is escaped."""
    escaped = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return "".join(escaped)


def without_function(text: str) -> str:
    """Return a sentence of the FMU without the C function that it begins with."""
    return re.sub(r"^fmi2[A-Za-z]+: ", "", text)


def warn(text: str) -> None:
    """Say in one line on standard error what a command goes on in spite of."""
    say(one_line(f"dockloop: warning: {text}"))


warn_once = functools.cache(warn)


_GIVEN_UP: list[Any] = []  # streams that took no text


def _takes_text() -> bool:
    """Return whether there is a standard error, and it has not failed."""
    return sys.stderr is not None and all(sys.stderr is not stream for stream in _GIVEN_UP)


def say(text: str, end: str = "\n") -> None:
    """Write to standard error; no work ends because that is closed, full or without a reader.

    A stream that takes nothing stays what it is for all others; this package leaves it alone.
    """
    if _takes_text():
        try:
            print(text, end=end, file=sys.stderr, flush=True)
        except (OSError, ValueError):  # ValueError: Python has closed it
            _GIVEN_UP.append(sys.stderr)


@atexit.register
def _forget_rest() -> None:
    """Let what is left in such a stream not change the exit status of the process."""
    if not _takes_text():
        sys.stderr = None


def is_watched() -> bool:
    """Return whether standard error is a terminal."""
    is_closed = getattr(sys.stderr, "closed", False)
    return _takes_text() and not is_closed and sys.stderr.isatty()
