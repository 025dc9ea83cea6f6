"""What is wrong with a code, told from what its runs are off by; each finding with its evidence.

A rule looks at one symptom of one series, and yields a diagnosis of `SENTENCES` with the numbers
behind it.  Rules stand in the order in which causes hide each other: numbers, clock and start
first, then the motion, the constraints, and λ last.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from newmark_cli.codes.matching import Factor
from newmark_cli.codes.measuring import (
    SAME_TIME,
    Measured,
    Motion,
    method,
    misfits_at,
    roundings,
)
from newmark_cli.codes.reading import STEP_SIZE, Run, Runs
from newmark_cli.newmark import integrator
from newmark_cli.newmark.forms import INDEX_3
from newmark_cli.newmark.formulation import CORRECTED
from newmark_cli.problems import multipliers
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.starting import corrected_velocity
from newmark_cli.report.judging.fits import format_order, power_law
from newmark_cli.support.arrays import Array, Mask

#: Diagnosis → what it says, of the evidence.  Its name is what stands before a slash: several
#: symptoms may have one name.
SENTENCES: Mapping[str, str] = MappingProxyType({
    "failure": "no result at {abscissa} = {sizes}: {because}",
    "single precision/numbers":
        "every number of the state is one of single precision: compute and print in double "
        "precision",
    "few digits":
        "numbers have at most {digits} digits, so that errors below 1e-{digits} are those of "
        "printing: print 17, as %.17g does",
    "clock":
        "t = {t:.9g} is {off:.2g} s off whole steps of h = {h:g}: t or h is summed up{single}; "
        "take t = k h in double precision",
    "start off its constraints":
        "the start misses {condition} = 0 by {misfit:.2g} {unit} ({constraint}): it is damped away "
        "or not, but early steps and λ are wrong",
    "another start/at t0":
        "the start differs from the problem's: {coordinate} = {value:.9g}, there {wanted:.9g}",
    "inconsistent a(0)":
        "after the first step {seen} {missing:.0%} at every h, down to h = {h:g}: the integration "
        "does not begin from the a of M a = f + G λ, Gᵀa + κ = 0; solve that system for a and λ "
        "at t = 0",
    "blow-up":
        "u is {size} at h = {h:g}, and smaller h makes it worse: the method is unstable for "
        "constrained motion, as with a γ that does not go with β (β ≥ (γ + ½)²/4, γ ≥ ½; "
        "generalized-α: γ = ½ − α_m + α_f)",
    "another time":
        "u stays {error:.2g} off at every h, by what it moves in {shift:.2g} s: the states are "
        "those of another time, as with a step size in single precision",
    "another mechanism/equations":
        "u converges, to a motion that is {error:.2g} off (h = {h:g}): {because}",
    "another mechanism/λ":
        "u converges, to a motion that is {error:.2g} off (h = {h:g}), and λ is not what u and v "
        "imply with the mechanism's masses and forces: a mass, an inertia or a force differs",
    "another mechanism":
        "u converges, to a motion that is {error:.2g} off (h = {h:g}): a mass, a force, a length "
        "or the start differs; with λ in the table more could be said",
    "another start":
        "u converges, to a motion that is {error:.2g} off (h = {h:g}), while λ is what u and v "
        "imply: the start differs, or the time",
    "order 1":
        "{orders}, where the method has {wanted}: accelerations are averaged wrongly, as with "
        "γ ≠ ½ (generalized-α: γ ≠ ½ − α_m + α_f), forces are taken at the wrong end of the step, "
        "or the start is not consistent; if the method has order 1, say so (--integrator)",
    "single precision":
        "Φ vanishes to {misfit:.1g} of the coordinates at every h, which is rounding of single "
        "precision: some of the computation, or of the output, is in float",
    "drift/level":
        "Φ is missed by {misfit:.2g} of the coordinates at h = {h:g}{grown}, and {rate} by "
        "rounding: constraints are held at the level of {level} only, so that positions drift; "
        "hold Φ as well (GGL, or a projection), or say that the formulation is {formulation}",
    "drift":
        "Φ is missed by {misfit:.2g} of the coordinates at h = {h:g}{grown} and falls with order "
        "{order:.1f}: it is not among the equations that are solved",
    "Newton ends early":
        "Φ is left at {misfit:.2g} of the coordinates at h = {h:g}{falls}, where an iteration to "
        "the end leaves rounding: the test of convergence is met too soon, as on a correction or "
        "residual that shrinks with h²; test what does not, such as ‖Δu‖ over ‖u‖ to 1e-12, or "
        "iterate until corrections grow",
    "alternation":
        "λ alternates from step to step by {amplitude:.2g} of its size at h = {h:g}, and no "
        "smaller h helps: the integrator does not damp it, as the trapezoidal rule; take "
        "generalized-α, HHT or BDF2, project velocities, or average two steps",
    "rounding of λ":
        "λ is best at h = {best:g} ({least:.2g}); below, its error grows like h^{power} and is as "
        "large as rounding in double precision makes it under this formulation, which no scaling "
        "moves; index 1, GGL, a projection or compensated increments do",
    "noise of λ":
        "λ is best at h = {best:g} ({least:.2g}); below, its error grows, to {excess:.1g} times "
        "the rounding of double precision at h = {h:g}: solve with scaled equations and unknowns, "
        "iterate until corrections grow, and look for single precision",
    "λ stops falling":
        "λ stops falling at {error:.2g} (h = {h:g}), although rounding allows {allowed:.1g}, and u "
        "and v go on: Newton stops too early, as on a residual or correction that shrinks with h², "
        "or λ is not damped and alternates",
    "tolerance out of reach":
        "Newton takes up to {iterations:g} iterations at h = {sizes} and {usual:g} at h = "
        "{largest:g}: its tolerance cannot be met there, as corrections of λ end where rounding "
        "leaves them; test λ times h², or stop where corrections grow ('newmark-study advise' "
        "names the smallest tolerance)",
    "linear convergence":
        "{seen}: the tangent lacks terms, such as the geometric stiffness ∂(Gλ)/∂u, or is not "
        "renewed; results are right, but cost more iterations",
    "factor of λ":
        "λ of {constraints} is off by a factor of {factor:.4g} at the smallest h: {why}; it is "
        "judged without",
})  # fmt: skip
#: Diagnoses that are limits of any code of the kind; all others are faults.
_LIMITS = ("rounding of λ", "alternation/undamped")

#: Rounding over value below which a point counts.
_CLEAR = 0.1
#: Orders below this are those of errors that stagnate; how far other orders may be off.
_STALLED, _OFF = 0.3, 0.35
#: Relative misfits of Φ: what single precision leaves; over those of a sound march, what is no
#: rounding; and the least that is none of double precision.
_SINGLE, _ROUNDINGS, _DOUBLE = (2e-9, 1e-4), 1e3, 1e-12
#: Largest error of u with which a motion is the one that was wanted; orders of a drift.
_RIGHT, _DRIFTS = 0.1, (1.3, 2.5)
#: Distance of two runs over that from the solution, below which they have converged.
_AGREE = 0.1
#: Part of the error at the smallest step size with which another run is right.
_NEARER = 0.2
#: Error of u that no step size should have.
_WRECKED = 10.0
#: Change of v in the first step over h a(0), that is missing; relative misfits of a start.
_FIRST, _START = 0.05, 1e-9
#: Residual of an equation of motion, relative to its largest term, that is no truncation.
_MISSED = 3e-3
#: Iterations that count as many, and the part of the steps that must have as many.
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


#: A diagnosis, and its evidence.
_Seen = Iterator[tuple[str, dict[str, Any]]]


@dataclass(frozen=True, eq=False)
class Case:
    """One series as the rules see it."""

    how: Mapping[str, str]  #: axis → value of its method
    measured: Sequence[Measured]  #: its runs that ended, by descending sizes
    runs: Sequence[Run]  #: all of its runs, twins and those that failed included
    motion: Motion
    table: Runs

    @property
    def h(self) -> Array:
        """(k,) step sizes, descending."""
        return np.array([m.run.size for m in self.measured])

    @property
    def method(self) -> integrator.Integrator:
        """Its integrator."""
        return integrator.parse(self.how["integrator"])

    def has(self, name: str) -> bool:
        """Whether all runs have this quantity: ``"u"`` of an error, others of an invariant."""
        return bool(self.measured) and all(_key(name) in m.errors for m in self.measured)

    def values(self, name: str, ours: bool = False, statistic: str = "max") -> Array:
        """(k,) values, those of marches of this tool's if `ours`; NaN where there are none."""
        rows = [(m.ours if ours else m.errors).get(_key(name)) for m in self.measured]
        return np.array([getattr(row and row.statistics, statistic, math.nan) for row in rows])

    def clear(self, name: str) -> Mask:
        """(k,) where rounding does not matter; all where nobody knows it."""
        values = self.values(name)
        unsure = np.nan_to_num(roundings(self.measured, _key(name)))
        return np.isfinite(values) & (values > 0) & (unsure < _CLEAR * values)

    def order(self, name: str, points: int = 4, statistic: str = "max") -> float:
        """Order over the smallest step sizes that are clear; NaN of fewer than three."""
        at = np.flatnonzero(self.clear(name))[-points:] if self.has(name) else ()
        values = self.values(name, statistic=statistic)
        return power_law(self.h[at], values[at]).slope if len(at) > 2 else math.nan

    def stalls(self, name: str) -> bool:
        """Whether it does not fall over the three smallest clear step sizes."""
        return abs(self.order(name, points=3)) < _STALLED


def _key(name: str) -> tuple[str, str]:
    invariants = ("position", "velocity", "multiplier", "energy")
    return ("invariant" if name in invariants else "error", name)


def diagnosed(
    runs: Runs,
    measured: Sequence[Measured],
    motion: Motion,
    options: Mapping[str, Any],
    factors: Sequence[Factor] = (),
) -> list[Finding]:
    """Findings on every series.

    Args:
        runs: The table.
        measured: Its runs, measured.
        motion: Solutions of the problem.
        options: Axis → value of the method where the table does not say it.
        factors: Factors of λ.
    """
    every: list[Finding] = []
    for label in dict.fromkeys(run.series for run in runs.runs):
        own = [run for run in runs.runs if run.series == label]
        ended = [m for m in measured if m.run.series == label]
        case = Case(method({**options, **own[-1].method}), ended, own, motion, runs)
        findings: list[Finding] = []
        for rule, hidden_by, of_steps in _RULES:
            if hidden_by & {finding.name for finding in findings}:
                continue
            if of_steps and (runs.abscissa != STEP_SIZE or not ended):
                continue
            findings += [_finding(label, *seen) for seen in rule(case)]
        findings += [_finding(label, *seen) for seen in _factors(factors, label)]
        every += findings
    return every


def _finding(label: str, diagnosis: str, evidence: Mapping[str, Any]) -> Finding:
    shown = {
        name: ", ".join(f"{size:g}" for size in value) if isinstance(value, list) else value
        for name, value in evidence.items()
    }
    name = diagnosis.partition("/")[0]
    text = SENTENCES.get(diagnosis, SENTENCES.get(name, "")).format(**shown)
    return Finding(name, label, text, diagnosis not in _LIMITS, evidence)


def _factors(factors: Sequence[Factor], label: str) -> _Seen:
    scales: dict[tuple[str, str], list[str]] = {}
    for factor in factors:
        if factor.series == label:
            scales.setdefault((factor.why, f"{factor.value:.4g}"), []).append(factor.constraint)
    for (why, value), names in scales.items():
        yield "factor of λ", {"constraints": ", ".join(names), "factor": float(value), "why": why}


# -- runs, numbers, clock, start --------------------------------------------------------------


def _failures(case: Case) -> _Seen:
    if failed := [run for run in case.runs if not run.ended]:
        said = next((run.message for run in failed if run.message), "")
        lacks = ", ".join(dict.fromkeys(name for run in failed for name in run.lacks[:3]))
        yield "failure", {
            "abscissa": case.table.abscissa,
            "sizes": [run.size for run in failed],
            "because": f"the code says “{said}”" if said
            else f"no number for {lacks} in the last row",
        }  # fmt: skip


def _printed(case: Case) -> _Seen:
    if case.table.single:
        yield "single precision/numbers", {}
    elif case.table.few_digits:
        yield "few digits", {"digits": case.table.digits}


def _clock(case: Case) -> _Seen:
    t0 = case.motion.problem.t0
    ends = np.array([run.t[-1] - t0 for run in case.runs if run.ended])
    sizes = np.array([run.size for run in case.runs if run.ended])
    off = np.abs(ends - np.round(ends / sizes) * sizes)
    part = off / np.maximum(ends, sizes)
    at = int(np.argmax(part))
    # A step size that was printed in short ends at the same time as all others.
    alike = np.ptp(ends) <= 1e-9 * ends.max() and len(ends) > 1
    if part[at] > 1e-9 and not alike and off[at] < 0.4 * sizes[at]:
        single = " in single precision" if part[at] < 1e-3 else ""
        yield "clock", {"t": t0 + ends[at], "off": float(off[at]), "h": sizes[at], "single": single}


def _start(case: Case) -> _Seen:
    problem = case.motion.problem
    starts = [
        (run, row) for run in case.runs if not run.twin
        for row in np.flatnonzero(np.abs(run.t - problem.t0) <= SAME_TIME)[:1]
    ]  # fmt: skip
    if not starts:
        return
    run, row = starts[0]
    # What printing, or single precision, leaves of a number.
    table = case.table
    unsure = 10.0 ** (1 - table.digits) if table.few_digits else 1e-6 * table.single
    unsure = max(_START, unsure)
    missed, v0 = misfits_at(problem, run, int(row)), problem.v0
    if case.how.get("start") == CORRECTED:
        # Off the rates of the constraints on purpose.
        missed.pop("velocity", None)
        v0 = corrected_velocity(problem, run.size)
    for name, condition, unit in (("position", "Φ", "m"), ("velocity", "Gᵀv + Φ_t", "m/s")):
        misfit = missed.get(name)
        if misfit and misfit.error > unsure * (float(misfit.sizes.max()) or 1.0):
            worst = problem.constraint_names[int(np.argmax(np.abs(misfit.errors)))]
            yield "start off its constraints", {"condition": condition, "misfit": misfit.error,
                                                "unit": unit, "constraint": worst}  # fmt: skip
            return
    for part, there in (("u", problem.u0), ("v", v0)):
        here = run.state[part][row]
        off = np.where(np.isfinite(here), np.abs(here - there), 0.0)
        at = int(np.argmax(off))
        if off[at] > unsure * max(float(np.abs(there).max()), _START):
            yield "another start/at t0", {
                "coordinate": f"{part}[{problem.coordinate_names[at]}]", "value": here[at],
                "wanted": there[at], "difference": float(off[at]),
            }  # fmt: skip
            return


def _first_step(case: Case) -> _Seen:
    """What the first step adds to v, over h a(0), and its λ: wrong where a(0) was not computed."""
    if case.method.order < 2 or case.order("velocity", statistic="last") < 1.5:
        return  # of a method of order 1 the first step is off by as much
    problem = case.motion.problem
    start = case.motion.at(problem.t0)
    a, _ = Index1(problem).accelerations(problem.t0, start.u, start.v)
    of_v, of_lambda = [], []
    for run in (m.run for m in case.measured):
        for row in np.flatnonzero(np.abs(run.t - problem.t0 - run.size) <= 1e-6 * run.size)[:1]:
            change = (run.state["v"][row] - start.v) / run.size
            if a.any() and np.isfinite(change).all():
                of_v.append((run.size, np.linalg.norm(change - a) / np.linalg.norm(a)))
            if off := misfits_at(problem, run, int(row)).get("multiplier"):
                # Where λ begins at 0, what it grows to.
                scales = np.maximum(multipliers.weights_at_start(problem).scales(off.sizes),
                                    case.motion.at(float(run.t[-1])).scales)  # fmt: skip
                of_lambda.append((run.size, np.abs(off.errors / scales).max()))
    # λ of an undamped integrator is off throughout.
    for seen, points in (
        ("v has changed by h a(0) less", of_v),
        ("λ is off by", of_lambda if case.method.damped else []),
    ):
        sizes, parts = np.array(points[-4:]).reshape(-1, 2).T
        if len(parts) > 1 and _FIRST < parts[-1] < 2.0 and power_law(sizes, parts).slope < _STALLED:
            yield "inconsistent a(0)", {"seen": seen, "missing": float(parts[-1]), "h": sizes[-1]}
            return


# -- the motion -------------------------------------------------------------------------------


def _blow_up(case: Case) -> _Seen:
    u = case.values("u")
    if not case.has("u") or u[-1] < _WRECKED:
        return
    finite = u[np.isfinite(u) & (u > 0)]
    if len(finite) < len(u) or (len(finite) > 1 and finite[-1] > 10 * finite[0]):
        wrecked = f"{u[-1]:.1g} times its size off" if math.isfinite(u[-1]) else "not finite"
        yield "blow-up", {"size": wrecked, "h": case.h[-1], "error": float(u[-1])}


def _other_motion(case: Case) -> _Seen:
    if not case.has("u") or len(case.measured) < 2 or not case.clear("u")[-1]:
        return
    # It converges if two step sizes agree with each other far better than with the solution.
    error, (*_, coarse, fine) = float(case.values("u")[-1]), case.measured
    there = case.motion.at(float(fine.run.t[-1]))
    apart = np.nanmax(np.abs(coarse.run.state["u"][-1] - fine.run.state["u"][-1]))
    if apart > _AGREE * error * np.abs(there.u).max():
        return
    # Another motion is as far off at every h; rounding that piles up, as in (u, λ), is not.
    if np.nanmin(case.values("u")) < _NEARER * error:
        return
    seen = {"error": error, "h": case.h[-1]}
    if math.isfinite(shift := _shifted(case)):
        yield "another time", seen | {"shift": shift}
    elif because := _equations(case):
        yield "another mechanism/equations", seen | {"because": because}
    elif not case.has("multiplier"):
        yield "another mechanism", seen
    else:
        yield "another mechanism/λ" if case.stalls("multiplier") else "another start", seen


def _shifted(case: Case) -> float:
    """Time (s) by which the last state is that of another time; NaN where it is not."""
    run, problem = case.measured[-1].run, case.motion.problem
    there = case.motion.at(float(run.t[-1]))
    a, _ = Index1(problem).accelerations(float(run.t[-1]), there.u, there.v)
    off, rate, of_v = run.state["u"][-1] - there.u, there.v, run.state["v"][-1] - there.v
    if not np.isfinite([*off, *of_v]).all() or not rate.any() or not a.any():
        return math.nan
    shift = float(off @ rate / (rate @ rate))
    left = np.linalg.norm(off - shift * rate) / np.linalg.norm(off)
    of_rate = np.linalg.norm(of_v - shift * a) / max(float(np.linalg.norm(of_v)), 1e-300)
    return shift if left < 0.05 and of_rate < 0.05 else math.nan


def _equations(case: Case) -> str:
    """Whose equations of motion the last rows miss, and by which mass that would be explained."""
    problem = case.motion.problem
    for run in (m.run for m in reversed(case.measured)):
        u, v, forces = (run.state.get(part, np.zeros((len(run.t), 0)))[-3:]
                        for part in ("u", "v", "lambda"))  # fmt: skip
        if len(run.t) < 3 or np.ptp(np.diff(run.t[-3:])) > 1e-6 * run.size:
            continue
        if not np.isfinite(np.concatenate([u, v, forces], axis=1)).all():
            continue
        a = (v[2] - v[0]) / (run.t[-1] - run.t[-3])
        inertia = problem.M @ a
        force = problem.evaluate(float(run.t[-2]), u[1], v[1], forces[1]).force  # f + G λ
        left, size = inertia - force, max(np.abs(inertia).max(), np.abs(force).max())
        # What differences in time leave: the same of the solution's neighbours would be as large.
        a_near = np.abs((v[2] - 2 * v[1] + v[0]) / run.size).max() / max(np.abs(a).max(), 1e-300)
        if np.abs(left).max() < max(_MISSED, 3 * a_near) * size:
            continue
        missed = np.flatnonzero(np.abs(left) > 0.2 * np.abs(left).max())
        points = dict.fromkeys(problem.point_of(int(i)) for i in missed)
        text = (f"the equations of motion of {', '.join(points)} are missed by "
                f"{np.abs(left).max() / size:.2g} of their largest term")  # fmt: skip
        for relative, what in ((a - _fall(problem), "mass"), (a, "inertia, but not the weight,")):
            if share := _as_mass(problem, left, relative):
                return f"{text}, as if the {what} of {share}"
        return f"{text}: a mass, an inertia or a force differs"
    return ""


def _fall(problem: Any) -> Array:
    """Accelerations that gravity gives to what is free."""
    at_rest = problem.evaluate(problem.t0, problem.u0, np.zeros(problem.n), np.zeros(problem.m))
    return np.asarray(np.linalg.lstsq(problem.M, at_rest.force, rcond=None)[0])


def _as_mass(problem: Any, left: Array, relative: Array) -> str:
    """The one point, and the factor of its mass, that would explain what is left."""
    best, text = 0.05, ""
    of = np.array([problem.point_of(i) for i in range(problem.n)])
    for point in dict.fromkeys(of.tolist()):
        row = np.where(of == point, np.diag(problem.M) * relative, 0.0)
        if row.any():
            share = float(left @ row / (row @ row))
            rest = float(np.linalg.norm(left - share * row) / np.linalg.norm(left))
            if rest < best:
                best, text = rest, f"{point} were {1 - share:.4g} times the mechanism's"
    return text


def _first_order(case: Case) -> _Seen:
    orders = {name: case.order(name) for name in ("u", "v") if case.has(name)}
    low = {name: order for name, order in orders.items() if abs(order - 1) < _OFF}
    wanted = case.method.order
    if wanted > 1 and low and not any(order > 2 - _OFF for order in orders.values()):
        text = " and ".join(f"{name} has order {order:.2f}" for name, order in low.items())
        yield "order 1", {"orders": text, "wanted": wanted, "order": next(iter(low.values()))}


# -- the constraints --------------------------------------------------------------------------


def _single(case: Case) -> _Seen:
    if not case.has("position") or case.how["formulation"] != INDEX_3:
        return
    values, ours = case.values("position"), case.values("position", ours=True)[-1]
    flat = (values > 0).sum() > 2 and abs(power_law(case.h, values).slope) < 0.5
    noisy = math.isnan(ours) or values[-1] > _ROUNDINGS * max(ours, 1e-16)
    if _SINGLE[0] < values[-1] < _SINGLE[1] and flat and noisy:
        yield "single precision", {"misfit": float(values[-1])}


def _drift(case: Case) -> _Seen:
    if case.how["formulation"].split()[0] not in (INDEX_3, "ggl", "augmented-lagrangian"):
        return
    values, ours = case.values("position"), case.values("position", ours=True)
    bound = np.where(np.isfinite(ours), np.maximum(_ROUNDINGS * ours, _DOUBLE / 10), _DOUBLE)
    # A motion that is wrong altogether says nothing of its constraints.
    above = (values > bound) & ~(case.values("u") >= _RIGHT)
    if not above.any():
        return
    at, fit = int(np.flatnonzero(above)[-1]), power_law(case.h[above], values[above])
    seen = {"misfit": float(values[at]), "h": case.h[at], "grown": _grown(case, at)}
    for name, rate, level, formulation in (
        ("velocity", "Gᵀv", "velocities", "index-2"),
        ("multiplier", "Gᵀa + κ", "accelerations", "index-1"),
    ):
        # An iteration that ends early misses rates by more than Φ; a from u rounds like ε/h².
        if case.values(name)[at] < max(1e-2 * values[at], 1e-12):
            yield "drift/level", seen | {"rate": rate, "level": level, "formulation": formulation}
            return
    if fit.points > 2 and _DRIFTS[0] < fit.slope < _DRIFTS[1]:
        yield "drift", seen | {"order": fit.slope}
    else:
        falls = f" (order {fit.slope:.1f})" if fit.points > 2 else ""
        yield "Newton ends early", seen | {"falls": falls}


def _grown(case: Case, at: int) -> str:
    """How the misfit of Φ grows along a trajectory, in words."""
    run, problem = case.measured[at].run, case.motion.problem
    rows = np.flatnonzero(run.t > 0.1 * run.t[-1])
    if len(rows) < 8:
        return ""
    rows = rows[:: max(1, len(rows) // 40)]
    missed = [misfits_at(problem, run, int(row))["position"].error for row in rows]
    power = power_law(run.t[rows] - problem.t0, np.array(missed)).slope
    return ", like t" if 0.5 < power < 1.5 else ", like t²" if 1.5 < power < 2.5 else ""


# -- λ ----------------------------------------------------------------------------------------


def _alternation(case: Case) -> _Seen:
    """λ − what u and v imply, of opposite signs in successive steps and no smaller with h."""
    problem, seen = case.motion.problem, []
    for run in (m.run for m in case.measured):
        gaps = np.flatnonzero(np.abs(np.diff(run.t) - run.size) >= 1e-6 * run.size)
        first = max(int(gaps[-1]) + 1 if len(gaps) else 0, len(run.t) - _LAST)
        scales = case.motion.at(float(run.t[-1])).scales
        missed = [misfits_at(problem, run, row) for row in range(first, len(run.t))]
        signed = np.array([of["multiplier"].errors / scales for of in missed if "multiplier" in of])
        if len(signed) < 3 or run.t[first] <= problem.t0:
            continue
        worst = signed[:, int(np.argmax(np.abs(signed).max(axis=0)))]
        steady = np.abs(np.diff(np.abs(worst))).max() < 0.5 * np.abs(worst).max()
        if (worst[1:] * worst[:-1] < 0).all() and steady:
            seen.append((run.size, float(np.abs(worst).max())))
    if len(seen) < max(2, math.ceil(len(case.measured) / 2)):
        return
    sizes, amplitudes = np.array(seen).T
    if power_law(sizes, amplitudes).slope < _STALLED and amplitudes[-1] > 1e-10:
        evidence = {"amplitude": float(amplitudes[-1]), "h": sizes[-1]}
        yield "alternation" if case.method.damped else "alternation/undamped", evidence


def _noise(case: Case) -> _Seen:
    """λ that grows below some step size: as rounding does, or by far more."""
    values = case.values("lambda")
    if not case.has("lambda") or len(values) < 2 or not (sound := _sound(case)[-1]) > 0:
        return
    least = int(np.argmin(np.where(np.isfinite(values), values, np.inf)))
    power = power_law(case.h[least:], values[least:]).slope
    after = len(values) - least
    if not (values[-1] > 3 * values[least] and (after == 2 or (after > 2 and power < -1.0))):
        return
    seen = {"best": case.h[least], "least": float(values[least]), "h": case.h[-1]}
    if values[-1] < _UNLIKE * sound:
        yield "rounding of λ", seen | {"power": format_order(round(power, 1)), "slope": power}
    else:
        yield "noise of λ", seen | {"excess": float(values[-1] / sound)}


def _early(case: Case) -> _Seen:
    """λ that stops falling where u and v do not."""
    if not case.has("lambda") or not case.stalls("lambda"):
        return
    value, allowed = float(case.values("lambda")[-1]), float(_sound(case)[-1])
    # λ that nothing damps does not fall in a sound code, either; only its march could tell.
    if not case.method.damped and not np.isfinite(case.values("lambda", ours=True)[-1]):
        return
    falls = all(case.order(name) > 1 - _OFF for name in ("u", "v") if case.has(name))
    if value > _LIKE * allowed > 0 and falls:
        yield "λ stops falling", {"error": value, "h": case.h[-1], "allowed": allowed}


def _sound(case: Case) -> Array:
    """(k,) error of λ that is to be expected of a sound code: its own truncation and rounding."""
    unsure = roundings(case.measured, ("error", "lambda"))
    return np.fmax(np.nan_to_num(case.values("lambda", ours=True)), np.nan_to_num(unsure))


# -- Newton -----------------------------------------------------------------------------------


def _counts(case: Case) -> list[Array]:
    """Newton's iterations in the steps of each run; none if any run lacks them."""
    columns = [m.run.numbers.get("iterations", np.zeros(1)) for m in case.measured]
    counts = [column[column > 0] for column in columns]
    return counts if len(counts) > 1 and all(map(len, counts)) else []


def _out_of_reach(case: Case) -> _Seen:
    if counts := _counts(case):
        usual = float(np.median(counts[0]))
        shares = np.array([np.mean(of >= max(_MANY, 2 * usual)) for of in counts])
        if shares[0] == 0 and shares[-1] > _OFTEN:
            yield "tolerance out of reach", {
                "iterations": max(float(of.max()) for of in counts), "usual": usual,
                "sizes": case.h[shares > _OFTEN].tolist(), "largest": case.h[0],
            }  # fmt: skip


def _linear(case: Case) -> _Seen:
    """Corrections of a step that fall linearly; of a quadratic fall the ratio counts as 0."""
    ratios = [ratio for m in case.measured if (ratio := _ratio(m.run)) is not None]
    if ratios and (ratio := max(ratios)) > 0:
        seen = f"each correction is about {ratio:.2g} of the one before"
        yield "linear convergence", {"seen": seen, "ratio": ratio}


def _ratio(run: Run) -> float | None:
    """Median ratio of successive corrections; 0 where they fall quadratically."""
    ratios = []
    for row in run.corrections:
        sizes = row[np.isfinite(row) & (row > 0)][:-1]  # the last may be rounding
        if len(sizes) > 2:
            *_, before, last = sizes[1:] / sizes[:-1]
            # Quadratic: each ratio is about the square of the one before; linear: they are alike.
            ratios.append(float(last) if before**1.5 < last < 1 else 0.0)
    return float(np.median(ratios)) if ratios else None


def _slow(case: Case) -> _Seen:
    """Iterations of a code without corrections, next to those of a march with the exact tangent."""
    counts = _counts(case)
    if not counts or any(_ratio(m.run) is not None for m in case.measured):
        return
    ours = [np.median(m.iterations[m.iterations > 0])
            if np.any(m.iterations > 0) else math.nan for m in case.measured]  # fmt: skip
    theirs, exact = np.array([np.median(of) for of in counts]), np.array(ours)
    if np.any(theirs >= np.maximum(exact + _MORE, _SLOW * exact)):
        seen = (f"Newton takes up to {theirs.max():g} iterations, with the exact tangent "
                f"{np.nanmax(exact):g}")  # fmt: skip
        yield "linear convergence", {"seen": seen, "iterations": float(theirs.max())}


#: Rules, the findings that hide them, and whether they need a step size.
_RULES: tuple[tuple[Callable[[Case], _Seen], set[str], bool], ...] = (
    (_failures, set(), False),
    (_printed, set(), False),
    (_clock, set(), True),
    (_start, set(), False),
    (_blow_up, {"clock"}, True),
    (_other_motion, {"blow-up", "clock", "few digits", "another start"}, True),
    (_alternation, set(), True),
    (_first_step, {"start off its constraints", "another start", "another mechanism",
                   "single precision", "few digits", "alternation"}, True),
    (_first_order, {"blow-up", "another mechanism", "another start", "another time", "few digits",
                    "inconsistent a(0)"}, True),
    (_single, {"few digits", "single precision"}, False),
    (_drift, {"single precision", "few digits", "blow-up"}, False),
    (_noise, {"blow-up", "alternation", "few digits", "another mechanism", "another start",
              "another time", "clock", "single precision"}, True),
    (_early, {"blow-up", "alternation", "few digits", "another mechanism", "another start",
              "another time", "clock", "Newton ends early"}, True),
    (_out_of_reach, {"blow-up"}, True),
    (_linear, {"blow-up", "tolerance out of reach", "single precision"}, True),
    (_slow, {"blow-up", "tolerance out of reach", "linear convergence", "single precision",
             "drift", "alternation"}, True),
)  # fmt: skip
