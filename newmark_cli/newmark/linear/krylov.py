"""Krylov solvers: J̄ q̄ = rhs by products with J̄ alone.

D_L and D_R are their only preconditioners, so that the iterations they take, and
whether they reach their tolerance at all, show what the scaling does.

The tolerance is on the residual in balanced rows (`jacobian.balancing_factors`), the
same in every scaling.  In rows of its own an unscaled system looks solved when it is
not: at h = 1e-6 rows D are 1e12 times rows C, and GMRES reports a residual of 1e-8
for 1000 random links after 14 iterations, 90 % of the constraints' still there.
"""

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from newmark_cli.newmark.constraints import Tangents
from newmark_cli.newmark.jacobian import balancing_factors, scaling_factors
from newmark_cli.newmark.linear.choice import Krylov, Stagnation
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.algebra import LU, norm, product
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array

_EPS = float(np.finfo(float).eps)


class KrylovSystem(SparseSystem):
    """J̄ of a scheme on a problem; a `newmark_cli.newmark.linear.solvers.LinearSystem`.

    GMRES (Saad & Schultz 1986) with its whole basis, which takes memory for ``limit`` vectors.

    Attributes:
        iterations: Iterations of each solve so far, failed ones included.
        residuals: ‖B(rhs − J̄ q̄)‖/‖B rhs‖ that each achieved, evaluated from its
            solution; B takes the scaled rows to balanced ones, and is 1 under the
            optimal scaling but for a factor β/γ in row D of the (v, λ) form.
    """

    def __init__(self, problem: Problem, scheme: Scheme, options: Krylov) -> None:
        """Take when to stop."""
        super().__init__(problem, scheme)
        self._options = options
        balanced, _ = balancing_factors(scheme, problem.n, problem.m)
        left, _ = scaling_factors(scheme, problem.n, problem.m)
        self._rows = balanced / left
        self.iterations: list[int] = []
        self.residuals: list[float] = []

    def solve(self, values: Values, rhs: Array, tangents: Tangents | None = None) -> Array:
        """Solution of J̄ q̄ = rhs; NaN, and not counted, where one of them is not finite."""
        entries = self.scaled_entries(values, tangents)
        matrix = scipy.sparse.csr_array((entries, (self.rows, self.columns)), (self.size,) * 2)
        if not (np.all(np.isfinite(rhs)) and np.all(np.isfinite(matrix.data))):
            return np.full_like(rhs, np.nan)
        # Squares of what is solved for must not underflow.
        unit = float(np.max(np.abs(rhs))) or 1.0
        target = rhs / unit
        size = norm(self._rows * target)
        wanted = self._options.tolerance * size
        solution, iterations = _gmres(matrix, target, self._rows, wanted, self._options.limit)
        residual = norm(self._rows * (target - matrix @ solution))
        self.iterations.append(iterations)
        self.residuals.append(residual / (size or 1.0))
        if not residual <= wanted:
            raise Stagnation(
                f"residual {self.residuals[-1]:.1e} after {iterations} iterations, "
                f"tolerance {self._options.tolerance:g}"
            )
        return np.asarray(unit * solution)


def _gmres(
    matrix: scipy.sparse.csr_array, rhs: Array, rows: Array, wanted: float, limit: int
) -> tuple[Array, int]:
    """GMRES, restarted where a residual is larger than its recurrence has it.

    That happens only where J̄ is too badly scaled for the recurrence; when a restart does not
    reduce the residual it gives up.  SciPy's can stop only by the residual in its own rows.
    """
    solution, iterations = np.zeros_like(rhs), 0
    residual, size = rhs, norm(rows * rhs)
    while size > wanted and iterations < limit:
        change, taken = _gmres_cycle(matrix, residual, rows, wanted, limit - iterations)
        iterations += taken
        residual = rhs - matrix @ (solution + change)
        before, size = size, norm(rows * residual)
        if not size < before:
            break
        solution += change
    return solution, iterations


def _gmres_cycle(
    matrix: scipy.sparse.csr_array, rhs: Array, rows: Array, wanted: float, limit: int
) -> tuple[Array, int]:
    """GMRES from zero, with Givens rotations, by the residual of its recurrence.

    The recurrence r ← s² r − s c γ v of the residual, v the new basis vector and γ the
    residual's signed norm, is that of Saad, "Iterative methods for sparse linear
    systems" (2003), Section 6.5.
    """
    limit = min(limit, len(rhs))
    basis = np.empty((limit + 1, len(rhs)))
    # The QR factors of the Hessenberg matrix, Q transposed.
    triangle, rotations = np.zeros((limit, limit)), np.zeros((limit + 1, limit + 1))
    size = norm(rhs)
    basis[0], rotations[0, 0], residual = rhs / size, 1.0, rhs
    columns = 0
    for k in range(limit):
        vector = matrix @ basis[k]
        before = norm(vector)
        column = np.zeros(k + 1)
        # Gram and Schmidt: once loses orthogonality, twice is enough.
        for _ in range(2):
            part = product(basis[: k + 1], vector)
            vector -= product(part, basis[: k + 1])
            column += part
        after = norm(vector)
        rotated = product(rotations[: k + 1, : k + 1], column)
        diagonal = np.hypot(rotated[k], after)
        if diagonal == 0:  # J̄ is singular, and the rest of the right-hand side out of reach.
            break
        triangle[:k, k], triangle[k, k] = rotated[:k], diagonal
        cosine, sine = rotated[k] / diagonal, after / diagonal
        rotations[k + 1] = -sine * rotations[k]
        rotations[k + 1, k + 1] = cosine
        rotations[k] *= cosine
        rotations[k, k + 1] = sine
        columns = k + 1
        if after <= _EPS * before:
            break
        basis[k + 1] = vector / after
        residual = sine**2 * residual + cosine * size * rotations[k + 1, 0] * basis[k + 1]
        if norm(rows * residual) <= wanted:
            break
    if columns == 0:
        return np.zeros_like(rhs), 1
    weights = LU(triangle[:columns, :columns]).solve(size * rotations[:columns, 0])
    return product(weights, basis[:columns]), columns
