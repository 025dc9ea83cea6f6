"""Predicted orders of every block against 240-digit arithmetic at h = 1e-20."""

import itertools
from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from covering import covering
from each import each
from high_precision import (
    LAYOUT,
    Array,
    FactorFunction,
    Factors,
    Measured,
    System,
    inverse,
    jacobian,
    kept_part,
    measure,
    measure_all,
    measure_scaled,
    mpf,
    product,
)
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from marching import start

from newmark_cli.mechanisms.registry import PROBLEMS, problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.orders import FormOrders, form_orders
from newmark_cli.newmark.scaling import VARIANTS, named_scaling

INF = np.inf
#: With and without Y, with and without X.
KINDS = [(True, True), (False, True), (True, False), (False, False)]

#: Form → order of the condition number: none, left, right, optimal, V row as printed.
CONDITION = {
    "u-v-a-lambda": (-2, -2, -2, 0, -1),
    "u-v-lambda": (-3, -2, -2, 0, 0),
    "u-lambda": (-4, -2, -2, 0, 0),
    "v-lambda": (-3, -1, -2, 0, 0),
    "a-lambda": (-2, 0, -2, 0, 0),
    "u-a-lambda": (-2, -2, -2, 0, 0),
    "v-a-lambda": (-2, -1, -2, 0, -1),
}
VARIANT_NAMES = ("none", "left", "right", "optimal", "optimal-printed")


def examples(count: int) -> settings:
    """So many examples; a busy machine or an unlucky run of G without full rank is no failure."""
    unhurried = (HealthCheck.too_slow, HealthCheck.filter_too_much)
    return settings(max_examples=count, deadline=None, suppress_health_check=unhurried)


@st.composite
def systems(draw: st.DrawFn, damped: bool = True, stiff: bool = True) -> System:
    """Systems of up to six coordinates in whole numbers, in general position."""
    n = draw(st.integers(2, 6))
    m = draw(st.integers(1, n - 1))

    def matrix(columns: int, present: bool = True) -> list[list[int]]:
        if not present:
            return [[0] * columns for _ in range(n)]
        row = st.lists(st.integers(-3, 3), min_size=columns, max_size=columns)
        return draw(st.lists(row, min_size=n, max_size=n))

    root = np.array(matrix(n))
    system = System.of(
        M=(root @ root.T + np.eye(n, dtype=int)).tolist(),
        X=matrix(n, stiff),
        Y=matrix(n, damped),
        G=matrix(m),
        beta=draw(st.integers(4, 16)) / 16,
        gamma=draw(st.integers(8, 16)) / 16,
    )
    assume(system.in_general_position() and system.damped is damped and system.stiff is stiff)
    return system


@cache
def shipped(name: str) -> System:
    """A shipped problem, linearised at its consistent initial state."""
    mechanism = problem(name)
    state = start(mechanism)
    terms = mechanism.evaluate(mechanism.t0, state.fields[0], state.fields[1], state.multipliers)
    matrices = (mechanism.M, terms.X, terms.Y, terms.G)
    return System.of(*(matrix.tolist() for matrix in matrices))


def factors(form: str, variant: str) -> FactorFunction:
    """The factors of a variant as a function of β, γ and h."""
    scaling = named_scaling(variant, FORMS[form])

    def numbers(values: Mapping[str, mpf]) -> tuple[Sequence[mpf], Sequence[mpf]]:
        return (
            [mpf(scaling.left[row](values)) for row in FORMS[form].rows],
            [mpf(scaling.right[unknown](values)) for unknown in FORMS[form].unknowns],
        )

    return numbers


def predicted(system: System, form: str) -> FormOrders:
    """Predicted orders of a form of this system."""
    return form_orders(FORMS[form], damped=system.damped, stiff=system.stiff)


def assert_unscaled(system: System, form: str, measured: Measured) -> None:
    """Everything that no scaling enters is as predicted."""
    orders = predicted(system, form)
    np.testing.assert_array_equal(measured.weights, orders.weights)
    np.testing.assert_array_equal(measured.jacobian, orders.jacobian)
    np.testing.assert_array_equal(measured.inverse, orders.inverse)
    np.testing.assert_array_equal(measured.residual, orders.residual)
    np.testing.assert_array_equal(measured.corrections(), list(orders.corrections().values()))
    np.testing.assert_array_equal(
        measured.physical_corrections(), list(orders.physical_corrections().values())
    )


def assert_scaled_corrections(system: System, form: str, variant: str, measured: Measured) -> None:
    """Corrections of the scaled unknowns are as predicted."""
    scaling = named_scaling(variant, FORMS[form])
    np.testing.assert_array_equal(
        measured.corrections(Factors.of(factors(form, variant), system)),
        list(predicted(system, form).corrections(scaling).values()),
    )


def assert_scaled(
    system: System, form: str, variant: str, found: tuple[Array, Array, float]
) -> None:
    """J̄, its inverse and its condition number are as predicted."""
    scaling = named_scaling(variant, FORMS[form])
    orders = predicted(system, form)
    scaled, inverted = orders.scaled(scaling)
    np.testing.assert_array_equal(found[0], scaled)
    np.testing.assert_array_equal(found[1], inverted)
    assert found[2] == orders.condition(scaling)


@each("form", FORMS)
@given(data=st.data())
@examples(5)
def test_random_systems(form: str, data: st.DataObject) -> None:
    """Blocks, residual and corrections of a form on random systems."""
    damped, stiff = data.draw(st.sampled_from(KINDS))
    system = data.draw(systems(damped, stiff))
    measured = measure(system, form)
    assert_unscaled(system, form, measured)
    for variant in VARIANTS:
        assert_scaled_corrections(system, form, variant, measured)


@given(data=st.data())
@examples(25)
def test_random_scaled_systems(data: st.DataObject) -> None:
    """The scaled matrix, formed and inverted as it is, of any form on random systems."""
    form, variant = data.draw(st.sampled_from([*FORMS])), data.draw(st.sampled_from([*VARIANTS]))
    damped, stiff = data.draw(st.sampled_from(KINDS))
    system = data.draw(systems(damped, stiff))
    found = measure_scaled(system, form, factors(form, variant))
    assert_scaled(system, form, variant, found)


@each("name, damped, stiff", [("andrews", False, True), ("pendulum", False, False)])
def test_terms_of_shipped_problems(name: str, damped: bool, stiff: bool) -> None:
    """Neither problem has damping; the pendulum starts with λ = 0 and hence X = 0."""
    system = shipped(name)
    assert (system.damped, system.stiff) == (damped, stiff)
    assert system.in_general_position()


#: Inverses in long numbers of more than this take minutes.
SMALL = [name for name in PROBLEMS if problem(name).n + problem(name).m <= 30]


@each("name, form", [
    (name, form) for (i, name), (k, form) in itertools.product(enumerate(SMALL), enumerate(FORMS))
    if (i + k) % 2 == 0
])  # fmt: skip
def test_shipped_problems(name: str, form: str) -> None:
    """Blocks, residual and corrections of every other form, by turns, on the shipped problems."""
    system = shipped(name)
    measured = measure(system, form)
    assert_unscaled(system, form, measured)
    for variant in VARIANTS:
        assert_scaled_corrections(system, form, variant, measured)


@each(("name", "form", "variant"), covering(SMALL, FORMS, VARIANTS))
def test_scaled_shipped_problems(name: str, form: str, variant: str) -> None:
    """The scaled matrix, formed and inverted as it is, on the shipped problems."""
    system = shipped(name)
    assert_scaled(system, form, variant, measure_scaled(system, form, factors(form, variant)))


@given(system=systems())
@examples(5)
def test_inverse_of_a_form_is_part_of_the_four_field_inverse(system: System) -> None:
    """A form's inverse is the rows and columns it keeps, entry by entry."""
    h = mpf("1e-20")
    whole = inverse(jacobian(system, "u-v-a-lambda", h))
    for form in LAYOUT:
        own = inverse(jacobian(system, form, h))
        part = kept_part(system, form, whole)
        size = max(abs(x) for row in own for x in row)
        differences = [
            abs(x - y)
            for left, right in zip(own, part, strict=True)
            for x, y in zip(left, right, strict=True)
        ]
        assert max(differences) < size * mpf("1e-120")
        unit = product(jacobian(system, form, h), own)
        assert all(
            abs(x - (i == j)) < mpf("1e-60")
            for i, row in enumerate(unit)
            for j, x in enumerate(row)
        )


@given(system=systems())
@examples(6)
def test_one_inversion_measures_every_form(system: System) -> None:
    """Forms measured through the four-field inverse, scalings through norms of blocks."""
    for form, measured in measure_all(system).items():
        assert_unscaled(system, form, measured)
        for variant in VARIANTS:
            numbers = Factors.of(factors(form, variant), system)
            found = (*measured.scaled(numbers), measured.condition(numbers))
            assert_scaled(system, form, variant, found)


@each("damped, stiff", KINDS)
def test_four_field_tables(damped: bool, stiff: bool) -> None:
    """J and its inverse in the four-field form, block by block."""
    orders = form_orders(FORMS["u-v-a-lambda"], damped=damped, stiff=stiff)
    x, y = (0 if stiff else INF), (0 if damped else INF)
    np.testing.assert_array_equal(
        orders.jacobian, [[x, y, 0, 0], [INF, 0, 1, INF], [0, INF, 2, INF], [0, INF, INF, INF]]
    )
    v = 2 if damped else INF
    np.testing.assert_array_equal(
        orders.inverse, [[2, v, 0, 0], [1, 0, -1, -1], [0, v - 2, -2, -2], [0, v - 2, -2, -2]]
    )


@each(
    "form, damped, stiff, row",
    [
        ("u-v-lambda", True, True, [0, -1, 0]),
        ("u-v-lambda", False, True, [0, -1, 0]),
        ("u-v-lambda", True, False, [INF, -1, 0]),
        ("u-lambda", False, False, [-2, 0]),
        ("v-lambda", False, False, [-1, 0]),
        ("a-lambda", False, False, [0, 0]),
        ("u-a-lambda", False, False, [INF, 0, 0]),
        ("u-a-lambda", False, True, [0, 0, 0]),
        ("v-a-lambda", False, True, [INF, 0, 0]),
        ("v-a-lambda", True, False, [0, 0, 0]),
    ],
)
def test_dynamic_row(form: str, damped: bool, stiff: bool, row: list[float]) -> None:
    """Absent X and Y empty a block of row D only where M does not stand behind them."""
    orders = form_orders(FORMS[form], damped=damped, stiff=stiff)
    np.testing.assert_array_equal(orders.jacobian[0], row)


@each("damped, stiff", KINDS)
@each("form", FORMS)
def test_variants(form: str, damped: bool, stiff: bool) -> None:
    """Condition numbers and corrections under every variant, whatever terms the problem has.

    Corrections grow as 0, −1, −2, −2 unless the unknowns are scaled, then not at all.
    """
    orders = form_orders(FORMS[form], damped=damped, stiff=stiff)
    conditions = [orders.condition(named_scaling(v, FORMS[form])) for v in VARIANT_NAMES]
    assert conditions == list(CONDITION[form])
    physical = {"u": 0, "v": -1, "a": -2, "lambda": -2}
    assert orders.physical_corrections() == physical
    kept = {unknown: physical[unknown] for unknown in FORMS[form].unknowns}
    for variant in VARIANT_NAMES:
        expected = kept if variant in ("none", "left") else dict.fromkeys(kept, 0)
        assert orders.corrections(named_scaling(variant, FORMS[form])) == expected


@each(
    "Y, column",
    [
        # Along the constraint's normal: the multiplier takes it all, nothing moves.
        ([[2, 1, 1], [0, 0, 0], [0, 0, 0]], [INF, 0, INF, 0]),
        # Tangent to the constraint: it reaches the multiplier through X alone.
        ([[0, 0, 0], [1, 2, 0], [0, 1, 1]], [2, 0, 0, 2]),
    ],
)
def test_special_damping(Y: list[list[int]], column: list[float]) -> None:
    """Damping of a special direction only makes the V column smaller."""
    unit = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    X = [[1, 2, 3], [1, 1, 1], [2, 1, 3]]
    system = System.of(M=unit, X=X, Y=Y, G=[[1], [0], [0]])
    assert not system.in_general_position()
    measured = measure(system, "u-v-a-lambda")
    np.testing.assert_array_equal(measured.inverse[:, 1], column)
    np.testing.assert_array_equal(measured.physical_corrections(), [0, -1, -2, -2])
