"""Names of coordinates and constraints, and what a multiplier is."""

import numpy as np
import pytest
from each import each
from mechanisms import built

from newmark_cli.mechanisms.registry import PROBLEMS, problem
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


@each("name", PROBLEMS)
def test_names_are_as_many_as_numbers_and_all_different(name):
    """One name for each coordinate and each constraint of the shipped problems."""
    subject = problem(name)
    for names, count in (
        (subject.coordinate_names, subject.n),
        (subject.constraint_names, subject.m),
    ):
        assert len(names) == count
        assert len(set(names)) == count


def test_names_of_a_definition():
    """What a problem in Python names is named so; numbers otherwise."""
    subject = from_definition(hanging(), "hanging")
    assert (subject.coordinate_names, subject.constraint_names) == (("1", "2"), ("1",))
    named = hanging(coordinate_names=["bob.x", "bob.y"], constraint_names=("rod",))
    subject = from_definition(named, "hanging")
    assert (subject.coordinate_names, subject.constraint_names) == (("bob.x", "bob.y"), ("rod",))


@each(
    "given, message",
    [
        (
            {"coordinate_names": ["x"]},
            "coordinate_names must be a list of 2 texts, all different, given ['x']",
        ),
        (
            {"coordinate_names": "xy"},
            "coordinate_names must be a list of 2 texts, all different, given 'xy'",
        ),
        (
            {"coordinate_names": 2},
            "coordinate_names must be a list of 2 texts, all different, given 2",
        ),
        (
            {"coordinate_names": ["x", 2]},
            "coordinate_names must be a list of 2 texts, all different, given ['x', 2]",
        ),
        (
            {"coordinate_names": ["x", " "]},
            "coordinate_names must be a list of 2 texts, all different, given ['x', ' ']",
        ),
        (
            {"coordinate_names": ["x", "x"]},
            "coordinate_names must be a list of 2 texts, all different, given ['x', 'x']",
        ),
        (
            {"constraint_names": ["rod", "bar"]},
            "a list of 1 texts, all different, given ['rod', 'bar']",
        ),
    ],
)
def test_names_that_cannot_be_used_are_refused(given, message):
    """Count, text and difference are checked."""
    with pytest.raises(ProblemError, match=r"^problem: ") as caught:
        from_definition(hanging(**given), "hanging")
    assert str(caught.value).endswith(message)


def multiplier(subject, name):
    """λ of a constraint at the start."""
    _, multipliers = Index1(subject).accelerations(subject.t0, subject.u0, subject.v0)
    return multipliers[subject.constraint_names.index(name)]


def test_a_multiplier_of_a_bar_is_minus_its_tension_over_its_length():
    """A pendulum at rest: the rod pulls with m g, λ L = −m g; N/m.

    Φ = (|Δ|² − L²)/2 has the gradient Δ: G λ pushes the end of a bar outwards where λ > 0.
    """
    bar = built(
        "points: {O: {fixed: [0, 0]}, P: {at: [0, -0.5], mass: 2.0}}\n"
        "bars: {rod: {from: O, to: P, length: 0.5}}\ngravity: [0, -3.0]\n"
    )
    assert multiplier(bar, "bars.rod") == pytest.approx(-2.0 * 3.0 / 0.5, rel=1e-14)
    assert multiplier(from_definition(hanging(), "h"), "1") == pytest.approx(-12.0, rel=1e-14)


def test_a_multiplier_of_a_body_is_minus_the_pull_between_its_points_over_their_distance():
    """A rod that hangs by its end pulls with m g; half of that passes its two points.

    A uniform rod in natural coordinates: masses m/3 at the points and m/6 between them.
    Gravity loads each point with m g/2; at rest λ L holds that of the lower one.
    """
    rod = built(
        "points: {O: {fixed: [0, 0]}, P: {at: [0, -2]}}\n"
        "bodies: {rod: {from: O, to: P, length: 2, mass: 6, centre: [1, 0], inertia: 2}}\n"
        "gravity: [0, -10]\n"
    )
    assert multiplier(rod, "bodies.rod") == pytest.approx(-30.0 / 2.0, rel=1e-14)


def test_a_multiplier_of_a_slider_is_a_force_along_the_left_normal():
    """A mass on a table: the line x pushes it up with m g (N); reversed, λ is −m g."""
    for direction, expected in (("[2, 0]", 6.0), ("[-2, 0]", -6.0)):
        table = built(
            "points: {P: {at: [1, 0], mass: 2.0}}\n"
            f"sliders: {{table: {{point: P, through: [0, 0], direction: {direction}}}}}\n"
            "gravity: [0, -3.0]\n"
        )
        assert multiplier(table, "sliders.table") == pytest.approx(expected, rel=1e-14)


def test_a_multiplier_of_a_driven_coordinate_is_the_force_that_drives_it():
    """A mass lifted with 0.5 m/s² under gravity 3: m (g + s) upwards (N)."""
    lift = built(
        "points: {P: {at: [0, 0], mass: 2.0}}\n"
        "motions: {lift: {point: P, x: {}, y: {acceleration: 0.5}}}\ngravity: [0, -3.0]\n"
    )
    assert multiplier(lift, "motions.lift.y") == pytest.approx(2.0 * 3.5, rel=1e-14)
    assert multiplier(lift, "motions.lift.x") == pytest.approx(0.0, abs=1e-14)


def test_a_multiplier_of_a_driven_angle_is_the_torque_over_the_distance_of_the_points():
    """A crank of length 2 held level against gravity: torque m g l/2 counter-clockwise, λ in N."""
    crank = built(
        "points: {O: {fixed: [0, 0]}, P: {at: [2, 0]}}\n"
        "bodies: {crank: {from: O, to: P, length: 2, mass: 6, centre: [1, 0], inertia: 2}}\n"
        "motions: {hold: {body: crank, angle: {}}}\ngravity: [0, -10]\n"
    )
    assert multiplier(crank, "motions.hold.angle") == pytest.approx(60.0 / 2.0, rel=1e-14)
    assert multiplier(crank, "bodies.crank") == pytest.approx(0.0, abs=1e-13)
