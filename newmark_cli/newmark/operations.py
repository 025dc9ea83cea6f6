"""The work of a march: its linear systems, each by a formula in its size.

The same number on every machine and in every run.  A matrix of N unknowns with E entries takes
2/3 E²/N multiplications and additions to factorise and 2 E to solve with, whatever the solver:
those of a full matrix, and of one with E/N entries in each row.  Fill-in, which hangs on the order
of elimination, is left out, and so is what a problem's functions take.
"""

from newmark_cli.newmark.formulation import RECOVERED
from newmark_cli.newmark.linear.krylov import KrylovSystem
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march import March


def of_march(march: March) -> int:
    """Multiplications and additions of a march from its start to where it stands.

    Each Newton correction solves a system; each projection, and recovered multipliers in every
    step, one of size n + m.
    """
    problem, scheme, system = march.problem, march.scheme, march.system
    matrix = system.pivoting if isinstance(system, StaticSystem) else system
    size, entries = matrix.size, len(matrix.rows)
    if isinstance(system, KrylovSystem):
        # Iteration j multiplies by the matrix and orthogonalises twice against j vectors.
        newton = sum(2 * entries * k + 4 * size * k * (k + 1) for k in system.iterations)
    else:
        newton = march.corrections * direct(size, entries)
    projection, pattern = scheme.projection, problem.pattern
    in_step = (projection.level > 0) + projection.accelerations + (scheme.reported == RECOVERED)
    saddle = direct(problem.n + problem.m, len(pattern.mass_rows) + 2 * len(pattern.g_rows))
    return newton + (march.positions + march.done * in_step) * saddle


def direct(size: int, entries: int) -> int:
    """Operations of factorising a matrix of so many unknowns and entries, and solving with it."""
    return 2 * entries * entries // (3 * size) + 2 * entries
