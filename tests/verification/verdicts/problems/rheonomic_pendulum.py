"""A pendulum whose pivot is shaken up and down: constraints that depend on time."""

import numpy as np
from numba import njit

from newmark_cli.problems.python_problem import Definition

AMPLITUDE, FREQUENCY = 0.1, 5.0


@njit
def force(u, v, t):
    """f."""
    return np.array([0.0, -9.81])


@njit
def constraints(u, t):
    """Φ."""
    y = u[1] - AMPLITUDE * np.sin(FREQUENCY * t)
    return np.array([(u[0] * u[0] + y * y - 1.0) / 2])


@njit
def gradient(u, t):
    """G."""
    return np.array([[u[0]], [u[1] - AMPLITUDE * np.sin(FREQUENCY * t)]])


def pendulum():
    """Released from 53 degrees while the pivot moves."""
    return Definition(
        mass_matrix=np.eye(2),
        u0=np.array([0.8, -0.6]),
        v0=np.array([0.0, AMPLITUDE * FREQUENCY]),
        force=force,
        constraints=constraints,
        gradient=gradient,
    )
