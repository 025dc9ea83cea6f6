"""Ways in which somebody changes the CSV of a study, as functions of its rows."""

from newmark_cli.study.measures import RECORDS
from newmark_cli.study.results import csv_text, parse_csv

STATISTICS = ("rms", "max", "median", "last")


def read(path):
    """Columns, and rows as text."""
    (columns, *rows), _ = parse_csv(path.read_bytes().decode())
    return columns, [dict(zip(columns, row, strict=True)) for row in rows]


def write(path, columns, rows):
    """As the tool writes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(csv_text(columns, rows))


def times(rows, factor, chosen=lambda row: True, columns=None):
    """Rows with numbers times a factor: those that are drawn, or those in columns."""

    def changed(row):
        names = columns or [RECORDS[row["measure"]].statistic]
        return {name: repr(float(row[name]) * factor) for name in names if row[name]}

    return [row | changed(row) if row["measure"] and chosen(row) else row for row in rows]


def swapped(rows, i, j):
    """Two rows, one in place of the other."""
    rows = list(rows)
    rows[i], rows[j] = rows[j], rows[i]
    return rows


def without(rows, **values):
    """Without the rows that have all these values."""
    return [row for row in rows if any(row[name] != value for name, value in values.items())]


def given(rows, chosen=lambda row: True, **values):
    """With other values in the chosen rows."""
    return [row | values if chosen(row) else row for row in rows]
