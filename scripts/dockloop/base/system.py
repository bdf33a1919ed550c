"""Locks of files, processors, signals: what Linux, macOS and Windows do differently."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import IO, Any

_FAR = 1 << 40  # bytes: Windows locks a place of a file, where no program can read then
CAN_REPLACE_OPEN_FILES = sys.platform != "win32"

ENDING = ("SIGTERM", "SIGHUP")  # a request to end, a terminal that goes
LANES = (1,)  # cases that a core can compute at once
ENGINES = ("auto", "core", "fmu")  # that run the cases of a sweep


def lock(file: IO) -> None:
    """Lock an open file, until it is closed. Raises OSError: another program has locked it."""
    if sys.platform == "win32":
        import msvcrt

        place = os.lseek(file.fileno(), 0, os.SEEK_CUR)
        os.lseek(file.fileno(), _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        finally:
            os.lseek(file.fileno(), place, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def count_processors() -> int:
    """Return how many processors this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def handling(names: Sequence[str], present: Any, handler: Any) -> Iterator[None]:
    """Let signals that `present` handles be handled by `handler`; Python allows the main thread."""
    is_main = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name) for name in names if is_main and hasattr(signal, name)]
    taken = [number for number in numbers if signal.getsignal(number) is present]
    for number in taken:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, present)


@contextmanager
def interrupting_later() -> Iterator[Callable[[], None]]:
    """Let Ctrl-C and requests to end wait while C code calls back, where exceptions are lost.

    Yields:
        A function that interrupts if that was asked for meanwhile. So does the end.
    """
    asked: list[tuple[Any, ...]] = []

    def interrupt() -> None:
        if asked:
            about = asked[-1]
            asked.clear()
            signal.default_int_handler(*about)

    def wait(*about: Any) -> None:
        asked.append(about)

    try:
        with handling((*ENDING, "SIGINT"), signal.default_int_handler, wait):
            yield interrupt
    finally:
        interrupt()
