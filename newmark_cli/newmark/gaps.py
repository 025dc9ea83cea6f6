"""Watches rows that were released as redundant: on the right motion they stay closed.

Where such a row is needed, the others depend on each other, and a march may leave on a motion
that only they allow.
"""

import numpy as np

from newmark_cli.newmark.march import March
from newmark_cli.problems.problem import Problem

#: States of a march that are looked at, and steps between two where its end is not known.
_LOOKS, _APART = 200, 50
#: Gap of a released row, in parts of the mechanism's size, that is none of rounding, and how far
#: it is above those of the rows that were kept: a march of their derivatives drifts.
_OPEN, _DRIFT = 1e-3, 10.0


class GapWatch:
    """Looks at released rows along a march; see the module.

    Attributes:
        stops: Steps at which it wants to see the march; none where no row was released.
        reason: Why the march is to end where it stands; empty as long as it may go on.
    """

    def __init__(self, problem: Problem, last: int | None, done: int = 0) -> None:
        """``last`` is the last step of the march, None where nobody knows."""
        self.stops: frozenset[int] = frozenset()
        self.reason, self._endless = "", last is None and problem.gaps is not None
        if last is not None and problem.gaps is not None:
            spread = np.unique(np.round(np.linspace(done, last, _LOOKS + 1)).astype(int))
            self.stops = frozenset(spread[1:].tolist())

    def until(self, done: int, halt: int) -> frozenset[int]:
        """Its stops from a step to another."""
        if not self._endless:
            return self.stops
        return frozenset(range((done // _APART + 1) * _APART, halt + 1, _APART))

    def sees(self, march: March) -> None:
        """The march stands somewhere."""
        problem = march.problem
        if problem.gaps is None or march.done not in self.until(march.done - 1, march.done):
            return
        gap, row, drift = problem.gaps(march.t, np.asarray(march.seen.fields[0], float))
        if gap > max(_OPEN, _DRIFT * drift):
            self.reason = (
                f"released rows ({', '.join(problem.released)}) are needed at t = "
                f"{march.t - problem.t0:.4g}: {row} is open by {gap:.2g} of the mechanism's size; "
                "release other rows"
            )
