"""One march that can be observed: cells, drawings and the library all take it."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from heapq import merge

import numpy as np

from newmark_cli.newmark import engine
from newmark_cli.newmark.formulation import CORRECTED, RECOVERED
from newmark_cli.newmark.linear import choice, solvers
from newmark_cli.newmark.linear.choice import AUTO, Krylov
from newmark_cli.newmark.linear.solvers import LinearSystem
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march_data import COMPLETED, Record, State, counting, recording
from newmark_cli.newmark.scheme import Scheme, Schemes
from newmark_cli.newmark.steps import TimeGrid
from newmark_cli.problems.algebra import product
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.starting import constraint_jerk, corrected_velocity
from newmark_cli.support.arrays import Array, IndexArray

#: Most steps between two signs of life; an interrupt waits for no longer.
_STRETCH = {choice.DENSE: 5_000, choice.SPARSE: 20, choice.GMRES: 1}
#: Most of static elimination: a fraction of a second, by its operations.
_STATIC_OPERATIONS = 2e7
#: Most numbers that are recorded between two halts.
_MOST_RECORDED = 2_000_000


def initial_state(problem: Problem, scheme: Scheme) -> State:
    """State of a march at the initial time, in the scheme's precision.

    Φ is carried from 0 on in compensated evaluation: the start meets the
    constraints by definition, not just to the rounding of its coordinates.

    Args:
        problem: The problem; its start is consistent.
        scheme: What marches it.
    """
    index_1 = Index1(problem)
    a, multipliers = index_1.accelerations(problem.t0, problem.u0, problem.v0)
    v, psi = problem.v0, np.zeros(problem.m)
    # What the start leaves is exact: no step is long enough to know it better.
    rates, offsets = np.zeros(1 + problem.m), np.zeros(1 + problem.n)
    rates[0] = offsets[0] = np.finfo(scheme.dtype).max
    if scheme.start == CORRECTED:
        rates[1:] = -constraint_jerk(problem) / 12
        v = corrected_velocity(problem, scheme.h)
        psi = index_1.rate(problem.t0, problem.u0, v)
    fields = np.array([problem.u0, v, a, a])
    past = product(scheme.relations.start, fields[:3])
    dtype = scheme.dtype
    return State(
        fields.astype(dtype),
        past.astype(dtype),
        multipliers.astype(dtype),
        lows=np.zeros((2, problem.n), dtype),
        phi=np.zeros(problem.m, dtype),
        psi=psi.astype(dtype),
        impulse=np.zeros(problem.m, dtype),
        rates=rates.astype(dtype),
        offsets=offsets.astype(dtype),
    )


@dataclass(frozen=True, eq=False)
class Stretch:
    """Records of successive steps.

    Attributes:
        norms: (steps, k) 2-norms of the recorded correction's blocks, as
            `Scheme.recorded` names them, in the unknowns that the solver sees.
        iterations: (steps,) corrections computed; negative where a step did not converge.
        looks: (k,) steps whose states were recorded, counted from the start of the march.
        record: Those states.
        pivoted: Steps that static elimination left to partial pivoting.
    """

    norms: Array
    iterations: IndexArray
    looks: IndexArray
    record: Record
    pivoted: int = 0


class March:
    """A problem under way.

    Attributes:
        problem: What marches.
        grid: When its steps are.
        solver: Linear solver in use.
        krylov: How a Krylov solver was asked for; None otherwise.
        state: Where the march is; overwritten as it goes on.
        done: Steps taken, of this grid.
        earlier: Steps before them, of the march that this one goes on with at another h.
        corrections: Newton corrections that this object has computed in them.
        positions: Corrections of positions by projections, likewise.
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
        state: State | None = None,
        done: int = 0,
        grid: TimeGrid | None = None,
    ) -> None:
        """Start from the problem's consistent initial state, or go on from another.

        Args:
            problem, scheme, linear_solver, krylov: What marches, and how.
            state: Where a march of this scheme on this problem stood; copied.
            done: Steps that it had taken.
            grid: When the steps are; all are of the scheme's size when omitted.
        """
        self.problem, self.krylov = problem, krylov
        self.grid = grid or TimeGrid(problem.t0, scheme.h)
        self.schemes = Schemes(scheme, self.grid)
        self.solver = choice.choose(
            linear_solver, problem, scheme.form, scheme.formulated, scheme.precision
        )
        self._systems = solvers.Systems(self.solver, problem, self.schemes, krylov)
        system = self._systems.base
        static = system if isinstance(system, StaticSystem) else None
        dense = static.dense if static else not isinstance(system, SparseSystem)
        self._engine = engine.Engine(
            problem, scheme, static, system.constraining, self.schemes,
            None if dense else self._systems.pivoting_at,
        )  # fmt: skip
        if state is None:
            self.state = initial_state(problem, self.schemes.at(1))
        else:
            self.state = State(*(np.array(array, scheme.dtype, order="C") for array in state))
        self.done, self.earlier, self.corrections, self.positions = done, 0, 0, 0
        self.ending = COMPLETED
        self._index_1 = Index1(problem) if scheme.reported == RECOVERED else None

    @property
    def scheme(self) -> Scheme:
        """How it marches: the scheme of the last step, of the first one at the start."""
        return self.schemes.at(self.done)

    @property
    def system(self) -> LinearSystem:
        """The linear system that the last step solved, likewise."""
        return self.system_of(self.done)

    def system_of(self, step: int) -> LinearSystem:
        """The linear system that a step solves, counted from 1."""
        return self._systems.at(step)

    @property
    def t(self) -> float:
        """Time (s)."""
        return self.grid.t(self.done)

    @property
    def here(self) -> State:
        """The state in double precision, whatever the precision of the march; a copy."""
        return State(*(array.astype(float) for array in self.state))

    @property
    def multipliers(self) -> Array:
        """(m,) λ as the scheme reports it; see `newmark_cli.newmark.formulation.REPORTED`."""
        if self._index_1:
            return self._recovered(self._index_1, self.t, self.state.fields)
        multipliers = self.state.multipliers
        if self.scheme.total:
            acting = self.scheme.dtype(self.scheme.acting)
            multipliers = multipliers + self.state.impulse / acting
        return multipliers.astype(float)

    def _recovered(self, index_1: Index1, t: float, fields: Array) -> Array:
        """(m,) λ that u and v imply; NaN where they determine none."""
        u, v = np.asarray(fields[:2], float)
        try:
            return index_1.accelerations(t, u, v)[1]
        except np.linalg.LinAlgError:
            return np.full(self.problem.m, np.nan)

    @property
    def seen(self) -> State:
        """The state with the multipliers that are reported, in double precision; a copy."""
        return self.here._replace(multipliers=self.multipliers)

    def advance(self, steps: int, looks: Sequence[int] = ()) -> Stretch:
        """Take so many steps, or as many as there are until the march ends.

        Whatever ends it, `state` is then that after the last whole step; after an
        exception, from the user's code for example, that before the first.

        Args:
            steps: How many.
            looks: Steps among them whose states are recorded, counted from the start of
                the march; ascending.
        """
        before, begin = self.state.copy(), self.done
        record = recording(self.state, np.array(looks, np.int64) - (begin + 1))
        counts = counting(steps, len(self.scheme.recorded))
        try:
            ending, taken = self._engine.march(self.state, begin, counts, record)
            counts = counts.part(0, taken)
            if ending != COMPLETED:
                # Newton has overwritten the state in the step that failed.
                self.state.restore(before)
                self._engine.march(self.state, begin, counting(taken, counts.norms.shape[1]))
            reached = bisect_right(looks, begin + taken)
            if self._index_1:
                for k in range(reached):
                    t = self.grid.t(looks[k])
                    record.multipliers[k] = self._recovered(self._index_1, t, record.fields[k])
            stretch = Stretch(
                counts.norms,
                counts.iterations,
                np.array(looks[:reached], np.int64),
                Record(*(array[:reached] for array in record)),
                int(counts.pivoted.sum()) if self._engine.static else 0,
            )
            self.corrections += int(np.abs(counts.iterations).sum())
            self.positions += int(counts.positions.sum())
            self.ending, self.done = ending, begin + taken
            return stretch
        except BaseException:
            # An interrupt may come at any place.
            self.state.restore(before)
            self.ending, self.done = COMPLETED, begin
            raise

    @property
    def _longest(self) -> int:
        """Most steps between two signs of life."""
        if not self.problem.compiled and self.solver != choice.GMRES:
            return _STRETCH[choice.SPARSE]
        if self.solver != choice.STATIC:
            return _STRETCH[self.solver]
        system = self._systems.base
        assert isinstance(system, StaticSystem)
        elimination = system.elimination
        in_step = elimination.lists.operations + 20 * elimination.size
        return max(1, min(_STRETCH[choice.DENSE], int(_STATIC_OPERATIONS / in_step)))

    def stretches(
        self, steps: int, stops: Iterable[int] = (), looks: Sequence[int] = ()
    ) -> Iterator[Stretch]:
        """Take steps, halting where somebody looks, and recording states on the way.

        Where it halts does not change the march by a bit.

        Args:
            steps: Step at which the march is over, counted from the start.
            stops: Steps after which it halts, besides halts that keep every stretch short.
            looks: Steps whose states are recorded, which takes no halt; ascending, and as
                a range they may be many.

        Yields:
            What was recorded since the last halt, of bounded size; the march stands at
            its end.
        """
        longest = self._longest
        if len(looks):
            numbers = self.state.fields.size + self.state.multipliers.size
            longest = max(1, min(longest, _MOST_RECORDED // numbers))
        regular = range(self.done + longest, steps, longest)
        # A range may be long, and is in order.
        ordered = stops if isinstance(stops, range) else sorted(stops)
        for halt in merge(regular, ordered, (steps,)):
            if not self.done < halt <= steps:
                continue
            here = slice(bisect_right(looks, self.done), bisect_right(looks, halt))
            yield self.advance(halt - self.done, looks[here])
            if self.ending != COMPLETED:
                return
