"""Says of one series what is wrong with the code, each cause with the test that it has passed.

Rules stand in the order in which causes hide each other: runs and numbers first, then the start,
the motion, the constraints, and λ last.  What no rule explains is only said to be seen.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.codes import geometry, levels
from newmark_cli.codes.changes import TERMS, Discrepancy, FittedChange, explained_by
from newmark_cli.codes.evidence import (
    PARTS,
    SYMBOLS,
    Finding,
    SeriesErrors,
    Told,
    is_single,
    order_of,
    printed,
)
from newmark_cli.codes.file_numbers import FileNumbers
from newmark_cli.codes.pushes import first_order
from newmark_cli.codes.truth import NoMotion, Truth
from newmark_cli.support.arrays import Array

if TYPE_CHECKING:
    from newmark_cli.codes.reading import Run
    from newmark_cli.codes.solutions import Measured

#: Steps after which a count of iterations that is no less is a sum.
_FEW = 20
#: Error of u, in sizes, that tells of no solution at all.
_WRECKED = 10.0
#: Times in h at which a state may be another one's, and what part of the error may be left.
_SHIFTS, _LEFT = (-1.0, -0.5, 0.5, 1.0), 0.1
#: Iterations that count as many, and the part of the steps that must have as many.
_MANY, _OFTEN = 8, 0.1
#: Tolerances that an error should not exceed.
_TOLERANCES = 1e3
#: Error that rounding to single precision may leave.
_ROUNDED = 3e-7
#: Numbers that may each explain a table, of which a sentence names at most so many.
_NAMED = 4


def explained(
    runs: Sequence["Run"],
    measured: Sequence["Measured"],
    told: Told,
    truth: Truth,
    file: FileNumbers | None = None,
) -> list[Finding]:
    """Findings on one series.

    Args:
        runs: All its runs, by descending sizes.
        measured: Those that ended, twins aside, with their errors.
        told: What the caller says of the code.
        truth: The solution, until a step after the last row.
        file: The mechanism's file, whose numbers may be changed; None of other problems.
    """
    found = _failures(runs, told)
    if not measured:
        return found
    evidence = SeriesErrors(measured, told, truth)
    found += _numbers(evidence)
    if told.steps:
        found += [*_clock(evidence), *_unstable(evidence)]
        if _named(found, "unstable"):
            return found
        if evidence.stopped:
            sizes = ", ".join(f"{h:g}" for h in evidence.stopped)
            found.append(evidence.finding("seen", f"runs of h = {sizes} end before the others"))
    else:
        found += _beyond_tolerance(evidence)
    late = ([*_late(evidence)] or [*levels.of_another_time(evidence)]) if told.steps else []
    # Rows of t = 0 that are those of another time, too, are no other start.
    if not any("u" in one.evidence["parts"] for one in late if one.fault):
        found += _of_geometry(evidence, file) or _of_start(evidence, found)
    as_told = not _named(found, "start", "length", "another mechanism")
    if as_told and told.steps:
        found += _of_motion(evidence, found, late, file)
    elif as_told and any(evidence.elsewhere(part) for part in ("u", "v")):
        found += _mechanism(evidence, file)
    return [*found, *_out_of_reach(evidence), *_tangent(evidence)]


def without_solution(runs: Sequence["Run"], t0: float, told: Told, why: str) -> list[Finding]:
    """What the differences of successive step sizes say, of a motion that has no solution.

    Args:
        runs, told: As of `explained`.
        t0: Time of the start (s).
        why: Why there is none.
    """
    found = _failures(runs, told)
    ended = [run for run in runs if run.ended and not run.twin]
    ends = [run for run in ended if abs(run.t[-1] - ended[-1].t[-1]) < 0.1 * ended[-1].size]
    said, low = [], False
    for part in PARTS if told.steps and len(ends) > 2 else ():
        values = np.array([run.state[part][-1] for run in ends])
        values = values[:, np.isfinite(values).all(axis=0)]
        if not values.size:
            continue
        gaps = np.abs(np.diff(values, axis=0)).max(axis=1)
        resolution = 3 * printed(ends, part, t0) * float(np.abs(values).max())
        if (gaps > resolution).sum() < 2:
            continue
        order = order_of(np.array([run.size for run in ends]), gaps, gaps > resolution)
        said.append(f"of {SYMBOLS[part]} with order {order:.2f}")
        low = low or (told.order > 0 and part != "lambda" and order < told.order - 0.35)
    text = f"{why}; so errors cannot be measured"
    if said:
        text += f", but differences of successive step sizes fall: {', '.join(said)}"
    return [*found, Finding("no solution", runs[0].series, text, low or not said)]


def _named(found: Sequence[Finding], *names: str) -> bool:
    return any(one.name in names and one.fault for one in found)


def _of_geometry(evidence: SeriesErrors, file: FileNumbers | None) -> list[Finding]:
    """A number with which Φ is met; a code may also keep what its start misses."""
    starts = [one for one in _start(evidence) if one.name == "start"]
    if starts and evidence.told.formulation in ("index-1", "index-2"):
        return []
    found = [*geometry.changed(evidence, file)]
    held = bool(evidence.told.formulation)
    if not found or (held and len(found[0].evidence["changes"]) == 1):
        return found
    also = ""
    if starts:
        also = f"; a code that keeps what its start misses does the same where {starts[0].text}"
    elif all(run.t[0] > evidence.t0 + 1e-11 for run in evidence.runs):
        also = "; a code that keeps what its start misses does the same: print the row of t = 0"
    return [replace(found[0], text=found[0].text + also)]


def _of_start(evidence: SeriesErrors, found: Sequence[Finding]) -> list[Finding]:
    """The start, or a length that is another one: both miss Φ at the first row."""
    starts = [*_start(evidence)]
    lengths = [] if _named(found, "single precision") else [*levels.length(evidence)]
    # Held at a level above, positions keep what the start misses.
    if lengths and not (starts and evidence.told.formulation in ("index-1", "index-2")):
        return lengths
    return starts


def _of_motion(
    evidence: SeriesErrors,
    before: Sequence[Finding],
    late: Sequence[Finding],
    file: FileNumbers | None,
) -> list[Finding]:
    """What u, v and λ say, where the start is the mechanism's."""
    found = [*late]
    if _named([*before, *late], "late", "clock", "single precision"):
        return found
    found += _mixed(evidence)
    if _named(found, "mixed"):
        return found
    found += levels.single(evidence)
    if _named(found, "single precision"):
        return found
    alternates = [*levels.alternation(evidence)]
    if any(evidence.elsewhere(part) for part in ("u", "v")):
        other = [*_mechanism(evidence, file, ("lambda",) if alternates else ())]
        if not _named(other, "another mechanism"):
            of_step = [one for one in first_order(evidence) if one.name != "seen"]
            other = of_step or other
        return [*found, *other, *alternates]
    explains = bool(alternates) or any("λ is" in one.text for one in found)
    if not explains:
        of_lambda = [*_factor(evidence, file)]
        undamped = evidence.told.integrator is not None and not evidence.told.damped
        sure = not undamped or levels.in_pairs(evidence)
        if not of_lambda and sure and evidence.elsewhere("lambda"):
            of_lambda = [*_mechanism(evidence, file)]
        found += of_lambda
        explains = bool(of_lambda)
    held = [*levels.constraints(evidence)]
    # An iteration that ends early leaves forces of a state before, too.
    pushed = [] if _named(held, "Newton ends early") else [*first_order(evidence)]
    lacking = pushed and TERMS.get(pushed[0].name)
    for k, one in enumerate(found if lacking else ()):
        if any(name.startswith(lacking) for name in one.evidence.get("changes", ())):
            left = pushed.pop().evidence["left"]
            also = f"; it explains errors of u and v of order 1, too, all but {left:.1%}"
            found[k] = replace(one, text=one.text + also)
            break
    found += [*pushed, *held, *alternates]
    if not explains and not any(one.fault for one in found):
        found += [*_lambda_stops(evidence)] or [*_low_order(evidence)]
    return found


# -- runs and numbers -------------------------------------------------------------------------


def _failures(runs: Sequence["Run"], told: Told) -> list[Finding]:
    failed = [run for run in runs if not run.ended]
    if not failed:
        return []
    said = next((run.message for run in failed if run.message), "")
    lacks = ", ".join(dict.fromkeys(name for run in failed for name in run.lacks[:3]))
    sizes = ", ".join(f"{run.size:g}" for run in failed)
    because = f"the code says “{said}”" if said else f"no number for {lacks} in the last row"
    name = "h" if told.steps else "tolerance"
    return [Finding("failure", runs[0].series, f"no result at {name} = {sizes}: {because}")]


def _numbers(evidence: SeriesErrors) -> Iterator[Finding]:
    worst = max((evidence.resolution[part] for part in PARTS if evidence.has[part]), default=0.0)
    if evidence.single:
        parts = " and ".join(SYMBOLS[part] for part in evidence.single)
        text = f"every number of {parts} is one of single precision: compute and print in double "
        yield evidence.finding("single precision", f"{text}precision")
    elif worst > 1e-13:
        text = f"printed to {worst:.0e} of their size: errors below are not judged; print 17 digits"
        yield evidence.finding("printing", text, False, resolution=worst)


def _clock(evidence: SeriesErrors) -> Iterator[Finding]:
    """T off whole steps, by a sum in single precision."""
    t = np.concatenate([run.t[run.t > evidence.t0] for run in evidence.runs])
    steps = [((run.t - evidence.t0) / run.size, run.size) for run in evidence.runs]
    off = max(float(np.abs(of - np.round(of)).max() * size) for of, size in steps)
    whole = np.all(np.abs(t - np.round(t, 6)) < 1e-13)
    if not whole and is_single(t) and off > 1e-9 * evidence.end:
        text = f"t is {off:.1e} s off whole steps and a number of single precision: take t = k h in"
        yield evidence.finding("clock", f"{text} double", off=off)


def _unstable(evidence: SeriesErrors) -> Iterator[Finding]:
    if not evidence.has["u"]:
        return
    u, h = evidence.last("u"), evidence.h
    worst = max(float(u.max()), float(evidence.last("v").max()) if evidence.has["v"] else 0.0)
    at = h[int(u.argmax())]
    stopped = [size for size in evidence.stopped if size < at]
    lost = bool(evidence.stopped) and worst > _WRECKED and min(evidence.stopped) < h[-1]
    grows = u.max() > _WRECKED and (bool(stopped) or (len(u) > 1 and u[-1] > 1 and u[-1] > u[0]))
    if lost or grows:
        smaller = (f"runs of h = {max(stopped):g} and less do not arrive" if stopped
                   else f"at the smallest h it is {u[-1]:.1g}")  # fmt: skip
        text = (
            f"u is {u.max():.1g} times its size off at h = {at:g}, and {smaller}: "
            "the method is unstable for constrained motion, as with a γ that does not go with β "
            "(β ≥ (γ + ½)²/4, γ ≥ ½; generalized-α: γ = ½ − α_m + α_f)"
        )
        yield evidence.finding("unstable", text, error=float(u.max()))


def _beyond_tolerance(evidence: SeriesErrors) -> Iterator[Finding]:
    tolerance = float(evidence.h[-1])
    for part in PARTS:
        off = float(evidence.last(part)[-1]) if evidence.has[part] else 0.0
        if off > max(_TOLERANCES * tolerance, 10 * evidence.floor(part)[-1]):
            text = f"{SYMBOLS[part]} is {off:.2g} off at tolerance {tolerance:g}: "
            text += f"{off / tolerance:.2g} tolerances"
            yield evidence.finding("seen", text, False, error=off)


# -- start and time ---------------------------------------------------------------------------


def _start(evidence: SeriesErrors) -> Iterator[Finding]:
    """Rows at t = 0 that are not the problem's start; without such rows nothing is said."""
    for k, run in enumerate(evidence.runs):
        at = np.flatnonzero(np.abs(run.t - evidence.t0) < 1e-11)
        for part in ("u", "v"):
            if not len(at) or not evidence.has[part] or (part == "v" and evidence.told.corrected):
                continue
            off = np.abs(evidence.error(part, k)[at[0]])
            allowed = 1e-6 if part in evidence.single else 3 * evidence.resolution[part] + 1e-9
            if not (np.isfinite(off).all() and off.max() > allowed):
                continue
            place = int(np.flatnonzero(evidence.known[part])[off.argmax()])
            name = f"{part}[{evidence.problem.coordinate_names[place]}]"
            phi, rate = (
                float(np.abs(evidence.misfit(k, of_v)[at[0]]).max(initial=0.0))
                if evidence.whole["u"] and (evidence.whole["v"] or not of_v)
                else 0.0
                for of_v in (False, True)
            )
            kind = "start"
            violates = max(phi, rate) > max(1e-9, allowed)
            if violates:
                says = f"; it misses Φ by {phi:.1g} and Φ′ by {rate:.1g}: no motion begins there"
            elif _begins(evidence, at[0], k):
                says = "; the motion from there is what the code computes"
            else:
                kind, says = "seen", ", which does not explain the rows that follow"
            text = f"the row of t = 0 has {name} off by {off.max():.2g} of the largest {part}{says}"
            yield evidence.finding(
                kind, text, coordinate=name, off=float(off.max()), misfit=phi, rate=rate,
                violates=violates,
            )  # fmt: skip
            return


def _begins(evidence: SeriesErrors, row: int, k: int) -> bool:
    """Whether the motion from a row of t = 0 is what the smallest step size converges to."""
    if not (evidence.whole["u"] and evidence.whole["v"]):
        return True
    run, first = evidence.runs[-1], evidence.runs[k].state
    try:
        truth = Truth(evidence.problem, float(run.t[-1]), u0=first["u"][row], v0=first["v"][row])
    except NoMotion:
        return False
    there = truth.at(run.t[-1:])
    left = max(
        float(np.abs(evidence.of(part, run.state[part][-1] - there[part][0])).max())
        - 3 * evidence.bound(part)
        for part in ("u", "v")
    )
    return bool(left < 0.05 * max(evidence.last("u")[-1], evidence.last("v")[-1]))


def _late(evidence: SeriesErrors) -> Iterator[Finding]:
    """U and v, or λ, of another time t + c h, at three step sizes and all of their rows."""
    if len(evidence.runs) < 3:
        return
    for parts in (("u", "v"), ("u",), ("v",), ("lambda",)):
        if not all(evidence.has[part] for part in parts):
            continue
        for c in _SHIFTS:
            left = [_left_at(evidence, parts, c, k) for k in range(-3, 0)]
            # No change of a step leaves v with order 1 and u with order 2.
            apart = parts == ("v",) and evidence.order("u")[0] > 1.5
            if max(left) <= 2 * _LEFT and left[-1] <= (2 * _LEFT if apart else _LEFT):
                yield _of_time(evidence, parts, c, left[-1])
                return


def _left_at(evidence: SeriesErrors, parts: Sequence[str], c: float, k: int) -> float:
    """Part of the error of a run that is left against the solution at t + c h."""
    run = evidence.runs[k]
    there = run.t + c * run.size
    known = (there >= evidence.t0 - 1e-12) & (there <= evidence.problem.until)
    rows = np.flatnonzero(known & (run.t > evidence.t0 + 0.5 * run.size))
    if parts == ("lambda",):
        rows = rows[evidence.settled(run)[rows]]
    if not len(rows):
        return math.inf
    right, left = evidence.truth.at(there[rows]), 0.0
    for part in parts:
        off = evidence.of(part, run.state[part][rows] - right[part])
        now = evidence.error(part, k)[rows]
        left = max(left, float(np.abs(off).max()) / max(float(np.abs(now).max()), 1e-300))
    return left


def _of_time(evidence: SeriesErrors, parts: Sequence[str], c: float, left: float) -> Finding:
    sign, size = "−" if c < 0 else "+", "½" if abs(c) == 0.5 else "1"
    said = f"{' and '.join(SYMBOLS[part] for part in parts)} {'are' if len(parts) > 1 else 'is'} "
    said += f"of t {sign} {size} h"
    numbers: dict[str, Any] = {"parts": [*parts], "shift": c, "left": left}
    rest = np.abs(evidence.problem.v0).max(initial=0.0) < 1e-6 * evidence.scale["v"]
    if "u" in parts and abs(c) == 0.5 and rest:
        text = f"{said}: from rest, a first step that lacks ½ h a(0) does the same"
        return evidence.finding("seen", text, **numbers)
    text = f"{said}, at every h and row: against the solution at that time {left:.1%} is left of it"
    orders = [evidence.order(part) for part in ("u", "v") if part not in parts]
    told, by_design = evidence.told, parts == ("lambda",)
    if by_design and (
        0 < told.order < 2 or any(order < 1.5 and scatter < 0.5 for order, scatter in orders)
    ):
        text += ", as methods of order 1 have it"
    elif by_design and abs(c) == 0.5:
        text += ", as methods have it that take λ in the middle of the step"
    else:
        by_design = False
    return evidence.finding("late", text, not by_design, **numbers)


def _mixed(evidence: SeriesErrors) -> Iterator[Finding]:
    """One run that does not lie on the line of all others."""
    if len(evidence.runs) < 4:
        return
    for part in ("u", "v"):
        if not evidence.has[part]:
            continue
        clear = evidence.last(part) > 10 * evidence.floor(part)
        if clear.sum() < 4 or not clear[: clear.sum()].all():
            continue
        x, y = np.log(evidence.h[clear]), np.log(evidence.last(part)[clear])
        # At the smallest h it may be rounding, where that was not measured with the method; three
        # others tell of the coarsest only.
        smallest = len(x) if evidence.told.integrator and clear.all() else len(x) - 1
        for k in range(smallest if len(x) > 4 else 1):
            rest = np.arange(len(x)) != k
            fit = np.polyfit(x[rest], y[rest], 1)
            above = float(y[k] - np.polyval(fit, x[k]))
            straight = np.abs(np.polyval(fit, x[rest]) - y[rest]).max() < 0.25
            if 0.7 < fit[0] < 6 and straight and above > 2.3:
                h, factor = float(evidence.h[k]), math.exp(above)
                text = f"{SYMBOLS[part]} at h = {h:g} is {factor:.2g} times what all other step "
                text += "sizes say: "
                # A coarse run of a sound code may be too coarse.
                coarse = k == 0
                text += (
                    "as that h is the coarsest, the run is left out; it is of other settings, or h "
                    "is too coarse there, which runs between it and the next would tell"
                    if coarse else "that run is of other settings"
                )  # fmt: skip
                yield evidence.finding("mixed", text, not coarse, h=h, factor=factor)
                return


# -- another mechanism, factors of λ ----------------------------------------------------------


def _mechanism(
    evidence: SeriesErrors, file: FileNumbers | None, without: Sequence[str] = ()
) -> Iterator[Finding]:
    """The one number of the file that explains u, v and λ, proved by a new solution."""
    wanted = Discrepancy(evidence, without)
    if not wanted.converges():
        text = f"{wanted.seen()}; differences of successive step sizes do not fall, so that no "
        yield evidence.finding("seen", f"{text}number is sought: Newton's iteration may end early")
        return
    fits = wanted.search(file)
    if good := _good(wanted, fits):
        yield _another(evidence, wanted, good)
        return
    what = "no single number of the mechanism explains it" if file else (
        "a number of the problem differs")  # fmt: skip
    if wanted.largest < _ROUNDED:
        what += "; forces or numbers that are rounded to single precision leave as much"
    tried = {fit.candidate.name: fit.change for fit in fits[:_NAMED]}
    yield evidence.finding("seen", f"{wanted.seen()}; {what}", tried=tried)


def _good(wanted: Discrepancy, fits: Sequence[FittedChange]) -> list[FittedChange]:
    """Changes that explain all, also what was not fitted."""
    return [fit for fit in explained_by(fits) if wanted.holds(fit)]


def _another(evidence: SeriesErrors, wanted: Discrepancy, good: Sequence[FittedChange]) -> Finding:
    """The numbers that each explain a table."""
    names = " or ".join(fit.candidate.said(fit.change) for fit in good[:_NAMED])
    told = " and ".join(SYMBOLS[part] for part in wanted.parts)
    if len(good) == 1:
        says = f"this alone explains {told} at all rows"
    else:
        lacks = "rows at another time" if "lambda" in wanted.parts else "λ, or rows at another time"
        says = f"each explains {told}, and the table cannot tell them apart; {lacks} would"
    numbers = {fit.candidate.name: fit.change for fit in good[:_NAMED]}
    return evidence.finding(
        "another mechanism", f"{wanted.seen()}; {names}: {says}", changes=numbers
    )


def _factor(evidence: SeriesErrors, file: FileNumbers | None) -> Iterator[Finding]:
    """λ over what u and v imply: one number, or one times a power of h, at all h and t.

    One row says nothing of a λ that may alternate.  A number that shows in λ only, as in a driven
    mechanism, goes before factors of some constraints, and beside one factor of all.
    """
    hits = levels.factors(evidence)
    if not hits:
        return
    said = ", ".join(f"{name}: {c:.5g}{f' h^{power}' if power else ''}" for name, c, power in hits)
    powers = [power for _, _, power in hits]
    numbers: dict[str, Any] = {"factors": {name: c for name, c, _ in hits}, "powers": powers}
    problem, told = evidence.problem, evidence.told
    alike = len(hits) == problem.m and len({(f"{c:.3g}", power) for _, c, power in hits}) == 1
    pairs = all((np.abs(np.diff(run.t) - run.size) < 1e-6 * run.size).any()
                for run in evidence.runs[-3:])  # fmt: skip
    if not pairs and not told.damped and not (alike and problem.m > 1):
        text = (
            f"λ is a constant times what u and v imply at the end ({said}): a factor, or λ "
            "alternates; rows of the last three steps would tell"
        )
        yield evidence.finding("seen", text, told.integrator is None, **numbers)
        return
    good: list[FittedChange] = []
    if not any(powers) and evidence.elsewhere("lambda"):
        wanted = Discrepancy(evidence)
        good = _good(wanted, wanted.search(file))
        if good and not alike:
            yield _another(evidence, wanted, good)
            return
    why = next(filter(None, (levels.reason(evidence, *hit) for hit in hits)), "")
    why = why or "another Φ, unit or scaling of λ"
    if alike and not any(powers):
        why += ", or every mass and force is that many times the mechanism's"
    for fit in good[:_NAMED]:
        why += f", or {fit.candidate.said(fit.change)}"
        numbers.setdefault("changes", {})[fit.candidate.name] = fit.change
    why += ", which cannot be told apart, as u and v are the same" if good else ""
    text = f"λ is a constant times what u and v imply, at all h and t ({said}): {why}"
    yield evidence.finding("factor of λ", text, **numbers)


# -- what is seen -----------------------------------------------------------------------------


def _lambda_stops(evidence: SeriesErrors) -> Iterator[Finding]:
    if not evidence.has["lambda"] or len(evidence.runs) < 3 or evidence.told.integrator is None:
        return
    values = evidence.last("lambda")
    sound = max(evidence.ours(-1, "lambda"), float(evidence.floor("lambda")[-1]))
    if values[-1] > 30 * sound and values[-1] > 0.5 * max(values[-2], values[-3]):
        how = "grows to" if values[-1] > 3 * values.min() else "stops falling at"
        text = f"λ {how} {values[-1]:.2g} (h = {evidence.h[-1]:g}), where a sound code leaves "
        yield evidence.finding("seen", f"{text}{sound:.1g}", error=float(values[-1]))


def _low_order(evidence: SeriesErrors) -> Iterator[Finding]:
    wanted = evidence.told.order
    for part in ("u", "v"):
        order, scatter = evidence.order(part)
        if wanted and scatter < 0.3 and order < wanted - 0.35:
            text = f"{SYMBOLS[part]} has order {order:.2f}, where the method has {wanted}"
            yield evidence.finding("seen", text, order=order)
            return


def _out_of_reach(evidence: SeriesErrors) -> Iterator[Finding]:
    """Newton's iterations that become many at small h."""
    if len(evidence.runs) < 2 or not all("iterations" in run.numbers for run in evidence.runs):
        return
    counts = [run.numbers["iterations"] for run in evidence.runs]
    if evidence.told.steps:
        counts = _of_steps(evidence, counts)
    counts = [of[of > 0] for of in counts]
    if not all(map(len, counts)):
        return
    usual = float(np.median(counts[0]))
    shares = np.array([np.mean(of >= max(_MANY, 2 * usual)) for of in counts])
    if shares[0] == 0 and shares[-1] > _OFTEN:
        most = max(float(of.max()) for of in counts)
        sizes = ", ".join(f"{h:g}" for h in evidence.h[shares > _OFTEN])
        text = (
            f"Newton takes up to {most:g} iterations at h = {sizes} and {usual:g} at h = "
            f"{evidence.h[0]:g}: its tolerance cannot be met there, as corrections of λ end where "
            "rounding leaves them; test λ times h², or stop where corrections grow"
        )
        yield evidence.finding("tolerance out of reach", text, iterations=most, usual=usual)


def _of_steps(evidence: SeriesErrors, counts: Sequence[Array]) -> list[Array]:
    """Iterations in each step, where the table has their sums since the start."""
    done = [np.maximum((run.t - evidence.t0) / evidence.step_of(run), 1) for run in evidence.runs]
    later = [of[steps > _FEW] / steps[steps > _FEW] for of, steps in zip(counts, done, strict=True)]
    sums = all(map(len, later)) and min(float(of.min()) for of in later) > 0.5
    return [of / steps if sums else of for of, steps in zip(counts, done, strict=True)]


def _tangent(evidence: SeriesErrors) -> Iterator[Finding]:
    """Corrections that fall linearly: the ratio of a quadratic fall counts as 0."""
    ratios = []
    for run in evidence.runs:
        for row in run.corrections:
            sizes = row[np.isfinite(row) & (row > 1e-13 * evidence.scale["u"])]
            if len(sizes) > 2:
                *_, before, last = sizes[1:] / sizes[:-1]
                ratios.append(float(last) if before**1.5 < last < 1 else 0.0)
    if len(ratios) > 2 and np.median(ratios) > 0:
        text = (
            f"each correction is about {max(ratios):.2g} of the one before: the tangent lacks "
            "terms, such as the geometric stiffness ∂(Gλ)/∂u, or is not renewed; results are "
            "right, but cost more iterations"
        )
        yield evidence.finding("linear convergence", text, ratio=max(ratios))
