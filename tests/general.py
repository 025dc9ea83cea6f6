"""A problem in general position: full M, X, Y and G, several constraints, all compiled.

Φ_k = ½ uᵀS_k u + b_k·u − c_k, and in its hard version also a cubic term and one that depends
on time.  Everything is smooth enough for complex arguments, so that a test can differentiate
by a complex step.
"""

from dataclasses import replace

import numpy as np
from numba import njit

from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Pattern, Problem

N, M = 5, 2


@njit(cache=True)
def evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    n, m, cubic = u.shape[0], phi.shape[0], reals[0, 0]
    wave = reals[0, 1] * np.sin(2.0 * t + 0.3)
    for i in range(n):
        force[i] = np.cos(3.0 * t + i)
        for j in range(n):
            force[i] -= reals[1 + i, j] * u[j] + reals[1 + n + i, j] * v[j]
            x_values[n * i + j] = reals[1 + i, j]
            y_values[n * i + j] = reals[1 + n + i, j]
    for k in range(m):
        b = 1 + (2 + m) * n + k
        phi[k] = -reals[0, 2 + k]
        for i in range(n):
            s = 1 + (2 + k) * n + i
            gradient = reals[b, i] + cubic * u[i] * u[i] + wave * (1.0 + k + i)
            phi[k] += u[i] * (reals[b, i] + wave * (1.0 + k + i) + cubic * u[i] * u[i] / 3.0)
            for j in range(n):
                gradient += reals[s, j] * u[j]
                phi[k] += u[i] * reals[s, j] * u[j] / 2.0
                x_values[n * i + j] -= multipliers[k] * reals[s, j]
            x_values[n * i + i] -= multipliers[k] * 2.0 * cubic * u[i]
            g_values[n * k + i] = gradient
            force[i] += gradient * multipliers[k]


@njit(cache=True)
def derivatives(t, u, v, w, ints, reals, rate, curvature, r_values, q_values):
    n, m, cubic = u.shape[0], rate.shape[0], reals[0, 0]
    wave, turn = reals[0, 1] * np.sin(2.0 * t + 0.3), 2.0 * reals[0, 1] * np.cos(2.0 * t + 0.3)
    for k in range(m):
        rate[k] = curvature[k] = 0.0
        for i in range(n):
            of_time, s = 1.0 + k + i, 1 + (2 + k) * n + i
            rate[k] += turn * of_time * u[i]
            r = turn * of_time + 2.0 * cubic * u[i] * v[i]
            q = -4.0 * wave * of_time + 2.0 * cubic * (u[i] * w[i] + v[i] * v[i])
            curvature[k] += 2.0 * turn * of_time * v[i] - 4.0 * wave * of_time * u[i]
            curvature[k] += 2.0 * cubic * u[i] * v[i] * v[i]
            for j in range(n):
                r += reals[s, j] * v[j]
                q += reals[s, j] * w[j]
                curvature[k] += v[i] * reals[s, j] * v[j]
            r_values[n * k + i], q_values[n * k + i] = r, q


def general(hard=True, singular=False):
    """The problem, in motion; ``singular`` gives it a mass matrix of rank N − 1."""
    random = np.random.default_rng(11)
    root = random.normal(size=(N, N))
    mass = root @ root.T / N + np.eye(N)
    if singular:
        lost = random.normal(size=N)
        # Of rank N − 1: what it loses is not in the null space of Gᵀ.
        mass -= np.outer(mass @ lost, mass @ lost) / (lost @ mass @ lost)
    reals = np.zeros((1 + (2 + M) * N + M, N))
    reals[0, :2] = (0.3, 0.2) if hard else (0.0, 0.0)
    reals[1:] = random.normal(size=reals[1:].shape)
    reals[1 : 1 + N] += 4 * np.eye(N)
    for k in range(M):
        s = slice(1 + (2 + k) * N, 1 + (3 + k) * N)
        reals[s] = (reals[s] + reals[s].T) / 2 + np.eye(N)
    u0, wanted = random.normal(size=N), random.normal(size=N)
    square = [index.ravel().astype(np.int64) for index in np.indices((N, N))]
    columns, rows = (index.ravel().astype(np.int64) for index in np.indices((M, N)))
    subject = Problem(
        name="general",
        u0=u0,
        v0=wanted,
        t0=0.0,
        constraints=M,
        function=evaluate,
        derivatives=derivatives,
        ints=np.zeros((1, 1), np.int64),
        reals=reals,
        pattern=Pattern(*square, *square, *square, rows, columns),
        mass_values=mass.ravel(),
        quadratic=not hard,
    )
    reals[0, 2 : 2 + M] = subject.constraint_values(0.0, u0)
    system = Index1(subject)
    change, _ = system.least_change(0.0, u0, -system.rate(0.0, u0, wanted))
    return replace(subject, v0=wanted + change)
