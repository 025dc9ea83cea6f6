"""Code made for one mechanism and form: the same bits as the loops that it is made from."""

import dataclasses
from pathlib import Path

import mechanisms
import numpy as np
import pytest
from each import each
from marching import march, scheme_of

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import problem
from newmark_cli.mechanisms.spec import Sized
from newmark_cli.newmark.compiled_march import Engine
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear.written import specialised
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march import initial_state


@pytest.fixture(scope="module")
def everything():
    """Mechanisms with every element, driven and not."""
    return {name: mechanisms.everything(driven=name == "driven") for name in ("driven", "free")}


def system_of(subject, scheme, static):
    """What eliminates; None with partial pivoting."""
    return StaticSystem(subject, scheme) if static else None


class Run:
    """A march of an engine, as `marching.march` calls it."""

    def __init__(self, system):
        self.system = system

    def march(self, subject, scheme, state, first, norms, iterations):
        """Advance the state."""
        return Engine(subject, scheme, self.system).march(state, first, norms, iterations)


@each(
    "subject, form, variant, integrator, evaluation, precision, static",
    [
        ("driven", "u-lambda", "none", Newmark(), "direct", "float64", False),
        ("driven", "u-v-a-lambda", "optimal", BDF2(), "direct", "float32", True),
        ("free", "v-lambda", "optimal", GeneralizedAlpha(0.8), "compensated", "float64", True),
        ("free", "u-a-lambda", "left", Newmark(), "compensated", "float32", False),
        ("andrews", "a-lambda", "right", GeneralizedAlpha(0.0), "direct", "float64", True),
        ("slider-crank", "v-a-lambda", "none", BDF2(), "compensated", "float64", True),
    ],
)
def test_the_same_bits(
    everything, subject, form, variant, integrator, evaluation, precision, static
):
    """States, norms and iterations of the code and of the loops are equal."""
    subject = everything[subject] if subject in everything else problem(subject)
    scheme = scheme_of(form, variant, 1e-4, integrator, evaluation=evaluation, precision=precision)
    found = []
    for most in (specialised.ELEMENTS_AT_MOST, 0):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(specialised, "ELEMENTS_AT_MOST", most)
            system = system_of(subject, scheme, static)
            assert bool(Engine(subject, scheme, system)._code[0]) == bool(most)
            state = initial_state(subject, scheme)
            taken = march(Run(system), subject, scheme, state, 0, 12)
            found.append([*taken, *state.copy()])
    for code, loops in zip(*found, strict=True):
        assert code.dtype == loops.dtype
        np.testing.assert_array_equal(code, loops)
    assert np.abs(found[0][1]).min() >= 2  # Newton has iterated


def code_of(subject, h=1e-3, form="u-lambda", static=False, **changes):
    """Addresses of what an engine calls."""
    scheme = scheme_of(form, "optimal", h, **changes)
    engine = Engine(subject, scheme, system_of(subject, scheme, static))
    return int(engine._code[0]), int(engine._tables.ints[0, 0])


def test_forms_share_the_evaluation():
    """Each has a correction of its own, and each solver."""
    subject = problem("pendulum")
    codes = [
        code_of(subject, form=form, static=static)
        for form, static in (("u-lambda", False), ("a-lambda", False), ("a-lambda", True))
    ]
    corrections, evaluations = map(set, zip(*codes, strict=True))
    assert (len(corrections), len(evaluations)) == (3, 1)


def test_parameters_are_arguments():
    """A mechanism under another gravity marches with the code of the first one."""
    scheme = scheme_of("u-lambda", "none", 1e-3)
    subject = problem("pendulum")
    assert subject.reals[subject.reals == -1].size == 1
    moon = dataclasses.replace(subject, reals=np.where(subject.reals == -1, -0.165, subject.reals))
    assert code_of(moon) == code_of(subject)
    state = initial_state(moon, scheme)
    march(Run(None), moon, scheme, state, 0, 100)
    # From rest at the horizontal the point falls g t²/2, less O(t⁶).
    assert state.fields[0, 1] == pytest.approx(-0.165 * 0.1**2 / 2, rel=1e-4)


def subject_of(why):
    """A mechanism, and a formulation, without code."""
    if why == "seldom kinds":
        return newmark.problem(Path(__file__).parents[1] / "docs/examples/shaper.yaml"), "index-3"
    formulated = why == "formulated"
    links = 2 if formulated else specialised.ELEMENTS_AT_MOST
    return Sized("chain", (("links", links),)).load(), "index-2" if formulated else "index-3"


@each("why", ["large", "formulated", "seldom kinds"])
def test_loops_serve_where_no_code_is_made(why):
    """Of large mechanisms, for formulations, and where there are gears, laws of time and such."""
    chain, formulation = subject_of(why)
    scheme = scheme_of("u-lambda", "none", 1e-3, formulation=Formulation(formulation))
    engine = Engine(chain, scheme)
    assert engine._code.tolist() == [0]
    assert engine._function is chain.function
    assert engine._tables.ints is chain.ints
