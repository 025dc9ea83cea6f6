"""Sheets as data, the one renderer, and a kind of figure that nothing else knows of."""

import re
from collections import Counter
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
import synthetic
from command_line import invoke

from newmark_cli.report.drawing import draw, panels, plot, sheets, traces
from newmark_cli.report.drawing.panels import Panel, Reference, Sheet, Trace, look
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.judging.slopes import of_csv
from newmark_cli.report.reading import words
from newmark_cli.report.reading.figures import FIGURES, Curve
from newmark_cli.study import csv_files

H = np.array([1e-4, 1e-3, 1e-2, 1e-1])


def trace(place, label, slope=1.0, x=H, **given):
    """A power law."""
    return Trace(label, x, (1 + place) * x**slope, look(place), **given)


def texts(legend):
    """Entries of a legend, broken lines put together."""
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


def test_words_and_hollow_markers_agree(committed_results):
    """`check` says that rounding rules below the step size at which markers become hollow."""
    counted = Counter()
    for slope in committed_results("cures").slopes:
        if slope.record.name == "invariant":
            continue
        told = re.search(r"rules (?:below h = ([^;]+)|at every h)", slope.reason)
        below = float(told[1] or "inf") if told else 0.0
        assert slope.h[traces.ruled(slope)].tolist() == slope.h[slope.h < below].tolist()
        counted[bool(told)] += 1
    assert min(counted.values()) > 10


def test_every_place_in_a_legend_has_a_look_of_its_own():
    """Of twenty series no three have one colour, and no two look alike."""
    looks = [look(place) for place in range(20)]
    assert tuple(looks[:10]) == panels.LOOKS
    assert len({(one.color, one.marker, one.linestyle) for one in looks}) == 20
    assert max(Counter(one.color for one in looks).values()) == 2
    assert len({one.marker for one in looks[:10]}) == 10


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


def test_shipped_figures_are_drawn_as_they_say(committed_results):
    """Every point of every trace, in its colour; every entry of the legend, none cut off.

    One of each kind; `test_layout` draws others.
    """
    chosen = [FIGURES[name] for name in ("2", "3", "12", "14", "16")]
    given = committed_results(*dict.fromkeys(figure.study for figure in chosen))
    for figure in chosen:
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


def test_a_trace_as_it_is_drawn():
    """Joined in its look; what stands apart and what rounding rules is hollow."""
    apart, ruled = np.array([True, False, False, False]), np.array([False, True, False, False])
    one = trace(1, "one", apart=apart, ruled=ruled)
    point = trace(6, "point", x=np.array([1e-2]))
    limits = trace(7, "limits", apart=np.full(4, True))
    drawing = draw.drawn(Sheet("", (Panel((one, point, limits)),)))
    joined, hollow, single, *_ = drawing.axes[0].get_lines()
    assert joined.get_xdata().tolist() == [1e-3, 1e-2, 1e-1]
    assert (joined.get_marker(), joined.get_linestyle()) == ("s", "--")
    assert joined.get_markerfacecolor() == joined.get_color()
    assert hollow.get_xdata().tolist() == [1e-4, 1e-3]
    assert (hollow.get_markerfacecolor(), hollow.get_linestyle()) == ("white", "None")
    assert (single.get_marker(), single.get_linestyle()) == ("*", "None")
    assert texts(drawing.legends[0]) == ["one", "point", "limits"]
    assert drawing.legends[0].legend_handles[-1].get_markerfacecolor() == "white"
    assert drawing.legends[0].get_title().get_text().replace("\n", " ") == (
        "hollow: rounding rules; not joined: runs that did not end well"
    )


def test_what_is_written_in_a_panel():
    """Orders at their lines, how many zeros are missing; in the legend what all lines are."""
    panel = Panel(
        (trace(0, "a"), Trace("zeros", H, np.array([0.0, 0.0, 1.0, np.nan]), look(1))),
        references=(Reference(H[[0, -1]], H[[0, -1]] * 3, "h¹"),),
        levels={0.5: "the most"},
    )
    drawing = draw.drawn(Sheet("", (panel,)))
    (axes,) = drawing.axes
    assert {text.get_text() for text in axes.texts} == {"h¹", "2 values are exactly 0"}
    assert texts(drawing.legends[0]) == ["a", "zeros", "the most", "predicted: h¹"]
    assert [len(line.get_xdata()) for line in axes.get_lines()[:2]] == [4, 1]


@pytest.mark.parametrize(
    ("names", "forms", "text"),
    [
        (("none", "left", "right", "optimal"), ["u-lambda"],
         "scaling left: rows D·h²; right: columns λ·h⁻²; optimal: both"),
        (("none", "left"), ["v-a-lambda"], "scaling left: rows D·h², V·h¹"),
        (("none", "optimal"), ["v-lambda"],
         "scaling optimal: rows D·h² and columns v·h⁻¹, λ·h⁻²"),
        (("none", "left", "right"), ["u-lambda", "a-lambda"],
         "scaling left: rows by powers of h; right: columns by powers of h"),
        (("optimal",), ["u-lambda"], ""),
        (("none", "partial"), ["u-lambda"], ""),
    ],
)  # fmt: skip
def test_what_scalings_scale(names, forms, text):
    """By the powers of Table 2, where series differ in their scaling."""
    series = [
        Curve("", "mine", "hoist", "u", "error", form=form, preconditioning=name)
        for form in forms
        for name in names
    ]
    assert words.scalings(series) == text


def test_an_empty_panel_among_others_has_no_frame():
    """Its title and its zeros are said, or that it has no values; the others keep theirs."""
    zeros, nothing = np.zeros(4), np.full(4, np.nan)
    panels = [
        Panel((Trace("a", H, y, look(0)),), titles=(name,))
        for name, y in (("one", H), ("two", zeros), ("three", nothing))
    ]
    drawing = draw.drawn(Sheet("", tuple(panels), columns=3))
    assert [axes.axison for axes in drawing.axes] == [True, False, False]
    assert [axes.get_title() for axes in drawing.axes] == ["one", "two", "three"]
    said = [[text.get_text() for text in axes.texts] for axes in drawing.axes]
    assert said == [[], ["4 values are exactly 0"], ["no values"]]


def test_a_series_of_zeros_beside_others_is_told_by_its_name():
    """Its entry in the legend has the line that it has in another panel."""
    zeros = Trace("V", H, np.zeros(4), look(1))
    panel = Panel((trace(0, "D", fit="1.00 ± 0.01"), zeros), titles=("one",))
    other = Panel((trace(1, "V"),), titles=("two",))
    full, short = draw._fits(panel)
    assert [text.replace("\u00a0", " ") for text in full] == ["D 1.00 ± 0.01", "V = 0"]
    assert [text.replace("\u00a0", " ") for text in short] == ["1.00", "= 0"]
    drawing = draw.drawn(Sheet("", (panel, other)))
    lines = drawing.legends[0].get_lines()
    assert [line.get_linestyle() for line in lines] == [look(0).linestyle, look(1).linestyle]


@pytest.mark.parametrize(("width", "columns"), [(7.0, 3), (3.3, 2), (1.8, 1)])
def test_groups_of_a_legend_stand_side_by_side_where_there_is_room(width, columns):
    """No group is split, and columns have one height."""
    groups = {"one": "abc", "two": "de", "three": "f"}
    traces = [
        trace(0, f"{label} as long as names", group=group)
        for group, labels in groups.items() for label in labels
    ]  # fmt: skip
    (legend,) = draw.drawn(Sheet("", (Panel(tuple(traces)),)), (width, None)).legends
    listed = [text.get_text() for text in legend.get_texts()]
    assert legend._ncols == columns
    tall = len(listed) // columns
    assert [text for text in listed if text in ("one:", "two:", "three:")] == [
        f"{group}:" for group in groups
    ]
    tops = [listed[i * tall] for i in range(columns)]
    assert tops == {3: ["one:", "two:", "three:"], 2: ["one:", "three:"], 1: ["one:"]}[columns]


def test_a_panel_without_a_value():
    """Zeros only: said, nothing drawn but where it would be, no tick that would mean nothing."""
    drawing = draw.drawn(Sheet("", (Panel((Trace("z", H, np.zeros(4), look(0)),)),)))
    (axes,) = drawing.axes
    assert [text.get_text() for text in axes.texts] == ["4 values are exactly 0"]
    assert H.min() / 2 < axes.get_xlim()[0] < H.min() < H.max() < axes.get_xlim()[1] < 2 * H.max()
    assert len(axes.get_yticks()) == len(axes.get_yticks(minor=True)) == 0
    assert texts(drawing.legends[0]) == ["z"]


def test_colours_of_a_style_stand_for_those_of_the_project():
    cycle = mpl.cycler(color=["#ff0000", "#00ff00"], linestyle=["-", ":"])
    traces = (*(replace(trace(k, "ab"[k]), place=k) for k in (0, 1)), trace(2, "c"))
    drawing = draw.drawn(Sheet("", (Panel(traces),)), settings={"axes.prop_cycle": cycle})
    found = [(line.get_color(), line.get_linestyle()) for line in drawing.axes[0].get_lines()]
    assert found == [("#ff0000", "-"), ("#00ff00", ":"), (look(2).color, look(2).linestyle)]


def test_a_grid_says_once_what_its_panels_share():
    """Titles above columns and beside rows, labels beside and below all; in a column each title."""
    titles = [(row, column) for row in ("u", "λ") for column in ("one", "two")]
    grid = tuple(Panel((trace(0, "a"),), "h", "error", own) for own in titles)
    sheet = Sheet("", grid, columns=2)
    drawing = draw.drawn(sheet)
    assert [axes.get_title() for axes in drawing.axes] == ["one", "two", "", ""]
    assert [[t.get_text() for t in axes.texts] for axes in drawing.axes] == [[], ["u"], [], ["λ"]]
    shared = drawing.subfigs[0]
    assert (shared.get_supxlabel(), shared.get_supylabel()) == ("h", "error")
    assert {axes.get_xlabel() + axes.get_ylabel() for axes in drawing.axes} == {""}
    wide = [
        Panel((trace(0, "a"),), titles=(row, column)) for row in "uv" for column in ("1", "2", "3")
    ]
    turned = draw.drawn(Sheet("", tuple(wide), columns=3), (3.3, None))
    assert [axes.get_title() for axes in turned.axes] == ["u", "v", "", "", "", ""]
    beside = [text.get_text() for axes in turned.axes for text in axes.texts]
    assert beside == ["1", "2", "3"]
    narrow = draw.drawn(sheet, (1.5, None))
    assert [axes.get_title() for axes in narrow.axes] == ["u, one", "u, two", "λ, one", "λ, two"]


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


@pytest.mark.parametrize("problem", ["andrews", "pendulum", "andrews.yaml"])
def test_a_mechanism_is_drawn_where_results_are_about_it(tmp_path, problem):
    """Figure 6 is not drawn into a stranger's results, unless it is asked for by name."""
    own = [row | {"study": "own", "problem": problem} for row in synthetic.rows(FIGURES["12"])]
    path = tmp_path / "own.csv"
    path.write_text(csv_files.csv_text(csv_files.COLUMNS, own))
    given = Results(tmp_path, of_csv(path))
    found = plot.chosen((), given).figures
    assert (FIGURES["6"] in found) == (problem == "andrews")
    # The study has a figure of its own, whatever it is about.
    assert any(figure.name.startswith("own-") for figure in found)
    if problem == "pendulum":
        options = ["--results", str(tmp_path), "--format", "svg"]
        printed = invoke(["plot", "6", *options], tmp_path).stdout
        assert printed.split() == [str(tmp_path / "figures/figure-6.svg")]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.005, "5·10⁻³"), (0.0005, "5·10⁻⁴"), (0.001, "10⁻³"), (2e5, "2·10⁵"), (1e6, "10⁶")],
)
def test_ticks_with_powers(value, text):
    """Numbers with a power of ten; 1 as a digit goes without saying."""
    assert draw._with_power(value) == text
