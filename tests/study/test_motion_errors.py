"""Errors over the motion, of marches and of rows of other codes."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import newmark_cli as newmark
from newmark_cli.codes.reading import Run
from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import integrator_labels, steps
from newmark_cli.newmark.formulation import Formulation, Projection
from newmark_cli.newmark.truncation import Marched
from newmark_cli.problems import reference
from newmark_cli.study.cell import Window
from newmark_cli.study.observers import AFTER, MOST_LOOKS, looked_at
from newmark_cli.study.replay import deviations

H, T_END = 0.01, 1.5
STUDY = f"""\
study: along
problem: pendulum
form: a-lambda
preconditioning: optimal
integrator: generalized-alpha rho=0.9
measure: error
error: {{over: MOTION}}
twins: 1
h: [{H}]
t_end: {T_END}
"""


def exact(t):
    """u, v and λ of the pendulum by its angle, from rest; λ = 3 y there."""
    u0 = problem("pendulum").u0

    def rates(_, state):
        return [state[1], -np.sin(state[0])]

    start = [np.arctan2(u0[0], -u0[1]), 0.0]
    of = solve_ivp(rates, (0, T_END), start, "DOP853", t, rtol=1e-13, atol=1e-13)
    angle, rate = of.y
    u = np.column_stack([np.sin(angle), -np.cos(angle)])
    v = rate[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return u, v, 3 * u[:, 1:]


@pytest.mark.parametrize(("over", "since"), [("motion", 0.0), ("[0.5, 1.2]", 0.5)])
def test_largest_errors(cli, over, since):
    """Those of all steps of the window, over the largest of the exact motion there."""
    cli.write("along.yaml", STUDY.replace("MOTION", over))
    cli("run", "along.yaml")
    rows = pd.read_csv(cli.folder / "results" / "along.csv")
    name = "window_error" if since else "motion_error"
    assert [*rows.measure] == ["error"] * 3 + [name] * 3
    marched = newmark.march("pendulum", h=H, t_end=T_END, integrator="generalized-alpha rho=0.9",
                            form="a-lambda")  # fmt: skip
    there = (marched.t > since + 1e-9) & (marched.t <= (1.2 if since else T_END) + 1e-9)
    t = np.append(0.0, marched.t[there])
    ours = (marched.u[there], marched.v[there], marched.multipliers[there])
    for quantity, here, true in zip(("u", "v", "lambda"), ours, exact(t), strict=True):
        largest = np.abs(here - true[1:]).max() / np.abs(true[1:]).max()
        row = rows[(rows.measure == name) & (rows.quantity == quantity)].iloc[0]
        assert row["max"] == pytest.approx(largest, rel=1e-6)
        assert 0 < row["rounding"] < 1e-9


def test_reference_along_the_motion():
    t = np.array([0.1, 0.4, 1.5])
    for ours, theirs in zip(reference.along(problem("pendulum"), t), exact(t), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-11)


def test_rows_of_another_code():
    """Errors of rows in a window are those that were put into them; a column without numbers
    has none.
    """
    subject, t = problem("pendulum"), np.linspace(0, T_END, 16)
    u, v, multipliers = exact(t)
    u[7] += [0.0, 1e-3]
    u[2] += [0.0, 1e-2]
    state = {"u": u, "v": v, "lambda": np.full_like(multipliers, np.nan)}
    run, end = Run("", 0.1, 0, t, state, {}), reference.solution(subject, T_END)
    found = deviations(run, subject, end, Window(0.5, 1.2))
    assert np.abs(found["window_error u"]).max() == pytest.approx(
        1e-3 / np.abs(exact(t)[0][6:13]).max(), rel=1e-8
    )
    assert np.abs(found["window_error v"]).max() < 1e-10
    assert "window_error lambda" not in found
    assert not any("window_error" in name for name in deviations(run, subject, end))


def test_steps_that_are_looked_at():
    assert [*looked_at(1, MOST_LOOKS)] == [*range(1, MOST_LOOKS + 1)]
    long = looked_at(101, 50_000, [30_001])
    assert len(long) <= MOST_LOOKS
    assert long[-1] == 50_000
    for begin in (101, 30_001):
        assert {*range(begin, begin + AFTER)} <= {*long.tolist()}


@pytest.mark.parametrize(
    ("rule", "formulation", "projection", "orders"),
    [
        ("generalized-alpha rho=0.9", "index-3", "none", (2, 1, 2)),
        ("bdf2", "ggl", "none", (2, 1, 2)),
        ("bdf1", "index-3", "none", (1, np.nan, 1)),
        ("newmark beta=0.25 gamma=0.5", "index-3", "none", (2, np.nan, np.nan)),
        ("generalized-alpha rho=0.9", "index-3", "velocity", (2, 2, 2)),
    ],
)
def test_predicted_orders(rule, formulation, projection, orders):
    """Of u over the motion, of λ over the motion, and of λ in a later window."""
    march = Marched(
        integrator_labels.parse(rule), Formulation.parse(formulation), Projection.parse(projection),
        "recovered" if projection == "velocity" else "newton", "consistent", False, steps.CONSTANT,
    )  # fmt: skip
    found = [march.largest_error(*of) for of in (("u", True), ("lambda", True), ("lambda", False))]
    np.testing.assert_array_equal(found, orders)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("error: {over: start}", "error.over: must be 'motion'"),
        ("error: {over: [1, 0.5]}", "error.over: must be [t0, t1] with 0 ≤ t0 < t1"),
        ("error: {over: [1, 2]}", "error: over ends at 2, and the march at 1.5"),
        ("measure: invariant", "error: needs 'measure: error'"),
        ("measure: transient", "it is gone: take measure: error and error: {over: [t0, t1]}"),
    ],
)
def test_mistakes(cli, given, told):
    key = given.partition(":")[0]
    lines = [line for line in STUDY.splitlines() if not line.startswith(f"{key}:")]
    cli.write("along.yaml", "\n".join([*lines, given]).replace("MOTION", "motion") + "\n")
    assert told in cli("validate", "along.yaml", code=2).stderr
