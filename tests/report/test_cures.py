"""The figures of cures against CSVs made by hand; drifts over time."""

import numpy as np
import pytest
import synthetic
from conftest import rows_in

from newmark_cli.report.drawing import plot, sheets
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.judging.slopes import of_csv
from newmark_cli.report.reading import records
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.support.errors import ResultsError


def test_drifts_over_time(tmp_path):
    """Figure 18 draws what the file has; values below rounding are left out."""
    figure = FIGURES["18"]
    path = synthetic.write(tmp_path, figure)
    synthetic.write_drifts(tmp_path, figure, {"andrews": 1e-5, "shaken-pendulum": 1e-3})
    given = Results(tmp_path, of_csv(path))
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
    file = tmp_path / "trajectory/drift.csv"
    file.write_text(file.read_text().replace("index-2", "index-1"))
    with pytest.raises(ResultsError, match="figure 18 needs index 2;"):
        sheets.require(figure, given)


def test_drifts_of_ones_own(cli):
    """What cells record, and the figure of it: no kind is only of shipped studies."""
    (cli.folder / "mine.yaml").write_text(
        "study: mine\nproblem: shaken-pendulum\nform: a-lambda\npreconditioning: optimal\n"
        "formulation: [index-1, ggl]\nmeasure: trajectory\ntrajectory: {every: 5, keep: drift}\n"
        "h: 1e-2\nt_end: 0.5\n"
        "figures: [{measure: trajectory, kind: drift, panels: quantity, series: formulation}]\n"
    )
    cli("run", "mine.yaml")
    given = Results(cli.folder / "results", of_csv(cli.folder / "results/mine.csv"))
    (figure,) = plot.chosen((), given).figures
    panels = sheets.sheet(figure, given).panels
    assert [(panel.title, [trace.label for trace in panel.traces]) for panel in panels] == [
        ("position", ["index 1", "GGL"]), ("velocity", ["index 1", "GGL"]),
    ]  # fmt: skip
    assert all(len(trace.x) == 10 for panel in panels for trace in panel.traces)
    rows, kept = (rows_in(cli.folder / f"results/{n}.csv") for n in ("trajectory/mine", "mine"))
    largest = {(row["formulation"], row["quantity"]): float(row["max"]) for row in kept}
    assert [int(row["step"]) for row in rows] == [*range(0, 51, 5)] * 2
    for formulation in ("index-1", "ggl"):
        for name in ("position", "velocity"):
            values = [float(r[f"drift[{name}]"]) for r in rows if r["formulation"] == formulation]
            assert max(values) == largest[formulation, name]
    assert largest["ggl", "position"] < 1e-14 < 1e-6 < largest["index-1", "position"]
    assert largest["ggl", "velocity"] < 1e-13 < 1e-6 < largest["index-1", "velocity"]
    assert records.changed(cli.folder / "results", ["mine"]) == []
    file = cli.folder / "results/trajectory/mine.csv"
    file.write_text(file.read_text().replace("e-0", "e-1", 1))
    (found,) = records.changed(cli.folder / "results", ["mine"])
    assert found.path == file
