"""Springs whose force is a law of their length, in the plane and in space."""

import numpy as np
import pytest
from mechanisms import built
from scipy.interpolate import PchipInterpolator

from newmark_cli.support.documents import DocumentError

LENGTHS, VALUES = [0.5, 1.0, 1.5, 2.5], [-20.0, 0.0, 30.0, 100.0]
TABLE = f"{{table: {{lengths: {LENGTHS}, values: {VALUES}}}}}"
POWERS = "{powers: [2, 100, 0, 500]}"
#: Two masses, a rod between them, and a spring of each kind.
PLANAR = f"""\
points:
  O: {{fixed: [0, 0]}}
  A: {{at: [1.3, 0.2], mass: 2}}
  B: {{at: [1.3, -0.8], mass: 1}}
bars: {{rod: {{from: A, to: B, length: 1}}}}
springs:
  hard: {{from: O, to: A, rest_length: 1, force: {POWERS}}}
  soft: {{from: O, to: B, force: {TABLE}}}
"""
#: A body that is free to move, its origin and another point of it on springs.
SPATIAL = f"""\
dimensions: 3
points: {{O: {{fixed: [0, 0, 0]}}}}
bodies: {{slab: {{position: [1, 0.5, 0.2], mass: 2, box: [1, 1, 1]}}}}
body_points: {{tip: {{on: slab, at: [0.3, 0.2, 0.1]}}, middle: {{on: slab, at: [0, 0, 0]}}}}
springs:
  hard: {{from: O, to: tip, rest_length: 1, force: {POWERS}}}
  soft: {{from: O, to: middle, force: {TABLE}}}
"""


#: A mass, and another one that a bar keeps from it.
MASSES = """\
points: {O: {fixed: [0, 0]}, A: {at: [0.9, 1.2], mass: 2}, B: {at: [0.9, 2.2], mass: 2}}
bars: {rod: {from: A, to: B, length: 1}}
"""
AT_REST = np.zeros(4)


def single(spring):
    """The mass on a spring."""
    return built(f"{MASSES}springs: {{s: {{from: O, to: A, {spring}}}}}\n")


def at(length):
    """Coordinates with the mass at a distance from the origin."""
    return np.array([0.6, 0.8, 0, 0]) * length + np.array([0, 0, 0.9, 2.2])


def by_table(length):
    """Between the values without overshoot, and straight on beyond them."""
    between = PchipInterpolator(LENGTHS, VALUES)
    inside = np.clip(length, LENGTHS[0], LENGTHS[-1])
    return between(inside) + between(inside, 1) * (length - inside)


def by_powers(length):
    return 2 + 100 * (length - 1) + 500 * (length - 1) ** 3


@pytest.mark.parametrize(
    ("spring", "expected"),
    [(f"force: {TABLE}", by_table), (f"rest_length: 1, force: {POWERS}", by_powers)],
)
def test_force_and_energy(spring, expected):
    """The force pulls along the spring, and the energy is its integral."""
    subject = single(spring)
    for length in (0.3, 0.5, 0.8, 1.0, 1.4, 2.0, 2.5, 3.1):
        found = subject.evaluate(0.0, at(length), AT_REST, np.zeros(1)).force
        pull = -expected(length) * np.array([0.6, 0.8, 0, 0])
        np.testing.assert_allclose(found, pull, rtol=1e-12, atol=1e-12)
        points = np.linspace(1.0, length, 20_001)
        work = np.trapezoid(expected(points), points)
        energy = [subject.energies(0.0, at(place), AT_REST)[1] for place in (length, 1.0)]
        assert energy[0] - energy[1] == pytest.approx(work, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("spring", "told"),
    [
        ("stiffness: 3", "rest_length: missing"),
        ("stiffness: 3, rest_length: 1, force: {powers: [0, 1]}", "stiffness: stands in the law"),
        (f"rest_length: 1, force: {TABLE}", "rest_length: stands in the law"),
        ("rest_length: 1, force: {}", "force: needs either powers or a table"),
        ("force: {table: {lengths: [1, 1], values: [0, 1]}}", "lengths: must increase: 1 follows"),
        ("force: {table: {lengths: [1, 2], values: [0]}}", "values: must be one for each of 2"),
        ("force: {table: {file: none.csv}}", "table.file: only in a mechanism file"),
    ],
)
def test_springs_that_are_none(spring, told):
    with pytest.raises(DocumentError, match=told):
        single(spring)
