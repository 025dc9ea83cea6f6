"""Verbs of formulations beside index 3, and of projections after a step."""

import numpy as np

from newmark_cli.newmark.march_data import COMPLETED, MOST_POSITIONS
from newmark_cli.newmark.newton import (
    append_constraints,
    assemble_residual,
    call_python,
    compiled_part,
    contains,
    copy_vector,
    correct,
    evaluate_at,
    evaluate_past,
    form_acceleration,
    recover,
    solve_in_place,
    square_of,
    take_increments,
    take_norms,
    threshold,
)


@compiled_part
def set_directions(evaluate, t, problem, extra, state, room):
    """Set η = 0 and P from the entries of G at the beginning of the step, if there are η."""
    work, g = room.work, room.iterate.g_old
    if extra.stabilised == 0:
        return
    if not room.iterate.compensated:
        evaluate_past(evaluate, t, problem, state, room.values, g)
    work.eta[:] = 0
    work.push[:] = 0
    for e in range(work.directions.shape[0]):
        work.directions[e] = extra.projector_values[e] * g[extra.projector_sources[e]]


@compiled_part
def evaluate_formulated(evaluate, derive, t, problem, tables, extra, state, room, solves):
    """Evaluate the problem and the rows of constraints at the iterate, and set −D_L b."""
    multipliers, iterate, values, work = state.multipliers, room.iterate, room.values, room.work
    if extra.penalty[0] == 0 or solves == 0:
        evaluate_at(evaluate, t, multipliers, problem, iterate, state, values)
    if extra.penalty[0] > 0:
        # Φ is that at the iterate, from here or from the last update of λ.
        for k in range(multipliers.shape[0]):
            work.shifted[k] = multipliers[k] - extra.penalty[0] * values.phi[k]
        evaluate_at(evaluate, t, work.shifted, problem, iterate, state, values)
    if extra.differentiated != 0:
        form_acceleration(tables, state)
        differentiate(derive, t, problem, iterate, state, values, work)
    _assemble_constraints(problem, extra, state, values, room.constraints, work)
    rhs = room.system.rhs
    assemble_residual(problem, tables, room.history, iterate.moving, values.force, rhs)
    for row in range(extra.rows.shape[0]):
        append_constraints(tables, row, room.constraints[row], rhs)
    if extra.stabilised != 0:
        _push_residual(problem, tables, extra, iterate.moving.shape[1], work, rhs)


@compiled_part
def differentiate(derive, t, problem, iterate, state, values, work):
    """Differentiate the constraints at the iterate, and set Ψ."""
    fields = state.fields
    derive(
        t, fields[0], fields[1], fields[3], problem.ints, problem.reals, work.rate,
        work.curvature, work.r, work.q,
    )  # fmt: skip
    _rate_of_constraints(problem, iterate, state, values, work)


@compiled_part
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


@compiled_part
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


@compiled_part
def _push_residual(problem, tables, extra, n, work, rhs):
    """Add Pη to rows D, V and K of −D_L b."""
    inertia = extra.inertia * extra.eta[2]
    for e in range(problem.mass_rows.shape[0]):
        pushed = problem.mass_values[e] * inertia * work.push[problem.mass_columns[e]]
        rhs[problem.mass_rows[e]] -= tables.left[0] * pushed
    for r in range(tables.row_weights.shape[0]):
        for i in range(n):
            rhs[(1 + r) * n + i] -= tables.left[1 + r] * extra.rows_eta[r] * work.push[i]


@compiled_part
def multiply(extra, sources):
    """Set the sources that are products of two others, behind all others."""
    begin = sources.shape[0] - extra.first.shape[0]
    for e in range(extra.first.shape[0]):
        sources[begin + e] = sources[extra.first[e]] * sources[extra.second[e]]


@compiled_part
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
        if not contains(tables.kept, f):
            block = 0.0
            for i in range(n):
                change = extra.eta[f] * work.moved[i]
                for k in range(p):
                    scaled = np.float64(correction[k * n + i])
                    change += tables.weights[f, k] * tables.right[k] * scaled
                block += change * change
            work.now[place] = np.sqrt(block)
            place += 1


@compiled_part
def apply_formulated(tables, extra, state, room):
    """Apply a correction to the kept fields, λ and η, and recover the other fields."""
    correction, iterate, work = room.system.rhs, room.iterate, room.work
    moving, multipliers = iterate.moving, state.multipliers
    n, m, p = moving.shape[1], multipliers.shape[0], tables.kept.shape[0]
    correct(tables, correction, moving, multipliers)
    if extra.stabilised != 0:
        for k in range(m):
            work.eta[k] += tables.right[p + 1] * correction[p * n + m + k]
        work.push[:] = 0
        for e in range(work.directions.shape[0]):
            pushed = work.directions[e] * work.eta[extra.projector_columns[e]]
            work.push[extra.projector_rows[e]] += pushed
    recover(tables, room.history, state.past, moving, 0, 2)
    for f in range(3):
        if extra.eta[f] != 0 and not contains(tables.kept, f):
            for i in range(n):
                moving[f, i] += extra.eta[f] * work.push[i]
    take_increments(iterate, state)


@compiled_part
def _update_by_penalty(tables, extra, multipliers, phi, work):
    """Update λ by −pΦ; returns the square of that, in scaled unknowns."""
    p, square = tables.kept.shape[0], 0.0
    for k in range(phi.shape[0]):
        update = -extra.penalty[0] * phi[k]
        multipliers[k] += update
        square += (np.float64(update) / tables.right[p]) ** 2
    work.now[p] = np.sqrt(square)
    return square


@compiled_part
def measure(evaluate, t, problem, tables, extra, state, room):
    """Norms of a correction; with a penalty it is applied, and λ updated after it.

    Returns:
        ‖q̄‖² and the square of the displacement part.
    """
    rhs, values, work, multipliers = room.system.rhs, room.values, room.work, state.multipliers
    n, m, norm_square = state.fields.shape[1], multipliers.shape[0], square_of(rhs)
    displacement_square = take_norms(tables, rhs, n, m, extra.rows.shape[0], work.now)
    if extra.stabilised != 0:
        _take_eliminated_norms(tables, extra, rhs, n, m, work)
    if extra.penalty[0] > 0:
        # λ follows from Φ after the correction.
        apply_formulated(tables, extra, state, room)
        evaluate_at(evaluate, t, multipliers, problem, room.iterate, state, values)
        norm_square += _update_by_penalty(tables, extra, multipliers, values.phi, work)
    return norm_square, displacement_square


@compiled_part
def record_decreasing(work, norms, settled):
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
            norms[b] = work.now[b]
        work.last[b] = work.now[b]
    return all_done


@compiled_part
def project(evaluate, derive, t, problem, tables, extra, schedule, state, room, positions):
    """Project positions, velocities and accelerations, set v'; False where it cannot be done."""
    multipliers, iterate, values, work = state.multipliers, room.iterate, room.values, room.work
    n, change = state.fields.shape[1], work.saddle.rhs
    while extra.level > 1 and positions[0] < MOST_POSITIONS:
        positions[0] += 1
        evaluate_at(evaluate, t, multipliers, problem, iterate, state, values)
        change[:] = 0
        if not _solve_projection(problem, extra, room, values.phi):
            return False
        if not _move(iterate.moving[0], iterate, state, change) > threshold(schedule, state.fields):
            break  # The next one would be of the order of the square.
    if extra.level > 0:
        evaluate_at(evaluate, t, multipliers, problem, iterate, state, values)
        differentiate(derive, t, problem, iterate, state, values, work)
        change[:] = 0
        if not _solve_projection(problem, extra, room, work.psi):
            return False
        _move(iterate.moving[1], iterate, state, change)
        for k in range(multipliers.shape[0]):
            state.impulse[k] = change[n + k]
    form_acceleration(tables, state)
    if extra.accelerations != 0:
        work.shifted[:] = 0
        evaluate_at(evaluate, t, work.shifted, problem, iterate, state, values)
        differentiate(derive, t, problem, iterate, state, values, work)
        copy_vector(values.force, change)
        if not _solve_projection(problem, extra, room, work.curvature):
            return False
        for i in range(n):
            change[i] -= state.fields[3, i]
            state.fields[3, i] += change[i]
        # Alike: a belongs to another time, and set to v' would cost generalized-α an order.
        _move(iterate.moving[2], iterate, state, change)
    return True


@compiled_part
def _solve_projection(problem, extra, room, misfit):
    """Solve [[M, −G], [Gᵀ, 0]] x = (b, −misfit) in place; b is there."""
    g, saddle, addresses = room.values.g, room.work.saddle, room.python.addresses
    n = room.values.force.shape[0]
    for k in range(misfit.shape[0]):
        saddle.rhs[n + k] = -misfit[k]
    if saddle.matrix.shape[0] == 0:
        return call_python(addresses[1]) == COMPLETED  # type: ignore[call-arg]
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


@compiled_part
def _move(field, iterate, state, change):
    """Move a field (n,) of the iterate by what was projected; returns the square of that."""
    square = 0.0
    for i in range(field.shape[0]):
        field[i] += change[i]
        square += np.float64(change[i]) * change[i]
    take_increments(iterate, state)
    return square
