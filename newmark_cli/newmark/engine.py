"""The kernel, and what a problem and a scheme decide of its arguments."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.newmark import callbacks, kernel, march_data
from newmark_cli.newmark.callbacks import Callbacks
from newmark_cli.newmark.carrying import Carrying
from newmark_cli.newmark.constraints import Constraining, FormulationTables, constraining_of
from newmark_cli.newmark.linear import assembly
from newmark_cli.newmark.linear.assembly import Products
from newmark_cli.newmark.linear.dense import dense_tables, no_tables
from newmark_cli.newmark.linear.solvers import LinearSystem
from newmark_cli.newmark.linear.written.exchanges import Exchanges
from newmark_cli.newmark.linear.written.static import StaticElimination, StaticSystem
from newmark_cli.newmark.linear.written.static_elimination import solve_generated
from newmark_cli.newmark.march_data import COMPLETED, SINGULAR, Counts, Plan, Record, State
from newmark_cli.newmark.scheme import Scheme, Schemes, Tolerance, contains
from newmark_cli.newmark.steps import TimeGrid
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array


class _Numbers(NamedTuple):
    """What the kernel is handed, as far as it may change with the step size."""

    tables: march_data.StepTables
    static: march_data.MatrixTables
    dense: march_data.MatrixTables
    extra: FormulationTables | None
    h: Array  #: (1,) step size (s)
    carried: Array  #: (P, P + 1) see `Scheme.carried`

    def arrays(self, units: int) -> dict[tuple[str, str], Array]:
        """(part, name) → array that may change; of the work space the first ``units`` numbers."""
        arrays = {("", "h"): self.h, ("", "carried"): self.carried}
        for part, names in _CHANGING.items():
            if (tables := getattr(self, part)) is not None:
                arrays |= {(part, name): getattr(tables, name) for name in names}
        return {**arrays, ("static", "work"): self.static.work[:units]}

    def among(self, numbers: Array, units: int) -> "_Numbers":
        """The same, its arrays being parts of ``numbers``, which ends with the work space."""
        begin, found = 0, self
        for (part, name), array in self.arrays(units).items():
            end = begin + array.size
            view = numbers[begin:] if name == "work" else numbers[begin:end].reshape(array.shape)
            begin, new = end, {name: view}
            own: Any = {part: getattr(found, part)._replace(**new)} if part else new
            found = found._replace(**own)
        return found


#: What changes with the step size, besides the units of static elimination.
_CHANGING = {
    "tables": (
        "weights", "past_weights", "dynamic_weights", "dynamic_past", "row_weights", "row_past",
        "predictor", "acceleration", "left", "right",
    ),
    "static": ("constant", "coefficients"),
    "dense": ("constant", "coefficients"),
    "extra": ("rows", "eta", "rows_eta", "penalty", "acting"),
}  # fmt: skip
#: Most numbers of steps of other sizes that are kept.
_MOST_NUMBERS = 2_000_000


class Engine:
    """Arguments of the kernel that a problem and a scheme decide, found once.

    Args:
        problem, scheme: What marches, and how.
        static: Its static elimination; partial pivoting when omitted.
        constraining: The scheme's formulation, found anew when omitted.
        schemes: The scheme of each step; all are of one size when omitted.
        system_at: The linear system of a step, counted from 1, that is to solve in Python: all,
            or what static elimination refuses; the kernel's dense one when omitted.

    Attributes:
        exchanges: Those that partial pivoting needs, of index 3 with steps of one size.
    """

    def __init__(
        self,
        problem: Problem,
        scheme: Scheme,
        static: StaticSystem | None = None,
        constraining: Constraining | None = None,
        schemes: Schemes | None = None,
        system_at: Callable[[int], LinearSystem] | None = None,
    ) -> None:
        self.problem, self.scheme, self.static = problem, scheme, static
        self.schemes = schemes = schemes or Schemes(scheme, TimeGrid(problem.t0, scheme.h))
        self._constraining = constraining or constraining_of(problem, scheme)
        self._is_dense = system_at is None
        self._python = Callbacks(problem, scheme.dtype, system_at)
        self._functions: tuple[Any, Any] = problem.function, problem.derivatives
        if not problem.compiled:
            self._functions = callbacks.evaluate, callbacks.derive
        self._numbers = self._numbers_of(scheme)
        if static:
            self._numbers = self._numbers._replace(static=static.elimination.tables)
        self._solve = static.elimination.solve if static else solve_generated
        dtype, pattern = scheme.dtype, problem.pattern
        self._tables = march_data.ProblemTables(
            self._python.ints,
            problem.reals.astype(dtype),
            problem.mass_values.astype(dtype),
            # Unsigned, as numba tests signed ones for their sign.
            pattern.mass_rows.astype(np.uint64),
            pattern.mass_columns.astype(np.uint64),
            *pattern[2:],
        )
        self._carrying = Carrying(problem, schemes)
        self._row_of: dict[int, Array] = {}
        self._memory = np.empty(0, dtype)
        self._units = 2 * static.elimination.size if static else 0
        if schemes.grid.varies:
            arrays = self._numbers.arrays(self._units).values()
            rest = self._numbers.static.work[self._units :]
            self._width = sum(array.size for array in arrays)
            self._memory = np.concatenate([*(array.ravel() for array in arrays), rest])
            self._numbers = self._numbers.among(self._memory, self._units)
        of_index_3 = self._constraining is None and not schemes.grid.varies
        exchanging = of_index_3 and problem.compiled and static is None and self._is_dense
        self.exchanges = Exchanges(problem, scheme, self._numbers.dense) if exchanging else None

    def _numbers_of(self, scheme: Scheme) -> _Numbers:
        """What a scheme tells the kernel; orders of elimination and P are reused."""
        problem, static = self.problem, self.static
        nothing = no_tables(scheme)
        eliminated = nothing
        if static:
            lists = static.elimination.lists
            eliminated = StaticElimination(problem, scheme, lists).entries
        constraining = self._constraining.at(scheme) if self._constraining else None
        dense, products = nothing, Products(*[np.empty(0, np.int64)] * 2)
        if self._is_dense:
            sums, products = assembly.of_formulation(problem, scheme.tables, constraining)
            dense = dense_tables(problem, scheme, sums)
        return _Numbers(
            tables=scheme.tables,
            static=eliminated,
            dense=dense,
            extra=constraining.tables(products) if constraining else None,
            h=np.array([scheme.h], scheme.dtype),
            carried=scheme.carried(scheme.h / scheme.ratio)[:, :-1].astype(scheme.dtype),
        )

    def _row(self, kind: int) -> Array:
        """(W,) numbers of a kind of steps."""
        if kind not in self._row_of:
            if (len(self._row_of) + 1) * self._width > _MOST_NUMBERS:
                self._row_of.clear()
            arrays = self._numbers_of(self.schemes.of_kind(kind)).arrays(self._units).values()
            self._row_of[kind] = np.concatenate([array.ravel() for array in arrays])
        return self._row_of[kind]

    def _at_once(self, first: int, count: int) -> int:
        """How many of ``count`` steps the kernel takes in one call."""
        if self.schemes.grid.varies:
            steps = self.schemes.carrying
            later = steps[np.searchsorted(steps, first + 1, side="right") :]
            count = min(count, int(later[0]) - first - 1) if len(later) else count
            room = max(1, _MOST_NUMBERS // self._width)
            if len(np.unique(self.schemes.grid.kinds(np.arange(first, first + count + 1)))) > room:
                return room
        return count

    def _sizes(self, first: int, count: int, begun: bool) -> march_data.Sizes:
        """Times and sizes of ``count`` steps, after as many as ``first``.

        ``begun`` if the past has been carried over to the first of them.
        """
        grid, numbers = self.schemes.grid, self._numbers
        which, rows = np.zeros(count + 1, np.int64), np.empty((0, 0), numbers.h.dtype)
        if grid.varies:
            which = grid.kinds(np.arange(first, first + count + 1))
            if begun:
                which[0] = which[1]
            kinds, which = np.unique(which, return_inverse=True)
            rows = np.array([self._row(max(kind, 0)) for kind in kinds.tolist()])
            self._memory[: self._width] = rows[which[0]]
        return march_data.Sizes(
            times=grid.times(np.arange(first, first + count + 1)),
            which=which.ravel(),
            rows=rows,
            numbers=self._memory[: rows.shape[1]],
            h=numbers.h,
            carried=numbers.carried,
        )

    def march(
        self, state: State, first: int, counts: Counts, record: Record | None = None
    ) -> tuple[int, int]:
        """Advance ``state`` by as many steps as ``counts`` has room for.

        What static elimination refuses is solved with partial pivoting, correction by
        correction; that what came before has no part in it keeps the march independent of
        where it halts.

        Args:
            state: Overwritten.
            first: Steps taken since the initial time.
            counts: Overwritten; zeros before.
            record: Overwritten with the states after the steps that it names.

        Returns:
            How the march ended and the steps done.
        """
        record = march_data.recording(state, np.empty(0)) if record is None else record
        steps = len(counts.norms)
        done = 0
        while True:
            if self.exchanges:
                self.exchanges.look(state, first + done)
                self._numbers = self._numbers._replace(static=self.exchanges.tables)
            begun = False
            if contains(self.schemes.carrying, first + done + 1):
                try:
                    begun = self._carrying.to(first + done + 1, state)
                except np.linalg.LinAlgError:
                    return SINGULAR, done
            rest = counts.part(done, self._at_once(first + done, steps - done))
            arguments = self.arguments(state, first + done, rest, record.after(done), begun)
            ending, taken = kernel.march(*arguments)  # type: ignore[no-untyped-call]
            if self.exchanges:
                self.exchanges.took(rest.pivoted[:taken])
            done += taken
            if ending != COMPLETED or done == steps:
                return ending, done

    def arguments(
        self, state: State, first: int, counts: Counts, record: Record, begun: bool = False
    ) -> tuple[Any, ...]:
        """Arguments of `newmark_cli.newmark.kernel.march`."""
        scheme, numbers = self.scheme, self._numbers
        stop, sizes = scheme.stop or Tolerance(), self._sizes(first, len(counts.norms), begun)
        schedule = march_data.Schedule(
            compensated=scheme.compensated,
            cap=scheme.iteration_cap,
            settled_below=scheme.settled_below,
            test=march_data.BY_ROUNDING if scheme.stop is None else march_data.TESTS[stop.test],
            limits=stop.limits,
            patience=self.exchanges.patience if self.exchanges else len(counts.norms) + 1,
        )
        self._python.first = first
        functions = *self._functions, self._solve
        plan = Plan(self._tables, numbers.tables, numbers.static, numbers.dense, schedule, sizes)
        return functions, plan, numbers.extra, self._python, state, counts, record
