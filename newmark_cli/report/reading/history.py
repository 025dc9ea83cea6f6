"""Time series of multipliers and of drifts: reading them back."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from newmark_cli.newmark.kept import ENERGY, OUTPUT
from newmark_cli.report.reading.curves import Curve
from newmark_cli.study import axes
from newmark_cli.study.cell import DRIFTS
from newmark_cli.study.measures import LAMBDA
from newmark_cli.study.reading import number, read_csv
from newmark_cli.study.results import (
    HISTORY_COLUMNS,
    HISTORY_MAY_HAVE,
    drift_path,
    history_path,
    read,
)
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ResultsError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class History:
    """Multipliers of one cell at its recorded steps."""

    t: Array  #: (recorded,) times (s), ascending
    multipliers: Array  #: (recorded, m) λ
    names: tuple[str, ...]  #: (m,) of the constraints; numbers in files of older versions


def read_histories(
    folder: Path, study: str, cells: Sequence[tuple[Curve, float]]
) -> list[History | None]:
    """Multipliers of cells; None for one that is not there.

    Raises:
        ResultsError: When the file is missing, truncated or of another schema.
    """
    path = history_path(folder, study)
    frame, names = _frame(path, study)
    others = [name for name in names if name == ENERGY or name.startswith(f"{OUTPUT}[")]
    names = names[: len(names) - len(others)]
    # Files of older versions number the multipliers.
    if not names or not all(re.fullmatch(rf"{LAMBDA}(\[.+\]|_\d+)", name) for name in names):
        text = "the columns after t must be lambda[name of a constraint]"
        raise ResultsError(f"{path}, line 1: {text}, given {', '.join(names) or 'none'}")
    return [
        History(table[:, 0], table[:, 1:], tuple(map(_constraint, own))) if table.size else None
        for own, table in _tables(path, frame, names, cells)
    ]


@dataclass(frozen=True, eq=False)
class Drift:
    """By how much one cell misses its constraints at recorded steps."""

    t: Array  #: (recorded,) times (s), ascending
    #: (recorded,) misfits of Φ (m) and of its rate (m/s).
    position: Array
    velocity: Array


def read_drifts(
    folder: Path, study: str, cells: Sequence[tuple[Curve, float]]
) -> list[Drift | None]:
    """Drifts of cells; None for one that is not there.

    Raises:
        ResultsError: As `read_histories`.
    """
    path = drift_path(folder, study)
    frame, names = _frame(path, study)
    if tuple(names) != DRIFTS:
        raise ResultsError(f"{path}, line 1: the columns after t must be {', '.join(DRIFTS)}")
    tables = _tables(path, frame, names, cells)
    return [Drift(*table.T) if table.size else None for _, table in tables]


def _constraint(column: str) -> str:
    """The constraint of ``lambda[bars.link]``, or the number of ``lambda_1``."""
    return column.removeprefix(LAMBDA).strip("[]_")


def _frame(path: Path, study: str) -> tuple["pd.DataFrame", list[str]]:
    """A file of what cells record over time, and its columns that tell no cells apart."""
    content = read(path.parents[1] / f"{study}.csv", series=True)[path]
    frame = read_csv(path, HISTORY_COLUMNS, content=content)
    known = (*HISTORY_COLUMNS, *HISTORY_MAY_HAVE)
    return frame, [name for name in frame.columns if name not in known]


def _tables(
    path: Path, frame: "pd.DataFrame", names: Sequence[str], cells: Sequence[tuple[Curve, float]]
) -> list[tuple[list[str], Array]]:
    """Names, and (recorded, 1 + names) time and values of each cell, empty where it is none."""
    values = {
        name: np.array([number(path, line, name, text) for line, text in frame[name].items()])
        for name in ("h", "t", *names)
    }
    spelled = {
        axis.name: np.array([axis.same(text) for text in frame[axis.name]], object)
        for axis in (axes.STUDY, *axes.cell_axes())
        if axis.series and axis.name in frame.columns
    }
    found = []
    for curve, h in cells:
        rows = np.isclose(values["h"], h, rtol=1e-9, atol=0)
        for name, given in spelled.items():
            # Of a plain text NumPy drops zeros at the end.
            rows &= given == np.array(getattr(curve, name), object)
        table = np.column_stack([values[name][rows] for name in ("t", *names)])
        # Problems with fewer multipliers leave the last columns empty.
        there = ~np.isnan(table).all(axis=0)
        own = [name for name, kept in zip(names, there[1:], strict=True) if kept]
        found.append((own, table[np.argsort(table[:, 0])][:, there]))
    return found
