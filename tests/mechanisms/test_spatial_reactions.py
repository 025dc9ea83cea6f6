"""Reactions of every joint by Newton and Euler, loads, drives, starts, planar mechanisms."""

import numpy as np
import pytest
import spatial
from mechanisms import built
from spatial import outputs

from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.problems.index_1 import Index1

GRAVITY = np.array([0.3, -1, -9])
BODY = """\
dimensions: 3
bodies:
  body: {position: [0.1, 0.2, 0.3], axes: {x: [1, 2, 2], y: [2, 1, -2]}, mass: 3,
         centre: [0.1, -0.2, 0.3], inertia: {xx: 2, yy: 3, zz: 4, xy: 0.2, xz: -0.1, yz: 0.3},
         velocity: [0.4, -1, 2], angular_velocity: [1, 2, 3]}
joints:
  J: {type: KIND, from: FROM, to: TO, AT}
gravity: [0.3, -1, -9]
project_velocities: true
"""
INERTIA = np.array([[2, 0.2, -0.1], [0.2, 3, 0.3], [-0.1, 0.3, 4]])
AXIS, OTHER = np.array([1, 1, 0.3]), np.array([1, -1, 0])


#: A point of the body whose height is given: a row of no joint.
LIFTED, LIFT = [0.2, 0.1, -0.4], "motions: {lift: {point: P, z: {acceleration: 2}}}\n"


def hung(kind, turned, more=""):
    """A body that moves on one joint of the ground, which it goes to or from."""
    text = f"{BODY}body_points: {{P: {{on: body, at: {LIFTED}}}}}\n{more}".replace("KIND", kind)
    ends = ("body", "ground") if turned else ("ground", "body")
    text = text.replace("FROM", ends[0]).replace("TO", ends[1])
    at = "at: [0.5, -0.4, 1]"
    if JOINTS[kind].axes == 1:
        at += f", axis: {AXIS.tolist()}"
    elif JOINTS[kind].axes == 2:
        at += f", axes: [{AXIS.tolist()}, {OTHER.tolist()}]"
    elif kind == "distance":
        at = "at: {ground: [0.5, -0.4, 1], body: [0.2, 0.1, 0]}"
    return built(text.replace("AT", at))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("kind", "more"), [*((kind, "") for kind in JOINTS if kind != "rigid"), ("spherical", LIFT)]
)
def test_reactions_obey_newton_and_euler(kind, more, turned):
    """Force and moment of a joint are what its body's motion, weight and drive ask for."""
    subject = hung(kind, turned, more)
    a, multipliers = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    found = outputs(subject, 0.0, subject.u0, subject.v0, multipliers)
    (u,), (w,) = (x.reshape(-1, 4, 3) for x in (subject.u0, a))
    frame = u[1:].T
    omega = spatial.spin(subject.u0, subject.v0)[0]
    faster = spatial.spin(subject.u0, a)[0]  # d × d' has no rate of its own
    centre, inertia = np.array([0.1, -0.2, 0.3]), frame @ INERTIA @ frame.T
    place, acceleration = u[0] + frame @ centre, w[0] + w[1:].T @ centre
    whole, lift = 3 * (acceleration - GRAVITY), np.zeros(3)
    if more:
        lift[2] = multipliers[subject.constraint_names.index("motions.lift.z")]
        assert abs(lift[2]) > 1
    force = whole - lift
    about = subject.outputs.joints["J"].sides[1].place(subject.u0.reshape(-1, 4, 3))
    moment = inertia @ faster + np.cross(omega, inertia @ omega) + np.cross(place - about, whole)
    moment -= np.cross(u[0] + frame @ LIFTED - about, lift)
    sign = -1 if turned else 1
    np.testing.assert_allclose(found["J.force"], sign * force, rtol=0, atol=1e-12)
    if JOINTS[kind].dots:
        np.testing.assert_allclose(found["J.moment"], sign * moment, rtol=0, atol=1e-12)
    else:
        np.testing.assert_allclose(moment, 0, atol=1e-12)
    n, b = AXIS / np.linalg.norm(AXIS), OTHER / np.linalg.norm(OTHER)
    free = {
        "revolute": [("moment", n)],
        "universal": [("moment", n), ("moment", b)],
        "cylindrical": [("moment", n), ("force", n)],
        "prismatic": [("force", n)],
        "planar": [("moment", n), ("force", b), ("force", np.cross(n, b))],
        "point-on-line": [("force", n)],
        "point-on-plane": [("force", b), ("force", np.cross(n, b))],
        "distance": [("force", np.cross(n, found["J.force"]))],
        "spherical": [],
    }
    for of, direction in free[kind]:
        assert found[f"J.{of}"] @ direction == pytest.approx(0, abs=1e-11)


def test_rigid_joint_carries_weight_and_its_lever():
    """A second body on a first one at rest: m g up, and its moment about the joint."""
    subject = built("""\
dimensions: 3
bodies:
  base: {position: [0, 0, 0], mass: 1, inertia: [1, 1, 1]}
  arm: {position: [2, 1, 0], mass: 3, inertia: [1, 1, 1]}
joints:
  A: {type: prismatic, from: ground, to: base, at: [0, 0, 0], axis: [1, 0, 0]}
  R: {type: rigid, from: base, to: arm, at: [0.5, 0, 0]}
gravity: [0, 0, -10]
""")
    _, multipliers = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    found = outputs(subject, 0.0, subject.u0, subject.v0, multipliers)
    np.testing.assert_allclose(found["R.force"], [0, 0, 30], atol=1e-12)
    np.testing.assert_allclose(found["R.moment"], np.cross([1.5, 1, 0], [0, 0, 30]), atol=1e-12)
    np.testing.assert_allclose(found["A.force"], [0, 0, 40], atol=1e-12)


def test_places_and_axes_may_be_given_by_body():
    """In the body's own axes they are those of the ground, turned and shifted."""
    whole = hung("revolute", False)
    origin, *frame = whole.u0.reshape(4, 3)
    place, axis = (np.array(frame) @ vector for vector in ([0.5, -0.4, 1] - origin, AXIS))
    by_body = built(
        BODY.replace("KIND", "revolute").replace("FROM", "ground").replace("TO", "body").replace(
            "AT",
            f"at: {{ground: [0.5, -0.4, 1], body: {place.tolist()}}}, "
            f"axis: {{ground: {AXIS.tolist()}, body: {axis.tolist()}}}",
        )
    )  # fmt: skip
    one, other = (
        np.concatenate(Index1(subject).accelerations(0.0, subject.u0, subject.v0))
        for subject in (whole, by_body)
    )
    np.testing.assert_allclose(one, other, atol=1e-11)


@pytest.mark.parametrize("frame", ["ground", "body"])
def test_loads_of_a_free_body_obey_newton_and_euler(frame):
    """A force at a point of it, and a torque in the axes of the ground or of the body."""
    text = BODY[: BODY.index("joints:")] + BODY[BODY.index("gravity:") :] + (
        "body_points: {P: {on: body, at: [0.2, 0.1, -0.4]}}\n"
        "forces: {f: {at: P, force: [1, 2, -3]}, g: {at: body, force: [0.5, 0, 1]}}\n"
        f"torques: {{t: {{on: body, torque: [3, -2, 5]{', frame: body' * (frame == 'body')}}}}}\n"
    )  # fmt: skip
    subject = built(text)
    a, _ = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    (u,), (w,) = (x.reshape(-1, 4, 3) for x in (subject.u0, a))
    turned, pushes = u[1:].T, np.array([[1, 2, -3], [0.5, 0, 1]])
    omega, faster = (spatial.spin(subject.u0, x)[0] for x in (subject.v0, a))
    centre, inertia = turned @ [0.1, -0.2, 0.3], turned @ INERTIA @ turned.T
    np.testing.assert_allclose(
        3 * (w[0] + w[1:].T @ turned.T @ centre), 3 * GRAVITY + pushes.sum(0)
    )
    torque = np.array([3, -2, 5]) if frame == "ground" else turned @ [3, -2, 5]
    torque = torque + np.cross(turned @ [0.2, 0.1, -0.4] - centre, pushes[0])
    torque = torque + np.cross(-centre, pushes[1])
    np.testing.assert_allclose(inertia @ faster + np.cross(omega, inertia @ omega), torque)


WHEEL = """\
dimensions: 3
bodies: {wheel: {position: [0, 0, 0], mass: 2, inertia: [1, 1, 0.5]}}
joints: {A: {type: revolute, from: ground, to: wheel, at: [0, 0, 0], axis: [0, 0, 1]}}
"""


def wheel(angle, rate):
    """Coordinates and velocities of the wheel."""
    c, s = np.cos(angle), np.sin(angle)
    directors = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    turning = rate * np.array([[-s, c, 0], [-c, -s, 0], [0, 0, 0]])
    return (np.concatenate([np.zeros(3), x.ravel()]) for x in (directors, turning))


def test_torsion_and_torque_of_a_joint():
    """J φ'' = τ − k (φ − φ₀) − c φ', on either side; next to ±π there is no torque of a spring."""
    for from_, to, sign in (("ground", "wheel", 1), ("wheel", "ground", -1)):
        text = WHEEL.replace("from: ground, to: wheel", f"from: {from_}, to: {to}")
        subject = built(
            f"{text}torsion_springs: {{k: {{on: A, stiffness: 8, rest_angle: 1}}}}\n"
            "torsion_dampers: {c: {on: A, damping: 0.5}}\ntorques: {t: {on: A, torque: 10}}\n"
        )
        for angle, rate in ((0.7, 3.0), (-2.0, -1.0)):
            u, v = wheel(angle, rate)
            a, _ = Index1(subject).accelerations(0.0, u, v)
            torque = 10 - 8 * (sign * angle - 1) - 0.5 * sign * rate
            assert spatial.spin(u, a)[0][2] == pytest.approx(sign * torque / 0.5)
        for angle, is_known in ((3.0, True), (3.11, False), (-3.11, False)):
            u, v = wheel(angle, 0.0)
            force = subject.evaluate(0.0, u, v, np.zeros(subject.m)).force
            assert np.isfinite(force).all() == is_known


def test_a_driven_slider():
    """The multiplier is the force along an oblique axis, m (s'' − g·n)."""
    subject = built("""\
dimensions: 3
bodies: {cart: {position: [1, 0, 0], mass: 2, inertia: [1, 1, 1]}}
joints: {S: {type: prismatic, from: ground, to: cart, at: [0, 0, 0], axis: [0.6, 0, 0.8]}}
motions: {m: {joint: S, distance: {acceleration: 3}}}
gravity: [0, 0, -10]
""")
    _, multipliers = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    assert multipliers[-1] == pytest.approx(2 * (3 + 8))
    moved = subject.u0 + np.repeat([[0.3], [0], [0], [0]], 3, 1).ravel() * np.tile([0.6, 0, 0.8], 4)
    assert outputs(subject, 0, moved, moved, multipliers)["S.distance"] == pytest.approx(0.3)


RSSR = """\
dimensions: 3
bodies:
  crank: {position: [0.1, 0, 0], mass: 1, box: [0.2, 0.02, 0.02]}
  coupler: {position: [0.45, 0.2, 0.1], mass: 1, box: [0.8, 0.02, 0.02]}
  rocker: {position: [0.7, 0.4, 0.2], mass: 1, box: [0.02, 0.02, 0.4]}
joints:
  A: {type: revolute, from: ground, to: crank, at: {ground: [0, 0, 0], crank: [-0.1, 0, 0]},
      axis: {ground: [0, 0, 1], crank: [0, 0, 1]}}
  B: {type: spherical, from: crank, to: coupler, at: {crank: [0.1, 0, 0], coupler: [-0.4, 0, 0]}}
  C: {type: spherical, from: coupler, to: rocker, at: {coupler: [0.4, 0, 0], rocker: [0, 0, 0.2]}}
  D: {type: revolute, from: rocker, to: ground, axis: {rocker: [1, 0, 0], ground: [1, 0, 0]},
      at: {rocker: [0, 0, -0.2], ground: [0.7, 0.4, 0]}}
gravity: [0, 0, -9.81]
assemble: true
rates: {A: 2}
"""


def test_assembled_four_bar_with_a_rate():
    """From a guess: bodies keep their sizes, joints meet, and the crank turns as it is told."""
    subject = built(RSSR)
    assert subject.n - subject.m == 2  # the coupler may spin
    assert np.abs(subject.constraint_values(0.0, subject.u0)).max() < 1e-15
    bodies = subject.u0.reshape(-1, 4, 3)
    for frame in bodies[:, 1:]:
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-14)
    for joint in subject.outputs.joints.values():
        first, second = (side.place(bodies) for side in joint.sides)
        np.testing.assert_allclose(first, second, atol=1e-14)
    spins = spatial.spin(subject.u0, subject.v0)
    np.testing.assert_allclose(spins[0], [0, 0, 2], atol=1e-13)
    gradient = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(subject.m)).G
    assert np.abs(gradient.T @ subject.v0).max() < 1e-13


def test_both_rates_of_a_cylindrical_joint():
    """A screw motion: turning and sliding as the file says, from any initial velocities."""
    subject = built("""\
dimensions: 3
bodies:
  nut: {position: [1, 0.5, 0], mass: 2, inertia: [1, 2, 2], velocity: [9, 9, 9]}
joints:
  C: {type: cylindrical, from: ground, to: nut, at: [0, 0, 0], axis: [0, 0, 2]}
rates: {C: {angle: 3, distance: -0.5}}
""")
    np.testing.assert_allclose(spatial.spin(subject.u0, subject.v0)[0], [0, 0, 3], atol=1e-13)
    np.testing.assert_allclose(subject.v0[:3], [-1.5, 3, -0.5], atol=1e-13)
