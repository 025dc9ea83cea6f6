"""Laws of time in spatial mechanisms: forces, torques, driven joints and points."""

import math

import numpy as np
import pytest
from mechanisms import built
from scipy.interpolate import CubicSpline
from spatial import outputs

from newmark_cli.problems.index_1 import Index1
from newmark_cli.support.documents import DocumentError

#: A law of every kind, and what it is.
LAW = (
    "{value: 1, amplitude: 2, frequency: 3, phase: 1, powers: [0, 2, 1], "
    "sines: [{amplitude: 1, frequency: 2}], table: {times: [0, 1, 2], values: [0, 1, 5]}}"
)
TABLE = CubicSpline([0, 1, 2], [0, 1, 5])


def law(t):
    """The same as a function."""
    return 1 + 2 * np.sin(3 * t + 1) + 2 * t + t**2 + np.sin(2 * t) + TABLE(t)


BODIES = f"""\
dimensions: 3
bodies:
  slab: {{position: [0, 0, 0], mass: 2, box: [1, 1, 1]}}
  disc: {{position: [5, 0, 0], mass: 1, inertia: [0.2, 0.3, 0.4]}}
  far: {{position: [0, 5, 0], mass: 3, inertia: [0.5, 0.5, 0.5]}}
body_points: {{tip: {{on: slab, at: [0, 0, 0]}}, rim: {{on: disc, at: [0.3, 0.2, 0]}}}}
joints:
  rail: {{type: prismatic, from: ground, to: slab, at: [0, 0, 0], axis: [1, 0, 0]}}
  axle: {{type: revolute, from: ground, to: disc, at: [5, 0, 0], axis: [0, 0, 1]}}
  pole: {{type: cylindrical, from: ground, to: far, at: [0, 5, 0], axis: [0, 0, 1]}}
motions:
  lift: {{joint: pole, distance: {{powers: [0, 0, 0.3], sines: [{{amplitude: 0, frequency: 1}}]}}}}
  turn: {{joint: pole, angle: {{acceleration: 2}}}}
forces:
  push: {{at: tip, force: [{LAW}, 0, 5]}}
  side: {{at: rim, force: [0, 0, {LAW}]}}
torques:
  motor: {{on: axle, torque: {LAW}}}
  twist: {{on: far, torque: [0, 0, {{powers: [0, 4]}}]}}
  follow: {{on: slab, frame: body, torque: [1, {{powers: [2, 4]}}, 0]}}
project_velocities: true
"""


def test_accelerations_and_reactions_of_laws():
    """A slab that slides, a disc that turns, and a body that is driven, at some times."""
    subject = built(BODIES)
    assert (subject.until, subject.potential) == (2.0, None)
    for t in (0.0, 0.3, 1.9):
        u, v, c, s = (
            subject.u0.reshape(-1, 4, 3).copy(),
            np.zeros((3, 4, 3)),
            np.cos(t**2),
            np.sin(t**2),
        )
        u[2, 1:], v[2, 1:] = (
            [[c, s, 0], [-s, c, 0], [0, 0, 1]],
            [[-s, c, 0], [-c, -s, 0], [0, 0, 0]],
        )
        u[2, 0, 2], v[2, 0, 2] = 0.3 * t**2, 0.3
        u, v = u.ravel(), 2 * t * v.ravel()
        np.testing.assert_allclose(subject.constraint_values(t, u), 0, atol=1e-14)
        np.testing.assert_allclose(Index1(subject).rate(t, u, v), 0, atol=1e-14)
        a, multipliers = Index1(subject).accelerations(t, u, v)
        found = dict(zip(subject.coordinate_names, a, strict=True))
        assert found["slab.origin.x"] == pytest.approx(law(t) / 2, rel=1e-12)
        assert found["disc.d1.y"] == pytest.approx(law(t) / 0.4, rel=1e-12)
        assert found["far.origin.z"] == pytest.approx(0.6, rel=1e-12)
        # The torque of the drive is what the given one lacks.
        values = outputs(subject, t, u, v, multipliers)
        forces = dict(zip(subject.constraint_names, multipliers, strict=True))
        assert forces["motions.lift.distance"] == pytest.approx(3 * 0.6, rel=1e-12)
        assert forces["motions.turn.angle"] == pytest.approx(0.5 * 2 - 4 * t, abs=1e-12)
        # Of the slab's guide and the disc's axle: what they are loaded with, turned round.
        np.testing.assert_allclose(values["rail.force"], [0, 0, -5], atol=1e-11)
        np.testing.assert_allclose(values["rail.moment"], [-1, -2 - 4 * t, 0], atol=1e-11)
        np.testing.assert_allclose(values["axle.force"], [0, 0, -law(t)], atol=1e-11)
        expected = -np.cross([0.3, 0.2, 0], [0, 0, law(t)])
        np.testing.assert_allclose(values["axle.moment"], expected, atol=1e-11)


CRANK = """\
points:
  O: {{fixed: [0, 0]}}
  A: {{at: [0.5, 0], mass: 1}}
bodies:
  arm: {{from: O, to: A, length: 0.5, mass: 1, centre: [0.25, 0], inertia: 0.02}}
motions:
  drive: {{body: arm, angle: {law}}}
"""
HALF_TURN = math.pi / 2


@pytest.mark.parametrize(
    "law",
    [
        f"{{amplitude: -0.5, frequency: 2, phase: {HALF_TURN!r}}}",
        f"{{value: 0.5, sines: [{{amplitude: -0.5, frequency: 2, phase: {HALF_TURN!r}}}]}}",
        "{powers: [0, 0.4], amplitude: 0.2, frequency: -2}",
    ],
)
def test_a_start_at_rest_may_round(law):
    """The cosine of a phase of π/2 is 6e-17: what is left of terms that cancel is no motion."""
    assert not built(CRANK.format(law=law)).v0.any()


def test_a_start_at_rest_of_a_law_that_moves_is_refused():
    law = f"{{amplitude: -0.5, frequency: 2, phase: {HALF_TURN + 1e-7!r}}}"
    with pytest.raises(DocumentError, match="initial velocities violate this constraint by 5e-08"):
        built(CRANK.format(law=law))
