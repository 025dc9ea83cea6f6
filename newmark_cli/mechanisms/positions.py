"""Positions on the constraints of a mechanism, next to a guess."""

import math
from collections.abc import Callable

import numpy as np
import scipy.sparse

from newmark_cli.problems import redundancy
from newmark_cli.problems.algebra import LU, solver
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.redundancy import column_norms, gradient_of
from newmark_cli.support.arrays import Array

#: Coordinates up to which ranks are found by dense factorisations.
DENSE_UP_TO = 600
#: Singular values or pivots, relative to the largest, that are rounding.
RANK_TOLERANCE = 1e-10
#: What a position that was looked for may miss of a constraint, of the largest coordinate.
MISSED = 1e-9
_MOST_CORRECTIONS = 50
#: What a sparse solution may miss, relative to what was asked for.
_SOLVED = 1e-6


def size_of(u: Array) -> float:
    """The largest coordinate, or 1."""
    return float(np.abs(u).max()) or 1.0


def on_constraints(problem: Problem, u: Array) -> Array:
    """A position next to another that meets all constraints, or the closest that was found.

    Newton's method of least change; where that ends elsewhere, that of Levenberg and
    Marquardt from the same start.
    """
    begin, size = u, size_of(u)
    # Newton's steps of directors, which have length 1, may be far too long.
    longest = 0.5 * size if len(problem.axes) == 3 else math.inf
    for _ in range(_MOST_CORRECTIONS):
        phi = problem.constraint_values(problem.t0, u)
        if not np.all(np.isfinite(phi)):
            break
        change = least_change(gradient_of(problem, u), phi)
        if not np.all(np.isfinite(change)):
            break
        step = float(np.abs(change).max())
        u = u - change * min(1.0, longest / step if step else 1.0)
        if step <= 1e-15 * size:
            break
    if np.abs(problem.constraint_values(problem.t0, u)).max() <= MISSED * max(size, size**2):
        return u
    return _closest(problem, begin)


def least_change(gradient: scipy.sparse.csc_array, wanted: Array) -> Array:
    """Smallest d with Gᵀ d = wanted; least squares where constraints are dependent."""
    square = gradient.T @ gradient
    if gradient.shape[0] <= DENSE_UP_TO:
        if (solve := solver_if_regular(square.toarray())) is not None:
            return np.asarray(gradient @ solve(wanted))
        return np.asarray(np.linalg.lstsq(gradient.toarray().T, wanted, rcond=1e-9)[0])
    try:
        change = np.asarray(gradient @ solver(square)(wanted))
    except np.linalg.LinAlgError:
        change = np.full(gradient.shape[0], np.nan)
    if np.linalg.norm(gradient.T @ change - wanted) <= _SOLVED * np.linalg.norm(wanted):
        return change
    return redundancy.least_change(gradient, wanted)


def solver_if_regular(matrix: Array) -> Callable[[Array], Array] | None:
    """Solver of A x = rhs; None if A is nearly singular."""
    try:
        factors = LU(matrix)
    except np.linalg.LinAlgError:
        return None
    pivots = np.abs(np.diagonal(factors.lu))
    return factors.solve if pivots.min() > RANK_TOLERANCE * pivots.max() else None


def _closest(problem: Problem, u: Array) -> Array:
    """Position near another that meets the constraints as well as possible.

    The method of Levenberg and Marquardt, which also converges where constraints depend
    on each other: the damping falls with what is missed.
    """
    scale = 1.0

    def missed(u: Array) -> tuple[float, Array]:
        phi = problem.constraint_values(problem.t0, u)
        size = float(np.linalg.norm(phi))
        return (size if np.isfinite(size) else np.inf), phi

    norm, phi = missed(u)
    for _ in range(_MOST_CORRECTIONS):
        gradient = gradient_of(problem, u)
        largest = float(column_norms(gradient).max()) ** 2 or 1.0
        damping = scale * min(1.0, norm / largest) * largest + 1e-15 * largest
        square = gradient.T @ gradient + damping * scipy.sparse.eye_array(problem.m)
        try:
            step = np.asarray(gradient @ solver(square)(phi))
        except np.linalg.LinAlgError:
            break
        if not np.all(np.isfinite(step)) or np.abs(step).max() <= 1e-16 * np.abs(u).max():
            break
        moved = u - step
        there, phi_there = missed(moved)
        if there < norm:
            u, norm, phi, scale = moved, there, phi_there, scale / 8
        else:
            scale *= 10
    return u
