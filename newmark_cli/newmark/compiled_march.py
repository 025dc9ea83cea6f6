"""The compiled kernel behind the same call as the SciPy march."""

from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np

from newmark_cli.newmark import kernel, scipy_march
from newmark_cli.newmark.constraints import Constraining, constraining_of
from newmark_cli.newmark.linear.dense import dense_tables, no_tables
from newmark_cli.newmark.linear.written.exchanges import Exchanges
from newmark_cli.newmark.linear.written.generated import Written
from newmark_cli.newmark.linear.written.specialised import specialised, unspecialised
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.linear.written.static_elimination import solve_in_order
from newmark_cli.newmark.march_data import (
    BY_ROUNDING,
    COMPLETED,
    PIVOTING,
    TESTS,
    Counts,
    ProblemTables,
    Record,
    Schedule,
    State,
    recording,
)
from newmark_cli.newmark.scheme import STOP, Scheme, Tolerance
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray


class Engine:
    """Arguments of the kernel that a problem and a scheme decide, found once.

    Args:
        problem, scheme: What marches, and how.
        static: Its static elimination; partial pivoting when omitted.
        constraining: The scheme's formulation, found anew when omitted.

    Attributes:
        pivoted: Steps in which static elimination left a correction to partial pivoting.
        exchanges: Those that partial pivoting needs, of index 3.
    """

    def __init__(
        self,
        problem: Problem,
        scheme: Scheme,
        static: StaticSystem | None = None,
        constraining: Constraining | None = None,
    ) -> None:
        self.static, self.pivoted = static, 0
        self.problem, self.scheme = problem, scheme
        constraining = constraining or constraining_of(problem, scheme)
        self._extra = constraining.tables() if constraining else None
        self._derive = problem.derivatives if constraining else None
        small = static is None or static.dense
        self._dense = dense_tables(problem, scheme) if small else no_tables(scheme)
        self._static = static.elimination.tables if static else no_tables(scheme)
        self._solve = static.elimination.solve if static else solve_in_order
        dtype, pattern = scheme.dtype, problem.pattern
        tables = ProblemTables(
            problem.ints,
            problem.reals.astype(dtype),
            problem.mass_values.astype(dtype),
            # Unsigned, as numba tests signed ones for their sign.
            pattern.mass_rows.astype(np.uint64),
            pattern.mass_columns.astype(np.uint64),
            *pattern[2:],
        )
        by_residual = scheme.stop is not None and scheme.stop.on_residual
        if self._extra is None and not by_residual:
            written = static is not None and static.elimination.written_out
            elimination = Written(self._static) if written else None
            found = specialised(problem, scheme, tables, elimination)
        else:
            found = unspecialised(problem)
        self._function, self._code = found.function, found.code
        self._tables = tables._replace(ints=found.ints)
        of_index_3 = static is None and self._extra is None
        self.exchanges = Exchanges(problem, scheme, self._dense) if of_index_3 else None

    def march(
        self,
        state: State,
        first: int,
        norms: Array,
        iterations: IndexArray,
        record: Record | None = None,
        positions: IndexArray | None = None,
    ) -> tuple[int, int]:
        """Advance ``state``; see `newmark_cli.newmark.scipy_march.march`.

        What static elimination refuses is solved with partial pivoting, correction by
        correction where the matrix is small, else step by step; that what came before has
        no part in it keeps the march independent of where it halts.
        """
        record = recording(state, np.empty(0)) if record is None else record
        positions = np.zeros(len(norms), np.int64) if positions is None else positions
        pivoted = np.zeros(len(norms), np.int64)
        done = 0
        while True:
            if self.exchanges:
                self._static, self._solve = self.exchanges.at(state, first + done)
            counts = Counts(norms[done:], iterations[done:], positions[done:], pivoted[done:])
            given = self.arguments(state, first + done, counts, _after(record, done))
            ending, taken = kernel.march(*given)  # type: ignore[no-untyped-call]
            if self.exchanges:
                self.exchanges.took(pivoted[done : done + taken])
            done += taken
            if ending == PIVOTING:
                # Too large for a dense matrix.
                one, pivoted[done] = slice(done, done + 1), 1
                ending, taken = self._by_scipy(
                    state, first + done, norms[one], iterations[one], record=_after(record, done)
                )
                done += taken
            if ending != COMPLETED or done == len(norms):
                if self.static:
                    self.pivoted += int(pivoted[:done].sum())
                return ending, done

    @cached_property
    def _by_scipy(self) -> Callable[..., tuple[int, int]]:
        assert self.static is not None
        return partial(scipy_march.march, self.problem, self.scheme, system=self.static.pivoting)

    def arguments(
        self, state: State, first: int, counts: Counts, record: Record
    ) -> tuple[Any, ...]:
        """Arguments of `newmark_cli.newmark.kernel.march`."""
        scheme, stop = self.scheme, self.scheme.stop or Tolerance()
        schedule = Schedule(
            compensated=scheme.compensated,
            t_start=float(self.problem.t0),
            h=float(scheme.h),
            first=first,
            cap=scheme.iteration_cap,
            settled_below=scheme.settled_below,
            test=BY_ROUNDING if scheme.stop is None else TESTS[stop.test],
            limits=stop.limits,
            ends=int(stop.missed == STOP),
            patience=self.exchanges.patience if self.exchanges else len(counts.norms) + 1,
        )
        functions = self._function, self._derive, self._solve
        tables, matrices = (self._tables, scheme.tables), (self._static, self._dense)
        return functions, self._code, tables, matrices, self._extra, state, schedule, counts, record


def _after(record: Record, done: int) -> Record:
    """The rest of a record once so many steps are done."""
    k = int(np.searchsorted(record.steps, done))
    return Record(record.steps[k:] - done, record.fields[k:], record.multipliers[k:])


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
