"""Figures by the data that they draw, and verdicts by the rows that they read."""

import ast
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import synthetic

import newmark_cli
from newmark_cli.mechanisms.registry import problem
from newmark_cli.report import draw, draw_mechanism, plot, style
from newmark_cli.report.figures import FIGURES, MechanismFigure, OrderFigure, StudyFigure
from newmark_cli.report.fits import Fit, format_fit, power_law
from newmark_cli.report.slopes import collect, study_slopes
from newmark_cli.report.verdicts import INCOMPLETE, MISS, PASS
from newmark_cli.running import runner
from newmark_cli.study import config, results
from newmark_cli.study.measures import RECORDS
from newmark_cli.study.reading import read_study

ORDER_FIGURES = [f for f in FIGURES.values() if isinstance(f, OrderFigure)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Small versions of the studies that the figures read: coarse h, few steps."""
    folder = tmp_path_factory.mktemp("results")
    studies = []
    for name in dict.fromkeys(f.study for f in ORDER_FIGURES):
        study = config.find(name)
        cases = [
            case.model_copy(update={"h": case.h[:3], "t_end": 30 * case.h[0]})
            for case in study.cases
        ]
        studies.append(study.model_copy(update={"cases": tuple(cases)}))
    runner.run_studies(studies, folder, runner.Options(jobs=2))
    return folder


@pytest.mark.parametrize("figure", ORDER_FIGURES, ids=lambda f: f"figure-{f.name}")
def test_order_figures_draw_the_csv(folder, figure):
    """Each series is the statistic of the CSV's rows; legend and prediction match the fit."""
    slopes = plot.series(figure, collect(folder, [figure.study]), folder)
    frame = read_study(folder / f"{figure.study}.csv")
    drawing = draw.order_figure(figure, slopes)
    (axes,) = drawing.axes
    lines = axes.get_lines()
    for slope, line in zip(slopes, lines, strict=False):
        rows = frame[
            (frame["quantity"] == figure.quantity)
            & (frame["measure"] == figure.measure)
            & (frame["preconditioning"] == slope.preconditioning)
        ].sort_values("h")
        drawn = rows[RECORDS[figure.measure].statistic].to_numpy()
        np.testing.assert_array_equal(line.get_xdata(), rows["h"][drawn > 0])
        np.testing.assert_array_equal(line.get_ydata(), drawn[drawn > 0])
        fit = power_law(rows["h"].to_numpy(), drawn)
        assert line.get_label() == f"{slope.preconditioning}: {format_fit(fit)}"
    assert [s.preconditioning for s in slopes] == list(figure.variants)
    # The thin lines have the predicted slopes.
    references = [
        np.diff(np.log10(line.get_ydata()))[0] / np.diff(np.log10(line.get_xdata()))[0]
        for line in lines[len(slopes) :]
    ]
    expected = list(dict.fromkeys(s.expected for s in slopes))
    np.testing.assert_allclose(references, expected, atol=1e-10)
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert "h" in axes.get_xlabel()


STUDY_FIGURES = [f for f in FIGURES.values() if isinstance(f, StudyFigure)]


def slopes_of(folder, figure, table=None):
    """Series of a figure past the paper, in the order of its curves."""
    path = synthetic.write(folder, figure, table)
    return plot.series(figure, study_slopes(read_study(path), path), folder)


@pytest.mark.parametrize("figure", STUDY_FIGURES, ids=lambda f: f"figure-{f.name}")
def test_study_figures_draw_the_csv(tmp_path, figure):
    """Each series is what its rows say, in a look of its own, named in the legend."""
    slopes = slopes_of(tmp_path, figure)
    drawing = draw.order_figure(figure, slopes)
    (axes,) = drawing.axes
    lines = {line.get_label().partition(":")[0]: line for line in axes.get_lines()}
    for curve, look in zip(figure.curves, style.LOOKS, strict=False):
        ok = [r for r in synthetic.rows_of(curve) if r["status"] != "stagnated"]
        ok = sorted(ok, key=lambda row: row["h"])
        statistic = RECORDS[curve.measure].statistic
        share = [row["steps"] if statistic == "met" else 1 for row in ok]
        expected = [row[statistic] / whole for row, whole in zip(ok, share, strict=True)]
        np.testing.assert_array_equal(lines[curve.label].get_xdata(), [row["h"] for row in ok])
        np.testing.assert_allclose(lines[curve.label].get_ydata(), expected, rtol=1e-15)
        assert lines[curve.label].get_color() == look["color"]
    named = [text.get_text().partition(":")[0] for text in drawing.legends[0].get_texts()]
    assert named[: len(figure.curves)] == [curve.label for curve in figure.curves]
    assert axes.get_xscale() == "log"
    assert axes.get_yscale() == ("linear" if figure.linear else "log")
    assert "h" in axes.get_xlabel()
    assert axes.get_ylabel()


def test_slopes_stand_where_there_is_a_prediction(tmp_path):
    """Figure 11: h² beside generalized-α down to its rounding floor, nothing else."""
    slopes = slopes_of(tmp_path, FIGURES["11"])
    drawing = draw.order_figure(FIGURES["11"], slopes)
    (axes,) = drawing.axes
    labels = [text.get_text() for text in drawing.legends[0].get_texts()]
    assert [label for label in labels if "±" in label] == [
        "generalized-α, direct: 1.95 ± 0.01",
        "generalized-α, compensated: 1.96 ± 0.01",
    ]
    (line,) = (line for line in axes.get_lines() if line.get_label() == "predicted")
    np.testing.assert_allclose(line.get_xdata(), [1e-6, 1e-4])
    assert np.diff(np.log10(line.get_ydata()))[0] == pytest.approx(4, abs=1e-10)
    assert [text.get_text() for text in axes.texts] == ["h²"]


def test_shares_and_counts_start_at_zero(tmp_path):
    """Figure 12 shows all of 0 to 1, Figure 13 all counts; zeros are drawn."""
    for name, top in (("12", 1), ("13", 600)):
        figure = FIGURES[name]
        (axes,) = draw.order_figure(figure, slopes_of(tmp_path, figure)).axes
        low, high = axes.get_ylim()
        assert low < 0 < top < high < 1.3 * top
        assert -low < 0.1 * top


def test_stagnation_is_marked(tmp_path):
    """Cells without convergence: open markers at the solver's limit, not joined, and words."""
    figure = FIGURES["13"]
    (axes,) = draw.order_figure(figure, slopes_of(tmp_path, figure)).axes
    at_limit = [
        line
        for line in axes.get_lines()
        if line.get_marker() != "None" and set(line.get_ydata()) == {synthetic.LIMIT}
    ]
    assert {tuple(line.get_xdata()) for line in at_limit} == {
        (1e-5, 1e-4, 1e-3), (1e-5, 1e-4), (1e-5,),
    }  # fmt: skip
    assert all(line.get_markerfacecolor() == "none" for line in at_limit)
    assert all(line.get_linestyle() == "None" for line in at_limit)
    assert [text.get_text() for text in axes.texts] == ["no convergence in 600 iterations"]


def test_precisions_side_by_side(tmp_path):
    """Figure 14: a panel for each unknown, both precisions of a variant in its look."""
    figure = FIGURES["14"]
    slopes = slopes_of(tmp_path, figure)
    drawing = draw.precision_figure(figure, slopes)
    assert len(drawing.axes) == 2
    for axes, unknown in zip(drawing.axes, ("u", "lambda"), strict=True):
        drawn = {(line.get_color(), tuple(line.get_ydata())) for line in axes.get_lines()}
        expected = {
            (look["color"], tuple(slope.values[::-1]))
            for variant, look in zip(figure.variants, style.LOOKS, strict=False)
            for slope in slopes
            if (slope.quantity, slope.preconditioning) == (unknown, variant)
        }
        assert drawn == expected
        assert len(drawn) == 8
        assert {text.get_text() for text in axes.texts} == {"float32", "float64"}
    assert [text.get_text() for text in drawing.legends[0].get_texts()] == list(figure.variants)


def test_history_draws_the_largest_multiplier(tmp_path):
    """Figure 15: λ₂ here, above in the range of the last curve, below as far as any goes."""
    figure = FIGURES["15"]
    synthetic.write_history(tmp_path, figure)
    drawing = draw.history_figure(figure, plot.histories(figure, tmp_path))
    zoomed, whole = drawing.axes
    for axes in (zoomed, whole):
        assert "lambda_2" in axes.get_ylabel()
        assert "kN/m" in axes.get_ylabel()
        for curve, line in zip(figure.curves, axes.get_lines(), strict=True):
            t, multipliers = synthetic.multipliers(curve)
            np.testing.assert_allclose(line.get_xdata(), t, rtol=1e-15)
            np.testing.assert_allclose(line.get_ydata(), 1e-3 * multipliers[:, 1], rtol=1e-14)
    last = 1e-3 * synthetic.multipliers(figure.curves[-1])[1][:, 1]
    assert zoomed.get_ylim() == pytest.approx(
        (1.25 * last.min() - 0.25 * last.max(), 1.25 * last.max() - 0.25 * last.min())
    )
    assert whole.get_yscale() == "symlog"
    low, high = whole.get_ylim()
    assert low < -1e5 < 1e5 < high


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: text[:-3], "truncated"),
        (lambda text: text.rpartition("\n")[0].rpartition(",")[0] + "\n", "fields where"),
        (lambda text: text.replace("lambda_2", "lambda_3", 1), "the columns after t"),
        (lambda text: text.replace(",step,", ",stage,", 1), "lacks step"),
        (lambda text: text.replace("generalized", "generalised"), "needs generalized-α, direct"),
        (lambda text: text.replace("e-06,", "e-05,"), "needs trapezoidal, direct, trap"),
        (lambda text: text.replace(",0.0,", ",zero,", 1), "line 2: t: not a number"),
    ],
)
def test_damaged_history(tmp_path, damage, words):
    """One line that names the file, and what is wrong with it."""
    figure = FIGURES["15"]
    path = synthetic.write_history(tmp_path, figure)
    path.write_text(damage(path.read_text()))
    with pytest.raises(results.ResultsError, match=words) as caught:
        plot.histories(figure, tmp_path)
    assert str(path) in str(caught.value)


def test_legends_are_whole(committed_folder):
    """Nothing is cut off at the sides, however many decimals the slopes have."""
    figures = [*ORDER_FIGURES, *STUDY_FIGURES]
    slopes = collect(committed_folder, dict.fromkeys(figure.study for figure in figures))
    for figure in figures:
        drawing = draw.order_figure(figure, plot.series(figure, slopes, committed_folder))
        drawing.draw_without_rendering()
        (legend,) = drawing.legends
        extent = legend.get_window_extent()
        assert 0 <= extent.x0 < extent.x1 <= drawing.bbox.width, figure.name


def test_only_the_drawing_modules_import_matplotlib():
    """All else reads CSVs and gives values; it can be used where nothing is drawn."""
    package = Path(newmark_cli.__file__).parent
    importing = set()
    for file in package.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if {name.partition(".")[0] for name in names} & {"matplotlib", "PIL"}:
                importing.add(file.relative_to(package).as_posix())
    assert importing == {f"report/{name}.py" for name in ("style", "draw", "draw_mechanism")}


def test_series_can_be_told_apart():
    """Distinct markers and line styles; colours apart in grey and for the colour blind."""
    looks = style.LOOKS[:4]
    assert len({look["marker"] for look in looks}) == 4
    assert len({look["linestyle"] for look in looks}) == 4
    grey = [np.dot(mpl.colors.to_rgb(look["color"]), [0.2126, 0.7152, 0.0722]) for look in looks]
    assert np.min(np.diff(grey)) > 0.05, "dark to light"


@pytest.mark.parametrize(
    "figure",
    [f for f in FIGURES.values() if isinstance(f, MechanismFigure)],
    ids=lambda f: f"figure-{f.name}",
)
def test_mechanism_figures_show_every_joint(figure):
    """All points are labelled, fixed ones filled, at their initial positions in mm."""
    subject = problem(figure.problem)
    mechanism = subject.drawing
    drawing = draw_mechanism.mechanism_figure(figure.title, subject, subject.u0)
    (axes,) = drawing.axes
    labels = {text.get_text() for text in axes.texts}
    assert set("OABCDEFGH") | set(mechanism.bodies) <= labels
    joints = {
        tuple(np.round([line.get_xdata()[0], line.get_ydata()[0]], 9))
        for line in axes.get_lines()
        if line.get_marker() == "o"
    }
    expected = {
        tuple(np.round(1e3 * np.array(point.fixed or point.at), 9))
        for point in mechanism.points.values()
    }
    assert expected < joints
    assert len(joints) == 9


def test_figures_are_made_by_reproduce():
    """The paper's by its studies, those past it by the others; none by both."""
    paper = plot.of_studies(config.REPRODUCED)
    assert paper == ["1", "2", "3", "4", "5", "6", "7", "8", "9", "sensitivity"]
    assert plot.of_studies((*config.REPRODUCED, *config.BEYOND)) == list(FIGURES)
    assert {figure.study for figure in synthetic.CLAIMING} == {*config.BEYOND} - {"integrators"}


@pytest.mark.parametrize(
    "figure",
    [f for f in FIGURES.values() if not isinstance(f, MechanismFigure)],
    ids=lambda f: f"figure-{f.name}",
)
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
    claiming = hasattr(figure, "claims")
    for curve in synthetic.curves(figure) if claiming else figure.curves:
        assert {column: getattr(curve, column) for column in cells[0]} in cells, curve.label


def test_both_files_have_the_same_bytes_again(folder, tmp_path):
    """PNG and SVG of a figure drawn twice."""
    figure = ORDER_FIGURES[1]
    contents = []
    for name in ("one", "two"):
        slopes = plot.series(figure, collect(folder, [figure.study]), folder)
        files = style.save(draw.order_figure(figure, slopes), tmp_path / name)
        contents.append([file.read_bytes() for file in files])
    assert contents[0] == contents[1]
    assert contents[0][0].startswith(b"\x89PNG")
    assert b"<svg" in contents[0][1]


def multiplier_rows(slope, zero_at=None, status="ok"):
    """Rows of Figure 2's optimal series with a given slope."""
    table = []
    for i, h in enumerate((1e-1, 1e-2, 1e-3, 1e-4)):
        row = dict.fromkeys(results.COLUMNS, 0)
        row |= {
            "study": "pendulum-u", "problem": "pendulum",
            "integrator": "newmark beta=0.25 gamma=0.5",
            "form": "u-lambda", "preconditioning": "optimal", "evaluation": "direct",
            "precision": "float64", "linear_solver": "dense-lu", "h": h, "t_end": 3.0,
            "steps": 30, "quantity": "lambda", "measure": "correction", "role": "primary",
            "rms": 0.0 if i == zero_at else 1e-17 * h**slope, "status": status,
            "row_block": "", "stop": "saturation", "met": "",
        }  # fmt: skip
        table.append(row)
    return table


@pytest.mark.parametrize(
    ("slope", "zero_at", "status", "verdict"),
    [
        (0.0, None, "ok", PASS),
        (0.149, None, "ok", PASS),
        (0.151, None, "ok", MISS),
        (-1.0, None, "ok", MISS),
        (0.0, 2, "ok", INCOMPLETE),
        (0.0, None, "not_converged", INCOMPLETE),
    ],
)
def test_verdicts(tmp_path, slope, zero_at, status, verdict):
    """Within the figure's tolerance, complete, every cell ok: nothing else passes."""
    path = tmp_path / "pendulum-u.csv"
    path.write_text(results.csv_text(results.COLUMNS, multiplier_rows(slope, zero_at, status)))
    (found,) = study_slopes(read_study(path), path)
    assert found.figures == ("2",)
    assert (found.expected, found.tolerance, found.verdict) == (0.0, 0.15, verdict)


def test_zeros_are_counted_not_drawn(tmp_path):
    """A zero has no place on a log axis; the figure says that one is missing."""
    path = tmp_path / "pendulum-u.csv"
    path.write_text(results.csv_text(results.COLUMNS, multiplier_rows(0.0, zero_at=1)))
    slopes = study_slopes(read_study(path), path)
    (axes,) = draw.order_figure(FIGURES["2"], slopes).axes
    assert len(axes.get_lines()[0].get_xdata()) == 3
    assert any("1 values are exactly 0" in text.get_text() for text in axes.texts)


@pytest.mark.parametrize(
    ("slope", "stderr", "text"),
    [
        (-2.046, 0.0512, "−2.05 ± 0.05"),
        (-0.001, 0.012, "0.00 ± 0.01"),
        (-0.0031, 0.0004, "−0.0031 ± 0.0004"),
        (2.0, 0.0, "2.00 ± 0.00"),
        (1.0, np.nan, "1.00"),
        (np.nan, np.nan, "n/a"),
    ],
)
def test_fits_are_written_with_the_decimals_of_their_error(slope, stderr, text):
    """A true minus sign, no minus zero, no error that rounds away."""
    assert format_fit(Fit(slope, stderr, 0.0, 4)) == text


def test_tolerances_are_the_claims():
    """What the paper's figures are held to."""
    assert {f.name: f.tolerance for f in ORDER_FIGURES} == {
        "1": 0.15, "2": 0.15, "3": 0.02, "4": 0.15, "5": 0.15, "7": 0.1, "8": 0.1, "9": 0.05,
    }  # fmt: skip
