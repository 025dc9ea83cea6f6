"""Exponent arithmetic against the orders that the paper states."""

import numpy as np
from each import each

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.orders import form_orders
from newmark_cli.newmark.scaling import PAPER_VARIANTS, named_scaling

#: Table 1's last row, first line; the others are Section 4's and high precision's.
CONDITION = {
    "none": (-2, -3, -4, -3, -2, -2, -2),
    "left": (-2, -2, -2, -1, 0, -2, -1),
    "right": (-2, -2, -2, -2, -2, -2, -2),
    "optimal": (0, 0, 0, 0, 0, 0, 0),
}


@each("variant", PAPER_VARIANTS)
@each(("index", "name"), list(enumerate(FORMS)))
def test_condition_numbers(index, name, variant):
    """Order of C, form by form."""
    found = form_orders(FORMS[name]).condition(named_scaling(variant, FORMS[name]))
    assert found == CONDITION[variant][index]


@each("name", FORMS)
def test_physical_corrections(name):
    """Table 1: u 0, v −1, a −2, λ −2, whichever unknowns are kept."""
    expected = {"u": 0, "v": -1, "a": -2, "lambda": -2}
    assert form_orders(FORMS[name]).physical_corrections() == expected


@each("variant", PAPER_VARIANTS)
@each("name", FORMS)
def test_scaled_corrections(name, variant):
    """none and left: as in physical units; right and optimal: all 0 (eqs. 40, 45)."""
    physical = {"u": 0, "v": -1, "a": -2, "lambda": -2}
    form = FORMS[name]
    found = form_orders(form).corrections(named_scaling(variant, form))
    scaled = variant in ("right", "optimal")
    assert found == {u: 0 if scaled else physical[u] for u in form.unknowns}


def test_blocks_are_those_of_the_paper():
    """Orders of J, J⁻¹ and the residual of (u, λ), eqs. 33 and 34, and of (u, v, λ), 21 to 23."""
    orders = form_orders(FORMS["u-lambda"])
    np.testing.assert_array_equal(orders.jacobian, [[-2, 0], [0, np.inf]])
    np.testing.assert_array_equal(orders.inverse, [[2, 0], [0, -2]])
    np.testing.assert_array_equal(orders.residual, [-2, 0])
    orders = form_orders(FORMS["u-v-lambda"])
    np.testing.assert_array_equal(
        orders.jacobian, [[0, -1, 0], [0, 1, np.inf], [0, np.inf, np.inf]]
    )
    np.testing.assert_array_equal(orders.inverse, [[2, 0, 0], [1, -1, -1], [0, -2, -2]])
    np.testing.assert_array_equal(orders.residual, [-1, 0, 0])


def test_optimal_scaling_makes_every_block_order_zero_or_more():
    """Eqs. 39 and 44: no block of J̄ or J̄⁻¹ grows."""
    for form in FORMS.values():
        jacobian, inverse = form_orders(form).scaled(named_scaling("optimal", form))
        assert jacobian.min() == 0
        assert inverse.min() == 0
