"""Figures of any study: what its results compare, arranged as its config says or by themselves.

A study without figures of its own gets one for each problem, form, quantity and measure.
Of the axes in which its series differ, the one with the most values tells the series of a
panel apart; the others become panels, or figures of their own where panels would be too many.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from newmark_cli.newmark.linear.choice import SPARSE, STATIC
from newmark_cli.newmark.orders import UNKNOWNS
from newmark_cli.report.drawing.sheets import Costs, Results, costs
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.reading.choosing import grouped
from newmark_cli.report.reading.figures import (
    Figure,
    Part,
    curve_of,
    figure_of,
    label_of,
    side_by_side,
)
from newmark_cli.study import axes
from newmark_cli.study.axes import is_among, value_text
from newmark_cli.study.cell import DRIFTS
from newmark_cli.study.csv_files import trajectory_path
from newmark_cli.study.entries import FigureConfig
from newmark_cli.study.measures import FLOOR_OF, OF_OUTPUTS, RECORDS, symbol
from newmark_cli.study.showable import COMPARABLE, WORK_PRECISION
from newmark_cli.support.retired import RETIRED

#: Most panels of one figure, and most series of one panel that gathers what is no grid.
MOST_PANELS, MOST_GATHERED = 6, 7

#: Axes whose comparison comes first where several have as many values.
_PREFERRED = ("preconditioning", "integrator", "evaluation")
#: Axes whose values are panels, never the series of one.
_PANELS = ("row_block",)
#: What each figure has one of, unless a definition compares it.
_ONE_EACH = ("problem", "form", "measure", "quantity", "initial")
#: What comes first where not all figures are drawn.
_FIRST = ("correction", "condition", "error", WORK_PRECISION)
#: What comes last there: corrections once more, in other units.
LAST = ("physical_correction", "floor", "physical_floor")
#: Quantities that go without saying: their measures have no other.
_ONLY = ("jacobian", "newton")
#: Axis → its value that goes without saying.
_USUAL = {axis.name: axis.usual for axis in axes.series_axes()} | {"preconditioning": "none"}


# -- which figures ------------------------------------------------------------------------------


def figures(
    study: str,
    results: Results,
    defined: Sequence[FigureConfig] | None = None,
    keep: Callable[[Slope], bool] = lambda slope: True,
    kinds: Sequence[str] = (),
) -> list[Figure]:
    """Figures of a study, those that matter most first unless its config defines them.

    Args:
        defined: Figures that its config defines; None to arrange all that the rows allow.
        kinds: Kinds of rows to draw, or `WORK_PRECISION`; all when empty.
    """
    ours = [s for s in results.slopes if s.study == study and s.measure and keep(s)]
    spent = costs(results, [slope for slope in ours if slope.measure == "error"])
    recorded = results.record(study).get("titles")
    titles = recorded if isinstance(recorded, dict) else {}
    arranged: list[Figure] = []
    kept = results.in_memory is None and any(
        trajectory_path(results.folder, study, parquet).exists() for parquet in (False, True)
    )
    for definition in _usual(ours, kept) if defined is None else defined:
        for kind in () if definition.figure else definition.kinds:
            if not kinds or kind in kinds:
                slopes = [slope for slope in ours if _shows(definition, kind, slope, spent)]
                for figure in _arranged(study, definition, kind, slopes, titles):
                    name = free(figure.name, [other.name for other in arranged])
                    of_drift = figure.kind == "history" and figure.curves[0].quantity in DRIFTS
                    drawn_as = "drift" if of_drift else figure.kind
                    arranged.append(replace(figure, name=name, kind=drawn_as))
    return arranged


def _usual(slopes: Iterable[Slope], kept: bool) -> list[FigureConfig]:
    """A definition for each kind of rows, those that matter most first; over time what is kept."""
    every = {slope.measure for slope in slopes}
    # Predicted floors stand in the figures of what they predict.
    every -= {FLOOR_OF[kind] for kind in every if kind in FLOOR_OF}
    order = dict.fromkeys((*_FIRST, *(name for name in RECORDS if name not in LAST), *LAST))
    return [
        FigureConfig.model_validate(
            {"measure": kind} | ({"kind": "history"} if kept and kind == "trajectory" else {})
        )
        for kind in order
        if (kind in every and kind not in RETIRED) or kind == WORK_PRECISION
    ]


def _shows(definition: FigureConfig, kind: str, slope: Slope, spent: Costs) -> bool:
    """Whether a series is of this kind and has at least two points."""
    work = kind == WORK_PRECISION
    if slope.measure != ("error" if work else kind) or not is_among(slope, definition.choice):
        return False
    if definition.kind in ("history", "drift"):
        return True
    there = np.isfinite(slope.values)
    if work:
        there &= np.isfinite(spent.get(slope.key, np.full(len(slope.h), np.nan)))
    return len(np.unique(slope.h[there])) >= 2


def _arranged(
    study: str,
    definition: FigureConfig,
    kind: str,
    slopes: Sequence[Slope],
    titles: Mapping[str, str],
) -> Iterator[Figure]:
    """Figures of one kind of rows; their names may be taken already."""
    order = definition.choice.items()
    slopes = sorted(
        slopes, key=lambda s: [_place(values, getattr(s, axis)) for axis, values in order]
    )
    grids = list(_grids(slopes, definition, kind, titles))
    for where, varied, series, grid in grids:
        apart = {
            axis: value
            for axis, value in where.items()
            if any(other.get(axis) != value for other, *_ in grids)
        }
        name = _name_parts(where, kind)
        if definition.name:
            name = [definition.name, *map(_slug, apart.values())]
        title = definition.heading
        if title is None:
            title = _title(where, grid[0][1][0], varied, kind, titles)
        elif title and apart:
            title += ": " + ", ".join(label_of(definition, *pair) for pair in apart.items())
        told = _told_apart(
            series, definition, [slope for _, of_panel in grid for slope in of_panel]
        )
        parts = tuple(
            Part(
                of_part,
                tuple(curve_of(definition, told(slope), slope.key.named()) for slope in of_panel),
                of_part[0] if of_part and series == varied else "",
            )
            for of_part, of_panel in grid
        )
        columns = definition.columns or _columns([of_part for of_part, _ in grid])
        stem = "-".join((study, *name))[:180]
        yield figure_of(definition, stem, title, study, parts, columns=columns)


def _told_apart(
    series: Sequence[str], definition: FigureConfig, slopes: Sequence[Slope]
) -> Callable[[Slope], list[str]]:
    """Axes that a legend names; of gathered series, not those with their usual value."""
    if definition.series is not None or len(series) == 1:
        return lambda slope: list(series)
    names = [axis for axis in series if axis != "linear_solver"]
    if len(grouped(slopes, names)) < len(grouped(slopes, series)):
        names = list(series)
    spared = [axis for axis in names[1:] if axis != "integrator"]
    return lambda slope: [
        axis for axis in names if axis not in spared or getattr(slope, axis) != _USUAL[axis]
    ]


def _place(values: Sequence[str], value: str) -> int:
    """Index of a value in a definition, which may name an own scaling without its factors."""
    return values.index(value if value in values else value.partition("[")[0])


#: Titles of panels, and their series.
_Grid = list[tuple[tuple[str, ...], list[Slope]]]


def _grids(
    slopes: Sequence[Slope], definition: FigureConfig, kind: str, titles: Mapping[str, str]
) -> Iterator[tuple[dict[str, str], list[str], list[str], _Grid]]:
    """Of each figure what it has one of, axis → value; what it varies; its series; its panels."""
    compared = (*(definition.series or ()), *(definition.panels or ()))
    one_each = [axis for axis in _ONE_EACH if axis not in compared]
    for at, group in grouped(slopes, one_each).items():
        values = {
            axis: list(dict.fromkeys(getattr(slope, axis) for slope in group))
            for axis in COMPARABLE
        }
        series, panels, apart = _axes(group, values, definition)
        for of_figure, ours in grouped(group, apart).items():
            where = dict(zip((*one_each, *apart), (*at, *of_figure), strict=True))
            varied = [*series, *panels]
            if not compared and (gathered := _gathered(ours, series, panels, kind)):
                yield where, varied, varied, gathered
                continue
            panels = sorted(panels, key=COMPARABLE.index)
            grid = sorted(
                grouped(ours, panels).items(),
                key=lambda part: [values[a].index(v) for a, v in zip(panels, part[0], strict=True)],
            )
            yield (
                where,
                varied,
                series,
                [
                    (
                        tuple(
                            _panel(definition, *pair, titles)
                            for pair in zip(panels, values_of, strict=True)
                            if pair[1]
                        ),
                        of_panel,
                    )
                    for values_of, of_panel in grid
                ],
            )


def _gathered(
    slopes: Sequence[Slope], series: Sequence[str], panels: Sequence[str], kind: str
) -> _Grid:
    """One panel of series that make no grid, or of a scatter; empty where that would be crowded.

    More series have two panels: what differs from the usual one by `series`, and by anything else.
    """
    sizes = [len(group) for group in grouped(slopes, panels).values()]
    is_grid = len(sizes) > 1 and min(sizes) == len(grouped(slopes, series))
    if (is_grid or set(panels) & set(_PANELS)) and kind != WORK_PRECISION:
        return []
    if len(slopes) <= MOST_GATHERED:
        return [((), list(slopes))]
    usual = {
        axis: Counter(getattr(slope, axis) for slope in slopes).most_common(1)[0][0]
        for axis in (*series, *panels)
    }
    changed = [[axis for axis in usual if getattr(s, axis) != usual[axis]] for s in slopes]
    first = [s for s, by in zip(slopes, changed, strict=True) if not {*by} & {*panels}]
    others = [s for s, by in zip(slopes, changed, strict=True) if not by or {*by} & {*panels}]
    if not panels or max(len(first), len(others)) > MOST_GATHERED:
        return []
    # Of axes that change together the first is named.
    also = dict.fromkeys(next(a for a in panels if a in by) for by in changed if {*by} & {*panels})
    return [
        ((", ".join(axes.named(axis).title for axis in of_panel),), ours)
        for of_panel, ours in ((series, first), (also, others))
    ]


def _axes(
    slopes: Sequence[Slope],
    values: Mapping[str, Sequence[str]],
    definition: FigureConfig,
) -> tuple[list[str], list[str], list[str]]:
    """Axes that tell series apart, panels, and figures."""
    varying = [axis for axis in COMPARABLE if len(values[axis]) > 1]
    panels = list(definition.panels or ())
    series = list(definition.series or _most_varied(values, {*varying} - {*panels}))
    rest = [axis for axis in varying if axis not in (*series, *panels)]
    if definition.panels is None and definition.kind != "history":  # its panels are units
        # What is least worth comparing becomes figures of their own.
        panels = sorted(rest, key=_preference)
        while panels and len(grouped(slopes, panels)) > MOST_PANELS:
            panels.pop()
    apart = [axis for axis in rest if axis not in panels]
    return series, panels, apart


def _most_varied(values: Mapping[str, Sequence[str]], varying: set[str]) -> list[str]:
    """The axis with the most values; the scaling where none varies."""
    able = varying - {*_PANELS}
    return [
        min(able, key=lambda axis: (-len(values[axis]), _preference(axis)), default=_PREFERRED[0])
    ]


def _preference(axis: str) -> tuple[int, int]:
    """First what is always panels, then what is preferred, then the others."""
    order = (*_PANELS, *_PREFERRED)
    return (order.index(axis) if axis in order else len(order), COMPARABLE.index(axis))


def _columns(places: Sequence[tuple[str, ...]]) -> int:
    """Panels side by side: the values of one axis in a row where two make a grid."""
    rows, *columns = (
        (len(set(of_axis)) for of_axis in zip(*places, strict=True)) if places[0] else (1,)
    )
    if len(columns) == 1 and rows * columns[0] == len(places) and columns[0] in (2, 3):
        return columns[0]
    return side_by_side(len(places))


# -- words --------------------------------------------------------------------------------------


def _panel(definition: FigureConfig, axis: str, value: str, titles: Mapping[str, str]) -> str:
    """Title of a panel's value: its label, or for a mechanism without one its own title."""
    label = label_of(definition, axis, value)
    own = axis == "problem" and label == value_text(axis, value)
    return titles.get(value, label) if own else label


def _title(
    where: Mapping[str, str],
    first: Slope,
    varied: Sequence[str],
    kind: str,
    titles: Mapping[str, str],
) -> str:
    """Title from the problem, the form, what all series share, and what is shown."""
    common = first.key.named()
    parts = [
        titles.get(where[axis]) or value_text(axis, where[axis])
        for axis in ("problem", "form")
        if axis in where
    ]
    if "preconditioning" not in varied:
        scaling = common["preconditioning"]
        name = value_text("preconditioning", scaling)
        parts.append("no scaling" if scaling == "none" else f"{name} scaling")
    for axis in COMPARABLE:
        if axis in (*varied, "problem", "form", "preconditioning", "quantity"):
            continue
        if axis not in where and common[axis] in (STATIC, SPARSE):
            continue  # `auto` has chosen it
        if common[axis] and common[axis] != _USUAL[axis]:
            parts.append(value_text(axis, common[axis]))
    parts += [value_text("initial", common["initial"])] if common["initial"] else []
    return f"{', '.join(parts)}: {_subject(where, first, kind)}"


def _subject(where: Mapping[str, str], first: Slope, kind: str) -> str:
    words, quantity = value_text("measure", kind), where.get("quantity", "")
    if quantity in _ONLY:
        return "condition number" if kind == "condition" else RECORDS[kind].label(first.key)
    if not quantity:
        return words
    if kind == "trajectory":
        return RECORDS[kind].text(first.key)
    of_it = quantity in UNKNOWNS or quantity in OF_OUTPUTS
    return f"{words} of {symbol(quantity)}" if of_it else f"{words}, {quantity}"


# -- names of files -----------------------------------------------------------------------------


def _name_parts(where: Mapping[str, str], kind: str) -> list[str]:
    """Parts of a figure's file name, in the order in which people look for them."""
    order = ("problem", "form", "measure", "quantity", "initial")
    there = {**where, "measure": kind.replace("_", "-")}
    axes_in_order = (*order, *(axis for axis in where if axis not in order))
    values = (there.get(axis) for axis in axes_in_order)
    return [_slug(value) for value in values if value and value not in _ONLY]


def _slug(value: str) -> str:
    """A value as a part of file names; different ones may have the same."""
    name = re.sub(r"\.ya?ml$", "", value.partition("[")[0])
    return re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-.")[:60] or "x"


def free(name: str, taken: Iterable[str]) -> str:
    """A name that no file has yet: this one, or this one and a number."""
    # On some machines files that differ in case are one.
    known = {n.lower() for n in taken}
    numbered = (name if i == 1 else f"{name}-{i}" for i in count(1))
    return next(n for n in numbered if n.lower() not in known)
