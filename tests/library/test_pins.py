"""Forces of pins in the test set: each body obeys Newton and Euler, each pin Newton's third law.

Bodies are taken as rigid ones with a centre and an angle, from the numbers of the mechanism
files; the package gives the accelerations of points, and nothing else.
"""

import csv
from functools import cache

import numpy as np
import pytest

from newmark_cli.library import testset
from newmark_cli.mechanisms import registry
from newmark_cli.problems.index_1 import Index1
from newmark_cli.support import documents

MEMBERS = [
    name for name in registry.TESTSET if (registry.TESTSET_FOLDER / f"{name}-pins.csv").exists()
]
#: Torque of the blow on the six-bar (N m) at the times of its rows, all of which are knots.
BLOW = {0.05: 0.0, 0.12: -5.0, 0.2: 0.0, 0.3: 0.0}


def turned(vector):
    return np.array([-vector[1], vector[0]])


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


class At:
    """A member at one row: motion of its points and bodies, λ, and the forces of its pins."""

    def __init__(self, name, row, pins):
        self.data = documents.read(registry.file(name)).data
        self.gravity, self.t = np.array(self.data.get("gravity", [0, 0])), float(row["t"])
        subject = registry.problem(name)
        u, v = (
            np.array([float(row[f"{part}[{one}]"]) for one in subject.coordinate_names])
            for part in "uv"
        )
        a, _ = Index1(subject).accelerations(self.t, u, v)
        moving = dict(zip(subject.coordinate_names, np.array([u, v, a]).T, strict=True))
        self.points = {
            point: np.array([moving[f"{point}.x"], moving[f"{point}.y"]]).T
            if f"{point}.x" in moving
            else np.array([given["fixed"], [0, 0], [0, 0]])
            for point, given in self.data["points"].items()
        }
        self.multiplier = {
            key[7:-1]: float(value) for key, value in row.items() if key.startswith("lambda[")
        }
        self.bodies = {body: self._of_body(given) for body, given in self.data["bodies"].items()}
        self.pins = {
            tuple(key[6:-3].split("@")): np.array([float(pins[key]), float(pins[key[:-2] + "y]"])])
            for key in pins
            if key.endswith(".x]")
        }

    def _of_body(self, given):
        """Position, turn, its rate and acceleration."""
        start, end = self.points[given["from"]], self.points[given["to"]]
        along, speed, acceleration = end - start
        size = along @ along
        omega = cross(along, speed) / size
        return {
            "along": along / np.sqrt(size), "omega": omega,
            "alpha": cross(along, acceleration) / size, "start": start,
        }  # fmt: skip

    def place(self, body, at):
        """Position, velocity and acceleration of a point of a body."""
        is_at = self.bodies[body]
        arm = at[0] * is_at["along"] + at[1] * turned(is_at["along"])
        omega, (x, v, a) = is_at["omega"], is_at["start"]
        return (
            x + arm, v + omega * turned(arm),
            a + is_at["alpha"] * turned(arm) - omega**2 * arm,
        )  # fmt: skip

    def turn(self, first, second):
        """Angle (rad) from one body to another."""
        a, b = (self.bodies[one]["along"] for one in (first, second))
        return np.arctan2(cross(a, b), a @ b)


def loads(name, at):
    """What acts on bodies besides pins: (body, place, force) of each, (body, torque) of others."""
    if name == "segment-beam":
        moments = [4 * at.turn(f"s{k}", f"s{k + 1}") for k in range(1, 8)]
        return [], [(f"s{k + 1}", m) for k, m in enumerate(moments)] + [
            (f"s{k + 2}", -m) for k, m in enumerate(moments)
        ]
    if name == "knee-table":
        drive, hip = at.multiplier["motions.knee.angle"], -2 * at.bodies["thigh"]["omega"]
        return [], [("shank", drive), ("thigh", -drive), ("thigh", hip)]
    if name == "sundials-slider-crank":
        (c1, v1, _), (c2, v2, _) = at.place("crank", [0.25, 0]), at.place("rod", [0.5, 0])
        length = np.linalg.norm(c2 - c1)
        unit = (c2 - c1) / length
        pull = (length - 1 + (v2 - v1) @ unit) * unit
        push = at.place("rod", [-1, 0])[0]
        return [("crank", c1, pull), ("rod", c2, -pull), ("rod", push, np.array([1, 0]))], []
    if name == "stephenson-sixbar":
        on_coupler = [("coupler", at.points["E"][0], -at.pins["arm", "E"])]
        return on_coupler, [("crank", 0.2), ("output", BLOW[at.t])]
    if name == "disc-in-bowl":
        # Its force acts at the contact; the table has it at the centre.
        outwards = at.points["C"][0] / np.linalg.norm(at.points["C"][0])
        return [], [("disc", cross(0.25 * outwards, at.pins["disc", "C"]))]
    return [], []


@cache
def rows(name):
    with (registry.TESTSET_FOLDER / f"{name}-pins.csv").open(encoding="utf-8") as file:
        pins = {float(row["t"]): row for row in csv.DictReader(file)}
    states = {float(row["t"]): row for row in testset.references(name)}
    return [At(name, states[t], pins[t]) for t in pins]


@pytest.mark.parametrize("name", MEMBERS)
def test_bodies_obey_newton_and_euler(name):
    """m (a − g) is the sum of forces, I α that of moments about the centre."""
    for at in rows(name):
        forces, torques = loads(name, at)
        largest = max(np.abs(force).max() for force in at.pins.values())
        for body, given in at.data["bodies"].items():
            centre, _, acceleration = at.place(body, given["centre"])
            acting = [
                (at.points[point][0], force)
                for (one, point), force in at.pins.items()
                if one == body
            ] + [(place, force) for one, place, force in forces if one == body]
            missing = sum(force for _, force in acting) - given["mass"] * (
                acceleration - at.gravity
            )
            assert np.abs(missing).max() <= 1e-10 * largest
            moment = sum(cross(place - centre, force) for place, force in acting)
            moment += sum(torque for one, torque in torques if one == body)
            missing = moment - given["inertia"] * at.bodies[body]["alpha"]
            assert abs(missing) <= 1e-10 * largest * given["length"]


@pytest.mark.parametrize("name", MEMBERS)
def test_pins_are_in_balance(name):
    """Forces on the bodies of a pin that moves are opposite, but for what else acts on it."""
    others = {
        "stephenson-sixbar": {"E"}, "disc-in-bowl": {"C"}, "sundials-slider-crank": {"B"},
    }.get(name, set())  # fmt: skip
    for at in rows(name):
        largest = max(np.abs(force).max() for force in at.pins.values())
        for point, given in at.data["points"].items():
            if "fixed" in given or point in others:
                continue
            total = sum(force for (_, one), force in at.pins.items() if one == point)
            assert np.abs(total).max() <= 1e-12 * largest


def test_forces_of_pins_are_those_of_the_multipliers():
    """The rail pushes B across; the bowl pushes the disc along the centres, by −λ times them."""
    for at in rows("sundials-slider-crank"):
        rail = [0, at.multiplier["sliders.rail"]]
        np.testing.assert_allclose(at.pins["rod", "B"], rail, rtol=0, atol=1e-12)
    for at in rows("disc-in-bowl"):
        inwards = -at.points["C"][0] / 0.75
        normal = -at.multiplier["rolling.bowl.contact"] * 0.75
        assert normal > 0
        assert at.pins["disc", "C"] @ inwards == pytest.approx(normal, rel=1e-12)
