"""Problems: tangents, mass matrices, consistent starts, the mechanism model."""

import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp

from newmark_cli.documents import DocumentError
from newmark_cli.errors import InputError
from newmark_cli.newmark.initial import consistent_accelerations
from newmark_cli.problems import elements, planar
from newmark_cli.problems.registry import PROBLEMS, problem

REFERENCED = [name for name in PROBLEMS if name in oracles.REFERENCES]


def complex_terms(subject, u, v, multipliers):
    """f + Gλ and Φ for complex coordinates, from the uncompiled element loop."""
    pattern = subject.pattern
    force, phi = np.zeros(subject.n, complex), np.zeros(subject.m, complex)
    elements.evaluate.py_func(
        0.0, u, v, multipliers, subject.ints, subject.reals, force, phi,
        np.zeros(len(pattern.x_rows), complex), np.zeros(len(pattern.y_rows), complex),
        np.zeros(len(pattern.g_rows), complex),
    )  # fmt: skip
    return force, phi


@pytest.mark.parametrize("name", PROBLEMS)
@given(st.integers(0, 2**32 - 1))
def test_tangents_are_derivatives(name, seed):
    """X, Y, G against complex-step differentiation, 1e-10 relative, at random states."""
    subject = problem(name)
    random = np.random.default_rng(seed)
    u = subject.u0 * (1 + 0.1 * random.normal(size=subject.n)) + 1e-3
    v = random.normal(size=subject.n)
    multipliers = random.normal(size=subject.m)
    terms = subject.evaluate(0.0, u, v, multipliers)
    x, g = np.empty_like(terms.X), np.empty_like(terms.G)
    y = np.empty_like(terms.Y)
    for j in range(subject.n):
        moved = u.astype(complex)
        moved[j] += 1e-30j
        force, phi = complex_terms(subject, moved, v, multipliers)
        x[:, j], g[j] = -force.imag / 1e-30, phi.imag / 1e-30
        faster = v.astype(complex)
        faster[j] += 1e-30j
        y[:, j] = -complex_terms(subject, u.astype(complex), faster, multipliers)[0].imag / 1e-30
    for found, expected in ((terms.X, x), (terms.G, g), (terms.Y, y)):
        size = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * size)


@pytest.mark.parametrize("name", REFERENCED)
@given(st.integers(0, 2**32 - 1))
def test_terms_against_mpmath(name, seed):
    """M, f + Gλ, Φ against the formulas typed again."""
    subject, reference = problem(name), oracles.REFERENCES[name]()
    random = np.random.default_rng(seed)
    u = subject.u0 * (1 + 0.1 * random.normal(size=subject.n)) + 1e-3
    multipliers = random.normal(size=subject.m)
    terms = subject.evaluate(0.0, u, np.zeros(subject.n), multipliers)
    with mp.workdps(oracles.DIGITS):
        exact = [mp.mpf(float(x)) for x in u]
        force = reference.force(exact, [mp.mpf(float(x)) for x in multipliers])
        phi = reference.phi(exact)
        mass = np.array(reference.mass.tolist(), dtype=float)
    force, phi = np.array(force, float), np.array(phi, float)
    np.testing.assert_allclose(subject.M, mass, rtol=1e-13, atol=1e-13 * np.abs(mass).max())
    np.testing.assert_allclose(terms.force, force, rtol=0, atol=1e-12 * np.abs(force).max())
    np.testing.assert_allclose(terms.phi, phi, rtol=0, atol=1e-14 * np.sum(u**2))


def test_andrews_initial_acceleration():
    """β'' = 14222.4439199541 to 1e-12, from the consistent start."""
    subject = problem("andrews")
    a, _ = consistent_accelerations(subject, 0.0, subject.u0, subject.v0)
    f, df = subject.u0[2:4], a[2:4]
    beta = (f[0] * df[1] - f[1] * df[0]) / (f @ f)
    assert beta == pytest.approx(14222.4439199541, rel=1e-12)


def test_andrews_start_follows_from_its_angles():
    """The 20 digits in the data file are those of the initial angles."""
    angles = (
        "-0.0617138900142764496358948458001", 0, "0.455279819163070380255912382449",
        "0.222668390165885884674473185609", "0.487364979543842550225598953530",
        "-0.222668390165885884674473185609", "1.23054744454982119249735015568",
    )  # fmt: skip
    with mp.workdps(40):
        points, _ = oracles.andrews_points(angles, [0] * 7)
    np.testing.assert_array_equal(problem("andrews").u0, [float(x) for x in points])


def test_pendulum_start():
    """From rest at (1, 0): a = (0, −1), λ = 3y = 0."""
    subject = problem("pendulum")
    a, multipliers = consistent_accelerations(subject, 0.0, subject.u0, subject.v0)
    np.testing.assert_allclose(a, [0, -1], atol=1e-16)
    np.testing.assert_allclose(multipliers, [0], atol=1e-16)


@given(st.floats(0, 2 * np.pi), st.floats(-3, 3))
def test_accelerations_in_motion(angle, rate):
    """λ = y − |v|² on the pendulum at any angle and speed: the curvature term is there."""
    u = np.array([np.cos(angle), np.sin(angle)])
    v = rate * np.array([-u[1], u[0]])
    a, multipliers = consistent_accelerations(problem("pendulum"), 0.0, u, v)
    assert multipliers[0] == pytest.approx(u[1] - rate**2, abs=1e-13)
    np.testing.assert_allclose(a, multipliers[0] * u + [0, -1], atol=1e-13)


BODY = """\
points:
  A: {fixed: [0, 0]}
  B: {at: [0.3, 0.4], velocity: [-0.8, 0.6]}
  C: {at: [0.3, 1.4], mass: 2, velocity: [-0.8, 0.6]}
bodies:
  one: {from: A, to: B, length: 0.5, mass: 3, centre: [0.2, 0.1], inertia: 0.5}
  two: {from: B, to: C, length: 1, mass: 4, centre: [0.5, -0.2], inertia: 0.25}
body_points:
  P: {on: one, at: [0.25, 0.3]}
  Q: {on: two, at: [0.75, -0.1]}
springs:
  spring: {from: P, to: Q, stiffness: 7, rest_length: 0.3}
bars: {}
torques:
  motor: {on: two, torque: 1.5}
gravity: [1, -9]
"""


@pytest.fixture
def double(tmp_path):
    """Two bodies in a row with everything the model has."""
    path = tmp_path / "double.yaml"
    path.write_text(BODY)
    return planar.load(path, "double")


def rigid(points, velocities, centre, length):
    """Mass centre, its velocity and the rate of turn of a two-point body."""
    along = (points[1] - points[0]) / length
    spin = ((velocities[1] - velocities[0]) / (1j * (points[1] - points[0]))).real
    place = points[0] + centre * along
    return place, velocities[0] + 1j * spin * (place - points[0]), spin


def test_kinetic_energy_is_that_of_rigid_bodies(double):
    """½ vᵀ M v against mass centres and rates of turn."""
    b, vb, c, vc = 0.3 + 0.4j, -0.8 + 0.6j, 0.3 + 1.4j, -0.8 + 0.6j
    _, v1, spin1 = rigid((0, b), (0, vb), 0.2 + 0.1j, 0.5)
    _, v2, spin2 = rigid((b, c), (vb, vc), 0.5 - 0.2j, 1.0)
    expected = 0.5 * (3 * abs(v1) ** 2 + 0.5 * spin1**2 + 4 * abs(v2) ** 2 + 0.25 * spin2**2)
    expected += 0.5 * 2 * abs(vc) ** 2
    assert 0.5 * double.v0 @ double.M @ double.v0 == pytest.approx(expected, rel=1e-14)


def test_power_is_that_of_gravity_spring_and_torque(double):
    """vᵀ f against the power of each force, found from the mass centres."""
    b, vb, c, vc = 0.3 + 0.4j, -0.8 + 0.6j, 0.3 + 1.4j, -0.8 + 0.6j
    gravity = 1 - 9j
    _, v1, _ = rigid((0, b), (0, vb), 0.2 + 0.1j, 0.5)
    _, v2, spin2 = rigid((b, c), (vb, vc), 0.5 - 0.2j, 1.0)
    power = sum((gravity.conjugate() * p).real for p in (3 * v1, 4 * v2, 2 * vc)) + 1.5 * spin2
    p, vp, _ = rigid((0, b), (0, vb), 0.25 + 0.3j, 0.5)
    q, vq, _ = rigid((b, c), (vb, vc), 0.75 - 0.1j, 1.0)
    stretch = abs(q - p) - 0.3
    power -= 7 * stretch * ((q - p).conjugate() * (vq - vp)).real / abs(q - p)
    force = double.evaluate(0.0, double.u0, double.v0, np.zeros(double.m)).force
    assert double.v0 @ force == pytest.approx(power, rel=1e-13)


def test_tangents_of_all_elements(double):
    """X of body-fixed points, springs and torques, by complex steps."""
    multipliers = np.array([0.7, -0.4])
    terms = double.evaluate(0.0, double.u0, double.v0, multipliers)
    for j in range(double.n):
        moved = double.u0.astype(complex)
        moved[j] += 1e-30j
        force, phi = complex_terms(double, moved, double.v0, multipliers)
        np.testing.assert_allclose(terms.X[:, j], -force.imag / 1e-30, rtol=0, atol=1e-11)
        np.testing.assert_allclose(terms.G[j], phi.imag / 1e-30, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("to: B, length: 0.5", "to: Z, length: 0.5", 6, "unknown point 'Z'"),
        ("length: 0.5,", "length: 0.6,", 6, "start 0.5 m apart, given length 0.6"),
        ("length: 1,", "length: 0,", 7, "greater than 0, given 0"),
        ("mass: 3", "mass: -3", 6, "greater than or equal to 0, given -3"),
        ("stiffness: 7", "stifness: 7", 12, "did you mean 'stiffness'?"),
        ("on: two, torque", "on: tow, torque", 15, "unknown body 'tow'; did you mean 'two'?"),
        ("A: {fixed: [0, 0]}", "A: {}", 2, "needs either 'fixed' or 'at'"),
        ("from: P, to: Q", "from: A, to: A", 12, "do not move apart"),
        ("  B: {at: [0.3, 0.4]", "  B: {at: [0.3]", 3, "missing"),
    ],
)
def test_mistakes_are_located(tmp_path, old, new, line, words):
    """Each mistake is named with file, line and key."""
    path = tmp_path / "bad.yaml"
    assert old in BODY
    path.write_text(BODY.replace(old, new))
    with pytest.raises(DocumentError) as caught:
        planar.load(path, "bad")
    assert f"bad.yaml, line {line}: " in str(caught.value)
    assert words in str(caught.value)


def test_unknown_problem():
    """The nearest name is offered."""
    with pytest.raises(InputError, match="did you mean 'andrews'"):
        problem("andrew")
