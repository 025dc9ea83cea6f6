"""Dense linear algebra of our own: against exact arithmetic, and the order of its sums."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from marching import EPS
from mpmath import mp, mpf

from newmark_cli.problems import algebra

NUMBERS = st.floats(-1e100, 1e100)


def uneven(shape, seed, decades=24):
    """A random matrix whose rows and columns are of very different size."""
    random = np.random.default_rng(seed)
    rows, columns = (10.0 ** random.uniform(-decades / 4, decades / 4, n) for n in shape)
    return rows[:, None] * random.normal(size=shape) * columns


@given(st.data(), st.integers(0, 4), st.integers(1, 4), st.integers(0, 4))
def test_products_add_from_the_first_term_to_the_last(data, k, n, count):
    """As a loop of Python's does, to the bit; of vectors, too."""
    first = data.draw(arrays.arrays(float, (k, n), elements=NUMBERS))
    second = data.draw(arrays.arrays(float, (n, count), elements=NUMBERS))
    expected = np.zeros((k, count))
    for i, j, term in np.ndindex(k, count, n):
        expected[i, j] += first[i, term] * second[term, j]
    np.testing.assert_array_equal(algebra.product(first, second), expected)
    for j in range(count):
        np.testing.assert_array_equal(algebra.product(first, second[:, j]), expected[:, j])
    for i in range(k):
        np.testing.assert_array_equal(algebra.product(first[i], second), expected[i])
    single = np.ones((2, 2), np.float32)
    assert algebra.product(single, single).dtype == np.float32


@given(arrays.arrays(float, st.integers(0, 20), elements=NUMBERS))
def test_norms(vector):
    """Exactly the root of the sum, but for n/2 + 1 roundings; squares may underflow."""
    squares = sum((Fraction(x) ** 2 for x in vector.tolist()), Fraction(0))
    with mp.workdps(40):
        expected = mp.sqrt(mpf(squares.numerator) / squares.denominator)
        rounding = (len(vector) / 2 + 1) * EPS * expected
        assert abs(algebra.norm(vector) - expected) <= max(rounding, 1e-150)


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (7, 4)])
def test_spectral_norms(shape):
    """The largest singular value, whatever the sizes of rows and columns."""
    for seed in range(2):
        matrix = uneven(shape, seed)
        with mp.workdps(60):
            expected = mp.svd_r(mp.matrix(matrix.tolist()), compute_uv=False)[0]
            assert abs(algebra.spectral_norm(matrix) / expected - 1) < 20 * EPS
        scaled = algebra.spectral_norm(np.ldexp(matrix, 900))
        assert scaled == np.ldexp(algebra.spectral_norm(matrix), 900)


@pytest.mark.parametrize("size", [1, 5])
def test_factors(size):
    """Solutions and inverses have small residuals; P A = L U is what is said of it."""
    for seed in range(2):
        matrix = uneven((size, size), seed, decades=8)
        factors = algebra.LU(matrix)
        lower, upper = np.tril(factors.lu, -1) + np.eye(size), np.triu(factors.lu)
        assert np.all(np.abs(lower) <= 1)
        parts = np.abs(lower) @ np.abs(upper)
        assert np.all(np.abs(lower @ upper - matrix[factors.order]) <= 2 * size * EPS * parts)
        rhs = np.random.default_rng(seed).normal(size=(size, 2))
        found = factors.solve(rhs)
        with mp.workdps(60):
            exact = mp.matrix(matrix.tolist())
            residual = exact * mp.matrix(found.tolist()) - mp.matrix(rhs.tolist())
        missed = np.array(residual.tolist(), float).reshape(rhs.shape)
        # Componentwise backward error of substitution (Higham, Section 9.2).
        bound = 6 * size * EPS * (parts @ np.abs(found))[np.argsort(factors.order)]
        assert np.all(np.abs(missed) <= bound)
        np.testing.assert_array_equal(factors.solve(rhs[:, 0]), found[:, 0])
        np.testing.assert_array_equal(factors.inverse(), factors.solve(np.eye(size)))


def test_what_has_no_inverse_is_refused_and_arguments_stay():
    """Where a pivot is exactly zero; what is not a number is handed on."""
    with pytest.raises(np.linalg.LinAlgError):
        algebra.LU(np.array([[1.0, 2.0], [2.0, 4.0]]))
    assert np.isnan(algebra.LU(np.array([[np.nan]])).solve(np.ones(1))).all()
    matrix, rhs = uneven((4, 4), 0), np.ones(4)
    before = matrix.copy()
    algebra.LU(matrix).solve(rhs)
    algebra.spectral_norm(matrix.T)
    np.testing.assert_array_equal(matrix, before)
    np.testing.assert_array_equal(rhs, np.ones(4))
