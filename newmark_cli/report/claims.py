"""Claims about figures past the paper, as data: a kind of claim for each idea.

A claim reads series of the CSVs alone and comes to a `Finding`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.report.curves import Curve
from newmark_cli.report.fits import format_fit, format_order, power_law
from newmark_cli.report.verdicts import INCOMPLETE, MISS, PASS
from newmark_cli.study.measures import RECORDS


class Series(Protocol):
    """The part of a series that a claim reads; see `newmark_cli.report.slopes.Slope`."""

    @property
    def h(self) -> Array:
        """(points,) step sizes."""

    @property
    def values(self) -> Array:
        """(points,) the statistic that is drawn; not negative."""

    @property
    def statuses(self) -> tuple[str, ...]:
        """Status of the cell behind each point."""


#: The series of a curve; None where the results lack it.
Find = Callable[[Curve], Series | None]


@dataclass(frozen=True)
class Finding:
    """The result of a claim.

    Attributes:
        measured: As text.
        value: As a number; the worst where the claim is about several, NaN where it is none.
        verdict: pass, miss or incomplete.
    """

    measured: str
    value: float
    verdict: str


class NoDataError(Exception):
    """Results lack what a claim reads; the text says what."""


class Claim(Protocol):
    """A sentence about series, true or false."""

    @property
    def text(self) -> str:
        """The sentence."""

    def measure(self, find: Find) -> Finding:
        """Compare it with results.

        Raises:
            NoDataError: When a series or a point is missing, not finite, or of a
                cell that did not end well.
        """


def evaluate(claim: Claim, find: Find) -> Finding:
    """Compare a claim with results; it is incomplete where its data are missing."""
    try:
        return claim.measure(find)
    except NoDataError as missing:
        return Finding(str(missing), math.nan, INCOMPLETE)


@dataclass(frozen=True)
class SlopeClaim:
    """A power law over all step sizes of a series.

    Attributes:
        curve: The series.
        order: Claimed slope.
        tolerance: Largest |fitted − order|.
    """

    curve: Curve
    order: float
    tolerance: float

    @property
    def text(self) -> str:
        """The sentence."""
        return f"{self.curve.label}: {self.said}"

    @property
    def said(self) -> str:
        """What it says of the series."""
        return f"slope {format_order(self.order)} ± {self.tolerance:g}"

    def measure(self, find: Find) -> Finding:
        """Fit it."""
        h, values = _points(self.curve, find)
        fit = power_law(h, values)
        if fit.points < len(h) or math.isnan(fit.slope):
            raise NoDataError(f"{self.curve.label}: cannot be fitted")
        within = abs(fit.slope - self.order) <= self.tolerance
        return Finding(format_fit(fit), fit.slope, PASS if within else MISS)


@dataclass(frozen=True)
class BoundClaim:
    """Bounds of a series at one step size, or at each.

    Attributes:
        curve: The series.
        low, high: Bounds, which the value may take.
        h: Where (s); at every step size when omitted.
    """

    curve: Curve
    low: float = 0.0
    high: float = math.inf
    h: float | None = None

    @property
    def text(self) -> str:
        """The sentence."""
        return f"{self.curve.label}, {self.said}"

    @property
    def said(self) -> str:
        """What it says of the series."""
        where = "every h" if self.h is None else f"h = {self.h:g}"
        return f"{where}: {_bounds(self.low, self.high)}"

    def measure(self, find: Find) -> Finding:
        """Take the value, or the worst."""
        return _within(_values(self.curve, self.h, find), self.low, self.high)


@dataclass(frozen=True)
class RatioClaim:
    """Bounds of the quotients of series, in a unit.

    Attributes:
        what: How the sentence names the quotients.
        pairs: Numerator and denominator, each pair over the same step sizes.
        low, high: Bounds, which a quotient may take.
        unit: What each quotient is divided by.
        at: Step sizes of numerator and denominator (s); every one when omitted.
    """

    what: str
    pairs: tuple[tuple[Curve, Curve], ...]
    low: float = 0.0
    high: float = math.inf
    unit: float = 1.0
    at: tuple[float, float] | None = None

    @property
    def text(self) -> str:
        """The sentence."""
        return f"{self.what}: {_bounds(self.low, self.high)}"

    def measure(self, find: Find) -> Finding:
        """Take the worst quotient."""
        quotients = np.concatenate([self._quotients(pair, find) for pair in self.pairs])
        return _within(quotients, self.low, self.high)

    def _quotients(self, pair: tuple[Curve, Curve], find: Find) -> Array:
        if self.at is None:
            h, other = (_points(curve, find)[0] for curve in pair)
            if len(h) != len(other) or not np.allclose(h, other, rtol=1e-9, atol=0):
                raise NoDataError(f"{pair[0].label}, {pair[1].label}: at different step sizes")
        above, below = (
            _values(curve, h, find) for curve, h in zip(pair, self.at or (None, None), strict=True)
        )
        if np.any(below == 0):
            raise NoDataError(f"{pair[1].label}: zero")
        return np.asarray(above / below / self.unit)


@dataclass(frozen=True)
class FloorClaim:
    """Predicted floors of corrections beside the corrections themselves.

    Points count where the cell ended well and a correction was not zero throughout.

    Attributes:
        pairs: Prediction and measurement, each over the same step sizes.
        near, far: Factors within which nine in ten quotients, and all, must be.
    """

    pairs: tuple[tuple[Curve, Curve], ...]
    near: float = 2.0
    far: float = 10 / 3

    @property
    def text(self) -> str:
        """The sentence."""
        return (
            f"predicted / measured correction: nine in ten within a factor of {self.near:g}, "
            f"all within {self.far:.2g}"
        )

    def measure(self, find: Find) -> Finding:
        """Take the share that is near, and the worst."""
        found = np.concatenate([self._quotients(pair, find) for pair in self.pairs])
        if len(found) == 0:
            raise NoDataError("no step size with both")
        beyond = np.fmax(found, 1 / found)
        share, worst = float(np.mean(beyond <= self.near)), float(found[np.argmax(beyond)])
        holds = share >= 0.9 and beyond.max() <= self.far
        text = f"{share:.0%} of {len(found)}, worst {worst:.3g}"
        return Finding(text, worst, PASS if holds else MISS)

    def _quotients(self, pair: tuple[Curve, Curve], find: Find) -> Array:
        prediction, measured = (_series(curve, find) for curve in pair)
        predicted = dict(zip(prediction.h.tolist(), prediction.values.tolist(), strict=True))
        quotients = [
            predicted[h] / value
            for h, value, status in zip(
                measured.h.tolist(), measured.values.tolist(), measured.statuses, strict=True
            )
            if status == "ok" and value > 0 and predicted.get(h, math.nan) > 0
        ]
        return np.array(quotients)


@dataclass(frozen=True)
class SpreadClaim:
    """A series that hardly depends on the step size.

    Attributes:
        curve: The series.
        high: Bound of (max − min)/min over the step sizes.
    """

    curve: Curve
    high: float

    @property
    def text(self) -> str:
        """The sentence."""
        return f"{self.curve.label}: (max − min)/min over h {_bounds(0, self.high)}"

    def measure(self, find: Find) -> Finding:
        """Take the spread."""
        _, values = _points(self.curve, find)
        least = np.min(values)
        if len(values) < 2 or least == 0:
            raise NoDataError(f"{self.curve.label}: needs two values, none of them zero")
        return _within((np.max(values, keepdims=True) - least) / least, 0.0, self.high)


@dataclass(frozen=True)
class StatusClaim:
    """How the cell of a series at its smallest step size ends.

    Attributes:
        curve: The series.
        status: The status.
    """

    curve: Curve
    status: str

    @property
    def text(self) -> str:
        """The sentence."""
        return f"{self.curve.label}, smallest h: {self.status}"

    def measure(self, find: Find) -> Finding:
        """Take the status."""
        series = _series(self.curve, find)
        place = int(np.argmin(series.h))
        found = series.statuses[place]
        verdict = PASS if found == self.status else MISS
        return Finding(f"{found} at h = {series.h[place]:g}", math.nan, verdict)


def _series(curve: Curve, find: Find) -> Series:
    series = find(curve)
    if series is None or len(series.h) == 0:
        raise NoDataError(f"no {curve.label}")
    return series


def _points(curve: Curve, find: Find, h: float | None = None) -> tuple[Array, Array]:
    """Step sizes, ascending, and values that count, at h or at every step size."""
    series = _series(curve, find)
    places = np.argsort(series.h)
    if h is not None:
        places = places[np.isclose(series.h[places], h, rtol=1e-9, atol=0)]
        if len(places) == 0:
            raise NoDataError(f"no {curve.label} at h = {h:g}")
    for place in places:
        where = f"{curve.label} at h = {series.h[place]:g}"
        if series.statuses[place] not in RECORDS[curve.measure].ok:
            raise NoDataError(f"{where}: {series.statuses[place]}")
        if not math.isfinite(series.values[place]):
            raise NoDataError(f"{where}: no value")
    return series.h[places], series.values[places]


def _values(curve: Curve, h: float | None, find: Find) -> Array:
    return _points(curve, find, h)[1]


def _within(values: Array, low: float, high: float) -> Finding:
    """Of several values the one that is farthest beyond a bound, or else nearest to one."""
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.fmax(low / values, values / high)
    value = float(values[np.argmax(beyond)])
    return Finding(f"{value:.3g}", value, PASS if low <= value <= high else MISS)


def _bounds(low: float, high: float) -> str:
    if low == high:
        return f"{low:g}"
    if math.isinf(high):
        return f"at least {low:g}"
    return f"{low:.3g} to {high:.3g}" if low else f"at most {high:g}"
