"""Motions and reactions of spatial mechanisms against what knows no directors."""

from functools import cache

import numpy as np
import pytest
import spatial_references as references
from each import each
from mechanisms import built
from spatial import outputs

import newmark_cli as newmark
from newmark_cli.problems.index_1 import Index1

DAMPED = "generalized-alpha rho=0.9"


def marched(subject, h, t, **options):
    """State at a time: u as bodies' origins and directors, v likewise, outputs by name."""
    done = newmark.march(subject, h=h, t_end=t, every=0, integrator=DAMPED, **options)
    assert done.status == "ok"
    u, v, multipliers = done.u[-1], done.v[-1], done.multipliers[-1]
    return u.reshape(-1, 4, 3), v.reshape(-1, 4, 3), outputs(subject, t, u, v, multipliers)


def at_rest(subject):
    """Outputs at the start, λ from the index-1 system."""
    _, multipliers = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    return outputs(subject, 0.0, subject.u0, subject.v0, multipliers)


def orders(errors):
    """Observed order of each error between two steps, one half of the other."""
    coarse, fine = (np.array(part) for part in errors)
    return np.log2(coarse / fine)


def away(found, expected):
    """Largest error over largest component."""
    return np.abs(found - expected).max() / np.abs(expected).max()


FREE = """\
dimensions: 3
bodies:
  body: {position: [1, 2, 3], mass: 2, inertia: [1, 2, 2.5], velocity: [0.3, 0, -1],
         angular_velocity: [0.4, 3, 0.2]}
"""


@each("torque", [(0, 0, 0), (0.3, -0.2, 0.5)])
def test_free_body_obeys_eulers_equations(torque):
    """An asymmetric body about its middle axis, with a global torque too: order 2."""
    text = FREE + f"torques: {{t: {{on: body, torque: {list(torque)}}}}}\n"
    turned, rates, _ = references.euler(
        np.diag([1, 2, 2.5]), lambda frame: frame.T @ np.array(torque), [0.4, 3, 0.2], 2.0
    )
    errors = []
    for h in (4e-3, 2e-3):
        u, _, found = marched(built(text), h, 2.0)
        errors.append([away(u[0, 1:].T, turned), away(found["body.omega"], turned @ rates)])
        np.testing.assert_allclose(u[0, 0], [1.6, 2, 1], rtol=1e-10)
    np.testing.assert_allclose(orders(errors), 2, atol=0.1)
    assert np.max(errors[1]) < 3e-5


def test_torque_that_follows_the_body():
    """A torque in the body's axes: Euler's equations with a constant right-hand side."""
    text = FREE + "torques: {t: {on: body, torque: [0.3, -0.2, 0.5], frame: body}}\n"
    turned, rates, _ = references.euler(
        np.diag([1, 2, 2.5]), lambda frame: np.array([0.3, -0.2, 0.5]), [0.4, 3, 0.2], 1.0
    )
    errors = []
    for h in (4e-3, 2e-3):
        u, _, found = marched(built(text), h, 1.0)
        errors.append([away(u[0, 1:].T, turned), away(found["body.omega"], turned @ rates)])
    np.testing.assert_allclose(orders(errors), 2, atol=0.1)


def test_heavy_top():
    """Order 2 of place, velocity, angular velocity and reaction, though M is singular."""
    subject = newmark.problem("heavy-top")
    about = np.diag([15.234375, 0.46875, 15.234375])
    weight, centre, t = 15 * references.G, np.array([0, 1, 0]), 0.1

    def pull(frame):
        return np.cross(centre, frame.T @ np.array([0, 0, -weight]))

    turned, w, faster = references.euler(about, pull, [0, 150, -4.61538], t)
    place, speed = turned @ centre, turned @ np.cross(w, centre)
    acceleration = turned @ (np.cross(faster, centre) + np.cross(w, np.cross(w, centre)))
    force = 15 * (acceleration + np.array([0, 0, references.G]))
    errors = []
    for h in (2e-4, 1e-4):
        u, v, found = marched(subject, h, t)
        errors.append(
            [
                away(u[0, 2], place), away(v[0, 2], speed), away(found["top.omega"], turned @ w),
                away(found["O.force"], force),
            ]
        )  # fmt: skip
    np.testing.assert_allclose(orders(errors), 2, atol=0.1)
    # As measured independently: 5.5e-6 in places, 4.6e-5 in the force.
    np.testing.assert_allclose([errors[1][0], errors[1][3]], [5.5e-6, 4.6e-5], rtol=0.05)


@cache
def crank_motion(t):
    """Angle of the crank, its rate and acceleration at a time."""
    return references.slider_crank().motion(0.0, 6.0, t)


@each("form, formulation", [("u-lambda", "index-3"), ("a-lambda", "ggl")])
def test_spatial_slider_crank(form, formulation):
    """Order 2 of places, velocities and the reactions of four kinds of joints."""
    subject, linkage, t = newmark.problem("spatial-slider-crank"), references.slider_crank(), 0.5
    np.testing.assert_allclose(subject.v0.reshape(-1, 4, 3)[2, 0], [0.24, 0, 0], rtol=0, atol=1e-15)
    assert np.allclose(at_rest(subject)["rod.omega"], [1.92, -0.96, 0.48], rtol=0, atol=1e-14)
    q, rate, faster = crank_motion(t)
    places, turns = (part.real for part in linkage.places(q + 0j))
    velocities = linkage.first(q)[0] * rate
    pulls = linkage.accelerations(q, rate, faster) - linkage.gravity
    # What the ground gives to all, and what the universal joint takes from the slider.
    ground, push = linkage.masses @ pulls, linkage.masses[2] * pulls[2, 0]
    errors = []
    for h in (4e-3, 2e-3):
        u, v, found = marched(subject, h, t, form=form, formulation=formulation)
        errors.append(
            [
                away(u[:, 0], places), away(u[:, 1:].transpose(0, 2, 1), turns),
                away(v[:, 0], velocities), away(found["A.force"] + found["S.force"], ground),
                away(-found["C.force"][:1], np.array([push])),
                abs(np.exp(1j * found["A.angle"]) - np.exp(1j * q)),
            ]
        )  # fmt: skip
        assert found["A.moment"][0] == pytest.approx(0, abs=1e-10)  # it turns freely
        assert found["S.force"][0] == pytest.approx(0, abs=1e-10)  # it slides freely
    np.testing.assert_allclose(orders(errors), 2, atol=0.1)


def test_bricard():
    """Order 2, and the relation of its joint angles at every step; one row is redundant."""
    subject, linkage, t = newmark.problem("bricard"), references.bricard(), 0.5
    q, rate, faster = linkage.motion(0.0, 0.0, t)
    places = linkage.places(q + 0j)[0].real
    ground = linkage.accelerations(q, rate, faster).sum(axis=0) - 5 * linkage.gravity
    errors = []
    for h in (4e-3, 2e-3):
        u, v, found = marched(subject, h, t)
        errors.append(
            [
                away(u[:, 0], places), away(v[:, 0], linkage.first(q)[0] * rate),
                away(found["P0.force"] + found["P5.force"], ground),
            ]
        )  # fmt: skip
    np.testing.assert_allclose(orders(errors), 2, atol=0.1)
    done = newmark.march(subject, h=4e-3, t_end=4.0, integrator=DAMPED)
    joints = subject.outputs.joints
    for u in done.u[::25]:
        bodies = u.reshape(-1, 4, 3)
        a, b, *rest = (joints[f"P{k}"].angle(bodies) for k in range(6))
        assert (1 + np.sin(a)) * (1 + np.sin(b)) == pytest.approx(1, abs=1e-10)
        assert np.abs(rest) == pytest.approx(np.abs([a, b, a, b]), abs=1e-10)
    energy = done.energy
    assert np.abs(energy - energy[0]).max() < 1e-3


def test_governor():
    """Order 2 of places and rates: springs and dampers of a stiff mechanism, four freedoms."""
    subject, t = newmark.problem("governor"), 0.5
    beta, s, spin, _, slide, _ = references.governor(t)
    errors = []
    for h in (1e-3, 5e-4):
        u, v, found = marched(subject, h, t)
        errors.append(
            [
                away(u[1, 0, 2], np.array(s)), away(v[1, 0, 2], np.array(slide)),
                away(found["A.angle"], np.array(beta - np.pi / 6)),
                away(found["shaft.omega"][2], np.array(spin)),
            ]
        )  # fmt: skip
    np.testing.assert_allclose(orders(errors), 2, atol=0.1)
