"""Finds the units, signs, order and factors in which another code writes its state.

What is unambiguous is undone and said.  A factor of λ that comes from another Φ is a finding,
and λ is judged without it.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from newmark_cli.codes.measuring import Motion
from newmark_cli.codes.reading import Run, Runs, changed
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import Reference
from newmark_cli.support.arrays import Array, IndexArray

#: How well a factor must fit, and the part of the runs that it must fit.
_FITS, _SHARE = 0.02, 0.4
#: The same where it fits other constraints, as a part of the factor's logarithm.
_NEAR = 0.25
#: Components below this part of the largest tell nothing.
_TELLING = 1e-3
#: Units of length and time that people use, over m and s.
_UNITS = {1e3: "mm", 1e2: "cm", 1e-3: "km", 39.37007874: "inches", 3.280839895: "feet"}


@dataclass(frozen=True)
class Factor:
    """By what λ of a constraint is too large.

    Attributes:
        series: Label of the series.
        constraint: Its name.
        value: The factor, at the smallest step size.
        why: What gives such a factor.
    """

    series: str
    constraint: str
    value: float
    why: str


def matched(runs: Runs, motion: Motion) -> tuple[Runs, list[Factor]]:
    """The runs in the mechanism's units, signs and order, and factors of λ that are faults."""
    factors: list[Factor] = []
    for series in dict.fromkeys(run.series for run in runs.runs):
        if ends := _ends(runs, series, motion):
            runs = _in_units(runs, series, ends)
    for series in dict.fromkeys(run.series for run in runs.runs):
        if (ends := _ends(runs, series, motion)) and motion.problem.m:
            runs = _in_order(runs, series, ends, motion.problem)
            runs, faults = _scaled(runs, series, _ends(runs, series, motion), motion.problem)
            factors += faults
    return runs, factors


def _ends(runs: Runs, series: str, motion: Motion) -> list[tuple[Run, Reference]]:
    """Runs of a series that ended, and the solution where they did."""
    ended = [run for run in runs.runs if run.series == series and run.ended]
    return [(run, motion.at(float(run.t[-1]))) for run in ended]


def _in_units(runs: Runs, series: str, ends: Sequence[tuple[Run, Reference]]) -> Runs:
    """Coordinates and velocities in m and m/s, where all of them have one other unit."""
    for part in ("u", "v"):
        factors = []
        for run, reference in ends:
            here, there = run.state[part][-1], getattr(reference, part)
            telling = np.isfinite(here) & (np.abs(there) > _TELLING * np.abs(there).max())
            if telling.any():
                ratios = here[telling] / there[telling]
                if np.ptp(ratios) <= 0.2 * abs(np.median(ratios)):
                    factors.append(float(np.median(ratios)))
        for factor, unit in _UNITS.items():
            if factors and abs(np.median(factors) / factor - 1) < _FITS:
                runs = changed(
                    runs,
                    partial(_divided, series, part, factor),
                    f"{series}: {part} is {factor:g} times as large, and taken to be in {unit}"
                    f"{'/s' if part == 'v' else ''}",
                )
    return runs


def _divided(series: str, part: str, factor: float, run: Run) -> Mapping[str, Array]:
    return {part: run.state[part] / factor} if run.series == series else {}


def _ratios(ends: Sequence[tuple[Run, Reference]], order: IndexArray | None = None) -> Array:
    """(runs, m) λ over the reference's; NaN of those that tell nothing."""
    rows = []
    for run, reference in ends:
        theirs, there = run.state["lambda"][-1], reference.multipliers
        if order is not None:
            theirs = theirs[order]
        telling = np.abs(there) > _TELLING * reference.scales
        with np.errstate(divide="ignore", invalid="ignore"):
            rows.append(np.where(telling, theirs / there, np.nan))
    return np.array(rows)


def _agree(ratios: Array, value: float) -> bool:
    """Whether enough runs have a ratio."""
    telling = ratios[np.isfinite(ratios)]
    near = np.abs(telling - value) < _FITS * abs(value)
    return bool(len(telling) and near.sum() >= max(1, math.ceil(_SHARE * len(telling))))


def _in_order(
    runs: Runs, series: str, ends: Sequence[tuple[Run, Reference]], problem: Problem
) -> Runs:
    """Multipliers in the mechanism's order, where exactly one order and signs fit."""
    m = problem.m
    ratios = _ratios(ends)
    fitting = [_agree(np.abs(ratios[:, k]), 1.0) or not np.isfinite(ratios[:, k]).any()
               for k in range(m)]  # fmt: skip
    if all(fitting) or m == 1 or not np.isfinite(ends[-1][0].state["lambda"][-1]).all():
        return runs
    candidates = []
    for k in range(m):
        of_k = _ratios(ends, np.full(m, k))  # column k of theirs over each of ours
        candidates.append([j for j in range(m) if _agree(np.abs(of_k[:, j]), 1.0)])
    # Theirs k is ours candidates[k]: unambiguous if each has one, and all are different.
    if any(len(matches) != 1 for matches in candidates):
        return runs
    places = np.array([matches[0] for matches in candidates])
    if len(set(places.tolist())) < m:
        return runs
    order = np.argsort(places)
    names = ", ".join(problem.constraint_names[j] for j in places)
    return changed(
        runs,
        lambda run: {"lambda": run.state["lambda"][:, order]} if run.series == series else {},
        f"{series}: multipliers are in the order {names}",
    )


def _scaled(
    runs: Runs, series: str, ends: Sequence[tuple[Run, Reference]], problem: Problem
) -> tuple[Runs, list[Factor]]:
    """Multipliers with the mechanism's signs and without factors, and what these were."""
    ratios = _ratios(ends)
    right = [
        float(np.nanmax(np.abs(run.state["u"][-1] - there.u), initial=0.0))
        < _FITS * float(np.abs(there.u).max())
        for run, there in ends
    ]
    divisors, unexplained = np.ones((len(ends), problem.m)), list[int]()
    faults, turned = list[Factor](), list[str]()
    for k, name in enumerate(problem.constraint_names):
        of_k = np.where(right, ratios[:, k], np.nan)
        if _agree(of_k, 1.0) or not np.isfinite(of_k).any():
            continue
        if _agree(of_k, -1.0):
            divisors[:, k] = -1.0
            turned.append(name)
            continue
        if (explained := _explained(of_k, problem, ends, k)) is None:
            unexplained.append(k)
        else:
            divisors[:, k], why = explained
            faults.append(Factor(series, name, float(divisors[-1, k]), why))
    if len({factor.why for factor in faults}) == 1 and not turned:
        # Of the rest it is the same where it is by far nearer than none.
        common = divisors[:, [problem.constraint_names.index(faults[0].constraint)]].ravel()
        for k in unexplained:
            telling = np.flatnonzero(np.isfinite(ratios[:, k]))
            size, factor = np.abs(ratios[telling[-1], k]), np.abs(common[telling[-1]])
            if size > 0 and abs(math.log(size / factor)) < _NEAR * abs(math.log(factor)):
                divisors[:, k] = common
                name = problem.constraint_names[k]
                faults.append(replace(faults[0], constraint=name, value=float(common[-1])))
    # What vanishes in the motion tells nothing: it goes with the others, where these agree.
    silent = ~np.isfinite(np.where(np.array(right)[:, None], ratios, np.nan)).any(axis=0)
    others = divisors[:, ~silent]
    if others.size and np.all(others == others[:, :1]):
        divisors[:, silent] = others[:, :1]
    if np.all(divisors == 1):
        return runs, faults
    of_size = {run.size: row for (run, _), row in zip(ends, divisors, strict=True)}
    last = divisors[-1]
    note = f"{series}: the sign of λ is turned, of {', '.join(turned)}" if turned else ""
    return changed(
        runs,
        lambda run: {"lambda": run.state["lambda"] / of_size.get(run.size, last)}
        if run.series == series else {},
        *filter(None, [note]),
    ), faults  # fmt: skip


def _explained(
    ratios: Array, problem: Problem, ends: Sequence[tuple[Run, Reference]], k: int
) -> tuple[Array, str] | None:
    """(runs,) what a factor that explains the ratios of λ_k divides by, and why."""
    sizes = np.array([run.size for run, _ in ends])
    for value, power, why in _factors(problem, ends, k):
        if _agree(ratios / sizes**power, value) or _agree(ratios / sizes**power, -value):
            return np.sign(np.nanmedian(ratios)) * value * sizes**power, why
    return None


def _factors(
    problem: Problem, ends: Sequence[tuple[Run, Reference]], k: int
) -> list[tuple[float, int, str]]:
    """Factors that λ may have, powers of h that go with them, and why."""
    _, reference = ends[-1]
    values = problem.values(problem.t0 + reference.t, reference.u, reference.v, np.zeros(problem.m))
    mask = problem.pattern.g_columns == k
    rows, entries = problem.pattern.g_rows[mask], values.g[mask]
    axes = len(problem.axes) if len(problem.axes) == 2 else 3
    points: dict[int, float] = {}
    for row, entry in zip(rows.tolist(), entries.tolist(), strict=True):
        points[row // axes] = points.get(row // axes, 0.0) + entry * entry
    length = math.sqrt(max(points.values(), default=0.0))
    factors = [(0.5, 0, "Φ is twice as large, such as |Δ|² − L² instead of half of it"),
             (2.0, 0, "Φ is half as large")]  # fmt: skip
    if abs(length - 1) > 2 * _FITS and length > 0:
        # First, since a length of 2 or ½ explains the same factor in one bar only.
        factors.insert(0, (length, 0, "Φ is a length, |Δ| − L instead of ½(|Δ|² − L²)"))
    powers: Mapping[int, str] = {
        2: "λ is scaled by h², and was not scaled back",
        1: "λ is an impulse, force times h",
        -2: "λ is divided by h²",
    }
    scales = ((1.0, ""), (0.25, " times β = 1/4"), (0.5, " times ½"))
    factors += [(value, power, why + more) for (power, why), (value, more)
              in itertools.product(powers.items(), scales)]  # fmt: skip
    return factors
