"""Tolerances for codes that choose their steps and solve F(t, y, y') = 0: see docs/advice.md.

python docs/examples/tolerances.py PROBLEM ACCURACY T_END
"""

import sys

import numpy as np

import newmark_cli as newmark


def tolerances(problem, accuracy, t_end):
    """Relative and absolute tolerances for GGL with the unknowns (u, v, ∫λ, ∫η).

    Args:
        problem: What `newmark.problem` takes.
        accuracy: Of local errors, relative to the motion.
        t_end: End of the motion (s).

    Returns:
        rtol, and atol (N,), an error as large as which in u and v moves ∫λ and ∫η so far.
    """
    problem = newmark.problem(problem)
    motion = newmark.march(
        problem, h=t_end / 600, steps=600, every=40, integrator="generalized-alpha rho=0.9"
    )
    moved, speed = largest(problem, motion.u - motion.u[0]), largest(problem, motion.v)
    impulses, etas = [], []
    for t, u, v, multipliers in zip(motion.t, motion.u, motion.v, motion.multipliers, strict=True):
        G = problem.evaluate(t, u, v, multipliers).G
        n, m = G.shape
        saddle = np.block([[problem.M, -G], [G.T, np.zeros((m, m))]])
        # Errors of coordinates are independent: their squares add up.
        of_v = np.vstack([np.zeros((n, n)), G.T * speed])
        impulses.append(np.linalg.norm(np.linalg.solve(saddle, of_v)[n:], axis=1))
        etas.append(np.linalg.norm(np.linalg.solve(G.T @ G, G.T * moved), axis=1))
    atol = accuracy * np.concatenate([moved, speed, np.max(impulses, axis=0), np.max(etas, axis=0)])
    # rtol counts from the origin, which may be far away.
    away = np.abs(motion.u).max() / moved.max()
    return accuracy if away <= 10 else accuracy / away, atol


def largest(problem, values):
    """(n,) largest of values (states, n): of a point its length, and none close to 0."""
    sizes, axes = np.abs(values), len(problem.axes)
    k = len(problem.points) * axes
    lengths = np.linalg.norm(values[:, :k].reshape(len(values), -1, axes), axis=2)
    sizes[:, :k] = np.repeat(lengths, axes, axis=1)
    sizes = sizes.max(axis=0)
    return np.maximum(sizes, 1e-3 * sizes.max() or 1.0)


if __name__ == "__main__":
    problem, accuracy, t_end = sys.argv[1], *map(float, sys.argv[2:])
    rtol, atol = tolerances(problem, accuracy, t_end)
    print(f"rtol = {rtol:.1e}")
    for name, value in zip(newmark.dae(problem).names, atol, strict=True):
        print(f"atol of {name} = {value:.1e}")
