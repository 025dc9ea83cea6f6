"""The kernel's residual, its solver, and when a step ends."""

from types import SimpleNamespace

import numpy as np
from each import each
from hypothesis import given
from hypothesis import strategies as st
from marching import ENGINES, EPS, march, scheme_of

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import kernel
from newmark_cli.newmark.march import initial_state


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
    rows_of_mass, columns_of_mass = np.indices((n, n)).reshape(2, -1)
    problem = SimpleNamespace(
        mass_rows=rows_of_mass, mass_columns=columns_of_mass, mass_values=mass.ravel()
    )
    tables = SimpleNamespace(kept=kept, left=left, dynamic_weights=weights, row_weights=row_weights)
    history = SimpleNamespace(dynamics=dynamics, rows=rows)
    kernel._assemble_residual.py_func(problem, tables, history, moving, force, found)
    kernel._append_constraints.py_func(tables, 0, phi, found)
    equations = [
        mass @ (weights @ moving[kept]) + dynamics - force,
        *(row_weights @ moving[kept] + rows),
        phi,
    ]
    expected = np.concatenate([-f * b for f, b in zip(left, equations, strict=True)])
    assert np.allclose(found, expected, rtol=0, atol=1e-12)


@each("engine", ENGINES)
def test_terminal_phase_needs_two_small_corrections(engine):
    """The first correction of the pendulum at h = 1e-4 is h²/2, no rounding; never recorded."""
    subject, scheme = problem("pendulum"), scheme_of("u-lambda", "none", 1e-4)
    state = initial_state(subject, scheme)
    norms, _ = march(engine, subject, scheme, state, 0, 100)
    assert norms[:, 0].max() < 1e-15


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
