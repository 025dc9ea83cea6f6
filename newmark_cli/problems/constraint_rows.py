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

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from newmark_cli.problems import differences
from newmark_cli.problems.algebra import product
from newmark_cli.problems.differences import LONGEST_STEP, STEP_RATIO, Compiler
from newmark_cli.support.arrays import Array

#: The four functions, as a definition calls them.
NAMES = ("constraint_rate", "curvature", "rate_gradient", "acceleration_gradient")


def derivatives(
    functions: Mapping[str, Any],
    rows: Mapping[str, Any],
    compile_: Compiler,
    quadratic: bool = False,
) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives`."""
    missing = [name for name in NAMES if name not in rows]
    if not missing:
        computed: Any = differences.nothing
    elif quadratic:
        computed = of_quadratic(functions, compile_)
    else:
        computed = by_differences(functions, missing, compile_)
    if not rows:
        return computed  # type: ignore[no-any-return]
    copy = differences.copying(compile_)
    kinds = (("ut", copy.vector), ("uvt", copy.vector), ("uvt", copy.flat), ("uvwt", copy.flat))
    give_rate, give_curvature, give_r, give_q = (
        differences.giving(rows.get(name), *kind, compile_)
        for name, kind in zip(NAMES, kinds, strict=True)
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


def by_differences(
    functions: Mapping[str, Any], wanted: Collection[str], compile_: Compiler
) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives` by central differences.

    They find their own step.  What is not wanted of the four may remain as it was.
    """
    phi_of, gradient_of = functions["constraints"], functions["gradient"]
    copy = differences.copying(compile_)
    wanted = {*wanted}
    in_time = bool(wanted & {"constraint_rate", "curvature"})
    along_v = bool(wanted - {"constraint_rate"})
    along_w = "acceleration_gradient" in wanted

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        states, times, phi, gradients = differences.states_along(
            t, u, v, w, rate, LONGEST_STEP, in_time, along_v, along_w
        )
        for k in range(states.shape[0]):
            copy.matrix(gradient_of(states[k], times[k]), gradients[k])
        for k in range(phi.shape[0]):
            copy.vector(phi_of(states[k], times[k]), phi[k])
        differences.take_rows(
            phi, gradients, u, v, w, LONGEST_STEP, in_time, along_v, along_w,
            rate, curvature, r_values, q_values,
        )  # fmt: skip

    return compile_(derivatives)


def of_quadratic(functions: Mapping[str, Any], compile_: Compiler) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives`, exactly, of such a Φ.

    It is at most quadratic in u and free of t, so that G is affine in u:
    G(u + s v) − G(u) = s (G(v) − G(0)).
    """
    gradient_of, copy = functions["gradient"], differences.copying(compile_)

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        directions, gradients = differences.directions(v, w, rate)
        for k in range(3):
            copy.matrix(gradient_of(directions[k], t), gradients[k])
        differences.take_rows_of_quadratic(gradients, v, rate, curvature, r_values, q_values)

    return compile_(derivatives)


#: Longest step (s) of `rates`; by which part of its size the motion may move over that in time
#: and over that along v; and how many steps there are of both.  References want the law of a
#: slow motor to all its digits: the steps in time may be longer than those of a march.
_LONGEST_RATE, _IN_TIME, _ALONG = 0.13, 0.3, 0.03
_SHRINKING = [np.array([STEP_RATIO**-k for k in range(levels)]) for levels in (11, 7)]


def rates(functions: Mapping[str, Any], rows: Mapping[str, Any]) -> Callable[..., None] | None:
    """`newmark_cli.problems.problem.Problem.rates`, by differences in plain Python."""
    phi_of, gradient_of = functions["constraints"], functions["gradient"]
    if {"constraint_rate", "curvature"} <= rows.keys():
        return None

    def rates(t, u, v, ints, reals, rate, curvature, share=1.0):  # type: ignore[no-untyped-def]
        differentiate(t, u, v, rate, curvature, share)  # type: ignore[no-untyped-call]
        if "constraint_rate" in rows:
            rate[:] = rows["constraint_rate"](u, t)
        if "curvature" in rows:
            curvature[:] = rows["curvature"](u, v, t)

    def differentiate(t, u, v, rate, curvature, share):  # type: ignore[no-untyped-def]
        size, speed = float(np.abs(u).max()), float(np.abs(v).max())
        turn_in = size / speed if size * speed > 0 else np.inf
        # Steps by which t changes without rounding: it stands in laws of high frequency.
        in_time, along = (
            t + min(_LONGEST_RATE, part * turn_in) * share * shrinking - t
            for part, shrinking in zip((_IN_TIME, _ALONG), _SHRINKING, strict=True)
        )
        then = [t + h for h in in_time] + [t - h for h in in_time]
        phi = np.array([phi_of(u, at) for at in then]).reshape(2, len(in_time), -1)
        drift = _ahead_less_behind(v, [gradient_of(u, at) for at in then])
        turned = _ahead_less_behind(v, [gradient_of(u + s * v, t + s) for s in (*along, *-along)])
        here, least = phi_of(u, t), 2.2e-16 * float(np.abs(gradient_of(u, t)).max())
        h, s = in_time[:, None], along[:, None]
        limit = differences.extrapolated
        rate[:] = limit((phi[0] - phi[1]) / (2 * h), STEP_RATIO, least * size / in_time)
        # Φ'' = (Gᵀ v)' along the motion + (Φ_t)', as in `differences.take_rows`.
        bent = (phi[0] - here + (phi[1] - here)) / (h * h) + drift / (2 * h)
        rounding = least * (size / in_time + speed) / in_time
        curvature[:] = limit(bent, STEP_RATIO, rounding)
        curvature += limit(turned / (2 * s), STEP_RATIO, least * speed / along)

    return rates


def _ahead_less_behind(v: Array, gradients: Sequence[Array]) -> Array:
    """(k, m) differences of Gᵀ v for 2k matrices G, those ahead first."""
    values = product(v, np.stack(gradients, axis=1))
    return np.asarray(values[: len(values) // 2] - values[len(values) // 2 :])
