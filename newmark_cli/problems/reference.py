"""Solutions to measure errors against: what a reference is, and how one is computed.

The reference of any problem comes from its underlying ordinary differential
equation, accelerations from the index-1 system, by the method of Dormand and
Prince of order 8, and back on the constraints every few steps.  It shares no code with the
integrators that are measured.  It ends where the motion meets a singular position, at which
that system has no solution.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from newmark_cli.problems import multipliers, singular, user_code
from newmark_cli.problems.dormand_prince import DormandPrince, StepVanishes
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.support import apart
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import InputError

#: Changes whenever `solution` may give other numbers: stored ones are then stale.
VERSION = 5

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
#: A motion is at a singular position if the smallest singular value falls below the first
#: part of its largest value so far; close to one, if it stops there, below the second.
_SINGULAR, _CLOSE = 1e-4, 0.1
#: Samples of each step that may have passed a singular position.
_FINER = 32
#: Constraints that an error names; most solutions that are kept.
_MOST_NAMED, _MOST_KNOWN = 8, 16
_EPS = float(np.finfo(float).eps)
#: What is left of an estimate when all solutions agree: rounding of the state.
_ROUNDING = 4 * _EPS
#: Part of its size by which a motion moves over a difference quotient of λ in time.
_NEXT = 1e-4
#: Part of themselves by which coordinates move to see what their rounding does.
_NUDGE = 1e-6
#: How much farther from the truth a solution may be than from another one, or the mean of
#: differences than from those with other steps: what is rounding in both may nearly agree.
_CHANCE = 3.0
#: Shares of their steps with which differences are taken again: the first two by a solution each,
#: and all of them at the end.
_SHARES = (0.93, 0.86, 0.79, 0.72, 0.65)


class NoReference(InputError):
    """A problem's motion cannot be computed up to the time that was asked for."""


class _Watch:
    """Looks out for singular positions along the steps of a motion, which it is told of."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.largest = problem, 0.0
        self.seen = [(problem.t0, problem.u0, problem.v0)]

    def judge(self, is_stuck: bool = False) -> None:
        """Require that what was seen since the last time has no singular position.

        Raises:
            NoReference: Names time and constraints.
        """
        times, u, v = map(np.array, zip(*self.seen, strict=True))
        g = singular.gradients(self.problem, times, u)
        if not np.all(np.isfinite(g)):
            return
        least = np.linalg.svd(g, compute_uv=False)[:, -1]
        self.largest = max(self.largest, least.max())
        ends: list[tuple[float, Array]] = []
        if singular.crossings(times, g):
            finer = np.linspace(times[0], times[-1], _FINER * (len(times) - 1) + 1)
            close = singular.gradients(self.problem, finer, CubicHermiteSpline(times, u, v)(finer))
            # Next to long steps of G, which only look like one, there is none.
            crossed = singular.crossings(finer, close)
            ends = [(t, close[np.argmin(np.abs(finer - t))]) for t in crossed]
        if least[-1] < (_CLOSE if is_stuck else _SINGULAR) * self.largest:
            ends.append((times[-1], g[-1]))
        for t, there in ends:
            names = singular.dependent(self.problem, there)
            further = len(names) - _MOST_NAMED
            listed = ", ".join(names[:_MOST_NAMED])
            raise NoReference(
                f"{self.problem.name}: no reference beyond t = {t - self.problem.t0:g}, close to "
                "which the motion meets a singular position, such as a dead centre, where these "
                f"constraints depend on each other: {listed}"
                + (f" and {further} more; end before it" if further > 0 else "; end before it")
            )
        del self.seen[:-2]


@dataclass(frozen=True, eq=False)
class Reference:
    """A solution at one time, and how far it may be trusted."""

    t: float  #: time since the problem's start (s)
    u: Array  #: (n,) coordinates and velocities
    v: Array
    multipliers: Array  #: (m,) λ
    scales: Array  #: (m,) what errors of λ are relative to, see `newmark_cli.problems.multipliers`
    source: str  #: where it comes from: "exact", "published" or "converged"
    u_error: float  #: estimated errors, largest component over largest component
    v_error: float
    multipliers_error: float  #: that of λ, the largest error of a multiplier over its scale


def relative_error(computed: Array, reference: Array) -> float:
    """max|computed − reference| / max|reference|; 0 where both vanish."""
    error, size = float(np.abs(computed - reference).max()), float(np.abs(reference).max())
    return error if error == 0 else error / size if size > 0 else np.inf


def solution(problem: Problem, t: float, on_work: Callable[[], None] = lambda: None) -> Reference:
    """The solution of any problem at a time since its start (s), as far as rounding allows.

    The estimated errors are three times the distances from a second solution whose
    tolerance is ten times as large, so that truncation is overestimated about thirtyfold;
    rounding is as large in both, and so is what a motion makes of it.  Two solutions may agree by
    chance, so the distances of v and λ are at least what a rounding of u in every step makes of
    them; it is much where a stiff spring lies far from the origin.  Where Φ_t or Φ'' come
    from differences there are two such solutions, with other steps of differences, as errors
    of these are nearly as large in all solutions; and what differences with still other
    steps change in v and λ at the end, |M⁻¹G S⁻¹| δΦ' and |S⁻¹| δΦ'' with S = GᵀM⁻¹G, is
    added.  So is what the motion does while t changes by its rounding.  ``on_work`` is called
    now and then; an exception that it raises ends the work.

    Raises:
        NoReference: When the motion does not get there: it meets a singular position, which is
            looked for with at most `singular.LARGEST` unknowns, the step size vanishes, there
            are too many steps, or it is so sensitive that rounding spoils it.
    """
    # The problem, and the same with other steps of differences; twice itself without any.
    shares = () if problem.rows_given == "exact" else _SHARES
    variants = [problem, *(replace(problem, reals=share * problem.reals) for share in shares)]
    variants += [problem] * (not shares)
    systems = [Index1(variant) for variant in variants]
    end, small = problem.t0 + t, problem.n + problem.m <= singular.LARGEST
    try:
        # A step that is much too long may overflow; what is not finite is not accepted.
        with np.errstate(all="ignore"):
            states = [
                _integrated(system, end, tolerance, on_work, _Watch(problem) if small else None)
                for system, tolerance in zip(systems, (_TOLERANCE, _COARSE, _COARSE), strict=False)
            ]
        (u, v, steps), others = states[0], [state[:2] for state in states[1:]]
        of_state = [
            system.accelerations(end, *state[:2])[1]
            for system, state in zip(systems, states, strict=False)
        ]
        changed = _changed_by_differences(variants, end, u, v)
        moved = _moved_by_rounding(systems[0], end, u, v)
        swung = _swung_by_rounding(systems[0], end, u, v, steps)
        scales = multipliers.weights(problem, end, u).scales(of_state[0])
    except InputError:
        raise
    except np.linalg.LinAlgError as error:
        raise NoReference(f"{problem.name}: no reference at t = {t:g}: {error}") from None
    except BaseException as error:  # of a problem in Python, an exit included
        if not (isinstance(error, Exception) or apart.inside()):
            raise
        reason = user_code.described(error)
        raise NoReference(f"{problem.name}: no reference at t = {t:g}: {reason}") from None
    u_error, v_error = (
        max(relative_error(other[k], of) for other in others) for k, of in enumerate((u, v))
    )
    if u_error > _WORST:
        raise NoReference(
            f"{problem.name}: no reference at t = {t:g}: the motion is so sensitive that its "
            f"solutions with tolerances {_TOLERANCE:g} and {_COARSE:g} are {u_error:.1g} apart"
        )

    def of_multipliers(other: Array) -> float:
        return multipliers.relative_error(other, of_state[0], scales)

    multipliers_error = max(map(of_multipliers, of_state[1:])) + of_multipliers(
        of_state[0] + changed[1]
    )
    multipliers_error = max(multipliers_error, of_multipliers(of_state[0] + swung[1]))
    v_error += relative_error(v + changed[0], v)
    v_error = max(v_error, relative_error(v + swung[0], v))
    return Reference(
        t=t,
        u=u,
        v=v,
        multipliers=of_state[0],
        scales=scales,
        source="converged",
        u_error=_ROUNDING + _CHANCE * u_error + relative_error(u + moved[0], u),
        v_error=_ROUNDING + _CHANCE * v_error + relative_error(v + moved[1], v),
        multipliers_error=_ROUNDING
        + _CHANCE * multipliers_error
        + of_multipliers(of_state[0] + moved[2]),
    )


#: u, v and λ at some times, (k, n), (k, n) and (k, m).
States = tuple[Array, Array, Array]

_known: dict[tuple[str, bytes], States] = {}


def along(problem: Problem, times: Array) -> States:
    """The solution at several times since the start (s), (k,), ascending.

    From each to the next by the method and the tolerance of `solution`, and back on the
    constraints there.  It does not look for singular positions: `solution` does, up to the end.

    Raises:
        NoReference: When the step size vanishes, or there are too many steps.
    """
    key = problem.content, times.tobytes()  # twins of a march ask for the same
    if key not in _known:
        if len(_known) >= _MOST_KNOWN:
            _known.clear()
        _known[key] = _along(problem, times)
    return _known[key]


def _along(problem: Problem, times: Array) -> States:
    t, u, v = problem.t0, problem.u0, problem.v0
    states = []
    for time in problem.t0 + times:
        system = Index1(replace(problem, t0=t, u0=u, v0=v))
        with np.errstate(all="ignore"):
            u, v, _ = _integrated(system, time, _TOLERANCE, lambda: None, None)
            states.append((u, v, system.accelerations(time, u, v)[1]))
        t = time
    u_all, v_all, multipliers_all = (np.array(of) for of in zip(*states, strict=True))
    return u_all, v_all, multipliers_all


def _changed_by_differences(
    variants: Sequence[Problem], t: float, u: Array, v: Array
) -> tuple[Array, Array]:
    """By how much other steps of differences may change v (n,) and λ (m,) at a state."""
    rate, curvature = np.abs(
        np.array([variant.constraint_derivatives(t, u, v) for variant in variants])
        - variants[0].constraint_derivatives(t, u, v)
    ).max(axis=0)
    if not (rate.any() or curvature.any()):
        return np.zeros(len(u)), np.zeros(len(rate))
    changed = Index1(variants[0]).changes(t, u)
    of_rates, of_curvatures = changed(np.diag(rate))[0], changed(np.diag(curvature))[1]
    return np.abs(of_rates).sum(axis=1), np.abs(of_curvatures).sum(axis=1)


def _moved_by_rounding(system: Index1, t: float, u: Array, v: Array) -> tuple[Array, Array, Array]:
    """By how much u (n,), v (n,) and λ (m,) change while t changes by its rounding."""
    a, here = system.accelerations(t, u, v)
    size, speed = float(np.abs(u).max()), float(np.abs(v).max())
    ahead = _NEXT * (size / speed if size * speed > 0 else 1.0)
    for step in (ahead, -ahead):  # past its last time a table has no values
        _, then = system.accelerations(t + step, u + step * v, v + step * a)
        if np.all(np.isfinite(then)):
            break
    unit = _EPS * abs(t)
    return unit * v, unit * a, unit * (then - here) / step


def _swung_by_rounding(
    system: Index1, t: float, u: Array, v: Array, steps: int
) -> tuple[float, Array]:
    """By how much v and λ (m,) change, as a rule, while every step rounds u.

    A misfit δ of u that changes a by α² δ swings with the rate α, and changes v by α δ.
    Roundings of many steps add up like their root.
    """
    a, here = system.accelerations(t, u, v)
    accelerated, pushed = 0.0, np.zeros(len(here))
    # Any two coordinates move apart in one of these patterns.
    for bit in range(len(u).bit_length()):
        signs = 1 - 2 * (np.arange(len(u)) >> bit & 1)
        there, then = system.accelerations(t, *system.projected(t, u + _NUDGE * signs * u, v))
        if np.all(np.isfinite(there)):
            accelerated = max(accelerated, float(np.abs(there - a).max()) / _NUDGE)
            pushed = np.maximum(pushed, np.abs(then - here) / _NUDGE)
    unit = 0.5 * _EPS * float(np.sqrt(steps))
    return unit * float(np.sqrt(accelerated * np.abs(u).max())), unit * pushed


def _integrated(
    system: Index1, end: float, tolerance: float, on_work: Callable[[], None], watch: _Watch | None
) -> tuple[Array, Array, int]:
    """(n,) coordinates and velocities at a time, and steps; with an eye on singular positions."""
    problem, n = system.problem, system.problem.n

    def rates(t: float, state: Array) -> Array:
        accelerations, _ = system.accelerations(t, state[:n], state[n:])
        return np.concatenate([state[n:], accelerations])

    t, u, v = problem.t0, problem.u0, problem.v0
    if t >= end:
        return u, v, 0
    sizes = _initial_sizes(system, end - t)
    step: float | None = None
    for steps in range(0, _MOST_STEPS, _STRETCH):
        on_work()
        sizes = np.maximum(sizes, [np.abs(u).max(), np.abs(v).max()])
        solver = DormandPrince(
            rates,
            t,
            np.concatenate([u, v]),
            end,
            relative=tolerance,
            absolute=tolerance * np.repeat(sizes, n),
            size=step,
        )
        for _ in range(_STRETCH):
            try:
                solver.step()
            except (StepVanishes, np.linalg.LinAlgError) as error:
                if watch is not None:
                    watch.judge(is_stuck=True)
                if not isinstance(error, StepVanishes):
                    raise
                raise NoReference(
                    f"{problem.name}: no reference beyond t = {solver.t - problem.t0:g}, where "
                    "the step size vanishes: the motion or its constraints are singular there"
                ) from None
            if watch is not None:
                watch.seen.append((solver.t, solver.y[:n], solver.y[n:]))
            if solver.t >= end:
                break
        t, step = solver.t, solver.taken
        if watch is not None:
            watch.judge()
        u, v = system.projected(t, solver.y[:n], solver.y[n:])
        if t >= end:
            return u, v, steps + _STRETCH
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
