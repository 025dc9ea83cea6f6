"""Laws of time as rows of element tables: what they say besides their six parameters."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.mechanisms.models import Law, Table

#: Kinds, which no element has, and their columns behind those that all have: kind, size, and
#: where their numbers begin.
LAW, LAW_TERM = 100, 101
TARGET, DRIVES, MORE = 3, 4, 5
WHAT, COUNT, REPEATS, ANOTHER = 3, 4, 5, 6
#: Place of the weight behind the six parameters.
WEIGHT = 6
POWERS, SINE, SPLINE, QUINTIC = range(4)


#: Ends of a quintic spline → (derivative, its value) there.
_QUINTIC_ENDS = {
    "natural": ([(3, 0.0), (4, 0.0)],) * 2,
    "clamped": ([(1, 0.0), (2, 0.0)],) * 2,
    "not-a-knot": (None, None),
}


def terms(law: Law) -> list[tuple[list[int], list[float]]]:
    """Terms besides the six parameters: which, how many of what, whether it repeats; numbers."""
    further: list[tuple[list[int], list[float]]] = []
    if law.powers:
        further.append(([POWERS, len(law.powers), False], list(law.powers)))
    further += [
        ([SINE, 1, False], [sine.amplitude, sine.frequency, sine.phase]) for sine in law.sines
    ]
    if law.table is not None:
        spline = _spline(law.table)
        kind = QUINTIC if law.table.interpolation == "quintic" else SPLINE
        # Beginning of each interval, and coefficients of its powers of t − beginning, down to 1.
        intervals = np.column_stack([spline.x[:-1], spline.c.T])
        numbers = [law.table.times[0], law.table.times[-1], *intervals.ravel().tolist()]
        further.append(([kind, len(intervals), law.table.ends == "periodic"], numbers))
    return further


def _spline(table: Table) -> Any:
    from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly, make_interp_spline

    times, values = np.array(table.times), np.array(table.values)
    if table.interpolation == "pchip":
        return PchipInterpolator(times, values)
    if table.interpolation == "cubic":
        return CubicSpline(times, values, bc_type=table.ends)
    ends: Any = _QUINTIC_ENDS.get(table.ends, table.ends)
    quintic: Any = make_interp_spline(times, values, k=5, bc_type=ends)
    spline = PPoly.from_spline(quintic)
    # Knots at the ends are repeated, or stand beyond them.
    begins = spline.x[:-1]
    inside = (np.diff(spline.x) > 0) & (begins >= times[0]) & (begins < times[-1])
    return PPoly(spline.c[:, inside], np.append(begins[inside], times[-1]))


def begin(law: Law, value: float) -> float:
    """The law with this constant term at t = 0."""
    start = value + law.amplitude * math.sin(law.phase) + sum(law.powers[:1])
    start += sum(sine.amplitude * math.sin(sine.phase) for sine in law.sines)
    return start if law.table is None else start + float(_spline(law.table)(0.0))


def pace(law: Law) -> float:
    """Size of the terms of its rate at t = 0, tables aside: what their rounding goes with."""
    swings = [(law.amplitude, law.frequency)]
    swings += [(sine.amplitude, sine.frequency) for sine in law.sines]
    return sum(map(abs, (law.rate, *law.powers[1:2], *(size * often for size, often in swings))))


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
    for k, (columns, numbers) in enumerate(further, 1):
        one(LAW_TERM, [*columns, k < len(further)], numbers)
