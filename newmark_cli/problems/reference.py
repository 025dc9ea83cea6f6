"""Solutions to measure errors against: what a reference is, and how one is computed.

The reference of any problem comes from its underlying ordinary differential
equation, accelerations from the index-1 system, by the method of Dormand and
Prince of order 8, and back on the constraints every few steps.  It shares no code
with the integrators that are measured.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.errors import InputError
from newmark_cli.problems import user_code
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem

#: Changes whenever `solution` may give other numbers: stored ones are then stale.
VERSION = 1

#: Local tolerances of the solution and of the one it is compared with, relative to
#: the largest coordinate and velocity.  The first is close to the least that
#: rounding allows.
_TOLERANCE, _COARSE = 3e-14, 3e-13
#: Steps between two projections; a new start after each costs some growth of the step.
_STRETCH = 10
#: Andrews' mechanism takes 280 to t = 0.03.
_MOST_STEPS = 200_000
#: Largest estimated error of u with which a solution is still one.
_WORST = 1e-3
#: What is left of an estimate when both solutions agree: rounding of the state.
_ROUNDING = 4 * float(np.finfo(float).eps)


class NoReference(InputError):
    """A problem's motion cannot be computed up to the time that was asked for."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A solution at one time, and how far it may be trusted.

    Attributes:
        t: Time since the problem's start (s).
        u, v: (n,) coordinates and velocities.
        multipliers: (m,) λ.
        source: Where it comes from: "exact", "published" or "converged".
        u_error, v_error, multipliers_error: Estimated errors, largest component
            over largest component.
    """

    t: float
    u: Array
    v: Array
    multipliers: Array
    source: str
    u_error: float
    v_error: float
    multipliers_error: float


def relative_error(found: Array, reference: Array) -> float:
    """max|found − reference| / max|reference|; 0 where both vanish."""
    error, size = float(np.abs(found - reference).max()), float(np.abs(reference).max())
    return error if error == 0 else error / size if size > 0 else np.inf


def solution(problem: Problem, t: float, on_work: Callable[[], None] = lambda: None) -> Reference:
    """The solution of any problem, converged as far as rounding allows.

    The estimated errors are the distances from a second solution whose tolerance
    is ten times as large, so that truncation is overestimated about tenfold;
    rounding is as large in both, and so is what a motion makes of it.

    Args:
        problem: The problem.
        t: Time since its start (s), not negative.
        on_work: Called now and then; an exception that it raises ends the work.

    Raises:
        NoReference: When the motion does not get there: the constraints lose rank
            on the way, the step size vanishes, there are too many steps, or it is
            so sensitive that rounding spoils it.
    """
    system = Index1(problem)
    end = problem.t0 + t
    try:
        # A step that is much too long may overflow; what is not finite is not accepted.
        with np.errstate(all="ignore"):
            (u, v), coarse = (
                _integrated(system, end, tolerance, on_work) for tolerance in (_TOLERANCE, _COARSE)
            )
        _, multipliers = system.accelerations(end, u, v)
        _, coarse_multipliers = system.accelerations(end, *coarse)
    except InputError:
        raise
    except np.linalg.LinAlgError as error:
        raise NoReference(f"{problem.name}: no reference at t = {t:g}: {error}") from None
    except Exception as error:  # of a problem in Python
        reason = user_code.described(error)
        raise NoReference(f"{problem.name}: no reference at t = {t:g}: {reason}") from None
    u_error = relative_error(coarse[0], u)
    if u_error > _WORST:
        raise NoReference(
            f"{problem.name}: no reference at t = {t:g}: the motion is so sensitive that its "
            f"solutions with tolerances {_TOLERANCE:g} and {_COARSE:g} are {u_error:.1g} apart"
        )
    return Reference(
        t=t,
        u=u,
        v=v,
        multipliers=multipliers,
        source="converged",
        u_error=_ROUNDING + u_error,
        v_error=_ROUNDING + relative_error(coarse[1], v),
        multipliers_error=_ROUNDING + relative_error(coarse_multipliers, multipliers),
    )


def _integrated(
    system: Index1, end: float, tolerance: float, on_work: Callable[[], None]
) -> tuple[Array, Array]:
    """Coordinates and velocities at a time."""
    # With scipy.optimize behind it this is a tenth of what starting a command takes.
    from scipy.integrate import DOP853

    problem, n = system.problem, system.problem.n

    def rates(t: float, state: Array) -> Array:
        accelerations, _ = system.accelerations(t, state[:n], state[n:])
        return np.concatenate([state[n:], accelerations])

    t, u, v = problem.t0, problem.u0, problem.v0
    if t >= end:
        return u, v
    sizes = _initial_sizes(system, end - t)
    step = np.inf
    for _ in range(0, _MOST_STEPS, _STRETCH):
        on_work()
        sizes = np.maximum(sizes, [np.abs(u).max(), np.abs(v).max()])
        solver = DOP853(
            rates,
            t,
            np.concatenate([u, v]),
            end,
            rtol=tolerance,
            # scipy-stubs does not know that each component may have its own.
            atol=tolerance * np.repeat(sizes, n),  # type: ignore[arg-type]
            first_step=min(step, end - t) if step < np.inf else None,
        )
        for _ in range(_STRETCH):
            trouble = solver.step()
            if trouble is not None:
                raise NoReference(
                    f"{problem.name}: no reference beyond t = {solver.t - problem.t0:g}, where "
                    "the step size vanishes: the motion or its constraints are singular there"
                )
            if solver.status != "running":
                break
        t, step = float(solver.t), float(solver.step_size or np.inf)
        u, v = system.projected(t, solver.y[:n], solver.y[n:])
        if t >= end:
            return u, v
    raise NoReference(
        f"{problem.name}: no reference beyond t = {t - problem.t0:g}, "
        f"which {_MOST_STEPS} steps reached"
    )


def _initial_sizes(system: Index1, duration: float) -> Array:
    """(2,) sizes of coordinates and velocities that tolerances of the first steps refer to.

    From rest a motion gathers speed: at most what its first acceleration gives over
    the whole time, or over a length as large as the coordinates.
    """
    problem = system.problem
    length, speed = float(np.abs(problem.u0).max()), float(np.abs(problem.v0).max())
    accelerations, _ = system.accelerations(problem.t0, problem.u0, problem.v0)
    push = float(np.abs(accelerations).max())
    speed = max(speed, min(push * duration, np.sqrt(push * length) or np.inf))
    length = length or speed * duration or 1.0
    return np.array([length, speed or length / duration])
