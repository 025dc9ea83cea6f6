"""Mechanisms of plain points and links as arrays: what `planar.build` makes, at any size.

`planar` looks at a mechanism part by part, because it is somebody's file and may be wrong
in every part.  A member of a family is right by construction and may have a million parts.
Here its tables are made with a few NumPy operations, equal to those of `planar` to the last
bit: sums run in the same order.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, overload

import numpy as np

from newmark_cli.problems.problem import Elements, Pattern, Problem
from newmark_cli.support.arrays import Array, IndexArray

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class Made(Sequence[_Item], Generic[_Item]):
    """A sequence whose items are made when they are asked for.

    Attributes:
        size: Number of items.
        item: Place, from 0 → item.
    """

    size: int
    item: Callable[[int], _Item]

    def __len__(self) -> int:
        return self.size

    def __iter__(self) -> Iterator[_Item]:
        return map(self.item, range(self.size))

    @overload
    def __getitem__(self, place: int) -> _Item: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[_Item, ...]: ...
    def __getitem__(self, place: int | slice) -> _Item | tuple[_Item, ...]:
        if isinstance(place, slice):
            return tuple(map(self.item, range(self.size)[place]))
        return self.item(range(self.size)[place])


@dataclass(frozen=True, eq=False)
class Linked:
    """Points, of which each link joins two, at least the second of them a moving one.

    Attributes:
        u0, v0: (2p,) initial coordinates (m) and velocities (m/s) of the p moving points.
        starts: (m,) moving point at the first end of each link; −1 for a fixed one.
        ends: (m,) moving point at its second end.
        anchors: (m, 2) position (m) of its first end if that is fixed, otherwise 0.
        squares: (m,) squares of their lengths (m²).
        masses: What the mass matrix is made of, see `Masses`.
        points: (p,) names of the points.
        links: (m,) kind and name of the links.
    """

    u0: Array
    v0: Array
    starts: IndexArray
    ends: IndexArray
    anchors: Array
    squares: Array
    masses: "Masses"
    points: Sequence[str]
    links: Sequence[tuple[str, str]]

    def problem(self, name: str, drawing: Callable[[], Any]) -> Problem:
        """The problem of this name.

        Args:
            name: Name of the problem.
            drawing: Makes what figures of it are drawn from.
        """
        # Loads it, and with it what compiles.
        from newmark_cli.mechanisms import elements

        ints, reals = self._tables(elements)
        loads = self.masses.loads(len(self.u0) // 2)
        loaded = np.flatnonzero(loads.any(axis=1))
        load_ints = np.zeros((len(loaded), elements.INT_COLUMNS), np.int64)
        load_ints[:, elements.KIND], load_ints[:, elements.COUNT] = elements.LOAD, 1
        load_ints[:, elements.DOF] = 2 * loaded
        load_reals = np.zeros((len(loaded), elements.REAL_COLUMNS))
        load_reals[:, elements.PARAMETER : elements.PARAMETER + 2] = loads[loaded]
        (mass_rows, mass_columns), mass_values = self.masses.entries(len(self.u0))
        (x_rows, x_columns), (g_rows, g_columns) = self._x_places(), self._g_places()
        nowhere = np.zeros(0, np.int64)
        return Problem(
            name=name,
            u0=self.u0,
            v0=self.v0,
            t0=0.0,
            constraints=len(self.ends),
            function=elements.evaluate,
            elements=Elements(elements.accumulate, np.arange(len(ints) + len(load_ints))),
            derivatives=elements.constraint_derivatives,
            ints=np.concatenate([ints, load_ints]),
            reals=np.concatenate([reals, load_reals]),
            pattern=Pattern(
                mass_rows, mass_columns, x_rows, x_columns, nowhere, nowhere, g_rows, g_columns
            ),
            mass_values=mass_values,
            drawing_given=drawing,
            points_given=self.points,
            quadratic=True,
            single=True,
            potential=elements.potential,
            constraints_given=self.links,
        )

    def _tables(self, elements: Any) -> tuple[IndexArray, Array]:
        """Rows of the links in both tables."""
        m, both = len(self.ends), self.starts >= 0
        count = 1 + both
        ints = np.zeros((m, elements.INT_COLUMNS), np.int64)
        ints[:, elements.KIND], ints[:, elements.COUNT] = elements.LINK, count
        ints[:, elements.DOF] = 2 * np.where(both, self.starts, self.ends)
        ints[both, elements.DOF + 1] = 2 * self.ends[both]
        ints[:, elements.ROW] = np.arange(m)
        # What the links before it have taken.
        ints[1:, elements.X_START] = np.cumsum(2 * count[:-1] ** 2)
        ints[1:, elements.G_START] = np.cumsum(2 * count[:-1])
        reals = np.zeros((m, elements.REAL_COLUMNS))
        reals[:, 0] = np.where(both, -1.0, 1.0)
        reals[both, 2] = 1.0
        reals[:, elements.OFFSET : elements.OFFSET + 2] = 0.0 - self.anchors
        reals[:, elements.PARAMETER] = self.squares
        return ints, reals

    def _coordinates(self) -> tuple[IndexArray, Any]:
        """(m, 2, 2) coordinates of both ends, and (m, 2) whether an end has any."""
        points = np.stack([self.starts, self.ends], axis=1)
        return 2 * points[:, :, None] + np.arange(2), points >= 0

    def _x_places(self) -> tuple[IndexArray, IndexArray]:
        """Rows and columns of the entries of X: for each two ends a multiple of identity."""
        places, moves = self._coordinates()
        shape = (len(self.ends), 2, 2, 2)
        taken = moves[:, :, None] & moves[:, None, :]
        rows = np.broadcast_to(places[:, :, None, :], shape)[taken]
        columns = np.broadcast_to(places[:, None, :, :], shape)[taken]
        return rows.reshape(-1), columns.reshape(-1)

    def _g_places(self) -> tuple[IndexArray, IndexArray]:
        """Coordinates and constraints of the entries of G."""
        places, moves = self._coordinates()
        links = np.broadcast_to(np.arange(len(self.ends))[:, None, None], places.shape)
        return places[moves].reshape(-1), links[moves].reshape(-1)


@dataclass(frozen=True, eq=False)
class Masses:
    """2×2 blocks of M that are multiples of the identity, and what they weigh.

    Attributes:
        rows, columns: (k,) moving points of each block; −1 for a fixed one, whose blocks
            count as far as they are loads on others.
        values: (k,) the multiples (kg).
        weights: (k, 2) share of each in the loads (N).
    """

    rows: IndexArray
    columns: IndexArray
    values: Array
    weights: Array

    def loads(self, points: int) -> Array:
        """(points, 2) constant force on each point (N)."""
        on = self.rows >= 0
        # `bincount` adds in the order given.
        sums = [np.bincount(self.rows[on], share[on], points) for share in self.weights.T]
        return np.stack(sums, axis=1)

    def entries(self, n: int) -> tuple[tuple[IndexArray, IndexArray], Array]:
        """Rows and columns of the entries of M, sorted, and their values."""
        on = (self.rows >= 0) & (self.columns >= 0) & (self.values != 0)
        rows, columns = (2 * of[on][:, None] + np.arange(2) for of in (self.rows, self.columns))
        places, slots = np.unique((rows * n + columns).reshape(-1), return_inverse=True)
        values = np.bincount(slots.reshape(-1), np.repeat(self.values[on], 2), len(places))
        return (places // n, places % n), np.asarray(values, float)
