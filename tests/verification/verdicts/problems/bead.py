"""A bead on a surface in space: a bowl, which is quadratic, and a wavy floor, which is not."""

import numpy as np
from numba import njit

from newmark_cli.problems.python_problem import Definition


@njit
def force(u, v, t):
    """f."""
    return np.array([0.0, 0.0, -9.81])


@njit
def bowl_constraints(u, t):
    """Φ."""
    return np.array([u[2] - (u[0] * u[0] + 2 * u[1] * u[1]) / 2])


@njit
def bowl_gradient(u, t):
    """G."""
    return np.array([[-u[0]], [-2 * u[1]], [1.0]])


@njit
def floor_constraints(u, t):
    """Φ."""
    return np.array([u[2] - 0.2 * np.sin(3 * u[0]) * np.cos(2 * u[1])])


@njit
def floor_gradient(u, t):
    """G."""
    return np.array(
        [
            [-0.6 * np.cos(3 * u[0]) * np.cos(2 * u[1])],
            [0.4 * np.sin(3 * u[0]) * np.sin(2 * u[1])],
            [1.0],
        ]
    )


def bowl():
    """Circling in the bowl."""
    return Definition(
        mass_matrix=0.5 * np.eye(3),
        u0=np.array([1.0, 0.0, 0.5]),
        v0=np.array([0.0, 1.5, 0.0]),
        force=force,
        constraints=bowl_constraints,
        gradient=bowl_gradient,
        quadratic=True,
    )


def floor():
    """Let go on the floor, at rest."""
    x, y = 0.3, 0.2
    return Definition(
        mass_matrix=0.5 * np.eye(3),
        u0=np.array([x, y, 0.2 * np.sin(3 * x) * np.cos(2 * y)]),
        v0=np.zeros(3),
        force=force,
        constraints=floor_constraints,
        gradient=floor_gradient,
    )
