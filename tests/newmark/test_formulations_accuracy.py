"""What formulations and projections do to the motion: errors, orders, drift, starts."""

from functools import cache

import numpy as np
import pytest
from each import each
from scipy.integrate import solve_ivp
from test_formulations import FORMULATIONS, PROJECTIONS, march_of, scheme_of, subject_of

from newmark_cli.newmark.formulation import CORRECTED, NEWTON, RECOVERED, TOTAL
from newmark_cli.newmark.integrator import BDF2, HHT, GeneralizedAlpha, Newmark
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scheme import COMPENSATED
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.reference import solution

TRAPEZOIDAL, DAMPED = Newmark(), GeneralizedAlpha(0.9)
#: Mass of the thrown pendulum (kg).
MASS = 1.5
CONVERGENT = [label for label in FORMULATIONS if "penalty" not in label]


@cache
def thrown_at(t):
    """u, v, λ of the thrown pendulum, from its angle, to thirteen digits."""
    found = solve_ivp(
        lambda _, y: [y[1], -np.cos(y[0])], (0, t), [0.0, 1.0], "DOP853", rtol=3e-14, atol=1e-15
    )
    angle, rate = found.y[:, -1]
    u = np.array([np.cos(angle), np.sin(angle)])
    v = rate * np.array([-u[1], u[0]])
    return u, v, np.array([MASS * (u[1] - rate**2)])


@cache
def andrews_at_the_end():
    """Multipliers of Andrews' mechanism at t = 0.03."""
    return solution(subject_of("andrews"), 0.03).multipliers


def marched(name, t, *arguments, change=None, **options):
    """A march to a time, from a start that may be changed."""
    scheme = scheme_of(*arguments, **options)
    march = March(subject_of(name), scheme)
    if change is not None:
        change(march.state)
    for _ in march.stretches(round(t / scheme.h)):
        pass
    return march


def thrown_errors(steps, *arguments, **options):
    """(steps, 3) largest errors of u, v, λ at t = 1."""
    found = []
    for h in steps:
        march = marched("thrown", 1.0, arguments[0], "a-lambda", h, *arguments[1:], **options)
        seen = march.seen
        parts = (seen.fields[0], seen.fields[1], seen.multipliers)
        found.append([np.abs(a - b).max() for a, b in zip(parts, thrown_at(1.0), strict=True)])
    return np.array(found)


def andrews_error(*arguments, **options):
    """Relative error of λ at t = 0.03."""
    found, right = marched("andrews", 0.03, *arguments, **options).multipliers, andrews_at_the_end()
    return float(np.abs(found - right).max() / np.abs(right).max())


@each("projection", PROJECTIONS)
@each("formulation", CONVERGENT)
def test_order_two_with_every_formulation_and_projection(formulation, projection):
    """Generalized-α: u, v and the recovered λ of a motion that does not start from rest.

    λ may fall faster where its first terms nearly cancel; it never falls slower.
    """
    steps = (1e-2, 5e-3, 2.5e-3)
    errors = thrown_errors(
        steps, formulation, GeneralizedAlpha(0.8), projection=projection, reported=RECOVERED
    )
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders[:, :2] > 1.85)
    assert np.all(orders[:, :2] < 2.15)
    assert np.all(orders[:, 2] > 1.75)
    assert np.all(errors[-1] < 3e-6)


@each("integrator", [DAMPED, HHT(0.1), BDF2()])
def test_the_total_reaction_is_of_order_two_where_lambda_is_not(integrator):
    """Velocities projected: λ has order 1, λ and what the projection did order 2.

    With BDF2 a change of velocities by M⁻¹Gμ in every step is worth 3μ/2h.
    """
    steps = (5e-3, 2.5e-3, 1.25e-3)
    newton = thrown_errors(steps, "index-3", integrator, projection="velocity")[:, 2]
    total = thrown_errors(steps, "index-3", integrator, projection="velocity", reported=TOTAL)[:, 2]
    np.testing.assert_allclose(np.log2(newton[:-1] / newton[1:]), 1.0, atol=0.15)
    np.testing.assert_allclose(np.log2(total[:-1] / total[1:]), 2.0, atol=0.15)


@each("formulation", ["index-2", "ggl"])
def test_the_projection_leaves_lambda_its_order_where_rates_are_in_the_system(formulation):
    """What the projection does is then O(h³) or rounding: Newton's λ, and the total, of order 2."""
    for integrator in (TRAPEZOIDAL, DAMPED):
        for reported in (NEWTON, TOTAL):
            errors = thrown_errors(
                (1e-2, 5e-3), formulation, integrator, projection="velocity", reported=reported
            )[:, 2]
            assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


#: Relative errors of λ, Andrews, t = 0.03, h = 1e-4 and 1e-5, trapezoidal and ρ∞ = 0.9.
ERRORS = {
    "index-2": ((1.1e-3, 1.2e-5), (1.1e-3, 1.2e-5)),
    "index-1": ((7.3e-4, 1.1e-5), (6.3e-4, 7.0e-6)),
    "baumgarte rate=1000": ((1.2e-2, 3.1e-5), (1.3e-2, 3.1e-5)),
    "baumgarte rate_h=1": ((2.5e-3, 1.3e-5), (2.6e-3, 1.3e-5)),
    "ggl": ((7.4e-4, 7.4e-6), (7.6e-4, 7.4e-6)),
}


@each("formulation", ERRORS)
def test_multipliers_of_andrews(formulation):
    """Errors as measured independently, where index 3 with the trapezoidal rule has 0.1 to 1."""
    for integrator, expected in zip((TRAPEZOIDAL, DAMPED), ERRORS[formulation], strict=True):
        for h, error in zip((1e-4, 1e-5), expected, strict=True):
            found = andrews_error(formulation, "a-lambda", h, integrator)
            assert found == pytest.approx(error, rel=0.08)


#: Drift of Andrews at h = 1e-5: largest |Φ| and |Gᵀv| until the end; None where it is rounding.
DRIFT = {
    "index-3": (None, 9.9e-7),
    "index-2": (8.0e-10, None),
    "index-1": (1.5e-9, 9.8e-7),
    "baumgarte rate=1000": (9.3e-10, 9.8e-7),
    "baumgarte rate_h=1": (2.0e-11, 9.9e-7),
    "ggl": (None, None),
}
ROUNDING = (1e-18, 3e-16)


@each("formulation", DRIFT)
def test_drift(formulation):
    """What stands in the system is met to rounding; the rest drifts like h², Φ of c/h like h³."""
    subject = subject_of("andrews")
    index_1 = Index1(subject)
    found = []
    for h in (2e-5, 1e-5):
        march = March(subject, scheme_of(formulation, "a-lambda", h, DAMPED))
        steps, sizes = round(0.03 / h), []
        for stretch in march.stretches(steps, looks=range(1, steps + 1, 10)):
            for u, v in stretch.record.fields[:, :2]:
                phi, rate = subject.constraint_values(0.0, u), index_1.rate(0.0, u, v)
                sizes.append([np.abs(phi).max(), np.abs(rate).max()])
        found.append(np.max(sizes, axis=0))
    for k, expected in enumerate(DRIFT[formulation]):
        if expected is None:
            assert found[1][k] < ROUNDING[k]
        else:
            assert found[1][k] == pytest.approx(expected, rel=0.1)
            order = 3 if formulation == "baumgarte rate_h=1" and k == 0 else 2
            assert np.log2(found[0][k] / found[1][k]) == pytest.approx(order, abs=0.2)


def test_the_augmented_lagrangian_needs_a_penalty_that_grows():
    """Factor 10: fewer iterations as h falls; the same penalty at every h: ever more."""
    subject, counts = subject_of("andrews"), {}
    first = march_of(subject, scheme_of("augmented-lagrangian factor=10", h=1e-4))
    penalty = first.system.constraining.penalty
    for h in (1e-4, 1e-5):
        for label in ("augmented-lagrangian factor=10", f"augmented-lagrangian penalty={penalty}"):
            march = march_of(subject, scheme_of(label, "a-lambda", h, DAMPED, iteration_cap=100))
            taken = march.advance(round(0.003 / h)).iterations
            counts[label.split()[1].split("=")[0], h] = np.median(np.abs(taken))
    assert counts["factor", 1e-4] == counts["penalty", 1e-4] <= 14
    assert counts["factor", 1e-5] < counts["factor", 1e-4]
    assert counts["penalty", 1e-5] > 60
    error = andrews_error("augmented-lagrangian", "a-lambda", 1e-5, DAMPED)
    assert error == pytest.approx(1.26e-5, rel=0.05)


def along_constraints(size):
    """A change along M⁻¹G of Andrews' start, of a 2-norm; as large in all constraints."""
    subject = subject_of("andrews")
    g = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(subject.m)).G
    change = np.linalg.solve(subject.M, g @ np.ones(subject.m))
    return change * size / np.linalg.norm(change)


def test_a_start_whose_velocities_miss_the_constraints():
    """Off by 1e-4 m/s: alternates like 1/h for ever, stays, or is forgotten."""

    def off(state):
        for velocities in (state.fields[1], state.past[1]):
            velocities += along_constraints(1e-4)

    def error(formulation, integrator, h=1e-5):
        return andrews_error(formulation, "a-lambda", h, integrator, change=off)

    for formulation in ("index-2", "ggl"):
        coarse, fine = (error(formulation, TRAPEZOIDAL, h) for h in (2e-5, 1e-5))
        assert fine == pytest.approx(1e-4, rel=0.3)
        assert fine > 1.3 * coarse
        assert error(formulation, DAMPED) < 1.3e-5
    for integrator in (TRAPEZOIDAL, DAMPED):
        coarse, fine = (error("index-1", integrator, h) for h in (2e-5, 1e-5))
        assert fine == pytest.approx(8e-5, rel=0.2)
        assert fine > 0.6 * coarse
        assert error("baumgarte rate_h=1", integrator) == pytest.approx(1.3e-5, rel=0.1)
    assert error("index-3", TRAPEZOIDAL, 2e-5) > 1e4


def test_the_corrected_start_repairs_the_trapezoidal_rule():
    """λ of the thrown pendulum: off by t at any h; corrected and compensated of order 2."""
    for h in (1e-2, 1e-3):
        for t in (0.1, 0.2):
            found = marched("thrown", t, "index-3", "u-lambda", h, TRAPEZOIDAL).multipliers
            assert np.abs(found - thrown_at(t)[2])[0] == pytest.approx(MASS * t, rel=0.2)
    steps = (4e-3, 2e-3, 1e-3)
    errors = thrown_errors(steps, "index-3", TRAPEZOIDAL, start=CORRECTED, evaluation=COMPENSATED)[
        :, 2
    ]
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.1)
    assert errors[-1] == pytest.approx(1.37e-6, rel=0.1)
    for spelling in (GeneralizedAlpha(1.0), HHT(0.0)):
        found = thrown_errors(
            steps[:1], "index-3", spelling, start=CORRECTED, evaluation=COMPENSATED
        )
        assert found[0, 2] == pytest.approx(errors[0], rel=1e-3), spelling.label
