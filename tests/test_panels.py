"""Sheets as data, the one renderer, and a kind of figure that nothing else knows of."""

import numpy as np
import pytest
import synthetic
from click.testing import CliRunner
from each import each

from newmark_cli.cli.commands import cli as command_line
from newmark_cli.report.drawing import draw, panels, plot, sheets
from newmark_cli.report.drawing.panels import (
    Layout,
    Legend,
    Level,
    Panel,
    Reference,
    Sheet,
    Trace,
    from_zero,
    look,
    spread,
)
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.judging.slopes import study_slopes
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.study import results
from newmark_cli.study.reading import read_study

H = np.array([1e-4, 1e-3, 1e-2, 1e-1])


def trace(place, label, slope=1.0, x=H, **given):
    """A power law."""
    return Trace(label, x, (1 + place) * x**slope, look(place), **given)


def texts(legend):
    """Entries of a legend, broken lines put together."""
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


# -- data -----------------------------------------------------------------------------------


def test_every_place_in_a_legend_has_a_look_of_its_own():
    """Seven colours, then the same with other markers and lines; no two alike among 28."""
    looks = [look(place) for place in range(28)]
    assert tuple(looks[:7]) == panels.LOOKS
    assert len({(one.color, one.marker, one.linestyle) for one in looks}) == 28
    for place in range(7):
        again = looks[place::7]
        assert len({one.color for one in again}) == 1
        assert len({(one.marker, one.filled) for one in again}) == 4
    assert len({one.marker for one in looks[:14]}) == 14


def test_points_without_a_place_are_not_shown():
    """NaN nowhere, zero and less not on logarithmic axes, on either axis."""
    values = np.array([np.nan, np.inf, -1.0, 0.0, 2.0])
    y = Trace("y", np.arange(1.0, 6.0), values, look(0))
    assert y.shown("log", "log").tolist() == [False, False, False, False, True]
    assert y.shown("log", "linear").tolist() == [False, False, True, True, True]
    assert y.shown("linear", "symlog").tolist() == [False, False, True, True, True]
    assert y.zeros == 1
    x = Trace("x", values, np.arange(1.0, 6.0), look(0))
    assert x.shown("log", "log").tolist() == [False, False, False, False, True]
    assert Panel((y, x)).empty is False
    assert Panel((Trace("z", H, np.zeros(4), look(0)),)).empty is True


def test_ends_of_ordinates():
    """At least four decades around the values, or from below zero to above the top."""
    low, high = spread([np.array([1.0, 1.1]), np.array([0.0, np.nan])])
    assert low * high == pytest.approx(1.1)
    assert np.log10(high / low) == pytest.approx(4)
    low, high = spread([np.array([1e-5, 1e5])], headroom=0.4)
    assert (np.log10(low), np.log10(high)) == (pytest.approx(-6.2), pytest.approx(9))
    assert spread([np.array([0.0, np.nan])]) is None
    assert spread([]) is None
    assert from_zero(2.0) == pytest.approx((-0.12, 2.14))


def test_a_sheet_in_words():
    """Its title, and what its traces say; who says nothing is not mentioned."""
    said = (trace(0, "a", said="a: slope 1"), trace(1, "b"), trace(2, "c", said="c: 5 at h = 1"))
    sheet = Sheet("Title", (Panel(said[:2]), Panel(said[2:])))
    assert sheet.words == "Title. a: slope 1. c: 5 at h = 1."


def test_sizes_of_sheets():
    """A column of panels has a journal's width; what is wider says so."""
    one, many = Panel((trace(0, "a"),)), tuple(Panel((trace(0, "a"),)) for _ in range(5))
    assert (Sheet("", (one,)).width, Sheet("", (one,)).wide) == (3.5, False)
    assert (Sheet("", many, columns=3).rows, Sheet("", many, columns=3).wide) == (2, True)
    laid_out = Sheet("", (one,), layout=Layout((5.0, 3.0), (0.1, 0.1, 0.8, 0.8)))
    assert (laid_out.width, laid_out.wide) == (5.0, True)


# -- the renderer ---------------------------------------------------------------------------


def inside(drawing, box, slack=1.0):
    """Whether nothing of a box is cut off by the edges of a sheet (pixels)."""
    return (
        box.x0 >= -slack
        and box.x1 <= drawing.bbox.width + slack
        and box.y0 >= -slack
        and box.y1 <= drawing.bbox.height + slack
    )


def require_whole(drawing):
    """Titles, labels and the legend are inside the sheet; the legend covers no panel."""
    with draw._without_minor_ticks(drawing.axes):  # shorter than the others, and many
        boxes = [axes.get_tightbbox() for axes in drawing.axes]
    assert all(inside(drawing, box) for box in boxes)
    assert all(inside(drawing, text.get_window_extent()) for text in drawing.texts)
    for legend in drawing.legends:
        extent = legend.get_window_extent()
        assert inside(drawing, extent)
        assert all(box.y0 >= extent.y1 - 2 for box in boxes)
    for axes in drawing.axes:
        assert axes.get_window_extent().height > 0.6 * drawing.dpi
        label = axes.yaxis.label.get_window_extent()
        assert label.height <= 1.25 * axes.get_window_extent().height


LONG = "half-cure with left scaling of the rows and right scaling of λ by 1/h, compensated"


@each(
    "sheet",
    [
        Sheet(
            "A mechanism of one's own, with a title that does not fit into one line of a column",
            (
                Panel(
                    tuple(trace(i, f"{LONG} {i}", fit="1.00 ± 0.01") for i in range(3)),
                    "step size $h$ (s)",
                    r"last decreasing correction of the multipliers $\|\Delta\bar \lambda\|$ (rms)",
                ),
            ),
            legend=Legend("fitted slope"),
        ),
        Sheet(
            "Four forms",
            tuple(
                Panel(
                    (trace(0, "none", fit="1.00"), trace(1, LONG, fit="1.00")),
                    "step size $h$ (s)",
                    "condition number",
                    title,
                    fits=True,
                )
                for title in "abcd"
            ),
            columns=3,
            share_y=True,
        ),
        Sheet(
            "Two",
            tuple(Panel((trace(i, "one"),), "wall time (s)", "error", "own") for i in range(2)),
            share_x=False,
        ),
    ],
)
def test_nothing_is_cut_off(sheet):
    """Without a layout, room is made for titles, labels and legends, however long they are."""
    drawing = draw.drawn(sheet)
    assert len(drawing.axes) == len(sheet.panels)
    require_whole(drawing)
    fits = sheet.panels[0].fits
    entries = [
        one.label if fits or not one.fit else f"{one.label}: {one.fit}"
        for one in sheet.panels[0].traces
    ]
    assert texts(drawing.legends[0]) == entries
    # Every column has a label at its foot, and numbers at its ticks.
    for axes in drawing.axes[-sheet.columns :]:
        assert axes.get_xlabel() == sheet.panels[0].x_label
        assert any(label.get_text() for label in axes.get_xticklabels())


def test_shipped_figures_are_drawn_as_they_say(committed_results):
    """Every point of every trace, in its colour; every entry of the legend, none cut off."""
    given = committed_results(*dict.fromkeys(f.study for f in FIGURES.values() if f.study))
    for figure in FIGURES.values():
        sheet = sheets.sheet(figure, given)
        drawing = draw.drawn(sheet)
        for panel, axes in zip(sheet.panels, drawing.axes, strict=True):
            drawn = {
                (line.get_color(), x, y)
                for line in axes.get_lines()
                for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
            }
            for one in panel.traces:
                shown = one.shown(panel.x_scale, panel.y_scale)
                points = zip(one.x[shown], one.y[shown], strict=True)
                assert {(one.look.color, x, y) for x, y in points} <= drawn
            if panel.y_limits:
                assert axes.get_ylim() == panel.y_limits
        assert len(drawing.legends) == 1
        for legend in drawing.legends:
            assert inside(drawing, legend.get_window_extent()), figure.name


def test_a_trace_as_it_is_drawn():
    """Joined in its look; what stands apart has open markers; a single point has no line."""
    apart = np.array([True, True, False, False])
    one = trace(1, "one", apart=apart)
    point = trace(6, "point", x=np.array([1e-2]))
    drawing = draw.drawn(Sheet("", (Panel((one, point)),)))
    joined, open_, single = drawing.axes[0].get_lines()
    assert joined.get_xdata().tolist() == [1e-2, 1e-1]
    assert (joined.get_marker(), joined.get_linestyle()) == ("x", "--")
    assert open_.get_xdata().tolist() == [1e-4, 1e-3]
    assert (open_.get_markerfacecolor(), open_.get_linestyle()) == ("none", "None")
    assert (single.get_marker(), single.get_linestyle()) == ("*", "None")
    assert texts(drawing.legends[0]) == ["one", "point"]


def test_what_is_written_in_a_panel():
    """Slopes at their lines, words on levels, and how many zeros are missing."""
    panel = Panel(
        (trace(0, "a"), Trace("zeros", H, np.array([0.0, 0.0, 1.0, np.nan]), look(1))),
        x_room=0.2,
        references=(Reference(H[[0, -1]], H[[0, -1]] * 3, "h¹"),),
        levels=(Level(0.5, "the most"),),
    )
    drawing = draw.drawn(Sheet("", (panel,)))
    (axes,) = drawing.axes
    assert [text.get_text() for text in axes.texts] == [
        "h¹", "the most", "2 values are exactly 0"
    ]  # fmt: skip
    assert axes.texts[0].xy == (1e-1, pytest.approx(0.3))
    assert texts(drawing.legends[0]) == ["a", "zeros", "predicted"]
    left, right = axes.get_xlim()
    assert right / 1e-1 > 3 * (1e-4 / left)
    assert [len(line.get_xdata()) for line in axes.get_lines()[:2]] == [4, 1]


def test_a_panel_without_a_value():
    """Zeros only: said, nothing drawn, no tick that would mean nothing."""
    drawing = draw.drawn(Sheet("", (Panel((Trace("z", H[:1], np.zeros(1), look(0)),)),)))
    (axes,) = drawing.axes
    assert [text.get_text() for text in axes.texts] == ["1 value is exactly 0"]
    assert axes.get_yticks().tolist() == []
    assert texts(drawing.legends[0]) == ["z"]


def test_fits_are_written_where_no_points_are():
    """In the upper right corner if it is free, otherwise in one that is."""
    for slope, aligned in ((-1.0, ("right", "top")), (1.0, ("left", "top"))):
        panel = Panel((trace(0, "one", slope, fit="1.00"), trace(1, "two", slope)), fits=True)
        (text,) = draw.drawn(Sheet("", (panel,))).axes[0].texts
        assert text.get_text() == "one: 1.00"
        assert (text.get_ha(), text.get_va()) == aligned


def test_fits_do_not_cover_orders():
    """The text at the end of a line counts like a point."""
    level = trace(0, "one", 0.0, fit="0.00")
    for word, aligned in (("", ("right", "top")), ("h²", ("left", "top"))):
        line = Reference(H[[0, -1]], np.array([1e-1, 1e2]), word)
        panel = Panel((level,), y_limits=(1e-9, 1e3), references=(line,), fits=True)
        *_, text = draw.drawn(Sheet("", (panel,))).axes[0].texts
        assert text.get_text() == "one: 0.00"
        assert (text.get_ha(), text.get_va()) == aligned


def test_ticks_within_a_decade():
    """Times between 0.2 and 0.8 s have numbers at their ticks; step sizes have powers of ten."""
    times = trace(0, "a", x=np.array([0.21, 0.4, 0.79]))
    for one, expected in ((times, {"0.5"}), (trace(0, "a"), {"10⁻³", "10⁻²"})):
        (axes,) = draw.drawn(Sheet("", (Panel((one,)),))).axes
        low, high = axes.get_xlim()
        seen = {
            label.get_text()
            for label in axes.get_xticklabels()
            if low <= label.get_position()[0] <= high
        }
        assert expected <= seen


def test_settings_are_those_of_the_sheet():
    """What a sheet sets holds for it, and for no other."""
    sizes = []
    for settings in ({"axes.labelsize": 5}, {}):
        sheet = Sheet("", (Panel((trace(0, "a"),), "x"),), settings=settings)
        sizes.append(draw.drawn(sheet).axes[0].xaxis.label.get_fontsize())
    assert sizes == [5, 8]


# -- whose results a mechanism belongs to ---------------------------------------------------


def ran(*arguments):
    """What a command in this process printed."""
    done = CliRunner().invoke(command_line, [*map(str, arguments)], standalone_mode=False)
    assert done.exception is None, done.exception
    assert done.return_value == 0
    return done


@each("problem", ["andrews", "pendulum", "andrews.yaml"])
def test_a_mechanism_is_drawn_where_results_are_about_it(tmp_path, problem):
    """Figure 6 is not drawn into a stranger's results, unless it is asked for by name."""
    own = [row | {"study": "own", "problem": problem} for row in synthetic.rows(FIGURES["12"])]
    path = tmp_path / "own.csv"
    path.write_text(results.csv_text(results.COLUMNS, own))
    given = Results(tmp_path, study_slopes(read_study(path), path))
    found = plot.chosen((), given).figures
    assert (FIGURES["6"] in found) == (problem == "andrews")
    # The study has a figure of its own, whatever it is about.
    assert any(figure.name.startswith("own-") for figure in found)
    printed = ran("plot", "6", "--results", tmp_path, "--format", "svg").stdout
    assert printed.split() == [f"{tmp_path}/figures/figure-6.svg"]


@each("value, text", [(0.0005, "0.0005"), (5e4, "50000"), (2e5, "2·10⁵"), (1e6, "10⁶")])
def test_ticks_of_short_axes(value, text):
    """Numbers of less than two powers of ten on an axis: large ones as powers."""
    assert draw._number(value) == text
