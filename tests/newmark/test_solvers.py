"""Linear solvers: their solutions and condition numbers, and when Krylov solvers give up."""

import itertools
from functools import cache

import exact_orders
import numpy as np
import oracles
import pytest
from covering import covering
from damped import damped
from hypothesis import given
from hypothesis import strategies as st
from marching import EPS, in_motion, in_system, scheme_of, start
from mpmath import mp

from newmark_cli.mechanisms.registry import SHIPPED
from newmark_cli.mechanisms.spec import Shipped, Sized
from newmark_cli.newmark import march_data, newton
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.jacobian import balancing_factors, scaling_factors
from newmark_cli.newmark.linear import solvers
from newmark_cli.newmark.linear.choice import GMRES, Krylov, Stagnation
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.krylov import KrylovSystem
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.linear.written import static_elimination
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.scaling import PAPER_VARIANTS, VARIANTS

MAKERS = {name: Shipped(name).load for name in SHIPPED} | {
    "chain": Sized("chain", (("links", 200),)).load,
    "random chain": Sized("random-chain", (("links", 12),)).load,
    "long": Sized("random-chain", (("links", 120),)).load,
    "bars": Sized("four-bars", (("windows", 20),)).load,
    "damped": damped,
}


@cache
def subject_of(name):
    """A problem by its name here."""
    return MAKERS[name]()


def values_of(subject, state):
    """The problem at a state."""
    return subject.values(0.0, *state.fields[:2], state.multipliers)


# -- accuracy ---------------------------------------------------------------------------------


def eliminated(subject, scheme, values, rhs):
    """By static elimination, written out and by lists."""
    system = StaticSystem(subject, scheme).elimination
    sources, tables, found, lists = system.sources(values), system.tables, rhs.copy(), rhs.copy()
    assert system.solve(sources, found, *tables) == 0
    assert static_elimination.solve_in_order(sources, lists, *system.entries) == 0
    np.testing.assert_allclose(lists, found, rtol=1e-9, atol=0)
    return found


def factorised(subject, scheme, values, rhs):
    """By sparse LU factors."""
    return SparseSystem(subject, scheme).solve(values, rhs)


PLANAR = ["andrews", "slider-crank", "shaken-pendulum"]


@pytest.mark.parametrize(
    ("solve", "name", "form", "variant", "h"),
    [
        *covering([eliminated], [*PLANAR, "bars"], FORMS, VARIANTS, (1e-3, 1e-5, 1e-7)),
        *covering([factorised], ["chain", "damped"], FORMS, VARIANTS, (1e-3, 1e-7)),
    ],
)
def test_solutions_are_right_whatever_the_scaling(solve, name, form, variant, h):
    """To rounding times the condition of the optimally scaled matrix, down to h = 1e-7."""
    subject, scheme = subject_of(name), scheme_of(form, variant, h)
    state = in_motion(subject)
    values, system = values_of(subject, state), SparseSystem(subject, scheme)
    units = balancing_factors(scheme, subject.n, subject.m)[1]
    units /= scaling_factors(scheme, subject.n, subject.m)[1]
    exact = np.random.default_rng(5).normal(size=system.size) * units
    # In extended precision, so that the error is the solver's and not the product's.
    product = np.zeros(system.size, np.longdouble)
    entries = system.scaled_entries(values).astype(np.longdouble)
    np.add.at(product, system.rows, entries * exact[system.columns])
    off = (solve(subject, scheme, values, product.astype(float)) - exact) / units
    best = SparseSystem(subject, scheme_of(form, "optimal", h)).balanced(0.0, state).condition()
    assert np.linalg.norm(off) < 20 * EPS * best * np.linalg.norm(exact / units)


@pytest.mark.parametrize(
    ("name", "form", "variant"), covering(["andrews", "bars"], FORMS, ["none", "optimal"])
)
def test_all_solve_the_same_matrix(name, form, variant):
    """Static, dense and sparse systems assemble the same, to rounding of its entries."""
    subject, scheme = subject_of(name), scheme_of(form, variant, 1e-4)
    values = values_of(subject, in_motion(subject))
    static, dense, sparse = (
        kind(subject, scheme).matrix(values).toarray()
        for kind in (StaticSystem, DenseSystem, SparseSystem)
    )
    for other in (dense, sparse):
        assert np.all(np.abs(static - other) <= 8 * EPS * np.abs(other))


@given(st.integers(1, 31), st.integers(0, 2**32 - 1), st.floats(0, 0.9))
def test_the_kernel_solves_with_partial_pivoting(size, seed, sparsity):
    """Backward stable, zeros or not; a zero column and a pivot that is no number are refused."""
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(size, size)) * (random.random((size, size)) >= sparsity)
    matrix += np.diag(random.choice([-3.0, 3.0], size))[random.permutation(size)]
    rhs = random.normal(size=size)
    solution = rhs.copy()
    work = np.empty(size, np.uint64), np.empty(size)
    assert newton.solve_in_place(matrix.copy(), solution, *work)
    scale = np.linalg.norm(matrix, np.inf) * np.linalg.norm(solution, np.inf)
    assert np.max(np.abs(matrix @ solution - rhs)) <= 50 * size * EPS * scale
    for bad in (0.0, np.nan):
        matrix[:, random.integers(size)] = bad
        assert not newton.solve_in_place(matrix.copy(), np.ones(size), *work)


# -- condition numbers ------------------------------------------------------------------------

H = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
#: Of Andrews' mechanism, of whom a singular value takes long, every form, variant and step size.
OF_EACH = [
    (form, PAPER_VARIANTS[(k + 2) % len(PAPER_VARIANTS)], H[(k + 4) % len(H)])
    for k, form in enumerate(FORMS)
]


@pytest.mark.parametrize(
    ("name", "cases"),
    [("pendulum", [*itertools.product(FORMS, PAPER_VARIANTS, H[::2])]), ("andrews", OF_EACH)],
)
def test_condition_numbers(name, cases):
    """Against 60 digits, within 1e-9 relative; C runs from 3 to 1e31."""
    wrong, subject = {}, subject_of(name)
    state, exact = start(subject), oracles.REFERENCES[name]()
    with mp.workdps(oracles.DIGITS):
        x, g = exact.jacobian_terms(map(float, state.fields[0]), map(float, state.multipliers))
        for form, variant, h in cases:
            blocks = exact_orders.form_jacobian(form, x, mp.zeros(subject.n), exact.mass, g, h)
            right = oracles.condition_number(oracles.scale(form, variant, *blocks, h))
            scheme = scheme_of(form, variant, h)
            found = DenseSystem(subject, scheme).balanced(0.0, state).condition()
            if not abs(found / right - 1) < 1e-9:
                wrong[form, variant, h] = found, right
    assert not wrong


@pytest.mark.parametrize(
    ("name", "form", "variant", "h"),
    covering(["andrews", "heavy-top", "bricard", "long"], FORMS, VARIANTS, (1e-2, 1e-5, 1e-8)),
)
def test_estimated_condition_numbers(name, form, variant, h):
    """Between a third of the exact 1-norm condition number and all of it; repeatable.

    ‖J̄‖ is exact; the estimate of ‖J̄⁻¹‖ is a lower bound, almost always within a factor
    of 3 (Higham and Tisseur, 2000).  Static elimination reuses its factors.
    """
    subject, scheme = subject_of(name), scheme_of(form, variant, h)
    state, system = in_motion(subject), SparseSystem(subject, scheme)
    dense = DenseSystem(subject, scheme).balanced(0.0, state)
    exact = np.linalg.norm(dense.system.dense(dense.scaled), 1) * np.linalg.norm(dense.inverse(), 1)
    found = system.balanced(0.0, state).condition()
    assert exact / 3 <= found <= exact * (1 + 1e-9)
    assert system.balanced(0.0, state).condition() == found
    if name == "long":
        of_static = StaticSystem(subject, scheme).balanced(0.0, state).condition()
        assert of_static == pytest.approx(found, rel=1e-6)


# -- Krylov solvers ---------------------------------------------------------------------------


def right_hand_side(scheme, subject):
    """Random, of the same size in every balanced row."""
    size = len(scheme.form.kept) * subject.n + subject.m
    return np.random.default_rng(7).normal(size=size)


@pytest.mark.parametrize(
    ("name", "form", "h"),
    covering(["andrews", "heavy-top", "random chain", "damped"], FORMS, [1e-2, 1e-5]),
)
def test_krylov_solutions(name, form, h):
    """As near to that of the LU factors as the condition number says, optimally scaled."""
    subject, scheme = subject_of(name), scheme_of(form, "optimal", h)
    state = in_motion(subject)
    values, rhs = values_of(subject, state), right_hand_side(scheme, subject)
    system = KrylovSystem(subject, scheme, Krylov(tolerance=1e-10))
    found, exact = system.solve(values, rhs), factorised(subject, scheme, values, rhs)
    condition = DenseSystem(subject, scheme).balanced(0.0, state).condition()
    # Twice: in the (v, λ) form balanced rows D are half those of the optimal scaling.
    assert np.linalg.norm(found - exact) <= 2 * condition * 1e-10 * np.linalg.norm(exact)
    assert system.iterations[0] <= 2 * len(rhs)


@pytest.mark.parametrize(("form", "variant"), covering(["u-lambda", "a-lambda"], PAPER_VARIANTS))
def test_recorded_residual(form, variant):
    """That of the solution, with rows D times βh² where D_L is 1: the same in every scaling."""
    subject, h = subject_of("long"), 0.4
    scheme, state = scheme_of(form, variant, h), in_motion(subject)
    values, rhs = values_of(subject, state), right_hand_side(scheme, subject)
    rows = np.ones(len(rhs))
    if variant in ("none", "right"):
        rows[: subject.n] = h**2 / 4
    rhs /= rows
    system = KrylovSystem(subject, scheme, Krylov(tolerance=1e-6))
    found = system.solve(values, rhs)
    matrix = SparseSystem(subject, scheme).matrix(values)
    exact = np.linalg.norm(rows * (rhs - matrix @ found)) / np.linalg.norm(rows * rhs)
    assert system.residuals == [pytest.approx(exact, rel=1e-6)]
    assert 1e-8 < exact <= 1e-6
    assert len(system.iterations) == 1


def test_iterations_do_not_depend_on_the_step_optimally_scaled():
    """Without scaling the tolerance is out of reach; at its limit a solver says where it is."""
    subject, counts = subject_of("long"), []
    values = values_of(subject, in_motion(subject))
    for h in (1e-2, 1e-4, 1e-6):
        scheme = scheme_of("u-lambda", "optimal", h)
        rhs, system = right_hand_side(scheme, subject), solvers.system(GMRES, subject, scheme)
        system.solve(values, rhs)
        counts += system.iterations
    assert max(counts) < 1.05 * min(counts)
    limited = solvers.system(GMRES, subject, scheme, Krylov(limit=9))
    with pytest.raises(np.linalg.LinAlgError, match="after 9 iterations, tolerance 1e-08"):
        limited.solve(values, rhs)
    assert limited.iterations == [9]
    assert 1e-8 < limited.residuals[0] < 1
    rhs[: subject.n] *= 4 / h**2
    with pytest.raises(Stagnation):
        solvers.system(GMRES, subject, scheme_of("u-lambda", "none", h)).solve(values, rhs)


def test_singular_matrices_end_the_march():
    """G vanishes at the pendulum's pivot, and the length of the rod is out of reach."""
    subject, scheme = subject_of("pendulum"), scheme_of("u-lambda", "optimal", 0.1)
    system, at_pivot = solvers.system(GMRES, subject, scheme), start(subject)
    for array in at_pivot:
        array[:] = 0
    ending = in_system(subject, scheme, system).march(at_pivot, 0, march_data.counting(3, 2))
    assert ending == (march_data.STAGNATED, 0)
    assert system.residuals[0] > 0.1
