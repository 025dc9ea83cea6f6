"""Verdicts on series: each rule, and a series that must not slip through it."""

import re

import numpy as np
import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from newmark_cli import problem
from newmark_cli.report.verdicts import (
    INCOMPLETE,
    LEAST,
    MISS,
    NOT_ASYMPTOTIC,
    NOT_CONVERGING,
    PASS,
    SHOWN,
    TOO_FEW,
    Evidence,
    judge,
    local_orders,
)
from newmark_cli.study.motion import amplification

NAN = float("nan")


def evidence(values, h=None, kind="truncation", expected=2.0, tolerance=0.2, **rest):
    """A run over one second, a decade between step sizes unless they are given."""
    values = np.array(values, float)
    h = 10.0 ** -np.arange(2, 2 + len(values)) if h is None else np.array(h)
    return Evidence(
        h, values, 1 / h, kind, expected=expected, tolerance=tolerance, **rest
    )  # fmt: skip


def words(given):
    found = judge(given)
    return found.verdict, found.reason


def require(given, verdict, reason):
    """The verdict is this, and the reason matches that."""
    found = judge(given)
    assert found.verdict == verdict
    assert re.fullmatch(reason, found.reason)


# -- errors -------------------------------------------------------------------------------------


def test_local_orders():
    """Exponents between successive points; none next to a zero."""
    h = np.array([1e-1, 1e-2, 1e-3, 1e-4])
    assert local_orders(h, h**3) == pytest.approx([3, 3, 3])
    np.testing.assert_equal(np.isnan(local_orders(h, np.array([1, 0, 1, 1]))), [True, True, False])


def test_an_order_and_then_the_floor_of_rounding():
    """The fit is for the middle; the tail is explained, not fitted."""
    found = judge(evidence([2.4e-5, 2.4e-7, 2.4e-9, 8.3e-10]))
    assert found.verdict == PASS
    assert found.fit.slope == pytest.approx(2)
    assert found.fitted.tolist() == [True, True, True, False]
    assert found.reason == "rounding rules below h = 0.0001"


GARBAGE = {"values": [0.75, 1.9, 1.15], "h": [1e-3, 3e-4, 1e-4]}
LOST = "at h = 0.0001 it is 1.1 times as large as what it is an error of"


@each("said, given, verdict, reason", [
    # It converges to something else.
    ("a floor far above rounding is no floor",
     evidence([2.4e-3, 2.4e-5, 2.4e-7, 2.3e-6, 2.2e-6], quantity="u"),
     NOT_CONVERGING, "stalls at 2.2e-06, where rounding may reach .*"),
    ("undamped, an alternation grows as h falls; this one does not",
     evidence([2.4e-3, 2.4e-5, 2.4e-7, 2.3e-3, 2.2e-3], damped=False), NOT_CONVERGING, ".*"),
    # The errors that were once dropped but for one, so that nothing was left to judge.
    ("garbage is not green", evidence(**GARBAGE), NOT_CONVERGING, LOST),
    ("nor where nothing is predicted", evidence(**GARBAGE, expected=NAN), NOT_CONVERGING, LOST),
    ("it grows while h falls", evidence([1e-3, 2e-3, 4e-3]), NOT_CONVERGING, ".*"),
    ("predicted or not", evidence([1e-3, 2e-3, 4e-3], expected=NAN), NOT_CONVERGING, ".*"),
    ("at the level of rounding it may do what it likes",
     evidence([1e-15, 2e-15, 4e-15], expected=NAN), SHOWN, ".*"),
    ("of an error above its size at large h, it counts where it goes",
     evidence([197, 2.16, 0.0216]), PASS, ".*"),
    ("another order is a miss",
     evidence([1e-2, 1e-3, 1e-4]), MISS, "order 1 over h = 0.01 … 0.0001"),
    ("also with a floor behind it", evidence([1e-2, 1e-3, 1e-4, 1e-5]), MISS, ".*"),
    ("three points of order 2 do not hide what follows",
     evidence([1e-1, 1e-3, 1e-5, 1e-6, 1e-7], quantity="u"), MISS, ".*"),
    # It falls, and the local orders go their way to the prediction.
    ("coarse steps are not asymptotic",
     evidence([5e-2, 2e-2, 1e-3, 2e-5], h=[1e-1, 5e-2, 1e-2, 2e-3]), NOT_ASYMPTOTIC, ".*"),
    ("nothing can be said of rounding from the start",
     evidence([1e-15, 3e-15, 2e-15]), TOO_FEW, ".*"),
    ("two points fit any line", evidence([1e-4, 1e-6]), TOO_FEW, ".*"),
    ("so do two clean ones before rounding",
     evidence([1.5e-6, 1.5e-8, 8e-10], h=[1e-3, 1e-4, 1e-5]), TOO_FEW, ".*"),
    # A reference that could not be had leaves an empty error.
    ("no value is incomplete", evidence([NAN, NAN, NAN]), INCOMPLETE, ".*"),
    ("iterations and histories are shown",
     evidence([1, 2, 3], kind="determined", expected=NAN), SHOWN, ".*"),
])  # fmt: skip
def test_verdicts_on_errors(said, given, verdict, reason):
    """The word, and the reason where there is one to give."""
    require(given, verdict, reason)


def test_an_alternation_that_rounding_feeds():
    """Without damping it carries rounding far, and it grows as h falls."""
    values = [3.6e-3, 3.6e-5, 3.6e-7, 4.2e-7, 4.2e-5]
    verdict, reason = words(evidence(values, damped=False))
    assert verdict == PASS
    assert "an alternation that is not damped" in reason
    assert words(evidence(values, damped=True))[0] == NOT_CONVERGING
    # A solution that is lost is lost, whatever fed it.
    assert words(evidence([*values[:4], 0.8], damped=False))[0] == NOT_CONVERGING


def test_multipliers_that_alternate_have_their_reason():
    """The trapezoidal rule, wrong by truncation at every h; with damping the reason is another."""
    values = [2.135, 2.135, 2.121]
    for damped in (False, True):
        verdict, reason = words(
            evidence(values, expected=NAN, quantity="lambda", damped=damped)
        )  # fmt: skip
        assert verdict == NOT_CONVERGING
        assert ("does not damp multipliers that alternate" in reason) == (not damped)


def test_a_head_is_left_out():
    """Three step sizes that show the order are enough."""
    found = judge(evidence([0.089, 8.7e-5, 8.7e-7, 8.7e-9]))
    assert (found.verdict, found.reason) == (PASS, "order shows from h = 0.001")
    assert found.fitted.tolist() == [False, True, True, True]


@given(
    st.floats(1, 3), st.floats(-6, -1), st.integers(LEAST, 7),
    st.lists(st.floats(-0.04, 0.04), min_size=7, max_size=7),
)  # fmt: skip
def test_a_clean_power_passes(order, size, points, noise):
    """Any order that is the predicted one, with a few per cent of disturbance; and no other."""
    h = 10.0 ** -np.arange(1, 1 + points)
    values = 10**size * (h / h[0]) ** order * np.exp(noise[:points])
    values = np.maximum(values, 1e-300)
    series = Evidence(h, values, 1 / h, "truncation", expected=order, tolerance=0.2)
    above = values > series.rounding
    if above[:LEAST].all():
        assert judge(series).verdict == PASS
        other = Evidence(h, values, 1 / h, "truncation", expected=order + 1, tolerance=0.2)
        assert judge(other).verdict != PASS


# -- corrections --------------------------------------------------------------------------------


def rounding(values, expected, **rest):
    return evidence(values, kind="rounding", expected=expected, tolerance=0.15, **rest)


@each("said, given, verdict, reason", [
    # As the pendulum's corrections do.
    ("scatter about an order passes", rounding([5e-9, 4e-7, 6e-5, 5e-3], -2.0), PASS, ".*"),
    ("flat is no order −2", rounding([1e-9, 1.1e-9, 0.9e-9, 1e-9], -2.0), MISS, ".*"),
    ("nor is −2.6", rounding([1e-12, 4e-10, 1.6e-7, 6e-5], -2.0), MISS, ".*"),
    ("three points as predicted do not hide a fourth a thousand times too large",
     rounding([1e-12, 1e-10, 1e-8, 1e-3], -2.0, damped=False), MISS, ".*"),
    ("the multipliers' drift is a factor of a few",
     rounding([1e-12, 1e-10, 1e-8, 5e-6], -2.0, damped=False), PASS, ".*"),
    ("and there only where nothing damps it",
     rounding([1e-12, 1e-10, 1e-8, 5e-6], -2.0, damped=True), MISS, ".*"),
    # They have no logarithm, and are not silently dropped.
    ("zeros are counted", rounding([0, 0, 1e-16], 0.0), TOO_FEW, "2 of 3 values are exactly 0"),
    ("also where there are few",
     rounding([0, 1e-16, 1e-16, 1e-16], 0.0), PASS, "1 of 4 values are exactly 0"),
])  # fmt: skip
def test_verdicts_on_corrections(said, given, verdict, reason):
    """The word, and the reason where there is one to give."""
    require(given, verdict, reason)


def test_a_head_of_corrections_is_left_out():
    """A stiff spring is not resolved by the largest step."""
    found = judge(rounding([4.3e-16, 6.2e-17, 6.5e-17, 8.1e-17, 6.9e-17, 5.9e-17], 0.0,
                           h=[3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4]))  # fmt: skip
    assert (found.verdict, found.reason) == (PASS, "order shows from h = 0.01")


# -- condition numbers ----------------------------------------------------------------------------


def condition(orders, expected, **rest):
    values = 10.0 ** np.cumsum([0.0, *(-order for order in orders)])
    return evidence(values, kind="determined", expected=expected, tolerance=0.05, **rest)


@each("said, given, verdict", [
    ("a crossover is on its way", condition([-2.0, -2.1, -2.7], -3.0), NOT_ASYMPTOTIC),
    ("or known to theory as what coarse steps show",
     condition([-2.0, -2.0, -2.0], -3.0, coarse=(-3.0, -2.0)), NOT_ASYMPTOTIC),
    ("this is not what theory knows",
     condition([-2.5, -2.5, -2.5], -3.0, coarse=(-3.0, -2.0)), MISS),
    ("growing faster than predicted is never for lack of smaller steps",
     condition([-1.0, -1.0, -1.0], 0.0, coarse=(0.0, 1.0)), MISS),
    ("the multipliers drift in the matrix",
     condition([-2.0, -2.0, -2.34], -2.0, damped=False), PASS),
    ("only where nothing damps it", condition([-2.0, -2.0, -2.34], -2.0, damped=True), MISS),
    ("and only by a little", condition([-2.0, -2.0, -4.0], -2.0, damped=False), MISS),
])  # fmt: skip
def test_verdicts_on_condition_numbers(said, given, verdict):
    """The word."""
    require(given, verdict, ".*")


def test_a_crossover_at_coarse_h():
    """(u, v, λ) without scaling: the last two local orders are the predicted one."""
    found = judge(condition([-2.65, -2.989, -2.9997], -3.0))
    assert (found.verdict, found.reason) == (PASS, "order shows from h = 0.001")


def test_multipliers_whose_mechanism_amplifies_rounding():
    """A short run has few steps, and yet λ may be as coarse as the mechanism makes it."""
    values, h = [1.2e-6, 1.3e-7, 4.1e-7, 2.9e-6], [2e-3, 6.7e-4, 1e-4, 5e-5]
    errors = [4.8e-6, *values]
    given = {"values": errors, "h": [4e-3, *h], "quantity": "lambda"}
    # h²-law through the first three; 2.9e-6 is 600 roundoffs of 0.054 s² over h².
    assert words(evidence(**given, amplification=0.0))[0] == PASS
    short = Evidence(**{**vars(evidence(**given)), "steps": 0.1 / np.array([4e-3, *h])})
    assert words(short)[0] == NOT_CONVERGING
    level = 600 * 2.0**-52 * 0.06 / np.array(h) ** 2
    assert level[-1] > 2.9e-6 > 0.8 * level[-1] * 0.05 / 0.06
    assert words(Evidence(**{**vars(short), "amplification": 0.06}))[0] == PASS
    assert words(Evidence(**{**vars(short), "amplification": 0.04}))[0] == NOT_CONVERGING
    # Velocities are not multipliers, and compensated evaluation has another floor.
    for other in ({"quantity": "v"}, {"compensated": True}):
        given = Evidence(**{**vars(short), "amplification": 0.06, **other})
        assert words(given)[0] == NOT_CONVERGING


def test_amplification_of_a_pendulum():
    """Rounding of a bar of length 1 is pulled back by m/h², next to λ = m g cos φ."""
    pendulum, u, v = problem("pendulum"), np.array([0.6, -0.8]), np.zeros(2)
    found = amplification(pendulum, [(0.0, u, v), (0.0, np.array([1.0, 0.0]), v)])
    assert found == {"lambda": pytest.approx(1 / 0.8, rel=1e-2)}
    # At rest in the horizontal there is no λ to compare with.
    assert amplification(pendulum, [(0.0, np.array([1.0, 0.0]), v)]) == {}


def test_a_block_that_a_problem_lacks_is_judged_by_its_order_first():
    """What is above rounding of 0 must have the order; what is not is nothing."""
    h = 10.0 ** -np.arange(3, 7)
    rounding = 1e-15 * h**2 * np.array([1, 3, 0.4, 2])
    of_block = {"h": h, "kind": "determined", "expected": 2, "tolerance": 0.05, "lacking": 2.0}
    verdict, reason = words(evidence(rounding, **of_block))
    assert (verdict, reason) == (PASS, "rounding of 0: the problem lacks this block")
    lost = 1e-9 * h**2 * np.array([1, 1, 3, 60])
    assert words(evidence(lost, **of_block))[0] == MISS
    assert words(evidence(1e-15 * h**2, **of_block)) == (PASS, "")


def test_a_bound_that_a_few_steps_come_close_to():
    """Each step is within the bound; the rms of all is steeper while ever more come close."""
    h = np.array([1e-3, 3e-4, 1e-4, 3e-5])
    of_bound = {"h": h, "kind": "rounding", "expected": -2, "tolerance": 0.15, "bound": "rounds"}
    rms, median = 1e-22 * h**-3, 1e-17 / h
    verdict, reason = words(evidence(rms, **of_bound, typical=median))
    assert verdict == NOT_ASYMPTOTIC
    assert reason == "a few steps rule; the median has order −1.00"
    assert words(evidence(rms, **of_bound, typical=rms / 3))[0] == MISS
    assert words(evidence(rms, **of_bound))[0] == MISS
    assert words(evidence(rms, **{**of_bound, "bound": ""}, typical=median))[0] == MISS
