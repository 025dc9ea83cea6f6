"""Rounding as twins tell it, beside marches in 40 digits, and what studies make of it."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from mpmath import MPContext

import newmark_cli as newmark
from newmark_cli.newmark.statistics import standard_error
from newmark_cli.problems.reference import Reference
from newmark_cli.study.measures import MEASURES
from newmark_cli.study.observers import OBSERVERS
from newmark_cli.support.errors import ArgumentError

mp = MPContext()
mp.dps = 40


def exact_pendulum(u, v, h, steps, keeps=False):
    """The trapezoidal rule on the unit pendulum, without rounding: its step has a closed form.

    u' = w + c λ u' with c = h²/4 and what is known in w; |u'| = L gives λ = (1 − |w|/L)/c.  L is 1,
    or, if the march keeps it, what the machine numbers of the start have.
    """
    u, v, g = (np.array([mp.mpf(float(x)) for x in z]) for z in (u, v, (0, -1)))
    length = mp.sqrt(u @ u) if keeps else mp.mpf(1)
    h = mp.mpf(h)
    c = h * h / 4
    a = g - u * (u @ g + v @ v) / (u @ u)
    for _ in range(steps):
        w = u + h * v + c * a + c * g
        size = mp.sqrt(w @ w) / length
        u, multiplier = w / size, (1 - size) / c
        new = g + multiplier * u
        v, a = v + h / 2 * (a + new), new
    return {"u": u, "v": v, "lambda": np.array([multiplier])}


def swung(h, angle, **options):
    """A march of a pendulum that is thrown, with three twins; and the same without rounding."""
    start = {"u0": [np.cos(angle), -np.sin(angle)], "v0": [np.sin(angle), np.cos(angle)]}
    found = newmark.march(
        "pendulum", h=h, t_end=0.6, every=0, twins=3, project=True, **start, **options
    )
    begin = found.problem
    return found, lambda **keeps: exact_pendulum(begin.u0, begin.v0, h, found.steps, **keeps)


def largest_off(exact, found, name):
    """Of a quantity at the end."""
    return max(abs(float(e - x)) for e, x in zip(exact[name], found[name], strict=True))


@pytest.mark.parametrize(("evaluation", "h", "angle"), [
    ("direct", 3e-2, 0.3), ("direct", 1e-2, 1.0), ("direct", 3e-3, 0.0), ("direct", 1e-3, 0.3),
    ("compensated", 3e-2, 1.0), ("compensated", 1e-2, 0.3), ("compensated", 1e-3, 0.0),
])  # fmt: skip
def test_twins_tell_rounding_to_a_factor(evaluation, h, angle):
    """Of u, v and λ at the end of a swing: the true rounding is rarely ten times as large."""
    compensated = evaluation == "compensated"
    found, without_rounding = swung(h, angle, evaluation=evaluation)
    exact, ends = without_rounding(keeps=compensated), {n: x[-1] for n, x in found.arrays.items()}
    # Three twins differ by two places of u at least, where rounding is half of one.
    least = 0.005 if compensated else 0.02
    for name in ("u", "v", "lambda"):
        off, told = largest_off(exact, ends, name), found.rounding[name].max()
        assert least * told < off < 10 * told, (name, off, told)
    if compensated:
        u = [mp.mpf(float(x)) for x in found.problem.u0]
        missed = abs(float((u[0] ** 2 + u[1] ** 2 - 1) / 2))
        # v is off by Φ₀/(h/2) along the rod, and a by twice that over h/2 more in every step.
        put_right = largest_off(without_rounding(), exact, "lambda")
        assert put_right == pytest.approx(missed * found.steps * 8 / h**2, rel=0.1)


@pytest.mark.parametrize(
    ("problem", "more"),
    [("pendulum", {}), ("shaken-pendulum", {"h_sequence": {"change": 0.5, "at": 0.2}})],
)
def test_twins_are_other_marches_of_the_same_problem(problem, more):
    """They differ in the last places; what they differ by is the spread; the march is the march."""
    options = {"h": 1e-2, "t_end": 0.5, "every": 25, **more}
    plain, found = (newmark.march(problem, **options, twins=count) for count in (0, 3))
    assert (found.energy is None) == (problem == "shaken-pendulum")
    np.testing.assert_array_equal(plain.u, found.u)
    assert len(plain.twins) == 0
    assert plain.rounding == {}
    assert len(found.twins) == 3
    for twin in found.twins:
        assert 0 < abs(twin.u - found.u).max() < 1e-13
    of_u = np.std([found.u, *(twin.u for twin in found.twins)], axis=0, ddof=1)
    np.testing.assert_array_equal(found.rounding["u"], of_u)
    again = newmark.march(problem, **options, twins=3)
    np.testing.assert_array_equal(found.rounding["lambda"], again.rounding["lambda"])


@pytest.mark.parametrize("options", [{"steps": True}, {"callback": print}])
def test_twins_of_what_has_none(options):
    """A loop, a callback: refused in one line."""
    with pytest.raises(ArgumentError, match="twins: not with steps=True, callback or state"):
        newmark.march("pendulum", h=1e-2, t_end=0.5, twins=1, **options)


STUDY = """study: swing
problem: pendulum
form: u-lambda
preconditioning: optimal
measure: [error, invariant, correction, condition]
h: [1e-2, 5e-3]
t_end: 0.5
"""


def test_the_column_rounding(tmp_path):
    """Errors as `march` tells them; corrections by blocks; of condition numbers nothing."""
    keys, frames = ["h", "measure", "quantity"], {}
    for name, more in (("usual", ""), ("none", "twins: 0\n"), ("five", "twins: 5\n")):
        (tmp_path / "swing.yaml").write_text(STUDY + more)
        frames[name] = newmark.run(tmp_path / "swing.yaml", results=tmp_path / name)
        pd.testing.assert_frame_equal(
            frames["usual"].drop(columns="rounding"), frames[name].drop(columns="rounding"),
            check_exact=True,
        )  # fmt: skip
    frame = frames["usual"]
    told = frame.set_index(keys)["rounding"]
    for h in (1e-2, 5e-3):
        found = newmark.march("pendulum", h=h, t_end=0.5, every=0, twins=3)
        for name in ("u", "v"):
            size = abs(found.arrays[name][-1]).max()
            assert told[h, "error", name] == pytest.approx(
                found.rounding[name].max() / size, rel=1e-3
            )
        assert 0 < told[h, "invariant", "position"] < 1e-12
        assert np.isnan(told[h, "condition", "jacobian"])
    share = told / frame.set_index(keys)["rms"]
    assert share[:, "correction", :].between(0.01, 0.5).all()
    twinned = frame["measure"].isin([name for name, each in MEASURES.items() if each.twins])
    assert twinned.sum() == 2 * 7
    assert frames["none"]["rounding"][twinned].isna().all()
    assert (frames["five"]["rounding"] != frame["rounding"])[twinned].sum() > 12


def test_the_error_of_the_reference_counts():
    """A value cannot be known better than what it is compared with."""
    off = Reference(1.0, *(np.ones(2),) * 4, "converged", 1e-9, 1e-8, 1e-7)
    observer = OBSERVERS["error"](SimpleNamespace(steps=1), SimpleNamespace(problem=None), off)
    told = [observer.unresolved(name) for name in ("u", "v", "lambda", "omega", "force")]
    assert told == [1e-9, 1e-8, 1e-7, 1e-8, 1e-7]


def test_the_error_of_an_rms_of_independent_steps():
    """Of normal numbers it is 1/√(2N), as a textbook has it; of neighbours alike it is larger."""
    random = np.random.default_rng(5)
    draws = [np.abs(random.normal(size=400)) for _ in range(60)]
    told = [standard_error(values) / np.sqrt(np.mean(values**2)) for values in draws]
    assert np.mean(told) == pytest.approx(1 / np.sqrt(800), rel=0.1)
    alike = [np.repeat(values[::20], 20) for values in draws]
    told = [standard_error(values) / np.sqrt(np.mean(values**2)) for values in alike]
    assert np.mean(told) == pytest.approx(1 / np.sqrt(40), rel=0.25)
