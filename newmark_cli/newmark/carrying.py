"""What a march carries over to a step of another size where velocities change, too."""

from functools import cached_property

import numpy as np

from newmark_cli.newmark.integrator import NEW_A, NEW_NU, NEW_V, NEW_W, TRUE_ACCELERATION
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Schemes, contains
from newmark_cli.problems.algebra import product
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

#: Units of rounding within which two numbers say the same.  One step leaves a few; where errors
#: alternate, as with ρ∞ near 1, those of a few steps add up to tens.
_ROUNDING = 100.0
#: Least ratio of a remembered step to one that may be too short: its numbers over h² and h
#: have a thousandth of the rounding.
_SHORTER = 10.0


class Carrying:
    """Scales with the step size what index 3 and auxiliary accelerations leave.

    Index 3 leaves Gᵀv + Φ_t = c h² Gᵀu‴, c being the integrator's, and takes what a step begins
    with for that of its own size: what is left of another size makes λ jump by O(h).  See
    `newmark_cli.newmark.integrator.Integrator.across`.  Generalized-α leaves a − v' = θ h u‴.

    A step of size δ rounds both.  It meets Φ = 0 to ε|u|, so that velocities are off by ε|u|/δ and
    accelerations by ε|u|/(β δ²): over h² and over h, both by ε|u|/δ³.  Scaled to the size of
    ordinary steps this is anything, if δ is short enough.  Of a longer step before it the same
    numbers are remembered.  They have changed by O(h) since then, by which λ is off by O(h²), as
    ever.  So they are taken wherever those of the short step do not differ from them by more than
    its rounding, and likewise the accelerations that u and v imply in place of its v'.
    """

    def __init__(self, problem: Problem, schemes: Schemes) -> None:
        self.problem, self.schemes = problem, schemes

    @cached_property
    def _index_1(self) -> Index1:
        return Index1(self.problem)

    def to(self, step: int, state: State) -> bool:
        """Replace the past by that which a step begins with.

        Returns:
            Whether it was; otherwise the step's own weights do it, `Scheme.carried`.

        Raises:
            numpy.linalg.LinAlgError: When no velocity meets the constraints.
        """
        size, behind = (self.schemes.grid.size(step - k) for k in range(2))
        if size < behind:
            self._remember(step, state)
        elif size > behind and self.schemes.wide and self._takes_remembered(step, state):
            return True
        if not contains(self.schemes.across, step):
            return False
        t = self.schemes.grid.t(step - 1)
        u, v = state.fields[:2].astype(float)
        across, _ = self._index_1.least_change(t, u, self._index_1.rate(t, u, v))
        old = np.concatenate([state.past, state.fields[3:], [across.astype(state.past.dtype)]])
        weights = self.schemes.carried(step)
        carried = product(weights.astype(old.dtype), old)
        self._keep_lost(state, carried[1], weights[1, -1] * across)
        state.past[:] = carried
        return True

    def _keep_lost(self, state: State, velocity: Array, moved: Array) -> None:
        """Carry over what the sum of velocities has lost, too (Knuth's two-sum)."""
        if self.schemes.base.compensated:
            high, low = state.past[1], velocity - state.past[1]
            state.lows[1] += (high - (velocity - low)) + (moved - low)

    def _left(self, step: int, state: State) -> tuple[tuple[Array, Array], ...]:
        """What the step before one leaves, (m,) over h², (n,) over h and v', and their rounding."""
        grid, base, eps = self.schemes.grid, self.schemes.base, np.finfo(state.past.dtype).eps
        behind, before, problem = grid.size(step - 1), grid.size(step - 2), self.problem
        across, t = base.integrator.across(behind, before), grid.t(step - 1)
        u, v, _, true = state.fields.astype(float)
        of_v = eps * float(np.abs(v).max())
        of_u = eps * float(np.abs(u).max())
        of_a = of_u / base.integrator.relations(behind).u_from_a
        g = problem.values(t, u, v, np.zeros(problem.m)).g
        lengths = np.sqrt(np.bincount(problem.pattern.g_columns, g**2, minlength=problem.m))
        auxiliary = state.past[base.relations.advance == NEW_A]
        return (
            (self._index_1.rate(t, u, v) / across, lengths * (of_u / behind + of_v) / across),
            ((auxiliary - true).sum(axis=0) / behind, np.full(problem.n, of_a / behind)),
            (true, np.full(problem.n, of_a)),
        )

    def _remember(self, step: int, state: State) -> None:
        """Remember what the step before one leaves, unless a longer one is known to leave that."""
        behind = self.schemes.grid.size(step - 1)
        remembered = (state.rates, state.offsets)
        for kept, (now, rounding) in zip(remembered, self._left(step, state), strict=False):
            if not (kept[0] > behind and _same(now, kept[1:], rounding)):
                kept[:] = behind, *now

    def _takes_remembered(self, step: int, state: State) -> bool:
        """Begin a step with what is remembered, where the one before it was too short."""
        grid, base, past = self.schemes.grid, self.schemes.base, state.past.astype(float)
        (size, behind, before), t = (grid.size(step - k) for k in range(3)), grid.t(step - 1)
        if not max(state.rates[0], state.offsets[0]) >= _SHORTER * behind:
            return False
        u, v, _, true = state.fields.astype(float)
        rate, offset, of_true = self._left(step, state)
        try:
            implied, _ = self._index_1.accelerations(t, u, v)
        except np.linalg.LinAlgError:
            return False
        by_rate, by_offset = (
            kept[0] >= _SHORTER * behind and _same(now, kept[1:], rounding)
            for kept, (now, rounding) in ((state.rates, rate), (state.offsets, offset))
        )
        by_implied = _same(true, implied, of_true[1])
        becomes = base.relations.advance.tolist()
        by_rate, by_offset = by_rate and base.across, by_offset and TRUE_ACCELERATION in becomes
        if not (by_rate or by_offset or by_implied):
            return False
        moved = across = np.zeros_like(v)
        if base.across:
            over = (state.rates[1:] if by_rate else rate[0]).astype(float)
            wanted = over * base.integrator.across(size, behind)
            now = rate[0] * base.integrator.across(behind, before)
            change = self._index_1.changes(t, u)(np.array([wanted - now, wanted]).T)[0]
            moved, across = change.T
        if by_implied:
            true = implied
        over_h = state.offsets[1:] if by_offset else offset[0]
        for place, what in enumerate(becomes):
            if what == NEW_V:
                past[place] += moved
            elif what == NEW_A:
                past[place] = true + over_h * size
            elif what == TRUE_ACCELERATION:
                past[place] = true
            elif what == NEW_W:
                # Of u(t) − u(t − δ), v being what it should but for what index 3 leaves.
                within = behind * true / 2 - across
                past[place] = behind * within if by_implied else past[place] - behind * moved
            elif what == NEW_NU and by_implied:
                past[place] = behind * true
        carried = past.astype(state.past.dtype)
        self._keep_lost(state, carried[1], moved)
        state.past[:], state.fields[3] = carried, true
        return True


def _same(now: Array, kept: Array, rounding: Array) -> bool:
    """Whether numbers differ by no more than rounding."""
    return bool(np.all(np.abs(now - kept) <= _ROUNDING * rounding))
