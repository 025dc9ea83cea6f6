"""D_L J D_R as constants and terms, in the numbers of one step size.

An entry of the matrix is a constant plus a sum of coefficients times sources: the values of
X, Y and G at their patterns, one after the other; of a formulation also the tangents of its
rows, the terms of P, and products of two sources.  Which constant, which sources and which
coefficients is decided here, once; all that has a matrix only multiplies and adds.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.newmark.constraints import Constraining, Tangents
from newmark_cli.newmark.march_data import StepTables
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
    origins: IndexArray  #: the source: an entry of X, then of Y, then of G, then see `Sources`
    coefficients: Array


class Products(NamedTuple):
    """Sources that are products of two that stand before them; they stand last."""

    first: IndexArray
    second: IndexArray

    def behind(self, sources: Array) -> Array:
        """The sources, and the products behind them."""
        return np.concatenate([sources, sources[self.first] * sources[self.second]])


def unknowns(problem: Problem, scheme: Scheme) -> int:
    """N, unknowns of the linear system."""
    return sum(scheme.form.sizes(problem.n, problem.m))


def sources(values: Values, tangents: Tangents | None = None) -> Array:
    """What the terms multiply, as `Sums` counts it, but for products."""
    parts = [values.x, values.y, values.g]
    if tangents is not None:
        parts += [tangents.rows.ravel(), tangents.directions]
    return np.concatenate(parts)


def unscaled(scheme: Scheme) -> StepTables:
    """Numbers of J without D_L and D_R, in double precision."""
    tables = replace(scheme, precision="float64").tables
    return tables._replace(left=np.ones_like(tables.left), right=np.ones_like(tables.right))


def constants(problem: Problem, tables: StepTables) -> Constants:
    """M in row D and the identities in the kept rows V and K."""
    pattern, n, dtype = problem.pattern, problem.n, tables.left.dtype
    mass = problem.mass_values.astype(dtype)
    parts = []
    for k, right in enumerate(tables.right[: len(tables.kept)]):
        factor = tables.left[0] * tables.dynamic_weights[k] * right
        parts.append((pattern.mass_rows, k * n + pattern.mass_columns, factor * mass))
        for r, weights in enumerate(tables.row_weights):
            factor = tables.left[1 + r] * weights[k] * right
            if factor != 0:
                coordinates = np.arange(n)
                diagonal = np.full(n, factor, dtype)
                parts.append(((1 + r) * n + coordinates, k * n + coordinates, diagonal))
    return Constants(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def of_formulation(
    problem: Problem, tables: StepTables, constraining: Constraining | None = None
) -> tuple[Sums, Products]:
    """X and Y in row D, rows of constraints, −G, a penalty, and the columns of η.

    Index 3 has X, Y and −G in row D, and Gᵀ in row C.
    """
    sources = _Sources(problem, constraining)
    # Φ itself for index 3.
    weights = constraining.weights if constraining else np.eye(1, 3)
    parts = [*_of_fields(problem, tables, sources), *_of_rows(problem, tables, sources, weights)]
    if constraining and constraining.penalty:
        parts += _of_penalty(problem, tables, sources, constraining)
    if constraining and constraining.stabilised:
        parts += _of_eta(problem, tables, sources, constraining)
    return _sums(parts, tables), sources.products


_Part = tuple[IndexArray, IndexArray, IndexArray, np.floating[Any] | Array]


def _of_fields(problem: Problem, tables: StepTables, sources: "_Sources") -> Iterator[_Part]:
    """X and Y in row D."""
    for k, right in enumerate(tables.right[: len(tables.kept)]):
        for field, rows, columns, entries in sources.of_fields:
            if (weight := tables.weights[field, k]) != 0:
                factor = tables.left[0] * weight * right
                yield rows, k * problem.n + columns, entries, factor


def _of_rows(
    problem: Problem, tables: StepTables, sources: "_Sources", weights: Array
) -> Iterator[_Part]:
    """Rows of constraints s₀, s₁, s₂, and −G in row D."""
    pattern, n, p = problem.pattern, problem.n, len(tables.kept)
    for row, used in enumerate(weights):
        at = p * n + row * problem.m + pattern.g_columns
        for k, right in enumerate(tables.right[:p]):
            for field in _fields(used):
                if (weight := tables.weights[field, k]) != 0:
                    factor = tables.left[1 + len(tables.row_weights) + row] * weight * right
                    yield at, k * n + pattern.g_rows, sources.tangents(row, field), factor
    if len(weights):
        factor = -(tables.left[0] * tables.right[p])
        yield pattern.g_rows, p * n + pattern.g_columns, sources.g, factor


def _of_penalty(
    problem: Problem, tables: StepTables, sources: "_Sources", constraining: Constraining
) -> Iterator[_Part]:
    """The penalty times G Gᵀ, in row D."""
    rows, (one, other) = problem.pattern.g_rows, constraining.pairs
    square = sources.product(sources.g[one], sources.g[other])
    for k, right in enumerate(tables.right[: len(tables.kept)]):
        if (weight := tables.weights[0, k]) != 0:
            factor = tables.left[0] * weight * right * constraining.penalty
            yield rows[one], k * problem.n + rows[other], square, factor


def _of_eta(
    problem: Problem, tables: StepTables, sources: "_Sources", constraining: Constraining
) -> Iterator[_Part]:
    """Columns of η: P behind X, Y, M and rows of constraints, and in the kept rows V and K."""
    pattern, n, m, p = problem.pattern, problem.n, problem.m, len(tables.kept)
    left, right, terms = tables.left, tables.right[p + 1], constraining.projector
    at, directions = p * n + m + terms.columns, sources.directions
    for field, rows, columns, entries in sources.of_fields:
        if (eta := constraining.eta[field]) != 0:
            one, other = _meetings(columns, terms.rows, n)
            product = sources.product(entries[one], directions[other])
            yield rows[one], at[other], product, left[0] * right * eta
    if (eta := constraining.inertia * constraining.eta[2]) != 0:
        one, other = _meetings(pattern.mass_columns, terms.rows, n)
        factors = left[0] * right * eta * problem.mass_values[one]
        yield pattern.mass_rows[one], at[other], directions[other], factors
    for r, eta in enumerate(constraining.rows_eta):
        if eta != 0:
            yield (1 + r) * n + terms.rows, at, directions, left[1 + r] * right * eta
    one, other = _meetings(pattern.g_rows, terms.rows, n)
    for row, used in enumerate(constraining.weights):
        for field in _fields(used):
            if (eta := constraining.eta[field]) != 0:
                product = sources.product(sources.tangents(row, field)[one], directions[other])
                factor = left[1 + len(tables.row_weights) + row] * right * eta
                yield p * n + row * m + pattern.g_columns[one], at[other], product, factor


class _Sources:
    """Numbers of the sources, and products among them."""

    def __init__(self, problem: Problem, constraining: Constraining | None) -> None:
        pattern, sizes = problem.pattern, [0, 0]
        x, y, g = (len(of) for of in (pattern.x_rows, pattern.y_rows, pattern.g_rows))
        if constraining:
            sizes = [3 * len(constraining.weights) * g, len(constraining.projector.rows)]
        sizes = [x, y, g, *sizes]
        ends = np.cumsum(sizes)
        x_entries, y_entries, self.g, self._tangents, self.directions = (
            np.arange(end - size, end) for size, end in zip(sizes, ends, strict=True)
        )
        #: Field, rows, columns and sources of X and of Y.
        self.of_fields = (
            (0, pattern.x_rows, pattern.x_columns, x_entries),
            (1, pattern.y_rows, pattern.y_columns, y_entries),
        )
        self._entries, self._end = g, int(ends[-1])
        none = np.empty(0, np.int64)
        self._parts: list[tuple[IndexArray, IndexArray]] = [(none, none)]

    def tangents(self, row: int, field: int) -> IndexArray:
        """Those of a row of constraints to a field; G where these are Φ itself."""
        if not len(self._tangents):
            return self.g
        return self._tangents[(3 * row + field) * self._entries :][: self._entries]

    def product(self, first: IndexArray, second: IndexArray) -> IndexArray:
        """New sources: products of others."""
        self._parts.append((first, second))
        self._end += len(first)
        return np.arange(self._end - len(first), self._end)

    @property
    def products(self) -> Products:
        """All of them."""
        return Products(*(np.concatenate(of) for of in zip(*self._parts, strict=True)))


def _fields(weights: Array) -> list[int]:
    """Fields to which a row s₀, s₁, s₂ of constraints has tangents."""
    return [field for field in range(3) if np.any(weights[field:])]


def _meetings(left: IndexArray, right: IndexArray, size: int) -> tuple[IndexArray, IndexArray]:
    """All pairs of places, one in each list, that hold the same number (below ``size``)."""
    order = np.argsort(right, kind="stable")
    counts = np.bincount(right, minlength=size)
    starts = np.concatenate([[0], np.cumsum(counts)])
    lengths = counts[left]
    first = np.repeat(np.arange(len(left)), lengths)
    within = np.arange(len(first)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return first, order[np.repeat(starts[left], lengths) + within]


def _sums(parts: list[_Part], tables: StepTables) -> Sums:
    none, dtype = np.empty(0, np.int64), tables.left.dtype
    rows, columns, origins = (
        np.concatenate([none, *(np.asarray(part[field], np.int64) for part in parts)])
        for field in range(3)
    )
    coefficients = [np.broadcast_to(part[3], len(part[0])).astype(dtype) for part in parts]
    return Sums(rows, columns, origins, np.concatenate([none.astype(dtype), *coefficients]))
