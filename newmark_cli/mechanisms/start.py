"""Consistent starts: positions on the constraints, velocities that fit, no redundancy."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from newmark_cli.arrays import Array
from newmark_cli.documents import Document, KeyPath
from newmark_cli.problems.problem import Problem

#: Coordinates up to which ranks are found by dense factorisations, which also tell
#: which constraints depend on each other; beyond, pivots of a sparse one must do.
_DENSE_UP_TO = 600
_RANK_TOLERANCE = 1e-10
_VELOCITY_TOLERANCE = 1e-9
_MOST_CORRECTIONS = 50


class Options(Protocol):
    """What a mechanism asks for at its start."""

    @property
    def assemble(self) -> bool:
        """Whether initial positions are a guess."""

    @property
    def project_velocities(self) -> bool:
        """Whether initial velocities are to be projected."""


def consistent(
    problem: Problem, options: Options, document: Document, paths: Sequence[KeyPath]
) -> Problem:
    """The problem with a consistent start.

    Args:
        problem: As given; its start may be a guess.
        options: Whether positions are assembled and velocities projected.
        document: Where the problem came from, for errors.
        paths: Key of each constraint in the document.

    Raises:
        DocumentError: When M is singular, constraints depend on each other, a guess
            cannot be assembled, or velocities do not fit the constraints.
    """
    _require_mass(problem, document)
    if problem.m == 0:
        raise document.error((), "no constraint: nothing here is of index 3")
    if options.assemble:
        problem = replace(problem, u0=_assembled(problem, document))
    gradient = _gradient(problem, problem.u0)
    _require_independent(gradient, document, paths)
    rate, _ = problem.constraint_derivatives(problem.t0, problem.u0, problem.v0)
    misfit = gradient.T @ problem.v0 + rate
    if options.project_velocities:
        return replace(problem, v0=problem.v0 - _least_change(gradient, misfit))
    sizes = _column_norms(gradient)
    speed = max(float(np.abs(problem.v0).max()), float(np.abs(rate / sizes).max()))
    worst = int(np.argmax(np.abs(misfit) / sizes))
    if abs(misfit[worst]) > _VELOCITY_TOLERANCE * sizes[worst] * speed:
        raise document.error(
            paths[worst],
            f"initial velocities miss this constraint by {abs(misfit[worst]) / sizes[worst]:.3g} "
            "m/s; correct them or set 'project_velocities: true'",
        )
    return problem


def _gradient(problem: Problem, u: Array) -> scipy.sparse.csc_array:
    """(n, m) sparse G at a position."""
    n, m, pattern = problem.n, problem.m, problem.pattern
    values = problem.values(problem.t0, u, problem.v0, np.zeros(m)).g
    return scipy.sparse.csc_array((values, (pattern.g_rows, pattern.g_columns)), shape=(n, m))


def _column_norms(gradient: scipy.sparse.csc_array) -> Array:
    return np.asarray(np.sqrt(gradient.multiply(gradient).sum(axis=0))).ravel()


def _least_change(gradient: scipy.sparse.csc_array, misfit: Array) -> Array:
    """Smallest d with Gᵀ d = misfit."""
    solve = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(gradient.T @ gradient)).solve
    return np.asarray(gradient @ solve(misfit))


def _assembled(problem: Problem, document: Document) -> Array:
    """Positions on the constraints near a guess, by Newton's method of least change."""
    u = problem.u0.copy()
    size = float(np.abs(u).max()) or 1.0
    for _ in range(_MOST_CORRECTIONS):
        phi = problem.constraint_values(problem.t0, u)
        try:
            change = _least_change(_gradient(problem, u), phi)
        except RuntimeError:  # exactly singular
            break
        if not np.all(np.isfinite(change)):
            break
        u -= change
        if np.abs(change).max() < 1e-15 * size:
            return u
    misfit = float(np.abs(problem.constraint_values(problem.t0, u)).max())
    if misfit < 1e-14 * size**2:
        return u
    raise document.error(
        ("assemble",), f"no position found from this guess; constraints are off by {misfit:.3g}"
    )


def _require_mass(problem: Problem, document: Document) -> None:
    """M must be positive definite: every coordinate carries mass."""
    n, pattern = problem.n, problem.pattern
    diagonal = np.zeros(n)
    on = pattern.mass_rows == pattern.mass_columns
    np.add.at(diagonal, pattern.mass_rows[on], problem.mass_values[on])
    weak = np.flatnonzero(diagonal <= 0)
    if len(weak) == 0 and n <= _DENSE_UP_TO:
        values = np.linalg.eigvalsh(problem.M)
        if values[0] <= 1e-13 * values[-1]:
            _, vectors = np.linalg.eigh(problem.M)
            weak = np.array([int(np.argmax(np.abs(vectors[:, 0])))])
    if len(weak):
        point = problem.point_of(int(weak[0]))
        raise document.error(
            ("points", point), f"{point} carries no mass of its own; the mass matrix is singular"
        )


def _require_independent(
    gradient: scipy.sparse.csc_array, document: Document, paths: Sequence[KeyPath]
) -> None:
    """G must have full rank; names the constraints that depend on each other."""
    n, m = gradient.shape
    sizes = _column_norms(gradient)
    if np.any(sizes == 0):
        worst = int(np.argmin(sizes))
        raise document.error(paths[worst], "does not constrain the initial position")
    scaled = gradient / sizes[None, :]
    if n <= _DENSE_UP_TO:
        dense = np.asarray(scaled.toarray(), float)
        # Vectors take ten times as long as values, and are needed for the error alone.
        values = np.linalg.svd(dense, compute_uv=False)
        rank = int(np.count_nonzero(values > _RANK_TOLERANCE * values[0]))
        if rank == m:
            return
        _, _, vectors = np.linalg.svd(dense)
        involved = np.flatnonzero(np.abs(vectors[rank:]).max(axis=0) > 1e-6)
    else:
        try:
            factors = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(scaled.T @ scaled))
        except RuntimeError:
            involved = np.array([m - 1])
        else:
            pivots = np.abs(factors.U.diagonal())
            # Pivots of GᵀG are squares of what a rank would be judged by.
            weak = np.flatnonzero(pivots < _RANK_TOLERANCE**1.5 * pivots.max())
            if len(weak) == 0:
                return
            involved = np.flatnonzero(np.isin(factors.perm_c, weak))
    names = ", ".join(".".join(map(str, paths[i])) for i in involved[:12])
    raise document.error(
        paths[int(involved[-1])],
        f"redundant: these constraints depend on each other: {names}",
    )
