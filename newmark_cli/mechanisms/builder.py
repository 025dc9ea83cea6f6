"""What builders of mechanisms in the plane and in space have in common."""

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from newmark_cli.mechanisms import laws
from newmark_cli.mechanisms.models import Law
from newmark_cli.problems.problem import Problem
from newmark_cli.support import documents
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import Document, DocumentError, KeyPath
from newmark_cli.support.spelling import nearest


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


def apart(length: float, misfit: float) -> str:
    """A distance in so many digits that its misfit from a length shows."""
    digits = 12 if abs(misfit) > 1e-9 * length else 16
    return f"{length + misfit:.{digits}g}"


class Builder(ABC):
    """Turns a mechanism into the tables of an element loop.

    A mistake in one part does not keep the others from being looked at; `problem` raises
    all of them together.

    Attributes:
        name: Of the problem.
        document: Where errors are.
        mechanism: What the file says.
        mistakes: Those of the parts.
        broken: Kind and name of what has a mistake: a reference to it is not another one.
        rows: All constraints.
        squares: Squares of lengths, of constraints ½ (|Δ|² − L²).
    """

    def __init__(self, name: str, document: Document, mechanism: Any) -> None:
        self.name, self.document, self.mechanism = name, document, mechanism
        self.mistakes = documents.Mistakes()
        self.broken: set[tuple[str, ...]] = set()
        self.rows: list[Row] = []
        self.squares: dict[int, float] = {}

    @abstractmethod
    def problem(self, released: Sequence[int] = ()) -> Problem:
        """The problem as the file has it, without some of its constraints.

        Raises:
            DocumentError: For mistakes in its parts.
        """

    @abstractmethod
    def velocities(self, u: Array) -> Array:
        """(n,) velocities that the file gives, at a position."""

    @abstractmethod
    def without_inertia(self, u: Array, motions: Array) -> list[tuple[KeyPath, str]]:
        """Keys and words of motions (n, k) that have no inertia."""

    def rates(self, u: Array) -> Iterator[tuple[KeyPath, Array, float]]:
        """Key, gradient (n,) and value of each rate that the file gives besides velocities."""
        return iter(())

    @contextmanager
    def checked(self, *broken: str) -> Iterator[None]:
        """Take up a mistake of the block, which ends there; kind and name are then broken."""
        try:
            yield
        except (DocumentError, Follows) as error:
            if isinstance(error, DocumentError):
                self.mistakes.note(error)
            if broken:
                self.broken.add(broken)

    def unknown(
        self, kind: str, name: str, path: KeyPath, allowed: Collection[str]
    ) -> DocumentError:
        """A reference to what there is not."""
        # Looking for the nearest name takes its time, which only what is printed is worth.
        hint = "" if self.mistakes.full else nearest(name, allowed)
        return self.document.error(path, f"unknown {kind} {name!r}{hint}")

    def one_row(self, path: KeyPath) -> int:
        """Number of a constraint that is the only one of its key."""
        self.rows.append(Row(path, ".".join(map(str, path))))
        return len(self.rows) - 1

    def fitting(
        self, law: Law, now: float, path: KeyPath, period: float = math.inf
    ) -> tuple[float, ...]:
        """Parameters of a law of time that starts where the mechanism does.

        Args:
            law: The law.
            now: Where the mechanism starts; a guess may be left.
            path: Where the law came from.
            period: Values that differ by it are the same; infinite for a length.

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
