"""Multipliers of different constraints compared: what an error of λ is relative to.

A multiplier is a force per length for a bar, Φ = ½(|Δ|² − L²), a force for a slider, a moment
for a driven angle.  What they have in common is what their constraints do.  Among all
accelerations a that the constraints allow, the motion has those with the least

    Z = ½ (a − a_f)ᵀ M (a − a_f),        M a_f = f

(Gauss's principle).  If constraint k were cut, Z would fall by ½ λ_k² / E_k, where

    E_k = [(Gᵀ M⁻¹ G)⁻¹]_kk

is the inertia that an acceleration of Φ_k meets while all other constraints hold.  So
|λ_k| / √E_k is a force over the root of a mass for every constraint.  It changes neither with
the scale of Φ_k nor with the coordinates: not where they are rotated, shifted, reordered or in
other units, nor where some are lengths and some are angles or directors.  It is at most √(2Z),
so that constraints that nearly depend on each other do not rule the rest.  E_k comes from the
index-1 matrix, and exists where M is singular.

Some points and bodies move as constraints on them alone prescribe.  Their mass acts on nothing
but the multipliers of these constraints, and may be fictitious: such multipliers do not count
in the size of the others.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray

#: Part of a random motion that is left where constraints prescribe a coordinate.
_MOVES = 1e-6
#: Least inertia that counts, in parts of the largest mass on a column of G of length 1.
_WEIGHTLESS = 1e-12
#: Multipliers below this part of the largest have no size of their own.
_UNLOADED = 1e-9
#: Constraints that are cut at a time; SuperLU is slower with more right-hand sides.
_AT_A_TIME = 16
_SEED = 20061012
#: Coordinates of a point in the plane, and of a body in space: its origin and directors.
_TOGETHER = {"xy": 2, "xyz": 12}


class Weights(NamedTuple):
    """What makes multipliers comparable."""

    sizes: Array  #: (m,) 1/√E_k
    #: (m,) 0 for a constraint on what can move; for others the number of the prescribed part that
    #: they act on
    parts: IndexArray

    def scales(self, multipliers: Array) -> Array:
        """(m,) what an error of each multiplier is compared with, in its own unit.

        The largest |λ_j| / √E_j times √E_k, of the constraints j on what can move, and
        for a prescribed part of its own as well; of all if these have no load.
        """
        # There are none of a motion that is not finite.
        with np.errstate(all="ignore"):
            largest = np.zeros(self.parts.max() + 1)
            np.maximum.at(largest, self.parts, self.sizes * np.abs(multipliers))
            compared = np.maximum(largest, largest[0])[self.parts]
            unloaded = ~(compared > _UNLOADED * largest.max())
            return np.asarray(np.where(unloaded, largest.max(), compared) / self.sizes)

    def largest(self, multipliers: Array) -> Array:
        """(k,) the largest multiplier of each of (k, m), in the unit of the largest of all.

        Of constraints on what can move, if these have a load.
        """
        with np.errstate(all="ignore"):
            weighted = self.sizes * np.abs(multipliers)
            peaks = weighted.max(axis=0, initial=0.0)
            counted = self.parts == 0
            if not peaks[counted].max(initial=0.0) > _UNLOADED * peaks.max():
                counted = np.full(len(peaks), True)
            unit = self.sizes[counted][np.argmax(peaks[counted])]
            return np.asarray(weighted[:, counted].max(axis=1) / unit)


@lru_cache(maxsize=8)
def weights_at_start(problem: Problem) -> Weights:
    """`weights` at the start of a problem, for what is compared along its motion."""
    return weights(problem, problem.t0, problem.u0)


def weights(problem: Problem, t: float, u: Array) -> Weights:
    """Weights of the multipliers at a time (s) and a position (n,) that meets the constraints.

    Takes one factorisation and m + 1 solutions of the index-1 system, whose matrix may be singular
    (numpy.linalg.LinAlgError).
    """
    n, m, (rows, columns) = problem.n, problem.m, problem.pattern[-2:]
    g = problem.values(t, u, np.zeros(n), np.zeros(m)).g
    changed = Index1(problem).changes(t, u)
    inertias = np.empty(m)
    for first in range(0, m, _AT_A_TIME):
        cut = np.arange(first, min(first + _AT_A_TIME, m))
        unit = np.zeros((m, len(cut)))
        unit[cut, cut - first] = 1.0
        inertias[cut] = changed(unit)[1][cut, cut - first]
    lengths = np.sqrt(np.bincount(columns, g * g, m))
    mass = float(np.abs(problem.mass_values).max())
    sizes = 1 / np.sqrt(np.maximum(inertias, _WEIGHTLESS * mass / lengths**2))

    # What is left of any motion once constraints have taken what they do not allow; whatever
    # its axes, a point moves if one of its coordinates does.
    motion = np.random.default_rng(_SEED).normal(size=n)
    left = np.abs(motion - changed(problem.along(g, motion))[0])
    of_points = len(problem.points_given) * len(problem.axes)
    owner = np.arange(n)
    owner[:of_points] -= owner[:of_points] % _TOGETHER[problem.axes]
    moves = np.isin(owner, owner[left > _MOVES * np.abs(motion).max()])
    free = np.bincount(columns[(g != 0) & moves[rows]], minlength=m) > 0
    held = (g != 0) & ~free[columns]
    graph = csr_array((g[held] != 0, (owner[rows[held]], n + columns[held])), (n + m, n + m))
    _, labels = connected_components(graph, directed=False)
    return Weights(sizes, np.where(free, 0, 1 + labels[n:]))


def relative(errors: Array, scales: float | Array) -> Array:
    """Errors over what they are compared with; 0 where an error vanishes, whatever that is."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(errors == 0, 0.0, errors / scales))


def relative_error(computed: Array, reference: Array, scales: Array) -> float:
    """Largest |computed_k − reference_k| / scale_k; 0 where an error vanishes."""
    return float(np.abs(relative(computed - reference, scales)).max())
