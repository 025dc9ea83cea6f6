"""One renderer for every figure: a sheet of panels, drawn in the style of the project.

matplotlib's constrained layout makes room for labels, titles and the legend.  What it does not
do is done here, in inches: as many panels side by side as there is room for, lines of text that
end where their panel does, and a figure that is as tall as all of that takes.
"""

import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from newmark_cli.report.drawing.panels import Look, Panel, Sheet, Trace, plain
from newmark_cli.report.drawing.style import NONE, checked, settled
from newmark_cli.report.reading.words import power
from newmark_cli.support.arrays import Array, Mask
from newmark_cli.support.errors import InputError

#: Least width of a panel with its labels (inch), and of one whose ordinate is that of its row: one
#: that is easy to read, and one where there is no other layout.
_NARROW, _WIDE_IN_ROW, _NARROW_IN_ROW = 1.5, 1.2, 0.8
#: Least width and height of axes (inch): on lower ones no slope can be read.
_LEAST = 0.4, 0.75
#: What a legend or a title may take of the sheet's width: files of more dots have wider letters.
_MOST = 0.94


def drawn(
    sheet: Sheet, size: tuple[float, float | None] | None = None, settings: Mapping[str, Any] = NONE
) -> Figure:
    """Draw a sheet, as tall as that takes where a size (inch) has no height."""
    width, height = size or (sheet.width, None)
    with settled(checked(sheet.settings), settings):
        sheet = _arranged(sheet, width)
        columns, rows = sheet.columns, -(-len(sheet.panels) // sheet.columns)
        drawing = Figure(figsize=(width, height or 1 + 3 * rows), layout="constrained")
        FigureCanvasAgg(drawing)  # keeps its renderer, which measuring a text would make anew
        # Of a figure with a legend below it labels that panels share would stand in the legend.
        inner: Any = drawing.subfigures()
        subplots = inner.subplots(rows, columns, squeeze=False, sharex=sheet.share_x).ravel()
        grid = list(subplots[: len(sheet.panels)])
        for axes in subplots[len(grid) :]:
            axes.remove()
        # Colours of a style of one's own stand for those of the project.
        own = "axes.prop_cycle" in {**sheet.settings, **settings}
        cycle = list(mpl.rcParams["axes.prop_cycle"]) if own else []
        entries: dict[tuple[str, str], Any] = {}
        for axes, panel in zip(grid, sheet.panels, strict=True):
            for name, handle in _draw(axes, panel, cycle):
                # A trace without points has no line to show.
                if name not in entries or not len(entries[name].get_xdata()):
                    entries[name] = handle
            for spine in axes.spines.values():
                spine.set_in_layout(False)  # which would look at all ticks again
            if sheet.grid:
                axes.grid(color="0.92", linewidth=0.5)
                axes.set_axisbelow(True)
        some = any(panel.scene or not panel.empty for panel in sheet.panels)
        for place, axes in enumerate(grid):
            _name_ticks(axes, place, sheet)
            if some and sheet.panels[place].empty and not sheet.panels[place].scene:
                axes.set_axis_off()  # its words say why
        if sheet.title:
            title = drawing.suptitle("")
            title.set_text(_wrapped(title, plain(sheet.title), _MOST * drawing.bbox.width))
        _write_legend(drawing, sheet, entries)
        if height is None:
            legends = [legend.get_window_extent().height for legend in drawing.legends]
            drawing.set_figheight(1 + 3 * rows + sum(legends) / drawing.dpi)
        try:
            _lay_out(drawing, grid, sheet, height)
        except UserWarning:
            inches = f"{width:g}" + (f"x{height:g}" if height else "")
            message = f"a figure of {inches} inches has no room for its panels, labels and legend"
            if height is not None:
                needed = drawn(sheet, (width, None), settings).get_figheight()
                message += f"; '--size {width:g}' makes it {needed:.1f} inches tall"
            raise InputError(message) from None
        for axes, panel in zip(grid, sheet.panels, strict=True):
            _write_orders(axes, panel)
            if panel.names:
                axes.apply_aspect()
                panel.names(axes)
            for axis, scale in ((axes.xaxis, panel.x_scale), (axes.yaxis, panel.y_scale)):
                if scale == "log" and sheet.minor_ticks and not panel.empty:
                    axis.set_minor_locator(LogLocator(subs=None))
    return drawing


def _arranged(sheet: Sheet, width: float) -> Sheet:
    """The sheet with as many panels side by side as there is room for, without a gap."""
    columns, count = sheet.columns, len(sheet.panels)
    if _is_grid(sheet):
        firsts = (sheet.panels[i - i % columns] for i in range(count))
        alike = all(map(_same_ordinate, sheet.panels, firsts))
        if alike and columns * _WIDE_IN_ROW <= width:
            return sheet
        rows = count // columns
        if rows < columns and rows * _NARROW <= width:
            turned = (
                replace(panel, titles=panel.titles[::-1])
                for column in range(columns)
                for panel in sheet.panels[column::columns]
            )
            return replace(sheet, panels=tuple(turned), columns=rows)
        if alike and columns * _NARROW_IN_ROW <= width:
            return sheet
    most = max(1, min(columns, int(width / _NARROW)))
    fits = most == columns or count > 4 or count % most == 0
    return replace(sheet, columns=most if fits else 1)


# -- what is inside a panel ---------------------------------------------------------------------

#: Group and name of an entry in the legend, and its handle.
Entry = tuple[tuple[str, str], Any]


def _draw(axes: Any, panel: Panel, cycle: Sequence[Mapping[str, Any]]) -> Iterator[Entry]:
    """Draw a panel, except what waits for the layout; yields legend entries."""
    if panel.scene is not None:
        handles = panel.scene(axes)
        axes.set_aspect("equal")
        # Names need room beside what is flat, too.
        seen = axes.dataLim
        room = 0.1 * max(seen.width, seen.height) or 1.0
        axes.set_xlim(seen.x0 - room, seen.x1 + room)
        axes.set_ylim(seen.y0 - room, seen.y1 + room)
        for handle in handles:
            yield ("", handle.get_label()), handle
        return
    axes.set_xscale(panel.x_scale)
    scale = {}
    if panel.y_scale == "symlog":
        # Room for the names of ticks on either side of 0.
        decades = math.log10(max(map(abs, panel.y_limits or (1.0,))) / panel.linthresh)
        scale = {"linthresh": panel.linthresh, "linscale": max(1.0, 0.35 * decades)}
    axes.set_yscale(panel.y_scale, **scale)
    single = not panel.titles
    for trace in panel.traces:
        label = plain(trace.label) + (f": {trace.fit}" if trace.fit and single else "")
        look = _own_look(trace, cycle)
        yield (trace.group, label), _draw_trace(axes, trace, panel, look)
    if panel.empty and panel.traces:  # its step sizes are known all the same
        x = np.concatenate([trace.x for trace in panel.traces])
        axes.update_datalim([(place, 1.0) for place in x[np.isfinite(x) & (x > 0)]])
    if panel.y_limits is not None:
        axes.set_ylim(panel.y_limits)
    thin: Any = {"color": "0.55", "linewidth": 0.6, "zorder": 1}
    for line in panel.references:
        yield (_PREDICTED, line.text), axes.plot(line.x, line.y, **thin)[0]
    for y, text in panel.levels.items():
        yield (_LEVELS, text), axes.axhline(y, **thin | {"linestyle": "--"})


#: Groups of entries that stand behind those of the traces.
_PREDICTED, _LEVELS = "\npredicted", "\nlevels"


def _own_look(trace: Trace, cycle: Sequence[Mapping[str, Any]]) -> Look:
    """The look of a trace, or that of the style's cycle."""
    if not cycle or trace.place is None:
        return trace.look
    entry = cycle[trace.place % len(cycle)]
    return replace(trace.look, **{k: v for k, v in entry.items() if k in Look.__annotations__})


def _draw_trace(axes: Any, trace: Trace, panel: Panel, look: Look) -> Any:
    """Draw points, joined unless they stand apart; returns the handle for the legend."""
    shown = trace.shown(panel.x_scale, panel.y_scale)
    joined, hollow = shown & ~trace.apart, shown & (trace.ruled | trace.apart)
    uncertain = shown & trace.uncertain
    if trace.bars is not None and uncertain.any():
        y, bars = trace.y[uncertain], trace.bars[uncertain]
        # On a logarithmic axis a decade at most, which is all that it has room for.
        least = 0.1 * y if panel.y_scale == "log" else -np.inf
        below, above = np.maximum(y - bars, least), y + bars
        axes.vlines(trace.x[uncertain], below, above, color=look.color, alpha=0.5, linewidth=1.0)

    def points(chosen: Mask, linestyle: str, face: str) -> Any:
        (line,) = axes.plot(
            trace.x[chosen], trace.y[chosen], color=look.color, linestyle=linestyle,
            linewidth=look.linewidth, marker=look.marker or "None", markersize=look.markersize,
            markerfacecolor=face, markeredgewidth=0.8, alpha=look.alpha,
        )  # fmt: skip
        return line

    handle = points(joined, look.linestyle if joined.sum() > 1 else "none", look.color)
    if hollow.any():
        hollow_points = points(hollow, "none", "white")
        return handle if joined.any() else hollow_points
    return handle


def _name_ticks(axes: Any, place: int, sheet: Sheet) -> None:
    """Ticks at powers of ten, labelled once where neighbouring panels share them."""
    panel, count = sheet.panels[place], len(sheet.panels)
    if sheet.share_x and place + sheet.columns >= count and not panel.scene:
        axes.tick_params(labelbottom=True)  # nothing stands below it
    if place % sheet.columns and panel.y_limits and _same_ordinate(panel, sheet.panels[place - 1]):
        axes.tick_params(labelleft=False)
    axes.minorticks_off()  # they take no room in the layout, but time
    for axis, scale in ((axes.xaxis, panel.x_scale), (axes.yaxis, panel.y_scale)):
        if scale == "symlog":
            axis.get_major_locator().set_params(numticks=7)
            axis.set_major_formatter(FuncFormatter(_power_of_ten))
        if scale != "log":
            continue
        low, high = np.log10(axis.get_view_interval())
        if math.floor(high) - math.ceil(low) >= 1:
            axis.set_major_locator(LogLocator())
            axis.set_major_formatter(FuncFormatter(_power_of_ten))
        else:  # fewer than two powers of ten
            axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high - low < 1 else (1, 3)))
            short = low >= -3 and high < 5
            axis.set_major_formatter("{x:g}" if short else FuncFormatter(_with_power))
        axis.set_minor_formatter(NullFormatter())
    if panel.y_scale == "log" and panel.empty:
        axes.yaxis.set_major_locator(NullLocator())


def _same_ordinate(one: Panel, other: Panel) -> bool:
    return (one.y_limits, one.y_scale) == (other.y_limits, other.y_scale)


def _power_of_ten(value: float, position: int | None = None) -> str:
    sign = "−" if value < 0 else ""
    return sign + power("10", f"{math.log10(abs(value)):.0f}") if value else "0"


def _with_power(value: float, position: int | None = None) -> str:
    digits, exponent = f"{value:.0e}".split("e")
    return ("" if digits == "1" else f"{digits}·") + power("10", str(int(exponent)))


# -- what is around the panels ------------------------------------------------------------------


def _write_legend(drawing: Figure, sheet: Sheet, entries: Mapping[tuple[str, str], Any]) -> None:
    """Legend below the panels, in as many columns as fit, or a column for each group."""
    blocks = _blocks(sheet, entries)
    every = [entry for block in blocks for entry in block]
    if not every:
        return
    most, count = _MOST * drawing.bbox.width, len(every)
    # The lowest layout that is no wider than the figure.
    layouts = [
        (columns, every) for columns in dict.fromkeys(-(-count // r) for r in range(1, count + 1))
    ]
    if len(blocks) > 1:
        stacks = (_stacked(blocks, each) for each in range(1, len(blocks) + 1))
        layouts = [(len(columns), [*chain(*columns)]) for columns in stacks]
    for columns, listed in layouts:
        texts, handles = zip(*listed, strict=True)
        legend = drawing.legend(
            handles, texts, ncols=columns, loc="outside lower center",
            **(_DENSE if len(blocks) > 1 else {}),
        )  # fmt: skip
        if legend.get_window_extent().width <= most or columns == 1:
            break
        legend.remove()
    room = most - legend.handlelength * 1.5 * _points(mpl.rcParams["legend.fontsize"])
    headings = {block[0][0] for block in blocks if block[0][1] is _BLANK}
    for entry in legend.get_texts():
        entry.set_fontstyle("italic" if entry.get_text() in headings else "normal")
        entry.set_text(_wrapped(entry, entry.get_text(), room))
    if sheet.heading:
        legend.set_title(" ")
        legend.set_title(_wrapped(legend.get_title(), sheet.heading, 0.95 * most))


def _blocks(sheet: Sheet, entries: Mapping[tuple[str, str], Any]) -> list[list[tuple[str, Any]]]:
    """Legend entries by group, with headings if there are several groups."""
    groups: dict[str, dict[str, Any]] = {}
    for (group, text), handle in entries.items():
        groups.setdefault(group, {})[text] = handle
    predicted, levels = groups.pop(_PREDICTED, {}), groups.pop(_LEVELS, {})
    if predicted:
        lines = {line.order: line.text for panel in sheet.panels for line in panel.references}
        orders = ", ".join(lines[order] for order in sorted(lines))
        levels[f"predicted: {orders}"] = next(iter(predicted.values()))
    blocks = [
        [*[(f"{plain(name)}:", _BLANK)] * (len(groups) > 1), *handles.items()]
        for name, handles in groups.items()
    ] or [[]]
    blocks[-1] += levels.items()
    return blocks


def _stacked(blocks: Sequence[list[Any]], each: int) -> list[list[Any]]:
    """Columns of so many blocks, all of one height."""
    stacks = [[*chain(*blocks[i : i + each])] for i in range(0, len(blocks), each)]
    tallest = max(map(len, stacks))
    return [[*stack, *[("", _BLANK)] * (tallest - len(stack))] for stack in stacks]


#: Settings of a legend of several groups.
_DENSE: Any = {
    "handlelength": 2.0, "handletextpad": 0.4, "columnspacing": 0.8, "labelspacing": 0.2,
}  # fmt: skip
#: What an entry without a line or marker has for a handle.
_BLANK = mpl.lines.Line2D([], [], linestyle="none")


#: Most layouts of a figure, that from which on ticks of a mechanism stay, and from which change on
#: (pixels) another one follows.
_LAYOUTS, _STILL, _SHIFT = 5, 2, 0.5
#: Between ticks of a mechanism (inch), about.
_TICKS = 0.3


def _lay_out(drawing: Figure, grid: Sequence[Any], sheet: Sheet, height: float | None) -> None:
    """Lay out the figure until its panels keep their place; `UserWarning` if there is no room."""
    engine: Any = drawing.get_layout_engine()
    rows = -(-len(grid) // sheet.columns)
    room = np.zeros(len(grid) + 1)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="constrained_layout not applied")
        for turn in range(_LAYOUTS):
            engine.execute(drawing)
            if turn == _STILL and sheet.panels[0].scene is not None:
                for axes in grid:  # others, of another length, would move the axes, and so on
                    axes.apply_aspect()
                    low, high = axes.get_ylim()
                    most = int(axes.get_window_extent().height / drawing.dpi / _TICKS)
                    ticks = MaxNLocator(min(max(most, 2), 9), steps=[1, 2, 5, 10])
                    axes.set_yticks([y for y in ticks.tick_values(low, high) if low <= y <= high])
            boxes = [axes.get_window_extent() for axes in grid]
            tall = boxes[0].height if height else drawing.dpi * _height(grid, sheet)
            more = tall - boxes[0].height
            before, room = room, np.array([tall, *(box.width for box in boxes)])
            if max(abs(more), *np.abs(room - before)) < _SHIFT:
                break
            # Texts are broken into lines by the room that they have, which they change.
            _write_labels(drawing, grid, sheet, tall)
            for place, axes in enumerate(grid):
                _write_titles(axes, sheet, place, tall)
            if before.any():  # the texts have had their room
                drawing.set_figheight(drawing.get_figheight() + rows * more / drawing.dpi)
        else:
            engine.execute(drawing)
            boxes = [axes.get_window_extent() for axes in grid]
    least_width, least_height = (side * drawing.dpi for side in _LEAST)
    if any(box.width < least_width or box.height < least_height for box in boxes):
        raise UserWarning
    # With the engine "none" matplotlib would draw every file twice.
    with mpl.rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
        drawing.set_layout_engine(None)


def _height(grid: Sequence[Any], sheet: Sheet) -> Any:
    """Height of axes that suits their width (inch)."""
    width = grid[0].get_window_extent().width / grid[0].figure.dpi
    if sheet.panels[0].scene is not None:
        limits = grid[0].viewLim
        return width * min(max(limits.height / limits.width, 0.4), 1.2)
    return min(max(0.7 * width, 0.9), max(2.0, width / 2) if len(grid) == 1 else 1.4)


def _write_labels(drawing: Figure, grid: Sequence[Any], sheet: Sheet, tall: float) -> None:
    """Axis labels; one that all panels of a row or of the sheet share is written once."""
    panels, columns = sheet.panels, sheet.columns
    count, rows = len(panels), -(-len(panels) // columns)
    if columns > 1 and len({panel.x_label for panel in panels}) == 1:
        drawing.subfigs[0].supxlabel(panels[0].x_label, fontsize=mpl.rcParams["axes.labelsize"])
    else:
        for place, axes in enumerate(grid):
            if place + columns >= count or panels[place + columns].x_label != panels[place].x_label:
                axes.set_xlabel(panels[place].x_label)
    if rows > 1 and len({panel.y_label for panel in panels}) == 1:
        label = drawing.subfigs[0].supylabel(" ", fontsize=mpl.rcParams["axes.labelsize"])
        label.set_text(_wrapped(label, panels[0].y_label, 0.8 * rows * tall))
        return
    for place, axes in enumerate(grid):
        if place % columns == 0 or panels[place - 1].y_label != panels[place].y_label:
            label = axes.yaxis.label
            label.set_text(_wrapped(label, panels[place].y_label, tall))


def _write_titles(axes: Any, sheet: Sheet, place: int, tall: float) -> None:
    """Titles above the panels and beside a grid, with the fitted slopes below them."""
    panel, columns = sheet.panels[place], sheet.columns
    while axes.texts and axes.texts[-1].get_label() == "title":
        axes.texts[-1].remove()
    width = axes.get_window_extent().width
    size = 0.9 * _points(mpl.rcParams["legend.fontsize"])
    title, beside = panel.title, ""
    if _is_grid(sheet):
        title = panel.titles[1] if place < columns else ""
        last = place % columns == columns - 1
        beside = panel.titles[0] if last else ""
    above, (fits, short) = 0.0, _fits(panel)
    if fits:
        where, side = ((0.5, 0.5), "center") if panel.empty else ((0.5, 1), "bottom")
        text = axes.annotate(
            "", where, xycoords="axes fraction", xytext=(0, 3), textcoords="offset points",
            ha="center", va=side, fontsize=size, color="0.3", label="title",
        )  # fmt: skip
        # Labels may have commas of their own.
        between = "; " if any(", " in fit for fit in fits) else ", "
        lines = _wrapped(text, between.join(fits), width)
        if lines.count("\n") > 1:  # names take too much room
            lines = _wrapped(text, ", ".join(short), width)
        text.set_text(lines)
        above = 0.0 if panel.empty else text.get_window_extent().height * 72 / axes.figure.dpi
    axes.set_title(" ", pad=4 + above + (3 if above else 0))
    axes.title.set_text(_wrapped(axes.title, plain(title), width))
    if beside:
        text = axes.annotate(
            "", (1, 0.5), xycoords="axes fraction", xytext=(4, 0), textcoords="offset points",
            ha="left", va="center", rotation=270 if len(beside) > 2 else 0, label="title",
            fontsize=mpl.rcParams["axes.titlesize"],
        )  # fmt: skip
        text.set_text(_wrapped(text, plain(beside), tall))


def _fits(panel: Panel) -> tuple[list[str], list[str]]:
    """Fitted slopes of a panel with a title, and its number of zeros, in full and in short.

    In full slopes have labels and standard errors.
    """
    told = panel.traces if panel.titles and any(t.fit for t in panel.traces) else ()
    log = panel.y_scale == "log"
    values = {t.label: "= 0" if log and t.zeros == len(t.y) else t.fit for t in told}
    fits = [f"{plain(k)}{_FIXED}{v.replace(' ', _FIXED)}" for k, v in values.items() if v]
    bare = (re.sub(r" ± [0-9.]+", "", value) for value in values.values())
    short = [fit.replace(" ", _FIXED) or "–" for fit in bare]
    zeros = sum(t.zeros for t in panel.traces if t.zeros < len(t.y) or not told)
    if zeros and panel.tell_zeros and log:
        fits.append("1 value is exactly 0" if zeros == 1 else f"{zeros} values are exactly 0")
        short.append(f"{zeros} zeros")
    elif panel.empty and not panel.scene:
        fits.append("no values")
    return fits, short


def _is_grid(sheet: Sheet) -> bool:
    """Whether panels have one title by row, and another by column."""
    titles = [panel.titles for panel in sheet.panels]
    return (
        sheet.columns > 1
        and len(titles) > sheet.columns
        and all(
            len(pair) == 2
            and pair[0] == titles[place - place % sheet.columns][0]
            and pair[1] == titles[place % sheet.columns][1]
            for place, pair in enumerate(titles)
        )
    )


#: What a line is not broken in: a word, mathematics, or a relation; and a space at which it is not.
_WORD, _FIXED = re.compile(r"(?:(?<!\\)\$[^$]*\$| [=≤≥×±] |[^ \n])+"), "\u00a0"
#: Where mathematics begins or ends; a dollar sign of a text has a backslash.
_DOLLAR = re.compile(r"(?<!\\)\$")


def _wrapped(probe: Any, text: str, most: float) -> str:
    """Break a text into lines of at most `most` pixels; measures, and changes, `probe`."""
    lines: list[str] = []
    side = "height" if probe.get_rotation() else "width"

    def excess(line: str) -> float:
        probe.set_text(line)
        return float(getattr(probe.get_window_extent(), side)) / most

    for word in _WORD.findall(text):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and excess(longer) > 1:
            lines.append(word)
        else:
            lines[-1:] = [longer]
        # A word that is longer than a line is broken, but for mathematics.
        mathematics = _DOLLAR.search(word)
        while not mathematics and (times := excess(lines[-1])) > 1 and len(lines[-1]) > 9:
            cut = int(len(lines[-1]) / times) or 1
            cut = lines[-1].rfind("-", 1, cut) + 1 or cut
            cut += lines[-1][cut - 1 : cut + 1] == r"\$"
            lines[-1:] = [lines[-1][:cut], lines[-1][cut:]]
    return "\n".join(lines)


def _points(size: Any) -> float:
    """Size of a font (points), which a style may give in words."""
    return float(FontProperties(size=size).get_size_in_points())


# -- predicted orders beside their lines --------------------------------------------------------


def _write_orders(axes: Any, panel: Panel) -> None:
    """Write predicted orders along their lines, where nothing else is drawn."""
    lines = [line for line in panel.references if line.text]
    taken = [_pixels(axes, line) for line in axes.get_lines()] if lines else []
    inside = axes.get_window_extent()
    low, high = inside.min + 6, inside.max - 6  # past the ticks in the frame
    for line in lines:
        text = axes.text(
            0, 0, line.text, ha="center", va="center", style="italic", fontsize=7, color="0.35"
        )
        text.set_in_layout(False)
        extent = text.get_window_extent()
        half = np.array([extent.width, extent.height]) / 2
        obstacles = np.concatenate(taken)
        for place in _places(axes.transData.transform(np.column_stack([line.x, line.y])), half):
            near = np.all(np.abs(obstacles - place) < half + 3, axis=1)
            if not near.any() and np.all((place - half > low) & (place + half < high)):
                text.set_position(axes.transData.inverted().transform(place))
                taken.append(place + half * np.array([[-1, 0], [0, 0], [1, 0]]))
                break
        else:
            text.remove()


def _places(ends: Array, half: Array) -> Iterator[Array]:
    """Candidate centres of a text beside a line, starting behind its end."""
    along = (ends[-1] - ends[0]) / np.linalg.norm(ends[-1] - ends[0])
    yield ends[-1] + along * (half[0] + 3)
    normal = np.array([-along[1], along[0]])
    off = normal * (np.abs(normal) @ half + 4)
    for share in np.linspace(1, 0, 21):
        point = ends[0] + share * (ends[-1] - ends[0])
        yield point + off
        yield point - off


def _pixels(axes: Any, line: Any) -> Array:
    """(points, 2) pixels that a line and its markers cover."""
    corners = line.get_transform().transform(line.get_xydata())
    steps = 1 if line.get_linestyle() == "None" else 100
    return np.asarray(Path(corners).interpolated(steps).vertices)
