"""The results folder: CSVs of studies, their provenance, atomic writing."""

import csv
import io
import json
import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from newmark_cli.errors import InputError
from newmark_cli.study.cell import Cell, Outcome

#: Columns of a study's CSV; a new one is appended, none is renamed.
COLUMNS = (
    "study", "problem", "integrator", "form", "preconditioning", "evaluation", "precision",
    "linear_solver", "h", "t_end", "steps", "quantity", "measure", "role", "rms", "max",
    "median", "last", "zeros", "not_converged", "newton_iterations", "status",
    "row_block", "stop", "met",
)  # fmt: skip


class ResultsError(InputError):
    """The results folder or a file in it cannot be used."""


def rows(study: str, cells: Iterable[Cell], outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Rows of a study's CSV: one for each cell and quantity, in the order of the cells.

    A cell that failed before it measured anything still has a row.
    """
    table = []
    for cell, outcome in zip(cells, outcomes, strict=True):
        common = (
            {"study": study}
            | cell.labels
            | {
                "t_end": cell.t_end,
                "steps": cell.steps,
                "not_converged": outcome.not_converged,
                "newton_iterations": outcome.newton_iterations,
                "status": outcome.status,
                "stop": cell.stop.label if cell.stop else "saturation",
                "met": outcome.met,
            }
        )
        for found in outcome.measurements:
            statistics = found.statistics
            table.append(
                common
                | {
                    "quantity": found.quantity,
                    "measure": found.measure,
                    "role": found.role,
                    "row_block": found.row_block,
                }
                | vars(statistics)
            )
        if not outcome.measurements:
            table.append(common)
    return table


#: Columns of a time series before those of the multipliers, lambda_1, lambda_2, …
HISTORY_COLUMNS = (
    "study", "problem", "integrator", "form", "preconditioning", "evaluation", "precision",
    "linear_solver", "h", "step", "t",
)  # fmt: skip


def history_path(folder: Path, study: str) -> Path:
    """File of a study's time series."""
    return folder / "history" / f"{study}.csv"


def history_text(study: str, cells: Iterable[Cell], outcomes: Iterable[Outcome]) -> str:
    """CSV of the recorded multipliers: a row for each cell and recorded step; or empty."""
    table = [
        {"study": study}
        | cell.labels
        | {"step": step, "t": cell.problem.load().t0 + step * cell.h}
        | {f"lambda_{k + 1}": float(value) for k, value in enumerate(multipliers)}
        for cell, outcome in zip(cells, outcomes, strict=True)
        for step, multipliers in outcome.history
    ]
    most = max((len(row) for row in table), default=0) - len(HISTORY_COLUMNS)
    columns = (*HISTORY_COLUMNS, *(f"lambda_{k + 1}" for k in range(most)))
    return csv_text(columns, table) if table else ""


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
