"""Verbs of Newton's iteration: predict, evaluate, assemble, solve, correct, test.

They are compiled without counting references: what a march overwrites is allocated in Python,
before it (`room`).  With counting, a call that is handed tuples of arrays takes longer than an
iteration on a small mechanism.
"""

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from newmark_cli.newmark.march_data import (
    BY_CORRECTION,
    BY_FIELD,
    BY_RESIDUAL,
    BY_ROUNDING,
    COMPLETED,
    DIVERGED,
    SINGULAR,
)
from newmark_cli.support.cached_code import cached_njit, part_njit
from newmark_cli.support.machine_code import generate_call

#: A function by itself, one that only the march calls, and one that is compiled as if it stood
#: in its caller.  Without fastmath: compiled and interpreted, the march gives the same bits.
_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "_nrt": False}
compiled_alone, compiled_part = cached_njit(**_OPTIONS), part_njit(**_OPTIONS)
inlined = cached_njit(**_OPTIONS, inline="always")

# -- at the beginning of a step -------------------------------------------------------------


@compiled_part
def change_size(sizes, s, acceleration, past, new_past):
    """Take the numbers of the size of a step, and carry the past over to it."""
    for k in range(sizes.numbers.shape[0]):
        sizes.numbers[k] = sizes.rows[sizes.which[s + 1], k]
    places = past.shape[0]
    for q in range(places):
        for i in range(past.shape[1]):
            value = sizes.carried[q, places] * acceleration[i]
            for k in range(places):
                value += sizes.carried[q, k] * past[k, i]
            new_past[q, i] = value
    copy_matrix(new_past, past)


@inlined
def collect_history(problem, tables, past, history):
    """Set what the past (P, n) adds to the fields and to rows D, V and K."""
    kept, weights, row_past = tables.kept, tables.past_weights, tables.row_past
    mass_rows, mass_columns = problem.mass_rows, problem.mass_columns
    mass_values, dynamic_past = problem.mass_values, tables.dynamic_past
    fields, dynamics, rows = history.fields, history.dynamics, history.rows
    for f in range(3):
        if not contains(kept, f):
            for i in range(past.shape[1]):
                fields[f, i] = past[0, i] * weights[f, 0]
            for q in range(1, past.shape[0]):
                weight = weights[f, q]
                for i in range(past.shape[1]):
                    fields[f, i] += past[q, i] * weight
    for i in range(past.shape[1]):
        dynamics[i] = 0
        for r in range(rows.shape[0]):
            rows[r, i] = 0
    for q in range(past.shape[0]):
        weight = dynamic_past[q]
        for e in range(mass_rows.shape[0]):
            dynamics[mass_rows[e]] += mass_values[e] * weight * past[q, mass_columns[e]]
        for r in range(rows.shape[0]):
            for i in range(past.shape[1]):
                rows[r, i] += row_past[r, q] * past[q, i]


@inlined
def extrapolate(tables, past, moving):
    """Set u = u_n + h v_n, and v and a to what the update relations give with it."""
    predictor = tables.predictor
    for f in range(3):
        for i in range(past.shape[1]):
            moving[f, i] = past[0, i] * predictor[f, 0]
        for q in range(1, past.shape[0]):
            weight = predictor[f, q]
            if weight != 0:
                for i in range(past.shape[1]):
                    moving[f, i] += past[q, i] * weight


@inlined
def take_increments(iterate, state):
    """Compensated: set Δ = h v_n + w, and u, v and a to where the increments lead."""
    h, moving, shift = iterate.h, iterate.moving, iterate.shift
    past, lows, fields = state.past, state.lows, state.fields
    if iterate.compensated:
        for i in range(fields.shape[1]):
            shift[i] = h[0] * past[1, i] + (h[0] * lows[1, i] + moving[0, i])
            fields[0, i] = past[0, i] + (lows[0, i] + shift[i])
            fields[1, i] = past[1, i] + (lows[1, i] + moving[1, i])
            fields[2, i] = moving[2, i]


# -- in every correction -----------------------------------------------------------------


@inlined
def _increase_phi(phi_old, g_old, g_new, rows, columns, shift, phi):
    """Φ = Φ_n + G(u_n + Δ/2)ᵀ Δ; G is affine in u, so its value midway is the mean."""
    half = phi.dtype.type(0.5)
    for k in range(phi.shape[0]):
        phi[k] = phi_old[k]
    for e in range(g_new.shape[0]):
        phi[columns[e]] += half * (g_old[e] + g_new[e]) * shift[rows[e]]


@inlined
def evaluate_at(evaluate, t, multipliers, problem, iterate, state, values):
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


@inlined
def evaluate_past(evaluate, t, problem, state, values, g_old):
    """Evaluate the problem at the beginning of a step, for G there."""
    evaluate(
        t, state.past[0], state.past[1], state.multipliers, problem.ints, problem.reals,
        values.force, values.phi, values.x, values.y, g_old,
    )  # fmt: skip


@inlined
def assemble_residual(problem, tables, history, moving, force, rhs):
    """Set row blocks D and the kept ones of V and K of −D_L b."""
    kept, left, weights = tables.kept, tables.left, tables.dynamic_weights
    row_weights, of_rows, dynamics = tables.row_weights, history.rows, history.dynamics
    mass_rows, mass_columns = problem.mass_rows, problem.mass_columns
    mass_values = problem.mass_values
    n, p, extra = moving.shape[1], kept.shape[0], row_weights.shape[0]
    for i in range(n):
        rhs[i] = force[i] - dynamics[i]
    for k in range(p):
        weight = weights[k]
        if weight != 0:
            source = kept[k]
            for e in range(mass_rows.shape[0]):
                rhs[mass_rows[e]] -= mass_values[e] * weight * moving[source, mass_columns[e]]
    for i in range(n):
        rhs[i] *= left[0]
    for r in range(extra):
        for i in range(n):
            residual = of_rows[r, i]
            for k in range(p):
                residual += row_weights[r, k] * moving[kept[k], i]
            rhs[np.uint64((1 + r) * n + i)] = -left[1 + r] * residual


@inlined
def append_constraints(tables, row, values, rhs):
    """Set a row of constraints of −D_L b from its values (m,)."""
    first = (
        rhs.shape[0]
        - (tables.left.shape[0] - 1 - tables.row_weights.shape[0] - row) * (values.shape[0])
    )
    factor = -tables.left[1 + tables.row_weights.shape[0] + row]
    for k in range(values.shape[0]):
        rhs[np.uint64(first + k)] = factor * values[k]


@inlined
def assemble(sources, dense, entries):
    """Set the entries of D_L J D_R: constants, and coefficients times sources."""
    for e in range(dense.constant.shape[0]):
        entries[e] = dense.constant[e]
    for e in range(dense.places.shape[0]):
        entries[dense.places[e]] += dense.coefficients[e] * sources[dense.origins[e]]


@compiled_alone
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
def call_python(typing, address):
    """Call a Python function; how what it does ended."""
    return types.int64(address), generate_call


@inlined
def solve_pivoting(python, system):
    """Solve a dense system, or have it solved in Python."""
    if system.matrix.shape[0] == 0:
        return call_python(python.addresses[0])  # type: ignore[call-arg]
    if solve_in_place(system.matrix, system.rhs, system.columns, system.row):
        return np.int64(COMPLETED)
    # What is not a number is no pivot either.
    return np.int64(SINGULAR if np.isfinite(square_of(system.rhs)) else DIVERGED)


@inlined
def take_norms(tables, correction, n, m, rows, norms):
    """Set the 2-norms of the blocks of a correction (N,), of fields and of rows of constraints.

    Returns:
        The square of its displacement part, in physical units.
    """
    kept, weights, right = tables.kept, tables.weights, tables.right
    p, displacement_square = kept.shape[0], 0.0
    for k in range(p):
        block = 0.0
        for i in range(k * n, (k + 1) * n):
            block += np.float64(correction[np.uint64(i)]) * correction[np.uint64(i)]
        norms[k] = np.sqrt(block)
        to_displacement = np.float64(weights[0, k]) * right[k]
        displacement_square += to_displacement * to_displacement * block
    for row in range(rows):
        block = 0.0
        for i in range(p * n + row * m, p * n + (row + 1) * m):
            block += np.float64(correction[np.uint64(i)]) * correction[np.uint64(i)]
        norms[p + row] = np.sqrt(block)
    return displacement_square


@inlined
def correct(tables, correction, moving, multipliers):
    """Apply a correction to the kept fields and to λ, where that is an unknown."""
    kept, right = tables.kept, tables.right
    n, p = moving.shape[1], kept.shape[0]
    for k in range(p):
        field = kept[k]
        for i in range(n):
            moving[field, i] += right[k] * correction[np.uint64(k * n + i)]
    if correction.shape[0] > p * n:
        for i in range(multipliers.shape[0]):
            multipliers[i] += right[p] * correction[np.uint64(p * n + i)]


@inlined
def recover(tables, history, past, moving, first, last):
    """Evaluate the eliminated fields from the first to the last afresh from the kept ones."""
    kept, weights, differenced = tables.kept, tables.weights, tables.differenced
    of_past = history.fields
    for f in range(first, last + 1):
        if not contains(kept, f):
            for i in range(moving.shape[1]):
                value = of_past[f, i]
                for k in range(kept.shape[0]):
                    weight = weights[f, k]
                    if weight != 0:
                        change = moving[kept[k], i]
                        if differenced[f] != 0:
                            change -= past[kept[k], i]
                        value += weight * change
                moving[f, i] = value


@inlined
def form_acceleration(tables, state):
    """Set the true acceleration v' from the new a and the past."""
    weights, fields, past = tables.acceleration, state.fields, state.past
    for i in range(fields.shape[1]):
        value = weights[0] * fields[2, i]
        for q in range(past.shape[0]):
            value += weights[1 + q] * past[q, i]
        fields[3, i] = value


# -- when Newton's iteration ends --------------------------------------------------------


@inlined
def is_small(tables, schedule, state, room, norm, displacement_square):
    """Whether a correction is in the terminal phase, or meets the test."""
    if schedule.test == BY_ROUNDING:
        return displacement_square < threshold(schedule, state.fields) or norm == 0
    last = room.last_fields, room.last_multipliers
    return _passes(
        schedule, tables.kept, tables.right, last, (state.fields, state.multipliers), norm
    )


@compiled_part
def _passes(schedule, kept, right, last, now, norm):
    """Whether a correction meets the test; the residual is tested after the next evaluation.

    What was before it and what is now are fields (4, n) and multipliers (m,).
    """
    if schedule.test == BY_FIELD:
        passes = True
        for f in range(3):
            limits = schedule.limits[f, 0], schedule.limits[f, 1]
            passes = passes and _changed_little(limits, last[0][f], now[0][f])
        limits = schedule.limits[3, 0], schedule.limits[3, 1]
        return passes and _changed_little(limits, last[1], now[1])
    if schedule.test != BY_CORRECTION:
        return False
    limit = schedule.limits[0, 0]
    if schedule.limits[0, 1] > 0:
        limit += schedule.limits[0, 1] * _scaled_size(kept, right, now[0], now[1])
    return norm <= limit


@compiled_part
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


@inlined
def look(tables, schedule, state, room, solves, first):
    """Before a correction: test the residual, or note from where the correction leads.

    Returns:
        Whether the residual meets the test, and the norm of the step's first.
    """
    if schedule.test == BY_FIELD:
        copy_matrix(state.fields, room.last_fields)
        copy_vector(state.multipliers, room.last_multipliers)
    if schedule.test != BY_RESIDUAL:
        return 0, first
    of_motion, m = 1 + tables.row_weights.shape[0], state.multipliers.shape[0]
    size = _residual(tables.left, room.system.rhs, of_motion, state.fields.shape[1], m)
    if solves == 0:
        return 0, size
    return int(size <= schedule.limits[0, 0] + schedule.limits[0, 1] * first), first


@compiled_part
def _residual(left, rhs, of_motion, n, m):
    """Norm of the residual b before scaling, from −D_L b; its first rows are of motion."""
    square = 0.0
    for i in range(rhs.shape[0]):
        row = i // n if i < of_motion * n else of_motion + (i - of_motion * n) // m
        value = np.float64(rhs[i]) / left[row]
        square += value * value
    return np.sqrt(square)


@inlined
def threshold(schedule, fields):
    """Square of the largest correction of u in the terminal phase."""
    return schedule.settled_below * schedule.settled_below * square_of(fields[0])


@inlined
def _scaled_size(kept, right, fields, multipliers):
    """Norm of the unknowns as the solver sees them."""
    square = 0.0
    for k in range(kept.shape[0]):
        for i in range(fields.shape[1]):
            square += (np.float64(fields[kept[k], i]) / right[k]) ** 2
    for i in range(multipliers.shape[0]):
        square += (np.float64(multipliers[i]) / right[kept.shape[0]]) ** 2
    return np.sqrt(square)


# -- vectors -----------------------------------------------------------------------------


@inlined
def contains(numbers, wanted):
    """Whether a short array has a number."""
    for number in numbers:  # noqa: SIM110, numba compiles no any() of a generator
        if number == wanted:
            return True
    return False


@inlined
def square_of(vector):
    """‖vector‖² in double precision: squares of small single numbers would vanish."""
    square = 0.0
    for i in range(vector.shape[0]):
        square += np.float64(vector[i]) * vector[i]
    return square


@inlined
def copy_vector(source, target):
    """Copy a vector; what an assignment as a whole can raise takes seconds to compile."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@inlined
def copy_matrix(source, target):
    """Copy a matrix."""
    for k in range(source.shape[0]):
        for i in range(source.shape[1]):
            target[k, i] = source[k, i]
