"""D_L J D_R of index 3 as constants and terms, in the numbers of one step size.

An entry of the matrix is a constant plus a sum of coefficients times sources, the values
of X, Y and G at their patterns, one after the other.  Which constant, which sources and
which coefficients is decided here, once; the engines only multiply and add.
"""

from typing import Any, NamedTuple

import numpy as np

from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array, IndexArray


class Constants(NamedTuple):
    """Entries that no state changes; those of one place add up."""

    rows: IndexArray
    columns: IndexArray
    values: Array


class Sums(NamedTuple):
    """Coefficients times sources; those of one place add up, in this order."""

    rows: IndexArray
    columns: IndexArray
    origins: IndexArray  #: the source: an entry of X, then of Y, then of G
    coefficients: Array


def unknowns(problem: Problem, scheme: Scheme) -> int:
    """N, unknowns of the linear system."""
    return sum(scheme.form.sizes(problem.n, problem.m))


def sources(values: Values, scheme: Scheme) -> Array:
    """(E,) what the terms multiply, as `Sums` counts it."""
    return np.concatenate([values.x, values.y, values.g]).astype(scheme.dtype)


def constants(problem: Problem, scheme: Scheme) -> Constants:
    """M in row D and the identities in the kept rows V and K."""
    tables, pattern, n = scheme.tables, problem.pattern, problem.n
    mass = problem.mass_values.astype(scheme.dtype)
    parts = []
    for k, right in enumerate(tables.right[: len(tables.kept)]):
        factor = tables.left[0] * tables.dynamic_weights[k] * right
        parts.append((pattern.mass_rows, k * n + pattern.mass_columns, factor * mass))
        for r, weights in enumerate(tables.row_weights):
            factor = tables.left[1 + r] * weights[k] * right
            if factor != 0:
                coordinates = np.arange(n)
                diagonal = np.full(n, factor, scheme.dtype)
                parts.append(((1 + r) * n + coordinates, k * n + coordinates, diagonal))
    return Constants(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def of_motion(problem: Problem, scheme: Scheme) -> Sums:
    """X and Y in row D."""
    return _sums(_of_motion(problem, scheme), scheme)


def of_index_3(problem: Problem, scheme: Scheme) -> Sums:
    """X, Y and −G in row D, Gᵀ in row C."""
    tables, pattern, n = scheme.tables, problem.pattern, problem.n
    p, first = len(tables.kept), len(pattern.x_rows) + len(pattern.y_rows)
    of_g, row = first + np.arange(len(pattern.g_rows)), 1 + len(tables.row_weights)
    parts = _of_motion(problem, scheme)
    for k, right in enumerate(tables.right[:p]):
        if (weight := tables.weights[0, k]) != 0:
            factor = tables.left[row] * weight * right
            parts.append((row * n + pattern.g_columns, k * n + pattern.g_rows, of_g, factor))
    factor = -(tables.left[0] * tables.right[p])
    parts.append((pattern.g_rows, p * n + pattern.g_columns, of_g, factor))
    return _sums(parts, scheme)


_Part = tuple[IndexArray, IndexArray, IndexArray, np.floating[Any]]


def _of_motion(problem: Problem, scheme: Scheme) -> list[_Part]:
    tables, pattern, n = scheme.tables, problem.pattern, problem.n
    of_x = np.arange(len(pattern.x_rows))
    of_y = len(of_x) + np.arange(len(pattern.y_rows))
    parts: list[_Part] = []
    for k, right in enumerate(tables.right[: len(tables.kept)]):
        u_weight, v_weight = tables.weights[:2, k]
        if u_weight != 0:
            factor = tables.left[0] * u_weight * right
            parts.append((pattern.x_rows, k * n + pattern.x_columns, of_x, factor))
        if v_weight != 0:
            factor = tables.left[0] * v_weight * right
            parts.append((pattern.y_rows, k * n + pattern.y_columns, of_y, factor))
    return parts


def _sums(parts: list[_Part], scheme: Scheme) -> Sums:
    rows, columns, origins = (
        np.concatenate([np.asarray(part[field], np.int64) for part in parts] or [_NONE])
        for field in range(3)
    )
    coefficients = [np.full(len(part[0]), part[3], scheme.dtype) for part in parts]
    return Sums(rows, columns, origins, np.concatenate(coefficients or [_NONE.astype(float)]))


_NONE = np.empty(0, np.int64)
