"""One march that can be observed: cells, drawings and the library all take it."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark import compiled_march, scipy_march
from newmark_cli.newmark.linear import choice, systems
from newmark_cli.newmark.linear.choice import AUTO, Krylov
from newmark_cli.newmark.march_data import COMPLETED, State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem

#: Most steps between two signs of life; an interrupt waits for no longer.
_STRETCH = {choice.DENSE: 5_000, choice.SPARSE: 20, choice.GMRES: 1, choice.MINRES: 1}


def initial_state(problem: Problem, scheme: Scheme) -> State:
    """State of a march at the initial time, in the scheme's precision.

    Φ is carried from 0 on in compensated evaluation: the start meets the
    constraints by definition, not just to the rounding of its coordinates.

    Args:
        problem: The problem; its start is consistent.
        scheme: What marches it.
    """
    a, multipliers = Index1(problem).accelerations(problem.t0, problem.u0, problem.v0)
    fields = np.array([problem.u0, problem.v0, a, a])
    past = scheme.relations.start @ fields[:3]
    dtype = scheme.dtype
    return State(
        fields.astype(dtype),
        past.astype(dtype),
        multipliers.astype(dtype),
        lows=np.zeros((2, problem.n), dtype),
        phi=np.zeros(problem.m, dtype),
    )


@dataclass(frozen=True, eq=False)
class Stretch:
    """What was recorded over successive steps.

    Attributes:
        norms: (steps, p + 1) 2-norms of the recorded correction's blocks, in the
            unknowns that the solver sees.
        iterations: (steps,) corrections computed; negative where a step did not converge.
    """

    norms: Array
    iterations: IndexArray


class March:
    """A problem under way.

    The kernel marches compiled problems with dense matrices, SciPy all others.

    Attributes:
        problem, scheme: What marches, and how.
        solver: Linear solver in use.
        system: The linear system that it solves.
        state: Where the march is; overwritten as it goes on.
        done: Steps taken.
        ending: How the march ended; COMPLETED as long as it can go on.

    Raises:
        numpy.linalg.LinAlgError: When the initial accelerations are not determined.
        InputError: When the linear solver does not fit the problem.
    """

    def __init__(
        self,
        problem: Problem,
        scheme: Scheme,
        linear_solver: str = AUTO,
        krylov: Krylov | None = None,
    ) -> None:
        """Start from the problem's consistent initial state."""
        self.problem, self.scheme = problem, scheme
        self.solver = choice.choose(linear_solver, problem, scheme.form)
        self.system = systems.system(self.solver, problem, scheme, krylov)
        compiled = self.solver == choice.DENSE and problem.compiled
        self._engine = (
            compiled_march.march if compiled else partial(scipy_march.march, system=self.system)
        )
        self.state = initial_state(problem, scheme)
        self.done = 0
        self.ending = COMPLETED

    @property
    def t(self) -> float:
        """Time (s)."""
        return self.problem.t0 + self.done * self.scheme.h

    @property
    def here(self) -> State:
        """The state in double precision, whatever the precision of the march; a copy."""
        return State(*(array.astype(float) for array in self.state))

    def advance(self, steps: int) -> Stretch:
        """Take so many steps, or as many as there are until the march ends."""
        norms = np.zeros((steps, len(self.scheme.form.unknowns)))
        iterations = np.zeros(steps, np.int64)
        self.ending, taken = self._engine(
            self.problem, self.scheme, self.state, self.done, norms, iterations
        )
        self.done += taken
        return Stretch(norms[:taken], iterations[:taken])

    def stretches(self, steps: int, stops: Iterable[int] = ()) -> Iterator[Stretch]:
        """Take steps, halting where somebody looks.

        Where it halts does not change the march by a bit.

        Args:
            steps: Step at which the march is over, counted from the start.
            stops: Steps after which it halts, besides halts that keep every stretch short.

        Yields:
            What was recorded since the last halt; the march stands at its end.
        """
        begin, longest = self.done, _STRETCH[self.solver]
        for stop in (*sorted(stop for stop in set(stops) if begin < stop < steps), steps):
            while self.done < stop:
                regular = self.done + longest - (self.done - begin) % longest
                yield self.advance(min(regular, stop) - self.done)
                if self.ending != COMPLETED:
                    return
