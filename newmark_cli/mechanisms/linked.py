"""Links in the plane as arrays: what builders make, at any size.

A builder looks at a mechanism part by part, because it is somebody's file and may be wrong
in every part.  A member of a family is right by construction and may have a million parts.
Here its elements are arrays from the beginning, equal to those of the builder to the last
bit: sums run in the same order.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, overload

import numpy as np

from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class Made(Sequence[_Item], Generic[_Item]):
    """A sequence whose items are made when they are asked for."""

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
        """The problem of this name; ``drawing`` makes what figures of it are drawn from."""
        # Loads it, and with it what compiles.
        from newmark_cli.mechanisms import elements, table

        m = len(self.ends)
        loads = self.masses.loads(len(self.u0) // 2)
        loaded = np.flatnonzero(loads.any(axis=1))
        groups = [table.loads(m + np.arange(len(loaded)), 2 * loaded, loads[loaded])]
        for both in (False, True):
            links = np.flatnonzero((self.starts >= 0) == both)
            shape = table.Shape(elements.LINK, 2, False, 2, 1, 1 + both, 0, 0)
            points = np.stack([self.starts, self.ends][not both :], axis=1)[links]
            weights = np.tile([-1.0, 1.0][not both :], (len(links), 1))
            numbers = 0.0 - self.anchors[links], self.squares[links, None], weights
            groups.append(table.Group(shape, links, links, 2 * points, np.hstack(numbers)))
        tables = table.tables(groups)
        mass_places, mass_values = self.masses.entries(len(self.u0))
        return Problem(
            name=name,
            u0=self.u0,
            v0=self.v0,
            t0=0.0,
            constraints=m,
            **tables.functions(conservative=True),
            pattern=tables.pattern(np.stack(mass_places)),
            mass_values=mass_values,
            drawing_given=drawing,
            points_given=self.points,
            quadratic=True,
            single=True,
            constraints_given=self.links,
        )


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
