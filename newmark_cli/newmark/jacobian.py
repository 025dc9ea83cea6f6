"""The Jacobian matrix of a form and a formulation, in double precision.

Solvers outside of the kernel and measures take it from here; see `linear/assembly.py`.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse

from newmark_cli.newmark.constraints import Tangents, constraining_of
from newmark_cli.newmark.linear import assembly
from newmark_cli.newmark.linear.ordering import Order
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scaling import sensitivity
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array, IndexArray


def summed(slots: IndexArray, values: Array, size: int) -> Array:
    """(size,) sums of the values of each slot, added in their order."""
    return np.asarray(np.bincount(slots, weights=values, minlength=size), float)


class Jacobian:
    """J and J̄ = D_L J D_R of a scheme on a problem; its terms are those of `assembly`.

    Attributes:
        size: N.
        order: In which rows and columns of the entries ascend.
        rows, columns: Of each entry.
        products: What a formulation multiplies before it is added up.
    """

    def __init__(self, problem: Problem, scheme: Scheme, order: Order | None = None) -> None:
        """Analyse the places; entries are in the order of the matrix when that is omitted."""
        self.problem, self.scheme = problem, scheme
        self.constraining = constraining_of(problem, scheme)
        n, m, tables = problem.n, problem.m, assembly.unscaled(scheme)
        self.size = assembly.unknowns(problem, scheme)
        fixed = assembly.constants(problem, tables)
        sums, self.products = assembly.of_formulation(problem, tables, self.constraining)
        self._fixed, self._sources, self._weights = fixed.values, sums.origins, sums.coefficients
        rows, columns = (np.concatenate(pair) for pair in zip(fixed[:2], sums[:2], strict=True))

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
        sources = self.products.behind(assembly.sources(values, tangents))
        weighted = np.concatenate([self._fixed, self._weights * sources[self._sources]])
        return summed(self._slots, weighted, len(self.rows))

    def scaled_entries(self, values: Values, tangents: Tangents | None = None) -> Array:
        """Entries of J̄ = D_L J D_R at `rows`, `columns`."""
        return np.asarray(self._entry_left * self.entries(values, tangents) * self._entry_right)

    def dense(self, entries: Array) -> Array:
        """(N, N) the matrix with these entries."""
        matrix = np.zeros((self.size, self.size))
        matrix[self.rows, self.columns] = entries
        return matrix

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
    return scaling_factors(replace(scheme, scaling=sensitivity(scheme.form)), n, m)


class Balanced:
    """J̄ at a state, to be solved through the balanced matrix whatever the scaling is.

    J̄ without left scaling can be so unevenly scaled that elimination with partial
    pivoting returns noise (forms that keep row K, h = 1e-8).  The balanced matrix
    has a moderate condition number; its solution is brought to the scaling asked
    for factor by factor, which is accurate to rounding.

    Attributes:
        size: N.
        scaled, balanced: Entries of J̄, and of the balanced matrix.
        factors: Of the balanced matrix; raises numpy.linalg.LinAlgError when J̄ is singular.
        row_factors, column_factors: (N,) from scaled rows to balanced ones, and back from
            balanced unknowns.
    """

    factors: Any

    def __init__(self, system: Jacobian, values: Values, tangents: Tangents | None) -> None:
        problem, scheme = system.problem, system.scheme
        left, right = scaling_factors(scheme, problem.n, problem.m)
        rows, columns = balancing_factors(scheme, problem.n, problem.m)
        self.system, self.size = system, system.size
        self.scaled = system.scaled_entries(values, tangents)
        entries = system.entries(values, tangents)
        self.balanced = rows[system.rows] * entries * columns[system.columns]
        self.row_factors, self.column_factors = rows / left, columns / right

    def solve(self, rhs: Array) -> Array:
        """Solution of J̄ q̄ = rhs."""
        return np.asarray(self.column_factors * self.factors.solve(self.row_factors * rhs))

    def condition(self) -> float:
        """Condition number ‖J̄‖·‖J̄⁻¹‖."""
        raise NotImplementedError
