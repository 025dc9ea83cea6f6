"""Drawings of mechanisms are whole: labels are inside, and names cover no joint and no name."""

import itertools

import pytest
from pages import ROOT
from test_layout import corners, overlap, texts

import newmark_cli as newmark
from newmark_cli.report.drawing import draw
from newmark_cli.report.drawing.draw_mechanism import mechanism_sheet

FILES = [ROOT / "docs/examples" / f"{name}.yaml" for name in ("hoist", "shaper", "space-linkage")]
SUBJECTS = [*map(str, FILES), "stephenson-sixbar", "knee-table", "hooke-shaft", "bathe-noh"]


@pytest.mark.parametrize(
    ("subject", "size"),
    [*zip(SUBJECTS, itertools.cycle([(3.3, None), (7.0, None), (4.5, 3.0)]), strict=False)],
)
def test_names_stand_where_they_hide_nothing(subject, size):
    problem = newmark.problem(subject)
    drawing = draw.drawn(mechanism_sheet("A title", problem, problem.u0), size)
    found = texts(drawing)
    for text, (low, high) in found:
        assert (low >= -1).all(), text
        assert (high <= [drawing.bbox.width + 1, drawing.bbox.height + 1]).all(), text
    (axes,) = drawing.axes
    names = [box for text, box in found if text in axes.texts and text.get_path_effects()]
    mechanism = problem.drawing
    assert len(names) >= len(mechanism.bodies)
    frame = corners(axes.get_window_extent())
    assert all((frame[0] < box[0]).all() and (box[1] < frame[1]).all() for box in names)
    triad = [box for text, box in found if text in axes.texts and "$" in text.get_text()]
    for one, other in itertools.combinations([*names, *triad], 2):
        assert not overlap(one, other)
    signs = [line for line in axes.lines if line.get_marker() == "o" and len(line.get_xdata()) == 1]
    for line, box in itertools.product(signs, names):
        sign = corners(line.get_window_extent())
        middle = (sign[0] + sign[1]) / 2
        assert not ((box[0] + 1 < middle) & (middle < box[1] - 1)).all()


def test_a_motion_is_drawn_and_marks_its_body():
    problem = newmark.problem("knee-table")
    drawing = draw.drawn(mechanism_sheet("", problem, problem.u0))
    entries = [text.get_text() for text in drawing.legends[0].get_texts()]
    assert {"driven body", "motion"} <= set(entries)
    assert "torque" not in entries
