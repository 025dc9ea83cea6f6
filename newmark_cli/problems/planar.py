"""Planar mechanisms as data: points, two-point bodies, springs, torques, gravity.

The coordinates are the positions of the moving points ("natural coordinates").
A body is carried by two points at constant distance, so it needs no angle, its
mass matrix is constant, and it brings one distance constraint.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, FiniteFloat

from newmark_cli import documents
from newmark_cli.arrays import Array
from newmark_cli.documents import Document, StrictModel
from newmark_cli.problems import elements
from newmark_cli.problems.problem import Pattern, Problem

Vector = tuple[FiniteFloat, FiniteFloat]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

#: Largest |Φ| of a bar at the start, relative to L²: the data are rounded numbers.
_MISFIT = 1e-12


class Point(StrictModel):
    """A fixed or a moving point; SI units."""

    fixed: Vector | None = Field(None, description="position of a fixed point (m)")
    at: Vector | None = Field(None, description="initial position of a moving point (m)")
    velocity: Vector = Field((0.0, 0.0), description="initial velocity of a moving point (m/s)")
    mass: NotNegative = Field(0.0, description="point mass (kg)")


class Body(StrictModel):
    """A rigid body carried by two points at constant distance."""

    from_: str = Field(alias="from", description="first point")
    to: str = Field(description="second point")
    length: Positive = Field(description="distance of the two points (m)")
    mass: NotNegative = Field(description="mass (kg)")
    centre: Vector = Field(
        (0.0, 0.0), description="mass centre along and across, from the first point (m)"
    )
    inertia: NotNegative = Field(description="moment of inertia about the mass centre (kg m²)")


class BodyPoint(StrictModel):
    """A point fixed on a body."""

    on: str = Field(description="body")
    at: Vector = Field(description="place along and across, from the body's first point (m)")


class Bar(StrictModel):
    """A massless bar: a constant distance."""

    from_: str = Field(alias="from", description="one end")
    to: str = Field(description="other end")
    length: Positive = Field(description="length (m)")


class Spring(StrictModel):
    """A linear spring between two points."""

    from_: str = Field(alias="from", description="one end")
    to: str = Field(description="other end")
    stiffness: NotNegative = Field(description="stiffness (N/m)")
    rest_length: NotNegative = Field(description="length without force (m)")


class Torque(StrictModel):
    """A constant torque on a body."""

    on: str = Field(description="body")
    torque: FiniteFloat = Field(description="torque, counter-clockwise (N m)")


class Mechanism(StrictModel):
    """A mechanism file."""

    title: str = ""
    source: str = ""
    points: dict[str, Point]
    bodies: dict[str, Body] = {}
    body_points: dict[str, BodyPoint] = {}
    bars: dict[str, Bar] = {}
    springs: dict[str, Spring] = {}
    torques: dict[str, Torque] = {}
    gravity: Vector = Field((0.0, 0.0), description="acceleration of gravity (m/s²)")


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


def load(path: Path, name: str) -> Problem:
    """Problem from a mechanism file.

    Args:
        path: YAML file.
        name: Name of the problem.

    Raises:
        DocumentError: Names file, line and key of the first mistake.
    """
    document = documents.read(path)
    return _Builder(name, document, documents.validate(document, Mechanism)).problem()


class _Builder:
    """Turns a mechanism into the tables of the element loop."""

    def __init__(self, name: str, document: Document, mechanism: Mechanism) -> None:
        self.name = name
        self.document = document
        self.mechanism = mechanism
        self.moving: dict[str, int] = {}
        self.fixed: dict[str, complex] = {}
        for point, given in mechanism.points.items():
            if (given.fixed is None) == (given.at is None):
                raise document.error(
                    ("points", point), "needs either 'fixed' or 'at', the initial position"
                )
            if given.fixed is not None:
                self.fixed[point] = complex(*given.fixed)
            else:
                self.moving[point] = 2 * len(self.moving)
        self.sites = {point: Site({point: 1}) for point in mechanism.points}
        for point, on_body in mechanism.body_points.items():
            body = self._named("bodies", on_body.on, ("body_points", point, "on"))
            z = complex(*on_body.at) / body.length
            self.sites[point] = Site({body.from_: 1 - z, body.to: z})
        self.ints: list[list[int]] = []
        self.reals: list[list[float]] = []
        self.x_entries: list[tuple[int, int]] = []
        self.g_entries: list[tuple[int, int]] = []
        self.mass: dict[tuple[int, int], float] = {}
        self.constraints = 0

    def problem(self) -> Problem:
        mechanism = self.mechanism
        n = 2 * len(self.moving)
        if n == 0:
            raise self.document.error(("points",), "no point moves")
        loads = np.zeros(n)
        gravity = complex(*mechanism.gravity)
        for name, body in mechanism.bodies.items():
            self._body_mass(body, loads, gravity, ("bodies", name))
            self._distance(body.from_, body.to, body.length, ("bodies", name))
        for name, point in mechanism.points.items():
            self._add_mass(name, name, complex(point.mass), loads, gravity)
        for name, bar in mechanism.bars.items():
            self._distance(bar.from_, bar.to, bar.length, ("bars", name))
        for name, spring in mechanism.springs.items():
            self._element(
                elements.SPRING,
                self._difference(spring.from_, spring.to, ("springs", name)),
                (spring.stiffness, spring.rest_length),
            )
        for name, torque in mechanism.torques.items():
            body = self._named("bodies", torque.on, ("torques", name, "on"))
            self._element(
                elements.TORQUE,
                self._difference(body.from_, body.to, ("torques", name)),
                (torque.torque, 0.0),
            )
        for i in range(0, n, 2):
            if np.any(loads[i : i + 2]):
                row = [elements.LOAD, 1, i, 0, 0, 0, 0, 0, 0]
                self.ints.append(row)
                self.reals.append([0.0] * elements.PARAMETER + [loads[i], loads[i + 1]])

        x = np.array(self.x_entries, np.int64).reshape(-1, 2).T.copy()
        g = np.array(self.g_entries, np.int64).reshape(-1, 2).T.copy()
        mass = np.array(sorted(self.mass), np.int64).reshape(-1, 2).T.copy()
        none = np.zeros(0, np.int64)
        points = [mechanism.points[name] for name in self.moving]
        return Problem(
            name=self.name,
            u0=np.array([c for point in points for c in point.at or ()]),
            v0=np.array([c for point in points for c in point.velocity]),
            t0=0.0,
            constraints=self.constraints,
            function=elements.evaluate,
            curvature_function=elements.constraint_curvature,
            ints=np.array(self.ints, np.int64).reshape(-1, elements.INT_COLUMNS),
            reals=np.array(self.reals, float).reshape(-1, elements.REAL_COLUMNS),
            pattern=Pattern(mass[0], mass[1], x[0], x[1], none, none, g[0], g[1]),
            mass_values=np.array([self.mass[place] for place in sorted(self.mass)]),
            drawing=mechanism,
        )

    def _named(self, kind: str, name: str, path: documents.KeyPath) -> Body:
        bodies: dict[str, Body] = getattr(self.mechanism, kind)
        if name not in bodies:
            raise self.document.error(
                path, f"unknown body {name!r}{documents.nearest(name, bodies)}"
            )
        return bodies[name]

    def _site(self, name: str, path: documents.KeyPath) -> Site:
        if name not in self.sites:
            raise self.document.error(
                path, f"unknown point {name!r}{documents.nearest(name, self.sites)}"
            )
        return self.sites[name]

    def _difference(self, start: str, end: str, path: documents.KeyPath) -> dict[str, complex]:
        difference = self._site(end, (*path, "to")).minus(self._site(start, (*path, "from")))
        if not any(name in self.moving for name in difference):
            raise self.document.error(path, f"joins {start} and {end}, which do not move apart")
        return difference

    def _distance(self, start: str, end: str, length: float, path: documents.KeyPath) -> None:
        difference = self._difference(start, end, path)
        vector = sum(weight * self._start(name) for name, weight in difference.items())
        misfit = abs(vector) - length
        if abs(misfit) > _MISFIT * length:
            raise self.document.error(
                path, f"{start} and {end} start {abs(vector):.12g} m apart, given length {length:g}"
            )
        plain = all(complex(weight).imag == 0 for weight in difference.values())
        kind = elements.LINK if plain else elements.BAR
        self._element(kind, difference, (length**2, 0.0), constraint=True)

    def _start(self, name: str) -> complex:
        if name in self.fixed:
            return self.fixed[name]
        at = self.mechanism.points[name].at
        assert at is not None
        return complex(*at)

    def _element(
        self,
        kind: int,
        difference: Mapping[str, complex],
        parameters: tuple[float, float],
        constraint: bool = False,
    ) -> None:
        offset = sum(
            (w * self.fixed[name] for name, w in difference.items() if name in self.fixed), 0j
        )
        moving = {name: w for name, w in difference.items() if name in self.moving}
        dofs = [self.moving[name] for name in moving]
        row = self.constraints if constraint else 0
        self.ints.append(
            [kind, len(dofs), *dofs, *[0] * (4 - len(dofs)), row,
             len(self.x_entries), len(self.g_entries)]
        )  # fmt: skip
        weights = [part for w in moving.values() for part in (complex(w).real, complex(w).imag)]
        self.reals.append(
            [*weights, *[0.0] * (8 - len(weights)), offset.real, offset.imag, *parameters]
        )
        places = ((0, 0), (1, 1)) if kind == elements.LINK else ((0, 0), (0, 1), (1, 0), (1, 1))
        self.x_entries += [(i + r, j + c) for i in dofs for j in dofs for r, c in places]
        if constraint:
            self.g_entries += [(i + r, row) for i in dofs for r in (0, 1)]
            self.constraints += 1

    def _body_mass(
        self, body: Body, loads: Array, gravity: complex, path: documents.KeyPath
    ) -> None:
        for name, key in ((body.from_, "from"), (body.to, "to")):
            self._site(name, (*path, key))
            if name not in self.mechanism.points:
                raise self.document.error((*path, key), f"{name} is itself fixed on a body")
        along, across = body.centre
        mass, length = body.mass, body.length
        about_first = (body.inertia + mass * math.hypot(along, across) ** 2) / length**2
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
