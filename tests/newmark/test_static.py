"""Static elimination: as right as partial pivoting, or left to it, and counted."""

import decimal
import json
from decimal import Decimal

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
import yaml
from covering import covering
from each import each
from hypothesis import given
from hypothesis import strategies as st
from marching import in_motion, scheme_of, start
from numba import njit

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import problem
from newmark_cli.mechanisms.spec import Sized
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha, Newmark
from newmark_cli.newmark.jacobian import balancing_factors, scaling_factors
from newmark_cli.newmark.linear.choice import AUTO, DENSE, SPARSE, STATIC, choose
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.ordering import order_by_size
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.linear.written import static_elimination
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import PIVOTING
from newmark_cli.newmark.monomial import Monomial
from newmark_cli.newmark.scaling import Scaling, named_scaling
from newmark_cli.newmark.scheme import Scheme

EPS = np.finfo(float).eps
#: Forms in which large problems are solved exactly, which takes its time.
ALSO_LARGE = ["u-lambda", "u-v-a-lambda"]
VARIANTS = ["none", "left", "right", "optimal"]
SUBJECTS = ["pendulum", "andrews", "four-bar", "slider-crank", "shaken-pendulum", "chain", "bars"]


def subject_of(name):
    """A shipped problem, or a member of a family: small ones are written out, others not."""
    sizes = {"chain": ("random-chain", "links", 60), "bars": ("four-bars", "windows", 20)}
    if name not in sizes:
        return problem(name)
    family, size, count = sizes[name]
    return Sized(family, ((size, count),)).load()


def solved_exactly(system, values, rhs):
    """J̄⁻¹ rhs, rounded: refined with residuals of the binary numbers in 100 digits."""
    found = system.elimination
    rows, columns = (np.empty(found.size) for _ in range(2))
    for units, side, of in zip((rows, columns), found.lists.order, found.units, strict=True):
        units[side] = np.abs(of)
    matrix = scipy.sparse.coo_array(system.matrix(values))
    scaled = scipy.sparse.diags_array(rows) @ matrix @ scipy.sparse.diags_array(columns)
    factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(scaled))
    with decimal.localcontext(decimal.Context(prec=100)):
        entries = [
            (i, j, Decimal(value))
            for i, j, value in zip(
                *(of.tolist() for of in (*matrix.coords, matrix.data)), strict=True
            )
        ]
        solution = [Decimal(0)] * found.size
        for _ in range(40):
            left = [Decimal(value) for value in rhs.tolist()]
            for i, j, value in entries:
                left[i] -= value * solution[j]
            change = columns * factors.solve(rows * np.array(left, float))
            solution = [x + Decimal(by) for x, by in zip(solution, change.tolist(), strict=True)]
            rounded = np.array(solution, float)
            if np.all(np.abs(change) <= 1e-25 * np.abs(rounded)):
                return rounded
    raise AssertionError("the factors have no digit")


def error(system, found, expected):
    """‖found − expected‖ over ‖expected‖, in units in which the blocks compare."""
    problem, scheme = system.problem, system.scheme
    _, right = scaling_factors(scheme, problem.n, problem.m)
    _, balanced = balancing_factors(scheme, problem.n, problem.m)
    return np.linalg.norm(right / balanced * (found - expected)) / np.linalg.norm(
        right / balanced * expected
    )


@each("name", SUBJECTS)
def test_solutions_are_right_whatever_the_scaling(name):
    """To rounding times the condition of the optimally scaled matrix, down to h = 1e-7.

    Unscaled too, where partial pivoting of forms with row K is not.
    """
    subject = subject_of(name)
    state = in_motion(subject)
    values = subject.values(0.0, state.fields[0], state.fields[1], state.multipliers)
    random = np.random.default_rng(5)
    large = subject.n > 30
    cases = covering(
        (1e-3, 1e-5, 1e-7),
        ALSO_LARGE if large else FORMS,
        ("none", "optimal") if large else VARIANTS,
    )
    for h, form, variant in cases:
        best = DenseSystem(subject, scheme_of(form, "optimal", h)).balanced(0.0, state)
        bound = 20 * EPS * np.linalg.cond(best.system.dense(best.balanced))
        system = StaticSystem(subject, scheme_of(form, variant, h))
        rhs = random.normal(size=system.elimination.size)
        rhs *= np.repeat(system.scheme.left, system.scheme.form.sizes(subject.n, subject.m))
        sources, tables = system.elimination.sources(values), system.elimination.tables
        found = rhs.copy()
        assert system.elimination.solve(sources, found, *tables) == 0, (h, form, variant)
        expected = solved_exactly(system, values, rhs)
        assert error(system, found, expected) < bound, (h, form, variant)
        lists = rhs.copy()
        assert static_elimination.solve_in_order(sources, lists, *tables) == 0
        np.testing.assert_allclose(lists, found, rtol=1e-9, atol=0)


@each("name", ["andrews", "bars"])
@each("form", FORMS)
def test_solves_what_the_engines_solve(name, form):
    """The matrix is the one that the dense and the sparse engine assemble."""
    subject = subject_of(name)
    state = in_motion(subject)
    values = subject.values(0.0, state.fields[0], state.fields[1], state.multipliers)
    for variant in ("none", "optimal"):
        scheme = scheme_of(form, variant, 1e-4)
        ours = StaticSystem(subject, scheme).matrix(values).toarray()
        for other in (DenseSystem(subject, scheme), SparseSystem(subject, scheme)):
            theirs = other.matrix(values).toarray()
            assert np.all(np.abs(ours - theirs) <= 8 * EPS * np.abs(theirs))


@each("form", FORMS)
def test_does_not_see_a_scaling_by_powers_of_two(form):
    """The solution is the same numbers, but for the scaling, bit by bit."""
    subject, form = problem("andrews"), FORMS[form]
    exponents = iter(range(-40, 60, 7))
    of = {name: Monomial(2.0 ** next(exponents)) for name in (*form.rows, *form.unknowns)}
    powers = Scaling(
        "powers", {row: of[row] for row in form.rows}, {u: of[u] for u in form.unknowns}
    )
    state = in_motion(subject)
    values = subject.values(0.0, state.fields[0], state.fields[1], state.multipliers)
    found, rhs = [], np.random.default_rng(1).normal(size=sum(form.sizes(subject.n, subject.m)))
    for scaling in (named_scaling("none", form), powers):
        scheme = Scheme(Newmark(), form, scaling, 1e-4)
        left, right = scaling_factors(scheme, subject.n, subject.m)
        found.append(right * StaticSystem(subject, scheme).solve(values, left * rhs))
    np.testing.assert_array_equal(*found)


@each(
    "name, form, variant, integrator, evaluation",
    [
        ("andrews", "u-lambda", "none", Newmark(), "direct"),
        ("andrews", "u-v-a-lambda", "optimal", GeneralizedAlpha(0.9), "compensated"),
        ("four-bar", "v-lambda", "left", BDF2(), "compensated"),
        ("shaken-pendulum", "a-lambda", "right", GeneralizedAlpha(0.5), "direct"),
        ("chain", "u-v-lambda", "optimal", BDF2(), "direct"),
        ("bars", "u-a-lambda", "optimal", Newmark(), "compensated"),
        ("bricard", "u-lambda", "optimal", GeneralizedAlpha(0.9), "direct"),
        ("governor", "u-v-a-lambda", "optimal", GeneralizedAlpha(0.9), "compensated"),
    ],
)
@each("h", [1e-4, 1e-6])
def test_marches_like_partial_pivoting(name, form, variant, integrator, evaluation, h):
    """Positions agree to rounding, corrections saturate at the same size."""
    subject = subject_of(name)
    scheme = scheme_of(form, variant, h, integrator, evaluation=evaluation)
    marches = [March(subject, scheme, solver) for solver in (STATIC, DENSE)]
    norms = [one.advance(30).norms for one in marches]
    difference = marches[0].state.fields[0] - marches[1].state.fields[0]
    assert np.linalg.norm(difference) < 2e-13 * np.linalg.norm(subject.u0)
    sizes = [np.sqrt(np.mean(one**2, axis=0)) for one in norms]
    assert np.all(sizes[0] < 5 * sizes[1])
    assert np.all(sizes[1] < 5 * sizes[0])


@given(st.integers(2, 14), st.integers(0, 2**32 - 1), st.floats(0.05, 0.6))
def test_fill_is_that_of_the_elimination(size, seed, density):
    """The analysis finds what an elimination of zeros and ones fills, and nothing else."""
    random = np.random.default_rng(seed)
    pattern = random.random((size, size)) < density
    np.fill_diagonal(pattern, True)
    columns, rows = np.nonzero(pattern.T)
    starts = np.searchsorted(columns, np.arange(size + 1))
    upper_starts, upper_rows, lower_starts, lower_rows = static_elimination.analyse(
        size, starts, rows
    )
    filled = pattern.copy()
    for k in range(size):
        filled[k + 1 :, k + 1 :] |= np.outer(filled[k + 1 :, k], filled[k, k + 1 :])
    for j in range(size):
        upper = upper_rows[upper_starts[j] : upper_starts[j + 1]]
        lower = lower_rows[lower_starts[j] : lower_starts[j + 1]]
        np.testing.assert_array_equal(upper, np.flatnonzero(filled[:j, j]))
        np.testing.assert_array_equal(lower, j + 1 + np.flatnonzero(filled[j + 1 :, j]))


def test_condition_numbers_reuse_the_factors():
    """Estimated in the 1-norm: at most the condition number, at least a third of it."""
    subject = Sized("random-chain", (("links", 120),)).load()
    scheme = scheme_of("u-lambda", "none", 1e-3)
    system, state = StaticSystem(subject, scheme), start(subject)
    found = system.balanced(0.0, state).condition()
    values = subject.values(0.0, state.fields[0], state.fields[1], state.multipliers)
    true = np.linalg.cond(system.matrix(values).toarray(), 1)
    assert true / 3 < found < true * (1 + 1e-6)
    assert found == pytest.approx(SparseSystem(subject, scheme).balanced(0.0, state).condition())


# -- what it refuses --------------------------------------------------------------------------

#: Two links upside down under a weight that makes X outweigh M/(βh²).
TOPPLING = {
    "title": "Two links upside down",
    "points": {
        "O": {"fixed": [0, 0]},
        "A": {"at": [0, 1], "velocity": [1e-4, 0], "mass": 1},
        "B": {"at": [0, 2], "velocity": [-1e-4, 0], "mass": 1},
    },
    "bars": {
        "one": {"from": "O", "to": "A", "length": 1},
        "two": {"from": "A", "to": "B", "length": 1},
    },
    "gravity": [0, -1e4],
}


@pytest.fixture
def toppling():
    """The mechanism."""
    return newmark.problem(TOPPLING)


@each("h", [0.02, 0.03])
@each("form", ["u-lambda", "a-lambda", "u-v-a-lambda"])
def test_what_needs_pivoting_is_pivoted(toppling, form, h):
    """Where X makes pivots vanish or negative, the march is that of partial pivoting.

    At h = 0.02 the weight of B cancels 4 m/h² but for rounding.
    """
    scheme = scheme_of(form, "optimal", h)
    static, dense = (March(toppling, scheme, solver) for solver in (STATIC, DENSE))
    stretch = static.advance(6)
    dense.advance(6)
    assert stretch.pivoted >= 5
    for ours, theirs in zip(static.state.fields, dense.state.fields, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())
    # In a small step M/(βh²) outweighs the same X.
    assert March(toppling, scheme_of(form, "none", 1e-4), STATIC).advance(50).pivoted == 0


@each("form", ["u-lambda", "v-lambda", "u-v-a-lambda"])
def test_lists_refuse_what_code_refuses(toppling, form):
    """A negative pivot, and a positive one that is too small; nothing is overwritten."""
    refused = 0
    for h in (0.015, 0.02, 0.03):
        system = StaticSystem(toppling, scheme_of(form, "optimal", h)).elimination
        for weight in (1.0, 1 - 1e-5, 1 - 1e-9):
            load = np.array([2e4, 1e4]) * weight
            values = toppling.values(0.0, toppling.u0, toppling.v0, load)
            codes = []
            for solve in (static_elimination.solve_generated, static_elimination.solve_in_order):
                rhs = np.ones(system.size)
                codes.append(solve(system.sources(values), rhs, *system.tables))
                assert codes[-1] == 0 or np.all(rhs == 1)
            assert codes[0] == codes[1]
            refused += codes[0] == PIVOTING
    assert refused >= 5


@each("solve", [static_elimination.solve_generated, static_elimination.solve_in_order])
def test_large_multipliers_are_refused(solve):
    """One link upside down: λ cancels the pivot 4 m/h² but for a part of it, which stays positive.

    The elimination's multiplier is its reciprocal; at most 1e4 is allowed.
    """
    one = {**TOPPLING, "points": {**TOPPLING["points"]}, "bars": {"one": TOPPLING["bars"]["one"]}}
    del one["points"]["B"]
    subject = newmark.problem(one)
    system = StaticSystem(subject, scheme_of("u-lambda", "optimal", 0.02)).elimination
    for part, code in ((1e-2, 0), (3e-4, 0), (3e-5, PIVOTING), (1e-9, PIVOTING)):
        load = np.array([(1 - part) * 4 / 0.02**2])
        values = subject.values(0.0, subject.u0, subject.v0, load)
        rhs = np.ones(system.size)
        assert solve(system.sources(values), rhs, *system.tables) == code, part


@njit(nogil=True, error_model="numpy")
def refuse(sources, rhs, constant, places, origins, coefficients, structure, room, work):
    """An elimination that finds no pivot."""
    return PIVOTING


def test_large_matrices_are_pivoted_by_a_sparse_solver():
    """Too large for a dense matrix, a correction that is refused is that of the sparse march."""
    subject = Sized("random-chain", (("links", 120),)).load()
    scheme = scheme_of("u-lambda", "optimal", 1e-3)
    static, sparse = (March(subject, scheme, solver) for solver in (STATIC, SPARSE))
    before = static.advance(2)
    static._engine._solve = refuse
    refused = static.advance(4, [3, 6])
    assert (before.pivoted, refused.pivoted) == (0, 4)
    expected = sparse.advance(6, [3, 6])
    np.testing.assert_allclose(
        refused.record.fields[:, 0], expected.record.fields[:, 0], rtol=0, atol=1e-11
    )
    assert np.all(refused.iterations > 0)


def test_pivoted_steps_are_in_the_provenance(cli, tmp_path):
    """A study says of every cell how many steps were left to partial pivoting."""
    (tmp_path / "toppling.yaml").write_text(yaml.safe_dump(TOPPLING), encoding="utf-8")
    study = {
        "study": "upside-down",
        "problem": "toppling.yaml",
        "form": "u-lambda",
        "preconditioning": "optimal",
        "linear_solver": [STATIC, DENSE],
        "h": [0.02, 1e-4],
        "steps": 6,
    }
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study), encoding="utf-8")
    cli("run", "study.yaml", "--results", "out")
    cells = json.loads((tmp_path / "out/upside-down.json").read_text(encoding="utf-8"))["cells"]
    counts = {(cell["linear_solver"], cell["h"]): cell.get("pivoted_steps") for cell in cells}
    assert len(counts) == 4
    assert {float(h) for (_, h), count in counts.items() if count} == {0.02}
    assert {solver for (solver, _), count in counts.items() if count} == {STATIC}
    assert max(count or 0 for count in counts.values()) >= 5


# -- which one is taken -----------------------------------------------------------------------


def test_auto_takes_it_where_it_is_much_faster():
    """Of more than 40 unknowns, index 3 and float64; elsewhere dense matrices up to 300."""
    form = FORMS["u-lambda"]
    sizes = 13, 14, 100, 101
    small, middle, dense, large = (Sized("chain", (("links", size),)).load() for size in sizes)
    assert choose(AUTO, small, form) == DENSE
    assert choose(AUTO, middle, form) == STATIC
    assert choose(AUTO, middle, form, precision="float32") == DENSE
    assert choose(AUTO, dense, form, formulated=True) == DENSE
    assert choose(AUTO, large, form) == STATIC
    assert choose(AUTO, large, form, formulated=True) == SPARSE


@each("name, most", [("governor", 2_000), ("bricard", 3_000), ("spatial-slider-crank", 700)])
def test_pivots_by_size_in_space(name, most):
    """They take a small part of the operations, and last for the whole motion but for a few steps.

    A pivot that is small at times is left to partial pivoting.
    """
    subject = problem(name)
    scheme = scheme_of("u-lambda", "optimal", 1e-3, GeneralizedAlpha(0.8))
    lists = StaticSystem(subject, scheme).elimination.lists
    assert (lists.operations < most, lists.signed) == (True, False)
    static, dense = (March(subject, scheme, solver) for solver in (STATIC, DENSE))
    assert static.advance(1500).pivoted < 150
    dense.advance(1500)
    for ours, theirs in zip(static.state.fields[:2], dense.state.fields[:2], strict=True):
        assert np.linalg.norm(ours - theirs) < 1e-7 * np.linalg.norm(theirs)


def test_no_order_of_a_singular_matrix():
    """No pivot is left; zeros of a regular one are none."""
    rows, columns = np.indices((3, 3)).reshape(2, -1)
    assert order_by_size(np.ones((3, 3)), rows, columns) is None
    found = order_by_size(np.array([[0.0, 1, 0], [1, 0, 0], [0, 1, 1]]), rows, columns)
    assert sorted(zip(*map(np.ndarray.tolist, found), strict=True)) == [(0, 1), (1, 0), (2, 2)]
