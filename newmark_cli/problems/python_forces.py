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
    digest = hashlib.sha256()
    sources: dict[str, bytes] = {}
    for push in pushes:
        file, _, name = push.python.rpartition(":")
        path, shown = folder / file, os.path.join(shown_folder, file)
        function, contents = python_problem.load_function(path, name, shown)
        size = len(push.offsets) // 2
        start = push.offsets + push.weights @ problem.u0[list(push.coordinates)]
        speed = push.weights @ problem.v0[list(push.coordinates)]
        function = python_problem.called_at(
            function, (start.reshape(size, 2), speed.reshape(size, 2), problem.t0), name,
            (path, shown), (size, 2),
        )  # fmt: skip
        folder_of = os.path.dirname(file)
        named = {os.path.normpath(os.path.join(folder_of, key)): x for key, x in contents.items()}
        digest.update(repr((push.python, named)).encode())
        sources |= named
        problem = _with(problem, push, function)
    return replace(problem, code=digest.hexdigest(), sources=sources)


def _with(problem: Problem, push: Push, function: Callable[..., Any]) -> Problem:
    """The problem with one force more, whose tangents stand behind those that it has."""
    compiled = problem.compiled and isinstance(function, Dispatcher)
    compile_ = njit if compiled else differences.as_it_is
    coordinates = np.array(push.coordinates, np.int64)
    weights, offsets = np.ascontiguousarray(push.weights), push.offsets
    size, count = len(offsets) // 2, len(coordinates)
    first_x, first_y = len(problem.pattern.x_rows), len(problem.pattern.y_rows)
    before, copy = problem.function, differences.copying(compile_).matrix
    at_rest = np.zeros(2 * size)

    def evaluate(  # type: ignore[no-untyped-def]
        t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values
    ):
        before(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)
        step, pace = differences.steps_of_tangents(u, v)
        qs, ws = differences.states_around(
            _chosen(u, coordinates), _chosen(v, coordinates), True, True, step, pace
        )
        forces, loads = np.zeros(qs.shape), np.empty((size, 2))
        for k in range(qs.shape[0]):
            places, speeds = _at(qs[k], weights, offsets), _at(ws[k], weights, at_rest)
            copy(function(places, speeds, t), loads)
            _add_generalised(loads, weights, forces[k])
        _add_at(forces[0], coordinates, force)
        differences.take_tangents(
            forces, True, True, step, pace, x_values[first_x:], y_values[first_y:]
        )

    rows, columns = (coordinates[index.ravel()] for index in np.indices((count, count)))
    pattern = problem.pattern
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
def _chosen(vector, coordinates):  # type: ignore[no-untyped-def]
    chosen = np.empty(coordinates.shape[0])
    for j in range(coordinates.shape[0]):
        chosen[j] = vector[coordinates[j]]
    return chosen


@cached_njit(nogil=True, error_model="numpy")
def _at(q, weights, offsets):  # type: ignore[no-untyped-def]
    """(k, 2) places of the points at coordinates q, or with no offsets their velocities."""
    size, count = offsets.shape[0] // 2, q.shape[0]
    places = np.empty((size, 2))
    for i in range(size):
        for c in range(2):
            place = offsets[2 * i + c]
            for j in range(count):
                place += weights[2 * i + c, j] * q[j]
            places[i, c] = place
    return places


@cached_njit(nogil=True, error_model="numpy")
def _add_generalised(loads, weights, forces):  # type: ignore[no-untyped-def]
    for j in range(forces.shape[0]):
        for i in range(loads.shape[0]):
            forces[j] += weights[2 * i, j] * loads[i, 0] + weights[2 * i + 1, j] * loads[i, 1]


@cached_njit(nogil=True, error_model="numpy")
def _add_at(forces, coordinates, force):  # type: ignore[no-untyped-def]
    for j in range(forces.shape[0]):
        force[coordinates[j]] += forces[j]
