"""Straight lines through log–log data."""

import math
from dataclasses import dataclass

import numpy as np

from newmark_cli.arrays import Array

#: Powers of ten below this are numbers.
_LARGEST = 300


@dataclass(frozen=True)
class Fit:
    """A power law y = 10^intercept · h^slope, by ordinary least squares.

    Attributes:
        slope: Exponent; NaN with fewer than two points.
        stderr: Standard error of the slope; NaN with fewer than three.
        intercept: log₁₀ of the prefactor.
        points: Points fitted; zeros and missing values have no logarithm.
    """

    slope: float
    stderr: float
    intercept: float
    points: int

    def __call__(self, h: Array) -> Array:
        """Fitted values at step sizes h."""
        if abs(self.intercept) < _LARGEST:
            return np.asarray(10**self.intercept * h**self.slope)
        # Steep lines meet h = 1 s beyond all numbers.
        with np.errstate(over="ignore"):
            return np.asarray(10 ** (self.intercept + self.slope * np.log10(h)))


def power_law(h: Array, values: Array) -> Fit:
    """Fit values against step sizes on logarithmic axes.

    Args:
        h: (points,) positive step sizes.
        values: (points,) what was measured; zero, negative and NaN are left out.
    """
    usable = np.isfinite(values) & (values > 0)
    x, y = np.log10(h[usable]), np.log10(values[usable])
    points = len(x)
    if points < 2 or x.max() - x.min() == 0:
        return Fit(np.nan, np.nan, np.nan, points)
    middle = x.mean()
    centred = x - middle
    spread = float((centred * centred).sum())
    slope = float((centred * y).sum()) / spread
    intercept = float(y.mean() - slope * middle)
    misfit = y - intercept - slope * x
    variance = (misfit * misfit).sum() / (points - 2) / spread if points > 2 else np.nan
    return Fit(slope, float(np.sqrt(variance)), intercept, points)


#: Smallest standard error that is printed; smaller ones would round to zero.
SMALLEST_ERROR = 5e-7
_MOST_DECIMALS = 6


def fit_parts(fit: Fit) -> tuple[str, str]:
    """Slope and standard error as text, with as many decimals as the error asks for.

    At least two decimals, at most six.  The error is empty where it is unknown, and
    where it is below `SMALLEST_ERROR`; the slope then has the decimals that differ
    from zero.
    """
    if np.isnan(fit.slope):
        return "n/a", ""
    if fit.stderr < SMALLEST_ERROR:
        digits = _fixed(fit.slope, _MOST_DECIMALS).rstrip("0")
        return digits + "0" * (2 - len(digits.partition(".")[2])), ""
    # "± 0.00" would claim too much.
    small = fit.stderr < 0.005
    decimals = min(-math.floor(math.log10(fit.stderr)), _MOST_DECIMALS) if small else 2
    error = "" if np.isnan(fit.stderr) else _fixed(fit.stderr, decimals)
    return _fixed(fit.slope, decimals), error


def _fixed(value: float, decimals: int) -> str:
    """Fixed point, without a negative zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def format_fit(fit: Fit) -> str:
    """Slope ± standard error; the slope only where the error is unknown or below 5e-7."""
    slope, error = fit_parts(fit)
    return " ± ".join(filter(None, (slope.replace("-", "−"), error)))


def format_order(value: float) -> str:
    """A predicted order: a whole number with a true minus sign; nothing where there is none."""
    return "" if np.isnan(value) else f"{value + 0:g}".replace("-", "−")
