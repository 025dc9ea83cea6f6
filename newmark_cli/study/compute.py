"""Marching a cell while its measures look on."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from newmark_cli.newmark import kernel, march_data
from newmark_cli.newmark.gaps import GapWatch
from newmark_cli.newmark.march import March
from newmark_cli.newmark.operations import of_march
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.statistics import Measurement
from newmark_cli.newmark.trajectory import REDUNDANT
from newmark_cli.newmark.twins import spread, twins
from newmark_cli.problems.reference import Reference
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import OVER_MOTION, Outcome
from newmark_cli.study.measures import MEASURES
from newmark_cli.study.observers import OBSERVERS, Deviations, Observer
from newmark_cli.support.arrays import IndexArray

#: Seconds that a march is timed for in all, and most repetitions of a short one.
_MEASURED, _MOST_MARCHES = 0.2, 1_000


class _Watch(GapWatch, Observer):
    """Ends a cell once rows that were dropped as redundant are needed."""


def scheme_of(cell: Cell) -> Scheme:
    """The scheme with which a cell marches its problem."""
    form = cell.formulated
    return Scheme(
        cell.integrator,
        form,
        cell.preconditioning.scaling(form),
        cell.h,
        iteration_cap=cell.iteration_cap,
        evaluation=cell.evaluation,
        precision=cell.precision,
        stop=cell.stop,
        formulation=cell.formulation,
        projection=cell.projection,
        reported=cell.reported,
        start=cell.start,
        auxiliary=cell.auxiliary,
    )


def march_of(cell: Cell) -> March:
    """The march of a cell, at its start."""
    problem = cell.problem.load()
    grid = cell.grid(problem.t0)
    return March(problem, scheme_of(cell), cell.solver, cell.krylov, grid=grid)


def twins_of(cell: Cell, count: int) -> Iterator[March]:
    """So many twins of that march."""
    problem = cell.problem.load()
    grid = cell.grid(problem.t0)
    return twins(problem, scheme_of(cell), count, cell.solver, cell.krylov, grid)


def prepare(cell: Cell) -> None:
    """Compile the kernel that a cell needs, unless it is: that is no time of the cell's."""
    scheme = scheme_of(cell)
    if not kernel.is_compiled(scheme.dtype, scheme.formulated):  # type: ignore[no-untyped-call]
        march_of(cell).advance(0)


def compute(
    cell: Cell,
    reference: Reference | None = None,
    on_steps: Callable[[int], None] = lambda steps: None,
) -> Outcome:
    """March a cell and measure it.

    Without the reference, the solution at the end, errors are empty.  ``on_steps`` is told how many
    steps were done, now and then; an exception that it raises ends the march.
    """
    march = march_of(cell)
    observers = {name: OBSERVERS[name](cell, march, reference) for name in _observed(cell)}
    every = [*observers.values(), _Watch(march.problem, cell.steps)]
    counts, pivoted = marched(march, cell.steps, every, on_steps)
    rows = {name: observer.measured() for name, observer in observers.items()}
    if cell.twins:
        twinned = _by_twins(cell, observers, reference, on_steps)
        for name, deviations in twinned.items():
            rows[name] = [
                with_rounding(row, deviations, observers[name].unresolved(row.quantity))
                for row in rows[name]
            ]
    reason = next((observer.reason for observer in every if observer.reason), "")
    not_converged = int(np.count_nonzero(counts < 0))
    ended = march_data.ENDINGS.get(march.ending, "not_converged" if not_converged else "ok")
    return Outcome(
        measurements=[*chain.from_iterable(rows.values())],
        not_converged=not_converged,
        newton_iterations=float(np.mean(np.abs(counts))) if march.done else np.nan,
        status=REDUNDANT if reason else ended,
        reason=reason,
        met=march.done - not_converged if cell.stop else None,
        trajectory=next(filter(None, (observer.trajectory for observer in every)), {}),
        pivoted=pivoted,
        operations=of_march(march),
    )


def _observed(cell: Cell) -> Iterator[str]:
    """Names of the observers of a cell, in the order of its rows."""
    for name in MEASURES:
        if name in cell.measure:
            yield name
            if name == "error" and cell.error is not None:
                yield OVER_MOTION


def _by_twins(
    cell: Cell,
    observers: Mapping[str, Observer],
    reference: Reference | None,
    on_steps: Callable[[int], None],
) -> dict[str, list[Deviations]]:
    """Measure with twins → deviations of the march, then of each twin."""
    twinned = [name for name in observers if name == OVER_MOTION or MEASURES[name].twins]
    deviations = {name: [observers[name].deviations] for name in twinned}
    for twin in twins_of(cell, cell.twins):
        of_twin = {name: OBSERVERS[name](cell, twin, reference) for name in twinned}
        marched(twin, cell.steps, [*of_twin.values()], on_steps)
        for name, observer in of_twin.items():
            deviations[name].append(observer.deviations)
    return deviations


def marched(
    march: March, steps: int, observers: Sequence[Observer], on_steps: Callable[[int], None]
) -> tuple[IndexArray, int]:
    """Newton iterations of each step, and the number of pivoted steps."""
    counts, pivoted = [np.zeros(0, np.int64)], 0
    if steps == 0:
        for observer in observers:
            observer.sees(march)
        on_steps(1)
    stops = frozenset[int]().union(*(observer.stops for observer in observers))
    looks = next((observer.looks for observer in observers if len(observer.looks)), ())
    for stretch in march.stretches(steps, stops, looks) if steps else ():
        on_steps(len(stretch.iterations))
        counts.append(stretch.iterations)
        pivoted += stretch.pivoted
        for observer in observers:
            observer.took(stretch)
        if march.ending == march_data.COMPLETED:
            for observer in observers:
                if march.done in observer.stops:
                    observer.sees(march)
        if any(observer.reason for observer in observers):
            break
    return np.concatenate(counts), pivoted


def with_rounding(
    row: Measurement, marches: Sequence[Deviations], unresolved: float = 0.0
) -> Measurement:
    """A row with the rounding that a march and its twins tell of what it is about.

    ``unresolved`` is by how much what they deviate from may be off itself.
    """
    off = spread([deviations.get(row.quantity, np.empty(0)) for deviations in marches])
    rounding = float(np.hypot(off.max(), unresolved)) if off.size else np.nan
    return replace(row, statistics=replace(row.statistics, rounding=rounding))


def march_seconds(cell: Cell, on_steps: Callable[[int], None]) -> float | None:
    """Wall time of a march by itself (s): the least of some that take 0.2 s together.

    Of a cell that has been computed, so that nothing needs to be compiled; None without steps.
    """
    seconds: list[float] = []
    while cell.steps and sum(seconds) < _MEASURED and len(seconds) < _MOST_MARCHES:
        march = march_of(cell)
        start = time.perf_counter()
        for _ in march.stretches(cell.steps):
            on_steps(0)
        seconds.append(time.perf_counter() - start)
    return min(seconds, default=None)
