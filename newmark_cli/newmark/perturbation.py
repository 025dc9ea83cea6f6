"""Section 2 of the paper as an experiment: what a perturbed residual does.

At convergence the residual is rounding.  A perturbation of size ε in one row
block changes the Newton correction by the corresponding block column of J⁻¹
times ε (eq. 7), so that ‖δq‖/ε against h has the orders of the blocks of J⁻¹.
"""

import numpy as np

from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.solvers import LinearSystem
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.algebra import norm
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

#: Size of the perturbation; a power of two, so that dividing by it is exact.
EPSILON = 2.0**-20
_SEED = 20061012


def perturbation(row: str, size: int) -> Array:
    """(size,) the seeded unit vector that perturbs a row block; the same at every h."""
    vector = np.random.default_rng([_SEED, *map(ord, row)]).normal(size=size)
    return np.asarray(vector / norm(vector))


def sensitivities(
    problem: Problem, scheme: Scheme, t: float, state: State, system: LinearSystem | None = None
) -> dict[tuple[str, str], float]:
    """(row block, unknown) → ‖δq̄‖/ε for a perturbation of each row block of b̄ at a state.

    The perturbation and what it does are those of the scaled system J̄ q̄ = −b̄, which is dense
    when omitted.

    Raises:
        numpy.linalg.LinAlgError: When J̄ is singular.
    """
    n, m = problem.n, problem.m
    jacobian = (system or DenseSystem(problem, scheme)).balanced(t, state)
    form = scheme.form
    sizes = form.sizes(n, m)
    ends = np.cumsum(sizes)
    ratios = {}
    for row, size, end in zip(form.rows, sizes, ends, strict=True):
        rhs = np.zeros(jacobian.size)
        rhs[end - size : end] = -EPSILON * perturbation(row, size)
        change = np.split(jacobian.solve(rhs), ends[:-1])
        for unknown, block in zip(form.solved, change, strict=True):
            ratios[row, unknown] = norm(block) / EPSILON
    return ratios
