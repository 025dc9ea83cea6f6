"""A cell of another code: its run is replayed before the measures that need states only.

Errors and invariants are those of the measures of these names, against the same references.
Rounding is told by the code's own twins; of a code without any by those of a march of this
package with the same method and step size.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from newmark_cli.codes.programs import CodeError, RunRequest
from newmark_cli.codes.reading import SAME_TIME, Run
from newmark_cli.codes.solutions import misfits_at
from newmark_cli.newmark.kept import KEPT, Kept
from newmark_cli.newmark.march_data import COMPLETED
from newmark_cli.newmark.statistics import Measurement, statistics
from newmark_cli.newmark.trajectory import Recorder, Trajectory
from newmark_cli.newmark.twins import last_places_off
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import Reference
from newmark_cli.study import observers
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Outcome, Window
from newmark_cli.study.compute import march_of, twins_of, with_rounding
from newmark_cli.study.observers import Deviations
from newmark_cli.support.arrays import Array

#: What can be measured of states alone.
OF_STATES = ("error", "invariant", "trajectory")
#: Rows of a run at which invariants are looked at, besides the first and last of it.
_SAMPLES, _ENDS = 32, 3
#: Twins of a march that stands in for those of a code that has none.
_TWINS = 3
#: Part of a step by which the last row may miss t_end: a sum of steps rounds.
_SAME_STEP = 1e-3
_EPS = float(np.finfo(float).eps)
#: Cell, times → its march and the twins of it, as runs; none where it does not arrive.
OwnRuns = Callable[[Cell, Array], Sequence[Run]]


def replayed(
    cell: Cell,
    reference: Reference | None = None,
    on_steps: Callable[[int], None] = lambda steps: None,
) -> tuple[Outcome, float | None]:
    """Run another code and measure what it gives; see `newmark_cli.study.compute.compute`.

    Returns:
        The outcome, and the time of the run without its twins (s): that of the column
        ``seconds``, or of the clock; None where it failed.
    """
    assert not isinstance(cell.code, str)
    problem = cell.problem.load()
    start = np.array([problem.u0, problem.v0])
    runs, seconds = [], 0.0
    try:
        for twin in range(1 + cell.twins):
            u0, v0 = last_places_off(start, twin - 1) if twin else start
            wanted = RunRequest(
                cell.problem, cell.h, problem.t0 + cell.t_end, u0, v0, twin, lambda: on_steps(0)
            )
            begun = time.perf_counter()
            run = cell.code.run(wanted)
            seconds = seconds or time.perf_counter() - begun
            on_steps(cell.steps)
            if run is not None:
                runs.append(_to_the_end(run, wanted))
    except CodeError as error:
        return Outcome([], 0, np.nan, "failed", f"{cell.code.name}: {error}"), None
    if lacks := runs[0].lacks:
        reason = f"{cell.code.name}: no number in the last row: {', '.join(lacks[:3])}"
        return Outcome([], 0, np.nan, "diverged", reason), None
    if len(told := runs[0].numbers.get("seconds", np.zeros(0))):
        seconds = float(told[-1])
    return measured(cell, runs, reference), seconds


def _to_the_end(run: Run, wanted: RunRequest) -> Run:
    """The rows up to the wanted end, which is among them."""
    slack = _SAME_STEP * wanted.h
    rows = run.t <= wanted.t_end + slack
    if not rows.any() or run.t[rows][-1] < wanted.t_end - slack:
        last = f"ended at t = {run.t[rows][-1]:g}" if rows.any() else "has no row"
        why = f": {run.message}" if run.message else ""
        raise CodeError(f"{last}, before t_end = {wanted.t_end:g}{why}")
    return replace(
        run,
        t=run.t[rows],
        state={part: values[rows] for part, values in run.state.items()},
        numbers={name: values[rows] for name, values in run.numbers.items()},
    )


def measured(
    cell: Cell,
    runs: Sequence[Run],
    reference: Reference | None,
    marches: OwnRuns | None = None,
) -> Outcome:
    """Outcome of a cell from a run that came to its end, and the runs of its twins.

    Args:
        cell: The cell; its axes say which method the code claims to have.
        runs: The run, then those of its twins.
        reference: Solution at the end; errors are empty without it.
        marches: In place of a march of this package: what is known of it, see `OwnRuns`.
    """
    problem, (run, *others) = cell.problem.load(), runs
    window = cell.error if "error" in cell.measure else None
    spread = [deviations(of, problem, reference, window) for of in runs]
    off = spread[0]
    wanted = [name for name in OF_STATES if name in cell.measure]
    if not others and cell.twins and {"error", "invariant"} & {*wanted}:
        own = (marches or of_march)(cell, run.t)
        # A march that projects or recovers, and its twins, agree with what they meet to the bit.
        spread = [deviations(twin, problem, reference, window, k) for k, twin in enumerate(own)]
    rows: dict[str, list[Measurement]] = {}
    for name, values in off.items():
        measure, _, quantity = name.partition(" ")
        row = Measurement(name, measure, "primary", statistics(np.abs(values).max(axis=1)))
        if len(spread) > 1:
            # What is printed of u and v is rounded itself, however well our own march meets it.
            unsure = _EPS if measure == "invariant" else observers.error_of(reference, quantity)
            row = with_rounding(row, spread, unsure)
        rows.setdefault(measure, []).append(replace(row, quantity=quantity))
    counts = run.numbers.get("iterations", np.zeros(0))
    counts = counts[counts > 0]
    given = {*wanted, *([window.record] if window else [])}
    trajectory: Mapping[str, Any] = {}
    if "trajectory" in wanted:
        kept = cell.trajectory or Kept()
        recorded = _kept_of(run, kept, cell)
        trajectory, rows["trajectory"] = observers.over_time(problem, kept, recorded)
    return Outcome(
        measurements=[row for name, of in rows.items() if name in given for row in of],
        not_converged=0,
        newton_iterations=float(np.mean(counts)) if len(counts) else np.nan,
        status="ok",
        trajectory=trajectory,
    )


def _kept_of(run: Run, kept: Kept, cell: Cell) -> Trajectory:
    """The rows that a trajectory keeps, as that of a march."""
    problem = cell.problem.load()
    numbers = np.round((run.t - problem.t0) / cell.h).astype(np.int64)
    if kept.at:
        rows = np.unique([int(np.abs(run.t - t).argmin()) for t in kept.at])
    else:
        rows = np.flatnonzero((numbers % kept.every == 0) | (numbers == numbers[-1]))
    arrays = {
        name: run.state[name][rows]
        for name in KEPT
        if name in run.state and np.isfinite(run.state[name][rows]).all()
    }
    # There is no state to go on from.
    return Trajectory(
        t=run.t[rows], numbers=numbers[rows], iterations=np.zeros(len(rows), np.int64),
        converged=np.ones(len(rows), bool), status="ok", steps=cell.steps, not_converged=0,
        newton_iterations=0, h=cell.h, state=cast(Any, None), problem=problem, arrays=arrays,
    )  # fmt: skip


def deviations(
    run: Run,
    problem: Problem,
    reference: Reference | None,
    window: Window | None = None,
    aside: int = 0,
) -> Deviations:
    """“measure quantity” → (samples, k) by how much components are off, relative to their size.

    Args:
        run: A run; what it has no columns of is left out.
        problem: What was solved.
        reference: The solution at its last row; no errors without it.
        window: Part of the motion over which there are errors of its rows, too.
        aside: Which twin of a march of this package it is, whose invariants are looked at with
            other last places of u and v; 0 of none.
    """
    by_name: dict[str, Array] = {}

    def note(name: str, off: Array) -> None:
        if (known := ~np.isnan(off)).any():
            by_name[name] = off[None, known]

    if reference is not None:
        end = {part: values[-1:] for part, values in run.state.items()}
        for name, off in observers.errors(problem, run.t[-1:], end, reference).items():
            note(f"error {name}", off[0])
        if window is not None:
            over = _over_window(run, problem, window)
            by_name |= {f"{window.record} {name}": off for name, off in over.items()}
    samples = [misfits_at(problem, run, row, aside) for row in looked_at(run, problem)]
    samples = [sample for sample in samples if sample]
    if samples:
        names = set(samples[0]).intersection(*samples)
        kept = [{name: sample[name] for name in samples[0] if name in names} for sample in samples]
        compared = observers.invariants(problem, kept)
        by_name |= {f"invariant {name}": off for name, off in compared.items()}
    return by_name


def _over_window(run: Run, problem: Problem, window: Window) -> Deviations:
    """Errors of the rows in a window, see `newmark_cli.study.observers.motion_errors`."""
    until = np.inf if window.until is None else window.until
    since_start = run.t - problem.t0
    slack = _SAME_STEP * np.diff(run.t, prepend=problem.t0)
    rows = np.flatnonzero((since_start > window.since + slack) & (since_start <= until + slack))
    if not len(rows):
        return {}
    rows = rows[observers.looked_at(0, len(rows) - 1)]
    here = {part: values[rows] for part, values in run.state.items()}
    off = observers.motion_errors(problem, run.t[rows], here)
    # Components without a column, and rows without a number.
    known = {name: of[:, ~np.isnan(of).all(axis=0)] for name, of in off.items()}
    known = {name: of[~np.isnan(of).any(axis=1)] for name, of in known.items()}
    return {name: of for name, of in known.items() if of.size}


def looked_at(run: Run, problem: Problem) -> list[int]:
    """Rows at which invariants are looked at, all after the start."""
    rows = np.flatnonzero(run.t > problem.t0 + SAME_TIME)
    if len(rows) > _SAMPLES:
        spread = np.round(np.linspace(0, len(rows) - 1, _SAMPLES)).astype(int)
        rows = rows[np.unique([*range(_ENDS), *spread, *range(len(rows) - _ENDS, len(rows))])]
    return [int(row) for row in rows]


def of_march(cell: Cell, times: Array) -> list[Run]:
    """A march of this package with the method of a cell, and its twins, at some times.

    Empty where one of them does not arrive there.
    """
    marches = [march_of(cell), *twins_of(cell, _TWINS)]
    looks = Kept(at=tuple(float(t) for t in times)).looks(marches[0].grid, cell.steps)
    runs = []
    for march in marches:
        recorder, converged = Recorder(march, ("u", "v", "lambda")), True
        if looks[0] == 0:
            recorder.keep_here()
        for stretch in march.stretches(cell.steps, looks=[*filter(None, looks)]):
            recorder.took(stretch)
            converged = converged and not (stretch.iterations < 0).any()
        kept = recorder.trajectory()
        arrived = march.ending == COMPLETED and converged
        if not arrived or len(kept.t) < len(np.unique(times)):
            return []
        state = observers.parts(march.problem, kept.t, kept.u, kept.v, kept.multipliers)
        runs.append(Run("", cell.h, 0, kept.t, state, {}))
    return runs
