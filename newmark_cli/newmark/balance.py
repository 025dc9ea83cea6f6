"""Condition numbers of one Jacobian under any diagonal scaling, and equilibration.

J is scaled so that its rows and columns are of one size before it is inverted, and the
inverse is brought to each scaling asked for factor by factor.  So the condition number of
D_L J D_R is accurate far beyond 1/eps, as that of `newmark_cli.newmark.linear.dense`, for
Jacobians of which nothing is known, too.
"""

import numpy as np

from newmark_cli.arrays import Array

_MOST_SWEEPS = 50


def equilibrium(matrix: Array) -> tuple[Array, Array]:
    """Factors that bring the largest entry of each row and column near 1 (Ruiz 2001).

    They are powers of two, so that nothing is rounded, and equal for rows and columns
    where the sizes of the entries are symmetric.  A row or column of zeros keeps 1.

    Args:
        matrix: (N, N).

    Returns:
        (N,) factors of the rows and (N,) factors of the columns.
    """
    with np.errstate(divide="ignore"):
        size = np.log2(np.abs(matrix))
    rows, columns = np.zeros(len(matrix)), np.zeros(len(matrix))
    for _ in range(_MOST_SWEEPS):
        now = rows[:, None] + size + columns[None, :]
        in_rows, in_columns = now.max(axis=1), now.max(axis=0)
        in_rows[np.isinf(in_rows)] = in_columns[np.isinf(in_columns)] = 0
        if max(np.abs(in_rows).max(), np.abs(in_columns).max()) < 0.1:
            break
        rows, columns = rows - in_rows / 2, columns - in_columns / 2
    return np.exp2(np.rint(rows)), np.exp2(np.rint(columns))


class Inverted:
    """A Jacobian and its inverse, for condition numbers under many scalings.

    Raises:
        numpy.linalg.LinAlgError: The matrix is singular to rounding.
    """

    def __init__(self, jacobian: Array) -> None:
        self.jacobian = jacobian
        self.rows, self.columns = equilibrium(jacobian)
        even = self.rows[:, None] * jacobian * self.columns[None, :]
        self._inverse = np.linalg.inv(even)
        if not is_regular(even):
            raise np.linalg.LinAlgError("Singular matrix")

    def condition(self, left: Array | float = 1.0, right: Array | float = 1.0) -> float:
        """2-norm condition number of D_L J D_R.

        Args:
            left, right: (N,) factors of the rows and of the columns.
        """
        size = len(self.jacobian)
        left, right = np.broadcast_to(left, size), np.broadcast_to(right, size)
        scaled = left[:, None] * self.jacobian * right[None, :]
        inverse = (self.columns / right)[:, None] * self._inverse * (self.rows / left)[None, :]
        return float(np.linalg.norm(scaled, 2) * np.linalg.norm(inverse, 2))


def is_regular(matrix: Array) -> bool:
    """Whether a matrix with rows and columns of one size has full rank beyond rounding."""
    if 0 in matrix.shape:
        return True
    values = np.linalg.svd(matrix, compute_uv=False)
    return bool(values[-1] > 4 * max(matrix.shape) * np.finfo(float).eps * values[0])


def has_full_rank(matrix: Array) -> bool:
    """Whether the columns of a matrix are linearly independent beyond rounding."""
    if matrix.shape[1] > matrix.shape[0]:
        return False
    sizes = np.linalg.norm(matrix, axis=0)
    return bool(np.all(sizes > 0)) and is_regular(matrix / sizes)


def saddle_point(mass: Array, gradient: Array) -> Array:
    """[M −G; Gᵀ 0] with rows and columns of one size.

    Args:
        mass: (n, n) M.
        gradient: (n, m) G.
    """
    m = gradient.shape[1]
    matrix = np.block([[mass, -gradient], [gradient.T, np.zeros((m, m))]])
    rows, columns = equilibrium(matrix)
    return np.asarray(rows[:, None] * matrix * columns[None, :])
