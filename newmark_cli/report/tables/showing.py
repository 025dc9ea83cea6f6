"""Studies to read in a terminal: values by step size, local orders, fits, verdicts."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.newmark.integrator import TRAPEZOIDAL_NAME
from newmark_cli.report.judging.fits import format_fit
from newmark_cli.report.judging.slopes import Slope, study_slopes
from newmark_cli.report.judging.text import Entry, text_table, wrapped
from newmark_cli.report.judging.verdicts import INCOMPLETE
from newmark_cli.report.reading.choosing import Choice, grouped
from newmark_cli.report.reading.words import counted, quantity
from newmark_cli.report.tables.check import format_integrator, format_prediction, format_verdict
from newmark_cli.report.tables.table import MISSING
from newmark_cli.study import axes
from newmark_cli.study.csv_rows import named_studies, read_record, read_rows

#: Columns of a study's CSV that tell its cells apart.
_CELL = [axis.name for axis in axes.cell_axes() if axis.cell] + ["steps"]
#: Axes in which the series of one table agree.
_TABLE = ("study", "problem", "form", "measure", "quantity")
#: Axes whose values tables have as CSVs do.
_AS_LABELS = ("integrator", "preconditioning", "row_block", "initial")


@dataclass(frozen=True)
class ShownStudy:
    """A study, and those of its series that are to be shown."""

    name: str
    statuses: tuple[str, ...]  #: of every cell
    slopes: tuple[Slope, ...]  #: all series, in the order of the CSV
    chosen: tuple[Slope, ...] = ()
    recovered: int = 0  #: how many series of recovered fields are left out

    @property
    def measures(self) -> list[str]:
        """Measures of its series."""
        return list(dict.fromkeys(slope.measure for slope in self.slopes if slope.measure))

    @property
    def verdicts(self) -> list[str]:
        """Of every series."""
        return list(map(format_verdict, self.slopes))

    def row(self) -> dict[str, Any]:
        """As values for programs, without the series."""
        return {
            "study": self.name, "cells": len(self.statuses),
            "statuses": dict(Counter(self.statuses)), "measures": self.measures,
            "verdicts": dict(Counter(self.verdicts)),
        }  # fmt: skip

    def data(self) -> dict[str, Any]:
        """As values for programs, with the series that are to be shown."""
        return self.row() | {"series": [_data(slope) for slope in self.chosen]}


def read(folder: Path, names: Sequence[str]) -> list[ShownStudy]:
    """Studies of a results folder; all without names."""
    studies = []
    for name in named_studies(folder, names):
        path = folder / f"{name}.csv"
        table = read_rows(path)
        statuses: dict[tuple[Any, ...], str] = {}  # the first row of a cell has its status
        for *cell, status in zip(*(table[column] for column in (*_CELL, "status")), strict=True):
            statuses.setdefault(tuple(cell), status)
        slopes = tuple(study_slopes(table, path, read_record(path)))
        studies.append(ShownStudy(name, tuple(statuses.values()), slopes))
    return studies


def choose(studies: Sequence[ShownStudy], choice: Choice) -> list[ShownStudy]:
    """The studies with the series that are chosen; recovered fields only when asked for."""
    choice.series([slope for study in studies for slope in study.slopes])  # or it refuses
    named = bool(choice.measures or choice.values.get("quantity"))
    shown = []
    for study in studies:
        ours = list(filter(choice.takes, study.slopes))
        chosen = tuple(slope for slope in ours if named or slope.role != "recovered")
        shown.append(replace(study, chosen=chosen, recovered=len(ours) - len(chosen)))
    return shown


# -- for people ---------------------------------------------------------------------------------


def listed(studies: Sequence[ShownStudy]) -> str:
    """The studies of a folder: cells, measures and verdicts of each."""
    rows = [("study", "cells", "measures", "series")]
    for study in studies:
        measures = ", ".join(study.measures)
        rows.append((study.name, counted(study.statuses), measures, counted(study.verdicts)))
    return text_table(rows)


def as_text(study: ShownStudy) -> str:
    """A study's overview, and a table for each problem, form, measure and quantity."""
    overview = (
        f"{study.name}: {len(study.statuses)} cells: {counted(study.statuses)}; "
        f"measures: {', '.join(study.measures) or 'none'}; series: {counted(study.verdicts)}"
    )
    parts = [wrapped(overview)]
    if study.recovered:
        left_out = (
            f"{study.recovered} series of recovered fields are not shown; --measure or --quantity "
            "shows them"
        )
        parts[0] += "\n" + wrapped(left_out)
    tables = grouped(study.chosen, _TABLE).values()
    return "\n\n".join([*parts, *map(_table, tables)])


def _table(slopes: Sequence[Slope]) -> str:
    """Step sizes down, series across: values and local orders, then fits and verdicts."""
    first = slopes[0]
    if not first.measure:
        where = f"{first.problem}, {first.form}: {INCOMPLETE}, cells failed: "
        return wrapped(where + "; ".join(" ".join(s.key.besides(*_TABLE)) for s in slopes))
    common, names = _names(slopes)
    title = ", ".join([first.problem, first.form, f"{quantity(first)} ({first.measure})", *common])
    points = [_entries(slope) for slope in slopes]
    rows: list[tuple[Entry, ...]] = [
        ("h", *(tuple(name) for name in names)),
        *(
            (f"{h:g}", *(entries.get((h, nth), MISSING) for entries in points))
            for h, nth in sorted({at for entries in points for at in entries}, reverse=True)
        ),
        ("",),
        ("slope ± stderr", *(format_fit(slope.fit) for slope in slopes)),
        ("fitted", *(_range(slope) for slope in slopes)),
        ("predicted", *(format_prediction(slope) or MISSING for slope in slopes)),
        ("verdict", *(format_verdict(slope) for slope in slopes)),
    ]
    reasons = [
        wrapped(": ".join(filter(None, (" ".join(name), slope.reason))), indent=2)
        for name, slope in zip(names, slopes, strict=True)
        if slope.reason
    ]
    return "\n".join([wrapped(title), text_table(rows, blocks=True, indent=2), *reasons])


def _names(slopes: Sequence[Slope]) -> tuple[list[str], list[list[str]]]:
    """Labels that all series of a table share, and those that distinguish them."""
    common: list[str] = []
    names: list[list[str]] = [[] for _ in slopes]
    for axis in axes.series_axes():
        if axis.name in _TABLE:
            continue
        text = str if axis.name in _AS_LABELS else axis.text
        values = [text(getattr(slope, axis.name)) for slope in slopes]
        labels = list(map(format_integrator, values))
        if len({*labels}) > 1:
            for name, value in zip(names, labels, strict=True):
                name += [value] if value else []
        elif labels[0] not in ("", text(axis.usual or ""), TRAPEZOIDAL_NAME):
            common += [f"at the {labels[0]}" if axis is axes.INITIAL else labels[0]]
    return common, [name or ["along the run"] for name in names] if len(slopes) > 1 else [["value"]]


def _entries(slope: Slope) -> dict[tuple[float, int], Entry]:
    """(h, how many of the same h came before) → value, local order, and status if not ok."""
    entries: dict[tuple[float, int], Entry] = {}
    seen: Counter[float] = Counter()
    for point in _points(slope):
        h, value, order, status = (point[k] for k in ("h", "value", "local_order", "status"))
        text = f"{value:.3g}" if math.isfinite(value) else ""
        if text and math.isfinite(order):
            text = f"{text:<9} {round(order, 2) + 0.0:.2f}".replace(" -", " −")
        if status in slope.record.ok:
            entries[h, -seen[h]] = text or MISSING
        else:
            entries[h, -seen[h]] = (text, status) if text else status
        seen[h] += 1
    return entries


def _range(slope: Slope) -> str:
    """Step sizes of the fit."""
    return MISSING if np.isnan(slope.fit.slope) else "{:g} … {:g}".format(*slope.span)


# -- for programs -------------------------------------------------------------------------------


def _points(slope: Slope) -> list[dict[str, Any]]:
    """Points of a series, the largest step size first."""
    return [
        {
            "h": float(slope.h[i]),
            "value": float(slope.values[i]),
            "status": slope.statuses[i],
            "local_order": float(order),
            "fitted": bool(slope.fitted[i]),
        }
        for i, order in enumerate([math.nan, *slope.local_orders][: len(slope.h)])
    ]


def _data(slope: Slope) -> dict[str, Any]:
    """A series for programs: `Slope.row`, with points and local orders."""
    rest = {key: value for key, value in slope.row().items() if key != "local_orders"}
    return rest | {"role": slope.role, "accepted": slope.accepted, "values": _points(slope)}
