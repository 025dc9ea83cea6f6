"""Parts of planar mechanisms: accelerations and reactions by hand, laws of time, turns."""

import math

import numpy as np
import pytest
from mechanisms import built

import newmark_cli as newmark
from newmark_cli.problems.index_1 import Index1
from newmark_cli.support.errors import ArgumentError

G = 9.81
#: A cart on a wheel, with an arm and a bead on it: all parts that `test_problems` lacks.
CART = """\
points:
  C: {at: [0, 0.2]}
  R: {at: [0, 0.4]}
  A: {at: [1, 0.2]}
  B: {at: [1, 0.7], mass: 0.1}
  P: {at: [1, 0.45], mass: 0.3}
  E: {at: [0.6, 0.2]}
  F: {at: [0.6, 0.3]}
  H: {at: [0, -0.2]}
  I: {at: [0.1, -0.2]}
bodies:
  wheel: {from: C, to: R, length: 0.2, mass: 2, inertia: 0.04}
  cart: {from: C, to: A, length: 1, mass: 3, centre: [0.5, 0], inertia: 0.3}
  arm: {from: A, to: B, length: 0.5, mass: 1, centre: [0.25, 0], inertia: 0.02}
  pinion: {from: E, to: F, length: 0.1, mass: 0.5, inertia: 0.001}
  moon: {from: H, to: I, length: 0.1, mass: 0.2, inertia: 0.003}
body_points:
  G: {on: cart, at: [0.6, 0]}
rolling:
  front: {wheel: wheel, radius: 0.2, line: {through: [0, 0], direction: [1, 0]}}
  rack: {wheel: pinion, radius: 0.1, line: {on: cart, through: [0, 0.1], direction: [1, 0]}}
  orbit: {wheel: moon, radius: 0.1, circle: {centre: C, radius: 0.3, body: wheel}}
angle_joints:
  level: {to: cart, angle: 0}
gears:
  mesh: {from: wheel, to: pinion, ratio: -2, on: cart}
motions:
  swing: {body: arm, relative_to: cart, angle: {sines: [{amplitude: 0.1, frequency: 3}]}}
  seat: {slider: guide, distance: {powers: [0.25, 0, 0.1], table: {times: [-1, 0, 1, 2],
         values: [0.1, 0, 0.1, 0]}}}
torsion_springs:
  coil: {from: cart, to: arm, stiffness: 3, rest_angle: 1}
torsion_dampers:
  oil: {from: cart, to: moon, damping: 0.2}
sliders:
  guide: {point: P, on: arm, through: [0, 0], direction: [2, 0]}
forces:
  push: {at: G, force: [{amplitude: 5, frequency: 3}, -2]}
torques:
  motor: {on: wheel, from: cart, torque: {powers: [0, 1]}}
gravity: [0, -9.81]
assemble: true
project_velocities: true
"""


def start_of(subject, t=0.0):
    """Accelerations by coordinate and multipliers by ``λ constraint``, at the start's state."""
    a, multipliers = Index1(subject).accelerations(t, subject.u0, subject.v0)
    forces = zip(subject.constraint_names, multipliers, strict=True)
    return dict(zip(subject.coordinate_names, a, strict=True)) | {
        f"λ {name}": value for name, value in forces
    }


def at(place, velocity=0j):
    """Where a point is, and how it moves, as a file says it."""
    (x, y), (a, b) = ((complex(z).real, complex(z).imag) for z in (place, velocity))
    return f"at: [{x!r}, {y!r}], velocity: [{a!r}, {b!r}]"


def towards(angle):
    return complex(math.cos(angle), math.sin(angle))


def xy(name, value):
    """Both coordinates of a point."""
    return {f"{name}.x": complex(value).real, f"{name}.y": complex(value).imag}


def cylinder_in_a_ring():
    """Rolling inside a fixed circle: 3/2 (R − r) ψ'' = −g cos ψ, normal and friction force."""
    away, r, mass, psi, rate = 0.75, 0.25, 2.0, -0.4, 1.7
    along, turn = towards(psi), -away / r * rate
    centre, moving, spoke = away * along, away * rate * 1j * along, r * towards(0.3)
    faster = -G * math.cos(psi) / (1.5 * away)
    text = f"""\
points: {{O: {{fixed: [0, 0]}}, C: {{{at(centre, moving)}}},
         K: {{{at(centre + spoke, moving + 1j * turn * spoke)}}}}}
bodies: {{W: {{from: C, to: K, length: 0.25, mass: 2, inertia: 0.0625}}}}
rolling: {{ring: {{wheel: W, radius: 0.25, circle: {{centre: O, radius: 1, inside: true}}}}}}
gravity: [0, -9.81]
"""
    return text, xy("C", away * (1j * faster - rate**2) * along) | {
        # Turns backwards, by the arcs that are as long.
        "W.angle": -away / r * faster,
        # The ring pushes inwards: λ (C − O) is its force.
        "λ rolling.ring.contact": -mass * (rate**2 - G * math.sin(psi) / away),
        # Friction turns the wheel: r μ = I θ''.
        "λ rolling.ring.rolling": mass * r**2 / 2 * -away / r * faster / r,
    }


def wheel_on_a_wheel():
    """A wheel rolls off another that turns freely: Lagrange's equations of two angles.

    T = ½ [large Θ'² + mass (R+r)² ψ'² + small θ'²],  r θ = (R+r) ψ − R Θ.
    """
    R, r, mass, large, small, psi = 0.5, 0.2, 1.5, 0.3, 0.04, 1.4
    theta_rate, psi_rate = 0.5, 0.7
    mixed = -small * R * (R + r) / r**2
    inertia = [
        [large + small * (R / r) ** 2, mixed],
        [mixed, mass * (R + r) ** 2 + small * ((R + r) / r) ** 2],
    ]
    sun, faster = np.linalg.solve(inertia, [0, -mass * G * (R + r) * math.cos(psi)])
    centre = (R + r) * towards(psi)
    moving, turn = 1j * psi_rate * centre, ((R + r) * psi_rate - R * theta_rate) / r
    text = f"""\
points: {{O: {{fixed: [0, 0]}}, K: {{{at(R, 1j * R * theta_rate)}}}, C: {{{at(centre, moving)}}},
         L: {{{at(centre + r, moving + 1j * r * turn)}}}}}
bodies:
  sun: {{from: O, to: K, length: 0.5, mass: 0, inertia: 0.3}}
  planet: {{from: C, to: L, length: 0.2, mass: 1.5, inertia: 0.04}}
rolling: {{r: {{wheel: planet, radius: 0.2, circle: {{centre: O, radius: 0.5, body: sun}}}}}}
gravity: [0, -9.81]
"""
    return text, xy("C", (1j * faster - psi_rate**2) * centre) | {
        "sun.angle": sun,
        "rolling.r.angle": faster,
        "planet.angle": ((R + r) * faster - R * sun) / r,
    }


def wheel_down_a_slope():
    """⅔ g sin α on a line; the line carries the wheel, friction is a third of its weight."""
    alpha, mass, r = 0.3, 3.0, 0.4
    down = towards(-alpha)
    way = G * math.sin(alpha) * 2 / 3
    text = f"""\
points: {{C: {{{at(r * 1j * down)}}}, K: {{{at(r * 1j * down + r)}}}}}
bodies: {{W: {{from: C, to: K, length: 0.4, mass: 3, inertia: 0.24}}}}
rolling:
  slope: {{wheel: W, radius: 0.4, line: {{through: [0, 0], direction: [{down.real}, {down.imag}]}}}}
gravity: [0, -9.81]
"""
    return text, xy("C", way * down) | {
        "W.angle": -way / r,
        "λ rolling.slope.contact": mass * G * math.cos(alpha),
        "λ rolling.slope.rolling": -mass * G * math.sin(alpha) / 3,
    }


def bead_in_a_moving_guide():
    """A sprung and damped bead on a free arm, and the guide's force 2 m s'θ' + m s θ''."""
    inertia, mass, k, c, rest = 0.3, 0.5, 40.0, 0.8, 0.3
    theta, s, turn, rate = 0.3, 0.4, 3.0, 0.5
    faster = -2 * mass * s * rate * turn / (inertia + mass * s**2)
    slide = s * turn**2 - (k * (s - rest) + c * rate) / mass
    along = towards(theta)
    text = f"""\
points: {{O: {{fixed: [0, 0]}}, A: {{{at(along, 1j * turn * along)}}},
         P: {{{at(s * along, (rate + 1j * s * turn) * along)}, mass: 0.5}}}}
bodies: {{arm: {{from: O, to: A, length: 1, mass: 0, inertia: 0.3}}}}
sliders: {{guide: {{point: P, on: arm, through: [0.1, 0], direction: [1, 0]}}}}
springs: {{s: {{from: O, to: P, stiffness: 40, rest_length: 0.3}}}}
dampers: {{d: {{from: O, to: P, damping: 0.8}}}}
"""
    across = 2 * rate * turn + s * faster
    return text, (
        xy("P", (slide - s * turn**2 + 1j * across) * along)
        | xy("A", (1j * faster - turn**2) * along)
        | {"λ sliders.guide": mass * across}
    )


def torsion_between_links():
    """Spring, damper and motor; the angle between the links is −5.7, or 0.583 a turn later."""
    first, second, rates = 2.8, -2.9, (-1.0, 2.0)
    torque = -2 * (second - first + 2 * math.pi - 1) - 0.1 * (rates[1] - rates[0]) + 0.7
    links = "".join(
        f"  {name}: {{{at(towards(angle), 1j * rate * towards(angle))}}}\n"
        for name, angle, rate in zip("AB", (first, second), rates, strict=True)
    )
    text = f"""\
points:
  O: {{fixed: [0, 0]}}
{links}bodies:
  one: {{from: O, to: A, length: 1, mass: 0, inertia: 0.5}}
  two: {{from: O, to: B, length: 1, mass: 0, inertia: 0.02}}
torsion_springs: {{s: {{from: one, to: two, stiffness: 2, rest_angle: 1}}}}
torsion_dampers: {{d: {{from: one, to: two, damping: 0.1}}}}
torques: {{motor: {{on: two, from: one, torque: 0.7}}}}
"""
    return text, {"one.angle": -torque / 0.5, "two.angle": torque / 0.02}


def level_platform():
    """A body that a crank carries keeps its angle: a pendulum, and the moment that holds it."""
    theta, rate, mass, offset = -0.5, 1.2, 2.0, 0.3
    along, faster = towards(theta), -G * math.cos(theta)
    moving = 1j * rate * along
    text = f"""\
points: {{O: {{fixed: [0, 0]}}, A: {{{at(along, moving)}}}, B: {{{at(along + 0.5, moving)}}}}}
bodies:
  crank: {{from: O, to: A, length: 1, mass: 0, inertia: 0}}
  tray: {{from: A, to: B, length: 0.5, mass: 2, centre: [0.3, 0], inertia: 0.1}}
angle_joints: {{level: {{to: tray, angle: 0}}}}
gravity: [0, -9.81]
"""
    lifted = (1j * faster - rate**2) * along
    # The moment about A of what accelerates the mass centre, over the distance of the points.
    moment = mass * offset * (lifted.imag + G) / 0.5
    return text, xy("A", lifted) | xy("B", lifted) | {"λ angle_joints.level": moment}


EPICYCLIC = """\
points:
  O: {fixed: [0, 0]}
  K: {at: [0.1, 0]}
  C: {at: [0.3, 0]}
  L: {at: [0.4, 0]}
bodies:
  sun: {from: O, to: K, length: 0.1, mass: 0, inertia: 0.02}
  arm: {from: O, to: C, length: 0.3, mass: 0, inertia: 0.05}
  planet: {from: C, to: L, length: 0.1, mass: 1, inertia: 0.01}
gears: {mesh: {from: sun, to: planet, ratio: -0.5, on: arm}}
torques: {motor: {on: sun, torque: 3}}
"""


def epicyclic_gear():
    """Willis: θ_p − ψ = i (θ_s − ψ); accelerations of three angles, and torque of the teeth."""
    i = -0.5
    matrix = [[0.02, 0, 0, i], [0, 0.05 + 0.09, 0, 1 - i], [0, 0, 0.01, -1], [-i, i - 1, 1, 0]]
    names = ("sun.angle", "arm.angle", "planet.angle", "λ gears.mesh")
    return EPICYCLIC, dict(zip(names, np.linalg.solve(matrix, [3, 0, 0, 0]), strict=True))


def driven_slider_and_relative_angle():
    """An arm turns relative to another that turns, and a bead is pushed along it."""
    text = """\
points:
  O: {fixed: [0, 0]}
  A: {at: [1, 0]}
  P: {at: [0.2, 0], mass: 0.5}
  Q: {at: [0, 1]}
bodies:
  base: {from: O, to: A, length: 1, mass: 0, inertia: 1}
  arm: {from: O, to: Q, length: 1, mass: 0, inertia: 0.3}
sliders: {guide: {point: P, on: base, through: [0.1, 0], direction: [1, 0]}}
motions:
  hold: {body: base, angle: {rate: 4}}
  turn: {body: arm, relative_to: base, angle: {rate: 1, acceleration: 3}}
  push: {slider: guide, distance: {rate: 0.5, acceleration: 2}}
project_velocities: true
"""
    along, across = 2 - 0.2 * 4**2, 2 * 0.5 * 4
    return text, xy("P", along + 1j * across) | {
        "arm.angle": 3.0,
        "λ motions.push.distance": 0.5 * along,
        "λ sliders.guide": 0.5 * across,
        "λ motions.turn.angle": 0.3 * 3,
    }


@pytest.mark.parametrize("mechanism", [
    cylinder_in_a_ring, wheel_on_a_wheel, wheel_down_a_slope, bead_in_a_moving_guide,
    torsion_between_links, level_platform, epicyclic_gear, driven_slider_and_relative_angle,
])  # fmt: skip
def test_accelerations_and_reactions_are_those_of_minimal_coordinates(mechanism):
    """Of a moving mechanism; that tangents and steps fit them is in `test_contract`."""
    text, expected = mechanism()
    subject = built(text)
    found = start_of(subject)
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_energy_of_a_torsion_spring():
    """½ k (φ − φ₀)², the angle counted in turns from where the file begins."""
    text, _ = torsion_between_links()
    subject = built(text[: text.index("torsion_dampers")])
    _, potential = subject.energies(0.0, subject.u0, subject.v0)
    assert potential == pytest.approx((-2.9 - 2.8 + 2 * math.pi - 1) ** 2, rel=1e-12)


def test_turns_are_counted():
    """By the coordinates of a gear that a constant torque drives."""
    subject, (_, faster) = built(EPICYCLIC), epicyclic_gear()
    done = newmark.march(
        subject, h=1e-3, t_end=0.5, every=0, integrator="generalized-alpha rho=0.9"
    )
    found = dict(zip(subject.coordinate_names, done.u[-1], strict=True))
    for name in ("sun.angle", "arm.angle", "planet.angle"):
        assert found[name] == pytest.approx(faster[name] / 8, rel=1e-3)
    assert found["sun.angle"] > 4 * np.pi
    with pytest.raises(ArgumentError, match="compensated needs constraints that are quadratic"):
        newmark.march(subject, h=1e-3, t_end=0.1, evaluation="compensated")
