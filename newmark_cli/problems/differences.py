"""Derivatives of users' functions by differences, as far as one code serves all problems.

For a problem with compiled functions, only the code that calls them is compiled anew; the
states where they are called, and what follows from the values, are compiled once.

X and Y follow from central differences of fourth order; the terms of Φ' = Gᵀ v + rate and
Φ'' = Gᵀ w + curvature, and the transposes of ∂Φ'/∂u and ∂Φ''/∂u, see
`newmark_cli.problems.python_problem.Definition`, from differences that find their own step.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from newmark_cli.support.cached_code import cached_njit

#: Steps (s) of differences in time.  The longest suits motions of some hundred radians per
#: second, the shortest some thousand.  Their ratio is no power of two, or all of them could
#: be periods of one motion.
LONGEST_STEP, STEP_RATIO, STEPS = 1e-2, 1.9, 7
#: Those of Φ_t, from which references want the law of a slow motor to all its digits: the longest
#: (s), the part of its size by which the motion may move over it, and how many there are.
_LONGEST_IN_TIME, _IN_TIME, _STEPS_IN_TIME = 0.13, 0.3, 11
_SHRINKING = STEP_RATIO ** -np.arange(_STEPS_IN_TIME)
_PART, _EPS = 3e-2, 2.2e-16

#: The four functions, as a definition calls them.
ROWS = ("constraint_rate", "curvature", "rate_gradient", "acceleration_gradient")

#: Compiles a function, or leaves it as it is.
Compiler = Callable[[Callable[..., Any]], Callable[..., Any]]


def as_it_is(function: Callable[..., Any]) -> Callable[..., Any]:
    """No compiler."""
    return function


@cached_njit(nogil=True, error_model="numpy")
def copy(values, out):  # type: ignore[no-untyped-def]
    """Copy an array into one of as many numbers, a matrix row by row."""
    # A loop: assigning to a slice would add the error that its shapes can raise, which takes
    # longer to compile, for every problem, than all the rest.
    for k in range(out.size):
        out.flat[k] = values.flat[k]


def _copy_plain(values: Any, out: Any) -> None:
    out[...] = values if np.ndim(values) == out.ndim else np.ravel(values)


def copying(compile_: Compiler) -> Callable[[Any, Any], None]:
    """`copy` for compiled functions, or for plain ones, which may return any kind of array."""
    return _copy_plain if compile_ is as_it_is else copy


@cached_njit(nogil=True, error_model="numpy")
def nothing(*arguments):  # type: ignore[no-untyped-def]
    """Does nothing."""


def giving(function: Any, arguments: str, compile_: Compiler) -> Any:
    """A function (u, v, w, t, out) that copies into an array what one of the user's returns.

    That takes ``"ut"``, ``"uvt"`` or ``"uvwt"``; it is None where there is nothing to do.
    """
    copy = copying(compile_)

    def of_place(u, v, w, t, out):  # type: ignore[no-untyped-def]
        copy(function(u, t), out)

    def of_motion(u, v, w, t, out):  # type: ignore[no-untyped-def]
        copy(function(u, v, t), out)

    def of_all(u, v, w, t, out):  # type: ignore[no-untyped-def]
        copy(function(u, v, w, t), out)

    if function is None:
        return nothing
    return compile_({"ut": of_place, "uvt": of_motion, "uvwt": of_all}[arguments])


@cached_njit(nogil=True, error_model="numpy")
def states_around(u, v, of_u, of_v, step, pace):  # type: ignore[no-untyped-def]
    """(k, n) coordinates and velocities where a force is asked for.

    Here, then with each coordinate and each velocity moved by a step and by twice that, as far as
    tangents to them are wanted.
    """
    n = u.shape[0]
    count = 1 + 4 * n * (int(of_u) + int(of_v))
    us, vs = np.empty((count, n)), np.empty((count, n))
    for k in range(count):
        copy(u, us[k])
        copy(v, vs[k])
    k = 1
    for moved, wanted, size in ((us, of_u, step), (vs, of_v, pace)):
        if wanted:
            for j in range(n):
                for shift in (-2, -1, 1, 2):
                    moved[k, j] += shift * size
                    k += 1
    return us, vs


@cached_njit(nogil=True, error_model="numpy")
def take_tangents(  # type: ignore[no-untyped-def]
    forces, of_u, of_v, step, pace, x_values, y_values
):
    """X and Y, (n · n,) each, from the (k, n) forces at `states_around`."""
    n, first = forces.shape[1], 1
    for wanted, size, values in ((of_u, step, x_values), (of_v, pace, y_values)):
        if wanted:
            for j in range(n):
                at = first + 4 * j
                for i in range(n):
                    tangent = 0.0
                    for k, weight in enumerate((1.0, -8.0, 8.0, -1.0)):
                        tangent -= weight * forces[at + k, i] / (12 * size)
                    values[i * n + j] = tangent
            first += 4 * n


@cached_njit(nogil=True, error_model="numpy")
def add_reactions(forces, gradients, multipliers):  # type: ignore[no-untyped-def]
    """G λ to the forces at as many states as there is a gradient of."""
    count, n, m = gradients.shape
    for k in range(count):
        for i in range(n):
            for c in range(m):
                forces[k, i] += gradients[k, i, c] * multipliers[c]


@cached_njit(nogil=True, error_model="numpy")
def size_of(vector, least=0.0):  # type: ignore[no-untyped-def]
    """Its largest component, or the least that counts."""
    size = least
    for i in range(vector.shape[0]):
        size = max(size, abs(vector[i]))
    return size


@cached_njit(nogil=True, error_model="numpy")
def steps_of_tangents(u, v):  # type: ignore[no-untyped-def]
    """By how much coordinates and velocities are moved, see `states_around`."""
    return 1e-3 * size_of(u, 1e-8), 1e-3 * size_of(v, 1e-3)


@cached_njit(nogil=True, error_model="numpy")
def states_of_tangents(u, v, multipliers, of_u, of_v):  # type: ignore[no-untyped-def]
    """`states_around` with the steps that suit them; arrays for f and G there."""
    step, pace = steps_of_tangents(u, v)
    us, vs = states_around(u, v, of_u, of_v, step, pace)
    n, m = u.shape[0], multipliers.shape[0]
    gradients = np.empty((1 + 4 * n * int(of_u), n, m))
    return us, vs, step, pace, np.empty(us.shape), gradients


@cached_njit(nogil=True, error_model="numpy")
def states_along(t, u, v, w, rate, share, in_time):  # type: ignore[no-untyped-def]
    """Where Φ and G are asked for: here, and before and after along up to three ways.

    (k, n) coordinates, (k,) times, and arrays for Φ, at those of the first way, and for G.
    """
    first, second, third = _ways(t, u, v, w, share, in_time)
    count = 1 + 2 * (first.shape[0] + second.shape[0] + third.shape[0])
    states, times = np.empty((count, u.shape[0])), np.full(count, t)
    copy(u, states[0])
    k = 1
    for way, steps in enumerate((first, second, third)):
        direction = w if way == 2 else v
        for step in steps:
            for shift in (step, -step):
                if way != 2:
                    times[k] = t + shift
                for i in range(u.shape[0]):
                    states[k, i] = u[i] + (0.0 if way == 0 else shift * direction[i])
                k += 1
    m = rate.shape[0]
    return states, times, np.empty((1 + 2 * first.shape[0], m)), np.empty((count, u.shape[0] * m))


@cached_njit(nogil=True, error_model="numpy")
def _ways(t, u, v, w, share, in_time):  # type: ignore[no-untyped-def]
    """Steps in time, if they are wanted, along v, and along w unless it vanishes."""
    first = steps_along(u, v, _LONGEST_IN_TIME, _IN_TIME, _STEPS_IN_TIME * int(in_time), share)
    # Steps by which t changes without rounding: it stands in laws of high frequency.
    for k in range(first.shape[0]):
        first[k] = t + first[k] - t
    second = steps_along(u, v, LONGEST_STEP, _PART, STEPS, share)
    third = steps_along(u, w, np.inf, _PART, STEPS * int(size_of(w) > 0), share)
    return first, second, third


# Loops from here on: expressions of arrays take several seconds to compile for every problem.


@cached_njit(nogil=True, error_model="numpy")
def take_rows(  # type: ignore[no-untyped-def]
    phi, gradients, t, u, v, w, share, in_time, rate, curvature, r_values, q_values
):
    """The four from Φ and G at `states_along`, as far as these are there."""
    first, second, third = _ways(t, u, v, w, share, in_time)
    noise, length, speed = _EPS * size_of(gradients[0]), size_of(u), size_of(v)
    there = 1 + 2 * first.shape[0]
    if in_time:
        _set_limits(_first(phi[1:], first), first, noise * length, 0.0, rate)
        # Φ'' = (Gᵀ v)' along the motion + (Φ_t)': first differences of G, which lose
        # less than second ones of Φ; those remain for a Φ that depends on time.
        bent = _second(phi[1:], phi[0], first)
        _add(_first(_products(gradients[1:there], v, phi.shape[1]), first), bent)
        _set_limits(bent, first, noise * speed, noise * length, curvature)
        turned = _products(gradients[there : there + 2 * STEPS], v, phi.shape[1])
        _add_limits(_first(turned, second), second, noise * speed, 0.0, curvature)
    along = gradients[there : there + 2 * STEPS]
    _set_limits(_first(along, second), second, noise, 0.0, r_values)
    _set_limits(_second(along, gradients[0], second), second, 0.0, noise, q_values)
    if third.shape[0]:
        _add_limits(_first(gradients[there + 2 * STEPS :], third), third, noise, 0.0, q_values)


@cached_njit(nogil=True, error_model="numpy")
def directions(v, w, rate):  # type: ignore[no-untyped-def]
    """(3, n) none, along v, and along w; an array for G there."""
    directions = np.zeros((3, v.shape[0]))
    copy(v, directions[1])
    copy(w, directions[2])
    return directions, np.empty((3, v.shape[0] * rate.shape[0]))


@cached_njit(nogil=True, error_model="numpy")
def take_rows_of_quadratic(  # type: ignore[no-untyped-def]
    gradients, v, rate, curvature, r_values, q_values
):
    """The four from G at `directions`."""
    for k in range(gradients.shape[1]):
        r_values[k] = gradients[1, k] - gradients[0, k]
        q_values[k] = gradients[2, k] - gradients[0, k]
    m = rate.shape[0]
    for c in range(m):
        rate[c] = curvature[c] = 0.0
        for i in range(v.shape[0]):
            curvature[c] += r_values[i * m + c] * v[i]


@cached_njit(nogil=True, error_model="numpy")
def _products(gradients, v, m):  # type: ignore[no-untyped-def]
    """(k, m) Gᵀ v of (k, n · m) G."""
    products = np.zeros((gradients.shape[0], m))
    for k in range(gradients.shape[0]):
        for i in range(v.shape[0]):
            for c in range(m):
                products[k, c] += gradients[k, i * m + c] * v[i]
    return products


@cached_njit(nogil=True, error_model="numpy")
def _first(values, steps):  # type: ignore[no-untyped-def]
    """(k, m) first derivatives from values ahead and behind in turn."""
    derivatives = np.empty((steps.shape[0], values.shape[1]))
    for k in range(steps.shape[0]):
        for c in range(values.shape[1]):
            derivatives[k, c] = (values[2 * k, c] - values[2 * k + 1, c]) / (2 * steps[k])
    return derivatives


@cached_njit(nogil=True, error_model="numpy")
def _second(values, here, steps):  # type: ignore[no-untyped-def]
    """(k, m) second derivatives from values ahead and behind in turn, and here."""
    derivatives = np.empty((steps.shape[0], values.shape[1]))
    for k in range(steps.shape[0]):
        for c in range(values.shape[1]):
            change = values[2 * k, c] - here[c] + (values[2 * k + 1, c] - here[c])
            derivatives[k, c] = change / (steps[k] * steps[k])
    return derivatives


@cached_njit(nogil=True, error_model="numpy")
def _add(values, out):  # type: ignore[no-untyped-def]
    for k in range(out.size):
        out.flat[k] += values.flat[k]


@cached_njit(nogil=True, error_model="numpy")
def _set_limits(differences, steps, of_first, of_second, out):  # type: ignore[no-untyped-def]
    """Set (m,) limits of (k, m) differences, whose rounding has a first and a second order."""
    for c in range(out.shape[0]):
        out[c] = 0.0
    _add_limits(differences, steps, of_first, of_second, out)


@cached_njit(nogil=True, error_model="numpy")
def _add_limits(differences, steps, of_first, of_second, out):  # type: ignore[no-untyped-def]
    """Add them."""
    rounding = np.empty(steps.shape[0])
    for k in range(steps.shape[0]):
        rounding[k] = (of_first + of_second / steps[k]) / steps[k]
    _add(extrapolated(differences, STEP_RATIO, rounding), out)


@cached_njit(nogil=True, error_model="numpy")
def steps_along(u, v, longest, part=_PART, count=STEPS, share=1.0):  # type: ignore[no-untyped-def]
    """Steps (s), longest first, that move no coordinate by more than a part of the largest.

    Only a share of each is taken.
    """
    size, speed = size_of(u), size_of(v)
    if size == 0:
        size = 1.0
    allowed = part * size / speed if speed > 0 else 1.0
    steps = np.empty(count)
    for k in range(count):
        steps[k] = share * (min(longest, allowed) * _SHRINKING[k])
    return steps


@cached_njit(nogil=True, error_model="numpy")
def extrapolated(differences, ratio, rounding):  # type: ignore[no-untyped-def]
    """(m,) limits of (steps, m) central differences for steps that shrink by a ratio.

    Romberg's tableau; of its entries the one that differs least from its neighbours
    (Ridders, Advances in Engineering Software 4, 1982), so that truncation need not be
    known.  Nor need rounding, (steps,) or 0, but where it is known, entries that agree with their
    neighbours by chance are not taken for better than they can be.
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


# -- for one problem: what calls its functions ----------------------------------------------


def constraint_rows(
    functions: Mapping[str, Any],
    rows: Mapping[str, Any],
    compile_: Compiler,
    quadratic: bool = False,
) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives`.

    Each of the four is the user's, or follows from G where Φ is at most quadratic in u and free
    of t, or is found by differences.
    """
    missing = [name for name in ROWS if name not in rows]
    if not missing:
        computed: Any = nothing
    elif quadratic:
        computed = _of_quadratic(functions, compile_)
    else:
        in_time = "constraint_rate" in missing or "curvature" in missing
        computed = _by_differences(functions, in_time, compile_)
    if not rows:
        return computed  # type: ignore[no-any-return]
    give_rate, give_curvature, give_r, give_q = (
        giving(rows.get(name), arguments, compile_)
        for name, arguments in zip(ROWS, ("ut", "uvt", "uvt", "uvwt"), strict=True)
    )

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        computed(t, u, v, w, ints, reals, rate, curvature, r_values, q_values)
        give_rate(u, v, w, t, rate)
        give_curvature(u, v, w, t, curvature)
        give_r(u, v, w, t, r_values)
        give_q(u, v, w, t, q_values)

    return compile_(derivatives)


def _by_differences(
    functions: Mapping[str, Any], in_time: bool, compile_: Compiler
) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives` by central differences.

    They find their own step; the longest is multiplied by ``reals[0, 0]``.  Rate and curvature
    remain as they were unless derivatives in time are wanted.
    """
    phi_of, gradient_of = functions["constraints"], functions["gradient"]
    copy_ = copying(compile_)

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        share = reals[0, 0]
        states, times, phi, gradients = states_along(t, u, v, w, rate, share, in_time)
        for k in range(states.shape[0]):
            copy_(gradient_of(states[k], times[k]), gradients[k])
        for k in range(phi.shape[0]):
            copy_(phi_of(states[k], times[k]), phi[k])
        take_rows(
            phi, gradients, t, u, v, w, share, in_time, rate, curvature, r_values, q_values,
        )  # fmt: skip

    return compile_(derivatives)


def _of_quadratic(functions: Mapping[str, Any], compile_: Compiler) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives`, exactly, of such a Φ.

    It is at most quadratic in u and free of t, so that G is affine in u:
    G(u + s v) − G(u) = s (G(v) − G(0)).
    """
    gradient_of, copy_ = functions["gradient"], copying(compile_)

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        ways, gradients = directions(v, w, rate)
        for k in range(3):
            copy_(gradient_of(ways[k], t), gradients[k])
        take_rows_of_quadratic(gradients, v, rate, curvature, r_values, q_values)

    return compile_(derivatives)
