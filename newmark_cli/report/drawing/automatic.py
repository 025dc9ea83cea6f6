"""Figures of any study: what its results compare, arranged as its config says or by themselves.

A study without figures of its own gets one for each problem, form, quantity and measure.
Of the axes in which its series differ, the one with the most values tells the series of a
panel apart; the others become panels, or figures of their own where panels would be too many.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from newmark_cli.newmark.linear.choice import SPARSE, STATIC
from newmark_cli.newmark.orders import UNKNOWNS
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.drawing.work import Costs, costs
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.reading import records
from newmark_cli.report.reading.choosing import grouped, is_among
from newmark_cli.report.reading.figures import (
    Figure,
    Part,
    curve_of,
    label_of,
    looks_of,
    side_by_side,
)
from newmark_cli.report.reading.words import measure_text, value_text
from newmark_cli.study import axes
from newmark_cli.study.drawing import COMPARABLE, WORK_PRECISION
from newmark_cli.study.figure_keys import FigureConfig
from newmark_cli.study.measures import FLOOR_OF, OF_OUTPUTS, RECORDS, symbol

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
#: (axis, value) → part of a file name.
Slugs = Mapping[tuple[str, str], str]
#: Axis → its value that goes without saying.
_USUAL = {axis.name: axis.usual for axis in axes.series_axes()}


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
    ours = [slope for slope in results.slopes if slope.study == study and slope.measure]
    slugs = _slugs(ours)
    ours = [slope for slope in ours if keep(slope)]
    spent = costs(results, [s for s in ours if s.measure == "error"])
    recorded = records.known(results.folder / f"{study}.csv").get("titles")
    titles = recorded if isinstance(recorded, dict) else {}
    arranged: list[Figure] = []
    for definition in _usual(ours) if defined is None else defined:
        for kind in definition.kinds:
            if definition.figure or (kinds and kind not in kinds):
                continue
            slopes = [slope for slope in ours if _shows(definition, kind, slope, spent)]
            for figure in _arranged(study, definition, kind, slopes, slugs, titles):
                name = free(figure.name, [other.name for other in arranged])
                arranged.append(replace(figure, name=name))
    return arranged


def _usual(slopes: Iterable[Slope]) -> list[FigureConfig]:
    """A definition for each kind of rows, those that matter most first."""
    every = {slope.measure for slope in slopes}
    # Predicted floors stand in the figures of what they predict.
    every -= {FLOOR_OF[kind] for kind in every if kind in FLOOR_OF}
    order = dict.fromkeys((*_FIRST, *(name for name in RECORDS if name not in LAST), *LAST))
    return [
        FigureConfig.model_validate({"measure": kind})
        for kind in order
        if kind in every or kind == WORK_PRECISION
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
    slugs: Slugs,
    titles: Mapping[str, str],
) -> Iterator[Figure]:
    """Figures of one kind of rows; their names may be taken already."""
    order = definition.choice.items()
    slopes = sorted(
        slopes, key=lambda s: [_place(values, getattr(s, axis)) for axis, values in order]
    )
    grids = list(_all_grids(slopes, definition, kind))
    places = [where for where, _ in grids]
    axes_of = {axis for where in places for axis in where}
    different = {axis for axis in axes_of if len({where.get(axis) for where in places}) > 1}
    for where, grid in grids:
        apart = {axis: value for axis, value in where.items() if axis in different}
        name = _name_parts(where, kind, slugs)
        if definition.name:
            name = [definition.name, *(slugs[pair] for pair in apart.items())]
        title = _title(where, grid, kind, titles)
        if definition.heading is not None:
            title = _with_values(definition.heading, apart)
        parts = [_part(grid, definition, *pair, titles) for pair in grid.parts]
        yield Figure(
            "-".join((study, *name))[:180],
            title,
            study,
            tuple(parts),
            definition.columns or grid.columns,
            definition.drawn_as,
            note=definition.note or "",
            h=definition.h,
            looks=looks_of(definition, (curve for part in parts for curve in part.curves)),
            style=definition.style or {},
        )


def _with_values(title: str, apart: Mapping[str, str]) -> str:
    """A title, if there is one, with what tells its figure from others."""
    rest = ", ".join(value_text(*pair) for pair in apart.items())
    return f"{title}: {rest}" if title and rest else title


def _all_grids(
    slopes: Sequence[Slope], definition: FigureConfig, kind: str
) -> Iterator[tuple[dict[str, str], "_Grid"]]:
    """Grids of all series, each with the values of the axes that it has one of."""
    compared = (*(definition.series or ()), *(definition.panels or ()))
    one_each = [axis for axis in _ONE_EACH if axis not in compared]
    for values, group in grouped(slopes, one_each).items():
        for apart, grid in _grids(group, definition, kind):
            yield dict(zip(one_each, values, strict=True)) | apart, grid


def _part(
    grid: "_Grid",
    definition: FigureConfig,
    where: Mapping[str, str],
    slopes: Iterable[Slope],
    titles: Mapping[str, str],
) -> Part:
    """A panel of a grid, at values of the axes that tell panels apart."""
    return Part(
        tuple(_panel(definition, axis, value, titles) for axis, value in where.items() if value),
        tuple(
            curve_of(definition, _told_apart(grid, definition, slope), slope.key.named())
            for slope in slopes
        ),
    )


def _told_apart(grid: "_Grid", definition: FigureConfig, slope: Slope) -> list[str]:
    """Axes that a legend names; of gathered series, not those with their usual value."""
    names = list(grid.series)
    if definition.series is not None or len(names) == 1:
        return names
    slopes = [s for _, of_panel in grid.parts for s in of_panel]
    shorter = [axis for axis in names if axis != "linear_solver"]
    if len(grouped(slopes, shorter)) == len(grouped(slopes, names)):
        names = shorter
    spared = [axis for axis in names[1:] if axis != "integrator"]
    return [axis for axis in names if axis not in spared or getattr(slope, axis) != _USUAL[axis]]


def _place(values: Sequence[str], value: str) -> int:
    """Index of a value in a definition, which may name an own scaling without its factors."""
    return values.index(value if value in values else value.partition("[")[0])


@dataclass(frozen=True)
class _Grid:
    """Series of one figure: the axes that tell series and panels apart."""

    series: tuple[str, ...]
    panels: tuple[str, ...]
    parts: Sequence[tuple[Mapping[str, str], Sequence[Slope]]]
    columns: int


def _grids(
    slopes: Sequence[Slope], definition: FigureConfig, kind: str
) -> Iterator[tuple[dict[str, str], _Grid]]:
    """Grids of the series of one problem, form and quantity, with the axes that separate them."""
    values = {
        axis: list(dict.fromkeys(getattr(slope, axis) for slope in slopes)) for axis in COMPARABLE
    }
    varying = [axis for axis in COMPARABLE if len(values[axis]) > 1]
    panels = list(definition.panels or ())
    series = list(definition.series or _most_varied(values, {*varying} - {*panels}))
    rest = [axis for axis in varying if axis not in (*series, *panels)]
    if definition.panels is None:
        # What is least worth comparing becomes figures of their own.
        panels = sorted(rest, key=_preference)
        while panels and len(grouped(slopes, panels)) > MOST_PANELS:
            panels.pop()
    apart = [axis for axis in rest if axis not in panels]
    arranged = definition.series is None and definition.panels is None
    if arranged and _is_gathered(slopes, series, panels, apart, kind):
        series, panels = [*series, *panels], []
    panels.sort(key=COMPARABLE.index)
    for where, group in grouped(slopes, apart).items():
        parts = [
            (dict(zip(panels, at, strict=True)), s) for at, s in grouped(group, panels).items()
        ]
        parts.sort(key=lambda part: [values[axis].index(value) for axis, value in part[0].items()])
        grid = _Grid(tuple(series), tuple(panels), parts, _columns(parts, panels))
        yield dict(zip(apart, where, strict=True)), grid


def _is_gathered(
    slopes: Sequence[Slope],
    series: Sequence[str],
    panels: Sequence[str],
    apart: Sequence[str],
    kind: str,
) -> bool:
    """Whether one panel holds all series: no full grid, or a scatter, and not crowded."""
    sizes = [len(group) for group in grouped(slopes, [*apart, *panels]).values()]
    single = min(sizes) < len(grouped(slopes, series)) or len(sizes) == 1
    single = single and not set(panels) & set(_PANELS)
    most = max(len(group) for group in grouped(slopes, apart).values())
    return (single or kind == WORK_PRECISION) and most <= MOST_GATHERED


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


def _columns(parts: Sequence[tuple[Mapping[str, str], object]], panels: Sequence[str]) -> int:
    """Panels side by side: the values of one axis in a row where two make a grid."""
    if len(panels) == 2:
        sizes = [len({where[axis] for where, _ in parts}) for axis in panels]
        if sizes[0] * sizes[1] == len(parts) and sizes[1] in (2, 3):
            return sizes[1]
    return side_by_side(len(parts))


# -- words --------------------------------------------------------------------------------------


def _panel(definition: FigureConfig, axis: str, value: str, titles: Mapping[str, str]) -> str:
    """Title of a panel's value: its label, or for a mechanism without one its own title."""
    label = label_of(definition, axis, value)
    own = axis == "problem" and label == value_text(axis, value)
    return titles.get(value, label) if own else label


def _title(where: Mapping[str, str], grid: _Grid, kind: str, titles: Mapping[str, str]) -> str:
    """Title from the problem, the form, what all series share, and what is shown."""
    common = grid.parts[0][1][0].key.named()
    varied = (*grid.series, *grid.panels)
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
    return f"{', '.join(parts)}: {_subject(where, kind)}"


def _subject(where: Mapping[str, str], kind: str) -> str:
    words, quantity = measure_text(kind), where.get("quantity", "")
    if kind == "condition":
        words = "condition number"
    if not quantity or quantity in _ONLY:
        return words
    of_it = quantity in UNKNOWNS or quantity in OF_OUTPUTS
    return f"{words} of {symbol(quantity)}" if of_it else f"{words}, {quantity}"


# -- names of files -----------------------------------------------------------------------------


def _name_parts(where: Mapping[str, str], kind: str, slugs: Slugs) -> list[str]:
    """Parts of a figure's file name, in the order in which people look for them."""
    order = ("problem", "form", "measure", "quantity", "initial")
    parts = []
    for axis in (*order, *(axis for axis in where if axis not in order)):
        if axis == "measure":
            parts.append(kind.replace("_", "-"))
        elif where.get(axis) and where[axis] not in _ONLY:
            parts.append(slugs[axis, where[axis]])
    return parts


def _slugs(slopes: Iterable[Slope]) -> Slugs:
    """Unique, safe parts of file names for the values of axes."""
    known: dict[tuple[str, str], str] = {}
    taken: set[tuple[str, str]] = set()
    for slope in slopes:
        for axis, value in slope.key.named().items():
            if (axis, value) not in known:
                slug = _slug(re.sub(r"\.ya?ml$", "", value.partition("[")[0]))
                numbered = (slug, *(f"{slug}-{i}" for i in range(2, 2 + len(taken))))
                slug = next(candidate for candidate in numbered if (axis, candidate) not in taken)
                taken.add((axis, slug))
                known[axis, value] = slug
    return known


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9._]+", "-", text).strip("-.")[:60] or "x"


def free(name: str, taken: Iterable[str]) -> str:
    """A name that no file has yet: this one, or this one and a number."""
    # On some machines files that differ in case are one.
    known = {n.lower() for n in taken}
    numbered = (name if i == 1 else f"{name}-{i}" for i in count(1))
    return next(n for n in numbered if n.lower() not in known)
