"""A start of the user's own, taken if it meets the constraints, or brought onto them.

Also the velocities from which the trapezoidal rule's multipliers do not alternate.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse

from newmark_cli.problems.differences import LONGEST_STEP, STEP_RATIO, extrapolated, steps_along
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.problems.redundancy import column_norms, gradient_of
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError

#: What a start may miss of a constraint, relative to the largest coordinate, and to the
#: largest velocity.
TOLERANCE = 1e-9

#: Relative errors of a curvature, by `Problem.rows_given`.
_NOISE = {"exact": 2.2e-16, "differences": 1e-11}


def started(problem: Problem, u0: Array, v0: Array, project: bool = False) -> Problem:
    """The problem with another start u0, v0 (n,).

    With ``project`` one that does not meet Φ = 0 and Gᵀ v + Φ_t = 0 is replaced by the nearest
    that does: first the coordinates, then at these the velocities, both in the norm of M,
    ‖d‖² = dᵀ M d.

    Raises:
        ArgumentError: When the start misses the constraints, with the numbers, or cannot
            be brought onto them.
    """
    if project:
        u0, v0 = _projected(problem, u0, v0)
    elif found := missed(problem, u0, v0):
        raise ArgumentError(
            f"{found[0]} misses the constraints: {found[1]}; correct it, or let project=True "
            "replace it by the nearest that fits"
        )
    return replace(problem, u0=u0, v0=v0)


def corrected_velocity(problem: Problem, h: float) -> Array:
    """Initial velocities from which the trapezoidal rule's multipliers do not alternate.

    The rule meets Φ = 0 at every step.  The error e = Gᵀ (v − v_exact) then follows
    e_{n+1} = −e_n − (h²/6) Gᵀ u‴, which rests at −(h²/12) Gᵀ u‴: from exact velocities an
    alternating part remains, and with it one of λ that does not vanish with h.  The
    velocities returned have this e and are otherwise the nearest to ``v0`` in the norm of
    M.  The initial accelerations are to stay those of ``v0``.

    It is right for the trapezoidal rule only: Newmark with β = 1/4, γ = 1/2, generalized-α
    with ρ∞ = 1, HHT with α = 0.
    """
    wanted = -(h**2) / 12 * constraint_jerk(problem)
    change, _ = Index1(problem).least_change(problem.t0, problem.u0, wanted)
    return np.asarray(problem.v0 + change)


def constraint_jerk(problem: Problem) -> Array:
    """(m,) Gᵀ u‴ at the start.

    Φ'' = Gᵀ u'' + κ = 0 along the motion, differentiated once more, with R = dGᵀ/dt and
    ∂κ/∂v = 2R:

        Gᵀ u‴ = −3 R u'' − d/ds κ(u + s v, v, t + s) at s = 0.

    The last term vanishes where Φ is at most quadratic and free of t; elsewhere it is found
    by central differences.
    """
    t, u, v = problem.t0, problem.u0, problem.v0
    a, _ = Index1(problem).accelerations(t, u, v)
    _, curvature, r, _ = problem.constraint_rows(t, u, v, a)
    turned = problem.along(r, a)
    if problem.quadratic:
        return np.asarray(-3 * turned)
    steps = steps_along(u, v, LONGEST_STEP)
    differences = np.empty((len(steps), problem.m))
    for k, step in enumerate(steps.tolist()):
        ahead, behind = (
            problem.constraint_rows(t + shift, u + shift * v, v, a).curvature
            for shift in (step, -step)
        )
        differences[k] = (ahead - behind) / (2 * step)
    noise = _NOISE[problem.rows_given] * max(float(np.abs(curvature).max()), 1e-300)
    return np.asarray(-3 * turned - extrapolated(differences, STEP_RATIO, noise / steps))


def _projected(problem: Problem, u0: Array, v0: Array) -> tuple[Array, Array]:
    system = Index1(problem)
    try:
        u = system.nearest(problem.t0, u0)
        _, v = system.projected(problem.t0, u, v0)
    except np.linalg.LinAlgError:
        u = v = np.full(problem.n, np.nan)
    if not (np.all(np.isfinite(u)) and np.all(np.isfinite(v))):
        raise ArgumentError(
            "u0 cannot be projected onto the constraints: they depend on each other on the way"
        )
    away = _distances(problem, u)
    worst = int(np.argmax(away))
    if away[worst] > TOLERANCE * float(np.abs(u).max()):
        raise ArgumentError(
            "u0 cannot be projected onto the constraints: "
            f"{problem.constraint_names[worst]} is still missed by {away[worst]:.3g}; "
            "give a position that is closer to them"
        )
    return u, v


def missed(problem: Problem, u0: Array, v0: Array) -> tuple[str, str] | None:
    """Which of u0, v0 (n,) does not meet the constraints, and by how much; None if both do."""
    away = _distances(problem, u0)
    worst = int(np.argmax(away))
    if away[worst] > TOLERANCE * float(np.abs(u0).max()):
        phi = problem.constraint_values(problem.t0, u0)
        text = f"max |Φ| = {np.abs(phi).max():.3g}, by {away[worst]:.3g}"
        return "u0", f"{text} at {problem.constraint_names[worst]}"
    gradient, lengths = _gradient(problem, u0)
    rate, _ = problem.constraint_derivatives(problem.t0, u0, v0)
    misfit = np.asarray(gradient.T @ v0 + rate)
    speed = max(float(np.abs(v0).max()), float(np.abs(rate / lengths).max()))
    worst = int(np.argmax(np.abs(misfit) / lengths))
    if abs(misfit[worst]) > TOLERANCE * lengths[worst] * speed:
        away = abs(misfit[worst]) / lengths[worst]
        text = f"max |Gᵀv + Φ_t| = {np.abs(misfit).max():.3g}, by {away:.3g}"
        return "v0", f"{text} at {problem.constraint_names[worst]}"
    return None


def _distances(problem: Problem, u: Array) -> Array:
    """(m,) |Φ_k| / ‖G_k‖: the distance from what each constraint allows."""
    _, lengths = _gradient(problem, u)
    return np.asarray(np.abs(problem.constraint_values(problem.t0, u)) / lengths)


def _gradient(problem: Problem, u: Array) -> tuple[scipy.sparse.csc_array, Array]:
    """(n, m) sparse G, and the (m,) lengths of its columns."""
    gradient = gradient_of(problem, u)
    lengths = column_norms(gradient)
    if not np.all(lengths > 0):
        k = int(np.argmin(lengths > 0))
        raise ProblemError(f"{problem.constraint_names[k]} does not constrain this start")
    return gradient, lengths
