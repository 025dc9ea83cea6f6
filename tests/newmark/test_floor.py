"""Floors of Newton's corrections: steps taken anew at a few states, beside whole marches."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from covering import covering
from each import each
from test_formulations import subject_of

import newmark_cli as newmark
from newmark_cli.newmark.floor import floor, unpredicted
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear.choice import Krylov
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme, Tolerance

#: What is committed.
RESULTS = Path(__file__).parents[2] / "results"
#: Problem → step size (s) and steps; all but the last have quadratic constraints.
QUADRATIC = {"andrews": (1e-4, 300), "thrown": (1e-3, 300), "four-bar": (1e-3, 300)}
SUBJECTS = {**QUADRATIC, "shaken-pendulum": (1e-3, 300)}
INTEGRATORS = (Newmark(), GeneralizedAlpha(0.9), BDF2())
FORMULATIONS = ("index-3", "ggl", "index-2", "index-1", "baumgarte rate_h=0.5")


def scheme_of(form, h, integrator=None, variant="optimal", formulation="index-3", **options):
    chosen = Formulation.parse(formulation)
    formulated = chosen.applied(FORMS[form])
    scaling = named_scaling(variant, formulated)
    return Scheme(integrator or BDF2(), formulated, scaling, h, formulation=chosen, **options)


def quotients(subject, scheme, steps, states=10):
    """Predicted over measured rms of every block that the march records."""
    march, norms, iterations, predicted = March(subject, scheme), [], [], []
    for _ in range(states):
        for half in range(2):
            stretch = march.advance(steps // states // 2)
            norms.append(stretch.norms)
            iterations.append(stretch.iterations)
            if half == 0:
                predicted.append(list(floor(march).scaled.values()))
    norms, iterations = np.concatenate(norms), np.concatenate(iterations)
    assert np.mean(iterations > 0) > 0.95
    measured = np.sqrt(np.mean(norms[iterations > 0] ** 2, axis=0))
    return np.sqrt(np.mean(np.square(predicted), axis=0)) / measured


def test_floors_are_predicted():
    """Nineteen in twenty within a factor of two, all within three."""
    cases = [
        *covering(list(SUBJECTS), list(FORMS), INTEGRATORS, ["direct"], ["float64", "float32"]),
        *covering(list(QUADRATIC), list(FORMS), INTEGRATORS, ["compensated"], ["float64"]),
    ]
    found = {}
    for name, form, integrator, evaluation, precision in cases:
        h, steps = SUBJECTS[name]
        if precision == "float32":
            # Without damping λ drifts away, which is not the floor.
            integrator = BDF2()
        options = {"evaluation": evaluation, "precision": precision}
        scheme = scheme_of(form, h, integrator, **options)
        of_blocks = quotients(subject_of(name), scheme, steps)
        for unknown, quotient in zip(scheme.recorded, of_blocks, strict=True):
            where = (name, form, integrator.label, evaluation, precision, unknown)
            found[where] = max(quotient, 1 / quotient)
    worst = sorted(found.items(), key=lambda item: -item[1])[:5]
    assert worst[0][1] < 3, worst
    assert np.mean([factor < 2 for factor in found.values()]) >= 0.95, worst


@each("formulation", FORMULATIONS)
def test_floors_of_formulations_are_predicted(formulation):
    """Their rows of constraints round too; with η eliminated fields are predicted as well."""
    for form, evaluation in (("a-lambda", "direct"), ("u-lambda", "compensated")):
        scheme = scheme_of(form, 1e-4, formulation=formulation, evaluation=evaluation)
        found = np.log(quotients(subject_of("andrews"), scheme, 300))
        assert np.all(np.abs(found) < np.log(2)), np.exp(found)


def test_exact_zeros_are_predicted():
    """Φ of a pendulum is often exactly zero, and then so is the correction."""
    subject, scheme = subject_of("pendulum"), scheme_of("v-lambda", 1e-3, GeneralizedAlpha(0.9))
    march = March(subject, scheme)
    norms, zeros = [], []
    for _ in range(10):
        norms.append(march.advance(200).norms)
        zeros.append(floor(march).zeros["v"])
    measured = np.mean(np.concatenate(norms)[:, 0] == 0)
    assert 0.2 < measured < 0.8
    assert abs(np.mean(zeros) - measured) < 0.15


def test_the_march_goes_on_as_if_nobody_had_looked():
    """Neither its state nor its counts, with a solver that remembers what it did as well."""
    for solver in ("dense-lu", "sparse-lu", "gmres"):
        marches = [March(subject_of("andrews"), scheme_of("a-lambda", 1e-4), solver, Krylov())
                   for _ in range(2)]  # fmt: skip
        for one in marches:
            one.advance(3)
        assert floor(marches[0], 2).scaled["lambda"] > 0
        norms = [one.advance(3).norms for one in marches]
        np.testing.assert_array_equal(*norms)
        assert marches[0].corrections == marches[1].corrections
        if solver == "gmres":
            assert marches[0].system.iterations == marches[1].system.iterations


def test_what_is_not_predicted():
    """Schemes that end otherwise are refused with the reason; too coarse steps give NaN."""
    subject = subject_of("andrews")
    penalised = scheme_of("u-lambda", 1e-5, formulation="augmented-lagrangian factor=10")
    stopping = scheme_of("u-lambda", 1e-5, stop=Tolerance(1e-9))
    assert "penalty" in unpredicted(penalised)
    with pytest.raises(ValueError, match="stops at a tolerance"):
        floor(March(subject, stopping))
    coarse = newmark.floor("andrews", h=0.1, t_end=0.03)
    assert np.isnan(list(coarse.scaled.values())).all()


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
    assert not [entry for entry in judged(cli("check", "--json", code=1)) if "claim" in entry]
    for name in ("floor.csv", "floor.json"):
        shutil.copy(RESULTS / name, cli.folder / "results")
    (claim,) = [entry for entry in judged(cli("check", "floor", "--json")) if "claim" in entry]
    assert (claim["figure"], claim["study"], claim["verdict"]) == ("floor", "floor", "pass")
    assert claim["claim"].startswith("predicted / measured correction: 0.3 to 3.3")
    # Ten times as large a prediction is noticed.
    rows = pd.read_csv(cli.folder / "results/floor.csv", keep_default_na=False)
    factors = np.where(rows["measure"] == "floor", 10.0, 1.0)
    for column in ("rms", "max", "median", "last"):
        rows[column] = pd.to_numeric(rows[column]) * factors
    rows.to_csv(cli.folder / "results/floor.csv", index=False)
    found = judged(cli("check", "floor", "--json", code=1))
    (claim,) = [entry for entry in found if "claim" in entry]
    assert claim["verdict"] == "miss"
    assert 10 * 0.3 < float(claim["measured"]) < 10 * 3.3


def judged(done):
    """What `check --json` has printed."""
    return json.loads(done.stdout)


def test_floors_of_matrices_are_those_of_the_problem():
    """Within the factor of three that how Φ is evaluated may make."""
    subject, h = subject_of("andrews"), 1e-4
    march = March(subject, scheme_of("u-lambda", h))
    march.advance(100)
    u, v, a, _ = march.here.fields
    terms = subject.evaluate(march.t, u, v, march.here.multipliers)
    state = {"u": u, "v": v, "a": a, "lambda": march.here.multipliers}
    matrices = {"M": subject.M, "G": terms.G, "X": terms.X, "Y": terms.Y, **state}
    found = newmark.floor(matrices, h=h, integrator="bdf2")
    expected = floor(march, samples=100)
    for unknown in ("u", "lambda"):
        assert 1 / 3 < found.physical[unknown] / expected.physical[unknown] < 3
