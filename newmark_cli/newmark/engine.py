"""Which of the two engines marches a problem."""

from collections.abc import Callable
from functools import partial

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark import kernel_march, scipy_march
from newmark_cli.newmark.linear import choice
from newmark_cli.newmark.linear.systems import LinearSystem
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem

#: See `newmark_cli.newmark.scipy_march.march`.
March = Callable[[Problem, Scheme, State, int, Array, IndexArray], tuple[int, int]]


def march_with(solver: str, problem: Problem, system: LinearSystem) -> March:
    """The kernel for compiled problems and dense matrices, else the SciPy march.

    Args:
        solver: Linear solver, as `newmark_cli.newmark.linear.choice.choose` gives it.
        problem: The problem.
        system: Its linear system, which the SciPy march solves.
    """
    if solver == choice.DENSE and problem.compiled:
        return kernel_march.march
    return partial(scipy_march.march, system=system)
