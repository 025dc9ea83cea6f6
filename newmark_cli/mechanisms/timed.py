"""Laws of time in the element tables of mechanisms, in the plane and in space.

A law has six parameters: c + r t + s t²/2 + A sin(ω t + φ).  Elements that are driven have
them among their own.  Where a law says more than that, or a number of another element is one,
laws stand behind all elements as kinds of their own, with their six parameters and a weight: a
`TARGET` in ``reals`` to which weight times law is added, or, where it is what `DRIVES` its
element, the first of six parameters that are replaced.  Each is followed by its terms, `MORE`
and `ANOTHER` telling whether one comes:

========  ===================================================================
``WHAT``  the numbers of the term
========  ===================================================================
POWERS    coefficients of 1, t, t², …, `COUNT` of them
SINE      A, ω, φ
SPLINE    first and last time; `COUNT` times the beginning of an interval and
          the coefficients of (t − beginning)³, …, 1 in it
QUINTIC   the same, from (t − beginning)⁵ on
========  ===================================================================

Beyond the last time a spline is not a number, unless it repeats itself.  `at_time` makes of
such a table one without laws, for the loops over elements.
"""

import numpy as np

from newmark_cli.mechanisms import laws, sines
from newmark_cli.support.cached_code import cached_njit, part_njit

sine_cosine = cached_njit(nogil=True, error_model="numpy")(sines.sine_cosine)
_part = part_njit(nogil=True, error_model="numpy")

#: How far beyond the ends of a spline it still holds, of its length: rounding of t.
_SLACK = 1e-6


@_part
def _oscillation(t, reals, first, derivative):
    """A sin(ω t + φ), whose numbers begin at a place, or its first or second derivative."""
    amplitude, frequency = reals[0, first], reals[0, first + 1]
    sine, cosine = sine_cosine(frequency * t + reals[0, first + 2], reals.dtype.type)
    if derivative == 0:
        return amplitude * sine
    if derivative == 1:
        return amplitude * frequency * cosine
    return -amplitude * frequency * frequency * sine


@_part
def law(t, reals, first, derivative):
    """The six parameters from a place on as a law of time, or a derivative of it."""
    rate, second = reals[0, first + 1], reals[0, first + 2]
    oscillation = _oscillation(t, reals, first + 3, derivative)
    if derivative == 0:
        half = reals.dtype.type(0.5)
        return reals[0, first] + (rate + half * second * t) * t + oscillation
    if derivative == 1:
        return rate + second * t + oscillation
    return second + oscillation


@_part
def interval(x, reals, r, count, width):
    """Where the numbers of the interval with x begin, of some of a width, from r on."""
    low, high = 0, count - 1
    while low < high:
        middle = (low + high + 1) // 2
        if x >= reals[0, r + width * middle]:
            low = middle
        else:
            high = middle - 1
    return r + width * low


@_part
def _term(t, what, count, repeats, reals, r, derivative):
    """A term of a law of time whose numbers begin at r, or its first or second derivative."""
    real = reals.dtype.type
    total = real(0)
    if what == laws.SINE:
        return _oscillation(t, reals, r, derivative)
    degree, backwards = count - 1, False
    if what != laws.POWERS:
        first, last = reals[0, r], reals[0, r + 1]
        if repeats != 0:
            t = t - (last - first) * np.floor((t - first) / (last - first))
        slack = real(_SLACK) * (last - first)
        if not first - slack <= t <= last + slack:
            return total + real(np.nan)
        degree, backwards = 5 if what == laws.QUINTIC else 3, True
        r = interval(t, reals, r + 2, count, degree + 2)
        t, r = t - reals[0, r], r + 1
    for k in range(degree, derivative - 1, -1):
        factor = real(1)
        for j in range(derivative):
            factor *= real(k - j)
        total = total * t + factor * reals[0, r + (degree - k if backwards else k)]
    return total


@_part
def _whole_law(t, ints, reals, e, derivative):
    """The law at e, with its terms, or its first or second derivative."""
    value = law(t, reals, ints[0, e + 2], derivative)
    another = ints[0, e + laws.MORE]
    while another != 0:
        e += ints[0, e + 1]
        what, count = ints[0, e + laws.WHAT], ints[0, e + laws.COUNT]
        repeats, r = ints[0, e + laws.REPEATS], ints[0, e + 2]
        value += _term(t, what, count, repeats, reals, r, derivative)
        another = ints[0, e + laws.ANOTHER]
    return value


@cached_njit(nogil=True, error_model="numpy")
def at_time(t, ints, reals):
    """A time and numbers (1, …) up to the laws of a table: its elements are at t as these then.

    Without laws both are the given ones.

    Args:
        t: Time (s).
        ints, reals: Tables with laws.
    """
    last = 0
    while last < ints.shape[1] and ints[0, last] != laws.LAW:
        last += ints[0, last + 1]
    if last == ints.shape[1]:
        return t, reals
    frozen = np.empty((1, ints[0, last + 2]), reals.dtype)
    for k in range(frozen.shape[1]):
        frozen[0, k] = reals[0, k]
    e = last
    while e < ints.shape[1]:
        if ints[0, e] == laws.LAW:
            target, drives = ints[0, e + laws.TARGET], ints[0, e + laws.DRIVES] != 0
            weight = reals[0, ints[0, e + 2] + laws.WEIGHT]
            for k in range(3 if drives else 1):
                value = _whole_law(t, ints, reals, e, k)
                if drives:
                    frozen[0, target + k] = value
                else:
                    frozen[0, target] += weight * value
            if drives:
                frozen[0, target + 3] = 0
        e += ints[0, e + 1]
    return reals.dtype.type(0), frozen
