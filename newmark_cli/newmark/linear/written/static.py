"""Static elimination: an order analysed once, no row exchanged; see `static_elimination`."""

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse

from newmark_cli.newmark.constraints import Tangents
from newmark_cli.newmark.jacobian import Balanced
from newmark_cli.newmark.linear import assembly
from newmark_cli.newmark.linear.assembly import Constants
from newmark_cli.newmark.linear.choice import DENSE_UP_TO
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.ordering import CHOSEN_UP_TO, order_by_size, static_order
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.linear.written import generated, static_elimination
from newmark_cli.newmark.linear.written.generated import Written
from newmark_cli.newmark.linear.written.lists import EliminationLists
from newmark_cli.newmark.march_data import COMPLETED, MatrixTables, State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array, IndexArray

#: Most operations with pivots by size that are written out: compiling takes a second.
_BY_SIZE_AT_MOST = 3_000
#: How many times as many operations pivots on the diagonal may take as pivots by size, which
#: may become small along the motion.
_CHEAPER = 4


class StaticElimination:
    """D_L J D_R of index 3, N by N, as static elimination takes it."""

    def __init__(
        self, problem: Problem, scheme: Scheme, lists: EliminationLists | None = None
    ) -> None:
        """Analyse the order, unless the lists are known from another step size."""
        self.problem, self.scheme = problem, scheme
        self.size = assembly.unknowns(problem, scheme)
        self.constants = assembly.constants(problem, scheme.tables)
        self._sums, _ = assembly.of_formulation(problem, scheme.tables)
        if lists:
            self.lists = lists
            return
        parts = [self.constants, self._sums]
        rows, columns = (
            np.concatenate([getattr(part, side) for part in parts]) for side in ("rows", "columns")
        )
        order = static_order(problem, len(scheme.form.kept), rows, columns)
        self.lists = EliminationLists(order, rows, columns)
        if not self.written_out and self.size <= CHOSEN_UP_TO:
            by_size = self._order_by_size(rows, columns)
            if by_size and _CHEAPER * by_size.operations <= self.lists.operations:
                self.lists = by_size

    def _order_by_size(self, rows: IndexArray, columns: IndexArray) -> EliminationLists | None:
        """By numbers at the start without X and Y, which do not depend on h in these units."""
        problem = self.problem
        values = problem.values(problem.t0, problem.u0, problem.v0, np.zeros(problem.m))
        values = values._replace(x=0 * values.x, y=0 * values.y)
        parts = self._in_units(*self.constants), self._in_units(*self.terms(values))
        matrix = np.zeros((self.size, self.size))
        for part in parts:
            np.add.at(matrix, (part.rows, part.columns), part.values)
        order = order_by_size(matrix, rows, columns)
        return EliminationLists(order, rows, columns, signed=False) if order else None

    @property
    def units(self) -> tuple[Array, Array]:
        """Units of rows and of columns in their order, the first signed as the pivots are."""
        rows, columns = self._units
        return rows[self.lists.order.rows], columns[self.lists.order.columns]

    @cached_property
    def _units(self) -> tuple[Array, Array]:
        """The same in the order of the matrix.

        At the start, without X and Y, which is what J̄ tends to as h decreases, every pivot
        is about one in them: fields as far as the update relations couple them to the
        highest kept one, that one by the diagonal of M, λ by that of GᵀM⁻¹G.  Powers of
        two, so that they round nothing.
        """
        problem, scheme, tables = self.problem, self.scheme, self.scheme.tables
        n, m, pattern, p = problem.n, problem.m, problem.pattern, len(tables.kept)
        relations = scheme.relations
        left, right = tables.left.astype(float), tables.right.astype(float)
        # The fields change like this when the highest kept one changes by 1.
        change = np.array([relations.u_from_a, relations.v_from_a, 1.0])
        change /= change[tables.kept[-1]]
        mass = np.zeros(n)
        diagonal = pattern.mass_rows == pattern.mass_columns
        np.add.at(mass, pattern.mass_rows[diagonal], problem.mass_values[diagonal])
        inertia = abs(left[0] * right[p - 1] * relations.acceleration[0] * change[2]) * mass
        # A coordinate without mass has no unit of its own.
        inertia[inertia == 0] = inertia.max()
        values = problem.values(problem.t0, problem.u0, problem.v0, np.zeros(m))
        with np.errstate(divide="ignore"):
            of_highest = 1 / np.sqrt(inertia)
            softness = np.zeros(m)
            np.add.at(softness, pattern.g_columns, values.g**2 * of_highest[pattern.g_rows] ** 2)
            of_constraints = 1 / np.sqrt(softness)
        rows, columns = [of_highest * np.sign(left[0] * right[p - 1])], [of_highest]
        for r in range(1, p):
            k = p - 1 - r
            unit = abs(change[tables.kept[k]] * right[p - 1] / right[k]) * of_highest
            rows.append(1 / (left[r] * float(tables.row_weights[r - 1, k]) * right[k] * unit))
            columns.insert(0, unit)
        rows.append(of_constraints / (left[-1] * change[0] * right[p - 1]))
        columns.append(of_constraints / (left[0] * right[p]))
        return _power_of_two(np.concatenate(rows)), _power_of_two(np.concatenate(columns))

    @property
    def written_out(self) -> bool:
        """Whether code is made for the pattern."""
        most = generated.OPERATIONS_AT_MOST if self.lists.signed else _BY_SIZE_AT_MOST
        return self.lists.operations <= most

    @property
    def solve(self) -> Any:
        """The eliminating function; of `newmark_cli.newmark.kernel.solve_type`."""
        if self.written_out:
            return static_elimination.solve_generated
        return static_elimination.solve_in_order

    @property
    def tables(self) -> MatrixTables:
        """All of it as `solve` reads it."""
        if not self.written_out:
            return self.entries
        return self.entries._replace(room=np.array([self._address], np.uint64))

    @cached_property
    def _address(self) -> int:
        return Written(self.entries).address()

    @cached_property
    def entries(self) -> MatrixTables:
        """The same as the loops read it."""
        lists, dtype = self.lists, self.scheme.dtype
        constants, sums = self._in_units(*self.constants), self._sums
        coefficients = self._in_units(sums.rows, sums.columns, sums.coefficients).values
        tables = lists.tables(constants, sums._replace(coefficients=coefficients), dtype)
        work = np.zeros(5 * self.size + len(lists.lower_rows) + len(lists.upper_rows), dtype)
        work[: 2 * self.size] = np.concatenate(self.units)
        return tables._replace(work=work)

    def _in_units(self, rows: IndexArray, columns: IndexArray, values: Array) -> Constants:
        """Entries in the units of the elimination."""
        row_unit, column_unit = self._units
        entries = row_unit[rows] * values.astype(float) * column_unit[columns]
        return Constants(rows, columns, entries)

    def sources(self, values: Values) -> Array:
        """(E,) what the terms multiply."""
        return assembly.sources(values).astype(self.scheme.dtype)

    def terms(self, values: Values) -> Constants:
        """What a state adds to the constants."""
        sums = self._sums
        entries = sums.coefficients * self.sources(values)[sums.origins]
        return Constants(sums.rows, sums.columns, entries)


class StaticSystem:
    """J̄ of a scheme on a problem, and the kernel's static elimination of it.

    Attributes:
        elimination: For the kernel.
        pivoting: The system that takes what static elimination refuses: dense up to
            `DENSE_UP_TO` unknowns, else sparse.
    """

    constraining = None

    def __init__(self, problem: Problem, scheme: Scheme) -> None:
        self.problem, self.scheme = problem, scheme
        self.elimination = StaticElimination(problem, scheme)

    @property
    def dense(self) -> bool:
        """Whether `pivoting` is dense, and condition numbers are in the 2-norm."""
        return self.elimination.size <= DENSE_UP_TO

    @cached_property
    def pivoting(self) -> DenseSystem | SparseSystem:
        """The solver that exchanges rows."""
        return (DenseSystem if self.dense else SparseSystem)(self.problem, self.scheme)

    def solve(self, values: Values, rhs: Array, tangents: Tangents | None = None) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular."""
        solution = rhs.copy()
        sources, tables = self.elimination.sources(values), self.elimination.tables
        if self.elimination.solve(sources, solution, *tables) == COMPLETED:
            return solution
        return self.pivoting.solve(values, rhs, tangents)

    def matrix(self, values: Values, tangents: Tangents | None = None) -> scipy.sparse.csc_array:
        """J̄, the numbers that `solve` takes, without its zeros."""
        parts = zip(self.elimination.constants, self.elimination.terms(values), strict=True)
        rows, columns, entries = (np.concatenate(pair) for pair in parts)
        matrix = scipy.sparse.csc_array((entries, (rows, columns)), (self.elimination.size,) * 2)
        matrix.eliminate_zeros()
        return matrix

    def balanced(self, t: float, state: State) -> Balanced:
        """J̄ at a state, to be solved accurately, by the solver that exchanges rows."""
        return self.pivoting.balanced(t, state)


def _power_of_two(values: Array) -> Array:
    """The powers of two nearest to values, signed; 1 for what is not finite."""
    powers = np.ldexp(np.sign(values), np.rint(np.log2(np.abs(values))).astype(int))
    return np.where(np.isfinite(values) & (values != 0), powers, 1.0)
