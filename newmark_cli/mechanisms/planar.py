"""Planar mechanisms as data: points, two-point bodies, springs, torques, gravity.

The coordinates are the positions of the moving points ("natural coordinates").
A body is carried by two points at constant distance, so it needs no angle, its
mass matrix is constant, and it brings one distance constraint.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from newmark_cli import documents
from newmark_cli.arrays import Array
from newmark_cli.documents import Document, DocumentError, KeyPath
from newmark_cli.mechanisms import elements, start
from newmark_cli.mechanisms.models import Body, Law, Mechanism, Motion, Slider
from newmark_cli.problems.problem import Elements, Pattern, Problem
from newmark_cli.spelling import nearest

#: Largest |Φ| of a bar at the start, relative to L²: the data are rounded numbers.
_MISFIT = 1e-12


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


def built(name: str, document: Document) -> Problem:
    """Problem from a mechanism file that was read.

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
    return build(name, mechanism, document)


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
    _Builder(name, document, mechanism, broken).problem()


#: Keys of a mechanism whose values are parts by name.
_PARTS = (
    "points", "bodies", "body_points", "bars", "sliders", "motions", "springs", "dampers",
    "torques",
)  # fmt: skip
_OTHERS = Mechanism.model_fields.keys() - set(_PARTS)


def build(name: str, mechanism: Mechanism, document: Document | None = None) -> Problem:
    """Problem from a mechanism.

    Args:
        name: Name of the problem.
        mechanism: The mechanism.
        document: Where it came from, for errors.

    Raises:
        DocumentError: See `load`.
    """
    document = document or Document(name, {}, {})
    builder = _Builder(name, document, mechanism)
    return start.consistent(builder.problem(), mechanism, document, builder.constraint_paths)


class _Follows(Exception):
    """A part cannot be built because of a mistake that is known already."""


class _Builder:
    """Turns a mechanism into the tables of the element loop.

    A mistake in one part does not keep the others from being looked at; `problem` raises
    all of them together.
    """

    def __init__(
        self,
        name: str,
        document: Document,
        mechanism: Mechanism,
        broken: Collection[tuple[str, str]] = (),
    ) -> None:
        self.name = name
        self.document = document
        self.mechanism = mechanism
        self.mistakes = documents.Mistakes()
        #: Points and bodies with a mistake: a reference to them is not another mistake.
        self.broken: set[tuple[str, ...]] = set(broken)
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
            with self._checked("points", point):
                body = self._body(on_body.on, ("body_points", point, "on"))
                if not {body.from_, body.to} <= self.moving.keys() | self.fixed.keys():
                    raise _Follows
                z = complex(*on_body.at) / body.length
                self.sites[point] = Site({body.from_: 1 - z, body.to: z})
        self.ints: list[list[int]] = []
        self.reals: list[list[float]] = []
        self.constraint_paths: list[KeyPath] = []
        self.x_entries: list[tuple[int, int]] = []
        self.y_entries: list[tuple[int, int]] = []
        self.g_entries: list[tuple[int, int]] = []
        self.mass: dict[tuple[int, int], float] = {}

    @contextmanager
    def _checked(self, *broken: str) -> Iterator[None]:
        """Take up a mistake of the block, which ends there; kind and name are then broken."""
        try:
            yield
        except (DocumentError, _Follows) as error:
            if isinstance(error, DocumentError):
                self.mistakes.note(error)
            if broken:
                self.broken.add(broken)

    def problem(self) -> Problem:
        mechanism = self.mechanism
        n = 2 * len(self.moving)
        if n == 0 and not self.broken:
            self.mistakes.note(self.document.error(("points",), "no point moves"))
        loads = np.zeros(n)
        gravity = complex(*mechanism.gravity)
        for name, body in mechanism.bodies.items():
            with self._checked("bodies", name):
                self._body_mass(body, loads, gravity, ("bodies", name))
                self._distance(body.from_, body.to, body.length, ("bodies", name))
        for name, point in mechanism.points.items():
            self._add_mass(name, name, complex(point.mass), loads, gravity)
        for name, bar in mechanism.bars.items():
            with self._checked():
                self._distance(bar.from_, bar.to, bar.length, ("bars", name))
        for name, spring in mechanism.springs.items():
            with self._checked():
                self._element(
                    elements.SPRING,
                    self._difference(spring.from_, spring.to, ("springs", name)),
                    (spring.stiffness, spring.rest_length),
                )
        for name, slider in mechanism.sliders.items():
            with self._checked():
                self._slider(slider, ("sliders", name))
        for name, motion in mechanism.motions.items():
            with self._checked():
                self._motion(motion, ("motions", name))
        for name, damper in mechanism.dampers.items():
            with self._checked():
                self._element(
                    elements.DAMPER,
                    self._difference(damper.from_, damper.to, ("dampers", name)),
                    (damper.damping,),
                )
        for name, torque in mechanism.torques.items():
            with self._checked():
                body = self._body(torque.on, ("torques", name, "on"))
                self._element(
                    elements.TORQUE,
                    self._difference(body.from_, body.to, ("torques", name)),
                    (torque.torque,),
                )
        self.mistakes.refuse()
        for i in range(0, n, 2):
            if np.any(loads[i : i + 2]):
                self.ints.append([elements.LOAD, 1, i] + [0] * (elements.INT_COLUMNS - 3))
                self._append_reals([], 0j, (loads[i], loads[i + 1]))

        mass, x, y, g = (
            np.array(entries, np.int64).reshape(-1, 2).T.copy()
            for entries in (sorted(self.mass), self.x_entries, self.y_entries, self.g_entries)
        )
        points = [mechanism.points[name] for name in self.moving]
        return Problem(
            name=self.name,
            u0=np.array([c for point in points for c in point.at or ()]),
            v0=np.array([c for point in points for c in point.velocity]),
            t0=0.0,
            constraints=len(self.constraint_paths),
            function=elements.evaluate,
            elements=Elements(elements.accumulate, np.arange(len(self.ints))),
            derivatives=elements.constraint_derivatives,
            ints=np.array(self.ints, np.int64).reshape(-1, elements.INT_COLUMNS),
            reals=np.array(self.reals, float).reshape(-1, elements.REAL_COLUMNS),
            pattern=Pattern(*mass, *x, *y, *g),
            mass_values=np.array([self.mass[place] for place in sorted(self.mass)]),
            drawing_given=mechanism,
            points_given=tuple(self.moving),
            # Links, bars and sliders are; laws of time are not carried by increments.
            quadratic=not mechanism.motions,
            single=True,
            potential=elements.potential if mechanism.conservative else None,
            # A motion is named with what it drives: `m.x` may be another's name.
            constraints_given=tuple(
                (*path, "angle") if path[0] == "motions" and len(path) == 2 else path
                for path in self.constraint_paths
            ),
        )

    def _body(self, name: str, path: KeyPath) -> Body:
        bodies = self.mechanism.bodies
        if ("bodies", name) in self.broken:
            raise _Follows
        if name not in bodies:
            raise self._unknown("body", name, path, bodies)
        return bodies[name]

    def _site(self, name: str, path: KeyPath) -> Site:
        if ("points", name) in self.broken:
            raise _Follows
        if name not in self.sites:
            raise self._unknown("point", name, path, self.sites)
        return self.sites[name]

    def _unknown(
        self, kind: str, name: str, path: KeyPath, allowed: Collection[str]
    ) -> DocumentError:
        # Looking for the nearest name takes its time, which only what is printed is worth.
        hint = "" if self.mistakes.full else nearest(name, allowed)
        return self.document.error(path, f"unknown {kind} {name!r}{hint}")

    def _ends(self, start: str, end: str, path: KeyPath) -> tuple[Site, Site]:
        """Both ends of a part; a mistake in one does not hide that in the other."""
        found = []
        for name, key in ((start, "from"), (end, "to")):
            with self._checked():
                found.append(self._site(name, (*path, key)))
        if len(found) < 2:
            raise _Follows
        return found[0], found[1]

    def _difference(self, start: str, end: str, path: KeyPath) -> dict[str, complex]:
        if start == end:
            raise self.document.error(path, f"joins {start} with itself")
        first, last = self._ends(start, end, path)
        difference = last.minus(first)
        if not any(name in self.moving for name in difference):
            raise self.document.error(
                path, f"joins {start} and {end}, which cannot move relative to each other"
            )
        return difference

    def _distance(self, start: str, end: str, length: float, path: KeyPath) -> None:
        difference = self._difference(start, end, path)
        misfit = abs(self._vector(difference)) - length
        if not self.mechanism.assemble and abs(misfit) > _MISFIT * length:
            raise self.document.error(
                path,
                f"{start} and {end} start {length + misfit:.12g} m apart, given length "
                f"{length:g}; correct the positions or set 'assemble: true'",
            )
        plain = all(complex(weight).imag == 0 for weight in difference.values())
        kind = elements.LINK if plain else elements.BAR
        self._element(kind, difference, (length**2,), constraint=path)

    def _slider(self, slider: Slider, path: KeyPath) -> None:
        along = complex(*slider.direction) / abs(complex(*slider.direction))
        normal = 1j * along
        site = self._moving_site(slider.point, (*path, "point"))
        through = complex(*slider.through)
        level = (normal.conjugate() * through).real
        away = (normal.conjugate() * self._vector(site)).real - level
        if not self.mechanism.assemble and abs(away) > _MISFIT * max(1.0, abs(through)):
            raise self.document.error(
                path,
                f"{slider.point} starts {abs(away):.12g} m off the line; correct its position "
                "or set 'assemble: true'",
            )
        law = (level, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._element(elements.LINE, site, (normal.real, normal.imag, *law), constraint=path)

    def _motion(self, motion: Motion, path: KeyPath) -> None:
        if motion.point is not None:
            site = self._moving_site(motion.point, (*path, "point"))
            place = self._vector(site)
            for key, law, normal in (("x", motion.x, (1.0, 0.0)), ("y", motion.y, (0.0, 1.0))):
                if law is not None:
                    now = place.real if key == "x" else place.imag
                    with self._checked():
                        parameters = self._fitting(law, now, (*path, key))
                        self._element(
                            elements.LINE, site, (*normal, *parameters), constraint=(*path, key)
                        )
        else:
            assert motion.body is not None
            assert motion.angle is not None
            body = self._body(motion.body, (*path, "body"))
            difference = self._difference(body.from_, body.to, path)
            vector = self._vector(difference)
            now = math.atan2(vector.imag, vector.real)
            parameters = self._fitting(motion.angle, now, (*path, "angle"), 2 * math.pi)
            self._element(elements.ANGLE, difference, (0.0, 0.0, *parameters), constraint=path)

    def _fitting(
        self, law: Law, now: float, path: KeyPath, period: float = math.inf
    ) -> tuple[float, ...]:
        guessed = self.mechanism.assemble
        return start.law_parameters(law, now, self.document, path, period, guessed)

    def _moving_site(self, name: str, path: KeyPath) -> dict[str, complex]:
        weights = dict(self._site(name, path).weights)
        if not any(point in self.moving for point in weights):
            raise self.document.error(path, f"{name} is fixed")
        return weights

    def _vector(self, weights: Mapping[str, complex]) -> complex:
        """Initial value of Σ (a + bR) P."""
        return sum((weight * self._start(name) for name, weight in weights.items()), 0j)

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
        parameters: tuple[float, ...],
        constraint: KeyPath | None = None,
    ) -> None:
        offset = sum(
            (w * self.fixed[name] for name, w in difference.items() if name in self.fixed), 0j
        )
        moving = {name: w for name, w in difference.items() if name in self.moving}
        dofs = [self.moving[name] for name in moving]
        row = len(self.constraint_paths) if constraint else 0
        self.ints.append(
            [kind, len(dofs), *dofs, *[0] * (4 - len(dofs)), row,
             len(self.x_entries), len(self.y_entries), len(self.g_entries)]
        )  # fmt: skip
        self._append_reals(list(moving.values()), offset, parameters)
        blocks = ((0, 0), (1, 1)) if kind == elements.LINK else ((0, 0), (0, 1), (1, 0), (1, 1))
        entries = [(i + r, j + c) for i in dofs for j in dofs for r, c in blocks]
        if kind not in (elements.LINE, elements.ANGLE):
            self.x_entries += entries
        if kind == elements.DAMPER:
            self.y_entries += entries
        if constraint:
            self.g_entries += [(i + r, row) for i in dofs for r in (0, 1)]
            self.constraint_paths.append(constraint)

    def _append_reals(
        self, weights: Sequence[complex], offset: complex, parameters: Sequence[float]
    ) -> None:
        parts = [part for w in weights for part in (complex(w).real, complex(w).imag)]
        row = [*parts, *[0.0] * (elements.OFFSET - len(parts)), offset.real, offset.imag]
        row += parameters
        self.reals.append(row + [0.0] * (elements.REAL_COLUMNS - len(row)))

    def _body_mass(self, body: Body, loads: Array, gravity: complex, path: KeyPath) -> None:
        mechanism = self.mechanism
        for name, key in ((body.from_, "from"), (body.to, "to")):
            if name in mechanism.body_points and name not in mechanism.points:
                raise self.document.error(
                    (*path, key), f"{name} is itself fixed on a body; a body needs two of 'points'"
                )
        self._ends(body.from_, body.to, path)
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
