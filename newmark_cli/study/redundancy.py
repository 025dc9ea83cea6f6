"""Watches rows that were dropped because they were redundant at the start."""

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.newmark.march import March
from newmark_cli.problems import singular
from newmark_cli.problems.problem import Problem
from newmark_cli.study.measures import Observer

#: States of a march that are looked at, and coordinates up to which that takes little time.
_LOOKS, _LARGEST = 200, 600
#: Least singular value of G, relative to that of the start, below which λ means nothing.
_LOST = 1e-2
#: Status of a cell that was ended.
REDUNDANT = "redundant"


class Watch(Observer):
    """Looks at the constraints that were kept along a march.

    A row may be dropped as long as it has a part in the self-stress of the mechanism.
    Where it loses that, the rows that were kept depend on each other: λ grows without bound,
    though the mechanism itself is as it was.

    It has no stops where no row was dropped.
    """

    def __init__(self, problem: Problem, steps: int) -> None:
        if problem.released and problem.n <= _LARGEST:
            spread = np.unique(np.round(np.linspace(0, steps, _LOOKS + 1)).astype(int))
            self.stops = frozenset(spread[1:].tolist())
            self._start = _least(problem, problem.t0, problem.u0)

    def sees(self, march: March) -> None:
        """The march stands at one of the stops."""
        if march.done not in self.stops:
            return  # at its start, where nothing is lost
        problem = march.problem
        least = _least(problem, march.t, np.asarray(march.seen.fields[0], float))
        if not least >= _LOST * self._start:
            listed = ", ".join(problem.released)
            self.reason = (
                f"released rows ({listed}) are needed at t = {march.t - problem.t0:.4g}: without "
                f"them the least singular value of G is {least:.2g}, at the start "
                f"{self._start:.2g}; release other rows"
            )


def _least(problem: Problem, t: float, u: Array) -> float:
    gradient = singular.gradient(problem, t, u)
    if not np.all(np.isfinite(gradient)):
        return np.inf  # the march tells what happens there
    return float(np.linalg.svd(gradient, compute_uv=False)[-1])
