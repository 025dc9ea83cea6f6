"""Which linear solvers there are, and which one a problem gets."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from newmark_cli.newmark.forms import Form
from newmark_cli.support.errors import InputError

DENSE, SPARSE, STATIC = "dense-lu", "sparse-lu", "static-lu"
GMRES = "gmres"
AUTO = "auto"
LINEAR_SOLVERS = (AUTO, DENSE, SPARSE, STATIC, GMRES)

#: Most unknowns for which `AUTO` pivots where static elimination is possible: up to there the
#: row exchanges are written out, too, and cost little.
PIVOTED_UP_TO = 40
#: Most unknowns for which `AUTO` takes the dense kernel elsewhere.  Time per Newton iteration
#: of both marches with partial pivoting, optimally scaled, on chains and rows of
#: four-bars of growing size: they are equal at 300 to 370 unknowns in the (u, λ) and the
#: (u, v, a, λ) form; at 30 the kernel is 20 times as fast, at 1200 the sparse march 6 times.
DENSE_UP_TO = 300
#: Most unknowns for which a dense matrix is built at all: 3 GB each.
_DENSE_AT_MOST = 20_000


def choose(
    linear_solver: str,
    problem: Any,
    form: Form,
    formulated: bool = False,
    precision: str = "float64",
) -> str:
    """The solver that one of `LINEAR_SOLVERS` means for a problem and a form.

    Of the problem it looks at ``name``, ``n``, ``m`` and ``compiled``.

    `AUTO` takes partial pivoting up to `PIVOTED_UP_TO` unknowns: static elimination does not see
    a diagonal scaling, and what a scaling does for a solver that does is what most studies are
    about.  Beyond, it takes static elimination, three times as fast and more, wherever that is
    possible; elsewhere partial pivoting, dense up to `DENSE_UP_TO` unknowns.

    Raises:
        InputError: When a dense matrix is asked for that no memory holds, or static
            elimination of what it cannot eliminate.
    """
    unknowns = sum(form.sizes(problem.n, problem.m))
    if linear_solver == AUTO:
        static = not formulated and problem.compiled and precision == "float64"
        if static and unknowns > PIVOTED_UP_TO:
            return STATIC
        return DENSE if unknowns <= DENSE_UP_TO else SPARSE
    if linear_solver == STATIC and (why := not_static(problem, formulated)):
        raise InputError(why)
    if linear_solver == DENSE and unknowns > _DENSE_AT_MOST:
        raise InputError(
            f"linear_solver {DENSE}: {problem.name}, {form.described} has {unknowns} unknowns, "
            f"at most {_DENSE_AT_MOST} are allowed; take {SPARSE}"
        )
    return linear_solver


def not_static(problem: Any, formulated: bool) -> str:
    """Why static elimination cannot solve for a problem; empty where it can."""
    if formulated:
        return f"{STATIC} solves index 3 without a projection only; take {DENSE} or {SPARSE}"
    if not problem.compiled:
        return (
            f"{STATIC} needs compiled functions, those of {problem.name} are plain Python; "
            f"take {DENSE} or {SPARSE}"
        )
    return ""


class Stagnation(np.linalg.LinAlgError):
    """An iterative solver did not reach its tolerance."""


@dataclass(frozen=True)
class Krylov:
    """When a Krylov solver stops."""

    #: largest residual relative to the right-hand side, both in balanced rows; between 0 and 1
    tolerance: float = 1e-8
    limit: int = 600  #: most iterations of a solve; at least 1

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise InputError(f"krylov tolerance = {self.tolerance:g}: must be between 0 and 1")
        if self.limit < 1:
            raise InputError(f"krylov limit = {self.limit}: must be at least 1")
