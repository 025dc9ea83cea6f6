"""Names of coordinates and constraints, and what a multiplier is."""

import numpy as np
import pytest
from mechanisms import built

from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import ProblemError
from newmark_cli.problems.python_problem import Definition, from_definition

#: Every kind of constraint, in another order than that of the rows.
EVERY_KIND = """\
motions:
  crank: {body: wheel, angle: {rate: 1.0}}
  lift: {point: D, x: {}, y: {rate: 0.1}}
sliders:
  guide: {point: C, through: [0, 2], direction: [1, 0]}
bars:
  rod: {from: A, to: B, length: 1.0}
bodies:
  wheel: {from: O, to: A, length: 1.0, mass: 2.0, inertia: 0.1}
points:
  O: {fixed: [0, 0]}
  A: {at: [1, 0], velocity: [0, 1]}
  B: {at: [2, 0], mass: 1.0, velocity: [0, 1]}
  C: {at: [0, 2], mass: 1.0}
  D: {at: [5, 5], mass: 1.0, velocity: [0, 0.1]}
"""


def hanging(**more):
    """A definition of a pendulum of mass 2 that hangs at rest, gravity 3, length 1/2."""
    given = {
        "mass_matrix": 2 * np.eye(2),
        "u0": [0.0, -0.5],
        "v0": [0.0, 0.0],
        "force": lambda u, v, t: np.array([0.0, -6.0]),
        "constraints": lambda u, t: np.array([(u @ u - 0.25) / 2]),
        "gradient": lambda u, t: u[:, None],
    }
    return Definition(**given | more)


def test_coordinates_and_constraints_are_named_by_their_parts():
    """Points in document order; constraints by kind and name, as the rows stand."""
    subject = built(EVERY_KIND)
    assert subject.coordinate_names == ("A.x", "A.y", "B.x", "B.y", "C.x", "C.y", "D.x", "D.y")
    assert subject.constraint_names == (
        "bodies.wheel", "bars.rod", "sliders.guide",
        "motions.crank.angle", "motions.lift.x", "motions.lift.y",
    )  # fmt: skip
    # Each row depends on the points of its part and on no other.
    touched = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(subject.m)).G != 0
    points = [
        {subject.points[i // 2] for i in np.flatnonzero(touched[:, k])} for k in range(subject.m)
    ]
    assert points == [{"A"}, {"A", "B"}, {"C"}, {"A"}, {"D"}, {"D"}]


def test_names_of_a_definition():
    """What a problem in Python names is named so; numbers otherwise."""
    subject = from_definition(hanging(), "hanging")
    assert (subject.coordinate_names, subject.constraint_names) == (("1", "2"), ("1",))
    named = hanging(coordinate_names=["bob.x", "bob.y"], constraint_names=("rod",))
    subject = from_definition(named, "hanging")
    assert (subject.coordinate_names, subject.constraint_names) == (("bob.x", "bob.y"), ("rod",))


@pytest.mark.parametrize("names", [["x"], "xy", 2, ["x", 2], ["x", " "], ["x", "x"]])
def test_names_that_cannot_be_used_are_refused(names):
    """Count, text and difference are checked."""
    for key, count, given in (("coordinate", 2, names), ("constraint", 1, ["rod", "bar"])):
        with pytest.raises(ProblemError, match=r"^problem: ") as caught:
            from_definition(hanging(**{f"{key}_names": given}), "hanging")
        said = f"{key}_names must be a list of {count} texts, all different, given {given!r}"
        assert str(caught.value).endswith(said)


#: Kind of constraint → a mechanism at rest, and its multipliers by hand.  Φ of a bar or body is
#: (|Δ|² − L²)/2, with the gradient Δ: G λ pushes the end outwards where λ > 0.
MULTIPLIERS = {
    "a bar pulls with m g, λ L = −m g": (
        "points: {O: {fixed: [0, 0]}, P: {at: [0, -0.5], mass: 2}}\n"
        "bars: {rod: {from: O, to: P, length: 0.5}}\ngravity: [0, -3]\n",
        {"bars.rod": -2 * 3 / 0.5},
    ),
    # In natural coordinates m/3 at the points and m/6 between them: gravity loads each with m g/2.
    "half of what hangs on a rod passes its two points": (
        "points: {O: {fixed: [0, 0]}, P: {at: [0, -2]}}\n"
        "bodies: {rod: {from: O, to: P, length: 2, mass: 6, centre: [1, 0], inertia: 2}}\n"
        "gravity: [0, -10]\n",
        {"bodies.rod": -30 / 2},
    ),
    "a line x pushes up along its left normal, in N": (
        "points: {P: {at: [1, 0], mass: 2}}\n"
        "sliders: {table: {point: P, through: [0, 0], direction: [2, 0]}}\ngravity: [0, -3]\n",
        {"sliders.table": 6},
    ),
    "a line that points to −x does so downwards": (
        "points: {P: {at: [1, 0], mass: 2}}\n"
        "sliders: {table: {point: P, through: [0, 0], direction: [-2, 0]}}\ngravity: [0, -3]\n",
        {"sliders.table": -6},
    ),
    "a driven coordinate takes m (g + s) upwards": (
        "points: {P: {at: [0, 0], mass: 2}}\n"
        "motions: {lift: {point: P, x: {}, y: {acceleration: 0.5}}}\ngravity: [0, -3]\n",
        {"motions.lift.x": 0, "motions.lift.y": 2 * 3.5},
    ),
    "a level crank takes the torque m g l/2, over the distance of its points": (
        "points: {O: {fixed: [0, 0]}, P: {at: [2, 0]}}\n"
        "bodies: {crank: {from: O, to: P, length: 2, mass: 6, centre: [1, 0], inertia: 2}}\n"
        "motions: {hold: {body: crank, angle: {}}}\ngravity: [0, -10]\n",
        {"motions.hold.angle": 60 / 2, "bodies.crank": 0},
    ),
}


@pytest.mark.parametrize("kind", MULTIPLIERS)
def test_what_a_multiplier_is(kind):
    text, expected = MULTIPLIERS[kind]
    subject = built(text)
    _, found = Index1(subject).accelerations(subject.t0, subject.u0, subject.v0)
    by_name = dict(zip(subject.constraint_names, found, strict=True))
    assert by_name == pytest.approx(expected, rel=1e-14, abs=1e-13)


def test_a_definition_has_the_multipliers_of_its_own_gradient():
    """G = u instead of a bar's Δ: the same, −m g/L."""
    subject = from_definition(hanging(), "h")
    _, found = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    assert found == pytest.approx([-12.0], rel=1e-14)
