"""Laws of time as rows of element tables: what they say besides their six parameters."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from newmark_cli.mechanisms.models import Law, Table

#: Kinds, which no element has, and their columns behind those that all have: kind, size, and
#: where their numbers begin.
LAW, LAW_TERM = 100, 101
TARGET, DRIVES, MORE = 3, 4, 5
WHAT, COUNT, REPEATS, ANOTHER = 3, 4, 5, 6
#: Place of the weight behind the six parameters.
WEIGHT = 6
POWERS, SINE, SPLINE = range(3)


class Term(NamedTuple):
    """A term of a law of time.

    Attributes:
        what: `POWERS`, `SINE` or `SPLINE`.
        size: Coefficients of a polynomial, or intervals of a spline.
        repeats: Whether a spline repeats itself.
        numbers: See `timed`.
    """

    what: int
    size: int
    repeats: bool
    numbers: list[float]


def terms(law: Law) -> list[Term]:
    """The terms of a law besides its six parameters."""
    further = []
    if law.powers:
        further.append(Term(POWERS, len(law.powers), False, list(law.powers)))
    further += [
        Term(SINE, 1, False, [sine.amplitude, sine.frequency, sine.phase]) for sine in law.sines
    ]
    if law.table is not None:
        times, intervals = law.table.times, _intervals(law.table)
        numbers = [times[0], times[-1], *(number for row in intervals for number in row)]
        further.append(Term(SPLINE, len(intervals), law.table.ends == "periodic", numbers))
    return further


def _intervals(table: Table) -> list[list[float]]:
    """Beginning of each interval, and coefficients of (t − beginning)³, …, 1 in it."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(np.array(table.times), np.array(table.values), bc_type=table.ends)
    rows: list[list[float]] = np.column_stack([spline.x[:-1], spline.c.T]).tolist()
    return rows


def begin(law: Law, value: float) -> float:
    """The law with this constant term at t = 0."""
    start = value + law.amplitude * math.sin(law.phase)
    for term in terms(law):
        first = term.numbers
        if term.what == POWERS:
            start += first[0]
        elif term.what == SINE:
            start += first[0] * math.sin(first[2])
        else:
            begins = [k for k in range(2, len(first), 5) if first[k] <= 0][-1]
            x, a, b, c, d = first[begins : begins + 5]
            start += ((a * -x + b) * -x + c) * -x + d
    return start


def until(law: Law) -> float:
    """Time (s) up to which the law says anything: the end of a table that does not repeat."""
    if law.table is None or law.table.ends == "periodic":
        return math.inf
    return law.table.times[-1]


class Timed(NamedTuple):
    """A law of time of an element.

    Attributes:
        law: The law.
        parameters: Its six.
        target: Which parameter of the element it is added to; None where it drives it.
        weight: Its factor.
    """

    law: Law
    parameters: Sequence[float]
    target: int | None = None
    weight: float = 1.0


def stands_behind(timed: Timed) -> bool:
    """Whether the six parameters of a driven element do not say it all."""
    return timed.target is not None or bool(terms(timed.law))


def append(ints: list[int], reals: list[float], target: int, timed: Timed) -> None:
    """Append a law to both tables, see `timed`; target is the place of what it acts on."""
    further = terms(timed.law)

    def one(kind: int, columns: Sequence[int], numbers: Sequence[float]) -> None:
        ints.extend([kind, 3 + len(columns), len(reals), *columns])
        reals.extend(numbers)

    one(LAW, [target, timed.target is None, bool(further)], [*timed.parameters, timed.weight])
    for left, term in zip(reversed(range(len(further))), further, strict=True):
        one(LAW_TERM, [term.what, term.size, term.repeats, left > 0], term.numbers)
