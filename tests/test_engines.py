"""Engines held to each other, the kernel's solver, and forms to one another."""

import itertools

import numpy as np
from covering import covering
from damped import damped
from each import each
from hypothesis import given
from hypothesis import strategies as st
from marching import (
    ENGINES,
    EPS,
    INTEGRATORS,
    STEP,
    assert_same_step,
    compiled,
    in_python,
    march,
    scheme_of,
    states,
)

from newmark_cli.mechanisms.registry import PROBLEMS, problem
from newmark_cli.newmark import kernel, march_data
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scaling import VARIANTS


def named(name):
    return damped() if name == "damped" else problem(name)


#: Problems of either kind, with damping, stiff, and driven.
STEPPED = (
    "pendulum", "andrews", "damped", "slider-crank", "shaken-pendulum", "heavy-top",
)  # fmt: skip


@given(st.integers(1, 5), st.integers(1, 3), st.integers(0, 2), st.integers(0, 2**32 - 1))
def test_the_residual_is_that_of_the_equations(n, m, extra, seed):
    """−D_L b, wherever the fields are: in a march rows V and K are met but for rounding."""
    random = np.random.default_rng(seed)
    kept = random.permutation(3)[: 1 + extra]
    mass, moving = random.normal(size=(n, n)), random.normal(size=(3, n))
    left, weights = random.normal(size=2 + extra), random.normal(size=1 + extra)
    row_weights, rows = random.normal(size=(extra, 1 + extra)), random.normal(size=(extra, n))
    force, dynamics, phi = (random.normal(size=size) for size in (n, n, m))
    found = np.empty((1 + extra) * n + m)
    kernel._assemble_residual(
        *np.indices((n, n)).reshape(2, -1), mass.ravel(), kept, left, weights, row_weights,
        dynamics, rows, moving, force, phi, found,
    )  # fmt: skip
    equations = [
        mass @ (weights @ moving[kept]) + dynamics - force,
        *(row_weights @ moving[kept] + rows),
        phi,
    ]
    expected = np.concatenate([-f * b for f, b in zip(left, equations, strict=True)])
    assert np.allclose(found, expected, rtol=0, atol=1e-12)


@each("name, form, variant, integrator", covering(STEPPED, FORMS, VARIANTS, INTEGRATORS))
def test_engines_agree_per_step(name, form, variant, integrator):
    """Matrices of the kernel and of terms give the same step, to rounding, along a run.

    Both are given the weights of forms and integrators and the factors of scalings: pairs do.
    """
    subject = named(name)
    scheme = scheme_of(form, variant, STEP[name], integrator)
    for first, state in states(subject, integrator, scheme.h, count=2):
        ours, reference = state.copy(), state.copy()
        found, _ = march(compiled, subject, scheme, ours, first, 1)
        expected, _ = march(in_python, subject, scheme, reference, first, 1)
        assert_same_step(subject, scheme, ours, reference)
        # What is recorded is rounding, or nothing.
        limits = scheme.right * found + scheme.right * expected
        assert limits[0, -1] < 1e-3 * max(np.linalg.norm(ours.multipliers), 1)


@each("name, variant", zip(PROBLEMS, itertools.cycle(VARIANTS), strict=False))
def test_all_forms_take_the_same_step(name, variant):
    """Section 3.6: elimination is exact, so every form gives the same u, v, a, λ."""
    subject, integrator = problem(name), Newmark()
    for first, state in states(subject, integrator, STEP[name], count=3):
        results = {}
        for form in FORMS:
            scheme = scheme_of(form, variant, STEP[name])
            results[form] = state.copy()
            march(compiled, subject, scheme, results[form], first, 1)
        for form in FORMS:
            assert_same_step(subject, scheme, results["u-lambda"], results[form])


@each("engine", ENGINES)
def test_terminal_phase_needs_two_small_corrections(engine):
    """The first correction of the pendulum at h = 1e-4 is h²/2, no rounding; never recorded."""
    subject, scheme = problem("pendulum"), scheme_of("u-lambda", "none", 1e-4)
    state = initial_state(subject, scheme)
    norms, _ = march(engine, subject, scheme, state, 0, 100)
    assert norms[:, 0].max() < 1e-15


@each("engine", ENGINES)
def test_what_cannot_be_solved_ends_the_march(engine):
    """A status, not a traceback, where G vanishes, and for a correction that is not finite."""
    subject, scheme = problem("pendulum"), scheme_of("u-lambda", "none", 0.1)
    state = State(*(np.zeros(shape) for shape in ((4, 2), (3, 2), 1, (2, 2), 1, 1, 1, 2, 3)))
    counts = np.zeros((3, 2)), np.zeros(3, np.int64)
    ending = engine(subject, scheme).march(state, 0, *counts)
    assert ending == (march_data.SINGULAR, 0)
    state = initial_state(subject, scheme)
    state.past[1] = 1e200
    with np.errstate(all="ignore"):
        ending, done = engine(subject, scheme).march(state, 0, *counts)
    assert ending == march_data.DIVERGED
    assert done == 0


@given(st.integers(1, 31), st.integers(0, 2**32 - 1), st.floats(0, 0.9))
def test_kernel_solver(size, seed, sparsity):
    """Backward stable: the residual is rounding of ‖A‖‖x‖, zeros or not."""
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(size, size)) * (random.random((size, size)) >= sparsity)
    matrix += np.diag(random.choice([-3.0, 3.0], size))[random.permutation(size)]
    rhs = random.normal(size=size)
    solution = rhs.copy()
    work = np.empty(size, np.uint64), np.empty(size)
    assert kernel.solve_in_place(matrix.copy(), solution, *work)
    scale = np.linalg.norm(matrix, np.inf) * np.linalg.norm(solution, np.inf)
    assert np.max(np.abs(matrix @ solution - rhs)) <= 50 * size * EPS * scale


@given(st.integers(2, 12), st.integers(0, 2**32 - 1))
def test_kernel_solver_finds_singular_matrices(size, seed):
    """A zero column and a pivot that is not a number are refused."""
    random = np.random.default_rng(seed)
    work = np.empty(size, np.uint64), np.empty(size)
    for bad in (0.0, np.nan):
        matrix = random.normal(size=(size, size))
        matrix[:, random.integers(size)] = bad
        assert not kernel.solve_in_place(matrix, np.ones(size), *work)
