"""Invariants of an exact motion: constraints, their rates, the multipliers, the energy."""

from typing import NamedTuple

import numpy as np
import scipy.sparse

from newmark_cli.newmark.march_data import State
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.redundancy import column_norms
from newmark_cli.support.arrays import Array

#: Names of the invariants, in the order of the CSV's rows.
INVARIANTS = ("position", "velocity", "multiplier", "energy")
#: Times the energy that there is one of an unstable march has, and the misfit that follows from
#: it, over its size.
UNSTABLE = 2.0
UNSTABLE_MISFIT = (UNSTABLE - 1) / (UNSTABLE + 1)


class Misfit(NamedTuple):
    """By how much a state misses an invariant, and what that is to be compared with.

    Sizes vanish where a motion turns.  What is reported is therefore the error over
    the largest size along the motion: see `newmark_cli.study.observers.invariants`.
    """

    errors: Array  #: (k,) with their signs; (1,) of the energy, (m,) of all others
    sizes: Array  #: (1,), or (m,) |λ₁| of multipliers, which differ in their units

    @property
    def error(self) -> float:
        """The largest error."""
        return _largest(self.errors)


def invariants(problem: Problem, t: float, state: State) -> dict[str, Misfit]:
    """`misfits` of the state of a march, and those of its multipliers, by name.

    Those of λ are λ − λ₁, where u and v imply λ₁ by the index-1 system; NaN where the state is
    not finite or its matrix is singular.  What errors of different multipliers are relative to is
    that of `newmark_cli.problems.multipliers`, in view of all of a motion.
    """
    u, v = np.asarray(state.fields[:2], float)
    by_name = misfits(problem, t, u, v)
    try:
        with np.errstate(all="ignore"):
            _, implied = Index1(problem).accelerations(t, u, v)
    except np.linalg.LinAlgError:
        implied = np.full(problem.m, np.nan)
    by_name["multiplier"] = Misfit(state.multipliers - implied, np.abs(implied))
    return {name: by_name[name] for name in INVARIANTS if name in by_name}


def misfits(problem: Problem, t: float, u: Array, v: Array) -> dict[str, Misfit]:
    """Misfits of coordinates and velocities by name, in the order of `INVARIANTS`.

    ==========  ==============================================  =====================
    name        errors                                          size
    ==========  ==============================================  =====================
    position    Φ_k / ‖G_k‖ (m): distance from the surface of   max |u|
                a constraint
    velocity    (Gᵀv + Φ_t)_k / ‖G_k‖ (m/s): speed at which     max |v|, |Φ_t| / ‖G‖
                it is left
    energy      E − E_0, E = T + V, where it is conserved       T + T_0 + |V − V_0|
    ==========  ==============================================  =====================

    G_k is the column of G of constraint k: dividing by its length makes links of any
    length, sliders and angles comparable, and the ratio to max |u| or max |v| reads
    in units of relative rounding.  NaN where the state is not finite.
    """
    with np.errstate(all="ignore"):
        values = problem.free_values(t, u, v)
        gradient = scipy.sparse.csc_array(
            (values.g, (problem.pattern.g_rows, problem.pattern.g_columns)),
            shape=(problem.n, problem.m),
        )
        lengths = column_norms(gradient)
        rate, _ = problem.constraint_derivatives(t, u, v)
        by_name = {
            "position": Misfit(values.phi / lengths, np.array([_largest(u)])),
            "velocity": Misfit(
                (gradient.T @ v + rate) / lengths,
                np.array([max(_largest(v), _largest(rate / lengths))]),
            ),
        }
        now, begin = (
            problem.energies(*at) for at in ((t, u, v), (problem.t0, problem.u0, problem.v0))
        )
        if now is not None and begin is not None:
            gained, released = now[0] - begin[0], begin[1] - now[1]
            size = now[0] + begin[0] + abs(released)
            by_name["energy"] = Misfit(np.array([gained - released]), np.array([size]))
    return by_name


def _largest(values: Array) -> float:
    return float(np.abs(values).max())
