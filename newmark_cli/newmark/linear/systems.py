"""Linear solvers: what the march and the measures ask of one."""

from newmark_cli.newmark.linear.choice import GMRES, MINRES, SPARSE, STATIC, Krylov
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.krylov import KrylovSystem
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem

#: J̄ of a scheme on a problem at any state: it times M, solved, as a matrix, and balanced at a
#: state.  A formulation beside index 3, or a projection, needs its tangents.
LinearSystem = DenseSystem | SparseSystem | StaticSystem


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
