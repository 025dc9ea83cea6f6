"""Drawing of results: quantities against the step size."""

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from newmark_cli.arrays import Array
from newmark_cli.newmark.forms import FORMS
from newmark_cli.report.figures import (
    HistoryFigure,
    OrderFigure,
    PrecisionFigure,
    SensitivityFigure,
    SeriesFigure,
    StudyFigure,
)
from newmark_cli.report.fits import format_fit, format_order
from newmark_cli.report.history import History
from newmark_cli.report.slopes import Slope
from newmark_cli.report.style import LOOKS, STYLE, WIDTH

_SYMBOLS = {"u": "u", "v": "v", "a": "a", "lambda": r"\lambda"}

#: Curves over time; the first alternates from step to step, the last two coincide.
_OVER_TIME: tuple[dict[str, Any], ...] = (
    {"color": "#D55E00", "linewidth": 0.4, "marker": ".", "markersize": 1.2, "alpha": 0.7},
    {"color": "#56B4E9", "linewidth": 2.6},
    {"color": "#000000", "linewidth": 0.8, "linestyle": "--"},
)

#: Problems of unit mass, length and gravity; all others are in SI units.
_WITHOUT_UNITS = ("pendulum", "chain")

#: A line of a legend (inch), and how many fit under axes of the usual size.
_LINE, _LINES = 0.147, 4


def axis_label(slope: Slope) -> str:
    """Label of the ordinate in the field's symbols."""
    return slope.record.label(slope.key)


def figure_of(figure: SeriesFigure, slopes: Sequence[Slope]) -> Figure:
    """Any figure of series.

    Args:
        figure: The entry.
        slopes: Its series, in the order of its curves.
    """
    if isinstance(figure, SensitivityFigure):
        return sensitivity_figure(figure, slopes)
    if isinstance(figure, PrecisionFigure):
        return precision_figure(figure, slopes)
    return order_figure(figure, slopes)


def order_figure(figure: OrderFigure | StudyFigure, slopes: Sequence[Slope]) -> Figure:
    """A quantity against h: points, fitted slopes in the legend, predicted ones as lines.

    Args:
        figure: The entry.
        slopes: Its series, in the order of the legend.
    """
    linear, note = (figure.linear, figure.note) if isinstance(figure, StudyFigure) else (False, "")
    with mpl.rc_context(STYLE):
        places = {curve.key: i for i, curve in enumerate(figure.curves)}
        labels = [
            figure.curves[places[slope.key]].label
            + ("" if np.isnan(slope.expected) else f": {format_fit(slope.fit)}")
            for slope in slopes
        ]
        predicted = any(not np.isnan(slope.expected) for slope in slopes)
        columns = 2 if max(map(len, labels)) <= 26 else 1
        lines = math.ceil((len(labels) + predicted) / columns) + bool(predicted or note)
        more = (lines - _LINES) * _LINE
        height = 3.3 + more
        drawing = Figure(figsize=(WIDTH, height))
        foot = (0.305 * 3.3 + more) / height
        axes = drawing.add_axes((0.165, foot, 0.815, 0.63 * 3.3 / height))
        axes.set_xscale("log")
        if not linear:
            axes.set_yscale("log")
        for slope, label in zip(slopes, labels, strict=True):
            _series(axes, slope, LOOKS[places[slope.key]], label, zeros=linear)
        if linear:
            _from_zero(axes, slopes)
        else:
            _widen(axes, slopes)
            axes.yaxis.set_major_locator(LogLocator(numticks=10))
            axes.yaxis.set_major_formatter(FuncFormatter(_power_of_ten))
            axes.yaxis.set_minor_formatter(NullFormatter())
            _predicted_lines(axes, slopes)
        _mark_stagnation(axes, slopes)
        axes.set_xlabel(_step_label(slopes))
        axes.set_ylabel(axis_label(slopes[0]))
        axes.set_title(figure.title)
        axes.xaxis.set_major_locator(LogLocator(numticks=12))
        axes.xaxis.set_major_formatter(FuncFormatter(_power_of_ten))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(color="0.92", linewidth=0.5)
        axes.set_axisbelow(True)
        handles, labels = axes.get_legend_handles_labels()
        legend = drawing.legend(
            handles,
            labels,
            title="fitted slope" if predicted else note,
            loc="lower center",
            ncols=columns,
            handlelength=3.0,
            borderpad=0.2,
            columnspacing=1.2,
        )
        # Under the axes, or further left where it would be cut off.
        width = legend.get_window_extent().width / drawing.bbox.width
        legend.set_bbox_to_anchor((min(0.56, 0.995 - width / 2), 0.0))
        missing = sum(int(np.count_nonzero(slope.values == 0)) for slope in slopes)
        if missing and not linear:
            axes.annotate(f"{missing} values are exactly 0", (0.02, 0.02), xycoords="axes fraction")
    return drawing


def _step_label(slopes: Sequence[Slope]) -> str:
    family = slopes[0].problem.partition("(")[0]
    return "step size $h$" + ("" if family in _WITHOUT_UNITS else " (s)")


def _series(
    axes: Any, slope: Slope, look: dict[str, Any], label: str, zeros: bool = False, size: float = 1
) -> None:
    """Points of one series, joined; cells that stagnated as open markers, not joined."""
    shown = np.isfinite(slope.values) & ((slope.values > 0) | zeros)
    stagnated = np.array([status == "stagnated" for status in slope.statuses], bool)
    for chosen, line, fill, name in (
        (shown & ~stagnated, look["linestyle"], look["fill"], label),
        (shown & stagnated, "none", False, None),
    ):
        order = np.argsort(slope.h[chosen])
        if name is not None or chosen.any():
            axes.plot(
                slope.h[chosen][order],
                slope.values[chosen][order],
                color=look["color"],
                marker=look["marker"],
                markersize=size * look["markersize"],
                markerfacecolor=look["color"] if fill else "none",
                linestyle=line if len(order) > 1 else "none",
                label=name,
            )


def _from_zero(axes: Any, slopes: Sequence[Slope]) -> None:
    """A share from 0 to 1, a count from 0 to its largest, with room for markers."""
    values = np.concatenate([slope.values for slope in slopes])
    top = 1.0 if slopes[0].measure == "tolerance" else 1.1 * float(np.nanmax(values))
    axes.set_ylim(-0.06 * top, 1.07 * top)


def _mark_stagnation(axes: Any, slopes: Sequence[Slope]) -> None:
    """Say what the open markers at the solver's limit are."""
    limits = [
        value
        for slope in slopes
        for value, status in zip(slope.values, slope.statuses, strict=True)
        if status == "stagnated" and np.isfinite(value)
    ]
    for limit in dict.fromkeys(limits):
        axes.axhline(limit, color="0.55", linewidth=0.6, zorder=1)
        axes.annotate(
            f"no convergence in {limit:.0f} iterations",
            (0.98, limit),
            xycoords=axes.get_yaxis_transform(),
            xytext=(0, 6),
            textcoords="offset points",
            ha="right",
            va="bottom",
            color="0.35",
        )


def precision_figure(figure: PrecisionFigure, slopes: Sequence[Slope]) -> Figure:
    """Corrections in two precisions against h, one panel below the other.

    Args:
        figure: The entry.
        slopes: Its series, panel by panel and precision by precision.
    """
    unknowns = FORMS[figure.form].unknowns
    with mpl.rc_context(STYLE):
        drawing = Figure(figsize=(WIDTH, 0.75 + 1.75 * len(unknowns)))
        panels = drawing.subplots(
            len(unknowns),
            sharex=True,
            squeeze=False,
            gridspec_kw={
                "left": 0.165, "right": 0.98, "bottom": 0.155, "top": 0.945, "hspace": 0.06,
            },
        )[:, 0]  # fmt: skip
        for unknown, axes in zip(unknowns, panels, strict=True):
            axes.set_xscale("log")
            axes.set_yscale("log")
            ours = [slope for slope in slopes if slope.quantity == unknown]
            for slope in ours:
                first = slope.precision == figure.precisions[0]
                variant = figure.variants.index(slope.preconditioning)
                label = slope.preconditioning if first else "_"
                _series(axes, slope, LOOKS[variant], label, size=0.8)
            _widen(axes, ours, headroom=0.06)
            axes.set_ylabel(axis_label(ours[0]).removeprefix("last decreasing "))
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(LogLocator(numticks=10))
                axis.set_major_formatter(FuncFormatter(_power_of_ten))
                axis.set_minor_formatter(NullFormatter())
            axes.grid(color="0.92", linewidth=0.5)
            axes.set_axisbelow(True)
            for precision in figure.precisions:
                _name_beside(axes, precision, [s for s in ours if s.precision == precision])
        left, right = panels[0].get_xlim()
        panels[0].set_xlim(left, right * (right / left) ** 0.17)
        panels[0].set_title(figure.title)
        panels[-1].set_xlabel(_step_label(slopes))
        drawing.legend(
            *panels[0].get_legend_handles_labels(),
            loc="lower center",
            ncols=len(figure.variants),
            handlelength=2.6,
            columnspacing=1.0,
            bbox_to_anchor=(0.56, 0.0),
        )
    return drawing


def history_figure(figure: HistoryFigure, histories: Sequence[History]) -> Figure:
    """A multiplier over time: above in the range of the last curve, below as far as any goes.

    Args:
        figure: The entry.
        histories: Its time series, in the order of its curves.
    """
    reference = histories[-1].multipliers
    component = int(np.argmax(np.max(np.abs(reference), axis=0)))
    low, high = (1e-3 * extreme(reference[:, component]) for extreme in (np.min, np.max))
    with mpl.rc_context(STYLE):
        drawing = Figure(figsize=(WIDTH, 4.4))
        zoomed, whole = drawing.subplots(
            2,
            sharex=True,
            gridspec_kw={
                "left": 0.165, "right": 0.965, "bottom": 0.24, "top": 0.95, "hspace": 0.08,
            },
        )  # fmt: skip
        for axes in (zoomed, whole):
            for curve, history, look in zip(figure.curves, histories, _OVER_TIME, strict=False):
                values = 1e-3 * history.multipliers[:, component]
                axes.plot(history.t, values, label=curve.label, **look)
            axes.set_ylabel(rf"$\lambda_{component + 1}$ (kN/m)")
            axes.grid(color="0.92", linewidth=0.5)
            axes.set_axisbelow(True)
        zoomed.set_ylim(low - 0.25 * (high - low), high + 0.25 * (high - low))
        whole.set_yscale("symlog", linthresh=10 ** math.floor(math.log10(high - low)))
        whole.yaxis.set_major_formatter(FuncFormatter(_signed_power_of_ten))
        zoomed.set_title(figure.title)
        whole.set_xlabel("time $t$ (s)")
        drawing.legend(
            *zoomed.get_legend_handles_labels(),
            title=f"$h$ = {_power_of_ten(figure.h)} s; pairs of successive steps",
            loc="lower center",
            handlelength=2.6,
            borderpad=0.2,
            bbox_to_anchor=(0.56, 0.0),
        )
    return drawing


def _signed_power_of_ten(value: float, position: int | None = None) -> str:
    if value == 0:
        return "0"
    return ("−" if value < 0 else "") + _power_of_ten(abs(value))


def _name_beside(axes: Any, name: str, slopes: Sequence[Slope]) -> None:
    """Write a name right of the last points of series that belong together."""
    last = [slope.values[np.argmax(slope.h)] for slope in slopes]
    place = float(np.exp(np.mean(np.log([value for value in last if value > 0]))))
    axes.annotate(
        name,
        (max(float(slope.h.max()) for slope in slopes), place),
        xytext=(8, 0),
        textcoords="offset points",
        ha="left",
        va="center",
    )


def sensitivity_figure(figure: SensitivityFigure, slopes: Sequence[Slope]) -> Figure:
    """A small log–log panel for each unknown (down) and row block (across).

    Args:
        figure: The entry.
        slopes: Series of every panel, in the order of the legend.
    """
    unknowns, rows = FORMS[figure.form].unknowns, FORMS[figure.form].rows
    with mpl.rc_context(STYLE | {"font.size": 6, "legend.fontsize": 6.5}):
        drawing = Figure(figsize=(2 * WIDTH, 1.35 * len(unknowns) + 0.6))
        panels = drawing.subplots(
            len(unknowns),
            len(rows),
            sharex=True,
            gridspec_kw={
                "left": 0.085,
                "right": 0.985,
                "bottom": 0.105,
                "top": 0.91,
                "wspace": 0.3,
                "hspace": 0.12,
            },
        )
        for i, unknown in enumerate(unknowns):
            for j, row in enumerate(rows):
                _sensitivity_panel(
                    panels[i, j],
                    [s for s in slopes if (s.quantity, s.row_block) == (unknown, row)],
                )
                if i == 0:
                    panels[i, j].set_title(f"row {row} perturbed", fontsize=7)
                if i == len(unknowns) - 1:
                    panels[i, j].set_xlabel("$h$ (s)", fontsize=7)
            symbol = _SYMBOLS[unknown]
            panels[i, 0].set_ylabel(rf"$\|\delta\bar {symbol}\|/\varepsilon$", fontsize=7)
        handles, _ = panels[0, 0].get_legend_handles_labels()
        drawing.legend(
            handles,
            [*figure.variants, "predicted"],
            loc="lower center",
            ncols=len(handles),
            handlelength=3.0,
        )
        drawing.suptitle(figure.title, fontsize=8)
    return drawing


def _sensitivity_panel(axes: Any, slopes: Sequence[Slope]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    texts = []
    for slope, look in zip(slopes, (LOOKS[0], LOOKS[3]), strict=False):
        shown = slope.values > 0
        axes.plot(
            slope.h[shown],
            slope.values[shown],
            color=look["color"],
            marker=look["marker"],
            markersize=0.6 * look["markersize"],
            linestyle=look["linestyle"],
            markerfacecolor=look["color"] if look["fill"] else "none",
            label=slope.preconditioning,
        )
        measured = (
            f"{round(slope.fit.slope, 3) + 0.0:.3f}".replace("-", "−")
            if shown.any()
            else "exactly 0"
        )
        texts.append(f"{slope.preconditioning}: {measured}")
    if any((slope.values > 0).any() for slope in slopes):
        _widen(axes, slopes, headroom=0.4)
        for k, slope in enumerate(slopes):
            shown = slope.values > 0
            if shown.any():
                log_h, log_y = np.log10(slope.h[shown]), np.log10(slope.values[shown])
                line = log_y.mean() + slope.expected * (log_h - log_h.mean())
                axes.plot(
                    slope.h[shown],
                    10**line,
                    color="0.55",
                    linewidth=0.6,
                    zorder=1,
                    label="predicted" if k == 0 else None,
                )
        axes.yaxis.set_major_locator(LogLocator(numticks=5))
        axes.yaxis.set_major_formatter(FuncFormatter(_power_of_ten))
    else:
        axes.set_yticks([])
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_locator(LogLocator(numticks=6))
    axes.xaxis.set_major_formatter(FuncFormatter(_power_of_ten))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.text(
        0.97,
        0.95,
        "\n".join(texts),
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize=5.5,
        bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1},
    )


def _power_of_ten(value: float, position: int | None = None) -> str:
    """Tick label as plain text; mathtext takes longer than all the rest of a figure."""
    return "10" + f"{math.log10(value):.0f}".translate(_SUPERSCRIPTS)


_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def _widen(axes: Any, slopes: Sequence[Slope], headroom: float = 0.12) -> None:
    """At least four decades: scatter by a few per cent must not look like a trend."""
    values = np.concatenate([slope.values for slope in slopes])
    values = np.log10(values[np.isfinite(values) & (values > 0)])
    if len(values) == 0:
        return
    low, high = values.min(), values.max()
    least = max(0.5, (4 - (high - low)) / 2)
    below, above = (max(share * (high - low), least) for share in (0.12, headroom))
    axes.set_ylim(10 ** (low - below), 10 ** (high + above))


def _predicted_lines(axes: Any, slopes: Sequence[Slope]) -> None:
    """One thin line for each distinct predicted slope, parallel to its series."""
    drawn: dict[float, Array] = {}
    low, high = np.log10(axes.get_ylim())
    shift = 0.045 * (high - low)
    for slope in slopes:
        shown = slope.fitted & np.isfinite(slope.values) & (slope.values > 0)
        if np.isnan(slope.expected) or slope.expected in drawn or not shown.any():
            continue
        log_h, log_y = np.log10(slope.h[shown]), np.log10(slope.values[shown])
        ends = np.array([log_h.min(), log_h.max()])
        # Beside the data, not under them.
        drawn[slope.expected] = log_y.mean() + slope.expected * (ends - log_h.mean()) + shift
        label = "predicted" if len(drawn) == 1 else None
        axes.plot(
            10**ends,
            10 ** drawn[slope.expected],
            color="0.55",
            linewidth=0.6,
            zorder=1,
            label=label,
        )
        axes.annotate(
            "h" + format_order(slope.expected).replace("−", "-").translate(_SUPERSCRIPTS),
            (10 ** ends[1], 10 ** drawn[slope.expected][1]),
            textcoords="offset points",
            xytext=(7, 0),
            ha="left",
            va="center",
            style="italic",
            fontsize=7,
            color="0.35",
        )
    if drawn:
        left, right = axes.get_xlim()
        axes.set_xlim(left, right * (right / left) ** 0.08)
