"""Sizes that can hardly be meant: a length of 1050 for 1.05, a mass in grams among kilograms.

Nothing is refused.  A fictitious mass is a size like that, and is meant.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from newmark_cli.mechanisms.models import GROUND
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import Document, KeyPath

if TYPE_CHECKING:
    # Either takes its time to import, and one of them is enough.
    from newmark_cli.mechanisms.models import Mechanism
    from newmark_cli.mechanisms.spatial_model import SpatialMechanism

#: A factor between sizes of one kind that can hardly be meant.
_FACTOR = 300.0
#: How many times as long as anything else a part may be to count in full in the size of a
#: mechanism: a wrong length must not make room for itself.
_LONGEST = 2.0


class Guess(NamedTuple):
    """What a file guesses of positions.

    Attributes:
        names: (k,) moving points of a planar mechanism, bodies of a spatial one.
        before, after: (k, 2) or (k, 3) their positions in the file, and assembled (m).
    """

    names: tuple[str, ...]
    before: Array
    after: Array

    @property
    def moved(self) -> dict[str, float]:
        """How far assembling has moved each (m)."""
        away = np.linalg.norm(self.after - self.before, axis=1)
        return dict(zip(self.names, away.tolist(), strict=True))


def guess(problem: Problem, mechanism: Any) -> Guess:
    """Guessed positions next to those of the problem, which is assembled."""
    if mechanism.dimensions == 2:
        names = problem.points
        before = [mechanism.points[name].at for name in names]
        after = problem.u0[: 2 * len(names)].reshape(-1, 2)  # angles come behind the points
    else:
        names = tuple(mechanism.bodies)
        before = [mechanism.bodies[name].position for name in names]
        after = problem.u0.reshape(-1, 12)[:, :3]  # directors come behind an origin
    return Guess(names, np.array(before, float), after)


def doubts(problem: Problem, document: Document) -> tuple[str, ...]:
    """A line on each kind of size that can hardly be meant, with file, line, key and value.

    A length, mass or inertia is doubted if it is more than 300 times as large as the others
    of its kind, or that much smaller.  The others are the median and whatever leads to it in
    steps of at most that factor: sizes may be graded.  Of two, the larger is doubted.  An
    inertia must stand out for the mass of its body, too, and for its mass and length, which
    explain most of what inertias differ by.  A position is doubted if assembling moves it
    farther than the mechanism is large.
    """
    mechanism = getattr(problem.drawing, "mechanism", problem.drawing)
    lengths = _lengths(mechanism)
    # One of each part: a body with many points is no majority.
    by_part = {
        part: max(of, key=lambda size: (size.small, size.value)).value
        for part, of in lengths.items()
    }
    parts = list(by_part.values())
    lines: list[str] = []
    if mechanism.assemble:
        lines += _moved(guess(problem, mechanism), mechanism, parts, document)
    masses = [
        _Size((kind, name, "mass"), part.mass)
        for kind in ("points", "bodies", "body_points")
        for name, part in getattr(mechanism, kind).items()
        if getattr(part, "mass", 0)
    ]
    for kind, unit, odd in (
        ("lengths", "m", _odd([size for of in lengths.values() for size in of], parts)),
        ("masses", "kg", _odd(masses, [size.value for size in masses])),
        ("inertias", "kg m²", _odd_inertias(mechanism, by_part)),
    ):
        lines += _lines(document, kind, unit, odd)
    return tuple(lines)


class _Size(NamedTuple):
    """A size in a file.

    Attributes:
        path: Its key.
        value: In SI units.
        small: Whether it may be too small, too: a place on a body may be anywhere.
        of: What a place is a distance from.
    """

    path: KeyPath
    value: float
    small: bool = True
    of: str = ""


class _Odd(NamedTuple):
    """An outlier, with the least and largest of the other sizes."""

    size: _Size
    low: float
    high: float

    @property
    def large(self) -> bool:
        """Whether it is too large rather than too small."""
        return self.size.value > self.high


#: A part and a size of it.
_Owned = tuple[KeyPath, _Size]


def _lengths(mechanism: Any) -> dict[KeyPath, list[_Size]]:
    """Positive lengths by part; places on bodies count as the bodies'."""
    by_part: defaultdict[KeyPath, list[_Size]] = defaultdict(list)
    if mechanism.dimensions == 2:
        of_parts = chain(_planar_lengths(mechanism), _places(mechanism, "first point"))
    else:
        of_parts = chain(_spatial_lengths(mechanism), _places(mechanism, "origin"))
    for part, size in of_parts:
        if size.value > 0:
            by_part[part].append(size)
    return by_part


def _place(body: str, path: KeyPath, away: Sequence[float], origin: str = "origin") -> _Owned:
    size = _Size(path, math.hypot(*away), False, f" from the {origin} of {body}")
    return ("bodies", body), size


def _places(mechanism: Any, origin: str) -> Iterator[_Owned]:
    for name, body in mechanism.bodies.items():
        yield _place(name, ("bodies", name, "centre"), body.centre, origin)
    for name, point in mechanism.body_points.items():
        yield _place(point.on, ("body_points", name, "at"), point.at, origin)
    for name, spring in mechanism.springs.items():
        path = ("springs", name)
        yield path, _Size((*path, "rest_length"), spring.rest_length, False)


def _planar_lengths(mechanism: "Mechanism") -> Iterator[_Owned]:
    for kind in ("bodies", "bars"):
        for name, part in getattr(mechanism, kind).items():
            yield (kind, name), _Size((kind, name, "length"), part.length)
    for name, rolling in mechanism.rolling.items():
        of_wheel, of_circle = ("rolling", name), ("rolling", name, "circle")
        yield of_wheel, _Size((*of_wheel, "radius"), rolling.radius)
        if rolling.circle:
            yield of_circle, _Size((*of_circle, "radius"), rolling.circle.radius)


def _spatial_lengths(mechanism: "SpatialMechanism") -> Iterator[_Owned]:
    for name, body in mechanism.bodies.items():
        if body.box:
            yield ("bodies", name), _Size(("bodies", name, "box"), max(body.box), False)
    for name, joint in mechanism.joints.items():
        path, at = ("joints", name), joint.at
        for end in (joint.from_, joint.to):
            if end == GROUND:
                continue
            if isinstance(at, dict):
                yield _place(end, (*path, "at", end), at[end])
            else:
                away = np.subtract(at, mechanism.bodies[end].position).tolist()
                yield _place(end, (*path, "at"), away)
        if joint.length:
            yield path, _Size((*path, "length"), joint.length)


def _others(values: Sequence[float]) -> tuple[float, float]:
    """Range around the median reached in steps of at most the factor."""
    values = sorted(values)
    first = last = (len(values) - 1) // 2
    while first > 0 and values[first] <= _FACTOR * values[first - 1]:
        first -= 1
    while last + 1 < len(values) and values[last + 1] <= _FACTOR * values[last]:
        last += 1
    return values[first], values[last]


def _odd(sizes: Sequence[_Size], parts: Sequence[float]) -> dict[KeyPath, _Odd]:
    """Outliers among sizes of one kind, by path; ``parts`` has one size for each part."""
    if not parts:
        return {}
    low, high = _others(parts)
    return {
        size.path: _Odd(size, low, high)
        for size in sizes
        if size.value > _FACTOR * high or (size.small and _FACTOR * size.value < low)
    }


def _odd_inertias(mechanism: Any, lengths: Mapping[KeyPath, float]) -> dict[KeyPath, _Odd]:
    """Inertias that are outliers also for their mass, and for their mass and length."""
    plain, by_mass, by_size = [], [], []
    for name, body in mechanism.bodies.items():
        inertia = body.inertia
        if mechanism.dimensions == 3:
            # A thin rod has next to no moment about its axis; that of a box follows.
            inertia = 0.0 if body.box else float(np.linalg.eigvalsh(body.tensor)[-1])
        if inertia > 0:
            path = ("bodies", name, "inertia")
            plain.append(_Size(path, inertia))
            if body.mass > 0:
                by_mass.append(_Size(path, inertia / body.mass))
                if length := lengths.get(path[:2]):
                    by_size.append(_Size(path, inertia / body.mass / length / length))
    odd = _odd(plain, [size.value for size in plain])
    for sizes in (by_mass, by_size):
        known = {size.path for size in sizes}
        too = _odd(sizes, [size.value for size in sizes])
        odd = {
            path: entry
            for path, entry in odd.items()
            if path not in known or (path in too and too[path].large == entry.large)
        }
    return odd


def _lines(document: Document, kind: str, unit: str, odd: dict[KeyPath, _Odd]) -> Iterator[str]:
    """A line on the first size that is too large, and the first that is too small."""
    for large, than in ((True, "more than {:g} times"), (False, "less than 1/{:g} of")):
        alike = [entry for entry in odd.values() if entry.large == large]
        if not alike:
            continue
        (path, value, _, of), low, high = min(
            alike, key=lambda entry: document.line(entry.size.path)
        )
        others = f"{low:.4g} {unit}" if low == high else f"{low:.4g} to {high:.4g} {unit}"
        more = f" (and {len(alike) - 1} more like it)" if len(alike) > 1 else ""
        text = f"{value:.6g} {unit}{of} is {than.format(_FACTOR)} the other {kind}, {others}{more}"
        yield str(document.error(path, text))


def _moved(
    guessed: Guess, mechanism: Any, lengths: Sequence[float], document: Document
) -> Iterator[str]:
    """A line on the point or body that assembling has moved farthest, if that is too far.

    The mechanism is as large as the box around its guess or around where it is assembled,
    the smaller of both, or as all its lengths in a row, if that is more.  So neither a
    position nor a length that is wrong makes it large.
    """
    fixed = [point.fixed for point in mechanism.points.values() if point.fixed is not None]
    around = np.array(fixed, float).reshape(-1, guessed.before.shape[1])
    box = min(
        float(np.linalg.norm(np.ptp(np.concatenate([around, of]), axis=0)))
        for of in (guessed.before, guessed.after)
    )
    *rest, longest = sorted(lengths) or [0.0]
    beside = max([box, *rest])
    size = max(box, sum(rest) + (min(longest, _LONGEST * beside) if beside else longest))
    moved = guessed.moved
    name = max(moved, key=moved.__getitem__)
    if moved[name] > size:
        planar = mechanism.dimensions == 2
        path = ("points", name, "at") if planar else ("bodies", name, "position")
        before = ", ".join(f"{number:g}" for number in guessed.before[guessed.names.index(name)])
        yield str(
            document.error(
                path,
                f"[{before}] is {moved[name]:.3g} m from where assembling puts {name}, more than "
                f"the size of the mechanism, {size:.3g} m",
            )
        )
