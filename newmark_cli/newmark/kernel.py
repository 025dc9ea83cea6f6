"""The compiled Newton march: every form, scaling and integrator in one loop.

Everything that tells one form, scaling or integrator from another reaches the
kernel as numbers (`march_data.StepTables`), every problem as a compiled function and
its tables (`march_data.ProblemTables`).  `_march` is the algorithm; the functions above are its
verbs, in the order in which they are needed.  In their shapes p is the number of kept fields
among (u, v, a), r of kept rows among (V, K), P of past vectors, k of rows of constraints, and
N = p n + m.

All of it is compiled without counting references: what the march overwrites is allocated in
Python, before it.  With counting, a call that is handed tuples of arrays takes longer than an
iteration on a small mechanism.  Measure a change with `benchmarks/kernel.py`.
"""

import threading
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, typeof, types
from numba.extending import intrinsic

from newmark_cli.newmark.march_data import (
    BY_CORRECTION,
    BY_FIELD,
    BY_RESIDUAL,
    BY_ROUNDING,
    COMPLETED,
    DIVERGED,
    MOST_POSITIONS,
    PIVOTING,
    RAISED,
    SINGULAR,
    UNSOLVED,
)
from newmark_cli.support.cached_code import cached_njit, part_njit
from newmark_cli.support.machine_code import generate_call

#: A function by itself, one that only the march calls, and one that is compiled as if it stood
#: in its caller.  Without fastmath: compiled and interpreted, the march gives the same bits.
_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "_nrt": False}
_compile, _part = cached_njit(**_OPTIONS), part_njit(**_OPTIONS)
_inline = cached_njit(**_OPTIONS, inline="always")


def _types_of_problem(dtype, results):
    """Numba type of a problem's function in the arithmetic of a dtype, with so many results."""
    scalar = from_dtype(dtype)
    vector, table = scalar[::1], scalar[:, ::1]
    given = scalar, vector, vector, vector, types.int64[:, ::1], table
    return types.FunctionType(types.void(*given, *[vector] * results))


def evaluate_type(dtype):
    """Numba type of a problem's function in the arithmetic of a dtype."""
    return _types_of_problem(dtype, 5)


def derivatives_type(dtype):
    """Numba type of a problem's derivatives of constraints in the arithmetic of a dtype."""
    return _types_of_problem(dtype, 4)


def solve_type(dtype):
    """Numba type of what solves the linear system, in the arithmetic of a dtype.

    It is handed the sources (E,), the entries of X, Y and G, the right-hand side (N,),
    which it overwrites with the solution, and the arrays of `march_data.MatrixTables`.
    It returns COMPLETED, or PIVOTING where it leaves the system to another.
    """
    scalar = from_dtype(dtype)
    vector = scalar[::1]
    return types.FunctionType(
        types.int64(
            vector, vector, vector, types.uint32[::1], types.uint32[::1], vector,
            types.uint32[::1], types.uint64[::1], vector,
        )
    )  # fmt: skip


class _Iterate(NamedTuple):
    """What Newton iterates on: the fields, or their increments over the step."""

    compensated: bool  #: whether it is the increments; only they need shift and g_old
    moving: np.ndarray  #: (3, n) u, v, a, the memory of the state; compensated: w, ν, a
    h: np.ndarray  #: (1,) step size (s)
    shift: np.ndarray  #: (n,) Δ = h v_n + w
    g_old: np.ndarray  #: entries of G at the beginning of the step


class _Values(NamedTuple):
    """The problem at the iterate; see `newmark_cli.problems.problem.Values`."""

    force: np.ndarray  #: (n,) f + Gλ
    phi: np.ndarray  #: (m,) Φ
    x: np.ndarray  #: entries of X
    y: np.ndarray  #: entries of Y
    g: np.ndarray  #: entries of G


class _History(NamedTuple):
    """What the past adds to the equations of one step."""

    fields: np.ndarray  #: (3, n) to u, v, a; not set of those that are kept
    dynamics: np.ndarray  #: (n,) to row D
    rows: np.ndarray  #: (r, n) to rows V, K


class _System(NamedTuple):
    """A dense linear system, (0, 0) where Python solves it."""

    matrix: np.ndarray  #: (N, N) until it is solved
    entries: np.ndarray  #: (N²,) the same memory as one vector
    rhs: np.ndarray  #: (N,) overwritten with the solution
    columns: np.ndarray  #: (N,) the solver's work space
    row: np.ndarray  #: (N,) likewise


class _Constraining(NamedTuple):
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
    saddle: _System  #: (n + m) of a projection


# -- before the first step ------------------------------------------------------------------


class _Room(NamedTuple):
    """What a march overwrites in every step."""

    #: entries of X, Y and G, those of the values; of a formulation then its own, see `assembly`
    sources: np.ndarray
    values: _Values
    constraints: np.ndarray  #: (k, m) rows of constraints; of index 3 the memory of Φ
    iterate: _Iterate
    history: _History
    system: _System
    new_past: np.ndarray  #: (P, n) what the past vectors become
    last_fields: np.ndarray  #: (4, n) u, v, a, v' before a correction that is tested by field
    last_multipliers: np.ndarray  #: (m,) λ likewise
    work: Any  #: `_Constraining`; None for index 3


def _system(size, dense, dtype):
    """Return room for a linear system."""
    matrix = np.empty((size, size) if len(dense.constant) else (0, 0), dtype)
    rhs, columns, row = (np.empty(size, kind) for kind in (dtype, np.uint64, dtype))
    return _System(matrix, matrix.ravel(), rhs, columns, row)


def _allocate(problem, tables, dense, extra, state, schedule, sizes, recorded):
    """Return room for a march that records so many blocks."""
    n, m, dtype = state.fields.shape[1], len(state.multipliers), state.fields.dtype
    rows, of_g = len(tables.row_weights), len(problem.g_rows)
    lengths = [len(problem.x_rows), len(problem.y_rows), of_g]
    if extra is not None:
        lengths += [3 * len(extra.rows) * of_g, len(extra.projector_rows), len(extra.first)]
    sources = np.zeros(sum(lengths), dtype)
    x, y, g, *own = np.split(sources, np.cumsum(lengths)[:-1])
    values = _Values(np.empty(n, dtype), np.empty(m, dtype), x, y, g)
    constraints, work = values.phi.reshape(1, m), None
    if extra is not None:
        constraints = np.empty((len(extra.rows), m), dtype)
        work = _Constraining(
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
    return _Room(
        sources,
        values,
        constraints,
        _Iterate(
            compensated=schedule.compensated,
            moving=np.empty((3, n), dtype) if schedule.compensated else state.fields[:3],
            h=sizes.h,
            shift=np.empty(n, dtype),
            g_old=np.empty(of_g, dtype),
        ),
        _History(np.empty((3, n), dtype), np.empty(n, dtype), np.empty((rows, n), dtype)),
        # As many multipliers as rows of constraints.
        _system(len(tables.kept) * n + (len(tables.left) - 1 - rows) * m, dense, dtype),
        np.empty_like(state.past),
        np.empty_like(state.fields),
        np.empty_like(state.multipliers),
        work,
    )


# -- at the beginning of a step -------------------------------------------------------------


@_part
def _change_size(sizes, s, state, new_past):
    """Take the numbers of the size of a step, and carry the past over to it."""
    for k in range(sizes.numbers.shape[0]):
        sizes.numbers[k] = sizes.rows[sizes.which[s + 1], k]
    places = state.past.shape[0]
    for q in range(places):
        for i in range(state.past.shape[1]):
            value = sizes.carried[q, places] * state.fields[3, i]
            for k in range(places):
                value += sizes.carried[q, k] * state.past[k, i]
            new_past[q, i] = value
    _copy_all(new_past, state.past)


@_inline
def _collect_history(problem, tables, past, history):
    """Set what the past (P, n) adds to the fields and to rows D, V and K."""
    for f in range(3):
        if not _contains(tables.kept, f):
            for i in range(past.shape[1]):
                history.fields[f, i] = past[0, i] * tables.past_weights[f, 0]
            for q in range(1, past.shape[0]):
                weight = tables.past_weights[f, q]
                for i in range(past.shape[1]):
                    history.fields[f, i] += past[q, i] * weight
    for i in range(past.shape[1]):
        history.dynamics[i] = 0
        for r in range(history.rows.shape[0]):
            history.rows[r, i] = 0
    for q in range(past.shape[0]):
        weight = tables.dynamic_past[q]
        for e in range(problem.mass_rows.shape[0]):
            history.dynamics[problem.mass_rows[e]] += (
                problem.mass_values[e] * weight * past[q, problem.mass_columns[e]]
            )
        for r in range(history.rows.shape[0]):
            for i in range(past.shape[1]):
                history.rows[r, i] += tables.row_past[r, q] * past[q, i]


@_inline
def _predict(tables, past, moving):
    """Set u = u_n + h v_n, and v and a to what the update relations give with it."""
    for f in range(3):
        for i in range(past.shape[1]):
            moving[f, i] = past[0, i] * tables.predictor[f, 0]
        for q in range(1, past.shape[0]):
            weight = tables.predictor[f, q]
            if weight != 0:
                for i in range(past.shape[1]):
                    moving[f, i] += past[q, i] * weight


@_inline
def _take_increments(iterate, state):
    """Compensated: set Δ = h v_n + w, and u, v and a to where the increments lead."""
    if iterate.compensated:
        for i in range(state.fields.shape[1]):
            iterate.shift[i] = iterate.h[0] * state.past[1, i] + (
                iterate.h[0] * state.lows[1, i] + iterate.moving[0, i]
            )
            state.fields[0, i] = state.past[0, i] + (state.lows[0, i] + iterate.shift[i])
            state.fields[1, i] = state.past[1, i] + (state.lows[1, i] + iterate.moving[1, i])
            state.fields[2, i] = iterate.moving[2, i]


# -- in every correction --------------------------------------------------------------------


@_inline
def _increase_phi(phi_old, g_old, g_new, rows, columns, shift, phi):
    """Φ = Φ_n + G(u_n + Δ/2)ᵀ Δ; G is affine in u, so its value midway is the mean."""
    half = phi.dtype.type(0.5)
    for k in range(phi.shape[0]):
        phi[k] = phi_old[k]
    for e in range(g_new.shape[0]):
        phi[columns[e]] += half * (g_old[e] + g_new[e]) * shift[rows[e]]


@_inline
def _assemble_residual(problem, tables, history, moving, force, rhs):
    """Set row blocks D and the kept ones of V and K of −D_L b."""
    n, p, extra = moving.shape[1], tables.kept.shape[0], tables.row_weights.shape[0]
    for i in range(n):
        rhs[i] = force[i] - history.dynamics[i]
    for k in range(p):
        weight = tables.dynamic_weights[k]
        if weight != 0:
            source = tables.kept[k]
            for e in range(problem.mass_rows.shape[0]):
                rhs[problem.mass_rows[e]] -= (
                    problem.mass_values[e] * weight * moving[source, problem.mass_columns[e]]
                )
    for i in range(n):
        rhs[i] *= tables.left[0]
    for r in range(extra):
        for i in range(n):
            residual = history.rows[r, i]
            for k in range(p):
                residual += tables.row_weights[r, k] * moving[tables.kept[k], i]
            rhs[(1 + r) * n + i] = -tables.left[1 + r] * residual


@_inline
def _append_constraints(tables, row, values, rhs):
    """Set a row of constraints of −D_L b from its values (m,)."""
    first = (
        rhs.shape[0]
        - (tables.left.shape[0] - 1 - tables.row_weights.shape[0] - row) * (values.shape[0])
    )
    factor = -tables.left[1 + tables.row_weights.shape[0] + row]
    for k in range(values.shape[0]):
        rhs[first + k] = factor * values[k]


@_inline
def _evaluate(evaluate, t, multipliers, problem, iterate, state, values):
    """Evaluate the problem at the iterate; compensated: Φ by its increment."""
    evaluate(
        t, state.fields[0], state.fields[1], multipliers, problem.ints, problem.reals,
        values.force, values.phi, values.x, values.y, values.g,
    )  # fmt: skip
    if iterate.compensated:
        _increase_phi(
            state.phi, iterate.g_old, values.g, problem.g_rows, problem.g_columns,
            iterate.shift, values.phi,
        )  # fmt: skip


@_inline
def _evaluate_past(evaluate, t, problem, state, values, g_old):
    """Evaluate the problem at the beginning of a step, for G there."""
    evaluate(
        t, state.past[0], state.past[1], state.multipliers, problem.ints, problem.reals,
        values.force, values.phi, values.x, values.y, g_old,
    )  # fmt: skip


@_inline
def _assemble(sources, dense, entries):
    """Set the entries of D_L J D_R: constants, and coefficients times sources."""
    for e in range(dense.constant.shape[0]):
        entries[e] = dense.constant[e]
    for e in range(dense.places.shape[0]):
        entries[dense.places[e]] += dense.coefficients[e] * sources[dense.origins[e]]


@_compile
def solve_in_place(matrix, rhs, columns, values):
    """Overwrite ``rhs`` with the solution of ``matrix`` x = ``rhs``.

    Gaussian elimination with partial pivoting (Golub & Van Loan, §3.4).  Zeros
    of the pivot row and of the pivot column are skipped: Jacobians of mechanisms
    have many, and fill in slowly.

    Args:
        matrix: (N, N) overwritten with its elimination.
        rhs: (N,) overwritten.
        columns, values: (N,) work space, columns unsigned.

    Returns:
        False when a pivot is zero or not a number.
    """
    size = rhs.shape[0]
    one = rhs.dtype.type(1)
    for k in range(size):
        pivot, largest = k, abs(matrix[k, k])
        for i in range(k + 1, size):
            candidate = abs(matrix[i, k])
            if candidate > largest:
                pivot, largest = i, candidate
        if not largest > 0:
            return False
        count = 0
        for j in range(k, size):
            value = matrix[pivot, j]
            matrix[pivot, j] = matrix[k, j]
            matrix[k, j] = value
            if value != 0:
                columns[count], values[count] = j, value
                count += 1
        of_pivot = rhs[pivot]
        rhs[pivot] = rhs[k]
        rhs[k] = of_pivot
        reciprocal = one / matrix[k, k]
        for i in range(k + 1, size):
            factor = matrix[i, k]
            if factor != 0:
                factor *= reciprocal
                for c in range(1, count):
                    matrix[i, columns[c]] -= factor * values[c]
                rhs[i] -= factor * of_pivot
        matrix[k, k] = reciprocal
    for k in range(size - 1, -1, -1):
        # By columns: the updates of one column do not wait for each other.
        solved = rhs[k] * matrix[k, k]
        rhs[k] = solved
        for i in range(k):
            rhs[i] -= matrix[i, k] * solved
    return True


@intrinsic
def _call_python(typing, address):
    """Call a Python function; how what it does ended."""
    return types.int64(address), generate_call


@_inline
def _solve_pivoting(python, system):
    """Solve a dense system, or have it solved in Python."""
    if system.matrix.shape[0] == 0:
        return _call_python(python.addresses[0])  # type: ignore[call-arg]
    if solve_in_place(system.matrix, system.rhs, system.columns, system.row):
        return np.int64(COMPLETED)
    # What is not a number is no pivot either.
    return np.int64(SINGULAR if np.isfinite(_square(system.rhs)) else DIVERGED)


@_inline
def _take_norms(tables, correction, n, m, rows, norms):
    """Set the 2-norms of the blocks of a correction (N,), of fields and of rows of constraints.

    Returns:
        The square of its displacement part, in physical units.
    """
    p, displacement_square = tables.kept.shape[0], 0.0
    for k in range(p):
        block = 0.0
        for i in range(k * n, (k + 1) * n):
            block += np.float64(correction[i]) * correction[i]
        norms[k] = np.sqrt(block)
        to_displacement = np.float64(tables.weights[0, k]) * tables.right[k]
        displacement_square += to_displacement * to_displacement * block
    for row in range(rows):
        block = 0.0
        for i in range(p * n + row * m, p * n + (row + 1) * m):
            block += np.float64(correction[i]) * correction[i]
        norms[p + row] = np.sqrt(block)
    return displacement_square


@_inline
def _correct(tables, correction, moving, multipliers):
    """Apply a correction to the kept fields and to λ, where that is an unknown."""
    n, p = moving.shape[1], tables.kept.shape[0]
    for k in range(p):
        field = tables.kept[k]
        for i in range(n):
            moving[field, i] += tables.right[k] * correction[k * n + i]
    if correction.shape[0] > p * n:
        for i in range(multipliers.shape[0]):
            multipliers[i] += tables.right[p] * correction[p * n + i]


@_inline
def _recover(tables, history, past, moving, first, last):
    """Evaluate the eliminated fields from the first to the last afresh from the kept ones."""
    kept, weights = tables.kept, tables.weights
    for f in range(first, last + 1):
        if not _contains(kept, f):
            for i in range(moving.shape[1]):
                value = history.fields[f, i]
                for k in range(kept.shape[0]):
                    weight = weights[f, k]
                    if weight != 0:
                        change = moving[kept[k], i]
                        if tables.differenced[f] != 0:
                            change -= past[kept[k], i]
                        value += weight * change
                moving[f, i] = value


@_inline
def _contains(numbers, wanted):
    """Whether a short array has a number."""
    for number in numbers:  # noqa: SIM110, numba compiles no any() of a generator
        if number == wanted:
            return True
    return False


@_inline
def _square(vector):
    """‖vector‖² in double precision: squares of small single numbers would vanish."""
    square = 0.0
    for i in range(vector.shape[0]):
        square += np.float64(vector[i]) * vector[i]
    return square


@_inline
def _is_small(tables, schedule, state, room, norm, displacement_square):
    """Whether a correction is in the terminal phase, or meets the test."""
    if schedule.test == BY_ROUNDING:
        return displacement_square < _threshold(schedule, state.fields) or norm == 0
    return _passes(tables, schedule, state, room.last_fields, room.last_multipliers, norm)


@_part
def _passes(tables, schedule, state, last_fields, last_multipliers, norm):
    """Whether a correction meets the test; the residual is tested after the next evaluation."""
    if schedule.test == BY_FIELD:
        passes = True
        for f in range(3):
            limits = schedule.limits[f, 0], schedule.limits[f, 1]
            passes = passes and _changed_little(limits, last_fields[f], state.fields[f])
        limits = schedule.limits[3, 0], schedule.limits[3, 1]
        return passes and _changed_little(limits, last_multipliers, state.multipliers)
    if schedule.test != BY_CORRECTION:
        return False
    limit = schedule.limits[0, 0]
    if schedule.limits[0, 1] > 0:
        limit += schedule.limits[0, 1] * _scaled_size(tables, state.fields, state.multipliers)
    return norm <= limit


@_part
def _changed_little(limits, last, now):
    """Whether the root mean square of changes over absolute + relative |now| is at most 1."""
    if limits[0] == 0 and limits[1] == 0:
        return True
    square = 0.0
    for i in range(now.shape[0]):
        if now[i] != last[i]:
            change = np.float64(now[i]) - last[i]
            square += (change / (limits[0] + limits[1] * abs(np.float64(now[i])))) ** 2
    return square <= now.shape[0]


@_part
def _look(tables, schedule, state, room, solves, first):
    """Before a correction: test the residual, or note from where the correction leads.

    Returns:
        Whether the residual meets the test, and the norm of the step's first.
    """
    if schedule.test == BY_FIELD:
        _copy_all(state.fields, room.last_fields)
        _copy(state.multipliers, room.last_multipliers)
    if schedule.test != BY_RESIDUAL:
        return 0, first
    size = _residual(tables, room.system.rhs, state.fields.shape[1], state.multipliers.shape[0])
    if solves == 0:
        return 0, size
    return int(size <= schedule.limits[0, 0] + schedule.limits[0, 1] * first), first


@_part
def _residual(tables, rhs, n, m):
    """Norm of the residual b before scaling, from −D_L b."""
    of_motion = 1 + tables.row_weights.shape[0]
    square = 0.0
    for i in range(rhs.shape[0]):
        row = i // n if i < of_motion * n else of_motion + (i - of_motion * n) // m
        value = np.float64(rhs[i]) / tables.left[row]
        square += value * value
    return np.sqrt(square)


@_inline
def _threshold(schedule, fields):
    """Square of the largest correction of u in the terminal phase."""
    return schedule.settled_below * schedule.settled_below * _square(fields[0])


@_inline
def _scaled_size(tables, fields, multipliers):
    """Norm of the unknowns as the solver sees them."""
    kept, right, square = tables.kept, tables.right, 0.0
    for k in range(kept.shape[0]):
        for i in range(fields.shape[1]):
            square += (np.float64(fields[kept[k], i]) / right[k]) ** 2
    for i in range(multipliers.shape[0]):
        square += (np.float64(multipliers[i]) / right[kept.shape[0]]) ** 2
    return np.sqrt(square)


@_inline
def _copy(source, target):
    """Copy a vector; what an assignment as a whole can raise takes seconds to compile."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@_inline
def _copy_all(source, target):
    """Copy a matrix."""
    for k in range(source.shape[0]):
        for i in range(source.shape[1]):
            target[k, i] = source[k, i]


# -- formulations beside index 3 ------------------------------------------------------------


@_part
def _differentiate(derive, t, problem, iterate, state, values, work):
    """Differentiate the constraints at the iterate, and set Ψ."""
    fields = state.fields
    derive(
        t, fields[0], fields[1], fields[3], problem.ints, problem.reals, work.rate,
        work.curvature, work.r, work.q,
    )  # fmt: skip
    _rate_of_constraints(problem, iterate, state, values, work)


@_part
def _set_directions(extra, g, work):
    """Set η = 0 and P from the entries of G at the beginning of the step."""
    work.eta[:] = 0
    work.push[:] = 0
    for e in range(work.directions.shape[0]):
        work.directions[e] = extra.projector_values[e] * g[extra.projector_sources[e]]


@_part
def _rate_of_constraints(problem, iterate, state, values, work):
    """Set Ψ = Gᵀv + Φ_t; compensated: Ψ_n + ½(G_n + G)ᵀν + ½(R_n + R)Δ."""
    half = values.phi.dtype.type(0.5)
    for k in range(work.psi.shape[0]):
        work.psi[k] = state.psi[k] if iterate.compensated else work.rate[k]
    for e in range(values.g.shape[0]):
        k, i = problem.g_columns[e], problem.g_rows[e]
        if iterate.compensated:
            mean_g = half * (iterate.g_old[e] + values.g[e])
            mean_r = half * (work.r_old[e] + work.r[e])
            work.psi[k] += mean_g * iterate.moving[1, i] + mean_r * iterate.shift[i]
        else:
            work.psi[k] += values.g[e] * state.fields[1, i]


@_part
def _assemble_constraints(problem, extra, state, values, rows, work):
    """Set the rows of constraints (k, m) and their tangents to u, v and a."""
    two = values.phi.dtype.type(2)
    for row in range(extra.rows.shape[0]):
        s0, s1, s2 = extra.rows[row, 0], extra.rows[row, 1], extra.rows[row, 2]
        for k in range(values.phi.shape[0]):
            value = s0 * values.phi[k]
            if s1 != 0:
                value += s1 * work.psi[k]
            if s2 != 0:
                value += s2 * work.curvature[k]
            rows[row, k] = value
        for e in range(values.g.shape[0]):
            g, r, q = values.g[e], work.r[e], work.q[e]
            if s2 != 0:
                acceleration = state.fields[3, problem.g_rows[e]]
                rows[row, problem.g_columns[e]] += s2 * (g * acceleration)
            work.tangents[row, 0, e] = s0 * g + s1 * r + s2 * q
            work.tangents[row, 1, e] = s1 * g + two * s2 * r
            work.tangents[row, 2, e] = s2 * extra.inertia * g


@_part
def _push_residual(problem, tables, extra, n, work, rhs):
    """Add Pη to rows D, V and K of −D_L b."""
    inertia = extra.inertia * extra.eta[2]
    for e in range(problem.mass_rows.shape[0]):
        pushed = problem.mass_values[e] * inertia * work.push[problem.mass_columns[e]]
        rhs[problem.mass_rows[e]] -= tables.left[0] * pushed
    for r in range(tables.row_weights.shape[0]):
        for i in range(n):
            rhs[(1 + r) * n + i] -= tables.left[1 + r] * extra.rows_eta[r] * work.push[i]


@_part
def _multiply(extra, sources):
    """Set the sources that are products of two others, behind all others."""
    begin = sources.shape[0] - extra.first.shape[0]
    for e in range(extra.first.shape[0]):
        sources[begin + e] = sources[extra.first[e]] * sources[extra.second[e]]


@_part
def _evaluate_formulated(evaluate, derive, t, problem, tables, extra, state, room, solves):
    """Evaluate the problem and the rows of constraints at the iterate, and set −D_L b."""
    multipliers, iterate, values, work = state.multipliers, room.iterate, room.values, room.work
    if extra.penalty[0] == 0 or solves == 0:
        _evaluate(evaluate, t, multipliers, problem, iterate, state, values)
    if extra.penalty[0] > 0:
        # Φ is that at the iterate, from here or from the last update of λ.
        for k in range(multipliers.shape[0]):
            work.shifted[k] = multipliers[k] - extra.penalty[0] * values.phi[k]
        _evaluate(evaluate, t, work.shifted, problem, iterate, state, values)
    if extra.differentiated != 0:
        _form_acceleration(tables, state)
        _differentiate(derive, t, problem, iterate, state, values, work)
    _assemble_constraints(problem, extra, state, values, room.constraints, work)
    rhs = room.system.rhs
    _assemble_residual(problem, tables, room.history, iterate.moving, values.force, rhs)
    for row in range(extra.rows.shape[0]):
        _append_constraints(tables, row, room.constraints[row], rhs)
    if extra.stabilised != 0:
        _push_residual(problem, tables, extra, iterate.moving.shape[1], work, rhs)


@_part
def _take_eliminated_norms(tables, extra, correction, n, m, work):
    """Set the norms of what a correction changes in eliminated fields, with η."""
    p = tables.kept.shape[0]
    first_eta, place = p * n + m, p + extra.rows.shape[0]
    work.moved[:] = 0
    for e in range(work.directions.shape[0]):
        scaled = np.float64(correction[first_eta + extra.projector_columns[e]])
        moved = work.directions[e] * tables.right[p + 1] * scaled
        work.moved[extra.projector_rows[e]] += moved
    for f in range(3):
        if not _contains(tables.kept, f):
            block = 0.0
            for i in range(n):
                change = extra.eta[f] * work.moved[i]
                for k in range(p):
                    scaled = np.float64(correction[k * n + i])
                    change += tables.weights[f, k] * tables.right[k] * scaled
                block += change * change
            work.now[place] = np.sqrt(block)
            place += 1


@_part
def _apply(tables, extra, state, room):
    """Apply a correction to the kept fields, λ and η, and recover the other fields."""
    correction, iterate, work = room.system.rhs, room.iterate, room.work
    moving, multipliers = iterate.moving, state.multipliers
    n, m, p = moving.shape[1], multipliers.shape[0], tables.kept.shape[0]
    _correct(tables, correction, moving, multipliers)
    if extra.stabilised != 0:
        for k in range(m):
            work.eta[k] += tables.right[p + 1] * correction[p * n + m + k]
        work.push[:] = 0
        for e in range(work.directions.shape[0]):
            pushed = work.directions[e] * work.eta[extra.projector_columns[e]]
            work.push[extra.projector_rows[e]] += pushed
    _recover(tables, room.history, state.past, moving, 0, 2)
    for f in range(3):
        if extra.eta[f] != 0 and not _contains(tables.kept, f):
            for i in range(n):
                moving[f, i] += extra.eta[f] * work.push[i]
    _take_increments(iterate, state)


@_part
def _update_by_penalty(tables, extra, multipliers, phi, work):
    """Update λ by −pΦ; returns the square of that, in scaled unknowns."""
    p, square = tables.kept.shape[0], 0.0
    for k in range(phi.shape[0]):
        update = -extra.penalty[0] * phi[k]
        multipliers[k] += update
        square += (np.float64(update) / tables.right[p]) ** 2
    work.now[p] = np.sqrt(square)
    return square


@_part
def _record_decreasing(work, norms, s, settled):
    """Record the blocks that still decrease; True when none does any more.

    Far from the solution all are recorded.
    """
    all_done = True
    for b in range(work.now.shape[0]):
        if settled < 2:
            work.done[b] = 0
        elif work.now[b] >= work.last[b]:
            work.done[b] = 1
        if work.done[b] == 0:
            all_done = False
            norms[s, b] = work.now[b]
        work.last[b] = work.now[b]
    return all_done


@_part
def _project(problem, extra, python, values, forced, misfit, work):
    """Solve [[M, −G], [Gᵀ, 0]] x = (f + Gλ, −misfit), or with zeros in place of f + Gλ."""
    g, saddle, n = values.g, work.saddle, values.force.shape[0]
    for i in range(n):
        saddle.rhs[i] = values.force[i] if forced else 0
    for k in range(misfit.shape[0]):
        saddle.rhs[n + k] = -misfit[k]
    if saddle.matrix.shape[0] == 0:
        return _call_python(python.addresses[1]) == COMPLETED  # type: ignore[call-arg]
    saddle.matrix[:] = 0
    for e in range(problem.mass_rows.shape[0]):
        i, j = problem.mass_rows[e], problem.mass_columns[e]
        saddle.matrix[i, j] += problem.mass_values[e] / extra.unit
    for e in range(g.shape[0]):
        i, k = problem.g_rows[e], n + problem.g_columns[e]
        saddle.matrix[i, k] -= g[e]
        saddle.matrix[k, i] += g[e]
    for i in range(n):
        saddle.rhs[i] /= extra.unit
    solved = solve_in_place(saddle.matrix, saddle.rhs, saddle.columns, saddle.row)
    for k in range(misfit.shape[0]):
        saddle.rhs[n + k] *= extra.unit
    return solved


@_part
def _move(field, iterate, state, change):
    """Move a field by what was projected; returns the square of that."""
    square = 0.0
    for i in range(state.fields.shape[1]):
        iterate.moving[field, i] += change[i]
        square += np.float64(change[i]) * change[i]
    _take_increments(iterate, state)
    return square


# -- at the end of a step -------------------------------------------------------------------


@_inline
def _form_acceleration(tables, state):
    """Set the true acceleration v' from the new a and the past."""
    for i in range(state.fields.shape[1]):
        value = tables.acceleration[0] * state.fields[2, i]
        for q in range(state.past.shape[0]):
            value += tables.acceleration[1 + q] * state.past[q, i]
        state.fields[3, i] = value


@_part
def _finish(
    evaluate, derive, t, problem, tables, extra, python, schedule, state, room, positions, s
):
    """Project positions, velocities and accelerations, set v'; False where it cannot be done."""
    multipliers, iterate, values, work = state.multipliers, room.iterate, room.values, room.work
    n, change = state.fields.shape[1], work.saddle.rhs
    while extra.level > 1 and positions[s] < MOST_POSITIONS:
        positions[s] += 1
        _evaluate(evaluate, t, multipliers, problem, iterate, state, values)
        if not _project(problem, extra, python, values, False, values.phi, work):
            return False
        if not _move(0, iterate, state, change) > _threshold(schedule, state.fields):
            break  # The next one would be of the order of the square.
    if extra.level > 0:
        _evaluate(evaluate, t, multipliers, problem, iterate, state, values)
        _differentiate(derive, t, problem, iterate, state, values, work)
        if not _project(problem, extra, python, values, False, work.psi, work):
            return False
        _move(1, iterate, state, change)
        for k in range(multipliers.shape[0]):
            state.impulse[k] = change[n + k]
    _form_acceleration(tables, state)
    if extra.accelerations != 0:
        work.shifted[:] = 0
        _evaluate(evaluate, t, work.shifted, problem, iterate, state, values)
        _differentiate(derive, t, problem, iterate, state, values, work)
        if not _project(problem, extra, python, values, True, work.curvature, work):
            return False
        for i in range(n):
            change[i] -= state.fields[3, i]
            state.fields[3, i] += change[i]
        # Alike: a belongs to another time, and set to v' would cost generalized-α an order.
        _move(2, iterate, state, change)
    return True


@_inline
def _advance(tables, state, iterate, new_past):
    """Set ``new_past`` (P, n) to what the past vectors become."""
    for q in range(state.past.shape[0]):
        source = tables.advance[q]
        for i in range(state.fields.shape[1]):
            if source < 4:
                new_past[q, i] = state.fields[source, i]
            elif iterate.compensated:
                new_past[q, i] = iterate.moving[source - 4, i]
            elif source == 4:
                increment = state.fields[0, i] - state.past[0, i]
                new_past[q, i] = increment - iterate.h[0] * state.past[1, i]
            else:
                new_past[q, i] = state.fields[1, i] - state.past[1, i]


@_inline
def _carry_over(state, iterate, values, new_past):
    """Carry Φ, G and the rounding errors of u and v over to the next step."""
    for k in range(state.phi.shape[0]):
        state.phi[k] = values.phi[k]
    for e in range(values.g.shape[0]):
        iterate.g_old[e] = values.g[e]
    _add_exactly(state.past[0], state.lows[0], iterate.shift, new_past[0])
    _add_exactly(state.past[1], state.lows[1], iterate.moving[1], new_past[1])


@_inline
def _add_exactly(high, low, increment, total):
    """High + low + increment as a rounded sum and its rounding error (Knuth's two-sum)."""
    for i in range(high.shape[0]):
        added = low[i] + increment[i]
        total[i] = high[i] + added
        of_added = total[i] - high[i]
        low[i] = (high[i] - (total[i] - of_added)) + (added - of_added)


@_inline
def _keep(state, record, place, s):
    """Copy the state to one place of the record if that is for step s; 1 if it is, else 0."""
    if place >= record.steps.shape[0] or record.steps[place] != s:
        return 0
    for field in range(state.fields.shape[0]):
        for i in range(state.fields.shape[1]):
            record.fields[place, field, i] = state.fields[field, i]
    for k in range(state.multipliers.shape[0]):
        record.multipliers[place, k] = state.multipliers[k]
    return 1


# -- the march ------------------------------------------------------------------------------


def _march(
    evaluate, derive, solve, problem, tables, static, dense, extra, python, state, schedule, sizes,
    counts, record, room,
):  # fmt: skip
    """The march as numba compiles it, with or without a formulation; see `march`.

    Index 3 has no ``extra``, and a formulation no ``solve``: numba drops what a comparison of an
    argument that is None excludes.
    """
    fields, past, multipliers = state.fields, state.past, state.multipliers
    number, compensated = fields.dtype.type, schedule.compensated
    n, m, to_tolerance = fields.shape[1], multipliers.shape[0], schedule.test != BY_ROUNDING
    values, iterate, history, system = room.values, room.iterate, room.history, room.system
    moving, rhs, work = iterate.moving, system.rhs, room.work
    norms, iterations, positions, pivoted = counts
    kept = given_up = 0
    if compensated:
        t = number(sizes.times[0])
        _evaluate_past(evaluate, t, problem, state, values, iterate.g_old)
        if extra is not None and (extra.differentiated != 0 or extra.level > 0):
            derive(
                t, past[0], past[1], fields[3], problem.ints, problem.reals, work.rate,
                work.curvature, work.r_old, work.q,
            )  # fmt: skip

    for s in range(norms.shape[0]):
        t = number(sizes.times[s + 1])
        python.step[0] = s
        if sizes.which[s + 1] != sizes.which[s]:
            _change_size(sizes, s, state, room.new_past)
        _collect_history(problem, tables, past, history)
        if extra is not None and extra.stabilised != 0:
            if not compensated:
                begin = number(sizes.times[s])
                _evaluate_past(evaluate, begin, problem, state, values, iterate.g_old)
            _set_directions(extra, iterate.g_old, work)
        _predict(tables, past, moving)
        _take_increments(iterate, state)
        previous, first, solves = np.inf, 0.0, np.int64(0)  # a literal: `_look` twice
        settled = 0  # corrections in a row that are in the terminal phase
        while solves < schedule.cap:
            if solve is not None:
                _evaluate(evaluate, t, multipliers, problem, iterate, state, values)
                _assemble_residual(problem, tables, history, moving, values.force, rhs)
                _append_constraints(tables, 0, values.phi, rhs)
            if extra is not None:
                _evaluate_formulated(
                    evaluate, derive, t, problem, tables, extra, state, room, solves
                )
            if python.raised[0] != 0:
                return RAISED, s
            if to_tolerance:
                settled, first = _look(tables, schedule, state, room, solves, first)
                if settled:
                    break
            ending = UNSOLVED
            if solve is not None:
                if static.structure.shape[0] > 0:
                    ending = solve(
                        room.sources, rhs, static.constant, static.places, static.origins,
                        static.coefficients, static.structure, static.room, static.work,
                    )  # fmt: skip
                if ending == PIVOTING:
                    pivoted[s] = 1
            if ending != COMPLETED:
                if extra is not None:
                    _multiply(extra, room.sources)
                _assemble(room.sources, dense, system.entries)
                ending = _solve_pivoting(python, system)
                if ending != COMPLETED:
                    return ending, s
            solves += 1
            norm_square, displacement_square = _square(rhs), 0.0
            if extra is not None:
                displacement_square = _take_norms(tables, rhs, n, m, extra.rows.shape[0], work.now)
                if extra.stabilised != 0:
                    _take_eliminated_norms(tables, extra, rhs, n, m, work)
                if extra.penalty[0] > 0:
                    # λ follows from Φ after the correction.
                    _apply(tables, extra, state, room)
                    _evaluate(evaluate, t, multipliers, problem, iterate, state, values)
                    norm_square += _update_by_penalty(tables, extra, multipliers, values.phi, work)
            norm = np.sqrt(norm_square)
            if not np.isfinite(norm):
                return DIVERGED, s
            if solve is not None:
                if settled >= 2 and norm >= previous and not to_tolerance:
                    break
                previous = norm
                displacement_square = _take_norms(tables, rhs, n, m, 1, norms[s])
                _correct(tables, rhs, moving, multipliers)
                # Nothing but the end of the step needs a.
                last = 2 if schedule.test == BY_FIELD else 1
                _recover(tables, history, past, moving, 0, last)
                _take_increments(iterate, state)
            if extra is not None:
                if _record_decreasing(work, norms, s, 0 if to_tolerance else settled):
                    break
                if extra.penalty[0] == 0:
                    _apply(tables, extra, state, room)
            small = _is_small(tables, schedule, state, room, norm, displacement_square)
            settled = settled + 1 if small else 0
            if small and (to_tolerance or norm == 0):
                break
        iterations[s] = solves if settled > 0 else -solves
        if solve is not None:
            _recover(tables, history, past, moving, 2, 2)
            _take_increments(iterate, state)
            _form_acceleration(tables, state)
        if extra is not None and not _finish(
            evaluate, derive, t, problem, tables, extra, python, schedule, state, room, positions,
            s,
        ):  # fmt: skip
            return SINGULAR, s
        _advance(tables, state, iterate, room.new_past)
        if compensated:
            # G, Φ and Φ' at the end of the step, whatever was applied last.
            _evaluate(evaluate, t, multipliers, problem, iterate, state, values)
            if extra is not None and (extra.differentiated != 0 or extra.level > 0):
                _differentiate(derive, t, problem, iterate, state, values, work)
                _copy(work.psi, state.psi)
                _copy(work.r, work.r_old)
            _carry_over(state, iterate, values, room.new_past)
        _copy_all(room.new_past, past)
        taken = _keep(state, record, kept, s)
        if extra is not None and taken != 0 and extra.total != 0:
            for k in range(m):
                record.multipliers[kept, k] += state.impulse[k] / extra.acting[0]
        kept += taken
        given_up += pivoted[s]
        if given_up >= schedule.patience:
            return COMPLETED, s + 1
    return COMPLETED, norms.shape[0]


_compiling = threading.Lock()
#: Type of the march's numbers, and whether there is a formulation → compiled march.
_compiled: dict = {}


def is_compiled(dtype, formulated):
    """Whether `march` is compiled, for numbers of a type, with or without a formulation."""
    return (np.dtype(dtype), formulated) in _compiled


def march(
    functions, problem, matrices, extra, python, state, schedule, sizes, counts, record
):  # fmt: skip
    """Advance ``state`` by as many steps as ``counts`` has room for.

    The function is compiled for problems' functions as such, not for particular ones, so that
    one compilation, kept on disk, serves all.

    Args:
        functions: Compiled: the problem's, of :func:`evaluate_type`; the derivatives of its
            constraints, of :func:`derivatives_type`, None for index 3; static elimination, of
            :func:`solve_type`.
        problem: The problem's tables and those of the step, whose numbers have the march's type.
        matrices: What static elimination is handed, without ``structure`` where there is none;
            and the dense matrix of what is solved with partial pivoting, empty where Python
            solves.
        extra: `newmark_cli.newmark.constraints.FormulationTables`; None for index 3.
        python: `newmark_cli.newmark.callbacks.Callbacks`.
        state, counts, record: Overwritten; see the classes.
        schedule: When Newton's iteration ends.
        sizes: When the steps are, and what depends on their sizes.

    Returns:
        How the march ended (COMPLETED, SINGULAR, DIVERGED, STAGNATED) and the steps done.
    """
    (evaluate, derive, solve), (static, dense) = functions, matrices
    dtype, formulated, recorded = state.fields.dtype, extra is not None, counts.norms.shape[1]
    of_problem, of_step = problem
    room = _allocate(of_problem, of_step, dense, extra, state, schedule, sizes, recorded)
    given = evaluate, *((derive, None) if formulated else (None, solve))
    numbers = (
        *problem, static, dense, extra, python.calls, state, schedule, sizes, counts, record, room
    )  # fmt: skip
    with _compiling:
        if (dtype, formulated) not in _compiled:
            kinds = (
                evaluate_type(dtype),
                derivatives_type(dtype) if formulated else types.none,
                types.none if formulated else solve_type(dtype),
            )
            compiled = _compile(_march)
            compiled.compile((*kinds, *(typeof(number) for number in numbers)))
            # A call with a jitted function would otherwise be compiled anew for that
            # one function, in every process.
            compiled.disable_compile()
            _compiled[dtype, formulated] = compiled
    with python.served(state, room):
        return _compiled[dtype, formulated](*given, *numbers)
