"""One renderer for every figure: a sheet of panels, drawn in the style of the project."""

import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

# isort: split
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from newmark_cli.report.drawing.panels import Panel, Sheet, Trace, power
from newmark_cli.report.drawing.style import NONE, STYLE, settled
from newmark_cli.support.arrays import Mask
from newmark_cli.support.errors import InputError, visible

#: What a legend or a title may take of the sheet's width.
_MOST = 0.99


def drawn(
    sheet: Sheet,
    size: tuple[float, float] | None = None,
    settings: Mapping[str, Any] = NONE,
) -> Figure:
    """Draw a sheet.

    Args:
        sheet: Panels, legend and layout; see `newmark_cli.report.drawing.panels`.
        size: Width and height of the figure (inch), whatever the layout says; as the sheet
            needs it when omitted.
        settings: Settings of matplotlib over those of the project and the sheet.

    Raises:
        InputError: When the size leaves no room for the panels.
    """
    if size is not None:
        sheet = replace(sheet, layout=None)
    with settled(sheet.settings, settings):
        drawing, grid = _axes(sheet, size)
        series: dict[str, Any] = {}
        lines: dict[str, Any] = {}
        for place, (axes, panel) in enumerate(zip(grid, sheet.panels, strict=True)):
            _label(axes, panel, sheet, place)
            for entries, found in zip((series, lines), _draw(axes, panel), strict=True):
                for text, handle in found:
                    entries.setdefault(text, handle)
            if sheet.grid:
                axes.grid(color="0.92", linewidth=0.5)
                axes.set_axisbelow(True)
        _make_room(grid, sheet)
        for axes, panel in zip(grid, sheet.panels, strict=True):
            _name_ticks(axes, panel, sheet)
        _write_title(drawing, grid, sheet, settings.get("axes.titlesize", STYLE["axes.titlesize"]))
        _write_legend(drawing, sheet, series | lines, grows=size is None)
        if sheet.layout is None:
            _settle(drawing, grid)
    return drawing


def _axes(sheet: Sheet, size: tuple[float, float] | None) -> tuple[Figure, list[Any]]:
    """A figure, and axes for its panels."""
    if sheet.layout is None:
        size = size or (sheet.width, sheet.rows * sheet.size[1])
        drawing, edges = Figure(figsize=size, layout="constrained"), {}
    else:
        drawing = Figure(figsize=sheet.layout.size)
        left, bottom, width, height = sheet.layout.box
        if len(sheet.panels) == 1:
            return drawing, [drawing.add_axes(sheet.layout.box)]
        # Rounded: 0.165 + 0.8 is meant to be 0.965.
        edges = {
            "left": left, "right": round(left + width, 9),
            "bottom": bottom, "top": round(bottom + height, 9),
            "wspace": sheet.layout.gaps[0], "hspace": sheet.layout.gaps[1],
        }  # fmt: skip
    every = drawing.subplots(
        sheet.rows, sheet.columns, squeeze=False, gridspec_kw=edges,
        sharex=sheet.share_x, sharey=sheet.share_y,
    ).ravel()  # fmt: skip
    for axes in every[len(sheet.panels) :]:
        axes.remove()
    return drawing, list(every[: len(sheet.panels)])


def _label(axes: Any, panel: Panel, sheet: Sheet, place: int) -> None:
    """Labels, at the outer panels where axes are shared, and the panel's own title."""
    lowest = place + sheet.columns >= len(sheet.panels)
    if lowest or not sheet.share_x:
        axes.set_xlabel(panel.x_label)
        if place + sheet.columns < sheet.rows * sheet.columns:
            axes.tick_params(labelbottom=True)  # nothing stands below it
    if place % sheet.columns == 0 or not sheet.share_y:
        axes.set_ylabel(panel.y_label)
    if panel.title:
        width = 0.8 * axes.figure.bbox.width / sheet.columns  # labels take the rest
        size = _points(mpl.rcParams["axes.titlesize"])
        axes.set_title(_wrapped(axes.figure, plain(panel.title), size, width))


#: Names and handles of entries in the legend.
Entries = list[tuple[str, Any]]


def _draw(axes: Any, panel: Panel) -> tuple[Entries, Entries]:
    """Everything inside a panel; returns the entries of its traces, and of its lines."""
    if panel.scene is not None:
        panel.scene.draw(axes)
        axes.set_aspect("equal")
        width, height = axes.dataLim.width or 1.0, axes.dataLim.height or 1.0
        # Names need room beside what is flat, too.
        axes.margins(max(0.1, 0.07 * height / width), max(0.1, 0.07 * width / height))
        return [(handle.get_label(), handle) for handle in panel.scene.handles()], []
    if panel.x_scale != "linear":
        axes.set_xscale(panel.x_scale)
    if panel.y_scale != "linear":
        axes.set_yscale(
            panel.y_scale, **{"linthresh": panel.linthresh} if panel.y_scale == "symlog" else {}
        )
    entries = [(_entry(trace, panel), _draw_trace(axes, trace, panel)) for trace in panel.traces]
    if panel.y_limits is not None:
        axes.set_ylim(panel.y_limits)
    lines = [
        (line.label, axes.plot(line.x, line.y, color="0.55", linewidth=0.6, zorder=1)[0])
        for line in panel.references
    ]
    _write(axes, panel)
    return entries, lines


def _entry(trace: Trace, panel: Panel) -> str:
    return plain(trace.label) + (f": {trace.fit}" if trace.fit and not panel.fits else "")


def plain(text: str) -> str:
    """A text without mathematics: a name that somebody gave may have dollar signs, or worse."""
    return visible(text).replace("$", r"\$")


def _draw_trace(axes: Any, trace: Trace, panel: Panel) -> Any:
    """Points, joined; those that stand apart as open markers.  Returns the handle."""
    look = trace.look
    shown = trace.shown(panel.x_scale, panel.y_scale)
    apart = np.zeros(len(shown), bool) if trace.apart is None else trace.apart

    def points(chosen: Mask, linestyle: str, filled: bool) -> Any:
        (line,) = axes.plot(
            trace.x[chosen],
            trace.y[chosen],
            color=look.color,
            marker=look.marker or "None",
            markersize=look.markersize,
            markerfacecolor=look.color if filled else "none",
            linestyle=linestyle if np.count_nonzero(chosen) > 1 else "none",
            linewidth=look.linewidth,
            alpha=look.alpha,
        )
        return line

    uncertain = shown & trace.uncertain
    if trace.bars is not None and uncertain.any():
        y, bars = trace.y[uncertain], trace.bars[uncertain]
        # On a logarithmic axis a decade at most, which is all that it has room for.
        least = 0.1 * y if panel.y_scale == "log" else -np.inf
        below, above = np.maximum(y - bars, least), y + bars
        axes.vlines(trace.x[uncertain], below, above, color=look.color, alpha=0.5, linewidth=1.0)
    # Also without a point, for the legend.
    handle = points(shown & ~apart, look.linestyle, look.filled)
    if (shown & apart).any():
        points(shown & apart, "none", filled=False)
    return handle


def _write(axes: Any, panel: Panel) -> None:
    """Texts among the traces."""
    for line in panel.references:
        if line.text:
            axes.annotate(
                line.text, (line.x[-1], line.y[-1]), textcoords="offset points", xytext=(7, 0),
                ha="left", va="center", style="italic", fontsize=7, color="0.35",
            )  # fmt: skip
    for level in panel.levels:
        axes.axhline(level.y, color="0.55", linewidth=0.6, zorder=1)
        axes.annotate(
            level.text, (0.98, level.y), xycoords=axes.get_yaxis_transform(),
            textcoords="offset points", xytext=(0, 6), ha="right", va="bottom", color="0.35",
        )  # fmt: skip
    if panel.fits:
        _write_fits(axes, panel)
    zeros = sum(trace.zeros for trace in panel.traces)
    if zeros and panel.tell_zeros and panel.y_scale == "log":
        text = "1 value is exactly 0" if zeros == 1 else f"{zeros} values are exactly 0"
        size, width = _points(mpl.rcParams["legend.fontsize"]), axes.get_window_extent().width
        axes.annotate(
            _wrapped(axes.figure, text, size, 0.6 * width), (0.04, 0.04),
            xycoords="axes fraction", fontsize=size,
        )  # fmt: skip


def _write_fits(axes: Any, panel: Panel) -> None:
    """Fits in a corner that is free, the upper right one if it is."""
    size = _points(mpl.rcParams["legend.fontsize"]) - 1
    room = 0.75 * axes.get_window_extent().width / (0.55 * size * axes.figure.dpi / 72)
    fits = [(visible(trace.label), trace.fit) for trace in panel.traces if trace.fit]
    lines = [f"{plain(_shortened(label, room - len(fit) - 2))}: {fit}" for label, fit in fits]
    tall = 0.05 + 0.08 * len(lines)
    shown = [(t, t.shown(panel.x_scale, panel.y_scale)) for t in panel.traces]
    points = np.concatenate(
        [np.column_stack([t.x[mask], t.y[mask]]) for t, mask in shown]
        + [np.array([[line.x[-1], line.y[-1]]]) for line in panel.references if line.text]
    )
    axes.autoscale_view()  # finds the limits, which are used here
    x, y = axes.transAxes.inverted().transform(axes.transData.transform(points)).T
    corners = [(right, top) for top in (True, False) for right in (True, False)]
    right, top = min(
        corners,
        key=lambda corner: np.count_nonzero(
            ((x > 0.5) == corner[0]) & ((y > 1 - tall) if corner[1] else (y < tall))
        ),
    )
    text = axes.text(
        0.97 if right else 0.03, 0.95 if top else 0.05, "\n".join(lines),
        transform=axes.transAxes, ha="right" if right else "left", va="top" if top else "bottom",
        fontsize=size,
        bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1},
    )  # fmt: skip
    text.set_in_layout(False)


def _points(size: Any) -> float:
    """Size of a font (points), which a style may give in words."""
    return float(FontProperties(size=size).get_size_in_points())


def _shortened(label: str, most: float) -> str:
    """A label where there is room for so many letters; the legend has all of it."""
    return label if len(label) <= most else label[: max(int(most), 6) - 1].rstrip(" ,") + "…"


def _make_room(grid: Sequence[Any], sheet: Sheet) -> None:
    """Room right of the points, the same in panels that share their abscissa."""
    rooms = [panel.x_room for panel in sheet.panels]
    for axes, room in [(grid[0], max(rooms))] if sheet.share_x else zip(grid, rooms, strict=True):
        if room:
            left, right = axes.get_xlim()
            if axes.get_xscale() == "log":
                axes.set_xlim(left, right * (right / left) ** room)
            else:
                axes.set_xlim(left, right + room * (right - left))


def _name_ticks(axes: Any, panel: Panel, sheet: Sheet) -> None:
    for axis, scale, most in zip(
        (axes.xaxis, axes.yaxis), (panel.x_scale, panel.y_scale), sheet.ticks, strict=True
    ):
        if scale == "symlog":
            axis.set_major_formatter(FuncFormatter(_signed_power_of_ten))
        if scale != "log":
            continue
        low, high = np.log10(axis.get_view_interval())
        if math.floor(high) - math.ceil(low) >= 1:
            axis.set_major_locator(LogLocator(numticks=most))
            axis.set_major_formatter(FuncFormatter(_power_of_ten))
        else:  # fewer than two powers of ten
            axis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=most))
            axis.set_major_formatter(FuncFormatter(_number))
        axis.set_minor_formatter(NullFormatter())
        if not sheet.minor_ticks:
            axis.set_minor_locator(NullLocator())
    if panel.y_scale == "log" and panel.empty:
        axes.set_yticks([])


def _power_of_ten(value: float, position: int | None = None) -> str:
    return power("10", f"{math.log10(value):.0f}")


def _signed_power_of_ten(value: float, position: int | None = None) -> str:
    if value == 0:
        return "0"
    return ("−" if value < 0 else "") + _power_of_ten(abs(value))


def _number(value: float, position: int | None = None) -> str:
    if value < 1e5:
        return f"{value:g}"
    digits, exponent = f"{value:.0e}".split("e+")
    return ("" if digits == "1" else f"{digits}·") + power("10", str(int(exponent)))


def _write_title(drawing: Figure, grid: Sequence[Any], sheet: Sheet, size: Any) -> None:
    """In the middle of a column of panels that have none, otherwise in that of the sheet."""
    title = _wrapped(drawing, plain(sheet.title), size, _MOST * drawing.bbox.width)
    if sheet.layout is not None and sheet.columns == 1 and not sheet.panels[0].title:
        grid[0].set_title(title, fontsize=size)
    else:
        drawing.suptitle(title, fontsize=size)


def _write_legend(drawing: Figure, sheet: Sheet, entries: dict[str, Any], grows: bool) -> None:
    """Below the panels, nothing cut off: fewer columns, then labels of several lines.

    Without a layout the figure grows by it, or else the panels make room.
    """
    if not entries:
        return
    most = _MOST * drawing.bbox.width
    size = mpl.rcParams["legend.fontsize"]
    title = _wrapped(drawing, sheet.heading, size, most)
    columns, room, labels = sheet.legend.columns or len(entries), most, list(entries)
    fixed = sheet.layout is not None
    while True:
        legend = drawing.legend(
            list(entries.values()),
            labels,
            title=title,
            ncols=columns,
            loc="lower center" if fixed else "outside lower center",
            bbox_to_anchor=(sheet.legend.centre, 0.0) if fixed else None,
        )
        box = legend.get_window_extent()
        if box.width <= most or room < 0.5 * most:
            break
        legend.remove()
        if columns > 1:
            columns -= 1
        else:
            room -= 0.05 * most
            labels = [_wrapped(drawing, label, size, room) for label in entries]
    if fixed:
        half = box.width / drawing.bbox.width / 2
        centre = max(min(sheet.legend.centre, 0.995 - half), 0.005 + half)
        legend.set_bbox_to_anchor((centre, 0.0))
    elif grows:
        drawing.set_figheight(drawing.get_figheight() + box.height / drawing.dpi)


def _settle(drawing: Figure, grid: Sequence[Any]) -> None:
    """Fix a layout that was found by measuring, ordinates' labels broken to fit beside it."""
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="constrained_layout not applied")
        try:
            _measure(drawing, grid)
        except UserWarning:
            width, height = drawing.get_size_inches()
            raise InputError(
                f"a figure of {width:g}x{height:g} inches has no room for its panels, labels and "
                "legend"
            ) from None
    # With the engine "none" matplotlib would draw every file twice.
    with mpl.rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
        drawing.set_layout_engine(None)


def _measure(drawing: Figure, grid: Sequence[Any]) -> None:
    engine: Any = drawing.get_layout_engine()
    with _without_minor_ticks(grid):
        engine.execute(drawing)
        for axes in grid:
            label = axes.yaxis.label
            height = axes.get_window_extent().height
            label.set_text(_wrapped(drawing, label.get_text(), label.get_fontsize(), height))
        engine.execute(drawing)


@contextmanager
def _without_minor_ticks(grid: Sequence[Any]) -> Iterator[None]:
    """They take no room, but time."""
    every = [axis for axes in grid for axis in (axes.xaxis, axes.yaxis)]
    locators = [axis.get_minor_locator() for axis in every]
    for axis in every:
        axis.set_minor_locator(NullLocator())
    yield
    for axis, locator in zip(every, locators, strict=True):
        axis.set_minor_locator(locator)


#: What a line is not broken in: a word, or mathematics.
_WORD = re.compile(r"(?:\$[^$]*\$|\S)+")


def _wrapped(drawing: Figure, text: str, size: float, width: float) -> str:
    """A text of lines that are no longer than a width (pixels), where words allow it."""
    probe = drawing.text(0, 0, "", fontsize=size)
    lines: list[str] = []
    for word in _WORD.findall(text):
        longer = f"{lines[-1]} {word}" if lines else word
        probe.set_text(longer)
        if lines and probe.get_window_extent().width > width:
            lines.append(word)
        else:
            lines[-1:] = [longer]
    probe.remove()
    return "\n".join(lines)
