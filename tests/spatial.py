"""Spatial mechanisms for tests, and what is known of them independently."""

import numpy as np
from scipy.spatial.transform import Rotation

#: A mechanism with every joint, every element, and both kinds of laws that are driven.
EVERYTHING = """\
dimensions: 3
points:
  G: {fixed: [0.3, -2, 0.4]}
bodies:
  one: {position: [0.1, 0.2, 0.3], axes: {x: [1, 2, 2], y: [2, 1, -2]}, mass: 3,
        centre: [0.1, -0.2, 0.3], inertia: {xx: 2, yy: 3, zz: 4, xy: 0.2, xz: -0.1, yz: 0.3},
        angular_velocity: [1, 2, 3]}
  two: {position: [1.1, 0.4, -0.3], axes: {x: [0, 1, 0], y: [0, 0, 1]}, mass: 2,
        inertia: [1, 1.5, 2]}
  three: {position: [2, 1, 0], mass: 1, box: [0.3, 0.4, 0.5]}
  four: {position: [3, 1, 0.2], mass: 1.5, inertia: [1, 1, 1]}
body_points:
  P: {on: one, at: [0.2, 0.1, -0.4], mass: 0.7}
  Q: {on: two, at: [-0.3, 0.5, 0.1]}
  R: {on: four, at: [0.3, 0.2, -0.1]}
joints:
JOINTS
springs:
  s1: {from: P, to: Q, stiffness: 7, rest_length: 0.3}
  s2: {from: G, to: R, stiffness: 5, rest_length: 0.9}
dampers:
  c1: {from: P, to: R, damping: 0.6}
  c2: {from: Q, to: G, damping: 0.4}
torsion_springs:
  k1: {on: H, stiffness: 1.7, rest_angle: 0.4}
  k2: {on: K, stiffness: 0.9}
torsion_dampers:
  b1: {on: K, damping: 0.3}
torques:
  t1: {on: one, torque: [1, -2, 0.5]}
  t2: {on: two, torque: [0.3, 0.8, -1.1], frame: body}
  t3: {on: H, torque: 0.7}
forces:
  f1: {at: Q, force: [1, 2, -3]}
  f2: {at: four, force: [0.5, 0, 1]}
motions:
  m1: {point: R, z: {amplitude: 0.3, frequency: 2}}
  m2: {joint: J, angle: {rate: 0.7, amplitude: 0.2, frequency: 3}}
gravity: [0.3, -1, -9]
"""

#: Joints of it, in two sets so that both mechanisms can move.
SETS = {
    "pairs": """\
  H: {type: revolute, from: ground, to: one, at: [0, 0.5, 1], axis: [1, 1, 0.3]}
  J: {type: revolute, from: one, to: two, at: [1, 0, 0], axis: [0.2, -1, 0.5]}
  K: {type: cylindrical, from: two, to: three, at: [2, 0, 1], axis: [0, 1, 1]}
  U: {type: universal, from: three, to: four, at: [3, 0, 0], axes: [[1, 1, 0], [1, -1, 0.5]]}
""",
    "planes": """\
  H: {type: planar, from: one, to: ground, at: [0, 0.5, 1], axis: [1, 1, 0.3]}
  J: {type: cylindrical, from: ground, to: two, at: [1, 0, 0], axis: [0.2, -1, 0.5]}
  K: {type: planar, from: two, to: three, at: [2, 0, 1], axis: [0, 1, 1]}
  S: {type: spherical, from: four, to: one, at: [2, 2, 1]}
  L: {type: point-on-line, from: three, to: four, at: [3, 1, 0], axis: [1, 1, 1]}
""",
    "slides": """\
  H: {type: revolute, from: one, to: ground, at: [0, 0.5, 1], axis: [1, 1, 0.3]}
  P1: {type: prismatic, from: one, to: two, at: [1, 0, 0], axis: [0.2, -1, 0.5]}
  J: {type: cylindrical, from: two, to: three, at: [2, 0, 1], axis: [0, 1, 1]}
  K: {type: cylindrical, from: four, to: ground, at: [2, 0, 1], axis: [0, 1, 1]}
  D: {type: distance, from: three, to: four, at: {three: [0.1, 0.2, 0], four: [0, -0.3, 0.1]}}
  N: {type: point-on-plane, from: four, to: two, at: [3, 1, 0], axis: [1, -1, 1]}
""",
    "fixed": """\
  H: {type: revolute, from: ground, to: one, at: [0, 0.5, 1], axis: [1, 1, 0.3]}
  F: {type: rigid, from: one, to: two, at: [1, 0, 0]}
  K: {type: revolute, from: two, to: three, at: [2, 0, 1], axis: [0, 1, 1]}
  J: {type: planar, from: ground, to: four, at: [2, 0, 1], axis: [0, 1, 1]}
""",
}


def everything(name):
    """One of `SETS` as the text of a file, its velocities projected."""
    return EVERYTHING.replace("JOINTS\n", SETS[name]) + "project_velocities: true\n"


def cross(vector):
    """(3, 3) matrix of the cross product from the left."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def state(problem, u):
    """(bodies, 4, 3) origins and directors."""
    return np.asarray(u).reshape(-1, 4, 3)


def spin(u, v):
    """(bodies, 3) angular velocities, ω = ½ Σ d × d'."""
    directors, rates = state(None, u)[:, 1:], state(None, v)[:, 1:]
    return np.cross(directors, rates).sum(axis=1) / 2


def outputs(problem, t, u, v, multipliers):
    """Outputs by name, those of vectors together under their name."""
    values = problem.outputs.values(problem, t, u, v, multipliers)
    found = dict(zip(problem.outputs.names, values, strict=True))
    vectors = {name[:-2] for name in found if name.endswith(".x")}
    return found | {name: np.array([found[f"{name}.{axis}"] for axis in "xyz"]) for name in vectors}


#: Bennett's loop: four revolute joints with skew axes move where a/sin α = b/sin β.
LENGTH, TWIST, OTHER_TWIST, START = 1.0, 0.5, 1.1, 0.7
#: tan(θ/2) tan(φ/2) of angles of neighbouring joints (J. E. Baker, *Mech. Mach. Theory* 14, 1979).
RATIO = np.sin((OTHER_TWIST + TWIST) / 2) / np.sin((OTHER_TWIST - TWIST) / 2)


def bennett(redundant):
    """A moving loop, its frames by the parameters of Denavit and Hartenberg."""
    neighbour = 2 * np.arctan(RATIO / np.tan(START / 2))
    longer = LENGTH * np.sin(OTHER_TWIST) / np.sin(TWIST)
    frame, places, axes = np.eye(4), [], []
    for k, angle in enumerate((START, neighbour, -START, -neighbour)):
        places.append(frame[:3, 3].tolist())
        axes.append(frame[:3, 2].tolist())
        length, twist = ((LENGTH, TWIST), (longer, OTHER_TWIST))[k % 2]
        turn, lean = np.eye(4), np.eye(4)
        turn[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
        lean[:3, :3] = Rotation.from_euler("x", twist).as_matrix()
        lean[0, 3] = length
        frame = frame @ turn @ lean
    np.testing.assert_allclose(frame, np.eye(4), atol=1e-14)
    names = ["ground", "link1", "link2", "link3", "ground"]
    middles = np.add(places[:3], places[1:]) / 2
    return {
        "dimensions": 3,
        "bodies": {
            name: {"position": middle.tolist(), "mass": 1.0, "inertia": [0.1, 0.2, 0.25]}
            for name, middle in zip(names[1:], middles, strict=False)
        },
        "joints": {
            f"J{k + 1}": {
                "type": "revolute", "from": names[k], "to": names[k + 1],
                "at": places[k], "axis": axes[k],
            }
            for k in range(4)
        },
        "rates": {"J1": 2.0},
        "redundant": redundant,
    }  # fmt: skip
