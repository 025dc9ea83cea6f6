"""Statistics, physical units, sampling and fits: pure functions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from marching import scheme_of
from scipy.stats import chi2
from scipy.stats import t as student

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.scaling import VARIANTS
from newmark_cli.newmark.statistics import statistics
from newmark_cli.report.judging import fits
from newmark_cli.report.judging.fits import power_law
from newmark_cli.study.observers import corrections, sample_steps

norms = arrays(float, st.integers(1, 40), elements=st.floats(0, 1e300))


@given(norms)
def test_statistics(values):
    """rms, max, median, last and zeros of any non-negative values, without overflow."""
    found = statistics(values)
    assert found.max == values.max()
    assert found.median == np.median(values)
    assert found.last == values[-1]
    assert found.zeros == np.count_nonzero(values == 0)
    exact = np.sqrt(np.mean(values.astype(np.longdouble) ** 2))
    assert found.rms == pytest.approx(float(exact), rel=1e-12)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", FORMS)
def test_physical_corrections(name, variant):
    """Physical = D_R times scaled; eliminated fields by the weights of the form."""
    form, scheme = FORMS[name], scheme_of(name, variant, 1e-3)
    random = np.random.default_rng(3)
    directions = [random.normal(size=5) for _ in form.unknowns]
    recorded = np.array([[np.linalg.norm(d) for d in directions]])
    found = {(m.quantity, m.measure): m for m in corrections(scheme, recorded, np.array([4]))}
    deltas = [factor * d for factor, d in zip(scheme.right, directions, strict=True)]
    fields = np.einsum("xk,ki->xi", scheme.elimination.weights, np.array(deltas[:-1]))
    for field, delta in zip((*FIELDS, "lambda"), [*fields, deltas[-1]], strict=True):
        measurement = found[field, "physical_correction"]
        assert measurement.statistics.last == pytest.approx(np.linalg.norm(delta), rel=1e-13)
        assert measurement.role == ("recovered" if field in form.eliminated else "primary")
    assert {q for q, measure in found if measure == "correction"} == set(form.unknowns)


def test_steps_that_did_not_converge_are_left_out():
    """A negative count excludes the step from every statistic."""
    scheme = scheme_of("u-lambda", "none", 1e-3)
    recorded = np.array([[1.0, 2.0], [100.0, 200.0], [3.0, 0.0]])
    found = corrections(scheme, recorded, np.array([3, -50, 4]))
    assert found[0].statistics.max == 3.0
    assert found[1].statistics.zeros == 1


@given(st.integers(0, 10**7), st.integers(1, 100))
def test_sample_steps(steps, samples):
    """Distinct, in range, evenly spread, the last step among them."""
    found = sample_steps(steps, samples)
    assert len(found) == min(steps, samples)
    if steps:
        assert found[-1] == steps
        assert found[0] >= 1
        gaps = np.diff(np.concatenate([[0], found]))
        assert gaps.max() - gaps.min() <= 2


@given(st.floats(-6, 6), st.floats(-20, 20), st.integers(3, 12), st.integers(0, 2**32 - 1))
def test_fit_is_ordinary_least_squares(slope, intercept, points, seed):
    """Slope and standard error against SciPy's regression."""
    from scipy.stats import linregress  # which takes a second to import

    random = np.random.default_rng(seed)
    h = 10 ** np.sort(random.uniform(-8, 0, points))
    values = 10 ** (intercept + slope * np.log10(h) + 0.1 * random.normal(size=points))
    found = power_law(h, values)
    expected = linregress(np.log10(h), np.log10(values))
    assert found.slope == pytest.approx(expected.slope, rel=1e-7, abs=1e-9)
    assert found.stderr == pytest.approx(expected.stderr, rel=1e-6, abs=1e-9)
    assert found.points == points


def test_fit_leaves_out_what_has_no_logarithm():
    """Zeros and missing values are not points."""
    h = np.array([1e-1, 1e-2, 1e-3, 1e-4])
    found = power_law(h, np.array([1e-1, 0.0, np.nan, 1e-4]))
    assert found.points == 2
    assert found.slope == pytest.approx(1.0)
    assert np.isnan(found.stderr)
    assert np.isnan(power_law(h[:1], h[:1]).slope)


def test_intervals_of_fits():
    """As a textbook's weighted least squares; Student's quantiles where scatter sets the error."""
    for freedoms in range(1, 12):
        inside, of_t = (table[min(freedoms, 10) - 1] for table in (fits._SQUARES, fits._STUDENT))
        least = min(freedoms, 10)
        assert inside == pytest.approx(chi2.ppf(0.9545, least) / least, abs=0.006)
        assert of_t == pytest.approx(student.ppf(0.97725, least), abs=0.006)
    h, unsure = np.array([1e-2, 3e-3, 1e-3, 1e-4]), np.array([0.1, 0.2, 0.1, 0.3])
    values = 3 * h**2 * np.exp([0.1, -0.1, 0.05, 0.0])
    found = power_law(h, values, unsure)
    known = np.hypot(unsure, 0.02)
    line, cov = np.polyfit(np.log(h), np.log(values), 1, w=1 / known, cov="unscaled")
    assert found.slope == pytest.approx(line[0])
    assert (found.stderr, found.margin) == pytest.approx(np.sqrt(cov[0, 0]) * np.array([1, 2]))
    assert found.straight
    off = power_law(h, values * [1, 3, 1 / 3, 1], unsure)
    _, cov = np.polyfit(np.log(h), np.log(values * [1, 3, 1 / 3, 1]), 1, w=1 / known, cov=True)
    assert not off.straight
    assert off.stderr == pytest.approx(np.sqrt(cov[0, 0]))
    assert off.margin == pytest.approx(4.53 * off.stderr)
