"""What the runs of a series are off by, at every row, and how much of it has no cause.

Errors are relative to the largest value of their part along the motion, λ to that of each
constraint.  Printing, rounding and truncation may leave some of them: a cause is sought for what
is above.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.newmark.integrator import Integrator, fading
from newmark_cli.support.arrays import Array, IndexArray, Mask

if TYPE_CHECKING:
    from newmark_cli.codes.reading import Run
    from newmark_cli.codes.solutions import Measured
    from newmark_cli.codes.truth import Truth

PARTS = ("u", "v", "lambda")
#: What messages call them.
SYMBOLS = {"u": "u", "v": "v", "lambda": "λ"}
#: Rounding of a march of ours, times this, is what another code may leave: of the method that is
#: named, and of one that nobody names.
_LIKE, _UNLIKE = 30, 300
#: Samples of the motion that sizes are taken from, and numbers whose digits are counted.
_SAMPLES, _COUNTED = 60, 400
#: What may be left of a damped alternation of λ where λ is looked at.
_FADED = 1e-2
#: Orders that differences may have.
_POWERS = np.linspace(1, 5, 81)
#: Part of the error before that a converged one exceeds.
_STILL = 0.3
#: Truncation, over the size of a part, from which on nothing tells where runs converge to.
_COARSE = 0.05
#: Of what differences of successive step sizes fall to, and of which part of the error they may do
#: as they like.
_FALLS, _NEGLIGIBLE = 0.8, 2e-3
#: Least error of λ with which it converges elsewhere by itself.
_OF_MULTIPLIERS = 1e-5
_EPS = float(np.finfo(float).eps)
#: Rows of a run that an explanation must meet.
_LOOKED_AT = 8


@dataclass(frozen=True)
class Finding:
    """What a symptom says.

    Attributes:
        name: A word or two, the same for all series.
        series: Label of the series.
        text: What is seen, what it comes from, and what to do.
        fault: Whether something is wrong; else it is a note.
        evidence: Numbers behind it.
    """

    name: str
    series: str
    text: str
    fault: bool = True
    evidence: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Told:
    """What the caller says of a code.

    Attributes:
        integrator: Its integrator; None where nobody says it.
        formulation: First word of its formulation; empty where nobody says it.
        corrected: Whether it begins from a corrected start, off the rates of the constraints.
        steps: Whether runs differ in a step size, not in a tolerance.
    """

    integrator: Integrator | None
    formulation: str
    corrected: bool = False
    steps: bool = True

    @property
    def order(self) -> int:
        """Order of the integrator; 0 where nobody says it."""
        return self.integrator.order if self.integrator else 0

    @property
    def damped(self) -> bool:
        """Whether a named integrator damps multipliers that alternate."""
        return self.integrator is not None and self.integrator.damped


def digits_of(numbers: Array) -> tuple[int, int]:
    """Most significant digits, and most decimal places, of the shortest decimals of numbers."""
    digits, places = 0, 0
    for text in map(repr, np.abs(numbers).tolist()):
        mantissa, _, power = text.partition("e")
        whole, _, decimals = mantissa.partition(".")
        decimals = decimals.rstrip("0")
        digits = max(digits, len((whole + decimals).strip("0")))
        places = max(places, len(decimals) - int(power or 0))
    return digits, places


def printed(runs: Sequence["Run"], part: str, t0: float) -> float:
    """What printing leaves of a number, over the size of its part.

    Args:
        runs: Runs of a series.
        part: "u", "v" or "lambda".
        t0: Time of the start (s), whose numbers do not count.
    """
    numbers = np.concatenate([run.state[part][run.t > t0].ravel() for run in runs])
    numbers = np.abs(numbers[np.isfinite(numbers) & (numbers != 0)])[-_COUNTED:]
    digits, places = digits_of(numbers)
    if not digits or digits >= 16:
        return 1e-16
    size = float(numbers.max())
    return max(10.0**-places, 10.0 ** (math.ceil(math.log10(size)) - digits)) / size


def is_single(numbers: Array) -> bool:
    """Whether all are numbers of single precision, as they are or printed with 9 digits.

    Zeros, what has three decimals, and what does not change are of any.
    """
    telling = numbers[np.isfinite(numbers)]
    telling = telling[telling != np.round(telling, 3)]
    with np.errstate(over="ignore"):
        single = telling.astype(np.float32)
    same = telling == single
    # Nine digits tell all numbers of single precision apart, and codes print no more of them.
    same[~same] = np.char.mod("%.9g", single[~same]).astype(float) == telling[~same]
    return len(np.unique(telling)) > 2 and bool(same.all())


def order_of(h: Array, gaps: Array, clear: Mask) -> float:
    """Order of which differences of successive step sizes are, the median over pairs of them.

    Of x = x∞ + c h^p the differences are c (h_i^p − h_j^p).

    Args:
        h: (k,) step sizes, descending.
        gaps: (k − 1,) differences.
        clear: (k − 1,) of them, which are above what printing and rounding leave.
    """
    steps = h[:-1, None] ** _POWERS - h[1:, None] ** _POWERS
    orders = [
        _POWERS[np.abs(np.log(steps[i] / steps[i + 1] * gaps[i + 1] / gaps[i])).argmin()]
        for i in np.flatnonzero(clear[:-1] & clear[1:])
    ]
    return float(np.median(orders)) if orders else math.nan


class SeriesErrors:
    """One series as the rules see it.

    Args:
        measured: Its runs that ended, twins aside, by descending sizes.
        told: What the caller says of the code.
        truth: The solution, until after the last row of any run.

    Attributes:
        runs: Runs that arrive, and in ``measured`` what was measured of them.
        h: (k,) step sizes, descending.
        stopped: Step sizes of runs that end long before the others.
        scale: Part → its largest value along the motion; of λ (m,).
        reference: Of each run, the solution at its rows.
        known: Part → (size,) components that all runs have at their ends.
        has, whole: Part → whether there are any, and whether these are all.
        single: Parts of which every number is one of single precision.
        resolution: Part → what printing leaves of a number, over the size of its part.
    """

    def __init__(self, measured: Sequence["Measured"], told: Told, truth: "Truth") -> None:
        self.problem, self.told, self.truth = truth.problem, told, truth
        self.t0, self.end = truth.problem.t0, max(float(of.run.t[-1]) for of in measured)
        step = max(of.run.size for of in measured) if told.steps else 0.1 * (self.end - self.t0)
        self.measured = [of for of in measured if of.run.t[-1] > self.end - 1.5 * step]
        self.runs = [of.run for of in self.measured]
        self.stopped = [of.run.size for of in measured if of.run.t[-1] <= self.end - 1.5 * step]
        self.h = np.array([run.size for run in self.runs])
        along = truth.at(np.linspace(self.t0, self.end, _SAMPLES))
        self.scale: dict[str, Any] = {
            part: float(np.abs(along[part]).max()) or 1.0 for part in ("u", "v", "a")
        }
        sizes = np.abs(along["lambda"]).max(axis=0)
        self.scale["lambda"] = np.maximum(sizes, 1e-3 * sizes.max(initial=0.0)) + 1e-300
        self.reference = [truth.at(run.t) for run in self.runs]
        self.known = {
            part: np.all([np.isfinite(run.state[part][-1]) for run in self.runs], axis=0)
            for part in PARTS
        }
        self.has = {part: bool(known.any()) for part, known in self.known.items()}
        self.whole = {part: bool(known.size and known.all()) for part, known in self.known.items()}
        self._fading = fading(told.integrator) if told.integrator else 0.0
        # Round numbers are of any precision, and so is the start.
        after = {part: [run.state[part][run.t > self.t0].ravel() for run in self.runs]
                 for part in PARTS}  # fmt: skip
        self.single = [part for part in PARTS if is_single(np.concatenate(after[part]))]
        self.resolution = {part: printed(self.runs, part, self.t0) for part in PARTS}

    def finding(self, name: str, text: str, fault: bool = True, **numbers: Any) -> Finding:
        """A finding on the series."""
        return Finding(name, self.runs[-1].series, text, fault, numbers)

    def ours(self, k: int, quantity: str, measure: str = "error") -> float:
        """What a march of this tool's with the step size of a run leaves; NaN where unknown."""
        row = self.measured[k].ours.get((measure, quantity))
        return row.statistics.max if row else math.nan

    def error(self, part: str, run: int) -> Array:
        """(rows, size) by how much a run is off."""
        return self.of(part, self.runs[run].state[part] - self.reference[run][part])

    def of(self, part: str, values: Array) -> Array:
        """(rows, known) values of the components that the table has, over their size."""
        return np.asarray((values / self.scale[part])[..., self.known[part]])

    def last(self, part: str) -> Array:
        """(k,) largest error at the end of each run."""
        return np.array([np.abs(self.error(part, k)[-1]).max() for k in range(len(self.runs))])

    def floor(self, part: str) -> Array:
        """(k,) what printing and rounding may leave of the last error."""
        rows = [of.errors.get(("error", part)) for of in self.measured]
        rounding = np.array([row.statistics.rounding if row else math.nan for row in rows])
        rounding = np.nan_to_num(rounding) * (_LIKE if self.told.integrator else _UNLIKE)
        power = {"u": 0, "v": 1, "lambda": 2}[part]
        steps = (self.end - self.t0) / self.h
        least = 1e-13 * (1 + (1e-3 * steps) ** power) + _EPS * steps
        return np.asarray(np.maximum(np.maximum(rounding, 3 * self.resolution[part]), least))

    def bound(self, part: str) -> float:
        """Error that truncation may leave at the smallest h.

        It is that of order 1, or of the order on which differences of successive step sizes agree;
        two differences, with the integrator that is named.
        """
        h, gaps = self._gaps(part)
        if not len(gaps):
            return math.inf
        left = gaps / (h[:-1] / h[1:] - 1) * h[-1] / h[1:]
        bound, floor = float(left[-2:].max()), float(self.floor(part)[-1])
        found = [order_of(h[i : i + 3], gaps[i : i + 2], gaps[i : i + 2] > 0)
                 for i in range(len(gaps) - 1)]  # fmt: skip
        if len(found) == 1 and self.told.order:
            found.append(float(self.told.order))
        agree = len(found) == 2 and abs(found[0] - found[1]) < 0.3 and found[1] > 1.3
        if agree and (gaps > 3 * floor).all():
            p = min(found) - 0.3
            bound = min(bound, 1.5 * gaps[-1] * h[-1] ** p / (h[-2] ** p - h[-1] ** p))
        return bound + floor

    def _gaps(self, part: str) -> tuple[Array, Array]:
        """Smallest step sizes with ends at one time, and differences of these ends."""
        ends = np.array([run.t[-1] for run in self.runs])
        same = np.flatnonzero(np.abs(ends - ends[-1]) < 0.1 * self.h[-1])[-4:]
        states = [self.runs[k].state[part][-1] for k in same]
        gaps = [np.abs(self.of(part, one - other)).max() for one, other in pairwise(states)]
        return self.h[same], np.array(gaps)

    def falls(self, part: str) -> bool:
        """Whether differences of successive step sizes fall, where they are not negligible."""
        _, gaps = self._gaps(part)
        small = max(float(self.last(part)[-1]) * _NEGLIGIBLE, 3 * float(self.floor(part)[-1]))
        return bool(len(gaps) < 2 or gaps[-1] < max(_FALLS * gaps[-2], small))

    def elsewhere(self, part: str) -> bool:
        """Whether it converges, to something that is not the solution."""
        if not self.has[part] or len(self.runs) < 2:
            return False
        last, bound = self.last(part), self.bound(part)
        factor = 3 if len(self.runs) > 2 else 10
        # Multipliers scatter by more than differences of two step sizes tell.
        least, factor = (_OF_MULTIPLIERS, 3 * factor) if part == "lambda" else (0.0, factor)
        away = last[-1] > max(factor * bound, least) and last.min() > 0.3 * last[-1]
        # What still falls has not arrived: differences may show a higher order than is left.
        away = away and last[-1] > _STILL * last[-2]
        return bool(away and bound < _COARSE)

    def order(self, part: str) -> tuple[float, float]:
        """Order over the smallest step sizes above the floors, and how far local ones scatter.

        NaN and infinity of fewer than three such step sizes.
        """
        if not self.has[part]:
            return math.nan, math.inf
        last = self.last(part)
        at = np.flatnonzero(last > 3 * self.floor(part))[-4:]
        if len(at) < 3 or (np.diff(at) > 1).any():
            return math.nan, math.inf
        local = np.diff(np.log(last[at])) / np.diff(np.log(self.h[at]))
        slope = float(np.polyfit(np.log(self.h[at]), np.log(last[at]), 1)[0])
        return slope, float(np.ptp(local[-2:]) + abs(local[-1] - local.mean()))

    def misfit(self, run: int, rate: bool = False) -> Array:
        """(rows, m) Φ_k over the size of u and over |G_k| in the last row; Φ′ over that of v.

        |G_k| may change along the motion, and another length is missed by the same Φ_k.
        """
        of, problem, missed = self.runs[run], self.problem, []
        for t, u, v in zip(of.t, of.state["u"], of.state["v"], strict=True):
            if rate:
                begun = problem.constraint_derivatives(t, u, v)[0]
                missed.append(problem.gradient(t, u).T @ v + begun)
            else:
                missed.append(problem.constraint_values(t, u))
        G = problem.gradient(of.t[-1], of.state["u"][-1])
        size = self.scale["v" if rate else "u"] * np.maximum(np.linalg.norm(G, axis=0), 1e-300)
        return np.asarray(np.array(missed).reshape(-1, problem.m) / size)

    def implied(self, run: int) -> Array:
        """(rows, m) λ that u and v imply."""
        of = self.runs[run]
        rows = zip(of.t, of.state["u"], of.state["v"], strict=True)
        return np.array([self.truth.solved(t, u, v)[1] for t, u, v in rows])

    def off_implied(self, run: int) -> Array:
        """(rows, m) by how much λ misses what u and v imply, over its size."""
        off = self.runs[run].state["lambda"] - self.implied(run)
        return np.asarray(off / self.scale["lambda"])

    def settled(self, run: "Run") -> Mask:
        """Rows at which λ has forgotten the first steps, of which integrators may miss some."""
        late = np.asarray(run.t > self.t0 + max(0.1 * (self.end - self.t0), 2.5 * run.size))
        faded = late & np.array([self.fades(run, float(t)) < _FADED for t in run.t])
        return faded if faded.any() else late

    def looked_at(self, run: "Run") -> IndexArray:
        """Rows after the start that an explanation must meet."""
        rows = np.flatnonzero(run.t > self.t0 + 0.5 * self.step_of(run))
        places = np.round(np.linspace(0, len(rows) - 1, _LOOKED_AT)).astype(int)
        return np.asarray(rows[np.unique(places)])

    def step_of(self, run: "Run") -> float:
        """Step size (s) of a run; 0 of one with a tolerance."""
        return run.size if self.told.steps else 0.0

    def fades(self, run: "Run", t: float) -> float:
        """Part of an alternation at the start that a named integrator leaves at a time (s)."""
        steps = (t - self.t0) / run.size
        return float(max(1.0, steps**2) * self._fading**steps)

    @cached_property
    def start(self) -> tuple[Array, Array] | None:
        """Start (n,) u and v in the row of t = 0, where it has all of them."""
        run = self.runs[-1]
        if abs(run.t[0] - self.t0) > 1e-11 or not (self.whole["u"] and self.whole["v"]):
            return None
        return run.state["u"][0], run.state["v"][0]


class WeightedRows:
    """Rows of the smallest step size that an explanation must meet, in one vector.

    Args:
        evidence: The series.
        rows: Their numbers.
        weight: Part that counts → what its errors are times.
    """

    def __init__(
        self, evidence: SeriesErrors, rows: IndexArray, weight: Mapping[str, float]
    ) -> None:
        self.times = evidence.runs[-1].t[rows]
        self._evidence, self._weight = evidence, weight

    def stacked(self, of: Mapping[str, Array]) -> Array:
        """Part → (rows, known), in one vector."""
        return np.concatenate([(of[part] * by).ravel() for part, by in self._weight.items()])

    def values(self, truth: "Truth") -> Array:
        """A motion at these rows, in one vector."""
        there = truth.at(self.times)
        return self.stacked({part: self._evidence.of(part, there[part]) for part in self._weight})
