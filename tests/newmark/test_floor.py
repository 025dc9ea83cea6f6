"""Floors of Newton's corrections: steps taken anew at a few states, beside whole marches."""

import numpy as np
import pandas as pd
import pytest
from covering import covering
from marching import formulated, scheme_of
from test_formulations import subject_of

import newmark_cli as newmark
from newmark_cli.newmark.floor import floor, unpredicted
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear.choice import Krylov
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scheme import Tolerance

#: Problem → step size (s); all but the last have quadratic constraints.
SUBJECTS = {"andrews": 1e-4, "thrown": 1e-3, "four-bar": 1e-3, "shaken-pendulum": 1e-3}
DAMPED = GeneralizedAlpha(0.9)
INTEGRATORS = (Newmark(), DAMPED, BDF2())
CASES = [
    *covering(SUBJECTS, FORMS, INTEGRATORS, ["direct"], ["index-3"])[::2],
    *covering([*SUBJECTS][:3], FORMS, INTEGRATORS, ["compensated"], ["index-3"])[::2],
    *(
        ("andrews", *how, formulation)
        for formulation in ("ggl", "index-2", "index-1", "baumgarte rate_h=0.5")
        for how in (("a-lambda", BDF2(), "direct"), ("u-lambda", BDF2(), "compensated"))
    ),
]


def quotients(subject, scheme, steps=300, states=5):
    """Predicted over measured rms of every block that the march records."""
    # Compensated corrections are often exactly zero: few draws miss those that are not.
    samples = 32 if scheme.compensated else 16
    march, norms, iterations, predicted = March(subject, scheme), [], [], []
    for _ in range(states):
        for half in range(2):
            stretch = march.advance(steps // states // 2)
            norms.append(stretch.norms)
            iterations.append(stretch.iterations)
            if half == 0:
                predicted.append(list(floor(march, samples).scaled.values()))
    norms, iterations = np.concatenate(norms), np.concatenate(iterations)
    assert np.mean(iterations > 0) > 0.95
    measured = np.sqrt(np.mean(norms[iterations > 0] ** 2, axis=0))
    return np.sqrt(np.mean(np.square(predicted), axis=0)) / measured


#: Without damping λ drifts away, which is not the floor.
SINGLE = covering(SUBJECTS, FORMS, [BDF2()], ["direct"], ["index-3"])[::2]


@pytest.mark.parametrize(
    ("precision", "cases"),
    [("float64", CASES), pytest.param("float32", SINGLE, marks=pytest.mark.release)],
)
def test_floors_are_predicted(precision, cases):
    """Nineteen in twenty within a factor of two, all within three; rows of formulations as well."""
    found = {}
    for case in cases:
        name, form, integrator, evaluation, formulation = case
        scheme = formulated(
            formulation, form, SUBJECTS[name], integrator, evaluation=evaluation,
            precision=precision,
        )  # fmt: skip
        of_blocks = quotients(subject_of(name), scheme)
        for unknown, quotient in zip(scheme.recorded, of_blocks, strict=True):
            found[*case, unknown] = max(quotient, 1 / quotient)
    worst = sorted(found.items(), key=lambda item: -item[1])[:5]
    assert worst[0][1] < 3, worst
    assert np.mean([factor < 2 for factor in found.values()]) >= 0.95, worst


def test_exact_zeros_are_predicted():
    """Φ of a pendulum is often exactly zero, and then so is the correction."""
    march = March(subject_of("pendulum"), scheme_of("v-lambda", "optimal", 1e-3, DAMPED))
    norms, zeros = [], []
    for _ in range(10):
        norms.append(march.advance(200).norms)
        zeros.append(floor(march).zeros["v"])
    measured = np.mean(np.concatenate(norms)[:, 0] == 0)
    assert 0.2 < measured < 0.8
    assert abs(np.mean(zeros) - measured) < 0.15


@pytest.mark.parametrize("solver", ["dense-lu", "gmres"])
def test_the_march_goes_on_as_if_nobody_had_looked(solver):
    """Neither its state nor its counts, with a solver that remembers what it did as well."""
    scheme = scheme_of("a-lambda", "optimal", 1e-4, BDF2())
    looked, plain = marches = [
        March(subject_of("andrews"), scheme, solver, Krylov()) for _ in range(2)
    ]
    for one in marches:
        one.advance(3)
    assert floor(looked, 2).scaled["lambda"] > 0
    np.testing.assert_array_equal(*(one.advance(3).norms for one in marches))
    assert looked.corrections == plain.corrections
    if solver == "gmres":
        assert looked.system.iterations == plain.system.iterations


def test_what_is_not_predicted():
    """Schemes that end otherwise are refused with the reason; too coarse steps give NaN."""
    assert "penalty" in unpredicted(formulated("augmented-lagrangian factor=10"))
    stopping = scheme_of("u-lambda", "optimal", 1e-5, BDF2(), stop=Tolerance(1e-9))
    with pytest.raises(ValueError, match="stops at a tolerance"):
        floor(March(subject_of("andrews"), stopping))
    coarse = newmark.floor("andrews", h=0.1, t_end=0.03)
    assert np.isnan(list(coarse.scaled.values())).all()


def test_floors_of_matrices_are_those_of_the_problem():
    """Within the factor of three that how Φ is evaluated may make."""
    subject, h = subject_of("andrews"), 1e-4
    march = March(subject, scheme_of("u-lambda", "optimal", h, BDF2()))
    march.advance(100)
    u, v, a, _ = march.here.fields
    terms = subject.evaluate(march.t, u, v, march.here.multipliers)
    state = {"u": u, "v": v, "a": a, "lambda": march.here.multipliers}
    matrices = {"M": subject.M, "G": terms.G, "X": terms.X, "Y": terms.Y, **state}
    found = newmark.floor(matrices, h=h, integrator="bdf2")
    expected = floor(march, samples=100)
    for unknown in ("u", "lambda"):
        assert 1 / 3 < found.physical[unknown] / expected.physical[unknown] < 3


STUDY = """\
study: mine
problem: andrews
form: u-lambda
preconditioning: [none, optimal]
integrator: {method: bdf2}
measure: [correction, floor]
samples: 3
h: [1e-4, 5e-5, 2e-5]
t_end: 0.006
"""


def test_floors_in_a_study(cli):
    """`run` records them; that they are right is claimed of the shipped study only."""
    cli.write("mine.yaml", STUDY)
    cli("run", "mine.yaml")
    rows = pd.read_csv(cli.folder / "results/mine.csv")
    keys = ["preconditioning", "h", "quantity"]
    measured = rows[rows["measure"] == "correction"].set_index(keys)["rms"]
    predicted = rows[rows["measure"] == "floor"].set_index(keys)["rms"]
    assert len(predicted) == len(measured) == 12
    assert ((predicted / measured).between(0.4, 2.5)).all()
    assert '"claim"' not in cli("check", "--json", code=1).stdout
