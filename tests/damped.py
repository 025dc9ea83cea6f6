"""A problem with everything in row D: stiffness, damping, a full mass matrix.

Three coordinates on an ellipsoid; f is linear in u and v, with matrices in
general position, and depends on time.  It is compiled like any problem, but knows no mechanism.
"""

import numpy as np
from numba import njit

from newmark_cli.problems.problem import Pattern, Problem

MASS = np.array([[2.0, 0.5, 0.0], [0.5, 3.0, -0.4], [0.0, -0.4, 1.5]])
STIFFNESS = np.array([[60.0, 10.0, -7.0], [4.0, 80.0, 3.0], [-2.0, 9.0, 50.0]])
DAMPING = np.array([[5.0, -3.0, 1.0], [2.0, 7.0, -1.5], [0.5, 1.0, 4.0]])


@njit(cache=True)
def evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    phi[0] = -0.5
    for i in range(3):
        weight = 1.0 + i
        phi[0] += weight * u[i] * u[i] / 2
        g_values[i] = weight * u[i]
        force[i] = multipliers[0] * weight * u[i] + 2.0 * np.sin(3.0 * t + i)
        for j in range(3):
            force[i] -= reals[i, j] * u[j] + reals[3 + i, j] * v[j]
            x_values[3 * i + j] = reals[i, j]
            y_values[3 * i + j] = reals[3 + i, j]
        x_values[4 * i] -= multipliers[0] * weight


@njit(cache=True)
def derivatives(t, u, v, w, ints, reals, rate, curvature, r_values, q_values):
    rate[0] = curvature[0] = 0.0
    for i in range(3):
        curvature[0] += (1.0 + i) * v[i] * v[i]
        r_values[i] = (1.0 + i) * v[i]
        q_values[i] = (1.0 + i) * w[i]


def damped():
    """The problem, moving from a point on the quadric."""
    rows, columns = (index.ravel().astype(np.int64) for index in np.indices((3, 3)))
    index, zeros = np.arange(3), np.zeros(3, np.int64)
    return Problem(
        name="damped",
        u0=np.array([1.0, 0.0, 0.0]),
        v0=np.array([0.0, 1.0, -0.5]),
        t0=0.0,
        constraints=1,
        function=evaluate,
        derivatives=derivatives,
        ints=np.zeros((1, 1), np.int64),
        reals=np.concatenate([STIFFNESS, DAMPING]),
        pattern=Pattern(rows, columns, rows, columns, rows, columns, index, zeros),
        mass_values=MASS.ravel(),
    )
