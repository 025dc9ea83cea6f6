"""Forms, their weights and histories, against the equations of the paper."""

import numpy as np
import oracles
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
