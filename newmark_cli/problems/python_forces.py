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

from newmark_cli.problems import constraint_rows, python_problem
from newmark_cli.problems.problem import Problem, Push


def pushed(problem: Problem, pushes: Sequence[Push], folder: Path, spelled: str) -> Problem:
    """The problem with forces in Python.

    Args:
        problem: A mechanism.
        pushes: The forces.
        folder: Where their files are looked for.
        spelled: How errors name it.

    Raises:
        ProblemError: When a file or a function fails, or does not return k forces.
    """
    digest = hashlib.sha256()
    sources: dict[str, bytes] = {}
    for push in pushes:
        file, _, name = push.given.rpartition(":")
        path, shown = folder / file, os.path.join(spelled, file)
        function, found = python_problem.load_function(path, name, shown)
        size = len(push.offsets) // 2
        start = push.offsets + push.weights @ problem.u0[list(push.coordinates)]
        speed = push.weights @ problem.v0[list(push.coordinates)]
        function = python_problem.called_at(
            function, (start.reshape(size, 2), speed.reshape(size, 2), problem.t0), name,
            (path, shown), (size, 2),
        )  # fmt: skip
        folder_of = os.path.dirname(file)
        named = {os.path.normpath(os.path.join(folder_of, key)): x for key, x in found.items()}
        digest.update(repr((push.given, named)).encode())
        sources |= named
        problem = _with(problem, push, function)
    return replace(problem, code=digest.hexdigest(), sources=sources)


def _with(problem: Problem, push: Push, function: Callable[..., Any]) -> Problem:
    """The problem with one force more, whose tangents stand behind those that it has."""
    compiled = problem.compiled and isinstance(function, Dispatcher)
    compile_ = njit if compiled else constraint_rows.as_it_is
    coordinates = np.array(push.coordinates, np.int64)
    weights, offsets = np.ascontiguousarray(push.weights), push.offsets
    size, count = len(offsets) // 2, len(coordinates)
    first_x, first_y = len(problem.pattern.x_rows), len(problem.pattern.y_rows)
    before = problem.function

    def force_of(t, q, w):  # type: ignore[no-untyped-def]
        """Generalised forces at coordinates q and velocities w of those that count."""
        places, speeds = np.empty((size, 2)), np.empty((size, 2))
        for i in range(size):
            for c in range(2):
                place, speed = offsets[2 * i + c], 0.0
                for j in range(count):
                    place += weights[2 * i + c, j] * q[j]
                    speed += weights[2 * i + c, j] * w[j]
                places[i, c] = place
                speeds[i, c] = speed
        given = function(places, speeds, t)
        total = np.zeros(count)
        for j in range(count):
            for i in range(size):
                total[j] += weights[2 * i, j] * given[i, 0] + weights[2 * i + 1, j] * given[i, 1]
        return total

    forces = compile_(force_of)

    def evaluate(  # type: ignore[no-untyped-def]
        t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values
    ):
        before(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)
        q, w = np.empty(count), np.empty(count)
        for j in range(count):
            q[j], w[j] = u[coordinates[j]], v[coordinates[j]]
        given = forces(t, q, w)
        for j in range(count):
            force[coordinates[j]] += given[j]
        length = max(np.max(np.abs(u)), 1e-8)
        pace = max(np.max(np.abs(v)), 1e-3)
        for j in range(count):
            for i in range(count):
                x_values[first_x + i * count + j] = 0.0
                y_values[first_y + i * count + j] = 0.0
            # Central differences of fourth order.
            for shift, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
                step = 1e-3 * length
                moved = q.copy()
                moved[j] += shift * step
                given = forces(t, moved, w)
                for i in range(count):
                    x_values[first_x + i * count + j] -= weight * given[i] / (12 * step)
                step = 1e-3 * pace
                moved = w.copy()
                moved[j] += shift * step
                given = forces(t, q, moved)
                for i in range(count):
                    y_values[first_y + i * count + j] -= weight * given[i] / (12 * step)

    rows, columns = (coordinates[index.ravel()] for index in np.indices((count, count)))
    pattern = problem.pattern
    return replace(
        problem,
        function=compile_(evaluate),
        elements=None,
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
