"""Which steps of a march are kept, and what of them; imports nothing that marches."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.steps import TimeGrid

#: What a trajectory may keep, as `keep` names it.
KEPT = (*FIELDS, "lambda")
#: What follows from u and v, where the problem has it.
ENERGY = "energy"
#: What the problem has names for besides: angular velocities, reactions, places of points.
OUTPUT = "output"
#: How far the constraints and their rate are missed.
DRIFT = "drift"
#: All of these.
KEEPABLE = (*KEPT, ENERGY, OUTPUT, DRIFT)


@dataclass(frozen=True)
class Kept:
    """Values that a study keeps of a march."""

    every: int = 1  #: the start, every so many steps, and the last
    at: tuple[float, ...] = ()  #: the steps nearest to these times (s) instead, if there are any
    keep: tuple[str, ...] = (*KEPT, ENERGY, OUTPUT)  #: some of `KEEPABLE`

    def looks(self, grid: TimeGrid, last: int) -> Sequence[int]:
        """Steps that are kept of a march, ascending; as a range where they may be many.

        The last of ``every`` is left out unless it is one of them, since nobody knows
        whether the march will come so far.
        """
        if self.at:
            steps: list[int] = grid.nearest(np.array(self.at), 0, last).tolist()
            return steps
        return range(0, last + 1, self.every)

    def outside(self, grid: TimeGrid, last: int) -> float | None:
        """The first of the times that the march does not come to; None if it does to all."""
        return first_outside(self.at, grid.t0, grid.t(last), grid.h)


def first_outside(times: Sequence[float], begin: float, end: float, h: float) -> float | None:
    """The first time that is not between two others, but for rounding; None if all are."""
    slack = 1e-6 * h
    return next((t for t in times if not begin - slack <= t <= end + slack), None)
