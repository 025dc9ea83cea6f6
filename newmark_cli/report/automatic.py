"""Figures of any study: what its results compare, arranged as its config says or by themselves.

A study without figures of its own gets one for each problem, form, quantity and measure.
Of the axes in which its series differ, the one with the most values tells the series of a
panel apart; the others become panels, or figures of their own where panels would be too many.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from newmark_cli.newmark.orders import UNKNOWNS
from newmark_cli.report import traces
from newmark_cli.report.curves import TRAPEZOIDAL, Curve, floor_of
from newmark_cli.report.kinds import Figure, Results
from newmark_cli.report.panels import (
    LOOKS,
    Legend,
    Look,
    Panel,
    Sheet,
    Trace,
    from_zero,
    look,
    spread,
)
from newmark_cli.report.parts import OfParts, Part
from newmark_cli.report.text import in_words
from newmark_cli.report.verdicts import PASS, SHOWN
from newmark_cli.report.work import NOT_JOINED, Costs, WorkPrecisionFigure, costs
from newmark_cli.study import axes
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.drawing import COMPARABLE, WORK_PRECISION, Definition
from newmark_cli.study.measures import FLOOR_OF, OF_OUTPUTS, RECORDS, symbol

if TYPE_CHECKING:
    from newmark_cli.report.slopes import Slope

#: Most panels of one figure, and most series of one panel that gathers what is no grid.
MOST_PANELS, MOST_GATHERED = 6, len(LOOKS)

#: Axes whose comparison comes first where several have as many values.
_PREFERRED = ("preconditioning", "integrator", "evaluation")
#: Axes whose values are panels, never the series of one.
_PANELS = ("row_block",)
#: What each figure has one of, unless a definition compares it.
_ONE_EACH = ("problem", "form", "measure", "quantity", "initial")
#: What comes first where not all figures are drawn.
_FIRST = ("correction", "condition", "error", WORK_PRECISION)
#: What comes last there: corrections once more, in other units.
_LAST = ("physical_correction", "floor", "physical_floor")
#: Quantities that go without saying: their measures have no other.
_ONLY = ("jacobian", "newton")


@dataclass(frozen=True)
class SeriesFigure(OfParts):
    """Series of a study against the step size, a panel for each combination of some axes."""

    def require(self, results: Results) -> None:
        """All series."""
        results.series(self)

    def sheet(self, results: Results) -> Sheet:
        """Fits in the legend of a single panel, in a corner of each of several."""
        series = {slope.key: slope for slope in results.series(self)}
        places = {label: i for i, label in enumerate(dict.fromkeys(c.label for c in self.curves))}
        several = len(self.parts) > 1
        panels = [
            self._panel(part, [series[curve.key] for curve in part.curves], places, several)
            for part in self.parts
        ]
        alike = several and _alike(series.values())
        if alike:
            every = list(series.values())
            panels = [
                _with_limits(panel, [series[curve.key] for curve in part.curves], every)
                for panel, part in zip(panels, self.parts, strict=True)
            ]
        every_slope = {slope.key: slope for slope in results.slopes}
        panels = [
            replace(panel, traces=(*panel.traces, *_floors(part, every_slope)))
            for panel, part in zip(panels, self.parts, strict=True)
        ]
        if self.columns > 2:  # narrow ones, where orders take a larger share
            panels = [replace(panel, x_room=2 * panel.x_room) for panel in panels]
        fitted = any(not np.isnan(slope.expected) for slope in series.values())
        apart = any(t.apart is not None and t.apart.any() for p in panels for t in p.traces)
        notes = ["fitted slope"] if fitted and not several else []
        notes += [NOT_JOINED] if apart else []
        return Sheet(
            self.title,
            tuple(panels),
            self.columns,
            Legend("; ".join(notes)),
            panel_size=None if several else (3.5, 2.5),
            share_y=alike,
            ticks=(8, 8),
        )

    def _panel(
        self, part: Part, slopes: Sequence["Slope"], places: Mapping[str, int], several: bool
    ) -> Panel:
        drawn = [
            _trace(slope, curve.label, places[curve.label], part.title)
            for curve, slope in zip(part.curves, slopes, strict=True)
        ]
        # Fits of many series would cover them.
        fits = several and len(drawn) <= 4
        panel = traces.panel(slopes, drawn, slopes[0].record.linear, part.title, fits)
        if fits and not slopes[0].record.linear:
            panel = _with_limits(panel, slopes, slopes)
        if len({slope.quantity for slope in slopes}) > 1:
            panel = replace(panel, y_label=_words(slopes[0].measure))
        if several and not fits:
            panel = replace(panel, traces=tuple(replace(t, fit="") for t in panel.traces))
        return panel


#: Predicted floors lie on what they predict.
_FLOOR = Look("#000000", "+", 4.0, linestyle=":", linewidth=0.8)


def _floors(part: Part, slopes: Mapping[SeriesKey, "Slope"]) -> list[Trace]:
    """The predicted floors of measured series, where there are any."""
    keys = (floor_of(curve.key) for curve in part.curves)
    return [
        traces.trace(slopes[key], "predicted floor", _FLOOR, fit="", name="predicted floor")
        for key in keys
        if key is not None and key in slopes
    ]


def _trace(slope: "Slope", label: str, place: int, panel: str) -> Trace:
    """A series with its verdict, cells that did not end well apart."""
    found = traces.trace(slope, label, look(place), name=", ".join(filter(None, (panel, label))))
    undecided = slope.verdict not in (PASS, SHOWN)
    ok = np.isin(np.array(slope.statuses, str)[np.argsort(slope.h)], slope.record.ok)
    return replace(
        found,
        apart=~ok,
        fit=", ".join(filter(None, (found.fit, slope.verdict if undecided else ""))),
        said=found.said + (f", {slope.verdict}" if slope.verdict != SHOWN else ""),
    )


def _alike(slopes: Iterable["Slope"]) -> bool:
    """Whether all series are of one quantity, so that panels can share an ordinate."""
    return len({(s.problem, s.quantity, s.measure, s.row_block) for s in slopes}) == 1


def _with_limits(panel: Panel, slopes: Sequence["Slope"], every: Sequence["Slope"]) -> Panel:
    """A panel whose ordinate suits several series besides its own, with room for its fits."""
    if panel.y_scale == "linear":
        found = [float(np.max(slope.values, initial=0, where=slope.values > 0)) for slope in every]
        top = 1.0 if slopes[0].record.share else 1.1 * max(found)
        return replace(panel, y_limits=from_zero(top) if top > 0 else None)
    lines = sum(bool(trace.fit) for trace in panel.traces) if panel.fits else 0
    limits = spread([slope.values for slope in every], max(0.12, 0.165 * lines))
    references = () if limits is None else traces.predicted(slopes, limits)
    return replace(panel, y_limits=limits, references=references)


# -- which figures ------------------------------------------------------------------------------


def figures(
    study: str,
    results: Results,
    defined: Sequence[Definition] | None = None,
    keep: Callable[["Slope"], bool] = lambda slope: True,
    kinds: Sequence[str] = (),
) -> list[Figure]:
    """Figures of a study, those that matter most first unless its config defines them.

    Args:
        study: Its name.
        results: What they are made from.
        defined: Figures that its config defines; None to arrange all that the rows allow.
        keep: Which series to draw.
        kinds: Kinds of rows to draw, or `WORK_PRECISION`; all when empty.
    """
    ours = [slope for slope in results.slopes if slope.study == study and slope.measure]
    spelled = _Slugs(ours)
    ours = [slope for slope in ours if keep(slope)]
    every = tuple(dict.fromkeys(slope.measure for slope in ours))
    spent = costs(results, [s for s in ours if s.measure == "error"])
    given = defined
    if given is None:
        # Predicted floors stand in the figures of what they predict.
        beside = {FLOOR_OF[kind] for kind in every if kind in FLOOR_OF}
        ranked = sorted(({*every, WORK_PRECISION} - beside), key=_rank)
        given = [Definition((kind,)) for kind in ranked]
    found: list[Figure] = []
    names = _Names()
    for definition in given:
        for kind in definition.kinds:
            if not kinds or kind in kinds:
                slopes = [slope for slope in ours if _shows(definition, kind, slope, spent)]
                found += _defined(study, definition, kind, slopes, spelled, names)
    return found


def _rank(kind: str) -> int:
    order = (*_FIRST, *(name for name in RECORDS if name not in (*_FIRST, *_LAST)), *_LAST)
    return order.index(kind)


def _shows(definition: Definition, kind: str, slope: "Slope", spent: Costs) -> bool:
    """Whether a series is of this kind and has at least two points."""
    work = kind == WORK_PRECISION
    rows = (definition.quantity, definition.problem, definition.form)
    given = (slope.quantity, slope.problem, slope.form)
    if slope.measure != ("error" if work else kind):
        return False
    if not all(not some or value in some for some, value in zip(rows, given, strict=True)):
        return False
    there = np.isfinite(slope.values)
    if work:
        there &= np.isfinite(spent.get(slope.key, np.full(len(slope.h), np.nan)))
    return len(np.unique(slope.h[there])) >= 2


def _defined(
    study: str,
    definition: Definition,
    kind: str,
    slopes: Sequence["Slope"],
    spelled: "_Slugs",
    names: "_Names",
) -> list[Figure]:
    """Figures of one kind of rows."""
    compared = (*(definition.series or ()), *(definition.panels or ()))
    one_each = [axis for axis in _ONE_EACH if axis not in compared]
    groups = [
        (dict(zip(one_each, values, strict=True)) | apart, grid)
        for values, group in _grouped(slopes, one_each).items()
        for apart, grid in _arranged(group, definition, kind)
    ]
    different = {
        axis for where, _ in groups for axis in where if len({w.get(axis) for w, _ in groups}) > 1
    }
    found: list[Figure] = []
    for where, grid in groups:
        if definition.name:
            told = [spelled(axis, value) for axis, value in where.items() if axis in different]
        else:
            told = _told(where, kind, spelled)
        name = names(study, definition.name, *told)
        title = _title(where, grid, kind)
        if definition.title:
            rest = ", ".join(_spelled(axis, where[axis]) for axis in where if axis in different)
            title = ": ".join(filter(None, (definition.title, rest)))
        make = WorkPrecisionFigure if kind == WORK_PRECISION else SeriesFigure
        parts = tuple(
            Part(_joined(grid.panels, where), tuple(_curve(s, grid.series) for s in several))
            for where, several in grid.parts
        )
        found.append(make(name, title, study, parts, grid.columns))
    return found


def _curve(slope: "Slope", series: Sequence[str]) -> Curve:
    return Curve(_joined(series, slope.key.named()), **slope.key.named())


@dataclass(frozen=True)
class _Grid:
    """Series of one figure: by which axes they differ, and in which panels they stand."""

    series: tuple[str, ...]
    panels: tuple[str, ...]
    parts: Sequence[tuple[Mapping[str, str], Sequence["Slope"]]]
    columns: int


def _arranged(
    slopes: Sequence["Slope"], definition: Definition, kind: str
) -> Iterable[tuple[dict[str, str], _Grid]]:
    """Grids of the series of one problem, form and quantity, and what they are apart by."""
    values = {
        axis: list(dict.fromkeys(getattr(slope, axis) for slope in slopes)) for axis in COMPARABLE
    }
    varying = [axis for axis in COMPARABLE if len(values[axis]) > 1]
    panels = list(definition.panels or ())
    series = list(
        definition.series or _most_varied(values, [a for a in varying if a not in panels])
    )
    rest = [axis for axis in varying if axis not in (*series, *panels)]
    if definition.panels is None:
        # What is least worth comparing becomes figures of their own.
        panels = sorted(rest, key=_preference)
        while panels and len({_at(slope, panels) for slope in slopes}) > MOST_PANELS:
            panels.pop()
    apart = [axis for axis in rest if axis not in panels]
    if definition.series is None and definition.panels is None:
        # No grid, or a cloud of points: one panel, as long as it is not crowded.
        single = all(len(few) == 1 for few in _grouped(slopes, [*apart, *panels]).values())
        single = single and not set(panels) & set(_PANELS)
        most = max(len(group) for group in _grouped(slopes, apart).values())
        if (single or kind == WORK_PRECISION) and most <= MOST_GATHERED:
            series, panels = [*series, *panels], []
    panels.sort(key=COMPARABLE.index)
    for where, group in _grouped(slopes, apart).items():
        found = _grouped(group, panels)
        ordered = sorted(
            found.items(),
            key=lambda part: [values[a].index(v) for a, v in zip(panels, part[0], strict=True)],
        )
        parts = [(dict(zip(panels, at, strict=True)), some) for at, some in ordered]
        yield (
            dict(zip(apart, where, strict=True)),
            _Grid(tuple(series), tuple(panels), parts, _columns(parts, panels)),
        )


def _most_varied(values: Mapping[str, Sequence[str]], varying: Sequence[str]) -> list[str]:
    """The axis with the most values; the scaling where none varies."""
    able = [axis for axis in varying if axis not in _PANELS]
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
    return {1: 1, 2: 1, 4: 2}.get(len(parts), 3)


def _at(slope: "Slope", names: Iterable[str]) -> tuple[str, ...]:
    return tuple(getattr(slope, axis) for axis in names)


def _grouped(
    slopes: Iterable["Slope"], names: Sequence[str]
) -> dict[tuple[str, ...], list["Slope"]]:
    found: dict[tuple[str, ...], list[Slope]] = {}
    for slope in slopes:
        found.setdefault(_at(slope, names), []).append(slope)
    return found


# -- words --------------------------------------------------------------------------------------


_METHODS = {
    "newmark": "Newmark",
    "generalized-alpha": "generalized-α",
    "hht": "HHT",
    "bdf1": "BDF1",
    "bdf2": "BDF2",
}
_PARAMETERS = {"beta": "β", "gamma": "γ", "rho": "ρ∞", "alpha": "α"}


def integrator_text(label: str) -> str:
    """An integrator as people write it, from its label."""
    if label == TRAPEZOIDAL:
        return "trapezoidal"
    method, *given = label.split()
    pairs = (part.partition("=") for part in given)
    said = [f"{_PARAMETERS.get(name, name)} = {value}" for name, _, value in pairs]
    return " ".join([_METHODS.get(method, method), *([f"({', '.join(said)})"] if said else [])])


def means(axis: str, word: str, value: str) -> bool:
    """Whether a word of a command line is a value of an axis, as CSVs or people write it.

    An integrator may be given by its method, a scaling of one's own by its name, and a
    mechanism file without its ending.
    """
    spellings = {value, _spelled(axis, value)}
    if axis == "integrator":
        spellings.add(value.split()[0])
    return word in spellings


def _spelled(axis: str, value: str) -> str:
    """A value of an axis as legends and titles have it."""
    if axis == "problem":
        return re.sub(r"\.ya?ml$", "", value)
    if axis == "integrator":
        return integrator_text(value)
    if axis == "form":
        return f"({', '.join(symbol(part) for part in value.split('-'))}) form"
    if axis == "preconditioning":
        return value.partition("[")[0]
    if axis == "row_block":
        return f"row {value} perturbed"
    if axis == "stop":
        return value if value == axes.SATURATION else f"tolerance {value}"
    if axis == "initial":
        return "at the start" if value else "along the motion"
    if axis == "measure":
        return _words(value)
    return symbol(value) if axis == "quantity" else in_words(axis, value)


def _words(measure: str) -> str:
    return measure.replace("_", " ").replace(WORK_PRECISION, "work and precision")


def _joined(names: Iterable[str], where: Mapping[str, str]) -> str:
    """Values of axes, a comma between them; what a series has nothing of is left out."""
    return ", ".join(_spelled(axis, where[axis]) for axis in names if where[axis])


def _title(where: Mapping[str, str], grid: _Grid, kind: str) -> str:
    """The problem, the form, what all series have in common, and what is shown."""
    common = grid.parts[0][1][0].key.named()
    varied = (*grid.series, *grid.panels)
    told = [_spelled(axis, where[axis]) for axis in ("problem", "form") if axis in where]
    if "preconditioning" not in varied:
        scaling = common["preconditioning"]
        name = _spelled("preconditioning", scaling)
        told.append("no scaling" if scaling == "none" else f"{name} scaling")
    usual = {each.name: each.usual for each in axes.series_axes()}
    for axis in COMPARABLE:
        if axis in (*varied, "problem", "form", "preconditioning", "quantity"):
            continue
        if common[axis] and common[axis] != usual[axis]:
            told.append(_spelled(axis, common[axis]))
    told += [_spelled("initial", common["initial"])] if common["initial"] else []
    return f"{', '.join(told)}: {_subject(where, kind)}"


def _subject(where: Mapping[str, str], kind: str) -> str:
    words, quantity = _words(kind), where.get("quantity", "")
    if kind == "condition":
        words = "condition number"
    if not quantity or quantity in _ONLY:
        return words
    of_it = quantity in UNKNOWNS or quantity in OF_OUTPUTS
    return f"{words} of {symbol(quantity)}" if of_it else f"{words}, {quantity}"


# -- names of files -----------------------------------------------------------------------------


def _told(where: Mapping[str, str], kind: str, spelled: "_Slugs") -> list[str]:
    """Parts of a figure's file name, in the order in which people look for them."""
    order = ("problem", "form", "measure", "quantity", "initial")
    told = []
    for axis in (*order, *(axis for axis in where if axis not in order)):
        if axis == "measure":
            told.append(kind.replace("_", "-"))
        elif where.get(axis) and where[axis] not in _ONLY:
            told.append(spelled(axis, where[axis]))
    return told


class _Slugs:
    """Values of axes as parts of file names: safe, and different where the values are."""

    def __init__(self, slopes: Iterable["Slope"]) -> None:
        self._known: dict[tuple[str, str], str] = {}
        taken: set[tuple[str, str]] = set()
        for slope in slopes:
            for axis, value in slope.key.named().items():
                if (axis, value) not in self._known:
                    slug = _slug(re.sub(r"\.ya?ml$", "", value.partition("[")[0]))
                    numbered = (slug, *(f"{slug}-{i}" for i in range(2, 2 + len(taken))))
                    slug = next(one for one in numbered if (axis, one) not in taken)
                    taken.add((axis, slug))
                    self._known[axis, value] = slug

    def __call__(self, axis: str, value: str) -> str:
        return self._known[axis, value]


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9._]+", "-", text).strip("-.")[:60] or "x"


class _Names:
    """Names of the figures of a study; one that is taken gets a number."""

    def __init__(self) -> None:
        self._taken: list[str] = []

    def __call__(self, *parts: str) -> str:
        name = free("-".join(filter(None, parts))[:180], self._taken)
        self._taken.append(name)
        return name


def free(name: str, taken: Iterable[str]) -> str:
    """A name that no file has yet: this one, or this one and a number."""
    # On some machines files that differ in case are one.
    known = {one.lower() for one in taken}
    numbered = (name if i == 1 else f"{name}-{i}" for i in count(1))
    return next(one for one in numbered if one.lower() not in known)
