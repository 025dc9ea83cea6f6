"""Laws of time in the element tables of mechanisms, in the plane and in space.

A law has six parameters: c + r t + s t²/2 + A sin(ω t + φ).  Elements that are driven have
them in their own row.  Where a law says more than that, or a number of another element is one,
rows of kind `LAW` stand behind all elements, one for each law of the table:

=========  ==================================================================
``ints``   kind, row of the element, column of its ``reals`` that weight times law is added
           to, or −1 for the six parameters of what is driven, whether terms follow
``reals``  six parameters, weight
=========  ==================================================================

Each is followed by its terms, of kind `LAW_TERM`, with columns `WHAT`, `SIZE`, `REPEATS` and
`ANOTHER`, whether one more follows:

========  ===================================================================
``WHAT``  the ``reals`` of the row
========  ===================================================================
POWERS    coefficients of 1, t, t², …, `SIZE` of them
SINE      A, ω, φ
SPLINE    first and last time; the next `SIZE` rows have the beginning of an interval
          and the coefficients of (t − beginning)³, …, 1 in it
========  ===================================================================

Beyond the last time a spline is not a number, unless it repeats itself.  `at_time` makes of
such a table one without laws, for the loops over elements.
"""

import numpy as np

from newmark_cli.mechanisms import sines
from newmark_cli.mechanisms.laws import (
    ANOTHER,
    COLUMN,
    LAW,
    MORE,
    POWERS,
    REPEATS,
    SINE,
    SIZE,
    SPLINE,
    TARGET,
    WEIGHT,
    WHAT,
)
from newmark_cli.support.cached_code import cached_njit

sine_cosine = cached_njit(nogil=True, error_model="numpy")(sines.sine_cosine)

#: How far beyond the ends of a spline it still holds, of its length: rounding of t.
_SLACK = 1e-6


@cached_njit(nogil=True, error_model="numpy")
def law(t, reals, e, first, derivative):
    """The six parameters from a column on as a law of time, or a derivative of it."""
    real = reals.dtype.type
    half = real(0.5)
    rate, second = reals[e, first + 1], reals[e, first + 2]
    amplitude, frequency = reals[e, first + 3], reals[e, first + 4]
    phase = frequency * t + reals[e, first + 5]
    if derivative == 0:
        return (
            reals[e, first]
            + (rate + half * second * t) * t
            + amplitude * sine_cosine(phase, real)[0]
        )
    if derivative == 1:
        return rate + second * t + amplitude * frequency * sine_cosine(phase, real)[1]
    return second - amplitude * frequency * frequency * sine_cosine(phase, real)[0]


@cached_njit(nogil=True, error_model="numpy")
def _term(t, ints, reals, row, derivative):
    """A term of a law of time, or its first or second derivative."""
    real = reals.dtype.type
    what, size = ints[row, WHAT], ints[row, SIZE]
    total = real(0)
    if what == POWERS:
        for k in range(size - 1, derivative - 1, -1):
            factor = real(1)
            for j in range(derivative):
                factor *= real(k - j)
            total = total * t + factor * reals[row, k]
        return total
    if what == SINE:
        amplitude, frequency = reals[row, 0], reals[row, 1]
        phase = frequency * t + reals[row, 2]
        if derivative == 0:
            return amplitude * sine_cosine(phase, real)[0]
        if derivative == 1:
            return amplitude * frequency * sine_cosine(phase, real)[1]
        return -amplitude * frequency * frequency * sine_cosine(phase, real)[0]
    first, last = reals[row, 0], reals[row, 1]
    if ints[row, REPEATS] != 0:
        t = t - (last - first) * np.floor((t - first) / (last - first))
    slack = real(_SLACK) * (last - first)
    if not first - slack <= t <= last + slack:
        return total + real(np.nan)
    low, high = row + 1, row + size
    while low < high:
        middle = (low + high + 1) // 2
        if t >= reals[middle, 0]:
            low = middle
        else:
            high = middle - 1
    x = t - reals[low, 0]
    a, b, c, d = reals[low, 1], reals[low, 2], reals[low, 3], reals[low, 4]
    if derivative == 0:
        return ((a * x + b) * x + c) * x + d
    if derivative == 1:
        return (real(3) * a * x + real(2) * b) * x + c
    return real(6) * a * x + real(2) * b


@cached_njit(nogil=True, error_model="numpy")
def _whole_law(t, ints, reals, row, derivative):
    """The law in a row, with its terms, or its first or second derivative."""
    value = law(t, reals, row, 0, derivative)
    term = row + 1 if ints[row, MORE] != 0 else 0
    while term > 0:
        value += _term(t, ints, reals, term, derivative)
        after = term + 1 + (ints[term, SIZE] if ints[term, WHAT] == SPLINE else 0)
        term = after if ints[term, ANOTHER] != 0 else 0
    return value


@cached_njit(nogil=True, error_model="numpy")
def at_time(t, ints, reals, parameters):
    """Both tables without the rows of laws, with laws that at t = 0 are what they are at t.

    Args:
        t: Time (s).
        ints, reals: Tables with rows of kind `LAW`.
        parameters: Column from which on the row of what is driven has its six.
    """
    count = 0
    while ints[count, 0] != LAW:
        count += 1
    frozen = reals[:count].copy()
    for row in range(count, ints.shape[0]):
        if ints[row, 0] == LAW:
            e, column = ints[row, TARGET], ints[row, COLUMN]
            if column < 0:
                for k in range(3):
                    frozen[e, parameters + k] = _whole_law(t, ints, reals, row, k)
                frozen[e, parameters + 3] = 0
            else:
                frozen[e, column] += reals[row, WEIGHT] * _whole_law(t, ints, reals, row, 0)
    return ints[:count], frozen
