"""Motions and reactions of spatial mechanisms against what knows no directors."""

import numpy as np
import pytest
import spatial
import spatial_references as references
from spatial import outputs

import newmark_cli as newmark
from newmark_cli.problems.index_1 import Index1


def accelerated(subject, u, v):
    """Accelerations of origins and directors (b, 4, 3) of a state, and outputs by name."""
    u, v = u.ravel(), v.ravel()
    a, multipliers = Index1(subject).accelerations(0.0, u, v)
    return a.reshape(-1, 4, 3), outputs(subject, 0.0, u, v, multipliers)


def test_heavy_top():
    """Order 2 of place, velocity, angular velocity and reaction, though M is singular."""
    subject = newmark.problem("heavy-top")
    about = np.diag([15.234375, 0.46875, 15.234375])
    weight, centre, t = 15 * references.G, np.array([0, 1, 0]), 0.1

    def pull(frame):
        return np.cross(centre, frame.T @ np.array([0, 0, -weight]))

    turned, w, faster = references.euler(about, pull, [0, 150, -4.61538], t)
    acceleration = turned @ (np.cross(faster, centre) + np.cross(w, np.cross(w, centre)))
    force = 15 * (acceleration + np.array([0, 0, references.G]))
    errors = []
    for h in (4e-4, 2e-4):
        done = newmark.march(subject, h=h, t_end=t, every=0, integrator="generalized-alpha rho=0.9")
        u, v = (x[-1].reshape(4, 3) for x in (done.u, done.v))
        found = outputs(subject, t, done.u[-1], done.v[-1], done.multipliers[-1])
        pairs = (
            (u[2], turned @ centre), (v[2], turned @ np.cross(w, centre)),
            (found["top.omega"], turned @ w), (found["O.force"], force),
        )  # fmt: skip
        errors.append([np.abs(one - other).max() / np.abs(other).max() for one, other in pairs])
    np.testing.assert_allclose(np.log2(np.divide(*errors)), 2, atol=0.1)
    # As measured independently at h = 1e-4: 5.5e-6 in places, 4.6e-5 in the force.
    np.testing.assert_allclose([errors[1][0], errors[1][3]], [2.2e-5, 1.84e-4], rtol=0.08)


@pytest.mark.parametrize("name", ["spatial-slider-crank", "bricard"])
@pytest.mark.parametrize(("q", "rate"), [(0.3, -2.0), (-0.2, 5.0)])
def test_linkages_of_one_freedom(name, q, rate):
    """Accelerations of all bodies, and what the ground and single joints carry."""
    subject = newmark.problem(name)
    linkage = {"bricard": references.bricard, "spatial-slider-crank": references.slider_crank}[
        name
    ]()
    places = [part + 0 for part in linkage.places(q + 1e-30j)]
    state = np.concatenate([places[0][:, None], places[1].transpose(0, 2, 1)], axis=1)
    u, v = state.real, rate * state.imag / 1e-30
    faster = linkage.faster(q, rate)
    a, found = accelerated(subject, u, v)
    centres = linkage.accelerations(q, rate, faster)
    size = np.abs(centres).max()
    np.testing.assert_allclose(a[:, 0], centres, atol=2e-6 * size)
    pulls = linkage.masses[:, None] * (centres - linkage.gravity)
    first, last = ("P0", "P5") if name == "bricard" else ("A", "S")
    ground = found[f"{first}.force"] + found[f"{last}.force"]
    np.testing.assert_allclose(ground, pulls.sum(axis=0), atol=5e-6 * size)
    if name == "bricard":
        # (1 + sin a)(1 + sin b) = 1
        np.testing.assert_allclose(subject.constraint_values(0.0, u.ravel()), 0, atol=1e-14)
    else:
        assert -found["C.force"][0] == pytest.approx(pulls[2, 0], abs=1e-6 * size)
        assert found["A.moment"][0] == pytest.approx(0, abs=1e-8)  # it turns freely
        assert found["S.force"][0] == pytest.approx(0, abs=1e-8)  # it slides freely
        assert found["A.angle"] == pytest.approx(q, abs=1e-12)
        start = spatial.spin(subject.u0, subject.v0)
        np.testing.assert_allclose(start[1], [1.92, -0.96, 0.48], atol=1e-14)


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
    a, _ = accelerated(subject, state.real, state.imag / 1e-30)
    faster, lifted, spun = references.governor(beta, s, spin, turn, slide)
    size = abs(lifted)
    assert a[1, 0, 2] == pytest.approx(lifted, abs=1e-7 * size)
    assert -a[2, 1, 2] == pytest.approx(c.real * faster - d.real * turn**2, abs=1e-7 * size)
    assert a[0, 1, 1] == pytest.approx(spun, abs=1e-7 * size)
