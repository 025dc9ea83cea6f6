"""Stopping at a tolerance: who meets it, after how many corrections, and what it says."""

import numpy as np
import pytest
from conftest import QUICK, rows_in
from covering import covering
from marching import ENGINES, march, scheme_of

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import newton
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.scheme import Tolerance
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
    start = initial_state(subject, scheme_of("u-lambda", "none", h))
    now = dict(zip("uva", start.fields[:3].copy(), strict=True)) | {"lambda": start.multipliers}

    def moved(u, old):
        """V and K solved for v and a."""
        a = (u - old["u"] - h * old["v"]) / (beta * h**2) - (1 / (2 * beta) - 1) * old["a"]
        return {"u": u, "v": old["v"] + h * ((1 - gamma) * old["a"] + gamma * a), "a": a}

    def residual():
        """(n + m,) of rows D and C before scaling."""
        terms = subject.evaluate(0.0, now["u"], now["v"], now["lambda"])
        return np.concatenate([mass @ now["a"] - terms.force, terms.phi]), terms

    def meets(correction, before):
        if stop.test == "field":
            return all(
                np.sqrt(np.mean(((now[name] - before[name]) / (x + y * np.abs(now[name]))) ** 2))
                <= 1
                for name, x, y in stop.fields
            )
        if stop.test == "residual":
            size, of = np.linalg.norm(residual()[0]), np.linalg.norm(first)
        else:
            size = np.linalg.norm([*(correction[:n] * rate / unit), *correction[n:]])
            of = np.linalg.norm([*(now[field] / unit), *(now["lambda"] / right)])
        return size <= stop.absolute + stop.relative * of

    counts = []
    for _ in range(steps):
        old = now
        now = moved(old["u"] + h * old["v"], old) | {"lambda": old["lambda"]}
        first = residual()[0]
        met, count = False, 0
        while not met and count < cap:
            (b, terms), before = residual(), now
            tangent = terms.X + gamma / (beta * h) * terms.Y + mass / (beta * h**2)
            jacobian = np.block([
                [left * tangent, -left * right * terms.G], [terms.G.T, np.zeros((m, m))]
            ])  # fmt: skip
            correction = np.linalg.solve(jacobian, -np.concatenate([left * b[:n], b[n:]]))
            multipliers = now["lambda"] + right * correction[n:]
            now = moved(now["u"] + correction[:n], old) | {"lambda": multipliers}
            met = meets(correction, before)
            count += 1
        # The march tests a residual before the next correction: of the last one it is not known.
        met = met and not (stop.test == "residual" and count == cap)
        counts.append(count if met else -count)
    return counts, now["u"], now["lambda"]


@pytest.mark.parametrize(
    ("subject", "field", "scaled", "stop", "cap", "engine"),
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
        ENGINES,
    ),
)  # fmt: skip
def test_rule(subject, field, scaled, stop, cap, engine):
    """Corrections of every step, met or not, and where they lead, against the rule written out."""
    (name, h), steps = subject, 20
    subject = problem(name)
    expected, u, multipliers = literal_steps(subject, h, steps, cap, field, scaled, stop)
    variant = "optimal" if scaled else "none"
    scheme = scheme_of(f"{field}-lambda", variant, h, iteration_cap=cap, stop=stop)
    state = initial_state(subject, scheme)
    _, iterations = march(engine, subject, scheme, state, 0, steps)
    assert iterations.tolist() == expected
    np.testing.assert_allclose(state.fields[0], u, rtol=0, atol=1e-9 * np.abs(u).max())
    size = np.abs(multipliers).max()
    np.testing.assert_allclose(state.multipliers, multipliers, rtol=0, atol=1e-6 * size)


@pytest.mark.parametrize(
    ("changes", "met"),
    [((0.9, 0.9, 0.9, 0.9), True), ((1.1, 1.1, 1.1, 1.1), False), ((1.9, 0, 0, 0), True),
     ((0, 0, -2.1, 0), False)],
)  # fmt: skip
def test_the_size_of_a_change_is_a_root_mean_square(changes, met):
    """Over the components, each over absolute + relative |now|."""
    now = np.array([1.0, -20.0, 300.0, 0.0])
    last = now - changes * (1e-6 + 1e-3 * np.abs(now))
    assert newton._changed_little.py_func((1e-6, 1e-3), last, now) == met


@pytest.mark.parametrize("engine", ENGINES)
def test_terminal_phase_needs_two_small_corrections(engine):
    """The first correction of the pendulum at h = 1e-4 is h²/2, no rounding; never recorded."""
    subject, scheme = problem("pendulum"), scheme_of("u-lambda", "none", 1e-4)
    norms, _ = march(engine, subject, scheme, initial_state(subject, scheme), 0, 100)
    assert norms[:, 0].max() < 1e-15


# Configs and results


STOPPED = QUICK + "measure: [condition, tolerance]\nstop: {absolute: 1e-8}\n"


@pytest.mark.parametrize(
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


def test_rows_say_what_was_met(cli):
    """Steps that met it, corrections computed; a run in which some missed it ends with 1."""
    for more, cap, code in (("", 20, 0), ("iteration_cap: 2\n", 2, 1)):
        cli.write("quick.yaml", STOPPED + more)
        cli("run", "quick.yaml", code=code)
        rows = rows_in(cli.folder / "results/quick.csv")
        for row in rows:
            missed = int(row["steps"]) - int(row["met"])
            assert (row["stop"], int(row["not_converged"])) == ("absolute 1e-08", missed)
            if row["measure"] == "tolerance":
                assert row["quantity"] == "newton"
                mean = float(row["newton_iterations"])
                assert 1 <= float(row["median"]) <= float(row["max"]) <= cap
                assert float(row["rms"]) >= mean > 1
        assert ("not_converged" in {row["status"] for row in rows}) == (code == 1)
    cli.write("quick.yaml", QUICK)
    cli("run", "quick.yaml")
    rows = rows_in(cli.folder / "results/quick.csv")
    assert {(row["stop"], row["met"]) for row in rows} == {("saturation", "")}
