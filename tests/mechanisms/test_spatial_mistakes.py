"""Mistakes in spatial mechanism files: one line each, with file, line and key."""

import numpy as np
import pytest
from each import each
from mechanisms import built

from newmark_cli.support.documents import DocumentError

ARM = """\
dimensions: 3
bodies:
  arm: {position: [0.5, 0, 0], mass: 1, inertia: [0.1, 1, 1]}
  rod: {position: [1, 0.5, 0], mass: 1, box: [0.1, 1, 0.1]}
body_points:
  E: {on: arm, at: [0.2, 0.3, 0]}
  F: {on: rod, at: [0.2, 0.3, 0]}
joints:
  A: {type: revolute, from: ground, to: arm, at: [0, 0, 0], axis: [0, 1, 0]}
  B: {type: universal, from: arm, to: rod, at: [1, 0, 0], axes: [[0, 0, 1], [1, 0, 0]]}
springs:
  s: {from: E, to: F, stiffness: 3, rest_length: 1}
gravity: [0, 0, -9.81]
"""

#: What is replaced, by what, the line and the key of the mistake, and words of it.
MISTAKES = {
    "gravity of the plane": (
        "[0, 0, -9.81]", "[0, -9.81]", 13, "gravity", "must have three components, given two",
    ),
    "dimensions left out": (
        "dimensions: 3\n", "# plane\n", 8, "joints", "is 'dimensions: 3' missing?",
    ),
    "dimensions": ("dimensions: 3", "dimensions: 4", 1, "dimensions", "must be 2 or 3, given 4"),
    "no direction": (
        "axis: [0, 1, 0]", "axis: [0, 0, 0]", 9, "joints.A.axis",
        "must not be [0, 0, 0]: it has no direction",
    ),
    "no axis": (", axis: [0, 1, 0]", "", 9, "joints.A.axis", "missing: a revolute joint has it"),
    "an axis too much": (
        "axes: [[", "axis: [0, 1, 0], axes: [[", 10, "joints.B.axis",
        "a universal joint has no 'axis'",
    ),
    "universal axes askew": (
        "[[0, 0, 1], [1, 0, 0]]", "[[0, 0, 1], [1, 0, 0.1]]", 10, "joints.B.axes",
        "must be perpendicular, the cosine is 0.0995",
    ),
    "body axes askew": (
        "mass: 1, inertia", "axes: {x: [1, 0, 0], y: [0.1, 1, 0]}, mass: 1, inertia", 3,
        "bodies.arm.axes.y", "must be perpendicular to x, the cosine is 0.0995",
    ),
    "negative moment": (
        "[0.1, 1, 1]", "{xx: 1, yy: 1, zz: 1, xy: 2}", 3, "bodies.arm.inertia",
        "must not have a negative moment, -1, 1, 3",
    ),
    "impossible moments": (
        "[0.1, 1, 1]", "[0.1, 1, 1.2]", 3, "bodies.arm.inertia",
        "no body has such moments, 0.1, 1, 1.2: the largest is more than the sum of the others; "
        "are they about the centre?",
    ),
    "box and inertia": (
        "inertia: [0.1, 1, 1]", "inertia: [0.1, 1, 1], box: [1, 1, 1]", 3, "bodies.arm.box",
        "give either 'inertia' or 'box', not both",
    ),
    "joint with itself": (
        "from: arm, to: rod", "from: arm, to: arm", 10, "joints.B.to", "joins arm with itself",
    ),
    "unknown body": (
        "from: ground, to", "from: grund, to", 9, "joints.A.from",
        "unknown body 'grund'; did you mean 'ground'?",
    ),
    "body called ground": (
        "  rod: {pos",
        "  ground: {position: [5, 0, 0], mass: 1, box: [1, 1, 1]}\n  rod: {pos", 4,
        "bodies.ground", "give this body another name",
    ),
    "unknown type": ("type: revolute", "type: hinge", 9, "joints.A.type", "must be 'spherical',"),
    "no distance": (
        "revolute, from: ground, to: arm, at: [0, 0, 0], axis: [0, 1, 0]",
        "distance, from: ground, to: arm, at: [0, 0, 0]", 9, "joints.A.at",
        "a distance has two points",
    ),
    "places of other bodies": (
        "at: [1, 0, 0]", "at: {arm: [0.5, 0, 0], rid: [0, -0.5, 0]}", 10, "joints.B.at",
        "must name both bodies, arm and rod, given arm, rid",
    ),
    "places apart": (
        "at: [1, 0, 0]", "at: {arm: [0.5, 0, 0], rod: [0, -0.4, 0]}", 10, "joints.B.at",
        "its places on arm and rod start 0.1 m apart",
    ),
    "axes apart": (
        "axis: [0, 1, 0]", "axis: {ground: [0, 1, 0], arm: [0, 1, 1]}", 9, "joints.A.axis",
        "its axes on ground and arm start 45° apart",
    ),
    "spring in a body": (
        "F: {on: rod", "F: {on: arm", 12, "springs.s",
        "joins E and F, which cannot move relative to each other",
    ),
    "spring without length": (
        "on: rod, at: [0.2, 0.3, 0]", "on: rod, at: [-0.3, -0.2, 0]", 12, "springs.s",
        "E and F start in one place",
    ),
    "torsion spring on a universal joint": (
        "gravity", "torsion_springs: {t: {on: B, stiffness: 1}}\ngravity", 13,
        "torsion_springs.t.on", "a universal joint has no angle; one of revolute, cylindrical,",
    ),
    "torsion spring wound up": (
        "gravity", "torsion_springs: {t: {on: A, stiffness: 1, rest_angle: 4}}\ngravity", 13,
        "torsion_springs.t.rest_angle", "must be less than or equal to 3, given 4",
    ),
    "motion of nothing": (
        "gravity", "motions: {m: {joint: A, x: {rate: 1}}}\ngravity", 13, "motions.m",
        "needs a joint with angle or distance, or a point with x, y or z",
    ),
    "motion of what does not move": (
        "gravity", "motions: {m: {joint: A, distance: {rate: 1}}}\ngravity", 13,
        "motions.m.distance", "a revolute joint has none; one of cylindrical, prismatic has",
    ),
    "motion that starts elsewhere": (
        "gravity", "motions: {m: {joint: A, angle: {value: 1}}}\ngravity", 13, "motions.m.angle",
        "the law starts at 1, the mechanism at 0",
    ),
    "velocities": (
        "box: [0.1, 1, 0.1]", "box: [0.1, 1, 0.1], velocity: [0, 0.3, 0]", 10, "joints.B",
        "initial velocities violate this constraint by 0.3 m/s (row y); correct them, give 'rates' "
        "of joints, or set "
        "'project_velocities: true'",
    ),
    "rate of no joint": (
        "gravity", "rates: {C: 1}\ngravity", 13, "rates.C", "unknown joint 'C'",
    ),
    "rate of a joint without one": (
        "gravity", "rates: {B: 1}\ngravity", 13, "rates.B", "a universal joint has no single rate",
    ),
    "redundant": (
        "springs:",
        "  C: {type: spherical, from: ground, to: arm, at: [0, 1, 0]}\nsprings:", 11, "joints.C",
        "redundant: these constraints depend on each other: A (x, y, z, p, q), C (x, y, z); "
        "'redundant: drop' releases C.x, C.y, C.z",
    ),
    "no such row": (
        "gravity", "redundant: {A: [r]}\ngravity", 13, "redundant.A[1]", "A has no row 'r'",
    ),
    "released in vain": (
        "gravity", "redundant: {A: [q]}\ngravity", 13, "redundant",
        "nothing is redundant, A.q cannot be released",
    ),
    "no freedom": (
        "universal, from: arm, to: rod, at: [1, 0, 0], axes: [[0, 0, 1], [1, 0, 0]]}",
        "rigid, from: arm, to: rod, at: [1, 0, 0]}\n"
        "  C: {type: point-on-plane, from: ground, to: rod, at: [1, 0, 0], axis: [0, 0, 1]}", 8,
        "joints", "nothing can move: no freedom is left",
    ),
    "no mass": ("mass: 1", "mass: 0", 2, "bodies", "no body has mass"),
    "no bodies": ("bodies:\n  arm: {position: [0.5, 0, 0], mass: 1, inertia: [0.1, 1, 1]}\n"
                  "  rod: {position: [1, 0.5, 0], mass: 1, box: [0.1, 1, 0.1]}\n", "bodies: {}\n",
                  2, "bodies", "must have at least 1 item, given 0"),
}  # fmt: skip


def mistakes(text):
    """Mistakes of a file."""
    with pytest.raises(DocumentError) as caught:
        built(text, "arm")
    return caught.value.mistakes


def test_it_is_right_as_it_stands():
    """The mechanism of these tests has no mistake: 3 freedoms."""
    subject = built(ARM)
    assert (subject.n, subject.m) == (24, 21)


@each("name", MISTAKES)
def test_mistake(name):
    """Each is refused in one line, which says where it is and what is allowed."""
    old, new, line, key, words = MISTAKES[name]
    assert old in ARM
    # Massless bodies have no box, and no mass is no inertia.
    text = ARM.replace(old, new) if name == "no mass" else ARM.replace(old, new, 1)
    if name == "no mass":
        text = text.replace("[0.1, 1, 1]", "[0, 0, 0]")
    found = mistakes(text)
    assert len(found) == 1, [one.text for one in found]
    assert found[0].text.startswith(f"arm.yaml, line {line}: {key}: "), found[0].text
    assert words in found[0].text
    assert "\n" not in found[0].text


def test_several_mistakes_are_told_at_once():
    """What does not depend on a mistake is looked at all the same."""
    text = ARM.replace("on: arm", "on: arn").replace("from: ground", "from: grand")
    assert [(one.line, one.path) for one in mistakes(text)] == [
        (6, ("body_points", "E", "on")),
        (9, ("joints", "A", "from")),
    ]


ROD = """\
dimensions: 3
bodies:
  rod: {position: [0, 0, 0], mass: 2, centre: [0, 0, 1], inertia: [2, 2, 0]}
joints:
  O: {type: spherical, from: ground, to: rod, at: [0, 0, 0]}
"""
#: At its start it has one dependence more than its neighbours, which is no redundancy.
FLAT = """\
dimensions: 3
bodies:
  crank: {position: [0.5, 0, 0], mass: 1, box: [1, 0.1, 0.1]}
  rod: {position: [2, 0, 0], mass: 1, box: [2, 0.1, 0.1]}
  rocker: {position: [2.5, 0, 0], mass: 1, box: [1, 0.1, 0.1]}
joints:
  A: {type: revolute, from: ground, to: crank, at: [0, 0, 0], axis: [0, 0, 1]}
  B: {type: universal, from: crank, to: rod, at: [1, 0, 0], axes: [[0, 0, 1], [0, 1, 0]]}
  C: {type: spherical, from: rod, to: rocker, at: [3, 0, 0]}
  D: {type: revolute, from: ground, to: rocker, at: [2, 0, 0], axis: [0, 0, 1]}
redundant: drop
"""

#: Text, where its one mistake is, and words of it.
OTHERS = {
    "three components in the plane": (
        "points: {O: {fixed: [0, 0, 0]}, P: {at: [1, 0], mass: 1}}\n"
        "bars: {b: {from: O, to: P, length: 1}}\n",
        "arm.yaml, line 1: points.O.fixed: ", "given three; is 'dimensions: 3' missing?",
    ),
    # One mistake, not one for each key.
    "a body with a position": (
        "bodies: {b: {position: [0, 0, 1], mass: 1, inertia: [1, 1, 1]}}\n",
        "arm.yaml, line 1: bodies.b.position: ",
        "only spatial mechanisms have it; is 'dimensions: 3' missing?",
    ),
    "a thin rod without inertia about its axis": (
        ROD, "arm.yaml, line 3: bodies.rod: ",
        "nothing stops rod from spinning about z, and it has no inertia there",
    ),
    "a singular position": (
        FLAT, "arm.yaml, line 10: joints.D: ", "the start is a singular position",
    ),
    "rates that contradict": (
        ARM.replace(
            "springs:",
            "  C: {type: revolute, from: arm, to: ground, at: [0, 0, 0], axis: [0, 1, 0]}\n"
            "redundant: drop\nrates: {A: 1, C: 2}\nsprings:",
        ),
        "arm.yaml, line 13: rates.", "contradicts other rates or the constraints",
    ),
    "a guess that cannot be assembled": (
        ARM.replace("at: [1, 0, 0]", "at: {arm: [0.5, 0, 0], rod: [0, -0.5, 0]}").replace(
            "springs:",
            "  C: {type: distance, from: ground, to: rod, at: {ground: [9, 0, 0], rod: [0, 0, 0]},"
            " length: 2}\nassemble: true\nsprings:",
        ),
        "arm.yaml, line 12: assemble: ", "C is open by 6.02 there",
    ),
}  # fmt: skip


@each("name", OTHERS)
def test_mistakes_of_other_mechanisms(name):
    """Each is the only one that is told, with its place and what is to be done."""
    text, place, words = OTHERS[name]
    (mistake,) = mistakes(text)
    assert mistake.text.startswith(place), mistake.text
    assert words in mistake.text


def test_thin_rod_on_a_revolute_joint_has_what_it_needs():
    """Across the axis of a revolute joint the same rod marches: M is singular, no matter."""
    text = ROD.replace("spherical", "revolute").replace(
        "at: [0, 0, 0]}", "at: [0, 0, 0], axis: [1, 0, 0]}"
    )
    subject = built(text)
    assert (np.linalg.matrix_rank(subject.M), subject.n) == (6, 12)


def test_validate_tells_of_a_mechanism(cli):
    """Freedoms, ranks, what is loose, and the inertia of bodies about centre and origin."""
    text = ARM.replace(
        "mass: 1, inertia: [0.1, 1, 1]", "mass: 2, centre: [0, 0, 3], inertia: [1, 1, 1]"
    )
    cli.write(
        "arm.yaml",
        text.replace(
            "body_points", "  free: {position: [5, 0, 0], mass: 1, box: [1, 1, 1]}\nbody_points"
        ),
    )
    assert cli("validate", "arm.yaml").stdout.splitlines() == [
        "arm.yaml: spatial mechanism, 36 coordinates, 27 constraints, 9 degrees of freedom; "
        "rank of M 36, of the saddle point 63",
        "  warning: nothing holds free: no joint has it",
        "  arm: inertia about its centre [1, 1, 1] kg m², about its origin [19, 19, 1] kg m²",
        "  rod: inertia about its centre and origin [0.0841667, 0.00166667, 0.0841667] kg m²",
        "  free: inertia about its centre and origin [0.166667, 0.166667, 0.166667] kg m²",
    ]
