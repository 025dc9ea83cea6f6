"""Forms, their weights and histories, against the equations of the paper."""

import numpy as np
import oracles
import pytest
from each import each
from hypothesis import given, settings
from hypothesis import strategies as st

from newmark_cli.newmark.forms import FORMS, eliminate
from newmark_cli.newmark.integrator import Newmark

betas = st.floats(0.05, 1.0)
gammas = st.floats(0.5, 1.0)
steps = st.floats(1e-7, 1.0)


@each("name", FORMS)
@settings(max_examples=10)  # of each form
@given(betas, gammas, steps)
def test_weights_are_those_of_the_table(name, beta, gamma, h):
    """W = ∂(u, v, a)/∂(kept), typed again from the definition of each form."""
    rows, kept, weights = oracles.FORMS[name]
    form = FORMS[name]
    assert "".join(form.rows) == rows
    assert "".join(form.kept) == kept
    found = eliminate(form, Newmark(beta, gamma).relations(h))
    np.testing.assert_allclose(found.weights, weights(beta, gamma, h), rtol=1e-12)


@each("name", FORMS)
@settings(max_examples=10)  # of each form
@given(betas, gammas, st.floats(1e-4, 1.0), st.integers(0, 2**32 - 1))
def test_forms_satisfy_newmarks_relations(name, beta, gamma, h, seed):
    """Eqs. 12b and 12c hold for the fields of a form, or are what its kept rows ask."""
    random = np.random.default_rng(seed)
    past = random.normal(size=3)
    form = FORMS[name]
    found = eliminate(form, Newmark(beta, gamma).relations(h))
    kept = random.normal(size=len(form.kept))
    u, v, a = found.weights @ kept + found.past @ past
    u_n, v_n, a_n = past
    residual = {
        "V": v - v_n - h * ((1 - gamma) * a_n + gamma * a),
        "K": u - u_n - h * v_n - h**2 / 2 * ((1 - 2 * beta) * a_n + 2 * beta * a),
    }
    size = {"V": abs(v) + abs(h * a) + 1, "K": abs(u) + abs(h**2 * a) + abs(h * v_n) + 1}
    kept_rows = dict(zip(form.extra_rows, found.rows @ kept + found.rows_past @ past, strict=True))
    for row, value in residual.items():
        assert kept_rows.get(row, 0.0) == pytest.approx(value, abs=1e-13 * size[row])
