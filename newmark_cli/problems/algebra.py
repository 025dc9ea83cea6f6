"""Dense linear algebra whose bits are the same on every processor.

BLAS and LAPACK choose the order in which they add by the processor, and rounding is what this
project measures.  Here every sum runs in one order, and nothing is contracted: results depend
on the numbers alone.  Arguments are not overwritten.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from newmark_cli.support.arrays import Array, IndexArray

#: Most unknowns for which `solver` is dense: beyond, sparse factors take less time.
DENSE_UP_TO = 120
#: Squares below this do not count in a norm of about 1.
_NEGLIGIBLE = 1e-280


class LU:
    """P A = L U by elimination with partial pivoting; the first of equal pivots is taken.

    Attributes:
        lu: (N, N) L below the diagonal, where it is 1, and U.
        order: (N,) the row of A that stands at each place.

    Raises:
        numpy.linalg.LinAlgError: When a pivot is exactly zero.
    """

    def __init__(self, matrix: Any) -> None:
        """Factorise a square matrix (N, N)."""
        self.lu = np.array(matrix, float, order="C")
        self.order: IndexArray = np.empty(len(self.lu), np.int64)
        if not _compiled(_factorise)(self.lu, self.order):
            raise np.linalg.LinAlgError("Singular matrix")

    def solve(self, rhs: Array) -> Array:
        """Solution of A x = rhs, (N,) or (N, k)."""
        solution = np.array(np.asarray(rhs, float)[self.order], order="C")
        _compiled(_substitute)(self.lu, solution.reshape(len(self.lu), -1))
        return solution

    def inverse(self) -> Array:
        """(N, N) A⁻¹."""
        return self.solve(np.eye(len(self.lu)))


def solver(matrix: Any) -> Callable[[Array], Array]:
    """Solver of A x = rhs of a sparse matrix (N, N).

    Up to `DENSE_UP_TO` unknowns it is that of `LU`, beyond SuperLU's, whose last bits are
    those of the BLAS.

    Raises:
        numpy.linalg.LinAlgError: When a pivot is exactly zero.
    """
    if matrix.shape[0] <= DENSE_UP_TO:
        return LU(matrix.toarray()).solve
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    try:
        factors = splu(csc_matrix(matrix))
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from None
    return lambda rhs: np.asarray(factors.solve(rhs), float)


def product(first: Any, second: Any) -> Array:
    """First @ second of vectors and matrices, terms added from the first to the last."""
    left, right = np.asarray(first), np.asarray(second)
    dtype = np.result_type(left, right, np.float32)
    left, right = np.ascontiguousarray(left, dtype), np.ascontiguousarray(right, dtype)
    inner = len(right)
    result = np.zeros((math.prod(left.shape[:-1]), math.prod(right.shape[1:])), dtype)
    _compiled(_multiply)(
        left.reshape(len(result), inner), right.reshape(inner, result.shape[1]), result
    )
    return result.reshape(left.shape[:-1] + right.shape[1:])


def norm(vector: Array) -> float:
    """2-norm of a vector (n,)."""
    vector = np.ravel(np.asarray(vector, float))
    return math.sqrt(product(vector, vector))


def spectral_norm(matrix: Array) -> float:
    """Largest singular value of a matrix (k, n); NaN where an entry is not finite.

    Householder's reflections make the matrix bidiagonal (Golub & Kahan 1965); the largest
    eigenvalue of [[0, B], [Bᵀ, 0]] is bisected by counts of signs.  Its relative error is a
    small multiple of the unit roundoff, however uneven the entries are.
    """
    tall = matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T
    tall = np.ascontiguousarray(tall, float)
    largest = float(np.abs(tall).max(initial=0.0))
    if not np.isfinite(largest):
        return np.nan
    if largest == 0:
        return 0.0
    # A power of two rounds nothing, and keeps squares from overflowing.
    _, exponent = np.frexp(largest)
    return float(np.ldexp(_compiled(_largest)(np.ldexp(tall, -exponent)), exponent))


@cache
def _compiled(function: Any) -> Any:
    # Numba takes long to import, and reading results does not need it.
    from newmark_cli.support.cached_code import cached_njit

    return cached_njit(nogil=True, error_model="numpy")(function)


def _factorise(lu, order):
    """Overwrite A with its factors; False at a pivot of zero."""
    n = lu.shape[0]
    for i in range(n):
        order[i] = i
    for k in range(n):
        pivot, largest = k, abs(lu[k, k])
        for i in range(k + 1, n):
            size = abs(lu[i, k])
            if size > largest:
                pivot, largest = i, size
        if largest == 0:
            return False
        if pivot != k:
            order[k], order[pivot] = order[pivot], order[k]
            for j in range(n):
                lu[k, j], lu[pivot, j] = lu[pivot, j], lu[k, j]
        for i in range(k + 1, n):
            if lu[i, k] != 0:
                factor = lu[i, k] / lu[k, k]
                lu[i, k] = factor
                for j in range(k + 1, n):
                    lu[i, j] -= factor * lu[k, j]
    return True


def _substitute(lu, x):
    """Overwrite permuted right-hand sides (N, k) with solutions."""
    n, count = x.shape
    for i in range(n):
        for j in range(i):
            factor = lu[i, j]
            if factor != 0:
                for c in range(count):
                    x[i, c] -= factor * x[j, c]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            factor = lu[i, j]
            if factor != 0:
                for c in range(count):
                    x[i, c] -= factor * x[j, c]
        for c in range(count):
            x[i, c] /= lu[i, i]


def _multiply(left, right, result):
    rows, inner = left.shape
    start = 0
    if right.shape[1] == 1:
        # Each sum waits for the term before; four at a time hide that.
        for i in range(0, rows - 3, 4):
            # Zeros of the arrays' type.
            a, b, c, d = result[i, 0], result[i + 1, 0], result[i + 2, 0], result[i + 3, 0]
            for k in range(inner):
                factor = right[k, 0]
                a += left[i, k] * factor
                b += left[i + 1, k] * factor
                c += left[i + 2, k] * factor
                d += left[i + 3, k] * factor
            result[i, 0], result[i + 1, 0], result[i + 2, 0], result[i + 3, 0] = a, b, c, d
        start = rows - rows % 4
    for i in range(start, rows):
        for k in range(inner):
            factor = left[i, k]
            for j in range(right.shape[1]):
                result[i, j] += factor * right[k, j]


def _largest(a):
    """Largest singular value of (k, n), k ≥ n, entries at most 1, which are overwritten."""
    rows, columns = a.shape
    # Diagonal and superdiagonal of B in turn, which stand beside the diagonal of
    # [[0, B], [Bᵀ, 0]] with its rows and columns shuffled.
    beside, along = np.zeros(2 * columns), np.zeros(columns)
    for k in range(columns):
        total = 0.0
        for i in range(k, rows):
            total += a[i, k] * a[i, k]
        if total > _NEGLIGIBLE:
            beside[2 * k] = np.sqrt(total)
            a[k, k] += np.copysign(beside[2 * k], a[k, k])
            half = beside[2 * k] * abs(a[k, k])
            along[k + 1 :] = 0
            for i in range(k, rows):
                for j in range(k + 1, columns):
                    along[j] += a[i, k] * a[i, j]
            for i in range(k, rows):
                factor = a[i, k] / half
                for j in range(k + 1, columns):
                    a[i, j] -= factor * along[j]
        total = 0.0
        for j in range(k + 1, columns):
            total += a[k, j] * a[k, j]
        if total > _NEGLIGIBLE:
            beside[2 * k + 1] = np.sqrt(total)
            a[k, k + 1] += np.copysign(beside[2 * k + 1], a[k, k + 1])
            half = beside[2 * k + 1] * abs(a[k, k + 1])
            for i in range(k + 1, rows):
                factor = 0.0
                for j in range(k + 1, columns):
                    factor += a[i, j] * a[k, j]
                factor /= half
                for j in range(k + 1, columns):
                    a[i, j] -= factor * a[k, j]
    low, high = 0.0, 0.0
    for k in range(2 * columns):
        low = max(low, beside[k])
        high = max(high, beside[k] + beside[max(k - 1, 0)])
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        # No eigenvalue is larger if all pivots of the matrix less the middle are negative.
        pivot = -middle
        for k in range(2 * columns - 1):
            pivot = -middle - beside[k] * beside[k] / pivot
            if pivot >= 0:
                break
        if pivot < 0:
            high = middle
        else:
            low = middle
