"""Jacobian matrices and their condition numbers, block by block as in the paper.

The engines' own assembly is checked against this literal one.
"""

import warnings

import numpy as np
import scipy.linalg

from newmark_cli.arrays import Array
from newmark_cli.newmark.integrator import FIELDS, Relations
from newmark_cli.newmark.scaling import sensitivity
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.tables import State
from newmark_cli.problems.problem import Problem, Terms, Values

Blocks = dict[str, dict[str, Array]]


def four_field(terms: Terms, mass_matrix: Array, relations: Relations) -> Blocks:
    """Blocks of the Jacobian of the (u, v, a, λ) form, row → column → block."""
    n, m = terms.G.shape
    identity, zero = np.eye(n), np.zeros((n, n))
    none = np.zeros((n, m))
    return {
        "D": {
            "u": terms.X,
            "v": terms.Y,
            "a": relations.acceleration[0] * mass_matrix,
            "lambda": -terms.G,
        },
        "V": {"u": zero, "v": identity, "a": -relations.v_from_a * identity, "lambda": none},
        "K": {"u": identity, "v": zero, "a": -relations.u_from_a * identity, "lambda": none},
        "C": {"u": terms.G.T, "v": none.T, "a": none.T, "lambda": np.zeros((m, m))},
    }


def form_blocks(scheme: Scheme, terms: Terms, mass_matrix: Array) -> list[list[Array]]:
    """Blocks of a form's Jacobian: columns combined by its weights, rows selected."""
    full = four_field(terms, mass_matrix, scheme.relations)

    def combined(row: str, weights: Array) -> Array:
        # Field by field, so that a sparse assembly can add the same numbers alike.
        u, v, a = (weight * full[row][f] for weight, f in zip(weights, FIELDS, strict=True))
        return np.asarray(u + v + a)

    return [
        [*(combined(row, weights) for weights in scheme.elimination.weights.T), full[row]["lambda"]]
        for row in scheme.form.rows
    ]


def scaled_jacobian(scheme: Scheme, terms: Terms, mass_matrix: Array) -> Array:
    """J̄ = D_L J D_R as one matrix."""
    n, m = terms.G.shape
    left, right = scaling_factors(scheme, n, m)
    jacobian = np.block(form_blocks(scheme, terms, mass_matrix))
    return np.asarray(left[:, None] * jacobian * right[None, :])


def scaling_factors(scheme: Scheme, n: int, m: int) -> tuple[Array, Array]:
    """D_L and D_R, a factor for each row and each unknown."""
    sizes = [n] * len(scheme.form.kept) + [m]
    return np.repeat(scheme.left, sizes), np.repeat(scheme.right, sizes)


def balancing_factors(scheme: Scheme, n: int, m: int) -> tuple[Array, Array]:
    """Factors that balance the blocks: by the sensitivities to displacement."""
    balanced = sensitivity(scheme.form)
    values = scheme.integrator.symbols(scheme.h)
    sizes = [n] * len(scheme.form.kept) + [m]
    return (
        np.repeat([balanced.left[row](values) for row in scheme.form.rows], sizes),
        np.repeat([balanced.right[unknown](values) for unknown in scheme.form.unknowns], sizes),
    )


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
        jacobian = np.block(form_blocks(scheme, terms, problem.M))
        left, right = scaling_factors(scheme, n, m)
        row_balance, column_balance = balancing_factors(scheme, n, m)
        self.size = len(jacobian)
        self.scaled = left[:, None] * jacobian * right[None, :]
        self._balanced = row_balance[:, None] * jacobian * column_balance[None, :]
        self._columns = column_balance / right
        self._rows = row_balance / left

    def solve(self, rhs: Array) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular."""
        return np.asarray(self._columns * np.linalg.solve(self._balanced, self._rows * rhs))

    def inverse(self) -> Array:
        """J̄⁻¹; raises numpy.linalg.LinAlgError when J̄ is singular."""
        inverse = np.linalg.inv(self._balanced)
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
        return float(np.linalg.norm(self.scaled, 2) * np.linalg.norm(inverse, 2))


def dense_lu(matrix: Array, rhs: Array) -> Array:
    """Solve by LAPACK's LU factorisation with partial pivoting.

    Raises:
        numpy.linalg.LinAlgError: When a pivot is exactly zero.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", scipy.linalg.LinAlgWarning)
        try:
            factors = scipy.linalg.lu_factor(matrix, check_finite=False)
        except scipy.linalg.LinAlgWarning as warning:
            raise np.linalg.LinAlgError(str(warning)) from None
    return np.asarray(scipy.linalg.lu_solve(factors, rhs, check_finite=False))


class DenseSystem:
    """J̄ of a scheme on a problem; a `newmark_cli.newmark.linear.LinearSystem`."""

    def __init__(self, problem: Problem, scheme: Scheme) -> None:
        self.problem, self.scheme = problem, scheme
        self.mass = problem.M

    def times_mass(self, vector: Array) -> Array:
        """M times (n,)."""
        return np.asarray(self.mass @ vector)

    def solve(self, values: Values, rhs: Array) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular."""
        return dense_lu(scaled_jacobian(self.scheme, self.problem.dense(values), self.mass), rhs)

    def balanced(self, t: float, state: State) -> BalancedJacobian:
        """J̄ at a state, to be solved accurately."""
        return BalancedJacobian(self.problem, self.scheme, t, state)


def condition_number(problem: Problem, scheme: Scheme, t: float, state: State) -> float:
    """2-norm condition number at a state; see `BalancedJacobian.condition`."""
    return BalancedJacobian(problem, scheme, t, state).condition()
