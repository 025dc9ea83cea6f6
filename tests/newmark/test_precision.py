"""Single precision: the march computes in it, and its floors are 2²⁹ times those of double."""

from types import SimpleNamespace

import mechanisms
import numpy as np
import pytest
from covering import covering
from each import each
from hypothesis import given
from hypothesis import strategies as st
from marching import compiled, interpreted_march, march
from numba import njit

from newmark_cli.mechanisms import elements
from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import METHODS, Formulation, Projection
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.march_data import counting
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import EVALUATIONS, PRECISIONS, Scheme, Tolerance

# Arithmetic


@njit
def sine(x):
    return np.sin(x)


@njit
def cosine(x):
    return np.cos(x)


@pytest.fixture(scope="module")
def everything():
    """A mechanism with every element, driven."""
    return mechanisms.everything()


def evaluated(function, subject, dtype, t, *state):
    """Force, Φ, X, Y, G in a precision."""
    pattern = subject.pattern
    sizes = subject.n, subject.m, len(pattern.x_rows), len(pattern.y_rows), len(pattern.g_rows)
    results = [np.full(size, np.nan, dtype) for size in sizes]
    given = (x.astype(dtype) for x in state)
    function(dtype(t), *given, subject.ints, subject.reals.astype(dtype), *results)
    return results


@given(seed=st.integers(0, 2**32 - 1), t=st.floats(-2, 2))
def test_elements_compute_in_single_precision(everything, seed, t):
    """Compiled and interpreted they agree bit by bit: no constant raises a term to double.

    NumPy's own sine differs from that of compiled code by a unit of rounding, so the
    interpreter is handed the latter.
    """
    random = np.random.default_rng(seed)
    u = everything.u0 + 0.2 * random.normal(size=everything.n)
    state = u, random.normal(size=everything.n), random.normal(size=everything.m)
    compiled = evaluated(elements.evaluate, everything, np.float32, t, *state)
    with mechanisms.interpreted() as patch:
        patch.setattr(
            elements, "np", SimpleNamespace(sin=sine, cos=cosine, sqrt=np.sqrt, int64=np.int64)
        )
        interpreted = evaluated(elements.evaluate, everything, np.float32, t, *state)
    double = evaluated(elements.evaluate, everything, np.float64, t, *state)
    for found, expected, exact in zip(compiled, interpreted, double, strict=True):
        assert found.dtype == expected.dtype == np.float32
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-3 * np.abs(exact).max())


def require_interpreted_steps(subject, scheme, steps):
    """Compiled and interpreted marches agree bit by bit; the state at the end."""
    ours, reference = initial_state(subject, scheme), initial_state(subject, scheme)
    norms, iterations = march(compiled, subject, scheme, ours, 0, steps)
    expected = counting(*norms.shape)
    interpreted_march(subject, scheme, reference, 0, expected)
    np.testing.assert_array_equal(norms, expected.norms)
    np.testing.assert_array_equal(iterations, expected.iterations)
    for one, other in zip(ours, reference, strict=True):
        np.testing.assert_array_equal(one, other)
    return ours


@each(
    "form, evaluation, stop, precision",
    covering(FORMS.values(), EVALUATIONS, [None, Tolerance(1e-5, 1e-4)], PRECISIONS),
)
def test_march_computes_in_its_precision(form, evaluation, stop, precision):
    """Compiled and interpreted it takes the same steps bit by bit."""
    subject = problem("four-bar")
    integrator = BDF2() if evaluation == "direct" else GeneralizedAlpha(0.9)
    scheme = Scheme(
        integrator, form, named_scaling("optimal", form), 1e-3, evaluation=evaluation,
        precision=precision, stop=stop,
    )  # fmt: skip
    ours = require_interpreted_steps(subject, scheme, 3)
    assert {array.dtype for array in ours} == {np.dtype(precision)}


@each(
    ("formulation", "evaluation", "projection", "precision", "name"),
    covering(
        METHODS,
        EVALUATIONS,
        ["none", "velocity", "position-velocity accelerations"],
        PRECISIONS,
        ["u-lambda", "v-a-lambda"],
        strength=3,
    ),
)
def test_formulations_march_in_their_precision(
    formulation, evaluation, projection, precision, name
):
    """Compiled and interpreted they too take the same steps bit by bit."""
    subject, integrator = problem("four-bar"), GeneralizedAlpha(0.9)
    of = Formulation(formulation)
    form = of.applied(FORMS[name])
    scheme = Scheme(
        integrator, form, named_scaling("optimal", form), 1e-3, evaluation=evaluation,
        precision=precision, formulation=of, projection=Projection.parse(projection),
    )  # fmt: skip
    require_interpreted_steps(subject, scheme, 2)
