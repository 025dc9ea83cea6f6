"""Trajectories of a study: the table of what its cells kept, and reading it back.

A row for each cell and step that was kept: what tells the cell from others, ``step``, ``t``,
and a column for each component, ``u[A.x]``, ``lambda[bars.link]`` and so on, as
`newmark_cli.Trajectory.to_frame` has them.  Problems of one study have different components:
the columns are those of all, and empty where a problem lacks one.  A row for each component
would repeat what tells a cell from others for every number.
"""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.newmark.kept import KEEPABLE
from newmark_cli.study import axes, reading, results
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Outcome
from newmark_cli.study.results import HISTORY_COLUMNS, HISTORY_MAY_HAVE
from newmark_cli.support.errors import InputError, ResultsError

if TYPE_CHECKING:
    import pandas as pd

_TEXTS = frozenset((*HISTORY_COLUMNS, *HISTORY_MAY_HAVE)) - {"h", "step", "t"}


def require_parquet() -> None:
    """Refuse to write Parquet where nobody can."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise InputError(
            "--format parquet needs pyarrow; install it with: pip install 'newmark-study[parquet]'"
        ) from None


@dataclass(frozen=True, eq=False)
class Table:
    """Trajectories that the cells of a study kept."""

    study: str  #: its name
    columns: Sequence[str]  #: of the file, in their order
    #: what tells each cell from others, and what it kept
    parts: Sequence[tuple[dict[str, Any], Outcome]]

    def csv(self) -> str:
        """As a CSV whose floats read back to the same bits."""
        return results.csv_text(self.columns, self._rows())

    def _rows(self) -> Iterator[dict[str, Any]]:
        # Row by row: there may be millions of values.
        for label, outcome in self.parts:
            names = tuple(outcome.trajectory)
            lists = (values.tolist() for values in outcome.trajectory.values())
            for values in zip(*lists, strict=True):
                yield {"study": self.study, **label, **dict(zip(names, values, strict=True))}

    def parquet(self) -> bytes:
        """In Parquet; what is missing is null."""
        import pyarrow as pa
        from pyarrow import parquet

        parts = []
        for label, outcome in self.parts:
            texts = {"study": self.study, **label}
            kept = len(outcome.trajectory["step"])
            arrays = {}
            for name in self.columns:
                if name in outcome.trajectory:
                    arrays[name] = pa.array(outcome.trajectory[name])
                elif name in texts:
                    kind = pa.float64() if name == "h" else pa.string()
                    arrays[name] = pa.array([texts[name]] * kept, kind)
                else:
                    arrays[name] = pa.nulls(kept, pa.float64())
            parts.append(pa.table(arrays))
        sink = io.BytesIO()
        parquet.write_table(pa.concat_tables(parts), sink)
        return sink.getvalue()


def table(study: str, cells: Sequence[Cell], outcomes: Sequence[Outcome]) -> Table | None:
    """Trajectories of cells; None if they kept nothing."""
    parts = [
        (axes.labels(cell), outcome)
        for cell, outcome in zip(cells, outcomes, strict=True)
        if outcome.trajectory
    ]
    if not parts:
        return None
    components = dict.fromkeys(
        name for _, outcome in parts for name in outcome.trajectory if name not in ("step", "t")
    )
    ordered = sorted(components, key=lambda name: KEEPABLE.index(name.partition("[")[0]))
    varying = results.told_apart([label for label, _ in parts])
    return Table(study, (*HISTORY_COLUMNS, *varying, *ordered), parts)


def read(folder: Path, study: str) -> "pd.DataFrame":
    """Trajectories of a study, from the file that its last run wrote.

    Its columns: ``step`` whole numbers, texts as text, all else floats, NaN where a problem
    lacks a component.

    Raises:
        ResultsError: When there is no such file, or it is not as a run writes it.
        InputError: When it is Parquet, and pyarrow is not installed.
    """
    path = folder / f"{study}.csv"
    contents = results.read(path, series=True)
    csv, parquet = (results.trajectory_path(folder, study, kind) for kind in (False, True))
    if isinstance(contents[csv], FileNotFoundError):
        if isinstance(contents[parquet], FileNotFoundError):
            raise ResultsError(
                f"{csv}: no trajectories of {study!r}; run it with 'measure: trajectory'"
            )
        return _read_parquet(parquet, contents[parquet])
    return parse(csv, contents[csv])


def parse(path: Path, content: bytes | OSError) -> "pd.DataFrame":
    """Trajectories from the content of a CSV; see `read`."""
    frame = reading.read_csv(path, HISTORY_COLUMNS, content=content)
    for column in frame.columns:
        if column not in _TEXTS:
            texts = frame[column].items()
            values = np.array([reading.number(path, line, column, text) for line, text in texts])
            if column != "step":
                frame[column] = values
            elif np.all(values % 1 == 0):
                frame[column] = values.astype(np.int64)
            else:
                raise ResultsError(f"{path}: step: not whole numbers")
    return frame.reset_index(drop=True)


def _read_parquet(path: Path, content: bytes | OSError) -> "pd.DataFrame":
    require_parquet()
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
