"""Trajectories of a study: the table of what its cells kept, and reading it back.

A row for each cell and step that was kept: what tells the cell from others, ``step``, ``t``,
and a column for each component, ``u[A.x]``, ``lambda[bars.link]`` and so on, as
`newmark_cli.Trajectory.to_frame` has them.  Problems of one study have different components:
the columns are those of all, and empty where a problem lacks one.  A row for each component
would repeat what tells a cell from others for every number.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from newmark_cli.newmark.kept import DRIFT, ENERGY, KEEPABLE
from newmark_cli.study import axes, csv_files, csv_rows
from newmark_cli.study.axes import Cell, SeriesKey
from newmark_cli.study.cell import DRIFTS, Outcome
from newmark_cli.study.csv_files import HISTORY_COLUMNS, HISTORY_MAY_HAVE
from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError

if TYPE_CHECKING:
    import pandas as pd

_LABELS = frozenset((*HISTORY_COLUMNS, *HISTORY_MAY_HAVE))
_TEXTS = _LABELS - {"h", "step", "t"}


def table(study: str, cells: Sequence[Cell], outcomes: Sequence[Outcome]) -> "pd.DataFrame | None":
    """Trajectories of cells, NaN where a problem lacks a component; None if they kept nothing."""
    labels, parts = [], []
    for cell, outcome in zip(cells, outcomes, strict=True):
        if outcome.trajectory:
            labels.append(axes.labels(cell))
            parts.append({"study": study, **labels[-1], **outcome.trajectory})
    if not parts:
        return None
    import pandas as pd

    components = dict.fromkeys(name for part in parts for name in part if name not in _LABELS)
    ordered = sorted(components, key=lambda name: KEEPABLE.index(name.partition("[")[0]))
    frame = pd.concat([pd.DataFrame(part) for part in parts], ignore_index=True)
    return frame[
        [*HISTORY_COLUMNS, *axes.present(HISTORY_MAY_HAVE, labels, HISTORY_MAY_HAVE), *ordered]
    ]


def csv(frame: "pd.DataFrame") -> str:
    """A table as a CSV whose floats read back to the same bits."""
    texts = {name: frame[name].map(csv_files.spelled) for name in frame.columns if name in _TEXTS}
    return str(frame.assign(**texts).to_csv(index=False, lineterminator="\n"))


def parquet(frame: "pd.DataFrame") -> bytes:
    """A table in Parquet; what is missing is null."""
    sink = io.BytesIO()
    frame.to_parquet(sink, engine="pyarrow", index=False)
    return sink.getvalue()


def read(folder: Path, study: str) -> "pd.DataFrame":
    """Trajectories of a study, from the file that its last run wrote.

    Its columns: ``step`` whole numbers, texts as text, all else floats, NaN where a problem
    lacks a component.

    Raises:
        ResultsError: When there is no such file, or it is not as a run writes it.
        InputError: When it is Parquet, and pyarrow is not installed.
    """
    path = folder / f"{study}.csv"
    contents = csv_files.read(path, series=True)
    text, binary = (csv_files.trajectory_path(folder, study, kind) for kind in (False, True))
    if isinstance(contents[text], FileNotFoundError):
        if isinstance(contents[binary], FileNotFoundError):
            raise ResultsError(
                f"{text}: no trajectories of {study!r}; run it with 'measure: trajectory'"
            )
        return _read_parquet(binary, contents[binary])
    return parse(text, contents[text])


def parse(path: Path, content: bytes | OSError) -> "pd.DataFrame":
    """Trajectories from the content of a CSV; see `read`."""
    frame = csv_rows.read_csv(path, HISTORY_COLUMNS, content=content)
    for column in frame.columns:
        if column not in _TEXTS:
            texts = frame[column].items()
            values = np.array([csv_rows.number(path, line, column, text) for line, text in texts])
            if column != "step":
                frame[column] = values
            elif np.all(values % 1 == 0):
                frame[column] = values.astype(np.int64)
            else:
                raise ResultsError(f"{path}: step: not whole numbers")
    return frame.reset_index(drop=True)


def _read_parquet(path: Path, content: bytes | OSError) -> "pd.DataFrame":
    files.require_parquet("--trajectories parquet")
    import pyarrow as pa
    from pyarrow import parquet

    if isinstance(content, OSError):
        raise ResultsError(f"{path}: cannot be read: {content.strerror}")
    try:
        table_read = parquet.read_table(io.BytesIO(content))
        missing = [name for name in HISTORY_COLUMNS if name not in table_read.column_names]
        if missing:
            raise ResultsError(f"{path}: not trajectories: lacks {', '.join(missing)}")
        frame: pd.DataFrame = table_read.to_pandas()
    except (pa.ArrowException, OSError) as error:
        raise ResultsError(f"{path}: not Parquet: {str(error).splitlines()[0]}") from None
    return frame


# -- multipliers and drifts over time, for figures -----------------------------------------------


def recorded(
    folder: Path, study: str, wanted: str, sizes: Mapping[SeriesKey, float]
) -> tuple[Path, dict[SeriesKey, "pd.DataFrame"]]:
    """The file of a study, and what it has of cells over time, by their series, the start left out.

    A frame has times (s), ascending, as its index.  Columns are components by their names, of
    multipliers by numbers in files of older versions, or drifts: ``position``, misfits of Φ (m),
    and ``velocity``, those of its rate (m/s).

    Args:
        folder, study: The results folder, and the study.
        wanted: What a trajectory keeps: u, lambda, output, drift …
        sizes: Series → step size (s) of the cell.
    """
    path = csv_files.trajectory_path(folder, study)
    former = folder / ("drift" if wanted == DRIFT else "history") / path.name  # before 0.4
    content = csv_files.read(folder / path.name, series=True)[former]
    if isinstance(content, FileNotFoundError):
        frame = read(folder, study)
    else:
        path, frame = former, parse(former, content)
    # Files of older versions number the multipliers, lambda_1, or have drifts by their names.
    listed = DRIFTS if wanted == DRIFT else (ENERGY,) if wanted == ENERGY else ()
    older = ("lambda_",) if wanted == "lambda" else ()
    columns = [n for n in frame.columns if n in listed or n.startswith((f"{wanted}[", *older))]
    if not columns:
        raise ResultsError(f"{path}, line 1: no columns {wanted}[…]; run it with 'keep: {wanted}'")
    names = {name: name.removeprefix(wanted).strip("[]_") or name for name in columns}
    kept = frame.loc[frame["step"] > 0]
    found = {}
    for key, h in sizes.items():
        rows = np.isclose(kept["h"], h, rtol=1e-9, atol=0)
        for axis in (axes.STUDY, *axes.cell_axes()):
            if axis.series and axis.name in kept.columns:
                rows &= kept[axis.name].map(axis.same).to_numpy() == getattr(key, axis.name)
        # Problems with fewer multipliers leave the last columns empty.
        own = kept.loc[rows, ["t", *columns]].sort_values("t").dropna(axis="columns", how="all")
        if own.size:
            found[key] = own.set_index("t").rename(columns=names)
    return path, found
