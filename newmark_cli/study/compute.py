"""Marching a cell while its measures look on."""

from collections.abc import Callable

import numpy as np

from newmark_cli.newmark import march_data
from newmark_cli.newmark.march import March, is_ready
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.reference import Reference
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Outcome
from newmark_cli.study.measures import MEASURES
from newmark_cli.study.redundancy import REDUNDANT, Watch


def scheme_of(cell: Cell) -> Scheme:
    """The scheme with which a cell marches its problem."""
    form = cell.formulated
    return Scheme(
        cell.integrator,
        form,
        cell.preconditioning.scaling(form),
        cell.h,
        cell.iteration_cap,
        cell.evaluation,
        cell.precision,
        cell.stop,
        cell.formulation,
        cell.projection,
        cell.reported,
        cell.start,
    )


def prepare(cell: Cell) -> None:
    """Compile the kernel that a cell needs, unless it is: that is no time of the cell's.

    Args:
        cell: What is about to be computed.
    """
    problem, scheme = cell.problem.load(), scheme_of(cell)
    if not is_ready(problem, scheme, cell.solver):
        March(problem, scheme, cell.solver, cell.krylov).advance(0)


def compute(
    cell: Cell,
    reference: Reference | None = None,
    on_steps: Callable[[int], None] = lambda steps: None,
) -> Outcome:
    """March a cell and measure it.

    Args:
        cell: What to compute.
        reference: The solution at the end, where errors are measured; without one
            the errors are empty.
        on_steps: Told how many steps were done, now and then; an exception
            that it raises ends the march.
    """
    march = March(cell.problem.load(), scheme_of(cell), cell.solver, cell.krylov)
    measures = [measure for name, measure in MEASURES.items() if name in cell.measure]
    observers = [measure.observe(cell, march, reference) for measure in measures]
    observers.append(Watch(march.problem, cell.steps))
    counts, pivoted = [np.zeros(0, np.int64)], 0
    if cell.steps == 0:
        for observer in observers:
            observer.sees(march)
        on_steps(1)
    stops = frozenset[int]().union(*(observer.stops for observer in observers))
    looks = next((observer.looks for observer in observers if len(observer.looks)), ())
    for stretch in march.stretches(cell.steps, stops, looks) if cell.steps else ():
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

    iterations = np.concatenate(counts)
    reason = next((observer.reason for observer in observers if observer.reason), "")
    not_converged = int(np.count_nonzero(iterations < 0))
    ended = march_data.ENDINGS.get(march.ending, "not_converged" if not_converged else "ok")
    return Outcome(
        measurements=[found for observer in observers for found in observer.measured()],
        not_converged=not_converged,
        newton_iterations=float(np.mean(np.abs(iterations))) if march.done else np.nan,
        status=REDUNDANT if reason else ended,
        reason=reason,
        met=march.done - not_converged if cell.stop else None,
        history=[entry for observer in observers for entry in observer.history],
        drift=[entry for observer in observers for entry in observer.drift],
        trajectory={name: at for each in observers for name, at in each.trajectory.items()},
        pivoted=pivoted,
    )
