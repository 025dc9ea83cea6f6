"""Sparse Jacobians and their march against the dense ones."""

import numpy as np
from covering import covering
from damped import damped
from each import each
from marching import in_motion, scheme_of

from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.mechanisms.spec import Shipped, Sized
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.scaling import VARIANTS

CHAIN = Sized("chain", (("links", 6),))
FOUR_BARS = Sized("four-bars", (("windows", 4),))
SPECS = [*(Shipped(name) for name in PROBLEMS), CHAIN, FOUR_BARS]
SUBJECTS = {spec.label: spec.load() for spec in SPECS} | {"damped": damped()}


@each("form", FORMS)
@each("variant", VARIANTS)
def test_accurate_at_small_steps_whatever_the_scaling(form, variant):
    """LU of J̄ of a bent chain at h = 1e-7, in the units of each unknown.

    Orders of elimination that reduce fill alone leave errors of 1 here.
    """
    subject = Sized("chain", (("links", 200),)).load()
    h = 1e-7
    scheme = scheme_of(form, variant, h)
    state = in_motion(subject)
    system = SparseSystem(subject, scheme)
    values = subject.values(0.0, *state.fields[:2], state.multipliers)
    unit = {"u": 1.0, "v": 2 / h, "a": 4 / h**2, "lambda": 4 / h**2}
    sizes = [subject.n] * len(scheme.form.kept) + [subject.m]
    units = np.repeat([unit[name] for name in scheme.form.unknowns] / scheme.right, sizes)
    exact = np.random.default_rng(5).normal(size=system.size) * units
    # In extended precision, so that the error is the solver's and not the product's.
    product = np.zeros(system.size, np.longdouble)
    entries = system.scaled_entries(values).astype(np.longdouble)
    np.add.at(product, system.rows, entries * exact[system.columns])
    found = system.solve(values, product.astype(float))
    assert np.max(np.abs(found - exact) / units) < 1e-8


@each("name, form, variant, h", covering(SUBJECTS, FORMS, VARIANTS, (1e-2, 1e-5, 1e-8)))
def test_condition_estimate(name, form, variant, h):
    """Between a third of the exact 1-norm condition number and all of it; repeatable.

    ‖J̄‖ is exact; the estimate of ‖J̄⁻¹‖ is a lower bound, almost always within a factor
    of 3 (Higham and Tisseur, 2000).
    """
    subject = SUBJECTS[name]
    state = in_motion(subject)
    scheme = scheme_of(form, variant, h)
    dense = DenseSystem(subject, scheme).balanced(0.0, state)
    exact = np.linalg.norm(dense.system.dense(dense.scaled), 1) * np.linalg.norm(dense.inverse(), 1)
    system = SparseSystem(subject, scheme)
    found = system.balanced(0.0, state).condition()
    assert exact / 3 <= found <= exact * (1 + 1e-9)
    assert system.balanced(0.0, state).condition() == found
