"""The motion of a mechanism at any time, solved anew with what a wrong code may have changed.

A table is explained by a change of the equations if the solution of the changed equations is what
the table converges to.  Such solutions come from the index-1 system by a Runge–Kutta method of
order 8, whose dense output serves any row.
"""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

#: Tolerance with which rows are compared, close to the least that rounding allows.
EXACT = 3e-13
#: Most evaluations of one solution: a wrong number may make a motion wild.
_MOST = 40_000
#: A step covers at most one part in so many of the motion: where rows are compared to rounding,
#: and where a change is fitted.
_STEPS, _FEW_STEPS = 40, 8

#: Time (s), u and v → a further force (n,).
Force = Callable[[float, Array, Array], Array]
#: Time (s) and u → a further part (n, n) of M.
MassOf = Callable[[float, Array], Array]


class NoMotion(ArithmeticError):
    """The changed mechanism has no motion that can be followed to the end."""


class Truth:
    """The solution of a problem, with another start or a further force.

    Args:
        problem: Whose equations are solved.
        t_end: Last time (s) that will be asked for.
        u0, v0: Another start (n,).
        force: A further force.
        mass: A further part of M.
        curvature: Factor of κ in Gᵀa + κ = 0, one or (m,), and that of its part at v = 0, which is
            that of driven constraints: other codes may lack either.
        recovered: Whether this is so of λ only, as where u and v are projected.
        tolerance: Local tolerance, relative to the largest coordinate and velocity.

    Raises:
        NoMotion: When the motion does not get there.
    """

    def __init__(
        self,
        problem: Problem,
        t_end: float,
        *,
        u0: Array | None = None,
        v0: Array | None = None,
        force: Force | None = None,
        mass: MassOf | None = None,
        curvature: tuple[float | tuple[float, ...], float] = (1.0, 1.0),
        recovered: bool = False,
        tolerance: float = EXACT,
    ) -> None:
        self.problem, self._force, self._left = problem, force, _MOST
        self._mass = mass
        self._curvature = (1.0, 1.0) if recovered else curvature
        u0, v0 = (problem.u0 if u0 is None else u0), (problem.v0 if v0 is None else v0)
        n, m, pattern = problem.n, problem.m, problem.pattern
        self._matrix = np.zeros((n + m, n + m))
        self._matrix[:n, :n] = problem.M
        self._places = pattern.g_rows * m + pattern.g_columns
        start = np.concatenate([u0, v0])
        steps = _STEPS if tolerance <= EXACT else _FEW_STEPS
        with np.errstate(all="ignore"):
            solved = solve_ivp(
                self._rate, (problem.t0, t_end), start, "DOP853",
                rtol=tolerance, atol=0.3 * tolerance * max(float(np.abs(start).max()), 1e-9),
                max_step=(t_end - problem.t0) / steps, dense_output=True,
            )  # fmt: skip
        if not solved.success:
            raise NoMotion(str(solved.message))
        assert solved.sol is not None  # since dense output was asked for
        self._states, self._curvature = solved.sol, curvature

    def _rate(self, t: float, y: Array) -> Array:
        self._left -= 1
        if self._left < 0 or not np.isfinite(y).all():
            raise NoMotion("a motion that cannot be followed")
        n = self.problem.n
        return np.concatenate([y[n:], self.solved(t, y[:n], y[n:])[0]])

    def solved(self, t: float, u: Array, v: Array) -> tuple[Array, Array]:
        """Accelerations (n,) and λ (m,) of a state."""
        problem, n, m = self.problem, self.problem.n, self.problem.m
        values = problem.free_values(t, u, v)
        force = values.force if self._force is None else values.force + self._force(t, u, v)
        gradient = np.bincount(self._places, values.g, minlength=n * m).reshape(n, m)
        matrix = self._matrix.copy()
        matrix[:n, n:], matrix[n:, :n] = -gradient, gradient.T
        if self._mass is not None:
            matrix[:n, :n] += self._mass(t, u)
        every, driven = self._curvature
        curvature = np.multiply(every, problem.constraint_derivatives(t, u, v)[1])
        if driven != 1:
            curvature += (driven - 1) * problem.constraint_derivatives(t, u, np.zeros(n))[1]
        right = np.concatenate([force, -curvature])
        try:
            both = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            both = np.linalg.lstsq(matrix, right, rcond=None)[0]
        return both[:n], both[n:]

    def at(self, times: Array) -> dict[str, Array]:
        """Part → (k, size) values at times (k,) in s; "a" has the accelerations."""
        n = self.problem.n
        states = self._states(times).T if len(times) else np.zeros((0, 2 * n))
        both = [self.solved(t, y[:n], y[n:]) for t, y in zip(times, states, strict=True)]
        return {
            "u": states[:, :n],
            "v": states[:, n:],
            "a": np.array([a for a, _ in both]).reshape(-1, n),
            "lambda": np.array([forces for _, forces in both]).reshape(-1, self.problem.m),
        }
