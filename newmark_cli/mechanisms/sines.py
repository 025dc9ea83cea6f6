"""Sines and cosines with the same bits everywhere, for laws of time and angles.

Those of a C library depend on whether the processor has fused multiply-adds: with glibc, in
seven of ten thousand arguments.  These are Taylor series behind a reduction to |x| ≤ π/4 in
three parts of π/2 (Cody and Waite, Software Manual for the Elementary Functions, 1980); up to
|x| = 1e5 they are off by less than a unit in the last place.
"""

from typing import Any

import numpy as np

_QUARTERS = 2 / np.pi
#: π/2 in two parts of 33 bits, of which a multiple is exact, and the rest.
_FIRST, _SECOND, _REST = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21


def sine_cosine(x: Any, real: Any) -> tuple[Any, Any]:
    """Sine and cosine of an angle.

    Args:
        x: The angle (rad); complex where tangents are found by complex steps.
        real: Type of the results; they are computed in double precision.
    """
    turns = np.rint(x.real * _QUARTERS)
    long = x - turns * _FIRST
    shift = turns * _SECOND
    near = long - shift
    rest = ((long - near) - shift) - turns * _REST
    square = near * near
    odd, even = 0.0, 0.0
    for k in range(8, 0, -1):
        odd = square * (1 - odd) / ((2 * k) * (2 * k + 1))
        even = square * (1 - even) / ((2 * k + 1) * (2 * k + 2))
    sine = near - (near * odd - rest)
    half = 0.5 * square
    one = 1 - half
    cosine = one + (((1 - one) - half) + (half * even - near * rest))
    quarter = turns - 4 * np.floor(turns / 4)
    if quarter == 0:
        return real(sine), real(cosine)
    if quarter == 1:
        return real(cosine), real(-sine)
    if quarter == 2:
        return real(-sine), real(-cosine)
    return real(-cosine), real(sine)
