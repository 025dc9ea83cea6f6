"""Multiplications and additions of a march, counted: the same number on every machine.

A correction evaluates the mechanism, adds up the terms of its matrix, eliminates and
substitutes.  A division or a root counts as one operation.  What takes as many
operations as there are unknowns is left out: residuals, updates, norms.

An elimination is counted by the pattern of the matrix, without row exchanges, in the order
of the solver: static elimination in its own, all other direct solvers in that of
`newmark_cli.newmark.linear.sparse.elimination_order`.  So the count knows nothing of the
numbers in the matrix; partial pivoting, which does, fills in more or less than that.

The functions of a mechanism count by running once, as Python, on numbers that count.  Those
of a problem in Python are not counted.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from operator import add, mul, sub
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from newmark_cli.newmark.constraints import Tangents, constraining_of
from newmark_cli.newmark.formulation import RECOVERED
from newmark_cli.newmark.linear.krylov import KrylovSystem
from newmark_cli.newmark.linear.ordering import Order
from newmark_cli.newmark.linear.sparse import SparseSystem, elimination_order
from newmark_cli.newmark.linear.systems import LinearSystem
from newmark_cli.newmark.linear.written.lists import EliminationLists
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array

#: What does not count: comparisons, signs, and what moves a number about.
_FREE = {
    np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal,
    np.absolute, np.negative, np.positive, np.isfinite, np.isnan, np.floor, np.maximum, np.minimum,
}  # fmt: skip


class Tally:
    """Counts the operations that are done with its numbers."""

    def __init__(self) -> None:
        self.operations = 0

    def number(self, value: float) -> Any:
        """A number that counts."""
        return _Number(self, value)

    def array(self, values: Any) -> Any:
        """An array of them."""
        numbers = np.asarray(values, float)
        counted = np.empty(numbers.shape, object)
        counted.ravel()[:] = [_Number(self, value) for value in numbers.ravel().tolist()]
        return counted


def _counting(compute: Callable[[Any, Any], Any]) -> Any:
    """An operator of `_Number`; by its ufunc it would take ten times as long."""

    def computed(self: "_Number", other: Any) -> "_Number":
        self.tally.operations += 1
        value = other.value if type(other) is _Number else other
        return _Number(self.tally, compute(self.value, value))

    return computed


class _Number(NDArrayOperatorsMixin):
    __slots__ = "tally", "value"

    def __init__(self, tally: Tally, value: Any) -> None:
        self.tally, self.value = tally, value

    @property
    def real(self) -> "_Number":
        """Itself: it is not complex."""
        return self

    __add__ = __radd__ = __iadd__ = _counting(add)
    __mul__ = __rmul__ = __imul__ = _counting(mul)
    __sub__ = __isub__ = _counting(sub)
    __rsub__ = _counting(lambda b, a: a - b)

    def __array_ufunc__(self, ufunc: Any, method: str, *operands: Any, out: Any = None) -> Any:
        self.tally.operations += ufunc not in _FREE
        result = ufunc(*(x.value if isinstance(x, _Number) else x for x in operands))
        return _Number(self.tally, result) if isinstance(result, np.floating) else result

    def __float__(self) -> float:
        return float(self.value)


def interpreted(function: Any) -> Callable[..., Any]:
    """A compiled function, and all that it calls, as Python."""
    plain = getattr(function, "py_func", function)
    called = {
        name: interpreted(value)
        for name in plain.__code__.co_names
        if hasattr(value := plain.__globals__.get(name), "py_func")
    }
    return FunctionType(plain.__code__, plain.__globals__ | called, plain.__name__)


class Evaluation(NamedTuple):
    """Operations of a problem's functions; 0 where they are the user's code."""

    values: int  #: of force, Φ, X, Y and G
    derivatives: int  #: of what Φ' and Φ'' have besides G, and of their tangents


@lru_cache(maxsize=16)
def evaluation(problem: Problem) -> Evaluation:
    """Operations of a problem's functions, at its start."""
    if problem.code or not problem.compiled:
        return Evaluation(0, 0)
    counts = []
    pattern, n, m = problem.pattern, problem.n, problem.m
    entries = len(pattern.g_rows)
    for function, third, results in (
        (problem.function, m, (n, m, len(pattern.x_rows), len(pattern.y_rows), entries)),
        (problem.derivatives, n, (m, m, entries, entries)),
    ):
        tally = Tally()
        state = [tally.array(values) for values in (problem.u0, problem.v0, np.zeros(third))]
        out = [tally.array(np.zeros(size)) for size in results]
        t, reals = tally.number(problem.t0), tally.array(problem.reals)
        interpreted(function)(t, *state, problem.ints, reals, *out)
        counts.append(tally.operations)
    return Evaluation(*counts)


class Work(NamedTuple):
    """Operations of the parts of a march."""

    correction: int  #: of a Newton correction; of a Krylov solver without its iterations
    step: int  #: what a step takes besides its corrections
    position: int  #: of a correction of positions by a projection


def work(problem: Problem, scheme: Scheme, system: LinearSystem) -> Work:
    """Operations of the parts of a march.

    Recovered multipliers are part of every step, as if each were reported.
    """
    values, derivatives = evaluation(problem)
    constraining = constraining_of(problem, scheme)
    sparse = system if isinstance(system, SparseSystem) else SparseSystem(problem, scheme)
    correction = values + 2 * sparse.terms
    if isinstance(system, StaticSystem):
        correction += elimination(system.elimination.lists)
    elif not isinstance(system, KrylovSystem):
        correction += elimination(EliminationLists(sparse.order, sparse.rows, sparse.columns))
    saddle = values + _saddle(problem)
    step = values * scheme.compensated
    if constraining:
        projection = scheme.projection
        correction += _constraining(sparse)
        if constraining.penalty:  # λ is updated by Φ after each correction
            correction, step = correction + values, step + values
        if constraining.differentiated:
            correction += derivatives
        if constraining.stabilised and not scheme.compensated:
            step += values
        if constraining.rated and scheme.compensated:
            step += derivatives
        step += ((projection.level > 0) + projection.accelerations) * (saddle + derivatives)
    if scheme.reported == RECOVERED:
        step += saddle + derivatives
    return Work(correction, step, saddle)


def of_march(march: March) -> int:
    """Operations of a march from its start to where it stands."""
    parts = work(march.problem, march.scheme, march.system)
    operations = march.corrections * parts.correction + march.done * parts.step
    if isinstance(march.system, KrylovSystem):
        operations += krylov(march.system, march.system.iterations)
    return operations + march.positions * parts.position


def elimination(lists: EliminationLists) -> int:
    """Operations of a factorisation in a fixed order, and of the substitutions for one vector."""
    lower, upper, size = len(lists.lower_rows), len(lists.upper_rows), lists.size
    return (2 * lists.operations + lower + size) + (2 * lower + 2 * upper + size)


def krylov(system: KrylovSystem, iterations: Sequence[int]) -> int:
    """Operations of Krylov solves with so many iterations each.

    Iteration j of GMRES has a product with J̄ and orthogonalises twice against j vectors; the
    solution is then put together from them.
    """
    size, product = system.size, 2 * len(system.rows)
    return sum(
        count * (product + 2 * size) + 4 * size * count * (count + 1) for count in iterations
    )


def _saddle(problem: Problem) -> int:
    """Of [[M, −G], [Gᵀ, 0]], eliminated for one vector."""
    n, pattern = problem.n, problem.pattern
    rows = np.concatenate([pattern.mass_rows, pattern.g_rows, n + pattern.g_columns])
    columns = np.concatenate([pattern.mass_columns, n + pattern.g_columns, pattern.g_rows])
    return elimination(EliminationLists(Order(*elimination_order(problem, 1)), rows, columns))


def _constraining(system: SparseSystem) -> int:
    """What a formulation forms before it is added up: tangents of its rows, and products."""
    constraining, problem, tally = system.constraining, system.problem, Tally()
    assert constraining is not None
    sizes = (len(rows) for rows in problem.pattern[2::2])
    x, y, g = (tally.array(np.ones(size)) for size in sizes)
    nothing: Array = np.zeros(0)
    tangents = Tangents(constraining.tangents(g, g, g), constraining.directions(g))
    system.products(Values(nothing, nothing, x, y, g), tangents)
    return tally.operations
