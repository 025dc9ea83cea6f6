"""Constraints that depend on each other in large problems: null spaces of a sparse G.

GᵀG + δ is factorised, δ far below the square of any singular value of G that is not rounding
and far above its rounding.  Its inverse enlarges null vectors by 1/δ and all others by less.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

_DAMPING = 1e-12
#: Null vectors that are looked for at first, and numbers in those of all.
_FIRST, _MOST = 8, 200_000_000
#: Applications of the inverse: each leaves δ/σ² of what belongs to a singular value σ.
_TIMES = 3
_SEED = 20061012
#: Largest ‖G x‖ of a null vector: what is left of other vectors, if columns have length 1.
_NULL = 1e-7


def gradient_of(problem: Problem, u: Array) -> scipy.sparse.csc_array:
    """(n, m) sparse G at the initial time and coordinates u (n,)."""
    n, m, pattern = problem.n, problem.m, problem.pattern
    values = problem.values(problem.t0, u, np.zeros(n), np.zeros(m)).g
    return scipy.sparse.csc_array((values, (pattern.g_rows, pattern.g_columns)), shape=(n, m))


def column_norms(gradient: scipy.sparse.csc_array) -> Array:
    """(m,) 2-norms of the columns."""
    return np.asarray(np.sqrt(gradient.multiply(gradient).sum(axis=0))).ravel()


def _factors(gradient: scipy.sparse.csc_array, damping: float) -> scipy.sparse.linalg.SuperLU:
    square = gradient.T @ gradient + damping * scipy.sparse.eye_array(gradient.shape[1])
    options = {"SymmetricMode": True}
    return scipy.sparse.linalg.splu(
        scipy.sparse.csc_matrix(square), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
        options=options,
    )  # fmt: skip


def null_space(gradient: scipy.sparse.csc_array, tolerance: float) -> Array:
    """(m, k) orthonormal vectors x with G x = 0, of (n, m) G with columns of length 1.

    The tolerance is the largest singular value that is rounding, relative to the largest; at
    least 1e-7 is taken for it.

    Raises:
        MemoryError: When there are so many that they do not fit.
    """
    m = gradient.shape[1]
    factors, random = _factors(gradient, _DAMPING), np.random.default_rng(_SEED)
    count = min(_FIRST, m)
    while True:
        if count * m > _MOST:
            raise MemoryError(f"more than {count // 2} constraints depend on each other")
        vectors = random.normal(size=(m, count))
        for _ in range(_TIMES):
            vectors = np.linalg.qr(factors.solve(vectors))[0]
        _, values, turned = np.linalg.svd(gradient @ vectors, full_matrices=False)
        null = values <= max(tolerance * np.sqrt(m), _NULL)
        if not null.all() or count == m:
            return np.asarray((vectors @ turned.T)[:, null])
        count = min(4 * count, m)


def along_null(gradient: scipy.sparse.csc_array, vector: Array) -> Array:
    """(n,) the part of a vector (n,) that Gᵀ takes to 0."""
    return np.asarray(vector - least_change(gradient, gradient.T @ vector))


def least_change(gradient: scipy.sparse.csc_array, wanted: Array) -> Array:
    """(n,) the smallest d with Gᵀd next to what is wanted (m,)."""
    sizes = column_norms(gradient)
    sizes[sizes == 0] = 1.0
    scaled, wanted = scipy.sparse.csc_array(gradient / sizes[None, :]), wanted / sizes
    solve, change = _factors(scaled, _DAMPING).solve, np.zeros(gradient.shape[0])
    for _ in range(2):
        change = change + np.asarray(scaled @ solve(wanted - scaled.T @ change), float)
    return change


def dependence(kept: scipy.sparse.csc_array, others: Array) -> tuple[Array, Array]:
    """How columns (n, k) depend on independent ones (n, m) of length 1, and what does not (n, k).

    (m, k) coefficients of least squares.
    """
    solve, coefficients = _factors(kept, _DAMPING).solve, np.zeros((kept.shape[1], others.shape[1]))
    for _ in range(2):
        coefficients = coefficients + solve(kept.T @ (others - kept @ coefficients))
    return coefficients, np.asarray(others - kept @ coefficients)


def gaps(
    whole: Problem, released: Sequence[int], lengths: Array, t: float, u: Array
) -> tuple[float, str, float]:
    """`newmark_cli.problems.problem.Problem.gaps` of released constraints of the whole problem.

    Values are divided by (m,) lengths, so that 1 is the size of the mechanism, or one radian.
    """
    away = np.abs(whole.constraint_values(t, u)) / lengths
    kept = float(np.delete(away, released).max(initial=0.0))
    worst = released[int(np.argmax(away[list(released)]))]
    return float(away[worst]), whole.constraint_names[worst], kept
