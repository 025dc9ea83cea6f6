"""Gaussian elimination in an order that is fixed beforehand, column by column.

Pattern, order and fill are analysed once; what is left in every iteration are loops over
lists of indices (Gilbert & Peierls 1988; the refactorisation of KLU, Davis & Palamadai
Natarajan 2010), without exchanging rows.  A diagonal scaling of the matrix scales its
factors and changes nothing else.

The matrix is taken in units of its own, powers of two that make its entries about one
at the start and its pivots positive, where they are on the diagonal.  They are watched: no such
pivot may become negative, and no multiplier of the elimination exceed `LARGEST_MULTIPLIER`; else
the elimination gives up.

All of it is called through `kernel.solve_type` or from Python.
"""

import numpy as np
from numba import types
from numba.extending import intrinsic

from newmark_cli.newmark.march_data import COMPLETED, PIVOTING
from newmark_cli.support.cached_code import cached_njit
from newmark_cli.support.machine_code import generate_call

_compile = cached_njit(nogil=True, error_model="numpy")

#: Largest multiplier of an elimination.
LARGEST_MULTIPLIER = 1e4

#: Sections of ``structure``, in this order; ``room`` has where they begin, then whether every
#: pivot has to be positive, and N.
SECTIONS = (
    "row_order", "column_order",
    "constant_starts", "constant_rows", "term_starts",
    "upper_starts", "upper_rows", "lower_starts", "lower_rows",
)  # fmt: skip
(
    ROW_ORDER, COLUMN_ORDER, CONSTANT_STARTS, CONSTANT_ROWS, TERM_STARTS,
    UPPER_STARTS, UPPER_ROWS, LOWER_STARTS, LOWER_ROWS,
) = range(len(SECTIONS))  # fmt: skip

SIGNED = len(SECTIONS)


@_compile
def analyse(size, starts, rows):
    """Fill of an elimination without row exchanges.

    From (N + 1,) where the columns of the matrix begin, and the rows of its entries, in the order
    of elimination.  Returns starts and rows of the columns of the strict upper factor, then of
    the strict lower one, rows ascending.
    """
    upper_starts, lower_starts = np.zeros(size + 1, np.int64), np.zeros(size + 1, np.int64)
    upper_rows, lower_rows = np.empty(4 * size, np.int64), np.empty(4 * size, np.int64)
    there = np.full(size, -1, np.int64)
    for j in range(size):
        least, most = j, j
        for e in range(starts[j], starts[j + 1]):
            there[rows[e]] = j
            least, most = min(least, rows[e]), max(most, rows[e])
        upper, lower = upper_starts[j], lower_starts[j]
        for k in range(least, j):
            if there[k] == j:
                if upper == upper_rows.shape[0]:
                    upper_rows = np.concatenate((upper_rows, np.empty_like(upper_rows)))
                upper_rows[upper] = k
                upper += 1
                for e in range(lower_starts[k], lower_starts[k + 1]):
                    there[lower_rows[e]] = j
                    most = max(most, lower_rows[e])
        for i in range(j + 1, most + 1):
            if there[i] == j:
                if lower == lower_rows.shape[0]:
                    lower_rows = np.concatenate((lower_rows, np.empty_like(lower_rows)))
                lower_rows[lower] = i
                lower += 1
        upper_starts[j + 1], lower_starts[j + 1] = upper, lower
    return upper_starts, upper_rows[:upper], lower_starts, lower_rows[:lower]


@_compile
def _factors(structure, room, work):
    """Starts, rows and values of the strict upper and lower factor, and the inverse pivots."""
    size = np.intp(room[-1])
    lower_starts = structure[np.intp(room[LOWER_STARTS]) :]
    lower_size = np.intp(lower_starts[size])
    return (
        structure[np.intp(room[UPPER_STARTS]) :],
        structure[np.intp(room[UPPER_ROWS]) :],
        work[5 * size + lower_size :],
        lower_starts,
        structure[np.intp(room[LOWER_ROWS]) :],
        work[5 * size : 5 * size + lower_size],
        work[2 * size : 3 * size],
    )


@_compile
def eliminate(sources, constant, places, origins, coefficients, structure, room, work):
    """Factorise the matrix of these sources; see `solve_in_order` for the arguments.

    False where a pivot is not one: the matrix needs another order.
    """
    size = np.intp(room[-1])
    constant_starts = structure[np.intp(room[CONSTANT_STARTS]) :]
    constant_rows = structure[np.intp(room[CONSTANT_ROWS]) :]
    term_starts = structure[np.intp(room[TERM_STARTS]) :]
    (
        upper_starts, upper_rows, upper, lower_starts, lower_rows, lower, inverse,
    ) = _factors(structure, room, work)  # fmt: skip
    column = work[3 * size : 4 * size]
    one, limit = work.dtype.type(1), work.dtype.type(LARGEST_MULTIPLIER)
    signed = room[SIGNED] != 0
    for j in range(size):
        for e in range(upper_starts[j], upper_starts[j + 1]):
            column[upper_rows[e]] = 0
        column[j] = 0
        for e in range(lower_starts[j], lower_starts[j + 1]):
            column[lower_rows[e]] = 0
        for e in range(constant_starts[j], constant_starts[j + 1]):
            column[constant_rows[e]] = constant[e]
        for e in range(term_starts[j], term_starts[j + 1]):
            column[places[e]] += coefficients[e] * sources[origins[e]]
        for e in range(upper_starts[j], upper_starts[j + 1]):
            k = upper_rows[e]
            factor = column[k]
            upper[e] = factor
            if factor != 0:
                for i in range(lower_starts[k], lower_starts[k + 1]):
                    column[lower_rows[i]] -= lower[i] * factor
        reciprocal = one / column[j]
        inverse[j] = reciprocal
        largest = work.dtype.type(0)
        for e in range(lower_starts[j], lower_starts[j + 1]):
            factor = column[lower_rows[e]] * reciprocal
            lower[e] = factor
            largest = max(largest, abs(factor))
        # A pivot may be zero, or not a number.
        positive = reciprocal if signed else abs(reciprocal)
        if not (positive > 0 and largest <= limit):
            return False
    return True


@_compile
def substitute(rhs, structure, room, work):
    """Overwrite ``rhs`` (N,) with the solution, of the factors that `eliminate` left."""
    size = np.intp(room[-1])
    row_order = structure[np.intp(room[ROW_ORDER]) :]
    column_order = structure[np.intp(room[COLUMN_ORDER]) :]
    (
        upper_starts, upper_rows, upper, lower_starts, lower_rows, lower, inverse,
    ) = _factors(structure, room, work)  # fmt: skip
    row_units, column_units = work[:size], work[size : 2 * size]
    solution = work[4 * size : 5 * size]
    for j in range(size):
        solution[j] = rhs[row_order[j]] * row_units[j]
    for j in range(size):
        solved = solution[j]
        for e in range(lower_starts[j], lower_starts[j + 1]):
            solution[lower_rows[e]] -= lower[e] * solved
    for j in range(size - 1, -1, -1):
        solved = solution[j] * inverse[j]
        rhs[column_order[j]] = solved * column_units[j]
        for e in range(upper_starts[j], upper_starts[j + 1]):
            solution[upper_rows[e]] -= upper[e] * solved


@_compile
def solve_in_order(
    sources, rhs, constant, places, origins, coefficients, structure, room, work
):  # fmt: skip
    """Solve D_L J D_R q̄ = −D_L b by static elimination; of `kernel.solve_type`.

    Args:
        sources: (E,) entries of X, Y and G.
        rhs: (N,) overwritten with the solution.
        constant: (S,) entries that no state changes, by columns in their order, in these
            units, as coefficients are.
        places: (T,) row, in the order of elimination, to which a term adds.
        origins, coefficients: (T,) the source of a term and its factor.
        structure, room: Orders, pattern and fill; see `SECTIONS`.
        work: Units of rows and of columns (N,), in their order, the first signed as the
            pivots are; then room: inverse pivots, two vectors, the lower and the upper
            factor.
    """
    if not eliminate(sources, constant, places, origins, coefficients, structure, room, work):
        return PIVOTING
    substitute(rhs, structure, room, work)
    return COMPLETED


@intrinsic
def _call(typing, address, sources, rhs, constant, coefficients, work):
    """Call what stands at an address with five arrays of one type of number."""
    return types.int64(address, sources, rhs, constant, coefficients, work), generate_call


@_compile
def solve_generated(
    sources, rhs, constant, places, origins, coefficients, structure, room, work
):  # fmt: skip
    """The same by code that `generated` has made for the pattern.

    Addresses of such code are all that ``room`` has, 0 for none: whichever solves the system
    comes first from then on.
    """
    for k in range(room.shape[0]):
        if room[k] == 0:
            break
        if _call(room[k], sources, rhs, constant, coefficients, work) == COMPLETED:  # type: ignore[call-arg]
            for before in range(k, 0, -1):
                room[before], room[before - 1] = room[before - 1], room[before]
            return COMPLETED
    return PIVOTING
