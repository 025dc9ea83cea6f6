"""Condition numbers of one Jacobian under any diagonal scaling, and equilibration.

J is scaled so that its blocks, rows and columns are of one size before it is inverted, and the
inverse is brought to each scaling asked for factor by factor.  So the condition number of
D_L J D_R is accurate far beyond 1/eps, as that of `newmark_cli.newmark.linear.dense`, for
Jacobians of which nothing is known, too.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import lsqr

from newmark_cli.problems.algebra import LU, spectral_norm
from newmark_cli.support.arrays import Array

_MOST_SWEEPS = 50
#: Entries this much smaller than all others in their row or column are zeros, rounded.
_NOISE = 1e-13


def block_factors(sizes: Array) -> tuple[Array, Array]:
    """Factors (k,) of rows and of columns that bring blocks as near to one size as can be.

    Least squares of logarithms of (k, k) sizes; those of 0 do not count.  By entries that is the
    scaling of Curtis & Reid (1972).  Taking largest entries only, M would stay small next to a
    large G, and the motion that the constraints allow with it.
    """
    rows, columns = np.nonzero(sizes)
    size = len(sizes)
    system = np.zeros((len(rows), 2 * size))
    system[np.arange(len(rows)), rows] = system[np.arange(len(rows)), size + columns] = 1
    factors = np.exp2(np.linalg.lstsq(system, -np.log2(sizes[rows, columns]), rcond=None)[0])
    return factors[:size], factors[size:]


def block_sizes(matrix: Array, counts: Sequence[int]) -> Array:
    """(k, k) 2-norms of the blocks of a matrix."""
    edges = [*pairwise(np.cumsum([0, *counts]))]
    return np.array(
        [[spectral_norm(matrix[i:j, begin:end]) for begin, end in edges] for i, j in edges]
    )


def equilibrium(matrix: Array, counts: Sequence[int]) -> tuple[Array, Array]:
    """Factors that bring entries as near to one size as can be, and none far above 1.

    First blocks, then entries (Curtis & Reid 1972), then the largest of each row and column
    (Ruiz 2001).  The factors are powers of two, so that nothing is rounded, and equal for rows
    and columns where the sizes of the entries are symmetric.  A row or column of zeros keeps 1.
    """
    of_blocks = block_factors(block_sizes(matrix, counts))
    rows, columns = (np.log2(np.repeat(factors, counts)) for factors in of_blocks)
    with np.errstate(divide="ignore"):
        size = np.log2(np.abs(matrix))
    even = rows[:, None] + size + columns[None, :]
    # What is rounding of zero has no size.
    noise = np.minimum(even.max(axis=1)[:, None], even.max(axis=0)[None, :]) + np.log2(_NOISE)
    places = np.nonzero(np.isfinite(even) & (even > noise))
    count, total = len(places[0]), len(matrix)
    sums = csr_array(
        (
            np.ones(2 * count),
            (np.tile(np.arange(count), 2), np.concatenate([places[0], total + places[1]])),
        ),
        (count, 2 * total),
    )
    exponents = lsqr(sums, -even[places], atol=1e-6, btol=1e-6)[0]
    rows, columns = rows + exponents[:total], columns + exponents[total:]
    for _ in range(_MOST_SWEEPS):
        even = rows[:, None] + size + columns[None, :]
        in_rows, in_columns = even.max(axis=1), even.max(axis=0)
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

    def __init__(self, jacobian: Array, counts: Sequence[int]) -> None:
        """Invert a matrix (N, N) with blocks of these sizes."""
        self.jacobian = jacobian
        self.rows, self.columns = equilibrium(jacobian, counts)
        even = self.rows[:, None] * jacobian * self.columns[None, :]
        if not is_regular(even):
            raise np.linalg.LinAlgError("Singular matrix")
        self._inverse = LU(even).inverse()

    def inverse(self) -> Array:
        """(N, N) J⁻¹."""
        return np.asarray(self.columns[:, None] * self._inverse * self.rows[None, :])

    def condition(self, left: Array | float = 1.0, right: Array | float = 1.0) -> float:
        """2-norm condition number of D_L J D_R, from (N,) factors of rows and columns."""
        size = len(self.jacobian)
        left, right = np.broadcast_to(left, size), np.broadcast_to(right, size)
        scaled = left[:, None] * self.jacobian * right[None, :]
        inverse = (self.columns / right)[:, None] * self._inverse * (self.rows / left)[None, :]
        return spectral_norm(scaled) * spectral_norm(inverse)


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
    """[M −G; Gᵀ 0] with rows and columns of one size."""
    m = gradient.shape[1]
    matrix = np.block([[mass, -gradient], [gradient.T, np.zeros((m, m))]])
    rows, columns = equilibrium(matrix, [len(mass), m])
    return np.asarray(rows[:, None] * matrix * columns[None, :])
