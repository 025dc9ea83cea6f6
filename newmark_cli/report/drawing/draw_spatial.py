"""Drawing of spatial mechanisms, in one fixed oblique view without perspective.

What is against gravity points up. Everything is projected onto the plane of the paper, where
places are x + iy, and drawn by the strokes of planar mechanisms.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.mechanisms.models import size_of
from newmark_cli.report.drawing.draw import plain
from newmark_cli.report.drawing.strokes import damper, line, zigzag
from newmark_cli.support.arrays import Array

if TYPE_CHECKING:
    from newmark_cli.mechanisms.spatial import SpatialModel

_BLUE, _RED, _GREEN = "#0072B2", "#D55E00", "#009E73"
#: From where one looks: about the upright, and above the level (rad).
_AZIMUTH, _ELEVATION = math.radians(-58), math.radians(20)

#: What a key may explain: label → how it looks.
Symbols = Mapping[str, Mapping[str, Any]]


def view(model: "SpatialModel") -> Array:
    """(3,) complex: a vector of three components times it is its place on the paper."""
    gravity = np.array(model.mechanism.gravity)
    up = int(np.argmax(np.abs(gravity))) if np.any(gravity) else 2
    side, depth = (up + 1) % 3, (up + 2) % 3
    found = np.zeros(3, complex)
    found[side] = complex(-math.sin(_AZIMUTH), -math.sin(_ELEVATION) * math.cos(_AZIMUTH))
    found[depth] = complex(math.cos(_AZIMUTH), -math.sin(_ELEVATION) * math.sin(_AZIMUTH))
    found[up] = 1j * math.cos(_ELEVATION)
    return found


def places(problem: Any, u: Array) -> dict[str, complex]:
    """Places on the paper of all that a drawing shows: centres, joints, points, corners (m)."""
    model: SpatialModel = problem.drawing
    seen, bodies = view(model), u.reshape(-1, 4, 3)
    found: dict[str, complex] = {}
    for i, (name, body) in enumerate(model.mechanism.bodies.items()):
        found[f"body {name}"] = complex(_at(bodies[i], body.centre) @ seen)
        if body.box is not None:
            corners = _corners(bodies[i], body.centre, body.box)
            found |= {f"corner {name} {k}": complex(at @ seen) for k, at in enumerate(corners)}
    for name, joint in model.joints.items():
        for k, side in enumerate(joint.sides):
            found[f"joint {name} {k}"] = complex(side.place(bodies) @ seen)
    for name, point in model.points.items():
        found[f"point {name}"] = complex(point.place(bodies) @ seen)
    return found


def _at(body: Array, place: Sequence[float]) -> Array:
    """(3,) global place of body coordinates, from origin and directors (4, 3)."""
    return np.asarray(body[0] + np.asarray(place) @ body[1:])


def _corners(body: Array, centre: Sequence[float], box: Sequence[float]) -> list[Array]:
    """Corners of a box, the last axis running first."""
    halves = [
        (a * box[0] / 2, b * box[1] / 2, c * box[2] / 2)
        for a in (-1, 1)
        for b in (-1, 1)
        for c in (-1, 1)
    ]
    return [_at(body, np.add(centre, half).tolist()) for half in halves]


#: Corners of a box that an edge joins.
_EDGES = tuple((i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit)


def draw(axes: Any, problem: Any, u: Array, factor: float, size: float, labelled: bool) -> None:
    """Draw a spatial mechanism at position u into axes.

    Args:
        axes: Axes of a figure.
        problem: A problem that is a spatial mechanism.
        u: (n,) position.
        factor: All lengths are multiplied by it.
        size: Extent of the drawing, times the factor.
        labelled: Whether bodies, joints and points have their names.
    """
    model: SpatialModel = problem.drawing
    mechanism, seen, bodies = model.mechanism, view(model), u.reshape(-1, 4, 3)
    at = {name: factor * place for name, place in places(problem, u).items()}
    axes.tick_params(left=False, bottom=False, labelleft=False, labelbottom=False)
    for name, body in mechanism.bodies.items():
        if body.box is not None and labelled:
            for i, j in _EDGES:
                ends = [at[f"corner {name} {i}"], at[f"corner {name} {j}"]]
                line(axes, ends, color=_BLUE, linewidth=0.4, alpha=0.5, zorder=1)
        for end in _ends(model, name):
            line(
                axes,
                [at[f"body {name}"], at[end]],
                color=_BLUE,
                linewidth=2.0 if labelled else 1.0,
                solid_capstyle="round",
                zorder=2,
            )
        if labelled:
            _mark(axes, at[f"body {name}"], "+", _RED)
    _struts(axes, model, at, size)
    for name, joint in model.joints.items():
        for axis in ("n", "a", "b"):
            for side in joint.sides:
                # The axis of the second body shows where it is not that of the first.
                if axis in side.vectors and (axis != "n" or side is joint.sides[0]):
                    along = complex(side.direction(axis, bodies) @ seen) * 0.055 * size
                    middle = factor * complex(side.place(bodies) @ seen)
                    ends = [middle - along, middle + along]
                    line(axes, ends, color=_RED, linewidth=1.1, zorder=4)
        first, second = (at[f"joint {name} {k}"] for k in range(2))
        if abs(second - first) > 1e-9 * size:
            thick = 1.4 if joint.kind == "distance" else 0.6
            style = "-" if joint.kind == "distance" else ":"
            line(axes, [first, second], color="black", linewidth=thick, linestyle=style, zorder=1)
        grounded = min(side.body for side in joint.sides) < 0
        if labelled or grounded:
            for place in dict.fromkeys((first, second)):
                face = "black" if grounded else "white"
                axes.plot(
                    place.real, place.imag, _MARKERS.get(joint.kind, "o"), color="black",
                    markersize=3.8, zorder=5, markerfacecolor=face, markeredgewidth=0.8,
                )  # fmt: skip
    for name in model.points:
        if labelled:
            _mark(axes, at[f"point {name}"], "x", "black")
    _loads(axes, model, at, seen, bodies, size)
    if labelled:
        _triad(axes, at, seen, size, factor)
        _labels(axes, model, at, size)


#: Joints that turn are circles, those that slide squares.
_MARKERS = {"prismatic": "s", "cylindrical": "s", "planar": "D", "point-on-plane": "D",
            "point-on-line": "s", "rigid": "P"}  # fmt: skip


def _mark(axes: Any, place: complex, marker: str, color: str) -> None:
    axes.plot(
        place.real, place.imag, marker=marker, color=color, markersize=3.6, markeredgewidth=0.8,
        zorder=6,
    )  # fmt: skip


def _ends(model: "SpatialModel", name: str) -> Iterator[str]:
    """Points that a body is drawn to from its centre: its joints and points."""
    number = model.bodies.index(name)
    for joint, made in model.joints.items():
        for k, side in enumerate(made.sides):
            if side.body == number:
                yield f"joint {joint} {k}"
    for point, side in model.points.items():
        if side.body == number:
            yield f"point {point}"


def _struts(axes: Any, model: "SpatialModel", at: Mapping[str, complex], size: float) -> None:
    """Springs and dampers; next to each other where they have the same ends."""
    springs = model.mechanism.springs.values()
    for spring in springs:
        ends = at[f"point {spring.from_}"], at[f"point {spring.to}"]
        if abs(ends[1] - ends[0]) > 1e-6 * size:
            line(axes, zigzag(*ends, 0.018 * size), color=_GREEN, linewidth=0.9, zorder=3)
    sprung = [{spring.from_, spring.to} for spring in springs]
    for dashpot in model.mechanism.dampers.values():
        start, end = at[f"point {dashpot.from_}"], at[f"point {dashpot.to}"]
        if abs(end - start) > 1e-6 * size:
            beside = 0.045 * size if {dashpot.from_, dashpot.to} in sprung else 0.0
            shift = beside * 1j * (end - start) / abs(end - start)
            damper(axes, start + shift, end + shift, 0.02 * size)


def _loads(
    axes: Any,
    model: "SpatialModel",
    at: Mapping[str, complex],
    seen: Array,
    bodies: Array,
    size: float,
) -> None:
    """Forces as arrows, torques as arrows with two heads, along their axes."""
    mechanism = model.mechanism
    for force in mechanism.forces.values():
        start = at.get(f"point {force.at}", at.get(f"body {force.at}", 0j))
        _arrow(
            axes, start, np.array([size_of(amount) for amount in force.force]), seen, size, heads=1
        )
    for torque in mechanism.torques.values():
        if not isinstance(torque.torque, tuple):
            side = model.joints[torque.on].sides[0]
            axis = size_of(torque.torque) * side.direction("n", bodies)
            _arrow(axes, at[f"joint {torque.on} 0"], axis, seen, size, heads=2)
        else:
            vector = np.array([size_of(amount) for amount in torque.torque])
            if torque.frame == "body":
                vector = vector @ bodies[model.bodies.index(torque.on), 1:]
            _arrow(axes, at[f"body {torque.on}"], vector, seen, size, heads=2)


def _arrow(axes: Any, start: complex, vector: Array, seen: Array, size: float, heads: int) -> None:
    length = float(np.linalg.norm(vector))
    if length == 0:
        return
    along = complex(vector @ seen) / length * 0.17 * size
    for share in (1.0, 0.8)[:heads]:
        tip = start + share * along
        axes.annotate(
            "", xy=(tip.real, tip.imag), xytext=(start.real, start.imag), zorder=7,
            arrowprops={"arrowstyle": "-|>", "color": _RED, "linewidth": 1.0, "shrinkA": 0,
                        "shrinkB": 0, "mutation_scale": 7},
        )  # fmt: skip


def _triad(
    axes: Any, at: Mapping[str, complex], seen: Array, size: float, factor: float,
) -> None:  # fmt: skip
    """The global axes, as long as a round number, to the left and below."""
    corner = complex(min(p.real for p in at.values()), min(p.imag for p in at.values()))
    length = 10.0 ** math.floor(math.log10(0.2 * size))
    length *= max(step for step in (1, 2, 5) if step * length <= 0.2 * size)
    origin = corner - complex(0.12 * size, 0.02 * size)
    for k, letter in enumerate("xyz"):
        tip = origin + length * complex(seen[k])
        line(axes, [origin, tip], color="0.35", linewidth=0.8)
        beyond = origin + (length + 0.035 * size) * complex(seen[k])
        axes.text(
            beyond.real, beyond.imag, f"${letter}$", fontsize=7, color="0.35", ha="center",
            va="center",
        )  # fmt: skip
    # Nothing to see: room for what stands at the edges.
    line(axes, [origin - complex(0.1, 0.14) * size, origin], alpha=0)
    unit = "mm" if factor == 1e3 else "m"
    below = origin - 0.075j * size
    axes.text(below.real, below.imag, f"{length:g} {unit}", fontsize=6, color="0.35", ha="center",
              va="top")  # fmt: skip


def _labels(axes: Any, model: "SpatialModel", at: Mapping[str, complex], size: float) -> None:
    """Names, each on the side of its place where nothing leaves it."""
    lines = [(at[f"body {body}"], at[end]) for body in model.bodies for end in _ends(model, body)]
    springs, dampers = model.mechanism.springs.values(), model.mechanism.dampers.values()
    struts = [*((s.from_, s.to) for s in springs), *((d.from_, d.to) for d in dampers)]
    lines += [(at[f"point {start}"], at[f"point {end}"]) for start, end in struts]
    taken: list[complex] = []

    def label(name: str, place: complex, **look: Any) -> None:
        leaving = [
            other - place
            for one, two in lines
            for here, other in ((one, two), (two, one))
            if abs(here - place) < 1e-9 * size and abs(other - here) > 1e-9 * size
        ]
        # Also away from names that stand there already, and from lines that pass.
        leaving += [other - place for other in taken if abs(other - place) < 0.12 * size]
        candidates = np.linspace(-math.pi, math.pi, 73)[:-1]
        room = [
            min(
                (
                    abs(math.remainder(angle - math.atan2(d.imag, d.real), math.tau))
                    for d in leaving
                ),
                default=math.pi - abs(angle - 0.8),
            )
            for angle in candidates
        ]
        angle = float(candidates[int(np.argmax(room))])
        away = complex(math.cos(angle), math.sin(angle))
        taken.append(place + 0.05 * size * away)
        aside = "left" if away.real > 0.4 else "right" if away.real < -0.4 else "center"
        far = 5 if aside != "center" else 9
        axes.annotate(
            plain(name), (place.real, place.imag), textcoords="offset points",
            xytext=(far * away.real, far * away.imag), ha=aside, va="center", zorder=8, **look,
        )  # fmt: skip

    for name in model.joints:
        label(name, at[f"joint {name} 1"], fontsize=8, fontweight="bold")
    for name in model.bodies:
        label(name, at[f"body {name}"], fontsize=6, color=_BLUE)
    for name in model.points:
        label(name, at[f"point {name}"], fontsize=6)


def symbols(model: "SpatialModel") -> Symbols:
    """Entries of a key."""
    mechanism = model.mechanism
    dot = {"linestyle": "none", "color": "black", "markersize": 4}
    found: dict[str, Mapping[str, Any]] = {
        "joint": {**dot, "marker": "o", "markerfacecolor": "white"},
        "joint to the ground": {**dot, "marker": "o"},
    }
    if any(joint.kind in _MARKERS for joint in model.joints.values()):
        found["joint that slides"] = {**dot, "marker": "s", "markerfacecolor": "white"}
    if any(JOINTS[joint.kind].axes for joint in model.joints.values()):
        found["axis"] = {"color": _RED, "linewidth": 1.1}
    found["mass centre"] = {**dot, "marker": "+", "color": _RED}
    if model.points:
        found["point"] = {**dot, "marker": "x"}
    if mechanism.springs:
        found["spring"] = {"color": _GREEN}
    if mechanism.dampers:
        found["damper"] = {"color": "#CC79A7"}
    return found
