"""Drawing of mechanisms: what `newmark_cli.report.drawing.sketch` sees, its key, and names."""

import io
import itertools
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from PIL import Image

from newmark_cli.problems.problem import Problem
from newmark_cli.report.drawing.panels import WIDTH, Panel, Sheet, plain
from newmark_cli.report.drawing.sketch import Mark, Scene, is_spatial, marks, scene
from newmark_cli.report.drawing.style import settled
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import InputError
from newmark_cli.support.files import write_output
from newmark_cli.support.spelling import nearest

#: Moving points, or vectors of bodies, up to which a mechanism is drawn with names and symbols.
_MOST_LABELS = {False: 30, True: 60}
#: No ticks above a mechanism and right of it.
_WITHOUT_TICKS = {"xtick.top": False, "ytick.right": False}
#: A small key.
_KEY = {
    "legend.fontsize": 6.5,
    "legend.handlelength": 1.5,
    "legend.borderpad": 0.4,
    "legend.columnspacing": 1.5,
}

#: Of names: how wide a letter is, for its size; how far they are from their place (points), and on
#: which sides, the first ones where all are alike; and where on a body.
_WIDE, _AWAY = 0.62, (5.0, 9.0)
_AROUND = [math.radians(angle) for angle in (90, 0, 180, 270, 45, 135, 225, 315, 22, 158, 202, 338)]
_SHARES = (0.5, 0.35, 0.65, 0.2, 0.8)
#: What a later choice costs, in points of lines that a name covers; where a name hides others.
_LATER, _GRID = 0.02, np.linspace(-1, 1, 9)
#: A sign is as large as a small circle.
_SIGN_AROUND = np.exp(2j * math.pi * np.arange(8) / 8)
#: Around names, so that they can be read where lines cross them.
_HALO = [withStroke(linewidth=1.6, foreground="white")]
_BLUE, _RED, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
_SIGN = {"linestyle": "none", "marker": "o", "color": "black", "markersize": 3.7, "zorder": 5,
         "markeredgewidth": 0.8}  # fmt: skip
_HOLLOW = {**_SIGN, "markerfacecolor": "white"}
#: Symbol → how it looks, those of the key first, by the names that they have there.
_LOOKS: dict[str, dict[str, Any]] = {
    "fixed point": _SIGN,
    "joint": _HOLLOW,
    "joint to the ground": _SIGN,
    "joint that slides": {**_HOLLOW, "marker": "s"},
    "axis": {"color": _RED, "linewidth": 1.1, "zorder": 4},
    "mass centre": {**_SIGN, "marker": "+", "color": _RED, "zorder": 6, "path_effects": _HALO},
    "point": {**_SIGN, "marker": "x", "zorder": 6},
    "spring": {"color": _GREEN, "linewidth": 0.9, "zorder": 3},
    "damper": {"color": _PURPLE, "linewidth": 0.9, "zorder": 3},
    "guide": {"color": "0.4", "linewidth": 3, "alpha": 0.35, "zorder": 1},
    "driven body": {"color": _RED, "linewidth": 3.2, "solid_capstyle": "round", "zorder": 3},
    "torque": {"color": _RED, "linewidth": 1, "zorder": 7},
    "force": {"color": _RED, "linewidth": 1, "zorder": 7},
    "motion": {"color": "black", "linewidth": 1, "zorder": 7},
    "wheel": {"color": _BLUE, "linewidth": 0.7, "zorder": 1},
    "path": {"linewidth": 1.1, "zorder": 1},
    "body": {"color": _BLUE, "linewidth": 1.9, "solid_capstyle": "round", "zorder": 2},
    "bar": {"color": "black", "linewidth": 1.6, "zorder": 2},
    "edge": {"color": _BLUE, "linewidth": 0.4, "alpha": 0.5, "zorder": 1},
    "open joint": {"color": "black", "linewidth": 0.6, "linestyle": ":", "zorder": 1},
    "hatch": {"color": "black", "linewidth": 0.5, "zorder": 2},
    "outline": {"facecolor": "#56B4E940", "edgecolor": _BLUE, "linewidth": 0.7, "zorder": 1},
    "ground": {"facecolor": "white", "edgecolor": "black", "linewidth": 0.7, "zorder": 3},
}
#: Symbols in the key, and those that a large mechanism is drawn without.
_IN_KEY = tuple(_LOOKS)[: tuple(_LOOKS).index("path")]
#: Colours of paths, in turn.
_PATHS = ("#E69F00", "#56B4E9", "black", "0.5")
_DETAILS = ("joint", "joint that slides", "mass centre", "point", "edge", "outline")


def _axis_labels(problem: Problem) -> tuple[str, str]:
    """Labels of the axes; spatial mechanisms draw their own triad instead."""
    if is_spatial(problem):
        # The key of the drawing has no room for what is not drawn.
        released = ", ".join(problem.released)
        return (plain(f"redundant, dropped: {released}") if released else ""), ""
    _, unit = _length_unit(problem)
    return f"$x$ ({unit})", f"$y$ ({unit})"


def paths(problem: Problem, names: Sequence[str], positions: Sequence[Array]) -> dict[str, Array]:
    """Name of a point → (k,) where it is drawn at positions (n,) along a motion.

    Raises:
        InputError: When the mechanism has no such point.
    """
    factor, _ = _length_unit(problem)
    seen = [scene(problem, u, factor).points for u in positions]
    for name in names:
        if name not in seen[0]:
            raise InputError(f"--path: unknown point {name!r}{nearest(name, seen[0])}")
    return {name: np.array([at[name] for at in seen]) for name in names}


def mechanism_sheet(
    title: str, problem: Problem, u: Array, paths: Mapping[str, Array] = MappingProxyType({})
) -> Sheet:
    """A mechanism at position u (n,): bodies, joints, ground, springs, and `paths` of points."""
    labelled = len(problem.points) <= _MOST_LABELS[is_spatial(problem)]
    scene = partial(draw_mechanism, problem=problem, u=u, labelled=labelled, paths=paths)
    labels = _axis_labels(problem)
    panel = Panel(
        (), *labels, x_scale="linear", y_scale="linear", scene=scene,
        names=partial(_write_names, problem=problem, u=u) if labelled else None,
    )  # fmt: skip
    return Sheet(title, (panel,), grid=False, settings={**_WITHOUT_TICKS, **_KEY})


def _length_unit(problem: Problem) -> tuple[float, str]:
    """Millimetres for a mechanism of less than half a metre, metres otherwise."""
    return (1e3, "mm") if scene(problem, problem.u0).size < 0.5 else (1.0, "m")


def draw_mechanism(
    axes: Any, problem: Problem, u: Array, labelled: bool = True,
    paths: Mapping[str, Array] = MappingProxyType({}),
) -> list[Line2D]:  # fmt: skip
    """Draw a mechanism at position u into axes, lengths in the unit of their labels.

    Without details and names unless labelled.  Returns the key to its symbols and paths.
    """
    factor, unit = _length_unit(problem)
    here = scene(problem, u, factor)
    ways = [
        Mark("path", places, {"color": color})
        for places, color in zip(paths.values(), itertools.cycle(_PATHS))
    ]
    key = [
        Line2D([], [], label=f"path of {plain(name)}", **_LOOKS["path"], **way.look)
        for name, way in zip(paths, ways, strict=True)
    ]
    seen = [mark for mark in marks(here) if labelled or mark.symbol not in _DETAILS]
    seen += ways
    for mark in seen:
        _draw(axes, mark, 1 if labelled else 0.5)
    if is_spatial(problem):
        axes.tick_params(left=False, bottom=False, labelleft=False, labelbottom=False)
    if not labelled:
        return key
    if is_spatial(problem):
        _triad(axes, here, unit)
    symbols = {mark.symbol for mark in seen}
    return [Line2D([], [], label=name, **_LOOKS[name]) for name in _IN_KEY if name in symbols] + key


def _draw(axes: Any, mark: Mark, thin: float) -> None:
    look = {**_LOOKS[mark.symbol], **mark.look}
    x, y = np.real(mark.places), np.imag(mark.places)
    if look.pop("arrow", False):
        head = {"arrowstyle": "-|>", "color": look["color"], "linewidth": 1, "shrinkA": 0,
                "shrinkB": 0, "mutation_scale": 8}  # fmt: skip
        axes.annotate("", (x[1], y[1]), (x[0], y[0]), arrowprops=head, zorder=look["zorder"])
    elif "facecolor" in look:
        axes.fill(x, y, **look)
    else:
        if mark.symbol in ("body", "bar", "driven body"):
            look["linewidth"] *= thin
        axes.plot(x, y, **look)


def _triad(axes: Any, scene: Scene, unit: str) -> None:
    """Draw the global axes, of a round length, in an empty corner, or else below the mechanism."""
    spots, size = np.array(scene.places), scene.size
    length = 10.0 ** math.floor(math.log10(0.2 * size))
    length *= max(step for step in (1, 2, 5) if step * length <= 0.2 * size)
    arms = np.array(scene.frames[""][1:]) / scene.factor
    tips = np.append((length + 0.035 * size) * arms, -0.1j * size)
    corners = [
        complex(side(spots.real) - side(tips.real), end(spots.imag) - end(tips.imag))
        for side in (np.min, np.max) for end in (np.min, np.max)
    ]  # fmt: skip
    drawn = np.concatenate([_along(mark.places, 0.02 * size) for mark in marks(scene)])
    rooms = [np.abs(drawn - at - tips.mean()).min() for at in corners]
    origin = corners[int(np.argmax(rooms))]
    if max(rooms) < np.abs(tips - tips.mean()).max() + 0.06 * size:
        origin = complex(spots.real.min(), spots.imag.min() - tips.imag.max() - 0.06 * size)
        # Nothing to see: room for what stands at the edges.
        axes.plot(origin.real - 0.1 * size, origin.imag - 0.14 * size, alpha=0)
    look: dict[str, Any] = {"color": "0.35", "ha": "center"}
    for letter, arm, tip in zip("xyz", arms, origin + tips, strict=False):
        end_of = origin + length * arm
        axes.plot([origin.real, end_of.real], [origin.imag, end_of.imag],
                  color="0.35", linewidth=0.8)  # fmt: skip
        axes.text(tip.real, tip.imag, f"${letter}$", fontsize=7, va="center", **look)
    below = origin - 0.075j * size
    axes.text(below.real, below.imag, f"{length:g} {unit}", fontsize=6, va="top", **look)


def _write_names(axes: Any, problem: Problem, u: Array) -> None:
    """Write names of joints, bodies and points, each where it covers least."""
    here = scene(problem, u, _length_unit(problem)[0])
    bold: dict[str, Any] = {"fontsize": 8, "fontweight": "bold"}
    spatial = hasattr(here.mechanism, "joints")
    joints = [(name, [ends[1]], bold) for name, ends in here.joints.items()]
    points = [(name, [at], {"fontsize": 6} if spatial else bold)
              for name, at in here.points.items()]  # fmt: skip
    bodies: list[tuple[str, list[complex], dict[str, Any]]] = []
    for name in here.mechanism.bodies:
        ends, blue = here.ends(name), {"fontsize": 6, "color": _BLUE}
        middle = here.centre(name) if spatial else sum(ends) / len(ends)
        along = [ends[0] + share * (ends[1] - ends[0]) for share in _SHARES if not spatial]
        bodies.append((name, [middle, *along], blue))
    limits = np.array([axes.get_xlim(), axes.get_ylim()])
    # How long a point of a font (1/72 in) is in the lengths of a drawing.
    inches = axes.get_window_extent().width / axes.get_figure(root=True).dpi
    unit = float(np.ptp(limits[0])) / (72 * inches)
    seen = [mark for mark in marks(here) if mark.symbol != "edge"]
    lines = [_along(mark.places, 2 * unit) for mark in seen]
    signs = [mark.places for mark in seen if len(mark.places) == 1]
    lines += [np.add(place, 2.5 * unit * turn) for place in signs for turn in _SIGN_AROUND]
    there, taken = np.concatenate(lines), [np.empty((0, 2))]
    for given, places, look in (*joints, *bodies, *points) if spatial else (*points, *bodies):
        name = plain(given)
        half = unit * look["fontsize"] * np.array([_WIDE * len(name) / 2, 0.45])
        centres = np.array([
            (place.real + math.cos(angle) * (away * unit + half[0]),
             place.imag + math.sin(angle) * (away * unit + half[1]))
            for place in places for away in _AWAY for angle in _AROUND
        ])  # fmt: skip
        lines_at = np.stack([there.real, there.imag], axis=-1)
        covered = np.all(np.abs(lines_at - centres[:, None]) < half + 1.5 * unit, axis=-1).sum(1)
        names_at = np.concatenate(taken)
        hidden = np.all(np.abs(names_at - centres[:, None]) < half + 2 * unit, axis=-1).sum(1)
        outside = ((centres - half < limits[:, 0]) | (centres + half > limits[:, 1])).sum(1)
        cost = covered + 5 * hidden + 50 * outside + _LATER * np.arange(len(centres))
        best = int(np.argmin(cost))
        at = centres[best]
        taken.append(at + half * np.array([(x, y) for x in _GRID for y in (-1, 0, 1)]))
        place = places[best // (len(_AWAY) * len(_AROUND))]
        offset = (at - [place.real, place.imag]) / unit
        axes.annotate(
            name, (place.real, place.imag), textcoords="offset points", xytext=tuple(offset),
            ha="center", va="center", zorder=8, path_effects=_HALO, **look,
        )  # fmt: skip


def _along(places: Any, step: float) -> Array:
    """Points on a polyline, at most a step apart."""
    parts = [np.asarray(places)]
    for start, end in itertools.pairwise(places):
        share = np.linspace(0, 1, math.ceil(abs(end - start) / step) + 1)
        parts.append(start + share * (end - start))
    return np.concatenate(parts)


def animation(
    titles: Sequence[str], problem: Problem, positions: Sequence[Array], stem: Path
) -> Path:
    """Write a looping GIF of a mechanism, a title and a position (n,) for each frame."""
    with settled(_WITHOUT_TICKS):
        drawing = Figure(figsize=(WIDTH, 3.5), dpi=110)
        axes = drawing.add_axes((0.155, 0.11, 0.825, 0.83))
        factor, _ = _length_unit(problem)
        x_label, y_label = _axis_labels(problem)
        everywhere = np.array([p for u in positions for p in scene(problem, u, factor).places])
        margin = 0.08 * scene(problem, problem.u0, factor).size
        frames = []
        for title, u in zip(titles, positions, strict=True):
            axes.clear()
            axes.set_aspect("equal")
            draw_mechanism(axes, problem, u, labelled=False)
            axes.set_xlim(everywhere.real.min() - margin, everywhere.real.max() + margin)
            axes.set_ylim(everywhere.imag.min() - margin, everywhere.imag.max() + margin)
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
