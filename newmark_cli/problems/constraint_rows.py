"""Terms of Φ' and Φ'' of a problem in Python, and their tangents to u.

Along a motion with u' = v the constraints change by Φ' = Gᵀ v + rate, and with u'' = w
by Φ'' = Gᵀ w + curvature.  Four functions make up what a problem says of them:

======================================  ======  ========================================
function                                shape   value
======================================  ======  ========================================
``constraint_rate(u, t)``               (m,)    Φ_t
``curvature(u, v, t)``                  (m,)    d²/ds² Φ(u + s v, t + s) at s = 0
``rate_gradient(u, v, t)``              (n, m)  d/ds G(u + s v, t + s)
``acceleration_gradient(u, v, w, t)``   (n, m)  d/ds G(u + s w, t)
                                                + d²/ds² G(u + s v, t + s)
======================================  ======  ========================================

The last two are the transposes of ∂Φ'/∂u and ∂Φ''/∂u.  Each is the user's, or follows
from G where Φ is at most quadratic in u and free of t, or is found by differences.  Where
the user's functions are compiled, so are all of these.  Compiling takes long: for one
problem only what asks its Φ and G at given states is compiled, once and with one call of
each; where these states are, and what follows from the values, is compiled for all problems.
"""

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from newmark_cli.cached_code import cached_njit
from newmark_cli.problems.differences import (
    Compiler,
    copy_vector,
    copying,
    flatten,
    nothing,
    size_of,
)

#: Steps (s) of differences in time.  The longest is short enough for motions of some
#: hundred radians a second, the shortest for some thousand.  No power of two stands
#: between them, lest all be periods of one motion.
LONGEST_STEP, STEP_RATIO, STEPS = 1e-2, 1.9, 7
_SHRINKING = STEP_RATIO ** -np.arange(STEPS)

#: The four functions, as a definition calls them.
NAMES = ("constraint_rate", "curvature", "rate_gradient", "acceleration_gradient")


def derivatives(
    functions: Mapping[str, Any],
    given: Mapping[str, Any],
    compile_: Compiler,
    quadratic: bool = False,
) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives`.

    Args:
        functions: ``constraints`` and ``gradient`` of the user.
        given: Those of the four functions that are the user's, by their names.
        compile_: Compiles what is returned if all of these are compiled.
        quadratic: Whether Φ is at most quadratic in u and free of t.
    """
    missing = [name for name in NAMES if name not in given]
    if not missing:
        computed: Any = nothing
    elif quadratic:
        computed = of_quadratic(functions, compile_)
    else:
        computed = by_differences(functions, missing, compile_)
    if not given:
        return computed  # type: ignore[no-any-return]
    give_rate, give_curvature, give_r, give_q = (
        _giving(name, given[name], compile_) if name in given else nothing for name in NAMES
    )

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        computed(t, u, v, w, ints, reals, rate, curvature, r_values, q_values)
        give_rate(t, u, v, w, rate)
        give_curvature(t, u, v, w, curvature)
        give_r(t, u, v, w, r_values)
        give_q(t, u, v, w, q_values)

    return compile_(derivatives)


def _giving(name: str, function: Any, compile_: Compiler) -> Any:
    """Overwrites an array with what one of the user's functions returns."""
    copy = copying(compile_)

    def constraint_rate(t, u, v, w, out):  # type: ignore[no-untyped-def]
        copy.vector(function(u, t), out)

    def curvature(t, u, v, w, out):  # type: ignore[no-untyped-def]
        copy.vector(function(u, v, t), out)

    def rate_gradient(t, u, v, w, out):  # type: ignore[no-untyped-def]
        copy.flat(function(u, v, t), out)

    def acceleration_gradient(t, u, v, w, out):  # type: ignore[no-untyped-def]
        copy.flat(function(u, v, w, t), out)

    return compile_(
        {
            "constraint_rate": constraint_rate,
            "curvature": curvature,
            "rate_gradient": rate_gradient,
            "acceleration_gradient": acceleration_gradient,
        }[name]
    )


def by_differences(
    functions: Mapping[str, Any],
    wanted: Collection[str],
    compile_: Compiler,
    longest: float = LONGEST_STEP,
) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives` by central differences.

    They find their own step.

    Args:
        functions: ``constraints`` and ``gradient`` of the user.
        wanted: Those of the four functions that are; the others may remain as they were.
        compile_: Compiles what is returned if both are compiled.
        longest: Longest step (s), see `LONGEST_STEP`.
    """
    phi_of, gradient_of = functions["constraints"], functions["gradient"]
    copy = copying(compile_)
    wanted = {*wanted}
    in_time = bool(wanted & {"constraint_rate", "curvature"})
    along_v = bool(wanted - {"constraint_rate"})
    along_w = "acceleration_gradient" in wanted

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        states, times, phi, gradients = _states(
            t, u, v, w, rate, longest, in_time, along_v, along_w
        )
        for k in range(states.shape[0]):
            copy.matrix(gradient_of(states[k], times[k]), gradients[k])
        for k in range(phi.shape[0]):
            copy.vector(phi_of(states[k], times[k]), phi[k])
        _differentiate(
            phi, gradients, u, v, w, longest, in_time, along_v, along_w,
            rate, curvature, r_values, q_values,
        )  # fmt: skip

    return compile_(derivatives)


def of_quadratic(functions: Mapping[str, Any], compile_: Compiler) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives`, exactly, of such a Φ.

    It is at most quadratic in u and free of t, so that G is affine in u:
    G(u + s v) − G(u) = s (G(v) − G(0)).
    """
    gradient_of, copy = functions["gradient"], copying(compile_)

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        directions, gradients = _directions(v, w, rate)
        for k in range(3):
            copy.matrix(gradient_of(directions[k], t), gradients[k])
        _take_differences(gradients, v, rate, curvature, r_values, q_values)

    return compile_(derivatives)


def rates(functions: Mapping[str, Any], given: Mapping[str, Any]) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.rates`, by differences in plain Python.

    Args:
        functions: ``constraints`` and ``gradient`` of the user.
        given: The user's ``constraint_rate`` and ``curvature``, as far as there are any.
    """
    phi_of, gradient_of = functions["constraints"], functions["gradient"]

    def rates(t, u, v, ints, reals, rate, curvature):  # type: ignore[no-untyped-def]
        steps = steps_along(u, v, LONGEST_STEP)
        phi, drift, turn = np.empty((3, 2, STEPS, len(rate)))
        for k, h in enumerate(steps.tolist()):
            for i, shift in enumerate((h, -h)):
                then = t + shift
                phi[i, k] = phi_of(u, then)
                drift[i, k] = v @ gradient_of(u, then)
                turn[i, k] = v @ gradient_of(u + shift * v, then)
        size, none = steps[:, None], np.zeros(STEPS)
        rate[:] = extrapolated((phi[0] - phi[1]) / (2 * size), STEP_RATIO, none)
        # As in `by_differences`, in one tableau.
        here = phi_of(u, t)
        second = (phi[0] - here + (phi[1] - here)) / size**2
        second += (drift[0] - drift[1] + (turn[0] - turn[1])) / (2 * size)
        curvature[:] = extrapolated(second, STEP_RATIO, none)
        if "constraint_rate" in given:
            rate[:] = given["constraint_rate"](u, t)
        if "curvature" in given:
            curvature[:] = given["curvature"](u, v, t)

    return rates


# What the functions above are made of is compiled once, for all problems.


@cached_njit(nogil=True, error_model="numpy")
def _states(  # type: ignore[no-untyped-def]
    t, u, v, w, rate, longest, in_time, along_v, along_w
):
    """Where Φ and G are asked for: here, and before and after along up to three ways.

    Returns:
        (k, n) coordinates, (k,) times, and arrays for Φ, at those of the first way, and for G.
    """
    count = 1 + 2 * STEPS * (int(in_time) + int(along_v) + int(along_w))
    states, times = np.empty((count, u.shape[0])), np.empty(count)
    copy_vector(u, states[0])
    times[0], k = t, 1
    for way, wanted in enumerate((in_time, along_v, along_w)):
        if not wanted:
            continue
        direction = w if way == 2 else v
        steps = longest * _SHRINKING
        if way > 0:
            steps = steps_along(u, direction, longest if way == 1 else np.inf)
        for h in steps:
            for shift in (h, -h):
                times[k] = t if way == 2 else t + shift
                for i in range(u.shape[0]):
                    states[k, i] = u[i] + (0.0 if way == 0 else shift * direction[i])
                k += 1
    m = rate.shape[0]
    of_phi = 1 + 2 * STEPS * int(in_time)
    return states, times, np.empty((of_phi, m)), np.empty((count, u.shape[0], m))


@cached_njit(nogil=True, error_model="numpy")
def _differentiate(  # type: ignore[no-untyped-def]
    phi, gradients, u, v, w, longest, in_time, along_v, along_w,
    rate, curvature, r_values, q_values,
):  # fmt: skip
    """The four from Φ and G at `_states`, as far as these are there."""
    _, n, m = gradients.shape
    size = _size(gradients[0].reshape(n * m))
    steps, way = longest * _SHRINKING, 1
    if in_time:
        rounding = _rounding(size * _size(u), steps, 1)
        copy_vector(extrapolated(_first(phi[1:], steps), STEP_RATIO, rounding), rate)
        # Φ'' = (Gᵀ v)' along the motion + (Φ_t)': first differences of G, which lose
        # less than second ones of Φ; those remain for a Φ that depends on time.
        drift = _first(_products(gradients[1:], v), steps)
        second = _second(phi[1:], phi[0], steps)
        way += 2 * STEPS
    if along_v:
        along = steps_along(u, v, longest)
        there = gradients[way:]
        if in_time:
            turn = _first(_products(there, v), along)
            rounding = _rounding(size * _size(v), along, 1)
            turned = extrapolated(turn, STEP_RATIO, rounding)
            rounding = _rounding(size * _size(v), steps, 1)
            drifted = extrapolated(drift, STEP_RATIO, rounding)
            rounding = _rounding(size * _size(u), steps, 2)
            bent = extrapolated(second, STEP_RATIO, rounding)
            for k in range(m):
                curvature[k] = turned[k] + drifted[k] + bent[k]
        flat = there.reshape(there.shape[0], n * m)
        rounding = _rounding(size, along, 1)
        copy_vector(extrapolated(_first(flat, along), STEP_RATIO, rounding), r_values)
        if along_w:
            rounding = _rounding(size, along, 2)
            second = _second(flat, gradients[0].reshape(n * m), along)
            bent = extrapolated(second, STEP_RATIO, rounding)
            steps = steps_along(u, w, np.inf)
            rounding = _rounding(size, steps, 1)
            turned = extrapolated(_first(flat[2 * STEPS :], steps), STEP_RATIO, rounding)
            for e in range(n * m):
                q_values[e] = turned[e] + bent[e]


@cached_njit(nogil=True, error_model="numpy")
def _directions(v, w, rate):  # type: ignore[no-untyped-def]
    """(3, n) none, along v, and along w; an array for G there."""
    directions = np.zeros((3, v.shape[0]))
    copy_vector(v, directions[1])
    copy_vector(w, directions[2])
    return directions, np.empty((3, v.shape[0], rate.shape[0]))


@cached_njit(nogil=True, error_model="numpy")
def _take_differences(  # type: ignore[no-untyped-def]
    gradients, v, rate, curvature, r_values, q_values
):
    """The four from G at `_directions`."""
    m = rate.shape[0]
    changes = gradients[1:] - gradients[0]
    curvatures = _products(changes, v)[0]
    for k in range(m):
        rate[k], curvature[k] = 0.0, curvatures[k]
    flatten(changes[0], r_values)
    flatten(changes[1], q_values)


@cached_njit(nogil=True, error_model="numpy")
def _products(gradients, v):  # type: ignore[no-untyped-def]
    """(k, m) Gᵀ v of (k, n, m) G."""
    count, n, m = gradients.shape
    products = np.zeros((count, m))
    for c in range(count):
        for i in range(n):
            for k in range(m):
                products[c, k] += gradients[c, i, k] * v[i]
    return products


@cached_njit(nogil=True, error_model="numpy")
def _size(vector):  # type: ignore[no-untyped-def]
    return size_of(vector, 0.0)


@cached_njit(nogil=True, error_model="numpy")
def _first(values, steps):  # type: ignore[no-untyped-def]
    """(k, m) first derivatives from values ahead and behind in turn."""
    found = np.empty((steps.shape[0], values.shape[1]))
    for k in range(steps.shape[0]):
        for i in range(values.shape[1]):
            found[k, i] = (values[2 * k, i] - values[2 * k + 1, i]) / (2 * steps[k])
    return found


@cached_njit(nogil=True, error_model="numpy")
def _second(values, here, steps):  # type: ignore[no-untyped-def]
    """(k, m) second derivatives from values ahead and behind in turn, and here."""
    found = np.empty((steps.shape[0], values.shape[1]))
    for k in range(steps.shape[0]):
        for i in range(values.shape[1]):
            bent = values[2 * k, i] - here[i] + (values[2 * k + 1, i] - here[i])
            found[k, i] = bent / (steps[k] * steps[k])
    return found


@cached_njit(nogil=True, error_model="numpy")
def _rounding(size, steps, order):  # type: ignore[no-untyped-def]
    """Rounding, at each step, of differences of numbers of this size."""
    return 2.2e-16 * size / steps**order


@cached_njit(nogil=True, error_model="numpy")
def steps_along(u, v, longest):  # type: ignore[no-untyped-def]
    """Steps (s), longest first, that move no coordinate by more than 3 % of the largest.

    Args:
        u, v: (n,) coordinates and velocities.
        longest: Longest step (s) allowed.
    """
    size, speed = _size(u), _size(v)
    if size == 0:
        size = 1.0
    allowed = 3e-2 * size / speed if speed > 0 else 1.0
    return min(longest, allowed) * _SHRINKING


@cached_njit(nogil=True, error_model="numpy")
def extrapolated(differences, ratio, rounding):  # type: ignore[no-untyped-def]
    """Limit of central differences for steps that shrink by a ratio, each column its own.

    Romberg's tableau; of its entries the one that differs least from its neighbours
    (Ridders, Advances in Engineering Software 4, 1982), so that truncation need not be
    known.  Nor need rounding, but where it is known, entries that agree with their
    neighbours by chance are not taken for better than they can be.

    Args:
        differences: (steps, m) central differences, longest step first.
        ratio: Of a step to the next.
        rounding: (steps,) that of the differences, or 0.

    Returns:
        (m,) limits.
    """
    steps, columns = differences.shape
    limits = differences[0].copy()
    for column in range(columns):
        above = np.empty(steps)
        least = np.inf
        for i in range(steps):
            entry = differences[i, column]
            factor = 1.0
            for j in range(i):
                factor *= ratio * ratio
                better = entry + (entry - above[j]) / (factor - 1)
                error = max(abs(better - entry), abs(better - above[j]), rounding[i])
                if error < least:
                    least, limits[column] = error, better
                above[j], entry = entry, better
            above[i] = entry
    return limits
