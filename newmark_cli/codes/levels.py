"""Causes that Φ and λ tell: lengths, drift, Newton's iteration, factors of λ."""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from newmark_cli.codes.evidence import PARTS, SYMBOLS, Finding, SeriesErrors
from newmark_cli.support.arrays import Array

#: Misfits of Φ that single precision leaves.
_SINGLE = (5e-9, 1e-6)
#: Last rows at which an alternation is looked for, and a factor.
_LAST, _OF_FACTOR = 20, 8
#: What a damped alternation may have left at the end of a run that is looked at.
_FADED = 1e-3
#: What a factor differs from 1 by, at least: λ has rounding and an order of its own.
_NEAR_ONE = 1e-4
#: How far an order of λ is from 1, and local ones scatter; part of h over which rates are taken,
#: and what another time may leave.
_OFF_ONE, _SCATTER, _APART, _LEAVES = 0.2, 0.35, 1e-2, 0.15
#: Steps by which the law of a motion may be late, and what of Φ is left at the right time.
_SHIFTS, _MET = (-1.0, -0.5, 0.5, 1.0), 1e-3
#: Powers of h that a factor of λ may have.
_POWERS = (0, 1, 2, -2, -1)


def length(evidence: SeriesErrors) -> Iterator[Finding]:
    """Φ of one constraint missed by the same amount at every h and t."""
    problem, runs = evidence.problem, evidence.runs
    if len(runs) < 2 or not problem.m or not evidence.whole["u"]:
        return
    every = np.concatenate(_after_start(evidence)[-3:])
    mean, spread = every.mean(axis=0), np.ptp(every, axis=0)
    hit = np.abs(mean) > np.maximum(10 * spread, 30 * evidence.resolution["u"] + 1e-11)
    if not hit.any():
        return
    k = int(np.argmax(np.where(hit, np.abs(mean), 0.0)))
    whole, end = _gradient(evidence, k)
    missed = float(mean[k] * evidence.scale["u"]) * whole / end
    names = problem.constraint_names
    said = f"Φ of {', '.join(np.array(names)[hit])} is missed by {missed:.3g} m at every h"
    # A penalty misses all of them, but for those that keep a body rigid, and by what λ is then.
    apart = np.array([not (name.startswith("bodies.") or "·" in name) for name in names])
    exact = bool((np.abs(every).max(axis=0) < 1e-3 * np.abs(mean).max())[apart].any())
    if np.ptp(runs[-1].t) < 0.3 * (evidence.end - evidence.t0) and not exact:
        text = f"{said}: a length or place of the constraint differs, or a penalty holds it; rows "
        yield evidence.finding("seen", f"{text}at another time would tell", misfit=missed)
        return
    also = ", and others are met" if exact else ""
    text = f"{said} and t{also}: a length or place of the constraint differs"
    yield evidence.finding("length", text, misfit=missed)


def single(evidence: SeriesErrors) -> Iterator[Finding]:
    """Φ that is noise of the size of single precision."""
    if not evidence.whole["u"] or not evidence.problem.m or evidence.resolution["u"] > 1e-9:
        return
    rows = _after_start(evidence)
    worst = np.array([np.abs(of).max(initial=0.0) for of in rows])
    every = np.concatenate([of[:, int(np.abs(of).max(axis=0).argmax())] for of in rows])
    low, high = _SINGLE
    of_its_size = len(rows) > 1 and (worst > low).all() and (worst < high).all()
    both_signs = (every > 0).any() and (every < 0).any()
    stays = worst[-1] > 0.2 * worst[0]
    held = _held(evidence, len(rows) - 1, float(worst[-1]))
    if of_its_size and both_signs and stays and held is None:
        text = (
            f"Φ is noise of {worst[-1]:.1g} of the coordinates at every h, as rounding of single "
            "precision leaves: something is computed in float"
        )
        yield evidence.finding("single precision", text, misfit=float(worst[-1]))


def constraints(evidence: SeriesErrors) -> Iterator[Finding]:
    """Φ above rounding: held at another level, or by an iteration that ends early."""
    if not evidence.whole["u"] or not evidence.problem.m:
        return
    told, last_u = evidence.told, evidence.last("u")
    if last_u.max() > 1:
        return
    strict = told.formulation in ("index-3", "ggl", "augmented-lagrangian")
    misfits = _after_start(evidence)
    value = np.array([np.abs(of).max(initial=0.0) for of in misfits])
    ours = np.array([evidence.ours(k, "position", "invariant") for k in range(len(value))])
    least = max(3 * evidence.resolution["u"], 2e-13)
    above = np.flatnonzero(value > np.fmax(ours * (1e3 if strict else 0.0), least))
    if not len(above):
        return
    k = int(above[0])
    missed = float(value[k])
    seen = f"Φ is missed by {missed:.2g} at h = {evidence.h[k]:g}"
    if held := _held(evidence, k, missed):
        rate, level, formulation = held
        hint = f"hold Φ as well (GGL, or a projection), or say that it is {formulation}"
        end = hint if strict else f"as {formulation} has it"
        text = (
            f"{seen}, {rate} by rounding only: constraints are held at the level of {level}, so "
            f"that positions drift; {end}"
        )
        yield evidence.finding("drift", text, strict, misfit=missed, level=formulation)
        return
    if (shift := _time_of_motions(evidence, k)) is not None:
        size = "½" if abs(shift) == 0.5 else "1"
        text = (
            f"{seen}, and met at the time t {'−' if shift < 0 else '+'} {size} h: the law of "
            f"{', '.join(dict.fromkeys(_driven(evidence)))} is taken there"
        )
        yield evidence.finding("late", text, misfit=missed, shift=shift, parts=["motions"])
        return
    worse = _worse(evidence, k)
    matters = missed > 1e-2 * min(last_u[k], 1e-4) or bool(worse)
    rows = np.abs(misfits[k]).max(axis=1)
    steady = len(rows) > 3 and rows[:2].max() > 0.02 * rows[-3:].max()
    early = strict and steady and len(above) > 1
    if early and not (evidence.whole["v"] and evidence.whole["lambda"]):
        lacks = "λ" if evidence.whole["v"] else "v and λ"
        text = (
            f"{seen} already after the first steps: the test of convergence is met too soon, or "
            f"Φ′ or Φ″ is held in its place; {lacks} would tell"
        )
        yield evidence.finding("seen", text, matters, misfit=missed)
    elif early:
        more = f", and {', '.join(worse)} at the end are worse than the method's" if worse else ""
        suffers = matters or _worse(evidence, len(value) - 1) or any(alternation(evidence))
        harmless = "" if suffers else "; the results do not suffer"
        text = (
            f"{seen} already after the first steps, where an iteration to the end leaves rounding; "
            f"neither Φ′ nor Φ″ is held instead{more}: the test of convergence is met too soon"
            f"{harmless}; test ‖Δu‖ over ‖u‖ to 1e-12, or iterate until corrections grow"
        )
        yield evidence.finding("Newton ends early", text, matters, misfit=missed)
    else:
        text = (
            f"{seen}: more than rounding, as a tolerance of Newton's iteration, a penalty or "
            "stabilisation leaves"
        )
        yield evidence.finding("seen", text, strict and matters, misfit=missed)


def _worse(evidence: SeriesErrors, k: int) -> list[str]:
    """What is twice as far off at a step size as a march of the method that is said."""
    return [
        SYMBOLS[part] for part in PARTS
        if evidence.told.integrator and evidence.has[part]
        and evidence.last(part)[k] > 2 * max(evidence.ours(k, part), evidence.floor(part)[k])
    ]  # fmt: skip


def _driven(evidence: SeriesErrors) -> list[str]:
    names = evidence.problem.constraint_names
    return [name.rpartition(".")[0] for name in names if name.startswith("motions.")]


def _time_of_motions(evidence: SeriesErrors, k: int) -> float | None:
    """Steps by which the law of a motion is late, if Φ is met at that time in all rows of a run."""
    run, problem = evidence.runs[k], evidence.problem
    rows = np.flatnonzero(run.t > evidence.t0 + 1.5 * evidence.step_of(run))
    for shift in _SHIFTS if len(rows) and _driven(evidence) else ():
        missed = [
            [np.abs(problem.constraint_values(run.t[row] + c * run.size, run.state["u"][row])).max()
             for row in rows]
            for c in (0.0, shift)
        ]  # fmt: skip
        if max(missed[1]) < _MET * max(missed[0]):
            return shift
    return None


def _after_start(evidence: SeriesErrors) -> list[Array]:
    """Of each run, (rows, m) misfits of Φ after its start."""
    return [
        evidence.misfit(k)[run.t > evidence.t0 + 0.5 * evidence.step_of(run)]
        for k, run in enumerate(evidence.runs)
    ]


def _held(evidence: SeriesErrors, k: int, missed: float) -> tuple[str, str, str] | None:
    """What is held in place of Φ: its symbol, level and formulation."""
    run, end = evidence.runs[k], len(evidence.runs) - 1
    if not evidence.whole["v"]:
        return None
    rate = _rate(evidence, k)
    of_rate = "Φ′", "velocities (index 2)", "index-2"
    if rate < max(3 * evidence.resolution["v"], 2e-13):
        return of_rate
    if evidence.whole["lambda"]:
        off = evidence.off_implied(k)[run.t > evidence.t0]
        gap = np.abs(off[np.isfinite(off)]).max(initial=0.0)
        if gap < max(1e-2 * missed, 10 * evidence.resolution["lambda"], 1e-10):
            return "Φ″", "accelerations (index 1)", "index-1"
    # What is held to a tolerance does not fall with h.
    small = rate < 1e-2 * missed and (k == end or _rate(evidence, end) > 0.1 * rate)
    return of_rate if small else None


def _rate(evidence: SeriesErrors, k: int) -> float:
    """Largest misfit of Φ′ of a run, after its start."""
    later = evidence.runs[k].t > evidence.t0
    return float(np.abs(evidence.misfit(k, rate=True)[later]).max(initial=0.0))


def alternation(evidence: SeriesErrors) -> Iterator[Finding]:
    """λ less what u and v imply, of opposite signs in successive rows and no smaller with h."""
    if not all(evidence.whole.values()):
        return
    damped, seen = evidence.told.damped, []
    for k, run in enumerate(evidence.runs):
        if damped and evidence.fades(run, float(run.t[-1])) > _FADED:
            continue  # what the start left has not been damped yet
        gaps = np.flatnonzero(np.abs(np.diff(run.t) - run.size) > 1e-6 * run.size)
        first = int(gaps[-1]) + 1 if len(gaps) else int(run.t[0] < evidence.t0 + 1e-11)
        off = evidence.off_implied(k)[max(first, len(run.t) - _LAST) :]
        if len(off) > 2 and np.isfinite(off).all():
            worst = off[:, int(np.abs(off).max(axis=0).argmax())]
            largest = np.abs(worst).max()
            steady = np.abs(np.diff(np.abs(worst))).max() < 0.5 * largest
            if (worst[1:] * worst[:-1] < 0).all() and steady:
                seen.append((run.size, float(largest)))
    if len(seen) < max(2, len(evidence.runs) / 2) or seen[-1][1] < max(0.3 * seen[0][1], 1e-8):
        return
    h, amplitude = seen[-1]
    why = "a method of this name damps it" if damped else (
        "nothing damps it, as in the trapezoidal rule; take generalized-α, HHT or BDF2, "
        "project velocities, or average two steps"
    )  # fmt: skip
    text = f"λ alternates from step to step by {amplitude:.2g} of its size at h = {h:g}, and no "
    name = "seen" if damped else "alternation"
    yield evidence.finding(name, f"{text}smaller h helps: {why}", damped, amplitude=amplitude, h=h)


def in_pairs(evidence: SeriesErrors) -> bool:
    """Whether the smaller step sizes have three successive rows, so that λ would alternate."""
    return all(
        (np.abs(np.diff(run.t)[-2:] - run.size) < 1e-6 * run.size).sum() > 1
        for run in evidence.runs[-2:]
    )


def factors(evidence: SeriesErrors) -> list[tuple[str, float, int]]:
    """Constraint, factor and power of h where λ is that times what u and v imply, at all rows."""
    knows = evidence.whole["u"] and evidence.whole["v"] and evidence.has["lambda"]
    if not knows or len(evidence.runs) < 2:
        return []
    values = []
    for k, run in enumerate(evidence.runs):
        rows = np.flatnonzero(evidence.settled(run))[-_OF_FACTOR:]
        implied = evidence.implied(k)[rows]
        with np.errstate(all="ignore"):
            ratio = run.state["lambda"][rows] / implied
        values.append(np.where(np.abs(implied) > 0.05 * evidence.scale["lambda"], ratio, np.nan))
    hits: list[tuple[str, float, int]] = []
    for (j, name), runs in itertools.product(enumerate(evidence.problem.constraint_names), (3, 2)):
        of = [value[:, j] for value in values[-runs:]]
        if any(np.isnan(x).all() for x in of) or name in [hit[0] for hit in hits]:
            continue
        c = np.array([np.nanmedian(x) for x in of])
        if not c.all():
            continue
        spread = max(float(np.nanmax(x) - np.nanmin(x)) for x in of)
        for power in _POWERS if runs > 2 else (0,):
            scaled = c / evidence.h[-len(of) :] ** power
            unsure = max(spread / np.abs(c).min(), float(np.ptp(scaled / scaled[-1])),
                         float(evidence.floor("lambda")[-1]))  # fmt: skip
            if unsure < 0.05 and (power or abs(scaled[-1] - 1) > max(8 * unsure, _NEAR_ONE)):
                hits.append((name, float(scaled[-1]), power))
                break
    return hits


def of_another_time(evidence: SeriesErrors) -> Iterator[Finding]:
    """λ of order 1 where u and v have a higher one: its time, or that of the a it comes from.

    To first order in h, λ of t − c h is off by −c h λ', and λ of M a(t − c h) = f + G λ by
    −c h G⁺ M a'.  One c must explain all rows of three step sizes.
    """
    order, scatter = evidence.order("lambda")
    others = [evidence.order(part)[0] for part in ("u", "v")]
    if not abs(order - 1) < _OFF_ONE or scatter > _SCATTER or any(of < 1.5 for of in others):
        return
    found: dict[str, list[tuple[float, float]]] = {"λ": [], "a": []}
    for k in range(len(evidence.runs) - 3, len(evidence.runs)):
        run = evidence.runs[k]
        rows = np.flatnonzero(evidence.settled(run))[-_LAST:]
        t, late = run.t[rows], _APART * run.size
        now, then = evidence.truth.at(t + late), evidence.truth.at(t - late)
        rate = {part: (now[part] - then[part]) / (2 * late) for part in ("lambda", "a")}
        gradients = [
            evidence.problem.gradient(time, u) for time, u in zip(t, now["u"], strict=True)
        ]
        of_a = np.array([
            np.linalg.lstsq(G, evidence.problem.M @ a, rcond=None)[0]
            for G, a in zip(gradients, rate["a"], strict=True)
        ])  # fmt: skip
        off = evidence.error("lambda", k)[rows]
        for name, slope in (("λ", rate["lambda"]), ("a", of_a)):
            by = -run.size * evidence.of("lambda", slope)
            c = float((by * off).sum() / max((by * by).sum(), 1e-300))
            left = float(np.abs(off - c * by).max() / max(float(np.abs(off).max()), 1e-300))
            found[name].append((c, left))
    good = {
        name: each for name, each in found.items()
        if max(left for _, left in each) < _LEAVES and np.ptp([c for c, _ in each]) < _LEAVES / 2
        and abs(each[-1][0]) < 1.6
    }  # fmt: skip
    if not good:
        return
    said = {"λ": "it is that of t − {:.3g} h, as methods have it that take λ within the step",
            "a": "it is of accelerations of t − {:.3g} h, as of differences of v"}  # fmt: skip
    texts = " or ".join(said[name].format(each[-1][0]) for name, each in good.items())
    left = max(each[-1][1] for each in good.values())
    text = (
        f"λ has order {order:.2f}, where u and v have more: {texts}; at all rows {left:.1%} is left"
    )
    fault = "λ" not in good and evidence.told.order > 1
    numbers = {"shift": -next(iter(good.values()))[-1][0], "left": left}
    yield evidence.finding("late", text, fault, parts=["lambda"], **numbers)


#: Factor of λ, power of h → what usually gives it.
_KNOWN = {
    (0.5, 0): "Φ is twice as large, such as |Δ|² − L² in place of half of it",
    (2.0, 0): "Φ is half as large",
    (1e-3, 0): "λ is in kN",
    (1.0, 1): "λ is an impulse, force times h",
    (1.0, 2): "λ is scaled by h², and was not scaled back",
    (0.25, 2): "λ is scaled by β h², and was not scaled back",
    (1.0, -2): "λ is divided by h²",
}


def reason(evidence: SeriesErrors, name: str, factor: float, power: int) -> str:
    """What usually gives a factor of λ; empty where nothing known does."""
    for (value, of_power), why in _KNOWN.items():
        if power == of_power and abs(factor / value - 1) < 0.02:
            return why
    _, end = _gradient(evidence, evidence.problem.constraint_names.index(name))
    if power == 0 and abs(factor / end - 1) < 0.02:
        return "Φ is a length, |Δ| − L in place of ½(|Δ|² − L²)"
    return ""


def _gradient(evidence: SeriesErrors, k: int) -> tuple[float, float]:
    """|G_k| at the end of the motion, and that of its point with the largest: Δ of a bar."""
    problem, u = evidence.problem, evidence.reference[-1]["u"][-1]
    G = problem.gradient(evidence.end, u)[:, k]
    points = [name.rpartition(".")[0] for name in problem.coordinate_names]
    squares = {point: sum(g * g for g, of in zip(G, points, strict=True) if of == point)
               for point in points}  # fmt: skip
    return float(np.linalg.norm(G)), max(math.sqrt(max(squares.values())), 1e-300)
