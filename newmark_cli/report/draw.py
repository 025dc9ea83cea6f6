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
from newmark_cli.report.figures import OrderFigure, SensitivityFigure
from newmark_cli.report.slopes import Slope, format_fit, format_order
from newmark_cli.report.style import LOOKS, STYLE, WIDTH

_SYMBOLS = {"u": "u", "v": "v", "a": "a", "lambda": r"\lambda"}


def axis_label(quantity: str, measure: str) -> str:
    """Label of the ordinate in the field's symbols."""
    if measure == "condition":
        return r"condition number $C = \|\bar J\|\,\|\bar J^{-1}\|$"
    symbol = _SYMBOLS[quantity]
    if measure == "correction":
        return rf"last decreasing correction $\|\Delta\bar {symbol}\|$ (rms)"
    return rf"last decreasing correction $\|\Delta {symbol}\|$ (rms)"


def order_figure(figure: OrderFigure, slopes: Sequence[Slope]) -> Figure:
    """A quantity against h: points, fitted slopes in the legend, predicted ones as lines.

    Args:
        figure: The entry.
        slopes: Its series, in the order of the legend.
    """
    with mpl.rc_context(STYLE):
        drawing = Figure(figsize=(WIDTH, 3.3))
        axes = drawing.add_axes((0.165, 0.305, 0.815, 0.63))
        axes.set_xscale("log")
        axes.set_yscale("log")
        for slope, look in zip(slopes, LOOKS, strict=False):
            shown = np.isfinite(slope.values) & (slope.values > 0)
            order = np.argsort(slope.h[shown])
            name = slope.preconditioning.partition("[")[0]
            axes.plot(
                slope.h[shown][order],
                slope.values[shown][order],
                color=look["color"],
                marker=look["marker"],
                markersize=look["markersize"],
                markerfacecolor=look["color"] if look["fill"] else "none",
                linestyle=look["linestyle"],
                label=f"{name}: {format_fit(slope.fit)}",
            )
        _widen(axes, slopes)
        _predicted_lines(axes, slopes)
        axes.set_xlabel(f"step size $h${figure.unit}")
        axes.set_ylabel(axis_label(figure.quantity, figure.measure))
        axes.set_title(figure.title)
        for axis, ticks in ((axes.xaxis, 12), (axes.yaxis, 10)):
            axis.set_major_locator(LogLocator(numticks=ticks))
            axis.set_major_formatter(FuncFormatter(_power_of_ten))
            axis.set_minor_formatter(NullFormatter())
        axes.grid(color="0.92", linewidth=0.5)
        axes.set_axisbelow(True)
        handles, labels = axes.get_legend_handles_labels()
        drawing.legend(
            handles,
            labels,
            title="fitted slope",
            loc="lower center",
            ncols=2,
            handlelength=3.0,
            borderpad=0.2,
            columnspacing=1.2,
            bbox_to_anchor=(0.56, 0.0),
        )
        missing = sum(int(np.count_nonzero(slope.values == 0)) for slope in slopes)
        if missing:
            axes.annotate(f"{missing} values are exactly 0", (0.02, 0.02), xycoords="axes fraction")
    return drawing


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
        if slope.expected in drawn or slope.fit.points < 1:
            continue
        shown = np.isfinite(slope.values) & (slope.values > 0)
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
    left, right = axes.get_xlim()
    axes.set_xlim(left, right * (right / left) ** 0.08)
