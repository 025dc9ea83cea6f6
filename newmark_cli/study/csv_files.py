"""The results folder: CSVs of studies, and where they stand."""

import csv
import io
import os
import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from newmark_cli.newmark.statistics import Statistics
from newmark_cli.study import axes
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Outcome
from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError


@dataclass(frozen=True)
class Column:
    """A column of a study's CSV for what was measured; those of the axes come from these."""

    name: str  #: as in the CSV, and the attribute that it holds of its owner
    about: str  #: what it holds
    #: the owner: an `Outcome`, the same in all rows of a cell, or the `Statistics` of a row
    of: type = Statistics
    #: version of the columns that brought it: columns are appended, never moved, and a column past
    #: version 0 is empty in a CSV that lacks it
    since: int = 0


ROUNDING = "rounding"
#: What was measured.
MEASURED = (
    Column(
        "rms",
        "root of the mean square over the steps that count (the sampled ones, for `condition` "
        "and `sensitivity`); what figures and slopes of corrections use",
    ),
    Column("max", "largest value over these steps"),
    Column("median", "median over these steps; what figures and slopes of condition numbers use"),
    Column("last", "value at the last of these steps"),
    Column("zeros", "how many values are exactly zero; a log axis cannot show them"),
    Column(
        "not_converged",
        "steps that reached the cap of iterations above the terminal-phase threshold; "
        "they are left out of the statistics",
        Outcome,
    ),
    Column("newton_iterations", "corrections computed per step, mean", Outcome),
    Column(
        "status",
        "how the cell ended: `ok`, `not_converged`, `stagnated` (a Krylov solver), `singular`, "
        "`diverged`, `redundant` (in space: a row that was released as redundant is needed after "
        "all) or `failed`",
        Outcome,
    ),
    Column("met", "steps that met the tolerance; empty where rounding stops Newton", Outcome, 2),
    Column(
        ROUNDING,
        "what rounding alone changes in the statistic that figures use, in its unit: of "
        "errors and invariants the standard deviation over the march and its twins, and "
        "the reference's own error; of corrections the standard error of the rms from blocks of "
        "steps; of sensitivities the change from one state to a neighbouring one; empty where it "
        "is not known",
        since=5,
    ),
)
#: Axes and settings that have a column.
AXES = (
    axes.STUDY, *(axis for axis in axes.cell_axes() if axis.column), *axes.row_axes(),
)  # fmt: skip

#: Columns of a study's CSV; a new one is appended, none is renamed.
COLUMNS = axes.appended(
    (
        *((axis.since[0], axis.name) for axis in AXES),
        *((column.since, column.name) for column in MEASURED),
    )
)
#: What each column holds.
ABOUT: Mapping[str, str] = {
    **{axis.name: axis.shows or axis.about for axis in AXES},
    **{column.name: column.about for column in MEASURED},
}
#: Columns that hold numbers.
NUMBERS = frozenset(("h", "t_end", "steps", *(of.name for of in MEASURED))) - {"status"}
#: Columns that a CSV of an older version may lack, and what it then has in them.
DEFAULTS = {axis.name: axis.usual for axis in AXES if axis.usual is not None} | {
    column.name: "" for column in MEASURED if column.since > 0
}


def rows(study: str, cells: Iterable[Cell], outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Rows of a study's CSV: one for each cell and quantity, in the order of the cells.

    A cell that failed before it measured anything still has a row.
    """
    table = []
    for cell, outcome in zip(cells, outcomes, strict=True):
        common = {"study": study} | {
            axis.name: axis.write(cell) for axis in axes.cell_axes() if axis.column
        }
        for measurement in outcome.measurements or (None,):
            row = dict(common)
            if measurement is not None:
                row |= {axis.name: axis.write(measurement) for axis in axes.row_axes()}
            owners = {Outcome: outcome, Statistics: measurement and measurement.statistics}
            row |= {of.name: getattr(owners[of.of], of.name, None) for of in MEASURED}
            table.append(row)
    return table


#: Columns of a trajectory before those of what was kept, lambda[bars.link] and so on.
HISTORY_COLUMNS = (
    "study", *(axis.name for axis in axes.cell_axes() if axis.cell and axis.since[0] == 0),
    "step", "t",
)  # fmt: skip
#: Columns that come behind these where a cell has a value that does not go without saying.
HISTORY_MAY_HAVE = tuple(axis.name for axis in axes.cell_axes() if axis.cell and axis.since[0] > 0)


def trajectory_path(folder: Path, study: str, parquet: bool = False) -> Path:
    """File of a study's trajectories: a CSV, or in Parquet."""
    return folder / "trajectory" / f"{study}.{'parquet' if parquet else 'csv'}"


#: Folder of the records of runs.
RUNS = "runs"
#: Folders of what cells record over time; those but the last are of versions before 0.4.
SERIES_FOLDERS = ("history", "drift", "trajectory")


def csv_text(columns: Iterable[str], table: Iterable[Mapping[str, Any]]) -> str:
    """CSV with floats that read back to the same bits; what is missing or NaN is empty.

    What a spreadsheet would take for a formula has an apostrophe before it.
    """
    columns = list(columns)
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    for row in table:
        writer.writerow([spelled(row.get(column)) for column in columns])
    return file.getvalue()


def parse_csv(text: str) -> tuple[list[list[str]], list[int]]:
    """Fields of a CSV as `csv_text` was given them, and the line in which each row begins."""
    rows, begins, before = [], [], 0
    guarded = "'" in text
    # Lines end at line feeds only: a name may have what other programs end a line with.
    reader = csv.reader(io.StringIO(text, newline="\n"))
    for row in reader:
        rows.append([_unguarded(field) for field in row] if guarded else row)
        begins.append(before + 1)
        before = reader.line_num
    return rows, begins


def spelled(value: Any) -> str:
    """A value in a CSV."""
    if value is None or value != value:
        return ""
    if isinstance(value, float):
        return repr(float(value))
    text = str(value)
    if isinstance(value, str) and _FORMULA.match(text) and not _PLAIN_NUMBERS.fullmatch(text):
        return f"'{text}"  # which no spreadsheet takes for a formula; see `_unguarded`
    return text


#: Beginning of a cell that a spreadsheet takes for a formula, and the same with an apostrophe.
_FORMULA = re.compile(r"""[ "']*[=+\-@\t\r]""")
_GUARDED = re.compile(rf"'{_FORMULA.pattern}")
#: Numbers between blanks, which are no formula whatever their sign is.
_PLAIN_NUMBERS = re.compile(r"[-+]?[0-9.]+(e[-+]?[0-9]+)?( ([-+]?[0-9.]+(e[-+]?[0-9]+)?|nan))*")


def _unguarded(text: str) -> str:
    return text[1:] if _GUARDED.match(text) else text


def run_path(path: Path) -> Path:
    """Record of what differs from run to run: times, versions, machine."""
    return path.parent / RUNS / path.with_suffix(".json").name


def series_paths(path: Path) -> tuple[Path, ...]:
    """Files of what a study records over time, of which it may have none."""
    csvs = (path.parent / folder / f"{path.stem}.csv" for folder in SERIES_FOLDERS)
    return (*csvs, trajectory_path(path.parent, path.stem, True))


def replace(
    folder: Path,
    study: str,
    texts: Mapping[Path, str | bytes],
    record: Mapping[str, Any],
    run: Mapping[str, Any],
) -> None:
    """Write the CSVs of a study and their records; readers see those of one run."""
    path = folder / f"{study}.csv"
    series = series_paths(path)
    for file in series:
        if file in texts:
            files.make_folder(file.parent, folder)
    gone = {file: None for file in series if file not in texts and os.path.lexists(file)}
    files.make_folder(run_path(path).parent, folder)
    records = {path.with_suffix(".json"): record, run_path(path): run}
    contents = {**texts, **gone, **{file: files.json_text(of) for file, of in records.items()}}
    files.replace_together(contents, folder)


def read(path: Path, series: bool = False) -> dict[Path, bytes | OSError]:
    """Contents of a CSV, its records and, if asked for, its `series_paths`, as `read_records`."""
    paths = (path, path.with_suffix(".json"), run_path(path), *(series_paths(path) * series))
    return {file: _content(file, path.parent) for file in paths}


def read_records(path: Path) -> tuple[bytes | OSError, bytes | OSError]:
    """Contents of the records of a study and of its run, or why they cannot be read."""
    return _content(path.with_suffix(".json"), path.parent), _content(run_path(path), path.parent)


def _content(file: Path, folder: Path) -> bytes | OSError:
    try:
        files.require_within(file.parent, folder)
        return files.read(file)
    except OSError as error:
        return error


def require_writable(folder: Path, names: Iterable[str]) -> None:
    """Refuse a results folder before hours of work rather than after."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor, probe = tempfile.mkstemp(dir=folder, prefix=".probe.")
        os.close(descriptor)
        Path(probe).unlink(missing_ok=True)
    except OSError as error:
        raise ResultsError(f"{folder}: results cannot be written: {error.strerror}") from None
    for name in names:
        files.require_replaceable(folder / name)
