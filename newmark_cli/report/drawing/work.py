"""Work and precision: the error that a cell leaves against the work that it takes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.report.reading import records
from newmark_cli.study import axes
from newmark_cli.study.axes import SeriesKey
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ResultsError

if TYPE_CHECKING:
    from newmark_cli.report.drawing.sheets import Results
    from newmark_cli.report.judging.slopes import Slope
    from newmark_cli.report.reading.figures import Figure

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


#: By name, as `newmark_cli.report.drawing.sheets.Results` has it.
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


def costs(results: "Results", slopes: Sequence["Slope"]) -> Costs:
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


def costed(figure: "Figure", results: "Results") -> tuple[Mapping[SeriesKey, "Slope"], Costs]:
    """Series of a figure, and costs of their cells; raises `ResultsError` if one has none."""
    slopes = results.series(figure)
    spent = costs(results, list(slopes.values()))
    if not all(np.isfinite(spent[key]).any() for key in slopes):
        raise ResultsError(
            f"{results.folder / figure.study}.json: figure {figure.name}: "
            f"{COSTS[results.cost].lacking}"
        )
    return slopes, spent


def ends(slope: "Slope", spent: Array, cost: Cost) -> str:
    """A series in words: its value and its cost at the largest and at the smallest step size."""
    order = np.argsort(-slope.h)
    known = order[np.isfinite(spent[order]) & np.isfinite(slope.values[order])].tolist()
    return "; ".join(
        f"{slope.values[i]:.3g} in {spent[i]:.3g} {cost.unit} at h = {slope.h[i]:g}"
        for i in dict.fromkeys((known[0], known[-1]))
    )
