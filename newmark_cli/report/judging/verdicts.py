"""Verdicts of a check: one rule for every measure.

Every point has an uncertainty, which is measured.  A weighted fit of the points that
rounding does not rule gives a slope with an interval, and the verdict is where that
interval is: within the tolerance of the predicted order, outside it, or neither.

Beside the interval the rule knows what a series of the bench needs (`tests/verification`): that
coarse step sizes may be left out, three shares of rounding, singular motions, of errors that
they are small, do not fall faster than predicted (near-change-point) and have a whole order (a
quick return with BDF2), of condition numbers and corrections the orders of other terms (a
suspension; stiff-spring in millimetres, hoist far from the origin), of condition numbers that they
vary along a motion (double pendulums), and of corrections that a few steps may rule their rms
(trammel far from the origin).
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from newmark_cli.report.judging.fits import Fit, format_fit, format_order, log10, power_law
from newmark_cli.support.arrays import Array, Mask

#: As predicted; not so.
PASS, MISS = "pass", "miss"
#: Results that it needs are not there, or a cell is not ok.
INCOMPLETE = "incomplete"
#: Theory predicts nothing: a value that is shown, not checked.
SHOWN = "shown"
#: The error does not fall with h, far above its rounding.
NOT_CONVERGING = "not converging"
#: The interval of the slope is neither within the tolerance nor outside it.
UNDECIDED = "undecided"

#: Verdicts with which a check fails.
FAILING = (MISS, NOT_CONVERGING, INCOMPLETE)

#: Least number of step sizes that an order is read from.
LEAST = 3
#: Rounding over value from which on rounding rules a point, and below which it is clear: twins
#: tell rounding to a factor of 10.  They do not see what is alike in all of them, and rounding
#: that is alike in N steps adds up to √N times as much.
RULED, _CLEAR = 0.5, 0.1
#: Relative uncertainty of corrections from which on a few steps rule their rms.
_FEW = 0.25
#: Least range of h that can speak against a series, but for rounding of its ends.
_DECADE = 9.99
#: Largest relative error that is small enough for its order to be that of the first term.
_SMALL = 0.1
#: Relative uncertainty of an error as a power of h, for the terms of the next order.
_NEXT_TERM = 0.05
#: Decades that rounding of h may add to a range of it.
_SAME = 1e-9
#: Why errors may be large, and multipliers wrong at every h without damping.
_TOO_COARSE = "h may be too coarse"
ALTERNATES = "the integrator does not damp multipliers that alternate, generalized-alpha does"


@dataclass(frozen=True, eq=False)
class Evidence:
    """A series as it is judged, step sizes descending."""

    h: Array  #: (points,) step sizes
    values: Array  #: (points,) the statistic that is drawn
    #: (points,) of each, relative: rounding over value, or the scatter of corrections; NaN where it
    #: was not measured.
    uncertainty: Array
    steps: Array  #: (points,) steps of the run
    kind: str  #: what rules the values; see `newmark_cli.study.measures.Record`
    expected: float = math.nan  #: predicted order; NaN where nobody says one
    tolerance: float = math.nan  #: largest |fitted − expected|; NaN likewise
    exact: bool = False  #: whether theory predicts nothing but rounding, of an error or invariant
    bound: str = ""  #: why the predicted order is only a lower bound; empty where it is the order
    coarse: Collection[float] = ()  #: orders that may show where h is too coarse
    typical: Array | None = None  #: (points,) medians along the runs
    largest: Array | None = None  #: (points,) largest values along the runs
    undamped: bool = False  #: whether multipliers may alternate from step to step, and stay so
    #: what a step leaves of the alternation that multipliers have from the start; 0 of others
    fading: float = 0.0
    irregular: str = ""  #: why no order holds along this motion; empty where one does
    #: whether the order is a user's, who wrote what holds at these step sizes; theory speaks of
    #: ever smaller ones, and spares what may come to its order there
    written: bool = False


class Judgement(NamedTuple):
    """Verdict on a series."""

    verdict: str  #: one of the words of this module
    fit: Fit  #: power law through the points that were fitted
    fitted: Mask  #: (points,) which these are
    reason: str = ""  #: what else there is to say, in a sentence; may be empty


def local_orders(h: Array, values: Array) -> Array:
    """(points − 1,) orders between successive points; NaN next to what has no logarithm."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.diff(log10(values)) / np.diff(log10(h)))


def judge(evidence: Evidence) -> Judgement:
    """The verdict on a series."""
    if evidence.kind == "truncation" and not np.all(np.isfinite(evidence.values)):
        return _judged(evidence, INCOMPLETE, np.isfinite(evidence.h), "no value at every step size")
    if evidence.exact:
        return _rounding_alone(evidence)
    # What could be rounding that is alike in all steps speaks against nothing.
    alike = np.minimum(_CLEAR, 1 / np.sqrt(np.maximum(evidence.steps, 1.0)))
    clear, left_out = _above(evidence, alike)
    unknown = bool(np.isnan(evidence.uncertainty).any())
    judgement = None
    if evidence.kind == "truncation" and _stalls(evidence, clear):
        judgement = _not_converging(evidence, clear)
    if math.isnan(evidence.expected):
        return judgement if judgement and not unknown else _of_any_order(evidence)
    # Rounding may hide an order sooner than it can feign one.
    for share in (RULED, _CLEAR, alike):
        if passed := _passed(evidence, *_above(evidence, share)):
            return passed
    judgement = judgement or _missed(evidence, clear, left_out)
    if judgement.verdict != UNDECIDED and unknown:
        reason = joined(judgement.reason, "its rounding was not measured, which twins do")
        return Judgement(UNDECIDED, judgement.fit, judgement.fitted, reason)
    return judgement


def _of_any_order(evidence: Evidence) -> Judgement:
    """The judgement on a series for which no order is predicted."""
    seen, unclear = _above(evidence, _CLEAR)
    if evidence.kind != "truncation":
        unclear = ""
    elif evidence.undamped and evidence.values[-1] > _SMALL:
        unclear = joined(unclear, f"off by {evidence.values[-1]:.2g} of its size: {ALTERNATES}")
    if not evidence.written:
        return _judged(evidence, SHOWN, seen, unclear)
    for window in _windows(seen):  # held against any order, so that there must be one
        if _fit(evidence, window).straight:
            return _judged(evidence, SHOWN, window, unclear)
    return _judged(evidence, UNDECIDED, seen, joined(_wanted(evidence, seen), unclear))


def _judged(evidence: Evidence, verdict: str, fitted: Mask, reason: str = "") -> Judgement:
    return Judgement(verdict, _fit(evidence, fitted), fitted, reason)


def _fit(evidence: Evidence, fitted: Mask) -> Fit:
    uncertainty = np.nan_to_num(evidence.uncertainty[fitted], nan=0.0, posinf=1.0)
    if evidence.kind == "truncation":
        uncertainty = np.sqrt(uncertainty * uncertainty + _NEXT_TERM**2)
    return power_law(evidence.h[fitted], evidence.values[fitted], uncertainty)


def joined(*parts: str) -> str:
    """What there is to say, one after the other."""
    return "; ".join(filter(None, parts))


def _above(evidence: Evidence, share: float | Array) -> tuple[Mask, str]:
    """Points from the coarsest on of which rounding is less than a share, and what is left out.

    Words and hollow markers have one threshold: rounding rules from half of a value on.  What is
    left out for a smaller share is what it may rule.
    """
    usable = np.isfinite(evidence.values) & (evidence.values > 0)
    zeros = int(np.count_nonzero(evidence.values == 0))
    left = f"{zeros} of {len(evidence.h)} values are exactly 0" if zeros else ""
    cuts: dict[int, str] = {}
    for word, least in (("may rule", share), ("rules", RULED)):
        ruled = usable & (evidence.uncertainty >= least)
        if ruled.any() and evidence.kind != "rounding":
            cuts[int(np.argmax(ruled))] = word
    if not cuts:
        return usable, left
    usable[min(cuts) :] = False
    where = (
        f"{word} below h = {evidence.h[first - 1]:g}" if first else f"{word} at every h"
        for first, word in cuts.items()
    )
    return usable, joined(left, f"rounding {', '.join(where)}")


def _rounding_alone(evidence: Evidence) -> Judgement:
    """The verdict where theory predicts nothing but rounding."""
    everything = np.isfinite(evidence.h)
    if np.isnan(evidence.uncertainty).any():
        reason = (
            f"at most {evidence.values.max():.2g}; its rounding was not measured, which twins do"
        )
        return _judged(evidence, UNDECIDED, everything, reason)
    rounding = np.where(evidence.values > 0, evidence.uncertainty, 0.0) * evidence.values
    where = int(np.argmax(evidence.values - rounding / _CLEAR))
    value, reach = evidence.values[where], rounding[where]
    reason = f"{value:.2g} at h = {evidence.h[where]:g}, which rounding changes by {reach:.2g}"
    if value > reach / _CLEAR:
        reason = joined(f"more than rounding: {reason}", evidence.irregular)
        verdict = UNDECIDED if evidence.irregular else MISS
        return _judged(evidence, verdict, everything, reason)
    return _judged(evidence, PASS, everything, f"rounding only: {reason}")


def _windows(points: Mask) -> Iterator[Mask]:
    """All points, then ever fewer, without the coarsest, as long as there are enough."""
    places = np.flatnonzero(points)
    for first in range(max(len(places) - LEAST + 1, 0)):
        window = np.full(len(points), False)
        window[places[first:]] = True
        yield window


def _passed(evidence: Evidence, points: Mask, left: str) -> Judgement | None:
    """The pass of a series with a predicted order, if it passes."""
    for window in _windows(points):
        fit = _fit(evidence, window)
        off = fit.slope - evidence.expected
        if abs(off) <= evidence.tolerance and fit.margin <= 2 * evidence.tolerance:
            first = int(np.argmax(window))
            head = f"order shows from h = {evidence.h[first]:g}" if points[:first].any() else ""
            return Judgement(PASS, fit, window, joined(head, left))
        if evidence.bound and off - fit.margin >= -evidence.tolerance:
            reason = f"at least order {format_order(evidence.expected)}, a bound: {evidence.bound}"
            return Judgement(PASS, fit, window, joined(reason, left))
    return None


def _missed(evidence: Evidence, points: Mask, left: str) -> Judgement:
    for window in _windows(points):
        fit = _fit(evidence, window)
        off = abs(fit.slope - evidence.expected) - evidence.tolerance
        if off > fit.margin and (fit.straight or evidence.written):
            first, last = evidence.h[window][[0, -1]].tolist()
            reason = f"slope {_sloped(fit)} over h = {first:g} … {last:g}"
            why = evidence.irregular or _of_start(evidence, window)
            if evidence.written:
                return Judgement(MISS, fit, window, joined(reason, why, left))
            spared = why or _spared(evidence, window, fit)
            if not spared and _between(evidence, fit):
                continue
            if not spared and first < _DECADE * last:
                more = _further(evidence, points)
                spared = reason = f"{reason}, less than a decade: {more} h would decide"
            reason = spared or reason
            return Judgement(UNDECIDED if spared else MISS, fit, window, joined(reason, left))
    seen, left = _above(evidence, _CLEAR)
    return _judged(evidence, UNDECIDED, seen, joined(_wanted(evidence, seen), left))


def _between(evidence: Evidence, fit: Fit) -> bool:
    """Whether the slope of an error is no whole number, as orders are, so that h is too coarse.

    As λ of a quick return with BDF2: 1.66 from errors of 10 % on, on a straight line by chance.
    """
    off = abs(fit.slope - np.round(fit.slope))
    return evidence.kind == "truncation" and bool(off > evidence.tolerance + fit.margin)


def _stalls(evidence: Evidence, points: Mask) -> bool:
    """Whether the values do not fall with h, though they are far above their rounding.

    Over three step sizes or more they fall by less than a tenth of an order from the first to
    the last, and by less than half an order from the largest.
    """
    places = np.flatnonzero(points)
    h, values = evidence.h[places], evidence.values[places]
    for first in range(len(places) - LEAST + 1):
        finer = h[-1] / h[first:]
        top = int(np.argmax(values[first:]))
        slow_falls = values[first] * finer[0] ** 0.1, values[first + top] * finer[top] ** 0.5
        if values[-1] >= max(slow_falls):
            return True
    return False


def _not_converging(evidence: Evidence, points: Mask) -> Judgement:
    last = int(np.flatnonzero(points)[-1])
    value, h = evidence.values[last], evidence.h[last]
    reason = (
        f"does not fall with h: {value:.2g} at h = {h:g}, which rounding changes by "
        f"{evidence.uncertainty[last] * value:.2g}"
    )
    coarse = _TOO_COARSE if value > _SMALL and evidence.kind == "truncation" else ""
    why = ALTERNATES if evidence.undamped else coarse
    return _judged(evidence, NOT_CONVERGING, points, joined(reason, why, evidence.irregular))


def _spared(evidence: Evidence, fitted: Mask, fit: Fit) -> str:
    """Why a slope outside the tolerance is no miss; empty if it is one."""
    for other in evidence.coarse:
        near = abs(fit.slope - other) <= 2 * evidence.tolerance
        # The rms of steps goes over slowly from one order to the other.
        between = evidence.kind == "rounding" and evidence.expected < fit.slope < other
        if other > evidence.expected and (near or between):
            return (
                f"terms of order {format_order(other)} rule until smaller h lets those of order "
                f"{format_order(evidence.expected)} overtake"
            )
    typical, largest, h = evidence.typical, evidence.largest, evidence.h[fitted]
    if evidence.kind == "determined" and typical is not None and largest is not None:
        # A coarse march passes other states than a fine one.
        factor = float((largest[fitted] / typical[fitted]).max())
        if abs(fit.slope - evidence.expected) < log10(factor) / log10(h[0] / h[-1]):
            more = _further(evidence, fitted)
            return f"varies by a factor of {factor:.2g} along a run: {more} h would decide"
    if evidence.kind == "rounding":
        few = bool((evidence.uncertainty[fitted] > _FEW).any())
        if (evidence.bound or few) and typical is not None:
            of_most = power_law(evidence.h, typical)
            # Of a bound it changes with h how many steps come close to it.
            if of_most.points >= LEAST and of_most.slope >= evidence.expected - evidence.tolerance:
                return f"a few steps rule; the median has order {format_fit(of_most)}"
        return "a few steps rule: more steps would decide" if few else ""
    if evidence.kind != "truncation":
        return ""
    least = float(evidence.values[fitted].min())
    if least > _SMALL:
        return f"errors of {least:.0%} are not small, which orders are about; {_TOO_COARSE}"
    # As those of BDF2 near a change point, where an error that ends small has been large.
    if fit.slope > evidence.expected:
        shows = "shows at smaller h" if fitted[-1] else "rounding hides"
        return f"falls faster than order {format_order(evidence.expected)}, which {shows}"
    return ""


def _further(evidence: Evidence, points: Mask) -> str:
    """Which step sizes there may be besides: smaller ones are no use where rounding rules."""
    return "smaller" if points[-1] else "larger"


def _of_start(evidence: Evidence, points: Mask) -> str:
    """Why multipliers tell of the start at some of the points; empty where they do not.

    What index 3 leaves in them there decays as N² ρᴺ: each step passes it on through u, v and a.
    Of a method that nobody names ρ is not known.
    """
    if math.isnan(evidence.expected):
        return ""
    with np.errstate(under="ignore"):
        left = evidence.steps**2 * evidence.fading**evidence.steps
    ruled = np.flatnonzero(points & (left > evidence.values))
    if not len(ruled):
        return ""
    h, steps = evidence.h[ruled[0]], evidence.steps[ruled[0]]
    return (
        f"λ still alternates from the start at h = {h:g}: ρ∞ = {evidence.fading:.2g} leaves "
        f"N² ρ∞^N = {left[ruled[0]]:.2g} after N = {steps:g} steps; "
        "ρ∞ = 0.5, a longer t_end or index 2 would decide"
    )


def _wanted(evidence: Evidence, points: Mask) -> str:
    """What would decide a slope whose interval straddles the tolerance."""
    fit, h = _fit(evidence, points), evidence.h[points]
    more = _further(evidence, points)
    if not evidence.values.any():
        return ""
    if not len(h) and evidence.kind == "determined":
        return "nothing but rounding: the problem may lack it"
    few = len(h) < LEAST
    sizes = f"{len(h)} usable step size{'s' * (len(h) != 1)}, an order needs {LEAST}"
    found = sizes if few else f"slope {_sloped(fit)}"
    if why := evidence.irregular or _of_start(evidence, points):
        return joined(found, why)
    if few:
        return f"{found}: {more} h would decide"
    if not fit.straight or _between(evidence, fit):
        cure = "smaller h would decide" if points[-1] else "and rounding hides which it tends to"
        return f"{found}: the order still changes with h, {cure}"
    spanned = float(log10(h[0] / h[-1]))
    decades = math.ceil(spanned * fit.margin / evidence.tolerance)
    if more == "larger":
        return f"{found}: larger h, over {decades} decades above h = {h[-1]:g}, would decide"
    if decades <= spanned + _SAME:
        return f"{found}: more step sizes would decide"
    return f"{found}: h over {decades} decades or more would decide"


def _sloped(fit: Fit) -> str:
    """A slope with its interval; ± stands for its standard error elsewhere."""
    low, high = (f"{fit.slope + side * fit.margin:.2f}" for side in (-1, 1))
    slope = format_order(round(fit.slope, 2))
    return f"{slope} (interval {low} to {high})".replace("-", "−")
