"""Drawing: the one module that imports matplotlib.  One style for all figures."""

import io
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Polygon
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from PIL import Image

from newmark_cli.arrays import Array
from newmark_cli.newmark.forms import FORMS
from newmark_cli.problems.planar import Mechanism
from newmark_cli.problems.problem import Problem
from newmark_cli.report.figures import OrderFigure, SensitivityFigure
from newmark_cli.report.slopes import Slope, format_fit, format_order
from newmark_cli.study.results import write_atomically

#: Width of a journal column (inch).
_WIDTH = 3.5

#: Moving points up to which a mechanism is drawn with all its names and symbols.
_MOST_LABELS = 30

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


def mechanism_figure(title: str, problem: Problem, u: Array) -> Figure:
    """A mechanism at a position: bodies, joints, ground, springs, dampers, torques.

    Args:
        title: Title of the figure.
        problem: A problem that is a planar mechanism.
        u: (n,) position.
    """
    with mpl.rc_context(_STYLE | {"xtick.top": False, "ytick.right": False}):
        drawing = Figure(figsize=(_WIDTH, 3.9))
        axes = drawing.add_axes((0.155, 0.205, 0.825, 0.735))
        factor, unit = _length_unit(places(problem, problem.u0))
        labelled = len(problem.points) <= _MOST_LABELS
        draw_mechanism(axes, problem, u, factor, labelled)
        if labelled:
            drawing.legend(
                handles=_key(problem.drawing),
                loc="lower center",
                ncols=3,
                handlelength=1.5,
                fontsize=6.5,
                columnspacing=1.5,
            )
        axes.set_aspect("equal")
        axes.margins(0.1)
        axes.set_xlabel(f"$x$ ({unit})")
        axes.set_ylabel(f"$y$ ({unit})")
        axes.set_title(title)
    return drawing


def _length_unit(positions: Mapping[str, complex]) -> tuple[float, str]:
    """Millimetres for what is a hand wide, metres otherwise."""
    width = _extent(positions)
    return (1e3, "mm") if width < 0.5 else (1.0, "m")


def _extent(positions: Mapping[str, complex]) -> float:
    values = list(positions.values())
    spans = (np.ptp([p.real for p in values]), np.ptp([p.imag for p in values]))
    return float(max(spans)) or 1.0


def draw_mechanism(
    axes: Any, problem: Problem, u: Array, factor: float, labelled: bool = True
) -> None:
    """Draw a mechanism at position u into axes, lengths multiplied by ``factor``."""
    mechanism: Mechanism = problem.drawing
    points = {name: factor * place for name, place in places(problem, u).items()}
    size = factor * _extent(places(problem, problem.u0))
    if labelled:
        for name in mechanism.bodies:
            _body(axes, mechanism, name, points)
            _body_label(axes, mechanism, name, points, size)
    else:
        for body in mechanism.bodies.values():
            _line(axes, [points[body.from_], points[body.to]], color="#0072B2", linewidth=0.8)
    for bar in mechanism.bars.values():
        _line(
            axes,
            [points[bar.from_], points[bar.to]],
            color="black",
            linewidth=1.6 if labelled else 0.6,
        )
    for slider in mechanism.sliders.values():
        _guide(axes, points[slider.point], complex(*slider.direction), 0.12 * size)
    for spring in mechanism.springs.values():
        _line(
            axes,
            _zigzag(points[spring.from_], points[spring.to], 0.018 * size),
            color="#009E73",
            linewidth=0.9,
        )
    sprung = [{spring.from_, spring.to} for spring in mechanism.springs.values()]
    for damper in mechanism.dampers.values():
        start, end = points[damper.from_], points[damper.to]
        beside = 0.045 * size if {damper.from_, damper.to} in sprung else 0.0
        shift = beside * 1j * (end - start) / abs(end - start)
        _damper(axes, start + shift, end + shift, 0.02 * size)
    for torque in mechanism.torques.values():
        _torque(axes, points[mechanism.bodies[torque.on].from_], 0.11 * size, torque.torque)
    for name, place in points.items():
        fixed = name in mechanism.points and mechanism.points[name].fixed is not None
        if fixed:
            _ground(axes, place, 0.03 * size)
        if labelled or fixed:
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
        if labelled:
            _joint_label(axes, mechanism, name, points)


def _key(mechanism: Mechanism) -> list[Line2D]:
    """What the symbols mean, as handles of a legend."""

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
    if mechanism.dampers:
        handles.append(Line2D([], [], label="damper", color="#CC79A7"))
    if mechanism.sliders:
        handles.append(Line2D([], [], label="guide", color="0.4", linewidth=3, alpha=0.35))
    if mechanism.torques:
        handles.append(Line2D([], [], label="torque, driven body", color="#D55E00", linewidth=2))
    return handles


def places(problem: Problem, u: Array) -> dict[str, complex]:
    """Positions of all points of a mechanism at u, as x + iy (m)."""
    mechanism: Mechanism = problem.drawing
    found = {
        name: complex(*point.fixed)
        for name, point in mechanism.points.items()
        if point.fixed is not None
    }
    found |= {name: complex(*u[2 * i : 2 * i + 2]) for i, name in enumerate(problem.points)}
    for name, point in mechanism.body_points.items():
        body = mechanism.bodies[point.on]
        along = (found[body.to] - found[body.from_]) / body.length
        found[name] = found[body.from_] + complex(*point.at) * along
    return {name: found[name] for name in (*mechanism.points, *mechanism.body_points)}


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
    align = "center"
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
        across = (place - (start + end) / 2).real / (0.04 * size)
        align = "left" if across > 0.5 else "right" if across < -0.5 else "center"
        nearer = (start + end) / 2 + 0.55 * (place - (start + end) / 2)
        place = nearer if align != "center" else place
    axes.text(place.real, place.imag, name, color="#0072B2", fontsize=6, ha=align, va="center")


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


def _guide(axes: Any, place: complex, direction: complex, half: float) -> None:
    along = half * direction / abs(direction)
    _line(axes, [place - along, place + along], color="0.4", linewidth=3, alpha=0.35, zorder=1)


def _damper(axes: Any, start: complex, end: complex, width: float) -> None:
    along = (end - start) / abs(end - start)
    middle, side = (start + end) / 2, width * along * 1j
    look = {"color": "#CC79A7", "linewidth": 0.9}
    _line(axes, [start, middle], **look)
    _line(axes, [middle - 0.7 * side, middle + 0.7 * side], **look)
    cup = [middle + 1.5 * width * along - side, middle + 1.5 * width * along + side]
    _line(
        axes,
        [middle - 0.5 * width * along - side, cup[0], cup[1], middle - 0.5 * width * along + side],
        **look,
    )
    _line(axes, [middle + 1.5 * width * along, end], **look)


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


def animation(title: str, problem: Problem, positions: Sequence[Array], stem: Path) -> Path:
    """Write a looping GIF of a mechanism.

    Args:
        title: Title of every frame.
        problem: A problem that is a planar mechanism.
        positions: (n,) position of each frame.
        stem: File.

    Returns:
        The file.
    """
    with mpl.rc_context(_STYLE | {"xtick.top": False, "ytick.right": False}):
        drawing = Figure(figsize=(_WIDTH, 3.5), dpi=110)
        axes = drawing.add_axes((0.155, 0.11, 0.825, 0.83))
        factor, unit = _length_unit(places(problem, problem.u0))
        everywhere = [factor * p for u in positions for p in places(problem, u).values()]
        corners = [part(p) for part in (np.real, np.imag) for p in everywhere]
        half = len(everywhere)
        frames = []
        for u in positions:
            axes.clear()
            axes.set_aspect("equal")
            draw_mechanism(axes, problem, u, factor, labelled=False)
            for limits, values in (
                (axes.set_xlim, corners[:half]),
                (axes.set_ylim, corners[half:]),
            ):
                margin = 0.08 * factor * _extent(places(problem, problem.u0))
                limits(min(values) - margin, max(values) + margin)
            axes.set_xlabel(f"$x$ ({unit})")
            axes.set_ylabel(f"$y$ ({unit})")
            axes.set_title(title)
            content = io.BytesIO()
            drawing.savefig(content, format="png", dpi=110)
            frames.append(Image.open(content).convert("P", palette=Image.Palette.ADAPTIVE))
    content = io.BytesIO()
    frames[0].save(
        content, format="GIF", save_all=True, append_images=frames[1:], duration=40, loop=0
    )
    write_atomically(stem, content.getvalue())
    return stem
