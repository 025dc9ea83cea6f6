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

from collections.abc import Callable, Mapping
from typing import Any

from newmark_cli.problems import differences
from newmark_cli.problems.differences import Compiler

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
        in_time = "constraint_rate" in missing or "curvature" in missing
        computed = by_differences(functions, in_time, compile_)
    if not rows:
        return computed  # type: ignore[no-any-return]
    give_rate, give_curvature, give_r, give_q = (
        differences.giving(rows.get(name), arguments, compile_)
        for name, arguments in zip(NAMES, ("ut", "uvt", "uvt", "uvwt"), strict=True)
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
    functions: Mapping[str, Any], in_time: bool, compile_: Compiler
) -> Callable[..., None]:
    """`newmark_cli.problems.problem.Problem.derivatives` by central differences.

    They find their own step; the longest is multiplied by ``reals[0, 0]``.  Rate and curvature
    remain as they were unless derivatives in time are wanted.
    """
    phi_of, gradient_of = functions["constraints"], functions["gradient"]
    copy = differences.copying(compile_)

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, w, ints, reals, rate, curvature, r_values, q_values
    ):
        share = reals[0, 0]
        states, times, phi, gradients = differences.states_along(t, u, v, w, rate, share, in_time)
        for k in range(states.shape[0]):
            copy(gradient_of(states[k], times[k]), gradients[k])
        for k in range(phi.shape[0]):
            copy(phi_of(states[k], times[k]), phi[k])
        differences.take_rows(
            phi, gradients, t, u, v, w, share, in_time, rate, curvature, r_values, q_values,
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
            copy(gradient_of(directions[k], t), gradients[k])
        differences.take_rows_of_quadratic(gradients, v, rate, curvature, r_values, q_values)

    return compile_(derivatives)
