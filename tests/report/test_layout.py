"""What is drawn is whole, and nothing lies on anything else: measured on the drawn boxes."""

import itertools

import numpy as np
import pytest
from covering import covering

from newmark_cli.report.drawing import draw, sheets
from newmark_cli.report.drawing.panels import Panel, Reference, Sheet, Trace, look
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.support.errors import InputError

H = np.array([1e-5, 1e-4, 1e-3, 1e-2])
LONG = "half-cure with left scaling of the rows and right scaling of λ by 1/h, compensated"


def corners(box):
    return np.array([[box.x0, box.y0], [box.x1, box.y1]])


def overlap(one, other, slack=1.0):
    """Whether two boxes have more in common than a line (pixels)."""
    (a, b), (c, d) = one, other
    return bool(np.all(np.minimum(b, d) - np.maximum(a, c) > slack))


def texts(drawing):
    """Every text that is seen and its box, those of a legend as one."""
    drawing.draw_without_rendering()
    found = [(legend, corners(legend.get_window_extent())) for legend in drawing.legends]
    inner = drawing.subfigs[0]
    several = [drawing._suptitle, inner._supxlabel, inner._supylabel]
    for axes in drawing.axes:
        several += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            several += [
                tick.label1 for tick in axis.get_major_ticks()
                if tick.label1.get_visible() and low <= tick.get_loc() <= high
            ]  # fmt: skip
    found += [
        (text, corners(text.get_window_extent()))
        for text in several
        if text is not None and text.get_text().strip()
    ]
    return found


def require_whole(drawing):
    """All inside the canvas; no two texts overlap, and none covers a point or a line."""
    found = texts(drawing)
    canvas = np.array([drawing.bbox.width, drawing.bbox.height])
    for text, (low, high) in found:
        assert np.all(low >= -1), text
        assert np.all(high <= canvas + 1), text
    for (text, box), (other, further) in itertools.combinations(found, 2):
        assert not overlap(box, further), (text, other)
    for axes in drawing.axes:
        points = np.concatenate(
            [np.empty((0, 2)), *(draw._pixels(axes, x) for x in axes.get_lines())]
        )
        low, high = corners(axes.get_window_extent())
        points = points[np.all((points > low) & (points < high), axis=1)]
        for text, (low, high) in found:
            assert not np.any(np.all((points > low + 1) & (points < high - 1), axis=1)), text


def sheet(kind, panels, series, words):
    """A sheet of a kind, with so many panels of so many series."""
    labels = [f"{LONG} {k}" if words == "long" else f"ρ = 0.{k}" for k in range(series)]
    several = panels > 1

    def panel(place):
        x_scale, y_scale = ("linear", "symlog") if kind == "history" else ("log", "log")
        orders = range(-4, 0) if words == "long" else (2,)
        traces = tuple(
            Trace(
                label, H, (1 + k) * 10.0**place * H ** orders[k % len(orders)], look(k % 7), k,
                "abc"[place % 3] * 8 if kind == "grouped" else "",
                ruled=H < 1e-4, bars=0.2 * H, fit="−2.00 ± 0.01" if kind == "orders" else "",
            )
            for k, label in enumerate(labels)
        )  # fmt: skip
        lines = [Reference(H[[0, -1]], 3.0 * H[[0, -1]] ** n, f"h{n}") for n in orders]
        grid = kind == "grouped" and panels in (4, 6, 9)
        columns = {4: 2}.get(panels, 3)
        titles = ("row", f"column {place}") if not grid else (
            f"mechanism {place // columns}", f"constraint rows {place % columns}",
        )  # fmt: skip
        return Panel(
            traces, "step size $h$ (s)" if several else "multiplications and additions",
            r"last decreasing correction of the multipliers $\|\Delta\bar \lambda\|$ (rms)",
            titles if several else (), x_scale, y_scale, linthresh=1e-3,
            references=tuple(lines) if kind == "orders" else (),
            levels={600.0: "no convergence in 600 iterations"} if kind == "work" else {},
        )  # fmt: skip

    return Sheet(
        "A mechanism of one's own, with a title that does not fit into one line of a column",
        tuple(map(panel, range(panels))), {1: 1, 2: 1, 4: 2}.get(panels, 3), "fitted slope",
        share_x=kind != "work",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "panels", "series", "words", "width"),
    covering(
        ("orders", "work", "history", "grouped"),
        (1, 4),
        (2, 6),
        ("short", "long"),
        (3.3, 7.0),
    ),
)
def test_nothing_lies_on_anything_else(kind, panels, series, words, width):
    """Of any kind, from a column's width to a page's, one panel or four, few series or many."""
    require_whole(draw.drawn(sheet(kind, panels, series, words), (width, None)))


def test_a_shipped_figure_is_whole(committed_results):
    """The one with most panels; mechanisms are in `test_drawn_mechanisms`."""
    figure = FIGURES["sensitivity"]
    given = committed_results(figure.study)
    require_whole(draw.drawn(sheets.sheet(figure, given), (3.3, None)))


def test_a_size_that_is_given_is_kept():
    """README's figure at the width of a column: four series, their slopes in the legend."""
    drawing = draw.drawn(sheet("orders", 1, 4, "short"), (3.3, 2.4))
    assert drawing.get_size_inches().tolist() == [3.3, 2.4]
    require_whole(drawing)


def test_a_size_without_room_names_one():
    """Two panels in a column: the height that they take; ten series leave axes of a few mm."""
    with pytest.raises(InputError, match=r"3.3x1 inches has no room .* '--size 3.3' makes it"):
        draw.drawn(sheet("orders", 2, 4, "short"), (3.3, 1.0))
    with pytest.raises(InputError, match=r"3.3x2.4 inches has no room .* '--size 3.3' makes it"):
        draw.drawn(sheet("orders", 1, 10, "short"), (3.3, 2.4))
