"""G of a problem as a sparse matrix, and the gaps of constraints that were released."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse

from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array


def gradient_of(problem: Problem, u: Array) -> scipy.sparse.csc_array:
    """(n, m) sparse G at the initial time and coordinates u (n,)."""
    n, m, pattern = problem.n, problem.m, problem.pattern
    values = problem.values(problem.t0, u, np.zeros(n), np.zeros(m)).g
    return scipy.sparse.csc_array((values, (pattern.g_rows, pattern.g_columns)), shape=(n, m))


def column_norms(gradient: scipy.sparse.csc_array) -> Array:
    """(m,) 2-norms of the columns."""
    return np.asarray(np.sqrt(gradient.multiply(gradient).sum(axis=0))).ravel()


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
