"""What changes of the step size do to errors of u, v and λ, as measured, and what is said of it."""

import numpy as np
import pandas as pd
import pytest
from each import each
from oracles import THROWN, thrown_pendulum

import newmark_cli as newmark


def errors(h, sequence, **options):
    """Largest errors of v and λ after t = 0.6 of a pendulum."""
    found = newmark.march(THROWN, h=h, t_end=1.2, h_sequence=sequence, **options)
    angle, rate = thrown_pendulum(found.t)
    off = np.abs(found.v - (rate * [-np.sin(angle), np.cos(angle)]).T).max(axis=1)
    multiplier = 9.81 * np.sin(angle) - rate**2
    behind = found.t > 0.6
    return off[behind].max(), np.abs(found.multipliers[:, 0] - multiplier)[behind].max()


FIVE, FOUR, RANDOM = (
    "alternate 1.0 0.5 every 5", "alternate 1.0 0.5 every 4", "random 0.5 2.0 seed 1"
)  # fmt: skip
CASES = [
    # integrator, formulation, projection, auxiliary, sequence, orders of v and λ
    ("hht alpha=0.3", "index-3", "none", "keep", FIVE, 1, 1),
    ("hht alpha=0.3", "index-3", "none", "rescale", FIVE, 2, 1),
    ("hht alpha=0.3", "index-3", "none", "rescale-velocity", FIVE, 2, 2),
    ("generalized-alpha rho=0.5", "index-3", "none", "rescale-velocity", RANDOM, 2, 2),
    ("generalized-alpha rho=0.5", "ggl", "none", "restart", FOUR, 1, 1),
    ("generalized-alpha rho=0.5", "ggl", "none", "rescale", FOUR, 2, 2),
    ("generalized-alpha rho=0.5", "index-2", "none", "rescale", RANDOM, 2, 2),
    ("bdf2", "index-3", "none", "keep", FIVE, 2, 1),
    ("bdf2", "index-3", "none", "rescale-velocity", RANDOM, 2, 2),
    ("bdf2", "index-3", "velocity", "keep", FOUR, 2, 2),
    ("bdf1", "index-3", "none", "keep", FIVE, 1, 0),
    ("bdf1", "index-3", "none", "rescale-velocity", FIVE, 1, 1),
    ("trapezoidal", "index-2", "none", "keep", FIVE, 2, 1),
    ("trapezoidal", "index-2", "none", "keep", FOUR, 2, 2),
    ("trapezoidal", "index-3", "velocity", "keep", FOUR, 2, 2),
]


@each("integrator, formulation, projection, auxiliary, sequence, of_v, of_lambda", CASES)
def test_orders_of_changes_that_recur(
    integrator, formulation, projection, auxiliary, sequence, of_v, of_lambda
):
    """As measured on a pendulum; constants of generalized-α are small."""
    how = {
        "integrator": integrator, "formulation": formulation, "projection": projection,
        "auxiliary": auxiliary,
    }  # fmt: skip
    (v, multiplier), (finer_v, finer) = (errors(h, sequence, **how) for h in (1e-3, 5e-4))
    assert np.log2(v / finer_v) == pytest.approx(of_v, abs=0.35)
    assert np.log2(multiplier / finer) == pytest.approx(of_lambda, abs=0.35)


def test_a_rescaled_acceleration_alone_may_resonate():
    """Five steps of 2h, five of h/2, ρ∞ = 0.9: λ grows without bound, but not if v is scaled."""
    sequence, how = "alternate 2.0 0.5 every 5", {"integrator": "generalized-alpha rho=0.9"}
    with pytest.warns(newmark.NewmarkWarning, match="the march is unstable"):
        grown = errors(1e-3, sequence, auxiliary="rescale", **how)[1]
    cured = errors(1e-3, sequence, auxiliary="rescale-velocity", **how)[1]
    assert grown > 1e3 > 1e-2 > cured


@pytest.mark.usefixtures("few_draws")
@each(
    "integrator, formulation, told",
    [
        ("generalized-alpha rho=0.9", "index-3", "multiply a − v' by h_new/h and what v misses"),
        (
            "bdf2",
            "index-3",
            "for some steps. To keep it multiply what v misses of Gᵀv + Φ_t = 0 by h_new (h",
        ),
        ("trapezoidal", "index-3", "alternates for good"),
        ("generalized-alpha rho=0.9", "ggl", "multiply a − v' by h_new/h"),
        ("bdf2", "index-2", None),
    ],
)
def test_advice_says_what_keeps_the_order(integrator, formulation, told):
    """And nothing where there is none."""
    advice = newmark.advise("pendulum", h=1e-3, integrator=integrator, formulation=formulation)
    found = [text for text in advice.findings if text.startswith("when your code changes h")]
    assert len(found) == (told is not None)
    assert told is None or told in found[0]


STUDY = """study: behind
problem: pendulum
form: a-lambda
preconditioning: optimal
integrator: bdf2
h_sequence: {change: 0.5, at: 1.0}
auxiliary: [rescale-velocity, keep]
measure: [error, transient]
h: [1e-2, 5e-3, 2.5e-3]
t_end: 1.5
expect:
  - {measure: transient, quantity: lambda, auxiliary: keep, slope: 1}
"""


def test_errors_after_a_change_in_a_study(cli):
    """Orders 2 and 1 of λ; the error at the end does not show it."""
    cli.write("behind.yaml", STUDY)
    cli("run", "behind.yaml")
    rows = pd.read_csv(cli.folder / "results" / "behind.csv").query("quantity == 'lambda'")
    for auxiliary, order in (("rescale-velocity", 2), ("keep", 1)):
        of_series = rows[rows.auxiliary == auxiliary]
        behind = of_series[of_series.measure == "transient"].sort_values("h")["max"].to_numpy()
        at_end = of_series[of_series.measure == "error"].sort_values("h")["last"].to_numpy()
        assert np.log2(behind[-1] / behind[0]) / 2 == pytest.approx(order, abs=0.15)
        assert np.log2(at_end[-1] / at_end[0]) / 2 == pytest.approx(2, abs=0.15)
    told = cli("check", "behind").stdout
    assert "11 of 11 slopes as predicted" in told
    assert "1 of 1 expectations hold" in told
