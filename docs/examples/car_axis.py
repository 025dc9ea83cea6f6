"""The car axis problem of the IVP test set: a problem in Python, with Φ(u, t).

Two springs carry the ends of an axis over a bumpy road: the left wheel is fixed,
the right one follows y_b(t). Coordinates are (x_l, y_l, x_r, y_r), all without units.
Source: Mazzia and Magherini, Test Set for Initial Value Problem Solvers, "Car Axis
problem", after Schneider, 1996.
"""

import numpy as np
from numba import njit

from newmark_cli import Definition

LENGTH, REST_LENGTH, EPSILON, MASS = 1.0, 0.5, 1e-2, 10.0
AMPLITUDE, FREQUENCY = 0.1, 10.0
HALF_MASS = EPSILON**2 * MASS / 2


def functions(compile_):
    """f, Φ and G, compiled or not; the tangents are left to finite differences."""

    @compile_
    def road(t):
        y = AMPLITUDE * np.sin(FREQUENCY * t)
        return np.sqrt(LENGTH**2 - y * y), y

    @compile_
    def force(u, v, t):
        x, y = road(t)
        left = np.sqrt(u[0] ** 2 + u[1] ** 2)
        right = np.sqrt((u[2] - x) ** 2 + (u[3] - y) ** 2)
        return np.array(
            [
                (REST_LENGTH - left) * u[0] / left,
                (REST_LENGTH - left) * u[1] / left - HALF_MASS,
                (REST_LENGTH - right) * (u[2] - x) / right,
                (REST_LENGTH - right) * (u[3] - y) / right - HALF_MASS,
            ]
        )

    @compile_
    def constraints(u, t):
        x, y = road(t)
        return np.array(
            [
                u[0] * x + u[1] * y,
                (u[0] - u[2]) ** 2 + (u[1] - u[3]) ** 2 - LENGTH**2,
            ]
        )

    @compile_
    def gradient(u, t):
        x, y = road(t)
        dx, dy = 2 * (u[0] - u[2]), 2 * (u[1] - u[3])
        return np.array([[x, dx], [y, dy], [0.0, -dx], [0.0, -dy]])

    return force, constraints, gradient


def car_axis(compiled=False):
    """The problem at its published start."""
    force, constraints, gradient = functions(njit if compiled else lambda function: function)
    return Definition(
        mass_matrix=HALF_MASS * np.eye(4),
        u0=np.array([0.0, 0.5, 1.0, 0.5]),
        v0=np.array([-0.5, 0.0, -0.5, 0.0]),
        force=force,
        constraints=constraints,
        gradient=gradient,
    )
