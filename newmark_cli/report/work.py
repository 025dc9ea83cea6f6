"""Work and precision: the error that a cell leaves against the wall time that it takes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.errors import ResultsError
from newmark_cli.report import records, traces
from newmark_cli.report.kinds import Figure, Results
from newmark_cli.report.panels import Legend, Panel, Sheet, Trace, look, spread
from newmark_cli.report.parts import OfParts
from newmark_cli.study import axes
from newmark_cli.study.axes import SeriesKey

if TYPE_CHECKING:
    from newmark_cli.report.slopes import Slope

#: What points that stand apart are.
NOT_JOINED = "not joined: cells that did not end well"

#: Series → wall time (s) of the cell behind each of its points; NaN where it is not known.
Times = Mapping[SeriesKey, Array]


def wall_times(folder: Path, slopes: Sequence["Slope"]) -> Times:
    """Wall times of the cells behind the points of series, from the records of their studies.

    Args:
        folder: Results folder.
        slopes: The series.
    """
    studies = dict.fromkeys(slope.study for slope in slopes)
    seconds = {study: _of_cells(records.known(folder / f"{study}.csv")) for study in studies}
    return {
        slope.key: np.array(
            [
                seconds[slope.study].get((*_cell(slope.key.named()), h, steps), np.nan)
                for h, steps in zip(slope.h.tolist(), slope.steps.tolist(), strict=True)
            ]
        )
        for slope in slopes
    }


def _of_cells(record: Mapping[str, Any]) -> dict[tuple[Any, ...], float]:
    found = {}
    for cell in records.cells_of(record):
        if isinstance(cell.get("h"), int | float) and isinstance(cell.get("steps"), int):
            found[*_cell(cell), float(cell["h"]), float(cell["steps"])] = records.seconds(cell)
    return found


def _cell(given: Mapping[str, Any]) -> tuple[str, ...]:
    """Labels that tell a cell from others besides its step size, from its record or a series."""
    return tuple(
        each.same(str(given.get(each.name, each.usual)))
        for each in axes.cell_axes()
        if each.cell and each.series
    )


def timed(
    figure: Figure, results: Results
) -> tuple[Mapping[SeriesKey, "Slope"], Mapping[SeriesKey, Array]]:
    """Series of a figure, and wall times of their cells.

    Raises:
        ResultsError: When a series is missing, or has no wall times.
    """
    slopes = {slope.key: slope for slope in results.series(figure)}
    times = wall_times(results.folder, list(slopes.values()))
    if not all(np.isfinite(times[key]).any() for key in slopes):
        raise ResultsError(
            f"{results.folder / figure.study}.json: no wall times for figure {figure.name}; "
            f"run the study again"
        )
    return slopes, times


@dataclass(frozen=True)
class WorkPrecisionFigure(OfParts):
    """Errors of a study against the wall times of its cells, a point for each step size."""

    def require(self, results: Results) -> None:
        """All series, and wall times of their cells."""
        timed(self, results)

    def sheet(self, results: Results) -> Sheet:
        """Points of a series joined from the largest step size to the smallest."""
        slopes, times = timed(self, results)
        labels = list(dict.fromkeys(curve.label for curve in self.curves))
        limits = spread([slope.values for slope in slopes.values()])
        panels = []
        for part in self.parts:
            first = slopes[part.curves[0].key]
            drawn = [
                _trace(slopes[c.key], times[c.key], c.label, labels.index(c.label), part.title)
                for c in part.curves
            ]
            panels.append(
                Panel(
                    tuple(drawn),
                    "wall time of the cell (s)",
                    first.record.label(first.key),
                    part.title,
                    y_limits=limits,
                )
            )
        notes = ["each from the largest step size to the smallest"]
        if any(
            trace.apart is not None and trace.apart.any()
            for panel in panels
            for trace in panel.traces
        ):
            notes.append(NOT_JOINED)
        alike = len({(slope.problem, slope.quantity) for slope in slopes.values()}) == 1
        if not alike:
            panels = [replace(panel, y_limits=None) for panel in panels]
        return Sheet(
            self.title,
            tuple(panels),
            self.columns,
            Legend("; ".join(notes)),
            panel_size=None if len(panels) > 1 else (3.5, 2.5),
            share_y=alike and len(panels) > 1,
            ticks=(8, 8),
        )


def _trace(slope: "Slope", seconds: Array, label: str, place: int, panel: str) -> Trace:
    order = np.argsort(-slope.h)
    ends = [i for i in order.tolist() if np.isfinite(seconds[i]) and np.isfinite(slope.values[i])]
    said = "; ".join(
        f"{slope.values[i]:.3g} in {seconds[i]:.3g} s at h = {slope.h[i]:g}"
        for i in dict.fromkeys((ends[0], ends[-1]))
    )
    name = ", ".join(filter(None, (panel, label)))
    ok = np.isin(np.array(slope.statuses, str), slope.record.ok)
    return Trace(
        label,
        seconds[order],
        slope.values[order],
        look(place),
        apart=~ok[order],
        said=f"{traces.quantity(slope)}, {name}: {said}",
    )
