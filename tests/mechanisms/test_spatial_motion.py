"""Motions and reactions of spatial mechanisms against what knows no directors."""

import numpy as np
import pytest
import spatial
from scipy.integrate import solve_ivp

import newmark_cli as newmark
from newmark_cli.problems.index_1 import Index1

G = 9.81


def euler(inertia, torque, start, t):
    """Rotation (3, 3), body rates and their rates at t, by Euler's equations in body axes."""
    inverse = np.linalg.inv(inertia)

    def rates(_, state):
        frame, w = state[:9].reshape(3, 3), state[9:]
        faster = inverse @ (torque(frame) - np.cross(w, inertia @ w))
        return np.concatenate([(frame @ spatial.cross(w)).ravel(), faster])

    start = np.concatenate([np.eye(3).ravel(), start])
    state = solve_ivp(rates, (0, t), start, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return state[:9].reshape(3, 3), state[9:], rates(t, state)[9:]


def test_heavy_top():
    """Order 2 of place, velocity, angular velocity and reaction, though M is singular."""
    subject = newmark.problem("heavy-top")
    about = np.diag([15.234375, 0.46875, 15.234375])
    weight, centre, t = 15 * G, np.array([0, 1, 0]), 0.1

    def pull(frame):
        return np.cross(centre, frame.T @ np.array([0, 0, -weight]))

    turned, w, faster = euler(about, pull, [0, 150, -4.61538], t)
    acceleration = turned @ (np.cross(faster, centre) + np.cross(w, np.cross(w, centre)))
    force = 15 * (acceleration + np.array([0, 0, G]))
    errors = []
    for h in (4e-4, 2e-4):
        done = newmark.march(subject, h=h, t_end=t, every=0, integrator="generalized-alpha rho=0.9")
        u, v = (x[-1].reshape(4, 3) for x in (done.u, done.v))
        found = spatial.outputs(subject, t, done.u[-1], done.v[-1], done.multipliers[-1])
        pairs = (
            (u[2], turned @ centre), (v[2], turned @ np.cross(w, centre)),
            (found["top.omega"], turned @ w), (found["O.force"], force),
        )  # fmt: skip
        errors.append([np.abs(one - other).max() / np.abs(other).max() for one, other in pairs])
    np.testing.assert_allclose(np.log2(np.divide(*errors)), 2, atol=0.1)
    # As measured independently at h = 1e-4: 5.5e-6 in places, 4.6e-5 in the force.
    np.testing.assert_allclose([errors[1][0], errors[1][3]], [2.2e-5, 1.84e-4], rtol=0.08)


def governor(beta, s, spin, turn, slide):
    """The flyball governor: β'', s'', ψ'' of a state β, s, ψ', β', s'.

    By symmetry both rods have one angle β below the horizontal; s is the height of the
    sleeve. The angular momentum I ψ' is constant.
    """
    short, long = 0.3 * 0.0002 / 12, 0.3 * 1.0001 / 12
    of_rod = long + 0.3 * 0.25 + 5

    def about_shaft(beta):
        c, d = np.cos(beta), np.sin(beta)
        rod = short * d**2 + long * c**2 + 0.3 * (0.05 + 0.5 * c) ** 2 + 5 * (0.05 + c) ** 2
        return 0.3 * 0.0002 / 12 + 3 * 0.02 / 12 + 2 * rod

    c, d = np.cos(beta), np.sin(beta)
    x, z = 0.5 * c, 1 - 0.5 * d - s  # from the sleeve to the middle of a rod
    length = np.hypot(x, z)
    of_beta, of_s = (-0.5 * d * x - 0.5 * c * z) / length, -z / length
    force = 8e5 * (length - 0.5) + 4e4 * (of_beta * turn + of_s * slide)
    shrinks = about_shaft(beta + 1e-30j).imag / 1e-30
    out = spin**2 * shrinks / 4 + (0.3 * 0.5 + 5) * G * c - force * of_beta
    return out / of_rod, -G - 2 * force * of_s / 3, -shrinks * turn * spin / about_shaft(beta)


def test_governor():
    """Springs and dampers of a stiff mechanism, four freedoms: accelerations of a state."""
    subject = newmark.problem("governor")
    beta, s, spin, turn, slide = 0.6, 0.47, 5.0, 0.02, -0.03
    step = 1e-30j
    c, d = (f(beta + step * turn) for f in (np.cos, np.sin))
    z = s + step * slide
    rod = np.array([[0.05, 0, 1], [c, 0, -d], [0, 1, 0], [d, 0, c]])
    half = np.diag([-1, -1, 1])
    bodies = [np.eye(4, 3, -1) + 0j, np.eye(4, 3, -1) + 0j, rod, rod @ half]
    bodies[0][0], bodies[1][0] = [0, 0, 0.5], [0, 0, z]
    angle = step * spin
    state = np.array(bodies) @ np.array([[1, angle, 0], [-angle, 1, 0], [0, 0, 1]])
    u, v = state.real.ravel(), state.imag.ravel() / 1e-30
    a = Index1(subject).accelerations(0.0, u, v)[0].reshape(-1, 4, 3)
    faster, lifted, spun = governor(beta, s, spin, turn, slide)
    size = abs(lifted)
    assert a[1, 0, 2] == pytest.approx(lifted, abs=1e-7 * size)
    assert -a[2, 1, 2] == pytest.approx(c.real * faster - d.real * turn**2, abs=1e-7 * size)
    assert a[0, 1, 1] == pytest.approx(spun, abs=1e-7 * size)


def test_start_of_the_spatial_slider_crank():
    """The rod's angular velocity by hand, from the rate of the crank and the universal joint."""
    subject = newmark.problem("spatial-slider-crank")
    spins = spatial.spin(subject.u0, subject.v0)
    np.testing.assert_allclose(spins[1], [1.92, -0.96, 0.48], atol=1e-14)
