"""Predictions of what a change of the step size does, against textbook recursions and marches."""

import math
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
from each import each
from scipy.integrate import solve_ivp

import newmark_cli as newmark
from newmark_cli.newmark.changes import NOTHING, POSITION, VELOCITY, Model, orders, transient
from newmark_cli.newmark.formulation import Formulation, Projection
from newmark_cli.newmark.integrator import BDF1, BDF2, HHT, GeneralizedAlpha, Newmark, parse
from newmark_cli.newmark.steps import Alternate, Change, Random
from newmark_cli.newmark.steps import parse as parse_sequence


def by_alpha(alpha_m, alpha_f, rule, steps=40):
    """|v' − x''| of generalized-α on x = t³/6, prescribed, in steps of 1 and then of 1/2."""
    gamma = Fraction(1, 2) + alpha_f - alpha_m
    beta = (gamma + Fraction(1, 2)) ** 2 / 4
    if alpha_m == 0:
        beta, gamma = (1 + alpha_f) ** 2 / 4, Fraction(1, 2) + alpha_f
    # What steps of 1 leave: v off by (γ/2 − β − 1/12) h² x‴, a by (1/2 − γ) h x‴.
    v, a, true, x, t, h = (
        gamma / 2 - beta - Fraction(1, 12),
        Fraction(1, 2) - gamma,
        Fraction(0),
        Fraction(0),
        Fraction(0),
        Fraction(1, 2),
    )
    a = {"keep": a, "restart": true}.get(rule, true + h * (a - true))
    v = v * h**2 if rule == "rescale-velocity" else v
    found = []
    for _ in range(steps):
        t += h
        new = (t**3 / 6 - x - h * v - h * h * (Fraction(1, 2) - beta) * a) / (beta * h * h)
        v += h * ((1 - gamma) * a + gamma * new)
        true = ((1 - alpha_m) * new + alpha_m * a - alpha_f * true) / (1 - alpha_f)
        x, a = t**3 / 6, new
        found.append(abs(true - t))
    return found


@each("rule", ("keep", "rescale", "restart", "rescale-velocity"))
@each(
    "integrator, alpha_m, alpha_f",
    [
        (GeneralizedAlpha(0.9), Fraction(8, 19), Fraction(9, 19)),
        (GeneralizedAlpha(0.5), Fraction(0), Fraction(1, 3)),
        (HHT(0.1), Fraction(0), Fraction(1, 10)),
        (Newmark(), Fraction(0), Fraction(0)),
    ],
)
def test_jump_and_decay(integrator, alpha_m, alpha_f, rule):
    """λ after h → h/2 in index 3: its size, and the steps to a hundredth, in exact fractions."""
    exact = by_alpha(alpha_m, alpha_f, rule, 150)
    if isinstance(integrator, GeneralizedAlpha) and integrator.rho == 0.5:
        exact = by_half(rule)
    found = transient(Model(integrator, rule, POSITION), 0.5)
    if rule == "rescale-velocity":
        assert found.order == 2
        assert max(exact[:40]) == 0
        return
    assert found.order == 1
    assert found.size == pytest.approx(float(max(exact[:40])), rel=1e-9)
    if isinstance(integrator, Newmark):
        assert found.size == pytest.approx(20)
        assert found.steps == math.inf
    else:
        last = max(k for k, off in enumerate(exact) if off > max(exact) / 100)
        assert found.steps == last + 1


def by_half(rule):
    """ρ∞ = 1/2 has α_m = 0 as HHT has, but other β and γ."""
    shifted = Fraction(1, 10**30)
    return by_alpha(shifted - shifted, Fraction(1, 3), rule, 150)


def slope_at_end(times, values):
    """Derivative of the parabola through three points at the last."""
    (r, s, t), (f, g, k) = times, values
    first, second = (g - f) / (s - r), (k - g) / (t - s)
    return second + (t - s) * (second - first) / (t - r)


@each("change", (Fraction(1, 2), Fraction(2), Fraction(5, 4)))
def test_backward_differences(change):
    """Index 3 of BDF2 and BDF1 by divided differences; v of BDF2 is off at three steps only."""
    times = [Fraction(k) for k in range(-8, 1)]
    times += [change * k for k in range(1, 41)]
    x = [t**3 / 6 for t in times]
    v = [slope_at_end(times[k : k + 3], x[k : k + 3]) for k in range(len(x) - 2)]
    w = [slope_at_end(times[k + 2 : k + 5], v[k : k + 3]) for k in range(len(v) - 2)]
    off = [abs(a - t) for a, t in zip(w, times[4:], strict=True)][5:]
    found = transient(Model(BDF2(), "keep", POSITION), float(change))
    assert (found.order, found.steps) == (1, 3)
    assert found.size == pytest.approx(float(max(off)))
    assert off[3:] == [0] * 37
    assert transient(Model(BDF2(), "rescale-velocity", POSITION), float(change)).order == 2
    x = [t**2 / 2 for t in times]
    v = [(x[k + 1] - x[k]) / (times[k + 1] - times[k]) for k in range(len(x) - 1)]
    w = [(v[k + 1] - v[k]) / (times[k + 2] - times[k + 1]) for k in range(len(v) - 1)]
    found = transient(Model(BDF1(), "keep", POSITION), float(change))
    assert (found.order, found.steps) == (0, 1)
    assert found.size == pytest.approx(float(max(abs(a - 1) for a in w)))
    assert transient(Model(BDF1(), "rescale-velocity", POSITION), float(change)).order == 1


@each("rho", (0.3, 0.5, 0.8, 0.9, 0.99))
def test_decay_is_the_spectral_radius_at_infinity(rho):
    """ρ∞ of generalized-α, a multiple root; (1 − α)/(1 + α) of HHT; 1 of the trapezoidal rule."""
    assert Model(GeneralizedAlpha(rho), "keep", POSITION).decay == pytest.approx(rho, abs=1e-4)
    alpha = 0.3 * rho
    found = Model(HHT(alpha), "keep", POSITION).decay
    assert found == pytest.approx((1 - alpha) / (1 + alpha), abs=1e-4)
    assert Model(Newmark(), "keep", VELOCITY).decay == pytest.approx(1)
    assert Model(Newmark(), "keep", NOTHING).decay == pytest.approx(0)


THROWN = {
    "points": {"O": {"fixed": (0, 0)}, "P": {"at": (1, 0), "velocity": (0, -1), "mass": 1}},
    "bars": {"rod": {"from": "O", "to": "P", "length": 1}},
    "gravity": (0, -9.81),
}


def errors(h, sequence, **options):
    """Largest errors of v and λ after t = 0.6 of a pendulum."""
    found = newmark.march(THROWN, h=h, t_end=1.2, h_sequence=sequence, **options)
    swing = solve_ivp(
        lambda t, y: [y[1], -9.81 * np.cos(y[0])], (0, found.t[-1]), [0, -1], method="DOP853",
        rtol=1e-12, atol=1e-13, t_eval=found.t,
    )  # fmt: skip
    angle, rate = swing.y
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
    """As predicted, and as measured on a pendulum; constants of generalized-α are small."""
    reported = "recovered" if projection != "none" else "newton"
    predicted = orders(
        parse(integrator), Formulation(formulation), Projection(projection), reported, auxiliary,
        parse_sequence(sequence),
    )  # fmt: skip
    assert predicted == (of_v, of_lambda)
    how = {
        "integrator": integrator, "formulation": formulation, "projection": projection,
        "auxiliary": auxiliary,
    }  # fmt: skip
    (v, multiplier), (finer_v, finer) = (errors(h, sequence, **how) for h in (1e-3, 5e-4))
    assert np.log2(v / finer_v) == pytest.approx(of_v, abs=0.35)
    assert np.log2(multiplier / finer) == pytest.approx(of_lambda, abs=0.35)


def test_a_rescaled_acceleration_alone_may_resonate():
    """Five steps of 2h, five of h/2, ρ∞ = 0.9: λ grows without bound, but not if v is scaled."""
    sequence = Alternate((2.0, 0.5), 5)
    how = (GeneralizedAlpha(0.9), Formulation(), Projection(), "newton")
    assert orders(*how, "rescale", sequence)[1] == -math.inf
    assert orders(*how, "rescale-velocity", sequence) == (2, 2)
    how = {"integrator": "generalized-alpha rho=0.9"}
    with pytest.warns(newmark.NewmarkWarning, match="the march is unstable"):
        grown = errors(1e-3, sequence.label, auxiliary="rescale", **how)[1]
    cured = errors(1e-3, sequence.label, auxiliary="rescale-velocity", **how)[1]
    assert grown > 1e3 > 1e-2 > cured


def test_what_random_changes_leave_walks():
    """Without damping λ keeps what each change leaves, of random signs: half an order less."""
    how = (Newmark(), Formulation("ggl"), Projection(), "newton", "keep")
    assert orders(*how, Random((0.5, 2.0), 5)) == (2, 1.5)
    assert orders(*how, Change(0.5, 1.0)) == (2, 2)


@pytest.mark.usefixtures("few_draws")
@each(
    "integrator, formulation, told",
    [
        ("generalized-alpha rho=0.9", "index-3", "a hundredth of that 88 steps later"),
        ("bdf2", "index-3", "a hundredth of that 3 steps later"),
        ("trapezoidal", "index-3", "alternates for good"),
        ("generalized-alpha rho=0.9", "ggl", "multiply a − v' by h_new/h"),
        ("bdf2", "index-2", None),
    ],
)
def test_advice_says_how_long_a_transient_lasts(integrator, formulation, told):
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
"""


def test_errors_after_a_change_in_a_study(cli):
    """Orders 2 and 1 of λ, as `check` predicts; the error at the end does not show it."""
    cli.write("behind.yaml", STUDY)
    cli("run", "behind.yaml")
    rows = pd.read_csv(cli.folder / "results" / "behind.csv").query("quantity == 'lambda'")
    for auxiliary, order in (("rescale-velocity", 2), ("keep", 1)):
        of_series = rows[rows.auxiliary == auxiliary]
        behind = of_series[of_series.measure == "transient"].sort_values("h")["max"].to_numpy()
        at_end = of_series[of_series.measure == "error"].sort_values("h")["last"].to_numpy()
        assert np.log2(behind[-1] / behind[0]) / 2 == pytest.approx(order, abs=0.15)
        assert np.log2(at_end[-1] / at_end[0]) / 2 == pytest.approx(2, abs=0.15)
    assert "12 of 12 slopes as predicted" in cli("check", "behind").stdout
