"""Singular positions: found along a motion, and references up to them against quadratures."""

import math
import re

import numpy as np
import pytest
from each import each
from mechanisms import built

from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.problems import python_problem
from newmark_cli.problems.reference import NoReference, relative_error, solution
from newmark_cli.problems.singular import crossings

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


NAMES = "bars.one, bars.two, bars.three"


@each("linkage, bars, guess, in_line, names", [
    (
        SLIDER_CRANK, SLIDER_CRANK_BARS.replace("ROD", "1"), 1.6, lambda u: u[0],
        "bars.crank, bars.rod, sliders.rail",
    ),
    (PARALLELOGRAM, PARALLELOGRAM_BARS, 3.1, lambda u: u[1], NAMES),
    (CHANGE_POINT, CHANGE_POINT_BARS, 3.1, lambda u: u[1], NAMES),
])  # fmt: skip
def test_references_end_at_dead_centres(linkage, bars, guess, in_line, names):
    """As good as they say before, and past it the error names the time and the constraints."""
    subject = built(mechanism(linkage, bars))
    with pytest.raises(NoReference, match=f"depend on each other: {names}; end before") as caught:
        solution(subject, 1.0)
    end = float(re.search(r"no reference beyond t = ([\d.]+), ", str(caught.value))[1])
    assert in_line(linkage.at(end, guess)[0]) == pytest.approx(0, abs=2e-3)
    t = 0.9 * end
    u, v = linkage.at(t, guess)
    found = solution(subject, t)
    true = np.array([relative_error(found.u, u), relative_error(found.v, v)])
    estimated = np.array([found.u_error, found.v_error])
    assert np.all(true <= 3 * estimated)
    assert np.all(estimated < 1e-10)


def test_windows_that_fold_at_once():
    """In each a singular value vanishes; an error names only some of their bars."""
    subject = FAMILIES["four-bars"].problem("four-bars", {"windows": 4})
    words = r"beyond t = 0\.7\d*, .* other: bodies.rod0, bodies.coupler1, .* and 1 more; end before"
    with pytest.raises(NoReference, match=words):
        solution(subject, 1.5)


#: The slider is pulled beyond its reach; the parallelogram stops in line, ends in line, and
#: is driven through, y = 0.8 (1 − t)², 0.8 (1 − t) and 0.8 − 1.2 t.
LAWS = {
    "pulled": ("{point: S, x: {rate: 1}}", 1.0, 0.8),
    "at rest": ("{point: P, y: {rate: -1.6, acceleration: 1.6}}", 1.5, 1.0),
    "at the end": ("{point: P, y: {rate: -0.8}}", 1.0, 1.0),
    "through": ("{point: P, y: {rate: -1.2}}", 0.9, 2 / 3),
}


@each("law", LAWS)
def test_driven_to_singular_positions(law):
    """They end in a locked position, or may go on in two ways: time and reason are said."""
    linkage, bars = PARALLELOGRAM, PARALLELOGRAM_BARS
    if law == "pulled":
        linkage, bars = SLIDER_CRANK, SLIDER_CRANK_BARS.replace("ROD", "1")
    motion, t, end = LAWS[law]
    subject = built(mechanism(linkage, bars, f"motions: {{m: {motion}}}\n"))
    assert solution(subject, 0.5 * t).u_error < 1e-12
    words = r"no reference beyond t = ([\d.]+), .*depend on each other: (bars\.\w+, ){2}"
    with pytest.raises(NoReference, match=words) as caught:
        solution(subject, t)
    assert "\n" not in str(caught.value)
    found = float(re.search(words, str(caught.value))[1])
    # Next to a position where it stops no step gets any further.
    assert 0.95 * end < found <= 1.001 * end


def test_python_problem_at_its_dead_centre():
    """Plain functions, tangents by differences: the slider-crank in three coordinates."""
    definition = python_problem.Definition(
        mass_matrix=np.diag([1.0, 1.0, 2.0]),
        u0=np.array([0.6, 0.8, 1.2]),
        v0=np.array([-1.6, 1.2, -3.2]),
        force=lambda u, v, t: np.array([0.0, -9.81, 0.0]),
        constraints=lambda u, t: (
            np.array([u[0] ** 2 + u[1] ** 2 - 1, (u[2] - u[0]) ** 2 + u[1] ** 2 - 1]) / 2
        ),
        gradient=lambda u, t: np.array([[u[0], u[0] - u[2]], [u[1], u[1]], [0, u[2] - u[0]]]),
    )
    subject = python_problem.from_definition(definition, "crank")
    u, v = (part[:3] for part in SLIDER_CRANK.at(0.3, 1.4))
    found = solution(subject, 0.3)
    assert relative_error(found.u, u) < 1e-10
    assert relative_error(found.v, v) < 1e-10
    with pytest.raises(NoReference, match=r"beyond t = 0\.389\d*, .* other: 1, 2; end before it"):
        solution(subject, 0.6)


TIMES = np.array([-0.5, -0.3, -0.12, 0.07, 0.25, 0.41])


@each("value, expected", [
    (lambda t: t, [0.0]),
    (lambda t: t - 0.07, [0.07]),
    (lambda t: np.sin(t) - 0.2, [math.asin(0.2)]),
    (lambda t: 0.1 * t**3, [0.0]),
    (lambda t: 0.1 * (t - 0.05) ** 2, [0.05]),
    (lambda t: 0.1 * (t - 0.07) ** 2, [0.07]),
    (lambda t: np.hypot(t, 0.05), []),
    (lambda t: 0.001 + t**2, []),
    (lambda t: 1 + t, []),
    (lambda t: (t - 0.3) * (t + 0.2), [-0.2, 0.3]),
])  # fmt: skip
def test_crossings(value, expected):
    """Zeros of a singular value whose vectors turn."""
    frames = [np.linalg.qr(np.random.default_rng(k).normal(size=(k, k)))[0] for k in (5, 3)]
    g = []
    for t in TIMES:
        cosine, sine = np.cos(t / 2), np.sin(t / 2)
        turned = np.eye(5)
        turned[:2, :2] = [[cosine, -sine], [sine, cosine]]
        middle = np.zeros((5, 3))
        middle[:3] = np.diag([value(t), 0.9, 0.7])
        g.append(frames[0] @ turned @ middle @ frames[1].T)
    np.testing.assert_allclose(crossings(TIMES, np.array(g)), expected, atol=0.04)
