"""Krylov solvers: their solutions, what they record, when they give up."""

from functools import partial

import numpy as np
import pytest
from covering import covering
from damped import damped
from each import each
from marching import assert_same_step, in_motion, in_system, march, scheme_of, start

from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.mechanisms.spec import Shipped, Sized
from newmark_cli.newmark import march_data
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear import choice, solvers
from newmark_cli.newmark.linear.choice import Krylov, Stagnation
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.krylov import KrylovSystem
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.scaling import PAPER_VARIANTS

SUBJECTS = {name: Shipped(name).load() for name in PROBLEMS} | {
    "chain": Sized("chain", (("links", 12),)).load(),
    "random-chain": Sized("random-chain", (("links", 12),)).load(),
    "damped": damped(),
}
LONG = Sized("random-chain", (("links", 120),)).load()


def values_of(subject, state):
    return subject.values(0.0, *state.fields[:2], state.multipliers)


def right_hand_side(scheme, subject, seed=7):
    """Random, of the same size in every balanced row."""
    size = len(scheme.form.kept) * subject.n + subject.m
    return np.random.default_rng(seed).normal(size=size)


#: Of the subjects, those of either kind, with damping, stiff, and longer.
SOLVED = (
    "pendulum", "andrews", "slider-crank", "heavy-top", "spatial-slider-crank", "random-chain",
    "damped",
)  # fmt: skip


@each("name, form, h", covering(SOLVED, FORMS, [1e-2, 1e-5]))
def test_solutions(name, form, h):
    """As near to that of the LU factors as the condition number says, optimally scaled."""
    subject, scheme = SUBJECTS[name], scheme_of(form, "optimal", h)
    state = in_motion(subject)
    values, rhs = values_of(subject, state), right_hand_side(scheme, subject)
    system = KrylovSystem(subject, scheme, Krylov(tolerance=1e-10))
    found, exact = system.solve(values, rhs), SparseSystem(subject, scheme).solve(values, rhs)
    condition = DenseSystem(subject, scheme).balanced(0.0, state).condition()
    # Twice: in the (v, λ) form balanced rows D are half those of the optimal scaling.
    assert np.linalg.norm(found - exact) <= 2 * condition * 1e-10 * np.linalg.norm(exact)
    assert system.iterations[0] <= 2 * len(rhs)


@each(
    "solver, form, variant",
    [
        *((choice.GMRES, "u-lambda", variant) for variant in PAPER_VARIANTS),
        *((choice.GMRES, "a-lambda", variant) for variant in PAPER_VARIANTS),
    ],
)
def test_recorded_residual(solver, form, variant):
    """That of the solution, with rows D times βh² where D_L is 1: the same in every scaling."""
    subject, h = LONG, 0.4
    scheme, state = scheme_of(form, variant, h), in_motion(subject)
    values, rhs = values_of(subject, state), right_hand_side(scheme, subject)
    rows = np.ones(len(rhs))
    if variant in ("none", "right"):
        rows[: subject.n] = h**2 / 4
    rhs /= rows
    system = solvers.system(solver, subject, scheme, Krylov(tolerance=1e-6))
    found = system.solve(values, rhs)
    matrix = DenseSystem(subject, scheme).matrix(values)
    exact = np.linalg.norm(rows * (rhs - matrix @ found)) / np.linalg.norm(rows * rhs)
    assert system.residuals == [pytest.approx(exact, rel=1e-6)]
    assert 1e-8 < exact <= 1e-6
    assert len(system.iterations) == 1


@each("solver", [choice.GMRES])
def test_iterations_do_not_depend_on_the_step_optimally_scaled(solver):
    """And without scaling the tolerance is out of reach, whatever the solver makes of it."""
    state, counts = in_motion(LONG), []
    for h in (1e-2, 1e-4, 1e-6):
        scheme = scheme_of("u-lambda", "optimal", h)
        values, rhs = values_of(LONG, state), right_hand_side(scheme, LONG)
        system = solvers.system(solver, LONG, scheme)
        system.solve(values, rhs)
        counts += system.iterations
        rhs[: LONG.n] *= 4 / h**2
        plain = solvers.system(solver, LONG, scheme_of("u-lambda", "none", h))
        if h <= 1e-4:
            with pytest.raises(Stagnation):
                plain.solve(values, rhs)
    assert max(counts) < 1.05 * min(counts)


@each("solver", [choice.GMRES])
def test_stagnation(solver):
    """At the limit it is raised, as one of numpy's errors, and the solve is recorded."""
    subject, scheme = SUBJECTS["random-chain"], scheme_of("u-lambda", "optimal", 1e-3)
    values = values_of(subject, in_motion(subject))
    rhs = right_hand_side(scheme, subject)
    system = solvers.system(solver, subject, scheme, Krylov(limit=9))
    with pytest.raises(np.linalg.LinAlgError, match="after 9 iterations, tolerance 1e-08"):
        system.solve(values, rhs)
    assert system.iterations == [9]
    assert 1e-8 < system.residuals[0] < 1


@each("solver", [choice.GMRES])
def test_singular_matrices_end_the_march(solver):
    """G vanishes at the pendulum's pivot, and the length of the rod is out of reach."""
    subject, scheme = SUBJECTS["pendulum"], scheme_of("u-lambda", "optimal", 0.1)
    system = solvers.system(solver, subject, scheme)
    at_pivot = start(subject)
    for array in at_pivot:
        array[:] = 0
    counts = march_data.counting(3, 2)
    ending = in_system(subject, scheme, system).march(at_pivot, 0, counts)
    assert ending == (march_data.STAGNATED, 0)
    assert system.residuals[0] > 0.1


@each(
    "name, h, integrator",
    [("andrews", 1e-5, Newmark()), ("random-chain", 1e-2, GeneralizedAlpha(0.9))],
)
def test_newton_saturates_as_with_lu(name, h, integrator):
    """Solves to 1e-8 do for Newton's corrections to end in rounding, the same as LU's."""
    subject, scheme = SUBJECTS[name], scheme_of("u-lambda", "optimal", h, integrator)
    first, second = start(subject, integrator, h), start(subject, integrator, h)
    by_gmres, by_lu = (
        partial(in_system, system=solvers.system(solver, subject, scheme))
        for solver in (choice.GMRES, choice.SPARSE)
    )
    ours, taken = march(by_gmres, subject, scheme, first, 0, 40)
    theirs, _ = march(by_lu, subject, scheme, second, 0, 40)
    assert taken.min() > 0
    rms = np.sqrt(np.mean(ours**2, 0) / np.mean(theirs**2, 0))
    assert rms == pytest.approx(1, rel=0.5)
    again = first.copy()
    march(by_gmres, subject, scheme, first, 40, 1)
    march(by_lu, subject, scheme, again, 40, 1)
    assert_same_step(subject, scheme, first, again)
