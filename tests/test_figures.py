"""Figures by the data that they draw, and verdicts by the rows that they read."""

import ast
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import newmark_cli
from newmark_cli.problems.registry import problem
from newmark_cli.report import draw, draw_mechanism, plot, style
from newmark_cli.report.figures import FIGURES, MechanismFigure, OrderFigure
from newmark_cli.report.fits import Fit, power_law
from newmark_cli.report.slopes import (
    INCOMPLETE,
    MISS,
    PASS,
    STATISTIC,
    collect,
    format_fit,
    study_slopes,
)
from newmark_cli.report.table import read_study
from newmark_cli.study import config, results, runner

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
    runner.run_studies(studies, folder, jobs=2)
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
        drawn = rows[STATISTIC[figure.measure]].to_numpy()
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


def synthetic(slope, zero_at=None, status="ok"):
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
    path.write_text(results.csv_text(results.COLUMNS, synthetic(slope, zero_at, status)))
    (found,) = study_slopes(read_study(path), path)
    assert found.figures == ("2",)
    assert (found.expected, found.tolerance, found.verdict) == (0.0, 0.15, verdict)


def test_zeros_are_counted_not_drawn(tmp_path):
    """A zero has no place on a log axis; the figure says that one is missing."""
    path = tmp_path / "pendulum-u.csv"
    path.write_text(results.csv_text(results.COLUMNS, synthetic(0.0, zero_at=1)))
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
