"""Theory of formulations as commands, verdicts and library calls."""

import json
from pathlib import Path

import pytest
import test_slopes
from conftest import QUICK, rows_in

import newmark_cli
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import GeneralizedAlpha
from newmark_cli.report.judging.verdicts import MISS, UNDECIDED
from newmark_cli.report.tables import theory
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.measures import RECORDS

DAMPED = GeneralizedAlpha(0.9)
REDUCED = ("index-2", "index-1", "baumgarte", "baumgarte rate_h=1", "ggl")


def key(measure, quantity="lambda", **rest):
    """Key of a series of (a, λ), ρ∞ = 0.9."""
    usual = {
        "study": "s", "problem": "andrews", "form": "a-lambda", "preconditioning": "none",
        "integrator": DAMPED.label, "measure": measure, "quantity": quantity, "row_block": "",
        "steps": 10,
    }  # fmt: skip
    return SeriesKey.of(usual | rest)


def predicted(*args, **rest):
    """Predicted order of a series."""
    one = key(*args, **rest)
    return RECORDS[one.measure].predicted(one)


def test_predictions_follow_the_formulation():
    """Corrections, condition numbers, sensitivities and errors of one form."""
    found = {
        formulation: (
            predicted("physical_correction", formulation=formulation),
            predicted("correction", formulation=formulation, preconditioning="optimal"),
            predicted("condition", "jacobian", formulation=formulation),
            predicted("error", formulation=formulation),
        )
        for formulation in ("index-3", *REDUCED, "augmented-lagrangian")
    }
    assert found == {
        "index-3": (-2, 0, -2, 2),
        "index-2": (-1, 1, -1, 2),
        "index-1": (0, 2, 0, 2),
        "baumgarte": (0, 2, 0, 2),
        "baumgarte rate_h=1": (-2, 0, 0, 2),
        "ggl": (-1, 1, -1, 2),
        "augmented-lagrangian": (-2, 0, 0, 2),
    }
    assert predicted("correction", "eta", formulation="ggl") == 0
    assert predicted("sensitivity", "eta", formulation="ggl", row_block="Cv") == 1
    assert predicted("sensitivity", formulation="ggl", row_block="C") == -1


@pytest.mark.parametrize(("rate", "expected"), [(1e3, UNDECIDED), (1.0, MISS)])
def test_a_rate_that_no_step_size_resolves_is_not_asymptotic(tmp_path, rate, expected):
    """Orders of a fixed rate need α h below 0.1 at three step sizes; then a miss is one."""
    values = {h: 1e-12 * h**-1.5 for h in (1e-1, 1e-2, 1e-3, 1e-4)}
    table = test_slopes.series(
        values, measure="physical_correction", form="a-lambda",
        formulation=f"baumgarte rate={rate!r}",
    )  # fmt: skip
    (found,) = test_slopes.found(tmp_path, table)
    assert found.expected == 0
    assert found.verdict == expected
    assert ("α h is 0.1 to 1e+02" in found.reason) == (expected == UNDECIDED)


def test_orders_of_a_formulation(cli):
    """Rows, η, and what is only a bound, in text and as JSON."""
    text = cli("orders", "--form", "u-v-lambda", "--formulation", "ggl", "--preconditioning",
               "none").stdout  # fmt: skip
    lines = [line.split() for line in text.splitlines()]
    assert text.startswith("(u, v, λ, η) form, ggl, preconditioning none\n")
    assert ["Cv", "O(h⁰)", "O(h⁰)", "0", "0"] in lines
    assert ["η", "O(h³)", "O(h⁰)", "O(h⁰)", "O(h¹)"] in lines
    assert "C O(h⁻²)" in text
    given = ("orders", "--form", "u-v-a-lambda", "--formulation", "index-1")
    assert "(Δu, Δv: a lower bound of the order;" in cli(*given).stdout
    found = json.loads(cli(*given, "--json").stdout)
    assert [entry["condition"] for entry in found] == [0, -2, -2, 0]
    assert found[0]["formulation"] == "index-1"
    assert found[0]["bounds"] == ["u", "v"]
    assert found[0]["jacobian"]["Ca"] == {"u": 0, "v": 0, "a": 0, "lambda": None}


def test_orders_of_an_augmented_lagrangian(cli):
    """λ has a correction, but is no unknown of the linear system."""
    text = cli("orders", "--form", "u-lambda", "--formulation", "augmented-lagrangian").stdout
    assert "updates it by −pΦ" in text
    (found, *_) = json.loads(
        cli("orders", "--form", "u-lambda", "--formulation", "augmented-lagrangian",
            "--json").stdout
    )  # fmt: skip
    assert found["jacobian"] == {"D": {"u": -2}}
    assert found["correction"] == {"u": 0, "lambda": -2}
    assert found["condition"] == 0


@pytest.mark.parametrize("formulation", ["ggl", "augmented-lagrangian penalty=3"])
def test_derive_a_formulation(cli, formulation):
    """The powers of the project's factors, in every form."""
    text = cli("orders", "--derive", "--formulation", formulation).stdout
    assert "NOT" not in text
    assert text.count("the powers of this project's factors") == 14
    assert text.count(f"form, {formulation.split()[0]}") == 7


def test_orders_of_a_config(cli):
    """A scaling of one's own is predicted without code, and so are formulations."""
    own = QUICK.replace("[none, optimal]", "{name: mine, right: {lambda: 1/h}}")
    cli.write("own.yaml", own + "formulation: [index-3, ggl, {method: baumgarte, rate_h: 2}]\n")
    found = json.loads(cli("orders", "--config", "own.yaml", "--json").stdout)
    assert list(dict.fromkeys(entry["formulation"] for entry in found)) == [
        "index-3",
        "ggl",
        "baumgarte rate_h=2.0",
    ]
    assert found[0]["correction"] == {"u": 0, "lambda": -1}
    assert found[0]["condition"] == -3


def test_tables_of_formulations(cli):
    """Markdown, which docs/reference/orders.md has, CSV and LaTeX of every formulation and form."""
    done = cli("tables", "--formulations")
    assert "ggl                           (a, λ)        0    0    −1  −1  0" in done.stdout
    folder = cli.folder / "results/tables"
    assert {f.name for f in folder.iterdir()} == {f"formulations.{s}" for s in ("md", "csv", "tex")}
    rows = rows_in(folder / "formulations.csv")
    titles = theory.TITLES
    assert len(rows) == 3 * 7 * len(titles) + 1
    bounds = {(r["formulation"], r["form"]) for r in rows if r["Δv"].startswith("≥")}
    assert ("index-1", "(u, v, a, λ)") in bounds
    assert not any(formulation in ("index-3", "ggl") for formulation, _ in bounds)
    text = (folder / "formulations.tex").read_text()
    assert text.isascii()
    # The three longest go on in another.
    assert text.count(r"\begin{table") == 4 + text.count(", continued.}") == 7
    assert r"    index-1 & $(u, v, a, \lambda )$ & $\ge$ 0 & $\ge$ 0 & 0 & 0 & -- " in text
    markdown = (folder / "formulations.md").read_text()
    assert "| ggl | (u, v, λ) | −2 | −2 | −2 | 0 | 0 |" in markdown
    docs = (Path(__file__).parents[2] / "docs/reference/orders.md").read_text()
    assert markdown.strip() in docs


@pytest.mark.parametrize("form", FORMS)
def test_scaling_of_a_formulation(form):
    """New rows as velocities and accelerations are scaled; η as displacements."""
    found = newmark_cli.scaling(form, h=1e-2, formulation="ggl")
    plain = newmark_cli.scaling(form, h=1e-2)
    assert found.rows == (*plain.rows, "Cv")
    assert found.unknowns == (*plain.unknowns, "eta")
    assert found.left["Cv"] == pytest.approx(0.25 * 1e-2 / 0.5)
    assert found.right["eta"] == 1
    assert found.formulation == "ggl"
    assert {row: found.left[row] for row in plain.rows} == dict(plain.left)
    given = {"method": "baumgarte", "rate_h": 2}
    other = newmark_cli.scaling(form, h=1e-2, formulation=given)
    assert other.left["B"] == pytest.approx(0.25e-4)
    assert other.formulation == "baumgarte rate_h=2.0"
    assert newmark_cli.scaling(form, h=1e-2, formulation="index-1").left["Ca"] == other.left["B"]
