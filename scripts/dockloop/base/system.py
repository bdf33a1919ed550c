"""What Linux, macOS and Windows do differently: locks of files, the number of processors."""

import os
import sys
from typing import IO

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
