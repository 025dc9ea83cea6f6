"""IDA of SUNDIALS by scikit-sundae, given the equations in several forms.

The reference solution is asked for by rtol and atol, both the tolerance; the algebraic unknowns
are named.  The cures: multipliers left out of the error test, which scikit-sundae does by a large
`atol` as it has no switch for IDASetSuppressAlg, or their integrals as unknowns.
"""

from functools import partial

import numpy as np
from common import TOLERANCES, Result, Run, main
from equations import Equations
from sksundae.ida import IDA

SERIES = {  # label → equations, atol of multipliers in place of the tolerance
    "IDA, index 3": ("index 3", None),
    "IDA, index 2": ("index 2", None),
    "IDA, index 1": ("index 1", None),
    "IDA, GGL": ("GGL", None),
    "IDA, index 2, λ not in the error test": ("index 2", 1e12),
    "IDA, GGL, λ and η not in the error test": ("GGL", 1e12),
    "IDA, index 2, ∫λ": ("index 2 with integrals", None),
    "IDA, GGL, ∫λ and ∫η": ("GGL with integrals", None),
}


def solve(problem, t_end, kind, atol_of_multipliers, tolerance):
    equations = Equations(problem, kind)

    def residual(t, y, yp, res):
        res[:] = equations(t, y, yp)

    atol = np.full(len(equations.y0), tolerance)
    if atol_of_multipliers:
        atol[equations.algebraic] = atol_of_multipliers
    algebraic = None if equations.integrals else equations.algebraic
    solver = IDA(residual, rtol=tolerance, atol=atol, algebraic_idx=algebraic, max_num_steps=10_000)
    found = solver.solve([0.0, t_end], equations.y0, equations.yp0)
    if not found.success:
        return Result(calls=equations.calls, message=f"{found.message} at t = {found.t[-1]:.3g}")
    return Result(*equations.state(found.y[-1], found.yp[-1]), calls=equations.calls)


def runs(name, problem, t_end):
    for label, (kind, atol) in SERIES.items():
        for tolerance in TOLERANCES:
            work = partial(solve, problem, t_end, kind, atol, tolerance)
            yield Run(label, "tolerance", tolerance, work)


if __name__ == "__main__":
    main(runs)
