"""The theory as commands: orders, the derived scaling, tables, the perturbation theorem."""

import json
import re
from dataclasses import replace

import exact_orders
import oracles
import pytest
from covering import covering
from marching import scheme_of, start
from mpmath import mp

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.monomial import Monomial
from newmark_cli.newmark.orders import derive_scaling, form_orders
from newmark_cli.newmark.perturbation import perturbation, sensitivities
from newmark_cli.newmark.scaling import TABLE_2
from newmark_cli.report.judging.verdicts import PASS
from newmark_cli.report.tables import study_tables

#: Powers of h in Table 2, typed again; the V row is h¹.
POWERS = {
    "u-v-a-lambda": ({"D": 2, "V": 1, "K": 0, "C": 0}, {"u": 0, "v": -1, "a": -2, "lambda": -2}),
    "u-v-lambda": ({"D": 2, "K": 0, "C": 0}, {"u": 0, "v": -1, "lambda": -2}),
    "u-lambda": ({"D": 2, "C": 0}, {"u": 0, "lambda": -2}),
    "v-lambda": ({"D": 2, "C": 0}, {"v": -1, "lambda": -2}),
    "a-lambda": ({"D": 2, "C": 0}, {"a": -2, "lambda": -2}),
    "u-a-lambda": ({"D": 2, "K": 0, "C": 0}, {"u": 0, "a": -2, "lambda": -2}),
    "v-a-lambda": ({"D": 2, "V": 1, "C": 0}, {"v": -1, "a": -2, "lambda": -2}),
}


def test_no_scaling_is_found_where_there_is_none():
    """Blocks of J that grow faster than those of J⁻¹ shrink cannot be balanced."""
    orders = form_orders(FORMS["u-lambda"])
    impossible = replace(orders, jacobian=orders.jacobian - 1)
    with pytest.raises(ValueError, match="no powers of h"):
        derive_scaling(impossible)


def test_orders_are_laid_out_as_in_the_paper(cli):
    """Eqs. 33, 34, 36, 37 in the terminal."""
    text = cli("orders", "--form", "u-lambda", "--preconditioning", "none").stdout
    lines = [line.split() for line in text.splitlines()]
    assert ["J̄", "u", "λ"] in lines
    assert ["D", "O(h⁻²)", "O(h⁰)"] in lines
    assert ["C", "O(h⁰)", "0"] in lines
    assert ["u", "O(h²)", "O(h⁰)"] in lines
    assert ["λ", "O(h⁰)", "O(h⁻²)"] in lines
    assert "Δb̄_D O(h⁻²), Δb̄_C O(h⁰)" in text
    assert "Δu O(h⁰), Δv* O(h⁻¹), Δa* O(h⁻²), Δλ O(h⁻²)" in text
    assert "C O(h⁻⁴)" in text


def test_derive_in_the_terminal(cli):
    """All seven forms agree, and the text says which are the paper's."""
    text = cli("orders", "--derive").stdout
    assert "NOT" not in text
    assert text.count("the powers of Table 2") == 10
    assert text.count("the powers of this project's factors") == 4
    found = json.loads(cli("orders", "--derive", "--json").stdout)
    assert {f["form"]: (f["left"], f["right"]) for f in found} == POWERS


def test_orders_refuses(cli):
    """Unknown names and contradicting options."""
    assert "did you mean 'u-lambda'" in cli.refused("orders", "--form", "u-lamda")
    assert "unknown preconditioning 'best'" in cli.refused("orders", "--preconditioning", "best")
    assert "--config already names" in cli.refused("orders", "--form", "u-lambda", "--config", "x")


@pytest.mark.parametrize(
    ("name", "form", "variant"), covering(oracles.REFERENCES, FORMS, ("none", "right", "optimal"))
)
def test_sensitivities_are_columns_of_the_inverse(name, form, variant):
    """‖δq̄‖/ε against J⁻¹ in 60 digits, also where J̄ is too uneven for plain elimination."""
    subject, h = problem(name), 1e-8
    state = start(subject)
    scheme = scheme_of(form, variant, h)
    found = sensitivities(subject, scheme, 0.0, state)
    with mp.workdps(oracles.DIGITS):
        reference = oracles.REFERENCES[name]()
        x, g = reference.jacobian_terms(map(float, state.fields[0]), map(float, state.multipliers))
        y = mp.zeros(subject.n)
        blocks = exact_orders.form_jacobian(form, x, y, reference.mass, g, h)
        scaled = oracles.scale(form, variant, *blocks, h)
        _, row_names, column_names = blocks
        factored, order = mp.LU_decomp(scaled)
        for row in FORMS[form].rows:
            places = [i for i, r in enumerate(row_names) if r == row]
            rhs = mp.zeros(scaled.rows, 1)
            for place, value in zip(places, perturbation(row, len(places)), strict=True):
                rhs[place] = mp.mpf(float(value))
            change = mp.U_solve(factored, mp.L_solve(factored, rhs, order))
            for unknown in FORMS[form].unknowns:
                block = [change[i] for i, c in enumerate(column_names) if c == unknown[:6]]
                exact = float(mp.norm(mp.matrix(block), 2))
                assert found[row, unknown] == pytest.approx(exact, rel=1e-9, abs=0), (row, unknown)


@pytest.fixture(scope="module")
def entries(committed_results):
    """Table, column and series of the entries of both tables, from the committed results."""
    found = study_tables.paper_entries(committed_results(study_tables.PAPER).slopes)
    return [(*name.removeprefix("Table ").split(", "), slope) for name, slope in found]


def test_table_1(entries):
    """Every form, u v a λ C: predicted as the paper prints, measured within tolerance."""
    condition = dict(zip(FORMS, (-2, -3, -4, -3, -2, -2, -2), strict=True))
    ours = [(name, slope) for table, name, slope in entries if table == "1"]
    assert len(ours) == 2 * 7 * 5
    for name, slope in ours:
        expected = {"Δu": 0, "Δv": -1, "Δa": -2, "Δλ": -2, "C": condition[slope.form]}[name]
        assert slope.expected == expected
        tolerance = 0.02 if name == "C" else 0.15
        assert slope.fit.slope == pytest.approx(expected, abs=tolerance), (name, slope.key)
        recovered = name in ("Δu", "Δv", "Δa") and name[1] not in slope.form.split("-")
        assert (slope.role == "recovered") == recovered


def test_table_2(entries):
    """Every factor's power of h, derived and measured by the reactions of the scaled system."""
    ours = [(name, slope) for table, name, slope in entries if table == "2"]
    assert len(ours) == 2 * sum(len(left) + len(right) for left, right in POWERS.values())
    for name, slope in ours:
        side, block = name[2], name.split()[1].replace("λ", "lambda")
        powers = POWERS[slope.form][0 if side == "L" else 1]
        factor = TABLE_2[slope.form]["left" if side == "L" else "right"][block]
        assert slope.expected == powers[block] == Monomial.parse(factor).order()
        assert slope.fit.slope == pytest.approx(powers[block], abs=0.05)
        assert slope.verdict == PASS


def test_tables_command(cli, committed_folder):
    """Terminal, Markdown, CSV and LaTeX, from the CSV alone."""
    (cli.folder / "results").mkdir()
    (cli.folder / "results/all-forms.csv").write_bytes(
        (committed_folder / "all-forms.csv").read_bytes()
    )
    done = cli("tables")
    assert "(u, λ)        0: " in done.stdout
    assert " !" not in done.stdout
    folder = cli.folder / "results/tables"
    names = {f"table-{n}.{s}" for n in (1, 2) for s in ("md", "csv", "tex")}
    assert {file.name for file in folder.iterdir()} == names
    for name in names:
        text = (folder / name).read_text()
        assert not re.search(r"(±|pm) 0\.0*\D", text)
    latex = cli("tables", "--format", "latex").stdout
    assert latex.count(r"\begin{table*}") == latex.count(r"\end{tabular}") == 3
    row = r"$(v, a, \lambda )$ & $\beta h^{2}$ & $\beta h/\gamma $ & -- & 1 & -- & "
    assert row + r"$\gamma /(\beta h)$ & $1/(\beta h^{2})$ & $1/(\beta h^{2})$" in latex


def test_tables_mark_a_mismatch(cli, committed_folder):
    """A factor whose power does not fit is marked, and both tables and check fail."""
    text = (committed_folder / "all-forms.csv").read_text().splitlines()
    header = text[0].split(",")
    names = ("problem", "measure", "preconditioning", "h", "median")
    columns = {name: header.index(name) for name in names}
    spoilt = [text[0]]
    for line in text[1:]:
        row = line.split(",")
        if row[columns["problem"]] != "pendulum":
            continue
        if row[columns["measure"]] == "sensitivity" and row[columns["preconditioning"]] == "left":
            value = float(row[columns["median"]]) / float(row[columns["h"]])
            row[columns["median"]] = repr(value)
        spoilt.append(",".join(row))
    cli.write("results/all-forms.csv", "\n".join(spoilt) + "\n")
    printed = cli("tables", code=1).stdout
    assert " !" in printed
    assert "! marks what is not as predicted." in printed
    assert "miss" in cli("check", code=1).stdout


def test_tables_need_their_study(cli):
    assert "run 'newmark-study run all-forms' first" in cli.refused("tables")
    assert "need a STUDY" in cli.refused("tables", "--rows", "form")
