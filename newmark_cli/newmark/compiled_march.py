"""The compiled kernel behind the same call as the SciPy march."""

import numpy as np

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark import kernel
from newmark_cli.newmark.constraints import FormulationTables, constraining_of
from newmark_cli.newmark.march_data import ProblemTables, Record, State, recording
from newmark_cli.newmark.scheme import Scheme, Tolerance
from newmark_cli.problems.problem import Problem


def march(
    problem: Problem,
    scheme: Scheme,
    state: State,
    first: int,
    norms: Array,
    iterations: IndexArray,
    record: Record | None = None,
    extra: FormulationTables | None = None,
) -> tuple[int, int]:
    """Advance ``state`` by ``len(norms)`` steps; see `newmark_cli.newmark.scipy_march.march`.

    ``extra`` is the scheme's formulation as the kernel reads it, found anew when omitted.
    """
    if extra is None and (constraining := constraining_of(problem, scheme)):
        extra = constraining.tables()
    dtype = scheme.dtype
    stop = scheme.stop or Tolerance()
    ending, done = kernel.march(  # type: ignore[no-untyped-call]
        problem.function,
        None if extra is None else problem.derivatives,
        ProblemTables(
            problem.ints,
            problem.reals.astype(dtype),
            problem.mass_values.astype(dtype),
            *problem.pattern,
        ),
        scheme.tables,
        extra,
        state,
        scheme.compensated,
        problem.t0,
        scheme.h,
        first,
        scheme.iteration_cap,
        scheme.settled_below,
        stop.absolute,
        stop.relative,
        norms,
        iterations,
        recording(state, np.empty(0)) if record is None else record,
    )
    return ending, done
