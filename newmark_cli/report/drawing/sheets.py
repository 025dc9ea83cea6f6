"""From a figure and results to its `Sheet`, plain data that `draw` draws.

The kind of a figure says what it needs and how it is laid out.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.report.drawing import traces
from newmark_cli.report.drawing.panels import (
    Legend,
    Look,
    Panel,
    Sheet,
    Trace,
    from_zero,
    look,
    power,
    spread,
)
from newmark_cli.report.drawing.work import COSTS, costed, trace
from newmark_cli.report.judging.verdicts import PASS, SHOWN
from newmark_cli.report.reading.curves import floor_of
from newmark_cli.report.reading.figures import Figure, Part
from newmark_cli.report.reading.history import read_drifts, read_histories
from newmark_cli.report.reading.words import measure_text
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.results import drift_path, history_path
from newmark_cli.support.errors import ResultsError

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope

#: What points that stand apart are.
NOT_JOINED = "not joined: cells that did not end well"


@dataclass(frozen=True)
class Results:
    """The data that a figure is made from.

    Attributes:
        folder: Results folder.
        slopes: Series of its CSVs.
        cost: What work is measured by, of `newmark_cli.report.drawing.work.COSTS`.
    """

    folder: Path
    slopes: Sequence["Slope"]
    cost: str = "operations"

    @cached_property
    def by_key(self) -> Mapping[SeriesKey, "Slope"]:
        """The series by what a `Curve` finds them by."""
        return {slope.key: slope for slope in self.slopes}

    def series(self, figure: "Figure") -> dict[SeriesKey, "Slope"]:
        """Series of a figure, in the order of its curves.

        Raises:
            ResultsError: When the results lack one.
        """
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


def require(figure: Figure, results: Results) -> None:
    """See whether a figure is drawn where nobody asks for it by name.

    Raises:
        ResultsError: When the results are not enough; says what is missing.
    """
    if figure.kind == "mechanism":
        _require_mechanism(figure, results)
    elif figure.kind in ("history", "drift"):
        _over_time(figure, results)
    elif figure.kind == "work":
        costed(figure, results)
    else:
        results.series(figure)


def sheet(figure: Figure, results: Results) -> Sheet:
    """The panels of a figure.

    Raises:
        ResultsError: When the results lack what it draws.
    """
    return _SHEETS[figure.kind](figure, results)


# -- series against the step size, errors against work ------------------------------------------

#: Predicted floors lie on what they predict.
_FLOOR = Look("#000000", "+", 4.0, linestyle=":", linewidth=0.8)


def _orders(figure: Figure, results: Results) -> Sheet:
    """Fits in the legend of a single panel, in a corner of each of several."""
    series = results.series(figure)
    places = {label: i for i, label in enumerate(dict.fromkeys(c.label for c in figure.curves))}
    several = len(figure.parts) > 1
    panels = []
    for part in figure.parts:
        own = [series[curve.key] for curve in part.curves]
        alike = [slope for slope in series.values() if _same(slope) in set(map(_same, own))]
        panel = _panel(part, own, places, several)
        if several:
            panel = _with_limits(panel, own, alike)
        panels.append(replace(panel, traces=(*panel.traces, *_floors(part, results.by_key))))
    if figure.columns > 2:  # narrow ones, where orders take a larger share
        panels = [replace(panel, x_room=2 * panel.x_room) for panel in panels]
    fitted = any(not np.isnan(slope.expected) for slope in series.values())
    notes = [figure.note] if figure.note else ["fitted slope"] if fitted and not several else []
    return _sheet(figure, panels, notes, several and len(set(map(_same, series.values()))) == 1)


def _sheet(figure: Figure, panels: Sequence[Panel], notes: list[str], share_y: bool) -> Sheet:
    apart = any(t.apart is not None and t.apart.any() for p in panels for t in p.traces)
    return Sheet(
        figure.title,
        tuple(panels),
        figure.columns,
        Legend("; ".join([*notes, *([NOT_JOINED] if apart else [])])),
        panel_size=None if len(panels) > 1 else (3.5, 2.5),
        # Of several problems each has its own range of step sizes.
        share_x=len({curve.problem for curve in figure.curves}) == 1,
        share_y=share_y,
        ticks=(8 if figure.columns < 4 else 4, 8),
    )


def _same(slope: "Slope") -> tuple[str, ...]:
    """What series have in common whose panels can share an ordinate."""
    return slope.problem, slope.quantity, slope.measure, slope.row_block


def _panel(
    part: Part, slopes: Sequence["Slope"], places: Mapping[str, int], several: bool
) -> Panel:
    drawn = [
        _trace(slope, curve.label, places[curve.label], part.title)
        for curve, slope in zip(part.curves, slopes, strict=True)
    ]
    # Fits of many series would cover them.
    fits = several and len(drawn) <= 4
    panel = traces.panel(slopes, drawn, slopes[0].record.linear, part.title, fits)
    if len({slope.quantity for slope in slopes}) > 1:
        panel = replace(panel, y_label=measure_text(slopes[0].measure))
    if several and not fits:
        panel = replace(panel, traces=tuple(replace(t, fit="") for t in panel.traces))
    return panel


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
    undecided = slope.verdict not in (PASS, SHOWN) and not slope.accepted
    ok = np.isin(np.array(slope.statuses, str)[np.argsort(slope.h)], slope.record.ok)
    return replace(
        found,
        apart=~ok,
        fit=", ".join(filter(None, (found.fit, slope.verdict if undecided else ""))),
        said=found.said + (f", {slope.verdict}" if slope.verdict != SHOWN else ""),
    )


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


def _work(figure: Figure, results: Results) -> Sheet:
    """Points of a series joined from the largest step size to the smallest."""
    slopes, spent = costed(figure, results)
    cost = COSTS[results.cost]
    labels = list(dict.fromkeys(curve.label for curve in figure.curves))
    panels = []
    for part in figure.parts:
        own = [slopes[curve.key] for curve in part.curves]
        alike = [slope for slope in slopes.values() if _same(slope) in set(map(_same, own))]
        drawn = tuple(
            trace(slopes[c.key], spent[c.key], cost, c.label, labels.index(c.label), part.title)
            for c in part.curves
        )
        label = own[0].record.label(own[0].key)
        limits = spread([slope.values for slope in alike])
        panels.append(Panel(drawn, cost.label, label, part.title, y_limits=limits))
    share = len(set(map(_same, slopes.values()))) == 1
    notes = ["each from the largest step size to the smallest"]
    return _sheet(figure, panels, notes, share and len(panels) > 1)


# -- values over time ---------------------------------------------------------------------------

#: Curves over time; the first alternates from step to step, the last two coincide.
_OVER_TIME = (
    Look("#D55E00", ".", 1.2, linewidth=0.4, alpha=0.7),
    Look("#56B4E9", linewidth=2.6),
    Look("#000000", linewidth=0.8, linestyle="--"),
)
#: Least drift that is drawn (m, m/s): what is smaller is rounding, or exactly 0.
_LEAST_DRIFT = 1e-18
_DRIFTS = {
    "position": r"$|\Phi_k|/\|G_k\|$ (m)",
    "velocity": r"$|(G^T v + \Phi_t)_k|/\|G_k\|$ (m/s)",
}


def _over_time(figure: Figure, results: Results) -> dict[SeriesKey, Any]:
    """Time series of a figure's cells.

    Raises:
        ResultsError: When the results lack one.
    """
    series, found = results.by_key, {}
    sizes = [
        figure.h or (float(series[c.key].h.min()) if c.key in series else math.nan)
        for c in figure.curves
    ]
    cells = list(zip(figure.curves, sizes, strict=True))
    folder, study = results.folder, figure.study
    given: Sequence[Any]
    if figure.kind == "drift":
        path, given = drift_path(folder, study), read_drifts(folder, study, cells)
    else:
        path, given = history_path(folder, study), read_histories(folder, study, cells)
    missing = []
    for curve, one in zip(figure.curves, given, strict=True):
        if one is None:
            missing.append(curve.label)
        found[curve.key] = one
    if missing:
        raise lacks(path, figure, missing)
    return found


def _time_look(place: int) -> Look:
    return Look(look(place).color, linewidth=0.9, linestyle=look(place).linestyle)


def _history(figure: Figure, results: Results) -> Sheet:
    """A multiplier, above in the range of the last curve, below as far as any goes.

    Of the multipliers the one is drawn that is largest in the last curve.
    """
    found = _over_time(figure, results)
    histories = [found[curve.key] for curve in figure.curves]
    component = int(np.argmax(np.max(np.abs(histories[-1].multipliers), axis=0)))
    series = tuple(
        Trace(
            curve.label,
            history.t,
            1e-3 * history.multipliers[:, component],
            _OVER_TIME[place] if place < len(_OVER_TIME) else _time_look(place),
            said=f"{curve.label}: |λ| up to {np.max(np.abs(history.multipliers)):.3g}",
        )
        for place, (curve, history) in enumerate(zip(figure.curves, histories, strict=True))
    )
    span = float(np.ptp(series[-1].y))
    zoomed = Panel(
        series,
        "time $t$ (s)",
        rf"$\lambda_{component + 1}$ (kN/m)",
        x_scale="linear",
        y_scale="linear",
        y_limits=_around(series[-1:], 0.25),
    )
    whole = replace(
        zoomed,
        traces=tuple(replace(trace, said="") for trace in series),
        y_scale="symlog",
        y_limits=_around(series, 0.05),
        linthresh=10.0 ** math.floor(math.log10(span)) if span > 0 else 1.0,
    )
    h = figure.h or results.by_key[figure.curves[0].key].h.min()
    step = power("10", f"{math.log10(h):.0f}")
    note = f"$h$ = {step} s; pairs of successive steps"
    return Sheet(figure.title, (zoomed, whole), legend=Legend(note, 1), ticks=(8, 8))


def _around(series: Sequence[Trace], margin: float) -> tuple[float, float]:
    """Ends of an ordinate around all values, with room on either side as a share of their span."""
    low = min(float(np.min(trace.y)) for trace in series)
    high = max(float(np.max(trace.y)) for trace in series)
    return low - margin * (high - low), high + margin * (high - low)


def _drift(figure: Figure, results: Results) -> Sheet:
    """Misfits over time on logarithmic ordinates: they differ by ten powers of ten."""
    found = _over_time(figure, results)
    labels = list(dict.fromkeys(curve.label for curve in figure.curves))
    panels = []
    for part in figure.parts:
        drawn = []
        for curve in part.curves:
            drift = found[curve.key]
            values = getattr(drift, curve.quantity)
            shown = np.where(values < _LEAST_DRIFT, np.nan, values)
            said = f"{part.title}, {curve.label}: up to {np.max(values):.2g}"
            own = _time_look(labels.index(curve.label))
            drawn.append(Trace(curve.label, drift.t, shown, own, said=said))
        most = max(np.nanmax(trace.y, initial=_LEAST_DRIFT) for trace in drawn)
        panels.append(
            Panel(
                tuple(drawn),
                "time $t$ (s)",
                _DRIFTS[part.curves[0].quantity],
                part.title,
                x_scale="linear",
                y_limits=(0.1 * _LEAST_DRIFT, 10 * float(most)),
                tell_zeros=False,
            )
        )
    return Sheet(
        figure.title, tuple(panels), figure.columns, Legend(figure.note), share_x=False,
        ticks=(6, 8), minor_ticks=False,
    )  # fmt: skip


# -- mechanisms -----------------------------------------------------------------------------------


def _require_mechanism(figure: Figure, results: Results) -> None:
    """A series of any study of this mechanism: no stranger's results are about it."""
    if all(slope.problem != figure.problem for slope in results.slopes):
        raise ResultsError(
            f"{results.folder}: figure {figure.name}: no results of {figure.problem}; "
            f"run 'newmark-study run {figure.study}' first"
        )


def _mechanism(figure: Figure, results: Results) -> Sheet:
    """A mechanism in its initial position, whatever the results are."""
    from newmark_cli.mechanisms.registry import picture
    from newmark_cli.report.drawing.draw_mechanism import mechanism_sheet

    subject = picture(figure.problem)
    return mechanism_sheet(figure.title, subject, subject.u0)


_SHEETS: Mapping[str, Callable[[Figure, Results], Sheet]] = {
    "orders": _orders,
    "work": _work,
    "history": _history,
    "drift": _drift,
    "mechanism": _mechanism,
}
