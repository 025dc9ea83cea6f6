"""Φ' and Φ'' and their tangents of problems in Python, and projections and starts by them."""

from dataclasses import replace

import numba
import numpy as np
import oracles
import pytest
from damped import MASS, damped
from marching import scheme_of
from mpmath import mp, mpf

import newmark_cli as newmark
from newmark_cli.newmark.formulation import CORRECTED
from newmark_cli.newmark.march import initial_state
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.starting import constraint_jerk, corrected_velocity


def wavy_definition(decorate=lambda function: function, given=()):
    """A bead on a wavy floor that moves: Φ is neither quadratic nor free of time."""

    @decorate
    def force(u, v, t):
        return [0.0, 0.0, -9.81]

    @decorate
    def constraints(u, t):
        wave = 0.2 * np.sin(3 * u[0] + t) * np.cos(2 * u[1])
        return (u[2] - wave - 0.1 * np.sin(3 * t),)

    @decorate
    def gradient(u, t):
        c, s = np.cos(3 * u[0] + t), np.sin(3 * u[0] + t)
        return [[-0.6 * c * np.cos(2 * u[1])], [0.4 * s * np.sin(2 * u[1])], [1.0]]

    @decorate
    def constraint_rate(u, t):
        moving = -0.2 * np.cos(3 * u[0] + t) * np.cos(2 * u[1])
        return np.array([moving - 0.3 * np.cos(3 * t)])

    @decorate
    def curvature(u, v, t):
        c, s = np.cos(3 * u[0] + t), np.sin(3 * u[0] + t)
        p, q = 3 * v[0] + 1, 2 * v[1]
        bent = (p * p + q * q) * s * np.cos(2 * u[1]) + 2 * p * q * c * np.sin(2 * u[1])
        return np.array([0.2 * bent + 0.9 * np.sin(3 * t)])

    @decorate
    def rate_gradient(u, v, t):
        c, s = np.cos(3 * u[0] + t), np.sin(3 * u[0] + t)
        a, b, p, q = np.cos(2 * u[1]), np.sin(2 * u[1]), 3 * v[0] + 1, 2 * v[1]
        return (0.6 * (s * a * p + c * b * q),), (0.4 * (c * b * p + s * a * q),), (0.0,)

    @decorate
    def acceleration_gradient(u, v, w, t):
        c, s = np.cos(3 * u[0] + t), np.sin(3 * u[0] + t)
        a, b, p, q = np.cos(2 * u[1]), np.sin(2 * u[1]), 3 * v[0] + 1, 2 * v[1]
        x = 1.8 * w[0] * s * a + 1.2 * w[1] * c * b
        y = 1.2 * w[0] * c * b + 0.8 * w[1] * s * a
        x += 0.2 * (3 * (p * p + q * q) * c * a - 6 * p * q * s * b)
        y += 0.2 * (4 * p * q * c * a - 2 * (p * p + q * q) * s * b)
        return np.array([[x], [y], [0.0]])

    @decorate
    def damping(u, v, t):
        return [[0, 0, 0], [0, 0, 0], [0, 0, 0]]

    own = locals()
    return {
        "mass_matrix": np.eye(3),
        "u0": np.array([0.3, 0.2, 0.2 * np.sin(0.9) * np.cos(0.4)]),
        "v0": np.array([0.0, 0.0, 0.3 + 0.2 * np.cos(0.9) * np.cos(0.4)]),
        **{key: own[key] for key in ("force", "constraints", "gradient", *given)},
    }


def wavy(*how):
    """The problem of `wavy_definition`."""
    return newmark.problem(newmark.Definition(**wavy_definition(*how)))


def wavy_phi(u, t):
    return [u[2] - mp.sin(3 * u[0] + t) * mp.cos(2 * u[1]) / 5 - mp.sin(3 * t) / 10]


ALL = ("constraint_rate", "curvature", "rate_gradient", "acceleration_gradient")


def dense(subject, t, u, v, w):
    """Rate, curvature, R and Q with matrices in full."""
    rows, pattern = subject.constraint_rows(t, u, v, w), subject.pattern
    matrices = np.zeros((2, subject.m, subject.n))
    for matrix, values in zip(matrices, (rows.r, rows.q), strict=True):
        np.add.at(matrix, (pattern.g_columns, pattern.g_rows), values)
    return [rows.rate, rows.curvature, *matrices]


def anywhere(subject, seed):
    """A state near the start, off the constraints, with velocities and accelerations."""
    random = np.random.default_rng(seed)
    n = subject.n
    u = subject.u0 + 0.2 * random.normal(size=n)
    return u, 2 * random.normal(size=n), 5 * random.normal(size=n)


def assert_alike(found, expected, tolerances):
    """Four results, each to a share of its largest entry."""
    for one, other, tolerance in zip(found, expected, tolerances, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * np.abs(other).max())


@pytest.mark.parametrize(
    ("given", "compiled"),
    [((), False), (("curvature",), False), (ALL, False), ((*ALL, "damping"), True)],
)
def test_rows_against_mpmath(given, compiled):
    """Given ones exactly; what enters the residual by differences to 1e-10, tangents to 1e-9.

    Compiled differences are those of the car axis, in `test_formulations`: a second problem would
    take as long to compile.
    """
    subject = wavy(numba.njit if compiled else lambda function: function, given)
    assert (subject.compiled, subject.rows_given == "exact") == (compiled, given[:4] == ALL)
    for seed in range(4):
        u, v, w = anywhere(subject, seed)
        expected = oracles.constraint_rows(wavy_phi, 0.4, u, v, w)
        exact = [1e-14 if key in given else by for key, by in
                 zip(ALL, (1e-11, 1e-10, 1e-10, 1e-9), strict=True)]  # fmt: skip
        assert_alike(dense(subject, 0.4, u, v, w), expected, exact)
        rate, curvature = subject.constraint_derivatives(0.4, u, v)
        assert rate == pytest.approx(expected[0], rel=exact[0])
        assert curvature == pytest.approx(expected[1], rel=exact[1])
    # Whatever is returned is converted alike.
    plain, state = wavy(lambda function: function, given), (0.4, u, v, np.ones(1))
    for one, other in zip(subject.evaluate(*state), plain.evaluate(*state), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


def test_a_plain_function_among_compiled_ones_leaves_the_problem_plain():
    """As a plain tangent does: the kernel could not call it."""
    kinds = iter([numba.njit] * 4 + [lambda function: function] + [numba.njit] * 9)
    assert not wavy(lambda function: next(kinds)(function), ("curvature",)).compiled


def test_rows_of_quadratic_constraints_follow_from_the_gradient():
    """Exactly, where the definition says that they are quadratic; to 1e-9 by differences."""
    given = {
        "mass_matrix": np.eye(4), "u0": [1.25, 0.0, 2.25, 0.0], "v0": [0.0, 1.0, 0.0, 3.0],
        "force": lambda u, v, t: np.array([0.0, -9.81, 0.0, -9.81]),
        "constraints": lambda u, t: np.array(
            [(u[0] - 0.25) ** 2 + u[1] ** 2 - 1, (u[2:] - u[:2]) @ (u[2:] - u[:2]) - 1]
        ) / 2,
        "gradient": lambda u, t: np.array(
            [[u[0] - 0.25, u[0] - u[2]], [u[1], u[1] - u[3]], [0, u[2] - u[0]], [0, u[3] - u[1]]]
        ),
    }  # fmt: skip
    exact, differences = (
        newmark.problem(newmark.Definition(**given, quadratic=quadratic))
        for quadratic in (True, False)
    )
    assert (exact.rows_given, differences.rows_given) == ("exact", "differences")
    for seed in range(3):
        u, v, w = anywhere(exact, seed)

        def turned(x):
            return np.array(
                [[x[0], x[1], 0, 0], [x[0] - x[2], x[1] - x[3], x[2] - x[0], x[3] - x[1]]]
            )

        expected = [np.zeros(2), turned(v) @ v, turned(v), turned(w)]
        assert_alike(dense(exact, 0.5, u, v, w), expected, [0, 1e-14, 1e-14, 1e-14])
        assert_alike(dense(differences, 0.5, u, v, w), expected, [0, 1e-12, 1e-12, 1e-9])
    # Velocities and accelerations that vanish are no direction to differentiate in.
    for part in differences.constraint_rows(0.5, u, 0 * v, 0 * w):
        np.testing.assert_array_equal(part, 0)


@pytest.mark.parametrize("of_chain", [False, True])
def test_projections_solve_the_bordered_system(of_chain):
    """δ and μ against the matrix written out, in the units of M δ = G μ, dense and sparse."""
    subject = newmark.problem("chain", links=60) if of_chain else damped()
    n, m, t, random = subject.n, subject.m, 0.0, np.random.default_rng(4)
    u = subject.u0 + 1e-5 * np.abs(subject.u0).max() * random.normal(size=n)
    v = subject.v0 + random.normal(size=n)
    terms, system = subject.evaluate(t, u, v, np.zeros(m)), Index1(subject)
    rate, _ = subject.constraint_derivatives(t, u, v)
    matrix = np.block([[subject.M, -terms.G], [terms.G.T, np.zeros((m, m))]])
    np.testing.assert_allclose(system.rate(t, u, v), terms.G.T @ v + rate, atol=1e-13)
    for misfit in (terms.G.T @ v + rate, terms.phi):
        found = np.concatenate(system.least_change(t, u, -misfit))
        expected = np.linalg.solve(matrix, np.concatenate([np.zeros(n), -misfit]))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    # Φ is quadratic in what is left of the distance.
    left = subject.constraint_values(t, u + found[:n])
    assert np.abs(left).max() < 1e-2 * np.abs(terms.phi).max()


def test_values_without_tangents_take_no_differences():
    """The same bits from one call of each function."""
    calls = []

    def counted(function):
        def called(*arguments):
            calls.append(function.__name__)
            return function(*arguments)

        return called

    subject = newmark.problem(newmark.Definition(**wavy_definition(counted)))
    u, v = np.array([0.3, -0.2, 0.1]), np.array([1.0, 0.5, -0.4])
    whole = subject.values(0.3, u, v, np.zeros(1))
    calls.clear()
    free = subject.free_values(0.3, u, v)
    assert sorted(calls) == ["constraints", "force", "gradient"]
    for name in ("force", "phi", "g"):
        assert np.array_equal(getattr(free, name), getattr(whole, name))


def moving(subject):
    """The same from other velocities, as near as the constraints allow to general ones."""
    _, v = Index1(subject).projected(0.0, subject.u0, np.array([0.4, -0.2, 0.3]))
    return replace(subject, v0=v)


def ellipsoid_phi(u, t):
    return [sum((1 + i) * x**2 for i, x in enumerate(u)) / 2 - mpf("0.5")]


def bent():
    return wavy(lambda function: function, ("curvature",))


@pytest.mark.parametrize(
    ("make", "phi"), [(wavy, wavy_phi), (bent, wavy_phi), (damped, ellipsoid_phi)]
)
def test_the_jerk_and_the_velocity_that_it_asks_for(make, phi):
    """Gᵀu‴ is what the third derivative of Φ along u + sv + s²a/2 lacks; by mpmath."""
    subject = moving(make())
    u, v, (a, _) = (
        subject.u0,
        subject.v0,
        Index1(subject).accelerations(0.0, subject.u0, subject.v0),
    )
    with mp.workdps(40):
        path = [[mpf(float(x)) for x in of] for of in (u, v, a)]

        def along(s):
            return phi([x + s * y + s**2 * z / 2 for x, y, z in zip(*path, strict=True)], s)[0]

        expected = -float(mp.diff(along, 0, 3))
    np.testing.assert_allclose(constraint_jerk(subject), expected, rtol=1e-8)
    # Least change in the norm of M: M δv is in the range of G.
    change = corrected_velocity(subject, 0.01) - v
    gradient = subject.evaluate(0.0, u, v, np.zeros(1)).G
    np.testing.assert_allclose(gradient.T @ change, -1e-4 / 12 * expected, rtol=1e-6)
    pulled = (MASS if phi is ellipsoid_phi else np.eye(3)) @ change
    inside = gradient @ np.linalg.lstsq(gradient, pulled, rcond=None)[0]
    np.testing.assert_allclose(inside, pulled, rtol=0, atol=1e-9 * np.abs(pulled).max())
    # What the start leaves of Φ' in proportion to h² is what a change of h goes by.
    state = initial_state(subject, scheme_of("u-lambda", "none", 0.01, start=CORRECTED))
    np.testing.assert_allclose(1e-4 * state.rates[1:], state.psi, rtol=1e-6)
