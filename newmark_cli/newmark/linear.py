"""Linear solvers: what the march and the measures ask of one, and which one is used."""

from typing import Protocol

from newmark_cli.arrays import Array
from newmark_cli.errors import InputError
from newmark_cli.newmark.forms import Form
from newmark_cli.newmark.jacobian import DenseSystem
from newmark_cli.newmark.kernel import State
from newmark_cli.newmark.krylov import Krylov, KrylovSystem
from newmark_cli.newmark.krylov import Stagnation as Stagnation
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.sparse import SparseSystem
from newmark_cli.problems.problem import Problem, Values

DENSE, SPARSE = "dense-lu", "sparse-lu"
GMRES, MINRES = "gmres", "minres"
AUTO = "auto"
LINEAR_SOLVERS = (AUTO, DENSE, SPARSE, GMRES, MINRES)

#: Most unknowns for which `AUTO` takes the dense kernel.  Time per Newton iteration
#: of both marches, optimally scaled, on chains and rows of four-bars of growing
#: size: they are equal at 300 to 370 unknowns in the (u, λ) and the (u, v, a, λ)
#: form; at 30 the kernel is 20 times as fast, at 1200 the sparse march 6 times.
DENSE_UP_TO = 300
#: Most unknowns for which a dense matrix is built at all: 3 GB each.
_DENSE_AT_MOST = 20_000


class BalancedSystem(Protocol):
    """J̄ at one state, solved accurately whatever the scaling is."""

    size: int

    def solve(self, rhs: Array) -> Array:
        """Solution of J̄ q̄ = rhs."""

    def condition(self) -> float:
        """Condition number of J̄, in the norm of the solver."""


class LinearSystem(Protocol):
    """J̄ of a scheme on a problem, at any state."""

    def times_mass(self, vector: Array) -> Array:
        """M times (n,)."""

    def solve(self, values: Values, rhs: Array) -> Array:
        """Solution of J̄ q̄ = rhs; raises numpy.linalg.LinAlgError when J̄ is singular."""

    def balanced(self, t: float, state: State) -> BalancedSystem:
        """J̄ at a state; raises numpy.linalg.LinAlgError when it is singular."""


class Counted(Protocol):
    """A problem, or as much of it as `choose` looks at."""

    @property
    def name(self) -> str:
        """How errors name it."""

    @property
    def n(self) -> int:
        """Coordinates."""

    @property
    def m(self) -> int:
        """Constraints."""


def choose(linear_solver: str, problem: Counted, form: Form) -> str:
    """The solver that one of `LINEAR_SOLVERS` means for a problem and a form.

    Raises:
        InputError: When a dense matrix is asked for that no memory holds.
    """
    unknowns = len(form.kept) * problem.n + problem.m
    if linear_solver == AUTO:
        return DENSE if unknowns <= DENSE_UP_TO else SPARSE
    if linear_solver == DENSE and unknowns > _DENSE_AT_MOST:
        raise InputError(
            f"linear_solver {DENSE}: {problem.name}, {form.name} has {unknowns} unknowns, at most "
            f"{_DENSE_AT_MOST} are allowed; take {SPARSE}"
        )
    return linear_solver


def system(
    linear_solver: str, problem: Problem, scheme: Scheme, krylov: Krylov | None = None
) -> LinearSystem:
    """The linear system of a scheme on a problem.

    Args:
        linear_solver: One of `LINEAR_SOLVERS` but `AUTO`.
        problem, scheme: What the system belongs to.
        krylov: When `GMRES` and `MINRES` stop; its defaults when omitted.

    Raises:
        InputError: When `MINRES` is asked for and J̄ is not symmetric.
    """
    if linear_solver in (GMRES, MINRES):
        return KrylovSystem(problem, scheme, krylov or Krylov(), symmetric=linear_solver == MINRES)
    if linear_solver == SPARSE:
        return SparseSystem(problem, scheme)
    return DenseSystem(problem, scheme)
