"""Forms, their weights and histories, against the equations of the paper."""

import numpy as np
import oracles
import pytest
from each import each
from hypothesis import given, settings
from hypothesis import strategies as st

from newmark_cli.newmark.forms import FORMS, eliminate
from newmark_cli.newmark.integrator import IntegratorError, Newmark
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme

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


@given(betas, gammas, st.floats(1e-6, 1.0), st.integers(0, 2**32 - 1))
def test_two_field_history_is_eq_28(beta, gamma, h, seed):
    """Row D of (u, λ): j_n = M [u_n/(βh²) + v_n/(βh) + (1/(2β) − 1) a_n]."""
    past = np.random.default_rng(seed).normal(size=3)
    form = FORMS["u-lambda"]
    tables = Scheme(Newmark(beta, gamma), form, named_scaling("none", form), h).tables
    u_n, v_n, a_n = past
    j_n = u_n / (beta * h**2) + v_n / (beta * h) + (1 / (2 * beta) - 1) * a_n
    assert -tables.dynamic_past @ past == pytest.approx(j_n, rel=1e-10, abs=1e-10 / h**2)
    assert tables.dynamic_weights[0] == pytest.approx(1 / (beta * h**2), rel=1e-15)
    v = tables.past_weights[1] @ past  # at u = u_n: the rates are differenced
    assert v == pytest.approx(
        (1 - gamma / beta) * v_n + h * (1 - gamma / (2 * beta)) * a_n, rel=1e-10, abs=1e-10
    )


@each(
    "beta, gamma, reason",
    [
        (0.0, 0.5, "must be positive"),
        (-0.25, 0.5, "must be positive"),
        (float("nan"), 0.5, "must be positive"),
        (float("inf"), 0.5, "must be positive"),
        (0.25, 0.49, "unstable"),
        (0.25, float("nan"), "unstable"),
    ],
)
def test_unusable_parameters_are_refused(beta, gamma, reason):
    """β ≤ 0 and γ < ½ are refused with the reason."""
    with pytest.raises(IntegratorError, match=reason):
        Newmark(beta, gamma)
