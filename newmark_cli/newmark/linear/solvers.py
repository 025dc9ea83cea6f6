"""Linear solvers: what the march and the measures ask of one."""

from functools import partial

from newmark_cli.newmark.linear.choice import GMRES, SPARSE, STATIC, Krylov
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.krylov import KrylovSystem
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.scheme import Scheme, Schemes
from newmark_cli.problems.problem import Problem

#: J̄ of a scheme on a problem at any state: solved, as a matrix, and balanced.  A formulation
#: beside index 3, or a projection, needs its tangents.
LinearSystem = DenseSystem | SparseSystem | StaticSystem
#: Most systems of steps of other sizes that are kept.
_MOST_KNOWN = 100


def system(
    linear_solver: str, problem: Problem, scheme: Scheme, krylov: Krylov | None = None
) -> LinearSystem:
    """The linear system of a scheme on a problem, by one of `LINEAR_SOLVERS` but `AUTO`."""
    if linear_solver == GMRES:
        return KrylovSystem(problem, scheme, krylov or Krylov())
    if linear_solver == STATIC:
        return StaticSystem(problem, scheme)
    if linear_solver == SPARSE:
        return SparseSystem(problem, scheme)
    return DenseSystem(problem, scheme)


class Systems:
    """The linear system of each step of a march.

    Attributes:
        base: That of steps of size h.
    """

    def __init__(
        self, linear_solver: str, problem: Problem, schemes: Schemes, krylov: Krylov | None
    ) -> None:
        self._make = partial(system, linear_solver, problem, krylov=krylov)
        self._schemes, self._known = schemes, dict[tuple[float, float], LinearSystem]()
        self.base = self._make(schemes.base)

    def at(self, step: int) -> LinearSystem:
        """The system of a step, counted from 1; step 0 has that of the first."""
        scheme = self._schemes.at(step)
        if scheme is self._schemes.base:
            return self.base
        key = scheme.h, scheme.ratio
        if key not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[key] = new = self._make(scheme)
            if isinstance(new, KrylovSystem) and isinstance(self.base, KrylovSystem):
                new.iterations, new.residuals = self.base.iterations, self.base.residuals
        return self._known[key]

    def pivoting_at(self, step: int) -> LinearSystem:
        """The same, or what takes the corrections that static elimination refuses."""
        found = self.at(step)
        return found.pivoting if isinstance(found, StaticSystem) else found
