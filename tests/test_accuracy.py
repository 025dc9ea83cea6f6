"""The scheme against exact and published motions: order 2, and physical corrections."""

import numpy as np
import oracles
import pytest
from each import each
from mpmath import mp
from scipy.special import ellipj

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import compiled_march, march_data
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme


def final_state(name, h, t_end, integrator=None):
    form = FORMS["u-lambda"]
    integrator = integrator or Newmark()
    scheme = Scheme(integrator, form, named_scaling("optimal", form), h)
    subject = problem(name)
    state = initial_state(subject, scheme)
    steps = round(t_end / h)
    ending = compiled_march.march(
        subject, scheme, state, 0, np.zeros((steps, 2)), np.zeros(steps, np.int64)
    )
    assert ending == (march_data.COMPLETED, steps)
    return state


def order(h, errors):
    return np.polyfit(np.log(h), np.log(errors), 1)[0]


@pytest.fixture(scope="module")
def andrews_errors():
    """Largest errors of positions and velocities at t = 0.03, by step size."""
    with mp.workdps(30):
        points, velocities = oracles.andrews_points(
            oracles.REFERENCE_ANGLES, oracles.REFERENCE_RATES
        )
    reference = np.array(points, float), np.array(velocities, float)
    errors = {}
    for h in (1e-4, 5e-5, 3e-5, 2e-5, 1e-5, 1e-6):
        state = final_state("andrews", h, 0.03)
        errors[h] = [np.abs(f - r).max() for f, r in zip(state.fields, reference, strict=False)]
    return errors


def test_andrews_positions_converge(andrews_errors):
    """Order 2.0 ± 0.1 against the IVP test set, and the error's size."""
    h = np.array(list(andrews_errors))
    errors = np.array([e[0] for e in andrews_errors.values()])
    assert order(h, errors) == pytest.approx(2.0, abs=0.1)
    np.testing.assert_allclose(errors[[0, 4, 5]], [2.2e-4, 2.2e-6, 2.2e-8], rtol=0.05)


def test_andrews_velocities_converge(andrews_errors):
    """Order 2.0 ± 0.1 once errors are small; from h = 1e-5 on rounding shows, see the next test."""
    h = np.array([5e-5, 3e-5, 2e-5])
    errors = np.array([andrews_errors[x][1] for x in h])
    assert order(h, errors) == pytest.approx(2.0, abs=0.1)


def pendulum_position(t):
    """Exact motion from the horizontal at rest, by Jacobi's elliptic functions."""
    modulus = np.sqrt(0.5)
    _, cn, dn, _ = ellipj(t, modulus**2)
    angle = 2 * np.arcsin(modulus * cn / dn)
    return np.array([np.sin(angle), -np.cos(angle)])


def test_pendulum_converges():
    """Positions and energy at t = 3 with order 2.0 ± 0.1 against the exact motion."""
    h = np.array([1e-1, 3e-2, 1e-2, 3e-3, 1e-3])
    positions, energies = [], []
    for step in h:
        state = final_state("pendulum", step, 3.0)
        u, v = state.fields[:2]
        positions.append(np.abs(u - pendulum_position(round(3.0 / step) * step)).max())
        energies.append(abs(0.5 * v @ v + u[1]))
    assert order(h, positions) == pytest.approx(2.0, abs=0.1)
    assert order(h, energies) == pytest.approx(2.0, abs=0.1)


@each(
    "name, t_end, h",
    [
        ("pendulum", 0.6, [1e-1, 3e-2, 1e-2, 3e-3]),
        ("double-pendulum", 0.6, [1e-2, 3e-3, 1e-3]),
        ("slider-crank", 0.3, [3e-3, 1e-3, 3e-4]),
    ],
)
def test_energy_is_conserved_at_second_order(name, t_end, h):
    """Mechanisms under gravity alone: kinetic energy plus −f·u, whose f is constant.

    Not for long: the trapezoidal rule is weakly unstable on index-3 systems
    (Cardona and Géradin, 1989), and the slider-crank's energy grows from t = 0.6 on.
    """
    subject = problem(name)
    weight = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(subject.m)).force

    def energy(u, v):
        return 0.5 * v @ subject.M @ v - weight @ u

    begin, errors = energy(subject.u0, subject.v0), []
    for step in h:
        u, v = final_state(name, step, t_end).fields[:2]
        errors.append(abs(energy(u, v) - begin))
    assert order(np.array(h), np.array(errors)) == pytest.approx(2.0, abs=0.1)
    assert errors[-1] < 1e-3
