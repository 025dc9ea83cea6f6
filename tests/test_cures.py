"""The tables of cures and their figures, against CSVs made by hand; drifts over time."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import synthetic
from each import each

from newmark_cli.report.drawing import sheets
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.judging.slopes import study_slopes
from newmark_cli.report.reading import records
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.report.tables import cures
from newmark_cli.study.reading import read_study
from newmark_cli.study.results import COLUMNS, csv_text
from newmark_cli.support.errors import ResultsError

ROOT = Path(__file__).parents[1]
STEPS = (1e-4, 1e-5, 1e-6)


def rows_of(curve, values, column="last", status="ok", **more):
    """Rows of a series made by hand: a value at each of `STEPS`."""
    table = []
    for h, value in zip(STEPS, values, strict=True):
        row = dict.fromkeys(COLUMNS, "")
        row |= {name: given for name, given in curve.key.named().items() if name in row}
        row |= {
            "h": h, "t_end": 0.03, "steps": round(0.03 / h), "role": "primary", "zeros": 0,
            "not_converged": 0, "newton_iterations": 4.0, "status": status, column: value,
        }  # fmt: skip
        table.append(row | more)
    return table


def found(folder, *tables):
    """Results of studies from rows, each study in its CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [row for table in tables for row in table]
    slopes = []
    for study in dict.fromkeys(row["study"] for row in rows):
        path = folder / f"{study}.csv"
        path.write_text(csv_text(COLUMNS, [row for row in rows if row["study"] == study]))
        slopes += study_slopes(read_study(path), path)
    return Results(folder, slopes)


def cell(folder, name, symptom, *tables):
    """One cell of the table."""
    return cures.build(found(folder, *tables))[name, symptom]


def named(name):
    """The cure of this name."""
    return next(cure for cure in cures.CURES if cure.name == name)


PLAIN, GGL = (cure for cure in cures.CURES if cure.name in ("index 3, trapezoidal", "GGL"))


def error(cure, values, problem="andrews"):
    """Errors of λ."""
    return rows_of(cure.curve("cures", problem, "lambda", "error"), values)


@each(
    "cure, values, text",
    [
        (GGL, (1e-3, 1e-5, 1e-7), "yes: 1e-7, falls like h²"),
        (PLAIN, (1.4, 0.3, 2e3), "no: 2e3"),
        (named("recovered λ"), (4e-3, 4e-5, 3e-4), "partly: 0.0003"),
    ],
)
def test_errors_in_the_table(tmp_path, cure, values, text):
    """A cell has the error at the smallest step size, and the order that is predicted."""
    assert cell(tmp_path, cure.name, "error of λ from rest", error(cure, values)).text == text
    assert cell(tmp_path, cure.name, "error of λ in motion", error(cure, values)).measured == "n/a"


@each(
    "values, mark, measured, agrees",
    [((1e3, 1e4, 1e5), "partly", "−1.0", True), ((1e5, 1e4, 1e3), "yes", "1.0", False)],
)
def test_orders_in_the_table(tmp_path, values, mark, measured, agrees):
    """GGL's condition number is predicted to grow like 1/h; another order is marked."""
    curve = GGL.curve("cures", "andrews", "jacobian", "condition")
    got = cell(
        tmp_path,
        "GGL",
        "condition number",
        error(GGL, (1e-3, 1e-5, 1e-7)),
        rows_of(curve, values, "median"),
    )
    assert (got.mark, got.predicted, got.measured, got.agrees) == (mark, "−1", measured, agrees)
    assert got.text.endswith(" !") is not agrees


def test_shares_and_iterations_in_the_table(tmp_path):
    """Steps that meet the tolerance as a share of all; a limit that was reached is said."""
    damped = cures.Cure("x", {"integrator": cures.DAMPED})
    tolerance = damped.curve(
        "cures-tolerance", "andrews", "newton", "tolerance", stop="absolute 1e-08"
    )
    krylov = PLAIN.curve(
        "cures-krylov", "random-chain(links=200)", "jacobian", "krylov_iterations",
        linear_solver="gmres",
    )  # fmt: skip
    met = rows_of(tolerance, (300, 30, 0), "met", "not_converged", steps=300)
    iterations = rows_of(krylov, (300, 400, 500), "median")
    iterations[-1] |= {"status": "stagnated", "max": 600}
    tables = [error(PLAIN, (1.4, 0.3, 2e3)), met, iterations]
    got = cell(tmp_path, PLAIN.name, "fixed tolerance", *tables)
    assert got.text == "no: 0 %"
    got = cell(tmp_path, PLAIN.name, "GMRES iterations", *tables)
    assert got.text == "no: 300 to more than 600"


def test_cost_is_from_the_record(tmp_path):
    """Operations per step over those of index 3, the median of the three smallest step sizes."""
    tables = []
    for cure in (PLAIN, GGL):
        tables += [error(cure, (1e-3, 1e-5, 1e-7))]
        tables += [rows_of(cure.curve("cures", "andrews", "u", "error"), (1e-3, 1e-5, 1e-7))]
    given = found(tmp_path, *tables)
    told = []
    for row in {(r["formulation"], r["h"]): r for table in tables for r in table}.values():
        factor = {1e-4: 9.0, 1e-5: 2.5, 1e-6: 2.0}[row["h"]] if row["formulation"] == "ggl" else 1
        cells = {name: row[name] for name in COLUMNS if row[name] != ""}
        told.append(cells | {"operations": factor * 1e5 * row["steps"]})
    (tmp_path / "cures.json").write_text(json.dumps({"study": "cures", "cells": told}))
    cells = cures.build(given)
    assert cells["GGL", "cheap"].text == "no: 2.5 times"
    assert cells[PLAIN.name, "cheap"].text == "yes: 1.0 times"


def test_table_needs_its_study(tmp_path):
    with pytest.raises(ResultsError, match="run 'newmark-study run cures' first"):
        cures.build(Results(tmp_path, []))


def test_tables_of_cures(cli):
    """Markdown, LaTeX and CSV have every entry; one that is not as predicted makes 1."""
    folder = cli.folder / "results"
    curve = GGL.curve("cures", "andrews", "jacobian", "condition")
    good = error(GGL, (1e-3, 1e-5, 1e-7))
    for values, code in (((1e3, 1e4, 1e5), 0), ((1e5, 1e4, 1e3), 1)):
        found(folder, good, rows_of(curve, values, "median"))
        cli("tables", "--cures", "--results", str(folder), code=code)
    with (folder / "tables/cures.csv").open(encoding="utf-8") as file:
        rows = {(row["cure"], row["symptom"]): row for row in csv.DictReader(file)}
    assert len(rows) == len(cures.CURES) * len(cures.SYMPTOMS) == 21 * 11
    assert rows["GGL", "condition number"] == {
        "group": "other constraint rows", "cure": "GGL", "symptom": "condition number",
        "mark": "yes", "predicted": "−1", "measured": "1.0", "agrees": "no",
    }  # fmt: skip
    entry = "yes: grows like h⁻¹, fitted 1.0 !"
    for form, row in (
        ("markdown", f"| GGL | n/a | {entry} | n/a |"),
        ("latex", f"GGL & n/a & {entry.replace('⁻¹', '$^{-1}$')} & n/a &"),
        ("text", "GGL                           n/a"),
    ):
        printed = cli("tables", "--cures", "--format", form, code=1).stdout
        assert row in printed.replace(r"\raggedright ", "")
        assert "rate tangent is how the rate G" in printed.replace("\n", " ").replace("  ", " ")
    assert "19 is a table, made by 'newmark-study tables --cures'" in cli.refused("plot", "19")


def test_errors_of_every_cure(tmp_path):
    """Figure 16: a row for each problem, a column for each group, each trace its CSV's points."""
    figure = FIGURES["16"]
    path = synthetic.write(tmp_path, figure)
    sheet = sheets.sheet(figure, Results(tmp_path, study_slopes(read_study(path), path)))
    assert (sheet.columns, len(sheet.panels)) == (3, 9)
    looks = {}
    for panel, part in zip(sheet.panels, figure.parts, strict=True):
        for curve, trace in zip(part.curves, panel.traces[: len(part.curves)], strict=True):
            expected = sorted((row["h"], row["last"]) for row in synthetic.rows_of(curve))
            assert list(zip(trace.x.tolist(), trace.y.tolist(), strict=True)) == expected
            assert trace.label == curve.label
            assert looks.setdefault(curve.label, trace.look) == trace.look
        assert len({trace.look.color for trace in panel.traces}) == len(part.curves)
        assert len({curve.problem for curve in part.curves}) == 1
    # Compensated evaluation is not to be had where constraints depend on time.
    assert [len(part.curves) for part in figure.parts] == [7, 7, 7, 7, 7, 7, 5, 7, 7]


def test_drifts_over_time(tmp_path):
    """Figure 18 draws what the file has; values below rounding are left out."""
    figure = FIGURES["18"]
    path = synthetic.write(tmp_path, figure)
    synthetic.write_drifts(tmp_path, figure, {"andrews": 1e-5, "shaken-pendulum": 1e-3})
    given = Results(tmp_path, study_slopes(read_study(path), path))
    sheet = sheets.sheet(figure, given)
    assert (sheet.columns, len(sheet.panels)) == (2, 4)
    curves = {(c.problem, c.label): c for c in figure.curves}
    for place, panel in enumerate(sheet.panels):
        problem = ("andrews", "shaken-pendulum")[place % 2]
        assert len(panel.traces) == 7
        for trace in panel.traces:
            t, values = synthetic.drifts(curves[problem, trace.label])
            expected = values[:, place // 2]
            np.testing.assert_allclose(trace.x, t, rtol=1e-15)
            np.testing.assert_array_equal(trace.y, np.where(expected < 1e-18, np.nan, expected))
    file = tmp_path / "drift/drift.csv"
    file.write_text(file.read_text().replace("index-2", "index-1"))
    with pytest.raises(ResultsError, match="figure 18 needs index 2;"):
        sheets.require(figure, given)


def test_measure_of_drift(cli):
    (cli.folder / "mine.yaml").write_text(
        "study: mine\nproblem: shaken-pendulum\nform: a-lambda\npreconditioning: optimal\n"
        "formulation: [index-1, ggl]\nmeasure: drift\nh: 1e-2\nt_end: 0.5\nsamples: 10\n"
    )
    cli("run", "mine.yaml")
    with (cli.folder / "results/drift/mine.csv").open() as file:
        rows = list(csv.DictReader(file))
    with (cli.folder / "results/mine.csv").open() as file:
        largest = {(r["formulation"], r["quantity"]): float(r["max"]) for r in csv.DictReader(file)}
    assert [int(row["step"]) for row in rows] == [*range(5, 51, 5)] * 2
    for formulation in ("index-1", "ggl"):
        for name in ("position", "velocity"):
            values = [float(r[name]) for r in rows if r["formulation"] == formulation]
            assert max(values) == largest[formulation, name]
    assert largest["ggl", "position"] < 1e-14 < 1e-6 < largest["index-1", "position"]
    assert largest["ggl", "velocity"] < 1e-13 < 1e-6 < largest["index-1", "velocity"]
    assert records.changed(cli.folder / "results", ["mine"]) == []
    file = cli.folder / "results/drift/mine.csv"
    file.write_text(file.read_text().replace("e-0", "e-1", 1))
    (found,) = records.changed(cli.folder / "results", ["mine"])
    assert found.path == file


def test_docs_have_the_table():
    """The tables of docs/what-scaling-cures.md are those of the committed results."""
    text = (ROOT / "docs/what-scaling-cures.md").read_text(encoding="utf-8")
    begin, end = "<!-- cures: begin -->\n", "<!-- cures: end -->"
    table = (ROOT / "results/tables/cures.md").read_text(encoding="utf-8")
    assert text.split(begin)[1].split(end)[0] == table
