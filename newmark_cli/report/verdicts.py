"""Verdicts of a check, decided from the data and the theory together.

A series over the step size has up to three parts: a head where h does not resolve the
motion yet, an asymptotic middle, and a tail where rounding rules.  Local orders between
successive step sizes tell them apart, and theory says how high rounding may reach.  The
fit and the verdict are about the middle; where there is too little of it, the verdict
says so instead of calling a right series a miss or a wrong one a pass.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from newmark_cli.arrays import Array, Mask
from newmark_cli.report.fits import Fit, format_fit, format_order, power_law

#: As predicted; not so.
PASS, MISS = "pass", "miss"
#: Results that it needs are not there, or a cell is not ok.
INCOMPLETE = "incomplete"
#: Theory predicts nothing: a value that is shown, not checked.
SHOWN = "shown"
#: The error does not fall with h, or is as large as what it is an error of.
NOT_CONVERGING = "not converging"
#: The step sizes are too coarse for the order to show.
NOT_ASYMPTOTIC = "not asymptotic"
#: Fewer than three step sizes show the order, whatever it is.
TOO_FEW = "too few points"

#: Verdicts with which a check fails.
FAILING = (MISS, NOT_CONVERGING, INCOMPLETE)
#: Verdicts that say nothing against a series, and nothing for it.
UNDECIDED = (NOT_ASYMPTOTIC, TOO_FEW)

#: Least number of step sizes that an order is read from.
LEAST = 3
#: How far a local order may be from the order of the middle.  Truncation and condition
#: numbers are smooth; rms of rounding scatter, by a factor of 2 between two step sizes.
_LOCAL = {"truncation": 0.25, "rounding": 0.6}
#: How far above that an alternation which is not damped may carry it: from starts one unit in
#: the last place apart, Andrews' mechanism reaches 400 in v at h = 1e-6, as its motion multiplies
#: a kick across the constraints by 1e7.  And how far above the order of the middle the drift
#: of λ may carry corrections and condition numbers.
_FED, _DRIFT = 1e3, 10.0
#: Rounding of a block that is zero, in units of roundoff and of balanced rows and unknowns.
_LACKING = 1e4
#: Relative error that is no longer a solution.
_LOST = 0.3
#: Rounding of a run of N steps, in units of roundoff: factor · N^power.  The powers are
#: those of the corrections, ε, ε/h and ε/h² of u, v and λ, after N steps that add up
#: like a random walk in v; the factor covers 20 mechanisms that were held against
#: marches in 33 digits, where λ reached 230, v 215 and u 100.
_ROUNDING_FACTOR = 3e3
#: Rounding of λ where the study has recorded how a mechanism amplifies that of u, in units of
#: roundoff · amplification / h².  Eight mechanisms in the plane and in space, one h below the
#: other, reach 30 to 200.
_AMPLIFIED_FACTOR = 600.0
_ROUNDING_POWER = {
    "u": 1.0, "v": 1.5, "lambda": 2.0, "multiplier": 2.0, "velocity": 1.5,
    "omega": 1.5, "force": 2.0, "moment": 2.0,
}  # fmt: skip
#: Quantities that are multipliers, or reactions, which are linear in them.
_OF_MULTIPLIERS = ("lambda", "multiplier", "force", "moment")


@dataclass(frozen=True, eq=False)
class Evidence:
    """A series as it is judged, step sizes descending.

    Attributes:
        h: (points,) step sizes.
        values: (points,) the statistic that is drawn.
        steps: (points,) steps of the run.
        kind: What rules the values; see `newmark_cli.study.measures.Record`.
        quantity: As in the CSV.
        expected: Predicted order; NaN where theory says nothing.
        tolerance: Largest |fitted − expected|; NaN likewise.
        damped: Whether the integrator damps an error that alternates.
        unit: Unit roundoff of the march.
        reference_error: What the reference itself may be off by, relative.
        coarse: Orders that may show where h is too coarse, besides the predicted one.
        compensated: Whether the evaluation is compensated.
        floor: Power of the number of steps with which rounding may grow; None where the
            quantity says it.
        exact: Whether theory predicts nothing but rounding, of an error or invariant.
        bound: Why the predicted order is only a lower bound; empty where it is the order.
        lacking: Order of the rounding of a value that may vanish; NaN where it cannot.
        typical: (points,) medians over the steps; empty where they are not known.
        amplification: Relative rounding of λ, or a reaction, for one of u, times h² (s²); 0
            where the study does not say.
    """

    h: Array
    values: Array
    steps: Array
    kind: str
    quantity: str = "u"
    expected: float = math.nan
    tolerance: float = math.nan
    damped: bool = True
    unit: float = 2.0**-52
    reference_error: float = 0.0
    coarse: Collection[float] = ()
    compensated: bool = False
    floor: float | None = None
    exact: bool = False
    bound: str = ""
    lacking: float = math.nan
    typical: Array = field(default_factory=lambda: np.empty(0))
    amplification: float = 0.0

    @property
    def local_orders(self) -> Array:
        """(points − 1,) orders between successive step sizes; NaN next to a zero."""
        return local_orders(self.h, self.values)

    @property
    def rounding(self) -> Array:
        """(points,) what rounding alone may amount to, for errors and invariants."""
        power = _ROUNDING_POWER.get(self.quantity, 1.0)
        if self.floor is not None:
            power = self.floor
        elif self.compensated and self.quantity in _OF_MULTIPLIERS:
            power -= 1  # the floor of λ is ε/h, not ε/h²
        level = _ROUNDING_FACTOR * self.unit * np.maximum(self.steps, 1.0) ** power
        if self.quantity in _OF_MULTIPLIERS and power == _ROUNDING_POWER["lambda"]:
            # Steps say nothing of a run that is short for its mechanism.
            each = _AMPLIFIED_FACTOR * self.unit * self.amplification / self.h**2
            level = np.maximum(level, each)
        return np.asarray(np.maximum(level, 10 * self.reference_error))


@dataclass(frozen=True, eq=False)
class Judgement:
    """Verdict on a series.

    Attributes:
        verdict: One of the words of this module.
        fit: Power law through the middle, or through all where there is none.
        fitted: (points,) which points the fit is for.
        reason: What else there is to say, in a sentence; may be empty.
    """

    verdict: str
    fit: Fit
    fitted: Mask = field(repr=False)
    reason: str = ""


def local_orders(h: Array, values: Array) -> Array:
    """(points − 1,) orders between successive points; NaN next to what has no logarithm."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(np.where(values > 0, values, np.nan))
        return np.asarray(np.diff(logs) / np.diff(np.log(h)))


def judge(given: Evidence) -> Judgement:
    """The verdict on a series.

    Args:
        given: The series; of cells that ended well.
    """
    everything = np.full(len(given.h), True)
    if given.kind == "truncation":
        return _truncation(given, everything)
    if math.isnan(given.expected):
        return _judged(given, SHOWN, everything)
    found = _of_order(given)
    if found.verdict != PASS and not math.isnan(given.lacking):
        largest = _LACKING * given.unit * given.h**given.lacking
        if bool(np.all(given.values <= largest)):
            return _judged(given, PASS, everything, "rounding of 0: the problem lacks this block")
    return found


def _of_order(given: Evidence) -> Judgement:
    """The verdict on a series that is not an error, and of which theory predicts an order."""
    usable = np.isfinite(given.values) & (given.values > 0)
    if np.count_nonzero(usable) < LEAST:
        zeros = int(np.count_nonzero(given.values == 0))
        reason = f"{zeros} of {len(given.h)} values are exactly 0" if zeros else ""
        return _judged(given, TOO_FEW, usable, reason)
    found = (_rounding if given.kind == "rounding" else _determined)(given, usable)
    return _from_one_side(given, usable, found) if given.bound else found


def _from_one_side(given: Evidence, usable: Mask, found: Judgement) -> Judgement:
    """The verdict where theory gives a lower bound of the order: more passes, less does not."""
    if found.verdict == PASS:
        return found
    fit = power_law(given.h[usable], given.values[usable])
    if fit.slope < given.expected - given.tolerance:
        if found.verdict == MISS and (typical := _within(given, usable)) is not None:
            # A bound of each step; how many steps come close to it changes with h.
            reason = f"a few steps rule; the median has order {format_fit(typical)}"
            return Judgement(NOT_ASYMPTOTIC, fit, usable, reason)
        return found
    reason = f"at least order {format_order(given.expected)}, a bound: {given.bound}"
    return Judgement(PASS, fit, usable, reason)


def _within(given: Evidence, usable: Mask) -> Fit | None:
    """The fit through the medians where they are within a bound that the rms is beyond."""
    if not len(given.typical):
        return None
    fit = power_law(given.h[usable], given.typical[usable])
    within = fit.points >= LEAST and fit.slope >= given.expected - given.tolerance
    return fit if within else None


def _judged(given: Evidence, verdict: str, fitted: Mask, reason: str = "") -> Judgement:
    return Judgement(verdict, power_law(given.h[fitted], given.values[fitted]), fitted, reason)


def _runs(near: Mask) -> list[tuple[int, int]]:
    """(first, last) point of every maximal run of local orders that are near, longest first.

    Of runs of one length the one of the smallest step sizes comes first.
    """
    found, start = [], None
    for i, good in enumerate([*near, False]):
        if good and start is None:
            start = i
        if not good and start is not None:
            found.append((start, i))
            start = None
    return sorted(found, key=lambda run: (run[0] - run[1], -run[0]))


def _window(usable: Mask, first: int, last: int) -> Mask:
    """Which points are the first-th to the last-th of those that are usable."""
    window = np.full(len(usable), False)
    window[np.flatnonzero(usable)[first : last + 1]] = True
    return window


def _listed(given: Evidence, first: int, last: int) -> str:
    return f"h = {given.h[first]:g} … {given.h[last]:g}"


# -- errors and invariants ----------------------------------------------------------------------


def _truncation(given: Evidence, everything: Mask) -> Judgement:
    """An error: of order p down to rounding, unless it does not converge."""
    h, values, level = given.h, given.values, given.rounding
    if not np.all(np.isfinite(values)):
        return _judged(given, INCOMPLETE, everything, "no value at every step size")
    above = values > level
    if given.exact:
        where = int(np.argmax(values / level))
        reason = f"{values[where]:.2g} at h = {h[where]:g}, rounding may reach {level[where]:.2g}"
        if above.any():
            return _judged(given, MISS, everything, f"more than rounding: {reason}")
        return _judged(given, PASS, everything, f"rounding only: at most {reason}")
    if not above.any():
        size = f"at most {values.max():.2g}, rounding may reach {level.min():.2g}"
        predicted = not math.isnan(given.expected)
        return _judged(given, TOO_FEW if predicted else SHOWN, everything, f"rounding: {size}")
    lost = above[-1] and values[-1] >= 1
    if lost:
        reason = f"at h = {h[-1]:g} it is {values[-1]:.2g} times as large as what it is an error of"
        return _judged(given, NOT_CONVERGING, everything, reason + _undamped(given))
    if math.isnan(given.expected):
        return _unpredicted(given, above, everything)

    orders = given.local_orders
    near = np.abs(orders - given.expected) <= max(_LOCAL["truncation"], given.tolerance)
    for first, last in _runs(near):
        window = _window(everything, first, last)
        if last - first + 1 < LEAST:
            break
        fit = power_law(h[window], values[window])
        if abs(fit.slope - given.expected) <= given.tolerance:
            return _with_tail(given, window, first, last)
    return _without_middle(given, above, everything)


def _undamped(given: Evidence) -> str:
    """The cause of multipliers that do not converge."""
    if given.damped or given.quantity not in _OF_MULTIPLIERS:
        return ""
    return "; the integrator does not damp multipliers that alternate, generalized-alpha does"


def _unpredicted(given: Evidence, above: Mask, everything: Mask) -> Judgement:
    """Theory predicts no order; that an error falls with h it does."""
    falls = len(given.h) < LEAST or given.values[-1] < 0.7 * given.values[:-1].min()
    if above[-1] and not falls:
        for order in given.coarse:
            near = np.abs(given.local_orders - order) <= _LOCAL["truncation"]
            for first, last in _runs(near):
                if last - first + 1 >= LEAST and given.values[-1] < _LOST:
                    reason = (
                        f"order {order:g} down to h = {given.h[last]:g}; below it rounding feeds "
                        "an alternation that is not damped"
                    )
                    return _judged(given, SHOWN, _window(everything, first, last), reason)
        low = given.rounding[-1]
        reason = (
            f"does not fall with h: {given.values[-1]:.2g} at h = {given.h[-1]:g}, where rounding "
            f"may reach {low:.2g}"
        )
        return _judged(given, NOT_CONVERGING, everything, reason + _undamped(given))
    return _judged(given, SHOWN, everything)


def _with_tail(given: Evidence, window: Mask, first: int, last: int) -> Judgement:
    """A middle of the right order; what follows must be rounding."""
    h, values = given.h, given.values
    parts = []
    if first > 0:
        parts.append(f"order shows from h = {h[first]:g}")
    if last < len(h) - 1:
        tail = values[last + 1 :]
        is_rounding = bool(np.all(tail <= given.rounding[last + 1 :]))
        # An error that alternates is fed by rounding in every step, and never leaves.
        fed = bool(np.all(tail <= _FED * given.rounding[last + 1 :]))
        grows = given.local_orders[-1] <= -0.5
        is_fed = not given.damped and (fed or grows) and tail.max() < _LOST
        if not (is_rounding or is_fed):
            level = given.rounding[-1]
            if abs(given.local_orders[-1] - given.expected) <= _LOCAL["truncation"]:
                reason = f"order {given.expected:g} is lost below h = {h[last]:g} and comes back"
                return _judged(given, NOT_ASYMPTOTIC, window, reason)
            if tail[-1] < 0.7 * values[last]:
                reason = f"order {given.expected:g} is lost below h = {h[last]:g}"
                return _judged(given, MISS, window, reason)
            reason = f"stalls at {tail[-1]:.2g}, where rounding may reach {level:.2g}"
            return _judged(given, NOT_CONVERGING, window, reason)
        how = "" if is_rounding else ", which feeds an alternation that is not damped,"
        parts.append(f"rounding{how} rules below h = {h[last]:g}")
    return _judged(given, PASS, window, "; ".join(parts))


def _without_middle(given: Evidence, above: Mask, everything: Mask) -> Judgement:
    """No three step sizes show the order: too coarse, too few before rounding, or wrong."""
    h, values, orders = given.h, given.values, given.local_orders
    count = int(np.argmin(above)) if not above.all() else len(above)
    for i in range(len(orders) - 1):
        pair = orders[i : i + 2]
        agree = np.ptp(pair) <= 0.15 and above[i] and above[i + 1]
        agree = agree and np.all(np.abs(orders[i + 2 : count - 1] - pair.mean()) <= 0.3)
        if agree and 0.3 < pair.mean() < given.expected - max(
            _LOCAL["truncation"], given.tolerance
        ):
            reason = f"order {pair.mean():.2g} over {_listed(given, i, i + 2)}"
            return _judged(given, MISS, _window(everything, i, i + 2), reason)
    if above[-1]:
        smallest = values[:-1].min() if len(values) > 1 else math.inf
        if values[-1] >= _LOST and len(h) >= LEAST:
            return _judged(
                given, NOT_CONVERGING, everything,
                f"still {values[-1]:.0%} at the smallest h = {h[-1]:g}",
            )  # fmt: skip
        if values[-1] >= 0.7 * smallest:
            reason = (
                f"does not fall with h: {values[-1]:.2g} at h = {h[-1]:g}, where rounding may "
                f"reach {given.rounding[-1]:.2g}"
            )
            return _judged(given, NOT_CONVERGING, everything, reason)
    if len(h) < LEAST or count < LEAST:
        reason = (
            f"rounding rules from h = {h[count]:g} on" if count < len(h) else f"{len(h)} step sizes"
        )
        return _judged(given, TOO_FEW, everything, reason)
    return _judged(given, NOT_ASYMPTOTIC, everything, "local orders have not settled yet")


# -- corrections --------------------------------------------------------------------------------


def _rounding(given: Evidence, usable: Mask) -> Judgement:
    """Corrections at saturation: they scatter, and the order is that of the trend."""
    h, values = given.h[usable], given.values[usable]
    points = len(h)
    orders = local_orders(h, values)
    zeros = int(np.count_nonzero(given.values == 0))
    parts = [f"{zeros} of {len(given.h)} values are exactly 0"] if zeros else []

    # The whole first, then without a head, then (where λ drifts) without a tail.
    tails = range(points - 1, points - 1 if given.damped else LEAST - 2, -1) or (points - 1,)
    windows = sorted(
        (
            (first, last)
            for last in {points - 1, *tails}
            for first in range(points)
            if last - first + 1 >= LEAST
        ),
        key=lambda w: (w[0] - w[1], points - 1 - w[1]),
    )
    for first, last in windows:
        fit = power_law(h[first : last + 1], values[first : last + 1])
        whole = (first, last) == (0, points - 1)
        steady = np.all(np.abs(orders[first:last] - given.expected) <= _LOCAL["rounding"])
        beyond = values[last + 1 :] <= _DRIFT * fit(h[last + 1 :])
        if abs(fit.slope - given.expected) <= given.tolerance and (
            whole or (steady and beyond.all())
        ):
            if first > 0:
                parts.append(f"order shows from h = {h[first]:g}")
            if last < points - 1:
                parts.append(f"drift of the multipliers rules below h = {h[last]:g}")
            return _judged(given, PASS, _window(usable, first, last), "; ".join(parts))
    fit = power_law(h, values)
    # A trend that scatter hides is no trend: its error is as large as what it misses.
    hidden = abs(fit.slope - given.expected) <= 1.5 * fit.stderr and fit.stderr > given.tolerance
    last, before = (abs(order - given.expected) for order in (orders[-1], orders[-2]))
    settles = last <= given.tolerance or (points == LEAST and last <= _LOCAL["rounding"] < before)
    if hidden or settles:
        parts.append(
            f"scatter of ± {fit.stderr:.2g} hides the order" if hidden
            else "only the last two step sizes have the order"
        )  # fmt: skip
        return _judged(given, NOT_ASYMPTOTIC, usable, "; ".join(parts))
    return _judged(given, MISS, usable, "; ".join(parts))


# -- condition numbers, sensitivities -------------------------------------------------------------


def _determined(given: Evidence, usable: Mask) -> Judgement:
    """Smooth in h: a crossover from other orders at coarse h, the predicted one below."""
    h, values = given.h[usable], given.values[usable]
    points = len(h)
    orders = local_orders(h, values)
    off = np.abs(orders - given.expected)

    whole = power_law(h, values)
    if abs(whole.slope - given.expected) <= given.tolerance and off[-1] <= 2 * given.tolerance:
        return _judged(given, PASS, usable)
    for first, last in _runs(off <= given.tolerance):
        if last - first + 1 < LEAST:
            break
        if last == points - 1:
            return _judged(
                given, PASS, _window(usable, first, last), f"order shows from h = {h[first]:g}"
            )
        fit = power_law(h[first : last + 1], values[first : last + 1])
        if not given.damped and np.all(values[last + 1 :] <= _DRIFT * fit(h[last + 1 :])):
            reason = f"drift of the multipliers enters the matrix below h = {h[last]:g}"
            return _judged(given, PASS, _window(usable, first, last), reason)
    approaching = points > 2 and off[-1] < min(0.8 * off[-2], 1.0)
    if off[-1] <= given.tolerance or approaching:
        return _judged(given, NOT_ASYMPTOTIC, usable, "local orders still approach the prediction")
    for other in given.coarse:
        if other > given.expected and abs(orders[-1] - other) <= 0.1:
            reason = (
                f"order {format_order(other)} until smaller h lets the terms of order "
                f"{format_order(given.expected)} overtake"
            )
            return _judged(given, NOT_ASYMPTOTIC, usable, reason)
    return _judged(given, MISS, usable)
