"""Terms of Φ' and Φ'' of a problem in Python, and their tangents to u.

Along a motion with u' = v the constraints change by Φ' = Gᵀ v + rate, and with u'' = w
by Φ'' = Gᵀ w + curvature.  Four functions make up what a problem says of them:

======================================  ======  ========================================
function                                shape   value
======================================  ======  ========================================
``rate(u, v, t)``                       (m,)    Φ_t
``curvature(u, v, t)``                  (m,)    d²/ds² Φ(u + s v, t + s) at s = 0
``rate_gradient(u, v, t)``              (n, m)  d/ds G(u + s v, t + s)
``acceleration_gradient(u, v, w, t)``   (n, m)  d/ds G(u + s w, t)
                                                + d²/ds² G(u + s v, t + s)
======================================  ======  ========================================

The last two are the transposes of ∂Φ'/∂u and ∂Φ''/∂u.  Each is the user's, or follows
from G where Φ is at most quadratic in u and free of t, or is found by differences.  Where
the user's functions are compiled, so are all of these.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.cached_code import cached_njit

#: Steps (s) of differences in time.  The longest is short enough for motions of some
#: hundred radians a second, the shortest for some thousand.  No power of two stands
#: between them, lest all be periods of one motion.
LONGEST_STEP, STEP_RATIO, STEPS = 1e-2, 1.9, 7
_SHRINKING = STEP_RATIO ** -np.arange(STEPS)

#: Compiles a function, or leaves it as it is.
Compiler = Callable[[Callable[..., Any]], Callable[..., Any]]


class Rows(NamedTuple):
    """The four functions; see the module."""

    rate: Callable[..., Any]
    curvature: Callable[..., Any]
    rate_gradient: Callable[..., Any]
    acceleration_gradient: Callable[..., Any]


def by_differences(
    functions: Mapping[str, Any], compile_: Compiler, longest: float = LONGEST_STEP
) -> Rows:
    """All four by central differences that find their own step.

    Args:
        functions: ``constraints`` and ``gradient`` of the user.
        compile_: Compiles what is returned if both are compiled.
        longest: Longest step (s), see `LONGEST_STEP`.
    """
    phi_of, gradient_of = functions["constraints"], functions["gradient"]

    def rate(u, v, t):  # type: ignore[no-untyped-def]
        steps = longest * _SHRINKING
        size = _size(gradient_of(u, t)) * _size(u)
        differences = np.empty((STEPS, phi_of(u, t).shape[0]))
        for k in range(STEPS):
            h = float(steps[k])
            _central(differences[k], phi_of(u, t + h), phi_of(u, t - h), h)
        return extrapolated(differences, STEP_RATIO, _rounding(size, steps, 1))

    def curvature(u, v, t):  # type: ignore[no-untyped-def]
        # Φ'' = (Gᵀ v)' along the motion + (Φ_t)': first differences of G, which lose
        # less than second ones of Φ; those remain for a Φ that depends on time.
        here = phi_of(u, t)
        size = _size(gradient_of(u, t))
        shape = STEPS, here.shape[0]
        turn, drift, second = np.empty(shape), np.empty(shape), np.empty(shape)
        along = steps_along(u, v, longest)
        steps = longest * _SHRINKING
        for k in range(STEPS):
            h = float(along[k])
            ahead, behind = (
                gradient_of(_moved(u, v, h), t + h),
                gradient_of(_moved(u, v, -h), t - h),
            )
            _central(turn[k], _product(ahead, v), _product(behind, v), h)
            h = float(steps[k])
            ahead, behind = gradient_of(u, t + h), gradient_of(u, t - h)
            _central(drift[k], _product(ahead, v), _product(behind, v), h)
            _bent(second[k], phi_of(u, t + h), here, phi_of(u, t - h), h)
        total = extrapolated(turn, STEP_RATIO, _rounding(size * _size(v), along, 1))
        total += extrapolated(drift, STEP_RATIO, _rounding(size * _size(v), steps, 1))
        total += extrapolated(second, STEP_RATIO, _rounding(size * _size(u), steps, 2))
        return total

    def rate_gradient(u, v, t):  # type: ignore[no-untyped-def]
        here = gradient_of(u, t)
        n, m = here.shape
        steps = steps_along(u, v, longest)
        differences = np.empty((STEPS, n, m))
        for k in range(STEPS):
            h = float(steps[k])
            ahead, behind = (
                gradient_of(_moved(u, v, h), t + h),
                gradient_of(_moved(u, v, -h), t - h),
            )
            _central(differences[k], ahead, behind, h)
        rounding = _rounding(_size(here), steps, 1)
        return extrapolated(differences.reshape(STEPS, n * m), STEP_RATIO, rounding).reshape(n, m)

    def acceleration_gradient(u, v, w, t):  # type: ignore[no-untyped-def]
        here = gradient_of(u, t)
        n, m = here.shape
        first, second = np.empty((STEPS, n, m)), np.empty((STEPS, n, m))
        along, steps = steps_along(u, w, np.inf), steps_along(u, v, longest)
        for k in range(STEPS):
            h = float(along[k])
            ahead, behind = gradient_of(_moved(u, w, h), t), gradient_of(_moved(u, w, -h), t)
            _central(first[k], ahead, behind, h)
            h = float(steps[k])
            ahead, behind = (
                gradient_of(_moved(u, v, h), t + h),
                gradient_of(_moved(u, v, -h), t - h),
            )
            _bent(second[k], ahead, here, behind, h)
        rounding = _rounding(_size(here), along, 1)
        total = extrapolated(first.reshape(STEPS, n * m), STEP_RATIO, rounding)
        rounding = _rounding(_size(here), steps, 2)
        total += extrapolated(second.reshape(STEPS, n * m), STEP_RATIO, rounding)
        return total.reshape(n, m)

    return Rows(
        compile_(rate), compile_(curvature), compile_(rate_gradient),
        compile_(acceleration_gradient),
    )  # fmt: skip


def of_quadratic(functions: Mapping[str, Any], compile_: Compiler) -> Rows:
    """All four, exactly, of a Φ at most quadratic in u and free of t.

    G is affine in u there: G(u + s v) − G(u) = s (G(v) − G(0)).
    """
    gradient_of = functions["gradient"]

    def turned(v, t):  # type: ignore[no-untyped-def]
        return _difference(gradient_of(v, t), gradient_of(np.zeros_like(v), t))

    change = compile_(turned)

    def rate(u, v, t):  # type: ignore[no-untyped-def]
        return np.zeros(gradient_of(u, t).shape[1])

    def curvature(u, v, t):  # type: ignore[no-untyped-def]
        return _product(change(v, t), v)

    def rate_gradient(u, v, t):  # type: ignore[no-untyped-def]
        return change(v, t)

    def acceleration_gradient(u, v, w, t):  # type: ignore[no-untyped-def]
        return change(w, t)

    return Rows(
        compile_(rate), compile_(curvature), compile_(rate_gradient),
        compile_(acceleration_gradient),
    )  # fmt: skip


def of_user(function: Callable[..., Any], compile_: Compiler) -> Callable[..., Any]:
    """``rate(u, v, t)`` of the user's ``constraint_rate(u, t)``."""

    def rate(u, v, t):  # type: ignore[no-untyped-def]
        return function(u, t)

    return compile_(rate)


def derivatives(rows: Rows, compile_: Compiler) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives` of the four functions."""
    rate_of, curvature_of, rate_gradient_of, acceleration_gradient_of = rows

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        rates, curvatures = rate_of(u, v, t), curvature_of(u, v, t)
        r, q = rate_gradient_of(u, v, t), acceleration_gradient_of(u, v, w, t)
        n, m = u.shape[0], rate.shape[0]
        for k in range(m):
            rate[k] = rates[k]
            curvature[k] = curvatures[k]
            for i in range(n):
                r_values[i * m + k] = r[i, k]
                q_values[i * m + k] = q[i, k]

    return compile_(derivatives)


def rates(functions: Mapping[str, Any], given: Mapping[str, Any]) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.rates`, by differences in plain Python.

    Args:
        functions: ``constraints`` and ``gradient`` of the user.
        given: The user's ``rate`` and ``curvature``, of (u, v, t), as far as there are any.
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
        if "rate" in given:
            rate[:] = given["rate"](u, v, t)
        if "curvature" in given:
            curvature[:] = given["curvature"](u, v, t)

    return rates


def as_it_is(function: Callable[..., Any]) -> Callable[..., Any]:
    """No compiler."""
    return function


# What the functions above are made of is compiled once, for all problems.


@cached_njit(nogil=True, error_model="numpy")
def _product(gradient, v):  # type: ignore[no-untyped-def]
    """Gᵀ v, of matrices of any layout and type."""
    n, m = gradient.shape
    product = np.zeros(m)
    for i in range(n):
        for k in range(m):
            product[k] += gradient[i, k] * v[i]
    return product


@cached_njit(nogil=True, error_model="numpy")
def _difference(one, other):  # type: ignore[no-untyped-def]
    return one - other


@cached_njit(nogil=True, error_model="numpy")
def _moved(u, v, h):  # type: ignore[no-untyped-def]
    return u + h * v


@cached_njit(nogil=True, error_model="numpy")
def _size(array):  # type: ignore[no-untyped-def]
    return float(np.max(np.abs(array)))


@cached_njit(nogil=True, error_model="numpy")
def _central(out, ahead, behind, h):  # type: ignore[no-untyped-def]
    """First derivative."""
    out[...] = (ahead - behind) / (2 * h)


@cached_njit(nogil=True, error_model="numpy")
def _bent(out, ahead, here, behind, h):  # type: ignore[no-untyped-def]
    """Second derivative."""
    out[...] = (ahead - here + (behind - here)) / (h * h)


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
    size, speed = np.max(np.abs(u)), np.max(np.abs(v))
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
