"""Verdicts on series: the rule, and series that must not slip through it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from newmark_cli.report.judging.fits import power_law
from newmark_cli.report.judging.verdicts import (
    FAILING,
    INCOMPLETE,
    MISS,
    NOT_CONVERGING,
    PASS,
    SHOWN,
    UNDECIDED,
    Evidence,
    judge,
    local_orders,
)

NAN = float("nan")
#: Rounding of an error that is far below everything else.
TINY = 1e-15


def evidence(values, h=None, rounding=TINY, kind="truncation", expected=2.0, **rest):
    """A series, a decade between step sizes unless they are given."""
    values = np.array(values, float)
    h = 10.0 ** -np.arange(2, 2 + len(values)) if h is None else np.array(h)
    with np.errstate(divide="ignore", invalid="ignore"):
        unsure = np.broadcast_to(rounding, values.shape) / values
    unsure[(values == 0) & (np.broadcast_to(rounding, values.shape) == 0)] = 0.0
    rest = {"tolerance": 0.2} | rest
    rest = {"steps": 1 / h} | rest
    return Evidence(h, values, unsure, kind=kind, expected=expected, **rest)


def require(given, verdict, reason=".*"):
    """The verdict is this, and the reason matches that."""
    found = judge(given)
    assert found.verdict == verdict, (found.fit, found.reason)
    assert re.fullmatch(reason, found.reason)


def test_local_orders():
    """Exponents between successive points; none next to a zero."""
    h = np.array([1e-1, 1e-2, 1e-3, 1e-4])
    assert local_orders(h, h**3) == pytest.approx([3, 3, 3])
    np.testing.assert_equal(np.isnan(local_orders(h, np.array([1, 0, 1, 1]))), [True, True, False])


@pytest.mark.parametrize(("squares", "straight"), [(2.0, True), (3.9, True), (4.1, False)])
def test_points_off_a_line_by_more_than_they_are_known(squares, straight):
    """Of three points with a sum of squares over their uncertainties; 4 is χ² at 95 %."""
    h, unsure = np.array([1e-2, 1e-3, 1e-4]), 0.1
    bend = np.sqrt(squares * (unsure**2 + 0.02**2) / 6) * np.array([1, -2, 1])
    fit = power_law(h, h**2 * np.exp(bend), np.full(3, unsure))
    assert fit.straight == straight
    assert fit.margin / fit.stderr == pytest.approx(2.0 if straight else 13.97)


@pytest.mark.parametrize(("slope", "verdict"), [(1.6, UNDECIDED), (2.6, PASS)])
def test_a_bound_needs_its_whole_interval(slope, verdict):
    """Slopes known to ± 0.25: one that may be the bound does not show it."""
    values = np.array([1e-2, 1e-3, 1e-4]) ** slope
    given = evidence(values, rounding=0.4 * values, kind="rounding", bound="of differences")
    require(given, verdict, "at least order 2, a bound: .*" if verdict == PASS else ".*")


def test_an_order_between_a_head_and_rounding():
    """The fit is for three step sizes that show the order, and for no others."""
    values, rounding = [0.089, 2.4e-5, 2.4e-7, 2.4e-9, 8.3e-10], [0, 0, 0, 4e-11, 6e-10]
    found = judge(evidence(values, rounding=rounding))
    assert found.verdict == PASS
    assert found.fit.slope == pytest.approx(2)
    assert found.fitted.tolist() == [False, True, True, True, False]
    assert found.reason == "order shows from h = 0.001; rounding rules below h = 1e-05"


GARBAGE = {"values": [0.75, 1.9, 1.15], "h": [1e-3, 3e-4, 1e-4]}
HEAVY_TOP = {"values": [1.2e-2, 5.7e-4, 7.8e-6, 8.0e-6], "h": [2e-4, 1e-4, 5e-5, 2e-5]}


def scattered(values, expected, h=None, **rest):
    """Corrections, of which blocks of steps and the place between powers of two tell 0.2."""
    values = np.array(values, float)
    return evidence(
        values, h, 0.2 * values, kind="rounding", expected=expected, tolerance=0.15, **rest
    )


#: Step sizes over three decades.
H = np.array([1e-1, 1e-2, 1e-3, 1e-4])


def flat(*unsure):
    """Corrections of order 0 that should have order −2, each known to so much."""
    return replace(scattered(np.full(len(unsure), 1e-9), -2.0), uncertainty=np.array(unsure))


def condition(orders, expected, values=(), **rest):
    values = np.array(values or 10.0 ** np.cumsum([0.0, *(-order for order in orders)]))
    rest = {"tolerance": 0.05} | rest
    rest = {name: np.array(each) for name, each in rest.items()}
    return evidence(values, kind="determined", expected=expected, **rest)


@pytest.mark.parametrize(("said", "given", "verdict", "reason"), [
    ("it converges to something else",
     evidence([2.4e-3, 2.4e-5, 2.4e-7, 2.3e-6, 2.2e-6]), NOT_CONVERGING, "does not fall with h.*"),
    ("three points of order 2 do not hide that",
     evidence([2.4e-3, 2.4e-5, 2.4e-7, 2.3e-3, 2.2e-3]), NOT_CONVERGING, ".*"),
    ("garbage is not green", evidence(**GARBAGE), NOT_CONVERGING,
     "does not fall with h: 1.1 at h = 0.0001, which rounding changes by 1e-15; h may be too "
     "coarse"),
    ("nor where nothing is predicted", evidence(**GARBAGE, expected=NAN), NOT_CONVERGING, ".*"),
    ("it is if it is rounding", evidence(**GARBAGE, rounding=1.0, expected=NAN), SHOWN,
     "rounding rules at every h"),
    ("however small it is", evidence([1e-7, 2e-7, 4.5e-7]), NOT_CONVERGING, ".*"),
    ("where rounding grows nothing is said, however large it is",
     evidence([1e-4, 1e-2, 4.6e-2], rounding=[1e-4, 2e-2, 3e-2], expected=NAN), SHOWN, ".*"),
    ("of an error above its size at large h, it counts where it goes",
     evidence([197, 2.16, 0.0216]), PASS, ""),
    ("another order is a miss", evidence([1e-2, 1e-3, 1e-4]), MISS,
     r"slope 1 \(interval 0\.97 to 1\.03\) over h = 0.01 … 0.0001"),
    ("also with rounding behind it",
     evidence([1e-2, 1e-3, 1e-4, 1e-5], rounding=[0, 0, 0, 9e-6]), MISS,
     r"slope 1 \(interval 0\.97 to 1\.03\) over h = 0.01 … 0.0001; "
     "rounding rules below h = 0.0001"),
    ("also with order 2 before it", evidence([1e-1, 1e-3, 1e-5, 1e-6, 1e-7]), MISS, ".*"),
    ("half a decade of it is not enough", evidence([1e-2, 5e-3, 2e-3], h=[0.1, 0.05, 0.02]),
     UNDECIDED,
     "slope 1 .interval .* over h = 0.1 … 0.02, less than a decade: smaller h would decide"),
    ("a stall behind many points of order 2 is none of it",
     evidence([1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-9], rounding=1e-14), UNDECIDED, ".*"),
    ("errors that are not small have no order yet",
     evidence([0.9, 0.6, 0.4], h=[0.1, 0.05, 0.02]), UNDECIDED, "errors of 40% are not small.*"),
    ("orders are whole numbers: λ of a quick return with BDF2, from errors of 10 % on",
     evidence([0.11, 0.0234, 7.0e-3, 2.5e-3, 5.07e-4], h=[1e-2, 4e-3, 2e-3, 1e-3, 4e-4]),
     UNDECIDED, r"slope 1\.66 .interval 1\.62 to 1\.71.: the order still changes with h, .*"),
    ("1.3 is neither 1 nor 2", evidence(10.0 ** (-1.3 * np.arange(2, 6))), UNDECIDED,
     ".*the order still changes with h.*"),
    ("1.215 is 1, as it is known", evidence(10.0 ** (-1.215 * np.arange(2, 6))), MISS,
     r"slope 1\.2. .*"),
    ("a written order is held against any",
     evidence(10.0 ** (-1.3 * np.arange(2, 6)), written=True), MISS, r"slope 1\.3 .*"),
    ("coarse steps do not decide",
     evidence([5e-2, 2e-2, 1e-3, 2e-5], h=[1e-1, 5e-2, 1e-2, 2e-3]), UNDECIDED,
     "slope .*interval .*: the order still changes with h, smaller h would decide"),
    ("a higher order may be on its way to the predicted one",
     evidence([1e-2, 1e-5, 1e-8]), UNDECIDED,
     "falls faster than order 2, which shows at smaller h"),
    ("rounding from the start decides nothing",
     evidence([1e-15, 3e-15, 2e-15]), UNDECIDED,
     "0 usable step sizes, an order needs 3: larger h would decide; "
     "rounding rules at every h"),
    ("two points fit any line", evidence([1e-4, 1e-6]), UNDECIDED,
     "2 usable step sizes, an order needs 3: smaller h would decide"),
    ("so do two clean ones before rounding",
     evidence([1.5e-6, 1.5e-8, 8e-10], h=[1e-3, 1e-4, 1e-5], rounding=9e-10), UNDECIDED,
     "2 usable step sizes, .*"),
    ("an error that changes its sign is no order",
     evidence(**HEAVY_TOP), UNDECIDED, ".*"),
    ("where rounding may rule nothing is fitted, though it rules only further on",
     evidence([1e-2, 1e-4, 1e-6, 5e-7, 4e-7], rounding=[0, 0, 0, 1e-7, 3e-7]), PASS,
     "rounding may rule below h = 0.0001, rules below h = 1e-05"),
    ("multipliers that alternate from the start have no order yet",
     evidence([1e-2, 1e-3, 1e-4], steps=np.array([10, 100, 1000]), fading=0.9), UNDECIDED,
     r"λ still alternates from the start at h = 0\.01: .*"),
    ("a curve far from the order that theory predicts has none",
     evidence([1e-2, 1e-3, 3e-5], expected=5.0), UNDECIDED, ".*the order still changes with h.*"),
    ("but misses one that somebody has written", evidence([1e-2, 1e-3, 3e-5], expected=5.0,
     written=True), MISS, r"slope 1\.26 .*"),
    # A reference that could not be had leaves an empty error.
    ("no value is incomplete", evidence([NAN, NAN, NAN]), INCOMPLETE, ".*"),
    ("iterations and histories are shown",
     evidence([1, 2, 3], kind="determined", expected=NAN), SHOWN, ""),
    # Of corrections and condition numbers, which are no errors.
    # As the pendulum's corrections do.
    ("scatter about an order passes", scattered([5e-9, 4e-7, 6e-5, 5e-3], -2.0), PASS, ""),
    ("flat is no order −2", scattered([1e-9, 1.1e-9, 0.9e-9, 1e-9], -2.0), MISS, ".*"),
    ("but that is how rounding of stiff forces fades, which theory knows",
     scattered([3.4e-14, 4.2e-14, 1.5e-14, 2.9e-15, 3.4e-16, 7.2e-17], 0.0,
               h=[3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4], coarse=(2.0,)), UNDECIDED,
     "terms of order 2 rule until smaller h lets those of order 0 overtake"),
    ("and so far from the origin, where increments round u",
     replace(scattered([5.4e-15, 5.8e-16, 5.8e-17, 1.4e-17, 4.5e-18], 1.0,
                       h=[1e-2, 3e-3, 1e-3, 3e-4, 1e-4], coarse=(2.0,)),
             uncertainty=np.array([0.52, 0.37, 0.33, 0.45, 0.37])), UNDECIDED,
     "terms of order 2 rule until smaller h lets those of order 1 overtake"),
    ("and not how anything grows",
     scattered([1e-9, 1e-8, 1e-7, 1e-6], 0.0, coarse=(2.0,)), MISS, ".*"),
    ("or falls", scattered(H**2.4, 0.0, H, coarse=(2.0,)), MISS, ".*"),
    ("but by as much as two tolerances more on the way",
     scattered(H**2.2, 0.0, H, coarse=(2.0,)), UNDECIDED, "terms of order 2 rule .*"),
    ("of which there is none between equal orders",
     evidence(H**1.25, H, 0.01 * H**1.25, "rounding", 1.0, tolerance=0.15, coarse=(1.0,)), MISS,
     ".*"),
    ("a few steps that rule say nothing of most",
     replace(scattered([3.3e-16, 1.3e-14, 2.6e-13], -1.0, h=[1e-3, 1e-4, 1e-5]),
             uncertainty=np.array([0.22, 0.54, 0.27])), UNDECIDED,
     "a few steps rule: more steps would decide"),
    ("each step is within a bound, of which ever more come close to it",
     scattered([1e-13, 3.7e-12, 1e-10, 3.7e-9], -2.0, h=[1e-3, 3e-4, 1e-4, 3e-5], bound="rounds",
               typical=np.array([1e-14, 3.3e-14, 1e-13, 3.3e-13])), UNDECIDED,
     "a few steps rule; the median has order −1.00"),
    ("but not if their median is steeper than it, too",
     scattered([1e-13, 3.7e-12, 1e-10, 3.7e-9], -2.0, h=[1e-3, 3e-4, 1e-4, 3e-5], bound="rounds",
               typical=np.array([1e-14, 3.7e-13, 1e-11, 3.7e-10])), MISS, ".*"),
    ("from a quarter on", flat(0.2, 0.26, 0.2), UNDECIDED, "a few steps rule.*"),
    ("not below", flat(0.24, 0.24, 0.24), MISS, ".*"),
    ("nor where they are not among those fitted",
     replace(scattered([1e-5, 1e-9, 1e-9, 1e-9], -2.0), uncertainty=np.array([0.5, 0.2, 0.2, 0.2])),
     MISS, ".*"),
    ("nor is −2.6", scattered([1e-12, 4e-10, 1.6e-7, 6e-5], -2.0), MISS, ".*"),
    ("three points as predicted do not hide a fourth a thousand times too large",
     scattered([1e-12, 1e-10, 1e-8, 1e-3], -2.0), UNDECIDED, ".*the order still changes.*"),
    ("places between powers of two are no miss over half a decade",
     scattered([1.0, 4.4, 32.7], -2.0, h=[0.1, 0.05, 0.02]),
     UNDECIDED,
     r"slope −2\.17 \(interval −2\.52 to −1\.82\): h over 2 decades or more would decide"),
    # They have no logarithm, and are not silently dropped.
    ("zeros are counted", scattered([0, 0, 1e-16], 0.0), UNDECIDED,
     ".*; 2 of 3 values are exactly 0"),
    ("also where there are few",
     scattered([0, 1e-16, 1e-16, 1e-16], 0.0), PASS, "1 of 4 values are exactly 0"),
    ("a head of corrections is left out, as the largest step does not resolve a stiff spring",
     scattered([9.3e-15, 6.2e-17, 6.5e-17, 8.1e-17, 6.9e-17, 5.9e-17], 0.0,
               h=[3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4]), PASS, "order shows from h = 0.01"),
    ("a crossover is on its way", condition([-2.0, -2.1, -2.7], -3.0), UNDECIDED, ".*"),
    ("or known to theory as what coarse steps show",
     condition([-2.0, -2.0, -2.0], -3.0, coarse=(-3.0, -2.0)), UNDECIDED,
     "terms of order −2 rule until smaller h lets those of order −3 overtake"),
    ("this is not what theory knows",
     condition([-2.5, -2.5, -2.5], -3.0, coarse=(-3.0, -2.0)), MISS, ".*"),
    ("growing faster than predicted is never for lack of smaller steps",
     condition([-1.0, -1.0, -1.0], 0.0, coarse=(-1.0, 0.0, 1.0)), MISS, ".*"),
    *[("coarse marches pass other states: medians of a double pendulum and of a slider-crank",
       condition([], order, values=values, typical=values, largest=largest), UNDECIDED,
       f"varies by a factor of {factor} along a run: smaller h would decide")
      for order, values, largest, factor in [
          (-2.0, [2614, 201811, 16149646], [75075, 5.6e6, 2.2e7], 29),
          (-4.0, [7.1e7, 4.04e11, 2.36e15], [3.7e8, 1.78e13, 7e15], 44)]],
    ("which must be enough for what they differ by",
     condition([], -2.0, values=[2614, 201811, 16149646], typical=[2614, 201811, 16149646],
               largest=[2875, 221992, 17764610]), MISS, ".*"),
    ("multipliers that drift in the matrix decide nothing",
     condition([-2.0, -2.0, -2.34], -2.0), UNDECIDED, ".*"),
    ("(u, v, λ) without scaling: the last two local orders are the predicted one",
     condition([-2.65, -2.989, -2.9997], -3.0), PASS, "order shows from h = 0.001"),
])  # fmt: skip
def test_verdicts(said, given, verdict, reason):
    require(given, verdict, reason)


@pytest.mark.parametrize(("values", "stalls"), [
    ([1, 10**-0.05, 10**-0.1], True), ([1, 10**-0.2, 10**-0.4], False),
    ([1e-3, 1, 0.4], True), ([1e-3, 1, 0.2], False),
])  # fmt: skip
def test_what_does_not_fall(values, stalls):
    """Less than a tenth of an order from the first, or half an order from the largest."""
    assert (judge(evidence(values)).verdict == NOT_CONVERGING) == stalls


def test_what_is_exactly_zero():
    """No other step size would decide it."""
    require(evidence([0.0, 0.0, 0.0]), UNDECIDED, "3 of 3 values are exactly 0")


def test_what_speaks_against_a_series_is_far_above_its_rounding():
    """Twins tell rounding to a factor of 10: a tail within it condemns nobody."""
    h, values = [1e-4, 3e-5, 1e-5, 3e-6, 1e-6], [3.4e-2, 3.59e-3, 3.83e-4, 1e-3, 4.2e-3]
    near, far = (part * np.array([0, 2e-5, 1e-4, 1e-3, 4e-3]) for part in (0.2, 1e-5))
    require(evidence(values, h, near), PASS, "rounding may rule below h = 1e-05")
    require(evidence(values, h, far), NOT_CONVERGING)


def test_rounding_that_is_alike_in_all_steps():
    """Twins do not see it, and in 1e4 steps it is up to a hundred times what they see."""
    values, rounding = [2e-4, 2e-6, 2e-8, 4e-8], [1e-14, 1e-13, 1e-12, 1e-9]
    require(evidence(values, rounding=rounding), PASS, "rounding may rule below h = 0.0001")
    short = {"steps": np.full(4, 100.0)}
    require(evidence(values, rounding=rounding, **short), UNDECIDED)
    rising = [2e-4, 2e-6, 2e-6, 4e-6]
    require(evidence(rising, rounding=rounding, **short), NOT_CONVERGING)
    require(evidence(rising, rounding=1e-15, **short), NOT_CONVERGING)


def test_without_twins_nothing_is_condemned():
    """A CSV of an older version, or of `twins: 0`, does not say what rounding is."""
    require(evidence([1e-2, 1e-4, 1e-6], rounding=NAN), PASS)
    for values in ([1e-2, 1e-3, 1e-4], [1e-3, 2e-3, 4e-3]):
        require(evidence(values, rounding=NAN), UNDECIDED, ".*its rounding was not measured.*")
    require(evidence([1e-3, 2e-3, 4e-3], rounding=NAN, expected=NAN), SHOWN)


def test_multipliers_that_alternate_have_their_reason():
    """The trapezoidal rule, wrong by truncation at every h; with damping the reason is another."""
    for undamped in (False, True):
        found = judge(evidence([2.135, 2.135, 2.121], expected=NAN, undamped=undamped))
        assert found.verdict == NOT_CONVERGING
        assert ("does not damp multipliers that alternate" in found.reason) == undamped


def test_what_ought_to_be_rounding():
    """It is, within what twins tell of it; what is far more is a miss."""
    exact = {"expected": NAN, "exact": True}
    require(evidence([2e-16, 3e-16, 2e-16], rounding=1e-16, **exact), PASS, "rounding only: .*")
    require(evidence([0, 0, 0], rounding=0, **exact), PASS)
    require(evidence([2e-16, 3e-16, 2e-14], rounding=1e-16, **exact), MISS, "more than rounding.*")
    require(evidence([2e-16, 3e-16, 2e-16], rounding=NAN, **exact), UNDECIDED)
    singular = evidence([2e-16, 3e-16, 2e-14], rounding=1e-16, irregular="singular", **exact)
    require(singular, UNDECIDED, "more than rounding.*; singular")


LISTS = st.sampled_from(
    [(0.1, 0.05, 0.02), (1e-2, 5e-3, 2e-3), (1e-1, 1e-2, 1e-3), (1e-3, 3e-4, 1e-4, 3e-5, 1e-5)]
)


@given(st.sampled_from([1.0, 2.0]), st.floats(-6, -1), LISTS, st.data())
def test_a_clean_power_passes(order, size, h, data):
    """Any order that is the predicted one, with a few per cent of disturbance; and no other."""
    h = np.array(h)
    noise = data.draw(st.lists(st.floats(-0.03, 0.03), min_size=len(h), max_size=len(h)))
    values = 10**size * (h / h[0]) ** order * np.exp(noise)
    assert judge(evidence(values, h, expected=order)).verdict == PASS
    wrong = MISS if h[0] / h[-1] > 9 else UNDECIDED
    assert judge(evidence(values, h, expected=order + 1)).verdict == wrong
    assert judge(evidence(values, h, expected=order - 1)).verdict == UNDECIDED


@given(st.floats(-8, -2), st.floats(-14, -2), LISTS, st.integers(0, 10**6))
def test_rounding_never_condemns(size, level, h, seed):
    """Whatever share of a right series is rounding, and however its measure is off by a factor."""
    h, random = np.array(h), np.random.default_rng(seed)
    rounding = 10**level * (h / h[-1]) ** -2
    values = np.abs(10**size * (h / h[0]) ** 2 + rounding * random.normal(size=len(h)))
    # Three twins have three degrees of freedom.
    told = rounding * np.sqrt(random.chisquare(3, len(h)) / 3)
    for expected in (2.0, NAN):
        assert judge(evidence(values, h, told, expected=expected)).verdict not in FAILING


@given(st.lists(st.floats(-12, 0), min_size=3, max_size=6), st.integers(-6, 6))
def test_units_of_time_do_not_matter(logs, power):
    """Step sizes in another unit: powers of two, which are exact.  Errors have none."""
    values = 10 ** np.array(logs)
    given = evidence(values, rounding=1e-3 * values)
    scaled = replace(given, h=2.0**power * given.h)
    assert judge(given).verdict == judge(scaled).verdict


def test_a_block_that_a_problem_lacks():
    """It is rounding of 0, which neighbouring states tell; what is above must have the order."""
    h = 10.0 ** -np.arange(3, 7)
    of_block = {"h": h, "kind": "determined", "expected": 2, "tolerance": 0.05}
    zero = 1e-15 * h**2 * np.array([1, 3, 0.4, 2])
    require(evidence(zero, rounding=zero, **of_block), UNDECIDED,
            "nothing but rounding: the problem may lack it; rounding rules at every h")  # fmt: skip
    require(evidence(1e-9 * h, rounding=1e-3 * h, **of_block), UNDECIDED)
    require(evidence(1e-9 * h, rounding=1e-18 * h, **of_block), MISS)
    require(evidence(1e-9 * h**2, rounding=1e-18 * h**2, **of_block), PASS)


@pytest.mark.parametrize(
    ("values", "verdict", "fitted"),
    [
        ([2.0, 1e-2, 1e-4, 1e-6], SHOWN, [False, True, True, True]),
        ([1e-2, 1e-4], UNDECIDED, [True, True]),
        ([1e-2, 1e-2, 1e-2], NOT_CONVERGING, [True, True, True]),
    ],
)
def test_a_series_held_against_any_order_must_have_one(values, verdict, fitted):
    """The coarsest step sizes may be left out, as where an order is predicted."""
    found = judge(evidence(values, expected=NAN, tolerance=NAN, written=True))
    assert (found.verdict, found.fitted.tolist()) == (verdict, fitted)
    if verdict == SHOWN:
        assert found.fit.slope == pytest.approx(2.0)
