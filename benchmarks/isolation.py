"""What it costs that every cell of a plain-Python problem has a process of its own.

    python benchmarks/isolation.py [ROUNDS]

Runs the 24 cells of a study of a pendulum and of a double pendulum in plain Python in
processes that cells share, and each in one of its own, in turn; prints both times, with
the start of the processes, and their ratio.  Exits with 1 when the median is above 1.5,
or when the two do not find the same numbers.
"""

import statistics
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from newmark_cli.mechanisms.spec import pinned
from newmark_cli.running import executors
from newmark_cli.study import config
from newmark_cli.support import apart
from newmark_cli.support.processors import usable

MOST = 1.5
PROBLEM = """\
import numpy as np
from newmark_cli.problems.python_problem import Definition


def chain(links):
    n = 2 * links

    def vectors(u):
        return np.diff(np.vstack([np.zeros(2), u.reshape(links, 2)]), axis=0)

    def constraints(u, t):
        return (np.sum(vectors(u) ** 2, axis=1) - 1) / 2

    def gradient(u, t):
        found = np.zeros((n, links))
        for k, vector in enumerate(vectors(u)):
            found[2 * k : 2 * k + 2, k] = vector
            if k:
                found[2 * k - 2 : 2 * k, k] = -vector
        return found

    weight = np.tile([0.0, -1.0], links)
    u0 = np.column_stack([np.arange(1.0, links + 1), np.zeros(links)]).ravel()
    return Definition(
        np.eye(n), u0, np.zeros(n), lambda u, v, t: weight, constraints, gradient, quadratic=True
    )
"""
STUDY = """\
study: plain
problem:
  - {python: "plain.py:chain", args: {links: 1}}
  - {python: "plain.py:chain", args: {links: 2}}
form: [u-lambda, v-lambda, a-lambda]
preconditioning: [none, optimal]
h: [2e-2, 1e-2]
t_end: 1.0
"""


def shared(tasks, jobs):
    """Outcomes from processes that take one cell after the other."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_be_own) as pool:
        futures = {name: pool.submit(executors.perform, task) for name, task in tasks.items()}
        return {name: future.result().outcome for name, future in futures.items()}


def _be_own():
    """Load problems here, as in `newmark_cli.support.apart`."""
    apart._inside = True


def isolated(tasks, jobs):
    """Outcomes from processes of their own, forks of a server."""
    with executors.local(tasks, jobs, None, lambda steps: None) as finished:
        return {name: done.outcome for name, done in finished}


def timed(run, *arguments):
    """What a function returns, and the time that it takes (s)."""
    begin = time.perf_counter()
    found = run(*arguments)
    return found, time.perf_counter() - begin


def main():
    """Print times and ratios."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    jobs = usable()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "plain.py").write_text(PROBLEM)
        (Path(folder) / "plain.yaml").write_text(STUDY)
        cells = config.load(Path(folder) / "plain.yaml", allow_code=True).cells()
        tasks = {i: executors.Task(cell) for i, cell in enumerate(cells)}
        sent = {i: task.of(pinned(task.cell.problem)) for i, task in tasks.items()}
        print(f"{len(tasks)} cells, {jobs} processes at a time")
        ratios, same = [], True
        for _ in range(rounds):
            one, before = timed(shared, sent, jobs)
            other, now = timed(isolated, tasks, jobs)
            same = same and all(repr(one[name]) == repr(other[name]) for name in tasks)
            ratios.append(now / before)
            print(f"shared {before:.2f} s, each its own {now:.2f} s: ratio {ratios[-1]:.2f}")
    median = statistics.median(ratios)
    print(f"median {median:.2f}, {'the same' if same else 'other'} numbers")
    return 0 if median <= MOST and same else 1


if __name__ == "__main__":
    sys.exit(main())
