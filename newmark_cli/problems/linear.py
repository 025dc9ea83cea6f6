"""A problem from its matrices at one state, linear around it."""

from functools import partial

import numpy as np

from newmark_cli.problems.problem import Pattern, Problem
from newmark_cli.support.arrays import Array


def linear_problem(
    name: str, matrices: tuple[Array, Array, Array, Array], state: tuple[Array, Array, Array, Array]
) -> Problem:
    """M v' = c − X u − Y v + G λ, Gᵀ u = d, with the c and d for which a state solves them.

    Constraints and forces are evaluated as products with the unknowns themselves, which
    round as those of the mechanism do whose matrices they are.  Matrices are M, X, Y (n, n) and
    G (n, m), the state is u, v, a (n,) and λ (m,).
    """
    mass, x, y, g = matrices
    u, v, a, multipliers = state
    n, m = g.shape
    constant = mass @ a - g @ multipliers + x @ u + y @ v
    rows, columns = (index.ravel() for index in np.indices((n, n)))
    g_rows, g_columns = (index.ravel() for index in np.indices((n, m)))
    return Problem(
        name=name,
        u0=u,
        v0=v,
        t0=0.0,
        constraints=m,
        function=partial(_function, n, m),
        derivatives=_derivatives,
        ints=np.zeros((1, 1), np.int64),
        reals=np.concatenate([part.ravel() for part in (x, y, g, constant, g.T @ u)])[None, :],
        pattern=Pattern(rows, columns, rows, columns, rows, columns, g_rows, g_columns),
        mass_values=mass.ravel(),
        compiled=False,
        quadratic=True,
        single=True,
    )


def _function(n: int, m: int, t, u, v, multipliers, ints, reals, force, phi, x, y, g) -> None:  # type: ignore[no-untyped-def]
    ends = np.cumsum([n * n, n * n, n * m, n])
    x[:], y[:], g[:], constant, target = np.split(reals[0], ends)
    gradient = g.reshape(n, m)
    force[:] = constant - x.reshape(n, n) @ u - y.reshape(n, n) @ v + gradient @ multipliers
    phi[:] = gradient.T @ u - target


def _derivatives(t, u, v, w, ints, reals, rate, curvature, r, q) -> None:  # type: ignore[no-untyped-def]
    for result in (rate, curvature, r, q):
        result[:] = 0
