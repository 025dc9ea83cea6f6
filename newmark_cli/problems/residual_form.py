"""The equations of a problem as F(t, y, y') = 0, as codes for general DAEs take them.

    index-3      u' = v, M v' = f + Gλ, 0 = Φ
    index-2      …, 0 = Φ' = Gᵀv + Φ_t
    index-1      …, 0 = Φ'' = Gᵀv' + …
    ggl          u' = v + Gη, …, 0 = Φ, 0 = Φ'

GGL is by Gear, Leimkuhler and Gupta (1985).  Integrals Λ, H with Λ' = λ, H' = η can be the
unknowns in place of λ, η, which lowers the index by one (Gear 1988).
"""

from typing import Any

import numpy as np

from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem, dense_matrix
from newmark_cli.support.arrays import Array

#: Equations → derivatives of Φ that are rows of it.
ROWS = {"index-3": (0,), "index-2": (1,), "index-1": (2,), "ggl": (0, 1)}


class Dae:
    """F(t, y, y') = 0 and a consistent start; y is (u, v, λ), of GGL (u, v, λ, η).

    Attributes:
        problem: The problem.
        equations, integrals: As of `newmark_cli.dae`.
        t0, y0, yp0: Time of the start (s), y and y' (N,) there.
        names: (N,) names of the unknowns, such as ``"v[A.x]"``; those of integrals begin with ∫.
        algebraic: Places of λ and η in y where they are unknowns themselves; else empty.

    Examples:
        >>> import newmark_cli as newmark
        >>> dae = newmark.dae("pendulum")
        >>> dae.names
        ('u[P.x]', 'u[P.y]', 'v[P.x]', 'v[P.y]', '∫lambda[bars.rod]', '∫eta[bars.rod]')
        >>> float(abs(dae.residual(dae.t0, dae.y0, dae.yp0)).max())
        0.0
    """

    def __init__(self, problem: Problem, equations: str, integrals: bool) -> None:
        self.problem, self.equations, self.integrals = problem, equations, integrals
        n, m, self.t0, self._mass = problem.n, problem.m, problem.t0, problem.M
        kinds = [(field, problem.coordinate_names) for field in "uv"] + [
            ("∫" * integrals + kind, problem.constraint_names)
            for kind, _ in zip(("lambda", "eta"), ROWS[equations], strict=False)
        ]
        self.names = tuple(f"{kind}[{name}]" for kind, names in kinds for name in names)
        self.algebraic = [] if integrals else [*range(2 * n, len(self.names))]
        a, multipliers = Index1(problem).accelerations(self.t0, problem.u0, problem.v0)
        self.y0, self.yp0 = np.zeros((2, len(self.names)))
        self.y0[: 2 * n] = np.concatenate([problem.u0, problem.v0])
        self.yp0[: 2 * n] = np.concatenate([problem.v0, a])
        (self.yp0 if integrals else self.y0)[2 * n : 2 * n + m] = multipliers

    def residual(self, t: float, y: Any, yp: Any) -> Array:
        """(N,) F at t (s), y and y' (N,)."""
        u, v, of_u, of_v, multipliers, eta = self._parts(y, yp)
        at = self.problem.evaluate(t, u, v, multipliers)
        rate, curvature = self.problem.constraint_derivatives(t, u, v)
        constraints = (at.phi, at.G.T @ v + rate, at.G.T @ of_v + curvature)
        rows = [of_u - v, self._mass @ of_v - at.force]
        if len(eta):
            rows[0] -= at.G @ eta
        return np.concatenate([*rows, *(constraints[k] for k in ROWS[self.equations])])

    def jacobian(self, t: float, y: Any, yp: Any) -> tuple[Array, Array]:
        """(N, N) ∂F/∂y and (N, N) ∂F/∂y' at t (s), y and y' (N,)."""
        problem, n, m, size = self.problem, self.problem.n, self.problem.m, len(self.names)
        u, v, _, of_v, multipliers, eta = self._parts(y, yp)
        at, rows = problem.evaluate(t, u, v, multipliers), problem.constraint_rows(t, u, v, of_v)
        places = (problem.pattern.g_columns, problem.pattern.g_rows)
        r, q = (dense_matrix(*places, entries, (m, n)) for entries in (rows.r, rows.q))
        of_y, of_yp, eye, none = *np.zeros((2, size, size)), np.eye(n), np.zeros((m, n))
        # By u, v and v' of Φ, Φ' and Φ''.
        tangents = ((at.G.T, none, none), (r, at.G.T, none), (q, 2 * r, at.G.T))
        chosen = [tangents[k] for k in ROWS[self.equations]]
        of_y[:, : 2 * n] = np.block(
            [[0 * eye, -eye], [at.X, at.Y], *([a, b] for a, b, _ in chosen)]
        )
        of_yp[:, : 2 * n] = np.block(
            [[eye, 0 * eye], [0 * eye, self._mass], *([none, c] for _, _, c in chosen)]
        )
        of_multipliers = of_yp if self.integrals else of_y
        of_multipliers[n : 2 * n, 2 * n : 2 * n + m] = -at.G
        if len(eta):
            of_multipliers[:n, 2 * n + m :] = -at.G
            # X is affine in λ: the tangent of Gη is a difference of two.
            pushed, still = (problem.evaluate(t, u, v, x).X for x in (eta, 0 * eta))
            of_y[:n, :n] = pushed - still
        return of_y, of_yp

    def state(self, y: Any, yp: Any) -> tuple[Array, Array, Array]:
        """u, v (n,) and λ (m,) of y and y' (N,)."""
        u, v, _, _, multipliers, _ = self._parts(y, yp)
        return u, v, multipliers

    def _parts(self, y: Any, yp: Any) -> tuple[Array, ...]:
        """u, v, u', v', λ, and η, which is empty where there is none; copies."""
        y, yp = np.array(y, float), np.array(yp, float)
        n, m = self.problem.n, self.problem.m
        multipliers = (yp if self.integrals else y)[2 * n :]
        return y[:n], y[n : 2 * n], yp[:n], yp[n : 2 * n], multipliers[:m], multipliers[m:]
