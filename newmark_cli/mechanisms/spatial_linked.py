"""Bars on spherical joints as arrays: what `spatial.build` makes of them, at any size.

`spatial` looks at a mechanism part by part, because it is somebody's file and may be wrong in
every part.  A member of a family is right by construction.  Here its tables are made with a
few NumPy operations, equal to those of `spatial` to the last bit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from newmark_cli.problems.algebra import product
from newmark_cli.problems.problem import Pattern, Problem
from newmark_cli.support.arrays import Array, IndexArray

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
        from newmark_cli.mechanisms import spatial
        from newmark_cli.mechanisms import spatial_elements as elements
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
        weights, bodies, offsets = _terms(sides)
        loads = np.outer(inertia[0], np.array(GRAVITY))
        ints, reals = _tables(elements, bars, weights, bodies, offsets, loads)
        x = _body_places(np.array(spatial.BODY_X), bars)
        g = _body_places(np.array(spatial.BODY_G), bars, _INTERNAL)
        g = np.concatenate([g, _joint_places(bars, weights, bodies)], axis=1)
        mass_rows, mass_columns = np.nonzero(inertia)
        within = np.concatenate([3 * np.array([mass_rows, mass_columns]) + c for c in range(3)], 1)
        masses = np.tile(inertia[mass_rows, mass_columns], 3 * bars)
        in_bar = (_PER_BODY * np.arange(bars)[:, None, None] + within[None]).transpose(1, 0, 2)
        nowhere = np.zeros(0, np.int64)
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
            function=elements.evaluate,
            derivatives=elements.constraint_derivatives,
            ints=ints,
            reals=reals,
            pattern=Pattern(
                in_bar[0].reshape(-1),
                in_bar[1].reshape(-1),
                x[0],
                x[1],
                nowhere,
                nowhere,
                g[0],
                g[1],
            ),
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
            potential=elements.potential,
            constraints_given=(
                *((bar, row) for bar in self.names for row in spatial.INTERNAL),
                *((joint, row) for joint in self.joints for row in "xyz"),
            ),
            outputs=outputs,
        )


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


def _tables(
    elements: Any, bars: int, weights: Array, bodies: IndexArray, offsets: Array, loads: Array
) -> tuple[IndexArray, Array]:
    """Rows of bodies, of joints with their terms, and of loads in both tables."""
    of_bars = np.zeros((bars, elements.INT_COLUMNS), np.int64)
    each = np.arange(bars)
    of_bars[:, elements.KIND] = elements.BODY
    of_bars[:, elements.FIRST] = _PER_BODY * each + 3
    of_bars[:, elements.X_START], of_bars[:, elements.G_START] = 27 * each, 27 * each
    of_bars[:, elements.ROW : elements.ROW + 3] = _INTERNAL * each[:, None] + np.arange(3)

    there = ~np.isnan(weights)
    counts = there.sum(axis=(1, 2))
    heads = np.arange(len(counts)) + np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
    of_joints = np.zeros((len(counts) + int(counts.sum()), elements.INT_COLUMNS), np.int64)
    of_joints[heads, elements.KIND], of_joints[heads, elements.FIRST] = elements.POINT, counts
    of_joints[heads, elements.X_START] = 27 * bars
    of_joints[heads, elements.G_START] = 27 * bars + 3 * (np.cumsum(counts) - counts)
    first = _INTERNAL * bars + 3 * np.arange(len(counts))
    of_joints[heads, elements.ROW : elements.ROW + 3] = first[:, None] + np.arange(3)
    values = np.zeros((len(of_joints), elements.REAL_COLUMNS))
    values[heads, elements.OFFSET : elements.OFFSET + 3] = offsets
    terms = np.setdiff1d(np.arange(len(of_joints)), heads)
    places = _PER_BODY * bodies[:, :, None] + 3 * np.arange(4)
    of_joints[terms, elements.KIND] = elements.TERM
    of_joints[terms, elements.FIRST] = places[there]
    values[terms, 0] = weights[there]

    pulled = np.flatnonzero(np.any(loads != 0, axis=1))
    of_loads = np.zeros((bars * len(pulled), elements.INT_COLUMNS), np.int64)
    of_loads[:, elements.KIND] = elements.LOAD
    of_loads[:, elements.FIRST] = (_PER_BODY * each[:, None] + 3 * pulled).reshape(-1)
    of_loads[:, elements.X_START] = 27 * bars
    of_loads[:, elements.G_START] = 27 * bars + 3 * int(counts.sum())
    forces = np.zeros((len(of_loads), elements.REAL_COLUMNS))
    forces[:, :3] = np.tile(loads[pulled], (bars, 1))
    none = np.zeros((bars, elements.REAL_COLUMNS))
    return np.concatenate([of_bars, of_joints, of_loads]), np.concatenate([none, values, forces])


def _body_places(entries: IndexArray, bars: int, rows: int = _PER_BODY) -> IndexArray:
    """(2, entries of all bars) of X, or of G whose second places are rows."""
    each = np.arange(bars)[:, None]
    first = _PER_BODY * each + 3 + entries[:, 0]
    second = rows * each + entries[:, 1] + (3 if rows == _PER_BODY else 0)
    return np.stack([first.reshape(-1), second.reshape(-1)]).astype(np.int64)


def _joint_places(bars: int, weights: Array, bodies: IndexArray) -> IndexArray:
    """(2, entries of all joints) of G: each row of a joint has all its terms."""
    there = ~np.isnan(weights)
    shape = (len(weights), 3, 2, 4)
    taken = np.broadcast_to(there[:, None], shape)
    places = (_PER_BODY * bodies[:, :, None] + 3 * np.arange(4))[:, None]
    rows = _INTERNAL * bars + 3 * np.arange(len(weights))[:, None] + np.arange(3)
    first = np.broadcast_to(places + np.arange(3)[:, None, None], shape)[taken]
    second = np.broadcast_to(rows[:, :, None, None], shape)[taken]
    return np.stack([first, second]).astype(np.int64)
