"""The scheme against a published motion: order 2, and the size of errors."""

import numpy as np
import oracles
import pytest
from mpmath import mp

import newmark_cli as newmark


def test_andrews_converges_to_the_published_table():
    """Order 2.0 ± 0.1 against the IVP test set; of velocities until rounding shows at h = 1e-5."""
    with mp.workdps(30):
        exact = oracles.andrews_points(oracles.REFERENCE_ANGLES, oracles.REFERENCE_RATES)
    steps, errors = np.array([1e-4, 5e-5, 3e-5, 2e-5, 1e-5, 1e-6]), []
    for h in steps:
        end = newmark.march("andrews", h=h, t_end=0.03, every=0)
        errors.append(
            [
                np.abs(f[-1] - np.array(x, float)).max()
                for f, x in zip((end.u, end.v), exact, strict=True)
            ]
        )
    positions, velocities = np.array(errors).T
    assert np.polyfit(np.log(steps), np.log(positions), 1)[0] == pytest.approx(2.0, abs=0.1)
    np.testing.assert_allclose(positions[[0, 4, 5]], [2.2e-4, 2.2e-6, 2.2e-8], rtol=0.05)
    h, rates = steps[1:4], velocities[1:4]
    assert np.polyfit(np.log(h), np.log(rates), 1)[0] == pytest.approx(2.0, abs=0.1)
