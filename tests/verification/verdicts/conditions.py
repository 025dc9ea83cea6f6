"""Condition numbers and blocks of the inverse, without the package.

The Jacobian of a form is written out from its rows and weights.  It is inverted where it
is well conditioned, with all rows and unknowns brought to displacement size, and the
powers of h are put back afterwards: what is found is good to some twelve digits at any h.
"""

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import exact_orders
import oracles

Array = np.ndarray

#: Form → kept fields, rows.
FORMS = {form: (kept, rows) for form, (rows, kept, _) in oracles.FORMS.items()}


def symbols(label: str) -> tuple[float, float, float]:
    """β, γ and c = ∂v'/∂a of an integrator as the CSV names it."""
    method, *given = label.split()
    values = [float(part.partition("=")[2]) for part in given]
    if method == "newmark":
        return values[0], values[1], 1.0
    if method == "bdf1":
        return 1.0, 1.0, 1.0
    if method == "bdf2":
        return 4 / 9, 2 / 3, 1.0
    if method == "hht":
        am, af = 0.0, values[0]
        beta, gamma = (1 + af) ** 2 / 4, 0.5 + af
    else:
        rho = values[0]
        am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        gamma = 0.5 + af - am
        beta = (gamma + 0.5) ** 2 / 4
    return beta, gamma, (1 - am) / (1 - af)


def factors(form: str, scaling: str, label: str, h: float) -> tuple[list[float], list[float]]:
    """Left factors by row and right factors by unknown, Table 2 of the paper.

    Its β and γ are those per unit of v', not of the auxiliary a of generalized-α.
    """
    beta, gamma, c = symbols(label)
    kept, rows = FORMS[form]

    def of(side: str, table: Mapping[str, Any], names: Sequence[str]) -> list[float]:
        there = table if scaling in (side, "optimal") else {}
        return [there[n](beta / c, gamma / c, h) if n in there else 1.0 for n in names]

    left, right = oracles.TABLE_2[form]
    return of("left", left, rows), of("right", right, [*kept, "lambda"])


def jacobian(
    form: str, label: str, h: float, M: Array, X: Array, Y: Array, G: Array
) -> tuple[Array, list[slice], list[slice]]:
    """J of a form, unscaled, with the places of its rows and unknowns."""
    (n, m), none = G.shape, np.zeros(G.T.shape)
    system = exact_orders.System(M, X, Y, G, G, none, none, *symbols(label))
    found = exact_orders.Jacobian(system, form, "index-3", h, 0.0, 0.0)
    sizes = {"C": m, "lambda": m}
    rows, columns = (
        _slices([sizes.get(name, n) for name in blocks]) for blocks in (found.rows, found.unknowns)
    )
    return found.matrix.astype(float), rows, columns


def _slices(sizes: Sequence[int]) -> list[slice]:
    ends = np.cumsum([0, *sizes])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def _spread(factors: Sequence[float], places: Sequence[slice]) -> Array:
    """A factor for each row or unknown."""
    return np.repeat(factors, [place.stop - place.start for place in places])


def inverse(form: str, label: str, h: float, *matrices: Array) -> tuple[Array, Array, Any, Any]:
    """J, J⁻¹, both unscaled, and the places of rows and unknowns."""
    J, rows, columns = jacobian(form, label, h, *matrices)
    left, right = factors(form, "optimal", label, h)
    rows_by, columns_by = _spread(left, rows), _spread(right, columns)
    scaled = rows_by[:, None] * J * columns_by
    # Masses of grams and springs of kilonewtons: equilibrate what powers of h leave.
    row_size = 1 / np.abs(scaled).max(axis=1)
    even = scaled * row_size[:, None]
    column_size = 1 / np.abs(even).max(axis=0)
    even = even * column_size
    inverted = np.linalg.inv(even)
    inverted = inverted @ (2 * np.eye(len(J)) - even @ inverted)
    return J, (columns_by * column_size)[:, None] * inverted * (row_size * rows_by), rows, columns


def condition(form: str, scaling: str, label: str, h: float, *matrices: Array) -> float:
    """‖J̄‖·‖J̄⁻¹‖ in the 2-norm."""
    J, inverted, rows, columns = inverse(form, label, h, *matrices)
    left, right = factors(form, scaling, label, h)
    rows_by, columns_by = _spread(left, rows), _spread(right, columns)
    return float(
        np.linalg.norm(rows_by[:, None] * J * columns_by, 2)
        * np.linalg.norm(inverted / columns_by[:, None] / rows_by, 2)
    )


def block(
    form: str, scaling: str, label: str, h: float, unknown: str, row: str, *matrices: Array
) -> float:
    """Largest singular value of one block of J̄⁻¹."""
    _, inverted, rows, columns = inverse(form, label, h, *matrices)
    left, right = factors(form, scaling, label, h)
    kept, names = FORMS[form]
    i, j = (kept + "l").index(unknown[0]), names.index(row)
    return float(np.linalg.norm(inverted[columns[i], rows[j]], 2) / right[i] / left[j])


def matrices(
    program: Path, problem: Path, states: Sequence[Sequence[float]]
) -> list[dict[str, Array]]:
    """M, X, Y, G at states (t, u, v, λ), from march.cpp; and u, v, a, λ there."""
    lines = "\n".join(" ".join(repr(float(x)) for x in state) for state in states) + "\n"
    done = subprocess.run(
        [program, problem, "matrices"], input=lines, capture_output=True, text=True, check=True
    )
    head = dict(line.split(" ", 1) for line in problem.read_text().splitlines()[:2])
    n, m = (int(x) for x in head["size"].split())
    M = np.array([float(x) for x in head["mass"].split()]).reshape(n, n)
    found: list[Mapping[str, Any]] = json.loads(
        done.stdout.replace("-nan", "NaN").replace("nan", "NaN")
    )
    return [
        {
            "M": M,
            "X": np.array(entry["X"]).reshape(n, n),
            "Y": np.array(entry["Y"]).reshape(n, n),
            "G": np.array(entry["G"]).reshape(n, m),
            "u": np.array(state[1 : 1 + n]),
            "v": np.array(state[1 + n : 1 + 2 * n]),
            "lambda": np.array(state[1 + 2 * n :]),
            "a": np.linalg.solve(M, np.array(entry["F"])),
        }
        for entry, state in zip(found, states, strict=True)
    ]
