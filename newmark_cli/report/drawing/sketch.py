"""What mechanisms look like, as plain data: lines and signs at places x + iy of the paper.

A mechanism in space is seen in one fixed oblique view without perspective, with what is against
gravity upwards; the plane is the paper itself.  Everything is projected at once: a body is its
origin and its axes as complex numbers, and so are points.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from newmark_cli.mechanisms.models import size_of
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

#: From where one looks at space: about the upright, and above the level (rad).
_AZIMUTH, _ELEVATION = math.radians(-58), math.radians(20)
#: Signs of joints that slide; others turn only and are circles.
_SLIDING = {"prismatic": "s", "cylindrical": "s", "planar": "D", "point-on-plane": "D",
            "point-on-line": "s", "rigid": "P"}  # fmt: skip


@dataclass(frozen=True)
class Mark:
    """A line through places, or a sign at each.

    Attributes:
        symbol: What it stands for, by which drawings know how it looks.
        places: (k,) its places.
        look: What differs from others of its kind.
    """

    symbol: str
    places: Any
    look: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Scene:
    """A mechanism at a position.

    Attributes:
        mechanism: What the file says.
        frames: Origin and axes of each body; those of the ground have no name.
        points: Places of points.
        joints: Ends of each joint.
        axes: Directions of the axes of each joint.
        factor: Lengths in the figure of a metre.
        size: Extent of the mechanism where it starts.
        start: The mechanism where it starts; None if this is it.
    """

    mechanism: Any
    frames: Mapping[str, Array]
    points: Mapping[str, complex]
    joints: Mapping[str, tuple[complex, complex]]
    axes: Mapping[str, Sequence[complex]]
    factor: float
    size: float = 1.0
    start: "Scene | None" = None

    def placed(self, body: str | None, at: Any) -> complex:
        """A place in the axes of a body, or of the ground (m)."""
        origin, *axes = self.frames[body or ""]
        return complex(origin + sum(part * axis for part, axis in zip(at, axes, strict=True)))

    def along(self, body: str | None) -> complex:
        """First axis of a body; 1 of the ground, and of what is none."""
        return complex(self.frames.get(body or "", self.frames[""])[1] / self.factor)

    def seen_from(self, body: str | None, point: str) -> complex:
        """Place of a point in the axes of a body of the plane (m)."""
        away = self.points[point] - self.frames[body or ""][0]
        return complex(away / self.along(body) / self.factor)

    def corners(self, name: str) -> list[complex]:
        """Corners of the box of a body, of which the last axis runs first."""
        body = self.mechanism.bodies[name]
        halves = itertools.product(*((-edge / 2, edge / 2) for edge in body.box))
        return [self.placed(name, np.add(body.centre, half)) for half in halves]

    def ends(self, name: str) -> list[complex]:
        """Points that a body of the plane joins, or where joints and points of one in space are."""
        body = self.mechanism.bodies[name]
        points = [self.points[p] for p, of in self.mechanism.body_points.items() if of.on == name]
        if not hasattr(self.mechanism, "joints"):
            return [self.points[body.from_], self.points[body.to], *points]
        return [
            end
            for key, joint in self.mechanism.joints.items()
            for end, of in zip(self.joints[key], (joint.from_, joint.to), strict=True)
            if of == name
        ] + points

    def centre(self, name: str) -> complex:
        """Mass centre of a body."""
        return self.placed(name, self.mechanism.bodies[name].centre)

    @property
    def places(self) -> list[complex]:
        """All that a drawing must have room for."""
        places = [*self.points.values(), *itertools.chain(*self.joints.values())]
        if hasattr(self.mechanism, "joints"):
            for name, body in self.mechanism.bodies.items():
                places += [self.centre(name), *(self.corners(name) if body.box else ())]
        return places


def is_spatial(problem: Problem) -> bool:
    """Whether a problem is a mechanism in space."""
    return len(problem.axes) == 3


def view(gravity: Sequence[float]) -> Array:
    """(3,) complex: a vector of three components times it is its place on the paper."""
    up = int(np.argmax(np.abs(gravity))) if np.any(gravity) else 2
    paper = np.zeros(3, complex)
    side, depth = (up + 1) % 3, (up + 2) % 3
    paper[side] = complex(-math.sin(_AZIMUTH), -math.sin(_ELEVATION) * math.cos(_AZIMUTH))
    paper[depth] = complex(math.cos(_AZIMUTH), -math.sin(_ELEVATION) * math.sin(_AZIMUTH))
    paper[up] = 1j * math.cos(_ELEVATION)
    return paper


def scene(problem: Problem, u: Array, factor: float = 1.0) -> Scene:
    """A mechanism at a position u (n,), lengths multiplied by ``factor``."""
    start = _scene(problem, problem.u0, factor)
    spots = np.array(start.places)
    size = float(max(np.ptp(spots.real), np.ptp(spots.imag))) or 1.0
    return replace(_scene(problem, u, factor), size=size, start=start)


def _scene(problem: Problem, u: Array, factor: float) -> Scene:
    joints, axes, mechanism = {}, {}, problem.drawing
    if is_spatial(problem):
        paper = factor * view(mechanism.gravity)
        bodies = u.reshape(-1, 4, 3) @ paper
        names = ("", *mechanism.bodies)
        frames = dict(zip(names, [np.array([0, *paper]), *bodies], strict=True))
        points = {name: complex(point.fixed @ paper) for name, point in mechanism.points.items()}
        outputs: Any = problem.outputs
        for name, joint in outputs.joints.items():
            sides = [(frames[names[side.body + 1]], side) for side in joint.sides]
            first, second = (complex(of[0] + side.point @ of[1:]) for of, side in sides)
            joints[name] = first, second
            # The axis of the second body shows where it is not that of the first.
            shown = [("n", sides[0]), ("a", sides[0]), ("b", sides[1])]
            axes[name] = [
                complex(side.vectors[key] @ of[1:]) / factor
                for key, (of, side) in shown
                if key in side.vectors
            ]
    else:
        paper = factor * np.array([1, 1j])
        moving = dict(zip(problem.points, u[: 2 * len(problem.points)].reshape(-1, 2), strict=True))
        points = {
            name: complex(np.dot(moving.get(name, point.fixed), paper))
            for name, point in mechanism.points.items()
        }
        frames = {"": np.array([0, *paper])}
        for name, body in mechanism.bodies.items():
            along = (points[body.to] - points[body.from_]) / body.length
            frames[name] = np.array([points[body.from_], along, 1j * along])
    drawn = Scene(mechanism, frames, points, joints, axes, factor)
    points |= {name: drawn.placed(at.on, at.at) for name, at in mechanism.body_points.items()}
    return drawn


def marks(scene: Scene) -> Iterator[Mark]:
    """All that is seen of a mechanism."""
    for key, sketch in SKETCHES.items():
        for name, part in getattr(scene.mechanism, key, {}).items():
            yield from sketch(scene, name, part)


# -- bodies, points, joints ---------------------------------------------------------------------


def _body(scene: Scene, name: str, body: Any) -> Iterator[Mark]:
    centre, ends = scene.centre(name), scene.ends(name)
    yield Mark("mass centre", [centre])
    if hasattr(scene.mechanism, "joints"):
        if body.box:
            corners = scene.corners(name)
            edges = ((i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit)
            yield from (Mark("edge", [corners[i], corners[j]]) for i, j in edges)
        yield from (Mark("body", [centre, end]) for end in ends)
        return
    outline = [*ends, centre] if len(ends) == 2 and body.centre[1] != 0 else ends
    if len(outline) > 2:
        yield Mark("outline", [*outline, outline[0]])
    driven = {torque.on for torque in scene.mechanism.torques.values()}
    driven |= {motion.body for motion in scene.mechanism.motions.values()}
    yield Mark("driven body" if name in driven else "body", ends[:2])


def _point(scene: Scene, name: str, point: Any) -> Iterator[Mark]:
    place, size = scene.points[name], 0.03 * scene.size
    if hasattr(scene.mechanism, "joints"):
        yield Mark("point", [place])
    elif getattr(point, "fixed", None) is None:
        yield Mark("joint", [place])
    else:
        yield Mark("fixed point", [place])
        yield Mark("ground", [place + size * foot for foot in (0, -0.6 - 1j, 0.6 - 1j)])
        for step in np.linspace(-0.8, 0.8, 5):
            foot = place + complex(step, -1) * size
            yield Mark("hatch", [foot, foot + complex(-0.35, -0.45) * size])


def _joint(scene: Scene, name: str, joint: Any) -> Iterator[Mark]:
    ends = scene.joints[name]
    for axis in scene.axes[name]:
        along = 0.055 * scene.size * axis
        yield Mark("axis", [ends[0] - along, ends[0] + along])
    if abs(ends[1] - ends[0]) > 1e-9 * scene.size:
        yield Mark("bar" if joint.type == "distance" else "open joint", ends)
    grounded = {joint.from_, joint.to} - scene.mechanism.bodies.keys()
    symbol, look = "joint to the ground" if grounded else "joint", {}
    if joint.type in _SLIDING:
        symbol = "joint that slides"
        look = {"marker": _SLIDING[joint.type], "markerfacecolor": "black" if grounded else "white"}
    yield Mark(symbol, list(dict.fromkeys(ends)), look)


def _guide(scene: Scene, name: str, slider: Any) -> Iterator[Mark]:
    # A guide does not travel with what it guides: it is drawn where that starts, and as far
    # as that has got.
    direction = complex(*slider.direction) / abs(complex(*slider.direction))
    first = (scene.start or scene).seen_from(slider.on, slider.point)
    moved = ((scene.seen_from(slider.on, slider.point) - first) * direction.conjugate()).real
    half = 0.12 * scene.size / scene.factor
    reaches = (first + reach * direction for reach in (min(moved, 0) - half, max(moved, 0) + half))
    yield Mark("guide", [scene.placed(slider.on, (at.real, at.imag)) for at in reaches])


# -- wheels --------------------------------------------------------------------------------------


def _disc(centre: complex, radius: float, towards: complex = 0j) -> Iterator[Mark]:
    """A circle, with a mark on its rim that turns with it."""
    yield Mark("wheel", centre + radius * _circle(0, 2 * np.pi, 73))
    if towards:
        yield Mark("wheel", [centre + share * radius * towards for share in (0.8, 1)],
                   {"linewidth": 1.4})  # fmt: skip


def _circle(first: float, last: float, count: int) -> Array:
    return np.asarray(np.exp(1j * np.linspace(first, last, count)))


def _gear(scene: Scene, name: str, gear: Any) -> Iterator[Mark]:
    start, end = (complex(scene.frames[body][0]) for body in (gear.from_, gear.to))
    distance = abs(end - start)
    if distance == 0 or gear.ratio == 1:
        yield Mark("bar", [start, end])
        return
    # Pitch circles meet between the axes, or beyond the smaller wheel where both turn alike.
    share = distance / abs(1 - gear.ratio)
    yield from _disc(start, abs(gear.ratio) * share, scene.along(gear.from_))
    yield from _disc(end, share, scene.along(gear.to))


def _rolling(scene: Scene, name: str, rolling: Any) -> Iterator[Mark]:
    centre = scene.points[rolling.centre or scene.mechanism.bodies[rolling.wheel].from_]
    yield from _disc(centre, scene.factor * rolling.radius, scene.along(rolling.wheel))
    if rolling.line is not None:
        line = rolling.line
        direction = complex(*line.direction) / abs(complex(*line.direction)) * scene.along(line.on)
        through = scene.placed(line.on, line.through)
        foot = through + direction * ((centre - through) * direction.conjugate()).real
        half = 0.2 * scene.size * direction
        yield Mark("guide", [foot - half, foot + half])
    if (circle := rolling.circle) is not None:
        turns = 0j if circle.body is None else scene.along(circle.body)
        yield from _disc(scene.points[circle.centre], scene.factor * circle.radius, turns)


# -- springs, dampers, loads ---------------------------------------------------------------------


def _bar(scene: Scene, name: str, bar: Any) -> Iterator[Mark]:
    yield Mark("bar", [scene.points[bar.from_], scene.points[bar.to]])


def _spring(scene: Scene, name: str, spring: Any) -> Iterator[Mark]:
    start, along = scene.points[spring.from_], scene.points[spring.to] - scene.points[spring.from_]
    if abs(along) > 1e-6 * scene.size:
        across, coils = 0.018j * scene.size * along / abs(along), 14
        wound = [(0.2 + 0.6 * (k + 0.5) / coils) * along + (-1) ** k * across for k in range(coils)]
        places = (0, 0.2 * along, *wound, 0.8 * along, along)
        yield Mark("spring", [start + place for place in places])


def _damper(scene: Scene, name: str, damper: Any) -> Iterator[Mark]:
    """A piston in a cup, beside a spring that has the same ends."""
    start, end = scene.points[damper.from_], scene.points[damper.to]
    if abs(end - start) <= 1e-6 * scene.size:
        return
    along = 0.02 * scene.size * (end - start) / abs(end - start)
    springs = ({spring.from_, spring.to} for spring in scene.mechanism.springs.values())
    aside = 2.25j * along if {damper.from_, damper.to} in springs else 0
    middle, across = (start + end) / 2, 1j * along
    cup = (-0.5 * along - across, 1.5 * along - across, 1.5 * along + across, -0.5 * along + across)
    for places in (
        (start, middle), (middle - 0.7 * across, middle + 0.7 * across),
        [middle + at for at in cup], (middle + 1.5 * along, end),
    ):  # fmt: skip
        yield Mark("damper", [place + aside for place in places])


def _spiral(scene: Scene, name: str, part: Any, damps: bool = False) -> Iterator[Mark]:
    """A torsion spring, or the arc of a torsion damper."""
    of_joint = hasattr(part, "on")
    centre = scene.joints[part.on][0] if of_joint else complex(scene.frames[part.to][0])
    if damps:
        yield Mark("damper", centre + 0.0675 * scene.size * _circle(0.3, 5.4, 40))
    else:
        wound = _circle(0, 5 * np.pi, 120) * np.linspace(0.15, 1, 120)
        yield Mark("spring", centre + 0.05 * scene.size * wound)


def _arrow(symbol: str, start: Any, end: Any) -> Mark:
    return Mark(symbol, [start, end], {"arrow": True})


def _force(scene: Scene, name: str, force: Any) -> Iterator[Mark]:
    vector = np.array([size_of(amount) for amount in force.force])
    if not np.any(vector):
        return
    along = complex(vector @ scene.frames[""][1:]) / scene.factor / np.linalg.norm(vector)
    if hasattr(scene.mechanism, "joints"):
        at = scene.points[force.at] if force.at in scene.points else scene.centre(force.at)
        yield _arrow("force", at, at + 0.17 * scene.size * along)
    else:
        tip = scene.points[force.at]
        yield _arrow("force", tip - 0.14 * scene.size * along, tip)


def _torque(scene: Scene, name: str, torque: Any) -> Iterator[Mark]:
    """An arc about the first point of a body; an arrow with two heads in space."""
    if not hasattr(scene.mechanism, "joints"):
        yield from _arc(scene, "torque", torque.on, size_of(torque.torque))
        return
    if isinstance(torque.torque, tuple):
        start, axes = scene.centre(torque.on), scene.frames[torque.on * (torque.frame == "body")]
        vector = np.array([size_of(amount) for amount in torque.torque])
        along = complex(vector @ axes[1:]) / scene.factor / (np.linalg.norm(vector) or 1)
    else:
        start = scene.joints[torque.on][0]
        along = math.copysign(1, size_of(torque.torque)) * scene.axes[torque.on][0]
    if torque.acts:
        for share in (0.17, 0.136):
            yield _arrow("torque", start, start + share * scene.size * along)


def _arc(scene: Scene, symbol: str, body: str, sign: float) -> Iterator[Mark]:
    """An arrow about the first point of a body of the plane, counterclockwise unless negative."""
    centre, radius = complex(scene.frames[body][0]), 0.11 * scene.size
    first, last = math.radians(20), math.radians(150)
    if sign < 0:
        first, last = last, first
    yield Mark(symbol, centre + radius * _circle(first, last, 40))
    back = math.copysign(math.radians(14), last - first)
    yield _arrow(symbol, *(centre + radius * _circle(last - back, last, 2)))


def _motion(scene: Scene, name: str, motion: Any) -> Iterator[Mark]:
    """An arrow in the direction in which a driven coordinate grows."""
    mechanism, ground = scene.mechanism, scene.frames[""][1:] / scene.factor
    if motion.point is not None:
        directions = zip((motion.x, motion.y, getattr(motion, "z", None)), ground, strict=False)
        ways = [(scene.points[motion.point], along) for law, along in directions if law]
    elif hasattr(mechanism, "joints"):
        ways = [(scene.joints[motion.joint][0], scene.axes[motion.joint][0])]
    elif motion.body is not None:
        yield from _arc(scene, "motion", motion.body, 1.0)
        return
    else:
        slider = mechanism.sliders[motion.slider]
        along = complex(*slider.direction) / abs(complex(*slider.direction))
        ways = [(scene.points[slider.point], along * scene.along(slider.on))]
    for start, along in ways:
        yield _arrow("motion", start, start + 0.15 * scene.size * along)


#: Key of a mechanism → (scene, name, what the file says) → what one looks like.
SKETCHES: Mapping[str, Callable[[Scene, str, Any], Iterator[Mark]]] = MappingProxyType(
    {
        "bodies": _body,
        "bars": _bar,
        "springs": _spring,
        "sliders": _guide,
        "dampers": _damper,
        "joints": _joint,
        "torques": _torque,
        "motions": _motion,
        "forces": _force,
        "torsion_springs": _spiral,
        "torsion_dampers": partial(_spiral, damps=True),
        "gears": _gear,
        "rolling": _rolling,
        "points": _point,
        "body_points": _point,
    }
)
