"""The equations of a problem as F(t, y, y') = 0, for codes that solve general DAEs.

They are those of `newmark_cli.dae`: "index 3", "index 2", "index 1", "GGL", and "… with integrals".
"""

from newmark_cli.problems.residual_form import Dae


class Equations(Dae):
    """F and a consistent start; `calls` counts the evaluations of F."""

    def __init__(self, problem, kind):
        kind, _, integrals = kind.partition(" with ")
        super().__init__(problem, kind.lower().replace(" ", "-"), bool(integrals))
        self.calls = 0

    def __call__(self, t, y, yp):
        """F, (n + n + m,) or (n + n + 2m,)."""
        self.calls += 1
        return self.residual(t, y, yp)
