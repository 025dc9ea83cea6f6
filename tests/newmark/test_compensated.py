"""Compensated evaluation: exact sums, exact increments of Φ, and what they buy."""

import itertools
from dataclasses import replace
from fractions import Fraction
from functools import cache

import mechanisms
import numpy as np
import pytest
import textbook
from damped import damped
from hypothesis import given
from hypothesis import strategies as st
from marching import ENGINES, EPS, STEP, formulated, in_python, march
from mpmath import mp, mpf

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import SHIPPED, problem
from newmark_cli.newmark import kernel
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import GeneralizedAlpha
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT, EVALUATIONS

#: Shipped problems whose constraints are quadratic and do not depend on time.
QUADRATIC = [name for name in SHIPPED if name != "shaken-pendulum"]


@pytest.fixture(scope="session")
def undriven():
    """Every element whose constraints do not depend on time."""
    return mechanisms.everything(driven=False)


@pytest.fixture(scope="session")
def subjects(undriven):
    """Problems with quadratic constraints by name."""
    named = {name: problem(name) for name in QUADRATIC}
    return named | {"damped": replace(damped(), quadratic=True), "undriven": undriven}


MARCHED = ["pendulum", "andrews", "slider-crank", "heavy-top", "undriven"]
STEPS_OF = {**{name: h for name, h in STEP.items() if name != "shaken-pendulum"}, "undriven": 1e-3}

# Exactness


NUMBERS = st.floats(-1e200, 1e200)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_sums_lose_one_rounding(high, low, increment):
    """The new sum is high + (low + increment rounded), exactly; its low part is below half an ulp.

    Rationals know no rounding.
    """
    added = low + increment
    total, lows = np.empty(1), np.array([low])
    kernel._add_exactly(np.array([high]), lows, np.array([increment]), total)
    assert Fraction(total[0]) + Fraction(lows[0]) == Fraction(high) + Fraction(added)
    assert total[0] == high + added
    assert abs(lows[0]) <= np.spacing(abs(total[0])) / 2


def exactly(values):
    return [Fraction(float(x)) for x in values]


def march_100(subject, engine, h):
    """State after 100 steps, the change of Φ(high + low), and the rounding of one step's."""
    scheme = formulated("index-3", "u-lambda", h, evaluation=COMPENSATED)
    state = initial_state(subject, scheme)
    begin = mechanisms.exact_phi(subject, exactly(state.past[0]))
    march(engine, subject, scheme, state, 0, 100)
    high, low = exactly(state.past[0]), exactly(state.lows[0])
    end = mechanisms.exact_phi(subject, [x + y for x, y in zip(high, low, strict=True)])
    change = np.array([float(b - a) for a, b in zip(begin, end, strict=True)])
    gradient = subject.values(0, *state.fields[:2], state.multipliers).g
    size = max(np.abs(subject.u0).max(), np.abs(gradient).max())
    return state, change, EPS * size * h * np.abs(state.past[1]).max()


@pytest.mark.parametrize(
    ("name", "engine"), [*itertools.product(MARCHED, ENGINES[:1]), ("undriven", in_python)]
)
def test_constraints_are_met_beyond_the_rounding_of_coordinates(name, engine, subjects):
    """After 100 steps Φ(high + low) is rounding of increments, far below eps ‖u‖²."""
    state, change, rounding = march_100(subjects[name], engine, STEPS_OF[name] / 10)
    assert np.abs(change).max() <= 100 * rounding
    assert np.abs(change - state.phi).max() <= 100 * rounding
    # What the sums of u and of v have lost is carried on, too.
    assert state.lows.any(axis=1).all()
    assert (np.abs(state.lows) <= np.spacing(np.abs(state.past[:2])) / 2).all()


# A march in long numbers


#: A pendulum off the horizontal, at a rate that fits its rod to the last bit.
MOVING = replace(problem("pendulum"), u0=np.array([0.6, 0.8]), v0=np.array([-1.6, 1.2]))
H, STEPS = 1e-6, 20


@cache
def long_motion():
    """The same steps of generalized-α in 40 digits, from the same start."""
    with mp.workdps(40):
        x, y = (mpf(float(c)) for c in MOVING.u0)
        system = textbook.System(
            mass=[[mpf(1), mpf(0)], [mpf(0), mpf(1)]],
            force=lambda t, u, v, m: [m[0] * u[0], m[0] * u[1] - 1],
            phi=lambda u: [(u[0] ** 2 - x**2 + u[1] ** 2 - y**2) / 2],
        )
        state = initial_state(MOVING, formulated("index-3", h=H))
        u, v, a, _ = ([mpf(float(c)) for c in field] for field in state.fields)
        start = textbook.Motion(mpf(0), u, v, a, a, [mpf(float(state.multipliers[0]))])
        return list(textbook.march(GeneralizedAlpha(0.9), system, start, mpf(H), STEPS))


@pytest.mark.bits("a compensated march meets the constraints where it starts by definition")
@pytest.mark.parametrize(
    ("form", "engine"), [*((form, ENGINES[0]) for form in FORMS), ("v-a-lambda", ENGINES[1])]
)
def test_multipliers_against_long_numbers(form, engine):
    """Over 20 steps of 1e-6: compensated λ is off by some eps/h, direct λ by some eps/h².

    The factors of a hundred are those of generalized-α: with ρ∞ = 0.9 an error of one
    step stays for some twenty. u and v are better by h in compensated evaluation too.
    """
    motion = long_motion()
    worst = {}
    for evaluation in EVALUATIONS:
        scheme = formulated("index-3", form, H, evaluation=evaluation)
        state, errors = initial_state(MOVING, scheme), []
        for step, exact in enumerate(motion):
            march(engine, MOVING, scheme, state, step, 1)
            with mp.workdps(40):
                found = [
                    [mpf(float(x)) + mpf(float(y)) for x, y in zip(high, low, strict=True)]
                    for high, low in zip(state.past[:2], state.lows, strict=True)
                ]
                found += [state.fields[2], state.multipliers]
                errors.append([
                    max(abs(float(x - y)) for x, y in zip(one, other, strict=True))
                    for one, other in zip(
                        found, (exact.u, exact.v, exact.a, exact.multipliers), strict=True
                    )
                ])  # fmt: skip
        worst[evaluation] = np.max(errors, axis=0)
    u, v, a, multipliers = worst[COMPENSATED] / EPS * np.array([1 / H, 1, H, H])
    assert u < 50
    assert v < 50
    assert a < 1e3
    assert multipliers < 1e3
    assert 10 < worst[DIRECT][3] / EPS * H**2 < 1e4


# Refusals


def declared(constraints, gradient, quadratic):
    """A swing in plain Python whose constraints are said to be quadratic, or not."""
    return newmark.problem(
        newmark.Definition(
            np.eye(2), np.array([1.0, 0.0]), np.array([0.0, -1.0]),
            lambda u, v, t: np.array([0.0, -1.0]), constraints, gradient, quadratic=quadratic,
        )
    )  # fmt: skip


def along(u, t):
    return u[:, None].copy()


@pytest.mark.parametrize(("constraints", "gradient", "words"), [
    (lambda u, t: np.array([(u @ u - 1) / 2 + u[1] ** 3]),
     lambda u, t: np.array([[u[0]], [u[1] + 3 * u[1] ** 2]]), "but are not"),
    (lambda u, t: np.array([np.log(u @ u)]), lambda u, t: 2 * u[:, None] / (u @ u), "but are not"),
    (lambda u, t: np.array([(u @ u - 1) / 2 + t**2]), along, "but depend on t"),
    (lambda u, t: np.array([(u @ u + 1) / 2 - np.cos(2 * np.pi * t)]), along, "but depend on t"),
])  # fmt: skip
def test_wrong_declarations_are_refused(constraints, gradient, words):
    """Constraints that are not quadratic, or change with time, were it each second alone."""
    declared(constraints, gradient, False)
    with pytest.raises(newmark.NewmarkError, match=f"declared quadratic, {words}"):
        declared(constraints, gradient, True)
