"""Drawing: the one module that imports matplotlib.  One style for all figures."""

import io
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Polygon
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from newmark_cli.arrays import Array
from newmark_cli.newmark.forms import FORMS
from newmark_cli.problems.planar import Mechanism
from newmark_cli.report.figures import MechanismFigure, OrderFigure, SensitivityFigure
from newmark_cli.report.slopes import Slope, format_fit, format_order
from newmark_cli.study.results import write_atomically

#: Width of a journal column (inch).
_WIDTH = 3.5

_STYLE: Any = {
    "font.size": 7.5,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "mathtext.fontset": "dejavusans",
    "svg.hashsalt": "newmark-study",
    "savefig.dpi": 300,
}

# Colours of Okabe and Ito, dark to light, so that they differ in grey too; open
# and filled markers of different sizes, so that coinciding series all show.
_LOOKS: tuple[dict[str, Any], ...] = (
    {"color": "#000000", "marker": "o", "markersize": 7.5, "fill": False, "linestyle": "-"},
    {"color": "#0072B2", "marker": "x", "markersize": 4.5, "fill": True, "linestyle": "--"},
    {"color": "#D55E00", "marker": "s", "markersize": 7.0, "fill": False, "linestyle": "-."},
    {"color": "#E69F00", "marker": "D", "markersize": 3.0, "fill": True, "linestyle": ":"},
    {"color": "#009E73", "marker": "^", "markersize": 5.0, "fill": False, "linestyle": "-"},
    {"color": "#56B4E9", "marker": "v", "markersize": 3.5, "fill": True, "linestyle": "--"},
)

_SYMBOLS = {"u": "u", "v": "v", "a": "a", "lambda": r"\lambda"}


def axis_label(quantity: str, measure: str) -> str:
    """Label of the ordinate in the field's symbols."""
    if measure == "condition":
        return r"condition number $C = \|\bar J\|\,\|\bar J^{-1}\|$"
    symbol = _SYMBOLS[quantity]
    if measure == "correction":
        return rf"last decreasing correction $\|\Delta\bar {symbol}\|$ (rms)"
    return rf"last decreasing correction $\|\Delta {symbol}\|$ (rms)"


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as PNG and SVG, the same bytes each time; returns the files."""
    files = []
    for suffix, metadata in ((".png", {}), (".svg", {"Date": None})):
        with mpl.rc_context(_STYLE):
            content = io.BytesIO()
            figure.savefig(content, format=suffix[1:], metadata=metadata)
        files.append(stem.with_suffix(suffix))
        write_atomically(files[-1], content.getvalue())
    return files


def order_figure(figure: OrderFigure, slopes: Sequence[Slope]) -> Figure:
    """A quantity against h: points, fitted slopes in the legend, predicted ones as lines.

    Args:
        figure: The entry.
        slopes: Its series, in the order of the legend.
    """
    with mpl.rc_context(_STYLE):
        drawing = Figure(figsize=(_WIDTH, 3.3))
        axes = drawing.add_axes((0.165, 0.305, 0.815, 0.63))
        axes.set_xscale("log")
        axes.set_yscale("log")
        for slope, look in zip(slopes, _LOOKS, strict=False):
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
    with mpl.rc_context(_STYLE | {"font.size": 6, "legend.fontsize": 6.5}):
        drawing = Figure(figsize=(2 * _WIDTH, 1.35 * len(unknowns) + 0.6))
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
    for slope, look in zip(slopes, (_LOOKS[0], _LOOKS[3]), strict=False):
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
        measured = format_fit(slope.fit).partition(" ±")[0] if shown.any() else "exactly 0"
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
    axes.xaxis.set_minor_formatter(NullFormatter())
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


def mechanism_figure(figure: MechanismFigure, mechanism: Mechanism) -> Figure:
    """A mechanism in its initial position: bodies, joints, ground, springs, torques."""
    with mpl.rc_context(_STYLE | {"xtick.top": False, "ytick.right": False}):
        places = _places(mechanism)
        # Millimetres: mechanisms of this kind are a hand wide.
        points = {name: 1e3 * place for name, place in places.items()}
        size = max(
            np.ptp([p.real for p in points.values()]), np.ptp([p.imag for p in points.values()])
        )
        drawing = Figure(figsize=(_WIDTH, 3.5))
        axes = drawing.add_axes((0.135, 0.11, 0.845, 0.83))
        for name in mechanism.bodies:
            _body(axes, mechanism, name, points)
            _body_label(axes, mechanism, name, points, size)
        for bar in mechanism.bars.values():
            _line(axes, [points[bar.from_], points[bar.to]], color="black", linewidth=1.6)
        for spring in mechanism.springs.values():
            _line(
                axes,
                _zigzag(points[spring.from_], points[spring.to], 0.012 * size),
                color="#009E73",
                linewidth=0.9,
            )
        for torque in mechanism.torques.values():
            _torque(axes, points[mechanism.bodies[torque.on].from_], 0.11 * size, torque.torque)
        for name, place in points.items():
            fixed = name in mechanism.points and mechanism.points[name].fixed is not None
            if fixed:
                _ground(axes, place, 0.03 * size)
            axes.plot(
                place.real,
                place.imag,
                "o",
                color="black",
                markersize=3.6,
                zorder=5,
                markerfacecolor="black" if fixed else "white",
                markeredgewidth=0.8,
            )
            _joint_label(axes, mechanism, name, points)
        _key(axes, mechanism)
        axes.set_aspect("equal")
        axes.margins(0.1)
        axes.set_xlabel("$x$ (mm)")
        axes.set_ylabel("$y$ (mm)")
        axes.set_title(figure.title)
    return drawing


def _key(axes: Any, mechanism: Mechanism) -> None:
    """What the symbols mean."""

    def symbol(label: str, marker: str, face: str, edge: str) -> Line2D:
        return Line2D(
            [],
            [],
            linestyle="none",
            label=label,
            marker=marker,
            color=edge,
            markersize=4,
            markerfacecolor=face,
        )

    handles = [symbol("fixed point", "o", "black", "black"), symbol("joint", "o", "white", "black")]
    if mechanism.bodies:
        handles.append(symbol("mass centre", "+", "none", "#D55E00"))
    if mechanism.springs:
        handles.append(Line2D([], [], label="spring", color="#009E73"))
    if mechanism.torques:
        handles.append(Line2D([], [], label="torque, driven body", color="#D55E00", linewidth=2))
    axes.legend(handles=handles, loc="upper left", fontsize=6, handlelength=1.5)


def _places(mechanism: Mechanism) -> dict[str, complex]:
    places = {
        name: complex(*(point.fixed or point.at or (0, 0)))
        for name, point in mechanism.points.items()
    }
    for name, point in mechanism.body_points.items():
        body = mechanism.bodies[point.on]
        along = (places[body.to] - places[body.from_]) / body.length
        places[name] = places[body.from_] + complex(*point.at) * along
    return places


def _corners(mechanism: Mechanism, name: str) -> list[str]:
    body = mechanism.bodies[name]
    return [
        body.from_,
        body.to,
        *(point for point, given in mechanism.body_points.items() if given.on == name),
    ]


def _line(axes: Any, points: Sequence[complex], **look: Any) -> None:
    axes.plot([p.real for p in points], [p.imag for p in points], **look)


def _body(axes: Any, mechanism: Mechanism, name: str, points: dict[str, complex]) -> None:
    body = mechanism.bodies[name]
    start, end = points[body.from_], points[body.to]
    corners = [points[corner] for corner in _corners(mechanism, name)]
    centre = start + complex(*body.centre) * (end - start) / body.length
    if len(corners) == 2 and body.centre[1] != 0:
        corners.append(centre)
    if len(corners) > 2:
        outline = [(p.real, p.imag) for p in corners]
        axes.add_patch(Polygon(outline, closed=True, facecolor="#56B4E9", alpha=0.25, zorder=1))
        axes.add_patch(
            Polygon(outline, closed=True, fill=False, edgecolor="#0072B2", linewidth=0.7, zorder=2)
        )
    driven = name in {torque.on for torque in mechanism.torques.values()}
    color, width, order = ("#D55E00", 3.2, 3) if driven else ("#0072B2", 1.8, 2)
    _line(axes, [start, end], color=color, linewidth=width, solid_capstyle="round", zorder=order)
    axes.plot(
        centre.real,
        centre.imag,
        marker="+",
        color="#D55E00",
        markersize=4,
        markeredgewidth=0.8,
        zorder=6,
    )


def _body_label(
    axes: Any, mechanism: Mechanism, name: str, points: dict[str, complex], size: float
) -> None:
    """Put a body's name inside its outline, or beside its line where there is more room."""
    body = mechanism.bodies[name]
    start, end = points[body.from_], points[body.to]
    corners = [points[p] for p, given in mechanism.body_points.items() if given.on == name]
    if corners:
        place = (start + end + sum(corners)) / (2 + len(corners)) - 0.03j * size
    else:
        normal = (end - start) / abs(end - start) * 1j
        sides = [(start + end) / 2 + sign * 0.04 * size * normal for sign in (1, -1)]
        others = [place for place in points.values() if place not in (start, end)]
        others += [
            points[name] - 0.04j * size  # the ground's hatching
            for name, point in mechanism.points.items()
            if point.fixed is not None
        ]
        for other in mechanism.bodies:
            corner = [points[name] for name in _corners(mechanism, other)]
            if other != name:
                others += [
                    first + step * (last - first)
                    for first, last in itertools.combinations(corner, 2)
                    for step in np.linspace(0, 1, 11)
                ]
        others.append(start + complex(*body.centre) * (end - start) / body.length)
        place = max(sides, key=lambda side: min(abs(side - other) for other in others))
    axes.text(place.real, place.imag, name, color="#0072B2", fontsize=6, ha="center", va="center")


def _joint_label(axes: Any, mechanism: Mechanism, name: str, points: dict[str, complex]) -> None:
    """Put a joint's name on the side where no body leaves it."""
    place = points[name]
    lines = [_corners(mechanism, body) for body in mechanism.bodies]
    lines += [[spring.from_, spring.to] for spring in mechanism.springs.values()]
    lines += [[bar.from_, bar.to] for bar in mechanism.bars.values()]
    neighbours = [
        points[other] for line in lines if name in line for other in line if other != name
    ]
    taken = [math.atan2((q - place).imag, (q - place).real) for q in neighbours]
    if name in mechanism.points and mechanism.points[name].fixed is not None:
        taken.append(-math.pi / 2)
    if not taken:
        taken = [0.0]
    candidates = np.linspace(-math.pi, math.pi, 73)[:-1]
    distance = [
        min(abs(math.remainder(angle - other, 2 * math.pi)) for other in taken)
        for angle in candidates
    ]
    angle = float(candidates[int(np.argmax(distance))])
    axes.annotate(
        name,
        (place.real, place.imag),
        textcoords="offset points",
        xytext=(8 * math.cos(angle), 8 * math.sin(angle)),
        ha="center",
        va="center",
        fontsize=8,
        fontweight="bold",
    )


def _ground(axes: Any, place: complex, size: float) -> None:
    foot = [place, place + complex(-0.6, -1) * size, place + complex(0.6, -1) * size]
    axes.add_patch(
        Polygon(
            [(p.real, p.imag) for p in foot],
            closed=True,
            facecolor="white",
            edgecolor="black",
            linewidth=0.7,
            zorder=3,
        )
    )
    for step in np.linspace(-0.8, 0.8, 5):
        start = place + complex(step, -1) * size
        _line(axes, [start, start + complex(-0.35, -0.45) * size], color="black", linewidth=0.5)


def _zigzag(start: complex, end: complex, amplitude: float, coils: int = 7) -> list[complex]:
    along = end - start
    normal = along / abs(along) * 1j
    inner = [
        start + along * (0.2 + 0.6 * (k + 0.5) / (2 * coils)) + (-1) ** k * amplitude * normal
        for k in range(2 * coils)
    ]
    return [start, start + 0.2 * along, *inner, start + 0.8 * along, end]


def _torque(axes: Any, centre: complex, radius: float, torque: float) -> None:
    first, last = (20.0, 150.0) if torque > 0 else (150.0, 20.0)
    axes.add_patch(
        Arc(
            (centre.real, centre.imag),
            2 * radius,
            2 * radius,
            theta1=min(first, last),
            theta2=max(first, last),
            color="#D55E00",
            linewidth=1.0,
        )
    )
    tip = centre + radius * np.exp(1j * math.radians(last))
    back = centre + radius * np.exp(1j * math.radians(last - math.copysign(14, torque)))
    axes.annotate(
        "",
        xy=(tip.real, tip.imag),
        xytext=(back.real, back.imag),
        arrowprops={
            "arrowstyle": "-|>",
            "color": "#D55E00",
            "linewidth": 1.0,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 8,
        },
    )
