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
    along = _along(compile_)

    def rate(u, v, t):  # type: ignore[no-untyped-def]
        steps = steps_along(u, v, longest)
        differences = np.empty((STEPS, len(phi_of(u, t))))
        for k in range(STEPS):
            h = float(steps[k])
            differences[k] = (phi_of(u, t + h) - phi_of(u, t - h)) / (2 * h)
        return extrapolated(differences, STEP_RATIO)

    def curvature(u, v, t):  # type: ignore[no-untyped-def]
        # Φ'' = (Gᵀ v)' along the motion + (Φ_t)': first differences of G, which lose
        # less than second ones of Φ; those remain for a Φ that depends on time.
        steps = steps_along(u, v, longest)
        here = phi_of(u, t)
        differences = np.empty((STEPS, len(here)))
        for k in range(STEPS):
            h = float(steps[k])
            drift = along(v, gradient_of(u, t + h)) - along(v, gradient_of(u, t - h))
            turn = along(v, gradient_of(u + h * v, t + h)) - along(v, gradient_of(u - h * v, t - h))
            second = (phi_of(u, t + h) - here + (phi_of(u, t - h) - here)) / (h * h)
            differences[k] = second + (drift + turn) / (2 * h)
        return extrapolated(differences, STEP_RATIO)

    def rate_gradient(u, v, t):  # type: ignore[no-untyped-def]
        n, m = gradient_of(u, t).shape
        steps = steps_along(u, v, longest)
        differences = np.empty((STEPS, n, m))
        for k in range(STEPS):
            h = float(steps[k])
            change = gradient_of(u + h * v, t + h) - gradient_of(u - h * v, t - h)
            differences[k] = change / (2 * h)
        return extrapolated(differences.reshape(STEPS, n * m), STEP_RATIO).reshape(n, m)

    def acceleration_gradient(u, v, w, t):  # type: ignore[no-untyped-def]
        here = gradient_of(u, t)
        n, m = here.shape
        first, second = np.zeros((STEPS, n, m)), np.empty((STEPS, n, m))
        if np.max(np.abs(w)) > 0:
            steps = steps_along(u, w, np.inf)
            for k in range(STEPS):
                h = float(steps[k])
                first[k] = (gradient_of(u + h * w, t) - gradient_of(u - h * w, t)) / (2 * h)
        steps = steps_along(u, v, longest)
        for k in range(STEPS):
            h = float(steps[k])
            change = gradient_of(u + h * v, t + h) - here + (gradient_of(u - h * v, t - h) - here)
            second[k] = change / (h * h)
        total = extrapolated(first.reshape(STEPS, n * m), STEP_RATIO)
        total += extrapolated(second.reshape(STEPS, n * m), STEP_RATIO)
        return total.reshape(n, m)

    return Rows(
        *(compile_(f) for f in (rate, curvature, rate_gradient, acceleration_gradient))
    )  # fmt: skip


def of_quadratic(functions: Mapping[str, Any], compile_: Compiler) -> Rows:
    """All four, exactly, of a Φ at most quadratic in u and free of t.

    G is affine in u there: G(u + s v) − G(u) = s (G(v) − G(0)).
    """
    gradient_of = functions["gradient"]
    along = _along(compile_)

    def turned(v, t):  # type: ignore[no-untyped-def]
        return gradient_of(v, t) - gradient_of(np.zeros_like(v), t)

    change = compile_(turned)

    def rate(u, v, t):  # type: ignore[no-untyped-def]
        return np.zeros(gradient_of(u, t).shape[1])

    def curvature(u, v, t):  # type: ignore[no-untyped-def]
        return along(v, change(v, t))

    def rate_gradient(u, v, t):  # type: ignore[no-untyped-def]
        return change(v, t)

    def acceleration_gradient(u, v, w, t):  # type: ignore[no-untyped-def]
        return change(w, t)

    return Rows(
        *(compile_(f) for f in (rate, curvature, rate_gradient, acceleration_gradient))
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


def rates(rows: Rows) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.rates` of the four functions."""

    def rates(t, u, v, ints, reals, rate, curvature):  # type: ignore[no-untyped-def]
        rate[:] = rows.rate(u, v, t)
        curvature[:] = rows.curvature(u, v, t)

    return rates


def as_it_is(function: Callable[..., Any]) -> Callable[..., Any]:
    """No compiler."""
    return function


def _along(compile_: Compiler) -> Callable[..., Any]:
    """Gᵀ v; a loop where it is compiled, which takes arrays of any layout and type."""
    return _product if compile_ is as_it_is else _product_in_a_loop


def _product(v, gradient):  # type: ignore[no-untyped-def]
    return v @ gradient


@cached_njit(nogil=True, error_model="numpy")
def _product_in_a_loop(v, gradient):  # type: ignore[no-untyped-def]
    n, m = gradient.shape
    product = np.zeros(m)
    for i in range(n):
        for k in range(m):
            product[k] += gradient[i, k] * v[i]
    return product


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
def extrapolated(differences, ratio):  # type: ignore[no-untyped-def]
    """Limit of central differences for steps that shrink by a ratio, each column its own.

    Romberg's tableau; of its entries the one that differs least from its neighbours
    (Ridders, Advances in Engineering Software 4, 1982), so that neither truncation
    nor rounding need be known.

    Args:
        differences: (steps, m) central differences, longest step first.
        ratio: Of a step to the next.

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
                error = max(abs(better - entry), abs(better - above[j]))
                if error < least:
                    least, limits[column] = error, better
                above[j], entry = entry, better
            above[i] = entry
    return limits
