"""Figures as plain data: a sheet of panels of traces, which `draw` draws.

    sheet   one figure: a title, a legend, panels side by side and one below the other
    panel   axes: labels, scales, limits, and what is written or drawn among the traces
    trace   the points of one series, the look they have, and what is said of them

Nothing here imports matplotlib: tests and the HTML page read what a figure shows from these
values.  A new kind of figure makes a `Sheet`; it draws nothing itself.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np

from newmark_cli.support.arrays import Array, Mask

#: Width of a journal column (inch).
WIDTH = 3.5

#: What bars show, in legends, and from which part of a value on they do.
BARS, _VISIBLE = "bars: rounding", 0.1

#: How an axis counts.
Scale = Literal["log", "linear", "symlog"]


@dataclass(frozen=True)
class Look:
    """How a trace looks.

    Attributes:
        color: As #RRGGBB.
        marker: Matplotlib's sign for the marker; empty for none.
        markersize: Points (1/72 inch).
        filled: Whether markers are filled.
        linestyle: Matplotlib's sign for the line.
        linewidth: Points; that of the style when omitted.
        alpha: Opacity; opaque when omitted.
    """

    color: str
    marker: str = ""
    markersize: float = 5.0
    filled: bool = True
    linestyle: str = "-"
    linewidth: float | None = None
    alpha: float | None = None


#: Colours of Okabe and Ito, dark to light, so that they differ in grey too; open
#: and filled markers of different sizes, so that coinciding series all show.
LOOKS = (
    Look("#000000", "o", 7.5, filled=False, linestyle="-"),
    Look("#0072B2", "x", 4.5, filled=True, linestyle="--"),
    Look("#D55E00", "s", 7.0, filled=False, linestyle="-."),
    Look("#E69F00", "D", 3.0, filled=True, linestyle=":"),
    Look("#009E73", "^", 5.0, filled=False, linestyle="-"),
    Look("#56B4E9", "v", 7.5, filled=False, linestyle="--"),
    Look("#CC79A7", "*", 4.5, filled=True, linestyle="-."),
)

#: Markers of the looks that follow when the colours begin again.
_MORE_MARKERS = ("P", "h", "<", "d", ">", "p", "X")

_LINESTYLES = ("-", "--", "-.", ":")


def look(place: int) -> Look:
    """Look of the series at a place in the legend, from 0; there is one for every place.

    After the last of `LOOKS` the colours begin again, with other markers and line styles.
    """
    again, i = divmod(place, len(LOOKS))
    first = LOOKS[i]
    if again == 0:
        return first
    shifted = _LINESTYLES[(_LINESTYLES.index(first.linestyle) + again) % len(_LINESTYLES)]
    marker = _MORE_MARKERS[(i + again - 1) % len(_MORE_MARKERS)]
    return Look(first.color, marker, 5.0, filled=again % 2 == 1, linestyle=shifted)


@dataclass(frozen=True, eq=False)
class Trace:
    """Points of one series.

    Attributes:
        label: Name in the legend; traces of one name, in several panels, share an entry.
        x, y: (points,) in the order in which they are joined; NaN where there is no value.
        look: How it looks.
        apart: (points,) which points are not joined and have open markers: cells of which
            the value is a limit, not a result; none when omitted.
        bars: (points,) what rounding alone changes in each y; NaN where it is not known.
        fit: Fitted slope as text; empty for none.
        said: The trace in words, for those who do not see it; empty where another trace
            has said it.
    """

    label: str
    x: Array
    y: Array
    look: Look
    apart: Mask | None = None
    bars: Array | None = None
    fit: str = ""
    said: str = ""

    def shown(self, x_scale: Scale, y_scale: Scale) -> Mask:
        """(points,) which points have a place on axes of these scales."""
        return _placed(self.x, x_scale) & _placed(self.y, y_scale)

    @property
    def uncertain(self) -> Mask:
        """(points,) which of them rounding changes so much that it shows."""
        if self.bars is None:
            return np.full(len(self.y), False)
        return np.asarray(self.bars > _VISIBLE * np.abs(self.y))

    @property
    def zeros(self) -> int:
        """How many values are exactly 0, which has no place on a logarithmic axis."""
        return int(np.count_nonzero(self.y == 0))


def _placed(values: Array, scale: Scale) -> Mask:
    return np.asarray(np.isfinite(values) & ((values > 0) | (scale != "log")))


@dataclass(frozen=True, eq=False)
class Reference:
    """A thin line to compare traces with, such as a predicted slope.

    Attributes:
        x, y: (points,) its corners.
        text: What is written at its last corner.
        label: Name in the legend.
    """

    x: Array
    y: Array
    text: str = ""
    label: str = "predicted"


@dataclass(frozen=True)
class Level:
    """A thin line across a panel, and what is written on it.

    Attributes:
        y: Where.
        text: What is written.
    """

    y: float
    text: str


class Scene(Protocol):
    """A drawing inside a panel that is not made of traces, such as a mechanism."""

    def draw(self, axes: Any) -> None:
        """Draw it into matplotlib's axes."""

    def handles(self) -> Sequence[Any]:
        """Matplotlib's handles for the legend."""


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes with traces.

    Attributes:
        traces: In the order of the legend.
        x_label, y_label: Labels; mathematics between dollar signs.
        title: What stands above it; a single panel has the sheet's title instead.
        x_scale, y_scale: How the axes count.
        y_limits: Ends of the ordinate; as the points need it when omitted.
        linthresh: Up to which |y| a symlog axis is linear.
        x_room: Room right of the points for what is written there, as a share of their span.
        references: Thin lines, such as predicted slopes.
        levels: Thin lines across.
        fits: Whether the fits of the traces are written into a corner that is free.  The
            legend has them otherwise, which suits a single panel.
        tell_zeros: Whether it says how many zeros a logarithmic ordinate cannot show.
        scene: A drawing that is not made of traces; axes then have equal units.
    """

    traces: tuple[Trace, ...]
    x_label: str = ""
    y_label: str = ""
    title: str = ""
    x_scale: Scale = "log"
    y_scale: Scale = "log"
    y_limits: tuple[float, float] | None = None
    linthresh: float = 1.0
    x_room: float = 0.0
    references: tuple[Reference, ...] = ()
    levels: tuple[Level, ...] = ()
    fits: bool = False
    tell_zeros: bool = True
    scene: Scene | None = None

    @property
    def empty(self) -> bool:
        """Whether none of its points has a place on its axes."""
        return not any(trace.shown(self.x_scale, self.y_scale).any() for trace in self.traces)


@dataclass(frozen=True)
class Legend:
    """The legend, below the panels.

    Attributes:
        title: What stands above it.
        columns: Entries side by side; fewer where they would be cut off, and as many as fit
            when omitted.
        centre: Its middle as a share of the sheet's width; further left or right where it
            would be cut off.
    """

    title: str = ""
    columns: int | None = None
    centre: float = 0.5


@dataclass(frozen=True)
class Layout:
    """Where panels stand on a sheet.

    Attributes:
        size: Width and height of the sheet (inch).
        box: Left and lower edge, width and height of all panels, as shares of the sheet.
        gaps: Gaps between panels side by side and one below the other, as shares of a panel.
    """

    size: tuple[float, float]
    box: tuple[float, float, float, float]
    gaps: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Sheet:
    """One figure.

    Attributes:
        title: What it shows.
        panels: Row by row.
        columns: Panels side by side.
        legend: The legend.
        layout: Where panels stand.  When omitted, they have the size of ``panel_size`` and
            room is made for labels, title and legend, however long they are.
        panel_size: Width and height of a panel with its labels (inch) without a layout; as
            suits their number when omitted.
        share_x, share_y: Whether all panels have the same ends of an axis.
        ticks: Most powers of ten named on x and y.
        minor_ticks, grid: Whether there are any.
        settings: Settings of matplotlib that differ from the style.
    """

    title: str
    panels: tuple[Panel, ...]
    columns: int = 1
    legend: Legend = Legend()
    layout: Layout | None = None
    panel_size: tuple[float, float] | None = None
    share_x: bool = True
    share_y: bool = False
    ticks: tuple[int, int] = (12, 10)
    minor_ticks: bool = True
    grid: bool = True
    settings: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def heading(self) -> str:
        """What stands above the legend, with the meaning of bars where there are any."""
        there = any(trace.uncertain.any() for panel in self.panels for trace in panel.traces)
        told = there and BARS not in self.legend.title
        return "; ".join(filter(None, (self.legend.title, BARS if told else "")))

    @property
    def rows(self) -> int:
        """Panels one below the other."""
        return -(-len(self.panels) // self.columns)

    @property
    def width(self) -> float:
        """Width (inch)."""
        return self.layout.size[0] if self.layout else self.columns * self.size[0]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of a panel with its labels (inch), without a layout."""
        if self.panel_size is not None:
            return self.panel_size
        if self.columns == 1:
            return WIDTH, 2.6 if len(self.panels) == 1 else 1.9
        # Tall enough for what is written in them.
        return 2 * WIDTH / self.columns, 2.6 if self.rows == 1 else 2.1

    @property
    def wide(self) -> bool:
        """Whether it is wider than a journal's column."""
        return self.width > WIDTH

    @property
    def words(self) -> str:
        """The title and what traces say, for those who do not see the figure."""
        traces = (trace for panel in self.panels for trace in panel.traces)
        return " ".join(f"{part}." for part in (self.title, *(t.said for t in traces if t.said)))


def spread(values: Iterable[Array], headroom: float = 0.12) -> tuple[float, float] | None:
    """Ends of a logarithmic ordinate that shows at least four decades.

    Scatter by a few per cent must not look like a trend.

    Args:
        values: What is drawn, an array for each trace.
        headroom: Least room above, as a share of the decades that the values span.

    Returns:
        The ends; None without a positive value.
    """
    every = np.concatenate([*values, np.array([])])
    logs = np.log10(every[np.isfinite(every) & (every > 0)])
    if len(logs) == 0:
        return None
    low, high = logs.min(), logs.max()
    least = max(0.5, (4 - (high - low)) / 2)
    below, above = (max(share * (high - low), least) for share in (0.12, headroom))
    return float(10 ** (low - below)), float(10 ** (high + above))


def from_zero(top: float) -> tuple[float, float]:
    """Ends of a linear ordinate from 0 to a value, with room for markers."""
    return -0.06 * top, 1.07 * top


_SUPERSCRIPTS = str.maketrans("−-.0123456789", "⁻⁻·⁰¹²³⁴⁵⁶⁷⁸⁹")


def power(base: str, exponent: str) -> str:
    """A power as plain text, which is drawn much faster than mathematics."""
    return base + exponent.translate(_SUPERSCRIPTS)
