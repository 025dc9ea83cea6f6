"""Figures of any study: what results arrange by themselves, and what a config defines."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from conftest import QUICK
from own_study import DAMPED, TRAPEZOIDAL, H, cells, row, table, written

from newmark_cli.report.drawing import automatic, draw, plot, sheets
from newmark_cli.report.reading.choosing import Choice
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.report.reading.words import unit
from newmark_cli.study.axes import value_text
from newmark_cli.study.csv_files import HISTORY_COLUMNS
from newmark_cli.support.errors import InputError


def drawn(given, *definitions, **options):
    """Name of each figure of `mine` → the figure."""
    found = automatic.figures("mine", given, list(definitions) or None, **options)
    return {figure.name: figure for figure in found}


def test_one_figure_for_each_problem_form_quantity_and_measure(tmp_path):
    """Names say which, corrections come first; the scalings are the series, in the CSV's order."""
    rows = [
        *table(problem=["hoist.yaml", "pendulum"], quantity=["u", "v"],
               preconditioning=["optimal", "none"]),
        *table(0.0, measure="correction", form=["u-lambda", "u-v-lambda"],
               preconditioning=["optimal", "none"]),
    ]  # fmt: skip
    found = drawn(written(tmp_path, rows))
    assert list(found) == [
        "mine-hoist-u-lambda-correction-u",
        "mine-hoist-u-v-lambda-correction-u",
        "mine-hoist-u-lambda-error-u",
        "mine-hoist-u-lambda-error-v",
        "mine-pendulum-u-lambda-error-u",
        "mine-pendulum-u-lambda-error-v",
    ]
    for figure in found.values():
        (part,) = figure.parts
        assert [curve.label for curve in part.curves] == ["optimal", "none"]
    assert found["mine-hoist-u-lambda-error-v"].title == "hoist, (u, λ) form: error of v"
    assert found["mine-pendulum-u-lambda-error-u"].curves[0].problem == "pendulum"


@pytest.mark.parametrize(("values", "series", "panels", "columns"), [
        ({}, ["optimal"], [""], 1),
        ({"integrator": [TRAPEZOIDAL, "bdf2"]}, ["trapezoidal", "BDF2"], [""], 1),
        (
            {"integrator": [TRAPEZOIDAL, "bdf2"], "evaluation": ["direct", "compensated"]},
            ["trapezoidal", "BDF2"], ["direct", "compensated"], 1,
        ),
        (
            {"integrator": [TRAPEZOIDAL, "bdf2"], "preconditioning": ["none", "left"]},
            ["none", "left"], ["trapezoidal", "BDF2"], 1,
        ),
        (
            {"precision": ["float64", "float32"], "evaluation": ["direct", "compensated"]},
            ["direct", "compensated"], ["float64", "float32"], 1,
        ),
        (
            {"integrator": [TRAPEZOIDAL, "bdf1", DAMPED], "preconditioning": ["none", "left"],
             "evaluation": ["direct", "compensated"]},
            ["trapezoidal", "BDF1", "generalized-α (ρ∞ = 0.9)"],
            ["none, direct", "none, compensated", "left, direct", "left, compensated"], 2,
        ),
    ])  # fmt: skip
def test_the_axis_with_most_values_is_the_series(tmp_path, values, series, panels, columns):
    """Then scaling, integrator, evaluation; what else varies tells panels apart."""
    ((_, figure),) = drawn(written(tmp_path, table(**values))).items()
    assert [part.title for part in figure.parts] == panels
    for part in figure.parts:
        assert [curve.label for curve in part.curves] == series
    assert figure.columns == columns


def test_what_would_be_too_many_panels_becomes_figures(tmp_path):
    """Three scalings, and eight integrators by precision: a figure for each integrator."""
    integrators = [f"generalized-alpha rho=0.{i}" for i in range(1, 4)]
    rows = table(
        preconditioning=["none", "left", "right", "optimal"], integrator=integrators,
        precision=["float64", "float32"], evaluation=["direct", "compensated"],
    )  # fmt: skip
    found = drawn(written(tmp_path, rows))
    assert list(found) == [
        "mine-hoist-u-lambda-error-u-float64", "mine-hoist-u-lambda-error-u-float32",
    ]  # fmt: skip
    for figure, precision in zip(found.values(), ("float64", "float32"), strict=True):
        assert len(figure.parts) == 6
        assert figure.columns == 2
        assert {curve.precision for curve in figure.curves} == {precision}
    assert list(found.values())[1].title == "hoist, (u, λ) form, float32: error of u"


def test_row_blocks_are_panels_and_the_start_is_apart(tmp_path):
    """Of sensitivities each row block has a panel; the start and a run never share a figure."""
    rows = [
        *table(0.0, measure="sensitivity", row_block=["D", "C"], steps=0),
        *table(0.0, measure="sensitivity", row_block=["D", "C"]),
    ]
    found = drawn(written(tmp_path, rows))
    assert list(found) == [
        "mine-hoist-u-lambda-sensitivity-u-start", "mine-hoist-u-lambda-sensitivity-u",
    ]  # fmt: skip
    at_start, along = found.values()
    assert [part.title for part in at_start.parts] == ["row D perturbed", "row C perturbed"]
    assert {curve.initial for curve in at_start.curves} == {"start"}
    assert {curve.initial for curve in along.curves} == {""}
    assert "at the start" in at_start.title
    assert "at the start" not in along.title


def test_changes_one_at_a_time_have_two_panels(tmp_path):
    """Those of the axis with most values, and all others; both begin with what is changed."""
    labels = ["index-3", "index-2", "index-1", "ggl", "baumgarte rate_h=1.0"]
    rows = [
        *table(preconditioning="none", formulation=labels),
        *table(preconditioning=["left", "optimal"], formulation="index-3"),
        *table(preconditioning="none", formulation="index-3", projection="velocity",
               multipliers="recovered"),
    ]  # fmt: skip
    given = written(tmp_path, rows)
    (figure,) = drawn(given).values()
    assert [(p.titles, p.group, [c.label for c in p.curves]) for p in figure.parts] == [
        (("formulation",), "formulation",
         ["index 3", "index 2", "index 1", "GGL", "Baumgarte (αh = 1)"]),
        (("preconditioning, projection",), "preconditioning, projection",
         ["index 3", "index 3, left", "index 3, optimal",
          "index 3, velocity projection, recovered λ"]),
    ]  # fmt: skip
    first, second = sheets.sheet(figure, given).panels
    assert first.traces[0].y.tolist() == second.traces[0].y.tolist()
    assert [trace.look for trace in first.traces[:4]] == [trace.look for trace in second.traces]
    drawing = draw.drawn(sheets.sheet(figure, given), (3.3, None))
    headings = [t.get_text() for t in drawing.legends[0].get_texts() if t.get_style() == "italic"]
    assert headings == ["formulation:", "preconditioning, projection:"]


@pytest.mark.parametrize(("axis", "value", "text"), [
    ("formulation", "index-2", "index 2"),
    ("formulation", "baumgarte rate=1000.0", "Baumgarte (α = 1000)"),
    ("formulation", "augmented-lagrangian factor=2.5", "augmented Lagrangian (factor = 2.5)"),
    ("linear_solver", "gmres", "GMRES"),
    ("stop", "relative 0.001", "relative tolerance 0.001"),
])  # fmt: skip
def test_values_are_written_as_in_the_field(axis, value, text):
    assert value_text(axis, value) == text


def kept(folder, integrators, **components):
    """Trajectories of three steps of 0.1 s: column → the values of each integrator."""
    rows = table(measure="trajectory", integrator=integrators, h=(0.1,))
    for one in rows:
        one["quantity"] = "output"
    given = written(folder, rows)
    parts = [
        {"study": "mine", "problem": "hoist.yaml", "form": "u-lambda", "preconditioning": "optimal",
         "evaluation": "direct", "precision": "float64", "linear_solver": "dense-lu",
         "integrator": integrator, "h": 0.1, "step": step, "t": 0.1 * step}
        | {name: (1 + i) * values[step] for name, values in components.items()}
        for i, integrator in enumerate(integrators) for step in range(4)
    ]  # fmt: skip
    (folder / "trajectory").mkdir()
    frame = pd.DataFrame(parts)
    columns = [*HISTORY_COLUMNS, *components]
    frame[columns].to_csv(folder / "trajectory/mine.csv", index=False)
    return given


OUTPUTS = {"output[A.force.x]": [0, 1, 2, 3], "output[A.force.y]": [0, 5, -5, 1],
           "output[P.x]": [0, 0.1, 0.1, 0.2], "output[A.angle]": [9, 1, 1, 1]}  # fmt: skip


def test_a_trajectory_is_drawn_over_time_with_a_panel_for_each_unit(tmp_path):
    """One step size is enough; the start is left out; what varies most comes first."""
    given = kept(tmp_path, [DAMPED], **OUTPUTS)
    (figure,) = plot.chosen(["mine"], given).figures
    assert figure.name == "mine-hoist-u-lambda-trajectory-output"
    assert figure.title.endswith(": output over time")
    sheet = sheets.sheet(figure, given)
    assert [(p.y_label, [t.label for t in p.traces]) for p in sheet.panels] == [
        ("output (N)", ["A.force.y", "A.force.x"]), ("output (m)", ["P.x"]),
        ("output (rad)", ["A.angle"]),
    ]  # fmt: skip
    forces, places, angles = sheet.panels
    assert forces.traces[0].x == pytest.approx([0.1, 0.2, 0.3])
    assert [trace.y.tolist() for trace in forces.traces] == [[5, -5, 1], [1, 2, 3]]
    assert forces.y_limits == pytest.approx((-5.5, 5.5))
    assert angles.y_limits == pytest.approx((0.5, 1.5))
    assert places.traces[0].group == "m"
    assert sheet.note == "$h$ = 0.1 s"
    draw.drawn(sheet)


def test_several_curves_over_time_show_one_component_of_each_unit(tmp_path):
    """Where one goes much farther than the last, a panel below has all of it."""
    given = kept(tmp_path, [DAMPED, "bdf2"], **OUTPUTS)
    (figure,) = plot.chosen(["mine"], given).figures
    sheet = sheets.sheet(figure, given)
    assert [p.y_label for p in sheet.panels] == ["A.force.y (N)", "P.x (m)", "A.angle (rad)"]
    for panel, values in zip(sheet.panels, ([5, -5, 1], [0.1, 0.1, 0.2], [1, 1, 1]), strict=True):
        assert [t.label for t in panel.traces] == ["generalized-α (ρ∞ = 0.9)", "BDF2"]
        for times, trace in enumerate(panel.traces, 1):
            assert trace.y == pytest.approx(times * np.array(values))
    swapped = dataclasses.replace(
        figure, parts=(dataclasses.replace(figure.parts[0], curves=figure.curves[::-1]),)
    )
    sheet = sheets.sheet(swapped, given)
    assert [(p.y_label, p.y_scale) for p in sheet.panels[:2]] == [
        ("A.force.y (N)", "linear"), ("A.force.y (N)", "symlog"),
    ]  # fmt: skip
    assert sheet.panels[1].y_limits == pytest.approx((-11, 11))


@pytest.mark.parametrize(("quantity", "name", "found"), [
    ("u", "P.x", "m"), ("v", "crank.angle", "rad/s"), ("a", "top.origin.z", "m/s²"),
    ("v", "top.d2.x", "1/s"), ("output", "rod.omega.x", "rad/s"), ("output", "A.moment.y", "N m"),
    ("output", "force.x", "m"), ("energy", "energy", "J"), ("lambda", "bars.rod", "SI units"),
    ("u", "1", "SI units"),
])  # fmt: skip
def test_units_of_components(quantity, name, found):
    """By their names; a point may be called as a kind of output."""
    curve = FIGURES["15"].curves[0]
    named = {**curve.key.named(), "quantity": quantity}
    assert unit(type(curve)("", **named), name) == found
    assert unit(type(curve)("", **{**named, "problem": "pendulum"}), name) == "dimensionless"


def test_one_step_size_is_not_enough(tmp_path):
    """A series needs two with a value: zero is one, nothing is none."""
    rows = [
        *table(h=(1e-2,), quantity="u"),
        *table(quantity="v", h=(1e-2, 1e-3)),
        row(1e-2, 1.0, quantity="lambda"),
        row(1e-3, np.nan, quantity="lambda", status="not_converged"),
        row(1e-2, 0.0, measure="invariant", quantity="energy"),
        row(1e-3, 1e-9, measure="invariant", quantity="energy"),
    ]
    assert list(drawn(written(tmp_path, rows))) == [
        "mine-hoist-u-lambda-error-v", "mine-hoist-u-lambda-invariant-energy",
    ]  # fmt: skip


def test_titles_say_what_all_series_have_in_common(tmp_path):
    """What does not go without saying stands in the title, a scaling of one's own by its name."""
    rows = table(
        integrator="hht alpha=0.1", evaluation="compensated", stop="absolute 1e-08",
        linear_solver="gmres", preconditioning="half[left D=beta*h^2]",
        precision=["float64", "float32"],
    )  # fmt: skip
    (figure,) = drawn(written(tmp_path, rows)).values()
    assert figure.title == (
        "hoist, (u, λ) form, half scaling, HHT (α = 0.1), compensated, GMRES, "
        "absolute tolerance 1e-08: error of u"
    )
    assert figure.name == "mine-hoist-u-lambda-error-u"


def test_file_names_are_safe_and_different(tmp_path):
    """Names of problems that differ in signs only get numbers, and no sign is left in them."""
    problems = ["a.yaml", "a", "A b/c", "dir.py:make(x=1 y=2)"]
    found = drawn(written(tmp_path, table(problem=problems)))
    assert list(found) == [
        "mine-a-u-lambda-error-u", "mine-a-u-lambda-error-u-2", "mine-A-b-c-u-lambda-error-u",
        "mine-dir.py-make-x-1-y-2-u-lambda-error-u",
    ]  # fmt: skip
    assert automatic.free("A", ["a", "a-2"]) == "A-3"


def test_sheet_of_a_single_panel(tmp_path):
    """Points as in the CSV, the predicted slope, and in the legend fits and what is not right."""
    rows = [
        *table(preconditioning="optimal", integrator=DAMPED),
        *table(1.0, preconditioning="none", integrator=DAMPED),
    ]
    given = written(tmp_path, rows)
    (figure,) = drawn(given).values()
    sheet = sheets.sheet(figure, given)
    (panel,) = sheet.panels
    optimal, none = panel.traces
    assert optimal.x.tolist() == sorted(H)
    assert optimal.y == pytest.approx(np.array(sorted(H)) ** 2)
    assert optimal.fit == "2.00 ± 0.01"
    assert none.fit == f"1.00 ± 0.01, {given.by_key[figure.curves[1].key].verdict}"
    assert none.fit.endswith("miss")
    (line,) = panel.references
    assert line.text == "h²"
    assert np.polyfit(np.log(line.x), np.log(line.y), 1)[0] == pytest.approx(2)
    assert sheet.note == "scaling optimal: rows D·h² and columns λ·h⁻²; fitted slope"
    assert sheet.words == (
        "hoist, (u, λ) form, generalized-α (ρ∞ = 0.9): error of u. "
        "error of u, optimal: slope 2.00 ± 0.01, predicted 2, pass. "
        "error of u, none: slope 1.00 ± 0.01, predicted 2, miss."
    )
    draw.drawn(sheet)


def test_the_fit_and_its_line_are_about_the_middle(tmp_path):
    """Points where rounding rules are drawn, but the line ends before them."""
    values = [2.4e-5, 2.4e-7, 2.4e-9, 8.3e-10]
    rows = [
        row(h, value, integrator=DAMPED) | {"rounding": 2e-20 / h**2}
        for h, value in zip((1e-2, 1e-3, 1e-4, 1e-5), values, strict=True)
    ]
    given = written(tmp_path, rows)
    (figure,) = drawn(given).values()
    (panel,) = sheets.sheet(figure, given).panels
    (trace,) = panel.traces
    assert trace.y.tolist() == values[::-1]
    assert trace.fit == "2.00 ± 0.02"
    assert trace.bars == pytest.approx(2e-20 / trace.x**2)
    assert trace.uncertain.tolist() == [True, False, False, False]
    assert sheets.sheet(figure, given).heading == "fitted slope; bars: rounding"
    assert panel.references[0].x == pytest.approx([1e-4, 1e-2])


def test_panels_of_one_quantity_share_their_ordinate(tmp_path):
    """A factor of a million between panels is seen; fits stand in the panels.

    The predicted line stands above the largest series of its order, whichever is first.
    """
    both = table(integrator=DAMPED), table(integrator="bdf2")
    rows = [
        one | {"last": factor * of * one["last"], "evaluation": evaluation}
        for evaluation, factor in (("direct", 1), ("compensated", 1e6))
        for series, of in zip(both, (1, 100), strict=True)
        for one in series
    ]
    given = written(tmp_path, rows)
    (figure,) = drawn(given).values()
    sheet = sheets.sheet(figure, given)
    direct, compensated = sheet.panels
    assert direct.y_limits == compensated.y_limits
    assert direct.y_limits[0] < 1e-8
    assert direct.y_limits[1] > 1e8 * 1e-2
    for panel in sheet.panels:
        assert {trace.fit for trace in panel.traces} == {"2.00 ± 0.01"}
        (line,) = panel.references
        largest = max(panel.traces, key=lambda trace: trace.y[0])
        ends = np.interp(line.x, largest.x, largest.y)
        assert ((ends < line.y) & (line.y < 10 * ends)).all()
    assert sheet.note == "above panels: fitted slopes, in this order"
    drawing = draw.drawn(sheet)
    assert [axes.get_ylim() for axes in drawing.axes] == [pytest.approx(direct.y_limits)] * 2


def test_work_precision_matches_cells_to_rows(tmp_path):
    """Operations by the axes, the step size and the steps; joined by h.

    Wall times of marches are drawn where they are asked for.
    """
    rows = table(integrator=[DAMPED, "bdf2"], evaluation=["direct", "compensated"])
    other = [one | {"steps": 7} for one in rows]

    def operations(one):
        factor = 2.0 if one["integrator"] == "bdf2" else 1.0
        return factor / one["h"] * (3 if one["evaluation"] == "compensated" else 1)

    record = {"cells": cells(other, lambda one: 99.0)["cells"]}
    record["cells"] += cells(rows, operations)["cells"]
    given = written(tmp_path, rows, record)
    found = drawn(given)
    assert list(found) == ["mine-hoist-u-lambda-error-u", "mine-hoist-u-lambda-work-precision-u"]
    figure = found["mine-hoist-u-lambda-work-precision-u"]
    (panel,) = sheets.sheet(figure, given).panels
    assert [trace.label for trace in panel.traces] == [
        "generalized-α (ρ∞ = 0.9)", "generalized-α (ρ∞ = 0.9), compensated",
        "BDF2", "BDF2, compensated",
    ]  # fmt: skip
    for trace, factor in zip(panel.traces, (1, 3, 2, 6), strict=True):
        assert trace.x == pytest.approx(factor / np.array(H[::-1]))
    assert panel.traces[1].y == pytest.approx(2 * np.array(H[::-1]) ** 2)
    assert (panel.x_scale, panel.y_scale) == ("log", "log")
    assert panel.x_label == "multiplications and additions"
    assert "system of $N$ unknowns" in sheets.sheet(figure, given).heading
    assert panel.traces[0].said.endswith(
        "0.01 in 10 operations at h = 0.1; 1e-08 in 1e+04 operations at h = 0.0001"
    )
    draw.drawn(sheets.sheet(figure, given))
    (timed,) = sheets.sheet(figure, dataclasses.replace(given, cost="wall-time")).panels
    assert timed.x_label == "wall time of the march (s)"
    assert timed.traces[3].x == pytest.approx(0.6 / np.array(H[::-1]))
    assert timed.traces[0].said.endswith("0.01 in 1 s at h = 0.1; 1e-08 in 1e+03 s at h = 0.0001")


def test_work_precision_needs_a_record(tmp_path):
    """Without operations there is none; a record of other cells is none."""
    rows = table(integrator=DAMPED)
    bare = written(tmp_path / "bare", rows)
    assert list(drawn(bare)) == ["mine-hoist-u-lambda-error-u"]
    with pytest.raises(InputError, match="no operations were counted; run the study again"):
        plot.chosen(["mine"], bare, Choice(("work-precision",)))
    strange = cells([one | {"form": "v-lambda"} for one in rows], lambda one: 1.0)
    assert list(drawn(written(tmp_path / "strange", rows, strange))) == [
        "mine-hoist-u-lambda-error-u"
    ]


def test_a_definition_that_means_several_figures_gives_several(tmp_path):
    """Their names and titles say what differs."""
    rows = table(quantity=["u", "v"], preconditioning=["none", "optimal"])
    entry = {"measure": "error", "title": "Mine", "name": "errors"}
    given = written(tmp_path, rows, {"config": {"figures": [entry, {"measure": "error"}]}})
    found = plot.chosen(["mine"], given).figures
    assert [(figure.name, figure.title) for figure in found] == [
        ("mine-errors-u", "Mine: u"),
        ("mine-errors-v", "Mine: v"),
        ("mine-hoist-u-lambda-error-u", "hoist, (u, λ) form: error of u"),
        ("mine-hoist-u-lambda-error-v", "hoist, (u, λ) form: error of v"),
    ]


#: Keys of a figure that begin one by one, and of one that is known by its number.
SHOWS, NUMBERED = "measure: correction", "figure: 7, problem: pendulum, quantity: u"


@pytest.mark.parametrize(("text", "told"), [
    ("- measure: correcton", "line 8: figures[1].measure: unknown measure 'correcton'"),
    ("- measure: error", "line 8: figures[1].measure: 'error' is not among the study's"),
    ("- quantity: u", "line 8: figures[1].measure: missing"),
    ("- {measure: condition, quantity: u}", "line 8: figures[1].quantity: condition has no 'u'"),
    (f"- {{{SHOWS}, series: h}}", "line 8: figures[1].series: unknown axis 'h'"),
    (f"- {{{SHOWS}, form: v-lambda}}", "figures[1].form: 'v-lambda' is not among"),
    (f"- {{{SHOWS}, problem: pendlum}}", "did you mean 'pendulum'?"),
    (f"- {{{SHOWS}, series: form, panels: form}}", "panels: form already tells"),
    (f"- {{{SHOWS}, titel: x}}", "unknown key; did you mean 'title'?"),
    (f"- {{{SHOWS}, style: {{backend: agg}}}}", "figures[1].style"),
    (f"- {{{SHOWS}, name: a/b}}", "name: must be a name of letters"),
    (f"- {{{SHOWS}, name: a}}\n- {{measure: condition, name: a}}", "line 9: figures[2].name"),
    (f"- {{{SHOWS}, {NUMBERED},\n   series: form, form: u-lambda}}", "[1].title: missing"),
    (f"- {{{SHOWS}, curves: [{{label: x}}]}}", "figures[1].curves: belong to a figure"),
    (f"- {{{SHOWS}, kind: order}}", "line 8: figures[1].kind: unknown name 'order'; did"),
    (f"- {{{SHOWS}, columns: 9}}", "line 8: figures[1].columns: must be"),
    (f"- {{{SHOWS}, {NUMBERED}, title: t,\n   curves: [{{label: a, colour: red}}]}}",
     "line 9: figures[1].curves[1].colour: unknown key"),
    (" []", "line 7: figures: must have at least 1 item, given 0"),
])  # fmt: skip
def test_mistakes_in_figures_are_found(cli, text, told):
    cli.write("quick.yaml", f"{QUICK}figures:\n{text}\n")
    line = cli.refused("validate", "quick.yaml")
    assert line.startswith("newmark-study: quick.yaml, line ")
    assert told in line


def test_choosers_restrict_series_and_figures(tmp_path):
    """Words as people or CSVs write them; several of one option add up."""
    rows = table(
        quantity=["u", "v", "lambda"], preconditioning=["none", "left", "optimal"],
        integrator=[TRAPEZOIDAL, DAMPED], form=["u-lambda", "v-lambda"],
    )  # fmt: skip
    given = written(tmp_path, rows)
    choice = Choice(
        ("error",),
        {"quantity": ("λ", "v"), "preconditioning": ("none", "optimal"),
         "integrator": ("generalized-alpha",), "form": ("v-lambda",), "problem": ("hoist",)},
    )  # fmt: skip
    found = plot.chosen(["mine"], given, choice).figures
    assert [figure.name for figure in found] == [
        "mine-hoist-v-lambda-error-v", "mine-hoist-v-lambda-error-lambda",
    ]  # fmt: skip
    for figure in found:
        assert [curve.label for curve in figure.curves] == ["none", "optimal"]
        assert {curve.integrator for curve in figure.curves} == {DAMPED}


def test_the_few_that_matter_and_the_names_of_the_rest(tmp_path):
    """One for each measure and quantity; any other by its name, all of them when asked for."""
    rows = table(quantity=["u", "v"], problem=[f"p{i}" for i in range(6)])
    given = written(tmp_path, [*rows, *table(0.0, measure="correction", problem="p1")])
    chosen = plot.chosen(["mine"], given)
    assert [figure.name for figure in chosen.figures] == [
        "mine-p1-u-lambda-correction-u", "mine-p0-u-lambda-error-u", "mine-p0-u-lambda-error-v",
    ]  # fmt: skip
    (note,) = chosen.notes
    assert note.startswith("mine: not drawn: mine-p1-u-lambda-error-u, mine-p2-u-lambda-error-u, ")
    assert note.endswith(" and 2 more; name one, choose with --measure, --form, …, "
                         "or draw all with --all")  # fmt: skip
    (named,) = plot.chosen(["mine-p5-u-lambda-error-v"], given).figures
    assert named.name == "mine-p5-u-lambda-error-v"
    everything = plot.chosen(["mine"], given, Choice(everything=True))
    assert (len(everything.figures), everything.notes) == (13, [])
    assert plot.chosen((), given).notes == chosen.notes


def test_series_are_named_ordered_coloured_and_left_out(tmp_path):
    """By values of their axes, in the order of the config; no title; a cycle of colours."""
    rows = table(preconditioning=["none", "left", "optimal"], integrator=DAMPED)
    entry = {
        "measure": "error", "series": ["preconditioning"], "title": "none",
        "preconditioning": ["optimal", "none"], "labels": {"none": "no scaling"},
        "colors": {"optimal": "#123456"},
        "style": {"axes.prop_cycle": {"color": ["#ff0000", "#00ff00"]}, "font.size": 9},
    }  # fmt: skip
    given = written(tmp_path, rows, {"config": {"figures": [entry]}})
    (figure,) = plot.chosen(["mine"], given).figures
    assert figure.title == ""
    sheet = sheets.sheet(figure, given)
    drawing = draw.drawn(sheet)
    assert drawing._suptitle is None
    lines = drawing.axes[0].get_lines()[:2]
    texts = [text.get_text().partition(":")[0] for text in drawing.legends[0].get_texts()]
    assert texts[:2] == ["optimal", "no scaling"]
    assert [line.get_color() for line in lines] == ["#123456", "#00ff00"]
    wrong = dataclasses.replace(sheet, settings={"axes.prop_cycle": "cycler(color=['r'])"})
    with pytest.raises(InputError, match=r"style: axes.prop_cycle: not a setting"):
        draw.drawn(wrong)


def test_a_figure_s_own_resolution_counts_when_it_is_written(tmp_path):
    """3.5 inches of 50 dots; the settings of a style file still stand over it."""
    entry = {"measure": "error", "series": ["integrator"], "style": {"savefig.dpi": 50}}
    given = written(tmp_path, table(integrator=DAMPED), {"config": {"figures": [entry]}})
    figures = plot.chosen(["mine"], given).figures
    style_file = tmp_path / "fine.mplstyle"
    style_file.write_text("savefig.dpi: 100\n")
    for given_style, width in ((None, 175), (style_file, 350)):
        (path,) = plot.plot(figures, given, size=(3.5, None), style_file=given_style)
        assert int.from_bytes(path.read_bytes()[16:20], "big") == width


def test_a_shipped_figure_is_drawn_whole_or_not_at_all(committed_results):
    """Figure 3 shows the condition only; nothing shows all of one scaling."""
    given = committed_results("pendulum-u")
    choice = Choice(("condition",))
    assert plot.chosen(["pendulum-u"], given, choice).figures == [FIGURES["3"]]
    choice = Choice(("condition",), {"preconditioning": ("optimal",)})
    (figure,) = plot.chosen(["pendulum-u"], given, choice).figures
    assert figure.name == "pendulum-u-pendulum-u-lambda-condition"
    assert [curve.preconditioning for curve in figure.curves] == ["optimal"]
    with pytest.raises(InputError, match="nothing to draw"):
        plot.chosen(["1"], given, choice)


def test_a_name_that_is_a_figure_and_a_study_is_the_figure(tmp_path):
    """It says so, unless both are the same."""
    given = written(tmp_path, table(study="6"))
    chosen = plot.chosen(["6"], given)
    assert chosen.figures == [FIGURES["6"]]
    assert chosen.notes == ["'6' is a figure and a study: the figure is drawn"]


def test_a_record_that_nobody_wrote_is_named(tmp_path):
    """Definitions that no run has written."""
    for wrong in (["error"], [{"measure": "speed"}], [{"measure": "error", "series": ["h"]}], 3):
        with pytest.raises(InputError, match=r"mine\.json: figures: not as written by a run"):
            written(tmp_path, table(), {"config": {"figures": wrong}})
