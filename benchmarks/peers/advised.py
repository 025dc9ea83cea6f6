"""The lines of docs/advice.md for codes that choose their steps are run, next to codes left alone.

    pip install -e '.[peers]'
    python benchmarks/peers/advised.py [MECHANISM ...]

Left alone means: index 3, index 2 or GGL with λ (and η) for unknowns, which IDA is told are
algebraic, differenced Jacobians, and rtol = atol.  Calls are evaluations of F, those for
differences among them, + those of the Jacobian; then the largest error of u, v and λ, relative to
the largest component.  Exits with 1 where the advised lines do not run.
"""

import os
import runpy
import sys
import warnings
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np
from scipy_dae.integrate import solve_dae as solve_scipy_dae
from sksundae.ida import IDA
from solve_dae.integrate import solve_dae

import newmark_cli as newmark
from newmark_cli.problems import reference
from newmark_cli.problems.residual_form import Dae

#: Of local errors, relative to the motion.
ACCURACIES = (1e-4, 1e-6, 1e-8)
#: Calls of F, or of the Jacobian, after which a run is given up.
MOST = 100_000
#: Of the advised weights of u and v.
PARTS = (1.0, 0.1, 0.01, 0.001)
#: A crank that is driven, in millimetres.
CRANK = {
    "points": {
        "O": {"fixed": [0, 0]},
        "A": {"at": [100, 0]},
        "B": {"at": [350, 0], "mass": 0.3},
    },
    "bodies": {
        "crank": {"from": "O", "to": "A", "length": 100, "mass": 0.2, "inertia": 700},
        "rod": {"from": "A", "to": "B", "length": 250, "mass": 0.4, "inertia": 2000,
                "centre": [125, 0]},
    },
    "sliders": {"guide": {"point": "B", "through": [0, 0], "direction": [1, 0]}},
    "motions": {"drive": {"body": "crank", "angle": {"rate": 10}}},
    "gravity": [0, -9810],
    "project_velocities": True,
}  # fmt: skip
#: A pendulum of a centimetre, a kilometre away from the origin.
FAR = {
    "points": {"O": {"fixed": [1000, 500]}, "P": {"at": [1000.01, 500], "mass": 1}},
    "bars": {"rod": {"from": "O", "to": "P", "length": 0.01}},
    "gravity": [0, -9.81],
}
#: Code → its function, where it is none of SUNDIALS, and its method.
CODES = {
    "IDA": None,
    "Radau": (solve_dae, "Radau"),
    "BDF": (solve_dae, "BDF"),
    "BDF of scipy_dae": (solve_scipy_dae, "BDF"),
}
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
tolerances = runpy.run_path(str(EXAMPLES / "tolerances.py"))["tolerances"]
#: Mechanism → what `newmark.problem` takes, and the end (s).
MECHANISMS = {
    "andrews": ("andrews", 0.03),
    "linkage in space": (str(EXAMPLES / "space-linkage.yaml"), 0.2),
    "driven crank, mm": (CRANK, 0.3),
    "far pendulum": (FAR, 0.1),
}


def told(at, work, *how):
    """A cell of the table: the calls that some work makes, and the error of the state it gives."""
    calls = {"residual": 0, "jacobian": 0}

    def counting(name):
        function = getattr(Dae, name)

        def called(self, *given):
            if calls[name] == MOST:
                raise OverflowError
            calls[name] += 1
            return function(self, *given)

        return mock.patch.object(Dae, name, called)

    with counting("residual"), counting("jacobian"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            state, ending = work(*how), "fails"
        except OverflowError:
            state, ending = None, "stopped"
        except Exception as error:
            return type(error).__name__
    counts = " + ".join(str(count) for count in calls.values() if count)
    if state is None:
        return f"{ending} after {counts}"
    errors = (np.abs(a - b).max() / np.abs(b).max() for a, b in zip(state, at, strict=True))
    return f"{counts}: {max(errors):.0e}"


def alone(problem, end, code, equations, tolerance=1e-6):
    """State where a code that is left alone comes to; None where it fails."""
    dae = newmark.dae(problem, equations, integrals=False)
    if code == "IDA":
        options = {"algebraic_idx": dae.algebraic, "max_num_steps": 10**6}
        return of_ida(dae, end, tolerance, tolerance, None, **options)
    return of_others(dae, end, code, rtol=tolerance, atol=tolerance)


def advised(problem, end, code, accuracy):
    """State by the lines of docs/advice.md."""
    dae = newmark.dae(problem, "ggl", integrals=True)
    rtol, atol = tolerances(problem, accuracy, end)
    if code == "IDA":
        return of_ida(dae, end, rtol, atol, dae.jacobian, max_num_steps=100_000)
    return of_others(dae, end, code, jac=dae.jacobian, rtol=rtol, atol=atol)


def tightened(problem, at, end, part):
    """IDA with λ in the error test of index 2, and a part of the advised weights of u and v."""
    dae, n = newmark.dae(problem, "index-2", integrals=False), problem.n
    rtol, weights = tolerances(problem, 1e-6, end)
    atol = np.full(len(dae.y0), 1e-6 * np.abs(at[2]).max())
    atol[: 2 * n] = part * weights[: 2 * n]
    options = {"algebraic_idx": dae.algebraic, "max_num_steps": 10**6}
    return of_ida(dae, end, part * rtol, atol, dae.jacobian, **options)


def of_ida(dae, end, rtol, atol, tangent, **options):
    """State that IDA finds, by the Jacobian of the equations or by differences."""

    def residual(t, y, yp, res):
        res[:] = dae.residual(t, y, yp)

    def jacobian(t, y, yp, res, cj, JJ):
        of_y, of_yp = tangent(t, y, yp)
        JJ[:] = of_y + cj * of_yp

    given = {"jacfn": jacobian} if tangent else {}
    found = IDA(residual, rtol=rtol, atol=atol, **given, **options).solve(
        [dae.t0, end], dae.y0, dae.yp0
    )
    return dae.state(found.y[-1], found.yp[-1]) if found.success else None


def of_others(dae, end, code, **options):
    """State that Radau or a BDF finds."""
    solve, method = CODES[code]
    found = solve(dae.residual, (dae.t0, end), dae.y0, dae.yp0, method=method, **options)
    return dae.state(found.y[:, -1], found.yp[:, -1]) if found.success else None


def main():
    table, failed = os.fdopen(os.dup(1), "w"), False
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # where SUNDIALS prints
    names = ("index-3", "index-2", "ggl")
    rows = [["mechanism", "code", *names, *(f"advised, {accuracy:g}" for accuracy in ACCURACIES)]]
    further = [["IDA, index-2, λ tested", *(f"u and v tighter by {part:g}" for part in PARTS)]]
    for name in sys.argv[1:] or MECHANISMS:
        given, end = MECHANISMS[name]
        problem = newmark.problem(given)
        solution = reference.solution(problem, end)
        at = solution.u, solution.v, solution.multipliers
        cell = partial(told, at)
        for code in CODES:
            # scipy_dae left alone says nothing that solve_dae does not.
            shared = code == "BDF of scipy_dae"
            left = ["–" if shared else cell(alone, problem, end, code, one) for one in names]
            found = [cell(advised, problem, end, code, accuracy) for accuracy in ACCURACIES]
            failed |= not all(": " in each for each in found)
            rows.append([name, code, *left, *found])
        further.append([name, *(cell(tightened, problem, at, end, part) for part in PARTS)])
    for head, *others in (rows, further):
        for row in (head, ["---"] * len(head), *others):
            print("|", " | ".join(row), "|", file=table)
        print(file=table)
    return failed


if __name__ == "__main__":
    sys.exit(main())
