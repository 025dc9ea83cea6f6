"""Series that are given as numbers, not run: examples that were judged wrong once, and traps.

    python named.py RESULTS

writes RESULTS/named.csv, each series as a problem of its own.  What is true of them is
known by construction.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

STUDY = "named"
COLUMNS = [
    "study", "problem", "integrator", "form", "preconditioning", "evaluation", "precision",
    "linear_solver", "h", "t_end", "steps", "quantity", "measure", "role", "rms", "max", "median",
    "last", "zeros", "not_converged", "newton_iterations", "status", "row_block", "stop", "met",
    "rounding",
]  # fmt: skip
DECADES = (1e-2, 1e-3, 1e-4, 1e-5)
NEWMARK = "newmark beta=0.25 gamma=0.5"
DAMPED = "generalized-alpha rho=0.9"


@dataclass(frozen=True)
class Named:
    """A series and the truth about it; `accept` are verdicts besides the label's own.

    `rounding` is what rounding changes in each value, of all that are errors.
    """

    problem: str
    measure: str
    quantity: str
    values: Sequence[float]
    label: str
    order: float
    reason: str
    h: Sequence[float] = DECADES
    span: tuple[float, float] | None = None
    form: str = "u-lambda"
    integrator: str = NEWMARK
    preconditioning: str = "none"
    accept: str = ""
    rounding: Sequence[float] = ()


def _grown(orders: Sequence[float], first: float, h: Sequence[float] = DECADES) -> list[float]:
    values = [first]
    for a, b, order in zip(h[:-1], h[1:], orders, strict=True):
        values.append(values[-1] * (b / a) ** order)
    return values


NAMED = (
    Named(
        "order-two-then-floor", "error", "u", (2.4e-5, 2.4e-7, 2.4e-9, 8.3e-10), "floor", 2,
        "order 2 over three points, then rounding", span=(1e-4, 1e-2),
        rounding=(1e-13, 1e-12, 2e-11, 5e-10),
    ),
    Named(
        "garbage", "error", "u", (0.75, 1.90, 1.15), "wrong", float("nan"),
        "errors as large as the motion at every h", h=(1e-3, 3e-4, 1e-4),
    ),
    Named(
        "late-condition", "condition", "jacobian", _grown((-2.65, -2.989, -2.9997), 3e4), "order",
        -3, "the first step size is before the asymptotic range", span=(1e-5, 1e-3),
        form="u-v-lambda",
    ),
    Named(
        "first-order", "error", "u", (3e-2, 3.01e-3, 3e-4, 3e-5), "wrong", 1,
        "a clean order 1 where theory says 2",
    ),
    Named(
        "head-of-two", "error", "u", (1e-2, 1e-4, 1e-5, 1e-6), "wrong", 1,
        "order 2 over the first two points, order 1 from there on",
    ),
    Named(
        "other-solution", "error", "u", (2.4e-1, 2.4e-3, 2.4e-5, 2.2e-5, 2.2e-5), "wrong", 0,
        "stops far above rounding: the run converges to something else", h=(1e-1, *DECADES),
        accept="not asymptotic|too few points",
    ),
    Named(
        "down-and-up", "error", "v", (1e-3, 1e-5, 1e-3, 1e-1), "wrong", float("nan"),
        "ends a hundred times above where it starts", accept="too few points|not asymptotic",
    ),
    Named(
        "alternating-multiplier", "error", "lambda", (2.135, 2.135, 2.121, 186.0), "wrong", 0,
        "multipliers miss by their own size at every h, then grow",
    ),
    Named(
        "damped-multiplier-stuck", "error", "lambda", (0.31, 0.30, 0.30, 0.30), "wrong", 0,
        "a damped scheme whose multipliers do not converge", integrator=DAMPED,
    ),
    Named(
        "multiplier-large-but-right", "error", "lambda", (270.0, 2.7, 2.7e-2, 2.7e-4), "order", 2,
        "large at the first h, but of order 2 throughout", integrator=DAMPED, span=(1e-5, 1e-2),
    ),
    Named(
        "condition-too-flat", "condition", "jacobian", _grown((-2.0, -2.0, -2.0), 3e4), "wrong",
        -2, "a clean −2 where theory says −3", form="u-v-lambda",
    ),
    Named(
        "correction-too-flat", "physical_correction", "lambda",
        _grown((-1.02, -0.97, -1.01), 1e-11), "wrong", -1, "a clean −1 where theory says −2",
    ),
    Named(
        "correction-with-a-jump", "physical_correction", "lambda",
        _grown((-2.0, -2.0, -5.0), 1e-12), "wrong", float("nan"),
        "three points as predicted, then a thousand times too large", accept="not asymptotic",
    ),
    Named(
        "two-points", "error", "u", (2.4e-5, 2.4e-7), "too few", 2, "two step sizes",
        h=(1e-2, 1e-3),
    ),
    Named(
        "floor-at-once", "error", "u", (2.4e-7, 3.1e-11, 8.3e-10, 4.1e-10), "too few", 2,
        "one point above rounding", rounding=(1e-12, 2e-11, 5e-10, 6e-10),
    ),
    Named(
        "coarse", "error", "u", (0.9, 0.4, 0.05), "preasymptotic", 2,
        "local orders 1.2 and 3.0: steps too large to say", h=(0.5, 0.25, 0.125),
    ),
    Named(
        "rounding-only", "error", "u", (1.2e-16, 2.4e-16, 1.2e-16), "too few", 2,
        "the coordinates are prescribed: rounding at every h", h=(1e-3, 3e-4, 1e-4),
        accept="shown", rounding=(1e-16, 1e-16, 2e-16),
    ),
)  # fmt: skip


def rows(named: Named) -> list[str]:
    """CSV rows of a series."""
    found = []
    of_errors = [1e-15 * value for value in named.values] if named.measure == "error" else []
    rounding = named.rounding or of_errors or [""] * len(named.values)
    for h, value, changes in zip(named.h, named.values, rounding, strict=True):
        steps = round(1 / h)
        values = {
            "study": STUDY, "problem": named.problem, "form": named.form,
            "integrator": named.integrator, "preconditioning": named.preconditioning,
            "evaluation": "direct", "precision": "float64", "linear_solver": "dense-lu",
            "h": h, "t_end": 1.0, "steps": steps, "quantity": named.quantity,
            "measure": named.measure, "role": "primary", "rms": value, "max": value,
            "median": value, "last": value, "zeros": 0, "not_converged": 0,
            "newton_iterations": 4.0, "status": "ok", "row_block": "", "stop": "saturation",
            "met": "", "rounding": changes,
            "formulation": "index-3", "projection": "none",
            "multipliers": "newton", "start": "consistent",
        }  # fmt: skip
        found.append(",".join(str(values[column]) for column in COLUMNS))
    return found


def write(folder: Path) -> None:
    """Write the CSV into a results folder."""
    lines = [",".join(COLUMNS), *(row for named in NAMED for row in rows(named))]
    (folder / f"{STUDY}.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
