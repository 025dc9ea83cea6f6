"""Linear systems of binary numbers, solved to many digits.

The factors of the balanced matrix are computed in double precision, residuals of the exact
binary values in decimal arithmetic of `PRECISION` digits.  Each refinement gains as many
digits as the factors have; where they have none, a small system is eliminated in decimal
arithmetic instead.
"""

import decimal
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from decimal import Decimal
from itertools import pairwise

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import splu

from newmark_cli.support.arrays import Array

#: Digits of the arithmetic, and those that every component of a solution has at least.
PRECISION, DIGITS = 220, 60
#: Largest last correction, and components that count as zero, both relative to the largest
#: component in balanced unknowns.
_CONVERGED, _ZERO = Decimal("1e-170"), Decimal("1e-100")
#: Largest ratio of successive residuals with which refinement goes on.
_GAIN = Decimal("0.1")
#: Most unknowns of a system that is eliminated in decimal arithmetic.
_ELIMINATED_UP_TO = 400

#: (columns, values) of each row of a matrix.
_Rows = list[tuple[list[int], list[Decimal]]]


class NotSolvedError(np.linalg.LinAlgError):
    """The factors in double precision have no digit, and the system is too large for others."""


def solve(
    matrix: scipy.sparse.csc_array, rhs: Array, rows: Array, columns: Array
) -> tuple[Decimal, ...]:
    """Solution of A x = rhs to at least `DIGITS` significant digits in every component.

    Components below 1e-100 of the largest, in balanced unknowns, are zeros.  ``rows`` and
    ``columns`` are factors that balance A, as far as they are known.

    Raises:
        numpy.linalg.LinAlgError: When A is singular.
        NotSolvedError: When A is too ill-conditioned, although balanced, for its size.
    """
    with _arithmetic():
        rows, columns = _balanced(matrix, rows, columns)
        outer, inner = [*map(Decimal, rows.tolist())], [*map(Decimal, columns.tolist())]
        exact: _Rows = [
            (places, [value * outer[i] * inner[j] for j, value in zip(places, values, strict=True)])
            for i, (places, values) in enumerate(_rows(matrix))
        ]
        target = [
            Decimal(value) * factor for value, factor in zip(rhs.tolist(), outer, strict=True)
        ]
        scaled = scipy.sparse.csc_array(
            scipy.sparse.diags_array(rows) @ matrix @ scipy.sparse.diags_array(columns)
        )
        solution = _refined(scaled, exact, target)
        if solution is None:
            if len(rhs) > _ELIMINATED_UP_TO:
                raise NotSolvedError(
                    f"{len(rhs)} unknowns, and no digit of the balanced matrix's factors is right"
                )
            solution = _eliminated(exact, target)
        least = _ZERO * max(map(abs, solution), default=Decimal(0))
        return tuple(
            factor * value if abs(value) > least else Decimal(0)
            for factor, value in zip(inner, solution, strict=True)
        )


def backward_error(matrix: scipy.sparse.csc_array, rhs: Array, x: Sequence[float]) -> float:
    """‖rhs − A x‖₂ / (‖A‖_F ‖x‖₂ + ‖rhs‖₂), evaluated in `PRECISION` digits."""
    with _arithmetic():
        solution, target = [*map(Decimal, x)], [*map(Decimal, rhs.tolist())]
        missed = _residual(_rows(matrix), target, solution)
        size = _norm([*map(Decimal, matrix.data.tolist())]) * _norm(solution) + _norm(target)
        return float(_norm(missed) / size) if size else 0.0


@contextmanager
def _arithmetic() -> Iterator[None]:
    """A context of its own: the caller's may trap inexact results."""
    with decimal.localcontext(decimal.Context(prec=PRECISION)):
        yield


def _rows(matrix: scipy.sparse.csc_array) -> _Rows:
    by_row = scipy.sparse.csr_array(matrix)
    by_row.sort_indices()
    places, values = by_row.indices.tolist(), [*map(Decimal, by_row.data.tolist())]
    starts = by_row.indptr.tolist()
    return [(places[begin:end], values[begin:end]) for begin, end in pairwise(starts)]


def _balanced(matrix: scipy.sparse.csc_array, rows: Array, columns: Array) -> tuple[Array, Array]:
    """Factors with which the largest entry of every row and column is near 1 (Ruiz 2001)."""
    places = matrix.tocoo()
    for _ in range(10):
        sizes = np.abs(rows[places.row] * places.data * columns[places.col])
        of_row, of_column = np.zeros(len(rows)), np.zeros(len(columns))
        np.maximum.at(of_row, places.row, sizes)
        np.maximum.at(of_column, places.col, sizes)
        if not (np.all(of_row > 0) and np.all(of_column > 0)):
            raise np.linalg.LinAlgError("a row or column is zero")
        rows, columns = rows / np.sqrt(of_row), columns / np.sqrt(of_column)
    return rows, columns


def _residual(rows: _Rows, target: Sequence[Decimal], x: Sequence[Decimal]) -> list[Decimal]:
    """Target − A x."""
    return [
        sum((-value * x[j] for j, value in zip(places, values, strict=True)), start)
        for start, (places, values) in zip(target, rows, strict=True)
    ]


def _norm(values: Sequence[Decimal]) -> Decimal:
    return sum((value * value for value in values), Decimal(0)).sqrt()


def _refined(
    matrix: scipy.sparse.csc_array, exact: _Rows, target: Sequence[Decimal]
) -> list[Decimal] | None:
    """The solution by refinement; None where that gains nothing."""
    solution = [Decimal(0)] * len(target)
    missed, before = list(target), None
    try:
        factors = splu(matrix)
    except RuntimeError:  # a pivot is exactly zero
        return None
    while size := max(map(abs, missed), default=Decimal(0)):
        if before is not None and size > _GAIN * before:
            return None
        before = size
        step = factors.solve(np.array([float(value / size) for value in missed]))
        if not np.all(np.isfinite(step)):
            return None
        solution = [x + size * Decimal(d) for x, d in zip(solution, step.tolist(), strict=True)]
        largest = max(map(abs, solution))
        if size * Decimal(float(np.abs(step).max())) <= _CONVERGED * largest:
            break
        missed = _residual(exact, target, solution)
    return solution


def _eliminated(exact: _Rows, target: Sequence[Decimal]) -> list[Decimal]:
    """The solution by elimination with partial pivoting."""
    size = len(target)
    table = [[Decimal(0)] * size + [value] for value in target]
    for row, (places, values) in zip(table, exact, strict=True):
        for place, value in zip(places, values, strict=True):
            row[place] = value
    # In balanced rows of entries near 1 nothing less than this is a pivot.
    least = Decimal(10) ** (DIGITS - PRECISION)
    for k in range(size):
        pivot = max(range(k, size), key=lambda i: abs(table[i][k]))
        table[k], table[pivot] = table[pivot], table[k]
        head = table[k]
        if abs(head[k]) < least:
            raise np.linalg.LinAlgError("the matrix is singular")
        filled = [j for j in range(k + 1, size + 1) if head[j]]
        for row in table[k + 1 :]:
            if row[k]:
                factor = row[k] / head[k]
                for j in filled:
                    row[j] -= factor * head[j]
    solution = [Decimal(0)] * size
    for k in reversed(range(size)):
        row = table[k]
        rest = sum((row[j] * solution[j] for j in range(k + 1, size) if row[j]), Decimal(0))
        solution[k] = (row[size] - rest) / row[k]
    return solution


def text(value: Decimal) -> str:
    """A component of a solution with ten digits more than it is sure to have."""
    return f"{value:.{DIGITS + 9}e}" if value and math.isfinite(value) else "0.0"
