"""Sparse Jacobians: the pattern analysed once, the values refilled at every iteration.

Memory and time are linear in the size for mechanisms that are long rather than
dense.  What makes the plain LU factorisation of J̄ usable at small step sizes,
scaled or not, is the order of elimination: see `elimination_order`.
"""

from typing import Protocol

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import LinearOperator, SuperLU, onenormest, splu

from newmark_cli.newmark.constraints import Constraining, Tangents, constraining_of
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.jacobian import balancing_factors, scaling_factors
from newmark_cli.newmark.linear.ordering import Order, banded, coupling
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems import algebra
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array, IndexArray


def elimination_order(
    problem: Problem, fields: int, constraint_rows: int = 1
) -> tuple[IndexArray, IndexArray]:
    """Rows (p n + k m,) and unknowns of a form in a static order of elimination.

    Of p kept fields, with rows D, p − 1 of V and K, and k rows of constraints.
    Coordinates go by reverse Cuthill–McKee, which keeps the fill of long
    mechanisms within a band.  Of a coordinate's kept fields only the highest has
    its column there, beside row D, where its coefficient of M is large.  The
    others, and the multipliers of its constraints, wait until that has happened
    for all coordinates that M, X, Y or a constraint couple to it.  Eliminated
    any earlier, their columns still reach rows D that have not been used.  Partial
    pivoting compares bare numbers: at small h, unscaled, a rounding-sized fill of
    such a row is as large as the proper pivot in row C or K, is taken, and its
    row, which is 1/h² times larger elsewhere, wipes out that row.  Orders that
    reduce fill alone (COLAMD, minimum degree) lose twelve digits in this way on a
    chain at h = 1e-6; this one is as accurate as under the optimal scaling, and
    its fill is 1.1 to 1.8 times theirs.
    """
    n, m, pattern = problem.n, problem.m, problem.pattern
    coupled = coupling(problem)
    place = banded(coupled)
    # When a coordinate and all that it is coupled to have had their turn.
    ends = coupled.tocoo()
    surrounded = place.copy()
    np.maximum.at(surrounded, ends.row, place[ends.col])
    met = np.zeros(m, np.int64)
    np.maximum.at(met, pattern.g_columns, surrounded[pattern.g_rows])

    first = np.zeros(n, np.int64)

    def order(fields_in_turn: list[int]) -> IndexArray:
        turns = [(surrounded, first + 1 + rank) for rank in range(fields)]
        turns[0] = (place, first)
        blocks = [turns[rank] for rank in fields_in_turn]
        blocks += [(met, np.full(m, 1 + fields + k)) for k in range(constraint_rows)]
        moments, ranks = (np.concatenate(part) for part in zip(*blocks, strict=True))
        return np.lexsort((ranks, moments)).astype(np.int64)

    ranks = list(range(fields))
    return order(ranks), order(ranks[::-1])


class Factors:
    """LU factors, with partial pivoting, of a matrix in a static order of elimination."""

    def __init__(
        self, ordered: scipy.sparse.csc_array, rows: IndexArray, columns: IndexArray
    ) -> None:
        """Factorise.

        Args:
            ordered: The matrix, its rows and columns already in order.
            rows, columns: What stands where in it.

        Raises:
            numpy.linalg.LinAlgError: When a pivot is exactly zero.
        """
        self.size, self._rows, self._columns = len(rows), rows, columns
        self._factors: SuperLU | None = None
        # SuperLU is not made for numbers that are not finite.
        if np.all(np.isfinite(ordered.data)):
            try:
                self._factors = splu(ordered, permc_spec="NATURAL")
            except RuntimeError as error:
                raise np.linalg.LinAlgError(str(error)) from None

    def solve(self, rhs: Array) -> Array:
        """Solution of A x = rhs."""
        return self._solve(rhs, self._rows, self._columns, "N")

    def solve_transposed(self, rhs: Array) -> Array:
        """Solution of Aᵀ x = rhs."""
        return self._solve(rhs, self._columns, self._rows, "T")

    def _solve(self, rhs: Array, inward: IndexArray, outward: IndexArray, kind: str) -> Array:
        solution = np.full_like(rhs, np.nan)
        if self._factors is not None:
            # scipy-stubs does not know the second argument.
            solution[outward] = self._factors.solve(rhs[inward], kind)  # type: ignore[call-overload]
        return solution


def mass_matrix(problem: Problem) -> scipy.sparse.csr_array:
    """M of a problem; shape (n, n)."""
    pattern = problem.pattern
    return scipy.sparse.csr_array(
        (problem.mass_values, (pattern.mass_rows, pattern.mass_columns)), (problem.n, problem.n)
    )


def _summed(slots: IndexArray, values: Array, size: int) -> Array:
    """(size,) sums of the values of each slot, added in their order."""
    return np.asarray(np.bincount(slots, weights=values, minlength=size), float)


class _Merged:
    """Places of a pattern without repeats; entries of one place are added up."""

    def __init__(self, rows: IndexArray, columns: IndexArray, width: int) -> None:
        """Analyse; ``width`` is the number of columns."""
        keys, self._slots = np.unique(rows * width + columns, return_inverse=True)
        self.rows, self.columns = keys // width, keys % width

    def __len__(self) -> int:
        return len(self.rows)

    def values(self, values: Array) -> Array:
        """(len(self),) from a value for each entry of the pattern."""
        return _summed(self._slots, values, len(self))


#: Rows, columns, sources and weight of a part of J.
_Term = tuple[IndexArray, IndexArray, IndexArray, float]


class _Products:
    """Products of values of a problem that a formulation puts into J.

    P stands behind X, Y, M and the rows of constraints, where η moves eliminated fields;
    a penalty adds GGᵀ to X.  Which entries meet is decided here, once.
    """

    def __init__(self, constraining: Constraining, problem: Problem) -> None:
        self._constraining, self._problem = constraining, problem
        pattern, form, (n, m) = problem.pattern, constraining.scheme.form, (problem.n, problem.m)
        self._pairs = constraining.pairs if constraining.penalty else (_NOWHERE, _NOWHERE)
        x, y, mass, g = (
            _meetings(columns, constraining.projector.rows, n)
            for columns in (
                pattern.x_columns, pattern.y_columns, pattern.mass_columns, pattern.g_rows,
            )
        )  # fmt: skip
        to_u, to_v, to_a = constraining.eta
        constraints = [len(form.kept) * n + i * m for i, _ in enumerate(form.constraint_rows)]
        #: Of each product with P the entries that meet, its rows, and its factor in η.
        self._with_p = [
            (x, pattern.x_rows, to_u),
            (y, pattern.y_rows, to_v),
            (mass, pattern.mass_rows, constraining.inertia * to_a),
            *((g, at + pattern.g_columns, f) for at in constraints for f in constraining.eta),
        ][: None if constraining.stabilised else 0]
        self._kept = [i * n for i, row in enumerate(form.rows) if row == "K"]

    def terms(self, behind: int, weights: Array) -> list[_Term]:
        """Where they stand in J; ``behind`` is the first source of theirs."""
        constraining, pattern, n = self._constraining, self._problem.pattern, self._problem.n
        found: list[_Term] = []
        to_projector = constraining.projector

        def add(rows: IndexArray, columns: IndexArray, factors: list[tuple[int, float]]) -> None:
            nonlocal behind
            sources = behind + np.arange(len(rows))
            behind += len(rows)
            found.extend((rows, at + columns, sources, factor) for at, factor in factors if factor)

        square = [pattern.g_rows[entries] for entries in self._pairs]
        in_u = [(k * n, constraining.penalty * weight) for k, weight in enumerate(weights[0])]
        add(square[0], square[1], in_u if constraining.penalty else [])
        eta = weights.shape[1] * n + self._problem.m
        for (first, second), rows, factor in self._with_p:
            add(rows[first], to_projector.columns[second], [(eta, factor)])
        for at in self._kept if constraining.stabilised else ():
            add(at + to_projector.rows, to_projector.columns, [(eta, -1.0)])
        return found

    def values(self, values: Values, tangents: Tangents) -> list[Array]:
        """The products, in the order of `terms`."""
        first, second = self._pairs
        found = [values.g[first] * values.g[second]]
        of_rows = (part for row in tangents.rows for part in row)
        factors = (values.x, values.y, self._problem.mass_values, *of_rows)
        for each, ((first, second), *_) in zip(factors, self._with_p, strict=False):
            found.append(each[first] * tangents.directions[second])
        return found + [tangents.directions] * (self._constraining.stabilised and len(self._kept))


_NOWHERE = np.empty(0, np.int64)


def _meetings(left: IndexArray, right: IndexArray, size: int) -> tuple[IndexArray, IndexArray]:
    """Every pair of places, one of each list, at which both have the same number below size."""
    order = np.argsort(right, kind="stable")
    counts = np.bincount(right, minlength=size)
    starts = np.concatenate([[0], np.cumsum(counts)])
    lengths = counts[left]
    first = np.repeat(np.arange(len(left)), lengths)
    within = np.arange(len(first)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return first, order[np.repeat(starts[left], lengths) + within]


class SparseSystem:
    """J̄ of a scheme on a problem; a `newmark_cli.newmark.linear.systems.LinearSystem`.

    An entry of J is a sum of weights times sources: values of X, Y, M, G at their
    places, 1, and the coefficients of V and K.  Which weight, which source and
    which entry is decided here, once.

    Attributes:
        size: N.
        order: Of the elimination.
        terms: Weights times sources that are added up.
    """

    def __init__(self, problem: Problem, scheme: Scheme) -> None:
        self.problem, self.scheme = problem, scheme
        self.constraining = constraining_of(problem, scheme)
        n, m, pattern, relations = problem.n, problem.m, problem.pattern, scheme.relations
        kept = len(scheme.form.kept)
        constraint_rows = len(scheme.form.constraint_rows)
        self.size = sum(scheme.form.sizes(n, m))
        self.mass = mass_matrix(problem)
        self._x = _Merged(pattern.x_rows, pattern.x_columns, n)
        self._y = _Merged(pattern.y_rows, pattern.y_columns, n)
        self._g = _Merged(pattern.g_rows, pattern.g_columns, m)
        mass = _Merged(pattern.mass_rows, pattern.mass_columns, n)
        self._fixed_sources = np.concatenate(
            [
                relations.acceleration[0] * mass.values(problem.mass_values),
                [1.0, -relations.v_from_a, -relations.u_from_a],
            ]
        )
        starts = np.cumsum([0, len(self._x), len(self._y), len(self._g), len(mass)])

        def block(merged: _Merged, start: int) -> tuple[IndexArray, IndexArray, IndexArray]:
            return merged.rows, merged.columns, start + np.arange(len(merged))

        def diagonal(source: int) -> tuple[IndexArray, IndexArray, IndexArray]:
            return np.arange(n), np.arange(n), np.full(n, starts[4] + source)

        g_rows, g_columns, g_sources = block(self._g, starts[2])
        # The four-field matrix, row → field → (rows, columns, sources); as
        # `jacobian.four_field`, which writes it out.
        full = {
            "D": {
                "u": block(self._x, starts[0]),
                "v": block(self._y, starts[1]),
                "a": block(mass, starts[3]),
            },
            "V": {"v": diagonal(0), "a": diagonal(1)},
            "K": {"u": diagonal(0), "a": diagonal(2)},
            "C": {"u": (g_columns, g_rows, g_sources)},
        }
        behind = starts[4] + 3
        terms = []
        if self.constraining:
            # Sources behind the others: tangents of the rows, then products.
            del full["C"]
            for row in scheme.form.constraint_rows:
                full[row] = {}
                for field in FIELDS:
                    full[row][field] = (g_columns, g_rows, behind + np.arange(len(self._g)))
                    behind += len(self._g)
            products = _Products(self.constraining, problem)
            #: What a formulation multiplies before it is added up.
            self.products = products.values
            terms += products.terms(behind, scheme.elimination.weights)
        ends = np.cumsum(scheme.form.sizes(n, m)).tolist()
        for row, start in zip(scheme.form.rows, [0, *ends], strict=False):
            for field, (rows, columns, sources) in full[row].items():
                for k, weight in enumerate(scheme.elimination.weights[FIELDS.index(field)]):
                    if weight != 0:
                        terms.append((start + rows, k * n + columns, sources, weight))
        if constraint_rows:
            # Row D comes first in every form, λ behind the fields.
            terms.append((g_rows, kept * n + g_columns, g_sources, -1.0))
        rows, columns, self._sources = (
            np.concatenate([term[part] for term in terms]) for part in range(3)
        )
        self._weights = np.concatenate([np.full(len(term[2]), term[3]) for term in terms])
        self.terms = len(self._weights)

        self.order = Order(*elimination_order(problem, kept, constraint_rows))
        keys, self._slots = np.unique(
            np.argsort(self.order.columns)[columns] * self.size + np.argsort(self.order.rows)[rows],
            return_inverse=True,
        )
        self._indices = keys % self.size
        self._starts = np.searchsorted(keys, np.arange(self.size + 1) * self.size)
        #: Row and column of each entry of J.
        self.rows = self.order.rows[self._indices]
        self.columns = self.order.columns[keys // self.size]
        left, right = scaling_factors(scheme, n, m)
        self._entry_left, self._entry_right = left[self.rows], right[self.columns]

    def entries(self, values: Values, tangents: Tangents | None = None) -> Array:
        """Entries of J, not scaled, at `rows`, `columns`."""
        parts = [
            self._x.values(values.x),
            self._y.values(values.y),
            self._g.values(values.g),
            self._fixed_sources,
        ]
        if self.constraining and tangents is not None:
            parts += [self._g.values(part) for row in tangents.rows for part in row]
            parts += self.products(values, tangents)
        sources = np.concatenate(parts)
        weighted = self._weights * sources[self._sources]
        return _summed(self._slots, weighted, len(self.rows))

    def scaled_entries(self, values: Values, tangents: Tangents | None = None) -> Array:
        """Entries of J̄ = D_L J D_R at `rows`, `columns`."""
        return np.asarray(self._entry_left * self.entries(values, tangents) * self._entry_right)

    def factorise(self, entries: Array) -> Factors:
        """LU factors of the matrix with these entries."""
        ordered = scipy.sparse.csc_array(
            (entries, self._indices, self._starts), (self.size, self.size)
        )
        return Factors(ordered, *self.order)

    def times_mass(self, vector: Array) -> Array:
        """M times (n,)."""
        return np.asarray(self.mass @ vector)

    def solve(self, values: Values, rhs: Array, tangents: Tangents | None = None) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular."""
        return self.factorise(self.scaled_entries(values, tangents)).solve(rhs)

    def matrix(self, values: Values, tangents: Tangents | None = None) -> scipy.sparse.csc_array:
        """J̄, the numbers that `solve` takes, without its zeros."""
        found = scipy.sparse.csc_array(
            (self.scaled_entries(values, tangents), (self.rows, self.columns)), (self.size,) * 2
        )
        found.eliminate_zeros()
        return found

    def balanced(self, t: float, state: State) -> "SparseBalancedJacobian":
        """J̄ at a state, to be solved accurately."""
        values = self.problem.values(t, state.fields[0], state.fields[1], state.multipliers)
        u, v, _, acceleration = state.fields
        tangents = (
            self.constraining.tangents_at(t, u, v, acceleration) if self.constraining else None
        )
        return SparseBalancedJacobian(self, values, tangents)


class Solvable(Protocol):
    """A factorised matrix A."""

    size: int

    def solve(self, rhs: Array) -> Array:
        """Solution of A x = rhs."""

    def solve_transposed(self, rhs: Array) -> Array:
        """Solution of Aᵀ x = rhs."""


def inverse_norm(matrix: Solvable) -> float:
    """‖A⁻¹‖₁, estimated from below.

    The estimate (Higham & Tisseur 2000) is rarely less than a third of the norm.  It
    works on one column: with more it would draw random ones, from a generator that
    threads share, and differ from run to run.
    """
    inverse = LinearOperator(
        (matrix.size, matrix.size),
        matvec=lambda x: matrix.solve(np.ravel(x)),
        rmatvec=lambda x: matrix.solve_transposed(np.ravel(x)),
        dtype=float,
    )
    return float(onenormest(inverse, t=1))


class _DenseFactors:
    """Factors of a matrix at the pattern of a system, the same on every processor."""

    def __init__(self, system: SparseSystem, entries: Array) -> None:
        self.size = system.size
        matrix = np.zeros((self.size, self.size))
        np.add.at(matrix, (system.rows, system.columns), entries)
        self.solve = algebra.Factors(matrix).solve
        self.solve_transposed = algebra.Factors(matrix.T).solve


class SparseBalancedJacobian:
    """J̄ at a state, solved through the balanced matrix; see `jacobian.BalancedJacobian`."""

    def __init__(
        self, system: SparseSystem, values: Values, tangents: Tangents | None = None
    ) -> None:
        problem, scheme = system.problem, system.scheme
        left, right = scaling_factors(scheme, problem.n, problem.m)
        row_balance, column_balance = balancing_factors(scheme, problem.n, problem.m)
        self.size = system.size
        self._scaled = system.scaled_entries(values, tangents)
        self._entry_columns = system.columns
        self._columns, self._rows = column_balance / right, row_balance / left
        entries = (
            row_balance[system.rows]
            * system.entries(values, tangents)
            * column_balance[system.columns]
        )
        self._factors: Solvable = (
            _DenseFactors(system, entries)
            if system.size <= algebra.DENSE_UP_TO
            else system.factorise(entries)
        )

    def solve(self, rhs: Array) -> Array:
        """Solution of J̄ q̄ = rhs."""
        return np.asarray(self._columns * self._factors.solve(self._rows * rhs))

    def solve_transposed(self, rhs: Array) -> Array:
        """Solution of J̄ᵀ x = rhs."""
        return np.asarray(self._rows * self._factors.solve_transposed(self._columns * rhs))

    def condition(self) -> float:
        """1-norm condition number ‖J̄‖₁·‖J̄⁻¹‖₁; see `inverse_norm`."""
        norm = _summed(self._entry_columns, np.abs(self._scaled), self.size).max()
        return float(norm * inverse_norm(self))
