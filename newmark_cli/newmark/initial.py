"""Consistent initial accelerations and multipliers."""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.sparse import csr_array

from newmark_cli.arrays import Array
from newmark_cli.newmark.kernel import State
from newmark_cli.newmark.linear import DENSE_UP_TO
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.sparse import index_1_solver
from newmark_cli.problems.problem import Problem


def consistent_accelerations(problem: Problem, t: float, u: Array, v: Array) -> tuple[Array, Array]:
    """Accelerations and multipliers that follow from u, v: the index-1 system.

    Solves  M a − G λ = f,  Gᵀ a = −(second derivative of Φ along u'' = 0).

    Args:
        problem: The problem.
        t: Time (s).
        u, v: (n,) coordinates and velocities that meet Φ = 0 and Φ' = 0.

    Returns:
        a (n,) and λ (m,).

    Raises:
        numpy.linalg.LinAlgError: When the index-1 matrix is singular.
    """
    n, m = problem.n, problem.m
    values = problem.values(t, u, v, np.zeros(m))
    # M of Andrews' mechanism is 1e-5, G 1e-2: scaling the multipliers by ‖M‖
    # keeps the matrix well conditioned.
    size = float(np.abs(problem.mass_values).max())
    _, curvature = problem.constraint_derivatives(t, u, v)
    rhs = np.concatenate([values.force / size, -curvature])
    matrix: Array | csr_array
    solve: Callable[[Array], Array]
    if n + m <= DENSE_UP_TO:
        g = problem.dense(values).G
        matrix = np.block([[problem.M / size, -g], [g.T, np.zeros((m, m))]])
        solve = partial(np.linalg.solve, matrix)
    else:
        matrix, solve = index_1_solver(problem, values, size)
    solution = solve(rhs)
    solution += solve(rhs - matrix @ solution)
    return solution[:n], solution[n:] * size


def initial_state(problem: Problem, scheme: Scheme) -> State:
    """State of the march at the initial time, in the scheme's precision.

    Φ is carried from 0 on in compensated evaluation: the start meets the
    constraints by definition, not just to the rounding of its coordinates.
    """
    a, multipliers = consistent_accelerations(problem, problem.t0, problem.u0, problem.v0)
    fields = np.array([problem.u0, problem.v0, a, a])
    past = scheme.relations.start @ fields[:3]
    dtype = scheme.dtype
    return State(
        fields.astype(dtype),
        past.astype(dtype),
        multipliers.astype(dtype),
        lows=np.zeros((2, problem.n), dtype),
        phi=np.zeros(problem.m, dtype),
    )
