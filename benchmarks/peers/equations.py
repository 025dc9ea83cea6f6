"""The equations of a problem as F(t, y, y') = 0, for codes that solve general DAEs.

    index 3      u' = v, M v' = f + Gλ, 0 = Φ                y = u, v, λ
    index 2      … 0 = Gᵀv                                   y = u, v, λ
    index 1      … 0 = Gᵀv' + Φ''                            y = u, v, λ
    GGL          u' = v + Gη, …, 0 = Φ, 0 = Gᵀv              y = u, v, λ, η

"with integrals" takes Λ and H with Λ' = λ, H' = η for unknowns, which lowers the index by one.
Gear, Leimkuhler and Gupta (1985); Gear (1988).
"""

import numpy as np

from newmark_cli.problems.index_1 import Index1


class Equations:
    """F and a consistent start; `calls` counts the evaluations of F."""

    def __init__(self, problem, kind):
        self.problem, self.calls = problem, 0
        self.kind, _, integrals = kind.partition(" with ")
        self.integrals, self.mass = bool(integrals), problem.M
        n, m, sets = problem.n, problem.m, 2 if self.kind == "GGL" else 1
        a, multipliers = Index1(problem).accelerations(0.0, problem.u0, problem.v0)
        of_force = np.concatenate([multipliers, np.zeros((sets - 1) * m)])
        self.y0 = np.concatenate([problem.u0, problem.v0, 0 * of_force])
        self.yp0 = np.concatenate([problem.v0, a, 0 * of_force])
        (self.yp0 if self.integrals else self.y0)[2 * n :] = of_force
        #: Places of the multipliers in y.
        self.algebraic = np.arange(2 * n, 2 * n + sets * m)

    def __call__(self, t, y, yp):
        """F, (n + n + m,) or (n + n + 2m,)."""
        self.calls += 1
        problem, n, m = self.problem, self.problem.n, self.problem.m
        u, v, a = y[:n].copy(), y[n : 2 * n].copy(), yp[n : 2 * n].copy()
        multipliers = (yp if self.integrals else y)[2 * n :].copy()
        at = problem.values(t, u, v, multipliers[:m])
        rows = [yp[:n] - v, self.mass @ a - at.force]
        if self.kind == "GGL":
            pushed = at.g * multipliers[m:][problem.pattern.g_columns]
            rows[0] = rows[0] - np.bincount(problem.pattern.g_rows, pushed, n)
        if self.kind in ("index 3", "GGL"):
            rows.append(at.phi)
        if self.kind in ("index 2", "GGL"):
            rows.append(problem.along(at.g, v))
        if self.kind == "index 1":
            rows.append(problem.along(at.g, a) + problem.constraint_derivatives(t, u, v)[1])
        return np.concatenate(rows)

    def jacobian(self, t, y, yp):
        """∂F/∂y and ∂F/∂y'."""
        problem, n, m = self.problem, self.problem.n, self.problem.m
        u, v, a = y[:n].copy(), y[n : 2 * n].copy(), yp[n : 2 * n].copy()
        multipliers = (yp if self.integrals else y)[2 * n :].copy()
        at, one = problem.evaluate(t, u, v, multipliers[:m]), np.eye(n)
        rows = problem.constraint_rows(t, u, v, a)
        of_y, of_yp = np.zeros((2, len(y), len(y)))
        of_multipliers = of_yp if self.integrals else of_y
        of_y[:n, n : 2 * n], of_yp[:n, :n] = -one, one
        of_y[n : 2 * n, : 2 * n] = np.hstack([at.X, at.Y])
        of_yp[n : 2 * n, n : 2 * n], of_multipliers[n : 2 * n, 2 * n : 2 * n + m] = self.mass, -at.G
        if self.kind == "GGL":
            zero, eta = (
                problem.evaluate(t, u, v, each).X for each in (0.0 * at.phi, multipliers[m:])
            )
            of_y[:n, :n], of_multipliers[:n, 2 * n + m :] = eta - zero, -at.G
        if self.kind in ("index 3", "GGL"):
            of_y[2 * n : 2 * n + m, :n] = at.G.T
        if self.kind in ("index 2", "GGL"):
            of_y[-m:, :n], of_y[-m:, n : 2 * n] = self._dense(rows.r), at.G.T
        if self.kind == "index 1":
            of_y[-m:, :n], of_y[-m:, n : 2 * n] = self._dense(rows.q), 2 * self._dense(rows.r)
            of_yp[-m:, n : 2 * n] = at.G.T
        return of_y, of_yp

    def _dense(self, entries):
        """(m, n) a matrix at the places of Gᵀ."""
        pattern = self.problem.pattern
        full = np.zeros((self.problem.m, self.problem.n))
        np.add.at(full, (pattern.g_columns, pattern.g_rows), entries)
        return full

    def state(self, y, yp):
        """u, v and λ (m,) of y and y'."""
        n, m = self.problem.n, self.problem.m
        return y[:n], y[n : 2 * n], (yp if self.integrals else y)[2 * n : 2 * n + m]
