"""Integrators: labels, relations against the textbook, damping, orders, a published motion."""

from contextlib import nullcontext
from dataclasses import replace
from functools import cache

import numpy as np
import oracles
import pytest
import textbook
from covering import covering
from damped import DAMPING, MASS, STIFFNESS, damped
from hypothesis import given
from hypothesis import strategies as st
from marching import ENGINES, INTEGRATORS, compiled, march, scheme_of
from mpmath import mp, mpf

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import (
    BDF1,
    BDF2,
    HHT,
    NEW_A,
    NEW_NU,
    NEW_U,
    NEW_V,
    NEW_W,
    TRUE_ACCELERATION,
    Alpha,
    GeneralizedAlpha,
    IntegratorError,
    Newmark,
)
from newmark_cli.newmark.integrator_labels import parse
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.orders import form_orders
from newmark_cli.newmark.scaling import PAPER_VARIANTS, named_scaling
from newmark_cli.report.judging.fits import power_law
from newmark_cli.study.observers import corrections

# Labels and parameters

ANY = st.one_of(
    st.builds(Newmark, st.floats(1e-300, 1e300), st.floats(0.5, 1e300)),
    st.builds(GeneralizedAlpha, st.floats(0, 1)),
    st.builds(HHT, st.floats(0, 1 / 3)),
    st.builds(Alpha, st.floats(0.5, 9), st.floats(0.5, 1), st.floats(-9, 0.5), st.floats(-9, 0.5)),
    st.builds(BDF1),
    st.builds(BDF2),
)


@given(ANY)
def test_labels_read_back(integrator):
    """Method and parameters to the last bit."""
    assert parse(integrator.label) == integrator


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("newmrk beta=0.25 gamma=0.5", "did you mean 'newmark'"),
        ("bdf3", "unknown integrator 'bdf3'"),
        ("newmark gamma=0.5 beta=0.25", "its parameters are beta, gamma"),
        ("bdf1 rho=0.1", "its parameters are none"),
        ("hht alpha=much", "parameters must be numbers"),
        ("newmark beta=0 gamma=0.5", "beta = 0: must be positive"),
        ("newmark beta=0.25 gamma=0.49", "gamma = 0.49: must be at least 0.5"),
        ("newmark beta=0.25 gamma=nan", "gamma = nan: must be at least 0.5"),
        ("generalized-alpha rho=nan", "rho = nan: must be within [0, 1]"),
        ("alpha beta=0.2 gamma=0.6 alpha_m=0 alpha_f=0.1", "beta = 0.2: multipliers would grow"),
        ("alpha beta=0.3 gamma=0.6 alpha_m=0.6 alpha_f=0.1", "alpha_m = 0.6: must be at most 0.5"),
        ("alpha beta=1 gamma=0.6 alpha_m=0 alpha_f=0.7", "by a factor of 2.3333 in every step"),
        ("alpha beta=0 gamma=0.5 alpha_m=0 alpha_f=0", "beta = 0: must be positive"),
        ("alpha beta=inf gamma=0.5 alpha_m=0 alpha_f=0", "beta = inf: must be finite"),
        ("hht alpha=0.34", "alpha = 0.34: must be within [0, 0.333333]"),
    ],
)
def test_refusals(label, words):
    """What is no integrator, in one line that says what is allowed."""
    with pytest.raises(IntegratorError) as caught:
        parse(label)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


# Relations against the textbook


STEPS, H = 2, 0.05


def damped_system():
    """The problem of damped.py, typed again."""
    mass, stiffness, damping = (
        [[mpf(float(x)) for x in row] for row in matrix] for matrix in (MASS, STIFFNESS, DAMPING)
    )

    def force(t, u, v, multipliers):
        return [
            multipliers[0] * (1 + i) * u[i] + 2 * mp.sin(3 * t + i)
            - mp.fdot(stiffness[i], u) - mp.fdot(damping[i], v)
            for i in range(3)
        ]  # fmt: skip

    return textbook.System(mass, force, lambda u: [(u[0] ** 2 + 2 * u[1] ** 2 + 3 * u[2] ** 2 - 1)])


@cache
def textbook_motion(integrator):
    """The last of a few steps, 24 digits."""
    fields = initial_state(damped(), scheme_of("u-lambda", "none", H, integrator))
    with mp.workdps(24):
        u, v, a, _ = ([mpf(float(x)) for x in field] for field in fields.fields)
        start = textbook.Motion(mpf(0), u, v, a, a, [mpf(float(fields.multipliers[0]))])
        *_, last = textbook.march(integrator, damped_system(), start, mpf(H), STEPS)
        return [np.array(x, float) for x in (last.u, last.v, last.a, last.rate, last.multipliers)]


@pytest.mark.parametrize(
    ("integrator", "form", "evaluation"), covering(INTEGRATORS, FORMS, ["direct", "compensated"])
)
def test_marches_are_those_of_the_textbook(integrator, form, evaluation):
    """Stiffness, damping, full M, a force of time: both engines, every form, to rounding."""
    u, v, a, rate, multipliers = textbook_motion(integrator)
    subject = replace(damped(), quadratic=True)
    scheme = scheme_of(form, "optimal", H, integrator, evaluation=evaluation)
    for engine in ENGINES:
        state = initial_state(subject, scheme)
        march(engine, subject, scheme, state, 0, STEPS)
        expected = [*zip(state.fields, (u, v, a, rate), strict=True)]
        for found, exact in [*expected, (state.multipliers, multipliers)]:
            np.testing.assert_allclose(found, exact, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("integrator", "h"), covering(INTEGRATORS, [1.0, 0.3, 1e-5]))
def test_symbols_are_sensitivities_to_displacement(integrator, h):
    """γ/(βh) = ∂v/∂u and 1/(βh²) = ∂v'/∂u, from which every scaling follows."""
    symbols, found = integrator.symbols(h), integrator.relations(h)
    beta, gamma = symbols["beta"], symbols["gamma"]
    assert symbols["h"] == h
    assert gamma / (beta * h) == pytest.approx(found.v_from_a / found.u_from_a, rel=1e-14)
    expected = found.acceleration[0] / found.u_from_a
    assert 1 / (beta * h**2) == pytest.approx(expected, rel=1e-14)


# Damping of what the constraints do not see


def spectral_radius(integrator):
    """Of one step's map of the past, where the constraint holds u at 0."""
    found = integrator.relations(1.0)
    a = -found.u_past / found.u_from_a
    v = found.v_from_a * a + found.v_past
    rate = found.acceleration[0] * a + found.acceleration[1:]
    old_u, old_v = np.eye(len(a))[:2]
    values = {
        NEW_U: 0 * a, NEW_V: v, NEW_A: a, TRUE_ACCELERATION: rate, NEW_W: -old_u - old_v,
        NEW_NU: v - old_v,
    }  # fmt: skip
    return np.abs(np.linalg.eigvals([values[source] for source in found.advance])).max()


@pytest.mark.parametrize(
    ("integrator", "radius"),
    [
        # Chung and Hulbert's definition of ρ∞.
        *((GeneralizedAlpha(rho), rho) for rho in (0.0, 0.25, 0.5, 0.9, 1.0)),
        (Newmark(), 1),
        # β = (γ + 1/2)²/4: a double eigenvalue (γ − 3/2)/(γ + 1/2)
        (Newmark(0.3025, 0.6), 0.9 / 1.1),
        (Newmark(0.25, 0.6), 1.2 + np.sqrt(0.84)),
        (Newmark(1 / 6, 0.5), 2 + np.sqrt(3)),
        (BDF1(), 0),
        (BDF2(), 0),
    ],
)
def test_spectral_radii(integrator, radius):
    """Worked out by hand; an eigenvalue of multiplicity three is found to the third root of eps."""
    assert spectral_radius(integrator) == pytest.approx(radius, abs=1e-4)
    assert integrator.damped == (radius < 1)


@pytest.mark.parametrize(
    ("integrator", "expected"),
    [
        (Newmark(), True),
        (GeneralizedAlpha(1.0), True),
        (HHT(0.0), True),
        (Alpha(0.25, 0.5, 0.3, 0.3), True),
        # The same V and K, but v' is not a.
        (Alpha(0.25, 0.5, -0.1, 0.0), False),
        (Newmark(0.25, 0.6), False),
        (GeneralizedAlpha(0.9), False),
        (BDF2(), False),
    ],
)
def test_names_of_the_trapezoidal_rule(integrator, expected):
    """Its states, and its own start, whatever it is called."""
    rule, own = (
        newmark.march("four-bar", h=1e-2, steps=5, integrator=of) for of in (Newmark(), integrator)
    )
    assert np.allclose(own.u, rule.u, rtol=0, atol=1e-12) == expected
    refused = pytest.raises(newmark.NewmarkError, match="corrected is of the trapezoidal rule")
    with nullcontext() if expected else refused:
        newmark.march("pendulum", h=1e-2, steps=1, start="corrected", integrator=integrator)


# Orders in h of corrections and condition numbers


@pytest.mark.parametrize(
    ("integrator", "form", "variant"), covering(INTEGRATORS, FORMS, PAPER_VARIANTS)[::2]
)
def test_corrections_have_the_predicted_orders(integrator, form, variant):
    """Scaled and physical, kept and recovered, ± 0.15; the pendulum, rms over 300 steps or more."""
    subject, h, values = problem("pendulum"), [1e-2, 3e-3, 1e-3], {}
    for step in h:
        scheme = scheme_of(form, variant, step, integrator)
        state = initial_state(subject, scheme)
        norms, iterations = march(compiled, subject, scheme, state, 0, int(3.0 / step))
        assert np.all(iterations > 0)
        for found in corrections(scheme, norms, iterations):
            values.setdefault((found.measure, found.quantity), []).append(found.statistics.rms)
    orders, scaling = form_orders(FORMS[form]), named_scaling(variant, FORMS[form])
    expected = {("correction", q): order for q, order in orders.corrections(scaling).items()}
    expected |= {
        ("physical_correction", q): order for q, order in orders.physical_corrections().items()
    }
    slopes = {key: power_law(np.array(h), np.array(rms)).slope for key, rms in values.items()}
    assert slopes == {key: pytest.approx(order, abs=0.15) for key, order in expected.items()}


# The scheme against a published motion


def test_andrews_converges_to_the_published_table():
    """Order 2.0 ± 0.1 against the IVP test set; of velocities until rounding shows at h = 1e-5."""
    with mp.workdps(30):
        exact = oracles.andrews_points(oracles.REFERENCE_ANGLES, oracles.REFERENCE_RATES)
    steps, errors = np.array([1e-4, 5e-5, 2e-5, 1e-5, 1e-6]), []
    for h in steps:
        end = newmark.march("andrews", h=h, t_end=0.03, every=0)
        pairs = zip((end.u, end.v), exact, strict=True)
        errors.append([np.abs(f[-1] - np.array(x, float)).max() for f, x in pairs])
    positions, velocities = np.array(errors).T
    assert np.polyfit(np.log(steps), np.log(positions), 1)[0] == pytest.approx(2.0, abs=0.1)
    np.testing.assert_allclose(positions[[0, 3, 4]], [2.2e-4, 2.2e-6, 2.2e-8], rtol=0.05)
    h, rates = steps[1:3], velocities[1:3]
    assert np.polyfit(np.log(h), np.log(rates), 1)[0] == pytest.approx(2.0, abs=0.1)
