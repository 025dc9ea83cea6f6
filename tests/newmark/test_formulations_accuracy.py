"""What formulations and projections do to the motion: errors, orders, drift, starts."""

from functools import cache

import numpy as np
import pytest
from covering import covering
from marching import FORMULATIONS, PROJECTIONS, formulated
from oracles import swing
from test_formulations import subject_of

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


def thrown_at(t):
    """u, v, λ of the thrown pendulum, from its angle."""
    angle, rate = swing(t, 1.0)
    u = np.array([np.cos(angle), np.sin(angle)])
    v = rate * np.array([-u[1], u[0]])
    return u, v, np.array([MASS * (u[1] - rate**2)])


@cache
def andrews_at_the_end():
    """Multipliers of Andrews' mechanism at t = 0.03."""
    return solution(subject_of("andrews"), 0.03).multipliers


def marched(name, t, *arguments, change=None, **options):
    """A march to a time, from a start that may be changed."""
    scheme = formulated(*arguments, **options)
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


@pytest.mark.parametrize(("formulation", "projection"), covering(CONVERGENT, PROJECTIONS))
def test_order_two_with_every_formulation_and_projection(formulation, projection):
    """Generalized-α: u, v and the recovered λ of a motion that does not start from rest."""
    steps = (5e-3, 2.5e-3)
    errors = thrown_errors(
        steps, formulation, GeneralizedAlpha(0.8), projection=projection, reported=RECOVERED
    )
    orders = np.log2(errors[0] / errors[1])
    assert np.all(orders[:2] > 1.85)
    assert np.all(orders[:2] < 2.15)
    assert orders[2] > 1.75
    assert np.all(errors[-1] < 3e-6)


@pytest.mark.parametrize(
    ("formulation", "integrator", "reported", "order"),
    [
        # With BDF2 a change of velocities by M⁻¹Gμ in every step is worth 3μ/2h.
        *(("index-3", of, NEWTON, 1) for of in (DAMPED, HHT(0.1), BDF2())),
        *(("index-3", of, TOTAL, 2) for of in (DAMPED, HHT(0.1), BDF2())),
        # What the projection does is then O(h³) or rounding.
        ("index-2", TRAPEZOIDAL, NEWTON, 2),
        ("index-2", DAMPED, TOTAL, 2),
        ("ggl", TRAPEZOIDAL, TOTAL, 2),
        ("ggl", DAMPED, NEWTON, 2),
    ],
)
def test_orders_of_lambda_where_velocities_are_projected(formulation, integrator, reported, order):
    """Index 3: λ one, with what the projection did two; two where rates are in the system."""
    errors = thrown_errors(
        (2.5e-3, 1.25e-3), formulation, integrator, projection="velocity", reported=reported
    )[:, 2]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


#: Relative error of λ of Andrews at t = 0.03 with h = 1e-5, as measured independently, and
#: drift: largest |Φ| and |Gᵀv| until then; None where it is rounding, or not of order 2.
ANDREWS = {
    "index-3": (None, None, 9.9e-7),
    "index-2": (1.2e-5, 8.0e-10, None),
    "index-1": (7.0e-6, 1.5e-9, 9.8e-7),
    "baumgarte rate=1000": (3.1e-5, 9.3e-10, 9.8e-7),
    "baumgarte rate_h=1": (1.3e-5, 2.0e-11, 9.9e-7),
    "ggl": (7.4e-6, None, None),
}
ROUNDING = (1e-18, 3e-16)


@pytest.mark.parametrize("formulation", ANDREWS)
def test_drift(formulation):
    """What stands in the system is met to rounding; the rest drifts like h², Φ of c/h like h³."""
    subject, found = subject_of("andrews"), []
    index_1 = Index1(subject)
    for h in (2e-5, 1e-5):
        march = March(subject, formulated(formulation, h=h, integrator=DAMPED))
        steps, sizes = round(0.03 / h), []
        for stretch in march.stretches(steps, looks=range(1, steps + 1, 10)):
            for u, v in stretch.record.fields[:, :2]:
                phi, rate = subject.constraint_values(0.0, u), index_1.rate(0.0, u, v)
                sizes.append([np.abs(phi).max(), np.abs(rate).max()])
        found.append(np.max(sizes, axis=0))
    of_lambda, *of_constraints = ANDREWS[formulation]
    if of_lambda:
        right = andrews_at_the_end()
        off = np.abs(march.multipliers - right).max() / np.abs(right).max()
        assert off == pytest.approx(of_lambda, rel=0.08)
    for k, expected in enumerate(of_constraints):
        if expected is None:
            assert found[1][k] < ROUNDING[k]
        else:
            assert found[1][k] == pytest.approx(expected, rel=0.1)
            order = 3 if formulation == "baumgarte rate_h=1" and k == 0 else 2
            assert np.log2(found[0][k] / found[1][k]) == pytest.approx(order, abs=0.2)


def test_the_augmented_lagrangian_needs_a_penalty_that_grows():
    """Factor 10: fewer iterations as h falls; the same penalty at every h: ever more."""
    subject, counts = subject_of("andrews"), {}
    first = March(subject, formulated("augmented-lagrangian factor=10", h=1e-4))
    penalty = first.system.constraining.penalty
    for h in (1e-4, 1e-5):
        for label in ("augmented-lagrangian factor=10", f"augmented-lagrangian penalty={penalty}"):
            march = March(subject, formulated(label, "a-lambda", h, DAMPED, iteration_cap=100))
            taken = march.advance(round(0.003 / h)).iterations
            counts[label.split()[1].split("=")[0], h] = np.median(np.abs(taken))
    assert counts["factor", 1e-4] == counts["penalty", 1e-4] <= 14
    assert counts["factor", 1e-5] < counts["factor", 1e-4]
    assert counts["penalty", 1e-5] > 60
    error = andrews_error("augmented-lagrangian", "a-lambda", 1e-5, DAMPED)
    assert error == pytest.approx(1.26e-5, rel=0.05)


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
