"""Integrators of a user's own: a class in a file, and any object in the library."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import newmark_cli as newmark
from newmark_cli.newmark import own_integrator
from newmark_cli.newmark.integrator import (
    BDF1,
    BDF2,
    HHT,
    Alpha,
    GeneralizedAlpha,
    IntegratorError,
    Newmark,
    fading,
)
from newmark_cli.newmark.integrator_labels import parse, plain_label
from newmark_cli.study.axes import means, named

MINE = """
import numpy as np


class Bossak:
    alpha, gamma, beta = -0.1, 0.6, 0.3025

    def relations(self, h):
        return {
            "v_from_a": self.gamma * h, "u_from_a": self.beta * h * h,
            "v_past": [0, 1, (1 - self.gamma) * h], "u_past": [1, h, (0.5 - self.beta) * h * h],
            "acceleration": [1 - self.alpha, 0, 0, self.alpha],
            "advance": ["u", "v", "a"], "start": np.eye(3),
        }


class Off(Bossak):
    gamma, beta, order = 0.61, 0.31, 2


class Growing(Bossak):
    beta = 0.2


class Broken:
    def relations(self, h):
        return 1 / 0


class Uneven(Bossak):
    def relations(self, h):
        return super().relations(h) | {"u_from_a": self.beta * h}


class Short(Bossak):
    def relations(self, h):
        return super().relations(h) | {"v_past": [0, 1]}


class Lacking(Bossak):
    def relations(self, h):
        return {"v_from_a": h}


class Still(Bossak):
    def relations(self, h):
        return super().relations(h) | {"v_past": [0, 0, 0]}


class Nothing:
    pass
"""
CONFIG = """
study: own
problem: pendulum
integrator: [%s]
form: [u-lambda, a-lambda, u-v-a-lambda]
preconditioning: optimal
formulation: [index-3, ggl]
h: [1e-2, 5e-3, 2e-3]
t_end: 0.3
evaluation: compensated
measure: error
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A folder with the classes, and what writes a config of some."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(MINE)

    def written(*names):
        (tmp_path / "own.yaml").write_text(CONFIG % ", ".join(names))
        return "own.yaml"

    return written


@pytest.mark.parametrize(
    "integrator",
    [Newmark(), Newmark(0.31, 0.61), GeneralizedAlpha(0.5), HHT(0.1), Alpha(0.3025, 0.6, -0.1, 0),
     BDF1(), BDF2()],
)  # fmt: skip
def test_what_is_known_of_an_integrator_follows_from_its_relations(integrator):
    """Order, ρ∞, β and γ, and coefficients at any h, of those whose values are known."""
    found = own_integrator.of("mine.py:Mine", integrator)
    assert found.order == integrator.order
    assert found.damped == integrator.damped
    assert fading(found) == pytest.approx(fading(integrator), abs=1e-9)
    for h in (1.0, 3e-4):
        assert found.symbols(h) == pytest.approx(integrator.symbols(h), rel=1e-14)
        one, other = vars(found.relations(h)), vars(integrator.relations(h))
        assert all(np.allclose(one[name], other[name], rtol=1e-14, atol=0) for name in other)
    assert parse(found.label) == found


@pytest.mark.parametrize(
    "text",
    [
        "alpha beta=0.3025 gamma=0.6 alpha_m=-0.1 alpha_f=0",
        "alpha beta=3025e-4 gamma=.6 alpha_m=-0.10 alpha_f=0.0",
        "alpha (β = 0.3025, γ = 0.6, α_m = -0.1, α_f = 0.0)",
    ],
)
def test_a_member_is_known_by_any_way_to_write_its_numbers(text):
    assert plain_label(text) == "alpha beta=0.3025 gamma=0.6 alpha_m=-0.1 alpha_f=0.0"
    assert parse(text) == Alpha(0.3025, 0.6, -0.1, 0.0)
    label = "alpha beta=0.3025 gamma=0.6 alpha_m=-0.1 alpha_f=0.0"
    assert means("integrator", text, label)
    assert not means("integrator", text, label.replace("0.6", "0.61"))


def test_legends_have_six_digits_by_which_a_member_is_found():
    label = f"alpha beta={25 / 81} gamma={11 / 18} alpha_m={-1 / 9} alpha_f=0.0"
    text = "alpha (β = 0.308642, γ = 0.611111, α_m = −0.111111, α_f = 0)"
    assert named("integrator").text(label) == text
    assert means("integrator", text, label)


@pytest.mark.usefixtures("few_draws")
def test_advice_takes_a_class(cli, own):
    """Condition numbers are those of the member that the class is."""
    own("mine.py:Bossak")
    command = ("advise", "pendulum", "--h", "1e-3", "--integrator")
    member = "alpha beta=0.3025 gamma=0.6 alpha_m=-0.1 alpha_f=0"
    outputs = [
        cli(*command, *how).stdout for how in (("mine.py:Bossak", "--allow-code"), (member,))
    ]
    # The first line of h = 0.001 has condition numbers; later ones have measured rounding.
    found, wanted = (
        next(line for line in text.splitlines() if line.split()[:1] == ["0.001"])
        for text in outputs
    )
    assert found == wanted
    assert found.split()[-1] == "2.618"
    assert "--allow-code" in cli(*command, "mine.py:Bossak", code=2).stderr
    label = "mine.py:Bossak order=2 rho=0.5 beta=0.3025 gamma=0.6 digest=0123456789ab"
    told = cli(*command, label, code=2).stderr
    assert "mine.py:Bossak: is code, which runs only with --allow-code" in told


def test_a_class_is_a_method_of_a_study(cli, own):
    """Orders of three forms and two formulations are predicted; `check` runs no code."""
    config = own(
        "mine.py:Bossak", "mine.py:Off", "alpha beta=0.3025 gamma=0.6 alpha_m=-0.1 alpha_f=0"
    )
    done = cli("run", config, code=2)
    assert "own.yaml, line 4: integrator" in done.stderr
    assert "mine.py is code, which runs only with --allow-code" in done.stderr
    done = cli("run", config, "--allow-code")
    assert "mine.py:Off: order = 2 is stated, and its relations have order 1" in done.stderr
    frame = pd.read_csv("results/own.csv")
    label = frame["integrator"].str.split().str[0]
    keys = ["form", "formulation", "h", "quantity"]
    ours, theirs = (
        frame[label == name].set_index(keys)["max"] for name in ("mine.py:Bossak", "alpha")
    )
    assert len(ours) == 3 * 2 * 3 * 3
    assert np.allclose(ours.to_numpy(), theirs[ours.index].to_numpy(), rtol=1e-4, atol=1e-12)
    # Orders of γ = 0.61 are told from 1 only at smaller step sizes: they are no miss.
    assert "as predicted" in cli("check").stdout


def test_a_changed_class_is_another_integrator(cli, own):
    config = own("mine.py:Bossak")
    Path(config).write_text(Path(config).read_text().replace("[index-3, ggl]", "index-3"))
    digests = set()
    for beta in ("0.3025", "0.31", "0.3025"):
        Path("mine.py").write_text(MINE.replace("0.3025", beta))
        done = cli("run", config, "--allow-code")
        digests.add(Path("results/own.csv").read_text().split("digest=")[1][:12])
    assert len(digests) == 2
    assert "9 cached" in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Growing", "mine.py:Growing: multipliers would grow by a factor of 3.3508 in every step"),
        ("Broken", "mine.py, line 27: ZeroDivisionError"),
        ("Uneven", "u_from_a at h = 0.5 is not that of h = 1 times a power of h"),
        ("Short", "v_past has shape (2,), must have (3,)"),
        ("Lacking", "relations lack u_from_a, v_past, u_past, acceleration, advance, start"),
        ("Still", "does not converge"),
        ("Nothing", "has no method relations(h)"),
        ("Missing", "mine.py has no class Missing"),
    ],
)
def test_what_is_no_integrator_is_refused_in_a_line(cli, own, name, said):
    done = cli("validate", own(f"mine.py:{name}"), "--allow-code", code=2)
    assert "own.yaml, line 4: integrator" in done.stderr
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


class Bossak:
    """Wood, Bossak and Zienkiewicz's method, as a caller of the library writes it."""

    def relations(self, h):
        """Its update relations."""
        relations = Alpha(0.3025, 0.6, -0.1, 0.0).relations(h)
        return vars(relations)


class TwoSteps:
    """BDF2, likewise."""

    def relations(self, h):
        """Its update relations."""
        return vars(BDF2().relations(h))


def test_the_library_takes_a_class_or_an_object():
    wanted = newmark.march("pendulum", h=1e-2, t_end=0.1, integrator=Alpha(0.3025, 0.6, -0.1, 0.0))
    for given in (Bossak, Bossak()):
        found = newmark.march("pendulum", h=1e-2, t_end=0.1, integrator=given)
        assert np.allclose(found.u, wanted.u, rtol=1e-14)
    changing = {"h": 1e-2, "t_end": 0.1, "h_sequence": "change 0.5 at 0.05"}
    wanted = newmark.march("pendulum", integrator=Alpha(0.3025, 0.6, -0.1, 0.0), **changing)
    found = newmark.march("pendulum", integrator=Bossak, **changing)
    assert np.allclose(found.u, wanted.u, rtol=1e-14)
    with pytest.raises(IntegratorError, match="takes steps of one size, as w and nu"):
        newmark.march("pendulum", integrator=TwoSteps, **changing)
