"""Table 2, the rule behind it, and scalings of one's own."""

import oracles
import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.scaling import (
    PAPER_VARIANTS,
    Preconditioning,
    ScalingError,
    named_scaling,
    own_scaling,
    sensitivity,
)


@each("variant", PAPER_VARIANTS)
@each("name", FORMS)
def test_table_2(name, variant):
    """Every factor of every variant against Table 2, typed again."""
    beta, gamma, h = 0.3, 0.7, 1e-3
    left, right = oracles.TABLE_2[name]
    found = named_scaling(variant, FORMS[name])
    values = {"beta": beta, "gamma": gamma, "h": h}
    for side, table, factors in (
        ("left", left, found.left),
        ("right", right, found.right),
    ):
        for block, factor in factors.items():
            active = variant in (side, "optimal")
            expected = table[block](beta, gamma, h) if active and block in table else 1.0
            assert factor(values) == pytest.approx(expected, rel=1e-14), (side, block)


@each("name", FORMS)
def test_sensitivity_rule_gives_the_orders_of_table_2(name):
    """Scaling by ∂v/∂u and ∂a/∂u has the powers of h of Table 2, form by form.

    For forms that keep u, and (a, λ), the rule is Table 2 exactly.
    """
    by_rule = sensitivity(FORMS[name])
    table = named_scaling("optimal", FORMS[name])
    for side in ("left", "right"):
        ours, paper = getattr(by_rule, side), getattr(table, side)
        assert {b: f.order() for b, f in ours.items()} == {b: f.order() for b, f in paper.items()}
    if name in ("u-v-a-lambda", "u-v-lambda", "u-lambda", "a-lambda"):
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


@each("label", ["best", "x[up D=h]", "x[left D]", "x[", "[left D=h]"])
def test_labels_refused(label):
    """What is no label is refused."""
    with pytest.raises(ScalingError):
        Preconditioning.parse(label)


def test_blocks_must_exist():
    """A factor for a row or an unknown that the form lacks is refused by name."""
    with pytest.raises(ScalingError, match="form u-lambda has no 'V'; it has D, C"):
        own_scaling("x", FORMS["u-lambda"], {"V": "h"}, {})
    with pytest.raises(ScalingError, match="form u-lambda has no 'a'"):
        own_scaling("x", FORMS["u-lambda"], {}, {"a": "h"})
