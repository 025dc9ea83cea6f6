"""F(t, y, y') = 0 for codes that solve general DAEs, and tolerances to set in them."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from each import each

import newmark_cli as newmark
from newmark_cli.problems import reference
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.residual_form import ROWS

EXAMPLE = Path(__file__).parents[2] / "docs/examples/tolerances.py"
tolerances = runpy.run_path(str(EXAMPLE))["tolerances"]
#: Pendulum of two masses, in a unit of length, turned by an angle, at a distance from the origin.
ARMS = 0.3, 0.2


def double(unit=1.0, angle=0.0, away=0.0):
    along = np.array([np.cos(angle), np.sin(angle)])
    origin = np.array([away, away / 2]) * unit
    at = [origin + length * unit * along for length in (ARMS[0], sum(ARMS))]
    down = 9.81 * unit * np.array([along[1], -along[0]])
    return newmark.problem({
        "points": {"O": {"fixed": origin.tolist()}, "P": {"at": at[0].tolist(), "mass": 2.0},
                   "Q": {"at": at[1].tolist(), "mass": 1.0}},
        "bars": {"upper": {"from": "O", "to": "P", "length": ARMS[0] * unit},
                 "lower": {"from": "P", "to": "Q", "length": ARMS[1] * unit}},
        "gravity": down.tolist(),
    })  # fmt: skip


@each("name, t", [("shaken-pendulum", 0.2), ("heavy-top", 0.03)])
@each("equations", ROWS)
@each("integrals", [False, True])
def test_a_motion_solves_the_equations(name, t, equations, integrals):
    """Driven and in space: F vanishes along the reference, and not next to it."""
    problem = newmark.problem(name)
    at, dae = reference.solution(problem, t), newmark.dae(problem, equations, integrals=integrals)
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


@each("name", ["shaken-pendulum", "heavy-top"])
@each("equations", ROWS)
@each("integrals", [False, True])
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


def test_tolerances_follow_the_units_and_not_the_axes():
    """In millimetres and turned; a kilometre away rtol makes up for the distance."""
    (rtol, sizes), (_, turned), (_, small), (away, _) = (
        tolerances(double(**how), 1.0, 0.5)
        for how in ({}, {"angle": 0.7}, {"unit": 1e3}, {"away": 1e3})
    )
    assert turned == pytest.approx(sizes, rel=1e-3)
    assert small[:8] == pytest.approx(1e3 * sizes[:8], rel=1e-3)
    assert rtol == 1.0
    assert 5e-4 < away < 1e-3
    # Sizes: how far points move, and how fast they get.
    motion = newmark.march(double(), h=1e-3, t_end=0.5)
    far = np.linalg.norm((motion.u - motion.u[0])[:, 2:], axis=1).max()
    fast = np.linalg.norm(motion.v[:, 2:], axis=1).max()
    names = newmark.dae(double()).names
    assert sizes[names.index("u[Q.x]")] == pytest.approx(far, rel=0.05)
    assert sizes[names.index("v[Q.y]")] == pytest.approx(fast, rel=0.05)


def test_tolerances_of_integrals_are_what_errors_of_u_and_v_are_in_them():
    """Steps of backward Euler from starts that are off by as much as the tolerances of u and v."""
    problem, h = double(), 1e-4
    _, atol = tolerances(problem, 1e-7, 0.5)
    dae, random = newmark.dae(problem), np.random.default_rng(2)
    n, ends = problem.n, []
    for _ in range(60):
        past = dae.y0.copy()
        past[: 2 * n] += atol[: 2 * n] * random.normal(size=2 * n)
        y = past.copy()
        for _ in range(6):
            of_y, of_yp = dae.jacobian(h, y, (y - past) / h)
            y = y - np.linalg.solve(of_y + of_yp / h, dae.residual(h, y, (y - past) / h))
        ends.append(y[2 * n :])
    ratio = np.std(ends, axis=0) / atol[2 * n :]
    assert np.all((ratio > 0.1) & (ratio < 3)), ratio


@each("words", [
    ("advise", "andrews", "--code", "ida"), ("advise", "andrews", "--accuracy", "1e-3"),
])  # fmt: skip
def test_what_replaces_advice_for_dae_codes_is_said(cli, words):
    assert f"{words[2]}'; it is gone: docs/advice.md has lines to paste" in cli.refused(*words)
    with pytest.raises(AttributeError, match=r"it is gone: docs/advice\.md"):
        getattr(newmark, "advise_dae")  # noqa: B009
