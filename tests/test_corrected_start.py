"""Corrected starts: from them the trapezoidal rule's multipliers do not alternate."""

from functools import cache

import numpy as np
import pytest
from each import each
from marching import march
from mechanisms import built
from mpmath import matrix, mp, mpf

from newmark_cli.newmark import compiled_march
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import HHT, GeneralizedAlpha, Newmark
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import COMPENSATED, Scheme
from newmark_cli.problems import python_problem
from newmark_cli.problems.starting import constraint_jerk, corrected_velocity

THROWN = """\
points:
  O: {fixed: [0, 0]}
  P: {at: [1, 0], mass: MASS, velocity: [0, 1]}
bars:
  rod: {from: O, to: P, length: 1}
gravity: [0, -1]
"""
TRAPEZOIDAL = [Newmark(), GeneralizedAlpha(1.0), HHT(0.0)]


def thrown(mass="1"):
    """The pendulum thrown from the horizontal with v₀ = 1."""
    return built(THROWN.replace("MASS", mass))


@cache
def swinging():
    """Angle of the thrown pendulum and its rate at any time, to 25 digits."""
    # It keeps the series that it has found: one for all times is one integration.
    return mp.odefun(lambda _, y: [y[1], -mp.cos(y[0])], 0, [mpf(0), mpf(1)], tol=mpf(10) ** -25)


def exact(t):
    """λ of the thrown pendulum, y − |v|²."""
    with mp.workdps(30):
        angle, rate = swinging()(mpf(t))
        return float(mp.sin(angle) - rate**2)


def multiplier(subject, h, t, integrator=None, evaluation=COMPENSATED, correct=None):
    """λ at time t; ``correct`` takes the start and h to a corrected v₀."""
    form = FORMS["u-lambda"]
    scaling = named_scaling("optimal", form)
    scheme = Scheme(integrator or Newmark(), form, scaling, h, evaluation=evaluation)
    state = initial_state(subject, scheme)
    if correct is not None:
        # v and, of the past, v: the accelerations stay as they were.
        fields = state.fields.copy()
        fields[1] = correct(subject, h)
        state = state._replace(fields=fields, past=scheme.relations.start @ fields[:3])
    march(compiled_march, subject, scheme, state, 0, round(t / h))
    return state.multipliers[0]


def worst_near(subject, h, t, integrator, correct):
    """Largest error of λ in four steps from t: what oscillates may vanish at one."""
    times = [t + k * h for k in range(4)]
    return max(
        abs(multiplier(subject, h, s, integrator, correct=correct) - exact(s)) for s in times
    )


RIPPLES = """
import numpy as np
from newmark_cli.problems.python_problem import Definition

def wave(t):
    return 0.1 * np.sin(3 * t + 0.5)

def factory(given=False):
    def curvature(u, v, t):
        c, s = np.cos(3 * u[0]), np.sin(3 * u[0])
        return np.array([1.8 * s * v[0]**2 + 2 * v[1]**2 + 9 * wave(t),
                         2 * (v[0]*v[0] + v[1]*v[1] + v[2]*v[2])])
    v = np.array([0.4, -0.2, 0.3])
    gradient = lambda u, t: np.array(
        [[-0.6 * np.cos(3 * u[0]), 2 * u[0]], [2 * u[1], 2 * u[1]], [1.0, 2 * u[2]]])
    constraints = lambda u, t: np.array(
        [u[2] + u[1]**2 - 0.2 * np.sin(3 * u[0]) - wave(t) - A, u @ u - B])
    u0 = np.array([0.5, 0.4, 0.7])
    G = gradient(u0, 0.0)
    v = v - np.linalg.pinv(G.T) @ (G.T @ v + np.array([-0.3 * np.cos(0.5), 0.0]))
    return Definition(
        mass_matrix=np.diag([1.0, 2.0, 3.0]), u0=u0, v0=v,
        force=lambda u, v, t: np.array([np.sin(t) - u[1], -v[0] * v[2], -9.81]),
        constraints=constraints, gradient=gradient, curvature=curvature if given else None,
    )
""".replace("- A", f"- {0.7 + 0.16 - 0.2 * np.sin(1.5) - 0.1 * np.sin(0.5)!r}").replace(
    "- B", "- 0.9"
)


def ripples_jerk(subject):
    """Gᵀu‴ at the start in mpmath: u'' from the index-1 system, once more by differences."""

    def gradient(u):
        return matrix([[-mpf(3) / 5 * mp.cos(3 * u[0]), 2 * u[0]], [2 * u[1]] * 2, [1, 2 * u[2]]])

    def acceleration(u, v, t):
        c = mpf(9) / 5 * mp.sin(3 * u[0]) * v[0] ** 2 + 2 * v[1] ** 2
        curvature = [c + mpf(9) / 10 * mp.sin(3 * t + 0.5), 2 * sum(x**2 for x in v)]
        force = [mp.sin(t) - u[1], -v[0] * v[2], mpf(-9.81)]
        bordered, g = matrix(5, 5), gradient(u)
        for i in range(3):
            bordered[i, i] = i + 1
            for k in range(2):
                bordered[i, 3 + k], bordered[3 + k, i] = -g[i, k], g[i, k]
        return list(mp.lu_solve(bordered, matrix([*force, *(-x for x in curvature)])))[:3]

    with mp.workdps(50):
        u, v = ([mpf(float(x)) for x in array] for array in (subject.u0, subject.v0))
        a, step = acceleration(u, v, mpf(0)), mpf(10) ** -15

        def then(s):
            place = [x + s * y + s**2 * z / 2 for x, y, z in zip(u, v, a, strict=True)]
            return acceleration(place, [y + s * z for y, z in zip(v, a, strict=True)], s)

        third = [(p - q) / (2 * step) for p, q in zip(then(step), then(-step), strict=True)]
        return np.array([float(x) for x in gradient(u).T * matrix(third)])


@each("given", [False, True])
def test_the_jerk_where_constraints_are_neither_quadratic_nor_free_of_time(tmp_path, given):
    """Against mpmath: Φ'' differentiated along the motion, given by the user or computed."""
    path = tmp_path / "mine.py"
    path.write_text(RIPPLES)
    subject = python_problem.load(path, "factory", {"given": given}, "mine")
    expected = ripples_jerk(subject)
    np.testing.assert_allclose(
        constraint_jerk(subject), expected, rtol=0, atol=1e-8 * np.abs(expected).max()
    )
    # Least change in the norm of M: M δv is in the range of G.
    change = corrected_velocity(subject, 0.01) - subject.v0
    gradient = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(2)).G
    np.testing.assert_allclose(gradient.T @ change, -1e-4 / 12 * expected, rtol=1e-6)
    pulled = subject.M @ change
    inside = gradient @ np.linalg.lstsq(gradient, pulled, rcond=None)[0]
    np.testing.assert_allclose(inside, pulled, rtol=0, atol=1e-9 * np.abs(pulled).max())


def test_corrected_starts_give_multipliers_of_order_two():
    """The thrown pendulum at t = 1, compensated: 1.9e-6 at h = 1e-3, in every spelling."""
    subject = thrown()
    h = np.array([4e-3, 2e-3, 1e-3])
    usual, *spellings = TRAPEZOIDAL
    errors = [worst_near(subject, s, 1.0, usual, corrected_velocity) for s in h]
    assert np.polyfit(np.log(h), np.log(errors), 1)[0] == pytest.approx(2, abs=0.05)
    assert errors[-1] == pytest.approx(1.9e-6, rel=0.1)
    for integrator in spellings:
        error = worst_near(subject, h[0], 1.0, integrator, corrected_velocity)
        assert error == pytest.approx(errors[0], rel=1e-6), integrator.label
