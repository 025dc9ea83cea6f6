"""The Jacobian matrix of a form and a formulation, as terms: weights times sources.

Every engine in double precision takes it from here; `linear/assembly.py` has that of
index 3 in the numbers of the kernel.
"""

import numpy as np
import scipy.sparse

from newmark_cli.newmark.constraints import Constraining, Tangents, constraining_of
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.linear.ordering import Order
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scaling import sensitivity
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array, IndexArray


def mass_matrix(problem: Problem) -> scipy.sparse.csr_array:
    """M of a problem; shape (n, n)."""
    pattern = problem.pattern
    return scipy.sparse.csr_array(
        (problem.mass_values, (pattern.mass_rows, pattern.mass_columns)), (problem.n, problem.n)
    )


def summed(slots: IndexArray, values: Array, size: int) -> Array:
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
        return summed(self._slots, values, len(self))


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
        self._kept = [
            i * n for i, row in enumerate(form.rows) if row == "K" and constraining.stabilised
        ]

    def terms(self, behind: int, weights: Array) -> list[_Term]:
        """Their places in J; ``behind`` is the number of their first source."""
        constraining, pattern, n = self._constraining, self._problem.pattern, self._problem.n
        terms: list[_Term] = []
        to_projector = constraining.projector

        def add(rows: IndexArray, columns: IndexArray, factors: list[tuple[int, float]]) -> None:
            nonlocal behind
            sources = behind + np.arange(len(rows))
            behind += len(rows)
            terms.extend((rows, at + columns, sources, factor) for at, factor in factors if factor)

        square = [pattern.g_rows[entries] for entries in self._pairs]
        in_u = [(k * n, constraining.penalty * weight) for k, weight in enumerate(weights[0])]
        add(square[0], square[1], in_u if constraining.penalty else [])
        eta = weights.shape[1] * n + self._problem.m
        for (first, second), rows, factor in self._with_p:
            add(rows[first], to_projector.columns[second], [(eta, factor)])
        for at in self._kept:
            add(at + to_projector.rows, to_projector.columns, [(eta, -1.0)])
        return terms

    def values(self, values: Values, tangents: Tangents) -> list[Array]:
        """The products, in the order of `terms`."""
        first, second = self._pairs
        products = [values.g[first] * values.g[second]]
        of_rows = (part for row in tangents.rows for part in row)
        factors = (values.x, values.y, self._problem.mass_values, *of_rows)
        for factor, ((first, second), *_) in zip(factors, self._with_p, strict=False):
            products.append(factor[first] * tangents.directions[second])
        return products + [tangents.directions] * len(self._kept)


_NOWHERE = np.empty(0, np.int64)


def _meetings(left: IndexArray, right: IndexArray, size: int) -> tuple[IndexArray, IndexArray]:
    """All pairs of places, one in each list, that hold the same number (below ``size``)."""
    order = np.argsort(right, kind="stable")
    counts = np.bincount(right, minlength=size)
    starts = np.concatenate([[0], np.cumsum(counts)])
    lengths = counts[left]
    first = np.repeat(np.arange(len(left)), lengths)
    within = np.arange(len(first)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return first, order[np.repeat(starts[left], lengths) + within]


class Jacobian:
    """J and J̄ = D_L J D_R of a scheme on a problem.

    An entry of J is a sum of weights times sources: values of X, Y, M, G at their
    places, 1, and the coefficients of V and K.  Which weight, which source and
    which entry is decided here, once.

    Attributes:
        size: N.
        order: In which rows and columns of the entries ascend.
        terms: Weights times sources that are added up.
        rows, columns: Of each entry.
    """

    def __init__(self, problem: Problem, scheme: Scheme, order: Order | None = None) -> None:
        """Analyse the places; entries are in the order of the matrix when that is omitted."""
        self.problem, self.scheme = problem, scheme
        self.constraining = constraining_of(problem, scheme)
        self.mass = mass_matrix(problem)
        n, m, pattern, relations = problem.n, problem.m, problem.pattern, scheme.relations
        kept = len(scheme.form.kept)
        constraint_rows = len(scheme.form.constraint_rows)
        self.size = sum(scheme.form.sizes(n, m))
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
        # The four-field matrix, row → field → (rows, columns, sources).
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

        places = np.arange(self.size)
        self.order = order or Order(places, places)
        keys, self._slots = np.unique(
            np.argsort(self.order.columns)[columns] * self.size + np.argsort(self.order.rows)[rows],
            return_inverse=True,
        )
        self._indices = keys % self.size
        self._starts = np.searchsorted(keys, np.arange(self.size + 1) * self.size)
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
        return summed(self._slots, weighted, len(self.rows))

    def scaled_entries(self, values: Values, tangents: Tangents | None = None) -> Array:
        """Entries of J̄ = D_L J D_R at `rows`, `columns`."""
        return np.asarray(self._entry_left * self.entries(values, tangents) * self._entry_right)

    def dense(self, entries: Array) -> Array:
        """(N, N) the matrix with these entries."""
        matrix = np.zeros((self.size, self.size))
        matrix[self.rows, self.columns] = entries
        return matrix

    def times_mass(self, vector: Array) -> Array:
        """M times (n,)."""
        return np.asarray(self.mass @ vector)

    def matrix(self, values: Values, tangents: Tangents | None = None) -> scipy.sparse.csc_array:
        """J̄, the numbers that `solve` takes, without its zeros."""
        matrix = scipy.sparse.csc_array(
            (self.scaled_entries(values, tangents), (self.rows, self.columns)), (self.size,) * 2
        )
        matrix.eliminate_zeros()
        return matrix

    def at(self, t: float, state: State) -> tuple[Values, Tangents | None]:
        """What entries are of at a state."""
        u, v, _, acceleration = state.fields
        values = self.problem.values(t, u, v, state.multipliers)
        if not self.constraining:
            return values, None
        return values, self.constraining.tangents_at(t, u, v, acceleration)


def scaling_factors(scheme: Scheme, n: int, m: int) -> tuple[Array, Array]:
    """D_L and D_R, a factor for each row and each unknown."""
    sizes = scheme.form.sizes(n, m)
    return np.repeat(scheme.left, sizes), np.repeat(scheme.right[: len(sizes)], sizes)


def balancing_factors(scheme: Scheme, n: int, m: int) -> tuple[Array, Array]:
    """Factors that balance the blocks: by the sensitivities to displacement."""
    balanced = sensitivity(scheme.form)
    values = scheme.symbols
    sizes = scheme.form.sizes(n, m)
    return (
        np.repeat([balanced.left[row](values) for row in scheme.form.rows], sizes),
        np.repeat([balanced.right[unknown](values) for unknown in scheme.form.solved], sizes),
    )


class Balanced:
    """J̄ at a state, to be solved through the balanced matrix whatever the scaling is.

    J̄ without left scaling can be so unevenly scaled that elimination with partial
    pivoting returns noise (forms that keep row K, h = 1e-8).  The balanced matrix
    has a moderate condition number; its solution is brought to the scaling asked
    for factor by factor, which is accurate to rounding.

    Attributes:
        size: N.
        scaled, balanced: Entries of J̄, and of the balanced matrix.
        row_factors, column_factors: (N,) from scaled rows to balanced ones, and back from
            balanced unknowns.
    """

    def __init__(self, system: Jacobian, values: Values, tangents: Tangents | None) -> None:
        problem, scheme = system.problem, system.scheme
        left, right = scaling_factors(scheme, problem.n, problem.m)
        rows, columns = balancing_factors(scheme, problem.n, problem.m)
        self.system, self.size = system, system.size
        self.scaled = system.scaled_entries(values, tangents)
        entries = system.entries(values, tangents)
        self.balanced = rows[system.rows] * entries * columns[system.columns]
        self.row_factors, self.column_factors = rows / left, columns / right
