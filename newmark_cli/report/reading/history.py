"""What cells record over time, multipliers and drifts: reading them back."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from newmark_cli.newmark.kept import ENERGY, OUTPUT
from newmark_cli.report.reading.figures import Curve
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


@dataclass(frozen=True, eq=False)
class Recorded:
    """What one cell records over time.

    Multipliers go by their constraints, or by numbers in files of older versions; drifts are
    ``position``, misfits of Φ (m), and ``velocity``, those of its rate (m/s).
    """

    t: Array  #: (recorded,) times (s), ascending
    values: Array  #: (recorded, names)
    names: tuple[str, ...]


def read_recorded(
    folder: Path, study: str, kind: str, cells: Sequence[tuple[Curve, float]]
) -> tuple[Path, list[Recorded | None]]:
    """The file of a study, and what it has of cells; None for one that is not there.

    The kind is history or drift; a cell is a series, and a step size (s) of it.
    """
    path = drift_path(folder, study) if kind == "drift" else history_path(folder, study)
    content = read(folder / f"{study}.csv", series=True)[path]
    frame = read_csv(path, HISTORY_COLUMNS, content=content)
    names = _recorded_names(path, kind, frame.columns)
    values = {
        name: np.array([number(path, line, name, text) for line, text in frame[name].items()])
        for name in ("h", "t", *names)
    }
    labels = {
        axis.name: np.array([axis.same(text) for text in frame[axis.name]], object)
        for axis in (axes.STUDY, *axes.cell_axes())
        if axis.series and axis.name in frame.columns
    }
    recorded: list[Recorded | None] = []
    for curve, h in cells:
        rows = np.isclose(values["h"], h, rtol=1e-9, atol=0)
        for name, texts in labels.items():
            # Of a plain text NumPy drops zeros at the end.
            rows &= texts == np.array(getattr(curve, name), object)
        table = np.column_stack([values[name][rows] for name in ("t", *names)])
        # Problems with fewer multipliers leave the last columns empty.
        there = ~np.isnan(table).all(axis=0)
        table = table[np.argsort(table[:, 0])][:, there]
        # The constraint of ``lambda[bars.link]``, or the number of ``lambda_1``.
        own = (names[i].removeprefix(LAMBDA).strip("[]_") for i in np.flatnonzero(there[1:]))
        recorded.append(Recorded(table[:, 0], table[:, 1:], tuple(own)) if table.size else None)
    return path, recorded


def _recorded_names(path: Path, kind: str, columns: Iterable[str]) -> list[str]:
    """Columns of drifts or multipliers; refuses others."""
    names = [n for n in columns if n not in (*HISTORY_COLUMNS, *HISTORY_MAY_HAVE)]
    if kind == "drift":
        allowed, usable = ", ".join(DRIFTS), tuple(names) == DRIFTS
        actual = ""
    else:
        names = [n for n in names if n != ENERGY and not n.startswith(f"{OUTPUT}[")]
        # Files of older versions number the multipliers.
        usable = bool(names) and all(re.fullmatch(rf"{LAMBDA}(\[.+\]|_\d+)", n) for n in names)
        allowed = "lambda[name of a constraint]"
        actual = f", given {', '.join(names) or 'none'}"
    if not usable:
        raise ResultsError(f"{path}, line 1: the columns after t must be {allowed}{actual}")
    return names
