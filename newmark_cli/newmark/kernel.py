"""The compiled Newton march: every form, scaling and integrator in one loop.

Everything that tells one form, scaling or integrator from another reaches the
kernel as numbers (`march_data.StepTables`), every problem as a compiled function and
its tables (`march_data.ProblemTables`).  All compiled code of the core stands
in this file, because numba's disk cache does not notice a change in another.
"""

import threading

import numpy as np
from numba import from_dtype, njit, typeof, types

from newmark_cli.newmark.march_data import COMPLETED, DIVERGED, SINGULAR


def evaluate_type(dtype):
    """Numba type of a problem's function in the arithmetic of a dtype."""
    scalar = from_dtype(dtype)
    vector, table = scalar[::1], scalar[:, ::1]
    return types.FunctionType(
        types.void(
            scalar, vector, vector, vector, types.int64[:, ::1], table,
            vector, vector, vector, vector, vector,
        )
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def _take_increments(moving, past, lows, h, shift, fields):
    """u, v and a that the increments lead to; ``shift`` becomes Δ = h v_n + w."""
    for i in range(shift.shape[0]):
        shift[i] = h * past[1, i] + (h * lows[1, i] + moving[0, i])
        fields[0, i] = past[0, i] + (lows[0, i] + shift[i])
        fields[1, i] = past[1, i] + (lows[1, i] + moving[1, i])
        fields[2, i] = moving[2, i]


@njit(cache=True, nogil=True, error_model="numpy")
def _increase_phi(phi_old, g_old, g_new, rows, columns, shift, phi):
    """Φ = Φ_n + G(u_n + Δ/2)ᵀ Δ; G is affine in u, so its value midway is the mean."""
    half = phi.dtype.type(0.5)
    for k in range(phi.shape[0]):
        phi[k] = phi_old[k]
    for e in range(g_new.shape[0]):
        phi[columns[e]] += half * (g_old[e] + g_new[e]) * shift[rows[e]]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_exactly(high, low, increment, total):
    """High + low + increment as a rounded sum and its rounding error (Knuth's two-sum)."""
    for i in range(high.shape[0]):
        added = low[i] + increment[i]
        total[i] = high[i] + added
        of_added = total[i] - high[i]
        low[i] = (high[i] - (total[i] - of_added)) + (added - of_added)


@njit(cache=True, nogil=True, error_model="numpy")
def _scaled_size(fields, multipliers, kept, right):
    """Norm of the unknowns as the solver sees them."""
    square = 0.0
    for k in range(kept.shape[0]):
        for i in range(fields.shape[1]):
            square += (np.float64(fields[kept[k], i]) / right[k]) ** 2
    for i in range(multipliers.shape[0]):
        square += (np.float64(multipliers[i]) / right[kept.shape[0]]) ** 2
    return np.sqrt(square)


def _march(
    evaluate, problem, tables, state, compensated, t_start, h, first, cap, settled_below,
    absolute, relative, norms, iterations,
):  # fmt: skip
    kept, weights, right, left = tables.kept, tables.weights, tables.right, tables.left
    fields, past, multipliers = state.fields, state.past, state.multipliers
    lows, carried_phi = state.lows, state.phi
    n, m, p = fields.shape[1], multipliers.shape[0], kept.shape[0]
    extra = tables.row_weights.shape[0]
    depth = past.shape[0]
    size = p * n + m
    constraint_row = (1 + extra) * n

    dtype = fields.dtype
    number = dtype.type
    step = number(h)
    to_tolerance = absolute > 0 or relative > 0
    constant = np.zeros((size, size), dtype)
    matrix = np.empty((size, size), dtype)
    entries = matrix.ravel()
    rhs = np.empty(size, dtype)
    work_columns, work_values = np.empty(size, np.uint64), np.empty(size, dtype)
    force, phi = np.empty(n, dtype), np.empty(m, dtype)
    x_values = np.empty(problem.x_rows.shape[0], dtype)
    y_values = np.empty(problem.y_rows.shape[0], dtype)
    g_values = np.empty(problem.g_rows.shape[0], dtype)
    field_history = np.empty((3, n), dtype)
    dynamic_history = np.empty(n, dtype)
    row_history = np.empty((extra, n), dtype)
    new_past = np.empty_like(past)
    # What Newton iterates on: the fields, or their increments over the step.
    moving = np.empty((3, n), dtype) if compensated else fields[:3]
    shift = np.empty(n, dtype)
    g_old = np.empty_like(g_values)
    if compensated:
        evaluate(
            number(t_start + first * h), past[0], past[1], multipliers, problem.ints,
            problem.reals, force, phi, x_values, y_values, g_old,
        )  # fmt: skip
    is_kept = np.zeros(3, np.bool_)
    for k in range(p):
        is_kept[kept[k]] = True

    # Blocks of D_L J D_R that stay: M in row D, the identities in V and K.
    for k in range(p):
        factor = left[0] * tables.dynamic_weights[k] * right[k]
        for e in range(problem.mass_rows.shape[0]):
            i, j = problem.mass_rows[e], k * n + problem.mass_columns[e]
            constant[i, j] += factor * problem.mass_values[e]
        for r in range(extra):
            factor = left[1 + r] * tables.row_weights[r, k] * right[k]
            for i in range(n):
                constant[(1 + r) * n + i, k * n + i] = factor
    # Factors of the blocks that change: X and Y in row D, G, and Gᵀ in row C.
    x_factor = np.empty(p, dtype)
    y_factor = np.empty(p, dtype)
    gt_factor = np.empty(p, dtype)
    for k in range(p):
        x_factor[k] = left[0] * weights[0, k] * right[k]
        y_factor[k] = left[0] * weights[1, k] * right[k]
        gt_factor[k] = left[1 + extra] * weights[0, k] * right[k]
    g_factor = left[0] * right[p]
    # Their places in the matrix; unsigned, as numba tests signed ones for sign.
    x_places = np.empty((p, x_values.shape[0]), np.uint64)
    y_places = np.empty((p, y_values.shape[0]), np.uint64)
    gt_places = np.empty((p, g_values.shape[0]), np.uint64)
    g_places = np.empty(g_values.shape[0], np.uint64)
    for k in range(p):
        for e in range(x_values.shape[0]):
            x_places[k, e] = problem.x_rows[e] * size + k * n + problem.x_columns[e]
        for e in range(y_values.shape[0]):
            y_places[k, e] = problem.y_rows[e] * size + k * n + problem.y_columns[e]
        for e in range(g_values.shape[0]):
            row = constraint_row + problem.g_columns[e]
            gt_places[k, e] = row * size + k * n + problem.g_rows[e]
    for e in range(g_values.shape[0]):
        g_places[e] = problem.g_rows[e] * size + p * n + problem.g_columns[e]
    mass_rows = problem.mass_rows.astype(np.uint64)
    mass_columns = problem.mass_columns.astype(np.uint64)

    for s in range(norms.shape[0]):
        t = number(t_start + (first + s + 1) * h)

        # History terms, once per step.
        row_history[:] = 0
        dynamic_history[:] = 0
        for f in range(3):
            for i in range(n):
                history = past[0, i] * tables.past_weights[f, 0]
                predicted = past[0, i] * tables.predictor[f, 0]
                for q in range(1, depth):
                    history += past[q, i] * tables.past_weights[f, q]
                    predicted += past[q, i] * tables.predictor[f, q]
                field_history[f, i] = history
                moving[f, i] = predicted
        for q in range(depth):
            for e in range(problem.mass_rows.shape[0]):
                dynamic_history[problem.mass_rows[e]] += (
                    problem.mass_values[e]
                    * tables.dynamic_past[q]
                    * past[q, problem.mass_columns[e]]
                )
            for r in range(extra):
                for i in range(n):
                    row_history[r, i] += tables.row_past[r, q] * past[q, i]

        if compensated:
            _take_increments(moving, past, lows, step, shift, fields)
        previous = np.inf
        settled = 0  # corrections in a row that are in the terminal phase
        solves = 0
        while solves < cap:
            evaluate(
                t, fields[0], fields[1], multipliers, problem.ints, problem.reals,
                force, phi, x_values, y_values, g_values,
            )  # fmt: skip
            if compensated:
                _increase_phi(
                    carried_phi, g_old, g_values, problem.g_rows, problem.g_columns, shift, phi
                )

            # rhs = −D_L b
            for i in range(n):
                rhs[i] = force[i] - dynamic_history[i]
            for k in range(p):
                weight = tables.dynamic_weights[k]
                if weight != 0:
                    field = moving[kept[k]]
                    for e in range(mass_rows.shape[0]):
                        rhs[mass_rows[e]] -= (
                            problem.mass_values[e] * weight * field[mass_columns[e]]
                        )
            for i in range(n):
                rhs[i] *= left[0]
            for r in range(extra):
                for i in range(n):
                    residual = row_history[r, i]
                    for k in range(p):
                        residual += tables.row_weights[r, k] * moving[kept[k], i]
                    rhs[(1 + r) * n + i] = -left[1 + r] * residual
            for i in range(m):
                rhs[constraint_row + i] = -left[1 + extra] * phi[i]

            # matrix = D_L J D_R
            matrix[:] = constant
            for k in range(p):
                if weights[0, k] != 0:
                    for e in range(x_values.shape[0]):
                        entries[x_places[k, e]] += x_factor[k] * x_values[e]
                    for e in range(g_values.shape[0]):
                        entries[gt_places[k, e]] += gt_factor[k] * g_values[e]
                if weights[1, k] != 0:
                    for e in range(y_values.shape[0]):
                        entries[y_places[k, e]] += y_factor[k] * y_values[e]
            for e in range(g_values.shape[0]):
                entries[g_places[e]] -= g_factor * g_values[e]

            if not solve_in_place(matrix, rhs, work_columns, work_values):
                return SINGULAR, s
            solves += 1
            # Norms in double precision: squares of small single ones would vanish.
            square = 0.0
            for i in range(size):
                square += np.float64(rhs[i]) * rhs[i]
            norm = np.sqrt(square)
            if not np.isfinite(norm):
                return DIVERGED, s
            if settled >= 2 and norm >= previous and not to_tolerance:
                break
            previous = norm

            # Apply the correction; its blocks are what the step would record.
            displacement_square = 0.0
            for k in range(p):
                field = moving[kept[k]]
                block = 0.0
                for i in range(n):
                    scaled = rhs[k * n + i]
                    block += np.float64(scaled) * scaled
                    field[i] += right[k] * scaled
                norms[s, k] = np.sqrt(block)
                to_displacement = np.float64(weights[0, k]) * right[k]
                displacement_square += to_displacement * to_displacement * block
            block = 0.0
            for i in range(m):
                scaled = rhs[p * n + i]
                block += np.float64(scaled) * scaled
                multipliers[i] += right[p] * scaled
            norms[s, p] = np.sqrt(block)

            for f in range(3):
                if not is_kept[f]:
                    for i in range(n):
                        value = field_history[f, i]
                        for k in range(p):
                            weight = weights[f, k]
                            if weight != 0:
                                change = moving[kept[k], i]
                                if tables.differenced[f] != 0:
                                    change -= past[kept[k], i]
                                value += weight * change
                        moving[f, i] = value
            if compensated:
                _take_increments(moving, past, lows, step, shift, fields)

            if to_tolerance:
                limit = absolute
                if relative > 0:
                    limit += relative * _scaled_size(fields, multipliers, kept, right)
                settled = 1 if norm <= limit else 0
                if settled == 1:
                    break
                continue
            size_of_u = 0.0
            for i in range(n):
                size_of_u += np.float64(fields[0, i]) * fields[0, i]
            if displacement_square < settled_below * settled_below * size_of_u or norm == 0:
                settled += 1
            else:
                settled = 0
            if norm == 0:
                break
        iterations[s] = solves if settled > 0 else -solves

        for i in range(n):
            value = tables.acceleration[0] * fields[2, i]
            for q in range(depth):
                value += tables.acceleration[1 + q] * past[q, i]
            fields[3, i] = value
        for q in range(depth):
            source = tables.advance[q]
            if source < 4:
                new_past[q] = fields[source]
            elif compensated:
                new_past[q] = moving[source - 4]
            elif source == 4:
                new_past[q] = fields[0] - past[0] - step * past[1]
            else:
                new_past[q] = fields[1] - past[1]
        if compensated:
            # G and Φ at the end of the step, whatever was applied last.
            evaluate(
                t, fields[0], fields[1], multipliers, problem.ints, problem.reals,
                force, phi, x_values, y_values, g_values,
            )  # fmt: skip
            _increase_phi(
                carried_phi, g_old, g_values, problem.g_rows, problem.g_columns, shift, phi
            )
            carried_phi[:] = phi
            g_old[:] = g_values
            _add_exactly(past[0], lows[0], shift, new_past[0])
            _add_exactly(past[1], lows[1], moving[1], new_past[1])
        past[:] = new_past
    return COMPLETED, norms.shape[0]


_compiling = threading.Lock()
#: Type of the march's numbers → compiled march.
_compiled: dict = {}


def march(
    evaluate, problem, tables, state, compensated, t_start, h, first, cap, settled_below,
    absolute, relative, norms, iterations,
):  # fmt: skip
    """Advance ``state`` by ``len(norms)`` steps.

    The function is compiled for a problem's function as such, not for one
    particular function, so that one compilation, kept on disk, serves all.

    Args:
        evaluate: Compiled function of the problem, of :func:`evaluate_type`.
        problem, tables, state: See the classes; ``state`` is overwritten.  The type
            of its numbers is the march's.
        compensated: Whether the tables relate increments; needs constraints that
            are quadratic in u and do not depend on time.
        t_start: Time of step 0 (s).
        h: Step size (s).
        first: Steps taken since ``t_start``.
        cap: Most corrections computed in a step.
        settled_below: Terminal phase: an increase of the corrections counts
            once the displacement parts of the correction to be recorded and of
            the one before it are below this fraction of ‖u‖.
        absolute, relative: When one is positive, Newton stops at a correction of
            at most absolute + relative ‖q̄‖ instead.
        norms: (steps, p + 1) overwritten with the 2-norms of the recorded
            correction, in the scaled unknowns, blocks as in ``tables.right``.
        iterations: (steps,) overwritten with the corrections computed; negative
            where the step ended above ``settled_below``, or above the tolerance.

    Returns:
        How the march ended (COMPLETED, SINGULAR, DIVERGED) and the steps done.
    """
    dtype = state.fields.dtype
    arguments = (
        problem, tables, state, compensated, float(t_start), float(h), first, cap,
        float(settled_below), float(absolute), float(relative), norms, iterations,
    )  # fmt: skip
    with _compiling:
        if dtype not in _compiled:
            signature = (evaluate_type(dtype), *(typeof(a) for a in arguments))
            compiled = njit(cache=True, nogil=True, error_model="numpy")(_march)
            compiled.compile(signature)
            # A call with a jitted function would otherwise be compiled anew for that
            # one function, in every process.
            compiled.disable_compile()
            _compiled[dtype] = compiled
    return _compiled[dtype](evaluate, *arguments)
