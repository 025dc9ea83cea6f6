"""A charged bead on a sphere in a magnetic field, with drag that grows like v squared."""

import numpy as np
from numba import njit

from newmark_cli.problems.python_problem import Definition

FIELD, DRAG = 3.0, 0.2


@njit
def force(u, v, t):
    """f."""
    drag = DRAG * np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    return np.array([FIELD * v[1] - drag * v[0], -FIELD * v[0] - drag * v[1], -9.81 - drag * v[2]])


@njit
def constraints(u, t):
    """Φ."""
    return np.array([(u[0] * u[0] + u[1] * u[1] + u[2] * u[2] - 1.0) / 2])


@njit
def gradient(u, t):
    """G."""
    return np.array([[u[0]], [u[1]], [u[2]]])


def bead():
    """Pushed along the equator."""
    return Definition(
        mass_matrix=np.eye(3),
        u0=np.array([1.0, 0.0, 0.0]),
        v0=np.array([0.0, 2.0, 0.5]),
        force=force,
        constraints=constraints,
        gradient=gradient,
        quadratic=True,
    )
