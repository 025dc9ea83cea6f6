"""Stopping at a tolerance: who meets it, after how many corrections, and what it says."""

from dataclasses import replace

import numpy as np
from conftest import QUICK, rows_in
from covering import covering
from each import each
from marching import ENGINES, march

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.march import March, initial_state
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme, Tolerance
from newmark_cli.study import keys


def literal_steps(subject, h, steps, cap, field, scaled, stop):
    """The trapezoidal rule, written out in u: corrections per step, negative where unmet.

    Newton stops by the test of ``stop``, in the unknowns of the form that keeps one of u, v, a
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

    def residual():
        """(n + m,) of rows D and C before scaling."""
        terms = subject.evaluate(0.0, u, v, multipliers)
        return np.concatenate([mass @ a - terms.force, terms.phi]), terms

    def looked_at(correction, now):
        """What the test looks at, and what it is relative to."""
        if stop.test == "residual":
            return np.linalg.norm(residual()[0]), np.linalg.norm(first)
        kept = {"u": u, "v": v, "a": a}[field]
        return (
            np.hypot(np.linalg.norm(correction[:n] * rate / unit), np.linalg.norm(correction[n:])),
            np.hypot(np.linalg.norm(kept / unit), np.linalg.norm(multipliers / right)),
        )

    def meets(correction, before, now):
        if stop.test != "field":
            size, of = looked_at(correction, now)
            return size <= stop.absolute + stop.relative * of
        return all(
            np.sqrt(np.mean(((now[name] - before[name]) / (x + y * np.abs(now[name]))) ** 2)) <= 1
            for name, x, y in stop.fields
        )

    counts = []
    for _ in range(steps):
        u_n, v_n, a_n = u, v, a
        u = u_n + h * v_n
        a = -(1 / (2 * beta) - 1) * a_n
        v = v_n + h * ((1 - gamma) * a_n + gamma * a)
        first = residual()[0]
        met, count = False, 0
        while not met and count < cap:
            b, terms = residual()
            before = {"u": u, "v": v, "a": a, "lambda": multipliers}
            tangent = terms.X + gamma / (beta * h) * terms.Y + mass / (beta * h**2)
            jacobian = np.block([
                [left * tangent, -left * right * terms.G], [terms.G.T, np.zeros((m, m))]
            ])  # fmt: skip
            correction = np.linalg.solve(jacobian, -np.concatenate([left * b[:n], b[n:]]))
            u = u + correction[:n]
            multipliers = multipliers + right * correction[n:]
            a = (u - u_n - h * v_n) / (beta * h**2) - (1 / (2 * beta) - 1) * a_n
            v = v_n + h * ((1 - gamma) * a_n + gamma * a)
            met = meets(correction, before, {"u": u, "v": v, "a": a, "lambda": multipliers})
            count += 1
        # The march tests a residual before the next correction: of the last one it is not known.
        met = met and not (stop.test == "residual" and count == cap)
        counts.append(count if met else -count)
    return counts, u, multipliers


@each("engine", ENGINES)
@each(
    ("subject", "field", "scaled", "stop", "cap"),
    covering(
        [("pendulum", 1e-1), ("andrews", 3e-4)],
        ["u", "v", "a"],
        [False, True],
        [
            Tolerance(1e-3), Tolerance(1e-6), Tolerance(0.0, 1e-4), Tolerance(0.0, 1e-7),
            Tolerance(1e-5, 1e-5),
            *(Tolerance(x, y, "residual") for x, y in ((0.0, 1e-3), (0.0, 1e-7), (1e-4, 0.0))),
            Tolerance(test="field", fields=(("u", 1e-9, 1e-4),)),
            Tolerance(test="field", fields=(("a", 1e-6, 1e-3), ("lambda", 1e-6, 1e-5))),
            Tolerance(test="field", fields=(("v", 1e-6, 0.0), ("lambda", 0.0, 1e-2))),
        ],
        [2, 3, 20],
    ),
)  # fmt: skip
def test_rule(subject, field, scaled, stop, cap, engine):
    """Corrections of every step, met or not, and where they lead, against the rule written out."""
    (name, h), steps = subject, 20
    subject, form = problem(name), FORMS[f"{field}-lambda"]
    expected, u, multipliers = literal_steps(subject, h, steps, cap, field, scaled, stop)
    scaling = named_scaling("optimal" if scaled else "none", form)
    scheme = Scheme(Newmark(), form, scaling, h, iteration_cap=cap, stop=stop)
    state = initial_state(subject, scheme)
    _, iterations = march(engine, subject, scheme, state, 0, steps)
    assert iterations.tolist() == expected
    np.testing.assert_allclose(state.fields[0], u, rtol=0, atol=1e-9 * np.abs(u).max())
    size = np.abs(multipliers).max()
    np.testing.assert_allclose(state.multipliers, multipliers, rtol=0, atol=1e-6 * size)


@each("formulation", ["index-2", "index-1", "ggl", "baumgarte rate=10", "augmented-lagrangian"])
def test_engines_agree(formulation):
    """Dense and sparse marches meet every test after the same corrections, and the test matters."""
    subject, formulation = problem("four-bar"), Formulation.parse(formulation)
    form, counts = formulation.applied(FORMS["a-lambda"]), []
    fields = (("u", 1e-12, 1e-9), ("lambda", 1e-9, 1e-7))
    for stop in (
        Tolerance(1e-3), Tolerance(0.0, 1e-4, "residual"), Tolerance(test="field", fields=fields),
    ):  # fmt: skip
        scheme = Scheme(
            Newmark(), form, named_scaling("optimal", form), 1e-3, iteration_cap=9, stop=stop,
            formulation=formulation,
        )  # fmt: skip
        engines = [March(subject, scheme, solver) for solver in ("dense-lu", "sparse-lu")]
        dense, sparse = (march.advance(30).iterations.tolist() for march in engines)
        assert dense == sparse
        counts.append(dense)
    assert len({tuple(each) for each in counts}) > 1


def test_floor_predicts_where_increments_of_lambda_cannot_be_small():
    """Δλ ≤ 1e-4 |λ| + 1e-10 within six corrections, Chrono's test of λ, with its integrator.

    All steps meet it at twice the step size where the floor of Δλ reaches it, not all at half.
    """
    thrown = replace(problem("pendulum"), v0=np.array([0.0, -1.0]))
    options = {"form": "a-lambda", "integrator": "hht alpha=0.2"}
    size = abs(newmark.march(thrown, h=1e-6, steps=1, **options).multipliers[0, 0])
    floor = newmark.floor(thrown, h=1e-6, **options).physical["lambda"]
    least = 1e-6 * np.sqrt(floor / (1e-4 * size + 1e-10))
    stop = {"lambda": {"absolute": 1e-10, "relative": 1e-4}}
    missed = [
        newmark.march(
            thrown,
            h=float(factor * least),
            steps=4000,
            stop=stop,
            iteration_cap=6,
            every=0,
            **options,
        ).not_converged
        for factor in (2, 0.5)
    ]
    assert missed[0] == 0 < missed[1]


# Configs and results


STOPPED = QUICK + "measure: [condition, tolerance]\nstop: {absolute: 1e-8}\n"


@each(
    "label",
    [
        "absolute 1e-08", "absolute 1e-08 relative 0.001", "residual relative 1e-08",
        "a absolute 1e-10 relative 0.0001 lambda relative 0.0001",
    ],
)  # fmt: skip
def test_labels_parse_back(label):
    """What the column of a CSV has is what a config may say."""
    stop = keys.read("stop", label, keys.StopConfig)
    assert stop.label == label
    assert keys.read("stop", f"tolerance {label}", keys.StopConfig) == stop


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
