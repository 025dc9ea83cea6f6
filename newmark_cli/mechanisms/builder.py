"""What builders of mechanisms in the plane and in space have in common.

A key of a mechanism file whose values are parts by name, such as ``springs``, is a method of a
builder, ``_springs``, which makes rows and forces of one.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from newmark_cli.mechanisms import elements, laws, spring_laws
from newmark_cli.mechanisms.element_tables import ElementList, Shape, Term
from newmark_cli.mechanisms.models import Law, MechanismModel
from newmark_cli.problems.problem import Place, Problem, Push
from newmark_cli.support import documents
from newmark_cli.support.arrays import Array, IndexArray
from newmark_cli.support.documents import Document, DocumentError, KeyPath
from newmark_cli.support.spelling import nearest

#: Largest misfit of a start, relative to the length it is a misfit of: data are rounded.
MISFIT = 1e-12
#: Kinds of parts that others refer to by the name of another kind.
ALIASES = {"body_points": "points"}


_Part = TypeVar("_Part")


class Follows(Exception):
    """A part cannot be built because of a mistake that is known already."""


class Row(NamedTuple):
    """A constraint, as errors name it.

    Attributes:
        path: Its key in the document.
        owner: The part that it belongs to; empty for what keeps a body rigid in space.
        name: Which of the rows of that part it is; empty where there is one.
    """

    path: KeyPath
    owner: str
    name: str = ""

    @property
    def parts(self) -> KeyPath:
        """Its name in parts: part and row, or the key of a part that has one."""
        return (self.owner or self.path[-1], self.name) if self.name else self.path

    @property
    def full(self) -> str:
        """Its name."""
        return ".".join(map(str, self.parts))


class Sum(NamedTuple):
    """Sums of a mechanism, such as a combination of its vectors: constants, and terms."""

    constant: Sequence[float] | Array
    terms: Sequence[Term]


class Builder(ABC):
    """Turns a mechanism into the tables of an element loop.

    A mistake in one part does not keep the others from being looked at; all of them are raised
    together.

    Attributes:
        name: Of the problem.
        document: Where errors are.
        mechanism: What the file says.
        mistakes: Those of the parts.
        broken: Kind and name of what has a mistake: a reference to it is not another one.
        rows: All constraints.
        squares: Squares of lengths, of constraints ½ (|Δ|² − L²).
        elements: All elements.
        turning: Angles that are coordinates: name → place in u.
        pushes: Forces in Python.
        loads: (vectors, components) constant forces.
        mass: (2, k) places of M, in their order, and their values.
    """

    #: What a file may say, its keys of parts in the order of their rows, components of a vector.
    model: ClassVar[type[MechanismModel]]
    parts: ClassVar[tuple[str, ...]]
    components: ClassVar[int]

    def __init__(
        self, name: str, document: Document, mechanism: Any,
        broken: Collection[tuple[str, str]] = (),
    ) -> None:  # fmt: skip
        self.name, self.document, self.mechanism = name, document, mechanism
        self.mistakes = documents.Mistakes()
        self.broken = set(broken)
        self.rows: list[Row] = []
        self.squares: dict[int, float] = {}
        self.elements = ElementList()
        self.turning: dict[str, int] = {}
        self.pushes: dict[KeyPath, Push] = {}
        self.loads: Array
        self.mass: tuple[IndexArray, Array]
        self.prepare()
        for key in self.parts:
            parts, build = getattr(mechanism, key), getattr(self, f"_{key}")
            for part, data in parts.items():
                try:
                    build(data, (key, part))
                except (DocumentError, Follows) as error:
                    self._take_up(error, ALIASES.get(key, key), part)
        self.mistakes.refuse()
        self.weigh()
        for place in np.flatnonzero(np.any(self.loads != 0, axis=1)).tolist():
            self.load(self.components * place, self.loads[place])

    @abstractmethod
    def prepare(self) -> None:
        """Make what parts need."""

    @abstractmethod
    def weigh(self) -> None:
        """Complete masses and loads of sound parts."""

    @abstractmethod
    def position(self) -> Array:
        """(n,) coordinates that the file gives."""

    @abstractmethod
    def velocities(self, u: Array) -> Array:
        """(n,) velocities that the file gives, at a position."""

    @abstractmethod
    def described(self, kept: Sequence[int], shared: frozenset[str]) -> Mapping[str, Any]:
        """Fields of a problem with some of the rows that name what it is."""

    @abstractmethod
    def without_inertia(self, u: Array, motions: Array) -> list[tuple[KeyPath, str]]:
        """Keys and words of motions (n, k) that have no inertia."""

    def wanted(self, places: Mapping[str, Place]) -> dict[str, Place]:
        """Those of the points on bodies, where the file asks for them as outputs."""
        asked = self.mechanism.body_points if "points" in self.mechanism.outputs else ()
        return {name: places[name] for name in asked}

    def rates(self, u: Array) -> Iterator[tuple[KeyPath, Array, float]]:
        """Key, gradient (n,) and value of each rate that the file gives besides velocities."""
        return iter(())

    def problem(
        self, released: Sequence[int] = (), shared: frozenset[str] = frozenset()
    ) -> Problem:
        """The problem as the file has it, without some constraints, and parts that share in them.

        Args:
            released: Numbers of constraints that are left out.
            shared: Parts whose reactions depend on which these are.
        """
        kept = np.setdiff1d(np.arange(len(self.rows)), list(released)).tolist()
        places, values = self.mass
        return Problem(
            name=self.name,
            u0=self.position(),
            v0=self.velocities(self.position()),
            t0=0.0,
            constraints=len(kept),
            **self.elements.fields(sorted(released), places, self.mechanism.conservative),
            mass_values=values,
            # Laws of time and angles are not carried by increments.
            quadratic=not (self.mechanism.motions or self.turning),
            single=True,
            # A motion is named with what it drives: `m.x` may be another's name.
            constraints_given=tuple(self.rows[row].parts for row in kept),
            released=tuple(self.rows[row].full for row in sorted(released)),
            until=self.elements.until,
            drawing_given=self.mechanism,
            **self.described(kept, shared),
        )

    # -- mistakes and references ---------------------------------------------------------------

    @contextmanager
    def checked(self, *broken: str) -> Iterator[None]:
        """Take up a mistake of the block, which ends there; kind and name are then broken."""
        try:
            yield
        except (DocumentError, Follows) as error:
            self._take_up(error, *broken)

    def _take_up(self, error: Exception, *broken: str) -> None:
        if isinstance(error, DocumentError):
            self.mistakes.note(error)
        if broken:
            self.broken.add((broken[0], broken[1]))

    def known(
        self, kind: str, name: str, path: KeyPath, among: Mapping[str, _Part],
        others: Iterable[str] = (),
    ) -> _Part:  # fmt: skip
        """The part of a kind that another one names; ``others`` are further names that exist."""
        if (kind, name) in self.broken:
            raise Follows
        if name not in among:
            # Looking for the nearest name takes its time, which only what is printed is worth.
            hint = "" if self.mistakes.full else nearest(name, (*among, *others))
            word = "body" if kind == "bodies" else kind[:-1]
            raise self.document.error(path, f"unknown {word} {name!r}{hint}")
        return among[name]

    def both(
        self, find: Callable[..., Any], start: str, end: str, path: KeyPath,
        keys: tuple[str, str] = ("from", "to"),
    ) -> tuple[Any, Any]:  # fmt: skip
        """Both ends of a part; a mistake in one does not hide that in the other."""
        ends = []
        for name, key in ((start, keys[0]), (end, keys[1])):
            try:  # `checked` would take half of the time of a large mechanism
                ends.append(find(name, (*path, key)))
            except (DocumentError, Follows) as error:
                self._take_up(error)
        if len(ends) < 2:
            raise Follows
        return ends[0], ends[1]

    def require(
        self, away: float, most: float, path: KeyPath, message: str, correct: str = "the positions"
    ) -> None:
        """Raise DocumentError where a start is off by more than it may; a guess may be."""
        if not self.mechanism.assemble and abs(away) > most:
            raise self.document.error(path, f"{message}; correct {correct} or set 'assemble: true'")

    def require_length(self, what: str, misfit: float, length: float, path: KeyPath) -> None:
        """Raise DocumentError where two points start at another distance than their length."""
        if abs(misfit) > MISFIT * length:
            # In so many digits that the misfit shows.
            digits = 12 if abs(misfit) > 1e-9 * length else 16
            distances = f"{length + misfit:.{digits}g} m apart, given length {length:.16g}"
            self.require(misfit, 0.0, path, f"{what} start {distances}")

    # -- rows and elements ---------------------------------------------------------------------

    def one_row(self, path: KeyPath) -> int:
        """Number of a constraint that is the only one of its key."""
        self.rows.append(Row(path, ".".join(map(str, path))))
        return len(self.rows) - 1

    def fitting(
        self, law: Law, now: float, path: KeyPath, period: float = math.inf
    ) -> tuple[float, ...]:
        """Parameters of a law of time that starts where the mechanism is now, but for periods.

        Raises:
            DocumentError: When it starts elsewhere.
        """
        parameters = law.parameters(now)
        begin = laws.begin(law, parameters[0])
        away = begin - now if math.isinf(period) else math.remainder(begin - now, period)
        if not self.mechanism.assemble and abs(away) > 1e-9 * max(1.0, abs(now)):
            raise self.document.error(
                path, f"the law starts at {begin:.12g}, the mechanism at {now:.12g}"
            )
        return parameters

    def add(
        self,
        kind: str,
        *sums: Sum,
        row: int = -1,
        single: Sequence[Term] = (),
        parameters: Sequence[float] = (),
        law: Law | None = None,
        timed: Sequence[laws.Timed] = (),
    ) -> None:
        """Add an element of a kind of `elements`; sums are s and t, ``single`` the terms of b.

        A term of the plane has two weights, of a turned combination.  Where an angle turns s, its
        constants are those of q and p in turn, and so are, in space, the weights of its terms.
        """
        planar = self.components == 2
        turned = planar and any(b != 0 for of in sums for _, _, b in of.terms)
        places, weights, counts = list[int](), list[float](), [0, 0]
        for i, of in enumerate(sums):
            counts[i] = len(of.terms) * (1 + turned)
            if turned:
                places += [place + c for place, _, _ in of.terms for c in (0, 1)]
                weights += [weight for _, a, b in of.terms for weight in (a, 0.0 - b)]
                weights += [weight for _, a, b in of.terms for weight in (b, a)]
            else:
                places += [term[0] for term in of.terms]
                weights += [weight for term in of.terms for weight in term[1 : 2 if planar else 3]]
        constants = [number for of in sums for number in of.constant]
        axes = (1 if turned else self.components) if sums else 0
        numbers = len(constants), len(parameters), *counts, len(single)
        shape = Shape(getattr(elements, kind), 1 + turned, axes, *numbers)
        places += [place for place, _ in single]
        weights += [weight for _, weight in single]
        acting = timed if law is None else (laws.Timed(law, parameters),)
        self.elements.add(shape, row, places, [*constants, *parameters, *weights], acting)

    def load(self, place: int, force: Sequence[float] | Array, *timed: laws.Timed) -> None:
        """Add a force on one vector, whose place in u is given."""
        shape = Shape(elements.LOAD, 1, self.components, 0, len(force), 1, 0, 0)
        self.elements.add(shape, -1, [place], force, timed)

    @abstractmethod
    def between(self, start: str, end: str, path: KeyPath) -> Sum:
        """The vector from one point to another, which it moves relative to."""

    def _springs(self, spring: Any, path: KeyPath) -> None:
        between = self.between(spring.from_, spring.to, path)
        if spring.force is None:
            self.add("SPRING", between, parameters=(spring.stiffness, spring.rest_length))
        else:
            self.add("STRETCH", between, parameters=spring_laws.parameters(spring))

    def _dampers(self, damper: Any, path: KeyPath) -> None:
        between = self.between(damper.from_, damper.to, path)
        self.add("DAMPER", between, parameters=(damper.damping,))
