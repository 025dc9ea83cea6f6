"""Which number of a mechanism's geometry or drive explains that Φ is missed: Φ alone tells.

A code that has another length, place, direction or drive meets the Φ of that mechanism, to rounding
at every row and h.  So no motion is solved: Φ of the changed mechanism is evaluated where the code
has been.
"""

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from newmark_cli.codes.changes import share
from newmark_cli.codes.evidence import Finding, SeriesErrors
from newmark_cli.codes.file_numbers import FileNumbers, Path, interpolations, joined
from newmark_cli.mechanisms import loading
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import InputError

#: Keys of what no constraint has.
_NO_GEOMETRY = {
    "mass", "inertia", "centre", "stiffness", "damping", "gravity", "springs", "dampers", "torques",
    "forces", "outputs", "velocity", "angular_velocity", "rates", "title",
}  # fmt: skip
#: Keys of vectors of which the direction counts, and of numbers that are places (m).
_DIRECTIONS, _PLACES = ("direction", "axis"), ("at", "fixed", "through", "position")
#: Least misfit of Φ, over the size of u, and the ratio that those of two step sizes may have.
_LEAST, _ALIKE = 1e-8, 2.0
#: Part of the misfit that an explanation may leave, and of rivals, times what the best leaves.
_LEAVES, _RIVALS = 1e-3, 30.0
#: How much larger than the smallest change another one is that nobody makes.
_LARGER = 8.0
#: Corrections of a number, its largest change in one of them, a small one, and one that is none.
_CORRECTIONS, _MOST, _SMALL, _MET = 12, 0.6, 0.05, 1e-9
#: Step of differences, and a slope of a number that no constraint has.
_STEP, _NO_SLOPE = 1e-6, 1e-9
#: Numbers that a sentence names.
_NAMED = 4


@dataclass(frozen=True, eq=False)
class _Number:
    """A number, or an angle, that may be another one.

    Attributes:
        name: What it is called.
        size: What its changes are measured in.
        document: Its changes (k,) in sizes → the document with them.
        said: Its changes → what it is then.
        starts: Changes from which it is sought.
    """

    name: str
    document: Callable[[Array], Mapping[str, Any]]
    said: Callable[[Array], str]
    starts: Sequence[Sequence[float]]


def changed(evidence: SeriesErrors, file: FileNumbers | None) -> Iterator[Finding]:
    """The one number with which Φ is met at all rows of the two smallest step sizes."""
    if file is None or len(evidence.runs) < 2 or not evidence.whole["u"]:
        return
    file = _placed(file, evidence.problem)
    told = _Misfits(evidence, file)
    if told.problem is None or not told.differs:
        return
    fits = [(left, number, c) for number in _numbers(file) for left, c in [told.fitted(number)]]
    fits.sort(key=lambda fit: fit[0])
    allowed = max(_LEAVES * told.largest, told.least)
    good = [fit for fit in fits if fit[0] < min(allowed, _RIVALS * max(fits[0][0], told.least))]
    if not good:
        return
    good.sort(key=lambda fit: float(np.linalg.norm(fit[2])))
    good = [fit for fit in good if np.linalg.norm(fit[2]) <= _LARGER * np.linalg.norm(good[0][2])]
    names = " or ".join(number.said(c) for _, number, c in good[:_NAMED])
    says = "with it all" if len(good) == 1 else "with any of these all"
    changes = {
        number.name: float(c[0] if len(c) == 1 else np.linalg.norm(c))
        for _, number, c in good[:_NAMED]
    }
    text = (
        f"Φ of {', '.join(told.names)} is missed at every h, by {told.largest:.3g} of the "
        f"coordinates; {names}: {says} constraints are met at all rows"
    )
    yield evidence.finding("another mechanism", text, changes=changes, misfit=told.largest)


def _placed(file: FileNumbers, problem: Problem) -> FileNumbers:
    """The file with its points where the start has them: teeth that mesh there count from it."""
    u = dict(zip(problem.coordinate_names, problem.u0.tolist(), strict=True))
    points = {
        name: {**point, "at": [u[f"{name}.{axis}"] for axis in problem.axes]}
        if f"{name}.x" in u
        else point
        for name, point in (file.document.get("points") or {}).items()
    }
    return replace(file, document={**file.document, "points": points}) if points else file


class _Misfits:
    """Φ of a mechanism, with all of its constraints, at rows of the two smallest step sizes."""

    def __init__(self, evidence: SeriesErrors, file: FileNumbers) -> None:
        self._file = file
        self.problem = self._of(file.document)
        if self.problem is None:
            return
        self._rows = [
            [(float(run.t[k]), run.state["u"][k]) for k in evidence.looked_at(run)]
            for run in evidence.runs[-2:]
        ]
        largest = np.linalg.norm(self.problem.gradient(*self._rows[-1][-1]), axis=0)
        self._unit = evidence.scale["u"] * np.maximum(largest, 1e-3 * largest.max())
        self.least = max(10 * evidence.resolution["u"], 1e-12)
        missed = [np.abs(self._missed(self.problem, rows)) for rows in self._rows]
        self.largest = float(missed[-1].max())
        sizes = sorted(float(of.max()) for of in missed)
        self.differs = sizes[0] > max(_LEAST, 3 * self.least) and sizes[1] < _ALIKE * sizes[0]
        hit = missed[-1].max(axis=0) > 0.01 * self.largest
        self.names = np.array(self.problem.constraint_names)[hit].tolist()

    def _of(self, document: Mapping[str, Any]) -> Problem | None:
        """The mechanism whose start need not fit, nor its constraints be independent."""
        try:
            return loading.made("changed", {**document, "assemble": True})
        except (ArithmeticError, InputError, LookupError, ValueError):
            return None

    def _missed(self, problem: Problem, rows: Sequence[tuple[float, Array]]) -> Array:
        phi = np.array([problem.constraint_values(t, u) for t, u in rows])
        return np.asarray(phi / self._unit)

    def of(self, number: _Number, c: Array) -> Array | None:
        """Misfits with a number changed, in one vector; None where there is no such mechanism."""
        problem = self._of(number.document(c))
        if problem is None or problem.m != len(self._unit):
            return None
        missed = np.concatenate([self._missed(problem, rows).ravel() for rows in self._rows])
        return missed if np.isfinite(missed).all() else None

    def fitted(self, number: _Number) -> tuple[float, Array]:
        """Largest misfit that is left, and the changes that leave it, by Gauss and Newton."""
        best = math.inf, np.zeros(len(number.starts[0]))
        for start in number.starts:
            c = np.array(start, float)
            for _ in range(_CORRECTIONS):
                here = self.of(number, c)
                if here is None:
                    break
                left = float(np.abs(here).max())
                if left < best[0]:
                    best = left, c
                change = self._correction(number, c, here)
                if change is None:
                    break
                c = c + change
            if best[0] < _LEAVES * self.largest:
                break
        return best

    def _correction(self, number: _Number, c: Array, here: Array) -> Array | None:
        """By how much a number is changed next; None where its slope tells that it is not it."""
        there = [self.of(number, c + step) for step in _STEP * np.eye(len(c))]
        slopes = np.array([(of - here) / _STEP for of in there if of is not None]).T
        if slopes.shape[-1] < len(c) or np.abs(slopes).max() < _NO_SLOPE:
            return None
        change = np.linalg.lstsq(slopes, -here, rcond=1e-8)[0]
        size = float(np.abs(change).max())
        stays = size < _SMALL and np.abs(here + slopes @ change).max() > np.abs(here).max() / 2
        if stays or size < _MET:
            return None
        return np.asarray(change * min(1.0, _MOST / size))


def _numbers(file: FileNumbers) -> Iterator[_Number]:
    """Numbers of a file that constraints may have, and the angles of its directions."""
    for path, (given, others) in _tables(file.document, ()):
        for other in others:
            told = f"{joined(path)} {other} in place of {given}"
            made = partial(_with, file, path, partial(_whatever, other))
            yield _Number(joined(path), made, partial(_whatever, told), [(0.0,)])
    for path, value in _leaves(file.document, ()):
        name, phase = joined(path), path[-1] == "phase"
        place = any(key in _PLACES for key in path)
        starts: list[tuple[float, ...]] = [(0.0,)]
        to: Callable[[Array], Any]
        if isinstance(value, list):
            to, said = partial(_turned, value), partial(_said_turned, name, value)
            starts = [(0.0,)] if len(value) == 2 else [(0.0, 0.0)]
        elif value and not (place or phase):
            to, said = partial(_times, value), partial(_said_times, name)
            starts = [(0.0,), (-2.0,)]
        else:
            unit = "rad" if phase else "m" if place else ""
            starts += [(-2.0 * value,)] if value else []
            to, said = partial(_plus, value), partial(_said_plus, name, unit)
            starts += [(turn * math.pi,) for turn in (0.5, -0.5, 1.0)] if phase else []
        yield _Number(name, partial(_with, file, path, to), said, starts)


def _whatever(value: str, c: Array) -> str:
    """What is no number has no changes."""
    return value


def _times(value: float, c: Array) -> float:
    return value * (1 + float(c[0]))


def _plus(value: float, c: Array) -> float:
    return value + float(c[0])


def _said_times(name: str, c: Array) -> str:
    return share(name)(float(c[0]))


def _said_plus(name: str, unit: str, c: Array) -> str:
    return f"{name} {c[0]:+.5g} {unit}".rstrip()


def _leaves(value: Any, path: Path) -> Iterator[tuple[Path, Any]]:
    """Paths of numbers and of directions, with phases that are left out."""
    items: Any = ()
    if isinstance(value, Mapping):
        items = [item for item in value.items() if item[0] not in _NO_GEOMETRY]
        if "frequency" in value and "phase" not in value:
            yield (*path, "phase"), 0.0
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    for key, item in items:
        if isinstance(item, bool):
            continue
        vector = isinstance(item, list | tuple) and len(item) in (2, 3)
        if vector and not {key, *path[-1:]}.isdisjoint(_DIRECTIONS):  # or that in a body
            yield (*path, key), [*item]
        elif isinstance(item, int | float):
            yield (*path, key), float(item)
        else:
            yield from _leaves(item, (*path, key))


def _tables(value: Any, path: Path) -> Iterator[tuple[Path, tuple[str, list[str]]]]:
    """Paths of the interpolations of tables of motions, with what they are and might be."""
    if isinstance(value, Mapping):
        if "times" in value:
            yield (*path, "interpolation"), interpolations(value)
        for key, item in value.items():
            if key not in _NO_GEOMETRY:
                yield from _tables(item, (*path, key))


def _with(
    file: FileNumbers, path: Path, value: Callable[[Array], Any], c: Array
) -> Mapping[str, Any]:
    """The document with another value at a path."""
    document = copy.deepcopy(dict(file.document))
    there: Any = document
    for key in path[:-1]:
        there = there[key]
    there[path[-1]] = value(c)
    return document


def _turned(direction: Sequence[float], angles: Array) -> list[float]:
    """A direction turned by angles (rad): in the plane, or to two sides in space."""
    d = np.array(direction, float)
    sides = [np.array([-d[1], d[0]])] if len(d) == 2 else _sides(d)
    angle = float(np.linalg.norm(angles))
    if not angle:
        return [float(x) for x in d]
    side = sum(a * s for a, s in zip(angles, sides, strict=True)) / angle
    return [float(x) for x in math.cos(angle) * d + math.sin(angle) * side]


def _sides(d: Array) -> list[Array]:
    """Two vectors as long as a third, at right angles to it and to each other."""
    across = np.cross(d, np.eye(3)[int(np.abs(d).argmin())])
    across *= np.linalg.norm(d) / np.linalg.norm(across)
    return [across, np.cross(d, across) / np.linalg.norm(d)]


def _said_turned(name: str, direction: Sequence[float], angles: Array) -> str:
    if len(direction) == 2:
        return f"{name} turned by {math.degrees(float(angles[0])):.4g}°"
    there = np.array(_turned(direction, angles)) / float(np.linalg.norm(direction))
    to = ", ".join(f"{round(float(x), 5) + 0.0:g}" for x in there)
    return f"{name} tilted by {math.degrees(float(np.linalg.norm(angles))):.4g}°, to [{to}]"
