"""Spatial mechanisms: the tables of the element loop from a mechanism's data.

A rigid body is the position of a point and three directors (Betsch and Steinmann): twelve
coordinates, a constant mass matrix, and constraints that are at most quadratic.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from newmark_cli.mechanisms import builder, laws, spatial_model
from newmark_cli.mechanisms.builder import MISFIT, Row, Sum
from newmark_cli.mechanisms.element_tables import Term
from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.mechanisms.models import GROUND, Law, amounts_of, laws_of
from newmark_cli.mechanisms.spatial_model import SpatialMechanism, directors, inertias, inner, unit
from newmark_cli.mechanisms.spatial_outputs import Connection, Side, SpatialOutputs
from newmark_cli.problems.algebra import norm, product
from newmark_cli.problems.problem import Place
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import KeyPath

#: Coordinates of a body.
PER_BODY = 12
#: How far from parallel axes that are given by body may be at the start.
_ASKEW = 1e-9

#: What keeps a body rigid: products of these directors.
DIRECTORS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


#: Least size of a direction's part, relative to the largest, that words mention.
_SEEN = 1e-6


class SpatialBuilder(builder.Builder):
    """Turns a mechanism in space into the tables of the element loop.

    Attributes:
        made: Joints that were built.
    """

    model = SpatialMechanism
    parts = (
        "points", "body_points", "bodies", "joints", "motions", "forces", "springs", "dampers",
        "torques", "torsion_springs", "torsion_dampers",
    )  # fmt: skip
    components = 3
    mechanism: SpatialMechanism

    def prepare(self) -> None:
        """Bodies: where they start, what keeps them rigid, and masses with those of points."""
        bodies = self.mechanism.bodies
        self.made: dict[str, Connection] = {}
        self.numbers = {body: i for i, body in enumerate(bodies)}
        self.start = np.empty((len(bodies), 4, 3))
        self.start[:, 0] = [body.position for body in bodies.values()]
        self.start[:, 1:] = directors(bodies.values())
        self.sites: dict[str, Side] = {}
        self.size = max(1.0, float(np.abs(self.start[:, 0]).max()))
        self.inertia = inertias(self.mechanism)
        self.loads = (0.0 + self.inertia[:, 0, :, None] * self.mechanism.gravity).reshape(-1, 3)

    # -- what it is asked for ------------------------------------------------------------------

    def weigh(self) -> None:
        """M = S ⊗ 1."""
        if not self.inertia.any():
            raise self.document.error(("bodies",), "no body has mass")
        every = np.repeat(self.inertia[:, None], 3, axis=1)
        body, c, row, column = np.nonzero(every)
        places = PER_BODY * body + 3 * np.stack([row, column]) + c
        self.mass = places, every[body, c, row, column]

    def described(self, kept: Sequence[int], shared: frozenset[str]) -> Mapping[str, Any]:
        """Its bodies, joints and points."""
        names = tuple(self.numbers)
        owners = tuple(self.rows[row].owner for row in kept)
        places = {name: self._point_of(side) for name, side in self.sites.items()}
        return {
            "points_given": tuple(f"{body}.{vector}" for body in names for vector in VECTORS),
            "axes": "xyz",
            "outputs": SpatialOutputs(names, self.made, owners, shared, self.wanted(places)),
            "places": places,
        }

    @staticmethod
    def _point_of(side: Side) -> Place:
        if side.body < 0:
            return Place(np.zeros(0, np.int64), np.zeros((3, 0)), side.point)
        coordinates = PER_BODY * side.body + np.arange(PER_BODY)
        return Place(coordinates, np.kron([1.0, *side.point], np.eye(3)), np.zeros(3))

    def rates(self, u: Array) -> Iterator[tuple[KeyPath, Array, float]]:
        """Key, gradient (n,) at a position (n,), and value of each rate that the file gives.

        Raises:
            DocumentError: When a joint has no such rate.
        """
        for name, value in self.mechanism.rates.items():
            path: KeyPath = ("rates", name)
            joint = self.joint(name, path)
            kind = JOINTS[joint.kind]
            has = ["angle"] * kind.turns + ["distance"] * kind.slides
            wanted = dict.fromkeys(has, value) if isinstance(value, float) else value.rates
            if not has or not set(wanted) <= set(has):
                what = " and ".join(has) or "no single rate; give its bodies 'angular_velocity'"
                raise self.document.error(path, f"a {joint.kind} joint has {what}")
            if isinstance(value, float) and len(has) > 1:
                raise self.document.error(
                    path, f"a {joint.kind} joint has two rates; give {{angle: …, distance: …}}"
                )
            for key, rate in wanted.items():
                yield path, self._rate_gradient(joint, key, u.reshape(-1, 4, 3)), rate

    # -- points and bodies -----------------------------------------------------------------------

    def _points(self, point: spatial_model.SpatialPoint, path: KeyPath) -> None:
        self.sites[str(path[1])] = Side(-1, np.array(point.fixed), {})

    def _body_points(self, point: spatial_model.SpatialBodyPoint, path: KeyPath) -> None:
        if path[1] in self.mechanism.points:
            raise self.document.error(path, f"there is a point {path[1]} of the ground, too")
        body = self.body(point.on, (*path, "on"))
        self.sites[str(path[1])] = Side(body, np.array(point.at), {})

    def _bodies(self, body: spatial_model.SpatialBody, path: KeyPath) -> None:
        """Rows of a body."""
        if path[1] == GROUND:
            message = "'ground' is what bodies stand on; give this body another name"
            raise self.document.error(path, message)
        first = PER_BODY * self.numbers[str(path[1])] + 3
        sums = [Sum((0.0,) * 3, [(first + 3 * i, 1.0)]) for i in range(3)]
        for i, j in DIRECTORS:
            row = len(self.rows)
            self.rows.append(Row(path, "", f"d{i + 1}·d{j + 1}"))
            if i == j:
                self.add("SQUARE", sums[i], row=row, parameters=(1.0,))
            else:
                self.add("PRODUCT", sums[i], sums[j], row=row)

    # -- references ----------------------------------------------------------------------------

    def body(self, name: str, path: KeyPath) -> int:
        """Number of a body."""
        return self.known("bodies", name, path, self.numbers)

    def body_or_ground(self, name: str, path: KeyPath) -> int:
        """Number of a body, or −1."""
        return -1 if name == GROUND else self.known("bodies", name, path, self.numbers, [GROUND])

    def joint(self, name: str, path: KeyPath) -> Connection:
        """A joint, which was built."""
        return self.known("joints", name, path, self.made)

    def site(self, name: str, path: KeyPath) -> Side:
        """A point."""
        return self.known("points", name, path, self.sites)

    def of_body(self, name: str, path: KeyPath) -> Side:
        """A point of a body, or the origin of one."""
        if name in self.numbers and name not in self.sites:
            return Side(self.numbers[name], np.zeros(3), {})
        side = self.known("points", name, path, self.sites, self.numbers)
        if side.body < 0:
            raise self.document.error(path, f"{name} is a point of the ground")
        return side

    def between(self, start: str, end: str, path: KeyPath) -> Sum:
        """The vector from one point to another, which it moves relative to."""
        first, second = self.both(self.site, start, end, path)
        if first.body == second.body:
            message = f"joins {start} and {end}, which cannot move relative to each other"
            raise self.document.error(path, message)
        apart = np.linalg.norm(self._place(second) - self._place(first))
        if not self.mechanism.assemble and apart <= MISFIT * self.size:
            raise self.document.error(
                path, f"{start} and {end} start in one place: their line has no direction"
            )
        return _minus(_site(second), _site(first))

    # -- geometry at the start -----------------------------------------------------------------

    def _place(self, side: Side) -> Array:
        return side.place(self.start)

    def _turned(self, body: int, vector: Array) -> Array:
        """(3,) a body vector in global axes."""
        return vector if body < 0 else inner(vector, self.start[body, 1:].T)

    def _seen(self, body: int, vector: Array) -> Array:
        """(3,) a global vector in body axes."""
        return vector if body < 0 else inner(self.start[body, 1:], vector)

    def _at(self, body: int, place: Array) -> Array:
        """(3,) a global place in body coordinates."""
        return place if body < 0 else self._seen(body, place - self.start[body, 0])

    # -- joints --------------------------------------------------------------------------------

    def _joints(self, joint: spatial_model.SpatialJoint, path: KeyPath) -> None:
        kind, name = JOINTS[joint.type], str(path[1])
        a, b = self._sides(joint, path)
        length = self._joined(joint, a, b, path)
        self.made[name] = Connection(joint.type, (a, b))
        row = len(self.rows)
        self.rows += [Row(path, name, of) for of in kind.rows]
        between = _minus(_site(b), _site(a))
        if kind.meets:
            for c in range(3):
                single = [(place + c, weight) for place, weight in between.terms]
                offset = 0.0 - between.constant[c]
                self.add("PRODUCT", row=row + c, single=single, parameters=(offset,))
        for k, dot in enumerate(kind.dots, row + 3 * kind.meets):
            other = between if dot.of_points else _direction(b, dot.second)
            self.add("PRODUCT", _direction(a, dot.first), other, row=k)
        if kind.length:
            row = len(self.rows) - 1
            self.squares[row] = length * length
            self.add("SQUARE", between, row=row, parameters=(length * length,))

    def _sides(self, joint: spatial_model.SpatialJoint, path: KeyPath) -> tuple[Side, Side]:
        """Frames of a joint on both bodies."""
        kind, names = JOINTS[joint.type], (joint.from_, joint.to)
        numbers = self.both(self.body_or_ground, *names, path)
        points = [
            np.array(joint.at[end])
            if isinstance(joint.at, dict)
            else self._at(body, np.array(joint.at))
            for end, body in zip(names, numbers, strict=True)
        ]
        vectors: list[dict[str, Array]] = [{}, {}]
        if kind.axes == 1:
            vectors = self._about(joint, *numbers, path)
        elif kind.axes == 2:
            vectors = self._crossed(joint, *numbers, path)
        elif kind.dots:
            vectors = [
                {f"e{i + 1}": self._seen(body, axis) for i, axis in enumerate(np.eye(3))}
                for body in numbers
            ]
        first, second = map(Side, numbers, points, vectors)
        return first, second

    def _joined(self, joint: spatial_model.SpatialJoint, a: Side, b: Side, path: KeyPath) -> float:
        """Length that a joint keeps, or 0; requires its points to start where they should."""
        kind = JOINTS[joint.type]
        if not (kind.length or isinstance(joint.at, dict)):
            return 0.0
        apart = self._place(b) - self._place(a)
        if kind.length:
            distance = float(np.linalg.norm(apart))
            if not distance > MISFIT * self.size:
                raise self.document.error((*path, "at"), "its points start in one place")
            length = joint.length or norm(apart)
            self.require_length("its points", distance - length, length, (*path, "length"))
            return length
        along = [self._turned(a.body, a.vectors[dot.first]) for dot in kind.dots if dot.of_points]
        missed = float(np.linalg.norm(apart if kind.meets else [x @ apart for x in along]))
        message = f"its places on {joint.from_} and {joint.to} start {missed:.12g} m apart"
        self.require(missed, MISFIT * self.size, (*path, "at"), message, "them")
        return 0.0

    def _about(
        self, joint: spatial_model.SpatialJoint, first: int, second: int, path: KeyPath
    ) -> list[dict[str, Array]]:
        """Vectors n, p and q on both bodies."""
        declared = joint.axis
        if isinstance(declared, dict):
            in_first, in_second = unit(declared[joint.from_]), unit(declared[joint.to])
            axis, other = self._turned(first, in_first), self._turned(second, in_second)
            sine, cosine = float(np.linalg.norm(np.cross(axis, other))), axis @ other
            degrees = math.degrees(math.atan2(sine, cosine))
            askew = sine if cosine >= 0 else 1.0
            if any(dot.second == "n" for dot in JOINTS[joint.type].dots):
                message = f"its axes on {joint.from_} and {joint.to} start {degrees:.3g}° apart"
                self.require(askew, _ASKEW, (*path, "axis"), message, "them")
        else:
            axis = other = unit(declared)
            in_first, in_second = self._seen(first, axis), self._seen(second, axis)
        across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        across /= norm(across)
        p_first = self._seen(first, across)
        # Perpendicular to the axis of the second body, too, where that is not yet parallel.
        leaning = across - product(across, other) * other
        leaning /= norm(leaning)
        p_second = self._seen(second, leaning)
        return [
            {"n": n, "p": p, "q": np.cross(n, p)}
            for n, p in ((in_first, p_first), (in_second, p_second))
        ]

    def _crossed(
        self, joint: spatial_model.SpatialJoint, first: int, second: int, path: KeyPath
    ) -> list[dict[str, Array]]:
        """Axes of a universal joint."""
        axes = joint.axes
        if isinstance(axes, dict):
            in_first, in_second = unit(axes[joint.from_]), unit(axes[joint.to])
            a, b = self._turned(first, in_first), self._turned(second, in_second)
            if not self.mechanism.assemble and abs(a @ b) > _ASKEW:
                message = f"must be perpendicular at the start, the cosine is {a @ b:.3g}"
                raise self.document.error((*path, "axes"), message)
            return [{"a": in_first}, {"b": in_second}]
        assert axes is not None
        a = unit(axes[0])
        b = unit(np.asarray(axes[1]) - product(a, axes[1]) * a)
        return [{"a": self._seen(first, a)}, {"b": self._seen(second, b)}]

    def _turning(self, kind: str, joint: Connection, **arguments: Any) -> None:
        """An element about the axis of a joint: Q and P of its first body, K of the other."""
        a, b = joint.sides
        q, p, other = _direction(a, "q"), _direction(a, "p"), _direction(b, "p")
        of_q: dict[int, float] = dict(q.terms)
        of_p: dict[int, float] = dict(p.terms)
        places = sorted(of_q.keys() | of_p.keys())
        first = [(place, of_q.get(place, 0.0), of_p.get(place, 0.0)) for place in places]
        constants = np.stack([q.constant, p.constant], axis=1).ravel()
        self.add(kind, Sum(constants, first), other, **arguments)

    def _hinge(
        self, name: str, parameters: Sequence[float], path: KeyPath,
        timed: Sequence[laws.Timed] = (),
    ) -> None:  # fmt: skip
        joint = self.joint(name, path)
        if not JOINTS[joint.kind].turns:
            turning = ", ".join(kind for kind, about in JOINTS.items() if about.turns)
            message = f"a {joint.kind} joint has no angle; one of {turning} has"
            raise self.document.error(path, message)
        self._turning("HINGE", joint, parameters=parameters, timed=timed)

    def _rate_gradient(self, joint: Connection, key: str, bodies: Array) -> Array:
        """(n,) gradient of a joint's angle or distance, at origins and directors (b, 4, 3)."""
        gradient = np.zeros(PER_BODY * len(self.numbers))

        def push(terms: Sequence[Term], vector: Array) -> None:
            for place, weight in terms:
                gradient[place : place + 3] += weight * vector

        a, b = joint.sides
        if key == "angle":
            q, p = a.direction("q", bodies), a.direction("p", bodies)
            other = b.direction("p", bodies)
            sine, cosine = float(product(q, other)), float(product(p, other))
            push(_direction(a, "q").terms, cosine * other)
            push(_direction(a, "p").terms, -sine * other)
            push(_direction(b, "p").terms, cosine * q - sine * p)
            return gradient / (sine**2 + cosine**2)
        push(_direction(a, "n").terms, b.place(bodies) - a.place(bodies))
        push(_minus(_site(b), _site(a)).terms, a.direction("n", bodies))
        return gradient

    # -- motions and forces ----------------------------------------------------------------------

    def _motions(self, motion: spatial_model.JointMotion, path: KeyPath) -> None:
        for key, law in motion.driven.items():
            with self.checked():
                if motion.joint is not None:
                    self._drive(motion.joint, key, law, path)
                else:
                    assert motion.point is not None
                    side = self.of_body(motion.point, (*path, "point"))
                    axis = np.eye(3)["xyz".index(key)]
                    now = float(product(axis, self._place(side)))
                    parameters = self.fitting(law, now, (*path, key))
                    self._follow(Sum(axis, ()), _site(side), (*path, key), parameters, law)

    def _follow(
        self, first: Sum, second: Sum, path: KeyPath, parameters: Sequence[float], law: Law
    ) -> None:
        """Add the row L·K − law(t)."""
        row = self.one_row(path)
        self.add("PRODUCT", first, second, row=row, parameters=parameters, law=law)

    def _drive(self, name: str, key: str, law: Law, path: KeyPath) -> None:
        joint, turns = self.joint(name, (*path, "joint")), key == "angle"
        able = [kind for kind, about in JOINTS.items() if (about.turns if turns else about.slides)]
        path = (*path, key)
        if joint.kind not in able:
            message = f"a {joint.kind} joint has none; one of {', '.join(able)} has"
            raise self.document.error(path, message)
        if turns:
            parameters = self.fitting(law, 0.0, path, 2 * math.pi)
            row = self.one_row(path)
            self._turning("ANGLE", joint, parameters=parameters, law=law, row=row)
            return
        a, b = joint.sides
        axis = self._turned(a.body, a.vectors["n"])
        now = float(product(axis, self._place(b) - self._place(a)))
        between = _minus(_site(b), _site(a))
        self._follow(_direction(a, "n"), between, path, self.fitting(law, now, path), law)

    def _forces(self, force: spatial_model.SpatialForce, path: KeyPath) -> None:
        side = self.of_body(force.at, (*path, "at"))
        weights = np.concatenate([[1.0], side.point])
        first = 4 * side.body
        for axis, amount in enumerate(force.force):
            if isinstance(amount, Law):
                for place, weight in enumerate(weights.tolist(), first):
                    if weight:
                        law = laws.Timed(amount, amount.parameters(), axis, weight)
                        self.load(3 * place, (0.0,) * 3, law)
            else:
                self.loads[first : first + 4, axis] += weights * amount

    def _torques(self, torque: spatial_model.SpatialTorque, path: KeyPath) -> None:
        of_body, of_joint = torque.on in self.numbers, torque.on in self.mechanism.joints
        amounts = amounts_of(torque.torque)
        constants = [0.0 if isinstance(amount, Law) else amount for amount in amounts]
        timed = [laws.Timed(law, law.parameters(), axis) for axis, law in laws_of(amounts).items()]
        if not isinstance(torque.torque, tuple):
            if torque.frame is not None:
                raise self.document.error((*path, "frame"), "a torque on a joint has none")
            if of_body and not of_joint:
                message = "must be [x, y, z] on a body, or the torque of a joint"
                raise self.document.error((*path, "torque"), message)
            self._hinge(torque.on, (*constants, 0.0, 0.0, 0.0), (*path, "on"), timed)
            return
        if of_joint and not of_body:
            message = "must be one number on a joint: about its axis"
            raise self.document.error((*path, "torque"), message)
        place = PER_BODY * self.body(torque.on, (*path, "on")) + 3
        kind = "FOLLOWER" if torque.frame == "body" else "MOMENT"
        self.add(kind, Sum((), [(place,)]), parameters=constants, timed=timed)

    def _torsion_springs(self, spring: spatial_model.SpatialTorsionSpring, path: KeyPath) -> None:
        parameters = (0.0, spring.stiffness, spring.rest_angle, 0.0)
        self._hinge(spring.on, parameters, (*path, "on"))

    def _torsion_dampers(self, damper: spatial_model.SpatialTorsionDamper, path: KeyPath) -> None:
        self._hinge(damper.on, (0.0, 0.0, 0.0, damper.damping), (*path, "on"))

    # -- start ---------------------------------------------------------------------------------

    def position(self) -> Array:
        """(n,) coordinates that the file gives."""
        return self.start.ravel()

    def velocities(self, u: Array) -> Array:
        """(n,) velocities that the file gives, where directors are those of a position."""
        bodies, rates = self.mechanism.bodies.values(), np.zeros((len(self.numbers), 4, 3))
        rates[:, 0] = [body.velocity for body in bodies]
        x, y, z = np.array([body.angular_velocity for body in bodies]).T
        turning = np.array([[0 * x, z, -y], [-z, 0 * x, x], [y, -x, 0 * x]])  # (ω ×)ᵀ
        for k, of_rates in enumerate(turning):
            rates[:, 1:] += u.reshape(-1, 4, 3)[:, 1:, k, None] * of_rates.T[:, None]
        return rates.ravel()

    def without_inertia(self, u: Array, motions: Array) -> list[tuple[KeyPath, str]]:
        """Key and words of a motion (n, 1 of k) that has no inertia."""
        bodies = tuple(self.mechanism.bodies)
        moving = motions[:, 0].reshape(len(bodies), 4, 3)
        worst = int(np.argmax(np.abs(moving).max(axis=(1, 2))))
        directors, change = u.reshape(len(bodies), 4, 3)[worst, 1:], moving[worst, 1:]
        spin = directors @ (np.cross(directors, change).sum(axis=0) / 2)  # in body axes
        name, path = bodies[worst], ("bodies", bodies[worst])
        if np.abs(spin).max() < _SEEN * np.abs(moving[worst]).max():
            return [(path, f"nothing stops {name} from moving, and it has no mass")]
        spin = spin / spin[int(np.argmax(np.abs(spin)))]
        axis = next(
            (letter for i, letter in enumerate("xyz") if np.abs(np.delete(spin, i)).max() < _SEEN),
            f"[{', '.join(f'{part:.3g}' for part in spin)}]",
        )
        return [
            (path, f"nothing stops {name} from spinning about {axis}, and it has no inertia there")
        ]


VECTORS = ("origin", "d1", "d2", "d3")


def _site(side: Side) -> Sum:
    """The point of a side."""
    if side.body < 0:
        return Sum(side.point, [])
    return Sum(np.zeros(3), [(PER_BODY * side.body, 1.0), *_weighed(side.body, side.point)])


def _direction(side: Side, name: str) -> Sum:
    """A vector of a side."""
    vector = side.vectors[name]
    return Sum(vector, []) if side.body < 0 else Sum(np.zeros(3), _weighed(side.body, vector))


def _weighed(body: int, vector: Array) -> list[Term]:
    """A vector as a combination of the directors of a body."""
    first = PER_BODY * body + 3
    return [(first + 3 * i, weight) for i, weight in enumerate(vector.tolist()) if weight]


def _minus(first: Sum, second: Sum) -> Sum:
    reversed_ = [(place, -weight) for place, weight in second.terms]
    return Sum(np.subtract(first.constant, second.constant), [*first.terms, *reversed_])
