"""Tables of any study, by options of a command and by its config."""

import csv
import io

import own_study
import pytest
from own_study import DAMPED, STUDY, table, written

from newmark_cli.report.judging.verdicts import MISS
from newmark_cli.report.tables import study_tables
from newmark_cli.study.entries import TableConfig


@pytest.fixture
def mine(cli):
    return own_study.run(cli)


def test_tables_of_ones_own(mine):
    """Rows and columns by axis, values and series as chosen, in every format."""
    printed = mine("tables", "mine", "--rows", "preconditioning", "--columns", "quantity",
                   "--format", "latex").stdout  # fmt: skip
    assert printed.count(r"\begin{tabular}{@{}ll@{}}") == 2
    assert r"    none & 2: 2.00~$\pm$~0.01 \tabularnewline" in printed
    assert r"\caption{Study mine: error. Entries: " in printed
    assert r"\label{tab:mine-error}" in printed
    # Alternatives stand in one table, each under its name.
    printed = mine("tables", "mine", "--rows", "quantity", "--columns", "measure",
                   "--format", "latex").stdout  # fmt: skip
    assert printed.count(r"\begin{table}") == 1
    assert r"    \multicolumn{3}{l}{\itshape optimal} \tabularnewline" in printed
    markdown = mine("tables", "mine", "--columns", "measure,quantity", "--values", "slope").stdout
    assert "| preconditioning | error, u | condition, C |" in markdown
    assert "| optimal | 2.00 | −4.00" in markdown
    assert mine("tables", "mine", "--format", "csv").stdout.startswith("table,preconditioning,")
    listed = mine("tables", "mine", "--list", "--measure", "error", "--format", "csv",
                  "--rows", "preconditioning,quantity").stdout  # fmt: skip
    rows = list(csv.DictReader(io.StringIO(listed)))
    assert [row["preconditioning"] for row in rows] == ["none", "optimal"]
    for row in rows:
        assert float(row["slope"]) == pytest.approx(2, abs=1e-12)
        assert (row["quantity"], row["predicted"], row["verdict"]) == ("u", "2.0", "pass")


@pytest.mark.parametrize(("options", "told"), [
    (("--rows", "quantiti"), "--rows: unknown axis 'quantiti'; did you mean 'quantity'?"),
    (("--values", "slop"), "--values: unknown value 'slop'; did you mean 'slope'?"),
    (("--columns", "preconditioning"), "--columns: preconditioning already tells"),
    (("--list", "--columns", "form"), "--columns: --list has none"),
    (("--quantity", "z"), "--quantity: no series of 'z' in the results"),
])  # fmt: skip
def test_wrong_tables(mine, options, told):
    """What there is not is one line."""
    assert told in mine.refused("tables", "mine", *options)


def test_strongest_of_several_series(tmp_path):
    """At step sizes that all of them have; its order is the least of theirs."""
    weak = table(2.0, quantity="u", integrator=DAMPED)
    strong = table(1.0, quantity="lambda", integrator=DAMPED)
    given = written(tmp_path, [*weak, *strong[:-1]])
    column = {"label": "worst", "quantity": ["u", "lambda"]}
    ((_, ((_, found),)),) = study_tables.groups(
        given.slopes, TableConfig(rows="problem", headings=[column])
    )
    assert found.h.tolist() == sorted({row["h"] for row in strong[:-1]}, reverse=True)
    assert found.fit.slope == pytest.approx(1)
    assert found.expected == 2
    assert found.verdict == MISS


def test_tables_of_a_config(cli):
    """A config defines its tables, column by column too; an axis that is none has its line."""
    tables = """\
tables:
  - {title: Orders, rows: preconditioning, columns: quantity, measure: condition}
  - title: Mine
    rows: problem
    headings:
      - {label: plain, measure: error, preconditioning: none, quantity: u}
      - {label: worst, measure: error, preconditioning: none, quantity: [u, lambda]}
"""
    study = STUDY.replace("t_end: 1.0", "t_end: 0.3")
    cli.write("mine.yaml", study + tables)
    cli("run", "mine.yaml")
    printed = cli("tables", "mine").stdout
    assert "### Orders\n\n| preconditioning | C |\n| --- | --- |\n| none | −4: −4.0" in printed
    assert "### Mine\n\n| problem | plain | worst |\n| --- | --- | --- |\n| pendulum |" in printed
    values = {
        name: cli("tables", "mine", "--list", "--measure", "error", "--quantity", name,
                  "--preconditioning", "none", "--values", "fitted").stdout.split("| ")[-1]
        for name in ("u", "lambda")
    }  # fmt: skip
    assert values["u"].split(" |")[0].rstrip("* ") in printed
    cli.write("wrong.yaml", study + tables.replace("columns: quantity", "columns: quantiti"))
    line = cli.refused("validate", "wrong.yaml")
    assert "quantiti" in line
    assert "did you mean 'quantity'" in line
    cli.write("other.yaml", study + tables.replace("measure: condition", "measure: floor"))
    line = cli.refused("validate", "other.yaml")
    assert "tables[1].measure: 'floor' is not among the study's" in line
