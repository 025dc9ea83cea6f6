"""From a figure and results to its `Sheet`, plain data that `draw` draws.

The kind of a figure says what it needs and how it is laid out.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.newmark.kept import DRIFT
from newmark_cli.report.drawing import traces
from newmark_cli.report.drawing.panels import Look, Panel, Sheet, Trace, look, plain
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.reading import records
from newmark_cli.report.reading.figures import Curve, Figure, Part
from newmark_cli.report.reading.words import NO_UNITS, component, power, quantity, scalings, unit
from newmark_cli.study import axes
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.measures import DRIFT_LABELS, FLOOR_OF
from newmark_cli.study.trajectories import recorded
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import InputError, ResultsError

if TYPE_CHECKING:
    import pandas as pd


#: Series → cost of the cell behind each of its points; NaN where it is not known.
Costs = Mapping[SeriesKey, Array]


@dataclass(frozen=True)
class Cost:
    """What the work of a cell is measured by."""

    key: str  #: of a cell in a record
    label: str  #: of an axis
    unit: str  #: behind a number
    lacking: str  #: what to do where a record lacks it
    about: str = ""  #: how it is counted, beside a figure


#: By name, as `Results` has it.
COSTS: Mapping[str, Cost] = MappingProxyType(
    {
        "operations": Cost(
            "operations",
            "multiplications and additions",
            "operations",
            "no operations were counted; run the study again",
            r"each system of $N$ unknowns and $E$ entries counts $2E^2/(3N) + 2E$",
        ),
        "wall-time": Cost(
            "march_seconds",
            "wall time of the march (s)",
            "s",
            "no march was timed; run the study again with --timed --force",
        ),
    }
)


@dataclass(frozen=True)
class Results:
    """The data that a figure is made from."""

    folder: Path  #: results folder
    slopes: Sequence[Slope]  #: series of its CSVs
    #: What work is measured by, of `COSTS`.
    cost: str = "operations"
    #: Study → its record, of rows that no folder has; None to read those of the folder.
    in_memory: Mapping[str, Mapping[str, Any]] | None = None

    def record(self, study: str) -> Mapping[str, Any]:
        """What the record of a study says; empty where there is none."""
        if self.in_memory is not None:
            return self.in_memory.get(study, {})
        return records.known(self.folder / f"{study}.csv")

    @cached_property
    def by_key(self) -> Mapping[SeriesKey, Slope]:
        """The series by what a `Curve` finds them by."""
        return {slope.key: slope for slope in self.slopes}

    def settled(self, figure: "Figure") -> "Figure":
        """A figure with the linear solvers that `auto` has chosen, where it names none."""
        parts = (
            replace(part, curves=tuple(map(self._settled, part.curves))) for part in figure.parts
        )
        return replace(figure, parts=tuple(parts))

    def _settled(self, curve: Curve) -> Curve:
        axis, named = "linear_solver", curve.key.named()
        if axis in curve.named or curve.key in self.by_key:
            return curve
        every = (slope.key.named() for slope in self.slopes)
        chosen = [named_axes for named_axes in every if named_axes | {axis: named[axis]} == named]
        return Curve(curve.label, **chosen[0]) if len(chosen) == 1 else curve

    def series(self, figure: "Figure") -> dict[SeriesKey, Slope]:
        """Series of a figure, in the order of its curves; `ResultsError` if one is missing."""
        missing = [curve.label for curve in figure.curves if curve.key not in self.by_key]
        if missing:
            raise lacks(self.folder / f"{figure.study}.csv", figure, missing)
        return {curve.key: self.by_key[curve.key] for curve in figure.curves}


def lacks(path: Path, figure: "Figure", missing: Iterable[str]) -> ResultsError:
    """What to say of results that a figure cannot be made from."""
    command = f"run 'newmark-study run {figure.study}'"
    if not path.exists():
        return ResultsError(f"{path}: no results for figure {figure.name}; {command} first")
    named = ", ".join(dict.fromkeys(missing))
    return ResultsError(f"{path}: figure {figure.name} needs {named}; {command} again")


# -- work and precision: the error that a cell leaves against the work that it takes --------------


def costs(results: Results, slopes: Sequence[Slope]) -> Costs:
    """Costs of the cells behind the points of series, from the records of their studies."""
    key = COSTS[results.cost].key
    studies = dict.fromkeys(slope.study for slope in slopes)
    of_study = {study: _of_cells(results.record(study), key) for study in studies}
    return {
        slope.key: np.array(
            [
                of_study[slope.study].get((*_cell(slope.key.named()), h, steps), np.nan)
                for h, steps in zip(slope.h.tolist(), slope.steps.tolist(), strict=True)
            ]
        )
        for slope in slopes
    }


def _of_cells(record: Mapping[str, Any], key: str) -> dict[tuple[Any, ...], float]:
    costs_of = {}
    for cell in records.cells_of(record):
        if isinstance(cell.get("h"), int | float) and isinstance(cell.get("steps"), int):
            place = *_cell(cell), float(cell["h"]), float(cell["steps"])
            costs_of[place] = records.number(cell, key)
    return costs_of


def _cell(labels: Mapping[str, Any]) -> tuple[str, ...]:
    """Labels that identify a cell but for its step size, from its record or a series."""
    return tuple(
        axis.same(str(labels.get(axis.name, axis.usual)))
        for axis in axes.cell_axes()
        if axis.cell and axis.series
    )


def costed(figure: Figure, results: Results) -> tuple[Mapping[SeriesKey, Slope], Costs]:
    """Series of a figure, and costs of their cells; raises `ResultsError` if one has none."""
    slopes = results.series(figure)
    spent = costs(results, list(slopes.values()))
    if not all(np.isfinite(spent[key]).any() for key in slopes):
        raise ResultsError(
            f"{results.folder / figure.study}.json: figure {figure.name}: "
            f"{COSTS[results.cost].lacking}"
        )
    return slopes, spent


def ends(slope: Slope, spent: Array, cost: Cost) -> str:
    """A series in words: its value and its cost at the largest and at the smallest step size."""
    order = np.argsort(-slope.h)
    known = order[np.isfinite(spent[order]) & np.isfinite(slope.values[order])].tolist()
    return "; ".join(
        f"{slope.values[i]:.3g} in {spent[i]:.3g} {cost.unit} at h = {slope.h[i]:g}"
        for i in dict.fromkeys((known[0], known[-1]))
    )


# -- from figures to sheets ------------------------------------------------------------------------


def require(figure: Figure, results: Results) -> None:
    """Refuse a figure that nobody asks for by name and the results are not enough for."""
    figure = results.settled(figure)
    if figure.kind == "mechanism":
        # A series of any study of this mechanism: no stranger's results are about it.
        if all(slope.problem != figure.problem for slope in results.slopes):
            raise ResultsError(
                f"{results.folder}: figure {figure.name}: no results of {figure.problem}; "
                f"run 'newmark-study run {figure.study}' first"
            )
    elif figure.kind in ("history", "drift"):
        _over_time(figure, results)
    elif figure.kind == "work":
        costed(figure, results)
    else:
        results.series(figure)


def sheet(figure: Figure, results: Results) -> Sheet:
    """The panels of a figure; raises `ResultsError` when the results lack what it draws."""
    return _SHEETS[figure.kind](results.settled(figure), results)


# -- series against the step size, errors against work ------------------------------------------

#: Predicted floors lie on what they predict.
_FLOOR = Look("#000000", "+", 4.0, linestyle=":", linewidth=0.8)

#: Most series of a panel whose fits stand above it, of several panels.
_MOST_FITS = 4


def _looks(
    figure: Figure, slopes: Mapping[SeriesKey, Slope]
) -> dict[tuple[Part, str], dict[str, Any]]:
    """Panel and label of a series → attributes of its trace."""
    several = len({part.group for part in figure.parts}) > 1
    sizes: dict[str, set[float]] = {}
    for curve in figure.curves:
        slope = slopes[curve.key]
        sizes.setdefault(curve.label, set()).update(slope.h[np.isfinite(slope.values)].tolist())
    places: dict[str, dict[str, int]] = {}
    looks = {}
    for part in figure.parts:
        group = part.group if several else ""
        of_group = places.setdefault(group, {})
        for label in (curve.label for curve in part.curves):
            place = of_group.setdefault(label, len(of_group))
            own = figure.looks.get(label, {})
            only = f" (h = {step(*sizes[label])} only)" if len(sizes[label]) == 1 else ""
            looks[part, label] = {
                "label": label + only,
                "look": replace(look(place), **own),
                "place": None if own else place,
                "group": group,
                "name": ", ".join(filter(None, (part.title, label))),
            }
    return looks


def step(h: float) -> str:
    """A step size as legends have it."""
    if h >= 1e-2:
        return f"{h:g}"
    digits, _, exponent = f"{h:.3e}".partition("e")
    digits = digits.rstrip("0").rstrip(".")
    ten = power("10", str(int(exponent)))
    return ten if digits == "1" else f"{digits}·{ten}"


def _orders(figure: Figure, results: Results) -> Sheet:
    """Series over h, or over the work from the largest step size to the smallest.

    Fits stand in the legend of a single panel, or above each of several.
    """
    cost = COSTS[results.cost] if figure.kind == "work" else None
    series, spent = costed(figure, results) if cost else (results.series(figure), {})
    looks = _looks(figure, series)
    panels = []
    for part in figure.parts:
        own = [series[curve.key] for curve in part.curves]
        alike = [slope for slope in series.values() if _same(slope) in set(map(_same, own))]
        fits = len(figure.parts) == 1 or len(own) <= _MOST_FITS
        drawn, some = [], any(slope.unique for slope in own)
        for curve, slope in zip(part.curves, own, strict=True):
            attributes = dict(looks[part, curve.label])
            if some and not slope.unique:
                attributes["label"] += traces.NOT_UNIQUE
            if cost:
                work = spent[curve.key]
                said = f"{quantity(slope)}, {attributes['name']}: {ends(slope, work, cost)}"
                attributes |= {"x": work[np.argsort(slope.h)], "said": said}
            elif fits:
                attributes["fit"] = traces.fit_text(slope)
            drawn.append(traces.trace(slope, **attributes))
        drawn += _floors(part, results.by_key)
        titles = part.titles if len(figure.parts) > 1 else ()
        panel = traces.panel(own, drawn, titles, alike)
        panels.append(replace(panel, x_label=cost.label, references=()) if cost else panel)
    note = ""
    if cost:
        note = "; ".join(
            filter(None, ("each from the largest step size to the smallest", cost.about))
        )
    elif any(trace.fit for panel in panels for trace in panel.traces):
        several = "above panels: fitted slopes, in this order"
        note = "fitted slope" if len(panels) == 1 else several
    # Of several problems each has its own range of step sizes.
    share_x = len({curve.problem for curve in figure.curves}) == 1
    notes = filter(None, (plain(figure.note), scalings(figure.curves), note))
    return Sheet(
        figure.title, tuple(panels), figure.columns, "; ".join(notes), share_x,
        settings=figure.style,
    )  # fmt: skip


def _same(slope: Slope) -> tuple[str, ...]:
    """What series must share for their panels to share an ordinate."""
    return slope.problem, slope.quantity, slope.measure


def _floors(part: Part, slopes: Mapping[SeriesKey, Slope]) -> list[Trace]:
    """Predicted floors of the measured series that have them."""
    named = (curve.key.named() for curve in part.curves if curve.measure in FLOOR_OF)
    keys = (SeriesKey.of(of | {"measure": FLOOR_OF[of["measure"]]}) for of in named)
    return [
        traces.trace(slopes[key], "predicted floor", _FLOOR, "predicted floor")
        for key in keys
        if key in slopes
    ]


# -- values over time ---------------------------------------------------------------------------

#: Curves over time; the first alternates from step to step, the last two coincide.
_OVER_TIME = (
    Look("#D55E00", ".", 1.2, linewidth=0.4, alpha=0.7),
    Look("#56B4E9", linewidth=2.6),
    Look("#000000", linewidth=0.8, linestyle="--"),
)
#: Most components that one curve shows.
_MOST_COMPONENTS = 6
#: Least drift that is drawn (m, m/s): what is smaller is rounding, or exactly 0.
_LEAST_DRIFT = 1e-18


def _over_time(figure: Figure, results: Results) -> dict[SeriesKey, "pd.DataFrame"]:
    """Recorded time series of a figure; raises `ResultsError` if one is missing."""
    if results.in_memory is not None:
        raise ResultsError(f"{results.folder}: no trajectories, which figure {figure.name} draws")
    series, sizes = results.by_key, {}
    for key in (curve.key for curve in figure.curves):
        smallest = float(series[key].h.min()) if key in series else math.nan
        sizes[key] = figure.h or smallest
    wanted = DRIFT if figure.kind == "drift" else figure.curves[0].quantity
    path, found = recorded(results.folder, figure.study, wanted, sizes)
    missing = [curve.label for curve in figure.curves if curve.key not in found]
    if missing:
        raise lacks(path, figure, missing)
    return found


def _history_look(place: int, count: int) -> Look:
    """Look of a curve: thin for all but the last two, and a line under a dashed one for these."""
    last = place - count + len(_OVER_TIME)
    if last > 0:
        return _OVER_TIME[last] if count > 1 else replace(look(0), marker="")
    return replace(_OVER_TIME[0], color=look(place + 2).color)


def _history(figure: Figure, results: Results) -> Sheet:
    """A quantity over time, a panel for each unit; below it as far as any curve goes, if farther.

    Several curves show the component that varies most in the last of them, one all those of a
    known unit that do.
    """
    over_time = _over_time(figure, results)
    first, last, panels = figure.curves[0], over_time[figure.curves[-1].key], []
    of_unit: dict[str, list[str]] = {}
    for name in last.columns:
        if "·" not in name:  # what keeps a body of directors rigid is no reaction
            of_unit.setdefault(unit(first, name), []).append(name)
    note = f"$h$ = {step(figure.h or float(results.by_key[first.key].h.min()))} s"
    for own, names in of_unit.items():
        varied = (last[names].max() - last[names].min()).nlargest(_MOST_COMPONENTS).index
        several = len(figure.curves) == 1 and own not in NO_UNITS
        if several:
            drawn = [(n, last[n], replace(look(i), marker="")) for i, n in enumerate(varied)]
        else:
            drawn = [
                (curve.label, over_time[curve.key][varied[0]], _history_look(i, len(figure.curves)))
                for i, curve in enumerate(figure.curves)
            ]
        series = tuple(
            Trace(
                label, values.index.to_numpy(), values.to_numpy(), its,
                group=own if several else "", said=f"{label}: up to {values.abs().max():.3g}",
            )
            for label, values, its in drawn
        )  # fmt: skip
        ruling = series if several else series[-1:]
        zoomed = Panel(
            series,
            "time $t$ (s)",
            f"{component(first.quantity, '' if several else varied[0])} ({own})",
            x_scale="linear",
            y_scale="linear",
            y_limits=_around(ruling, 0.05 if several else 0.25),
        )
        panels.append(zoomed)
        if not several and np.ptp(ruling[0].y) < 0.8 * max(np.ptp(trace.y) for trace in series):
            most = float(np.max(np.abs(ruling[0].y)))
            linear = 10.0 ** math.floor(math.log10(most)) if most > 0 else 1.0
            note += f"; lower panel: linear within ±{step(linear)}"
            whole = replace(
                zoomed,
                traces=tuple(replace(trace, said="") for trace in series),
                y_scale="symlog",
                y_limits=_around(series, 0.05),
                linthresh=linear,
            )
            panels.append(whole)
    return Sheet(figure.title, tuple(panels), note=note, settings=figure.style)


def _around(series: Sequence[Trace], margin: float) -> tuple[float, float]:
    """Limits around all values, with a margin relative to their span."""
    low = min(float(np.min(trace.y)) for trace in series)
    high = max(float(np.max(trace.y)) for trace in series)
    room = margin * (high - low) or 0.5 * abs(high) or 1.0
    return low - room, high + room


def _drift(figure: Figure, results: Results) -> Sheet:
    """Misfits over time on logarithmic ordinates."""
    over_time = _over_time(figure, results)
    labels = list(dict.fromkeys(curve.label for curve in figure.curves))
    panels = []
    for part in figure.parts:
        drawn = []
        for curve in part.curves:
            values = over_time[curve.key][curve.quantity]
            shown = np.where(values < _LEAST_DRIFT, np.nan, values)
            said = f"{part.title}, {curve.label}: up to {np.max(values):.2g}"
            own = replace(look(labels.index(curve.label)), marker="", linewidth=0.9)
            drawn.append(Trace(curve.label, values.index.to_numpy(), shown, own, said=said))
        most = max(np.nanmax(trace.y, initial=_LEAST_DRIFT) for trace in drawn)
        least = min(np.nanmin(trace.y, initial=float(most)) for trace in drawn)
        panels.append(
            Panel(
                tuple(drawn),
                "time $t$ (s)",
                DRIFT_LABELS[part.curves[0].quantity],
                part.titles if len(figure.parts) > 1 else (),
                x_scale="linear",
                y_limits=(0.1 * float(least), 10 * float(most)),
                tell_zeros=False,
            )
        )
    return Sheet(
        figure.title, tuple(panels), figure.columns, figure.note, share_x=False,
        minor_ticks=False, settings=figure.style,
    )  # fmt: skip


# -- mechanisms -----------------------------------------------------------------------------------


def _mechanism(figure: Figure, results: Results) -> Sheet:
    """A mechanism in its initial position; needs no results."""
    from newmark_cli.mechanisms.registry import PROBLEMS, problem
    from newmark_cli.report.drawing.draw_mechanism import mechanism_sheet

    if figure.problem not in PROBLEMS:
        raise InputError(
            f"figure {figure.name}: {figure.problem} is not a shipped mechanism; "
            f"'newmark-study draw {figure.problem}' draws it"
        )
    subject = problem(figure.problem)
    sheet = mechanism_sheet(figure.title, subject, subject.u0)
    return replace(sheet, settings={**sheet.settings, **figure.style})


_SHEETS: Mapping[str, Callable[[Figure, Results], Sheet]] = {
    "orders": _orders,
    "work": _orders,
    "history": _history,
    "drift": _drift,
    "mechanism": _mechanism,
}
