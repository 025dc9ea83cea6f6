"""Forces in Python on points of a mechanism.

A function of the user's, compiled by numba or not,

    def drag(positions, velocities, t):
        return -0.3 * velocities

is handed the places (m) and velocities (m/s) of k points, (k, 2) each, and the time (s), and
returns the forces on them (N), (k, 2).  Its tangents are found by differences.
"""

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher

from newmark_cli.problems import differences, python_problem
from newmark_cli.problems.problem import Problem, Push
from newmark_cli.support.cached_code import cached_njit


def pushed(problem: Problem, pushes: Sequence[Push], folder: Path, shown_folder: str) -> Problem:
    """The mechanism with forces in Python, whose files are looked for in a folder.

    Raises:
        ProblemError: When a file or a function fails, or does not return k forces.
    """
    code, sources = "", dict[str, bytes]()
    for push in pushes:
        file, _, name = push.python.rpartition(":")
        own = list(push.coordinates)
        start = _places(problem.u0[own], push.weights, push.offsets)
        speed = _places(problem.v0[own], push.weights, 0 * push.offsets)
        function, contents = python_problem.load_function(
            folder / file, name, os.path.join(shown_folder, file), (start, speed, problem.t0),
            start.shape,
        )  # fmt: skip
        named = {os.path.normpath(os.path.join(file, "..", key)): x for key, x in contents.items()}
        code += repr((push.python, named))
        sources |= named
        problem = _with(problem, push, function)
    return replace(problem, code=hashlib.sha256(code.encode()).hexdigest(), sources=sources)


def _with(problem: Problem, push: Push, function: Callable[..., Any]) -> Problem:
    """The problem with one force more, whose tangents stand behind those that it has."""
    compiled = problem.compiled and isinstance(function, Dispatcher)
    compile_ = njit if compiled else differences.as_it_is
    own, weights = np.array(push.coordinates, np.int64), np.ascontiguousarray(push.weights)
    offsets, at_rest = push.offsets, 0 * push.offsets
    pattern, before, copy = problem.pattern, problem.function, differences.copying(compile_).matrix
    first_x, first_y = len(pattern.x_rows), len(pattern.y_rows)

    def evaluate(  # type: ignore[no-untyped-def]
        t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values
    ):
        before(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)
        step, pace = differences.steps_of_tangents(u, v)
        us, vs = differences.states_around(u[own], v[own], True, True, step, pace)
        forces, loads = np.zeros(us.shape), np.empty((len(offsets) // 2, 2))
        for k in range(us.shape[0]):
            places = _places(us[k], weights, offsets)
            copy(function(places, _places(vs[k], weights, at_rest), t), loads)
            _add(loads, weights, forces[k])
        force[own] += forces[0]
        differences.take_tangents(
            forces, True, True, step, pace, x_values[first_x:], y_values[first_y:]
        )

    rows, columns = (own[index.ravel()] for index in np.indices((len(own), len(own))))
    return replace(
        problem,
        function=compile_(evaluate),
        pattern=pattern._replace(
            x_rows=np.concatenate([pattern.x_rows, rows]),
            x_columns=np.concatenate([pattern.x_columns, columns]),
            y_rows=np.concatenate([pattern.y_rows, rows]),
            y_columns=np.concatenate([pattern.y_columns, columns]),
        ),
        compiled=compiled,
        single=False,
        potential=None,
    )


@cached_njit(nogil=True, error_model="numpy")
def _places(q, weights, offsets):  # type: ignore[no-untyped-def]
    """(k, 2) places of the points at coordinates q, or with no offsets their velocities."""
    places = offsets.copy()
    for i in range(weights.shape[0]):
        for j in range(q.shape[0]):
            places[i] += weights[i, j] * q[j]
    return places.reshape(-1, 2)


@cached_njit(nogil=True, error_model="numpy")
def _add(loads, weights, forces):  # type: ignore[no-untyped-def]
    """Generalised forces (c,) of loads (k, 2)."""
    for j in range(forces.shape[0]):
        for i in range(loads.shape[0]):
            forces[j] += weights[2 * i, j] * loads[i, 0] + weights[2 * i + 1, j] * loads[i, 1]
