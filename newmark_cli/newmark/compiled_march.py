"""The compiled kernel behind the same call as the SciPy march."""

from typing import Any, Protocol

import numpy as np

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark import kernel
from newmark_cli.newmark.constraints import Constraining, constraining_of
from newmark_cli.newmark.linear.dense import dense_tables
from newmark_cli.newmark.march_data import MatrixTables, ProblemTables, Record, State, recording
from newmark_cli.newmark.scheme import Scheme, Tolerance
from newmark_cli.problems.problem import Problem


class Compiled(Protocol):
    """A linear solver of the kernel."""

    @property
    def solve(self) -> Any:
        """Its compiled function, of `kernel.solve_type`."""

    @property
    def tables(self) -> MatrixTables:
        """What that function is handed."""


class Engine:
    """What the kernel is given of a problem and a scheme, found once.

    Args:
        problem, scheme: What marches, and how.
        solver: A linear solver of the kernel; partial pivoting when omitted.
        constraining: The scheme's formulation, found anew when omitted.
    """

    def __init__(
        self,
        problem: Problem,
        scheme: Scheme,
        solver: Compiled | None = None,
        constraining: Constraining | None = None,
    ) -> None:
        self.problem, self.scheme = problem, scheme
        constraining = constraining or constraining_of(problem, scheme)
        self._extra = constraining.tables() if constraining else None
        self._derive = problem.derivatives if constraining else None
        self._matrix = solver.tables if solver else dense_tables(problem, scheme)
        self._solve = solver.solve if solver else kernel.solve_pivoting
        dtype, pattern = scheme.dtype, problem.pattern
        self._tables = ProblemTables(
            problem.ints,
            problem.reals.astype(dtype),
            problem.mass_values.astype(dtype),
            # Unsigned, as numba tests signed ones for their sign.
            pattern.mass_rows.astype(np.uint64),
            pattern.mass_columns.astype(np.uint64),
            *pattern[2:],
        )

    def march(
        self,
        state: State,
        first: int,
        norms: Array,
        iterations: IndexArray,
        record: Record | None = None,
    ) -> tuple[int, int]:
        """Advance ``state``; see `newmark_cli.newmark.scipy_march.march`.

        Returns:
            How the march ended and the steps done; PIVOTING where the next step is left to
            a solver that exchanges rows.
        """
        given = self.arguments(state, first, norms, iterations, record)
        ending, done = kernel.march(*given)  # type: ignore[no-untyped-call]
        return ending, done

    def arguments(
        self,
        state: State,
        first: int,
        norms: Array,
        iterations: IndexArray,
        record: Record | None = None,
    ) -> tuple[Any, ...]:
        """What `newmark_cli.newmark.kernel.march` is given."""
        scheme = self.scheme
        stop = scheme.stop or Tolerance()
        return (
            self.problem.function,
            self._derive,
            self._solve,
            self._tables,
            scheme.tables,
            self._matrix,
            self._extra,
            state,
            scheme.compensated,
            self.problem.t0,
            scheme.h,
            first,
            scheme.iteration_cap,
            scheme.settled_below,
            stop.absolute,
            stop.relative,
            norms,
            iterations,
            recording(state, np.empty(0)) if record is None else record,
        )


def march(
    problem: Problem,
    scheme: Scheme,
    state: State,
    first: int,
    norms: Array,
    iterations: IndexArray,
    record: Record | None = None,
) -> tuple[int, int]:
    """Advance ``state`` by ``len(norms)`` steps with partial pivoting; see `Engine.march`."""
    return Engine(problem, scheme).march(state, first, norms, iterations, record)
