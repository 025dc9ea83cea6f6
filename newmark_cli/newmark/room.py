"""What a march overwrites in every step, allocated before it.

In the shapes p is the number of kept fields among (u, v, a), r of kept rows among (V, K), P of
past vectors, k of rows of constraints, and N = p n + m.
"""

from typing import Any, NamedTuple

import numpy as np

from newmark_cli.newmark.march_data import PythonCalls


class Iterate(NamedTuple):
    """What Newton iterates on: the fields, or their increments over the step."""

    compensated: bool  #: whether it is the increments; only they need shift and g_old
    moving: np.ndarray  #: (3, n) u, v, a, the memory of the state; compensated: w, ν, a
    h: np.ndarray  #: (1,) step size (s)
    shift: np.ndarray  #: (n,) Δ = h v_n + w
    g_old: np.ndarray  #: entries of G at the beginning of the step


class Evaluated(NamedTuple):
    """The problem at the iterate; see `newmark_cli.problems.problem.Values`."""

    force: np.ndarray  #: (n,) f + Gλ
    phi: np.ndarray  #: (m,) Φ
    x: np.ndarray  #: entries of X
    y: np.ndarray  #: entries of Y
    g: np.ndarray  #: entries of G


class History(NamedTuple):
    """What the past adds to the equations of one step."""

    fields: np.ndarray  #: (3, n) to u, v, a; not set of those that are kept
    dynamics: np.ndarray  #: (n,) to row D
    rows: np.ndarray  #: (r, n) to rows V, K


class System(NamedTuple):
    """A dense linear system, (0, 0) where Python solves it."""

    matrix: np.ndarray  #: (N, N) until it is solved
    entries: np.ndarray  #: (N²,) the same memory as one vector
    rhs: np.ndarray  #: (N,) overwritten with the solution
    columns: np.ndarray  #: (N,) the solver's work space
    row: np.ndarray  #: (N,) likewise


class Enforcing(NamedTuple):
    """Room for what a formulation adds; E entries of G, b recorded blocks."""

    rate: np.ndarray  #: (m,) Φ_t
    curvature: np.ndarray  #: (m,) κ
    r: np.ndarray  #: (E,) entries of R
    r_old: np.ndarray  #: (E,) the same at the beginning of the step
    q: np.ndarray  #: (E,) entries of Q
    psi: np.ndarray  #: (m,) Gᵀv + Φ_t
    tangents: np.ndarray  #: (k, 3, E) of the rows of constraints to u, v, a
    eta: np.ndarray  #: (m,) η
    directions: np.ndarray  #: (T,) terms of P at the beginning of the step
    moved: np.ndarray  #: (n,) P times the change of η, in double precision
    push: np.ndarray  #: (n,) Pη
    shifted: np.ndarray  #: (m,) λ − pΦ
    now: np.ndarray  #: (b,) norms of the blocks of a correction
    last: np.ndarray  #: (b,) of the one before
    done: np.ndarray  #: (b,) whether a block has stopped decreasing
    saddle: System  #: (n + m) of a projection


class Room(NamedTuple):
    """What a march overwrites in every step."""

    #: entries of X, Y and G, those of the values; of a formulation then its own, see `assembly`
    sources: np.ndarray
    values: Evaluated
    constraints: np.ndarray  #: (k, m) rows of constraints; of index 3 the memory of Φ
    iterate: Iterate
    history: History
    system: System
    new_past: np.ndarray  #: (P, n) what the past vectors become
    last_fields: np.ndarray  #: (4, n) u, v, a, v' before a correction that is tested by field
    last_multipliers: np.ndarray  #: (m,) λ likewise
    work: Any  #: `Enforcing`; None for index 3
    python: PythonCalls  #: what is called in Python


def _system(size, dense, dtype):
    """Return room for a linear system."""
    matrix = np.empty((size, size) if len(dense.constant) else (0, 0), dtype)
    rhs, columns, row = (np.empty(size, kind) for kind in (dtype, np.uint64, dtype))
    return System(matrix, matrix.ravel(), rhs, columns, row)


def allocate(plan, extra, python, state, recorded):
    """Return room for a march that records so many blocks; see `kernel.march`."""
    problem, tables, dense = plan.problem, plan.tables, plan.dense
    compensated = plan.schedule.compensated
    n, m, dtype = state.fields.shape[1], len(state.multipliers), state.fields.dtype
    rows, of_g = len(tables.row_weights), len(problem.g_rows)
    lengths = [len(problem.x_rows), len(problem.y_rows), of_g]
    if extra is not None:
        lengths += [3 * len(extra.rows) * of_g, len(extra.projector_rows), len(extra.first)]
    sources = np.zeros(sum(lengths), dtype)
    x, y, g, *own = np.split(sources, np.cumsum(lengths)[:-1])
    values = Evaluated(np.empty(n, dtype), np.empty(m, dtype), x, y, g)
    constraints, work = values.phi.reshape(1, m), None
    if extra is not None:
        constraints = np.empty((len(extra.rows), m), dtype)
        work = Enforcing(
            rate=np.zeros(m, dtype),
            curvature=np.zeros(m, dtype),
            r=np.zeros(of_g, dtype),
            r_old=np.zeros(of_g, dtype),
            q=np.zeros(of_g, dtype),
            psi=np.zeros(m, dtype),
            tangents=own[0].reshape(len(extra.rows), 3, of_g),
            eta=np.zeros(m, dtype),
            directions=own[1],
            moved=np.zeros(n),
            push=np.zeros(n, dtype),
            shifted=np.empty(m, dtype),
            now=np.zeros(recorded),
            last=np.zeros(recorded),
            done=np.zeros(recorded, np.int64),
            saddle=_system(n + m if extra.level > 0 else 0, dense, dtype),
        )
    return Room(
        sources,
        values,
        constraints,
        Iterate(
            compensated=compensated,
            moving=np.empty((3, n), dtype) if compensated else state.fields[:3],
            h=plan.sizes.h,
            shift=np.empty(n, dtype),
            g_old=np.empty(of_g, dtype),
        ),
        History(np.empty((3, n), dtype), np.empty(n, dtype), np.empty((rows, n), dtype)),
        # As many multipliers as rows of constraints.
        _system(len(tables.kept) * n + (len(tables.left) - 1 - rows) * m, dense, dtype),
        np.empty_like(state.past),
        np.empty_like(state.fields),
        np.empty_like(state.multipliers),
        work,
        python,
    )
