"""Mistakes in mechanism files: one line each, with file, line and key, and what to do."""

import re

import numpy as np
import pytest
from mechanisms import built
from test_planar_parts import CART
from test_spatial_laws import BODIES

from newmark_cli.support.documents import DocumentError


def mistakes(text):
    """Texts of the mistakes of a file."""
    with pytest.raises(DocumentError) as caught:
        built(text, "bad")
    return [mistake.text for mistake in caught.value.mistakes]


RECTANGLE = """\
points:
  A: {fixed: [0, 0]}
  B: {fixed: [2, 0]}
  C: {at: [2, 1], mass: 1}
  D: {at: [0, 1], mass: 1}
bars:
  left: {from: A, to: D, length: 1}
  right: {from: B, to: C, length: 1}
  top: {from: D, to: C, length: 2}
"""
PLAIN_CART = CART.replace("assemble: true", "assemble: false")

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

#: What is replaced | by what; line, key and words of the mistake.
CARTS = r"""
wheel: pinion | wheel: onion
    21: rolling.rack.wheel: unknown body
radius: 0.2, line | radius: 0.25, line
    20: rolling.front: wheel starts with its centre 0.2 m away, its radius asks for 0.25 m;
radius: 0.3, body | radius: 0.35, body
    22: rolling.orbit: moon starts with its centre 0.4 m away, its radius asks for 0.45 m; correct
radius: 0.1, line: {on: cart, through: [0, 0.1], direction: [1, 0]} | radius: 0.1
    21: rolling.rack: needs either a line or a circle
radius: 0.3, body: wheel | radius: 0.1, inside: true
    22: rolling.orbit.radius: must be less than that of the circle around it, 0.1, given 0.1
angle: 0} | angle: 0.5}
    24: angle_joints.level: cart starts at 0 rad to ground, given 0.5
ratio: -2 | ratio: 0
    26: gears.mesh.ratio: must not be 0
to: pinion, ratio | to: wheel, ratio
    26: gears.mesh.to: must be different bodies
times: [-1, 0, 1, 2] | times: [-1, 0, 2, 1]
    29: motions.seat.distance.table.times: must increase: 1 follows 2
times: [-1, 0, 1, 2] | times: [0.5, 0.7, 1, 2]
    29: motions.seat.distance.table.times: must begin at 0 or before, given 0.5
values: [0.1, 0, 0.1, 0] | values: [0.1, 0, 0.1, 0], ends: periodic
    30: motions.seat.distance.table.values: must end as they begin to repeat: 0.1, 0
at: G, force | at: Z, force
    38: forces.push.at: unknown point 'Z'
on: wheel, from: cart | on: wheel, from: wheel
    40: torques.motor.from: must be another body than wheel
"""
RECTANGLES = r"""
points:\n | points:\n  E: {at: [1, 1]}\n
    2: points.E: E carries no mass
D: {at: [0, 1], mass: 1} | D: {at: [0, 1], mass: 1, velocity: [0, 1]}
    7: bars.left: initial velocities violate this constraint by
bars: | sliders: {s: {point: C, through: [0, 0], direction: [0, 0]}}\nbars:
    6: sliders.s.direction: must not be [0, 0]: it has no direction
bars: | sliders: {s: {point: C, through: [0, 0], direction: [1, 0]}}\nbars:
    6: sliders.s: starts 1 m off the line
length: 2} | length: 9}\nassemble: true
    10: assemble: no position found
bars: | motions: {m: {point: C}}\nbars:
    6: motions.m: needs a point with x or y
bars: | motions: {m: {point: C, x: {value: 3}}}\nbars:
    6: motions.m.x: the law starts at 3, the mechanism at 2
bars: | motions: {m: {point: A, x: {}}}\nbars:
    6: motions.m.point: A is fixed
"""
ARMS = r"""
[0, 0, -9.81] | [0, -9.81]
    13: gravity: must have three components, given two
dimensions: 3\n | # plane\n
    8: joints: is 'dimensions: 3' missing?
dimensions: 3 | dimensions: 4
    1: dimensions: must be 2 or 3, given 4
axes: [[ | axis: [0, 1, 0], axes: [[
    10: joints.B.axis: a universal joint has no 'axis'
[[0, 0, 1], [1, 0, 0]] | [[0, 0, 1], [1, 0, 0.1]]
    10: joints.B.axes: must be perpendicular, the cosine is 0.0995
mass: 1, inertia | axes: {x: [1, 0, 0], y: [0.1, 1, 0]}, mass: 1, inertia
    3: bodies.arm.axes.y: must be perpendicular to x, the cosine is 0.0995
[0.1, 1, 1] | [0.1, 1, 1.2]
    3: bodies.arm.inertia: no body has such moments, 0.1, 1, 1.2: the largest is more than the
inertia: [0.1, 1, 1] | inertia: [0.1, 1, 1], box: [1, 1, 1]
    3: bodies.arm.box: give either 'inertia' or 'box', not both
from: ground, to | from: grund, to
    9: joints.A.from: unknown body 'grund'; did you mean 'ground'?
at: [1, 0, 0] | at: {arm: [0.5, 0, 0], rid: [0, -0.5, 0]}
    10: joints.B.at: must name both bodies, arm and rod, given arm, rid
at: [1, 0, 0] | at: {arm: [0.5, 0, 0], rod: [0, -0.4, 0]}
    10: joints.B.at: its places on arm and rod start 0.1 m apart
axis: [0, 1, 0] | axis: {ground: [0, 1, 0], arm: [0, 1, 1]}
    9: joints.A.axis: its axes on ground and arm start 45° apart
F: {on: rod | F: {on: arm
    12: springs.s: joins E and F, which cannot move relative to each other
gravity | torsion_springs: {t: {on: B, stiffness: 1}}\ngravity
    13: torsion_springs.t.on: a universal joint has no angle; one of revolute, cylindrical,
gravity | motions: {m: {joint: A, distance: {rate: 1}}}\ngravity
    13: motions.m.distance: a revolute joint has none; one of cylindrical, prismatic has
gravity | motions: {m: {joint: A, angle: {value: 1}}}\ngravity
    13: motions.m.angle: the law starts at 1, the mechanism at 0
box: [0.1, 1, 0.1] | box: [0.1, 1, 0.1], velocity: [0, 0.3, 0]
    10: joints.B: initial velocities violate this constraint by 0.3 m/s (row y); correct them,
gravity | rates: {B: 1}\ngravity
    13: rates.B: a universal joint has no single rate; give its bodies 'angular_velocity'
springs: |   C: {type: spherical, from: ground, to: arm, at: [0, 1, 0]}\nsprings:
    11: joints.C: redundant: these constraints depend on each other: A (x, y, z, p, q), C (x, y,
gravity | redundant: {A: [r]}\ngravity
    13: redundant.A[1]: A has no row 'r'
gravity | redundant: {A: [q]}\ngravity
    13: redundant: nothing is redundant, A.q cannot be released
"""
LAWS = r"""
[0, 0, {powers: [0, 4]}] | {powers: [0, 4]}
    19: torques.twist.torque: must be [x, y, z] on a body
{powers: [0, 4]} | {power: [0, 4]}
    19: torques.twist.torque[3].power: unknown key
"""


def cases():
    """A file, one of its mistakes, and how that is told."""
    files = ((PLAIN_CART, CARTS), (RECTANGLE, RECTANGLES), (ARM, ARMS), (BODIES, LAWS))
    for text, table in files:
        lines = table.strip().splitlines()
        for change, told in zip(lines[::2], lines[1::2], strict=True):
            yield text, change, told.strip()


@pytest.mark.parametrize(("text", "change", "said"), [*cases()])
def test_mistake(text, change, said):
    """In one line, which says where it is and what is allowed."""
    old, new = change.replace("\\n", "\n").split(" | ")
    assert old in text
    (line, key, words), told = said.split(": ", 2), mistakes(text.replace(old, new, 1))
    wanted = [one for one in told if one.startswith(f"bad.yaml, line {line}: {key}: ")]
    assert any(words in one for one in wanted), told
    assert "\n" not in "".join(told)


def test_several_mistakes_are_told_at_once():
    """What does not depend on a mistake is looked at all the same; both files are right."""
    for right in (PLAIN_CART, RECTANGLE, ARM, BODIES):
        built(right)
    text = ARM.replace("on: arm", "on: arn").replace("from: ground", "from: grand")
    found = [one.partition(": unknown")[0] for one in mistakes(text)]
    assert found == ["bad.yaml, line 6: body_points.E.on", "bad.yaml, line 9: joints.A.from"]
    gear = "{from: wheel, to: pinion, ratio: -2, on: cart}"
    text = PLAIN_CART.replace(gear, "{from: wheel, to: wheel, ratio: 0}")
    assert mistakes(text) == [
        "bad.yaml, line 26: gears.mesh.ratio: must not be 0: the second body would not turn",
        "bad.yaml, line 26: gears.mesh.to: must be different bodies, and another than the carrier",
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
DIAGONALS = (
    "  one: {from: A, to: C, length: 2.23606797749979}\n"
    "  two: {from: B, to: D, length: 2.23606797749979}\n"
)
#: A coupler on three parallel cranks of one length: one is redundant wherever it moves to,
#: although G has full rank off the constraints.
CRANKS = """\
points:
  A: {fixed: [0, 0]}
  B: {fixed: [2, 0]}
  E: {fixed: [1, 0]}
  D: {at: [0, 1], mass: 1}
  C: {at: [2, 1], mass: 1}
bodies: {coupler: {from: D, to: C, length: 2, mass: 1, centre: [1, 0], inertia: 1}}
body_points: {M: {on: coupler, at: [1, 0]}}
bars:
  left: {from: A, to: D, length: 1}
  right: {from: B, to: C, length: 1}
  middle: {from: E, to: M, length: 1}
"""
#: Two bars in a line between supports: nothing moves, and neither bar is redundant.
STRETCHED = """\
points: {A: {fixed: [0, 0]}, B: {fixed: [2, 0]}, C: {at: [1, 0], mass: 1}, D: {at: [5, 0], mass: 1}}
bars:
  free: {from: B, to: D, length: 3}
  left: {from: A, to: C, length: 1}
  right: {from: B, to: C, length: 1}
"""
#: Crank and rod in a line, driven at the slider: a dead centre.
DEAD_CENTRE = """\
points: {O: {fixed: [0, 0]}, P: {at: [1, 0], mass: 1}, Q: {at: [3, 0], mass: 1}}
bars: {crank: {from: O, to: P, length: 1}, rod: {from: P, to: Q, length: 2}}
sliders: {guide: {point: Q, through: [0, 0], direction: [1, 0]}}
motions: {drive: {point: Q, x: {amplitude: 0.1, frequency: 1}}}
project_velocities: true
"""
DEPEND, ONLY_HERE = (
    "redundant: these constraints depend on each other: ",
    (
        "the start is a singular position, such as a dead centre: only here do these constraints "
        "depend on each other: "
    ),
)
#: Text, its only mistake, and whether it stays the same next to the position of the file.
WHOLE = {
    "three components in the plane": (
        "points: {O: {fixed: [0, 0, 0]}, P: {at: [1, 0], mass: 1}}\n"
        "bars: {b: {from: O, to: P, length: 1}}\n",
        "line 1: points.O.fixed: .* given three; is 'dimensions: 3' missing", False,
    ),
    "no constraint": (RECTANGLE[: RECTANGLE.index("bars")], "has no constraints", False),
    "no mass": (
        re.sub(r"mass: 1, (inertia|box): \S+ \S+ \S+\]", "mass: 0, inertia: [0, 0, 0]", ARM),
        "line 2: bodies: no body has mass", False,
    ),
    "no freedom": (
        ARM.replace("universal", "rigid").replace(
            ", axes: [[0, 0, 1], [1, 0, 0]]}",
            "}\n  C: {type: point-on-plane, from: ground, to: rod, at: [1, 0, 0], axis: [0, 0, 1]}",
        ),
        "line 8: joints: nothing can move: no freedom is left", False,
    ),
    "no inertia about its axis": (
        ROD, "line 3: bodies.rod: nothing stops rod from spinning about z, and it has no inertia",
        False,
    ),
    "rates that contradict": (
        ARM.replace(
            "springs:",
            "  C: {type: revolute, from: arm, to: ground, at: [0, 0, 0], axis: [0, 1, 0]}\n"
            "redundant: drop\nrates: {A: 1, C: 2}\nsprings:",
        ),
        "line 13: rates.*contradicts other rates or the constraints", False,
    ),
    "a guess that cannot be assembled": (
        ARM.replace("at: [1, 0, 0]", "at: {arm: [0.5, 0, 0], rod: [0, -0.5, 0]}").replace(
            "springs:",
            "  C: {type: distance, from: ground, to: rod, at: {ground: [9, 0, 0], rod: [0, 0, 0]},"
            " length: 2}\nassemble: true\nsprings:",
        ),
        "line 12: assemble: .*C is open by 6.02 there", False,
    ),
    "flat in space": (FLAT, "line 10: joints.D: the start is a singular position", False),
    "diagonals": (RECTANGLE + DIAGONALS, f"line 11: bars.two: {DEPEND}.*bars.one, bars.two$", True),
    "three cranks": (
        CRANKS, f"line 12: bars.middle: {DEPEND}bars.left, bars.right, bars.middle$", True,
    ),
    "stretched": (
        STRETCHED, f"line 5: bars.right: {ONLY_HERE}bars.left, bars.right; start from another",
        True,
    ),
    "dead centre": (
        DEAD_CENTRE,
        f"line 4: motions.drive.x: {ONLY_HERE}bars.crank, bars.rod, motions.drive.x;", False,
    ),
}  # fmt: skip


@pytest.mark.parametrize(("name", "guessed"), [(name, False) for name in WHOLE] + [
    (name, True) for name, (*_, nearby) in WHOLE.items() if nearby
])  # fmt: skip
def test_mistakes_of_a_whole_mechanism(name, guessed):
    """Each is the only one that is told; redundant rows are told from singular positions."""
    text, said, _ = WHOLE[name]
    if guessed:  # every moving point a little off
        text = (
            re.sub(
                r"at: \[([\d.]+), ([\d.]+)\](?=, mass)",
                lambda found: f"at: [{float(found[1]) + 0.01}, {float(found[2]) + 0.003}]",
                text,
            )
            + "assemble: true\n"
        )
    (mistake,) = mistakes(text)
    assert re.search(f"^bad.yaml.*{said}", mistake), mistake


def test_thin_rod_on_a_revolute_joint_has_what_it_needs():
    """Across the axis of a revolute joint the same rod marches: M is singular, no matter."""
    text = ROD.replace("spherical", "revolute").replace("0]}\n", "0], axis: [1, 0, 0]}\n")
    text = text.replace("[2, 2, 0], axis: [1, 0, 0]}", "[2, 2, 0]}")
    subject = built(text)
    assert (np.linalg.matrix_rank(subject.M), subject.n) == (6, 12)


def test_contradicting_lengths():
    """Named with how far the closest position is from each; midway between two equal bars."""
    again = "  again: {from: D, to: C, length: 2.1}\nassemble: true\n"
    (mistake,) = mistakes(RECTANGLE + again)
    found = re.fullmatch(
        r"bad\.yaml, line 11: assemble: no position found from this guess: the closest one misses "
        r"bars\.top by (\S+) m, bars\.again by (\S+) m; these contradict each other, or .*",
        mistake,
    )
    # Φ of both is half the difference of squares: they share 2.1² − 2².
    between = np.sqrt((2.1**2 + 2**2) / 2)
    assert float(found[1]) == pytest.approx(between - 2, rel=1e-2)
    assert float(found[2]) == pytest.approx(2.1 - between, rel=1e-2)


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
