"""Figures by the data that they draw, and verdicts by the rows that they read."""

import ast
from pathlib import Path

import numpy as np
import pytest
import synthetic

import newmark_cli
from newmark_cli.report.drawing import sheets
from newmark_cli.report.drawing.panels import LOOKS
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.judging.fits import Fit, format_fit, power_law
from newmark_cli.report.judging.slopes import of_csv
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.study import config, csv_files
from newmark_cli.study.csv_rows import read_study
from newmark_cli.study.measures import RECORDS
from newmark_cli.support.errors import ResultsError

ORDER_FIGURES = [f for f in FIGURES.values() if f.in_paper]


def order(reference):
    """Slope of a line on logarithmic axes."""
    return np.diff(np.log10(reference.y))[0] / np.diff(np.log10(reference.x))[0]


@pytest.mark.parametrize("figure", ORDER_FIGURES)
def test_order_figures_draw_the_csv(committed_folder, committed_results, figure):
    """Each series is the statistic of the CSV's rows; legend and prediction match the fit."""
    sheet = sheets.sheet(figure, committed_results(figure.study))
    frame = read_study(committed_folder / f"{figure.study}.csv")
    (panel,) = sheet.panels
    first = figure.curves[0]
    for trace in panel.traces:
        rows = frame[
            (frame["quantity"] == first.quantity)
            & (frame["measure"] == first.measure)
            & (frame["preconditioning"] == trace.label)
        ].sort_values("h")
        values = rows[RECORDS[first.measure].statistic].to_numpy()
        np.testing.assert_array_equal(trace.x, rows["h"])
        np.testing.assert_array_equal(trace.y, values)
        scatter = np.log(2) / np.sqrt(12) if first.measure == "correction" else 0.0
        unsure = np.hypot(scatter, (rows["rounding"] / values).fillna(0.0).to_numpy())
        assert trace.fit == format_fit(power_law(rows["h"].to_numpy(), values, unsure))
        assert f"{trace.label}: slope {trace.fit}, predicted " in sheet.words
    assert [trace.label for trace in panel.traces] == ["none", "left", "right", "optimal"]
    # The thin lines have the predicted slopes.
    expected = {"1": [0], "3": [-4, -2, 0], "4": [-1, 0], "7": [0], "9": [-4, -2, 0]}
    np.testing.assert_allclose(
        [order(line) for line in panel.references], expected.get(figure.name, [-2, 0]), atol=1e-10
    )
    assert (panel.x_scale, panel.y_scale) == ("log", "log")
    assert "h" in panel.x_label
    columns = {"u-lambda": "λ·h⁻²", "v-lambda": "v·h⁻¹, λ·h⁻²", "a-lambda": "a·h⁻², λ·h⁻²"}
    assert sheet.note == (
        f"scaling left: rows D·h²; right: columns {columns[first.form]}; optimal: both; "
        "fitted slope"
    )


STUDY_FIGURES = [FIGURES[name] for name in ("10", "11", "12", "13", "16", "24", "25")]


def sheet_of(folder, figure, table=None):
    """What a figure past the paper draws of synthetic results."""
    path = synthetic.write(folder, figure, table)
    return sheets.sheet(figure, Results(folder, of_csv(path)))


@pytest.mark.parametrize("figure", STUDY_FIGURES)
def test_study_figures_draw_the_csv(tmp_path, figure):
    """Each series is what its rows say, with its look in all panels, named in the legend.

    Cells without convergence stand apart, at the solver's limit.
    """
    sheet, looks = sheet_of(tmp_path, figure), {}
    for panel, part in zip(sheet.panels, figure.parts, strict=True):
        for curve, trace in zip(part.curves, panel.traces, strict=True):
            rows = sorted(synthetic.rows_of(curve), key=lambda row: row["h"])
            statistic = RECORDS[curve.measure].statistic
            expected = [
                row["max"] if row["status"] == "stagnated"
                else row[statistic] / (row["steps"] if statistic == "met" else 1)
                for row in rows
            ]  # fmt: skip
            assert trace.label == curve.label + (" (h = 10⁻⁶ only)" if len(rows) == 1 else "")
            assert looks.setdefault(trace.label, trace.look) == trace.look
            np.testing.assert_array_equal(trace.x, [row["h"] for row in rows])
            np.testing.assert_allclose(trace.y, expected, rtol=1e-15)
            np.testing.assert_array_equal(
                trace.apart, [row["status"] == "stagnated" for row in rows]
            )
        assert len({trace.look for trace in panel.traces}) == len(part.curves)
        assert len({curve.problem for curve in part.curves}) == 1
        assert panel.x_scale == "log"
        assert panel.y_scale == ("linear" if figure.name in ("12", "13") else "log")
        assert "h" in panel.x_label
        assert panel.y_label
        limit = {600: "no convergence in 600 iterations"}
        assert panel.levels == (limit if figure.name == "13" else {})
    if len(sheet.panels) == 1:
        assert tuple(looks.values()) == LOOKS[: len(looks)]
    else:  # Compensated evaluation is not to be had where constraints depend on time.
        found = [len(panel.traces) for panel in sheet.panels]
        assert found == {"16": [7, 7, 5]}.get(figure.name, [7, 7, 7])
        assert sheet.columns == 3


def test_sensitivities_have_a_panel_for_each_unknown(committed_results):
    """Scalings down, unknowns across; row blocks are its series, V without a value but for v."""
    figure = FIGURES["sensitivity"]
    given = committed_results("sensitivity")
    sheet = sheets.sheet(figure, given)
    assert (len(sheet.panels), sheet.columns) == (8, 4)
    by_key = {slope.key: slope for slope in given.slopes}
    series = [by_key[curve.key] for curve in figure.curves]
    drawn = [(panel, trace) for panel in sheet.panels for trace in panel.traces]
    for slope, (panel, trace) in zip(series, drawn, strict=True):
        ascending = np.argsort(slope.h)
        np.testing.assert_array_equal(trace.x, slope.h[ascending])
        np.testing.assert_array_equal(trace.y, slope.values[ascending])
        assert trace.label == slope.row_block
        if (slope.values > 0).any():
            assert trace.fit == format_fit(slope.fit)
            assert any(order(line) == pytest.approx(slope.expected) for line in panel.references)
        else:
            assert trace.fit == ""
    scalings = ("unscaled", "optimal scaling")
    titles = [panel.titles for panel in sheet.panels]
    assert titles == [(scaling, of) for scaling in scalings for of in ("u", "v", "a", "λ")]


def test_history_draws_the_largest_multiplier(tmp_path):
    """Figure 15: λ₂ here, above in the range of the last curve, below as far as any goes."""
    figure = FIGURES["15"]
    synthetic.write_history(tmp_path, figure)
    sheet = sheets.sheet(figure, Results(tmp_path, []))
    zoomed, whole = sheet.panels
    for panel in (zoomed, whole):
        assert panel.y_label == r"$\lambda$ of b (SI units)"
        assert panel.x_scale == "linear"
        for curve, trace in zip(figure.curves, panel.traces, strict=True):
            t, multipliers = synthetic.multipliers(curve)
            np.testing.assert_allclose(trace.x, t, rtol=1e-15)
            np.testing.assert_allclose(trace.y, multipliers[:, 1], rtol=1e-14)
    last = synthetic.multipliers(figure.curves[-1])[1][:, 1]
    assert zoomed.y_limits == pytest.approx(
        (1.25 * last.min() - 0.25 * last.max(), 1.25 * last.max() - 0.25 * last.min())
    )
    assert (zoomed.y_scale, whole.y_scale) == ("linear", "symlog")
    assert whole.linthresh == 10_000
    low, high = whole.y_limits
    assert low < -1e8 < 1e8 < high
    # Said once, though drawn twice.
    most = [np.max(np.abs(synthetic.multipliers(c)[1][:, 1])) for c in figure.curves]
    assert sheet.words == " ".join(
        f"{part}."
        for part in (
            figure.title,
            *(f"{c.label}: up to {m:.3g}" for c, m in zip(figure.curves, most, strict=True)),
        )
    )


@pytest.fixture(scope="module")
def history(tmp_path_factory):
    """Text of a file that Figure 15 is drawn from."""
    return synthetic.write_history(tmp_path_factory.mktemp("history"), FIGURES["15"]).read_text()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: text[:-3], "truncated"),
        (lambda text: text.rpartition("\n")[0].rpartition(",")[0] + "\n", "fields where"),
        (lambda text: text.replace("lambda[", "v["), "no columns lambda"),
        (lambda text: text.replace(",step,", ",stage,", 1), "lacks step"),
        (lambda text: text.replace("generalized", "generalised"), "needs generalized-α, direct"),
        (lambda text: text.replace("e-06,", "e-05,"), "needs trapezoidal, direct, trap"),
        (
            lambda text: text.replace(",9.999999999999999e-05,", ",zero,", 1),
            "line 2: t: not a number",
        ),
    ],
)
def test_damaged_history(tmp_path, history, damage, words):
    figure = FIGURES["15"]
    path = csv_files.trajectory_path(tmp_path, figure.study)
    path.parent.mkdir()
    path.write_text(damage(history))
    with pytest.raises(ResultsError, match=words) as caught:
        sheets.require(figure, Results(tmp_path, []))
    assert str(path) in str(caught.value)


def test_only_the_drawing_modules_import_matplotlib():
    """All else reads CSVs and gives values; it can be used where nothing is drawn."""
    package = Path(newmark_cli.__file__).parent
    importing = set()
    for file in package.rglob("*.py"):
        text = file.read_text()
        drawing = "matplotlib" in text or "PIL" in text
        for node in ast.walk(ast.parse(text)) if drawing else ():
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if {name.partition(".")[0] for name in names} & {"matplotlib", "PIL"}:
                importing.add(file.relative_to(package).as_posix())
    assert importing == {
        f"report/drawing/{name}.py" for name in ("style", "draw", "draw_mechanism")
    }


@pytest.mark.parametrize("figure", [f for f in FIGURES.values() if f.curves])
def test_shipped_configs_give_what_figures_draw(figure):
    """Every series of a figure has cells, under the labels that the CSV will have."""
    cells = [
        {
            "problem": cell.problem.label,
            "integrator": cell.integrator.label,
            "form": cell.form,
            "preconditioning": cell.preconditioning.label,
            "evaluation": cell.evaluation,
            "precision": cell.precision,
            "linear_solver": cell.solver,
            "stop": cell.stop.label if cell.stop else "saturation",
        }
        for cell in config.load_shipped(figure.study).cells()
    ]
    for curve in synthetic.curves(figure):
        assert {column: getattr(curve, column) for column in cells[0]} in cells, curve.label


@pytest.mark.parametrize(
    ("slope", "stderr", "text"),
    [
        (-2.046, 0.0512, "−2.05 ± 0.05"),
        (-0.001, 0.012, "0.00 ± 0.01"),
        (-0.0031, 0.0004, "0.00"),
        (-1.999993, 0.00001, "−2.00"),
        (1.25, 1e-12, "1.25"),
        (1.0, np.nan, "1.00"),
        (np.nan, np.nan, "n/a"),
    ],
)
def test_fits_are_written_with_two_decimals(slope, stderr, text):
    """A true minus sign, no minus zero, no error that would be 0.00."""
    assert format_fit(Fit(slope, stderr, 4)) == text
