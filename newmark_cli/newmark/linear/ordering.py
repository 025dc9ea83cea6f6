"""Static orders of elimination: pivots on the diagonal, or by their size at the start.

On the diagonal, rows and unknowns come in pairs, the pivots: row D goes with the highest kept
field, whose coefficient there is that of M; V and K with the other kept fields, by the update
relations; a constraint with its multiplier.  A field goes before the field of its
coordinate that row D belongs to, and a multiplier after all coordinates of its constraint:
then its pivot is that of GᵀA⁻¹G for the constraints so far, A standing for row D's part,
and is positive wherever A is positive definite and G has full rank.  Anything less, one
end of a bar for example, would fail at a dead centre.

For bodies of twelve coordinates and six constraints in space that costs ten times the
operations of the best order, whose pivots are entries of G.  `order_by_size` finds one; where a
pivot is small along the motion, the elimination gives up, and partial pivoting takes over.
"""

import heapq
from typing import NamedTuple

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import reverse_cuthill_mckee

from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray

#: Most unknowns for which each pivot is chosen for the least work; more go by bands.
CHOSEN_UP_TO = 300
#: Least pivot by size, of the largest entry in its column.
_LEAST_PIVOT = 0.3


class Order(NamedTuple):
    """Rows and unknowns in their order of elimination."""

    rows: IndexArray
    columns: IndexArray


def static_order(problem: Problem, fields: int, rows: IndexArray, columns: IndexArray) -> Order:
    """Order of elimination of a form's Jacobian, pivots on the diagonal.

    Of p kept fields; rows are D, p − 1 of V and K, and C, with entries at these places.
    """
    n, m = problem.n, problem.m
    size = fields * n + m
    by_bands = _bands(problem, fields)
    if size <= CHOSEN_UP_TO:
        chosen = _least_work(problem, fields, rows, columns, by_bands)
    else:
        chosen = by_bands
    return Order(_row_of(n, m, fields)[chosen], chosen)


def order_by_size(matrix: Array, rows: IndexArray, columns: IndexArray) -> Order | None:
    """Order by least work of the next pivot (Markowitz 1957), among entries that are large.

    Of a matrix (N, N) at the start, in units in which its entries compare, and the places of its
    entries at any state; None if it is singular.
    """
    size, work = len(matrix), matrix.copy()
    there = np.zeros((size, size), bool)
    there[rows, columns] = True
    order = np.empty((2, size), np.int64)
    for k in range(size):
        sizes = np.where(there, np.abs(work), 0)
        large = (sizes > 0) & (sizes >= _LEAST_PIVOT * sizes.max(axis=0))
        cost = np.outer(there.sum(axis=1) - 1, there.sum(axis=0) - 1)
        i, j = divmod(int(np.where(large, cost, size * size).argmin()), size)
        if not large[i, j]:
            return None
        order[:, k] = i, j
        below, beside = there[:, j].copy(), there[i].copy()
        below[i] = beside[j] = False
        fill = np.ix_(below, beside)
        work[fill] -= np.outer(work[below, j] / work[i, j], work[i, beside])
        there[fill] = True
        there[i] = there[:, j] = False
    return Order(*order)


def coupling(problem: Problem) -> scipy.sparse.csr_array:
    """(n, n) which coordinates M, X, Y or a constraint couple."""
    n, m, pattern = problem.n, problem.m, problem.pattern
    constraints = _ones(pattern.g_rows, pattern.g_columns, (n, m))
    coupled = scipy.sparse.csr_array(
        _ones(pattern.mass_rows, pattern.mass_columns, (n, n))
        + _ones(pattern.x_rows, pattern.x_columns, (n, n))
        + _ones(pattern.y_rows, pattern.y_columns, (n, n))
        + constraints @ constraints.T
    )
    return scipy.sparse.csr_array(coupled + coupled.T)


def banded(coupled: scipy.sparse.csr_array) -> IndexArray:
    """(n,) place of each coordinate by reverse Cuthill–McKee."""
    return inverse(np.asarray(reverse_cuthill_mckee(coupled, symmetric_mode=True), np.int64))


def inverse(order: IndexArray) -> IndexArray:
    """Place of each number in an order of all."""
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return place


def _ones(rows: IndexArray, columns: IndexArray, shape: tuple[int, int]) -> scipy.sparse.csr_array:
    return scipy.sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape)


def _row_of(n: int, m: int, fields: int) -> IndexArray:
    """(N,) the row of each unknown's pivot."""
    blocks = [(fields - 1 - k) * n + np.arange(n) for k in range(fields)]
    return np.concatenate([*blocks, fields * n + np.arange(m)])


def _bands(problem: Problem, fields: int) -> IndexArray:
    """Unknowns by reverse Cuthill–McKee, which keeps the fill of long mechanisms in a band."""
    n, m, pattern = problem.n, problem.m, problem.pattern
    place = banded(coupling(problem))
    met = np.zeros(m, np.int64)
    np.maximum.at(met, pattern.g_columns, place[pattern.g_rows])
    moments = np.concatenate([place] * fields + [met])
    ranks = np.repeat(np.arange(fields + 1), [n] * fields + [m])
    return np.lexsort((ranks, moments)).astype(np.int64)


def _least_work(
    problem: Problem, fields: int, rows: IndexArray, columns: IndexArray, ties: IndexArray
) -> IndexArray:
    """Unknowns by least work of the next pivot (Markowitz 1957), ties in a given order."""
    n, m, pattern = problem.n, problem.m, problem.pattern
    size = fields * n + m
    pivot = inverse(_row_of(n, m, fields))
    in_row: list[set[int]] = [set() for _ in range(size)]
    in_column: list[set[int]] = [set() for _ in range(size)]
    for i, j in zip(pivot[rows].tolist(), columns.tolist(), strict=True):
        if i != j:
            in_row[i].add(j)
            in_column[j].add(i)
    after: list[list[int]] = [[] for _ in range(size)]
    waiting = [0] * size
    highest = (fields - 1) * n

    def wait(first: int, then: int) -> None:
        after[first].append(then)
        waiting[then] += 1

    for i in range(n):
        for k in range(fields - 1):
            wait(k * n + i, highest + i)
    places = zip(pattern.g_rows.tolist(), pattern.g_columns.tolist(), strict=True)
    for i, k in sorted(set(places)):
        wait(highest + i, fields * n + k)
    rank = inverse(ties).tolist()

    def cost(k: int) -> int:
        return len(in_row[k]) * len(in_column[k])

    heap = [(cost(k), rank[k], k) for k in range(size) if not waiting[k]]
    heapq.heapify(heap)
    order: list[int] = []
    done = [False] * size
    while heap:
        least, _, k = heapq.heappop(heap)
        if done[k] or least != cost(k):
            continue
        done[k] = True
        order.append(k)
        touched = in_row[k] | in_column[k]
        for i in in_column[k]:
            in_row[i].discard(k)
            in_row[i] |= in_row[k]
            in_row[i].discard(i)
        for j in in_row[k]:
            in_column[j].discard(k)
            in_column[j] |= in_column[k]
            in_column[j].discard(j)
        for then in after[k]:
            waiting[then] -= 1
            touched.add(then)
        for j in touched:
            if not waiting[j] and not done[j]:
                heapq.heappush(heap, (cost(j), rank[j], j))
    return np.array(order, np.int64)
