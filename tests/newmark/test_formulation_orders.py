"""Orders of every formulation against exact arithmetic, block by block."""

import itertools
import random
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from covering import covering
from exact_orders import CONSTRAINTS, Measured, System, random_system, zeros

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.orders import derive_scaling, form_orders
from newmark_cli.newmark.scaling import VARIANTS, named_scaling, sensitivity

#: Whether Y and X are there.
TERMS = [(True, True), (False, True), (True, False), (False, False)]
#: Y, X, (∂(Gᵀv)/∂u, ∂(Gᵀv')/∂u + ∂κ/∂u) there or not, P = M⁻¹G or G: what may be special.
SPECIAL = covering(
    (True, False), (True, False), ((True, True), (False, True), (False, False)), (True, False)
)


def orders_of(formulation, form, **options):
    """What is predicted of a form with the rows of a formulation."""
    return form_orders(Formulation.parse(formulation).applied(FORMS[form]), **options)


@cache
def system(y=True, x=True, rows=(True, True), p=False) -> System:
    """A random system, of three coordinates and two constraints; p: P = M⁻¹G."""
    found = random_system(random.Random(10), y, x, rows[0], p)
    assert found.G.shape == (3, 2)
    return found if rows[1] else replace(found, Q=zeros(2, 3))


def powers(side):
    """Powers of h of a side of a scaling."""
    return {block: factor.order() for block, factor in side.items()}


@pytest.mark.parametrize(("formulation", "form", "terms"), [*covering(CONSTRAINTS, FORMS, TERMS)])
def test_blocks(formulation, form, terms):
    """J, J⁻¹, the residual and all corrections in general position, with and without X and Y."""
    y, x = terms
    measured = Measured(system(y, x), form, formulation)
    for compensated in (False, True):
        orders = orders_of(formulation, form, damped=y, stiff=x, compensated=compensated)
        assert (orders.form.rows, orders.form.solved) == (measured.rows, measured.unknowns)
        np.testing.assert_array_equal(orders.jacobian, measured.jacobian)
        np.testing.assert_array_equal(orders.inverse, measured.inverse)
        residual = dict(zip(orders.form.rows, orders.residual, strict=True))
        assert residual == measured.residual(compensated)
        found = measured.corrections(random.Random(1), compensated)
        physical = orders.physical_corrections()
        assert {name: physical[name] for name in found} == found
    assert not orders.bounded
    if y and x:
        orders = orders_of(formulation, form)
        physical = orders.physical_corrections()
        without = measured.corrections(random.Random(4), rows="DCB")
        smaller = {name for name, order in without.items() if order > physical[name]}
        assert smaller == set(orders.bounded)


@pytest.mark.parametrize(("formulation", "form"), [*itertools.product(CONSTRAINTS, FORMS)])
def test_special_positions(formulation, form):
    """Single blocks of J⁻¹ get smaller, to a limit; corrections and C stay what they are."""
    orders = orders_of(formulation, form)
    derived = derive_scaling(orders)
    for scaling in (named_scaling("optimal", orders.form), sensitivity(orders.form)):
        of_solved = {name: scaling.right[name] for name in orders.form.solved}
        assert derived == (powers(scaling.left), powers(of_solved))
        jacobian, inverse = orders.scaled(scaling)
        assert np.min(jacobian) == np.min(inverse) == 0
    reached, physical = orders.inverse, orders.physical_corrections()
    whole = form == "u-v-a-lambda"
    for kind in SPECIAL if whole else SPECIAL[[*FORMS].index(form) % 3 :: 4]:
        measured = Measured(system(*kind), form, formulation)
        assert np.all(measured.inverse >= orders.inverse), kind
        assert np.all(measured.inverse <= orders.special), kind
        assert measured.condition(*derived) == 0
        reached = np.maximum(reached, measured.inverse)
        for name, order in measured.corrections(random.Random(2)).items():
            assert order == physical[name], (kind, name)
        for variant in VARIANTS:
            scaling = named_scaling(variant, orders.form)
            condition = measured.condition(powers(scaling.left), powers(scaling.right))
            assert condition == orders.condition(scaling), (kind, variant)
    if whole:
        np.testing.assert_array_equal(reached, orders.special)
