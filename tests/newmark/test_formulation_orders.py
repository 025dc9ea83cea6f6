"""Orders of every formulation against exact arithmetic, block by block."""

import itertools
import random
from dataclasses import replace
from functools import cache

import numpy as np
from covering import covering
from each import each
from exact_orders import CONSTRAINTS, ZERO, Measured, System, random_system

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.orders import derive_scaling, form_orders
from newmark_cli.newmark.scaling import VARIANTS, named_scaling, sensitivity

#: Whether Y and X are there.
TERMS = [(True, True), (False, True), (True, False), (False, False)]
#: Y, X, ∂(Gᵀv)/∂u, ∂(Gᵀv')/∂u there or not, P = M⁻¹G or G: what may be special.
SPECIAL = [
    (y, x, a, q, p)
    for y, x, (a, q), p in covering(
        (True, False), (True, False), ((True, True), (False, True), (False, False)), (True, False)
    )
]


def applied(formulation, form):
    """A form with the rows of a formulation."""
    return Formulation.parse(formulation).applied(FORMS[form])


@cache
def system(y=True, x=True, a=True, q=True, p=False) -> System:
    """A random system, of four coordinates and two constraints; p: P = M⁻¹G."""
    found = random_system(random.Random(4), y, x, a, p)
    assert (found.n, found.m) == (4, 2)
    return found if q else replace(found, Q=[[ZERO] * found.n for _ in range(found.m)])


@cache
def measured_of(y, x, form, formulation) -> Measured:
    """In general position, with Y and X or without."""
    return Measured(system(y, x), form, formulation)


@each("formulation, form, terms", covering(CONSTRAINTS, FORMS, TERMS))
def test_blocks(formulation, form, terms):
    """J, J⁻¹, the residual and all corrections in general position, with and without X and Y."""
    y, x = terms
    measured = measured_of(y, x, form, formulation)
    for compensated in (False, True):
        orders = form_orders(applied(formulation, form), damped=y, stiff=x, compensated=compensated)
        assert (orders.form.rows, orders.form.solved) == (measured.rows, measured.unknowns)
        np.testing.assert_array_equal(orders.jacobian, measured.jacobian)
        np.testing.assert_array_equal(orders.inverse, measured.inverse)
        residual = dict(zip(orders.form.rows, orders.residual, strict=True))
        assert residual == measured.residual(compensated)
        found = measured.corrections(random.Random(1), compensated)
        physical = orders.physical_corrections()
        assert {name: physical[name] for name in found} == found


@each("formulation, form", itertools.product(CONSTRAINTS, FORMS))
def test_special_positions(formulation, form):
    """Single blocks of J⁻¹ get smaller, to a limit; corrections and C stay what they are."""
    orders = form_orders(applied(formulation, form))
    reached = orders.inverse
    whole = form == "u-v-a-lambda"
    for kind in SPECIAL if whole else SPECIAL[[*FORMS].index(form) % 3 :: 4]:
        measured = Measured(system(*kind), form, formulation)
        assert np.all(measured.inverse >= orders.inverse), kind
        assert np.all(measured.inverse <= orders.special), kind
        reached = np.maximum(reached, measured.inverse)
        physical = orders.physical_corrections()
        for name, order in measured.corrections(random.Random(2)).items():
            assert order == physical[name], (kind, name)
        for variant in VARIANTS:
            scaling = named_scaling(variant, orders.form)
            powers = (
                {block: factor.order() for block, factor in side.items()}
                for side in (scaling.left, scaling.right)
            )
            assert measured.condition(*powers) == orders.condition(scaling), (kind, variant)
    if whole:
        np.testing.assert_array_equal(reached, orders.special)


@each("formulation, form", itertools.product(CONSTRAINTS, FORMS))
def test_derived_scaling(formulation, form):
    """Least powers are those of the optimal scaling, and every block of J̄ and J̄⁻¹ is O(1)."""
    orders = form_orders(applied(formulation, form))
    left, right = derive_scaling(orders)
    for scaling in (named_scaling("optimal", orders.form), sensitivity(orders.form)):
        assert left == {row: factor.order() for row, factor in scaling.left.items()}
        assert right == {name: scaling.right[name].order() for name in orders.form.solved}
        jacobian, inverse = orders.scaled(scaling)
        assert np.min(jacobian) == np.min(inverse) == 0
    measured = measured_of(True, True, form, formulation)
    assert measured.condition(left, right) == 0


@each("form", FORMS)
def test_bounds_by_exact_arithmetic(form):
    """Without perturbations of V and K, only bounded corrections get smaller; compensated none."""
    for formulation in CONSTRAINTS:
        assert not form_orders(applied(formulation, form), compensated=True).bounded
        orders = form_orders(applied(formulation, form))
        measured = measured_of(True, True, form, formulation)
        without = measured.corrections(random.Random(4), rows="DCB")
        physical = orders.physical_corrections()
        smaller = {name for name, order in without.items() if order > physical[name]}
        assert smaller == set(orders.bounded)
