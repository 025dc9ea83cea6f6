"""Velocities of corrected starts; `test_formulations_accuracy` has what they are for."""

from dataclasses import replace

import numpy as np
import pytest
from damped import MASS, damped
from marching import scheme_of
from mpmath import mp, mpf
from test_constraint_rows import wavy, wavy_phi

from newmark_cli.newmark.formulation import CORRECTED
from newmark_cli.newmark.march import initial_state
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.starting import constraint_jerk, corrected_velocity


def moving(subject):
    """The same from other velocities, as near as the constraints allow to general ones."""
    _, v = Index1(subject).projected(0.0, subject.u0, np.array([0.4, -0.2, 0.3]))
    return replace(subject, v0=v)


def ellipsoid_phi(u, t):
    return [sum((1 + i) * x**2 for i, x in enumerate(u)) / 2 - mpf("0.5")]


def bent():
    return wavy(lambda function: function, ("curvature",))


@pytest.mark.parametrize(
    ("make", "phi"), [(wavy, wavy_phi), (bent, wavy_phi), (damped, ellipsoid_phi)]
)
def test_the_jerk_and_the_velocity_that_it_asks_for(make, phi):
    """Gᵀu‴ is what the third derivative of Φ along u + sv + s²a/2 lacks; by mpmath."""
    subject = moving(make())
    u, v, (a, _) = (
        subject.u0,
        subject.v0,
        Index1(subject).accelerations(0.0, subject.u0, subject.v0),
    )
    with mp.workdps(40):
        path = [[mpf(float(x)) for x in of] for of in (u, v, a)]

        def along(s):
            return phi([x + s * y + s**2 * z / 2 for x, y, z in zip(*path, strict=True)], s)[0]

        expected = -float(mp.diff(along, 0, 3))
    np.testing.assert_allclose(constraint_jerk(subject), expected, rtol=1e-8)
    # Least change in the norm of M: M δv is in the range of G.
    change = corrected_velocity(subject, 0.01) - v
    gradient = subject.evaluate(0.0, u, v, np.zeros(1)).G
    np.testing.assert_allclose(gradient.T @ change, -1e-4 / 12 * expected, rtol=1e-6)
    pulled = (MASS if phi is ellipsoid_phi else np.eye(3)) @ change
    inside = gradient @ np.linalg.lstsq(gradient, pulled, rcond=None)[0]
    np.testing.assert_allclose(inside, pulled, rtol=0, atol=1e-9 * np.abs(pulled).max())
    # What the start leaves of Φ' in proportion to h² is what a change of h goes by.
    state = initial_state(subject, scheme_of("u-lambda", "none", 0.01, start=CORRECTED))
    np.testing.assert_allclose(1e-4 * state.rates[1:], state.psi, rtol=1e-6)
