"""Reading the CSVs of studies back, strictly."""

import csv
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from newmark_cli.study import axes, csv_files
from newmark_cli.study.cell import STATUSES
from newmark_cli.study.csv_files import COLUMNS, NUMBERS, parse_csv
from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError
from newmark_cli.support.spelling import nearest

if TYPE_CHECKING:
    import pandas as pd

_AXES = tuple(axis for axis in csv_files.AXES if axis.name not in NUMBERS)
#: Columns that tell the rows of one step size apart.
SERIES = tuple(axis.name for axis in _AXES)
#: Files in a results folder that are not studies.
NOT_STUDIES = ("slopes.csv",)


def study_files(folder: Path) -> list[Path]:
    """CSVs of the studies in a results folder, by name."""
    # From Python 3.13 on, a glob says nothing of what it cannot look into.
    with suppress(FileNotFoundError, NotADirectoryError, ValueError):
        folder.stat()
    files = sorted(file for file in folder.glob("*.csv") if file.name not in NOT_STUDIES)
    for file in files:
        if not axes.STUDY_NAME.fullmatch(file.stem):
            raise ResultsError(
                f"{file}: no study of a name other than letters, digits, '.', '_', '-'"
            )
    if not files:
        raise ResultsError(f"{folder}: no results; run 'newmark-study reproduce' or 'run' first")
    return files


def named_studies(folder: Path, names: Sequence[str]) -> list[str]:
    """Names of studies in a results folder: those that are asked for, in the folder's order."""
    there = [file.stem for file in study_files(folder)]
    for name in names:
        if name not in there:
            raise ResultsError(f"{folder}: no results of {name!r}{nearest(name, there)}")
    return [name for name in there if name in names or not names]


def read_csv(
    path: Path, columns: Sequence[str], content: bytes | OSError | None = None
) -> "pd.DataFrame":
    """A CSV as text, cell by cell; its index is the line in which each row begins, from 1.

    Its header must have these columns in this order, and its content may be known already.
    """
    import pandas as pd

    texts, lines = _read_csv(path, columns, {}, content)
    return pd.DataFrame(texts, index=lines)


def _read_csv(
    path: Path, columns: Sequence[str], defaults: Mapping[str, str], content: bytes | OSError | None
) -> tuple[dict[str, list[Any]], list[int]]:
    """Columns of a CSV, and the line in which each row begins; those with a default may lack."""
    text = _text(path, content)
    try:
        rows, begins = parse_csv(text)
    except csv.Error as error:
        raise ResultsError(f"{path}: not a CSV: {error}") from None
    header = tuple(rows[0]) if rows else ()
    missing = [name for name in columns if name not in header and name not in defaults]
    ordered = [name for name in columns if name in header]
    if missing or ordered != [name for name in header if name in columns]:
        what = f"lacks {', '.join(missing)}" if missing else "has them in another order"
        raise ResultsError(f"{path}, line 1: not the columns of a study's CSV: {what}")
    if not text.endswith("\n") or len(rows) < 2:
        raise ResultsError(f"{path}, line {begins[-1]}: truncated; run the study again")
    for row, line in zip(rows, begins, strict=True):
        if len(row) != len(header):
            raise ResultsError(
                f"{path}, line {line}: {len(row)} fields where {len(header)} belong; truncated?"
            )
    table = dict(zip(header, map(list, zip(*rows[1:], strict=True)), strict=True))
    for name, usual in defaults.items():
        table.setdefault(name, [usual] * (len(rows) - 1))
    return table, begins[1:]


def _text(path: Path, content: bytes | OSError | None) -> str:
    """Decoded text of a file, read unless its content is given."""
    try:
        content = files.read(path) if content is None else content
        if isinstance(content, OSError):
            raise content
        return content.decode("utf-8")
    except OSError as error:
        raise ResultsError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ResultsError(f"{path}, line 1: not a text file in UTF-8") from None


def read_study(path: Path) -> "pd.DataFrame":
    """Rows of one study's CSV."""
    import pandas as pd

    return pd.DataFrame(read_rows(path))


def read_rows(path: Path, content: bytes | None = None) -> dict[str, list[Any]]:
    """Columns of one study's CSV; pandas takes longer to import than most of them to read.

    What is in memory already is read from its content, and has no record beside it.
    """
    record = path.with_suffix(".json")
    contents = csv_files.read(path) if content is None else {path: content, record: b"{}"}
    columns, lines = _read_csv(path, COLUMNS, csv_files.DEFAULTS, contents[path])
    for axis in _AXES:
        spellings = {text: axis.same(text) for text in dict.fromkeys(columns[axis.name])}
        columns[axis.name] = [spellings[text] for text in columns[axis.name]]
    for column in NUMBERS:
        columns[column] = _numbers(path, lines, column, columns[column])
    # Marches that ended at a missed test stand in CSVs of before.
    for column, allowed in (("status", (*STATUSES, "missed")), ("study", (path.stem,))):
        for line, text in zip(lines, columns[column], strict=True):
            if text not in allowed:
                raise ResultsError(
                    f"{path}, line {line}: {column} is {text!r}; allowed here: {', '.join(allowed)}"
                )
    # A CSV that was cut at the end of a line tells by what stands beside it.
    recorded = parsed(contents[record]).get("rows")
    if isinstance(recorded, int) and recorded != len(lines):
        raise ResultsError(
            f"{path}, line {lines[-1] + 1}: {len(lines)} rows where {recorded} were written; "
            "truncated?"
        )
    return columns


def _numbers(path: Path, lines: Sequence[int], column: str, texts: Sequence[str]) -> list[float]:
    """Numbers of a column; see `number`."""
    try:
        return [float(text) if text else math.nan for text in texts]
    except ValueError:  # says where
        return [number(path, line, column, text) for line, text in zip(lines, texts, strict=True)]


def read_record(path: Path) -> dict[str, Any]:
    """The record next to a CSV; empty where there is none that can be read."""
    return parsed(csv_files.read_records(path)[0])


def mapping(record: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A mapping in a record, which somebody else may have written; empty where there is none."""
    value = record.get(key)
    return value if isinstance(value, dict) else {}


def listed(record: Mapping[str, Any], key: str) -> Sequence[Any]:
    """A list in a record; empty where there is none."""
    value = record.get(key)
    return value if isinstance(value, list) else []


def parsed(content: bytes | OSError) -> dict[str, Any]:
    """A record; empty where there is none that can be read."""
    try:
        record = {} if isinstance(content, OSError) else files.parse_json(content)
    except ValueError:
        return {}
    return record if isinstance(record, dict) else {}


def number(path: Path, line: Any, column: str, text: str) -> float:
    """A number of a CSV; NaN where the cell is empty."""
    if text == "":
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise ResultsError(f"{path}, line {line}: {column}: not a number, given {text!r}") from None
