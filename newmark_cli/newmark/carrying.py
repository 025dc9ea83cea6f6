"""What a march carries over to a step of another size where velocities change, too."""

from functools import cached_property

import numpy as np

from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Schemes
from newmark_cli.problems.algebra import product
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem


class Carrying:
    """Scales velocities across the constraints with the step size.

    Index 3 leaves Gᵀv + Φ_t = c h² Gᵀu‴, c being the integrator's, and takes what a step begins
    with for that of its own size: what is left of another size makes λ jump by O(h).  See
    `newmark_cli.newmark.integrator.Integrator.across`.
    """

    def __init__(self, problem: Problem, schemes: Schemes) -> None:
        self.problem, self.schemes = problem, schemes

    @cached_property
    def _index_1(self) -> Index1:
        return Index1(self.problem)

    def to(self, step: int, state: State) -> None:
        """Replace the past by that which a step begins with.

        Raises:
            numpy.linalg.LinAlgError: When no velocity meets the constraints.
        """
        t = self.schemes.grid.t(step - 1)
        u, v = state.fields[:2].astype(float)
        across, _ = self._index_1.least_change(t, u, self._index_1.rate(t, u, v))
        old = np.concatenate([state.past, state.fields[3:], [across.astype(state.past.dtype)]])
        weights = self.schemes.carried(step)
        carried = product(weights.astype(old.dtype), old)
        if self.schemes.base.compensated:
            # What the sum has lost is carried, too (Knuth's two-sum).
            high, low = state.past[1], carried[1] - state.past[1]
            moved = weights[1, -1] * across
            state.lows[1] += (high - (carried[1] - low)) + (moved - low)
        state.past[:] = carried
