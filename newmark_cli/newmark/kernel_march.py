"""The compiled kernel behind the same call as the SciPy march."""

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark import kernel
from newmark_cli.newmark.kernel import ProblemTables, State
from newmark_cli.newmark.scheme import SETTLED_BELOW, Scheme
from newmark_cli.problems.problem import Problem


def march(
    problem: Problem,
    scheme: Scheme,
    state: State,
    first: int,
    norms: Array,
    iterations: IndexArray,
) -> tuple[int, int]:
    """Advance ``state`` by ``len(norms)`` steps; see `newmark_cli.newmark.scipy_march.march`."""
    ending, done = kernel.march(  # type: ignore[no-untyped-call]
        problem.function,
        ProblemTables(problem.ints, problem.reals, problem.mass_values, *problem.pattern),
        scheme.tables,
        state,
        problem.t0,
        scheme.h,
        first,
        scheme.iteration_cap,
        SETTLED_BELOW,
        norms,
        iterations,
    )
    return ending, done
