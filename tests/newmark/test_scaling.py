"""Table 2, the rule behind it, and scalings of one's own."""

import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.scaling import Preconditioning, ScalingError, named_scaling, sensitivity


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
    with pytest.raises(ScalingError):
        Preconditioning.parse(label)
