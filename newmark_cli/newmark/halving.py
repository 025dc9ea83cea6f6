"""Steps that miss the test of Newton's iteration, taken again as 2, 4, 8, … shorter ones.

So do codes that answer a missed test with a smaller step, down to a smallest one.  The time
grid stays: a step taken in parts is one step of the march, and the next one has its size again.
"""

import sys
from collections.abc import Callable

import numpy as np

from newmark_cli.newmark.march_data import COMPLETED, MISSED, Record, State, recording
from newmark_cli.newmark.scheme import Schemes
from newmark_cli.newmark.steps import TimeGrid
from newmark_cli.support.arrays import Array, IndexArray

#: Takes the state, steps done, norms, iterations and a record; returns ending and steps.
Engine = Callable[..., tuple[int, int]]
#: Numbers of parts whose engines are kept.
_MOST_KEPT = 64


class Halving:
    """An engine that takes missed steps in parts.

    Such a step counts as not converged, with all corrections of all attempts.

    Args:
        schemes: The scheme of each step of the march.
        engine: What marches them, and ends with MISSED.
        make: Makes an engine of other steps.
        smallest: Parts are not smaller (s).
    """

    def __init__(
        self, schemes: Schemes, engine: Engine, make: Callable[[Schemes], Engine], smallest: float
    ) -> None:
        self._schemes, self._engine, self._make = schemes, engine, make
        self._smallest = smallest
        self._parts: dict[tuple[float, ...], tuple[TimeGrid, Engine]] = {}
        #: Step → sizes of the two before it, and in how many parts it is taken: of steps that
        #: missed, and of those that begin with parts.  A march that is repeated takes the same.
        self._known: dict[int, tuple[tuple[float, float], int]] = {}

    def march(
        self,
        state: State,
        first: int,
        norms: Array,
        iterations: IndexArray,
        record: Record,
        positions: IndexArray,
    ) -> tuple[int, int]:
        """Advance ``state``; see `newmark_cli.newmark.scipy_march.march`."""
        grid, done = self._schemes.grid, 0
        while done < len(norms):
            step = first + done + 1
            if step in self._known:
                here = slice(done, done + 1)
                if not self._in_parts(state, step, norms[here], iterations[here], positions[here]):
                    return MISSED, done
                record.keep(state, done)
                done += 1
                continue
            rest = slice(done, min(self._next_known(step) - first - 1, len(norms)))
            before = state.copy()
            ending, taken = self._engine(
                state, first + done, norms[rest], iterations[rest], record=record.after(done),
                positions=positions[rest],
            )  # fmt: skip
            if ending == MISSED:
                state.restore(before)
                again = slice(done, done + taken)
                if taken:
                    self._engine(
                        state, first + done, norms[again], iterations[again],
                        record=recording(state, np.empty(0)), positions=positions[again],
                    )  # fmt: skip
                missed = step + taken
                self._known[missed] = (grid.size(missed - 1), grid.size(missed - 2)), 2
            elif ending != COMPLETED:
                return ending, done + taken
            done += taken
        return COMPLETED, done

    def _next_known(self, step: int) -> int:
        """The next known step; they become known in order."""
        if next(reversed(self._known), 0) < step:
            return sys.maxsize
        return min(known for known in self._known if known > step)

    def _in_parts(
        self, state: State, step: int, norms: Array, iterations: IndexArray, positions: IndexArray
    ) -> bool:
        """Take a step in as many parts as it needs; False if even the smallest miss the test."""
        size, (behind, parts) = self._schemes.grid.size(step), self._known[step]
        before = state.copy()
        corrections = abs(int(iterations[0]))
        while parts == 1 or size / parts >= self._smallest * (1 - 1e-9):
            grid, engine = self._of(size / parts, parts, behind)
            grid.t0 = self._schemes.grid.t(step - 1)
            part_norms, computed = np.zeros((parts, norms.shape[1])), np.zeros(parts, np.int64)
            corrected = np.zeros(parts, np.int64)
            none = recording(state, np.empty(0))
            ending, _ = engine(state, 0, part_norms, computed, record=none, positions=corrected)
            corrections += int(np.abs(computed).sum())
            if ending == COMPLETED:
                norms[0], positions[0] = part_norms[-1], corrected.sum()
                iterations[0] = corrections if parts == 1 else -corrections
                self._known[step] = behind, parts
                last = size / parts, size / parts if parts > 1 else behind[0]
                if last != (size, self._schemes.grid.size(step - 1)):
                    self._known[step + 1] = last, 1
                return True
            state.restore(before)
            parts *= 2
        return False

    def _of(self, size: float, parts: int, behind: tuple[float, float]) -> tuple[TimeGrid, Engine]:
        """Grid and engine of ``parts`` steps of a size (s), and the sizes before them."""
        key = (size, float(parts), *behind)
        if key not in self._parts:
            if len(self._parts) >= _MOST_KEPT:
                self._parts.clear()
            grid = TimeGrid(0.0, size, np.full(parts, size), behind)
            self._parts[key] = grid, self._make(Schemes(self._schemes.base.at(size, 1.0), grid))
        return self._parts[key]
