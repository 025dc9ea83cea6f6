"""Partial pivoting with the row exchanges that a matrix needed before.

Along a march the exchanges change seldom.  With them known the elimination can be written
out, see `generated`.  The code compares every pivot with the entries below it and gives up
where partial pivoting would take another row: what it solves, partial pivoting solves with
the same operations.  Then other code is tried, and loops solve what none does.
"""

import numpy as np

from newmark_cli.newmark.linear import assembly
from newmark_cli.newmark.linear.assembly import Constants
from newmark_cli.newmark.linear.dense import assembled, no_tables
from newmark_cli.newmark.linear.ordering import Order
from newmark_cli.newmark.linear.written import generated
from newmark_cli.newmark.linear.written.generated import Written
from newmark_cli.newmark.linear.written.lists import EliminationLists
from newmark_cli.newmark.march_data import MatrixTables, State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.algebra import LU
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray

#: Steps that take as long as compiling code once.
_WORTH = 5_000
#: Steps that take some ten times as long as looking exchanges up.
_BETWEEN = 1_000
#: Steps in which code gives up until others are looked up.
_PATIENCE = 20
#: Most orders of rows that are remembered, whatever the number of steps.
_MOST_KNOWN = 64
#: Most of them that a march goes to and fro between without a halt.  Where none of them fits,
#: they take a few times as long as the loops that follow.
_AT_HAND = 4
_NEVER = 2**62


class Exchanges:
    """Row exchanges of a march, as far as code is made for them.

    Attributes:
        given_up: Steps since the last look in which others were needed.
        looks: How often they were looked up.
        compiled: How often code was made for them.
    """

    def __init__(self, problem: Problem, scheme: Scheme, dense: MatrixTables) -> None:
        """Of index 3; the dense tables are the problem's."""
        self._problem, self._scheme, self._dense = problem, scheme, dense
        self._known: dict[bytes, Written | int | None] = {}
        #: Tables of `static_elimination.solve_generated`; empty ones for loops.
        self.tables = no_tables(scheme)
        self._steps = self.looks = self.given_up = self.compiled = 0

    @property
    def coded(self) -> bool:
        """Whether there is code for some exchanges."""
        return len(self.tables.room) > 0

    @property
    def patience(self) -> int:
        """After how many steps in which the code gives up the march should halt."""
        return _PATIENCE if self.coded and self._may_look else _NEVER

    @property
    def _may_look(self) -> bool:
        return self._steps >= _BETWEEN * (1 + self.looks)

    def took(self, given_up: IndexArray) -> None:
        """Count steps, and those of them in which the code has given up."""
        self._steps += len(given_up)
        self.given_up += int(given_up.sum())

    def look(self, state: State, step: int) -> None:
        """See to code for the exchanges at a state, if those that have some do not serve."""
        if not self._may_look or (self.coded and self.given_up < _PATIENCE):
            return
        self.looks, self.given_up = self.looks + 1, 0
        address = self._address(state, step)
        others = [other for other in self.tables.room.tolist() if other != address]
        if address:
            self.tables.room[:] = [address, *others][: len(self.tables.room)]

    def _address(self, state: State, step: int) -> int:
        """Where the code for the exchanges at a state stands; 0 where there is none."""
        problem, (u, v, *_) = self._problem, state.fields.astype(float)
        t, multipliers = problem.t0 + step * self._scheme.h, state.multipliers.astype(float)
        values = problem.values(t, u, v, multipliers)
        rows = row_order(assembled(self._dense, self._scheme, values))
        if rows is None:
            return 0
        key = rows.tobytes()
        if key not in self._known:
            if len(self._known) == _MOST_KNOWN:
                return 0
            self._known[key] = _written(rows, problem, self._scheme, self._dense)
        known = self._known[key]
        if isinstance(known, Written):
            address = known.address(compiling=False)
            if not address:
                if self.compiled >= self._steps // _WORTH:
                    return 0
                self.compiled += 1
                address = known.address()
            if not self.coded:
                # Whatever the rows, the same numbers.
                self.tables = known.tables._replace(room=np.zeros(_AT_HAND, np.uint64))
            self._known[key] = known = address
        return known or 0


def _written(
    rows: IndexArray, problem: Problem, scheme: Scheme, dense: MatrixTables
) -> Written | None:
    """Partial pivoting with an order of rows; None where there is too much fill."""
    fixed = assembly.constants(problem, scheme.tables)
    sums, _ = assembly.of_formulation(problem, scheme.tables)
    places = np.concatenate([fixed.rows, sums.rows]), np.concatenate([fixed.columns, sums.columns])
    lists = EliminationLists(Order(rows, np.arange(len(rows))), *places)
    if lists.operations > generated.OPERATIONS_AT_MOST:
        return None
    # Entries of the dense matrix, so that their sums are rounded as there.
    keys = np.unique(fixed.rows * len(rows) + fixed.columns)
    constants = Constants(*np.divmod(keys, len(rows)), dense.constant[keys])
    return Written(lists.tables(constants, sums, scheme.dtype), pivoting=True)


def row_order(matrix: Array) -> IndexArray | None:
    """(N,) rows in the order of their pivots; None where a pivot is zero or not a number."""
    try:
        factors = LU(matrix)
    except np.linalg.LinAlgError:
        return None
    # Also false where a pivot is not a number.
    return factors.order if np.all(np.abs(np.diagonal(factors.lu)) > 0) else None
