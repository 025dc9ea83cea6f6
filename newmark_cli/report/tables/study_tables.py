"""Tables of a study: fitted orders, rows and columns by axis, as its config or a command says."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from newmark_cli.report.judging.fits import Fit, fit_parts, format_fit, format_order, power_law
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.judging.text import format_orders
from newmark_cli.report.judging.verdicts import MISS, PASS, SHOWN
from newmark_cli.report.reading import records
from newmark_cli.report.reading.choosing import grouped, select
from newmark_cli.report.reading.words import joined_values, scalings
from newmark_cli.report.tables import theory
from newmark_cli.report.tables.table import MARK, MARKED, MISSING, Record, Report, Table, pivoted
from newmark_cli.study import shipped
from newmark_cli.study.axes import SeriesKey, is_among, value_text
from newmark_cli.study.csv_rows import listed
from newmark_cli.study.entries import TableConfig, table, tables
from newmark_cli.study.showable import TABULATED, VALUES
from newmark_cli.support.errors import InputError, ResultsError

#: What a command prints of a study that does not say.
USUAL = table(rows=["preconditioning"], columns=["quantity"])
#: Values of each series in a list, by default.
LISTED = ("slope", "stderr", "predicted", "verdict")

#: Value of a table, and the quantity of the series that have no other.
FAILED = "failed"
#: Where a reason says that the code of a user's has failed.
_PLACE = re.compile(r"[^:]+\.py, line \d+: ")

#: Value → its text; for programs it is that of `Slope.row`.
_TEXTS: Mapping[str, Callable[[Slope], str]] = {
    "predicted": lambda slope: format_order(slope.expected),
    "tolerance": lambda slope: "" if np.isnan(slope.tolerance) else f"{slope.tolerance:g}",
    "fitted": lambda slope: format_fit(slope.fit) + _marks(slope),
    "slope": lambda slope: fit_parts(slope.fit)[0].replace("-", "−"),
    "stderr": lambda slope: fit_parts(slope.fit)[1],
    "points": lambda slope: str(slope.fit.points),
    "h_from": lambda slope: _step(slope.span[0]),
    "h_to": lambda slope: _step(slope.span[1]),
    "least": lambda slope: _point(slope, slope.least),
    "finest": lambda slope: _point(slope, slope.finest),
    "local_orders": format_orders,
    "verdict": lambda slope: slope.verdict,
    "reason": lambda slope: slope.reason,
    FAILED: lambda slope: slope.reason if slope.quantity == FAILED else "",
}


def _marks(slope: Slope) -> str:
    return ("*" if slope.role == "recovered" else "") + (MARK if slope.missed else "")


def _step(h: float | None) -> str:
    return "" if h is None else f"{h:g}"


def _point(slope: Slope, point: tuple[float, float] | None) -> str:
    """A value and its step size, which needs no word where it is the only one."""
    if point is None:
        return ""
    return f"{point[0]:.2g} at {point[1]:g}" if len(slope.h) > 1 else f"{point[0]:.2g}"


def from_options(
    rows: tuple[str, ...], columns: tuple[str, ...], as_list: bool, values: tuple[str, ...]
) -> TableConfig:
    """The table that options of a command ask for; what they leave open is as usual."""
    if as_list and columns:
        raise InputError("--columns: --list has none; name axes of its rows with --rows")
    try:
        if as_list:
            return table(rows=rows, values=values or LISTED)
        return table(
            rows=rows or ["preconditioning"], columns=columns or ["quantity"], values=values
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        option = first["loc"][0] if first["loc"] else first["ctx"]["key"]
        raise InputError(f"--{option}: {first['msg']}") from None


def defined(folder: Path, study: str) -> Sequence[TableConfig]:
    """Tables that the config of a study defines, by its record, or else the shipped one."""
    return records.configured(folder / f"{study}.csv", "tables", tables)


def report(
    slopes: Iterable[Slope],
    layout: TableConfig,
    record: Mapping[str, Any] | None = None,
    keeps: Callable[[Slope], bool] = lambda slope: True,
) -> Report:
    """Tables of series; as a CSV, a list has numbers, and others have their entries.

    Args:
        slopes: Series of a study.
        layout: What the tables show.
        record: That of the study, which says why cells failed.
        keeps: Whether a series that failed is shown.
    """
    ours = [slope for slope in slopes if slope.measure]
    if FAILED in layout.shown:
        ours = [slope for slope in _with_failed(ours, layout, record or {}) if keeps(slope)]
    titled = groups(ours, layout)
    study = ours[0].study if ours else ""
    name = f"table-{layout.table}" if layout.table else "table"
    legend = _legend(layout, [slope for _, placed in titled for _, slope in placed])
    if layout.across:
        of = layout.title or study
        tables = [replace(_cross(title, placed, layout), of=of) for title, placed in titled]
        return Report(name, tuple(tables), legend, study=study)
    tables = [_list(title, placed, layout) for title, placed in titled]
    rows = [_record(slope, layout) for _, placed in titled for _, slope in placed]
    columns = (*(layout.rows or ("study", *TABULATED)), *layout.shown)
    return Report(name, tuple(tables), legend, rows, columns, study)


def _with_failed(
    slopes: Sequence[Slope], layout: TableConfig, record: Mapping[str, Any]
) -> list[Slope]:
    """Series that a layout chooses, and those that failed, in the order of the study's cells."""
    chosen = {axis: of for axis, of in layout.choice.items() if axis not in ("measure", "quantity")}
    measure = next((slope.measure for slope in select(slopes, **layout.choice)), "")
    reasons: dict[SeriesKey, dict[str, list[str]]] = {}
    for cell in listed(record, "cells"):
        named = {**cell, "study": record["study"], "measure": measure, "quantity": FAILED}
        why = str(cell.get("reason", "")) if cell["status"] == "failed" else ""
        why = _PLACE.sub("", why.removeprefix(f"{cell.get('code')}: "), count=1)
        reasons.setdefault(SeriesKey.of(named), {}).setdefault(why, []).append(f"{cell['h']:g}")
    failed = [
        Slope(key, "primary", reason=_said(of_sizes))
        for key, of_sizes in reasons.items()
        if {*of_sizes} != {""}
    ]
    order = {key: place for place, key in enumerate(reasons)}

    def place(slope: Slope) -> int:
        cell = {"measure": measure, "quantity": FAILED, "row_block": ""}
        return order.get(SeriesKey.of(slope.key.named() | cell), len(order))

    every = [*select(slopes, **layout.choice), *select(failed, **chosen)]
    return sorted(every, key=place)


def _said(of_sizes: Mapping[str, Sequence[str]]) -> str:
    """Why cells of a series failed, and at which step sizes where it has several."""
    several = sum(map(len, of_sizes.values())) > 1
    return "; ".join(
        f"at {', '.join(sizes)}: {why}" if several else why
        for why, sizes in of_sizes.items()
        if why
    )


#: A column and a series in it.
Placed = tuple[str, Slope]


def groups(slopes: Iterable[Slope], layout: TableConfig) -> list[tuple[str, list[Placed]]]:
    """Title and entries of each table of a layout."""
    ours = [slope for slope in slopes if slope.quantity == FAILED or is_among(slope, layout.choice)]
    if not layout.across:
        return [(layout.title or ours[0].study, [("", slope) for slope in ours])] if ours else []
    across = {axis for heading in layout.headings or () for axis in heading.choice}
    said = {*(layout.rows or ()), *(layout.columns or ()), *across}
    apart = [axis for axis in (*TABULATED, "initial") if axis not in said]
    found = grouped(ours, apart)
    varying = [axis for i, axis in enumerate(apart) if len({where[i] for where in found}) > 1]
    titled = [(_title(layout, varying, group[0]), group) for group in found.values()]
    return [(title, placed) for title, group in titled if (placed := _placed(group, layout))]


def _title(layout: TableConfig, varying: Iterable[str], first: Slope) -> str:
    """The title of one of several tables, with what distinguishes it."""
    values = joined_values(varying, first.key.named())
    title = f"{layout.title} ({values})" if layout.title and values else layout.title or values
    return title or first.study


def _placed(slopes: Sequence[Slope], layout: TableConfig) -> list[Placed]:
    """Series by columns; under headings, the strongest for each entry."""
    if not layout.headings:
        across = layout.columns or ()
        return [(joined_values(across, slope.key.named()) or MISSING, slope) for slope in slopes]
    return [
        (heading.label, _strongest(group))
        for heading in layout.headings
        for group in grouped(select(slopes, **heading.choice), layout.rows or ()).values()
    ]


def _strongest(slopes: Sequence[Slope]) -> Slope:
    """The maximum of several series over their common step sizes, with their least order."""
    first = slopes[0]
    if len(slopes) == 1:
        return first
    points = [dict(zip(slope.h.tolist(), slope.values.tolist(), strict=True)) for slope in slopes]
    h = np.array(sorted(set.intersection(*map(set, points)), reverse=True))
    values = np.array([max(of_series[size] for of_series in points) for size in h.tolist()])
    fit: Fit = power_law(h, values)
    expected = np.min([slope.expected for slope in slopes])
    tolerance = np.min([slope.tolerance for slope in slopes])
    verdict = PASS if abs(fit.slope - expected) <= tolerance else MISS
    return replace(
        first, h=h, values=values, fitted=np.isfinite(values), fit=fit, expected=float(expected),
        tolerance=float(tolerance), verdict=SHOWN if np.isnan(expected) else verdict,
    )  # fmt: skip


def _cross(title: str, placed: Sequence[Placed], layout: TableConfig) -> Table:
    rows = {axis: partial(_row_name, axis) for axis in layout.rows or ()}
    entries = [{**slope.key.named(), "column": column, "slope": slope} for column, slope in placed]
    columns = [column for column, slope in placed if slope.quantity != FAILED]
    return pivoted(
        title, entries, rows, "column", lambda e: _entry(e["slope"], layout.shown), columns
    )


def _entry(slope: Slope, values: Iterable[str]) -> str:
    if slope.quantity == FAILED:
        return slope.reason
    texts = dict.fromkeys(_TEXTS[name](slope) for name in values)  # one may be both
    return ": ".join(filter(None, texts)) or MISSING


def _row_name(axis: str, value: str) -> str:
    return value_text(axis, value).removesuffix(" form") if value else MISSING


def _list(title: str, placed: Sequence[Placed], layout: TableConfig) -> Table:
    slopes = [slope for _, slope in placed]
    varying = tuple(a for a in TABULATED if len({getattr(slope, a) for slope in slopes}) > 1)
    names = layout.rows or varying or ("quantity",)
    body = (
        (
            *(_row_name(axis, getattr(slope, axis)) for axis in names),
            *(_TEXTS[name](slope) for name in layout.shown),
        )
        for slope in slopes
    )
    return Table(title, (*names, *layout.shown), tuple(body))


def _record(slope: Slope, layout: TableConfig) -> Record:
    """A series for programs: axes of a list, and values as numbers."""
    row: dict[str, Any] = {**slope.row(), "predicted": slope.expected, "fitted": slope.fit.slope}
    row["least"] = slope.least[0] if slope.least else None
    row["finest"] = slope.finest[0] if slope.finest else None
    row[FAILED] = _TEXTS[FAILED](slope)
    names = layout.rows or ("study", *TABULATED)
    return {name: getattr(slope, name) for name in names} | {n: row[n] for n in layout.shown}


def _legend(layout: TableConfig, slopes: Sequence[Slope]) -> tuple[tuple[str, str], ...]:
    """What entries and marks mean."""
    if not layout.across:
        legend = [(name, f"{VALUES[name]}.") for name in layout.shown]
    else:
        legend = [("", f"Entries: {': '.join(VALUES[name] for name in layout.shown)}.")]
    compared = {*(layout.rows or ()), *(layout.columns or ())}
    if (said := scalings(slopes)) and ("preconditioning" in compared or not layout.across):
        legend.append(("", f"S{said[1:]}."))
    marks = {_marks(slope) for slope in slopes if "fitted" in layout.shown}
    if any("*" in mark for mark in marks):
        legend.append(("", "* marks what is eliminated and recovered from the other unknowns."))
    if any(MARK in mark for mark in marks):
        legend.append(("", MARKED))
    return tuple(legend)


# -- Tables 1 and 2 of the paper, as the shipped config defines them -----------------------------

#: Study that Tables 1 and 2 of the paper read.
PAPER = "all-forms"


def _of_paper(slopes: Iterable[Slope]) -> list[Slope]:
    """Series of the study; raises `ResultsError` when there are none."""
    ours = [s for s in slopes if s.study == PAPER and s.shipped and s.measure]
    if not ours:
        raise ResultsError(
            f"no results of the shipped {PAPER}; run 'newmark-study run {PAPER}' first"
        )
    return ours


def paper_entries(slopes: Iterable[Slope]) -> Iterator[tuple[str, Slope]]:
    """Table and column of each entry of Tables 1 and 2, and its series."""
    ours = _of_paper(slopes)
    for layout in tables(shipped.configs()[PAPER]):
        for _, placed in groups(ours, layout):
            yield from ((f"Table {layout.table}, {column}", slope) for column, slope in placed)


def paper_reports(slopes: Sequence[Slope]) -> list[Report]:
    """Tables 1 and 2 of the paper; the second begins with the factors themselves."""
    ours = _of_paper(slopes)
    first, second = (report(ours, layout) for layout in tables(shipped.configs()[PAPER]))
    return [first, replace(second, tables=(theory.factors(), *second.tables))]


def not_as_predicted(slopes: Iterable[Slope]) -> list[tuple[str, Slope]]:
    """Name and series of each entry of Tables 1 and 2 that is not as predicted."""
    return [
        (f"{name}, {slope.form}, {slope.problem}", slope)
        for name, slope in paper_entries(slopes)
        if slope.missed
    ]
