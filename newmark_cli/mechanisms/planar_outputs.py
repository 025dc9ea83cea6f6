"""Outputs that the file of a planar mechanism asks for: places of points, forces of pins.

A pin is a point that bodies share, so M, f and G have the sums over these bodies only.  Here each
body gets two points of its own beside those of the file: what names a body or a point on it acts
on these, all else on the points of the file.  Rows and angles stay the same, and so does λ;

    force of the pins on a body = M a − f − G λ

at its own two points is what its inertia, its loads and its own constraints leave.  Accelerations
are those that the dynamics and λ give; so the forces at each pin are in balance for any λ.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csc_array, diags_array

from newmark_cli.mechanisms.models import Body, Mechanism, Point
from newmark_cli.mechanisms.positions import DENSE_UP_TO, solver_if_regular
from newmark_cli.problems.algebra import solver
from newmark_cli.problems.problem import Place, Problem, said
from newmark_cli.support.arrays import Array, IndexArray


def _own(body: str, point: str) -> str:
    """A body's own point; no file has the name."""
    return f"{body}\0{point}"


def taken_apart(mechanism: Mechanism) -> Mechanism:
    """The same mechanism with two points for each body that nothing else has."""
    points, bodies = dict(mechanism.points), dict[str, Body]()
    for name, body in mechanism.bodies.items():
        for end in (body.from_, body.to):
            of = mechanism.points[end]
            points[_own(name, end)] = Point(at=of.fixed or of.at, velocity=of.velocity)
        ends = {"from_": _own(name, body.from_), "to": _own(name, body.to)}
        bodies[name] = body.model_copy(update=ends)
    # What touches a wheel's centre acts on the pin there.
    rolling = {
        name: of.model_copy(update={"centre": of.centre or mechanism.bodies[of.wheel].from_})
        for name, of in mechanism.rolling.items()
    }
    changed = {"points": points, "bodies": bodies, "rolling": rolling}
    return mechanism.model_copy(update={**changed, "outputs": [], "assemble": True})


@dataclass(frozen=True, eq=False)
class Pins:
    """Forces of pins on bodies.

    Attributes:
        apart: The mechanism as `taken_apart` has it.
        sources: (n',) which coordinate of the mechanism each of its coordinates is; −1 where a
            point is fixed.
        names: Body and point of each force, ``crank@A``.
        rows: (2k,) coordinates of ``apart`` at which they act.
        mass: (2, j) places of M of the mechanism, and its values.
    """

    apart: Problem
    sources: IndexArray
    names: tuple[str, ...]
    rows: IndexArray
    mass: tuple[IndexArray, Array]

    @classmethod
    def of(
        cls, mechanism: Mechanism, apart: Problem, coordinates: Mapping[str, int],
        mass: tuple[IndexArray, Array],
    ) -> "Pins":  # fmt: skip
        """Forces of a mechanism whose coordinates have these places, by their names."""
        own = {
            _own(name, end): (f"{name}@{end}", end)
            for name, body in mechanism.bodies.items()
            for end in (body.from_, body.to)
        }
        known = {**coordinates} | {
            f"{name}.{axis}": coordinates.get(f"{end}.{axis}", -1)
            for name, (_, end) in own.items()
            for axis in "xy"
        }
        places = {name: i for i, name in enumerate(apart.coordinate_names)}
        return cls(
            apart,
            np.array([known[name] for name in places]),
            tuple(name for name, _ in own.values()),
            np.array([places[f"{name}.{axis}"] for name in own for axis in "xy"]),
            mass,
        )

    def values(self, problem: Problem, t: float, u: Array, v: Array, multipliers: Array) -> Array:
        """(2k,) components of the forces (N) at a state: t (s), u and v (n,), λ (m,)."""
        a = self._accelerations(problem.values(t, u, v, multipliers).force)
        moves, pattern = self.sources >= 0, self.apart.pattern
        places = np.where(moves, u[self.sources], self.apart.u0)
        rates, changes = (np.where(moves, of[self.sources], 0.0) for of in (v, a))
        force = self.apart.values(t, places, rates, multipliers).force
        pushed = self.apart.mass_values * changes[pattern.mass_columns]
        inertia = np.bincount(pattern.mass_rows, pushed, len(force))
        return np.asarray((inertia - force)[self.rows], float)

    @cached_property
    def _accelerations(self) -> Callable[[Array], Array]:
        """Solver of M a = f + Gλ.

        What M leaves open of a has no part in M a of a body: M of each is at least semidefinite.
        """
        (rows, columns), values = self.mass
        n = int(self.sources.max()) + 1
        matrix = csc_array((values, (rows, columns)), (n, n))
        heavy = matrix.diagonal() > 0
        size = 1 / np.sqrt(np.where(heavy, matrix.diagonal(), 1.0))
        scaled = csc_array(matrix * size[:, None] * size + diags_array(1.0 * ~heavy))
        dense = n <= DENSE_UP_TO
        solve = solver_if_regular(scaled.toarray()) if dense else solver(scaled)
        if solve is None:
            solve = np.linalg.pinv(scaled.toarray(), rcond=1e-12, hermitian=True).__matmul__
        return lambda force: size * solve(size * force)

    def __getstate__(self) -> dict[str, Any]:
        # Factors cannot be pickled.
        return {name: value for name, value in vars(self).items() if name != "_accelerations"}


@dataclass(frozen=True, eq=False)
class PlanarOutputs:
    """Outputs of a planar mechanism: ``C.x`` of points (m), ``crank@A.force.x`` of pins (N).

    The force of a pin is the one on the body, in global axes.

    Attributes:
        places: Points on bodies, by name.
        pins: Forces; None where the file does not ask for them.
    """

    places: Mapping[str, Place]
    pins: Pins | None = None
    not_unique: tuple[str, ...] = ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All different."""
        forces = self.pins.names if self.pins else ()
        names = [*self.places, *(f"{name}.force" for name in forces)]
        return tuple(f"{name}.{axis}" for name in names for axis in "xy")

    @property
    def content(self) -> str:
        """What the numbers depend on besides those of the problem."""
        return said(self.places) + (self.pins.apart.content if self.pins else "")

    def values(self, problem: Problem, t: float, u: Array, v: Array, multipliers: Array) -> Array:
        """(k,) outputs at one state: t (s), u and v (n,), λ (m,)."""
        parts = [place.at(u) for place in self.places.values()]
        if self.pins:
            parts.append(self.pins.values(problem, t, u, v, multipliers))
        return np.concatenate(parts)

    def length(self, u: Array) -> float:
        """Largest coordinate (m); no output is a moment."""
        return float(np.abs(u).max())
