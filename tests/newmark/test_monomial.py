"""Monomials: parsing, values, orders."""

import contextlib
import warnings

import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

from newmark_cli.newmark.monomial import SYMBOLS, Monomial, MonomialError

powers = st.dictionaries(st.sampled_from(SYMBOLS), st.integers(-6, 6))
coefficients = st.floats(1e-6, 1e6)
numbers = st.fixed_dictionaries({s: st.floats(1e-3, 10) for s in SYMBOLS})


def build(coefficient, exponents):
    return Monomial(coefficient, tuple(sorted((s, p) for s, p in exponents.items() if p)))


@given(coefficients, powers)
def test_text_reads_back(coefficient, exponents):
    """What a monomial prints is what it parses."""
    monomial = build(coefficient, exponents)
    assert Monomial.parse(str(monomial)) == monomial


@given(coefficients, powers, numbers)
def test_value_is_the_product(coefficient, exponents, values):
    """The value agrees with the product in 50 digits."""
    with mp.workdps(50):
        exact = mpf(coefficient)
        for symbol, power in exponents.items():
            exact *= mpf(values[symbol]) ** power
        assert build(coefficient, exponents)(values) == pytest.approx(float(exact), rel=1e-14)


@given(powers, powers)
def test_orders_add(first, second):
    a, b = build(1.0, first), build(1.0, second)
    assert (a * b).order() == a.order() + b.order()
    assert (a**-1).order() == -a.order()


@each("text, value, order", [
    ("beta*h^2", 0.25 * 1e-4, 2),
    ("1/(beta*h^2)", 4e4, -2),
    ("gamma/(beta*h)", 200.0, -1),
    ("2.5e-1 * h**-1", 25.0, -1),
    ("h/gamma/gamma", 0.04, 1),
    ("((h))^3", 1e-6, 3),
    ("7", 7.0, 0),
])  # fmt: skip
def test_known_texts(text, value, order):
    """Texts as users write them."""
    monomial = Monomial.parse(text)
    assert monomial({"beta": 0.25, "gamma": 0.5, "h": 1e-2}) == pytest.approx(value, rel=1e-15)
    assert monomial.order() == order


@each(("text", "reason"), [
    ("h +", "not a product"),
    ("beta*x", "unknown symbol 'x'"),
    ("0", "not positive"),
    ("-h", "must be positive"),
    ("1/0", "division by zero"),
    ("h^0.5", "whole numbers"),
    ("10^16^16", "whole numbers"),
    ("__import__('os')", "only numbers"),
    ("1e308*10", "not positive"),
    ("h" * 300, "longer than"),
])  # fmt: skip
def test_refused(text, reason):
    """Everything else is refused with a reason, never evaluated, and Python does not warn."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        with pytest.raises(MonomialError, match=reason):
            Monomial.parse(text)
    assert not warned


@given(st.text(max_size=60))
def test_any_text_parses_or_is_refused(text):
    """No text makes the parser fail in another way."""
    with contextlib.suppress(MonomialError):
        assert Monomial.parse(text).coefficient > 0
