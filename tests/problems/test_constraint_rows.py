"""Φ' and Φ'' and their tangents: mechanisms, problems in Python, projections with them."""

from dataclasses import replace

import numba
import numpy as np
import oracles
import pytest
from damped import damped
from each import each
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from mechanisms import TWO_BODIES, built
from mpmath import mp, mpc, mpf

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import problem
from newmark_cli.problems import python_problem
from newmark_cli.problems.differences import constraint_rows
from newmark_cli.problems.index_1 import Index1

ANGLE = {"rate": 2, "acceleration": 1.5, "amplitude": 0.1, "frequency": 5, "phase": 0.7}
ABSCISSA = {"rate": -0.5, "acceleration": 0.8, "amplitude": 0.2, "frequency": 3, "phase": -0.4}
ALONG = (0.3 + 0.4j) / 0.5
#: Every element that is a constraint, on plain points and on body-fixed ones.
CONSTRAINED = (
    """\
points:
  A: {fixed: [0, 0]}
  B: {at: [0.3, 0.4]}
  C: {at: [0.9, 1.2], mass: 2}
  S: {at: [1.5, 0.5], mass: 1}
  D: {at: [2.1, 1.3], mass: 1}
"""
    + TWO_BODIES
    + f"""\
bars:
  between: {{from: P, to: S, length: {abs(1.5 + 0.5j - (0.25 + 0.3j) * ALONG)!r}}}
  plain: {{from: S, to: D, length: 1}}
sliders:
  rail: {{point: S, through: [1, 0], direction: [1, 1]}}
motions:
  crank: {{body: one, angle: {ANGLE}}}
  pushed: {{point: Q, x: {ABSCISSA}}}
project_velocities: true
"""
).replace("'", "")


def law(of, initially, t):
    """A law of time that starts somewhere, in mpmath."""
    rate, half, amplitude, frequency, phase = (
        mpf(of[key]) for key in ("rate", "acceleration", "amplitude", "frequency", "phase")
    )
    begin = mpf(initially) - amplitude * mp.sin(phase)
    return begin + rate * t + half * t**2 / 2 + amplitude * mp.sin(frequency * t + phase)


def constrained_phi(u, t):
    """Φ of `CONSTRAINED`, typed again with complex numbers."""
    b, c, s, d = (mpc(u[i], u[i + 1]) for i in range(0, 8, 2))
    p = mpc("0.25", "0.3") * b / mpf("0.5")
    q = b + mpc("0.75", "-0.1") * (c - b)
    start = 0.3 + 0.4j + (0.75 - 0.1j) * (0.6 + 0.8j)
    turned = b * mp.expj(-law(ANGLE, np.angle(0.3 + 0.4j), t))
    normal = mp.expj(3 * mp.pi / 4)
    return [
        (abs(b) ** 2 - mpf("0.25")) / 2,
        (abs(c - b) ** 2 - 1) / 2,
        (abs(s - p) ** 2 - 1) / 2,
        (abs(d - s) ** 2 - 1) / 2,
        (mp.conj(normal) * (s - 1)).real,
        turned.imag,
        q.real - law(ABSCISSA, start.real, t),
    ]


def dense(subject, rows):
    """Rate, curvature, R and Q with matrices in full."""
    pattern = subject.pattern
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


@pytest.fixture(scope="module")
def constrained():
    """`CONSTRAINED`."""
    return built(CONSTRAINED)


# References take their time: a failure is not made smaller.
@settings(max_examples=10, phases=[Phase.generate])
@given(st.integers(0, 2**32 - 1), st.floats(-2, 2))
def test_every_element_against_mpmath(constrained, seed, t):
    """Rate, curvature, R and Q are exact: laws of time and body-fixed points included."""
    u, v, w = anywhere(constrained, seed)
    found = dense(constrained, constrained.constraint_rows(t, u, v, w))
    expected = oracles.constraint_rows(constrained_phi, t, u, v, w)
    assert_alike(found, expected, [1e-13] * 4)
    for part in expected:
        assert np.abs(part).max() > 1e-2


def test_all_entries_are_overwritten(constrained):
    """Nothing remains of what stood in the arrays before, where an entry is zero too."""
    u, v, w = anywhere(constrained, 1)
    expected = constrained.constraint_rows(0.5, u, v, w)
    found = type(expected)(*(np.full_like(part, np.nan) for part in expected))
    constrained.derivatives(0.5, u, v, w, constrained.ints, constrained.reals, *found)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


# Problems in Python

#: A crank driven by a law of time, and a link on it.
CRANK = """
import numpy as np
from newmark_cli.problems.python_problem import Definition

def factory(decorate=lambda function: function, given=()):
    @decorate
    def angle(t):
        return 0.3 + 2 * t + 0.1 * np.sin(5 * t)
    @decorate
    def turn(t):
        return 2 + 0.5 * np.cos(5 * t)
    @decorate
    def faster(t):
        return -2.5 * np.sin(5 * t)
    @decorate
    def force(u, v, t):
        return np.array([0.0, -9.81, 0.0, -9.81])
    @decorate
    def constraints(u, t):
        c, s = np.cos(angle(t)), np.sin(angle(t))
        x, y = u[2] - u[0], u[3] - u[1]
        return np.array([(u[0]**2 + u[1]**2 - 4) / 2, c * u[1] - s * u[0], (x*x + y*y - 1) / 2])
    @decorate
    def gradient(u, t):
        c, s = np.cos(angle(t)), np.sin(angle(t))
        x, y = u[2] - u[0], u[3] - u[1]
        return np.array([[u[0], -s, -x], [u[1], c, -y], [0.0, 0.0, x], [0.0, 0.0, y]])
    @decorate
    def constraint_rate(u, t):
        c, s = np.cos(angle(t)), np.sin(angle(t))
        return np.array([0.0, -turn(t) * (s * u[1] + c * u[0]), 0.0])
    @decorate
    def curvature(u, v, t):
        c, s = np.cos(angle(t)), np.sin(angle(t))
        x, y = v[2] - v[0], v[3] - v[1]
        driven = -faster(t) * (s * u[1] + c * u[0]) - turn(t)**2 * (c * u[1] - s * u[0])
        driven -= 2 * turn(t) * (s * v[1] + c * v[0])
        return np.array([v[0]**2 + v[1]**2, driven, x*x + y*y])
    @decorate
    def rate_gradient(u, v, t):
        c, s = turn(t) * np.cos(angle(t)), turn(t) * np.sin(angle(t))
        x, y = v[2] - v[0], v[3] - v[1]
        return np.array([[v[0], -c, -x], [v[1], -s, -y], [0.0, 0.0, x], [0.0, 0.0, y]])
    @decorate
    def acceleration_gradient(u, v, w, t):
        c, s = np.cos(angle(t)), np.sin(angle(t))
        x, y = w[2] - w[0], w[3] - w[1]
        p, q = turn(t)**2 * s - faster(t) * c, -turn(t)**2 * c - faster(t) * s
        return np.array([[w[0], p, -x], [w[1], q, -y], [0.0, 0.0, x], [0.0, 0.0, y]])
    p = 2 * np.exp(0.3j)
    v = 2.5j * p
    own = locals()
    return Definition(
        mass_matrix=np.eye(4), u0=[p.real, p.imag, p.real + 1, p.imag],
        v0=[v.real, v.imag, v.real, v.imag + 0.5], force=force, constraints=constraints,
        gradient=gradient, **{key: own[key] for key in given},
    )
"""
ALL = ("constraint_rate", "curvature", "rate_gradient", "acceleration_gradient")
_CRANK_MECHANISM = """\
points:
  O: {fixed: [0, 0]}
  P: {at: [1.9106729782512121, 0.5910404133226791]}
  Q: {at: [2.9106729782512121, 0.5910404133226791], mass: 1}
bodies: {rod: {from: O, to: P, length: 2, mass: 1, centre: [1, 0], inertia: 1}}
bars: {link: {from: P, to: Q, length: 1}}
motions: {crank: {body: rod, angle: {rate: 2, amplitude: 0.1, frequency: 5}}}
project_velocities: true
"""


def crank(tmp_path, text=CRANK, **arguments):
    path = tmp_path / "mine.py"
    path.write_text(text)
    return python_problem.load(path, "factory", arguments, "mine")


@pytest.fixture(scope="module")
def cranks(tmp_path_factory):
    """The crank with all, some and none of the functions given; with all of them compiled too."""
    folder = tmp_path_factory.mktemp("cranks")
    given = {"given": ALL, "some": ("curvature", "acceleration_gradient"), "computed": ()}
    return {
        (name, compiled): crank(
            folder, given=keys, **({"decorate": numba.njit} if compiled else {})
        )
        for name, keys in given.items()
        for compiled in (False, True)
        if not compiled or name == "given"
    }


def test_ways_to_the_rows_of_a_crank_agree(cranks):
    """Given, computed, compiled, and the mechanism: one set of numbers.

    What enters the residual is found by differences to 1e-10, the tangents to 1e-9.  Compiled
    differences are those of the car axis, in `test_formulations`: a second problem would take
    as long to compile.
    """
    mechanism = built(_CRANK_MECHANISM)
    for seed in range(20):
        t = np.random.default_rng(seed).uniform(0, 3)
        u, v, w = anywhere(mechanism, seed)
        rows = dense(mechanism, mechanism.constraint_rows(t, u, v, w))
        expected = [part[[0, 2, 1]] for part in rows]  # motions stand last
        for (name, compiled), subject in cranks.items():
            assert subject.compiled == compiled
            found = dense(subject, subject.constraint_rows(t, u, v, w))
            exact = name == "given"
            assert_alike(found, expected, [1e-14] * 4 if exact else [1e-11, 1e-10, 1e-10, 1e-9])
            assert subject.rows_given == ("exact" if exact else "differences")


def test_what_starts_a_march_is_what_is_given_or_differences(cranks):
    """Rate and curvature: where the user gives one, it is that; `test_python_problems` has more."""
    given, some, computed = (cranks[name, False] for name in ("given", "some", "computed"))
    for seed in range(5):
        u, v, _ = anywhere(some, seed)
        found = some.constraint_derivatives(0.7, u, v)
        expected = computed.constraint_derivatives(0.7, u, v)
        np.testing.assert_array_equal(found[0], expected[0])
        assert np.abs(expected[0]).max() > 0
        exact = given.constraint_derivatives(0.7, u, v)
        np.testing.assert_array_equal(found[1], exact[1])
    assert cranks["given", True].constraint_derivatives(0.7, u, v)[1][1] == pytest.approx(
        expected[1][1], rel=1e-9
    )


def double(quadratic=False, decorate=lambda function: function):
    """Two bars in a row; with its force, constraints and gradient."""

    @decorate
    def force(u, v, t):
        return np.array([0.0, -9.81, 0.0, -9.81])

    @decorate
    def constraints(u, t):
        x, y = u[2] - u[0], u[3] - u[1]
        return np.array([((u[0] - 0.25) ** 2 + u[1] ** 2 - 1) / 2, (x * x + y * y - 1) / 2])

    @decorate
    def gradient(u, t):
        x, y = u[2] - u[0], u[3] - u[1]
        return np.array([[u[0] - 0.25, -x], [u[1], -y], [0.0, x], [0.0, y]])

    return newmark.Definition(
        mass_matrix=np.eye(4), u0=[1.25, 0.0, 2.25, 0.0], v0=[0.0, 1.0, 0.0, 3.0],
        force=force, constraints=constraints, gradient=gradient, quadratic=quadratic,
    )  # fmt: skip


def test_rows_of_quadratic_constraints_follow_from_the_gradient():
    """Exactly, where the definition says that they are quadratic; to 1e-9 by differences.

    Compiled, they are asked for without the problem around them, which takes longer to compile.
    """
    mechanism = built(
        "points:\n  O: {fixed: [0.25, 0]}\n"
        "  A: {at: [1.25, 0], mass: 1}\n  B: {at: [2.25, 0], mass: 1}\n"
        "bars:\n  one: {from: O, to: A, length: 1}\n  two: {from: A, to: B, length: 1}\n"
    )
    exact, differences = (newmark.problem(double(quadratic)) for quadratic in (True, False))
    assert (exact.rows_given, differences.rows_given) == ("exact", "differences")
    given = double(decorate=numba.njit)
    functions = {key: getattr(given, key) for key in ("force", "constraints", "gradient")}
    rows = constraint_rows(functions, {}, numba.njit, quadratic=True)
    compiled = replace(exact, derivatives=rows)
    for seed in range(5):
        u, v, w = anywhere(mechanism, seed)
        expected = dense(mechanism, mechanism.constraint_rows(0.5, u, v, w))
        for subject in (exact, compiled):
            found = dense(subject, subject.constraint_rows(0.5, u, v, w))
            assert_alike(found, expected, [0, 1e-14, 1e-14, 1e-14])
        found = dense(differences, differences.constraint_rows(0.5, u, v, w))
        assert_alike(found, expected, [0, 1e-12, 1e-12, 1e-9])
    assert compiled.derivatives.signatures
    # Velocities and accelerations that vanish are no direction to differentiate in.
    for part in differences.constraint_rows(0.5, u, 0 * v, 0 * w):
        np.testing.assert_array_equal(part, 0)


WAVY = """
import numpy as np
class Problem:
    mass_matrix = np.eye(3)
    u0 = np.array([0.3, 0.2, 0.2 * np.sin(0.9) * np.cos(0.4)])
    v0 = np.array([0.0, 0.0, 0.3 + 0.2 * np.cos(0.9) * np.cos(0.4)])
    def force(self, u, v, t):
        return np.array([0.0, 0.0, -9.81])
    def constraints(self, u, t):
        wave = 0.2 * np.sin(3 * u[0] + t) * np.cos(2 * u[1])
        return np.array([u[2] - wave - 0.1 * np.sin(3 * t)])
    def gradient(self, u, t):
        c, s = np.cos(3 * u[0] + t), np.sin(3 * u[0] + t)
        return np.array([[-0.6 * c * np.cos(2 * u[1])], [0.4 * s * np.sin(2 * u[1])], [1.0]])
def factory():
    return Problem()
"""


def wavy_phi(u, t):
    return [u[2] - mp.sin(3 * u[0] + t) * mp.cos(2 * u[1]) / 5 - mp.sin(3 * t) / 10]


def test_rows_of_a_surface_that_is_not_quadratic(tmp_path):
    """A bead on a wavy floor that moves: Q has third derivatives of Φ, from G alone."""
    subject = crank(tmp_path, WAVY)
    for seed in range(10):
        u, v, w = anywhere(subject, seed)
        expected = oracles.constraint_rows(wavy_phi, 0.4, u, v, w)
        found = dense(subject, subject.constraint_rows(0.4, u, v, w))
        assert_alike(found, expected, [1e-11, 1e-10, 1e-10, 1e-9])


def test_a_plain_function_among_compiled_ones_leaves_the_problem_plain(tmp_path):
    """As a plain tangent does: the kernel could not call it."""
    text = CRANK.replace("    @decorate\n    def curvature", "    def curvature")
    assert not crank(tmp_path, text, decorate=numba.njit, given=("curvature",)).compiled


# Projections


@each("subject", ["damped", "andrews", "constrained", "chain"])
def test_projections_solve_the_bordered_system(subject, constrained):
    """δv, μ and δu against the matrix written out, in the units of M δv = G μ."""
    subject = {
        "damped": damped,
        "andrews": lambda: problem("andrews"),
        "constrained": lambda: constrained,
        "chain": lambda: newmark.problem("chain", links=60),
    }[subject]()
    n, m, t = subject.n, subject.m, 0.0
    random = np.random.default_rng(4)
    size = np.abs(subject.u0).max()
    u = subject.u0 + 1e-5 * size * random.normal(size=n)
    v = subject.v0 + random.normal(size=n)
    terms = subject.evaluate(t, u, v, np.zeros(m))
    rate, _ = subject.constraint_derivatives(t, u, v)
    # λ in a unit that leaves the matrix well conditioned.
    unit = np.abs(subject.M).max()
    matrix = np.block([[subject.M / unit, -terms.G], [terms.G.T, np.zeros((m, m))]])

    def solved(misfit):
        rhs = np.concatenate([np.zeros(n), -misfit])
        found = np.linalg.solve(matrix, rhs)
        found += np.linalg.solve(matrix, rhs - matrix @ found)
        return found[:n], unit * found[n:]

    system = Index1(subject)
    change, impulse = system.least_change(t, u, -system.rate(t, u, v))
    for found, expected in zip((change, impulse), solved(terms.G.T @ v + rate), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(
        subject.M @ change, terms.G @ impulse, rtol=0,
        atol=1e-11 * np.abs(terms.G).max() * np.abs(impulse).max(),
    )  # fmt: skip
    expected, _ = solved(terms.phi)
    found, _ = Index1(subject).least_change(t, u, -terms.phi)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    # Φ is quadratic in what is left of the distance.
    left = subject.constraint_values(t, u + found)
    assert np.abs(left).max() < 1e-2 * np.abs(terms.phi).max()
