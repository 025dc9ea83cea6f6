"""Planar mechanisms as data: points, two-point bodies, and parts that join or load them.

The coordinates are the positions of the moving points ("natural coordinates").
A body is carried by two points at constant distance, so it needs no angle, its
mass matrix is constant, and it brings one distance constraint.

Torsion springs, gears and wheels that roll count turns, which points cannot.  A body that one
of them names has its angle θ as a further coordinate behind those of the points, with one
more constraint n(θ)·Δ = 0, n = (−sin θ, cos θ), and half of its inertia; everything that acts
on angles is linear in them.  Other bodies keep to points.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from newmark_cli.mechanisms import builder, elements, laws, start, table
from newmark_cli.mechanisms.builder import Follows
from newmark_cli.mechanisms.models import Body, Law, Line, Mechanism, Slider
from newmark_cli.mechanisms.parts import MISFIT, PARTS, UNIT, conserves, is_ground
from newmark_cli.mechanisms.table import Element, Term
from newmark_cli.problems.algebra import product
from newmark_cli.problems.problem import Problem, Push
from newmark_cli.support import documents
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import Document, DocumentError, KeyPath

#: What adds forces in Python to a problem.
Code = Callable[[Problem, Sequence["Push"]], Problem]

#: Coordinates of angles with their weights in a sum.
Angles = tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class Site:
    """A point of the mechanism as Σ (a + bR) P over base points."""

    weights: Mapping[str, complex]

    def minus(self, other: "Site") -> dict[str, complex]:
        """Weights of the difference of two sites."""
        names = dict.fromkeys((*other.weights, *self.weights))
        return {
            name: weight
            for name in names
            if (weight := self.weights.get(name, 0) - other.weights.get(name, 0)) != 0
        }


def built(name: str, document: Document, code: Code | None = None) -> Problem:
    """Problem from a mechanism file that was read.

    Args:
        name: Name of the problem.
        document: The file.
        code: Adds forces in Python; refused if omitted.

    Raises:
        DocumentError: For every mistake that can be found, each with file, line and
            key: of the file itself, or of a mechanism without a consistent start.
    """
    try:
        mechanism = documents.validate(document, Mechanism)
    except DocumentError as error:
        mistakes = documents.Mistakes()
        mistakes.note(error)
        with mistakes.gathered():
            _check_rest(name, document, error)
        mistakes.refuse()
        raise
    return build(name, mechanism, document, code)


def _check_rest(name: str, document: Document, error: DocumentError) -> None:
    """What can be said of a file apart from mistakes that are known.

    Raises:
        DocumentError: For mistakes in the relations between parts that are well formed.
    """
    wrong: set[KeyPath] = {mistake.path[:2] for mistake in error.mistakes}
    parts = {path for path in wrong if path[:1] and path[0] in _PARTS}
    others = {path[0] for path in wrong - parts if path}
    if error.more or () in wrong or any(len(path) < 2 for path in parts) or others - _OTHERS:
        return
    sound = {
        key: {name: part for name, part in value.items() if (key, name) not in parts}
        if key in _PARTS
        else value
        for key, value in document.data.items()
        if key not in others
    }
    if "assemble" in others:
        sound["assemble"] = True  # nobody knows whether positions are meant to fit
    broken = [("bodies" if kind == "bodies" else "points", str(name)) for kind, name in parts]
    mechanism = documents.validate(document, Mechanism, sound)
    Builder(name, document, mechanism, broken).problem()


#: Keys of a mechanism whose values are parts by name.
_PARTS = ("points", "bodies", "body_points", *PARTS)
_OTHERS = Mechanism.model_fields.keys() - set(_PARTS)


def build(
    name: str,
    mechanism: Mechanism,
    document: Document | None = None,
    code: Code | None = None,
) -> Problem:
    """Problem from a mechanism.

    Args:
        name: Name of the problem.
        mechanism: The mechanism.
        document: Where it came from, for errors.
        code: Adds forces in Python; refused if omitted.

    Raises:
        DocumentError: See `load`.
    """
    document = document or Document(name, {}, {})
    under_way = Builder(name, document, mechanism)
    under_way.problem()
    if under_way.pushes and code is None:
        path = next(iter(under_way.pushes))
        file = under_way.pushes[path].given.rpartition(":")[0]
        message = f"{file} is code, which runs only with --allow-code"
        raise document.error((*path, "python"), message)
    problem = start.consistent(under_way).problem
    if under_way.pushes and code is not None:
        problem = code(problem, tuple(under_way.pushes.values()))
    return problem


class Builder(builder.Builder):
    """Turns a mechanism of the plane into the tables of the element loop."""

    mechanism: Mechanism

    def __init__(
        self,
        name: str,
        document: Document,
        mechanism: Mechanism,
        broken: Collection[tuple[str, str]] = (),
    ) -> None:
        super().__init__(name, document, mechanism)
        self.broken.update(broken)
        self.moving: dict[str, int] = {}
        self.fixed: dict[str, complex] = {}
        for point, data in mechanism.points.items():
            if (data.fixed is None) == (data.at is None):
                message = "needs either 'fixed' or 'at', the initial position"
                self.mistakes.note(document.error(("points", point), message))
                self.broken.add(("points", point))
            elif data.fixed is not None:
                self.fixed[point] = complex(*data.fixed)
            else:
                self.moving[point] = 2 * len(self.moving)
        self.sites = {point: Site({point: 1}) for point in mechanism.points}
        for point, on_body in mechanism.body_points.items():
            with self.checked("points", point):
                body = self.body(on_body.on, ("body_points", point, "on"))
                if not {body.from_, body.to} <= self.moving.keys() | self.fixed.keys():
                    raise Follows
                z = complex(*on_body.at) / body.length
                self.sites[point] = Site({body.from_: 1 - z, body.to: z})
        self.fixed[UNIT] = 1 + 0j
        self.elements: list[Element] = []
        self.mass: dict[tuple[int, int], float] = {}
        #: Angles that are coordinates: name → place in u, and at the start with their rates.
        self.turning: dict[str, int] = {}
        self.start_angles: list[tuple[float, float]] = []
        #: Forces in Python.
        self.pushes: dict[KeyPath, Push] = {}
        self._problem: Problem | None = None

    def problem(self, released: Sequence[int] = ()) -> Problem:
        """The problem, whose start is as given; raises DocumentError for its mistakes."""
        if self._problem is None:
            self._problem = self._built()
        return self._problem

    def velocities(self, u: Array) -> Array:
        """(n,) velocities that the file gives, wherever the points are."""
        return self.problem().v0

    def without_inertia(self, u: Array, motions: Array) -> list[tuple[KeyPath, str]]:
        """Points that move without inertia, as words of errors."""
        sizes = np.abs(motions).max(axis=1)
        weak = np.flatnonzero(sizes > 1e-6 * sizes.max())
        points = dict.fromkeys(self.problem().point_of(int(i)) for i in weak)
        message = "carries no mass of its own; the mass matrix is singular"
        return [(("points", point), f"{point} {message}") for point in points]

    def _built(self) -> Problem:
        mechanism = self.mechanism
        if not self.moving and not self.broken:
            self.mistakes.note(self.document.error(("points",), "no point moves"))
        for name, body in mechanism.bodies.items():
            with self.checked("bodies", name):
                self._require_points(body, ("bodies", name))
                self.distance(body.from_, body.to, body.length, ("bodies", name))
        for key, part in PARTS.items():
            for name, one in getattr(mechanism, key).items():
                with self.checked():
                    part.build(self, one, (key, name))
        self.mistakes.refuse()
        n = 2 * len(self.moving) + len(self.turning)
        loads = np.zeros(n)
        gravity = complex(*mechanism.gravity)
        for name, body in mechanism.bodies.items():
            self._body_mass(name, body, loads, gravity)
        for name, point in mechanism.points.items():
            self._add_mass(name, name, complex(point.mass), loads, gravity)
        for i in range(0, 2 * len(self.moving), 2):
            if np.any(loads[i : i + 2]):
                load = loads[i : i + 2].tolist()
                self.elements.append(Element(elements.LOAD, 2, first=((i,),), parameters=load))
        tables = table.of_elements(self.elements)
        mass = np.array(sorted(self.mass), np.int64).reshape(-1, 2).T.copy()
        points = [mechanism.points[name] for name in self.moving]
        at = [c for point in points for c in point.at or ()]
        velocity = [c for point in points for c in point.velocity]
        return Problem(
            name=self.name,
            u0=np.array(at + [angle for angle, _ in self.start_angles]),
            v0=np.array(velocity + [rate for _, rate in self.start_angles]),
            t0=0.0,
            constraints=len(self.rows),
            **tables.functions(conserves(mechanism)),
            pattern=tables.pattern(mass),
            mass_values=np.array([self.mass[place] for place in sorted(self.mass)]),
            drawing_given=mechanism,
            points_given=tuple(self.moving),
            coordinates_given=tuple(self.turning),
            # Links, bars, sliders and angle joints are; laws of time and angles are not
            # carried by increments.
            quadratic=not mechanism.motions and not self.turning,
            single=True,
            # A motion is named with what it drives: `m.x` may be another's name.
            constraints_given=tuple(row.parts for row in self.rows),
            until=table.until(self.elements),
        )

    def body(self, name: str, path: KeyPath) -> Body:
        bodies = self.mechanism.bodies
        if ("bodies", name) in self.broken:
            raise Follows
        if name not in bodies:
            raise self.unknown("body", name, path, bodies)
        return bodies[name]

    def site(self, name: str, path: KeyPath) -> Site:
        if ("points", name) in self.broken:
            raise Follows
        if name not in self.sites:
            raise self.unknown("point", name, path, self.sites)
        return self.sites[name]

    def _ends(
        self, start: str, end: str, path: KeyPath, keys: tuple[str, str] = ("from", "to")
    ) -> tuple[Site, Site]:
        """Both ends of a part; a mistake in one does not hide that in the other."""
        found = []
        for name, key in ((start, keys[0]), (end, keys[1])):
            with self.checked():
                found.append(self.site(name, (*path, key)))
        if len(found) < 2:
            raise Follows
        return found[0], found[1]

    def difference(
        self, start: str, end: str, path: KeyPath, keys: tuple[str, str] = ("from", "to")
    ) -> dict[str, complex]:
        """The vector from one point to another."""
        if start == end:
            raise self.document.error(path, f"joins {start} with itself")
        first, last = self._ends(start, end, path, keys)
        difference = last.minus(first)
        if not self._moves(difference):
            raise self.document.error(
                path, f"joins {start} and {end}, which cannot move relative to each other"
            )
        return difference

    def _moves(self, weights: Mapping[str, complex]) -> bool:
        return any(name in self.moving for name in weights)

    def distance(
        self, start: str, end: str, length: float, path: KeyPath, checked: bool = False
    ) -> None:
        """Two points keep a distance, which they have at the start; ``checked`` if it is known."""
        difference = self.difference(start, end, path)
        misfit = abs(self.vector(difference)) - length
        if not (checked or self.mechanism.assemble) and abs(misfit) > MISFIT * length:
            raise self.document.error(
                path,
                f"{start} and {end} start {builder.apart(length, misfit)} m apart, given length "
                f"{length:.16g}; correct the positions or set 'assemble: true'",
            )
        square, row = length * length, self.one_row(path)
        constants, terms = self.combination(difference)
        turned = any(complex(weight).imag != 0 for weight in difference.values())
        kind = elements.SQUARE if turned else elements.LINK
        if not turned:
            terms = [(place, weight) for place, weight, _ in terms]
        self.add(kind, terms, constants=constants, parameters=(square,), row=row, turned=turned)
        self.squares[row] = square

    def on_line(
        self, point: str, line: Slider | Line, path: KeyPath, point_path: KeyPath | None = None
    ) -> tuple[dict[str, complex], dict[str, complex]]:
        """Direction of a line, of length 1, and the vector from it to a point.

        Args:
            point: The point.
            line: The line, fixed or on a body.
            path: Where the line is given.
            point_path: Where the point is; with the line if omitted.
        """
        site = self.site(point, point_path or (*path, "point"))
        direction = complex(*line.direction) / abs(complex(*line.direction))
        through = complex(*line.through)
        if line.on is None:
            along, origin = {UNIT: direction}, Site({UNIT: through})
        else:
            body = self.body(line.on, (*path, "on"))
            turn = direction / body.length
            z = through / body.length
            along = self._joined({body.to: turn, body.from_: -turn})
            origin = Site({body.from_: 1 - z, body.to: z})
        away = site.minus(origin)
        if not (self._moves(along) or self._moves(away)):
            raise self.document.error(point_path or (*path, "point"), f"{point} is fixed")
        return along, away

    @staticmethod
    def _joined(weights: Mapping[str, complex]) -> dict[str, complex]:
        return {name: weight for name, weight in weights.items() if weight != 0}

    def require_on_line(self, point: str, away: float, size: float, path: KeyPath) -> None:
        """Raises DocumentError where a point starts off its line by ``away`` (m)."""
        if not self.mechanism.assemble and abs(away) > MISFIT * max(1.0, size):
            raise self.document.error(
                path,
                f"{point} starts {abs(away):.12g} m off the line; correct its position "
                "or set 'assemble: true'",
            )

    def require_contact(
        self, wheel: str, distance: float, asked: float, size: float, path: KeyPath
    ) -> None:
        """Raises DocumentError where a wheel starts at another distance than ``asked`` (m)."""
        if not self.mechanism.assemble and abs(distance - asked) > MISFIT * max(size, asked):
            raise self.document.error(
                path,
                f"{wheel} starts with its centre {distance:.12g} m away, its radius asks for "
                f"{asked:.12g} m; correct the positions or set 'assemble: true'",
            )

    def moving_site(self, name: str, path: KeyPath) -> dict[str, complex]:
        """A point that is not fixed."""
        weights = dict(self.site(name, path).weights)
        if not self._moves(weights):
            raise self.document.error(path, f"{name} is fixed")
        return weights

    def vector(self, weights: Mapping[str, complex]) -> complex:
        """Initial value of Σ (a + bR) P."""
        return sum((weight * self._start(name) for name, weight in weights.items()), 0j)

    def _start(self, name: str) -> complex:
        if name in self.fixed:
            return self.fixed[name]
        at = self.mechanism.points[name].at
        assert at is not None
        return complex(*at)

    # Angles that are coordinates.

    def direction(self, name: str, path: KeyPath) -> dict[str, complex]:
        """The vector from the first to the second point of a body, or (1, 0) of the ground."""
        if is_ground(name, self.mechanism):
            return {UNIT: 1 + 0j}
        body = self.body(name, path)
        return self.difference(body.from_, body.to, path)

    def angle(self, body: str, path: KeyPath) -> int:
        """Place in u of the angle of a body, which becomes a coordinate."""
        found = self.body(body, path)
        name = f"{body}.angle"
        if name in self.turning:
            return self.turning[name]
        difference = self.difference(found.from_, found.to, path)
        return self.angle_of(difference, ("bodies", body, "angle"), name)

    def angle_of(self, difference: Mapping[str, complex], path: KeyPath, name: str) -> int:
        """Place in u of the angle of a vector, a new coordinate with its constraint."""
        place = 2 * len(self.moving) + len(self.turning)
        self.turning[name] = place
        vector = self.vector(difference)
        velocities = {key: point.velocity for key, point in self.mechanism.points.items()}
        rate = sum(w * complex(*velocities[key]) for key, w in difference.items() if key != UNIT)
        turning = (vector.conjugate() * rate).imag / abs(vector) ** 2 if vector else 0.0
        self.start_angles.append((math.atan2(vector.imag, vector.real), turning))
        self.angular("COUPLE", difference, path, single=((place, 1.0),))
        return place

    def relative(
        self, start: str, end: str, path: KeyPath, keys: tuple[str, str] = ("from", "to")
    ) -> Angles:
        """The angle of a body minus that of another, or of the ground, which has none."""
        if start == end:
            raise self.document.error((*path, keys[1]), f"joins {end} with itself")
        last = ((self.angle(end, (*path, keys[1])), 1.0),)
        if is_ground(start, self.mechanism):
            return last
        return (*last, (self.angle(start, (*path, keys[0])), -1.0))

    def sum_of(self, angles: Angles) -> float:
        """A sum of angles at the start."""
        first = 2 * len(self.moving)
        return math.fsum(weight * self.start_angles[place - first][0] for place, weight in angles)

    # Elements.

    def combination(self, weights: Mapping[str, complex]) -> tuple[list[float], list[Term]]:
        """Σ (a + bR) P: what is constant of it, and its terms."""
        fixed = [
            weight * self.fixed[name] for name, weight in weights.items() if name in self.fixed
        ]
        offset = sum(fixed, 0j)
        moving = {self.moving[name]: w for name, w in weights.items() if name in self.moving}
        terms = [(place, complex(w).real, complex(w).imag) for place, w in moving.items()]
        return [offset.real, offset.imag], terms

    def add(self, kind: int, first: Sequence[Term] = (), **given: Any) -> None:
        """Add an element; its weights are turned unless it says otherwise."""
        self.elements.append(Element(kind, 2, first=first, **{"turned": True, **given}))

    def on_vector(
        self, kind: str, difference: Mapping[str, complex], parameters: Sequence[float],
        timed: Sequence[laws.Timed] = (),
    ) -> None:  # fmt: skip
        """Add a force that acts on a vector."""
        constants, terms = self.combination(difference)
        number = getattr(elements, kind)
        self.add(number, terms, constants=constants, parameters=parameters, timed=timed)

    def line(
        self,
        site: Mapping[str, complex],
        normal: complex,
        path: KeyPath,
        parameters: Sequence[float],
        law: Law | None = None,
    ) -> None:
        """Add the constraint n·P − law(t) = 0, of a site P that is linear in the coordinates."""
        constants, terms = self.combination(site)
        nx, ny = normal.real, normal.imag
        first, *others = parameters
        parameters = (first - (nx * constants[0] + ny * constants[1]), *others)
        single = [
            term
            for place, a, b in terms
            for term in ((place, a * nx + b * ny), (place + 1, a * ny - b * nx))
        ]
        self.elements.append(
            Element(
                elements.PRODUCT, 0, self.one_row(path), single=single, parameters=parameters,
                timed=() if law is None else (laws.Timed(law, parameters),),
            )
        )  # fmt: skip

    def angular(
        self, kind: str, difference: Mapping[str, complex], path: KeyPath, **given: Any
    ) -> None:
        """Add the constraint n·Δ = 0, n = (−sin θ, cos θ)."""
        constants, terms = self.combination(difference)
        constants = [0.0, 1.0, *constants, 1.0, 0.0]
        number, row = getattr(elements, kind), self.one_row(path)
        self.add(number, second=terms, constants=constants, row=row, **given)

    def pair(
        self,
        along: Mapping[str, complex],
        away: Mapping[str, complex],
        angles: Angles,
        constraint: KeyPath,
        parameters: Sequence[float] = (),
        law: Law | None = None,
    ) -> None:
        """Add the constraint D × Δ + Σ w θ − law(t) = 0.

        Args:
            along: D.
            away: Δ.
            angles: θ and w.
            constraint: Its name.
            parameters: A constant, or six of the law.
            law: The law.
        """
        # D × Δ is RD · Δ.
        one, first = self.combination({name: 1j * weight for name, weight in along.items()})
        other, second = self.combination(away)
        products = bool(along or away)
        self.elements.append(
            Element(
                elements.PRODUCT, 2 * products, self.one_row(constraint), first, second, angles,
                [*one, *other] * products, parameters, products,
                () if law is None else (laws.Timed(law, parameters),),
            )
        )  # fmt: skip

    def twist(self, angles: Angles, rest: float, stiffness: float, damping: float) -> None:
        """Add a torque −stiffness (q − rest) − damping q' of q = Σ w θ."""
        parameters = (rest, stiffness, damping)
        self.elements.append(Element(elements.TWIST, 0, single=angles, parameters=parameters))

    def push(self, given: str, points: Sequence[str], path: KeyPath) -> None:
        """Keep a force in Python on points, for what adds it to the problem."""
        sites = []
        for place, point in enumerate(points):
            with self.checked():
                sites.append(self.site(point, (*path, "on", place)))
        if len(sites) < len(points):
            raise Follows
        names = list(dict.fromkeys(n for site in sites for n in site.weights))
        moving = [name for name in names if name in self.moving]
        if not moving:
            raise self.document.error((*path, "on"), "must name a point that moves")
        weights = np.zeros((2 * len(sites), 2 * len(moving)))
        offsets = np.zeros(2 * len(sites))
        for k, site in enumerate(sites):
            for name, weight in site.weights.items():
                a, b = complex(weight).real, complex(weight).imag
                block = np.array([[a, -b], [b, a]])
                if name in self.fixed:
                    at = self.fixed[name]
                    offsets[2 * k : 2 * k + 2] += product(block, [at.real, at.imag])
                else:
                    j = 2 * moving.index(name)
                    weights[2 * k : 2 * k + 2, j : j + 2] = block
        coordinates = [self.moving[name] + c for name in moving for c in (0, 1)]
        self.pushes[path] = Push(given, coordinates, weights, offsets)

    def _require_points(self, body: Body, path: KeyPath) -> None:
        mechanism = self.mechanism
        for name, key in ((body.from_, "from"), (body.to, "to")):
            if name in mechanism.body_points and name not in mechanism.points:
                raise self.document.error(
                    (*path, key), f"{name} is itself fixed on a body; a body needs two of 'points'"
                )
        self._ends(body.from_, body.to, path)

    def _body_mass(self, name: str, body: Body, loads: Array, gravity: complex) -> None:
        along, across = body.centre
        mass, length, inertia = body.mass, body.length, body.inertia
        place = self.turning.get(f"{name}.angle")
        if place is not None and inertia > 0:
            # Half of it turns with the angle: as regular as before, and the same motion.
            inertia = inertia / 2
            self.mass[place, place] = inertia
        away = math.hypot(along, across)
        about_first = (inertia + mass * (away * away)) / (length * length)
        first = complex(mass - 2 * mass * along / length + about_first)
        mixed = complex(mass * along / length - about_first, mass * across / length)
        start, end = body.from_, body.to
        self._add_mass(start, start, first, loads, gravity)
        self._add_mass(start, end, mixed, loads, gravity)
        self._add_mass(end, start, mixed.conjugate(), loads, gravity)
        self._add_mass(end, end, complex(about_first), loads, gravity)

    def _add_mass(
        self, row: str, column: str, weight: complex, loads: Array, gravity: complex
    ) -> None:
        """Add the 2×2 block a + bR of M, and its share of the weight of the mechanism."""
        if row not in self.moving or weight == 0:
            return
        i = self.moving[row]
        share = weight * gravity
        loads[i : i + 2] += (share.real, share.imag)
        if column in self.moving:
            j = self.moving[column]
            a, b = weight.real, weight.imag
            for place, value in (
                ((i, j), a), ((i, j + 1), -b), ((i + 1, j), b), ((i + 1, j + 1), a)
            ):  # fmt: skip
                if value != 0:
                    self.mass[place] = self.mass.get(place, 0.0) + value
