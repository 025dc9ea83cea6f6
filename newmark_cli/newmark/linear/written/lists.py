"""Fill of an elimination in a fixed order, as lists."""

import numpy as np

from newmark_cli.newmark.linear.assembly import Constants, Sums
from newmark_cli.newmark.linear.ordering import Order, inverse
from newmark_cli.newmark.linear.written import static_elimination
from newmark_cli.newmark.march_data import MatrixTables
from newmark_cli.support.arrays import IndexArray


class EliminationLists:
    """Pattern of a matrix and its fill in an order of elimination.

    Attributes:
        size: N.
        order: In which rows and unknowns are eliminated.
        upper_starts, upper_rows, lower_starts, lower_rows: The strict factors by columns,
            in that order.
        operations: Multiplications and subtractions of a factorisation.
        signed: Whether its pivots are positive, and have to stay so.
    """

    def __init__(
        self, order: Order, rows: IndexArray, columns: IndexArray, signed: bool = True
    ) -> None:
        """Of the places of a matrix' entries; a place may be there more than once."""
        self.order, self.size, self.signed = order, len(order.rows), signed
        self._row_place, self._column_place = inverse(order.rows), inverse(order.columns)
        keys = np.unique(self._keys(rows, columns))
        starts = np.searchsorted(keys, np.arange(self.size + 1) * self.size)
        (
            self.upper_starts, self.upper_rows, self.lower_starts, self.lower_rows,
        ) = static_elimination.analyse(self.size, starts, keys % self.size)  # fmt: skip
        below = np.diff(self.lower_starts)
        self.operations = int(below[self.upper_rows].sum())

    def tables(self, constants: Constants, sums: Sums, dtype: type) -> MatrixTables:
        """A matrix with this pattern, as `static_elimination` reads it; without work space."""
        # By columns in their order, and by rows in that of the matrix, for any order of these.
        keys = self._column_place[constants.columns] * self.size + constants.rows
        keys, slots = np.unique(keys, return_inverse=True)
        columns = self._column_place[sums.columns]
        by_column = np.argsort(columns, kind="stable")
        starts = np.arange(self.size + 1)
        sections = [
            self.order.rows, self.order.columns,
            np.searchsorted(keys, starts * self.size), self._row_place[keys % self.size],
            np.searchsorted(columns[by_column], starts),
            self.upper_starts, self.upper_rows, self.lower_starts, self.lower_rows,
        ]  # fmt: skip
        begins = np.cumsum([0, *map(len, sections)])[:-1]
        return MatrixTables(
            constant=np.bincount(slots, constants.values, len(keys)).astype(dtype),
            places=self._row_place[sums.rows[by_column]].astype(np.uint32),
            origins=sums.origins[by_column].astype(np.uint32),
            coefficients=sums.coefficients[by_column].astype(dtype),
            structure=np.concatenate(sections).astype(np.uint32),
            room=np.array([*begins, self.signed, self.size], np.uint64),
            work=np.empty(0, dtype),
        )

    def _keys(self, rows: IndexArray, columns: IndexArray) -> IndexArray:
        """Numbers of places, by columns in their order."""
        keys: IndexArray = self._column_place[columns] * self.size + self._row_place[rows]
        return keys
