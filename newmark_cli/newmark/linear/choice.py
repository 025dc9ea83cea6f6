"""Which linear solvers there are, and which one a problem gets."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from newmark_cli.errors import InputError
from newmark_cli.newmark.forms import Form

DENSE, SPARSE = "dense-lu", "sparse-lu"
GMRES, MINRES = "gmres", "minres"
AUTO = "auto"
LINEAR_SOLVERS = (AUTO, DENSE, SPARSE, GMRES, MINRES)

#: Most unknowns for which `AUTO` takes the dense kernel.  Time per Newton iteration
#: of both marches, optimally scaled, on chains and rows of four-bars of growing
#: size: they are equal at 300 to 370 unknowns in the (u, λ) and the (u, v, a, λ)
#: form; at 30 the kernel is 20 times as fast, at 1200 the sparse march 6 times.
DENSE_UP_TO = 300
#: Most unknowns for which a dense matrix is built at all: 3 GB each.
_DENSE_AT_MOST = 20_000


class Counted(Protocol):
    """A problem, or as much of it as `choose` looks at."""

    @property
    def name(self) -> str:
        """How errors name it."""

    @property
    def n(self) -> int:
        """Coordinates."""

    @property
    def m(self) -> int:
        """Constraints."""


def choose(linear_solver: str, problem: Counted, form: Form) -> str:
    """The solver that one of `LINEAR_SOLVERS` means for a problem and a form.

    Raises:
        InputError: When a dense matrix is asked for that no memory holds.
    """
    unknowns = sum(form.sizes(problem.n, problem.m))
    if linear_solver == AUTO:
        return DENSE if unknowns <= DENSE_UP_TO else SPARSE
    if linear_solver == DENSE and unknowns > _DENSE_AT_MOST:
        raise InputError(
            f"linear_solver {DENSE}: {problem.name}, {form.described} has {unknowns} unknowns, "
            f"at most {_DENSE_AT_MOST} are allowed; take {SPARSE}"
        )
    return linear_solver


class Stagnation(np.linalg.LinAlgError):
    """An iterative solver did not reach its tolerance."""


@dataclass(frozen=True)
class Krylov:
    """When a Krylov solver stops.

    Attributes:
        tolerance: Largest residual relative to the right-hand side, both in balanced
            rows; between 0 and 1.
        limit: Most iterations of a solve; at least 1.

    Raises:
        InputError: For other values.
    """

    tolerance: float = 1e-8
    limit: int = 600

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise InputError(f"krylov tolerance = {self.tolerance:g}: must be between 0 and 1")
        if self.limit < 1:
            raise InputError(f"krylov limit = {self.limit}: must be at least 1")
