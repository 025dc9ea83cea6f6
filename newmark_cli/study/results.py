"""The results folder: CSVs of studies, their provenance, atomic writing."""

import csv
import io
import json
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from newmark_cli.errors import InputError
from newmark_cli.newmark.statistics import Statistics
from newmark_cli.study import axes
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Outcome

#: Columns of what a cell found, besides its axes, and the version that brought each.
_STATISTICS = tuple((0, each.name) for each in fields(Statistics))
_OUTCOME = ((0, "not_converged"), (0, "newton_iterations"), (0, "status"), (2, "met"))

#: Columns of a study's CSV; a new one is appended, none is renamed.
COLUMNS = axes.appended(
    (
        (axes.STUDY.since[0], axes.STUDY.name),
        *((axis.since[0], axis.name) for axis in axes.cell_axes() if axis.column),
        *((axis.since[0], axis.name) for axis in axes.row_axes()),
        *_STATISTICS,
        *_OUTCOME,
    )
)
#: Columns that hold numbers.
NUMBERS = frozenset(
    ("h", "t_end", "steps", *(name for _, name in (*_STATISTICS, *_OUTCOME) if name != "status"))
)


class ResultsError(InputError):
    """The results folder or a file in it cannot be used."""


def rows(study: str, cells: Iterable[Cell], outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Rows of a study's CSV: one for each cell and quantity, in the order of the cells.

    A cell that failed before it measured anything still has a row.
    """
    table = []
    for cell, outcome in zip(cells, outcomes, strict=True):
        common = {
            "study": study,
            **{axis.name: axis.write(cell) for axis in axes.cell_axes() if axis.column},
            **{name: getattr(outcome, name) for _, name in _OUTCOME},
        }
        for found in outcome.measurements:
            of_row = {axis.name: axis.write(found) for axis in axes.row_axes()}
            table.append(common | of_row | vars(found.statistics))
        if not outcome.measurements:
            table.append(common)
    return table


#: Columns of a time series before those of the multipliers, lambda_1, lambda_2, …
HISTORY_COLUMNS = (
    "study", *(axis.name for axis in axes.cell_axes() if axis.cell and axis.since[0] == 0),
    "step", "t",
)  # fmt: skip
#: Columns that come behind these where a cell has a value that does not go without saying.
HISTORY_MAY_HAVE = tuple(axis.name for axis in axes.cell_axes() if axis.cell and axis.since[0] > 0)


def history_path(folder: Path, study: str) -> Path:
    """File of a study's time series."""
    return folder / "history" / f"{study}.csv"


def history_text(study: str, cells: Sequence[Cell], outcomes: Sequence[Outcome]) -> str:
    """CSV of the recorded multipliers: a row for each cell and recorded step; or empty."""
    recording = [
        (cell, outcome) for cell, outcome in zip(cells, outcomes, strict=True) if outcome.history
    ]
    if not recording:
        return ""
    most = max(len(values) for _, outcome in recording for _, values in outcome.history)
    names = [f"lambda_{k + 1}" for k in range(most)]
    labels = [axes.labels(cell) for cell, _ in recording]
    told = [
        axis.name
        for axis in axes.cell_axes()
        if axis.name in HISTORY_MAY_HAVE and any(each[axis.name] != axis.usual for each in labels)
    ]
    # Row by row: there may be millions of values.
    table = (
        {"study": study}
        | label
        | {"step": step, "t": cell.problem.load().t0 + step * cell.h}
        | dict(zip(names, multipliers.tolist(), strict=False))
        for label, (cell, outcome) in zip(labels, recording, strict=True)
        for step, multipliers in outcome.history
    )
    return csv_text((*HISTORY_COLUMNS, *told, *names), table)


def csv_text(columns: Iterable[str], table: Iterable[Mapping[str, Any]]) -> str:
    """CSV with floats that read back to the same bits; what is missing or NaN is empty."""
    columns = list(columns)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in table:
        writer.writerow([_spell(row.get(column)) for column in columns])
    return text.getvalue()


def _spell(value: Any) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, float):
        return repr(float(value))
    return str(value)


def write_atomically(path: Path, content: str | bytes, make_folder: bool = True) -> None:
    """Write a file under a temporary name and rename it: whole, or as it was before.

    Args:
        path: The file.
        content: Text or bytes.
        make_folder: Whether to make its folder; what was there when a run began and
            is not any more was taken away by somebody.

    Raises:
        ResultsError: When it cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        if make_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.chmod(temporary, 0o666 & ~_umask())
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {error.strerror}") from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def require_writable(folder: Path, names: Iterable[str]) -> None:
    """Refuse a results folder before hours of work rather than after.

    Args:
        folder: Results folder; made when it does not exist.
        names: Files that will be written into it.

    Raises:
        ResultsError: When the folder cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor, probe = tempfile.mkstemp(dir=folder, prefix=".probe.")
        os.close(descriptor)
        Path(probe).unlink(missing_ok=True)
    except OSError as error:
        raise ResultsError(f"{folder}: results cannot be written: {error.strerror}") from None
    for name in names:
        if (folder / name).is_dir():
            raise ResultsError(f"{folder / name}: cannot be written: it is a folder")


def write_json(path: Path, value: Any, make_folder: bool = True) -> None:
    """Write JSON for people to read; see `write_atomically`."""
    write_atomically(path, json.dumps(value, indent=2, ensure_ascii=False) + "\n", make_folder)


def make_subfolder(folder: Path) -> None:
    """Make a folder in a results folder, which exists.

    Raises:
        ResultsError: When it cannot be made.
    """
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise ResultsError(f"{folder}: cannot be made: {error.strerror}") from None
