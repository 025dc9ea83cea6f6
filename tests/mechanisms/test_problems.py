"""Shipped problems: terms against mpmath, starts, states of any kind."""

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp

from newmark_cli.mechanisms.registry import SHIPPED, problem
from newmark_cli.problems.index_1 import Index1

REFERENCED = [name for name in SHIPPED if name in oracles.REFERENCES]


@pytest.mark.parametrize("name", REFERENCED)
@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_terms_against_mpmath(name, seed):
    """M, f + Gλ, Φ against the formulas typed again."""
    subject, reference = problem(name), oracles.REFERENCES[name]()
    random = np.random.default_rng(seed)
    u = subject.u0 * (1 + 0.1 * random.normal(size=subject.n)) + 1e-3
    multipliers = random.normal(size=subject.m)
    terms = subject.evaluate(0.0, u, np.zeros(subject.n), multipliers)
    with mp.workdps(oracles.DIGITS):
        exact = [mp.mpf(float(x)) for x in u]
        force = reference.force(exact, [mp.mpf(float(x)) for x in multipliers])
        phi = reference.phi(exact)
        mass = np.array(reference.mass.tolist(), dtype=float)
    force, phi = np.array(force, float), np.array(phi, float)
    np.testing.assert_allclose(subject.M, mass, rtol=1e-13, atol=1e-13 * np.abs(mass).max())
    np.testing.assert_allclose(terms.force, force, rtol=0, atol=1e-12 * np.abs(force).max())
    np.testing.assert_allclose(terms.phi, phi, rtol=0, atol=1e-14 * np.sum(u**2))


def test_start_of_andrews():
    """β'' = 14222.4439199541 to 1e-12; the digits of the file are those of the initial angles."""
    subject = problem("andrews")
    a, _ = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    f, df = subject.u0[2:4], a[2:4]
    beta = (f[0] * df[1] - f[1] * df[0]) / (f @ f)
    assert beta == pytest.approx(14222.4439199541, rel=1e-12)
    angles = (
        "-0.0617138900142764496358948458001", 0, "0.455279819163070380255912382449",
        "0.222668390165885884674473185609", "0.487364979543842550225598953530",
        "-0.222668390165885884674473185609", "1.23054744454982119249735015568",
    )  # fmt: skip
    with mp.workdps(40):
        points, _ = oracles.andrews_points(angles, [0] * 7)
    np.testing.assert_array_equal(problem("andrews").u0, [float(x) for x in points])


def test_states_of_any_kind_take_the_compiled_code_that_is_there():
    """Read-only, parts of arrays, in single precision, whole numbers as times."""
    subject = problem("double-pendulum")
    state = [subject.u0, subject.v0 + 0.5, np.ones(subject.m)]
    functions = subject.function, subject.derivatives, subject.potential

    def computed(t, u, v, multipliers):
        values = *subject.values(t, u, v, multipliers), *subject.constraint_rows(t, u, v, v)
        return np.concatenate([*values, subject.energies(t, u, v)])

    expected = computed(0.0, *state)
    compiled = [function.signatures[:] for function in functions]
    fixed = [array.copy() for array in state]
    for array in fixed:
        array.flags.writeable = False
    for kind in (fixed, [np.repeat(a, 2)[::2] for a in state], [a.astype("f4") for a in state]):
        np.testing.assert_array_equal(computed(0, *kind), expected)
    assert [function.signatures for function in functions] == compiled
