"""Terms of equations of motion in angles and distances, which people write by hand.

With rates ω = Wᵀv of as many angles and distances as there are degrees of freedom, and T such that
GᵀT = 0 and WᵀT = 1, motions are v = T ω, and the equations

    TᵀM T ω′ + Σ q_ijk ω_j ω_k = Tᵀf,    q_ijk = T_i · M (∂T_j/∂u) T_k.

One of these quadratic terms is a force W_i q_ijk ω_j ω_k, since T_iᵀW_i = 1, and one entry of TᵀM T
a part W_i (T_i · M T_j) W_jᵀ of M.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from newmark_cli.codes.truth import Force, MassOf
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, Mask

#: Numbers of an equation, and of two rates.
_Term = tuple[int, int, int]
#: Most degrees of freedom, and choices of their rates, that are looked at.
_FREEDOMS, _CHOICES = 3, 8
#: Step of a difference, over the size of the coordinates.
_STEP = 1e-5
#: Part of the largest term from which on one tells something; singular values that count.
_TELLS, _RANK = 1e-6, 1e-8
#: Rates with which terms are compared, and how far from the start, over its size.
_COMPARED, _AWAY = np.array([1.0, 0.7, 1.3]), 0.1


class Rate(NamedTuple):
    """A rate in which equations may be written."""

    of: str  #: what moves: a choice has one rate of each
    name: str
    weights: Callable[[Array], Array]  #: coordinates u (n,) → (n,) what it is of velocities


def terms(problem: Problem, rates: Sequence[Rate]) -> Iterator[tuple[str, Force]]:
    """Quadratic terms of equations in every choice of rates, by name, as the forces that they are.

    Args:
        problem: The mechanism.
        rates: Those of angles and distances that codes may take as coordinates.
    """
    seen: list[Array] = []
    for equations, u, v in _choices(problem, rates):
        moved = equations.motions(problem.t0, u)
        inertia = float(np.abs(moved.T @ problem.M @ moved).max())
        for name, parts in _named(equations.rates):
            force = partial(equations.terms, parts)
            there = force(problem.t0, u, v)
            size = float(np.abs(there).max())
            least = _TELLS * inertia * float(np.abs(equations.weights(u)).max())
            if size > least and all(np.abs(there - old).max() > _TELLS * size for old in seen):
                seen.append(there)
                yield name, force


def couplings(problem: Problem, rates: Sequence[Rate]) -> Iterator[tuple[str, MassOf]]:
    """Couplings T_i · M T_j of two rates in the matrix of masses, as part of M, by name.

    Args:
        problem, rates: As of `terms`.
    """
    for equations, u, _ in _choices(problem, rates):
        moved = equations.motions(problem.t0, u)
        inertia = np.abs(moved.T @ problem.M @ moved)
        for i, j in itertools.combinations(range(len(inertia)), 2):
            if inertia[i, j] > _TELLS * inertia.max():
                names = " and ".join(equations.rates[k].name for k in (i, j))
                yield f"the coupling of {names} in the matrix of masses", \
                    partial(equations.coupling, i, j)  # fmt: skip


def _choices(
    problem: Problem, rates: Sequence[Rate]
) -> Iterator[tuple["_Equations", Array, Array]]:
    """Equations in as many rates as there are degrees of freedom, and u and v to compare them at.

    Codes write driven rates, too.  Where a motion starts, much may be 0.
    """
    kept = np.array([not name.startswith("motions.") for name in problem.constraint_names], bool)
    u0 = problem.u0
    gradient = problem.gradient(problem.t0, u0)[:, kept]
    free = int(problem.n - np.linalg.matrix_rank(gradient, tol=_RANK))
    if not 0 < free <= _FREEDOMS:
        return
    every = (_Equations(problem, kept, choice) for choice in itertools.combinations(rates, free)
             if len({rate.of for rate in choice}) == free)  # fmt: skip
    v: Array | None = None
    for equations in filter(_Equations.are_independent, itertools.islice(every, _CHOICES)):
        if v is None:
            v = equations.motions(problem.t0, u0) @ _COMPARED[:free]
        yield equations, u0 + _AWAY * np.abs(u0).max() / np.abs(v).max() * v, v


def _named(choice: Sequence[Rate]) -> Iterator[tuple[str, list[_Term]]]:
    """Each term, those of an equation together, and all."""
    equations: list[list[_Term]] = []
    for i, of in enumerate(choice):
        pairs = itertools.combinations_with_replacement(range(len(choice)), 2)
        equations.append([(i, j, k) for j, k in pairs])
        for term in equations[-1]:
            _, j, k = term
            rate = f"the rate of {choice[j].name} squared"
            if j != k:
                rate = f"the rates of {choice[j].name} and {choice[k].name}"
            yield f"the term with {rate} in the equation of {of.name}", [term]
    for of, parts in zip(choice, equations, strict=True):
        yield f"every quadratic term in the equation of {of.name}", parts
    names = ", ".join(rate.name for rate in choice)
    yield f"every quadratic term of the equations in {names}", [*itertools.chain(*equations)]


@dataclass(frozen=True, eq=False)
class _Equations:
    """Equations of motion in a choice of rates."""

    problem: Problem
    kept: Mask  #: (m,) constraints that are not driven
    rates: Sequence[Rate]

    def are_independent(self) -> bool:
        """Whether no motion at the start leaves all rates 0."""
        rows = self._rows(self.problem.t0, self.problem.u0)
        return int(np.linalg.matrix_rank(rows, tol=_RANK)) == self.problem.n

    def terms(self, parts: Sequence[_Term], t: float, u: Array, v: Array) -> Array:
        """(n,) sum of W_i q_ijk ω_j ω_k, of those with j and k exchanged, too."""
        rows, count = self._rows(t, u), len(self.rates)
        inverse = np.linalg.pinv(rows)
        weights, moved = rows[:count], inverse[:, :count]
        omega, pushed = weights @ v, moved.T @ self.problem.M @ inverse
        forces = np.zeros(len(u))
        for k in {k for _, _, k in parts}:
            step = _STEP * (np.abs(u).max() or 1.0) / np.abs(moved[:, k]).max()
            ahead, behind = (self._rows(t, u + way * step * moved[:, k]) for way in (1, -1))
            # Of R T = (1, 0) the derivative is R ∂T = −∂R T.
            q = -omega[k] * pushed @ ((ahead - behind) / (2 * step) @ moved)
            for i, j, _ in (part for part in parts if part[2] == k):
                forces += weights[i] * q[i, j] * omega[j] * (1 if j == k else 2)
        return forces

    def coupling(self, i: int, j: int, t: float, u: Array) -> Array:
        """(n, n) W_i (T_i · M T_j) W_jᵀ, and its transpose."""
        weights, moved = self.weights(u), self.motions(t, u)
        half = (moved[:, i] @ self.problem.M @ moved[:, j]) * np.outer(weights[i], weights[j])
        return np.asarray(half + half.T)

    def weights(self, u: Array) -> Array:
        """(k, n) Wᵀ."""
        return np.array([rate.weights(u) for rate in self.rates])

    def motions(self, t: float, u: Array) -> Array:
        """(n, k) T: velocities of which one rate is 1."""
        return np.asarray(np.linalg.pinv(self._rows(t, u))[:, : len(self.rates)])

    def _rows(self, t: float, u: Array) -> Array:
        """(k + constraints, n) R: Wᵀ and Gᵀ."""
        return np.vstack([self.weights(u), self.problem.gradient(t, u)[:, self.kept].T])
