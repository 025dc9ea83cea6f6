"""Twins of a march: the same motion from starts that differ in the last place.

A twin solves the same problem to far less than its rounding, and rounds everything
differently.  What twins differ by is therefore rounding, with all that the motion, the
integrator and the solver make of it: no constant has to be known.  Twins do not see what
all of them share, such as data that were rounded once.  In compensated evaluation that is also
what the last places of u₀ miss Φ = 0 by: it is carried as 0, and so part of the mechanism.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from newmark_cli.newmark.linear.choice import Krylov
from newmark_cli.newmark.march import March, initial_state
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.steps import TimeGrid
from newmark_cli.problems.algebra import product
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

_SEED = 20061012


def twins(
    problem: Problem,
    scheme: Scheme,
    count: int,
    linear_solver: str,
    krylov: Krylov | None = None,
    grid: TimeGrid | None = None,
) -> Iterator[March]:
    """Marches at their start, each with other signs of what it is perturbed by.

    Coordinates and velocities are u₀ (1 ± kε) and v₀ (1 ± kε), and where time may enter, as no
    energy is conserved, h is h (1 ± kε), with k from 1 to 4 and the roundoff ε of the
    scheme's precision.
    """
    for number in range(count):
        units = _units((problem.n + 1, 2), number)
        factor = float(1 + np.finfo(scheme.dtype).eps * units[-1, 0])
        own, own_grid = scheme, grid
        if problem.potential is None:
            own, own_grid = replace(scheme, h=scheme.h * factor), grid and grid.scaled(factor)
        first = own if own_grid is None else own.at(own_grid.size(1), 1.0)
        begin = initial_state(problem, first)
        state = beside(begin, number)
        change = (state.fields - begin.fields)[:3].astype(float)
        carried = product(first.relations.start, change).astype(scheme.dtype)
        state = state._replace(past=begin.past + carried)
        yield March(problem, own, linear_solver, krylov, state, grid=own_grid)


def beside(state: State, number: int = 0) -> State:
    """The state with u (1 ± kε) and v (1 ± kε); what the integrator carries is not touched."""
    moved = last_places_off(state.fields[:2], number)
    return state._replace(fields=np.concatenate([moved, state.fields[2:]]))


def last_places_off(fields: Array, number: int = 0) -> Array:
    """(2, n) u (1 ± kε) and v (1 ± kε), as those of a twin differ from a march's at the start."""
    units = _units((fields.shape[1] + 1, 2), number)[:-1].T
    return np.asarray(
        fields + np.finfo(fields.dtype).eps * units.astype(fields.dtype) * fields, fields.dtype
    )


def _units(shape: tuple[int, int], number: int) -> Array:
    """Signed units in the last place, 1 to 4: few coordinates often draw the same signs."""
    signs = np.random.default_rng((_SEED, number)).choice([-1.0, 1.0], shape)
    return np.asarray((1 + number % 4) * signs)


def spread(marches: Sequence[Array]) -> Array:
    """Sample standard deviation over marches, entry by entry; infinite where one did not arrive.

    Of at least two arrays of one shape; an empty one of a twin that did not get there.
    """
    first, *others = marches
    if any(other.shape != first.shape for other in others):
        return np.full(first.shape, np.inf)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.std(marches, axis=0, ddof=1))
