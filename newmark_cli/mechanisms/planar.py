"""Planar mechanisms: points, two-point bodies, and parts that join or load them.

The coordinates are the positions of the moving points ("natural coordinates").
A body is carried by two points at constant distance, so it needs no angle, its
mass matrix is constant, and it brings one distance constraint.

Torsion springs, gears and wheels that roll count turns, which points cannot.  A body that one
of them names has its angle θ as a further coordinate behind those of the points, with one
more constraint n(θ)·Δ = 0, n = (−sin θ, cos θ), and half of its inertia; everything that acts
on angles is linear in them.  Other bodies keep to points.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from newmark_cli.mechanisms import builder, laws, models
from newmark_cli.mechanisms.builder import MISFIT, Follows, Sum
from newmark_cli.mechanisms.element_tables import Term
from newmark_cli.mechanisms.models import GROUND, Law, Mechanism
from newmark_cli.mechanisms.planar_outputs import Pins, PlanarOutputs, taken_apart
from newmark_cli.problems.problem import Place, Push
from newmark_cli.support.arrays import Array, IndexArray
from newmark_cli.support.documents import KeyPath

#: The constant vector (1, 0), as if it were a fixed point.
UNIT = "\0"

#: Coordinates of angles with their weights in a sum.
Angles = tuple[tuple[int, float], ...]
#: A combination of points: name → a + ib of the weight a + bR.
Weights = Mapping[str, complex]


def _minus(first: Weights, second: Weights) -> dict[str, complex]:
    """Weights of the difference of two combinations."""
    return {
        name: weight
        for name in dict.fromkeys((*second, *first))
        if (weight := first.get(name, 0) - second.get(name, 0)) != 0
    }


class PlanarBuilder(builder.Builder):
    """Turns a mechanism of the plane into the tables of the element loop."""

    model = Mechanism
    parts = (
        "points", "body_points", "bodies", "bars", "springs", "sliders", "motions", "dampers",
        "torques", "forces", "torsion_springs", "torsion_dampers", "angle_joints", "gears",
        "rolling", "python_forces",
    )  # fmt: skip
    components = 2
    mechanism: Mechanism

    def prepare(self) -> None:
        """Places of points."""
        points = self.mechanism.points
        self.moving: dict[str, int] = {}
        self.fixed: dict[str, complex] = {UNIT: 1 + 0j}
        #: Of all points.
        self.start: dict[str, complex] = {UNIT: 1 + 0j}
        self.sites: dict[str, dict[str, complex]] = {point: {point: 1} for point in points}
        #: Of the places of angles that are coordinates.
        self.turning_mass: dict[int, float] = {}
        #: Of angles that are coordinates, and their rates.
        self.start_angles: list[tuple[float, float]] = []
        if not self.broken and not any(point.at or not point.fixed for point in points.values()):
            self.mistakes.note(self.document.error(("points",), "no point moves"))

    def weigh(self) -> None:
        """Mass matrix, and gravity on it."""
        rows, columns, a, b = self._mass_blocks()
        gx, gy = self.mechanism.gravity
        self.loads = np.zeros((len(self.moving), 2))
        np.add.at(self.loads, rows // 2, np.stack([a * gx - b * gy, a * gy + b * gx], axis=1))
        here = columns >= 0
        i, j = rows[here, None] + [0, 0, 1, 1], columns[here, None] + [0, 1, 0, 1]
        values = np.stack([a, -b, b, a], axis=1)[here]
        there, angles = values != 0, np.array([*self.turning_mass], np.int64)
        places = np.stack([np.append(i[there], angles), np.append(j[there], angles)])
        n = 2 * len(self.moving) + len(self.turning)
        keys, slots = np.unique(places[0] * n + places[1], return_inverse=True)
        # Added up in this order.
        added = np.append(values[there], [*self.turning_mass.values()])
        sums = np.asarray(np.bincount(slots, added), float)
        self.mass = np.stack([keys // n, keys % n]), sums

    def _mass_blocks(self) -> tuple[IndexArray, IndexArray, Array, Array]:
        """Places in u of the 2×2 blocks a + bR of M, −1 for a fixed point's columns, a and b."""
        moving, bodies = self.moving, self.mechanism.bodies
        joined = [[moving.get(end, -1) for end in (of.from_, of.to)] for of in bodies.values()]
        starts, ends = np.array(joined, np.int64).reshape(-1, 2).T
        numbers = [
            (*body.centre, math.hypot(*body.centre), body.mass, body.length, body.inertia)
            for body in bodies.values()
        ]
        along, across, away, mass, length, inertia = np.array(numbers).reshape(-1, 6).T
        for k, name in enumerate(bodies):
            place = self.turning.get(f"{name}.angle")
            if place is not None and inertia[k] > 0:
                # Half of it turns with the angle: as regular as before, and the same motion.
                inertia[k] = self.turning_mass[place] = inertia[k] / 2
        about_first = (inertia + mass * (away * away)) / (length * length)
        first = mass - 2 * mass * along / length + about_first
        mixed, turned = mass * along / length - about_first, mass * across / length
        here, none = np.array([*moving.values()], np.int64), 0 * turned
        masses = np.array([self.mechanism.points[name].mass for name in moving])
        rows = np.append(np.stack([starts, starts, ends, ends], axis=1), here)
        columns = np.append(np.stack([starts, ends, starts, ends], axis=1), here)
        a = np.append(np.stack([first, mixed, mixed, about_first], axis=1), masses)
        b = np.append(np.stack([none, turned, -turned, none], axis=1), 0 * masses)
        kept = (rows >= 0) & ((a != 0) | (b != 0))
        return rows[kept], columns[kept], a[kept], b[kept]

    def position(self) -> Array:
        """(n,) coordinates: moving points, and angles behind them."""
        at = [part for name in self.moving for part in self.mechanism.points[name].at or ()]
        return np.array(at + [angle for angle, _ in self.start_angles])

    def velocities(self, u: Array) -> Array:
        """(n,) velocities that the file gives, wherever the points are."""
        velocity = [part for name in self.moving for part in self.mechanism.points[name].velocity]
        return np.array(velocity + [rate for _, rate in self.start_angles])

    def described(self, kept: Sequence[int], shared: frozenset[str]) -> Mapping[str, Any]:
        """Its points and angles."""
        places = {
            name: self._place(site) for name, site in self.sites.items() if name not in self.moving
        }
        wanted, pins = self.wanted(places), self._pins
        return {
            "points_given": tuple(self.moving),
            "coordinates_given": tuple(self.turning),
            "places": places,
            "outputs": PlanarOutputs(wanted, pins) if wanted or pins else None,
        }

    def _place(self, site: Weights) -> Place:
        constant, terms = self.combination(site)
        coordinates = [place + c for place, _, _ in terms for c in (0, 1)]
        weights = np.array([[(a, -b), (b, a)] for _, a, b in terms]).reshape(-1, 2, 2)
        blocks = np.transpose(weights, (1, 0, 2)).reshape(2, -1)
        return Place(np.array(coordinates, np.int64), blocks, np.array(constant))

    @cached_property
    def _pins(self) -> Pins | None:
        if "pins" not in self.mechanism.outputs or not self.mechanism.bodies:
            return None
        apart = PlanarBuilder(self.name, self.document, taken_apart(self.mechanism)).problem()
        named = {
            f"{name}.{c}": at + i for name, at in self.moving.items() for i, c in enumerate("xy")
        }
        return Pins.of(self.mechanism, apart, {**named, **self.turning}, self.mass)

    def without_inertia(self, u: Array, motions: Array) -> list[tuple[KeyPath, str]]:
        """Points that move without inertia, as words of errors."""
        sizes = np.abs(motions).max(axis=1)
        names = [*(name for name in self.moving for _ in "xy"), *self.turning]
        points = dict.fromkeys(names[k] for k in np.flatnonzero(sizes > 1e-6 * sizes.max()))
        message = "carries no mass of its own; the mass matrix is singular"
        return [(("points", point), f"{point} {message}") for point in points]

    # -- vectors ---------------------------------------------------------------------------------

    def site(self, name: str, path: KeyPath) -> Weights:
        """A point as Σ (a + bR) P over others."""
        return self.known("points", name, path, self.sites)

    def difference(
        self, start: str, end: str, path: KeyPath, keys: tuple[str, str] = ("from", "to")
    ) -> Weights:
        """The vector from one point to another."""
        if start == end:
            raise self.document.error(path, f"joins {start} with itself")
        first, last = self.both(self.site, start, end, path, keys)
        difference = _minus(last, first)
        if not self._moves(difference):
            raise self.document.error(
                path, f"joins {start} and {end}, which cannot move relative to each other"
            )
        return difference

    def arm(self, body: str, path: KeyPath) -> Weights:
        """The vector between the points of a body."""
        part = self.known("bodies", body, path, self.mechanism.bodies)
        return self.difference(part.from_, part.to, path)

    def between(self, start: str, end: str, path: KeyPath) -> Sum:
        """The same as constant and terms."""
        return self.combination(self.difference(start, end, path))

    def _moves(self, weights: Weights) -> bool:
        return any(name in self.moving for name in weights)

    def moving_site(self, name: str, path: KeyPath) -> Weights:
        """A point that is not fixed."""
        site = self.site(name, path)
        if not self._moves(site):
            raise self.document.error(path, f"{name} is fixed")
        return site

    def vector(self, weights: Weights) -> complex:
        """Initial value of Σ (a + bR) P."""
        return sum((weight * self.start[name] for name, weight in weights.items()), 0j)

    def combination(self, weights: Weights) -> Sum:
        """Σ (a + bR) P: what is constant of it, and its terms."""
        fixed = [
            weight * self.fixed[name] for name, weight in weights.items() if name in self.fixed
        ]
        offset = sum(fixed, 0j)
        moving = {self.moving[name]: w for name, w in weights.items() if name in self.moving}
        terms = [(place, complex(w).real, complex(w).imag) for place, w in moving.items()]
        return Sum([offset.real, offset.imag], terms)

    # -- angles, which are coordinates where something counts turns --------------------------------

    def is_ground(self, name: str) -> bool:
        """Whether what parts of angles name is the ground, and no body of that name."""
        return name == GROUND and name not in self.mechanism.bodies

    def angle(self, body: str, path: KeyPath) -> int:
        """Place in u of the angle of a body, which becomes a coordinate."""
        name = f"{body}.angle"
        if name in self.turning:
            return self.turning[name]
        return self.angle_of(self.arm(body, path), ("bodies", body, "angle"), name)

    def angle_of(self, difference: Weights, path: KeyPath, name: str) -> int:
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
        if self.is_ground(start):
            return last
        return (*last, (self.angle(start, (*path, keys[0])), -1.0))

    def sum_of(self, angles: Angles) -> float:
        """A sum of angles at the start."""
        first = 2 * len(self.moving)
        return math.fsum(weight * self.start_angles[place - first][0] for place, weight in angles)

    # -- rows ------------------------------------------------------------------------------------

    def distance(self, start: str, end: str, length: float, path: KeyPath) -> float:
        """Add the constraint that two points keep a distance; returns how far they start off it."""
        difference = self.difference(start, end, path)
        row = self.one_row(path)
        self.squares[row] = length * length
        self.add("SQUARE", self.combination(difference), row=row, parameters=(length * length,))
        return abs(self.vector(difference)) - length

    def line(
        self, site: Weights, normal: complex, path: KeyPath, parameters: Sequence[float],
        law: Law | None = None,
    ) -> None:  # fmt: skip
        """Add the constraint n·P − law(t) = 0, of a site P that is linear in the coordinates."""
        offset, single = self.component(site, normal)
        first, *others = parameters
        parameters = (first - offset, *others)
        self.add("PRODUCT", row=self.one_row(path), single=single, parameters=parameters, law=law)

    def component(self, site: Weights, normal: complex) -> tuple[float, list[Term]]:
        """n·P of a site P: what is constant of it, and its terms."""
        constants, terms = self.combination(site)
        nx, ny = normal.real, normal.imag
        single = [
            term
            for place, a, b in terms
            for term in ((place, a * nx + b * ny), (place + 1, a * ny - b * nx))
        ]
        return nx * constants[0] + ny * constants[1], single

    def angular(self, kind: str, difference: Weights, path: KeyPath, **arguments: Any) -> None:
        """Add the constraint n·Δ = 0, n = (−sin θ, cos θ)."""
        # (0, 1) and (1, 0) turn into n, number by number.
        sums = Sum([0.0, 1.0, 1.0, 0.0], ()), self.combination(difference)
        self.add(kind, *sums, row=self.one_row(path), **arguments)

    def pair(
        self, along: Weights, away: Weights, angles: Angles, constraint: KeyPath,
        parameters: Sequence[float] = (), law: Law | None = None,
    ) -> None:  # fmt: skip
        """Add the constraint D × Δ + Σ w θ − law(t) = 0; D is along, Δ away, θ and w the angles."""
        # D × Δ is RD · Δ.
        turned = {name: 1j * weight for name, weight in along.items()}
        sums = [self.combination(turned), self.combination(away)] * bool(along or away)
        row = self.one_row(constraint)
        self.add("PRODUCT", *sums, row=row, single=angles, parameters=parameters, law=law)

    # -- points and bodies -----------------------------------------------------------------------

    def _points(self, point: models.Point, path: KeyPath) -> None:
        if (point.fixed is None) == (point.at is None):
            message = "needs either 'fixed' or 'at', the initial position"
            raise self.document.error(path, message)
        name = str(path[1])
        if point.fixed is not None:
            self.fixed[name] = self.start[name] = complex(*point.fixed)
        elif point.at is not None:
            self.moving[name], self.start[name] = 2 * len(self.moving), complex(*point.at)

    def _body_points(self, point: models.BodyPoint, path: KeyPath) -> None:
        body = self.known("bodies", point.on, (*path, "on"), self.mechanism.bodies)
        if not {body.from_, body.to} <= self.moving.keys() | self.fixed.keys():
            raise Follows
        z = complex(*point.at) / body.length
        self.sites[str(path[1])] = {body.from_: 1 - z, body.to: z}

    def _bodies(self, body: models.Body, path: KeyPath) -> None:
        mechanism = self.mechanism
        for name, key in ((body.from_, "from"), (body.to, "to")):
            if name in mechanism.body_points and name not in mechanism.points:
                raise self.document.error(
                    (*path, key), f"{name} is itself fixed on a body; a body needs two of 'points'"
                )
        self._bars(body, path)

    # -- parts -----------------------------------------------------------------------------------

    def _bars(self, bar: models.Bar | models.Body, path: KeyPath) -> None:
        """A constant distance: ½ (|Δ|² − L²) = 0."""
        misfit = self.distance(bar.from_, bar.to, bar.length, path)
        self.require_length(f"{bar.from_} and {bar.to}", misfit, bar.length, path)

    def _on_line(
        self, point: str, line: models.Line, path: KeyPath, point_path: KeyPath
    ) -> tuple[Weights, Weights]:
        """Direction of a line, of length 1, and the vector from it to a point."""
        site = self.site(point, point_path)
        direction = complex(*line.direction) / abs(complex(*line.direction))
        through = complex(*line.through)
        along, origin = {UNIT: direction}, {UNIT: through}
        if line.on is not None:
            body = self.known("bodies", line.on, (*path, "on"), self.mechanism.bodies)
            turn, z = direction / body.length, through / body.length
            along, origin = {body.to: turn, body.from_: -turn}, {body.from_: 1 - z, body.to: z}
        away = _minus(site, origin)
        if not (self._moves(along) or self._moves(away)):
            raise self.document.error(point_path, f"{point} is fixed")
        return along, away

    def _sliders(self, slider: models.Slider, path: KeyPath) -> None:
        """A point on a line: n·Δ = 0; on a body d × Δ = 0, both of them moving."""
        point_path, size = (*path, "point"), abs(complex(*slider.through))
        if slider.on is not None:
            along, away = self._on_line(slider.point, slider, path, point_path)
            arm = self.vector(away)
            off, size = (self.vector(along).conjugate() * arm).imag, abs(arm)
        else:
            normal = 1j * (complex(*slider.direction) / abs(complex(*slider.direction)))
            site = self.moving_site(slider.point, point_path)
            level = (normal.conjugate() * complex(*slider.through)).real
            off = (normal.conjugate() * self.vector(site)).real - level
        message = f"{slider.point} starts {abs(off):.12g} m off the line"
        self.require(off, MISFIT * max(1.0, size), path, message, "its position")
        if slider.on is not None:
            self.pair(along, away, (), path)
        else:
            self.line(site, normal, path, (level,))

    def _motions(self, motion: models.Motion, path: KeyPath) -> None:
        """A law of time: of a place, of an angle or between two, or along a line."""
        key, law = next(iter(motion.driven.items()))
        law_path = (*path, key)
        if motion.point is not None:
            site = self.moving_site(motion.point, (*path, "point"))
            for key, law in motion.driven.items():
                normal = 1 + 0j if key == "x" else 1j
                now = (normal.conjugate() * self.vector(site)).real
                with self.checked():
                    parameters = self.fitting(law, now, (*path, key))
                    self.line(site, normal, (*path, key), parameters, law)
        elif motion.slider is not None:
            sliders = self.mechanism.sliders
            slider = self.known("sliders", motion.slider, (*path, "slider"), sliders)
            of_slider = ("sliders", motion.slider)
            along, away = self._on_line(slider.point, slider, of_slider, (*of_slider, "point"))
            now = (self.vector(along).conjugate() * self.vector(away)).real
            # D × Δ with −iD in place of D is D · Δ.
            turned = {name: -1j * weight for name, weight in along.items()}
            self.pair(turned, away, (), law_path, self.fitting(law, now, law_path), law)
        elif motion.relative_to is not None:
            assert motion.body is not None
            self.known("bodies", motion.body, (*path, "body"), self.mechanism.bodies)
            names = motion.relative_to, motion.body
            angles = self.relative(*names, path, ("relative_to", "body"))
            now = self.sum_of(angles)
            first, *others = self.fitting(law, now, law_path, 2 * math.pi)
            # The law may begin some turns away from the coordinates.
            turns = round((now - laws.begin(law, first)) / (2 * math.pi))
            self.pair({}, {}, angles, law_path, (first + 2 * math.pi * turns, *others), law)
        else:
            assert motion.body is not None
            difference = self.arm(motion.body, (*path, "body"))
            vector = self.vector(difference)
            now = math.atan2(vector.imag, vector.real)
            parameters = self.fitting(law, now, law_path, 2 * math.pi)
            self.angular("ANGLE", difference, law_path, parameters=parameters, law=law)

    def _torques(self, torque: models.Torque, path: KeyPath) -> None:
        """A torque τ(t) on a body, the opposite one on another."""
        if torque.from_ == torque.on:
            raise self.document.error((*path, "from"), f"must be another body than {torque.on}")
        law = torque.torque if isinstance(torque.torque, Law) else None
        for name, key, sign in ((torque.on, "on", 1.0), (torque.from_, "from", -1.0)):
            with self.checked():
                if name is None:
                    continue
                between = self.combination(self.arm(name, (*path, key)))
                constant = 0.0 if isinstance(torque.torque, Law) else sign * torque.torque
                timed = [] if law is None else [laws.Timed(law, law.parameters(), 0, sign)]
                self.add("TORQUE", between, parameters=(constant,), timed=timed)

    def _forces(self, force: models.Force, path: KeyPath) -> None:
        """A force F(t) at a point."""
        site = self.moving_site(force.at, (*path, "at"))
        for amount, normal in zip(force.force, (1 + 0j, 1j), strict=True):
            if amount != 0:
                law = amount if isinstance(amount, Law) else Law(value=amount)
                _, single = self.component(site, normal)
                self.add("FORCE", single=single, parameters=law.parameters(), law=law)

    def _torsion_springs(self, spring: models.TorsionSpring, path: KeyPath) -> None:
        angles = self.relative(spring.from_, spring.to, path)
        rest = counted = self.sum_of(angles)
        if spring.rest_angle is not None:
            # The file counts from an angle within ±π, the coordinates perhaps from another turn.
            rest = spring.rest_angle + 2 * math.pi * round(counted / (2 * math.pi))
        self.add("TWIST", single=angles, parameters=(rest, spring.stiffness, 0.0))

    def _torsion_dampers(self, damper: models.TorsionDamper, path: KeyPath) -> None:
        angles = self.relative(damper.from_, damper.to, path)
        self.add("TWIST", single=angles, parameters=(0.0, 0.0, damper.damping))

    def _angle_joints(self, joint: models.AngleJoint, path: KeyPath) -> None:
        """A constant angle: (Δ_a turned by φ) × Δ_b = 0."""
        if joint.from_ == joint.to:
            raise self.document.error((*path, "to"), f"joins {joint.to} with itself")

        def direction(name: str, key: str) -> Weights:
            if self.is_ground(name):
                return {UNIT: 1 + 0j}
            return self.arm(name, (*path, key))

        end, start = direction(joint.to, "to"), direction(joint.from_, "from")
        turn = self.vector(end) / self.vector(start)
        now = math.atan2(turn.imag, turn.real)
        angle = now if joint.angle is None else joint.angle
        message = f"{joint.to} starts at {now:.12g} rad to {joint.from_}, given {angle:g}"
        self.require(math.remainder(angle - now, 2 * math.pi), 1e-9, path, message)
        turned = complex(math.cos(angle), math.sin(angle))
        self.pair({name: turned * weight for name, weight in start.items()}, end, (), path)

    def _gears(self, gear: models.Gear, path: KeyPath) -> None:
        """Turns in a ratio, counted from the start: θ_b − ψ = i (θ_a − ψ), Willis' equation."""
        angles = [(self.angle(gear.to, (*path, "to")), 1.0)]
        angles.append((self.angle(gear.from_, (*path, "from")), -gear.ratio))
        if gear.on is not None and gear.ratio != 1:
            angles.append((self.angle(gear.on, (*path, "on")), gear.ratio - 1.0))
        self.pair({}, {}, tuple(angles), path, (self.sum_of(tuple(angles)),))

    def _rolling(self, rolling: models.Rolling, path: KeyPath) -> None:
        """Contact and rolling without slip, on a line or on a circle.

        On a line d × Δ = ±r and d·Δ ± r (θ − ψ) is constant; on a circle |Δ| = R ± r, and
        (R ± r) ψ − R θ_b ∓ r θ is constant, with ψ the angle of the line of centres.
        """
        body = self.known("bodies", rolling.wheel, (*path, "wheel"), self.mechanism.bodies)
        centre = rolling.centre or body.from_
        centre_path = (*path, "wheel" if rolling.centre is None else "centre")
        contact, no_slip, radius = (*path, "contact"), (*path, "rolling"), rolling.radius

        def require(distance: float, required: float, size: float) -> None:
            message = (
                f"{rolling.wheel} starts with its centre {distance:.12g} m away, its radius asks "
                f"for {required:.12g} m"
            )
            self.require(distance - required, MISFIT * max(size, required), path, message)

        if (line := rolling.line) is not None:
            along, away = self._on_line(centre, line, (*path, "line"), centre_path)
            start, arm = self.vector(along), self.vector(away)
            off = (start.conjugate() * arm).imag
            side = math.copysign(1.0, off)
            require(abs(off), radius, abs(arm))
            self.pair(along, away, (), contact, (side * radius,))
            angles = [(self.angle(rolling.wheel, (*path, "wheel")), side * radius)]
            if line.on is not None:
                angles.append((self.angle(line.on, (*path, "line", "on")), -side * radius))
            turned = {name: -1j * weight for name, weight in along.items()}
            now = (start.conjugate() * arm).real + self.sum_of(tuple(angles))
            self.pair(turned, away, tuple(angles), no_slip, (now,))
            return
        circle = rolling.circle
        assert circle is not None
        signed = -radius if circle.inside else radius
        keys = ("circle", str(centre_path[-1]))
        difference = self.difference(circle.centre, centre, path, keys)
        distance = circle.radius + signed
        require(abs(self.vector(difference)), distance, distance)
        self.distance(circle.centre, centre, distance, contact)
        name = ".".join(map(str, (*path, "angle")))
        angles = [(self.angle_of(difference, (*path, "angle"), name), distance)]
        angles.append((self.angle(rolling.wheel, (*path, "wheel")), -signed))
        if circle.body is not None:
            angles.append((self.angle(circle.body, (*path, "circle", "body")), -circle.radius))
        self.pair({}, {}, tuple(angles), no_slip, (self.sum_of(tuple(angles)),))

    def _python_forces(self, force: models.PythonForce, path: KeyPath) -> None:
        """Keep forces F(P, P', t) to be added to the problem later."""
        sites = []
        for place, point in enumerate(force.on):
            with self.checked():
                sites.append(self.site(point, (*path, "on", place)))
                if "pins" in self.mechanism.outputs and point in self.mechanism.body_points:
                    text = f"{point} is on a body, whose pins then cannot be told from this force"
                    raise self.document.error((*path, "on", place), f"{text}; see 'outputs'")
        if len(sites) < len(force.on):
            raise Follows
        sums = [self.combination(site) for site in sites]
        places = list(dict.fromkeys(place for of in sums for place, _, _ in of.terms))
        if not places:
            raise self.document.error((*path, "on"), "must name a point that moves")
        weights = np.zeros((2 * len(sums), 2 * len(places)))
        for k, of in enumerate(sums):
            for place, a, b in of.terms:
                j = 2 * places.index(place)
                weights[2 * k : 2 * k + 2, j : j + 2] = [[a, -b], [b, a]]
        coordinates = [place + c for place in places for c in (0, 1)]
        offsets = np.array([of.constant for of in sums]).ravel()
        self.pushes[path] = Push(force.python, coordinates, weights, offsets)
