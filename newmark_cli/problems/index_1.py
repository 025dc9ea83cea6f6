"""The index-1 system of a problem: what u and v alone say of a and λ.

Differentiated twice, the constraints give with the dynamics

    M a − G λ = f(u, v, t),        Gᵀ a = −Φ''(u, v, t; u'' = 0),

a linear system for a and λ.  Its matrix also gives the nearest state, in the
norm of M, that meets Φ = 0 and Φ' = 0.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csc_array

from newmark_cli.problems import algebra
from newmark_cli.problems.algebra import LU, product, solver
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

#: Least eigenvalue of M on free motions, relative to the largest, with which it is regular.
_NO_INERTIA = 1e-13


def weightless(mass: Array, gradient: Array) -> Array:
    """(n, k) motions that constraints allow and that have no inertia; none where k is 0.

    The system determines accelerations where M is positive on the kernel of Gᵀ; M itself
    may be singular.
    """
    sizes = np.linalg.norm(gradient, axis=0)
    vectors, values, _ = np.linalg.svd(gradient / np.where(sizes > 0, sizes, 1.0))
    rank = int(np.count_nonzero(values > 1e-10 * values.max(initial=0.0)))
    free = vectors[:, rank:]
    if free.shape[1] == 0:
        return free
    inertia = free.T @ mass @ free
    diagonal = np.sqrt(np.maximum(np.diag(inertia), 0.0))
    sizes = np.where(diagonal > _NO_INERTIA * diagonal.max(), diagonal, 1.0)
    moments, motions = np.linalg.eigh(inertia / np.outer(sizes, sizes))
    return np.asarray((free / sizes) @ motions[:, moments <= _NO_INERTIA * moments[-1]])


class Index1:
    """Index-1 system of one problem; the places of its entries are found once.

    Where its matrix is singular, all but `rate` raise numpy.linalg.LinAlgError.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        n, pattern = problem.n, problem.pattern
        self._size = n + problem.m
        # M of Andrews' mechanism is 1e-5, G 1e-2: with multipliers in this unit the
        # matrix is well conditioned.
        self._unit = float(np.abs(problem.mass_values).max())
        self._mass = problem.mass_values / self._unit
        rows = np.concatenate([pattern.mass_rows, pattern.g_rows, n + pattern.g_columns])
        columns = np.concatenate([pattern.mass_columns, n + pattern.g_columns, pattern.g_rows])
        self._is_dense = self._size <= algebra.DENSE_UP_TO
        if self._is_dense:
            self._slots = rows * self._size + columns
        else:
            places, self._slots = np.unique(columns * self._size + rows, return_inverse=True)
            self._rows, self._columns = places % self._size, places // self._size
            self._starts = np.searchsorted(self._columns, np.arange(self._size + 1))
        self._zeros = np.zeros(n)

    def accelerations(self, t: float, u: Array, v: Array) -> tuple[Array, Array]:
        """Accelerations (n,) and λ (m,) that follow from t, u, v; NaN where f, G or Φ overflow."""
        n = self.problem.n
        values = self.problem.free_values(t, u, v)
        _, curvature = self.problem.constraint_derivatives(t, u, v)
        solution = self.solution(values.g, np.concatenate([values.force, -curvature]))
        return solution[:n], solution[n:]

    def solution(self, g: Array, rhs: Array) -> Array:
        """(n + m,) solution of [[M, −G], [Gᵀ, 0]] x = rhs, G given by its entries."""
        n = self.problem.n
        solution = self._solver(g)(np.concatenate([rhs[:n] / self._unit, rhs[n:]]))
        return np.concatenate([solution[:n], solution[n:] * self._unit])

    def projected(self, t: float, u: Array, v: Array) -> tuple[Array, Array]:
        """The state on the constraints that is nearest in the norm of M; u, v are close to them.

        One step of Newton's method for the positions: the rest is of the order of
        the square of the distance.
        """
        u = u + self.least_change(t, u, -self.problem.constraint_values(t, u))[0]
        return u, v + self.least_change(t, u, -self.rate(t, u, v))[0]

    def rate(self, t: float, u: Array, v: Array) -> Array:
        """(m,) Φ' = Gᵀv + Φ_t at a time (s) and (n,) coordinates and velocities."""
        values = self.problem.free_values(t, u, v)
        rate, _ = self.problem.constraint_derivatives(t, u, v)
        return self.problem.along(values.g, v) + rate

    def least_change(self, t: float, u: Array, wanted: Array) -> tuple[Array, Array]:
        """Least change δ (n,), in the norm of M, with Gᵀδ (m,) as wanted, and μ (m,), M δ = G μ."""
        return self.changes(t, u)(wanted)

    def changes(self, t: float, u: Array) -> Callable[[Array], tuple[Array, Array]]:
        """`least_change` at a time (s) and coordinates (n,), its matrix factorised once.

        What is returned takes (m, k) for k changes, too, and gives (n, k) and (m, k).
        """
        n = self.problem.n
        solve = self._solver(self.problem.free_values(t, u, self._zeros).g)

        def change(wanted: Array) -> tuple[Array, Array]:
            solution = solve(np.concatenate([np.zeros((n, *wanted.shape[1:])), wanted]))
            return solution[:n], solution[n:] * self._unit

        return change

    def nearest(self, t: float, u: Array, most: int = 100) -> Array:
        """The position on the constraints that is nearest to u in the norm of M.

        Minimises (w − u)ᵀ M (w − u) over all w with Φ(w, t) = 0 by Newton's method with
        M in place of the Lagrangian's Hessian: M (w − u) lies in the range of G at the end.
        It may miss the constraints where u is far from all that meet them.
        """
        n, pattern = self.problem.n, self.problem.pattern
        w, least = u.copy(), np.inf
        for _ in range(most):
            values = self.problem.free_values(t, w, self._zeros)
            away = (self._mass * (u - w)[pattern.mass_columns]).astype(float)
            pull = np.bincount(pattern.mass_rows, away, minlength=n)
            change = self._solver(values.g)(np.concatenate([pull, -values.phi]))[:n]
            size = float(np.abs(change).max())
            if not np.isfinite(size):
                break
            w = w + change
            if size <= 4e-16 * float(np.abs(w).max()) or (
                size >= least and size <= 1e-12 * float(np.abs(w).max())
            ):
                break
            least = size
        return w

    def _solver(self, g: Array) -> Callable[[Array], Array]:
        """Solver of [[M/unit, −G], [Gᵀ, 0]] x = rhs, with one step of refinement."""
        shape = (self._size, self._size)
        values = np.concatenate([self._mass, -g, g])
        solve: Callable[[Array], Array]
        try:
            if self._is_dense:
                matrix: Any = np.bincount(self._slots, values, self._size**2).reshape(shape)
                solve = LU(matrix).solve
            else:
                entries = np.bincount(self._slots, values, len(self._rows))
                if not np.all(np.isfinite(entries)):  # which SuperLU is not made for
                    return lambda rhs: np.full_like(rhs, np.nan)
                matrix = csc_array((entries, self._rows, self._starts), shape)
                solve = solver(matrix)
        except np.linalg.LinAlgError as error:
            raise np.linalg.LinAlgError("the index-1 matrix is singular") from error

        def refined(rhs: Array) -> Array:
            solution = solve(rhs)
            times = product(matrix, solution) if self._is_dense else matrix @ solution
            return solution + solve(rhs - times)

        return refined
