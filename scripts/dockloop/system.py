"""What Linux, macOS and Windows do differently: the number of processors."""

import os
import sys


def count_processors() -> int:
    """Return how many processors this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
