"""What errors of λ are relative to: Gauss's function, other units and axes, fictitious masses."""

import math
from dataclasses import replace

import numpy as np
import pytest
from each import each
from mechanisms import built

from newmark_cli.mechanisms.registry import problem
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.multipliers import relative_error, weights


def at_start(subject):
    """λ and weights at the start."""
    at = subject.t0, subject.u0
    return Index1(subject).accelerations(*at, subject.v0)[1], weights(subject, *at)


def least(mass, force, gradient, wanted):
    """Gauss's function ½ (a − a_f)ᵀ M (a − a_f) at its least with Gᵀa as wanted."""
    inverse = np.linalg.inv(mass)
    missing = wanted - gradient.T @ inverse @ force
    change = inverse @ gradient @ np.linalg.solve(gradient.T @ inverse @ gradient, missing)
    return 0.5 * change @ mass @ change


@each("name", ["andrews", "slider-crank", "shaken-pendulum", "bricard"])
def test_a_weighted_multiplier_is_what_gauss_function_falls_by(name):
    """½ (λ_k / √E_k)², for each constraint that is cut while the others hold."""
    subject = problem(name)
    # Nothing at rest, so that no multiplier vanishes.
    subject = replace(subject, v0=subject.v0 + np.sin(np.arange(subject.n)))
    multipliers, found = at_start(subject)
    terms = subject.evaluate(subject.t0, subject.u0, subject.v0, np.zeros(subject.m))
    _, curvature = subject.constraint_derivatives(subject.t0, subject.u0, subject.v0)
    whole = least(subject.M, terms.force, terms.G, -curvature)
    for k in range(subject.m):
        kept = np.arange(subject.m) != k
        cut = least(subject.M, terms.force, terms.G[:, kept], -curvature[kept])
        weighted = 0.5 * (multipliers[k] * found.sizes[k]) ** 2
        assert weighted == pytest.approx(whole - cut, rel=1e-6, abs=1e-9 * whole)
        assert weighted <= whole * (1 + 1e-9)


HOIST = """\
points:
  A: {{fixed: {a}}}
  W: {{fixed: {w}}}
  B: {{at: {b}}}
  S: {{at: {s}, mass: {mass}}}
bodies:
  lever: {{from: A, to: B, length: {l1}, mass: {lever}, centre: {centre}, inertia: {inertia}}}
body_points:
  P: {{on: lever, at: {p}}}
bars:
  link: {{from: P, to: S, length: {l2}}}
sliders:
  rail: {{point: S, through: {a}, direction: {direction}}}
springs:
  counterweight: {{from: W, to: S, stiffness: {stiffness}, rest_length: {rest}}}
gravity: {gravity}
assemble: true
"""


def hoist(length=1.0, mass=1.0, time=1.0, turned=0.0, shifted=(0.0, 0.0)):
    """The hoist of the README where its units of length, mass and time are parts of the SI's."""
    cosine, sine = math.cos(turned), math.sin(turned)

    def vector(x, y, unit=1.0):
        return [unit * (cosine * x - sine * y), unit * (sine * x + cosine * y)]

    def place(x, y):
        return vector(x + shifted[0], y + shifted[1], length)

    text = HOIST.format(
        a=place(0, 0), w=place(2.2, 1.6), b=place(0.4, 0.3), s=place(1.3, 0.65), mass=2 * mass,
        l1=0.5 * length, lever=1.2 * mass, centre=[0.25 * length, 0.05 * length],
        inertia=0.03 * mass * length**2, p=[0.5 * length, 0.25 * length], l2=1.05 * length,
        direction=vector(2, 1), stiffness=80 * mass / time**2, rest=0.9 * length,
        gravity=vector(0, -9.81, length / time**2),
    )  # fmt: skip
    return built(text)


CRANK = """\
dimensions: 3
bodies:
  crank: {{position: {crank}, mass: 0.12, inertia: {light}}}
  rod:
    {{position: {rod}, axes: {{x: [0.2, -0.1, -0.2], y: [0, 2, -1]}}, mass: 0.5, inertia: {heavy}}}
  slider: {{position: {slider}, mass: 2, inertia: {light}}}
joints:
  A: {{type: revolute, from: ground, to: crank, at: {a}, axis: [1, 0, 0]}}
  B: {{type: spherical, from: crank, to: rod, at: {b}}}
  C: {{type: universal, from: slider, to: rod, at: {slider}, axes: [[1, 0, 0], [0, 2, -1]]}}
  S: {{type: prismatic, from: ground, to: slider, at: {slider}, axis: [1, 0, 0]}}
rates: {{A: 6}}
gravity: {gravity}
"""


def crank(length=1.0):
    """A slider-crank in space; directors have no unit."""

    def place(*given):
        return [length * each for each in given]

    text = CRANK.format(
        crank=place(0, 0.1, 0.16), rod=place(0.1, 0.05, 0.1), slider=place(0.2, 0, 0),
        light=[length**2 * each for each in (1e-4, 1e-4, 1e-5)],
        heavy=[length**2 * each for each in (4e-4, 4e-3, 4e-3)],
        a=place(0, 0.1, 0.12), b=place(0, 0.1, 0.2), gravity=place(0, 0, -9.81),
    )  # fmt: skip
    return built(text)


def judged(subject):
    """Relative errors of λ, each multiplier off by a part in a thousand in turn."""
    multipliers, found = at_start(subject)
    scales = found.scales(multipliers)
    errors = 1e-3 * np.diag(multipliers)
    return np.array([relative_error(multipliers + one, multipliers, scales) for one in errors])


def test_errors_of_multipliers_do_not_depend_on_units():
    """In space, with directors."""
    usual, other = judged(crank(1.0)), judged(crank(1000.0))
    assert usual.max() == pytest.approx(1e-3)
    assert usual.min() < 0.7e-3
    np.testing.assert_allclose(other, usual, rtol=1e-6, atol=1e-12)


@each(
    "how",
    [
        {"length": 1e3},
        {"mass": 1e3},
        {"time": 1e3},
        {"length": 0.01, "mass": 1e-3, "time": 60.0},
        {"turned": 0.7},
        {"turned": math.pi / 2, "shifted": (3.0, -5.0)},
    ],
)
def test_errors_of_multipliers_are_those_of_the_mechanism(how):
    """The hoist in other units, rotated and shifted."""
    usual, other = (judged(hoist(**given)) for given in ({}, how))
    np.testing.assert_allclose(other, usual, rtol=1e-6)


SHAKEN = """\
points:
  C: {{at: [0, 0]{mass}, velocity: [0.8, 0]}}
  P: {{at: [0.6, -0.8], mass: 1, velocity: [0.8, 0]}}
  Q: {{at: [1.2, 0], mass: 2, velocity: [0.8, 0]}}
bars: {{upper: {{from: C, to: P, length: 1}}, lower: {{from: P, to: Q, length: 1}}}}
sliders: {{rail: {{point: C, through: [0, 0], direction: [1, 0]}}}}
motions: {{drive: {{point: C, x: {{rate: 0.8, acceleration: 90}}}}}}
gravity: [0, -9.81]
"""


def test_a_driven_point_with_any_mass_does_not_rule():
    """Nor one without: bars are compared with bars; the drive with its own load."""
    parts = []
    for mass in ("", ", mass: 1e-6", ", mass: 1", ", mass: 1e6"):
        subject = built(SHAKEN.format(mass=mass))
        multipliers, found = at_start(subject)
        names = [name.partition(".")[0] for name in subject.constraint_names]
        assert [name == "bars" for name in names] == (found.parts == 0).tolist()
        bars = [k for k, name in enumerate(names) if name == "bars"]
        parts.append((found.scales(multipliers) / np.abs(multipliers))[bars])
        drive = names.index("motions")
        assert found.scales(multipliers)[drive] >= np.abs(multipliers[drive])
    for other in parts[1:]:
        np.testing.assert_allclose(other, parts[0], rtol=1e-6)
    assert parts[0].min() == pytest.approx(1)


def test_the_largest_multiplier_of_each_step():
    """In the unit of the constraint with the largest of all; at rest there is none."""
    _, found = at_start(problem("slider-crank"))
    assert not found.parts.any()
    units = 1 / found.sizes
    values = np.array([[3.0, 0.0, 0.0], [0.0, -1.0, 0.0], [2.0, 0.0, -4.0]]) * units[:3]
    np.testing.assert_allclose(found.largest(values), np.array([3.0, 1.0, 4.0]) * units[2])
    np.testing.assert_array_equal(found.largest(0 * values), 0)
    assert found.largest(values[:0]).shape == (0,)
    assert np.isnan(found.largest(np.array([[1.0, np.nan, 1.0]]))).all()
    # A prescribed part counts where nothing else has a load.
    found = found._replace(parts=np.array([0, 0, 1]))
    np.testing.assert_allclose(found.largest(values), np.array([3.0, 1.0, 2.0]) * units[0])
    values[:, :2] = 0
    np.testing.assert_allclose(found.largest(values), np.array([0.0, 0.0, 4.0]) * units[2])
