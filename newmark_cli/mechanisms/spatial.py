"""Spatial mechanisms: the tables of the element loop from a mechanism's data.

A rigid body is the position of a point and three directors (Betsch and Steinmann): twelve
coordinates, a constant mass matrix, and constraints that are at most quadratic.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from newmark_cli.mechanisms import builder, elements, laws, start, table
from newmark_cli.mechanisms.builder import Follows, Row
from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.mechanisms.models import Law
from newmark_cli.mechanisms.spatial_model import (
    GROUND,
    Body,
    Joint,
    Motion,
    SpatialMechanism,
    unit,
)
from newmark_cli.mechanisms.spatial_outputs import Connection, Side, SpatialOutputs
from newmark_cli.mechanisms.table import Element, Term
from newmark_cli.problems.algebra import norm, product
from newmark_cli.problems.problem import Problem
from newmark_cli.support import documents
from newmark_cli.support.arrays import Array, IndexArray
from newmark_cli.support.documents import Document, KeyPath

#: Coordinates of a body.
PER_BODY = 12
#: What the two places of a joint may differ by at the start, of the largest coordinate.
_MISFIT = 1e-12
#: How far from parallel axes that are given by body may be at the start.
_ASKEW = 1e-9

#: What keeps a body rigid: products of these directors.
DIRECTORS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
INTERNAL = tuple(f"d{i + 1}·d{j + 1}" for i, j in DIRECTORS)


@dataclass(frozen=True, eq=False)
class SpatialModel:
    """Data of a spatial mechanism for drawings and outputs.

    Attributes:
        mechanism: What the file says.
        bodies: Names, in the order of the coordinates.
        joints: By name.
        points: Points of the ground and of bodies, by name.
        shared: Joints whose reactions are not unique, because they depend on what is dropped.
        freedom: Degrees of freedom at the start.
        mass_rank: Rank of M.
        loose: Bodies that nothing holds.
    """

    mechanism: SpatialMechanism
    bodies: tuple[str, ...]
    joints: Mapping[str, Connection]
    points: Mapping[str, Side]
    shared: frozenset[str] = frozenset()
    freedom: int = 0
    mass_rank: int = 0
    loose: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Heads drawings."""
        return self.mechanism.title

    @property
    def description(self) -> str:
        """Kind and motion, in one line."""
        return self.mechanism.description


#: Constant part, and (place of a vector in u, weight) pairs.
_Combination = tuple[Array, list[Term]]


def built(name: str, document: Document) -> Problem:
    """Problem from the document of a spatial mechanism.

    Raises:
        DocumentError: For mistakes, each with file, line and key.
    """
    return build(name, documents.validate(document, SpatialMechanism), document)


def build(name: str, mechanism: SpatialMechanism, document: Document | None = None) -> Problem:
    """Problem from a spatial mechanism.

    Args:
        name: Name of the problem.
        mechanism: The mechanism.
        document: Where it came from, for errors.

    Raises:
        DocumentError: For mistakes, each with file, line and key.
    """
    under_way = Builder(name, document or Document(name, {}, {}), mechanism)
    problem, shared, freedom = start.consistent(under_way)
    held = {side.body for joint in under_way.joints.values() for side in joint.sides}
    model = replace(
        problem.drawing,
        shared=shared,
        freedom=freedom,
        mass_rank=_mass_rank(problem),
        loose=tuple(body for i, body in enumerate(mechanism.bodies) if i not in held),
    )
    assert isinstance(problem.outputs, SpatialOutputs)
    outputs = replace(problem.outputs, shared=shared)
    return replace(problem, drawing_given=model, outputs=outputs)


#: Largest moment of a body, relative to others, with which a motion has no inertia.
_NO_INERTIA = 1e-13
#: Least size of a direction's part, relative to the largest, that words mention.
_SEEN = 1e-6


def _mass_rank(problem: Problem) -> int:
    """Rank of M, which is S ⊗ 1 for each body."""
    blocks = np.zeros((problem.n // PER_BODY, 4, 4))
    rows, columns = problem.pattern.mass_rows, problem.pattern.mass_columns
    along = rows % 3 == 0
    body = rows[along] // PER_BODY
    i, j = rows[along] % PER_BODY // 3, columns[along] % PER_BODY // 3
    blocks[body, i, j] = problem.mass_values[along]
    values = np.linalg.eigvalsh(blocks)
    largest = np.maximum(values[:, -1:], 1e-300)
    return 3 * int(np.count_nonzero(values > _NO_INERTIA * largest))


class Builder(builder.Builder):
    """Turns a mechanism in space into the tables of the element loop.

    Attributes:
        joints: Joints that were built.
    """

    mechanism: SpatialMechanism

    def __init__(self, name: str, document: Document, mechanism: SpatialMechanism) -> None:
        super().__init__(name, document, mechanism)
        self.joints: dict[str, Connection] = {}
        self._elements: list[Element] = []
        self._numbers = {body: i for i, body in enumerate(mechanism.bodies)}
        self._frames = [body.directors for body in mechanism.bodies.values()]
        self._origins = [np.array(body.position) for body in mechanism.bodies.values()]
        self._points: dict[str, Side] = {}
        self._build()

    # -- what it is asked for ------------------------------------------------------------------

    def problem(self, released: Sequence[int] = ()) -> Problem:
        """The problem, without some of its constraints.

        Args:
            released: Numbers of constraints that are dropped.
        """
        kept = np.setdiff1d(np.arange(len(self.rows)), list(released)).tolist()
        mechanism = self.mechanism
        number = np.full(len(self.rows) + 1, -1)
        number[kept] = np.arange(len(kept))
        tables = table.of_elements(
            [
                replace(one, row=int(number[one.row]))
                for one in self._elements
                if one.row < 0 or number[one.row] >= 0
            ]
        )
        mass_places, mass_values = self._mass
        return Problem(
            name=self.name,
            u0=self._start(),
            v0=self.velocities(self._start()),
            t0=0.0,
            constraints=len(kept),
            **tables.functions(mechanism.conservative),
            pattern=tables.pattern(np.stack(mass_places)),
            mass_values=mass_values,
            drawing_given=SpatialModel(
                mechanism,
                tuple(self._numbers),
                self.joints,
                self._points,
            ),
            points_given=tuple(f"{body}.{vector}" for body in self._numbers for vector in VECTORS),
            axes="xyz",
            quadratic=not mechanism.motions,
            single=True,
            until=table.until(self._elements),
            constraints_given=tuple(self.rows[row].parts for row in kept),
            released=tuple(self.rows[row].full for row in sorted(released)),
            outputs=SpatialOutputs(
                tuple(self._numbers), self.joints, tuple(self.rows[row].owner for row in kept)
            ),
        )

    def rates(self, u: Array) -> Iterator[tuple[KeyPath, Array, float]]:
        """Key, gradient (n,) at a position (n,), and value of each rate that the file gives.

        Raises:
            DocumentError: When a joint has no such rate.
        """
        for name, given in self.mechanism.rates.items():
            path: KeyPath = ("rates", name)
            joint = self._joint(name, path)
            kind = JOINTS[joint.kind]
            has = [
                key for key, is_so in (("angle", kind.turns), ("distance", kind.slides)) if is_so
            ]
            wanted = (
                {
                    key: rate
                    for key in ("angle", "distance")
                    if (rate := getattr(given, key)) is not None
                }
                if not isinstance(given, float)
                else dict.fromkeys(has, given)
            )
            if not has or not set(wanted) <= set(has):
                what = " and ".join(has) or "no single rate"
                raise self.document.error(path, f"a {joint.kind} joint has {what}")
            if isinstance(given, float) and len(has) > 1:
                raise self.document.error(
                    path, f"a {joint.kind} joint has two rates; give {{angle: …, distance: …}}"
                )
            for key, rate in wanted.items():
                yield path, self._rate_gradient(joint, key, u.reshape(-1, 4, 3)), rate

    # -- parts ---------------------------------------------------------------------------------

    def _build(self) -> None:
        mechanism = self.mechanism
        if GROUND in mechanism.bodies:
            message = "'ground' is what bodies stand on; give this body another name"
            self.mistakes.note(self.document.error(("bodies", GROUND), message))
        for name, point in mechanism.points.items():
            self._points[name] = Side(-1, np.array(point.fixed), {})
        for name, on_body in mechanism.body_points.items():
            with self.checked():
                if name in mechanism.points:
                    message = f"there is a point {name} of the ground, too"
                    raise self.document.error(("body_points", name), message)
                body = self._body(on_body.on, ("body_points", name, "on"))
                self._points[name] = Side(body, np.array(on_body.at), {})
        self._loads = np.zeros((4 * len(self._numbers), 3))
        self._mass = self._masses()
        for name, body in self._numbers.items():
            directors = [PER_BODY * body + 3 * i for i in (1, 2, 3)]
            for text, (i, j) in zip(INTERNAL, DIRECTORS, strict=True):
                self.rows.append(Row(("bodies", name), "", text))
                one, other = (directors[i], 1.0), (directors[j], 1.0)
                if i == j:
                    self._square([one], np.zeros(3), 1.0)
                else:
                    self._product((np.zeros(3), [one]), (np.zeros(3), [other]))
        for name, joint in mechanism.joints.items():
            with self.checked():
                self._add_joint(name, joint)
        for name, motion in mechanism.motions.items():
            with self.checked():
                self._add_motion(motion, ("motions", name))
        self._add_forces()
        self.mistakes.refuse()
        for place in np.flatnonzero(np.any(self._loads != 0, axis=1)).tolist():
            load = self._loads[place].tolist()
            self._push(3 * place, load)

    def _add_forces(self) -> None:
        mechanism = self.mechanism
        for name, force in mechanism.forces.items():
            with self.checked():
                side = self._of_body(force.at, ("forces", name, "at"))
                weights = np.concatenate([[1.0], side.point])
                first = 4 * side.body
                for axis, amount in enumerate(force.force):
                    if isinstance(amount, Law):
                        for place, weight in enumerate(weights.tolist(), first):
                            if weight:
                                law = laws.Timed(amount, amount.parameters(), axis, weight)
                                self._push(3 * place, (0.0,) * 3, law)
                    else:
                        self._loads[first : first + 4, axis] += weights * amount
        for name, spring in mechanism.springs.items():
            with self.checked():
                ends = self._ends(spring.from_, spring.to, ("springs", name))
                self._strut(elements.SPRING, ends, (spring.stiffness, spring.rest_length))
        for name, damper in mechanism.dampers.items():
            with self.checked():
                ends = self._ends(damper.from_, damper.to, ("dampers", name))
                self._strut(elements.DAMPER, ends, (damper.damping,))
        for name in mechanism.torques:
            with self.checked():
                self._add_torque(name)
        for name, twisted in mechanism.torsion_springs.items():
            with self.checked():
                path: KeyPath = ("torsion_springs", name, "on")
                self._hinge(twisted.on, (0.0, twisted.stiffness, twisted.rest_angle, 0.0), path)
        for name, rubbed in mechanism.torsion_dampers.items():
            with self.checked():
                path = ("torsion_dampers", name, "on")
                self._hinge(rubbed.on, (0.0, 0.0, 0.0, rubbed.damping), path)

    def _push(self, place: int, force: Sequence[float], *timed: laws.Timed) -> None:
        """A force on the origin or a director of a body."""
        self._elements.append(
            Element(elements.LOAD, 3, first=((place,),), parameters=force, timed=timed)
        )

    def _add_torque(self, name: str) -> None:
        torque, path = self.mechanism.torques[name], ("torques", name)
        if isinstance(torque.torque, float | Law):
            if torque.frame is not None:
                raise self.document.error((*path, "frame"), "a torque on a joint has none")
            if torque.on in self._numbers and torque.on not in self.mechanism.joints:
                message = "must be [x, y, z] on a body, or the torque of a joint"
                raise self.document.error((*path, "torque"), message)
            constant = torque.torque if isinstance(torque.torque, float) else 0.0
            timed: tuple[laws.Timed, ...] = ()
            if isinstance(torque.torque, Law):
                timed = (laws.Timed(torque.torque, torque.torque.parameters(), 0),)
            self._hinge(torque.on, (constant, 0.0, 0.0, 0.0), (*path, "on"), timed)
            return
        if torque.on in self.mechanism.joints and torque.on not in self._numbers:
            message = "must be one number on a joint: about its axis"
            raise self.document.error((*path, "torque"), message)
        body = self._body(torque.on, (*path, "on"))
        kind = elements.FOLLOWER if torque.frame == "body" else elements.MOMENT
        timed_by = tuple(
            laws.Timed(amount, amount.parameters(), axis)
            for axis, amount in enumerate(torque.torque)
            if isinstance(amount, Law)
        )
        constant_of = [0.0 if isinstance(amount, Law) else amount for amount in torque.torque]
        place = PER_BODY * body + 3
        self._elements.append(
            Element(kind, 3, first=((place,),), parameters=constant_of, timed=timed_by)
        )

    def _masses(self) -> tuple[tuple[IndexArray, IndexArray], Array]:
        """Places and values of M = S ⊗ 1; gravity goes into the loads."""
        gravity = np.array(self.mechanism.gravity)
        points: dict[int, list[tuple[Array, float]]] = {}
        for name, point in self.mechanism.body_points.items():
            if point.mass and name in self._points:
                side = self._points[name]
                points.setdefault(side.body, []).append((side.point, point.mass))
        places, values = [], []
        for i, body in enumerate(self.mechanism.bodies.values()):
            inertia = mass_of(body)
            for at, mass in points.get(i, ()):
                weights = np.concatenate([[1.0], at])
                inertia = inertia + mass * np.outer(weights, weights)
            self._loads[4 * i : 4 * i + 4] += np.outer(inertia[0], gravity)
            rows, columns = np.nonzero(inertia)
            for c in range(3):
                places.append(PER_BODY * i + 3 * np.array([rows, columns]) + c)
                values.append(inertia[rows, columns])
        found = np.concatenate(values)
        if not len(found):
            message = "no body has mass"
            raise self.document.error(("bodies",), message)
        together = np.concatenate(places, axis=1).astype(np.int64)
        return (together[0], together[1]), found

    # -- references ----------------------------------------------------------------------------

    def _body(self, name: str, path: KeyPath, ground: bool = False) -> int:
        if ground and name == GROUND:
            return -1
        if name not in self._numbers:
            allowed = (*self._numbers, GROUND) if ground else tuple(self._numbers)
            raise self.unknown("body", name, path, allowed)
        return self._numbers[name]

    def _joint(self, name: str, path: KeyPath) -> Connection:
        if name not in self.mechanism.joints:
            raise self.unknown("joint", name, path, self.mechanism.joints)
        if name not in self.joints:
            raise Follows
        return self.joints[name]

    def _point(self, name: str, path: KeyPath) -> Side:
        if name in self.mechanism.body_points and name not in self._points:
            raise Follows
        if name not in self._points:
            raise self.unknown("point", name, path, self._points)
        return self._points[name]

    def _of_body(self, name: str, path: KeyPath) -> Side:
        """A point of a body, or the origin of one."""
        if name in self._numbers and name not in self._points:
            return Side(self._numbers[name], np.zeros(3), {})
        if name not in self._points and name not in self.mechanism.body_points:
            raise self.unknown("point", name, path, (*self._points, *self._numbers))
        side = self._point(name, path)
        if side.body < 0:
            raise self.document.error(path, f"{name} is a point of the ground")
        return side

    def _ends(self, start: str, end: str, path: KeyPath) -> tuple[Side, Side]:
        found = []
        for name, key in ((start, "from"), (end, "to")):
            with self.checked():
                found.append(self._point(name, (*path, key)))
        if len(found) < 2:
            raise Follows
        if found[0].body == found[1].body:
            message = f"joins {start} and {end}, which cannot move relative to each other"
            raise self.document.error(path, message)
        if not self.mechanism.assemble:
            apart = np.linalg.norm(self._place(found[1]) - self._place(found[0]))
            if apart <= _MISFIT * self._size:
                raise self.document.error(
                    path, f"{start} and {end} start in one place: their line has no direction"
                )
        return found[0], found[1]

    # -- geometry at the start -----------------------------------------------------------------

    @property
    def _size(self) -> float:
        return max(1.0, *(float(np.abs(origin).max()) for origin in self._origins))

    def _place(self, side: Side) -> Array:
        if side.body < 0:
            return side.point
        return np.asarray(self._origins[side.body] + product(self._frames[side.body], side.point))

    def _turned(self, body: int, vector: Array) -> Array:
        """(3,) a vector of a body in global axes."""
        return vector if body < 0 else product(self._frames[body], vector)

    def _seen(self, body: int, vector: Array) -> Array:
        """(3,) a global vector in the axes of a body."""
        return vector if body < 0 else product(self._frames[body].T, vector)

    def _at(self, body: int, place: Array) -> Array:
        """(3,) body coordinates of a global place."""
        if body < 0:
            return place
        return product(self._frames[body].T, place - self._origins[body])

    # -- joints --------------------------------------------------------------------------------

    def _add_joint(self, name: str, joint: Joint) -> None:
        path: KeyPath = ("joints", name)
        kind, numbers = JOINTS[joint.type], []
        for given, key in ((joint.from_, "from"), (joint.to, "to")):
            with self.checked():
                numbers.append(self._body(given, (*path, key), ground=True))
        if len(numbers) < 2:
            raise Follows
        first, second = numbers
        names = (joint.from_, joint.to)
        points = [
            np.array(joint.at[end])
            if isinstance(joint.at, dict)
            else self._at(body, np.array(joint.at))
            for end, body in zip(names, numbers, strict=True)
        ]
        vectors: list[dict[str, Array]] = [{}, {}]
        if kind.axes == 1:
            vectors = self._about(joint, first, second, path)
        elif kind.axes == 2:
            vectors = self._crossed(joint, first, second, path)
        elif joint.type == "rigid":
            frame = np.eye(3)
            vectors = [
                {f"e{i + 1}": self._seen(body, frame[i]) for i in range(3)} for body in numbers
            ]
        a, b = (
            Side(body, point, found)
            for body, point, found in zip(numbers, points, vectors, strict=True)
        )
        apart = self._place(b) - self._place(a)
        if kind.length:
            if not np.linalg.norm(apart) > _MISFIT * self._size:
                raise self.document.error((*path, "at"), "its points start in one place")
            length = joint.length or norm(apart)
            misfit = float(np.linalg.norm(apart)) - length
            if not self.mechanism.assemble and abs(misfit) > _MISFIT * length:
                raise self.document.error(
                    (*path, "length"),
                    f"its points start {builder.apart(length, misfit)} m apart, given length "
                    f"{length:.16g}; correct the positions or set 'assemble: true'",
                )
        elif isinstance(joint.at, dict) and not self.mechanism.assemble:
            self._require_met(joint, a, b, apart, path)
        self.joints[name] = Connection(joint.type, (a, b))
        row = len(self.rows)
        self.rows += [Row(path, name, row) for row in kind.rows]
        between = _minus(_site(b), _site(a))
        if kind.meets:
            offset, terms = between
            for c in range(3):
                single = [(place + c, weight) for place, weight in terms]
                self._elements.append(
                    Element(
                        elements.PRODUCT, 0, row + c, single=single, parameters=(0.0 - offset[c],)
                    )
                )
            row += 3
        for dot in kind.dots:
            other = between if dot.of_points else _direction(b, dot.second)
            self._product(_direction(a, dot.first), other, row=row)
            row += 1
        if kind.length:
            self.squares[row] = length * length
            self._square(between[1], between[0], length * length)

    def _require_met(self, joint: Joint, a: Side, b: Side, apart: Array, path: KeyPath) -> None:
        """Both places of a joint are one at the start, as far as the joint asks."""
        kind = JOINTS[joint.type]
        along = [self._turned(a.body, a.vectors[dot.first]) for dot in kind.dots if dot.of_points]
        missed = float(np.linalg.norm(apart if kind.meets else [x @ apart for x in along]))
        if missed > _MISFIT * self._size:
            raise self.document.error(
                (*path, "at"),
                f"its places on {joint.from_} and {joint.to} start {missed:.12g} m apart; correct "
                "them or set 'assemble: true'",
            )

    def _about(
        self, joint: Joint, first: int, second: int, path: KeyPath
    ) -> list[dict[str, Array]]:
        """n, p and q of both bodies."""
        given = joint.axis
        if isinstance(given, dict):
            in_first, in_second = unit(given[joint.from_]), unit(given[joint.to])
            axis, other = self._turned(first, in_first), self._turned(second, in_second)
            askew = float(np.linalg.norm(np.cross(axis, other)))
            aligned = any(dot.second == "n" for dot in JOINTS[joint.type].dots)
            if aligned and not self.mechanism.assemble and (askew > _ASKEW or axis @ other < 0):
                raise self.document.error(
                    (*path, "axis"),
                    f"its axes on {joint.from_} and {joint.to} start {_degrees(axis, other):.3g}° "
                    "apart; correct them or set 'assemble: true'",
                )
        else:
            axis = other = unit(given)
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
        self, joint: Joint, first: int, second: int, path: KeyPath
    ) -> list[dict[str, Array]]:
        """Axes of a universal joint."""
        given = joint.axes
        if isinstance(given, dict):
            in_first, in_second = unit(given[joint.from_]), unit(given[joint.to])
            a, b = self._turned(first, in_first), self._turned(second, in_second)
            if not self.mechanism.assemble and abs(a @ b) > _ASKEW:
                message = f"must be perpendicular at the start, the cosine is {a @ b:.3g}"
                raise self.document.error((*path, "axes"), message)
            return [{"a": in_first}, {"b": in_second}]
        assert given is not None
        a = unit(given[0])
        b = unit(np.asarray(given[1]) - product(a, given[1]) * a)
        return [{"a": self._seen(first, a)}, {"b": self._seen(second, b)}]

    def _product(
        self, first: _Combination, second: _Combination, law: Law | None = None,
        parameters: Sequence[float] = (), row: int | None = None,
    ) -> None:  # fmt: skip
        """The row L·K − law(t); the last one unless its number is given."""
        timed = () if law is None else (laws.Timed(law, parameters),)
        self._elements.append(
            Element(
                elements.PRODUCT, 3, len(self.rows) - 1 if row is None else row, first[1],
                second[1], constants=_flat(first, second), parameters=parameters, timed=timed,
            )
        )  # fmt: skip

    def _square(self, terms: list[Term], offset: Array, square: float) -> None:
        """The last row, ½ (L·L − square)."""
        row = len(self.rows) - 1
        self._elements.append(
            Element(elements.SQUARE, 3, row, terms, constants=offset.tolist(), parameters=(square,))
        )

    def _strut(self, kind: int, ends: tuple[Side, Side], parameters: Sequence[float]) -> None:
        offset, terms = _minus(_site(ends[1]), _site(ends[0]))
        self._elements.append(
            Element(kind, 3, first=terms, constants=offset.tolist(), parameters=parameters)
        )

    def _turning(self, kind: int, joint: Connection, **given: Any) -> None:
        """An element about the axis of a joint: Q and P of its first body, K of the other."""
        a, b = joint.sides
        q, p, other = _direction(a, "q"), _direction(a, "p"), _direction(b, "p")
        of_q: dict[int, float] = dict(q[1])
        of_p: dict[int, float] = dict(p[1])
        both = sorted(of_q.keys() | of_p.keys())
        first = [(place, of_q.get(place, 0.0), of_p.get(place, 0.0)) for place in both]
        self._elements.append(
            Element(kind, 3, first=first, second=other[1], constants=_flat(q, other, p), **given)
        )

    def _hinge(
        self, name: str, parameters: Sequence[float], path: KeyPath,
        timed: Sequence[laws.Timed] = (),
    ) -> None:  # fmt: skip
        joint = self._joint(name, path)
        if not JOINTS[joint.kind].turns:
            turning = ", ".join(kind for kind, about in JOINTS.items() if about.turns)
            message = f"a {joint.kind} joint has no angle; one of {turning} has"
            raise self.document.error(path, message)
        self._turning(elements.HINGE, joint, parameters=parameters, timed=timed)

    def _rate_gradient(self, joint: Connection, key: str, bodies: Array) -> Array:
        """(n,) of the angle or the distance of a joint, at origins and directors (b, 4, 3)."""
        gradient = np.zeros(PER_BODY * len(self._numbers))

        def push(terms: Sequence[tuple[int, float]], vector: Array) -> None:
            for place, weight in terms:
                gradient[place : place + 3] += weight * vector

        a, b = joint.sides
        if key == "angle":
            q, p, other = (
                a.direction("q", bodies),
                a.direction("p", bodies),
                b.direction("p", bodies),
            )
            sine, cosine = float(product(q, other)), float(product(p, other))
            push(_direction(a, "q")[1], cosine * other)
            push(_direction(a, "p")[1], -sine * other)
            push(_direction(b, "p")[1], cosine * q - sine * p)
            return gradient / (sine**2 + cosine**2)
        push(_direction(a, "n")[1], b.place(bodies) - a.place(bodies))
        push(_minus(_site(b), _site(a))[1], a.direction("n", bodies))
        return gradient

    # -- motions -------------------------------------------------------------------------------

    def _add_motion(self, motion: Motion, path: KeyPath) -> None:
        for key, law in motion.laws.items():
            with self.checked():
                if motion.joint is not None:
                    self._drive(motion.joint, key, law, path)
                else:
                    assert motion.point is not None
                    side = self._of_body(motion.point, (*path, "point"))
                    axis = np.eye(3)["xyz".index(key)]
                    now = float(product(axis, self._place(side)))
                    parameters = self.fitting(law, now, (*path, key))
                    self.one_row((*path, key))
                    self._product((axis, []), _site(side), law, parameters)

    def _drive(self, name: str, key: str, law: Law, path: KeyPath) -> None:
        joint = self._joint(name, (*path, "joint"))
        kind = JOINTS[joint.kind]
        if not (kind.turns if key == "angle" else kind.slides):
            having = ", ".join(
                other for other, one in JOINTS.items()
                if (one.turns if key == "angle" else one.slides)
            )  # fmt: skip
            message = f"a {joint.kind} joint has none; one of {having} has"
            raise self.document.error((*path, key), message)
        a, b = joint.sides
        period = 2 * math.pi if key == "angle" else math.inf
        now = 0.0
        if key == "distance":
            axis = self._turned(a.body, a.vectors["n"])
            now = float(product(axis, self._place(b) - self._place(a)))
        parameters = self.fitting(law, now, (*path, key), period)
        self.one_row((*path, key))
        if key == "distance":
            between = _minus(_site(b), _site(a))
            self._product(_direction(a, "n"), between, law, parameters)
            return
        timed = (laws.Timed(law, parameters),)
        row = len(self.rows) - 1
        self._turning(elements.ANGLE, joint, parameters=parameters, timed=timed, row=row)

    # -- start ---------------------------------------------------------------------------------

    def _start(self) -> Array:
        """(n,) coordinates."""
        return np.concatenate(
            [
                np.concatenate([origin, frame.T.ravel()])
                for origin, frame in zip(self._origins, self._frames, strict=True)
            ]
        )

    def velocities(self, u: Array) -> Array:
        """(n,) velocities that the file gives, where directors are those of a position."""
        frames = u.reshape(-1, 4, 3)[:, 1:]
        of_bodies = zip(self.mechanism.bodies.values(), frames, strict=True)
        return np.concatenate(
            [
                np.concatenate([body.velocity, product(frame, turning_rate(body).T).ravel()])
                for body, frame in of_bodies
            ]
        )

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


def turning_rate(body: Body) -> Array:
    """(3, 3) matrix of ω ×."""
    x, y, z = body.angular_velocity
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def mass_of(body: Body) -> Array:
    """(4, 4) S of a body, M = S ⊗ 1: mass, first moments, Euler tensor about the origin."""
    centre, inertia = np.array(body.centre), body.tensor
    euler = np.trace(inertia) / 2 * np.eye(3) - inertia + body.mass * np.outer(centre, centre)
    first = body.mass * centre
    return np.block([[np.array([[body.mass]]), first[None]], [first[:, None], euler]])


def _degrees(first: Array, second: Array) -> float:
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(first, second))), first @ second))


def _site(side: Side) -> _Combination:
    """The point of a side."""
    if side.body < 0:
        return side.point, []
    place = PER_BODY * side.body
    weights = zip(range(place + 3, place + PER_BODY, 3), side.point.tolist(), strict=True)
    return np.zeros(3), [(place, 1.0), *((at, weight) for at, weight in weights if weight)]


def _direction(side: Side, name: str) -> _Combination:
    """A vector of a side."""
    vector = side.vectors[name]
    if side.body < 0:
        return vector, []
    place = PER_BODY * side.body
    weights = zip(range(place + 3, place + PER_BODY, 3), vector.tolist(), strict=True)
    return np.zeros(3), [(at, weight) for at, weight in weights if weight]


def _minus(one: _Combination, other: _Combination) -> _Combination:
    return one[0] - other[0], [*one[1], *((place, -weight) for place, weight in other[1])]


def _flat(*combinations: _Combination) -> list[float]:
    return [number for constant, _ in combinations for number in constant.tolist()]
