"""Noise of λ along a march: rounding of the constraints, as the update relations carry it on.

At the end of a step Newton's iteration has brought the computed Φ as near to zero as machine
numbers allow.  So the exact one is Gᵀ δ − ρ: the coordinates are off by their rounding δ, and Φ
is computed with an error ρ, which is the larger of the two where constraints have many terms.
Accelerations that follow from such coordinates through V and K, and with them λ, are off by
∂v'/∂u times that in the step itself, and what stays in the past vectors adds to the next steps.
With numerical dissipation it dies out, and the sum has a variance that the relations alone
give; without, it grows for ever.
"""

import math

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from newmark_cli.newmark.integrator import Integrator, at_infinity
from newmark_cli.newmark.jacobian import scaling_factors
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

#: Rms relative error of a rounding, in units of eps, for mantissas spread log-uniformly.
ROUNDING = 0.212
#: Units in the last place around a state in which the rounding of Φ is looked at.
_UNITS_ASIDE = 64
_DRAWS = 32
_SEED = 20061012


def carried(integrator: Integrator) -> float:
    """Rms of v' when positions have independent errors, over that of a single error's v'.

    It does not depend on h; infinite without numerical dissipation.
    """
    advanced, true = at_infinity(integrator)
    passing, entering = advanced[:, :-1], advanced[:, -1]
    if not (integrator.damped and np.max(np.abs(np.linalg.eigvals(passing))) < 1):
        return np.inf
    variance = solve_discrete_lyapunov(passing, np.outer(entering, entering))
    past, now = true[:-1], true[-1]
    return float(np.sqrt(past @ variance @ past + now**2) / abs(now))


def violations(problem: Problem, scheme: Scheme, t: float, u: Array, v: Array) -> Array:
    """(draws, m) Φ at the end of a step, as rounding leaves it: draws of Gᵀ δ − ρ.

    ρ comes from the problem's own function at machine numbers near the state u, v (n,).  In
    compensated evaluation Φ changes by Gᵀ Δ: Δ, about h v, is rounded in place of u, and so is
    the product.
    """
    dtype, none = scheme.dtype, np.zeros(problem.m, scheme.dtype)
    u, v = u.astype(dtype), v.astype(dtype)
    entries = problem.values(t, u, v, none, dtype).g
    moved = dtype(scheme.h) * v if scheme.compensated else u
    unit = np.where(moved == 0, 0, np.abs(np.spacing(moved))).astype(float)
    rows, columns = problem.pattern.g_rows, problem.pattern.g_columns

    def constraints(moved: Array) -> Array:
        if not scheme.compensated:
            return problem.values(t, moved, v, none, dtype).phi
        phi = np.zeros(problem.m, dtype)
        np.add.at(phi, columns, entries * moved[rows])
        return phi

    random, drawn = np.random.default_rng(_SEED), np.empty((_DRAWS, problem.m))
    for k in range(_DRAWS):
        aside = random.integers(-_UNITS_ASIDE, _UNITS_ASIDE + 1, problem.n) * unit
        drawn[k] = problem.along(entries, aside) - constraints((moved + aside).astype(dtype))
    # What all draws share is how far the state itself is off, which is not known.
    drawn = (drawn - drawn.mean(axis=0)) * math.sqrt(_DRAWS / (_DRAWS - 1))
    roundings = random.uniform(-0.5, 0.5, (_DRAWS, problem.n)) * unit
    return np.asarray(drawn + [problem.along(entries, off) for off in roundings])


def multiplier_noise(jacobian: Array, scheme: Scheme, violated: Array) -> float:
    """Rms of the change of ‖λ‖ that comes with constraints that a single step has not met.

    From J (n + m, n + m) of the (u, λ) form, index 3, which may be singular
    (numpy.linalg.LinAlgError), and (draws, m) Φ at the end of the step.
    """
    draws, m = violated.shape
    n = len(jacobian) - m
    left, right = scaling_factors(scheme, n, m)
    rhs = np.zeros((n + m, draws))
    rhs[n:] = left[n:, None] * violated.T
    changes = right[n:, None] * np.linalg.solve(left[:, None] * jacobian * right, rhs)[n:]
    return float(np.sqrt(np.sum(changes**2) / draws))
