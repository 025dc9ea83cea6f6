"""Laws of time as rows of element tables: what they say besides their six parameters."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from newmark_cli.mechanisms.models import Law, Table

#: Kinds, which no element has, and columns.
LAW, LAW_TERM = 100, 101
TARGET, COLUMN, MORE = 1, 2, 3
WEIGHT = 6
WHAT, SIZE, REPEATS, ANOTHER = 1, 2, 3, 4
POWERS, SINE, SPLINE = range(3)
#: Column of a law that drives its element.
DRIVES = -1


class Term(NamedTuple):
    """A term of a law of time.

    Attributes:
        what: `POWERS`, `SINE` or `SPLINE`.
        size: Coefficients of a polynomial, or intervals of a spline.
        repeats: Whether a spline repeats itself.
        rows: What the real table has in its row, and of a spline in those behind it.
    """

    what: int
    size: int
    repeats: bool
    rows: list[list[float]]


def terms(law: Law) -> list[Term]:
    """The terms of a law besides its six parameters."""
    found = []
    if law.powers:
        found.append(Term(POWERS, len(law.powers), False, [list(law.powers)]))
    for sine in law.sines:
        row = [sine.amplitude, sine.frequency, sine.phase]
        found.append(Term(SINE, 1, False, [row]))
    if law.table is not None:
        table = law.table
        rows = [[table.times[0], table.times[-1]], *_intervals(table)]
        found.append(Term(SPLINE, len(rows) - 1, table.ends == "periodic", rows))
    return found


def _intervals(table: Table) -> list[list[float]]:
    """Beginning of each interval, and coefficients of (t − beginning)³, …, 1 in it."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(np.array(table.times), np.array(table.values), bc_type=table.ends)
    rows: list[list[float]] = np.column_stack([spline.x[:-1], spline.c.T]).tolist()
    return rows


def begin(law: Law, value: float) -> float:
    """The law at t = 0.

    Args:
        law: The law.
        value: Its constant term.
    """
    start = value + law.amplitude * math.sin(law.phase)
    for term in terms(law):
        first = term.rows[0]
        if term.what == POWERS:
            start += first[0]
        elif term.what == SINE:
            start += first[0] * math.sin(first[2])
        else:
            here = [row for row in term.rows[1:] if row[0] <= 0][-1]
            x = -here[0]
            start += ((here[1] * x + here[2]) * x + here[3]) * x + here[4]
    return start


def until(law: Law) -> float:
    """Time (s) up to which the law says anything: the end of a table that does not repeat."""
    if law.table is None or law.table.ends == "periodic":
        return math.inf
    return law.table.times[-1]


class Timed(NamedTuple):
    """A law of time of an element.

    Attributes:
        column: Column of the real table that it is added to, or `DRIVES`.
        law: The law.
        parameters: Its six.
        weight: Its factor.
    """

    column: int
    law: Law
    parameters: Sequence[float]
    weight: float = 1.0


def rows(laws: Sequence[tuple[int, Timed]]) -> Iterator[tuple[list[int], Sequence[float]]]:
    """Rows of both tables behind all elements, see `timed`.

    None where the six parameters of driven elements, which stand in their rows, say it all;
    otherwise every law has some.

    Args:
        laws: Row of an element, and a law that it has.
    """
    if all(one.column == DRIVES and not terms(one.law) for _, one in laws):
        return
    for target, one in laws:
        further = terms(one.law)
        yield (
            [LAW, target, one.column, int(bool(further))],
            [*one.parameters, one.weight],
        )
        for number, term in enumerate(further):
            another = int(number < len(further) - 1)
            own = [LAW_TERM, term.what, term.size, int(term.repeats), another]
            for place, reals in enumerate(term.rows):
                yield (own if place == 0 else [LAW_TERM]), reals
