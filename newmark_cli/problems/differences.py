"""Tangents of users' forces by central differences of fourth order.

Of a problem whose functions are compiled only what calls them is compiled anew; where they
are called, and what follows from the values, is compiled once for all problems.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.cached_code import cached_njit

#: Compiles a function, or leaves it as it is.
Compiler = Callable[[Callable[..., Any]], Callable[..., Any]]


def as_it_is(function: Callable[..., Any]) -> Callable[..., Any]:
    """No compiler."""
    return function


class Copying(NamedTuple):
    """Functions (given, out) that copy what a user's function returned into an array.

    Attributes:
        vector, matrix: Into one of its shape.
        flat: A matrix into a vector, row by row.
    """

    vector: Callable[[Any, Any], None]
    matrix: Callable[[Any, Any], None]
    flat: Callable[[Any, Any], None]


def copying(compile_: Compiler) -> Copying:
    """For plain functions, whose arrays may be of any kind, or for compiled ones."""
    if compile_ is as_it_is:
        return Copying(_copy_plain, _copy_plain, _flatten_plain)
    return Copying(copy_vector, copy_matrix, flatten)


def _copy_plain(given: Any, out: Any) -> None:
    out[...] = given


def _flatten_plain(given: Any, out: Any) -> None:
    out[...] = np.ravel(given)


# Loops: an assignment to a slice would bring with it the error that its shapes can raise,
# which takes longer to compile, in every problem, than all else.


@cached_njit(nogil=True, error_model="numpy")
def copy_vector(given, out):  # type: ignore[no-untyped-def]
    """See `Copying`."""
    for i in range(out.shape[0]):
        out[i] = given[i]


@cached_njit(nogil=True, error_model="numpy")
def copy_matrix(given, out):  # type: ignore[no-untyped-def]
    """See `Copying`."""
    for i in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[i, k] = given[i, k]


@cached_njit(nogil=True, error_model="numpy")
def flatten(given, out):  # type: ignore[no-untyped-def]
    """See `Copying`."""
    rows, columns = given.shape
    for i in range(rows):
        for k in range(columns):
            out[i * columns + k] = given[i, k]


@cached_njit(nogil=True, error_model="numpy")
def nothing(*given):  # type: ignore[no-untyped-def]
    """Where there is nothing to do."""


@cached_njit(nogil=True, error_model="numpy")
def states_around(u, v, of_u, of_v, step, pace):  # type: ignore[no-untyped-def]
    """Where a force is asked for: here, then with each coordinate and each velocity moved.

    Args:
        u, v: (n,) coordinates and velocities.
        of_u, of_v: Whether the tangent to u, to v is wanted.
        step, pace: By how much both are moved, and twice.

    Returns:
        (k, n) coordinates and velocities.
    """
    n = u.shape[0]
    count = 1 + 4 * n * (int(of_u) + int(of_v))
    us, vs = np.empty((count, n)), np.empty((count, n))
    for k in range(count):
        copy_vector(u, us[k])
        copy_vector(v, vs[k])
    k = 1
    for moved, wanted, size in ((us, of_u, step), (vs, of_v, pace)):
        if wanted:
            for j in range(n):
                for shift in (-2, -1, 1, 2):
                    moved[k, j] += shift * size
                    k += 1
    return us, vs


@cached_njit(nogil=True, error_model="numpy")
def take_tangents(  # type: ignore[no-untyped-def]
    forces, of_u, of_v, step, pace, x_values, y_values
):
    """X and Y, (n · n,) each, from the (k, n) forces at `states_around`."""
    n, first = forces.shape[1], 1
    for wanted, size, values in ((of_u, step, x_values), (of_v, pace, y_values)):
        if wanted:
            for j in range(n):
                at = first + 4 * j
                for i in range(n):
                    tangent = 0.0
                    for k, weight in enumerate((1.0, -8.0, 8.0, -1.0)):
                        tangent -= weight * forces[at + k, i] / (12 * size)
                    values[i * n + j] = tangent
            first += 4 * n


@cached_njit(nogil=True, error_model="numpy")
def add_reactions(forces, gradients, multipliers):  # type: ignore[no-untyped-def]
    """G λ to the forces at as many states as there is a gradient of."""
    count, n, m = gradients.shape
    for k in range(count):
        for i in range(n):
            for c in range(m):
                forces[k, i] += gradients[k, i, c] * multipliers[c]


@cached_njit(nogil=True, error_model="numpy")
def size_of(vector, least):  # type: ignore[no-untyped-def]
    """Its largest component, or the least that counts."""
    size = least
    for i in range(vector.shape[0]):
        size = max(size, abs(vector[i]))
    return size
