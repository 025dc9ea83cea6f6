"""Errors and invariants of another code's runs, and what rounding changes in them.

They are those of the measures `error` and `invariant`, against the same references.  Rounding
is told by the runs' own twins; without any, by a march of this tool's with the same method and
step size and its twins, as far as that is affordable, and from there on by powers of h.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.codes.reading import STEP_SIZE, Run, Runs
from newmark_cli.library.marching import march
from newmark_cli.library.scalings import read
from newmark_cli.newmark.formulation import RECOVERED
from newmark_cli.newmark.invariants import Misfit, misfits
from newmark_cli.newmark.statistics import Measurement, statistics
from newmark_cli.newmark.twins import last_places_off
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.multipliers import relative
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import NoReference, Reference, solution
from newmark_cli.report.judging.slopes import Slope, study_slopes
from newmark_cli.report.judging.verdicts import SHOWN
from newmark_cli.study import axes
from newmark_cli.study.compute import with_rounding
from newmark_cli.study.csv_files import NUMBERS
from newmark_cli.study.measures import OF_OUTPUTS
from newmark_cli.study.observers import Deviations
from newmark_cli.study.observers import invariants as compared
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError, InputError

#: The method that a code is held against where nobody says which it has.
USUAL = {"integrator": "generalized-alpha rho=0.9", "formulation": "index-3"}
#: Twins of a march of this tool's; most steps of all of these, of a problem with one unknown;
#: and unknowns that make a step twice as long.
_TWINS, _MOST_STEPS, _UNKNOWNS = 3, 2_000_000, 5
#: Rows of a run at which invariants are looked at, besides the first and last of it.
_SAMPLES, _ENDS = 32, 3
_EPS = float(np.finfo(float).eps)
#: Largest power of 1/h with which rounding of a quantity grows; 0 of others.
_GROWTH = {"lambda": 2.0, "multiplier": 2.0, "force": 2.0, "moment": 2.0,
           "v": 1.0, "velocity": 1.0, "omega": 1.0}  # fmt: skip
#: Times that differ by less, over their size, are the same.
SAME_TIME = 1e-11
#: Part of the time of a run within which others may end and be judged with it.
_SAME_END = 0.05


@dataclass(frozen=True, eq=False)
class Measured:
    """One run with what it is off by.

    Attributes:
        run: The run.
        errors: Measure, quantity → its value and what rounding changes in it.
        ours: The same of a march of this tool's with the run's method and step size; empty
            where none was affordable.
        iterations: Newton corrections of that march in the steps of the run's rows.
    """

    run: Run
    errors: Mapping[tuple[str, str], Measurement]
    ours: Mapping[tuple[str, str], Measurement]
    iterations: Array


@dataclass(frozen=True, eq=False)
class Motion:
    """Solutions of a problem at the times of runs."""

    problem: Problem
    references: dict[float, Reference]
    #: Time since the start (s) → solution, where one is given; computed otherwise.
    given: Callable[[float], Reference] | None = None

    def at(self, t: float) -> Reference:
        """The solution at a time (s).

        Raises:
            ArgumentError: When there is none.
        """
        for known, reference in self.references.items():
            if abs(known - t) <= SAME_TIME * max(1.0, abs(t)):
                return reference
        try:
            solve = self.given or partial(solution, self.problem)
            self.references[t] = solve(t - self.problem.t0)
        except NoReference as error:
            raise ArgumentError(str(error)) from None
        return self.references[t]


def method(options: Mapping[str, Any]) -> dict[str, str]:
    """Axis → value of a method, as CSVs have them.

    Raises:
        ArgumentError, IntegratorError, FormulationError: For what no method has.
    """
    labelled = ("integrator", "formulation", "projection")
    values = {
        name: read(name, value).label if name in labelled else str(value)
        for name, value in (USUAL | {k: v for k, v in options.items() if v}).items()
    }
    if values.get("projection", "none") != "none":
        values.setdefault("multipliers", RECOVERED)
    return values


def measured(runs: Runs, motion: Motion, options: Mapping[str, Any]) -> list[Measured]:
    """Every run that ended, twins aside, with its errors.

    Args:
        runs: The runs.
        motion: Solutions of the problem.
        options: Axis → value of their method where the table does not say it.
    """
    ended = [run for run in runs.runs if run.ended]
    first = [run for run in ended if run.twin == min(r.twin for r in ended if _same(r, run))]
    steps = {id(run): (run.t[-1] - motion.problem.t0) / run.size for run in first}
    left = _MOST_STEPS / (1 + (motion.problem.n + motion.problem.m) / _UNKNOWNS)
    ours: dict[int, tuple[list[Deviations], Array]] = {}
    if runs.abscissa == STEP_SIZE:
        for run in sorted(first, key=lambda run: steps[id(run)]):
            left -= steps[id(run)] * (1 + _TWINS)
            if left < 0:
                break
            if (marched := _of_march(run, motion, options)) is not None:
                ours[id(run)] = marched
    return [
        _measured(run, [r for r in ended if _same(r, run) and r is not run], motion, runs,
                  ours.get(id(run)))
        for run in first
    ]  # fmt: skip


def _same(one: Run, other: Run) -> bool:
    return one.series == other.series and one.size == other.size


def _measured(
    run: Run,
    twins: Sequence[Run],
    motion: Motion,
    runs: Runs,
    ours: tuple[list[Deviations], Array] | None,
) -> Measured:
    own = [deviations(r, motion, runs.components) for r in (run, *twins)]
    of_march, iterations = ours if ours is not None else ([], np.zeros(0))
    spread = own if twins else of_march
    reference = motion.at(float(run.t[-1]))
    return Measured(run, _rows(own[0], spread, reference), _rows(of_march[0], of_march, reference)
                    if of_march else {}, iterations)  # fmt: skip


def _rows(
    off: Deviations, marches: Sequence[Deviations], reference: Reference
) -> dict[tuple[str, str], Measurement]:
    rows = {}
    for name, values in off.items():
        measure, _, quantity = name.partition(" ")
        row = Measurement(name, measure, "primary", statistics(np.abs(values).max(axis=1)))
        if len(marches) > 1:
            of = {"lambda": "multipliers"}.get(of := OF_OUTPUTS.get(quantity, quantity), of)
            # What is printed of u and v is rounded itself, however well our own march meets it.
            unsure = getattr(reference, f"{of}_error", 0.0) if measure == "error" else _EPS
            row = with_rounding(row, marches, unsure)
        rows[measure, quantity] = replace(row, quantity=quantity)
    return rows


def deviations(
    run: Run, motion: Motion, components: Mapping[str, Sequence[str]], aside: int = 0
) -> Deviations:
    """“measure quantity” → (samples, k) by how much components are off, relative to their size.

    Args:
        run, motion, components: What is compared.
        aside: Which twin it is, whose invariants are looked at with other last places of u and
            v, as it meets to the bit what it projects or recovers; 0 of none.
    """
    problem, reference = motion.problem, motion.at(float(run.t[-1]))
    by_name: dict[str, Array] = {}

    def note(name: str, off: Array) -> None:
        if (known := ~np.isnan(off)).any():
            by_name[name] = off[None, known]

    end = {part: values[-1] for part, values in run.state.items()}
    for part, there in (("u", reference.u), ("v", reference.v)):
        note(f"error {part}", relative(end[part] - there, float(np.abs(there).max())))
    if problem.m:
        note("error lambda", relative(end["lambda"] - reference.multipliers, reference.scales))
    if components.get("output") and problem.outputs is not None:
        here, there = end["output"], problem.outputs.values(
            problem, run.t[-1], reference.u, reference.v, reference.multipliers
        )  # fmt: skip
        kinds = np.array([n.rpartition(".")[0].rpartition(".")[2] for n in problem.outputs.names])
        for kind in OF_OUTPUTS:
            of = kinds == kind
            if of.any():
                size = float(np.abs(there[of]).max())
                if kind == "moment":
                    lever = problem.outputs.length(reference.u)
                    size = max(size, lever * float(np.abs(there[kinds == "force"]).max()))
                note(f"error {kind}", relative(here[of] - there[of], size))
    samples = [misfits_at(problem, run, row, aside) for row in _looked_at(run, problem)]
    samples = [sample for sample in samples if sample]
    if samples:
        names = set(samples[0]).intersection(*samples)
        kept = [{name: sample[name] for name in samples[0] if name in names} for sample in samples]
        by_name |= {f"invariant {name}": off for name, off in compared(problem, kept).items()}
    return by_name


def _looked_at(run: Run, problem: Problem) -> list[int]:
    """Rows at which invariants are looked at, all after the start."""
    rows = np.flatnonzero(run.t > problem.t0 + SAME_TIME)
    if len(rows) > _SAMPLES:
        spread = np.round(np.linspace(0, len(rows) - 1, _SAMPLES)).astype(int)
        rows = rows[np.unique([*range(_ENDS), *spread, *range(len(rows) - _ENDS, len(rows))])]
    return [int(row) for row in rows]


def misfits_at(problem: Problem, run: Run, row: int, aside: int = 0) -> dict[str, Misfit]:
    """What a row of a run misses of the invariants that its columns tell of.

    λ is compared with that which u and v imply; u and v of a twin with other last places.
    """
    u, v, multipliers = (run.state.get(part, np.zeros((len(run.t), 0)))[row]
                         for part in ("u", "v", "lambda"))  # fmt: skip
    if not np.isfinite(u).all():
        return {}
    if aside:
        u, v = last_places_off(np.array([u, v]), aside - 1)
    with_v = bool(np.isfinite(v).all())
    missed = misfits(problem, float(run.t[row]), u, v if with_v else np.zeros(problem.n))
    if not with_v:
        return {"position": missed["position"]}
    if problem.m and np.isfinite(multipliers).all():
        try:
            with np.errstate(all="ignore"):
                _, implied = Index1(problem).accelerations(float(run.t[row]), u, v)
            missed["multiplier"] = Misfit(multipliers - implied, np.abs(implied))
        except np.linalg.LinAlgError:
            pass
    return missed


def _of_march(
    run: Run, motion: Motion, options: Mapping[str, Any]
) -> tuple[list[Deviations], Array] | None:
    """The same of a march of this tool's, and of its twins; None where it does not arrive."""
    how: dict[str, Any] = method({**options, **run.method})
    problem = motion.problem
    try:
        ours = march(problem, h=run.size, at=run.t, twins=_TWINS, keep=("u", "v", "lambda"), **how)
    except InputError:
        return None
    times = np.asarray(run.t, float)
    trajectories = (ours, *ours.twins)
    if any(len(x.t) < len(np.unique(times)) or x.status != "ok" for x in trajectories):
        return None
    marches = []
    for x in trajectories:
        state = {"u": x.u, "v": x.v, "lambda": x.multipliers}
        if problem.outputs is not None:
            state["output"] = np.array([
                problem.outputs.values(problem, t, u, v, multipliers)
                for t, u, v, multipliers in zip(x.t, x.u, x.v, x.multipliers, strict=True)
            ])  # fmt: skip
        marches.append(Run(run.series, run.size, 0, np.asarray(x.t), state, {}))
    parts = {part: ["all"] for part in ("u", "v", "lambda", "output")}
    # A march that projects or recovers, and its twins, would agree with what they meet to the bit.
    off = [deviations(r, motion, parts, aside) for aside, r in enumerate(marches)]
    return off, np.asarray(ours.iterations)


def slopes(
    measurements: Sequence[Measured], runs: Runs, motion: Motion, options: Mapping[str, Any]
) -> list[Slope]:
    """Series of the runs, judged by the rule of `check`; of tolerances only shown."""
    series = dict.fromkeys(m.run.series for m in measurements)
    judged = []
    for label in series:
        of = [m for m in measurements if m.run.series == label]
        how = method({**options, **of[-1].run.method})
        judged += study_slopes(_frame(of, label, how, motion.problem), Path(label), {})
    if runs.abscissa != STEP_SIZE:
        judged = [replace(s, expected=math.nan, tolerance=math.nan, verdict=SHOWN, reason="")
                  for s in judged]  # fmt: skip
    return judged


def _frame(
    measurements: Sequence[Measured], label: str, how: Mapping[str, str], problem: Problem
) -> Any:
    import pandas as pd

    names = dict.fromkeys(name for m in measurements for name in m.errors)
    rows = []
    for measure, quantity in names:
        of = [m for m in measurements if (measure, quantity) in m.errors]
        rounding = roundings(of, (measure, quantity))
        for m, unsure in zip(of, rounding, strict=True):
            value = m.errors[measure, quantity].statistics
            rows.append({
                "study": label, "problem": problem.name, "form": "u-lambda",
                "preconditioning": "optimal", **how,
                "quantity": quantity, "measure": measure, "role": "primary",
                "h": m.run.size, "t_end": float(m.run.t[-1]), "status": "ok",
                "steps": max(1.0, (m.run.t[-1] - problem.t0) / m.run.size),
                "rms": value.rms, "max": value.max, "median": value.median, "last": value.last,
                "zeros": value.zeros, "rounding": unsure,
            })  # fmt: skip
    usual = {axis.name: axis.usual for axis in (*axes.cell_axes(), *axes.row_axes())
             if axis.column and axis.series}  # fmt: skip
    frame = pd.DataFrame(rows)
    # Each is held against the solution at its own end: a step size need not divide the time.
    ends = frame["t_end"]
    if ends.max() - ends.min() <= _SAME_END * ends.max():
        frame["t_end"] = ends.median()
    for name, default in usual.items():
        if name not in frame:
            frame[name] = default
    for name in NUMBERS - set(frame):
        frame[name] = np.nan
    return frame


def roundings(measurements: Sequence[Measured], name: tuple[str, str]) -> Array:
    """(runs,) rounding of a quantity, of runs by descending sizes.

    Where none was measured it is that of the nearest larger step size, times a power of h.
    """
    rounding = np.array([m.errors[name].statistics.rounding for m in measurements])
    sizes = np.array([m.run.size for m in measurements])
    for place in np.flatnonzero(np.isnan(rounding)):
        known = np.flatnonzero(np.isfinite(rounding[:place]))
        if len(known):
            ratio = sizes[known[-1]] / sizes[place]
            rounding[place] = rounding[known[-1]] * ratio ** _GROWTH.get(name[1], 0.0)
    return rounding
