"""The consistent state that a march starts from."""

import numpy as np

from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem


def initial_state(problem: Problem, scheme: Scheme) -> State:
    """State of the march at the initial time, in the scheme's precision.

    Φ is carried from 0 on in compensated evaluation: the start meets the
    constraints by definition, not just to the rounding of its coordinates.
    """
    a, multipliers = Index1(problem).accelerations(problem.t0, problem.u0, problem.v0)
    fields = np.array([problem.u0, problem.v0, a, a])
    past = scheme.relations.start @ fields[:3]
    dtype = scheme.dtype
    return State(
        fields.astype(dtype),
        past.astype(dtype),
        multipliers.astype(dtype),
        lows=np.zeros((2, problem.n), dtype),
        phi=np.zeros(problem.m, dtype),
    )
