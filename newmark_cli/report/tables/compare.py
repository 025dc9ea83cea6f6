"""Two results folders side by side: cells, values, slopes, verdicts, environments."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.report.judging import expectations, slopes
from newmark_cli.report.judging.fits import format_fit
from newmark_cli.report.judging.text import text_table
from newmark_cli.report.reading import records
from newmark_cli.study import axes
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.csv_rows import SERIES, read_study, study_files
from newmark_cli.study.measures import RECORDS
from newmark_cli.support.errors import visible

if TYPE_CHECKING:
    import pandas as pd

#: Measures of what is determined by more than rounding: they agree to a relative tolerance.
DETERMINED = ("condition", "sensitivity", "krylov_iterations")

#: Factor within which all other measures agree.  Two machines round differently, as two
#: codings of one step do: in the studies `all-forms`, `integrators` and `precision` rms of
#: corrections in physical units scatter by up to 8.4 over forms and variants.
FACTOR = 10.0

#: Columns that tell rows, and cells, apart.
_ROW = [*SERIES, "h", "steps"]
_OF_ROWS = {axis.name: "" for axis in axes.row_axes()}
_CELL = [name for name in _ROW if name not in _OF_ROWS]

#: What is not the same in both folders, and what it is in either.
Difference = tuple[str, str, str]


def compare(
    first: Path, second: Path, rtol: float, most: int | None
) -> tuple[str, dict[str, Any], bool]:
    """Compare two results folders.

    Args:
        first, second: The folders.
        rtol: Relative tolerance of the measures in `DETERMINED`.
        most: Length of each printed list; None prints all.

    Returns:
        What to print, all of it as data, and whether a verdict is another one or a study in both
        folders has a cell, series or row in only one of them.
    """
    names = str(first), str(second)
    a, b = _rows(first), _rows(second)
    cells = a.drop_duplicates(_CELL).merge(b.drop_duplicates(_CELL), on=_CELL)
    both = a[a["measure"] != ""].merge(b, on=_ROW)
    lines = [f"cells in both: {len(cells)}"]
    only = [list(_only(*pair)) for pair in ((a, b), (b, a))]
    lacked = [list(_lacked(*pair)) for pair in ((a, b), (b, a))]
    for lacking in (lacked, only):
        for name, entries in zip(names, lacking, strict=True):
            shown = [*entries[:most], *_more(entries, most)]
            lines += [visible(f"only in {name}: {entry}") for entry in shown]
    beyond = both[~agree(both["measure"], both["value_x"], both["value_y"], rtol)]
    ours, theirs = (_judged(folder) for folder in (first, second))
    judged = {name: (ours[name], theirs[name]) for name in ours if name in theirs}
    verdicts = [
        (name, " ".join(x[:2]), " ".join(y[:2])) for name, (x, y) in judged.items() if x[1] != y[1]
    ]
    apart = {name: abs(x[2] - y[2]) for name, (x, y) in judged.items() if not math.isnan(x[2])}
    farthest = max(apart, key=lambda name: np.nan_to_num(apart[name]), default="")
    differences: dict[str, list[Difference]] = {
        "statuses": _differences(cells[cells["status_x"] != cells["status_y"]], "status", _cell),
        "values": _differences(beyond, "value", _row),
        "farthest_slope": [(farthest, ours[farthest][0], theirs[farthest][0])]
        if apart.get(farthest, 0) > 0
        else [],
        "environment": list(_environments(first, second)),
        "verdicts": verdicts,
    }
    fitted = sum(of[3] for of, _ in judged.values())
    titles = (
        f"cells that ended differently: {len(differences['statuses'])}",
        f"values beyond tolerance: {len(beyond)} of {len(both)} "
        f"({', '.join(DETERMINED)}: {rtol:g}; others: a factor of {FACTOR:g})",
        "slope farthest apart:" if differences["farthest_slope"] else "no slope differs",
        "computed with something else:" if differences["environment"]
        else "no difference in what was recorded of code and machine",
        f"verdicts changed: {len(verdicts)}, of {fitted} slopes and {len(judged) - fitted} claims",
    )  # fmt: skip
    blocks = zip(titles, differences.values(), strict=True)
    text = "\n\n".join(["\n".join(lines), *(_block(*block, names, most) for block in blocks)])
    data = {
        "folders": [*names],
        "cells_in_both": len(cells),
        "values_in_both": len(both),
        "only_in_first": lacked[0] + only[0],
        "only_in_second": lacked[1] + only[1],
        **differences,
    }
    return text, data, bool(verdicts) or any(only)


def _block(
    title: str, entries: Sequence[Difference], names: tuple[str, str], most: int | None
) -> str:
    """A list under its title, or the title only."""
    if not entries:
        return title
    block = f"{title}\n{text_table([('', *names), *entries[:most]], indent=2)}"
    return "\n  ".join([block, *_more(entries, most)])


def _more(entries: Sequence[Any], most: int | None) -> list[str]:
    """How many entries are not shown, if any."""
    left = len(entries) - len(entries[:most])
    return [f"{left} more (--all)"] if left else []


def _rows(folder: Path) -> "pd.DataFrame":
    """Rows of all studies of a folder, with the values that are compared."""
    import pandas as pd

    frame = pd.concat(map(read_study, study_files(folder)), ignore_index=True)
    frame["value"] = math.nan
    for measure, rows in frame.groupby("measure", sort=False):
        if measure in RECORDS:
            frame.loc[rows.index, "value"] = RECORDS[str(measure)].drawn(rows)
    return frame


def _only(mine: "pd.DataFrame", theirs: "pd.DataFrame") -> Iterator[str]:
    """Cells, series and rows of studies in both frames that the second one lacks."""
    mine = mine[mine["study"].isin(theirs["study"])]

    def lacks(keys: list[str]) -> "pd.Series[bool]":
        merged = mine[keys].merge(theirs[keys].drop_duplicates(), how="left", indicator=True)
        return (merged["_merge"] == "left_only").set_axis(mine.index)

    no_cell, no_series = lacks(_CELL), lacks([*SERIES])
    for row in mine[no_cell].drop_duplicates(_CELL).to_dict("records"):
        yield _cell(row)
    there = ~no_cell & (mine["measure"] != "")
    for values, rows in mine[there & no_series].groupby([*SERIES], sort=False):
        series = _series(SeriesKey.of(dict(zip(SERIES, values, strict=True))))
        yield f"{series}, {len(rows)} row{'s' if len(rows) > 1 else ''}"
    for row in mine[there & ~no_series & lacks(_ROW)].to_dict("records"):
        yield _row(row)


def _lacked(mine: "pd.DataFrame", theirs: "pd.DataFrame") -> Iterator[str]:
    """Studies that the second frame lacks altogether."""
    cells = mine[~mine["study"].isin(theirs["study"])].drop_duplicates(_CELL)
    for study, count in cells["study"].value_counts(sort=False).items():
        yield f"study {study}, {count} cells"


def _differences(rows: "pd.DataFrame", column: str, named: Any) -> list[Difference]:
    def text(value: Any) -> str:
        return f"{value:.6g}" if isinstance(value, float) else str(value)

    return [
        (named(row), *(text(row[f"{column}_{side}"]) for side in "xy"))
        for row in rows.to_dict("records")
    ]


def agree(measure: Any, a: Any, b: Any, rtol: float) -> Any:
    """Whether values of measures, at least 0, or NaN for none, agree but for rounding."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    with np.errstate(invalid="ignore"):
        close = high - low <= rtol * high
        alike = np.where(np.isin(measure, DETERMINED), close, high <= FACTOR * low)
    return alike | (np.isnan(a) & np.isnan(b))


#: What was measured, the verdict, the slope if it is one of a series, and whether it is.
_Judged = tuple[str, str, float, bool]


def _judged(folder: Path) -> dict[str, _Judged]:
    """Series, claims and expectations in words, with what they come to."""
    found = slopes.collect(folder)
    judged: dict[str, _Judged] = {}
    for claim in expectations.judge(folder, found):
        if not claim.missing:
            name = claim.name if claim.figure else f"expectation of {claim.study}"
            judged[f"{name}: {claim.text}"] = claim.measured, claim.verdict, math.nan, False
    for slope in found:
        judged[_series(slope.key)] = format_fit(slope.fit), slope.verdict, slope.fit.slope, True
    return judged


def _environments(*folders: Path) -> Iterator[Difference]:
    """Facts about code and machine of the studies in both folders that differ.

    One folder may mix several machines.  Where a run has no record, as with results that are
    shipped, nothing of it is compared.
    """
    first, second = (
        {file.stem: records.known(file) for file in study_files(folder)} for folder in folders
    )
    shared: dict[str, list[tuple[str, str]]] = {}
    for study, record in first.items():
        if not (record and second.get(study)):
            continue
        mine, theirs = (
            records.environment(of)
            | {f"config of {study}": str(of.get("config_sha256", records.UNKNOWN))}
            for of in (record, second[study])
        )
        ran = "python" in mine and "python" in theirs
        for name in dict.fromkeys((*mine, *theirs)):
            if ran or (name in mine and name in theirs):
                sides = mine.get(name, records.UNKNOWN), theirs.get(name, records.UNKNOWN)
                shared.setdefault(name, []).append(sides)
    for name, pairs in shared.items():
        a, b = (", ".join(dict.fromkeys(side)) for side in zip(*pairs, strict=True))
        if a != b:
            yield name, a, b


def _at(row: Mapping[Any, Any]) -> str:
    return f"h = {row['h']:g}, {row['steps']:g} steps"


def _cell(row: Mapping[Any, Any]) -> str:
    return f"{_where(SeriesKey.of({**row, **_OF_ROWS}))}, {_at(row)}"


def _row(row: Mapping[Any, Any]) -> str:
    return f"{_series(SeriesKey.of(row))}, {_at(row)}"


def _where(key: SeriesKey) -> str:
    return " ".join(key.besides("measure", "quantity", "row_block"))


def _series(key: SeriesKey) -> str:
    return f"{_where(key)}, {' '.join(filter(None, (key.measure, key.quantity, key.row_block)))}"
