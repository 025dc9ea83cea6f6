"""Singular positions: found along a motion, references up to them, and starts next to them."""

import math
import re

import numpy as np
import pytest
from mechanisms import built
from scipy.integrate import quad
from scipy.optimize import brentq

from newmark_cli.mechanisms import loading
from newmark_cli.problems.reference import NoReference, relative_error, solution
from newmark_cli.problems.singular import crossings
from newmark_cli.support.documents import DocumentError, parse

#: A crank and a rod of the same length: the slider passes the crank's pin.
SLIDER_CRANK = """\
points:
  O: {fixed: [0, 0]}
  P: {at: [0.6, 0.8], mass: 1, velocity: [-1.6, 1.2]}
  S: {at: [1.2, 0], mass: 2, velocity: [-3.2, 0]}
bars: {crank: {from: O, to: P, length: 1}, rod: {from: P, to: S, length: 1}}
sliders: {rail: {point: S, through: [0, 0], direction: [1, 0]}}
gravity: [0, -9.81]
project_velocities: true
"""
BEGIN = math.atan2(4, 3)


def rate(angle):
    """Of the crank, by the energy: ½ (1 + 8 sin²) φ'² + g sin φ."""
    kinetic = 2.0**2 * (1 + 8 * 0.64) + 2 * 9.81 * (0.8 - math.sin(angle))
    return math.sqrt(kinetic / (1 + 8 * math.sin(angle) ** 2))


def until(angle):
    """Time at which the crank gets there, by quadrature."""
    return quad(lambda a: 1 / rate(a), BEGIN, angle, epsabs=1e-14, epsrel=1e-13)[0]


def test_references_end_at_dead_centres():
    """As good as they say before, and past it the error names the time and the constraints."""
    subject = built(SLIDER_CRANK)
    words = r"beyond t = ([\d.]+), .* other: bars.crank, bars.rod, sliders.rail; end before"
    with pytest.raises(NoReference, match=words) as caught:
        solution(subject, 1.0)
    end = float(re.search(words, str(caught.value))[1])
    assert end == pytest.approx(until(math.pi / 2), abs=1e-3)
    angle = brentq(lambda a: until(a) - 0.9 * end, BEGIN, math.pi / 2, xtol=1e-14)
    c, s, turn = math.cos(angle), math.sin(angle), rate(angle)
    found = solution(subject, 0.9 * end)
    assert relative_error(found.u, np.array([c, s, 2 * c, 0])) <= 3 * found.u_error < 1e-10
    v = turn * np.array([-s, c, -2 * s, 0])
    assert relative_error(found.v, v) <= 3 * found.v_error < 1e-10


PARALLELOGRAM = """\
points:
  O: {fixed: [0, 0]}
  Q: {fixed: [4, 0]}
  P: {at: [0.6, 0.8], mass: 1}
  S: {at: [4.6, 0.8], mass: 3}
bars:
  one: {from: O, to: P, length: 1}
  two: {from: Q, to: S, length: 1}
  three: {from: P, to: S, length: 4}
project_velocities: true
"""


@pytest.mark.parametrize(("text", "motion", "t", "end"), [
    (SLIDER_CRANK, "{point: S, x: {rate: 1}}", 1.0, 0.8),
    (PARALLELOGRAM, "{point: P, y: {rate: -1.2}}", 0.9, 2 / 3),
])  # fmt: skip
def test_driven_to_singular_positions(text, motion, t, end):
    """Pulled beyond its reach, or driven through where it may go on in two ways."""
    subject = built(f"{text}motions: {{m: {motion}}}\n")
    assert solution(subject, 0.5 * t).u_error < 1e-12
    words = r"no reference beyond t = ([\d.]+), .*depend on each other: (bars\.\w+, ){2}"
    with pytest.raises(NoReference, match=words) as caught:
        solution(subject, t)
    # Next to a position where it stops no step gets any further.
    found = float(re.search(words, str(caught.value))[1])
    assert 0.95 * end < found <= 1.001 * end


TIMES = np.array([-0.5, -0.3, -0.12, 0.07, 0.25, 0.41])


@pytest.mark.parametrize(("value", "expected"), [
    (lambda t: t - 0.07, [0.07]),
    (lambda t: np.sin(t) - 0.2, [math.asin(0.2)]),
    (lambda t: 0.1 * (t - 0.05) ** 2, [0.05]),
    (lambda t: 0.1 * (t - 0.07) ** 2, [0.07]),
    (lambda t: np.hypot(t, 0.05), []),
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


#: A slider-crank whose slider is driven away from where the linkage is nearly straight.
DRIVEN = """\
points: {{A: {{fixed: [0, 0]}}, B: {{at: [2, {off!r}]}}, C: {{at: [4, 0], mass: 1}}}}
bodies:
  crank: {{from: A, to: B, length: 2, mass: 1, centre: [0.1, 0], inertia: 0.1}}
  rod: {{from: B, to: C, length: 2, mass: 1, centre: [0.1, 0], inertia: 0.1}}
sliders: {{rail: {{point: C, through: [0, 0], direction: [1, 0]}}}}
motions: {{push: {{point: C, x: {{rate: 1}}}}}}
project_velocities: true
{options}
"""


@pytest.mark.parametrize("options", ["", "assemble: true"])
@pytest.mark.parametrize("off", [0.0, 1e-10, 1e-8])
def test_driven_at_a_dead_centre(off, options):
    """Refused with the line of a constraint, or started with velocities that fit it."""
    document = parse(DRIVEN.format(off=off, options=options), "m.yaml")
    problem, refusal = None, ""
    try:
        problem = loading.built("m.yaml", document)
    except DocumentError as error:
        refusal = str(error)
    if problem is None:
        assert re.fullmatch(r"m\.yaml, line [3-8]: [\w.]+: .*", refusal)
        return
    rate, _ = problem.constraint_derivatives(problem.t0, problem.u0, problem.v0)
    values = problem.values(problem.t0, problem.u0, problem.v0, np.zeros(problem.m))
    gradient = np.zeros((problem.n, problem.m))
    np.add.at(gradient, (problem.pattern.g_rows, problem.pattern.g_columns), values.g)
    assert abs(rate).max() == pytest.approx(1, rel=1e-12)
    size = np.linalg.norm(gradient, axis=0) * max(abs(problem.v0).max(), 1)
    assert np.all(abs(gradient.T @ problem.v0 + rate) <= 2e-9 * size)
