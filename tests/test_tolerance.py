"""Stopping at a tolerance: who meets it, after how many corrections, and what it says."""

import numpy as np
from conftest import QUICK, rows_in
from covering import covering
from each import each
from marching import march

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import compiled_march, scipy_march
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme, Tolerance

ENGINES = each("engine", [compiled_march, scipy_march])


def literal_steps(subject, h, steps, cap, field, scaled, absolute, relative):
    """The trapezoidal rule, written out in u: corrections per step, negative where unmet.

    Newton stops once a correction, applied, is at most absolute + relative times the
    norm of what it led to, both in the unknowns of the form that keeps one of u, v, a
    beside λ: divided by Table 2's factors, or as they are.
    """
    beta, gamma = 0.25, 0.5
    rate = {"u": 1.0, "v": gamma / (beta * h), "a": 1 / (beta * h**2)}[field]
    left, right = (beta * h**2, 1 / (beta * h**2)) if scaled else (1.0, 1.0)
    unit = {"u": 1.0, "v": 1 / (gamma * h), "a": 1 / (beta * h**2)}[field] if scaled else 1.0
    n, m, mass = subject.n, subject.m, subject.M
    start = initial_state(
        subject, Scheme(Newmark(), FORMS["u-lambda"], named_scaling("none", FORMS["u-lambda"]), h)
    )
    (u, v, a), multipliers = start.fields[:3].copy(), start.multipliers.copy()
    counts = []
    for _ in range(steps):
        u_n, v_n, a_n = u, v, a
        u = u_n + h * v_n
        a = -(1 / (2 * beta) - 1) * a_n
        v = v_n + h * ((1 - gamma) * a_n + gamma * a)
        met, count = False, 0
        while not met and count < cap:
            terms = subject.evaluate(0.0, u, v, multipliers)
            tangent = terms.X + gamma / (beta * h) * terms.Y + mass / (beta * h**2)
            jacobian = np.block([
                [left * tangent, -left * right * terms.G], [terms.G.T, np.zeros((m, m))]
            ])  # fmt: skip
            correction = np.linalg.solve(
                jacobian, -np.concatenate([left * (mass @ a - terms.force), terms.phi])
            )
            u = u + correction[:n]
            multipliers = multipliers + right * correction[n:]
            a = (u - u_n - h * v_n) / (beta * h**2) - (1 / (2 * beta) - 1) * a_n
            v = v_n + h * ((1 - gamma) * a_n + gamma * a)
            kept = {"u": u, "v": v, "a": a}[field]
            size = np.hypot(np.linalg.norm(kept / unit), np.linalg.norm(multipliers / right))
            step = np.hypot(
                np.linalg.norm(correction[:n] * rate / unit), np.linalg.norm(correction[n:])
            )
            met = step <= absolute + relative * size
            count += 1
        counts.append(count if met else -count)
    return counts, u, multipliers


@ENGINES
@each(
    ("subject", "field", "scaled", "tolerance", "cap"),
    covering(
        [("pendulum", 1e-1), ("andrews", 3e-4)],
        ["u", "v", "a"],
        [False, True],
        [(1e-3, 0.0), (1e-6, 0.0), (0.0, 1e-4), (0.0, 1e-7), (1e-5, 1e-5)],
        [2, 3, 20],
    ),
)
def test_rule(subject, field, scaled, tolerance, cap, engine):
    """Corrections of every step, met or not, and where they lead, against the rule written out."""
    (name, h), (absolute, relative) = subject, tolerance
    subject, form, steps = problem(name), FORMS[f"{field}-lambda"], 20
    expected, u, multipliers = literal_steps(
        subject, h, steps, cap, field, scaled, absolute, relative
    )
    scaling = named_scaling("optimal" if scaled else "none", form)
    scheme = Scheme(
        Newmark(), form, scaling, h, iteration_cap=cap, stop=Tolerance(absolute, relative)
    )
    state = initial_state(subject, scheme)
    _, iterations = march(engine, subject, scheme, state, 0, steps)
    assert iterations.tolist() == expected
    np.testing.assert_allclose(state.fields[0], u, rtol=0, atol=1e-9 * np.abs(u).max())
    size = np.abs(multipliers).max()
    np.testing.assert_allclose(state.multipliers, multipliers, rtol=0, atol=1e-6 * size)


# Configs and results


STOPPED = QUICK + "measure: [condition, tolerance]\nstop: {absolute: 1e-8}\n"


def rows(cli):
    return rows_in(cli.folder / "results/quick.csv")


def test_rows_say_what_was_met(cli):
    """Steps that met it, corrections computed; empty where rounding stops Newton."""
    cli.write("quick.yaml", STOPPED)
    cli("run", "quick.yaml")
    for row in rows(cli):
        assert (row["stop"], row["met"], row["status"]) == ("absolute 1e-08", row["steps"], "ok")
        if row["measure"] == "tolerance":
            assert row["quantity"] == "newton"
            mean = float(row["newton_iterations"])
            assert 1 <= float(row["median"]) <= float(row["max"]) <= 20
            assert float(row["rms"]) >= mean > 1
    cli.write("quick.yaml", QUICK)
    cli("run", "quick.yaml")
    assert {(row["stop"], row["met"]) for row in rows(cli)} == {("saturation", "")}


def test_accepted_statuses_do_not_fail_a_run(cli):
    """Steps that miss the tolerance end the run with 1, unless the study is about them."""
    missed = STOPPED.replace("{absolute: 1e-8}", "{absolute: 1e-8}\niteration_cap: 2")
    cli.write("quick.yaml", missed)
    cli("run", "quick.yaml", code=1)
    refused = rows(cli)
    cli.write("quick.yaml", missed + "accept: not_converged\n")
    cli("run", "quick.yaml")
    accepted = rows(cli)
    assert refused == accepted
    statuses = {row["status"] for row in accepted}
    assert "not_converged" in statuses
    for row in accepted:
        assert int(row["met"]) + int(row["not_converged"]) == int(row["steps"])
    cli.write("quick.yaml", missed + "accept: [singular, diverged]\n")
    cli("run", "quick.yaml", code=1)
    cli.write("quick.yaml", missed + "accept: ok\n")
    assert "line 10: accept: unknown status 'ok'" in cli.refused("run", "quick.yaml")
