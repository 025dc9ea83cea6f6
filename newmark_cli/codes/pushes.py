"""Which change of a step explains errors of order 1, at all rows.

To first order in h an integrator solves M a = f + G λ + h w: each change of a step has its push
w(t), and its effect on the motion is that of a further force, or of another start.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from newmark_cli.codes.changes import TERMS
from newmark_cli.codes.evidence import SYMBOLS, Finding, SeriesErrors, WeightedRows
from newmark_cli.codes.truth import Truth
from newmark_cli.problems.index_1 import Index1
from newmark_cli.support.arrays import Array, IndexArray

#: An order that is 1, and how far local orders may scatter.
_OFF, _SCATTER = 0.2, 0.35
#: Times at which pushes are sampled; part of a motion over which they are differences.
_GRID, _APART = 400, 1e-6
#: First steps, of the next larger size, that are not looked at.
_FIRST = 3.5
#: What an explanation may leave of u and v; others must leave more than so many times as much.
_LEAVES, _WORSE = 0.15, 3.0
#: Times more that one of two changes that are alike may leave.
_ALIKE = 2.0

_SAYS = {
    "averaging":
        "accelerations are averaged with weights that are off by {c:.3g} "
        "(γ − ½ of Newmark, γ − ½ + α_m − α_f of generalized-α)",
    "old force":
        "f is that of t {sign} {size:.3g} h: forces are taken at the wrong end of the step",
    "old force/velocities": "forces take the velocities of t {sign} {size:.3g} h",
    "old force/positions": "forces take the positions of t {sign} {size:.3g} h",
    "old force/time": "forces take the time t {sign} {size:.3g} h",
    "old force/G": "G is that of the step before",
    "old force/both": "f and G are those of the step before",
    "a(0)":
        "the first step lacks {c:.3g} h a(0): the integration does not begin from the a of "
        "M a = f + G λ, Gᵀa + κ = 0; solve that system for a and λ at t = 0",
    "κ":
        "accelerations lack κ of Gᵀa + κ = 0 (centrifugal terms), which projections make good "
        "to order 1 only",
    "motions":
        "accelerations lack that of the motions, which projections make good to order 1 only",
    "backward Euler": "it is what backward Euler does",
    "forward Euler": "it is what forward Euler does",
}  # fmt: skip
#: Changes with a number that is fitted, and its bounds; that of others is 1.
_FREE = {
    "averaging": (-3.0, 3.0), "a(0)": (0.05, 1.5), "old force": (-1.5, 2.5),
    "old force/velocities": (-1.5, 2.5), "old force/positions": (-1.5, 2.5),
    "old force/time": (-1.5, 2.5), "κ": (0.05, 1.5), "motions": (0.05, 1.5),
}  # fmt: skip
#: How near to 1 a fitted number is 1.
_WHOLE = 0.03


@dataclass(frozen=True, eq=False)
class _Tried:
    name: str
    left: float  #: part of u and v that it leaves
    c: float

    @property
    def plain(self) -> bool:
        """Whether it explains without a number that is fitted."""
        return self.name not in ("averaging", "a(0)", *TERMS) and self.c == 1.0

    def worse(self, best: "_Tried") -> bool:
        """Whether it leaves so much more than the best that it is no rival."""
        margin = 0.0 if best.plain and not self.plain else 0.02
        return self.left > _WORSE * best.left + margin


def first_order(evidence: SeriesErrors) -> Iterator[Finding]:
    """Errors like h, and the change of a step that explains them.

    A fault only where the method that the caller names has a higher order.
    """
    told = evidence.told
    if told.integrator is not None and told.order < 2:
        return
    orders = {part: evidence.order(part) for part in ("u", "v")}
    low = {part: order for part, (order, scatter) in orders.items()
           if abs(order - 1) < _OFF and scatter < _SCATTER}  # fmt: skip
    if not low or any(order > 1.5 and scatter < _SCATTER for order, scatter in orders.values()):
        return
    fault = told.order > 1
    said = " and ".join(f"{SYMBOLS[part]} has order {order:.2f}" for part, order in low.items())
    tried = sorted(_tried(evidence), key=lambda x: (x.left > 0.05 or not x.plain, x.left))
    seen = {one.name: {"leaves": one.left, "c": one.c} for one in tried[:4]}
    numbers = {"orders": low, "tried": seen}
    good = [one for one in tried if one.left < _LEAVES]
    if good and all(x.worse(good[0]) for x in tried if not _same(good[0], x)):
        best = _likeliest(good)
        sign = "−" if best.c > 0 else "+"
        says = _SAYS[best.name].format(c=best.c, sign=sign, size=abs(best.c))
        hint = "" if fault else "; if your method has order 2, this is what is wrong with it"
        text = f"{said}: {says}; this explains all but {best.left:.1%} of u and v at all rows{hint}"
        yield evidence.finding(best.name.partition("/")[0], text, fault, left=best.left, **numbers)
        return
    wanted = f", where the method has {told.order}" if fault else ""
    hint = "" if fault else "; if your method has order 2, something of the step is wrong"
    text = f"{said}{wanted}; no change of a step that was tried explains it alone{hint}"
    yield evidence.finding("order 1" if fault else "seen", text, fault, **numbers)


def _likeliest(good: Sequence[_Tried]) -> _Tried:
    """Of changes that leave as much: one without a number that is fitted, or a weight that is off.

    M ȧ and the rate of a force are alike where forces drive the motion, and nobody writes forces of
    t − 0.19 h.
    """
    rivals = [one for one in good if not one.worse(good[0])]
    plain = [one for one in rivals if one.plain]
    weights = [one for one in rivals if one.name == "averaging"]
    return (plain or weights or rivals)[0]


def _same(one: _Tried, other: _Tried) -> bool:
    """Whether two are one change, where one of them has a free number or is part of the other."""
    names = {one.name.partition("/")[0], other.name.partition("/")[0]}
    if "averaging" in names and names & {"backward Euler", "forward Euler"}:
        # Weights that are off by about 1 are those of Euler's methods, but for the first step.
        return max(one.left, other.left) < _ALIKE * min(one.left, other.left)
    # Nobody writes forces of t − 0.3 h.
    forces = [x for x in (one, other) if x.name == "old force" and (x is other or not x.plain)]
    return one is other or (bool(forces) and names <= {"old force", "averaging"})


def _pushes(evidence: SeriesErrors, grid: Array) -> dict[str, Array]:
    """Name → (k, n) force over h, at the times of a grid."""
    problem, way = evidence.problem, evidence.truth.at(grid)
    late = _APART * (evidence.end - evidence.t0)

    def pure(t: float, u: Array, v: Array) -> Array:
        return problem.free_values(t, u, v).force

    rows = [*zip(grid, way["u"], way["v"], way["a"], strict=True)]
    now = np.array([pure(t, u, v) for t, u, v, _ in rows])
    of = {
        "old force/velocities": [pure(t, u, v - late * a) for t, u, v, a in rows],
        "old force/positions": [pure(t, u - late * v, v) for t, u, v, _ in rows],
        "old force/time": [pure(max(t - late, evidence.t0), u, v) for t, u, v, _ in rows],
    }
    pushes = {name: (np.array(then) - now) / late for name, then in of.items()}
    largest = max(float(np.abs(push).max()) for push in pushes.values())
    pushes = {name: push for name, push in pushes.items() if np.abs(push).max() > 1e-6 * largest}
    # Of one part alone the whole is the same.
    whole = sum(pushes.values(), start=np.zeros_like(now))
    pushes = (pushes if len(pushes) != 1 else {}) | {"old force": whole}
    gradients = np.array([problem.gradient(t, u) for t, u, *_ in rows])
    turning = np.gradient(gradients, grid, axis=0)
    pushes["old force/G"] = -np.einsum("tnm,tm->tn", turning, way["lambda"])
    pushes["old force/both"] = whole + pushes["old force/G"]
    for name, curvature in {"κ": (0.0, 1.0), "motions": (1.0, 0.0)}.items():
        # What they lack is at right angles to the constraints, and those turn in a step.
        lacks = Truth(problem, evidence.end, curvature=curvature, recovered=True)
        missed = way["lambda"] - lacks.at(grid)["lambda"]
        pushes[name] = np.einsum("tnm,tm->tn", turning, missed)
    pushes["averaging"] = np.gradient(way["a"], grid, axis=0) @ problem.M
    size = np.abs(pushes["averaging"]).max()
    return {name: push for name, push in pushes.items() if np.abs(push).max() > 1e-9 * size}


def _leading(evidence: SeriesErrors) -> tuple[IndexArray, dict[str, Array]]:
    """Rows of the smallest step size, and part → errors over h there as h goes to 0.

    They are those that the next larger step size has, too, and terms of order 2 are taken out;
    where it has none of them, all.  First steps have errors of their own.
    """
    coarse, fine = evidence.runs[-2:]
    rows = evidence.looked_at(fine)
    settled = fine.t[rows] > evidence.t0 + _FIRST * coarse.size
    rows = rows[settled] if settled.any() else rows
    places = np.abs(coarse.t[:, None] - fine.t[rows]).argmin(axis=0)
    alike = np.abs(coarse.t[places] - fine.t[rows]) < 1e-6 * fine.size
    share = fine.size / (coarse.size - fine.size) if alike.any() else 0.0
    if share:
        rows, places = rows[alike], places[alike]
    leading = {}
    for part in (part for part in ("u", "v") if evidence.has[part]):
        now = evidence.error(part, -1)[rows] / fine.size
        leading[part] = now + share * (now - evidence.error(part, -2)[places] / coarse.size)
    return rows, leading


def _tried(evidence: SeriesErrors) -> list[_Tried]:
    """Each change with the part of u and v that it leaves."""
    problem, none, h = evidence.problem, np.zeros(evidence.problem.m), float(evidence.h[-1])
    rows, off = _leading(evidence)
    every = evidence.looked_at(evidence.runs[-1])
    most = {part: float(np.abs(evidence.error(part, -1)[every]).max()) for part in off}
    weight = {part: h / (size or h) for part, size in most.items()}
    met = WeightedRows(evidence, rows, weight)
    wanted, right, small = met.stacked(off), met.values(evidence.truth), 1e-3 * h

    def effect(**changed: Any) -> Array:
        return (met.values(Truth(problem, evidence.end, **changed)) - right) / small

    grid = np.linspace(evidence.t0, evidence.end, _GRID)
    effects: dict[str, Array] = {}
    for name, push in _pushes(evidence, grid).items():
        further = make_interp_spline(grid, small * push, k=1)
        effects[name] = effect(force=lambda t, u, v, further=further: further(t))
    start = evidence.t0, problem.u0, problem.v0
    a0, _ = evidence.truth.solved(*start)
    # The part of a(0) that the constraints allow, which is M a less what they take of it.
    mass_times_a = np.concatenate([problem.M @ a0, none])
    free = Index1(problem).solution(problem.values(*start, none).g, mass_times_a)[: problem.n]
    effects["a(0)"] = effect(v0=problem.v0 - small * free)
    if "averaging" in effects:
        a = evidence.reference[-1]["a"][rows]
        shift = {part: 0.5 * evidence.of(part, a) * (part == "v") for part in off}
        # ü = f(u, u̇ − h a/2) + h ȧ, and v = u̇ − h a/2.
        backward = effects["averaging"] - 0.5 * effects["a(0)"] - met.stacked(shift)
        backward += 0.5 * effects.get("old force/velocities", 0.0)
        effects |= {"backward Euler": backward, "forward Euler": -backward}
    tried: list[_Tried] = []
    for name, slope in effects.items():
        low, high = _FREE.get(name, (1.0, 1.0))
        c = float(slope @ wanted) / max(float(slope @ slope), 1e-300) if name in _FREE else 1.0
        if name != "averaging" and abs(c - 1) < _WHOLE:
            c = 1.0
        if slope.any() and low <= c <= high:
            tried.append(_Tried(name, float(np.abs(wanted - c * slope).max()), c))
    return tried
