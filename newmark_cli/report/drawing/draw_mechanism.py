"""Drawing of mechanisms: bodies, joints, ground, springs, dampers, torques."""

import io
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

# isort: split
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Polygon
from PIL import Image

from newmark_cli.mechanisms.models import Mechanism
from newmark_cli.mechanisms.parts import PARTS
from newmark_cli.mechanisms.sketch import (
    Arrow,
    Coil,
    Dashpot,
    Disc,
    Mark,
    Scene,
    Spiral,
    Stroke,
    Turn,
)
from newmark_cli.report.drawing import draw_spatial
from newmark_cli.report.drawing.draw import drawn, plain
from newmark_cli.report.drawing.panels import WIDTH, Panel, Sheet
from newmark_cli.report.drawing.strokes import damper, line, zigzag
from newmark_cli.report.drawing.style import settled
from newmark_cli.support.arrays import Array
from newmark_cli.support.files import write_output

#: Moving points up to which a mechanism is drawn with all its names and symbols.
_MOST_LABELS = 30

#: No ticks above a mechanism and right of it.
_WITHOUT_TICKS = {"xtick.top": False, "ytick.right": False}


class Drawable(Protocol):
    """Attributes of a problem that is drawn."""

    @property
    def drawing(self) -> Any:
        """The `Mechanism`."""

    @property
    def points(self) -> tuple[str, ...]:
        """Its moving points."""

    @property
    def axes(self) -> str:
        """Names of the coordinates of each of them."""

    @property
    def u0(self) -> Array:
        """(n,) initial coordinates."""


@dataclass(frozen=True, eq=False)
class MechanismScene:
    """A mechanism at a position, with a key to its symbols while it has room for names.

    Attributes:
        problem: A problem that is a mechanism.
        u: (n,) position.
    """

    problem: Drawable
    u: Array

    @property
    def labelled(self) -> bool:
        """Whether points and bodies have their names."""
        return len(self.problem.points) <= _MOST_LABELS * (2 if is_spatial(self.problem) else 1)

    def draw(self, axes: Any) -> None:
        """Draw it, lengths in the unit of the labels."""
        factor, _ = _length_unit(places(self.problem, self.problem.u0))
        draw_mechanism(axes, self.problem, self.u, factor, self.labelled)

    def handles(self) -> list[Line2D]:
        """Legend of the symbols."""
        if not self.labelled:
            return []
        if is_spatial(self.problem):
            known = draw_spatial.symbols(self.problem.drawing)
            return [Line2D([], [], label=label, **look) for label, look in known.items()]
        return _key(self.problem.drawing, _marks(_scene(self.problem, self.u, 1.0)))


def is_spatial(problem: Drawable) -> bool:
    """Whether a problem is a spatial mechanism."""
    return len(problem.axes) == 3


def _axis_labels(problem: Drawable) -> tuple[str, str]:
    """Labels of the axes; a spatial mechanism shows the directions of its own."""
    if is_spatial(problem):
        released = getattr(problem, "released", ())
        # The key of the drawing has no room for what is not drawn.
        return (plain(f"redundant, dropped: {', '.join(released)}") if released else ""), ""
    _, unit = _length_unit(places(problem, problem.u0))
    return f"$x$ ({unit})", f"$y$ ({unit})"


def mechanism_sheet(title: str, problem: Drawable, u: Array) -> Sheet:
    """A mechanism at a position: bodies, joints, ground, springs, dampers, torques.

    Args:
        title: Title of the figure.
        problem: A problem that is a mechanism.
        u: (n,) position.
    """
    x_label, y_label = _axis_labels(problem)
    return Sheet(
        title,
        (
            Panel(
                (),
                x_label,
                y_label,
                x_scale="linear",
                y_scale="linear",
                scene=MechanismScene(problem, u),
            ),
        ),
        grid=False,
        settings=_WITHOUT_TICKS
        | {
            "legend.fontsize": 6.5,
            "legend.handlelength": 1.5,
            "legend.borderpad": 0.4,
            "legend.columnspacing": 1.5,
        },
    )


def mechanism_figure(title: str, problem: Drawable, u: Array) -> Figure:
    """The same, drawn."""
    return drawn(mechanism_sheet(title, problem, u))


def _length_unit(positions: Mapping[str, complex]) -> tuple[float, str]:
    """Millimetres for what is a hand wide, metres otherwise."""
    width = _extent(positions)
    return (1e3, "mm") if width < 0.5 else (1.0, "m")


def _extent(positions: Mapping[str, complex]) -> float:
    values = list(positions.values())
    spans = (np.ptp([p.real for p in values]), np.ptp([p.imag for p in values]))
    return float(max(spans)) or 1.0


def _scene(problem: Drawable, u: Array, factor: float) -> Scene:
    """A planar mechanism at a position u, lengths multiplied by ``factor``."""
    begin = places(problem, problem.u0)
    here, there = (
        {name: factor * place for name, place in found.items()}
        for found in (places(problem, u), begin)
    )
    start = Scene(problem.drawing, there, factor * _extent(begin), factor)
    return replace(start, points=here, start=start)


def _marks(scene: Scene) -> list[Mark]:
    """Shapes of its parts."""
    return [
        mark
        for key, part in PARTS.items()
        for one in getattr(scene.mechanism, key).values()
        for mark in part.sketch(scene, one)
    ]


def draw_mechanism(
    axes: Any, problem: Drawable, u: Array, factor: float, labelled: bool = True
) -> None:
    """Draw a mechanism at position u into axes, lengths multiplied by ``factor``."""
    if is_spatial(problem):
        size = factor * _extent(places(problem, problem.u0))
        draw_spatial.draw(axes, problem, u, factor, size, labelled)
        return
    scene = _scene(problem, u, factor)
    mechanism, points, size = scene.mechanism, scene.points, scene.size
    if labelled:
        for name in mechanism.bodies:
            _body(axes, mechanism, name, points)
            _body_label(axes, mechanism, name, points, size)
    else:
        for name, body in mechanism.bodies.items():
            color = "#D55E00" if _is_driven(mechanism, name) else "#0072B2"
            line(axes, [points[body.from_], points[body.to]], color=color, linewidth=0.8)
    for mark in _marks(scene):
        _draw_mark(axes, mark, size, labelled)
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


#: Symbol → how its line looks in the key, for those that have an entry there.
_LOOKS: dict[str, dict[str, Any]] = {
    "spring": {"label": "spring", "color": "#009E73"},
    "damper": {"label": "damper", "color": "#CC79A7"},
    "guide": {"label": "guide", "color": "0.4", "linewidth": 3, "alpha": 0.35},
    "torque": {"label": "torque, driven body", "color": "#D55E00", "linewidth": 2},
    "force": {"label": "force", "color": "#D55E00", "linewidth": 1},
    "wheel": {"label": "wheel", "color": "#0072B2", "linewidth": 0.7},
}


def _key(mechanism: Mechanism, marks: Sequence[Mark]) -> list[Line2D]:
    """Handles of a legend of the symbols."""

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
    # In the order of the key, each once.
    looks = [_LOOKS[symbol] for symbol in _LOOKS if symbol in {mark.symbol for mark in marks}]
    handles += [Line2D([], [], **look) for look in looks]
    return handles


def places(problem: Drawable, u: Array) -> dict[str, complex]:
    """Positions of all points of a mechanism at u, as x + iy (m); of one in space projected."""
    if is_spatial(problem):
        return draw_spatial.places(problem, u)
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


def _is_driven(mechanism: Mechanism, body: str) -> bool:
    return body in {torque.on for torque in mechanism.torques.values()}


def _body(axes: Any, mechanism: Mechanism, name: str, points: Mapping[str, complex]) -> None:
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
    driven = _is_driven(mechanism, name)
    color, width, order = ("#D55E00", 3.2, 3) if driven else ("#0072B2", 1.8, 2)
    line(axes, [start, end], color=color, linewidth=width, solid_capstyle="round", zorder=order)
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
    axes: Any, mechanism: Mechanism, name: str, points: Mapping[str, complex], size: float
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
    axes.text(
        place.real, place.imag, plain(name), color="#0072B2", fontsize=6, ha=align, va="center"
    )


def _joint_label(axes: Any, mechanism: Mechanism, name: str, points: Mapping[str, complex]) -> None:
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
        plain(name),
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
        line(axes, [start, start + complex(-0.35, -0.45) * size], color="black", linewidth=0.5)


def _draw_mark(axes: Any, mark: Mark, size: float, labelled: bool) -> None:
    """Draw what a part looks like; thin lines without labels, where there are many."""
    match mark:
        case Stroke(ends, "guide"):
            line(axes, ends, color="0.4", linewidth=3, alpha=0.35, zorder=1)
        case Stroke(ends):
            line(axes, ends, color="black", linewidth=1.6 if labelled else 0.6)
        case Coil(start, end):
            line(axes, zigzag(start, end, 0.018 * size), color="#009E73", linewidth=0.9)
        case Dashpot(start, end):
            damper(axes, start, end, 0.02 * size)
        case Turn(centre, radius, sign):
            _torque(axes, centre, radius, sign)
        case Spiral(centre, radius, True):
            turn = np.exp(1j * np.linspace(0.3, 5.4, 40))
            line(axes, centre + radius * turn, color="#CC79A7", linewidth=0.9)
        case Spiral(centre, radius):
            angle = np.linspace(0, 5 * np.pi, 120)
            wound = centre + radius * (0.15 + 0.85 * angle / angle[-1]) * np.exp(1j * angle)
            line(axes, wound, color="#009E73", linewidth=0.9)
        case Disc(centre, radius, towards):
            rim = centre + radius * np.exp(1j * np.linspace(0, 2 * np.pi, 73))
            line(axes, rim, color="#0072B2", linewidth=0.7, zorder=1)
            if towards:
                mark_on_rim = [centre + 0.8 * radius * towards, centre + radius * towards]
                line(axes, mark_on_rim, color="#0072B2", linewidth=1.4, zorder=1)
        case Arrow(tip, towards, length):
            _arrow(axes, tip - length * towards, tip, 1.0)


def _arrow(axes: Any, back: complex, tip: complex, width: float) -> None:
    axes.annotate(
        "",
        xy=(tip.real, tip.imag),
        xytext=(back.real, back.imag),
        arrowprops={
            "arrowstyle": "-|>",
            "color": "#D55E00",
            "linewidth": width,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 8,
        },
    )


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
    _arrow(axes, back, tip, 1.0)


def animation(
    titles: Sequence[str], problem: Drawable, positions: Sequence[Array], stem: Path
) -> Path:
    """Write a looping GIF of a mechanism.

    Args:
        titles: Title of each frame.
        problem: A problem that is a mechanism.
        positions: (n,) position of each frame.
        stem: File.

    Returns:
        The file.
    """
    with settled(_WITHOUT_TICKS):
        drawing = Figure(figsize=(WIDTH, 3.5), dpi=110)
        axes = drawing.add_axes((0.155, 0.11, 0.825, 0.83))
        factor, _ = _length_unit(places(problem, problem.u0))
        x_label, y_label = _axis_labels(problem)
        everywhere = [factor * p for u in positions for p in places(problem, u).values()]
        corners = [part(p) for part in (np.real, np.imag) for p in everywhere]
        half = len(everywhere)
        frames = []
        for title, u in zip(titles, positions, strict=True):
            axes.clear()
            axes.set_aspect("equal")
            draw_mechanism(axes, problem, u, factor, labelled=False)
            for limits, values in (
                (axes.set_xlim, corners[:half]),
                (axes.set_ylim, corners[half:]),
            ):
                margin = 0.08 * factor * _extent(places(problem, problem.u0))
                limits(min(values) - margin, max(values) + margin)
            axes.set_xlabel(x_label)
            axes.set_ylabel(y_label)
            axes.set_title(plain(title))
            content = io.BytesIO()
            drawing.savefig(content, format="png", dpi=110)
            frames.append(Image.open(content).convert("P", palette=Image.Palette.ADAPTIVE))
    content = io.BytesIO()
    frames[0].save(
        content, format="GIF", save_all=True, append_images=frames[1:], duration=40, loop=0
    )
    write_output(stem, content.getvalue())
    return stem
