"""Partial pivoting by code for known row exchanges: the same bits as by loops, or given up."""

import numpy as np
import pytest
from marching import STEP, formulated, scheme_of

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.engine import Engine
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear import assembly, dense
from newmark_cli.newmark.linear.written import exchanges, generated
from newmark_cli.newmark.linear.written.static_elimination import solve_generated
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.march_data import COMPLETED, PIVOTING, counting
from newmark_cli.newmark.newton import solve_in_place

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
        ("heavy-top", "a-lambda", "optimal", GeneralizedAlpha(0.8), "direct", "float64"),
        pytest.param(
            "double-pendulum", "v-a-lambda", "left", Newmark(), "compensated", "float32",
            marks=pytest.mark.release,
        ),
    ],
)  # fmt: skip
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


def test_code_at_hand_is_tried_in_turn():
    """What one gives up, the next solves, and comes first from then on; else nothing changes."""
    subject, scheme = problem("andrews"), scheme_of("u-lambda", "optimal", 1e-5)
    tables = run(subject, scheme, 3, 20)[0].exchanges.tables
    sums, _ = assembly.of_formulation(subject, scheme.tables)
    matrices = dense.dense_tables(subject, scheme, sums)
    values = subject.values(subject.t0, subject.u0, subject.v0, np.zeros(subject.m))
    matrix, sources = dense.assembled(matrices, scheme, values), assembly.sources(values)
    size = len(matrix)
    right, others = (
        exchanges._written(exchanges.row_order(each), subject, scheme, matrices).address()
        for each in (matrix, matrix * np.geomspace(1, 1e6, size)[:, None])
    )
    expected, rhs = np.arange(1.0, size + 1), np.arange(1.0, size + 1)
    assert solve_in_place(matrix, expected, np.empty(size, np.uint64), np.empty(size))
    room = np.array([others, 0, 0], np.uint64)
    assert solve_generated(sources, rhs, *tables._replace(room=room)) == PIVOTING
    np.testing.assert_array_equal(rhs, np.arange(1.0, size + 1))
    room = np.array([others, right, 0], np.uint64)
    assert solve_generated(sources, rhs, *tables._replace(room=room)) == COMPLETED
    np.testing.assert_array_equal(rhs, expected)
    assert room.tolist() == [right, others, 0]


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
