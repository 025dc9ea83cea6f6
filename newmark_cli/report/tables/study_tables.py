"""Tables of any study: its fitted orders, rows and columns by axis."""

from collections.abc import Iterable, Sequence

from newmark_cli.report.judging.fits import format_fit
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.judging.text import latex_text
from newmark_cli.report.reading.words import joined_values
from newmark_cli.report.tables.check import format_prediction
from newmark_cli.report.tables.paper_tables import latex_row, latex_table, markdown_table
from newmark_cli.study import results
from newmark_cli.study.axes import ALIASES
from newmark_cli.study.drawing import COMPARABLE
from newmark_cli.support.errors import InputError
from newmark_cli.support.spelling import nearest

#: Axes that rows and columns can stand for, and formats.
AXES = (*COMPARABLE, "measure")
FORMATS = ("markdown", "latex", "csv")

#: How to read an entry.
NOTE = "Predicted ± tolerance: fitted ± standard error; only fitted where theory predicts no order."

#: A title, and rows with headings first.
Grid = tuple[str, list[tuple[str, ...]]]


def grids(slopes: Iterable[Slope], rows: str, columns: str) -> list[Grid]:
    """A table for each combination of the axes that are neither rows nor columns.

    Args:
        slopes: The series.
        rows, columns: Two of `AXES`.

    Raises:
        InputError: When an axis is none, or both are the same.
    """
    rows, columns = ALIASES.get(rows, rows), ALIASES.get(columns, columns)
    for option, axis in (("--rows", rows), ("--columns", columns)):
        if axis not in AXES:
            raise InputError(f"{option}: unknown axis {axis!r}{nearest(axis, AXES)}")
    if rows == columns:
        raise InputError(f"--columns: {columns!r} are the rows already")
    others = [axis for axis in (*AXES, "initial") if axis not in (rows, columns)]
    tables: dict[tuple[str, ...], list[Slope]] = {}
    for slope in slopes:
        if slope.measure:
            tables.setdefault(tuple(getattr(slope, axis) for axis in others), []).append(slope)
    varying = [axis for i, axis in enumerate(others) if len({where[i] for where in tables}) > 1]
    found = []
    for where, ours in tables.items():
        named = dict(zip(others, where, strict=True))
        found.append((joined_values(varying, named) or ours[0].study, _rows(ours, rows, columns)))
    return found


def _rows(slopes: Sequence[Slope], rows: str, columns: str) -> list[tuple[str, ...]]:
    cells = {(getattr(slope, rows), getattr(slope, columns)): slope for slope in slopes}
    down, across = (list(dict.fromkeys(key[i] for key in cells)) for i in (0, 1))
    headings = (rows, *(joined_values([columns], {columns: value}) for value in across))
    return [
        headings,
        *(
            (
                joined_values([rows], {rows: value}),
                *(_cell(cells.get((value, other))) for other in across),
            )
            for value in down
        ),
    ]


def _cell(slope: Slope | None) -> str:
    if slope is None:
        return "–"
    return ": ".join(filter(None, (format_prediction(slope), format_fit(slope.fit))))


def text(tables: Sequence[Grid], form: str) -> str:
    """The tables in one of `FORMATS`."""
    if form == "markdown":
        return "\n".join(markdown_table(title, rows, NOTE) for title, rows in tables)
    if form == "csv":
        columns = ("table", *dict.fromkeys(name for _, rows in tables for name in rows[0]))
        entries = (
            {"table": title, **dict(zip(rows[0], row, strict=True))}
            for title, rows in tables
            for row in rows[1:]
        )
        return results.csv_text(columns, entries)
    return "\n".join(
        latex_table(
            f"{latex_text(title)}. {latex_text(NOTE)}",
            f"orders-{i}",
            "l" * len(rows[0]),
            [latex_row([latex_text(name) for name in rows[0]])],
            [[latex_text(entry) for entry in row] for row in rows[1:]],
        )
        for i, (title, rows) in enumerate(tables, 1)
    )
