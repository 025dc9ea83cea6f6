"""Links in the plane and bars in space as arrays: what builders make, at any size.

A builder looks at a mechanism part by part, because it is somebody's file and may be wrong
in every part.  A member of a family is right by construction and may have a million parts.
Here its elements are arrays from the beginning, equal to those of the builder to the last
bit: sums run in the same order.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

import numpy as np

from newmark_cli.problems.algebra import product
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray

if TYPE_CHECKING:
    from newmark_cli.mechanisms import table

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


#: Coordinates and internal constraints of a body.
_PER_BODY, _INTERNAL = 12, 6
#: Mass (kg) and edges (m) of every bar.
MASS, BOX = 1.0, (1.0, 0.2, 0.1)
GRAVITY = (0.0, 0.0, -1.0)


@dataclass(frozen=True, eq=False)
class Bars:
    """Equal homogeneous bars, and the spherical joints between them; all at rest.

    Attributes:
        title: One line.
        names: (b,) of the bars.
        places: (b,) centres (m).
        along: (k,) directions of bars, and one across each.
        kinds: (b,) which of these directions a bar has.
        joints: (j,) names of the joints.
        starts, ends: (j,) bars that each goes from and to; −1 for the ground.
        at: (j,) where each is (m).
    """

    title: str
    names: Sequence[str]
    places: Sequence[tuple[float, float, float]]
    along: Sequence[tuple[tuple[float, float, float], tuple[float, float, float]]]
    kinds: Sequence[int]
    joints: Sequence[str]
    starts: Sequence[int]
    ends: Sequence[int]
    at: Sequence[tuple[float, float, float]]

    def data(self) -> dict[str, Any]:
        """The mechanism as a file would have it."""
        bodies = {
            name: {
                "position": place,
                "axes": {"x": self.along[kind][0], "y": self.along[kind][1]},
                "mass": MASS,
                "box": BOX,
            }
            for name, place, kind in zip(self.names, self.places, self.kinds, strict=True)
        }
        called = ("ground", *self.names)
        joints = {
            name: {"type": "spherical", "from": called[a + 1], "to": called[b + 1], "at": at}
            for name, a, b, at in zip(self.joints, self.starts, self.ends, self.at, strict=True)
        }
        return {
            "title": self.title, "dimensions": 3, "bodies": bodies, "joints": joints,
            "gravity": GRAVITY,
        }  # fmt: skip

    def problem(self, name: str, drawing: Callable[[], Any]) -> Problem:
        """The problem of this name.

        Args:
            name: Name of the problem.
            drawing: Makes what figures of it are drawn from.
        """
        # Loads it, and with it what compiles.
        from newmark_cli.mechanisms import spatial, table
        from newmark_cli.mechanisms.spatial_model import SpatialMechanism
        from newmark_cli.mechanisms.spatial_outputs import Connection, Side, SpatialOutputs

        model = SpatialMechanism.model_validate(
            {
                "dimensions": 3,
                "bodies": {
                    str(k): {
                        "position": (0.0, 0.0, 0.0),
                        "axes": {"x": x, "y": y},
                        "mass": MASS,
                        "box": BOX,
                    }
                    for k, (x, y) in enumerate(self.along)
                },
                "gravity": GRAVITY,
            }
        )
        kinds = list(model.bodies.values())
        frames = [body.directors for body in kinds]
        inertia = spatial.mass_of(kinds[0])
        bars, count = len(self.names), len(self.joints)
        n, m = _PER_BODY * bars, _INTERNAL * bars + 3 * count
        places = [np.array(place) for place in self.places]

        # One by one: sums of a few numbers, in the order in which `spatial` has them.
        def side(body: int, place: Array) -> Side:
            point = place if body < 0 else product(frames[self.kinds[body]].T, place - places[body])
            return Side(body, point, {})

        sides = [
            (side(a, np.array(at)), side(b, np.array(at)))
            for a, b, at in zip(self.starts, self.ends, self.at, strict=True)
        ]
        loads = np.outer(inertia[0], np.array(GRAVITY))
        pulled = np.flatnonzero(np.any(loads != 0, axis=1))
        at = _PER_BODY * np.arange(bars)[:, None] + 3 * pulled
        tables = table.tables(
            [
                *_rigid(bars),
                *_joined(bars, *_terms(sides)),
                table.loads(
                    m + np.arange(at.size), at.reshape(-1), np.tile(loads[pulled], (bars, 1))
                ),
            ]
        )
        mass_rows, mass_columns = np.nonzero(inertia)
        within = np.concatenate([3 * np.array([mass_rows, mass_columns]) + c for c in range(3)], 1)
        masses = np.tile(inertia[mass_rows, mass_columns], 3 * bars)
        in_bar = (_PER_BODY * np.arange(bars)[:, None, None] + within[None]).transpose(1, 0, 2)
        directors = np.array([frame.T.ravel() for frame in frames])
        still = np.array(
            [
                product(frame.T, spatial.turning_rate(body).T).ravel()
                for body, frame in zip(kinds, frames, strict=True)
            ]
        )
        chosen = np.array(self.kinds)
        origins = np.array(self.places, float)
        outputs = SpatialOutputs(
            tuple(self.names),
            {
                joint: Connection("spherical", both)
                for joint, both in zip(self.joints, sides, strict=True)
            },
            (
                *([""] * (_INTERNAL * bars)),
                *(joint for joint in self.joints for _ in "xyz"),
            ),
        )
        return Problem(
            name=name,
            u0=np.concatenate([origins, directors[chosen]], axis=1).reshape(-1),
            v0=np.concatenate([0.0 * np.abs(origins), still[chosen]], axis=1).reshape(-1),
            t0=0.0,
            constraints=m,
            **tables.functions(conservative=True),
            pattern=tables.pattern(in_bar.reshape(2, -1)),
            mass_values=masses,
            drawing_given=lambda: spatial.SpatialModel(
                drawing(),
                tuple(self.names),
                outputs.joints,
                {},
                freedom=n - m,
                mass_rank=n,
            ),
            points_given=tuple(f"{bar}.{part}" for bar in self.names for part in spatial.VECTORS),
            axes="xyz",
            quadratic=True,
            single=True,
            constraints_given=(
                *((bar, row) for bar in self.names for row in spatial.INTERNAL),
                *((joint, row) for joint in self.joints for row in "xyz"),
            ),
            outputs=outputs,
        )


def _rigid(bars: int) -> "Iterator[table.Group]":
    """What keeps bars rigid: products of their directors."""
    from newmark_cli.mechanisms import elements, spatial, table

    first = _PER_BODY * np.arange(bars)[:, None] + 3
    for k, (i, j) in enumerate(spatial.DIRECTORS):
        rows = _INTERNAL * np.arange(bars) + k
        if i == j:
            shape, places = table.Shape(elements.SQUARE, 3, False, 3, 1, 1, 0, 0), [3 * i]
            reals = [0.0, 0.0, 0.0, 1.0, 1.0]
        else:
            shape, places = table.Shape(elements.PRODUCT, 3, False, 6, 0, 1, 1, 0), [3 * i, 3 * j]
            reals = [*[0.0] * 6, 1.0, 1.0]
        yield table.Group(shape, rows, rows, first + places, np.tile(reals, (bars, 1)))


def _joined(
    bars: int, weights: Array, bodies: IndexArray, offsets: Array
) -> "Iterator[table.Group]":
    """Rows of joints, by how many terms they have."""
    from newmark_cli.mechanisms import elements, table

    weights, there = weights.reshape(len(weights), -1), ~np.isnan(weights.reshape(len(weights), -1))
    places = (_PER_BODY * bodies[:, :, None] + 3 * np.arange(4)).reshape(len(bodies), -1)
    counts = there.sum(axis=1)
    for count in np.unique(counts).tolist():
        joints = np.flatnonzero(counts == count)
        at = places[joints][there[joints]].reshape(-1, count)
        w = weights[joints][there[joints]].reshape(-1, count)
        shape = table.Shape(elements.PRODUCT, 0, False, 0, 1, 0, 0, count)
        for c in range(3):
            rows = _INTERNAL * bars + 3 * joints + c
            reals = np.hstack([0.0 - offsets[joints, c, None], w])
            yield table.Group(shape, rows, rows, at + c, reals)


def _terms(sides: Sequence[tuple[Any, Any]]) -> tuple[Array, IndexArray, Array]:
    """Of each joint: (j, 2, 4) weights, of `to` and then of `from` reversed; NaN for none.

    Further (j, 2) the bodies, and (j, 3) what is constant.
    """
    weights = np.full((len(sides), 2, 4), np.nan)
    bodies = np.full((len(sides), 2), -1, np.int64)
    offsets = np.zeros((len(sides), 3))
    for k, (first, second) in enumerate(sides):
        for i, (side, sign) in enumerate(((second, 1.0), (first, -1.0))):
            bodies[k, i] = side.body
            if side.body < 0:
                offsets[k] = offsets[k] - side.point
            else:
                weights[k, i, 0] = sign
                weights[k, i, 1:] = np.where(side.point != 0, sign * side.point, np.nan)
    return weights, bodies, offsets
