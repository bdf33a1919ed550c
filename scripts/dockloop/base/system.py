"""Locks of files, processors, signals: what Linux, macOS and Windows do differently."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, Any

_FAR = 1 << 40  # bytes: Windows locks a place of a file, where no program can read then
CAN_REPLACE_OPEN_FILES = sys.platform != "win32"

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
def interrupting_later() -> Iterator[Callable[[], None]]:
    """Let Ctrl-C and requests to end wait while C code calls back, where exceptions are lost.

    Yields:
        A function that interrupts if that was asked for meanwhile. So does the end.
    """
    numbers = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]
    is_main = threading.current_thread() is threading.main_thread()
    raising = [n for n in numbers if is_main and signal.getsignal(n) is signal.default_int_handler]
    asked: list[tuple[Any, ...]] = []

    def interrupt() -> None:
        if asked:
            about = asked[-1]
            asked.clear()
            signal.default_int_handler(*about)

    for number in raising:
        signal.signal(number, lambda *about: asked.append(about))
    try:
        yield interrupt
    finally:
        for number in raising:
            signal.signal(number, signal.default_int_handler)
        interrupt()
