"""Laws of time as rows of element tables: what they say besides their six parameters."""

import math
from typing import NamedTuple

import numpy as np

from newmark_cli.mechanisms.models import Law, Sine, Table

#: What a row is, as in both element loops.
POWERS, SINE, SPLINE = range(3)


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


def negated(law: Law) -> Law:
    """The law with the opposite sign."""
    table = law.table
    return law.model_copy(
        update={
            "value": None if law.value is None else -law.value,
            "rate": -law.rate,
            "acceleration": -law.acceleration,
            "amplitude": -law.amplitude,
            "powers": [-coefficient for coefficient in law.powers],
            "sines": [
                Sine(amplitude=-sine.amplitude, frequency=sine.frequency, phase=sine.phase)
                for sine in law.sines
            ],
            "table": table
            and table.model_copy(update={"values": [-value for value in table.values]}),
        }
    )
