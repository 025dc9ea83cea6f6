"""From series of the CSVs to what is drawn of them: traces, reference lines, labels, words."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from newmark_cli.report.drawing.panels import (
    Level,
    Look,
    Panel,
    Reference,
    Trace,
    from_zero,
    power,
    spread,
)
from newmark_cli.report.judging.fits import format_fit, format_order
from newmark_cli.report.reading.words import quantity
from newmark_cli.support.arrays import Array, Mask

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope

#: Problems of unit mass, length and gravity; all others are in SI units.
_WITHOUT_UNITS = ("pendulum", "chain")


def step_label(problem: str) -> str:
    """Label of the abscissa of a problem: the step size, and its unit where it has one."""
    return "step size $h$" + ("" if problem.partition("(")[0] in _WITHOUT_UNITS else " (s)")


def trace(
    slope: "Slope",
    label: str,
    look: Look,
    fit: str | None = None,
    name: str | None = None,
) -> Trace:
    """A series against the step size; cells whose Krylov solver stagnated stand apart.

    Args:
        slope: The series.
        label: Its name in the legend.
        look: How it looks.
        fit: Fitted slope as text; when omitted, as `format_fit` has it where theory predicts one.
        name: Its name in words, where the label is not enough.
    """
    if fit is None:
        fitted = not (math.isnan(slope.expected) or math.isnan(slope.fit.slope))
        fit = format_fit(slope.fit) if fitted else ""
    order = np.argsort(slope.h)
    stagnated = np.array([status == "stagnated" for status in slope.statuses], bool)
    return Trace(
        label if slope.unique else f"{label} (not unique)",
        slope.h[order],
        slope.values[order],
        look,
        apart=stagnated[order],
        # Of corrections it is the scatter of steps, which is no rounding of the rms.
        bars=None if slope.record.kind == "rounding" else slope.rounding[order],
        fit=fit,
        said=in_words(name or label, slope),
    )


def panel(
    slopes: Sequence["Slope"],
    traces: Sequence[Trace],
    linear: bool = False,
    title: str = "",
    fits: bool = False,
) -> Panel:
    """Series of one quantity and measure against the step size, beside their predicted slopes.

    Args:
        slopes: The series.
        traces: A trace of each, in the order of the legend.
        linear: Whether the ordinate is linear, from zero.
        title: What stands above the panel; nothing for a single one.
        fits: Whether fits are written into the panel; otherwise the legend has them.
    """
    first = slopes[0]
    values = [slope.values for slope in slopes]
    # Fits are written above the traces, a line each.
    headroom = max(0.4, 0.15 + 0.16 * len(traces)) if fits else 0.12
    limits = _linear_limits(slopes) if linear else spread(values, headroom)
    references = () if linear or limits is None else predicted(slopes, limits)
    return Panel(
        tuple(traces),
        step_label(first.problem),
        first.record.label(first.key),
        title,
        y_scale="linear" if linear else "log",
        y_limits=limits,
        x_room=0.08 if references else 0.0,
        references=references,
        levels=_solver_limits(slopes),
        fits=fits,
    )


def predicted(slopes: Sequence["Slope"], limits: tuple[float, float]) -> tuple[Reference, ...]:
    """A line for each distinct predicted slope, parallel to the first of its series.

    Args:
        slopes: The series.
        limits: Ends of the logarithmic ordinate.
    """
    drawn: dict[float, Reference] = {}
    low, high = np.log10(limits)
    shift = 0.045 * (high - low)
    for slope in slopes:
        shown = np.logical_and(slope.fitted, _positive(slope.values))
        if math.isnan(slope.expected) or slope.expected in drawn or not shown.any():
            continue
        log_h, log_y = np.log10(slope.h[shown]), np.log10(slope.values[shown])
        ends = np.array([log_h.min(), log_h.max()])
        # Above the data, not under them.
        line = log_y.mean() + slope.expected * (ends - log_h.mean()) + shift
        order = power("h", format_order(slope.expected))
        drawn[slope.expected] = Reference(10**ends, 10**line, order)
    return tuple(drawn.values())


def in_words(name: str, slope: "Slope") -> str:
    """A series in words: its name, and its slope or else its values at either end."""
    text = f"{quantity(slope)}, {name}"
    if not math.isnan(slope.expected):
        return f"{text}: slope {format_fit(slope.fit)}, predicted {format_order(slope.expected)}"
    ends = [int(np.argmax(slope.h)), int(np.argmin(slope.h))]
    return f"{text}: " + ", ".join(f"{slope.values[i]:.3g} at h = {slope.h[i]:g}" for i in ends)


def _positive(values: Array) -> Mask:
    return np.asarray(np.isfinite(values) & (values > 0))


def _linear_limits(slopes: Sequence["Slope"]) -> tuple[float, float] | None:
    """A share from 0 to 1, a count from 0 to its largest."""
    values = np.concatenate([slope.values for slope in slopes])
    if slopes[0].record.share:
        return from_zero(1.0)
    most = float(np.max(values[np.isfinite(values)], initial=0.0))
    return from_zero(1.1 * most) if most > 0 else None


def _solver_limits(slopes: Sequence["Slope"]) -> tuple[Level, ...]:
    """Meaning of the open markers of cells that stagnated: as many iterations as were allowed."""
    found = [
        float(value)
        for slope in slopes
        for value, status in zip(slope.values, slope.statuses, strict=True)
        if status == "stagnated" and slope.record.at_limit and math.isfinite(value)
    ]
    return tuple(Level(y, f"no convergence in {y:.0f} iterations") for y in dict.fromkeys(found))
