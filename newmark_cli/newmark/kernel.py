"""The compiled Newton march: every form, scaling and integrator in one loop.

Everything that tells one form, scaling or integrator from another reaches the
kernel as numbers (`march_data.StepTables`), every problem as a compiled function and
its tables (`march_data.ProblemTables`).  `_march` is the algorithm; its verbs are here, in
`newton`, and for formulations beside index 3 in `enforcing`.  What it overwrites is `room`.

Numba drops what a comparison of an argument that is None excludes: index 3 has no ``extra``,
and a formulation no ``solve``.  Measure a change with `benchmarks/kernel.py`.
"""

import threading

import numpy as np
from numba import from_dtype, typeof, types

from newmark_cli.newmark.enforcing import (
    apply_formulated,
    differentiate,
    evaluate_formulated,
    measure,
    multiply,
    project,
    record_decreasing,
    set_directions,
)
from newmark_cli.newmark.march_data import (
    BY_FIELD,
    BY_ROUNDING,
    COMPLETED,
    DIVERGED,
    PIVOTING,
    RAISED,
    SINGULAR,
    UNSOLVED,
)
from newmark_cli.newmark.newton import (
    append_constraints,
    assemble,
    assemble_residual,
    change_size,
    collect_history,
    compiled_alone,
    copy_matrix,
    copy_vector,
    correct,
    evaluate_at,
    evaluate_past,
    extrapolate,
    form_acceleration,
    inlined,
    is_small,
    look,
    recover,
    solve_pivoting,
    square_of,
    take_increments,
    take_norms,
)
from newmark_cli.newmark.room import allocate


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


@inlined
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


@inlined
def _carry_over(state, iterate, values, new_past):
    """Carry Φ, G and the rounding errors of u and v over to the next step."""
    for k in range(state.phi.shape[0]):
        state.phi[k] = values.phi[k]
    for e in range(values.g.shape[0]):
        iterate.g_old[e] = values.g[e]
    _add_exactly(state.past[0], state.lows[0], iterate.shift, new_past[0])
    _add_exactly(state.past[1], state.lows[1], iterate.moving[1], new_past[1])


@inlined
def _add_exactly(high, low, increment, total):
    """High + low + increment as a rounded sum and its rounding error (Knuth's two-sum)."""
    for i in range(high.shape[0]):
        added = low[i] + increment[i]
        total[i] = high[i] + added
        of_added = total[i] - high[i]
        low[i] = (high[i] - (total[i] - of_added)) + (added - of_added)


@inlined
def _begin(evaluate, derive, t, problem, extra, iterate, values, work, state):
    """Compensated: evaluate G, and its rate, where the march stands."""
    if iterate.compensated:
        evaluate_past(evaluate, t, problem, state, values, iterate.g_old)
        if extra is not None and (extra.differentiated != 0 or extra.level > 0):
            derive(
                t, state.past[0], state.past[1], state.fields[3], problem.ints, problem.reals,
                work.rate, work.curvature, work.r_old, work.q,
            )  # fmt: skip


@inlined
def _solve(solve, static, dense, extra, sources, system, python, pivoted):
    """Overwrite the right-hand side with the correction; how that ended."""
    ending = UNSOLVED
    if solve is not None:
        if static.structure.shape[0] > 0:
            ending = solve(
                sources, system.rhs, static.constant, static.places, static.origins,
                static.coefficients, static.structure, static.room, static.work,
            )  # fmt: skip
        if ending == PIVOTING:
            pivoted[0] = 1
    if ending != COMPLETED:
        if extra is not None:
            multiply(extra, sources)
        assemble(sources, dense, system.entries)
        ending = solve_pivoting(python, system)
    return ending


@inlined
def _look_back(evaluate, derive, t, problem, extra, state, room):
    """Compensated: evaluate G, Φ and Φ' at the end of the step, whatever was applied last."""
    iterate, values, work = room.iterate, room.values, room.work
    evaluate_at(evaluate, t, state.multipliers, problem, iterate, state, values)
    if extra is not None and (extra.differentiated != 0 or extra.level > 0):
        differentiate(derive, t, problem, iterate, state, values, work)
        copy_vector(work.psi, state.psi)
        copy_vector(work.r, work.r_old)
    _carry_over(state, iterate, values, room.new_past)


@inlined
def _record(extra, state, record, place, s):
    """Copy the state to one place of the record if that is for step s; 1 if it is, else 0."""
    if place >= record.steps.shape[0] or record.steps[place] != s:
        return 0
    for field in range(state.fields.shape[0]):
        for i in range(state.fields.shape[1]):
            record.fields[place, field, i] = state.fields[field, i]
    for k in range(state.multipliers.shape[0]):
        record.multipliers[place, k] = state.multipliers[k]
    if extra is not None and extra.total != 0:
        for k in range(state.multipliers.shape[0]):
            record.multipliers[place, k] += state.impulse[k] / extra.acting[0]
    return 1


def _march(evaluate, derive, solve, plan, extra, state, counts, record, room):
    """The march as numba compiles it, with or without a formulation; see `march`."""
    problem, tables, static, dense, schedule, sizes = plan
    values, iterate, history, system = room.values, room.iterate, room.history, room.system
    moving, rhs, work, python = iterate.moving, system.rhs, room.work, room.python
    past, multipliers, number = state.past, state.multipliers, state.fields.dtype.type
    n, m, to_tolerance = past.shape[1], multipliers.shape[0], schedule.test != BY_ROUNDING
    kept = given_up = 0
    t = number(sizes.times[0])
    _begin(evaluate, derive, t, problem, extra, iterate, values, work, state)
    for s in range(counts.norms.shape[0]):
        begin, t = t, number(sizes.times[s + 1])
        norms, python.step[0] = counts.norms[s], s
        if sizes.which[s + 1] != sizes.which[s]:
            change_size(sizes, s, state.fields[3], past, room.new_past)
        collect_history(problem, tables, past, history)
        extrapolate(tables, past, moving)
        take_increments(iterate, state)
        if extra is not None:
            set_directions(evaluate, begin, problem, extra, state, room)
        previous, first, solves = np.inf, 0.0, np.int64(0)  # a literal: `look` twice
        settled = 0  # corrections in a row that are in the terminal phase
        while solves < schedule.cap:
            if solve is not None:
                evaluate_at(evaluate, t, multipliers, problem, iterate, state, values)
                assemble_residual(problem, tables, history, moving, values.force, rhs)
                append_constraints(tables, 0, values.phi, rhs)
            if extra is not None:
                evaluate_formulated(
                    evaluate, derive, t, problem, tables, extra, state, room, solves
                )
            if python.raised[0] != 0:
                return RAISED, s
            if to_tolerance:
                settled, first = look(tables, schedule, state, room, solves, first)
                if settled:
                    break
            pivoted = counts.pivoted[s : s + 1]
            ending = _solve(solve, static, dense, extra, room.sources, system, python, pivoted)
            if ending != COMPLETED:
                return ending, s
            solves += 1
            norm_square, displacement_square = square_of(rhs), 0.0
            if extra is not None:
                norm_square, displacement_square = measure(
                    evaluate, t, problem, tables, extra, state, room
                )
            norm = np.sqrt(norm_square)
            if not np.isfinite(norm):
                return DIVERGED, s
            if solve is not None:
                if settled >= 2 and norm >= previous and not to_tolerance:
                    break
                previous = norm
                displacement_square = take_norms(tables, rhs, n, m, 1, norms)
                correct(tables, rhs, moving, multipliers)
                # Nothing but the end of the step needs a.
                last = 2 if schedule.test == BY_FIELD else 1
                recover(tables, history, past, moving, 0, last)
                take_increments(iterate, state)
            if extra is not None:
                if record_decreasing(work, norms, 0 if to_tolerance else settled):
                    break
                if extra.penalty[0] == 0:
                    apply_formulated(tables, extra, state, room)
            small = is_small(tables, schedule, state, room, norm, displacement_square)
            settled = settled + 1 if small else 0
            if small and (to_tolerance or norm == 0):
                break
        counts.iterations[s] = solves if settled > 0 else -solves
        if extra is None:
            recover(tables, history, past, moving, 2, 2)
            take_increments(iterate, state)
            form_acceleration(tables, state)
        elif not project(
            evaluate, derive, t, problem, tables, extra, schedule, state, room,
            counts.positions[s : s + 1],
        ):  # fmt: skip
            return SINGULAR, s
        _advance(tables, state, iterate, room.new_past)
        if iterate.compensated:
            _look_back(evaluate, derive, t, problem, extra, state, room)
        copy_matrix(room.new_past, past)
        kept += _record(extra, state, record, kept, s)
        given_up += counts.pivoted[s]
        if given_up >= schedule.patience:
            return COMPLETED, s + 1
    return COMPLETED, counts.norms.shape[0]


_compiling = threading.Lock()
#: Type of the march's numbers, and whether there is a formulation → compiled march.
_compiled: dict = {}


def is_compiled(dtype, formulated):
    """Whether `march` is compiled, for numbers of a type, with or without a formulation."""
    return (np.dtype(dtype), formulated) in _compiled


def march(functions, plan, extra, python, state, counts, record):
    """Advance ``state`` by as many steps as ``counts`` has room for.

    The function is compiled for problems' functions as such, not for particular ones, so that
    one compilation, kept on disk, serves all.

    Args:
        functions: Compiled: the problem's, of :func:`evaluate_type`; the derivatives of its
            constraints, of :func:`derivatives_type`, None for index 3; static elimination, of
            :func:`solve_type`.
        plan: `newmark_cli.newmark.march_data.Plan`; its numbers have the march's type.
        extra: `newmark_cli.newmark.constraints.FormulationTables`; None for index 3.
        python: `newmark_cli.newmark.callbacks.Callbacks`.
        state, counts, record: Overwritten; see the classes.

    Returns:
        How the march ended (COMPLETED, SINGULAR, DIVERGED, STAGNATED) and the steps done.
    """
    evaluate, derive, solve = functions
    dtype, formulated = state.fields.dtype, extra is not None
    room = allocate(plan, extra, python.calls, state, counts.norms.shape[1])
    given = evaluate, *((derive, None) if formulated else (None, solve))
    numbers = plan, extra, state, counts, record, room
    with _compiling:
        if (dtype, formulated) not in _compiled:
            kinds = (
                evaluate_type(dtype),
                derivatives_type(dtype) if formulated else types.none,
                types.none if formulated else solve_type(dtype),
            )
            compiled = compiled_alone(_march)
            compiled.compile((*kinds, *(typeof(number) for number in numbers)))
            # A call with a jitted function would otherwise be compiled anew for that
            # one function, in every process.
            compiled.disable_compile()
            _compiled[dtype, formulated] = compiled
    with python.served(state, room):
        return _compiled[dtype, formulated](*given, *numbers)
