"""Watches rows that were dropped because they were redundant at the start.

A row may be dropped as long as it has a part in the self-stress of the mechanism.  Where it
loses that, the rows that were kept depend on each other: λ grows without bound, though the
mechanism itself is as it was.
"""

import numpy as np
import scipy.sparse

from newmark_cli.newmark.march import March
from newmark_cli.problems import singular
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.redundancy import Least, column_norms
from newmark_cli.support.arrays import Array

#: States of a march that are looked at, and steps between two where its end is not known.
_LOOKS, _APART = 200, 50
#: Coordinates up to which all singular values take little time.
_DENSE_UP_TO = 600
#: Least singular value of G, relative to that of the start, below which λ means nothing.
_LOST = 1e-2


class Needed:
    """Looks at the constraints that were kept along a march; see the module.

    Attributes:
        stops: Steps at which it wants to see the march; none where no row was dropped.
        reason: Why the march is to end where it stands; empty as long as it may go on.
    """

    def __init__(self, problem: Problem, last: int | None, done: int = 0) -> None:
        """Compare with the problem's start; ``last`` is the last step, None where nobody knows."""
        self.stops: frozenset[int] = frozenset()
        self.reason = ""
        self._last, self._watches = last, bool(problem.released)
        if not self._watches:
            return
        self._least = Least()
        self._start = self._value(problem, problem.t0, problem.u0)
        if last is not None:
            spread = np.unique(np.round(np.linspace(done, last, _LOOKS + 1)).astype(int))
            self.stops = frozenset(spread[1:].tolist())

    def until(self, done: int, halt: int) -> frozenset[int]:
        """Its stops from a step to another."""
        if self._last is not None or not self._watches:
            return self.stops
        return frozenset(range((done // _APART + 1) * _APART, halt + 1, _APART))

    def sees(self, march: March) -> None:
        """The march stands somewhere."""
        if march.done not in self.until(march.done - 1, march.done):
            return  # at its start, where nothing is lost
        problem = march.problem
        least = self._value(problem, march.t, np.asarray(march.seen.fields[0], float))
        if not least >= _LOST * self._start:
            listed = ", ".join(problem.released)
            self.reason = (
                f"released rows ({listed}) are needed at t = {march.t - problem.t0:.4g}: without "
                f"them the least singular value of G is {least:.2g}, at the start "
                f"{self._start:.2g}; release other rows"
            )

    def _value(self, problem: Problem, t: float, u: Array) -> float:
        """Least singular value of G with columns of length 1."""
        if problem.n > _DENSE_UP_TO:
            pattern = problem.pattern
            g = problem.values(t, u, np.zeros(problem.n), np.zeros(problem.m)).g
            if not np.all(np.isfinite(g)):
                return np.inf
            places, shape = (pattern.g_rows, pattern.g_columns), (problem.n, problem.m)
            gradient = scipy.sparse.csc_array((g, places), shape)
            sizes = column_norms(gradient)
            return self._least.of(scipy.sparse.csc_array(gradient / sizes[None, :]))
        dense = singular.gradient(problem, t, u)
        if not np.all(np.isfinite(dense)):
            return np.inf  # the march itself reports that
        return float(np.linalg.svd(dense, compute_uv=False)[-1])
