"""How many processors this process may use."""

import os


def usable() -> int:
    """Processors that this process may run on, at least 1."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on Linux
        return os.cpu_count() or 1
