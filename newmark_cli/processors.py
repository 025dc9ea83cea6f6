"""How many processors this process may use."""

import math
import os
from collections.abc import Iterator
from pathlib import Path


def usable(root: Path = Path("/")) -> int:
    """Processors that this process may use, at least 1.

    Those that it may run on (its affinity), or fewer where a control group limits its
    time: a container that may use 150 % of a processor keeps two of them busy.

    Args:
        root: Where ``proc`` and ``sys`` are.
    """
    try:
        count = len(os.sched_getaffinity(0))
    except (AttributeError, OSError):  # not on Linux
        count = os.cpu_count() or 1
    return min([count, *map(math.ceil, _quotas(root))])


def _quotas(root: Path) -> Iterator[float]:
    """Limits of the process's control groups and of all above them, in processors."""
    try:
        lines = (root / "proc/self/cgroup").read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return
    mounted = root / "sys/fs/cgroup"
    for line in lines:
        _, controllers, path = [*line.split(":", 2), "", ""][:3]
        if not controllers:
            folders, limit = (mounted, mounted / "unified"), _quota_2
        elif "cpu" in controllers.split(","):
            folders, limit = (mounted / controllers, mounted / "cpu"), _quota_1
        else:
            continue
        # In a container the path may be that of the host; the container's group is the
        # mounted folder itself then.
        group = Path(path.lstrip("/"))
        for folder in folders:
            for part in (group, *group.parents):
                found = limit(folder / part)
                if found is not None:
                    yield found


def _quota_2(group: Path) -> float | None:
    """Of a group of version 2: ``max`` or microseconds, in a period of microseconds."""
    quota, _, period = _text(group / "cpu.max").partition(" ")
    return _ratio(quota, period)


def _quota_1(group: Path) -> float | None:
    """Of a group of version 1: microseconds or -1, in a period of microseconds."""
    return _ratio(_text(group / "cpu.cfs_quota_us"), _text(group / "cpu.cfs_period_us"))


def _ratio(quota: str, period: str) -> float | None:
    if not (quota.isdecimal() and period.isdecimal() and int(quota) and int(period)):
        return None
    return int(quota) / int(period)


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
