"""Figures as plain data: a sheet of panels of traces, which `draw` draws.

    sheet   one figure: a title, a note, panels side by side and one below the other
    panel   axes: labels, scales, limits, and the lines that traces are compared with
    trace   the points of one series, the look they have, and what is said of them

Nothing here imports matplotlib: tests and the HTML page read what a figure shows from these
values.  A new kind of figure makes a `Sheet`; it draws nothing itself.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from newmark_cli.support.arrays import Array, Mask
from newmark_cli.support.errors import visible

#: Width of a journal column (inch).
WIDTH = 3.5

#: Part of a value from which on what rounding changes in it shows as a bar.
_VISIBLE = 0.1
#: What legends say of points, and which points it is said of.
_SIGNS: Mapping[str, Callable[["Trace"], Mask]] = {
    "bars: rounding": lambda trace: trace.uncertain,
    "hollow: rounding rules": lambda trace: trace.ruled,
    "not joined: runs that did not end well": lambda trace: trace.apart,
}

#: How an axis counts.
Scale = Literal["log", "linear", "symlog"]


@dataclass(frozen=True)
class Look:
    """How a trace looks."""

    color: str  #: as matplotlib writes colours
    marker: str = ""  #: matplotlib's sign for the marker; empty for none
    markersize: float = 4.0  #: points (1/72 inch)
    linestyle: str = "-"  #: matplotlib's sign for the line
    linewidth: float | None = None  #: points; that of the style when omitted
    alpha: float | None = None  #: opacity; opaque when omitted


#: Colours of Okabe and Ito, dark to light, so that they differ in grey too, and three more; the
#: first markers get smaller, so that coinciding series all show.
LOOKS = (
    Look("#000000", "o", 5.8, "-"),
    Look("#0072B2", "s", 4.2, "--"),
    Look("#D55E00", "D", 2.9, "-."),
    Look("#E69F00", "^", 2.9, ":"),
    Look("#009E73", "v", 4.6, "-"),
    Look("#56B4E9", "P", 4.6, "--"),
    Look("#CC79A7", "*", 5.0, "-."),
    Look("#882255", "h", 4.2, ":"),
    Look("#999933", "<", 4.2, "-"),
    Look("#777777", "X", 4.2, "--"),
)

#: Markers and lines of the looks that follow when the colours begin again.
_MORE_MARKERS = (">", "p", "d", "o", "s", "^", "v", "8", "P", "D")
_LINESTYLES = ("-", "--", "-.", ":")


def look(place: int) -> Look:
    """Look of the series at a place in the legend, from 0; there is one for every place.

    After the last of `LOOKS` the colours begin again, with other markers and line styles.
    """
    again, i = divmod(place, len(LOOKS))
    first = LOOKS[i]
    if again == 0:
        return first
    linestyle = _LINESTYLES[(_LINESTYLES.index(first.linestyle) + again) % len(_LINESTYLES)]
    return Look(first.color, _MORE_MARKERS[(i + again - 1) % len(_MORE_MARKERS)], 4.0, linestyle)


@dataclass(frozen=True, eq=False)
class Trace:
    """Points of one series."""

    label: str  #: name in the legend; traces of one name, in several panels, share an entry
    #: (points,) in the order in which they are joined; NaN where there is no value.
    x: Array
    y: Array
    look: Look  #: how it looks
    #: Place in the legend, from 0, by which a style with colours of its own chooses; None for a
    #: look that no style changes.
    place: int | None = None
    #: Heading of its entry in the legend; panels of different groups may have the same looks.
    group: str = ""
    #: (points,) which points are not joined and hollow: cells of which the value is a limit, not a
    #: result.
    apart: Mask = field(default_factory=lambda: np.array(False))
    #: (points,) which points are hollow, as rounding rules them.
    ruled: Mask = field(default_factory=lambda: np.array(False))
    #: (points,) what rounding alone changes in each y; NaN where it is not known.
    bars: Array | None = None
    fit: str = ""  #: fitted slope or verdict as text; empty for none
    #: The trace in words, for those who do not see it; empty where another trace has said it.
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
    """A thin line to compare traces with, such as a predicted slope."""

    #: (points,) its corners.
    x: Array
    y: Array
    text: str  #: what it is, in the legend, and beside the line where there is room

    @property
    def order(self) -> float:
        """Its slope on logarithmic axes."""
        return round(float(np.log(self.y[-1] / self.y[0]) / np.log(self.x[-1] / self.x[0])), 6)


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes with traces."""

    traces: tuple[Trace, ...]  #: in the order of the legend
    #: Labels; mathematics between dollar signs.
    x_label: str = ""
    y_label: str = ""
    #: What tells the panel from others; of two, a grid has the first beside its rows and the second
    #: above its columns.
    titles: tuple[str, ...] = ()
    #: How the axes count.
    x_scale: Scale = "log"
    y_scale: Scale = "log"
    #: Ends of the ordinate; as the points need it when omitted.
    y_limits: tuple[float, float] | None = None
    linthresh: float = 1.0  #: up to which |y| a symlog axis is linear
    references: tuple[Reference, ...] = ()  #: thin lines, such as predicted slopes
    #: y of thin lines across → what they are.
    levels: Mapping[float, str] = field(default_factory=dict)
    tell_zeros: bool = True  #: whether it says how many zeros a logarithmic ordinate cannot show
    #: Draws what is not made of traces into matplotlib's axes, which then have equal units, and
    #: returns handles for the legend.
    scene: Callable[[Any], Sequence[Any]] | None = None
    #: Writes names into a scene of which the layout is known.
    names: Callable[[Any], None] | None = None

    @property
    def title(self) -> str:
        """What tells the panel from others, in one line."""
        return ", ".join(filter(None, self.titles))

    @property
    def empty(self) -> bool:
        """Whether none of its points has a place on its axes."""
        return not any(trace.shown(self.x_scale, self.y_scale).any() for trace in self.traces)


@dataclass(frozen=True, eq=False)
class Sheet:
    """One figure."""

    title: str  #: what it shows
    panels: tuple[Panel, ...]  #: row by row
    columns: int = 1  #: most panels side by side; fewer where the figure is too narrow for them
    note: str = ""  #: what stands above the legend, before what the signs in it mean
    share_x: bool = True  #: whether all panels have the same ends of the abscissa
    #: Whether there are any.
    grid: bool = True
    minor_ticks: bool = True
    #: Settings of matplotlib that differ from the style.
    settings: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def heading(self) -> str:
        """What stands above the legend, with the meaning of bars and hollow markers."""
        traces = [trace for panel in self.panels for trace in panel.traces]
        signs = (text for text, points in _SIGNS.items() if any(points(t).any() for t in traces))
        return "; ".join(filter(None, (self.note, *signs)))

    @property
    def width(self) -> float:
        """Width (inch)."""
        return WIDTH if self.columns == 1 else 2 * WIDTH

    @property
    def wide(self) -> bool:
        """Whether it is wider than a journal's column."""
        return self.width > WIDTH

    @property
    def words(self) -> str:
        """The title and what traces say, for those who do not see the figure."""
        said = (trace.said for panel in self.panels for trace in panel.traces)
        return " ".join(f"{part}." for part in (self.title, *said) if part)


def spread(values: Iterable[Array]) -> tuple[float, float] | None:
    """Ends of a logarithmic ordinate of four decades or more; None without a positive value.

    Scatter by a few per cent must not look like a trend.
    """
    every = np.concatenate([*values, np.array([])])
    logs = np.log10(every[np.isfinite(every) & (every > 0)])
    if len(logs) == 0:
        return None
    low, high = logs.min(), logs.max()
    room = max(0.5, (4 - (high - low)) / 2, 0.12 * (high - low))
    return float(10 ** (low - room)), float(10 ** (high + room))


def from_zero(top: float) -> tuple[float, float]:
    """Ends of a linear ordinate from 0 to a value, with room for markers."""
    return -0.06 * top, 1.07 * top


#: Longest text of somebody's that is drawn: what is longer takes long, and nobody reads it.
_LONGEST = 200


def plain(text: str) -> str:
    """A text without mathematics: a name that somebody gave may have dollar signs, or worse."""
    shown = visible(text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…")
    return shown.replace("$", r"\$")
