"""Terms of equations of motion in angles and distances, which people write by hand.

With rates ω = Wᵀv of as many angles and distances as there are degrees of freedom, and T such that
GᵀT = 0 and WᵀT = 1, motions are v = T ω, and the equations

    TᵀM T ω′ + Σ q_ijk ω_j ω_k = Tᵀf,    q_ijk = T_i · M (∂T_j/∂u) T_k.

One of these quadratic terms is a force W_i q_ijk ω_j ω_k, since T_iᵀW_i = 1.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from newmark_cli.codes.truth import Force
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
#: Rates at the start with which terms are compared.
_AT_START = np.array([1.0, 0.7, 1.3])


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
    # Codes write down what is driven, too.
    kept = np.array([not name.startswith("motions.") for name in problem.constraint_names], bool)
    t0, u0 = problem.t0, problem.u0
    free = problem.n - np.linalg.matrix_rank(problem.gradient(t0, u0)[:, kept], tol=_RANK)
    if not 0 < free <= _FREEDOMS:
        return
    choices = (
        choice for choice in itertools.combinations(rates, int(free))
        if len({rate.of for rate in choice}) == free
    )  # fmt: skip
    seen: list[Array] = []
    v: Array | None = None
    for choice in itertools.islice(choices, _CHOICES):
        equations = _Equations(problem, kept, choice)
        if not equations.are_independent():
            continue
        moved = equations.motions(t0, u0)
        inertia = float(np.abs(moved.T @ problem.M @ moved).max())
        v = moved @ _AT_START[:free] if v is None else v  # the same for all choices
        for name, parts in _named(choice):
            force = partial(equations.terms, parts)
            at_start = force(t0, u0, v)
            size = float(np.abs(at_start).max())
            least = _TELLS * inertia * float(np.abs(equations.weights(u0)).max())
            if size > least and all(np.abs(at_start - old).max() > _TELLS * size for old in seen):
                seen.append(at_start)
                yield name, force


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
            step = _STEP * np.abs(u).max() / np.abs(moved[:, k]).max()
            ahead, behind = (self._rows(t, u + way * step * moved[:, k]) for way in (1, -1))
            # Of R T = (1, 0) the derivative is R ∂T = −∂R T.
            q = -omega[k] * pushed @ ((ahead - behind) / (2 * step) @ moved)
            for i, j, _ in (part for part in parts if part[2] == k):
                forces += weights[i] * q[i, j] * omega[j] * (1 if j == k else 2)
        return forces

    def weights(self, u: Array) -> Array:
        """(k, n) Wᵀ."""
        return np.array([rate.weights(u) for rate in self.rates])

    def motions(self, t: float, u: Array) -> Array:
        """(n, k) T: velocities of which one rate is 1."""
        return np.asarray(np.linalg.pinv(self._rows(t, u))[:, : len(self.rates)])

    def _rows(self, t: float, u: Array) -> Array:
        """(k + constraints, n) R: Wᵀ and Gᵀ."""
        return np.vstack([self.weights(u), self.problem.gradient(t, u)[:, self.kept].T])
