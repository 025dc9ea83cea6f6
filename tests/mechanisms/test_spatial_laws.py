"""Laws of time in spatial mechanisms: forces, torques, driven joints and points."""

import numpy as np
import pytest
from each import each
from mechanisms import built
from scipy.interpolate import CubicSpline

import newmark_cli as newmark
from newmark_cli.support.documents import DocumentError

DISSIPATIVE = {"method": "generalized-alpha", "rho": 0.9}

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


@pytest.fixture(scope="module")
def bodies():
    """Three bodies, pushed, turned and driven by laws of time."""
    return built(BODIES)


def test_motions_and_reactions_of_laws(bodies):
    """A slab that slides and a disc that turns: ∫∫ of the law; forces of the drives; order 2."""
    x = TABLE.antiderivative(2)(1.0)
    # ∫∫ of 1 + 2 sin(3t + 1) + 2t + t² + sin 2t from rest, at t = 1.
    x += 0.5 - 2 * (np.sin(4) - np.sin(1)) / 9 + 2 * np.cos(1) / 3 + 1 / 3 + 1 / 12
    x += -np.sin(2) / 4 + 0.5
    turn = x / 0.4
    errors = []
    for h in (1e-2, 5e-3):
        march = newmark.march(bodies, h=h, t_end=1.0, every=0, integrator=DISSIPATIVE)
        names, u = march.coordinate_names, march.u[-1]
        found = [
            u[names.index("slab.origin.x")] - x / 2,
            np.angle(np.exp(-1j * turn) * complex(*u[[names.index(f"disc.d1.{c}") for c in "xy"]])),
            u[names.index("far.origin.z")] - 0.3,
        ]
        forces = dict(zip(march.constraint_names, march.multipliers[-1], strict=True))
        errors.append([*found, forces["motions.lift.distance"] - 3 * 0.6])
        # The torque of the drive is what the given one lacks.
        assert forces["motions.turn.angle"] == pytest.approx(0.5 * 2 - 4, abs=2e-2)
    errors = np.abs(errors)
    np.testing.assert_allclose(np.log2(errors[0, :2] / errors[1, :2]), 2, atol=0.1)
    assert errors[0, :2].max() < 1e-2
    np.testing.assert_allclose(errors[1, 2:], 0, atol=1e-4)
    assert bodies.until == 2.0
    assert bodies.potential is None


@each(
    ("old", "new", "words"),
    [
        ("[0, 0, {powers: [0, 4]}]", "{powers: [0, 4]}", "must be \\[x, y, z\\] on a body"),
        ("{powers: [0, 4]}", "{power: [0, 4]}", "torques.twist.torque\\[3\\].power"),
        ("powers: [0, 0, 0.3]", "powers: [1, 0, 0.3]", "the law starts at 1, the mechanism at 0"),
    ],
)
def test_mistakes_in_laws(old, new, words):
    assert BODIES.count(old) == 1
    with pytest.raises(DocumentError, match=words):
        built(BODIES.replace(old, new))
