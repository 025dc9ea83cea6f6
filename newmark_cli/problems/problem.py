"""Problems as the core needs them: M v' = f + Gλ, u' = v, 0 = Φ."""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from newmark_cli.problems.algebra import product
from newmark_cli.support.arrays import Array, IndexArray
from newmark_cli.support.errors import ArgumentError, InputError


class ProblemError(InputError):
    """A problem's definition cannot be used; says where and why.

    Examples:
        >>> import newmark_cli as newmark
        >>> newmark.problem("androws")
        Traceback (most recent call last):
        ...
        newmark_cli.problems.problem.ProblemError: unknown problem 'androws'; did you mean ...
    """


class Pattern(NamedTuple):
    """Where the values that a problem's function produces belong.

    Entries with the same place add up.
    """

    mass_rows: IndexArray
    mass_columns: IndexArray
    x_rows: IndexArray
    x_columns: IndexArray
    y_rows: IndexArray
    y_columns: IndexArray
    g_rows: IndexArray  #: coordinate of each entry of G
    g_columns: IndexArray  #: constraint of each entry of G


class Values(NamedTuple):
    """Values of a problem's function at one state; matrices as values at the pattern."""

    force: Array  #: (n,) f + Gλ
    phi: Array  #: (m,) Φ
    x: Array
    y: Array
    g: Array


class ConstraintRows(NamedTuple):
    """Φ' = Gᵀ v + rate and Φ'' = Gᵀ w + curvature at one state, and their tangents.

    With ∂(Φ')/∂v = Gᵀ, ∂(Φ'')/∂v = 2R and ∂(Φ'')/∂w = Gᵀ they are complete.
    """

    rate: Array  #: (m,) Φ_t
    curvature: Array  #: (m,) vᵀ Φ_uu v + 2 Φ_tu v + Φ_tt
    r: Array  #: R = ∂(Gᵀ v + rate)/∂u, its transpose as values at the places of G
    q: Array  #: Q = ∂(Gᵀ w + curvature)/∂u, likewise


class Terms(NamedTuple):
    """A problem at one state."""

    force: Array  #: (n,) f + Gλ
    phi: Array  #: (m,) Φ
    X: Array  #: (n, n) −∂(f + Gλ)/∂u (eq. 18a).
    Y: Array  #: (n, n) −∂f/∂v (eq. 18b).
    G: Array  #: (n, m) Φ_uᵀ


class Place(NamedTuple):
    """A point of a mechanism that is no coordinate itself: W u + c, of some coordinates u."""

    coordinates: IndexArray  #: (j,) which coordinates
    weights: Array  #: (d, j) W
    offset: Array  #: (d,) c (m)

    def at(self, vectors: Array, field: str = "u") -> Array:
        """(…, d) the point at positions (…, n), or what it has of another field of these."""
        moved = product(vectors[..., self.coordinates], self.weights.T)
        return np.asarray(moved + self.offset if field == "u" else moved)


def said(places: Mapping[str, Place]) -> str:
    """Names and numbers of points in full; empty without any."""
    return "".join(f"{name} {[part.tolist() for part in of]}" for name, of in places.items())


class Outputs(Protocol):
    """Outputs that follow from a state besides coordinates and multipliers, by name."""

    @property
    def names(self) -> tuple[str, ...]:
        """(k,) names; all different."""

    @property
    def not_unique(self) -> tuple[str, ...]:
        """Names of reactions that depend on which redundant constraints were dropped."""

    @property
    def content(self) -> str:
        """What of the values depends on more than the problem's numbers; may be empty."""

    def values(self, problem: "Problem", t: float, u: Array, v: Array, multipliers: Array) -> Array:
        """(k,) outputs at one state: t (s), u and v (n,), λ (m,)."""

    def length(self, u: Array) -> float:
        """A length (m) that forces times are moments to compare with; u is (n,)."""


@dataclass(frozen=True, eq=False)
class Problem:
    """An index-3 problem whose values come from one function.

    Attributes:
        name: Name in configs and CSVs.
        u0, v0: (n,) initial coordinates and velocities.
        t0: Initial time (s).
        constraints: m.
        function: ``(t, u, v, λ, ints, reals, force, Φ, X, Y, G)`` that
            overwrites the last five, the matrices as values at ``pattern``.
        derivatives: ``(t, u, v, w, ints, reals, rate, curvature, R, Q)`` that
            overwrites the last four, see `ConstraintRows`; w is the acceleration.  It is
            compiled where ``function`` is.
        ints, reals: Two-dimensional tables handed to the functions.
        pattern: Places of the values.
        mass_values: Values of M.
        drawing_given: What `drawing` is, or a function without arguments that makes it.
        points_given: Names of the moving points of a mechanism, and of what else has a
            coordinate on each axis.
        axes: Names of the coordinates of each of ``points``.
        compiled: Whether ``function`` is compiled, as the kernel needs it.
        quadratic: Whether Φ is at most quadratic in u and does not depend on time,
            so that its increments are exact; see `newmark_cli.newmark.scheme`.
        known_tangents: How many entries of X and Y ``function`` must have room for: those behind
            them are found by differences, unless there is no room; None where all are known.
        single: Whether ``function`` keeps to float32 where it is handed float32.
        potential: ``(t, u, v, ints, reals)`` → what the kinetic energy lacks to the
            total one (J), up to a constant; None where no energy is conserved.
        code: Digest of the user's code behind the functions; empty without any.
        sources: What the problem was made from: path, relative to the folder of its
            file, → content, of the file and of the modules beside it that it imported.
        coordinates_given: Names of the coordinates behind those of the points; numbers
            where there are neither.
        constraints_given: (m,) parts of the name of each constraint, such as
            ``("bars", "link")``; numbers where it is empty.
        rows_given: ``"exact"``, or ``"differences"`` where ``derivatives`` finds any of
            its results by numerical differentiation, with steps multiplied by ``reals[0, 0]``.
        outputs: What else the problem has names for, such as reactions; None without any.
        places: Points of a mechanism that are no coordinates: fixed ones, and those on bodies.
        released: Names of constraints that were dropped because they are redundant.
        gaps: ``(t, u)`` → the largest gap of these, relative to the size of the mechanism, its
            constraint, and the largest of the others; None where none was dropped.
        until: Time (s) up to which the problem is given: the end of its shortest table.
        doubts: Lines on a mechanism file that can hardly be meant.

    Examples:
        >>> import newmark_cli as newmark
        >>> pendulum = newmark.problem("pendulum")
        >>> pendulum.n, pendulum.m, pendulum.u0.tolist()
        (2, 1, [1.0, 0.0])
        >>> pendulum.evaluate(0.0, pendulum.u0, pendulum.v0, [0.0]).G.tolist()
        [[1.0], [0.0]]
    """

    name: str
    u0: Array
    v0: Array
    t0: float
    constraints: int
    function: Callable[..., None]
    derivatives: Callable[..., None]
    ints: IndexArray
    reals: Array
    pattern: Pattern
    mass_values: Array
    drawing_given: Any = None
    points_given: Sequence[str] = ()
    axes: str = "xy"
    compiled: bool = True
    quadratic: bool = False
    known_tangents: tuple[int, int] | None = None
    single: bool = False
    potential: Callable[..., float] | None = None
    code: str = ""
    sources: Mapping[str, bytes] = field(default_factory=dict)
    coordinates_given: Sequence[str] = ()
    constraints_given: Sequence[Sequence[str | int]] = ()
    rows_given: str = "exact"
    outputs: Outputs | None = None
    places: Mapping[str, Place] = field(default_factory=dict)
    released: tuple[str, ...] = ()
    gaps: Callable[[float, Array], tuple[float, str, float]] | None = None
    until: float = math.inf
    doubts: tuple[str, ...] = ()

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.u0)

    @property
    def m(self) -> int:
        """Number of constraints."""
        return self.constraints

    # Made on demand: a mechanism may have a million points.
    @cached_property
    def drawing(self) -> Any:
        """Data that a figure of the problem is drawn from; None if it has none."""
        return self.drawing_given() if callable(self.drawing_given) else self.drawing_given

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Moving points of a mechanism, as many coordinates each as it has `axes`; else empty."""
        return tuple(self.points_given)

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """(n,) names of the coordinates, in the order of u; all different.

        ``A.x`` and ``A.y`` of the point A of a mechanism, ``crank.angle`` of a body whose
        angle is a coordinate; ``1`` … ``n`` where a problem
        in Python does not name them.
        """
        named = tuple(f"{point}.{axis}" for point in self.points for axis in self.axes)
        return named + tuple(self.coordinates_given) or _numbered(self.n)

    @cached_property
    def constraint_names(self) -> tuple[str, ...]:
        """(m,) names of the constraints, in the order of Φ and λ; all different.

        Kind and name of the part of a mechanism that a constraint comes from, such as
        ``bars.link``; a prescribed motion adds what it drives, ``motions.crank.angle``.
        ``1`` … ``m`` where a problem in Python does not name them.
        """
        names = self.constraints_given
        return tuple(".".join(map(str, parts)) for parts in names) or _numbered(self.m)

    @property
    def M(self) -> Array:
        """(n, n) mass matrix."""
        return dense_matrix(
            self.pattern.mass_rows, self.pattern.mass_columns, self.mass_values, (self.n, self.n)
        )

    def values(
        self, t: float, u: Array, v: Array, multipliers: Array, dtype: type[Any] = np.float64
    ) -> Values:
        """Force, Φ and the values of X, Y, G at a state; u, v are (n,), multipliers (m,).

        Computed in one type of numbers.
        """
        of_xy = len(self.pattern.x_rows), len(self.pattern.y_rows)
        return self._evaluated(_plain(dtype, t, u, v, multipliers), dtype, of_xy)

    def free_values(self, t: float, u: Array, v: Array) -> Values:
        """The same at λ = 0 without what differences give of X and Y, which takes long."""
        of_xy = self.known_tangents or (len(self.pattern.x_rows), len(self.pattern.y_rows))
        return self._evaluated(_plain(np.float64, t, u, v, np.zeros(self.m)), np.float64, of_xy)

    def _evaluated(
        self, state: tuple[Any, ...], dtype: type[Any], of_xy: tuple[int, int]
    ) -> Values:
        sizes = self.n, self.m, *of_xy, len(self.pattern.g_rows)
        values = Values(*(np.empty(size, dtype) for size in sizes))
        self.function(*state, self.ints, self.reals.astype(dtype, copy=False), *values)
        return values

    def dense(self, values: Values) -> Terms:
        """The same with matrices in full."""
        n, m, pattern = self.n, self.m, self.pattern
        return Terms(
            force=values.force,
            phi=values.phi,
            X=dense_matrix(pattern.x_rows, pattern.x_columns, values.x, (n, n)),
            Y=dense_matrix(pattern.y_rows, pattern.y_columns, values.y, (n, n)),
            G=dense_matrix(pattern.g_rows, pattern.g_columns, values.g, (n, m)),
        )

    def evaluate(self, t: float, u: Array, v: Array, multipliers: Array) -> Terms:
        """All terms at a state; u, v are (n,), multipliers (m,).

        Raises:
            ArgumentError: For other shapes, or what is not a number.
        """
        arguments = {"u": (u, self.n), "v": (v, self.n), "multipliers": (multipliers, self.m)}
        for name, (values, length) in arguments.items():
            array = np.asarray(values)
            if array.shape != (length,) or array.dtype.kind not in "iuf":
                raise ArgumentError(
                    f"{name} must be {length} numbers, given an array of shape {array.shape}"
                )
        return self.dense(self.values(t, u, v, multipliers))

    def along(self, entries: Array, vector: Array) -> Array:
        """(m,) a matrix at the pattern of Gᵀ times (n,).

        Args:
            entries: Its values, where `pattern` has those of G.
            vector: (n,).
        """
        products = entries * vector[self.pattern.g_rows]
        sums = np.bincount(self.pattern.g_columns, products, minlength=self.m)
        return np.asarray(sums, float)

    def constraint_values(self, t: float, u: Array) -> Array:
        """(m,) Φ."""
        return self.free_values(t, u, np.zeros(self.n)).phi

    def gradient(self, t: float, u: Array) -> Array:
        """(n, m) G."""
        g = self.free_values(t, u, np.zeros(self.n)).g
        return dense_matrix(self.pattern.g_rows, self.pattern.g_columns, g, (self.n, self.m))

    def energies(self, t: float, u: Array, v: Array) -> tuple[float, float] | None:
        """Kinetic and potential energy (J), the second up to a constant.

        None where their sum is not conserved; u, v are (n,).
        """
        if self.potential is None:
            return None
        pattern = self.pattern
        kinetic = 0.5 * np.sum(v[pattern.mass_rows] * self.mass_values * v[pattern.mass_columns])
        state = _plain(np.float64, t, u, v)
        return float(kinetic), float(self.potential(*state, self.ints, self.reals))

    @cached_property
    def content(self) -> str:
        """Hexadecimal digest of what the problem's numbers depend on.

        Tables, masses, patterns and start, and the code behind the functions if it is
        the user's.  Neither its name, nor what the user's code imports from elsewhere
        than beside its file, nor the data that it reads.
        """
        digest = hashlib.sha256(f"{self.code} {self.m} {self.t0!r}".encode())
        arrays = (self.u0, self.v0, self.ints, self.reals, self.mass_values, *self.pattern)
        for array in arrays:
            digest.update(f"{array.shape} {array.dtype.str}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(self.outputs.content.encode() if self.outputs else b"")
        return digest.hexdigest()

    def constraint_rows(self, t: float, u: Array, v: Array, w: Array) -> ConstraintRows:
        """Terms of Φ' and Φ'' besides Gᵀ v and Gᵀ w, and the tangents of both to u.

        Args:
            t: Time (s).
            u, v, w: (n,) coordinates, velocities and accelerations.
        """
        entries = len(self.pattern.g_rows)
        sizes = (self.m, self.m, entries, entries)
        rows = ConstraintRows(*(np.zeros(size) for size in sizes))
        self.derivatives(*_plain(np.float64, t, u, v, w), self.ints, self.reals, *rows)
        return rows

    def constraint_derivatives(self, t: float, u: Array, v: Array) -> tuple[Array, Array]:
        """(m,) rate and curvature: Φ' = Gᵀ v + rate, Φ'' = Gᵀ u'' + curvature."""
        return self.constraint_rows(t, u, v, np.zeros(self.n))[:2]


@dataclass(frozen=True, eq=False)
class Push:
    """A force in Python on points of a mechanism, see `python_problem.pushed`."""

    python: str  #: ``file:function``, as in the mechanism
    coordinates: Sequence[int]  #: (c,) coordinates that the points depend on
    weights: Array  #: (2k, c) how
    offsets: Array  #: (2k,) what does not move of them (m)


def is_beyond(until: float, t: float) -> bool:
    """Whether a time (s) is after the last of a table, but for rounding."""
    return t > until * (1 + 1e-9)


def _plain(dtype: type[Any], t: float, *arrays: Array) -> tuple[Any, ...]:
    """A time and arrays as functions are compiled for: others would compile them once more.

    Of one type, and not parts of others or read-only.
    """
    time = float(t) if dtype is np.float64 else dtype(t)
    return time, *(np.array(array, dtype, order="C") for array in arrays)


def _numbered(count: int) -> tuple[str, ...]:
    return tuple(map(str, range(1, count + 1)))


def dense_matrix(
    rows: IndexArray, columns: IndexArray, values: Array, shape: tuple[int, int]
) -> Array:
    """Matrix from values at places; those of one place add up."""
    matrix = np.zeros(shape)
    np.add.at(matrix, (rows, columns), values)
    return matrix
