"""Singular positions: where the columns of G depend on each other.

A linkage is there in its dead centre, and where it folds up: branches of motions meet,
the multipliers of single constraints are not determined, and no matrix of the equations
of motion is regular.  References end there.
"""

import numpy as np

from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

#: Most unknowns n + m for which a singular value decomposition is worth its time.
LARGEST = 120
#: A smallest sample below the first number is taken for a zero without a change of sign
#: when the parabola through it and its neighbours has a vertex below the second, times the
#: sample.
_SMALL, _VERTEX = 1e-2, 0.1
#: A sample that is as small is a zero itself.
_ZERO = 1e-10
#: Singular values that vanish together: relative to the least, and to the largest; and the
#: least part of their vectors that names a constraint.
_TOGETHER, _NOTHING, _INVOLVED = 10.0, 1e-3, 0.05


def gradients(problem: Problem, times: Array, positions: Array) -> Array:
    """(k, n, m) G at times (k,) (s) and positions (k, n) with columns of length 1.

    A column that vanishes stays.  So links of any length, sliders and angles are alike, and
    singular values are numbers between 0 and √m.
    """
    g = np.array([problem.gradient(t, u) for t, u in zip(times, positions, strict=True)])
    lengths = np.linalg.norm(g, axis=1, keepdims=True)
    return np.asarray(g / np.where(lengths > 0, lengths, 1.0))


def dependent(problem: Problem, g: Array) -> list[str]:
    """Names of constraints whose columns of G (n, m) nearly depend on each other."""
    _, values, vectors = np.linalg.svd(g)
    null = np.abs(vectors[values <= max(_TOGETHER * values[-1], _NOTHING * values[0])]).max(axis=0)
    return [problem.constraint_names[k] for k in np.flatnonzero(null > _INVOLVED)]


def crossings(times: Array, g: Array) -> list[float]:
    """Times (s) of singular positions between sampled positions, and at them, in order.

    A singular value that vanishes in passing changes its sign if its vectors are
    continued; then G_i⁺ G_{i+1}, elsewhere close to the identity, has a negative
    eigenvalue, the ratio of the two values.  Times are (k,), increasing (s), G (k, n, m).
    """
    least, steps = np.linalg.svd(g, compute_uv=False)[:, -1], np.diff(times)
    changes = np.linalg.norm(np.diff(g, axis=0), axis=(1, 2))
    positions: list[float] = []
    passed = np.zeros(len(steps), bool)
    # A value cannot vanish in between unless G changes by both its values.
    near = least[:-1] + least[1:] <= changes
    # The sign of a value that is zero at a sample is that of rounding; see below.
    for i in np.flatnonzero(near & (np.minimum(least[:-1], least[1:]) > _ZERO)).tolist():
        ratios = np.linalg.eigvals(np.linalg.pinv(g[i], rcond=0) @ g[i + 1]).real
        for ratio in ratios[ratios < 0]:
            passed[i] = True
            positions.append(float(times[i] + steps[i] / (1 - ratio)))
    for j in range(1, len(least) - 1):
        before, here, after = least[j - 1 : j + 2]
        if passed[j - 1] or passed[j] or here > min(before, after, _SMALL):
            continue
        if here <= _ZERO:
            positions.append(float(times[j]))
            continue
        rise, fall = (after - here) / steps[j], (before - here) / steps[j - 1]
        bend = (rise + fall) / (steps[j - 1] + steps[j])
        slope = rise - bend * steps[j]
        if bend > 0 and here - slope**2 / (4 * bend) < _VERTEX * here:
            positions.append(float(times[j] - slope / (2 * bend)))
    return sorted(positions)
