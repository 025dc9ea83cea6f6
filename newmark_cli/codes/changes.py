"""Which one number of a mechanism explains another motion: found by solving it anew.

The number is fitted to the rows of the smallest step size and named only if it alone explains u,
v and λ at all of them, within what truncation leaves.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from newmark_cli.codes.evidence import PARTS, SYMBOLS, SeriesErrors, WeightedRows
from newmark_cli.codes.file_numbers import LEFT_OUT, SIZES, FileNumbers, Path, difference, joined
from newmark_cli.codes.further_forces import further_forces, is_whole, opposite, rates
from newmark_cli.codes.minimal_coordinates import couplings, terms
from newmark_cli.codes.truth import EXACT, Force, MassOf, NoMotion, Truth
from newmark_cli.codes.turning_bodies import Unturned, unturned
from newmark_cli.support.arrays import Array, IndexArray, Mask
from newmark_cli.support.errors import InputError

#: Misfit of Φ by which a place is one of a constraint.
_MISFIT = 1e-9
#: Keys of which all of a mechanism may be wrong alike.
_ALIKE = ("mass", "inertia", "stiffness", "damping", "rest_length")
_MOMENTS, _PRODUCTS = ("xx", "yy", "zz"), ("xy", "xz", "yz")
#: Numbers that files have positive only.
_POSITIVE = ("stiffness", "damping")
#: Share of an inertia of which M is known to be linear.
_LITTLE = 1e-3
#: Shares by which a number is scanned where the error is large: left out and turned come first.
_SCAN = (-0.5, -0.2, -0.08, 0.08, 0.2, 0.5, 1.0, 3.0, 11.0)
#: What of a change of h a number may follow that the smallest two step sizes ask for.
_FOLLOWS = 0.6
#: Terms of accelerations that codes lack.
TERMS = {"κ": "κ of Gᵀa + κ = 0 (centrifugal terms)",
         "motions": "the acceleration of the motions"}  # fmt: skip
#: Ranks of places, of pushes and of terms, and candidates that are fitted to the whole motion.
_PLACE, _LAST, _TERM, _KEPT = 1, 2, 3, 6
#: Part of the rows that all candidates are fitted to, and how clear these must be.
_EARLY, _CLEAR = 0.4, 30.0
#: What an explanation may leave, over what truncation does; relative to all, in the mean.
_EXPLAINS, _IN_THE_MEAN = 3.0, 0.2
#: What it may leave beside truncation, over the largest error, and the part of that below which no
#: other is sought.
_SLACK, _SURE = 2e-3, 0.1


@dataclass(frozen=True, eq=False)
class Candidate:
    """One number that may be another one.

    Attributes:
        name: What it is called.
        of: Its change, a tolerance and a last time (s) → the motion.
        said: Its change → what it is then.
        starts: Changes that are tried first, such as −1, where it is left out.
        rank: 0, or that of places, pushes and terms, which are looked at where no other explains.
        holds: Whether a change can be.
    """

    name: str
    of: Callable[[float, float, float], Truth]
    said: Callable[[float], str]
    starts: Sequence[float] = ()
    rank: int = 0
    holds: Callable[[float], bool] = lambda c: True


def candidates(evidence: SeriesErrors, file: FileNumbers | None) -> Iterator[Candidate]:
    """What may have been changed, the numbers of the file first."""
    problem = evidence.problem

    def lacking(
        name: str, changed: Callable[[float], dict[str, Any]], starts: Sequence[float]
    ) -> Candidate:
        """A term of which a share may be lacking: its change → what the motion has otherwise."""
        return Candidate(
            name, lambda c, tol, end: Truth(problem, end, tolerance=tol, **changed(c)),
            share(name), starts,
        )  # fmt: skip

    if file is not None:
        yield from _of_file(evidence, file)
        yield from _of_motions(evidence, file)
    size = float(np.abs(problem.M).max()) * evidence.scale["a"]
    for one in further_forces(problem, size, evidence.scale["v"], file):
        there = lacking(one.name, partial(_multiple, one.of), one.starts)
        rank = _LAST if one.last else 0
        yield replace(there, said=one.said or there.said, holds=one.holds, rank=rank)
    moving = [*rates(problem, file.document)] if file else []
    for name, term in terms(problem, moving):
        there = lacking(name, partial(_multiple, partial(opposite, term)), (-1.0, -2.0))
        yield replace(there, rank=_TERM)
    for name, coupling in couplings(problem, moving):
        there = lacking(name, partial(_more_mass, coupling), (-1.0, -2.0))
        yield replace(there, rank=_TERM)
    for name, at_rest in unturned(problem, file):
        there = lacking(name, partial(_at_rest, at_rest), (1.0,))
        yield replace(there, said=partial(_only, name), rank=_TERM, holds=is_whole)
    right = not any(evidence.elsewhere(part) for part in ("u", "v"))
    driven = file is not None and file.document.get("motions")
    for key, of in {"κ": lambda c: (1 + c, 1.0), "motions": lambda c: (1.0, 1 + c)}.items():
        if key == "motions" and not driven:
            continue
        name = TERMS[key]
        yield lacking(name, partial(_less_curved, of, False), (-1.0, -2.0))
        if right:
            yield lacking(f"{name} in λ", partial(_less_curved, of, True), (-1.0, -2.0))
    for k in _curved(evidence) if right else ():
        name = f"κ of {problem.constraint_names[k]} in λ"
        yield lacking(name, partial(_less_of_one, np.arange(problem.m) == k), (-1.0, -2.0))
    if evidence.start is None:
        yield lacking("the start's velocities", lambda c: {"v0": problem.v0 * (1 + c)}, (-1.0,))


def _multiple(force: Force, c: float) -> dict[str, Any]:
    """A further force."""
    return {"force": lambda t, u, v: c * force(t, u, v)}


def _more_mass(mass: MassOf, c: float) -> dict[str, Any]:
    """A further part of M."""
    return {"mass": lambda t, u: c * mass(t, u)}


def _at_rest(of: Unturned, c: float) -> dict[str, Any]:
    """A share of J in other axes."""
    return {"mass": lambda t, u: c * of.mass(t, u), "force": lambda t, u, v: c * of.force(t, u, v)}


def _only(text: str, c: float) -> str:
    return text


def _less_curved(
    of: Callable[[float], tuple[float, float]], recovered: bool, c: float
) -> dict[str, Any]:
    """Other factors of κ."""
    return {"curvature": of(c), "recovered": recovered}


def _less_of_one(only: Mask, c: float) -> dict[str, Any]:
    """Another κ of one constraint, of which λ comes."""
    return {"curvature": (tuple((1 + c * only).tolist()), 1.0), "recovered": True}


def _curved(evidence: SeriesErrors) -> IndexArray:
    """Constraints with a κ at the end of the motion, where there are several."""
    there = {part: of[-1] for part, of in evidence.reference[-1].items()}
    kappa = evidence.problem.constraint_derivatives(evidence.end, there["u"], there["v"])[1]
    found = np.flatnonzero(np.abs(kappa) > _MISFIT * np.abs(kappa).max(initial=0.0))
    return found if len(found) > 1 else found[:0]


def _of_motions(evidence: SeriesErrors, file: FileNumbers) -> Iterator[Candidate]:
    """Numbers of motions, with which a mechanism also starts otherwise."""

    def driven(path: Path, start: Any, c: float, tolerance: float, end: float) -> Truth:
        # It starts as its first row says, or projected.
        moving = replace(file, document={**file.document, "project_velocities": True})
        other = moving.changed([path], lambda value: _times(value, c))
        u0, v0 = start or (None, None)
        return Truth(other, end, u0=u0, v0=v0, force=file.push, tolerance=tolerance)

    begins = [None] if evidence.start is None else [evidence.start, None]
    for path, start in itertools.product(file.motions(), begins):
        yield Candidate(joined(path), partial(driven, path, start), share(joined(path)))


def _of_file(evidence: SeriesErrors, file: FileNumbers) -> Iterator[Candidate]:
    """Each number of a file, phases that it leaves out, and all numbers of a kind together."""
    right = evidence.problem

    def moved(
        paths: Sequence[Path],
        change: Callable[[Any, float], Any],
        c: float,
        tolerance: float,
        end: float,
    ) -> Truth:
        # The start is that of the right mechanism: a table may say otherwise in its first row.
        if c < -1 and paths[0][-1] in _POSITIVE:
            less = file.changed(paths, lambda value: _times(value, LEFT_OUT - 1))
            term = difference(file.mechanism, less)
            return Truth(right, end, force=lambda t, u, v: c * term(t, u, v), tolerance=tolerance)
        try:
            other = file.changed(paths, lambda value: change(value, c))
        except InputError:
            if "inertia" not in paths[0]:
                raise
            # Below 0 no file has it, as where a parallel-axis term is missing: M is linear in it.
            more = file.changed(paths, lambda value: change(value, _LITTLE)).M - file.mechanism.M
            more *= c / _LITTLE
            return Truth(right, end, mass=lambda t, u: more, tolerance=tolerance)
        if np.abs(other.constraint_values(right.t0, right.u0)).max(initial=0.0) > _MISFIT:
            raise NoMotion("the start misses a constraint")
        return Truth(other, end, u0=right.u0, v0=right.v0, force=file.push, tolerance=tolerance)

    def number(
        paths: Sequence[Path], change: Callable[[Any, float], Any] = _times, name: str = "",
        said: Callable[[float], str] | None = None, starts: Sequence[float] = (-1.0, -2.0),
    ) -> Candidate:  # fmt: skip
        name = name or joined(paths[0])
        return Candidate(name, partial(moved, paths, change), said or share(name), starts)

    alike: dict[str, list[Path]] = {}
    for path in file.numbers():
        key, name, value = str(path[-1]), joined(path), file.at(path)
        if value == 0:  # a component of a centre
            yield number([path], _plus, said=partial("{} {:+.5g} m".format, name), starts=())
            continue
        alike.setdefault(key, []).append(path)
        inert = ("mass" in path or "inertia" in path) and key not in _PRODUCTS
        yield number([path], starts=(-1.0,) if inert else (-1.0, -2.0))
        if isinstance(value, Mapping):
            products = [(*path, of) for of in _PRODUCTS if of in value]
            yield number(products, name=f"every product of {name}")
        if key == "inertia" and isinstance(value, list | tuple):
            for i, j in itertools.combinations(range(3), 2):
                said = partial(_exchanged, name, "xyz"[i], "xyz"[j])
                yield number([path], partial(_mixed, i, j), said(1.0), said, (1.0,))
        if key == "gravity" and len(value) == 2:
            yield number([path], _rotated, "the direction of gravity",
                         lambda c: f"gravity turned by {math.degrees(c):.4g}°",
                         (math.pi / 2, -math.pi / 2))  # fmt: skip
        for axis in _across(value) if key == "gravity" and len(value) == 3 else ():
            said = partial(_said_turned, value, axis)
            yield number([path], partial(_turned_about, axis), f"gravity about {'xyz'[axis]}",
                         said, (math.pi / 2, -math.pi / 2))  # fmt: skip
        if key == "inertia" and any((body := file.at(path[:-1])).get("centre") or ()):
            said = partial("{} with {:.4g} times its parallel-axis term besides".format, name)
            yield number([path], partial(_besides, body), f"{name}, parallel axes", said,
                         (1.0, -1.0))  # fmt: skip
        if key == "frequency":
            phase = (*path[:-1], "phase")
            said = partial("{} + {:.5g} rad".format, joined(phase))
            yield number([phase], _plus, "", said, (math.pi / 2, math.pi))
    for path in file.loads():
        yield number([path], _scaled)
    for name, place, point in _on_bodies(file.document):
        said = partial(_counted, f"bodies.{name}.centre counted", place)
        counted = number([("bodies", name, "centre")], partial(_further, point), said(1.0), said,
                         (1.0, -1.0))  # fmt: skip
        yield replace(counted, rank=_PLACE, holds=lambda c: is_whole(abs(c)))
    for key in _ALIKE:
        if len(paths := alike.get(key, [])) > 1:
            yield number(paths, name=f"every {key}", starts=(-1.0,) if key == "damping" else ())
    for path in file.places():
        said = partial("{} {:+.5g} m".format, joined(path))
        turned = (-2 * file.at(path),) if file.at(path) else ()
        yield replace(number([path], _plus, "", said, turned), rank=_PLACE)


def _on_bodies(document: Mapping[str, Any]) -> Iterator[tuple[str, str, Sequence[float]]]:
    """Body in space, place on it, and where that is in its axes (m)."""
    if document.get("dimensions") != 3:
        return
    for name, joint in (document.get("joints") or {}).items():
        at = joint.get("at")
        for body in document["bodies"].keys() & (at if isinstance(at, Mapping) else ()):
            yield body, f"joints.{name}", at[body]
    for name, point in (document.get("body_points") or {}).items():
        yield point["on"], f"body_points.{name}", point["at"]


def _further(point: Sequence[float], value: Sequence[float] | None, c: float) -> list[float]:
    """A place, further by c times a vector."""
    return [x + c * y for x, y in zip(value or [0.0] * len(point), point, strict=True)]


def _counted(what: str, place: str, c: float) -> str:
    return f"{what} from {place}" if c > 0 else f"{what} towards the origin from {place}"


def _plus(value: Any, c: float) -> Any:
    return (value or 0.0) + c


def _times(value: Any, c: float) -> Any:
    """A number, or each of several, times 1 + c."""
    if isinstance(value, Mapping):
        return {key: item * (1 + c) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [item * (1 + c) for item in value]
    return value * (1 + c)


def _scaled(value: Any, c: float) -> Any:
    """A load of several numbers times 1 + c."""
    if isinstance(value, Mapping):
        return {key: _scaled(item, c) if key in SIZES else item for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_scaled(item, c) for item in value]
    return value * (1 + c) if isinstance(value, int | float) else value


def _rotated(value: Sequence[float], c: float) -> list[float]:
    """A vector in the plane, turned by c (rad)."""
    x, y = value
    return [x * math.cos(c) - y * math.sin(c), x * math.sin(c) + y * math.cos(c)]


def _across(vector: Sequence[float]) -> Iterator[int]:
    """Axes about which a vector in space can be turned."""
    yield from (k for k in range(3) if any(x for i, x in enumerate(vector) if i != k))


def _turned_about(axis: int, value: Sequence[float], c: float) -> list[float]:
    """A vector in space, turned about an axis by c (rad)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = [*value]
    turned[i], turned[j] = _rotated((value[i], value[j]), c)
    return turned


def _said_turned(value: Sequence[float], axis: int, c: float) -> str:
    there = ", ".join(f"{round(x, 4) + 0.0:g}" for x in _turned_about(axis, value, c))
    return f"gravity turned by {math.degrees(c):.4g}° about {'xyz'[axis]}, to [{there}]"


def _besides(body: Mapping[str, Any], inertia: Any, c: float) -> Any:
    """An inertia with c times what it is more about the origin of its body."""
    centre = np.array(body["centre"], float)
    term = c * body["mass"] * (centre @ centre * np.eye(len(centre)) - np.outer(centre, centre))
    if not isinstance(inertia, list | tuple | Mapping):
        return inertia + float(term[0, 0] + term[-1, -1])
    given = inertia if isinstance(inertia, Mapping) else dict(zip(_MOMENTS, inertia, strict=True))
    places = itertools.combinations_with_replacement(range(3), 2)
    return {
        "xyz"[i] + "xyz"[j]: given.get("xyz"[i] + "xyz"[j], 0.0) + float(term[i, j])
        for i, j in places
    }


def _mixed(i: int, j: int, value: Sequence[float], c: float) -> list[float]:
    """Numbers of which a share c of two is exchanged."""
    values = [*value]
    values[i] += c * (value[j] - value[i])
    values[j] += c * (value[i] - value[j])
    return values


def _exchanged(name: str, one: str, other: str, c: float) -> str:
    what = f"{name} about {one} and {other}"
    return f"{what} exchanged" if abs(c - 1) < 1e-3 else f"a share of {c:.5g} of {what} exchanged"


def share(name: str) -> Callable[[float], str]:
    """Share of a number by which it differs → what it is then."""
    return lambda c: (
        f"{name} left out" if abs(c + 1) < 1e-3
        else f"{name} with its sign turned" if abs(c + 2) < 1e-3
        else f"{name} × {1 + c:.5g}"
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class FittedChange:
    """What a candidate leaves."""

    worst: float  #: largest, over what an explanation may leave
    mean: float  #: part of the whole error
    beyond: float  #: largest, over what the cause itself may leave
    change: float
    candidate: Candidate


class Discrepancy:
    """What the smallest step size is off by, weighted by what truncation may leave."""

    def __init__(
        self, evidence: SeriesErrors, without: Sequence[str] = (), share: float = 1.0
    ) -> None:
        run = evidence.runs[-1]
        rows = evidence.looked_at(run)
        rows = rows[evidence.settled(run)[rows]] if evidence.settled(run)[rows].any() else rows
        rows = rows[: math.ceil(share * len(rows))]
        self._end = evidence.end if share == 1 else float(run.t[rows[-1]])
        self.evidence, self._rows, self._without = evidence, rows, without
        self.unsure = {x: 2 * evidence.bound(x) for x in PARTS if evidence.has[x]}
        self.parts = [
            x for x in PARTS
            if evidence.has[x] and x not in without
            and (x != "lambda" or self.unsure[x] < max(1e-3, 0.6 * evidence.last(x)[-1]))
        ]  # fmt: skip
        self.off = off = {x: evidence.error(x, -1)[rows] for x in self.parts}
        largest = {x: float(np.abs(of).max()) for x, of in off.items()}
        self.largest = max(largest.values())
        weight = {x: 1 / max(self.unsure[x], _SLACK * largest[x], 1e-15) for x in self.parts}
        self._met = WeightedRows(evidence, rows, weight)
        self.all = self._met.stacked(off)
        self.size = float(np.linalg.norm(self.all))
        surely = {x: max(self.unsure[x], _SURE * _SLACK * largest[x], 1e-15) for x in off}
        self._surely = self._met.stacked({x: np.full_like(of, surely[x]) for x, of in off.items()})
        least, most = (EXACT, 1e-8) if share == 1 else (1e-10, 1e-6)
        self.tolerance = float(np.clip(1e-4 * self.largest, least, most))
        right = Truth(evidence.problem, self._end, tolerance=self.tolerance)
        self._right = self._met.values(right)

    def moved(self, candidate: Candidate, c: float) -> Array:
        """By how much a change moves all rows; huge if no mechanism can have it."""
        try:
            moved = self._met.values(candidate.of(c, self.tolerance, self._end)) - self._right
        except (ArithmeticError, InputError, np.linalg.LinAlgError, NoMotion):
            return np.full_like(self.all, 1e9)
        return np.where(np.isfinite(moved), moved, 1e9)

    def fitted(self, candidate: Candidate, near: float) -> FittedChange:
        """A change by Gauss and Newton, with secants; given up early where it leads away."""
        c, delta = near, 1e-3
        here = self.moved(candidate, c) if c else np.zeros_like(self.all)
        best = FittedChange(*self._left(here), c, candidate)
        for step in range(12):
            there = self.moved(candidate, c + delta)
            slope = (there - here) / delta
            if not slope.any() or np.abs(there).max() >= 1e9:
                break
            if step or near:
                c, here = c + delta, there
                if (fit := FittedChange(*self._left(here), c, candidate)).mean < best.mean:
                    best = fit
                elif step > 2:
                    break
            left = self.all - here
            delta = float(slope @ left / (slope @ slope))
            gained = float(np.linalg.norm(left - delta * slope))
            if step == 0 and gained > 0.9 * self.size and abs(delta) < 0.05:
                break  # a small change, for which the slope tells all
            if step > 2 and best.mean > 0.5:
                break
            delta = float(np.clip(delta, -0.4, 0.4))
            if abs(delta) < 1e-6 * max(1e-3, abs(c)):
                break
        return best

    def _left(self, moved: Array) -> tuple[float, float, float]:
        left = np.abs(self.all - moved)
        mean = float(np.linalg.norm(left)) / max(self.size, 1e-300)
        return float(left.max()), mean, float((left / self._surely).max())

    def search(self, file: FileNumbers | None) -> list[FittedChange]:
        """What each candidate leaves, the best first."""
        fits: list[FittedChange] = []
        every = list(candidates(self.evidence, file))
        moves = any(self.evidence.elsewhere(part) for part in ("u", "v"))
        ranks = (0, _PLACE, _LAST, _TERM) if moves else (0,)
        rounds = [(False, rank) for rank in ranks]
        if self.largest > 0.02 and moves:
            rounds.insert(2, (True, 0))
        early = self._early()
        for k, (far, rank) in enumerate(rounds):
            tried = [(one, 0.0) for one in every if one.rank == rank]
            if early and len(tried) > _KEPT:
                first = [fit for one, _ in tried for fit in early.tried(one, 0.0, far)]
                first.sort(key=lambda fit: fit.mean)
                tried = [(fit.candidate, fit.change) for fit in first[:_KEPT]]
            fits += [fit for one, near in tried for fit in self.tried(one, near, far)]
            best = min(fits, key=lambda fit: fit.worst, default=None)
            if not best or best.beyond >= _EXPLAINS:
                continue  # what leaves more may only be near the cause
            # A rest length is also that of a spring which is held elsewhere along its line.
            if k or "rest_length" not in best.candidate.name:
                break
        return sorted(fits, key=lambda fit: fit.worst)

    def tried(self, candidate: Candidate, near: float, far: bool) -> list[FittedChange]:
        """A change fitted from where it is known to be near, or from the best of those to try."""
        least = 0.6 if far else 0.3
        starts = () if near else _SCAN if far else candidate.starts
        for c in starts if self.largest > 1e-4 else ():
            if (left := self._left(self.moved(candidate, c))[1]) < least:
                near, least = c, left
        if far and not near:
            return []
        fit = self.fitted(candidate, near)
        return [fit] if candidate.holds(fit.change) else []

    def _early(self) -> "Discrepancy | None":
        """The first part of the motion, where that tells candidates apart."""
        early = Discrepancy(self.evidence, self._without, _EARLY)
        clear = early._met.stacked({x: np.full_like(of, _CLEAR * self.unsure[x])
                                    for x, of in early.off.items()})  # fmt: skip
        several = len(early._rows) > 1 and len(early._rows) < len(self._rows)
        return early if several and (np.abs(early.all) > clear).any() else None

    def converges(self) -> bool:
        """Whether differences of successive step sizes fall, or are small against the error."""
        return all(self.evidence.falls(part) for part in self.parts)

    def holds(self, fit: FittedChange) -> bool:
        """Whether a change is what explains the smallest h, and also λ that was not fitted.

        The start of the table may explain all of it without the change.  λ may be too rough to be
        fitted; then it must not be further from the changed mechanism's than from the right one's.
        """
        if self._left(self.moved(fit.candidate, 0.0))[0] < _EXPLAINS or self._falls(fit):
            return False
        if "lambda" in self.parts or "lambda" in self._without or not self.evidence.has["lambda"]:
            return True
        run, part = self.evidence.runs[-1], "lambda"
        there = self._solved(fit).at(run.t[self._rows])[part]
        left = self.evidence.of(part, run.state[part][self._rows] - there)
        now = self.evidence.error(part, -1)[self._rows]
        allowed = max(_EXPLAINS * self.unsure[part], 1.2 * float(np.abs(now).max()))
        return bool(np.abs(left).max() <= allowed)

    def _solved(self, fit: FittedChange) -> Truth:
        return fit.candidate.of(fit.change, self.tolerance, self._end)

    def _falls(self, fit: FittedChange) -> bool:
        """Whether the next larger step size asks for a larger change: then no number differs."""
        runs = self.evidence.runs[-2:]
        if len(runs) < 2:
            return False
        rows = self.evidence.looked_at(runs[0])
        t = runs[0].t[rows]
        now, then = self.evidence.truth.at(t), self._solved(fit).at(t)
        moved = {x: self.evidence.of(x, then[x] - now[x]) / self.unsure[x] for x in self.parts}
        missed = {x: self.evidence.error(x, -2)[rows] / self.unsure[x] for x in self.parts}
        effect, off = (
            np.concatenate([of[x].ravel() for x in self.parts]) for of in (moved, missed)
        )
        asked = float(effect @ off) / max(float(effect @ effect), 1e-300)
        return asked > 1 + _FOLLOWS * (runs[0].size / runs[1].size - 1)

    def seen(self) -> str:
        """That it converges elsewhere, in numbers."""
        points = ", ".join(
            f"{SYMBOLS[x]} by {self.evidence.last(x)[-1]:.2g} ({self.unsure[x] / 2:.1g})"
            for x in self.parts
        )
        size = "h" if self.evidence.told.steps else "tolerance"
        return (f"the runs converge to another solution: the smallest {size} is off in {points}; "
                "in parentheses is what truncation may leave")  # fmt: skip


def explained_by(fits: Sequence[FittedChange]) -> list[FittedChange]:
    """Those that explain all, if any, numbers before places; a much better one stands alone."""
    good = [fit for fit in fits if fit.worst < _EXPLAINS and fit.mean < _IN_THE_MEAN]
    near = [fit for fit in good if fit.worst < 4 * good[0].worst + 0.3]
    best: dict[str, FittedChange] = {}
    for fit in sorted(near, key=lambda fit: fit.candidate.rank):
        best.setdefault(fit.candidate.name, fit)
    return [*best.values()]
