"""What is wrong with a code, told from what its runs are off by; each finding with its evidence.

Every rule looks at one symptom of one series.  They come in the order in which causes hide each
other: numbers, clock and start first, then the motion, the constraints, and λ last.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from newmark_cli.external.matching import Factor
from newmark_cli.external.measuring import (
    SAME_TIME,
    Measured,
    Motion,
    method,
    misfits_at,
    roundings,
)
from newmark_cli.external.reading import STEP_SIZE, Run, Runs, few_digits
from newmark_cli.newmark import integrator
from newmark_cli.newmark.forms import INDEX_3
from newmark_cli.problems import multipliers
from newmark_cli.problems.index_1 import Index1
from newmark_cli.report.judging.fits import format_order, power_law
from newmark_cli.support.arrays import Array, Mask

#: Rounding over value below which a point counts; points that an order is read from.
_CLEAR, _POINTS = 0.1, 4
#: Orders that are those of what does not fall, and how far others may be off.
_STALLED, _OFF = 0.3, 0.35
#: Relative misfits of Φ: what single precision leaves, and over those of a sound march what is
#: no rounding.
_SINGLE, _ROUNDINGS = (2e-9, 1e-4), 1e3
#: Least misfit of Φ that is none of double precision.
_DOUBLE = 1e-12
#: Largest error of u with which a motion is the one that was wanted; orders of a drift.
_RIGHT, _DRIFTS = 0.1, (1.3, 2.5)
#: Distance of two runs over that from the solution, below which they have converged.
_AGREE = 0.1
#: Errors of u that no step size should have, and the power of h with which a blow-up goes.
_WRECKED, _BLOWN_UP = 10.0, -4.0
#: Change of v in the first step over h a(0), that is missing; relative misfits of a start.
_FIRST, _START = 0.05, 1e-9
#: Misses of an equation of motion, relative to its largest term, that are no truncation.
_MISSED = 3e-3
#: Iterations that are many, and the part of the steps in which they are.
_MANY, _OFTEN = 8, 0.1
#: Corrections in a step, more than a sound march has, that tell of linear convergence.
_MORE, _SLOW = 3, 1.6
#: Last rows at which an alternation is looked for.
_LAST = 20
#: Factors over the error of a sound march: of what does not fall, and of noise, which another
#: integrator or solver may make larger.
_LIKE, _UNLIKE = 30.0, 1e4


@dataclass(frozen=True)
class Finding:
    """What a symptom says.

    Attributes:
        name: A word or two, the same for all series.
        series: Label of the series.
        text: What is seen, what it comes from, and what to do.
        fault: Whether something is wrong; else it is a limit of any code of the kind.
        evidence: Numbers behind it.
    """

    name: str
    series: str
    text: str
    fault: bool = True
    evidence: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Case:
    """One series as the rules see it.

    Attributes:
        label: Label of the series.
        how: Axis → value of its method.
        found: Its runs that ended, by descending sizes.
        runs: All of its runs, twins and those that failed included.
        motion: Solutions of the problem.
        table: The whole table.
    """

    label: str
    how: Mapping[str, str]
    found: Sequence[Measured]
    runs: Sequence[Run]
    motion: Motion
    table: Runs

    @property
    def h(self) -> Array:
        """(k,) step sizes, descending."""
        return np.array([each.run.size for each in self.found])

    def has(self, *names: str) -> bool:
        """Whether all runs have these quantities: ``"u"`` of an error, others of an invariant."""
        return bool(self.found) and all(
            _key(n) in each.errors for each in self.found for n in names
        )

    def values(self, name: str, ours: bool = False, end: bool = False) -> Array:
        """(k,) the largest; of a march of this tool's if `ours`, NaN where there is none.

        At the last row only if `end`.
        """
        rows = [(each.ours if ours else each.errors).get(_key(name)) for each in self.found]
        statistic = "last" if end else "max"
        return np.array(
            [math.nan if row is None else getattr(row.statistics, statistic) for row in rows]
        )

    def clear(self, name: str) -> Mask:
        """(k,) where rounding does not matter; all where nobody knows it."""
        unsure = np.nan_to_num(roundings(self.found, _key(name)))
        values = self.values(name)
        return np.isfinite(values) & (values > 0) & (unsure < _CLEAR * values)

    def order(self, name: str, end: bool = False) -> float:
        """Order over the smallest step sizes that are clear; NaN of fewer than three."""
        at = np.flatnonzero(self.clear(name))[-_POINTS:]
        if len(at) < 3:
            return math.nan
        return power_law(self.h[at], self.values(name, end=end)[at]).slope

    def stalls(self, name: str) -> bool:
        """Whether it does not fall over the three smallest clear step sizes."""
        at = np.flatnonzero(self.clear(name))[-3:]
        return len(at) == 3 and abs(power_law(self.h[at], self.values(name)[at]).slope) < _STALLED

    @property
    def order_wanted(self) -> int:
        """Order of its integrator."""
        return integrator.parse(self.how["integrator"]).order


def _key(name: str) -> tuple[str, str]:
    invariants = ("position", "velocity", "multiplier", "energy")
    return ("invariant" if name in invariants else "error", name)


def diagnosed(
    runs: Runs,
    found: Sequence[Measured],
    motion: Motion,
    options: Mapping[str, Any],
    factors: Sequence[Factor] = (),
) -> list[Finding]:
    """Findings on every series.

    Args:
        runs: The table.
        found: Its runs, measured.
        motion: Solutions of the problem.
        options: Axis → value of the method where the table does not say it.
        factors: Factors of λ that were found.
    """
    every: list[Finding] = []
    for label in dict.fromkeys(run.series for run in runs.runs):
        of = [each for each in found if each.run.series == label]
        own = [run for run in runs.runs if run.series == label]
        case = Case(label, method({**options, **own[-1].method}), of, own, motion, runs)
        told: list[Finding] = []
        for rule in _RULES:
            if rule in _OF_STEPS and runs.abscissa != STEP_SIZE:
                continue
            told += rule(case, {each.name for each in told})
        scales: dict[tuple[str, str], list[str]] = {}
        for factor in factors:
            if factor.series == label:
                of_factor = scales.setdefault((factor.why, f"{factor.value:.4g}"), [])
                of_factor.append(factor.constraint)
        told += [
            Finding("factor of λ", label,
                    f"λ of {', '.join(names)} is off by a factor of {value} at the "
                    "smallest h: "
                    f"{why}; it is judged without", evidence={"factor": float(value)})
            for (why, value), names in scales.items()
        ]  # fmt: skip
        every += told
    return every


def _told(case: Case, name: str, text: str, fault: bool = True, **evidence: Any) -> Finding:
    return Finding(name, case.label, text, fault, evidence)


# -- runs, numbers, clock, start --------------------------------------------------------------


def _failures(case: Case, told: set[str]) -> Iterator[Finding]:
    failed = [run for run in case.runs if not run.ended]
    if failed:
        sizes = ", ".join(f"{run.size:g}" for run in failed)
        said = next((run.message for run in failed if run.message), "")
        lacks = ", ".join(dict.fromkeys(name for run in failed for name in run.lacks[:3]))
        because = (
            f": the code says “{said}”" if said else f": no number for {lacks} in the last row"
        )
        yield _told(case, "failure", f"no result at {case.table.abscissa} = {sizes}{because}",
                    sizes=[run.size for run in failed])  # fmt: skip


def _printed(case: Case, told: set[str]) -> Iterator[Finding]:
    if case.table.single:
        yield _told(case, "single precision", "every number of the state is one of single "
                    "precision: compute and print in double precision")  # fmt: skip
    elif few_digits(case.table):
        digits = case.table.digits
        yield _told(case, "few digits", f"numbers have at most {digits} digits, so that errors "
                    f"below 1e-{digits} are those of printing: print 17, as %.17g does",
                    digits=digits)  # fmt: skip


def _clock(case: Case, told: set[str]) -> Iterator[Finding]:
    ends = np.array([run.t[-1] for run in case.runs if run.ended])
    sizes = np.array([run.size for run in case.runs if run.ended])
    if not len(ends):
        return
    off = np.abs(ends - np.round(ends / sizes) * sizes) / np.maximum(ends, sizes)
    place = int(np.argmax(off))
    # A step size that was printed in short ends at the same time as all others.
    alike = np.ptp(ends) <= 1e-9 * ends.max() and len(ends) > 1
    if off[place] > 1e-9 and not alike and off[place] * ends[place] < 0.4 * sizes[place]:
        single = " in single precision" if 1e-9 < off[place] < 1e-3 else ""
        yield _told(case, "clock", f"t = {ends[place]:.9g} is {off[place] * ends[place]:.2g} s off "
                    f"whole steps of h = {sizes[place]:g}: t or h is summed up{single}; take "
                    "t = k h in double precision", off=float(off[place] * ends[place]))  # fmt: skip


def _start(case: Case, told: set[str]) -> Iterator[Finding]:
    problem = case.motion.problem
    for run in case.runs:
        at = np.flatnonzero(np.abs(run.t - problem.t0) <= SAME_TIME)
        if not len(at) or run.twin:
            continue
        row = int(at[0])
        missed = misfits_at(problem, run, row)
        for name, what in (("position", "Φ"), ("velocity", "Gᵀv + Φ_t")):
            if name in missed:
                size = float(missed[name].sizes.max()) or 1.0
                if missed[name].error > max(_START, _floor(case)) * size:
                    worst = problem.constraint_names[int(np.argmax(np.abs(missed[name].errors)))]
                    unit = "m" if name == "position" else "m/s"
                    yield _told(
                        case, "start off its constraints",
                        f"the start misses {what} = 0 by {missed[name].error:.2g} {unit} "
                        f"({worst}): it is damped away or not, but early steps and λ are wrong",
                        misfit=missed[name].error,
                    )  # fmt: skip
                    return
        for part, there in (("u", problem.u0), ("v", problem.v0)):
            here = run.state[part][row]
            size = float(np.abs(there).max())
            off = np.where(np.isfinite(here), np.abs(here - there), 0.0)
            if off.max() > max(_START, _floor(case)) * max(size, _START):
                name = problem.coordinate_names[int(np.argmax(off))]
                yield _told(
                    case, "another start",
                    f"the start differs from the problem's: {part}[{name}] = "
                    f"{here[np.argmax(off)]:.9g}, there {there[np.argmax(off)]:.9g}",
                    difference=float(off.max()),
                )  # fmt: skip
                return
        return


def _floor(case: Case) -> float:
    """Relative size of what printing, or single precision, leaves of a number."""
    digits = case.table.digits if few_digits(case.table) else None
    return 10.0 ** (1 - digits) if digits else 1e-6 if case.table.single else 0.0


def _first_step(case: Case, told: set[str]) -> Iterator[Finding]:
    """What the first step adds to v, over h a(0), and its λ: wrong where a(0) was not computed."""
    if {"start off its constraints", "another start", "another mechanism", "single precision",
            "few digits", "alternation"} & told:  # fmt: skip
        return
    if case.order_wanted < 2 or (case.has("velocity") and case.order("velocity", end=True) < 1.5):
        return  # of a method of order 1 the first step is off by as much
    problem = case.motion.problem
    start = case.motion.at(problem.t0)
    a, _ = Index1(problem).accelerations(problem.t0, start.u, start.v)
    size = float(np.linalg.norm(a))
    missing: dict[str, list[tuple[float, float]]] = {"v": [], "λ": []}
    for each in case.found:
        run = each.run
        at = np.flatnonzero(np.abs(run.t - problem.t0 - run.size) <= 1e-6 * run.size)
        if not len(at):
            continue
        if size and np.isfinite(run.state["v"][at[0]]).all():
            change = (run.state["v"][at[0]] - start.v) / run.size
            missing["v"].append((run.size, float(np.linalg.norm(change - a)) / size))
        if off := misfits_at(problem, run, int(at[0])).get("multiplier"):
            # Where λ begins at 0, what it grows to.
            scales = np.maximum(multipliers.weights_at_start(problem).scales(off.sizes),
                                case.motion.at(float(run.t[-1])).scales)  # fmt: skip
            missing["λ"].append((run.size, float(np.abs(off.errors / scales).max())))
    # λ of an undamped integrator is off throughout.
    for of in ("v", "λ") if integrator.parse(case.how["integrator"]).damped else ("v",):
        sizes, parts = np.array(missing[of][-_POINTS:]).reshape(-1, 2).T
        if len(parts) > 1 and _FIRST < parts[-1] < 2.0 and power_law(sizes, parts).slope < _STALLED:
            seen = {"v": "v has changed by h a(0) less", "λ": "λ is off by"}[of]
            yield _told(
                case, "inconsistent a(0)",
                f"after the first step {seen} {parts[-1]:.0%} at every h, down to h = "
                f"{sizes[-1]:g}: the integration does not begin from the a of M a = f + G λ, "
                "Gᵀa + κ = 0; solve that system for a and λ at t = 0",
                missing=float(parts[-1]),
            )  # fmt: skip
            return


# -- the motion -------------------------------------------------------------------------------


def _blow_up(case: Case, told: set[str]) -> Iterator[Finding]:
    if not case.has("u") or {"clock"} & told:
        return
    with np.errstate(over="ignore"):
        u = case.values("u")
    last = u[-1]
    if math.isfinite(last) and last < _WRECKED:
        return
    finite = u[np.isfinite(u) & (u > 0)]
    grows = len(finite) < len(u) or (len(finite) > 1 and finite[-1] > 10 * finite[0])
    if grows:
        yield _told(
            case, "blow-up",
            f"u is {'not finite' if not math.isfinite(last) else f'{last:.1g} times its size off'} "
            f"at h = {case.h[-1]:g}, and smaller h makes it worse: the method is unstable for "
            "constrained motion, as with a γ that does not go with β (β ≥ (γ + ½)²/4, γ ≥ ½; "
            "generalized-α: γ = ½ − α_m + α_f)",
            error=float(last),
        )  # fmt: skip


def _shifted(case: Case) -> float:
    """Time (s) by which the last state is that of another time; NaN where it is not."""
    run = case.found[-1].run
    there = case.motion.at(float(run.t[-1]))
    problem = case.motion.problem
    a, _ = Index1(problem).accelerations(float(run.t[-1]), there.u, there.v)
    off, rate = run.state["u"][-1] - there.u, there.v
    of_v = run.state["v"][-1] - there.v
    if not np.isfinite([*off, *of_v]).all() or not rate.any() or not a.any():
        return math.nan
    shift = float(off @ rate / (rate @ rate))
    left = np.linalg.norm(off - shift * rate) / np.linalg.norm(off)
    of_rate = np.linalg.norm(of_v - shift * a) / max(float(np.linalg.norm(of_v)), 1e-300)
    return shift if left < 0.05 and of_rate < 0.05 else math.nan


def _other_motion(case: Case, told: set[str]) -> Iterator[Finding]:
    if {"blow-up", "clock", "few digits", "another start"} & told or not case.has("u"):
        return
    error, h = float(case.values("u")[-1]), float(case.h[-1])
    if len(case.found) < 2 or not case.clear("u")[-1]:
        return
    # It converges if two step sizes agree with each other far better than with the solution.
    (*_, coarse, fine), there = case.found, case.motion.at(float(case.found[-1].run.t[-1]))
    apart = np.nanmax(np.abs(coarse.run.state["u"][-1] - fine.run.state["u"][-1]))
    if apart > _AGREE * error * np.abs(there.u).max():
        return
    shift = _shifted(case)
    if math.isfinite(shift):
        yield _told(case, "another time", f"u stays {error:.2g} off at every h, by what it "
                    f"moves in {shift:.2g} s: the states are those of another time, as with a "
                    "step size in single precision", shift=shift)  # fmt: skip
        return
    where = _equations(case)
    text = f"u converges, to a motion that is {error:.2g} off (h = {h:g})"
    if where:
        yield _told(case, "another mechanism", f"{text}: {where}", error=error)
    elif case.has("multiplier") and case.stalls("multiplier"):
        yield _told(case, "another mechanism", f"{text}, and λ is not what u and v imply with the "
                    "mechanism's masses and forces: a mass, an inertia or a force differs",
                    error=error)  # fmt: skip
    elif case.has("multiplier"):
        yield _told(case, "another start", f"{text}, while λ is what u and v imply: the start "
                    "differs, or the time", error=error)  # fmt: skip
    else:
        yield _told(case, "another mechanism", f"{text}: a mass, a force, a length or the start "
                    "differs; with λ in the table more could be said", error=error)  # fmt: skip


def _equations(case: Case) -> str:
    """Whose equations of motion the last rows miss, and by which mass that would be explained."""
    problem = case.motion.problem
    for each in reversed(case.found):
        run = each.run
        if len(run.t) < 3 or np.ptp(np.diff(run.t[-3:])) > 1e-6 * run.size:
            continue
        u, v, forces = (run.state[part][-3:] for part in ("u", "v", "lambda"))
        if not np.isfinite(np.concatenate([u, v, forces], axis=1)).all():
            continue
        t = float(run.t[-2])
        a = (v[2] - v[0]) / (run.t[-1] - run.t[-3])
        inertia, force = problem.M @ a, problem.evaluate(t, u[1], v[1], forces[1]).force
        left = inertia - force  # f + G λ
        size = max(np.abs(inertia).max(), np.abs(force).max())
        # What differences in time leave: the same of the solution's neighbours would be as large.
        a_near = np.abs((v[2] - 2 * v[1] + v[0]) / run.size).max() / max(np.abs(a).max(), 1e-300)
        if np.abs(left).max() < max(_MISSED, 3 * a_near) * size:
            continue
        missed = np.flatnonzero(np.abs(left) > 0.2 * np.abs(left).max())
        points = list(dict.fromkeys(problem.point_of(int(i)) for i in missed))
        text = (f"the equations of motion of {', '.join(points)} are missed by "
                f"{np.abs(left).max() / size:.2g} of their largest term")  # fmt: skip
        for relative, what in ((a - _fall(problem), "mass"), (a, "inertia, but not the weight,")):
            if share := _as_mass(problem, left, relative):
                return f"{text}, as if the {what} of {share}"
        return f"{text}: a mass, an inertia or a force differs"
    return ""


def _fall(problem: Any) -> Array:
    """Accelerations that gravity gives to what is free."""
    none = np.zeros(problem.m)
    force = problem.evaluate(problem.t0, problem.u0, np.zeros(problem.n), none).force
    fall, *_ = np.linalg.lstsq(problem.M, force, rcond=None)
    return np.asarray(fall)


def _as_mass(problem: Any, left: Array, relative: Array) -> str:
    """The one point, and the factor of its mass, that would explain what is left."""
    best, said = 0.05, ""
    points = dict.fromkeys(problem.point_of(i) for i in range(problem.n))
    for point in points:
        own = np.array([problem.point_of(i) == point for i in range(problem.n)])
        row = np.where(own, np.diag(problem.M) * relative, 0.0)
        if not row.any():
            continue
        share = float(left @ row / (row @ row))
        rest = float(np.linalg.norm(left - share * row) / np.linalg.norm(left))
        if rest < best:
            best, said = rest, f"{point} were {1 - share:.4g} times the mechanism's"
    return said


def _first_order(case: Case, told: set[str]) -> Iterator[Finding]:
    if {"blow-up", "another motion", "few digits", "inconsistent a(0)"} & told:
        return
    if case.order_wanted < 2:
        return
    low = [name for name in ("u", "v") if case.has(name) and abs(case.order(name) - 1) < _OFF]
    if low and not any(case.has(n) and case.order(n) > 2 - _OFF for n in ("u", "v")):
        orders = " and ".join(f"{n} has order {case.order(n):.2f}" for n in low)
        yield _told(
            case, "order 1",
            f"{orders}, where the method has {case.order_wanted}: accelerations are averaged "
            "wrongly, as with γ ≠ ½ (generalized-α: γ ≠ ½ − α_m + α_f), forces are taken at the "
            "wrong end of the step, or the start is not consistent; if the method has order 1, "
            "say so (--integrator)",
            order=case.order(low[0]),
        )  # fmt: skip


# -- the constraints --------------------------------------------------------------------------


def _single(case: Case, told: set[str]) -> Iterator[Finding]:
    if {"few digits", "single precision"} & told:
        return
    if not case.has("position") or case.how["formulation"] != INDEX_3:
        return
    values = case.values("position")
    flat = abs(power_law(case.h, values).slope) < 0.5 if (values > 0).sum() > 2 else False
    noisy = values[-1] > _ROUNDINGS * max(case.values("position", ours=True)[-1], 1e-16)
    if (
        _SINGLE[0] < values[-1] < _SINGLE[1]
        and flat
        and (noisy or math.isnan(case.values("position", ours=True)[-1]))
    ):
        yield _told(case, "single precision", f"Φ vanishes to {values[-1]:.1g} of the coordinates "
                    "at every h, which is rounding of single precision: some of the computation, "
                    "or of the output, is in float", misfit=float(values[-1]))  # fmt: skip


def _drift(case: Case, told: set[str]) -> Iterator[Finding]:
    if {"single precision", "few digits", "blow-up"} & told or not case.has("position"):
        return
    if case.how["formulation"].split()[0] not in (INDEX_3, "ggl", "augmented-lagrangian"):
        return
    values, ours = case.values("position"), case.values("position", ours=True)
    bound = np.where(np.isfinite(ours), np.maximum(_ROUNDINGS * ours, _DOUBLE / 10), _DOUBLE)
    above = values > bound
    if case.has("u"):  # a motion that is wrong altogether says nothing of its constraints
        above &= case.values("u") < _RIGHT
    if not above.any():
        return
    fit = power_law(case.h[above], values[above])
    place = int(np.flatnonzero(above)[-1])
    value, h = float(values[place]), float(case.h[place])
    velocity = case.values("velocity") if case.has("velocity") else np.full(len(values), math.nan)
    multiplier = case.values("multiplier") if case.has("multiplier") else velocity * math.nan
    held = next((name for name, of in (("velocities", velocity), ("accelerations", multiplier))
                 if of[place] < 1e-3 * value or of[place] < 1e-12), "")  # fmt: skip
    if held:
        yield _told(
            case, "drift",
            f"Φ is missed by {value:.2g} of the coordinates at h = {h:g}"
            f"{_grown(case, place)}, and {'Gᵀv' if held == 'velocities' else 'Gᵀa + κ'} by "
            f"rounding: constraints are held at the level of {held} only, so that positions "
            "drift; hold Φ as well (GGL, or a projection), or say that the formulation is "
            f"index-{2 if held == 'velocities' else 1}",
            misfit=value,
        )  # fmt: skip
    elif fit.points < 3 or not _DRIFTS[0] < fit.slope < _DRIFTS[1]:
        yield _told(
            case, "Newton ends early",
            f"Φ is left at {value:.2g} of the coordinates at h = {h:g}"
            + (f" (order {fit.slope:.1f})" if fit.points > 2 else "")
            + ", where an iteration to the end leaves rounding: the test of convergence is met "
            "too soon, as on a correction or residual that shrinks with h²; test what does not, "
            "such as ‖Δu‖ over ‖u‖ to 1e-12, or iterate until corrections grow",
            misfit=value,
        )  # fmt: skip
    else:
        yield _told(case, "drift", f"Φ is missed by {value:.2g} of the coordinates at h = {h:g}"
                    f"{_grown(case, place)} and falls with order {fit.slope:.1f}: it is not among "
                    "the equations that are solved", misfit=value)  # fmt: skip


def _grown(case: Case, place: int) -> str:
    """How the misfit of Φ grows along a trajectory, in words."""
    run, problem = case.found[place].run, case.motion.problem
    at = [row for row in range(len(run.t)) if run.t[row] > 0.1 * run.t[-1]]
    if len(at) < 8:
        return ""
    at = at[:: max(1, len(at) // 40)]
    missed = [misfits_at(problem, run, row)["position"].error for row in at]
    fit = power_law(run.t[at] - problem.t0, np.array(missed))
    near = round(fit.slope)
    return f", like t{'²' if near == 2 else ''}" if near in (1, 2) else ""


# -- λ ----------------------------------------------------------------------------------------


def _alternation(case: Case, told: set[str]) -> Iterator[Finding]:
    """λ − what u and v imply, of opposite signs in successive steps and no smaller with h."""
    if not case.has("multiplier"):
        return
    problem, sizes, seen = case.motion.problem, [], []
    for each in case.found:
        run = each.run
        whole = np.abs(np.diff(run.t) - run.size) < 1e-6 * run.size
        gaps = np.flatnonzero(~whole)
        first = max(int(gaps[-1]) + 1 if len(gaps) else 0, len(run.t) - _LAST)
        off = []
        for row in range(first, len(run.t)):
            missed = misfits_at(problem, run, row).get("multiplier")
            if missed is not None:
                scales = case.motion.at(float(run.t[-1])).scales
                off.append(missed.errors / scales)
        if len(off) < 3 or run.t[first] <= problem.t0:
            continue
        signed = np.array(off)
        worst = signed[:, int(np.argmax(np.abs(signed).max(axis=0)))]
        turns = np.mean(worst[1:] * worst[:-1] < 0)
        steady = np.abs(np.abs(worst[1:]) - np.abs(worst[:-1])).max() < 0.5 * np.abs(worst).max()
        if turns == 1 and steady:
            seen.append(float(np.abs(worst).max()))
            sizes.append(run.size)
    if len(seen) < max(2, math.ceil(len(case.found) / 2)):
        return
    fit = power_law(np.array(sizes), np.array(seen))
    if fit.slope < _STALLED and seen[-1] > 1e-10:
        yield _told(
            case, "alternation",
            f"λ alternates from step to step by {seen[-1]:.2g} of its size at h = {sizes[-1]:g}, "
            "and no smaller h helps: the integrator does not damp it, as the trapezoidal rule; "
            "take generalized-α, HHT or BDF2, project velocities, or average two steps",
            fault=integrator.parse(case.how["integrator"]).damped,
            amplitude=seen[-1],
        )  # fmt: skip


def _multipliers(case: Case, told: set[str]) -> Iterator[Finding]:
    """λ that stops falling: rounding of index 3, single precision, or Newton's test."""
    hidden = {"blow-up", "alternation", "few digits", "another mechanism", "another start",
              "another time", "clock"}  # fmt: skip
    if hidden & told or not case.has("lambda") or len(case.h) < 2:
        return
    values, ours = case.values("lambda"), case.values("lambda", ours=True)
    least = int(np.argmin(np.where(np.isfinite(values), values, np.inf)))
    after = np.arange(least, len(values))
    unsure = roundings(case.found, ("error", "lambda"))
    value, h = float(values[-1]), float(case.h[-1])
    fit = power_law(case.h[after], values[after])
    rises = len(after) > 2 and fit.slope < -1.0 and values[-1] > 3 * values[least]
    rises = rises or (len(after) == 2 and values[-1] > 3 * values[least])
    # What is expected of a sound code here, its own errors and rounding.
    sound = np.fmax(np.nan_to_num(ours), np.nan_to_num(unsure))
    if rises and sound[-1] > 0 and value < _UNLIKE * sound[-1]:
        yield _told(
            case, "rounding of λ",
            f"λ is best at h = {case.h[least]:g} ({values[least]:.2g}); below, its error grows "
            f"like h^{format_order(round(fit.slope, 1))} and is as large as rounding in double "
            "precision makes it under this formulation, which no scaling moves; index 1, GGL, a "
            "projection or compensated increments do",
            fault=False, slope=fit.slope,
        )  # fmt: skip
    elif rises and value > _UNLIKE * sound[-1] > 0 and "single precision" not in told:
        yield _told(
            case, "noise of λ",
            f"λ is best at h = {case.h[least]:g} ({values[least]:.2g}); below, its error grows, to "
            f"{value / sound[-1]:.1g} times the rounding of double precision at h = {h:g}: solve "
            "with scaled equations and unknowns, iterate until corrections grow, and look for "
            "single precision",
            excess=value / sound[-1],
        )  # fmt: skip
    elif (
        case.stalls("lambda")
        and sound[-1] > 0
        and value > _LIKE * sound[-1]
        and ("Newton ends early" not in told)
    ):
        falls = all(not case.has(n) or case.order(n) > 1 - _OFF for n in ("u", "v"))
        if falls:
            yield _told(
                case, "λ stops falling",
                f"λ stops falling at {value:.2g} (h = {h:g}), although rounding allows "
                f"{sound[-1]:.1g}, and u and v go on: Newton stops too early, as on a residual or "
                "correction that shrinks with h², or λ is not damped and alternates",
                error=value,
            )  # fmt: skip


# -- Newton -----------------------------------------------------------------------------------


def _iterations(case: Case, told: set[str]) -> Iterator[Finding]:
    if "blow-up" in told:
        return
    given = [each.run.numbers.get("iterations", np.array([math.nan])) for each in case.found]
    count = np.array([np.median(of[of > 0]) if (of > 0).any() else math.nan for of in given])
    if np.isnan(count).any() or len(count) < 2:
        count = np.zeros(0)
    else:
        many = max(_MANY, 2 * float(count[0]))
        shares = np.array([np.mean(of[of > 0] >= many) for of in given])
        if shares[0] == 0 and shares[-1] > _OFTEN:
            most = max(float(np.nanmax(of)) for of in given)
            sizes = ", ".join(f"{h:g}" for h in case.h[shares > _OFTEN])
            yield _told(
                case, "tolerance out of reach",
                f"Newton takes up to {most:g} iterations at h = {sizes} and {count[0]:g} at h = "
                f"{case.h[0]:g}: its tolerance cannot be met there, as corrections of λ end where "
                "rounding leaves them; test λ times h², or stop where corrections grow "
                "('newmark-study advise' names the smallest tolerance)",
                iterations=most,
            )  # fmt: skip
            return
    linear = [ratio for each in case.found if (ratio := _linear(each.run)) is not None]
    slow = False
    other = {"drift", "alternation"} & told  # another method than that of the march beside it
    if not linear and not other and len(count) and case.found[0].iterations.size:
        ours = np.array([np.median(each.iterations[each.iterations > 0])
                         if np.any(each.iterations > 0) else math.nan
                         for each in case.found])  # fmt: skip
        slow = bool(np.any(count >= np.maximum(ours + _MORE, _SLOW * ours)))
    if (linear and max(linear) > 0) or slow:
        seen = (f"each correction is about {max(linear):.2g} of the one before"
                if linear else f"Newton takes up to {count.max():g} iterations, with the exact "
                f"tangent {np.nanmax(ours):g}")  # fmt: skip
        yield _told(
            case, "linear convergence",
            f"{seen}: the tangent lacks terms, such as the geometric stiffness ∂(Gλ)/∂u, or is not "
            "renewed; results are right, but cost more iterations",
            ratio=max(linear, default=math.nan),
        )  # fmt: skip


def _linear(run: Run) -> float | None:
    """Ratio of successive corrections where they fall linearly; 0 if they do so quadratically."""
    every = run.corrections
    found: list[float] = []
    for row in every:
        sizes = row[np.isfinite(row) & (row > 0)][:-1]  # the last may be rounding
        if len(sizes) > 2:
            *_, before, ratio = sizes[1:] / sizes[:-1]
            # Quadratic: each ratio is about the square of the one before; linear: they are alike.
            found.append(float(ratio) if before**1.5 < ratio < 1 else 0.0)
    if not found:
        return None
    return float(np.median(found))


_Rule = Callable[[Case, set[str]], Iterator[Finding]]
_RULES: tuple[_Rule, ...] = (
    _failures, _printed, _clock, _start, _blow_up, _other_motion, _alternation, _first_step,
    _first_order, _single, _drift, _multipliers, _iterations,
)  # fmt: skip
#: Rules that read a step size.
_OF_STEPS = (_clock, _first_step, _blow_up, _other_motion, _first_order, _alternation,
             _multipliers, _iterations)  # fmt: skip
