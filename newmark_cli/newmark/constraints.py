"""Rows of constraints of a formulation, their tangents, and what enforces them otherwise.

See `newmark_cli.newmark.formulation` for the rows.  With A + Φ_tu = R = ∂(Gᵀv + Φ_t)/∂u and
Q = ∂(Gᵀv' + κ)/∂u, both at the pattern of Gᵀ, the tangents of a row s₀, s₁, s₂ are

    to u: s₀ Gᵀ + s₁ R + s₂ Q,    to v: s₁ Gᵀ + 2 s₂ R,    to a: s₂ c Gᵀ,

c being ∂v'/∂a of the integrator.  η stands in row K as −Pη, P = M⁻¹G at the beginning of
the step, so that Pη is the change of least size in the norm of M.
"""

import copy
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, eigsh

from newmark_cli.newmark.scaling import DISPLACEMENT_TO_A
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.algebra import LU, spectral_norm
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray

#: Most coordinates that M couples for which its inverse is formed, block by block.
_LARGEST_BLOCK = 300
#: Most constraints for which the inverse of GᵀM⁻¹G is formed.
_DENSE_UP_TO = 300
_SEED = 20061012


class FormulationTables(NamedTuple):
    """What a formulation beside index 3, or a projection, tells the kernel.

    k is the number of rows of constraints, r of kept rows among V, K, E of entries of G.
    """

    rows: Array  #: (k, 3) s₀, s₁, s₂
    eta: Array  #: (3,) coefficients of Pη in u, v, a
    rows_eta: Array  #: (r,) the same in the kept rows V, K
    inertia: np.floating[Any]  #: c = ∂v'/∂a
    penalty: Array  #: (1,) p; 0 where λ is an unknown
    stabilised: int  #: whether there are η
    differentiated: int  #: whether a row has more than Φ itself
    level: int  #: of the projection: 0 none, 1 velocities, 2 positions too
    accelerations: int  #: whether v' is projected too
    total: int  #: whether λ + μ/h is recorded
    acting: Array  #: (1,) h in it; see `newmark_cli.newmark.scheme.Scheme.acting`
    unit: np.floating[Any]  #: of M in the projection's matrix
    projector_rows: IndexArray  #: coordinate of each term of P
    projector_columns: IndexArray  #: its constraint
    projector_sources: IndexArray  #: the entry of G that it multiplies
    projector_values: Array  #: an entry of M⁻¹
    first: IndexArray  #: sources of the dense matrix whose products are sources behind them
    second: IndexArray


class Tangents(NamedTuple):
    """Blocks of a Jacobian that a formulation adds, at one state."""

    rows: Array  #: (k, 3, E) of the rows of constraints to u, v, a, at the pattern of G
    directions: Array  #: the terms of P, at the places of `Constraining.projector`


class Projector(NamedTuple):
    """P as a sum of entries of M⁻¹ times entries of G."""

    rows: IndexArray
    columns: IndexArray
    sources: IndexArray
    values: Array


def projector(problem: Problem) -> Projector:
    """P = M⁻¹G, block by block of coordinates that M couples; as G where a block is singular.

    Where M couples more than `_LARGEST_BLOCK` coordinates, M⁻¹ is that of its diagonal:
    any P of full rank in GᵀP will do, and this one keeps the pattern of G.  In place of the
    inverse of a singular block stands the identity over its mean diagonal, so that all
    blocks are of one kind, and GᵀP is positive.
    """
    n, pattern = problem.n, problem.pattern
    mass = scipy.sparse.csr_array(
        (problem.mass_values, (pattern.mass_rows, pattern.mass_columns)), (n, n)
    )
    entries = np.arange(len(pattern.g_rows))
    plain = Projector(pattern.g_rows, pattern.g_columns, entries, np.ones(len(entries)))
    count, labels = connected_components(mass, directed=False)
    if np.bincount(labels, minlength=count).max() > _LARGEST_BLOCK:
        diagonal = mass.diagonal()
        if not np.all(diagonal > 0):
            return plain
        return plain._replace(values=1 / diagonal[pattern.g_rows])
    members = np.argsort(labels, kind="stable")
    blocks = np.split(members, np.cumsum(np.bincount(labels, minlength=count))[:-1])
    parts = [mass[block][:, block].toarray() for block in blocks]
    regular = [np.linalg.cond(part) <= 1 / np.finfo(float).eps ** 0.75 for part in parts]
    if not any(regular):
        return plain
    # A block without any mass weighs as much as the others do on the average.
    usual = float(np.abs(problem.mass_values).max())
    of_coordinate: dict[int, tuple[Any, Any]] = {}
    for block, part, invertible in zip(blocks, parts, regular, strict=True):
        mean = float(np.trace(part)) / len(block) or usual
        inverse = LU(part).inverse() if invertible else np.eye(len(block)) / mean
        of_coordinate.update((int(i), (block, inverse[:, j])) for j, i in enumerate(block))
    rows, columns, sources, values = [], [], [], []
    for e, (i, k) in enumerate(zip(pattern.g_rows.tolist(), pattern.g_columns, strict=True)):
        block, column = of_coordinate[i]
        there = np.flatnonzero(column)
        rows.append(block[there])
        columns.append(np.full(len(there), k))
        sources.append(np.full(len(there), e))
        values.append(column[there])
    return Projector(*(np.concatenate(parts) for parts in (rows, columns, sources, values)))


def least_inertia(problem: Problem) -> float:
    """Least eigenvalue of GᵀM⁻¹G at the start: how hard a constraint is to violate.

    Raises:
        numpy.linalg.LinAlgError: When [[M, −G], [Gᵀ, 0]] is singular.
    """
    m = problem.m
    changed = Index1(problem).changes(problem.t0, problem.u0)

    def impulse(wanted: Array) -> Array:
        """(GᵀM⁻¹G)⁻¹ times (m,)."""
        return changed(np.ravel(wanted))[1]

    if m <= _DENSE_UP_TO:
        inverse = np.column_stack([impulse(unit) for unit in np.eye(m)])
        return 1 / spectral_norm((inverse + inverse.T) / 2)
    start = np.random.default_rng(_SEED).normal(size=m)
    operator = LinearOperator((m, m), matvec=impulse, dtype=float)
    return 1 / float(eigsh(operator, k=1, v0=start, return_eigenvectors=False)[0])


class Constraining:
    """A formulation, and a projection, on a problem."""

    def __init__(self, problem: Problem, scheme: Scheme) -> None:
        self.problem = problem
        self._take(scheme)

    def at(self, scheme: Scheme) -> "Constraining":
        """The same at another step size."""
        other = copy.copy(self)
        other.__dict__.pop("penalty", None)
        other._take(scheme)
        return other

    def _take(self, scheme: Scheme) -> None:
        self.scheme = scheme
        self.weights = scheme.formulation.weights(scheme.h)
        self.inertia = float(scheme.relations.acceleration[0])
        self.stabilised = scheme.stabilised
        self.eta = scheme.elimination.eta
        self.rows_eta = scheme.elimination.rows_eta

    @cached_property
    def penalty(self) -> float:
        """Penalty p of the augmented Lagrangian; 0 for other formulations."""
        formulation = self.scheme.formulation
        if not formulation.kind.penalised:
            return 0.0
        assert formulation.parameter is not None
        name, value = formulation.parameter
        if name == "penalty":
            return value
        to_acceleration = DISPLACEMENT_TO_A(self.scheme.symbols)
        return value * to_acceleration / self._least_inertia

    @cached_property
    def _least_inertia(self) -> float:
        return least_inertia(self.problem)

    @cached_property
    def projector(self) -> Projector:
        """The terms of P; none without η."""
        if not self.stabilised:
            nowhere = np.empty(0, np.int64)
            return Projector(nowhere, nowhere, nowhere, np.empty(0))
        return projector(self.problem)

    @property
    def differentiated(self) -> bool:
        """Whether a row of constraints has more than Φ itself."""
        return bool(np.any(self.weights[:, 1:]))

    def directions(self, g: Array) -> Array:
        """The terms of P for these entries of G; none without η."""
        terms = self.projector
        return np.asarray(terms.values * g[terms.sources])

    @cached_property
    def pairs(self) -> tuple[IndexArray, IndexArray]:
        """Pairs of entries of G that stand in one constraint."""
        columns = self.problem.pattern.g_columns
        order = np.argsort(columns, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(columns[order])) + 1)
        first = [np.repeat(group, len(group)) for group in groups]
        second = [np.tile(group, len(group)) for group in groups]
        return np.concatenate(first), np.concatenate(second)

    def tangents(self, g: Array, r: Array, q: Array) -> Array:
        """(k, 3, E) of the rows to u, v, a, from the entries of G, R and Q."""
        return np.array(
            [
                [s0 * g + s1 * r + s2 * q, s1 * g + 2 * s2 * r, s2 * self.inertia * g]
                for s0, s1, s2 in self.weights
            ]
        ).reshape(-1, 3, len(g))

    def tangents_at(self, t: float, u: Array, v: Array, acceleration: Array) -> Tangents:
        """Tangents at a state, P being that of the state itself."""
        g = self.problem.values(t, u, v, np.zeros(self.problem.m)).g
        rows = self.problem.constraint_rows(t, u, v, acceleration)
        return Tangents(self.tangents(g, rows.r, rows.q), self.directions(g))

    def tables(self, products: Sequence[IndexArray]) -> FormulationTables:
        """All of it as the numbers that the kernel reads, in the scheme's precision.

        ``products`` are pairs of sources of the dense matrix.
        """
        scheme, dtype = self.scheme, self.scheme.dtype
        terms, (first, second) = self.projector, products
        unit = float(np.abs(self.problem.mass_values).max())
        return FormulationTables(
            rows=self.weights.astype(dtype),
            eta=self.eta.astype(dtype),
            rows_eta=self.rows_eta.astype(dtype),
            inertia=dtype(self.inertia),
            penalty=np.array([self.penalty], dtype),
            stabilised=int(self.stabilised),
            differentiated=int(self.differentiated),
            level=scheme.projection.level,
            accelerations=int(scheme.projection.accelerations),
            total=int(scheme.total),
            acting=np.array([scheme.acting], dtype),
            unit=dtype(unit),
            projector_rows=terms.rows.astype(np.int64),
            projector_columns=terms.columns.astype(np.int64),
            projector_sources=terms.sources.astype(np.int64),
            projector_values=terms.values.astype(dtype),
            # Unsigned, as numba tests signed ones for their sign.
            first=first.astype(np.uint32),
            second=second.astype(np.uint32),
        )


def constraining_of(problem: Problem, scheme: Scheme) -> Constraining | None:
    """The formulation of a scheme on a problem; None for index 3 without a projection."""
    return Constraining(problem, scheme) if scheme.formulated else None
