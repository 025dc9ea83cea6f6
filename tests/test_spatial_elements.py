"""Elements and joints of spatial mechanisms against complex steps and differences."""

from functools import cache

import numpy as np
import pytest
import spatial
from each import each
from mechanisms import built, complex_terms

from newmark_cli.mechanisms.joints import JOINTS

T = 0.4


@cache
def subject_of(joints):
    """A mechanism with every element, and some of the joints."""
    return built(spatial.everything(joints))


#: Those that have every joint together.
EVERY = each("joints", spatial.SETS)


def states(subject, random):
    """A position off the constraints, velocities, accelerations and multipliers."""
    u = subject.u0 + 0.1 * random.normal(size=subject.n)
    return u, *random.normal(size=(2, subject.n)), random.normal(size=subject.m)


def test_sets_have_every_joint():
    """Every kind of joint is among those that are tested."""
    assert {kind for kind in JOINTS if f"type: {kind}," in "".join(spatial.SETS.values())} == set(
        JOINTS
    )


@EVERY
def test_tangents_are_derivatives(joints):
    """X, Y, G against complex steps, to 1e-10 of their largest entry."""
    subject, random = subject_of(joints), np.random.default_rng(7)
    u, v, _, multipliers = states(subject, random)
    found = subject.evaluate(T, u, v, multipliers)
    # Whatever a wrong entry is, a random direction sees it.
    for direction in random.normal(size=(3, subject.n)):
        force, phi = complex_terms(subject, T, u + 1e-30j * direction, v, multipliers)
        faster, _ = complex_terms(subject, T, u, v + 1e-30j * direction, multipliers)
        for matrix, change in ((-found.X, force), (found.G.T, phi), (-found.Y, faster)):
            expected = change.imag / 1e-30
            size = np.abs(expected).max()
            np.testing.assert_allclose(matrix @ direction, expected, rtol=0, atol=1e-10 * size)
    force, phi = complex_terms(subject, T, u, v, multipliers)
    np.testing.assert_allclose(found.force, force.real, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.phi, phi.real, rtol=1e-12, atol=1e-12)


@EVERY
def test_rates_of_constraints(joints):
    """Φ', Φ'' and their tangents against differences of Φ along a motion, and of each other."""
    subject = subject_of(joints)
    u, v, w, multipliers = states(subject, np.random.default_rng(7))

    def along(s):
        return u + s * v + s**2 / 2 * w, v + s * w

    def phi(s):
        return subject.constraint_values(T + s, along(s)[0])

    rows = subject.constraint_rows(T, u, v, w)
    g = subject.evaluate(T, u, v, multipliers).G
    first = [(phi(h) - phi(-h)) / (2 * h) for h in (1e-3, 2e-3)]
    second = [(phi(h) - 2 * phi(0) + phi(-h)) / h**2 for h in (1e-2, 2e-2)]
    rate, curvature = (4 * fine / 3 - coarse / 3 for fine, coarse in (first, second))
    np.testing.assert_allclose(g.T @ v + rows.rate, rate, rtol=0, atol=1e-9)
    np.testing.assert_allclose(g.T @ w + rows.curvature, curvature, rtol=0, atol=1e-5)

    def dense(values):
        matrix = np.zeros((subject.n, subject.m))
        np.add.at(matrix, (subject.pattern.g_rows, subject.pattern.g_columns), values)
        return matrix

    for k, of in ((0, rows.r), (1, rows.q)):
        expected = np.empty((subject.n, subject.m))
        for j in range(subject.n):
            sides = []
            for h in (1e-5, -1e-5):
                moved = u.copy()
                moved[j] += h
                there = subject.constraint_rows(T, moved, v, w)
                turned = subject.evaluate(T, moved, v, multipliers).G.T
                sides.append(turned @ v + there.rate if k == 0 else turned @ w + there.curvature)
            expected[j] = (sides[0] - sides[1]) / 2e-5
        np.testing.assert_allclose(dense(of), expected, rtol=0, atol=1e-8)


def test_forces_derive_from_the_potential():
    """f = −∂V/∂u where nothing damps or drives, by differences."""
    random = np.random.default_rng(7)
    text = spatial.everything("pairs")
    for section in ("dampers", "torsion_dampers", "torques", "motions"):
        begin = text.index(f"{section}:\n")
        end = begin + len(section) + 2
        while text[end] == " ":
            end = text.index("\n", end) + 1
        text = text[:begin] + text[end:]
    subject = built(text)
    assert subject.quadratic
    u = subject.u0 + 0.05 * random.normal(size=subject.n)
    nothing = np.zeros(subject.n), np.zeros(subject.m)
    force = subject.evaluate(0.0, u, *nothing).force
    for j in range(subject.n):
        step = np.zeros(subject.n)
        step[j] = 1e-5
        sides = [subject.energies(0.0, u + s * step, nothing[0])[1] for s in (1, -1)]
        assert -(sides[0] - sides[1]) / 2e-5 == pytest.approx(force[j], abs=1e-7)
