"""From series of the CSVs to what is drawn of them: traces, reference lines, labels, words."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from newmark_cli.report.drawing.panels import (
    Look,
    Panel,
    Reference,
    Trace,
    from_zero,
    spread,
)
from newmark_cli.report.judging.fits import format_fit, format_order
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.judging.verdicts import MISS, PASS, RULED, SHOWN
from newmark_cli.report.reading.words import power, quantity
from newmark_cli.study.axes import value_text
from newmark_cli.study.measures import is_dimensionless
from newmark_cli.support.arrays import Mask


def fit_text(slope: Slope) -> str:
    """The fitted slope of a series that has one, and its verdict if it is not as predicted."""
    verdict = slope.verdict if slope.missed else ""
    return ", ".join(filter(None, (format_fit(slope.fit) if _judged(slope) else "", verdict)))


def _judged(slope: Slope) -> bool:
    """Whether a series has a fitted slope and a predicted one."""
    return slope.verdict in (PASS, MISS) and not math.isnan(slope.expected + slope.fit.slope)


#: What labels say of reactions that redundant constraints share.
NOT_UNIQUE = " (not unique)"


def ruled(slope: Slope) -> Mask:
    """(points,) which points rounding rules: where it is half of a value, and at smaller h."""
    if slope.record.kind == "rounding":
        return np.full(len(slope.h), False)
    with np.errstate(invalid="ignore"):
        ruling = (slope.values > 0) & (slope.rounding >= RULED * slope.values)
    return np.asarray(ruling.any() & (slope.h <= np.max(slope.h[ruling], initial=0.0)))


def trace(slope: Slope, label: str, look: Look, name: str, **overrides: Any) -> Trace:
    """A series against the step size; cells that did not end well stand apart."""
    order = np.argsort(slope.h)
    parts: dict[str, Any] = {
        "x": slope.h[order],
        "y": slope.values[order],
        "apart": ~np.isin(np.array(slope.statuses, str), slope.record.ok)[order],
        "ruled": ruled(slope)[order],
        # Of corrections it is the scatter of steps, which is no rounding of the rms.
        "bars": None if slope.record.kind == "rounding" else slope.rounding[order],
        "said": in_words(name, slope),
    }
    return Trace(label, **{"look": look, **parts, **overrides})


def panel(
    slopes: Sequence[Slope],
    traces: Sequence[Trace],
    titles: tuple[str, ...],
    every: Sequence[Slope],
) -> Panel:
    """Traces of series of one measure beside their predicted slopes; the ordinate suits `every`."""
    record = slopes[0].record
    values = [slope.values for slope in every]
    if record.linear:
        most = max(float(np.max(v[np.isfinite(v)], initial=0.0)) for v in values)
        top = 1.0 if record.share else 1.1 * most
        limits = from_zero(top) if top > 0 else None
    else:
        limits = spread(values)
    several = len({slope.quantity for slope in slopes}) > 1
    label = value_text("measure", slopes[0].measure) if several else record.label(slopes[0].key)
    if not any(slope.unique for slope in slopes):
        label += NOT_UNIQUE
    return Panel(
        tuple(traces),
        f"step size $h$ ({'dimensionless' if is_dimensionless(slopes[0].problem) else 's'})",
        label,
        titles,
        y_scale="linear" if record.linear else "log",
        y_limits=limits,
        references=() if record.linear or limits is None else predicted(slopes, limits),
        levels=_solver_limits(slopes),
    )


def predicted(slopes: Sequence[Slope], limits: tuple[float, float]) -> tuple[Reference, ...]:
    """A line for each distinct predicted slope, above all judged series that have it.

    It stands at the points that were fitted, or where no series was judged at those that rounding
    does not rule.
    """
    drawn: dict[float, tuple[tuple[bool, float], Reference]] = {}
    low, high = np.log10(limits)
    shift = 0.045 * (high - low)
    for slope in slopes:
        usable = slope.fitted if _judged(slope) else ~ruled(slope)
        with np.errstate(invalid="ignore"):
            shown = np.logical_and(usable, np.isfinite(slope.values) & (slope.values > 0))
        shown &= np.isin(np.array(slope.statuses, str), slope.record.ok)
        if math.isnan(slope.expected) or len(set(slope.h[shown])) < 2:
            continue
        log_h, log_y = np.log10(slope.h[shown]), np.log10(slope.values[shown])
        ends = np.array([log_h.min(), log_h.max()])
        at_1 = float(log_y.mean() - slope.expected * log_h.mean())
        rank = _judged(slope), at_1
        if slope.expected not in drawn or rank > drawn[slope.expected][0]:
            line = at_1 + slope.expected * ends + shift
            order = power("h", format_order(slope.expected))
            drawn[slope.expected] = rank, Reference(10**ends, 10**line, order)
    return tuple(line for _, line in drawn.values())


def in_words(name: str, slope: Slope) -> str:
    """A series in words: its name, its slope or else its values at either end, its verdict."""
    text = f"{quantity(slope)}, {name}: "
    if _judged(slope):
        text += f"slope {format_fit(slope.fit)}, predicted {format_order(slope.expected)}"
    else:
        ends = [int(np.argmax(slope.h)), int(np.argmin(slope.h))]
        text += ", ".join(f"{slope.values[i]:.3g} at h = {slope.h[i]:g}" for i in ends)
    return text + (f", {slope.verdict}" if slope.verdict != SHOWN else "")


def _solver_limits(slopes: Sequence[Slope]) -> dict[float, str]:
    """Levels of cells that stagnated: all iterations that were allowed."""
    return {
        float(value): f"no convergence in {value:.0f} iterations"
        for slope in slopes
        for value, status in zip(slope.values, slope.statuses, strict=True)
        if status == "stagnated" and slope.record.at_limit and math.isfinite(value)
    }
