"""What `stiffness` saves a problem in plain Python: a chain of 30 points, 60 coordinates.

python benchmarks/stiffness.py
"""

import time

import numpy as np

import newmark_cli as newmark

POINTS = 30


def links(u):
    """(POINTS, 2) differences of successive points, the first from the origin."""
    return np.diff(np.vstack([[0.0, 0.0], u.reshape(POINTS, 2)]), axis=0)


def gradient(u, t):
    """(60, 30) of the constraints (∣d∣² − 1)/2 of each link."""
    columns = np.zeros((POINTS, 2, POINTS))
    for i, d in enumerate(links(u)):
        columns[i, :, i] = d
        if i:
            columns[i - 1, :, i] = -d
    return columns.reshape(2 * POINTS, POINTS)


def stiffness(u, v, multipliers, t):
    """(60, 60) −∂(Gλ)/∂u."""
    next_ones = np.append(multipliers[1:], 0.0)
    of_points = -np.diag(multipliers + next_ones)
    of_points += np.diag(multipliers[1:], 1) + np.diag(multipliers[1:], -1)
    return np.kron(of_points, np.eye(2))


def chain(**given):
    """The chain, straight and at rest, with what is given of its derivatives."""
    return newmark.Definition(
        mass_matrix=np.eye(2 * POINTS),
        u0=np.column_stack([np.arange(1.0, POINTS + 1), np.zeros(POINTS)]).ravel(),
        v0=np.zeros(2 * POINTS),
        force=lambda u, v, t: np.tile([0.0, -9.81], POINTS),
        constraints=lambda u, t: (np.sum(links(u) ** 2, axis=1) - 1) / 2,
        gradient=gradient,
        **given,
    )


if __name__ == "__main__":
    zero = np.zeros((2 * POINTS, 2 * POINTS))
    given = {"stiffness": stiffness, "damping": lambda u, v, t: zero}
    for name, problem in (("given", chain(**given)), ("by differences", chain())):
        problem = newmark.problem(problem)
        newmark.march(problem, h=1e-3, t_end=2e-3)
        begun = time.process_time()
        newmark.march(problem, h=1e-3, t_end=0.1)
        print(f"stiffness {name}: {10 * (time.process_time() - begun):.1f} ms a step")
