"""Linear solvers: what the march and the measures ask of one."""

from typing import Protocol

import scipy.sparse

from newmark_cli.newmark.constraints import Constraining, Tangents
from newmark_cli.newmark.linear.choice import GMRES, MINRES, SPARSE, STATIC, Krylov
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.krylov import KrylovSystem
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array


class BalancedSystem(Protocol):
    """J̄ at one state, solved accurately whatever the scaling is."""

    size: int

    def solve(self, rhs: Array) -> Array:
        """Solution of J̄ q̄ = rhs."""

    def condition(self) -> float:
        """Condition number of J̄, in the norm of the solver."""


class LinearSystem(Protocol):
    """J̄ of a scheme on a problem, at any state."""

    @property
    def problem(self) -> Problem:
        """Whose J̄ it is."""

    @property
    def constraining(self) -> Constraining | None:
        """The formulation; None for index 3 without a projection."""

    def times_mass(self, vector: Array) -> Array:
        """M times (n,)."""

    def solve(self, values: Values, rhs: Array, tangents: Tangents | None = None) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular.

        A formulation beside index 3, or a projection, needs its tangents.
        """

    def matrix(self, values: Values, tangents: Tangents | None = None) -> scipy.sparse.csc_array:
        """J̄ that `solve` solves with, without its zeros."""

    def balanced(self, t: float, state: State) -> BalancedSystem:
        """J̄ at a state; raises numpy.linalg.LinAlgError when it is singular."""


def system(
    linear_solver: str, problem: Problem, scheme: Scheme, krylov: Krylov | None = None
) -> LinearSystem:
    """The linear system of a scheme on a problem, by one of `LINEAR_SOLVERS` but `AUTO`.

    Raises:
        InputError: When `MINRES` is asked for and J̄ is not symmetric.
    """
    if linear_solver in (GMRES, MINRES):
        return KrylovSystem(problem, scheme, krylov or Krylov(), symmetric=linear_solver == MINRES)
    if linear_solver == STATIC:
        return StaticSystem(problem, scheme)
    if linear_solver == SPARSE:
        return SparseSystem(problem, scheme)
    return DenseSystem(problem, scheme)
