"""Dense Jacobians: solved by elimination with partial pivoting, and their condition numbers."""

import math
from functools import cached_property

import numpy as np
import scipy.sparse

from newmark_cli.newmark.constraints import Tangents, constraining_of
from newmark_cli.newmark.jacobian import (
    balancing_factors,
    form_blocks,
    scaled_jacobian,
    scaling_factors,
)
from newmark_cli.newmark.linear import assembly
from newmark_cli.newmark.march_data import MatrixTables, State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.algebra import Factors, product, spectral_norm
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array


class BalancedJacobian:
    """J̄ at a state, solved through the balanced matrix whatever the scaling is.

    J̄ without left scaling can be so unevenly scaled that elimination with partial
    pivoting returns noise (forms that keep row K, h = 1e-8).  The balanced matrix
    has a moderate condition number; its solution is brought to the scaling asked
    for factor by factor, which is accurate to rounding.
    """

    def __init__(self, problem: Problem, scheme: Scheme, t: float, state: State) -> None:
        terms = problem.evaluate(t, state.fields[0], state.fields[1], state.multipliers)
        n, m = problem.n, problem.m
        constraining = constraining_of(problem, scheme)
        u, v, _, acceleration = state.fields
        tangents = constraining.tangents_at(t, u, v, acceleration) if constraining else None
        jacobian = np.block(form_blocks(scheme, terms, problem.M, constraining, tangents))
        left, right = scaling_factors(scheme, n, m)
        row_balance, column_balance = balancing_factors(scheme, n, m)
        self.size = len(jacobian)
        self.scaled = left[:, None] * jacobian * right[None, :]
        self._balanced = row_balance[:, None] * jacobian * column_balance[None, :]
        self._columns = column_balance / right
        self._rows = row_balance / left

    @cached_property
    def _factors(self) -> Factors:
        return Factors(self._balanced)

    def solve(self, rhs: Array) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular."""
        return np.asarray(self._columns * self._factors.solve(self._rows * rhs))

    def inverse(self) -> Array:
        """J̄⁻¹; raises numpy.linalg.LinAlgError when J̄ is singular."""
        inverse = self._factors.inverse()
        return np.asarray(self._columns[:, None] * inverse * self._rows[None, :])

    def condition(self) -> float:
        """2-norm condition number ‖J̄‖·‖J̄⁻¹‖; infinite when the matrix is singular.

        One singular value decomposition of J̄ loses the smallest singular value
        when C exceeds 1/eps; the largest one of J̄⁻¹ is always accurate.
        """
        try:
            inverse = self.inverse()
        except np.linalg.LinAlgError:
            return np.inf
        return spectral_norm(self.scaled) * spectral_norm(inverse)


def dense_tables(problem: Problem, scheme: Scheme) -> MatrixTables:
    """D_L J D_R as the kernel assembles it; places count its entries row by row.

    Of a formulation it has the constants, X and Y.
    """
    dtype, size = scheme.dtype, assembly.unknowns(problem, scheme)
    fixed = assembly.constants(problem, scheme)
    sums = (assembly.of_motion if scheme.formulated else assembly.of_index_3)(problem, scheme)
    constant = np.zeros(size * size, dtype)
    np.add.at(constant, fixed.rows * size + fixed.columns, fixed.values)
    return MatrixTables(
        constant=constant,
        places=(sums.rows * size + sums.columns).astype(np.uint32),
        origins=sums.origins.astype(np.uint32),
        coefficients=sums.coefficients,
        structure=np.empty(0, np.uint32),
        room=np.empty(0, np.uint64),
        work=np.empty(0, dtype),
    )


def assembled(tables: MatrixTables, scheme: Scheme, values: Values) -> Array:
    """(N, N) D_L J D_R of index 3 at a state, as the kernel assembles it."""
    sources = assembly.sources(values, scheme)
    entries = tables.constant.copy()
    np.add.at(entries, tables.places, tables.coefficients * sources[tables.origins])
    size = math.isqrt(len(entries))
    return entries.reshape(size, size)


def no_tables(scheme: Scheme) -> MatrixTables:
    """Nothing, for a solver that is not used."""
    no_numbers, nowhere = np.empty(0, scheme.dtype), np.empty(0, np.uint32)
    return MatrixTables(
        no_numbers, nowhere, nowhere, no_numbers, nowhere, np.empty(0, np.uint64), no_numbers
    )


class DenseSystem:
    """J̄ of a scheme on a problem; a `newmark_cli.newmark.linear.systems.LinearSystem`."""

    def __init__(self, problem: Problem, scheme: Scheme) -> None:
        self.problem, self.scheme = problem, scheme
        self.mass = problem.M
        self.constraining = constraining_of(problem, scheme)

    def times_mass(self, vector: Array) -> Array:
        """M times (n,)."""
        return product(self.mass, vector)

    def solve(self, values: Values, rhs: Array, tangents: Tangents | None = None) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular."""
        return Factors(self._scaled(values, tangents)).solve(rhs)

    def matrix(self, values: Values, tangents: Tangents | None = None) -> scipy.sparse.csc_array:
        """J̄, the numbers that `solve` takes, without its zeros."""
        return scipy.sparse.csc_array(self._scaled(values, tangents))

    def _scaled(self, values: Values, tangents: Tangents | None) -> Array:
        terms = self.problem.dense(values)
        return scaled_jacobian(self.scheme, terms, self.mass, self.constraining, tangents)

    def balanced(self, t: float, state: State) -> BalancedJacobian:
        """J̄ at a state, to be solved accurately."""
        return BalancedJacobian(self.problem, self.scheme, t, state)
