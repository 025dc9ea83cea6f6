"""Positions of a problem along its motion, for drawings."""

from collections.abc import Sequence

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.errors import InputError
from newmark_cli.newmark import march_data
from newmark_cli.newmark.engine import march_with
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.initial import initial_state
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.linear import choice, systems
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem


def positions(problem: Problem, t_end: float, h: float, frames: int) -> Sequence[Array]:
    """Positions at evenly spread times from the start to t_end.

    The trapezoidal rule in the (u, λ) form with optimal scaling.

    Args:
        problem: The problem.
        t_end: End (s), counted from the problem's start.
        h: Step size (s).
        frames: How many positions, the first and the last included.

    Returns:
        (n,) positions.

    Raises:
        InputError: When the march does not get there.
    """
    form = FORMS["u-lambda"]
    scheme = Scheme(Newmark(), form, named_scaling("optimal", form), h)
    solver = choice.choose(choice.AUTO, problem, form)
    march = march_with(solver, problem, systems.system(solver, problem, scheme))
    state = initial_state(problem, scheme)
    found, done = [state.fields[0].copy()], 0
    for stop in np.unique(np.round(np.linspace(0, t_end / h, frames)).astype(int))[1:]:
        norms = np.zeros((int(stop) - done, 2))
        iterations = np.zeros(len(norms), np.int64)
        ending, _ = march(problem, scheme, state, done, norms, iterations)
        done = int(stop)
        if ending != march_data.COMPLETED or np.any(iterations < 0):
            raise InputError(f"the march fails before t = {done * h:g}; try a smaller --h")
        found.append(state.fields[0].copy())
    return found
