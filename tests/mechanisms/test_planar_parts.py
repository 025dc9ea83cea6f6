"""Parts of planar mechanisms: tangents, motions in minimal coordinates, reactions by hand."""

import numpy as np
import pytest
from each import each
from mechanisms import built
from pages import blocks, pages
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import newmark_cli as newmark
from newmark_cli.support.documents import DocumentError
from newmark_cli.support.errors import ArgumentError

#: Undamped enough for reactions to converge: the trapezoidal rule lets them drift.
DISSIPATIVE = {"method": "generalized-alpha", "rho": 0.9}

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


@pytest.fixture(scope="module")
def cart():
    """A mechanism with every part that acts on angles, moving lines and laws of time."""
    return built(CART)


def test_starts_as_given(cart):
    """All constraints hold where the file puts the points, so that assembling moves nothing."""
    np.testing.assert_allclose(cart.constraint_values(0.0, cart.u0), 0, atol=1e-15)
    given = [0, 0.2, 0, 0.4, 1, 0.2, 1, 0.7, 1, 0.45, 0.6, 0.2, 0.6, 0.3, 0, -0.2, 0.1, -0.2]
    np.testing.assert_allclose(cart.u0[:18], given, atol=1e-15)
    plain = built(CART.replace("assemble: true", "assemble: false"))
    np.testing.assert_allclose(plain.u0[18:], cart.u0[18:], atol=1e-15)
    angles = dict(zip(cart.coordinate_names[18:], cart.u0[18:], strict=True))
    assert angles["arm.angle"] == angles["wheel.angle"] == pytest.approx(np.pi / 2)
    assert angles["rolling.orbit.angle"] == pytest.approx(-np.pi / 2)


def orders(text, exact, h=(4e-3, 2e-3), t_end=0.6, **options):
    """log₂ of the ratios of errors at two steps of what ``exact`` names, and the errors.

    Args:
        text: The mechanism.
        exact: Name of a coordinate, ``'name`` of its rate, or ``λ name`` → value at the end.
        h: Step sizes.
        t_end: End (s).
        options: Of the march.
    """
    problem = built(text)
    found = []
    for step in h:
        march = newmark.march(
            problem, h=step, t_end=t_end, every=0, integrator=DISSIPATIVE, **options
        )
        ends = dict(zip(problem.coordinate_names, march.u[-1], strict=True))
        ends |= {f"'{n}": x for n, x in zip(problem.coordinate_names, march.v[-1], strict=True)}
        multipliers = zip(problem.constraint_names, march.multipliers[-1], strict=True)
        ends |= {f"λ {name}": value for name, value in multipliers}
        found.append([abs(ends[name] - value) for name, value in exact.items()])
    found = np.array(found)
    return np.log2(np.maximum(found[0], 1e-300) / np.maximum(found[1], 1e-300)), found


def solved(function, start, t_end=0.6):
    """End of an initial value problem of minimal coordinates."""
    return solve_ivp(function, (0, t_end), start, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]


def order_2(found, coarse=1e-2):
    """Every error falls fourfold when the step is halved, and is small."""
    slopes, errors = found
    np.testing.assert_allclose(slopes, 2, atol=0.1)
    assert errors[0].max() < coarse


def test_cylinder_in_a_ring():
    """Rolling inside a fixed circle: 3/2 (R − r) ψ'' = −g cos ψ, normal and friction force."""
    R, r, mass, g = 1.0, 0.25, 2.0, 9.81
    inertia = mass * r**2 / 2

    def motion(t, y):
        return [y[1], -g * np.cos(y[0]) / (1.5 * (R - r))]

    psi, rate = solved(motion, [0.0, 0.0])
    faster = motion(0, [psi, rate])[1]
    text = """\
points: {O: {fixed: [0, 0]}, C: {at: [0.75, 0]}, K: {at: [1, 0]}}
bodies: {W: {from: C, to: K, length: 0.25, mass: 2, inertia: 0.0625}}
rolling: {ring: {wheel: W, radius: 0.25, circle: {centre: O, radius: 1, inside: true}}}
gravity: [0, -9.81]
"""
    order_2(
        orders(
            text,
            {
                "C.x": (R - r) * np.cos(psi),
                "C.y": (R - r) * np.sin(psi),
                # Turns backwards, by the arcs that are as long.
                "W.angle": -(R - r) / r * psi,
                "'W.angle": -(R - r) / r * rate,
                # The ring pushes inwards: λ (C − O) is its force.
                "λ rolling.ring.contact": -mass * ((R - r) * rate**2 - g * np.sin(psi)) / (R - r),
                # Friction turns the wheel: r μ = I θ''.
                "λ rolling.ring.rolling": inertia * -(R - r) / r * faster / r,
            },
        ),
        coarse=1e-1,
    )


def test_wheel_on_a_wheel():
    """A wheel rolls off another that turns freely; two angles, Lagrange's equations by hand."""
    R, r, mass, g = 0.5, 0.2, 1.5, 9.81
    large, small = 0.3, 0.04
    # T = ½ [large Θ'² + mass (R+r)² ψ'² + small θ'²], r θ = (R+r) ψ − R Θ.
    inertia = np.array([[large + small * (R / r) ** 2, -small * R * (R + r) / r**2],
                        [-small * R * (R + r) / r**2,
                         mass * (R + r) ** 2 + small * ((R + r) / r) ** 2]])  # fmt: skip

    def motion(t, y):
        force = [0, -mass * g * (R + r) * np.cos(y[1])]
        return [*y[2:], *np.linalg.solve(inertia, force)]

    theta, psi, turn, _rate = solved(motion, [0, 1.4, 0.5, 0])
    c, s = np.cos(1.4), np.sin(1.4)
    x, y = float((R + r) * c), float((R + r) * s)
    text = f"""\
points:
  O: {{fixed: [0, 0]}}
  K: {{at: [0.5, 0], velocity: [0, 0.25]}}
  C: {{at: [{x!r}, {y!r}]}}
  L: {{at: [{x + 0.2!r}, {y!r}], velocity: [0, {0.2 * (-R * 0.5 / r)!r}]}}
bodies:
  sun: {{from: O, to: K, length: 0.5, mass: 0, inertia: 0.3}}
  planet: {{from: C, to: L, length: 0.2, mass: 1.5, inertia: 0.04}}
rolling: {{r: {{wheel: planet, radius: 0.2, circle: {{centre: O, radius: 0.5, body: sun}}}}}}
gravity: [0, -9.81]
"""
    order_2(
        orders(
            text,
            {
                "C.x": (R + r) * np.cos(psi),
                "C.y": (R + r) * np.sin(psi),
                "sun.angle": theta,
                "'sun.angle": turn,
                "rolling.r.angle": psi,
                "planet.angle": ((R + r) * (psi - 1.4) - R * theta) / r,
            },
        )
    )


def test_wheel_rolls_down_a_slope():
    """x'' = ⅔ g sin α on a line; the line carries the wheel, friction is a third of its weight."""
    alpha, g, mass, r = 0.3, 9.81, 3.0, 0.4
    d, n = np.exp(-1j * alpha), 1j * np.exp(-1j * alpha)
    start, rim = complex(r * n), complex(r * n + r)
    text = f"""\
points: {{C: {{at: [{start.real}, {start.imag}]}}, K: {{at: [{rim.real}, {rim.imag}]}}}}
bodies: {{W: {{from: C, to: K, length: 0.4, mass: 3, inertia: 0.24}}}}
rolling:
  slope: {{wheel: W, radius: 0.4, line: {{through: [0, 0], direction: [{d.real}, {d.imag}]}}}}
gravity: [0, -9.81]
"""
    way = g * np.sin(alpha) * 2 / 3 * 3.0**2 / 2
    assert way / r > 6 * np.pi, "three turns"
    place = start + way * d
    slopes, errors = orders(
        text,
        {
            "W.angle": -way / r,
            "C.x": place.real,
            "C.y": place.imag,
            "λ rolling.slope.contact": mass * g * np.cos(alpha),
            "λ rolling.slope.rolling": -mass * g * np.sin(alpha) / 3,
        },
        h=(1e-2, 5e-3),
        t_end=3.0,
    )
    order_2((slopes[:3], errors[:, :3]), coarse=2e-2)
    np.testing.assert_allclose(errors[1, 3:], 0, atol=2e-2)


def test_bead_in_a_moving_guide():
    """Angle and place of a sprung bead on a free arm, and the guide's force 2 m s'θ' + m s θ''."""
    inertia, mass, k, rest = 0.3, 0.5, 40.0, 0.3

    def motion(t, y):
        _, s, turn, rate = y
        faster = -2 * mass * s * rate * turn / (inertia + mass * s**2)
        return [turn, rate, faster, s * turn**2 - k / mass * (s - rest)]

    theta, s, turn, rate = solved(motion, [0, 0.4, 3, 0])
    faster = motion(0, [theta, s, turn, rate])[2]
    text = """\
points:
  O: {fixed: [0, 0]}
  A: {at: [1, 0], velocity: [0, 3]}
  P: {at: [0.4, 0], velocity: [0, 1.2], mass: 0.5}
bodies: {arm: {from: O, to: A, length: 1, mass: 0, inertia: 0.3}}
sliders: {guide: {point: P, on: arm, through: [0.1, 0], direction: [1, 0]}}
springs: {s: {from: O, to: P, stiffness: 40, rest_length: 0.3}}
"""
    exact = {
        "P.x": s * np.cos(theta),
        "P.y": s * np.sin(theta),
        "A.x": np.cos(theta),
        "'P.x": rate * np.cos(theta) - s * turn * np.sin(theta),
        "λ sliders.guide": mass * (2 * rate * turn + s * faster),
    }
    order_2(orders(text, exact))
    # Quadratic in the points, so that increments carry it too.
    order_2(orders(text, exact, evaluation="compensated"))
    energy = newmark.march(built(text), h=1e-3, t_end=0.6).energy
    coarse = newmark.march(built(text), h=2e-3, t_end=0.6).energy
    drift = [abs(e - e[0]).max() for e in (coarse, energy)]
    assert np.log2(drift[0] / drift[1]) == pytest.approx(2, abs=0.1)


def test_double_pendulum_with_torsion():
    """Spring and damper between two links, which wind up by more than a turn."""
    k, c, inertia, rest = 2.0, 0.1, (0.5, 0.02), 1.0

    def motion(t, y):
        torque = -k * (y[1] - y[0] - rest) - c * (y[3] - y[2])
        return [*y[2:], -torque / inertia[0], torque / inertia[1]]

    first, second, _rate, other = solved(motion, [0, 2.0, 0, 100.0], 0.15)
    assert second - first > 2 * np.pi
    text = """\
points:
  O: {fixed: [0, 0]}
  A: {at: [1, 0]}
  B: {at: [-0.41614683654714241, 0.90929742682568171],
      velocity: [-90.929742682568171, -41.614683654714241]}
bodies:
  one: {from: O, to: A, length: 1, mass: 0, inertia: 0.5}
  two: {from: O, to: B, length: 1, mass: 0, inertia: 0.02}
torsion_springs: {s: {from: one, to: two, stiffness: 2, rest_angle: 1}}
torsion_dampers: {d: {from: one, to: two, damping: 0.1}}
"""
    exact = {"one.angle": first, "two.angle": second, "'two.angle": other, "B.x": np.cos(second)}
    order_2(orders(text, exact, t_end=0.15, h=(5e-4, 2.5e-4)))
    undamped = built(text.replace("damping: 0.1", "damping: 0"))
    drift = []
    for h in (1e-3, 5e-4):
        energy = newmark.march(undamped, h=h, t_end=0.15).energy
        drift.append(abs(energy - energy[0]).max())
    assert np.log2(drift[0] / drift[1]) == pytest.approx(2, abs=0.1)


def test_level_platform():
    """A body that a crank carries keeps its angle: a pendulum, and the moment that holds it."""
    length, mass, offset, g = 1.0, 2.0, 0.3, 9.81

    def motion(t, y):
        return [y[1], -g / length * np.cos(y[0])]

    theta, rate = solved(motion, [0.0, 0.0])
    faster = motion(0, [theta, rate])[1]
    down = length * (faster * np.cos(theta) - rate**2 * np.sin(theta)) + g
    text = """\
points:
  O: {fixed: [0, 0]}
  A: {at: [1, 0]}
  B: {at: [1.5, 0]}
bodies:
  crank: {from: O, to: A, length: 1, mass: 0, inertia: 0}
  tray: {from: A, to: B, length: 0.5, mass: 2, centre: [0.3, 0], inertia: 0.1}
angle_joints: {level: {to: tray, angle: 0}}
gravity: [0, -9.81]
"""
    # The moment about A of what accelerates the mass centre, over the distance of the points.
    exact = {
        "A.x": np.cos(theta),
        "B.y": np.sin(theta),
        "λ angle_joints.level": mass * offset * down / 0.5,
    }
    order_2(orders(text, exact))
    order_2(orders(text, exact, evaluation="compensated"))


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


def test_epicyclic_gear():
    """Willis: θ_p − ψ = i (θ_s − ψ); constant accelerations and torque of the teeth by hand."""
    # Unknowns: accelerations of sun, arm, and planet, torque of the teeth on the planet.
    i = -0.5
    matrix = np.array(
        [[0.02, 0, 0, i], [0, 0.05 + 0.09, 0, 1 - i], [0, 0, 0.01, -1], [-i, i - 1, 1, 0]]
    )
    sun, arm, planet, tooth = np.linalg.solve(matrix, [3, 0, 0, 0])
    order_2(
        orders(
            EPICYCLIC,
            {
                "sun.angle": sun / 8,
                "arm.angle": arm / 8,
                "planet.angle": planet / 8,
                "'planet.angle": planet / 2,
                "C.x": 0.3 * np.cos(arm / 8),
                "λ gears.mesh": tooth,
            },
            t_end=0.5,
        ),
        coarse=1,
    )
    assert sun / 8 > 4 * np.pi, "two turns"


LAWS = {
    "powers": ("{powers: [1, -2, 3]}", lambda t: 1 - 2 * t + 3 * t**2),
    "sines": (
        "{rate: 1, sines: [{amplitude: 2, frequency: 5}, {amplitude: 1, frequency: 9, phase: 1}]}",
        lambda t: t + 2 * np.sin(5 * t) + np.sin(9 * t + 1),
    ),
    "table": (
        "{table: {times: [-0.5, 0, 0.2, 0.5, 1], values: [0, 1, -1, 2, 0]}}",
        CubicSpline([-0.5, 0, 0.2, 0.5, 1], [0, 1, -1, 2, 0]),
    ),
    "natural": (
        "{value: 2, table: {times: [0, 0.3, 1], values: [0, 1, -1], ends: natural}}",
        lambda t: 2 + CubicSpline([0, 0.3, 1], [0, 1, -1], bc_type="natural")(t),
    ),
    "periodic": (
        "{table: {times: [0, 0.1, 0.2, 0.25], values: [0, 1, -1, 0], ends: periodic}}",
        CubicSpline([0, 0.1, 0.2, 0.25], [0, 1, -1, 0], bc_type="periodic"),
    ),
    "all": (
        "{value: 1, amplitude: 2, frequency: 3, phase: 1, powers: [0, 2], "
        "sines: [{amplitude: 1, frequency: 2}], table: {times: [0, 2], values: [1, 5]}}",
        lambda t: 2 + 2 * np.sin(3 * t + 1) + 4 * t + np.sin(2 * t),
    ),
}


@each("name", LAWS)
def test_force_with_a_law(name):
    """A mass on a rail, and a wheel, pushed by a law of time: ∫∫ of it; order 2."""
    law, function = LAWS[name]
    x, v = solved(lambda t, y: [y[1], function(t) / 2], [0, 0])
    text = f"""\
points: {{O: {{fixed: [0, 1]}}, P: {{at: [0, 0], mass: 2}}, A: {{at: [1, 1]}}}}
bodies: {{disc: {{from: O, to: A, length: 1, mass: 0, inertia: 2}}}}
sliders: {{rail: {{point: P, through: [0, 0], direction: [1, 0]}}}}
forces: {{push: {{at: P, force: [{law}, -3]}}}}
torques: {{motor: {{on: disc, torque: {law}}}}}
"""
    found = orders(
        text,
        {"P.x": x, "'P.x": v, "A.x": np.cos(x), "A.y": 1 + np.sin(x), "λ sliders.rail": 3.0},
        h=(2e-3, 1e-3),
    )
    order_2((found[0][:4], found[1][:, :4]))
    np.testing.assert_allclose(found[1][:, 4], 0, atol=1e-9)


@each("name", [name for name in LAWS if name != "natural"])
def test_motion_with_a_law(name):
    """Place, rate and force of a driven mass: the law, its two derivatives, and M times it."""
    law, function = LAWS[name]
    start = float(function(0))
    step = 1e-5
    speed = float(function(step) - function(-step)) / (2 * step)
    if name in ("table", "periodic"):
        speed = float(function(0, 1))
    text = f"""\
points: {{P: {{at: [{start!r}, 0], velocity: [{speed!r}, 0], mass: 2}}}}
motions: {{drive: {{point: P, x: {law}}}}}
project_velocities: true
"""
    problem, t = built(text), 0.37
    place = problem.constraint_values(t, np.zeros(2))
    rate, curvature = problem.constraint_derivatives(t, np.zeros(2), np.zeros(2))
    values = [float(function(t + k * 1e-3)) for k in (-2, -1, 0, 1, 2)]
    np.testing.assert_allclose(-place[0], values[2], atol=1e-13)
    np.testing.assert_allclose(-rate[0], np.array([1, -8, 0, 8, -1]) @ values / 12e-3, atol=1e-7)
    second = np.array([-1, 16, -30, 16, -1]) @ values / 12e-6
    np.testing.assert_allclose(-curvature[0], second, atol=2e-5)


def test_driven_slider_and_relative_angle():
    """An arm turns relative to another, a bead along it: forces and torques by hand."""
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
    march = newmark.march(built(text), h=1e-3, t_end=1.0, every=0, integrator=DISSIPATIVE)
    names = march.coordinate_names
    # Both go on for more than half a turn.
    assert march.u[-1][names.index("arm.angle")] == pytest.approx(np.pi / 2 + 4 + 1 + 1.5, rel=1e-6)
    place = 0.1 + 0.1 + 0.5 + 1
    np.testing.assert_allclose(complex(*march.u[-1][2:4]), place * np.exp(4j), rtol=1e-5)
    forces = dict(zip(march.constraint_names, march.multipliers[-1], strict=True))
    assert forces["motions.push.distance"] == pytest.approx(0.5 * (2 - place * 16), rel=1e-4)
    assert forces["sliders.guide"] == pytest.approx(0.5 * 2 * 2.5 * 4, rel=1e-4)
    assert forces["motions.turn.angle"] == pytest.approx(0.3 * 3, rel=1e-4)


#: What of `CART` is replaced, by what, the line and key of the mistake, and words of it.
MISTAKES = {
    "no such wheel": ("wheel: pinion", "wheel: onion", 21, "rolling.rack.wheel", "unknown body"),
    "off the line": (
        "radius: 0.2, line", "radius: 0.25, line", 20, "rolling.front",
        "wheel starts with its centre 0.2 m away, its radius asks for 0.25 m; correct",
    ),
    "off the circle": (
        "radius: 0.3, body", "radius: 0.35, body", 22, "rolling.orbit",
        "moon starts with its centre 0.4 m away, its radius asks for 0.45 m; correct",
    ),
    "nothing to roll on": (
        ", line: {on: cart, through: [0, 0.1], direction: [1, 0]}", "", 21, "rolling.rack",
        "needs either a line or a circle",
    ),
    "too large inside": (
        "radius: 0.3, body: wheel", "radius: 0.1, inside: true", 22, "rolling.orbit.radius",
        "must be less than that of the circle around it, 0.1, given 0.1",
    ),
    "another angle": (
        "angle: 0}", "angle: 0.5}", 24, "angle_joints.level",
        "cart starts at 0 rad to ground, given 0.5",
    ),
    "no ratio": ("ratio: -2", "ratio: 0", 26, "gears.mesh.ratio", "must not be 0"),
    "a gear with itself": (
        "to: pinion, ratio", "to: wheel, ratio", 26, "gears.mesh.to", "must be different bodies",
    ),
    "no such carrier": ("on: cart}\nmotions", "on: kart}\nmotions", 26, "gears.mesh.on", "'cart'"),
    "times that fall": (
        "times: [-1, 0, 1, 2]", "times: [-1, 0, 2, 1]", 29, "motions.seat.distance.table.times",
        "must increase: 1 follows 2",
    ),
    "times without values": (
        "values: [0.1, 0, 0.1, 0]", "values: [0.1, 0, 0.1]", 30,
        "motions.seat.distance.table.values", "must be one for each of 4 times, given 3",
    ),
    "begins late": (
        "times: [-1, 0, 1, 2]", "times: [0.5, 0.7, 1, 2]", 29,
        "motions.seat.distance.table.times", "must begin at 0 or before, given 0.5",
    ),
    "does not repeat": (
        "values: [0.1, 0, 0.1, 0]", "values: [0.1, 0, 0.1, 0], ends: periodic", 30,
        "motions.seat.distance.table.values", "must end as they begin to repeat: 0.1, 0",
    ),
    "spring with itself": (
        "coil: {from: cart, to: arm", "coil: {from: arm, to: arm", 32, "torsion_springs.coil.to",
        "joins arm with itself",
    ),
    "no such point": ("at: G, force", "at: Z, force", 38, "forces.push.at", "unknown point 'Z'"),
    "no number": ("-2]}\ntorques", "two]}\ntorques", 38, "forces.push.force[2]", "'two'"),
    "a torque from itself": (
        "on: wheel, from: cart", "on: wheel, from: wheel", 40, "torques.motor.from",
        "must be another body than wheel",
    ),
}  # fmt: skip


@each("name", MISTAKES)
def test_mistakes_are_located(name):
    old, new, line, key, words = MISTAKES[name]
    text = CART.replace("assemble: true", "assemble: false")
    assert text.count(old) == 1, f"{old!r} stands in the file once"
    with pytest.raises(DocumentError) as caught:
        built(text.replace(old, new), "bad")
    told = [mistake.text for mistake in caught.value.mistakes]
    wanted = [text for text in told if text.startswith(f"bad.yaml, line {line}: {key}: ")]
    assert wanted, told
    assert any(words in text for text in wanted), told


TABLE = """\
points: {P: {at: [0, 0], mass: 1}}
motions: {drive: {point: P, x: {table: {times: [0, 0.5, 1], values: [0, 1, 0]}}}}
project_velocities: true
"""


def test_nothing_beyond_a_table(cli):
    """A march must end with the table; `validate` and the library say so, and it may repeat."""
    cli.write("cam.yaml", TABLE)
    cli.write(
        "study.yaml",
        "study: s\nproblem: cam.yaml\nform: u-lambda\npreconditioning: optimal\nh: [1e-2]\n"
        "t_end: 1.5\n",
    )
    done = cli("validate", "study.yaml", code=2)
    assert "line 6: t_end: must be at most 1 s, where a table of cam.yaml ends, given 1.5 s" in (
        done.stderr
    )
    assert "--at: must be at most 1 s, where a table of cam.yaml ends, given 2 s" in cli.refused(
        "draw", "cam.yaml", "--at", "2"
    )
    with pytest.raises(ArgumentError, match="t_end: must be at most 1 s, where a table of"):
        newmark.march(built(TABLE), h=1e-2, t_end=1.5)
    assert newmark.march(built(TABLE), h=1e-2, t_end=1.0, every=0).u[-1][0] == pytest.approx(0)
    repeated = built(TABLE.replace("0]}", "0], ends: periodic}"))
    ends = newmark.march(repeated, h=1e-2, t_end=1.5, every=0).u[-1]
    assert ends[0] == pytest.approx(1, abs=1e-9)


def test_compensated_is_refused_with_angles():
    with pytest.raises(ArgumentError, match="compensated needs constraints that are quadratic"):
        newmark.march(built(EPICYCLIC), h=1e-3, t_end=0.1, evaluation="compensated")


def test_what_alternates_spins_a_part_of_little_inertia(tmp_path):
    """The rod of the docs on a driven arm, beside the equation of its angle.

    The trapezoidal rule has its motion wrong at every h; all that the page names as ways out have
    it right.
    """
    (page,) = (b.text for b in blocks(pages()["what-scaling-cures.md"]) if b.title == "rod.yaml")
    (tmp_path / "rod.yaml").write_text(page)
    radius, rate, mass, centre, inertia = 0.2, 5.0, 0.1, 1e-4, 1e-9

    def falling(t, state):
        angle, speed = state
        x, y = (-radius * rate**2 * f(rate * t) for f in (np.cos, np.sin))
        moment = -mass * centre * ((y + 9.81) * np.cos(angle) - x * np.sin(angle))
        return speed, moment / (inertia + mass * centre**2)

    right = solve_ivp(falling, (0, 1), (0, 10), method="DOP853", rtol=1e-11, atol=1e-9).y[1, -1]
    assert right == pytest.approx(256.673, abs=1e-3)

    def turning(h, **options):
        end = newmark.march(str(tmp_path / "rod.yaml"), h=h, t_end=1.0, every=0, **options)
        assert end.status == "ok"
        (x, y), (dx, dy) = (end.point("B", f)[-1] - end.point("A", f)[-1] for f in "uv")
        return (x * dy - y * dx) / 0.1**2

    for start in ("consistent", "corrected"):
        for h in (1e-4, 4e-5):
            assert abs(turning(h, start=start) - right) > 100, (start, h)
    for way_out in (
        {"formulation": "index-2"}, {"formulation": "ggl"}, {"projection": "velocity"},
        {"integrator": "generalized-alpha rho=0.9"}, {"integrator": "generalized-alpha rho=0.5"},
        {"integrator": "hht alpha=0.1"}, {"integrator": "bdf2"},
    ):  # fmt: skip
        coarse, fine = (abs(turning(h, **way_out) - right) for h in (8e-5, 4e-5))
        assert fine < 4e-3 * right, way_out
        assert 3 < coarse / fine < 5, way_out
