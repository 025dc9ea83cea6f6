"""solve_dae and scipy_dae: Radau IIA and BDF with the equations in several forms.

rtol and atol are the tolerance.  Jacobians are given, as the documentation strongly recommends.
It says that systems of an index above 1 are not implemented; the cure is GGL with ∫λ and ∫η for
unknowns, which has index 1.
"""

import importlib
import warnings

from rows import last_row

import newmark_cli as newmark


def solve(
    problem, h, t_end, u0, v0, package, method, formulation, tolerance, integrals=False
):  # fmt: skip
    """The row at `t_end`.

    Args:
        h, u0, v0: Not used: the codes choose their steps, and start where the problem does.
        package: solve_dae or scipy_dae, which have one interface.
        method: Radau or BDF.
        formulation: One of those of `newmark.dae`.
        tolerance: rtol and atol.
        integrals: Whether ∫λ and ∫η are the unknowns.
    """
    integrate = importlib.import_module(f"{package}.integrate")
    dae = newmark.dae(problem, formulation, integrals=integrals)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of singular matrices, just before the end of a run
        found = integrate.solve_dae(
            dae.residual, (dae.t0, t_end), dae.y0, dae.yp0, method=method, jac=dae.jacobian,
            rtol=tolerance, atol=tolerance,
        )  # fmt: skip
    if not found.success:
        raise RuntimeError(found.message)
    state = dae.state(found.y[:, -1], found.yp[:, -1])
    return last_row(problem, t_end, *state, calls=found.nfev)
