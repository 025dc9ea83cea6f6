"""The linear systems that Newton's iteration solves along a march."""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
import scipy.sparse

from newmark_cli.newmark.constraints import Tangents
from newmark_cli.newmark.engine import Engine
from newmark_cli.newmark.linear.solvers import LinearSystem
from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import COMPLETED, counting
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Values
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import InputError


@dataclass(frozen=True, eq=False)
class NewtonSystem:
    """J̄ q̄ = −D_L b of one iteration of Newton's in one step, with all that it came from.

    Attributes:
        matrix: J̄ = D_L J D_R, shape (N, N), without its zeros.
        rhs: (N,) −D_L b.
        scheme: Integrator, form, scaling and step size of the march.
        n, m: Coordinates and constraints.
        t: Time at the end of the step (s).
        step: Number of the step, the first being 1.
        iteration: Number of the iteration in the step, the first being 1.
        iterations: Linear systems that the step solved.

    Examples:
        >>> import newmark_cli as newmark
        >>> first, last = newmark.linear_systems("pendulum", h=1e-3, steps=[10])
        >>> first.rows, first.unknowns, first.sizes, first.matrix.shape
        (('D', 'C'), ('u', 'lambda'), (2, 1), (3, 3))
        >>> last.iteration == last.iterations, f"{last.beta * last.h**2:g}", last.left["D"]
        (True, '2.5e-07', 2.5e-07)
    """

    matrix: scipy.sparse.csc_array
    rhs: Array
    scheme: Scheme
    n: int
    m: int
    t: float
    step: int
    iteration: int
    iterations: int

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the row blocks."""
        return self.scheme.form.rows

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the blocks of unknowns."""
        return self.scheme.form.solved

    @property
    def sizes(self) -> tuple[int, ...]:
        """Sizes of the blocks, the same of rows and unknowns."""
        return tuple(self.scheme.form.sizes(self.n, self.m))

    @property
    def left(self) -> dict[str, float]:
        """Row block → its factor in D_L."""
        return dict(zip(self.rows, self.scheme.left.tolist(), strict=True))

    @property
    def right(self) -> dict[str, float]:
        """Unknown → its factor in D_R."""
        return dict(zip(self.unknowns, self.scheme.right.tolist(), strict=False))

    @property
    def h(self) -> float:
        """Step size (s)."""
        return self.scheme.h

    @property
    def beta(self) -> float:
        """β in the factors: ∂u/∂v' = β h²."""
        return self.scheme.symbols["beta"]

    @property
    def gamma(self) -> float:
        """γ in the factors: ∂v/∂v' = γ h."""
        return self.scheme.symbols["gamma"]


#: Number of a solution, J̄ and the right-hand side.
_Seen = list[tuple[int, scipy.sparse.csc_array, Array]]


def _observed_by(seen: _Seen, system: LinearSystem, every: bool) -> LinearSystem:
    """The same linear system, which notes what it solves: all, or the first and the last."""

    def solve(values: Values, rhs: Array, tangents: Tangents | None = None) -> Array:
        number = seen[-1][0] + 1 if seen else 1
        if not every:
            del seen[1:]
        seen.append((number, system.matrix(values, tangents), rhs.copy()))
        return system.solve(values, rhs, tangents)

    noting = copy(system)
    vars(noting)["solve"] = solve
    return noting


def newton_systems(
    march: March, steps: Sequence[int], every_iteration: bool = False
) -> Iterator[NewtonSystem]:
    """Systems that a march solves in some of its steps: in the first and last iteration.

    The march goes on as ever, with its own solver.  A step that is observed is taken twice, from
    the state in which the march stands: the same algorithm, from the same numbers, with systems
    assembled and solved in Python.  When the march ends before the last of the steps, so do the
    systems; its `ending` says how.  Systems that are not finite are left out.  Steps are
    ascending, the first being 1, of this march or that which it goes on with.

    Raises:
        InputError: In single precision: such a march is assembled and solved inside the
            compiled kernel.
    """
    if march.scheme.precision != "float64":
        raise InputError(
            f"precision {march.scheme.precision}: only systems of marches in float64 can be "
            "had; others are assembled and solved inside the compiled kernel"
        )
    return _observed(march, steps, every_iteration)


def _observed(march: March, steps: Sequence[int], every_iteration: bool) -> Iterator[NewtonSystem]:
    problem, noting = march.problem, list[LinearSystem]()
    engine = Engine(
        problem, march.schemes.base, constraining=march.system_of(0).constraining,
        schemes=march.schemes, system_at=lambda step: noting[-1],
    )  # fmt: skip
    for step in steps:
        number = step - march.earlier
        for _ in march.stretches(number - 1):
            pass
        if march.ending != COMPLETED:
            return
        seen: _Seen = []
        scheme, state = march.schemes.at(number), march.state.copy()
        noting[:] = [_observed_by(seen, march.system_of(number), every_iteration)]
        engine.march(state, march.done, counting(1, len(scheme.recorded)))
        for iteration, matrix, rhs in seen:
            if np.all(np.isfinite(matrix.data)) and np.all(np.isfinite(rhs)):
                t = march.grid.t(number)
                yield NewtonSystem(
                    matrix, rhs, scheme, problem.n, problem.m, t, step, iteration, seen[-1][0]
                )
        march.advance(1)
        if march.ending != COMPLETED:
            return
