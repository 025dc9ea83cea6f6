"""Condition numbers against mpmath with 60 digits."""

import itertools

import oracles
import pytest
from marching import scheme_of, start
from mpmath import mp

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.scaling import PAPER_VARIANTS

H = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)

#: Every form, every variant, and every step size; the largest number is among them.
OF_EACH = [
    (form, PAPER_VARIANTS[(k + 2) % len(PAPER_VARIANTS)], H[(k + 4) % len(H)])
    for k, form in enumerate(FORMS)
]


@pytest.fixture
def reference(request):
    """Problem, its initial state, and X, G, M there in 60 digits."""
    with mp.workdps(oracles.DIGITS):
        subject = problem(request.param)
        state = start(subject)
        exact = oracles.REFERENCES[request.param]()
        x, g = exact.jacobian_terms(map(float, state.fields[0]), map(float, state.multipliers))
    return subject, state, x, g, exact.mass


@pytest.mark.parametrize(
    ("reference", "cases"),
    [
        ("pendulum", [*itertools.product(FORMS, PAPER_VARIANTS, H)]),
        ("andrews", OF_EACH),  # of whom a singular value takes long
    ],
    indirect=["reference"],
    ids=oracles.REFERENCES,
)
def test_condition_numbers(reference, cases):
    """All forms and variants, h = 1e-1 … 1e-7, within 1e-9 relative; C runs from 3 to 1e31.

    Of Andrews' mechanism each of these once.
    """
    subject, state, x, g, mass = reference
    wrong = {}
    with mp.workdps(oracles.DIGITS):
        no_damping = mp.zeros(subject.n)
        for form, variant, h in cases:
            blocks = oracles.form_jacobian(form, x, no_damping, mass, g, h)
            exact = oracles.condition_number(oracles.scale(form, variant, *blocks, h))
            scheme = scheme_of(form, variant, h)
            found = DenseSystem(subject, scheme).balanced(0.0, state).condition()
            if not abs(found / exact - 1) < 1e-9:
                wrong[form, variant, h] = found, exact
    assert not wrong
