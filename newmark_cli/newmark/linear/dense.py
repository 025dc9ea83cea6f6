"""Dense Jacobians: solved by elimination with partial pivoting, and their condition numbers."""

import math
from functools import cached_property

import numpy as np

from newmark_cli.newmark.constraints import Tangents
from newmark_cli.newmark.jacobian import Balanced, Jacobian
from newmark_cli.newmark.linear import assembly
from newmark_cli.newmark.linear.assembly import Sums
from newmark_cli.newmark.march_data import MatrixTables, State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.algebra import LU, spectral_norm
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array


class BalancedJacobian(Balanced):
    """J̄ at a state, solved by dense elimination of the balanced matrix."""

    @cached_property
    def factors(self) -> LU:
        """Of the balanced matrix."""
        return LU(self.system.dense(self.balanced))

    def inverse(self) -> Array:
        """J̄⁻¹; raises numpy.linalg.LinAlgError when J̄ is singular."""
        inverse = self.factors.inverse()
        return np.asarray(self.column_factors[:, None] * inverse * self.row_factors[None, :])

    def condition(self) -> float:
        """2-norm condition number ‖J̄‖·‖J̄⁻¹‖; infinite when the matrix is singular.

        One singular value decomposition of J̄ loses the smallest singular value
        when C exceeds 1/eps; the largest one of J̄⁻¹ is always accurate.
        """
        try:
            inverse = self.inverse()
        except np.linalg.LinAlgError:
            return np.inf
        return spectral_norm(self.system.dense(self.scaled)) * spectral_norm(inverse)


def dense_tables(problem: Problem, scheme: Scheme, sums: Sums) -> MatrixTables:
    """D_L J D_R as the kernel assembles it; places count its entries row by row."""
    size, fixed = assembly.unknowns(problem, scheme), assembly.constants(problem, scheme.tables)
    constant = np.zeros(size * size, scheme.dtype)
    np.add.at(constant, fixed.rows * size + fixed.columns, fixed.values)
    return no_tables(scheme)._replace(
        constant=constant,
        places=(sums.rows * size + sums.columns).astype(np.uint32),
        origins=sums.origins.astype(np.uint32),
        coefficients=sums.coefficients,
    )


def assembled(tables: MatrixTables, scheme: Scheme, values: Values) -> Array:
    """(N, N) D_L J D_R of index 3 at a state, as the kernel assembles it."""
    sources = assembly.sources(values).astype(scheme.dtype)
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


class DenseSystem(Jacobian):
    """J̄ of a scheme on a problem; a `newmark_cli.newmark.linear.solvers.LinearSystem`."""

    def solve(self, values: Values, rhs: Array, tangents: Tangents | None = None) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular."""
        return LU(self.dense(self.scaled_entries(values, tangents))).solve(rhs)

    def balanced(self, t: float, state: State) -> BalancedJacobian:
        """J̄ at a state, to be solved accurately."""
        return BalancedJacobian(self, *self.at(t, state))
