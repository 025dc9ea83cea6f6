"""Monomials, Table 2, the rule behind it, and scalings of one's own."""

import contextlib
import warnings

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.monomial import SYMBOLS, Monomial, MonomialError
from newmark_cli.newmark.scaling import Preconditioning, ScalingError, named_scaling, sensitivity

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


@pytest.mark.parametrize(("text", "value", "order"), [
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


@pytest.mark.parametrize(("text", "reason"), [
    ("h +", "not a product"),
    ("beta*x", "unknown symbol 'x'"),
    ("0", "not positive"),
    ("-h", "must be positive"),
    ("1/0", "division by zero"),
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


@given(st.text("0123456789.e*/^+-() hbetagm_'\0é", max_size=60))
def test_any_text_parses_or_is_refused(text):
    """No text makes the parser fail in another way."""
    with contextlib.suppress(MonomialError):
        assert Monomial.parse(text).coefficient > 0


@pytest.mark.parametrize("name", ["u-v-a-lambda", "u-v-lambda", "u-lambda", "a-lambda"])
def test_sensitivity_rule_is_table_2(name):
    """For forms that keep u, and (a, λ); `test_formulation_orders` has the powers of h of all."""
    by_rule, table = sensitivity(FORMS[name]), named_scaling("optimal", FORMS[name])
    assert (by_rule.left, by_rule.right) == (table.left, table.right)


@given(
    st.dictionaries(st.sampled_from("DC"), st.sampled_from(["h", "beta*h^2", "2/h"])),
    st.dictionaries(st.sampled_from(["u", "lambda"]), st.sampled_from(["1/h", "3", "h^-2"])),
)
def test_labels_say_everything(left, right):
    """The label of a scaling of one's own reads back to the same scaling."""
    own = Preconditioning("mine", tuple(left.items()), tuple(right.items()), own=True)
    back = Preconditioning.parse(own.label)
    assert back.scaling(FORMS["u-lambda"]) == own.scaling(FORMS["u-lambda"])
    assert "," not in own.label


@pytest.mark.parametrize("label", ["best", "x[up D=h]", "x[left D]", "x[", "[left D=h]"])
def test_labels_refused(label):
    with pytest.raises(ScalingError):
        Preconditioning.parse(label)
