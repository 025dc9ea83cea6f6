"""Floors of Newton's corrections, from steps taken anew, beside those of whole marches.

Every form, three integrators, both evaluations, both precisions, at step sizes around the
paper's, over the planar problems.  Prints for each problem the quotients predicted / measured:
how many there are, how many are within a factor of two, the least and the largest, and those
that are not.  Fails where fewer than 98 % of all are within a factor of two.

    python tests/verification/floors.py [problem ...]
"""

import sys
import tempfile

import numpy as np

import newmark_cli as newmark
from newmark_cli.newmark.forms import FORMS

#: Step sizes and end (s) of each shipped mechanism, and whether its constraints are quadratic.
STUDIES = {
    "pendulum": ([1e-1, 1e-2, 1e-3], 3.0, True),
    "andrews": ([1e-3, 1e-4, 1e-5, 1e-6], 0.03, True),
    "double-pendulum": ([1e-2, 1e-3, 1e-4], 2.0, True),
    "four-bar": ([1e-2, 1e-3, 1e-4], 1.0, True),
    "slider-crank": ([1e-3, 1e-4, 1e-5], 0.1, True),
    "shaken-pendulum": ([1e-2, 1e-3, 1e-4], 2.0, False),
}
INTEGRATORS = [
    {"method": "newmark"},
    {"method": "generalized-alpha", "rho": 0.9},
    {"method": "bdf2"},
]
#: Share of quotients that must be within a factor of two.
ENOUGH = 0.98
#: Columns that tell one point from another.
KEYS = ["form", "integrator", "evaluation", "precision", "h", "quantity"]


def quotients(problem: str):
    """One row for each point that was measured in cells that ended well."""
    h, t_end, quadratic = STUDIES[problem]
    study = {
        "study": problem, "problem": problem, "form": list(FORMS), "preconditioning": "optimal",
        "integrator": INTEGRATORS, "precision": ["float64", "float32"],
        "evaluation": ["direct", "compensated"] if quadratic else "direct",
        "measure": ["correction", "floor"], "samples": 8, "h": h, "t_end": t_end,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        rows = newmark.run(study, results=folder)
    rows = rows[rows["status"] == "ok"]
    measured = rows[rows["measure"] == "correction"].set_index(KEYS)
    predicted = rows[rows["measure"] == "floor"].set_index(KEYS)["rms"]
    measured = measured.assign(quotient=predicted / measured["rms"])
    there = np.isfinite(measured["quotient"]) & (measured["rms"] > 0)
    return measured[there]


def main(problems) -> int:
    """Print what was found; 1 where too many are farther off."""
    every = []
    for problem in problems or STUDIES:
        found = quotients(problem)
        q = found["quotient"].to_numpy()
        near, inside = _near(q), (q > 0.3) & (q < 3)
        every.append(q)
        print(f"{problem}: {len(q)} points, {np.mean(near):.1%} within 0.5 … 2, "
              f"{np.sum(~inside)} outside 0.3 … 3, least {q.min():.2f}, largest {q.max():.2f}",
              flush=True)  # fmt: skip
        odd = found[~near][["quotient", "rms", "zeros", "steps", "newton_iterations"]]
        if len(odd):
            print(odd.to_string(), flush=True)
    near = _near(np.concatenate(every))
    print(f"all: {len(near)} points, {np.mean(near):.1%} within 0.5 … 2")
    return int(np.mean(near) < ENOUGH)


def _near(quotients):
    return (quotients > 0.5) & (quotients < 2)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
