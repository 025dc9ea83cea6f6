"""Andrews' study on one thread and on two, in turn; the ratio of their times.

    python benchmarks/jobs.py [ROUNDS]

Exits with 1 when two threads are not 1.6 times as fast: on two free processors.
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

from newmark_cli.running.runner import Options, run_studies
from newmark_cli.study import config

LEAST = 1.6


def seconds(jobs):
    """Time of one run from nothing."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        (done,) = run_studies([config.load_shipped("andrews-u")], Path(folder), Options(jobs))
        assert done.ok
        return time.perf_counter() - begin


def main():
    """Print the ratios."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    seconds(2)  # compiles
    ratios = []
    for _ in range(rounds):
        one, two = seconds(1), seconds(2)
        ratios.append(one / two)
        print(f"one thread {one:.2f} s, two {two:.2f} s: {ratios[-1]:.2f} times as fast")
    median = statistics.median(ratios)
    print(f"median {median:.2f}")
    return 0 if median >= LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
