"""What errors of λ are relative to: Gauss's function, other units and axes, fictitious masses."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import built

from newmark_cli.mechanisms.registry import problem
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.multipliers import weights


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


@pytest.mark.parametrize("name", ["slider-crank", "shaken-pendulum", "bricard"])
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
    for mass in ("", ", mass: 1", ", mass: 1e6"):
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
