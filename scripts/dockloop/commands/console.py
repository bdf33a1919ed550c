"""What a command prints: what it found on standard output, why it fails on standard error."""

import json
import sys
from collections.abc import Callable, Iterable
from typing import Any

from dockloop.base.errors import DockloopError, find_reason, one_line, say
from dockloop.base.sections import Section, write_text
from dockloop.commands.arguments import Options


class ReaderGoneError(Exception):
    """The reader of our output has closed it."""


def write(text: str, end: str = "\n") -> None:
    """Print what a command found; without an `end`, at once, else when the command is done.

    Raises:
        ReaderGoneError: standard output has no reader any more.
        DockloopError: standard output cannot be written.
    """
    try:
        print(text, end=end, flush=not end)
    except BrokenPipeError:
        sys.stdout = None
        raise ReaderGoneError from None
    except OSError as error:
        sys.stdout = None
        raise DockloopError(f"standard output cannot be written ({find_reason(error)})") from None


def write_found(options: Options, found: Any, report: Callable[[Any], Iterable[Section]]) -> None:
    """Print what a command found: as JSON if the user wants that, else its report."""
    write(json.dumps(found, indent=2) if options.json else write_text(report(found)))


def write_failure(text: str) -> None:
    """Say in one line why a command fails."""
    say(one_line(f"dockloop: {text}"))
