"""scipy_dae: Radau IIA and BDF with the equations in several forms.

rtol and atol are the tolerance.  Jacobians are given, as the documentation strongly recommends.
It says that systems of an index above 1 are not implemented; the cure is GGL with ∫λ and ∫η for
unknowns, which has index 1.
"""

from functools import partial

from common import TOLERANCES, Result, Run, main
from equations import Equations
from scipy_dae.integrate import solve_dae

FORMS = {  # method → label → equations
    "Radau": {
        "index 3": "index 3",
        "index 2": "index 2",
        "GGL": "GGL",
        "GGL, ∫λ and ∫η": "GGL with integrals",
    },
    "BDF": {"index 3": "index 3", "GGL, ∫λ and ∫η": "GGL with integrals"},
}


def solve(problem, t_end, method, kind, tolerance):
    equations = Equations(problem, kind)
    found = solve_dae(
        equations, (0.0, t_end), equations.y0, equations.yp0, method=method,
        jac=equations.jacobian, rtol=tolerance, atol=tolerance,
    )  # fmt: skip
    if not found.success:
        where = f"{found.message} t = {found.t[-1]:.3g}"
        return Result(calls=equations.calls, message=where)
    return Result(*equations.state(found.y[:, -1], found.yp[:, -1]), calls=equations.calls)


def runs(name, problem, t_end):
    for method, forms in FORMS.items():
        for label, kind in forms.items():
            for tolerance in TOLERANCES:
                work = partial(solve, problem, t_end, method, kind, tolerance)
                yield Run(f"scipy_dae, {method}, {label}", "tolerance", tolerance, work)


if __name__ == "__main__":
    main(runs)
