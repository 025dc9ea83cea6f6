"""Straight lines through log–log data."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from newmark_cli.support.arrays import Array


@dataclass(frozen=True)
class Fit:
    """The exponent of a power law, by least squares."""

    slope: float  #: exponent; NaN with fewer than two points
    stderr: float  #: standard error of the slope; NaN with fewer than three
    points: int  #: points fitted; zeros and missing values have no logarithm
    #: Half the width of the interval of the slope, of about 95 %; NaN likewise.
    margin: float = math.nan
    straight: bool = True  #: whether the points are on the line as well as they are known


#: ln 10 and ln 2, and coefficients of the Taylor series of atanh(s)/s, which suffice for s < 0.18.
_LN_10, _LN_2 = 2.302585092994046, 0.6931471805599453
_SERIES = tuple(1 / (2 * k + 1) for k in range(12, -1, -1))


def log10(x: Any) -> Array:
    """log₁₀ of numbers, with the same bits everywhere; NaN of what has none.

    NumPy's depends on whether the processor has AVX-512, and that of a C library on whether it
    has fused multiply-adds.  This is made of sums, products and quotients, which are rounded
    alike everywhere.
    """
    numbers = np.asarray(x, float)
    logarithms = [*map(_log10, numbers.ravel().tolist())]
    return np.array(logarithms, float).reshape(numbers.shape)


@lru_cache(100_000)
def _log10(x: float) -> float:
    """With x = m 2ᵉ and m near 1, ln x = e ln 2 + 2 atanh((m − 1)/(m + 1)), over ln 10."""
    if not 0 < x < math.inf:
        return math.nan
    m, e = math.frexp(x)
    if m * m < 0.5:
        m, e = 2 * m, e - 1
    s = (m - 1) / (m + 1)
    square, series = s * s, 0.0
    for coefficient in _SERIES:
        series = series * square + coefficient
    return (e * _LN_2 + 2 * s * series) / _LN_10


#: Relative uncertainty that every point has besides, as no series is a power law exactly.
_LEAST_UNCERTAINTY = 0.02
#: Standard errors of an interval that holds 95.45 % of a normal distribution.  The same of
#: Student's with 1 to 10 degrees of freedom, and what χ² over them then stays below.
_NORMAL = 2.0
_STUDENT = (13.97, 4.53, 3.31, 2.87, 2.65, 2.52, 2.43, 2.37, 2.32, 2.28)
_SQUARES = (4.0, 3.09, 2.67, 2.43, 2.26, 2.14, 2.05, 1.97, 1.91, 1.86)


def power_law(h: Array, values: Array, uncertainty: Array | None = None) -> Fit:
    """Fit values against step sizes on logarithmic axes.

    With uncertainties the standard error is theirs, or that of the scatter about the line
    where that is larger, and then the interval is Student's.

    Args:
        h: (points,) positive step sizes.
        values: (points,) what was measured; zero, negative and NaN are left out.
        uncertainty: (points,) relative; all alike and not known when omitted.
    """
    usable = np.isfinite(values) & (values > 0)
    x, y = log10(h[usable]), log10(values[usable])
    points = len(x)
    if points < 2 or x.max() - x.min() == 0:
        return Fit(np.nan, np.nan, points)
    known = np.zeros(len(h)) if uncertainty is None else uncertainty
    squares = known[usable] ** 2 + _LEAST_UNCERTAINTY**2
    weights = 1 / squares
    middle, height = (float((weights * z).sum() / weights.sum()) for z in (x, y))
    centred = x - middle
    spread = float((weights * centred * centred).sum())
    slope = float((weights * centred * y).sum()) / spread
    intercept = height - slope * middle
    if points == 2:
        return Fit(slope, np.nan, points)
    misfit = y - intercept - slope * x
    # Of natural logarithms, as relative uncertainties are.
    scatter = float((weights * misfit * misfit).sum()) * _LN_10**2 / (points - 2)
    freedoms = min(points - 2, len(_STUDENT)) - 1
    straight = uncertainty is not None and scatter <= _SQUARES[freedoms]
    stderr = math.sqrt((max(scatter, 1.0) if uncertainty is not None else scatter) / spread)
    stderr /= _LN_10
    factor = _NORMAL if straight else _STUDENT[freedoms]
    return Fit(slope, stderr, points, factor * stderr, straight)


def fit_parts(fit: Fit) -> tuple[str, str]:
    """Slope and standard error as text, with two decimals: no interval of a slope is finer.

    The error is empty where it is unknown, and where it would be 0.00.
    """
    if np.isnan(fit.slope):
        return "n/a", ""
    error = "" if np.isnan(fit.stderr) or fit.stderr < 0.005 else f"{fit.stderr:.2f}"
    # Without a negative zero.
    return f"{round(fit.slope, 2) + 0.0:.2f}", error


def format_fit(fit: Fit) -> str:
    """Slope ± standard error; the slope only where the error is unknown or below 0.005."""
    slope, error = fit_parts(fit)
    return " ± ".join(filter(None, (slope.replace("-", "−"), error)))


def format_order(value: float) -> str:
    """A predicted order: a whole number with a true minus sign; nothing where there is none."""
    return "" if np.isnan(value) else f"{value + 0:g}".replace("-", "−")
