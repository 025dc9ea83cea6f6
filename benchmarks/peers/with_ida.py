"""IDA of SUNDIALS by scikit-sundae, given the equations in several forms.

The documentation asks for rtol and atol, both the tolerance here, and for the names of algebraic
unknowns.  Multipliers are left out of the error test by a large `atol`, as scikit-sundae has no
switch for IDASetSuppressAlg.
"""

import os

import numpy as np
from rows import last_row
from sksundae.ida import IDA

import newmark_cli as newmark

#: Evaluations of F after which a run is given up; the longest that ends takes 138,000.
MOST = 150_000
# A study runs this file in a process of its own, where SUNDIALS prints what its message says.
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def solve(problem, h, t_end, u0, v0, formulation, tolerance, integrals=False, tested=True):
    """The row at `t_end`.

    Args:
        h, u0, v0: Not used: IDA chooses its steps, and starts where the problem does.
        formulation: One of those of `newmark.dae`.
        tolerance: rtol and atol.
        integrals: Whether ∫λ and ∫η are the unknowns.
        tested: Whether λ and η are in the error test.
    """
    dae = newmark.dae(problem, formulation, integrals=integrals)
    calls = 0

    def residual(t, y, yp, res):
        nonlocal calls
        calls += 1
        if calls > MOST:
            raise RuntimeError(f"not at the end after {MOST} evaluations of F, at t = {t:.3g}")
        res[:] = dae.residual(t, y, yp)

    atol = np.full(len(dae.y0), tolerance)
    if not tested:
        atol[dae.algebraic] = 1e12
    solver = IDA(
        residual, rtol=tolerance, atol=atol, algebraic_idx=dae.algebraic or None,
        max_num_steps=10_000,
    )  # fmt: skip
    found = solver.solve([dae.t0, t_end], dae.y0, dae.yp0)
    if not found.success:
        raise RuntimeError(found.message)
    return last_row(problem, t_end, *dae.state(found.y[-1], found.yp[-1]), calls=calls)
