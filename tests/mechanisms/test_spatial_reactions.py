"""Reactions of every joint by Newton and Euler, drives, torsion, starts, and planar motions."""

import numpy as np
import pytest
import spatial
import yaml
from each import each
from mechanisms import built
from spatial import bennett, outputs

import newmark_cli as newmark
from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.problems.index_1 import Index1

DAMPED = "generalized-alpha rho=0.9"
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


def hung(kind, turned):
    """A body that moves on one joint of the ground, which it goes to or from."""
    text = BODY.replace("KIND", kind)
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


@each("turned", [False, True])
@each("kind", [kind for kind in JOINTS if kind != "rigid"])
def test_reactions_obey_newton_and_euler(kind, turned):
    """Force and moment of a joint are what its body's motion and weight ask for.

    And they do nothing along what the joint leaves free.
    """
    subject = hung(kind, turned)
    a, multipliers = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    found = outputs(subject, 0.0, subject.u0, subject.v0, multipliers)
    (u,), (w,) = (x.reshape(-1, 4, 3) for x in (subject.u0, a))
    frame = u[1:].T
    omega = spatial.spin(subject.u0, subject.v0)[0]
    faster = spatial.spin(subject.u0, a)[0]  # d × d' has no rate of its own
    centre, inertia = np.array([0.1, -0.2, 0.3]), frame @ INERTIA @ frame.T
    place, acceleration = u[0] + frame @ centre, w[0] + w[1:].T @ centre
    force = 3 * (acceleration - GRAVITY)
    about = subject.outputs.joints["J"].sides[1].place(subject.u0.reshape(-1, 4, 3))
    moment = inertia @ faster + np.cross(omega, inertia @ omega) + np.cross(place - about, force)
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


WHEEL = """\
dimensions: 3
bodies:
  wheel: {position: [0, 0, 0], mass: 2, inertia: [1, 1, 0.5], angular_velocity: [0, 0, RATE]}
joints:
  A: {type: revolute, from: ground, to: wheel, at: [0, 0, 0], axis: [0, 0, 1]}
"""


def test_torsion_pendulum():
    """φ = φ₀ (1 − cos ωt), ω² = k/J, to order 2; its energy is conserved to order 2."""
    text = WHEEL.replace("RATE", "0") + "torsion_springs: {k: {on: A, stiffness: 8, rest_angle: 1}}"
    errors, energies = [], []
    for h in (2e-2, 1e-2):
        done = newmark.march(built(text), h=h, t_end=1.0, integrator=DAMPED)
        exact = 1 - np.cos(4 * done.t)
        errors.append(np.abs(done.output("A.angle") - exact).max())
        energies.append(np.abs(done.energy - done.energy[0]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert np.log2(energies[0] / energies[1]) == pytest.approx(2, abs=0.3)
    assert errors[1] < 1e-3


def test_torsion_damper_and_torque_of_a_joint():
    """J φ'' = τ − c φ': the rate goes to τ/c exponentially, over many turns."""
    text = WHEEL.replace("RATE", "3") + (
        "torsion_dampers: {c: {on: A, damping: 0.5}}\ntorques: {t: {on: A, torque: 10}}\n"
    )
    errors = []
    for h in (2e-3, 1e-3):
        done = newmark.march(built(text), h=h, t_end=2.0, every=0, integrator=DAMPED)
        exact = 20 + (3 - 20) * np.exp(-2.0)
        errors.append(abs(done.output("wheel.omega.z")[-1] - exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert errors[1] < 1e-3


def test_driven_joint():
    """The multiplier of a driven angle is the torque J θ'', and the angle follows its law."""
    text = WHEEL.replace("RATE", "3") + (
        "motions: {m: {joint: A, angle: {rate: 3, acceleration: 4, amplitude: 0.5, frequency: 2}}}"
        "\nproject_velocities: true\n"
    )
    subject = built(text)
    assert not subject.quadratic
    t, errors = 1.3, []
    law = 3 * t + 2 * t**2 + 0.5 * np.sin(2 * t)  # more than a turn
    for h in (2e-3, 1e-3):
        done = newmark.march(subject, h=h, steps=round(t / h), every=0, integrator=DAMPED)
        assert np.exp(1j * done.output("A.angle")[-1]) == pytest.approx(np.exp(1j * law), abs=1e-12)
        torque = done.constraint("motions.m.angle")[-1]
        errors.append(abs(torque - 0.5 * (4 - 2 * np.sin(2 * t))))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def test_driven_distance():
    """A prismatic joint that is driven: the multiplier is the force along its axis."""
    subject = built("""\
dimensions: 3
bodies:
  cart: {position: [1, 0, 0], mass: 2, inertia: [1, 1, 1]}
joints:
  S: {type: prismatic, from: ground, to: cart, at: [0, 0, 0], axis: [0.6, 0, 0.8]}
motions:
  m: {joint: S, distance: {acceleration: 3}}
gravity: [0, 0, -10]
""")
    _, multipliers = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    assert multipliers[-1] == pytest.approx(2 * (3 + 8))
    done = newmark.march(subject, h=1e-2, t_end=1.0, every=0)
    assert done.output("S.distance")[-1] == pytest.approx(1.5, abs=1e-12)


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


def test_projection_is_least_in_the_norm_of_the_masses():
    """Crank speeds that do not fit are corrected by the least change in kinetic energy's norm."""
    text = RSSR.replace("rates: {A: 2}", "project_velocities: true").replace(
        "position: [0.1, 0, 0], mass", "position: [0.1, 0, 0], angular_velocity: [1, 2, 3], mass"
    )
    subject = built(text)
    given = np.zeros((3, 4, 3))
    given[0, 1:] = np.cross([1, 2, 3], subject.u0.reshape(-1, 4, 3)[0, 1:])
    gradient = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(subject.m)).G
    change = subject.M @ (subject.v0 - given.ravel())
    # M δ lies in the range of G: it vanishes on all that may move.
    _, _, rest = np.linalg.svd(gradient.T)
    assert np.abs(rest[subject.m :] @ change).max() < 1e-12


def test_rows_that_are_dropped_do_not_matter():
    """Bricard's motion, and the force on the ground, whichever row is released; by itself P5.q."""
    text = (newmark.problem("bricard").sources["bricard.yaml"]).decode()
    by_rule = built(text.replace("{P5: [q]}", "drop"))
    assert by_rule.released == ("P5.q",)
    assert by_rule.outputs.shared == {f"P{k}" for k in range(6)}
    states = []
    for rows in ("{P5: [q]}", "{P1: [y]}"):
        subject = built(text.replace("{P5: [q]}", rows))
        done = newmark.march(subject, h=5e-3, t_end=0.5, every=0, integrator=DAMPED)
        found = outputs(subject, 0.5, done.u[-1], done.v[-1], done.multipliers[-1])
        states.append((done.u[-1], found["P0.force"] + found["P5.force"], found["P0.force"]))
    (one, ground, alone), (other, same, differs) = states
    np.testing.assert_allclose(one, other, atol=1e-11)
    np.testing.assert_allclose(ground, same, atol=1e-7)
    assert np.abs(alone - differs).max() > 0.1  # not unique


def rod(start, end, mass):
    """A uniform rod between two places of the plane, as a body in space."""
    (x, y), (a, b) = start, end
    length = np.hypot(a - x, b - y)
    j = mass * length**2 / 12
    return (
        f"{{position: [{x}, {y}, 0], axes: {{x: [{a - x}, {b - y}, 0], y: [{y - b}, {a - x}, 0]}}, "
        f"mass: {mass}, centre: [{length / 2}, 0, 0], inertia: [{j}, {j}, {j}]}}"
    )


def in_plane(rods, fixed, moving):
    """The same rods as a planar mechanism."""
    places = fixed | moving

    def body(start, end, mass):
        length = float(np.hypot(*np.subtract(places[end], places[start])))
        about = {"centre": [length / 2, 0], "inertia": mass * length**2 / 12}
        return {"from": start, "to": end, "length": length, "mass": mass} | about

    return {
        "points": {name: {"fixed": at} for name, at in fixed.items()}
        | {name: {"at": at} for name, at in moving.items()},
        "bodies": {name: body(*of) for name, of in rods.items()},
        "gravity": [0, -9.81],
    }


PLACES = {"A": (0.0, 0.0), "B": (0.2, 0.5), "C": (1.1, 0.9), "D": (1.0, 0.0)}


@each("closed", [False, True])
def test_planar_mechanisms_in_space(closed):
    """A double pendulum, and a four-bar with three redundant rows, move as in the plane."""
    rods = {"one": ("A", "B", 1.0), "two": ("B", "C", 2.0)}
    joints = ["A", "B"]
    if closed:
        rods["three"] = ("D", "C", 1.5)
        joints += ["C", "D"]
    ends = {"A": ("ground", "one"), "B": ("one", "two"), "C": ("two", "three"),
            "D": ("ground", "three")}  # fmt: skip
    text = "dimensions: 3\nbodies:\n" + "".join(
        f"  {name}: {rod(PLACES[start], PLACES[end], mass)}\n"
        for name, (start, end, mass) in rods.items()
    )
    text += "joints:\n" + "".join(
        f"  {name}: {{type: revolute, from: {ends[name][0]}, to: {ends[name][1]}, "
        f"at: [{PLACES[name][0]}, {PLACES[name][1]}, 0], axis: [0, 0, 1]}}\n"
        for name in joints
    )
    subject = built(text + "gravity: [0, -9.81, 0]\nredundant: drop\n")
    assert subject.released == (("D.z", "D.p", "D.q") if closed else ())
    fixed = {name: PLACES[name] for name in ("AD" if closed else "A")}
    flat = newmark.problem(in_plane(rods, fixed, {name: PLACES[name] for name in "BC"}))
    how = {"h": 2e-3, "t_end": 0.5, "every": 0, "integrator": DAMPED}
    there, here = newmark.march(subject, **how), newmark.march(flat, **how)
    for field in ("u", "v"):
        bodies = getattr(there, field)[-1].reshape(-1, 4, 3)
        length = np.hypot(0.9, 0.4)
        found = [bodies[1, 0], bodies[1, 0] + length * bodies[1, 1]]
        expected = getattr(here, field)[-1].reshape(-1, 2)
        np.testing.assert_allclose(np.array(found)[:, :2], expected, atol=1e-9)
        np.testing.assert_allclose(np.array(found)[:, 2], 0, atol=1e-12)


def test_names():
    """Coordinates, multipliers and outputs are named after bodies and joints."""
    subject = newmark.problem("heavy-top")
    assert subject.coordinate_names[:4] == (
        "top.origin.x", "top.origin.y", "top.origin.z", "top.d1.x",
    )  # fmt: skip
    assert subject.constraint_names == (
        "top.d1·d1", "top.d2·d2", "top.d3·d3", "top.d1·d2", "top.d1·d3", "top.d2·d3",
        "O.x", "O.y", "O.z",
    )  # fmt: skip
    assert subject.outputs.names == (
        "top.omega.x", "top.omega.y", "top.omega.z", "O.force.x", "O.force.y", "O.force.z",
    )  # fmt: skip
    for name in ("bricard", "governor", "spatial-slider-crank"):
        names = newmark.problem(name).outputs.names
        assert len(set(names)) == len(names)


def test_trajectories_have_outputs(cli):
    """`output` is kept by name; what a study writes is what the library returns."""
    cli.write(
        "top.yaml",
        "study: top\nproblem: heavy-top\nform: u-lambda\npreconditioning: optimal\nh: 1e-4\n"
        "steps: 20\nmeasure: trajectory\ntrajectory: {every: 10, keep: [output]}\n",
    )
    cli("run", "top.yaml")
    frame = newmark.trajectories(cli.folder / "results", "top")
    columns = [name for name in frame.columns if "[" in name]
    assert columns[:4] == [
        "output[top.omega.x]", "output[top.omega.y]", "output[top.omega.z]", "output[O.force.x]",
    ]  # fmt: skip
    done = newmark.march("heavy-top", h=1e-4, steps=20, every=10)
    np.testing.assert_array_equal(frame[columns[1]], done.output("top.omega.y"))
    np.testing.assert_allclose(done.point("top.d2")[0], [0, 1, 0], atol=1e-15)


def test_torsion_spring_that_is_wound_too_far():
    """Past half a turn the angle would jump: the march ends instead of going wrong."""
    text = WHEEL.replace("RATE", "9") + "torsion_springs: {k: {on: A, stiffness: 0.1}}\n"
    done = newmark.march(built(text), h=1e-3, t_end=1.0, integrator=DAMPED)
    assert done.status in ("diverged", "singular")
    assert done.output("A.angle").max() == pytest.approx(np.pi - 0.05, abs=0.01)
    gentle = newmark.march(built(text.replace("0, 9]", "0, 1]")), h=1e-3, t_end=9.0, every=0)
    assert gentle.status == "ok"


def test_released_row_that_is_needed_later(cli):
    """A cell of which a released row opens ends and says why; one that drops others does not."""
    for name, released in (("mine", {"J4": ["x", "y", "z"]}), ("other", "drop")):
        cli.write(f"{name}.yaml", yaml.safe_dump(bennett(released)))
    cli.write(
        "study.yaml",
        "study: mine\nproblem: [mine.yaml, other.yaml]\nform: u-lambda\nformulation: index-2\n"
        "preconditioning: optimal\nintegrator: {method: generalized-alpha, rho: 0.9}\nh: 5e-3\n"
        "t_end: 2\n",
    )
    done = cli("run", "study.yaml", code=1)
    assert done.stdout.startswith("mine: 1 redundant, 1 ok -> ")
    assert "released rows (J4.x, J4.y, J4.z) are needed at t = 1.8" in done.stderr


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
    done = newmark.march(subject, h=1e-2, t_end=1.0, every=0, integrator=DAMPED)
    assert done.output("C.distance")[-1] == pytest.approx(-0.5, abs=1e-10)
    assert np.exp(1j * done.output("C.angle")[-1]) == pytest.approx(np.exp(3j), abs=1e-3)
