"""Partial pivoting by code for known row exchanges: the same bits as by loops, or given up."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from marching import STEP, formulated, scheme_of

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import newton
from newmark_cli.newmark.engine import Engine
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear.assembly import Constants, Sums
from newmark_cli.newmark.linear.ordering import Order
from newmark_cli.newmark.linear.written import exchanges, generated, static_elimination
from newmark_cli.newmark.linear.written.generated import Written
from newmark_cli.newmark.linear.written.lists import EliminationLists
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.march_data import COMPLETED, PIVOTING, counting
from newmark_cli.support import machine_code

NEVER = 10**9


def run(subject, scheme, stretches, looks_after, after_stretch=lambda exchanges: None):
    """The engine after stretches of 20 steps, and all that these leave behind."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("_BETWEEN", "_WORTH"):
            patch.setattr(exchanges, name, looks_after)
        engine, state, found = Engine(subject, scheme), initial_state(subject, scheme), []
        for k in range(stretches):
            counts = counting(20, len(scheme.recorded))
            assert engine.march(state, 20 * k, counts) == (COMPLETED, 20)
            found += [counts.norms, counts.iterations, *state.copy()]
            after_stretch(engine.exchanges)
    return engine, found


@pytest.mark.parametrize(
    ("subject", "form", "variant", "integrator", "evaluation", "precision"),
    [
        ("andrews", "u-lambda", "optimal", Newmark(), "direct", "float64"),
        ("slider-crank", "u-v-a-lambda", "left", BDF2(), "compensated", "float64"),
        ("four-bar", "u-v-lambda", "right", Newmark(), "direct", "float32"),
        ("heavy-top", "a-lambda", "optimal", GeneralizedAlpha(0.8), "direct", "float64"),
        ("double-pendulum", "v-a-lambda", "left", Newmark(), "compensated", "float32"),
    ],
)
def test_the_same_bits(subject, form, variant, integrator, evaluation, precision):
    """States, norms and iterations by code and by loops are equal."""
    scheme = scheme_of(
        form, variant, STEP[subject] / 10, integrator, evaluation=evaluation, precision=precision
    )
    subject = problem(subject)
    by_code, code = run(subject, scheme, 6, 20)
    by_loops, loops = run(subject, scheme, 6, NEVER)
    assert (by_code.exchanges.coded, by_loops.exchanges.coded) == (True, False)
    assert by_code.exchanges.given_up < 20
    for mine, theirs in zip(code, loops, strict=True):
        assert mine.dtype == theirs.dtype
        np.testing.assert_array_equal(mine, theirs)


def test_the_march_halts_where_code_is_given_up(monkeypatch):
    """After so many such steps, and not at the end of a stretch only."""
    halts, took = [], exchanges.Exchanges.took

    def seen(exchanges, given_up):
        halts.append(len(given_up))
        took(exchanges, given_up)

    monkeypatch.setattr(exchanges.Exchanges, "took", seen)
    monkeypatch.setattr(exchanges.Exchanges, "patience", 5)
    run(problem("andrews"), scheme_of("u-lambda", "optimal", 1e-3), 3, 20)
    assert halts == [20, *[5] * 8]


def test_no_code_for_formulations_or_much_fill(monkeypatch):
    """Systems with rows that the lists do not know, and eliminations with many operations."""
    scheme = formulated("index-2", "u-lambda", 1e-3)
    assert run(problem("pendulum"), scheme, 3, 20)[0].exchanges is None
    monkeypatch.setattr(generated, "OPERATIONS_AT_MOST", 20)
    scheme = scheme_of("u-lambda", "optimal", 1e-5)
    assert not run(problem("andrews"), scheme, 3, 20)[0].exchanges.coded
    assert run(problem("pendulum"), scheme, 3, 20)[0].exchanges.coded


#: Entries that are there; with as many zeros fill is to be seen.
THERE = np.array(
    [[1, 1, 0, 0, 1], [1, 0, 1, 0, 0], [1, 1, 0, 1, 0], [0, 0, 1, 1, 0], [1, 0, 0, 1, 1]], bool
)
ROWS, COLUMNS = np.nonzero(THERE)
NO_SUMS = Sums(*(np.empty(0, np.int64) for _ in range(3)), np.empty(0))


def code_for(rows, matrix):
    """Tables of an elimination in an order of rows, with the numbers of a matrix."""
    lists = EliminationLists(Order(np.array(rows), np.arange(5)), ROWS, COLUMNS)
    tables = lists.tables(Constants(ROWS, COLUMNS, matrix[ROWS, COLUMNS]), NO_SUMS, float)
    tables.room[static_elimination.ADDRESS] = Written(tables, pivoting=True).address()
    return tables


def order_of(matrix):
    """Rows as partial pivoting takes them, the first among equals; None when it fails."""
    matrix, rows = matrix.copy(), list(range(len(matrix)))
    for k in range(len(matrix)):
        sizes = [abs(entry) for entry in matrix[k:, k]]
        if max(sizes) == 0:
            return None
        at = k + sizes.index(max(sizes))
        matrix[[k, at]] = matrix[[at, k]]
        rows[k], rows[at] = rows[at], rows[k]
        reciprocal = 1 / matrix[k, k]
        for i in range(k + 1, len(matrix)):
            matrix[i, k:] -= matrix[i, k] * reciprocal * matrix[k, k:]
    return rows


@given(
    values=st.lists(st.integers(-3, 3), min_size=len(ROWS), max_size=len(ROWS)),
    rows=st.sampled_from([(0, 1, 2, 3, 4), (1, 0, 4, 3, 2), (2, 4, 1, 3, 0), (4, 2, 3, 0, 1)]),
    fit=st.booleans(),
)
@settings(max_examples=150)
def test_solved_or_given_up(values, rows, fit):
    """Whole numbers have many ties: what partial pivoting orders otherwise is given up."""
    matrix = np.zeros((5, 5))
    matrix[ROWS, COLUMNS] = values
    b, expected = np.arange(1.0, 6.0), np.arange(1.0, 6.0)
    wanted = order_of(matrix)
    rows = wanted if fit and wanted else list(rows)
    with pytest.MonkeyPatch.context() as patch:
        # A hundred files that nobody needs again.
        patch.setattr(machine_code, "kept_bytes", lambda owner, name, make, made_from: make())
        tables = code_for(rows, matrix)
    ending = static_elimination.solve_generated(np.empty(0), b, *tables)
    if wanted != rows:
        assert ending == PIVOTING
        np.testing.assert_array_equal(b, expected)
    else:
        assert ending == COMPLETED
        assert newton.solve_in_place(matrix, expected, np.empty(5, np.uint64), np.empty(5))
        np.testing.assert_array_equal(b, expected)
