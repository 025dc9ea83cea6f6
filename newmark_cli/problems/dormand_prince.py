"""The explicit method of Dormand and Prince, of order 8, with its step size controlled.

SciPy has it too, whose coefficients these are, but sums by BLAS: its last bits are those of
one processor.
"""

import math
from collections.abc import Callable

import numpy as np

from newmark_cli.problems.algebra import norm, product
from newmark_cli.support.arrays import Array

#: How much a step may shrink and grow, and the part of the best size that is taken.
_LEAST, _MOST, _SAFETY = 0.2, 10.0, 0.9


class StepVanishes(Exception):
    """No step size satisfies the tolerance."""


class DormandPrince:
    """y' = f(t, y) from one time to another, step by step.

    The local error is estimated from formulas of order 5 and 3 (E. Hairer, S. P. Nørsett and
    G. Wanner, *Solving Ordinary Differential Equations I*, 1993, Section II.10).

    Attributes:
        t: Time (s) that was reached.
        y: (k,) the state there.
        size: The step size (s) that is tried next.
        taken: The size of the last step (s).
    """

    taken: float

    def __init__(
        self,
        rates: Callable[[float, Array], Array],
        t: float,
        y: Array,
        end: float,
        relative: float,
        absolute: Array,
        size: float | None = None,
    ) -> None:
        """Begin at t (s) with y (k,); tolerances are local, the absolute ones (k,).

        The first step size (s) is found out when omitted.
        """
        from scipy.integrate import DOP853

        self.t, self.y = t, y
        self._rates, self._end = rates, end
        self._relative, self._absolute = relative, absolute
        self._nodes, self._stages = DOP853.C, DOP853.A
        self._ends = np.array([np.append(DOP853.B, 0.0), DOP853.E5, DOP853.E3])
        self._rate = rates(t, y)
        self.size = min(size or self._first_size(), end - t)

    def _rms(self, change: Array, scale: Array) -> float:
        return norm(change / scale) / math.sqrt(len(change))

    def _first_size(self) -> float:
        """A step size (s) with which a step of order 1, and the change of f over it, are small."""
        scale = self._absolute + self._relative * np.abs(self.y)
        state, rate = self._rms(self.y, scale), self._rms(self._rate, scale)
        size = 0.01 * state / rate if min(state, rate) > 1e-5 else 1e-6
        size = min(size, self._end - self.t)
        ahead = self._rates(self.t + size, self.y + size * self._rate)
        bent = self._rms(ahead - self._rate, scale) / size
        largest = max(rate, bent)
        by_order = _eighth_root(0.01 / largest) if largest > 1e-15 else max(1e-6, 1e-3 * size)
        return float(min(100 * size, by_order))

    def step(self) -> None:
        """Take one step, of a size that keeps the local error within the tolerances."""
        rejected = False
        while True:
            if not self.size >= 10 * float(np.spacing(self.t)):
                raise StepVanishes
            left = self._end - self.t
            size = min(self.size, left)
            slopes = np.empty((len(self._nodes) + 1, len(self.y)))
            slopes[0] = self._rate
            for k in range(1, len(self._nodes)):
                along = product(self._stages[k, :k], slopes[:k])
                slopes[k] = self._rates(self.t + self._nodes[k] * size, self.y + size * along)
            slopes[-1] = 0.0
            y = self.y + size * product(self._ends[0], slopes)
            then = self._end if size == left else self.t + size
            slopes[-1] = self._rates(then, y)
            scale = self._absolute + self._relative * np.maximum(np.abs(self.y), np.abs(y))
            fifth, third = product(self._ends[1:], slopes)
            error = self._error(size, fifth / scale, third / scale)
            best = _SAFETY / _eighth_root(error) if error > 0 else _MOST
            if error < 1:
                self.t, self.y, self._rate, self.taken = then, y, slopes[-1], size
                self.size = size * min(1.0 if rejected else _MOST, max(_LEAST, best))
                return
            # Also where the error is not a number.
            self.size = size * (max(_LEAST, best) if error >= 1 else _LEAST)
            rejected = True

    @staticmethod
    def _error(size: float, fifth: Array, third: Array) -> float:
        """Rms of the local error over the tolerances."""
        first, second = (length * length for length in (norm(fifth), norm(third)))
        if first == second == 0:
            return 0.0
        return float(size * first / np.sqrt((first + 0.01 * second) * len(fifth)))


def _eighth_root(value: float) -> float:
    """By square roots, whose last bits are the same everywhere; those of powers are not."""
    return math.sqrt(math.sqrt(math.sqrt(value)))
