"""Singular positions: where the columns of G depend on each other.

A linkage is there in its dead centre, and where it folds up: branches of motions meet,
the multipliers of single constraints are not determined, and no matrix of the equations
of motion is regular.  A motion that runs through such a position with some speed keeps
to its branch and is smooth; `newmark_cli.problems.collocation` computes it.
"""

from typing import NamedTuple

import numpy as np

from newmark_cli.problems.problem import Problem, dense_matrix
from newmark_cli.support.arrays import Array

#: Most unknowns n + m for which a singular value decomposition is worth its time.
LARGEST = 120
#: A singular value passes through zero like a straight line if its rate next to the zero
#: is at least this part of the rate one sample further away.
_STRAIGHT = 0.5
#: A smallest sample below the first number is taken for a zero without a change of sign
#: when the parabola through it and its neighbours has a vertex below the second, times the
#: sample.
_SMALL, _VERTEX = 1e-2, 0.1
#: A sample that is as small is a zero itself.
_ZERO = 1e-10


class Crossing(NamedTuple):
    """A singular position that a motion passes."""

    t: float  #: time (s), by interpolation between samples
    #: whether the singular value passes through zero at some rate. Where it only touches zero, or
    #: creeps through it, branches of motions touch, and the motion is not determined.
    straight: bool


def gradient(problem: Problem, t: float, u: Array) -> Array:
    """(n, m) G at t (s), u (n,) with columns of length 1; a column that vanishes stays.

    So links of any length, sliders and angles are alike, and singular values are numbers
    between 0 and √m.
    """
    values = problem.values(t, u, np.zeros(problem.n), np.zeros(problem.m))
    pattern, shape = problem.pattern, (problem.n, problem.m)
    return scaled(dense_matrix(pattern.g_rows, pattern.g_columns, values.g, shape))


def scaled(g: Array) -> Array:
    """G, or several of them (..., n, m), with columns of length 1; see `gradient`."""
    lengths = np.linalg.norm(g, axis=-2, keepdims=True)
    return np.asarray(g / np.where(lengths > 0, lengths, 1.0))


def smallest(problem: Problem, t: float, u: Array) -> float | None:
    """Smallest singular value of `gradient`, a number between 0 and 1 without unit.

    About the angle (rad) by which the position is away from a singular one.  Takes one
    evaluation of the problem and a decomposition, O(n m²): 0.1 ms for ten constraints,
    some ms for the largest.  0 where G is not finite; None for more than `LARGEST` unknowns.
    """
    if problem.n + problem.m > LARGEST:
        return None
    g = gradient(problem, t, u)
    return float(_least(g[None])[0]) if np.all(np.isfinite(g)) else 0.0


def crossings(times: Array, g: Array) -> list[Crossing]:
    """Singular positions between sampled positions, and at them, in order.

    A singular value that vanishes in passing changes its sign if its vectors are
    continued; then G_i⁺ G_{i+1}, elsewhere close to the identity, has a negative
    eigenvalue, the ratio of the two values.  Times are (k,), increasing (s), G (k, n, m).
    """
    least, steps = _least(g), np.diff(times)
    changes = np.linalg.norm(np.diff(g, axis=0), axis=(1, 2))
    positions = []
    passed = np.zeros(len(steps), bool)
    # A value cannot vanish in between unless G changes by both its values.
    near = least[:-1] + least[1:] <= changes
    # The sign of a value that is zero at a sample is that of rounding; see below.
    for i in np.flatnonzero(near & (np.minimum(least[:-1], least[1:]) > _ZERO)).tolist():
        ratios = np.linalg.eigvals(np.linalg.pinv(g[i], rcond=0) @ g[i + 1]).real
        rate = (least[i] + least[i + 1]) / steps[i]
        for ratio in ratios[ratios < 0]:
            passed[i] = True
            time = float(times[i] + steps[i] / (1 - ratio))
            positions.append(Crossing(time, _is_straight(rate, least, steps, i, i + 1)))
    for j in range(1, len(least) - 1):
        before, here, after = least[j - 1 : j + 2]
        if passed[j - 1] or passed[j] or here > min(before, after, _SMALL):
            continue
        rise, fall = (after - here) / steps[j], (before - here) / steps[j - 1]
        if here <= _ZERO:
            straight = _is_straight(min(rise, fall), least, steps, j - 1, j + 1)
            positions.append(Crossing(float(times[j]), straight))
            continue
        bend = (rise + fall) / (steps[j - 1] + steps[j])
        slope = rise - bend * steps[j]
        if bend > 0 and here - slope**2 / (4 * bend) < _VERTEX * here:
            positions.append(Crossing(float(times[j] - slope / (2 * bend)), False))
    return sorted(positions)


def _least(g: Array) -> Array:
    """(k,) smallest singular values of (k, n, m) matrices."""
    return np.asarray(np.linalg.svd(g, compute_uv=False)[:, -1], float)


def _is_straight(rate: float, least: Array, steps: Array, i: int, j: int) -> bool:
    """Whether a rate between samples i and j is not much below those next to them."""
    beyond = [0.0]
    if i > 0:
        beyond.append(abs(least[i - 1] - least[i]) / steps[i - 1])
    if j + 1 < len(least):
        beyond.append(abs(least[j + 1] - least[j]) / steps[j])
    return bool(rate >= _STRAIGHT * max(beyond))
