"""F(t, y, y') = 0 for codes that solve general DAEs, and tolerances to set in them."""

import functools
import itertools

import numpy as np
import pytest

import newmark_cli as newmark
from newmark_cli.problems import reference
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.residual_form import ROWS

SOLUTIONS = {
    name: (t, functools.cache(lambda name=name, t=t: reference.solution(newmark.problem(name), t)))
    for name, t in (("shaken-pendulum", 0.2), ("heavy-top", 0.003))
}
EVERY = pytest.mark.parametrize(
    ("name", "equations", "integrals"), [*itertools.product(SOLUTIONS, ROWS, (False, True))]
)


@EVERY
def test_a_motion_solves_the_equations(name, equations, integrals):
    """Driven and in space: F vanishes along the reference, and not next to it."""
    problem, (t, solved) = newmark.problem(name), SOLUTIONS[name]
    at, dae = solved(), newmark.dae(problem, equations, integrals=integrals)
    a, _ = Index1(problem).accelerations(t, at.u, at.v)
    y, yp = np.zeros((2, len(dae.y0)))
    n, m = problem.n, problem.m
    y[: 2 * n], yp[: 2 * n] = np.concatenate([at.u, at.v]), np.concatenate([at.v, a])
    (yp if integrals else y)[2 * n : 2 * n + m] = at.multipliers
    size = np.abs(problem.evaluate(t, at.u, at.v, at.multipliers).force).max() + np.abs(a).max()
    size = max(size, np.abs(problem.M @ a).max())
    assert np.abs(dae.residual(t, y, yp)).max() < 1e-9 * size
    assert np.abs(dae.residual(dae.t0, dae.y0, dae.yp0)).max() < 1e-9 * size
    assert np.abs(dae.residual(t, y * 1.01, yp)).max() > 1e-4 * size
    for found, expected in zip(dae.state(y, yp), (at.u, at.v, at.multipliers), strict=True):
        assert np.array_equal(found, expected)


@EVERY
def test_jacobians_are_those_of_differences(name, equations, integrals):
    dae = newmark.dae(name, equations, integrals=integrals)
    random = np.random.default_rng(1)
    y, yp = (x + random.normal(size=len(x)) for x in (dae.y0, dae.yp0))
    size = 1e-5 * np.eye(len(y))
    for found, on_y in zip(dae.jacobian(0.3, y, yp), (1, 0), strict=True):
        columns = [
            [dae.residual(0.3, y + sign * on_y * step, yp + sign * (1 - on_y) * step)
             for sign in (1, -1)] for step in size
        ]  # fmt: skip
        expected = np.array([(after - before) / 2e-5 for after, before in columns]).T
        assert np.abs(found - expected).max() < 1e-6 * max(1.0, np.abs(expected).max())
