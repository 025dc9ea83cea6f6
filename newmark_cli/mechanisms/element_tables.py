"""Elements of mechanisms as the tables of `newmark_cli.mechanisms.elements`, and places of values.

Both tables and all places are laid out together for elements of one shape, one or a million.
"""

import math
from array import array
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.mechanisms import elements, laws, rates
from newmark_cli.problems.problem import Pattern
from newmark_cli.support.arrays import Array, IndexArray

#: Place in u of a vector or a coordinate, and its weight; a and b of a turned one, a + bR.
Term = tuple[Any, ...]
#: Of elements of one shape, one after the other.
_Columns = tuple["array[int]", "array[int]", "array[int]", "array[float]"]
#: The same as arrays, (k,), (k,), (k, terms), and (k, …) constants, parameters and weights.
_Group = tuple["Shape", IndexArray, IndexArray, IndexArray, Array]
#: A place in the values of a matrix: term of the row and a coordinate of it, and of the column.
_Entry = tuple[int, int, int, int]


class Shape(NamedTuple):
    """What elements have in common whose rows of the tables look alike.

    Attributes:
        kind: One of the kinds of `elements`.
        sums: How many have weights of their own.
        axes: On how many axes each is repeated; 0 without any.
        constants: Numbers that are constant of the sums.
        parameters: Numbers of parameters of their kind.
        first, second, single: Numbers of terms.
    """

    kind: int
    sums: int
    axes: int
    constants: int
    parameters: int
    first: int
    second: int
    single: int

    @property
    def _slots(self) -> list[tuple[int, int]]:
        """Terms and axes of the sums, in the order of their gradient."""
        return [(i, c) for i in range(self.first + self.second) for c in range(self.axes)]

    def x_entries(self) -> list[_Entry]:
        """Places of the values of X, in the order in which the loop writes them."""
        kind, terms, axes = self.kind, range(self.first + self.second), range(self.axes)
        if kind in (elements.PRODUCT, elements.ANGLE):
            pairs = [(i, j) for i in terms[: self.first] for j in terms[self.first :]]
            return [(a, c, b, c) for i, j in pairs for a, b in ((i, j), (j, i)) for c in axes]
        if kind == elements.SQUARE:
            return [(i, c, j, c) for i in terms for j in terms for c in axes]
        if kind in elements.ALONG_LINES:
            return [(i, c, j, d) for i in terms for j in terms for c in axes for d in axes]
        if kind == elements.HINGE:
            return [(*row, *column) for row in self._slots for column in self._slots]
        return self._rare_entries()

    def _rare_entries(self) -> list[_Entry]:
        """The same for angles that are coordinates, and for torques on a body in space."""
        if self.kind == elements.TWIST:
            return [(i, 0, j, 0) for i in range(self.single) for j in range(self.single)]
        if self.kind == elements.COUPLE:
            angle = (self.second, 0)
            both = [pair for slot in self._slots for pair in ((*slot, *angle), (*angle, *slot))]
            return [*both, (*angle, *angle)]
        if self.kind not in (elements.MOMENT, elements.FOLLOWER):
            return []
        crossed = [(c + a, c + b) for c in range(3) for a, b in ((1, 2), (2, 1))]
        own = self.kind == elements.MOMENT
        directors = [(i, j) for i in range(3) for j in range(3) if i == j or not own]
        return [(0, 3 * i + c % 3, 0, 3 * j + d % 3) for i, j in directors for c, d in crossed]

    def y_entries(self) -> list[_Entry]:
        """The same of Y."""
        damps = self.kind in (elements.DAMPER, elements.TWIST, elements.HINGE)
        return self.x_entries() if damps else []

    def g_entries(self) -> list[tuple[int, int]]:
        """Terms and coordinates of the values of G."""
        if self.kind not in elements.CONSTRAINTS:
            return []
        behind = self.first + self.second
        return self._slots + [(behind + i, 0) for i in range(self.single)]


class ElementList:
    """Elements in the order in which they are added, which is that of the tables."""

    def __init__(self) -> None:
        """Without elements."""
        #: Numbers of elements, and laws of time that act on them.
        self._timed: list[tuple[int, laws.Timed]] = []
        self._size = 0
        #: Numbers of the elements of a shape, their rows, places in u, and reals.
        self._columns: defaultdict[Shape, _Columns] = defaultdict(
            lambda: (array("q"), array("q"), array("q"), array("d"))
        )

    def add(
        self, shape: Shape, row: int, places: Iterable[int], reals: Iterable[float],
        timed: Iterable[laws.Timed],
    ) -> None:  # fmt: skip
        """Add an element, with its constraint or −1, and laws of time that act on it."""
        numbers, rows, all_places, all_reals = self._columns[shape]
        numbers.append(self._size)
        rows.append(row)
        all_places.extend(places)
        all_reals.extend(reals)
        self._timed += [(self._size, law) for law in timed]
        self._size += 1

    @property
    def until(self) -> float:
        """Time (s) up to which all laws say anything."""
        return min((laws.until(law.law) for _, law in self._timed), default=math.inf)

    def fields(
        self, released: Sequence[int], mass: IndexArray, conservative: bool
    ) -> Mapping[str, Any]:
        """Fields of a `Problem`: tables, pattern, and the functions that these elements ask for.

        Args:
            released: Numbers of constraints that are left out, in their order.
            mass: (2, entries) places of the mass matrix.
            conservative: Whether energy is conserved.
        """
        groups, timed = self._kept(released)
        ints, reals, entries = _tables(groups, timed)
        kinds = {shape.kind for shape, *_ in groups}
        behind = any(laws.stands_behind(law) for _, law in timed)
        rare = behind or any(kind >= elements.COUPLE for kind in kinds)
        angular = behind or not kinds.isdisjoint(elements.ANGULAR)
        common = rates.constraint_derivatives
        return {
            "function": elements.evaluate_all if rare else elements.evaluate,
            "derivatives": rates.all_constraint_derivatives if angular else common,
            "potential": rates.potential if conservative else None,
            "ints": ints[None],
            "reals": reals[None],
            "pattern": Pattern(*mass, *entries),
        }

    def _kept(self, released: Sequence[int]) -> tuple[list[_Group], list[tuple[int, laws.Timed]]]:
        """Elements without those of some constraints, and laws, numbered anew."""
        groups: list[_Group] = []
        kept = np.ones(self._size, bool)
        for shape, (numbers, all_rows, places, values) in self._columns.items():
            of_rows = np.array(all_rows, np.int64)
            here = ~np.isin(of_rows, released)
            kept[np.array(numbers)[~here]] = False
            count = len(numbers)
            group = (
                shape,
                np.array(numbers, np.int64)[here],
                (of_rows - np.searchsorted(released, of_rows))[here],
                np.array(places, np.int64).reshape(count, -1)[here],
                np.array(values, float).reshape(count, -1)[here],
            )
            groups.append(group)
        number = np.cumsum(kept) - 1
        timed = [(int(number[i]), law) for i, law in self._timed if kept[i]]
        groups = [(shape, number[of], rows, at, reals) for shape, of, rows, at, reals in groups]
        return groups, timed


def _tables(
    groups: Sequence[_Group], timed: Sequence[tuple[int, laws.Timed]]
) -> tuple[IndexArray, Array, list[IndexArray]]:
    """Both tables, and rows and columns of the values of X, Y and G."""
    count = sum(len(numbers) for _, numbers, *_ in groups)
    # Entries of each element in both tables and in X, Y and G.
    sizes = np.zeros((5, count), np.int64)
    entries = []
    for shape, numbers, _, places, reals in groups:
        all_entries = shape.x_entries(), shape.y_entries(), shape.g_entries()
        entries.append([np.array(of, np.int64).T for of in all_entries])
        width = elements.PLACES + places.shape[1], reals.shape[1]
        sizes[:, numbers] = np.array([*width, *(len(of) for of in all_entries)])[:, None]
    begins = np.zeros((5, count + 1), np.int64)
    np.cumsum(sizes, axis=1, out=begins[:, 1:])
    ints = np.zeros(begins[0, -1], np.int64)
    numbers_of = np.zeros(begins[1, -1])
    x, y, g = (np.zeros((2, size), np.int64) for size in begins[2:, -1])
    parameters_at, driven_at = np.zeros((2, count), np.int64)
    for (shape, numbers, rows, places, reals), values in zip(groups, entries, strict=True):
        at = begins[:, numbers]
        parameters = at[1] + shape.constants
        parameters_at[numbers] = parameters
        driven_at[numbers] = parameters + shape.parameters - elements.LAW
        header = [
            shape.kind, sizes[0, numbers], at[1], parameters, parameters + shape.parameters, rows,
            *at[2:], shape.sums, shape.axes, shape.parameters, shape.first, shape.second,
            shape.single,
        ]  # fmt: skip
        for column, value in enumerate(header):
            ints[at[0] + column] = value
        _put(ints, at[0] + elements.PLACES, places)
        _put(numbers_of, at[1], reals)
        for to, begin, of in zip((x, y), at[2:4], values[:2], strict=True):
            if of.size:
                for side in (0, 1):
                    _put(to[side], begin, places[:, of[2 * side]] + of[2 * side + 1])
        if values[2].size:
            term, coordinate = values[2]
            _put(g[0], at[4], places[:, term] + coordinate)
            _put(g[1], at[4], np.repeat(rows[:, None], len(term), axis=1))
    if any(laws.stands_behind(law) for _, law in timed):
        tables = ints.tolist(), numbers_of.tolist()
        for i, law in timed:
            place = driven_at[i] if law.target is None else parameters_at[i] + law.target
            laws.append(*tables, int(place), law)
        ints, numbers_of = np.array(tables[0], np.int64), np.array(tables[1])
    return ints, numbers_of, [*x, *y, *g]


def _put(to: Array | IndexArray, begins: IndexArray, values: Array | IndexArray) -> None:
    """Write each row of values from its place on."""
    to[begins[:, None] + np.arange(values.shape[1])] = values
