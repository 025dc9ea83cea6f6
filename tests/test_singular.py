"""Singular positions: found along a motion, and motions through them against quadratures."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import SWING
from each import each
from mechanisms import built
from scipy.integrate import solve_ivp

from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.spec import PythonFactory
from newmark_cli.problems import singular
from newmark_cli.problems.reference import NoReference, relative_error, solution
from newmark_cli.problems.singular import Crossing, crossings
from newmark_cli.support import apart

GRAVITY = 9.81


class Linkage:
    """A motion of one degree of freedom that never turns, by quadrature.

    Places of the moving points are functions of a crank angle; energy gives its rate, and
    the integral of its inverse the time: by Gauss, to rounding.
    """

    def __init__(self, masses, places, begin, rate):
        self.masses, self.places = np.array(masses, float), places
        self.begin, self.rate = begin, rate

    def speeds(self, angle):
        """Derivatives of the places by the angle, by a complex step."""
        return self.places(angle + 1e-40j).imag / 1e-40

    def rate_at(self, angle):
        """Rate of the angle, by the energy."""

        def inertia(a):
            return self.masses @ (self.speeds(a) ** 2).reshape(-1, 2).sum(axis=1)

        def height(a):
            return self.masses @ self.places(a)[1::2]

        gained = 2 * GRAVITY * (height(self.begin) - height(angle))
        energy = self.rate**2 * inertia(self.begin) + gained
        return math.copysign(math.sqrt(energy / inertia(angle)), self.rate)

    def at(self, t, guess):
        """(u, v) at a time; ``guess`` is an angle close to that there."""
        nodes, weights = np.polynomial.legendre.leggauss(120)
        angle = guess
        for _ in range(6):
            turned = angle - self.begin
            rates = [self.rate_at(self.begin + turned * (1 + x) / 2) for x in nodes]
            angle += (t - turned / 2 * (weights @ (1 / np.array(rates)))) * self.rate_at(angle)
        return self.places(angle), self.rate_at(angle) * self.speeds(angle)


def mechanism(linkage, bars, extra=""):
    """YAML of a linkage on P, S, ... at its start."""
    u = [float(x) for x in linkage.places(linkage.begin)]
    v = [float(linkage.rate * x) for x in linkage.speeds(linkage.begin)]
    points = "".join(
        f"  {name}: {{at: [{u[2 * k]!r}, {u[2 * k + 1]!r}], mass: {mass}, "
        f"velocity: [{v[2 * k]!r}, {v[2 * k + 1]!r}]}}\n"
        for k, (name, mass) in enumerate(zip("PS", linkage.masses, strict=True))
    )
    return (
        f"points:\n  O: {{fixed: [0, 0]}}\n  Q: {{fixed: [4, 0]}}\n{points}bars:\n{bars}{extra}"
        f"gravity: [0, -{GRAVITY}]\nassemble: true\nproject_velocities: true\n"
    )


#: A crank and a rod of the same length: the slider passes the crank's pin.
SLIDER_CRANK = Linkage(
    (1, 2), lambda a: np.array([np.cos(a), np.sin(a), 2 * np.cos(a), 0 * a]), math.atan2(4, 3), 2.0
)
SLIDER_CRANK_BARS = """\
  crank: {from: O, to: P, length: 1}
  rod: {from: P, to: S, length: ROD}
sliders:
  rail: {point: S, through: [0, 0], direction: [1, 0]}
"""
PARALLELOGRAM = Linkage(
    (1, 3),
    lambda a: np.array([np.cos(a), np.sin(a), 4 + np.cos(a), np.sin(a)]),
    math.atan2(4, 3),
    5.0,
)
PARALLELOGRAM_BARS = """\
  one: {from: O, to: P, length: 1}
  two: {from: Q, to: S, length: 1}
  three: {from: P, to: S, length: 4}
"""


def change_point(angle):
    """Four-bar of lengths 1, 3, 2 on a ground of 4.

    With p, q the cotangents of half the angles, 2p²q² − p² + 5q² − 2pq = 0; q/p is smooth
    where both vanish and the bars are in line.
    """
    p = 1 / np.tan(angle / 2)
    q = p * (1 + np.sqrt(6 + 2 * p**2)) / (5 + 2 * p**2)
    cosine, sine = (q**2 - 1) / (q**2 + 1), 2 * q / (q**2 + 1)
    return np.array([np.cos(angle), np.sin(angle), 4 + 2 * cosine, 2 * sine])


CHANGE_POINT = Linkage((1, 1.5), change_point, math.pi / 2, 8.0)
CHANGE_POINT_BARS = """\
  one: {from: O, to: P, length: 1}
  two: {from: Q, to: S, length: 2}
  three: {from: P, to: S, length: 3}
"""


@each("linkage, bars, t, guess", [
    (SLIDER_CRANK, SLIDER_CRANK_BARS.replace("ROD", "1"), 1.0, 2.3),
    (SLIDER_CRANK, SLIDER_CRANK_BARS.replace("ROD", "1"), 1.9, 5.4),
    (PARALLELOGRAM, PARALLELOGRAM_BARS, 0.6, 4.3),
    (PARALLELOGRAM, PARALLELOGRAM_BARS, 1.0, 7.0),
    (CHANGE_POINT, CHANGE_POINT_BARS, 0.3, 4.3),
])  # fmt: skip
def test_motions_through_dead_centres(linkage, bars, t, guess):
    """They keep to their branch, to the accuracy that the reference says, which is high."""
    subject = built(mechanism(linkage, bars))
    u, v = linkage.at(t, guess)
    found = solution(subject, t)
    true = np.array([relative_error(found.u, u), relative_error(found.v, v)])
    estimated = np.array([found.u_error, found.v_error])
    assert np.all(true <= 3 * estimated)
    assert np.all(estimated < 1e-10)
    # λ by the equations of motion, from quotients of the exact velocities.
    step = 1e-4
    later, earlier = (linkage.at(t + shift, guess)[1] for shift in (step, -step))
    terms = subject.evaluate(subject.t0 + t, u, v, np.zeros(subject.m))
    load = subject.M @ (later - earlier) / (2 * step) - terms.force
    multipliers = np.linalg.lstsq(terms.G, load, rcond=None)[0]
    assert relative_error(found.multipliers, multipliers) < 1e-5
    assert found.multipliers_error < 1e-9


def test_four_bars_fall_through_the_horizontal():
    """In each window a singular value vanishes at once; all rods stay parallel, as pendula."""
    subject = FAMILIES["four-bars"].problem("four-bars", {"windows": 2})
    found = solution(subject, 1.5)
    tops = found.u.reshape(-1, 2) - [[0, 0], [1, 0], [2, 0]]
    np.testing.assert_allclose(tops, tops[:1].repeat(3, axis=0), atol=1e-11)
    # Rods turn about their ends, couplers do not turn: (3/3 + 2) θ'²/2, of heights 3/2 + 2.
    height, speed = tops[0, 1], np.linalg.norm(found.v.reshape(-1, 2)[0])
    assert 1.5 * speed**2 + 3.5 * GRAVITY * height == pytest.approx(1.5 + 3.5 * GRAVITY, abs=1e-9)
    # As one point of mass 3 with a weight of 3.5.
    weight = 3.5 / 3 * GRAVITY
    turned = solve_ivp(
        lambda t, y: [y[1], weight * np.sin(y[0])], (0, 1.5), [0, 1], "DOP853",
        rtol=1e-13, atol=1e-14,
    ).y[0, -1]  # fmt: skip
    np.testing.assert_allclose(tops[0], [math.sin(turned), math.cos(turned)], atol=1e-10)


LAWS = {
    # The slider is pulled beyond its reach.
    "pulled": (
        SLIDER_CRANK,
        SLIDER_CRANK_BARS.replace("ROD", "1") + "motions: {m: {point: S, x: {rate: 1}}}\n",
        1.0,
        r"no reference beyond t = 0\.799\d*, close to which the constraints lose rank: it ends or "
        "is not smooth there",
    ),
    # y = 0.8 (1 − t)²: at rest in line.
    "at rest": (
        PARALLELOGRAM,
        PARALLELOGRAM_BARS + "motions: {m: {point: P, y: {rate: -1.6, acceleration: 1.6}}}\n",
        1.5,
        "no reference beyond t = 1, close to which the constraints lose rank: branches of the "
        "motion touch, and it may take either",
    ),
    # y = 0.8 (1 − t): in line at the end.
    "at the end": (
        PARALLELOGRAM,
        PARALLELOGRAM_BARS + "motions: {m: {point: P, y: {rate: -0.8}}}\n",
        1.0,
        # Rounding decides whether the last step arrives there.
        r"no reference (beyond t = 0\.99\d*, close to which the constraints lose rank: it ends "
        r"or is not smooth there|at t = 1: (the index-1 matrix is singular|the constraints nearly "
        r"lose rank there, and λ is known to \S+ only))$",
    ),
}


@each("law", LAWS)
def test_motions_that_do_not_get_through(law):
    """They end in a locked position, or may go on in two ways: time and reason are said."""
    linkage, bars, t, words = LAWS[law]
    subject = built(mechanism(linkage, bars))
    assert solution(subject, 0.5 * t).u_error < 1e-12
    with pytest.raises(NoReference, match=words) as caught:
        solution(subject, t)
    assert "\n" not in str(caught.value)


def test_driven_through():
    """Positions that a law of time prescribes: y = 0.8 − 1.2 t, on both sides of the line."""
    law = "motions: {m: {point: P, y: {rate: -1.2}}}\n"
    subject = built(mechanism(PARALLELOGRAM, PARALLELOGRAM_BARS + law))
    for t in (0.5, 0.9):
        found = solution(subject, t)
        y = 0.8 - 1.2 * t
        x = math.sqrt(1 - y * y)
        exact = np.array([x, y, 4 + x, y])
        assert relative_error(found.u, exact) < 1e-12
        assert relative_error(found.v, np.array([1.2 * y / x, -1.2, 1.2 * y / x, -1.2])) < 1e-11


@each("weight, right", [(9.81, True), (9.8, False)])
def test_python_problem_through_its_dead_centre(tmp_path, monkeypatch, weight, right):
    """Plain functions, tangents by differences: the slider-crank in three coordinates.

    An energy that is not conserved tells that something is wrong.
    """
    monkeypatch.setattr(apart, "_inside", True)
    path = tmp_path / "mine.py"
    path.write_text(
        SWING.split("def swing")[0] + "def crank():\n"
        "    return Definition(\n"
        "        mass_matrix=np.diag([1.0, 1.0, 2.0]),\n"
        "        u0=np.array([0.6, 0.8, 1.2]),\n"
        "        v0=np.array([-1.6, 1.2, -3.2]),\n"
        "        force=lambda u, v, t: np.array([0.0, -9.81, 0.0]),\n"
        "        constraints=lambda u, t: np.array(\n"
        "            [u[0]**2 + u[1]**2 - 1, (u[2] - u[0])**2 + u[1]**2 - 1]) / 2,\n"
        "        gradient=lambda u, t: np.array(\n"
        "            [[u[0], u[0] - u[2]], [u[1], u[1]], [0, u[2] - u[0]]]),\n"
        "        energy=lambda u, v, t: v @ (v * [1, 1, 2]) / 2 + 9.81 * u[1],\n"
        "    )\n"
    )
    subject = PythonFactory(path, "crank", (), "mine.py:crank").load()
    subject = replace(subject, potential=lambda t, u, v, ints, reals: weight * u[1])
    if not right:
        with pytest.raises(NoReference, match=r"its energy is not conserved: .* gained, .* releas"):
            solution(subject, 0.6)
        return
    found = solution(subject, 0.6)
    u, v = (part[:3] for part in SLIDER_CRANK.at(0.6, 1.9))
    assert relative_error(found.u, u) < 1e-10
    assert relative_error(found.v, v) < 1e-10


@each("angle", [0.0, 1e-6, 0.01, 0.3])
def test_smallest_singular_value(angle):
    """Of a slider-crank near its dead centre, where it is about the angle to it."""
    subject = built(mechanism(SLIDER_CRANK, SLIDER_CRANK_BARS.replace("ROD", "1")))
    c, s = math.sin(angle), math.cos(angle)  # of the crank, away from the upright position
    g = np.array([[c, s, 0, 0], [-c, s, c, -s], [0, 0, 0, 1]]).T
    g /= np.linalg.norm(g, axis=0)
    expected = np.linalg.svd(g)[1][-1]
    place = np.array([c, s, 2 * c, 0.0])
    assert singular.smallest(subject, 0.0, place) == pytest.approx(expected, rel=1e-9, abs=1e-15)
    assert singular.smallest(subject, 0.0, place * np.nan) == 0
    assert expected == pytest.approx(math.sqrt(1.25) * angle, rel=0.05, abs=1e-12)
    # Large problems are too dear to decompose.
    subject = FAMILIES["chain"].problem("chain", {"links": 41})
    assert singular.smallest(subject, 0.0, subject.u0) is None
    subject = FAMILIES["chain"].problem("chain", {"links": 40})
    assert 0 < singular.smallest(subject, 0.0, subject.u0) < 1


TIMES = np.array([-0.5, -0.3, -0.12, 0.07, 0.25, 0.41])


@each("value, expected", [
    (lambda t: t, [(0.0, True)]),
    (lambda t: t - 0.07, [(0.07, True)]),
    (lambda t: np.sin(t) - 0.2, [(math.asin(0.2), True)]),
    (lambda t: 0.1 * t**3, [(0.0, False)]),
    (lambda t: 0.1 * (t - 0.05) ** 2, [(0.05, False)]),
    (lambda t: 0.1 * (t - 0.07) ** 2, [(0.07, False)]),
    (lambda t: np.hypot(t, 0.05), []),
    (lambda t: 0.001 + t**2, []),
    (lambda t: 1 + t, []),
    (lambda t: (t - 0.3) * (t + 0.2), [(-0.2, True), (0.3, True)]),
])  # fmt: skip
def test_crossings(value, expected):
    """Zeros of a singular value whose vectors turn, and how it gets to them."""
    frames = [np.linalg.qr(np.random.default_rng(k).normal(size=(k, k)))[0] for k in (5, 3)]
    g = []
    for t in TIMES:
        cosine, sine = np.cos(t / 2), np.sin(t / 2)
        turned = np.eye(5)
        turned[:2, :2] = [[cosine, -sine], [sine, cosine]]
        middle = np.zeros((5, 3))
        middle[:3] = np.diag([value(t), 0.9, 0.7])
        g.append(frames[0] @ turned @ middle @ frames[1].T)
    found = crossings(TIMES, np.array(g))
    assert [one.straight for one in found] == [straight for _, straight in expected]
    np.testing.assert_allclose([one.t for one in found], [t for t, _ in expected], atol=0.04)
    assert all(isinstance(one, Crossing) for one in found)
