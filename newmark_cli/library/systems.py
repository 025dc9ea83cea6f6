"""Linear systems of marches for notebooks."""

from collections.abc import Iterator, Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from newmark_cli.library import arguments
from newmark_cli.library.marching import Options, march
from newmark_cli.newmark.newton_systems import NewtonSystem, newton_systems
from newmark_cli.support.errors import ArgumentError

#: Options of `march` that are about what is kept of it.
_KEEPING = ("every", "at", "keep", "callback")


def linear_systems(
    problem: Any,
    *,
    h: ArrayLike,
    steps: Sequence[int],
    every_iteration: bool = False,
    **options: Unpack[Options],
) -> Iterator[NewtonSystem]:
    """The linear systems J̄ q̄ = −D_L b that Newton's iteration solves along a march.

    They are assembled in a step from the state in which the march stands.  When the march ends
    early, so do they.

    Args:
        problem: As of `march`.
        h: As of `march`.
        steps: In which steps, the first being 1; after a ``state`` as ``numbers`` of a
            `Trajectory` count them.
        every_iteration: Systems of all iterations, not of the first and the last of a step.
        **options: Further arguments of `march`, such as ``form``, ``scaling``,
            ``integrator``, ``formulation`` and ``linear_solver``; not ``every``, ``at``,
            ``keep`` and ``callback``.

    Returns:
        An iterator over systems in the order in which they are solved, each with a sparse
        ``matrix``, the right-hand side ``rhs``, and names, sizes and factors of its blocks.

    Raises:
        ArgumentError: If steps are not whole numbers from 1 on, and as `march`.
        InputError: In single precision, whose systems cannot be had.
        NewmarkError: As `march`.

    Examples:
        >>> import newmark_cli as newmark
        >>> for system in newmark.linear_systems("andrews", h=1e-6, steps=[1, 50]):
        ...     print(system.step, system.iteration == 1, system.matrix.shape, system.rhs.shape)
        1 True (15, 15) (15,)
        1 False (15, 15) (15,)
        50 True (15, 15) (15,)
        50 False (15, 15) (15,)
    """
    for name in _KEEPING:
        if name in options:
            raise ArgumentError(f"{name}: linear_systems keeps nothing of the march; give steps")
    if isinstance(steps, str) or not hasattr(steps, "__iter__"):
        raise ArgumentError(f"steps must be a list of numbers, given {arguments.shown(steps)}")
    wanted = sorted({arguments.count("steps", step, 1) for step in steps})
    if not wanted:
        raise ArgumentError("steps must name a step, given none")
    begun = march(problem, h=h, steps=True, **options)._recorder.march
    first = begun.earlier + begun.done + 1
    if wanted[0] < first:
        raise ArgumentError(f"steps must be at least {first} after this state, given {wanted[0]}")
    if np.ndim(h) and wanted[-1] >= first + (size := len(np.asarray(h))):
        raise ArgumentError(f"h has the sizes of {size} steps, {wanted[-1]} is beyond them")
    return newton_systems(begun, wanted, arguments.flag("every_iteration", every_iteration))
