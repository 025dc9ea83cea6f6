"""Outputs of a spatial mechanism: angular velocities, angles, reactions.

With f the force of a joint's constraints on the coordinates of a body, f = Σ λ_k ∂Φ_k/∂u,

    force R = f_φ,        moment about r:  Σ_i d_i × f_{d_i} + (φ − r) × R.

Neither depends on how constraints are scaled, nor on the directions p and q of a joint.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.problems.algebra import product
from newmark_cli.problems.problem import Place, Problem, said
from newmark_cli.support.arrays import Array


def angular_velocities(directors: Array, rates: Array) -> Array:
    """(bodies, 3) ω = ½ Σ d_i × d_i′ (rad/s, global) of (bodies, 3, 3) directors and rates."""
    return np.asarray(np.cross(directors, rates).sum(axis=-2) / 2)


@dataclass(frozen=True, eq=False)
class Side:
    """A joint's frame on one of its bodies.

    Attributes:
        body: Number of the body; −1 for the ground.
        point: (3,) its point, in body axes.
        vectors: Its directions by the name that `joints` gives them, in body axes.
    """

    body: int
    point: Array
    vectors: Mapping[str, Array]

    def place(self, bodies: Array) -> Array:
        """(3,) its point, of the origins and directors (bodies, 4, 3) of a position."""
        if self.body < 0:
            return self.point
        return np.asarray(bodies[self.body, 0] + product(self.point, bodies[self.body, 1:]))

    def direction(self, name: str, bodies: Array) -> Array:
        """(3,) one of its directions, in global axes."""
        vector = self.vectors[name]
        return vector if self.body < 0 else product(vector, bodies[self.body, 1:])


@dataclass(frozen=True, eq=False)
class Connection:
    """A joint as it was built."""

    kind: str
    sides: tuple[Side, Side]

    def angle(self, bodies: Array) -> float:
        """Angle of the second body about the axis, 0 at the start, between −π and π."""
        first, second = self.sides
        p = second.direction("p", bodies)
        sine, cosine = (float(product(first.direction(name, bodies), p)) for name in ("q", "p"))
        return float(np.arctan2(sine, cosine))

    def distance(self, bodies: Array) -> float:
        """How far the second body has slid along the axis (m)."""
        first, second = self.sides
        apart = second.place(bodies) - first.place(bodies)
        return float(product(first.direction("n", bodies), apart))


@dataclass(frozen=True, eq=False)
class SpatialOutputs:
    """Outputs of a spatial mechanism, in the order of its bodies and joints.

    Angular velocities ``rod.omega.x`` (rad/s, global), and of each joint ``A.angle`` (rad)
    or ``A.distance`` (m) where it has one, ``A.force.x`` (N) and, where its constraints are
    more than places, ``A.moment.x`` (N m), in global axes, on the body that it goes to,
    about its point there.

    Attributes:
        bodies: Names of the bodies.
        joints: Joints by name.
        rows: (m,) joint of each constraint; no joint's name for others.
        shared: Joints with a share in what is redundant: their reactions are not unique.
        places: Points of which the file asks for the places ``C.x`` (m), by name.
    """

    bodies: tuple[str, ...]
    joints: Mapping[str, Connection]
    rows: tuple[str, ...]
    shared: frozenset[str] = frozenset()
    places: Mapping[str, Place] = field(default_factory=dict)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All different."""
        return tuple(map(".".join, self._named))

    @cached_property
    def not_unique(self) -> tuple[str, ...]:
        """Names of the outputs that depend on which redundant constraints were dropped."""
        reactions = [parts for parts in self._named if parts[1] in ("force", "moment")]
        return tuple(".".join(parts) for parts in reactions if parts[0] in self.shared)

    @cached_property
    def _named(self) -> list[tuple[str, ...]]:
        """Body or joint, quantity, and axis of a vector."""
        found: list[tuple[str, ...]]
        found = [(body, "omega", axis) for body in self.bodies for axis in "xyz"]
        for name, joint in self.joints.items():
            kind = JOINTS[joint.kind]
            found += [(name, "angle")] * kind.turns + [(name, "distance")] * kind.slides
            vectors = ["force"] + ["moment"] * bool(kind.dots)
            found += [(name, vector, axis) for vector in vectors for axis in "xyz"]
        return found + [(name, axis) for name in self.places for axis in "xyz"]

    @property
    def content(self) -> str:
        """What the numbers depend on besides those of the problem."""
        return said(self.places)

    def values(self, problem: Problem, t: float, u: Array, v: Array, multipliers: Array) -> Array:
        """(k,) outputs at one state: t (s), u and v (n,), λ (m,)."""
        bodies, rates = u.reshape(-1, 4, 3), v.reshape(-1, 4, 3)
        outputs = angular_velocities(bodies[:, 1:], rates[:, 1:]).ravel().tolist()
        pushed = self._pushed(problem, t, u, multipliers)
        for i, joint in enumerate(self.joints.values()):
            kind = JOINTS[joint.kind]
            if kind.turns:
                outputs.append(joint.angle(bodies))
            if kind.slides:
                outputs.append(joint.distance(bodies))
            force, moment = self._reaction(joint, pushed[i], bodies)
            outputs += force.tolist()
            if kind.dots:
                outputs += moment.tolist()
        for place in self.places.values():
            outputs += place.at(u).tolist()
        return np.array(outputs)

    def length(self, u: Array) -> float:
        """Largest distance of an origin or a joint from their middle (m)."""
        bodies = u.reshape(-1, 4, 3)
        places = [side.place(bodies) for joint in self.joints.values() for side in joint.sides]
        every = np.array([*bodies[:, 0], *places])
        return float(np.linalg.norm(every - every.mean(axis=0), axis=1).max())

    def _pushed(self, problem: Problem, t: float, u: Array, multipliers: Array) -> Array:
        """(joints, 2, 4, 3) force of each joint on the vectors of both bodies."""
        pattern = problem.pattern
        gradient = problem.values(t, u, np.zeros(problem.n), np.zeros(problem.m)).g
        pushes = gradient * multipliers[pattern.g_columns]
        numbers = {name: i for i, name in enumerate(self.joints)}
        owners = np.array([numbers.get(joint, len(numbers)) for joint in self.rows], np.int64)
        owner = owners[pattern.g_columns]  # one past the last for rows of no joint
        sides = np.array(
            [[side.body for side in joint.sides] for joint in self.joints.values()] + [[-1, -1]]
        )
        body = pattern.g_rows // 12
        forces = np.zeros((len(self.joints) + 1, 2, 12))
        for k in range(2):
            here = sides[owner, k] == body
            np.add.at(forces, (owner[here], k, pattern.g_rows[here] % 12), pushes[here])
        return forces.reshape(-1, 2, 4, 3)

    @staticmethod
    def _reaction(joint: Connection, pushed: Array, bodies: Array) -> tuple[Array, Array]:
        """Force on the second body of a joint, and the moment about its point."""
        about = joint.sides[1].place(bodies)
        # The ground has no coordinates: its reaction is that of the other body, reversed.
        k, sign = (1, 1.0) if joint.sides[1].body >= 0 else (0, -1.0)
        body, force = bodies[joint.sides[k].body], pushed[k, 0]
        moment = np.cross(body[1:], pushed[k, 1:]).sum(axis=0) + np.cross(body[0] - about, force)
        return sign * force, sign * moment
